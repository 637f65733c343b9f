/* The measures of a prefix against brute force. */
#include "libcore/surfels/candidates.h"
#include "libcore/measures/measure.h"
#include "tests/unit/cloud.h"

static cloud c;
static pbs_place place[MOST];
static bool valid_at[MOST];
static uint8_t averaged[4 * MOST];
static double linear[MOST][3], owned[MOST], nearest[MOST];

static double euclid(size_t i, size_t k) {
    double d = 0;
    for (int a = 0; a < 3; a++) {
        double x = (double)c.position[3 * i + a] - c.position[3 * k + a];
        d += x * x;
    }
    return sqrt(d);
}

static int rising(const void *x, const void *y) {
    double a = *(const double *)x, b = *(const double *)y;
    return (a > b) - (a < b);
}

static void brute_spacing(size_t n, pbs_measures *out) {
    if (n < 2) return;
    for (size_t i = 0; i < n; i++) {
        nearest[i] = INFINITY;
        for (size_t k = 0; k < n; k++)
            if (k != i) nearest[i] = fmin(nearest[i], euclid(order[i], order[k]));
    }
    qsort(nearest, n, sizeof *nearest, rising);
    out->min_spacing = nearest[0];
    out->median_spacing = nearest[n / 2];
}

static void take_colour(size_t owner, size_t i) {
    owned[owner]++;
    for (size_t k = 0; k < 3; k++)
        linear[owner][k] += pbs_srgb_to_linear(c.colour[4 * i + k] / 255.0f);
}

static void brute_colours(size_t n, pbs_measures *out) {
    double own = 0, mean = 0, count = 0;
    for (size_t s = 0; s < n; s++)
        for (size_t k = 0; k < 3 && owned[s] > 0; k++) {
            double truth = 255 * pbs_linear_to_srgb((float)(linear[s][k] / owned[s]));
            double x = c.colour[4 * order[s] + k] - truth, y = averaged[4 * s + k] - truth;
            own += x * x, mean += y * y, count++;
        }
    out->colour_own = sqrt(own / count);
    out->colour_averaged = sqrt(mean / count);
}

/* radius is in *out already. The holes come last: they need it. */
static void brute(float weight, size_t n, pbs_measures *out) {
    pbs_run run = {.threads = 1};
    pbs_metric m;
    size_t invalid, holes = 0, valid = 0;
    double most = 0;
    CHECK(!pbs_metric_set(&run, &m, &c.points, 1, &invalid, NULL));
    m.base = 1 - weight * weight / 2;
    m.slope = weight * weight / 2 / (32767.0f * 32767.0f);
    memset(linear, 0, sizeof linear), memset(owned, 0, sizeof owned);
    brute_spacing(n, out);
    for (size_t i = 0; i < c.points.count; i++)
        valid_at[i] = pbs_place_of(&m, &c.points, i, &place[i]);
    for (size_t i = 0; i < c.points.count; i++)
        if (valid_at[i]) {
            double best = INFINITY;
            float d2 = INFINITY;
            size_t owner = 0;
            for (size_t s = 0; s < n; s++) {
                float d = pbs_metric_d2(&m, &place[i], &place[order[s]]);
                best = fmin(best, euclid(i, order[s]));
                if (d < d2) d2 = d, owner = s;
            }
            out->covering = fmax(out->covering, best);
            most = fmax(most, d2);
            if (d2 < INFINITY) take_colour(owner, i);
        }
    out->covering_d = sqrt(most) / m.length;
    if (!out->radius) out->radius = out->covering;
    for (size_t i = 0; i < c.points.count; i++) {
        if (!valid_at[i]) continue;
        bool hole = true;
        valid++;
        for (size_t s = 0; s < n && hole; s++) {
            const int16_t *a = place[i].n, *b = place[order[s]].n;
            hole = !(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] > 0 &&
                     euclid(i, order[s]) <= 1.25 * out->radius);
        }
        holes += hole;
    }
    out->holes = (double)holes / (double)valid;
    brute_colours(n, out);
}

static bool near(double x, double y) {
    return x == y || fabs(x - y) <= 1e-6 * fabs(y);
}

static void compare(pbs_measurer *m, float weight, size_t n, double radius) {
    pbs_measures got, want = {.surfels = n, .radius = radius};
    CHECK(!pbs_measure(m, order, n, radius, averaged, &got, NULL));
    brute(weight, n, &want);
    CHECK(got.surfels == n);
    CHECK_NUM(near(got.min_spacing, want.min_spacing), got.min_spacing - want.min_spacing);
    CHECK_NUM(near(got.median_spacing, want.median_spacing), got.median_spacing);
    CHECK_NUM(near(got.covering, want.covering), got.covering - want.covering);
    CHECK_NUM(near(got.covering_d, want.covering_d), got.covering_d - want.covering_d);
    CHECK_NUM(near(got.radius, want.radius), got.radius);
    CHECK_NUM(fabs(got.holes - want.holes) * (double)c.points.count < 1.5, got.holes - want.holes);
    CHECK_NUM(fabs(got.colour_own - want.colour_own) < 0.1, got.colour_own - want.colour_own);
    CHECK_NUM(fabs(got.colour_averaged - want.colour_averaged) < 0.1, got.colour_averaged);
}

static const float weights[] = {0, 1, 0.5f};

TEST(measures_are_those_of_brute_force) {
    pbs_run run = {.threads = 2};
    pbs_sampler *s;
    CHECK(!pbs_sampler_new(&run, &s, NULL));
    for (size_t i = 0; i < sizeof averaged; i++) averaged[i] = (uint8_t)(i * 37);
    for (int which = 0; which < CLOUDS; which++)
        for (int w = 0; w < 3; w++) {
            int bad = pbs_bad;
            pbs_measurer *m;
            make(&c, which);
            size_t n =
                sample_with(s, &c, &(pbs_sample_params){.count = 400, .normal_weight = weights[w]});
            CHECK(!pbs_measurer_new(&run, &c.points, weights[w], &m, NULL));
            compare(m, weights[w], 1, 0);
            compare(m, weights[w], 17, 0);
            compare(m, weights[w], n / 3, spacing[n / 2]);
            compare(m, weights[w], n, 0);
            pbs_measurer_free(m);
            if (pbs_bad > bad) printf("# cloud %d, weight %g\n", which, weights[w]);
        }
    pbs_sampler_free(s);
    CHECK(pbs_mem_used(&run) == 0);
}

/* The spacing that the sampler gives is what is measured here. */
TEST(covering_of_a_greedy_prefix_is_its_next_spacing) {
    pbs_run run = {.threads = 1};
    pbs_sampler *s;
    pbs_measurer *m;
    make(&c, 0);
    for (int w = 0; w < 2; w++) {
        CHECK(!pbs_sampler_new(&run, &s, NULL));
        sample_with(s, &c, &(pbs_sample_params){.count = 500, .normal_weight = weights[w]});
        CHECK(!pbs_measurer_new(&run, &c.points, weights[w], &m, NULL));
        for (size_t n = 10; n < 500; n *= 3) {
            pbs_measures got;
            CHECK(!pbs_measure(m, order, n, 0, NULL, &got, NULL));
            CHECK_NUM(near(got.covering_d, spacing[n]), got.covering_d - spacing[n]);
            CHECK(got.colour_averaged == 0 && got.colour_own > 10);
        }
        pbs_measurer_free(m);
        pbs_sampler_free(s);
    }
}

/* What the metric is for: a plate much thinner than the surfels are apart, and as much surface
 * that is no wall. (Of walls alone both sides need so many surfels that spacing grows by 1.4.) */
TEST(walls_have_few_holes_with_normals) {
    enum { PREFIXES = 2, MANY = 10000 };
    static const size_t prefix[PREFIXES] = {2000, MANY};
    pbs_run run = {.threads = 2};
    pbs_sampler *s;
    pbs_measurer *m;
    pbs_measures plain[PREFIXES], aware;
    make(&c, 0);
    c.points.count = 0;
    plate(&c, 200, 0.05);
    sphere(&c, 40000, 200 / 3.545, 400);
    CHECK(!pbs_sampler_new(&run, &s, NULL) && !pbs_measurer_new(&run, &c.points, 1, &m, NULL));
    sample_with(s, &c, &(pbs_sample_params){.count = MANY});
    for (int i = 0; i < PREFIXES; i++)
        CHECK(!pbs_measure(m, order, prefix[i], 0, NULL, &plain[i], NULL));
    sample_with(s, &c, &(pbs_sample_params){.count = MANY, .normal_weight = 1});
    for (int i = 0; i < PREFIXES; i++) {
        CHECK(!pbs_measure(m, order, prefix[i], plain[i].radius, NULL, &aware, NULL));
        CHECK_NUM(plain[i].holes > 0.03, plain[i].holes);
        CHECK_NUM(aware.holes * 5 < plain[i].holes, aware.holes);
    }
    pbs_measurer_free(m);
    pbs_sampler_free(s);
}

TEST(nothing_to_measure_and_limits) {
    pbs_run run = {.threads = 1};
    pbs_measurer *m;
    pbs_measures got;
    memset(&c.points, 0, sizeof c.points);
    c.points.position = c.position;
    CHECK(!pbs_measurer_new(&run, &c.points, 1, &m, NULL));
    CHECK(!pbs_measure(m, order, 0, 0, NULL, &got, NULL) && got.covering == 0);
    pbs_measurer_free(m);
    make(&c, 0);
    c.points.normal = NULL, c.points.colour = NULL;
    for (uint32_t i = 0; i < 100; i++) order[i] = 3 * i;
    CHECK(!pbs_measurer_new(&run, &c.points, 1, &m, NULL));
    CHECK(!pbs_measure(m, order, 100, 0, NULL, &got, NULL));
    CHECK(got.holes == 0 && got.colour_own == 0 && got.covering > 0);
    CHECK(got.covering_d == got.covering);
    CHECK(pbs_mem_peak(&run) <= pbs_measurer_need(PBS_POSITION, c.points.count, 100));
    run.mem_limit = pbs_mem_used(&run) + 100;
    CHECK(pbs_measure(m, order, 100, 0, NULL, &got, NULL) == PBS_LIMIT);
    pbs_measurer_free(m);
    CHECK(pbs_mem_used(&run) == 0);
    run.mem_limit = 1000;
    CHECK(pbs_measurer_new(&run, &c.points, 1, &m, NULL) == PBS_LIMIT && !m);
}

TEST_MAIN
