/* test_clip.c: the cells of triangles against integers, areas against a clipper in long double, and
 * laws. */
#include "libcore/voxels/clip.h"
#include "libcore/data/rng.h"
#include "tests/check.h"
#include <time.h>

/* ---- clipping, as a list ---- */

typedef struct list {
    size_t count, room;
    pbs_fragment *fragment;
} list;

static void take(void *ctx, pbs_fragments *f) {
    list *l = ctx;
    if (l->count + f->count > l->room) {
        l->room = 2 * l->room + PBS_FRAGMENTS;
        l->fragment = realloc(l->fragment, l->room * sizeof *l->fragment);
    }
    if (!f->count) return;
    memcpy(l->fragment + l->count, f->fragment, f->count * sizeof *f->fragment);
    l->count += f->count;
    f->count = 0;
}

static int by_cell(const void *a, const void *b) {
    const pbs_fragment *x = a, *y = b;
    if (x->triangle != y->triangle) return x->triangle < y->triangle ? -1 : 1;
    return x->cell < y->cell ? -1 : x->cell > y->cell;
}

typedef struct tri {
    double p[3][3];
} tri;

static void batch_add(pbs_triangles *b, const tri *t, const double at[3]) {
    uint32_t i = b->count++;
    for (int k = 0; k < 3; k++) {
        b->min[k][i] = INFINITY, b->max[k][i] = -INFINITY;
        for (int c = 0; c < 3; c++) {
            double x = t->p[c][k] - at[k];
            b->p[c][k][i] = x;
            b->min[k][i] = fmin(b->min[k][i], x), b->max[k][i] = fmax(b->max[k][i], x);
        }
    }
}

static void clip(const pbs_triangles *b, bool simd, list *l) {
    static pbs_fragments out;
    out.count = 0, out.flush = take, out.ctx = l;
    pbs_clip(b, true, simd, &out);
    take(l, &out);
}

/* The fragments of a triangle in the block at that place, sorted by cell. */
static list clipped(const tri *t, const double at[3]) {
    static pbs_triangles b;
    list l = {0};
    b.count = 0;
    batch_add(&b, t, at);
    clip(&b, false, &l);
    if (l.count) qsort(l.fragment, l.count, sizeof *l.fragment, by_cell);
    for (size_t i = 1; i < l.count; i++) CHECK(l.fragment[i].cell != l.fragment[i - 1].cell);
    return l;
}

static const double origin[3] = {0, 0, 0};

/* ---- oracles ---- */

typedef long double real;
static real dot(const real a[3], const real b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
static void cross(real out[3], const real a[3], const real b[3]) {
    for (int k = 0; k < 3; k++)
        out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

/* Area in low .. high, and its first moment. A triangle across an axis is moved up by 2^-45, so
 * that what lies in a face goes to the upper cell. -1: they do not meet. */
static real area_in(const tri *t, const real low[3], const real high[3], real moment[3]) {
    real from[12][3], to[12][3];
    int n = 3;
    for (int k = 0; k < 3; k++) {
        bool across = t->p[1][k] == t->p[0][k] && t->p[2][k] == t->p[0][k];
        for (int c = 0; c < 3; c++) from[c][k] = t->p[c][k] - low[k] + (across ? 0x1p-45L : 0);
    }
    for (int f = 0; f < 6; f++) {
        int k = f / 2, m = 0;
        real s = f & 1 ? -1 : 1, at = f & 1 ? low[k] - high[k] : 0;
        for (int i = 0; i < n; i++) {
            const real *p = from[i], *q = from[(i + 1) % n];
            real dp = s * p[k] - at, dq = s * q[k] - at;
            if (dp >= 0) memcpy(to[m++], p, sizeof from[0]);
            if ((dp >= 0) == (dq >= 0)) continue;
            for (int c = 0; c < 3; c++) to[m][c] = p[c] + dp / (dp - dq) * (q[c] - p[c]);
            to[m++][k] = s * at;
        }
        memcpy(from, to, sizeof from);
        n = m;
        if (!n) return -1;
    }
    real area = 0;
    moment[0] = moment[1] = moment[2] = 0;
    for (int i = 1; i + 1 < n; i++) {
        real a[3], b[3], c[3];
        for (int k = 0; k < 3; k++)
            a[k] = from[i][k] - from[0][k], b[k] = from[i + 1][k] - from[0][k];
        cross(c, a, b);
        real part = sqrtl(dot(c, c)) / 2;
        area += part;
        for (int k = 0; k < 3; k++) moment[k] += part * (low[k] + from[0][k] + (a[k] + b[k]) / 3);
    }
    return area;
}

static real cell_area(const tri *t, uint32_t cell, real grow, real moment[3]) {
    int c[3] = {PBS_CELL_X(cell), PBS_CELL_Y(cell), PBS_CELL_Z(cell)};
    real low[3], high[3];
    for (int k = 0; k < 3; k++) low[k] = c[k] - grow, high[k] = c[k] + 1 + grow;
    return area_in(t, low, high, moment);
}

/* Whether a triangle of coordinates below 2^6 with 9 bits behind the point meets a half-open cell.
 * The box ends 2^-49 below the cell's upper corner: no gap is so small, and so separating axes of
 * closed boxes decide. */
typedef __int128 wide;
static bool meets(const tri *t, const int cell[3]) {
    const wide unit = (wide)1 << 40;
    wide p[3][3], axis[13][3], low[3], high[3];
    for (int i = 0; i < 9; i++) p[i / 3][i % 3] = (wide)(t->p[i / 3][i % 3] * 512);
    for (int k = 0; k < 3; k++) low[k] = cell[k] * 512 * unit, high[k] = low[k] + 512 * unit - 1;
    memset(axis, 0, sizeof axis);
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        axis[k][k] = 1;
        axis[3][k] =
            (p[1][a] - p[0][a]) * (p[2][b] - p[0][b]) - (p[1][b] - p[0][b]) * (p[2][a] - p[0][a]);
        for (int e = 0; e < 3; e++) {
            axis[4 + 3 * k + e][a] = p[(e + 1) % 3][b] - p[e][b];
            axis[4 + 3 * k + e][b] = p[e][a] - p[(e + 1) % 3][a];
        }
    }
    for (int i = 0; i < 13; i++) {
        wide least = 0, most = 0, from = 0, to = 0;
        for (int c = 0; c < 3; c++) {
            wide s = 0;
            for (int k = 0; k < 3; k++) s += axis[i][k] * p[c][k] * unit;
            least = c == 0 || s < least ? s : least, most = c == 0 || s > most ? s : most;
        }
        for (int k = 0; k < 3; k++) {
            from += axis[i][k] * (axis[i][k] > 0 ? low[k] : high[k]);
            to += axis[i][k] * (axis[i][k] > 0 ? high[k] : low[k]);
        }
        if (most < from || least > to) return false;
    }
    return true;
}

static void plane_of(const tri *t, real n[3]) {
    real a[3], b[3];
    for (int k = 0; k < 3; k++)
        a[k] = (real)t->p[1][k] - t->p[0][k], b[k] = (real)t->p[2][k] - t->p[0][k];
    cross(n, a, b);
}
static real area_of(const tri *t) {
    real n[3];
    plane_of(t, n);
    return sqrtl(dot(n, n)) / 2;
}

/* ---- triangles ---- */

static uint64_t state;
static double uniform(double low, double high) {
    double x = (double)(pbs_random(7, 1, state++) >> 11) * 0x1p-53;
    return low + x * (high - low);
}
static double snapped(double x, double bits) {
    return floor(x * bits + 0.5) / bits;
}
/* Corners around a middle, on a lattice. */
static tri random_tri(double low, double high, double size, double bits) {
    tri t;
    double middle[3] = {uniform(low, high), uniform(low, high), uniform(low, high)};
    for (int i = 0; i < 9; i++)
        t.p[i / 3][i % 3] = snapped(middle[i % 3] + uniform(-size, size), bits);
    return t;
}

/* What CAD has: lattice corners, flat along an axis, walls, segments, points. */
static tri odd_tri(int kind, double size, double bits) {
    tri t = random_tri(2, 6, size, bits);
    int k = kind / 8 % 3, a = (k + 1) % 3, b = (k + 2) % 3;
    switch (kind % 8) {
    case 1: /* in a plane across an axis */
        t.p[1][k] = t.p[2][k] = t.p[0][k];
        break;
    case 2: /* in a face between cells */
        t.p[0][k] = t.p[1][k] = t.p[2][k] = floor(t.p[0][k]);
        break;
    case 3: /* a wall: an edge along an axis */
        t.p[1][a] = t.p[0][a], t.p[1][b] = t.p[0][b];
        break;
    case 4: /* both */
        t.p[1][a] = t.p[0][a], t.p[1][b] = t.p[0][b] = floor(t.p[0][b]);
        break;
    case 5: /* a segment, its ends twice */
        for (int c = 0; c < 3; c++) t.p[2][c] = t.p[kind / 24 % 2][c];
        break;
    case 6: /* a segment and its middle */
        for (int c = 0; c < 3; c++) t.p[2][c] = (t.p[0][c] + t.p[1][c]) / 2;
        break;
    case 7: /* a point, or an edge in a face */
        if (kind / 24 % 2)
            t.p[1][k] = t.p[0][k] = floor(t.p[0][k]);
        else
            for (int c = 0; c < 3; c++) t.p[1][c] = t.p[2][c] = t.p[0][c];
    }
    return t;
}

/* ---- one triangle against the oracles ---- */

/* Areas, centroids; returns the area and adds the moment. */
static real check_pieces(const tri *t, const list *l, double slack, real moment[3]) {
    real sum = 0, whole = area_of(t);
    for (size_t i = 0; i < l->count; i++) {
        const pbs_fragment *f = &l->fragment[i];
        real m[3], area = cell_area(t, f->cell, 0, m), want = area > 0 ? area : 0;
        CHECK_NUM(fabsl(f->area - want) <= slack * (1 + want), (double)(f->area - want));
        CHECK(f->area >= 0 && f->u >= 0 && f->v >= 0 && f->u + f->v <= 1);
        sum += f->area;
        for (int k = 0; k < 3; k++) {
            real c = t->p[0][k] + f->u * ((real)t->p[1][k] - t->p[0][k]) +
                     f->v * ((real)t->p[2][k] - t->p[0][k]);
            moment[k] += f->area * c;
            real off = fabsl(c - m[k] / area);
            if (area > 1e-6 + 1e-3 * fminl(whole, 1))
                CHECK_NUM(off < 1e-5 + 2e-7 * fabsl(t->p[1][k] - t->p[0][k]) +
                                    2e-7 * fabsl(t->p[2][k] - t->p[0][k]),
                          (double)off);
        }
    }
    return sum;
}

static void check_small(const tri *t) {
    list l = clipped(t, origin);
    size_t at = 0;
    real moment[3] = {0}, whole = area_of(t);
    int low[3], high[3];
    for (int k = 0; k < 3; k++) {
        double x = t->p[0][k], y = t->p[1][k], z = t->p[2][k];
        low[k] = (int)fmax(fmin(x, fmin(y, z)) - 1, 0), high[k] = (int)fmax(x, fmax(y, z)) + 1;
    }
    for (int z = low[2]; z <= high[2]; z++)
        for (int y = low[1]; y <= high[1]; y++)
            for (int x = low[0]; x <= high[0]; x++) {
                bool is = at < l.count && l.fragment[at].cell == PBS_CELL(x, y, z);
                CHECK(is == meets(t, (int[3]){x, y, z}));
                at += is;
            }
    CHECK(at == l.count);
    real sum = check_pieces(t, &l, 1e-11, moment);
    CHECK_NUM(fabsl(sum - whole) <= 1e-11 * whole, (double)((sum - whole) / whole));
    for (int k = 0; k < 3; k++) {
        real want = whole * ((real)t->p[0][k] + t->p[1][k] + t->p[2][k]) / 3;
        CHECK_NUM(fabsl(moment[k] - want) <= 4e-7 * (whole * 8 + 1e-9), (double)(moment[k] - want));
    }
    free(l.fragment);
}

TEST(cells_are_exact_and_areas_right) {
    static const double bits[] = {256, 256, 16, 2, 1}, sizes[] = {0.2, 0.7, 1.5, 2};
    for (int i = 0; i < 6000 && pbs_bad < 20; i++) {
        double size = sizes[i % 4];
        tri t = random_tri(2, 6, size, bits[i / 4 % 5]);
        check_small(&t);
        t = odd_tri(i, size, bits[i / 4 % 5]);
        check_small(&t);
    }
}

/* ---- any coordinates: against long double, up to its rounding ---- */

/* Whether the triangle's plane passes a cell at all, to spare most cells the clipping. */
static bool near_plane(const tri *t, const real n[3], const int c[3]) {
    real d = 0, reach = 0;
    for (int k = 0; k < 3; k++) d += n[k] * (c[k] + 0.5L - t->p[0][k]), reach += fabsl(n[k]);
    return fabsl(d) <= 0.51L * reach;
}

/* The cells of the block that certainly hold a point of the triangle are there, and no others but
 * those that perhaps do; the pieces sum to the triangle's area in the block. */
static void check_any(const tri *t, const double at[3], double slack, double error) {
    list l = clipped(t, at);
    tri s;
    for (int i = 0; i < 9; i++) s.p[i / 3][i % 3] = t->p[i / 3][i % 3] - at[i % 3];
    real n[3], ignored[3], moment[3] = {0};
    plane_of(&s, n);
    size_t place = 0;
    int low[3], high[3];
    for (int k = 0; k < 3; k++) {
        low[k] = (int)fmax(fmin(fmin(s.p[0][k], s.p[1][k]), s.p[2][k]) - 1, 0);
        high[k] = (int)fmin(fmax(fmax(s.p[0][k], s.p[1][k]), s.p[2][k]) + 1, PBS_BLOCK - 1);
    }
    for (int z = low[2]; z <= high[2]; z++)
        for (int y = low[1]; y <= high[1]; y++)
            for (int x = low[0]; x <= high[0]; x++) {
                uint32_t cell = PBS_CELL(x, y, z);
                bool is = place < l.count && l.fragment[place].cell == cell;
                place += is;
                if (!near_plane(&s, n, (int[3]){x, y, z}))
                    CHECK(!is);
                else if (is)
                    CHECK(cell_area(&s, cell, slack, ignored) >= 0);
                else
                    CHECK(cell_area(&s, cell, -slack, ignored) < 0);
            }
    CHECK(place == l.count);
    real sum = check_pieces(&s, &l, error, moment);
    real want = fmaxl(area_in(&s, (real[3]){0, 0, 0}, (real[3]){64, 64, 64}, ignored), 0);
    CHECK_NUM(fabsl(sum - want) <= 1e-9 * want + error * (double)l.count, (double)(sum - want));
    free(l.fragment);
}

#define FULL 0x1p32

TEST(any_coordinates) {
    for (int i = 0; i < 3000 && pbs_bad < 20; i++) {
        tri t = random_tri(0, 64, i % 3 == 0 ? 1e-3 : i % 3 == 1 ? 0.5 : 2, FULL);
        check_any(&t, origin, 1e-12, 1e-11);
    }
    for (int i = 0; i < 20 && pbs_bad < 20; i++) {
        tri t = random_tri(0, 64, i < 10 ? 8 : 40, FULL);
        check_any(&t, origin, 1e-12, 1e-11);
    }
}

/* Nearly along an axis: slopes of 2^-32. */
TEST(nearly_flat_triangles) {
    for (int i = 0; i < 60 && pbs_bad < 20; i++) {
        tri t = random_tri(8, 24, 8, FULL);
        int k = i % 3;
        for (int c = 0; c < 3; c++)
            t.p[c][k] =
                (i & 1 ? 20 : t.p[0][k]) + floor(uniform(-3, 3)) * (i & 2 ? 0x1p-32 : 0x1p-20);
        check_any(&t, origin, 1e-12, 1e-8);
    }
}

static void to_lattice(tri *t, double bits) {
    for (int i = 0; i < 9; i++) t->p[i / 3][i % 3] = snapped(t->p[i / 3][i % 3], bits);
}

/* Where a random point of a triangle is, in blocks. */
static void block_on(const tri *t, double at[3]) {
    double a = uniform(0, 1), b = uniform(0, 1 - a);
    for (int k = 0; k < 3; k++) {
        double x = t->p[0][k] + a * (t->p[1][k] - t->p[0][k]) + b * (t->p[2][k] - t->p[0][k]);
        at[k] = floor(x / PBS_BLOCK) * PBS_BLOCK;
    }
}

TEST(triangles_of_a_million_voxels) {
    for (int i = 0; i < 24 && pbs_bad < 20; i++) {
        static const double sizes[] = {500, 2e4, 5e5};
        double size = sizes[i % 3], at[3];
        tri t = random_tri(-size / 100, size / 100, size, FULL);
        if (i % 4 == 3) /* thin, along an edge */
            for (int k = 0; k < 3; k++)
                t.p[2][k] = t.p[0][k] + 0.3 * (t.p[1][k] - t.p[0][k]) + uniform(-1, 1);
        to_lattice(&t, FULL);
        block_on(&t, at);
        check_any(&t, at, size * 1e-14, size * 1e-14 + 1e-11);
    }
}

TEST(needles) {
    for (int i = 0; i < 300 && pbs_bad < 20; i++) {
        tri t = random_tri(28, 36, i % 2 ? 20 : 3, FULL);
        double thin = i % 3 == 0 ? 4e-8 : i % 3 == 1 ? 1e-6 : 1e-9;
        for (int k = 0; k < 3; k++)
            t.p[2][k] = (t.p[0][k] + t.p[1][k]) / (i % 5 ? 2 : 1) + uniform(-thin, thin) -
                        (i % 5 ? 0 : t.p[1][k]);
        to_lattice(&t, FULL);
        list l = clipped(&t, origin);
        real sum = 0, whole = area_of(&t);
        for (size_t f = 0; f < l.count; f++) {
            real m[3], want = cell_area(&t, l.fragment[f].cell, 1e-12, m);
            CHECK(want >= 0);
            CHECK_NUM(fabsl(l.fragment[f].area - want) <= 1e-6 * whole, (double)want);
            sum += l.fragment[f].area;
        }
        CHECK_NUM(fabsl(sum - whole) <= (thin < 1e-8 ? 1e-7 : 1e-9) * whole,
                  (double)((sum - whole) / whole));
        free(l.fragment);
        check_any(&t, origin, 1e-12, 1e-11);
    }
}

/* ---- laws ---- */

/* All pieces over all blocks: areas sum to the area, moments to that of the triangle. */
TEST(blocks_share_a_triangle_out) {
    for (int i = 0; i < 12 && pbs_bad < 20; i++) {
        tri t = random_tri(-40, 40, 110, i % 3 ? FULL : 1);
        if (i % 4 == 1) t.p[0][i / 4] = t.p[1][i / 4] = t.p[2][i / 4];
        real sum = 0, moment[3] = {0}, whole = area_of(&t);
        for (int b = 0; b < 6 * 6 * 6; b++) {
            double at[3] = {(b % 6 - 3) * 64, (b / 6 % 6 - 3) * 64, (b / 36 - 3) * 64};
            list l = clipped(&t, at);
            for (size_t f = 0; f < l.count; f++) {
                const pbs_fragment *p = &l.fragment[f];
                sum += p->area;
                for (int k = 0; k < 3; k++)
                    moment[k] += p->area * (t.p[0][k] + p->u * ((real)t.p[1][k] - t.p[0][k]) +
                                            p->v * ((real)t.p[2][k] - t.p[0][k]));
            }
            free(l.fragment);
        }
        CHECK_NUM(fabsl(sum - whole) <= 1e-11 * whole, (double)((sum - whole) / whole));
        for (int k = 0; k < 3; k++) {
            real want = ((real)t.p[0][k] + t.p[1][k] + t.p[2][k]) / 3;
            CHECK_NUM(fabsl(moment[k] / whole - want) <= 1e-7 * 110,
                      (double)(moment[k] / whole - want));
        }
    }
}

static void same_cells(const list *a, const list *b, int32_t shift, const tri *t) {
    CHECK(a->count == b->count);
    for (size_t i = 0; i < a->count && i < b->count; i++) {
        CHECK(a->fragment[i].cell + (uint32_t)shift == b->fragment[i].cell);
        double d = a->fragment[i].area - b->fragment[i].area;
        CHECK_NUM(fabs(d) <= 1e-12 * fmax(1, (double)area_of(t)), d);
    }
}

TEST(corners_turned_and_moved_by_whole_voxels) {
    static const double sizes[] = {0.4, 1, 3, 12};
    for (int i = 0; i < 2000 && pbs_bad < 20; i++) {
        double bits = i % 3 ? FULL : i % 2 ? 2 : 16;
        tri t = i % 5 ? random_tri(20, 40, sizes[i % 4], bits) : odd_tri(i / 5, sizes[i % 4], bits);
        list l = clipped(&t, origin);
        tri turned = {{{t.p[1][0], t.p[1][1], t.p[1][2]},
                       {t.p[2][0], t.p[2][1], t.p[2][2]},
                       {t.p[0][0], t.p[0][1], t.p[0][2]}}};
        list m = clipped(&turned, origin);
        same_cells(&l, &m, 0, &t);
        if (i % 5) {
            double at[3] = {-5, 3, -7};
            list s = clipped(&t, at);
            same_cells(&l, &s, 5 - 3 * 128 + 7 * 16384, &t);
            free(s.fragment);
        }
        free(l.fragment);
        free(m.fragment);
    }
}

/* What two blocks see of the same cells is the same, to the bit, also if they see different parts
 * of the triangle. Gives the number of cells compared. */
static size_t same_bits(const tri *t, const double at[3]) {
    list a = clipped(t, origin), b = clipped(t, at);
    uint32_t shift = (uint32_t)((int)at[0] + (int)at[1] * 128 + (int)at[2] * 16384);
    size_t i = 0, k = 0, same = 0;
    while (i < a.count && k < b.count) {
        pbs_fragment *x = &a.fragment[i], *y = &b.fragment[k];
        uint32_t cell = y->cell + shift;
        int q[3] = {PBS_CELL_X(y->cell) + (int)at[0], PBS_CELL_Y(y->cell) + (int)at[1],
                    PBS_CELL_Z(y->cell) + (int)at[2]};
        bool here = q[0] >= 0 && q[0] < 64 && q[1] >= 0 && q[1] < 64 && q[2] >= 0 && q[2] < 64;
        if (here && x->cell == cell) {
            CHECK(x->area == y->area && x->u == y->u && x->v == y->v);
            i++, k++, same++;
        } else if (!here) {
            k++;
        } else {
            CHECK(x->cell < cell); /* not in b's block, then */
            i++;
        }
    }
    free(a.fragment), free(b.fragment);
    return same;
}

TEST(other_blocks_see_the_same_bits) {
    static const double sizes[] = {0.4, 1, 2, 3, 5, 12, 30, 90, 400, 3000};
    size_t same = 0;
    for (int i = 0; i < 6000 && pbs_bad < 20; i++) {
        double size = sizes[i % 10], at[3], bits = i % 3 ? FULL : i % 2 ? 2 : 16;
        tri t = i % 7 ? random_tri(10, 54, size, bits) : odd_tri(i / 7, fmin(size, 30), bits);
        for (int k = 0; k < 3; k++) at[k] = floor(uniform(-40, 40));
        if (i % 11 == 0) /* across an axis */
            for (int c = 0; c < 3; c++) t.p[c][i % 3] = t.p[0][i % 3];
        same += same_bits(&t, at);
    }
    CHECK_NUM(same > 100000, same);
}

TEST(halves_make_the_whole) {
    static const double sizes[] = {0.4, 1, 3, 12};
    for (int i = 0; i < 1000 && pbs_bad < 20; i++) {
        tri t = random_tri(20, 40, sizes[i % 4], i % 2 ? 8 : 0x1p31), half[2] = {t, t};
        for (int k = 0; k < 3; k++) half[0].p[1][k] = half[1].p[0][k] = (t.p[0][k] + t.p[1][k]) / 2;
        list l = clipped(&t, origin), h[2] = {clipped(&half[0], origin), clipped(&half[1], origin)};
        size_t at[2] = {0, 0};
        for (size_t f = 0; f < l.count; f++) {
            double sum = 0;
            bool found = false;
            for (int s = 0; s < 2; s++)
                if (at[s] < h[s].count && h[s].fragment[at[s]].cell == l.fragment[f].cell)
                    sum += h[s].fragment[at[s]++].area, found = true;
            CHECK(found);
            CHECK_NUM(fabs(sum - l.fragment[f].area) < 1e-12 * fmax(1, (double)area_of(&t)), sum);
        }
        CHECK(at[0] == h[0].count && at[1] == h[1].count);
        free(l.fragment), free(h[0].fragment), free(h[1].fragment);
    }
}

TEST(simd_gives_the_same_bits) {
#if defined(__x86_64__)
    if (!__builtin_cpu_supports("avx2")) SKIP("no AVX2");
#endif
    static pbs_triangles b;
    static const double sizes[] = {0.2, 0.4, 1, 5, 40}, none[3] = {0, 0, 0};
    for (int i = 0; i < 400 && pbs_bad < 20; i++) {
        list l[2] = {{0}, {0}};
        b.count = 0;
        for (int c = 0; c < (i % 8 ? 64 : i % 64); c++) {
            double bits = c % 3 ? FULL : c % 2 ? 2 : 16;
            tri t = c % 5 ? random_tri(-1, 65, sizes[(i + c) % 5], bits)
                          : odd_tri(i + c, sizes[c % 5], bits);
            batch_add(&b, &t, none);
        }
        clip(&b, false, &l[0]);
        clip(&b, true, &l[1]);
        CHECK(l[0].count == l[1].count);
        CHECK(l[0].count == 0 ||
              memcmp(l[0].fragment, l[1].fragment, l[0].count * sizeof *l[0].fragment) == 0);
        free(l[0].fragment), free(l[1].fragment);
    }
}

/* ---- time ---- */

/* Seconds a fragment, the least of a few runs; a triangle counts as one, and a row of the block. */
static double cost(const tri *t) {
    static pbs_triangles b;
    double least = INFINITY;
    b.count = 0;
    for (int i = 0; i < 4; i++) batch_add(&b, t, origin);
    for (int run = 0; run < 3; run++) {
        list l = {0};
        clock_t from = clock();
        for (int i = 0; i < 2; i++) l.count = 0, clip(&b, false, &l);
        double s = (double)(clock() - from) / CLOCKS_PER_SEC / 2;
        least = fmin(least, s / ((double)l.count + 64 * 4));
        free(l.fragment);
    }
    return least;
}

TEST(no_shape_takes_long) {
    static const tri shapes[] = {
        {{{-1e6, -1e6, 1}, {1e6, -1e6, 1e3}, {0, 1e6, 3}}},     /* across the block's box */
        {{{-1e6, 5, -1e6}, {1e6, 5.5, 1e6}, {3e3, 1e6, -9e5}}}, /* through it */
        {{{-1e6, -1e6, -1e6}, {1e6, 1e6, 1e6}, {1e6, 1e6, 1e6 - 0x1p-32}}}, /* a needle */
        {{{-1e6, 32, 32}, {1e6, 32, 32}, {0, 32, 32 + 0x1p-32}}}, /* along edges of cells */
        {{{0, 0, 0}, {64, 64, 0}, {64, 64, 64}}}, /* a diagonal wall on the lattice */
        {{{0, 0, 0}, {64, 0, 64}, {0, 64, 64}}},  /* a plane through corners */
        {{{-5e5, 64 + 1e-3, 0}, {1e6, 64 + 2e-3, 3e5}, {3e3, 65, -9e5}}}, /* just outside */
    };
    static const tri plain = {{{1.3, 2.6, 10.2}, {60.1, 12.3, 31.7}, {18.9, 58.2, 22.4}}};
    double usual = cost(&plain);
    for (size_t i = 0; i < sizeof shapes / sizeof *shapes; i++) {
        double c = cost(&shapes[i]);
        CHECK_NUM(c < 30 * usual + 1e-6, c / usual);
    }
}
TEST_MAIN
