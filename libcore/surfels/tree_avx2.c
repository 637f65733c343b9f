/* tree.c once more, with the instructions of AVX2: same source, same bits. */
#if defined(__x86_64__) && defined(__GNUC__)
#pragma GCC target("avx2,bmi,bmi2,popcnt,lzcnt")
#endif
#define PBS_TREE_NAME(name) name##_avx2
#include "libcore/surfels/tree.c"
