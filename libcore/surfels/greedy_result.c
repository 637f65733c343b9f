/* Reads the greedy permutation off a tree in which the surfels are marked.
 *
 * This file is compiled a second time for AVX2, by greedy_result_avx2.c. */
#include "libcore/surfels/greedy.h"
#include "libcore/surfels/greedy_inner.h"
#include "libcore/ground/pipe.h"

#ifndef PBS_GREEDY_NAME
#define PBS_GREEDY_NAME(name) name
#endif

enum {
    DIGIT = 11,
    SMALL_DIGIT = 8, /* for so few that clearing the counts would be the most work */
    FEW = 1 << 12,
    SORT_PART = 1 << 14, /* surfels that are worth a thread */
    LEAF_PART = 1 << 10  /* leaves */
};

/* Surfels sort by (d falling, index rising), which is the order they were chosen in. */
static uint64_t place_of(float d, uint32_t id) {
    uint32_t bits;
    memcpy(&bits, &d, 4);
    return (uint64_t)~bits << 32 | id;
}

static float place_d(uint64_t place) {
    uint32_t bits = ~(uint32_t)(place >> 32);
    float d;
    memcpy(&d, &bits, 4);
    return d;
}

typedef struct share {
    size_t surfels, zero; /* in a part of the leaves; surfels: then where they go */
} share;

typedef struct harvest {
    pbs_tree *t;
    size_t first, wanted;
    uint64_t *place;
    size_t count, room;
    uint64_t last; /* of the last that counts */
    int parts;
    share part[PBS_PARTS];
    /* the sort, and what comes of it */
    uint64_t *from, *to, *spare;
    size_t n;
    uint32_t *digits;
    int shift, bits;
    uint32_t *order;
    float *spacing;
} harvest;

/* The surfel at a slot that holds d < 0. The first was chosen without a distance, and others may
 * have been chosen at an infinite one. */
static uint64_t place_at(const harvest *h, size_t slot) {
    if (slot == h->first) return 0;
    return place_of(-h->t->leaf[slot / PBS_LEAF].d[slot % PBS_LEAF], h->t->id[slot]);
}

/* Moves the k smallest to the front, the largest of them last (Hoare's partition). 0 < k <= n */
static void select_smallest(uint64_t *v, size_t n, size_t k) {
    size_t low = 0, high = n - 1;
    while (low < high) {
        uint64_t pivot = v[low + (high - low) / 2];
        size_t i = low, j = high;
        for (;; i++, j--) {
            while (v[i] < pivot) i++;
            while (v[j] > pivot) j--;
            if (i >= j) break;
            uint64_t x = v[i];
            v[i] = v[j], v[j] = x;
        }
        if (k - 1 <= j)
            high = j;
        else
            low = j + 1;
    }
}

/* ---- sorting ---- */

static pbs_code count_digits(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    const harvest *h = ctx;
    uint32_t *count = h->digits + (i << h->bits), mask = (1u << h->bits) - 1;
    memset(count, 0, sizeof *count << h->bits);
    size_t end = pbs_part_end(h->n, h->parts, i);
    for (size_t j = pbs_part_begin(h->n, h->parts, i); j < end; j++)
        count[h->from[j] >> h->shift & mask]++;
    return PBS_OK;
}

static pbs_code scatter(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    const harvest *h = ctx;
    uint32_t *at = h->digits + (i << h->bits), mask = (1u << h->bits) - 1;
    uint64_t *from = h->from, *to = h->to;
    size_t end = pbs_part_end(h->n, h->parts, i);
    for (size_t j = pbs_part_begin(h->n, h->parts, i); j < end; j++)
        to[at[from[j] >> h->shift & mask]++] = from[j];
    return PBS_OK;
}

/* Turns counts into places; false: all have the same digit. */
static bool add_up(harvest *h) {
    uint32_t sum = 0;
    for (size_t d = 0; d < (size_t)1 << h->bits; d++) {
        uint32_t before = sum;
        for (size_t i = 0; i < (size_t)h->parts; i++) {
            uint32_t c = h->digits[(i << h->bits) + d];
            h->digits[(i << h->bits) + d] = sum;
            sum += c;
        }
        if (sum - before == h->n) return false;
    }
    return true;
}

/* Radix sort of the first n places; the result is in h->from. */
static pbs_code sort_places(pbs_run *run, harvest *h, size_t n, pbs_err *err) {
    h->from = h->place;
    h->to = h->spare;
    h->n = n;
    h->bits = n < FEW ? SMALL_DIGIT : DIGIT;
    h->parts = pbs_parts(run, n, SORT_PART);
    for (h->shift = 0; h->shift < 64 && n > 1; h->shift += h->bits) {
        pbs_code rc = pbs_parallel(run, (size_t)h->parts, count_digits, h, err);
        if (rc) return rc;
        if (!add_up(h)) continue;
        if ((rc = pbs_parallel(run, (size_t)h->parts, scatter, h, err))) return rc;
        uint64_t *t = h->from;
        h->from = h->to, h->to = t;
    }
    return PBS_OK;
}

static pbs_code write_out(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    const harvest *h = ctx;
    size_t end = pbs_part_end(h->n, h->parts, i);
    for (size_t j = pbs_part_begin(h->n, h->parts, i); j < end; j++) {
        h->order[j] = j ? (uint32_t)h->from[j] : h->t->id[h->first];
        h->spacing[j] = pbs_metric_length(&h->t->metric, j ? place_d(h->from[j]) : INFINITY);
    }
    return PBS_OK;
}

/* ---- collecting ---- */

static void add(harvest *h, uint64_t place) {
    if (h->count == h->room) {
        select_smallest(h->place, h->count, h->wanted + 1);
        h->count = h->wanted + 1;
    }
    h->place[h->count++] = place;
}

/* Bit k: point k of a leaf is a surfel. */
static uint32_t surfels_in(const pbs_leaf *l) {
    uint32_t m = 0;
    for (int k = 0; k < PBS_LEAF; k += 8) m |= f8_less(f8_at(l->d + k), f8_all(0)) << k;
    return m;
}

static uint32_t zeros_in(const pbs_leaf *l) {
    uint32_t m = 0;
    for (int k = 0; k < PBS_LEAF; k += 8) m |= f8_equal(f8_at(l->d + k), f8_all(0)) << k;
    return m;
}

static pbs_code count_part(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    harvest *h = ctx;
    const pbs_tree *t = h->t;
    share s = {0, 0};
    size_t end = pbs_part_end(t->leaves, h->parts, i);
    for (size_t leaf = pbs_part_begin(t->leaves, h->parts, i); leaf < end; leaf++) {
        s.surfels += (size_t)__builtin_popcount(surfels_in(&t->leaf[leaf]));
        s.zero += (size_t)__builtin_popcount(zeros_in(&t->leaf[leaf]));
    }
    h->part[i] = s;
    return PBS_OK;
}

static pbs_code collect_part(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    harvest *h = ctx;
    const pbs_tree *t = h->t;
    uint64_t *out = h->place + h->part[i].surfels;
    size_t end = pbs_part_end(t->leaves, h->parts, i);
    for (size_t leaf = pbs_part_begin(t->leaves, h->parts, i); leaf < end; leaf++)
        for (uint32_t m = surfels_in(&t->leaf[leaf]); m; m &= m - 1)
            *out++ = place_at(h, leaf * PBS_LEAF + (unsigned)__builtin_ctz(m));
    return PBS_OK;
}

/* All surfels, or at least the wanted and one more; *zero: how many others are at distance 0. */
static pbs_code collect(pbs_run *run, harvest *h, size_t *zero, pbs_err *err) {
    const pbs_tree *t = h->t;
    size_t all = 0;
    h->parts = pbs_parts(run, t->leaves, LEAF_PART);
    pbs_code rc = pbs_parallel(run, (size_t)h->parts, count_part, h, err);
    if (rc) return rc;
    *zero = 0;
    for (int i = 0; i < h->parts; i++) {
        size_t here = h->part[i].surfels;
        h->part[i].surfels = all;
        all += here;
        *zero += h->part[i].zero;
    }
    *zero -= t->leaves * PBS_LEAF - t->points; /* what fills the last leaf is at 0 too */
    if (all <= h->room) {
        h->count = all;
        return pbs_parallel(run, (size_t)h->parts, collect_part, h, err);
    }
    for (size_t leaf = 0; leaf < t->leaves; leaf++)
        for (uint32_t m = surfels_in(&t->leaf[leaf]); m; m &= m - 1)
            add(h, place_at(h, leaf * PBS_LEAF + (unsigned)__builtin_ctz(m)));
    return PBS_OK;
}

/* Calls see for every point at D = 0 from `at`, until it says true. */
static bool any_at(const harvest *h, const pbs_place *at, int level, size_t fan,
                   bool (*see)(const harvest *h, size_t slot, size_t *count), size_t *count) {
    const pbs_tree *t = h->t;
    for (unsigned m = fan_around(&t->fan[level][fan], at->p); m; m &= m - 1) {
        size_t child = fan * PBS_FAN + (unsigned)__builtin_ctz(m);
        if (level) {
            if (any_at(h, at, level - 1, child, see, count)) return true;
            continue;
        }
        for (size_t slot = child * PBS_LEAF; slot < (child + 1) * PBS_LEAF; slot++) {
            probe x;
            if (slot >= t->points) break;
            probe_set(&x, t, slot);
            if (pbs_metric_d2(&t->metric, &x.at, at) == 0 && see(h, slot, count)) return true;
        }
    }
    return false;
}

static bool is_result(const harvest *h, size_t slot, size_t *count) {
    (void)count;
    return h->t->leaf[slot / PBS_LEAF].d[slot % PBS_LEAF] < 0 && place_at(h, slot) <= h->last;
}

/* A point that is at distance 0 only because of surfels beyond the wanted. */
static bool is_freed(const harvest *h, size_t slot, size_t *count) {
    float *d = &h->t->leaf[slot / PBS_LEAF].d[slot % PBS_LEAF];
    probe x;
    probe_set(&x, h->t, slot);
    if (*d != 0 || any_at(h, &x.at, h->t->levels - 1, 0, is_result, NULL)) return false;
    *d = 1;
    ++*count;
    return false;
}

/* How many points are at distance 0 from the surfels beyond the wanted, and from no others. */
static size_t count_freed(harvest *h) {
    const pbs_tree *t = h->t;
    size_t count = 0;
    h->last = 0;
    for (size_t i = 0; i < h->wanted; i++) h->last = h->place[i] > h->last ? h->place[i] : h->last;
    for (size_t leaf = 0; leaf < t->leaves; leaf++)
        for (uint32_t m = surfels_in(&t->leaf[leaf]); m; m &= m - 1) {
            size_t slot = leaf * PBS_LEAF + (unsigned)__builtin_ctz(m);
            probe x;
            if (place_at(h, slot) <= h->last) continue;
            probe_set(&x, t, slot);
            any_at(h, &x.at, t->levels - 1, 0, is_freed, &count);
        }
    return count;
}

static size_t room_for(size_t candidates, size_t wanted) {
    return candidates / 2 < wanted + 1 ? candidates : 2 * (wanted + 1);
}

static void layout(harvest *h, size_t candidates, pbs_layout *scratch) {
    int bits = h->wanted < FEW ? SMALL_DIGIT : DIGIT;
    size_t digits = (size_t)pbs_parts_most(h->wanted, SORT_PART) << bits;
    h->room = room_for(candidates, h->wanted);
    h->place = pbs_layout_take(scratch, h->room * sizeof *h->place);
    h->spare = pbs_layout_take(scratch, h->wanted * sizeof *h->spare);
    h->digits = pbs_layout_take(scratch, digits * sizeof *h->digits);
}

void PBS_GREEDY_NAME(pbs_greedy_result_layout)(size_t candidates, size_t wanted,
                                               pbs_layout *scratch) {
    harvest h = {.wanted = wanted};
    layout(&h, candidates, scratch);
}

pbs_code PBS_GREEDY_NAME(pbs_greedy_result)(pbs_run *run, pbs_tree *t, size_t first, size_t wanted,
                                            pbs_layout *scratch, uint32_t *order, float *spacing,
                                            pbs_sample_result *result, pbs_err *err) {
    harvest h = {.t = t, .first = first, .wanted = wanted, .order = order, .spacing = spacing};
    layout(&h, t->points, scratch);
    pbs_code rc = collect(run, &h, &result->duplicates, err);
    if (rc) return rc;
    size_t n = h.count < wanted ? h.count : wanted;
    float covering = fan_most(&t->fan[t->levels - 1][0]);
    if (h.count > wanted) {
        select_smallest(h.place, h.count, wanted + 1);
        covering = place_d(h.place[wanted]);
        if (result->duplicates) result->duplicates -= count_freed(&h);
    }
    rc = sort_places(run, &h, n, err);
    if (!rc) rc = pbs_parallel(run, (size_t)h.parts, write_out, &h, err);
    if (rc) return rc;
    result->covering = pbs_metric_length(&t->metric, covering);
    result->count = n;
    return PBS_OK;
}
