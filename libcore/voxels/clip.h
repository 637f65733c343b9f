/* clip.h: triangles cut along the faces of cells: which cells they touch, and the area and centroid
 * of the piece in each (paper 2, section 3: "exact intersection area").
 *
 * Which cells is exact: the conservative set of grid.h, half-open cells, decided in doubles with
 * error bounds and in integers where these do not decide. Areas and centroids are computed in
 * floating point: the pieces of a triangle sum to its area within 1e-9 of it and 1e-14 square
 * voxels (needles a few 2^-32 wide have hardly more than that), and each is right within 1e-6 of a
 * square voxel, and of itself if it is larger than that; a cell that the triangle merely touches
 * has area 0. What a cell gets is made from the triangle's place relative to the cell alone: in
 * another block, and moved by whole voxels, it is the same to the bit.
 */
#ifndef PBS_CLIP_H
#define PBS_CLIP_H

#include "libcore/voxels/grid.h"

typedef struct pbs_fragment {
    uint32_t cell;     /* PBS_CELL, inside the block */
    uint32_t triangle; /* of the batch */
    double area;       /* of the piece, square voxels, at least 0 */
    float u, v;        /* its centroid: corner 0 + u (corner 1 - corner 0) + v (corner 2 - 0); u, v,
                          1-u-v >= 0 */
} pbs_fragment;

/* flush is called whenever the buffer may become too full, and must set count to 0. */
#define PBS_FRAGMENTS 512
typedef struct pbs_fragments {
    uint32_t count;
    void (*flush)(void *ctx, struct pbs_fragments *fragments);
    void *ctx;
    pbs_fragment fragment[PBS_FRAGMENTS];
} pbs_fragments;

/* Appends a fragment for each cell of the block and triangle of the batch that meet, each once.
 * What is left in the buffer is not flushed. centroids false: u and v are not computed (0), for
 * triangles of one colour. simd: may use AVX2; same fragments, in the same order, either way. Time
 * grows with the number of fragments, not with the box of the triangle. */
void pbs_clip(const pbs_triangles *t, bool centroids, bool simd, pbs_fragments *out);
#endif
