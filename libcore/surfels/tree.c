/* Builds the tree of candidates.h: sorts the candidates along Hilbert's curve and fills the leaves.
 *
 * This file is compiled a second time for AVX2, by tree_avx2.c. */
#include "libcore/surfels/candidates.h"
#include "libcore/surfels/hilbert.h"
#include "libcore/ground/pipe.h"
#include "libcore/data/simd8.h"
#include <float.h>

#ifndef PBS_TREE_NAME
#define PBS_TREE_NAME(name) name
#endif

enum { DIGIT = PBS_HILBERT_BITS / 2, DIGITS = PBS_TREE_DIGITS };
enum { SMALL = 2 * PBS_LEAF /* points in a cell */, AHEAD = 48 /* entries to prefetch */ };
enum { FEW = 1 << 13 /* so few that a count for each digit would be the most work */ };
_Static_assert(1 << DIGIT == DIGITS, "two passes");

/* Cubic cells over a box; per 0: the box has no size that a distance could tell. */
typedef struct cells {
    float low[3], per;
} cells;

typedef struct sorter {
    pbs_tree *tree;
    const pbs_points *in;
    const pbs_hilbert *curve;
    cells cells;
    uint64_t *from, *to; /* key << 32 | candidate */
    int shift, parts;
    size_t first[PBS_PARTS + 1]; /* of each part's entries, where they are not n / parts apart */
} sorter;

static const float *position_of(const sorter *s, size_t candidate) {
    return s->in->position + 3 * candidate;
}

static cells cells_over(const float low[3], const float high[3]) {
    float side = 0;
    cells c = {{low[0], low[1], low[2]}, 0};
    for (int k = 0; k < 3; k++) side = high[k] - low[k] > side ? high[k] - low[k] : side;
    if (side > 0) c.per = (1 << PBS_HILBERT_AXIS) / side;
    if (!(c.per < FLT_MAX)) c.per = 0;
    return c;
}

/* Eight scaled positions at a time. */
typedef struct batch {
    float p[3][8];
    uint32_t id[8];
    int count;
} batch;

static void write_batch(const sorter *s, const cells *c, const batch *b, uint64_t *out) {
    int32_t cell[3][8];
    const f8 last = f8_all((1 << PBS_HILBERT_AXIS) - 1);
    for (int k = 0; k < 3; k++) {
        f8 v = f8_sub(f8_at(b->p[k]), f8_all(c->low[k]));
        v = f8_max(f8_mul(v, f8_all(c->per)), f8_all(0)); /* lanes beyond count are anything */
        f8_to_int(cell[k], f8_min(v, last));
    }
    for (int i = 0; i < b->count; i++) {
        uint32_t key = pbs_hilbert_index(s->curve, (unsigned)cell[0][i], (unsigned)cell[1][i],
                                         (unsigned)cell[2][i]);
        out[i] = (uint64_t)key << 32 | b->id[i];
    }
}

static inline void batch_add(batch *b, const float p[3], uint32_t id) {
    for (int k = 0; k < 3; k++) b->p[k][b->count] = p[k];
    b->id[b->count++] = id;
}

/* ---- sorting ---- */

static pbs_code count_valid(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    sorter *s = ctx;
    size_t n = s->in->count, valid = 0;
    float p[3];
    for (size_t j = pbs_part_begin(n, s->parts, i); j < pbs_part_end(n, s->parts, i); j++)
        valid += pbs_scaled(&s->tree->metric, position_of(s, j), p);
    s->first[i] = valid;
    return PBS_OK;
}

static pbs_code write_keys(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    sorter *s = ctx;
    const pbs_metric m = s->tree->metric;
    size_t n = s->in->count, end = pbs_part_end(n, s->parts, i);
    bool all_valid = s->tree->invalid == 0;
    uint64_t *out = s->from + s->first[i];
    batch b = {.count = 0};
    for (size_t j = pbs_part_begin(n, s->parts, i); j < end; j++) {
        float p[3];
        if (!pbs_scaled(&m, position_of(s, j), p) && !all_valid) continue;
        batch_add(&b, p, (uint32_t)j);
        if (b.count < 8) continue;
        write_batch(s, &s->cells, &b, out);
        out += 8;
        b.count = 0;
    }
    write_batch(s, &s->cells, &b, out);
    return PBS_OK;
}

static pbs_code count_digits(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    sorter *s = ctx;
    size_t n = s->tree->points, end = pbs_part_end(n, s->parts, i);
    uint32_t *count = s->tree->digits + i * DIGITS;
    memset(count, 0, DIGITS * sizeof *count);
    for (size_t j = pbs_part_begin(n, s->parts, i); j < end; j++)
        count[s->from[j] >> s->shift & (DIGITS - 1)]++;
    return PBS_OK;
}

static pbs_code scatter(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    sorter *s = ctx;
    size_t n = s->tree->points, end = pbs_part_end(n, s->parts, i);
    uint32_t *at = s->tree->digits + i * DIGITS;
    uint64_t *from = s->from, *to = s->to;
    for (size_t j = pbs_part_begin(n, s->parts, i); j < end; j++)
        to[at[from[j] >> s->shift & (DIGITS - 1)]++] = from[j];
    return PBS_OK;
}

/* One pass of a radix sort. Parts count and scatter for themselves; where a part's entries of a
 * digit go follows from the sums over (digit, part), so it is stable for any number of parts. */
static pbs_code radix_pass(pbs_run *run, sorter *s, int shift, pbs_err *err) {
    s->shift = shift;
    pbs_code rc = pbs_parallel(run, (size_t)s->parts, count_digits, s, err);
    if (rc) return rc;
    uint32_t sum = 0;
    for (int d = 0; d < DIGITS; d++)
        for (int i = 0; i < s->parts; i++) {
            uint32_t c = s->tree->digits[i * DIGITS + d];
            s->tree->digits[i * DIGITS + d] = sum;
            sum += c;
        }
    rc = pbs_parallel(run, (size_t)s->parts, scatter, s, err);
    uint64_t *t = s->from;
    s->from = s->to, s->to = t;
    return rc;
}

static void radix_small(uint64_t *v, uint64_t *tmp, size_t n) {
    for (int shift = 32; shift < 32 + PBS_HILBERT_BITS; shift += 8) {
        uint32_t at[256] = {0}, sum = 0;
        for (size_t i = 0; i < n; i++) at[v[i] >> shift & 255]++;
        for (int d = 0; d < 256; d++) {
            uint32_t c = at[d];
            at[d] = sum, sum += c;
        }
        for (size_t i = 0; i < n; i++) tmp[at[v[i] >> shift & 255]++] = v[i];
        memcpy(v, tmp, n * sizeof *v);
    }
}

static size_t run_length(const uint64_t *v, size_t n) {
    size_t i = 1;
    while (i < n && v[i] >> 32 == v[0] >> 32) i++;
    return i;
}

/* Many points in one cell: a far outlier, or simply many points. They are sorted again in cells
 * over their own box. Every level has a smaller box, or a box of no size, which ends it. */
static void refine(const sorter *s, uint64_t *v, uint64_t *tmp, size_t n) {
    const pbs_metric *m = &s->tree->metric;
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    float p[3];
    for (size_t i = 0; i < n; i++) {
        pbs_scaled(m, position_of(s, (uint32_t)v[i]), p);
        for (int k = 0; k < 3; k++) {
            low[k] = p[k] < low[k] ? p[k] : low[k];
            high[k] = p[k] > high[k] ? p[k] : high[k];
        }
    }
    cells c = cells_over(low, high);
    if (c.per == 0) return;
    for (size_t i = 0; i < n; i += 8) {
        batch b = {.count = 0};
        for (size_t j = i; j < n && j < i + 8; j++) {
            pbs_scaled(m, position_of(s, (uint32_t)v[j]), p);
            batch_add(&b, p, (uint32_t)v[j]);
        }
        write_batch(s, &c, &b, v + i);
    }
    radix_small(v, tmp, n);
    for (size_t i = 0, k; i < n; i += k) {
        k = run_length(v + i, n - i);
        if (k > SMALL) refine(s, v + i, tmp + i, k);
    }
}

static pbs_code refine_part(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    sorter *s = ctx;
    uint64_t *v = s->from;
    for (size_t k, at = s->first[i]; at < s->first[i + 1]; at += k) {
        k = run_length(v + at, s->tree->points - at);
        if (k > SMALL) refine(s, v + at, s->to + at, k);
    }
    return PBS_OK;
}

/* The parts of refine_part begin where runs begin. */
static void first_runs(sorter *s) {
    size_t n = s->tree->points;
    s->first[0] = 0;
    s->first[s->parts] = n;
    for (int i = 1; i < s->parts; i++) {
        size_t at = pbs_part_begin(n, s->parts, (size_t)i);
        if (at < s->first[i - 1]) at = s->first[i - 1];
        while (at && at < n && s->from[at] >> 32 == s->from[at - 1] >> 32) at++;
        s->first[i] = at;
    }
}

/* Where each part's valid candidates go. */
static pbs_code first_valid(pbs_run *run, sorter *s, pbs_err *err) {
    size_t sum = 0;
    pbs_code rc =
        s->tree->invalid ? pbs_parallel(run, (size_t)s->parts, count_valid, s, err) : PBS_OK;
    for (int i = 0; i < s->parts; i++) {
        size_t c = s->first[i];
        s->first[i] = s->tree->invalid ? sum : pbs_part_begin(s->in->count, s->parts, (size_t)i);
        sum += c;
    }
    return rc;
}

static pbs_code sort(pbs_run *run, sorter *s, pbs_err *err) {
    const pbs_metric *m = &s->tree->metric;
    float low[3], high[3];
    for (int k = 0; k < 3; k++) low[k] = (float)m->low[k], high[k] = (float)m->high[k];
    s->cells = cells_over(low, high);
    s->curve = pbs_hilbert_get();
    pbs_code rc = first_valid(run, s, err);
    if (!rc) rc = pbs_parallel(run, (size_t)s->parts, write_keys, s, err);
    if (!rc && s->tree->points < FEW)
        radix_small(s->from, s->to, s->tree->points);
    else
        for (int shift = 0; shift < PBS_HILBERT_BITS && !rc; shift += DIGIT)
            rc = radix_pass(run, s, 32 + shift, err);
    if (!rc) first_runs(s);
    if (!rc) rc = pbs_parallel(run, (size_t)s->parts, refine_part, s, err);
    return rc;
}

/* ---- filling ---- */

static void fan_set(pbs_fan *f, int c, const float low[3], const float high[3], float max) {
    for (int k = 0; k < 3; k++) f->low[k][c] = low[k], f->high[k][c] = high[k];
    f->max[c] = max;
}

static void least_and_most(const float *v, float *least, float *most) {
    f8 low = f8_at(v), high = low;
    for (int k = 8; k < PBS_LEAF; k += 8) {
        low = f8_min(low, f8_at(v + k));
        high = f8_max(high, f8_at(v + k));
    }
    *least = -f8_most(f8_sub(f8_all(0), low));
    *most = f8_most(high);
}

static void fill_leaf(const sorter *s, size_t leaf, pbs_fan *fan) {
    pbs_tree *t = s->tree;
    pbs_leaf *l = &t->leaf[leaf];
    uint32_t *id = t->id + leaf * PBS_LEAF;
    size_t first = leaf * PBS_LEAF, here = t->points - first;
    here = here < PBS_LEAF ? here : PBS_LEAF;
    if (first + AHEAD + PBS_LEAF <= t->points)
        for (size_t i = 0; i < PBS_LEAF; i++)
            __builtin_prefetch(position_of(s, (uint32_t)s->from[first + AHEAD + i]));
    for (size_t i = 0; i < PBS_LEAF; i++) {
        float p[3];
        id[i] = (uint32_t)s->from[first + (i < here ? i : here - 1)];
        pbs_scaled(&t->metric, position_of(s, id[i]), p);
        l->x[i] = p[0], l->y[i] = p[1], l->z[i] = p[2];
        l->d[i] = i < here ? INFINITY : 0;
    }
    float low[3], high[3];
    least_and_most(l->x, &low[0], &high[0]);
    least_and_most(l->y, &low[1], &high[1]);
    least_and_most(l->z, &low[2], &high[2]);
    fan_set(fan, (int)(leaf % PBS_FAN), low, high, INFINITY);
}

static const float NOWHERE_LOW[3] = {INFINITY, INFINITY, INFINITY};
static const float NOWHERE_HIGH[3] = {-INFINITY, -INFINITY, -INFINITY};

static pbs_code fill_part(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    sorter *s = ctx;
    pbs_tree *t = s->tree;
    size_t n = t->fans[0];
    for (size_t f = pbs_part_begin(n, s->parts, i); f < pbs_part_end(n, s->parts, i); f++)
        for (size_t leaf = f * PBS_FAN; leaf < (f + 1) * PBS_FAN; leaf++) {
            if (leaf < t->leaves)
                fill_leaf(s, leaf, &t->fan[0][f]);
            else
                fan_set(&t->fan[0][f], (int)(leaf % PBS_FAN), NOWHERE_LOW, NOWHERE_HIGH, 0);
        }
    return PBS_OK;
}

static f8 f8_mirror(f8 v, f8 by) {
    f8 zero = f8_all(0);
    return f8_add(v, f8_if_less(v, zero, by, f8_sub(zero, by)));
}

static f8 f8_snorm16(f8 v) {
    v = f8_max(f8_min(v, f8_all(1)), f8_all(-1));
    f8 half = f8_if_less(v, f8_all(0), f8_all(-0.5f), f8_all(0.5f));
    return f8_add(f8_mul(v, f8_all(32767)), half);
}

/* pbs_place_normal, eight at a time. */
static void fill_eight_normals(const int16_t oct[8][2], int16_t (*xy)[2], int16_t (*z0)[2]) {
    f8 x, y, zero = f8_all(0), one = f8_all(1);
    f8_of_pairs(&oct[0][0], &x, &y);
    x = f8_mul(x, f8_all(1 / 32767.0f));
    y = f8_mul(y, f8_all(1 / 32767.0f));
    f8 z = f8_sub(f8_sub(one, f8_max(x, f8_sub(zero, x))), f8_max(y, f8_sub(zero, y)));
    f8 over = f8_max(f8_sub(zero, z), zero);
    x = f8_mirror(x, over);
    y = f8_mirror(y, over);
    f8 square = f8_add(f8_add(f8_mul(x, x), f8_mul(y, y)), f8_mul(z, z));
    f8 l = f8_div(one, f8_sqrt(square));
    f8_to_pairs(xy[0], f8_snorm16(f8_mul(x, l)), f8_snorm16(f8_mul(y, l)));
    f8_to_pairs(z0[0], f8_snorm16(f8_mul(z, l)), zero);
}

/* After the leaves, because the sort's entries lie where the normals go. */
static pbs_code fill_normals(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    sorter *s = ctx;
    pbs_tree *t = s->tree;
    size_t n = t->leaves * PBS_LEAF / 8, end = pbs_part_end(n, s->parts, i);
    for (size_t j = pbs_part_begin(n, s->parts, i); j < end; j++) {
        pbs_leaf_normals *l = &t->normal[j * 8 / PBS_LEAF];
        size_t at = j * 8 % PBS_LEAF;
        int16_t oct[8][2];
        if (j + AHEAD / 8 < n)
            for (size_t k = 0; k < 8; k++)
                __builtin_prefetch(s->in->normal + 2 * (size_t)t->id[j * 8 + AHEAD + k]);
        for (size_t k = 0; k < 8; k++)
            memcpy(oct[k], s->in->normal + 2 * (size_t)t->id[j * 8 + k], 4);
        fill_eight_normals(oct, l->xy + at, l->z0 + at);
    }
    return PBS_OK;
}

/* The box around a fan's children is a child of the fan above. */
static void fill_above(const pbs_fan *f, pbs_fan *above, int c) {
    float low[3], high[3];
    for (int k = 0; k < 3; k++) {
        low[k] = -f8_most(f8_sub(f8_all(0), f8_at(f->low[k])));
        high[k] = f8_most(f8_at(f->high[k]));
    }
    fan_set(above, c, low, high, f8_most(f8_at(f->max)));
}

static void fill_levels(pbs_tree *t) {
    for (int level = 1; level < t->levels; level++)
        for (size_t i = 0; i < t->fans[level] * PBS_FAN; i++) {
            pbs_fan *above = &t->fan[level][i / PBS_FAN];
            int c = (int)(i % PBS_FAN);
            if (i < t->fans[level - 1])
                fill_above(&t->fan[level - 1][i], above, c);
            else
                fan_set(above, c, NOWHERE_LOW, NOWHERE_HIGH, 0);
        }
}

pbs_code PBS_TREE_NAME(pbs_tree_build)(pbs_run *run, pbs_tree *t, const pbs_points *in,
                                       pbs_err *err) {
    sorter s = {.tree = t, .in = in};
    t->points = in->count - t->invalid;
    t->leaves = (t->points + PBS_LEAF - 1) / PBS_LEAF;
    s.parts = pbs_parts(run, in->count, PBS_TREE_PART);
    /* The sort goes to and fro between the places of the normals and of the leaves. */
    s.from = (uint64_t *)t->normal;
    s.to = (uint64_t *)t->leaf;
    pbs_code rc = sort(run, &s, err);
    if (!rc) rc = pbs_parallel(run, (size_t)s.parts, fill_part, &s, err);
    if (!rc && t->metric.normals) rc = pbs_parallel(run, (size_t)s.parts, fill_normals, &s, err);
    if (!rc) fill_levels(t);
    if (!t->metric.normals) t->normal = NULL;
    return rc;
}
