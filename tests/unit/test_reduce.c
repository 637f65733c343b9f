/* Points by a pass over all records: the same that a plain loop keeps, in steps of any size, and
 * drawn without holes. Needs a GL (Mesa's software will do). */
#include "cmd/pbs-view/draw/reduce.h"
#include "libcore/gbuffer/lod.h"
#include "libcore/measures/metrics.h"
#include "libcore/data/quant.h"
#include "tests/check.h"
#include "tests/residents.h"

#define PI 3.14159265358979323846
enum { SIDE = 160, NODES = 3, POINTS = 9000, STRIDE = 12 };

static pbs_run run = {.threads = 1};
static pbs_gl gl;
static pbs_gl_context *context;
static pbs_err err;
static uint8_t store[NODES][POINTS][STRIDE];

static bool no_gl(void) {
    static pbs_code code = -1;
    if ((int)code == -1) code = pbs_gl_context_new("sw", &context, &gl, &err);
    return code != PBS_OK;
}

static void expect(pbs_code rc) {
    if (rc) printf("# %s\n", err.text);
    CHECK(rc == PBS_OK);
}

typedef struct stage {
    pbs_canvas *canvas;
    pbs_residents *pool;
    pbs_reduce *reduce;
    pbs_camera camera;
    pbs_surfels nodes[NODES];
    pbs_resident resident[NODES];
} stage;

static uint32_t state = 1;
static uint32_t random_bits(void) {
    return (state = state * 69069 + 1) >> 8;
}

/* Points anywhere in a cube, spacings of levels, a few damaged ones. */
static void fill_cube(pbs_surfels *node, int which) {
    for (int i = 0; i < POINTS; i++) {
        uint16_t q[4];
        for (int k = 0; k < 3; k++) q[k] = (uint16_t)random_bits();
        q[3] = pbs_half_put((float)ldexp(1, (int)(random_bits() % 12) - 16));
        if (i % 97 == 0) q[3] = (uint16_t)random_bits();
        if (i % 101 == 0) q[3] = 0;
        memcpy(store[which][i], q, 8);
        memcpy(store[which][i] + 8, &i, 4);
    }
    *node = (pbs_surfels){.records = store[which],
                          .channels = PBS_COLOUR,
                          .prefix = POINTS - (uint32_t)which,
                          .whole = POINTS,
                          .corner = {-1, -1, -1},
                          .step = 1 / 32767.5,
                          .m = {1, 0, 0, which * 2.0 - 2, 0, 1, 0, 0, 0, 0, 1 + which * 0.5, 0}};
}

static uint64_t key_of(int node) {
    return 77 + (uint64_t)node * 0x100000001u;
}

static stage open_stage(uint32_t most) {
    stage s = {0};
    pbs_canvas_desc d = {SIDE, SIDE, 4};
    if (pbs_canvas_new(&run, &gl, &d, &s.canvas, &err) ||
        pbs_residents_new(&run, &gl, &s.pool, &err) ||
        pbs_reduce_new(&run, &gl, most, &s.reduce, &err)) {
        printf("# %s\n", err.text);
        exit(1);
    }
    pbs_camera_parse(&s.camera, "0.5,0.3,2,0.1,0,0,50", NULL);
    for (int i = 0; i < NODES; i++) {
        fill_cube(&s.nodes[i], i);
        expect(pbs_residents_add(s.pool, &s.nodes[i], key_of(i), &s.resident[i], &err));
    }
    return s;
}

static void close_stage(stage *s) {
    pbs_reduce_free(s->reduce);
    pbs_residents_free(s->pool);
    pbs_canvas_free(s->canvas);
    CHECK(pbs_mem_used(&run) == 0);
}

/* ---- the same by a loop ---- */

static bool wanted(const stage *s, int node, uint32_t i, const pbs_reduce_options *o) {
    float m[3][4], disc[3][4], normal[3][4], c[3];
    const pbs_camera *v = &s->camera;
    const pbs_resident *r = &s->resident[node];
    uint16_t q[4];
    memcpy(q, store[node][i], 8);
    pbs_resident_place(r, v, m, disc, normal);
    for (int k = 0; k < 3; k++)
        c[k] = ((m[k][0] * q[0] + m[k][1] * q[1]) + m[k][2] * q[2]) + m[k][3];
    float px = (float)(1 / v->tan_half), wide = (float)(o->wide > 0 ? o->wide : 2);
    float own = pbs_half_get(q[3]) * (float)(65535 * r->step * pbs_lod_stretch(r->m) / v->unit);
    if (!o->steps) own *= pbs_reduce_share(key_of(node), i);
    float d = -c[2], x = c[0] * px, y = c[1] * px, density = 1;
    if (!(d >= (float)PBS_CAMERA_NEAR && fabsf(x) <= wide * d && fabsf(y) <= wide * d))
        return false;
    if (o->periphery) {
        float u = x / d, w = y / d;
        float away = (float)(o->fall > 0 ? o->fall : 0.5) * sqrtf(u * u + w * w);
        density = fmaxf(1 - away, (float)(o->least > 0 ? o->least : 0.3));
    }
    float spacing = (float)((o->spacing > 0 ? o->spacing : 1) / 1000), reach = own * density;
    return own > 0 &&
           reach * reach >= spacing * spacing * ((c[0] * c[0] + c[1] * c[1]) + c[2] * c[2]);
}

/* Points know their node's place: the colour is the number, the node is asked for by position. */
static void check_same(stage *s, const pbs_reduce_options *o, uint64_t least) {
    static uint8_t found[NODES][POINTS];
    pbs_reduced *points;
    size_t count, wrong = 0, expected = 0;
    memset(found, 0, sizeof found);
    expect(pbs_reduce_read(s->reduce, &points, &count, &err));
    for (size_t i = 0; i < count; i++) {
        uint32_t number;
        memcpy(&number, points[i].colour, 4);
        int which = -1;
        for (int n = 0; n < NODES && number < POINTS; n++) {
            float m[3][4], disc[3][4], normal[3][4], away = 0;
            uint16_t q[4];
            memcpy(q, store[n][number], 8);
            pbs_resident_place(&s->resident[n], &s->camera, m, disc, normal);
            for (int k = 0; k < 3; k++)
                away += fabsf(m[k][0] * q[0] + m[k][1] * q[1] + m[k][2] * q[2] + m[k][3] -
                              points[i].position[k]);
            if (away < 1e-5f) which = n;
        }
        CHECK(which >= 0);
        if (which >= 0) found[which][number]++;
        CHECK(points[i].normal[0] == -32768 && points[i].normal[1] == -32768);
    }
    for (int n = 0; n < NODES; n++)
        for (uint32_t i = 0; i < POINTS; i++) {
            bool w = i < s->nodes[n].prefix && wanted(s, n, i, o);
            expected += w;
            wrong += found[n][i] != w;
        }
    CHECK_NUM(wrong == 0, wrong);
    CHECK_NUM(expected >= least && expected < NODES * POINTS / 2, expected);
    pbs_free(&run, points);
}

static int pass(stage *s, const pbs_reduce_options *o) {
    bool whole = false;
    int steps = 0;
    while (!whole && steps < 10000) {
        expect(pbs_reduce_step(s->reduce, &s->camera, 1, s->resident, NODES, o, &whole, &err));
        steps++;
    }
    return steps;
}

TEST(the_same_set_as_a_loop) {
    if (no_gl()) SKIP(err.text);
    stage s = open_stage(NODES * POINTS);
    const pbs_reduce_options options[] = {
        {0},
        {.steps = true, .spacing = 3},
        {.spacing = 20, .wide = 1},
        {.periphery = true, .spacing = 10},
        {.periphery = true, .spacing = 10, .fall = 0.9, .least = 0.05, .steps = true},
        {.spacing = 0.001, .wide = 0.5},
    };
    for (size_t i = 0; i < sizeof options / sizeof options[0]; i++) {
        CHECK(pass(&s, &options[i]) == 1);
        check_same(&s, &options[i], 500);
    }
    pbs_camera_parse(&s.camera, "0.1,0.05,0.1,5,1,2,90", NULL); /* inside */
    CHECK(pass(&s, &options[0]) == 1);
    check_same(&s, &options[0], 500);
    close_stage(&s);
}

/* In steps of any size, whatever their borders; what is drawn is the last whole pass. */
TEST(spread_over_frames) {
    if (no_gl()) SKIP(err.text);
    stage s = open_stage(NODES * POINTS);
    pbs_reduce_options o = {.spacing = 5, .step = 1000};
    uint64_t kept, before, lost;
    CHECK(pass(&s, &o) == 27);
    check_same(&s, &o, 1000);
    o.step = 1;
    bool whole;
    expect(pbs_reduce_count(s.reduce, &before, &lost, &err));
    CHECK(lost == 0);
    pbs_camera other = s.camera;
    pbs_camera_parse(&other, "9,9,9,0,0,0,20", NULL);
    expect(pbs_reduce_step(s.reduce, &other, 1, s.resident, NODES, &o, &whole, &err));
    expect(pbs_reduce_count(s.reduce, &kept, &lost, &err));
    CHECK(!whole && kept == before);
    /* A node that has gone is no part of the rest; one that comes is. */
    o.step = 0;
    expect(pbs_reduce_step(s.reduce, &other, 1, s.resident, 1, &o, &whole, &err));
    CHECK(whole);
    pbs_reduced *points;
    size_t count;
    expect(pbs_reduce_read(s.reduce, &points, &count, &err));
    CHECK_NUM(count > 10 && count < POINTS, count);
    pbs_free(&run, points);
    expect(pbs_reduce_step(s.reduce, &s.camera, 1, NULL, 0, &o, &whole, &err));
    expect(pbs_reduce_count(s.reduce, &kept, &lost, &err));
    CHECK(whole && kept == 0 && lost == 0);
    close_stage(&s);
}

TEST(more_than_there_is_room_for) {
    if (no_gl()) SKIP(err.text);
    stage s = open_stage(700);
    pbs_reduce_options o = {.spacing = 5};
    uint64_t kept, lost;
    pass(&s, &o);
    expect(pbs_reduce_count(s.reduce, &kept, &lost, &err));
    CHECK_NUM(kept == 700 && lost > 1000, lost);
    /* Counts that the buffer has no room for, and no buffer. */
    s.resident[0].prefix = UINT32_MAX;
    s.resident[0].offset = (32u << 20) - 1200;
    s.resident[1].offset = UINT64_MAX - 3;
    s.resident[2].buffer = 0;
    CHECK(pass(&s, &o) == 1);
    expect(pbs_reduce_count(s.reduce, &kept, &lost, &err));
    CHECK(kept + lost <= 100);
    s.resident[0].offset = 2;
    bool whole;
    CHECK(pbs_reduce_step(s.reduce, &s.camera, 1, s.resident, 1, &o, &whole, &err) == PBS_INTERNAL);
    close_stage(&s);
}

/* ---- the picture ---- */

/* A sphere of points whose spacings are those of levels: every fourth as far again. */
static pbs_surfels sphere(int which) {
    for (int i = 0; i < POINTS; i++) {
        double y = 1 - (2 * i + 1.0) / POINTS, r = sqrt(1 - y * y), a = i * PI * (3 - sqrt(5));
        double n[3] = {r * cos(a), y, r * sin(a)};
        uint16_t q[4];
        for (int k = 0; k < 3; k++) q[k] = (uint16_t)((n[k] + 1) * 32767.5 + 0.5);
        q[3] = pbs_half_put((float)(0.5 * sqrt(4 * PI / POINTS)));
        memcpy(store[which][i], q, 8);
        memcpy(store[which][i] + 8, (uint8_t[4]){180, 120, 60, 255}, 4);
    }
    return (pbs_surfels){.records = store[which],
                         .channels = PBS_COLOUR,
                         .prefix = POINTS,
                         .whole = POINTS,
                         .radius = 1.1 * sqrt(4 * PI / POINTS),
                         .corner = {-1, -1, -1},
                         .step = 1 / 32767.5};
}

TEST(like_discs_without_holes) {
    if (no_gl()) SKIP(err.text);
    stage s = open_stage(POINTS);
    pbs_residents *pool;
    pbs_frame f = {0};
    pbs_camera_parse(&f.camera, "0,0,4,0,0,0,40", NULL);
    expect(pbs_residents_new(&run, &gl, &pool, &err));
    pbs_surfels node = sphere(0);
    pbs_resident r;
    expect(pbs_residents_add(pool, &node, 5, &r, &err));
    /* At this distance the wanted spacing is a little less than half of theirs. */
    pbs_reduce_options o = {.spacing = 8, .steps = true, .size = 3.2};
    pbs_image a, b;
    bool whole;
    expect(pbs_reduce_step(s.reduce, &f.camera, 1, &r, 1, &o, &whole, &err));
    expect(pbs_canvas_begin(s.canvas, &f, &err));
    expect(pbs_canvas_surfels(s.canvas, &node, 1, &err));
    expect(pbs_canvas_end(s.canvas, &a, &err));
    expect(pbs_canvas_begin(s.canvas, &f, &err));
    expect(pbs_reduce_draw(s.reduce, s.canvas, &o, &err));
    expect(pbs_canvas_end(s.canvas, &b, &err));
    pbs_picture_error e;
    expect(pbs_picture_compare(&run, &b, &a, &e, &err));
    CHECK_NUM(e.ssim > 0.9, e.ssim);
    CHECK_NUM(e.hole < 0.001, e.hole);
    pbs_free(&run, b.rgba);
    /* Without the rasteriser: an edge goes through the pixel, and all else is the same. */
    pbs_canvas *plain;
    expect(pbs_canvas_new(&run, &gl, &(pbs_canvas_desc){SIDE, SIDE, 1}, &plain, &err));
    expect(pbs_canvas_begin(plain, &f, &err));
    expect(pbs_reduce_draw(s.reduce, plain, &o, &err));
    expect(pbs_canvas_end(plain, &b, &err));
    pbs_image d;
    for (int i = 0; i < 2; i++) {
        expect(pbs_canvas_begin(plain, &f, &err));
        expect(pbs_reduce_cast(s.reduce, plain, &o, &err));
        expect(pbs_canvas_end(plain, &d, &err));
        size_t differ = 0;
        for (size_t p = 0; p < (size_t)4 * SIDE * SIDE; p++)
            differ += abs(d.rgba[p] - b.rgba[p]) > 12;
        CHECK_NUM(differ < SIDE * SIDE / 50, differ);
        pbs_free(&run, d.rgba);
    }
    pbs_free(&run, b.rgba);
    pbs_canvas_free(plain);
    /* Farther away, before the next pass, points shrink, and then there are none. */
    double last = 2;
    for (double away = 1; away < 2.4; away += 0.2) {
        char text[64];
        snprintf(text, sizeof text, "0,0,%g,0,0,0,40", 4 * away);
        pbs_camera_parse(&f.camera, text, NULL);
        expect(pbs_canvas_begin(s.canvas, &f, &err));
        expect(pbs_reduce_draw(s.reduce, s.canvas, &o, &err));
        expect(pbs_canvas_end(s.canvas, &b, &err));
        double sum = 0, share;
        for (size_t p = 0; p < (size_t)SIDE * SIDE; p++) sum += b.rgba[4 * p + 3] / 255.0;
        share = sum * away * away / (SIDE * SIDE);
        CHECK_NUM(share <= last + 0.05, share);
        last = share;
        pbs_free(&run, b.rgba);
    }
    CHECK_NUM(last == 0, last);
    pbs_free(&run, a.rgba);
    pbs_residents_free(pool);
    close_stage(&s);
    pbs_gl_context_free(context);
}

TEST_MAIN
