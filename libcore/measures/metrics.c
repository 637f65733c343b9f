/* metrics.c: structural similarity (Wang, Bovik, Sheikh, Simoncelli 2004), PSNR, holes.
 *
 * One pass over the rows. Each row of luma is filtered along x into a ring of 11 rows, and the
 * ring is filtered along y; so the memory is a few rows, and stays in the cache. SSIM needs the
 * variances only as a sum, so four moments do instead of five.
 */
#include "libcore/measures/metrics.h"
#include <string.h>

enum {
    TAPS = 11,
    HALF = TAPS / 2,
    BLOCK = 16, /* inner loops have this length, known to the compiler, so it vectorises them */
    MOMENTS = 4 /* x, y, x^2 + y^2, xy */
};

/* exp(-(i - 5)^2 / (2 * 1.5^2)), normalised to sum 1. */
static const float WEIGHT[HALF + 1] = {0.00102838008f, 0.00759875814f, 0.0360007721f,
                                       0.109360689f,   0.213005538f,   0.266011725f};

/* Luma is shifted by this, which halves the largest square twice: variances are differences of
 * squares, in float. */
#define SHIFT 128.0f
#define C1    (0.01f * 255 * 0.01f * 255)
#define C2    (0.03f * 255 * 0.03f * 255)

typedef struct rows {
    size_t width;          /* of the picture */
    size_t padded;         /* of a row here: whole blocks, and a filter's length more */
    float *plane[MOMENTS]; /* this row's values */
    float *ring[MOMENTS];  /* TAPS rows, filtered along x */
    float *ssim;           /* one row of results */
} rows;

/* The colour bytes of BLOCK pixels. */
#define COLOUR4  255, 255, 255, 0
#define COLOUR16 COLOUR4, COLOUR4, COLOUR4, COLOUR4
static const uint8_t COLOUR[4 * BLOCK] = {COLOUR16, COLOUR16, COLOUR16, COLOUR16};

typedef struct totals {
    double ssim;
    uint64_t square, truth, picture, hole, spill;
    unsigned max;
} totals;

static inline __attribute__((always_inline)) void luma_body(const rows *r, const uint8_t *a,
                                                            const uint8_t *b) {
    float *x = r->plane[0], *y = r->plane[1], *ss = r->plane[2], *xy = r->plane[3];
    for (size_t i = 0; i < r->width; i++) {
        const uint8_t *p = a + 4 * i, *q = b + 4 * i;
        x[i] = 0.2126f * p[0] + 0.7152f * p[1] + 0.0722f * p[2] - SHIFT;
        y[i] = 0.2126f * q[0] + 0.7152f * q[1] + 0.0722f * q[2] - SHIFT;
    }
    for (size_t i = 0; i < r->width; i += BLOCK)
        for (size_t j = i; j < i + BLOCK; j++) {
            ss[j] = x[j] * x[j] + y[j] * y[j];
            xy[j] = x[j] * y[j];
        }
}

/* Result i stands for the window that begins at i. */
static inline __attribute__((always_inline)) void along_x_body(const rows *r, size_t slot) {
    for (int m = 0; m < MOMENTS; m++) {
        const float *in = r->plane[m];
        float *out = r->ring[m] + slot * r->padded;
        for (size_t i = 0; i < r->width; i += BLOCK) {
            float sum[BLOCK];
            for (int j = 0; j < BLOCK; j++) sum[j] = WEIGHT[HALF] * in[i + HALF + j];
            for (int k = 0; k < HALF; k++)
                for (int j = 0; j < BLOCK; j++)
                    sum[j] += WEIGHT[k] * (in[i + k + j] + in[i + TAPS - 1 - k + j]);
            memcpy(out + i, sum, sizeof sum);
        }
    }
}

/* first: the slot of the window's top row. */
static inline __attribute__((always_inline)) void along_y_body(const rows *r, size_t first) {
    for (size_t i = 0; i < r->width; i += BLOCK) {
        float s[MOMENTS][BLOCK];
        for (int m = 0; m < MOMENTS; m++) {
            const float *ring = r->ring[m] + i;
            const float *mid = ring + (first + HALF) % TAPS * r->padded;
            for (int j = 0; j < BLOCK; j++) s[m][j] = WEIGHT[HALF] * mid[j];
            for (size_t k = 0; k < HALF; k++) {
                const float *top = ring + (first + k) % TAPS * r->padded;
                const float *low = ring + (first + TAPS - 1 - k) % TAPS * r->padded;
                for (int j = 0; j < BLOCK; j++) s[m][j] += WEIGHT[k] * (top[j] + low[j]);
            }
        }
        for (int j = 0; j < BLOCK; j++) {
            /* Written so that equal rows give equal bits above and below the line: exactly 1. */
            float x = s[0][j], y = s[1][j], square = x * x + y * y, product = x * y;
            float covariance = 2 * (s[3][j] - product), variance = s[2][j] - square;
            x += SHIFT, y += SHIFT;
            r->ssim[i + j] =
                (2 * (x * y) + C1) * (covariance + C2) / ((x * x + y * y + C1) * (variance + C2));
        }
    }
}

static void row_portable(const rows *r, const uint8_t *a, const uint8_t *b, size_t slot) {
    luma_body(r, a, b);
    along_x_body(r, slot);
}
static void window_portable(const rows *r, size_t first) {
    along_y_body(r, first);
}

/* The same operations eight at a time: the same bits. */
#if defined(__x86_64__)
__attribute__((target("avx2"))) static void row_avx2(const rows *r, const uint8_t *a,
                                                     const uint8_t *b, size_t slot) {
    luma_body(r, a, b);
    along_x_body(r, slot);
}
__attribute__((target("avx2"))) static void window_avx2(const rows *r, size_t first) {
    along_y_body(r, first);
}
static bool wide(void) {
    return __builtin_cpu_supports("avx2");
}
#else
#define row_avx2    row_portable
#define window_avx2 window_portable
static bool wide(void) {
    return false;
}
#endif

/* BLOCK pixels of both pictures. Covered: the top bit of alpha. */
static inline void block_differences(totals *t, const uint8_t *a, const uint8_t *b) {
    enum { BYTES = 4 * BLOCK };
    int square = 0, picture = 0, truth = 0, both = 0;
    uint8_t d[BYTES], max = 0;
    for (int i = 0; i < BYTES; i++) {
        uint8_t high = a[i] > b[i] ? a[i] : b[i], low = a[i] > b[i] ? b[i] : a[i];
        d[i] = (uint8_t)(high - low) & COLOUR[i];
    }
    for (int i = 0; i < BYTES; i++) max = d[i] > max ? d[i] : max;
    for (int i = 0; i < BYTES; i++) square += (int16_t)d[i] * (int16_t)d[i];
    for (int i = 0; i < BLOCK; i++) {
        int p = a[4 * i + 3] >> 7, q = b[4 * i + 3] >> 7;
        picture += p, truth += q, both += p & q;
    }
    t->square += (unsigned)square;
    t->max = max > t->max ? max : t->max;
    t->truth += (unsigned)truth, t->picture += (unsigned)picture;
    t->hole += (unsigned)(truth - both), t->spill += (unsigned)(picture - both);
}

static void row_differences(totals *t, const uint8_t *a, const uint8_t *b, size_t width) {
    uint8_t rest[2][4 * BLOCK] = {{0}};
    size_t whole = width / BLOCK * BLOCK;
    for (size_t i = 0; i < whole; i += BLOCK) block_differences(t, a + 4 * i, b + 4 * i);
    memcpy(rest[0], a + 4 * whole, 4 * (width - whole));
    memcpy(rest[1], b + 4 * whole, 4 * (width - whole));
    block_differences(t, rest[0], rest[1]);
}

static pbs_code compare_rows(const pbs_run *run, const rows *r, const pbs_image *a,
                             const pbs_image *b, totals *t, pbs_err *err) {
    bool fast = wide();
    for (size_t y = 0; y < a->height; y++) {
        const uint8_t *p = a->rgba + 4 * y * r->width, *q = b->rgba + 4 * y * r->width;
        if (y % 64 == 0 && pbs_run_check(run, err)) return PBS_CANCEL;
        row_differences(t, p, q, r->width);
        (fast ? row_avx2 : row_portable)(r, p, q, y % TAPS);
        if (y + 1 < TAPS) continue;
        (fast ? window_avx2 : window_portable)(r, (y + 1) % TAPS);
        double sum = 0;
        for (size_t x = 0; x + TAPS <= r->width; x++) sum += r->ssim[x];
        t->ssim += sum;
    }
    return PBS_OK;
}

static void divide_rows(rows *r, float *memory) {
    for (int m = 0; m < MOMENTS; m++) r->plane[m] = memory + m * r->padded;
    for (size_t m = 0; m < MOMENTS; m++) r->ring[m] = memory + (MOMENTS + m * TAPS) * r->padded;
    r->ssim = memory + MOMENTS * (1 + TAPS) * r->padded;
}

pbs_code pbs_picture_compare(pbs_run *run, const pbs_image *picture, const pbs_image *truth,
                             pbs_picture_error *out, pbs_err *err) {
    if (picture->width != truth->width || picture->height != truth->height)
        return pbs_fail(err, PBS_DATA, "pictures of %u x %u and %u x %u pixels: sizes differ",
                        picture->width, picture->height, truth->width, truth->height);
    if (truth->width < TAPS || truth->height < TAPS)
        return pbs_fail(err, PBS_DATA, "pictures of %u x %u pixels: at least %d x %d are needed",
                        truth->width, truth->height, TAPS, TAPS);
    rows r = {.width = truth->width};
    r.padded = (r.width + BLOCK - 1) / BLOCK * BLOCK + BLOCK;
    size_t floats = (MOMENTS * (1 + TAPS) + 1) * r.padded;
    float *memory;
    pbs_code code = pbs_alloc(run, &memory, floats, sizeof *memory, "picture rows", err);
    if (code) return code;
    memset(memory, 0, floats * sizeof *memory); /* the padding is read, its results are not */
    divide_rows(&r, memory);
    totals t = {0};
    code = compare_rows(run, &r, picture, truth, &t, err);
    pbs_free(run, memory);
    if (code) return code;
    double pixels = (double)r.width * truth->height;
    double windows = (double)(r.width - TAPS + 1) * (truth->height - TAPS + 1);
    out->ssim = t.ssim / windows;
    out->psnr = 10 * log10(255.0 * 255.0 * 3 * pixels / (double)t.square);
    out->max = t.max;
    out->hole = t.truth ? (double)t.hole / (double)t.truth : 0;
    out->spill = t.picture ? (double)t.spill / (double)t.picture : 0;
    return PBS_OK;
}
