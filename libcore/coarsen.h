/* coarsen.h: all coarser levels of voxels from the voxels alone, in one pass (paper 2, section 3,
 * "Level of detail").
 *
 * The paper sorts the voxels of a chunk and compacts runs of equal parents. Voxels that come in
 * Morton order need no sorting, and their parents come in Morton order again, so that all levels
 * are made while the finest streams by: memory is a buffer a level, whatever the input.
 *
 * A parent's faces are the OR of its children's, so it covers them; faces on the border of its
 * chunk are added ("caps"). Attributes are means by weight, which are not rounded from level to
 * level: sums of the finest voxels are carried up. A mean normal that vanishes is that of the
 * heaviest child, the first of them; the parent is two-sided if the mean is short
 * (PBS_COARSEN_THIN) or the heaviest child is. Per face: colours by weight, materials by the
 * largest sum of weights, ties to the lower id.
 */
#ifndef PBS_COARSEN_H
#define PBS_COARSEN_H

#include "libcore/run.h"
#include "libcore/voxel.h"

#define PBS_COARSEN_THIN 0.3

typedef struct pbs_coarsen pbs_coarsen;

/* What comes out: voxels of a chunk of a level, in Morton order; several calls for a chunk follow
 * each other, with the chunks of other levels in between; done: this was the last of it, and may
 * have no voxels. All arrays are borrowed until it returns. */
typedef struct pbs_coarsen_sink {
    void *ctx;
    pbs_code (*voxels)(void *ctx, uint32_t level, const uint32_t chunk[3], const pbs_voxels *v,
                       const uint32_t *faces, size_t face_count, bool done, pbs_err *err);
} pbs_coarsen_sink;

/* channels: of the input, PBS_POSITION always; without weights all voxels weigh the same. levels:
 * how many levels are made above the finest; cells of level l are given and made by chunks of
 * 256^3. per_face_colour: what the entries of face lists are. Errors: PBS_LIMIT. */
pbs_code pbs_coarsen_new(pbs_run *run, uint32_t channels, uint32_t levels, bool per_face_colour,
                         const pbs_coarsen_sink *sink, pbs_coarsen **out, pbs_err *err);
/* Voxels of a chunk of the finest level; chunks in Morton order, a chunk in any number of calls
 * that follow each other. faces: what v->face points into. Errors: the sink's; PBS_DATA if a voxel
 * does not come in Morton order. */
pbs_code pbs_coarsen_add(pbs_coarsen *c, const uint32_t chunk[3], const pbs_voxels *v,
                         const uint32_t *faces, size_t face_count, pbs_err *err);
/* Ends all chunks that are open. */
pbs_code pbs_coarsen_end(pbs_coarsen *c, pbs_err *err);
void pbs_coarsen_free(pbs_coarsen *c); /* NULL is fine */
#endif
