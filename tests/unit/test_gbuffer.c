/* The G-buffer against a brute-force rasteriser in double, and its laws: watertight, mirrored,
 * independent of threads, order, place and scale, every candidate on its triangle. */
#include "libcore/gbuffer/raster.h"
#include "libcore/gbuffer/resolve.h"
#include "tests/unit/gbuffer_shape.h"

/* ---- the reference ---- */

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
    picture scene = {.draws = d, .draw_count = 2};
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
    picture scene = {.draws = &d, .draw_count = 1};
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

/* The same for what becomes of the pixels. */
TEST(vector_and_plain_candidates) {
    if (!pbs_raster_simd()) SKIP("no AVX2 here");
    enum { SIZE = 150 };
    shape s = ball(60, 80, 0.3);
    pbs_draw d = placed(&s);
    memcpy(d.m, (double[12]){0.3, 0.1, 0, 0, 0, -0.2, 0.1, 0, 0.2, 0, 0.4, 0}, sizeof d.m);
    pbs_pair pair = {.right = {1, 0, 0},
                     .up = {0, 1, 0},
                     .toward = {0, 0, 1},
                     .pixel = 1.0 / SIZE,
                     .depth = 2,
                     .width = SIZE,
                     .height = SIZE};
    uint64_t *key = malloc((2 * SIZE * SIZE + PBS_KEY_PAD) * sizeof *key);
    pbs_snapped *v = aligned_alloc(64, (s.mesh.vertices * sizeof *v + 63) / 64 * 64);
    pbs_raster r = {.key = key, .width = SIZE, .y1 = SIZE, .simd = true};
    double m[12];
    int32_t box[4];
    pbs_pair_project(m, &pair, d.m);
    pbs_raster_clear(&r);
    pbs_raster_snap(m, s.position, s.mesh.vertices, true, v, box);
    pbs_raster_draw(&r, v, s.index, s.mesh.triangles, 0, true);
    const uint32_t first[2] = {0, s.mesh.triangles};
    pbs_resolve set = {.draws = &d, .draw_count = 1, .first = first, .channels = PBS_NORMAL};
    pbs_resolve_out out[2][2];
    for (int simd = 0; simd < 2; simd++) {
        pbs_resolve_scratch *work = malloc(sizeof *work);
        work->column = malloc(SIZE * sizeof *work->column), work->simd = simd;
        for (int odd = 0; odd < 2; odd++) {
            pbs_points p = {.position = malloc(12 * SIZE * SIZE),
                            .normal = malloc(4 * SIZE * SIZE)};
            out[simd][odd] = (pbs_resolve_out){p, malloc(4 * SIZE * SIZE)};
        }
        pbs_resolve_begin(work, &set, &pair);
        pbs_resolve_band(work, &r, out[simd]);
        free(work->column), free(work);
    }
    for (int odd = 0; odd < 2; odd++) {
        const pbs_resolve_out *a = &out[0][odd], *b = &out[1][odd];
        size_t n = a->points.count;
        CHECK(n == b->points.count && n > 2000);
        CHECK(!memcmp(a->where, b->where, 4 * n));
        CHECK(!memcmp(a->points.position, b->points.position, 12 * n));
        CHECK(!memcmp(a->points.normal, b->points.normal, 4 * n));
        for (int simd = 0; simd < 2; simd++)
            free(out[simd][odd].where), free(out[simd][odd].points.position),
                free(out[simd][odd].points.normal);
    }
    free(key), free(v);
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
        picture scene = {.draws = d, .draw_count = 2, .materials = m, .material_count = 2};
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
    picture scene = {.draws = &d, .draw_count = 1};
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
    picture scene[2] = {{.draws = d, .draw_count = N}, {.draws = &one, .draw_count = 1}};
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
