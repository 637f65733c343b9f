/* draw_near.c: source geometry that is in the GPU's memory, for close-ups: paper 2, section 4. */
#include "cmd/pbs-view/draw/draw_internal.h"
#include "shaders.h"

/* As near.vert.glsl has it (std140). */
typedef struct mesh_params {
    float to_view[3][4], normal_rows[3][4];
    int32_t index, position, normal, colour, triangle_material;
    uint32_t material;
    int32_t uv, pad;
} mesh_params;

static pbs_code init(pbs_canvas *c, bool textured, pbs_err *err) {
    const char *defines = textured ? "#define TEXTURED\n" : "";
    const pbs_gl_stage stage[2] = {
        {GL_VERTEX_SHADER, {PBS_GLSL_VERSION, defines, shade_glsl, material_glsl, near_vert_glsl}},
        {GL_FRAGMENT_SHADER,
         {PBS_GLSL_VERSION, defines, shade_glsl, material_glsl, surface_frag_glsl}},
    };
    GLuint *program = textured ? &c->near.textured : &c->near.program;
    if (*program) return PBS_OK;
    return pbs_gl_program(c->gl, "near", stage, 2, program, err);
}

void pbs_near_painter_free(pbs_canvas *c) {
    c->gl->DeleteProgram(c->near.program);
    c->gl->DeleteProgram(c->near.textured);
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
    p->uv = word_of(t->uv);
}

static bool is_textured(const pbs_placed_mesh *t) {
    return t->look && t->uv >= 0;
}

/* Those with textures, or those without: each has its program. */
static pbs_code draw(pbs_canvas *c, const pbs_placed_mesh *meshes, size_t count, bool textured,
                     pbs_err *err) {
    bool begun = false;
    for (size_t i = 0; i < count; i++) {
        const pbs_placed_mesh *t = &meshes[i];
        if (is_textured(t) != textured) continue;
        if (!begun) {
            pbs_code rc = init(c, textured, err);
            if (rc) return rc;
            pbs_canvas_view_uniforms(c, textured ? c->near.textured : c->near.program);
            begun = true;
        }
        if (textured) pbs_canvas_wear(c, t->look, t->texture);
        pbs_batch_use(c, i);
        c->gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, t->buffer);
        c->gl->DrawArrays(GL_TRIANGLES, (GLint)(3 * t->first), (GLsizei)(3 * t->count));
        c->calls++;
    }
    if (begun && textured) pbs_canvas_undress(c);
    return PBS_OK;
}

pbs_code pbs_canvas_triangles(pbs_canvas *c, const pbs_placed_mesh *meshes, size_t count,
                              const pbs_palette *palette, pbs_err *err) {
    if (!count) return PBS_OK;
    pbs_code rc = pbs_batch_begin(c, count, err);
    if (!rc) rc = pbs_canvas_palette(c, palette, err);
    if (rc) return rc;
    for (size_t i = 0; i < count; i++) fill(c, &meshes[i], pbs_batch_block(c, i));
    pbs_batch_send(c, count);
    if (!c->near.array) c->gl->CreateVertexArrays(1, &c->near.array);
    c->gl->BindVertexArray(c->near.array);
    rc = draw(c, meshes, count, false, err);
    if (!rc) rc = draw(c, meshes, count, true, err);
    return rc ? rc : pbs_gl_check(c->gl, "meshes", err);
}
