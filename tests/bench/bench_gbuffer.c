/* The G-buffer of a million triangles, eight views of 1024 x 1024, against software GL doing the
 * same job. CPU time of the whole process (user and system), minimum of several runs. */
#include "cmd/pbs-view/draw/gl.h"
#include "libcore/gbuffer/gbuffer.h"
#include "libcore/gbuffer/raster.h"
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>

enum { RUNS = 7, RESOLUTION = 1024 };

static double cpu_ms(void) {
    struct rusage u;
    getrusage(RUSAGE_SELF, &u);
    return 1e3 * (double)(u.ru_utime.tv_sec + u.ru_stime.tv_sec) +
           1e-3 * (double)(u.ru_utime.tv_usec + u.ru_stime.tv_usec);
}

typedef struct scene {
    const char *name;
    pbs_mesh *mesh;
    size_t meshes;
    pbs_draw *draw;
    size_t draws;
    uint64_t triangles;
    pbs_box box;
} scene;

static void *need(void *p) {
    if (!p) abort();
    return p;
}

static void finish(scene *s) {
    s->box = PBS_BOX_EMPTY;
    for (size_t d = 0; d < s->draws; d++) {
        const pbs_mesh *m = s->draw[d].mesh;
        s->triangles += m->triangles;
        for (uint32_t i = 0; i < m->vertices; i++) {
            double p[3] = {m->position[3 * i], m->position[3 * i + 1], m->position[3 * i + 2]};
            pbs_xform_point(p, s->draw[d].m, p);
            pbs_box_add(&s->box, p);
        }
    }
}

static void free_scene(scene *s) {
    for (size_t i = 0; i < s->meshes; i++) {
        free((void *)s->mesh[i].position), free((void *)s->mesh[i].normal);
        free((void *)s->mesh[i].colour), free((void *)s->mesh[i].index);
    }
    free(s->mesh), free(s->draw);
}

/* A lumpy ball, a cube blown up: six faces of 2 x 2 meshes, quads in Morton order. */
typedef struct patch {
    pbs_mesh mesh;
    float *position;
    int16_t *normal;
    uint8_t *colour;
    uint16_t *index;
} patch;

static void blow_up(int face, double u, double v, float out[3]) {
    double c[3], l, r;
    c[face % 3] = face < 3 ? 1 : -1;
    c[(face + 1) % 3] = tan(u * M_PI / 4), c[(face + 2) % 3] = tan(v * M_PI / 4);
    l = sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
    for (int k = 0; k < 3; k++) c[k] /= l;
    r = 1 + 0.08 * sin(9 * c[0]) * sin(11 * c[1] + 1) * sin(10 * c[2] + 2) +
        0.004 * sin(90 * c[0]) * sin(80 * c[1]) * sin(85 * c[2]);
    for (int k = 0; k < 3; k++) out[k] = (float)(c[k] * r);
}

static uint16_t vertex_at(patch *p, uint32_t *number, int face, uint32_t n, uint32_t x, uint32_t y,
                          uint32_t ox, uint32_t oy, uint32_t all) {
    uint32_t *at = &number[y * (n + 1) + x];
    if (*at) return (uint16_t)(*at - 1);
    uint32_t v = p->mesh.vertices++;
    float q[3][3], g[3];
    for (int k = 0; k < 3; k++)
        blow_up(face, 2.0 * (ox + x + 0.1 * (k == 1)) / all - 1,
                2.0 * (oy + y + 0.1 * (k == 2)) / all - 1, q[k]);
    memcpy(p->position + 3 * v, q[0], 12);
    for (int k = 0; k < 3; k++) q[1][k] -= q[0][k], q[2][k] -= q[0][k];
    for (int k = 0; k < 3; k++)
        g[k] = q[1][(k + 1) % 3] * q[2][(k + 2) % 3] - q[1][(k + 2) % 3] * q[2][(k + 1) % 3];
    pbs_oct_encode(p->normal + 2 * v, g);
    for (int k = 0; k < 4; k++) p->colour[4 * v + k] = k < 3 ? (uint8_t)(128 + 100 * q[0][k]) : 255;
    *at = v + 1;
    return (uint16_t)v;
}

static uint32_t every_second_bit(uint32_t i) {
    uint32_t r = 0;
    for (int b = 0; b < 16; b++) r |= (i >> (2 * b) & 1) << b;
    return r;
}

static pbs_mesh make_patch(int face, uint32_t n, uint32_t ox, uint32_t oy, uint32_t all) {
    size_t most = (size_t)(n + 1) * (n + 1), side = 1;
    uint32_t *number = need(calloc(most, 4));
    patch p = {.position = need(malloc(12 * most)),
               .normal = need(malloc(4 * most)),
               .colour = need(malloc(4 * most)),
               .index = need(malloc((size_t)12 * n * n))};
    while (side < n) side *= 2;
    for (uint32_t i = 0; i < side * side; i++) {
        uint32_t x = every_second_bit(i), y = every_second_bit(i >> 1);
        if (x >= n || y >= n) continue;
        uint16_t c[4];
        for (uint32_t k = 0; k < 4; k++)
            c[k] = vertex_at(&p, number, face, n, x + (k & 1), y + (k >> 1), ox, oy, all);
        uint16_t t[6] = {c[0], c[1], c[2], c[1], c[3], c[2]};
        memcpy(p.index + 3 * p.mesh.triangles, t, 12);
        p.mesh.triangles += 2;
    }
    free(number);
    p.mesh.position = p.position, p.mesh.normal = p.normal, p.mesh.colour = p.colour;
    p.mesh.index = p.index, p.mesh.material = PBS_NONE;
    return p.mesh;
}

static scene ball(void) {
    enum { N = 144 };
    scene s = {.name = "ball: 24 meshes", .meshes = 24, .draws = 24};
    s.mesh = need(calloc(24, sizeof *s.mesh)), s.draw = need(calloc(24, sizeof *s.draw));
    for (int i = 0; i < 24; i++) {
        s.mesh[i] = make_patch(i / 4, N, i & 1 ? N : 0, i & 2 ? N : 0, 2 * N);
        s.draw[i].mesh = &s.mesh[i];
        memcpy(s.draw[i].m, PBS_IDENTITY, sizeof s.draw[i].m);
    }
    finish(&s);
    return s;
}

/* A plant: one small part, a capped tube of 48 triangles, placed 20 800 times. */
static scene plant(void) {
    enum { SIDES = 12, DRAWS = 20800 };
    scene s = {.name = "plant: 20800 draws of 48 triangles", .meshes = 1, .draws = DRAWS};
    s.mesh = need(calloc(1, sizeof *s.mesh)), s.draw = need(calloc(DRAWS, sizeof *s.draw));
    float *p = need(malloc(12 * (2 * SIDES + 2)));
    uint8_t *colour = need(malloc(4 * (2 * SIDES + 2)));
    int16_t *normal = need(malloc(4 * (2 * SIDES + 2)));
    uint16_t *t = need(malloc(6 * 4 * SIDES));
    memset(colour, 200, 4 * (2 * SIDES + 2));
    for (uint16_t i = 0; i < 2 * SIDES + 2; i++) {
        double a = 2 * M_PI * (i / 2) / SIDES;
        bool mid = i >= 2 * SIDES;
        float q[3] = {(float)(mid ? 0 : cos(a)), (float)(mid ? 0 : sin(a)), i & 1 ? 1.0f : -1.0f};
        memcpy(p + 3 * i, q, 12);
        pbs_oct_encode(normal + 2 * i, q);
    }
    for (uint16_t i = 0; i < SIDES; i++) {
        uint16_t a = 2 * i, b = 2 * ((i + 1) % SIDES);
        uint16_t q[12] = {a, b,         a + 1, b,     b + 1, a + 1,
                          a, 2 * SIDES, b,     a + 1, b + 1, 2 * SIDES + 1};
        memcpy(t + 12 * i, q, 24);
    }
    s.mesh[0] = (pbs_mesh){.vertices = 2 * SIDES + 2,
                           .triangles = 4 * SIDES,
                           .position = p,
                           .normal = normal,
                           .colour = colour,
                           .index = t,
                           .material = PBS_NONE};
    uint64_t seed = 7;
    for (int d = 0; d < DRAWS; d++) {
        double r[7];
        for (int k = 0; k < 7; k++) {
            seed = seed * 6364136223846793005u + 1442695040888963407u;
            r[k] = (double)(seed >> 11) * 0x1p-53;
        }
        double thick = 0.002 + 0.02 * r[0] * r[0], length = 0.01 + 0.2 * r[1] * r[1] * r[1];
        double *m = s.draw[d].m, c = cos(7 * r[2]), w = sin(7 * r[2]);
        int k = (int)(3 * r[3]), k1 = (k + 1) % 3, k2 = (k + 2) % 3;
        m[4 * k + 2] = length, m[4 * k1] = c * thick, m[4 * k1 + 1] = -w * thick;
        m[4 * k2] = w * thick, m[4 * k2 + 1] = c * thick;
        for (int i = 0; i < 3; i++) m[4 * i + 3] = r[4 + i];
        s.draw[d].mesh = s.mesh;
    }
    finish(&s);
    return s;
}

static pbs_code ignore(void *ctx, const pbs_gbuffer_view *view, pbs_err *err) {
    (void)ctx, (void)view, (void)err;
    return PBS_OK;
}

static void must(pbs_code rc, const pbs_err *err) {
    if (!rc) return;
    printf("bench_gbuffer: %s\n", err->text);
    exit(70);
}

/* A scene as one node, with everything that belongs to it. */
static void draw(const scene *s, uint32_t resolution, uint32_t channels, int threads,
                 pbs_code (*sink)(void *, const pbs_gbuffer_view *, pbs_err *), void *ctx,
                 pbs_gbuffer_stats *stats) {
    pbs_run run = {.threads = threads};
    pbs_err err;
    pbs_surfaces *surfaces;
    pbs_gbuffers *g;
    pbs_gbuffer_params params = {.resolution = resolution, .channels = channels, .box = s->box};
    must(pbs_surfaces_new(&run, NULL, 0, NULL, 0, channels, &surfaces, &err), &err);
    must(pbs_gbuffers_new(&run, surfaces, threads, &g, &err), &err);
    must(pbs_gbuffer(g, s->draw, s->draws, &params, sink, ctx, stats, &err), &err);
    pbs_gbuffers_free(g);
    pbs_surfaces_free(&run, surfaces);
}

/* Transform and drawing only, by the parts that pbs_gbuffer is made of. */
static double raster_only(const scene *s, double pixel, double *snap_ms) {
    double start = cpu_ms();
    uint32_t vertices = 0;
    for (size_t d = 0; d < s->draws; d++)
        vertices = s->draw[d].mesh->vertices > vertices ? s->draw[d].mesh->vertices : vertices;
    pbs_snapped *v = need(aligned_alloc(64, (sizeof *v * vertices + 63) / 64 * 64));
    uint64_t *key = need(malloc((2 * RESOLUTION * RESOLUTION + PBS_KEY_PAD) * sizeof *key));
    for (int only_snap = 1; only_snap >= 0; only_snap--) {
        start = cpu_ms();
        for (int i = 0; i < 4; i++) {
            pbs_pair pair = {.pixel = pixel, .depth = 4, .width = RESOLUTION, .height = RESOLUTION};
            const double *n = PBS_GBUFFER_CORNERS[i];
            double l = sqrt(3), q = sqrt(n[0] * n[0] + n[2] * n[2]);
            for (int k = 0; k < 3; k++) pair.toward[k] = n[k] / l;
            pair.right[0] = n[2] / q, pair.right[2] = -n[0] / q;
            for (int k = 0; k < 3; k++)
                pair.up[k] = pair.toward[(k + 1) % 3] * pair.right[(k + 2) % 3] -
                             pair.toward[(k + 2) % 3] * pair.right[(k + 1) % 3];
            for (int k = 0; k < 3; k++) pair.centre[k] = (s->box.min[k] + s->box.max[k]) / 2;
            pbs_raster r = {
                .key = key, .width = RESOLUTION, .y1 = RESOLUTION, .simd = pbs_raster_simd()};
            if (!only_snap) pbs_raster_clear(&r);
            uint32_t first = 0;
            for (size_t d = 0; d < s->draws; d++) {
                const pbs_mesh *mesh = s->draw[d].mesh;
                double m[12];
                int32_t box[4];
                pbs_pair_project(m, &pair, s->draw[d].m);
                bool ok = pbs_raster_snap(m, mesh->position, mesh->vertices, r.simd, v, box);
                if (!only_snap && pbs_raster_sees(&r, box))
                    pbs_raster_draw(&r, v, mesh->index, mesh->triangles, first, ok);
                first += mesh->triangles;
            }
        }
        if (only_snap) *snap_ms = cpu_ms() - start;
    }
    double ms = cpu_ms() - start;
    free(v), free(key);
    return ms - *snap_ms;
}

static double ours(const scene *s, uint32_t channels, int threads, pbs_gbuffer_stats *stats) {
    double best = 1e30;
    for (int i = 0; i < RUNS; i++) {
        double start = cpu_ms();
        draw(s, RESOLUTION, channels, threads, ignore, NULL, stats);
        double ms = cpu_ms() - start;
        best = ms < best ? ms : best;
    }
    return best;
}

/* ---- the same by software GL ---- */

static const char vertex_glsl[] =
    "#version 450\n"
    "layout(location = 0) in vec3 position;\n"
    "layout(location = 1) in vec2 normal;\n"
    "layout(location = 2) in vec4 colour;\n"
    "layout(location = 3) in vec4 row[3];\n"
    "uniform vec4 view[3];\n"
    "out vec3 p;\n"
    "out vec3 n;\n"
    "out vec4 c;\n"
    "void main() {\n"
    "    vec4 q = vec4(position, 1);\n"
    "    p = vec3(dot(row[0], q), dot(row[1], q), dot(row[2], q));\n"
    "    vec3 o = vec3(normal, 1 - abs(normal.x) - abs(normal.y));\n"
    "    float t = max(-o.z, 0);\n"
    "    o.xy += mix(vec2(t), vec2(-t), greaterThanEqual(o.xy, vec2(0)));\n"
    "    n = transpose(inverse(mat3(row[0].xyz, row[1].xyz, row[2].xyz))) * normalize(o);\n"
    "    c = colour;\n"
    "    gl_Position = vec4(dot(view[0], vec4(p, 1)), dot(view[1], vec4(p, 1)),\n"
    "                       dot(view[2], vec4(p, 1)), 1);\n"
    "}\n";
static const char fragment_glsl[] = "#version 450\n"
                                    "in vec3 p;\n"
                                    "in vec3 n;\n"
                                    "in vec4 c;\n"
                                    "uniform vec3 toward;\n"
                                    "layout(location = 0) out vec4 out_p;\n"
                                    "layout(location = 1) out vec4 out_n;\n"
                                    "layout(location = 2) out vec4 out_c;\n"
                                    "void main() {\n"
                                    "    vec3 m = normalize(n);\n"
                                    "    out_p = vec4(p, 1);\n"
                                    "    out_n = vec4(dot(m, toward) < 0 ? -m : m, 0);\n"
                                    "    out_c = c;\n"
                                    "}\n";

typedef struct reference {
    pbs_gl gl;
    pbs_gl_context *context;
    GLuint program, array, buffer[5], frame, target[4];
    GLint view, toward;
    const scene *s;
    float *plane[3]; /* RGBA of a view: position and coverage, normal, colour */
} reference;

static GLuint upload(const pbs_gl *gl, const void *data, size_t bytes) {
    GLuint b;
    gl->CreateBuffers(1, &b);
    gl->NamedBufferStorage(b, (GLsizeiptr)bytes, data, 0);
    return b;
}

/* All meshes one after the other in four buffers, and a row of matrices. */
static void upload_scene(reference *r) {
    const scene *s = r->s;
    size_t v = 0, t = 0;
    for (size_t i = 0; i < s->meshes; i++) v += s->mesh[i].vertices, t += s->mesh[i].triangles;
    float *position = need(malloc(12 * v)), *matrix = need(malloc(48 * s->draws));
    int16_t *normal = need(malloc(4 * v));
    uint8_t *colour = need(malloc(4 * v));
    uint16_t *index = need(malloc(6 * t));
    v = t = 0;
    for (size_t i = 0; i < s->meshes; i++) {
        const pbs_mesh *m = &s->mesh[i];
        memcpy(position + 3 * v, m->position, (size_t)12 * m->vertices);
        memcpy(normal + 2 * v, m->normal, (size_t)4 * m->vertices);
        memcpy(colour + 4 * v, m->colour, (size_t)4 * m->vertices);
        memcpy(index + 3 * t, m->index, (size_t)6 * m->triangles);
        v += m->vertices, t += m->triangles;
    }
    for (size_t i = 0; i < 12 * s->draws; i++) matrix[i] = (float)s->draw[i / 12].m[i % 12];
    const void *data[5] = {position, normal, colour, matrix, index};
    size_t bytes[5] = {12 * v, 4 * v, 4 * v, 48 * s->draws, 6 * t};
    for (int i = 0; i < 5; i++) r->buffer[i] = upload(&r->gl, data[i], bytes[i]);
    free(position), free(normal), free(colour), free(index), free(matrix);
}

static void describe_vertices(reference *r) {
    const pbs_gl *gl = &r->gl;
    const GLsizei stride[4] = {12, 4, 4, 48};
    gl->CreateVertexArrays(1, &r->array);
    for (GLuint i = 0; i < 4; i++)
        gl->VertexArrayVertexBuffer(r->array, i, r->buffer[i], 0, stride[i]);
    gl->VertexArrayElementBuffer(r->array, r->buffer[4]);
    gl->VertexArrayAttribFormat(r->array, 0, 3, GL_FLOAT, 0, 0);
    gl->VertexArrayAttribFormat(r->array, 1, 2, GL_SHORT, 1, 0);
    gl->VertexArrayAttribFormat(r->array, 2, 4, GL_UNSIGNED_BYTE, 1, 0);
    for (GLuint i = 0; i < 6; i++) {
        if (i > 2) gl->VertexArrayAttribFormat(r->array, i, 4, GL_FLOAT, 0, 16 * (i - 3));
        gl->VertexArrayAttribBinding(r->array, i, i < 3 ? i : 3);
        gl->EnableVertexArrayAttrib(r->array, i);
    }
    gl->VertexArrayBindingDivisor(r->array, 3, 1);
}

static bool start(reference *r, const scene *s, pbs_err *err) {
    r->s = s;
    if (pbs_gl_context_new("sw", &r->context, &r->gl, err)) return false;
    const pbs_gl *gl = &r->gl;
    const pbs_gl_stage stage[2] = {{GL_VERTEX_SHADER, {vertex_glsl}},
                                   {GL_FRAGMENT_SHADER, {fragment_glsl}}};
    if (pbs_gl_program(gl, "gbuffer", stage, 2, &r->program, err)) return false;
    r->view = gl->GetUniformLocation(r->program, "view");
    r->toward = gl->GetUniformLocation(r->program, "toward");
    upload_scene(r);
    describe_vertices(r);
    gl->CreateFramebuffers(1, &r->frame);
    gl->CreateTextures(GL_TEXTURE_2D, 4, r->target);
    GLenum colours[3];
    for (GLuint i = 0; i < 4; i++) {
        GLenum at = i < 3 ? GL_COLOR_ATTACHMENT0 + i : GL_DEPTH_ATTACHMENT;
        gl->TextureStorage2D(r->target[i], 1, i < 3 ? GL_RGBA32F : GL_DEPTH_COMPONENT32F,
                             RESOLUTION, RESOLUTION);
        gl->NamedFramebufferTexture(r->frame, at, r->target[i], 0);
        if (i < 3) colours[i] = at, r->plane[i] = need(malloc(16 * RESOLUTION * RESOLUTION));
    }
    gl->NamedFramebufferDrawBuffers(r->frame, 3, colours);
    return pbs_gl_check(gl, "setting up", err) == PBS_OK;
}

static void stop(reference *r) {
    for (int i = 0; i < 3; i++) free(r->plane[i]);
    pbs_gl_context_free(r->context);
}

/* Draws one view and reads its planes. */
static void draw_gl(reference *r, const pbs_gbuffer_view *v) {
    const pbs_gl *gl = &r->gl;
    const double *axis[3] = {v->right, v->up, v->toward};
    double scale[3] = {2 / (v->pixel * v->width), 2 / (v->pixel * v->height), -0.5};
    float row[3][4], toward[3];
    for (int i = 0; i < 3; i++) {
        double t = 0;
        for (int k = 0; k < 3; k++) {
            row[i][k] = (float)(axis[i][k] * scale[i]);
            t -= axis[i][k] * scale[i] * (r->s->box.min[k] + r->s->box.max[k]) / 2;
            toward[k] = (float)v->toward[k];
        }
        row[i][3] = (float)t;
    }
    gl->BindFramebuffer(GL_FRAMEBUFFER, r->frame);
    gl->Viewport(0, 0, (GLsizei)v->width, (GLsizei)v->height);
    gl->Enable(GL_DEPTH_TEST);
    const float zero[4] = {0, 0, 0, 0}, far = 1;
    for (GLint i = 0; i < 3; i++) gl->ClearNamedFramebufferfv(r->frame, GL_COLOR, i, zero);
    gl->ClearNamedFramebufferfv(r->frame, GL_DEPTH, 0, &far);
    gl->UseProgram(r->program);
    gl->Uniform4fv(r->view, 3, row[0]);
    gl->Uniform3fv(r->toward, 1, toward);
    gl->BindVertexArray(r->array);
    size_t vertex = 0, index = 0;
    for (size_t m = 0, d = 0; m < r->s->meshes; m++) {
        const pbs_mesh *mesh = &r->s->mesh[m];
        size_t from = d;
        while (d < r->s->draws && r->s->draw[d].mesh == mesh) d++;
        gl->DrawElementsInstancedBaseVertexBaseInstance(
            GL_TRIANGLES, (GLsizei)(3 * mesh->triangles), GL_UNSIGNED_SHORT, (void *)(6 * index),
            (GLsizei)(d - from), (GLint)vertex, (GLuint)from);
        vertex += mesh->vertices, index += mesh->triangles;
    }
    for (GLenum i = 0; i < 3; i++) {
        gl->NamedFramebufferReadBuffer(r->frame, GL_COLOR_ATTACHMENT0 + i);
        gl->ReadPixels(0, 0, (GLsizei)v->width, (GLsizei)v->height, GL_RGBA, GL_FLOAT, r->plane[i]);
    }
}

/* ---- do they agree? ---- */

typedef struct agreement {
    reference *r;
    size_t covered, only_one, elsewhere;
    pbs_gbuffer_view view[8]; /* without points */
} agreement;

static pbs_code agree(void *ctx, const pbs_gbuffer_view *v, pbs_err *err) {
    agreement *a = ctx;
    size_t next = 0;
    (void)err;
    a->view[v->view] = *v;
    draw_gl(a->r, v);
    for (size_t i = 0; i < (size_t)v->width * v->height; i++) {
        const float *p = a->r->plane[0] + 4 * i;
        bool theirs = p[3] > 0, mine = next < v->points.count && v->where[next] == i;
        const float *q = v->points.position + 3 * next;
        double far = 0;
        next += mine;
        a->covered += mine;
        a->only_one += mine != theirs;
        if (!mine || !theirs) continue;
        for (int k = 0; k < 3; k++) far += ((double)p[k] - q[k]) * ((double)p[k] - q[k]);
        a->elsewhere += far > v->pixel * v->pixel;
    }
    return PBS_OK;
}

static void compare(const scene *s, double mine) {
    reference r = {0};
    agreement a = {.r = &r};
    pbs_err err = {0};
    double best = 1e30;
    if (!start(&r, s, &err)) {
        printf("  software GL left out: %s\n", err.text);
    } else {
        draw(s, RESOLUTION, 0, 1, agree, &a, NULL);
        for (int i = 0; i < 3; i++) {
            double from = cpu_ms();
            for (int v = 0; v < 8; v++) draw_gl(&r, &a.view[v]);
            r.gl.Finish();
            best = cpu_ms() - from < best ? cpu_ms() - from : best;
        }
        printf("  %s: %.0f ms CPU, %.1f times as much\n", r.gl.device, best, best / mine);
        printf("  of %zu pixels covered, %zu by one of the two only, %zu over a pixel apart\n",
               a.covered, a.only_one, a.elsewhere);
    }
    stop(&r);
}

static void bench(const scene *s) {
    pbs_gbuffer_stats st;
    double full = ours(s, PBS_NORMAL | PBS_COLOUR, 1, &st),
           two = ours(s, PBS_NORMAL | PBS_COLOUR, 2, &st);
    double bare = ours(s, 0, 1, &st), snap = 1e30, raster = 1e30;
    for (int i = 0; i < RUNS; i++) {
        double a = 0, b = raster_only(s, st.pixel, &a);
        snap = a < snap ? a : snap, raster = b < raster ? b : raster;
    }
    printf("%s, %.2f M triangles, 8 views of %d: %.0f ms CPU (%.0f with 2 threads)\n", s->name,
           1e-6 * (double)s->triangles, RESOLUTION, full, two);
    printf("  transform %.0f ms, drawing %.0f ms, resolve %.0f ms with normals and colours, %.0f "
           "without\n",
           snap, raster, full - snap - raster, bare - snap - raster);
    printf("  %.2f M candidates, %.2f M fragments; %.1f M triangles a second and core, a view\n",
           1e-6 * (double)st.candidates, 1e-6 * (double)st.fragments,
           8e-3 * (double)s->triangles / full);
    if (getenv("NOGL") == NULL) compare(s, full);
}

/* One of the many small nodes of a hierarchy: 200 triangles, drawn again and again with the same
 * buffers, and the price of the call without its pixels. */
static double small_us(const pbs_mesh *mesh, uint32_t resolution, int threads,
                       pbs_gbuffer_stats *stats) {
    enum { CALLS = 1000 };
    pbs_run run = {.threads = threads};
    pbs_err err;
    pbs_surfaces *surfaces;
    pbs_gbuffers *g;
    pbs_draw d = {.mesh = mesh};
    scene s = {.draw = &d, .draws = 1};
    double best = 1e30;
    memcpy(d.m, PBS_IDENTITY, sizeof d.m);
    finish(&s);
    pbs_gbuffer_params params = {
        .resolution = resolution, .channels = PBS_NORMAL | PBS_COLOUR, .box = s.box};
    must(pbs_surfaces_new(&run, NULL, 0, NULL, 0, params.channels, &surfaces, &err), &err);
    must(pbs_gbuffers_new(&run, surfaces, threads, &g, &err), &err);
    for (int i = 0; i < RUNS; i++) {
        double start = cpu_ms();
        for (int k = 0; k < CALLS; k++)
            must(pbs_gbuffer(g, &d, 1, &params, ignore, NULL, stats, &err), &err);
        double us = 1e3 * (cpu_ms() - start) / CALLS;
        best = us < best ? us : best;
    }
    pbs_gbuffers_free(g);
    pbs_surfaces_free(&run, surfaces);
    return best;
}

static void bench_small(void) {
    pbs_mesh mesh = make_patch(0, 10, 0, 0, 10);
    pbs_gbuffer_stats st, none;
    double full = small_us(&mesh, 71, 1, &st), two = small_us(&mesh, 71, 2, &none);
    double bare = small_us(&mesh, 1, 1, &none);
    printf("small node, %u triangles, 8 views of 71: %.0f us CPU (%.0f with 2 threads), %.0f ns a "
           "candidate; of one pixel: %.1f us\n",
           mesh.triangles, full, two, 1e3 * (full - bare) / (double)st.candidates, bare);
    free((void *)mesh.position), free((void *)mesh.normal);
    free((void *)mesh.colour), free((void *)mesh.index);
}

/* An argument picks one scene: 0, 1. With NOGL in the environment GL is left out. */
int main(int argc, char **argv) {
    scene s[2] = {ball(), plant()};
    int only = argc > 1 ? atoi(argv[1]) : -1;
    for (int i = 0; i < 2; i++) {
        if (only >= 0 && only != i) continue;
        bench(&s[i]);
        free_scene(&s[i]);
    }
    bench_small();
    return 0;
}
