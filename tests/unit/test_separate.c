/* The six-separating cells against the rule of grid.h, cell by cell, in integers.
 *
 * The oracle does not look at a triangle's plane, and has no cases: what a line meets of a triangle
 * reaches from the least to the largest of the points that are corners on the line, points of edges
 * on the line, and means of three corners on the line (these are the corners of a linear program).
 */
#include "libcore/voxels/exact.h"
#include "tests/unit/separated.h"

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

TEST_MAIN
