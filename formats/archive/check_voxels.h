/* check_voxels.h: what check.c asks of voxels: every one of them, and that the levels of detail fit
 * together. */
#ifndef PBS_CHECK_VOXELS_H
#define PBS_CHECK_VOXELS_H

#include "formats/scene/node.h"
#include "formats/voxels/voxels.h"

typedef struct pbs_voxel_check pbs_voxel_check;

/* channels: of the file's voxels. name: the file, borrowed. Errors: PBS_LIMIT. */
pbs_code pbs_voxel_check_new(pbs_run *run, const char *name, uint32_t channels,
                             pbs_voxel_check **out, pbs_err *err);
void pbs_voxel_check_free(pbs_voxel_check *v); /* NULL is fine */

/* Every NODE chunk, in order. */
pbs_code pbs_voxel_check_node(pbs_voxel_check *v, const pbs_node *n, pbs_err *err);
/* Every VOXL or VFAC chunk. index: in the file's directory. Errors: PBS_DATA. */
pbs_code pbs_voxel_check_chunk(pbs_voxel_check *v, const pbs_chunk *c, size_t index, pbs_err *err);

/* When all has come, with so many materials: lists of faces are long enough, children are one level
 * finer and in their parent. With a reader that is mapped, and its directory, also that parents
 * have exactly the voxels that their children have a part in, and their faces; NULL: that is left
 * out. Memory does not grow with the voxels. */
pbs_code pbs_voxel_check_end(pbs_voxel_check *v, uint32_t materials, pbs_reader *r,
                             const pbs_chunk *entries, pbs_err *err);
#endif
