/* simd16.h: sixteen floats at a time: two of simd8.h, and sixteen small numbers. With and
 * without AVX2 the bits are the same. (AVX-512 was tried: it is no faster here.)
 */
#ifndef PBS_SIMD16_H
#define PBS_SIMD16_H

#include "libcore/data/simd8.h"

typedef struct f16 {
    f8 a, b;
} f16;
static inline f16 f16_all(float v) {
    return (f16){f8_all(v), f8_all(v)};
}
static inline f16 f16_at(const float *p) {
    return (f16){f8_at(p), f8_at(p + 8)};
}
static inline void f16_put(float *p, f16 a) {
    f8_put(p, a.a), f8_put(p + 8, a.b);
}
static inline f16 f16_add(f16 a, f16 b) {
    return (f16){f8_add(a.a, b.a), f8_add(a.b, b.b)};
}
static inline f16 f16_sub(f16 a, f16 b) {
    return (f16){f8_sub(a.a, b.a), f8_sub(a.b, b.b)};
}
static inline f16 f16_mul(f16 a, f16 b) {
    return (f16){f8_mul(a.a, b.a), f8_mul(a.b, b.b)};
}
static inline f16 f16_min(f16 a, f16 b) {
    return (f16){f8_min(a.a, b.a), f8_min(a.b, b.b)};
}
static inline unsigned f16_less(f16 a, f16 b) {
    return f8_less(a.a, b.a) | f8_less(a.b, b.b) << 8;
}
static inline f16 f16_if_less(f16 a, f16 b, f16 then, f16 other) {
    return (f16){f8_if_less(a.a, b.a, then.a, other.a), f8_if_less(a.b, b.b, then.b, other.b)};
}
static inline float f16_least(f16 a) {
    return f8_least(f8_min(a.a, a.b));
}
static inline float f16_most(f16 a) {
    return f8_most(f8_max(a.a, a.b));
}
static inline f16 f16_of_ints(const int32_t *p, int32_t from) {
#ifdef __AVX2__
    const __m256i f = _mm256_set1_epi32(from);
    __m256i a = _mm256_loadu_si256((const __m256i *)(const void *)p);
    __m256i b = _mm256_loadu_si256((const __m256i *)(const void *)(p + 8));
    return (f16){_mm256_cvtepi32_ps(_mm256_sub_epi32(a, f)),
                 _mm256_cvtepi32_ps(_mm256_sub_epi32(b, f))};
#else
    float v[16];
    for (int i = 0; i < 16; i++) v[i] = (float)(int32_t)((uint32_t)p[i] - (uint32_t)from);
    return f16_at(v);
#endif
}

/* ---- sixteen small numbers ---- */

#ifdef __SSE4_1__
typedef __m128i b16;
static inline b16 b16_at(const int8_t *p) {
    return _mm_loadu_si128((const __m128i *)(const void *)p);
}
static inline void b16_put(int8_t *p, b16 a) {
    _mm_storeu_si128((__m128i *)(void *)p, a);
}
static inline b16 b16_all(int8_t v) {
    return _mm_set1_epi8(v);
}
static inline b16 b16_min(b16 a, b16 b) {
    return _mm_min_epi8(a, b);
}
static inline b16 b16_or(b16 a, b16 b) {
    return _mm_or_si128(a, b);
}
/* Lane j in all. */
static inline b16 b16_lane(b16 a, int j) {
    return _mm_shuffle_epi8(a, _mm_set1_epi8((char)j));
}
/* a[i] < b[i] ? a[i] : 127, of numbers from 0 on */
static inline b16 b16_if_less(b16 a, b16 b) {
    __m128i no = _mm_xor_si128(_mm_cmpgt_epi8(b, a), _mm_set1_epi8(-1));
    return _mm_or_si128(a, _mm_and_si128(no, _mm_set1_epi8(127)));
}
#else
typedef struct b16 {
    int8_t v[16];
} b16;
#define B16_LANES(expression)                                                                      \
    b16 r;                                                                                         \
    for (int i = 0; i < 16; i++) r.v[i] = (int8_t)(expression);                                    \
    return r
static inline b16 b16_at(const int8_t *p) {
    B16_LANES(p[i]);
}
static inline void b16_put(int8_t *p, b16 a) {
    memcpy(p, &a, sizeof a);
}
static inline b16 b16_all(int8_t v) {
    B16_LANES(v);
}
static inline b16 b16_min(b16 a, b16 b) {
    B16_LANES(a.v[i] < b.v[i] ? a.v[i] : b.v[i]);
}
static inline b16 b16_or(b16 a, b16 b) {
    B16_LANES(a.v[i] | b.v[i]);
}
static inline b16 b16_lane(b16 a, int j) {
    B16_LANES(a.v[j]);
}
static inline b16 b16_if_less(b16 a, b16 b) {
    B16_LANES(a.v[i] < b.v[i] ? a.v[i] : 127);
}
#undef B16_LANES
#endif
#endif
