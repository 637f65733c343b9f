/* hierarchy.c: the plan of a scene's surfels: who has some, how many, from what (paper 1, section
 * 3.4). */
#include "formats/surfels/hierarchy.h"
#include "formats/scene/dag.h"
#include "libcore/gbuffer/extent.h"
#include "libcore/gbuffer/views.h"
#include <string.h>

/* Boxes are exact, vertex by vertex, below nodes with at most so many placed vertices; above, the
 * boxes of the children do. */
#define EXACT_VERTICES 1000000u

typedef struct maker {
    const pbs_scene *s;
    const pbs_lod *lod;
    const pbs_gbuffer_params *views;
    bool top_down;
    pbs_plan *plan;
    bool *top;
    bool *moves;         /* something below each node does */
    pbs_extent *all;     /* of everything below each node */
    pbs_extent *still;   /* of what does not move; at first of the node's own vertices */
    uint64_t *vertices;  /* placed below each node, without what moves */
    uint64_t *triangles; /* likewise */
} maker;

static uint64_t own_meshes(const pbs_scene *s, size_t node) {
    return s->first_mesh[node + 1] - s->first_mesh[node];
}

static uint64_t own_vertices(const pbs_scene *s, size_t node) {
    uint64_t n = 0;
    for (size_t i = s->first_mesh[node]; i < s->first_mesh[node + 1]; i++)
        n += s->meshes[i].vertices;
    return n;
}

static uint64_t own_triangles(const pbs_scene *s, size_t node) {
    uint64_t n = 0;
    for (size_t i = s->first_mesh[node]; i < s->first_mesh[node + 1]; i++)
        n += s->meshes[i].triangles;
    return n;
}

/* How many are placed below each node, without what moves: a walk that leaves out subtrees with
 * none of them ends even if 64 levels of two equal children each place 2^64 nodes that only have
 * something that moves. */
static void count(const pbs_scene *s, uint64_t (*own)(const pbs_scene *s, size_t node),
                  uint64_t *n) {
    for (size_t i = 0; i < s->node_count; i++) {
        n[i] = own(s, i);
        for (uint32_t j = 0; j < s->nodes[i].child_count; j++) {
            const pbs_child *c = &s->nodes[i].children[j];
            if (c->flags & PBS_CHILD_MOVES) continue;
            if (__builtin_add_overflow(n[i], n[c->node], &n[i])) n[i] = UINT64_MAX;
        }
    }
}

static void to_part(double out[12], const double m[12], const double origin[3]) {
    double local[12];
    memcpy(local, PBS_IDENTITY, sizeof local);
    for (int k = 0; k < 3; k++) local[4 * k + 3] = origin[k];
    pbs_xform_mul(out, m, local);
}

/* ---- who is a top ---- */

/* The one child that is all there is to see of a node, or NULL. */
static const pbs_child *only_child(const maker *k, uint32_t node) {
    const pbs_node *n = &k->s->nodes[node];
    const pbs_child *only = NULL;
    if (own_meshes(k->s, node)) return NULL;
    for (uint32_t j = 0; j < n->child_count; j++) {
        const pbs_child *c = &n->children[j];
        if (c->flags & PBS_CHILD_MOVES || !k->triangles[c->node]) continue;
        if (only) return NULL;
        only = c;
    }
    return only;
}

static uint32_t mark_top(maker *k, uint32_t node) {
    const pbs_child *c;
    while ((c = only_child(k, node))) node = c->node;
    k->top[node] = k->triangles[node] != 0;
    return node;
}

static void mark_tops(maker *k) {
    const pbs_scene *s = k->s;
    memset(k->top, 0, s->node_count * sizeof *k->top);
    k->plan->root = mark_top(k, (uint32_t)s->node_count - 1);
    for (size_t i = 0; i < s->node_count; i++)
        for (uint32_t j = 0; j < s->nodes[i].child_count; j++)
            if (s->nodes[i].children[j].flags & PBS_CHILD_MOVES)
                mark_top(k, s->nodes[i].children[j].node);
}

/* ---- boxes ---- */

static pbs_code measure_parts(maker *k, pbs_err *err) {
    const pbs_scene *s = k->s;
    for (size_t i = 0; i < s->node_count; i++) {
        pbs_code rc = i % 256 ? PBS_OK : pbs_run_check(s->run, err);
        if (rc) return rc;
        pbs_box box = PBS_BOX_EMPTY;
        for (size_t j = s->first_mesh[i]; j < s->first_mesh[i + 1]; j++) {
            const pbs_mesh *mesh = &s->meshes[j];
            for (uint32_t v = 0; v < mesh->vertices; v++) {
                double p[3];
                for (int a = 0; a < 3; a++)
                    p[a] = s->nodes[i].origin[a] + mesh->position[3 * v + (uint32_t)a];
                pbs_box_add(&box, p);
            }
        }
        k->still[i] = pbs_extent_of(&box);
    }
    return PBS_OK;
}

typedef struct exact {
    const maker *k;
    pbs_box *box;
} exact;

static pbs_code add_vertices(void *ctx, uint32_t node, const double m[12], uint32_t flags,
                             bool *descend, pbs_err *err) {
    exact *e = ctx;
    const pbs_scene *s = e->k->s;
    double local[12];
    (void)err;
    *descend = !(flags & PBS_CHILD_MOVES) && e->k->vertices[node];
    if (!*descend) return PBS_OK;
    to_part(local, m, s->nodes[node].origin);
    for (size_t j = s->first_mesh[node]; j < s->first_mesh[node + 1]; j++)
        for (uint32_t v = 0; v < s->meshes[j].vertices; v++) {
            const float *f = s->meshes[j].position + 3 * (size_t)v;
            double p[3] = {f[0], f[1], f[2]};
            pbs_xform_point(p, local, p);
            pbs_box_add(e->box, p);
        }
    return PBS_OK;
}

/* seen: without what moves; box: with it. */
static pbs_code measure(maker *k, uint32_t node, pbs_err *err) {
    pbs_planned *p = &k->plan->nodes[node];
    const pbs_node *n = &k->s->nodes[node];
    pbs_extent *still = &k->still[node], *all = &k->all[node];
    bool root = node + 1 == k->s->node_count;
    pbs_code rc = PBS_OK;
    *all = *still;
    k->moves[node] = false;
    for (uint32_t j = 0; j < n->child_count; j++) {
        const pbs_child *c = &n->children[j];
        bool moves = c->flags & PBS_CHILD_MOVES;
        pbs_extent placed = pbs_extent_place(c->m, &k->all[c->node]);
        pbs_extent_join(all, &placed);
        placed = pbs_extent_place(c->m, &k->still[c->node]);
        if (!moves) pbs_extent_join(still, &placed);
        k->moves[node] |= moves || k->moves[c->node];
    }
    if ((p->wanted || root) && n->child_count && k->vertices[node] <= EXACT_VERTICES) {
        pbs_box box = PBS_BOX_EMPTY;
        exact e = {k, &box};
        rc = pbs_dag_walk(k->s->run, k->s->nodes, node + 1, add_vertices, &e, err);
        *still = pbs_extent_of(&box);
    }
    if (!k->moves[node]) *all = *still;
    p->seen = still->box;
    p->box = all->box;
    return rc;
}

/* ---- one node ---- */

static pbs_code plan_views(maker *k, uint32_t node, pbs_err *err) {
    pbs_planned *p = &k->plan->nodes[node];
    if (pbs_box_is_empty(&p->seen)) {
        if (k->top[node]) return pbs_fail(err, PBS_DATA, "transforms leave no finite vertex");
        p->wanted = 0;
        return PBS_OK;
    }
    for (int a = 0; a < 3; a++) {
        if (!(p->seen.max[a] - p->seen.min[a] < 1e300)) /* that of views.h */
            return pbs_fail(err, PBS_DATA, "transforms blow it up beyond all numbers");
        p->origin[a] = p->seen.min[a] / 2 + p->seen.max[a] / 2;
        p->seen.min[a] -= p->origin[a];
        p->seen.max[a] -= p->origin[a];
    }
    double side = 0;
    for (int a = 0; a < 3; a++) side = fmax(side, p->seen.max[a] - p->seen.min[a]);
    p->resolution = pbs_lod_resolution(k->lod, p->wanted, side);
    pbs_gbuffer_params params = *k->views;
    params.box = p->seen;
    params.resolution = p->resolution;
    pbs_views views;
    pbs_code rc = pbs_views_plan(&params, &views, err);
    p->pixel = rc ? 0 : views.pixel;
    return rc;
}

typedef struct look {
    const pbs_plan *plan;
    const pbs_scene *s;
    uint32_t node;
    double from[3];
    bool below; /* for marking: something is fine */
    pbs_draw **draws;
    size_t *cap, count;
    uint64_t triangles;
} look;

/* Whether the surfels of a placed node could stand for it. */
static bool is_fine(const look *l, uint32_t node, const double m[12]) {
    const pbs_planned *p = &l->plan->nodes[node];
    return node != l->node && p->wanted &&
           pbs_lod_fine(&p->box, p->pixel, m, l->plan->nodes[l->node].pixel);
}

/* Whether they do. They always do if they can, unless a node between the two was left out since it
 * failed: what was to be seen through it is not marked as used. */
static bool stands(const look *l, uint32_t node, const double m[12]) {
    return l->plan->nodes[l->node].flags & PBS_NODE_BELOW &&
           l->plan->nodes[node].flags & PBS_NODE_USED && is_fine(l, node, m);
}

static pbs_code too_many(pbs_err *err) {
    return pbs_fail(err, PBS_DATA, "more than 2^32 - 2 triangles in a picture");
}

static pbs_code mark_used(void *ctx, uint32_t node, const double m[12], uint32_t flags,
                          bool *descend, pbs_err *err) {
    look *l = ctx;
    *descend = !(flags & PBS_CHILD_MOVES) && l->plan->meshes[node];
    if (!*descend) return PBS_OK;
    if (is_fine(l, node, m)) {
        l->plan->nodes[node].flags |= PBS_NODE_USED;
        l->below = true;
        *descend = false;
        return PBS_OK;
    }
    /* What cannot be drawn in the end is refused before 2^64 placings of it are looked at. */
    l->count += own_meshes(l->s, node);
    l->triangles += own_triangles(l->s, node);
    if (l->triangles > UINT32_MAX - 1) return too_many(err);
    return pbs_mem_plan(l->s->run, l->count * sizeof **l->draws, "the placed meshes", err);
}

static pbs_code plan_below(maker *k, uint32_t node, pbs_err *err) {
    pbs_planned *p = &k->plan->nodes[node];
    look l = {.plan = k->plan, .s = k->s, .node = node};
    pbs_code rc = pbs_dag_walk(k->s->run, k->s->nodes, node + 1, mark_used, &l, err);
    if (l.below) p->flags |= PBS_NODE_BELOW;
    return rc;
}

static pbs_code plan_node(maker *k, uint32_t node, pbs_err *err) {
    pbs_planned *p = &k->plan->nodes[node];
    *p = (pbs_planned){.seen = PBS_BOX_EMPTY, .box = PBS_BOX_EMPTY};
    if (k->top[node] || !only_child(k, node))
        p->wanted = pbs_lod_count(k->lod, k->triangles[node], k->top[node]);
    pbs_code rc = measure(k, node, err);
    if (!rc && p->wanted) rc = plan_views(k, node, err);
    if (!rc && p->wanted && !k->top_down && k->s->nodes[node].child_count)
        rc = plan_below(k, node, err);
    k->plan->wanted += !rc && p->wanted;
    return rc;
}

/* A node that cannot be planned is an error, or told and gets no surfels (see failed in scene.h):
 * the nodes above draw what is in it as far as that can be drawn. */
static pbs_code plan_or_leave_out(maker *k, uint32_t node, pbs_err *err) {
    const pbs_scene_options *o = &k->s->options;
    pbs_code rc = plan_node(k, node, err);
    if (rc != PBS_DATA) return rc;
    pbs_fail_in(err, "node %u \"%s\"", node, k->s->nodes[node].name);
    if (!o->failed) return rc;
    o->failed(o->failed_ctx, err);
    k->plan->nodes[node].wanted = k->plan->nodes[node].flags = 0;
    return PBS_OK;
}

/* ---- the plan ---- */

static uint64_t count_singular(const pbs_scene *s) {
    uint64_t n = 0;
    for (size_t i = 0; i < s->node_count; i++)
        for (uint32_t j = 0; j < s->nodes[i].child_count; j++)
            n += pbs_xform_is_singular(s->nodes[i].children[j].m);
    return n;
}

static pbs_code take_room(maker *k, pbs_err *err) {
    const pbs_scene *s = k->s;
    size_t n = s->node_count;
    const char *what = "the plan of the hierarchy";
    pbs_code rc = pbs_alloc(s->run, &k->plan->nodes, n, sizeof *k->plan->nodes, what, err);
    if (!rc) rc = pbs_alloc(s->run, &k->top, n, sizeof *k->top, what, err);
    if (!rc) rc = pbs_alloc(s->run, &k->moves, n, sizeof *k->moves, what, err);
    if (!rc) rc = pbs_alloc(s->run, &k->still, n, sizeof *k->still, what, err);
    if (!rc) rc = pbs_alloc(s->run, &k->all, n, sizeof *k->all, what, err);
    if (!rc) rc = pbs_alloc(s->run, &k->triangles, n, sizeof *k->triangles, what, err);
    if (!rc) rc = pbs_alloc(s->run, &k->vertices, n, sizeof *k->vertices, what, err);
    if (!rc) rc = pbs_alloc(s->run, &k->plan->meshes, n, sizeof *k->plan->meshes, what, err);
    return rc;
}

pbs_code pbs_plan_make(const pbs_scene *s, const pbs_lod *lod, const pbs_gbuffer_params *views,
                       bool top_down, pbs_plan *out, pbs_err *err) {
    maker k = {.s = s, .lod = lod, .views = views, .top_down = top_down, .plan = out};
    memset(out, 0, sizeof *out);
    pbs_code rc = take_room(&k, err);
    if (!rc) rc = measure_parts(&k, err);
    if (!rc) {
        count(s, own_triangles, k.triangles);
        count(s, own_vertices, k.vertices);
        count(s, own_meshes, out->meshes);
        mark_tops(&k);
        out->singular = count_singular(s);
        if (!k.triangles[s->node_count - 1] && !s->nodes[s->node_count - 1].triangles)
            rc = pbs_fail(err, PBS_DATA, "no triangles in it");
    }
    for (size_t i = 0; i < s->node_count && !rc; i++) rc = plan_or_leave_out(&k, (uint32_t)i, err);
    if (rc == PBS_DATA) pbs_fail_in(err, "%s", pbs_reader_name(s->reader));
    pbs_free(s->run, k.top);
    pbs_free(s->run, k.moves);
    pbs_free(s->run, k.still);
    pbs_free(s->run, k.all);
    pbs_free(s->run, k.triangles);
    pbs_free(s->run, k.vertices);
    return rc;
}

void pbs_plan_free(pbs_run *run, pbs_plan *plan) {
    pbs_free(run, plan->nodes);
    pbs_free(run, plan->meshes);
    memset(plan, 0, sizeof *plan);
}

/* ---- what is drawn ---- */

static pbs_code add_draws(void *ctx, uint32_t node, const double m[12], uint32_t flags,
                          bool *descend, pbs_err *err) {
    look *l = ctx;
    const pbs_scene *s = l->s;
    *descend = !(flags & PBS_CHILD_MOVES) && l->plan->meshes[node] && !stands(l, node, m);
    size_t first = s->first_mesh[node], end = s->first_mesh[node + 1];
    if (!*descend || first == end) return PBS_OK;
    pbs_code rc = pbs_grow(s->run, l->draws, l->cap, l->count + (end - first), sizeof **l->draws,
                           "the placed meshes", err);
    double local[12];
    to_part(local, m, s->nodes[node].origin);
    for (int k = 0; k < 3; k++) local[4 * k + 3] -= l->from[k];
    for (size_t i = first; i < end && !rc; i++) {
        pbs_draw *d = &(*l->draws)[l->count++];
        d->mesh = &s->meshes[i];
        memcpy(d->m, local, sizeof local);
        l->triangles += d->mesh->triangles;
    }
    if (!rc && l->triangles > UINT32_MAX - 1) rc = too_many(err);
    return rc;
}

pbs_code pbs_plan_draws(const pbs_scene *s, const pbs_plan *plan, uint32_t node, pbs_draw **draws,
                        size_t *cap, size_t *count, uint64_t *triangles, pbs_err *err) {
    look l = {.plan = plan, .s = s, .node = node, .draws = draws, .cap = cap};
    memcpy(l.from, plan->nodes[node].origin, sizeof l.from);
    pbs_code rc = pbs_dag_walk(s->run, s->nodes, node + 1, add_draws, &l, err);
    *count = l.count;
    *triangles = l.triangles;
    return rc;
}

/* ---- the surfels' side ---- */

typedef struct below {
    const pbs_node *nodes;
    const uint64_t *used;
    const pbs_node *top;
    pbs_code (*place)(void *ctx, uint32_t below, const double m[12], pbs_err *err);
    void *ctx;
    uint64_t left; /* visits; a stream of a few kilobytes can ask for 2^64 */
} below;

static pbs_code place_below(void *ctx, uint32_t node, const double m[12], uint32_t flags,
                            bool *descend, pbs_err *err) {
    below *b = ctx;
    const pbs_node *n = &b->nodes[node];
    *descend = !(flags & PBS_CHILD_MOVES) && b->used[node];
    if (!b->left--)
        return pbs_fail(err, PBS_DATA, "node %u: more than 2^32 nodes placed below it", b->top->id);
    if (!*descend || n == b->top || !n->wanted || !(n->flags & PBS_NODE_USED) ||
        !pbs_lod_fine(&n->box, n->pixel, m, b->top->pixel))
        return PBS_OK;
    double local[12];
    *descend = false;
    to_part(local, m, n->origin);
    for (int k = 0; k < 3; k++) local[4 * k + 3] -= b->top->origin[k];
    return b->place(b->ctx, node, local, err);
}

pbs_code pbs_plan_below(pbs_run *run, const pbs_node *nodes, const uint64_t *used, uint32_t node,
                        pbs_code (*place)(void *ctx, uint32_t below, const double m[12],
                                          pbs_err *err),
                        void *ctx, pbs_err *err) {
    below b = {nodes, used, &nodes[node], place, ctx, (uint64_t)1 << 32};
    return pbs_dag_walk(run, nodes, node + 1, place_below, &b, err);
}
