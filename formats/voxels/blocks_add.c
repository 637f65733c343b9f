/* blocks_add.c: the triangles near a block go into it. */
#include "formats/voxels/blocks.h"

static pbs_code add(void *ctx, const pbs_mesh *mesh, const uint32_t *triangles, size_t count,
                    const pbs_to_grid *to, pbs_sides sides, pbs_err *err) {
    return pbs_block_add(ctx, mesh, triangles, count, to, sides, err);
}

pbs_code pbs_nearby_add(const pbs_nearby *n, pbs_block *block, pbs_err *err) {
    return pbs_nearby_visit(n, add, block, err);
}
