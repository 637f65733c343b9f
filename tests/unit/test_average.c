/* Octaves against their definition: every candidate asked for its nearest surfel. */
#include "libcore/surfels/average.h"
#include "libcore/surfels/cover.h"
#include "tests/unit/cloud.h"

static cloud c;

typedef struct entries {
    pbs_points p;
    int16_t normal[2 * MOST];
    uint8_t colour[4 * MOST], material[4 * MOST], emissive[4 * MOST];
} entries;
static entries a, b;

static void prepare(entries *e) {
    memset(&e->p, 0, sizeof e->p);
    if (c.points.normal) e->p.normal = e->normal;
    if (c.points.colour) e->p.colour = e->colour;
    if (c.points.material) e->p.material = e->material;
    if (c.points.emissive) e->p.emissive = e->emissive;
}

/* Returns the number of surfels. */
static size_t average(const pbs_sample_params *p, int threads, entries *e) {
    pbs_run run = {.threads = threads};
    pbs_sampler *s = NULL;
    pbs_averager *v = NULL;
    prepare(e);
    CHECK(!pbs_sampler_new(&run, &s, NULL) && !pbs_averager_new(&run, &v, NULL));
    size_t n = sample_with(s, &c, p), before = pbs_mem_used(&run);
    CHECK(!pbs_average(v, s, &c.points, order, spacing, n, &e->p, NULL));
    CHECK(pbs_mem_used(&run) - before <=
          pbs_average_need(pbs_points_channels(&c.points), c.points.count, n));
    CHECK_NUM(e->p.count == pbs_octave_begin(n, 0), e->p.count);
    pbs_averager_free(v);
    pbs_sampler_free(s);
    CHECK(pbs_mem_used(&run) == 0);
    return n;
}

static bool same(const entries *x, const entries *y) {
    size_t n = x->p.count;
    return n == y->p.count && (!x->p.normal || !memcmp(x->normal, y->normal, 4 * n)) &&
           (!x->p.colour || !memcmp(x->colour, y->colour, 4 * n)) &&
           (!x->p.material || !memcmp(x->material, y->material, 4 * n)) &&
           (!x->p.emissive || !memcmp(x->emissive, y->emissive, 4 * n));
}

/* ---- the definition ---- */

typedef struct mean {
    double n, colour[4], material[2], emissive[3], normal[3];
} mean;
static mean sum[MOST];
static pbs_place place[MOST];

static void take(mean *m, size_t i) {
    float normal[3];
    pbs_oct_decode(normal, c.normal + 2 * i);
    m->n++;
    for (size_t k = 0; k < 3; k++) {
        m->colour[k] += pbs_srgb_to_linear(c.colour[4 * i + k] / 255.0f);
        m->emissive[k] += pbs_srgb_to_linear(c.emissive[4 * i + k] / 255.0f);
        m->normal[k] += normal[k];
        if (k < 2) m->material[k] += c.material[4 * i + k];
    }
    m->colour[3] += c.colour[4 * i + 3];
}

static int off(double want, uint8_t code) {
    return fabs(want - code) > 0.6; /* half a step, and the rounding of sums to 16 bits */
}

static double srgb(double linear) {
    return 255 * pbs_linear_to_srgb((float)linear);
}

static int wrong_entry(const mean *m, const entries *e, size_t at) {
    int wrong = 0;
    for (size_t k = 0; k < 3; k++) {
        wrong += off(srgb(m->colour[k] / m->n), e->colour[4 * at + k]);
        wrong += off(srgb(m->emissive[k] / m->n), e->emissive[4 * at + k]);
        if (k < 2) wrong += off(m->material[k] / m->n, e->material[4 * at + k]);
    }
    wrong += off(m->colour[3] / m->n, e->colour[4 * at + 3]);
    float n[3];
    double l = sqrt(m->normal[0] * m->normal[0] + m->normal[1] * m->normal[1] +
                    m->normal[2] * m->normal[2]),
           dot = 0;
    pbs_oct_decode(n, e->normal + 2 * at);
    for (int k = 0; k < 3; k++) dot += n[k] * m->normal[k] / l;
    return wrong + (l / m->n > 0.01 && !(dot > 0.9999));
}

static void check_octaves(float weight, size_t surfels, const entries *e) {
    pbs_run run = {.threads = 1};
    pbs_metric m;
    size_t invalid, at = 0;
    CHECK(!pbs_metric_set(&run, &m, &c.points, weight, &invalid, NULL));
    for (int k = pbs_octaves(surfels); k > 0; k--) {
        size_t length = pbs_octave_length(surfels, k);
        int wrong = 0;
        memset(sum, 0, length * sizeof *sum);
        for (size_t s = 0; s < length; s++) pbs_place_of(&m, &c.points, order[s], &place[s]);
        for (size_t i = 0; i < c.points.count; i++) {
            pbs_place p;
            float best = INFINITY;
            size_t owner = 0;
            if (!pbs_place_of(&m, &c.points, i, &p)) continue;
            for (size_t s = 0; s < length; s++) {
                float d2 = pbs_metric_d2(&m, &place[s], &p);
                if (d2 < best) best = d2, owner = s;
            }
            if (best < INFINITY) take(&sum[owner], i);
        }
        CHECK(at == pbs_octave_begin(surfels, k));
        for (size_t s = 0; s < length; s++) wrong += wrong_entry(&sum[s], e, at++);
        CHECK_NUM(wrong == 0, wrong);
    }
}

static const float weights[] = {0, 1, 0.5f};

TEST(every_candidate_counts_where_it_is_nearest) {
    for (int which = 0; which < CLOUDS; which++)
        for (int w = 0; w < 3; w++)
            for (int method = PBS_GREEDY; method <= PBS_RANDOM; method++) {
                int bad = pbs_bad;
                make(&c, which);
                pbs_sample_params p = {
                    .count = 700, .normal_weight = weights[w], .method = (pbs_method)method};
                size_t n = average(&p, 1, &a);
                check_octaves(weights[w], n, &a);
                if (pbs_bad > bad)
                    printf("# cloud %d, weight %g, method %d\n", which, weights[w], method);
            }
}

TEST(more_candidates_than_a_thread_takes) {
    make(&c, 0);
    c.points.count = 0;
    sphere(&c, 70000, 1, 0);
    pbs_sample_params p = {.count = 1200, .normal_weight = 1};
    check_octaves(1, average(&p, 2, &a), &a);
}

TEST(any_number_of_threads_gives_the_same) {
    make(&c, 0);
    c.points.count = 0;
    plate(&c, 260, 0.3);
    for (int w = 0; w < 2; w++) {
        pbs_sample_params p = {.count = 20000, .normal_weight = weights[w]};
        average(&p, 1, &a);
        for (int threads = 2; threads <= 8; threads *= 2) {
            average(&p, threads, &b);
            CHECK_NUM(same(&a, &b), threads);
        }
    }
}

/* Both compilations of the covering. */
TEST(portable_and_avx2_are_the_same) {
    if (!pbs_cpu_has_avx2()) SKIP("no AVX2 here");
    static uint32_t owner[2][MOST];
    static pbs_cover_surfel surfels[500];
    pbs_run run = {.threads = 1};
    make(&c, 1);
    for (int i = 0; i < 2; i++) {
        pbs_sampler *s;
        pbs_tree t = {0};
        pbs_layout l = {0};
        void *block;
        CHECK(!pbs_sampler_new(&run, &s, NULL));
        size_t n = sample_with(s, &c, &(pbs_sample_params){.count = 500, .normal_weight = 1});
        pbs_sampler_free(s);
        CHECK(!pbs_metric_set(&run, &t.metric, &c.points, 1, &t.invalid, NULL));
        pbs_tree_layout(&t, c.points.count, &l);
        CHECK(!pbs_alloc(&run, &block, l.used, 1, "test", NULL));
        l = (pbs_layout){block, 0};
        pbs_tree_layout(&t, c.points.count, &l);
        CHECK(!pbs_tree_build(&run, &t, &c.points, NULL));
        pbs_cover_find(&t, order, n, owner[i], c.points.count, surfels);
        pbs_cover cover = {&t, owner[i], PBS_COVER_METRIC};
        CHECK(!pbs_cover_begin(&run, &cover, NULL));
        CHECK(!(i ? pbs_cover_add_avx2 : pbs_cover_add)(&run, &cover, surfels, n, 1, false, NULL));
        pbs_free(&run, block);
    }
    CHECK(!memcmp(owner[0], owner[1], c.points.count * sizeof owner[0][0]));
}

TEST(absent_channels_stay_absent) {
    make(&c, 0);
    pbs_sample_params p = {.count = 700, .normal_weight = 1};
    average(&p, 1, &a);
    c.points.material = c.points.emissive = NULL;
    average(&p, 1, &b);
    CHECK(b.p.count == a.p.count && !memcmp(a.colour, b.colour, 4 * a.p.count));
    c.points.colour = NULL;
    average(&p, 1, &b);
    CHECK(!memcmp(a.normal, b.normal, 4 * a.p.count));
    c.points.normal = NULL;
    CHECK(average(&p, 1, &b) == 700 && b.p.count == pbs_octave_begin(700, 0));
}

/* One colour stays that colour, whichever it is. */
TEST(one_colour_stays) {
    for (int v = 0; v < 256; v += 5) {
        make(&c, 0);
        memset(c.colour, v, 4 * c.points.count);
        memset(c.material, v, 4 * c.points.count);
        memset(c.emissive, v, 4 * c.points.count);
        pbs_sample_params p = {.count = 300};
        average(&p, 1, &a);
        int wrong = 0;
        for (size_t i = 0; i < 4 * a.p.count; i++) wrong += a.colour[i] != v;
        for (size_t i = 0; i < 4 * a.p.count; i++)
            wrong += (i % 4 < 2 && a.material[i] != v) + (i % 4 < 3 && a.emissive[i] != v);
        CHECK_NUM(wrong == 0, v);
    }
}

TEST(the_rule_of_octaves) {
    CHECK(pbs_octaves(0) == 0 && pbs_octaves(16) == 0 && pbs_octaves(60) == 0);
    CHECK(pbs_octaves(61) == 1 && pbs_octave_length(61, 1) == 16);
    CHECK(pbs_octaves(100000) == 6 && pbs_octave_length(100000, 6) == 25);
    CHECK(pbs_octave_begin(100000, 6) == 0 && pbs_octave_begin(100000, 5) == 25);
    CHECK(pbs_octave_begin(100000, 0) == 25000 + 6250 + 1563 + 391 + 98 + 25);
    CHECK(pbs_octave_length(SIZE_MAX, 1) == SIZE_MAX / 4 + 1);
    CHECK(pbs_octave_of(100000, 100000) == 0 && pbs_octave_of(100000, 25001) == 0);
    CHECK(pbs_octave_of(100000, 25000) == 1 && pbs_octave_of(100000, 6251) == 1);
    CHECK(pbs_octave_of(100000, 1) == 6 && pbs_octave_of(10, 1) == 0);
}

TEST(few_surfels_limits_and_cancel) {
    pbs_run run = {.threads = 1};
    pbs_sampler *s;
    pbs_averager *v;
    CHECK(!pbs_sampler_new(&run, &s, NULL) && !pbs_averager_new(&run, &v, NULL));
    make(&c, 0);
    prepare(&a);
    size_t n = sample_with(s, &c, &(pbs_sample_params){.count = 40});
    CHECK(!pbs_average(v, s, &c.points, order, spacing, n, &a.p, NULL) && a.p.count == 0);
    n = sample_with(s, &c, &(pbs_sample_params){.count = 400});
    run.mem_limit = pbs_mem_used(&run) + 1000;
    CHECK(pbs_average(v, s, &c.points, order, spacing, n, &a.p, NULL) == PBS_LIMIT);
    run.mem_limit = 0;
    volatile sig_atomic_t cancel = 1;
    run.cancel = &cancel;
    CHECK(pbs_average(v, s, &c.points, order, spacing, n, &a.p, NULL) == PBS_CANCEL);
    pbs_averager_free(v);
    pbs_sampler_free(s);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST_MAIN
