/* Who owns what (cover.h).
 *
 * This file is compiled a second time for AVX2, by cover_avx2.c. */
#include "libcore/surfels/cover.h"
#include "libcore/surfels/greedy_inner.h"
#include "libcore/ground/pipe.h"

#ifndef PBS_COVER_NAME
#define PBS_COVER_NAME(name) name
#endif

/* ---- one surfel ---- */

/* A part of the work: every surfel, and the leaves below fans first .. end - 1 of level 0. No two
 * parts touch the same leaf. */
typedef struct walk {
    const pbs_cover *c;
    pbs_place at;
    size_t slot;
    uint32_t rank;
    f8 most; /* d above this are not asked for */
    size_t first, end;
} walk;

/* Without its d, which another thread may be changing. */
static inline void walk_to(walk *w, const pbs_cover_surfel *s) {
    const pbs_tree *t = w->c->tree;
    size_t leaf = s->slot / PBS_LEAF, k = s->slot % PBS_LEAF;
    const pbs_leaf *l = &t->leaf[leaf];
    w->at = (pbs_place){{l->x[k], l->y[k], l->z[k]}, {0}};
    w->slot = s->slot;
    w->rank = s->rank;
    if (!t->normal) return;
    memcpy(w->at.n, t->normal[leaf].xy[k], 4);
    memcpy(w->at.n + 2, t->normal[leaf].z0[k], 4);
}

/* What the normals make of the squares of the plain distances. */
static inline f8 lanes_stretch(const walk *w, size_t leaf, int k, f8 d2) {
    const pbs_tree *t = w->c->tree;
    if (!t->normal) return d2;
    const pbs_leaf_normals *n = &t->normal[leaf];
    if (w->c->kind != PBS_COVER_SIDE) return leaf_stretch(&t->metric, n, k, &w->at, d2);
    f8 dot = f8_dot16(n->xy[8 * k], n->z0[8 * k], w->at.n);
    return f8_if_less(f8_all(0), dot, d2, f8_all(INFINITY));
}

static inline f8 bits_of(uint32_t v) {
    float f;
    memcpy(&f, &v, 4);
    return f8_all(f);
}

/* Ties are rare: point by point. */
static void settle_ties(const walk *w, uint32_t *owner, unsigned ties) {
    for (; ties; ties &= ties - 1) {
        uint32_t *o = owner + __builtin_ctz(ties);
        if (w->rank < *o) *o = w->rank;
    }
}

static inline void cover_lanes(const walk *w, size_t leaf) {
    enum { VECTORS = PBS_LEAF / 8 };
    pbs_leaf *l = &w->c->tree->leaf[leaf];
    uint32_t *owner = w->c->owner + leaf * PBS_LEAF;
    f8 old[VECTORS], d2[VECTORS], most = f8_all(0);
    unsigned far = 255;
#pragma GCC unroll 4
    for (int k = 0; k < VECTORS; k++) {
        old[k] = f8_at(l->d + 8 * k);
        d2[k] = leaf_euclid(l, k, &w->at);
        far &= f8_less(old[k], d2[k]);
    }
    if (far == 255) return;
#pragma GCC unroll 4
    for (int k = 0; k < VECTORS; k++) {
        d2[k] = lanes_stretch(w, leaf, k, d2[k]);
        unsigned ties = f8_equal(d2[k], old[k]) & f8_less(d2[k], f8_all(INFINITY));
        if (ties) settle_ties(w, owner + 8 * k, ties);
        float *o = (float *)(void *)(owner + 8 * k); /* moved, never computed with */
        f8_put(o, f8_if_less(d2[k], old[k], bits_of(w->rank), f8_at(o)));
        d2[k] = f8_min(d2[k], old[k]);
        f8_put(l->d + 8 * k, d2[k]);
        most = f8_max(most, d2[k]);
    }
    w->c->tree->fan[0][leaf / PBS_FAN].max[leaf % PBS_FAN] = f8_most(most);
}

/* A surfel's own slot is left as it was where only the others count; its leaf's maximum with it. */
static void cover_leaf(const walk *w, size_t leaf) {
    if (w->c->kind != PBS_COVER_OTHERS || w->slot / PBS_LEAF != leaf) {
        cover_lanes(w, leaf);
        return;
    }
    float *d = &w->c->tree->leaf[leaf].d[w->slot % PBS_LEAF], d_before = *d;
    uint32_t *owner = &w->c->owner[w->slot], owner_before = *owner;
    cover_lanes(w, leaf);
    *d = d_before, *owner = owner_before;
    float *max = &w->c->tree->fan[0][leaf / PBS_FAN].max[leaf % PBS_FAN];
    *max = *max > d_before ? *max : d_before;
}

static void cover_fan(const walk *w, int level, size_t fan) {
    const pbs_fan *f = &w->c->tree->fan[level][fan];
    f8 limit = f8_min(f8_at(f->max), w->most);
    unsigned near = ~f8_less(limit, fan_d2(f, w->at.p)) & 255;
    for (; near; near &= near - 1) {
        size_t child = fan * PBS_FAN + (unsigned)__builtin_ctz(near);
        if (!level) {
            cover_leaf(w, child);
            continue;
        }
        int shift = 3 * (level - 1);
        if (child << shift < w->end && (child + 1) << shift > w->first)
            cover_fan(w, level - 1, child);
    }
}

/* ---- all surfels ---- */

typedef struct pass {
    const pbs_cover *c;
    const pbs_cover_surfel *surfels;
    size_t count;
    float radius2;
    int parts;
} pass;

static pbs_code cover_part(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    const pass *s = ctx;
    const pbs_tree *t = s->c->tree;
    walk w = {.c = s->c, .most = f8_all(s->radius2)};
    w.first = pbs_part_begin(t->fans[0], s->parts, i);
    w.end = pbs_part_end(t->fans[0], s->parts, i);
    for (size_t k = 0; k < s->count; k++) {
        walk_to(&w, &s->surfels[k]);
        cover_fan(&w, t->levels - 1, 0);
    }
    return PBS_OK;
}

static void raise_max(const pbs_tree *t) {
    for (int level = 1; level < t->levels; level++)
        for (size_t i = 0; i < t->fans[level - 1]; i++)
            t->fan[level][i / PBS_FAN].max[i % PBS_FAN] = fan_most(&t->fan[level - 1][i]);
}

/* Surfels are looked at in runs, so that somebody who wants to stop need not wait. */
enum { RUN = 1 << 16 };

static pbs_code cover_pass(pbs_run *run, pass s, size_t count, pbs_err *err) {
    const pbs_cover_surfel *all = s.surfels;
    pbs_code rc = PBS_OK;
    for (size_t at = 0; at < count && !rc; at += RUN) {
        s.surfels = all + at;
        s.count = count - at < RUN ? count - at : RUN;
        rc = pbs_run_check(run, err);
        if (!rc) rc = pbs_parallel(run, (size_t)s.parts, cover_part, &s, err);
    }
    raise_max(s.c->tree);
    return rc;
}

/* D of two points can be this much longer than the way between them: 2^7. */
#define LONGEST 0x1p14f

pbs_code PBS_COVER_NAME(pbs_cover_add)(pbs_run *run, const pbs_cover *c,
                                       const pbs_cover_surfel *surfels, size_t count, float radius2,
                                       bool once, pbs_err *err) {
    const pbs_tree *t = c->tree;
    double diagonal = t->metric.diagonal * t->metric.length;
    float least = (float)(diagonal * diagonal) * 0x1p-40f;
    pass s = {.c = c, .surfels = surfels, .radius2 = radius2};
    s.parts = pbs_parts(run, t->points, PBS_TREE_PART);
    if (!(s.radius2 > least)) s.radius2 = least;
    for (;;) {
        pbs_code rc = cover_pass(run, s, count, err);
        float most = fan_most(&t->fan[t->levels - 1][0]);
        if (rc || once || most <= s.radius2 || !(s.radius2 < INFINITY)) return rc;
        /* What is farther than anything can be finitely far has no owner; one walk tells. */
        s.radius2 = s.radius2 < (float)(diagonal * diagonal) * LONGEST ? 4 * s.radius2 : INFINITY;
    }
}

#ifndef PBS_COVER_ONCE
#define PBS_COVER_ONCE

static pbs_code begin_part(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    const pass *s = ctx;
    const pbs_tree *t = s->c->tree;
    for (size_t leaf = pbs_part_begin(t->leaves, s->parts, i);
         leaf < pbs_part_end(t->leaves, s->parts, i); leaf++)
        for (size_t k = 0; k < PBS_LEAF; k++) {
            t->leaf[leaf].d[k] = leaf * PBS_LEAF + k < t->points ? INFINITY : 0;
            s->c->owner[leaf * PBS_LEAF + k] = PBS_NOBODY;
        }
    return PBS_OK;
}

pbs_code pbs_cover_begin(pbs_run *run, const pbs_cover *c, pbs_err *err) {
    const pbs_tree *t = c->tree;
    pass s = {.c = c, .parts = pbs_parts(run, t->points, PBS_TREE_PART)};
    pbs_code rc = pbs_parallel(run, (size_t)s.parts, begin_part, &s, err);
    if (rc) return rc;
    for (size_t i = 0; i < t->fans[0] * PBS_FAN; i++)
        t->fan[0][i / PBS_FAN].max[i % PBS_FAN] = i < t->leaves ? INFINITY : 0;
    raise_max(t);
    return PBS_OK;
}

float pbs_cover_radius2(const pbs_metric *m, double length) {
    if (!(length < m->diagonal)) return INFINITY;
    double r = length * m->length * (1 + 1e-6);
    return (float)(r * r);
}

void pbs_cover_find(const pbs_tree *t, const uint32_t *order, size_t count, uint32_t *scratch,
                    size_t candidates, pbs_cover_surfel *out) {
    /* Most candidates are no surfels: a bit for each stays in the cache. */
    size_t words = (candidates + 31) / 32, found = 0;
    memset(scratch, 0, words * sizeof *scratch);
    for (size_t i = 0; i < count; i++) scratch[order[i] / 32] |= 1u << order[i] % 32;
    for (size_t slot = 0; slot < t->points; slot++) {
        uint32_t id = t->id[slot];
        if (scratch[id / 32] >> id % 32 & 1) out[found++].slot = (uint32_t)slot;
    }
    for (size_t i = 0; i < count; i++) scratch[order[i]] = (uint32_t)i;
    for (size_t i = 0; i < found; i++) out[i].rank = scratch[t->id[out[i].slot]];
}
#endif
