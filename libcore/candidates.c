#include "libcore/candidates.h"
#include "libcore/pipe.h"
#include "libcore/vec.h"
#include <float.h>
#include <string.h>

int pbs_parts(const pbs_run *run, size_t things, size_t least) {
    size_t most = things / least, parts = run->threads < PBS_PARTS ? (size_t)run->threads : PBS_PARTS;
    if (parts > most) parts = most;
    return parts ? (int)parts : 1;
}

static size_t part_begin(size_t n, int parts, size_t i) { return n / (size_t)parts * i; }
static size_t part_end(size_t n, int parts, size_t i) {
    return (int)i + 1 == parts ? n : part_begin(n, parts, i + 1);
}

/* ---- the metric ---- */

typedef struct bounds {
    float low[3], high[3];
    size_t invalid;
} bounds;

typedef struct measure {
    const pbs_points *in;
    int parts;
    bounds part[PBS_PARTS];
} measure;

static void bounds_add(bounds *b, const float p[3]) {
    if (!isfinite(p[0]) || !isfinite(p[1]) || !isfinite(p[2])) {
        b->invalid++;
        return;
    }
    for (int k = 0; k < 3; k++) {
        b->low[k] = p[k] < b->low[k] ? p[k] : b->low[k];
        b->high[k] = p[k] > b->high[k] ? p[k] : b->high[k];
    }
}

enum { BATCH = 8 };

/* Eight points are 24 floats, in which the axes repeat: plain vector code. Gives up, false, at
 * the first coordinate that is not finite: v - v is 0 for the others. */
static bool bounds_of_batches(bounds *b, const float *p, size_t batches) {
    float low[3 * BATCH], high[3 * BATCH], odd[3 * BATCH] = {0};
    for (int k = 0; k < 3 * BATCH; k++) low[k] = INFINITY, high[k] = -INFINITY;
    for (size_t i = 0; i < batches; i++, p += 3 * BATCH)
        for (int k = 0; k < 3 * BATCH; k++) {
            float v = p[k];
            low[k] = v < low[k] ? v : low[k];
            high[k] = v > high[k] ? v : high[k];
            odd[k] += v - v;
        }
    for (int k = 0; k < 3 * BATCH; k++)
        if (odd[k] != 0) return false;
    for (int k = 0; k < 3 * BATCH; k += 3)
        if (batches) bounds_add(b, low + k), bounds_add(b, high + k);
    return true;
}

static pbs_code measure_part(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    measure *m = ctx;
    size_t at = part_begin(m->in->count, m->parts, i), end = part_end(m->in->count, m->parts, i);
    bounds *b = &m->part[i];
    *b = (bounds){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}, 0};
    size_t batches = (end - at) / BATCH;
    if (bounds_of_batches(b, m->in->position + 3 * at, batches)) at += batches * BATCH;
    for (; at < end; at++) bounds_add(b, m->in->position + 3 * at);
    return PBS_OK;
}

static void metric_scale(pbs_metric *m, const bounds *b) {
    double side = 0, square = 0;
    int e = 53;
    for (int k = 0; k < 3; k++) {
        double s = (double)b->high[k] - b->low[k];
        side = s > side ? s : side;
        square += s * s;
    }
    if (side > 0) frexp(side, &e);
    int up = 53 - e, first = up > 127 ? 127 : up;
    m->up = ldexpf(1, first);
    m->up2 = ldexpf(1, up - first);
    m->length = ldexp(1, up);
    m->diagonal = sqrt(square);
    for (int k = 0; k < 3; k++) {
        m->low[k] = (double)b->low[k] * m->length;
        m->high[k] = (double)b->high[k] * m->length;
    }
}

pbs_code pbs_metric_set(pbs_run *run, pbs_metric *m, const pbs_points *in, float weight,
                        size_t *invalid, pbs_err *err) {
    measure work = {in, pbs_parts(run, in->count, 1 << 16), {{{0}, {0}, 0}}};
    pbs_code rc = pbs_parallel(run, (size_t)work.parts, measure_part, &work, err);
    if (rc) return rc;
    bounds all = work.part[0];
    for (int i = 1; i < work.parts; i++) {
        bounds_add(&all, work.part[i].low);
        bounds_add(&all, work.part[i].high);
        all.invalid += work.part[i].invalid;
    }
    *m = (pbs_metric){0};
    if (all.low[0] <= all.high[0]) metric_scale(m, &all);
    float w = weight > 1 ? 1 : weight > 0 ? weight : 0;
    m->normals = in->normal && w > 0;
    m->base = 1 - w * w / 2;
    m->slope = w * w / 2 / (32767.0f * 32767.0f);
    *invalid = all.invalid;
    return PBS_OK;
}

void pbs_place_normal(int16_t out[4], const int16_t oct[2]) {
    float n[3];
    pbs_oct_decode(n, oct);
    for (int k = 0; k < 3; k++) out[k] = pbs_snorm16(n[k]);
    out[3] = 0;
}

/* ---- the curve: Hilbert's, 8 bits an axis (Hamilton, Compact Hilbert indices, 2006) ---- */

enum { BITS = 8, STEP = 2, KEY_BITS = 3 * BITS, STATES = 24 };

typedef struct curve {
    uint32_t spread[1 << BITS];             /* bit i to bit 3i */
    uint16_t step[STATES][1 << (3 * STEP)]; /* of two levels' octants: index << 5 | next state */
} curve;

static unsigned rotate3(unsigned v, unsigned by) {
    by %= 3;
    return ((v << by) | (v >> (3 - by))) & 7;
}

/* One level: the octant's place along the curve in state (entry, axis), and the state inside it. */
static unsigned hilbert_level(unsigned octant, unsigned *state) {
    static const uint8_t entry[8] = {0, 0, 0, 3, 3, 6, 6, 5}, axis[8] = {0, 1, 1, 2, 2, 1, 1, 0};
    unsigned e = *state / 3, d = *state % 3;
    unsigned g = rotate3(octant ^ e, 2 - d); /* right by d + 1 */
    unsigned w = g ^ (g >> 1) ^ (g >> 2);
    *state = (e ^ rotate3(entry[w], d + 1)) * 3 + (d + axis[w] + 1) % 3;
    return w;
}

static void curve_init(curve *c) {
    for (unsigned v = 0; v < 1 << BITS; v++) {
        c->spread[v] = 0;
        for (int b = 0; b < BITS; b++) c->spread[v] |= (v >> b & 1) << (3 * b);
    }
    for (unsigned s = 0; s < STATES; s++)
        for (unsigned two = 0; two < 64; two++) {
            unsigned state = s, high = hilbert_level(two >> 3, &state);
            unsigned low = hilbert_level(two & 7, &state);
            c->step[s][two] = (uint16_t)((high << 3 | low) << 5 | state);
        }
}

static uint32_t curve_index(const curve *c, const unsigned cell[3]) {
    uint32_t octants = c->spread[cell[0]] | c->spread[cell[1]] << 1 | c->spread[cell[2]] << 2;
    uint32_t index = 0, state = 0;
    for (int shift = KEY_BITS - 3 * STEP; shift >= 0; shift -= 3 * STEP) {
        uint32_t s = c->step[state][octants >> shift & 63];
        index = index << (3 * STEP) | s >> 5;
        state = s & 31;
    }
    return index;
}

/* Cubic cells over a box; per 0: the box has no size that a distance could tell. */
typedef struct cells {
    float low[3], per;
} cells;

static cells cells_over(const float low[3], const float high[3]) {
    float side = 0;
    cells c = {{low[0], low[1], low[2]}, 0};
    for (int k = 0; k < 3; k++) side = high[k] - low[k] > side ? high[k] - low[k] : side;
    if (side > 0) c.per = (1 << BITS) / side;
    if (!(c.per < FLT_MAX)) c.per = 0;
    return c;
}

static uint32_t cells_key(const cells *c, const curve *along, const float p[3]) {
    unsigned cell[3];
    for (int k = 0; k < 3; k++) {
        int v = (int)((p[k] - c->low[k]) * c->per);
        cell[k] = v < (1 << BITS) ? (unsigned)v : (1 << BITS) - 1;
    }
    return curve_index(along, cell);
}

/* ---- sorting: (key << 32 | id), stable ---- */

enum { DIGIT = 12, DIGITS = 1 << DIGIT, SMALL = 2 * PBS_LEAF };

typedef struct sorter {
    pbs_tree *tree;
    const pbs_points *in;
    curve curve;
    cells cells;
    uint64_t *from, *to;
    int shift, parts;
    size_t first[PBS_PARTS + 1]; /* of each part's entries, where they are not n / parts apart */
} sorter;

static bool position_of(const sorter *s, size_t candidate, float p[3]) {
    return pbs_scaled(&s->tree->metric, s->in->position + 3 * candidate, p);
}

static pbs_code count_valid(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    sorter *s = ctx;
    size_t n = s->in->count, valid = 0;
    float p[3];
    for (size_t j = part_begin(n, s->parts, i); j < part_end(n, s->parts, i); j++)
        valid += position_of(s, j, p);
    s->first[i] = valid;
    return PBS_OK;
}

static pbs_code write_keys(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    sorter *s = ctx;
    size_t n = s->in->count, at = s->first[i];
    float p[3];
    for (size_t j = part_begin(n, s->parts, i); j < part_end(n, s->parts, i); j++)
        if (position_of(s, j, p))
            s->from[at++] = (uint64_t)cells_key(&s->cells, &s->curve, p) << 32 | j;
    return PBS_OK;
}

static pbs_code count_digits(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    sorter *s = ctx;
    size_t n = s->tree->points;
    uint32_t *count = s->tree->digits + i * DIGITS;
    memset(count, 0, DIGITS * sizeof *count);
    for (size_t j = part_begin(n, s->parts, i); j < part_end(n, s->parts, i); j++)
        count[s->from[j] >> s->shift & (DIGITS - 1)]++;
    return PBS_OK;
}

static pbs_code scatter(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    sorter *s = ctx;
    size_t n = s->tree->points;
    uint32_t *at = s->tree->digits + i * DIGITS;
    for (size_t j = part_begin(n, s->parts, i); j < part_end(n, s->parts, i); j++)
        s->to[at[s->from[j] >> s->shift & (DIGITS - 1)]++] = s->from[j];
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
    for (int shift = 32; shift < 32 + KEY_BITS; shift += 8) {
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
    bounds b = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}, 0};
    float p[3];
    for (size_t i = 0; i < n; i++) {
        position_of(s, (uint32_t)v[i], p);
        bounds_add(&b, p);
    }
    cells c = cells_over(b.low, b.high);
    if (c.per == 0) return;
    for (size_t i = 0; i < n; i++) {
        position_of(s, (uint32_t)v[i], p);
        v[i] = (uint64_t)cells_key(&c, &s->curve, p) << 32 | (uint32_t)v[i];
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
        size_t at = part_begin(n, s->parts, (size_t)i);
        if (at < s->first[i - 1]) at = s->first[i - 1];
        while (at && at < n && s->from[at] >> 32 == s->from[at - 1] >> 32) at++;
        s->first[i] = at;
    }
}

static pbs_code sort(pbs_run *run, sorter *s, pbs_err *err) {
    const pbs_metric *m = &s->tree->metric;
    float low[3], high[3];
    for (int k = 0; k < 3; k++) low[k] = (float)m->low[k], high[k] = (float)m->high[k];
    s->cells = cells_over(low, high);
    curve_init(&s->curve);
    pbs_code rc = PBS_OK;
    if (s->tree->invalid) {
        rc = pbs_parallel(run, (size_t)s->parts, count_valid, s, err);
        for (size_t i = 0, sum = 0, c; i < (size_t)s->parts; i++, sum += c)
            c = s->first[i], s->first[i] = sum;
    } else
        for (int i = 0; i < s->parts; i++)
            s->first[i] = part_begin(s->in->count, s->parts, (size_t)i);
    if (!rc) rc = pbs_parallel(run, (size_t)s->parts, write_keys, s, err);
    for (int shift = 0; shift < KEY_BITS && !rc; shift += DIGIT)
        rc = radix_pass(run, s, 32 + shift, err);
    if (!rc) first_runs(s);
    if (!rc) rc = pbs_parallel(run, (size_t)s->parts, refine_part, s, err);
    return rc;
}

/* ---- the tree ---- */

void pbs_tree_layout(pbs_tree *t, size_t candidates, pbs_layout *layout) {
    size_t n = (candidates + PBS_FAN_POINTS - 1) / PBS_FAN_POINTS;
    if (!n) n = 1;
    t->leaf = pbs_layout_take(layout, n * PBS_FAN * sizeof *t->leaf);
    t->normal = pbs_layout_take(layout, n * PBS_FAN * sizeof *t->normal);
    t->id = pbs_layout_take(layout, n * PBS_FAN_POINTS * sizeof *t->id);
    t->digits = pbs_layout_take(layout, (size_t)PBS_PARTS * DIGITS * sizeof *t->digits);
    t->levels = 0;
    for (;; n = (n + PBS_FAN - 1) / PBS_FAN) {
        t->fans[t->levels] = n;
        t->fan[t->levels++] = pbs_layout_take(layout, n * sizeof *t->fan[0]);
        if (n == 1) break;
    }
}

static void fan_set(pbs_fan *f, int c, const float low[3], const float high[3], float max) {
    for (int k = 0; k < 3; k++) f->low[k][c] = low[k], f->high[k][c] = high[k];
    f->max[c] = max;
}

static void fill_leaf(const sorter *s, size_t leaf, pbs_fan *fan) {
    pbs_tree *t = s->tree;
    pbs_leaf *l = &t->leaf[leaf];
    uint32_t *id = t->id + leaf * PBS_LEAF;
    size_t first = leaf * PBS_LEAF;
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (size_t i = 0; i < PBS_LEAF; i++) {
        size_t slot = first + i < t->points ? first + i : t->points - 1;
        id[i] = (uint32_t)s->from[slot];
        float p[3];
        position_of(s, id[i], p);
        for (int k = 0; k < 3; k++) {
            low[k] = p[k] < low[k] ? p[k] : low[k];
            high[k] = p[k] > high[k] ? p[k] : high[k];
        }
        l->x[i] = p[0], l->y[i] = p[1], l->z[i] = p[2];
        l->d[i] = first + i < t->points ? INFINITY : 0;
    }
    fan_set(fan, (int)(leaf % PBS_FAN), low, high, INFINITY);
}

static const float NOWHERE_LOW[3] = {INFINITY, INFINITY, INFINITY};
static const float NOWHERE_HIGH[3] = {-INFINITY, -INFINITY, -INFINITY};

static pbs_code fill_part(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    sorter *s = ctx;
    pbs_tree *t = s->tree;
    size_t n = t->fans[0];
    for (size_t f = part_begin(n, s->parts, i); f < part_end(n, s->parts, i); f++)
        for (size_t leaf = f * PBS_FAN; leaf < (f + 1) * PBS_FAN; leaf++) {
            if (leaf < t->leaves) fill_leaf(s, leaf, &t->fan[0][f]);
            else fan_set(&t->fan[0][f], (int)(leaf % PBS_FAN), NOWHERE_LOW, NOWHERE_HIGH, 0);
        }
    return PBS_OK;
}

/* After the leaves, because the sort's entries lie where the normals go. */
static pbs_code fill_normals(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    sorter *s = ctx;
    pbs_tree *t = s->tree;
    size_t n = t->leaves;
    for (size_t leaf = part_begin(n, s->parts, i); leaf < part_end(n, s->parts, i); leaf++)
        for (size_t k = 0; k < PBS_LEAF; k++) {
            int16_t v[4];
            pbs_place_normal(v, s->in->normal + 2 * (size_t)t->id[leaf * PBS_LEAF + k]);
            memcpy(t->normal[leaf].xy[k], v, 4);
            memcpy(t->normal[leaf].z0[k], v + 2, 4);
        }
    return PBS_OK;
}

static void fill_levels(pbs_tree *t) {
    for (int level = 1; level < t->levels; level++)
        for (size_t i = 0; i < t->fans[level] * PBS_FAN; i++) {
            pbs_fan *up = &t->fan[level][i / PBS_FAN];
            if (i >= t->fans[level - 1]) {
                fan_set(up, (int)(i % PBS_FAN), NOWHERE_LOW, NOWHERE_HIGH, 0);
                continue;
            }
            const pbs_fan *f = &t->fan[level - 1][i];
            float low[3], high[3];
            for (int k = 0; k < 3; k++) {
                low[k] = f->low[k][0], high[k] = f->high[k][0];
                for (int c = 1; c < PBS_FAN; c++) {
                    low[k] = f->low[k][c] < low[k] ? f->low[k][c] : low[k];
                    high[k] = f->high[k][c] > high[k] ? f->high[k][c] : high[k];
                }
            }
            fan_set(up, (int)(i % PBS_FAN), low, high, INFINITY);
        }
}

pbs_code pbs_tree_build(pbs_run *run, pbs_tree *t, const pbs_points *in, pbs_err *err) {
    sorter s = {.tree = t, .in = in};
    t->points = in->count - t->invalid;
    t->leaves = (t->points + PBS_LEAF - 1) / PBS_LEAF;
    s.parts = pbs_parts(run, in->count, 1 << 15);
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
