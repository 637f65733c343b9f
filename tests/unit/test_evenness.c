/* evenness.h against all pairs, for sets of every kind; and what is known of a square lattice. */
#include "libcore/measures/evenness.h"
#include "libcore/data/rng.h"
#include "tests/check.h"
#include <math.h>

static pbs_run run = {.threads = 1};
static pbs_err err;

enum { MOST = 900 };
static float p[3 * MOST], surface[3 * MOST];

static double chance(uint64_t i) {
    return (double)(pbs_mix64(i * 0x9e3779b97f4a7c15u) >> 11) * 0x1p-53;
}

static double d2(const float *a, const float *b) {
    double s = 0;
    for (int k = 0; k < 3; k++) s += ((double)a[k] - (double)b[k]) * ((double)a[k] - (double)b[k]);
    return s;
}

static bool near(double a, double b) {
    return a == b || fabs(a - b) <= 1e-12 * (fabs(a) + fabs(b));
}

static void compare(size_t n, size_t m, double radius) {
    pbs_points of = {.count = n, .position = p}, on = {.count = m, .position = surface};
    pbs_evenness e;
    double least = INFINITY, sum = 0, covering = 0, within = 0, square = 0;
    for (size_t i = 0; i < n; i++) {
        double best = INFINITY;
        for (size_t k = 0; k < n; k++) best = k == i ? best : fmin(best, d2(p + 3 * i, p + 3 * k));
        sum += sqrt(best);
        least = fmin(least, sqrt(best));
    }
    for (size_t i = 0; i < m; i++) {
        double best = INFINITY, count = 0;
        for (size_t k = 0; k < n; k++) {
            double d = d2(surface + 3 * i, p + 3 * k);
            best = fmin(best, d);
            count += d <= radius * radius;
        }
        covering = fmax(covering, sqrt(best));
        within += count, square += count * count;
    }
    CHECK(!pbs_evenness_of(&run, &of, &on, radius, &e, &err));
    CHECK(e.count == n && !run.mem_used);
    CHECK_NUM(near(e.covering, covering) && e.covering99 <= covering, e.covering);
    if (n > 1) CHECK_NUM(near(e.least, least) && near(e.mean, sum / (double)n), e.least);
    double mean = within / (double)m, sigma = sqrt(fmax(square / (double)m - mean * mean, 0));
    CHECK_NUM(mean == 0 ? e.scatter == 0 : fabs(e.scatter - sigma / mean) < 1e-6, e.scatter);
}

/* kind 0: in a cube; 1: on a plane; 2: on a line; 3: at few places; 4: two heaps far apart. */
static void place(float *to, size_t n, int kind, uint64_t seed) {
    for (size_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) {
            double v = chance(seed + 3 * i + (uint64_t)k);
            if (kind == 1 && k == 2) v = 0.25;
            if (kind == 2 && k) v = 1e6;
            if (kind == 3) v = floor(4 * v);
            if (kind == 4) v += i % 2 ? 1e7 : 0;
            to[3 * i + (size_t)k] = (float)v;
        }
}

TEST(as_all_pairs_say) {
    const size_t counts[] = {1, 2, 3, 50, 900};
    for (int kind = 0; kind < 5; kind++)
        for (int i = 0; i < 5; i++) {
            place(p, counts[i], kind, 1);
            place(surface, 700, kind, 1000003);
            compare(counts[i], 700, 0.2);
        }
    /* a surface that is elsewhere */
    place(p, 300, 1, 1);
    place(surface, 50, 4, 9);
    compare(300, 50, 1e7);
}

TEST(a_square_lattice) {
    pbs_points of = {.count = MOST, .position = p};
    pbs_evenness e;
    for (int i = 0; i < MOST; i++)
        p[3 * i] = (float)(i % 30), p[3 * i + 1] = (float)(i / 30), p[3 * i + 2] = 0;
    CHECK(!pbs_evenness_of(&run, &of, NULL, 0, &e, &err));
    CHECK(e.least == 1 && e.mean == 1 && e.sigma == 0 && e.percentile == 1 && e.covering == 0);
}

TEST(nothing_and_no_numbers) {
    pbs_points of = {.count = 0, .position = p}, on = {.count = 3, .position = surface};
    pbs_evenness e;
    place(surface, 3, 0, 5);
    CHECK(!pbs_evenness_of(&run, &of, &on, 1, &e, &err));
    CHECK(e.count == 0 && isinf(e.covering) && e.scatter == 0);
    p[0] = NAN, p[1] = p[2] = 0;
    p[3] = p[4] = 1, p[5] = INFINITY;
    p[6] = p[7] = p[8] = 2;
    of.count = 3;
    surface[0] = NAN;
    CHECK(!pbs_evenness_of(&run, &of, &on, 1, &e, &err));
    CHECK(e.count == 1 && e.least == 0 && isfinite(e.covering));
    for (int i = 0; i < 9; i++) p[i] = i % 2 ? -3e38f : 3e38f;
    CHECK(!pbs_evenness_of(&run, &of, &on, 1, &e, &err));
    CHECK(e.count == 3 && e.mean >= 0);
    CHECK(!run.mem_used);
}

TEST_MAIN
