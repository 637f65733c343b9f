/* resolve_avx2.c: resolve_math.h, compiled for AVX2. */
#if defined(__x86_64__)
#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC target("avx2")
#endif
#include "libcore/gbuffer/resolve_math.h"

void pbs_resolve_solve_avx2(const pbs_placed *p, pbs_lanes *b, int from, int to, bool normals,
                            bool odd) {
    solve_all(p, b, from, to, normals, odd);
}
#ifdef __clang__
#pragma clang attribute pop
#endif
#endif
