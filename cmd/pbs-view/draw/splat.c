/* splat.c: the passes of deferred splatting (paper 4, section 4). */
#include "cmd/pbs-view/draw/splat_internal.h"
#include "shaders.h"

typedef struct command {
    GLuint count, instances, first, base;
} command;

enum { VISIBLE, FRESH, GROUPS }; /* lists, in the order of their commands */

static pbs_code build_programs(pbs_splat *s, pbs_err *err) {
    const pbs_gl_stage depth[2] = {
        {GL_VERTEX_SHADER, {PBS_GLSL_VERSION, shade_glsl, splat_glsl, splat_disc_vert_glsl}},
        {GL_FRAGMENT_SHADER, {PBS_GLSL_VERSION, splat_depth_frag_glsl}},
    };
    const pbs_gl_stage index[2] = {
        {GL_VERTEX_SHADER, {PBS_GLSL_VERSION, shade_glsl, splat_glsl, splat_index_vert_glsl}},
        {GL_FRAGMENT_SHADER, {PBS_GLSL_VERSION, splat_index_frag_glsl}},
    };
    const pbs_gl_stage collect = {
        GL_COMPUTE_SHADER,
        {PBS_GLSL_VERSION "#define COLLECT\n", splat_glsl, splat_collect_comp_glsl}};
    const pbs_gl_stage ewa[2] = {
        {GL_VERTEX_SHADER,
         {PBS_GLSL_VERSION "#define EWA\n", shade_glsl, splat_glsl, splat_disc_vert_glsl}},
        {GL_FRAGMENT_SHADER, {PBS_GLSL_VERSION, splat_ewa_frag_glsl}},
    };
    const pbs_gl_stage last[2] = {
        {GL_VERTEX_SHADER, {PBS_GLSL_VERSION, splat_final_vert_glsl}},
        {GL_FRAGMENT_SHADER, {PBS_GLSL_VERSION, splat_final_frag_glsl}},
    };
    pbs_code rc = pbs_gl_program(s->gl, "splat depth", depth, 2, &s->depth_program, err);
    if (!rc) rc = pbs_gl_program(s->gl, "splat index", index, 2, &s->index_program, err);
    if (!rc) rc = pbs_gl_program(s->gl, "splat lists", &collect, 1, &s->collect_program, err);
    if (!rc) rc = pbs_gl_program(s->gl, "splat colours", ewa, 2, &s->ewa_program, err);
    return rc ? rc : pbs_gl_program(s->gl, "splat division", last, 2, &s->final_program, err);
}

pbs_code pbs_splat_new(pbs_run *run, const pbs_gl *gl, pbs_splat **out, pbs_err *err) {
    pbs_splat *s;
    *out = NULL;
    pbs_code rc = pbs_alloc(run, &s, 1, sizeof *s, "deferred splatting", err);
    if (rc) return rc;
    *s = (pbs_splat){.run = run, .gl = gl};
    gl->CreateVertexArrays(1, &s->no_vertices);
    rc = build_programs(s, err);
    if (!rc) rc = pbs_gl_check(gl, "deferred splatting", err);
    if (rc)
        pbs_splat_free(s);
    else
        *out = s;
    return rc;
}

/* ---- what is drawn into ---- */

static void free_textures(pbs_splat *s) {
    const GLuint textures[5] = {s->depth, s->depth_copy, s->ids, s->sums, s->coverage};
    const GLuint frames[3] = {s->depth_frame, s->index_frame, s->sum_frame};
    s->gl->DeleteTextures(5, textures);
    s->gl->DeleteFramebuffers(3, frames);
    pbs_mem_give(s->run, s->textures_counted);
    s->textures_counted = 0;
    s->width = 0;
}

static void free_frame(pbs_splat *s, splat_frame *f) {
    const GLuint buffers[4] = {f->flag.buffer, f->visible.buffer, f->groups.buffer,
                               f->commands.buffer};
    s->gl->DeleteBuffers(4, buffers);
    pbs_free(s->run, f->objects);
    pbs_free(s->run, f->slots);
    pbs_numbers_free(s->run, &f->by_key);
}

void pbs_splat_free(pbs_splat *s) {
    if (!s) return;
    const GLuint buffers[3] = {s->table.buffer, s->fresh.buffer, s->places.buffer};
    const GLuint programs[5] = {s->depth_program, s->index_program, s->collect_program,
                                s->ewa_program, s->final_program};
    free_textures(s);
    for (int i = 0; i < 2; i++) free_frame(s, &s->frames[i]);
    for (int i = 0; i < 5; i++) s->gl->DeleteProgram(programs[i]);
    s->gl->DeleteBuffers(3, buffers);
    s->gl->DeleteVertexArrays(1, &s->no_vertices);
    pbs_mem_give(s->run, s->counted);
    pbs_free(s->run, s->parts);
    pbs_free(s->run, s->entries);
    pbs_free(s->run, s->moved);
    pbs_free(s->run, s);
}

static GLuint texture(const pbs_splat *s, GLenum format) {
    GLuint t;
    s->gl->CreateTextures(GL_TEXTURE_2D, 1, &t);
    s->gl->TextureStorage2D(t, 1, format, (GLsizei)s->width, (GLsizei)s->height);
    s->gl->TextureParameteri(t, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    s->gl->TextureParameteri(t, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    return t;
}

static pbs_code framebuffer(const pbs_splat *s, GLuint *out, GLuint colour, GLuint second,
                            GLuint depth, pbs_err *err) {
    static const GLenum both[2] = {GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1};
    const pbs_gl *gl = s->gl;
    gl->CreateFramebuffers(1, out);
    gl->NamedFramebufferTexture(*out, GL_DEPTH_ATTACHMENT, depth, 0);
    if (colour) gl->NamedFramebufferTexture(*out, GL_COLOR_ATTACHMENT0, colour, 0);
    if (second) gl->NamedFramebufferTexture(*out, GL_COLOR_ATTACHMENT1, second, 0);
    gl->NamedFramebufferReadBuffer(*out, colour ? GL_COLOR_ATTACHMENT0 : GL_NONE);
    if (colour)
        gl->NamedFramebufferDrawBuffers(*out, second ? 2 : 1, both);
    else
        gl->NamedFramebufferDrawBuffer(*out, GL_NONE);
    GLenum status = gl->CheckNamedFramebufferStatus(*out, GL_DRAW_FRAMEBUFFER);
    if (status == GL_FRAMEBUFFER_COMPLETE) return PBS_OK;
    return pbs_fail(err, PBS_LIMIT, "splats of %u x %u pixels: %s refuses (framebuffer 0x%04x)",
                    s->width, s->height, gl->device, status);
}

static pbs_code fit_textures(pbs_splat *s, const pbs_canvas *c, pbs_err *err) {
    uint32_t width = c->columns.wide + 2 * PBS_SPLAT_MARGIN;
    uint32_t height = c->height + 2 * PBS_SPLAT_MARGIN;
    if (s->width == width && s->height == height) return PBS_OK;
    if (width > (uint32_t)s->gl->max_texture || height > (uint32_t)s->gl->max_texture)
        return pbs_fail(err, PBS_LIMIT, "splats of %u x %u pixels: %s draws up to %d", width,
                        height, s->gl->device, s->gl->max_texture);
    free_textures(s);
    size_t bytes = (size_t)width * height * (4 + 4 + 4 + 8 + 1);
    pbs_code rc = pbs_mem_take(s->run, bytes, "the pictures of splats", err);
    if (rc) return rc;
    s->textures_counted = bytes;
    s->width = width;
    s->height = height;
    s->depth = texture(s, GL_DEPTH_COMPONENT32F);
    s->depth_copy = texture(s, GL_DEPTH_COMPONENT32F);
    s->ids = texture(s, GL_R32UI);
    s->sums = texture(s, GL_RGBA16F);
    s->coverage = texture(s, GL_R8);
    rc = framebuffer(s, &s->depth_frame, 0, 0, s->depth, err);
    if (!rc) rc = framebuffer(s, &s->index_frame, s->ids, 0, s->depth_copy, err);
    if (!rc) rc = framebuffer(s, &s->sum_frame, s->sums, s->coverage, s->depth, err);
    if (rc) free_textures(s);
    return rc;
}

/* Lists, flags and commands of this frame, empty. */
static pbs_code fit_lists(pbs_splat *s, pbs_err *err) {
    splat_frame *f = &s->frames[s->now];
    size_t flags = 4 * ((size_t)f->flags / 32 + 1), slots = f->slot_count;
    uint64_t pixels = (uint64_t)s->width * s->height, visible = 0, groups = 0;
    command *commands;
    pbs_code rc = pbs_alloc(s->run, &commands, 3 * slots, sizeof *commands, "the list", err);
    if (rc) return rc;
    for (size_t i = 0; i < slots; i++) {
        splat_slot *b = &f->slots[i];
        commands[VISIBLE * slots + i] = commands[FRESH * slots + i] =
            (command){0, 1, (GLuint)(3 * visible), 0};
        commands[GROUPS * slots + i] = (command){0, 1, (GLuint)(3 * f->group * groups), 0};
        visible += b->surfels < pixels ? b->surfels : pixels;
        groups += b->groups < pixels ? b->groups : pixels;
    }
    rc = pbs_splat_reserve(s, &f->visible, 4 * visible, err);
    if (!rc) rc = pbs_splat_reserve(s, &s->fresh, 4 * visible, err);
    if (!rc) rc = pbs_splat_reserve(s, &f->groups, f->group > 1 ? 4 * groups : 4, err);
    if (!rc) rc = pbs_splat_reserve(s, &f->flag, flags, err);
    if (!rc) rc = pbs_splat_reserve(s, &f->commands, 3 * slots * sizeof *commands, err);
    if (!rc && slots)
        s->gl->NamedBufferSubData(f->commands.buffer, 0, (GLsizeiptr)(3 * slots * sizeof *commands),
                                  commands);
    if (!rc)
        s->gl->ClearNamedBufferSubData(f->flag.buffer, GL_R32UI, 0, (GLsizeiptr)flags,
                                       GL_RED_INTEGER, GL_UNSIGNED_INT, NULL);
    pbs_free(s->run, commands);
    return rc;
}

/* ---- drawing ---- */

static void use(const pbs_splat *s, const pbs_canvas *c, GLuint program) {
    const pbs_gl *gl = s->gl;
    pbs_canvas_view_uniforms(c, program);
    gl->Uniform1f(gl->GetUniformLocation(program, "pixel"),
                  (float)pbs_camera_pixel(&c->camera, c->height));
    gl->Uniform3f(gl->GetUniformLocation(program, "project"),
                  (float)(c->columns.wide / (c->camera.tan_half * c->aspect * s->width)),
                  (float)(c->height / (c->camera.tan_half * s->height)), (float)PBS_CAMERA_NEAR);
}

/* Objects from..to - 1, each whole. */
static void draw_objects(const pbs_splat *s, GLuint program, size_t from, size_t to, GLenum kind) {
    const pbs_gl *gl = s->gl;
    const splat_frame *f = &s->frames[s->now];
    GLint direct = gl->GetUniformLocation(program, "direct");
    GLsizei vertices = kind == GL_POINTS ? 1 : 3;
    GLuint bound = 0;
    for (size_t i = from; i < to; i++) {
        const splat_object *o = &f->objects[i];
        if (i == from || o->buffer != bound)
            gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, bound = o->buffer);
        gl->Uniform1ui(direct, (GLuint)i);
        gl->DrawArrays(kind, 0, vertices * (GLsizei)o->count);
    }
}

/* A list of a frame, by its commands; only from buffers that are in use now. */
static void draw_list(const pbs_splat *s, GLuint program, const splat_frame *f, int list,
                      GLuint entries, uint32_t group) {
    const pbs_gl *gl = s->gl;
    const splat_frame *now = &s->frames[s->now];
    gl->Uniform1ui(gl->GetUniformLocation(program, "direct"), UINT32_MAX);
    gl->Uniform1ui(gl->GetUniformLocation(program, "larges"), f->larges);
    gl->Uniform1ui(gl->GetUniformLocation(program, "group"), group);
    gl->Uniform1i(gl->GetUniformLocation(program, "moved"), f != now);
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 2, entries);
    gl->BindBuffer(GL_DRAW_INDIRECT_BUFFER, f->commands.buffer);
    for (size_t i = 0; i < f->slot_count; i++) {
        bool here = false;
        for (size_t k = 0; k < now->slot_count && !here; k++)
            here = now->slots[k].buffer == f->slots[i].buffer;
        if (!here || !f->slots[i].surfels) continue;
        gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, f->slots[i].buffer);
        gl->DrawArraysIndirect(
            GL_TRIANGLES, (const void *)(((size_t)list * f->slot_count + i) * sizeof(command)));
    }
}

/* Pass 1. */
static void draw_first(const pbs_splat *s, const pbs_canvas *c, bool coherent) {
    const pbs_gl *gl = s->gl;
    const splat_frame *f = &s->frames[s->now], *last = &s->frames[!s->now];
    float farthest = 0;
    gl->BindFramebuffer(GL_FRAMEBUFFER, s->depth_frame);
    gl->Disable(GL_SCISSOR_TEST);
    gl->Viewport(0, 0, (GLsizei)s->width, (GLsizei)s->height);
    gl->ClearNamedFramebufferfv(s->depth_frame, GL_DEPTH, 0, &farthest);
    use(s, c, s->depth_program);
    draw_objects(s, s->depth_program, coherent ? f->selected : 0, f->count, GL_TRIANGLES);
    if (!coherent) return;
    bool groups = last->group > 1;
    draw_list(s, s->depth_program, last, groups ? GROUPS : VISIBLE,
              groups ? last->groups.buffer : last->visible.buffer, last->group);
}

/* Pass 2: the depth of single pixels must not stay, so it goes to a copy. */
static void draw_indices(const pbs_splat *s, const pbs_canvas *c) {
    const pbs_gl *gl = s->gl;
    const splat_frame *f = &s->frames[s->now];
    GLint w = (GLint)s->width, h = (GLint)s->height;
    const GLuint none[4] = {UINT32_MAX, UINT32_MAX, UINT32_MAX, UINT32_MAX};
    gl->BlitNamedFramebuffer(s->depth_frame, s->index_frame, 0, 0, w, h, 0, 0, w, h,
                             GL_DEPTH_BUFFER_BIT, GL_NEAREST);
    gl->BindFramebuffer(GL_FRAMEBUFFER, s->index_frame);
    gl->ClearNamedFramebufferuiv(s->index_frame, GL_COLOR, 0, none);
    gl->BindTextureUnit(0, s->depth);
    use(s, c, s->index_program);
    draw_objects(s, s->index_program, 0, f->selected, GL_POINTS);
}

static void collect(const pbs_splat *s, bool coherent) {
    const pbs_gl *gl = s->gl;
    const splat_frame *f = &s->frames[s->now], *last = &s->frames[!s->now];
    const GLuint buffers[8] = {0,
                               s->table.buffer,
                               f->visible.buffer,
                               s->fresh.buffer,
                               f->groups.buffer,
                               f->flag.buffer,
                               coherent ? last->flag.buffer : f->flag.buffer,
                               f->commands.buffer};
    GLuint p = s->collect_program;
    gl->UseProgram(p);
    for (GLuint i = 1; i < 8; i++) gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, i, buffers[i]);
    gl->BindTextureUnit(0, s->ids);
    gl->Uniform1ui(gl->GetUniformLocation(p, "larges"), f->larges);
    gl->Uniform1ui(gl->GetUniformLocation(p, "group"), f->group);
    gl->Uniform1ui(gl->GetUniformLocation(p, "buffers"), (GLuint)f->slot_count);
    gl->Uniform2ui(gl->GetUniformLocation(p, "size"), s->width, s->height);
    gl->Uniform1i(gl->GetUniformLocation(p, "remember"), s->coherent);
    gl->DispatchCompute((s->width + 15) / 16, (s->height + 15) / 16, 1);
    gl->MemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_COMMAND_BARRIER_BIT |
                      GL_BUFFER_UPDATE_BARRIER_BIT);
}

/* Pass 4. */
static void draw_colours(const pbs_splat *s, const pbs_canvas *c) {
    const pbs_gl *gl = s->gl;
    const splat_frame *f = &s->frames[s->now];
    const float nothing[4] = {0};
    gl->BindFramebuffer(GL_FRAMEBUFFER, s->sum_frame);
    gl->ClearNamedFramebufferfv(s->sum_frame, GL_COLOR, 0, nothing);
    gl->ClearNamedFramebufferfv(s->sum_frame, GL_COLOR, 1, nothing);
    gl->DepthMask(GL_FALSE);
    gl->Enable(GL_BLEND);
    gl->BlendFunc(GL_ONE, GL_ONE);
    gl->BlendEquationi(1, GL_MAX);
    use(s, c, s->ewa_program);
    if (f->selected) draw_list(s, s->ewa_program, f, VISIBLE, f->visible.buffer, 1);
    draw_objects(s, s->ewa_program, f->selected, f->count, GL_TRIANGLES);
    gl->BlendEquation(GL_FUNC_ADD);
    gl->DepthMask(GL_TRUE);
}

/* Pass 5; leaves the state as pbs_canvas_begin does. */
static void draw_quotient(const pbs_splat *s, const pbs_canvas *c) {
    const pbs_gl *gl = s->gl;
    gl->BindFramebuffer(GL_FRAMEBUFFER, c->draw.frame);
    pbs_canvas_window(c);
    gl->UseProgram(s->final_program);
    gl->Uniform2i(gl->GetUniformLocation(s->final_program, "margin"),
                  PBS_SPLAT_MARGIN - c->columns.from, PBS_SPLAT_MARGIN);
    gl->BindTextureUnit(0, s->sums);
    gl->BindTextureUnit(1, s->coverage);
    gl->BindTextureUnit(2, s->depth);
    gl->BlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
    gl->DrawArrays(GL_TRIANGLES, 0, 3);
    gl->Disable(GL_BLEND);
}

pbs_code pbs_splat_draw(pbs_splat *s, pbs_canvas *c, const pbs_resident *nodes, size_t count,
                        const pbs_splat_options *o, pbs_err *err) {
    const pbs_gl *gl = s->gl;
    pbs_code rc = fit_textures(s, c, err);
    if (rc) return rc;
    s->now = !s->now;
    splat_frame *f = &s->frames[s->now];
    const splat_frame *last = &s->frames[!s->now];
    s->coherent = !o->afresh && !o->whole;
    bool coherent = s->compared = s->coherent && last->lists;
    f->lists = false;
    rc = pbs_splat_table(s, c, nodes, count, o, coherent, err);
    if (!rc) rc = fit_lists(s, err);
    if (rc) return rc;
    gl->BindVertexArray(s->no_vertices);
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 1, s->table.buffer);
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 3, coherent ? s->places.buffer : s->table.buffer);
    draw_first(s, c, coherent);
    if (f->selected) {
        draw_indices(s, c);
        collect(s, coherent);
        f->lists = s->coherent;
    }
    if (f->selected && coherent) {
        gl->BindFramebuffer(GL_FRAMEBUFFER, s->depth_frame);
        use(s, c, s->depth_program);
        draw_list(s, s->depth_program, f, FRESH, s->fresh.buffer, 1);
    }
    draw_colours(s, c);
    draw_quotient(s, c);
    return pbs_gl_check(gl, "splats", err);
}

/* ---- what was drawn ---- */

static pbs_code read_commands(const pbs_splat *s, const splat_frame *f, command **out,
                              pbs_err *err) {
    size_t n = 3 * f->slot_count;
    pbs_code rc = pbs_alloc(s->run, out, n, sizeof **out, "the list", err);
    if (rc || !n) return rc;
    s->gl->GetNamedBufferSubData(f->commands.buffer, 0, (GLsizeiptr)(n * sizeof **out), *out);
    return PBS_OK;
}

/* Entries of a list; 0 if the frame has none. */
static pbs_code listed(const pbs_splat *s, const splat_frame *f, int list, uint32_t vertices,
                       uint64_t *out, pbs_err *err) {
    command *commands;
    pbs_code rc = read_commands(s, f, &commands, err);
    *out = 0;
    if (rc) return rc;
    for (size_t i = 0; i < f->slot_count && f->selected; i++)
        *out += commands[(size_t)list * f->slot_count + i].count / vertices;
    pbs_free(s->run, commands);
    return PBS_OK;
}

pbs_code pbs_splat_count(pbs_splat *s, pbs_splat_counts *out, pbs_err *err) {
    const splat_frame *f = &s->frames[s->now];
    *out = (pbs_splat_counts){.all = s->all, .plain = s->plain, .first = s->all};
    pbs_code rc = listed(s, f, VISIBLE, 3, &out->visible, err);
    if (rc || !s->compared) return rc;
    const splat_frame *last = &s->frames[!s->now];
    rc = listed(s, last, last->group > 1 ? GROUPS : VISIBLE, 3, &out->first, err);
    out->first += s->plain;
    return rc ? rc : listed(s, f, FRESH, 3, &out->fresh, err);
}

pbs_code pbs_splat_visible(pbs_splat *s, pbs_splat_surfel **out, size_t *count, pbs_err *err) {
    const splat_frame *f = &s->frames[s->now];
    command *commands;
    uint32_t *ids = NULL;
    uint64_t most;
    *out = NULL;
    *count = 0;
    pbs_code rc = listed(s, f, VISIBLE, 3, &most, err);
    if (!rc) rc = read_commands(s, f, &commands, err);
    if (rc) return rc;
    rc = pbs_alloc(s->run, out, most, sizeof **out, "the list", err);
    if (!rc) rc = pbs_alloc(s->run, &ids, most, sizeof *ids, "the list", err);
    for (size_t i = 0; i < f->slot_count && most && !rc; i++) {
        uint32_t n = commands[i].count / 3;
        if (n)
            s->gl->GetNamedBufferSubData(f->visible.buffer, 4 * (GLintptr)(commands[i].first / 3),
                                         4 * (GLsizeiptr)n, ids);
        for (uint32_t k = 0; k < n; k++) {
            bool small = ids[k] >> 31;
            uint32_t o = small ? f->larges + (ids[k] >> 17 & 0x3fff) : ids[k] >> 20;
            (*out)[(*count)++] = (pbs_splat_surfel){
                f->objects[o].node, f->objects[o].skip + (ids[k] & (small ? 0x1ffff : 0xfffff))};
        }
    }
    pbs_free(s->run, ids);
    pbs_free(s->run, commands);
    if (!rc) return pbs_gl_check(s->gl, "splats", err);
    pbs_free(s->run, *out);
    *out = NULL;
    return rc;
}
