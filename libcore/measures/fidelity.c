#include "libcore/measures/fidelity.h"
#include "libcore/voxels/clip.h"
#include "libcore/voxels/place.h"
#include "libcore/gbuffer/raster.h"

enum { CELLS = PBS_BLOCK * PBS_BLOCK * PBS_BLOCK };

struct pbs_fidelity_block {
    pbs_run *run;
    uint32_t at[3];
    const pbs_voxels *v;
    double *nearest; /* square of the distance, of each voxel */
    size_t cap;
    pbs_placing placing;
    pbs_batch batch;
    pbs_fragments fragments;
    pbs_fidelity sum;
    uint32_t voxel[CELLS]; /* number of a cell's voxel, and one; 0: none */
};

/* ---- a point and a triangle ---- */

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double squared(const double p[3], const double q[3]) {
    double d[3] = {p[0] - q[0], p[1] - q[1], p[2] - q[2]};
    return dot(d, d);
}

/* The square of the distance of p from the segment a, a + e. */
static double from_segment(const double p[3], const double a[3], const double e[3]) {
    double ap[3] = {p[0] - a[0], p[1] - a[1], p[2] - a[2]}, l = dot(e, e);
    double t = l > 0 ? fmin(fmax(dot(ap, e) / l, 0), 1) : 0;
    double q[3] = {a[0] + t * e[0], a[1] + t * e[1], a[2] + t * e[2]};
    return squared(p, q);
}

/* The same of a triangle: of its plane, if p lies above it, else of the nearest edge. */
static double from_triangle(const double p[3], double c[3][3]) {
    double e[3][3], n[3], best = INFINITY;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) e[i][k] = c[(i + 1) % 3][k] - c[i][k];
    for (int k = 0; k < 3; k++)
        n[k] = e[0][(k + 1) % 3] * e[1][(k + 2) % 3] - e[0][(k + 2) % 3] * e[1][(k + 1) % 3];
    bool above = dot(n, n) > 0;
    for (int i = 0; i < 3; i++) {
        double a[3] = {p[0] - c[i][0], p[1] - c[i][1], p[2] - c[i][2]}, side = 0;
        for (int k = 0; k < 3; k++)
            side +=
                n[k] * (e[i][(k + 1) % 3] * a[(k + 2) % 3] - e[i][(k + 2) % 3] * a[(k + 1) % 3]);
        above = above && side >= 0;
        best = fmin(best, from_segment(p, c[i], e[i]));
    }
    if (!above) return best;
    double a[3] = {p[0] - c[0][0], p[1] - c[0][1], p[2] - c[0][2]}, d = dot(a, n);
    return fmin(best, d * d / dot(n, n));
}

/* ---- fragments ---- */

static uint32_t number_of(int x, int y, int z) {
    return (uint32_t)(x + PBS_BLOCK * (y + PBS_BLOCK * z));
}

static void compare_normals(pbs_fidelity_block *f, size_t i, uint32_t t, double area) {
    float n[3];
    double m[3] = {f->batch.normal[0][t], f->batch.normal[1][t], f->batch.normal[2][t]};
    pbs_normal10_get(n, f->v->normal[i]);
    double c = m[0] * (double)n[0] + m[1] * (double)n[1] + m[2] * (double)n[2];
    c /= sqrt((double)n[0] * n[0] + (double)n[1] * n[1] + (double)n[2] * n[2]);
    if (f->v->place[i] >> 24 & PBS_VOXEL_TWO_SIDED) c = fabs(c);
    double angle = acos(fmin(fmax(c, -1), 1)) * (180 / M_PI);
    f->sum.normal_sum += area * angle;
    f->sum.area += area;
    if (angle > f->sum.normal_max) f->sum.normal_max = angle;
}

static void take(pbs_fidelity_block *f, const pbs_fragment *part) {
    int x = PBS_CELL_X(part->cell), y = PBS_CELL_Y(part->cell), z = PBS_CELL_Z(part->cell);
    uint32_t i = f->voxel[number_of(x, y, z)], t = part->triangle;
    if (!i--) return;
    double p[3] = {x + 0.5, y + 0.5, z + 0.5}, c[3][3];
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) c[k][a] = f->batch.t.p[k][a][t];
    double d = from_triangle(p, c);
    if (d < f->nearest[i]) f->nearest[i] = d;
    if (f->v->normal && part->area > 0) compare_normals(f, i, t, part->area);
}

static void flush(void *ctx, pbs_fragments *fragments) {
    for (uint32_t i = 0; i < fragments->count; i++) take(ctx, &fragments->fragment[i]);
    fragments->count = 0;
}

/* ---- a block ---- */

pbs_code pbs_fidelity_new(pbs_run *run, pbs_fidelity_block **out, pbs_err *err) {
    pbs_fidelity_block *f;
    *out = NULL;
    pbs_code rc = pbs_alloc(run, &f, 1, sizeof *f, "the measuring of voxels", err);
    if (rc) return rc;
    memset(f, 0, sizeof *f);
    f->run = run;
    f->fragments.flush = flush;
    f->fragments.ctx = f;
    *out = f;
    return PBS_OK;
}

void pbs_fidelity_free(pbs_fidelity_block *f) {
    if (!f) return;
    pbs_free(f->run, f->nearest);
    pbs_free(f->run, f);
}

/* Places are relative to the chunk; a block's cells are those modulo its side. */
static uint32_t cell_of(uint32_t place) {
    return number_of(place % PBS_BLOCK, (place >> 8) % PBS_BLOCK, (place >> 16) % PBS_BLOCK);
}

pbs_code pbs_fidelity_begin(pbs_fidelity_block *f, const uint32_t at[3], const pbs_voxels *v,
                            pbs_err *err) {
    memcpy(f->at, at, sizeof f->at);
    memset(f->voxel, 0, sizeof f->voxel);
    f->sum = (pbs_fidelity){.voxels = v->count};
    f->v = v;
    for (size_t i = 0; i < v->count; i++) f->voxel[cell_of(v->place[i])] = (uint32_t)i + 1;
    pbs_code rc = pbs_grow(f->run, &f->nearest, &f->cap, v->count, sizeof *f->nearest,
                           "the distances of voxels", err);
    for (size_t i = 0; i < v->count && !rc; i++) f->nearest[i] = 0.75;
    return rc;
}

pbs_code pbs_fidelity_add(pbs_fidelity_block *f, const pbs_mesh *mesh, const uint32_t *triangles,
                          size_t count, const pbs_to_grid *to, pbs_sides sides, pbs_err *err) {
    pbs_feed feed = {.triangles = triangles, .count = count};
    bool simd = pbs_raster_simd();
    pbs_placing_make(&f->placing, mesh, to, f->at, sides, false, simd);
    for (uint32_t n = 0; pbs_batch_fill(&f->placing, &feed, &f->batch); n++) {
        if (n % 64 == 0 && pbs_run_check(f->run, err)) return PBS_CANCEL;
        pbs_clip(&f->batch.t, false, simd, &f->fragments);
        flush(f, &f->fragments);
    }
    return PBS_OK;
}

void pbs_fidelity_end(pbs_fidelity_block *f, pbs_fidelity *out) {
    for (size_t i = 0; i < f->v->count; i++) {
        double d = sqrt(f->nearest[i]);
        f->sum.distance_sum += d;
        f->sum.distance_max = fmax(f->sum.distance_max, d);
    }
    *out = f->sum;
}

void pbs_fidelity_sum(pbs_fidelity *a, const pbs_fidelity *b) {
    a->voxels += b->voxels;
    a->distance_sum += b->distance_sum;
    a->distance_max = fmax(a->distance_max, b->distance_max);
    a->normal_sum += b->normal_sum;
    a->normal_max = fmax(a->normal_max, b->normal_max);
    a->area += b->area;
}
