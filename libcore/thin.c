/* One level of a continuous level of detail (thin.h).
 *
 * Space is cut into blocks that are a few spacings wide. Points in Morton order come block by
 * block, and what a block keeps lies together, so a hash of blocks to ranges finds all that is near
 * the block's candidates; they are copied once and serve all of them, eight at a time.
 *
 * This file is compiled a second time for AVX2, by thin_avx2.c. */
#include "libcore/thin.h"
#include "libcore/simd8.h"
#include <string.h>

#ifndef PBS_THIN_NAME
#define PBS_THIN_NAME(name) name
#endif

#define BLOCK_SHIFT 1          /* a block is 2^(k + BLOCK_SHIFT) wide: two spacings */
#define FIXED       UINT32_MAX /* takes no colour */
#define FAR         1e30f      /* its square is infinite */

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

/* ---- the points of a block, and those near it ---- */

typedef struct run_of {
    uint32_t first, end;
    int32_t at[3], min[3], max[3]; /* block; box around its candidates */
    int shift;
} run_of;

/* Positions near a block are relative to its corner: float holds them exactly. */
static inline float from_corner(const run_of *r, int axis, int32_t v) {
    return (float)(v - (int32_t)((uint32_t)r->at[axis] << r->shift));
}

static inline void block_at(const pbs_thin_set *s, uint32_t i, int shift, int32_t at[3]) {
    at[0] = s->x[i] >> shift, at[1] = s->y[i] >> shift, at[2] = s->z[i] >> shift;
}

static inline bool same_block(const pbs_thin_set *s, uint32_t i, const run_of *r) {
    return !(((s->x[i] >> r->shift) ^ r->at[0]) | ((s->y[i] >> r->shift) ^ r->at[1]) |
             ((s->z[i] >> r->shift) ^ r->at[2]));
}

static inline int32_t least(int32_t a, int32_t b) {
    return a < b ? a : b;
}
static inline int32_t most(int32_t a, int32_t b) {
    return a > b ? a : b;
}

static inline void next_run(const pbs_thin_set *s, run_of *r) {
    uint32_t i = r->first = r->end;
    block_at(s, i, r->shift, r->at);
    r->min[0] = r->max[0] = s->x[i], r->min[1] = r->max[1] = s->y[i];
    r->min[2] = r->max[2] = s->z[i];
    for (i++; i < s->count && same_block(s, i, r); i++) {
        r->min[0] = least(r->min[0], s->x[i]), r->max[0] = most(r->max[0], s->x[i]);
        r->min[1] = least(r->min[1], s->y[i]), r->max[1] = most(r->max[1], s->y[i]);
        r->min[2] = least(r->min[2], s->z[i]), r->max[2] = most(r->max[2], s->z[i]);
    }
    r->end = i;
}

static pbs_code reserve_near(pbs_thin *t, size_t need, pbs_err *err) {
    need += 16;
    if (need <= t->near_room) return PBS_OK;
    size_t room = need + need / 2;
    pbs_free(t->run, t->near);
    pbs_free(t->run, t->near_id);
    t->near = NULL, t->near_id = NULL, t->near_room = 0;
    pbs_code rc =
        pbs_alloc(t->run, &t->near, 4 * room, sizeof *t->near, "points near a block", err);
    if (!rc)
        rc = pbs_alloc(t->run, &t->near_id, room, sizeof *t->near_id, "points near a block", err);
    if (!rc) t->near_room = room;
    return rc;
}

/* Behind the last one there are always eight that are far from everything. */
static inline void put_near(pbs_thin *t, float x, float y, float z, float square, uint32_t id) {
    float *p = t->near;
    size_t n = t->near_count++, room = t->near_room;
    p[n] = x, p[room + n] = y, p[2 * room + n] = z, p[3 * room + n] = square;
    t->near_id[n] = id;
}
static inline void end_near(pbs_thin *t) {
    f8_put(t->near + t->near_count, f8_all(FAR));
}

/* Positions that can be too near to a candidate, from the block's corner. */
typedef struct window {
    int32_t corner[3];
    float low[3], high[3];
} window;

static inline void take_near(pbs_thin *t, const window *w, int32_t x, int32_t y, int32_t z,
                             float square, uint32_t id) {
    float px = (float)(x - w->corner[0]), py = (float)(y - w->corner[1]),
          pz = (float)(z - w->corner[2]);
    size_t before = t->near_count;
    put_near(t, px, py, pz, square, id);
    t->near_count = before + ((px >= w->low[0]) & (px <= w->high[0]) & (py >= w->low[1]) &
                              (py <= w->high[1]) & (pz >= w->low[2]) & (pz <= w->high[2]));
}

/* Points first .. first + count - 1 of a set. k: exponents of their spacings, NULL: they are kept
 * and take colours. Room for 8 more than that is behind the list. */
#ifdef __AVX2__
static inline __m256 axis_from(const int32_t *p, int32_t corner) {
    __m256i v = _mm256_loadu_si256((const __m256i *)(const void *)p);
    return _mm256_cvtepi32_ps(_mm256_sub_epi32(v, _mm256_set1_epi32(corner)));
}
static inline __m256 within(__m256 v, float low, float high) {
    return _mm256_and_ps(_mm256_cmp_ps(v, _mm256_set1_ps(low), _CMP_GE_OQ),
                         _mm256_cmp_ps(v, _mm256_set1_ps(high), _CMP_LE_OQ));
}
static inline __m256 squares_of(const uint32_t *k) {
    __m256i e = _mm256_loadu_si256((const __m256i *)(const void *)k);
    __m256i more =
        _mm256_and_si256(_mm256_cmpgt_epi32(e, _mm256_set1_epi32(11)), _mm256_set1_epi32(1 << 7));
    e = _mm256_add_epi32(_mm256_add_epi32(e, e), _mm256_set1_epi32(127));
    return _mm256_castsi256_ps(_mm256_or_si256(_mm256_slli_epi32(e, 23), more));
}
static void take_range(pbs_thin *t, const window *w, const pbs_thin_set *s, uint32_t first,
                       uint32_t count, const uint32_t *k) {
    size_t n = t->near_count, room = t->near_room;
    for (uint32_t i = first; i < first + count; i += 8) {
        uint32_t left = first + count - i;
        __m256 x = axis_from(s->x + i, w->corner[0]), y = axis_from(s->y + i, w->corner[1]),
               z = axis_from(s->z + i, w->corner[2]);
        __m256 in = _mm256_and_ps(
            within(x, w->low[0], w->high[0]),
            _mm256_and_ps(within(y, w->low[1], w->high[1]), within(z, w->low[2], w->high[2])));
        unsigned mask = (unsigned)_mm256_movemask_ps(in) & (left < 8 ? (1u << left) - 1 : 255);
        if (!mask) continue;
        /* the lanes that are in, one behind the other */
        uint64_t bytes = _pext_u64(0x0706050403020100u, _pdep_u64(mask, 0x0101010101010101u) * 255);
        __m256i lane = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128((long long)bytes));
        __m256i id = _mm256_add_epi32(lane, _mm256_set1_epi32((int)i));
        __m256 square = k ? squares_of(k + i) : _mm256_set1_ps(INFINITY);
        if (k) id = _mm256_set1_epi32((int)FIXED);
        _mm256_storeu_ps(t->near + n, _mm256_permutevar8x32_ps(x, lane));
        _mm256_storeu_ps(t->near + room + n, _mm256_permutevar8x32_ps(y, lane));
        _mm256_storeu_ps(t->near + 2 * room + n, _mm256_permutevar8x32_ps(z, lane));
        _mm256_storeu_ps(t->near + 3 * room + n, _mm256_permutevar8x32_ps(square, lane));
        _mm256_storeu_si256((__m256i *)(void *)(t->near_id + n), id);
        n += (size_t)__builtin_popcount(mask);
    }
    t->near_count = n;
}
#else
static void take_range(pbs_thin *t, const window *w, const pbs_thin_set *s, uint32_t first,
                       uint32_t count, const uint32_t *k) {
    for (uint32_t i = first; i < first + count; i++)
        take_near(t, w, s->x[i], s->y[i], s->z[i], k ? square_of((int)k[i]) : INFINITY,
                  k ? FIXED : i);
}
#endif

static pbs_code gather_block(pbs_thin *t, const pbs_thin_set *kept, const pbs_thin_block *b,
                             const window *w, size_t more, pbs_err *err) {
    size_t n = b->kept_count + b->tail_count;
    if (t->near_count + n + more + 16 > t->near_room) {
        /* The list is filled anew by the caller. */
        pbs_code rc = reserve_near(t, 2 * (t->near_count + n + more), err);
        return rc ? rc : (t->near_count = SIZE_MAX, PBS_OK);
    }
    if (b->kept_count) take_range(t, w, kept, b->kept, b->kept_count, NULL);
    if (b->tail_count) take_range(t, w, &t->tail, b->tail, b->tail_count, t->tail.id);
    for (uint32_t i = b->fixed; i; i = t->fixed[i - 1].next) {
        const struct pbs_thin_fixed *f = &t->fixed[i - 1];
        if (t->near_count + more + 16 > t->near_room) {
            pbs_code rc = reserve_near(t, 2 * (t->near_count + more), err);
            return rc ? rc : (t->near_count = SIZE_MAX, PBS_OK);
        }
        take_near(t, w, f->at[0], f->at[1], f->at[2], square_of(f->k), FIXED);
    }
    return PBS_OK;
}

/* What is nearer than `reach` to the box of the run's candidates, relative to the block's corner.
 */
static pbs_code gather(pbs_thin *t, const pbs_thin_set *kept, const run_of *r, int64_t reach,
                       pbs_err *err) {
    window w;
    int64_t low[3], high[3];
    for (int k = 0; k < 3; k++) {
        low[k] = (r->min[k] - reach) >> r->shift, high[k] = (r->max[k] + reach) >> r->shift;
        w.corner[k] = (int32_t)((uint32_t)r->at[k] << r->shift);
        w.low[k] = (float)(r->min[k] - w.corner[k]) - (float)reach;
        w.high[k] = (float)(r->max[k] - w.corner[k]) + (float)reach;
    }
    pbs_code rc = reserve_near(t, r->end - r->first, err);
again:
    t->near_count = 0;
    for (int64_t z = low[2]; z <= high[2]; z++)
        for (int64_t y = low[1]; y <= high[1]; y++)
            for (int64_t x = low[0]; x <= high[0]; x++) {
                const pbs_thin_block *b = find(t, (int32_t)x, (int32_t)y, (int32_t)z);
                if (b && !rc) rc = gather_block(t, kept, b, &w, r->end - r->first, err);
                if (!rc && t->near_count == SIZE_MAX) goto again;
            }
    if (!rc) end_near(t);
    return rc;
}

/* The squares of the distances from a candidate to the points near it, number i and the next. */
static inline f8 squares(const pbs_thin *t, size_t i, const f8 at[3]) {
    const float *p = t->near + i;
    size_t room = t->near_room;
    f8 dx = f8_sub(f8_at(p), at[0]), dy = f8_sub(f8_at(p + room), at[1]);
    f8 dz = f8_sub(f8_at(p + 2 * room), at[2]);
    return f8_add(f8_add(f8_mul(dx, dx), f8_mul(dy, dy)), f8_mul(dz, dz));
}

/* The first of them that is nearer than its spacing and than s2 say, or near_count. */
static inline size_t too_near(const pbs_thin *t, const f8 at[3], float s2) {
    f8 s = f8_all(s2);
    for (size_t i = 0; i < t->near_count; i += 8) {
        unsigned any = f8_less(squares(t, i, at), f8_min(s, f8_at(t->near + 3 * t->near_room + i)));
        if (any) return i + (size_t)__builtin_ctz(any);
    }
    return t->near_count;
}

static inline void position_of(const pbs_thin_set *s, uint32_t i, const run_of *r, float p[3]) {
    p[0] = from_corner(r, 0, s->x[i]), p[1] = from_corner(r, 1, s->y[i]);
    p[2] = from_corner(r, 2, s->z[i]);
}

/* ---- one level ---- */

typedef float four __attribute__((vector_size(16)));

static inline void add_colour(float *to, const float *colour, float weight) {
    four v, c;
    memcpy(&v, to, sizeof v);
    memcpy(&c, colour, sizeof c);
    v += c * weight;
    memcpy(to, &v, sizeof v);
}

static void level_run(pbs_thin *t, const pbs_thin_set *c, const run_of *r, float s2,
                      pbs_thin_set *kept, pbs_thin_set *rejected) {
    for (uint32_t i = r->first; i < r->end; i++) {
        float p[3];
        position_of(c, i, r, p);
        f8 at[3] = {f8_all(p[0]), f8_all(p[1]), f8_all(p[2])};
        pbs_thin_set *to = rejected;
        if (too_near(t, at, s2) == t->near_count) {
            to = kept;
            put_near(t, p[0], p[1], p[2], INFINITY, kept->count);
            if (t->near_count % 8 == 0) end_near(t);
        }
        if (c->sum) memcpy(to->sum + 4 * (size_t)to->count, c->sum + 4 * (size_t)i, 16);
        pbs_thin_put(to, c->x[i], c->y[i], c->z[i], c->id[i]);
    }
}

/* A colour to those of eight that stay and are closer than s2 says. */
static inline void give_colour(const pbs_thin *t, size_t first, f8 d2, float s2,
                               const float *colour, float *sum) {
    unsigned any = f8_less(d2, f8_all(s2));
    if (!any) return;
    float weight[8];
    f8_put(weight, f8_sub(f8_all(1), f8_mul(d2, f8_all(1 / s2))));
    for (; any; any &= any - 1) {
        size_t j = (size_t)__builtin_ctz(any);
        uint32_t id = t->near_id[first + j];
        if (id != FIXED) add_colour(sum + 4 * (size_t)id, colour, weight[j]);
    }
}

/* Each candidate's colour to all that stay near it. */
static pbs_code give_colours(pbs_thin *t, const pbs_thin_set *c, int k, pbs_thin_set *kept,
                             pbs_err *err) {
    run_of r = {.shift = k + BLOCK_SHIFT};
    float s2 = square_of(k);
    memset(kept->sum, 0, 16 * (size_t)kept->count);
    while (r.end < c->count) {
        next_run(c, &r);
        pbs_code rc = gather(t, kept, &r, (int64_t)1 << k, err);
        if (rc) return rc;
        for (uint32_t i = r.first; i < r.end; i++) {
            float p[3];
            position_of(c, i, &r, p);
            f8 at[3] = {f8_all(p[0]), f8_all(p[1]), f8_all(p[2])};
            for (size_t n = 0; n < t->near_count; n += 8)
                give_colour(t, n, squares(t, n, at), s2, c->sum + 4 * (size_t)i, kept->sum);
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
    run_of r = {.shift = k + BLOCK_SHIFT};
    float s2 = square_of(k);
    kept->count = 0;
    rejected->count = 0;
    while (r.end < c->count) {
        next_run(c, &r);
        pbs_code rc = gather(t, kept, &r, (int64_t)1 << k, err);
        if (rc) return rc;
        uint32_t begin = kept->count;
        level_run(t, c, &r, s2, kept, rejected);
        pbs_thin_block *b = find_or_add(t, r.at);
        b->kept = begin, b->kept_count = kept->count - begin;
    }
    return c->sum && !first ? give_colours(t, c, k, kept, err) : PBS_OK;
}

/* ---- what a level left over ---- */

typedef struct nearest {
    float square; /* of the distance to the nearest that asks for more than that */
    float kept;   /* to the nearest that stays; FAR: none */
    size_t which; /* that one */
} nearest;

static inline nearest nearest_of(const pbs_thin *t, const f8 at[3]) {
    const float *asked = t->near + 3 * t->near_room;
    f8 far = f8_all(FAR), best = far, kept = far, which = f8_all(0);
    float d[8], first[8];
    for (size_t i = 0; i < t->near_count; i += 8) {
        f8 d2 = squares(t, i, at), square = f8_at(asked + i);
        best = f8_min(best, f8_if_less(d2, square, d2, far));
        f8 stays = f8_if_less(far, square, d2, far);
        which = f8_if_less(stays, kept, f8_all((float)i), which);
        kept = f8_min(stays, kept); /* in this order: behind the last one anything may lie */
    }
    nearest n = {f8_least(best), FAR, 0};
    f8_put(d, kept);
    f8_put(first, which);
    for (size_t j = 0; j < 8; j++)
        if (d[j] < n.kept) n.kept = d[j], n.which = (size_t)first[j] + j;
    return n;
}

/* The largest k below `below` with 2^k of at most a distance. */
static inline int level_of(float square, int below) {
    uint32_t bits;
    memcpy(&bits, &square, sizeof bits);
    int k = ((int)(bits >> 23) - 127) >> 1;
    k -= k > 11 && square < square_of(k);
    return k < below ? k : below - 1;
}

static void tail_run(pbs_thin *t, const pbs_thin_set *c, const run_of *r, int k, float *sum,
                     int8_t *level) {
    const float s2 = square_of(k);
    for (uint32_t i = r->first; i < r->end; i++) {
        float p[3];
        position_of(c, i, r, p);
        f8 at[3] = {f8_all(p[0]), f8_all(p[1]), f8_all(p[2])};
        nearest n = nearest_of(t, at);
        int l = level_of(n.square, k);
        if (sum && n.kept < s2)
            add_colour(sum + 4 * (size_t)t->near_id[n.which], c->sum + 4 * (size_t)i,
                       1 - n.kept / s2);
        level[c->id[i]] = (int8_t)l;
        pbs_thin_put(&t->tail, c->x[i], c->y[i], c->z[i], (uint32_t)l);
        put_near(t, p[0], p[1], p[2], square_of(l), FIXED);
        if (t->near_count % 8 == 0) end_near(t);
    }
}

pbs_code PBS_THIN_NAME(pbs_thin_tail_run)(pbs_thin *t, pbs_thin_set *kept,
                                          const pbs_thin_set *rejected, int k, int8_t *level,
                                          pbs_err *err);
pbs_code PBS_THIN_NAME(pbs_thin_tail_run)(pbs_thin *t, pbs_thin_set *kept,
                                          const pbs_thin_set *rejected, int k, int8_t *level,
                                          pbs_err *err) {
    run_of r = {.shift = k + BLOCK_SHIFT};
    t->tail.count = 0;
    while (r.end < rejected->count) {
        next_run(rejected, &r);
        pbs_code rc = gather(t, kept, &r, (int64_t)1 << (k ? k - 1 : 0), err);
        if (rc) return rc;
        uint32_t first = t->tail.count;
        tail_run(t, rejected, &r, k, kept->sum, level);
        pbs_thin_block *b = find(t, r.at[0], r.at[1], r.at[2]);
        b->tail = first, b->tail_count = t->tail.count - first;
    }
    return PBS_OK;
}

#ifndef PBS_THIN_ONCE
#define PBS_THIN_ONCE

static bool have_avx2(void) {
#if defined(__x86_64__) && defined(__GNUC__)
    return __builtin_cpu_supports("avx2");
#else
    return false;
#endif
}

pbs_code pbs_thin_level_run_avx2(pbs_thin *t, const pbs_thin_set *c, int k, bool first,
                                 pbs_thin_set *kept, pbs_thin_set *rejected, pbs_err *err);
pbs_code pbs_thin_tail_run_avx2(pbs_thin *t, pbs_thin_set *kept, const pbs_thin_set *rejected,
                                int k, int8_t *level, pbs_err *err);

pbs_code pbs_thin_set_new(pbs_run *run, size_t room, bool colours, pbs_thin_set *s, pbs_err *err) {
    memset(s, 0, sizeof *s);
    pbs_code rc = pbs_alloc(run, &s->x, room + 8, sizeof *s->x, "a level's points", err);
    if (!rc) rc = pbs_alloc(run, &s->y, room + 8, sizeof *s->y, "a level's points", err);
    if (!rc) rc = pbs_alloc(run, &s->z, room + 8, sizeof *s->z, "a level's points", err);
    if (!rc) rc = pbs_alloc(run, &s->id, room + 8, sizeof *s->id, "a level's points", err);
    if (!rc && colours) rc = pbs_alloc(run, &s->sum, room, 4 * sizeof *s->sum, "colours", err);
    return rc;
}

void pbs_thin_set_free(pbs_run *run, pbs_thin_set *s) {
    pbs_free(run, s->x);
    pbs_free(run, s->y);
    pbs_free(run, s->z);
    pbs_free(run, s->id);
    pbs_free(run, s->sum);
    memset(s, 0, sizeof *s);
}

pbs_code pbs_thin_new(pbs_run *run, size_t room, pbs_thin *t, pbs_err *err) {
    memset(t, 0, sizeof *t);
    t->run = run;
    pbs_code rc = pbs_thin_set_new(run, room, false, &t->tail, err);
    return rc ? rc : reserve_near(t, 1000, err);
}

void pbs_thin_free(pbs_thin *t) {
    if (!t->run) return;
    pbs_free(t->run, t->block);
    pbs_free(t->run, t->slot);
    pbs_free(t->run, t->fixed);
    pbs_free(t->run, t->near);
    pbs_free(t->run, t->near_id);
    pbs_thin_set_free(t->run, &t->tail);
    memset(t, 0, sizeof *t);
}

pbs_code pbs_thin_reserve_fixed(pbs_thin *t, size_t more, pbs_err *err) {
    return pbs_grow(t->run, &t->fixed, &t->fixed_room, t->fixed_count + more, sizeof *t->fixed,
                    "points beside a cell", err);
}

/* An empty table for the blocks of the candidates and of the fixed points. */
static pbs_code make_table(pbs_thin *t, const pbs_thin_set *c, int shift, pbs_err *err) {
    size_t blocks = t->fixed_count, slots = 16;
    run_of r = {.shift = shift};
    for (uint32_t i = 0; i < c->count; i++) {
        if (i && same_block(c, i, &r)) continue;
        block_at(c, i, shift, r.at);
        blocks++;
    }
    while (slots < 2 * blocks) slots *= 2;
    pbs_code rc = PBS_OK;
    if (blocks > t->block_room) {
        pbs_free(t->run, t->block);
        t->block = NULL, t->block_room = 0;
        rc = pbs_alloc(t->run, &t->block, blocks, sizeof *t->block, "blocks of points", err);
        t->block_room = rc ? 0 : blocks;
    }
    if (!rc && slots > t->slot_room) {
        pbs_free(t->run, t->slot);
        t->slot = NULL, t->slot_room = 0;
        rc = pbs_alloc(t->run, &t->slot, slots, sizeof *t->slot, "blocks of points", err);
        t->slot_room = rc ? 0 : slots;
    }
    if (rc) return rc;
    memset(t->slot, 0, slots * sizeof *t->slot);
    t->slot_mask = (uint32_t)slots - 1;
    t->block_count = 0;
    return PBS_OK;
}

static void add_fixed(pbs_thin *t, int shift) {
    for (size_t i = 0; i < t->fixed_count; i++) {
        struct pbs_thin_fixed *f = &t->fixed[i];
        int32_t at[3] = {f->at[0] >> shift, f->at[1] >> shift, f->at[2] >> shift};
        pbs_thin_block *b = find_or_add(t, at);
        f->next = b->fixed;
        b->fixed = (uint32_t)i + 1;
    }
}

pbs_code pbs_thin_level(pbs_thin *t, const pbs_thin_set *c, int k, bool first, pbs_thin_set *kept,
                        pbs_thin_set *rejected, pbs_err *err) {
    pbs_code rc = make_table(t, c, k + BLOCK_SHIFT, err);
    if (rc) return rc;
    add_fixed(t, k + BLOCK_SHIFT);
    return (have_avx2() ? pbs_thin_level_run_avx2 : pbs_thin_level_run)(t, c, k, first, kept,
                                                                        rejected, err);
}

pbs_code pbs_thin_tail(pbs_thin *t, pbs_thin_set *kept, const pbs_thin_set *rejected, int k,
                       int8_t *level, pbs_err *err) {
    return (have_avx2() ? pbs_thin_tail_run_avx2 : pbs_thin_tail_run)(t, kept, rejected, k, level,
                                                                      err);
}
#endif
