/* separate_inner.h: what separate.c is made of: four doubles at a time, and the questions that are
 * answered by integers where doubles do not decide.
 *
 * The source is compiled twice; both ways give the same bits: every lane is one IEEE operation.
 */
#ifndef PBS_SEPARATE_INNER_H
#define PBS_SEPARATE_INNER_H

#include "libcore/voxels/exact.h"
#include "libcore/voxels/separate.h"

/* All of a batch. _avx2: the same on the processors that have it. */
void pbs_separate_all(const pbs_triangles *t, pbs_hits *out);
void pbs_separate_all_avx2(const pbs_triangles *t, pbs_hits *out);

/* ---- four doubles ---- */

#ifdef __AVX2__
#include <immintrin.h>
typedef __m256d d4;
static inline d4 d4_all(double v) {
    return _mm256_set1_pd(v);
}
static inline d4 d4_at(const double *p) {
    return _mm256_loadu_pd(p);
}
static inline d4 d4_of(const double *p, const uint32_t i[4]) {
    return _mm256_setr_pd(p[i[0]], p[i[1]], p[i[2]], p[i[3]]);
}
static inline void d4_put(double *p, d4 a) {
    _mm256_storeu_pd(p, a);
}
static inline d4 d4_ramp(void) {
    return _mm256_setr_pd(0, 1, 2, 3);
}
static inline d4 d4_add(d4 a, d4 b) {
    return _mm256_add_pd(a, b);
}
static inline d4 d4_sub(d4 a, d4 b) {
    return _mm256_sub_pd(a, b);
}
static inline d4 d4_mul(d4 a, d4 b) {
    return _mm256_mul_pd(a, b);
}
static inline d4 d4_div(d4 a, d4 b) {
    return _mm256_div_pd(a, b);
}
static inline d4 d4_min(d4 a, d4 b) {
    return _mm256_min_pd(a, b);
}
static inline d4 d4_max(d4 a, d4 b) {
    return _mm256_max_pd(a, b);
}
static inline d4 d4_floor(d4 a) {
    return _mm256_floor_pd(a);
}
static inline d4 d4_ceil(d4 a) {
    return _mm256_ceil_pd(a);
}
static inline d4 d4_abs(d4 a) {
    return _mm256_andnot_pd(_mm256_set1_pd(-0.0), a);
}
/* a[i] < b[i] ? then[i] : other[i] */
static inline d4 d4_if_less(d4 a, d4 b, d4 then, d4 other) {
    return _mm256_blendv_pd(other, then, _mm256_cmp_pd(a, b, _CMP_LT_OQ));
}
/* a, negated where s is negative */
static inline d4 d4_turn(d4 a, d4 s) {
    return _mm256_xor_pd(a, _mm256_and_pd(s, _mm256_set1_pd(-0.0)));
}
/* Bit i: a[i] < b[i] */
static inline unsigned d4_less(d4 a, d4 b) {
    return (unsigned)_mm256_movemask_pd(_mm256_cmp_pd(a, b, _CMP_LT_OQ));
}
static inline unsigned d4_differ(d4 a, d4 b) {
    return (unsigned)_mm256_movemask_pd(_mm256_cmp_pd(a, b, _CMP_NEQ_UQ));
}
#else
typedef struct d4 {
    double v[4];
} d4;
#define D4_LANES(expression)                                                                       \
    d4 r;                                                                                          \
    for (int i = 0; i < 4; i++) r.v[i] = (expression);                                             \
    return r
#define D4_BITS(expression)                                                                        \
    unsigned r = 0;                                                                                \
    for (int i = 0; i < 4; i++) r |= (unsigned)(expression) << i;                                  \
    return r
static inline d4 d4_all(double v) {
    D4_LANES(v);
}
static inline d4 d4_at(const double *p) {
    D4_LANES(p[i]);
}
static inline d4 d4_of(const double *p, const uint32_t index[4]) {
    D4_LANES(p[index[i]]);
}
static inline void d4_put(double *p, d4 a) {
    memcpy(p, &a, sizeof a);
}
static inline d4 d4_ramp(void) {
    D4_LANES(i);
}
static inline d4 d4_add(d4 a, d4 b) {
    D4_LANES(a.v[i] + b.v[i]);
}
static inline d4 d4_sub(d4 a, d4 b) {
    D4_LANES(a.v[i] - b.v[i]);
}
static inline d4 d4_mul(d4 a, d4 b) {
    D4_LANES(a.v[i] * b.v[i]);
}
static inline d4 d4_div(d4 a, d4 b) {
    D4_LANES(a.v[i] / b.v[i]);
}
static inline d4 d4_min(d4 a, d4 b) {
    D4_LANES(a.v[i] < b.v[i] ? a.v[i] : b.v[i]);
}
static inline d4 d4_max(d4 a, d4 b) {
    D4_LANES(a.v[i] > b.v[i] ? a.v[i] : b.v[i]);
}
static inline d4 d4_floor(d4 a) {
    D4_LANES(floor(a.v[i]));
}
static inline d4 d4_ceil(d4 a) {
    D4_LANES(ceil(a.v[i]));
}
static inline d4 d4_abs(d4 a) {
    D4_LANES(fabs(a.v[i]));
}
static inline d4 d4_if_less(d4 a, d4 b, d4 then, d4 other) {
    D4_LANES(a.v[i] < b.v[i] ? then.v[i] : other.v[i]);
}
static inline d4 d4_turn(d4 a, d4 s) {
    D4_LANES(s.v[i] < 0 ? -a.v[i] : a.v[i]);
}
static inline unsigned d4_less(d4 a, d4 b) {
    D4_BITS(a.v[i] < b.v[i]);
}
static inline unsigned d4_differ(d4 a, d4 b) {
    D4_BITS(!(a.v[i] == b.v[i]));
}
#undef D4_LANES
#undef D4_BITS
#endif

static inline d4 d4_dot3(const d4 a[3], const d4 b[3]) {
    return d4_add(d4_add(d4_mul(a[0], b[0]), d4_mul(a[1], b[1])), d4_mul(a[2], b[2]));
}

/* ---- hits ---- */

/* Makes room for n more hits, and for the lanes that a vector writes past them. */
static inline void hits_room(pbs_hits *out, uint32_t n) {
    if (out->count + n + 4 > PBS_HITS) out->flush(out->ctx, out);
}

/* Appends the lanes in mask; cells are whole numbers there. */
static inline void hits_put(pbs_hits *out, d4 cells, const uint32_t triangle[4], unsigned mask) {
    pbs_hit *to = out->hit + out->count;
#ifdef __AVX2__
    /* The halves of lane i to the front, for each mask: four bits a half. */
    static const uint32_t order[16] = {0x00000000, 0x00000010, 0x00000032, 0x00003210,
                                       0x00000054, 0x00005410, 0x00005432, 0x00543210,
                                       0x00000076, 0x00007610, 0x00007632, 0x00763210,
                                       0x00007654, 0x00765410, 0x00765432, 0x76543210};
    const __m256i nibble = _mm256_setr_epi32(0, 4, 8, 12, 16, 20, 24, 28);
    __m128i cell = _mm256_cvttpd_epi32(cells);
    __m128i id = _mm_loadu_si128((const __m128i *)(const void *)triangle);
    __m256i all = _mm256_inserti128_si256(_mm256_castsi128_si256(_mm_unpacklo_epi32(cell, id)),
                                          _mm_unpackhi_epi32(cell, id), 1);
    __m256i lanes = _mm256_srlv_epi32(_mm256_set1_epi32((int)order[mask]), nibble);
    all = _mm256_permutevar8x32_epi32(all, lanes);
    _mm256_storeu_si256((__m256i *)(void *)to, all);
#else
    for (uint32_t i = 0, k = 0; i < 4; i++)
        if (mask >> i & 1) to[k++] = (pbs_hit){(uint32_t)cells.v[i], triangle[i]};
#endif
    out->count += (uint32_t)__builtin_popcount(mask);
}

/* n cells in a row. */
static inline void hits_run(pbs_hits *out, uint32_t cell, uint32_t step, int n, uint32_t triangle) {
    hits_room(out, (uint32_t)n);
    pbs_hit *to = out->hit + out->count;
    for (int i = 0; i < n; i++) to[i] = (pbs_hit){cell + (uint32_t)i * step, triangle};
    out->count += (uint32_t)n;
}

/* ---- a triangle ---- */

typedef struct shape {
    double p[3][3]; /* [corner][axis] */
    double min[3], max[3];
    int first[3], last[3]; /* the middles of cells in its box, cut to the block and its layer */
    double n[3];           /* the normal; relative errors of 2^-44, 0 if it is */
    bool exact;            /* whether `normal` is there */
    pbs_int128 normal[3];  /* in 2^-64 */
    uint32_t number[4];    /* of the batch, four times */
} shape;

static inline pbs_int128 normal_exact(const shape *s, int a) {
    int u = (a + 1) % 3, v = (a + 2) % 3;
    int64_t u0 = pbs_fixed(s->p[0][u]), v0 = pbs_fixed(s->p[0][v]);
    return pbs_cross(pbs_fixed(s->p[1][u]) - u0, pbs_fixed(s->p[1][v]) - v0,
                     pbs_fixed(s->p[2][u]) - u0, pbs_fixed(s->p[2][v]) - v0);
}

/* Differences are exact, so the error is less than 2^-53 of the two products and their difference;
 * where that is more than a little of it, integers. */
static inline void shape_normal(shape *s) {
    for (int a = 0; a < 3; a++) {
        int u = (a + 1) % 3, v = (a + 2) % 3;
        double l = (s->p[1][u] - s->p[0][u]) * (s->p[2][v] - s->p[0][v]);
        double r = (s->p[1][v] - s->p[0][v]) * (s->p[2][u] - s->p[0][u]);
        s->n[a] = l - r;
        if (fabs(l - r) < 0x1p-8 * (fabs(l) + fabs(r)))
            s->n[a] = (double)normal_exact(s, a) * 0x1p-64;
    }
}

/* Whether the plane's depth along axis a is at least k on the line through u, v + 1/2. The plane
 * is normal . (q - p0) = 0. */
static inline bool depth_at_least(shape *s, int a, const int at[3], int k) {
    if (!s->exact) {
        for (int i = 0; i < 3; i++) s->normal[i] = normal_exact(s, i);
        s->exact = true;
    }
    pbs_wide sum = pbs_wide_of(0);
    for (int i = 0; i < 3; i++) {
        int64_t q = i == a ? k * PBS_FIXED_ONE : at[i] * PBS_FIXED_ONE + PBS_FIXED_ONE / 2;
        sum = pbs_wide_add(sum, pbs_wide_mul64(s->normal[i], q - pbs_fixed(s->p[0][i])));
    }
    return pbs_wide_sign(sum) * pbs_sign128(s->normal[a]) <= 0;
}

/* ---- an edge, seen along an axis ---- */

/* An edge as a function of the row: at + (row - from) * slope, between its ends. Then the product
 * is at most 2^21, and all rounding errors together are below 2^-30. */
#define SIDE_ERROR 0x1p-28
typedef struct side {
    const double *a, *b; /* corners */
    int row, axis;
    double from, at, slope, error;
} side;

/* row: what it is a function of; corner a is not above b there. */
static inline side side_of(const double *a, const double *b, int row, int axis) {
    double run = b[row] - a[row], rise = b[axis] - a[axis];
    bool constant = rise == 0 || run == 0;
    return (side){
        a, b, row, axis, a[row], a[axis], constant ? 0 : rise / run, constant ? 0 : SIDE_ERROR};
}

/* -1, 0, 1 as the edge is below `value` at the row, on it, above it */
static inline int side_compare(const side *s, double row, double value) {
    int64_t row_a = pbs_fixed(s->a[s->row]), a = pbs_fixed(s->a[s->axis]);
    int64_t run = pbs_fixed(s->b[s->row]) - row_a, rise = pbs_fixed(s->b[s->axis]) - a;
    return pbs_sign128(pbs_cross(pbs_fixed(row) - row_a, pbs_fixed(value) - a, run, rise));
}

/* The edge at four rows. */
static inline d4 side_at(const side *s, d4 row) {
    return d4_add(d4_all(s->at), d4_mul(d4_sub(row, d4_all(s->from)), d4_all(s->slope)));
}

/* The largest whole number k with k + off <= the edge, and the least with k + off >= it. */
static inline int side_floor(const side *s, double row, double off) {
    double x = s->at + (row - s->from) * s->slope - off;
    double k = floor(x + s->error);
    if (floor(x - s->error) != k && side_compare(s, row, k + off) < 0) k--;
    return (int)k;
}
static inline int side_ceil(const side *s, double row, double off) {
    double x = s->at + (row - s->from) * s->slope - off;
    double k = ceil(x - s->error);
    if (ceil(x + s->error) != k && side_compare(s, row, k + off) > 0) k++;
    return (int)k;
}
#endif
