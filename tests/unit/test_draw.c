/* The canvas: what it draws against what should be seen. Needs a GL (Mesa's software will do). */
#include "cmd/pbs-view/plan/cut.h"
#include "cmd/pbs-view/draw/draw.h"
#include "libcore/surfels/average.h"
#include "libcore/measures/metrics.h"
#include "tests/check.h"

#define PI 3.14159265358979323846
enum { SIDE = 160, SURFELS = 6000, STRIDE = 16 };

static pbs_run run = {.threads = 1};
static pbs_gl gl;
static pbs_gl_context *context;
static pbs_err err;

/* A context costs more than all pictures here: one for all tests. */
static bool no_gl(void) {
    static pbs_code code = -1;
    if ((int)code == -1) code = pbs_gl_context_new("sw", &context, &gl, &err);
    return code != PBS_OK;
}

static pbs_canvas *new_canvas(int samples) {
    pbs_canvas *c = NULL;
    pbs_canvas_desc d = {SIDE, SIDE, samples};
    if (pbs_canvas_new(&run, &gl, &d, &c, &err)) printf("# %s\n", err.text), pbs_bad++;
    return c;
}

static const pbs_box UNIT = {{-1, -1, -1}, {1, 1, 1}};

static pbs_frame frame_of(const double m[12]) {
    pbs_frame f = {0};
    pbs_box b = pbs_xform_box(m, &UNIT);
    pbs_camera_frame(&f.camera, &b, &(pbs_camera_desc){0});
    return f;
}

static pbs_image shot(pbs_canvas *c, const pbs_frame *f, const pbs_surfels *s,
                      const pbs_meshes *m) {
    pbs_image image = {0};
    if (pbs_canvas_begin(c, f, &err) || (s && pbs_canvas_surfels(c, s, 1, &err)) ||
        (m && pbs_canvas_meshes(c, m, &err)) || pbs_canvas_end(c, &image, &err)) {
        printf("# %s\n", err.text);
        pbs_bad++;
        image = (pbs_image){SIDE, SIDE, calloc(SIDE * SIDE, 4)};
    }
    return image;
}

static bool same(const pbs_image *a, const pbs_image *b) {
    return memcmp(a->rgba, b->rgba, (size_t)4 * SIDE * SIDE) == 0;
}

static double covered(const pbs_image *i) {
    double sum = 0;
    for (size_t p = 0; p < (size_t)i->width * i->height; p++) sum += i->rgba[4 * p + 3] / 255.0;
    return sum;
}

static const uint8_t *pixel(const pbs_image *i, uint32_t x, uint32_t y) {
    return i->rgba + 4 * ((size_t)y * i->width + x);
}

/* ---- a sphere, both ways ---- */

static uint8_t records[SURFELS][STRIDE];
static double covering;

/* A Fibonacci sphere; its covering radius is about 1.1 times the root of the area of a point. */
static pbs_surfels sphere_surfels(void) {
    for (int i = 0; i < SURFELS; i++) {
        double y = 1 - (2 * i + 1.0) / SURFELS, r = sqrt(1 - y * y), a = i * PI * (3 - sqrt(5));
        double n[3] = {r * cos(a), y, r * sin(a)};
        float nf[3] = {(float)n[0], (float)n[1], (float)n[2]};
        uint16_t q[4] = {0};
        int16_t o[2];
        for (int k = 0; k < 3; k++) q[k] = (uint16_t)((n[k] + 1) * 32767.5 + 0.5);
        pbs_oct_encode(o, nf);
        memcpy(records[i], q, 8);
        memcpy(records[i] + 8, o, 4);
        memcpy(records[i] + 12, (uint8_t[4]){180, 120, 60, 255}, 4);
    }
    covering = 1.1 * sqrt(4 * PI / SURFELS);
    return (pbs_surfels){.records = records,
                         .channels = PBS_NORMAL | PBS_COLOUR,
                         .prefix = SURFELS,
                         .radius = covering,
                         .corner = {-1, -1, -1},
                         .step = 1 / 32767.5};
}

enum { RINGS = 48, VERTICES = (RINGS + 1) * (2 * RINGS + 1), TRIANGLES = 4 * RINGS * RINGS };
static float position[VERTICES][3];
static int16_t normal[VERTICES][2];
static uint8_t colour[VERTICES][4];
static uint16_t index_of[TRIANGLES][3];

static pbs_mesh sphere_mesh(void) {
    uint32_t t = 0, w = 2 * RINGS + 1;
    for (uint32_t j = 0, v = 0; j <= RINGS; j++)
        for (uint32_t i = 0; i < w; i++, v++) {
            double a = PI * i / RINGS, b = PI * j / RINGS;
            double n[3] = {sin(b) * cos(a), cos(b), sin(b) * sin(a)};
            for (int k = 0; k < 3; k++) position[v][k] = (float)n[k];
            pbs_oct_encode(normal[v], position[v]);
            memcpy(colour[v], (uint8_t[4]){180, 120, 60, 255}, 4);
            if (i == 2 * RINGS || j == RINGS) continue;
            uint16_t q[6] = {v, v + 1, v + w, v + 1, v + w + 1, v + w};
            memcpy(index_of[t], q, sizeof q), t += 2;
        }
    return (pbs_mesh){.vertices = VERTICES,
                      .triangles = TRIANGLES,
                      .position = position[0],
                      .normal = normal[0],
                      .colour = colour[0],
                      .index = index_of[0],
                      .material = PBS_NONE};
}

static void check_alike(const pbs_image *surfels, const pbs_image *mesh, double ssim) {
    pbs_picture_error e;
    CHECK(pbs_picture_compare(&run, surfels, mesh, &e, &err) == PBS_OK);
    CHECK_NUM(e.ssim > ssim, e.ssim);
    CHECK_NUM(e.hole < 0.001, e.hole);
    CHECK_NUM(e.spill < 0.04, e.spill);
}

/* Surfels and triangles of a sphere, placed by m, give the same picture. */
static pbs_image check_sphere(pbs_canvas *c, const double m[12], double ssim) {
    pbs_surfels s = sphere_surfels();
    pbs_mesh mesh = sphere_mesh();
    pbs_draw draw = {.mesh = &mesh};
    pbs_meshes scene = {.draws = &draw, .draw_count = 1};
    memcpy(s.m, m, sizeof s.m);
    memcpy(draw.m, m, sizeof draw.m);
    pbs_frame f = frame_of(m);
    pbs_image a = shot(c, &f, &s, NULL), b = shot(c, &f, NULL, &scene);
    check_alike(&a, &b, ssim);
    pbs_free(&run, a.rgba);
    return b;
}

TEST(empty_picture) {
    if (no_gl()) SKIP(err.text);
    pbs_canvas *c = new_canvas(0);
    pbs_frame f = frame_of(PBS_IDENTITY);
    memcpy(f.background, (uint8_t[4]){10, 130, 250, 255}, 4);
    pbs_image i = shot(c, &f, NULL, NULL);
    CHECK(covered(&i) == 0);
    for (uint32_t k = 0; k < SIDE; k++)
        CHECK(memcmp(pixel(&i, k, (k * 7) % SIDE), (uint8_t[4]){10, 130, 250, 0}, 4) == 0);
    pbs_free(&run, i.rgba);
    pbs_canvas_free(c);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(sphere_both_ways) {
    if (no_gl()) SKIP(err.text);
    for (int samples = 1; samples <= 4; samples += 3) {
        pbs_canvas *c = new_canvas(samples);
        pbs_image b = check_sphere(c, PBS_IDENTITY, 0.97);
        /* Its outline is a circle of a known size. */
        pbs_frame f = frame_of(PBS_IDENTITY);
        double pixel_size = pbs_camera_pixel(&f.camera, SIDE);
        double sine = 1 / f.camera.unit;
        double area = PI * sine * sine / (1 - sine * sine) / (pixel_size * pixel_size);
        CHECK_NUM(fabs(covered(&b) / area - 1) < 0.02, covered(&b) / area);
        pbs_free(&run, b.rgba);
        pbs_canvas_free(c);
    }
}

/* Far from the origin and in any scale a scene looks the same. */
TEST(place_and_scale_do_not_matter) {
    if (no_gl()) SKIP(err.text);
    pbs_canvas *c = new_canvas(0);
    pbs_image at_origin = check_sphere(c, PBS_IDENTITY, 0.97);
    double scales[] = {1e-9, 1e9, 1, 3e-20, 1e25}, offsets[] = {0, 0, 1e7, 0, 0};
    for (int i = 0; i < 5; i++) {
        double s = scales[i], o = offsets[i], m[12] = {s, 0, 0, o, 0, s, 0, -o, 0, 0, s, o};
        pbs_image there = check_sphere(c, m, 0.97);
        pbs_picture_error e;
        CHECK(pbs_picture_compare(&run, &there, &at_origin, &e, &err) == PBS_OK);
        CHECK_NUM(e.ssim > 0.9999, e.ssim);
        pbs_free(&run, there.rgba);
    }
    pbs_free(&run, at_origin.rgba);
    pbs_canvas_free(c);
}

TEST(transforms) {
    if (no_gl()) SKIP(err.text);
    pbs_canvas *c = new_canvas(0);
    const double m[][12] = {{-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},     /* mirrored */
                            {1, 0, 0, 0, 0, 0.3, 0, 0, 0, 0, 2, 0},    /* flattened */
                            {1, 0.8, 0, 0, 0, 1, 0, 3, 0.4, 0, 1, 0}}; /* sheared */
    for (int i = 0; i < 3; i++) {
        pbs_image b = check_sphere(c, m[i], 0.93);
        pbs_free(&run, b.rgba);
    }
    pbs_canvas_free(c);
}

/* Same bytes: twice, with the default of what is absent given, and through the buffer in pieces. */
TEST(same_bytes) {
    if (no_gl()) SKIP(err.text);
    static uint8_t wide[2100][4096];
    pbs_canvas *c = new_canvas(0);
    pbs_surfels s = sphere_surfels();
    pbs_frame f = frame_of(PBS_IDENTITY);
    s.prefix = 2100;
    for (int i = 0; i < 2100; i++) memcpy(wide[i], records[i], STRIDE);
    pbs_image a = shot(c, &f, &s, NULL), b = shot(c, &f, &s, NULL);
    CHECK(same(&a, &b));
    pbs_free(&run, b.rgba);
    s.records = wide, s.stride = sizeof wide[0]; /* 8.6 MB */
    b = shot(c, &f, &s, NULL);
    CHECK(same(&a, &b));
    pbs_free(&run, b.rgba);
    for (int i = 0; i < 2100; i++) memcpy(wide[i] + 16, (uint8_t[8]){0, 255}, 8);
    s.channels |= PBS_MATERIAL | PBS_EMISSIVE;
    b = shot(c, &f, &s, NULL);
    CHECK(same(&a, &b));
    CHECK(pbs_surfel_size(s.channels) == 24 && pbs_surfel_size(0) == 8);
    pbs_free(&run, b.rgba);
    pbs_free(&run, a.rgba);
    s.stride = 20;
    CHECK(pbs_canvas_surfels(c, &s, 1, &err) == PBS_INTERNAL);
    pbs_canvas_free(c);
}

/* Normals absent: discs face the eye and still close the surface. */
TEST(surfels_without_normals) {
    if (no_gl()) SKIP(err.text);
    pbs_canvas *c = new_canvas(0);
    pbs_surfels s = sphere_surfels();
    pbs_frame f = frame_of(PBS_IDENTITY);
    pbs_image a = shot(c, &f, &s, NULL);
    s.channels = 0, s.stride = STRIDE;
    pbs_image b = shot(c, &f, &s, NULL);
    CHECK_NUM(covered(&b) >= covered(&a) && covered(&b) < covered(&a) * 1.1, covered(&b));
    pbs_free(&run, a.rgba);
    pbs_free(&run, b.rgba);
    pbs_canvas_free(c);
}

/* A surfel of no size, anywhere, turned anyhow, is seen. */
TEST(no_surfel_vanishes) {
    if (no_gl()) SKIP(err.text);
    uint32_t state = 7;
    for (int samples = 1; samples <= 4; samples += 3) {
        pbs_canvas *c = new_canvas(samples);
        pbs_surfels s = sphere_surfels();
        pbs_frame f = frame_of(PBS_IDENTITY);
        s.prefix = 1, s.radius = 0;
        for (int i = 0; i < 200; i++) {
            uint8_t one[STRIDE];
            for (int k = 0; k < STRIDE; k++) one[k] = (uint8_t)((state = state * 69069 + 1) >> 24);
            s.records = one;
            pbs_image p = shot(c, &f, &s, NULL);
            CHECK_NUM(covered(&p) > 0.2 && covered(&p) < 4, covered(&p));
            pbs_free(&run, p.rgba);
        }
        pbs_canvas_free(c);
    }
}

/* ---- materials ---- */

static const float QUAD[4][3] = {{-1, 1, 0}, {1, 1, 0}, {1, -1, 0}, {-1, -1, 0}};
static const float QUAD_UV[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
static const uint16_t QUAD_INDEX[6] = {0, 2, 1, 0, 3, 2}; /* seen from +z: clockwise or not */

static pbs_frame front(void) {
    pbs_frame f = {0};
    pbs_camera_parse(&f.camera, "0,0,4,0,0,0,40", NULL);
    return f;
}

static char strongest(const pbs_image *i, double x, double y) {
    const uint8_t *p = pixel(i, (uint32_t)(x * SIDE), (uint32_t)(y * SIDE));
    if (p[3] == 0) return '-';
    if (p[0] > p[1] + 60 && p[0] > p[2] + 60) return 'r';
    if (p[1] > p[0] + 60 && p[1] > p[2] + 60) return 'g';
    return p[2] > p[0] + 60 && p[2] > p[1] + 60 ? 'b' : 'w';
}

TEST(textures) {
    if (no_gl()) SKIP(err.text);
    /* red green / blue hole */
    uint8_t texel[16] = {255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 255, 255, 255, 0};
    pbs_image texture[2] = {{2, 2, texel}, {2, 2, NULL}};
    pbs_mesh mesh = {
        .vertices = 4, .triangles = 2, .position = QUAD[0], .uv = QUAD_UV[0], .index = QUAD_INDEX};
    pbs_material material = PBS_MATERIAL_DEFAULT;
    pbs_draw draw = {.mesh = &mesh, .m = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    pbs_meshes scene = {&draw, 1, &material, 1, texture, 2};
    pbs_canvas *c = new_canvas(0);
    pbs_frame f = front();
    material.base_texture.texture = 0;
    material.alpha = PBS_ALPHA_MASK;
    pbs_image i = shot(c, &f, NULL, &scene);
    CHECK(strongest(&i, 0.3, 0.3) == 'r' && strongest(&i, 0.7, 0.3) == 'g');
    CHECK(strongest(&i, 0.3, 0.7) == 'b' && strongest(&i, 0.7, 0.7) == '-');
    pbs_free(&run, i.rgba);
    /* shifted by half a texture, which repeats: the columns change places */
    material.base_texture.transform[2] = 0.5f;
    material.alpha = PBS_ALPHA_OPAQUE;
    i = shot(c, &f, NULL, &scene);
    CHECK(strongest(&i, 0.3, 0.3) == 'g' && strongest(&i, 0.7, 0.3) == 'r');
    CHECK(strongest(&i, 0.3, 0.7) == 'w' && strongest(&i, 0.7, 0.7) == 'b');
    pbs_free(&run, i.rgba);
    /* a texture that is not there is white */
    material.base_texture.texture = 1;
    i = shot(c, &f, NULL, &scene);
    CHECK(strongest(&i, 0.3, 0.3) == 'w' && strongest(&i, 0.7, 0.7) == 'w');
    pbs_free(&run, i.rgba);
    pbs_canvas_free(c);
}

/* Materials by triangle, in an order that is not theirs; flat and given normals agree. */
TEST(materials_by_triangle) {
    if (no_gl()) SKIP(err.text);
    float tilted[4][3];
    int16_t toward[4][2];
    for (int v = 0; v < 4; v++) {
        memcpy(tilted[v], QUAD[v], sizeof tilted[v]);
        tilted[v][2] = 0.75f * tilted[v][0];
        pbs_oct_encode(toward[v], (float[3]){-0.6f, 0, 0.8f});
    }
    uint32_t by_triangle[2] = {2, 1};
    pbs_material material[3] = {PBS_MATERIAL_DEFAULT, PBS_MATERIAL_DEFAULT, PBS_MATERIAL_DEFAULT};
    memcpy(material[1].base, (float[4]){1, 0, 0, 1}, 16);
    memcpy(material[2].base, (float[4]){0, 0, 1, 1}, 16);
    pbs_mesh flat = {.vertices = 4,
                     .triangles = 2,
                     .position = tilted[0],
                     .index = QUAD_INDEX,
                     .triangle_material = by_triangle};
    pbs_mesh given = flat;
    given.normal = toward[0];
    pbs_draw draw[2] = {{&flat, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}},
                        {&flat, {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}}}; /* singular: nothing */
    pbs_meshes scene = {draw, 2, material, 3, NULL, 0};
    pbs_canvas *c = new_canvas(0);
    pbs_frame f = front();
    pbs_image a = shot(c, &f, NULL, &scene);
    CHECK(strongest(&a, 0.7, 0.3) == 'b' && strongest(&a, 0.3, 0.7) == 'r');
    draw[0].mesh = &given;
    pbs_image b = shot(c, &f, NULL, &scene);
    CHECK(same(&a, &b));
    pbs_free(&run, a.rgba);
    pbs_free(&run, b.rgba);
    pbs_canvas_free(c);
}

/* Two triangles at an angle: each has its own normal and material, in one mesh or in two. */
TEST(faces_keep_their_normals) {
    if (no_gl()) SKIP(err.text);
    uint32_t by_triangle[2] = {1, 0};
    float bent[4][3];
    memcpy(bent, QUAD, sizeof bent);
    bent[1][2] = 0.9f;
    pbs_material material[2] = {PBS_MATERIAL_DEFAULT, PBS_MATERIAL_DEFAULT};
    memcpy(material[1].base, (float[4]){0.8f, 0.5f, 0.2f, 1}, 16);
    pbs_mesh both = {.vertices = 4,
                     .triangles = 2,
                     .position = bent[0],
                     .index = QUAD_INDEX,
                     .triangle_material = by_triangle};
    pbs_mesh one = both, other = both;
    one.triangle_material = other.triangle_material = NULL;
    one.triangles = other.triangles = 1;
    one.material = 1, other.material = 0, other.index = QUAD_INDEX + 3;
    pbs_draw draw[2] = {{&both, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}}};
    pbs_meshes scene = {draw, 1, material, 2, NULL, 0};
    pbs_canvas *c = new_canvas(0);
    pbs_frame f = front();
    pbs_image a = shot(c, &f, NULL, &scene);
    draw[1] = draw[0];
    draw[0].mesh = &one, draw[1].mesh = &other, scene.draw_count = 2;
    pbs_image b = shot(c, &f, NULL, &scene);
    CHECK(same(&a, &b));
    pbs_free(&run, a.rgba);
    pbs_free(&run, b.rgba);
    pbs_canvas_free(c);
}

/* ---- octaves ---- */

static uint8_t entries[SURFELS][8];

/* Of the sphere, in one colour. */
static void fill_octaves(const uint8_t colour_of[4]) {
    size_t at = 0;
    for (int k = pbs_octaves(SURFELS); k > 0; k--)
        for (size_t i = 0; i < pbs_octave_length(SURFELS, k); i++, at++) {
            memcpy(entries[at], records[i] + 8, 4);
            memcpy(entries[at] + 4, colour_of, 4);
        }
}

static int largest_difference(const pbs_image *a, const pbs_image *b) {
    int most = 0;
    for (size_t i = 0; i < (size_t)4 * SIDE * SIDE; i++) {
        int d = abs(a->rgba[i] - b->rgba[i]);
        most = d > most ? d : most;
    }
    return most;
}

TEST(octaves_say_what_a_prefix_looks_like) {
    if (no_gl()) SKIP("no OpenGL here");
    pbs_canvas *c = new_canvas(4);
    static const uint8_t brown[4] = {180, 120, 60, 255}, green[4] = {20, 200, 30, 255};
    pbs_frame f = frame_of(PBS_IDENTITY);
    for (uint32_t prefix = SURFELS; prefix > 40; prefix = prefix * 2 / 3) {
        pbs_surfels own = sphere_surfels(), octaves = own;
        own.prefix = octaves.prefix = prefix;
        octaves.whole = SURFELS, octaves.octaves = entries;
        fill_octaves(brown);
        pbs_image a = shot(c, &f, &own, NULL), b = shot(c, &f, &octaves, NULL);
        CHECK_NUM(largest_difference(&a, &b) <= 1, prefix);
        pbs_free(&run, b.rgba);
        fill_octaves(green);
        b = shot(c, &f, &octaves, NULL);
        CHECK_NUM(prefix == SURFELS || largest_difference(&a, &b) > 10, prefix);
        pbs_free(&run, a.rgba);
        /* From the first octave on nothing is left of the surfels' own colours. */
        for (int i = 0; i < SURFELS; i++) memcpy(records[i] + 12, green, 4);
        a = shot(c, &f, &own, NULL);
        int d = largest_difference(&a, &b);
        CHECK_NUM(prefix <= SURFELS / 4 ? d <= 1 : d > 10, prefix);
        pbs_free(&run, a.rgba);
        pbs_free(&run, b.rgba);
    }
    pbs_canvas_free(c);
}

TEST(refusals) {
    if (no_gl()) SKIP(err.text);
    pbs_canvas *c;
    pbs_canvas_desc huge = {1u << 20, 8, 0}, fine = {SIDE, SIDE, 0};
    CHECK(pbs_canvas_new(&run, &gl, &huge, &c, &err) == PBS_LIMIT && !c);
    pbs_run small = {.threads = 1, .mem_limit = 1 << 18};
    CHECK(pbs_canvas_new(&small, &gl, &fine, &c, &err) == PBS_LIMIT && !c);
    CHECK(pbs_mem_used(&small) == 0 && pbs_mem_used(&run) == 0);
    pbs_gl_context *other;
    pbs_gl table;
    CHECK(pbs_gl_context_new("fast", &other, &table, &err) == PBS_USAGE && !other);
    CHECK(pbs_gl_context_new("31", &other, &table, &err) == PBS_IO && !other);
    GLuint program;
    pbs_gl_stage bad = {GL_VERTEX_SHADER, {"#version 450 core\n", "void main() { x = 1; }"}};
    CHECK(pbs_gl_program(&gl, "bad", &bad, 1, &program, &err) == PBS_INTERNAL && program == 0);
    CHECK(strstr(err.text, "bad") && strstr(err.text, "x"));
    /* The last test: give the context back. */
    pbs_gl_context_free(context);
}

TEST_MAIN
