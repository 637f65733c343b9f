/* raster_avx2.c: the vector half of the rasteriser: eight triangles at a time until it is known
 * which of them hold a pixel centre at all, then eight pixels at a time.
 *
 * About half of the triangles of a detailed part are smaller than a pixel and hold none, and most
 * others hold one or two; so the front end is what counts.
 */
#include "libcore/gbuffer/raster_inner.h"

#ifdef PBS_RASTER_AVX2
#include <immintrin.h>

#define AVX2        __attribute__((target("avx2")))
#define AVX2_INLINE __attribute__((target("avx2"), always_inline)) static inline

/* ---- vertices, four at a time ---- */

AVX2_INLINE __m256d row_of(const double *m, __m256d x, __m256d y, __m256d z) {
    __m256d s = _mm256_mul_pd(_mm256_set1_pd(m[0]), x);
    s = _mm256_add_pd(s, _mm256_mul_pd(_mm256_set1_pd(m[1]), y));
    s = _mm256_add_pd(s, _mm256_mul_pd(_mm256_set1_pd(m[2]), z));
    return _mm256_add_pd(s, _mm256_set1_pd(m[3]));
}

AVX2_INLINE __m256d clamp_pd(__m256d v, double lo, double hi) {
    return _mm256_max_pd(_mm256_min_pd(v, _mm256_set1_pd(hi)), _mm256_set1_pd(lo));
}

AVX2 void pbs_raster_snap_avx2(const double m[12], const float *position, uint32_t n,
                               pbs_snapped *out, int32_t box[4], int32_t *bad) {
    const double limit = 1 << 29;
    __m128i lx = _mm_set1_epi32(box[0]), ly = _mm_set1_epi32(box[1]);
    __m128i hx = _mm_set1_epi32(box[2]), hy = _mm_set1_epi32(box[3]);
    __m256d none = _mm256_setzero_pd();
    for (uint32_t i = 0; i < n; i += 4, position += 12, out += 4) {
        __m128 a = _mm_loadu_ps(position), b = _mm_loadu_ps(position + 4);
        __m128 c = _mm_loadu_ps(position + 8); /* x0y0z0x1 y1z1x2y2 z2x3y3z3 */
        __m128 x2y2x3y3 = _mm_shuffle_ps(b, c, _MM_SHUFFLE(2, 1, 3, 2));
        __m128 y0z0y1z1 = _mm_shuffle_ps(a, b, _MM_SHUFFLE(1, 0, 2, 1));
        __m256d x = _mm256_cvtps_pd(_mm_shuffle_ps(a, x2y2x3y3, _MM_SHUFFLE(2, 0, 3, 0)));
        __m256d y = _mm256_cvtps_pd(_mm_shuffle_ps(y0z0y1z1, x2y2x3y3, _MM_SHUFFLE(3, 1, 2, 0)));
        __m256d z = _mm256_cvtps_pd(_mm_shuffle_ps(y0z0y1z1, c, _MM_SHUFFLE(3, 0, 3, 1)));
        __m256d sx = row_of(m, x, y, z), sy = row_of(m + 4, x, y, z), sz = row_of(m + 8, x, y, z);
        __m256d nan = _mm256_add_pd(_mm256_sub_pd(sx, sx), _mm256_sub_pd(sy, sy));
        nan = _mm256_add_pd(nan, _mm256_sub_pd(sz, sz));
        none = _mm256_add_pd(none, nan);
        __m256i wide = _mm256_castpd_si256(_mm256_cmp_pd(nan, nan, _CMP_UNORD_Q));
        __m128i flag = _mm_castps_si128(_mm_shuffle_ps(
            _mm_castsi128_ps(_mm256_castsi256_si128(wide)),
            _mm_castsi128_ps(_mm256_extracti128_si256(wide, 1)), _MM_SHUFFLE(2, 0, 2, 0)));
        __m128i ix = _mm256_cvtpd_epi32(clamp_pd(sx, -limit, limit));
        __m128i iy = _mm256_cvtpd_epi32(clamp_pd(sy, -limit, limit));
        __m128i iz = _mm_castps_si128(_mm256_cvtpd_ps(clamp_pd(sz, 0, 1)));
        lx = _mm_min_epi32(lx, ix), ly = _mm_min_epi32(ly, iy);
        hx = _mm_max_epi32(hx, ix), hy = _mm_max_epi32(hy, iy);
        __m128i xy01 = _mm_unpacklo_epi32(ix, iy), xy23 = _mm_unpackhi_epi32(ix, iy);
        __m128i zf01 = _mm_unpacklo_epi32(iz, flag), zf23 = _mm_unpackhi_epi32(iz, flag);
        _mm_store_si128((__m128i *)(void *)(out + 0), _mm_unpacklo_epi64(xy01, zf01));
        _mm_store_si128((__m128i *)(void *)(out + 1), _mm_unpackhi_epi64(xy01, zf01));
        _mm_store_si128((__m128i *)(void *)(out + 2), _mm_unpacklo_epi64(xy23, zf23));
        _mm_store_si128((__m128i *)(void *)(out + 3), _mm_unpackhi_epi64(xy23, zf23));
    }
    if (_mm256_movemask_pd(_mm256_cmp_pd(none, none, _CMP_UNORD_Q))) *bad = -1;
    int32_t lane[4][4];
    _mm_storeu_si128((__m128i *)lane[0], lx), _mm_storeu_si128((__m128i *)lane[1], ly);
    _mm_storeu_si128((__m128i *)lane[2], hx), _mm_storeu_si128((__m128i *)lane[3], hy);
    for (int k = 0; k < 4; k++) {
        box[0] = lane[0][k] < box[0] ? lane[0][k] : box[0];
        box[1] = lane[1][k] < box[1] ? lane[1][k] : box[1];
        box[2] = lane[2][k] > box[2] ? lane[2][k] : box[2];
        box[3] = lane[3][k] > box[3] ? lane[3][k] : box[3];
    }
}

/* ---- pixels ---- */

/* The depth of pixels x .. x + 7 of a row; pbs_raster_z in eight lanes. */
AVX2_INLINE __m256 eight_z(const pbs_raster_plane *p, float row, __m256i x) {
    __m256 dx = _mm256_cvtepi32_ps(_mm256_sub_epi32(x, _mm256_set1_epi32(p->x0)));
    __m256 z = _mm256_add_ps(_mm256_set1_ps(row), _mm256_mul_ps(dx, _mm256_set1_ps(p->gx)));
    z = _mm256_max_ps(z, _mm256_set1_ps(p->lo));
    return _mm256_min_ps(z, _mm256_set1_ps(p->hi));
}

AVX2_INLINE void put_two(uint64_t *key, __m256i k) {
    __m256i old = _mm256_loadu_si256((const __m256i *)(const void *)key);
    __m256i less = _mm256_cmpgt_epi64(old, k);
    _mm256_storeu_si256((__m256i *)(void *)key, _mm256_blendv_epi8(old, k, less));
}

/* Eight pixels side by side; those outside `in` get keys that never win. May write back what it
 * read up to seven pixels further on. */
AVX2_INLINE void put_eight(uint64_t *key, __m256 z, __m256i in, __m256i id) {
    __m256i never = _mm256_set1_epi32(0x7fffffff), bits = _mm256_castps_si256(z);
    __m256i near = _mm256_blendv_epi8(never, bits, in);
    __m256i far =
        _mm256_blendv_epi8(never, _mm256_sub_epi32(_mm256_set1_epi32(PBS_RASTER_FAR), bits), in);
    __m256i n0 = _mm256_unpacklo_epi32(id, near), n2 = _mm256_unpackhi_epi32(id, near);
    __m256i f0 = _mm256_unpacklo_epi32(id, far), f2 = _mm256_unpackhi_epi32(id, far);
    __m256i k0 = _mm256_unpacklo_epi64(n0, f0), k1 = _mm256_unpackhi_epi64(n0, f0);
    __m256i k2 = _mm256_unpacklo_epi64(n2, f2), k3 = _mm256_unpackhi_epi64(n2, f2);
    put_two(key + 0, _mm256_permute2x128_si256(k0, k1, 0x20));
    put_two(key + 4, _mm256_permute2x128_si256(k2, k3, 0x20));
    put_two(key + 8, _mm256_permute2x128_si256(k0, k1, 0x31));
    put_two(key + 12, _mm256_permute2x128_si256(k2, k3, 0x31));
}

AVX2_INLINE __m256i ramp(void) {
    return _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
}

AVX2_INLINE __m256i centres(int32_t x) {
    __m256i col = _mm256_slli_epi32(ramp(), 8);
    return _mm256_add_epi32(_mm256_set1_epi32(x * PBS_SUBPIXELS + PBS_SUBPIXELS / 2), col);
}

AVX2 static void span(pbs_raster *r, const pbs_raster_plane *p, int32_t x0, int32_t x1, int32_t y,
                      uint32_t id, void *ctx) {
    (void)ctx;
    float row = pbs_raster_row_z(p, y);
    uint64_t *key = pbs_raster_at(r, 0, y);
    __m256i ids = _mm256_set1_epi32((int32_t)id);
    for (int32_t x = x0; x <= x1; x += 8) {
        __m256i in = _mm256_cmpgt_epi32(_mm256_set1_epi32(x1 - x + 1), ramp());
        put_eight(key + 2 * x, eight_z(p, row, centres(x)), in, ids);
    }
    r->fragments += (uint64_t)(x1 - x0 + 1);
}

/* ---- triangles, eight at a time ---- */

/* What the front end leaves for the triangles that hold a pixel centre of the band. */
typedef struct batch {
    int32_t px0[8], px1[8], py0[8], py1[8]; /* the pixels of the box, cut to the band */
    int32_t e[3][8], ex[3][8], ey[3][8];    /* edges at pixel (px0, py0), in pixels (raster.c) */
    int32_t x0[8], y0[8];
    float z0[8], gx[8], gy[8], lo[8], hi[8];
} __attribute__((aligned(32))) batch;

typedef struct corner {
    __m256i x, y;
    __m256 z;
} corner;

typedef struct planes {
    __m256 gx, gy, lo, hi;
} planes;
typedef struct edges {
    __m256i e[3], x[3], y[3];
} edges;
typedef struct pixel_box {
    __m256i x0, x1, y0, y1;
} pixel_box;

/* One corner of eight triangles: eight vertices, turned into columns. */
AVX2_INLINE corner load_corner(const pbs_snapped *v, const uint16_t *index) {
    __m256i p[4];
#pragma GCC unroll 4
    for (int t = 0; t < 4; t++) {
        const __m128i *a = (const __m128i *)(const void *)(v + index[3 * t]);
        const __m128i *b = (const __m128i *)(const void *)(v + index[3 * t + 12]);
        p[t] = _mm256_inserti128_si256(_mm256_castsi128_si256(_mm_load_si128(a)), _mm_load_si128(b),
                                       1);
    }
    __m256i a = _mm256_unpacklo_epi32(p[0], p[1]), b = _mm256_unpacklo_epi32(p[2], p[3]);
    __m256i c = _mm256_unpackhi_epi32(p[0], p[1]), d = _mm256_unpackhi_epi32(p[2], p[3]);
    return (corner){_mm256_unpacklo_epi64(a, b), _mm256_unpackhi_epi64(a, b),
                    _mm256_castsi256_ps(_mm256_unpacklo_epi64(c, d))};
}

AVX2_INLINE __m256i min3(__m256i a, __m256i b, __m256i c) {
    return _mm256_min_epi32(_mm256_min_epi32(a, b), c);
}
AVX2_INLINE __m256i max3(__m256i a, __m256i b, __m256i c) {
    return _mm256_max_epi32(_mm256_max_epi32(a, b), c);
}
AVX2_INLINE int lanes(__m256i m) {
    return _mm256_movemask_ps(_mm256_castsi256_ps(m));
}
AVX2_INLINE void keep(int32_t *to, __m256i v) {
    _mm256_store_si256((__m256i *)(void *)to, v);
}

/* The first and last pixel centre in lo .. hi, cut to a .. b. Returns where there is one. */
AVX2_INLINE __m256i pixels(__m256i lo, __m256i hi, int32_t a, int32_t b, __m256i *first,
                           __m256i *last) {
    lo = _mm256_srai_epi32(_mm256_add_epi32(lo, _mm256_set1_epi32(127)), 8);
    hi = _mm256_srai_epi32(_mm256_sub_epi32(hi, _mm256_set1_epi32(128)), 8);
    *first = _mm256_max_epi32(lo, _mm256_set1_epi32(a));
    *last = _mm256_min_epi32(hi, _mm256_set1_epi32(b));
    return _mm256_cmpgt_epi32(_mm256_add_epi32(*last, _mm256_set1_epi32(1)), *first);
}

AVX2_INLINE void find_planes(planes *p, const corner c[3], const __m256i ex[3], const __m256i ey[3],
                             __m256i area) {
    __m256 zero = _mm256_setzero_ps();
    __m256 inv = _mm256_div_ps(_mm256_set1_ps(1), _mm256_cvtepi32_ps(area));
    __m256 d1 = _mm256_sub_ps(c[1].z, c[0].z), d2 = _mm256_sub_ps(c[2].z, c[0].z);
    __m256 x1 = _mm256_cvtepi32_ps(ex[0]), y1 = _mm256_cvtepi32_ps(ey[0]);
    __m256 x2 = _mm256_cvtepi32_ps(ex[2]), y2 = _mm256_cvtepi32_ps(ey[2]);
    __m256 gx = _mm256_sub_ps(_mm256_mul_ps(d2, _mm256_sub_ps(zero, y1)), _mm256_mul_ps(d1, y2));
    __m256 gy = _mm256_sub_ps(_mm256_mul_ps(d2, x1), _mm256_mul_ps(d1, _mm256_sub_ps(zero, x2)));
    p->gx = _mm256_mul_ps(gx, inv), p->gy = _mm256_mul_ps(gy, inv);
    p->lo = _mm256_min_ps(c[0].z, _mm256_min_ps(c[1].z, c[2].z));
    p->hi = _mm256_max_ps(c[0].z, _mm256_max_ps(c[1].z, c[2].z));
}

/* Edge functions at the first pixel of each box, as raster.c has them. Returns the lanes that
 * have an area. */
AVX2_INLINE int find_edges(edges *o, planes *p, const corner c[3], const pixel_box *px) {
    const __m256i half = _mm256_set1_epi32(PBS_SUBPIXELS / 2), one = _mm256_set1_epi32(1);
    __m256i cx = _mm256_add_epi32(_mm256_slli_epi32(px->x0, 8), half);
    __m256i cy = _mm256_add_epi32(_mm256_slli_epi32(px->y0, 8), half);
    __m256i ex[3], ey[3], e[3];
#pragma GCC unroll 3
    for (int i = 0; i < 3; i++) {
        const corner *a = &c[i], *b = &c[(i + 1) % 3];
        ex[i] = _mm256_sub_epi32(b->x, a->x), ey[i] = _mm256_sub_epi32(b->y, a->y);
        e[i] = _mm256_sub_epi32(_mm256_mullo_epi32(ex[i], _mm256_sub_epi32(cy, a->y)),
                                _mm256_mullo_epi32(ey[i], _mm256_sub_epi32(cx, a->x)));
    }
    __m256i area = _mm256_add_epi32(_mm256_add_epi32(e[0], e[1]), e[2]);
    find_planes(p, c, ex, ey, area);
#pragma GCC unroll 3
    for (int i = 0; i < 3; i++) {
        o->x[i] = _mm256_sign_epi32(ex[i], area), o->y[i] = _mm256_sign_epi32(ey[i], area);
        /* Negative where y < 0, or y = 0 and x > 0: the edge owns the centres on it. */
        __m256i owns = _mm256_sub_epi32(_mm256_slli_epi32(o->y[i], 15), o->x[i]);
        __m256i bias = _mm256_add_epi32(_mm256_srai_epi32(owns, 31), one);
        o->e[i] = _mm256_srai_epi32(_mm256_sub_epi32(_mm256_sign_epi32(e[i], area), bias), 8);
    }
    return ~lanes(_mm256_cmpeq_epi32(area, _mm256_setzero_si256()));
}

AVX2_INLINE void put_one(uint64_t *key, uint32_t bits, uint32_t id) {
    uint64_t near = (uint64_t)bits << 32 | id, far = (uint64_t)(PBS_RASTER_FAR - bits) << 32 | id;
    __m128i k = _mm_insert_epi64(_mm_cvtsi64_si128((int64_t)near), (int64_t)far, 1);
    __m128i old = _mm_load_si128((const __m128i *)(const void *)key);
    __m128i less = _mm_cmpgt_epi64(old, k);
    _mm_store_si128((__m128i *)(void *)key, _mm_blendv_epi8(old, k, less));
}

/* Triangles whose box has at most 2 x 2 pixels: all tests and depths of all of them first, then
 * one loop over the fragments, however they are spread. tiny: which lanes. */
AVX2_INLINE void fill_tiny(pbs_raster *r, const corner *c, const edges *o, const planes *p,
                           const pixel_box *px, uint32_t first, int tiny) {
    const __m256i next = _mm256_set1_epi32(PBS_SUBPIXELS);
    const __m256i half = _mm256_set1_epi32(PBS_SUBPIXELS / 2);
    __m256i out[4];
    __m256i e0 = o->e[0], e1 = o->e[1], e2 = o->e[2];
    out[0] = _mm256_or_si256(_mm256_or_si256(e0, e1), e2);
    __m256i r0 = _mm256_sub_epi32(e0, o->y[0]), r1 = _mm256_sub_epi32(e1, o->y[1]);
    __m256i r2 = _mm256_sub_epi32(e2, o->y[2]);
    out[1] = _mm256_or_si256(_mm256_or_si256(r0, r1), r2);
    e0 = _mm256_add_epi32(e0, o->x[0]), e1 = _mm256_add_epi32(e1, o->x[1]);
    e2 = _mm256_add_epi32(e2, o->x[2]);
    out[2] = _mm256_or_si256(_mm256_or_si256(e0, e1), e2);
    r0 = _mm256_add_epi32(r0, o->x[0]), r1 = _mm256_add_epi32(r1, o->x[1]);
    r2 = _mm256_add_epi32(r2, o->x[2]);
    out[3] = _mm256_or_si256(_mm256_or_si256(r0, r1), r2);
    unsigned wide = (unsigned)lanes(_mm256_cmpgt_epi32(px->x1, px->x0));
    unsigned tall = (unsigned)lanes(_mm256_cmpgt_epi32(px->y1, px->y0)), lane = (unsigned)tiny;
    unsigned in = (~(unsigned)lanes(out[0]) & lane) |
                  (~(unsigned)lanes(out[1]) & lane & wide) << 8 |
                  (~(unsigned)lanes(out[2]) & lane & tall) << 16 |
                  (~(unsigned)lanes(out[3]) & lane & wide & tall) << 24;
    if (!in) return;
    __m256i dx = _mm256_sub_epi32(_mm256_add_epi32(_mm256_slli_epi32(px->x0, 8), half), c->x);
    __m256i dy = _mm256_sub_epi32(_mm256_add_epi32(_mm256_slli_epi32(px->y0, 8), half), c->y);
    uint32_t bits[32], at[8];
#pragma GCC unroll 4
    for (int k = 0; k < 4; k++) {
        __m256i x = k & 1 ? _mm256_add_epi32(dx, next) : dx;
        __m256i y = k & 2 ? _mm256_add_epi32(dy, next) : dy;
        __m256 z = _mm256_add_ps(c->z, _mm256_mul_ps(_mm256_cvtepi32_ps(y), p->gy));
        z = _mm256_add_ps(z, _mm256_mul_ps(_mm256_cvtepi32_ps(x), p->gx));
        _mm256_storeu_ps((float *)(void *)(bits + 8 * k),
                         _mm256_min_ps(_mm256_max_ps(z, p->lo), p->hi));
    }
    __m256i row = _mm256_sub_epi32(px->y0, _mm256_set1_epi32((int32_t)r->y0));
    row = _mm256_mullo_epi32(row, _mm256_set1_epi32((int32_t)r->width));
    _mm256_storeu_si256((__m256i *)(void *)at, _mm256_add_epi32(row, px->x0));
    const size_t step[4] = {0, 1, r->width, (size_t)r->width + 1};
    r->fragments += (uint64_t)__builtin_popcount(in);
    for (; in; in &= in - 1) {
        unsigned j = (unsigned)__builtin_ctz(in), k = j & 7;
        put_one(r->key + 2 * (at[k] + step[j >> 3]), bits[j], first + k);
    }
}

AVX2_INLINE void keep_all(batch *b, const corner *c, const edges *o, const planes *p,
                          const pixel_box *px) {
#pragma GCC unroll 3
    for (int i = 0; i < 3; i++)
        keep(b->e[i], o->e[i]), keep(b->ex[i], o->x[i]), keep(b->ey[i], o->y[i]);
    keep(b->px0, px->x0), keep(b->px1, px->x1), keep(b->py0, px->y0), keep(b->py1, px->y1);
    keep(b->x0, c->x), keep(b->y0, c->y);
    _mm256_store_ps(b->z0, c->z);
    _mm256_store_ps(b->gx, p->gx), _mm256_store_ps(b->gy, p->gy);
    _mm256_store_ps(b->lo, p->lo), _mm256_store_ps(b->hi, p->hi);
}

AVX2_INLINE __m256i edge_at(const batch *b, int i, int k, __m256i col, __m256i row) {
    __m256i e = _mm256_set1_epi32(b->e[i][k]);
    e = _mm256_sub_epi32(e, _mm256_mullo_epi32(col, _mm256_set1_epi32(b->ey[i][k])));
    return _mm256_add_epi32(e, _mm256_mullo_epi32(row, _mm256_set1_epi32(b->ex[i][k])));
}

/* A box of up to four columns: two rows at a time. */
AVX2_INLINE void fill_narrow(pbs_raster *r, const batch *b, int k, const pbs_raster_plane *p,
                             uint32_t id) {
    const __m256i col = _mm256_setr_epi32(0, 1, 2, 3, 0, 1, 2, 3);
    const __m256i row = _mm256_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1);
    int32_t x0 = b->px0[k], y1 = b->py1[k], w = b->px1[k] - x0 + 1;
    __m256i e0 = edge_at(b, 0, k, col, row), e1 = edge_at(b, 1, k, col, row);
    __m256i e2 = edge_at(b, 2, k, col, row);
    __m256i d0 = _mm256_set1_epi32(2 * b->ex[0][k]), d1 = _mm256_set1_epi32(2 * b->ex[1][k]);
    __m256i d2 = _mm256_set1_epi32(2 * b->ex[2][k]);
    __m256i cx = _mm256_slli_epi32(_mm256_add_epi32(_mm256_set1_epi32(x0), col), 8);
    cx = _mm256_add_epi32(cx, _mm256_set1_epi32(PBS_SUBPIXELS / 2));
    for (int32_t y = b->py0[k]; y <= y1; y += 2) {
        int in = ~lanes(_mm256_or_si256(_mm256_or_si256(e0, e1), e2));
        in &= y < y1 ? 0x11 * ((1 << w) - 1) : (1 << w) - 1;
        e0 = _mm256_add_epi32(e0, d0), e1 = _mm256_add_epi32(e1, d1);
        e2 = _mm256_add_epi32(e2, d2);
        if (!in) continue;
        float za = pbs_raster_row_z(p, y), zb = pbs_raster_row_z(p, y + 1);
        __m256 dx = _mm256_cvtepi32_ps(_mm256_sub_epi32(cx, _mm256_set1_epi32(p->x0)));
        __m256 z = _mm256_set_m128(_mm_set1_ps(zb), _mm_set1_ps(za));
        z = _mm256_add_ps(z, _mm256_mul_ps(dx, _mm256_set1_ps(p->gx)));
        z = _mm256_max_ps(z, _mm256_set1_ps(p->lo));
        z = _mm256_min_ps(z, _mm256_set1_ps(p->hi));
        uint32_t bits[8];
        _mm256_storeu_ps((float *)(void *)bits, z);
        uint64_t *key = pbs_raster_at(r, x0, y);
        r->fragments += (uint64_t)__builtin_popcount((unsigned)in);
        for (; in; in &= in - 1) {
            int j = __builtin_ctz((unsigned)in);
            put_one(key + 2 * ((size_t)(j >> 2) * r->width + (size_t)(j & 3)), bits[j], id);
        }
    }
}

/* A wider box: eight columns at a time. */
AVX2_INLINE void fill_wide(pbs_raster *r, const batch *b, int k, const pbs_raster_plane *p,
                           uint32_t id) {
    int32_t x0 = b->px0[k], x1 = b->px1[k], y1 = b->py1[k];
    __m256i zero = _mm256_setzero_si256(), ids = _mm256_set1_epi32((int32_t)id);
    __m256i s0 = edge_at(b, 0, k, ramp(), zero), s1 = edge_at(b, 1, k, ramp(), zero);
    __m256i s2 = edge_at(b, 2, k, ramp(), zero);
    __m256i dx0 = _mm256_set1_epi32(8 * b->ey[0][k]), dy0 = _mm256_set1_epi32(b->ex[0][k]);
    __m256i dx1 = _mm256_set1_epi32(8 * b->ey[1][k]), dy1 = _mm256_set1_epi32(b->ex[1][k]);
    __m256i dx2 = _mm256_set1_epi32(8 * b->ey[2][k]), dy2 = _mm256_set1_epi32(b->ex[2][k]);
    uint64_t drawn = 0;
    for (int32_t y = b->py0[k]; y <= y1; y++) {
        float row = pbs_raster_row_z(p, y);
        uint64_t *key = pbs_raster_at(r, 0, y);
        __m256i e0 = s0, e1 = s1, e2 = s2;
        for (int32_t x = x0; x <= x1; x += 8) {
            __m256i out = _mm256_or_si256(_mm256_or_si256(e0, e1), e2);
            __m256i in = _mm256_cmpgt_epi32(_mm256_set1_epi32(x1 - x + 1), ramp());
            in = _mm256_andnot_si256(_mm256_srai_epi32(out, 31), in);
            int any = lanes(in);
            if (any) put_eight(key + 2 * x, eight_z(p, row, centres(x)), in, ids);
            drawn += (uint64_t)__builtin_popcount((unsigned)any);
            e0 = _mm256_sub_epi32(e0, dx0), e1 = _mm256_sub_epi32(e1, dx1);
            e2 = _mm256_sub_epi32(e2, dx2);
        }
        s0 = _mm256_add_epi32(s0, dy0), s1 = _mm256_add_epi32(s1, dy1);
        s2 = _mm256_add_epi32(s2, dy2);
    }
    r->fragments += drawn;
}

AVX2_INLINE void fill(pbs_raster *r, const batch *b, int k, uint32_t id) {
    pbs_raster_plane p = {b->x0[k], b->y0[k], b->z0[k], b->gx[k], b->gy[k], b->lo[k], b->hi[k]};
    if (b->px1[k] - b->px0[k] < 4)
        fill_narrow(r, b, k, &p, id);
    else
        fill_wide(r, b, k, &p, id);
}

AVX2_INLINE void draw_eight(pbs_raster *r, batch *b, const pbs_snapped *v, const uint16_t *index,
                            uint32_t first, int live) {
    const __m256i two = _mm256_set1_epi32(2);
    corner c[3] = {load_corner(v, index), load_corner(v, index + 1), load_corner(v, index + 2)};
    __m256i lx = min3(c[0].x, c[1].x, c[2].x), hx = max3(c[0].x, c[1].x, c[2].x);
    __m256i ly = min3(c[0].y, c[1].y, c[2].y), hy = max3(c[0].y, c[1].y, c[2].y);
    pixel_box px;
    __m256i seen = pixels(lx, hx, 0, (int32_t)r->width - 1, &px.x0, &px.x1);
    live &= lanes(
        _mm256_and_si256(seen, pixels(ly, hy, (int32_t)r->y0, (int32_t)r->y1 - 1, &px.y0, &px.y1)));
    if (!live) return;
    __m256i side = _mm256_max_epi32(_mm256_sub_epi32(hx, lx), _mm256_sub_epi32(hy, ly));
    int large = live & lanes(_mm256_cmpgt_epi32(side, _mm256_set1_epi32(PBS_RASTER_SMALL - 1)));
    __m256i most = _mm256_max_epi32(_mm256_sub_epi32(px.x1, px.x0), _mm256_sub_epi32(px.y1, px.y0));
    edges o;
    planes p;
    live &= ~large;
    if (live) live &= find_edges(&o, &p, c, &px);
    int tiny = live & lanes(_mm256_cmpgt_epi32(two, most));
    if (tiny) fill_tiny(r, &c[0], &o, &p, &px, first, tiny);
    live &= ~tiny;
    if (live) keep_all(b, &c[0], &o, &p, &px);
    for (; live; live &= live - 1) {
        int k = __builtin_ctz((unsigned)live);
        fill(r, b, k, first + (uint32_t)k);
    }
    for (; large; large &= large - 1) {
        int k = __builtin_ctz((unsigned)large);
        const uint16_t *t = index + 3 * k;
        const pbs_snapped *q[3] = {v + t[0], v + t[1], v + t[2]};
        pbs_raster_large(r, q, first + (uint32_t)k, span, NULL);
    }
}

AVX2 void pbs_raster_draw_avx2(pbs_raster *r, const pbs_snapped *v, const uint16_t *index,
                               uint32_t count, uint32_t first) {
    batch b;
    uint32_t i = 0;
    for (; i + 8 <= count; i += 8) draw_eight(r, &b, v, index + 3 * (size_t)i, first + i, 0xff);
    if (i == count) return;
    uint16_t rest[24] = {0};
    memcpy(rest, index + 3 * (size_t)i, 3 * (count - i) * sizeof *index);
    draw_eight(r, &b, v, rest, first + i, (1 << (count - i)) - 1);
}
#endif
