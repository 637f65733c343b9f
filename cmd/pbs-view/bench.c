#include "cmd/pbs-view/bench.h"
#include "libcore/measures/metrics.h"
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

static pbs_code open_truth(pbs_bench *b, pbs_err *err) {
    b->truth_options = *b->show->options;
    b->truth_options.geometry = true;
    return pbs_show_open(b->run, &b->truth_options, b->play->options->truth, &b->truth, err);
}

pbs_code pbs_bench_open(pbs_show *show, pbs_play *play, const pbs_gl *gl, pbs_bench *b,
                        pbs_err *err) {
    *b = (pbs_bench){
        .run = show->run, .show = show, .play = play, .gl = gl, .count = pbs_play_frames(play)};
    pbs_code rc = pbs_output_open(b->run, play->options->bench, &b->out, err);
    if (rc) return rc;
    rc = pbs_alloc(b->run, &b->rows, b->count, sizeof *b->rows, "the table", err);
    if (!rc && play->options->truth) rc = open_truth(b, err);
    if (!rc) pbs_timer_open(&b->timer, gl);
    return rc;
}

void pbs_bench_close(pbs_bench *b) {
    if (b->out.run) pbs_output_close(&b->out);
    pbs_timer_close(&b->timer);
    pbs_canvas_free(b->truth_canvas);
    if (b->truth.run) pbs_show_close(&b->truth);
    pbs_free(b->run, b->rows);
    *b = (pbs_bench){0};
}

/* ---- one frame ---- */

static pbs_code fit_truth(pbs_bench *b, uint32_t width, uint32_t height, pbs_err *err) {
    if (b->truth_canvas && b->truth_width == width && b->truth_height == height) return PBS_OK;
    pbs_canvas_free(b->truth_canvas);
    b->truth_canvas = NULL;
    b->truth_width = width, b->truth_height = height;
    pbs_canvas_desc d = {width, height, (int)b->show->options->samples};
    return pbs_canvas_new(b->run, b->gl, &d, &b->truth_canvas, err);
}

static pbs_code compare(pbs_bench *b, pbs_canvas *canvas, const pbs_show_view *v,
                        pbs_bench_row *row, pbs_err *err) {
    pbs_image picture = {0}, truth = {0};
    pbs_picture_error e = {0};
    pbs_code rc = fit_truth(b, v->width, v->height, err);
    if (!rc) rc = pbs_canvas_end(canvas, &picture, err);
    if (!rc) rc = pbs_show_draw(&b->truth, b->truth_canvas, v, err);
    if (!rc) rc = pbs_canvas_end(b->truth_canvas, &truth, err);
    if (!rc) rc = pbs_picture_compare(b->run, &picture, &truth, &e, err);
    pbs_free(b->run, picture.rgba);
    pbs_free(b->run, truth.rgba);
    row->ssim = e.ssim, row->psnr = e.psnr, row->hole = e.hole, row->spill = e.spill;
    return rc;
}

pbs_code pbs_bench_frame(pbs_bench *b, pbs_canvas *canvas, uint32_t width, uint32_t height,
                         pbs_err *err) {
    pbs_bench_row row = {0};
    pbs_camera camera = pbs_play_frame(b->play, b->show, b->done, b->count, &row.time);
    pbs_play_move(b->play, b->show, row.time);
    pbs_show_view v = pbs_play_view(b->play, &camera, width, height);
    double gpu;
    for (int i = 0; i < PBS_BENCH_REALS; i++) row.real[i] = NAN;
    row.size = v.surfel_size;
    /* What is measured without a window is drawing, and not how fast the disk is. */
    bool whole = !b->play->options->window;
    pbs_code rc = whole ? pbs_show_settle(b->show, canvas, &v, err) : PBS_OK;
    pbs_count_take();
    double wall = pbs_clock_wall(), cpu = pbs_clock_thread();
    pbs_timer_begin(&b->timer);
    if (!rc) rc = pbs_show_draw(b->show, canvas, &v, err);
    pbs_timer_end(&b->timer);
    b->gl->Finish();
    row.wall = 1e3 * (pbs_clock_wall() - wall);
    row.cpu = 1e3 * (pbs_clock_thread() - cpu);
    if (pbs_timer_take(&b->timer, true, &gpu)) row.gpu = 1e3 * gpu;
    pbs_counts counts = pbs_count_take();
    row.draws = counts.draws, row.bytes = counts.bytes;
    row.nodes = b->show->drawn_nodes, row.surfels = b->show->drawn_surfels;
    row.voxels = b->show->drawn_voxels, row.triangles = b->show->drawn_triangles;
    if (!rc && b->truth.run) rc = compare(b, canvas, &v, &row, err);
    pbs_control_step(&b->play->control, 1e-3 * row.wall);
    if (!rc) rc = pbs_run_check(b->run, err);
    if (!rc) b->rows[b->done++] = row;
    pbs_run_progress(b->run, "frames", b->done, b->count);
    return rc;
}

/* ---- the table ---- */

typedef struct column {
    const char *name;
    size_t offset;
    bool integer, truth; /* a uint64_t, else a double; only with --truth */
    int digits;
} column;

#define REAL(name, field, digits, truth)                                                           \
    { name, offsetof(pbs_bench_row, field), false, truth, digits }
#define COUNT(name, field)                                                                         \
    { name, offsetof(pbs_bench_row, field), true, false, 0 }
static const column columns[] = {
    REAL("gpu_ms", gpu, 4, false),
    REAL("cpu_ms", cpu, 4, false),
    REAL("wall_ms", wall, 4, false),
    COUNT("draws", draws),
    COUNT("nodes", nodes),
    COUNT("surfels", surfels),
    COUNT("voxels", voxels),
    COUNT("triangles", triangles),
    COUNT("bytes_uploaded", bytes),
    REAL("surfel_size_px", size, 4, false),
    REAL("ssim", ssim, 6, true),
    REAL("psnr_db", psnr, 3, true),
    REAL("hole_share", hole, 6, true),
    REAL("spill_share", spill, 6, true),
};
enum { COLUMNS = sizeof columns / sizeof columns[0] };

static double value(const pbs_bench_row *row, const column *c) {
    const char *p = (const char *)row + c->offset;
    uint64_t n;
    double v;
    memcpy(&n, p, sizeof n);
    memcpy(&v, p, sizeof v);
    return c->integer ? (double)n : v;
}

static int rising(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Least, median, mean, 95 % and largest of a column. */
enum { LEAST, MEDIAN, MEAN, MOST_OF_ALL, LARGEST, SUMMARIES };
static const char *const summary_name[SUMMARIES] = {"#min", "#median", "#mean", "#p95", "#max"};

static pbs_code summarise(const pbs_bench *b, const column *c, double out[SUMMARIES],
                          pbs_err *err) {
    double *v, sum = 0;
    size_t n = 0;
    pbs_code rc = pbs_alloc(b->run, &v, b->done, sizeof *v, "the summary", err);
    if (rc) return rc;
    for (uint64_t i = 0; i < b->done; i++) {
        double x = value(&b->rows[i], c);
        if (isnan(x)) continue;
        v[n++] = x;
        sum += x;
    }
    qsort(v, n, sizeof *v, rising);
    for (int k = 0; k < SUMMARIES; k++) out[k] = NAN;
    if (n) {
        out[LEAST] = v[0];
        out[MEDIAN] = n % 2 ? v[n / 2] : v[n / 2 - 1] + (v[n / 2] - v[n / 2 - 1]) / 2;
        out[MEAN] = sum / (double)n;
        out[MOST_OF_ALL] = v[(size_t)ceil(0.95 * (double)n) - 1];
        out[LARGEST] = v[n - 1];
    }
    pbs_free(b->run, v);
    return PBS_OK;
}

double pbs_bench_median(const pbs_bench *b, size_t offset) {
    double s[SUMMARIES];
    column c = {.offset = offset};
    return summarise(b, &c, s, NULL) ? NAN : s[MEDIAN];
}

__attribute__((format(printf, 3, 4))) static pbs_code put(pbs_output *out, pbs_err *err,
                                                          const char *fmt, ...) {
    char text[200];
    va_list args;
    va_start(args, fmt);
    int n = vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    return pbs_output_write(out, text, (size_t)n, err);
}

static bool shown(const pbs_bench *b, const column *c) {
    return !c->truth || b->truth.run;
}

/* NaN as gnuplot and most readers of tables know it, whatever its sign. */
static pbs_code put_real(pbs_output *out, double v, int digits, pbs_err *err) {
    return isnan(v) ? put(out, err, "\tnan") : put(out, err, "\t%.*f", digits, v);
}

static pbs_code write_table(const pbs_bench *b, pbs_output *out, pbs_err *err) {
    double summary[COLUMNS][SUMMARIES];
    pbs_code rc = put(out, err, "frame\ttime_s");
    for (int c = 0; c < COLUMNS && !rc; c++) {
        if (shown(b, &columns[c])) rc = put(out, err, "\t%s", columns[c].name);
        if (!rc) rc = summarise(b, &columns[c], summary[c], err);
    }
    for (uint64_t i = 0; i < b->done && !rc; i++) {
        rc = put(out, err, "\n%" PRIu64 "\t%.6f", i, b->rows[i].time);
        for (int c = 0; c < COLUMNS && !rc; c++)
            if (shown(b, &columns[c]))
                rc = put_real(out, value(&b->rows[i], &columns[c]), columns[c].digits, err);
    }
    for (int k = 0; k < SUMMARIES && !rc; k++) {
        rc = put(out, err, "\n%s\t", summary_name[k]);
        for (int c = 0; c < COLUMNS && !rc; c++)
            if (shown(b, &columns[c])) rc = put_real(out, summary[c][k], columns[c].digits, err);
    }
    return rc ? rc : put(out, err, "\n");
}

pbs_code pbs_bench_write(pbs_bench *b, pbs_err *err) {
    pbs_code rc = write_table(b, &b->out, err);
    return rc ? rc : pbs_output_commit(&b->out, err);
}
