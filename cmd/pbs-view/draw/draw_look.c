/* draw_look.c: materials and textures of source geometry, the same for scenes and for close-ups out
 * of archives. */
#include "cmd/pbs-view/draw/draw_internal.h"

/* As material.glsl has it. */
typedef struct gpu_material {
    float base[4], emissive[4], rest[4], place[6][4];
} gpu_material;

static gpu_material material_of(const pbs_material *m) {
    const pbs_texture_use *use[3] = {&m->base_texture, &m->material_texture, &m->emissive_texture};
    gpu_material g = {{m->base[0], m->base[1], m->base[2], m->base[3]},
                      {m->emissive[0], m->emissive[1], m->emissive[2], 0},
                      {m->metallic, m->roughness, 0, 0},
                      {{0}}};
    if (m->alpha == PBS_ALPHA_MASK) g.rest[2] = m->alpha_cutoff;
    for (int i = 0; i < 6; i++) memcpy(g.place[i], use[i / 2]->transform + 3 * (i % 2), 12);
    return g;
}

pbs_code pbs_canvas_palette(pbs_canvas *c, const pbs_palette *p, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    gpu_material *g;
    if (!c->palette || !p->materials || c->palette_of != p->materials) {
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

/* ---- textures ---- */

static void make_samplers(pbs_canvas *c) {
    static const GLint wrap[3] = {GL_REPEAT, GL_CLAMP_TO_EDGE, GL_MIRRORED_REPEAT};
    static const uint8_t one[4] = {255, 255, 255, 255};
    const pbs_gl *gl = c->gl;
    wardrobe *w = &c->wardrobe;
    w->white = pbs_gl_texture_new(gl, &(pbs_mips){1, 1, false});
    pbs_gl_texture_fill(gl, w->white, &(pbs_mips){1, 1, false}, 0, one, 4);
    gl->CreateSamplers(9, w->sampler);
    for (int i = 0; i < 9; i++) {
        gl->SamplerParameteri(w->sampler[i], GL_TEXTURE_WRAP_S, wrap[i / 3]);
        gl->SamplerParameteri(w->sampler[i], GL_TEXTURE_WRAP_T, wrap[i % 3]);
        gl->SamplerParameteri(w->sampler[i], GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_LINEAR);
        gl->SamplerParameteri(w->sampler[i], GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    }
}

void pbs_canvas_wear(pbs_canvas *c, const pbs_material *m, const GLuint texture[3]) {
    const pbs_texture_use *use[3] = {&m->base_texture, &m->material_texture, &m->emissive_texture};
    if (!c->wardrobe.white) make_samplers(c);
    for (GLuint unit = 0; unit < 3; unit++) {
        int u = use[unit]->wrap_u < 3 ? use[unit]->wrap_u : 0;
        int v = use[unit]->wrap_v < 3 ? use[unit]->wrap_v : 0;
        c->gl->BindTextureUnit(unit, texture[unit] ? texture[unit] : c->wardrobe.white);
        c->gl->BindSampler(unit, c->wardrobe.sampler[3 * u + v]);
    }
}

/* Samplers would make the textures of others, without mipmaps, incomplete. */
void pbs_canvas_undress(const pbs_canvas *c) {
    for (GLuint unit = 0; unit < 3; unit++) c->gl->BindSampler(unit, 0);
}

void pbs_wardrobe_free(pbs_canvas *c) {
    c->gl->DeleteBuffers(1, &c->palette);
    c->gl->DeleteTextures(1, &c->wardrobe.white);
    if (c->wardrobe.white) c->gl->DeleteSamplers(9, c->wardrobe.sampler);
}
