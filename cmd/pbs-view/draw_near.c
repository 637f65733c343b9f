/* draw_near.c: source geometry that is in the GPU's memory, for close-ups: paper 2, section 4. */
#include "cmd/pbs-view/draw_internal.h"
#include "shaders.h"

/* As near.vert.glsl has it (std140). */
typedef struct mesh_params {
    float to_view[3][4], normal_rows[3][4];
    int32_t index, position, normal, colour, triangle_material;
    uint32_t material, pad[2];
} mesh_params;

typedef struct gpu_material {
    float base[4], emissive[4], rest[4];
} gpu_material;

static gpu_material material_of(const pbs_material *m) {
    gpu_material g = {{m->base[0], m->base[1], m->base[2], m->base[3]},
                      {m->emissive[0], m->emissive[1], m->emissive[2], 0},
                      {m->metallic, m->roughness, 0, 0}};
    if (m->alpha == PBS_ALPHA_MASK) g.rest[2] = m->alpha_cutoff;
    return g;
}

pbs_code pbs_canvas_palette(pbs_canvas *c, const pbs_palette *p, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    gpu_material *g;
    if (!c->palette || c->palette_of != p->materials) {
        pbs_code rc = pbs_alloc(c->run, &g, p->count + 1, sizeof *g, "the materials", err);
        if (rc) return rc;
        for (size_t i = 0; i < p->count; i++) g[i] = material_of(&p->materials[i]);
        g[p->count] = material_of(&PBS_MATERIAL_DEFAULT);
        if (!c->palette) gl->CreateBuffers(1, &c->palette);
        gl->NamedBufferData(c->palette, (GLsizeiptr)((p->count + 1) * sizeof *g), g,
                            GL_STATIC_DRAW);
        pbs_free(c->run, g);
        c->palette_of = p->materials;
    }
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 3, c->palette);
    return pbs_gl_check(gl, "materials", err);
}

static pbs_code init(pbs_canvas *c, pbs_err *err) {
    const pbs_gl_stage stage[2] = {
        {GL_VERTEX_SHADER, {PBS_GLSL_VERSION, shade_glsl, near_vert_glsl}},
        {GL_FRAGMENT_SHADER, {PBS_GLSL_VERSION, shade_glsl, near_frag_glsl}},
    };
    if (c->near.program) return PBS_OK;
    c->gl->CreateVertexArrays(1, &c->near.array);
    return pbs_gl_program(c->gl, "near", stage, 2, &c->near.program, err);
}

void pbs_near_painter_free(pbs_canvas *c) {
    c->gl->DeleteProgram(c->near.program);
    c->gl->DeleteVertexArrays(1, &c->near.array);
}

static int32_t word_of(int64_t at) {
    return at < 0 ? -1 : (int32_t)(at / 4);
}

static void fill(const pbs_canvas *c, const pbs_placed_mesh *t, mesh_params *p) {
    double view[12], at[12] = {1, 0, 0, t->origin[0], 0, 1, 0, t->origin[1], 0, 0, 1, t->origin[2]};
    pbs_xform_mul(at, t->m, at);
    pbs_camera_place(view, &c->camera, at);
    pbs_rows(p->to_view, view, 1);
    pbs_normal_rows(p->normal_rows, view);
    p->index = (int32_t)(t->index / 2);
    p->position = word_of(t->position);
    p->normal = word_of(t->normal);
    p->colour = word_of(t->colour);
    p->triangle_material = word_of(t->triangle_material);
    p->material = t->material;
}

pbs_code pbs_canvas_triangles(pbs_canvas *c, const pbs_placed_mesh *meshes, size_t count,
                              const pbs_palette *palette, pbs_err *err) {
    pbs_code rc = count ? init(c, err) : PBS_OK;
    if (rc || !count) return rc;
    rc = pbs_batch_begin(c, count, err);
    if (!rc) rc = pbs_canvas_palette(c, palette, err);
    if (rc) return rc;
    for (size_t i = 0; i < count; i++) fill(c, &meshes[i], pbs_batch_block(c, i));
    pbs_canvas_view_uniforms(c, c->near.program);
    pbs_batch_send(c, count);
    c->gl->BindVertexArray(c->near.array);
    for (size_t i = 0; i < count; i++) {
        pbs_batch_use(c, i);
        c->gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, meshes[i].buffer);
        c->gl->DrawArrays(GL_TRIANGLES, 0, (GLsizei)(3 * meshes[i].count));
        c->calls++;
    }
    return pbs_gl_check(c->gl, "meshes", err);
}
