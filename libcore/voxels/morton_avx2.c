/* morton_avx2.c: morton_inner.h, compiled for AVX2. */
#if defined(__x86_64__)
#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC target("avx2")
#endif
#include "libcore/voxels/morton_inner.h"

void pbs_place_look_avx2(pbs_place_look *look, const uint32_t *place, size_t n) {
    place_look(look, place, n);
}
bool pbs_areas_avx2(const float *area, size_t n) {
    return areas(area, n);
}
#ifdef __clang__
#pragma clang attribute pop
#endif
#endif
