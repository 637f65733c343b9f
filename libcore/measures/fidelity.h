/* fidelity.h: how far the voxels of a block are from the surface that they stand for.
 *
 * The distance of a voxel is that of its middle from the nearest point of the triangles in it, at
 * most half the diagonal of a cell. Its normal is compared with those of the triangles in it, by
 * the area that each has there; where it is two-sided, up to the sign.
 */
#ifndef PBS_FIDELITY_H
#define PBS_FIDELITY_H

#include "libcore/voxels/block.h"

typedef struct pbs_fidelity {
    uint64_t voxels;
    double distance_sum, distance_max; /* in voxels */
    double normal_sum, normal_max;     /* degrees; the sum times the area in square voxels */
    double area;
} pbs_fidelity;

/* One thread's scratch. */
typedef struct pbs_fidelity_block pbs_fidelity_block;
pbs_code pbs_fidelity_new(pbs_run *run, pbs_fidelity_block **out, pbs_err *err);
void pbs_fidelity_free(pbs_fidelity_block *f); /* NULL is fine */

/* at, v: a block and its voxels, as of pbs_block_end, borrowed until the end. Without normals the
 * distance alone is measured. Errors: PBS_LIMIT. */
pbs_code pbs_fidelity_begin(pbs_fidelity_block *f, const uint32_t at[3], const pbs_voxels *v,
                            pbs_err *err);
/* Its triangles, as of pbs_block_add. */
pbs_code pbs_fidelity_add(pbs_fidelity_block *f, const pbs_mesh *mesh, const uint32_t *triangles,
                          size_t count, const pbs_to_grid *to, pbs_sides sides, pbs_err *err);
void pbs_fidelity_end(pbs_fidelity_block *f, pbs_fidelity *out);

/* Adds b to a. */
void pbs_fidelity_sum(pbs_fidelity *a, const pbs_fidelity *b);
#endif
