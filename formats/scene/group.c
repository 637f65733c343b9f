/* group.c: loose octree over the boxes of an assembly's children: paper 1, sections 3.1, 3.4. */
#include "formats/scene/group.h"
#include <stdlib.h>

/* A cell of at most so many children, or below so many triangles, is no group of its own. */
enum { FEW_CHILDREN = 8, FEW_TRIANGLES = 1000, STOP_TRIANGLES = 4000 };
/* Cells below this depth are smaller than what a double tells apart. */
enum { DEPTH_MAX = 64 };

typedef struct cell {
    double min[3], side;
    int depth;
} cell;

typedef struct grouper {
    pbs_run *run;
    const pbs_grouping *g;
    uint32_t *order, *sorted; /* the items, cell after cell; and room to sort them */
    uint32_t *ref;            /* what the open cells hold so far, one after the other */
    size_t refs, refs_room;
    uint32_t groups;
} grouper;

static pbs_code push(grouper *p, uint32_t ref, pbs_err *err) {
    pbs_code rc = pbs_grow(p->run, &p->ref, &p->refs_room, p->refs + 1, sizeof *p->ref,
                           "groups of children", err);
    if (!rc) p->ref[p->refs++] = ref;
    return rc;
}

static double centre(const pbs_box *b, int k) {
    return b->min[k] / 2 + b->max[k] / 2;
}

static double extent(const pbs_box *b) {
    return fmax(fmax(b->max[0] - b->min[0], b->max[1] - b->min[1]), b->max[2] - b->min[2]);
}

static bool stays_on_top(const pbs_group_item *item) {
    const pbs_box *b = &item->box;
    if (item->apart || pbs_box_is_empty(b)) return true;
    return !isfinite(extent(b)) || !isfinite(b->min[0] + b->min[1] + b->min[2]);
}

static uint64_t triangles_of(const grouper *p, size_t first, size_t end) {
    uint64_t n = 0;
    for (size_t i = first; i < end; i++)
        if (__builtin_add_overflow(n, p->g->item[p->order[i]].triangles, &n)) return UINT64_MAX;
    return n;
}

static int compare(const void *a, const void *b) {
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

/* What was pushed since `base` becomes a group, which takes its place. */
static pbs_code close_group(grouper *p, size_t base, pbs_err *err) {
    if (p->refs - base < 2) return PBS_OK;
    qsort(p->ref + base, p->refs - base, sizeof *p->ref, compare);
    pbs_code rc = p->g->make(p->g->ctx, p->ref + base, p->refs - base, err);
    p->refs = base;
    return rc ? rc : push(p, p->g->count + p->groups++, err);
}

/* Sorts items first .. end by the cell below that they belong to, in their order, those that stay
 * in front; at[i] .. at[i + 1] is then cell i - 1, and at[0] .. at[1] what stays. */
static void distribute(grouper *p, size_t first, size_t end, const cell *c, size_t at[10]) {
    size_t count[10] = {0};
    double half = c->side / 2;
    for (size_t i = first; i < end; i++) {
        const pbs_box *b = &p->g->item[p->order[i]].box;
        uint32_t to = 0;
        if (extent(b) <= half) {
            for (int k = 0; k < 3; k++) to |= (uint32_t)(centre(b, k) - c->min[k] >= half) << k;
            to++;
        }
        count[to + 1]++;
        p->sorted[i] = to;
    }
    at[0] = first;
    for (int i = 1; i < 10; i++) count[i] += i > 1 ? count[i - 1] : 0, at[i] = first + count[i];
    size_t next[9];
    memcpy(next, at, sizeof next);
    uint32_t *moved = p->sorted + p->g->count;
    for (size_t i = first; i < end; i++) moved[next[p->sorted[i]]++] = p->order[i];
    memcpy(p->order + first, moved + first, (end - first) * sizeof *moved);
}

static pbs_code divide(grouper *p, size_t first, size_t end, cell c, pbs_err *err);

static pbs_code divide_below(grouper *p, const size_t at[10], const cell *c, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (int i = 0; i < 8 && !rc; i++) {
        size_t first = at[i + 1], end = at[i + 2], base = p->refs;
        if (first == end) continue;
        cell below = {.side = c->side / 2, .depth = c->depth + 1};
        for (int k = 0; k < 3; k++) below.min[k] = c->min[k] + (i >> k & 1 ? below.side : 0);
        rc = divide(p, first, end, below, err);
        bool few = end - first <= FEW_CHILDREN || triangles_of(p, first, end) < FEW_TRIANGLES;
        if (!rc && !few) rc = close_group(p, base, err);
    }
    return rc;
}

/* Pushes what the cell holds. */
static pbs_code divide(grouper *p, size_t first, size_t end, cell c, pbs_err *err) {
    size_t at[10];
    bool stop = end - first <= p->g->limit || c.depth >= DEPTH_MAX ||
                triangles_of(p, first, end) < STOP_TRIANGLES;
    pbs_code rc = pbs_run_check(p->run, err);
    if (!stop) distribute(p, first, end, &c, at);
    size_t own = stop ? end : at[1];
    for (size_t i = first; i < own && !rc; i++) rc = push(p, p->order[i], err);
    return rc || stop ? rc : divide_below(p, at, &c, err);
}

/* A cube around all boxes. */
static cell root_cell(const grouper *p, size_t n) {
    pbs_box box = PBS_BOX_EMPTY;
    for (size_t i = 0; i < n; i++) {
        const pbs_box *b = &p->g->item[p->order[i]].box;
        pbs_box_add(&box, b->min);
        pbs_box_add(&box, b->max);
    }
    cell c = {.side = extent(&box)};
    memcpy(c.min, box.min, sizeof c.min);
    return c;
}

static pbs_code group_all(grouper *p, pbs_err *err) {
    const pbs_grouping *g = p->g;
    size_t n = 0;
    pbs_code rc = PBS_OK;
    for (uint32_t i = 0; i < g->count && !rc; i++) {
        if (stays_on_top(&g->item[i]))
            rc = push(p, i, err);
        else
            p->order[n++] = i;
    }
    if (!rc && n) rc = divide(p, 0, n, root_cell(p, n), err);
    if (!rc && p->refs) qsort(p->ref, p->refs, sizeof *p->ref, compare);
    return rc;
}

pbs_code pbs_group(pbs_run *run, const pbs_grouping *g, uint32_t **top, size_t *n, pbs_err *err) {
    grouper p = {.run = run, .g = g};
    const char *what = "groups of children";
    pbs_code rc = pbs_alloc(run, &p.order, g->count, sizeof *p.order, what, err);
    if (!rc) rc = pbs_alloc(run, &p.sorted, g->count, 2 * sizeof *p.sorted, what, err);
    if (!rc) rc = group_all(&p, err);
    pbs_free(run, p.order);
    pbs_free(run, p.sorted);
    if (rc) pbs_free(run, p.ref);
    *top = rc ? NULL : p.ref;
    *n = rc ? 0 : p.refs;
    return rc;
}
