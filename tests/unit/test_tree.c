/* What becomes of parts and assemblies on their way into a scene stream: split, grouped, made one
 * with equal ones. Whatever happens, every placed triangle stays where it was, under its path of
 * names; the same bytes come out for any limit of memory. */
#include "formats/scene/meshbuild.h"
#include "tests/unit/support.h"
#include "tests/check.h"

static pbs_run run = {.threads = 1};
static pbs_err err;

/* ---- a model of what the sink is told, unfolded by brute force ---- */

enum { NODES = 80, CHILDREN = 140, SHAPES = 7 };

typedef struct model_child {
    int node;
    char name[8];
    double m[12];
    uint32_t flags;
} model_child;

typedef struct model_node {
    char name[8];
    int shape; /* -1: an assembly */
    int children;
    model_child child[CHILDREN];
    uint64_t below;
} model_node;

typedef struct model {
    model_node node[NODES];
    int count;
} model;

static const uint32_t shape_size[SHAPES] = {1, 12, 200, 1500, 1500, 40, 900};

static double noise(uint64_t *seed) {
    return (double)random_bits(seed) / 0x1p32;
}

/* Triangle t of a shape: a patch of a surface for even ones, anywhere for odd ones. */
static void shape_triangle(int shape, uint32_t t, pbs_corner c[3]) {
    static const int corner[2][3][2] = {{{0, 0}, {1, 0}, {0, 1}}, {{1, 0}, {1, 1}, {0, 1}}};
    uint64_t seed = (uint64_t)shape << 32 | t;
    memset(c, 0, 3 * sizeof *c);
    for (int i = 0; i < 3; i++) {
        double x = t / 2 % 30 + corner[t % 2][i][0], y = t / 60 + corner[t % 2][i][1];
        if (shape & 1) x = 30 * noise(&seed), y = 30 * noise(&seed);
        c[i].position[0] = x / 3, c[i].position[1] = y / 7;
        c[i].position[2] = shape & 1 ? noise(&seed) : sin(x) * cos(y) + shape;
        c[i].normal[2] = shape == 4 && t % 3 ? 0 : 1;
        c[i].uv[0] = (float)x, c[i].uv[1] = (float)y;
        memset(c[i].colour, (int)(t % 251), 4);
    }
}

static uint32_t shape_material(int shape, uint32_t t) {
    return shape % 3 == 2 ? t % 2 : shape % 3 ? 0 : PBS_NONE;
}

static uint32_t shape_corners(int shape) {
    return shape == 6 ? 7 : shape == 4 ? PBS_CORNER_NORMAL : shape == 2 ? PBS_CORNER_COLOUR : 0;
}

static void random_name(char name[8], uint64_t *seed) {
    name[0] = 0;
    if (random_bits(seed) % 3) snprintf(name, 8, "n%u", random_bits(seed) % 5);
}

static void random_transform(double m[12], uint64_t *seed) {
    memcpy(m, PBS_IDENTITY, sizeof PBS_IDENTITY);
    if (random_bits(seed) % 4 == 0) m[0] = -1;
    for (int k = 0; k < 3; k++) m[4 * k + 3] = floor(200 * noise(seed));
}

static void add_child(model *md, model_node *n, int node, uint64_t *seed) {
    if (n->children == CHILDREN || n->below + md->node[node].below > 60000) return;
    model_child *c = &n->child[n->children++];
    c->node = node;
    random_name(c->name, seed);
    random_transform(c->m, seed);
    c->flags = random_bits(seed) % 16 ? 0 : PBS_CHILD_MOVES;
    n->below += md->node[node].below;
}

/* Parts of few shapes under many names, and assemblies, of which some are copies of others. */
static void random_model(model *md, uint64_t seed) {
    memset(md, 0, sizeof *md);
    for (; md->count < NODES; md->count++) {
        model_node *n = &md->node[md->count];
        bool last = md->count == NODES - 1;
        random_name(n->name, &seed);
        n->shape = -1;
        if (md->count < 20) {
            n->shape = (int)(random_bits(&seed) % SHAPES);
            n->below = shape_size[n->shape];
            continue;
        }
        const model_node *like = &md->node[random_bits(&seed) % (uint32_t)md->count];
        if (!last && random_bits(&seed) % 3 == 0 && like->shape < 0) {
            char name[8];
            memcpy(name, n->name, sizeof name);
            *n = *like;
            memcpy(n->name, name, sizeof name);
            continue;
        }
        uint32_t children = last ? CHILDREN : random_bits(&seed) % 12;
        for (uint32_t i = 0; i < children; i++)
            add_child(md, n, (int)(random_bits(&seed) % (uint32_t)(last ? 40 : md->count)), &seed);
    }
}

typedef struct sum {
    uint64_t hash, count; /* of placed triangles, in any order */
} sum;

static uint64_t mix(uint64_t h, const void *bytes, size_t n) {
    const uint8_t *p = bytes;
    for (size_t i = 0; i < n; i++) h = (h ^ p[i]) * 0x100000001b3u;
    return h ^ h >> 29;
}

static uint64_t mix_name(uint64_t path, const char *placing, const char *own) {
    const char *name = placing && *placing ? placing : own;
    return *name ? mix(mix(path, name, strlen(name)), "/", 1) : path;
}

/* position is relative to the part's origin, which all parts here share. */
static const double part_origin[3] = {5, 2, 0.5};

static void count_triangle(sum *s, uint64_t path, const double m[12], float position[3][3],
                           const uint8_t *colour, uint32_t material) {
    uint64_t h = mix(path, &material, 4);
    for (int i = 0; i < 3; i++) {
        double p[3];
        for (int k = 0; k < 3; k++) p[k] = part_origin[k] + position[i][k];
        pbs_xform_point(p, m, p);
        for (int k = 0; k < 3; k++) p[k] += 0.0;
        h = mix(h, p, sizeof p);
    }
    s->hash += colour ? mix(h, colour, 4) : h;
    s->count++;
}

static void unfold_model(const model *md, int node, uint64_t path, const double m[12], sum *s) {
    const model_node *n = &md->node[node];
    for (uint32_t t = 0; n->shape >= 0 && t < shape_size[n->shape]; t++) {
        pbs_corner c[3];
        float position[3][3];
        shape_triangle(n->shape, t, c);
        for (int i = 0; i < 9; i++)
            position[i / 3][i % 3] = (float)(c[i / 3].position[i % 3] - part_origin[i % 3]);
        bool colour = shape_corners(n->shape) & PBS_CORNER_COLOUR;
        count_triangle(s, path, m, position, colour ? c->colour : NULL,
                       shape_material(n->shape, t));
    }
    for (int i = 0; i < n->children; i++) {
        const model_child *c = &n->child[i];
        double below[12];
        pbs_xform_mul(below, m, c->m);
        uint64_t p = mix_name(path, c->name, md->node[c->node].name);
        unfold_model(md, c->node, c->flags ? mix(p, "moves", 5) : p, below, s);
    }
}

static void unfold_mesh(const pbs_mesh *mesh, uint64_t path, const double m[12], sum *s) {
    for (uint32_t t = 0; t < mesh->triangles; t++) {
        float position[3][3];
        const uint16_t *v = mesh->index + 3 * t;
        for (int i = 0; i < 3; i++) memcpy(position[i], mesh->position + 3 * v[i], 12);
        uint32_t material = mesh->triangle_material ? mesh->triangle_material[t] : mesh->material;
        count_triangle(s, path, m, position, mesh->colour ? mesh->colour + 4 * v[0] : NULL,
                       material);
    }
}

static void unfold_scene(const pbs_scene *sc, uint32_t node, uint64_t path, const double m[12],
                         sum *s) {
    const pbs_node *n = &sc->nodes[node];
    for (size_t i = sc->first_mesh[node]; i < sc->first_mesh[node + 1]; i++)
        unfold_mesh(&sc->meshes[i], path, m, s);
    for (uint32_t i = 0; i < n->child_count; i++) {
        const pbs_child *c = &n->children[i];
        double below[12];
        pbs_xform_mul(below, m, c->m);
        uint64_t p = mix_name(path, c->name, sc->nodes[c->node].name);
        unfold_scene(sc, c->node, c->flags ? mix(p, "moves", 5) : p, below, s);
    }
}

/* ---- writing it ---- */

static uint32_t put_shape(const pbs_sink *s, const char *name, int shape) {
    uint32_t node;
    must(s->part_begin(s->ctx, name, part_origin, shape_corners(shape), &err), &err);
    for (uint32_t t = 0; t < shape_size[shape]; t++) {
        pbs_corner c[3];
        shape_triangle(shape, t, c);
        must(s->triangle(s->ctx, c, shape_material(shape, t), &err), &err);
    }
    must(s->part_end(s->ctx, &node, &err), &err);
    return node;
}

static blob write_model(const model *md, const pbs_scene_options *options, size_t limit,
                        pbs_scene_totals *totals) {
    pbs_run small = {.threads = 1, .mem_limit = limit};
    pbs_writer *w = spool_writer(&small, PBS_SCENE, NULL, 0);
    pbs_scene_writer *sw;
    must(pbs_scene_writer_new(&small, w, options, &sw, &err), &err);
    const pbs_sink *s = pbs_scene_sink(sw);
    const pbs_material white = PBS_MATERIAL_DEFAULT;
    uint32_t id[NODES];
    for (int i = 0; i < 2; i++) must(s->material(s->ctx, &white, id, &err), &err);
    for (int i = 0; i < md->count; i++) {
        const model_node *n = &md->node[i];
        pbs_child child[CHILDREN];
        for (int k = 0; k < n->children; k++) {
            const model_child *c = &n->child[k];
            child[k] = (pbs_child){.node = id[c->node], .name = c->name, .flags = c->flags};
            memcpy(child[k].m, c->m, sizeof c->m);
        }
        if (n->shape >= 0)
            id[i] = put_shape(s, n->name, n->shape);
        else
            must(s->assembly(s->ctx, n->name, child, (size_t)n->children, &id[i], &err), &err);
    }
    must(s->root(s->ctx, id[md->count - 1], &err), &err);
    must(pbs_scene_writer_end(sw, &err), &err);
    if (totals) *totals = pbs_scene_writer_totals(sw);
    pbs_scene_writer_free(sw);
    blob b = take_bytes(w);
    CHECK(small.mem_used == 0);
    return b;
}

static void open_written(blob b, pbs_scene *s) {
    char path[40];
    int fd = memfd_create("scene", MFD_CLOEXEC);
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    if (write(fd, b.bytes, b.size) != (ssize_t)b.size) abort();
    must(pbs_scene_open(&run, path, NULL, s, &err), &err);
    close(fd);
}

/* ---- laws ---- */

/* The last node's own name is not in a path: no placing of it has one. */
static void check_model(const model *md, const pbs_scene_options *options) {
    sum want = {0}, got = {0};
    unfold_model(md, md->count - 1, 1, PBS_IDENTITY, &want);
    pbs_scene_totals t;
    blob b = write_model(md, options, 0, &t), little = write_model(md, options, 7 << 20, NULL);
    CHECK(b.size == little.size && !memcmp(b.bytes, little.bytes, b.size));
    free(little.bytes);
    pbs_scene s;
    open_written(b, &s);
    unfold_scene(&s, (uint32_t)s.node_count - 1, 1, PBS_IDENTITY, &got);
    CHECK_NUM(got.count == want.count && got.count == t.triangles, got.count);
    CHECK(got.hash == want.hash);
    uint32_t most = 0;
    size_t large = 0;
    for (size_t i = 0; i < s.node_count; i++) {
        most = s.nodes[i].child_count > most ? s.nodes[i].child_count : most;
        large += options->split && s.nodes[i].records > options->split;
    }
    CHECK(!options->group || options->group >= CHILDREN || (t.groups && most < CHILDREN));
    CHECK(options->group || (!t.groups && most == (uint32_t)md->node[md->count - 1].children));
    CHECK_NUM(large == 0, large);
    CHECK(!options->split == !t.parts_split);
    CHECK(t.parts_unified && t.assemblies_unified);
    pbs_scene_close(&s);
    free(b.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(every_triangle_keeps_its_place_and_path) {
    static const pbs_scene_options options[] = {
        {0}, {.split = 50}, {.group = 2}, {.split = 7, .group = 32}, {.split = 700, .group = 12}};
    static model md;
    for (int i = 0; i < 10; i++) {
        random_model(&md, 77 + (uint64_t)i);
        check_model(&md, &options[i % 5]);
    }
}

/* ---- equal nodes ---- */

typedef struct maker {
    pbs_writer *w;
    pbs_scene_writer *sw;
    const pbs_sink *s;
} maker;

static maker new_scene(const pbs_scene_options *options) {
    maker m = {.w = spool_writer(&run, PBS_SCENE, NULL, 0)};
    must(pbs_scene_writer_new(&run, m.w, options, &m.sw, &err), &err);
    m.s = pbs_scene_sink(m.sw);
    return m;
}

static pbs_scene_totals end_scene(maker *m, uint32_t root, pbs_scene *s) {
    must(m->s->root(m->s->ctx, root, &err), &err);
    must(pbs_scene_writer_end(m->sw, &err), &err);
    pbs_scene_totals t = pbs_scene_writer_totals(m->sw);
    pbs_scene_writer_free(m->sw);
    blob b = take_bytes(m->w);
    open_written(b, s);
    free(b.bytes);
    return t;
}

static uint32_t put_pair(const maker *m, const char *name, uint32_t a, uint32_t b, double move) {
    pbs_child c[2] = {{.node = a}, {.node = b}};
    uint32_t node;
    memcpy(c[0].m, PBS_IDENTITY, sizeof c[0].m), memcpy(c[1].m, PBS_IDENTITY, sizeof c[1].m);
    c[1].m[3] = move;
    must(m->s->assembly(m->s->ctx, name, c, 2, &node, &err), &err);
    return node;
}

static uint32_t put_sized(const maker *m, const char *name, double size, double origin,
                          uint32_t corners) {
    const double at[3] = {origin, 0, 0};
    uint32_t node;
    must(m->s->part_begin(m->s->ctx, name, at, corners, &err), &err);
    put_quad(m->s, size, PBS_NONE, PBS_NONE);
    must(m->s->part_end(m->s->ctx, &node, &err), &err);
    return node;
}

TEST(equal_parts_and_what_differs) {
    maker m = new_scene(NULL);
    uint32_t a = put_sized(&m, "bolt", 1, 0, 0);
    CHECK(put_sized(&m, "bolt", 1, 0, 0) == a);
    uint32_t renamed = put_sized(&m, "screw", 1, 0, 0), none = put_sized(&m, "", 1, 0, 0);
    uint32_t different[] = {put_sized(&m, "bolt", 2, 0, 0), put_sized(&m, "bolt", 1, 8, 0),
                            put_sized(&m, "bolt", 1, 0, PBS_CORNER_UV),
                            put_sized(&m, "bolt", 1, 0, PBS_CORNER_NORMAL)};
    for (int i = 0; i < 4; i++) CHECK(different[i] != a && different[i] != renamed);
    CHECK(none != a && none != renamed && renamed != a);
    uint32_t p = put_pair(&m, "p", a, renamed, 3), q = put_pair(&m, "q", a, renamed, 3);
    CHECK(put_pair(&m, "p", a, renamed, 3) == p && put_pair(&m, "p", a, a, 3) != p &&
          put_pair(&m, "p", a, renamed, -3) != p);
    uint32_t still, moving;
    pbs_child c = {.node = a};
    memcpy(c.m, PBS_IDENTITY, sizeof c.m);
    must(m.s->assembly(m.s->ctx, "one", &c, 1, &still, &err), &err);
    c.flags = PBS_CHILD_MOVES;
    must(m.s->assembly(m.s->ctx, "one", &c, 1, &moving, &err), &err);
    CHECK(still != moving);
    uint32_t both = put_pair(&m, "all", p, q, 50);
    pbs_scene s;
    pbs_scene_totals t = end_scene(&m, put_pair(&m, "top", both, none, 0), &s);
    CHECK(t.parts_unified == 2 && t.assemblies_unified == 2);
    const pbs_node *n = &s.nodes[both];
    CHECK(n->child_count == 2 && n->children[0].node == n->children[1].node);
    CHECK(!n->children[0].name && !strcmp(n->children[1].name, "q"));
    n = &s.nodes[n->children[0].node];
    CHECK(!strcmp(n->name, "p") && n->children[0].node == n->children[1].node);
    CHECK(!n->children[0].name && !strcmp(n->children[1].name, "screw"));
    pbs_scene_close(&s);
    CHECK(pbs_mem_used(&run) == 0);
}

/* The root is the last node, even if it equals an inner one or goes by another name. */
TEST(root_that_equals_another) {
    for (int renamed = 0; renamed < 2; renamed++) {
        maker m = new_scene(NULL);
        uint32_t a = put_sized(&m, "a", 1, 0, 0);
        uint32_t p = put_pair(&m, "p", a, a, 3);
        if (!renamed) put_pair(&m, "other", p, a, 1);
        pbs_scene s;
        end_scene(&m, put_pair(&m, renamed ? "root" : "p", a, a, 3), &s);
        const pbs_node *n = &s.nodes[s.node_count - 1];
        CHECK(n->child_count == 1 && n->children[0].node == p && n->triangles == 4);
        CHECK(!renamed == !n->children[0].name);
        pbs_scene_close(&s);
    }
    CHECK(pbs_mem_used(&run) == 0);
}

/* ---- splitting ---- */

static void cloud_triangle(uint32_t i, void (*middle)(uint32_t i, double p[3]), pbs_corner c[3]) {
    double p[3], size = 1 + i % 100;
    memset(c, 0, 3 * sizeof *c);
    middle(i, p);
    for (int k = 0; k < 3; k++) {
        memcpy(c[k].position, p, sizeof p);
        c[k].position[k] += size * fabs(p[0] + (p[0] == 0)), c[k].position[(k + 1) % 3] -= size;
    }
}

/* How many triangles have one middle, as they are stored. */
static uint64_t most_equal(uint32_t count, void (*middle)(uint32_t i, double p[3])) {
    double(*middles)[3] = calloc(count, sizeof *middles);
    uint64_t most = 0;
    for (uint32_t i = 0; i < count; i++) {
        pbs_corner c[3];
        uint64_t equal = 0;
        cloud_triangle(i, middle, c);
        for (int k = 0; k < 9; k++) middles[i][k % 3] += (float)c[k / 3].position[k % 3];
        for (uint32_t j = 0; j <= i; j++) equal += !memcmp(middles[i], middles[j], sizeof *middles);
        most = equal > most ? equal : most;
    }
    free(middles);
    return most;
}

static uint32_t put_cloud(const maker *m, uint32_t n, void (*middle)(uint32_t i, double p[3])) {
    uint32_t node;
    const double zero[3] = {0, 0, 0};
    must(m->s->part_begin(m->s->ctx, "cloud", zero, 0, &err), &err);
    for (uint32_t i = 0; i < n; i++) {
        pbs_corner c[3];
        cloud_triangle(i, middle, c);
        must(m->s->triangle(m->s->ctx, c, PBS_NONE, &err), &err);
    }
    must(m->s->part_end(m->s->ctx, &node, &err), &err);
    return node;
}

static void in_one_point(uint32_t i, double p[3]) {
    (void)i;
    p[0] = p[1] = p[2] = 0;
}
/* A third in one point, a third in a line of it, the others far away. */
static void uneven(uint32_t i, double p[3]) {
    p[0] = i % 3 ? 1 : 1e6 + i, p[1] = i % 3 == 1 ? 1e-3 * i : 0, p[2] = 0;
}
static void of_all_sizes(uint32_t i, double p[3]) {
    for (int k = 0; k < 3; k++) p[k] = ldexp(1 + i % 7, (int)(i * 37 % 100) - 50 + k);
}

static void check_cloud(uint32_t count, uint64_t limit, void (*middle)(uint32_t, double[3])) {
    uint64_t equal = most_equal(count, middle);
    maker m = new_scene(&(pbs_scene_options){.split = limit});
    uint32_t node = put_cloud(&m, count, middle);
    pbs_scene s;
    end_scene(&m, node, &s);
    uint64_t most = 0, all = 0, used = 0;
    for (size_t i = 0; i < s.node_count; i++) {
        const pbs_node *n = &s.nodes[i];
        most = n->records > most ? n->records : most;
        all += n->records, used += n->child_count;
        CHECK(n->child_count != 1 && n->triangles >= n->records);
        CHECK(!n->child_count || !n->records);
    }
    CHECK_NUM(equal > limit ? most == equal : most <= limit, most);
    CHECK(all == count && s.nodes[s.node_count - 1].triangles == count);
    CHECK(used == s.node_count - 1); /* a tree */
    CHECK(!strcmp(s.nodes[s.node_count - 1].name, "cloud"));
    pbs_scene_close(&s);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(splitting_gets_on) {
    check_cloud(1000, 10, in_one_point);
    check_cloud(900, 50, uneven);
    check_cloud(3000, 1, of_all_sizes);
    check_cloud(3000, 20, of_all_sizes);
    check_cloud(10, 10, of_all_sizes);
}

enum { SIDE = 150, COUNT = 2 * SIDE * SIDE };
static const double ground_origin[3] = {1e7, 0.1, 0};

static void ground_vertex(double x, double y, double p[3]) {
    p[0] = 1e7 + x / 7, p[1] = y / 3, p[2] = sin(x * 0.1) * cos(y);
}

static blob write_ground(size_t limit) {
    pbs_scene_options options = {.split = 1000};
    run.mem_limit = limit;
    maker m = new_scene(&options);
    uint32_t node;
    must(m.s->part_begin(m.s->ctx, "ground", ground_origin, 0, &err), &err);
    for (int t = 0; t < COUNT; t++) {
        pbs_corner c[3];
        memset(c, 0, sizeof c);
        for (int i = 0; i < 3; i++) {
            double x = t / 2 % SIDE + (t % 2 ? i > 0 : i == 1);
            double y = t / 2 / SIDE + (t % 2 ? i < 2 : i == 2);
            ground_vertex(x, y, c[i].position);
        }
        must(m.s->triangle(m.s->ctx, c, PBS_NONE, &err), &err);
    }
    must(m.s->part_end(m.s->ctx, &node, &err), &err);
    must(m.s->root(m.s->ctx, node, &err), &err);
    must(pbs_scene_writer_end(m.sw, &err), &err);
    pbs_scene_writer_free(m.sw);
    run.mem_limit = 0;
    return take_bytes(m.w);
}

/* Leaves are filled, and what two of them share has the same bits: those of its place. */
TEST(leaves_of_a_surface) {
    blob b = write_ground(0);
    pbs_scene s;
    open_written(b, &s);
    size_t leaves = 0, wrong = 0;
    for (size_t i = 0; i < s.mesh_count; i++, leaves++)
        for (uint32_t v = 0; v < s.meshes[i].vertices; v++) {
            const float *p = s.meshes[i].position + 3 * v;
            double want[3];
            ground_vertex(round(p[0] * 7), round((p[1] + 0.1) * 3), want);
            for (int k = 0; k < 3; k++) wrong += p[k] != (float)(want[k] - ground_origin[k]);
        }
    CHECK_NUM(wrong == 0, wrong);
    CHECK_NUM(leaves >= COUNT / 1000 && leaves < 2.5 * COUNT / 1000, leaves);
    for (size_t i = 0; i < s.node_count; i++)
        CHECK(!memcmp(s.nodes[i].origin, ground_origin, 24) || s.nodes[i].child_count);
    pbs_scene_close(&s);
    free(b.bytes);
}

TEST(a_part_larger_than_memory) {
    blob b = write_ground(0), little = write_ground((size_t)8 << 20);
    CHECK(b.size == little.size && !memcmp(b.bytes, little.bytes, b.size));
    free(b.bytes), free(little.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

/* ---- grouping ---- */

/* A row of rows: the children that move stay children of the assembly, flags and names and all. */
TEST(what_moves_is_kept_apart) {
    enum { COUNT_OF_CHILDREN = 120 };
    maker m = new_scene(NULL);
    uint32_t part = put_shape(m.s, "part", 6), node;
    pbs_child child[COUNT_OF_CHILDREN];
    for (int i = 0; i < COUNT_OF_CHILDREN; i++) {
        child[i] = (pbs_child){.node = part, .name = i % 50 ? NULL : "mover"};
        memcpy(child[i].m, PBS_IDENTITY, sizeof child[i].m);
        child[i].m[3] = 100.0 * i;
        child[i].flags = i % 50 ? 0 : PBS_CHILD_MOVES;
    }
    must(m.s->assembly(m.s->ctx, "row", child, COUNT_OF_CHILDREN, &node, &err), &err);
    pbs_scene s;
    pbs_scene_totals t = end_scene(&m, node, &s);
    const pbs_node *n = &s.nodes[s.node_count - 1];
    int moving = 0;
    for (uint32_t i = 0; i < n->child_count; i++) {
        const pbs_child *c = &n->children[i];
        if (!(c->flags & PBS_CHILD_MOVES)) continue;
        CHECK(c->node == part && !strcmp(c->name, "mover") && c->m[3] == 5000.0 * moving);
        moving++;
    }
    CHECK(moving == 3 && !strcmp(n->name, "row") && n->triangles == 900 * COUNT_OF_CHILDREN);
    CHECK(t.groups >= 4 && t.groups == s.node_count - 2 && n->child_count < 20);
    pbs_scene_close(&s);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST_MAIN
