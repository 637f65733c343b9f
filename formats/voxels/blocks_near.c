/* blocks_near.c: the triangles near a block: what the walk has not opened is opened here, anew for
 * each block, so that nothing is stored. */
#include "formats/voxels/blocks_inner.h"

enum {
    CHECK_EVERY = 4096, /* steps */
    RUN_MOST = 1 << 14  /* triangles that are handed over at a time */
};

typedef struct step {
    uint32_t node, child; /* child that comes next */
    bool inside;          /* everything below is in the block's reach: no boxes are looked at */
    double m[12];
} step;

typedef struct visitor {
    pbs_blocks *b;
    double low[3], high[3]; /* the block's reach, in voxels */
    pbs_nearby_fn fn;
    void *ctx;
    step *steps;
    size_t depth, cap;
    uint32_t count; /* steps so far */
} visitor;

/* The triangles of a mesh that are handed over next. */
typedef struct batch {
    visitor *v;
    uint32_t mesh;
    walk_mesh at;
    const double *m;
    pbs_to_grid to;
    bool ready; /* `to` is made */
    uint32_t first, count;
} batch;

static bool touches(const visitor *v, const pbs_box *box) {
    for (int k = 0; k < 3; k++)
        if (box->max[k] < v->low[k] || box->min[k] >= v->high[k]) return false;
    return true;
}

static bool is_inside(const visitor *v, const pbs_box *box) {
    for (int k = 0; k < 3; k++)
        if (!(box->min[k] >= v->low[k] && box->max[k] < v->high[k])) return false;
    return true;
}

/* ---- meshes ---- */

static pbs_code flush(batch *t, pbs_err *err) {
    visitor *v = t->v;
    pbs_blocks *b = v->b;
    if (!t->count) return PBS_OK;
    if (!t->ready && !pbs_to_grid_make(&t->to, &b->grid, t->m))
        return pbs_fail(err, PBS_DATA, "%s: a part is placed too far away for cells of %g",
                        pbs_reader_name(b->s->reader), b->grid.voxel);
    t->ready = true;
    pbs_pages_saw(&b->pages, t->count);
    pbs_code rc = v->fn(v->ctx, &b->s->meshes[t->mesh], t->at.clusters->order + t->first, t->count,
                        &t->to, (pbs_sides)b->sides[t->mesh], err);
    t->count = 0;
    return rc;
}

static pbs_code hand_over(batch *t, int level, uint32_t box, pbs_err *err) {
    uint32_t first, n = pbs_clusters_below(t->at.clusters, level, box, &first);
    pbs_code rc = PBS_OK;
    if (t->count && (t->first + t->count != first || t->count >= RUN_MOST)) rc = flush(t, err);
    if (!t->count) t->first = first;
    t->count += n;
    return rc;
}

/* No deeper than PBS_CLUSTER_LEVELS. */
static pbs_code visit_box(batch *t, int level, uint32_t i, pbs_err *err) {
    pbs_box box = walk_mesh_box(&t->at, level, i);
    if (!touches(t->v, &box)) return PBS_OK;
    if (!level || is_inside(t->v, &box)) return hand_over(t, level, i, err);
    pbs_code rc = PBS_OK;
    uint32_t end = 8 * i + 8, all = t->at.clusters->count[level - 1];
    for (i = 8 * i; i < end && i < all && !rc; i++) rc = visit_box(t, level - 1, i, err);
    return rc;
}

static pbs_code visit_mesh(visitor *v, uint32_t mesh, const double m[12], int level, uint32_t box,
                           bool inside, pbs_err *err) {
    batch t = {.v = v, .mesh = mesh, .m = m, .at = walk_mesh_at(v->b, mesh, m)};
    pbs_code rc = inside ? hand_over(&t, level, box, err) : visit_box(&t, level, box, err);
    return rc ? rc : flush(&t, err);
}

/* ---- nodes ---- */

/* Its meshes; its children follow if it has any. */
static pbs_code visit_node(visitor *v, uint32_t node, const double m[12], bool inside,
                           pbs_err *err) {
    const pbs_blocks *b = v->b;
    const pbs_scene *s = b->s;
    double local[12];
    if (pbs_bound_is_empty(&b->bound[node]) || walk_is_nowhere(m)) return PBS_OK;
    if (!inside && !walk_is_mesh(s, node)) {
        pbs_box box = walk_node_box(b, node, m);
        if (!touches(v, &box)) return PBS_OK;
        inside = is_inside(v, &box);
    }
    pbs_code rc = PBS_OK;
    if (s->first_mesh[node] < s->first_mesh[node + 1]) pbs_part_place(local, m, &s->nodes[node]);
    for (size_t i = s->first_mesh[node]; i < s->first_mesh[node + 1] && !rc; i++) {
        int levels = b->clusters[i].levels;
        if (levels) rc = visit_mesh(v, (uint32_t)i, local, levels - 1, 0, inside, err);
    }
    if (rc || !s->nodes[node].child_count) return rc;
    rc = pbs_grow(b->run, &v->steps, &v->cap, v->depth + 1, sizeof *v->steps, "the hierarchy", err);
    if (rc) return rc;
    step *top = &v->steps[v->depth++];
    *top = (step){.node = node, .inside = inside};
    memcpy(top->m, m, sizeof top->m);
    return PBS_OK;
}

/* A step whose last child comes next is not needed any more: a chain of nodes takes one. */
static pbs_code visit_below(visitor *v, uint32_t node, const double m[12], pbs_err *err) {
    const pbs_scene *s = v->b->s;
    pbs_code rc = visit_node(v, node, m, false, err);
    while (!rc && v->depth) {
        step *top = &v->steps[v->depth - 1];
        const pbs_node *n = &s->nodes[top->node];
        const pbs_child *c = &n->children[top->child++];
        bool inside = top->inside;
        double t[12];
        pbs_xform_mul(t, top->m, c->m);
        v->depth -= top->child == n->child_count;
        rc = visit_node(v, c->node, t, inside, err);
        if (!rc && ++v->count % CHECK_EVERY == 0) rc = pbs_run_check(v->b->run, err);
    }
    return rc;
}

pbs_code pbs_nearby_visit(const pbs_nearby *n, pbs_nearby_fn fn, void *ctx, pbs_err *err) {
    visitor v = {.b = n->b, .fn = fn, .ctx = ctx};
    pbs_code rc = PBS_OK;
    for (int k = 0; k < 3; k++) {
        v.low[k] = (double)n->at[k] * PBS_BLOCK - 1;
        v.high[k] = v.low[k] + PBS_BLOCK + 2;
    }
    for (size_t i = 0; i < n->count && !rc; i++) {
        const walk_entry *e = &n->entry[i];
        if (e->level == WALK_NODE)
            rc = visit_below(&v, e->id, n->place[e->place], err);
        else
            rc = visit_mesh(&v, e->id, n->place[e->place], e->level, e->box, false, err);
    }
    pbs_free(n->b->run, v.steps);
    return rc;
}
