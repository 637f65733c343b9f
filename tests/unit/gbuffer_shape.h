/* gbuffer_shape.h: meshes for the tests of the G-buffer, and a run of it with its views kept. */
#ifndef PBS_GBUFFER_SHAPE_H
#define PBS_GBUFFER_SHAPE_H

#include "libcore/gbuffer/gbuffer.h"
#include "tests/check.h"

/* ---- random numbers and meshes ---- */

static uint64_t seed = 1;
static inline double rnd(void) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(seed >> 11) * 0x1p-53;
}

typedef struct shape {
    pbs_mesh mesh;
    float *position, *uv;
    int16_t *normal;
    uint8_t *colour;
    uint16_t *index;
    uint32_t *material;
} shape;

static inline shape new_shape(uint32_t vertices, uint32_t triangles) {
    shape s = {.position = calloc(vertices ? vertices : 1, 12),
               .index = calloc(triangles ? triangles : 1, 6)};
    s.mesh = (pbs_mesh){.vertices = vertices,
                        .triangles = triangles,
                        .position = s.position,
                        .index = s.index,
                        .material = PBS_NONE};
    return s;
}

static inline void free_shape(shape *s) {
    free(s->position), free(s->uv), free(s->normal), free(s->colour), free(s->index);
    free(s->material);
}

static inline void corner_is(shape *s, uint32_t v, double x, double y, double z) {
    s->position[3 * v] = (float)x, s->position[3 * v + 1] = (float)y,
                    s->position[3 * v + 2] = (float)z;
}

/* Colours tell which triangle a candidate comes from; three vertices of their own each. */
static inline void number_triangles(shape *s) {
    s->mesh.colour = s->colour = calloc(s->mesh.vertices, 4);
    for (uint32_t i = 0; i < s->mesh.vertices; i++) {
        uint32_t id = i / 3;
        s->colour[4 * i] = (uint8_t)id, s->colour[4 * i + 1] = (uint8_t)(id >> 8);
        s->colour[4 * i + 2] = (uint8_t)(id >> 16), s->colour[4 * i + 3] = 255;
    }
}

/* Triangles of sizes from a hundredth of a pixel to the whole picture. */
static inline shape soup(uint32_t n) {
    shape s = new_shape(3 * n, n);
    for (uint32_t i = 0; i < n; i++) {
        double size = pow(10, -3.5 * rnd()), c[3];
        for (int k = 0; k < 3; k++) c[k] = size + (1 - 2 * size) * rnd();
        if (size > 0.5) c[0] = c[1] = c[2] = 0.5, size = 0.5;
        for (uint32_t j = 0; j < 3; j++) {
            corner_is(&s, 3 * i + j, c[0] + size * (2 * rnd() - 1), c[1] + size * (2 * rnd() - 1),
                      c[2] + size * (2 * rnd() - 1));
            s.index[3 * i + j] = (uint16_t)(3 * i + j);
        }
    }
    number_triangles(&s);
    return s;
}

/* A closed surface, every vertex once. bump 0: a sphere of radius 1. */
static inline shape ball(uint32_t rings, uint32_t sectors, double bump) {
    shape s = new_shape((rings - 1) * sectors + 2, 2 * sectors * (rings - 1));
    s.mesh.normal = s.normal = calloc(s.mesh.vertices, 4);
    uint32_t south = s.mesh.vertices - 1, v = 1, t = 0;
    for (uint32_t r = 0; r <= rings; r++)
        for (uint32_t c = 0; c < sectors; c++) {
            if ((r == 0 || r == rings) && c) break;
            double a = M_PI * r / rings, b = 2 * M_PI * c / sectors;
            double l = 1 + bump * sin(5 * a) * cos(7 * b);
            uint32_t at = r == 0 ? 0 : r == rings ? south : v++;
            float n[3] = {(float)(sin(a) * cos(b)), (float)cos(a), (float)(sin(a) * sin(b))};
            corner_is(&s, at, l * n[0], l * n[1], l * n[2]);
            pbs_oct_encode(s.normal + 2 * at, n);
        }
    for (uint32_t r = 0; r < rings; r++)
        for (uint32_t c = 0; c < sectors; c++) {
            uint32_t d = (c + 1) % sectors, up = 1 + (r - 1) * sectors, low = 1 + r * sectors;
            uint32_t a0 = r ? up + c : 0, a1 = r ? up + d : 0;
            uint32_t b0 = r + 1 < rings ? low + c : south, b1 = r + 1 < rings ? low + d : south;
            uint16_t q[6] = {(uint16_t)a0, (uint16_t)a1, (uint16_t)b0,
                             (uint16_t)a1, (uint16_t)b1, (uint16_t)b0};
            if (r) memcpy(s.index + 3 * t++, q, 6);
            if (r + 1 < rings) memcpy(s.index + 3 * t++, q + 3, 6);
        }
    return s;
}

/* ---- a run, kept ---- */

typedef struct kept {
    pbs_gbuffer_view v;
    uint32_t *where;
    pbs_points p;
} kept;
typedef struct result {
    int count;
    kept view[2 * PBS_GBUFFER_MAX_PAIRS];
    pbs_gbuffer_stats stats;
    pbs_code rc;
    size_t peak, left;
    int stop_at; /* the sink fails at this view; 0: never */
} result;

static inline void *copy(const void *from, size_t bytes) {
    void *p = malloc(bytes + 1);
    if (from) memcpy(p, from, bytes);
    return p;
}

static inline pbs_code keep_view(void *ctx, const pbs_gbuffer_view *v, pbs_err *err) {
    result *r = ctx;
    size_t n = v->points.count;
    CHECK(v->view == r->count);
    if (r->stop_at && v->view == r->stop_at) return pbs_fail(err, PBS_IO, "no more");
    kept *k = &r->view[r->count++];
    k->v = *v;
    k->where = copy(v->where, 4 * n);
    k->p.count = n;
    k->p.position = copy(v->points.position, 12 * n);
    if (v->points.normal) k->p.normal = copy(v->points.normal, 4 * n);
    if (v->points.colour) k->p.colour = copy(v->points.colour, 4 * n);
    if (v->points.material) k->p.material = copy(v->points.material, 4 * n);
    if (v->points.emissive) k->p.emissive = copy(v->points.emissive, 4 * n);
    return PBS_OK;
}

static inline void drop(result *r) {
    for (int i = 0; i < r->count; i++) {
        kept *k = &r->view[i];
        free(k->where), free(k->p.position), free(k->p.normal), free(k->p.colour);
        free(k->p.material), free(k->p.emissive);
    }
}

/* What is drawn, and with what. */
typedef struct picture {
    const pbs_draw *draws;
    size_t draw_count;
    const pbs_material *materials;
    size_t material_count;
    const pbs_image *textures;
    size_t texture_count;
} picture;

static inline size_t picture_need(const picture *s, const pbs_gbuffer_params *params, int threads) {
    return pbs_surfaces_need(s->materials, s->material_count, s->textures, s->texture_count,
                             params->channels) +
           pbs_gbuffer_need(NULL, s->draws, s->draw_count, params, threads);
}

/* A call with everything that belongs to it. */
static inline pbs_code draw_once(pbs_run *run, const picture *s, const pbs_gbuffer_params *params,
                                 result *r, pbs_err *err) {
    pbs_surfaces *surfaces = NULL;
    pbs_gbuffers *g = NULL;
    pbs_code rc = pbs_surfaces_new(run, s->materials, s->material_count, s->textures,
                                   s->texture_count, params->channels, &surfaces, err);
    if (!rc) rc = pbs_gbuffers_new(run, surfaces, run->threads, &g, err);
    if (!rc) rc = pbs_gbuffer(g, s->draws, s->draw_count, params, keep_view, r, &r->stats, err);
    pbs_gbuffers_free(g);
    pbs_surfaces_free(run, surfaces);
    return rc;
}

static inline result draw_scene(const picture *scene, const pbs_gbuffer_params *params,
                                int threads) {
    result r = {0};
    pbs_run run = {.threads = threads};
    pbs_err err = {0};
    r.rc = draw_once(&run, scene, params, &r, &err);
    r.peak = pbs_mem_peak(&run), r.left = pbs_mem_used(&run);
    CHECK(r.left == 0);
    CHECK_NUM(r.rc || r.peak <= picture_need(scene, params, threads), r.peak);
    return r;
}

static inline pbs_box box_of(const pbs_draw *draws, size_t count) {
    pbs_box b = PBS_BOX_EMPTY;
    for (size_t d = 0; d < count; d++)
        for (uint32_t i = 0; i < draws[d].mesh->vertices; i++) {
            const float *f = draws[d].mesh->position + 3 * i;
            double p[3] = {f[0], f[1], f[2]};
            pbs_xform_point(p, draws[d].m, p);
            pbs_box_add(&b, p);
        }
    return b;
}

static inline pbs_draw placed(const shape *s) {
    pbs_draw d = {.mesh = &s->mesh};
    memcpy(d.m, PBS_IDENTITY, sizeof d.m);
    return d;
}

static inline result draw_shape(const shape *s, uint32_t resolution, uint32_t channels,
                                int threads) {
    pbs_draw d = placed(s);
    picture scene = {.draws = &d, .draw_count = 1};
    pbs_gbuffer_params params = {
        .resolution = resolution, .channels = channels, .box = box_of(&d, 1)};
    return draw_scene(&scene, &params, threads);
}

static inline bool same(const result *a, const result *b) {
    if (a->count != b->count || a->rc != b->rc) return false;
    for (int i = 0; i < a->count; i++) {
        const kept *x = &a->view[i], *y = &b->view[i];
        size_t n = x->p.count;
        if (n != y->p.count || x->v.width != y->v.width) return false;
        if (memcmp(x->where, y->where, 4 * n) || memcmp(x->p.position, y->p.position, 12 * n))
            return false;
        if (x->p.normal && memcmp(x->p.normal, y->p.normal, 4 * n)) return false;
        if (x->p.colour && memcmp(x->p.colour, y->p.colour, 4 * n)) return false;
    }
    return true;
}

static inline double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
#endif
