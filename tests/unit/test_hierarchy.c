/* The plan of a scene's surfels on random hierarchies: who has some, and every triangle that does
 * not move is in a node's picture exactly once, drawn or in the surfels of one below. Surfels that
 * are kept come back; candidates from below lie where they should. */
#include "formats/surfels/below.h"
#include "formats/scene/dag.h"
#include "formats/surfels/hierarchy.h"
#include "tests/unit/scenes.h"
#include "tests/check.h"

/* A wavy sheet of 2 n n triangles, 1 long; different ones with another `wave`. */
static uint32_t add_sheet(const maker *m, int n, double wave) {
    uint32_t node;
    const double origin[3] = {0.5, 0.25, 0};
    static const int at[6][2] = {{0, 0}, {1, 0}, {0, 1}, {1, 0}, {1, 1}, {0, 1}};
    must(m->s->part_begin(m->s->ctx, "sheet", origin, 0, &err), &err);
    for (int q = 0; q < n * n; q++)
        for (int t = 0; t < 2; t++) {
            pbs_corner c[3];
            memset(c, 0, sizeof c);
            for (int i = 0; i < 3; i++) {
                double x = (q % n + at[3 * t + i][0]) / (double)n;
                double y = (q / n + at[3 * t + i][1]) / (double)n;
                c[i].position[0] = x, c[i].position[1] = y;
                c[i].position[2] = wave * sin(9 * x) * sin(7 * y);
            }
            must(m->s->triangle(m->s->ctx, c, PBS_NONE, &err), &err);
        }
    must(m->s->part_end(m->s->ctx, &node, &err), &err);
    return node;
}

static uint32_t add_empty(const maker *m) {
    uint32_t node;
    const double origin[3] = {0};
    must(m->s->part_begin(m->s->ctx, "none", origin, 0, &err), &err);
    must(m->s->part_end(m->s->ctx, &node, &err), &err);
    return node;
}

/* ---- a plan and its other side ---- */

typedef struct planned {
    pbs_scene s;
    pbs_plan plan;
    pbs_node *nodes; /* as pbs-sample gets them */
    uint64_t *used, *still;
    pbs_draw *draws;
    size_t cap;
} planned;

static const pbs_lod small_lod = {50, 0.5, 2000, 0, 0};
static const pbs_gbuffer_params corners = {0};

static pbs_code make_plan(planned *p, const pbs_lod *lod, bool top_down) {
    pbs_code rc = pbs_plan_make(&p->s, lod, &corners, top_down, &p->plan, &err);
    size_t n = p->s.node_count;
    p->nodes = calloc(n, sizeof *p->nodes);
    p->used = calloc(n, sizeof *p->used);
    p->still = calloc(n, sizeof *p->still);
    p->draws = NULL, p->cap = 0;
    for (size_t i = 0; i < n && !rc; i++) {
        const pbs_planned *from = &p->plan.nodes[i];
        pbs_node *to = &p->nodes[i];
        *to = p->s.nodes[i];
        to->wanted = from->wanted, to->pixel = from->pixel, to->box = from->box;
        to->flags = from->flags;
        memcpy(to->origin, from->origin, sizeof to->origin);
        p->used[i] = to->wanted != 0;
        for (size_t k = p->s.first_mesh[i]; k < p->s.first_mesh[i + 1]; k++)
            p->still[i] += p->s.meshes[k].triangles;
        for (uint32_t k = 0; k < to->child_count; k++) {
            if (to->children[k].flags & PBS_CHILD_MOVES) continue;
            p->used[i] += p->used[to->children[k].node];
            p->still[i] += p->still[to->children[k].node];
        }
    }
    return rc;
}

static void drop_plan(planned *p) {
    pbs_plan_free(&run, &p->plan);
    pbs_free(&run, p->draws);
    free(p->nodes), free(p->used), free(p->still);
}

static void close_scene(planned *p) {
    drop_plan(p);
    pbs_scene_close(&p->s);
    CHECK(pbs_mem_used(&run) == 0);
}

/* What a picture has of every mesh: how often, and the sum of the matrices. */
typedef struct tally {
    planned *p;
    uint32_t node;
    uint64_t count[64];
    double sum[64][12];
    uint64_t placings, triangles;
    double m[12]; /* of what is walked */
    const double *from;
    uint32_t *stood; /* how often each node stands for itself */
} tally;

static void tally_mesh(tally *t, const pbs_mesh *mesh, const double m[12]) {
    size_t k = (size_t)(mesh - t->p->s.meshes);
    if (k >= 64) abort();
    t->count[k]++;
    t->triangles += mesh->triangles;
    for (int i = 0; i < 12; i++) t->sum[k][i] += m[i];
}

/* Every mesh that does not move, one by one. */
static pbs_code tally_node(void *ctx, uint32_t node, const double m[12], uint32_t flags,
                           bool *descend, pbs_err *e) {
    tally *t = ctx;
    const pbs_scene *s = &t->p->s;
    double to[12], origin[12];
    (void)e;
    *descend = !(flags & PBS_CHILD_MOVES) && t->p->still[node];
    if (!*descend) return PBS_OK;
    memcpy(origin, PBS_IDENTITY, sizeof origin);
    for (int k = 0; k < 3; k++) origin[4 * k + 3] = s->nodes[node].origin[k];
    pbs_xform_mul(to, m, origin);
    if (t->from)
        for (int k = 0; k < 3; k++) to[4 * k + 3] -= t->from[k];
    else
        pbs_xform_mul(to, t->m, to);
    for (size_t i = s->first_mesh[node]; i < s->first_mesh[node + 1]; i++)
        tally_mesh(t, &s->meshes[i], to);
    return PBS_OK;
}

/* m takes the frame of the points below; what is walked is in the node's coordinates. */
static pbs_code tally_below(void *ctx, uint32_t below, const double m[12], pbs_err *e) {
    tally *t = ctx;
    double back[12];
    memcpy(back, PBS_IDENTITY, sizeof back);
    for (int k = 0; k < 3; k++) back[4 * k + 3] = -t->p->nodes[below].origin[k];
    pbs_xform_mul(t->m, m, back);
    t->from = NULL;
    t->placings++;
    t->stood[below]++;
    CHECK(below < t->node && t->p->nodes[below].wanted);
    CHECK(t->p->plan.nodes[below].flags & PBS_NODE_USED);
    CHECK(pbs_lod_fine(&t->p->nodes[below].box, t->p->nodes[below].pixel, m,
                       t->p->nodes[t->node].pixel));
    return pbs_dag_walk(&run, t->p->s.nodes, below + 1, tally_node, t, e);
}

static void check_same(const tally *a, const tally *b, double scale) {
    CHECK(a->triangles == b->triangles && !memcmp(a->count, b->count, sizeof a->count));
    for (size_t k = 0; k < a->p->s.mesh_count; k++)
        for (int i = 0; i < 12; i++)
            if (!(fabs(a->sum[k][i] - b->sum[k][i]) <= 1e-9 * scale * (double)(1 + a->count[k]))) {
                CHECK_NUM(!"placed alike", a->sum[k][i] - b->sum[k][i]);
                return;
            }
}

/* Returns how many placings stand for something. */
static uint64_t check_picture(planned *p, uint32_t node, uint32_t *stood) {
    static tally all, seen;
    size_t count;
    uint64_t triangles;
    memset(&all, 0, sizeof all), memset(&seen, 0, sizeof seen);
    all.p = seen.p = p, all.node = seen.node = node, seen.stood = stood;
    all.from = p->nodes[node].origin;
    must(pbs_dag_walk(&run, p->s.nodes, node + 1, tally_node, &all, &err), &err);
    must(pbs_plan_draws(&p->s, &p->plan, node, &p->draws, &p->cap, &count, &triangles, &err), &err);
    for (size_t i = 0; i < count; i++) tally_mesh(&seen, p->draws[i].mesh, p->draws[i].m);
    CHECK(triangles == seen.triangles);
    if (p->nodes[node].flags & PBS_NODE_BELOW)
        must(pbs_plan_below(&run, p->nodes, p->used, node, tally_below, &seen, &err), &err);
    CHECK(all.triangles == p->still[node]);
    check_same(&all, &seen, 100);
    CHECK(p->nodes[node].flags & PBS_NODE_BELOW || !seen.placings);
    return seen.placings;
}

/* ---- who is to have surfels ---- */

static const pbs_child *only_child(const planned *p, uint32_t node) {
    const pbs_child *only = NULL;
    int n = 0;
    if (p->s.first_mesh[node] != p->s.first_mesh[node + 1]) return NULL;
    for (uint32_t i = 0; i < p->nodes[node].child_count; i++) {
        const pbs_child *c = &p->nodes[node].children[i];
        if (!(c->flags & PBS_CHILD_MOVES) && p->still[c->node]) only = c, n++;
    }
    return n == 1 ? only : NULL;
}

static bool is_top(const planned *p, uint32_t node) {
    uint32_t root = (uint32_t)p->s.node_count - 1;
    for (const pbs_child *c; (c = only_child(p, root));) root = c->node;
    if (node == root) return p->still[node];
    for (size_t i = 0; i < p->s.node_count; i++)
        for (uint32_t k = 0; k < p->nodes[i].child_count; k++) {
            uint32_t at = p->nodes[i].children[k].node;
            if (!(p->nodes[i].children[k].flags & PBS_CHILD_MOVES)) continue;
            for (const pbs_child *c; (c = only_child(p, at));) at = c->node;
            if (at == node) return p->still[node];
        }
    return false;
}

static void check_who(const planned *p, const pbs_lod *lod) {
    size_t wanted = 0;
    for (uint32_t i = 0; i < p->s.node_count; i++) {
        bool top = is_top(p, i);
        uint32_t n = !top && only_child(p, i) ? 0 : pbs_lod_count(lod, p->still[i], top);
        const pbs_planned *q = &p->plan.nodes[i];
        CHECK_NUM(q->wanted == n, i);
        CHECK(!q->wanted == !(q->pixel > 0) && (q->wanted || !q->flags));
        CHECK(!q->wanted || q->resolution == pbs_lod_resolution(lod, n, 0));
        wanted += q->wanted != 0;
    }
    CHECK(p->plan.wanted == wanted);
}

typedef struct boxing {
    const planned *p;
    pbs_box box;
} boxing;

static pbs_code box_node(void *ctx, uint32_t node, const double m[12], uint32_t flags,
                         bool *descend, pbs_err *e) {
    boxing *b = ctx;
    const pbs_scene *s = &b->p->s;
    (void)e;
    *descend = !(flags & PBS_CHILD_MOVES);
    for (size_t i = s->first_mesh[node]; *descend && i < s->first_mesh[node + 1]; i++)
        for (uint32_t v = 0; v < s->meshes[i].vertices; v++) {
            double q[3];
            for (int k = 0; k < 3; k++)
                q[k] = s->nodes[node].origin[k] + s->meshes[i].position[3 * v + (uint32_t)k];
            pbs_xform_point(q, m, q);
            pbs_box_add(&b->box, q);
        }
    return PBS_OK;
}

static void check_boxes(const planned *p) {
    for (uint32_t i = 0; i < p->s.node_count; i++) {
        const pbs_planned *q = &p->plan.nodes[i];
        boxing b = {p, PBS_BOX_EMPTY};
        if (!q->wanted) continue;
        must(pbs_dag_walk(&run, p->s.nodes, i + 1, box_node, &b, &err), &err);
        for (int k = 0; k < 3; k++) {
            double eps = 1e-11 * (b.box.max[k] - b.box.min[k] + fabs(b.box.max[k]));
            CHECK(fabs(q->seen.min[k] + q->origin[k] - b.box.min[k]) <= eps &&
                  fabs(q->seen.max[k] + q->origin[k] - b.box.max[k]) <= eps);
            CHECK(q->box.min[k] <= b.box.min[k] + eps && q->box.max[k] >= b.box.max[k] - eps);
        }
    }
}

/* All laws; returns how many placings stand for something. */
static uint64_t check_plan(planned *p, const pbs_lod *lod, bool top_down) {
    must(make_plan(p, lod, top_down), &err);
    uint32_t *stood = calloc(p->s.node_count, sizeof *stood);
    uint64_t n = 0;
    check_who(p, lod);
    check_boxes(p);
    for (uint32_t i = 0; i < p->s.node_count; i++)
        if (p->plan.nodes[i].wanted) {
            uint64_t here = check_picture(p, i, stood);
            CHECK(!(p->plan.nodes[i].flags & PBS_NODE_BELOW) == !here);
            n += here;
        }
    for (uint32_t i = 0; i < p->s.node_count; i++)
        CHECK(!(p->plan.nodes[i].flags & PBS_NODE_USED) == !stood[i]);
    CHECK(!top_down || !n);
    free(stood);
    return n;
}

static double any(uint64_t *seed, double from, double to) {
    return from + (to - from) * random_bits(seed) / 4294967296.0;
}

static void random_transform(uint64_t *seed, double m[12]) {
    double a = any(seed, 0, 6.3), scale = pow(2, any(seed, -1, 1));
    memcpy(m, PBS_IDENTITY, 12 * sizeof *m);
    m[0] = scale * cos(a), m[1] = -scale * sin(a), m[4] = scale * sin(a), m[5] = scale * cos(a);
    m[10] = random_bits(seed) % 4 ? scale : -scale;
    if (random_bits(seed) % 8 == 0) m[2] = 0.7;
    for (int k = 0; k < 3; k++) m[4 * k + 3] = any(seed, -5, 5);
}

static uint32_t random_scene(maker *m, uint64_t seed) {
    uint32_t node[24], n = 0;
    while (n < 5) node[n] = add_sheet(m, 1 + (int)(random_bits(&seed) % 25), any(&seed, 0, 1)), n++;
    node[n++] = add_empty(m);
    while (n < 24) {
        pbs_child c[5];
        size_t count = 1 + random_bits(&seed) % 5;
        if (random_bits(&seed) % 4 == 0) count = 1;
        for (size_t i = 0; i < count; i++) {
            /* rather one of the last few, so that it gets deep */
            uint32_t back = random_bits(&seed) % (random_bits(&seed) % 2 ? 4 : n);
            c[i] = child_at(node[n - 1 - back], 0, 1, random_bits(&seed) % 9 == 0);
            random_transform(&seed, c[i].m);
        }
        node[n++] = add_assembly(m, c, count);
    }
    return add_pair(m, child_at(node[n - 1], 0, 1, seed % 3 == 0),
                    child_at(node[0], 9, 1, seed % 5 == 0));
}

/* Nodes that fail are left out: the pictures of the others stay whole. */
static void check_failures(planned *p, uint64_t seed) {
    uint32_t *stood = calloc(p->s.node_count, sizeof *stood);
    for (uint32_t i = 0; i < p->s.node_count; i++) {
        if (random_bits(&seed) % 3 == 0) {
            p->plan.nodes[i].wanted = p->plan.nodes[i].flags = 0;
            p->nodes[i].wanted = p->nodes[i].flags = 0;
        }
        p->used[i] = p->nodes[i].wanted != 0;
        for (uint32_t k = 0; k < p->nodes[i].child_count; k++)
            if (!(p->nodes[i].children[k].flags & PBS_CHILD_MOVES))
                p->used[i] += p->used[p->nodes[i].children[k].node];
        if (p->nodes[i].wanted) check_picture(p, i, stood);
    }
    free(stood);
}

TEST(random_hierarchies) {
    uint64_t stood = 0, tops = 0;
    for (uint64_t seed = 1; seed <= 60; seed++) {
        maker m = new_scene();
        uint32_t root = random_scene(&m, seed);
        planned p = {.s = reopen(&m, root)};
        if (p.s.nodes[p.s.node_count - 1].triangles < 100000) {
            stood += check_plan(&p, &small_lod, false);
            for (uint32_t i = 0; i < p.s.node_count; i++) tops += is_top(&p, i);
            check_failures(&p, seed);
            drop_plan(&p);
            check_plan(&p, &small_lod, true);
            drop_plan(&p);
            check_plan(&p, &PBS_LOD_DEFAULT, false);
        }
        close_scene(&p);
    }
    CHECK_NUM(stood > 500, stood);
    CHECK_NUM(tops > 80, tops);
}

/* ---- the rules, one by one ---- */

TEST(wrappers_and_groups) {
    maker m = new_scene();
    uint32_t large = add_sheet(&m, 40, 0.1), small = add_sheet(&m, 10, 0.2); /* 3200, 200 */
    uint32_t wrap = add_assembly(&m, (pbs_child[]){child_at(large, 3, 2, false)}, 1);
    pbs_child c[6] = {child_at(wrap, 0, 1, false)};
    for (int i = 1; i < 6; i++) c[i] = child_at(small, i, 1, false);
    uint32_t group = add_assembly(&m, c + 1, 5); /* 1000 */
    c[1] = child_at(group, 0, 1, false);
    uint32_t two = add_assembly(&m, c, 2);
    planned p = {.s = reopen(&m, add_assembly(&m, (pbs_child[]){child_at(two, 0, 1, false)}, 1))};
    check_plan(&p, &PBS_LOD_DEFAULT, false);
    const pbs_planned *n = p.plan.nodes;
    CHECK(n[large].wanted == 1600 && !n[small].wanted && !n[wrap].wanted);
    CHECK(n[group].wanted == 500 && n[two].wanted == 200000 && !n[two + 1].wanted);
    CHECK(p.plan.root == two && p.plan.wanted == 3 && p.s.node_count == 6);
    CHECK(n[group].resolution == 71 && n[two].resolution == 1415);
    close_scene(&p);
}

/* Kept apart, at any depth, also inside of another one that moves. */
TEST(what_moves) {
    maker m = new_scene();
    uint32_t a = add_sheet(&m, 30, 0.1), b = add_sheet(&m, 20, 0.2), c = add_sheet(&m, 5, 0.3);
    uint32_t arm = add_pair(&m, child_at(b, 0, 1, false), child_at(c, 100, 1, true));
    uint32_t base = add_pair(&m, child_at(a, 0, 1, false), child_at(arm, 1e6, 1, true));
    planned p = {
        .s = reopen(&m, add_pair(&m, child_at(base, 0, 1, false), child_at(a, 2, 1, false)))};
    check_plan(&p, &PBS_LOD_DEFAULT, false);
    const pbs_planned *n = p.plan.nodes;
    uint32_t root = (uint32_t)p.s.node_count - 1;
    CHECK(n[root].wanted == 200000 && n[b].wanted == 200000 && n[c].wanted == 200000);
    CHECK(n[a].wanted == 900 && !n[base].wanted && !n[arm].wanted);
    CHECK(fabs(n[root].seen.max[0] + n[root].origin[0] - 3) < 1e-9);
    CHECK(n[root].box.max[0] > 1e6 + 100);
    CHECK(n[root].pixel < 0.01 && p.still[root] == 3600);
    close_scene(&p);
    /* everything moves */
    m = new_scene();
    a = add_sheet(&m, 30, 0.1);
    p.s = reopen(&m, add_assembly(&m, (pbs_child[]){child_at(a, 0, 1, true)}, 1));
    check_plan(&p, &PBS_LOD_DEFAULT, false);
    CHECK(p.plan.nodes[0].wanted == 200000 && !p.plan.nodes[1].wanted && p.plan.wanted == 1);
    close_scene(&p);
}

/* A million placings of one small part: its surfels stand for it nowhere near it. */
TEST(doubling_20_levels) {
    maker m = new_scene();
    uint32_t node = add_sheet(&m, 1, 0);
    for (int i = 0; i < 20; i++)
        node = add_pair(&m, child_at(node, 0, 1, false), child_at(node, ldexp(1.5, i), 1, false));
    planned p = {.s = reopen(&m, node)};
    must(make_plan(&p, &PBS_LOD_DEFAULT, false), &err);
    CHECK(p.still[node] == 1 << 21 && p.plan.nodes[node].wanted == 200000);
    size_t count;
    uint64_t triangles;
    must(pbs_plan_draws(&p.s, &p.plan, node, &p.draws, &p.cap, &count, &triangles, &err), &err);
    CHECK(p.plan.nodes[node].flags & PBS_NODE_BELOW && triangles == 2 * count && !count);
    static tally t;
    memset(&t, 0, sizeof t);
    uint32_t stood[32] = {0};
    t.p = &p, t.node = node, t.stood = stood;
    must(pbs_plan_below(&run, p.nodes, p.used, node, tally_below, &t, &err), &err);
    CHECK_NUM(t.placings >= 2 && t.placings <= 64 && t.triangles == 1 << 21, t.placings);
    drop_plan(&p);
    must(make_plan(&p, &PBS_LOD_DEFAULT, true), &err);
    must(pbs_plan_draws(&p.s, &p.plan, node, &p.draws, &p.cap, &count, &triangles, &err), &err);
    CHECK(count == 1 << 20 && triangles == 1 << 21);
    close_scene(&p);
}

TEST(deep) {
    maker m = new_scene();
    uint32_t part = add_sheet(&m, 10, 0.1), node = part;
    for (int i = 0; i < 1000; i++)
        node = add_pair(&m, child_at(node, 0.01, 1, false), child_at(part, i % 7, 1, false));
    planned p = {.s = reopen(&m, node)};
    CHECK(check_plan(&p, &(pbs_lod){1000, 0.01, 200000, 0, 0}, false) == 0);
    CHECK(p.still[node] == 200 * 1001);
    close_scene(&p);
}

/* A few kilobytes that stand for 2^64 placings: an end, whatever it is. */
TEST(doubling_64_levels) {
    for (int which = 0; which < 3; which++) {
        maker m = new_scene();
        uint32_t one = add_sheet(&m, 1, 0), other = add_sheet(&m, 30, 0.5), node = one;
        if (which == 1) node = add_empty(&m);
        if (which == 2) node = add_assembly(&m, (pbs_child[]){child_at(one, 0, 1, true)}, 1);
        for (int i = 0; i < 64; i++)
            node = add_pair(&m, child_at(node, 0, 1, false), child_at(node, 1, 1, false));
        node = add_pair(&m, child_at(node, 0, 1, false), child_at(other, 1, 1, false));
        planned p = {.s = reopen(&m, node)};
        run.mem_limit = (size_t)100 << 20;
        pbs_code rc = make_plan(&p, &small_lod, false);
        CHECK_NUM(which ? !rc : rc == PBS_LIMIT || rc == PBS_DATA, which);
        if (which) check_picture(&p, other, (uint32_t[200]){0});
        if (which) check_picture(&p, node, (uint32_t[200]){0});
        run.mem_limit = 0;
        close_scene(&p);
    }
}

/* ---- numbers ---- */

TEST(transforms_of_all_kinds) {
    static const double wild[] = {1e300, 1e308, -1e308, 1e-300, 0};
    static const double scale[] = {1, 1e305, 1e-300};
    int good = 0, bad = 0;
    for (int i = 0; i < 5 * 12 * 3 * 2; i++) {
        maker m = new_scene();
        uint32_t a = add_sheet(&m, 8, 0.1), b = add_sheet(&m, 9, 0.1);
        pbs_child c[2] = {child_at(a, 0, 1, false), child_at(b, 2, 1, i % 2)};
        c[1].m[i / 2 % 12] = wild[i / 24 % 5];
        uint32_t pair = add_assembly(&m, c, 2);
        double s = scale[i / 120];
        planned p = {
            .s = reopen(&m, add_pair(&m, child_at(pair, 1, s, false), child_at(a, 0, 1, false)))};
        pbs_code rc = make_plan(&p, &small_lod, false);
        CHECK_NUM(!rc || rc == PBS_DATA, rc);
        if (rc) CHECK(strstr(err.text, "node ") != NULL);
        for (uint32_t k = 0; k < p.s.node_count && !rc; k++) {
            const pbs_planned *n = &p.plan.nodes[k];
            CHECK(isfinite(n->pixel) && (!n->wanted || n->pixel > 0));
            for (int x = 0; x < 3; x++) CHECK(isfinite(n->origin[x]));
            if (n->wanted) check_picture(&p, k, (uint32_t[8]){0});
        }
        good += !rc, bad += rc != 0;
        close_scene(&p);
    }
    CHECK_NUM(good > 150, good);
    CHECK_NUM(bad > 30, bad);
}

TEST(singular_placings_are_counted) {
    maker m = new_scene();
    uint32_t a = add_sheet(&m, 8, 0.1);
    pbs_child c[4] = {child_at(a, 0, 1, false), child_at(a, 0, 1e-200, false),
                      child_at(a, 0, -1e100, false), child_at(a, 1, 1, false)};
    c[3].m[10] = 0;
    planned p = {.s = reopen(&m, add_assembly(&m, c, 4))};
    must(make_plan(&p, &small_lod, false), &err);
    CHECK_NUM(p.plan.singular == 1, p.plan.singular);
    close_scene(&p);
}

TEST_MAIN
