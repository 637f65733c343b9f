/* clip_small_inner.h: triangles that span at most two cells along each axis, four at a time.
 *
 * Which of the cells the triangle touches follows from the signs of what the separating axes say
 * about the one corner of the lattice between these cells, in doubles with a bound, and where that
 * does not decide, from pbs_clip_meets.
 */
#ifndef PBS_CLIP_SMALL_INNER_H
#define PBS_CLIP_SMALL_INNER_H

#include "libcore/voxels/clip_lanes_inner.h"

/* The 2, 4 or 8 cells between the planes of so many axes: bit k of the index is set above the
 * plane of axis k. */
LANE void small_masses(const part4 *p, int axes, bool centroids, mass4 out[8]) {
    mass4 whole = part_mass(p, centroids), xt, zx, zy, zw;
    part4 tx, ty, txy;
    l4 below = tip_of(p->x[0]).below;
    mass4 x = part_below(p, 0, axes, centroids, &tx);
    if (axes == 1) {
        out[0] = x, out[1] = mass_less(whole, x);
        return;
    }
    mass4 y = part_below(p, 1, axes, centroids, &ty);
    xt = part_below(&tx, 1, axes, centroids, &txy); /* of the tip */
    out[0] = mass_pick(below, xt, mass_less(y, xt));
    out[1] = mass_less(y, out[0]), out[2] = mass_less(x, out[0]);
    out[3] = mass_less(mass_less(whole, x), out[1]);
    if (axes == 2) return;
    mass4 z = part_below(p, 2, axes, centroids, NULL);
    zx = part_below(&tx, 2, axes, centroids, NULL);
    zy = part_below(&ty, 2, axes, centroids, NULL);
    zw = part_below(&txy, 2, axes, centroids, NULL);
    mass4 tip_low = mass_pick(tip_of(tx.x[1]).below, zw, mass_less(zx, zw));
    mass4 xz = mass_pick(below, zx, mass_less(z, zx));
    mass4 yz = mass_pick(tip_of(p->x[1]).below, zy, mass_less(z, zy));
    mass4 low[4];
    low[0] = mass_pick(below, tip_low, mass_less(yz, tip_low));
    low[1] = mass_less(yz, low[0]), low[2] = mass_less(xz, low[0]);
    low[3] = mass_less(mass_less(z, xz), low[1]);
    UNROLL
    for (int i = 0; i < 4; i++) out[4 + i] = mass_less(out[i], low[i]), out[i] = low[i];
}

/* ---- which of the cells are touched ---- */

static const uint8_t small_low[3] = {0x55, 0x33, 0x0f}; /* the cells below the plane of an axis */

/* The cells on the side that the signs of a direction say. */
LANE l4 small_side(l4 positive, int axis) {
    return (positive & 0xff) ^ small_low[axis];
}

/* The cells that the edges, seen along an axis, separate. Adds lanes that are not certain. *area:
 * twice the signed area in that view; *none: where it is known to be 0. */
LANE l4 small_edges(const part4 *p, int i, int j, d4 *area, l4 *none, l4 *doubt) {
    const d4 *x = p->x[i], *y = p->x[j], zero = all4(0), bound = all4(0x1p-48);
    d4 s = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0]);
    l4 gone = (l4)zero;
    *none = gone;
    UNROLL
    for (int e = 0; e < 3; e++) {
        d4 dx = x[(e + 1) % 3] - x[e], dy = y[(e + 1) % 3] - y[e];
        *none |= (l4)(dx == 0) & (l4)(dy == 0);
    }
    UNROLL
    for (int e = 0; e < 3; e++) {
        d4 dx = x[(e + 1) % 3] - x[e], dy = y[(e + 1) % 3] - y[e];
        d4 g = dx * y[e] - dy * x[e];
        l4 oblique = (l4)(dx != 0) & (l4)(dy != 0);
        /* Outwards is (dy, -dx) if the corners turn left; a line has an edge on both sides. */
        l4 turn = (l4)(pick(*none, g, s) < 0);
        l4 beyond = (l4)(g > 0) ^ turn;
        l4 cells = small_side((l4)(dy > 0) ^ turn, i) & small_side((l4)(dx < 0) ^ turn, j);
        gone |= cells & beyond & oblique;
        *doubt |= (l4)(abs4(g) <= bound) & oblique;
    }
    *doubt |= (l4)(abs4(s) <= bound) & ~*none;
    *area = s;
    return gone;
}

/* The cells that are touched, and the lanes that are not certain. */
LANE l4 small_touched(const part4 *p, int axes, l4 *doubt) {
    l4 gone = (l4)all4(0);
    *doubt = gone;
    if (axes == 1) return gone + 3;
    d4 n[3];
    l4 none[3];
    gone = small_edges(p, 0, 1, &n[2], &none[2], doubt);
    if (axes == 2) return ~gone & 0xf;
    gone |= small_edges(p, 1, 2, &n[0], &none[0], doubt);
    gone |= small_edges(p, 2, 0, &n[1], &none[1], doubt);
    /* A normal with a component of 0 is across an edge's view: seen there already. */
    d4 d = -(n[0] * p->x[0][0] + n[1] * p->x[1][0] + n[2] * p->x[2][0]);
    l4 turn = (l4)(d < 0), wall = none[0] | none[1] | none[2], cells = (l4)all4(0) + 0xff;
    UNROLL
    for (int k = 0; k < 3; k++) cells &= small_side((l4)(n[k] > 0) ^ turn, k);
    *doubt |= (l4)(abs4(d) <= 0x1p-45) & ~wall;
    return ~(gone | (cells & ~wall)) & 0xff;
}

/* ---- four triangles ---- */

typedef struct clip_small {
    const pbs_triangles *t;
    const double *area;                 /* of each */
    const double (*low)[PBS_TRIANGLES]; /* cells at the lower end, [axis] */
    pbs_fragments *out;
} clip_small;

typedef struct small_result {
    double area[8][4];
    float u[8][4], v[8][4];
    int64_t touched[4], doubt[4];
} small_result;

static void small_exactly(const clip_small *s, uint32_t i, const int axis[3], int cells,
                          const small_result *r, int lane, int64_t *touched) {
    double p[3][3];
    for (int c = 0; c < 9; c++) p[c / 3][c % 3] = s->t->p[c / 3][c % 3][i];
    for (int o = 0; o < cells; o++) {
        int cell[3];
        for (int k = 0; k < 3; k++) cell[axis[k]] = (int)s->low[axis[k]][i] + (o >> k & 1);
        bool is = r->area[o][lane] > 0x1p-40 || pbs_clip_meets(p, cell);
        *touched = is ? *touched | 1 << o : *touched & ~(1 << o);
    }
}

/* The fragments of a triangle whose axes that are cut come first. */
static void small_emit(const clip_small *s, uint32_t i, const int axis[3], int axes,
                       small_result *r, int lane) {
    uint32_t cell = 0, step[3];
    int64_t cells = r->touched[lane];
    if (r->doubt[lane]) small_exactly(s, i, axis, 1 << axes, r, lane, &cells);
    for (int k = 0; k < 3; k++) {
        int low = (int)s->low[axis[k]][i];
        step[k] = 1u << 7 * axis[k];
        cell += (uint32_t)(low + 1) * step[k];
        if (low < 0) cells &= ~small_low[k];
        if (low == PBS_BLOCK - 1 && k < axes) cells &= small_low[k];
    }
    pbs_fragments *out = s->out;
    for (; cells; cells &= cells - 1) {
        int o = __builtin_ctz((unsigned)cells);
        out->fragment[out->count++] = (pbs_fragment){
            cell + (o & 1 ? step[0] : 0) + (o & 2 ? step[1] : 0) + (o & 4 ? step[2] : 0), i,
            r->area[o][lane], r->u[o][lane], r->v[o][lane]};
    }
}

/* Centroids of what may have no area are inside the triangle all the same. */
LANE void small_place(const mass4 *m, float u[4], float v[4]) {
    const d4 little = all4(0x1p-100);
    d4 share = 1 / (3 * (max4(m->f, all4(0)) + little));
    put_place(u, v, (m->a + little) * share, (m->b + little) * share);
}

LANE void small_four(const clip_small *s, const uint8_t index[4], const uint8_t (*axis)[3],
                     int count, int axes, bool centroids) {
    part4 p;
    mass4 m[8];
    d4 area;
    small_result r;
    UNROLL
    for (int i = 0; i < 4; i++) {
        uint32_t at = index[i];
        area[i] = s->area[at];
        UNROLL
        for (int k = 0; k < axes; k++) {
            int a = axis[i][k];
            double plane = s->low[a][at] + 1;
            UNROLL
            for (int c = 0; c < 3; c++) p.x[k][c][i] = s->t->p[c][a][at] - plane;
        }
    }
    p.f = all4(1);
    UNROLL
    for (int c = 0; c < 3; c++) p.a[c] = all4(c == 1), p.b[c] = all4(c == 2);
    small_masses(&p, axes, centroids, m);
    UNROLL
    for (int o = 0; o < 8; o++) {
        if (o >> axes) continue;
        put4(r.area[o], area * max4(m[o].f, all4(0)));
        if (centroids)
            small_place(&m[o], r.u[o], r.v[o]);
        else
            memset(r.u[o], 0, sizeof r.u[o]), memset(r.v[o], 0, sizeof r.v[o]);
    }
    l4 doubt, touched = small_touched(&p, axes, &doubt);
    memcpy(r.touched, &touched, sizeof touched);
    memcpy(r.doubt, &doubt, sizeof doubt);
    if (s->out->count + 32 > PBS_FRAGMENTS) s->out->flush(s->out->ctx, s->out);
    for (int i = 0; i < count; i++) {
        int order[3] = {axis[i][0], axis[i][1], axis[i][2]};
        small_emit(s, index[i], order, axes, &r, i);
    }
}
#endif
