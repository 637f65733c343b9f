/* The cells of triangles against CGAL's exact kernel: the conservative set, the crosshairs of the
 * six-separating one, and the areas of pieces.
 *
 * A half-open cell [k, k+1) is the closed box [k, k+1-2^-200]: coordinates are multiples of 2^-32
 * below 2^20, so where a triangle meets a line of the lattice, or comes nearest to a corner, is a
 * quotient whose divisor has at most 160 bits, and no gap is as small as that. */
#include "tests/check.h"
#if !__has_include(<CGAL/Exact_predicates_exact_constructions_kernel.h>)
TEST(voxels_cgal) {
    SKIP("CGAL is not installed");
}
#else
#include <CGAL/Exact_predicates_exact_constructions_kernel.h>
#include <CGAL/Intersections_3/Iso_cuboid_3_Segment_3.h>
#include <CGAL/Intersections_3/Iso_cuboid_3_Triangle_3.h>
#include <CGAL/Intersections_3/Segment_3_Segment_3.h>
#include <CGAL/Intersections_3/Segment_3_Triangle_3.h>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <variant>
#include <vector>
/* These headers are C's. */
#define _Alignas alignas
extern "C" {
#include "libcore/voxels/clip.h"
#include "libcore/data/rng.h"
#include "libcore/voxels/separate.h"
}

using kernel = CGAL::Exact_predicates_exact_constructions_kernel;
using number = kernel::FT;
using point = kernel::Point_3;
using segment = kernel::Segment_3;
using triangle = kernel::Triangle_3;
using box = kernel::Iso_cuboid_3;
using cell = std::array<int, 3>;

struct tri {
    double p[3][3];
};

static uint64_t draws;
static double uniform(double low, double high) {
    return low + (high - low) * (double)(pbs_random(11, 0, draws++) >> 11) * 0x1p-53;
}
static int below(int n) {
    return (int)pbs_random_below(pbs_random(12, 0, draws++), (uint32_t)n);
}
static double snap(double x, double step) {
    return std::floor(x / step + 0.5) * step;
}

/* ---- what we say ---- */

struct found {
    std::map<cell, pbs_fragment> pieces;
    std::set<cell> hits;
    bool twice = false; /* a piece came again */
};

static cell cell_of(uint32_t c) {
    return {PBS_CELL_X(c), PBS_CELL_Y(c), PBS_CELL_Z(c)};
}
static void take_pieces(void *ctx, pbs_fragments *f) {
    found *to = (found *)ctx;
    for (uint32_t i = 0; i < f->count; i++)
        to->twice |= !to->pieces.emplace(cell_of(f->fragment[i].cell), f->fragment[i]).second;
    f->count = 0;
}
static void take_hits(void *ctx, pbs_hits *h) {
    for (uint32_t i = 0; i < h->count; i++) ((found *)ctx)->hits.insert(cell_of(h->hit[i].cell));
    h->count = 0;
}

static found ask(const tri &t, bool simd) {
    static pbs_triangles batch;
    static pbs_fragments pieces;
    static pbs_hits hits;
    found f;
    batch.count = 1;
    for (int k = 0; k < 3; k++) {
        for (int c = 0; c < 3; c++) batch.p[c][k][0] = t.p[c][k];
        batch.min[k][0] = std::fmin(t.p[0][k], std::fmin(t.p[1][k], t.p[2][k]));
        batch.max[k][0] = std::fmax(t.p[0][k], std::fmax(t.p[1][k], t.p[2][k]));
    }
    pieces.count = hits.count = 0;
    pieces.flush = take_pieces, hits.flush = take_hits;
    pieces.ctx = hits.ctx = &f;
    pbs_clip(&batch, true, simd, &pieces);
    take_pieces(&f, &pieces);
    pbs_separate(&batch, simd, &hits);
    take_hits(&f, &hits);
    return f;
}

/* ---- what CGAL says ---- */

/* A triangle may have no area. */
using shape = std::variant<point, segment, triangle>;

static shape exact(const tri &t) {
    point p[3];
    for (int i = 0; i < 3; i++) p[i] = point(t.p[i][0], t.p[i][1], t.p[i][2]);
    if (!CGAL::collinear(p[0], p[1], p[2])) return triangle(p[0], p[1], p[2]);
    std::sort(p, p + 3, kernel::Less_xyz_3());
    if (p[0] == p[2]) return p[0];
    return segment(p[0], p[2]);
}

static const number &end() {
    static const number e = number(1) - number(0x1p-200);
    return e;
}

static bool holds(const shape &s, const cell &c) {
    const box b(point(c[0], c[1], c[2]), point(c[0] + end(), c[1] + end(), c[2] + end()));
    if (const point *p = std::get_if<point>(&s)) return !b.has_on_unbounded_side(*p);
    if (const segment *l = std::get_if<segment>(&s)) return CGAL::do_intersect(*l, b);
    return CGAL::do_intersect(std::get<triangle>(s), b);
}

static bool crosses(const shape &s, const cell &c) {
    for (int k = 0; k < 3; k++) {
        number from[3], to[3];
        for (int i = 0; i < 3; i++) {
            from[i] = i == k ? number(c[i]) : number(c[i] + 0.5);
            to[i] = i == k ? c[i] + end() : from[i];
        }
        const segment hair(point(from[0], from[1], from[2]), point(to[0], to[1], to[2]));
        const point *p = std::get_if<point>(&s);
        const segment *l = std::get_if<segment>(&s);
        if (p   ? hair.has_on(*p)
            : l ? CGAL::do_intersect(*l, hair)
                : CGAL::do_intersect(std::get<triangle>(s), hair))
            return true;
    }
    return false;
}

static double area(const point &a, const point &b, const point &c) {
    kernel::Vector_3 n = CGAL::cross_product(b - a, c - a);
    return std::sqrt(CGAL::to_double(n.squared_length())) / 2;
}

static double area_in(const shape &s, const cell &c) {
    if (!std::holds_alternative<triangle>(s)) return 0;
    const box b(point(c[0], c[1], c[2]), point(c[0] + end(), c[1] + end(), c[2] + end()));
    auto piece = CGAL::intersection(std::get<triangle>(s), b);
    if (!piece) return 0;
    if (const triangle *t = boost::get<triangle>(&*piece))
        return area(t->vertex(0), t->vertex(1), t->vertex(2));
    const std::vector<point> *p = boost::get<std::vector<point>>(&*piece);
    double sum = 0;
    for (size_t i = 2; p && i < p->size(); i++) sum += area((*p)[0], (*p)[i - 1], (*p)[i]);
    return sum;
}

/* ---- one triangle ---- */

/* All cells of its box, or, if these are many, some and those around what we say. */
static std::set<cell> cells_to_ask(const tri &t, const found &f) {
    std::set<cell> ask;
    int low[3], n[3];
    double all = 1;
    for (int k = 0; k < 3; k++) {
        double a = std::fmin(t.p[0][k], std::fmin(t.p[1][k], t.p[2][k]));
        double b = std::fmax(t.p[0][k], std::fmax(t.p[1][k], t.p[2][k]));
        low[k] = (int)std::fmax(std::floor(a) - 1, -1);
        n[k] = (int)std::fmin(std::floor(b) + 1, PBS_BLOCK) - low[k] + 1;
        all *= n[k] > 0 ? n[k] : 0;
    }
    if (all <= 160) {
        for (int i = 0; i < (int)all; i++)
            ask.insert({low[0] + i % n[0], low[1] + i / n[0] % n[1], low[2] + i / n[0] / n[1]});
        return ask;
    }
    std::vector<cell> said;
    for (auto &p : f.pieces) said.push_back(p.first);
    said.insert(said.end(), f.hits.begin(), f.hits.end());
    for (int i = 0; i < 160; i++) {
        cell c;
        bool near = i % 4 && !said.empty();
        const cell from = near ? said[(size_t)below((int)said.size())] : cell();
        for (int k = 0; k < 3; k++) {
            int at = near ? from[k] + (i % 4 == 1 ? 0 : below(3) - 1) : low[k] + below(n[k]);
            c[k] = std::max(-1, std::min(at, PBS_BLOCK));
        }
        ask.insert(c);
    }
    return ask;
}

static void say(const char *what, const tri &t, const cell &c) {
    printf("# %s: cell %d %d %d of %a %a %a  %a %a %a  %a %a %a\n", what, c[0], c[1], c[2],
           t.p[0][0], t.p[0][1], t.p[0][2], t.p[1][0], t.p[1][1], t.p[1][2], t.p[2][0], t.p[2][1],
           t.p[2][2]);
    pbs_bad++;
}

static void check_areas(const tri &t, const shape &s, const found &f) {
    size_t step = f.pieces.size() / 12 + 1, i = 0;
    for (auto &p : f.pieces) {
        if (i++ % step) continue;
        double want = area_in(s, p.first);
        if (!(std::fabs(p.second.area - want) <= 1e-6 * std::fmax(want, 1)))
            say("another area", t, p.first);
    }
}

static bool is_inside(const tri &t) {
    bool inside = true;
    for (int i = 0; i < 9; i++)
        inside = inside && t.p[i / 3][i % 3] >= 0 && t.p[i / 3][i % 3] < PBS_BLOCK;
    return inside;
}

static void check_tri(const tri &t) {
    const shape s = exact(t);
    const found f = ask(t, false);
    if (f.twice) say("a piece came twice", t, {0, 0, 0});
    for (const cell &c : cells_to_ask(t, f)) {
        int outside = 0;
        for (int k = 0; k < 3; k++) outside += c[k] < 0 || c[k] >= PBS_BLOCK;
        if (!outside && holds(s, c) != (f.pieces.count(c) != 0)) say("conservative", t, c);
        if (outside < 2 && crosses(s, c) != (f.hits.count(c) != 0)) say("six-separating", t, c);
    }
    check_areas(t, s, f);
    if (is_inside(t) && std::holds_alternative<triangle>(s)) {
        const triangle &whole = std::get<triangle>(s);
        double sum = 0, want = area(whole.vertex(0), whole.vertex(1), whole.vertex(2));
        for (auto &p : f.pieces) sum += p.second.area;
        /* Rounding of pieces stays, which may be more than that of the area of a needle. */
        if (!(std::fabs(sum - want) <= 1e-9 * want + 1e-14))
            say("another sum of areas", t, {0, 0, 0});
    }
    if (!__builtin_cpu_supports("avx2")) return;
    const found g = ask(t, true);
    CHECK(g.hits == f.hits && g.pieces.size() == f.pieces.size());
    for (auto a = f.pieces.begin(), b = g.pieces.begin(); a != f.pieces.end(); ++a, ++b)
        CHECK(a->first == b->first && a->second.area == b->second.area);
}

/* ---- triangles ---- */

static tri around(double middle, double size, double step) {
    tri t;
    double m[3];
    for (double &x : m) x = uniform(middle - 2, middle + 2);
    for (int i = 0; i < 9; i++) t.p[i / 3][i % 3] = snap(m[i % 3] + uniform(-size, size), step);
    return t;
}

static void check_many(int n, double middle, double size, double step) {
    for (int i = 0; i < n; i++) check_tri(around(middle, size, step));
}

TEST(voxels_cgal_small) {
    check_many(150, 8, 0.4, 0x1p-32);
    check_many(150, 8, 2.5, 0x1p-32);
    check_many(60, 32, 12, 0x1p-32);
    /* Over the block's faces. */
    check_many(60, 0, 3, 0x1p-32);
    check_many(60, PBS_BLOCK, 3, 0x1p-32);
}

/* Corners on corners of cells, and on their middles. */
TEST(voxels_cgal_lattice) {
    for (double step : {1.0, 0.5, 0.25}) {
        check_many(100, 8, 2, step);
        check_many(40, 30, 9, step);
    }
    check_many(60, 0, 2, 0.5);
}

/* Across an axis, in planes between cells and through their middles, with edges along axes. */
TEST(voxels_cgal_flat) {
    for (int i = 0; i < 240; i++) {
        tri t = around(8, i % 5 ? 2.5 : 9, i % 2 ? 0.5 : 0x1p-32);
        int k = i % 3, a = (k + 1) % 3;
        double at = snap(t.p[0][k], i % 4 ? 0.5 : 0x1p-32);
        t.p[0][k] = t.p[1][k] = at;
        if (i % 7) t.p[2][k] = at;
        if (i % 3 == 0) t.p[1][a] = t.p[0][a];
        check_tri(t);
    }
}

/* Segments and points. */
TEST(voxels_cgal_degenerate) {
    for (int i = 0; i < 240; i++) {
        tri t = around(8, 3, i % 2 ? 0.5 : 0x1p-31);
        for (int k = 0; k < 3; k++) {
            if (i % 3 == 0) t.p[2][k] = (t.p[0][k] + t.p[1][k]) / 2;
            if (i % 3 == 1) t.p[2][k] = t.p[i % 2][k];
            if (i % 3 == 2) t.p[1][k] = t.p[2][k] = t.p[0][k];
        }
        check_tri(t);
    }
}

/* Of 1 : 10^8 and more: one edge is a few units of 2^-32. */
TEST(voxels_cgal_needles) {
    for (int i = 0; i < 160; i++) {
        tri t = around(i % 4 ? 10 : 32, i % 4 ? 4 : 24, i % 3 ? 0x1p-32 : 0.5);
        int from = i % 2;
        for (int k = 0; k < 3; k++)
            t.p[2][k] =
                snap(t.p[from][k] + uniform(-20, 20) * (i % 5 ? 0x1p-32 : 0x1p-26), 0x1p-32);
        check_tri(t);
    }
}

/* Planes through the block whose corners are as far away as they may be. */
TEST(voxels_cgal_far) {
    for (int i = 0; i < 120; i++) {
        tri t;
        double step = i % 3 ? 0x1p-32 : 0.5, far = i % 2 ? PBS_GRID_FAR - 100 : 3000;
        double a[3], b[3], m[3];
        for (int k = 0; k < 3; k++)
            a[k] = uniform(-1, 1), b[k] = i % 5 ? uniform(-1, 1) : a[k] + uniform(-1e-7, 1e-7),
            m[k] = uniform(0, PBS_BLOCK);
        for (int k = 0; k < 3; k++) {
            t.p[0][k] = snap(m[k] + far * a[k] * 0.9, step);
            t.p[1][k] = snap(m[k] - far * b[k] * 0.9, step);
            t.p[2][k] = snap(m[k] + (i % 4 ? far * (b[k] - a[k]) * 0.3 : uniform(-4, 4)), step);
        }
        check_tri(t);
    }
}

/* A ball, and a real model where there is one, in a block. */
TEST(voxels_cgal_meshes) {
    const int n = 12;
    auto at = [&](int i, int j, double *p) {
        double u = M_PI * i / n, v = M_PI * j / n;
        p[0] = snap(20 + 9.3 * std::sin(u) * std::cos(v), 0x1p-32);
        p[1] = snap(20 + 9.3 * std::sin(u) * std::sin(v), 0x1p-32);
        p[2] = snap(20 + 9.3 * std::cos(u), 0x1p-32);
    };
    for (int i = 0; i < n; i++)
        for (int j = 0; j < 2 * n; j += 2) {
            tri t;
            at(i, j, t.p[0]), at(i + 1, j, t.p[1]), at(i + 1, j + 1, t.p[2]);
            check_tri(t);
        }
    FILE *f = fopen("/usr/share/assimp/models/OBJ/spider.obj", "r");
    if (!f) return;
    std::vector<std::array<double, 3>> v;
    char line[512];
    int a[3], faces = 0;
    while (fgets(line, sizeof line, f)) {
        std::array<double, 3> p;
        if (sscanf(line, "v %lf %lf %lf", &p[0], &p[1], &p[2]) == 3) v.push_back(p);
        if (sscanf(line, "f %d%*s %d%*s %d", &a[0], &a[1], &a[2]) != 3 || ++faces % 8) continue;
        tri t;
        for (int i = 0; i < 9; i++)
            t.p[i / 3][i % 3] = snap(32 + v.at((size_t)a[i / 3] - 1)[(size_t)i % 3] / 4, 0x1p-32);
        check_tri(t);
    }
    fclose(f);
    CHECK(faces > 1000);
}
#endif

TEST_MAIN
