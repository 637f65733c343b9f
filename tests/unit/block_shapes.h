/* block_shapes.h: meshes for the tests of blocks, and what comes out of a block. */
#ifndef PBS_BLOCK_SHAPES_H
#define PBS_BLOCK_SHAPES_H
#include "libcore/voxels/block_inner.h"
#include "tests/check.h"

/* ---- meshes ---- */

enum { MOST = 20000 };
typedef struct shape {
    pbs_mesh mesh;
    float position[3 * MOST];
    int16_t normal[2 * MOST];
    uint8_t colour[4 * MOST];
    float uv[2 * MOST];
    uint16_t index[3 * MOST];
    uint32_t material[MOST];
} shape;
static shape one;
static __attribute__((unused)) shape two;

static uint64_t seed;
static inline double uniform(void) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(seed >> 11) * 0x1p-53;
}

static inline void clear(shape *s) {
    s->mesh = (pbs_mesh){.position = s->position, .index = s->index, .material = PBS_NONE};
}
static inline uint16_t vertex(shape *s, double x, double y, double z) {
    float *p = s->position + 3 * (size_t)s->mesh.vertices;
    p[0] = (float)x, p[1] = (float)y, p[2] = (float)z;
    return (uint16_t)s->mesh.vertices++;
}
static inline void triangle(shape *s, int a, int b, int c) {
    uint16_t *t = s->index + 3 * (size_t)s->mesh.triangles++;
    t[0] = (uint16_t)a, t[1] = (uint16_t)b, t[2] = (uint16_t)c;
}
static inline void quad(shape *s, int a, int b, int c, int d) {
    triangle(s, a, b, c);
    triangle(s, a, c, d);
}

/* Outwards, seen counter-clockwise. */
static inline void sphere(shape *s, double x, double y, double z, double r, int n) {
    int first = (int)s->mesh.vertices;
    for (int i = 0; i <= n; i++)
        for (int j = 0; j < 2 * n; j++) {
            double t = M_PI * i / n, p = M_PI * j / n, q = i % n ? sin(t) : 0;
            vertex(s, x + r * q * cos(p), y + r * q * sin(p), z + r * cos(t));
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < 2 * n; j++) {
            int a = first + i * 2 * n + j, b = first + i * 2 * n + (j + 1) % (2 * n);
            triangle(s, a, a + 2 * n, b + 2 * n);
            if (i) triangle(s, a, b + 2 * n, b);
        }
}

static inline void soup(shape *s, int n, double size, double large) {
    for (int i = 0; i < n; i++) {
        double c[3], r = uniform() < 0.05 ? large : size;
        for (int k = 0; k < 3; k++) c[k] = -3 + 70 * uniform();
        int v[3];
        for (int k = 0; k < 3; k++)
            v[k] = vertex(s, c[0] + r * (uniform() - 0.5), c[1] + r * (uniform() - 0.5),
                          c[2] + r * (uniform() - 0.5));
        triangle(s, v[0], v[1], v[2]);
    }
}

static inline void colours(shape *s) {
    for (uint32_t i = 0; i < s->mesh.vertices; i++) {
        for (int k = 0; k < 4; k++) s->colour[4 * i + (uint32_t)k] = (uint8_t)(256 * uniform());
        float n[3];
        for (int k = 0; k < 3; k++) n[k] = (float)(uniform() - 0.5);
        pbs_oct_encode(s->normal + 2 * i, n);
    }
    s->mesh.colour = s->colour;
}

/* ---- what comes out ---- */

typedef struct result {
    pbs_voxels v; /* malloc'ed */
    uint32_t *faces;
    size_t face_count;
    pbs_block_stats stats;
    double sum[4]; /* area, area * normal of all cells that are touched */
} result;

typedef struct how {
    pbs_block_params params;
    pbs_sides sides;
    uint32_t at[3], size;
    pbs_to_grid to;
    int order;       /* 1: backwards; 2: in many calls; 3: in another order, a third at a time */
    int64_t wide_at; /* 0: as it is */
    bool portable;
} how;

enum { ALL = PBS_NORMAL | PBS_WEIGHT | PBS_COLOUR | PBS_MATERIAL | PBS_EMISSIVE };

static inline how plainly(void) {
    return (how){.params = {.channels = PBS_NORMAL | PBS_WEIGHT},
                 .size = 4096,
                 .at = {64, 64, 64},
                 .to = {.m = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .whole = {64, 64, 64}}};
}

static inline void *copy(const void *from, size_t n) {
    void *to = malloc(4 * n + 1);
    if (n) memcpy(to, from, 4 * n);
    return to;
}

static inline void total(const pbs_block *b, double sum[4]) {
    __int128 all[8] = {0};
    for (uint32_t n = 1; n < b->bricks.records; n++) {
        const int64_t *r = pbs_record_at(&b->bricks, n);
        for (uint32_t i = 0; i < 8 && !(r[PBS_REC_FLAGS] & PBS_REC_BARE); i++)
            all[i] += pbs_record_total(&b->bricks, r, i);
    }
    sum[0] = (double)all[PBS_REC_AREA] / PBS_UNIT;
    for (int i = 0; i < 3; i++)
        sum[i + 1] = (double)(all[PBS_REC_NEAR + i] + all[PBS_REC_BEYOND + i]) / PBS_UNIT;
}

static uint32_t list[MOST];

static inline void feed(pbs_block *b, const how *h, const pbs_mesh *mesh) {
    uint32_t n = mesh->triangles, step = h->order == 3 ? 7919 : 1, each = n;
    for (uint32_t i = 0; i < n; i++)
        list[i] = h->order == 1 ? n - 1 - i : (uint32_t)((uint64_t)i * step % n);
    if (h->order == 2) each = 5;
    if (h->order == 3) each = n / 3 + 1;
    for (uint32_t i = 0; i < n; i += each)
        CHECK(
            !pbs_block_add(b, mesh, list + i, n - i < each ? n - i : each, &h->to, h->sides, NULL));
}

static inline result take(pbs_block *b) {
    result r = {0};
    pbs_voxels v;
    const uint32_t *faces;
    CHECK(!pbs_block_end(b, &v, &faces, &r.face_count, &r.stats, NULL));
    r.v.count = v.count;
    r.v.place = copy(v.place, v.count);
    if (v.normal) r.v.normal = copy(v.normal, v.count);
    if (v.weight) r.v.weight = copy(v.weight, v.count);
    if (v.colour) r.v.colour = copy(v.colour, v.count);
    if (v.material) r.v.material = copy(v.material, v.count);
    if (v.emissive) r.v.emissive = copy(v.emissive, v.count);
    if (v.face) r.v.face = copy(v.face, v.count);
    r.faces = copy(faces, r.face_count);
    total(b, r.sum);
    return r;
}

static inline pbs_block *fresh(pbs_run *run, const how *h) {
    pbs_block *b;
    CHECK(!pbs_block_new(run, &h->params, &b, NULL));
    if (h->wide_at) b->wide_at = h->wide_at;
    if (h->portable) b->simd = false;
    return b;
}

static inline result work(const how *h, const pbs_mesh *mesh) {
    pbs_run run = {.threads = 1};
    pbs_block *b = fresh(&run, h);
    pbs_block_begin(b, h->at, h->size);
    feed(b, h, mesh);
    result r = take(b);
    pbs_block_free(b);
    CHECK(pbs_mem_used(&run) == 0);
    return r;
}

static inline void drop(result *r) {
    void *p[] = {r->v.place,    r->v.normal,   r->v.weight, r->v.colour,
                 r->v.material, r->v.emissive, r->v.face,   r->faces};
    for (size_t i = 0; i < 8; i++) free(p[i]);
}

static inline bool same_array(const void *a, const void *b, size_t n) {
    return !a == !b && (!a || !memcmp(a, b, 4 * n));
}
static inline bool same(const result *a, const result *b) {
    size_t n = a->v.count;
    return n == b->v.count && same_array(a->v.place, b->v.place, n) &&
           same_array(a->v.normal, b->v.normal, n) && same_array(a->v.weight, b->v.weight, n) &&
           same_array(a->v.colour, b->v.colour, n) && same_array(a->v.material, b->v.material, n) &&
           same_array(a->v.emissive, b->v.emissive, n) && same_array(a->v.face, b->v.face, n) &&
           a->face_count == b->face_count && same_array(a->faces, b->faces, a->face_count) &&
           !memcmp(&a->stats, &b->stats, sizeof a->stats);
}

/* The same but for what rounding does to sums when corners come in another order. */
static inline bool alike(const result *a, const result *b) {
    size_t wrong = a->v.count != b->v.count;
    for (size_t i = 0; !wrong && i < a->v.count; i++) {
        float m[3], n[3];
        pbs_normal10_get(m, a->v.normal[i]), pbs_normal10_get(n, b->v.normal[i]);
        wrong += a->v.place[i] != b->v.place[i];
        wrong += fabsf(a->v.weight[i] - b->v.weight[i]) > 1e-6f;
        for (int k = 0; k < 3; k++) wrong += fabsf(m[k] - n[k]) > 0.0021f;
    }
    return !wrong;
}

static inline uint32_t faces_of(const result *r, size_t i) {
    return r->v.place[i] >> 24 & PBS_FACES_ALL;
}
static inline long find(const result *r, int x, int y, int z) {
    for (size_t i = 0; i < r->v.count; i++)
        if ((r->v.place[i] & 0xffffff) == (uint32_t)(x | y << 8 | z << 16)) return (long)i;
    return -1;
}

/* ---- materials ---- */

static pbs_run materials_run = {.threads = 1};
static pbs_material material[4];
static uint8_t pixels[64 * 64 * 4];
static pbs_image image = {64, 64, pixels};

static inline pbs_surfaces *surfaces(uint32_t channels) {
    pbs_surfaces *s;
    for (int i = 0; i < 4; i++) {
        material[i] = PBS_MATERIAL_DEFAULT;
        material[i].metallic = (float)i / 4, material[i].roughness = 0.3f;
        for (int k = 0; k < 3; k++) {
            material[i].base[k] = (float)((i + 3 * k) % 5) / 4;
            material[i].emissive[k] = (float)(i * k) / 7;
        }
    }
    material[3].base_texture.texture = 0;
    CHECK(!pbs_surfaces_new(&materials_run, material, 4, &image, 1, channels, &s, NULL));
    return s;
}

static inline void many_materials(shape *s) {
    for (uint32_t i = 0; i < s->mesh.triangles; i++) s->material[i] = i % 5 - (i % 5 == 4 ? 5 : 0);
    s->mesh.triangle_material = s->material;
    for (uint32_t i = 0; i < 2 * s->mesh.vertices; i++) s->uv[i] = (float)uniform();
    s->mesh.uv = s->uv;
}
#endif
