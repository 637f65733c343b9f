/* The exact greedy permutation: the farthest candidate next, ties to the lower index.
 *
 * The first surfels, each of which changes a large part of the candidates, are taken one by one
 * (`take_first`): every fan of 256 points keeps the surfels that may concern it waiting until its
 * maximum is asked for, so that its points are loaded once for several of them.
 *
 * The others are taken in sweeps along the curve (`sweep`): all that have d >= bound, in any
 * order. A candidate p is chosen at once if no candidate x that comes before it (larger d, or
 * equal and lower index) has D(x, p)^2 < d(x). Otherwise the same is asked of that x, and so on:
 * values rise, so it ends. This gives the same surfels with the same values as one by one:
 * values only fall, so whatever is chosen before p in the true order comes before p now; it cannot
 * lower d(p), which would take D^2 < d(p) <= d(x); and p cannot lower it. The metric only has to
 * be symmetric.
 *
 * Threads take ranges of the curve. A candidate whose ball may reach outside the range is left to
 * a second round with other borders, and then to one thread. What is chosen with d >= bound does
 * not depend on the order, so it does not depend on the ranges either.
 *
 * This file is compiled a second time for AVX2, by greedy_avx2.c. */
#include "libcore/surfels/greedy.h"
#include "libcore/surfels/greedy_inner.h"
#include "libcore/ground/pipe.h"
#include <pthread.h>

#ifndef PBS_GREEDY_NAME
#define PBS_GREEDY_NAME(name) name
#endif

enum {
    PART = 16,    /* fans that are worth a thread */
    WAIT = 15,    /* surfels that wait at a fan */
    WAITS = 2048, /* that are worth the start of some threads */
    BALL = 2048,  /* one by one until a ball holds about so many points */
    BLOCKS = 512, /* of a worker's neighbour lists */
    LONGEST = 64, /* blocks of one list */
    SECOND = 16,  /* leaves left over that are worth a thread again */
    QUEUE = 4096  /* leaves that one candidate's ball may touch, in parallel rounds */
};

typedef struct waiting {
    uint32_t count, surfel[WAIT];
} waiting;

/* Eight neighbours of a fan: their boxes, with what the maxima were when the list was made. */
typedef struct block {
    pbs_fan box;
    uint32_t fan[PBS_FAN];
} block;

enum { NO_LIST = UINT32_MAX };
typedef struct list {
    uint64_t epoch;         /* valid if it is its worker's */
    uint32_t begin, blocks; /* NO_LIST: too long */
} list;

typedef struct worker {
    struct pbs_greedy *g;
    size_t begin, end; /* of the fans: those of them that it owns are its own */
    uint8_t number;
    bool alone; /* nobody else works, and the queue has room for everything: all are its own */
    size_t made;
    uint64_t epoch;
    uint32_t used; /* blocks */
    block *block;
    uint32_t *queue; /* leaves in reach of the candidate in question */
    size_t queued, room;
    uint32_t rival[QUEUE + PBS_FAN]; /* those of them that may hold one that comes before it */
    size_t rivals;
} worker;

struct pbs_greedy {
    pbs_run *run;
    pbs_tree *t;
    size_t wanted, made;
    /* one by one */
    uint64_t *key[PBS_LEVELS]; /* of each fan's best point: d's bits << 32 | ~index; 0: none left.
                                  Not below the truth while surfels wait */
    waiting *wait;
    probe *surfel;
    size_t surfels; /* room in it */
    size_t waits;   /* how often something began to wait since the last flush_all */
    /* sweeps */
    float bound;
    int parts;
    uint64_t epochs;
    list *list;
    uint8_t *owner; /* of each fan: the number of its worker */
    worker *worker;
};

static size_t fans_padded(const pbs_tree *t, int level) {
    return (t->fans[level] + PBS_FAN - 1) / PBS_FAN * PBS_FAN;
}

/* For every leaf, and for what reach() wants to be free. */
static size_t room_alone(const pbs_tree *t) {
    return t->fans[0] * PBS_FAN + PBS_FAN * PBS_FAN + QUEUE;
}

static void layout(pbs_greedy *g, const pbs_tree *t, size_t candidates, pbs_layout *l) {
    size_t fans = t->fans[0];
    for (int k = 0; k < t->levels; k++)
        g->key[k] = pbs_layout_take(l, fans_padded(t, k) * sizeof *g->key[k]);
    g->wait = pbs_layout_take(l, fans * sizeof *g->wait);
    g->surfels = candidates / BALL + 1;
    g->surfel = pbs_layout_take(l, g->surfels * sizeof *g->surfel);
    g->list = pbs_layout_take(l, fans * sizeof *g->list);
    int parts = pbs_parts_most(fans, PART);
    g->owner = pbs_layout_take(l, fans);
    g->worker = pbs_layout_take(l, (size_t)parts * sizeof *g->worker);
    size_t alone = room_alone(t);
    for (int i = 0; i < parts; i++) {
        /* The first is also the one that works alone. */
        size_t room = i ? QUEUE : alone;
        void *queue = pbs_layout_take(l, room * sizeof(uint32_t));
        void *blocks = pbs_layout_take(l, BLOCKS * sizeof(block));
        if (l->base) g->worker[i].queue = queue, g->worker[i].block = blocks;
    }
}

/* ---- one by one ---- */

static uint64_t key_of(float d, uint32_t id) {
    uint32_t bits;
    memcpy(&bits, &d, 4);
    return (uint64_t)bits << 32 | (uint32_t)~id;
}

static float key_value(uint64_t key) {
    uint32_t bits = (uint32_t)(key >> 32);
    float d;
    memcpy(&d, &bits, 4);
    return d;
}

static uint64_t fan_key(const pbs_tree *t, size_t fan) {
    const pbs_fan *f = &t->fan[0][fan];
    float most = fan_most(f);
    uint64_t best = 0;
    if (most == 0) return 0;
    for (unsigned m = fan_at_least(f, most); m; m &= m - 1) {
        size_t slot = leaf_first(t, fan * PBS_FAN + (unsigned)__builtin_ctz(m), most);
        uint64_t key = key_of(most, t->id[slot]);
        if (key > best) best = key;
    }
    return best;
}

static void flush(pbs_greedy *g, size_t fan) {
    pbs_tree *t = g->t;
    waiting *w = &g->wait[fan];
    for (size_t i = 0; i < PBS_FAN_POINTS; i += 16)
        __builtin_prefetch(&t->id[fan * PBS_FAN_POINTS + i]);
    for (uint32_t i = 0; i < w->count; i++)
        for (unsigned m = fan_near(&t->fan[0][fan], g->surfel[w->surfel[i]].at.p); m; m &= m - 1)
            leaf_prefetch(t, fan * PBS_FAN + (unsigned)__builtin_ctz(m));
    for (uint32_t i = 0; i < w->count; i++) {
        const probe *p = &g->surfel[w->surfel[i]];
        for (unsigned m = fan_near(&t->fan[0][fan], p->at.p); m; m &= m - 1)
            leaf_touch(t, fan * PBS_FAN + (unsigned)__builtin_ctz(m), p);
    }
    w->count = 0;
    g->key[0][fan] = fan_key(t, fan);
}

/* The key and the maximum of a fan above follow from its children. */
static bool follow(pbs_greedy *g, int level, size_t fan) {
    const uint64_t *child = g->key[level - 1] + fan * PBS_FAN;
    pbs_fan *f = &g->t->fan[level][fan];
    uint64_t best = 0;
    for (int c = 0; c < PBS_FAN; c++) {
        f->max[c] = key_value(child[c]);
        if (child[c] > best) best = child[c];
    }
    bool same = best == g->key[level][fan];
    g->key[level][fan] = best;
    return !same;
}

static void flush_and_tell(pbs_greedy *g, size_t fan) {
    flush(g, fan);
    for (int level = 1; level < g->t->levels; level++)
        if (!follow(g, level, fan /= PBS_FAN)) break;
}

static pbs_code flush_part(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    pbs_greedy *g = ctx;
    size_t n = g->t->fans[0], each = n / (size_t)g->parts, begin = i * each;
    size_t end = (int)i + 1 == g->parts ? n : begin + each;
    for (size_t f = begin; f < end; f++)
        if (g->wait[f].count) flush(g, f);
    return PBS_OK;
}

static pbs_code flush_all(pbs_greedy *g, pbs_err *err) {
    pbs_code rc = pbs_parallel(g->run, (size_t)g->parts, flush_part, g, err);
    g->waits = 0;
    for (int level = 1; level < g->t->levels; level++)
        for (size_t f = 0; f < g->t->fans[level]; f++) follow(g, level, f);
    return rc;
}

/* Lets a surfel wait at every fan below that it may concern. */
static void announce(pbs_greedy *g, int level, size_t fan, uint32_t surfel) {
    if (level == 0) {
        waiting *w = &g->wait[fan];
        if (w->count == WAIT) flush_and_tell(g, fan);
        w->surfel[w->count++] = surfel;
        g->waits++;
        return;
    }
    for (unsigned m = fan_near(&g->t->fan[level][fan], g->surfel[surfel].at.p); m; m &= m - 1)
        announce(g, level - 1, fan * PBS_FAN + (unsigned)__builtin_ctz(m), surfel);
}

static void choose(pbs_greedy *g, size_t slot) {
    float *d = &g->t->leaf[slot / PBS_LEAF].d[slot % PBS_LEAF];
    probe_set(&g->surfel[g->made], g->t, slot);
    *d = -*d;
    announce(g, g->t->levels - 1, 0, (uint32_t)g->made++);
}

/* The slot of the largest key, after flushing whatever stands in the way; false: none is left. */
static bool farthest(pbs_greedy *g, size_t *slot) {
    const pbs_tree *t = g->t;
    for (;;) {
        int top = t->levels - 1;
        uint64_t key = g->key[top][0];
        if (!key) return false;
        size_t fan = 0;
        for (int level = top - 1; level >= 0; level--) {
            fan *= PBS_FAN;
            while (g->key[level][fan] != key) fan++;
        }
        if (!g->wait[fan].count) {
            const uint32_t *id = t->id + fan * PBS_FAN_POINTS;
            size_t i = 0;
            while (id[i] != (uint32_t)~key) i++;
            *slot = fan * PBS_FAN_POINTS + i;
            return true;
        }
        flush_and_tell(g, fan);
    }
}

static float d_of(const pbs_tree *t, size_t slot) {
    return t->leaf[slot / PBS_LEAF].d[slot % PBS_LEAF];
}

static pbs_code take_first(pbs_greedy *g, size_t first, pbs_err *err) {
    size_t wanted = g->wanted < g->surfels ? g->wanted : g->surfels, slot = first;
    for (int k = 0; k < g->t->levels; k++)
        memset(g->key[k], 0, fans_padded(g->t, k) * sizeof *g->key[k]);
    for (size_t f = 0; f < g->t->fans[0]; f++) g->wait[f].count = 0;
    choose(g, slot);
    pbs_code rc = flush_all(g, err);
    while (!rc && g->made < wanted && farthest(g, &slot) && d_of(g->t, slot) > g->t->enough) {
        choose(g, slot);
        if (g->waits > WAITS) rc = flush_all(g, err);
        if (!rc && g->made % 64 == 0) rc = pbs_run_check(g->run, err);
    }
    return rc ? rc : flush_all(g, err);
}

static void take_below(pbs_tree *t, int level, size_t fan, const probe *p) {
    pbs_fan *f = &t->fan[level][fan];
    for (unsigned m = fan_near(f, p->at.p); m; m &= m - 1) {
        unsigned c = (unsigned)__builtin_ctz(m);
        size_t child = fan * PBS_FAN + c;
        if (level == 0) {
            leaf_touch(t, child, p);
            continue;
        }
        take_below(t, level - 1, child, p);
        f->max[c] = fan_most(&t->fan[level - 1][child]);
    }
}

float PBS_GREEDY_NAME(pbs_greedy_take)(pbs_tree *t, size_t slot) {
    probe p;
    probe_set(&p, t, slot);
    if (!(p.d > 0)) return 0;
    t->leaf[slot / PBS_LEAF].d[slot % PBS_LEAF] = -p.d;
    take_below(t, t->levels - 1, 0, &p);
    return p.d;
}

/* ---- sweeps ---- */

/* Puts the fans near a box into w's blocks, from w->used on. */
static bool find_neighbours(worker *w, int level, size_t fan, const float low[3],
                            const float high[3], uint32_t *count) {
    const pbs_tree *t = w->g->t;
    const pbs_fan *f = &t->fan[level][fan];
    for (unsigned m = fan_near_box(f, low, high); m; m &= m - 1) {
        unsigned c = (unsigned)__builtin_ctz(m);
        size_t child = fan * PBS_FAN + c;
        if (level > 1) {
            if (!find_neighbours(w, level - 1, child, low, high, count)) return false;
            continue;
        }
        if (*count == LONGEST * PBS_FAN) return false;
        block *b = &w->block[w->used + *count / PBS_FAN];
        unsigned at = (*count)++ % PBS_FAN;
        for (int k = 0; k < 3; k++)
            b->box.low[k][at] = f->low[k][c], b->box.high[k][at] = f->high[k][c];
        b->box.max[at] = f->max[c];
        b->fan[at] = (uint32_t)child;
    }
    return true;
}

/* Of the one fan that is the whole tree: itself. */
static void only_neighbour(worker *w) {
    block *b = &w->block[w->used];
    for (int k = 0; k < 3; k++) b->box.low[k][0] = -INFINITY, b->box.high[k][0] = INFINITY;
    b->box.max[0] = INFINITY;
    b->fan[0] = 0;
}

/* The fans that a candidate with d >= bound in this fan may reach; made when first asked for. */
static const list *neighbours(worker *w, size_t fan) {
    const pbs_tree *t = w->g->t;
    list *l = &w->g->list[fan];
    if (l->epoch == w->epoch) return l;
    if (w->used + LONGEST > BLOCKS) w->used = 0, w->epoch++;
    float low[3], high[3];
    uint32_t count = 0;
    const pbs_fan *f = &t->fan[0][fan];
    fan_box(f, fan_at_least(f, w->g->bound), low, high);
    *l = (list){w->epoch, w->used, NO_LIST};
    if (t->levels == 1)
        only_neighbour(w), count = 1;
    else if (!find_neighbours(w, t->levels - 1, 0, low, high, &count))
        return l;
    l->blocks = (count + PBS_FAN - 1) / PBS_FAN;
    for (; count % PBS_FAN; count++)
        w->block[w->used + count / PBS_FAN].box.max[count % PBS_FAN] = 0; /* no d is below that */
    w->used += l->blocks;
    return l;
}

static void queue_fan(worker *w, const probe *p, size_t fan) {
    const pbs_fan *f = &w->g->t->fan[0][fan];
    unsigned near = fan_near(f, p->at.p);
    w->queued += mask_append(w->queue + w->queued, near, (uint32_t)(fan * PBS_FAN));
    w->rivals +=
        mask_append(w->rival + w->rivals, near & fan_at_least(f, p->d), (uint32_t)(fan * PBS_FAN));
    if (w->rivals > QUEUE) w->rivals = QUEUE;
}

static void queue_below(worker *w, const probe *p, int level, size_t fan) {
    if (level == 0) {
        queue_fan(w, p, fan);
        return;
    }
    for (unsigned m = fan_near(&w->g->t->fan[level][fan], p->at.p); m; m &= m - 1)
        queue_below(w, p, level - 1, fan * PBS_FAN + (unsigned)__builtin_ctz(m));
}

/* Queues the leaves that p may reach. False: not all of them are this worker's, or too many. */
static bool reach(worker *w, const probe *p) {
    const pbs_tree *t = w->g->t;
    const uint8_t *owner = w->g->owner;
    w->queued = w->rivals = 0;
    const list *l = neighbours(w, p->slot / PBS_FAN_POINTS);
    if (l->blocks == NO_LIST) {
        if (w->alone) queue_below(w, p, t->levels - 1, 0);
        return w->alone;
    }
    for (uint32_t i = 0; i < l->blocks; i++) {
        const block *b = &w->block[l->begin + i];
        if (w->queued + PBS_FAN * (PBS_FAN + 1) > w->room) return false;
        for (unsigned m = fan_near(&b->box, p->at.p); m; m &= m - 1) {
            uint32_t fan = b->fan[__builtin_ctz(m)];
            if (!w->alone && owner[fan] != w->number) return false;
            queue_fan(w, p, fan);
        }
    }
    for (size_t i = 0; i < w->queued; i++) leaf_prefetch(t, w->queue[i]);
    return true;
}

/* The first of those that come before p and that p would lower; p itself if there is none. */
static probe first_rival(const worker *w, const probe *p) {
    const pbs_tree *t = w->g->t;
    probe best = *p;
    if (w->rivals < QUEUE) {
        for (size_t i = 0; i < w->rivals; i++) leaf_rival(t, w->rival[i], p, &best);
    } else /* some may be missing */
        for (size_t i = 0; i < w->queued; i++) leaf_rival(t, w->queue[i], p, &best);
    if (best.slot != p->slot) probe_set(&best, t, best.slot);
    return best;
}

/* Chooses the best point of a leaf, or one that has to come before it. False: not here. */
static bool settle(worker *w, size_t leaf) {
    pbs_tree *t = w->g->t;
    probe p, before;
    probe_set(&p, t, leaf_first(t, leaf, t->fan[0][leaf / PBS_FAN].max[leaf % PBS_FAN]));
    for (;; p = before) {
        if (!reach(w, &p)) return false;
        before = first_rival(w, &p);
        if (before.slot == p.slot) break;
    }
    t->leaf[p.slot / PBS_LEAF].d[p.slot % PBS_LEAF] = -p.d;
    for (size_t i = 0; i < w->queued; i++) leaf_touch(t, w->queue[i], &p);
    w->made++;
    return true;
}

static pbs_code sweep(worker *w, pbs_err *err) {
    const pbs_tree *t = w->g->t;
    for (size_t f = w->begin; f < w->end; f++) {
        if (!w->alone && w->g->owner[f] != w->number) continue;
        unsigned left = 0, m;
        while ((m = fan_at_least(&t->fan[0][f], w->g->bound) & ~left)) {
            unsigned c = (unsigned)__builtin_ctz(m);
            /* The best of the fan has the fewest that have to come before it. */
            for (m &= m - 1; m; m &= m - 1)
                if (t->fan[0][f].max[__builtin_ctz(m)] > t->fan[0][f].max[c])
                    c = (unsigned)__builtin_ctz(m);
            if (!settle(w, f * PBS_FAN + c)) left |= 1u << c;
        }
        pbs_code rc = f % 64 ? PBS_OK : pbs_run_check(w->g->run, err);
        if (rc) return rc;
    }
    return PBS_OK;
}

static pbs_code sweep_part(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread;
    pbs_greedy *g = ctx;
    return sweep(&g->worker[i], err);
}

static void worker_init(pbs_greedy *g, int number, bool alone) {
    worker *w = &g->worker[number];
    w->g = g;
    w->begin = 0, w->end = g->t->fans[0];
    w->number = (uint8_t)number;
    w->alone = alone;
    w->room = alone ? room_alone(g->t) : QUEUE;
    w->made = w->used = 0;
    w->epoch = ++g->epochs << 32;
}

/* How many leaves of a fan have something to choose. */
static size_t leaves_left(const pbs_greedy *g, size_t fan) {
    return (size_t)__builtin_popcount(fan_at_least(&g->t->fan[0][fan], g->bound));
}

/* First round: every worker owns a range of the curve, with about the same number of leaves that
 * have something to choose. */
static void own_ranges(pbs_greedy *g) {
    size_t n = g->t->fans[0], total = 0, sum = 0;
    int last = 0;
    for (size_t f = 0; f < n; f++) total += leaves_left(g, f);
    for (size_t f = 0; f < n; f++) {
        while (last + 1 < g->parts && sum * (size_t)g->parts >= total * (size_t)(last + 1))
            g->worker[last].end = f, g->worker[++last].begin = f;
        sum += leaves_left(g, f);
        g->owner[f] = (uint8_t)last;
    }
    for (; last + 1 < g->parts; last++) g->worker[last + 1].begin = n;
}

enum { SLICES = 256 };

/* Which slice of the box across its longest side a fan is in. */
static int slice_of(const pbs_greedy *g, size_t fan, int axis, float low, float per) {
    const pbs_fan *f = &g->t->fan[0][fan];
    float at = (f->low[axis][0] - low) * per; /* the first child is always there */
    return at > 0 ? at < SLICES - 1 ? (int)at : SLICES - 1 : 0;
}

/* Second round: what the first has left lies along the borders of its ranges. Across the longest
 * side of the box around that, every worker owns a slab. False: it is not worth it. */
static bool own_slabs(pbs_greedy *g) {
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    size_t n = g->t->fans[0], total = 0, left[SLICES] = {0}, sum = 0;
    int axis = 0;
    uint8_t owner[SLICES];
    for (size_t f = 0; f < n; f++) {
        size_t here = leaves_left(g, f);
        total += here;
        for (int k = 0; k < 3 && here; k++) {
            float at = g->t->fan[0][f].low[k][0];
            low[k] = at < low[k] ? at : low[k];
            high[k] = at > high[k] ? at : high[k];
        }
    }
    if (total < (size_t)g->parts * SECOND) return false;
    for (int k = 1; k < 3; k++)
        if (high[k] - low[k] > high[axis] - low[axis]) axis = k;
    float side = high[axis] - low[axis], per = side > 0 ? SLICES / side : 0;
    for (size_t f = 0; f < n; f++) left[slice_of(g, f, axis, low[axis], per)] += leaves_left(g, f);
    for (int i = 0; i < SLICES; i++) {
        owner[i] = (uint8_t)(sum * (size_t)g->parts / total);
        sum += left[i];
        if (owner[i] >= g->parts) owner[i] = (uint8_t)(g->parts - 1);
    }
    for (size_t f = 0; f < n; f++) g->owner[f] = owner[slice_of(g, f, axis, low[axis], per)];
    return true;
}

static pbs_code sweep_round(pbs_greedy *g, pbs_err *err) {
    pbs_code rc = pbs_parallel(g->run, (size_t)g->parts, sweep_part, g, err);
    for (int i = 0; i < g->parts; i++) g->made += g->worker[i].made;
    return rc;
}

/* All that have d >= bound. What is left after two rounds, next to nothing, one thread does. */
static pbs_code sweep_all(pbs_greedy *g, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (int round = 0; round < 2 && g->parts > 1 && !rc; round++) {
        for (int i = 0; i < g->parts; i++) worker_init(g, i, false);
        if (round == 0)
            own_ranges(g);
        else if (!own_slabs(g))
            break;
        rc = sweep_round(g, err);
    }
    if (rc) return rc;
    worker_init(g, 0, true);
    rc = sweep(&g->worker[0], err);
    g->made += g->worker[0].made;
    return rc;
}

/* Brings the maxima of the upper levels up to date; returns the largest d of all. */
static float refresh(pbs_tree *t) {
    for (int level = 1; level < t->levels; level++)
        for (size_t f = 0; f < t->fans[level - 1]; f++)
            t->fan[level][f / PBS_FAN].max[f % PBS_FAN] = fan_most(&t->fan[level - 1][f]);
    return fan_most(&t->fan[t->levels - 1][0]);
}

/* On a surface d is about c / surfels, from which follows where the bound for the wanted number
 * is. It is meant to come out a little too low: one sweep too few costs more than some surfels. */
static float next_bound(const pbs_greedy *g, float top) {
    double to_end = 0.995 * (double)g->made / (double)g->wanted;
    float bound = (float)(top * (to_end > 0.6 ? to_end : 0.6));
    float least = nextafterf(g->t->enough, INFINITY); /* below top, or it would be the end */
    if (bound < least) bound = least;
    return bound > 0 && bound < top ? bound : top;
}

static pbs_code take_rest(pbs_greedy *g, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t f = 0; f < g->t->fans[0]; f++) g->list[f].epoch = 0;
    for (float top = refresh(g->t); !rc && g->made < g->wanted && top > g->t->enough;
         top = refresh(g->t)) {
        g->bound = next_bound(g, top);
        pbs_run_progress(g->run, "sampling", g->made, g->wanted);
        rc = sweep_all(g, err);
    }
    return rc;
}

pbs_code PBS_GREEDY_NAME(pbs_greedy_run)(pbs_run *run, pbs_tree *t, size_t first, size_t wanted,
                                         pbs_layout *scratch, pbs_err *err) {
    pbs_greedy g = {.run = run, .t = t, .wanted = wanted};
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, mask_lanes_fill);
    layout(&g, t, t->points, scratch);
    g.parts = pbs_parts(run, t->fans[0], PART);
    pbs_code rc = take_first(&g, first, err);
    return rc ? rc : take_rest(&g, err);
}

void PBS_GREEDY_NAME(pbs_greedy_layout)(const pbs_tree *t, size_t candidates, pbs_layout *scratch) {
    pbs_greedy g = {0};
    layout(&g, t, candidates, scratch);
}
