/* Reads the greedy permutation off a tree in which the surfels are marked. */
#include "libcore/greedy.h"
#include "libcore/greedy_inner.h"

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

typedef struct harvest {
    pbs_tree *t;
    size_t first, wanted;
    uint64_t *place;
    size_t count, room;
    uint64_t last; /* of the last that counts */
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

enum { DIGIT = 11, PASSES = 6 };

static void sort_places(uint64_t *v, uint64_t *tmp, size_t n) {
    uint64_t *from = v, *to = tmp;
    for (int pass = 0; pass < PASSES; pass++) {
        int shift = pass * DIGIT;
        size_t at[1 << DIGIT] = {0}, sum = 0;
        for (size_t i = 0; i < n; i++) at[from[i] >> shift & ((1 << DIGIT) - 1)]++;
        if (n && at[from[0] >> shift & ((1 << DIGIT) - 1)] == n) continue;
        for (int d = 0; d < 1 << DIGIT; d++) {
            size_t c = at[d];
            at[d] = sum, sum += c;
        }
        for (size_t i = 0; i < n; i++) to[at[from[i] >> shift & ((1 << DIGIT) - 1)]++] = from[i];
        uint64_t *x = from;
        from = to, to = x;
    }
    if (from != v) memcpy(v, from, n * sizeof *v);
}

static void add(harvest *h, uint64_t place) {
    if (h->count == h->room) {
        select_smallest(h->place, h->count, h->wanted + 1);
        h->count = h->wanted + 1;
    }
    h->place[h->count++] = place;
}

/* Whether all d of a leaf are above 0, as most are: their bits, as integers, are too. */
static bool nothing_in(const pbs_leaf *l) {
    int32_t bits[PBS_LEAF], any = 0;
    memcpy(bits, l->d, sizeof bits);
    for (int k = 0; k < PBS_LEAF; k++) any |= bits[k] - 1;
    return any >= 0;
}

/* All surfels, or at least the wanted and one more; and how many others are at distance 0. */
static size_t collect(harvest *h) {
    const pbs_tree *t = h->t;
    size_t zero = 0;
    for (size_t leaf = 0; leaf < t->leaves; leaf++) {
        if (nothing_in(&t->leaf[leaf])) continue;
        for (size_t k = 0; k < PBS_LEAF; k++) {
            float d = t->leaf[leaf].d[k];
            zero += d == 0;
            if (d < 0) add(h, place_at(h, leaf * PBS_LEAF + k));
        }
    }
    return zero - (t->leaves * PBS_LEAF - t->points); /* what fills the last leaf is at 0 too */
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
static size_t count_freed(const harvest *h) {
    const pbs_tree *t = h->t;
    size_t count = 0;
    for (size_t slot = 0; slot < t->points; slot++) {
        probe x;
        if (t->leaf[slot / PBS_LEAF].d[slot % PBS_LEAF] >= 0 || place_at(h, slot) <= h->last)
            continue;
        probe_set(&x, t, slot);
        any_at(h, &x.at, t->levels - 1, 0, is_freed, &count);
    }
    return count;
}

static size_t room_for(size_t candidates, size_t wanted) {
    return candidates / 2 < wanted + 1 ? candidates : 2 * (wanted + 1);
}

void pbs_greedy_result_layout(size_t candidates, size_t wanted, pbs_layout *scratch) {
    pbs_layout_take(scratch, room_for(candidates, wanted) * sizeof(uint64_t));
    pbs_layout_take(scratch, wanted * sizeof(uint64_t));
}

void pbs_greedy_result(pbs_tree *t, size_t first, size_t wanted, pbs_layout *scratch,
                       uint32_t *order, float *spacing, pbs_sample_result *result) {
    harvest h = {.t = t, .first = first, .wanted = wanted};
    h.room = room_for(t->points, wanted);
    h.place = pbs_layout_take(scratch, h.room * sizeof *h.place);
    uint64_t *tmp = pbs_layout_take(scratch, wanted * sizeof *tmp);
    result->duplicates = collect(&h);
    size_t n = h.count < wanted ? h.count : wanted;
    float covering = fan_most(&t->fan[t->levels - 1][0]);
    if (h.count > wanted) {
        select_smallest(h.place, h.count, wanted + 1);
        covering = place_d(h.place[wanted]);
        select_smallest(h.place, wanted, wanted);
        h.last = h.place[wanted - 1];
        if (result->duplicates) result->duplicates -= count_freed(&h);
    }
    sort_places(h.place, tmp, n);
    for (size_t i = 0; i < n; i++) {
        order[i] = i ? (uint32_t)h.place[i] : t->id[first];
        spacing[i] = pbs_metric_length(&t->metric, i ? place_d(h.place[i]) : INFINITY);
    }
    result->covering = pbs_metric_length(&t->metric, covering);
    result->count = n;
}
