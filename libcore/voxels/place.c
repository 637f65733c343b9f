#include "libcore/voxels/place_math.h"

/* ---- how ---- */

/* Scaled first: scales of 10^-200 would underflow in the products. Returns the determinant. */
static double cofactor(const double m[9], double out[9]) {
    double t[12] = {0}, most = 0;
    for (int i = 0; i < 9; i++) most = fmax(most, fabs(m[i]));
    for (int i = 0; i < 9 && most > 0; i++) t[4 * (i / 3) + i % 3] = m[i] / most;
    pbs_xform_cofactor(out, t);
    most = 0;
    for (int i = 0; i < 9; i++) most = fmax(most, fabs(out[i]));
    for (int i = 0; i < 9 && most > 0; i++) out[i] /= most;
    return pbs_xform_det(t);
}

static bool is_safe(const pbs_to_grid *to) {
    double most = 0;
    for (int i = 0; i < 9; i++) most = fmax(most, fabs(to->m[i]));
    return most * 4e38 * 4 < 0x1p1000;
}

void pbs_placing_make(pbs_placing *out, const pbs_mesh *mesh, const pbs_to_grid *to,
                      const uint32_t at[3], pbs_sides sides, bool interior, bool simd) {
    *out = (pbs_placing){.mesh = mesh, .safe = is_safe(to), .simd = simd};
    memcpy(out->m, to->m, sizeof out->m);
    memcpy(out->part, to->part, sizeof out->part);
    double det = cofactor(to->m, out->cofactor);
    for (int k = 0; k < 3; k++) {
        out->at[k] = at[k];
        out->shift[k] = to->whole[k] - at[k];
        out->far_lo[k] = -PBS_PLACE_FAR - out->at[k];
        out->far_hi[k] = PBS_PLACE_FAR - out->at[k];
    }
    out->sign = (det < 0) == (sides == PBS_SIDES_IN) ? 1 : -1;
    out->both = sides == PBS_SIDES_UNKNOWN || !(fabs(det) > 0);
    out->all_faces = out->both || interior;
}

/* ---- triangles that reach far ---- */

/* A corner of a polygon: its place, and where that is in the triangle. */
typedef struct corner {
    double p[3], b[2];
} corner;

static bool comes_first(const corner *a, const corner *b) {
    for (int k = 0; k < 3; k++)
        if (a->p[k] != b->p[k]) return a->p[k] < b->p[k];
    return false;
}

static corner cut_edge(const corner *a, const corner *b, int axis, double where) {
    if (!comes_first(a, b)) {
        const corner *c = a;
        a = b, b = c;
    }
    corner out;
    double t = (where - a->p[axis]) / (b->p[axis] - a->p[axis]);
    for (int k = 0; k < 3; k++) out.p[k] = a->p[k] + t * (b->p[k] - a->p[k]);
    for (int k = 0; k < 2; k++) out.b[k] = a->b[k] + t * (b->b[k] - a->b[k]);
    out.p[axis] = where;
    return out;
}

/* What of a polygon lies below (side -1) or above (1) a plane. */
static int cut_polygon(corner *p, int n, int axis, double where, double side) {
    corner out[12];
    int m = 0;
    for (int i = 0; i < n; i++) {
        const corner *a = &p[i], *b = &p[(i + 1) % n];
        bool in_a = (a->p[axis] - where) * side >= 0, in_b = (b->p[axis] - where) * side >= 0;
        if (in_a) out[m++] = *a;
        if (in_a != in_b) out[m++] = cut_edge(a, b, axis, where);
    }
    memcpy(p, out, (size_t)m * sizeof *p);
    return m;
}

static double snap(double v) {
    double s = v < 0 ? -(double)PBS_GRID_FAR : PBS_GRID_FAR;
    return (v + s) - s;
}

/* Coordinates relative to the grid here: the same for all blocks. */
static bool far_corners(const pbs_placing *g, uint32_t triangle, corner *p) {
    static const double b[3][2] = {{0, 0}, {1, 0}, {0, 1}};
    const uint16_t *index = g->mesh->index + 3 * (size_t)triangle;
    bool finite = true;
    for (int c = 0; c < 3; c++) {
        const float *v = g->mesh->position + 3 * (size_t)index[c];
        memcpy(p[c].b, b[c], sizeof b[c]);
        for (int r = 0; r < 3; r++) {
            const double *m = g->m + 3 * r;
            double q = snap(m[0] * v[0] + m[1] * v[1] + m[2] * v[2] + g->part[r]);
            p[c].p[r] = q + (g->shift[r] + g->at[r]);
            finite = finite && fabs(p[c].p[r]) < 0x1p1000;
        }
    }
    return finite;
}

static void put_piece(const pbs_placing *g, const corner *const c[3], uint32_t triangle,
                      pbs_batch *out) {
    uint32_t n = out->t.count;
    for (int r = 0; r < 3; r++) {
        double lo = INFINITY, hi = -INFINITY;
        for (int k = 0; k < 3; k++) {
            double v = snap(c[k]->p[r]) - g->at[r];
            out->t.p[k][r][n] = v;
            lo = fmin(lo, v), hi = fmax(hi, v);
        }
        if (!(lo < PBS_BLOCK + 1 && hi >= -1)) return;
        out->t.min[r][n] = lo, out->t.max[r][n] = hi;
    }
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 2; i++) out->bary[n][k][i] = (float)c[k]->b[i];
    out->id[n] = triangle;
    out->cut |= UINT64_C(1) << n;
    out->t.count++;
}

enum { PIECES = 7 };

/* False if that cannot be. */
static bool put_far(const pbs_placing *g, uint32_t triangle, pbs_batch *out) {
    corner p[12];
    int n = 3;
    if (!far_corners(g, triangle, p)) return false;
    for (int k = 0; k < 3; k++) {
        n = cut_polygon(p, n, k, -PBS_PLACE_FAR, 1);
        n = cut_polygon(p, n, k, PBS_PLACE_FAR, -1);
    }
    for (int i = 2; i < n; i++) {
        const corner *const c[3] = {&p[0], &p[i - 1], &p[i]};
        put_piece(g, c, triangle, out);
    }
    return true;
}

/* ---- batches ---- */

static void gather(const pbs_mesh *mesh, const uint32_t *triangles, uint32_t count,
                   pbs_corners *to) {
    for (uint32_t i = 0; i < count; i++) {
        const uint16_t *index = mesh->index + 3 * (size_t)triangles[i];
#pragma GCC unroll 3
        for (int c = 0; c < 3; c++) {
            const float *p = mesh->position + 3 * (size_t)index[c];
            to->p[c][0][i] = p[0], to->p[c][1][i] = p[1], to->p[c][2][i] = p[2];
        }
    }
    /* The lanes behind the last one are computed too. */
    for (uint32_t i = count; i % 4; i++)
        for (int c = 0; c < 3; c++)
            for (int r = 0; r < 3; r++) to->p[c][r][i] = 0;
}

static void gather_normals(const pbs_mesh *mesh, const pbs_batch *b, pbs_corners *to) {
    for (uint32_t i = 0; i < (b->t.count + 3) / 4 * 4; i++) {
        const uint16_t *index = mesh->index + 3 * (size_t)b->id[i < b->t.count ? i : 0];
        for (int c = 0; c < 3; c++)
            memcpy(&to->normal[c][i], mesh->normal + 2 * (size_t)index[c], 4);
    }
}

static void take(const pbs_placing *p, pbs_feed *feed, pbs_corners *corners, pbs_batch *out) {
    uint32_t room = PBS_TRIANGLES - out->t.count;
    uint32_t n = feed->count < room ? (uint32_t)feed->count : room;
    uint64_t far = n == 64 ? UINT64_MAX : (UINT64_C(1) << n) - 1;
    if (p->safe) {
        gather(p->mesh, feed->triangles, n, corners);
#if defined(__x86_64__)
        if (p->simd)
            far = pbs_batch_place_avx2(p, corners, feed->triangles, n, out);
        else
#endif
            far = place_all(p, corners, feed->triangles, n, out);
    }
    for (; far; far &= far - 1)
        feed->far[feed->far_count++] = feed->triangles[__builtin_ctzll(far)];
    feed->triangles += n, feed->count -= n;
}

/* The lanes behind the last one are computed too, and must not hold what was there by chance. */
static void fill_up(pbs_batch *b) {
    for (uint32_t n = b->t.count; n % 4; n++)
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) b->t.p[c][r][n] = 0;
}

static void finish(const pbs_placing *p, pbs_corners *corners, pbs_batch *out) {
    fill_up(out);
    if (p->mesh->normal) gather_normals(p->mesh, out, corners);
#if defined(__x86_64__)
    if (p->simd) {
        pbs_batch_normals_avx2(p, out);
        if (p->mesh->normal) pbs_batch_smooth_avx2(p, corners, out);
        return;
    }
#endif
    normals_all(p, out);
    if (p->mesh->normal) smooth_all(p, corners, out);
}

bool pbs_batch_fill(const pbs_placing *p, pbs_feed *feed, pbs_batch *out) {
    pbs_corners corners;
    out->t.count = 0;
    out->cut = 0;
    for (;;) {
        while (feed->far_count && out->t.count + PIECES <= PBS_TRIANGLES)
            feed->lost += !put_far(p, feed->far[--feed->far_count], out);
        /* A batch that is nearly full is not worth another round. */
        if (feed->far_count || !feed->count || out->t.count > PBS_TRIANGLES - 8) break;
        take(p, feed, &corners, out);
    }
    if (out->t.count) finish(p, &corners, out);
    return out->t.count > 0;
}
