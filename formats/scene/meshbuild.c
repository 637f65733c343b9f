#include "formats/scene/meshbuild.h"
#include "formats/scene/meshbits.h"
#include "formats/container/wire.h"
#include <stdlib.h>
#include <string.h>

/* Payload of a MESH chunk: u32 vertices, triangles, arrays, material; then, each if its bit is
 * set, the lattice (meshbits.h), position f32x3, normal i16x2, uv f32x2, colour u8x4 a vertex,
 * material u32 a triangle; at last index u16x3 a triangle. */
enum { HEAD = 16, HAS_NORMAL = 1, HAS_UV = 2, HAS_COLOUR = 4, HAS_MATERIAL = 8, HAS_ALL = 31 };

#define SLOTS (2u * PBS_MESH_VERTICES) /* of the hash table: half full at most */

typedef pbs_vertex vertex;
_Static_assert(sizeof(vertex) == 28, "vertices are compared and hashed as bytes");

struct pbs_builder {
    pbs_run *run;
    pbs_mesh_out to;
    uint32_t corners;
    double origin[3];
    pbs_box box;
    uint64_t part_triangles, skipped[PBS_SKIP_KINDS];
    uint32_t vertices, triangles;
    bool mixed, has_normal; /* materials differ; any corner had a usable normal */
    uint16_t generation;
    uint32_t *slot; /* vertex, and above it the generation in which it is valid: clearing costs
                       nothing */
    vertex *vertex;
    uint16_t *index;
    uint32_t *material;
    uint8_t *payload;
};

pbs_code pbs_builder_new(pbs_run *run, pbs_mesh_out to, pbs_builder **out, pbs_err *err) {
    pbs_builder *b = *out = calloc(1, sizeof *b);
    if (!b) return pbs_fail(err, PBS_LIMIT, "no memory");
    b->run = run;
    b->to = to;
    const char *what = "the mesh builder";
    pbs_code rc = pbs_alloc(run, &b->slot, SLOTS, 4, what, err);
    if (!rc) rc = pbs_alloc(run, &b->vertex, PBS_MESH_VERTICES, sizeof(vertex), what, err);
    if (!rc) rc = pbs_alloc(run, &b->index, PBS_MESH_TRIANGLES * 3, 2, what, err);
    if (!rc) rc = pbs_alloc(run, &b->material, PBS_MESH_TRIANGLES, 4, what, err);
    if (!rc) rc = pbs_alloc(run, &b->payload, PBS_MESH_VERTICES, 28, what, err);
    if (!rc) memset(b->slot, 0, SLOTS * sizeof *b->slot);
    if (!rc) return PBS_OK;
    pbs_builder_free(b);
    *out = NULL;
    return rc;
}

void pbs_builder_free(pbs_builder *b) {
    if (!b) return;
    pbs_free(b->run, b->slot);
    pbs_free(b->run, b->vertex);
    pbs_free(b->run, b->index);
    pbs_free(b->run, b->material);
    pbs_free(b->run, b->payload);
    free(b);
}

static void start_mesh(pbs_builder *b) {
    b->vertices = b->triangles = 0;
    b->mixed = b->has_normal = false;
    if (!++b->generation) { /* wrapped: those of 2^16 meshes ago would look valid */
        memset(b->slot, 0, SLOTS * sizeof *b->slot);
        b->generation = 1;
    }
}

void pbs_builder_begin(pbs_builder *b, const double origin[3], uint32_t corners) {
    b->corners = corners;
    memcpy(b->origin, origin, sizeof b->origin);
    b->box = PBS_BOX_EMPTY;
    b->part_triangles = 0;
    start_mesh(b);
}

/* ---- emitting ---- */

static uint8_t *put_vertices(const pbs_builder *b, uint8_t *p, uint32_t arrays) {
    for (uint32_t i = 0; i < b->vertices; i++, p += 12) memcpy(p, b->vertex[i].position, 12);
    if (arrays & HAS_NORMAL)
        for (uint32_t i = 0; i < b->vertices; i++, p += 4) memcpy(p, b->vertex[i].normal, 4);
    if (arrays & HAS_UV)
        for (uint32_t i = 0; i < b->vertices; i++, p += 8) memcpy(p, b->vertex[i].uv, 8);
    if (arrays & HAS_COLOUR)
        for (uint32_t i = 0; i < b->vertices; i++, p += 4) memcpy(p, b->vertex[i].colour, 4);
    return p;
}

static pbs_code emit(pbs_builder *b, pbs_err *err) {
    if (!b->triangles) return PBS_OK;
    uint32_t arrays =
        (b->has_normal ? HAS_NORMAL : 0u) | (b->corners & PBS_CORNER_UV ? HAS_UV : 0u) |
        (b->corners & PBS_CORNER_COLOUR ? HAS_COLOUR : 0u) | (b->mixed ? HAS_MATERIAL : 0u);
    uint8_t head[HEAD];
    pbs_put_u32(head, b->vertices);
    pbs_put_u32(head + 4, b->triangles);
    pbs_put_u32(head + 8, arrays);
    pbs_put_u32(head + 12, b->mixed ? PBS_NONE : b->material[0]);
    uint8_t *end = put_vertices(b, b->payload, arrays);
    pbs_piece piece[4] = {{head, HEAD},
                          {b->payload, (size_t)(end - b->payload)},
                          {b->material, b->mixed ? b->triangles * 4ul : 0},
                          {b->index, b->triangles * 6ul}};
    b->part_triangles += b->triangles;
    pbs_code rc = b->to.mesh(b->to.ctx, b->triangles, piece, 4, err);
    start_mesh(b);
    return rc;
}

/* ---- taking ---- */

/* Read in the widths in which it was just written: wider ones would wait for that. */
static uint32_t hash(const vertex *v) {
    uint32_t w[8] = {0};
    uint64_t h = 0x9e3779b97f4a7c15u;
    for (int i = 0; i < 7; i++) memcpy(&w[i], (const char *)v + 4 * i, 4);
    for (int i = 0; i < 8; i += 2) {
        h = (h ^ ((uint64_t)w[i + 1] << 32 | w[i])) * 0xd6e8feb86659fd93u;
        h ^= h >> 32;
    }
    return (uint32_t)h;
}

/* The number of the vertex, which is new if no equal one is there. s: where to look first. */
static uint16_t weld(pbs_builder *b, const vertex *v, uint32_t s) {
    while (b->slot[s] >> 16 == b->generation) {
        uint16_t i = (uint16_t)b->slot[s];
        if (!memcmp(&b->vertex[i], v, sizeof *v)) return i;
        s = (s + 1) & (SLOTS - 1);
    }
    b->slot[s] = (uint32_t)b->generation << 16 | b->vertices;
    b->vertex[b->vertices] = *v;
    return (uint16_t)b->vertices++;
}

/* A direction without its length, which may be too large or small to be squared in float. */
static bool get_direction(const double v[3], float out[3]) {
    double s = 0;
    for (int k = 0; k < 3; k++) {
        if (!isfinite(v[k])) return false;
        s = fmax(s, fabs(v[k]));
    }
    for (int k = 0; k < 3 && s > 0; k++) out[k] = (float)(v[k] / s);
    return s > 0;
}

static void cross_normal(const double a[3], const double d[3], float out[3]) {
    double cross[3];
    for (int k = 0; k < 3; k++)
        cross[k] = a[(k + 1) % 3] * d[(k + 2) % 3] - a[(k + 2) % 3] * d[(k + 1) % 3];
    if (!get_direction(cross, out)) out[0] = out[1] = out[2] = 0;
}

static void corner_face_normal(const pbs_corner c[3], float out[3]) {
    double a[3], d[3];
    for (int k = 0; k < 3; k++) {
        a[k] = c[1].position[k] - c[0].position[k];
        d[k] = c[2].position[k] - c[0].position[k];
    }
    cross_normal(a, d, out);
}

static void face_normal(const vertex v[3], float out[3]) {
    double a[3], d[3];
    for (int k = 0; k < 3; k++) {
        a[k] = (double)v[1].position[k] - v[0].position[k];
        d[k] = (double)v[2].position[k] - v[0].position[k];
    }
    cross_normal(a, d, out);
}

/* A corner without a usable normal gets the triangle's. */
static void corner_normal(pbs_builder *b, vertex v[3], const pbs_corner c[3]) {
    float face[3], own[3];
    bool have_face = false;
    for (int i = 0; i < 3; i++) {
        const double n[3] = {c[i].normal[0], c[i].normal[1], c[i].normal[2]};
        if (get_direction(n, own)) {
            pbs_oct_encode(v[i].normal, own);
            b->has_normal = true;
            continue;
        }
        if (!have_face) corner_face_normal(c, face);
        have_face = true;
        pbs_oct_encode(v[i].normal, face);
    }
}

/* Positions to float; -0 becomes 0, so that equal numbers are equal bits. */
static bool corner_positions(const pbs_builder *b, vertex v[3], const pbs_corner c[3]) {
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            float p = (float)(c[i].position[k] - b->origin[k]) + 0.0f;
            if (!isfinite(p)) return false;
            v[i].position[k] = p;
        }
    return true;
}

/* Whether six numbers add up to exactly nothing: an expansion whose parts do not overlap
 * (Shewchuk 1997) is zero only if each part is. */
static bool is_zero_sum(const double t[6]) {
    double e[6];
    bool zero = true;
    for (int i = 0; i < 6; i++) {
        double q = t[i];
        for (int k = 0; k < i; k++) {
            double sum = q + e[k], part = sum - q;
            e[k] = (q - (sum - part)) + (e[k] - part);
            q = sum;
        }
        e[i] = q;
    }
    for (int i = 0; i < 6; i++) zero = zero && e[i] == 0;
    return zero;
}

/* Twice the area of the projection along an axis: products of floats are exact in double. */
static bool is_exactly_flat(const vertex v[3], int x, int y) {
    const float *a = v[0].position, *b = v[1].position, *c = v[2].position;
    const double t[6] = {(double)a[x] * b[y],  -(double)a[y] * b[x], (double)b[x] * c[y],
                         -(double)b[y] * c[x], (double)c[x] * a[y],  -(double)c[y] * a[x]};
    return is_zero_sum(t);
}

/* The same in plain double: true if that has surely an area. */
static bool is_surely_wide(const vertex v[3], int x, int y) {
    const float *a = v[0].position, *b = v[1].position, *c = v[2].position;
    double p = ((double)b[x] - a[x]) * ((double)c[y] - a[y]);
    double q = ((double)b[y] - a[y]) * ((double)c[x] - a[x]);
    return fabs(p - q) > 1e-15 * (fabs(p) + fabs(q));
}

/* Exactly no area: two equal corners, or three on a line. A needle that has any area stays. */
static bool is_degenerate(const vertex v[3]) {
    if (!memcmp(v[0].position, v[1].position, 12) || !memcmp(v[1].position, v[2].position, 12) ||
        !memcmp(v[0].position, v[2].position, 12))
        return true;
    if (is_surely_wide(v, 0, 1) || is_surely_wide(v, 1, 2) || is_surely_wide(v, 2, 0)) return false;
    return is_exactly_flat(v, 0, 1) && is_exactly_flat(v, 1, 2) && is_exactly_flat(v, 2, 0);
}

static void corner_rest(pbs_builder *b, vertex v[3], const pbs_corner c[3]) {
    if (b->corners & PBS_CORNER_NORMAL) corner_normal(b, v, c);
    for (int i = 0; i < 3; i++) {
        if (b->corners & PBS_CORNER_UV)
            for (int k = 0; k < 2; k++) v[i].uv[k] = isfinite(c[i].uv[k]) ? c[i].uv[k] + 0.0f : 0;
        if (b->corners & PBS_CORNER_COLOUR) memcpy(v[i].colour, c[i].colour, 4);
    }
}

static pbs_code make_room(pbs_builder *b, pbs_err *err) {
    if (b->vertices <= PBS_MESH_VERTICES - 3 && b->triangles < PBS_MESH_TRIANGLES) return PBS_OK;
    pbs_code rc = pbs_run_check(b->run, err);
    return rc ? rc : emit(b, err);
}

/* The three places of the table are asked for before they are needed. */
static void take(pbs_builder *b, const vertex v[3], uint32_t material) {
    uint32_t s[3];
    for (int i = 0; i < 3; i++) {
        s[i] = hash(&v[i]) & (SLOTS - 1);
        __builtin_prefetch(&b->slot[s[i]]);
    }
    for (int i = 0; i < 3; i++) {
        double p[3];
        for (int k = 0; k < 3; k++) p[k] = b->origin[k] + v[i].position[k];
        pbs_box_add(&b->box, p);
    }
    for (int i = 0; i < 3; i++) b->index[3 * b->triangles + i] = weld(b, &v[i], s[i]);
    b->material[b->triangles] = material;
    b->mixed = b->mixed || material != b->material[0];
    b->triangles++;
}

pbs_code pbs_builder_triangle(pbs_builder *b, const pbs_corner c[3], uint32_t material,
                              pbs_err *err) {
    vertex v[3];
    memset(v, 0, sizeof v);
    if (!corner_positions(b, v, c)) {
        b->skipped[PBS_SKIP_NONFINITE]++;
        return PBS_OK;
    }
    if (is_degenerate(v)) {
        b->skipped[PBS_SKIP_DEGENERATE]++;
        return PBS_OK;
    }
    pbs_code rc = make_room(b, err);
    if (rc) return rc;
    corner_rest(b, v, c);
    take(b, v, material);
    return PBS_OK;
}

pbs_code pbs_builder_stored(pbs_builder *b, const pbs_vertex v[3], uint32_t material,
                            pbs_err *err) {
    pbs_code rc = make_room(b, err);
    if (rc) return rc;
    b->has_normal = b->corners & PBS_CORNER_NORMAL;
    take(b, v, material);
    return PBS_OK;
}

pbs_code pbs_builder_end(pbs_builder *b, uint64_t *triangles, pbs_box *box, pbs_err *err) {
    pbs_code rc = emit(b, err);
    *triangles = b->part_triangles;
    *box = b->box;
    return rc;
}

void pbs_builder_skips(const pbs_builder *b, uint64_t skipped[PBS_SKIP_KINDS]) {
    for (int i = 0; i < PBS_SKIP_KINDS; i++) skipped[i] += b->skipped[i];
}

/* ---- parsing ---- */

static bool indices_fit(const uint16_t *index, size_t n, uint32_t vertices) {
    uint16_t max = 0;
    for (size_t i = 0; i < n; i++) max = index[i] > max ? index[i] : max;
    return max < vertices;
}

static bool all_finite(const float *v, size_t n) {
    float sum = 0; /* 0 * x is 0 for finite x, else NaN */
    for (size_t i = 0; i < n; i++) sum += 0 * v[i];
    return sum == 0;
}

size_t pbs_mesh_view(const void *payload, pbs_mesh *m) {
    const uint8_t *start = payload, *p = start + HEAD;
    memset(m, 0, sizeof *m);
    m->vertices = pbs_get_u32(start);
    m->triangles = pbs_get_u32(start + 4);
    uint32_t arrays = pbs_get_u32(start + 8);
    m->material = pbs_get_u32(start + 12);
    size_t v = m->vertices, t = m->triangles;
    if (arrays & PBS_MESH_LATTICE) p += PBS_MESH_LATTICE_SIZE;
    m->position = (const float *)p, p += 12 * v;
    if (arrays & HAS_NORMAL) m->normal = (const int16_t *)p, p += 4 * v;
    if (arrays & HAS_UV) m->uv = (const float *)p, p += 8 * v;
    if (arrays & HAS_COLOUR) m->colour = p, p += 4 * v;
    if (arrays & HAS_MATERIAL) m->triangle_material = (const uint32_t *)p, p += 4 * t;
    m->index = (const uint16_t *)p;
    return (size_t)(p - start) + 6 * t;
}

pbs_code pbs_mesh_parse(const char *place, const pbs_chunk *c, pbs_mesh *m, pbs_err *err) {
    const uint8_t *p = c->payload;
    memset(m, 0, sizeof *m);
    if (c->bytes < HEAD) goto bad;
    uint64_t v = pbs_get_u32(p), t = pbs_get_u32(p + 4);
    if (v > PBS_MESH_VERTICES || t > PBS_MESH_TRIANGLES || t != c->count ||
        pbs_get_u32(p + 8) > HAS_ALL || pbs_mesh_view(p, m) != c->bytes)
        goto bad;
    if (!indices_fit(m->index, 3 * t, m->vertices) || !all_finite(m->position, 3 * v) ||
        (m->uv && !all_finite(m->uv, 2 * v)))
        goto bad;
    return PBS_OK;
bad:
    memset(m, 0, sizeof *m);
    return pbs_fail(err, PBS_DATA, "%s: a mesh of node %u is damaged", place, c->node);
}

/* ---- triangles again ---- */

void pbs_mesh_stored(const pbs_mesh *m, uint32_t t, uint32_t corners, pbs_vertex v[3],
                     uint32_t *material) {
    memset(v, 0, 3 * sizeof *v);
    for (int i = 0; i < 3; i++) {
        size_t k = m->index[3 * t + (uint32_t)i];
        memcpy(v[i].position, m->position + 3 * k, sizeof v->position);
        if (m->normal) memcpy(v[i].normal, m->normal + 2 * k, sizeof v->normal);
        if (m->uv) memcpy(v[i].uv, m->uv + 2 * k, sizeof v->uv);
        if (m->colour) memcpy(v[i].colour, m->colour + 4 * k, sizeof v->colour);
    }
    *material = m->triangle_material ? m->triangle_material[t] : m->material;
    if (m->normal || !(corners & PBS_CORNER_NORMAL)) return;
    float n[3];
    face_normal(v, n);
    for (int i = 0; i < 3; i++) pbs_oct_encode(v[i].normal, n);
}
