/* What is in the chunks: records, nodes, the hierarchy and archives. Everything
 * comes back as it was written, and hostile contents are refused in words. */
#include "formats/archive/archive.h"
#include "formats/scene/dag.h"
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

TEST(points_fit_before_room_is_made) {
    pbs_record r = pbs_record_make(PBS_POSITION | PBS_SPACING, false);
    pbs_chunk c = {.tag = PBS_TAG_POINTS, .count = 4, .first = 3, .bytes = 4 * r.stride};
    CHECK(pbs_points_fit("x", &r, &c, 3, &err) == PBS_OK);
    CHECK(pbs_points_fit("x", &r, &c, 2, &err) == PBS_DATA);
    c.count = 4000000000u; /* more than memory holds, in 64 bytes */
    CHECK(pbs_points_fit("x", &r, &c, 3, &err) == PBS_DATA);
}

TEST(points_faults) {
    static const float odd[] = {NAN, INFINITY, -INFINITY};
    pbs_points p;
    fill_points(&run, PBS_POSITION | PBS_SPACING, 5, 1, &p);
    CHECK(!pbs_points_fault(&p, 0));
    for (int i = 0; i < 3; i++) {
        float was = p.position[7];
        p.position[7] = odd[i];
        CHECK(pbs_points_fault(&p, 0) && pbs_points_fault(&p, 2) && !pbs_points_fault(&p, 3));
        p.position[7] = was;
        was = p.spacing[4];
        p.spacing[4] = odd[i];
        CHECK(pbs_points_fault(&p, 0) && pbs_points_fault(&p, 4));
        p.spacing[4] = was;
    }
    p.spacing[0] = -1;
    CHECK(pbs_points_fault(&p, 0) && !pbs_points_fault(&p, 1));
    pbs_points_free(&run, &p);
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
    must(pbs_node_write(&run, w, n, &err), &err);
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

static pbs_code visit(void *ctx, uint32_t node, const double m[12], uint32_t flags, bool *descend,
                      pbs_err *e) {
    visits *v = ctx;
    (void)e, (void)flags;
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
    visit(v, node, m, 0, &descend, NULL);
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

static pbs_code count_visits(void *ctx, uint32_t node, const double m[12], uint32_t flags,
                             bool *descend, pbs_err *e) {
    (void)node, (void)m, (void)flags, (void)descend;
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
            pbs_node_data d;
            size_t chunks;
            const pbs_node *n = &a.nodes[id];
            CHECK(!pbs_archive_load_node(&a, id, &d, &err));
            fill_points(&run, subset(i), 4 + 2 * id, id + 9, &p);
            must(pbs_points_alloc(&run, subset(i), p.count, &back, &err), &err);
            back.count = 0;
            pbs_lattice l = {{n->lattice_min[0], n->lattice_min[1], n->lattice_min[2]}, n->lattice};
            pbs_chunk c = {.count = (uint32_t)p.count,
                           .bytes = p.count * a.record.stride,
                           .payload = d.records};
            CHECK(n->records == p.count && !pbs_points_read("f", &a.record, &c, &back, &l, &err));
            check_packed(&p, &back, &l);
            pbs_archive_list(&a, id, PBS_SORT_POINTS, &chunks);
            CHECK(same_attributes(&p, &back) && chunks == 1 + id);
            pbs_node_data_free(&a, &d);
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
        pbs_node_data d;
        volatile uint8_t sum = 0;
        c.bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
        reseal(c);
        pbs_code rc = open_archive_blob(c, &a), checked = check_blob(&run, c, false, NULL);
        CHECK(rc == PBS_OK || rc == PBS_DATA);
        bool opened = !rc;
        for (uint32_t i = 0; !rc && i < a.node_count; i++) {
            if ((rc = pbs_archive_load_node(&a, i, &d, &err))) break;
            for (uint64_t k = 0; k < a.nodes[i].records * a.record.stride; k++) sum += d.records[k];
            pbs_node_data_free(&a, &d);
        }
        CHECK(rc == PBS_OK || rc == PBS_DATA);
        if (opened) pbs_archive_close(&a);
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
