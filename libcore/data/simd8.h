/* simd8.h: eight floats at a time, with AVX2 where the file is compiled for it, else in plain C.
 *
 * Both ways give the same bits: every lane is one IEEE operation, and nothing is contracted.
 */
#ifndef PBS_SIMD8_H
#define PBS_SIMD8_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#ifdef __AVX2__
#include <immintrin.h>
typedef __m256 f8;
static inline f8 f8_all(float v) {
    return _mm256_set1_ps(v);
}
static inline f8 f8_at(const float *p) {
    return _mm256_loadu_ps(p);
}
static inline void f8_put(float *p, f8 a) {
    _mm256_storeu_ps(p, a);
}
static inline f8 f8_add(f8 a, f8 b) {
    return _mm256_add_ps(a, b);
}
static inline f8 f8_sub(f8 a, f8 b) {
    return _mm256_sub_ps(a, b);
}
static inline f8 f8_mul(f8 a, f8 b) {
    return _mm256_mul_ps(a, b);
}
static inline f8 f8_div(f8 a, f8 b) {
    return _mm256_div_ps(a, b);
}
static inline f8 f8_min(f8 a, f8 b) {
    return _mm256_min_ps(a, b);
}
static inline f8 f8_max(f8 a, f8 b) {
    return _mm256_max_ps(a, b);
}
/* Bit i: a[i] < b[i] */
static inline unsigned f8_less(f8 a, f8 b) {
    return (unsigned)_mm256_movemask_ps(_mm256_cmp_ps(a, b, _CMP_LT_OQ));
}
static inline unsigned f8_equal(f8 a, f8 b) {
    return (unsigned)_mm256_movemask_ps(_mm256_cmp_ps(a, b, _CMP_EQ_OQ));
}
/* a[i] < b[i] ? then[i] : other[i] */
static inline f8 f8_if_less(f8 a, f8 b, f8 then, f8 other) {
    return _mm256_blendv_ps(other, then, _mm256_cmp_ps(a, b, _CMP_LT_OQ));
}
/* xy[2i] * px + xy[2i+1] * py + z0[2i] * pz, exact, then rounded to float */
static inline f8 f8_dot16(const int16_t *xy, const int16_t *z0, const int16_t p[4]) {
    int32_t pxy, pz0;
    memcpy(&pxy, p, 4);
    memcpy(&pz0, p + 2, 4);
    __m256i a = _mm256_loadu_si256((const __m256i *)xy),
            b = _mm256_loadu_si256((const __m256i *)z0);
    a = _mm256_madd_epi16(a, _mm256_set1_epi32(pxy));
    b = _mm256_madd_epi16(b, _mm256_set1_epi32(pz0));
    return _mm256_cvtepi32_ps(_mm256_add_epi32(a, b));
}
static inline f8 f8_sqrt(f8 a) {
    return _mm256_sqrt_ps(a);
}
/* Towards zero, as a conversion in C. */
static inline void f8_to_int(int32_t *p, f8 a) {
    _mm256_storeu_si256((__m256i *)p, _mm256_cvttps_epi32(a));
}
/* p[2i] to a[i], p[2i+1] to b[i], and back. */
static inline void f8_of_pairs(const int16_t *p, f8 *a, f8 *b) {
    __m256i v = _mm256_loadu_si256((const __m256i *)p);
    *a = _mm256_cvtepi32_ps(_mm256_srai_epi32(_mm256_slli_epi32(v, 16), 16));
    *b = _mm256_cvtepi32_ps(_mm256_srai_epi32(v, 16));
}
static inline void f8_to_pairs(int16_t *p, f8 a, f8 b) {
    __m256i low = _mm256_and_si256(_mm256_cvttps_epi32(a), _mm256_set1_epi32(0xffff));
    __m256i high = _mm256_slli_epi32(_mm256_cvttps_epi32(b), 16);
    _mm256_storeu_si256((__m256i *)p, _mm256_or_si256(low, high));
}
/* p[i] = base + byte i */
static inline void i8_put_bytes(uint32_t *p, uint64_t bytes, uint32_t base) {
    __m256i v = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128((long long)bytes));
    _mm256_storeu_si256((__m256i *)p, _mm256_add_epi32(v, _mm256_set1_epi32((int)base)));
}
static inline float f8_most(f8 a) {
    __m128 m = _mm_max_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps(a, 1));
    m = _mm_max_ps(m, _mm_movehl_ps(m, m));
    return _mm_cvtss_f32(_mm_max_ss(m, _mm_movehdup_ps(m)));
}
static inline float f8_least(f8 a) {
    __m128 m = _mm_min_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps(a, 1));
    m = _mm_min_ps(m, _mm_movehl_ps(m, m));
    return _mm_cvtss_f32(_mm_min_ss(m, _mm_movehdup_ps(m)));
}
#else
typedef struct f8 {
    float v[8];
} f8;
static inline f8 f8_at(const float *p) {
    f8 a;
    memcpy(&a, p, sizeof a);
    return a;
}
static inline void f8_put(float *p, f8 a) {
    memcpy(p, &a, sizeof a);
}
#define F8_LANES(expression)                                                                       \
    f8 r;                                                                                          \
    for (int i = 0; i < 8; i++) r.v[i] = (expression);                                             \
    return r
#define F8_BITS(expression)                                                                        \
    unsigned r = 0;                                                                                \
    for (int i = 0; i < 8; i++) r |= (unsigned)(expression) << i;                                  \
    return r
static inline f8 f8_all(float v) {
    F8_LANES(v);
}
static inline f8 f8_add(f8 a, f8 b) {
    F8_LANES(a.v[i] + b.v[i]);
}
static inline f8 f8_sub(f8 a, f8 b) {
    F8_LANES(a.v[i] - b.v[i]);
}
static inline f8 f8_mul(f8 a, f8 b) {
    F8_LANES(a.v[i] * b.v[i]);
}
static inline f8 f8_div(f8 a, f8 b) {
    F8_LANES(a.v[i] / b.v[i]);
}
static inline f8 f8_min(f8 a, f8 b) {
    F8_LANES(a.v[i] < b.v[i] ? a.v[i] : b.v[i]);
}
static inline f8 f8_max(f8 a, f8 b) {
    F8_LANES(a.v[i] > b.v[i] ? a.v[i] : b.v[i]);
}
static inline unsigned f8_less(f8 a, f8 b) {
    F8_BITS(a.v[i] < b.v[i]);
}
static inline unsigned f8_equal(f8 a, f8 b) {
    F8_BITS(a.v[i] == b.v[i]);
}
static inline f8 f8_if_less(f8 a, f8 b, f8 then, f8 other) {
    F8_LANES(a.v[i] < b.v[i] ? then.v[i] : other.v[i]);
}
static inline f8 f8_dot16(const int16_t *xy, const int16_t *z0, const int16_t p[4]) {
    F8_LANES((float)(xy[2 * i] * p[0] + xy[2 * i + 1] * p[1] + z0[2 * i] * p[2]));
}
static inline f8 f8_sqrt(f8 a) {
    F8_LANES(sqrtf(a.v[i]));
}
static inline void f8_to_int(int32_t *p, f8 a) {
    for (int i = 0; i < 8; i++) p[i] = (int32_t)a.v[i];
}
static inline void f8_of_pairs(const int16_t *p, f8 *a, f8 *b) {
    for (int i = 0; i < 8; i++) a->v[i] = p[2 * i], b->v[i] = p[2 * i + 1];
}
static inline void f8_to_pairs(int16_t *p, f8 a, f8 b) {
    for (int i = 0; i < 8; i++) p[2 * i] = (int16_t)a.v[i], p[2 * i + 1] = (int16_t)b.v[i];
}
static inline void i8_put_bytes(uint32_t *p, uint64_t bytes, uint32_t base) {
    for (int i = 0; i < 8; i++) p[i] = base + (uint32_t)(bytes >> 8 * i & 255);
}
static inline float f8_most(f8 a) {
    float m = a.v[0];
    for (int i = 1; i < 8; i++) m = a.v[i] > m ? a.v[i] : m;
    return m;
}
static inline float f8_least(f8 a) {
    float m = a.v[0];
    for (int i = 1; i < 8; i++) m = a.v[i] < m ? a.v[i] : m;
    return m;
}
#undef F8_LANES
#undef F8_BITS
#endif
#endif
