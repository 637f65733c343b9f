/* What stands beside the painters: depth under a pixel, text, times, counts, a device that is lost.
 * Needs a GL (Mesa's software will do). */
#include "cmd/pbs-view/draw/count.h"
#include "cmd/pbs-view/draw/draw_probe.h"
#include "cmd/pbs-view/draw/draw_text.h"
#include "cmd/pbs-view/draw/timer.h"
#include "tests/check.h"
#include <stdio.h>

enum { WIDTH = 200, HEIGHT = 120 };

static pbs_run run = {.threads = 1};
static pbs_gl gl;
static pbs_gl_context *context;
static pbs_err err;

static bool no_gl(void) {
    static pbs_code code = -1;
    if ((int)code == -1) {
        code = pbs_gl_context_new("sw", &context, &gl, &err);
        if (!code) pbs_count_open(&gl);
    }
    return code != PBS_OK;
}

static bool ok(pbs_code code) {
    if (code) printf("# %s\n", err.text);
    return code == PBS_OK;
}

static pbs_canvas *new_canvas(int samples) {
    pbs_canvas *c = NULL;
    pbs_canvas_desc d = {WIDTH, HEIGHT, samples};
    CHECK(ok(pbs_canvas_new(&run, &gl, &d, &c, &err)));
    return c;
}

/* A square across the line of sight, from 0,0 to 3,2 at z = 0. */
static float position[4][3] = {{0, 0, 0}, {3, 0, 0}, {0, 2, 0}, {3, 2, 0}};
static uint16_t corners[6] = {0, 1, 2, 2, 1, 3};
static const pbs_mesh square = {
    .vertices = 4, .triangles = 2, .position = position[0], .index = corners, .material = PBS_NONE};

static pbs_camera begin(pbs_canvas *c) {
    pbs_frame f = {0};
    CHECK(pbs_camera_parse(&f.camera, "0,0,10,0,0,2,40", &err) == PBS_OK);
    CHECK(ok(pbs_canvas_begin(c, &f, &err)));
    return f.camera;
}

static void draw_square(pbs_canvas *c) {
    pbs_draw draw = {.mesh = &square};
    pbs_meshes m = {.draws = &draw, .draw_count = 1};
    memcpy(draw.m, PBS_IDENTITY, sizeof draw.m);
    CHECK(ok(pbs_canvas_meshes(c, &m, &err)));
}

/* Column and row of a point of the plane z = 0. */
static void pixel_of(double x, double y, uint32_t out[2]) {
    double half = 10 * tan(20 * 3.14159265358979323846 / 180);
    out[0] = (uint32_t)((x / (half * WIDTH / HEIGHT) + 1) / 2 * WIDTH);
    out[1] = (uint32_t)((1 - y / half) / 2 * HEIGHT);
}

TEST(depth_under_a_pixel) {
    if (no_gl()) SKIP(err.text);
    const double inside[4][2] = {{0.3, 0.3}, {2.7, 0.3}, {0.3, 1.7}, {2.7, 1.7}};
    const double outside[4][2] = {{-0.3, 0.3}, {0.3, -0.3}, {3.3, 1}, {1, 2.3}};
    for (int samples = 1; samples <= 4; samples += 3) {
        pbs_canvas *c = new_canvas(samples);
        double depth;
        uint32_t at[2];
        begin(c);
        draw_square(c);
        for (int i = 0; i < 4; i++) {
            pixel_of(inside[i][0], inside[i][1], at);
            CHECK(ok(pbs_canvas_depth(c, at[0], at[1], &depth, &err)));
            CHECK_NUM(fabs(depth * 8 - 10) < 1e-4, depth); /* the target is 8 away */
            pixel_of(outside[i][0], outside[i][1], at);
            CHECK(ok(pbs_canvas_depth(c, at[0], at[1], &depth, &err)) && depth == 0);
        }
        CHECK(ok(pbs_canvas_depth(c, WIDTH, 0, &depth, &err)) && depth == 0);
        CHECK(ok(pbs_canvas_depth(c, 0, UINT32_MAX, &depth, &err)) && depth == 0);
        pbs_canvas_free(c);
    }
    CHECK(pbs_mem_used(&run) == 0);
}

static uint64_t covered(const pbs_image *i, uint32_t from, uint32_t to) {
    uint64_t n = 0;
    for (uint32_t y = 0; y < i->height; y++)
        for (uint32_t x = from; x < to; x++) n += i->rgba[4 * ((size_t)y * i->width + x) + 3] > 127;
    return n;
}

/* Each eye draws into its own columns only, and the other one's stay. */
TEST(two_eyes_on_one_canvas) {
    if (no_gl()) SKIP(err.text);
    pbs_canvas *c = new_canvas(1);
    pbs_image image = {0};
    pbs_camera camera = begin(c);
    pbs_camera_shift(&camera, 1.5);
    pbs_camera_move(&camera, 0, 0.125, 0.9); /* so near that the square is larger than the part */
    pbs_canvas_look(c, &camera, (pbs_columns){WIDTH / 2, WIDTH / 2, WIDTH / 2, WIDTH / 2});
    draw_square(c);
    CHECK(ok(pbs_canvas_end(c, &image, &err)));
    CHECK(covered(&image, 0, WIDTH / 2) == 0);
    CHECK_NUM(covered(&image, WIDTH / 2, WIDTH) > WIDTH / 2 * HEIGHT / 4,
              covered(&image, WIDTH / 2, WIDTH));
    uint64_t right = covered(&image, WIDTH / 2, WIDTH);
    pbs_free(&run, image.rgba);
    pbs_canvas_look(c, &camera, (pbs_columns){0, WIDTH / 2, 0, WIDTH / 2});
    draw_square(c);
    CHECK(ok(pbs_canvas_end(c, &image, &err)));
    CHECK(covered(&image, 0, WIDTH / 2) == right && covered(&image, WIDTH / 2, WIDTH) == right);
    pbs_free(&run, image.rgba);
    pbs_canvas_free(c);
}

static unsigned programs;
static PFNGLCREATEPROGRAMPROC create_program;
static GLuint APIENTRY counted_program(void) {
    programs++;
    return create_program();
}

/* Another size is another picture, as a new canvas would have it, and no program is made for it. */
TEST(a_canvas_takes_another_size) {
    if (no_gl()) SKIP(err.text);
    for (int samples = 1; samples <= 4; samples += 3) {
        pbs_canvas *fresh = new_canvas(samples), *c = NULL;
        pbs_canvas_desc d = {WIDTH / 3, 3 * HEIGHT, samples};
        pbs_image a = {0}, b = {0};
        begin(fresh);
        draw_square(fresh);
        CHECK(ok(pbs_canvas_end(fresh, &a, &err)));
        CHECK(ok(pbs_canvas_new(&run, &gl, &d, &c, &err)));
        begin(c);
        draw_square(c);
        create_program = gl.CreateProgram;
        gl.CreateProgram = counted_program;
        programs = 0;
        CHECK(pbs_canvas_resize(c, UINT32_MAX, 2, &err) == PBS_LIMIT);
        CHECK(ok(pbs_canvas_resize(c, 1, 1, &err)));
        begin(c);
        draw_square(c);
        CHECK(ok(pbs_canvas_resize(c, WIDTH, HEIGHT, &err)));
        CHECK(ok(pbs_canvas_resize(c, WIDTH, HEIGHT, &err)));
        begin(c);
        draw_square(c);
        CHECK(ok(pbs_canvas_end(c, &b, &err)));
        CHECK(programs == 0 && memcmp(a.rgba, b.rgba, (size_t)4 * WIDTH * HEIGHT) == 0);
        gl.CreateProgram = create_program;
        pbs_free(&run, a.rgba);
        pbs_free(&run, b.rgba);
        pbs_canvas_free(fresh);
        pbs_canvas_free(c);
        CHECK(pbs_mem_used(&run) == 0);
    }
}

static pbs_image written(pbs_text *t, pbs_canvas *c, const char *text, int x, int y, int scale) {
    pbs_image image = {0};
    begin(c);
    CHECK(ok(pbs_text_draw(t, c, text, x, y, scale, &err)));
    CHECK(ok(pbs_canvas_end(c, &image, &err)));
    return image;
}

static uint64_t light_pixels(const pbs_image *i) {
    uint64_t n = 0;
    for (size_t p = 0; p < (size_t)i->width * i->height; p++)
        n += i->rgba[4 * p + 3] > 127 && i->rgba[4 * p] > 200;
    return n;
}

TEST(text_is_drawn) {
    if (no_gl()) SKIP(err.text);
    static char long_line[100001];
    memset(long_line, 'W', sizeof long_line - 1);
    pbs_canvas *c = new_canvas(1);
    pbs_text *t;
    CHECK(ok(pbs_text_new(&run, &gl, &t, &err)));
    pbs_image one = written(t, c, "pbs\n", 10, 20, 1), two = written(t, c, "pbs\n", 10, 20, 2);
    CHECK(light_pixels(&one) > 20);
    CHECK_NUM(light_pixels(&two) == 4 * light_pixels(&one), light_pixels(&two));
    CHECK(covered(&one, 0, 10) == 0); /* nothing left of where it begins */
    pbs_free(&run, two.rgba);
    /* A character of UTF-8 is one letter, and bytes that are none are letters, too. */
    int width, height, other;
    pbs_text_size("a?b\n", &width, &height);
    pbs_text_size("a\xc3\xa9"
                  "b\n",
                  &other, &height);
    CHECK(width == other && height == 12);
    const char *strange[] = {"", "\n\n\n", "\xff\xfe\x80\x01\x7f\n", "a\tb\tc\nd\n", long_line};
    for (size_t i = 0; i < sizeof strange / sizeof *strange; i++) {
        two = written(t, c, strange[i], -5, i == 4 ? 100000 : 0, 3);
        pbs_free(&run, two.rgba);
    }
    /* Tabs: second cells begin at one column. */
    pbs_text_size("a\tx\n", &width, &height);
    pbs_text_size("a\tx\nlonger\tx\n", &other, &height);
    CHECK(other > width && height == 24);
    pbs_free(&run, one.rgba);
    pbs_text_free(t);
    pbs_text_free(NULL);
    pbs_canvas_free(c);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(calls_and_bytes_are_counted) {
    if (no_gl()) SKIP(err.text);
    static const uint8_t bytes[300];
    GLuint buffer;
    gl.CreateBuffers(1, &buffer);
    pbs_count_take();
    gl.NamedBufferData(buffer, 1000, NULL, GL_STREAM_DRAW); /* room only */
    gl.NamedBufferSubData(buffer, 10, 300, bytes);
    pbs_counts n = pbs_count_take();
    CHECK_NUM(n.bytes == 300 && n.draws == 0, n.bytes);
    pbs_canvas *c = new_canvas(1);
    begin(c);
    draw_square(c);
    n = pbs_count_take();
    CHECK_NUM(n.draws == 1, n.draws);
    CHECK_NUM(n.bytes >= 4 * 12 + 6 * 2, n.bytes);
    CHECK(pbs_count_take().draws == 0);
    gl.DeleteBuffers(1, &buffer);
    pbs_canvas_free(c);
}

TEST(device_time) {
    if (no_gl()) SKIP(err.text);
    pbs_canvas *c = new_canvas(4);
    pbs_timer t;
    double seconds = -1;
    pbs_timer_open(&t, &gl);
    CHECK(!pbs_timer_take(&t, true, &seconds));      /* nothing to wait for */
    for (int i = 0; i < 3 * PBS_TIMER_FRAMES; i++) { /* more than it holds: not measured */
        pbs_timer_begin(&t);
        begin(c);
        draw_square(c);
        pbs_timer_end(&t);
    }
    int taken = 0;
    for (; pbs_timer_take(&t, true, &seconds); taken++) CHECK_NUM(seconds > 0, seconds);
    CHECK_NUM(taken == PBS_TIMER_FRAMES, taken);
    pbs_timer_begin(&t);
    pbs_timer_end(&t);
    CHECK(pbs_timer_take(&t, true, &seconds));
    pbs_timer_close(&t);
    pbs_canvas_free(c);
}

/* ---- a device that is lost, as a driver would tell it ---- */

static GLenum status, error;
static GLenum APIENTRY get_status(void) {
    return status;
}
static GLenum APIENTRY get_error(void) {
    return error;
}

TEST(a_lost_device_is_said) {
    pbs_gl lost = {.GetGraphicsResetStatus = get_status, .GetError = get_error, .device = "GPU 7"};
    status = GL_NO_ERROR, error = GL_NO_ERROR;
    CHECK(pbs_gl_lost(&lost, &err) == PBS_OK && pbs_gl_check(&lost, "x", &err) == PBS_OK);
    status = GL_INNOCENT_CONTEXT_RESET;
    CHECK(pbs_gl_lost(&lost, &err) == PBS_IO && strstr(err.text, "another program"));
    CHECK(strstr(err.text, "GPU 7"));
    error = GL_CONTEXT_LOST;
    CHECK(pbs_gl_check(&lost, "x", &err) == PBS_IO && strstr(err.text, "the device was lost"));
    status = GL_NO_ERROR; /* the reset is over; the context is lost all the same */
    CHECK(pbs_gl_check(&lost, "x", &err) == PBS_IO);
    error = GL_OUT_OF_MEMORY;
    CHECK(pbs_gl_check(&lost, "x", &err) == PBS_LIMIT);
    error = GL_INVALID_OPERATION;
    CHECK(pbs_gl_check(&lost, "x", &err) == PBS_INTERNAL);
}

/* Drivers that lack things: no GL at all, an older one, one without a function. */
static GLint major;
static void APIENTRY get_integer(GLenum name, GLint *v) {
    *v = name == GL_MAJOR_VERSION ? major : 5;
}
static pbs_gl_proc nothing(const char *name) {
    (void)name;
    return NULL;
}
static pbs_gl_proc only_versions(const char *name) {
    return strcmp(name, "glGetIntegerv") ? NULL : (pbs_gl_proc)get_integer;
}

TEST(drivers_that_lack_things) {
    pbs_gl none;
    CHECK(pbs_gl_load(&none, nothing, &err) == PBS_IO && strstr(err.text, "this is 0.0"));
    major = 3;
    CHECK(pbs_gl_load(&none, only_versions, &err) == PBS_IO && strstr(err.text, "this is 3.5"));
    major = 4;
    CHECK(pbs_gl_load(&none, only_versions, &err) == PBS_IO && strstr(err.text, "has no gl"));
}

TEST_MAIN
