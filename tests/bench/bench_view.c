/* The player's ratios on this machine's device, as one table: what is compared, milliseconds of a
 * frame, of the same without it, and how many times that is; from one glFinish to the next, best of
 * several, a camera on its way around a ball with a smaller one inside, which is never seen.
 *
 *     bench_view [DEVICE [SURFELS [POINTS [TRIANGLES]]]]
 *
 * DEVICE as pbs-view has it. Without numbers they are small enough for a software renderer where
 * there is only that. */
#include "cmd/pbs-view/draw/reduce.h"
#include "cmd/pbs-view/draw/splat.h"
#include "libcore/data/quant.h"
#include "tests/residents.h"
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define PI 3.14159265358979323846
enum { WIDTH = 640, HEIGHT = 480, FRAMES = 12, STRIDE = 16, MOST_NODES = 256 };

static pbs_run run = {.threads = 1};
static pbs_gl gl;
static pbs_err err;

static void need(pbs_code rc) {
    if (!rc) return;
    printf("%s\n", err.text);
    exit(rc == PBS_IO ? 0 : 1);
}

static double now_ms(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e3 * (double)t.tv_sec + 1e-6 * (double)t.tv_nsec;
}

/* A Fibonacci sphere with ripples, its surfels in an order whose prefixes are spread; spacings as
 * of the levels of a cloud: half of the points have the finest. */
static pbs_surfels ball(uint32_t count, double size) {
    uint8_t *records = malloc((size_t)count * STRIDE);
    if (!records) exit(1);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t at = (uint32_t)((uint64_t)i * 1000003 % count);
        uint8_t *r = records + (size_t)at * STRIDE;
        double y = 1 - (2 * i + 1.0) / count, w = sqrt(1 - y * y), a = i * PI * (3 - sqrt(5));
        double n[3] = {w * cos(a), y, w * sin(a)};
        double far = size * (1 + 0.02 * sin(20 * n[0]) * sin(20 * n[1]) * sin(20 * n[2]));
        double apart =
            sqrt(4 * PI / count) * size * exp2(floor(log2((double)count / (at + 1)) / 2));
        float nf[3] = {(float)n[0], (float)n[1], (float)n[2]};
        uint16_t q[4];
        int16_t o[2];
        for (int k = 0; k < 3; k++) q[k] = (uint16_t)((n[k] * far + 1.1) / 2.2 * 65535);
        q[3] = pbs_half_put((float)(apart / 2.2));
        pbs_oct_encode(o, nf);
        memcpy(r, q, 8);
        memcpy(r + 8, o, 4);
        memcpy(r + 12,
               (uint8_t[4]){(uint8_t)(90 + 60 * n[0]), 120, (uint8_t)(120 + 90 * n[1]), 255}, 4);
    }
    return (pbs_surfels){.records = records,
                         .channels = PBS_NORMAL | PBS_COLOUR,
                         .prefix = count,
                         .whole = count,
                         .radius = 1.1 * size * sqrt(4 * PI / count),
                         .corner = {-1.1, -1.1, -1.1},
                         .step = 2.2 / 65535};
}

static pbs_frame frame_at(double turn) {
    pbs_frame f = {0};
    char text[96];
    snprintf(text, sizeof text, "%.9f,0.6,%.9f,0,0,0,40", 3.2 * sin(turn), 3.2 * cos(turn));
    pbs_camera_parse(&f.camera, text, NULL);
    return f;
}

/* A line of the table. */
static void print_row(const char *what, double ms, double against, const char *note) {
    printf("%-44s %9.2f %9.2f %8.2f  %s\n", what, ms, against, against / ms, note);
}

/* ---- prefixes of surfels against all triangles ---- */

enum { GRID = 128, PATCHES = 64 }; /* cells along a patch's side; patches of a buffer */
enum { CORNERS = (GRID + 1) * (GRID + 1), TRIANGLES = 2 * GRID * GRID };
enum { PATCH = CORNERS * 12 + TRIANGLES * 6 };

/* Part of the ball between two meridians, as positions and indices. */
static void fill_patch(uint8_t *to, double from, double wide) {
    float *p = (float *)to;
    uint16_t *index = (uint16_t *)(to + CORNERS * 12);
    for (int y = 0; y <= GRID; y++)
        for (int x = 0; x <= GRID; x++) {
            double t = PI * y / GRID, a = from + wide * x / GRID;
            *p++ = (float)(sin(t) * cos(a)), *p++ = (float)cos(t), *p++ = (float)(sin(t) * sin(a));
        }
    for (int y = 0; y < GRID; y++)
        for (int x = 0; x < GRID; x++) {
            int at = y * (GRID + 1) + x, below = at + GRID + 1;
            const int six[6] = {at, at + 1, below, below, at + 1, below + 1};
            for (int k = 0; k < 6; k++) *index++ = (uint16_t)six[k];
        }
}

static size_t upload_patches(size_t count, pbs_placed_mesh *meshes) {
    uint8_t *bytes = malloc((size_t)PATCHES * PATCH);
    if (!bytes) exit(1);
    for (size_t i = 0; i < count; i += PATCHES) {
        size_t n = count - i < PATCHES ? count - i : PATCHES;
        GLuint buffer;
        gl.CreateBuffers(1, &buffer);
        for (size_t k = 0; k < n; k++) {
            int64_t at = (int64_t)k * PATCH;
            fill_patch(bytes + at, 2 * PI * (double)(i + k) / (double)count,
                       2 * PI / (double)count);
            meshes[i + k] = (pbs_placed_mesh){.buffer = buffer,
                                              .count = TRIANGLES,
                                              .material = PBS_NONE,
                                              .position = at,
                                              .normal = -1,
                                              .uv = -1,
                                              .colour = -1,
                                              .index = at + CORNERS * 12,
                                              .triangle_material = -1};
            memcpy(meshes[i + k].m, PBS_IDENTITY, sizeof meshes[i + k].m);
        }
        gl.NamedBufferData(buffer, (GLsizeiptr)(n * PATCH), bytes, GL_STATIC_DRAW);
    }
    free(bytes);
    return count * TRIANGLES;
}

static double triangle_time(pbs_canvas *canvas, const pbs_placed_mesh *meshes, size_t count) {
    double best = INFINITY;
    for (int i = 0; i < FRAMES; i++) {
        pbs_frame f = frame_at(0.02 * i);
        gl.Finish();
        double t = now_ms();
        need(pbs_canvas_begin(canvas, &f, &err));
        need(pbs_canvas_triangles(canvas, meshes, count, &(pbs_palette){0}, &err));
        gl.Finish();
        if (i > 1) best = fmin(best, now_ms() - t);
    }
    return best;
}

/* As many surfels as discs of so many pixels need at the ball's nearest point. */
static double prefix_time(pbs_canvas *canvas, const pbs_resident *r, double pixels,
                          uint32_t *prefix) {
    double best = INFINITY;
    for (int i = 0; i < FRAMES; i++) {
        pbs_frame f = frame_at(0.02 * i);
        double wanted = pixels / 2 * pbs_camera_pixel(&f.camera, HEIGHT) * (f.camera.unit - 1);
        double n = 4 * PI * 1.21 / (wanted * wanted);
        pbs_surfels node = {.buffer = r->buffer,
                            .at = r->offset,
                            .stride = r->stride,
                            .channels = r->channels,
                            .whole = r->whole,
                            .radius = wanted,
                            .step = r->step};
        memcpy(node.corner, r->corner, sizeof node.corner);
        node.prefix = *prefix = n < r->whole ? (uint32_t)n : r->whole;
        gl.Finish();
        double t = now_ms();
        need(pbs_canvas_begin(canvas, &f, &err));
        need(pbs_canvas_surfels(canvas, &node, 1, &err));
        gl.Finish();
        if (i > 1) best = fmin(best, now_ms() - t);
    }
    return best;
}

static void bench_prefix(pbs_canvas *canvas, uint32_t surfels, uint64_t triangles) {
    size_t count = (size_t)(triangles / TRIANGLES) + 1;
    pbs_placed_mesh *meshes = malloc(count * sizeof *meshes);
    pbs_residents *pool;
    pbs_resident r;
    /* As many as the smallest discs need. */
    const double least = gl.software ? 4 : 2;
    pbs_surfels node = ball(gl.software ? 330000 : surfels, 1);
    if (!meshes) exit(1);
    triangles = upload_patches(count, meshes);
    need(pbs_residents_new(&run, &gl, &pool, &err));
    need(pbs_residents_add(pool, &node, 1, &r, &err));
    double all = triangle_time(canvas, meshes, count);
    for (double pixels = least; pixels <= 4 * least; pixels *= 2) {
        char what[60], note[80];
        uint32_t prefix;
        double ms = prefix_time(canvas, &r, pixels, &prefix);
        snprintf(what, sizeof what, "prefix, %g px, against all triangles", pixels);
        snprintf(note, sizeof note, "%u surfels, %llu triangles", prefix,
                 (unsigned long long)triangles);
        print_row(what, ms, all, note);
    }
    for (size_t i = 0; i < count; i += PATCHES) gl.DeleteBuffers(1, &meshes[i].buffer);
    free(meshes);
    free((void *)node.records);
    pbs_residents_free(pool);
}

/* ---- splats ---- */

typedef struct row {
    const char *name;
    pbs_splat_options options;
    double step; /* between two frames, radians */
} row;

static double splat_row(pbs_canvas *canvas, const pbs_resident *nodes, size_t count, const row *r,
                        double against) {
    pbs_splat *s;
    pbs_splat_counts c;
    double best = INFINITY;
    need(pbs_splat_new(&run, &gl, &s, &err));
    for (int i = 0; i < FRAMES; i++) {
        pbs_frame f = frame_at(i * r->step);
        gl.Finish();
        double t = now_ms();
        need(pbs_canvas_begin(canvas, &f, &err));
        need(pbs_splat_draw(s, canvas, nodes, count, &r->options, &err));
        gl.Finish();
        t = now_ms() - t;
        if (i > 1) best = fmin(best, t);
    }
    need(pbs_splat_count(s, &c, &err));
    char note[100];
    snprintf(note, sizeof note, "first %llu, visible %llu, new %llu of %llu",
             (unsigned long long)c.first, (unsigned long long)c.visible,
             (unsigned long long)c.fresh, (unsigned long long)c.all);
    print_row(r->name, best, against > 0 ? against : best, note);
    pbs_splat_free(s);
    return best;
}

static void bench_splats(pbs_canvas *canvas, uint32_t surfels) {
    const row rows[] = {{"deferred splatting without selection", {.whole = true}, 0.02},
                        {"  with selection, against without", {.afresh = true}, 0.02},
                        {"  and with coherence, against without", {0}, 0.02},
                        {"  the same in groups of 64", {.group = 64}, 0.02},
                        {"  with coherence, camera at rest", {0}, 0}};
    pbs_residents *pool;
    pbs_surfels part[2] = {ball(surfels / 4, 0.6), ball(surfels - surfels / 4, 1)};
    pbs_resident nodes[2];
    double whole = 0;
    need(pbs_residents_new(&run, &gl, &pool, &err));
    for (int i = 0; i < 2; i++)
        need(pbs_residents_add(pool, &part[i], (uint64_t)i, &nodes[i], &err));
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        double ms = splat_row(canvas, nodes, 2, &rows[i], whole);
        if (i == 0) whole = ms;
    }
    for (int i = 0; i < 2; i++) free((void *)part[i].records);
    pbs_residents_free(pool);
}

/* ---- points ---- */

/* GB/s of a copy on the device, read and written, of more than its caches hold. */
static double copy_rate(void) {
    GLsizeiptr bytes = gl.software ? 64 << 20 : 512 << 20;
    GLuint buffer[2];
    double best = INFINITY;
    gl.CreateBuffers(2, buffer);
    for (int i = 0; i < 2; i++) gl.NamedBufferData(buffer[i], bytes, NULL, GL_DYNAMIC_COPY);
    gl.ClearNamedBufferData(buffer[0], GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, NULL);
    for (int i = 0; i < FRAMES; i++) {
        gl.Finish();
        double t = now_ms();
        gl.CopyNamedBufferSubData(buffer[0], buffer[1], 0, 0, bytes);
        gl.Finish();
        best = fmin(best, now_ms() - t);
    }
    gl.DeleteBuffers(2, buffer);
    return 2e-6 * (double)bytes / best;
}

static void reduce_row(pbs_canvas *canvas, const pbs_resident *nodes, size_t count, uint64_t points,
                       double spacing, double copy) {
    pbs_reduce *r;
    pbs_reduce_options o = {.spacing = spacing, .size = 4, .step = UINT32_MAX};
    double best = INFINITY, drawn = INFINITY, cast = INFINITY;
    uint64_t kept, lost;
    need(pbs_reduce_new(&run, &gl, 0, &r, &err));
    for (int i = 0; i < FRAMES; i++) {
        pbs_frame f = frame_at(0.02 * i);
        bool whole;
        gl.Finish();
        double t = now_ms();
        need(pbs_reduce_step(r, &f.camera, (double)WIDTH / HEIGHT, nodes, count, &o, &whole, &err));
        gl.Finish();
        best = fmin(best, now_ms() - t);
        t = now_ms();
        need(pbs_canvas_begin(canvas, &f, &err));
        need(pbs_reduce_draw(r, canvas, &o, &err));
        gl.Finish();
        drawn = fmin(drawn, now_ms() - t);
        t = now_ms();
        need(pbs_canvas_begin(canvas, &f, &err));
        need(pbs_reduce_cast(r, canvas, &o, &err));
        gl.Finish();
        cast = fmin(cast, now_ms() - t);
    }
    need(pbs_reduce_count(r, &kept, &lost, &err));
    double bytes = (double)points * STRIDE + (double)kept * sizeof(pbs_reduced);
    char note[120];
    snprintf(note, sizeof note, "%.2f GB/s, %.0f %% of a copy's %.2f; %llu of %llu points kept%s",
             1e-6 * bytes / best, 1e-4 * bytes / best / copy, copy, (unsigned long long)kept,
             (unsigned long long)points, lost ? ", others lost" : "");
    print_row("reduce pass, against a copy of as many bytes", best, 1e-6 * bytes / copy, note);
    print_row("  points cast, against the rasteriser", cast, drawn, "");
    pbs_reduce_free(r);
}

static void bench_points(pbs_canvas *canvas, uint64_t points) {
    static pbs_resident nodes[MOST_NODES];
    pbs_residents *pool;
    const uint32_t each = 1 << 20;
    size_t count = 0;
    need(pbs_residents_new(&run, &gl, &pool, &err));
    for (uint64_t left = points; left && count < MOST_NODES; count++) {
        pbs_surfels node = ball(left < each ? (uint32_t)left : each, 1 - 0.002 * (double)count);
        need(pbs_residents_add(pool, &node, 1000 + count, &nodes[count], &err));
        left -= node.prefix;
        free((void *)node.records);
    }
    points = 0;
    for (size_t i = 0; i < count; i++) points += nodes[i].prefix;
    double copy = copy_rate();
    for (double spacing = 16; spacing >= 1; spacing /= 4)
        reduce_row(canvas, nodes, count, points, spacing, copy);
    pbs_residents_free(pool);
}

int main(int argc, char **argv) {
    pbs_gl_context *context;
    pbs_canvas *canvas;
    setvbuf(stdout, NULL, _IOLBF, 0); /* a line when it is measured */
    need(pbs_gl_context_new(argc > 1 ? argv[1] : "", &context, &gl, &err));
    uint32_t surfels = argc > 2 ? (uint32_t)atol(argv[2]) : gl.software ? 60000 : 4000000;
    uint64_t points = argc > 3 ? (uint64_t)atoll(argv[3]) : gl.software ? 400000 : 100000000;
    uint64_t triangles = argc > 4 ? (uint64_t)atoll(argv[4]) : gl.software ? 1000000 : 50000000;
    printf("%s; %d x %d pixels\n", gl.device, WIDTH, HEIGHT);
    printf("%-44s %9s %9s %8s\n", "", "ms", "against", "times");
    need(pbs_canvas_new(&run, &gl, &(pbs_canvas_desc){WIDTH, HEIGHT, 1}, &canvas, &err));
    bench_prefix(canvas, surfels, triangles);
    bench_splats(canvas, surfels);
    bench_points(canvas, points);
    pbs_canvas_free(canvas);
    pbs_gl_context_free(context);
    return 0;
}
