/* Texture pyramids and look-up, and the sRGB tables. */
#include "libcore/data/texture.h"
#include "tests/check.h"

static uint64_t seed = 3;
static uint32_t rnd(uint32_t n) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(seed >> 33) % n;
}

static pbs_image noise(uint32_t w, uint32_t h) {
    pbs_image m = {w, h, malloc((size_t)4 * w * h)};
    for (size_t i = 0; i < (size_t)4 * w * h; i++) m.rgba[i] = (uint8_t)rnd(256);
    return m;
}

static pbs_texture build(pbs_run *run, const pbs_image *m, bool srgb) {
    pbs_texture t;
    pbs_err err;
    size_t before = pbs_mem_used(run);
    CHECK(pbs_texture_build(run, m, srgb, &t, &err) == PBS_OK);
    CHECK(pbs_mem_used(run) - before <= pbs_texture_need(m));
    return t;
}

TEST(srgb_tables) {
    const pbs_srgb_table *t = pbs_srgb();
    int wrong = 0;
    for (int i = 0; i < 256; i++) wrong += pbs_srgb_encode(t, t->linear[i]) != i;
    for (int i = 0; i <= 300000; i++) {
        float v = (float)i / 290000;
        int a = pbs_srgb_encode(t, v), b = pbs_unorm8(pbs_linear_to_srgb(v));
        float exact = 255 * pbs_linear_to_srgb(v < 1 ? v : 1);
        wrong += a != b && fabsf(fabsf(exact - (float)a) - 0.5f) > 1e-3f;
    }
    CHECK_NUM(wrong == 0, wrong);
    CHECK(pbs_srgb_encode(t, NAN) == 0 && pbs_srgb_encode(t, -INFINITY) == 0);
    CHECK(pbs_srgb_encode(t, INFINITY) == 255 && pbs_srgb_encode(t, -0.0f) == 0);
}

/* The top of the pyramid is the mean of the image, for odd sizes too. */
TEST(top_is_the_mean) {
    const uint32_t sizes[][2] = {{1, 1}, {2, 2}, {3, 1}, {1, 7}, {64, 64}, {33, 17}, {100, 3}};
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        pbs_run run = {.threads = 1};
        pbs_image m = noise(sizes[s][0], sizes[s][1]);
        pbs_texture t = build(&run, &m, false);
        double mean[4] = {0}, n = (double)m.width * m.height;
        for (size_t i = 0; i < (size_t)n; i++)
            for (int k = 0; k < 4; k++) mean[k] += m.rgba[4 * i + (size_t)k] / n;
        int top = t.levels - 1;
        CHECK(t.width[top] == 1 && t.height[top] == 1);
        for (int k = 0; k < 4; k++) CHECK_NUM(fabs(t.level[top][k] - mean[k]) < 3, s);
        pbs_texture_free(&run, &t);
        CHECK(pbs_mem_used(&run) == 0);
        free(m.rgba);
    }
}

/* Level 0 against bilinear interpolation written out, for all ways to wrap. */
TEST(look_up_and_wrap) {
    pbs_run run = {.threads = 1};
    pbs_image m = noise(5, 3);
    pbs_texture t = build(&run, &m, true);
    const double none[2] = {0, 0};
    int wrong = 0;
    for (int i = 0; i < 3000; i++) {
        pbs_texture_use use = {0, (uint8_t)(i % 3), (uint8_t)(i / 3 % 3), {1, 0, 0, 0, 1, 0}};
        double uv[2] = {(rnd(8000) - 4000.0) / 1000, (rnd(8000) - 4000.0) / 1000}, want[4] = {0};
        double x = uv[0] * 5 - 0.5, y = uv[1] * 3 - 0.5;
        for (int c = 0; c < 4; c++) {
            int64_t n[2] = {5, 3},
                    at[2] = {(int64_t)floor(x) + (c & 1), (int64_t)floor(y) + (c >> 1)};
            double w = (c & 1 ? x - floor(x) : 1 - x + floor(x)) *
                       (c >> 1 ? y - floor(y) : 1 - y + floor(y));
            for (int k = 0; k < 2; k++) {
                int mode = k ? use.wrap_v : use.wrap_u;
                if (mode == 1) at[k] = at[k] < 0 ? 0 : at[k] >= n[k] ? n[k] - 1 : at[k];
                while (mode == 0 && at[k] < 0) at[k] += n[k];
                while (mode == 2 && at[k] < 0) at[k] += 2 * n[k];
                at[k] %= mode == 2 ? 2 * n[k] : n[k];
                if (at[k] >= n[k]) at[k] = 2 * n[k] - 1 - at[k];
            }
            const uint8_t *p = m.rgba + 4 * (5 * at[1] + at[0]);
            for (int k = 0; k < 4; k++)
                want[k] += w * (k < 3 ? pbs_srgb_to_linear((float)p[k] / 255) : (float)p[k] / 255);
        }
        float got[4];
        pbs_texture_sample(&t, &use, uv, none, none, got);
        for (int k = 0; k < 4; k++) wrong += fabs(got[k] - want[k]) > 1e-5;
    }
    CHECK_NUM(wrong == 0, wrong);
    pbs_texture_free(&run, &t);
    free(m.rgba);
}

/* A footprint of the whole picture gives its mean, whatever is asked for at which place; the
 * transform scales the footprint too. */
TEST(levels_follow_the_footprint) {
    pbs_run run = {.threads = 1};
    pbs_image m = noise(64, 64);
    pbs_texture t = build(&run, &m, false);
    pbs_texture_use use = PBS_TEXTURE_NONE;
    double last = 1;
    for (int level = 0; level <= 5; level++) {
        double step = ldexp(1.0 / 64, level), square = 0;
        for (int i = 0; i < 500; i++) {
            double uv[2] = {rnd(1000) / 1000.0, rnd(1000) / 1000.0};
            double dx[2] = {step, 0}, dy[2] = {0, step / 3};
            float a[4], b[4];
            pbs_texture_sample(&t, &use, uv, dx, dy, a);
            square += (a[0] - 0.5) * (a[0] - 0.5) / 500;
            pbs_texture_use half = use;
            half.transform[0] = half.transform[4] = 0.5f;
            for (int k = 0; k < 2; k++) uv[k] *= 2, dx[k] *= 2, dy[k] *= 2;
            pbs_texture_sample(&t, &half, uv, dx, dy, b);
            CHECK(!memcmp(a, b, sizeof a));
        }
        CHECK_NUM(square < 0.5 * last, square); /* noise fades by two a level */
        last = square;
    }
    pbs_texture_free(&run, &t);
    free(m.rgba);
}

TEST(odd_input) {
    pbs_run run = {.threads = 1};
    pbs_image m = noise(4, 4), empty = {0, 0, NULL};
    pbs_texture t = build(&run, &m, true), white = build(&run, &empty, true);
    pbs_texture_use use = PBS_TEXTURE_NONE;
    const double odd[] = {0, -1e-300, 1e8, -1e18, 1e308, INFINITY, -INFINITY, NAN};
    float out[4];
    for (int i = 0; i < 8 * 8 * 8; i++) {
        double uv[2] = {odd[i % 8], odd[i / 8 % 8]}, dx[2] = {odd[i / 64], 0},
               dy[2] = {0, odd[i % 8]};
        use.wrap_u = use.wrap_v = (uint8_t)(i % 3);
        pbs_texture_sample(&t, &use, uv, dx, dy, out);
        for (int k = 0; k < 4; k++) CHECK(out[k] >= 0 && out[k] <= 1.0001f);
    }
    pbs_texture_sample(&white, &use, odd, odd, odd, out);
    CHECK(out[0] == 1 && out[3] == 1 && pbs_texture_need(&empty) == 0);
    pbs_texture_free(&run, &t), pbs_texture_free(&run, &white);
    CHECK(pbs_mem_used(&run) == 0);
    free(m.rgba);
    m = noise(300, 300);
    run.mem_limit = 1000;
    pbs_err err;
    CHECK(pbs_texture_build(&run, &m, true, &t, &err) == PBS_LIMIT);
    pbs_texture_free(&run, &t);
    free(m.rgba);
}

TEST_MAIN
