/* Merging: every triangle of a scene arrives, where it was, at the nodes that pack.h says, with its
 * material and that one's picture; nothing else does. What is equal is stored once. */
#include "formats/scene/meshbuild.h"
#include "formats/surfels/octaves.h"
#include "formats/archive/pack.h"
#include "formats/voxels/voxels.h"
#include "formats/voxels/voxelstream.h"
#include "tests/unit/scenes.h"
#include "tests/check.h"
#include <math.h>

/* ---- a scene: a part of small triangles placed four times, and one of large ones ---- */

enum { SMALL = 300, LARGE = 6, PLACINGS = 4, ALL = SMALL * PLACINGS + LARGE };

static double chance(uint64_t *seed, double most) {
    return most * (random_bits(seed) / 4294967296.0);
}

/* salt: of the textures' bytes, so that scenes differ in them. The last material, which has the
 * last texture, is nowhere. */
static void add_looks(const maker *m, int salt) {
    static const char *const name[] = {"red", "green", "blue", "unseen"};
    for (int i = 0; i < 3; i++) {
        char bytes[32], path[8];
        uint32_t id;
        snprintf(path, sizeof path, "%d.png", i);
        snprintf(bytes, sizeof bytes, "picture %d", i ? i * salt : 0);
        must(m->s->texture(m->s->ctx, path, bytes, strlen(bytes), &id, &err), &err);
    }
    for (uint32_t i = 0; i < 4; i++) {
        pbs_material material = PBS_MATERIAL_DEFAULT;
        uint32_t id;
        material.name = name[i];
        material.base[i] = 0.5f;
        if (i != 2) material.base_texture.texture = i < 2 ? i : 2;
        must(m->s->material(m->s->ctx, &material, &id, &err), &err);
    }
}

static uint32_t add_part(const maker *m, int count, double size, double x, uint64_t seed) {
    const double origin[3] = {x, 0, 0};
    uint32_t node;
    must(m->s->part_begin(m->s->ctx, "part", origin, PBS_CORNER_NORMAL | PBS_CORNER_UV, &err),
         &err);
    for (int i = 0; i < count; i++) {
        pbs_corner c[3] = {0};
        double at[3] = {x + chance(&seed, 8), chance(&seed, 8), chance(&seed, 8)};
        for (int k = 0; k < 9; k++) c[k / 3].position[k % 3] = at[k % 3] + chance(&seed, size);
        for (int k = 0; k < 9; k++) c[k / 3].normal[k % 3] = (float)chance(&seed, 2) - 1;
        must(m->s->triangle(m->s->ctx, c, (uint32_t)i % 3, &err), &err);
    }
    must(m->s->part_end(m->s->ctx, &node, &err), &err);
    return node;
}

static pbs_scene make_scene(int salt) {
    maker m = new_scene();
    add_looks(&m, salt);
    uint32_t small = add_part(&m, SMALL, 0.5, 1e6, 1), large = add_part(&m, LARGE, 30, 0, 2);
    pbs_child c[5] = {child_at(small, -1e6, 1, false), child_at(small, 20 - 2e6, 2, false),
                      child_at(small, 1e6, 1, false), child_at(small, -1e6, 1, false),
                      child_at(large, 0, 1, false)};
    c[2].m[0] = -1; /* mirrored */
    c[2].m[7] = 12;
    c[3].m[2] = 0.25, c[3].m[11] = 10; /* sheared */
    uint32_t inner = add_pair(&m, c[0], c[1]);
    pbs_child top[4] = {child_at(inner, 0, 1, false), c[2], c[3], c[4]};
    return reopen(&m, add_assembly(&m, top, 4));
}

static uint32_t material_of(const pbs_mesh *m, uint32_t t) {
    return m->triangle_material ? m->triangle_material[t] : m->material;
}

/* All its triangles, placed. */
typedef struct placed {
    double p[3][3];
    uint32_t material;
    int seen;
} placed;

static placed *place_all(const pbs_scene *s) {
    pbs_flat flat;
    placed *all = calloc(ALL, sizeof *all), *to = all;
    must(pbs_scene_flatten(s, &flat, &err), &err);
    for (size_t d = 0; d < flat.count; d++) {
        const pbs_mesh *m = flat.draws[d].mesh;
        for (uint32_t t = 0; t < m->triangles; t++, to++) {
            to->material = material_of(m, t);
            for (int i = 0; i < 3; i++) {
                const float *q = m->position + 3 * (size_t)m->index[3 * t + (uint32_t)i];
                double p[3] = {q[0], q[1], q[2]};
                /* in the frame that pbs_scene_flatten chose */
                pbs_xform_point(to->p[i], flat.draws[d].m, p);
            }
        }
    }
    CHECK(to == all + ALL);
    pbs_free(&run, flat.draws);
    return all;
}

/* ---- streams that could have been made from it ---- */

static void to_file(const char *path, blob b) {
    FILE *f = fopen(path, "wb");
    if (!f || fwrite(b.bytes, 1, b.size, f) != b.size || fclose(f)) abort();
    free(b.bytes);
}

static void scene_to_file(const pbs_scene *s, const char *path) {
    pbs_writer *w = spool_writer(&run, PBS_SCENE, NULL, 0);
    const pbs_chunk *e;
    size_t n;
    must(pbs_reader_directory(s->reader, &e, &n, &err), &err);
    for (size_t i = 0; i < n; i++) {
        pbs_chunk c;
        must(pbs_reader_at(s->reader, &e[i], &c, &err), &err);
        must(pbs_writer_pass(w, &c, &err), &err);
    }
    to_file(path, take_bytes(w));
}

/* Node 0 has surfels, and an origin of its own; the others have none. change: it is another one. */
static void surfels_to_file(const pbs_scene *s, const char *path, bool change) {
    pbs_record r = pbs_record_make(PBS_POSITION | PBS_SPACING | PBS_NORMAL, false);
    char text[256];
    pbs_points points;
    pbs_record_text(&r, text);
    pbs_writer *w = spool_writer(&run, PBS_SURFELS, text, 0);
    fill_points(&run, r.channels, 10, 5, &points);
    for (uint32_t i = 0; i < s->node_count; i++) {
        pbs_node n = s->nodes[i];
        n.records = i ? 0 : 10;
        n.triangles += change && i == 1;
        for (int k = 0; k < 3; k++) n.origin[k] = i ? 0 : n.origin[k] + 0.125;
        if (!i) must(pbs_points_write(&run, w, &r, i, &points, 0, 4, NULL, &err), &err);
        must(pbs_node_write(&run, w, &n, &err), &err);
    }
    pbs_points_free(&run, &points);
    to_file(path, take_bytes(w));
}

/* A cube of 2^3 chunks of cells around the scene, of which those with a bit in `missing` are not
 * there; a voxel in each. MATL: the scene's. */
static const pbs_grid grid = {{-40, -40, -40}, 80 / 512.0, 512};
static void voxels_to_file(const pbs_scene *s, const char *path, unsigned missing) {
    char text[256];
    pbs_child child[8] = {0};
    pbs_voxels v;
    pbs_node root = {.name = "voxels", .box = PBS_BOX_EMPTY, .children = child};
    pbs_voxels_text(PBS_POSITION | PBS_WEIGHT, text);
    must(pbs_voxels_alloc(&run, PBS_POSITION | PBS_WEIGHT, 1, &v, &err), &err);
    v.place[0] = 63u << 24, v.weight[0] = 1;
    pbs_writer *w = spool_writer(&run, PBS_VOXELS, text, 0);
    must(pbs_scene_copy_materials(s, w, &err), &err);
    for (uint32_t i = 0; i < 8; i++) {
        static const uint8_t cell[3] = {0};
        pbs_voxel_place at = {0, 1, 512, {i & 1, i >> 1 & 1, i >> 2}};
        if (missing >> i & 1) continue;
        pbs_child *c = &child[root.child_count];
        *c = (pbs_child){.node = root.child_count};
        memcpy(c->m, PBS_IDENTITY, sizeof c->m);
        pbs_node n = pbs_voxel_node(&grid, &at, root.child_count++, 1, cell, cell);
        pbs_box_add(&root.box, n.box.min), pbs_box_add(&root.box, n.box.max);
        must(pbs_voxels_write(w, n.id, &at, &v, 0, &err), &err);
        must(pbs_node_write(&run, w, &n, &err), &err);
    }
    root.id = root.child_count;
    root.triangles = ALL;
    must(pbs_node_write(&run, w, &root, &err), &err);
    pbs_voxels_free(&run, &v);
    to_file(path, take_bytes(w));
}

/* ---- the archive ---- */

static pbs_code pack(const char *const *paths, size_t n, const char *to, pbs_pack_stats *stats) {
    pbs_pack *p;
    pbs_code rc = pbs_pack_new(&run, &p, &err);
    for (size_t i = 0; i < n && !rc; i++) rc = pbs_pack_add(p, paths[i], &err);
    if (!rc) rc = pbs_pack_write(p, &(pbs_writer_desc){.path = to, .stage = "test"}, stats, &err);
    pbs_pack_free(p);
    if (rc) printf("# %s\n", err.text);
    return rc;
}

typedef struct archive {
    pbs_reader *r;
    const pbs_chunk *e;
    size_t count, nodes;
    pbs_node *node;
} archive;

static int rank_of(uint32_t tag) {
    return tag == PBS_TAG_NODE                               ? 0
           : tag == PBS_TAG_MATERIAL                         ? 1
           : tag == PBS_TAG_POINTS || tag == PBS_TAG_OCTAVES ? 2
           : tag == PBS_TAG_VOXELS || tag == PBS_TAG_FACES   ? 3
           : tag == PBS_TAG_MESH                             ? 4
           : tag == PBS_TAG_TEXTURE                          ? 5
                                                             : 6;
}

/* Verified, and with its chunks in order. */
static archive open_archive(const char *path) {
    archive a = {0};
    pbs_input in;
    pbs_checked found;
    must(pbs_input_open(&run, path, &in, &err), &err);
    must(pbs_check_file(&run, &in, &found, &err), &err);
    must(pbs_reader_open_path(&run, path, PBS_KIND(PBS_ARCHIVE), &a.r, &err), &err);
    must(pbs_reader_directory(a.r, &a.e, &a.count, &err), &err);
    a.node = calloc(a.count, sizeof *a.node);
    for (size_t i = 0; i < a.count; i++) {
        pbs_chunk c;
        CHECK(!i || rank_of(a.e[i].tag) >= rank_of(a.e[i - 1].tag));
        if (a.e[i].tag != PBS_TAG_NODE) continue;
        must(pbs_reader_at(a.r, &a.e[i], &c, &err), &err);
        must(pbs_node_read(&run, path, &c, (uint32_t)a.nodes, &a.node[a.nodes], &err), &err);
        a.nodes++;
    }
    return a;
}

static void close_archive(archive *a) {
    for (size_t i = 0; i < a->nodes; i++) pbs_node_free(&run, &a->node[i]);
    free(a->node);
    pbs_reader_close(a->r);
}

/* The name of a material, and in *picture the bytes of its texture or "". */
static const char *look_of(const archive *a, uint32_t material, char picture[32]) {
    static char name[64];
    uint32_t texture = PBS_NONE;
    *name = *picture = 0;
    for (int pass = 0; pass < 2; pass++)
        for (size_t i = 0; i < a->count; i++) {
            pbs_chunk c;
            pbs_material m;
            bool here = pass ? a->e[i].tag == PBS_TAG_TEXTURE && a->e[i].node == texture
                             : a->e[i].tag == PBS_TAG_MATERIAL && a->e[i].node == material;
            if (!here) continue;
            must(pbs_reader_at(a->r, &a->e[i], &c, &err), &err);
            const char *bytes = c.payload;
            if (pass) {
                snprintf(picture, 32, "%.*s", (int)c.bytes - 8 - 5, bytes + 8 + 5); /* "0.png" */
                continue;
            }
            CHECK(pbs_material_parse(&c, PBS_NONE, &m));
            texture = m.base_texture.texture;
            snprintf(name, sizeof name, "%.*s", (int)c.bytes - 144, bytes + 144);
        }
    return name;
}

/* A triangle at those corners, up to which is the first. */
static bool is_at(const placed *t, const double p[3][3], const double frame[3], double most) {
    for (int turn = 0; turn < 3; turn++) {
        double far = 0;
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                far = fmax(far, fabs(t->p[(i + turn) % 3][k] + frame[k] - p[i][k]));
        if (far <= most) return true;
    }
    return false;
}

/* Finds the archive's triangles of a node, placed by m, among those of the scene. turned: corners
 * of mirrored placings go the other way round there. Returns how many. */
static uint64_t find_triangles(const archive *a, uint32_t node, const double m[12], placed *all,
                               const double frame[3], bool turned) {
    uint64_t count = 0;
    for (size_t i = 0; i < a->count; i++) {
        pbs_chunk c;
        pbs_mesh mesh;
        if (a->e[i].tag != PBS_TAG_MESH || a->e[i].node != node) continue;
        must(pbs_reader_at(a->r, &a->e[i], &c, &err), &err);
        must(pbs_mesh_parse("a", &c, &mesh, &err), &err);
        CHECK(mesh.normal && mesh.uv);
        for (uint32_t t = 0; t < mesh.triangles; t++, count++) {
            double p[3][3], q[3][3];
            for (int v = 0; v < 3; v++) {
                const float *f = mesh.position + 3 * (size_t)mesh.index[3 * t + (uint32_t)v];
                double x[3];
                for (int k = 0; k < 3; k++) x[k] = a->node[node].origin[k] + f[k];
                pbs_xform_point(p[v], m, x);
            }
            memcpy(q, p, sizeof q);
            memcpy(q[1], p[2], sizeof q[1]), memcpy(q[2], p[1], sizeof q[2]);
            int found = 0;
            for (int k = 0; k < ALL; k++) {
                bool there = is_at(&all[k], (const double(*)[3])p, frame, 2e-4) ||
                             (turned && is_at(&all[k], (const double(*)[3])q, frame, 2e-4));
                if (!there || all[k].material != material_of(&mesh, t)) continue;
                all[k].seen++;
                found++;
            }
            CHECK_NUM(found == 1, found);
        }
    }
    return count;
}

/* All placings below a node. */
static uint64_t find_below(const archive *a, uint32_t node, const double m[12], placed *all,
                           const double frame[3]) {
    uint64_t n = find_triangles(a, node, m, all, frame, false);
    for (uint32_t i = 0; i < a->node[node].child_count; i++) {
        double t[12];
        pbs_xform_mul(t, m, a->node[node].children[i].m);
        n += find_below(a, a->node[node].children[i].node, t, all, frame);
    }
    return n;
}

static void frame_of(const pbs_scene *s, double frame[3]) {
    pbs_flat flat;
    must(pbs_scene_flatten(s, &flat, &err), &err);
    memcpy(frame, flat.origin, sizeof flat.origin);
    pbs_free(&run, flat.draws);
}

/* ---- tests ---- */

TEST(meshes_are_at_the_nodes_of_surfels) {
    for (int change = 0; change < 2; change++) {
        pbs_scene s = make_scene(1);
        pbs_pack_stats stats;
        double frame[3];
        frame_of(&s, frame);
        scene_to_file(&s, "a.scene");
        surfels_to_file(&s, "a.surf", change);
        CHECK(!pack((const char *const[]){"a.scene", "a.surf"}, 2, "a.pbs", &stats));
        archive a = open_archive("a.pbs");
        /* Made from another scene: two children of a root. */
        CHECK_NUM(stats.matched == !change, stats.matched);
        CHECK_NUM(a.nodes == (change ? 2 * s.node_count + 1 : s.node_count), a.nodes);
        placed *all = place_all(&s);
        uint32_t root = (uint32_t)a.nodes - 1;
        CHECK(find_below(&a, root, PBS_IDENTITY, all, frame) == ALL);
        for (int i = 0; i < ALL; i++) CHECK_NUM(all[i].seen == 1, i);
        free(all);
        close_archive(&a);
        pbs_scene_close(&s);
    }
    CHECK_NUM(!run.mem_used, run.mem_used);
}

/* Does a triangle have a point in the chunk? Looks at many of them. */
static bool is_in(const placed *t, const double frame[3], const double low[3], double side) {
    enum { STEPS = 60 };
    for (int i = 0; i <= STEPS; i++)
        for (int j = 0; i + j <= STEPS; j++) {
            bool in = true;
            for (int k = 0; k < 3; k++) {
                double v =
                    frame[k] +
                    (t->p[0][k] * i + t->p[1][k] * j + t->p[2][k] * (STEPS - i - j)) / STEPS -
                    low[k];
                in = in && v >= 0 && v <= side;
            }
            if (in) return true;
        }
    return false;
}

TEST(meshes_are_at_the_nodes_of_voxels) {
    for (unsigned missing = 0; missing < 256; missing = missing ? 256 : 0x80) {
        pbs_scene s = make_scene(1);
        pbs_pack_stats stats;
        double frame[3], side = grid.voxel * PBS_CHUNK;
        frame_of(&s, frame);
        scene_to_file(&s, "a.scene");
        voxels_to_file(&s, "a.vox", missing);
        CHECK(!pack((const char *const[]){"a.vox", "a.scene"}, 2, "a.pbs", &stats));
        archive a = open_archive("a.pbs");
        CHECK(stats.matched == 1 && a.nodes == 9 - (missing != 0));
        placed *all = place_all(&s);
        uint64_t stored = 0;
        for (uint32_t n = 0; n + 1 < a.nodes; n++) {
            for (int i = 0; i < ALL; i++) all[i].seen = 0;
            stored += find_triangles(&a, n, PBS_IDENTITY, all, frame, true);
            for (int i = 0; i < ALL; i++)
                if (is_in(&all[i], frame, a.node[n].origin, side))
                    CHECK_NUM(all[i].seen == 1, i);
                else /* at most in the layer of a cell around it */
                    for (int k = 0; k < 3 && all[i].seen; k++) {
                        double low = fmin(all[i].p[0][k], fmin(all[i].p[1][k], all[i].p[2][k]));
                        double high = fmax(all[i].p[0][k], fmax(all[i].p[1][k], all[i].p[2][k]));
                        low += frame[k] - a.node[n].origin[k];
                        high += frame[k] - a.node[n].origin[k];
                        CHECK(low <= side + 1.001 * grid.voxel && high >= -1.001 * grid.voxel);
                    }
        }
        CHECK_NUM(stored == stats.triangles && stored >= (missing ? 1 : ALL), stored);
        /* What is in the missing chunk alone is in none, and said. */
        uint64_t homeless = 0;
        for (int i = 0; i < ALL && missing; i++) {
            bool any = false;
            for (uint32_t n = 0; n + 1 < a.nodes && !any; n++) {
                double low[3];
                for (int k = 0; k < 3; k++) low[k] = a.node[n].origin[k] - grid.voxel;
                any = is_in(&all[i], frame, low, side + 2 * grid.voxel);
            }
            homeless += !any;
        }
        CHECK_NUM(stats.homeless == homeless, stats.homeless);
        CHECK(!missing || homeless);
        free(all);
        close_archive(&a);
        pbs_scene_close(&s);
    }
    CHECK_NUM(!run.mem_used, run.mem_used);
}

/* Two scenes that share a picture, and voxels of the first, whose materials are its. */
TEST(materials_and_pictures_are_the_same_ones) {
    static const char *const names[] = {"red", "green", "blue"};
    pbs_scene s = make_scene(1), other = make_scene(2);
    pbs_pack_stats stats;
    char picture[32];
    scene_to_file(&s, "a.scene");
    scene_to_file(&other, "b.scene");
    voxels_to_file(&other, "b.vox", 0);
    voxels_to_file(&s, "a.vox", 0);
    CHECK(!pack((const char *const[]){"a.vox", "b.scene", "a.scene"}, 3, "a.pbs", &stats));
    archive a = open_archive("a.pbs");
    uint32_t materials = 0, textures = 0;
    for (size_t i = 0; i < a.count; i++) {
        materials += a.e[i].tag == PBS_TAG_MATERIAL;
        textures += a.e[i].tag == PBS_TAG_TEXTURE;
    }
    /* red and blue, and picture 0, are shared; green has another picture in each scene. What is
     * unseen has lost its picture, and is shared, too. */
    CHECK_NUM(textures == 3, textures);
    CHECK_NUM(materials == 5, materials);
    int unseen = 0;
    for (uint32_t i = 0; i < materials; i++)
        if (!strncmp(look_of(&a, i, picture), "unseen", 6)) unseen += !*picture;
    CHECK_NUM(unseen == 1, unseen);
    for (size_t i = 0; i < a.count; i++) {
        pbs_chunk c;
        pbs_mesh mesh;
        if (a.e[i].tag != PBS_TAG_MESH) continue;
        must(pbs_reader_at(a.r, &a.e[i], &c, &err), &err);
        must(pbs_mesh_parse("a", &c, &mesh, &err), &err);
        /* b.scene is the first that the voxels may be from */
        bool first = c.node < 9;
        for (uint32_t t = 0; t < mesh.triangles; t++) {
            const char *name = look_of(&a, material_of(&mesh, t), picture);
            if (!strcmp(name, names[0])) CHECK(!strcmp(picture, "picture 0"));
            if (!strcmp(name, names[1])) CHECK(!strcmp(picture, first ? "picture 2" : "picture 1"));
            if (!strcmp(name, names[2])) CHECK(!*picture);
        }
    }
    close_archive(&a);
    pbs_scene_close(&s);
    pbs_scene_close(&other);
}

/* Materials whose pictures are not here name none. */
TEST(no_picture_is_named_that_is_not_there) {
    pbs_scene s = make_scene(1);
    pbs_pack_stats stats;
    char picture[32];
    voxels_to_file(&s, "a.vox", 0);
    CHECK(!pack((const char *const[]){"a.vox"}, 1, "a.pbs", &stats));
    archive a = open_archive("a.pbs");
    for (uint32_t i = 0; i < 3; i++) {
        CHECK(*look_of(&a, i, picture));
        CHECK(!*picture);
    }
    close_archive(&a);
    pbs_scene_close(&s);
}

TEST(what_is_equal_is_stored_once) {
    pbs_scene s = make_scene(1);
    pbs_pack_stats once, twice, changed;
    scene_to_file(&s, "a.scene");
    surfels_to_file(&s, "a.surf", false);
    surfels_to_file(&s, "b.surf", true);
    CHECK(!pack((const char *const[]){"a.surf"}, 1, "a.pbs", &once));
    CHECK(!pack((const char *const[]){"a.surf", "a.surf"}, 2, "a.pbs", &twice));
    CHECK(twice.nodes == once.nodes + 1 && twice.same == once.nodes && twice.surfels == 10);
    archive a = open_archive("a.pbs");
    const pbs_node *root = &a.node[a.nodes - 1];
    CHECK(root->child_count == 2 && root->children[0].node == root->children[1].node);
    CHECK(root->triangles == 2 * (uint64_t)ALL);
    close_archive(&a);
    /* Node 1 says something else: it, and what places it, are others; node 0 is not. */
    CHECK(!pack((const char *const[]){"a.surf", "b.surf"}, 2, "a.pbs", &changed));
    CHECK_NUM(changed.surfels == 10, changed.surfels);
    CHECK_NUM(changed.same == 2, changed.same); /* and the inner assembly of it */
    CHECK(!pack((const char *const[]){"a.scene", "a.scene"}, 2, "a.pbs", &twice));
    CHECK(twice.nodes == s.node_count + 1 && twice.triangles == SMALL + LARGE);
    pbs_scene_close(&s);
}

TEST(clouds_beside_surfels_have_no_normals) {
    pbs_scene s = make_scene(1);
    pbs_pack_stats stats;
    FILE *f = fopen("c.xyz", "w");
    for (int i = 0; i < 500; i++) fprintf(f, "%d %d 0 %d 7 9\n", i % 20, i / 20, i % 256);
    fclose(f);
    surfels_to_file(&s, "a.surf", false);
    CHECK(!pack((const char *const[]){"c.xyz", "a.surf", "c.xyz"}, 3, "a.pbs", &stats));
    CHECK(stats.cloud.points == 1000 && stats.record.stride == 16);
    archive a = open_archive("a.pbs");
    uint64_t none = 0, some = 0;
    for (size_t i = 0; i < a.count; i++) {
        pbs_chunk c;
        if (a.e[i].tag != PBS_TAG_POINTS) continue;
        must(pbs_reader_at(a.r, &a.e[i], &c, &err), &err);
        bool cloud = a.node[c.node].flags & PBS_NODE_ADDS;
        for (uint32_t k = 0; k < c.count; k++) {
            const uint8_t *at = (const uint8_t *)c.payload + 16 * (size_t)k;
            int16_t normal[2];
            memcpy(normal, at + 8, 4);
            bool is_none = normal[0] == PBS_NO_NORMAL && normal[1] == PBS_NO_NORMAL;
            CHECK(is_none == cloud);
            CHECK(cloud ? at[13] == 7 : at[13] == 255);
            none += is_none, some += !is_none;
        }
    }
    CHECK(none == 1000 && some == 10);
    const pbs_node *root = &a.node[a.nodes - 1];
    CHECK(root->child_count == 2 && root->children[0].node + 1 + s.node_count == a.nodes - 1);
    close_archive(&a);
    pbs_scene_close(&s);
    CHECK_NUM(!run.mem_used, run.mem_used);
}

TEST_MAIN
