/* cut.c: the walk through the hierarchy.
 *
 * Paper 1, section 4: prefixes, and the blending between a node and what is below it. Paper 2,
 * section 4: the octree is cut by the size of its cells in the picture, what was hidden is drawn
 * coarse, and what is not there yet is asked for, level by level.
 */
#include "cmd/pbs-view/plan/cut.h"
#include "cmd/pbs-view/plan/hidden.h"
#include "libcore/gbuffer/lod.h"
#include <stdlib.h>
#include <string.h>

enum { NONE = UINT32_MAX, RECORDS = 3, MOST_HIDDEN = 1 << 20 };

/* Of a node's surfels that are too few: at this share of their radius only what is below is left.
 */
#define BLENDED 0.5

/* A placed node whose subtree is still to be looked at. */
typedef struct task {
    uint32_t node, level;
    uint32_t parent; /* in the list of refined */
    bool covered;    /* a node above is drawn in its place: only what moves is left */
    bool moves;
    double share; /* of its surfels, while it comes in */
    uint64_t key; /* of the placing, the same in every frame */
    double m[12];
} task;

/* A placed chunk of voxels whose children are looked at in its place. */
typedef struct refined {
    uint64_t key;
    uint32_t parent;
    bool drawn, seen; /* children */
    bool open;        /* what is below it is not a complete row of drawn children */
} refined;

typedef struct entry {
    uint32_t parent;
    bool voxels;    /* else it counts as seen: no one notes it */
    uint64_t probe; /* key, 0: it is none */
} entry;

/* What feedback of a frame is about. */
typedef struct record {
    uint64_t number; /* 0: done */
    entry *entries;
    refined *refined;
    size_t entry_count, entry_cap, refined_count, refined_cap;
} record;

struct pbs_cut {
    pbs_run *run;
    pbs_cut_scene scene;
    bool *refines;       /* everything below the node has something to draw */
    double *pad;         /* how far discs reach out of the node's box, its unit */
    uint32_t *need_slot; /* of each item: 1 + its place in needs, 0: none */
    pbs_hidden hidden;
    record records[RECORDS];
    uint64_t number;
    task *tasks;
    size_t task_count, task_cap;
    pbs_cut_draw *draws;
    size_t draw_count, draw_cap;
    pbs_cut_need *needs;
    size_t need_count, need_cap;
    /* of this frame */
    const pbs_cut_view *view;
    pbs_eyes eyes;
    record *record;
    uint64_t culled, steps;
};

/* ---- what never changes ---- */

/* Whether a node shows itself: with its own data, or through everything below it. */
static bool covers(const pbs_cut *c, uint32_t node) {
    return c->scene.has[node] || c->refines[node] || !c->scene.nodes[node].triangles;
}

static void look_below(pbs_cut *c) {
    const pbs_cut_scene *s = &c->scene;
    for (size_t i = 0; i < s->node_count; i++) {
        const pbs_node *n = &s->nodes[i];
        bool all = n->child_count || s->has[i] & PBS_HAS_MESH;
        double pad = s->has[i] & PBS_HAS_SURFELS ? fmax(0, n->covering) : 0;
        for (uint32_t k = 0; k < n->child_count; k++) {
            const pbs_child *child = &n->children[k];
            all = all && covers(c, child->node);
            pad = fmax(pad, pbs_lod_stretch(child->m) * c->pad[child->node]);
        }
        c->refines[i] = all;
        c->pad[i] = pad;
    }
}

pbs_code pbs_cut_new(pbs_run *run, const pbs_cut_scene *scene, pbs_cut **out, pbs_err *err) {
    const char *what = "the table of nodes";
    size_t n = scene->node_count;
    pbs_cut *c;
    *out = NULL;
    pbs_code rc = pbs_alloc(run, &c, 1, sizeof *c, what, err);
    if (rc) return rc;
    memset(c, 0, sizeof *c);
    c->run = run;
    c->scene = *scene;
    rc = pbs_alloc(run, &c->refines, n, sizeof *c->refines, what, err);
    if (!rc) rc = pbs_alloc(run, &c->pad, n, sizeof *c->pad, what, err);
    if (!rc) rc = pbs_alloc(run, &c->need_slot, 2 * n, sizeof *c->need_slot, what, err);
    if (rc) {
        pbs_cut_free(c);
        return rc;
    }
    memset(c->need_slot, 0, 2 * n * sizeof *c->need_slot);
    look_below(c);
    *out = c;
    return PBS_OK;
}

void pbs_cut_free(pbs_cut *c) {
    if (!c) return;
    for (int i = 0; i < RECORDS; i++) {
        pbs_free(c->run, c->records[i].entries);
        pbs_free(c->run, c->records[i].refined);
    }
    pbs_hidden_free(c->run, &c->hidden);
    pbs_free(c->run, c->refines);
    pbs_free(c->run, c->pad);
    pbs_free(c->run, c->need_slot);
    pbs_free(c->run, c->tasks);
    pbs_free(c->run, c->draws);
    pbs_free(c->run, c->needs);
    pbs_free(c->run, c);
}

/* ---- lists ---- */

static uint64_t child_key(uint64_t key, uint32_t i) {
    uint64_t x = key + (i + 1) * 0x9e3779b97f4a7c15u;
    x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9u;
    x = (x ^ x >> 27) * 0x94d049bb133111ebu;
    x ^= x >> 31;
    return x ? x : 1;
}

static pbs_code add_task(pbs_cut *c, const task *t, pbs_err *err) {
    pbs_code rc = pbs_grow(c->run, &c->tasks, &c->task_cap, c->task_count + 1, sizeof *c->tasks,
                           "the hierarchy", err);
    if (!rc) c->tasks[c->task_count++] = *t;
    return rc;
}

/* as: what the children's tasks have in common; its m is the parent's. */
static pbs_code add_children(pbs_cut *c, const task *as, pbs_err *err) {
    const pbs_node *n = &c->scene.nodes[as->node];
    pbs_code rc = PBS_OK;
    for (uint32_t i = 0; i < n->child_count && !rc; i++) {
        const pbs_child *child = &n->children[i];
        task t = *as;
        if (!c->scene.placings[child->node]) continue;
        if (++c->steps % 4096 == 0 && (rc = pbs_run_check(c->run, err))) break;
        t.node = child->node;
        t.moves = child->flags & PBS_CHILD_MOVES;
        t.key = child_key(as->key, i);
        pbs_xform_mul(t.m, as->m, pbs_pose_of(c->view->pose, child));
        rc = add_task(c, &t, err);
    }
    return rc;
}

static pbs_code add_draw(pbs_cut *c, const task *t, const pbs_cut_draw *draw, pbs_err *err) {
    pbs_code rc = pbs_grow(c->run, &c->draws, &c->draw_cap, c->draw_count + 1, sizeof *c->draws,
                           "the list of what is drawn", err);
    if (rc) return rc;
    pbs_cut_draw *d = &c->draws[c->draw_count];
    *d = *draw;
    d->node = t->node;
    d->parent = t->parent;
    d->order = (uint32_t)c->draw_count++;
    d->key = t->key;
    memcpy(d->m, t->m, sizeof d->m);
    return PBS_OK;
}

/* Says that an item is needed, and whether it is there. */
static pbs_code need(pbs_cut *c, uint32_t item, uint32_t level, double depth, bool *there,
                     pbs_err *err) {
    uint32_t at = c->need_slot[item];
    *there = c->scene.resident[item];
    if (at) {
        pbs_cut_need *n = &c->needs[at - 1];
        n->level = level < n->level ? level : n->level;
        n->depth = fmin(depth, n->depth);
        return PBS_OK;
    }
    pbs_code rc = pbs_grow(c->run, &c->needs, &c->need_cap, c->need_count + 1, sizeof *c->needs,
                           "the list of what is needed", err);
    if (rc) return rc;
    c->needs[c->need_count++] = (pbs_cut_need){item, level, depth};
    c->need_slot[item] = (uint32_t)c->need_count;
    return PBS_OK;
}

static pbs_code add_refined(pbs_cut *c, const task *t, uint32_t *out, pbs_err *err) {
    record *r = c->record;
    pbs_code rc = pbs_grow(c->run, &r->refined, &r->refined_cap, r->refined_count + 1,
                           sizeof *r->refined, "the list of what is drawn", err);
    if (rc) return rc;
    *out = (uint32_t)r->refined_count;
    r->refined[r->refined_count++] = (refined){.key = t->key, .parent = t->parent};
    if (t->parent != NONE) r->refined[t->parent].open = true;
    return PBS_OK;
}

/* ---- the walk ---- */

static bool visible(const pbs_cut *c, const task *t) {
    const pbs_node *n = &c->scene.nodes[t->node];
    return pbs_eyes_see(&c->eyes, &n->box, c->pad[t->node], t->m);
}

static double depth_of(const pbs_cut *c, const task *t) {
    return pbs_eyes_depth(&c->eyes, &c->scene.nodes[t->node].box, t->m);
}

/* Radius of a disc that has the view's size there, node's unit. */
static double wanted_of(const pbs_cut *c, const task *t, double depth) {
    double size = pbs_eyes_size(&c->eyes, c->view->size, &c->scene.nodes[t->node].box, t->m);
    return pbs_cut_wanted(&c->view->camera, c->view->height, depth, size, t->m);
}

/* Whether all is there that would be drawn in the place of the node; asks for it in any case. */
static pbs_code below_is_there(pbs_cut *c, const task *t, bool *all, pbs_err *err) {
    size_t base = c->task_count;
    bool there;
    task as = *t, k;
    as.level++;
    *all = true;
    pbs_code rc = PBS_OK;
    if (c->scene.has[t->node] & PBS_HAS_MESH) {
        rc = need(c, PBS_ITEM_MESH(t->node), as.level, depth_of(c, t), &there, err);
        *all = there;
    }
    if (!rc) rc = add_children(c, &as, err);
    while (!rc && c->task_count > base) {
        k = c->tasks[--c->task_count];
        uint8_t has = c->scene.has[k.node];
        if (k.moves || !visible(c, &k)) continue;
        if (has) {
            uint32_t item = has == PBS_HAS_MESH ? PBS_ITEM_MESH(k.node) : PBS_ITEM_OWN(k.node);
            rc = need(c, item, k.level, depth_of(c, &k), &there, err);
            *all = *all && there;
        }
        if (!rc && !(has & ~PBS_HAS_MESH)) rc = add_children(c, &k, err);
    }
    c->task_count = base;
    return rc;
}

static pbs_code draw_mesh(pbs_cut *c, const task *t, uint32_t level, bool *there, pbs_err *err) {
    double depth = depth_of(c, t);
    pbs_code rc = need(c, PBS_ITEM_MESH(t->node), level, depth, there, err);
    if (rc || !*there) return rc;
    return add_draw(c, t, &(pbs_cut_draw){.kind = PBS_CUT_MESH, .depth = depth}, err);
}

/* A node whose points stay when its children are drawn (cloudpack.h). All of them together close
 * the surface: discs are as large as the camera allows, of points half as far apart, but not
 * smaller than points of the cloud usually are apart. Children come when all its points do. */
static pbs_code draw_adding(pbs_cut *c, const task *t, double depth, double wanted, pbs_err *err) {
    const pbs_node *n = &c->scene.nodes[t->node];
    const pbs_profile *p = c->scene.profile[t->node];
    uint64_t fixed = c->view->prefix;
    pbs_cut_draw d = {.kind = PBS_CUT_SURFELS, .depth = depth};
    d.prefix =
        fixed ? (fixed < p->count ? (uint32_t)fixed : p->count) : pbs_profile_adding(p, wanted / 2);
    d.radius = fmax(fixed ? 0 : wanted, n->covering);
    pbs_code rc = d.prefix ? add_draw(c, t, &d, err) : PBS_OK;
    bool finer = fixed ? fixed > p->count : d.prefix == p->count;
    task as = *t;
    as.level++;
    return rc || !finer ? rc : add_children(c, &as, err);
}

/* With a prefix that the user wants discs close the surface whatever it costs in shape; without,
 * they are as large as the camera allows and the prefix is what closes the surface then. */
static void choose(const pbs_cut *c, uint32_t node, double wanted, pbs_cut_draw *d, double *all) {
    const pbs_node *n = &c->scene.nodes[node];
    const pbs_profile *p = c->scene.profile[node];
    uint64_t fixed = c->view->prefix;
    bool formula = c->view->formula && n->median_count;
    if (fixed)
        d->prefix = fixed < p->count ? (uint32_t)fixed : p->count;
    else
        d->prefix = formula ? pbs_formula_prefix(n, wanted) : pbs_profile_prefix(p, wanted);
    d->radius = formula ? pbs_formula_radius(n, d->prefix) : pbs_profile_radius(p, d->prefix);
    *all = formula ? pbs_formula_radius(n, p->count) : pbs_profile_radius(p, p->count);
}

static uint32_t part_of(double share, uint32_t prefix) {
    return share < 1 ? (uint32_t)ceil(share * prefix) : prefix;
}

/* A node that is there and in the picture. */
static pbs_code draw_surfels(pbs_cut *c, const task *t, double depth, double wanted, bool *below,
                             pbs_err *err) {
    pbs_cut_draw d = {.kind = PBS_CUT_SURFELS, .depth = depth};
    double all, share = t->share;
    task as = *t;
    pbs_code rc = PBS_OK;
    choose(c, t->node, wanted, &d, &all);
    *below = !c->view->prefix && wanted < all && c->refines[t->node];
    if (*below) {
        bool complete;
        rc = below_is_there(c, t, &complete, err);
        double gone = fmin(1, (1 - wanted / all) / (1 - BLENDED)); /* how far the blending is */
        if (complete) share *= fmin(1, 2 - 2 * gone);
        as.share = t->share * fmin(1, 2 * gone);
        as.level++;
        *below = complete || c->view->partial;
        if (!rc && *below) rc = add_children(c, &as, err);
        bool there;
        if (!rc && *below && c->scene.has[t->node] & PBS_HAS_MESH)
            rc = draw_mesh(c, t, as.level, &there, err);
    }
    d.prefix = part_of(share, d.prefix);
    return rc || !d.prefix ? rc : add_draw(c, t, &d, err);
}

static pbs_code visit_surfels(pbs_cut *c, const task *t, pbs_err *err) {
    const pbs_node *n = &c->scene.nodes[t->node];
    bool there = false, below = false, seen = visible(c, t);
    double depth = depth_of(c, t);
    pbs_code rc = PBS_OK;
    c->culled += !seen;
    if (seen) rc = need(c, PBS_ITEM_OWN(t->node), t->level, depth, &there, err);
    if (!rc && there) {
        double wanted = wanted_of(c, t, depth);
        if (n->flags & PBS_NODE_ADDS) return draw_adding(c, t, depth, wanted, err);
        rc = draw_surfels(c, t, depth, wanted, &below, err);
    }
    if (rc || below || !c->scene.moving[t->node]) return rc;
    task as = *t;
    as.covered = true;
    return add_children(c, &as, err);
}

static bool has_finer_voxels(const pbs_cut *c, const pbs_node *n) {
    for (uint32_t i = 0; i < n->child_count; i++)
        if (!(c->scene.has[n->children[i].node] & PBS_HAS_VOXELS)) return false;
    return n->child_count != 0;
}

/* Children in the place of their parent. */
static pbs_code refine_voxels(pbs_cut *c, const task *t, bool *done, pbs_err *err) {
    bool complete;
    task as = *t;
    pbs_code rc = below_is_there(c, t, &complete, err);
    *done = complete || c->view->partial;
    if (rc || !*done) return rc;
    rc = add_refined(c, t, &as.parent, err);
    if (!rc && !complete) c->record->refined[as.parent].open = true;
    as.level++;
    return rc ? rc : add_children(c, &as, err);
}

static pbs_code visit_voxels(pbs_cut *c, const task *t, pbs_err *err) {
    const pbs_node *n = &c->scene.nodes[t->node];
    bool there, done = false;
    if (!visible(c, t)) {
        c->culled++;
        return PBS_OK;
    }
    pbs_cut_draw d = {.kind = PBS_CUT_VOXELS, .depth = depth_of(c, t)};
    pbs_code rc = need(c, PBS_ITEM_OWN(t->node), t->level, d.depth, &there, err);
    if (rc || !there) return rc;
    double size = pbs_eyes_size(&c->eyes, c->view->size, &n->box, t->m);
    if (!pbs_cut_fine(&c->view->camera, c->view->height, d.depth, size, n->lattice, t->m)) {
        bool finer = has_finer_voxels(c, n);
        if (finer && c->view->occlusion && pbs_hidden_has(&c->hidden, t->key))
            d.kind = PBS_CUT_PROBE;
        else if (finer)
            rc = refine_voxels(c, t, &done, err);
        else if (c->scene.has[t->node] & PBS_HAS_MESH)
            rc = draw_mesh(c, t, t->level + 1, &done, err);
    }
    return rc || done ? rc : add_draw(c, t, &d, err);
}

static pbs_code visit(pbs_cut *c, task *t, pbs_err *err) {
    uint8_t has = c->scene.has[t->node];
    if (t->moves) t->covered = false, t->share = 1;
    if (t->covered) return c->scene.moving[t->node] ? add_children(c, t, err) : PBS_OK;
    if (has & PBS_HAS_VOXELS) return visit_voxels(c, t, err);
    if (has & PBS_HAS_SURFELS) return visit_surfels(c, t, err);
    if (!c->scene.moving[t->node] && !visible(c, t)) {
        c->culled++;
        return PBS_OK;
    }
    bool there;
    pbs_code rc = has & PBS_HAS_MESH ? draw_mesh(c, t, t->level, &there, err) : PBS_OK;
    return rc ? rc : add_children(c, t, err);
}

/* ---- a frame ---- */

static int compare(double a, double b) {
    return (a > b) - (a < b);
}

static int by_kind_and_depth(const void *x, const void *y) {
    const pbs_cut_draw *a = x, *b = y;
    if (a->kind != b->kind) return a->kind < b->kind ? -1 : 1;
    int order = compare(a->depth, b->depth);
    return order ? order : (a->order > b->order) - (a->order < b->order);
}

static int by_priority(const void *x, const void *y) {
    const pbs_cut_need *a = x, *b = y;
    if (a->level != b->level) return a->level < b->level ? -1 : 1;
    int order = compare(a->depth, b->depth);
    return order ? order : (a->item > b->item) - (a->item < b->item);
}

static void start(pbs_cut *c, const pbs_cut_view *view) {
    for (size_t i = 0; i < c->need_count; i++) c->need_slot[c->needs[i].item] = 0;
    c->need_count = c->draw_count = c->task_count = 0;
    c->culled = 0;
    c->view = view;
    if (view->eyes)
        c->eyes = *view->eyes;
    else
        pbs_eyes_of(&c->eyes, &view->camera, view->width, view->height, 0, 0, NULL, NULL);
    c->record = &c->records[++c->number % RECORDS];
    c->record->number = 0;
    c->record->entry_count = c->record->refined_count = 0;
}

/* Keeps of the draws what feedback is about, in their order. */
static pbs_code keep_entries(pbs_cut *c, pbs_err *err) {
    record *r = c->record;
    pbs_code rc = pbs_grow(c->run, &r->entries, &r->entry_cap, c->draw_count, sizeof *r->entries,
                           "the list of what is drawn", err);
    if (rc) return rc;
    for (size_t i = 0; i < c->draw_count; i++) {
        const pbs_cut_draw *d = &c->draws[i];
        r->entries[i] = (entry){d->parent, d->kind == PBS_CUT_VOXELS || d->kind == PBS_CUT_PROBE,
                                d->kind == PBS_CUT_PROBE ? d->key : 0};
    }
    r->entry_count = c->draw_count;
    r->number = c->number;
    return PBS_OK;
}

static void describe(const pbs_cut *c, pbs_cut_frame *out) {
    *out = (pbs_cut_frame){.number = c->number,
                           .draws = c->draws,
                           .draw_count = c->draw_count,
                           .needs = c->needs,
                           .need_count = c->need_count,
                           .culled = c->culled};
    for (size_t i = 0; i < c->draw_count; i++) {
        const pbs_cut_draw *d = &c->draws[i];
        out->first[d->kind + 1]++;
        out->surfels += d->prefix;
        out->hidden += d->kind == PBS_CUT_PROBE;
    }
    for (int k = 0; k < PBS_CUT_KINDS; k++) out->first[k + 1] += out->first[k];
    for (size_t i = 0; i < c->need_count; i++) out->missing += !c->scene.resident[c->needs[i].item];
}

pbs_code pbs_cut_next(pbs_cut *c, const pbs_cut_view *view, pbs_cut_frame *out, pbs_err *err) {
    start(c, view);
    task root = {.node = (uint32_t)c->scene.node_count - 1, .parent = NONE, .share = 1, .key = 1};
    memcpy(root.m, PBS_IDENTITY, sizeof root.m);
    pbs_code rc = c->scene.placings[root.node] ? add_task(c, &root, err) : PBS_OK;
    while (!rc && c->task_count) {
        task t = c->tasks[--c->task_count];
        rc = visit(c, &t, err);
    }
    if (rc) return rc;
    if (c->draw_count) qsort(c->draws, c->draw_count, sizeof *c->draws, by_kind_and_depth);
    if (c->need_count) qsort(c->needs, c->need_count, sizeof *c->needs, by_priority);
    for (size_t i = 0; i < c->need_count; i++) c->need_slot[c->needs[i].item] = (uint32_t)i + 1;
    rc = keep_entries(c, err);
    if (!rc) describe(c, out);
    return rc;
}

pbs_code pbs_cut_feedback(pbs_cut *c, uint64_t frame, const uint32_t *seen, size_t count,
                          pbs_err *err) {
    record *r = &c->records[frame % RECORDS];
    pbs_code rc = PBS_OK;
    if (!frame || r->number != frame || count < r->entry_count) return PBS_OK;
    r->number = 0;
    for (size_t i = 0; i < r->entry_count; i++) {
        const entry *e = &r->entries[i];
        if (e->probe && seen[i]) pbs_hidden_remove(&c->hidden, e->probe);
        if (e->parent == NONE) continue;
        r->refined[e->parent].drawn = true;
        r->refined[e->parent].seen |= seen[i] || !e->voxels;
    }
    if (c->hidden.count > MOST_HIDDEN) pbs_hidden_clear(&c->hidden);
    for (size_t i = 0; i < r->refined_count && !rc; i++) {
        const refined *f = &r->refined[i];
        if (f->drawn && !f->seen && !f->open) rc = pbs_hidden_add(c->run, &c->hidden, f->key, err);
    }
    return rc;
}
