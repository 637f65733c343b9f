/* clip_lanes_inner.h: four triangles at a time, and what is on one side of a plane.
 *
 * A plane cuts a tip off a triangle, which is a triangle again; the rest is what is missing to the
 * whole. So all areas and moments come from triangles: without polygons, and without a branch.
 */
#ifndef PBS_CLIP_LANES_INNER_H
#define PBS_CLIP_LANES_INNER_H

#include "libcore/voxels/clip_inner.h"
#include "libcore/data/vectors.h"

/* So that vectors in arrays stay in registers. */
#define UNROLL _Pragma("GCC unroll 8")

LANE d4 all4(double x) {
    return (d4){x, x, x, x};
}
LANE d4 at4(const double *p) {
    return *(const d4_at *)p;
}
LANE void put4(double *p, d4 x) {
    *(d4_at *)p = x;
}
LANE d4 pick(l4 mask, d4 a, d4 b) {
#if defined(__AVX2__)
    return (d4)_mm256_blendv_pd((__m256d)b, (__m256d)a, (__m256d)mask);
#else
    return (d4)(((l4)a & mask) | ((l4)b & ~mask));
#endif
}
/* A bit for each lane. */
LANE uint32_t bits4(l4 mask) {
#if defined(__AVX2__)
    return (uint32_t)_mm256_movemask_pd((__m256d)mask);
#else
    return (uint32_t)((mask[0] & 1) | (mask[1] & 2) | (mask[2] & 4) | (mask[3] & 8));
#endif
}
LANE d4 abs4(d4 x) {
    return (d4)((l4)x & INT64_MAX);
}
LANE d4 max4(d4 a, d4 b) {
    return pick((l4)(a > b), a, b);
}
LANE d4 min4(d4 a, d4 b) {
    return pick((l4)(a < b), a, b);
}
LANE d4 sqrt4(d4 x) {
#if defined(__AVX2__)
    return (d4)_mm256_sqrt_pd((__m256d)x);
#else
    UNROLL
    for (int i = 0; i < 4; i++) x[i] = sqrt(x[i]);
    return x;
#endif
}
/* Barycentric coordinates that rounding may have pushed out of the triangle. */
LANE void put_place(float u[4], float v[4], d4 a, d4 b) {
    d4 zero = all4(0);
    a = min4(max4(a, zero), all4(1)), b = max4(b, zero);
    f4 x = __builtin_convertvector(a, f4), y = __builtin_convertvector(b, f4), most = 1 - x;
    i4 less = (i4)(y < most);
    *(f4_at *)u = x;
    *(f4_at *)v = (f4)(((i4)y & less) | ((i4)most & ~less));
}
/* For |x| < 2^51. */
LANE d4 floor4(d4 x) {
    d4 r = (x + 0x1.8p52) - 0x1.8p52;
    return r - (d4)((l4)(r > x) & (l4)all4(1));
}

/* ---- tips ---- */

/* A part of the triangle: its share of the area, and that times thrice the centroid. */
typedef struct mass4 {
    d4 f, a, b;
} mass4;

LANE mass4 mass_less(mass4 x, mass4 y) {
    return (mass4){x.f - y.f, x.a - y.a, x.b - y.b};
}
LANE mass4 mass_pick(l4 mask, mass4 x, mass4 y) {
    return (mass4){pick(mask, x.f, y.f), pick(mask, x.a, y.a), pick(mask, x.b, y.b)};
}

/* The corner that is alone on its side of a plane, and how far the plane is from it on the way to
 * the next corner and the last. Where all are on one side, the tip is the whole triangle, to the
 * bit: what a lane gives must not depend on what is done for the others. */
typedef struct tip4 {
    l4 second, third; /* which corner that is; else the first */
    l4 below;
    d4 next, last;
} tip4;

/* The value of the corner that is alone, the next one, the last. */
LANE void tip_turn(const tip4 *t, const d4 x[3], d4 out[3]) {
    UNROLL
    for (int i = 0; i < 3; i++)
        out[i] = pick(t->third, x[(i + 2) % 3], pick(t->second, x[(i + 1) % 3], x[i]));
}

LANE tip4 tip_of(const d4 x[3]) {
    l4 s0 = (l4)(x[0] < 0), s1 = (l4)(x[1] < 0), s2 = (l4)(x[2] < 0);
    tip4 t = {.third = ~(s0 ^ s1) & (s0 ^ s2), .second = (s0 ^ s1) & ~(s0 ^ s2)};
    d4 v[3];
    tip_turn(&t, x, v);
    t.below = (l4)(v[0] < 0);
    l4 one_side = ~((s0 ^ s1) | (s0 ^ s2));
    t.next = pick(one_side, all4(1), v[0] / (v[0] - v[1]));
    t.last = pick(one_side, all4(1), v[0] / (v[0] - v[2]));
    return t;
}

LANE void tip_corners(const tip4 *t, const d4 x[3], d4 out[3]) {
    d4 v[3];
    tip_turn(t, x, v);
    out[0] = v[0];
    out[1] = v[0] * (1 - t->next) + v[1] * t->next;
    out[2] = v[0] * (1 - t->last) + v[2] * t->last;
}

/* A triangle within the triangle: signed distances from up to four planes, called axes here,
 * places, share. */
typedef struct part4 {
    d4 x[4][3], a[3], b[3], f; /* x[axis][corner] */
} part4;

/* The tip that the plane of an axis cuts off; distances only from that axis on. */
LANE part4 part_tip(const part4 *p, const tip4 *t, int axes, bool centroids) {
    part4 r;
    r.f = p->f * (t->next * t->last);
    UNROLL
    for (int k = 1; k < axes; k++) tip_corners(t, p->x[k], r.x[k]);
    if (centroids) tip_corners(t, p->a, r.a), tip_corners(t, p->b, r.b);
    return r;
}
LANE mass4 part_mass(const part4 *p, bool centroids) {
    if (!centroids) return (mass4){p->f, all4(0), all4(0)};
    return (mass4){p->f, p->f * (p->a[0] + p->a[1] + p->a[2]),
                   p->f * (p->b[0] + p->b[1] + p->b[2])};
}

/* What of a part is below the plane of an axis; its tip, if wanted. */
LANE mass4 part_below(const part4 *p, int axis, int axes, bool centroids, part4 *tip) {
    tip4 t = tip_of(p->x[axis]);
    part4 r = part_tip(p, &t, axes, centroids);
    mass4 whole = part_mass(p, centroids), m = part_mass(&r, centroids);
    if (tip) *tip = r;
    return mass_pick(t.below, m, mass_less(whole, m));
}
#endif
