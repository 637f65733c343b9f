/* separate.h: the six-separating cells of triangles, exactly (paper 2, section 3; Laine 2013).
 *
 * A cell is hit if its crosshair meets the closed triangle (grid.h has the rule). For each of the
 * three axes that is a rasterisation at the middles of pixels: the line through a middle meets the
 * triangle at a depth, whose floor is the cell. Lines that run within the triangle's plane meet it
 * in an interval, and all its cells are hit. All in doubles with error bounds, and in integers
 * where these do not decide.
 */
#ifndef PBS_SEPARATE_H
#define PBS_SEPARATE_H

#include "libcore/voxels/grid.h"

typedef struct pbs_hit {
    uint32_t cell;     /* PBS_CELL, inside the block or next to it */
    uint32_t triangle; /* of the batch */
} pbs_hit;

/* flush is called whenever the buffer may become too full, and must set count to 0. */
#define PBS_HITS 1024
typedef struct pbs_hits {
    uint32_t count;
    void (*flush)(void *ctx, struct pbs_hits *hits);
    void *ctx;
    pbs_hit hit[PBS_HITS];
} pbs_hits;

/* Appends the hits of all triangles of the batch in the block and the layer of one cell around it
 * (of that layer: at least the cells that share a face with one of the block). A cell may come
 * several times for one triangle. What is left in the buffer is not flushed. simd: may use AVX2;
 * same hits, in the same order, either way. Time grows with the cells that are hit, and at most
 * with the length of the triangle's edges inside the block. */
void pbs_separate(const pbs_triangles *t, bool simd, pbs_hits *out);
#endif
