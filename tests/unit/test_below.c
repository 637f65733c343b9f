/* Surfels that are kept come back, and prefixes are what a search from the first to the last finds;
 * candidates from the nodes below lie where they are placed, without what is hidden. */
#include "formats/surfels/below.h"
#include "libcore/gbuffer/lod.h"
#include "libcore/surfels/sample.h"
#include "tests/unit/support.h"
#include "tests/check.h"

enum { ALL = PBS_POSITION | PBS_NORMAL | PBS_COLOUR | PBS_MATERIAL };

static pbs_run run = {.threads = 2};
static pbs_err err;

static double any(uint64_t *seed) {
    return random_bits(seed) / 4294967296.0;
}

/* ---- keep ---- */

static void fill_set(pbs_points *p, size_t n, uint64_t seed, bool ties) {
    fill_points(&run, ALL | PBS_SPACING, n, seed, p);
    double s = 10;
    for (size_t i = 0; i < n; i++) {
        p->spacing[i] = (float)s;
        if (!ties || i % 7 == 0) s *= 1 - 0.02 * any(&seed);
    }
}

static void check_prefix(pbs_keep *k, uint32_t node, const pbs_points *p, double covering,
                         double radius) {
    size_t slow = 1, fast;
    double covered;
    while (slow < p->count && p->spacing[slow] > radius) slow++;
    must(pbs_keep_prefix(k, node, radius, &fast, &covered, &err), &err);
    CHECK_NUM(fast == slow, fast);
    CHECK_NUM(covered == (slow < p->count ? p->spacing[slow] : covering), covered);
}

TEST(prefixes) {
    static const uint32_t at[] = {0, 1, 5, 6, 90, 4000000000};
    static const size_t counts[] = {1, 2, 3, 1000, 20000, 17};
    pbs_points p[6], out = {0};
    size_t cap = 0;
    pbs_keep *k;
    must(pbs_keep_new(&run, ALL, &k, &err), &err);
    for (int i = 0; i < 6; i++) {
        fill_set(&p[i], counts[i], (uint64_t)i, i % 2);
        must(pbs_keep_put(k, at[i], &p[i], 1e-5, &err), &err);
    }
    for (int t = 0; t < 2; t++) /* what was read may be read again */
        for (int i = 0; i < 6; i++) {
            static const double radius[] = {0, -1, 1e-5, 0.3, 5, 9.9, 10, 1e9, INFINITY};
            for (int r = 0; r < 9; r++) check_prefix(k, at[i], &p[i], 1e-5, radius[r]);
            for (size_t r = 0; r < p[i].count; r += 1 + p[i].count / 9)
                check_prefix(k, at[i], &p[i], 1e-5, p[i].spacing[r]);
            for (size_t n = p[i].count; n; n /= 3) {
                must(pbs_keep_get(k, at[i], n, &out, &cap, &err), &err);
                CHECK(out.count == n && !memcmp(out.position, p[i].position, 12 * n));
                CHECK(!memcmp(out.normal, p[i].normal, 4 * n) &&
                      !memcmp(out.colour, p[i].colour, 4 * n) &&
                      !memcmp(out.material, p[i].material, 4 * n) && !out.emissive);
            }
        }
    size_t n = 7;
    double covered = 7;
    for (uint32_t missing = 2; missing < 200; missing += 97) {
        must(pbs_keep_prefix(k, missing, 1, &n, &covered, &err), &err);
        pbs_box b = pbs_keep_box(k, missing);
        CHECK(n == 0 && covered == 0 && pbs_box_is_empty(&b));
    }
    pbs_box box = pbs_keep_box(k, 0);
    for (int c = 0; c < 3; c++)
        CHECK(box.min[c] == p[0].position[c] && box.max[c] == p[0].position[c]);
    pbs_keep_free(k);
    pbs_keep_free(NULL);
    pbs_points_free(&run, &out);
    for (int i = 0; i < 6; i++) pbs_points_free(&run, &p[i]);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(keep_only_what_there_is) {
    pbs_points p, out = {0};
    size_t cap = 0;
    pbs_keep *k;
    fill_points(&run, PBS_POSITION | PBS_SPACING, 100, 3, &p);
    must(pbs_keep_new(&run, PBS_POSITION, &k, &err), &err);
    size_t count = p.count;
    p.count = 0; /* none are none */
    must(pbs_keep_put(k, 3, &p, 0, &err), &err);
    p.count = count;
    must(pbs_keep_put(k, 4, &p, 0.5, &err), &err);
    must(pbs_keep_get(k, 4, 60, &out, &cap, &err), &err);
    CHECK(out.count == 60 && !out.normal && !out.colour && !out.material && !out.emissive);
    CHECK(!memcmp(out.position, p.position, 12 * 60));
    size_t n = 1;
    double covered;
    must(pbs_keep_prefix(k, 3, 1, &n, &covered, &err), &err);
    CHECK(!n);
    pbs_keep_free(k);
    pbs_points_free(&run, &out), pbs_points_free(&run, &p);
    CHECK(pbs_mem_used(&run) == 0);
}

/* ---- below ---- */

/* A ball around (1, 2, 3), which is its node's origin: surfels as they are chosen. */
enum { CANDIDATES = 20000, BALL = 3000 };

static double make_ball(pbs_points *p) {
    uint64_t seed = 1;
    pbs_points all;
    static uint32_t order[BALL];
    static float spacing[BALL];
    pbs_sampler *s;
    pbs_sample_result r;
    fill_points(&run, ALL, CANDIDATES, 2, &all);
    for (size_t i = 0; i < CANDIDATES; i++) {
        double z = 2 * any(&seed) - 1, a = 6.283185307 * any(&seed), w = sqrt(1 - z * z);
        float n[3] = {(float)(w * cos(a)), (float)(w * sin(a)), (float)z};
        memcpy(all.position + 3 * i, n, sizeof n);
        pbs_oct_encode(all.normal + 2 * i, n);
    }
    const pbs_sample_params how = {.count = BALL, .normal_weight = 1};
    must(pbs_sampler_new(&run, &s, &err), &err);
    must(pbs_sample(s, &all, &how, order, spacing, &r, &err), &err);
    fill_points(&run, ALL | PBS_SPACING, BALL, 2, p);
    for (size_t i = 0; i < BALL; i++) {
        memcpy(p->position + 3 * i, all.position + 3 * order[i], 12);
        memcpy(p->normal + 2 * i, all.normal + 2 * order[i], 4);
        p->spacing[i] = spacing[i];
    }
    pbs_sampler_free(s);
    pbs_points_free(&run, &all);
    return r.covering;
}

typedef struct family {
    pbs_node nodes[3];
    pbs_child child[4];
    uint64_t used[3];
    pbs_points ball;
    pbs_keep *keep;
    pbs_below *below;
} family;

/* m takes the ball's middle to `to`. */
static pbs_child ball_at(double x, double scale, bool mirror) {
    pbs_child c = {.node = 0};
    for (int k = 0; k < 3; k++) c.m[5 * k] = scale;
    if (mirror) c.m[0] = -scale;
    const double middle[3] = {1, 2, 3}, to[3] = {x, 0, 0};
    for (int k = 0; k < 3; k++) c.m[4 * k + 3] = to[k] - c.m[5 * k] * middle[k];
    return c;
}

static void make_family(family *f) {
    memset(f, 0, sizeof *f);
    double covering = make_ball(&f->ball);
    for (int i = 0; i < 3; i++) {
        f->nodes[i] = (pbs_node){.id = (uint32_t)i, .name = "", .wanted = BALL, .pixel = 0.01};
        f->used[i] = 1;
    }
    f->nodes[0].flags = f->nodes[1].flags = PBS_NODE_USED; /* 1 has no surfels in the end */
    for (int k = 0; k < 3; k++) {
        f->nodes[0].origin[k] = k + 1;
        f->nodes[0].box.min[k] = k, f->nodes[0].box.max[k] = k + 2;
    }
    f->child[0] = ball_at(-3, 1, false);
    f->child[1] = ball_at(3, 1, true);
    f->child[2] = ball_at(-3, 0.6, false); /* inside of the first */
    f->child[3] = ball_at(1e5, 1, false);
    f->child[3].flags = PBS_CHILD_MOVES;
    pbs_node *n = &f->nodes[2];
    n->children = f->child, n->child_count = 3;
    n->pixel = 0.1, n->flags = PBS_NODE_BELOW | PBS_NODE_CORNERS;
    n->origin[0] = 0.5;
    n->box = (pbs_box){{-4, -1, -1}, {4, 1, 2}};
    f->used[2] = 4;
    must(pbs_keep_new(&run, ALL, &f->keep, &err), &err);
    must(pbs_below_new(&run, f->keep, &f->below, &err), &err);
    must(pbs_keep_put(f->keep, 0, &f->ball, covering, &err), &err);
}

static void free_family(family *f) {
    pbs_below_free(f->below);
    pbs_keep_free(f->keep);
    pbs_points_free(&run, &f->ball);
    CHECK(pbs_mem_used(&run) == 0);
}

/* Own candidates: every other one in the first ball, the others on a roof over everything. */
static pbs_points add(family *f, size_t own, uint64_t *splats) {
    pbs_points p;
    size_t cap = own ? own : 1;
    fill_points(&run, ALL, own, 9, &p);
    for (size_t i = 0; i < own; i++) {
        static const float up[3] = {0, 0, 1};
        float *at = p.position + 3 * i, roof[3] = {(float)(i % 50) / 10 - 3, 0, 2};
        if (i % 2)
            memcpy(at, roof, sizeof roof);
        else
            at[0] = -3.5f, at[1] = (float)i / 1000, at[2] = 0;
        pbs_oct_encode(p.normal + 2 * i, up);
    }
    *splats = 5;
    must(pbs_below_add(f->below, f->nodes, f->used, 2, ALL, &p, &cap, splats, &err), &err);
    return p;
}

TEST(candidates_from_below) {
    static family f;
    uint64_t splats, mirrored = 0, plain = 0, roof = 0, hidden = 0, colours = 0, inwards = 0;
    make_family(&f);
    size_t prefix = 1;
    while (f.ball.spacing[prefix] > PBS_LOD_DENSE * 0.1) prefix++;
    size_t inner = 1;
    while (f.ball.spacing[inner] > PBS_LOD_DENSE * 0.1 / 0.6) inner++;
    pbs_points p = add(&f, 200, &splats);
    CHECK_NUM(splats == 5 + 200 + 2 * prefix + inner, splats);
    for (size_t i = 0; i < p.count; i++) {
        const float *at = p.position + 3 * i;
        float n[3];
        pbs_oct_decode(n, p.normal + 2 * i);
        if (at[2] == 2) {
            roof++;
            continue;
        }
        bool right = at[0] > 0;
        double q[3] = {at[0] + 0.5 - (right ? 3 : -3), at[1], at[2]};
        double r = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]);
        if (r < 0.99) {
            hidden++;
            continue;
        }
        CHECK_NUM(fabs(r - 1) < 1e-5, r);
        inwards += q[0] * n[0] + q[1] * n[1] + q[2] * n[2] < 0.999;
        size_t k = right ? mirrored : plain; /* in their order, none left out */
        if (k < prefix) colours += !memcmp(p.colour + 4 * i, f.ball.colour + 4 * k, 4);
        mirrored += right, plain += !right;
    }
    CHECK_NUM(hidden < inner / 2, hidden); /* discs that are this dense leave some gaps */
    CHECK_NUM(!inwards, inwards);
    CHECK_NUM(mirrored == prefix && plain == prefix, plain);
    CHECK_NUM(colours == 2 * prefix, colours);
    CHECK_NUM(roof == 100, roof);
    pbs_points_free(&run, &p);
    /* none of its own, or nobody there */
    p = add(&f, 0, &splats);
    CHECK_NUM(p.count >= 2 * prefix && p.count <= 2 * prefix + inner / 2, p.count);
    pbs_points_free(&run, &p);
    f.nodes[2].child_count = 0;
    p = add(&f, 0, &splats);
    CHECK(p.count == 0 && splats == 5);
    pbs_points_free(&run, &p);
    free_family(&f);
}

/* What moves far away makes the node's box large, but not its pictures. */
TEST(what_moves_costs_nothing) {
    static family f;
    uint64_t splats;
    make_family(&f);
    pbs_points a = add(&f, 200, &splats);
    f.nodes[2].child_count = 4;
    f.nodes[2].box.max[0] = 1e5;
    run.mem_limit = (size_t)64 << 20;
    pbs_points b = add(&f, 200, &splats);
    run.mem_limit = 0;
    CHECK(a.count == b.count && !memcmp(a.position, b.position, 12 * a.count));
    pbs_points_free(&run, &a), pbs_points_free(&run, &b);
    free_family(&f);
}

/* What a damaged stream may say of a node. */
TEST(bad_nodes) {
    static family f;
    uint64_t splats = 0;
    size_t cap = 1;
    make_family(&f);
    pbs_points none;
    fill_points(&run, ALL, 1, 1, &none);
    memset(none.position, 0, 12);
    for (int i = 0; i < 4; i++) {
        pbs_node keep = f.nodes[2];
        if (i == 0) f.nodes[2].pixel = 0;
        if (i == 1) f.nodes[2].pixel = -1;
        if (i == 2) f.nodes[2].box = PBS_BOX_EMPTY;
        if (i == 3) f.nodes[2].box.max[0] = -9;
        CHECK(pbs_below_add(f.below, f.nodes, f.used, 2, ALL, &none, &cap, &splats, &err) ==
              PBS_DATA);
        CHECK(none.count == 1);
        f.nodes[2] = keep;
    }
    run.mem_limit = pbs_mem_used(&run) + 1000;
    CHECK(pbs_below_add(f.below, f.nodes, f.used, 2, ALL, &none, &cap, &splats, &err) == PBS_LIMIT);
    run.mem_limit = 0;
    must(pbs_below_add(f.below, f.nodes, f.used, 2, ALL, &none, &cap, &splats, &err), &err);
    CHECK(none.count > 1000);
    pbs_points_free(&run, &none);
    free_family(&f);
}
TEST_MAIN
