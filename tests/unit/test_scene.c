/* Scenes and meshes: the builder welds, cuts and counts; a scene comes back as it was written;
 * hostile contents are refused, and a few kilobytes that stand for 2^64 instances too. */
#include "formats/scene/meshbuild.h"
#include "tests/unit/support.h"
#include "tests/check.h"

static pbs_run run = {.threads = 1};
static pbs_err err;

/* ---- scenes ---- */

typedef struct maker {
    pbs_writer *w;
    pbs_scene_writer *sw;
    const pbs_sink *s;
} maker;

static maker new_scene(void) {
    maker m = {.w = spool_writer(&run, PBS_SCENE, NULL, 0)};
    must(pbs_scene_writer_new(&run, m.w, NULL, &m.sw, &err), &err);
    m.s = pbs_scene_sink(m.sw);
    return m;
}

/* size 0: an empty part. */
static uint32_t add_quad(const maker *m, const char *name, double size) {
    uint32_t node;
    const double origin[3] = {0, 0, 0};
    must(m->s->part_begin(m->s->ctx, name, origin, 0, &err), &err);
    if (size > 0) put_quad(m->s, size, PBS_NONE, PBS_NONE);
    must(m->s->part_end(m->s->ctx, &node, &err), &err);
    return node;
}

static uint32_t add_part(const maker *m, const char *name, bool empty) {
    return add_quad(m, name, empty ? 0 : 1);
}

static uint32_t add_assembly(const maker *m, uint32_t a, uint32_t b, double move) {
    pbs_child c[2] = {{.node = a}, {.node = b}};
    uint32_t node;
    memcpy(c[0].m, PBS_IDENTITY, sizeof c[0].m), memcpy(c[1].m, PBS_IDENTITY, sizeof c[1].m);
    c[1].m[3] = move;
    must(m->s->assembly(m->s->ctx, "pair", c, b == PBS_NONE ? 1 : 2, &node, &err), &err);
    return node;
}

/* Ends the scene and opens it again. */
static pbs_code reopen(maker *m, uint32_t root, pbs_scene *out) {
    must(m->s->root(m->s->ctx, root, &err), &err);
    must(pbs_scene_writer_end(m->sw, &err), &err);
    pbs_scene_writer_free(m->sw);
    blob b = take_bytes(m->w);
    char path[40];
    int fd = memfd_create("scene", MFD_CLOEXEC);
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    if (write(fd, b.bytes, b.size) != (ssize_t)b.size) abort();
    pbs_code rc = pbs_scene_open(&run, path, NULL, out, &err);
    close(fd);
    free(b.bytes);
    return rc;
}

TEST(doubling_64_levels) {
    maker m = new_scene();
    uint32_t node = add_part(&m, "one", false);
    for (int i = 0; i < 64; i++) node = add_assembly(&m, node, node, 1);
    pbs_scene s;
    pbs_flat flat;
    CHECK(!reopen(&m, node, &s) && s.node_count == 65 && s.nodes[64].triangles == UINT64_MAX);
    pbs_code rc = pbs_scene_flatten(&s, &flat, &err);
    CHECK((rc == PBS_DATA || rc == PBS_LIMIT) && !flat.draws);
    /* the counts that the nodes give are not believed */
    s.nodes[64].triangles = 1;
    rc = pbs_scene_flatten(&s, &flat, &err);
    CHECK((rc == PBS_DATA || rc == PBS_LIMIT) && !flat.draws);
    pbs_scene_close(&s);
    /* 2^64 + 1 in 64 bits is 1 */
    m = new_scene();
    uint32_t one = node = add_part(&m, "one", false);
    for (int i = 0; i < 64; i++) node = add_assembly(&m, node, node, 1);
    CHECK(!reopen(&m, add_assembly(&m, node, one, 1), &s));
    s.nodes[65].triangles = 1;
    rc = pbs_scene_flatten(&s, &flat, &err);
    CHECK((rc == PBS_DATA || rc == PBS_LIMIT) && !flat.draws);
    pbs_scene_close(&s);
    CHECK(pbs_mem_used(&run) == 0);
}

/* As many instances of nothing cost nothing. */
TEST(doubling_empty) {
    maker m = new_scene();
    uint32_t one = add_part(&m, "one", false), node = add_part(&m, "none", true);
    for (int i = 0; i < 64; i++) node = add_assembly(&m, node, node, 1);
    pbs_scene s;
    pbs_flat flat;
    CHECK(!reopen(&m, add_assembly(&m, node, one, 5), &s));
    CHECK(!pbs_scene_flatten(&s, &flat, &err) && flat.count == 1 && flat.triangles == 2);
    CHECK(flat.box.min[0] == 5 && flat.box.max[0] == 6 && flat.origin[0] == 5.5);
    pbs_free(&run, flat.draws);
    pbs_scene_close(&s);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(deep_scene) {
    maker m = new_scene();
    uint32_t node = add_part(&m, "one", false);
    for (int i = 0; i < 20000; i++) node = add_assembly(&m, node, PBS_NONE, 0);
    pbs_scene s;
    pbs_flat flat;
    CHECK(!reopen(&m, node, &s) && s.node_count == 20001);
    CHECK(!pbs_scene_flatten(&s, &flat, &err) && flat.count == 1 && flat.triangles == 2);
    pbs_free(&run, flat.draws);
    pbs_scene_close(&s);
    CHECK(pbs_mem_used(&run) == 0);
}

static pbs_code open_scene_blob(blob b, pbs_scene *s) {
    char path[40];
    int fd = memfd_create("scene", MFD_CLOEXEC);
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    if (write(fd, b.bytes, b.size) != (ssize_t)b.size) abort();
    pbs_code rc = pbs_scene_open(&run, path, NULL, s, &err);
    close(fd);
    return rc;
}

TEST(scene_comes_back) {
    blob b = small_scene(&run);
    pbs_scene s;
    CHECK(!open_scene_blob(b, &s));
    CHECK(s.node_count == 3 && s.mesh_count == 2 && s.material_count == 1 && s.texture_count == 1);
    CHECK(!strcmp(s.nodes[0].name, "a") && !strcmp(s.nodes[2].name, "all"));
    CHECK(s.nodes[2].triangles == 6 && s.nodes[0].records == 2 && s.nodes[2].records == 0);
    CHECK(s.nodes[2].box.min[0] == 0 && s.nodes[2].box.max[0] == 2 && s.nodes[2].box.max[1] == 3);
    CHECK(s.nodes[2].child_count == 3 && s.nodes[2].children[2].m[7] == 2);
    CHECK(!strcmp(s.nodes[2].children[0].name, "left"));
    CHECK(!strcmp(s.textures[0].name, "t.png") && s.textures[0].size == 13 &&
          !memcmp(s.textures[0].bytes, "not a picture", 13));
    const pbs_material *m = &s.materials[0];
    CHECK(!strcmp(m->name, "red") && m->base[0] == 1 && m->base[1] == 0 && m->base[3] == 1);
    CHECK(m->base_texture.texture == 0 && m->base_texture.wrap_u == 2 && m->roughness == 1);
    CHECK(m->base_texture.transform[4] == 1 && m->emissive_texture.texture == PBS_NONE);
    CHECK(m->double_sided == 1 && m->alpha_cutoff == 0.5f);
    CHECK(s.first_mesh[0] == 0 && s.first_mesh[1] == 1 && s.first_mesh[2] == 2 &&
          s.first_mesh[3] == 2);
    const pbs_mesh *a = &s.meshes[0], *c = &s.meshes[1];
    CHECK(a->vertices == 4 && a->triangles == 2 && a->normal && a->uv && a->colour);
    CHECK(!a->triangle_material && a->material == 0);
    CHECK(!c->normal && !c->uv && !c->colour && c->triangle_material);
    CHECK(c->triangle_material && c->triangle_material[0] == 0 &&
          c->triangle_material[1] == PBS_NONE);
    CHECK(s.skipped[PBS_SKIP_LINES] == 3 && s.skipped[PBS_SKIP_POINTS] == 0);
    CHECK(s.channels == (PBS_NORMAL | PBS_COLOUR));
    CHECK(!strcmp(pbs_scene_history(&s), "stage a test\nstage test\n"));
    pbs_flat flat;
    CHECK(!pbs_scene_flatten(&s, &flat, &err) && flat.count == 3 && flat.triangles == 6);
    CHECK(flat.draws[0].mesh == flat.draws[2].mesh && flat.singular == 0);
    pbs_free(&run, flat.draws);
    pbs_scene_close(&s);
    free(b.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

/* Every bit of every byte, with the checksums put right: taken or refused, never a crash. What the
 * checker takes, the reader takes, and the other way round. */
TEST(scene_hostile_bits) {
    blob b = small_scene(&run);
    int differ = 0;
    for (size_t bit = 8 * pbs_get_u32(b.bytes + HEADER_BYTES_AT); bit < 8 * b.size; bit += 5) {
        blob c = copy_blob(b);
        pbs_scene s;
        pbs_flat flat;
        c.bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
        reseal(c);
        pbs_code rc = open_scene_blob(c, &s), checked = check_blob(&run, c, false, NULL);
        CHECK(rc == PBS_OK || rc == PBS_DATA);
        if (!rc && !pbs_scene_flatten(&s, &flat, &err)) pbs_free(&run, flat.draws);
        if (!rc) pbs_scene_close(&s);
        differ += rc == PBS_DATA && checked == PBS_OK;
        free(c.bytes);
    }
    CHECK_NUM(differ == 0, differ);
    free(b.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(scene_writer_refuses_and_counts) {
    maker m = new_scene();
    uint32_t none = add_part(&m, "none", true);
    must(m.s->root(m.s->ctx, none, &err), &err);
    CHECK(pbs_scene_writer_end(m.sw, &err) == PBS_DATA && !strcmp(err.text, "no triangles in it"));
    pbs_scene_writer_free(m.sw), pbs_writer_close(m.w);
    m = new_scene();
    CHECK(pbs_scene_writer_end(m.sw, &err) == PBS_DATA); /* no root either */
    uint32_t id;
    CHECK(m.s->missing(m.s->ctx, "wood.png", &id, &err) == PBS_DATA &&
          strstr(err.text, "wood.png"));
    pbs_scene_writer_free(m.sw), pbs_writer_close(m.w);
    m = new_scene(); /* a placing that cannot be, and a root that is not the last node */
    uint32_t part = add_part(&m, "one", false);
    uint32_t root = add_assembly(&m, part, part, NAN);
    add_quad(&m, "unused", 2);
    pbs_scene s;
    CHECK(!reopen(&m, root, &s) && s.skipped[PBS_SKIP_TRANSFORM] == 1);
    CHECK(s.node_count == 4 && s.nodes[3].triangles == 2 && s.nodes[3].children[0].node == root);
    pbs_flat flat;
    CHECK(!pbs_scene_flatten(&s, &flat, &err) && flat.count == 1);
    pbs_free(&run, flat.draws);
    pbs_scene_close(&s);
    CHECK(pbs_mem_used(&run) == 0);
}

/* ---- meshes ---- */

typedef struct mesh_file {
    blob b;
    pbs_reader *r;
    pbs_mesh mesh[64];
    uint32_t first[64];
    size_t count;
    uint64_t triangles, skipped[PBS_SKIP_KINDS];
    uint32_t seen;
    pbs_box box;
    pbs_writer *w;
    pbs_builder *builder;
} mesh_file;

static pbs_code put_mesh(void *ctx, uint32_t triangles, const pbs_piece *piece, int pieces,
                         pbs_err *e) {
    mesh_file *f = ctx;
    pbs_chunk c = {.tag = PBS_TAG_MESH, .node = 3, .count = triangles, .first = f->seen};
    f->seen += triangles;
    return pbs_writer_chunk(f->w, &c, piece, pieces, e);
}

static void begin_mesh(mesh_file *f, const double origin[3], uint32_t corners) {
    memset(f, 0, sizeof *f);
    f->w = spool_writer(&run, PBS_SCENE, NULL, 0);
    pbs_mesh_out to = {f, put_mesh};
    must(pbs_builder_new(&run, to, &f->builder, &err), &err);
    pbs_builder_begin(f->builder, origin, corners);
}

static void end_mesh(mesh_file *f) {
    must(pbs_builder_end(f->builder, &f->triangles, &f->box, &err), &err);
    pbs_builder_skips(f->builder, f->skipped);
    pbs_builder_free(f->builder);
    f->b = take_bytes(f->w);
    pbs_input in;
    open_mapped(&run, f->b, &in);
    must(pbs_reader_open(&run, &in, PBS_KIND(PBS_SCENE), &f->r, &err), &err);
    uint64_t seen = 0;
    for (;;) {
        pbs_chunk c;
        bool end;
        must(pbs_reader_next(f->r, &c, &end, &err), &err);
        if (end) break;
        CHECK(c.tag == PBS_TAG_MESH && c.node == 3 && c.first == seen && f->count < 64);
        seen += c.count;
        must(pbs_mesh_parse("f", &c, &f->mesh[f->count++], &err), &err);
    }
    CHECK(seen == f->triangles);
}

static void close_mesh(mesh_file *f) {
    pbs_reader_close(f->r);
    free(f->b.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

static const double zero[3], grid_origin[3] = {1e7 + 3.7, -1e7, 0.1};

static void set_corner(pbs_corner *c, double x, double y, double z) {
    memset(c, 0, sizeof *c);
    c->position[0] = x, c->position[1] = y, c->position[2] = z;
}

static void put_triangle(mesh_file *f, const double p[9], uint32_t material) {
    pbs_corner c[3];
    for (int i = 0; i < 3; i++) set_corner(&c[i], p[3 * i], p[3 * i + 1], p[3 * i + 2]);
    must(pbs_builder_triangle(f->builder, c, material, &err), &err);
}

/* Triangle t of a grid of n x n quads; its corners' places in doubles that are no floats. */
static void grid_triangle(int n, int t, double p[9]) {
    static const int corner[2][3][2] = {{{0, 0}, {1, 0}, {0, 1}}, {{1, 0}, {1, 1}, {0, 1}}};
    int q = t / 2;
    for (int i = 0; i < 3; i++) {
        double x = q % n + corner[t % 2][i][0], y = q / n + corner[t % 2][i][1];
        p[3 * i] = 1e7 + x / 7, p[3 * i + 1] = -1e7 + y / 3, p[3 * i + 2] = sin(x * 0.1) * cos(y);
    }
}

static void check_grid(int n, size_t least_meshes) {
    static mesh_file f;
    const double *origin = grid_origin;
    double p[9];
    begin_mesh(&f, origin, 0);
    for (int t = 0; t < 2 * n * n; t++) grid_triangle(n, t, p), put_triangle(&f, p, 5);
    end_mesh(&f);
    CHECK(f.triangles == 2ull * (unsigned)(n * n) && f.count >= least_meshes);
    /* the triangles come in order, each corner the one float that its double gives: so a vertex
     * that two meshes share has the same bits in both */
    int t = 0, wrong = 0;
    size_t vertices = 0;
    pbs_box box = PBS_BOX_EMPTY;
    for (size_t k = 0; k < f.count; k++) {
        const pbs_mesh *m = &f.mesh[k];
        CHECK(m->vertices <= PBS_MESH_VERTICES && m->triangles <= PBS_MESH_TRIANGLES);
        CHECK(m->material == 5 && !m->triangle_material && !m->normal && !m->uv && !m->colour);
        CHECK(k + 1 == f.count || m->vertices > PBS_MESH_VERTICES - 3);
        vertices += m->vertices;
        for (uint32_t i = 0; i < m->triangles; i++, t++) {
            grid_triangle(n, t, p);
            for (int c = 0; c < 9; c++) {
                float got = m->position[3 * m->index[3 * i + (uint32_t)c / 3] + (uint32_t)c % 3];
                wrong += got != (float)(p[c] - origin[c % 3]);
            }
        }
        for (uint32_t i = 0; i < m->vertices; i++) {
            double v[3];
            for (int c = 0; c < 3; c++) v[c] = origin[c] + m->position[3 * i + (uint32_t)c];
            pbs_box_add(&box, v);
        }
    }
    CHECK_NUM(wrong == 0, wrong);
    CHECK(!memcmp(&box, &f.box, sizeof box));
    if (f.count == 1) CHECK_NUM(vertices == (size_t)(n + 1) * (size_t)(n + 1), vertices);
    close_mesh(&f);
}

TEST(builder_welds) {
    check_grid(40, 1);
}
TEST(builder_fills_a_mesh) {
    check_grid(255, 1);
} /* 65536 vertices */
TEST(builder_cuts) {
    check_grid(420, 3);
}

TEST(builder_cuts_at_triangles) {
    static mesh_file f;
    double p[9];
    begin_mesh(&f, grid_origin, 0);
    for (int i = 0; i < PBS_MESH_TRIANGLES + 10; i++)
        grid_triangle(10, i % 200, p), put_triangle(&f, p, 0);
    end_mesh(&f);
    CHECK(f.count == 2 && f.mesh[0].triangles == PBS_MESH_TRIANGLES && f.mesh[1].triangles == 10);
    close_mesh(&f);
}

TEST(builder_welds_by_bits) {
    static mesh_file f;
    begin_mesh(&f, zero, 0);
    put_triangle(&f, (double[9]){0, 0, 0, 1, 0, 0, 0, 1, 0}, 0);
    put_triangle(&f, (double[9]){-0.0, 0, -0.0, 0, -0.0, 1, 1, -0.0, 0}, 0); /* -0 is 0 */
    put_triangle(&f, (double[9]){1e-300, 0, 0, 1, 0, 0, 0, 1, 0}, 0); /* so is this, in float */
    end_mesh(&f);
    CHECK(f.count == 1 && f.mesh[0].vertices == 4 && f.triangles == 3);
    close_mesh(&f);
    begin_mesh(&f, zero, PBS_CORNER_NORMAL | PBS_CORNER_UV | PBS_CORNER_COLOUR);
    pbs_corner c[3];
    for (int i = 0; i < 3; i++) set_corner(&c[i], i == 1, i == 2, 0), c[i].normal[2] = 1;
    for (int i = 0; i < 8; i++) { /* what differs in any attribute is another vertex */
        c[0].uv[0] = i & 1 ? 0.5f : -0.0f, c[0].colour[2] = i & 2 ? 7 : 0;
        c[0].normal[0] = i & 4 ? 1 : 0;
        must(pbs_builder_triangle(f.builder, c, 0, &err), &err);
    }
    end_mesh(&f);
    CHECK_NUM(f.count == 1 && f.mesh[0].vertices == 10, f.mesh[0].vertices);
    close_mesh(&f);
}

TEST(builder_counts_what_it_leaves_out) {
    static mesh_file f;
    static const double bad[][9] = {{NAN, 0, 0, 1, 0, 0, 0, 1, 0},
                                    {0, 0, 0, INFINITY, 0, 0, 0, 1, 0},
                                    {0, 0, 0, 1, 0, 0, 0, 0, -INFINITY},
                                    {1e39, 0, 0, 1, 0, 0, 0, 1, 0}, /* no float */
                                    {0, 0, 0, 0, -1e300, 0, 0, 1, 0}};
    static const double flat[][9] = {{0, 0, 0, 0, 0, 0, 0, 1, 0},
                                     {0, 0, 0, 1, 1, 1, 1, 1, 1},
                                     {5, 5, 5, 5, 5, 5, 5, 5, 5},
                                     {0, 0, 0, 1, 1, 1, 2, 2, 2},
                                     {0, 0, 0, 3, 6, 9, 1, 2, 3},
                                     {0, 0, 0, 0, 0, -0.0, 1, 0, 0},
                                     {1e8, 1, 1, 1e8, 1 + 1e-12, 1, 0, 0, 0}, /* in float */
                                     {1e20, 1e20, 0, 1, 1, 0, 1e-20, 1e-20, 0}};
    static const double needle[][9] = {{0, 0, 0, 1, 0, 0, 0, 1e-8, 0},
                                       {0, 0, 0, 1e8, 0, 0, 5e7, 1, 0},
                                       {0, 0, 0, 1, 0, 0, 0.5, 1e-40, 0},
                                       {1, 1, 1, 2, 2, 2, 3, 3, 3 + 2.5e-7},
                                       {1e-30, 0, 0, 0, 1e-30, 0, 0, 0, 1e-30},
                                       {1, 1, 0, 1e-20, 0, 0, 0, 1e-20, 0},
                                       {1e30, 1e30, 1e30, -1e30, 0, 0, 0, 1e-30, 0}};
    begin_mesh(&f, zero, 0);
    for (int i = 0; i < 5; i++) put_triangle(&f, bad[i], 0);
    for (int i = 0; i < 8; i++) put_triangle(&f, flat[i], 0);
    for (int i = 0; i < 7; i++) put_triangle(&f, needle[i], 0);
    end_mesh(&f);
    CHECK_NUM(f.skipped[PBS_SKIP_NONFINITE] == 5, f.skipped[PBS_SKIP_NONFINITE]);
    CHECK_NUM(f.skipped[PBS_SKIP_DEGENERATE] == 8, f.skipped[PBS_SKIP_DEGENERATE]);
    CHECK_NUM(f.triangles == 7, f.triangles);
    close_mesh(&f);
}

TEST(builder_materials) {
    static mesh_file f;
    double p[9];
    begin_mesh(&f, grid_origin, 0);
    for (int t = 0; t < 50; t++)
        grid_triangle(5, t, p), put_triangle(&f, p, t < 20 ? PBS_NONE : (uint32_t)t);
    end_mesh(&f);
    CHECK(f.count == 1 && f.mesh[0].triangle_material && f.mesh[0].vertices == 36);
    for (uint32_t t = 0; t < 50; t++)
        CHECK(f.mesh[0].triangle_material[t] == (t < 20 ? PBS_NONE : t));
    close_mesh(&f);
}

static void normal_of_corner(const mesh_file *f, uint32_t corner, float n[3]) {
    pbs_oct_decode(n, f->mesh[0].normal + 2 * f->mesh[0].index[corner]);
}

/* A normal of any length counts; one that is none is the triangle's own, at any scale. */
TEST(builder_normals) {
    static const float length[] = {1, 1e-30f, 1e-20f, 1e20f, 1e30f};
    static const double scale[] = {1, 1e-30, 1e-20, 1e-9, 1e9, 1e20, 1e30};
    for (int s = 0; s < 7; s++) {
        static mesh_file f;
        pbs_corner c[3];
        begin_mesh(&f, zero, PBS_CORNER_NORMAL);
        for (int i = 0; i < 5; i++) {
            for (int k = 0; k < 3; k++)
                set_corner(&c[k], 0, k == 1 ? scale[s] : 0, k == 2 ? scale[s] : 0);
            c[0].normal[1] = length[i];
            c[1].normal[0] = i & 1 ? NAN : 0;
            c[2].normal[2] = i & 1 ? INFINITY : 0;
            must(pbs_builder_triangle(f.builder, c, 0, &err), &err);
        }
        end_mesh(&f);
        for (uint32_t i = 0; i < 5; i++) {
            float n[3];
            normal_of_corner(&f, 3 * i, n);
            CHECK_NUM(n[0] == 0 && n[1] == 1 && n[2] == 0, length[i]);
            for (uint32_t k = 1; k < 3; k++) {
                normal_of_corner(&f, 3 * i + k, n);
                CHECK_NUM(n[0] == 1 && n[1] == 0 && n[2] == 0, scale[s]);
            }
        }
        close_mesh(&f);
    }
}

TEST(builder_empty) {
    static mesh_file f;
    begin_mesh(&f, zero, 0);
    end_mesh(&f);
    CHECK(f.count == 0 && f.triangles == 0 && pbs_box_is_empty(&f.box));
    close_mesh(&f);
}

TEST(mesh_hostile) {
    uint32_t payload[4 + 9 + 2] = {3, 1, 0, PBS_NONE};
    for (int i = 0; i < 9; i++) memcpy(&payload[4 + i], &(float){(float)i}, 4);
    uint16_t index[3] = {0, 1, 2};
    uint8_t *bytes = malloc(16 + 36 + 6);
    memcpy(bytes, payload, 52), memcpy(bytes + 52, index, 6);
    pbs_chunk c = {.tag = PBS_TAG_MESH, .node = 1, .count = 1, .bytes = 58, .payload = bytes};
    pbs_mesh m;
    CHECK(!pbs_mesh_parse("f", &c, &m, &err) && m.vertices == 3 && m.index[2] == 2);
    for (uint64_t n = 0; n < 58; n++) {
        pbs_chunk cut = c;
        cut.bytes = n;
        CHECK(pbs_mesh_parse("f", &cut, &m, &err) == PBS_DATA);
    }
    CHECK(!strcmp(err.text, "f: a mesh of node 1 is damaged"));
    pbs_chunk empty = {.tag = PBS_TAG_MESH, .node = 1};
    CHECK(pbs_mesh_parse("f", &empty, &m, &err) == PBS_DATA);
    static const struct {
        size_t at;
        uint32_t v;
    } bad[] = {{0, 2},          {0, 65537},       {0, UINT32_MAX},  {4, 0},
               {4, 2},          {4, UINT32_MAX},  {8, 1},           {8, 16},
               {8, UINT32_MAX}, {16, 0x7f800000}, {48, 0x7fc00000}, {48, 0xff800000},
               {52, 3},         {54, 0xffff0000}};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        uint8_t keep[4];
        memcpy(keep, bytes + bad[i].at, 4);
        pbs_put_u32(bytes + bad[i].at, bad[i].v);
        CHECK_NUM(pbs_mesh_parse("f", &c, &m, &err) == PBS_DATA, bad[i].at);
        memcpy(bytes + bad[i].at, keep, 4);
    }
    c.count = 2;
    CHECK(pbs_mesh_parse("f", &c, &m, &err) == PBS_DATA);
    free(bytes);
}

TEST_MAIN
