/* separate.c: the six-separating cells of triangles (paper 2, section 3; Laine 2013).
 *
 * Most triangles of a detailed scene are smaller than a cell and hold no middle of a pixel, seen
 * along any axis: four at a time are looked at until that is known. Those that are small but hold
 * some are finished four at a time as well, if doubles decide. What is larger, or undecided, is
 * drawn row by row.
 *
 * The file is compiled twice, for any processor and, by separate_avx2.c, for AVX2.
 */
#include "libcore/voxels/separate_inner.h"

#ifndef PBS_SEPARATE_NAME
#define PBS_SEPARATE_NAME(name) name
#define PBS_SEPARATE_ONCE
#endif

#define LOW  (-1)      /* the cells of the block and the layer around it */
#define HIGH PBS_BLOCK /* the last of them */
#define SIDE (PBS_BLOCK + 2)

static uint32_t cell_step(int axis) {
    return (uint32_t)1 << 7 * axis;
}

/* ---- lines that run within the triangle's plane ---- */

/* The cells of a line along axis a from depth cell e to f, in either order. */
static void put_interval(const shape *s, int a, const int at[3], int e, int f, pbs_hits *out) {
    int lo = e < f ? e : f, hi = e < f ? f : e, c[3] = {at[0], at[1], at[2]};
    lo = lo > LOW ? lo : LOW;
    hi = hi < HIGH ? hi : HIGH;
    if (lo > hi) return;
    c[a] = lo;
    hits_run(out, PBS_CELL(c[0], c[1], c[2]), cell_step(a), hi - lo + 1, s->number[0]);
}

/* Corners along an axis, lowest first. Returns whether that is an odd permutation. */
static bool sort_corners(const shape *s, int axis, const double *o[3]) {
    bool odd = false;
    for (int i = 0; i < 3; i++) o[i] = s->p[i];
    for (int i = 0; i < 3; i++) {
        const double **x = i == 1 ? o + 1 : o;
        if (x[0][axis] <= x[1][axis]) continue;
        const double *swap = x[0];
        x[0] = x[1], x[1] = swap;
        odd = !odd;
    }
    return odd;
}

/* The two sides of a section through a triangle whose corners o are sorted by row: the long edge,
 * and what is opposite to it, whose corner is at `row`. */
typedef struct section {
    side across, lower, upper;
    double row;
} section;

static inline section section_of(const double *const o[3], int row, int axis) {
    return (section){side_of(o[0], o[2], row, axis), side_of(o[0], o[1], row, axis),
                     side_of(o[1], o[2], row, axis), o[1][row]};
}

static inline const side *section_other(const section *s, double row) {
    return row < s->row ? &s->lower : &s->upper;
}

/* Seen along axis a the triangle is a segment, or a point. */
static void draw_edge_on(const shape *s, int a, pbs_hits *out) {
    int u = (a + 1) % 3, v = (a + 2) % 3, at[3];
    if (s->max[v] - s->min[v] > s->max[u] - s->min[u]) v = u, u = (a + 2) % 3;
    at[a] = 0;
    if (s->max[u] == s->min[u]) {
        at[u] = s->first[u], at[v] = s->first[v];
        put_interval(s, a, at, (int)floor(s->min[a]), (int)floor(s->max[a]), out);
        return;
    }
    const double *o[3];
    sort_corners(s, u, o);
    side line = side_of(o[0], o[2], u, v);
    section depth = section_of(o, u, a);
    bool along = s->max[v] == s->min[v]; /* an axis: all of the segment is at the middle */
    at[v] = s->first[v];
    for (at[u] = s->first[u]; at[u] <= s->last[u]; at[u]++) {
        double row = at[u] + 0.5;
        if (!along) at[v] = side_ceil(&line, row, 0.5);
        if (!along && at[v] != side_floor(&line, row, 0.5)) continue;
        if (at[v] < LOW || at[v] > HIGH) continue;
        int e = side_floor(&depth.across, row, 0);
        put_interval(s, a, at, e, side_floor(section_other(&depth, row), row, 0), out);
    }
}

/* ---- lines that cross the plane ---- */

/* Depth as a function of the line's cell: at + (row - from[0]) * slope[0] + (column - from[1]) *
 * slope[1].
 * error is more than all rounding errors of what is looked at. */
typedef struct plane {
    shape *s;
    int a, row, column;
    double at, from[2], slope[2], error;
    bool cut;                              /* whether depths may be outside the block */
    enum { UNKNOWN, LATTICE, NONE } whole; /* whether these are there: */
    int64_t base, step[2];                 /* depth = (base + row * step[0] + ..) * 2^-48 */
} plane;

static double farther(double from, const shape *s, int axis) {
    double a = fabs(s->first[axis] - from), b = fabs(s->last[axis] - from);
    return a > b ? a : b;
}

/* Two components of the normal have errors of 2^-44, so a slope has one of 2^-42.9; the rest of
 * 2^-42 is for the rounding of what is computed with them. A plane across the axis is exact. */
static void plane_of(plane *p, shape *s, int a, int row, int column) {
    *p = (plane){s, a, row, column, .at = s->p[0][a]};
    p->from[0] = s->p[0][row] - 0.5, p->from[1] = s->p[0][column] - 0.5;
    p->slope[0] = -s->n[row] / s->n[a], p->slope[1] = -s->n[column] / s->n[a];
    p->cut = s->min[a] < LOW || s->max[a] >= HIGH + 1;
    if (s->n[row] == 0 && s->n[column] == 0) return;
    p->error = 0x1p-42 * (fabs(p->at) + fabs(p->slope[0]) * farther(p->from[0], s, row) +
                          fabs(p->slope[1]) * farther(p->from[1], s, column));
}

/* The cell of a depth that doubles do not decide; LOW - 1 or HIGH + 1 if it is further out. */
__attribute__((noinline)) static int depth_exact(const plane *p, const int at[3], double z) {
    if (p->error < 0.25) {
        if (z > HIGH + 2 || z < LOW - 1) return LOW - 1;
        int k = (int)floor(z + p->error);
        return depth_at_least(p->s, p->a, at, k) ? k : k - 1;
    }
    int lo = LOW - 1, hi = HIGH + 2; /* at least lo, as far as we care; less than hi */
    while (hi - lo > 1) {
        int middle = lo + (hi - lo) / 2;
        if (depth_at_least(p->s, p->a, at, middle))
            lo = middle;
        else
            hi = middle;
    }
    return lo;
}

/* The lanes in `open` of k, the floors of the depths z; lane 0 is at column c. */
static d4 decide(const plane *p, int row, int c, d4 z, d4 k, unsigned open) {
    double depth[4], cell[4];
    int at[3];
    at[p->row] = row, at[p->a] = 0;
    d4_put(depth, z), d4_put(cell, k);
    for (; open; open &= open - 1) {
        int i = __builtin_ctz(open);
        at[p->column] = c + i;
        cell[i] = depth_exact(p, at, depth[i]);
    }
    return d4_at(cell);
}

/* Slopes that are multiples of 2^-16, as of chamfers on a lattice: depths are whole numbers of
 * 2^-48, so all that is needed is 64 bits. There, many depths are on the border of two cells. */
static bool plane_is_whole(plane *p) {
    if (p->whole != UNKNOWN) return p->whole == LATTICE;
    const double *at = p->s->p[0];
    pbs_int128 base = (pbs_int128)pbs_fixed(at[p->a]) * 65536;
    p->whole = NONE;
    for (int i = 0; i < 2; i++) {
        int axis = i ? p->column : p->row;
        if (!(fabs(p->slope[i]) < 64)) return false;
        int64_t slope = (int64_t)floor(p->slope[i] * 0x1p16 + 0.5);
        pbs_wide a = pbs_wide_mul64(normal_exact(p->s, p->a), slope);
        pbs_wide b = pbs_wide_mul64(normal_exact(p->s, axis), -65536);
        if (pbs_wide_compare(a, b) != 0) return false;
        base += (pbs_int128)(PBS_FIXED_ONE / 2 - pbs_fixed(at[axis])) * slope;
        p->step[i] = slope * PBS_FIXED_ONE;
    }
    p->base = (int64_t)base;
    if (base < -((int64_t)1 << 62) || base > (int64_t)1 << 62) return false;
    p->whole = LATTICE;
    return true;
}

/* Columns c0 .. c1 of a row of such a plane. */
static void draw_whole(const plane *p, int row, int c0, int c1, pbs_hits *out) {
    uint32_t step = cell_step(p->column), deep = cell_step(p->a);
    uint32_t cell = PBS_CELL(0, 0, 0) + (uint32_t)row * cell_step(p->row) + (uint32_t)c0 * step;
    int64_t z = p->base + row * p->step[0] + c0 * p->step[1];
    for (int c = c0; c <= c1; c++, cell += step, z += p->step[1]) {
        int64_t k = z >> 48;
        out->hit[out->count] = (pbs_hit){cell + (uint32_t)k * deep, p->s->number[0]};
        out->count += k >= LOW && k <= HIGH;
    }
}

/* Narrows the columns to those whose depths may be in the block. */
static void cut_columns(const plane *p, double row_z, double *c0, double *c1) {
    double slope = p->slope[1], margin = p->error + 0x1p-10;
    if (slope == 0) return;
    double x = p->from[1] + (LOW - margin - row_z) / slope;
    double y = p->from[1] + (HIGH + 1 + margin - row_z) / slope;
    double lo = ceil((slope > 0 ? x : y) - 0x1p-10), hi = floor((slope > 0 ? y : x) + 0x1p-10);
    *c0 = lo > *c0 ? lo : *c0;
    *c1 = hi < *c1 ? hi : *c1;
}

/* One row, columns c0 .. c1, which are in the block or its layer. */
static inline void draw_row(plane *p, int row, double c0, double c1, pbs_hits *out) {
    double row_z = p->at + (row - p->from[0]) * p->slope[0];
    if (p->cut) cut_columns(p, row_z, &c0, &c1);
    const d4 error = d4_all(p->error), from = d4_all(p->from[1]), last = d4_all(c1);
    const d4 slope = d4_all(p->slope[1]), base = d4_all(row_z);
    const d4 step = d4_all(cell_step(p->column)), deep = d4_all(cell_step(p->a));
    d4 column = d4_add(d4_all(c0), d4_ramp());
    d4 cells = d4_all(PBS_CELL(0, 0, 0) + row * (double)cell_step(p->row));
    cells = d4_add(cells, d4_mul(column, step));
    hits_room(out, SIDE);
    for (double c = c0; c <= c1; c += 4) {
        unsigned in = 15 & ~d4_less(last, column);
        d4 z = d4_add(base, d4_mul(d4_sub(column, from), slope));
        d4 k = d4_floor(d4_add(z, error));
        unsigned open = d4_differ(k, d4_floor(d4_sub(z, error))) & in;
        if (open && plane_is_whole(p)) {
            draw_whole(p, row, (int)c, (int)c1, out);
            return;
        }
        if (open) k = decide(p, row, (int)c, z, k, open);
        if (p->cut) in &= d4_less(d4_all(LOW - 1), k) & d4_less(k, d4_all(HIGH + 1));
        hits_put(out, d4_add(cells, d4_mul(k, deep)), p->s->number, in);
        column = d4_add(column, d4_all(4)), cells = d4_add(cells, d4_mul(step, d4_all(4)));
    }
}

/* The first and last columns between the edges, of n rows from `first`, at most four. high: the
 * corner that is not of the long edge is above it. */
typedef struct ends {
    double c0[4], c1[4];
} ends;

static inline void ends_of(ends *o, const section *s, bool high, int first, int n) {
    d4 row = d4_add(d4_add(d4_all(first), d4_ramp()), d4_all(0.5));
    d4 across = side_at(&s->across, row), middle = d4_all(s->row);
    d4 other = d4_if_less(row, middle, side_at(&s->lower, row), side_at(&s->upper, row));
    d4 e = d4_all(s->across.error);
    d4 f = d4_if_less(row, middle, d4_all(s->lower.error), d4_all(s->upper.error));
    d4 lo = d4_sub(high ? across : other, d4_all(0.5)), lo_error = high ? e : f;
    d4 hi = d4_sub(high ? other : across, d4_all(0.5)), hi_error = high ? f : e;
    d4 least = d4_ceil(d4_sub(lo, lo_error)), most = d4_floor(d4_add(hi, hi_error));
    unsigned open = d4_differ(least, d4_ceil(d4_add(lo, lo_error)));
    open |= d4_differ(most, d4_floor(d4_sub(hi, hi_error)));
    d4_put(o->c0, least), d4_put(o->c1, most);
    for (open &= n < 4 ? (1u << n) - 1 : 15; open; open &= open - 1) {
        int i = __builtin_ctz(open);
        double at = first + i + 0.5;
        const side *t = section_other(s, at);
        o->c0[i] = side_ceil(high ? &s->across : t, at, 0.5);
        o->c1[i] = side_floor(high ? t : &s->across, at, 0.5);
    }
}

static void draw_plane(shape *s, int a, pbs_hits *out) {
    int row = (a + 1) % 3, column = (a + 2) % 3;
    if (s->last[row] - s->first[row] > s->last[column] - s->first[column])
        column = row, row = (a + 2) % 3;
    const double *o[3];
    bool odd = sort_corners(s, row, o);
    /* Whether the middle corner is on the high side of the edge between the others. */
    bool high = (s->n[a] > 0) ^ odd ^ (column != (a + 1) % 3);
    section edges = section_of(o, row, column);
    plane p;
    plane_of(&p, s, a, row, column);
    double first = s->first[column], last = s->last[column];
    for (int r = s->first[row]; r <= s->last[row]; r += 4) {
        int n = s->last[row] - r + 1 < 4 ? s->last[row] - r + 1 : 4;
        ends end;
        ends_of(&end, &edges, high, r, n);
        for (int i = 0; i < n; i++) {
            double c0 = end.c0[i] > first ? end.c0[i] : first;
            double c1 = end.c1[i] < last ? end.c1[i] : last;
            if (c0 <= c1) draw_row(&p, r + i, c0, c1, out);
        }
    }
}

/* ---- whole triangles ---- */

/* Whether the box of block and layer is on one side of the triangle's plane, or of the triangle
 * seen along an axis: a separating axis, in doubles with a margin. */
static bool misses(const shape *s) {
    const double middle = (LOW + HIGH + 1) * 0.5, half = (HIGH + 1 - LOW) * 0.5;
    double q[3][3], at = 0, reach = 0, size = 0;
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 3; k++) q[c][k] = s->p[c][k] - middle;
    for (int k = 0; k < 3; k++) {
        at += s->n[k] * q[0][k];
        size += fabs(s->n[k]) * fabs(q[0][k]), reach += fabs(s->n[k]) * half;
    }
    if (fabs(at) > reach * (1 + 0x1p-30) + size * 0x1p-40) return true;
    for (int a = 0; a < 3; a++) {
        int u = (a + 1) % 3, v = (a + 2) % 3;
        for (int c = 0; c < 3; c++) {
            const double *b = q[c], *e = q[(c + 1) % 3];
            double du = e[u] - b[u], dv = e[v] - b[v];
            double f = dv * b[u] - du * b[v]; /* at the middle; inside it has the sign of n */
            double margin = (fabs(du) + fabs(dv)) * half * (1 + 0x1p-30) +
                            (fabs(dv * b[u]) + fabs(du * b[v])) * 0x1p-40;
            if (f < -margin && s->n[a] >= 0) return true;
            if (f > margin && s->n[a] <= 0) return true;
        }
    }
    return false;
}

/* Whether the triangle is in a plane across axis a, at middles: then all its cells along that axis
 * are also those of lines within the plane. */
static bool is_in_lines(const shape *s, int a) {
    return s->n[(a + 1) % 3] == 0 && s->n[(a + 2) % 3] == 0 && s->n[a] != 0 &&
           s->min[a] - floor(s->min[a]) == 0.5;
}

/* axes: bit a: draw it as seen along axis a. */
static void draw(const pbs_triangles *t, uint32_t i, unsigned axes, pbs_hits *out) {
    shape s;
    bool large = false, cut = false;
    s.exact = false;
    for (int k = 0; k < 4; k++) s.number[k] = i;
    for (int k = 0; k < 3; k++) {
        for (int c = 0; c < 3; c++) s.p[c][k] = t->p[c][k][i];
        s.min[k] = t->min[k][i], s.max[k] = t->max[k][i];
        double first = ceil(s.min[k] - 0.5), last = floor(s.max[k] - 0.5);
        s.first[k] = first > HIGH ? HIGH + 1 : first > LOW ? (int)first : LOW;
        s.last[k] = last < LOW ? LOW - 1 : last < HIGH ? (int)last : HIGH;
        large |= s.max[k] - s.min[k] > 8;
        cut |= s.min[k] < LOW || s.max[k] > HIGH + 1;
    }
    shape_normal(&s);
    if (large && cut && misses(&s)) return;
    for (int a = 0; a < 3; a++) {
        if (!(axes >> a & 1) || is_in_lines(&s, a)) continue;
        if (s.n[a] == 0)
            draw_edge_on(&s, a, out);
        else
            draw_plane(&s, a, out);
    }
}

/* ---- four triangles ---- */

/* Triangles smaller than this are walked through in doubles, middle by middle. Relative to the
 * first middle all coordinates are below 2^3, so an edge function there has an error of at most
 * 2^-45; it stays below 2^7, so that each of at most 14 steps adds 2^-46. All is below 2^-42.
 *
 * The three sum to the area and are turned to its sign, or what seems to be its sign. If all are
 * above the error, that was right. If one is below -16 errors, and the sum was wrong, another is
 * above the error: outside in any case. */
#define SMALL       8
#define SMALL_ERROR 0x1p-42
#define SMALL_OUT   (-16 * SMALL_ERROR)

/* Four triangles seen along axis a: corners relative to the first middle in the box, and depths
 * over the lowest. */
typedef struct four {
    int a, u, v;
    uint32_t index[4];
    d4 x[3], y[3], z[3];
    d4 first_u, first_v, low, high;
} four;

static inline d4 min3(const d4 a[3]) {
    return d4_min(d4_min(a[0], a[1]), a[2]);
}
static inline d4 max3(const d4 a[3]) {
    return d4_max(d4_max(a[0], a[1]), a[2]);
}

static inline d4 first_middle(d4 min) {
    return d4_max(d4_ceil(d4_sub(min, d4_all(0.5))), d4_all(LOW));
}

static inline void four_of(four *f, const pbs_triangles *t, int a) {
    f->a = a, f->u = (a + 1) % 3, f->v = (a + 2) % 3;
    for (int c = 0; c < 3; c++) {
        f->x[c] = d4_of(t->p[c][f->u], f->index), f->y[c] = d4_of(t->p[c][f->v], f->index);
        f->z[c] = d4_of(t->p[c][a], f->index);
    }
    f->low = min3(f->z), f->high = max3(f->z);
    f->first_u = first_middle(min3(f->x)), f->first_v = first_middle(min3(f->y));
    d4 u = d4_add(f->first_u, d4_all(0.5)), v = d4_add(f->first_v, d4_all(0.5));
    for (int c = 0; c < 3; c++) {
        f->x[c] = d4_sub(f->x[c], u), f->y[c] = d4_sub(f->y[c], v);
        f->z[c] = d4_sub(f->z[c], f->low);
    }
}

/* PBS_CELL of the first middles, with depth 0. */
static inline d4 four_code(const four *f) {
    d4 u = d4_mul(f->first_u, d4_all(cell_step(f->u)));
    d4 v = d4_mul(f->first_v, d4_all(cell_step(f->v)));
    return d4_add(d4_add(u, v), d4_all(PBS_CELL(0, 0, 0)));
}

/* The edge functions at the first middle, and the sum of the edge functions weighted with the
 * depths; positive inside. */
static inline d4 edges_of(const four *f, d4 e[4]) {
    for (int c = 0; c < 3; c++) {
        int p = (c + 1) % 3, q = (c + 2) % 3;
        e[c] = d4_sub(d4_mul(f->x[p], f->y[q]), d4_mul(f->y[p], f->x[q]));
    }
    d4 area = d4_add(d4_add(e[0], e[1]), e[2]);
    for (int c = 0; c < 3; c++) e[c] = d4_turn(e[c], area);
    e[3] = d4_dot3(e, f->z);
    return area;
}

/* How the cells of four depths are found: depth = low + e[3] * share. */
typedef struct depths {
    d4 low, share, error, floor_low, floor_high;
} depths;

/* e[3] is below 2^9 range, and with its 14 steps has an error below 2^-39 range; that of the area
 * is below 2^-43, and of the depth, in the mean's place, at most as much of the range. */
static inline void depths_of(depths *d, const four *f, d4 area) {
    d->low = f->low, d->share = d4_div(d4_all(1), d4_abs(area));
    d->error = d4_add(d4_mul(d->share, d4_all(0x1p-38)), d4_all(0x1p-50));
    d->error = d4_add(d4_mul(d->error, d4_sub(f->high, f->low)), d4_all(0x1p-32));
    d->floor_low = d4_floor(f->low), d->floor_high = d4_floor(f->high);
}

/* Appends the cells of the lanes in `in` that are in the block and its layer. Returns the lanes
 * that are not decided. */
static inline unsigned put_depths(const depths *d, const four *f, d4 e, d4 code, unsigned in,
                                  pbs_hits *out) {
    d4 z = d4_add(d->low, d4_mul(e, d->share));
    d4 cell = d4_max(d4_floor(d4_sub(z, d->error)), d->floor_low);
    unsigned open = d4_differ(cell, d4_min(d4_floor(d4_add(z, d->error)), d->floor_high)) & in;
    in &= ~open & d4_less(d4_all(LOW - 1), cell) & d4_less(cell, d4_all(HIGH + 1));
    hits_put(out, d4_add(code, d4_mul(cell, d4_all(cell_step(f->a)))), f->index, in);
    return open;
}

/* Of these, every box holds one middle. Returns the lanes that are not decided. */
static unsigned draw_single(const pbs_triangles *t, four *f, int a, unsigned lanes, pbs_hits *out) {
    d4 e[4];
    depths d;
    four_of(f, t, a);
    d4 area = edges_of(f, e), least = min3(e);
    unsigned in = lanes & ~d4_less(least, d4_all(SMALL_OUT));
    if (!in) return 0;
    depths_of(&d, f, area);
    hits_room(out, 4);
    unsigned sure = in & d4_less(d4_all(SMALL_ERROR), least);
    return (in & ~sure) | put_depths(&d, f, e[3], four_code(f), sure, out);
}

/* What edges_of says changes by from column to column and row to row, and the columns and rows
 * beside the first. */
typedef struct walk {
    d4 column[4], row[4], columns, rows;
} walk;

static inline void walk_of(walk *w, const four *f, d4 area) {
    for (int c = 0; c < 3; c++) {
        int p = (c + 1) % 3, q = (c + 2) % 3;
        w->column[c] = d4_turn(d4_sub(f->y[p], f->y[q]), area);
        w->row[c] = d4_turn(d4_sub(f->x[q], f->x[p]), area);
    }
    w->column[3] = d4_dot3(w->column, f->z), w->row[3] = d4_dot3(w->row, f->z);
    w->columns = d4_min(d4_floor(max3(f->x)), d4_sub(d4_all(HIGH), f->first_u));
    w->rows = d4_min(d4_floor(max3(f->y)), d4_sub(d4_all(HIGH), f->first_v));
}

/* Of these, boxes hold some middles. Returns the lanes that are not decided. */
static unsigned draw_small(const pbs_triangles *t, four *f, int a, unsigned lanes, pbs_hits *out) {
    const d4 zero = d4_all(0), one = d4_all(1);
    const d4 open = d4_all(SMALL_ERROR), minus = d4_all(SMALL_OUT);
    d4 e[4];
    walk w;
    depths deep;
    four_of(f, t, a);
    d4 area = edges_of(f, e), code = four_code(f);
    const d4 step_u = d4_all(cell_step(f->u)), step_v = d4_all(cell_step(f->v));
    walk_of(&w, f, area);
    depths_of(&deep, f, area);
    unsigned undecided = 0;
    for (unsigned row = lanes; row;) {
        d4 e0 = e[0], e1 = e[1], e2 = e[2], e3 = e[3], cells = code, columns = w.columns;
        hits_room(out, 4 * SMALL);
        for (unsigned in = row; in;) {
            d4 least = d4_min(d4_min(e0, e1), e2);
            unsigned now = in & ~d4_less(least, minus);
            if (now) {
                unsigned sure = now & ~undecided & d4_less(open, least);
                undecided |= now & ~sure;
                undecided |= put_depths(&deep, f, e3, cells, sure, out);
            }
            columns = d4_sub(columns, one), in &= ~d4_less(columns, zero);
            e0 = d4_add(e0, w.column[0]), e1 = d4_add(e1, w.column[1]);
            e2 = d4_add(e2, w.column[2]), e3 = d4_add(e3, w.column[3]);
            cells = d4_add(cells, step_u);
        }
        w.rows = d4_sub(w.rows, one), row &= ~d4_less(w.rows, zero) & ~undecided;
        for (int c = 0; c < 4; c++) e[c] = d4_add(e[c], w.row[c]);
        code = d4_add(code, step_v);
    }
    return undecided;
}

/* ---- batches ---- */

/* Bit i: triangle i. */
typedef struct found {
    uint64_t axis[3]; /* the box holds middles of the lines along the axis */
    uint64_t more[3]; /* not only one */
    uint64_t large;
} found;

/* Looks at the boxes of triangles first .. first + 3. */
static inline void look(const pbs_triangles *t, uint32_t first, found *out) {
    const d4 zero = d4_all(0);
    d4 more[3], size = zero, near = zero;
    for (int k = 0; k < 3; k++) {
        d4 min = d4_at(t->min[k] + first), max = d4_at(t->max[k] + first);
        d4 middle = first_middle(min);
        more[k] = d4_sub(d4_min(d4_floor(d4_sub(max, d4_all(0.5))), d4_all(HIGH)), middle);
        size = d4_max(size, d4_sub(max, min));
        near = d4_min(near, d4_min(d4_sub(max, d4_all(LOW)), d4_sub(d4_all(HIGH + 1), min)));
    }
    for (int a = 0; a < 3; a++) {
        d4 u = more[(a + 1) % 3], v = more[(a + 2) % 3];
        uint64_t axis = 15 & ~d4_less(d4_min(near, d4_min(u, v)), zero);
        out->axis[a] |= axis << first;
        out->more[a] |= (uint64_t)d4_less(zero, d4_max(u, v)) << first;
    }
    out->large |= (uint64_t)(15 & ~d4_less(size, d4_all(SMALL))) << first;
}

/* Draws the triangles of a set, four at a time. Returns those that are not decided. */
typedef unsigned (*draw_four)(const pbs_triangles *t, four *f, int a, unsigned lanes,
                              pbs_hits *out);
static inline uint64_t draw_set(const pbs_triangles *t, int a, uint64_t set, draw_four work,
                                pbs_hits *out) {
    uint64_t rest = 0;
    while (set) {
        four f;
        int n = 0;
        for (int i = 0; i < 4; i++) {
            f.index[i] = set ? (uint32_t)__builtin_ctzll(set) : f.index[0];
            n += set != 0;
            set &= set - (set != 0);
        }
        for (unsigned open = work(t, &f, a, (1u << n) - 1, out); open; open &= open - 1)
            rest |= (uint64_t)1 << f.index[__builtin_ctz(open)];
    }
    return rest;
}

#if defined(__x86_64__) && defined(__GNUC__)
#define PBS_SEPARATE_AVX2
#endif

void PBS_SEPARATE_NAME(pbs_separate_all)(const pbs_triangles *t, pbs_hits *out) {
    found f = {{0}, {0}, 0};
    uint64_t all = t->count < 64 ? ((uint64_t)1 << t->count) - 1 : ~(uint64_t)0, rest[3];
    for (uint32_t i = 0; i < t->count; i += 4) look(t, i, &f);
    for (int a = 0; a < 3; a++) {
        uint64_t small = f.axis[a] & all & ~f.large;
        rest[a] = f.axis[a] & all & f.large;
        rest[a] |= draw_set(t, a, small & ~f.more[a], draw_single, out);
        rest[a] |= draw_set(t, a, small & f.more[a], draw_small, out);
    }
    for (uint64_t any = rest[0] | rest[1] | rest[2]; any; any &= any - 1) {
        int i = __builtin_ctzll(any);
        unsigned axes = rest[0] >> i & 1;
        axes |= (rest[1] >> i & 1) << 1 | (rest[2] >> i & 1) << 2;
        draw(t, (uint32_t)i, axes, out);
    }
}

#ifdef PBS_SEPARATE_ONCE
void pbs_separate(const pbs_triangles *t, bool simd, pbs_hits *out) {
#ifdef PBS_SEPARATE_AVX2
    if (simd && __builtin_cpu_supports("avx2")) {
        pbs_separate_all_avx2(t, out);
        return;
    }
#else
    (void)simd;
#endif
    pbs_separate_all(t, out);
}
#endif
