/* thin_avx2.c: thin_inner.h, compiled for AVX2. */
#if defined(__x86_64__) && defined(__GNUC__)
#pragma GCC target("avx2,bmi,bmi2,popcnt,lzcnt")
#endif
#define PBS_THIN_NAME(name) name##_avx2
#include "libcore/clouds/thin_inner.h"
