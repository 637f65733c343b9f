/* cloudnodes.c: the nodes of a point cloud's archive, and the points of each (cloudpack.h). */
#include "formats/archive/cloudpack.h"
#include <math.h>
#include <string.h>

enum {
    ACROSS = 7, /* a node is 2^7 spacings of its level wide */
    COARSE = 3, /* the largest nodes are two: the first one stops 2^3 spacings before */
    TOP_K = PBS_CLOD_LEVELS - 1,
    OFTEN = 1 << 15 /* a megabyte of points that are left */
};

/* ---- which points are where ---- */

/* The side of the largest nodes with points. */
static int widest(const pbs_cloud_tree *t) {
    int bits = t->points->lattice.bits;
    return bits < PBS_CLOD_SIDE ? bits : PBS_CLOD_SIDE;
}

/* The level that a node of a size has of its own, if it is not the largest or a leaf. */
static int own_level(int bits) {
    return bits - ACROSS;
}

/* Does a cell leave a level to the larger nodes above it? */
static bool goes_up(const pbs_cloud_tree *t, const pbs_clod_cell *c, int k) {
    return c->bits < widest(t) && k >= 0 && k > own_level(c->bits);
}

/* Points of level k of a cell. */
static uint64_t in_level(const pbs_cloud_tree *t, size_t cell, int k) {
    return pbs_clod_of_level(&t->points->cells.cell[cell], k);
}

static uint64_t count_levels(const pbs_cloud_tree *t, const pbs_cloud_node *n) {
    uint64_t count = 0;
    for (size_t i = n->first; i < n->end; i++) {
        const pbs_clod_cell *c = &t->points->cells.cell[i];
        for (int k = n->low; k <= n->high; k++)
            if (n->bits != c->bits || !goes_up(t, c, k)) count += in_level(t, i, k);
    }
    return count;
}

/* Points that were left of a cell count at the level that they got in the end. */
static void count_cells(pbs_cloud_points *p, const pbs_clod_upper *u) {
    for (size_t i = 0; i < p->cells.count; i++) {
        pbs_clod_cell *c = &p->cells.cell[i];
        c->level[pbs_clod_top(c)] = 0;
        for (size_t r = u->first[i]; r < u->first[i + 1]; r++) {
            c->level[u->rest[r].level]++;
            if (r % OFTEN == OFTEN - 1) pbs_trim_now(&p->trim);
        }
    }
}

/* ---- the tree ---- */

static pbs_code add(pbs_run *run, pbs_cloud_tree *t, pbs_cloud_node n, pbs_err *err) {
    pbs_code rc = PBS_OK;
    if (t->count == UINT32_MAX - 1) return pbs_fail(err, PBS_LIMIT, "more than 2^32 nodes");
    rc = pbs_grow(run, &t->node, &t->room, t->count + 1, sizeof *t->node, "the nodes", err);
    if (rc) return rc;
    n.count = count_levels(t, &n);
    t->node[t->count++] = n;
    return PBS_OK;
}

static bool is_leaf(const pbs_cloud_tree *t, const pbs_cloud_node *n) {
    return n->end - n->first == 1 && t->points->cells.cell[n->first].bits == n->bits;
}

/* The levels of a cube's node. */
static void set_levels(const pbs_cloud_tree *t, pbs_cloud_node *n) {
    int most = widest(t), own = own_level(n->bits);
    n->low = 1, n->high = 0; /* none */
    if (is_leaf(t, n))
        n->low = -1, n->high = TOP_K;
    else if (n->bits == most)
        n->low = own + COARSE > 0 ? own + COARSE : 0, n->high = TOP_K;
    else if (n->bits < most && own >= 0)
        n->low = n->high = own;
}

/* The cells of a cube's eighth, from `first` on. */
static size_t end_of(const pbs_cloud_tree *t, const uint32_t origin[3], int bits, size_t first,
                     size_t end) {
    const pbs_clod_cell *cell = t->points->cells.cell;
    while (first < end && cell[first].origin[0] >> bits == origin[0] >> bits &&
           cell[first].origin[1] >> bits == origin[1] >> bits &&
           cell[first].origin[2] >> bits == origin[2] >> bits)
        first++;
    return first;
}

/* A cube with few cells in one corner stands for that corner. */
static pbs_cloud_node shrink(const pbs_cloud_tree *t, pbs_cloud_node n) {
    const pbs_clod_cell *cell = t->points->cells.cell;
    while (n.bits > widest(t)) {
        int bits = n.bits - 1;
        uint32_t origin[3];
        for (int k = 0; k < 3; k++) origin[k] = cell[n.first].origin[k] >> bits << bits;
        if (end_of(t, origin, bits, n.first, n.end) != n.end) break;
        n.bits = (int8_t)bits;
        memcpy(n.origin, origin, sizeof n.origin);
    }
    return n;
}

static pbs_code add_children(pbs_run *run, pbs_cloud_tree *t, size_t at, pbs_err *err) {
    pbs_cloud_node n = t->node[at];
    pbs_code rc = PBS_OK;
    uint32_t child = (uint32_t)t->count;
    int fine = own_level(n.bits) > 0 ? own_level(n.bits) : 0;
    if (is_leaf(t, &n)) return PBS_OK;
    if (n.bits == widest(t) && n.high == TOP_K && n.low > fine) {
        /* the finer half of the largest */
        pbs_cloud_node c = n;
        c.high = n.low - 1, c.low = fine;
        rc = add(run, t, c, err);
    } else
        for (size_t i = n.first; i < n.end && !rc;) {
            pbs_cloud_node c = {.bits = n.bits - 1, .first = i};
            for (int k = 0; k < 3; k++)
                c.origin[k] = t->points->cells.cell[i].origin[k] >> c.bits << c.bits;
            i = c.end = end_of(t, c.origin, c.bits, i, n.end);
            c = shrink(t, c);
            set_levels(t, &c);
            rc = add(run, t, c, err);
        }
    t->node[at].child = child;
    t->node[at].children = (uint32_t)t->count - child;
    return rc;
}

/* Gives back the room that the nodes have beyond what they need. */
static pbs_code fit(pbs_run *run, pbs_cloud_tree *t, pbs_err *err) {
    pbs_cloud_node *exact;
    pbs_code rc = pbs_alloc(run, &exact, t->count, sizeof *exact, "the nodes", err);
    if (rc) return rc;
    memcpy(exact, t->node, t->count * sizeof *exact);
    pbs_free(run, t->node);
    t->node = exact, t->room = t->count;
    return PBS_OK;
}

pbs_code pbs_cloud_tree_new(pbs_run *run, pbs_cloud_points *p, const pbs_clod_upper *u,
                            pbs_cloud_tree *t, pbs_err *err) {
    *t = (pbs_cloud_tree){.points = p, .upper = u};
    pbs_cloud_node root = {.bits = (int8_t)p->lattice.bits, .end = (uint32_t)p->cells.count};
    count_cells(p, u);
    root = shrink(t, root);
    set_levels(t, &root);
    pbs_code rc = add(run, t, root, err);
    for (size_t i = 0; i < t->count && !rc; i++) rc = add_children(run, t, i, err);
    if (!rc) rc = fit(run, t, err);
    if (rc) pbs_cloud_tree_free(run, t);
    return rc;
}

void pbs_cloud_tree_free(pbs_run *run, pbs_cloud_tree *t) {
    pbs_free(run, t->node);
    memset(t, 0, sizeof *t);
}

/* How far points below a node usually are apart: two fifths of them are in levels up to here. */
static double usual_spacing(const pbs_cloud_tree *t, const pbs_cloud_node *n) {
    uint64_t sum = 0, all = 0;
    int k = TOP_K;
    for (size_t i = n->first; i < n->end; i++)
        for (int l = 0; l <= TOP_K; l++) all += in_level(t, i, l);
    for (; k >= 0; k--) {
        for (size_t i = n->first; i < n->end; i++) sum += in_level(t, i, k);
        if (10 * sum >= 4 * all) break;
    }
    return ldexp(t->points->lattice.step, k > 0 ? k : 0);
}

pbs_node pbs_cloud_tree_node(const pbs_cloud_tree *t, size_t i) {
    const pbs_cloud_node *n = &t->node[i];
    const pbs_cloud_lattice *l = &t->points->lattice;
    pbs_node out = {.id = (uint32_t)(t->count - 1 - i),
                    .box = PBS_BOX_EMPTY,
                    .records = n->count,
                    .flags = PBS_NODE_ADDS,
                    .covering = usual_spacing(t, n),
                    .lattice = l->step,
                    .child_count = n->children};
    for (int k = 0; k < 3; k++) out.origin[k] = l->origin[k] + l->step * n->origin[k];
    for (size_t c = n->first; c < n->end; c++) {
        const pbs_clod_cell *cell = &t->points->cells.cell[c];
        double low[3], high[3];
        for (int k = 0; k < 3; k++) {
            low[k] = l->origin[k] + l->step * cell->low[k];
            high[k] = l->origin[k] + l->step * cell->high[k];
        }
        pbs_box_add(&out.box, low);
        pbs_box_add(&out.box, high);
    }
    return out;
}

/* ---- the points of a node ---- */

static uint64_t take_rest(const pbs_cloud_tree *t, size_t cell, int k, pbs_clod_point *out) {
    uint64_t n = 0;
    for (size_t r = t->upper->first[cell]; r < t->upper->first[cell + 1]; r++) {
        const pbs_clod_rest *rest = &t->upper->rest[r];
        if (rest->level != k) continue;
        pbs_clod_point p = {.spacing = pbs_clod_spacing(k), .colour = {255, 255, 255, 255}};
        for (int a = 0; a < 3; a++)
            p.q[a] = (uint16_t)(rest->q[a] - t->points->cells.cell[cell].origin[a]);
        if (t->points->colours) pbs_clod_rest_colour(rest, p.colour);
        out[n++] = p;
    }
    return n;
}

/* The points of level k of a cell, in Morton order, relative to it. */
static pbs_code take_level(const pbs_cloud_tree *t, size_t cell, int k, pbs_clod_point *out,
                           uint64_t *got, pbs_err *err) {
    const pbs_clod_cell *c = &t->points->cells.cell[cell];
    if (k >= pbs_clod_top(c)) {
        *got = take_rest(t, cell, k, out);
        return PBS_OK;
    }
    uint64_t first = 0, n = *got = pbs_clod_of_level(c, k);
    for (int l = TOP_K; l > k; l--) first += c->level[l];
    return pbs_scratch_read(&t->points->raw, pbs_clod_at(c) + first * sizeof *out,
                            (size_t)n * sizeof *out, out, err);
}

static void move(pbs_clod_point *p, uint64_t n, const pbs_clod_cell *c, const pbs_cloud_node *to) {
    uint16_t by[3];
    for (int k = 0; k < 3; k++) by[k] = (uint16_t)(c->origin[k] - to->origin[k]);
    if (!(by[0] | by[1] | by[2])) return;
    for (uint64_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) p[i].q[k] = (uint16_t)(p[i].q[k] + by[k]);
}

/* In the order of ranks with their bits reversed: each prefix is spread over the whole. */
static void spread(pbs_clod_point *out, const pbs_clod_point *in, uint64_t n) {
    int bits = 0;
    while ((uint64_t)1 << bits < n) bits++;
    uint64_t rank = 0, side = (uint64_t)1 << bits;
    for (uint64_t i = 0; i < side; i++) {
        if (rank < n) *out++ = in[rank];
        uint64_t bit = side >> 1; /* counts up from the highest bit */
        while (rank & bit) rank ^= bit, bit >>= 1;
        rank |= bit;
    }
}

pbs_code pbs_cloud_tree_points(const pbs_cloud_tree *t, size_t i, pbs_clod_point *out,
                               pbs_clod_point *scratch, pbs_err *err) {
    const pbs_cloud_node *n = &t->node[i];
    pbs_code rc = PBS_OK;
    for (int k = n->high; k >= n->low && !rc; k--) {
        uint64_t count = 0, got = 0;
        for (size_t c = n->first; c < n->end && !rc; c++, count += got, got = 0) {
            const pbs_clod_cell *cell = &t->points->cells.cell[c];
            if (!in_level(t, c, k) || (n->bits == cell->bits && goes_up(t, cell, k))) continue;
            rc = take_level(t, c, k, scratch + count, &got, err);
            if (!rc) move(scratch + count, got, cell, n);
        }
        if (!rc) spread(out, scratch, count);
        out += count;
    }
    return rc;
}
