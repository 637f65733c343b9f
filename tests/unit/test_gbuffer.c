/* The G-buffer against a brute-force rasteriser in double, and its laws: watertight, mirrored,
 * independent of threads, order, place and scale, every candidate on its triangle. */
#include "tests/check.h"
#include "libcore/gbuffer.h"
#include "libcore/raster.h"

/* ---- random numbers and meshes ---- */

static uint64_t seed = 1;
static double rnd(void) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(seed >> 11) * 0x1p-53;
}

typedef struct shape {
    pbs_mesh mesh;
    float *position, *uv;
    int16_t *normal;
    uint8_t *colour;
    uint16_t *index;
    uint32_t *material;
} shape;

static shape new_shape(uint32_t vertices, uint32_t triangles) {
    shape s = {.position = calloc(vertices ? vertices : 1, 12),
               .index = calloc(triangles ? triangles : 1, 6)};
    s.mesh = (pbs_mesh){.vertices = vertices,
                        .triangles = triangles,
                        .position = s.position,
                        .index = s.index,
                        .material = PBS_NONE};
    return s;
}

static void free_shape(shape *s) {
    free(s->position), free(s->uv), free(s->normal), free(s->colour), free(s->index);
    free(s->material);
}

static void corner_is(shape *s, uint32_t v, double x, double y, double z) {
    s->position[3 * v] = (float)x, s->position[3 * v + 1] = (float)y,
                    s->position[3 * v + 2] = (float)z;
}

/* Colours tell which triangle a candidate comes from; three vertices of their own each. */
static void number_triangles(shape *s) {
    s->mesh.colour = s->colour = calloc(s->mesh.vertices, 4);
    for (uint32_t i = 0; i < s->mesh.vertices; i++) {
        uint32_t id = i / 3;
        s->colour[4 * i] = (uint8_t)id, s->colour[4 * i + 1] = (uint8_t)(id >> 8);
        s->colour[4 * i + 2] = (uint8_t)(id >> 16), s->colour[4 * i + 3] = 255;
    }
}

/* Triangles of sizes from a hundredth of a pixel to the whole picture. */
static shape soup(uint32_t n) {
    shape s = new_shape(3 * n, n);
    for (uint32_t i = 0; i < n; i++) {
        double size = pow(10, -3.5 * rnd()), c[3];
        for (int k = 0; k < 3; k++) c[k] = size + (1 - 2 * size) * rnd();
        if (size > 0.5) c[0] = c[1] = c[2] = 0.5, size = 0.5;
        for (uint32_t j = 0; j < 3; j++) {
            corner_is(&s, 3 * i + j, c[0] + size * (2 * rnd() - 1), c[1] + size * (2 * rnd() - 1),
                      c[2] + size * (2 * rnd() - 1));
            s.index[3 * i + j] = (uint16_t)(3 * i + j);
        }
    }
    number_triangles(&s);
    return s;
}

/* A closed surface, every vertex once. bump 0: a sphere of radius 1. */
static shape ball(uint32_t rings, uint32_t sectors, double bump) {
    shape s = new_shape((rings - 1) * sectors + 2, 2 * sectors * (rings - 1));
    s.mesh.normal = s.normal = calloc(s.mesh.vertices, 4);
    uint32_t south = s.mesh.vertices - 1, v = 1, t = 0;
    for (uint32_t r = 0; r <= rings; r++)
        for (uint32_t c = 0; c < sectors; c++) {
            if ((r == 0 || r == rings) && c) break;
            double a = M_PI * r / rings, b = 2 * M_PI * c / sectors;
            double l = 1 + bump * sin(5 * a) * cos(7 * b);
            uint32_t at = r == 0 ? 0 : r == rings ? south : v++;
            float n[3] = {(float)(sin(a) * cos(b)), (float)cos(a), (float)(sin(a) * sin(b))};
            corner_is(&s, at, l * n[0], l * n[1], l * n[2]);
            pbs_oct_encode(s.normal + 2 * at, n);
        }
    for (uint32_t r = 0; r < rings; r++)
        for (uint32_t c = 0; c < sectors; c++) {
            uint32_t d = (c + 1) % sectors, up = 1 + (r - 1) * sectors, low = 1 + r * sectors;
            uint32_t a0 = r ? up + c : 0, a1 = r ? up + d : 0;
            uint32_t b0 = r + 1 < rings ? low + c : south, b1 = r + 1 < rings ? low + d : south;
            uint16_t q[6] = {(uint16_t)a0, (uint16_t)a1, (uint16_t)b0,
                             (uint16_t)a1, (uint16_t)b1, (uint16_t)b0};
            if (r) memcpy(s.index + 3 * t++, q, 6);
            if (r + 1 < rings) memcpy(s.index + 3 * t++, q + 3, 6);
        }
    return s;
}

/* ---- a run, kept ---- */

typedef struct kept {
    pbs_gbuffer_view v;
    uint32_t *where;
    pbs_points p;
} kept;
typedef struct result {
    int count;
    kept view[2 * PBS_GBUFFER_MAX_PAIRS];
    pbs_gbuffer_stats stats;
    pbs_code rc;
    size_t peak, left;
    int stop_at; /* the sink fails at this view; 0: never */
} result;

static void *copy(const void *from, size_t bytes) {
    void *p = malloc(bytes + 1);
    if (from) memcpy(p, from, bytes);
    return p;
}

static pbs_code keep_view(void *ctx, const pbs_gbuffer_view *v, pbs_err *err) {
    result *r = ctx;
    size_t n = v->points.count;
    CHECK(v->view == r->count);
    if (r->stop_at && v->view == r->stop_at) return pbs_fail(err, PBS_IO, "no more");
    kept *k = &r->view[r->count++];
    k->v = *v;
    k->where = copy(v->where, 4 * n);
    k->p.count = n;
    k->p.position = copy(v->points.position, 12 * n);
    if (v->points.normal) k->p.normal = copy(v->points.normal, 4 * n);
    if (v->points.colour) k->p.colour = copy(v->points.colour, 4 * n);
    if (v->points.material) k->p.material = copy(v->points.material, 4 * n);
    if (v->points.emissive) k->p.emissive = copy(v->points.emissive, 4 * n);
    return PBS_OK;
}

static void drop(result *r) {
    for (int i = 0; i < r->count; i++) {
        kept *k = &r->view[i];
        free(k->where), free(k->p.position), free(k->p.normal), free(k->p.colour);
        free(k->p.material), free(k->p.emissive);
    }
}

static result draw_scene(const pbs_gbuffer_scene *scene, const pbs_gbuffer_params *params,
                         int threads) {
    result r = {0};
    pbs_run run = {.threads = threads};
    pbs_err err = {0};
    r.rc = pbs_gbuffer(&run, scene, params, keep_view, &r, &r.stats, &err);
    r.peak = pbs_mem_peak(&run), r.left = pbs_mem_used(&run);
    CHECK(r.left == 0);
    CHECK_NUM(r.rc || r.peak <= pbs_gbuffer_need(scene, params, threads), r.peak);
    return r;
}

static pbs_box box_of(const pbs_draw *draws, size_t count) {
    pbs_box b = PBS_BOX_EMPTY;
    for (size_t d = 0; d < count; d++)
        for (uint32_t i = 0; i < draws[d].mesh->vertices; i++) {
            const float *f = draws[d].mesh->position + 3 * i;
            double p[3] = {f[0], f[1], f[2]};
            pbs_xform_point(p, draws[d].m, p);
            pbs_box_add(&b, p);
        }
    return b;
}

static pbs_draw placed(const shape *s) {
    pbs_draw d = {.mesh = &s->mesh};
    memcpy(d.m, PBS_IDENTITY, sizeof d.m);
    return d;
}

static result draw_shape(const shape *s, uint32_t resolution, uint32_t channels, int threads) {
    pbs_draw d = placed(s);
    pbs_gbuffer_scene scene = {.draws = &d, .draw_count = 1};
    pbs_gbuffer_params params = {
        .resolution = resolution, .channels = channels, .box = box_of(&d, 1)};
    return draw_scene(&scene, &params, threads);
}

static bool same(const result *a, const result *b) {
    if (a->count != b->count || a->rc != b->rc) return false;
    for (int i = 0; i < a->count; i++) {
        const kept *x = &a->view[i], *y = &b->view[i];
        size_t n = x->p.count;
        if (n != y->p.count || x->v.width != y->v.width) return false;
        if (memcmp(x->where, y->where, 4 * n) || memcmp(x->p.position, y->p.position, 12 * n))
            return false;
        if (x->p.normal && memcmp(x->p.normal, y->p.normal, 4 * n)) return false;
        if (x->p.colour && memcmp(x->p.colour, y->p.colour, 4 * n)) return false;
    }
    return true;
}

/* ---- the reference ---- */

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* A triangle as a view sees it: exact coordinates, and snapped ones. */
typedef struct seen {
    double x[3], y[3], z[3];
    int64_t sx[3], sy[3];
} seen;

static seen see(const kept *k, const pbs_box *box, const shape *s, uint32_t t) {
    seen out;
    for (int i = 0; i < 3; i++) {
        const float *f = s->position + 3 * s->index[3 * t + (uint32_t)i];
        double p[3];
        for (int c = 0; c < 3; c++) p[c] = f[c] - (box->min[c] + box->max[c]) / 2;
        out.x[i] = dot(k->v.right, p) / k->v.pixel + k->v.width / 2.0;
        out.y[i] = dot(k->v.up, p) / k->v.pixel + k->v.height / 2.0;
        out.z[i] = dot(k->v.toward, p);
        out.sx[i] = llrint(256 * out.x[i]), out.sy[i] = llrint(256 * out.y[i]);
    }
    return out;
}

/* The top-left rule, mirrored for odd views. */
static bool covers(const seen *s, uint32_t px, uint32_t py, bool odd) {
    int64_t cx = 256 * (int64_t)px + 128, cy = 256 * (int64_t)py + 128;
    int64_t area = (s->sx[1] - s->sx[0]) * (s->sy[2] - s->sy[0]) -
                   (s->sx[2] - s->sx[0]) * (s->sy[1] - s->sy[0]);
    if (!area) return false;
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3;
        int64_t ex = s->sx[j] - s->sx[i], ey = s->sy[j] - s->sy[i];
        int64_t e = ex * (cy - s->sy[i]) - ey * (cx - s->sx[i]);
        if (area < 0) e = -e, ex = -ex, ey = -ey;
        bool left = odd ? ey > 0 : ey < 0;
        if (e < 0 || (e == 0 && !(left || (ey == 0 && ex > 0)))) return false;
    }
    return true;
}

/* Depth of the plane at a pixel centre, kept in the triangle's range; larger is nearer. */
static double depth_at(const seen *s, uint32_t px, uint32_t py) {
    double ax = s->x[1] - s->x[0], ay = s->y[1] - s->y[0], bx = s->x[2] - s->x[0];
    double by = s->y[2] - s->y[0], dx = px + 0.5 - s->x[0], dy = py + 0.5 - s->y[0];
    double det = ax * by - bx * ay;
    double z = s->z[0] + ((dx * by - bx * dy) * (s->z[1] - s->z[0]) +
                          (ax * dy - dx * ay) * (s->z[2] - s->z[0])) /
                             det;
    z = fmin(z, fmax(s->z[0], fmax(s->z[1], s->z[2])));
    return fmax(z, fmin(s->z[0], fmin(s->z[1], s->z[2])));
}

static double point_triangle(const double p[3], const shape *s, uint32_t t) {
    double v[3][3], best = INFINITY;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) v[i][k] = s->position[3 * s->index[3 * t + (uint32_t)i] + k];
    double a[3], b[3], d[3];
    for (int k = 0; k < 3; k++)
        a[k] = v[1][k] - v[0][k], b[k] = v[2][k] - v[0][k], d[k] = p[k] - v[0][k];
    double aa = dot(a, a), ab = dot(a, b), bb = dot(b, b), ad = dot(a, d), bd = dot(b, d);
    double den = aa * bb - ab * ab, u = (ad * bb - bd * ab) / den, w = (bd * aa - ad * ab) / den;
    if (u >= 0 && w >= 0 && u + w <= 1) {
        double far = 0;
        for (int k = 0; k < 3; k++) far += pow(d[k] - u * a[k] - w * b[k], 2);
        best = sqrt(far);
    }
    for (int i = 0; i < 3; i++) {
        double e[3], q[3], far = 0;
        for (int k = 0; k < 3; k++) e[k] = v[(i + 1) % 3][k] - v[i][k], q[k] = p[k] - v[i][k];
        double l = dot(e, e), f = l > 0 ? fmin(1, fmax(0, dot(e, q) / l)) : 0;
        for (int k = 0; k < 3; k++) far += pow(q[k] - f * e[k], 2);
        best = fmin(best, sqrt(far));
    }
    return best;
}

static uint32_t id_of(const kept *k, size_t i) {
    const uint8_t *c = k->p.colour + 4 * i;
    return c[0] | (uint32_t)c[1] << 8 | (uint32_t)c[2] << 16;
}

/* Every pixel of every view: covered or not, and by the nearest triangle up to rounding. */
static void compare(const shape *s, uint32_t resolution) {
    result r = draw_shape(s, resolution, PBS_COLOUR, 1);
    pbs_draw d = placed(s);
    pbs_box box = box_of(&d, 1);
    int wrong_cover = 0, wrong_id = 0, off_triangle = 0, off_centre = 0;
    seen *t = malloc(s->mesh.triangles * sizeof *t);
    CHECK(r.rc == PBS_OK && r.count == 8);
    for (int v = 0; v < r.count; v++) {
        const kept *k = &r.view[v];
        for (uint32_t i = 0; i < s->mesh.triangles; i++) t[i] = see(k, &box, s, i);
        size_t next = 0;
        for (uint32_t at = 0; at < k->v.width * k->v.height; at++) {
            uint32_t x = at % k->v.width, y = at / k->v.width;
            double best = -INFINITY;
            for (uint32_t i = 0; i < s->mesh.triangles; i++)
                if (covers(&t[i], x, y, v & 1)) best = fmax(best, depth_at(&t[i], x, y));
            bool have = next < k->p.count && k->where[next] == at;
            wrong_cover += have != (best > -INFINITY);
            if (!have) continue;
            uint32_t id = id_of(k, next);
            const float *f = k->p.position + 3 * next++;
            if (id >= s->mesh.triangles || !covers(&t[id], x, y, v & 1)) {
                wrong_id++;
                continue;
            }
            /* Thin triangles: unsnapped and snapped depth differ by what the slope makes of
             * 1/256 pixel, so only the range counts. */
            double z = depth_at(&t[id], x, y), p[3] = {f[0], f[1], f[2]}, q[3];
            double range = fmax(t[id].z[0], fmax(t[id].z[1], t[id].z[2])) -
                           fmin(t[id].z[0], fmin(t[id].z[1], t[id].z[2]));
            wrong_id += z < best - 1e-6 - 0.02 * range;
            off_triangle += point_triangle(p, s, id) > 1e-6;
            for (int c = 0; c < 3; c++) q[c] = p[c] - (box.min[c] + box.max[c]) / 2;
            double ex = dot(k->v.right, q) / k->v.pixel + k->v.width / 2.0 - x - 0.5;
            double ey = dot(k->v.up, q) / k->v.pixel + k->v.height / 2.0 - y - 0.5;
            off_centre += fabs(ex) > 0.01 || fabs(ey) > 0.01;
        }
        CHECK(next == k->p.count);
    }
    CHECK_NUM(wrong_cover == 0, wrong_cover);
    CHECK_NUM(wrong_id <= 2, wrong_id);
    CHECK_NUM(off_triangle == 0, off_triangle);
    CHECK_NUM(off_centre == 0, off_centre);
    free(t);
    drop(&r);
}

TEST(brute_force) {
    for (int i = 0; i < 4; i++) {
        shape s = soup(i < 2 ? 40 : 400);
        compare(&s, i & 1 ? 33 : 90);
        free_shape(&s);
    }
}

/* Slivers a millionth as wide as long, some edge-on to a view. */
TEST(needles) {
    shape s = new_shape(600, 200);
    for (uint32_t i = 0; i < 200; i++) {
        double a[3], b[3], w = pow(10, -1 - 7 * rnd());
        for (int k = 0; k < 3; k++) a[k] = rnd(), b[k] = rnd();
        if (i % 4 == 0)
            for (int k = 0; k < 3; k++) b[k] = a[k] + (0.5 - a[0]) * 0.7; /* along (1, 1, 1) */
        corner_is(&s, 3 * i, a[0], a[1], a[2]);
        corner_is(&s, 3 * i + 1, b[0], b[1], b[2]);
        corner_is(&s, 3 * i + 2, b[0] + w * rnd(), b[1] + w * rnd(), b[2] - w * rnd());
        for (uint32_t j = 0; j < 3; j++) s.index[3 * i + j] = (uint16_t)(3 * i + j);
    }
    number_triangles(&s);
    compare(&s, 100);
    free_shape(&s);
}

/* ---- laws ---- */

/* Closed and convex: every pixel of the outline is drawn by one front and one back triangle, and
 * each row is one run. The mesh is cut in two along a ring; the halves share its vertices. */
TEST(watertight) {
    shape s = ball(97, 130, 0);
    pbs_mesh half[2] = {s.mesh, s.mesh};
    half[0].triangles = s.mesh.triangles / 3;
    half[1].triangles -= half[0].triangles;
    half[1].index += 3 * half[0].triangles;
    pbs_draw d[2] = {placed(&s), placed(&s)};
    d[0].mesh = &half[0], d[1].mesh = &half[1];
    pbs_gbuffer_scene scene = {.draws = d, .draw_count = 2};
    pbs_gbuffer_params params = {.resolution = 300, .box = box_of(d, 2)};
    for (int turn = 0; turn < 8; turn++) {
        result r = draw_scene(&scene, &params, 1);
        CHECK(r.rc == PBS_OK);
        CHECK_NUM(r.stats.fragments == r.stats.candidates, r.stats.fragments);
        CHECK(r.stats.triangles == s.mesh.triangles && r.stats.candidates > 8 * 20000);
        int holes = 0;
        for (int v = 0; v < r.count; v++)
            for (size_t i = 1; i < r.view[v].p.count; i++) {
                uint32_t a = r.view[v].where[i - 1], b = r.view[v].where[i], w = r.view[v].v.width;
                holes += b <= a || (b != a + 1 && a / w == b / w);
            }
        CHECK_NUM(holes == 0, holes);
        drop(&r);
        double a = 0.3 + turn;
        for (int i = 0; i < 2; i++)
            memcpy(d[i].m, (double[12]){cos(a), sin(a), 0, 3, -sin(a), cos(a), 0, 4, 0, 0, 1, 5},
                   sizeof d[i].m);
        params.box = box_of(d, 2);
    }
    free_shape(&s);
}

/* A square net with its inner vertices shaken, some on pixel centres: no pixel twice, none left. */
TEST(net_of_shared_edges) {
    enum { N = 60 };
    shape s = new_shape((N + 1) * (N + 1), 2 * N * N);
    for (uint32_t y = 0, v = 0; y <= N; y++)
        for (uint32_t x = 0; x <= N; x++, v++) {
            bool rim = !x || !y || x == N || y == N;
            double dx = rim || (x + y) % 3 == 0 ? 0 : rnd() - 0.5;
            corner_is(&s, v, x + 0.4 * dx, y + 0.4 * dx, 0);
        }
    for (uint32_t y = 0, t = 0; y < N; y++)
        for (uint32_t x = 0; x < N; x++) {
            uint32_t a = y * (N + 1) + x, b = a + N + 1;
            uint16_t q[6] = {(uint16_t)a,       (uint16_t)(a + 1), (uint16_t)b,
                             (uint16_t)(a + 1), (uint16_t)(b + 1), (uint16_t)b};
            memcpy(s.index + t, q, sizeof q), t += 6;
        }
    pbs_draw d = placed(&s);
    pbs_gbuffer_scene scene = {.draws = &d, .draw_count = 1};
    for (uint32_t res = 61; res < 400; res += 60) {
        pbs_gbuffer_params params = {
            .pairs = 1, .direction = {{0, 0, 1}}, .resolution = res, .box = box_of(&d, 1)};
        result r = draw_scene(&scene, &params, 1);
        CHECK_NUM(2 * r.stats.fragments == r.stats.candidates, r.stats.fragments);
        CHECK(r.view[0].v.width == res && r.view[0].v.height == res);
        /* The square is res - 1 pixels wide and half a pixel from the border. */
        CHECK_NUM(r.view[0].p.count == (res - 1) * (res - 1), r.view[0].p.count);
        drop(&r);
    }
    free_shape(&s);
}

TEST(opposite_views_mirror) {
    shape s = soup(300);
    result r = draw_shape(&s, 128, PBS_NORMAL, 1);
    CHECK(r.count == 8);
    for (int v = 0; v < 8; v += 2) {
        const kept *a = &r.view[v], *b = &r.view[v + 1];
        CHECK(a->p.count == b->p.count && a->v.width == b->v.width);
        size_t row = 0, bad = 0;
        for (size_t i = 0; i < a->p.count; i++) {
            uint32_t w = a->v.width, y = a->where[i] / w;
            if (i && y != a->where[i - 1] / w) row = i;
            size_t end = i;
            while (end + 1 < a->p.count && a->where[end + 1] / w == y) end++;
            size_t m = row + end - i; /* the mirrored point in the odd view's row */
            bad += b->where[m] / w != y || b->where[m] % w != w - 1 - a->where[i] % w;
            double p[3], q[3];
            for (int k = 0; k < 3; k++)
                p[k] = a->p.position[3 * i + (size_t)k], q[k] = b->p.position[3 * m + (size_t)k];
            bad += dot(a->v.toward, p) < dot(a->v.toward, q) - 1e-6;
        }
        CHECK_NUM(bad == 0, bad);
        for (int k = 0; k < 3; k++) {
            CHECK(a->v.toward[k] == -b->v.toward[k] && a->v.right[k] == -b->v.right[k]);
            CHECK(a->v.up[k] == b->v.up[k]);
        }
    }
    drop(&r);
    free_shape(&s);
}

TEST(any_number_of_threads) {
    shape s = soup(2000);
    result one = draw_shape(&s, 200, PBS_NORMAL | PBS_COLOUR, 1);
    for (int threads = 2; threads < 20; threads += threads < 5 ? 1 : 7) {
        result more = draw_shape(&s, 200, PBS_NORMAL | PBS_COLOUR, threads);
        CHECK_NUM(same(&one, &more), threads);
        CHECK(one.stats.fragments == more.stats.fragments);
        drop(&more);
    }
    drop(&one);
    free_shape(&s);
}

/* Both code paths leave the same keys, bit by bit, also outside of the picture. */
TEST(vector_and_plain_code) {
    if (!pbs_raster_simd()) SKIP("no AVX2 here");
    shape s = soup(5000);
    pbs_snapped *v[2];
    uint64_t *key[2], fragments[2];
    size_t keys = 2 * 200 * 170 + PBS_KEY_PAD;
    double m[12] = {50000, 9000, 0, -900, -8000, 60000, 100, -3000, 0.01, 0.3, 0.7, -0.003};
    for (int i = 0; i < 2; i++) {
        v[i] = aligned_alloc(64, (s.mesh.vertices * sizeof **v + 63) / 64 * 64);
        key[i] = malloc(keys * sizeof **key);
        pbs_raster r = {.key = key[i], .width = 200, .y0 = 20, .y1 = 190, .simd = i};
        int32_t box[4];
        CHECK(pbs_raster_snap(m, s.position, s.mesh.vertices, i, v[i], box));
        pbs_raster_clear(&r);
        pbs_raster_draw(&r, v[i], s.index, s.mesh.triangles, 7, true);
        fragments[i] = r.fragments;
    }
    CHECK(!memcmp(v[0], v[1], s.mesh.vertices * sizeof **v));
    CHECK(!memcmp(key[0], key[1], (keys - PBS_KEY_PAD) * sizeof **key));
    CHECK(fragments[0] == fragments[1] && fragments[0] > 100000);
    for (int i = 0; i < 2; i++) free(v[i]), free(key[i]);
    free_shape(&s);
}

TEST(order_of_triangles) {
    shape s = soup(1500);
    result a = draw_shape(&s, 150, PBS_NORMAL | PBS_COLOUR, 1);
    for (uint32_t i = s.mesh.triangles - 1; i > 0; i--) {
        uint32_t j = (uint32_t)(rnd() * (i + 1));
        uint16_t t[3];
        memcpy(t, s.index + 3 * i, 6);
        memcpy(s.index + 3 * i, s.index + 3 * j, 6);
        memcpy(s.index + 3 * j, t, 6);
    }
    result b = draw_shape(&s, 150, PBS_NORMAL | PBS_COLOUR, 1);
    size_t differ = 0, n = 0;
    for (int v = 0; v < 8; v++) {
        CHECK(a.view[v].p.count == b.view[v].p.count);
        CHECK(!memcmp(a.view[v].where, b.view[v].where, 4 * a.view[v].p.count));
        for (size_t i = 0; i < a.view[v].p.count; i++, n++)
            differ += memcmp(a.view[v].p.position + 3 * i, b.view[v].p.position + 3 * i, 12) != 0;
    }
    CHECK_NUM(differ <= n / 1000, differ);
    drop(&a), drop(&b);
    free_shape(&s);
}

/* Two equal triangles: the first one is seen, from both sides. */
TEST(ties_go_to_the_lower) {
    shape s = soup(1);
    pbs_material m[2] = {{.base = {1, 0, 0, 1}}, {.base = {0, 1, 0, 1}}};
    for (int i = 0; i < 2; i++)
        m[i].base_texture.texture = m[i].material_texture.texture = m[i].emissive_texture.texture =
            PBS_NONE;
    pbs_mesh b = s.mesh;
    b.colour = NULL, s.mesh.colour = NULL;
    for (int first = 0; first < 2; first++) {
        s.mesh.material = (uint32_t)first, b.material = 1 - (uint32_t)first;
        pbs_draw d[2] = {placed(&s), placed(&s)};
        d[1].mesh = &b;
        pbs_gbuffer_scene scene = {
            .draws = d, .draw_count = 2, .materials = m, .material_count = 2};
        pbs_gbuffer_params params = {.resolution = 50, .channels = PBS_COLOUR, .box = box_of(d, 2)};
        result r = draw_scene(&scene, &params, 2);
        size_t wrong = 0;
        for (int v = 0; v < 8; v++)
            for (size_t i = 0; i < r.view[v].p.count; i++)
                wrong += r.view[v].p.colour[4 * i] != (first ? 0 : 255);
        CHECK(r.stats.candidates > 100);
        CHECK_NUM(wrong == 0, wrong);
        drop(&r);
    }
    free_shape(&s);
}

/* The matrix moves a scene by what double can hold exactly, and scales it by powers of two. */
TEST(place_and_scale) {
    shape s = soup(500);
    for (uint32_t i = 0; i < 3 * s.mesh.vertices; i++) /* to the grid that the shift keeps */
        s.position[i] = roundf(s.position[i] * 65536) / 65536;
    pbs_draw d = placed(&s);
    pbs_gbuffer_scene scene = {.draws = &d, .draw_count = 1};
    pbs_gbuffer_params params = {.resolution = 100, .channels = PBS_NORMAL, .box = box_of(&d, 1)};
    result a = draw_scene(&scene, &params, 1);
    for (int e = -30; e <= 30; e += 20) {
        double f = ldexp(1, e);
        memcpy(d.m, (double[12]){f, 0, 0, 0, 0, f, 0, 0, 0, 0, f, 0}, sizeof d.m);
        params.box = box_of(&d, 1);
        result b = draw_scene(&scene, &params, 1);
        for (int v = 0; v < 8; v++)
            for (size_t i = 0; i < 3 * b.view[v].p.count; i++) b.view[v].p.position[i] /= (float)f;
        CHECK_NUM(same(&a, &b), e);
        CHECK(b.stats.pixel == a.stats.pixel * f);
        drop(&b);
    }
    memcpy(d.m, (double[12]){1, 0, 0, 1e7, 0, 1, 0, -3e7, 0, 0, 1, 5e6}, sizeof d.m);
    params.box = box_of(&d, 1);
    result c = draw_scene(&scene, &params, 1);
    for (int v = 0; v < 8; v++) {
        CHECK(a.view[v].p.count == c.view[v].p.count);
        CHECK(!memcmp(a.view[v].where, c.view[v].where, 4 * a.view[v].p.count));
        CHECK(!memcmp(a.view[v].p.normal, c.view[v].p.normal, 4 * a.view[v].p.count));
    }
    drop(&a), drop(&c);
    free_shape(&s);
}

/* ---- normals ---- */

/* On a sphere under any matrix, the normal is the gradient of its equation, on the seen side. */
TEST(normals_under_a_matrix) {
    shape s = ball(200, 300, 0);
    double m[3][12] = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                       {-2, 0.3, 0, 5, 0, 1, 0.4, 6, 0.1, 0, 0.5, 7},
                       {1e-9, 0, 0, 0, 0, -3e-9, 1e-9, 0, 0, 0, 2e-9, 0}};
    for (int i = 0; i < 6; i++) {
        pbs_draw d = placed(&s);
        memcpy(d.m, m[i % 3], sizeof d.m);
        s.mesh.normal = i < 3 ? s.normal : NULL;
        pbs_gbuffer_scene scene = {.draws = &d, .draw_count = 1};
        pbs_gbuffer_params params = {
            .resolution = 200, .channels = PBS_NORMAL, .box = box_of(&d, 1)};
        result r = draw_scene(&scene, &params, 1);
        double cof[9], inv[9], det = pbs_xform_det(d.m), least = 1;
        pbs_xform_cofactor(cof, d.m);
        for (int k = 0; k < 9; k++) inv[k] = cof[k % 3 * 3 + k / 3] / det;
        for (int v = 0; v < 8; v++)
            for (size_t k = 0; k < r.view[v].p.count; k++) {
                const float *p = r.view[v].p.position + 3 * k;
                double q[3] = {p[0] - d.m[3], p[1] - d.m[7], p[2] - d.m[11]}, u[3], g[3];
                float n[3];
                pbs_oct_decode(n, r.view[v].p.normal + 2 * k);
                for (int c = 0; c < 3; c++)
                    u[c] = inv[3 * c] * q[0] + inv[3 * c + 1] * q[1] + inv[3 * c + 2] * q[2];
                for (int c = 0; c < 3; c++)
                    g[c] = (cof[3 * c] * u[0] + cof[3 * c + 1] * u[1] + cof[3 * c + 2] * u[2]) *
                           (det < 0 ? -1 : 1);
                double l = sqrt(dot(g, g)), cosine = (g[0] * n[0] + g[1] * n[1] + g[2] * n[2]) / l;
                least = fmin(least, cosine);
            }
        CHECK_NUM(least > (i < 3 ? 0.9999 : 0.996), least);
        drop(&r);
    }
    s.mesh.normal = s.normal;
    free_shape(&s);
}

/* A sheet seen from both sides, with a smooth normal that leans: turned to each viewer. */
TEST(normals_of_a_sheet) {
    shape s = new_shape(3, 1);
    corner_is(&s, 1, 1, 0, 0), corner_is(&s, 2, 0, 1, 0);
    s.index[1] = 1, s.index[2] = 2;
    s.mesh.normal = s.normal = calloc(3, 4);
    for (int how = 0; how < 3; how++) {
        float n[3] = {0.6f, 0, how ? -0.8f : 0.8f};
        for (int i = 0; i < 3; i++) pbs_oct_encode(s.normal + 2 * i, n);
        if (how == 2) { /* two opposite normals cancel out: the face's own is used */
            float o[3] = {-0.6f, 0, 0.8f};
            pbs_oct_encode(s.normal + 2, o), pbs_oct_encode(s.normal + 4, o);
        }
        pbs_draw d = placed(&s);
        pbs_gbuffer_scene scene = {.draws = &d, .draw_count = 1};
        pbs_gbuffer_params params = {.pairs = 1,
                                     .direction = {{0, 0, 2}},
                                     .resolution = 40,
                                     .channels = PBS_NORMAL,
                                     .box = box_of(&d, 1)};
        result r = draw_scene(&scene, &params, 1);
        CHECK(r.count == 2 && r.view[0].p.count > 500);
        for (int v = 0; v < 2; v++)
            for (size_t i = 0; i < r.view[v].p.count; i++) {
                pbs_oct_decode(n, r.view[v].p.normal + 2 * i);
                CHECK((v ? -n[2] : n[2]) > 0.001f);
            }
        drop(&r);
    }
    free_shape(&s);
}

/* ---- textures, masks, materials ---- */

/* The unit square in z = 0, seen along z; uv is its position, v downwards. */
static shape square(void) {
    shape s = new_shape(4, 2);
    s.mesh.uv = s.uv = calloc(8, sizeof(float));
    for (uint32_t i = 0; i < 4; i++) {
        corner_is(&s, i, i & 1, i >> 1, 0);
        s.uv[2 * i] = (float)(i & 1), s.uv[2 * i + 1] = 1 - (float)(i >> 1);
    }
    memcpy(s.index, (uint16_t[6]){0, 1, 2, 1, 3, 2}, 12);
    s.mesh.material = 0;
    return s;
}

static result draw_square(const shape *s, const pbs_material *m, const pbs_image *image,
                          uint32_t res, uint32_t channels) {
    pbs_draw d = placed(s);
    pbs_gbuffer_scene scene = {.draws = &d,
                               .draw_count = 1,
                               .materials = m,
                               .material_count = 1,
                               .textures = image,
                               .texture_count = 1};
    pbs_gbuffer_params params = {.pairs = 1,
                                 .direction = {{0, 0, 1}},
                                 .resolution = res,
                                 .channels = channels,
                                 .box = box_of(&d, 1)};
    result r = draw_scene(&scene, &params, 1);
    CHECK(r.rc == PBS_OK && r.count == 2);
    return r;
}

TEST(texture_where_it_belongs) {
    shape s = square();
    uint8_t px[4 * 16 * 16];
    for (int i = 0; i < 256; i++) {
        uint8_t c[4] = {(uint8_t)(16 * (i % 16)), (uint8_t)(16 * (i / 16)), 77, 200};
        memcpy(px + 4 * i, c, 4);
    }
    pbs_image image = {16, 16, px};
    pbs_material m = PBS_MATERIAL_DEFAULT;
    m.base_texture.texture = 0;
    result r = draw_square(&s, &m, &image, 257, PBS_COLOUR); /* 16 pixels a texel */
    int wrong = 0;
    for (int v = 0; v < 2; v++)
        for (size_t i = 0; i < r.view[v].p.count; i++) {
            const float *p = r.view[v].p.position + 3 * i;
            double u = p[0] * 16, w = (1 - p[1]) * 16;
            if (fabs(u - floor(u) - 0.5) > 0.01 || fabs(w - floor(w) - 0.5) > 0.01) continue;
            const uint8_t *c = r.view[v].p.colour + 4 * i;
            wrong += abs(c[0] - 16 * (int)u) > 2 || abs(c[1] - 16 * (int)w) > 2 || c[2] != 77;
            wrong += c[3] != 255; /* opaque */
        }
    CHECK_NUM(wrong == 0, wrong);
    CHECK(r.view[0].p.count == 256 * 256);
    drop(&r);
    /* One pixel a texture: its mean in linear light. */
    double mean = 0;
    for (int i = 0; i < 16; i++) mean += pbs_srgb_to_linear((float)(16 * i) / 255) / 16;
    int want = pbs_unorm8(pbs_linear_to_srgb((float)mean));
    m.alpha = PBS_ALPHA_BLEND;
    r = draw_square(&s, &m, &image, 2, PBS_COLOUR);
    CHECK(r.view[0].p.count == 1);
    for (int k = 0; k < 2; k++)
        CHECK_NUM(abs(r.view[0].p.colour[k] - want) <= 2, r.view[0].p.colour[k]);
    CHECK(r.view[0].p.colour[3] == 200);
    drop(&r);
    free_shape(&s);
}

TEST(material_planes) {
    shape s = square();
    uint8_t px[4] = {10, 51, 102, 255};
    pbs_image image = {1, 1, px};
    pbs_material m = PBS_MATERIAL_DEFAULT;
    m.metallic = 0.5f, m.roughness = 0.5f;
    m.emissive[0] = 0, m.emissive[1] = 1, m.emissive[2] = 0.5f;
    result r = draw_square(&s, &m, &image, 20, PBS_MATERIAL | PBS_EMISSIVE);
    CHECK(!r.view[0].p.normal && !r.view[0].p.colour);
    CHECK(!memcmp(r.view[0].p.material, (uint8_t[4]){128, 128, 0, 0}, 4));
    CHECK(!memcmp(r.view[0].p.emissive, (uint8_t[4]){0, 255, 188, 0}, 4));
    drop(&r);
    m.material_texture.texture = 0, m.emissive_texture.texture = 0;
    r = draw_square(&s, &m, &image, 20, PBS_MATERIAL | PBS_EMISSIVE);
    CHECK(!memcmp(r.view[0].p.material, (uint8_t[4]){51, 26, 0, 0}, 4));
    CHECK(!memcmp(r.view[0].p.emissive, (uint8_t[4]){0, 51, 73, 0}, 4));
    drop(&r);
    free_shape(&s);
}

/* Holes in a masked square show what is behind it, and have no candidate where nothing is. */
TEST(masked_material) {
    shape s = square();
    uint8_t px[4 * 64 * 64];
    for (int i = 0; i < 64 * 64; i++) {
        uint8_t hole = i % 64 >= 16 && i % 64 < 48 && i / 64 >= 16 && i / 64 < 48;
        uint8_t c[4] = {255, 0, 0, hole ? 0 : 255};
        memcpy(px + 4 * i, c, 4);
    }
    pbs_image image = {64, 64, px};
    pbs_material m[2] = {PBS_MATERIAL_DEFAULT, PBS_MATERIAL_DEFAULT};
    m[0].base_texture.texture = 0;
    m[0].alpha = PBS_ALPHA_MASK;
    for (int behind = 0; behind < 2; behind++) {
        shape b = square();
        for (uint32_t i = 0; i < 4; i++) b.position[3 * i + 2] = -0.5f;
        b.mesh.material = 1;
        pbs_draw d[2] = {placed(&s), placed(&b)};
        pbs_gbuffer_scene scene = {.draws = d,
                                   .draw_count = 1 + (size_t)behind,
                                   .materials = m,
                                   .material_count = 2,
                                   .textures = &image,
                                   .texture_count = 1};
        pbs_gbuffer_params params = {.pairs = 1,
                                     .direction = {{0, 0, 1}},
                                     .resolution = 101,
                                     .channels = PBS_COLOUR,
                                     .box = box_of(d, 2)};
        result r = draw_scene(&scene, &params, 2);
        const kept *k = &r.view[0];
        CHECK_NUM(k->p.count == (behind ? 100 * 100 : 100 * 100 - 49 * 49), k->p.count);
        int wrong = 0;
        for (size_t i = 0; i < k->p.count; i++) {
            const float *p = k->p.position + 3 * i;
            bool hole = fabsf(p[0] - 0.5f) < 0.25f && fabsf(p[1] - 0.5f) < 0.25f;
            wrong += (p[2] != 0) != hole || (k->p.colour[4 * i + 1] != 0) != hole;
            wrong += k->p.colour[4 * i + 3] != 255;
        }
        CHECK_NUM(wrong == 0, wrong);
        drop(&r);
        free_shape(&b);
    }
    /* Constant alpha below the cutoff: nothing there at all. */
    m[0].base_texture.texture = PBS_NONE, m[0].base[3] = 0.4f;
    result r = draw_square(&s, m, &image, 30, PBS_COLOUR);
    CHECK(r.stats.candidates == 0);
    drop(&r);
    free_shape(&s);
}

/* ---- bad and odd input ---- */

TEST(empty_and_flat) {
    shape s = new_shape(3, 1);
    s.index[1] = 1, s.index[2] = 2;
    for (int dim = 0; dim < 4; dim++) { /* a point, a line, a triangle in a plane, in space */
        for (int i = 0; i < dim && i < 3; i++) s.position[3 * ((i + 1) % 3) + i] = 1;
        if (dim == 3) s.position[2] = 0.5f;
        result r = draw_shape(&s, 64, PBS_NORMAL, 1);
        CHECK(r.rc == PBS_OK && r.count == 8);
        CHECK((r.stats.candidates > 0) == (dim > 1));
        for (int v = 0; v < r.count; v++) CHECK(r.view[v].v.width >= 1 && r.view[v].v.height >= 1);
        drop(&r);
    }
    pbs_gbuffer_scene none = {0};
    pbs_gbuffer_params params = {.resolution = 16, .box = {{0, 0, 0}, {1, 1, 1}}};
    result r = draw_scene(&none, &params, 2);
    CHECK(r.rc == PBS_OK && r.count == 8 && r.stats.candidates == 0);
    drop(&r);
    free_shape(&s);
}

TEST(box_too_small_and_hostile_matrices) {
    shape s = soup(200);
    pbs_draw d = placed(&s);
    pbs_gbuffer_scene scene = {.draws = &d, .draw_count = 1};
    double odd[] = {1, 0, -1, 1e-30, 1e9, 1e40, 1e200, 1e308, INFINITY, NAN};
    for (size_t i = 0; i < sizeof odd / sizeof *odd; i++)
        for (int where = 0; where < 12; where++) {
            pbs_gbuffer_params params = {.resolution = 37,
                                         .channels = PBS_NORMAL,
                                         .box = {{0.2, 0.3, 0.4}, {0.7, 0.6, 0.5}}};
            memcpy(d.m, PBS_IDENTITY, sizeof d.m);
            d.m[where] = odd[i];
            result r = draw_scene(&scene, &params, 2);
            CHECK(r.rc == PBS_OK && r.count == 8);
            drop(&r);
        }
    free_shape(&s);
}

TEST(all_resolutions) {
    shape s = ball(10, 12, 0.1);
    pbs_draw d = placed(&s);
    pbs_gbuffer_scene scene = {.draws = &d, .draw_count = 1};
    for (uint32_t res = 1; res < 70; res += res < 5 ? 1 : 13) {
        pbs_gbuffer_params params = {.pairs = 3,
                                     .direction = {{1, 0, 0}, {0, -2, 0}, {1, 2, 3}},
                                     .resolution = res,
                                     .box = box_of(&d, 1)};
        result r = draw_scene(&scene, &params, 2);
        uint32_t longest = 0;
        for (int v = 0; v < r.count; v++) {
            longest = r.view[v].v.width > longest ? r.view[v].v.width : longest;
            longest = r.view[v].v.height > longest ? r.view[v].v.height : longest;
        }
        CHECK(r.count == 6 && longest == res && (r.stats.candidates > 0 || res == 2));
        drop(&r);
    }
    free_shape(&s);
}

TEST(refusals) {
    shape s = soup(10);
    pbs_draw d = placed(&s);
    pbs_gbuffer_scene scene = {.draws = &d, .draw_count = 1};
    pbs_gbuffer_params good = {.resolution = 64, .box = box_of(&d, 1)}, p;
    result r = {0};
    volatile sig_atomic_t stop = 1;
    pbs_run run = {.threads = 2};
    pbs_err err;
    p = good, p.resolution = 0;
    CHECK(pbs_gbuffer(&run, &scene, &p, keep_view, &r, NULL, &err) == PBS_USAGE);
    p = good, p.resolution = PBS_GBUFFER_MAX_SIZE + 1;
    CHECK(pbs_gbuffer(&run, &scene, &p, keep_view, &r, NULL, &err) == PBS_USAGE);
    p = good, p.pairs = 17;
    CHECK(pbs_gbuffer(&run, &scene, &p, keep_view, &r, NULL, &err) == PBS_USAGE);
    p = good, p.pairs = 1;
    CHECK(pbs_gbuffer(&run, &scene, &p, keep_view, &r, NULL, &err) == PBS_USAGE);
    p = good, p.box = PBS_BOX_EMPTY;
    CHECK(pbs_gbuffer(&run, &scene, &p, keep_view, &r, NULL, &err) == PBS_USAGE);
    p = good, p.box.max[1] = NAN;
    CHECK(pbs_gbuffer(&run, &scene, &p, keep_view, &r, NULL, &err) == PBS_USAGE);
    CHECK(r.count == 0);
    run.mem_limit = 120000;
    CHECK(pbs_gbuffer(&run, &scene, &good, keep_view, &r, NULL, &err) == PBS_LIMIT);
    run.mem_limit = 0, run.cancel = &stop;
    CHECK(pbs_gbuffer(&run, &scene, &good, keep_view, &r, NULL, &err) == PBS_CANCEL);
    CHECK(r.count == 0);
    run.cancel = NULL, r.stop_at = 3;
    CHECK(pbs_gbuffer(&run, &scene, &good, keep_view, &r, NULL, &err) == PBS_IO);
    CHECK(r.count == 3 && pbs_mem_used(&run) == 0);
    drop(&r);
    free_shape(&s);
}

/* Many small draws under their own matrices give what one mesh with their points gives. */
TEST(many_draws) {
    enum { N = 3000 };
    shape s = ball(3, 4, 0), all = new_shape(N * 10, N * 16);
    pbs_draw *d = calloc(N, sizeof *d);
    CHECK(s.mesh.vertices == 10 && s.mesh.triangles == 16);
    for (uint32_t i = 0; i < N; i++) {
        d[i].mesh = &s.mesh;
        memcpy(d[i].m, PBS_IDENTITY, sizeof d[i].m);
        d[i].m[0] = d[i].m[5] = d[i].m[10] = 1.0 / 64;
        for (int k = 0; k < 3; k++) d[i].m[4 * k + 3] = floor(rnd() * 1024) / 1024;
    }
    for (uint32_t i = 0; i < s.mesh.vertices * 3; i++) /* exact under all matrices */
        s.position[i] = roundf(s.position[i] * 64) / 64;
    for (uint32_t i = 0; i < N; i++)
        for (uint32_t v = 0; v < 10; v++)
            for (uint32_t k = 0; k < 3; k++)
                all.position[3 * (10 * i + v) + k] =
                    (float)(s.position[3 * v + k] / 64 + d[i].m[4 * k + 3]);
    for (uint32_t i = 0; i < N * 16 * 3; i++)
        all.index[i] = (uint16_t)(s.index[i % 48] + i / 48 * 10);
    s.mesh.normal = NULL;
    pbs_draw one = placed(&all);
    pbs_gbuffer_scene scene[2] = {{.draws = d, .draw_count = N}, {.draws = &one, .draw_count = 1}};
    pbs_gbuffer_params params = {.resolution = 200, .channels = PBS_NORMAL, .box = box_of(d, N)};
    result a = draw_scene(&scene[0], &params, 2), b = draw_scene(&scene[1], &params, 1);
    size_t differ = 0;
    for (int v = 0; v < 8; v++) {
        CHECK(a.view[v].p.count == b.view[v].p.count);
        for (size_t i = 0; i < a.view[v].p.count; i++)
            for (size_t k = 0; k < 3; k++)
                differ += fabsf(a.view[v].p.position[3 * i + k] - b.view[v].p.position[3 * i + k]) >
                          1e-5f;
    }
    CHECK(a.stats.triangles == N * 16 && a.stats.fragments == b.stats.fragments);
    CHECK_NUM(differ <= 30, differ);
    drop(&a), drop(&b);
    free(d);
    free_shape(&s), free_shape(&all);
}

TEST_MAIN
