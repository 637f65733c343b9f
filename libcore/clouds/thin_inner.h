/* thin_inner.h: the loops of a level (thin.h), compiled twice: in thin.c for any processor and in
 * thin_avx2.c; every lane is one IEEE operation, so both give the same bits.
 *
 * Points in Morton order come block by block, and what a block keeps lies together, so a hash of
 * blocks to ranges finds all that is near the block's candidates. It is copied once, relative to
 * the block's corner, and serves all of them. Sixteen candidates are looked at together, against
 * one point after the other; what they do to each other is decided last, in their order.
 */
#ifndef PBS_THIN_INNER_H
#define PBS_THIN_INNER_H

#include "libcore/data/simd16.h"
#include "libcore/clouds/thin.h"
#include <string.h>

#define BLOCK_SHIFT PBS_THIN_BLOCK
#define FAR         1e30f /* its square is infinite */

static inline uint32_t hash_of(int32_t x, int32_t y, int32_t z) {
    uint32_t h = (uint32_t)x * 0x9e3779b1u ^ (uint32_t)y * 0x85ebca77u ^ (uint32_t)z * 0xc2b2ae3du;
    return h ^ h >> 15;
}

static inline pbs_thin_block *find(const pbs_thin *t, int32_t x, int32_t y, int32_t z) {
    for (uint32_t h = hash_of(x, y, z) & t->slot_mask; t->slot[h]; h = (h + 1) & t->slot_mask) {
        pbs_thin_block *b = &t->block[t->slot[h] - 1];
        if (b->at[0] == x && b->at[1] == y && b->at[2] == z) return b;
    }
    return NULL;
}

static pbs_thin_block *find_or_add(pbs_thin *t, const int32_t at[3]) {
    uint32_t h = hash_of(at[0], at[1], at[2]) & t->slot_mask;
    for (; t->slot[h]; h = (h + 1) & t->slot_mask) {
        pbs_thin_block *b = &t->block[t->slot[h] - 1];
        if (!memcmp(b->at, at, sizeof b->at)) return b;
    }
    pbs_thin_block *b = &t->block[t->block_count];
    t->slot[h] = (uint32_t)++t->block_count;
    t->row[at[2] & 63][at[1] & 63] |= UINT64_C(1) << (at[0] & 63);
    *b = (pbs_thin_block){.at = {at[0], at[1], at[2]}};
    return b;
}

/* The square that distances are compared with. Differences beyond 12 bits have squares that float
 * rounds; a little more is asked for then. */
static inline float square_of(int k) {
    uint32_t bits = (uint32_t)(127 + 2 * k) << 23 | (k > 11 ? 1u << 7 : 0);
    float s;
    memcpy(&s, &bits, sizeof s);
    return s;
}

/* ---- lists ---- */

static inline pbs_code make_room(pbs_run *run, pbs_thin_list *l, size_t need, pbs_err *err) {
    need += 32; /* sixteen are written at a time */
    if (need <= l->room) return PBS_OK;
    pbs_thin_list to = {.count = l->count, .room = need + need / 2};
    pbs_code rc = pbs_alloc(run, &to.at, 4 * to.room, sizeof *to.at, "points near a block", err);
    if (!rc) rc = pbs_alloc(run, &to.id, to.room, sizeof *to.id, "points near a block", err);
    if (rc) {
        pbs_free(run, to.at);
        return rc;
    }
    for (size_t r = 0; r < 4 && l->count; r++)
        memcpy(to.at + r * to.room, l->at + r * l->room, l->count * sizeof *to.at);
    if (l->count) memcpy(to.id, l->id, l->count * sizeof *to.id);
    pbs_free(run, l->at);
    pbs_free(run, l->id);
    *l = to;
    return PBS_OK;
}

/* Positions that can be too near to some candidates. */
typedef struct window {
    float low[3], high[3];
} window;

/* A little wider than it must be: float rounds positions beyond 24 bits. */
static inline window window_of(const float low[3], const float high[3], float reach) {
    window w;
    reach += reach * 0x1p-16f;
    for (int k = 0; k < 3; k++) w.low[k] = low[k] - reach, w.high[k] = high[k] + reach;
    return w;
}

static inline void put_near(pbs_thin_list *l, float x, float y, float z, float square,
                            uint32_t id) {
    size_t n = l->count++;
    l->at[n] = x, l->at[l->room + n] = y, l->at[2 * l->room + n] = z;
    l->at[3 * l->room + n] = square;
    l->id[n] = id;
}
static inline bool within(const window *w, float x, float y, float z) {
    return (x >= w->low[0]) & (x <= w->high[0]) & (y >= w->low[1]) & (y <= w->high[1]) &
           (z >= w->low[2]) & (z <= w->high[2]);
}

/* The parts of a window test, and what is in it one behind the other: for each width. */
#ifdef __AVX2__
static inline f8 of_ints8(const int32_t *p, int32_t from) {
    __m256i v = _mm256_loadu_si256((const __m256i *)(const void *)p);
    return _mm256_cvtepi32_ps(_mm256_sub_epi32(v, _mm256_set1_epi32(from)));
}
static inline __m256 between8(f8 v, float low, float high) {
    return _mm256_and_ps(_mm256_cmp_ps(v, _mm256_set1_ps(low), _CMP_GE_OQ),
                         _mm256_cmp_ps(v, _mm256_set1_ps(high), _CMP_LE_OQ));
}
static inline unsigned within8(const window *w, f8 x, f8 y, f8 z) {
    return (unsigned)_mm256_movemask_ps(_mm256_and_ps(
        between8(x, w->low[0], w->high[0]),
        _mm256_and_ps(between8(y, w->low[1], w->high[1]), between8(z, w->low[2], w->high[2]))));
}
static inline void put_near8(pbs_thin_list *l, unsigned mask, f8 x, f8 y, f8 z, f8 square,
                             __m256i id) {
    uint64_t bytes = _pext_u64(0x0706050403020100u, _pdep_u64(mask, 0x0101010101010101u) * 255);
    __m256i lane = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128((long long)bytes));
    float *p = l->at + l->count;
    _mm256_storeu_ps(p, _mm256_permutevar8x32_ps(x, lane));
    _mm256_storeu_ps(p + l->room, _mm256_permutevar8x32_ps(y, lane));
    _mm256_storeu_ps(p + 2 * l->room, _mm256_permutevar8x32_ps(z, lane));
    _mm256_storeu_ps(p + 3 * l->room, _mm256_permutevar8x32_ps(square, lane));
    _mm256_storeu_si256((__m256i *)(void *)(l->id + l->count),
                        _mm256_permutevar8x32_epi32(id, lane));
    l->count += (size_t)__builtin_popcount(mask);
}
#define LANES       8
#define FIRST(left) ((left) < 8 ? (1u << (left)) - 1 : 255u)
#define OF_INTS     of_ints8
#define FLOATS      f8_at
#define ALL         f8_all
#define WITHIN      within8
#define PUT_NEAR    put_near8
#define IDS(i)      _mm256_add_epi32(step, _mm256_set1_epi32((int)(i)))
#define IDS_AT(p)   _mm256_loadu_si256((const __m256i *)(const void *)(p))
#define STEP        const __m256i step = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7)
#else
#define LANES          1
#define FIRST(left)    ((left) > 0)
#define OF_INTS(p, by) ((float)(int32_t)((uint32_t) * (p) - (uint32_t)(by)))
#define FLOATS(p)      (*(p))
#define ALL(v)         (v)
#define WITHIN         within
#define IDS(i)         (i)
#define IDS_AT(p)      (*(p))
#define STEP           (void)0
#define PUT_NEAR(l, mask, x, y, z, square, id)                                                     \
    do {                                                                                           \
        if (mask) put_near(l, x, y, z, square, id);                                                \
    } while (0)
#endif

/* Points first .. first + count - 1 of a set, those that are in the window; square NULL: they are
 * kept. There is room for all. */
static void take_range(pbs_thin_list *l, const window *w, const int32_t corner[3],
                       const pbs_thin_set *s, uint32_t first, uint32_t count, const float *square) {
    STEP;
    for (uint32_t i = first; i < first + count; i += LANES) {
        const __typeof__(ALL(0.0f)) x = OF_INTS(s->x + i, corner[0]),
                                    y = OF_INTS(s->y + i, corner[1]),
                                    z = OF_INTS(s->z + i, corner[2]);
        PUT_NEAR(l, WITHIN(w, x, y, z) & FIRST(first + count - i), x, y, z,
                 square ? FLOATS(square + i) : ALL(INFINITY), IDS(i));
    }
}

static void filter(pbs_thin_list *to, const pbs_thin_list *from, const window *w) {
    to->count = 0;
    for (size_t i = 0; i < from->count; i += LANES) {
        const float *p = from->at + i;
        const __typeof__(ALL(0.0f)) x = FLOATS(p), y = FLOATS(p + from->room),
                                    z = FLOATS(p + 2 * from->room);
        PUT_NEAR(to, WITHIN(w, x, y, z) & FIRST(from->count - i), x, y, z,
                 FLOATS(p + 3 * from->room), IDS_AT(from->id + i));
    }
}

/* ---- what is near a block ---- */

static inline void corner_of(const pbs_thin_run *r, int shift, int32_t corner[3]) {
    for (int k = 0; k < 3; k++) corner[k] = (int32_t)((uint32_t)r->at[k] << shift);
}

/* What has been decided: the kept ones, and those that a tail has given a level; NULL: none. */
typedef struct decided {
    const pbs_thin_set *kept, *tail;
    int64_t reach, tail_reach; /* how far from candidates they matter */
    int shift;                 /* of blocks */
} decided;

typedef struct surrounding {
    int32_t corner[3];
    window near, tail;
} surrounding;

static pbs_code take_block(pbs_thin *t, const decided *d, const surrounding *s,
                           const pbs_thin_block *b, bool tail, pbs_err *err) {
    uint32_t others = tail ? b->tail_count : 0;
    pbs_code rc = PBS_OK;
    if (t->kept.count + b->kept_count + 16 > t->kept.room)
        rc = make_room(t->run, &t->kept, t->kept.count + b->kept_count, err);
    if (!rc && t->other.count + others + 16 > t->other.room)
        rc = make_room(t->run, &t->other, t->other.count + others, err);
    if (rc) return rc;
    if (b->kept_count)
        take_range(&t->kept, &s->near, s->corner, d->kept, b->kept, b->kept_count, NULL);
    if (others) take_range(&t->other, &s->tail, s->corner, d->tail, b->tail, others, t->tail);
    for (uint32_t i = b->fixed; i && !rc; i = t->fixed[i - 1].next) {
        const struct pbs_thin_fixed *f = &t->fixed[i - 1];
        float x = (float)(f->at[0] - s->corner[0]), y = (float)(f->at[1] - s->corner[1]),
              z = (float)(f->at[2] - s->corner[2]);
        if (!within(&s->near, x, y, z)) continue;
        rc = make_room(t->run, &t->other, t->other.count + 1, err);
        if (!rc) put_near(&t->other, x, y, z, square_of(f->k), 0);
    }
    return rc;
}

/* Fills t->kept and t->other with what is nearer than `reach` to the box of a run's candidates. */
static pbs_code gather(pbs_thin *t, const decided *d, const pbs_thin_run *r, pbs_err *err) {
    surrounding s;
    int64_t low[3], high[3], tail_low[3], tail_high[3];
    float box[2][3];
    pbs_code rc = PBS_OK;
    corner_of(r, d->shift, s.corner);
    for (int k = 0; k < 3; k++) {
        low[k] = (r->min[k] - d->reach) >> d->shift, high[k] = (r->max[k] + d->reach) >> d->shift;
        tail_low[k] = (r->min[k] - d->tail_reach) >> d->shift;
        tail_high[k] = (r->max[k] + d->tail_reach) >> d->shift;
        box[0][k] = (float)(r->min[k] - s.corner[k]), box[1][k] = (float)(r->max[k] - s.corner[k]);
    }
    s.near = window_of(box[0], box[1], (float)d->reach);
    s.tail = window_of(box[0], box[1], (float)d->tail_reach);
    t->kept.count = t->other.count = 0;
    const uint64_t wide = (UINT64_C(2) << (high[0] - low[0])) - 1;
    for (int64_t z = low[2]; z <= high[2] && !rc; z++)
        for (int64_t y = low[1]; y <= high[1] && !rc; y++) {
            uint64_t row = t->row[z & 63][y & 63], by = (uint64_t)low[0] & 63;
            bool tail =
                z >= tail_low[2] && z <= tail_high[2] && y >= tail_low[1] && y <= tail_high[1];
            for (row = (row >> by | row << (-by & 63)) & wide; row && !rc; row &= row - 1) {
                int64_t x = low[0] + __builtin_ctzll(row);
                const pbs_thin_block *b = find(t, (int32_t)x, (int32_t)y, (int32_t)z);
                if (b)
                    rc =
                        take_block(t, d, &s, b, tail && x >= tail_low[0] && x <= tail_high[0], err);
            }
        }
    return rc;
}

/* ---- sixteen candidates ---- */

typedef struct batch {
    f16 at[3];
    float p[3][16]; /* the same */
    uint32_t first, count;
} batch;

/* Candidate i and those behind it, up to `end`; the lanes behind the last one are the first. */
static inline batch batch_of(const pbs_thin_set *c, uint32_t i, uint32_t end,
                             const int32_t corner[3]) {
    static const float lane[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
    batch b = {.first = i, .count = end - i < 16 ? end - i : 16};
    const int32_t *from[3] = {c->x + i, c->y + i, c->z + i};
    f16 there = f16_all((float)b.count);
    for (int k = 0; k < 3; k++) {
        f16 first = f16_all((float)(int32_t)((uint32_t)from[k][0] - (uint32_t)corner[k]));
        f16 v = f16_of_ints(from[k], corner[k]);
        b.at[k] = f16_if_less(f16_at(lane), there, v, first);
        f16_put(b.p[k], b.at[k]);
    }
    return b;
}

static inline window window_of_batch(const batch *b, float reach) {
    float low[3], high[3];
    for (int k = 0; k < 3; k++) low[k] = f16_least(b->at[k]), high[k] = f16_most(b->at[k]);
    return window_of(low, high, reach);
}

/* The squares of their distances to a place. */
static inline f16 squares(const batch *b, const float *x, const float *y, const float *z) {
    f16 dx = f16_sub(b->at[0], f16_all(*x)), dy = f16_sub(b->at[1], f16_all(*y));
    f16 dz = f16_sub(b->at[2], f16_all(*z));
    return f16_add(f16_add(f16_mul(dx, dx), f16_mul(dy, dy)), f16_mul(dz, dz));
}
static inline f16 squares_near(const batch *b, const pbs_thin_list *l, size_t i) {
    return squares(b, l->at + i, l->at + l->room + i, l->at + 2 * l->room + i);
}
static inline f16 squares_own(const batch *b, int j) {
    return squares(b, &b->p[0][j], &b->p[1][j], &b->p[2][j]);
}

typedef float four __attribute__((vector_size(16)));

static inline void add_colour(float *to, const float *colour, float weight) {
    four v, c;
    memcpy(&v, to, sizeof v);
    memcpy(&c, colour, sizeof c);
    v += c * weight;
    memcpy(to, &v, sizeof v);
}

/* ---- one level ---- */

static inline void copy_point(const pbs_thin_set *c, uint32_t i, pbs_thin_set *to) {
    if (c->sum) memcpy(to->sum + 4 * (size_t)to->count, c->sum + 4 * (size_t)i, 16);
    pbs_thin_put(to, c->x[i], c->y[i], c->z[i], c->id[i]);
}

/* Which of them are too near to something: bits. */
static inline unsigned too_near(const pbs_thin *t, const batch *b, f16 s2) {
    const pbs_thin_list *l = &t->some_kept, *o = &t->some_other;
    f16 least = f16_all(FAR);
    unsigned bad = 0;
    for (size_t i = 0; i < l->count; i++) least = f16_min(least, squares_near(b, l, i));
    for (size_t i = 0; i < o->count; i++)
        bad |= f16_less(squares_near(b, o, i), f16_min(s2, f16_all(o->at[3 * o->room + i])));
    return bad | f16_less(least, s2);
}

static void level_run(pbs_thin *t, const pbs_thin_set *c, const pbs_thin_run *r, int k,
                      pbs_thin_set *kept, pbs_thin_set *rejected) {
    const f16 s2 = f16_all(square_of(k));
    int32_t corner[3];
    corner_of(r, k + BLOCK_SHIFT, corner);
    for (uint32_t i = r->first; i < r->end; i += 16) {
        batch b = batch_of(c, i, r->end, corner);
        window w = window_of_batch(&b, ldexpf(1, k));
        filter(&t->some_kept, &t->kept, &w);
        filter(&t->some_other, &t->other, &w);
        unsigned all = (1u << b.count) - 1, bad = too_near(t, &b, s2), stay = 0;
        for (unsigned left = all & ~bad; left; left = all & ~bad & ~stay) {
            int j = __builtin_ctz(left);
            stay |= 1u << j;
            bad |= f16_less(squares_own(&b, j), s2);
            put_near(&t->kept, b.p[0][j], b.p[1][j], b.p[2][j], INFINITY,
                     kept->count + (uint32_t)__builtin_popcount(stay) - 1);
        }
        for (uint32_t j = 0; j < b.count; j++)
            copy_point(c, i + j, stay >> j & 1 ? kept : rejected);
    }
}

/* A candidate's colour to those that stay near it. */
static inline void give_colour(const pbs_thin_list *l, const batch *b, uint32_t j, float s2,
                               const float *colour, float *sum) {
    f16 x = f16_all(b->p[0][j]), y = f16_all(b->p[1][j]), z = f16_all(b->p[2][j]);
    for (size_t n = 0; n < l->count; n += 16) {
        const float *p = l->at + n;
        float weight[16];
        f16 dx = f16_sub(f16_at(p), x), dy = f16_sub(f16_at(p + l->room), y);
        f16 dz = f16_sub(f16_at(p + 2 * l->room), z);
        f16 d2 = f16_add(f16_add(f16_mul(dx, dx), f16_mul(dy, dy)), f16_mul(dz, dz));
        unsigned any = f16_less(d2, f16_all(s2));
        f16_put(weight, f16_sub(f16_all(1), f16_mul(d2, f16_all(1 / s2))));
        for (; any; any &= any - 1) {
            size_t i = (size_t)__builtin_ctz(any);
            add_colour(sum + 4 * (size_t)l->id[n + i], colour, weight[i]);
        }
    }
}

/* Each candidate's colour to all that stay near it. */
static pbs_code give_colours(pbs_thin *t, const pbs_thin_set *c, const decided *d, int k,
                             pbs_thin_set *kept, pbs_err *err) {
    memset(kept->sum, 0, 16 * (size_t)kept->count);
    for (size_t n = 0; n < t->run_count; n++) {
        const pbs_thin_run *r = &t->runs[n];
        int32_t corner[3];
        pbs_code rc = gather(t, d, r, err);
        if (!rc) rc = make_room(t->run, &t->some_kept, t->kept.count, err);
        if (rc) return rc;
        corner_of(r, d->shift, corner);
        for (uint32_t i = r->first; i < r->end; i += 16) {
            batch b = batch_of(c, i, r->end, corner);
            window w = window_of_batch(&b, ldexpf(1, k));
            filter(&t->some_kept, &t->kept, &w);
            /* Behind the last one are sixteen that are far from everything. */
            f16_put(t->some_kept.at + t->some_kept.count, f16_all(FAR));
            for (uint32_t j = 0; j < b.count; j++)
                give_colour(&t->some_kept, &b, j, square_of(k), c->sum + 4 * (size_t)(i + j),
                            kept->sum);
        }
    }
    return PBS_OK;
}

pbs_code PBS_THIN_NAME(pbs_thin_level_run)(pbs_thin *t, const pbs_thin_set *c, int k, bool first,
                                           pbs_thin_set *kept, pbs_thin_set *rejected,
                                           pbs_err *err);
pbs_code PBS_THIN_NAME(pbs_thin_level_run)(pbs_thin *t, const pbs_thin_set *c, int k, bool first,
                                           pbs_thin_set *kept, pbs_thin_set *rejected,
                                           pbs_err *err) {
    const decided d = {.kept = kept, .reach = (int64_t)1 << k, .shift = k + BLOCK_SHIFT};
    kept->count = 0;
    rejected->count = 0;
    for (size_t n = 0; n < t->run_count; n++) {
        pbs_thin_run *r = &t->runs[n];
        pbs_code rc = gather(t, &d, r, err);
        if (!rc) rc = make_room(t->run, &t->kept, t->kept.count + (r->end - r->first), err);
        if (!rc) rc = make_room(t->run, &t->some_kept, t->kept.count + (r->end - r->first), err);
        if (!rc) rc = make_room(t->run, &t->some_other, t->other.count, err);
        if (rc) return rc;
        uint32_t begin = kept->count;
        r->rejected = rejected->count;
        level_run(t, c, r, k, kept, rejected);
        r->rejected_end = rejected->count;
        pbs_thin_block *b = find_or_add(t, r->at);
        b->kept = begin, b->kept_count = kept->count - begin;
    }
    return c->sum && !first ? give_colours(t, c, &d, k, kept, err) : PBS_OK;
}

/* ---- what a level left over ---- */

/* The largest k below `below` with 2^k of at most a distance. */
static inline int level_of(float square, int below) {
    uint32_t bits;
    memcpy(&bits, &square, sizeof bits);
    int k = ((int)(bits >> 23) - 127) >> 1;
    k -= k > 11 && square < square_of(k);
    return k < below ? k : below - 1;
}

/* level_of for all, but for the bound; 0 for what is below 1. */
static inline b16 levels_of(f16 square, int below) {
    if (below > 12) {
        float v[16];
        int8_t k[16];
        f16_put(v, square);
        for (int j = 0; j < 16; j++) k[j] = (int8_t)(v[j] < 1 ? 0 : level_of(v[j], 100));
        return b16_at(k);
    }
#if defined(__AVX2__)
    const __m256i bias = _mm256_set1_epi32(127), zero = _mm256_setzero_si256();
    __m256i a = _mm256_srli_epi32(_mm256_castps_si256(square.a), 23),
            b = _mm256_srli_epi32(_mm256_castps_si256(square.b), 23);
    a = _mm256_srli_epi32(_mm256_max_epi32(_mm256_sub_epi32(a, bias), zero), 1);
    b = _mm256_srli_epi32(_mm256_max_epi32(_mm256_sub_epi32(b, bias), zero), 1);
    __m256i both = _mm256_permute4x64_epi64(_mm256_packs_epi32(a, b), 0xd8);
    return _mm_packs_epi16(_mm256_castsi256_si128(both), _mm256_extracti128_si256(both, 1));
#else
    float v[16];
    int8_t k[16];
    f16_put(v, square);
    for (int j = 0; j < 16; j++) k[j] = (int8_t)(v[j] < 1 ? 0 : level_of(v[j], 100));
    return b16_at(k);
#endif
}

typedef struct nearest {
    f16 square; /* of the distance to the nearest that asks for more than that */
    f16 kept;   /* to the nearest that stays; FAR: none */
    f16 which;  /* that one */
} nearest;

static inline nearest nearest_of(const pbs_thin *t, const batch *b) {
    const pbs_thin_list *l = &t->some_kept, *o = &t->some_other;
    const float *asked = o->at + 3 * o->room;
    const f16 far = f16_all(FAR);
    nearest n = {far, far, f16_all(0)};
    for (size_t i = 0; i < l->count; i++) {
        f16 d2 = squares_near(b, l, i);
        n.which = f16_if_less(d2, n.kept, f16_all((float)i), n.which);
        n.kept = f16_min(n.kept, d2);
    }
    for (size_t i = 0; i < o->count; i++) {
        f16 d2 = squares_near(b, o, i);
        n.square = f16_min(n.square, f16_if_less(d2, f16_all(asked[i]), d2, far));
    }
    n.square = f16_min(n.square, n.kept);
    return n;
}

/* Levels of a batch, one after the other: each respects those before it. A point that is closer
 * than an earlier one's spacing asks has at most the level of that distance. */
static inline b16 decide(const batch *b, f16 square, int k) {
    static const int8_t past[31] = {127, 127, 127, 127, 127, 127, 127, 127,
                                    127, 127, 127, 127, 127, 127, 127, 127};
    b16 level = b16_min(levels_of(square, k), b16_all((int8_t)(k - 1)));
    for (int j = 0; j < (int)b->count - 1; j++) {
        b16 to = b16_or(levels_of(squares_own(b, j), k), b16_at(past + 15 - j));
        level = b16_min(level, b16_if_less(to, b16_lane(level, j)));
    }
    return level;
}

/* The squares of their spacings. */
static inline f16 asked_by(const int8_t level[16]) {
    float v[16];
    for (int j = 0; j < 16; j++) v[j] = square_of(level[j]);
    return f16_at(v);
}

typedef struct tail_job {
    const pbs_thin_set *rejected;
    float *sum; /* of the kept; NULL: no colours */
    int8_t *level;
    int k;
} tail_job;

static inline void tail_batch(pbs_thin *t, const tail_job *job, const batch *b) {
    const pbs_thin_set *c = job->rejected;
    const float s2 = square_of(job->k), reach = ldexpf(1, job->k);
    window w = window_of_batch(b, reach);
    filter(&t->some_kept, &t->kept, &w);
    w = window_of_batch(b, reach / 2);
    filter(&t->some_other, &t->other, &w);
    nearest n = nearest_of(t, b);
    int8_t level[16];
    b16_put(level, decide(b, n.square, job->k));
    f16 asked = asked_by(level);
    float *to = t->other.at + t->other.count, kept[16], which[16];
    size_t room = t->other.room;
    for (int a = 0; a < 3; a++) f16_put(to + (size_t)a * room, b->at[a]);
    f16_put(to + 3 * room, asked);
    f16_put(t->tail + b->first, asked);
    t->other.count += b->count;
    for (uint32_t j = 0; j < b->count; j++) job->level[c->id[b->first + j]] = level[j];
    if (!job->sum) return;
    f16_put(kept, n.kept);
    f16_put(which, n.which);
    for (uint32_t j = 0; j < b->count; j++)
        if (kept[j] < s2)
            add_colour(job->sum + 4 * (size_t)t->some_kept.id[(size_t)which[j]],
                       c->sum + 4 * (size_t)(b->first + j), 1 - kept[j] / s2);
}

pbs_code PBS_THIN_NAME(pbs_thin_tail_run)(pbs_thin *t, pbs_thin_set *kept,
                                          const pbs_thin_set *rejected, int k, int8_t *level,
                                          pbs_err *err);
pbs_code PBS_THIN_NAME(pbs_thin_tail_run)(pbs_thin *t, pbs_thin_set *kept,
                                          const pbs_thin_set *rejected, int k, int8_t *level,
                                          pbs_err *err) {
    const tail_job job = {rejected, kept->sum, level, k};
    const decided d = {.kept = kept,
                       .tail = rejected,
                       .reach = (int64_t)1 << k,
                       .tail_reach = (int64_t)1 << (k ? k - 1 : 0),
                       .shift = k + BLOCK_SHIFT};
    for (size_t n = 0; n < t->run_count; n++) {
        const pbs_thin_run *r = &t->runs[n];
        uint32_t count = r->rejected_end - r->rejected;
        int32_t corner[3];
        if (!count) continue;
        pbs_code rc = gather(t, &d, r, err);
        if (!rc) rc = make_room(t->run, &t->other, t->other.count + count, err);
        if (!rc) rc = make_room(t->run, &t->some_kept, t->kept.count, err);
        if (!rc) rc = make_room(t->run, &t->some_other, t->other.count + count, err);
        if (rc) return rc;
        corner_of(r, d.shift, corner);
        for (uint32_t i = r->rejected; i < r->rejected_end; i += 16) {
            batch b = batch_of(rejected, i, r->rejected_end, corner);
            tail_batch(t, &job, &b);
        }
        pbs_thin_block *b = find(t, r->at[0], r->at[1], r->at[2]);
        b->tail = r->rejected, b->tail_count = count;
    }
    return PBS_OK;
}
#endif
