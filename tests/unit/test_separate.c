/* The six-separating cells against the rule of grid.h, cell by cell, in integers; and laws.
 *
 * The oracle does not look at a triangle's plane, and has no cases: what a line meets of a triangle
 * reaches from the least to the largest of the points that are corners on the line, points of edges
 * on the line, and means of three corners on the line (these are the corners of a linear program).
 */
#include "libcore/exact.h"
#include "libcore/rng.h"
#include "libcore/separate.h"
#include "tests/check.h"

enum { SIDE = PBS_BLOCK + 2, CELLS = SIDE * SIDE * SIDE };
typedef struct cells {
    uint8_t *hit; /* [z][y][x], from -1 */
} cells;
typedef struct tri {
    double p[3][3];
} tri;

static uint64_t draws;
static uint64_t bits(void) {
    return pbs_random(5, 0, draws++);
}
static double uniform(double lo, double hi) {
    return lo + (hi - lo) * ((double)(bits() >> 11) * 0x1p-53);
}
static double snap(double v, double step) {
    return floor(v / step + 0.5) * step;
}

static size_t at(int x, int y, int z) {
    return ((size_t)(z + 1) * SIDE + (size_t)(y + 1)) * SIDE + (size_t)(x + 1);
}
static cells cells_new(void) {
    return (cells){calloc(CELLS, 1)};
}

/* ---- the oracle ---- */

typedef struct ratio {
    pbs_wide up;
    __int128 down; /* positive */
    double near;
} ratio;

static int64_t fix(double v) {
    int64_t f = (int64_t)(v * 4294967296.0);
    if ((double)f != v * 4294967296.0) abort();
    return f;
}
/* up / down >= k */
static bool reaches(const ratio *r, int k) {
    return pbs_wide_compare(r->up, pbs_wide_mul64(r->down, k * PBS_FIXED_ONE)) >= 0;
}
static int ratio_floor(const ratio *r) {
    int k = r->near < -2 ? -2 : r->near > 66 ? 66 : (int)r->near;
    while (k > -2 && !reaches(r, k)) k--;
    while (k < 66 && reaches(r, k + 1)) k++;
    return k;
}
static __int128 cross(const int64_t a[2], const int64_t b[2], const int64_t c[2]) {
    return (__int128)(b[0] - a[0]) * (c[1] - a[1]) - (__int128)(b[1] - a[1]) * (c[0] - a[0]);
}
static int sign(__int128 v) {
    return v < 0 ? -1 : v > 0;
}
static void widen(int range[2], __int128 down, pbs_wide up) {
    if (down < 0) down = -down, up = pbs_wide_negate(up);
    double near = ((double)up.high * 0x1p128 + (double)up.low) / (double)down * 0x1p-32;
    ratio r = {up, down, near};
    int k = ratio_floor(&r);
    range[0] = k < range[0] ? k : range[0];
    range[1] = k > range[1] ? k : range[1];
}

/* The cells' numbers, from -2 (anything below) to 66, on a line through q; false: none. */
static bool line_meets(const int64_t p[3][2], const int64_t z[3], const int64_t q[2],
                       int range[2]) {
    range[0] = 100, range[1] = -100;
    __int128 w[3], sum = 0;
    for (int c = 0; c < 3; c++) {
        const int64_t *a = p[c], *b = p[(c + 1) % 3];
        w[(c + 2) % 3] = cross(a, b, q);
        sum += w[(c + 2) % 3];
        if (a[0] == q[0] && a[1] == q[1]) widen(range, 1, pbs_wide_of(z[c]));
        if (cross(a, b, q) != 0) continue;
        for (int k = 0; k < 2; k++) {
            int64_t run = b[k] - a[k], x = q[k] - a[k];
            if (run < 0) run = -run, x = -x;
            if (run == 0 || x < 0 || x > run) continue;
            if (a[!k] == b[!k] && q[!k] != a[!k]) continue;
            pbs_wide from = pbs_wide_mul64(run - x, z[c]), to = pbs_wide_mul64(x, z[(c + 1) % 3]);
            widen(range, run, pbs_wide_add(from, to));
        }
    }
    if (sum != 0 && sign(w[0]) * sign(sum) >= 0 && sign(w[1]) * sign(sum) >= 0 &&
        sign(w[2]) * sign(sum) >= 0) {
        pbs_wide up = pbs_wide_of(0);
        for (int c = 0; c < 3; c++) up = pbs_wide_add(up, pbs_wide_mul64(w[c], z[c]));
        widen(range, sum, up);
    }
    return range[0] <= range[1];
}

static void oracle_axis(const tri *t, int a, cells *out) {
    int u = (a + 1) % 3, v = (a + 2) % 3, lo[2] = {64, 64}, hi[2] = {-1, -1};
    int64_t p[3][2], z[3];
    for (int c = 0; c < 3; c++) {
        p[c][0] = fix(t->p[c][u]), p[c][1] = fix(t->p[c][v]), z[c] = fix(t->p[c][a]);
        for (int k = 0; k < 2; k++) {
            double cell = fmin(fmax(floor(k ? t->p[c][v] : t->p[c][u]), -1), 64);
            lo[k] = (int)fmin(lo[k], cell), hi[k] = (int)fmax(hi[k], cell);
        }
    }
    for (int i = lo[0]; i <= hi[0]; i++)
        for (int j = lo[1]; j <= hi[1]; j++) {
            int64_t q[2] = {fix(i + 0.5), fix(j + 0.5)};
            int range[2], cell[3];
            if (!line_meets(p, z, q, range)) continue;
            cell[u] = i, cell[v] = j;
            for (int k = range[0]; k <= range[1]; k++) {
                cell[a] = k;
                if (k >= -1 && k <= 64) out->hit[at(cell[0], cell[1], cell[2])] = 1;
            }
        }
}

/* ---- what is tested ---- */

typedef struct list {
    pbs_hit *hit;
    size_t count, room;
} list;
static void keep(void *ctx, pbs_hits *h) {
    list *l = ctx;
    if (h->count > PBS_HITS) abort();
    if (l->count + h->count > l->room) {
        l->room = 2 * (l->count + h->count);
        l->hit = realloc(l->hit, l->room * sizeof *l->hit);
    }
    for (uint32_t i = 0; i < h->count; i++) l->hit[l->count + i] = h->hit[i];
    l->count += h->count, h->count = 0;
}

static void batch_of(pbs_triangles *b, const tri *t, uint32_t n) {
    /* What is behind the last triangle may be anything. */
    for (size_t i = 0; i < sizeof *b / sizeof(double); i++) ((double *)(void *)b)[i] = NAN;
    b->count = n;
    for (uint32_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) {
            double lo = t[i].p[0][k], hi = lo;
            for (int c = 0; c < 3; c++) {
                b->p[c][k][i] = t[i].p[c][k];
                lo = fmin(lo, t[i].p[c][k]), hi = fmax(hi, t[i].p[c][k]);
            }
            b->min[k][i] = lo, b->max[k][i] = hi;
        }
}

static list hits_of(const tri *t, uint32_t n, bool simd) {
    static pbs_triangles b;
    static pbs_hits h;
    list l = {0};
    h.flush = keep, h.ctx = &l, h.count = 0;
    for (uint32_t i = 0; i < n; i += PBS_TRIANGLES) {
        batch_of(&b, t + i, n - i < PBS_TRIANGLES ? n - i : PBS_TRIANGLES);
        size_t before = l.count + h.count;
        pbs_separate(&b, simd, &h);
        keep(&l, &h);
        for (; before < l.count; before++) {
            CHECK(l.hit[before].triangle < b.count);
            l.hit[before].triangle += i;
        }
    }
    return l;
}

/* The cells of one triangle of the list. */
static void mark(const list *l, uint32_t triangle, cells *out) {
    for (size_t i = 0; i < l->count; i++)
        if (l->hit[i].triangle == triangle) {
            uint32_t c = l->hit[i].cell;
            out->hit[at(PBS_CELL_X(c), PBS_CELL_Y(c), PBS_CELL_Z(c))] = 1;
        }
}

static void print(const char *what, const tri *t) {
    printf("# %s:", what);
    for (int c = 0; c < 3; c++) printf(" (%.12g %.12g %.12g)", t->p[c][0], t->p[c][1], t->p[c][2]);
    printf("\n");
}

/* How many of the layer's directions a cell is out of the block in. */
static int outside(size_t i) {
    int n = 0;
    for (int k = 0; k < 3; k++, i /= SIDE) n += i % SIDE == 0 || i % SIDE == SIDE - 1;
    return n;
}

/* Both ways agree hit by hit, and with the oracle. Returns the hits. */
static size_t compare(const tri *t, uint32_t n) {
    list a = hits_of(t, n, false), b = hits_of(t, n, true);
    CHECK(a.count == b.count && (!a.count || !memcmp(a.hit, b.hit, a.count * sizeof *a.hit)));
    cells want = cells_new(), got = cells_new();
    size_t hits = a.count;
    for (uint32_t i = 0; i < n; i++) {
        memset(want.hit, 0, CELLS), memset(got.hit, 0, CELLS);
        for (int k = 0; k < 3; k++) oracle_axis(t + i, k, &want);
        mark(&a, i, &got);
        int wrong = 0, lost = 0;
        if (memcmp(want.hit, got.hit, CELLS))
            for (size_t c = 0; c < CELLS; c++) {
                wrong += got.hit[c] && !want.hit[c];
                lost += want.hit[c] && !got.hit[c] && outside(c) < 2;
            }
        CHECK_NUM(!wrong, wrong);
        CHECK_NUM(!lost, lost);
        if (wrong || lost) print("differs", t + i);
    }
    free(want.hit), free(got.hit), free(a.hit), free(b.hit);
    return hits;
}

/* ---- triangles ---- */

#define STEP 0x1p-32

static tri random_tri(double lo, double hi, double size, double step) {
    tri t;
    for (int k = 0; k < 3; k++) {
        double at_k = uniform(lo, hi);
        for (int c = 0; c < 3; c++) t.p[c][k] = snap(at_k + uniform(-size, size), step);
    }
    return t;
}

static void random_batch(double size, double step, uint32_t n) {
    tri *t = malloc(n * sizeof *t);
    for (uint32_t i = 0; i < n; i++) t[i] = random_tri(-1.5, 65.5, size, step);
    size_t hits = compare(t, n);
    CHECK_NUM(hits > n / 100, hits);
    free(t);
}

TEST(random_triangles) {
    random_batch(0.5, STEP, 1500);
    random_batch(2, STEP, 500);
    random_batch(10, STEP, 150);
    random_batch(60, STEP, 40);
}

/* Around the places where cells are decided: middles, and the faces between cells. */
TEST(tiny_triangles_at_middles) {
    enum { N = 3000 };
    tri *t = malloc(N * sizeof *t);
    const double size[] = {0.3, 0.05, 1e-4, 4 * STEP};
    for (int i = 0; i < N; i++)
        for (int k = 0; k < 3; k++) {
            double s = size[i % 4], middle = snap(uniform(-1, 65), 0.5);
            for (int c = 0; c < 3; c++) t[i].p[c][k] = snap(middle + uniform(-s, s), STEP);
        }
    CHECK(compare(t, N) > N / 8);
    free(t);
}

TEST(triangles_on_a_coarse_lattice) {
    const double step[] = {1, 0.5, 0.25, 0x1p-10};
    for (int i = 0; i < 4; i++) {
        random_batch(1, step[i], 600);
        random_batch(3, step[i], 400);
        random_batch(20, step[i], 60);
        random_batch(70, step[i], 10);
    }
}

TEST(no_triangles_and_odd_counts) {
    tri t[67];
    for (int i = 0; i < 67; i++) t[i] = random_tri(0, 64, 2, STEP);
    for (uint32_t n = 0; n < 67; n++) {
        list all = hits_of(t, 67, true), some = hits_of(t, n, true);
        size_t k = 0;
        while (k < all.count && all.hit[k].triangle < (n & ~3u)) k++;
        CHECK(some.count >= k && (!k || !memcmp(some.hit, all.hit, k * sizeof *all.hit)));
        free(all.hit), free(some.hit);
    }
    compare(t, 67);
}

/* Slivers that are a few steps wide, seen along an axis, on both sides of a middle or beside it:
 * their normals are all rounding, and their depths are steep. */
TEST(slivers_at_middles) {
    enum { N = 600 };
    tri *t = malloc(N * sizeof *t);
    const double length[] = {0.5, 3, 30, 5e5};
    for (int i = 0; i < N; i++) {
        int a = i % 3, u = (a + 1) % 3, v = (a + 2) % 3;
        double angle = uniform(0, 6.3), l = length[i / 3 % 4], deep = i % 5 ? 70 : 1e6;
        double m[2] = {floor(uniform(0, 64)) + 0.5, floor(uniform(0, 64)) + 0.5};
        for (int c = 0; c < 3; c++) {
            double at_c = c == 0 ? -uniform(0, l) : c == 1 ? uniform(0, l) : uniform(-0.1, 0.1) * l;
            t[i].p[c][u] = snap(m[0] + at_c * cos(angle) + uniform(-3, 3) * STEP, STEP);
            t[i].p[c][v] = snap(m[1] + at_c * sin(angle) + uniform(-3, 3) * STEP, STEP);
            t[i].p[c][a] = snap(32 + uniform(-deep, deep), STEP);
            /* Some have a whole depth at the middle. */
            if (i % 7 < 3 && l < 100)
                t[i].p[c][a] = 32 + 2 * (t[i].p[c][u] - m[0]) + (m[1] - t[i].p[c][v]);
        }
    }
    CHECK(compare(t, N) > N / 8);
    free(t);
}

/* Edges that pass a middle at 2^-64 of a square voxel, on either side: x1 y2 - y1 x2 is 1 by
 * Euclid's algorithm. And depths at the middle that are next to a whole number. */
TEST(edges_next_to_middles) {
    enum { N = 800 };
    tri *t = malloc(N * sizeof *t);
    for (int i = 0; i < N; i++) {
        int64_t x1 = (int64_t)(bits() >> (i % 2 ? 30 : 33)) | 1, y1 = (int64_t)(bits() >> 33);
        int64_t r0 = x1, r1 = y1, s0 = 1, s1 = 0, t0 = 0, t1 = 1;
        while (r1) {
            int64_t q = r0 / r1, r = r0 - q * r1, s = s0 - q * s1, w = t0 - q * t1;
            r0 = r1, r1 = r, s0 = s1, s1 = s, t0 = t1, t1 = w;
        }
        /* x1 s0 + y1 t0 = r0, so the cross product of (x1, y1) and (-t0, s0) is r0. */
        int64_t x2 = i % 4 < 2 ? t0 : -t0, y2 = i % 4 < 2 ? -s0 : s0;
        if ((x1 < 0) == (x2 < 0) && x2) x2 = -x2, y2 = -y2;
        int a = i % 3, u = (a + 1) % 3, v = (a + 2) % 3;
        double m[2] = {floor(uniform(4, 60)) + 0.5, floor(uniform(4, 60)) + 0.5};
        double k = floor(uniform(1, 63)), side = i % 8 < 4 ? 1 : -1;
        if (i % 7 == 0) side = 0; /* the middle is a corner, and the area 2^-65 */
        const double x[3] = {(double)x1, (double)x2, -side * (double)(y1 >> 1)};
        const double y[3] = {(double)y1, (double)y2, side * (double)(x1 >> 1)};
        for (int c = 0; c < 3; c++) {
            t[i].p[c][u] = m[0] + x[c] * STEP, t[i].p[c][v] = m[1] + y[c] * STEP;
            t[i].p[c][a] = k + (c == 2 ? (i % 16 < 8 ? -STEP : STEP) : 0);
            if (i % 5 == 0) t[i].p[c][a] = snap(k + uniform(-2, 2), STEP);
        }
    }
    CHECK(compare(t, N) > N / 8);
    free(t);
}

/* As good as on an edge whose ends are at whole depths; the third corner is a step off. */
TEST(depths_next_to_whole_numbers) {
    enum { N = 800 };
    tri *t = malloc(N * sizeof *t);
    for (int i = 0; i < N; i++) {
        int a = i % 3, u = (a + 1) % 3, v = (a + 2) % 3;
        double m[2] = {floor(uniform(4, 60)) + 0.5, floor(uniform(4, 60)) + 0.5};
        double beside = STEP * (double)(1 << i % 24), k = floor(uniform(1, 63)),
               size = i % 2 ? 2 : 9;
        for (int c = 0; c < 3; c++) {
            t[i].p[c][u] = snap(m[0] + (c - 1) * uniform(0.2, 1) * size, STEP);
            t[i].p[c][v] = c == 1 ? snap(m[1] + uniform(0.2, 1) * size, STEP) : m[1] - beside;
            t[i].p[c][a] = k + (c == 1 ? (i % 4 < 2 ? -STEP : STEP) : 0);
        }
    }
    CHECK(compare(t, N) > N / 2);
    free(t);
}

/* Two coordinates of a corner 1e8 times farther from each other than the third is wide. */
TEST(needles_and_slivers) {
    tri t[400];
    for (int i = 0; i < 400; i++) {
        double a[3], b[3], length = i % 2 ? 3 : 60;
        for (int k = 0; k < 3; k++) a[k] = uniform(0, 64), b[k] = a[k] + uniform(-length, length);
        if (i % 3 == 0) b[bits() % 3] = a[0] = snap(a[0], 0.5);
        for (int k = 0; k < 3; k++) {
            double f = uniform(0, 1), w = uniform(-1e-8, 1e-8) * length;
            t[i].p[0][k] = snap(a[k], STEP), t[i].p[1][k] = snap(b[k], STEP);
            t[i].p[2][k] = snap(a[k] + f * (b[k] - a[k]) + (i % 5 ? w : 0), STEP);
        }
    }
    compare(t, 400);
}

/* Planes, segments and points along the axes, at whole and half coordinates and a step beside. */
TEST(flat_triangles) {
    tri t[900];
    for (int i = 0; i < 900; i++) {
        double size = i % 2 ? 40 : 2;
        t[i] = random_tri(2, 62, size, i % 7 ? STEP : 0.5);
        int a = (int)(bits() % 3), b = (int)(bits() % 3);
        double step = i % 3 ? 0.5 : STEP, beside = i % 11 == 0 ? STEP : 0;
        double flat[2] = {snap(t[i].p[0][a], step), snap(t[i].p[0][b], step)};
        for (int c = 0; c < 3; c++) {
            t[i].p[c][a] = flat[0] + (c == 1 ? beside : 0);
            if (i % 4 == 0) t[i].p[c][b] = flat[1];
            if (i % 16 == 0) t[i].p[c][3 - a - b > 2 || a == b ? 0 : 3 - a - b] = flat[0];
        }
        if (i % 5 == 0) memcpy(t[i].p[2], t[i].p[i % 10 ? 1 : 0], sizeof t[i].p[2]);
    }
    CHECK(compare(t, 900) > 10000);
}

/* Edge-on but not along an axis: the plane holds an axis and a direction with whole numbers, so
 * that it goes through middles. */
TEST(edge_on_triangles) {
    tri t[300];
    for (int i = 0; i < 300; i++) {
        int a = (int)(bits() % 3), u = (a + 1) % 3, v = (a + 2) % 3;
        double du = (double)(bits() % 9) - 4, dv = (double)(bits() % 9) - 4;
        double u0 = snap(uniform(0, 64), 0.5), v0 = snap(uniform(0, 64), 0.5);
        for (int c = 0; c < 3; c++) {
            double f = snap(uniform(-8, 8), 0.25);
            t[i].p[c][u] = u0 + f * du, t[i].p[c][v] = v0 + f * dv;
            t[i].p[c][a] = snap(uniform(-5, 69), i % 2 ? 0.5 : STEP);
        }
    }
    CHECK(compare(t, 300) > 1000);
}

/* Corners up to 2^20 away; planes that cut a corner of the block, or pass by it. */
TEST(huge_triangles) {
    const double far = 1048576;
    enum { N = 120 };
    tri t[N];
    for (int i = 0; i < N; i++) {
        double through[3], d[3][3];
        for (int k = 0; k < 3; k++) through[k] = snap(uniform(-3, 67), i % 3 ? STEP : 0.5);
        for (int k = 0; k < 3; k++) d[0][k] = uniform(-1, 1), d[1][k] = uniform(-1, 1);
        if (i % 4 == 0) d[0][i % 3] = d[1][i % 3] = 0; /* along an axis */
        if (i % 8 == 1) d[0][i % 3] = STEP / far, d[1][i % 3] = 0;
        if (i % 8 == 5) memcpy(d[1], d[0], sizeof d[0]), d[1][0] += 1e-7;
        for (int k = 0; k < 3; k++) d[2][k] = -(d[0][k] + d[1][k]) * uniform(0.1, 0.9);
        double reach = i % 2 ? far - 70 : 300;
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++)
                t[i].p[c][k] =
                    fmin(fmax(snap(through[k] + reach * d[c][k], i % 3 ? STEP : 0.5), -far), far);
    }
    CHECK(compare(t, N) > 1000);
    tri corner = {{{-far, -far, far}, {far, -far, -far}, {-far, far, -far}}};
    for (int k = 0; k < 3; k++) corner.p[k][k == 0 ? 2 : k == 1 ? 0 : 1] -= 0.5;
    compare(&corner, 1);
}

/* x + y + z = c, and slopes of 2, 1/2, 1/3, where depths are whole numbers again and again. */
TEST(depths_that_are_whole_numbers) {
    enum { N = 96 };
    tri t[N];
    for (int i = 0; i < N; i++) {
        double c = 30 + i % 7 * 0.5, w = i % 2 ? 12 : 3, slope[4] = {1, 2, 0.5, 1 / 3.0};
        double gx = slope[i % 4], gy = i % 3 ? slope[i / 4 % 4] : 0;
        int a = i % 3;
        for (int k = 0; k < 3; k++) {
            double x = 3 * w * (k == 1), y = 3 * w * (k == 2);
            t[i].p[k][(a + 1) % 3] = 0.5 + x, t[i].p[k][(a + 2) % 3] = 1.5 + y;
            t[i].p[k][a] = snap(c + gx * x - gy * y, 0.5);
        }
    }
    CHECK(compare(t, N) > 1000);
}

/* ---- laws ---- */

static cells union_of(const tri *t, uint32_t n) {
    list l = hits_of(t, n, true);
    cells out = cells_new();
    for (size_t i = 0; i < l.count; i++) l.hit[i].triangle = 0;
    mark(&l, 0, &out);
    free(l.hit);
    return out;
}
static bool same_cells(const tri *a, uint32_t na, const tri *b, uint32_t nb) {
    cells x = union_of(a, na), y = union_of(b, nb);
    bool same = !memcmp(x.hit, y.hit, CELLS);
    free(x.hit), free(y.hit);
    return same;
}

/* Of all kinds: tiny to large, on lattices, flat. */
static tri any_tri(void) {
    const double size[] = {0.4, 1.5, 6, 30}, step[] = {STEP, 0.5, 1, 0.25};
    tri t = random_tri(8, 56, size[bits() % 4], step[bits() % 4]);
    if (bits() % 4 == 0)
        for (int c = 1; c < 3; c++) t.p[c][0] = t.p[0][0];
    return t;
}

TEST(corners_in_any_order) {
    static const int order[5][3] = {{0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    for (int i = 0; i < 150; i++) {
        tri t = any_tri(), other;
        for (int k = 0; k < 5; k++) {
            for (int c = 0; c < 3; c++) memcpy(other.p[c], t.p[order[k][c]], sizeof t.p[0]);
            CHECK(same_cells(&t, 1, &other, 1));
        }
    }
}

TEST(whole_voxels_further) {
    for (int i = 0; i < 200; i++) {
        tri t = any_tri(), moved = t;
        int d[3];
        for (int k = 0; k < 3; k++) {
            d[k] = (int)(bits() % 100) - 50;
            for (int c = 0; c < 3; c++) moved.p[c][k] += d[k];
        }
        cells a = union_of(&t, 1), b = union_of(&moved, 1);
        int differ = 0;
        for (int z = 0; z < 64; z++)
            for (int y = 0; y < 64; y++)
                for (int x = 0; x < 64; x++) {
                    int to[3] = {x + d[0], y + d[1], z + d[2]};
                    if (((to[0] | to[1] | to[2]) & ~63) == 0)
                        differ += a.hit[at(x, y, z)] != b.hit[at(to[0], to[1], to[2])];
                }
        CHECK_NUM(differ == 0, differ);
        free(a.hit), free(b.hit);
    }
}

TEST(axes_in_any_order) {
    for (int i = 0; i < 200; i++) {
        tri t = any_tri(), turned;
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++) turned.p[c][(k + 1 + i % 2) % 3] = t.p[c][k];
        cells a = union_of(&t, 1), b = union_of(&turned, 1);
        int differ = 0;
        for (int z = -1; z <= 64; z++)
            for (int y = -1; y <= 64; y++)
                for (int x = -1; x <= 64; x++)
                    differ +=
                        a.hit[at(x, y, z)] != (i % 2 ? b.hit[at(y, z, x)] : b.hit[at(z, x, y)]);
        CHECK_NUM(differ == 0, differ);
        free(a.hit), free(b.hit);
    }
}

TEST(a_triangle_is_its_halves) {
    for (int i = 0; i < 300; i++) {
        tri t = any_tri(), half[2];
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++) t.p[c][k] = snap(t.p[c][k], 0x1p-31);
        half[0] = half[1] = t;
        for (int k = 0; k < 3; k++) half[0].p[1][k] = half[1].p[0][k] = (t.p[0][k] + t.p[1][k]) / 2;
        CHECK(same_cells(&t, 1, half, 2));
    }
}

/* ---- closed surfaces ---- */

/* Cells that can be reached from outside the block through faces. */
static cells flood(const cells *wall) {
    cells seen = cells_new();
    int *stack = malloc(CELLS * sizeof *stack), top = 0;
    const int step[3] = {1, SIDE, SIDE * SIDE};
    seen.hit[0] = 1, stack[top++] = 0;
    while (top) {
        int c = stack[--top];
        for (int k = 0; k < 6; k++) {
            int axis = k >> 1, place = c / step[axis] % SIDE, d = k & 1 ? 1 : -1;
            if (place + d < 0 || place + d >= SIDE) continue;
            int next = c + d * step[axis];
            if (seen.hit[next] || wall->hit[next]) continue;
            seen.hit[next] = 1, stack[top++] = next;
        }
    }
    free(stack);
    return seen;
}

/* A convex solid: how deep a point is below its faces, which look outwards. */
static double depth_in(const tri *t, uint32_t n, const double q[3]) {
    double least = INFINITY;
    for (uint32_t i = 0; i < n; i++) {
        double e[3], f[3], g[3];
        for (int k = 0; k < 3; k++) {
            e[k] = t[i].p[1][k] - t[i].p[0][k], f[k] = t[i].p[2][k] - t[i].p[0][k];
            g[k] = t[i].p[0][k] - q[k];
        }
        double d = 0;
        for (int k = 0; k < 3; k++) {
            int u = (k + 1) % 3, v = (k + 2) % 3;
            d += g[k] * (e[u] * f[v] - e[v] * f[u]);
        }
        least = fmin(least, d);
    }
    return least;
}

static void check_shell(const tri *t, uint32_t n, int least) {
    cells wall = union_of(t, n), seen = flood(&wall);
    int inside = 0, leaks = 0, outside_lost = 0;
    for (int z = 0; z < 64; z++)
        for (int y = 0; y < 64; y++)
            for (int x = 0; x < 64; x++) {
                double q[3] = {x + 0.5, y + 0.5, z + 0.5}, d = depth_in(t, n, q);
                size_t c = at(x, y, z);
                inside += d > 1e-9 && !wall.hit[c];
                leaks += d > 1e-9 && seen.hit[c];
                outside_lost += d < -1e-9 && !seen.hit[c] && !wall.hit[c];
            }
    CHECK_NUM(inside >= least, inside);
    CHECK_NUM(leaks == 0, leaks);
    CHECK_NUM(outside_lost == 0, outside_lost); /* no cell outside is walled in: it is convex */
    free(wall.hit), free(seen.hit);
}

static void box_of(tri t[12], const double lo[3], const double hi[3]) {
    int n = 0;
    for (int a = 0; a < 3; a++)
        for (int s = 0; s < 2; s++) {
            double q[4][3];
            for (int i = 0; i < 4; i++) {
                q[i][a] = s ? hi[a] : lo[a];
                q[i][(a + 1) % 3] = (i == 1 || i == 2) == s ? hi[(a + 1) % 3] : lo[(a + 1) % 3];
                q[i][(a + 2) % 3] = i >= 2 ? hi[(a + 2) % 3] : lo[(a + 2) % 3];
            }
            for (int h = 0; h < 2; h++, n++)
                for (int c = 0; c < 3; c++) memcpy(t[n].p[c], q[c ? c + h : 0], sizeof q[0]);
        }
    /* The faces must look outwards. */
    double middle[3];
    for (int k = 0; k < 3; k++) middle[k] = (lo[k] + hi[k]) / 2;
    for (int i = 0; i < 12; i++)
        if (depth_in(t + i, 1, middle) < 0) {
            double swap[3];
            memcpy(swap, t[i].p[1], sizeof swap), memcpy(t[i].p[1], t[i].p[2], sizeof swap);
            memcpy(t[i].p[2], swap, sizeof swap);
        }
}

TEST(boxes_are_closed) {
    const double step[] = {1, 0.5, STEP};
    for (int i = 0; i < 12; i++) {
        tri t[12];
        double lo[3], hi[3];
        for (int k = 0; k < 3; k++) {
            lo[k] = snap(uniform(3, 20), step[i % 3]), hi[k] = snap(uniform(30, 60), step[i % 3]);
        }
        box_of(t, lo, hi);
        check_shell(t, 12, 500);
    }
}

TEST(tetrahedra_are_closed) {
    for (int i = 0; i < 25; i++) {
        double q[4][3], step = i % 3 ? STEP : 0.5;
        for (int c = 0; c < 4; c++)
            for (int k = 0; k < 3; k++) q[c][k] = snap(uniform(2, 62), step);
        tri t[4];
        for (int f = 0; f < 4; f++) {
            for (int c = 0; c < 3; c++) memcpy(t[f].p[c], q[(f + 1 + c) % 4], sizeof q[0]);
            if (depth_in(t + f, 1, q[f]) < 0)
                memcpy(t[f].p[0], q[(f + 2) % 4], sizeof q[0]),
                    memcpy(t[f].p[1], q[(f + 1) % 4], sizeof q[0]);
        }
        check_shell(t, 4, 0);
    }
}

static tri *icosphere(int levels, const double middle[3], double radius, uint32_t *count) {
    const double g = 1.6180339887498949;
    const double v[12][3] = {{-1, g, 0}, {1, g, 0}, {-1, -g, 0}, {1, -g, 0},
                             {0, -1, g}, {0, 1, g}, {0, -1, -g}, {0, 1, -g},
                             {g, 0, -1}, {g, 0, 1}, {-g, 0, -1}, {-g, 0, 1}};
    const int face[20][3] = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                             {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                             {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                             {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
    uint32_t n = 20, all = 20u << 2 * levels;
    tri *t = malloc(all * sizeof *t);
    for (uint32_t i = 0; i < n; i++)
        for (int c = 0; c < 3; c++) memcpy(t[i].p[c], v[face[i][c]], sizeof v[0]);
    for (int l = 0; l < levels; l++, n *= 4)
        for (uint32_t i = 0; i < n; i++) {
            tri o = t[i], m;
            for (int c = 0; c < 3; c++)
                for (int k = 0; k < 3; k++) m.p[c][k] = (o.p[c][k] + o.p[(c + 1) % 3][k]) / 2;
            t[i] = m;
            for (uint32_t c = 0; c < 3; c++) {
                tri *to = t + n * (c + 1) + i;
                memcpy(to->p[0], o.p[c], sizeof o.p[0]);
                memcpy(to->p[1], m.p[c], sizeof o.p[0]);
                memcpy(to->p[2], m.p[(c + 2) % 3], sizeof o.p[0]);
            }
        }
    for (uint32_t i = 0; i < n; i++)
        for (int c = 0; c < 3; c++) {
            double *p = t[i].p[c], r = radius / sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
            for (int k = 0; k < 3; k++) p[k] = snap(middle[k] + r * p[k], STEP);
        }
    *count = n;
    return t;
}

/* Of triangles below a cell and above; the flood must not leak, and go everywhere else. */
TEST(spheres_are_closed) {
    for (int levels = 0; levels <= 5; levels++) {
        double middle[3] = {31.7, 32.2, 30.9}, radius = levels == 5 ? 9 : 25;
        uint32_t n;
        tri *t = icosphere(levels, middle, radius, &n);
        cells wall = union_of(t, n), seen = flood(&wall);
        int leaks = 0, lost = 0, inside = 0;
        /* Rounding and edges below the sphere: the faces are at most that far inside it. */
        double sag = levels < 2 ? radius * 0.25 : radius * 0.02;
        for (int z = 0; z < 64; z++)
            for (int y = 0; y < 64; y++)
                for (int x = 0; x < 64; x++) {
                    double q[3] = {x + 0.5 - middle[0], y + 0.5 - middle[1], z + 0.5 - middle[2]};
                    double r = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]);
                    size_t c = at(x, y, z);
                    inside += r < radius - sag && !wall.hit[c];
                    leaks += r < radius - sag && seen.hit[c];
                    lost += r > radius && !wall.hit[c] && !seen.hit[c];
                }
        CHECK_NUM(inside > 1000, inside);
        CHECK_NUM(leaks == 0, leaks);
        CHECK_NUM(lost == 0, lost);
        free(t), free(wall.hit), free(seen.hit);
    }
}

TEST_MAIN
