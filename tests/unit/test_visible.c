/* What is seen from outside against a slow twin, closed shapes and plates, any transform, bad
 * numbers; the same for any number of threads and any order of the clouds. */
#include "libcore/gbuffer/visible.h"
#include "libcore/gbuffer/gbuffer.h"
#include "libcore/data/rng.h"
#include "tests/check.h"

enum { MOST = 30000, ALL = PBS_POSITION | PBS_NORMAL | PBS_COLOUR };

typedef struct cloud {
    pbs_points p;
    float position[3 * MOST];
    int16_t normal[2 * MOST];
    uint8_t colour[4 * MOST];
} cloud;

static pbs_run run = {.threads = 2};
static pbs_err err;
static cloud in[3], out[3];

static double uniform(uint64_t *state) {
    *state += 1;
    return (double)(pbs_mix64(*state * 0x9e3779b97f4a7c15u) >> 11) * 0x1p-53;
}

static cloud *empty(cloud *c) {
    c->p =
        (pbs_points){.position = c->position, .normal = c->normal, .colour = c->colour, .count = 0};
    return c;
}

static void add(cloud *c, const double p[3], const double n[3]) {
    size_t i = c->p.count++;
    float f[3];
    for (int k = 0; k < 3; k++) c->position[3 * i + (size_t)k] = (float)p[k], f[k] = (float)n[k];
    pbs_oct_encode(c->normal + 2 * i, f);
    uint64_t colour = pbs_mix64(i + 1);
    memcpy(c->colour + 4 * i, &colour, 4);
}

/* Even points on a sphere, normals outwards. */
static void add_sphere(cloud *c, size_t n, double r) {
    for (size_t i = 0; i < n; i++) {
        double z = 1 - 2 * ((double)i + 0.5) / (double)n, a = 2.399963229728653 * (double)i;
        double d[3] = {sqrt(1 - z * z) * cos(a), sqrt(1 - z * z) * sin(a), z};
        double p[3] = {r * d[0], r * d[1], r * d[2]};
        add(c, p, d);
    }
}

static void add_plate(cloud *c, int side, double z, double facing) {
    for (int i = 0; i < side * side; i++) {
        double p[3] = {(i % side + 0.5) * 2 / side - 1, (i / side + 0.5) * 2.0 / side - 1, z};
        add(c, p, (double[3]){0, 0, facing});
    }
}

static pbs_views views_of(double half, uint32_t resolution) {
    pbs_gbuffer_params p = {.resolution = resolution,
                            .box = {{-half, -half, -half}, {half, half, half}}};
    pbs_views v;
    CHECK(!pbs_views_plan(&p, &v, &err));
    return v;
}

static pbs_cloud placed(const cloud *c, const double m[12], double radius) {
    pbs_cloud k = {.points = &c->p, .count = c->p.count, .radius = radius};
    memcpy(k.m, m, sizeof k.m);
    return k;
}

/* What is seen of clouds that are given together. */
static void see(const pbs_views *views, const pbs_cloud *clouds, size_t n, cloud *seen) {
    pbs_visible *v;
    CHECK(!pbs_visible_new(&run, &v, &err) && !pbs_visible_begin(v, views, &err));
    CHECK(!pbs_visible_splat(v, clouds, n, &err));
    for (size_t i = 0; i < n; i++)
        CHECK(!pbs_visible_take(v, &clouds[i], &empty(&seen[i])->p, &err));
    pbs_visible_free(v);
    CHECK(pbs_mem_used(&run) == 0);
}

static size_t see_one(double half, uint32_t resolution, const cloud *c, const double m[12],
                      double radius, cloud *seen) {
    pbs_views views = views_of(half, resolution);
    pbs_cloud k = placed(c, m, radius);
    see(&views, &k, 1, seen);
    return seen->p.count;
}

/* Colours are names: which of a's are in b, in order. */
static size_t common(const cloud *a, const cloud *b) {
    size_t n = 0, j = 0;
    for (size_t i = 0; i < a->p.count; i++) {
        size_t k = j;
        while (k < b->p.count && memcmp(a->colour + 4 * i, b->colour + 4 * k, 4)) k++;
        if (k < b->p.count) n++, j = k + 1;
    }
    return n;
}

/* ---- the slow twin ---- */

/* In pixels and in double; what hangs on rounding is said to. */
typedef struct disc {
    double p[3], n[3], r, steep;
} disc;

static disc project(const pbs_cloud *c, size_t i, const pbs_pair *v) {
    disc d = {.n = {0, 0, 1}};
    double p[3], n[3], cof[9], l = 0;
    float f[3] = {0, 0, 1};
    const double *axis[3] = {v->right, v->up, v->toward};
    for (int k = 0; k < 3; k++) p[k] = c->points->position[3 * i + (size_t)k];
    pbs_xform_point(p, c->m, p);
    if (c->points->normal) pbs_oct_decode(f, c->points->normal + 2 * i);
    pbs_xform_cofactor(cof, c->m);
    for (int r = 0; r < 3; r++) {
        n[r] = cof[3 * r] * f[0] + cof[3 * r + 1] * f[1] + cof[3 * r + 2] * f[2];
        if (pbs_xform_det(c->m) < 0) n[r] = -n[r];
        l += n[r] * n[r];
    }
    for (int r = 0; r < 3; r++) {
        for (int k = 0; k < 3; k++) d.p[r] += axis[r][k] * (p[k] - v->centre[k]) / v->pixel;
        if (!c->points->normal) continue;
        d.n[r] = 0;
        for (int k = 0; k < 3; k++) d.n[r] += axis[r][k] * n[k] / sqrt(l);
    }
    d.p[0] += v->width / 2.0, d.p[1] += v->height / 2.0;
    d.r = 0.7 * c->radius / v->pixel;
    d.steep = fabs(d.n[2]) > 0.25 ? d.n[2] : copysign(0.25, d.n[2]);
    return d;
}

#define EPS 1e-3
/* The disc's depth in the middle of a pixel; false: not there. sure: whatever the rounding. */
static bool at_pixel(const disc *d, double x, double y, double *z, bool *sure) {
    if (d->r <= 0.5) return false;
    double dx = x + 0.5 - d->p[0], dy = y + 0.5 - d->p[1];
    double dz = -(d->n[0] * dx + d->n[1] * dy) / d->steep, rr = dx * dx + dy * dy + dz * dz;
    *z = d->p[2] + dz;
    *sure = rr < d->r * d->r - EPS;
    return rr < d->r * d->r + EPS;
}

/* 1: seen, 0: not, -1: rounding decides */
static int seen_slowly(const pbs_views *views, const pbs_cloud *clouds, size_t n, size_t which,
                       size_t i) {
    int verdict = 0;
    for (int v = 0; v < views->pairs && verdict != 1; v++) {
        const pbs_pair *pair = &views->pair[v];
        disc me = project(&clouds[which], i, pair);
        double x = floor(me.p[0]), y = floor(me.p[1]), near[2] = {-1e300, -1e300},
               far[2] = {1e300, 1e300};
        if (!(x >= 0 && x < pair->width && y >= 0 && y < pair->height)) continue;
        bool edge = fabs(me.p[0] - rint(me.p[0])) < EPS || fabs(me.p[1] - rint(me.p[1])) < EPS;
        for (size_t c = 0; c < n; c++)
            for (size_t k = 0; k < clouds[c].count; k++) {
                double z;
                bool sure;
                disc d = project(&clouds[c], k, pair);
                double push = d.r + 1.5;
                if (floor(d.p[0]) == x && floor(d.p[1]) == y) /* its centre always counts */
                    for (int s = 0; s < 2; s++) {
                        near[s] = fmax(near[s], d.p[2] - push);
                        far[s] = fmin(far[s], d.p[2] + push);
                    }
                if (!at_pixel(&d, x, y, &z, &sure)) continue;
                near[1] = fmax(near[1], z - push), far[1] = fmin(far[1], z + push);
                if (sure) near[0] = fmax(near[0], z - push), far[0] = fmin(far[0], z + push);
            }
        double front = me.n[2] + 0.1, back = 0.1 - me.n[2], z = me.p[2];
        if (!clouds[which].points->normal) front = back = 1;
        bool is = (z > near[1] + EPS && front > EPS) || (z < far[1] - EPS && back > EPS);
        bool may = (z > near[0] - EPS && front > -EPS) || (z < far[0] + EPS && back > -EPS);
        if (is && !edge)
            verdict = 1;
        else if (may || edge)
            verdict = -1;
    }
    return verdict;
}

typedef struct limits_of {
    size_t unsure, seen, hidden; /* at most, at least, at least */
} limits_of;

static void compare(const pbs_views *views, const pbs_cloud *clouds, size_t n, limits_of l) {
    size_t unsure = 0, seen = 0, hidden = 0, wrong = 0;
    see(views, clouds, n, out);
    for (size_t c = 0; c < n; c++)
        for (size_t i = 0, at = 0; i < in[c].p.count; i++) {
            int slow = seen_slowly(views, clouds, n, c, i);
            bool is =
                at < out[c].p.count && !memcmp(out[c].colour + 4 * at, in[c].colour + 4 * i, 4);
            at += is;
            unsure += slow<0, seen += slow> 0, hidden += !slow;
            wrong += slow >= 0 && slow != is;
        }
    CHECK_NUM(!wrong, wrong);
    CHECK_NUM(unsure < l.unsure, unsure);
    CHECK_NUM(seen > l.seen, seen);
    CHECK_NUM(hidden > l.hidden, hidden);
}

static void check_slowly(bool normals, double radius) {
    static const double m[3][12] = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                                    {0, -0.5, 0.1, 0.2, 0.6, 0, 0, -0.1, 0, 0.2, 0.5, 0.1},
                                    {-0.4, 0.3, 0, 0, 0, 0.4, 0, 0.3, 0, 0, 0.5, -0.2}};
    pbs_cloud clouds[3];
    uint64_t seed = 5;
    for (int c = 0; c < 3; c++) {
        empty(&in[c]);
        for (int i = 0; i < 220; i++) {
            double p[3], q[3];
            for (int k = 0; k < 3; k++) {
                p[k] = 2 * uniform(&seed) - 1;
                q[k] = p[k] + 0.5 * (2 * uniform(&seed) - 1);
            }
            add(&in[c], p, q);
        }
        if (!normals) in[c].p.normal = NULL;
        clouds[c] = placed(&in[c], m[c], radius * (1 + c));
    }
    pbs_views views = views_of(1.2, 24);
    compare(&views, clouds, 3, (limits_of){20, 60, 60});
}

TEST(as_the_slow_twin) {
    check_slowly(true, 0.16);
    check_slowly(true, 0.4);
    check_slowly(false, 0.3);
}
/* Discs that a view sees at a steep angle, which a pair of views has to decide alone. */
TEST(as_the_slow_twin_at_an_angle) {
    pbs_gbuffer_params p = {
        .pairs = 1, .direction = {{0, 0, 1}}, .resolution = 30, .box = {{-1, -1, -1}, {1, 1, 1}}};
    pbs_views views;
    uint64_t seed = 9;
    CHECK(!pbs_views_plan(&p, &views, &err));
    empty(&in[0]);
    for (int i = 0; i < 400; i++) {
        double q[3], n[3];
        for (int k = 0; k < 3; k++) q[k] = 2 * uniform(&seed) - 1, n[k] = uniform(&seed) - 0.5;
        n[i % 2] *= 0.1, n[2] *= 0.1; /* nearly along an axis of the picture */
        add(&in[0], q, n);
    }
    pbs_cloud c = placed(&in[0], PBS_IDENTITY, 0.7);
    compare(&views, &c, 1, (limits_of){20, 30, 100});
}
TEST(as_the_slow_twin_with_points) {
    static const double small = 1e-3;
    pbs_views views = views_of(1, 8);
    empty(&in[0]);
    uint64_t seed = 8;
    for (int i = 0; i < 800; i++) {
        double p[3] = {2 * uniform(&seed) - 1, 2 * uniform(&seed) - 1, 2 * uniform(&seed) - 1};
        add(&in[0], p, (double[3]){0, 0, 1});
    }
    pbs_cloud c = placed(&in[0], PBS_IDENTITY, small);
    compare(&views, &c, 1, (limits_of){20, 60, 50});
}

/* ---- shapes ---- */

TEST(a_sphere_hides_what_is_in_it) {
    add_sphere(empty(&in[0]), 20000, 1);
    add_sphere(empty(&in[1]), 3000, 0.8);
    pbs_views views = views_of(1, 200);
    pbs_cloud c[2] = {placed(&in[0], PBS_IDENTITY, 0.025), placed(&in[1], PBS_IDENTITY, 0.06)};
    see(&views, c, 2, out);
    CHECK_NUM(out[0].p.count == 20000, out[0].p.count);
    CHECK_NUM(out[1].p.count == 0, out[1].p.count);
    see(&views, c + 1, 1, out); /* alone it is seen */
    CHECK_NUM(out[0].p.count == 3000, out[0].p.count);
    /* inside out: what faces the middle is seen by nobody but where it is edge-on */
    for (size_t i = 0; i < 20000; i++) {
        float n[3];
        pbs_oct_decode(n, in[0].normal + 2 * i);
        for (int k = 0; k < 3; k++) n[k] = -n[k];
        pbs_oct_encode(in[0].normal + 2 * i, n);
    }
    see(&views, c, 1, out);
    CHECK_NUM(out[0].p.count < 7000, out[0].p.count);
}

TEST(plates) {
    pbs_views views = views_of(1, 150);
    pbs_cloud c[2];
    for (int inwards = 0; inwards < 2; inwards++) {
        add_plate(empty(&in[0]), 100, 0.06, inwards ? -1 : 1);
        add_plate(empty(&in[1]), 100, -0.06, inwards ? 1 : -1);
        for (int i = 0; i < 2; i++) c[i] = placed(&in[i], PBS_IDENTITY, 0.0145);
        see(&views, c, 2, out);
        for (int i = 0; i < 2 && !inwards; i++) CHECK_NUM(out[i].p.count == 10000, out[i].p.count);
        size_t inside = 0; /* what the slit at the edges shows is no fault */
        for (int i = 0; i < 2 && inwards; i++)
            for (size_t k = 0; k < out[i].p.count; k++)
                inside += fabsf(out[i].position[3 * k]) < 0.7f &&
                          fabsf(out[i].position[3 * k + 1]) < 0.7f;
        CHECK_NUM(!inside, inside);
    }
}

/* A sphere with a cap cut off, so that its inside is seen: something is hidden, something not. */
static void add_bowl(cloud *c) {
    static cloud whole;
    add_sphere(empty(&whole), 8000, 0.9);
    for (size_t i = 0; i < whole.p.count; i++) {
        float n[3];
        double p[3], d[3];
        pbs_oct_decode(n, whole.normal + 2 * i);
        for (int k = 0; k < 3; k++) p[k] = whole.position[3 * i + (size_t)k], d[k] = n[k];
        if (p[1] > 0.3) continue;
        add(c, p, d);
        for (int k = 0; k < 3; k++) p[k] *= 0.95, d[k] = -d[k];
        add(c, p, d);
    }
}

/* ---- transforms ---- */

TEST(powers_of_two_are_exact) {
    add_bowl(empty(&in[0]));
    size_t n = see_one(1, 100, &in[0], PBS_IDENTITY, 0.03, &out[0]);
    CHECK_NUM(n > 7000 && n < in[0].p.count - 500, n);
    for (int e = -60; e <= 60; e += 15) {
        double m[12];
        for (int i = 0; i < 12; i++) m[i] = ldexp(PBS_IDENTITY[i], e);
        CHECK(see_one(ldexp(1, e), 100, &in[0], m, ldexp(0.03, e), &out[1]) == n);
        size_t wrong = 0;
        for (size_t i = 0; i < 3 * n; i++)
            wrong += out[1].position[i] != ldexpf(out[0].position[i], e);
        CHECK(!wrong && !memcmp(out[0].normal, out[1].normal, 4 * n) &&
              !memcmp(out[0].colour, out[1].colour, 4 * n));
    }
}

/* A placing gives what a cloud gives whose surfels were taken there one by one. */
static void check_placing(const double m[12], bool normals) {
    double inverse[9];
    pbs_xform_cofactor(inverse, m);
    double side = pbs_xform_det(m) < 0 ? -1 : 1;
    empty(&in[1]);
    for (size_t i = 0; i < in[0].p.count; i++) {
        double p[3], q[3] = {0};
        float n[3];
        pbs_oct_decode(n, in[0].normal + 2 * i);
        for (int k = 0; k < 3; k++) p[k] = in[0].position[3 * i + (size_t)k];
        pbs_xform_point(p, m, p);
        for (int r = 0; r < 3; r++)
            for (int k = 0; k < 3; k++) q[r] += side * inverse[3 * r + k] * n[k];
        double l = hypot(hypot(q[0], q[1]), q[2]);
        for (int r = 0; r < 3; r++) q[r] /= l > 0 ? l : 1;
        add(&in[1], p, q);
    }
    in[0].p.normal = normals ? in[0].normal : NULL;
    in[1].p.normal = normals ? in[1].normal : NULL;
    size_t n = see_one(1.5, 120, &in[0], m, 0.03, &out[0]);
    size_t k = see_one(1.5, 120, &in[1], PBS_IDENTITY, 0.03, &out[1]);
    in[0].p.normal = in[0].normal;
    size_t both = common(&out[0], &out[1]);
    CHECK_NUM(n > 1000 && (double)(n + k - 2 * both) < 0.003 * (double)n, n + k - 2 * both);
    if (both != n || n != k) return;
    for (size_t i = 0; i < n; i++)
        for (int c = 0; c < 3; c++) {
            float a[3], b[3];
            pbs_oct_decode(a, out[0].normal + 2 * i), pbs_oct_decode(b, out[1].normal + 2 * i);
            if (normals && fabsf(a[c] - b[c]) < 3e-4f) continue;
            if (!normals) continue;
            CHECK_NUM(!"normals differ", i);
            return;
        }
}

TEST(placed_anyhow) {
    static const double mirrored[12] = {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                        turned[12] = {0.6, -0.8, 0, 0.1, 0.8, 0.6, 0, 0, 0, 0, 1, -0.2},
                        sheared[12] = {0.8, 0.5, 0, 0, 0, 0.7, 0, 0, 0.3, 0, -0.6, 0},
                        flat[12] = {1, 0, 0, 0, 0, 0.01, 0, 0, 0, 0, 1, 0};
    add_bowl(empty(&in[0]));
    for (int normals = 0; normals < 2; normals++) {
        check_placing(mirrored, normals);
        check_placing(turned, normals);
        check_placing(sheared, normals);
        check_placing(flat, normals);
    }
}

TEST(a_mirror_keeps_outside_outside) {
    add_sphere(empty(&in[0]), 5000, 1);
    static const double m[12] = {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    CHECK(see_one(1, 80, &in[0], m, 0.05, &out[0]) == 5000);
    size_t wrong = 0;
    for (size_t i = 0; i < 5000; i++) {
        float n[3], dot = 0;
        pbs_oct_decode(n, out[0].normal + 2 * i);
        for (int k = 0; k < 3; k++) dot += n[k] * out[0].position[3 * i + (size_t)k];
        wrong += !(dot > 0.999f);
    }
    CHECK_NUM(!wrong, wrong);
}

TEST(singular) {
    static const double m[][12] = {
        {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0.25}, {0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0}, {0}};
    add_sphere(empty(&in[0]), 3000, 0.9);
    for (int i = 0; i < 3; i++) {
        size_t n = see_one(1, 64, &in[0], m[i], 0.05, &out[0]);
        CHECK_NUM(n > 1000 && n <= 3000, n);
        size_t wrong = 0;
        for (size_t k = 0; k < n && !i; k++) {
            float v[3];
            pbs_oct_decode(v, out[0].normal + 2 * k);
            wrong += out[0].position[3 * k + 2] != 0.25f || fabsf(v[2]) < 0.9999f;
        }
        CHECK_NUM(!wrong, wrong);
    }
}

/* ---- bad numbers ---- */

TEST(not_finite) {
    static const float bad[] = {NAN, INFINITY, -INFINITY, 3e38f, -3e38f};
    add_bowl(empty(&in[0]));
    see_one(1, 100, &in[0], PBS_IDENTITY, 0.03, &out[0]);
    size_t good = in[0].p.count;
    for (size_t i = 0; i < 200; i++) {
        add(&in[0], (double[3]){0, 0, 0}, (double[3]){0, 1, 0});
        in[0].position[3 * (good + i) + i % 3] = bad[i % 5];
    }
    see_one(1, 100, &in[0], PBS_IDENTITY, 0.03, &out[1]);
    CHECK(out[0].p.count == out[1].p.count &&
          !memcmp(out[0].position, out[1].position, 12 * out[0].p.count));
    static const double wild[] = {NAN, INFINITY, 1e300, -1e300, 1e-300, -1e-300, 0};
    for (int i = 0; i < 7; i++)
        for (int k = 0; k < 12; k++) {
            double m[12];
            memcpy(m, PBS_IDENTITY, sizeof m);
            m[k] = wild[i];
            see_one(1, 20, &in[0], m, 0.1, &out[0]);
            for (size_t j = 0; j < 3 * out[0].p.count; j++)
                if (!isfinite(out[0].position[j])) {
                    CHECK_NUM(!"finite", i * 100 + k);
                    break;
                }
        }
}

TEST(wild_radius) {
    static const double wild[] = {0, 1e-300, 1, 1e3, 1e300, INFINITY, NAN, -1};
    add_sphere(empty(&in[0]), 50, 0.9);
    for (int i = 0; i < 8; i++) {
        size_t n = see_one(1, 40, &in[0], PBS_IDENTITY, wild[i], &out[0]);
        CHECK_NUM(n <= 50 && (n == 50 || i), n);
    }
}

TEST(nothing) {
    empty(&in[0]);
    CHECK(see_one(1, 40, &in[0], PBS_IDENTITY, 1, &out[0]) == 0);
    pbs_views views = views_of(1, 40);
    see(&views, NULL, 0, out);
    in[0].p = (pbs_points){0};
    CHECK(see_one(1, 40, &in[0], PBS_IDENTITY, 1, &out[0]) == 0);
}

/* ---- the same however it is done ---- */

static void take_all(pbs_visible *v, const pbs_cloud *c, cloud *seen) {
    for (int i = 0; i < 3; i++) CHECK(!pbs_visible_take(v, &c[i], &empty(&seen[i])->p, &err));
}

TEST(threads_and_order) {
    static cloud other[3];
    pbs_cloud c[3];
    add_bowl(empty(&in[0]));
    add_sphere(empty(&in[1]), 25000, 0.5);
    add_plate(empty(&in[2]), 60, 0.2, 1);
    for (int i = 0; i < 3; i++) c[i] = placed(&in[i], PBS_IDENTITY, 0.03);
    pbs_views views = views_of(1, 90), small = views_of(0.3, 33);
    see(&views, c, 3, out);
    static const int threads[] = {1, 2, 5};
    for (int t = 0; t < 3; t++) {
        pbs_visible *v;
        run.threads = threads[t];
        CHECK(!pbs_visible_new(&run, &v, &err));
        /* what was in the buffers before is gone */
        CHECK(!pbs_visible_begin(v, &small, &err) && !pbs_visible_splat(v, c, 3, &err));
        CHECK(!pbs_visible_begin(v, &views, &err));
        CHECK(pbs_mem_used(&run) >= pbs_visible_need(&views));
        for (int i = 2; i >= 0; i--) {
            pbs_cloud half = c[i], rest = c[i]; /* in two pieces, and the first one twice */
            pbs_points tail = *c[i].points;
            half.count = half.count / 3;
            tail.position += 3 * half.count, tail.normal += 2 * half.count;
            rest.points = &tail, rest.count -= half.count;
            CHECK(!pbs_visible_splat(v, &rest, 1, &err));
            CHECK(!pbs_visible_splat(v, (pbs_cloud[]){half, half}, 2, &err));
        }
        take_all(v, c, other);
        pbs_visible_free(v);
        for (int i = 0; i < 3; i++) {
            size_t n = out[i].p.count;
            CHECK(n == other[i].p.count && n && n < c[i].count);
            CHECK(!memcmp(out[i].position, other[i].position, 12 * n) &&
                  !memcmp(out[i].normal, other[i].normal, 4 * n) &&
                  !memcmp(out[i].colour, other[i].colour, 4 * n));
        }
    }
    run.threads = 2;
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(limits) {
    volatile sig_atomic_t stop = 1;
    pbs_visible *v;
    pbs_views views = views_of(1, 100);
    add_sphere(empty(&in[0]), 1000, 1);
    pbs_cloud c = placed(&in[0], PBS_IDENTITY, 0.1);
    CHECK(!pbs_visible_new(&run, &v, &err));
    run.mem_limit = pbs_visible_need(&views) / 2;
    CHECK(pbs_visible_begin(v, &views, &err) == PBS_LIMIT);
    run.mem_limit = 0; /* it can be used again */
    CHECK(!pbs_visible_begin(v, &views, &err) && !pbs_visible_splat(v, &c, 1, &err));
    run.cancel = &stop;
    CHECK(pbs_visible_splat(v, &c, 1, &err) == PBS_CANCEL);
    CHECK(pbs_visible_take(v, &c, &empty(out)->p, &err) == PBS_CANCEL && !out->p.count);
    run.cancel = NULL;
    CHECK(!pbs_visible_take(v, &c, &empty(out)->p, &err) && out->p.count == 1000);
    pbs_visible_free(v);
    pbs_visible_free(NULL);
    CHECK(pbs_mem_used(&run) == 0);
}
TEST_MAIN
