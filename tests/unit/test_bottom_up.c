/* Surfels from surfels against surfels from geometry, over three levels: as even, and as near to
 * the surface. */
#include "formats/surfels/below.h"
#include "formats/surfels/hierarchy.h"
#include "libcore/surfels/sample.h"
#include "tests/unit/scenes.h"
#include "tests/check.h"

enum { LEAVES = 3, NODES = 16 };

static const pbs_lod lod = {200, 2, 2000, 0, 0};

/* ---- a scene: boulders in heaps, heaps in a quarry, gravel that has no surfels of its own ---- */

static uint32_t add_boulder(const maker *m, int n, double bumps) {
    static const int at[6][2] = {{0, 0}, {1, 0}, {0, 1}, {1, 0}, {1, 1}, {0, 1}};
    const double origin[3] = {0};
    uint32_t node;
    must(m->s->part_begin(m->s->ctx, "boulder", origin, 0, &err), &err);
    for (int q = 0; q < 2 * n * n; q++)
        for (int t = 0; t < 2; t++) {
            pbs_corner c[3];
            memset(c, 0, sizeof c);
            for (int i = 0; i < 3; i++) {
                int u = q % (2 * n) + at[3 * t + i][0], v = q / (2 * n) + at[3 * t + i][1];
                double a = M_PI / n * (u % (2 * n)), b = M_PI * v / n;
                double r = 1 + 0.1 * sin(bumps * a) * sin(b) * sin(b);
                c[i].position[0] = r * sin(b) * cos(a);
                c[i].position[1] = r * sin(b) * sin(a);
                c[i].position[2] = r * cos(b);
            }
            must(m->s->triangle(m->s->ctx, c, PBS_NONE, &err), &err);
        }
    must(m->s->part_end(m->s->ctx, &node, &err), &err);
    return node;
}

/* Turned by quarters, which keeps the views (pbs_lod_keeps_views), every third one mirrored. */
static pbs_child lying(uint32_t node, int i, double step, double scale, double a) {
    pbs_child c = {.node = node};

    memcpy(c.m, PBS_IDENTITY, sizeof c.m);
    c.m[0] = scale * cos(a), c.m[1] = -scale * sin(a);
    c.m[4] = scale * sin(a), c.m[5] = scale * cos(a), c.m[10] = i % 3 ? scale : -scale;
    c.m[3] = step * (i % 3), c.m[7] = step * (i / 3 % 3), c.m[11] = step * (i / 9 + 0.2 * (i % 2));
    return c;
}

static pbs_scene quarry(void) {
    maker m = new_scene();
    uint32_t part[LEAVES] = {add_boulder(&m, 24, 5), add_boulder(&m, 16, 3), add_boulder(&m, 4, 2)};
    pbs_child c[18];
    for (int i = 0; i < 18; i++)
        c[i] = lying(part[i % 5 == 4 ? 2 : i % 2], i, 2.3, i % 4 ? 1 : 1.3, M_PI / 2 * i);
    uint32_t heap = add_assembly(&m, c, 18);
    for (int i = 0; i < 8; i++) c[i] = lying(heap, i, 9, i % 2 ? 1 : 0.8, M_PI / 2 * i);
    c[8] = lying(part[0], 8, 9, 3, 0);
    return reopen(&m, add_assembly(&m, c, 9));
}

/* ---- the way through both programs ---- */

typedef struct line {
    pbs_scene *s;
    pbs_plan plan;
    pbs_node nodes[NODES];
    uint64_t used[NODES];
    pbs_points candidates[NODES], surfels[NODES];
    size_t cap;
    pbs_points *now;
    pbs_keep *keep;
    pbs_below *below;
    pbs_gbuffers *buffers;
    pbs_sampler *sampler;
} line;

static pbs_code take_view(void *ctx, const pbs_gbuffer_view *view, pbs_err *e) {
    line *l = ctx;
    const pbs_points *p = &view->points;
    pbs_points *to = l->now;
    pbs_code rc =
        pbs_points_grow(&run, PBS_POSITION | PBS_NORMAL, to, &l->cap, to->count + p->count, e);
    if (rc || !p->count) return rc;
    memcpy(to->position + 3 * to->count, p->position, 12 * p->count);
    memcpy(to->normal + 2 * to->count, p->normal, 4 * p->count);
    to->count += p->count;
    return PBS_OK;
}

static void draw(line *l, uint32_t i) {
    const pbs_planned *plan = &l->plan.nodes[i];
    pbs_draw *draws = NULL;
    size_t cap = 0, count;
    uint64_t triangles, splats = 0;
    pbs_gbuffer_params p = {
        .channels = PBS_NORMAL, .resolution = plan->resolution, .box = plan->seen};
    l->now = &l->candidates[i];
    l->cap = 0;
    must(pbs_plan_draws(l->s, &l->plan, i, &draws, &cap, &count, &triangles, &err), &err);
    if (count) must(pbs_gbuffer(l->buffers, draws, count, &p, take_view, l, NULL, &err), &err);
    pbs_free(&run, draws);
    if (plan->flags & PBS_NODE_BELOW)
        must(pbs_below_add(l->below, l->nodes, l->used, i, PBS_POSITION | PBS_NORMAL, l->now,
                           &l->cap, &splats, &err),
             &err);
}

static void choose(line *l, uint32_t i) {
    static uint32_t order[2000];
    const pbs_points *from = &l->candidates[i];
    pbs_points *to = &l->surfels[i];
    pbs_sample_params how = {.count = l->plan.nodes[i].wanted, .normal_weight = 1, .node = i};
    pbs_sample_result r;
    must(pbs_points_alloc(&run, PBS_POSITION | PBS_NORMAL | PBS_SPACING, how.count, to, &err),
         &err);
    must(pbs_sample(l->sampler, from, &how, order, to->spacing, &r, &err), &err);
    to->count = r.count;
    for (size_t k = 0; k < r.count; k++) {
        memcpy(to->position + 3 * k, from->position + 3 * order[k], 12);
        memcpy(to->normal + 2 * k, from->normal + 2 * order[k], 4);
    }
    l->nodes[i].covering = r.covering;
    if (l->plan.nodes[i].flags & PBS_NODE_USED)
        must(pbs_keep_put(l->keep, i, to, r.covering, &err), &err);
}

static void make_line(line *l, pbs_scene *s, const pbs_surfaces *surfaces, bool top_down) {
    const pbs_gbuffer_params corners = {0};
    memset(l, 0, sizeof *l);
    l->s = s;
    must(pbs_plan_make(s, &lod, &corners, top_down, &l->plan, &err), &err);
    must(pbs_gbuffers_new(&run, surfaces, 2, &l->buffers, &err), &err);
    must(pbs_sampler_new(&run, &l->sampler, &err), &err);
    must(pbs_keep_new(&run, PBS_POSITION | PBS_NORMAL, &l->keep, &err), &err);
    must(pbs_below_new(&run, l->keep, &l->below, &err), &err);
    for (uint32_t i = 0; i < s->node_count; i++) {
        const pbs_planned *p = &l->plan.nodes[i];
        pbs_node *n = &l->nodes[i];
        *n = s->nodes[i];
        n->wanted = p->wanted, n->flags = p->flags, n->pixel = p->pixel, n->box = p->box;
        memcpy(n->origin, p->origin, sizeof n->origin);
        l->used[i] = p->wanted != 0;
        for (uint32_t k = 0; k < n->child_count; k++) l->used[i] += l->used[n->children[k].node];
        if (p->wanted) draw(l, i), choose(l, i);
    }
}

static void free_line(line *l) {
    for (int i = 0; i < NODES; i++)
        pbs_points_free(&run, &l->candidates[i]), pbs_points_free(&run, &l->surfels[i]);
    pbs_below_free(l->below);
    pbs_keep_free(l->keep);
    pbs_sampler_free(l->sampler);
    pbs_gbuffers_free(l->buffers);
    pbs_plan_free(&run, &l->plan);
}

/* ---- how far from each of `from` to the nearest of `to` ---- */

static int by_size(const void *a, const void *b) {
    float p = *(const float *)a, q = *(const float *)b;
    return p < q ? -1 : p > q;
}

/* Sorted; malloc'ed. Both are of the same node, so of one frame. */
static float *distances(const pbs_points *from, const pbs_points *to) {
    float *d = malloc(sizeof *d * (from->count + 1));
    for (size_t i = 0; i < from->count; i++) {
        const float *p = from->position + 3 * i;
        float best = INFINITY;
        for (size_t k = 0; k < to->count; k++) {
            const float *q = to->position + 3 * k;
            float x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2], l = x * x + y * y + z * z;
            best = l < best ? l : best;
        }
        d[i] = sqrtf(best);
    }
    qsort(d, from->count, sizeof *d, by_size);
    return d;
}

static void compare(const line *down, const line *up, uint32_t i) {
    const pbs_points *truth = &down->candidates[i];
    double pixel = up->nodes[i].pixel;
    float *near = distances(&up->surfels[i], truth);
    float *a = distances(truth, &down->surfels[i]), *b = distances(truth, &up->surfels[i]);
    size_t n = truth->count, last = up->surfels[i].count - 1;
    CHECK_NUM(up->surfels[i].count == lod.most, up->surfels[i].count);
    /* What lies deeper than that is seen through the gaps between discs. */
    CHECK_NUM(near[last / 2] <= 0.7 * pixel, near[last / 2] / pixel);
    CHECK_NUM(near[last * 19 / 20] <= 1.5 * pixel, near[last * 19 / 20] / pixel);
    CHECK_NUM(near[last * 99 / 100] <= 4 * pixel, near[last * 99 / 100] / pixel);
    size_t at[] = {n / 2, n - 1 - n / 10, n - 1 - n / 100, n - 1 - n / 1000};
    const double most[] = {1.05, 1.05, 1.1, 1.2};
    for (int k = 0; k < 4; k++) CHECK_NUM(b[at[k]] <= most[k] * a[at[k]], b[at[k]] / a[at[k]]);
    free(near), free(a), free(b);
}

TEST(as_good_as_from_geometry) {
    static line down, up;
    pbs_scene s = quarry();
    pbs_surfaces *surfaces;
    must(pbs_surfaces_new(&run, NULL, 0, NULL, 0, PBS_NORMAL, &surfaces, &err), &err);
    if (s.node_count > NODES) abort();
    make_line(&down, &s, surfaces, true);
    make_line(&up, &s, surfaces, false);
    uint32_t root = (uint32_t)s.node_count - 1;
    CHECK(root == LEAVES + 1 && !up.plan.nodes[2].wanted);
    for (uint32_t i = 0; i < 2; i++) /* leaves are made in one way only */
        CHECK(up.surfels[i].count > 400 && up.surfels[i].count == down.surfels[i].count &&
              !memcmp(up.surfels[i].position, down.surfels[i].position, 12 * up.surfels[i].count));
    for (uint32_t i = 3; i <= root; i++) {
        CHECK(up.plan.nodes[i].flags & PBS_NODE_BELOW &&
              !(down.plan.nodes[i].flags & PBS_NODE_BELOW));
        compare(&down, &up, i);
    }
    free_line(&down), free_line(&up);
    pbs_surfaces_free(&run, surfaces);
    pbs_scene_close(&s);
    CHECK(pbs_mem_used(&run) == 0);
}
TEST_MAIN
