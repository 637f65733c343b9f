/* The sampler against brute force: the definition of the greedy permutation, point by point. */
#include "libcore/surfels/candidates.h"
#include "libcore/surfels/greedy.h"
#include "libcore/ground/pipe.h"
#include "libcore/data/rng.h"
#include "libcore/surfels/sample.h"
#include "libcore/data/vec.h"
#include "tests/check.h"

enum { MOST = 20000 };

typedef struct cloud {
    pbs_points points;
    float position[3 * MOST];
    int16_t normal[2 * MOST];
} cloud;

static double uniform(uint64_t *state) {
    *state += 1;
    return (double)(pbs_mix64(*state * 0x9e3779b97f4a7c15u) >> 11) * 0x1p-53;
}

static void add(cloud *c, double x, double y, double z, double nx, double ny, double nz) {
    size_t i = c->points.count++;
    c->position[3 * i] = (float)x, c->position[3 * i + 1] = (float)y;
    c->position[3 * i + 2] = (float)z;
    pbs_oct_encode(c->normal + 2 * i, (float[3]){(float)nx, (float)ny, (float)nz});
}

static void begin(cloud *c) {
    memset(&c->points, 0, sizeof c->points);
    c->points.position = c->position;
    c->points.normal = c->normal;
}

/* ---- clouds ---- */

static void cube(cloud *c, size_t n) {
    uint64_t r = n;
    for (size_t i = 0; i < n; i++) {
        double x = uniform(&r), y = uniform(&r), z = uniform(&r);
        add(c, x, y, z, uniform(&r) - 0.5, uniform(&r) - 0.5, uniform(&r) - 0.5);
    }
}

static void sphere(cloud *c, size_t n) {
    uint64_t r = n + 77;
    for (size_t i = 0; i < n; i++) {
        double z = 2 * uniform(&r) - 1, a = 6.283185307179586 * uniform(&r), s = sqrt(1 - z * z);
        add(c, s * cos(a), s * sin(a), z, s * cos(a), s * sin(a), z);
    }
}

/* A thin plate: two sides, `gap` apart, on a regular grid. Ties everywhere. */
static void plate(cloud *c, size_t side, double gap) {
    for (size_t i = 0; i < side * side; i++) {
        double x = (double)(i % side), y = (double)(i / side);
        add(c, x, y, gap, 0, 0, 1);
        add(c, x, y, 0, 0, 0, -1);
    }
}

static void line(cloud *c, size_t n) {
    uint64_t r = 5;
    for (size_t i = 0; i < n; i++) {
        double t = floor(uniform(&r) * 4096) / 64;
        add(c, t, 2 * t, -3 * t, 0, i % 2 ? 1 : -1, 0);
    }
}

/* A dense cluster, a sparse one, and a point far away from both. */
static void clusters(cloud *c, size_t n) {
    uint64_t r = 9;
    for (size_t i = 0; i < n; i++) {
        double s = i % 10 ? 1e-4 : 1;
        add(c, s * uniform(&r), s * uniform(&r), s * uniform(&r), 0, 1, uniform(&r));
    }
    add(c, 1e7, -1e7, 3, 1, 0, 0);
}

static void repeated(cloud *c, size_t n) {
    uint64_t r = 3;
    for (size_t i = 0; i < n; i++) {
        double x = floor(5 * uniform(&r)), y = floor(5 * uniform(&r)), a = floor(4 * uniform(&r));
        add(c, x, y, 0, a == 0 ? 1 : a == 1 ? -1 : 0, a == 2 ? 1 : a == 3 ? -1 : 0, 0);
    }
}

static void broken(cloud *c, size_t n) {
    cube(c, n);
    for (size_t i = 0; i < n; i += 7) c->position[3 * i + i % 3] = i % 2 ? NAN : INFINITY;
}

static void scaled(cloud *c, size_t n, double scale, double offset) {
    sphere(c, n);
    for (size_t i = 0; i < 3 * n; i++)
        c->position[i] = (float)((double)c->position[i] * scale + offset);
}

enum { CLOUDS = 18 };

static void make(cloud *c, int which) {
    begin(c);
    switch (which) {
    case 0:
        return;
    case 1:
        add(c, 3, 4, 5, 0, 0, 1);
        return;
    case 2:
        add(c, 1, 1, 1, 0, 0, 1), add(c, 1, 1, 1, 0, 0, -1);
        return;
    case 3:
        cube(c, 700);
        return;
    case 4:
        sphere(c, 900);
        return;
    case 5:
        plate(c, 20, 0.01);
        return;
    case 6:
        plate(c, 18, 0);
        return;
    case 7:
        line(c, 500);
        return;
    case 8:
        clusters(c, 1000);
        return;
    case 9:
        repeated(c, 400);
        return;
    case 10:
        broken(c, 500);
        return;
    case 11:
        scaled(c, 300, 1e-30, 0);
        return;
    case 12:
        scaled(c, 300, 1e30, 0);
        return;
    case 13:
        scaled(c, 300, 3.4e38, 0);
        return;
    case 14:
        scaled(c, 300, 1e-42, 0);
        return;
    case 15:
        scaled(c, 600, 1e-3, 1e4);
        return;
    case 16:
        for (int i = 0; i < 300; i++) add(c, 1e38, -1, 7, 0, 0, 1);
        return;
    default:
        for (int i = 0; i < 40; i++) add(c, NAN, 0, 0, 0, 0, 1);
    }
}

/* ---- the definition ---- */

typedef struct answer {
    uint32_t order[MOST];
    float spacing[MOST];
    pbs_sample_result r;
} answer;

/* Goes through order[] as if each had been chosen in its turn, and checks that the greedy method
 * had to choose it, or only its spacing. Fills in covering and duplicates. */
static void brute(const cloud *c, float weight, const answer *a, bool greedy, answer *out) {
    static pbs_place place[MOST];
    static float d[MOST];
    pbs_run run = {.threads = 1};
    pbs_metric m;
    size_t n = c->points.count, invalid, wrong = 0;
    CHECK(!pbs_metric_set(&run, &m, &c->points, weight, &invalid, NULL));
    for (size_t i = 0; i < n; i++)
        d[i] = pbs_place_of(&m, &c->points, i, &place[i]) ? INFINITY : -1;
    for (size_t k = 0; k < a->r.count; k++) {
        uint32_t chosen = a->order[k];
        if (greedy && k > 0) {
            chosen = 0;
            for (uint32_t i = 1; i < n; i++)
                if (d[i] > d[chosen]) chosen = i;
        }
        wrong += chosen != a->order[k] || !(d[chosen] > 0) ||
                 pbs_metric_length(&m, k ? d[chosen] : INFINITY) != a->spacing[k];
        d[chosen] = -1;
        for (size_t i = 0; i < n; i++) {
            float v = d[i] >= 0 ? pbs_metric_d2(&m, &place[i], &place[chosen]) : -1;
            if (v < d[i]) d[i] = v;
        }
    }
    CHECK_NUM(wrong == 0, wrong);
    float most = 0;
    out->r = (pbs_sample_result){.count = a->r.count, .invalid = invalid};
    for (size_t i = 0; i < n; i++) {
        most = d[i] > most ? d[i] : most;
        out->r.duplicates += d[i] == 0;
    }
    out->r.covering = n > invalid ? pbs_metric_length(&m, most) : 0;
}

static void sample(const cloud *c, const pbs_sample_params *p, int threads, answer *a) {
    pbs_run run = {.threads = threads};
    pbs_sampler *s = NULL;
    pbs_err err = {0};
    CHECK(!pbs_sampler_new(&run, &s, &err));
    CHECK(!pbs_sample(s, &c->points, p, a->order, a->spacing, &a->r, &err));
    size_t need = pbs_sample_need(c->points.count, p);
    CHECK_NUM(pbs_mem_peak(&run) <= need, (double)pbs_mem_peak(&run) - (double)need);
    pbs_sampler_free(s);
    CHECK(pbs_mem_used(&run) == 0);
}

static bool same(const answer *a, const answer *b) {
    return a->r.count == b->r.count && a->r.covering == b->r.covering &&
           a->r.duplicates == b->r.duplicates && a->r.invalid == b->r.invalid &&
           !memcmp(a->order, b->order, a->r.count * sizeof a->order[0]) &&
           !memcmp(a->spacing, b->spacing, a->r.count * sizeof a->spacing[0]);
}

static cloud c;
static answer a, b;

static void compare(const pbs_sample_params *p, bool greedy) {
    sample(&c, p, 1, &a);
    brute(&c, p->normal_weight, &a, greedy, &b);
    CHECK_NUM(a.r.covering == b.r.covering, a.r.covering);
    CHECK_NUM(a.r.duplicates == b.r.duplicates, a.r.duplicates);
    CHECK_NUM(a.r.invalid == b.r.invalid, a.r.invalid);
    size_t most = p->count < c.points.count ? p->count : c.points.count;
    CHECK(a.r.count == most || a.r.covering == 0);
    sample(&c, p, 3, &b);
    CHECK(same(&a, &b));
}

static const float weights[] = {0, 1, 0.5f};

TEST(greedy_is_the_definition) {
    for (int which = 0; which < CLOUDS; which++)
        for (int w = 0; w < 3; w++)
            for (size_t count = 1; count < 4000; count = count * 6 + 1) {
                make(&c, which);
                int bad = pbs_bad;
                pbs_sample_params p = {.count = count,
                                       .normal_weight = weights[w],
                                       .seed = 4,
                                       .node = (uint32_t)which};
                compare(&p, true);
                if (pbs_bad > bad)
                    printf("# cloud %d, weight %g, count %zu\n", which, weights[w], count);
            }
}

TEST(greedy_is_the_definition_for_larger_sets) {
    for (int w = 0; w < 2; w++) {
        begin(&c);
        sphere(&c, MOST);
        compare(&(pbs_sample_params){.count = 2000, .normal_weight = weights[w], .seed = 1}, true);
        begin(&c);
        plate(&c, 100, 0.3);
        compare(&(pbs_sample_params){.count = 1500, .normal_weight = weights[w], .seed = 2}, true);
        begin(&c);
        clusters(&c, MOST - 1);
        compare(&(pbs_sample_params){.count = 1200, .normal_weight = weights[w], .seed = 3}, true);
    }
}

TEST(any_number_of_threads_gives_the_same) {
    begin(&c);
    plate(&c, 100, 0.3);
    for (int w = 0; w < 2; w++) {
        pbs_sample_params p = {.count = 9000, .normal_weight = weights[w]};
        sample(&c, &p, 1, &a);
        for (int threads = 2; threads < 40; threads = threads * 2 + 1) {
            sample(&c, &p, threads, &b);
            CHECK_NUM(same(&a, &b), threads);
        }
    }
}

/* Both compilations make the same tree, and mark the same surfels with the same values. */
TEST(portable_and_avx2_are_the_same) {
    if (!pbs_cpu_has_avx2()) SKIP("no AVX2 here");
    begin(&c);
    sphere(&c, MOST);
    pbs_run run = {.threads = 1};
    pbs_tree t[2] = {0};
    void *block[2];
    for (int i = 0; i < 2; i++) {
        size_t invalid;
        pbs_metric m;
        CHECK(!pbs_metric_set(&run, &m, &c.points, 1, &invalid, NULL));
        t[i].metric = m;
        pbs_layout l = {0};
        pbs_tree_layout(&t[i], MOST, &l);
        pbs_greedy_layout(&t[i], MOST, &l);
        CHECK(!pbs_alloc(&run, &block[i], l.used, 1, "test", NULL));
        l = (pbs_layout){block[i], 0};
        pbs_tree_layout(&t[i], MOST, &l);
        CHECK(!(i ? pbs_tree_build_avx2 : pbs_tree_build)(&run, &t[i], &c.points, NULL));
        CHECK(!(i ? pbs_greedy_run_avx2 : pbs_greedy_run)(&run, &t[i], 7, 2000, &l, NULL));
    }
    CHECK(!memcmp(t[0].leaf, t[1].leaf, t[0].leaves * sizeof *t[0].leaf));
    CHECK(!memcmp(t[0].normal, t[1].normal, t[0].leaves * sizeof *t[0].normal));
    CHECK(!memcmp(t[0].id, t[1].id, t[0].leaves * PBS_LEAF * sizeof *t[0].id));
    for (int i = 0; i < 2; i++) {
        answer *out = i ? &a : &b;
        pbs_layout l = {0};
        memset(&out->r, 0, sizeof out->r);
        pbs_greedy_result_layout(MOST, 1900, &l);
        void *scratch;
        CHECK(!pbs_alloc(&run, &scratch, l.used, 1, "test", NULL));
        l = (pbs_layout){scratch, 0};
        CHECK(!(i ? pbs_greedy_result_avx2 : pbs_greedy_result)(
            &run, &t[i], 7, 1900, &l, out->order, out->spacing, &out->r, NULL));
        pbs_free(&run, scratch);
    }
    CHECK(a.r.count == 1900 && same(&a, &b));
    for (int i = 0; i < 2; i++) pbs_free(&run, block[i]);
}

typedef struct nodes {
    pbs_run run;
    pbs_points points;
    answer part[6];
} nodes;

/* Node i is a prefix of the candidates, of another length each. */
static pbs_code sample_node(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread;
    nodes *n = ctx;
    pbs_sampler *s;
    pbs_points in = n->points;
    pbs_sample_params p = {.count = 700 * i + 40, .normal_weight = 1, .node = (uint32_t)i};
    in.count = 3000 * i + 100;
    pbs_code rc = pbs_sampler_new(&n->run, &s, err);
    answer *out = &n->part[i];
    if (!rc) rc = pbs_sample(s, &in, &p, out->order, out->spacing, &out->r, err);
    pbs_sampler_free(s);
    return rc;
}

TEST(samplers_work_beside_each_other) {
    static nodes n[2];
    begin(&c);
    sphere(&c, MOST);
    for (int k = 0; k < 2; k++) {
        n[k].points = c.points;
        n[k].run.threads = k ? 3 : 1;
        CHECK(!pbs_parallel(&n[k].run, 6, sample_node, &n[k], NULL));
    }
    for (int i = 0; i < 6; i++) CHECK_NUM(same(&n[0].part[i], &n[1].part[i]), i);
}

TEST(a_prefix_is_the_result_of_a_smaller_count) {
    for (int method = PBS_GREEDY; method <= PBS_RANDOM; method++) {
        begin(&c);
        sphere(&c, 5000);
        pbs_sample_params p = {.count = 2000, .method = (pbs_method)method, .normal_weight = 1};
        sample(&c, &p, 2, &a);
        p.count = 777;
        sample(&c, &p, 2, &b);
        CHECK(b.r.count == 777);
        CHECK(!memcmp(a.order, b.order, 777 * sizeof a.order[0]));
        CHECK(!memcmp(a.spacing, b.spacing, 777 * sizeof a.spacing[0]));
        if (method == PBS_GREEDY) CHECK(b.r.covering == a.spacing[777]);
    }
}

/* With a radius the order is the shortest prefix that covers so well. */
TEST(a_radius_ends_the_order) {
    for (int which = 0; which < CLOUDS; which++)
        for (int w = 0; w < 2; w++) {
            make(&c, which);
            pbs_sample_params p = {.count = MOST, .normal_weight = weights[w], .seed = 4};
            sample(&c, &p, 1, &a);
            for (size_t i = 1; i < a.r.count; i = i * 3 + 1) {
                p.radius = a.spacing[i] * 1.01f;
                if (p.radius >= a.spacing[0]) continue; /* D may be infinite there */
                sample(&c, &p, 1 + (int)(i % 3), &b);
                size_t n = 1;
                while (n < a.r.count && a.spacing[n] > p.radius) n++;
                CHECK_NUM(b.r.count == n && b.r.covering == a.spacing[n], (double)b.r.count);
                CHECK(!memcmp(a.order, b.order, n * sizeof a.order[0]));
                CHECK(!memcmp(a.spacing, b.spacing, n * sizeof a.spacing[0]));
            }
        }
}

TEST(greedy_spacing_never_rises_and_starts_with_the_diagonal) {
    begin(&c);
    plate(&c, 40, 0);
    sample(&c, &(pbs_sample_params){.count = 3200, .normal_weight = 1}, 1, &a);
    CHECK(a.r.count == 3200); /* both sides of a sheet without thickness */
    CHECK_NUM(fabs(a.spacing[0] - 39 * sqrt(2)) < 1e-4, a.spacing[0]);
    CHECK_NUM(a.spacing[1] == a.spacing[0], a.spacing[1]);
    size_t rises = 0;
    for (size_t i = 1; i < a.r.count; i++) rises += !(a.spacing[i] <= a.spacing[i - 1]);
    CHECK_NUM(rises == 0, rises);
    sample(&c, &(pbs_sample_params){.count = 3200}, 1, &a);
    CHECK_NUM(a.r.count == 1600 && a.r.duplicates == 1600, a.r.count);
}

TEST(heuristics_report_what_brute_force_finds) {
    for (int method = PBS_PAPER; method <= PBS_RANDOM; method++)
        for (int which = 0; which < CLOUDS; which++)
            for (int w = 0; w < 2; w++)
                for (size_t count = 20; count <= 600; count += 580) {
                    make(&c, which);
                    int bad = pbs_bad;
                    compare(&(pbs_sample_params){.count = count,
                                                 .method = (pbs_method)method,
                                                 .normal_weight = weights[w],
                                                 .node = (uint32_t)which},
                            false);
                    if (pbs_bad > bad)
                        printf("# method %d, cloud %d, weight %g\n", method, which, weights[w]);
                }
}

TEST(greedy_covers_best_and_random_worst) {
    float covering[3];
    begin(&c);
    sphere(&c, MOST);
    for (int method = PBS_GREEDY; method <= PBS_RANDOM; method++) {
        sample(&c, &(pbs_sample_params){.count = 500, .method = (pbs_method)method}, 1, &a);
        covering[method] = a.r.covering;
    }
    CHECK_NUM(covering[PBS_GREEDY] < covering[PBS_PAPER], covering[PBS_PAPER]);
    CHECK_NUM(covering[PBS_PAPER] < covering[PBS_RANDOM], covering[PBS_RANDOM]);
}

TEST(seed_and_node_choose_the_first) {
    begin(&c);
    sphere(&c, 5000);
    uint32_t first[3];
    for (int i = 0; i < 3; i++) {
        sample(&c, &(pbs_sample_params){.count = 1, .seed = i == 1, .node = i == 2}, 1, &a);
        first[i] = a.order[0];
        CHECK(a.r.count == 1);
    }
    CHECK(first[0] != first[1] && first[0] != first[2] && first[1] != first[2]);
}

TEST(without_normals_any_weight_is_euclid) {
    begin(&c);
    sphere(&c, 3000);
    c.points.normal = NULL;
    sample(&c, &(pbs_sample_params){.count = 500, .normal_weight = 1}, 1, &a);
    sample(&c, &(pbs_sample_params){.count = 500, .normal_weight = NAN}, 1, &b);
    CHECK(same(&a, &b));
    c.points.normal = c.normal;
    sample(&c, &(pbs_sample_params){.count = 500}, 1, &b);
    CHECK(same(&a, &b));
}

TEST(scratch_is_reused_and_limits_are_kept) {
    for (int method = PBS_GREEDY; method <= PBS_RANDOM; method++) {
        pbs_sample_params p = {.count = 300, .method = (pbs_method)method, .normal_weight = 1};
        pbs_run run = {.threads = 2, .mem_limit = pbs_sample_need(4000, &p)};
        pbs_sampler *s;
        pbs_err err = {0};
        CHECK(!pbs_sampler_new(&run, &s, NULL));
        begin(&c);
        sphere(&c, 4000);
        CHECK(!pbs_sample(s, &c.points, &p, a.order, a.spacing, &a.r, &err));
        size_t used = pbs_mem_used(&run);
        make(&c, 3);
        CHECK(!pbs_sample(s, &c.points, &p, b.order, b.spacing, &b.r, &err));
        CHECK(pbs_mem_used(&run) == used);
        begin(&c);
        sphere(&c, MOST);
        CHECK(pbs_sample(s, &c.points, &p, b.order, b.spacing, &b.r, &err) == PBS_LIMIT);
        begin(&c);
        sphere(&c, 4000);
        CHECK(!pbs_sample(s, &c.points, &p, b.order, b.spacing, &b.r, &err));
        CHECK(same(&a, &b));
        volatile sig_atomic_t cancel = 1;
        run.cancel = &cancel;
        CHECK(pbs_sample(s, &c.points, &p, b.order, b.spacing, &b.r, &err) == PBS_CANCEL);
        pbs_sampler_free(s);
        CHECK(pbs_mem_used(&run) == 0);
    }
}

TEST(nothing_wanted) {
    make(&c, 4);
    sample(&c, &(pbs_sample_params){.count = 0}, 1, &a);
    CHECK(a.r.count == 0 && a.r.covering > 1.9f && a.r.duplicates == 0);
}

TEST_MAIN
