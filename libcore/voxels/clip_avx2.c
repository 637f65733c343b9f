/* clip_avx2.c: clip_batch_inner.h, compiled for AVX2. */
#if defined(__x86_64__)
#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx2,bmi,popcnt"))), apply_to = function)
#else
#pragma GCC target("avx2,bmi,popcnt")
#endif
#include "libcore/voxels/clip_batch_inner.h"

void pbs_clip_avx2(const pbs_triangles *t, bool centroids, pbs_fragments *out) {
    clip_batch(t, centroids, out);
}
#ifdef __clang__
#pragma clang attribute pop
#endif
#endif
