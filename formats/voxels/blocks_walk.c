/* blocks_walk.c: the octree of the grid, walked down together with the DAG of nodes and the trees
 * of boxes. Lists of what touches a cell lie on a stack, cell inside cell. */
#include "formats/voxels/blocks_inner.h"

/* Lists are never longer than list_most, since a child's list without anything opened is not longer
 * than its parent's: so there is room for one a level, and one that is being made. */
pbs_code walk_begin(pbs_blocks *b, size_t memory, pbs_err *err) {
    if (memory < 1u << 20) memory = 1u << 20;
    b->list_most = memory / 2 / ((WALK_DEPTH + 1) * sizeof *b->list);
    b->places_most = memory / 2 / sizeof *b->place;
    if (b->places_most > UINT32_MAX) b->places_most = UINT32_MAX;
    b->depth = -1;
    const char *what = "what touches blocks";
    pbs_code rc =
        pbs_alloc(b->run, &b->list, b->list_most * (WALK_DEPTH + 1), sizeof *b->list, what, err);
    return rc ? rc : pbs_alloc(b->run, &b->place, b->places_most, sizeof *b->place, what, err);
}

/* ---- entries ---- */

/* Which blocks a box touches: block i reaches from 64 i - 1 to 64 i + 65. Subtracting 1 is exact
 * wherever it matters. False: none of the grid's. */
static bool set_range(const pbs_blocks *b, const pbs_box *box, walk_entry *e) {
    double widest = 0;
    for (int k = 0; k < 3; k++) {
        double low = (box->min[k] - 1) / PBS_BLOCK, high = (box->max[k] + 1) / PBS_BLOCK;
        double wide = box->max[k] - box->min[k];
        if (high < 0 || low >= b->across) return false;
        e->first[k] = low > 0 ? (uint16_t)low : 0; /* also if NaN */
        e->last[k] = (uint16_t)(high < b->across ? (uint32_t)high : b->across - 1);
        if (!(wide <= widest)) widest = wide;
    }
    int span = 255;
    if (widest < 0x1p60) frexp(widest, &span);
    e->span = (uint8_t)(span < 0 ? 0 : span);
    return true;
}

static bool touches(const walk_entry *e, const uint32_t at[3], uint32_t side) {
    for (int k = 0; k < 3; k++)
        if (e->first[k] >= at[k] + side || e->last[k] < at[k]) return false;
    return true;
}

/* 2^span cells of the grid are as wide as a cell of the octree. */
static unsigned span_of(uint32_t side) {
    unsigned span = 6; /* of a block */
    for (; side > 1; side /= 2) span++;
    return span;
}

/* A list that is being made, at the end of the stack. */
typedef struct making {
    pbs_blocks *b;
    const walk_frame *f;
    size_t end;
    bool full;
} making;

static void put(making *w, const walk_entry *e) {
    if (w->end - w->f->begin >= w->b->list_most)
        w->full = true;
    else
        w->b->list[w->end++] = *e;
}

static uint32_t put_place(making *w, const double m[12]) {
    pbs_blocks *b = w->b;
    if (b->places == b->places_most) {
        w->full = true;
        return 0;
    }
    memcpy(b->place[b->places], m, sizeof *b->place);
    return (uint32_t)b->places++;
}

static bool mesh_entry(const making *w, uint32_t mesh, const double m[12], walk_entry *e) {
    const pbs_clusters *c = &w->b->clusters[mesh];
    if (!c->levels) return false;
    walk_mesh at = walk_mesh_at(w->b, mesh, m);
    pbs_box box = walk_mesh_box(&at, c->levels - 1, 0);
    *e = (walk_entry){.id = mesh, .level = (uint8_t)(c->levels - 1)};
    return set_range(w->b, &box, e) && touches(e, w->f->at, w->f->side);
}

/* A node where m places it, or its mesh if it is nothing else. */
static void put_node(making *w, uint32_t node, const double m[12]) {
    const pbs_scene *s = w->b->s;
    double local[12];
    walk_entry e = {.id = node, .level = WALK_NODE};
    if (pbs_bound_is_empty(&w->b->bound[node]) || walk_is_nowhere(m)) return;
    if (walk_is_mesh(s, node)) {
        pbs_part_place(local, m, &s->nodes[node]);
        m = local;
        if (!mesh_entry(w, (uint32_t)s->first_mesh[node], m, &e)) return;
    } else {
        pbs_box box = walk_node_box(w->b, node, m);
        if (!set_range(w->b, &box, &e) || !touches(&e, w->f->at, w->f->side)) return;
    }
    e.place = put_place(w, m);
    if (!w->full) put(w, &e);
}

static void open_node(making *w, const walk_entry *e) {
    const pbs_scene *s = w->b->s;
    const pbs_node *n = &s->nodes[e->id];
    double m[12], local[12];
    bool placed = false;
    uint32_t place = 0;
    memcpy(m, w->b->place[e->place], sizeof m);
    pbs_part_place(local, m, n);
    for (size_t i = s->first_mesh[e->id]; i < s->first_mesh[e->id + 1] && !w->full; i++) {
        walk_entry mesh;
        if (!mesh_entry(w, (uint32_t)i, local, &mesh)) continue;
        if (!placed) place = put_place(w, local), placed = true;
        mesh.place = place;
        put(w, &mesh);
    }
    for (uint32_t k = 0; k < n->child_count && !w->full; k++) {
        double t[12];
        pbs_xform_mul(t, m, n->children[k].m);
        put_node(w, n->children[k].node, t);
    }
}

static void open_box(making *w, const walk_entry *e) {
    walk_mesh at = walk_mesh_at(w->b, e->id, w->b->place[e->place]);
    uint32_t first = 8u * e->box, end = first + 8, all = at.clusters->count[e->level - 1];
    for (uint32_t i = first; i < end && i < all && !w->full; i++) {
        pbs_box box = walk_mesh_box(&at, e->level - 1, i);
        walk_entry c = {e->id, e->place, (uint8_t)(e->level - 1), 0, (uint16_t)i, {0}, {0}};
        if (set_range(w->b, &box, &c) && touches(&c, w->f->at, w->f->side)) put(w, &c);
    }
}

/* Opens what is wider than the cell, and what comes out of it, as long as there is room. What does
 * not fit stays as it was. */
static pbs_code open_large(making *w, pbs_err *err) {
    pbs_blocks *b = w->b;
    size_t kept = w->f->begin;
    unsigned span = span_of(w->f->side);
    for (size_t i = kept; i < w->end; i++) {
        walk_entry e = b->list[i];
        size_t end = w->end, places = b->places;
        if (e.span > span && e.level) {
            pbs_code rc = pbs_run_check(b->run, err);
            if (rc) return rc;
            w->full = false;
            if (e.level == WALK_NODE)
                open_node(w, &e);
            else
                open_box(w, &e);
            if (!w->full) continue;
            w->end = end;
            b->places = places;
        }
        b->list[kept++] = e;
    }
    w->end = kept;
    return PBS_OK;
}

/* ---- cells ---- */

/* The cell's list is there and filtered; opens it and goes into it, if it is not empty. */
static pbs_code enter(pbs_blocks *b, walk_frame *f, pbs_err *err) {
    making w = {.b = b, .f = f, .end = f->end};
    f->places = b->places;
    pbs_code rc = open_large(&w, err);
    f->end = w.end;
    if (!rc && f->begin < f->end)
        b->frame[++b->depth] = *f;
    else
        b->places = f->places;
    return rc;
}

static pbs_code enter_root(pbs_blocks *b, pbs_err *err) {
    const pbs_scene *s = b->s;
    walk_frame f = {.side = 1};
    while (f.side < b->across) f.side *= 2;
    making w = {.b = b, .f = &f};
    put_node(&w, (uint32_t)s->node_count - 1, PBS_IDENTITY);
    f.end = w.end;
    return enter(b, &f, err);
}

static pbs_code enter_child(pbs_blocks *b, uint32_t which, pbs_err *err) {
    const walk_frame *parent = &b->frame[b->depth];
    walk_frame f = {.side = parent->side / 2, .begin = parent->end, .end = parent->end};
    for (int k = 0; k < 3; k++) {
        f.at[k] = parent->at[k] + (which >> k & 1) * f.side;
        if (f.at[k] >= b->across) return PBS_OK;
    }
    unsigned span = span_of(f.side);
    for (size_t i = parent->begin; i < parent->end; i++) {
        const walk_entry *e = &b->list[i];
        if (!touches(e, f.at, f.side)) continue;
        if (!e->level && e->span > span && !walk_cluster_touches(b, e, f.at, f.side)) continue;
        b->list[f.end++] = *e;
    }
    return enter(b, &f, err);
}

static void leave(pbs_blocks *b) {
    b->places = b->frame[b->depth--].places;
}

/* ---- blocks ---- */

/* Entries with one transform follow each other mostly. */
static size_t copy_places(const pbs_blocks *b, const walk_frame *f, walk_entry *entry,
                          double (*place)[12]) {
    size_t n = 0;
    uint32_t last = UINT32_MAX;
    for (size_t i = f->begin; i < f->end; i++) {
        const walk_entry *e = &b->list[i];
        if (e->place != last || !n) {
            if (place) memcpy(place[n], b->place[e->place], sizeof *place);
            n++;
        }
        last = e->place;
        if (entry) entry[i - f->begin] = *e, entry[i - f->begin].place = (uint32_t)n - 1;
    }
    return n;
}

static pbs_code make_nearby(pbs_blocks *b, const walk_frame *f, pbs_nearby **out, pbs_err *err) {
    size_t count = f->end - f->begin, places = copy_places(b, f, NULL, NULL);
    size_t size = sizeof(pbs_nearby) + places * sizeof *b->place + count * sizeof *b->list;
    pbs_nearby *n;
    pbs_code rc = pbs_alloc(b->run, &n, size, 1, "what touches a block", err);
    if (rc) return rc;
    double(*place)[12] = (double(*)[12])(n + 1);
    walk_entry *entry = (walk_entry *)(place + places);
    copy_places(b, f, entry, place);
    *n = (pbs_nearby){.b = b, .count = count, .entry = entry, .place = (const double(*)[12])place};
    memcpy(n->at, f->at, sizeof n->at);
    *out = n;
    return PBS_OK;
}

void pbs_nearby_free(pbs_nearby *n) {
    if (n) pbs_free(n->b->run, n);
}

pbs_code pbs_blocks_next(pbs_blocks *b, uint32_t at[3], pbs_nearby **near, bool *end,
                         pbs_err *err) {
    pbs_code rc = PBS_OK;
    *near = NULL;
    *end = false;
    if (!b->begun) rc = enter_root(b, err);
    b->begun = true;
    while (!rc && b->depth >= 0) {
        walk_frame *f = &b->frame[b->depth];
        if (f->side == 1) {
            for (int k = 0; k < 3; k++) at[k] = f->at[k] * PBS_BLOCK;
            rc = make_nearby(b, f, near, err);
            leave(b);
            return rc;
        }
        if (f->child == 8)
            leave(b);
        else if (!(rc = pbs_run_check(b->run, err)))
            rc = enter_child(b, f->child++, err);
    }
    *end = !rc;
    return rc;
}
