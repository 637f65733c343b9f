/* coarsen.h: all coarser levels of voxels from the voxels alone, in one pass (paper 2, section 3,
 * "Level of detail").
 *
 * The paper sorts the voxels of a chunk and compacts runs of equal parents. Voxels that come in
 * Morton order need no sorting, and their parents come in Morton order again, so that all levels
 * are made while the finest streams by: memory is a buffer a level, whatever the input.
 *
 * A parent's faces are the OR of its children's, so it covers them; faces on the border of its
 * chunk are added ("caps"). Attributes are means by weight, which are not rounded from level to
 * level: sums of the finest voxels are carried up. A mean normal that is short (PBS_COARSEN_THIN)
 * says little, and nothing where it vanishes: the parent gets the normal of its heaviest child, the
 * first of them, and is two-sided. Else it is two-sided if its heaviest child is; without normals,
 * if any child is. The same child gives colours if there is no weight at all. Per face: colours by
 * weight, materials by the largest sum of the weights that the children's were chosen with, ties to
 * the lower id; a cap that no child has takes all other faces together, or UINT32_MAX if there are
 * none.
 */
#ifndef PBS_COARSEN_H
#define PBS_COARSEN_H

#include "libcore/ground/run.h"
#include "libcore/voxels/voxel.h"

#define PBS_COARSEN_THIN 0.3

typedef struct pbs_coarsen pbs_coarsen;

/* What comes out: voxels of a chunk of a level, 1 .. levels, in Morton order; several calls for a
 * chunk follow each other, with the chunks of other levels in between; done: this was the last of
 * it, and may have no voxels. A chunk is done before the one above it, and before another one of
 * its level begins. faces: the list that v->face of this call points into. All arrays are borrowed
 * until it returns. */
typedef struct pbs_coarsen_sink {
    void *ctx;
    pbs_code (*voxels)(void *ctx, uint32_t level, const uint32_t chunk[3], const pbs_voxels *v,
                       const uint32_t *faces, size_t face_count, bool done, pbs_err *err);
} pbs_coarsen_sink;

/* channels: of the input, PBS_POSITION always; without weights all voxels weigh the same. levels:
 * how many levels are made above the finest, at most 31; cells of level l are given and made by
 * chunks of 256^3. per_face_colour: what the entries of face lists are. Takes 50 to 500 KiB a
 * level. Errors: PBS_LIMIT. */
pbs_code pbs_coarsen_new(pbs_run *run, uint32_t channels, uint32_t levels, bool per_face_colour,
                         const pbs_coarsen_sink *sink, pbs_coarsen **out, pbs_err *err);
/* Voxels of a chunk of the finest level; chunks in Morton order, a chunk in any number of calls
 * that follow each other. faces: what v->face points into. Errors: the sink's; PBS_DATA if a voxel
 * does not come in Morton order, which may be found at a later call or at the end, or if its list
 * of faces is not in that of all. */
pbs_code pbs_coarsen_add(pbs_coarsen *c, const uint32_t chunk[3], const pbs_voxels *v,
                         const uint32_t *faces, size_t face_count, pbs_err *err);
/* Ends all chunks that are open. */
pbs_code pbs_coarsen_end(pbs_coarsen *c, pbs_err *err);
void pbs_coarsen_free(pbs_coarsen *c); /* NULL is fine */
#endif
