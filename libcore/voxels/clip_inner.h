/* clip_inner.h: what the parts of clip.c share. All clip_*_inner.h are compiled twice, in clip.c
 * and, with AVX2, in clip_avx2.c; every number is made by the same IEEE operations, so both give
 * the same bits.
 */
#ifndef PBS_CLIP_INNER_H
#define PBS_CLIP_INNER_H

#include "libcore/voxels/clip.h"

/* Exactly: whether the closed triangle p[corner][axis] has a point in the half-open cell. Doubles
 * decide nearly always. */
bool pbs_clip_meets(const double p[3][3], const int cell[3]);

/* The same where the cell lies above a pixel that is covered, so that only the plane decides. */
bool pbs_clip_meets_plane(const double p[3][3], const int cell[3]);

/* The normal, twice as long as the area, each component right to a rounding: 0 if it is 0. */
void pbs_clip_normal(const double p[3][3], double n[3]);

void pbs_clip_avx2(const pbs_triangles *t, bool centroids, pbs_fragments *out);

static inline void clip_put(pbs_fragments *out, uint32_t cell, uint32_t triangle, double area,
                            float u, float v) {
    out->fragment[out->count++] = (pbs_fragment){cell, triangle, area, u, v};
    if (out->count == PBS_FRAGMENTS) out->flush(out->ctx, out);
}

/* A centroid that rounding may have pushed out of the triangle. */
static inline void clip_put_at(pbs_fragments *out, uint32_t cell, uint32_t triangle, double area,
                               double u, double v) {
    float a = u > 0 ? (float)u : 0, b = v > 0 ? (float)v : 0;
    a = a < 1 ? a : 1;
    float most = 1 - a;
    clip_put(out, cell, triangle, area, a, b < most ? b : most);
}

/* The largest whole number that is not greater, of numbers that fit an int. */
static inline int clip_floor(double x) {
    int i = (int)x;
    return i - (x < i);
}
#endif
