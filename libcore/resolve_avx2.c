/* resolve_avx2.c: resolve_math.h, compiled for AVX2. */
#if defined(__x86_64__)
#pragma GCC target("avx2")
#include "libcore/resolve_math.h"

void pbs_resolve_solve_avx2(const pbs_placed *p, pbs_lanes *b, int from, int to, bool normals,
                            bool odd) {
    solve_all(p, b, from, to, normals, odd);
}
#endif
