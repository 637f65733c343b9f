/* Parts repaired: what comes out is closed, outward, and holds what went in, corner by corner. */
#include "formats/scene/mend.h"
#include "formats/scene/meshbuild.h"
#include "tests/unit/scenes.h"
#include "tests/check.h"
#include <math.h>

/* ---- soups ---- */

typedef struct soup {
    double p[4096][3][3];
    uint32_t material[4096];
    int count;
} soup;
static soup in;

static void add(const double a[3], const double b[3], const double c[3], uint32_t material) {
    memcpy(in.p[in.count][0], a, 24);
    memcpy(in.p[in.count][1], b, 24);
    memcpy(in.p[in.count][2], c, 24);
    in.material[in.count++] = material;
}

/* The sides of a box, outward; material: which side. skip: a side that is left out. */
static void add_box(double x, double y, double z, double size, int skip) {
    for (int side = 0; side < 6; side++) {
        int k = side / 2, up = side % 2;
        double c[4][3];
        if (side == skip) continue;
        for (int i = 0; i < 4; i++) {
            int u = (i == 1 || i == 2), v = i > 1;
            c[i][k] = up;
            c[i][(k + 1) % 3] = up ? u : v;
            c[i][(k + 2) % 3] = up ? v : u;
            for (int j = 0; j < 3; j++) c[i][j] = c[i][j] * size + (j == 0 ? x : j == 1 ? y : z);
        }
        add(c[0], c[1], c[2], (uint32_t)side);
        add(c[0], c[2], c[3], (uint32_t)side);
    }
}

static void turn(int i) {
    double t[3];
    memcpy(t, in.p[i][1], sizeof t);
    memcpy(in.p[i][1], in.p[i][2], sizeof t);
    memcpy(in.p[i][2], t, sizeof t);
}

static void turn_some(uint64_t seed) {
    for (int i = 0; i < in.count; i++)
        if (random_bits(&seed) % 2) turn(i);
}

/* What a corner carries follows from where it is, so that it can be checked anywhere. */
static void dress(pbs_corner *c, const double p[3]) {
    for (int k = 0; k < 3; k++) c->position[k] = p[k];
    c->uv[0] = (float)(p[0] + 2 * p[1]), c->uv[1] = (float)p[2];
    for (int k = 0; k < 3; k++) c->colour[k] = (uint8_t)(int)(50 + 10 * p[k]);
    c->colour[3] = 255;
}

static bool is_dressed(const pbs_vertex *v, const double origin[3]) {
    double p[3];
    pbs_corner c;
    for (int k = 0; k < 3; k++) p[k] = v->position[k] + origin[k];
    dress(&c, p);
    return c.uv[0] == v->uv[0] && c.uv[1] == v->uv[1] && !memcmp(c.colour, v->colour, 4);
}

static const double nowhere[3];

/* The soup as a scene of one part, under an assembly. corners: which of its attributes. */
static pbs_scene scene_of(const double origin[3], uint32_t corners) {
    maker m = new_scene();
    uint32_t id, material;
    for (int i = 0; i < 6; i++) {
        pbs_material mat = PBS_MATERIAL_DEFAULT;
        mat.metallic = (float)i / 8;
        must(m.s->material(m.s->ctx, &mat, &material, &err), &err);
    }
    must(m.s->part_begin(m.s->ctx, "soup", origin, corners, &err), &err);
    for (int i = 0; i < in.count; i++) {
        pbs_corner c[3];
        memset(c, 0, sizeof c);
        double a[3], b[3];
        for (int k = 0; k < 3; k++)
            a[k] = in.p[i][1][k] - in.p[i][0][k], b[k] = in.p[i][2][k] - in.p[i][0][k];
        for (int j = 0; j < 3; j++) {
            dress(&c[j], in.p[i][j]);
            for (int k = 0; k < 3; k++)
                c[j].normal[k] =
                    (float)(a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3]);
        }
        must(m.s->triangle(m.s->ctx, c, in.material[i] % 6, &err), &err);
    }
    must(m.s->part_end(m.s->ctx, &id, &err), &err);
    pbs_child two[2] = {child_at(id, 5, 1, false), child_at(id, -5, 2, true)};
    two[0].name = "left";
    return reopen(&m, add_assembly(&m, two, 2));
}

/* ---- what came out ---- */

static pbs_mend_totals got;
static pbs_mend_options fill_none;

static pbs_scene repaired(const pbs_scene *s, const pbs_mend_options *options) {
    static const pbs_scene_options as_it_is = {0};
    pbs_writer *w = spool_writer(&run, PBS_SCENE, NULL, 0);
    pbs_scene_writer *sw;
    pbs_scene out;
    char path[40];
    must(pbs_scene_writer_new(&run, w, &as_it_is, &sw, &err), &err);
    must(pbs_scene_mend(s, options, sw, &got, &err), &err);
    must(pbs_scene_writer_end(sw, &err), &err);
    pbs_scene_writer_free(sw);
    blob b = take_bytes(w);
    int fd = memfd_create("repaired", MFD_CLOEXEC);
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    if (write(fd, b.bytes, b.size) != (ssize_t)b.size) abort();
    must(pbs_scene_open(&run, path, NULL, &out, &err), &err);
    close(fd);
    free(b.bytes);
    return out;
}

/* Repairs the soup, whose scene is forgotten. */
static pbs_scene repair_soup(const double origin[3], const pbs_mend_options *options) {
    pbs_scene s = scene_of(origin, 0), out = repaired(&s, options);
    pbs_scene_close(&s);
    return out;
}

/* Calls each with all triangles of the part. */
static void for_triangles(const pbs_scene *s, uint32_t corners,
                          void (*each)(void *ctx, const pbs_vertex v[3], uint32_t material),
                          void *ctx) {
    for (size_t i = 0; i < s->mesh_count; i++)
        for (uint32_t t = 0; t < s->meshes[i].triangles; t++) {
            pbs_vertex v[3];
            uint32_t material;
            pbs_mesh_stored(&s->meshes[i], t, corners, v, &material);
            each(ctx, v, material);
        }
}

static void add_volume(void *ctx, const pbs_vertex v[3], uint32_t material) {
    const float *a = v[0].position, *b = v[1].position, *c = v[2].position;
    (void)material;
    *(double *)ctx += ((double)a[0] * ((double)b[1] * c[2] - (double)b[2] * c[1]) -
                       (double)a[1] * ((double)b[0] * c[2] - (double)b[2] * c[0]) +
                       (double)a[2] * ((double)b[0] * c[1] - (double)b[1] * c[0])) /
                      6;
}
static double volume(const pbs_scene *s) {
    double sum = 0;
    for_triangles(s, 0, add_volume, &sum);
    return sum;
}

static bool same_meshes(const pbs_scene *a, const pbs_scene *b) {
    bool same = a->mesh_count == b->mesh_count && a->node_count == b->node_count;
    for (size_t i = 0; same && i < a->mesh_count; i++) {
        const pbs_mesh *x = &a->meshes[i], *y = &b->meshes[i];
        same = x->vertices == y->vertices && x->triangles == y->triangles &&
               !memcmp(x->position, y->position, 12 * (size_t)x->vertices) &&
               !memcmp(x->index, y->index, 6 * (size_t)x->triangles) && !x->normal == !y->normal &&
               (!x->normal || !memcmp(x->normal, y->normal, 4 * (size_t)x->vertices)) &&
               (!x->uv || !memcmp(x->uv, y->uv, 8 * (size_t)x->vertices));
    }
    return same;
}

static bool no_module(void) {
    const void *table;
    in.count = 0;
    fill_none = (pbs_mend_options){0};
    return pbs_module_open(&run, "mend", 0, &table, &err) != PBS_OK;
}
#define NEED_MEND                                                                                  \
    if (no_module()) SKIP("the module mend is not built")

/* ---- tests ---- */

TEST(random_windings) {
    NEED_MEND;
    for (uint64_t seed = 0; seed < 40; seed++) {
        const double far[3] = {1e7, -1e7, 3e6};
        in.count = 0;
        add_box(seed % 2 * far[0], seed % 2 * far[1], seed % 2 * far[2], 1, -1);
        turn_some(seed);
        pbs_scene s = repair_soup(seed % 2 ? far : nowhere, &fill_none);
        CHECK_NUM(fabs(volume(&s) - 1) < 1e-6, volume(&s));
        CHECK(got.counts[PBS_MEND_CLOSED_AFTER] == 1 && s.nodes[0].triangles == 12);
        CHECK(s.node_count == 2 && s.nodes[1].child_count == 2 && s.nodes[1].triangles == 24);
        CHECK(!strcmp(s.nodes[0].name, "soup") && !strcmp(s.nodes[1].children[0].name, "left"));
        CHECK(s.nodes[1].children[1].flags == PBS_CHILD_MOVES);
        pbs_scene_close(&s);
    }
}

/* A box in a box is a cavity, and one in that is solid again. */
TEST(cavities) {
    NEED_MEND;
    for (uint64_t seed = 1; seed < 10; seed++) {
        in.count = 0;
        add_box(0, 0, 0, 9, -1);
        add_box(1, 1, 1, 6, -1);
        add_box(2, 2, 2, 3, -1);
        add_box(20, 0, 0, 2, -1);
        turn_some(seed);
        pbs_scene s = repair_soup(nowhere, &fill_none);
        CHECK_NUM(fabs(volume(&s) - (729 - 216 + 27 + 8)) < 1e-6, volume(&s));
        pbs_scene_close(&s);
    }
}

/* Solids that share a wall, an edge or a corner stay solids. */
TEST(touching) {
    NEED_MEND;
    const double at[3][3] = {{2, 0, 0}, {2, 2, 0}, {2, 2, 2}};
    for (uint64_t seed = 0; seed < 30; seed++) {
        in.count = 0;
        add_box(0, 0, 0, 2, -1);
        add_box(at[seed % 3][0], at[seed % 3][1], at[seed % 3][2], 2, -1);
        if (seed > 2) turn_some(seed);
        pbs_scene s = repair_soup(nowhere, &fill_none);
        CHECK_NUM(fabs(volume(&s) - 16) < 1e-6, volume(&s));
        CHECK(s.nodes[0].triangles == 24 && got.counts[PBS_MEND_CLOSED_AFTER] == 1);
        pbs_scene_close(&s);
    }
}

TEST(duplicates) {
    NEED_MEND;
    for (uint64_t seed = 0; seed < 10; seed++) {
        in.count = 0;
        add_box(0, 0, 0, 1, -1);
        add_box(0, 0, 0, 1, -1);
        if (seed) turn_some(seed);
        pbs_scene s = repair_soup(nowhere, &fill_none);
        CHECK_NUM(fabs(volume(&s) - 1) < 1e-6, volume(&s));
        CHECK(s.nodes[0].triangles == 12 && got.counts[PBS_MEND_DUPLICATE_TRIANGLES] == 12);
        pbs_scene_close(&s);
        /* A sheet, open around. */
        in.count = 2;
        add(in.p[0][0], in.p[0][1], in.p[0][2], 0);
        s = repair_soup(nowhere, &fill_none);
        CHECK(s.nodes[0].triangles == 2 && got.counts[PBS_MEND_DUPLICATE_TRIANGLES] == 1);
        pbs_scene_close(&s);
    }
    /* Both sides of a sheet, wound as such. */
    in.count = 0;
    add_box(0, 0, 0, 1, -1);
    in.count = 2;
    for (int i = 0; i < 2; i++) add(in.p[i][0], in.p[i][2], in.p[i][1], 0);
    pbs_scene s = repair_soup(nowhere, &fill_none);
    CHECK(s.nodes[0].triangles == 4 && !got.counts[PBS_MEND_FLIPPED_TRIANGLES]);
    pbs_scene_close(&s);
}

static void point_outward(void *ctx, const pbs_vertex v[3], uint32_t material) {
    double n[3], side = 0;
    (void)material;
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        n[k] = (v[1].position[i] - v[0].position[i]) * (v[2].position[j] - v[0].position[j]) -
               (v[1].position[j] - v[0].position[j]) * (v[2].position[i] - v[0].position[i]);
        side += n[k] * ((v[0].position[k] + v[1].position[k] + v[2].position[k]) / 3 - 0.5);
    }
    *(int *)ctx += side > 0;
}

TEST(open_box) {
    NEED_MEND;
    for (int skip = 0; skip < 6; skip++) {
        int outward = 0;
        in.count = 0;
        add_box(0, 0, 0, 1, skip);
        turn_some((uint64_t)skip);
        pbs_scene s = repair_soup(nowhere, &fill_none);
        for_triangles(&s, 0, point_outward, &outward);
        CHECK_NUM(outward == 10, outward);
        CHECK(got.counts[PBS_MEND_HOLES] == 1 && !got.counts[PBS_MEND_CLOSED_AFTER]);
        pbs_scene_close(&s);
    }
}

TEST(holes) {
    NEED_MEND;
    pbs_mend_options four = {.fill = 4}, three = {.fill = 3};
    add_box(0, 0, 0, 1, 2);
    turn_some(3);
    pbs_scene s = repair_soup(nowhere, &four);
    CHECK_NUM(fabs(volume(&s) - 1) < 1e-6, volume(&s));
    CHECK(got.counts[PBS_MEND_HOLES_FILLED] == 1 && s.nodes[0].triangles == 12);
    CHECK(got.counts[PBS_MEND_CLOSED_AFTER] && got.counts[PBS_MEND_FILLED_TRIANGLES] == 2);
    pbs_scene_close(&s);
    s = repair_soup(nowhere, &three);
    CHECK(!got.counts[PBS_MEND_HOLES_FILLED] && s.nodes[0].triangles == 10);
    pbs_scene_close(&s);
    /* A sheet has a border, not a hole. */
    in.count = 2;
    s = repair_soup(nowhere, &four);
    CHECK(!got.counts[PBS_MEND_HOLES_FILLED] && s.nodes[0].triangles == 2);
    pbs_scene_close(&s);
}

TEST(moebius) {
    NEED_MEND;
    const int n = 16;
    double edge[17][2][3];
    for (int i = 0; i <= n; i++)
        for (int k = 0; k < 2; k++) {
            double a = 2 * M_PI * i / n, r = 2 + (k ? 0.5 : -0.5) * cos(a / 2);
            edge[i][k][0] = r * cos(a), edge[i][k][1] = r * sin(a);
            edge[i][k][2] = (k ? 0.5 : -0.5) * sin(a / 2);
        }
    memcpy(edge[n][0], edge[0][1], 24);
    memcpy(edge[n][1], edge[0][0], 24);
    for (int i = 0; i < n; i++) {
        add(edge[i][0], edge[i + 1][0], edge[i][1], 0);
        add(edge[i][1], edge[i + 1][0], edge[i + 1][1], 0);
    }
    for (uint64_t seed = 0; seed < 5; seed++) {
        turn_some(seed);
        pbs_scene s = repair_soup(nowhere, &fill_none);
        CHECK(got.counts[PBS_MEND_UNORIENTABLE_EDGES] == 1 && s.nodes[0].triangles == 2 * 16);
        pbs_scene_close(&s);
    }
}

static void is_whole(void *ctx, const pbs_vertex v[3], uint32_t material) {
    const pbs_node *n = ctx;
    int side = (int)material, k = side / 2;
    double face[3];
    for (int i = 0; i < 3; i++) {
        float normal[3];
        CHECK(is_dressed(&v[i], n->origin));
        CHECK(v[i].position[k] + n->origin[k] == side % 2);
        pbs_oct_decode(normal, v[i].normal);
        CHECK(normal[k] * (side % 2 ? 1 : -1) > 0.999f);
    }
    for (int j = 0; j < 3; j++) {
        int a = (j + 1) % 3, b = (j + 2) % 3;
        face[j] = (v[1].position[a] - v[0].position[a]) * (v[2].position[b] - v[0].position[b]) -
                  (v[1].position[b] - v[0].position[b]) * (v[2].position[a] - v[0].position[a]);
    }
    CHECK(face[k] * (side % 2 ? 1 : -1) > 0.999);
}

/* Materials stay with triangles, the rest with corners; normals are turned with their triangle. */
TEST(attributes) {
    NEED_MEND;
    const double origin[3] = {0.5, 0.5, 0.25};
    for (uint64_t seed = 0; seed < 10; seed++) {
        in.count = 0;
        add_box(0, 0, 0, 1, -1);
        turn_some(seed);
        pbs_scene s = scene_of(origin, PBS_CORNER_NORMAL | PBS_CORNER_UV | PBS_CORNER_COLOUR);
        pbs_scene r = repaired(&s, &fill_none);
        CHECK(r.material_count == 6 && r.materials[5].metallic == 5.0f / 8);
        CHECK(r.meshes[0].vertices == 24 && r.meshes[0].triangles == 12);
        CHECK(got.counts[PBS_MEND_NORMALS_TURNED] == got.counts[PBS_MEND_FLIPPED_TRIANGLES]);
        for_triangles(&r, PBS_CORNER_NORMAL, is_whole, &r.nodes[0]);
        pbs_scene_close(&s);
        pbs_scene_close(&r);
    }
}

/* A good mesh comes out as it was, and a repaired one is a good one. */
TEST(idempotent) {
    NEED_MEND;
    pbs_mend_options options = {.fill = 8, .intersections = true};
    for (uint64_t seed = 0; seed < 12; seed++) {
        in.count = 0;
        add_box(0, 0, 0, 3, seed > 5 ? 0 : -1);
        add_box(3, 0, 0, 3, -1);
        add_box(1, 1, 1, 1, -1);
        if (seed == 0)
            for (int i = 24; i < 36; i++) turn(i);
        if (seed) turn_some(seed);
        pbs_scene s = scene_of(nowhere, PBS_CORNER_NORMAL | PBS_CORNER_UV);
        pbs_scene r = repaired(&s, &options);
        CHECK(seed || same_meshes(&s, &r));
        CHECK(got.counts[PBS_MEND_CLOSED_BEFORE] == (seed == 0));
        pbs_scene again = repaired(&r, &options);
        CHECK(same_meshes(&r, &again));
        CHECK(got.counts[PBS_MEND_CLOSED_BEFORE] && !got.counts[PBS_MEND_FLIPPED_TRIANGLES]);
        pbs_scene_close(&again);
        pbs_scene_close(&r);
        pbs_scene_close(&s);
    }
}

/* A fin on an edge of a box: the box stays closed in itself. */
TEST(fin) {
    NEED_MEND;
    for (uint64_t seed = 0; seed < 10; seed++) {
        in.count = 0;
        add_box(0, 0, 0, 1, -1);
        add((double[]){1, 1, 0}, (double[]){1, 1, 1}, (double[]){2, 2, 0}, 0);
        turn_some(seed);
        pbs_scene s = repair_soup(nowhere, &fill_none);
        double all = volume(&s), own = 0;
        add_volume(&own,
                   (pbs_vertex[3]){
                       {.position = {1, 1, 0}}, {.position = {1, 1, 1}}, {.position = {2, 2, 0}}},
                   0);
        CHECK_NUM(fabs(fabs(all - 1) - fabs(own)) < 1e-6, all);
        CHECK(got.counts[PBS_MEND_NONMANIFOLD_EDGES] == 1);
        pbs_scene_close(&s);
    }
}

/* Anything at all between few points: coincident, folded, crossing, around one edge. */
TEST(chaos) {
    NEED_MEND;
    pbs_mend_options options = {.fill = 6, .intersections = true};
    for (uint64_t seed = 0; seed < 40; seed++) {
        uint64_t state = seed;
        uint32_t side = 2 + seed % 4;
        in.count = 0;
        while (in.count < 5 + (int)(seed * 2)) {
            double p[3][3];
            for (int i = 0; i < 9; i++) p[i / 3][i % 3] = random_bits(&state) % side;
            add(p[0], p[1], p[2], 0);
        }
        pbs_scene s = scene_of(nowhere, PBS_CORNER_UV);
        size_t before = pbs_mem_used(&run);
        pbs_scene r = repaired(&s, &options);
        CHECK(r.nodes[0].triangles == s.nodes[0].triangles -
                                          got.counts[PBS_MEND_DUPLICATE_TRIANGLES] -
                                          got.counts[PBS_MEND_DEGENERATE_TRIANGLES] +
                                          got.counts[PBS_MEND_FILLED_TRIANGLES]);
        CHECK(got.counts[PBS_MEND_CLOSED_AFTER] >= got.counts[PBS_MEND_CLOSED_BEFORE]);
        pbs_scene_close(&r);
        CHECK(pbs_mem_used(&run) == before);
        pbs_scene_close(&s);
    }
}

TEST(limit) {
    NEED_MEND;
    add_box(0, 0, 0, 1, -1);
    pbs_scene s = scene_of(nowhere, 0);
    size_t used = pbs_mem_used(&run);
    pbs_writer *w = spool_writer(&run, PBS_SCENE, NULL, 0);
    pbs_scene_writer *sw;
    must(pbs_scene_writer_new(&run, w, NULL, &sw, &err), &err);
    run.mem_limit = pbs_mem_used(&run) + 9000;
    CHECK(pbs_scene_mend(&s, &fill_none, sw, &got, &err) == PBS_LIMIT);
    CHECK(strstr(err.text, "the largest part") != NULL);
    run.mem_limit = 0;
    pbs_scene_writer_free(sw);
    pbs_writer_close(w);
    CHECK(pbs_mem_used(&run) == used);
    pbs_scene_close(&s);
}

TEST_MAIN
