/* clip_pixel_inner.h: the pieces of a large triangle above four pixels at a time.
 *
 * A pixel is two triangles; each is cut by the planes between the cells above it, and by the edges
 * of the large triangle that cross it, as in clip_small_inner.h. Everything is relative to the
 * pixel, and heights are relative to a whole number near the plane, so that the size of the
 * triangle and slopes of next to nothing do no harm.
 */
#ifndef PBS_CLIP_PIXEL_INNER_H
#define PBS_CLIP_PIXEL_INNER_H

#include "libcore/voxels/clip_row_inner.h"

/* The pixels of a triangle that wait for being four. */
typedef struct clip_pixels {
    int count;
    int8_t at[4][2];
} clip_pixels;

typedef struct pixel_four {
    d4 height[4];  /* at the corners 00, 10, 01, 11 */
    d4 edge[2][4]; /* of the edges that cross a pixel; positive inside */
    d4 first;      /* of the cells above it, relative to job->level */
    l4 crowded;    /* all three edges cross it: left to clip_cell */
    bool one, two; /* whether any pixel has so many edges */
    l4 cut, cut2;  /* pixels above which it crosses a plane, two of them */
} pixel_four;

LANE void pixel_corners(d4 base, double du, double dv, d4 out[4]) {
    out[0] = base, out[1] = base + du, out[2] = base + dv, out[3] = base + (du + dv);
}
LANE d4 pixel_least(const d4 x[4]) {
    return min4(min4(x[0], x[1]), min4(x[2], x[3]));
}
LANE d4 pixel_most(const d4 x[4]) {
    return max4(max4(x[0], x[1]), max4(x[2], x[3]));
}
LANE bool any4(l4 mask) {
    return bits4(mask) != 0;
}

LANE void pixel_edges(const clip_job *job, d4 u, d4 v, pixel_four *f) {
    d4 e[3][4];
    l4 crosses[3];
    double turn = job->normal[2] > 0 ? 1 : -1;
    UNROLL
    for (int k = 0; k < 3; k++) {
        double du = turn * job->d[k][0], dv = turn * job->d[k][1];
        pixel_corners(du * (v - job->p[k][1]) - dv * (u - job->p[k][0]), -dv, du, e[k]);
        crosses[k] = (l4)(pixel_least(e[k]) < 0);
    }
    l4 second = crosses[0] & crosses[1], third = (crosses[0] | crosses[1]) & crosses[2] & ~second;
    UNROLL
    for (int c = 0; c < 4; c++) {
        f->edge[0][c] = pick(crosses[0], e[0][c], pick(crosses[1], e[1][c], e[2][c]));
        f->edge[1][c] = pick(second, e[1][c], pick(third, e[2][c], all4(1)));
    }
    f->crowded = second & crosses[2];
    f->two = any4(second | third);
}

/* Less the tips of two edges: what is inside of both, below the plane of an axis if it is not 0. */
LANE mass4 pixel_inside(const part4 *p, const part4 *tip, l4 below0, l4 below1, l4 below01,
                        bool two, int axis, int axes, bool centroids) {
    mass4 w, x, y, xy;
    if (axis) {
        w = part_below(p, axis, axes, centroids, NULL);
        x = part_below(&tip[0], axis, axes, centroids, NULL);
    } else {
        w = part_mass(p, centroids), x = part_mass(&tip[0], centroids);
    }
    mass4 outside = mass_pick(below0, x, mass_less(w, x));
    if (!two) return mass_less(w, outside);
    if (axis) {
        y = part_below(&tip[1], axis, axes, centroids, NULL);
        xy = part_below(&tip[2], axis, axes, centroids, NULL);
    } else {
        y = part_mass(&tip[1], centroids), xy = part_mass(&tip[2], centroids);
    }
    mass4 outside1 = mass_pick(below1, y, mass_less(w, y));
    mass4 both = mass_pick(below01, xy, mass_less(x, xy)); /* of the tip, outside of the second */
    both = mass_pick(below0, both, mass_less(outside1, both));
    return mass_less(mass_less(w, outside), mass_less(outside1, both));
}

/* Adds one of the pixel's two triangles: what is inside in all, below the first plane, below the
 * second. */
LANE void pixel_half(const pixel_four *f, const int corner[3], bool edges, bool two, int cuts,
                     bool centroids, mass4 sum[3]) {
    part4 p, tip[3];
    l4 below0 = {0}, below1 = {0}, below01 = {0};
    int axes = 2 + cuts;
    p.f = all4(0.5);
    UNROLL
    for (int c = 0; c < 3; c++) {
        int at = corner[c];
        p.a[c] = all4(at & 1), p.b[c] = all4(at >> 1);
        p.x[0][c] = f->edge[0][at], p.x[1][c] = f->edge[1][at];
        p.x[2][c] = f->height[at] - (f->first + 1);
        p.x[3][c] = f->height[at] - (f->first + 2);
    }
    if (edges) {
        tip4 t = tip_of(p.x[0]);
        below0 = t.below;
        tip[0] = part_tip(&p, &t, axes, centroids);
        if (two) {
            tip4 y = tip_of(p.x[1]), xy = tip_of(tip[0].x[1]);
            below1 = y.below, below01 = xy.below;
            tip[1] = part_tip(&p, &y, axes, centroids);
            tip[2] = part_tip(&tip[0], &xy, axes, centroids);
        }
    }
    UNROLL
    for (int k = 0; k <= cuts; k++) {
        mass4 m;
        int axis = k ? 1 + k : 0;
        if (edges)
            m = pixel_inside(&p, tip, below0, below1, below01, two, axis, axes, centroids);
        else
            m = axis ? part_below(&p, axis, axes, centroids, NULL) : part_mass(&p, centroids);
        sum[k] = (mass4){sum[k].f + m.f, sum[k].a + m.a, sum[k].b + m.b};
    }
}

LANE void pixel_halves(const pixel_four *f, bool edges, bool two, int cuts, bool centroids,
                       mass4 sum[3]) {
    static const int low[3] = {0, 1, 2}, high[3] = {3, 2, 1};
    pixel_half(f, low, edges, two, cuts, centroids, sum);
    pixel_half(f, high, edges, two, cuts, centroids, sum);
}

/* Of the cells above the pixels: the first three. What lies beyond a plane only because the plane
 * of the triangle goes on behind its ends stays below it, whatever the other pixels need. */
LANE void pixel_masses(const pixel_four *f, bool edges, bool centroids, mass4 cell[3]) {
    mass4 zero = {all4(0), all4(0), all4(0)}, sum[3] = {zero, zero, zero};
    int cuts = any4(f->cut2) ? 2 : any4(f->cut) ? 1 : 0;
    if (!edges) {
        if (cuts == 0)
            pixel_halves(f, false, false, 0, centroids, sum);
        else if (cuts == 1)
            pixel_halves(f, false, false, 1, centroids, sum);
        else
            pixel_halves(f, false, false, 2, centroids, sum);
    } else if (!f->two) {
        if (cuts == 0)
            pixel_halves(f, true, false, 0, centroids, sum);
        else if (cuts == 1)
            pixel_halves(f, true, false, 1, centroids, sum);
        else
            pixel_halves(f, true, false, 2, centroids, sum);
    } else {
        if (cuts == 0)
            pixel_halves(f, true, true, 0, centroids, sum);
        else if (cuts == 1)
            pixel_halves(f, true, true, 1, centroids, sum);
        else
            pixel_halves(f, true, true, 2, centroids, sum);
    }
    mass4 top = cuts == 2 ? mass_pick(f->cut2, sum[2], sum[0]) : sum[0];
    cell[0] = cuts ? mass_pick(f->cut, sum[1], sum[0]) : sum[0];
    cell[1] = cuts ? mass_less(top, cell[0]) : zero;
    cell[2] = cuts == 2 ? mass_less(sum[0], top) : zero;
}

/* Of the cells first .. first + 2 above four pixels, [cell][pixel]. Bits of masks are in that
 * order, from the cell below the first on to the one above the last. */
typedef struct pixel_result {
    double area[3][4];
    float u[3][4], v[3][4];
    uint32_t sure, maybe, crowded; /* certainly touched; perhaps; pixels left to clip_cell */
    int first[4];
} pixel_result;

/* From places in the pixels to places in the triangle. */
LANE void pixel_place(const clip_job *job, const mass4 *m, d4 u, d4 v, float outu[4],
                      float outv[4]) {
    const d4 little = all4(0x1p-100), one = all4(1), zero = all4(0);
    d4 share = 1 / (3 * (max4(m->f, zero) + little));
    d4 x = min4(max4((m->a + little) * share, zero), one) + (u - job->p[0][0]);
    d4 y = min4(max4((m->b + little) * share, zero), one) + (v - job->p[0][1]);
    const double *to = job->place;
    put_place(outu, outv, to[0] * x + to[1] * y, to[2] * x + to[3] * y);
}

/* Which cells the plane passes, and are in the block; which of them hold certainly a piece. */
LANE void pixel_cells(const clip_job *job, const pixel_four *f, int count, d4 low, d4 high,
                      pixel_result *r) {
    double margin = job->even ? 0 : job->margin;
    d4 from = floor4(low - margin), to = floor4(high + margin);
    d4 lowest = max4(from, all4(job->lowest - job->level));
    d4 highest = min4(to, all4(job->highest - job->level));
    uint32_t pixels = (1u << count) - 1;
    r->crowded = bits4(f->crowded) & pixels, r->sure = r->maybe = 0;
    UNROLL
    for (int o = -1; o <= 3; o++) {
        d4 at = f->first + o;
        uint32_t in = bits4((l4)(at >= lowest) & (l4)(at <= highest)) & pixels, sure = 0;
        if (o >= 0 && o < 3)
            sure = in & ~r->crowded & bits4((l4)(at4(r->area[o]) > 32 * job->margin));
        r->sure |= sure << 4 * (o + 1), r->maybe |= (in & ~sure) << 4 * (o + 1);
    }
    i4 first = __builtin_convertvector(f->first + job->level, i4);
    memcpy(r->first, &first, sizeof first);
}

/* What is doubtful: a piece of next to nothing, or a pixel left to clip_cell. */
static void pixel_emit_maybe(const clip_job *job, clip_pixels *px, const pixel_result *r,
                             bool edges) {
    for (uint32_t bits = r->maybe; bits; bits &= bits - 1) {
        int i = __builtin_ctz(bits), o = i / 4 - 1, lane = i % 4, cell[3];
        const int place[3] = {px->at[lane][0], px->at[lane][1], r->first[lane] + o};
        if (clip_apart(&job->walls, place)) continue;
        if (r->crowded >> lane & 1) {
            clip_cell(job, place);
            continue;
        }
        cell[job->u] = place[0], cell[job->v] = place[1], cell[job->w] = place[2];
        if (!(edges ? pbs_clip_meets(job->corner, cell) : pbs_clip_meets_plane(job->corner, cell)))
            continue;
        bool known = o >= 0 && o < 3;
        clip_put(job->out, PBS_CELL(cell[0], cell[1], cell[2]), job->triangle,
                 known ? r->area[o][lane] : 0, known ? r->u[o][lane] : 0,
                 known ? r->v[o][lane] : 0);
    }
}

static void pixel_emit(const clip_job *job, clip_pixels *px, const pixel_result *r, bool edges) {
    pbs_fragments *out = job->out;
    uint32_t step[3] = {1u << 7 * job->u, 1u << 7 * job->v, 1u << 7 * job->w}, cell[4];
    for (int i = 0; i < 4; i++)
        cell[i] = PBS_CELL(0, 0, 0) + (uint32_t)px->at[i][0] * step[0] +
                  (uint32_t)px->at[i][1] * step[1] + (uint32_t)r->first[i] * step[2];
    if (out->count + 12 >= PBS_FRAGMENTS) out->flush(out->ctx, out);
    for (uint32_t bits = r->sure >> 4; bits; bits &= bits - 1) {
        int i = __builtin_ctz(bits), o = i / 4, lane = i % 4;
        out->fragment[out->count++] =
            (pbs_fragment){cell[lane] + (uint32_t)o * step[2], job->triangle, r->area[o][lane],
                           r->u[o][lane], r->v[o][lane]};
    }
    if (r->maybe) pixel_emit_maybe(job, px, r, edges);
}

LANE void pixel_flush_as(const clip_job *job, clip_pixels *px, bool edges, bool centroids) {
    pixel_four f;
    f.crowded = (l4)all4(0);
    pixel_result r;
    mass4 m[3];
    d4 u, v;
    UNROLL
    for (int i = 0; i < 4; i++) {
        u[i] = px->at[i][0], v[i] = px->at[i][1];
    }
    double g = job->slope[0], h = job->slope[1];
    pixel_corners((job->p[0][2] - job->level) + (g * (u - job->p[0][0]) + h * (v - job->p[0][1])),
                  g, h, f.height);
    d4 low = pixel_least(f.height), high = pixel_most(f.height);
    /* The plane goes on beyond the triangle's ends. */
    low = min4(max4(low, all4(job->low - job->level)), all4(job->high - job->level));
    high = max4(min4(high, all4(job->high - job->level)), low);
    f.first = floor4(low);
    f.cut = (l4)(high > f.first + 1), f.cut2 = (l4)(high > f.first + 2);
    if (edges) pixel_edges(job, u, v, &f);
    pixel_masses(&f, edges, centroids, m);
    UNROLL
    for (int k = 0; k < 3; k++) {
        put4(r.area[k], job->stretch * max4(m[k].f, all4(0)));
        if (centroids)
            pixel_place(job, &m[k], u, v, r.u[k], r.v[k]);
        else
            memset(r.u[k], 0, sizeof r.u[k]), memset(r.v[k], 0, sizeof r.v[k]);
    }
    pixel_cells(job, &f, px->count, low, high, &r);
    pixel_emit(job, px, &r, edges);
    px->count = 0;
}

static void pixel_flush(const clip_job *job, clip_pixels *px, bool edges) {
    if (!px->count) return;
    for (int i = px->count; i < 4; i++) memcpy(px->at[i], px->at[0], sizeof px->at[0]);
    if (edges) {
        if (job->centroids)
            pixel_flush_as(job, px, true, true);
        else
            pixel_flush_as(job, px, true, false);
    } else {
        if (job->centroids)
            pixel_flush_as(job, px, false, true);
        else
            pixel_flush_as(job, px, false, false);
    }
}

static inline void pixel_add(const clip_job *job, clip_pixels *px, int i, int j, bool edges) {
    px->at[px->count][0] = (int8_t)i, px->at[px->count++][1] = (int8_t)j;
    if (px->count == 4) pixel_flush(job, px, edges);
}

/* Few pixels that are covered are cut as if they were on edges: one vector of pixels, not two. */
static inline void pixel_join(clip_pixels px[2]) {
    if (px[0].count == 0 || px[0].count + px[1].count > 4) return;
    memcpy(px[0].at[px[0].count], px[1].at, sizeof px[1].at[0] * (size_t)px[1].count);
    px[0].count += px[1].count, px[1].count = 0;
}

/* Pixels that are covered, of a triangle across the axis: whole squares. */
static void pixel_squares(const clip_job *job, int j, int from, int to) {
    int at[3];
    const double *place = job->place;
    at[job->u] = from, at[job->v] = j, at[job->w] = clip_floor(job->p[0][2]);
    double y = j + 0.5 - job->p[0][1];
    uint32_t cell = PBS_CELL(at[0], at[1], at[2]), step = 1u << 7 * job->u;
    for (int i = from; i < to; i++, cell += step) {
        double x = i + 0.5 - job->p[0][0];
        if (job->centroids)
            clip_put_at(job->out, cell, job->triangle, 1, place[0] * x + place[1] * y,
                        place[2] * x + place[3] * y);
        else
            clip_put(job->out, cell, job->triangle, 1, 0, 0);
    }
}

static void pixel_row(const clip_job *job, const clip_rows *rows, int r, int j, clip_pixels px[2]) {
    int from = rows->from[r], to = rows->to[r], low = rows->low[r], high = rows->high[r];
    for (int i = from; i < low; i++) pixel_add(job, &px[0], i, j, true);
    if (job->even) pixel_squares(job, j, low, high);
    for (int i = low; i < high && !job->even; i++) pixel_add(job, &px[1], i, j, false);
    for (int i = high; i <= to; i++) pixel_add(job, &px[0], i, j, true);
}
#endif
