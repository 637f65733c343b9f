/* Far away, very small and very large, needles, mirrored and sheared instances, coincident
 * surfaces: the candidates are those of the plain twin, within what gbuffer.h says. */
#include "tests/unit/gbuffer_shape.h"

enum { RESOLUTION = 160 };
static const uint32_t CHANNELS = PBS_NORMAL | PBS_COLOUR;

static const double CENTRED[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

static result draw_with(const shape *s, const double m[12], uint32_t channels) {
    pbs_draw d = placed(s);
    memcpy(d.m, m, sizeof d.m);
    picture p = {.draws = &d, .draw_count = 1};
    pbs_gbuffer_params params = {
        .resolution = RESOLUTION, .channels = channels, .box = box_of(&d, 1)};
    result r = draw_scene(&p, &params, 1);
    CHECK(r.rc == PBS_OK && r.count == 8 && r.stats.candidates > 1000);
    return r;
}

/* How two pictures differ; lengths in pixels of the first. */
typedef struct difference {
    size_t pixels;   /* of both together */
    size_t only_one; /* covered in one of the two only */
    size_t moved;    /* farther apart than allowed */
    size_t turned;   /* normals farther apart than allowed */
} difference;

typedef struct relation {
    double back[12]; /* from the second's frame to the first's */
    double slack;    /* allowed distance */
    double degrees;  /* allowed angle of normals; 0: 0.02, what their code can be off */
    bool mirrored;   /* the second picture is the first from right to left */
} relation;

static void compare_points(difference *d, const kept *a, size_t i, const kept *b, size_t j,
                           const relation *rel) {
    const float *p = a->p.position + 3 * i, *q = b->p.position + 3 * j;
    double back[3] = {q[0], q[1], q[2]}, far = 0, sum = 0, l = 0, cof[9];
    pbs_xform_point(back, rel->back, back);
    for (int k = 0; k < 3; k++) far = fmax(far, fabs(back[k] - p[k]));
    if (!(far <= rel->slack)) {
        d->moved++;
        return;
    }
    if (!a->p.normal) return;
    float n[3], m[3];
    pbs_oct_decode(n, a->p.normal + 2 * i);
    pbs_oct_decode(m, b->p.normal + 2 * j);
    pbs_xform_cofactor(cof, rel->back);
    double sign = pbs_xform_det(rel->back) < 0 ? -1 : 1;
    for (int k = 0; k < 3; k++) {
        double t = sign * (cof[3 * k] * m[0] + cof[3 * k + 1] * m[1] + cof[3 * k + 2] * m[2]);
        sum += t * n[k], l += t * t;
    }
    double unit[3] = {n[0], n[1], n[2]};
    d->turned += !(sum / sqrt(l * dot(unit, unit)) >
                   cos((rel->degrees > 0 ? rel->degrees : 0.02) * M_PI / 180));
}

static uint32_t seen_at(const kept *k, size_t i, bool mirrored) {
    uint32_t w = k->v.width, at = k->where[i];
    return mirrored ? at / w * w + (w - 1 - at % w) : at;
}

static void compare_views(difference *d, const kept *a, const kept *b, const relation *rel) {
    size_t size = (size_t)a->v.width * a->v.height, both = 0;
    uint32_t *other = malloc(size * sizeof *other);
    memset(other, 0xff, size * sizeof *other);
    CHECK(a->v.width == b->v.width && a->v.height == b->v.height);
    for (size_t j = 0; j < b->p.count; j++) other[seen_at(b, j, rel->mirrored)] = (uint32_t)j;
    for (size_t i = 0; i < a->p.count; i++) {
        uint32_t j = other[a->where[i]];
        if (j == UINT32_MAX) continue;
        both++;
        compare_points(d, a, i, b, j, rel);
    }
    d->pixels += a->p.count + b->p.count - both;
    d->only_one += a->p.count + b->p.count - 2 * both;
    free(other);
}

static difference compare(const result *a, const result *b, const relation *rel) {
    difference d = {0};
    for (int v = 0; v < 8; v++) compare_views(&d, &a->view[v], &b->view[v], rel);
    return d;
}

static void few(const difference *d, double share) {
    CHECK(d->pixels > 1000);
    CHECK_NUM((double)d->only_one <= share * (double)d->pixels, d->only_one);
    CHECK_NUM((double)d->moved <= share * (double)d->pixels, d->moved);
    CHECK_NUM((double)d->turned <= share * (double)d->pixels, d->turned);
}

/* A tilted disc of 2 n triangles around its middle: every second one is a needle, as wide at its
 * end as two floats are apart, 1 : 10^7 to 1 : 10^8 and thinner. bare: without the needles. */
static shape needle_disc(uint32_t n, bool bare) {
    shape s = new_shape(1 + 2 * n, bare ? n : 2 * n);
    for (uint32_t i = 0; i < n; i++) {
        double a = 2 * M_PI * i / n + 0.1;
        float *p = s.position + 3 * (1 + 2 * i), *q = p + 3;
        corner_is(&s, 1 + 2 * i, cos(a), sin(a), 0.3 * cos(a) - 0.2 * sin(a));
        memcpy(q, p, 12);
        q[i & 1] = nextafterf(p[i & 1], 2);
        uint32_t next = (2 * i + 2) % (2 * n);
        uint16_t t[6] = {0, (uint16_t)(2 + 2 * i), (uint16_t)(1 + next),
                         0, (uint16_t)(1 + 2 * i), (uint16_t)(2 + 2 * i)};
        memcpy(s.index + (bare ? 3 : 6) * i, t, bare ? 6 : 12);
    }
    return s;
}

/* A few ulps of the largest coordinate, which is about 1. */
#define ULPS 0x1p-21

/* ---- scale and place ---- */

TEST(any_scale) {
    shape s = ball(60, 90, 0.1);
    result a = draw_with(&s, CENTRED, CHANNELS);
    double factor[] = {1e-9, 1e9, 1e-30, 1e30, 0.1, 3, 1 / 0.7};
    for (size_t i = 0; i < sizeof factor / sizeof *factor; i++) {
        double f = factor[i], g = 1 / f;
        result b = draw_with(&s, (double[12]){f, 0, 0, 0, 0, f, 0, 0, 0, 0, f, 0}, CHANNELS);
        relation rel = {{g, 0, 0, 0, 0, g, 0, 0, 0, 0, g, 0}, ULPS, 0, false};
        difference d = compare(&a, &b, &rel);
        few(&d, 1e-3);
        CHECK(fabs(b.stats.pixel / f / a.stats.pixel - 1) < 1e-12);
        drop(&b);
    }
    drop(&a);
    free_shape(&s);
}

/* The same factors in the vertices, taken back by the matrix or not. */
TEST(scale_of_the_vertices) {
    shape s = ball(60, 90, 0.1), t = ball(60, 90, 0.1);
    result a = draw_with(&s, CENTRED, CHANNELS);
    double power[] = {-30, 30, -100, 100};
    for (size_t i = 0; i < 4; i++) {
        double f = pow(2, power[i]), g = 1 / f;
        for (uint32_t k = 0; k < 3 * s.mesh.vertices; k++)
            t.position[k] = (float)(f * s.position[k]);
        result b = draw_with(&t, (double[12]){g, 0, 0, 0, 0, g, 0, 0, 0, 0, g, 0}, CHANNELS);
        result c = draw_with(&t, CENTRED, CHANNELS);
        for (int v = 0; v < 8; v++)
            for (size_t k = 0; k < 3 * c.view[v].p.count; k++)
                c.view[v].p.position[k] = (float)(g * c.view[v].p.position[k]);
        CHECK(same(&a, &b) && same(&a, &c));
        drop(&b), drop(&c);
    }
    drop(&a);
    free_shape(&s), free_shape(&t);
}

/* What is far from the frame's origin: the picture is the same; positions are the floats there. */
TEST(far_from_the_origin) {
    shape s[2] = {ball(60, 90, 0.1), needle_disc(50, false)};
    for (int i = 0; i < 2; i++) {
        result a = draw_with(&s[i], CENTRED, PBS_NORMAL);
        result b =
            draw_with(&s[i], (double[12]){1, 0, 0, 1e7, 0, 1, 0, -1e7, 0, 0, 1, 3e6}, PBS_NORMAL);
        relation rel = {{1, 0, 0, -1e7, 0, 1, 0, 1e7, 0, 0, 1, -3e6}, 0.501, 0, false};
        difference d = compare(&a, &b, &rel);
        few(&d, 1e-3);
        drop(&a), drop(&b);
    }
    free_shape(&s[0]), free_shape(&s[1]);
}

/* A part of 10^-9 beside one of 10^9: the picture of both is that of the large one, and the small
 * one by itself, in its own frame, is what it is anywhere. */
TEST(both_ends_in_one_scene) {
    shape s = ball(60, 90, 0.1);
    pbs_draw d[2] = {placed(&s), placed(&s)};
    for (int i = 0; i < 3; i++) d[0].m[5 * i] = 1e9, d[1].m[5 * i] = 1e-9;
    picture p = {.draws = d, .draw_count = 1};
    pbs_gbuffer_params params = {
        .resolution = RESOLUTION, .channels = CHANNELS, .box = box_of(d, 1)};
    result large = draw_scene(&p, &params, 1);
    for (int where = 0; where < 3; where++) { /* in its middle, on its rim, outside */
        d[1].m[3] = where == 1 ? 1.05e9 : 0, d[1].m[7] = where == 2 ? 1.2e9 : 0;
        p.draw_count = 2;
        result both = draw_scene(&p, &params, 1);
        if (where != 1) CHECK(same(&large, &both));
        relation rel = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, 1e9 * ULPS, 0, false};
        difference diff = compare(&large, &both, &rel);
        CHECK_NUM(diff.moved + diff.only_one + diff.turned <= 8, diff.moved + diff.only_one);
        drop(&both);
    }
    result plain = draw_with(&s, CENTRED, CHANNELS);
    d[1].m[3] = d[1].m[7] = 0;
    p = (picture){.draws = d + 1, .draw_count = 1};
    params.box = box_of(d + 1, 1);
    result small = draw_scene(&p, &params, 1);
    relation rel = {{1e9, 0, 0, 0, 0, 1e9, 0, 0, 0, 0, 1e9, 0}, ULPS, 0, false};
    difference diff = compare(&plain, &small, &rel);
    few(&diff, 1e-3);
    /* The large one drawn around it does not shake it: what is beyond the box is moved there. */
    params.box = (pbs_box){{-2e-9, -2e-9, -2e-9}, {2e-9, 2e-9, 2e-9}};
    result bare = draw_scene(&p, &params, 1);
    p = (picture){.draws = d, .draw_count = 2};
    result around = draw_scene(&p, &params, 1);
    CHECK(around.rc == PBS_OK && around.stats.candidates >= bare.stats.candidates);
    drop(&plain), drop(&small), drop(&large), drop(&bare), drop(&around);
    free_shape(&s);
}

/* ---- needles ---- */

TEST(needles_in_a_surface) {
    shape s = needle_disc(50, false), without = needle_disc(50, true);
    result a = draw_with(&s, CENTRED, PBS_NORMAL), plain = draw_with(&without, CENTRED, PBS_NORMAL);
    relation same_place = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, ULPS, 0, false};
    difference d = compare(&a, &plain, &same_place);
    few(&d, 0);
    double factor[] = {1e-9, 1e9, 7};
    for (size_t i = 0; i < 3; i++) {
        double f = factor[i], g = 1 / f;
        result b =
            draw_with(&s, (double[12]){f, 0, 0, 40 * f, 0, f, 0, 0, 0, 0, f, -30 * f}, PBS_NORMAL);
        relation rel = {{g, 0, 0, -40, 0, g, 0, 0, 0, 0, g, 30}, 64 * ULPS, 0, false};
        d = compare(&a, &b, &rel);
        few(&d, 2e-3);
        drop(&b);
    }
    drop(&a), drop(&plain);
    free_shape(&s), free_shape(&without);
}

/* ---- transforms of instances ---- */

/* Mirrored at x = 0, directions (1,1,1) and (-1,1,1) change places, as (1,-1,1) and -(1,1,-1). */
TEST(mirrored_instance) {
    static const int twin[8] = {2, 3, 0, 1, 7, 6, 5, 4};
    shape s = ball(60, 90, 0.1);
    for (int how = 0; how < 2; how++) {
        s.mesh.normal = how ? NULL : s.normal;
        result a = draw_with(&s, CENTRED, CHANNELS);
        result b = draw_with(&s, (double[12]){-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, CHANNELS);
        relation rel = {{-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, ULPS, 0, true};
        difference d = {0};
        for (int v = 0; v < 8; v++) {
            CHECK(a.view[v].v.toward[0] * b.view[twin[v]].v.toward[0] < 0);
            compare_views(&d, &a.view[v], &b.view[twin[v]], &rel);
        }
        few(&d, 2e-3);
        size_t away = 0; /* the face's own normal is never turned from the viewer */
        for (int v = 0; how && v < 8; v++)
            for (size_t i = 0; i < b.view[v].p.count; i++) {
                float n[3];
                pbs_oct_decode(n, b.view[v].p.normal + 2 * i);
                double m[3] = {n[0], n[1], n[2]};
                away += dot(m, b.view[v].v.toward) < -1e-4;
            }
        CHECK_NUM(away == 0, away);
        drop(&a), drop(&b);
    }
    s.mesh.normal = s.normal;
    free_shape(&s);
}

/* A sheared, mirrored, squeezed instance, and a mesh whose vertices and normals were taken there
 * beforehand (normals by the inverse transpose). */
TEST(sheared_instance) {
    static const double m[4][12] = {{1, 0.8, 0, 0, 0, 1, 0.5, 0, 0, 0, 1, 0},
                                    {-1, 0.3, 0, 2, 0.2, 1, -0.4, 1, 0, 0.7, 0.5, 3},
                                    {1, 0, 0, 0, 0, 1e-3, 0, 0, 0.5, 0, 1, 0},
                                    {0, -2, 0, 0, 3, 0, 0.1, 0, 0, 0, 1, 0}};
    shape s = ball(60, 90, 0.1), t = ball(60, 90, 0.1);
    for (int i = 0; i < 8; i++) {
        double cof[9], sign = pbs_xform_det(m[i % 4]) < 0 ? -1 : 1;
        pbs_xform_cofactor(cof, m[i % 4]);
        for (uint32_t v = 0; v < s.mesh.vertices; v++) {
            double p[3], g[3];
            float n[3];
            for (int k = 0; k < 3; k++) p[k] = s.position[3 * v + (uint32_t)k];
            pbs_xform_point(p, m[i % 4], p);
            corner_is(&t, v, p[0], p[1], p[2]);
            pbs_oct_decode(n, s.normal + 2 * v);
            for (int k = 0; k < 3; k++)
                g[k] = sign * (cof[3 * k] * n[0] + cof[3 * k + 1] * n[1] + cof[3 * k + 2] * n[2]);
            double l = sqrt(dot(g, g));
            for (int k = 0; k < 3; k++) n[k] = (float)(g[k] / l);
            pbs_oct_encode(t.normal + 2 * v, n);
        }
        s.mesh.normal = i < 4 ? s.normal : NULL, t.mesh.normal = i < 4 ? t.normal : NULL;
        result a = draw_with(&t, CENTRED, PBS_NORMAL), b = draw_with(&s, m[i % 4], PBS_NORMAL);
        /* A smooth normal is interpolated before or after the matrix: not quite the same. */
        relation rel = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, 16 * ULPS, i < 4 ? 1 : 0.02, false};
        difference d = compare(&a, &b, &rel);
        few(&d, i < 4 ? 0.01 : 3e-3);
        drop(&a), drop(&b);
    }
    s.mesh.normal = s.normal, t.mesh.normal = t.normal;
    free_shape(&s), free_shape(&t);
}

/* ---- coincident surfaces ---- */

static size_t colour_seen(const result *r, int red) {
    size_t n = 0;
    for (int v = 0; v < 8; v++)
        for (size_t i = 0; i < r->view[v].p.count; i++)
            n += (r->view[v].p.colour[4 * i] == 255) == red;
    return n;
}

/* The same surface twice, red and green: everywhere the one that comes first, wherever the scene
 * lies, however large it is, and also if mirrored or sheared. */
TEST(coincident_surfaces) {
    static const double m[5][12] = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                                    {1e-9, 0, 0, 0, 0, 1e-9, 0, 0, 0, 0, 1e-9, 0},
                                    {1e9, 0, 0, 1e12, 0, 1e9, 0, 0, 0, 0, 1e9, -1e11},
                                    {1, 0, 0, 1e7, 0, -1, 0, 1e7, 0, 0, 1, -1e7},
                                    {1, 0.5, 0, 3, 0, 1, 0.2, 0, 0, 0, -0.3, 0}};
    shape s = ball(40, 60, 0.1);
    pbs_material mat[2] = {PBS_MATERIAL_DEFAULT, PBS_MATERIAL_DEFAULT};
    mat[0].base[1] = mat[0].base[2] = mat[1].base[0] = mat[1].base[2] = 0;
    pbs_mesh twin = s.mesh;
    s.mesh.material = 0, twin.material = 1;
    for (int i = 0; i < 10; i++) {
        pbs_draw d[2] = {placed(&s), placed(&s)};
        d[1 - (i & 1)].mesh = &twin;
        for (int k = 0; k < 2; k++) memcpy(d[k].m, m[i / 2], sizeof d[k].m);
        picture p = {.draws = d, .draw_count = 2, .materials = mat, .material_count = 2};
        pbs_gbuffer_params params = {
            .resolution = RESOLUTION, .channels = CHANNELS, .box = box_of(d, 2)};
        result r = draw_scene(&p, &params, 1), one;
        p.draw_count = 1;
        one = draw_scene(&p, &params, 1);
        CHECK(r.stats.candidates > 1000 && same(&r, &one));
        CHECK_NUM(colour_seen(&r, i & 1) == 0, colour_seen(&r, i & 1));
        drop(&r), drop(&one);
    }
    free_shape(&s);
}

/* A tilted square of n x n cells. */
static shape square(uint32_t n, double lift) {
    shape s = new_shape((n + 1) * (n + 1), 2 * n * n);
    for (uint32_t y = 0, v = 0, t = 0; y <= n; y++)
        for (uint32_t x = 0; x <= n; x++, v++) {
            double a = (double)x / n, b = (double)y / n;
            corner_is(&s, v, a, b, 0.4 * a - 0.7 * b + lift);
            if (x == n || y == n) continue;
            uint16_t q[6] = {(uint16_t)v,       (uint16_t)(v + 1),     (uint16_t)(v + n + 1),
                             (uint16_t)(v + 1), (uint16_t)(v + n + 2), (uint16_t)(v + n + 1)};
            memcpy(s.index + 6 * t++, q, sizeof q);
        }
    return s;
}

/* The same square from other triangles: rounding decides which of the two is seen, but how a
 * candidate is turned and, but for 1/256 pixel at edges, where it lies is one and the same. */
TEST(coplanar_surfaces) {
    shape s = square(1, 0), t = square(37, 0);
    result one = draw_with(&s, CENTRED, PBS_NORMAL);
    pbs_draw d[2] = {placed(&s), placed(&t)};
    picture p = {.draws = d, .draw_count = 2};
    pbs_gbuffer_params params = {
        .resolution = RESOLUTION, .channels = PBS_NORMAL, .box = box_of(d, 2)};
    result both = draw_scene(&p, &params, 1);
    relation rel = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, one.stats.pixel / 64, 0, false};
    difference diff = compare(&one, &both, &rel);
    CHECK_NUM(diff.pixels == one.stats.candidates, diff.pixels);
    few(&diff, 0);
    drop(&one), drop(&both);
    free_shape(&s), free_shape(&t);
}

/* The two sides of a wall that is as thick as gbuffer.h says are told apart in every view. */
TEST(sides_of_a_thin_wall) {
    shape s = square(3, 0), t = square(41, 1.1e-4);
    for (int e = -30; e <= 30; e += 30) {
        pbs_draw d[2] = {placed(&s), placed(&t)};
        for (int i = 0; i < 3; i++) d[0].m[5 * i] = d[1].m[5 * i] = ldexp(1, e);
        number_triangles(&s);
        memset(s.colour, 0, 4 * (size_t)s.mesh.vertices);
        picture p = {.draws = d, .draw_count = 2};
        pbs_gbuffer_params params = {
            .resolution = RESOLUTION, .channels = PBS_COLOUR, .box = box_of(d, 2)};
        result r = draw_scene(&p, &params, 1);
        size_t wrong = 0;
        for (int v = 0; v < 8; v++) {
            const double g[3] = {-0.4, 0.7, 1};
            bool above = dot(g, r.view[v].v.toward) > 0;
            for (size_t i = 0; i < r.view[v].p.count; i++) {
                double x = ldexp(r.view[v].p.position[3 * i], -e);
                double y = ldexp(r.view[v].p.position[3 * i + 1], -e);
                bool rim = fabs(x - 0.5) > 0.49 || fabs(y - 0.5) > 0.49; /* one past the other */
                wrong += !rim && (r.view[v].p.colour[4 * i] == 255) != above;
            }
        }
        double thick = ldexp(1.1e-4, e) / sqrt(0.4 * 0.4 + 0.7 * 0.7 + 1);
        CHECK(r.stats.candidates > 1000 && thick < 2.1 / 256 * r.stats.pixel);
        CHECK_NUM(wrong == 0, wrong);
        drop(&r);
        free(s.colour);
        s.mesh.colour = s.colour = NULL;
    }
    free_shape(&s), free_shape(&t);
}

TEST_MAIN
