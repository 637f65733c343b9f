/* Picture metrics against a direct implementation in double, and their laws. */
#include "libcore/measures/metrics.h"
#include "tests/check.h"

static pbs_run run = {.threads = 1};
static uint32_t state = 1;

static uint32_t random_bits(void) {
    state = state * 1664525u + 1013904223u;
    return state >> 8;
}

static pbs_image new_image(uint32_t w, uint32_t h) {
    pbs_image image = {w, h, calloc((size_t)w * h, 4)};
    return image;
}

static void paint(pbs_image *i, int r, int g, int b, int a) {
    for (size_t p = 0; p < (size_t)i->width * i->height; p++)
        i->rgba[4 * p] = r, i->rgba[4 * p + 1] = g, i->rgba[4 * p + 2] = b, i->rgba[4 * p + 3] = a;
}

/* Smooth shapes and some noise: every term of SSIM matters. */
static void scribble(pbs_image *i, double phase, int noise) {
    for (uint32_t y = 0; y < i->height; y++)
        for (uint32_t x = 0; x < i->width; x++) {
            uint8_t *p = i->rgba + 4 * ((size_t)y * i->width + x);
            for (int c = 0; c < 3; c++) {
                double v = 128 + 90 * sin(0.15 * x + phase * c) * cos(0.11 * y - phase);
                v += noise ? (int)(random_bits() % (uint32_t)noise) - noise / 2 : 0;
                p[c] = v < 0 ? 0 : v > 255 ? 255 : (uint8_t)v;
            }
            p[3] = random_bits() & 1 ? 255 : 0;
        }
}

static double luma(const pbs_image *i, uint32_t x, uint32_t y) {
    const uint8_t *p = i->rgba + 4 * ((size_t)y * i->width + x);
    return 0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2];
}

/* SSIM of the window whose top left is (x, y), straight from the definition. */
static double ssim_at(const pbs_image *a, const pbs_image *b, uint32_t x, uint32_t y) {
    double w = 0, ma = 0, mb = 0, va = 0, vb = 0, cov = 0;
    double c1 = 0.01 * 255 * 0.01 * 255, c2 = 0.03 * 255 * 0.03 * 255;
    for (int pass = 0; pass < 2; pass++) {
        for (int j = 0; j < 11; j++)
            for (int i = 0; i < 11; i++) {
                double g = exp(-((i - 5) * (i - 5) + (j - 5) * (j - 5)) / (2 * 1.5 * 1.5));
                double p = luma(a, x + i, y + j), q = luma(b, x + i, y + j);
                if (pass == 0) {
                    w += g, ma += g * p, mb += g * q;
                } else {
                    va += g / w * (p - ma) * (p - ma);
                    vb += g / w * (q - mb) * (q - mb);
                    cov += g / w * (p - ma) * (q - mb);
                }
            }
        if (pass == 0) ma /= w, mb /= w;
    }
    return (2 * ma * mb + c1) * (2 * cov + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2));
}

static pbs_picture_error direct(const pbs_image *a, const pbs_image *b) {
    pbs_picture_error e = {0};
    size_t pixels = (size_t)a->width * a->height, ca = 0, cb = 0, hole = 0, spill = 0;
    double square = 0;
    for (uint32_t y = 0; y + 11 <= a->height; y++)
        for (uint32_t x = 0; x + 11 <= a->width; x++) e.ssim += ssim_at(a, b, x, y);
    e.ssim /= (a->width - 10.0) * (a->height - 10.0);
    for (size_t i = 0; i < 4 * pixels; i++) {
        double d = abs(a->rgba[i] - b->rgba[i]);
        if (i % 4 == 3) {
            int p = a->rgba[i] >= 128, q = b->rgba[i] >= 128;
            ca += p, cb += q, hole += q && !p, spill += p && !q;
        } else {
            square += d * d;
            e.max = d > e.max ? d : e.max;
        }
    }
    e.psnr = 20 * log10(255 / sqrt(square / (3.0 * pixels)));
    e.hole = cb ? (double)hole / cb : 0;
    e.spill = ca ? (double)spill / ca : 0;
    return e;
}

static void check_pair(uint32_t w, uint32_t h, int noise) {
    pbs_image a = new_image(w, h), b = new_image(w, h);
    pbs_picture_error got = {0};
    scribble(&a, 0.3, noise);
    scribble(&b, 0.35, noise);
    CHECK(pbs_picture_compare(&run, &a, &b, &got, NULL) == PBS_OK);
    pbs_picture_error want = direct(&a, &b);
    CHECK_NUM(fabs(got.ssim - want.ssim) < 1e-5, got.ssim - want.ssim);
    CHECK_NUM(fabs(got.psnr - want.psnr) < 1e-9, got.psnr - want.psnr);
    CHECK(got.max == want.max && got.hole == want.hole && got.spill == want.spill);
    free(a.rgba), free(b.rgba);
}

TEST(equals_direct_implementation) {
    for (uint32_t w = 11; w < 46; w += 1 + w % 3) check_pair(w, 57 - w, 40);
    check_pair(11, 11, 200);
    check_pair(64, 16, 0);
    check_pair(129, 33, 250);
}

TEST(equal_pictures) {
    pbs_image a = new_image(50, 40);
    pbs_picture_error e;
    for (int noise = 0; noise < 256; noise += 51) {
        scribble(&a, 0.1 * noise, noise);
        CHECK(pbs_picture_compare(&run, &a, &a, &e, NULL) == PBS_OK);
        CHECK_NUM(e.ssim == 1, e.ssim);
        CHECK(isinf(e.psnr) && e.psnr > 0 && e.max == 0 && e.hole == 0 && e.spill == 0);
    }
    free(a.rgba);
}

TEST(swapping_swaps_hole_and_spill) {
    pbs_image a = new_image(70, 30), b = new_image(70, 30);
    pbs_picture_error ab, ba;
    scribble(&a, 0, 30);
    scribble(&b, 1, 90);
    CHECK(pbs_picture_compare(&run, &a, &b, &ab, NULL) == PBS_OK);
    CHECK(pbs_picture_compare(&run, &b, &a, &ba, NULL) == PBS_OK);
    CHECK(ab.ssim == ba.ssim && ab.psnr == ba.psnr && ab.max == ba.max);
    CHECK(ab.hole == ba.spill && ab.spill == ba.hole);
    CHECK_NUM(ab.ssim < 0.95, ab.ssim);
    free(a.rgba), free(b.rgba);
}

/* Flat pictures have no variance: SSIM is its luminance term alone. */
TEST(flat_pictures) {
    pbs_image a = new_image(20, 20), b = new_image(20, 20);
    pbs_picture_error e;
    double c1 = 0.01 * 255 * 0.01 * 255;
    paint(&a, 100, 100, 100, 255);
    paint(&b, 150, 150, 150, 255);
    CHECK(pbs_picture_compare(&run, &a, &b, &e, NULL) == PBS_OK);
    double want = (2 * 100 * 150 + c1) / (100 * 100 + 150 * 150 + c1);
    CHECK_NUM(fabs(e.ssim - want) < 1e-5, e.ssim - want);
    CHECK_NUM(fabs(e.psnr - 20 * log10(255 / 50.0)) < 1e-9, e.psnr);
    CHECK(e.max == 50 && e.hole == 0 && e.spill == 0);
    paint(&a, 0, 0, 0, 0);
    paint(&b, 255, 255, 255, 0);
    CHECK(pbs_picture_compare(&run, &a, &b, &e, NULL) == PBS_OK);
    CHECK_NUM(e.ssim < 2e-4 && e.ssim >= 0, e.ssim);
    CHECK(fabs(e.psnr) < 1e-9 && e.max == 255 && e.hole == 0 && e.spill == 0);
    free(a.rgba), free(b.rgba);
}

TEST(hole_and_spill_counts) {
    pbs_image a = new_image(16, 16), b = new_image(16, 16);
    pbs_picture_error e;
    paint(&a, 9, 9, 9, 0);
    paint(&b, 9, 9, 9, 0);
    for (int i = 0; i < 100; i++) b.rgba[4 * i + 3] = 255; /* the truth: 0 .. 99 */
    for (int i = 90; i < 110; i++) a.rgba[4 * i + 3] = i == 109 ? 127 : 128;
    CHECK(pbs_picture_compare(&run, &a, &b, &e, NULL) == PBS_OK);
    CHECK_NUM(fabs(e.hole - 0.90) < 1e-12, e.hole);
    CHECK_NUM(fabs(e.spill - 9.0 / 19) < 1e-12, e.spill);
    CHECK(e.ssim == 1 && isinf(e.psnr)); /* coverage is no colour */
    free(a.rgba), free(b.rgba);
}

TEST(more_noise_is_worse) {
    pbs_image a = new_image(64, 64), b = new_image(64, 64);
    pbs_picture_error e, last = {.ssim = 1, .psnr = INFINITY};
    for (int noise = 4; noise <= 256; noise *= 2) {
        scribble(&a, 0.4, 0);
        scribble(&b, 0.4, noise);
        CHECK(pbs_picture_compare(&run, &b, &a, &e, NULL) == PBS_OK);
        CHECK_NUM(e.ssim < last.ssim && e.psnr < last.psnr, noise);
        last = e;
    }
    free(a.rgba), free(b.rgba);
}

TEST(refusals) {
    pbs_image a = new_image(20, 20), b = new_image(20, 21), c = new_image(10, 20);
    pbs_picture_error e;
    pbs_err err;
    CHECK(pbs_picture_compare(&run, &a, &b, &e, &err) == PBS_DATA && strstr(err.text, "differ"));
    CHECK(pbs_picture_compare(&run, &c, &c, &e, &err) == PBS_DATA && strstr(err.text, "at least"));
    pbs_run small = {.threads = 1, .mem_limit = 1000};
    CHECK(pbs_picture_compare(&small, &a, &a, &e, &err) == PBS_LIMIT);
    volatile sig_atomic_t stop = 1;
    pbs_run cancelled = {.threads = 1, .cancel = &stop};
    CHECK(pbs_picture_compare(&cancelled, &a, &a, &e, &err) == PBS_CANCEL);
    CHECK(pbs_mem_used(&small) == 0 && pbs_mem_used(&cancelled) == 0 && pbs_mem_used(&run) == 0);
    free(a.rgba), free(b.rgba), free(c.rgba);
}

TEST_MAIN
