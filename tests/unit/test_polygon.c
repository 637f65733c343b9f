/* Laws of triangulation: n - 2 triangles; their areas add up to the polygon's as vectors, for any
 * polygon; for a simple one the sizes of the areas add up too, so nothing overlaps. */
#include "libcore/data/polygon.h"
#include "tests/check.h"
#include <math.h>
#include <time.h>

typedef struct shape {
    double *xy; /* 2 a corner */
    uint32_t n, room;
} shape;

static void add(shape *s, double x, double y) {
    if (s->n == s->room) {
        s->room = 2 * s->room + 16;
        s->xy = realloc(s->xy, 2 * s->room * sizeof(double));
        if (!s->xy) abort();
    }
    s->xy[2 * s->n] = x, s->xy[2 * s->n++ + 1] = y;
}

static uint64_t seed = 1;
/* 0 .. n - 1, from a generator of this file, so that the shapes never change */
static uint32_t any(uint32_t n) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)((seed >> 33) % n);
}

static double twice_area(const shape *s) {
    double a = 0;
    for (uint32_t i = 0, j = s->n - 1; i < s->n; j = i++)
        a += s->xy[2 * j] * s->xy[2 * i + 1] - s->xy[2 * i] * s->xy[2 * j + 1];
    return a;
}

typedef struct result {
    double sum[3], size; /* twice the areas: as vectors, and their lengths */
    uint32_t degenerate;
    bool clean, valid;
    double seconds;
} result;

static double measure(const double *xyz, const uint32_t *t, double sum[3]) {
    double u[3], v[3], a[3];
    for (int k = 0; k < 3; k++) {
        u[k] = xyz[6 * t[1] + k] - xyz[6 * t[0] + k];
        v[k] = xyz[6 * t[2] + k] - xyz[6 * t[0] + k];
    }
    for (int k = 0; k < 3; k++) {
        a[k] = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
        sum[k] += a[k];
    }
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
}

/* The shape in the plane that m's first two columns span, 9 numbers by rows, corner `first` first.
 * Everything is allocated in the exact size. */
static result cut(const shape *s, const double m[9], const double offset[3], uint32_t first) {
    result r = {{0, 0, 0}, 0, 0, false, true, 0};
    uint32_t n = s->n, *t = malloc((size_t)(n > 2 ? n - 2 : 1) * 3 * sizeof *t);
    double *xyz = malloc((size_t)n * 6 * sizeof *xyz);
    void *scratch = malloc(pbs_polygon_scratch(n) + 1);
    if (!t || !xyz || !scratch) abort();
    for (uint32_t i = 0; i < n; i++) {
        const double *p = s->xy + 2 * ((i + first) % n);
        for (int k = 0; k < 3; k++)
            xyz[6 * i + (size_t)k] = m[3 * k] * p[0] + m[3 * k + 1] * p[1] + offset[k];
    }
    clock_t begin = clock();
    r.clean = pbs_polygon_triangulate(xyz, 6, n, t, scratch);
    r.seconds = (double)(clock() - begin) / CLOCKS_PER_SEC;
    for (uint32_t i = 0; i + 2 < n; i++) {
        const uint32_t *c = t + 3 * i;
        if (c[0] >= n || c[1] >= n || c[2] >= n || c[0] == c[1] || c[1] == c[2] || c[2] == c[0]) {
            r.valid = false;
            break;
        }
        double size = measure(xyz, c, r.sum);
        r.size += size;
        r.degenerate += size == 0;
    }
    free(t), free(xyz), free(scratch);
    return r;
}

static const double flat[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, nowhere[3] = {0, 0, 0};
/* Twists the xy plane into another one; determinant 1, rows of length 1. */
static const double tilted[9] = {0.36, 0.48, -0.8, -0.8, 0.6, 0, 0.48, 0.64, 0.6};
static const double upside[9] = {0, 1, 0, 1, 0, 0, 0, 0, -1};

/* A simple polygon with exact coordinates, in several poses and from every corner. */
static void check_simple(const shape *s, uint32_t degenerate) {
    double area = fabs(twice_area(s));
    for (uint32_t first = 0; first < s->n; first += 1 + s->n / 40) {
        result r = cut(s, flat, nowhere, first);
        CHECK(r.valid && r.clean);
        CHECK_NUM(r.size == area, r.size - area);
        CHECK_NUM(r.degenerate == degenerate, r.degenerate);
        r = cut(s, upside, nowhere, first);
        CHECK(r.valid && r.clean && r.size == area && r.degenerate == degenerate);
        r = cut(s, tilted, nowhere, first);
        CHECK(r.valid && r.clean);
        CHECK_NUM(fabs(r.size - area) <= 1e-12 * area, r.size / area - 1);
        r = cut(s, tilted, (double[3]){1e7, -2e7, 3e7}, first);
        CHECK(r.valid);
        CHECK_NUM(fabs(r.size - area) <= 1e-6 * area, r.size / area - 1);
    }
}

static void comb(shape *s, int teeth) {
    s->n = 0;
    for (int i = 0; i < teeth; i++)
        add(s, 2 * i, 0), add(s, 2 * i, 10), add(s, 2 * i + 1, 10), add(s, 2 * i + 1, 0);
    add(s, 2 * teeth - 1, -1), add(s, 0, -1);
}

static void star(shape *s, uint32_t n) {
    s->n = 0;
    for (uint32_t i = 0; i < n; i++) {
        double r = i % 2 ? 1000 : 400, a = 6.283185307179586 * i / n;
        add(s, rint(r * cos(a)), rint(r * sin(a)));
    }
}

static void spiral(shape *s, uint32_t n) {
    s->n = 0;
    for (uint32_t i = 0; i < n; i++) {
        double a = 0.3 * i, r = 10 + a;
        add(s, r * cos(a), r * sin(a));
    }
    for (uint32_t i = n; i-- > 0;) {
        double a = 0.3 * i, r = 13 + a;
        add(s, r * cos(a), r * sin(a));
    }
}

/* Puts k corners on every side. */
static void subdivide(shape *s, int k) {
    shape out = {0};
    for (uint32_t i = 0; i < s->n; i++) {
        const double *a = s->xy + 2 * i, *b = s->xy + 2 * ((i + 1) % s->n);
        for (int j = 0; j <= k; j++)
            add(&out, a[0] + (b[0] - a[0]) * j / (k + 1), a[1] + (b[1] - a[1]) * j / (k + 1));
    }
    free(s->xy);
    *s = out;
}

TEST(convex) {
    shape s = {0};
    for (uint32_t n = 3; n < 40; n++) {
        s.n = 0;
        for (uint32_t i = 0; i < n; i++)
            add(&s, rint(1e4 * cos(6.2831853 * i / n)), rint(1e4 * sin(6.2831853 * i / n)));
        check_simple(&s, 0);
    }
    free(s.xy);
}

TEST(concave_quads) {
    /* every arrow with the notch at each corner, and a triangle with a corner on a side */
    static const double arrow[8] = {0, 0, 4, -4, 1, 0, 4, 4}, on_side[8] = {0, 0, 2, 0, 4, 0, 0, 4};
    shape s = {0};
    for (int i = 0; i < 4; i++) add(&s, arrow[2 * i], arrow[2 * i + 1]);
    check_simple(&s, 0);
    for (int i = 0; i < 4; i++) s.xy[2 * i] = on_side[2 * i], s.xy[2 * i + 1] = on_side[2 * i + 1];
    check_simple(&s, 0);
    free(s.xy);
}

TEST(concave) {
    static const double c[16] = {0, 0, 8, 0, 8, 2, 2, 2, 2, 6, 8, 6, 8, 8, 0, 8};
    shape s = {0};
    for (int i = 0; i < 8; i++) add(&s, c[2 * i], c[2 * i + 1]);
    check_simple(&s, 0);
    comb(&s, 9);
    check_simple(&s, 0);
    star(&s, 42);
    check_simple(&s, 0);
    free(s.xy);
}

TEST(collinear_corners_make_no_degenerate_triangles) {
    shape s = {0};
    add(&s, 0, 0), add(&s, 64, 0), add(&s, 0, 64);
    subdivide(&s, 3);
    check_simple(&s, 0);
    s.n = 0;
    add(&s, 0, 0), add(&s, 16, 0), add(&s, 16, 16), add(&s, 0, 16);
    subdivide(&s, 3);
    check_simple(&s, 0);
    comb(&s, 6);
    subdivide(&s, 1);
    check_simple(&s, 0);
    free(s.xy);
}

TEST(equal_corners) {
    shape s = {0}, twice = {0};
    comb(&s, 4);
    for (uint32_t i = 0; i < s.n; i++)
        for (uint32_t k = 0; k <= i % 3; k++) add(&twice, s.xy[2 * i], s.xy[2 * i + 1]);
    check_simple(&twice, twice.n - s.n);
    free(s.xy), free(twice.xy);
}

/* A square with square holes, all joined to one outline by bridges that are walked twice. */
TEST(holes_with_bridges) {
    shape s = {0};
    add(&s, 0, 0);
    for (int i = 0; i < 5; i++) {
        double x = 4 + 8 * i;
        add(&s, x, 0);
        add(&s, x, 4), add(&s, x, 8), add(&s, x + 4, 8), add(&s, x + 4, 4), add(&s, x, 4);
        add(&s, x, 0);
    }
    add(&s, 44, 0), add(&s, 44, 12), add(&s, 0, 12);
    check_simple(&s, 0);
    free(s.xy);
}

/* A slit is walked in and out again: no area, but corners on both its sides. */
TEST(slits) {
    shape s = {0};
    add(&s, 0, 0), add(&s, 8, 0), add(&s, 8, 4), add(&s, 2, 4), add(&s, 8, 4), add(&s, 8, 8);
    add(&s, 4, 8), add(&s, 4, 12), add(&s, 4, 8), add(&s, 0, 8);
    for (uint32_t first = 0; first < s.n; first++) {
        result r = cut(&s, flat, nowhere, first);
        CHECK(r.valid && r.size == 128);
    }
    free(s.xy);
}

/* Random outlines that see the origin from every corner: simple, and as concave as can be. */
TEST(random_star_shaped) {
    shape s = {0};
    for (int round = 0; round < 300; round++) {
        uint32_t n = 5 + any(60);
        s.n = 0;
        for (uint32_t i = 0; i < n; i++) {
            double a = 6.283185307179586 * (i + 0.4 * any(1000) / 1000.0) / n, r = 1 + any(1000);
            add(&s, ldexp(rint(ldexp(r * cos(a), 20)), -20),
                ldexp(rint(ldexp(r * sin(a), 20)), -20));
        }
        double area = fabs(twice_area(&s));
        result r = cut(&s, flat, nowhere, any(n));
        CHECK(r.valid && r.clean);
        CHECK_NUM(fabs(r.size - area) <= 1e-12 * area, r.size / area - 1);
        r = cut(&s, tilted, nowhere, any(n));
        CHECK(r.valid && fabs(r.size - area) <= 1e-9 * area);
    }
    free(s.xy);
}

/* Corners on a tiny lattice: crossing, touching, coinciding. Still n - 2 triangles and the right
 * sum of vectors. */
TEST(random_garbage) {
    shape s = {0};
    for (int round = 0; round < 3000; round++) {
        uint32_t n = 3 + any(round % 10 ? 12 : 200), side = 2 + any(6);
        s.n = 0;
        for (uint32_t i = 0; i < n; i++) add(&s, any(side), any(side));
        result r = cut(&s, flat, nowhere, 0);
        double area = twice_area(&s);
        CHECK(r.valid && r.sum[0] == 0 && r.sum[1] == 0);
        CHECK_NUM(r.sum[2] == area, r.sum[2] - area);
        if (r.clean) CHECK_NUM(r.size == fabs(area), r.size - fabs(area));
    }
    free(s.xy);
}

TEST(scales) {
    shape s = {0};
    for (int e = -1070; e <= 960; e += 70) {
        comb(&s, 3);
        double area = twice_area(&s);
        for (uint32_t i = 0; i < 2 * s.n; i++) s.xy[i] = ldexp(s.xy[i], e);
        result r = cut(&s, flat, nowhere, 0);
        CHECK(r.valid && r.clean);
        if (abs(e) < 240) CHECK(r.size == ldexp(fabs(area), 2 * e));
    }
    free(s.xy);
}

TEST(not_finite_and_no_area) {
    static const double bad[] = {NAN, INFINITY, -INFINITY, 1e308, -1e308, 5e-324};
    shape s = {0};
    for (uint32_t n = 0; n < 12; n++)
        for (size_t b = 0; b < sizeof bad / sizeof *bad; b++) {
            s.n = 0;
            for (uint32_t i = 0; i < n; i++) add(&s, i == n / 2 ? bad[b] : i, (i * i) % 5);
            result r = cut(&s, flat, nowhere, 0);
            CHECK(r.valid);
            CHECK(b > 2 || n < 5 || !r.clean);
        }
    s.n = 0;
    for (uint32_t i = 0; i < 9; i++) add(&s, i, 2 * i);
    CHECK(cut(&s, flat, nowhere, 0).degenerate == 7);
    for (uint32_t i = 0; i < 18; i++) s.xy[i] = 3;
    CHECK(cut(&s, tilted, nowhere, 0).degenerate == 7);
    free(s.xy);
}

static void check_big(const shape *s, const double m[9], bool simple) {
    result r = cut(s, m, nowhere, 0);
    double area = fabs(twice_area(s));
    CHECK(r.valid && (!simple || r.clean));
    if (simple) CHECK_NUM(fabs(r.size - area) <= 1e-9 * area, r.size / area - 1);
    CHECK_NUM(r.seconds < 10, r.seconds); /* n^2 would be minutes */
}

/* 100,000 corners, in shapes that defeat a grid or a sweep. */
TEST(big) {
    shape s = {0};
    spiral(&s, 50000);
    check_big(&s, flat, true);
    comb(&s, 25000);
    for (uint32_t i = 0; i < s.n; i++) s.xy[2 * i] /= 5000;
    static const double diagonal[9] = {0.8, -0.6, 0, 0.6, 0.8, 0, 0, 0, 1};
    check_big(&s, diagonal, true);
    s.n = 0;
    for (uint32_t i = 0; i < 100000; i++) {
        double r = 1000 + any(1000) * 1e-3, a = 6.283185307179586 * i / 100000;
        if (i == 7) r = 1e6; /* everything else is one dot beside this corner */
        add(&s, r * cos(a), r * sin(a));
    }
    check_big(&s, tilted, true);
    s.n = 0;
    for (uint32_t i = 0; i < 20000; i++) add(&s, any(1 << 20), any(1 << 20));
    check_big(&s, flat, false);
    free(s.xy);
}

TEST_MAIN
