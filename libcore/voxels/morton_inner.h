/* morton_inner.h: a look at voxels, eight at a time. It is compiled twice, in morton.c and, for
 * AVX2, in morton_avx2.c; it counts and compares, so both find the same.
 */
#ifndef PBS_MORTON_INNER_H
#define PBS_MORTON_INNER_H

#include "libcore/voxels/morton.h"
#include "libcore/data/vectors.h"
#include <string.h>

typedef uint32_t u8x __attribute__((vector_size(32)));
typedef int32_t i8x __attribute__((vector_size(32)));
typedef float f8x __attribute__((vector_size(32)));
typedef u8x u8x_at __attribute__((aligned(4), may_alias));
typedef f8x f8x_at __attribute__((aligned(4), may_alias));

void pbs_place_look_avx2(pbs_place_look *look, const uint32_t *place, size_t n);
bool pbs_areas_avx2(const float *area, size_t n);

LANE u8x spread8(u8x v) {
    v = (v | v << 8) & 0x00f00f;
    v = (v | v << 4) & 0x0c30c3;
    return (v | v << 2) & 0x249249;
}
LANE u8x codes8(u8x p) {
    return spread8(p & 255) | spread8(p >> 8 & 255) << 1 | spread8(p >> 16 & 255) << 2;
}
/* The least and the largest of each byte. */
LANE u8x least8(u8x a, u8x b) {
#if defined(__AVX2__)
    return (u8x)_mm256_min_epu8((__m256i)a, (__m256i)b);
#else
    typedef uint8_t b32 __attribute__((vector_size(32)));
    b32 less = (b32)((b32)a < (b32)b);
    return (a & (u8x)less) | (b & ~(u8x)less);
#endif
}
LANE u8x largest8(u8x a, u8x b) {
#if defined(__AVX2__)
    return (u8x)_mm256_max_epu8((__m256i)a, (__m256i)b);
#else
    return ~least8(~a, ~b);
#endif
}

static inline void look_one(pbs_place_look *look, uint32_t p, int32_t *before) {
    int32_t now = (int32_t)pbs_morton8(p);
    look->sorted = look->sorted && now > *before;
    look->any |= p;
    for (int k = 0; k < 3; k++) {
        uint8_t c = (uint8_t)(p >> 8 * k);
        if (c < look->low[k]) look->low[k] = c;
        if (c > look->high[k]) look->high[k] = c;
    }
    *before = now;
}

LANE void place_look(pbs_place_look *look, const uint32_t *place, size_t n) {
    if (!n) return;
    int32_t before = look->last == PBS_NO_PLACE ? -1 : (int32_t)pbs_morton8(look->last);
    u8x least = {0}, most = {0}, any = {0};
    i8x bad = {0};
    size_t i = 0;
    look_one(look, place[i++], &before);
    least = ~least;
    for (; i + 8 <= n; i += 8) { /* each with the one before it */
        u8x p = *(const u8x_at *)(uintptr_t)(place + i);
        u8x last = *(const u8x_at *)(uintptr_t)(place + i - 1);
        bad |= (i8x)codes8(p) <= (i8x)codes8(last);
        least = least8(least, p), most = largest8(most, p), any |= p;
    }
    before = (int32_t)pbs_morton8(place[i - 1]);
    for (int k = 0; k < 8; k++) {
        look->sorted = look->sorted && !bad[k];
        look->any |= any[k];
        for (int a = 0; a < 3 && i > 1; a++) {
            uint8_t low = (uint8_t)(least[k] >> 8 * a), high = (uint8_t)(most[k] >> 8 * a);
            if (low < look->low[a]) look->low[a] = low;
            if (high > look->high[a]) look->high[a] = high;
        }
    }
    for (; i < n; i++) look_one(look, place[i], &before);
    look->last = place[n - 1] & 0xffffff;
}

LANE bool areas(const float *area, size_t n) {
    i8x good = ~(i8x){0};
    size_t i = 0;
    for (; i + 8 <= n; i += 8) {
        f8x w = *(const f8x_at *)(uintptr_t)(area + i);
        good &= (i8x)(w >= 0) & (i8x)(w < INFINITY);
    }
    bool all = true;
    for (int k = 0; k < 8; k++) all = all && good[k];
    for (; i < n; i++) all = all && area[i] >= 0 && area[i] < INFINITY;
    return all;
}
#endif
