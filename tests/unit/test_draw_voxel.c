/* Voxels on the canvas: against the same faces as triangles, and what masks, normals and sides do.
 * Needs a GL (Mesa's software will do). */
#include "cmd/pbs-view/draw/draw.h"
#include "cmd/pbs-view/draw/draw_texture.h"
#include "libcore/measures/metrics.h"
#include "tests/unit/support.h"
#include "tests/check.h"

enum { SIDE = 160 };

static pbs_run run = {.threads = 1};
static pbs_gl gl;
static pbs_gl_context *context;
static pbs_canvas *canvas;
static pbs_err err;

/* A context costs more than all pictures here: one for all tests. */
static bool no_gl(void) {
    static pbs_code code = -1;
    if ((int)code == -1) {
        code = pbs_gl_context_new("sw", &context, &gl, &err);
        if (!code)
            code = pbs_canvas_new(&run, &gl, &(pbs_canvas_desc){SIDE, SIDE, 0}, &canvas, &err);
    }
    return code != PBS_OK;
}

static const pbs_box UNIT = {{-1, -1, -1}, {1, 1, 1}};

static pbs_frame frame_of(const double m[12]) {
    pbs_frame f = {0};
    pbs_box b = pbs_xform_box(m, &UNIT);
    pbs_camera_frame(&f.camera, &b, &(pbs_camera_desc){0});
    return f;
}

static pbs_image shot(const pbs_frame *f, const pbs_cubes *v, const pbs_meshes *m) {
    pbs_image image = {0};
    if (pbs_canvas_begin(canvas, f, &err) || (v && pbs_canvas_voxels(canvas, v, 1, NULL, &err)) ||
        (m && pbs_canvas_meshes(canvas, m, &err)) || pbs_canvas_end(canvas, &image, &err)) {
        printf("# %s\n", err.text);
        pbs_bad++;
        image = (pbs_image){SIDE, SIDE, calloc(SIDE * SIDE, 4)};
    }
    return image;
}

static double covered(const pbs_image *i) {
    double sum = 0;
    for (size_t p = 0; p < SIDE * SIDE; p++) sum += i->rgba[4 * p + 3] / 255.0;
    return sum;
}

static const double lens[][12] = {
    {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},          {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
    {1, 0.8, 0, 0, 0, 1, 0, 3, 0.4, 0, 1, 0},      {1, 0, 0, 1e7, 0, 1, 0, -1e7, 0, 0, 1, 0},
    {1e-9, 0, 0, 0, 0, 1e-9, 0, 0, 0, 0, 1e-9, 0}, {1e25, 0, 0, 0, 0, 1e25, 0, 0, 0, 0, 1e25, 0},
};
enum { LENSES = sizeof lens / sizeof lens[0] };

/* ---- a sphere's voxels, as cubes and as triangles ---- */

typedef struct sphere {
    vox_model m;
    pbs_voxels v;
    pbs_cubes cubes;
} sphere;

static void make_sphere(sphere *s, uint32_t size, uint32_t channels) {
    vox_sphere(&s->m, size);
    must(pbs_voxels_alloc(&run, channels, s->m.count[0], &s->v, &err), &err);
    for (uint32_t i = 0; i < s->m.count[0]; i++) {
        const vox_cell *c = &s->m.cell[0][i];
        s->v.place[i] = pbs_unmorton8((uint32_t)c->code) | c->faces << 24;
        if (s->v.normal) s->v.normal[i] = pbs_normal10_put(c->normal);
        if (s->v.colour) s->v.colour[i] = 0xff3c78b4;
    }
    s->cubes =
        (pbs_cubes){.chunks = &s->v, .chunk_count = 1, .corner = {-1, -1, -1}, .side = 2.0 / size};
    memcpy(s->cubes.m, PBS_IDENTITY, sizeof s->cubes.m);
}

static void free_sphere(sphere *s) {
    pbs_voxels_free(&run, &s->v);
    vox_free(&s->m);
}

/* Every face in every mask, without normals, which makes them flat. */
static pbs_mesh faces_of(const sphere *s) {
    uint32_t most = 6 * (uint32_t)s->v.count, n = 0;
    float(*p)[3] = malloc(4 * most * sizeof *p);
    uint16_t(*index)[3] = malloc(2 * most * sizeof *index);
    for (size_t i = 0; i < s->v.count; i++)
        for (uint32_t f = 0; f < 6; f++) {
            if (!(s->v.place[i] >> 24 >> f & 1)) continue;
            uint32_t k = f / 2, a = (k + 1) % 3, b = (k + 2) % 3;
            for (uint32_t j = 0; j < 4; j++) {
                uint32_t at[3] = {s->v.place[i] & 255, s->v.place[i] >> 8 & 255,
                                  s->v.place[i] >> 16 & 255};
                at[k] += f & 1, at[a] += j & 1, at[b] += j >> 1;
                for (int c = 0; c < 3; c++)
                    p[4 * n + j][c] = (float)(at[c] * s->cubes.side + s->cubes.corner[c]);
            }
            const uint16_t v = (uint16_t)(4 * n);
            memcpy(index[2 * n], (uint16_t[6]){v, v + 1, v + 2, v + 1, v + 3, v + 2}, 12);
            n++;
        }
    if (4 * n > 65536) abort();
    return (pbs_mesh){.vertices = 4 * n,
                      .triangles = 2 * n,
                      .position = p[0],
                      .index = index[0],
                      .material = PBS_NONE};
}

/* Seen from outside, cubes of three faces and all faces in the masks are one picture. */
TEST(cubes_are_their_faces) {
    if (no_gl()) SKIP(err.text);
    sphere s;
    make_sphere(&s, 32, PBS_POSITION);
    pbs_mesh mesh = faces_of(&s);
    pbs_draw draw = {.mesh = &mesh};
    pbs_meshes scene = {.draws = &draw, .draw_count = 1};
    for (int i = 0; i < LENSES; i++) {
        pbs_picture_error e;
        pbs_frame f = frame_of(lens[i]);
        memcpy(draw.m, lens[i], sizeof draw.m);
        memcpy(s.cubes.m, lens[i], sizeof draw.m);
        pbs_image a = shot(&f, &s.cubes, NULL), b = shot(&f, NULL, &scene);
        CHECK(pbs_picture_compare(&run, &a, &b, &e, &err) == PBS_OK);
        CHECK_NUM(e.ssim > 0.999, e.ssim);
        CHECK_NUM(e.hole < 1e-4 && e.spill < 1e-4, e.hole);
        CHECK_NUM(covered(&a) > 0.1 * SIDE * SIDE, covered(&a));
        pbs_free(&run, a.rgba), pbs_free(&run, b.rgba);
    }
    free((void *)mesh.position), free((void *)mesh.index);
    free_sphere(&s);
}

/* With normals it looks like the surface, and in parts of any size like the whole. */
TEST(normals_and_parts) {
    if (no_gl()) SKIP(err.text);
    sphere s;
    make_sphere(&s, 256, PBS_POSITION | PBS_NORMAL | PBS_COLOUR);
    pbs_frame f = frame_of(PBS_IDENTITY);
    pbs_image a = shot(&f, &s.cubes, NULL);
    for (size_t part = 3001; part <= 200000; part *= 9) {
        size_t n = (s.v.count + part - 1) / part;
        pbs_voxels *some = malloc(n * sizeof *some);
        for (size_t i = 0; i < n; i++)
            some[i] = (pbs_voxels){.count = i + 1 < n ? part : s.v.count - i * part,
                                   .place = s.v.place + i * part,
                                   .normal = s.v.normal + i * part,
                                   .colour = s.v.colour + i * part};
        pbs_cubes parts = s.cubes;
        parts.chunks = some, parts.chunk_count = n;
        pbs_image b = shot(&f, &parts, NULL);
        CHECK(!memcmp(a.rgba, b.rgba, (size_t)4 * SIDE * SIDE));
        pbs_free(&run, b.rgba);
        free(some);
    }
    /* The outline of a sphere of that radius, and up to a voxel more. */
    double pixel = pbs_camera_pixel(&f.camera, SIDE), sine = 0.96 / f.camera.unit;
    double area = 3.14159265 * sine * sine / (1 - sine * sine) / (pixel * pixel);
    CHECK_NUM(covered(&a) > area && covered(&a) < 1.03 * area, covered(&a) / area);
    pbs_free(&run, a.rgba);
    free_sphere(&s);
}

/* ---- one voxel ---- */

static pbs_image shot_one(uint32_t flags, const float *n, const double m[12], const double eye[3]) {
    uint32_t place = PBS_PLACE(0, 0, 0, flags), normal = n ? pbs_normal10_put(n) : 0;
    pbs_voxels v = {.count = 1, .place = &place, .normal = n ? &normal : NULL};
    pbs_cubes cubes = {.chunks = &v, .chunk_count = 1, .corner = {-1, -1, -1}, .side = 2, .m = {0}};
    pbs_frame f = {0};
    pbs_box b = pbs_xform_box(m, &UNIT);
    memcpy(cubes.m, m, sizeof cubes.m);
    pbs_camera_desc d = {.toward_eye = {eye[0], eye[1], eye[2]}};
    pbs_camera_frame(&f.camera, &b, &d);
    return shot(&f, &cubes, NULL);
}

/* Each face covers what it should: seen from its own side only, three together what all do. */
TEST(masks) {
    if (no_gl()) SKIP(err.text);
    for (int octant = 0; octant < 8; octant++) {
        double eye[3], area = 0;
        uint32_t toward = 0;
        for (int k = 0; k < 3; k++) {
            eye[k] = octant >> k & 1 ? 1 : -1;
            toward |= 1u << (2 * k + (octant >> k & 1));
        }
        for (uint32_t f = 0; f < 6; f++) {
            pbs_image i = shot_one(1u << f, NULL, PBS_IDENTITY, eye);
            CHECK((covered(&i) > 100) == (toward >> f & 1));
            area += covered(&i);
            pbs_free(&run, i.rgba);
        }
        pbs_image all = shot_one(PBS_FACES_ALL, NULL, PBS_IDENTITY, eye);
        CHECK_NUM(fabs(area - covered(&all)) < 20, area - covered(&all));
        pbs_free(&run, all.rgba);
        all = shot_one(PBS_FACES_ALL & ~toward, NULL, PBS_IDENTITY, eye);
        CHECK(covered(&all) == 0);
        pbs_free(&run, all.rgba);
    }
}

static int brightness(uint32_t flags, const float *n, const double m[12]) {
    pbs_image i = shot_one(flags, n, m, (const double[3]){0, 0, 1});
    int green = i.rgba[4 * (SIDE / 2 * SIDE + SIDE / 2) + 1];
    pbs_free(&run, i.rgba);
    return green;
}

/* A normal that looks away is turned if the voxel has two sides, and else the face has its own; the
 * same in a mirror. So it has without one, or with none of its own. */
TEST(sides) {
    if (no_gl()) SKIP(err.text);
    const float to[3] = {0, 0, 1}, away[3] = {0, 0, -1}, slanted[3] = {0.3f, 0.4f, -0.2f};
    for (int i = 0; i < 2; i++) {
        const double *m = lens[i];
        int lit = brightness(PBS_FACE_Z1, to, m);
        CHECK_NUM(lit == brightness(PBS_FACE_Z1, NULL, m), lit);
        CHECK(lit == brightness(PBS_FACE_Z1 | PBS_VOXEL_TWO_SIDED, away, m));
        int edge = brightness(PBS_FACE_Z1, slanted, m);
        CHECK_NUM(edge != brightness(PBS_FACE_Z1 | PBS_VOXEL_TWO_SIDED, slanted, m), edge);
        CHECK_NUM(edge == lit, edge);
    }
    uint32_t place = PBS_PLACE(0, 0, 0, PBS_FACES_ALL), none = 0;
    pbs_voxels v = {.count = 1, .place = &place, .normal = &none}, w = v;
    w.normal = NULL;
    pbs_cubes a = {.chunks = &v,
                   .chunk_count = 1,
                   .corner = {-1, -1, -1},
                   .side = 2,
                   .m = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}},
              b = a;
    b.chunks = &w;
    pbs_frame f = frame_of(PBS_IDENTITY);
    pbs_image one = shot(&f, &a, NULL), other = shot(&f, &b, NULL);
    CHECK(!memcmp(one.rgba, other.rgba, (size_t)4 * SIDE * SIDE));
    pbs_free(&run, one.rgba), pbs_free(&run, other.rgba);
}

/* ---- in the GPU's memory ---- */

static GLuint buffer_of(const void *bytes, size_t size) {
    GLuint b;
    gl.CreateBuffers(1, &b);
    gl.NamedBufferData(b, (GLsizeiptr)size, bytes, GL_STATIC_DRAW);
    return b;
}

/* One voxel that fills the unit cube, words behind others; scaled and moved. */
static pbs_cubes resident_one(GLuint buffer, double scale, double z) {
    return (pbs_cubes){.buffer = buffer,
                       .at = 4,
                       .count = 1,
                       .place = 0,
                       .normal = -1,
                       .colour = -1,
                       .material = -1,
                       .emissive = -1,
                       .face = -1,
                       .faces = -1,
                       .corner = {-1, -1, -1},
                       .side = 2,
                       .m = {scale, 0, 0, 0, 0, scale, 0, 0, 0, 0, scale, z}};
}

static pbs_image shot_with(const pbs_cubes *v, size_t n, const pbs_voxel_mode *mode) {
    pbs_frame f = {0};
    pbs_image image = {0};
    must(pbs_camera_parse(&f.camera, "0,0,6,0,0,0", &err), &err);
    must(pbs_canvas_begin(canvas, &f, &err), &err);
    must(pbs_canvas_voxels(canvas, v, n, mode, &err), &err);
    must(pbs_canvas_end(canvas, &image, &err), &err);
    return image;
}

/* Faces have their own colours, in the order of the mask's bits, or materials. */
TEST(attributes_of_single_faces) {
    if (no_gl()) SKIP(err.text);
    const pbs_material m[2] = {PBS_MATERIAL_DEFAULT, {.base = {0, 1, 0, 1}, .roughness = 1}};
    for (int material = 0; material < 2; material++) {
        /* word 0 is another's; place, where its faces begin, and the list. */
        const uint32_t red = 0xff0000ff, green = 0xff00ff00, other = 0xffffffff;
        uint32_t words[] = {
            other, PBS_PLACE(0, 0, 0, PBS_FACE_X0 | PBS_FACE_Z0 | PBS_FACE_Z1), 1, other, red, red,
            green};
        if (material) words[4] = words[5] = 0, words[6] = 1;
        pbs_cubes v = resident_one(buffer_of(words, sizeof words), 1, 0);
        v.face = 1, v.faces = 2, v.face_count = 4, v.face_colours = !material;
        pbs_voxel_mode mode = {.palette = {m, 2}};
        pbs_image i = shot_with(&v, 1, &mode);
        const uint8_t *p = i.rgba + 4 * (SIDE / 2 * SIDE + SIDE / 2);
        CHECK_NUM(p[1] > 100 && p[0] < 90 && p[2] < 90, p[1]);
        pbs_free(&run, i.rgba);
        /* A list that is too short, as a damaged file may have it. */
        words[2] = 77;
        gl.NamedBufferSubData(v.buffer, 0, sizeof words, words);
        i = shot_with(&v, 1, &mode);
        CHECK(covered(&i) > 100);
        pbs_free(&run, i.rgba);
        gl.DeleteBuffers(1, &v.buffer);
    }
}

/* Of a small cube behind a large one nothing is seen, of one beside it something; a probe is noted
 * and leaves no trace. */
TEST(notes_of_what_is_seen) {
    if (no_gl()) SKIP(err.text);
    const uint32_t words[] = {0, PBS_PLACE(0, 0, 0, PBS_FACES_ALL)};
    GLuint b = buffer_of(words, sizeof words);
    pbs_cubes v[3] = {resident_one(b, 1, 0), resident_one(b, 0.3, -2), resident_one(b, 0.3, -2)};
    v[2].m[3] = 2; /* beside */
    pbs_voxel_mode mode = {.frame = 4, .first = 2, .all = 9};
    pbs_image plain = shot_with(v, 3, NULL), noted = shot_with(v, 3, &mode);
    CHECK(!memcmp(plain.rgba, noted.rgba, (size_t)4 * SIDE * SIDE));
    uint64_t frame;
    const uint32_t *seen;
    size_t count;
    CHECK(pbs_canvas_seen(canvas, false, &frame, &seen, &count, &err) == PBS_OK && frame == 0);
    CHECK(pbs_canvas_seen(canvas, true, &frame, &seen, &count, &err) == PBS_OK && frame == 4);
    CHECK(count == 9 && seen[2] && !seen[3] && seen[4] && !seen[0] && !seen[8]);
    /* The large one is a probe of another frame. */
    pbs_frame f = {0};
    must(pbs_camera_parse(&f.camera, "0,0,6,0,0,0", &err), &err);
    must(pbs_canvas_begin(canvas, &f, &err), &err);
    mode = (pbs_voxel_mode){.frame = 5, .all = 3};
    must(pbs_canvas_voxels(canvas, v + 1, 2, &mode, &err), &err);
    mode.first = 2, mode.probes = true;
    must(pbs_canvas_voxels(canvas, v, 1, &mode, &err), &err);
    pbs_image with, without = shot_with(v + 1, 2, NULL);
    CHECK(pbs_canvas_seen(canvas, true, &frame, &seen, &count, &err) == PBS_OK && frame == 5);
    CHECK(count == 3 && seen[0] && seen[1] && seen[2]);
    CHECK(pbs_canvas_seen(canvas, false, &frame, &seen, &count, &err) == PBS_OK && frame == 4);
    must(pbs_canvas_begin(canvas, &f, &err), &err);
    mode = (pbs_voxel_mode){.frame = 6, .all = 3};
    must(pbs_canvas_voxels(canvas, v + 1, 2, &mode, &err), &err);
    mode.first = 2, mode.probes = true;
    must(pbs_canvas_voxels(canvas, v, 1, &mode, &err), &err);
    must(pbs_canvas_end(canvas, &with, &err), &err);
    CHECK(!memcmp(with.rgba, without.rgba, (size_t)4 * SIDE * SIDE));
    pbs_free(&run, plain.rgba), pbs_free(&run, noted.rgba);
    pbs_free(&run, with.rgba), pbs_free(&run, without.rgba);
    gl.DeleteBuffers(1, &b);
}

/* Source geometry out of a buffer is the same picture as through the canvas. */
TEST(triangles_out_of_a_buffer) {
    if (no_gl()) SKIP(err.text);
    float position[4][3] = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0.5f}};
    uint16_t index[2][3] = {{0, 1, 2}, {0, 2, 3}};
    uint8_t colour[4][4] = {{255, 0, 0, 255}, {0, 255, 0, 255}, {0, 0, 255, 255}, {9, 9, 9, 255}};
    pbs_mesh mesh = {.vertices = 4,
                     .triangles = 2,
                     .position = position[0],
                     .colour = colour[0],
                     .index = index[0],
                     .material = 0};
    pbs_material m = {.base = {1, 0.5f, 1, 1}, .roughness = 0.7f, .metallic = 0.2f};
    pbs_draw draw = {.mesh = &mesh};
    memcpy(draw.m, PBS_IDENTITY, sizeof draw.m);
    draw.m[3] = 0.25;
    pbs_meshes scene = {&draw, 1, &m, 1, NULL, 0};
    uint8_t bytes[4 + sizeof index + sizeof position + sizeof colour];
    memcpy(bytes + 4, index, sizeof index);
    memcpy(bytes + 4 + sizeof index, position, sizeof position);
    memcpy(bytes + 4 + sizeof index + sizeof position, colour, sizeof colour);
    pbs_placed_mesh t = {.buffer = buffer_of(bytes, sizeof bytes),
                         .count = 2,
                         .material = 0,
                         .index = 4,
                         .position = 4 + sizeof index,
                         .colour = 4 + sizeof index + sizeof position,
                         .normal = -1,
                         .triangle_material = -1,
                         .origin = {0.25, 0, 0}};
    memcpy(t.m, PBS_IDENTITY, sizeof t.m);
    pbs_frame f = frame_of(PBS_IDENTITY);
    pbs_palette palette = {&m, 1};
    pbs_image a = shot(&f, NULL, &scene), b = {0};
    must(pbs_canvas_begin(canvas, &f, &err), &err);
    must(pbs_canvas_triangles(canvas, &t, 1, &palette, &err), &err);
    CHECK(pbs_canvas_calls(canvas) == 1);
    must(pbs_canvas_end(canvas, &b, &err), &err);
    pbs_picture_error e;
    CHECK(pbs_picture_compare(&run, &a, &b, &e, &err) == PBS_OK);
    CHECK_NUM(e.ssim > 0.999, e.ssim);
    CHECK(covered(&a) > 1000 && fabs(covered(&a) - covered(&b)) < 1e-9);
    pbs_free(&run, a.rgba), pbs_free(&run, b.rgba);
    gl.DeleteBuffers(1, &t.buffer);
}

/* A texture that comes in small pieces. */
static GLuint texture_in_pieces(const pbs_image *image, bool srgb, uint64_t piece) {
    pbs_mips m;
    uint8_t *chain;
    must(pbs_mips_make(&run, image, srgb, 1024, UINT64_MAX, &m, &chain, &err), &err);
    GLuint t = pbs_gl_texture_new(&gl, &m);
    uint64_t all = pbs_mips_bytes(&m);
    for (uint64_t at = 0; at < all; at += piece)
        pbs_gl_texture_fill(&gl, t, &m, at, chain + at, piece < all - at ? piece : all - at);
    pbs_free(&run, chain);
    return t;
}

static pbs_image shot_placed(const pbs_frame *f, const pbs_placed_mesh *t, size_t n,
                             const pbs_palette *palette) {
    pbs_image image = {0};
    must(pbs_canvas_begin(canvas, f, &err), &err);
    must(pbs_canvas_triangles(canvas, t, n, palette, &err), &err);
    CHECK(pbs_canvas_calls(canvas) == n);
    must(pbs_canvas_end(canvas, &image, &err), &err);
    return image;
}

/* The same with textures, of which a triangle has three, turned and clamped, and the other none. */
TEST(textured_triangles_out_of_a_buffer) {
    if (no_gl()) SKIP(err.text);
    struct {
        float position[4][3], uv[4][2];
        uint32_t material[2];
        uint16_t index[2][3];
    } b = {{{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0.5f}},
           {{0, 0}, {1.5f, 0}, {1.5f, 1}, {-0.25f, 1}},
           {1, 0},
           {{0, 1, 2}, {0, 2, 3}}};
    uint8_t texel[3 * 140];
    for (int i = 0; i < (int)sizeof texel; i++) texel[i] = (uint8_t)(i * 7 + i / 9 * 40);
    pbs_image image[3] = {{5, 7, texel}, {7, 5, texel + 140}, {1, 35, texel + 280}};
    pbs_material m[2] = {PBS_MATERIAL_DEFAULT, PBS_MATERIAL_DEFAULT};
    pbs_texture_use *use[3] = {&m[0].base_texture, &m[0].material_texture, &m[0].emissive_texture};
    for (uint32_t i = 0; i < 3; i++) {
        *use[i] = (pbs_texture_use){i, i > 0, i > 1 ? 2 : 0, {0.5f, 1, 0.1f, -1, 0.5f, 0.2f}};
        m[0].emissive[i] = 0.2f * (float)i;
    }
    m[0].metallic = 0.7f, m[0].alpha = PBS_ALPHA_MASK, m[0].alpha_cutoff = 0.4f;
    m[1].base[2] = 0.25f;
    pbs_mesh mesh = {.vertices = 4,
                     .triangles = 2,
                     .position = b.position[0],
                     .uv = b.uv[0],
                     .triangle_material = b.material,
                     .index = b.index[0]};
    pbs_draw draw = {.mesh = &mesh};
    memcpy(draw.m, PBS_IDENTITY, sizeof draw.m);
    pbs_meshes scene = {&draw, 1, m, 2, image, 3};
    pbs_placed_mesh t[2];
    t[0] = (pbs_placed_mesh){.buffer = buffer_of(&b, sizeof b),
                             .count = 1,
                             .position = 0,
                             .uv = sizeof b.position,
                             .triangle_material = sizeof b.position + sizeof b.uv,
                             .index = sizeof b.position + sizeof b.uv + sizeof b.material,
                             .normal = -1,
                             .colour = -1};
    memcpy(t[0].m, PBS_IDENTITY, sizeof t[0].m);
    t[1] = t[0];
    t[1].first = 1, t[1].look = &m[0];
    for (int i = 0; i < 3; i++)
        t[1].texture[i] = texture_in_pieces(&image[i], i != 1, 4 + 12 * (uint64_t)i);
    pbs_frame f = frame_of(PBS_IDENTITY);
    pbs_palette palette = {m, 2};
    pbs_image expected = shot(&f, NULL, &scene), got = shot_placed(&f, t, 2, &palette);
    pbs_picture_error e;
    CHECK(pbs_picture_compare(&run, &expected, &got, &e, &err) == PBS_OK);
    CHECK_NUM(e.ssim > 0.999 && e.psnr > 45, e.psnr);
    CHECK(covered(&expected) > 1000 && fabs(covered(&expected) - covered(&got)) < 1e-9);
    /* Without its textures it looks otherwise: it is they that are compared. */
    memset(t[1].texture, 0, sizeof t[1].texture);
    pbs_free(&run, got.rgba);
    got = shot_placed(&f, t, 2, &palette);
    CHECK(pbs_picture_compare(&run, &expected, &got, &e, &err) == PBS_OK);
    CHECK_NUM(e.psnr < 30, e.psnr);
    pbs_free(&run, expected.rgba), pbs_free(&run, got.rgba);
    gl.DeleteBuffers(1, &t[0].buffer);
}

/* Too large a texture loses its finest levels; each level is the mean of the one below it. */
TEST(large_textures_are_reduced) {
    uint8_t texel[64 * 16 * 4], *chain;
    pbs_image image = {64, 16, texel};
    pbs_mips m, whole = {64, 16, true};
    for (size_t i = 0; i < sizeof texel; i++) texel[i] = i % 4 == 3 ? 255 : i / 4 % 2 ? 255 : 0;
    CHECK(pbs_mips_levels(&whole) == 7);
    CHECK(pbs_mips_bytes(&whole) == 4 * (1024 + 256 + 64 + 16 + 4 + 2 + 1));
    must(pbs_mips_make(&run, &image, true, 40, UINT64_MAX, &m, &chain, &err), &err);
    CHECK(m.width == 32 && m.height == 8 && chain[0] == 188 && chain[3] == 255);
    pbs_free(&run, chain);
    must(pbs_mips_make(&run, &image, true, 64, 4 * 90, &m, &chain, &err), &err);
    CHECK(m.width == 16 && m.height == 4);
    pbs_free(&run, chain);
    must(pbs_mips_make(&run, &image, false, 64, 1, &m, &chain, &err), &err);
    CHECK(m.width == 1 && m.height == 1 && chain[0] == 128);
    pbs_free(&run, chain);
    image.rgba = NULL;
    must(pbs_mips_make(&run, &image, false, 64, 1, &m, &chain, &err), &err);
    CHECK(m.width == 0 && !chain && pbs_mips_levels(&m) == 0 && pbs_mips_bytes(&m) == 0);
}

/* Inside of a voxel, in line with its faces, pressed flat, and none at all. */
TEST(odd_places) {
    if (no_gl()) SKIP(err.text);
    const double flat[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0}, nothing[12] = {0};
    const double *m[] = {PBS_IDENTITY, flat, nothing};
    for (int i = 0; i < 3; i++) {
        uint32_t place = PBS_PLACE(0, 0, 0, PBS_FACES_ALL);
        pbs_voxels v = {.count = 1, .place = &place}, empty = {.place = &place};
        pbs_cubes cubes = {
            .chunks = &v, .chunk_count = 1, .corner = {-1, -1, -1}, .side = 2, .m = {0}};
        memcpy(cubes.m, m[i], sizeof cubes.m);
        const char *eyes[] = {"0,0,0,0,0,1", "3,1,0,0,1,0", "1,1,1,0,0,0"};
        for (int e = 0; e < 3; e++) {
            pbs_frame f = {0};
            must(pbs_camera_parse(&f.camera, eyes[e], &err), &err);
            pbs_image image = shot(&f, &cubes, NULL);
            CHECK(e || covered(&image) == 0); /* from inside no face looks at the eye */
            pbs_free(&run, image.rgba);
            cubes.chunks = e ? &empty : &v;
        }
    }
    pbs_canvas_free(canvas);
    pbs_gl_context_free(context);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST_MAIN
