/* place_avx2.c: place_math.h, compiled for AVX2. */
#if defined(__x86_64__)
#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC target("avx2")
#endif
#include "libcore/voxels/place_math.h"

uint64_t pbs_batch_place_avx2(const pbs_placing *p, const pbs_corners *in, const uint32_t *id,
                              uint32_t count, pbs_batch *out) {
    return place_all(p, in, id, count, out);
}
void pbs_batch_normals_avx2(const pbs_placing *p, pbs_batch *b) {
    normals_all(p, b);
}
void pbs_batch_smooth_avx2(const pbs_placing *p, const pbs_corners *in, pbs_batch *b) {
    smooth_all(p, in, b);
}
#ifdef __clang__
#pragma clang attribute pop
#endif
#endif
