/* vectors.h: four numbers at a time, in the compiler's own vectors, for files that are compiled for
 * any processor and once more for AVX2. Every lane is one IEEE operation, so both give the same
 * bits.
 */
#ifndef PBS_VECTORS_H
#define PBS_VECTORS_H

#include <math.h>
#include <stdint.h>
#if defined(__AVX2__)
#include <immintrin.h>
#elif defined(__SSE2__)
#include <emmintrin.h>
#endif

typedef double d4 __attribute__((vector_size(32)));
typedef int64_t l4 __attribute__((vector_size(32)));
typedef float f4 __attribute__((vector_size(16)));
typedef int32_t i4 __attribute__((vector_size(16)));
typedef uint32_t u4 __attribute__((vector_size(16)));

/* Vectors in arrays that are only as aligned as their elements. */
typedef d4 d4_at __attribute__((aligned(8), may_alias));
typedef l4 l4_at __attribute__((aligned(8), may_alias));
typedef f4 f4_at __attribute__((aligned(4), may_alias));
typedef i4 i4_at __attribute__((aligned(4), may_alias));
typedef u4 u4_at __attribute__((aligned(4), may_alias));

/* Vectors are passed to and returned from inlined functions only, so how the ABI does that is no
 * matter. */
#define LANE __attribute__((always_inline)) static inline
#pragma GCC diagnostic ignored "-Wpsabi"

LANE f4 abs4f(f4 v) {
    return (f4)((i4)v & INT32_MAX);
}
/* v with the sign of s turned over where s is negative */
LANE f4 turn4f(f4 v, f4 s) {
    return (f4)((i4)v ^ ((i4)s & INT32_MIN));
}
LANE f4 sqrt4f(f4 v) {
#if defined(__SSE2__)
    return (f4)_mm_sqrt_ps((__m128)v);
#else
    for (int i = 0; i < 4; i++) v[i] = sqrtf(v[i]);
    return v;
#endif
}
#endif
