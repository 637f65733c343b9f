/* One cell of a point cloud, thinned from fine to coarse (clod.h). */
#include "libcore/clouds/clod_internal.h"
#include "libcore/data/srgb.h"
#include "libcore/data/vectors.h"
#include <string.h>

enum { DIGIT = 12, FEW = 160, CROWD = 600 };

pbs_code pbs_clod_work_new(pbs_run *run, bool colours, pbs_clod_work *w, pbs_err *err) {
    const char *what = "a cell of points";
    const size_t n = PBS_CLOD_CELL;
    memset(w, 0, sizeof *w);
    pbs_code rc = pbs_alloc(run, &w->raw, n, sizeof *w->raw, what, err);
    w->points = (void *)w->raw;
    if (!rc) rc = pbs_alloc(run, &w->key, n, sizeof *w->key, what, err);
    if (!rc) rc = pbs_alloc(run, &w->other, n, sizeof *w->other, what, err);
    if (!rc) rc = pbs_alloc(run, &w->colour, n, sizeof *w->colour, what, err);
    if (!rc) rc = pbs_alloc(run, &w->q, n, sizeof *w->q, what, err);
    if (!rc) rc = pbs_alloc(run, &w->level, n, sizeof *w->level, what, err);
    if (!rc) rc = pbs_thin_set_new(run, n, colours, &w->kept, err);
    if (!rc) rc = pbs_thin_set_new(run, n, colours, &w->next, err);
    if (!rc) rc = pbs_thin_set_new(run, n, colours, &w->rejected, err);
    if (!rc) rc = pbs_thin_new(run, n, &w->thin, err);
    if (rc) pbs_clod_work_free(run, w);
    return rc;
}

void pbs_clod_work_free(pbs_run *run, pbs_clod_work *w) {
    pbs_free(run, w->raw);
    pbs_free(run, w->key);
    pbs_free(run, w->other);
    pbs_free(run, w->colour);
    pbs_free(run, w->q);
    pbs_free(run, w->level);
    pbs_thin_set_free(run, &w->kept);
    pbs_thin_set_free(run, &w->next);
    pbs_thin_set_free(run, &w->rejected);
    pbs_thin_free(&w->thin);
    memset(w, 0, sizeof *w);
}

/* ---- Morton order: keys of 48 bits, and 16 bits of where the point was ---- */

static inline uint32_t spread8(uint32_t v) {
    v = (v | v << 8) & 0x00f00f;
    v = (v | v << 4) & 0x0c30c3;
    return (v | v << 2) & 0x249249;
}
static inline uint64_t spread(const uint32_t *of_byte, uint32_t v) {
    return of_byte[v & 255] | (uint64_t)of_byte[v >> 8] << 24;
}

static inline i4 select4i(i4 which, i4 yes, i4 no) {
    return (yes & which) | (no & ~which);
}

static void make_keys(pbs_clod_cell *c, pbs_clod_work *w) {
    i4 low = {INT32_MAX, INT32_MAX, INT32_MAX, INT32_MAX}, high = {0};
    uint32_t of_byte[256];
    for (uint32_t v = 0; v < 256; v++) of_byte[v] = spread8(v);
    for (uint32_t i = 0; i < c->count; i++) {
        const uint32_t *q = w->raw[i].q;
        i4 v = *(const i4_at *)(const void *)&w->raw[i]; /* the fourth is its colour */
        low = select4i(v < low, v, low);
        high = select4i(v > high, v, high);
        uint64_t m = spread(of_byte, q[0] - c->origin[0]) |
                     spread(of_byte, q[1] - c->origin[1]) << 1 |
                     spread(of_byte, q[2] - c->origin[2]) << 2;
        w->key[i] = m << 16 | i;
    }
    memcpy(c->low, &low, sizeof c->low);
    memcpy(c->high, &high, sizeof c->high);
}

/* Few, for which clearing the counts would cost more. */
static void sort_few(uint64_t *key, uint32_t n) {
    for (uint32_t i = 1; i < n; i++) {
        uint64_t v = key[i];
        uint32_t j = i;
        for (; j && key[j - 1] >> 16 > v >> 16; j--) key[j] = key[j - 1];
        key[j] = v;
    }
}

/* Least significant digit first. */
void pbs_clod_sort(uint64_t **key, uint64_t **other, uint32_t n, int bits) {
    static const uint32_t mask = (1 << DIGIT) - 1;
    uint32_t count[4][1 << DIGIT];
    uint64_t *from = *key, *to = *other;
    int digits = (bits + DIGIT - 1) / DIGIT;
    if (n < 32) {
        sort_few(*key, n);
        return;
    }
    memset(count, 0, (size_t)digits * sizeof count[0]);
    for (uint32_t i = 0; i < n; i++)
        for (int d = 0; d < digits; d++) count[d][from[i] >> (16 + DIGIT * d) & mask]++;
    for (int d = 0; d < digits && n; d++) {
        uint32_t at = 0, *c = count[d];
        int shift = 16 + DIGIT * d;
        if (c[from[0] >> shift & mask] == n) continue; /* all the same */
        for (uint32_t i = 0; i <= mask; i++) {
            uint32_t k = c[i];
            c[i] = at;
            at += k;
        }
        for (uint32_t i = 0; i < n; i++) to[c[from[i] >> shift & mask]++] = from[i];
        uint64_t *t = from;
        from = to, to = t;
    }
    *key = from, *other = to;
}

/* ---- levels ---- */

static inline void add_colour(float *sum, const float *linear, const uint8_t c[4]) {
    for (int k = 0; k < 3; k++) sum[k] += linear[c[k]];
    sum[3] += 1;
}

/* Fills the colours in Morton order and the set of all places; what is at the place of another
 * point gives it its colour and has no level. */
static void take_points(const pbs_clod_cell *c, pbs_clod_work *w) {
    const float *linear = pbs_srgb()->linear;
    uint32_t n = (uint32_t)c->count;
    float *sum = w->kept.sum;
    const uint32_t *o = c->origin;
    w->kept.count = 0;
    for (uint32_t i = 0; i < n; i++) {
        const pbs_clod_raw *r = &w->raw[w->key[i] & 0xffff];
        memcpy(w->colour[i], r->colour, 4);
        w->level[i] = -1;
        for (int k = 0; k < 3; k++) w->q[i][k] = (uint16_t)(r->q[k] - o[k]);
        if (!i || (w->key[i] ^ w->key[i - 1]) >> 16) {
            pbs_thin_put(&w->kept, (int32_t)r->q[0], (int32_t)r->q[1], (int32_t)r->q[2], i);
            if (sum) memset(sum + 4 * (size_t)(w->kept.count - 1), 0, 4 * sizeof *sum);
        }
        if (sum) add_colour(sum + 4 * (size_t)(w->kept.count - 1), linear, r->colour);
    }
}

/* Pairs of points in one block of a level, for each point. */
static uint64_t crowd(const pbs_clod_work *w, uint32_t n, int k) {
    const int shift = 3 * (k + PBS_THIN_BLOCK);
    uint64_t pairs = 0, first = 0;
    for (uint64_t i = 1; i <= n; i++) {
        if (i < n && (w->key[i] ^ w->key[i - 1]) >> 16 >> shift == 0) continue;
        pairs += (i - first) * (i - first);
        first = i;
    }
    return pairs / n;
}

/* The first level: the coarsest whose blocks have FEW points in the mean; but where most points are
 * in few blocks a finer one, since what a block costs grows with the square of its points. */
static int first_level(const pbs_clod_work *w, uint32_t n, int top) {
    uint32_t at[PBS_CLOD_SIDE + 1] = {0}, blocks = 1; /* of pairs that a level's blocks part */
    for (uint32_t i = 1; i < n; i++) {
        uint64_t differ = (w->key[i] ^ w->key[i - 1]) >> 16;
        if (differ) at[(63 - __builtin_clzll(differ)) / 3]++;
    }
    int k = PBS_CLOD_SIDE - PBS_THIN_BLOCK;
    for (; k > 1; k--) {
        blocks += at[k + PBS_THIN_BLOCK];
        if ((uint64_t)blocks * FEW >= n) break;
    }
    while (k > 1 && crowd(w, n, k) > CROWD) k--;
    return k < top ? k : top;
}

static void drop_fixed(pbs_thin *t, int below) {
    size_t n = 0;
    for (size_t i = 0; i < t->fixed_count; i++)
        if (t->fixed[i].k >= below) t->fixed[n++] = t->fixed[i];
    t->fixed_count = n;
}

static inline void mean_colour(const pbs_srgb_table *t, const float *sum, uint8_t colour[4]) {
    float weight = 1 / sum[3];
    for (int k = 0; k < 3; k++) colour[k] = pbs_srgb_encode(t, sum[k] * weight);
}

static void set_levels(const pbs_clod_work *w, const pbs_thin_set *s, int k) {
    const pbs_srgb_table *t = pbs_srgb();
    for (uint32_t i = 0; i < s->count; i++) {
        w->level[s->id[i]] = (int8_t)k;
        if (s->sum) mean_colour(t, s->sum + 4 * (size_t)i, w->colour[s->id[i]]);
    }
}

static pbs_code thin(pbs_clod_work *w, uint32_t n, int top, pbs_err *err) {
    pbs_thin_set *from = &w->kept, *to = &w->next;
    pbs_code rc = PBS_OK;
    for (int first = first_level(w, n, top), k = first; k <= top && top && !rc; k++) {
        drop_fixed(&w->thin, k > first ? k : 0);
        rc = pbs_thin_level(&w->thin, from, k, k == first, to, &w->rejected, err);
        if (!rc && k == first)
            rc = pbs_thin_tail(&w->thin, to, &w->rejected, k, w->level, err);
        else if (!rc)
            set_levels(w, &w->rejected, k - 1);
        pbs_thin_set *t = from;
        from = to, to = t;
    }
    if (!rc) set_levels(w, from, top);
    w->last = from;
    return rc;
}

/* ---- what comes out ---- */

uint16_t pbs_clod_spacing(int k) {
    /* 2^(k - 16), below 2^-14 a number without leading one */
    return (uint16_t)(k < 0 ? 0 : k > 1 ? (k - 1) << 10 : 256 << k);
}

void pbs_clod_rest_colour(const pbs_clod_rest *r, uint8_t colour[4]) {
    mean_colour(pbs_srgb(), r->sum, colour);
    colour[3] = r->alpha;
}

/* By level from the coarsest on, and in Morton order. */
static void write_points(const pbs_clod_work *w, pbs_clod_cell *c, pbs_clod_point *out) {
    uint32_t n = (uint32_t)c->count, of[PBS_CLOD_LEVELS + 1] = {0}, at[PBS_CLOD_LEVELS + 1];
    uint32_t first = 0;
    uint16_t spacing[PBS_CLOD_LEVELS + 1];
    for (uint32_t i = 0; i < n; i++) of[w->level[i] + 1]++;
    for (int k = PBS_CLOD_LEVELS + 1; k--; first += of[k]) at[k] = first;
    for (int k = 0; k <= PBS_CLOD_LEVELS; k++) spacing[k] = pbs_clod_spacing(k - 1);
    c->equal = of[0];
    for (int k = 0; k < PBS_CLOD_LEVELS; k++) c->level[k] = (uint16_t)of[k + 1];
    for (uint32_t i = 0; i < n; i++) {
        int k = w->level[i] + 1;
        pbs_clod_point p = {.spacing = spacing[k]};
        memcpy(p.q, w->q[i], sizeof p.q);
        memcpy(p.colour, w->colour[i], 4);
        out[at[k]++] = p;
    }
}

static inline bool at_border(const uint16_t q[3], int bits, int k) {
    int32_t side = 1 << bits, s = 1 << k;
    for (int a = 0; a < 3; a++)
        if (q[a] + 1 < s || side - q[a] < s) return true;
    return false;
}

/* Behind the points, where there are 4 bytes for each: those at borders, and sums of what is left.
 * If they are too many, neighbours look at all points, and of a sum only its weight is kept: the
 * colour of the point is its mean. Returns how many bytes there are. */
static size_t leave_more(const pbs_clod_work *w, pbs_clod_cell *c, const pbs_clod_point *p) {
    pbs_clod_border *b = (void *)w->other; /* as large, and free */
    uint8_t *to = (uint8_t *)w->raw + c->count * sizeof *p;
    const float *sum = w->last->sum;
    uint32_t n = 0;
    uint64_t i = 0;
    for (int k = PBS_CLOD_LEVELS - 1; k > 0; k--)
        for (uint64_t end = i + c->level[k]; i < end; i++)
            if (at_border(p[i].q, c->bits, k))
                b[n++] = (pbs_clod_border){{p[i].q[0], p[i].q[1], p[i].q[2]}, (int16_t)k};
    size_t size = n * sizeof *b, sums = sum ? c->rest_count * 4 * sizeof *sum : 0;
    c->border_count = size + sums <= c->count * 4 ? n : PBS_CLOD_NO_LIST;
    if (c->border_count == n) {
        memcpy(to, b, size);
        if (sum) memcpy(to + size, sum, sums);
        return size + sums;
    }
    for (i = 0; sum && i < c->rest_count; i++)
        memcpy(to + i * sizeof *sum, &sum[4 * i + 3], sizeof *sum);
    return sum ? c->rest_count * sizeof *sum : 0;
}

/* What is left of a cell, from the store. */
pbs_code pbs_clod_take_rest(const pbs_clod_store *s, const pbs_clod_cell *c, bool colours,
                            pbs_clod_work *w, pbs_clod_rest *out, pbs_err *err) {
    const float *linear = pbs_srgb()->linear;
    const bool list = c->border_count != PBS_CLOD_NO_LIST;
    const size_t each = (list ? 4 : 1) * sizeof(float), size = c->rest_count * sizeof *w->points;
    float *sum = w->next.sum;
    uint64_t at = pbs_clod_at(c) + c->count * sizeof *w->points;
    if (list) at += c->border_count * sizeof(pbs_clod_border);
    pbs_code rc = s->read(s->ctx, pbs_clod_at(c), size, w->points, err);
    if (!rc && colours) rc = s->read(s->ctx, at, c->rest_count * each, sum, err);
    for (uint32_t i = 0; i < c->rest_count && !rc; i++) {
        const pbs_clod_point *p = &w->points[i];
        pbs_clod_rest r = {.alpha = p->colour[3], .level = (int8_t)pbs_clod_top(c)};
        for (int k = 0; k < 3; k++) r.q[k] = c->origin[k] + p->q[k];
        if (colours && list)
            memcpy(r.sum, sum + 4 * (size_t)i, sizeof r.sum);
        else if (colours) {
            for (int k = 0; k < 3; k++) r.sum[k] = linear[p->colour[k]] * sum[i];
            r.sum[3] = sum[i];
        }
        out[i] = r;
    }
    return rc;
}

/* All points at one place, more than the arrays are for: piece by piece. */
static pbs_code thin_place(const pbs_clod_store *s, pbs_clod_cell *c, pbs_clod_work *w,
                           double sum[4], pbs_err *err) {
    const float *linear = pbs_srgb()->linear;
    pbs_clod_point *out = (void *)w->raw;
    pbs_code rc = PBS_OK;
    for (uint64_t i = 0, n; i < c->count && !rc; i += n) {
        n = c->count - i < PBS_CLOD_CELL ? c->count - i : PBS_CLOD_CELL;
        rc = s->read(s->ctx, pbs_clod_at(c) + i * sizeof *w->raw, n * sizeof *w->raw, w->raw, err);
        for (uint64_t j = 0; j < n && !rc; j++) {
            pbs_clod_point p = {.spacing = pbs_clod_spacing(i + j ? -1 : 0)};
            memcpy(p.colour, w->raw[j].colour, 4);
            for (int k = 0; k < 3; k++) sum[k] += (double)linear[p.colour[k]];
            out[j] = p; /* in front of what is still to be read */
        }
        if (!rc) rc = s->write(s->ctx, pbs_clod_at(c) + i * sizeof *out, n * sizeof *out, out, err);
    }
    return rc;
}

static pbs_code leave_place(const pbs_clod_store *s, pbs_clod_cell *c, pbs_clod_work *w,
                            pbs_err *err) {
    double sum[4] = {0};
    float left[4];
    memcpy(c->low, c->origin, sizeof c->low);
    memcpy(c->high, c->origin, sizeof c->high);
    memset(c->level, 0, sizeof c->level);
    c->level[0] = 1;
    c->equal = c->count - 1;
    c->rest_count = 1;
    c->border_count = 0;
    pbs_code rc = thin_place(s, c, w, sum, err);
    if (rc || !w->kept.sum) return rc;
    for (int k = 0; k < 3; k++) left[k] = (float)sum[k];
    left[3] = (float)c->count;
    return s->write(s->ctx, pbs_clod_at(c) + c->count * sizeof(pbs_clod_point), sizeof left, left,
                    err);
}

pbs_code pbs_clod_thin_cell(const pbs_clod_store *s, pbs_clod_cell *c, pbs_clod_work *w,
                            pbs_err *err) {
    pbs_clod_point *out = (void *)w->raw;
    int top = pbs_clod_top(c);
    if (c->count > PBS_CLOD_CELL) return leave_place(s, c, w, err);
    pbs_code rc = s->read(s->ctx, pbs_clod_at(c), c->count * sizeof *w->raw, w->raw, err);
    if (rc) return rc;
    make_keys(c, w);
    pbs_clod_sort(&w->key, &w->other, (uint32_t)c->count, 3 * c->bits);
    take_points(c, w);
    rc = thin(w, (uint32_t)c->count, top, err);
    if (rc) return rc;
    write_points(w, c, out);
    c->rest_count = c->level[top];
    size_t behind = leave_more(w, c, out);
    return s->write(s->ctx, pbs_clod_at(c), c->count * sizeof *out + behind, out, err);
}

typedef struct taker {
    pbs_thin *t;
    const pbs_clod_cell *from;
    int64_t low[3], high[3]; /* box that they matter for */
} taker;

/* Room is reserved. */
static inline void take_fixed(const taker *to, const uint16_t q[3], int k) {
    int64_t side = (int64_t)1 << k;
    struct pbs_thin_fixed f = {.k = k};
    bool near = true;
    for (int a = 0; a < 3; a++) {
        int64_t v = (int64_t)to->from->origin[a] + q[a];
        f.at[a] = (int32_t)v;
        near = near && v > to->low[a] - side && v < to->high[a] + side;
    }
    if (near) to->t->fixed[to->t->fixed_count++] = f;
}

/* 2^k / 65536 as a half float, back. */
static inline int level_of(uint16_t spacing) {
    return spacing >= 1024 ? (spacing >> 10) + 1 : spacing == 512 ? 1 : spacing ? 0 : -1;
}

/* The same from all points of a cell. */
static pbs_code take_points_at_border(const taker *to, const pbs_clod_store *s, int least,
                                      pbs_clod_point *room, pbs_err *err) {
    const pbs_clod_cell *c = to->from;
    const uint64_t most = PBS_CLOD_BORDER / 2;
    least = least > 1 ? least : 1;
    for (uint64_t i = 0; i < c->count; i += most) {
        uint64_t n = c->count - i < most ? c->count - i : most;
        pbs_code rc = pbs_thin_reserve_fixed(to->t, (size_t)n, err);
        if (!rc)
            rc = s->read(s->ctx, pbs_clod_at(c) + i * sizeof *room, (size_t)n * sizeof *room, room,
                         err);
        if (rc) return rc;
        for (uint64_t j = 0; j < n; j++) {
            int k = level_of(room[j].spacing);
            if (k < least) return PBS_OK; /* they fall */
            if (at_border(room[j].q, c->bits, k)) take_fixed(to, room[j].q, k);
        }
    }
    return PBS_OK;
}

pbs_code pbs_clod_take_border(pbs_thin *t, const pbs_clod_store *s, const pbs_clod_cell *from,
                              const int64_t low[3], const int64_t high[3], int least,
                              pbs_clod_border *room, pbs_err *err) {
    taker to = {t, from, {low[0], low[1], low[2]}, {high[0], high[1], high[2]}};
    if (from->border_count == PBS_CLOD_NO_LIST)
        return take_points_at_border(&to, s, least, (void *)room, err);
    pbs_code rc = pbs_thin_reserve_fixed(t, from->border_count, err);
    if (!rc)
        rc = s->read(s->ctx, pbs_clod_at(from) + from->count * sizeof(pbs_clod_point),
                     from->border_count * sizeof *room, room, err);
    for (uint32_t i = 0; i < from->border_count && !rc; i++) {
        if (room[i].k < least) break; /* they fall */
        take_fixed(&to, room[i].q, room[i].k);
    }
    return rc;
}
