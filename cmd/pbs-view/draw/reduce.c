/* reduce.c: paper 3, section 3.3: the pass over all records, spread over frames, and the draw. */
#include "cmd/pbs-view/draw/reduce.h"
#include "cmd/pbs-view/draw/draw_internal.h"
#include "cmd/pbs-view/plan/numbers.h"
#include "libcore/gbuffer/lod.h"
#include "shaders.h"
#include <stdlib.h>

enum { GROUP = 1024, MOST = 4000000, GROUPS = 65535 }; /* records of a work group; points; groups */

/* As the shader sees it. */
typedef struct slice {
    float to_view[3][4], normal[3][4];
    uint32_t records[4];
    int32_t field[4];
    float unit[4];
} slice;

typedef struct command {
    GLuint vertices, instances, first, base, taken, most, groups[3];
} command;

/* A buffer of points and the camera of the pass that filled it. */
typedef struct output {
    GLuint points, command;
    pbs_camera camera;
} output;

struct pbs_reduce {
    pbs_run *run;
    const pbs_gl *gl;
    GLuint reduce_program, finish_program, draw_program, shares, slice_buffer, no_vertices;
    uint32_t most;
    size_t counted, slice_bytes;
    output out[2];
    int filling; /* which output; the other one is drawn */
    bool running, drawable;
    double aspect;
    pbs_numbers done; /* node: records that this pass has looked at */
    slice *slices;    /* of a step, those of one buffer together */
    struct work {
        GLuint buffer;
        uint32_t slice;
    } * work; /* in the order in which they came */
    slice *sorted;
    size_t slice_count, slice_room, work_room, sorted_room;
    /* pbs_reduce_cast; made when it is first called */
    GLuint cast_program, light_program, pixels, numbers;
    uint64_t pixel_room;
    bool wide; /* 64-bit maxima */
};

static uint32_t seed_of(uint64_t key) {
    return (uint32_t)((key ^ key >> 29) * 0x9e3779b97f4a7c15u >> 32);
}

/* The same as number() in the shader. */
static uint32_t number(uint32_t i, uint32_t seed) {
    uint32_t h = (i ^ seed) * 747796405u + 2891336453u;
    h = (h >> ((h >> 28) + 4) ^ h) * 277803737u;
    return (h >> 22 ^ h) & 255u;
}

static float share(uint32_t n) {
    return (float)exp2(-(n + 0.5) / 256);
}

float pbs_reduce_share(uint64_t key, uint32_t index) {
    return share(number(index, seed_of(key)));
}

static pbs_code build(pbs_reduce *r, pbs_err *err) {
    const pbs_gl *gl = r->gl;
    const pbs_gl_stage reduce = {GL_COMPUTE_SHADER,
                                 {PBS_GLSL_VERSION, shade_glsl, reduce_comp_glsl}};
    const pbs_gl_stage finish = {GL_COMPUTE_SHADER, {PBS_GLSL_VERSION, reduce_finish_comp_glsl}};
    const pbs_gl_stage draw[2] = {
        {GL_VERTEX_SHADER, {PBS_GLSL_VERSION, shade_glsl, reduce_point_glsl, reduce_vert_glsl}},
        {GL_FRAGMENT_SHADER, {PBS_GLSL_VERSION, shade_glsl, disc_frag_glsl}},
    };
    float shares[256];
    for (uint32_t i = 0; i < 256; i++) shares[i] = share(i);
    pbs_code rc = pbs_gl_program(gl, "reduce", &reduce, 1, &r->reduce_program, err);
    if (!rc) rc = pbs_gl_program(gl, "reduce end", &finish, 1, &r->finish_program, err);
    if (!rc) rc = pbs_gl_program(gl, "points", draw, 2, &r->draw_program, err);
    if (rc) return rc;
    gl->CreateVertexArrays(1, &r->no_vertices);
    gl->CreateBuffers(1, &r->shares);
    gl->CreateBuffers(1, &r->slice_buffer);
    gl->NamedBufferData(r->shares, sizeof shares, shares, GL_STATIC_DRAW);
    for (int i = 0; i < 2; i++) {
        gl->CreateBuffers(1, &r->out[i].points);
        gl->CreateBuffers(1, &r->out[i].command);
        gl->NamedBufferData(r->out[i].points, (GLsizeiptr)(r->most * sizeof(pbs_reduced)), NULL,
                            GL_DYNAMIC_COPY);
        gl->NamedBufferData(r->out[i].command, sizeof(command), NULL, GL_DYNAMIC_COPY);
    }
    return pbs_gl_check(gl, "points", err);
}

pbs_code pbs_reduce_new(pbs_run *run, const pbs_gl *gl, uint32_t most, pbs_reduce **out,
                        pbs_err *err) {
    pbs_reduce *r;
    *out = NULL;
    most = most ? most : MOST;
    size_t bytes = most * sizeof(pbs_reduced);
    if ((int64_t)bytes > gl->max_storage)
        return pbs_fail(err, PBS_LIMIT, "%u points: %s has room for %lld", most, gl->device,
                        (long long)(gl->max_storage / (int64_t)sizeof(pbs_reduced)));
    pbs_code rc = pbs_alloc(run, &r, 1, sizeof *r, "the points", err);
    if (rc) return rc;
    *r = (pbs_reduce){.run = run, .gl = gl, .most = most};
    rc = pbs_mem_take(run, 2 * bytes, "the points", err);
    if (!rc) r->counted = 2 * bytes;
    if (!rc) rc = build(r, err);
    if (rc)
        pbs_reduce_free(r);
    else
        *out = r;
    return rc;
}

void pbs_reduce_free(pbs_reduce *r) {
    if (!r) return;
    const pbs_gl *gl = r->gl;
    const GLuint buffers[8] = {r->out[0].points,  r->out[1].points, r->out[0].command,
                               r->out[1].command, r->shares,        r->slice_buffer,
                               r->pixels,         r->numbers};
    gl->DeleteBuffers(8, buffers);
    gl->DeleteProgram(r->cast_program);
    gl->DeleteProgram(r->light_program);
    gl->DeleteProgram(r->reduce_program);
    gl->DeleteProgram(r->finish_program);
    gl->DeleteProgram(r->draw_program);
    gl->DeleteVertexArrays(1, &r->no_vertices);
    pbs_mem_give(r->run, r->counted);
    pbs_numbers_free(r->run, &r->done);
    pbs_free(r->run, r->slices);
    pbs_free(r->run, r->sorted);
    pbs_free(r->run, r->work);
    pbs_free(r->run, r);
}

/* ---- a step ---- */

static void begin_pass(pbs_reduce *r, const pbs_camera *camera, double aspect) {
    output *o = &r->out[r->filling];
    const command c = {0, 1, 0, 0, 0, r->most, {0}};
    r->gl->NamedBufferSubData(o->command, 0, sizeof c, &c);
    o->camera = *camera;
    r->aspect = aspect;
    r->running = true;
    pbs_numbers_clear(&r->done);
}

/* Records first .. first + n - 1 of a node. */
static pbs_code add_slice(pbs_reduce *r, const pbs_resident *node, const pbs_resident_words *w,
                          uint32_t first, uint32_t n, pbs_err *err) {
    static const double unset[12];
    const pbs_camera *camera = &r->out[r->filling].camera;
    float disc[3][4];
    pbs_code rc = pbs_grow(r->run, &r->slices, &r->slice_room, r->slice_count + 1, sizeof(slice),
                           "the points", err);
    if (!rc)
        rc = pbs_grow(r->run, &r->work, &r->work_room, r->slice_count + 1, sizeof *r->work,
                      "the points", err);
    if (rc) return rc;
    const double *m = memcmp(node->m, unset, sizeof unset) ? node->m : PBS_IDENTITY;
    slice *s = &r->slices[r->slice_count];
    *s = (slice){.records = {w->first + first * w->stride, w->stride, n, node->part.before + first},
                 .field = {w->field[0], w->field[1], 0, (int32_t)seed_of(node->key)}};
    s->unit[0] = (float)(65535 * node->step * pbs_lod_stretch(m) / camera->unit);
    pbs_resident_place(node, camera, s->to_view, disc, s->normal);
    r->work[r->slice_count] = (struct work){node->buffer, (uint32_t)r->slice_count};
    r->slice_count++;
    return PBS_OK;
}

/* What this step looks at: nodes whose turn has not been, until there are enough records. */
static pbs_code choose(pbs_reduce *r, const pbs_resident *nodes, size_t count, uint64_t most,
                       bool *all, pbs_err *err) {
    GLuint buffer = 0;
    uint64_t bytes = 0, taken = 0;
    r->slice_count = 0;
    *all = true;
    for (size_t i = 0; i < count; i++) {
        pbs_resident_words w;
        uint32_t done = pbs_numbers_get(&r->done, pbs_resident_key(&nodes[i]));
        if (done == (uint32_t)PBS_NUMBERS_NONE) done = 0;
        if (nodes[i].buffer != buffer || i == 0)
            bytes = pbs_resident_bytes(r->gl, buffer = nodes[i].buffer);
        pbs_code rc = pbs_resident_check(&nodes[i], bytes, &w, err);
        if (rc) return rc;
        if (done >= w.count) continue;
        uint64_t n = w.count - done < most - taken ? w.count - done : most - taken;
        if (n < w.count - done) *all = false;
        if (!n) return PBS_OK;
        rc = add_slice(r, &nodes[i], &w, done, (uint32_t)n, err);
        if (!rc)
            rc = pbs_numbers_put(r->run, &r->done, pbs_resident_key(&nodes[i]), done + (uint32_t)n,
                                 err);
        if (rc) return rc;
        taken += n;
    }
    return PBS_OK;
}

static int by_buffer(const void *a, const void *b) {
    const struct work *x = a, *y = b;
    if (x->buffer != y->buffer) return x->buffer < y->buffer ? -1 : 1;
    return x->slice < y->slice ? -1 : x->slice > y->slice;
}

/* Slices of one buffer together, each with the number of its first work group in its buffer. */
static pbs_code send_slices(pbs_reduce *r, pbs_err *err) {
    size_t n = r->slice_count, bytes = n * sizeof(slice);
    pbs_code rc =
        pbs_grow(r->run, &r->sorted, &r->sorted_room, n, sizeof *r->sorted, "the points", err);
    if (rc) return rc;
    qsort(r->work, n, sizeof *r->work, by_buffer);
    uint32_t groups = 0;
    for (size_t i = 0; i < n; i++) {
        if (i && r->work[i].buffer != r->work[i - 1].buffer) groups = 0;
        r->sorted[i] = r->slices[r->work[i].slice];
        r->sorted[i].field[2] = (int32_t)groups;
        groups += (r->sorted[i].records[2] + GROUP - 1) / GROUP;
    }
    if ((int64_t)bytes > r->gl->max_storage)
        return pbs_fail(err, PBS_LIMIT, "%zu nodes of points in one step", n);
    if (bytes > r->slice_bytes)
        r->gl->NamedBufferData(r->slice_buffer, (GLsizeiptr)(r->slice_bytes = bytes + bytes / 2),
                               NULL, GL_STREAM_DRAW);
    r->gl->NamedBufferSubData(r->slice_buffer, 0, (GLsizeiptr)bytes, r->sorted);
    return PBS_OK;
}

static double or_default(double v, double otherwise) {
    return v > 0 ? v : otherwise;
}

/* What both shaders are told. */
static void set_options(const pbs_reduce *r, GLuint p, const pbs_reduce_options *o) {
    const pbs_gl *gl = r->gl;
    gl->Uniform1f(gl->GetUniformLocation(p, "spacing"), (float)(or_default(o->spacing, 1) / 1000));
    gl->Uniform1f(gl->GetUniformLocation(p, "fall"), (float)or_default(o->fall, 0.5));
    gl->Uniform1f(gl->GetUniformLocation(p, "least"), (float)or_default(o->least, 0.3));
    gl->Uniform1i(gl->GetUniformLocation(p, "periphery"), o->periphery);
}

static void run_pass(pbs_reduce *r, const pbs_reduce_options *o) {
    const pbs_gl *gl = r->gl;
    const output *out = &r->out[r->filling];
    const pbs_camera *v = &out->camera;
    const GLuint buffers[5] = {0, r->slice_buffer, out->points, out->command, r->shares};
    GLuint p = r->reduce_program;
    gl->UseProgram(p);
    set_options(r, p, o);
    gl->Uniform1f(gl->GetUniformLocation(p, "wide"), (float)or_default(o->wide, 2));
    gl->Uniform1i(gl->GetUniformLocation(p, "steps"), o->steps);
    gl->Uniform3f(gl->GetUniformLocation(p, "project"), (float)(1 / (v->tan_half * r->aspect)),
                  (float)(1 / v->tan_half), (float)PBS_CAMERA_NEAR);
    for (GLuint i = 1; i < 5; i++) gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, i, buffers[i]);
    for (size_t from = 0, to; from < r->slice_count; from = to) {
        for (to = from; to < r->slice_count && r->work[to].buffer == r->work[from].buffer;) to++;
        const slice *last = &r->sorted[to - 1];
        uint32_t groups = (uint32_t)last->field[2] + (last->records[2] + GROUP - 1) / GROUP;
        gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, r->work[from].buffer);
        gl->Uniform2ui(gl->GetUniformLocation(p, "slices"), (GLuint)from, (GLuint)to);
        for (uint32_t done = 0; done < groups; done += GROUPS) {
            gl->Uniform1ui(gl->GetUniformLocation(p, "group"), done);
            gl->DispatchCompute(groups - done < GROUPS ? groups - done : GROUPS, 1, 1);
        }
    }
    gl->MemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
}

static void end_pass(pbs_reduce *r) {
    const pbs_gl *gl = r->gl;
    gl->UseProgram(r->finish_program);
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 3, r->out[r->filling].command);
    gl->DispatchCompute(1, 1, 1);
    gl->MemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_COMMAND_BARRIER_BIT |
                      GL_BUFFER_UPDATE_BARRIER_BIT);
    r->filling = !r->filling;
    r->running = false;
    r->drawable = true;
}

pbs_code pbs_reduce_step(pbs_reduce *r, const pbs_camera *camera, double aspect,
                         const pbs_resident *nodes, size_t count, const pbs_reduce_options *o,
                         bool *whole, pbs_err *err) {
    *whole = false;
    if (!r->running) begin_pass(r, camera, aspect);
    pbs_code rc = choose(r, nodes, count, o->step ? o->step : 16 << 20, whole, err);
    if (!rc && r->slice_count) {
        rc = send_slices(r, err);
        if (!rc) run_pass(r, o);
    }
    if (rc) {
        *whole = r->running = false;
        return rc;
    }
    if (*whole) end_pass(r);
    return pbs_gl_check(r->gl, "points", err);
}

/* ---- what it has left ---- */

/* What all programs that draw points are told. */
static void use_points(const pbs_reduce *r, GLuint p, const pbs_canvas *c,
                       const pbs_reduce_options *o) {
    const pbs_gl *gl = r->gl;
    const output *out = &r->out[!r->filling];
    const pbs_camera *v = &out->camera;
    double view[12], placed[12];
    /* From view coordinates of the pass to the world. */
    for (int k = 0; k < 3; k++) {
        placed[4 * k] = v->right[k] * v->unit;
        placed[4 * k + 1] = v->up[k] * v->unit;
        placed[4 * k + 2] = v->back[k] * v->unit;
        placed[4 * k + 3] = v->eye[k];
    }
    pbs_camera_place(view, &c->camera, placed);
    pbs_canvas_view_uniforms(c, p);
    set_options(r, p, o);
    pbs_canvas_matrix(gl, gl->GetUniformLocation(p, "to_view"), 4, view, 1);
    pbs_canvas_normal_matrix(gl, gl->GetUniformLocation(p, "to_view_normal"), view);
    gl->Uniform1f(gl->GetUniformLocation(p, "stretch"), (float)(v->unit / c->camera.unit));
    gl->Uniform1f(gl->GetUniformLocation(p, "fade"), (float)or_default(o->fade, 0.8));
    gl->Uniform1f(gl->GetUniformLocation(p, "size"), (float)or_default(o->size, 1));
    gl->Uniform1f(gl->GetUniformLocation(p, "floor_size"), (float)(o->smallest / c->camera.unit));
    gl->Uniform1f(gl->GetUniformLocation(p, "smallest"),
                  0.70710678f * (float)pbs_camera_pixel(&c->camera, c->height));
    gl->Uniform2ui(gl->GetUniformLocation(p, "extent"), c->columns.wide, c->height);
    gl->Uniform1i(gl->GetUniformLocation(p, "from"), c->columns.from);
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, out->points);
    gl->BindVertexArray(r->no_vertices);
}

pbs_code pbs_reduce_draw(pbs_reduce *r, pbs_canvas *c, const pbs_reduce_options *o, pbs_err *err) {
    const pbs_gl *gl = r->gl;
    if (o->cast) return pbs_reduce_cast(r, c, o, err);
    if (!r->drawable) return PBS_OK;
    use_points(r, r->draw_program, c, o);
    gl->Uniform1i(gl->GetUniformLocation(r->draw_program, "samples"), c->samples);
    gl->BindBuffer(GL_DRAW_INDIRECT_BUFFER, r->out[!r->filling].command);
    gl->DrawArraysIndirect(GL_TRIANGLES, NULL);
    return pbs_gl_check(gl, "points", err);
}

/* ---- without the rasteriser ---- */

static bool has_extension(const pbs_gl *gl, const char *name) {
    GLint n = 0;
    gl->GetIntegerv(GL_NUM_EXTENSIONS, &n);
    for (GLint i = 0; i < n; i++)
        if (strcmp((const char *)gl->GetStringi(GL_EXTENSIONS, (GLuint)i), name) == 0) return true;
    return false;
}

#define CAST_WIDE                                                                                  \
    PBS_GLSL_VERSION "#extension GL_ARB_gpu_shader_int64 : require\n"                              \
                     "#extension GL_NV_shader_atomic_int64 : require\n"                            \
                     "#define WIDE\n"
#define LIGHT_WIDE PBS_GLSL_VERSION "#define WIDE\n"

static pbs_code build_cast(pbs_reduce *r, bool wide, pbs_err *err) {
    const pbs_gl_stage cast = {
        GL_COMPUTE_SHADER,
        {wide ? CAST_WIDE : PBS_GLSL_VERSION, shade_glsl, reduce_point_glsl, cast_comp_glsl}};
    const pbs_gl_stage light[2] = {
        {GL_VERTEX_SHADER, {PBS_GLSL_VERSION, splat_final_vert_glsl}},
        {GL_FRAGMENT_SHADER,
         {wide ? LIGHT_WIDE : PBS_GLSL_VERSION, shade_glsl, reduce_point_glsl, cast_frag_glsl}},
    };
    pbs_code rc = pbs_gl_program(r->gl, "cast", &cast, 1, &r->cast_program, err);
    return rc ? rc : pbs_gl_program(r->gl, "cast light", light, 2, &r->light_program, err);
}

/* With 64-bit maxima if the device has them and its compiler takes the shader. */
static pbs_code choose_cast(pbs_reduce *r, pbs_err *err) {
    if (r->light_program) return PBS_OK;
    r->wide = has_extension(r->gl, "GL_NV_shader_atomic_int64") &&
              has_extension(r->gl, "GL_ARB_gpu_shader_int64");
    if (r->wide && build_cast(r, true, err) == PBS_OK) return PBS_OK;
    r->wide = false;
    r->gl->DeleteProgram(r->cast_program);
    return build_cast(r, false, err);
}

/* A number, or a depth and a number, of every pixel; cleared. */
static pbs_code clear_pixels(pbs_reduce *r, const pbs_canvas *c, pbs_err *err) {
    const pbs_gl *gl = r->gl;
    uint64_t bytes = 4 * (uint64_t)c->columns.wide * c->height, wide = r->wide ? 2 : 1;
    if (bytes > r->pixel_room) {
        if ((int64_t)(wide * bytes) > gl->max_storage)
            return pbs_fail(err, PBS_LIMIT, "points on %u x %u pixels: too many for %s",
                            c->columns.wide, c->height, gl->device);
        pbs_code rc = pbs_mem_take(r->run, 2 * (size_t)(bytes - r->pixel_room), "the points", err);
        if (rc) return rc;
        r->counted += 2 * (size_t)(bytes - r->pixel_room);
        r->pixel_room = bytes;
        if (!r->pixels) gl->CreateBuffers(1, &r->pixels);
        if (!r->numbers) gl->CreateBuffers(1, &r->numbers);
        gl->NamedBufferData(r->pixels, (GLsizeiptr)(wide * bytes), NULL, GL_DYNAMIC_COPY);
        gl->NamedBufferData(r->numbers, r->wide ? 4 : (GLsizeiptr)bytes, NULL, GL_DYNAMIC_COPY);
    }
    gl->ClearNamedBufferData(r->pixels, GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, NULL);
    gl->ClearNamedBufferData(r->numbers, GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, NULL);
    return PBS_OK;
}

pbs_code pbs_reduce_cast(pbs_reduce *r, pbs_canvas *c, const pbs_reduce_options *o, pbs_err *err) {
    const pbs_gl *gl = r->gl;
    const output *out = &r->out[!r->filling];
    if (!r->drawable) return PBS_OK;
    pbs_code rc = choose_cast(r, err);
    if (!rc) rc = clear_pixels(r, c, err);
    if (rc) return rc;
    use_points(r, r->cast_program, c, o);
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 1, r->pixels);
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 2, r->numbers);
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 3, out->command);
    gl->BindBuffer(GL_DISPATCH_INDIRECT_BUFFER, out->command);
    for (int run = 0; run < (r->wide ? 1 : 2); run++) {
        gl->Uniform1i(gl->GetUniformLocation(r->cast_program, "second"), run);
        gl->DispatchComputeIndirect((GLintptr)offsetof(command, groups));
        /* The next call clears them. */
        gl->MemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_BUFFER_UPDATE_BARRIER_BIT);
    }
    use_points(r, r->light_program, c, o);
    gl->DrawArrays(GL_TRIANGLES, 0, 3);
    return pbs_gl_check(gl, "points", err);
}

pbs_code pbs_reduce_count(pbs_reduce *r, uint64_t *kept, uint64_t *lost, pbs_err *err) {
    command c = {0};
    if (r->drawable) r->gl->GetNamedBufferSubData(r->out[!r->filling].command, 0, sizeof c, &c);
    *kept = c.vertices / 3;
    *lost = c.taken - *kept;
    return pbs_gl_check(r->gl, "points", err);
}

pbs_code pbs_reduce_read(pbs_reduce *r, pbs_reduced **out, size_t *count, pbs_err *err) {
    uint64_t kept, lost;
    *out = NULL;
    *count = 0;
    pbs_code rc = pbs_reduce_count(r, &kept, &lost, err);
    if (!rc) rc = pbs_alloc(r->run, out, (size_t)kept, sizeof **out, "the points", err);
    if (rc) return rc;
    *count = (size_t)kept;
    if (kept)
        r->gl->GetNamedBufferSubData(r->out[!r->filling].points, 0,
                                     (GLsizeiptr)(kept * sizeof **out), *out);
    return pbs_gl_check(r->gl, "points", err);
}
