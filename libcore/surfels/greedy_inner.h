/* greedy_inner.h: the inner loops of greedy.c, on boxes and leaves.
 *
 * Box tests are Euclidean whatever the metric: D is never below the Euclidean distance. They are
 * safe in every bit: rounding is monotone, and a box's nearest corner goes through the same
 * operations in the same order as a point inside it.
 */
#ifndef PBS_GREEDY_INNER_H
#define PBS_GREEDY_INNER_H

#include "libcore/surfels/candidates.h"
#include "libcore/data/simd8.h"

/* A candidate that is, or may become, the next surfel. */
typedef struct probe {
    pbs_place at;
    float d; /* what it is chosen with */
    size_t slot;
} probe;

static inline void probe_set(probe *p, const pbs_tree *t, size_t slot) {
    size_t leaf = slot / PBS_LEAF, k = slot % PBS_LEAF;
    const pbs_leaf *l = &t->leaf[leaf];
    *p = (probe){{{l->x[k], l->y[k], l->z[k]}, {0}}, l->d[k], slot};
    if (!t->normal) return;
    memcpy(p->at.n, t->normal[leaf].xy[k], 4);
    memcpy(p->at.n + 2, t->normal[leaf].z0[k], 4);
}

/* The squares of the distances of p to the children's boxes. */
static inline f8 fan_d2(const pbs_fan *f, const float p[3]) {
    f8 zero = f8_all(0), sum = zero;
#pragma GCC unroll 3
    for (int k = 0; k < 3; k++) {
        f8 at = f8_all(p[k]), low = f8_at(f->low[k]), high = f8_at(f->high[k]);
        f8 gap = f8_max(f8_max(f8_sub(low, at), f8_sub(at, high)), zero);
        sum = k ? f8_add(sum, f8_mul(gap, gap)) : f8_mul(gap, gap);
    }
    return sum;
}

/* The children that hold a point which p may be nearer to than all surfels so far. */
static inline unsigned fan_near(const pbs_fan *f, const float p[3]) {
    return f8_less(fan_d2(f, p), f8_at(f->max));
}

/* The children that p is in. */
static inline unsigned fan_around(const pbs_fan *f, const float p[3]) {
    return f8_equal(fan_d2(f, p), f8_all(0));
}

/* As fan_near for any p in a box. */
static inline unsigned fan_near_box(const pbs_fan *f, const float low[3], const float high[3]) {
    f8 zero = f8_all(0), sum = zero;
#pragma GCC unroll 3
    for (int k = 0; k < 3; k++) {
        f8 below = f8_sub(f8_at(f->low[k]), f8_all(high[k]));
        f8 above = f8_sub(f8_all(low[k]), f8_at(f->high[k]));
        f8 gap = f8_max(f8_max(below, above), zero);
        sum = k ? f8_add(sum, f8_mul(gap, gap)) : f8_mul(gap, gap);
    }
    return f8_less(sum, f8_at(f->max));
}

static inline unsigned fan_at_least(const pbs_fan *f, float d) {
    return ~f8_less(f8_at(f->max), f8_all(d)) & 255;
}

static inline float fan_most(const pbs_fan *f) {
    return f8_most(f8_at(f->max));
}

/* Bit by bit, a list of what is in a mask ends where the CPU did not expect it. So all eight places
 * are written, and only those that count are kept: out has room for 8 more. */
static uint64_t mask_lanes[256]; /* the numbers of the bits that are set, one a byte */
static inline void mask_lanes_fill(void) {
    for (unsigned m = 0; m < 256; m++) {
        mask_lanes[m] = 0;
        for (unsigned bit = 8; bit--;)
            if (m >> bit & 1) mask_lanes[m] = mask_lanes[m] << 8 | bit;
    }
}

static inline size_t mask_append(uint32_t *out, unsigned mask, uint32_t base) {
    i8_put_bytes(out, mask_lanes[mask], base);
    return (size_t)__builtin_popcount(mask);
}

/* The box around those children. */
static inline void fan_box(const pbs_fan *f, unsigned children, float low[3], float high[3]) {
    for (int k = 0; k < 3; k++) low[k] = INFINITY, high[k] = -INFINITY;
    for (; children; children &= children - 1) {
        int c = __builtin_ctz(children);
        for (int k = 0; k < 3; k++) {
            low[k] = f->low[k][c] < low[k] ? f->low[k][c] : low[k];
            high[k] = f->high[k][c] > high[k] ? f->high[k][c] : high[k];
        }
    }
}

/* |p - x|^2 of the points 8k .. 8k + 7, in the order of pbs_metric_d2 */
static inline f8 leaf_euclid(const pbs_leaf *l, int k, const pbs_place *p) {
    f8 x = f8_sub(f8_at(l->x + 8 * k), f8_all(p->p[0]));
    f8 y = f8_sub(f8_at(l->y + 8 * k), f8_all(p->p[1]));
    f8 z = f8_sub(f8_at(l->z + 8 * k), f8_all(p->p[2]));
    return f8_add(f8_add(f8_mul(x, x), f8_mul(y, y)), f8_mul(z, z));
}

/* What the normals make of it, as in pbs_metric_d2. */
static inline f8 leaf_stretch(const pbs_metric *m, const pbs_leaf_normals *n, int k,
                              const pbs_place *p, f8 d2) {
    f8 dot = f8_dot16(n->xy[8 * k], n->z0[8 * k], p->n);
    f8 below = f8_add(f8_all(m->base), f8_mul(f8_all(m->slope), dot));
    below = f8_min(below, f8_all(1));
    return f8_if_less(f8_all(PBS_OPPOSITE), below, f8_div(d2, below), f8_all(INFINITY));
}

/* p is a surfel now: lowers the d of the points of a leaf, and the leaf's maximum. */
static inline void leaf_touch(pbs_tree *t, size_t leaf, const probe *p) {
    enum { VECTORS = PBS_LEAF / 8 };
    pbs_leaf *l = &t->leaf[leaf];
    f8 old[VECTORS], d2[VECTORS];
    unsigned hit = leaf == p->slot / PBS_LEAF; /* its own leaf has lost its maximum */
#pragma GCC unroll 4
    for (int k = 0; k < VECTORS; k++) {
        old[k] = f8_at(l->d + 8 * k);
        d2[k] = leaf_euclid(l, k, &p->at);
        hit |= f8_less(d2[k], old[k]);
    }
    if (!hit) return;
    f8 most = f8_all(0);
#pragma GCC unroll 4
    for (int k = 0; k < VECTORS; k++) {
        if (t->normal) d2[k] = leaf_stretch(&t->metric, &t->normal[leaf], k, &p->at, d2[k]);
        d2[k] = f8_min(d2[k], old[k]);
        f8_put(l->d + 8 * k, d2[k]);
        most = f8_max(most, d2[k]);
    }
    t->fan[0][leaf / PBS_FAN].max[leaf % PBS_FAN] = f8_most(most);
}

/* The slot with the largest d of a leaf, ties to the lower index; max is its value. The indices
 * are looked at only if there are ties: they are far away. */
static inline size_t leaf_first(const pbs_tree *t, size_t leaf, float max) {
    const float *d = t->leaf[leaf].d;
    const uint32_t *id = t->id + leaf * PBS_LEAF;
    uint32_t ties = 0;
    for (int k = 0; k < PBS_LEAF; k += 8) ties |= f8_equal(f8_at(d + k), f8_all(max)) << k;
    unsigned at = (unsigned)__builtin_ctz(ties);
    for (ties &= ties - 1; ties; ties &= ties - 1) {
        unsigned i = (unsigned)__builtin_ctz(ties);
        if (id[i] < id[at]) at = i;
    }
    return leaf * PBS_LEAF + at;
}

/* Of the points of a leaf that come before *best and that p is near enough to lower, the first
 * becomes *best. It begins as p itself. */
static inline void leaf_rival(const pbs_tree *t, size_t leaf, const probe *p, probe *best) {
    const pbs_leaf *l = &t->leaf[leaf];
#pragma GCC unroll 4
    for (int k = 0; k < PBS_LEAF / 8; k++) {
        size_t first = leaf * PBS_LEAF + (size_t)k * 8;
        f8 d = f8_at(l->d + 8 * k);
        unsigned m = ~f8_less(d, f8_all(best->d)) & 255;
        if (p->slot - first < 8) m &= ~(1u << (p->slot - first));
        if (!m) continue;
        f8 d2 = leaf_euclid(l, k, &p->at);
        if (t->normal) d2 = leaf_stretch(&t->metric, &t->normal[leaf], k, &p->at, d2);
        for (m &= f8_less(d2, d); m; m &= m - 1) {
            size_t slot = first + (unsigned)__builtin_ctz(m);
            float value = l->d[slot % PBS_LEAF];
            if (value > best->d || (value == best->d && t->id[slot] < t->id[best->slot]))
                best->d = value, best->slot = slot;
        }
    }
}

/* Leaves are asked for before they are needed: they are seldom in a cache. */
static inline void leaf_prefetch(const pbs_tree *t, size_t leaf) {
    const char *l = (const char *)&t->leaf[leaf];
#pragma GCC unroll 8
    for (size_t at = 0; at < sizeof *t->leaf; at += 64) __builtin_prefetch(l + at, 1);
}
#endif
