#include "libcore/gbuffer/shade.h"
#include "libcore/gbuffer/raster.h"

static const pbs_material white = {.base = {1, 1, 1, 1},
                                   .roughness = 1,
                                   .base_texture.texture = PBS_NONE,
                                   .material_texture.texture = PBS_NONE,
                                   .emissive_texture.texture = PBS_NONE};

static uint32_t material_of(const pbs_surfaces *s, const pbs_mesh *mesh, uint32_t triangle) {
    uint32_t m = mesh->triangle_material ? mesh->triangle_material[triangle] : mesh->material;
    return m < s->count ? m : s->count;
}
static const pbs_material *get(const pbs_surfaces *s, uint32_t m) {
    return m < s->count ? &s->materials[m] : &white;
}

/* ---- which textures are needed ---- */

static bool any_masked(const pbs_material *m, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (m[i].alpha == PBS_ALPHA_MASK) return true;
    return false;
}

/* Bit 0 of use[]: as sRGB, bit 1: as plain numbers. */
static void mark(uint8_t *use, size_t count, const pbs_texture_use *t, int bit) {
    if (t->texture < count) use[t->texture] |= (uint8_t)bit;
}

static void mark_material(uint8_t *use, size_t count, const pbs_material *m, uint32_t channels) {
    if (channels & PBS_COLOUR || m->alpha == PBS_ALPHA_MASK) mark(use, count, &m->base_texture, 1);
    if (channels & PBS_MATERIAL) mark(use, count, &m->material_texture, 2);
    if (channels & PBS_EMISSIVE) mark(use, count, &m->emissive_texture, 1);
}

size_t pbs_surfaces_need(const pbs_material *materials, size_t material_count,
                         const pbs_image *textures, size_t texture_count, uint32_t channels) {
    bool masked = any_masked(materials, material_count);
    size_t kinds = (masked || channels & (PBS_COLOUR | PBS_EMISSIVE)) + !!(channels & PBS_MATERIAL);
    size_t n = sizeof(pbs_surfaces) + (material_count + 1) * sizeof(pbs_plain) +
               texture_count * (2 * sizeof(pbs_texture) + 1) + 4 * 128;
    for (size_t i = 0; i < texture_count && kinds; i++) n += kinds * pbs_texture_need(&textures[i]);
    return n;
}

/* ---- flat values ---- */

static inline void encode(const pbs_surfaces *s, const pbs_material *m, const float c[4],
                          uint8_t out[4]) {
#pragma GCC unroll 3
    for (int k = 0; k < 3; k++) out[k] = pbs_srgb_encode(s->srgb, c[k]);
    out[3] = m->alpha == PBS_ALPHA_BLEND ? pbs_unorm8(c[3]) : 255;
}

static const pbs_texture *texture_of(const pbs_surfaces *s, const pbs_texture_use *t, int plain) {
    if (t->texture >= s->textures) return NULL;
    const pbs_texture *p = &s->texture[2 * (size_t)t->texture + plain];
    return p->levels ? p : NULL;
}

static void flatten(const pbs_surfaces *s, const pbs_material *m, pbs_plain *f) {
    f->base = texture_of(s, &m->base_texture, 0);
    f->material = texture_of(s, &m->material_texture, 1);
    f->emissive = texture_of(s, &m->emissive_texture, 0);
    encode(s, m, m->base, f->colour);
    f->finish[0] = pbs_unorm8(m->metallic), f->finish[1] = pbs_unorm8(m->roughness);
    f->finish[2] = f->finish[3] = 0;
    for (int k = 0; k < 3; k++) f->glow[k] = pbs_srgb_encode(s->srgb, m->emissive[k]);
    f->glow[3] = 0;
}

static pbs_code build_textures(pbs_run *run, pbs_surfaces *s, const pbs_image *textures,
                               pbs_err *err) {
    uint8_t *use;
    pbs_code rc = pbs_alloc(run, &use, s->textures, 1, "the list of textures", err);
    if (rc) return rc;
    memset(use, 0, s->textures);
    for (uint32_t i = 0; i < s->count; i++)
        mark_material(use, s->textures, &s->materials[i], s->channels);
    for (size_t i = 0; !rc && i < s->textures; i++)
        for (int plain = 0; !rc && plain < 2; plain++)
            if (use[i] >> plain & 1)
                rc = pbs_texture_build(run, &textures[i], !plain,
                                       &s->texture[2 * i + (size_t)plain], err);
    pbs_free(run, use);
    return rc;
}

static pbs_code build(pbs_run *run, pbs_surfaces *s, const pbs_image *textures,
                      size_t texture_count, pbs_err *err) {
    pbs_code rc =
        pbs_alloc(run, &s->flat, (size_t)s->count + 1, sizeof *s->flat, "the materials", err);
    if (!rc)
        rc =
            pbs_alloc(run, &s->texture, texture_count, 2 * sizeof *s->texture, "the textures", err);
    if (rc) return rc;
    memset(s->texture, 0, texture_count * 2 * sizeof *s->texture);
    s->textures = texture_count;
    if (s->textures) rc = build_textures(run, s, textures, err);
    for (uint32_t i = 0; !rc && i <= s->count; i++) flatten(s, get(s, i), &s->flat[i]);
    return rc;
}

pbs_code pbs_surfaces_new(pbs_run *run, const pbs_material *materials, size_t material_count,
                          const pbs_image *textures, size_t texture_count, uint32_t channels,
                          pbs_surfaces **out, pbs_err *err) {
    pbs_surfaces *s;
    pbs_code rc = pbs_alloc(run, &s, 1, sizeof *s, "the materials", err);
    *out = NULL;
    if (rc) return rc;
    *s = (pbs_surfaces){.materials = materials,
                        .count = (uint32_t)material_count,
                        .channels = channels & (PBS_COLOUR | PBS_MATERIAL | PBS_EMISSIVE),
                        .masked = any_masked(materials, material_count),
                        .srgb = pbs_srgb()};
    if (s->masked || s->channels) rc = build(run, s, textures, texture_count, err);
    if (rc)
        pbs_surfaces_free(run, s);
    else
        *out = s;
    return rc;
}

void pbs_surfaces_free(pbs_run *run, pbs_surfaces *s) {
    if (!s) return;
    for (size_t i = 0; i < 2 * s->textures; i++) pbs_texture_free(run, &s->texture[i]);
    pbs_free(run, s->texture);
    pbs_free(run, s->flat);
    pbs_free(run, s);
}

/* ---- one point ---- */

static const pbs_mesh *mesh_of(const pbs_lanes *b, int lane) {
    return b->place[lane]->draw->mesh;
}

static void sample(const pbs_texture *t, const pbs_texture_use *use, const pbs_lanes *b, int lane,
                   float out[4]) {
    const float *uv[3];
    double at[2], dx[2], dy[2];
    for (int i = 0; i < 3; i++) uv[i] = mesh_of(b, lane)->uv + 2 * (size_t)b->corner[i][lane];
    /* Barycentric coordinates per pixel, from the inverse of the edges' matrix. */
    double f = PBS_SUBPIXELS / b->det[lane];
    for (int k = 0; k < 2; k++) {
        double d1 = (double)uv[1][k] - uv[0][k], d2 = (double)uv[2][k] - uv[0][k];
        at[k] = b->b[0][lane] * uv[0][k] + b->b[1][lane] * uv[1][k] + b->b[2][lane] * uv[2][k];
        dx[k] = (d1 * b->a[1][1][lane] - d2 * b->a[0][1][lane]) * f;
        dy[k] = (d2 * b->a[0][0][lane] - d1 * b->a[1][0][lane]) * f;
    }
    pbs_texture_sample(t, use, at, dx, dy, out);
}

static inline void vertex_colour(const pbs_surfaces *s, const pbs_lanes *b, int lane, float c[4]) {
    const uint8_t *colour = mesh_of(b, lane)->colour;
    const float *linear = s->srgb->linear;
    float sum[4] = {0, 0, 0, 0};
#pragma GCC unroll 3
    for (int i = 0; i < 3; i++) {
        const uint8_t *v = colour + 4 * (size_t)b->corner[i][lane];
        float w = (float)b->b[i][lane];
        sum[0] += w * linear[v[0]], sum[1] += w * linear[v[1]], sum[2] += w * linear[v[2]];
        sum[3] += w * s->srgb->unorm[v[3]];
    }
    c[0] *= sum[0], c[1] *= sum[1], c[2] *= sum[2], c[3] *= sum[3];
}

static inline void linear_colour(const pbs_surfaces *s, const pbs_material *m, const pbs_texture *t,
                                 const pbs_lanes *b, int lane, float c[4]) {
    float texel[4];
    memcpy(c, m->base, 4 * sizeof *c);
    if (mesh_of(b, lane)->colour) vertex_colour(s, b, lane, c);
    if (!t) return;
    sample(t, &m->base_texture, b, lane, texel);
    for (int k = 0; k < 4; k++) c[k] *= texel[k];
}

bool pbs_surfaces_may_ask(const pbs_surfaces *s, const pbs_mesh *mesh) {
    if (!s->masked || mesh->triangle_material) return s->masked;
    return get(s, mesh->material)->alpha == PBS_ALPHA_MASK;
}

bool pbs_surfaces_asks(const pbs_surfaces *s, const pbs_mesh *mesh, uint32_t triangle) {
    uint32_t i = material_of(s, mesh, triangle);
    const pbs_material *m = get(s, i);
    if (m->alpha != PBS_ALPHA_MASK) return false;
    return (s->flat[i].base && mesh->uv) || mesh->colour || m->base[3] < m->alpha_cutoff;
}

bool pbs_surfaces_keep(const pbs_surfaces *s, const pbs_lanes *b, int lane) {
    float c[4];
    const pbs_mesh *mesh = mesh_of(b, lane);
    uint32_t i = material_of(s, mesh, b->triangle[lane]);
    linear_colour(s, get(s, i), mesh->uv ? s->flat[i].base : NULL, b, lane, c);
    return !(c[3] < get(s, i)->alpha_cutoff);
}

void pbs_surfaces_colour(const pbs_surfaces *s, const pbs_lanes *b, int lane, uint8_t out[4]) {
    const pbs_mesh *mesh = mesh_of(b, lane);
    uint32_t i = material_of(s, mesh, b->triangle[lane]);
    const pbs_texture *t = mesh->uv ? s->flat[i].base : NULL;
    if (!t && !mesh->colour) {
        memcpy(out, s->flat[i].colour, 4);
        return;
    }
    float c[4];
    linear_colour(s, get(s, i), t, b, lane, c);
    encode(s, get(s, i), c, out);
}

void pbs_surfaces_material(const pbs_surfaces *s, const pbs_lanes *b, int lane, uint8_t out[4]) {
    const pbs_mesh *mesh = mesh_of(b, lane);
    uint32_t i = material_of(s, mesh, b->triangle[lane]);
    const pbs_material *m = get(s, i);
    memcpy(out, s->flat[i].finish, 4);
    if (!mesh->uv || !s->flat[i].material) return;
    float c[4];
    sample(s->flat[i].material, &m->material_texture, b, lane, c);
    out[0] = pbs_unorm8(m->metallic * c[2]), out[1] = pbs_unorm8(m->roughness * c[1]);
}

void pbs_surfaces_emissive(const pbs_surfaces *s, const pbs_lanes *b, int lane, uint8_t out[4]) {
    const pbs_mesh *mesh = mesh_of(b, lane);
    uint32_t i = material_of(s, mesh, b->triangle[lane]);
    const pbs_material *m = get(s, i);
    memcpy(out, s->flat[i].glow, 4);
    if (!mesh->uv || !s->flat[i].emissive) return;
    float c[4];
    sample(s->flat[i].emissive, &m->emissive_texture, b, lane, c);
    for (int k = 0; k < 3; k++) out[k] = pbs_srgb_encode(s->srgb, m->emissive[k] * c[k]);
}
