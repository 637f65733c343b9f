/* keep.h: surfels of nodes that are done, kept in $TMPDIR until the nodes above need prefixes of
 * them. In memory is only where each node begins.
 */
#ifndef PBS_KEEP_H
#define PBS_KEEP_H

#include "formats/surfels/points.h"
#include "libcore/data/vec.h"

typedef struct pbs_keep pbs_keep;

/* channels: of all surfels; spacing always. Errors: PBS_IO, PBS_LIMIT. */
pbs_code pbs_keep_new(pbs_run *run, uint32_t channels, pbs_keep **out, pbs_err *err);
void pbs_keep_free(pbs_keep *k); /* NULL is fine */

/* Nodes in rising order; nodes may be left out. covering: radius of the whole set. */
pbs_code pbs_keep_put(pbs_keep *k, uint32_t node, const pbs_points *surfels, double covering,
                      pbs_err *err);

/* The shortest prefix whose covering radius is at most `radius`, or all; *covered is its covering
 * radius. A node that is not there has 0. */
pbs_code pbs_keep_prefix(pbs_keep *k, uint32_t node, double radius, size_t *prefix, double *covered,
                         pbs_err *err);

/* Of the whole set, in the coordinates of its positions. A node that is not there: empty. */
pbs_box pbs_keep_box(const pbs_keep *k, uint32_t node);

/* The first `count` surfels, which there are, into *out, whose room *cap grows as needed. */
pbs_code pbs_keep_get(pbs_keep *k, uint32_t node, size_t count, pbs_points *out, size_t *cap,
                      pbs_err *err);
#endif
