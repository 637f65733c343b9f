/* check_points.c: are the points of a cloud as far apart as they say? (check_points.h; the promise
 * is that of paper 3, section 3.1, kept everywhere and not only inside of a node.)
 *
 * Two points that are too near are each inside of the other's spacing. So a node's points are
 * compared with those of nodes that come before it in the file, coarse first, as far as they lie in
 * its box grown by its own largest spacing. That is done level by level: of the points with a
 * spacing of at least 2^k there are at most a few in a cell of side 2^(k+1), or two are too near,
 * which ends the search. */
#include "formats/archive/check_points.h"
#include "formats/container/wire.h"
#include "libcore/data/rng.h"
#include <float.h>
#include <string.h>

enum { LEVELS = 32, NO_SPACING = -1 };

typedef struct member {
    double origin[3], step;
    pbs_box box;
    size_t first; /* its chunks in the directory */
    uint32_t chunks;
    size_t children; /* where they begin in the list */
    uint32_t child_count;
    uint32_t root; /* of its cloud */
    bool adds, is_child;
} member;

typedef struct spot {
    int64_t q[3]; /* relative to the node that is looked at */
    int32_t k;    /* spacing 2^k */
    uint32_t next;
} spot;

typedef struct checker {
    pbs_run *run;
    pbs_reader *reader;
    const pbs_record *record;
    const pbs_chunk *entries;
    const char *name;
    member *node;
    size_t count, room;
    uint32_t *child, *stack;
    size_t child_count, child_room, stack_room;
    /* of the node that is looked at */
    spot *spot;
    size_t spots, spot_room, sorted_room;
    spot *sorted;
    uint32_t *head;
    size_t heads, head_room;
    int64_t low[3], high[3]; /* of its points; then with the largest spacing around them */
    int top;                 /* its largest k */
} checker;

static pbs_code bad(const checker *c, size_t node, const char *what, pbs_err *err) {
    return pbs_fail(err, PBS_DATA, "%s: points of node %zu: %s", c->name, node, what);
}

/* ---- nodes ---- */

static pbs_code add_node(checker *c, const pbs_node *n, pbs_err *err) {
    pbs_code rc = pbs_grow(c->run, &c->node, &c->room, c->count + 1, sizeof *c->node,
                           "the table of nodes", err);
    if (!rc)
        rc = pbs_grow(c->run, &c->child, &c->child_room, c->child_count + n->child_count,
                      sizeof *c->child, "the table of children", err);
    if (rc) return rc;
    member *m = &c->node[c->count++];
    *m = (member){.step = n->lattice,
                  .box = n->box,
                  .children = c->child_count,
                  .child_count = n->child_count,
                  .adds = n->flags & PBS_NODE_ADDS};
    memcpy(m->origin, n->origin, sizeof m->origin);
    for (uint32_t i = 0; i < n->child_count; i++) {
        member *below = &c->node[n->children[i].node];
        c->child[c->child_count++] = n->children[i].node;
        if (!m->adds) continue;
        if (below->is_child) return bad(c, n->children[i].node, "it is placed twice", err);
        below->is_child = true;
        if (memcmp(n->children[i].m, PBS_IDENTITY, sizeof PBS_IDENTITY))
            return bad(c, n->children[i].node, "it is moved", err);
        if (below->adds && below->step != m->step)
            return bad(c, n->children[i].node, "it has another lattice", err);
    }
    return PBS_OK;
}

/* Everything was checked before: chunks follow one another. */
static pbs_code read_nodes(checker *c, size_t entries, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < entries && !rc; i++) {
        pbs_chunk chunk;
        pbs_node n;
        const pbs_chunk *e = &c->entries[i];
        if (e->tag == PBS_TAG_POINTS && !c->node[e->node].chunks++) c->node[e->node].first = i;
        if (e->tag != PBS_TAG_NODE) continue;
        rc = pbs_reader_at(c->reader, e, &chunk, err);
        if (!rc) rc = pbs_node_read(c->run, c->name, &chunk, (uint32_t)c->count, &n, err);
        if (rc) break;
        rc = add_node(c, &n, err);
        pbs_node_free(c->run, &n);
    }
    return rc;
}

/* ---- the points of a node ---- */

/* The exponent of a spacing, 2^k / 65536 as a half float; NO_SPACING for 0, LEVELS if it is none.
 */
static int level_of(uint16_t half) {
    if (!half) return NO_SPACING;
    if (half == 256 || half == 512) return half / 512; /* too small for a leading one */
    return half & 0x8000 || half < 1024 || half & 1023 ? LEVELS : (half >> 10) + 1;
}

static pbs_code add_spot(checker *c, const spot *s, pbs_err *err) {
    if (c->spots == c->spot_room) {
        pbs_code rc = pbs_grow(c->run, &c->spot, &c->spot_room, c->spots + 1, sizeof *c->spot,
                               "points to compare", err);
        if (rc) return rc;
    }
    c->spot[c->spots++] = *s;
    return PBS_OK;
}

static bool in_box(const member *m, const uint16_t q[3]) {
    for (int a = 0; a < 3; a++) {
        double at = m->origin[a] + m->step * q[a], slack = m->step / 2 + 4e-16 * fabs(at);
        if (at < m->box.min[a] - slack || at > m->box.max[a] + slack) return false;
    }
    return true;
}

/* A node's own: everything about them is looked at. */
static pbs_code take_own(checker *c, size_t node, const uint8_t *p, uint32_t n, int *last,
                         pbs_err *err) {
    const member *m = &c->node[node];
    int spacing = pbs_record_at(c->record, PBS_SPACING);
    pbs_code rc = PBS_OK;
    for (uint32_t i = 0; i < n && !rc; i++, p += c->record->stride) {
        uint16_t q[3];
        memcpy(q, p, sizeof q);
        int k = level_of(pbs_get_u16(p + spacing));
        if (k == LEVELS) return bad(c, node, "a spacing is that of no level", err);
        if (k > *last) return bad(c, node, "a spacing is larger than the one before", err);
        if (!in_box(m, q)) return bad(c, node, "one is outside of the node's box", err);
        *last = k;
        if (k == NO_SPACING) continue;
        spot s = {{q[0], q[1], q[2]}, k, 0};
        for (int a = 0; a < 3; a++) {
            c->low[a] = s.q[a] < c->low[a] ? s.q[a] : c->low[a];
            c->high[a] = s.q[a] > c->high[a] ? s.q[a] : c->high[a];
        }
        c->top = k > c->top ? k : c->top;
        rc = add_spot(c, &s, err);
    }
    return rc;
}

/* Another node's, as far as they are near. by: its origin in steps. */
static pbs_code take_other(checker *c, const int64_t by[3], const uint8_t *p, uint32_t n,
                           pbs_err *err) {
    int spacing = pbs_record_at(c->record, PBS_SPACING);
    pbs_code rc = PBS_OK;
    for (uint32_t i = 0; i < n && !rc; i++, p += c->record->stride) {
        spot s = {
            {by[0] + pbs_get_u16(p), by[1] + pbs_get_u16(p + 2), by[2] + pbs_get_u16(p + 4)}, 0, 0};
        bool near = true;
        for (int a = 0; a < 3; a++) near = near && s.q[a] >= c->low[a] && s.q[a] <= c->high[a];
        if (!near) continue;
        s.k = level_of(pbs_get_u16(p + spacing));
        if (s.k >= 0 && s.k < LEVELS) rc = add_spot(c, &s, err);
    }
    return rc;
}

/* by NULL: the node itself. */
static pbs_code take_node(checker *c, size_t node, const int64_t *by, pbs_err *err) {
    const member *m = &c->node[node];
    size_t at = m->first;
    int last = LEVELS;
    pbs_code rc = PBS_OK;
    for (uint32_t i = 0; i < m->chunks && !rc; i++, at++) {
        pbs_chunk chunk;
        while (c->entries[at].tag != PBS_TAG_POINTS || c->entries[at].node != node) at++;
        rc = pbs_reader_read(c->reader, &c->entries[at], &chunk, err);
        if (!rc)
            rc = by ? take_other(c, by, chunk.payload, chunk.count, err)
                    : take_own(c, node, chunk.payload, chunk.count, &last, err);
        if (!rc) rc = pbs_run_check(c->run, err);
    }
    return rc;
}

/* ---- other nodes ---- */

static bool is_near(const checker *c, const member *to, const member *m) {
    for (int a = 0; a < 3; a++) {
        double low = to->origin[a] + to->step * ((double)c->low[a] - 1);
        double high = to->origin[a] + to->step * ((double)c->high[a] + 1);
        if (m->box.max[a] < low || m->box.min[a] > high) return false;
    }
    return true;
}

/* Where the origin of m is as seen from that of `to`; an error if it is on no lattice point. */
static pbs_code offset_of(const checker *c, size_t node, const member *to, int64_t by[3],
                          pbs_err *err) {
    const member *m = &c->node[node];
    for (int a = 0; a < 3; a++) {
        double steps = (m->origin[a] - to->origin[a]) / to->step, whole = floor(steps + 0.5);
        if (!(fabs(steps) < 0x1p40) || fabs(steps - whole) > 0.25)
            return bad(c, node, "its origin is not on the lattice of the others", err);
        by[a] = (int64_t)whole;
    }
    return PBS_OK;
}

/* Can doubles tell lattice points apart, so far from the origin? */
static bool is_exact(const member *m) {
    double most = 0;
    for (int a = 0; a < 3; a++)
        most = fmax(most, fmax(fabs(m->origin[a]), fmax(fabs(m->box.min[a]), fabs(m->box.max[a]))));
    return most * (8 * DBL_EPSILON) < m->step / 4;
}

/* Nodes with larger numbers come before `node` in the file; those below it all have smaller ones.
 */
static pbs_code take_others(checker *c, size_t root, size_t node, pbs_err *err) {
    const member *to = &c->node[node];
    size_t depth = 0;
    pbs_code rc =
        pbs_grow(c->run, &c->stack, &c->stack_room, 1, sizeof *c->stack, "the hierarchy", err);
    if (rc || root <= node) return rc;
    c->stack[depth++] = (uint32_t)root;
    while (depth && !rc) {
        uint32_t u = c->stack[--depth];
        const member *m = &c->node[u];
        int64_t by[3];
        if (u <= node || !m->adds || !is_near(c, to, m)) continue;
        rc = offset_of(c, u, to, by, err);
        if (!rc) rc = take_node(c, u, by, err);
        if (!rc)
            rc = pbs_grow(c->run, &c->stack, &c->stack_room, depth + m->child_count,
                          sizeof *c->stack, "the hierarchy", err);
        for (uint32_t i = 0; i < m->child_count && !rc; i++)
            c->stack[depth++] = c->child[m->children + i];
    }
    return rc;
}

/* ---- comparing ---- */

static size_t slot_of(const checker *c, int64_t x, int64_t y, int64_t z) {
    uint64_t key = (uint64_t)x * 0x9e3779b97f4a7c15u + (uint64_t)y * 0xbf58476d1ce4e5b9u +
                   (uint64_t)z * 0x94d049bb133111ebu;
    return (size_t)(pbs_mix64(key) & (c->heads - 1));
}

static bool too_near(const spot *a, const spot *b, int k) {
    uint64_t sum = 0, s = (uint64_t)1 << k;
    for (int i = 0; i < 3; i++) {
        uint64_t d = (uint64_t)(a->q[i] > b->q[i] ? a->q[i] - b->q[i] : b->q[i] - a->q[i]);
        if (d >= s) return false;
        sum += d * d;
    }
    return sum < s * s;
}

/* Is one of those that are in the cells closer than 2^k? They are in cells of side 2^(k+1). */
static bool finds(const checker *c, const spot *s, int k) {
    int64_t reach = (int64_t)1 << k, from[3], to[3];
    for (int a = 0; a < 3; a++)
        from[a] = (s->q[a] - reach) >> (k + 1), to[a] = (s->q[a] + reach) >> (k + 1);
    for (int64_t z = from[2]; z <= to[2]; z++)
        for (int64_t y = from[1]; y <= to[1]; y++)
            for (int64_t x = from[0]; x <= to[0]; x++)
                for (uint32_t i = c->head[slot_of(c, x, y, z)]; i; i = c->sorted[i - 1].next)
                    if (too_near(s, &c->sorted[i - 1], k)) return true;
    return false;
}

static void put_in(checker *c, uint32_t i, int k) {
    spot *s = &c->sorted[i];
    size_t slot = slot_of(c, s->q[0] >> (k + 1), s->q[1] >> (k + 1), s->q[2] >> (k + 1));
    s->next = c->head[slot];
    c->head[slot] = i + 1;
}

/* Largest spacings first. begin: of each, from LEVELS - 1 down; begin[0] is where k = 0 ends. */
static void sort_spots(checker *c, size_t begin[LEVELS + 1]) {
    size_t at[LEVELS] = {0}, sum = 0;
    for (size_t i = 0; i < c->spots; i++) at[c->spot[i].k]++;
    for (int k = LEVELS - 1; k >= 0; k--) {
        size_t n = at[k];
        begin[k + 1] = at[k] = sum;
        sum += n;
    }
    begin[0] = sum;
    for (size_t i = 0; i < c->spots; i++) c->sorted[at[c->spot[i].k]++] = c->spot[i];
}

static pbs_code compare(checker *c, size_t node, pbs_err *err) {
    size_t begin[LEVELS + 1];
    if (c->spots >= UINT32_MAX / 2)
        return pbs_fail(err, PBS_LIMIT, "%s: node %zu: too many points", c->name, node);
    for (c->heads = 64; c->heads < 2 * c->spots;) c->heads *= 2;
    pbs_code rc = pbs_grow(c->run, &c->head, &c->head_room, c->heads, sizeof *c->head,
                           "points to compare", err);
    if (!rc)
        rc = pbs_grow(c->run, &c->sorted, &c->sorted_room, c->spots, sizeof *c->sorted,
                      "points to compare", err);
    if (rc) return rc;
    sort_spots(c, begin);
    for (int k = LEVELS - 1; k >= 0 && !rc; k--) {
        size_t from = begin[k + 1], end = begin[k];
        if (from == end) continue;
        memset(c->head, 0, c->heads * sizeof *c->head);
        for (size_t i = 0; i < from; i++) put_in(c, (uint32_t)i, k);
        for (size_t i = from; i < end; i++) {
            if (finds(c, &c->sorted[i], k))
                return bad(c, node, "one is closer to another than both their spacings", err);
            put_in(c, (uint32_t)i, k);
        }
        rc = pbs_run_check(c->run, err);
    }
    return rc;
}

static pbs_code check_node(checker *c, size_t root, size_t node, pbs_err *err) {
    const member *m = &c->node[node];
    if (!m->chunks) return PBS_OK;
    c->spots = 0;
    c->top = NO_SPACING;
    for (int a = 0; a < 3; a++) c->low[a] = INT64_MAX, c->high[a] = INT64_MIN;
    pbs_code rc = take_node(c, node, NULL, err);
    if (rc || c->top == NO_SPACING) return rc;
    for (int a = 0; a < 3; a++) {
        c->low[a] -= (int64_t)1 << c->top;
        c->high[a] += (int64_t)1 << c->top;
    }
    if (is_exact(m) && is_exact(&c->node[root])) rc = take_others(c, root, node, err);
    return rc ? rc : compare(c, node, err);
}

/* ---- all ---- */

static pbs_code check_all(checker *c, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = c->count; i-- && !rc;) {
        member *m = &c->node[i];
        if (!m->adds) continue;
        if (!m->is_child) m->root = (uint32_t)i;
        for (uint32_t k = 0; k < m->child_count; k++)
            c->node[c->child[m->children + k]].root = m->root;
        rc = check_node(c, m->root, i, err);
        pbs_run_progress(c->run, "comparing", c->count - i, c->count);
    }
    return rc;
}

pbs_code pbs_check_clouds(pbs_run *run, pbs_reader *r, const pbs_record *record,
                          const pbs_chunk *entries, size_t count, pbs_err *err) {
    checker c = {
        .run = run, .reader = r, .record = record, .entries = entries, .name = pbs_reader_name(r)};
    pbs_code rc = read_nodes(&c, count, err);
    if (!rc) rc = check_all(&c, err);
    pbs_free(run, c.node);
    pbs_free(run, c.child);
    pbs_free(run, c.stack);
    pbs_free(run, c.spot);
    pbs_free(run, c.sorted);
    pbs_free(run, c.head);
    return rc;
}
