/* The G-buffer of a million triangles, eight views of 1024 x 1024, against software GL doing the
 * same job. CPU time of the whole process (user and system), minimum of several runs. */
#include "cmd/pbs-view/gl.h"
#include "libcore/gbuffer.h"
#include "libcore/raster.h"
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>

enum { RUNS = 7, RESOLUTION = 1024 };

static double cpu_ms(void) {
    struct rusage u;
    getrusage(RUSAGE_SELF, &u);
    return 1e3 * (double)(u.ru_utime.tv_sec + u.ru_stime.tv_sec) +
           1e-3 * (double)(u.ru_utime.tv_usec + u.ru_stime.tv_usec);
}

typedef struct scene {
    const char *name;
    pbs_mesh *mesh;
    size_t meshes;
    pbs_draw *draw;
    size_t draws;
    uint64_t triangles;
    pbs_box box;
} scene;

static void *need(void *p) {
    if (!p) abort();
    return p;
}

static void finish(scene *s) {
    s->box = PBS_BOX_EMPTY;
    for (size_t d = 0; d < s->draws; d++) {
        const pbs_mesh *m = s->draw[d].mesh;
        s->triangles += m->triangles;
        for (uint32_t i = 0; i < m->vertices; i++) {
            double p[3] = {m->position[3 * i], m->position[3 * i + 1], m->position[3 * i + 2]};
            pbs_xform_point(p, s->draw[d].m, p);
            pbs_box_add(&s->box, p);
        }
    }
}

static void free_scene(scene *s) {
    for (size_t i = 0; i < s->meshes; i++) {
        free((void *)s->mesh[i].position), free((void *)s->mesh[i].normal);
        free((void *)s->mesh[i].colour), free((void *)s->mesh[i].index);
    }
    free(s->mesh), free(s->draw);
}

/* A lumpy ball, a cube blown up: six faces of 2 x 2 meshes, quads in Morton order. */
typedef struct patch {
    pbs_mesh mesh;
    float *position;
    int16_t *normal;
    uint8_t *colour;
    uint16_t *index;
} patch;

static void blow_up(int face, double u, double v, float out[3]) {
    double c[3], l, r;
    c[face % 3] = face < 3 ? 1 : -1;
    c[(face + 1) % 3] = tan(u * M_PI / 4), c[(face + 2) % 3] = tan(v * M_PI / 4);
    l = sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
    for (int k = 0; k < 3; k++) c[k] /= l;
    r = 1 + 0.08 * sin(9 * c[0]) * sin(11 * c[1] + 1) * sin(10 * c[2] + 2) +
        0.004 * sin(90 * c[0]) * sin(80 * c[1]) * sin(85 * c[2]);
    for (int k = 0; k < 3; k++) out[k] = (float)(c[k] * r);
}

static uint16_t vertex_at(patch *p, uint32_t *number, int face, uint32_t n, uint32_t x, uint32_t y,
                          uint32_t ox, uint32_t oy, uint32_t all) {
    uint32_t *at = &number[y * (n + 1) + x];
    if (*at) return (uint16_t)(*at - 1);
    uint32_t v = p->mesh.vertices++;
    float q[3][3], g[3];
    for (int k = 0; k < 3; k++)
        blow_up(face, 2.0 * (ox + x + 0.1 * (k == 1)) / all - 1,
                2.0 * (oy + y + 0.1 * (k == 2)) / all - 1, q[k]);
    memcpy(p->position + 3 * v, q[0], 12);
    for (int k = 0; k < 3; k++) q[1][k] -= q[0][k], q[2][k] -= q[0][k];
    for (int k = 0; k < 3; k++)
        g[k] = q[1][(k + 1) % 3] * q[2][(k + 2) % 3] - q[1][(k + 2) % 3] * q[2][(k + 1) % 3];
    pbs_oct_encode(p->normal + 2 * v, g);
    for (int k = 0; k < 4; k++) p->colour[4 * v + k] = k < 3 ? (uint8_t)(128 + 100 * q[0][k]) : 255;
    *at = v + 1;
    return (uint16_t)v;
}

static uint32_t every_second_bit(uint32_t i) {
    uint32_t r = 0;
    for (int b = 0; b < 16; b++) r |= (i >> (2 * b) & 1) << b;
    return r;
}

static pbs_mesh make_patch(int face, uint32_t n, uint32_t ox, uint32_t oy, uint32_t all) {
    size_t most = (size_t)(n + 1) * (n + 1), side = 1;
    uint32_t *number = need(calloc(most, 4));
    patch p = {.position = need(malloc(12 * most)),
               .normal = need(malloc(4 * most)),
               .colour = need(malloc(4 * most)),
               .index = need(malloc((size_t)12 * n * n))};
    while (side < n) side *= 2;
    for (uint32_t i = 0; i < side * side; i++) {
        uint32_t x = every_second_bit(i), y = every_second_bit(i >> 1);
        if (x >= n || y >= n) continue;
        uint16_t c[4];
        for (uint32_t k = 0; k < 4; k++)
            c[k] = vertex_at(&p, number, face, n, x + (k & 1), y + (k >> 1), ox, oy, all);
        uint16_t t[6] = {c[0], c[1], c[2], c[1], c[3], c[2]};
        memcpy(p.index + 3 * p.mesh.triangles, t, 12);
        p.mesh.triangles += 2;
    }
    free(number);
    p.mesh.position = p.position, p.mesh.normal = p.normal, p.mesh.colour = p.colour;
    p.mesh.index = p.index, p.mesh.material = PBS_NONE;
    return p.mesh;
}

static scene ball(void) {
    enum { N = 144 };
    scene s = {.name = "ball: 24 meshes", .meshes = 24, .draws = 24};
    s.mesh = need(calloc(24, sizeof *s.mesh)), s.draw = need(calloc(24, sizeof *s.draw));
    for (int i = 0; i < 24; i++) {
        s.mesh[i] = make_patch(i / 4, N, i & 1 ? N : 0, i & 2 ? N : 0, 2 * N);
        s.draw[i].mesh = &s.mesh[i];
        memcpy(s.draw[i].m, PBS_IDENTITY, sizeof s.draw[i].m);
    }
    finish(&s);
    return s;
}

/* A plant: one small part, a capped tube of 48 triangles, placed 20 800 times. */
static scene plant(void) {
    enum { SIDES = 12, DRAWS = 20800 };
    scene s = {.name = "plant: 20800 draws of 48 triangles", .meshes = 1, .draws = DRAWS};
    s.mesh = need(calloc(1, sizeof *s.mesh)), s.draw = need(calloc(DRAWS, sizeof *s.draw));
    float *p = need(malloc(12 * (2 * SIDES + 2)));
    uint8_t *colour = need(malloc(4 * (2 * SIDES + 2)));
    int16_t *normal = need(malloc(4 * (2 * SIDES + 2)));
    uint16_t *t = need(malloc(6 * 4 * SIDES));
    memset(colour, 200, 4 * (2 * SIDES + 2));
    for (uint16_t i = 0; i < 2 * SIDES + 2; i++) {
        double a = 2 * M_PI * (i / 2) / SIDES;
        bool mid = i >= 2 * SIDES;
        float q[3] = {(float)(mid ? 0 : cos(a)), (float)(mid ? 0 : sin(a)), i & 1 ? 1.0f : -1.0f};
        memcpy(p + 3 * i, q, 12);
        pbs_oct_encode(normal + 2 * i, q);
    }
    for (uint16_t i = 0; i < SIDES; i++) {
        uint16_t a = 2 * i, b = 2 * ((i + 1) % SIDES);
        uint16_t q[12] = {a, b,         a + 1, b,     b + 1, a + 1,
                          a, 2 * SIDES, b,     a + 1, b + 1, 2 * SIDES + 1};
        memcpy(t + 12 * i, q, 24);
    }
    s.mesh[0] = (pbs_mesh){.vertices = 2 * SIDES + 2,
                           .triangles = 4 * SIDES,
                           .position = p,
                           .normal = normal,
                           .colour = colour,
                           .index = t,
                           .material = PBS_NONE};
    uint64_t seed = 7;
    for (int d = 0; d < DRAWS; d++) {
        double r[7];
        for (int k = 0; k < 7; k++) {
            seed = seed * 6364136223846793005u + 1442695040888963407u;
            r[k] = (double)(seed >> 11) * 0x1p-53;
        }
        double thick = 0.002 + 0.02 * r[0] * r[0], length = 0.01 + 0.2 * r[1] * r[1] * r[1];
        double *m = s.draw[d].m, c = cos(7 * r[2]), w = sin(7 * r[2]);
        int k = (int)(3 * r[3]), k1 = (k + 1) % 3, k2 = (k + 2) % 3;
        m[4 * k + 2] = length, m[4 * k1] = c * thick, m[4 * k1 + 1] = -w * thick;
        m[4 * k2] = w * thick, m[4 * k2 + 1] = c * thick;
        for (int i = 0; i < 3; i++) m[4 * i + 3] = r[4 + i];
        s.draw[d].mesh = s.mesh;
    }
    finish(&s);
    return s;
}

static pbs_code ignore(void *ctx, const pbs_gbuffer_view *view, pbs_err *err) {
    (void)ctx, (void)view, (void)err;
    return PBS_OK;
}

/* Transform and drawing only, by the parts that pbs_gbuffer is made of. */
static double raster_only(const scene *s, double pixel, double *snap_ms) {
    double start = cpu_ms();
    uint32_t vertices = 0;
    for (size_t d = 0; d < s->draws; d++)
        vertices = s->draw[d].mesh->vertices > vertices ? s->draw[d].mesh->vertices : vertices;
    pbs_snapped *v = need(aligned_alloc(64, (sizeof *v * vertices + 63) / 64 * 64));
    uint64_t *key = need(malloc((2 * RESOLUTION * RESOLUTION + PBS_KEY_PAD) * sizeof *key));
    for (int only_snap = 1; only_snap >= 0; only_snap--) {
        start = cpu_ms();
        for (int i = 0; i < 4; i++) {
            pbs_pair pair = {.pixel = pixel, .depth = 4, .width = RESOLUTION, .height = RESOLUTION};
            const double *n = PBS_GBUFFER_CORNERS[i];
            double l = sqrt(3), q = sqrt(n[0] * n[0] + n[2] * n[2]);
            for (int k = 0; k < 3; k++) pair.toward[k] = n[k] / l;
            pair.right[0] = n[2] / q, pair.right[2] = -n[0] / q;
            for (int k = 0; k < 3; k++)
                pair.up[k] = pair.toward[(k + 1) % 3] * pair.right[(k + 2) % 3] -
                             pair.toward[(k + 2) % 3] * pair.right[(k + 1) % 3];
            for (int k = 0; k < 3; k++) pair.centre[k] = (s->box.min[k] + s->box.max[k]) / 2;
            pbs_raster r = {
                .key = key, .width = RESOLUTION, .y1 = RESOLUTION, .simd = pbs_raster_simd()};
            if (!only_snap) pbs_raster_clear(&r);
            uint32_t first = 0;
            for (size_t d = 0; d < s->draws; d++) {
                const pbs_mesh *mesh = s->draw[d].mesh;
                double m[12];
                int32_t box[4];
                pbs_pair_project(m, &pair, s->draw[d].m);
                bool ok = pbs_raster_snap(m, mesh->position, mesh->vertices, r.simd, v, box);
                if (!only_snap) pbs_raster_draw(&r, v, mesh->index, mesh->triangles, first, ok);
                first += mesh->triangles;
            }
        }
        if (only_snap) *snap_ms = cpu_ms() - start;
    }
    double ms = cpu_ms() - start;
    free(v), free(key);
    return ms - *snap_ms;
}

static double ours(const scene *s, uint32_t channels, int threads, pbs_gbuffer_stats *stats) {
    double best = 1e30;
    for (int i = 0; i < RUNS; i++) {
        pbs_run run = {.threads = threads};
        pbs_err err;
        pbs_gbuffer_scene in = {.draws = s->draw, .draw_count = s->draws};
        pbs_gbuffer_params params = {.resolution = RESOLUTION, .channels = channels, .box = s->box};
        double start = cpu_ms();
        if (pbs_gbuffer(&run, &in, &params, ignore, NULL, stats, &err)) {
            printf("bench_gbuffer: %s\n", err.text);
            exit(70);
        }
        double ms = cpu_ms() - start;
        best = ms < best ? ms : best;
    }
    return best;
}

static void bench(const scene *s) {
    pbs_gbuffer_stats st;
    double full = ours(s, PBS_NORMAL | PBS_COLOUR, 1, &st),
           two = ours(s, PBS_NORMAL | PBS_COLOUR, 2, &st);
    double bare = ours(s, 0, 1, &st), snap = 1e30, raster = 1e30;
    for (int i = 0; i < RUNS; i++) {
        double a = 0, b = raster_only(s, st.pixel, &a);
        snap = a < snap ? a : snap, raster = b < raster ? b : raster;
    }
    printf("%s, %.2f M triangles, 8 views of %d: %.0f ms CPU (%.0f with 2 threads)\n", s->name,
           1e-6 * (double)s->triangles, RESOLUTION, full, two);
    printf("  transform %.0f ms, drawing %.0f ms, resolve %.0f ms with normals and colours, %.0f "
           "without\n",
           snap, raster, full - snap - raster, bare - snap - raster);
    printf("  %.2f M candidates, %.2f M fragments; %.1f M triangles a second and core, a view\n",
           1e-6 * (double)st.candidates, 1e-6 * (double)st.fragments,
           8e-3 * (double)s->triangles / full);
}

/* An argument picks one scene: 0, 1. */
int main(int argc, char **argv) {
    scene s[2] = {ball(), plant()};
    int only = argc > 1 ? atoi(argv[1]) : -1;
    for (int i = 0; i < 2; i++) {
        if (only >= 0 && only != i) continue;
        bench(&s[i]);
        free_scene(&s[i]);
    }
    return 0;
}
