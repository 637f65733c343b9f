/* Thresholds of the hierarchy against what the man page says; the stretch of a matrix against
 * vectors that it is tried on. */
#include "libcore/gbuffer/gbuffer.h"
#include "libcore/gbuffer/lod.h"
#include "libcore/data/rng.h"
#include "tests/check.h"

static const pbs_lod standard = PBS_LOD_DEFAULT;

static double uniform(uint64_t *state) {
    *state += 1;
    return (double)(pbs_mix64(*state * 0x9e3779b97f4a7c15u) >> 11) * 0x1p-53;
}

TEST(count) {
    CHECK(pbs_lod_count(&standard, 0, false) == 0 && pbs_lod_count(&standard, 0, true) == 0);
    CHECK(pbs_lod_count(&standard, 999, false) == 0);
    CHECK(pbs_lod_count(&standard, 1000, false) == 500);
    CHECK(pbs_lod_count(&standard, 1001, false) == 500);
    CHECK(pbs_lod_count(&standard, 399999, false) == 199999);
    CHECK(pbs_lod_count(&standard, 400000, false) == 200000);
    CHECK(pbs_lod_count(&standard, UINT64_MAX, false) == 200000);
    CHECK(pbs_lod_count(&standard, 1, true) == 200000);
    pbs_lod lod = {1, 1e6, 50000000000, 0, 0};
    CHECK(pbs_lod_count(&lod, 1, false) == 1000000);
    CHECK(pbs_lod_count(&lod, UINT64_MAX, false) == UINT32_MAX);
    lod.share = 0;
    CHECK(pbs_lod_count(&lod, 1000000, false) == 0 && pbs_lod_count(&lod, 1, true) == UINT32_MAX);
}

TEST(count_rises) {
    for (uint64_t n = 1; n < 1000000; n += 1 + n / 50)
        CHECK(pbs_lod_count(&standard, n, false) <= pbs_lod_count(&standard, n + 1, false) &&
              pbs_lod_count(&standard, n, false) <= pbs_lod_count(&standard, n, true) &&
              2 * (uint64_t)pbs_lod_count(&standard, n, false) <= n);
}

TEST(resolution) {
    CHECK(pbs_lod_resolution(&standard, 200000, 1) == 1415); /* sqrt(2e6) = 1414.2 */
    CHECK(pbs_lod_resolution(&standard, 500, 1) == 71);
    CHECK(pbs_lod_resolution(&standard, 409, 1) == 64 && pbs_lod_resolution(&standard, 1, 1) == 64);
    CHECK(pbs_lod_resolution(&standard, UINT32_MAX, 1) == PBS_GBUFFER_MAX_SIZE);
    pbs_lod lod = {1000, 0.5, 10000, 400, 0};
    CHECK(pbs_lod_resolution(&lod, 10000, 1) == 400 && pbs_lod_resolution(&lod, 2500, 1) == 200);
    CHECK(pbs_lod_resolution(&lod, 10, 1) == 64);
    lod.resolution = 10; /* less than 64 only where the user says so */
    CHECK(pbs_lod_resolution(&lod, 10000, 1) == 10 && pbs_lod_resolution(&lod, 10, 1) == 10);
    lod.resolution = PBS_GBUFFER_MAX_SIZE;
    CHECK(pbs_lod_resolution(&lod, UINT32_MAX, 1) == PBS_GBUFFER_MAX_SIZE);
}

static double length_of(const double m[12], const double v[3]) {
    double p[3];
    for (int r = 0; r < 3; r++) p[r] = m[4 * r] * v[0] + m[4 * r + 1] * v[1] + m[4 * r + 2] * v[2];
    return hypot(hypot(p[0], p[1]), p[2]);
}

/* The longest of many vectors of length 1, refined around the best so far. */
static double tried(const double m[12], uint64_t *seed) {
    double best = 0, at[3] = {1, 0, 0}, reach = 2;
    for (int i = 0; i < 3000; i++) {
        double v[3], l = 0;
        for (int k = 0; k < 3; k++) v[k] = at[k] + reach * (2 * uniform(seed) - 1);
        for (int k = 0; k < 3; k++) l += v[k] * v[k];
        for (int k = 0; k < 3; k++) v[k] /= sqrt(l);
        if (i >= 300) reach = fmax(1e-5, reach * 0.996);
        if (length_of(m, v) <= best) continue;
        best = length_of(m, v);
        memcpy(at, v, sizeof at);
    }
    return best;
}

TEST(resolution_of_an_error) {
    pbs_lod lod = PBS_LOD_DEFAULT;
    lod.error = 0.01;
    CHECK(pbs_lod_resolution(&lod, 200000, 1) == 500 &&
          pbs_lod_resolution(&lod, 200000, 2) == 1000);
    CHECK(pbs_lod_resolution(&lod, 200000, 100) == 1415); /* finer would be of no use */
    CHECK(pbs_lod_resolution(&lod, 200000, 0) == 64 &&
          pbs_lod_resolution(&lod, 200000, 1e-300) == 64);
}

TEST(stretch_is_the_longest_vector) {
    uint64_t seed = 3;
    for (int t = 0; t < 100; t++) {
        double m[12];
        for (int i = 0; i < 12; i++) m[i] = uniform(&seed) - 0.5;
        for (int i = 0; i < 3; i++) m[4 * (t % 3) + i] *= t % 5 ? 1 : 0; /* some are singular */
        double s = pbs_lod_stretch(m), v = tried(m, &seed);
        CHECK_NUM(fabs(s - v) <= 1e-6 * s, s / v - 1);
    }
}

TEST(stretch_of_any_size) {
    static const double turned[12] = {0, -3, 0, 9e99, 2, 0, 0, NAN, 0, 0, -1, INFINITY};
    for (int e = -300; e <= 300; e += 20) {
        double m[12];
        for (int i = 0; i < 12; i++) m[i] = turned[i] * pow(10, e);
        CHECK_NUM(fabs(pbs_lod_stretch(m) / pow(10, e) - 3) < 1e-12, e);
    }
    double m[12] = {0};
    CHECK(pbs_lod_stretch(m) == 0 && fabs(pbs_lod_stretch(PBS_IDENTITY) - 1) < 1e-15);
    m[5] = 1, m[6] = 1e-150; /* a spread whose cube is nothing */
    CHECK(fabs(pbs_lod_stretch(m) - 1) < 1e-15);
    m[1] = INFINITY;
    CHECK(!(pbs_lod_stretch(m) < INFINITY));
    m[1] = NAN;
    CHECK(isnan(pbs_lod_stretch(m)));
}

TEST(fine) {
    const pbs_box box = {{-50, 0, 1}, {50, 1, 1}};
    double m[12];
    memcpy(m, PBS_IDENTITY, sizeof m);
    CHECK(pbs_lod_fine(&box, 0.125, m, 0.35) && !pbs_lod_fine(&box, 0.125, m, 0.3499));
    m[0] = -1; /* mirrored: the same directions */
    CHECK(pbs_lod_fine(&box, 0.125, m, 0.35));
    m[0] = m[5] = m[10] = 0;
    m[1] = 2, m[6] = -2, m[8] = 2; /* quarter turns and a scale, which counts */
    CHECK(pbs_lod_keeps_views(m));
    CHECK(pbs_lod_fine(&box, 0.125, m, 0.7001) && !pbs_lod_fine(&box, 0.125, m, 0.699));
    m[0] = 0.1, m[1] = 2 * sqrt(1 - 0.0025); /* at an angle: only as a speck of ten pixels */
    CHECK(!pbs_lod_keeps_views(m) && !pbs_lod_fine(&box, 0.125, m, 1));
    CHECK(pbs_lod_fine(&box, 0.125, m, 22) && !pbs_lod_fine(&box, 0.125, m, 19));
    memcpy(m, PBS_IDENTITY, sizeof m);
    m[0] = 0.9; /* pressed: other directions */
    CHECK(!pbs_lod_keeps_views(m));
    m[0] = 0, m[8] = 1; /* flat */
    CHECK(!pbs_lod_keeps_views(m));
    memcpy(m, PBS_IDENTITY, sizeof m);
    CHECK(!pbs_lod_fine(&box, 0, m, 1) && !pbs_lod_fine(&box, 1, m, 0) &&
          !pbs_lod_fine(&box, NAN, m, 1) && !pbs_lod_fine(&box, 1e-9, m, NAN));
    m[0] = NAN;
    CHECK(!pbs_lod_fine(&box, 1e-9, m, 1));
    m[0] = INFINITY;
    CHECK(!pbs_lod_fine(&box, 1e-9, m, 1));
}
TEST_MAIN
