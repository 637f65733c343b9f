/* What is in the chunks: records, nodes, the hierarchy, archives, meshes and scenes. Everything
 * comes back as it was written, and hostile contents are refused in words. */
#include "formats/archive.h"
#include "formats/dag.h"
#include "formats/meshbuild.h"
#include "tests/unit/support.h"
#include "tests/check.h"

static pbs_run run = {.threads = 1};
static pbs_err err;

enum { OPTIONAL = 5, SUBSETS = 1 << OPTIONAL };
/* Subset i of the optional channels, and the position. */
static uint32_t subset(int i) {
    return PBS_POSITION | (uint32_t)i << 1;
}

/* ---- records ---- */

TEST(record_of_every_subset) {
    static const uint32_t order[] = {PBS_POSITION, PBS_SPACING,  PBS_NORMAL,
                                     PBS_COLOUR,   PBS_MATERIAL, PBS_EMISSIVE};
    for (int packed = 0; packed < 2; packed++)
        for (int i = 0; i < SUBSETS; i++) {
            if (packed && !(i & 1)) continue;
            pbs_record r = pbs_record_make(subset(i), packed), back;
            int at = 0;
            for (int k = 0; k < 6; k++) { /* no gaps, in order */
                bool has = subset(i) & order[k];
                CHECK(pbs_record_at(&r, order[k]) == (has ? at : -1));
                if (has) at += k == 0 ? (packed ? 6 : 12) : k == 1 && packed ? 2 : 4;
            }
            CHECK_NUM((uint32_t)at == r.stride && r.stride % 4 == 0, r.stride);
            char text[256];
            pbs_record_text(&r, text);
            CHECK(!pbs_record_parse("f", text, &back, &err));
            CHECK(back.channels == r.channels && back.packed == r.packed &&
                  back.stride == r.stride);
        }
}

TEST(record_text_is_canonical) {
    static const char *const bad[] = {"",
                                      "normal:i16x2",
                                      "position:f32x3 ",
                                      " position:f32x3",
                                      "position:f32x3 colour:u8x4 normal:i16x2",
                                      "position:f64x3",
                                      "position:f32x3 position:f32x3",
                                      "position:f32x3 heat:f32",
                                      "position:u16x3",
                                      "position:u16x3 normal:i16x2",
                                      "position:u16x3 spacing:f32",
                                      "position:f32x3 spacing:f16",
                                      "position:f32x3,normal:i16x2",
                                      "position:f32x3 normal:i16x2x"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        pbs_record r;
        CHECK(pbs_record_parse("f", bad[i], &r, &err) == PBS_DATA);
        CHECK(!strncmp(err.text, "f: channels that this program does not know: ", 44));
    }
}

/* Writes p in chunks of `limit` and reads it again from the container. */
static void through_file(const pbs_record *r, const pbs_points *p, uint32_t limit,
                         const pbs_lattice *l, bool piped, pbs_points *out) {
    char text[256];
    pbs_record_text(r, text);
    pbs_writer *w = spool_writer(&run, PBS_SURFELS, text, 0);
    must(pbs_points_write(&run, w, r, 0, p, 0, limit, l, &err), &err);
    blob b = take_bytes(w);
    pbs_input in;
    pbs_reader *reader;
    open_blob(&run, b, piped, &in);
    must(pbs_reader_open(&run, &in, PBS_KIND(PBS_SURFELS), &reader, &err), &err);
    must(pbs_points_alloc(&run, r->channels, p->count, out, &err), &err);
    out->count = 0;
    uint64_t chunks = 0;
    for (bool end = false; !end; chunks++) {
        pbs_chunk c;
        must(pbs_reader_next(reader, &c, &end, &err), &err);
        if (!end) must(pbs_points_read("f", r, &c, out, l, &err), &err);
    }
    CHECK(chunks - 1 == pbs_points_chunks(p->count, limit) && out->count == p->count);
    pbs_reader_close(reader);
    free(b.bytes);
}

static bool same(const void *a, const void *b, size_t n) {
    return !a == !b && (!a || !memcmp(a, b, n));
}

static bool same_attributes(const pbs_points *a, const pbs_points *b) {
    size_t n = 4 * a->count;
    return same(a->normal, b->normal, n) && same(a->colour, b->colour, n) &&
           same(a->material, b->material, n) && same(a->emissive, b->emissive, n);
}

TEST(points_of_every_subset) {
    for (int i = 0; i < SUBSETS; i++) {
        pbs_points p, back;
        pbs_record r = pbs_record_make(subset(i), false);
        fill_points(&run, subset(i), 100, (uint64_t)i, &p);
        through_file(&r, &p, i % 2 ? 33 : 100, NULL, i & 2, &back);
        CHECK(same(p.position, back.position, 1200) && same(p.spacing, back.spacing, 400));
        CHECK(same_attributes(&p, &back));
        pbs_points_free(&run, &p);
        pbs_points_free(&run, &back);
    }
    CHECK(pbs_mem_used(&run) == 0);
}

static void check_packed(const pbs_points *p, const pbs_points *back, const pbs_lattice *l) {
    double place = 0, gap = 0, side = 65535 * l->step;
    for (size_t k = 0; k < 3 * p->count; k++)
        place = fmax(place, fabs((double)p->position[k] - back->position[k]));
    for (size_t k = 0; k < p->count; k++) {
        double bound = fmax(p->spacing[k] * ldexp(1, -11), side * ldexp(1, -25));
        gap = fmax(gap, fabs((double)p->spacing[k] - back->spacing[k]) / bound);
    }
    CHECK_NUM(place <= l->step / 2 * (1 + 1e-3), place / l->step); /* and a float's rounding */
    CHECK_NUM(gap <= 1 + 1e-3, gap);
}

TEST(packed_points_within_the_bound) {
    for (int i = 1; i < SUBSETS; i += 2) {
        pbs_points p, back;
        pbs_record r = pbs_record_make(subset(i), true);
        fill_points(&run, subset(i), 100, (uint64_t)i, &p);
        pbs_lattice l = pbs_lattice_of(p.position, p.count);
        for (int k = 0; k < 300; k++) p.spacing[k % 100] *= k > 60 && k < 80 ? 1e-4f : 1;
        through_file(&r, &p, 7, &l, i & 2, &back);
        CHECK(same_attributes(&p, &back));
        check_packed(&p, &back, &l);
        pbs_points_free(&run, &p);
        pbs_points_free(&run, &back);
    }
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(points_that_do_not_fit) {
    pbs_record r = pbs_record_make(PBS_POSITION, false);
    pbs_points p;
    must(pbs_points_alloc(&run, PBS_POSITION, 4, &p, &err), &err);
    float bytes[12] = {0};
    pbs_chunk c = {.tag = PBS_TAG_POINTS, .count = 4, .bytes = 48, .first = 4, .payload = bytes};
    p.count = 0;
    CHECK(pbs_points_read("f", &r, &c, &p, NULL, &err) == PBS_DATA && p.count == 0);
    c.first = 0, c.bytes = 47;
    CHECK(pbs_points_read("f", &r, &c, &p, NULL, &err) == PBS_DATA && p.count == 0);
    c.bytes = 48, c.count = 0x40000004; /* 48 bytes in 32 bits */
    CHECK(pbs_points_read("f", &r, &c, &p, NULL, &err) == PBS_DATA && p.count == 0);
    c.count = 4;
    CHECK(pbs_points_read("f", &r, &c, &p, NULL, &err) == PBS_OK && p.count == 4);
    pbs_points_free(&run, &p);
}

TEST(points_grow) {
    pbs_points p = {0};
    size_t cap = 0;
    for (uint32_t i = 0; i < 3000; i++) {
        must(pbs_points_grow(&run, PBS_POSITION | PBS_COLOUR, &p, &cap, i + 1, &err), &err);
        p.position[3 * i] = (float)i;
        memcpy(p.colour + 4 * i, &i, 4);
    }
    bool kept = !p.normal && !p.spacing;
    for (uint32_t i = 0; i < 3000; i++)
        kept = kept && p.position[3 * i] == (float)i && !memcmp(p.colour + 4 * i, &i, 4);
    CHECK(kept);
    pbs_points_free(&run, &p);
    pbs_run small = {.threads = 1, .mem_limit = 2000};
    CHECK(pbs_points_alloc(&small, subset(31), 1000, &p, &err) == PBS_LIMIT && !p.position);
    CHECK(pbs_mem_used(&small) == 0 && pbs_mem_used(&run) == 0);
}

/* ---- nodes ---- */

/* The payload of a node's chunk, in malloc'ed memory of just that size. */
static pbs_chunk node_chunk(const pbs_node *n) {
    pbs_writer *w = spool_writer(&run, PBS_SURFELS, "position:f32x3", 0);
    must(pbs_node_write(w, n, &err), &err);
    blob b = take_bytes(w);
    const uint8_t *h = b.bytes + pbs_get_u32(b.bytes + HEADER_BYTES_AT);
    pbs_chunk c = {
        .tag = PBS_TAG_NODE, .node = n->id, .count = 1, .bytes = pbs_get_u64(h + CHUNK_BYTES_AT)};
    void *copy = malloc((size_t)c.bytes);
    memcpy(copy, h + CHUNK_FIXED, (size_t)c.bytes);
    c.payload = copy;
    free(b.bytes);
    return c;
}

static pbs_node full_node(pbs_child child[3]) {
    for (int i = 0; i < 3; i++) {
        static const char *const names[] = {"first", NULL, "a longer name, \xc3\xa9"};
        child[i] = (pbs_child){.node = (uint32_t)i * 4, .name = names[i], .flags = (uint32_t)i};
        for (int k = 0; k < 12; k++) child[i].m[k] = 1e-9 * k - i * 1e9;
    }
    return (pbs_node){.id = 9,
                      .name = "n\xc3\xb6"
                              "de",
                      .origin = {1e7, -2, 3},
                      .triangles = 1ull << 60,
                      .box = {{1, 2, 3}, {4, 5, 6}},
                      .records = 1ull << 40,
                      .pixel = 0.1,
                      .covering = 0.2,
                      .median = 0.3,
                      .median_count = 1000,
                      .lattice_min = {-1, -2, -3},
                      .lattice = 1e-5,
                      .child_count = 3,
                      .children = child};
}

TEST(node_comes_back) {
    pbs_child child[3];
    pbs_node n = full_node(child), back;
    pbs_chunk c = node_chunk(&n);
    CHECK(!pbs_node_read(&run, "f", &c, 9, &back, &err));
    CHECK(back.id == 9 && !strcmp(back.name, n.name) && !memcmp(back.origin, n.origin, 24));
    CHECK(!memcmp(&back.box, &n.box, sizeof n.box) && back.triangles == n.triangles);
    CHECK(back.records == n.records && back.pixel == n.pixel && back.covering == n.covering);
    CHECK(back.median == n.median && back.median_count == n.median_count);
    CHECK(!memcmp(back.lattice_min, n.lattice_min, 24) && back.lattice == n.lattice);
    CHECK(back.child_count == 3);
    for (int i = 0; i < 3; i++) {
        const pbs_child *a = &child[i], *b = &back.children[i];
        CHECK(a->node == b->node && a->flags == b->flags && !memcmp(a->m, b->m, sizeof a->m));
        CHECK(a->name ? !strcmp(a->name, b->name) : !b->name || !*b->name);
    }
    pbs_node_free(&run, &back);
    free((void *)c.payload);
    pbs_node empty = {.id = 0, .name = NULL, .box = PBS_BOX_EMPTY};
    c = node_chunk(&empty);
    CHECK(!pbs_node_read(&run, "f", &c, 0, &back, &err));
    CHECK(pbs_box_is_empty(&back.box) && !*back.name && !back.child_count);
    pbs_node_free(&run, &back);
    free((void *)c.payload);
    CHECK(pbs_mem_used(&run) == 0);
}

static void refuse_node(const pbs_chunk *c, uint32_t expect, const char *what) {
    pbs_node n;
    pbs_code rc = pbs_node_read(&run, "f", c, expect, &n, &err);
    if (rc != PBS_DATA || pbs_mem_used(&run))
        printf("# %s: %d\n", what, (int)rc), pbs_bad++;
    else if (strcmp(err.text, "f: node 9 is damaged"))
        printf("# %s\n", err.text), pbs_bad++;
    if (!rc) pbs_node_free(&run, &n);
}

TEST(node_of_any_length) {
    pbs_child child[3];
    pbs_node n = full_node(child);
    pbs_chunk c = node_chunk(&n), cut = c;
    for (cut.bytes = 0; cut.bytes < c.bytes; cut.bytes++) {
        void *p = malloc((size_t)cut.bytes + 1); /* exact, so that asan sees a byte too far */
        memcpy(p, c.payload, (size_t)cut.bytes);
        cut.payload = p = realloc(p, cut.bytes ? (size_t)cut.bytes : 1);
        refuse_node(&cut, 9, "cut");
        free(p);
    }
    cut.payload = calloc(1, (size_t)c.bytes + 8), cut.bytes = c.bytes + 8;
    memcpy((void *)cut.payload, c.payload, (size_t)c.bytes);
    refuse_node(&cut, 9, "longer");
    free((void *)cut.payload);
    refuse_node(&c, 8, "another id");
    cut = c, cut.payload = NULL, cut.bytes = 0;
    refuse_node(&cut, 9, "nothing");
    free((void *)c.payload);
}

TEST(node_hostile) {
    static const struct {
        size_t at;
        int what; /* 0: NaN, 1: infinity, 2: all ones, 3: id 9, 4: -1.0, 5: a zero byte */
        const char *name;
    } row[] = {
        {0, 0, "origin NaN"},         {16, 1, "origin infinite"},  {24, 0, "box NaN"},
        {64, 0, "box NaN"},           {24, 1, "box infinite"},     {64, 1, "box infinite"},
        {48, 4, "box inside out"},    {88, 0, "pixel NaN"},        {96, 1, "covering infinite"},
        {104, 0, "median NaN"},       {112, 0, "lattice NaN"},     {136, 1, "lattice infinite"},
        {136, 4, "lattice negative"}, {148, 2, "name long"},       {152, 2, "children many"},
        {168, 0, "child NaN"},        {256, 1, "child infinite"},  {264, 2, "child unknown"},
        {264, 3, "child itself"},     {272, 2, "child name long"}, {161, 5, "zero in name"}};
    pbs_child child[3];
    pbs_node n = full_node(child);
    for (size_t i = 0; i < sizeof row / sizeof row[0]; i++) {
        pbs_chunk c = node_chunk(&n);
        uint8_t *p = (uint8_t *)c.payload + row[i].at;
        switch (row[i].what) {
        case 0:
            pbs_put_f64(p, NAN);
            break;
        case 1:
            pbs_put_f64(p, INFINITY);
            break;
        case 2:
            pbs_put_u32(p, UINT32_MAX);
            break;
        case 3:
            pbs_put_u32(p, 9);
            break;
        case 4:
            pbs_put_f64(p, -1.0);
            break;
        default:
            *p = 0;
        }
        refuse_node(&c, 9, row[i].name);
        free((void *)c.payload);
    }
}

/* ---- the hierarchy ---- */

typedef struct visits {
    uint32_t seen[20000], stop_at;
    double m[20000][12];
    size_t count;
} visits;

static pbs_code visit(void *ctx, uint32_t node, const double m[12], bool *descend, pbs_err *e) {
    visits *v = ctx;
    (void)e;
    if (v->count < 20000) {
        v->seen[v->count] = node;
        memcpy(v->m[v->count], m, sizeof v->m[0]);
    }
    v->count++;
    *descend = node != v->stop_at;
    return PBS_OK;
}

static void walk_slowly(const pbs_node *nodes, uint32_t node, const double m[12], visits *v) {
    bool descend;
    visit(v, node, m, &descend, NULL);
    for (uint32_t i = 0; descend && i < nodes[node].child_count; i++) {
        double t[12];
        pbs_xform_mul(t, m, nodes[node].children[i].m);
        walk_slowly(nodes, nodes[node].children[i].node, t, v);
    }
}

TEST(walk_against_recursion) {
    static visits a, b;
    static pbs_node nodes[12];
    static pbs_child child[12][3];
    uint64_t seed = 5;
    for (int round = 0; round < 50; round++) {
        memset(nodes, 0, sizeof nodes);
        for (uint32_t i = 0; i < 12; i++) {
            nodes[i] = (pbs_node){.id = i, .children = child[i]};
            nodes[i].child_count = i ? random_bits(&seed) % 4 : 0;
            for (uint32_t k = 0; k < nodes[i].child_count; k++) {
                child[i][k].node = random_bits(&seed) % i;
                for (int j = 0; j < 12; j++) child[i][k].m[j] = random_bits(&seed) % 7 - 3.0;
            }
        }
        a.count = b.count = 0;
        a.stop_at = b.stop_at = round % 2 ? 6 : PBS_NONE;
        walk_slowly(nodes, 11, PBS_IDENTITY, &a);
        CHECK(!pbs_dag_walk(&run, nodes, 12, visit, &b, &err));
        size_t n = a.count < 20000 ? a.count : 20000;
        CHECK(a.count == b.count && !memcmp(a.seen, b.seen, n * sizeof a.seen[0]));
        CHECK(!memcmp(a.m, b.m, n * sizeof a.m[0]));
    }
}

static pbs_code count_visits(void *ctx, uint32_t node, const double m[12], bool *descend,
                             pbs_err *e) {
    (void)node, (void)m, (void)descend;
    return ++*(size_t *)ctx == 1000000 ? pbs_fail(e, PBS_CANCEL, "enough") : PBS_OK;
}

TEST(walk_deep_and_wide) {
    enum { DEEP = 100000 };
    pbs_node *nodes = calloc(DEEP, sizeof *nodes);
    pbs_child *child = calloc(2 * DEEP, sizeof *child);
    size_t count = 0;
    for (uint32_t i = 0; i < DEEP; i++) {
        nodes[i] = (pbs_node){.id = i, .child_count = i > 0, .children = &child[2 * i]};
        child[2 * i].node = child[2 * i + 1].node = i - 1;
    }
    CHECK(!pbs_dag_walk(&run, nodes, DEEP, count_visits, &count, &err) && count == DEEP);
    for (uint32_t i = 1; i < DEEP; i++) nodes[i].child_count = 2;
    count = 0; /* endless, but it stops when asked to, and needs no memory for what it has left */
    CHECK(pbs_dag_walk(&run, nodes, DEEP, count_visits, &count, &err) == PBS_CANCEL);
    CHECK(pbs_mem_used(&run) == 0);
    free(nodes), free(child);
}

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

static uint32_t add_part(const maker *m, const char *name, bool empty) {
    uint32_t node;
    const double origin[3] = {0, 0, 0};
    must(m->s->part_begin(m->s->ctx, name, origin, 0, &err), &err);
    if (!empty) put_quad(m->s, 1, PBS_NONE, PBS_NONE);
    must(m->s->part_end(m->s->ctx, &node, &err), &err);
    return node;
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
    add_part(&m, "unused", false);
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
    pbs_box box;
    pbs_writer *w;
    pbs_builder *builder;
} mesh_file;

static void begin_mesh(mesh_file *f, const double origin[3], uint32_t corners) {
    memset(f, 0, sizeof *f);
    f->w = spool_writer(&run, PBS_SCENE, NULL, 0);
    must(pbs_builder_new(&run, f->w, &f->builder, &err), &err);
    pbs_builder_begin(f->builder, 3, origin, corners);
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

/* ---- archives ---- */

static pbs_code open_archive_blob(blob b, pbs_archive *a) {
    char path[40];
    int fd = memfd_create("archive", MFD_CLOEXEC);
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    if (write(fd, b.bytes, b.size) != (ssize_t)b.size) abort();
    pbs_code rc = pbs_archive_open(&run, path, a, &err);
    close(fd);
    return rc;
}

TEST(archive_comes_back) {
    for (int i = 1; i < SUBSETS; i += 2) {
        blob b = small_archive(&run, subset(i));
        pbs_archive a;
        CHECK(!open_archive_blob(b, &a));
        CHECK(a.node_count == 2 && a.nodes[1].child_count == 1 && a.record.channels == subset(i));
        for (uint32_t id = 0; id < 2; id++) {
            pbs_points p, back;
            const pbs_node *n = &a.nodes[id];
            fill_points(&run, subset(i), 4 + 2 * id, id + 9, &p);
            must(pbs_points_alloc(&run, subset(i), p.count, &back, &err), &err);
            back.count = 0;
            pbs_lattice l = {{n->lattice_min[0], n->lattice_min[1], n->lattice_min[2]}, n->lattice};
            pbs_chunk c = {.count = (uint32_t)p.count,
                           .bytes = p.count * a.record.stride,
                           .payload = a.records[id]};
            CHECK(n->records == p.count && !pbs_points_read("f", &a.record, &c, &back, &l, &err));
            check_packed(&p, &back, &l);
            CHECK(same_attributes(&p, &back) && !a.joined[0] && a.joined[1]);
            pbs_points_free(&run, &p);
            pbs_points_free(&run, &back);
        }
        pbs_archive_close(&a);
        free(b.bytes);
    }
    CHECK(pbs_mem_used(&run) == 0);
}

/* A reader of an archive may use all that it is given without looking twice. */
TEST(archive_hostile_bits) {
    blob b = small_archive(&run, PBS_NORMAL);
    int differ = 0;
    for (size_t bit = 8 * pbs_get_u32(b.bytes + HEADER_BYTES_AT); bit < 8 * b.size; bit += 3) {
        blob c = copy_blob(b);
        pbs_archive a;
        volatile uint8_t sum = 0;
        c.bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
        reseal(c);
        pbs_code rc = open_archive_blob(c, &a), checked = check_blob(&run, c, false, NULL);
        CHECK(rc == PBS_OK || rc == PBS_DATA);
        for (size_t i = 0; !rc && i < a.node_count; i++)
            for (uint64_t k = 0; k < a.nodes[i].records * a.record.stride; k++)
                sum += a.records[i][k];
        if (!rc) pbs_archive_close(&a);
        differ += rc == PBS_DATA && checked == PBS_OK;
        free(c.bytes);
    }
    CHECK_NUM(differ == 0, differ);
    free(b.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(archive_every_truncation) {
    blob b = small_archive(&run, PBS_NORMAL);
    for (size_t n = 0; n < b.size; n += 3) {
        pbs_archive a;
        CHECK(open_archive_blob((blob){b.bytes, n}, &a) == PBS_DATA);
    }
    free(b.bytes);
    b = small_file(&run, SMALL_SURFELS);
    pbs_archive a;
    CHECK(open_archive_blob(b, &a) == PBS_DATA);
    free(b.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST_MAIN
