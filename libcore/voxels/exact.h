/* exact.h: whole numbers of 256 bits, for the decisions that doubles leave open (grid.h).
 *
 * A coordinate is a whole number of 2^-32 voxels below 2^53, so the difference of two has 54 bits
 * with its sign, the cross product of two such vectors 109, and the distance of a point from a
 * triangle's plane, times the length of its normal, 164: more than __int128 holds.
 */
#ifndef PBS_EXACT_H
#define PBS_EXACT_H

#include <stdint.h>

typedef __int128 pbs_int128;

#define PBS_FIXED_ONE ((int64_t)1 << 32) /* a voxel */

/* A coordinate, which must be a multiple of 2^-32 and less than 2^30. */
static inline int64_t pbs_fixed(double c) {
    return (int64_t)(c * (double)PBS_FIXED_ONE);
}

static inline int pbs_sign128(pbs_int128 a) {
    return (a > 0) - (a < 0);
}

/* ax by - ay bx, of numbers up to 2^63 - 1 */
static inline pbs_int128 pbs_cross(int64_t ax, int64_t ay, int64_t bx, int64_t by) {
    return (pbs_int128)ax * by - (pbs_int128)ay * bx;
}

/* high 2^128 + low */
typedef struct pbs_wide {
    unsigned __int128 low;
    pbs_int128 high;
} pbs_wide;

static inline pbs_wide pbs_wide_of(pbs_int128 a) {
    return (pbs_wide){(unsigned __int128)a, a < 0 ? -1 : 0};
}

/* Modulo 2^256, as everything here. */
static inline pbs_wide pbs_wide_add(pbs_wide a, pbs_wide b) {
    pbs_wide r = {a.low + b.low, 0};
    r.high = (pbs_int128)((unsigned __int128)a.high + (unsigned __int128)b.high + (r.low < a.low));
    return r;
}

static inline pbs_wide pbs_wide_negate(pbs_wide a) {
    pbs_wide r = {-a.low, 0};
    r.high = (pbs_int128)(~(unsigned __int128)a.high + (a.low == 0));
    return r;
}

static inline pbs_wide pbs_wide_sub(pbs_wide a, pbs_wide b) {
    return pbs_wide_add(a, pbs_wide_negate(b));
}

static inline int pbs_wide_sign(pbs_wide a) {
    return a.high < 0 ? -1 : (a.high | (pbs_int128)a.low) != 0;
}

/* -1, 0, 1 as a is less than b, equal, greater */
static inline int pbs_wide_compare(pbs_wide a, pbs_wide b) {
    if (a.high != b.high) return a.high < b.high ? -1 : 1;
    return (a.low > b.low) - (a.low < b.low);
}

static inline pbs_wide pbs_wide_mul64(pbs_int128 a, int64_t b) {
    /* The lower half of a is unsigned; its product still fits. */
    pbs_int128 low = (pbs_int128)(uint64_t)a * b, high = (pbs_int128)(int64_t)(a >> 64) * b;
    pbs_wide shifted = {(unsigned __int128)high << 64, high >> 64};
    return pbs_wide_add(pbs_wide_of(low), shifted);
}

static inline pbs_wide pbs_wide_mul(pbs_int128 a, pbs_int128 b) {
    /* b = high 2^64 + low; where the low half reads as negative, high is one more. */
    int64_t low = (int64_t)(uint64_t)b, high = (int64_t)(b >> 64);
    pbs_wide h = pbs_wide_mul64(a, high), l = pbs_wide_mul64(a, low);
    if (low < 0) h = pbs_wide_add(h, pbs_wide_of(a));
    pbs_wide shifted = {h.low << 64, (pbs_int128)((unsigned __int128)h.high << 64 | h.low >> 64)};
    return pbs_wide_add(shifted, l);
}
#endif
