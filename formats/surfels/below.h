/* below.h: candidates of a node from the surfels of the nodes below it (paper 1, section 3.4,
 * bottom-up).
 */
#ifndef PBS_BELOW_H
#define PBS_BELOW_H

#include "formats/surfels/keep.h"
#include "formats/scene/node.h"
#include "libcore/gbuffer/visible.h"

typedef struct pbs_below pbs_below; /* buffers, reused from node to node */

pbs_code pbs_below_new(pbs_run *run, pbs_keep *keep, pbs_below **out, pbs_err *err);
void pbs_below_free(pbs_below *b); /* NULL is fine */

/* Replaces *points (room *cap), the candidates that the geometry of `node` gave, by what can be
 * seen of them and of the surfels of all nodes that stand for their part of it (hierarchy.h);
 * these come as prefixes that are just dense in the node's views. nodes: at least up to `node`;
 * used: as for pbs_plan_below. *splats: how many surfels were looked at. Errors: PBS_LIMIT,
 * PBS_IO, PBS_CANCEL; PBS_DATA for a node whose numbers fit nothing. */
pbs_code pbs_below_add(pbs_below *b, const pbs_node *nodes, const uint64_t *used, uint32_t node,
                       uint32_t channels, pbs_points *points, size_t *cap, uint64_t *splats,
                       pbs_err *err);
#endif
