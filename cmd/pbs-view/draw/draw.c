/* draw.c: the canvas and its target. Discs are in draw_disc.c, triangles in draw_mesh.c, cubes in
 * draw_voxel.c. */
#include "cmd/pbs-view/draw/draw_internal.h"
#include "shaders.h"

uint32_t pbs_surfel_size(uint32_t channels) {
    uint32_t size = 8;
    for (uint32_t c = PBS_NORMAL; c <= PBS_EMISSIVE; c <<= 1) size += channels & c ? 4 : 0;
    return size;
}

static pbs_code build_programs(pbs_canvas *c, pbs_err *err) {
    const pbs_gl_stage mesh[2] = {
        {GL_VERTEX_SHADER, {PBS_GLSL_VERSION, shade_glsl, material_glsl, mesh_vert_glsl}},
        {GL_FRAGMENT_SHADER,
         {PBS_GLSL_VERSION, "#define TEXTURED\n", shade_glsl, material_glsl, surface_frag_glsl}},
    };
    return pbs_gl_program(c->gl, "mesh", mesh, 2, &c->mesh.program, err);
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

static pbs_code check_size(pbs_canvas *c, uint32_t width, uint32_t height, pbs_err *err) {
    uint32_t largest = (uint32_t)c->gl->max_texture;
    c->width = width ? width : 1024;
    c->height = height ? height : 1024;
    if (c->width > largest || c->height > largest)
        return pbs_fail(err, PBS_LIMIT, "picture of %u x %u pixels: %s draws up to %u x %u",
                        c->width, c->height, c->gl->device, largest, largest);
    size_t pixels = (size_t)c->width * c->height;
    c->counted = pixels * (8 * (size_t)c->samples + (c->samples > 1 ? 4 : 0));
    pbs_code code = pbs_mem_take(c->run, c->counted, "the canvas", err);
    if (code) c->counted = 0;
    return code;
}

static pbs_code build_targets(pbs_canvas *c, uint32_t width, uint32_t height, pbs_err *err) {
    pbs_code code = check_size(c, width, height, err);
    if (!code) code = build_target(c, &c->draw, c->samples, true, err);
    if (!code && c->samples > 1) code = build_target(c, &c->resolved, 1, false, err);
    return code;
}

static pbs_code build(pbs_canvas *c, const pbs_canvas_desc *desc, pbs_err *err) {
    int most = c->gl->max_samples < 4 ? c->gl->max_samples : 4;
    c->samples = desc->samples > 0 && desc->samples < most ? desc->samples : most;
    if (c->samples < 1) c->samples = 1;
    pbs_code code = build_targets(c, desc->width, desc->height, err);
    if (!code) code = build_programs(c, err);
    if (code) return code;
    c->gl->CreateBuffers(1, &c->stream);
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
    pbs_near_painter_free(c);
    pbs_wardrobe_free(c);
    pbs_passes_free(c);
    free_target(gl, &c->draw);
    free_target(gl, &c->resolved);
    pbs_disc_painter_free(c);
    pbs_batch_free(c);
    gl->DeleteBuffers(1, &c->stream);
    pbs_mem_give(c->run, c->counted);
    pbs_free(c->run, c);
}

pbs_code pbs_canvas_resize(pbs_canvas *c, uint32_t width, uint32_t height, pbs_err *err) {
    if (c->draw.frame && c->width == width && c->height == height) return PBS_OK;
    free_target(c->gl, &c->draw);
    free_target(c->gl, &c->resolved);
    c->draw = c->resolved = (target){0};
    pbs_mem_give(c->run, c->counted);
    c->counted = 0;
    return build_targets(c, width, height, err);
}

pbs_code pbs_canvas_begin(pbs_canvas *c, const pbs_frame *frame, pbs_err *err) {
    static const uint8_t light_grey[4] = {238, 240, 242, 255};
    const uint8_t *background = frame->background[3] ? frame->background : light_grey;
    const pbs_gl *gl = c->gl;
    float clear[4] = {0}, farthest = 0;
    for (int k = 0; k < 3; k++) clear[k] = pbs_srgb_to_linear(background[k] / 255.0f);
    c->begun = frame->camera;
    c->frames++;
    c->calls = 0;
    gl->BindFramebuffer(GL_FRAMEBUFFER, c->draw.frame);
    pbs_canvas_look(c, &frame->camera, (pbs_columns){0, c->width, 0, c->width});
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

uint64_t pbs_canvas_calls(const pbs_canvas *c) {
    return c->calls;
}

const pbs_gl *pbs_canvas_gl(const pbs_canvas *c) {
    return c->gl;
}

void pbs_canvas_window(const pbs_canvas *c) {
    pbs_columns k = c->columns;
    GLsizei h = (GLsizei)c->height;
    c->gl->Viewport(k.from, 0, (GLsizei)k.wide, h);
    c->gl->Scissor((GLint)k.left, 0, (GLsizei)k.width, h);
    if (k.width < c->width)
        c->gl->Enable(GL_SCISSOR_TEST);
    else
        c->gl->Disable(GL_SCISSOR_TEST);
}

void pbs_canvas_look(pbs_canvas *c, const pbs_camera *camera, pbs_columns columns) {
    c->camera = *camera;
    c->columns = columns;
    c->aspect = (double)columns.wide / c->height;
    pbs_canvas_window(c);
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
    GLuint from = resolve(c);
    /* Bytes as they are: converted, they would be those of a window in linear colours, which many
     * drivers give where none in sRGB was asked for. */
    c->gl->Disable(GL_FRAMEBUFFER_SRGB);
    /* The window's first row is the lowest. */
    c->gl->BlitNamedFramebuffer(from, 0, 0, 0, w, h, 0, h, w, 0, GL_COLOR_BUFFER_BIT, GL_NEAREST);
    c->gl->Enable(GL_FRAMEBUFFER_SRGB);
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
