/* passes.h: the painters that remember the last frame, splat.h and reduce.h, as parts of a canvas:
 * made when they are first wanted, and freed with it. */
#ifndef PBS_PASSES_H
#define PBS_PASSES_H

#include "cmd/pbs-view/draw/reduce.h"
#include "cmd/pbs-view/draw/splat.h"

/* Surfels by deferred splatting. Errors: PBS_LIMIT, PBS_INTERNAL. */
pbs_code pbs_passes_splat(pbs_canvas *canvas, const pbs_resident *nodes, size_t count,
                          const pbs_splat_options *options, pbs_err *err);
/* Of the last one; waits for the device. */
pbs_code pbs_passes_splat_count(pbs_canvas *canvas, pbs_splat_counts *out, pbs_err *err);

/* Points of the nodes' prefixes, whatever the radius. A pass has the camera that the canvas was
 * begun with and is made once for two eyes (paper 3, section 3.3.1): the first call after a begin
 * goes on with it. wait: until they are those for this frame's camera, else *again says whether the
 * caller should come again although nothing moves. */
pbs_code pbs_passes_points(pbs_canvas *canvas, const pbs_resident *nodes, size_t count,
                           const pbs_reduce_options *options, bool wait, bool *again, pbs_err *err);
/* Points that the last pass has kept; waits for the device. */
pbs_code pbs_passes_points_count(pbs_canvas *canvas, uint64_t *kept, pbs_err *err);
#endif
