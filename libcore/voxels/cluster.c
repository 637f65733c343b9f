/* cluster.c: triangles sorted along a Morton curve, and boxes around runs of them. */
#include "libcore/voxels/cluster.h"

enum { AXIS_BITS = 10, DIGIT = 1 << AXIS_BITS, PASSES = 3 };

/* The order of a mesh of one cluster. */
static const uint32_t in_order[PBS_CLUSTER] = {
    0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21,
    22, 23, 24, 25, 26, 27, 28, 29, 30, 31, 32, 33, 34, 35, 36, 37, 38, 39, 40, 41, 42, 43,
    44, 45, 46, 47, 48, 49, 50, 51, 52, 53, 54, 55, 56, 57, 58, 59, 60, 61, 62, 63};

/* How many boxes each level has; returns how many there are in all. */
static size_t count_boxes(pbs_clusters *c, uint32_t triangles) {
    size_t all = 0;
    c->levels = 0;
    c->triangles = triangles;
    for (uint32_t n = triangles, each = PBS_CLUSTER; n && (!c->levels || n > 1); each = 8) {
        n = n / each + (n % each != 0);
        c->count[c->levels++] = n;
        all += n;
    }
    return all;
}

size_t pbs_clusters_bytes(uint32_t triangles) {
    pbs_clusters c;
    size_t bytes = count_boxes(&c, triangles) * sizeof(float[6]);
    if (triangles > PBS_CLUSTER) bytes += triangles * sizeof(uint32_t);
    return (bytes + 63) / 64 * 64;
}

/* ---- the order ---- */

static const float *corner(const pbs_mesh *m, uint32_t t, int i) {
    return m->position + 3 * (size_t)m->index[3 * (size_t)t + (size_t)i];
}

/* Bit i to bit 3 i. */
static uint32_t spread(uint32_t v) {
    v = (v | v << 16) & 0x030000ff;
    v = (v | v << 8) & 0x0300f00f;
    v = (v | v << 4) & 0x030c30c3;
    return (v | v << 2) & 0x09249249;
}

/* Three times the box of the middles is at most three times the box of the vertices: sums of
 * corners are sorted, not middles. All axes have one scale, so that cells are cubes. */
static void code_triangles(const pbs_mesh *m, uint64_t *out) {
    double min[3] = {INFINITY, INFINITY, INFINITY}, max[3] = {-INFINITY, -INFINITY, -INFINITY};
    double side = 0;
    for (uint32_t i = 0; i < m->vertices; i++)
        for (int k = 0; k < 3; k++) {
            double p = m->position[3 * (size_t)i + (size_t)k];
            min[k] = p < min[k] ? p : min[k];
            max[k] = p > max[k] ? p : max[k];
        }
    for (int k = 0; k < 3; k++) side = max[k] - min[k] > side ? max[k] - min[k] : side;
    double scale = side > 0 ? (DIGIT - 1) / (3 * side) : 0;
    for (uint32_t t = 0; t < m->triangles; t++) {
        const float *a = corner(m, t, 0), *b = corner(m, t, 1), *c = corner(m, t, 2);
        uint32_t code = 0;
        for (int k = 0; k < 3; k++) {
            double x = ((double)a[k] + b[k] + c[k] - 3 * min[k]) * scale;
            code |= spread(x > 0 ? x < DIGIT - 1 ? (uint32_t)x : DIGIT - 1 : 0) << k;
        }
        out[t] = (uint64_t)code << 32 | t;
    }
}

/* Both arrays have n; ends in the second one. Equal codes keep their order. */
static void radix_sort(uint64_t *from, uint64_t *to, size_t n) {
    uint32_t at[PASSES][DIGIT] = {0};
    for (size_t i = 0; i < n; i++)
        for (int p = 0; p < PASSES; p++) at[p][from[i] >> (32 + AXIS_BITS * p) & (DIGIT - 1)]++;
    for (int p = 0; p < PASSES; p++) {
        uint32_t sum = 0;
        for (int d = 0; d < DIGIT; d++) {
            uint32_t here = at[p][d];
            at[p][d] = sum;
            sum += here;
        }
        for (size_t i = 0; i < n; i++)
            to[at[p][from[i] >> (32 + AXIS_BITS * p) & (DIGIT - 1)]++] = from[i];
        uint64_t *other = from;
        from = to;
        to = other;
    }
}

static pbs_code sort(pbs_run *run, const pbs_mesh *m, uint32_t *order, pbs_err *err) {
    uint64_t *code;
    size_t n = m->triangles;
    pbs_code rc = pbs_alloc(run, &code, 2 * n, sizeof *code, "sorting triangles", err);
    if (rc) return rc;
    code_triangles(m, code);
    radix_sort(code, code + n, n);
    for (size_t i = 0; i < n; i++) order[i] = (uint32_t)code[n + i];
    pbs_free(run, code);
    return PBS_OK;
}

/* ---- the boxes ---- */

static inline void grow(float box[6], const float low[3], const float high[3]) {
    for (int k = 0; k < 3; k++) {
        box[k] = low[k] < box[k] ? low[k] : box[k];
        box[k + 3] = high[k] > box[k + 3] ? high[k] : box[k + 3];
    }
}

static void begin_box(float box[6]) {
    for (int k = 0; k < 3; k++) box[k] = INFINITY, box[k + 3] = -INFINITY;
}

static void fill_boxes(const pbs_mesh *m, const pbs_clusters *c, float (*box)[6]) {
    for (uint32_t i = 0; i < c->count[0]; i++) {
        uint32_t first, n = pbs_clusters_below(c, 0, i, &first);
        begin_box(box[i]);
        for (uint32_t t = first; t < first + n; t++)
            for (int v = 0; v < 3; v++) {
                const float *p = corner(m, c->order[t], v);
                grow(box[i], p, p);
            }
    }
    for (int l = 1; l < c->levels; l++) {
        float(*above)[6] = box + c->count[l - 1];
        for (uint32_t i = 0; i < c->count[l]; i++) begin_box(above[i]);
        for (uint32_t i = 0; i < c->count[l - 1]; i++) grow(above[i / 8], box[i], box[i] + 3);
        box = above;
    }
}

pbs_code pbs_clusters_make(pbs_run *run, const pbs_mesh *mesh, void *memory, pbs_clusters *out,
                           pbs_err *err) {
    float(*box)[6] = memory;
    size_t at = 0, boxes = count_boxes(out, mesh->triangles);
    for (int l = 0; l < out->levels; at += out->count[l++])
        out->box[l] = (const float(*)[6])box + at;
    out->order = in_order;
    if (mesh->triangles > PBS_CLUSTER) {
        uint32_t *order = (uint32_t *)(box + boxes);
        pbs_code rc = sort(run, mesh, order, err);
        if (rc) return rc;
        out->order = order;
    }
    if (mesh->triangles) fill_boxes(mesh, out, box);
    return PBS_OK;
}
