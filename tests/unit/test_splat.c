/* Deferred splatting: what is found visible against a z-buffer of the test's own, colours that do
 * not change by being added up, no holes, and last frame's set that changes nothing. Needs a GL
 * (Mesa's software will do). */
#include "cmd/pbs-view/draw/splat.h"
#include "libcore/surfels/average.h"
#include "libcore/measures/metrics.h"
#include "libcore/data/quant.h"
#include "tests/check.h"
#include "tests/residents.h"

#define PI 3.14159265358979323846
enum { SIDE = 160, MOST = 40000, STRIDE = 16 };

static pbs_run run = {.threads = 1};
static pbs_gl gl;
static pbs_gl_context *context;
static pbs_err err;

static bool no_gl(void) {
    static pbs_code code = -1;
    if ((int)code == -1) code = pbs_gl_context_new("sw", &context, &gl, &err);
    return code != PBS_OK;
}

/* A canvas, records on the device, and splats. */
typedef struct stage {
    pbs_canvas *canvas;
    pbs_residents *pool;
    pbs_splat *splat;
    pbs_frame frame;
} stage;

static stage open_stage(int samples) {
    stage s = {0};
    pbs_canvas_desc d = {SIDE, SIDE, samples};
    if (pbs_canvas_new(&run, &gl, &d, &s.canvas, &err) ||
        pbs_residents_new(&run, &gl, &s.pool, &err) || pbs_splat_new(&run, &gl, &s.splat, &err)) {
        printf("# %s\n", err.text);
        exit(1);
    }
    pbs_camera_parse(&s.frame.camera, "0,0,4,0,0,0,40", NULL);
    return s;
}

static void close_stage(stage *s) {
    pbs_splat_free(s->splat);
    pbs_residents_free(s->pool);
    pbs_canvas_free(s->canvas);
}

/* ---- surfels ---- */

static uint8_t store[4][MOST][STRIDE];

static void put(uint8_t *record, const double p[3], const double n[3], const uint8_t colour[4]) {
    float nf[3] = {(float)n[0], (float)n[1], (float)n[2]};
    uint16_t q[4] = {0};
    int16_t o[2];
    for (int k = 0; k < 3; k++) q[k] = (uint16_t)((p[k] + 1) * 32767.5 + 0.5);
    pbs_oct_encode(o, nf);
    memcpy(record, q, 8);
    memcpy(record + 8, o, 4);
    memcpy(record + 12, colour, 4);
}

static pbs_surfels node_of(int which, uint32_t count, double radius) {
    return (pbs_surfels){.records = store[which],
                         .channels = PBS_NORMAL | PBS_COLOUR,
                         .prefix = count,
                         .whole = count,
                         .radius = radius,
                         .corner = {-1, -1, -1},
                         .step = 1 / 32767.5};
}

static const uint8_t BROWN[4] = {180, 120, 60, 255}, GREEN[4] = {40, 160, 60, 255};

/* A Fibonacci sphere; its covering radius is about 1.1 times the root of the area of a point. */
static pbs_surfels sphere(int which, uint32_t count, const uint8_t colour[4]) {
    for (uint32_t i = 0; i < count; i++) {
        double y = 1 - (2 * i + 1.0) / count, r = sqrt(1 - y * y), a = i * PI * (3 - sqrt(5));
        double n[3] = {r * cos(a), y, r * sin(a)};
        put(store[which][(uint64_t)i * 7919 % count], n, n, colour); /* prefixes are spread */
    }
    return node_of(which, count, 1.1 * sqrt(4 * PI / count));
}

/* A square across z, its points jittered, less than a disc is wide. */
static pbs_surfels square(int which, uint32_t side, double z, double half, const uint8_t c[4]) {
    uint32_t state = 5;
    for (uint32_t i = 0; i < side * side; i++) {
        double u = (state = state * 69069 + 1) / 4294967296.0,
               v = (state = state * 69069 + 1) / 4294967296.0;
        double p[3] = {half * (2 * (i % side + 0.3 + 0.4 * u) / side - 1),
                       half * (2 * (i / side + 0.3 + 0.4 * v) / side - 1), z + 0.003 * (u - v)};
        put(store[which][i], p, (double[3]){0, 0, 1}, c);
    }
    return node_of(which, side * side, 1.1 * 2 * half / side);
}

static pbs_image splat(stage *s, const pbs_surfels *nodes, uint32_t count, pbs_splat_options o) {
    pbs_image image = {0};
    pbs_resident r[4];
    pbs_code rc = pbs_canvas_begin(s->canvas, &s->frame, &err);
    for (uint32_t i = 0; i < count && !rc; i++)
        rc = pbs_residents_add(s->pool, &nodes[i], 100 + i, &r[i], &err);
    if (!rc) rc = pbs_splat_draw(s->splat, s->canvas, r, count, &o, &err);
    if (!rc) rc = pbs_canvas_end(s->canvas, &image, &err);
    if (rc) {
        printf("# %s\n", err.text);
        pbs_bad++;
        image = (pbs_image){SIDE, SIDE, NULL};
        CHECK(pbs_alloc(&run, &image.rgba, SIDE * SIDE, 4, "x", &err) == PBS_OK);
    }
    return image;
}

static pbs_image discs(stage *s, const pbs_surfels *nodes, uint32_t count) {
    pbs_image image = {0};
    CHECK(!pbs_canvas_begin(s->canvas, &s->frame, &err) &&
          !pbs_canvas_surfels(s->canvas, nodes, count, &err) &&
          !pbs_canvas_end(s->canvas, &image, &err));
    return image;
}

static void drop(pbs_image *i) {
    pbs_free(&run, i->rgba);
    i->rgba = NULL;
}

static uint32_t differing(const pbs_image *a, const pbs_image *b, int by) {
    uint32_t n = 0;
    for (size_t p = 0; p < (size_t)SIDE * SIDE; p++) {
        int d = 0;
        for (int k = 0; k < 4; k++) {
            int e = abs(a->rgba[4 * p + k] - b->rgba[4 * p + k]);
            d = e > d ? e : d;
        }
        n += d > by;
    }
    return n;
}

static pbs_splat_counts counts_of(stage *s) {
    pbs_splat_counts c = {0};
    CHECK(pbs_splat_count(s->splat, &c, &err) == PBS_OK);
    return c;
}

/* ---- pass 2 ---- */

static int by_place(const void *a, const void *b) {
    const pbs_splat_surfel *x = a, *y = b;
    if (x->node != y->node) return x->node < y->node ? -1 : 1;
    return x->surfel < y->surfel ? -1 : x->surfel > y->surfel;
}

/* Which pixel a surfel's centre is in, and its distance; false at the edge of a pixel, where
 * rounding decides. */
static bool project(const stage *s, const uint8_t *record, int32_t pixel[2], double *depth) {
    uint16_t q[3];
    double p[3], view[12];
    bool sure = true;
    memcpy(q, record, 6);
    for (int k = 0; k < 3; k++) p[k] = q[k] / 32767.5 - 1;
    pbs_camera_place(view, &s->frame.camera, PBS_IDENTITY);
    pbs_xform_point(p, view, p);
    *depth = -p[2];
    for (int k = 0; k < 2; k++) {
        double at = (1 + (k ? -p[1] : p[0]) / (*depth * s->frame.camera.tan_half)) * SIDE / 2;
        pixel[k] = (int32_t)floor(at);
        sure = sure && fabs(at - floor(at + 0.5)) > 0.01;
    }
    return sure;
}

/* A square in front of half of another one: of every pixel the nearest surfel, and none that the
 * front one hides. */
TEST(visible_as_in_a_z_buffer) {
    if (no_gl()) SKIP(err.text);
    enum { MARGIN = 16, W = SIDE + 2 * MARGIN };
    static struct {
        double depth;
        int node, surfel;
        bool sure;
    } nearest[W * W];
    static bool unsure[2][MOST];
    stage s = open_stage(1);
    pbs_surfels nodes[2] = {square(0, 180, -0.5, 0.99, BROWN), square(1, 90, 0.5, 0.45, GREEN)};
    pbs_image image = splat(&s, nodes, 2, (pbs_splat_options){.afresh = true});
    drop(&image);
    for (int i = 0; i < W * W; i++) nearest[i].depth = INFINITY, nearest[i].sure = true;
    for (int n = 0; n < 2; n++)
        for (uint32_t i = 0; i < nodes[n].prefix; i++) {
            int32_t at[2];
            double depth;
            bool sure = project(&s, store[n][i], at, &depth);
            int p = (at[1] + MARGIN) * W + at[0] + MARGIN;
            /* The front square's discs reach a disc's radius farther than its surfels. */
            double u = (store[n][i][0] | store[n][i][1] << 8) / 32767.5 - 1;
            double v = (store[n][i][2] | store[n][i][3] << 8) / 32767.5 - 1;
            double shadow = 0.45 * (4.5 / 3.5), rim = 0.03;
            double reach = fmax(fabs(u), fabs(v));
            if (n == 0 && reach < shadow - rim) continue; /* hidden */
            if (n == 0 && reach < shadow + rim) sure = false;
            unsure[n][i] = !sure;
            for (int k = 0; k < 9 && !sure; k++)
                nearest[p + (k / 3 - 1) * W + k % 3 - 1].sure = false;
            if (depth < nearest[p].depth - 1e-6) {
                nearest[p].depth = depth;
                nearest[p].node = n;
                nearest[p].surfel = (int)i;
            } else if (depth < nearest[p].depth + 1e-6) {
                nearest[p].sure = false; /* at the same distance any will do */
            }
        }
    pbs_splat_surfel *found;
    size_t count, missing = 0, surplus = 0, expected = 0;
    CHECK(pbs_splat_visible(s.splat, &found, &count, &err) == PBS_OK);
    qsort(found, count, sizeof *found, by_place);
    for (int p = 0; p < W * W; p++) {
        if (!nearest[p].sure || isinf(nearest[p].depth)) continue;
        pbs_splat_surfel key = {(uint32_t)nearest[p].node, (uint32_t)nearest[p].surfel};
        expected++;
        missing += !bsearch(&key, found, count, sizeof key, by_place);
    }
    for (size_t i = 0; i < count; i++) {
        int32_t at[2];
        double depth;
        const uint8_t *record = store[found[i].node][found[i].surfel];
        if (i) CHECK(by_place(&found[i - 1], &found[i]) < 0);
        if (!project(&s, record, at, &depth) || unsure[found[i].node][found[i].surfel]) continue;
        int p = (at[1] + MARGIN) * W + at[0] + MARGIN;
        surplus += nearest[p].sure && depth > nearest[p].depth + 1e-6;
    }
    CHECK_NUM(expected > 2000, expected);
    CHECK_NUM(missing == 0, missing);
    CHECK_NUM(surplus == 0, surplus);
    CHECK(counts_of(&s).visible == count);
    pbs_free(&run, found);
    close_stage(&s);
}

/* ---- passes 4 and 5 ---- */

TEST(a_constant_colour_stays_constant) {
    if (no_gl()) SKIP(err.text);
    for (int samples = 1; samples <= 4; samples += 3) {
        stage s = open_stage(samples);
        pbs_surfels node = square(0, 150, 0, 0.9, BROWN);
        pbs_image a = splat(&s, &node, 1, (pbs_splat_options){0});
        const uint8_t *middle = a.rgba + 4 * (SIDE / 2 * SIDE + SIDE / 2);
        int worst = 0, inside = 0;
        for (int y = 0; y < SIDE; y++)
            for (int x = 0; x < SIDE; x++) {
                const uint8_t *p = a.rgba + 4 * (y * SIDE + x);
                if (x > 40 && x < 120 && y > 40 && y < 120) CHECK(p[3] == 255);
                if (p[3] < 255) continue;
                inside++;
                for (int k = 0; k < 3; k++)
                    worst = abs(p[k] - middle[k]) > worst ? abs(p[k] - middle[k]) : worst;
            }
        /* 0.9 / (4 tan 20) of the half, twice, squared. */
        double side = 0.9 / (4 * tan(PI / 9)) * SIDE;
        CHECK_NUM(worst <= 1, worst);
        CHECK_NUM(fabs(inside / (side * side) - 1) < 0.05, inside / (side * side));
        drop(&a);
        close_stage(&s);
    }
}

/* Pixels that are not covered where the discs cover all around. */
static uint32_t holes(const pbs_image *a, const pbs_image *d) {
    uint32_t n = 0;
    for (int y = 1; y < SIDE - 1; y++)
        for (int x = 1; x < SIDE - 1; x++) {
            bool inside = true;
            for (int k = 0; k < 9; k++)
                inside = inside && d->rgba[4 * ((y + k / 3 - 1) * SIDE + x + k % 3 - 1) + 3] == 255;
            n += inside && a->rgba[4 * (y * SIDE + x) + 3] < 240;
        }
    return n;
}

static void check_like_discs(stage *s, const pbs_surfels *nodes, uint32_t count, double ssim) {
    pbs_image d = discs(s, nodes, count);
    for (int mode = 0; mode < 4; mode++) {
        pbs_splat_options o = {
            .whole = mode == 0, .afresh = mode == 1, .group = mode == 3 ? 64 : 1};
        for (int i = 0; i < 3; i++) {
            pbs_image a = splat(s, nodes, count, o);
            pbs_picture_error e;
            CHECK(pbs_picture_compare(&run, &a, &d, &e, &err) == PBS_OK);
            CHECK_NUM(e.ssim > ssim, e.ssim);
            CHECK_NUM(e.hole < 0.005, e.hole);
            CHECK_NUM(e.spill < 0.03, e.spill);
            /* A pixel's centre may be on no disc though its samples are on two. */
            CHECK_NUM(holes(&a, &d) <= 2, holes(&a, &d));
            drop(&a);
        }
    }
    drop(&d);
}

TEST(like_discs_without_holes) {
    if (no_gl()) SKIP(err.text);
    stage s = open_stage(4);
    pbs_surfels nodes[2] = {sphere(0, 20000, BROWN), square(1, 60, 0.99, 0.4, GREEN)};
    nodes[1].m[0] = nodes[1].m[5] = nodes[1].m[10] = 1;
    nodes[1].m[11] = 0.3;
    check_like_discs(&s, nodes, 2, 0.97);
    /* Few, large ones: more than fit the margin, and so without selection. */
    nodes[0] = sphere(2, 60, BROWN);
    check_like_discs(&s, nodes, 1, 0.75);
    CHECK(counts_of(&s).plain == 60);
    close_stage(&s);
}

/* ---- what is looked at from behind ---- */

/* Opaque pixels that are more green than brown. */
static uint32_t green_ones(const pbs_image *a, uint32_t *opaque) {
    uint32_t n = 0;
    *opaque = 0;
    for (const uint8_t *p = a->rgba; p < a->rgba + 4 * SIDE * SIDE; p += 4) {
        *opaque += p[3] == 255;
        n += p[3] == 255 && p[1] > p[0];
    }
    return n;
}

/* The square of a node, turned around. */
static pbs_surfels turned(int which, uint32_t side, double z, const uint8_t colour[4]) {
    pbs_surfels s = square(which, side, z, 0.9, colour);
    for (uint32_t i = 0; i < s.prefix; i++) {
        int16_t o[2];
        pbs_oct_encode(o, (float[3]){0, 0, -1});
        memcpy(store[which][i] + 8, o, 4);
    }
    return s;
}

/* A plate thinner than a disc, brown on its front and green on its back: from either side, as it is
 * and mirrored, nothing of the other colour. */
TEST(the_back_of_a_plate_does_not_show) {
    if (no_gl()) SKIP(err.text);
    for (int mirrored = 0; mirrored < 2; mirrored++)
        for (int back = 0; back < 2; back++) {
            stage s = open_stage(1);
            pbs_surfels nodes[2] = {square(0, 150, 0.008, 0.9, BROWN), turned(1, 150, 0, GREEN)};
            for (int i = 0; i < 2 && mirrored; i++)
                nodes[i].m[0] = -1, nodes[i].m[5] = nodes[i].m[10] = 1;
            pbs_camera_parse(&s.frame.camera, back ? "2,1,-3,0,0,0,40" : "2,1,3,0,0,0,40", NULL);
            for (int i = 0; i < 3; i++) {
                uint32_t opaque;
                pbs_image a = splat(&s, nodes, 2, (pbs_splat_options){.afresh = i == 0});
                uint32_t green = green_ones(&a, &opaque);
                uint32_t wrong = back ? opaque - green : green;
                CHECK_NUM(opaque > SIDE * SIDE / 8, opaque);
                CHECK_NUM(wrong == 0, wrong);
                drop(&a);
            }
            close_stage(&s);
        }
}

/* The far sides of a box lie behind its outline: not one pixel has their colour. */
TEST(the_far_sides_of_a_box_do_not_show) {
    if (no_gl()) SKIP(err.text);
    stage s = open_stage(1);
    enum { N = 70 };
    uint32_t n = 0, opaque;
    for (int side = 0; side < 6; side++)
        for (uint32_t i = 0; i < N * N; i++, n++) {
            int k = side / 2;
            double normal[3] = {0}, p[3];
            normal[k] = side % 2 ? 1 : -1;
            p[k] = 0.6 * normal[k];
            p[(k + 1) % 3] = 0.6 * (2.0 * (i % N) / (N - 1) - 1);
            p[(k + 2) % 3] = 0.6 * (2.0 * (i / N) / (N - 1) - 1);
            put(store[0][n], p, normal, side % 2 ? BROWN : GREEN);
        }
    pbs_surfels node = node_of(0, n, 1.2 / N);
    pbs_camera_parse(&s.frame.camera, "2.2,1.9,2.6,0,0,0,40", NULL);
    for (int i = 0; i < 3; i++) {
        pbs_image a = splat(&s, &node, 1, (pbs_splat_options){.afresh = i == 0});
        uint32_t green = green_ones(&a, &opaque);
        CHECK_NUM(opaque > SIDE * SIDE / 8, opaque);
        CHECK_NUM(green == 0, green);
        drop(&a);
    }
    close_stage(&s);
}

/* Where there is no front, as inside of a hull or on the wrong side of a sheet, the back stays;
 * also where one looks along it. */
TEST(a_back_without_a_front_stays) {
    if (no_gl()) SKIP(err.text);
    static const char *const views[] = {"0,0,4,0,0,0,40", "3,0,1.2,0,0,0,40",
                                        "0.5,3.4,0.4,0,0,0,40"};
    for (int v = 0; v < 3; v++) {
        stage s = open_stage(4);
        pbs_surfels front = square(0, 150, 0, 0.9, BROWN), back = turned(1, 150, 0, BROWN);
        pbs_camera_parse(&s.frame.camera, views[v], NULL);
        for (int i = 0; i < 3; i++) {
            uint32_t seen, expected;
            pbs_image a = splat(&s, &front, 1, (pbs_splat_options){.afresh = i == 0});
            pbs_image b = splat(&s, &back, 1, (pbs_splat_options){.afresh = i == 0});
            green_ones(&a, &expected);
            green_ones(&b, &seen);
            CHECK_NUM(abs((int)seen - (int)expected) <= (int)expected / 50, seen);
            CHECK_NUM(holes(&b, &a) <= 2, holes(&b, &a));
            drop(&a), drop(&b);
        }
        close_stage(&s);
    }
    stage s = open_stage(4);
    pbs_surfels hull = sphere(2, 30000, BROWN);
    pbs_camera_parse(&s.frame.camera, "0,0,0.9,0.6,0.1,0,60", NULL);
    check_like_discs(&s, &hull, 1, 0.95);
    close_stage(&s);
}

/* ---- temporal coherence ---- */

TEST(a_still_camera_converges) {
    if (no_gl()) SKIP(err.text);
    for (uint32_t group = 1; group <= 64; group *= 8) {
        stage s = open_stage(1);
        pbs_surfels nodes[2] = {sphere(0, 30000, BROWN), square(1, 60, 0.99, 0.4, GREEN)};
        pbs_image off = splat(&s, nodes, 2, (pbs_splat_options){.afresh = true}), last = {0};
        pbs_splat_counts before = counts_of(&s);
        CHECK(before.first == before.all && before.fresh == 0 && before.visible < before.all / 2);
        for (int i = 0; i < 4; i++) {
            drop(&last);
            last = splat(&s, nodes, 2, (pbs_splat_options){.group = group});
        }
        pbs_image on = splat(&s, nodes, 2, (pbs_splat_options){.group = group});
        pbs_splat_counts after = counts_of(&s);
        /* Sums are rounded, and their order is free. */
        CHECK_NUM(differing(&last, &on, 1) == 0, differing(&last, &on, 1));
        CHECK_NUM(differing(&off, &on, 2) < SIDE * SIDE / 200, differing(&off, &on, 2));
        CHECK_NUM(after.fresh == 0, after.fresh);
        CHECK_NUM(group > 1 || after.first == after.visible, after.first);
        /* Neighbours in the order are none on the surface. */
        CHECK_NUM(group > 1 || after.first < after.all / 2, after.first);
        CHECK_NUM(fabs((double)after.visible / (double)before.visible - 1) < 0.02, after.visible);
        drop(&off), drop(&last), drop(&on);
        close_stage(&s);
    }
}

/* Turned by a right angle between two frames most of what is seen is new, and the picture is that
 * of a first frame. */
TEST(a_jump_leaves_no_trace) {
    if (no_gl()) SKIP(err.text);
    stage s = open_stage(1), fresh = open_stage(1);
    pbs_surfels node = sphere(0, 30000, BROWN);
    for (uint32_t i = 0; i < node.prefix; i++)
        memcpy(store[0][i] + 12, (uint8_t[4]){store[0][i][1], store[0][i][3], store[0][i][5], 255},
               4);
    pbs_image a = splat(&s, &node, 1, (pbs_splat_options){0});
    drop(&a);
    pbs_camera_parse(&s.frame.camera, "4,0,1,0,0,0,40", NULL);
    fresh.frame = s.frame;
    a = splat(&s, &node, 1, (pbs_splat_options){0});
    pbs_splat_counts c = counts_of(&s);
    CHECK_NUM(c.fresh > c.visible / 4 && c.fresh < c.visible, c.fresh);
    pbs_image b = splat(&fresh, &node, 1, (pbs_splat_options){.afresh = true});
    pbs_picture_error e;
    CHECK(pbs_picture_compare(&run, &a, &b, &e, &err) == PBS_OK);
    CHECK_NUM(e.ssim > 0.99, e.ssim);
    CHECK_NUM(e.hole < 0.001, e.hole);
    drop(&a), drop(&b);
    close_stage(&fresh);
    close_stage(&s);
}

/* Nodes come, go, change places and prefixes between frames. */
TEST(nodes_come_and_go) {
    if (no_gl()) SKIP(err.text);
    stage s = open_stage(1);
    pbs_surfels nodes[3] = {sphere(0, 20000, BROWN), square(1, 60, 0.99, 0.4, GREEN),
                            square(2, 40, 0.7, 0.9, GREEN)};
    const int order[][3] = {{0, 1, 2},  {2, 0, -1},   {1, -1, -1},
                            {0, 1, -1}, {-1, -1, -1}, {1, 0, 2}};
    for (int i = 0; i < 6; i++) {
        pbs_surfels now[3];
        uint32_t count = 0;
        for (int k = 0; k < 3; k++)
            if (order[i][k] >= 0) {
                now[count] = nodes[order[i][k]];
                now[count].prefix /= 1 + (uint32_t)(i % 2);
                now[count].radius *= i % 2 ? 1.5 : 1;
                count++;
            }
        pbs_image a = splat(&s, now, count, (pbs_splat_options){.group = i % 3 ? 8 : 1});
        pbs_image b = splat(&s, now, count, (pbs_splat_options){.afresh = true});
        uint32_t d = differing(&a, &b, 3);
        CHECK_NUM(d < SIDE * SIDE / 100, d);
        drop(&a), drop(&b);
    }
    close_stage(&s);
}

/* ---- surfel mipmaps ---- */

TEST(small_surfels_show_their_octaves) {
    if (no_gl()) SKIP(err.text);
    static uint8_t entries[MOST][8];
    stage s = open_stage(1);
    pbs_surfels node = sphere(0, 16384, BROWN), plain = node;
    for (size_t i = 0; i < pbs_octave_begin(16384, 0); i++) memcpy(entries[i] + 4, GREEN, 4);
    size_t at = 0;
    for (int k = pbs_octaves(16384); k > 0; k--)
        for (size_t i = 0; i < pbs_octave_length(16384, k); i++, at++)
            memcpy(entries[at], store[0][i] + 8, 4);
    node.octaves = entries;
    /* Near: discs of more than a pixel, nothing is blended. */
    pbs_image a = splat(&s, &plain, 1, (pbs_splat_options){.afresh = true});
    memcpy(store[3], store[0], sizeof store[0]); /* the same records at another place */
    node.records = store[3];
    pbs_image b = splat(&s, &node, 1, (pbs_splat_options){.afresh = true});
    CHECK(differing(&a, &b, 1) == 0);
    drop(&b);
    /* A prefix of a quarter is all green; a tenth of the size, those that have an octave. */
    node.prefix = 4096, node.radius *= 2;
    b = splat(&s, &node, 1, (pbs_splat_options){0});
    const uint8_t *p = b.rgba + 4 * (SIDE / 2 * SIDE + SIDE / 2);
    CHECK(p[1] > p[0] + 60);
    drop(&b);
    node.prefix = 16384, node.radius /= 2;
    pbs_camera_parse(&s.frame.camera, "0,0,16,0,0,0,40", NULL);
    b = splat(&s, &node, 1, (pbs_splat_options){0});
    drop(&a);
    a = splat(&s, &plain, 1, (pbs_splat_options){0});
    CHECK(differing(&a, &b, 20) > 100);
    drop(&a), drop(&b);
    close_stage(&s);
}

/* ---- what does not fit ---- */

/* More records than the buffer has, octaves behind its end, odd offsets. */
TEST(damaged_counts) {
    if (no_gl()) SKIP(err.text);
    stage s = open_stage(1);
    pbs_surfels node = sphere(0, 1000, BROWN);
    pbs_resident r, bad[4];
    pbs_splat_options o = {0};
    CHECK(pbs_residents_add(s.pool, &node, 1, &r, &err) == PBS_OK);
    for (int i = 0; i < 4; i++) bad[i] = r, bad[i].key = (uint64_t)i;
    bad[0].prefix = UINT32_MAX;
    bad[0].offset = (32u << 20) - 1600;
    bad[1].offset = UINT64_MAX - 3;
    bad[2].octaves = (32u << 20) - 16;
    bad[2].whole = UINT32_MAX;
    bad[3].buffer = 0;
    CHECK(pbs_canvas_begin(s.canvas, &s.frame, &err) == PBS_OK);
    for (int i = 0; i < 3; i++)
        CHECK(pbs_splat_draw(s.splat, s.canvas, bad, 4, &o, &err) == PBS_OK);
    CHECK_NUM(counts_of(&s).all == 100 + 1000, counts_of(&s).all);
    r.offset = 2;
    CHECK(pbs_splat_draw(s.splat, s.canvas, &r, 1, &o, &err) == PBS_INTERNAL);
    r.offset = 0, r.stride = 12;
    CHECK(pbs_splat_draw(s.splat, s.canvas, &r, 1, &o, &err) == PBS_INTERNAL);
    close_stage(&s);
}

/* More objects than there are identifiers: the others are splatted without selection. */
TEST(more_nodes_than_identifiers) {
    if (no_gl()) SKIP(err.text);
    enum { NODES = 2048 + 16383 + 7 };
    stage s = open_stage(1);
    pbs_surfels node = sphere(0, 4, BROWN);
    node.radius = 0.001;
    pbs_resident *r = calloc(NODES, sizeof *r);
    pbs_splat_options o = {0};
    for (uint32_t i = 0; r && i < NODES; i++)
        CHECK(pbs_residents_add(s.pool, &node, i, &r[i], &err) == PBS_OK);
    CHECK(pbs_canvas_begin(s.canvas, &s.frame, &err) == PBS_OK);
    CHECK(r && pbs_splat_draw(s.splat, s.canvas, r, NODES, &o, &err) == PBS_OK);
    pbs_splat_counts c = counts_of(&s);
    CHECK_NUM(c.plain == 4 * 7 && c.all == 4 * NODES, c.plain);
    CHECK_NUM(c.visible == 4, c.visible);
    free(r);
    close_stage(&s);
    CHECK(pbs_mem_used(&run) == 0);
    /* The last test: give the context back. */
    pbs_gl_context_free(context);
}

TEST_MAIN
