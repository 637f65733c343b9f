/* raster_inner.h: what raster.c and raster_avx2.c share. The two compute the same expressions in
 * the same order, so that they agree bit by bit.
 */
#ifndef PBS_RASTER_INNER_H
#define PBS_RASTER_INNER_H

#include "libcore/gbuffer/raster.h"

/* Triangles whose box has longer sides (1/256 pixel) overflow 32-bit edge functions: they are
 * drawn by pbs_raster_large. The margin is for the pixels that a vector reaches past the box. */
#define PBS_RASTER_SMALL (1 << 14)

#if defined(__x86_64__)
#define PBS_RASTER_AVX2 1
#endif

static inline uint32_t pbs_float_bits(float z) {
    uint32_t b;
    memcpy(&b, &z, sizeof b);
    return b;
}

/* The bits of 1.0f: depths 0 .. 1 the other way round. */
#define PBS_RASTER_FAR 0x3f800000

/* Branch-free: whether a fragment wins cannot be predicted. */
static inline void pbs_raster_put(uint64_t *key, uint32_t bits, uint32_t id) {
    uint64_t near = (uint64_t)bits << 32 | id, far = (uint64_t)(PBS_RASTER_FAR - bits) << 32 | id;
    uint64_t a = key[0], b = key[1];
    key[0] = near < a ? near : a;
    key[1] = far < b ? far : b;
}

static inline uint64_t *pbs_raster_at(const pbs_raster *r, int32_t x, int32_t y) {
    return r->key + 2 * ((size_t)(y - (int32_t)r->y0) * r->width + (size_t)x);
}

/* Depth of a triangle: z = clamp(z0 + (float)(y - y0) * gy + (float)(x - x0) * gx), in 1/256
 * pixel from the first corner, so that it does not depend on how the picture is cut into bands. */
typedef struct pbs_raster_plane {
    int32_t x0, y0;
    float z0, gx, gy, lo, hi;
} pbs_raster_plane;

static inline float pbs_raster_row_z(const pbs_raster_plane *p, int32_t y) {
    return p->z0 + (float)(y * PBS_SUBPIXELS + PBS_SUBPIXELS / 2 - p->y0) * p->gy;
}
static inline float pbs_raster_clamp_z(const pbs_raster_plane *p, float z) {
    z = z > p->lo ? z : p->lo;
    return z < p->hi ? z : p->hi;
}
static inline float pbs_raster_z(const pbs_raster_plane *p, float row, int32_t x) {
    float dx = (float)(x * PBS_SUBPIXELS + PBS_SUBPIXELS / 2 - p->x0);
    return pbs_raster_clamp_z(p, row + dx * p->gx);
}

/* One row of a triangle, x0 .. x1, which is not empty. */
typedef void (*pbs_raster_span)(pbs_raster *r, const pbs_raster_plane *p, int32_t x0, int32_t x1,
                                int32_t y, uint32_t id, void *ctx);

/* Any triangle, in 64-bit integers, row by row. */
void pbs_raster_large(pbs_raster *r, const pbs_snapped *const v[3], uint32_t id,
                      pbs_raster_span span, void *ctx);

#ifdef PBS_RASTER_AVX2
void pbs_raster_snap_avx2(const double m[12], const float *position, uint32_t n, pbs_snapped *out,
                          int32_t box[4], int32_t *bad);
void pbs_raster_draw_avx2(pbs_raster *r, const pbs_snapped *v, const uint16_t *index,
                          uint32_t count, uint32_t first);
#endif
#endif
