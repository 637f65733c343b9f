#include "libcore/voxels/block_inner.h"

void pbs_block_shade_init(pbs_block *b) {
    const pbs_block_params *p = &b->params;
    b->srgb = pbs_srgb();
    b->want = p->channels & (PBS_COLOUR | PBS_MATERIAL | PBS_EMISSIVE);
    if (p->per_face == PBS_PER_FACE_COLOUR) b->want |= PBS_COLOUR;
    b->at_material = b->want & PBS_COLOUR ? 4 : 0;
    b->at_emissive = b->at_material + (b->want & PBS_MATERIAL ? 2 : 0);
    b->extras = b->at_emissive + (b->want & PBS_EMISSIVE ? 3 : 0);
    for (int i = 0; i < 256; i++) b->light[i] = (uint16_t)(b->srgb->linear[i] * PBS_LIGHT + 0.5f);
}

/* ---- of a triangle ---- */

static void put_light(const pbs_block *b, const uint8_t code[3], int32_t out[3]) {
    for (int k = 0; k < 3; k++) out[k] = b->light[code[k]];
}

/* What the surfaces say of the lane. */
static void ask(const pbs_block *b, int32_t *value) {
    const pbs_surfaces *s = b->params.surfaces;
    uint8_t c[4];
    if (b->want & PBS_COLOUR) {
        pbs_surfaces_colour(s, &b->lanes, 0, c);
        put_light(b, c, value);
        value[3] = c[3];
    }
    if (b->want & PBS_MATERIAL) {
        pbs_surfaces_material(s, &b->lanes, 0, c);
        value[b->at_material] = c[0], value[b->at_material + 1] = c[1];
    }
    if (b->want & PBS_EMISSIVE) {
        pbs_surfaces_emissive(s, &b->lanes, 0, c);
        put_light(b, c, value + b->at_emissive);
    }
}

static bool varies(const pbs_block *b, uint32_t material) {
    const pbs_surfaces *s = b->params.surfaces;
    const pbs_mesh *mesh = b->placing.mesh;
    if (mesh->colour && b->want & PBS_COLOUR) return true;
    if (!mesh->uv) return false;
    const pbs_plain *f = &s->flat[material < s->count ? material : s->count];
    return (b->want & PBS_COLOUR && f->base) || (b->want & PBS_MATERIAL && f->material) ||
           (b->want & PBS_EMISSIVE && f->emissive);
}

static uint32_t material_of(const pbs_mesh *mesh, uint32_t triangle) {
    return mesh->triangle_material ? mesh->triangle_material[triangle] : mesh->material;
}

void pbs_block_shade_call(pbs_block *b, const pbs_mesh *mesh) {
    b->draw.mesh = mesh;
    b->placed.draw = &b->draw;
    b->lanes.count = 1;
    b->lanes.place[0] = &b->placed;
    b->plain_material = PBS_NONE - 1;
}

/* Vertex colours alone are mixed in linear light, without a look at the surfaces for each point. */
static bool is_mix(const pbs_block *b, uint32_t i, uint32_t material) {
    const pbs_surfaces *s = b->params.surfaces;
    const pbs_mesh *mesh = b->placing.mesh;
    return b->want == PBS_COLOUR && !(b->batch.cut >> i & 1) &&
           !(mesh->uv && s->flat[material < s->count ? material : s->count].base);
}

static float clamp(float v, float most) {
    return v < most ? v > 0 ? v : 0 : v >= most ? most : 0;
}

static void corner_colours(pbs_block *b, uint32_t i, uint32_t material) {
    static const pbs_material white = {.base = {1, 1, 1, 1}};
    const pbs_surfaces *s = b->params.surfaces;
    const pbs_mesh *mesh = b->placing.mesh;
    const pbs_material *m = material < s->count ? &s->materials[material] : &white;
    for (int c = 0; c < 3; c++) {
        const uint8_t *v = mesh->colour + 4 * (size_t)mesh->index[3 * b->batch.id[i] + c];
        float *to = b->mix[i][c];
        for (int k = 0; k < 3; k++)
            to[k] = clamp(m->base[k] * b->srgb->linear[v[k]] * PBS_LIGHT, PBS_LIGHT);
        to[3] = m->alpha == PBS_ALPHA_BLEND ? clamp(m->base[3] * v[3], 255) : 255;
    }
}

void pbs_block_shade_batch(pbs_block *b) {
    const pbs_mesh *mesh = b->placing.mesh;
    const pbs_surfaces *s = b->params.surfaces;
    bool may_ask = s && pbs_surfaces_may_ask(s, mesh);
    b->asks = b->varies = b->mixes = 0;
    b->lane_triangle = PBS_NONE;
    if (!may_ask && !b->extras && !b->params.per_face) return;
    for (uint32_t i = 0; i < b->batch.t.count; i++) {
        uint32_t id = b->batch.id[i], m = b->material[i] = material_of(mesh, id);
        if (may_ask) b->asks |= (uint64_t)pbs_surfaces_asks(s, mesh, id) << i;
        if (!b->extras) continue;
        if (varies(b, m)) {
            bool mix = is_mix(b, i, m);
            b->varies |= UINT64_C(1) << i;
            b->mixes |= (uint64_t)mix << i;
            if (mix) corner_colours(b, i, m);
            continue;
        }
        if (m != b->plain_material) {
            b->lanes.triangle[0] = id;
            ask(b, b->plain);
            b->plain_material = m;
        }
        memcpy(b->value[i], b->plain, sizeof b->plain);
    }
}

/* ---- of a fragment ---- */

void pbs_block_uncut(const pbs_block *b, uint32_t t, double uv[2]) {
    if (!(b->batch.cut >> t & 1)) return;
    const float(*c)[2] = (const void *)b->batch.bary[t];
    double u = uv[0], v = uv[1];
    for (int k = 0; k < 2; k++) uv[k] = (1 - u - v) * c[0][k] + u * c[1][k] + v * c[2][k];
}

/* A pixel is a voxel: the triangle lies in its own plane, edge 0-1 along the first axis. */
static void aim(pbs_block *b) {
    const pbs_placing *g = &b->placing;
    pbs_lanes *l = &b->lanes;
    double e[2][3];
    for (int c = 1; c < 3; c++) {
        const float *o = g->mesh->position + 3 * (size_t)l->corner[0][0];
        const float *p = g->mesh->position + 3 * (size_t)l->corner[c][0];
        for (int r = 0; r < 3; r++) {
            double sum = 0;
            for (int k = 0; k < 3; k++) sum += g->m[3 * r + k] * ((double)p[k] - o[k]);
            e[c - 1][r] = sum * 256;
        }
    }
    double aa = 0, ab = 0, bb = 0;
    for (int r = 0; r < 3; r++)
        aa += e[0][r] * e[0][r], ab += e[0][r] * e[1][r], bb += e[1][r] * e[1][r];
    double length = sqrt(aa), along = ab / length, high = bb - along * along;
    l->a[0][0][0] = length, l->a[0][1][0] = 0;
    l->a[1][0][0] = along, l->a[1][1][0] = sqrt(high > 0 ? high : 0);
    l->det[0] = length * l->a[1][1][0];
}

static void look_at(pbs_block *b, uint32_t t, double u, double v) {
    double uv[2] = {u, v};
    pbs_lanes *l = &b->lanes;
    pbs_block_uncut(b, t, uv);
    uint32_t id = b->batch.id[t];
    if (b->lane_triangle != id) {
        const uint16_t *index = b->placing.mesh->index + 3 * (size_t)id;
        l->triangle[0] = b->lane_triangle = id;
        for (int c = 0; c < 3; c++) l->corner[c][0] = index[c];
        if (b->placing.mesh->uv) aim(b);
    }
    l->b[0][0] = 1 - uv[0] - uv[1], l->b[1][0] = uv[0], l->b[2][0] = uv[1];
}

void pbs_block_values(pbs_block *b, const pbs_fragment *f, int32_t value[PBS_EXTRAS]) {
    look_at(b, f->triangle, f->u, f->v);
    ask(b, value);
}

/* ---- masks ---- */

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* The nearest point of the edge from a to b, to 0; returns its square distance. */
static double nearest_on(const double a[3], const double b[3], double *t) {
    double e[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]}, l = dot(e, e);
    *t = l > 0 ? -dot(a, e) / l : 0;
    *t = *t > 0 ? *t < 1 ? *t : 1 : 0;
    double p[3] = {a[0] + *t * e[0], a[1] + *t * e[1], a[2] + *t * e[2]};
    return dot(p, p);
}

/* u, v of the point of a triangle that is nearest to 0. */
static void nearest(const double p[3][3], double uv[2]) {
    double e[3], f[3], best = INFINITY;
    for (int k = 0; k < 3; k++) e[k] = p[1][k] - p[0][k], f[k] = p[2][k] - p[0][k];
    double ee = dot(e, e), ef = dot(e, f), ff = dot(f, f), det = ee * ff - ef * ef;
    double eo = -dot(e, p[0]), fo = -dot(f, p[0]);
    double u = (eo * ff - fo * ef) / det, v = (fo * ee - eo * ef) / det;
    uv[0] = u, uv[1] = v;
    if (u >= 0 && v >= 0 && u + v <= 1) return;
    for (int i = 0; i < 3; i++) {
        double t, far = nearest_on(p[i], p[(i + 1) % 3], &t);
        if (!(far < best)) continue;
        best = far;
        uv[0] = i == 0 ? t : i == 1 ? 1 - t : 0;
        uv[1] = i == 0 ? 0 : i == 1 ? t : 1 - t;
    }
}

bool pbs_block_keeps(pbs_block *b, uint32_t triangle, uint32_t cell) {
    const double middle[3] = {PBS_CELL_X(cell) + 0.5, PBS_CELL_Y(cell) + 0.5,
                              PBS_CELL_Z(cell) + 0.5};
    double p[3][3], uv[2] = {0, 0};
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 3; k++) p[c][k] = b->batch.t.p[c][k][triangle] - middle[k];
    nearest((const double(*)[3])p, uv);
    look_at(b, triangle, uv[0], uv[1]);
    return pbs_surfaces_keep(b->params.surfaces, &b->lanes, 0);
}
