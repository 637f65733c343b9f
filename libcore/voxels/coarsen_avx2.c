/* coarsen_avx2.c: coarsen_inner.h, compiled for AVX2. */
#if defined(__x86_64__)
#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC target("avx2")
#endif
#include "libcore/voxels/coarsen_inner.h"

size_t pbs_coarsen_step_avx2(pbs_coarsen_block *b, const pbs_cell_rows *in, size_t n,
                             pbs_cell_rows *out) {
    return coarsen_step(b, in, n, out);
}
#ifdef __clang__
#pragma clang attribute pop
#endif
#endif
