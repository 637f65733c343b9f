/* retained.h: surfels of this process's memory, kept on the device from their first draw on, by the
 * painters that need that: splat.h and reduce.h. They belong to the canvas. */
#ifndef PBS_RETAINED_H
#define PBS_RETAINED_H

#include "cmd/pbs-view/reduce.h"
#include "cmd/pbs-view/splat.h"

/* As pbs_canvas_surfels, by deferred splatting. A node is the same as in the last frame if records
 * and transform are. Errors: PBS_LIMIT, PBS_INTERNAL. */
pbs_code pbs_retained_splat(pbs_canvas *canvas, const pbs_surfels *nodes, size_t count,
                            const pbs_splat_options *options, pbs_err *err);
/* Of the last one; waits for the device. */
pbs_code pbs_retained_splat_count(pbs_canvas *canvas, pbs_splat_counts *out, pbs_err *err);

/* Points of the nodes' prefixes, whatever the radius. wait: until they are those for this
 * frame's camera, else *again says whether the caller should come again although nothing moves. */
pbs_code pbs_retained_points(pbs_canvas *canvas, const pbs_surfels *nodes, size_t count,
                             const pbs_reduce_options *options, bool wait, bool *again,
                             pbs_err *err);
/* Points that the last pass has kept; waits for the device. */
pbs_code pbs_retained_points_count(pbs_canvas *canvas, uint64_t *kept, pbs_err *err);
#endif
