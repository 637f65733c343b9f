/* draw.c: the canvas, its target, and discs. Triangles are in draw_mesh.c, cubes in draw_voxel.c.
 */
#include "cmd/pbs-view/draw_internal.h"
#include "libcore/average.h"
#include "shaders.h"

/* A disc's picture has at least this half axis in pixels: it holds a pixel's centre wherever it
 * lies. */
#define LEAST_HALF_AXIS 0.70710678f

uint32_t pbs_surfel_size(uint32_t channels) {
    uint32_t size = 8;
    for (uint32_t c = PBS_NORMAL; c <= PBS_EMISSIVE; c <<= 1) size += channels & c ? 4 : 0;
    return size;
}

/* In words, as the shader wants it; -1: absent. */
static GLint field_word(uint32_t channels, uint32_t channel) {
    return channels & channel ? (GLint)(pbs_surfel_size(channels & (channel - 1)) / 4) : -1;
}

static pbs_code build_programs(pbs_canvas *c, pbs_err *err) {
    const pbs_gl_stage disc[2] = {
        {GL_VERTEX_SHADER, {PBS_GLSL_VERSION, shade_glsl, disc_vert_glsl}},
        {GL_FRAGMENT_SHADER, {PBS_GLSL_VERSION, shade_glsl, disc_frag_glsl}},
    };
    const pbs_gl_stage mesh[2] = {
        {GL_VERTEX_SHADER, {PBS_GLSL_VERSION, shade_glsl, mesh_vert_glsl}},
        {GL_FRAGMENT_SHADER, {PBS_GLSL_VERSION, shade_glsl, mesh_frag_glsl}},
    };
    pbs_code code = pbs_gl_program(c->gl, "disc", disc, 2, &c->disc, err);
    return code ? code : pbs_gl_program(c->gl, "mesh", mesh, 2, &c->mesh.program, err);
}

/* A framebuffer with a colour and, if wanted, a depth buffer. */
static pbs_code build_target(pbs_canvas *c, target *t, int samples, bool depth, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    GLsizei w = (GLsizei)c->width, h = (GLsizei)c->height, s = samples > 1 ? samples : 0;
    gl->CreateFramebuffers(1, &t->frame);
    gl->CreateRenderbuffers(1, &t->colour);
    gl->NamedRenderbufferStorageMultisample(t->colour, s, GL_SRGB8_ALPHA8, w, h);
    gl->NamedFramebufferRenderbuffer(t->frame, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, t->colour);
    if (depth) {
        gl->CreateRenderbuffers(1, &t->depth);
        gl->NamedRenderbufferStorageMultisample(t->depth, s, GL_DEPTH_COMPONENT32F, w, h);
        gl->NamedFramebufferRenderbuffer(t->frame, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, t->depth);
    }
    pbs_code code = pbs_gl_check(gl, "canvas", err);
    if (code) return code;
    GLenum status = gl->CheckNamedFramebufferStatus(t->frame, GL_DRAW_FRAMEBUFFER);
    if (status == GL_FRAMEBUFFER_COMPLETE) return PBS_OK;
    return pbs_fail(err, PBS_LIMIT, "picture of %u x %u pixels: %s refuses it (framebuffer 0x%04x)",
                    c->width, c->height, gl->device, status);
}

static void free_target(const pbs_gl *gl, target *t) {
    gl->DeleteFramebuffers(1, &t->frame);
    gl->DeleteRenderbuffers(1, &t->colour);
    gl->DeleteRenderbuffers(1, &t->depth);
}

static pbs_code check_size(pbs_canvas *c, const pbs_canvas_desc *desc, pbs_err *err) {
    uint32_t largest = (uint32_t)c->gl->max_texture;
    int most = c->gl->max_samples < 4 ? c->gl->max_samples : 4;
    c->width = desc->width ? desc->width : 1024;
    c->height = desc->height ? desc->height : 1024;
    c->samples = desc->samples > 0 && desc->samples < most ? desc->samples : most;
    if (c->samples < 1) c->samples = 1;
    if (c->width > largest || c->height > largest)
        return pbs_fail(err, PBS_LIMIT, "picture of %u x %u pixels: %s draws up to %u x %u",
                        c->width, c->height, c->gl->device, largest, largest);
    size_t pixels = (size_t)c->width * c->height;
    c->counted = pixels * (8 * (size_t)c->samples + (c->samples > 1 ? 4 : 0)) + PBS_CANVAS_STREAM;
    pbs_code code = pbs_mem_take(c->run, c->counted, "the canvas", err);
    if (code) c->counted = 0;
    return code;
}

static pbs_code build(pbs_canvas *c, const pbs_canvas_desc *desc, pbs_err *err) {
    pbs_code code = check_size(c, desc, err);
    if (!code) code = build_programs(c, err);
    if (!code) code = build_target(c, &c->draw, c->samples, true, err);
    if (!code && c->samples > 1) code = build_target(c, &c->resolved, 1, false, err);
    if (code) return code;
    c->gl->CreateBuffers(1, &c->stream);
    c->gl->CreateVertexArrays(1, &c->no_vertices);
    c->stream_at = PBS_CANVAS_STREAM; /* full: the first upload makes room */
    pbs_mesh_painter_init(c);
    return pbs_gl_check(c->gl, "canvas", err);
}

pbs_code pbs_canvas_new(pbs_run *run, const pbs_gl *gl, const pbs_canvas_desc *desc,
                        pbs_canvas **out, pbs_err *err) {
    pbs_canvas *c;
    *out = NULL;
    pbs_code code = pbs_alloc(run, &c, 1, sizeof *c, "the canvas", err);
    if (code) return code;
    memset(c, 0, sizeof *c);
    c->run = run;
    c->gl = gl;
    code = build(c, desc, err);
    if (code)
        pbs_canvas_free(c);
    else
        *out = c;
    return code;
}

void pbs_canvas_free(pbs_canvas *c) {
    if (!c) return;
    const pbs_gl *gl = c->gl;
    pbs_mesh_painter_free(c);
    pbs_voxel_painter_free(c);
    pbs_retained_free(c);
    free_target(gl, &c->draw);
    free_target(gl, &c->resolved);
    gl->DeleteProgram(c->disc);
    gl->DeleteBuffers(1, &c->stream);
    gl->DeleteVertexArrays(1, &c->no_vertices);
    pbs_mem_give(c->run, c->counted);
    pbs_free(c->run, c);
}

pbs_code pbs_canvas_begin(pbs_canvas *c, const pbs_frame *frame, pbs_err *err) {
    static const uint8_t light_grey[4] = {238, 240, 242, 255};
    const uint8_t *background = frame->background[3] ? frame->background : light_grey;
    const pbs_gl *gl = c->gl;
    float clear[4] = {0}, farthest = 0;
    for (int k = 0; k < 3; k++) clear[k] = pbs_srgb_to_linear(background[k] / 255.0f);
    c->camera = frame->camera;
    c->aspect = (double)c->width / c->height;
    gl->BindFramebuffer(GL_FRAMEBUFFER, c->draw.frame);
    gl->Viewport(0, 0, (GLsizei)c->width, (GLsizei)c->height);
    /* The top row first in memory, and depth from 1 at the near plane to 0 at infinity. */
    gl->ClipControl(GL_UPPER_LEFT, GL_ZERO_TO_ONE);
    gl->DepthFunc(GL_GREATER);
    gl->DepthMask(GL_TRUE);
    gl->Enable(GL_DEPTH_TEST);
    gl->Enable(GL_FRAMEBUFFER_SRGB);
    gl->Enable(GL_MULTISAMPLE);
    gl->Disable(GL_CULL_FACE);
    gl->Disable(GL_BLEND);
    gl->ClearNamedFramebufferfv(c->draw.frame, GL_COLOR, 0, clear);
    gl->ClearNamedFramebufferfv(c->draw.frame, GL_DEPTH, 0, &farthest);
    return pbs_gl_check(gl, "clear", err);
}

void pbs_canvas_view_uniforms(const pbs_canvas *c, GLuint program) {
    const pbs_gl *gl = c->gl;
    const pbs_camera *v = &c->camera;
    float sky[3];
    const double *axis[3] = {v->right, v->up, v->back}, *up = v->world_up;
    for (int k = 0; k < 3; k++)
        sky[k] = (float)(axis[k][0] * up[0] + axis[k][1] * up[1] + axis[k][2] * up[2]);
    gl->UseProgram(program);
    gl->Uniform3fv(gl->GetUniformLocation(program, "sky"), 1, sky);
    gl->Uniform3f(gl->GetUniformLocation(program, "project"),
                  (float)(1 / (v->tan_half * c->aspect)), (float)(1 / v->tan_half),
                  (float)PBS_CAMERA_NEAR);
}

void pbs_canvas_matrix(const pbs_gl *gl, GLint place, int columns, const double *m, double scale) {
    float f[12];
    for (int i = 0; i < 3 * columns; i++) f[i] = (float)(m[i] * scale);
    if (columns == 4)
        gl->UniformMatrix4x3fv(place, 1, GL_TRUE, f);
    else
        gl->UniformMatrix3fv(place, 1, GL_TRUE, f);
}

/* Cofactors of the linear part, scaled so that the largest is 1: float holds no squares of
 * 10^-30. */
void pbs_canvas_normal_matrix(const pbs_gl *gl, GLint place, const double m[12]) {
    double unit[12], cofactor[9], largest = 0;
    for (int i = 0; i < 12; i++)
        if (i % 4 < 3) largest = fmax(largest, fabs(m[i]));
    for (int i = 0; i < 12; i++) unit[i] = largest > 0 ? m[i] / largest : m[i];
    pbs_xform_cofactor(cofactor, unit);
    largest = 0;
    for (int i = 0; i < 9; i++) largest = fmax(largest, fabs(cofactor[i]));
    pbs_canvas_matrix(gl, place, 3, cofactor, largest > 0 ? 1 / largest : 1);
}

static void place_node(const pbs_canvas *c, const pbs_surfels *node) {
    static const double unset[12];
    const pbs_gl *gl = c->gl;
    const double *m = memcmp(node->m, unset, sizeof unset) ? node->m : PBS_IDENTITY;
    double view[12], linear[9];
    double lattice[12] = {node->step, 0,          0,          node->corner[0],
                          0,          node->step, 0,          node->corner[1],
                          0,          0,          node->step, node->corner[2]};
    pbs_camera_place(view, &c->camera, m);
    for (int i = 0; i < 9; i++) linear[i] = view[4 * (i / 3) + i % 3];
    double radius = node->radius > 0 && isfinite(node->radius) ? node->radius : 0;
    pbs_canvas_normal_matrix(gl, gl->GetUniformLocation(c->disc, "to_view_normal"), view);
    pbs_canvas_matrix(gl, gl->GetUniformLocation(c->disc, "disc_to_view"), 3, linear, radius);
    /* In this order the corner, far from the origin as it may be, is added in double. */
    pbs_xform_mul(lattice, m, lattice);
    pbs_camera_place(view, &c->camera, lattice);
    pbs_canvas_matrix(gl, gl->GetUniformLocation(c->disc, "to_view"), 4, view, 1);
}

void pbs_canvas_room(pbs_canvas *c, size_t size) {
    if (size <= PBS_CANVAS_STREAM - c->stream_at) return;
    c->gl->NamedBufferData(c->stream, PBS_CANVAS_STREAM, NULL, GL_STREAM_DRAW);
    c->stream_at = 0;
}

GLuint pbs_canvas_upload(pbs_canvas *c, const void *bytes, size_t size) {
    size_t at = c->stream_at;
    if (size) c->gl->NamedBufferSubData(c->stream, (GLintptr)at, (GLsizeiptr)size, bytes);
    c->stream_at += size;
    return (GLuint)(at / 4);
}

/* Where the looks of surfels come from: normal, colour, material, emission. */
typedef struct looks {
    const uint8_t *first; /* NULL: none */
    uint32_t stride, count;
} looks;

static looks octave_of(const pbs_surfels *node, int octave) {
    uint32_t size = pbs_surfel_size(node->channels) - 8;
    if (!node->octaves || !octave || octave > pbs_octaves(node->whole)) return (looks){NULL, 0, 0};
    return (looks){(const uint8_t *)node->octaves + pbs_octave_begin(node->whole, octave) * size,
                   size, (uint32_t)pbs_octave_length(node->whole, octave)};
}

static void set_fields(const pbs_gl *gl, GLint place, uint32_t channels, bool entries) {
    GLint field[4];
    for (int k = 0; k < 4; k++) {
        field[k] = field_word(channels, (uint32_t)PBS_NORMAL << k);
        if (field[k] >= 0 && entries) field[k] -= 2; /* no position, no spacing */
    }
    gl->Uniform4i(place, field[0], field[1], field[2], field[3]);
}

/* Surfels done .. done + n - 1. */
static void draw_some(pbs_canvas *c, const pbs_surfels *node, uint32_t stride, const looks *fine,
                      const looks *coarse, uint32_t done, uint32_t n) {
    const pbs_gl *gl = c->gl;
    uint32_t blended = coarse->count > done ? coarse->count - done : 0;
    blended = blended < n ? blended : n;
    pbs_canvas_room(c, (size_t)n * (stride + fine->stride) + (size_t)blended * coarse->stride);
    GLuint first = pbs_canvas_upload(c, (const uint8_t *)node->records + (size_t)done * stride,
                                     (size_t)n * stride);
    GLuint look = first;
    if (fine->first)
        look = pbs_canvas_upload(c, fine->first + (size_t)done * fine->stride,
                                 (size_t)n * fine->stride);
    gl->Uniform1ui(gl->GetUniformLocation(c->disc, "first"), first);
    gl->Uniform2ui(gl->GetUniformLocation(c->disc, "fine"), look,
                   (fine->first ? fine->stride : stride) / 4);
    look = blended ? pbs_canvas_upload(c, coarse->first + (size_t)done * coarse->stride,
                                       (size_t)blended * coarse->stride)
                   : 0;
    gl->Uniform3ui(gl->GetUniformLocation(c->disc, "coarse"), look, coarse->stride / 4, blended);
    gl->DrawArrays(GL_TRIANGLES, 0, (GLsizei)(3 * n));
}

static pbs_code draw_node(pbs_canvas *c, const pbs_surfels *node, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    uint32_t size = pbs_surfel_size(node->channels), stride = node->stride ? node->stride : size;
    if (stride < size || stride % 4 || stride > PBS_CANVAS_STREAM / 4)
        return pbs_fail(err, PBS_INTERNAL, "surfel records of %u bytes, stride %u", size, stride);
    int k = node->octaves ? pbs_octave_of(node->whole, node->prefix) : 0;
    looks fine = octave_of(node, k), coarse = octave_of(node, k + 1);
    double between = coarse.first ? log2((double)node->whole / node->prefix) / 2 - k : 0;
    place_node(c, node);
    gl->Uniform1ui(gl->GetUniformLocation(c->disc, "stride"), stride / 4);
    gl->Uniform1f(gl->GetUniformLocation(c->disc, "blend"), (float)fmin(1, fmax(0, between)));
    set_fields(gl, gl->GetUniformLocation(c->disc, "fine_field"), node->channels, fine.first);
    set_fields(gl, gl->GetUniformLocation(c->disc, "coarse_field"), node->channels, true);
    uint32_t most = PBS_CANVAS_STREAM / (stride + fine.stride + coarse.stride);
    for (uint32_t done = 0, n; done < node->prefix; done += n) {
        n = node->prefix - done < most ? node->prefix - done : most;
        pbs_code code = pbs_run_check(c->run, err);
        if (code) return code;
        draw_some(c, node, stride, &fine, &coarse, done, n);
    }
    return PBS_OK;
}

pbs_code pbs_canvas_surfels(pbs_canvas *c, const pbs_surfels *nodes, size_t count, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    pbs_canvas_view_uniforms(c, c->disc);
    gl->Uniform1f(gl->GetUniformLocation(c->disc, "smallest"),
                  LEAST_HALF_AXIS * (float)pbs_camera_pixel(&c->camera, c->height));
    gl->Uniform1i(gl->GetUniformLocation(c->disc, "samples"), c->samples);
    gl->BindVertexArray(c->no_vertices);
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, c->stream);
    for (size_t i = 0; i < count; i++) {
        pbs_code code = draw_node(c, &nodes[i], err);
        if (code) return code;
    }
    return pbs_gl_check(gl, "surfels", err);
}

/* The framebuffer that holds one sample a pixel. */
static GLuint resolve(pbs_canvas *c) {
    GLint w = (GLint)c->width, h = (GLint)c->height;
    if (c->samples < 2) return c->draw.frame;
    c->gl->BlitNamedFramebuffer(c->draw.frame, c->resolved.frame, 0, 0, w, h, 0, 0, w, h,
                                GL_COLOR_BUFFER_BIT, GL_NEAREST);
    return c->resolved.frame;
}

pbs_code pbs_canvas_present(pbs_canvas *c, pbs_err *err) {
    GLint w = (GLint)c->width, h = (GLint)c->height;
    /* The window's first row is the lowest. */
    c->gl->BlitNamedFramebuffer(resolve(c), 0, 0, 0, w, h, 0, h, w, 0, GL_COLOR_BUFFER_BIT,
                                GL_NEAREST);
    return pbs_gl_check(c->gl, "showing the picture", err);
}

pbs_code pbs_canvas_end(pbs_canvas *c, pbs_image *out, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    GLint w = (GLint)c->width, h = (GLint)c->height;
    *out = (pbs_image){c->width, c->height, NULL};
    pbs_code code =
        pbs_alloc(c->run, &out->rgba, (size_t)c->width * c->height, 4, "the picture", err);
    if (code) return code;
    gl->BindFramebuffer(GL_READ_FRAMEBUFFER, resolve(c));
    gl->PixelStorei(GL_PACK_ALIGNMENT, 4);
    gl->ReadPixels(0, 0, w, h, GL_RGBA, GL_UNSIGNED_BYTE, out->rgba);
    code = pbs_gl_check(gl, "reading the picture", err);
    if (code) {
        pbs_free(c->run, out->rgba);
        out->rgba = NULL;
    }
    return code;
}
