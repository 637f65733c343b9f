/* One level of a continuous level of detail (thin.h): sets, tables, and which loops run. */
#define PBS_THIN_NAME(name) name
#include "libcore/clouds/thin_inner.h"

typedef pbs_code level_loop(pbs_thin *t, const pbs_thin_set *c, int k, bool first,
                            pbs_thin_set *kept, pbs_thin_set *rejected, pbs_err *err);
typedef pbs_code tail_loop(pbs_thin *t, pbs_thin_set *kept, const pbs_thin_set *rejected, int k,
                           int8_t *level, pbs_err *err);
level_loop pbs_thin_level_run_avx2;
tail_loop pbs_thin_tail_run_avx2;

static bool have_avx2(void) {
#if defined(__x86_64__) && defined(__GNUC__)
    return __builtin_cpu_supports("avx2");
#else
    return false;
#endif
}

pbs_code pbs_thin_set_new(pbs_run *run, size_t room, bool colours, pbs_thin_set *s, pbs_err *err) {
    memset(s, 0, sizeof *s);
    pbs_code rc = pbs_alloc(run, &s->x, room + 16, sizeof *s->x, "a level's points", err);
    if (!rc) rc = pbs_alloc(run, &s->y, room + 16, sizeof *s->y, "a level's points", err);
    if (!rc) rc = pbs_alloc(run, &s->z, room + 16, sizeof *s->z, "a level's points", err);
    if (!rc) rc = pbs_alloc(run, &s->id, room + 16, sizeof *s->id, "a level's points", err);
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
    pbs_code rc = pbs_alloc(run, &t->tail, room + 16, sizeof *t->tail, "a level's points", err);
    if (!rc) rc = pbs_alloc(run, &t->row, 64, sizeof *t->row, "a level's points", err);
    if (!rc) memset(t->row, 0, 64 * sizeof *t->row);
    if (!rc) rc = make_room(run, &t->kept, 1000, err);
    return rc ? rc : make_room(run, &t->other, 1000, err);
}

static void list_free(pbs_run *run, pbs_thin_list *l) {
    pbs_free(run, l->at);
    pbs_free(run, l->id);
}

void pbs_thin_free(pbs_thin *t) {
    if (!t->run) return;
    pbs_free(t->run, t->block);
    pbs_free(t->run, t->slot);
    pbs_free(t->run, t->row);
    pbs_free(t->run, t->runs);
    pbs_free(t->run, t->tail);
    pbs_free(t->run, t->fixed);
    list_free(t->run, &t->kept);
    list_free(t->run, &t->other);
    list_free(t->run, &t->some_kept);
    list_free(t->run, &t->some_other);
    memset(t, 0, sizeof *t);
}

pbs_code pbs_thin_reserve_fixed(pbs_thin *t, size_t more, pbs_err *err) {
    return pbs_grow(t->run, &t->fixed, &t->fixed_room, t->fixed_count + more, sizeof *t->fixed,
                    "points beside a cell", err);
}

static inline bool same_block(const pbs_thin_set *s, uint32_t i, const pbs_thin_run *r, int shift) {
    return !(((s->x[i] >> shift) ^ r->at[0]) | ((s->y[i] >> shift) ^ r->at[1]) |
             ((s->z[i] >> shift) ^ r->at[2]));
}
static inline int32_t least(int32_t a, int32_t b) {
    return a < b ? a : b;
}
static inline int32_t most(int32_t a, int32_t b) {
    return a > b ? a : b;
}

static pbs_thin_run run_from(const pbs_thin_set *s, uint32_t i, int shift) {
    int32_t x = s->x[i], y = s->y[i], z = s->z[i];
    pbs_thin_run r = {.first = i, .at = {x >> shift, y >> shift, z >> shift}};
    r.min[0] = r.max[0] = x, r.min[1] = r.max[1] = y, r.min[2] = r.max[2] = z;
    for (i++; i < s->count && same_block(s, i, &r, shift); i++) {
        r.min[0] = least(r.min[0], s->x[i]), r.max[0] = most(r.max[0], s->x[i]);
        r.min[1] = least(r.min[1], s->y[i]), r.max[1] = most(r.max[1], s->y[i]);
        r.min[2] = least(r.min[2], s->z[i]), r.max[2] = most(r.max[2], s->z[i]);
    }
    r.end = i;
    return r;
}

static pbs_code find_runs(pbs_thin *t, const pbs_thin_set *c, int shift, pbs_err *err) {
    t->run_count = 0;
    for (uint32_t i = 0; i < c->count; i = t->runs[t->run_count++].end) {
        pbs_code rc = pbs_grow(t->run, &t->runs, &t->run_room, t->run_count + 1, sizeof *t->runs,
                               "blocks of points", err);
        if (rc) return rc;
        t->runs[t->run_count] = run_from(c, i, shift);
    }
    return PBS_OK;
}

/* An empty table for the blocks of the candidates and of the fixed points. */
static pbs_code make_table(pbs_thin *t, const pbs_thin_set *c, int shift, pbs_err *err) {
    pbs_code rc = find_runs(t, c, shift, err);
    for (size_t i = 0; i < t->block_count; i++) /* of the level before */
        t->row[t->block[i].at[2] & 63][t->block[i].at[1] & 63] = 0;
    t->block_count = 0;
    size_t blocks = t->fixed_count + t->run_count, slots = 16;
    while (slots < 2 * blocks) slots *= 2;
    if (!rc && blocks > t->block_room) {
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
    level_loop *loop = have_avx2() ? pbs_thin_level_run_avx2 : pbs_thin_level_run;
    return loop(t, c, k, first, kept, rejected, err);
}

pbs_code pbs_thin_tail(pbs_thin *t, pbs_thin_set *kept, const pbs_thin_set *rejected, int k,
                       int8_t *level, pbs_err *err) {
    tail_loop *loop = have_avx2() ? pbs_thin_tail_run_avx2 : pbs_thin_tail_run;
    return loop(t, kept, rejected, k, level, err);
}
