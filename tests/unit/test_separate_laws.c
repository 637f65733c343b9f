/* Laws of the six-separating cells: what must not change them, and that closed surfaces are closed
 * (Laine 2013): no path through faces of cells leads from outside to inside. */
#include "tests/unit/separated.h"

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
