/* The promise of clouds, behind right checksums: points that come too near to another of their own
 * node, of a node above, or of one beside, spacings that are none, points outside of their box; and
 * what is right passes, in bounded memory. */
#include "formats/archive/cloudpack.h"
#include "tests/unit/support.h"
#include "tests/check.h"
#include "tests/cloudfile.h"

static pbs_run run = {.threads = 1};
static pbs_err err;

enum { COUNT = 150000, MOST_NODES = 200 };

/* A cloud as an archive: where its points are. */
typedef struct made {
    blob b;
    pbs_node node[MOST_NODES];
    uint8_t *points[MOST_NODES];
    size_t nodes;
    uint32_t stride;
} made;

static blob cloud_file(double offset) {
    static int32_t q[3 * COUNT];
    uint64_t state = 5;
    pbs_cloud cloud;
    pbs_cloudpack_stats stats;
    pbs_input in;
    for (size_t i = 0; i < COUNT; i++) {
        uint32_t side = i % 2 ? 200000 : 3000; /* and so cells of several sizes */
        for (int k = 0; k < 2; k++) q[3 * i + k] = (int32_t)(random_bits(&state) % side);
        q[3 * i + 2] = q[3 * i] / 7;
    }
    memcpy(q, q + 3, 12); /* two at one place */
    las_desc d = {2, 0, 0, {0.001, 0.001, 0.001}, {offset, -offset, 0}, COUNT, 0, 0};
    las_write("check.las", &d, q, NULL);
    must(pbs_cloud_open(&run, "check.las", &cloud, &err), &err);
    pbs_writer_desc to = {.path = "check.pbs", .stage = "test"};
    must(pbs_cloudpack(&run, &cloud, 1, &to, &stats, &err), &err);
    pbs_cloud_close(&cloud);
    must(pbs_input_open(&run, "check.pbs", &in, &err), &err);
    blob b = copy_blob((blob){(uint8_t *)(uintptr_t)in.bytes, (size_t)in.size});
    pbs_input_close(&in);
    unlink("check.las"), unlink("check.pbs");
    return b;
}

static made make(double offset) {
    made m = {.b = cloud_file(offset), .stride = 8};
    pbs_input in;
    pbs_reader *r;
    const pbs_chunk *e;
    size_t n;
    open_blob(&run, m.b, false, &in);
    must(pbs_reader_open(&run, &in, PBS_KIND(PBS_ARCHIVE), &r, &err), &err);
    must(pbs_reader_directory(r, &e, &n, &err), &err);
    for (size_t i = 0; i < n; i++) {
        pbs_chunk c;
        must(pbs_reader_at(r, &e[i], &c, &err), &err);
        if (e[i].tag == PBS_TAG_POINTS && !e[i].first)
            m.points[e[i].node] = m.b.bytes + e[i].offset + 64;
        if (e[i].tag != PBS_TAG_NODE || m.nodes == MOST_NODES) continue;
        must(pbs_node_read(&run, "", &c, (uint32_t)m.nodes, &m.node[m.nodes], &err), &err);
        m.nodes++;
    }
    pbs_reader_close(r);
    return m;
}

static void end(made *m) {
    for (size_t i = 0; i < m->nodes; i++) pbs_node_free(&run, &m->node[i]);
    free(m->b.bytes);
}

static uint8_t *point(const made *m, size_t node, size_t i) {
    return m->points[node] + i * m->stride;
}

/* PBS_OK, or what is said. */
static pbs_code check(made *m) {
    reseal(m->b);
    pbs_run own = {.threads = 1};
    pbs_code rc = check_blob(&own, m->b, false, &err);
    CHECK(!pbs_mem_used(&own));
    return rc;
}

#define REFUSED(m, says)                                                                           \
    do {                                                                                           \
        CHECK(check(m) == PBS_DATA && strstr(err.text, says));                                     \
        if (!strstr(err.text, says)) printf("# %s\n", err.text);                                   \
    } while (0)

TEST(a_cloud_is_right) {
    for (double offset = 0; offset < 1e8; offset = offset * 100 + 1e5) {
        made m = make(offset);
        CHECK_NUM(m.nodes > 5 && m.nodes < MOST_NODES, m.nodes);
        pbs_code rc = check(&m);
        if (rc) printf("# %s\n", err.text);
        CHECK(!rc);
        end(&m);
    }
}

/* Where doubles are too coarse for its lattice, nodes are still looked at. */
TEST(a_cloud_too_far_away_is_right) {
    made m = make(3e11);
    pbs_code rc = check(&m);
    if (rc) printf("# %s\n", err.text);
    CHECK(!rc);
    end(&m);
}

TEST(two_of_a_node) {
    made m = make(0);
    for (size_t i = 0; i < m.nodes; i++) {
        if (m.node[i].records < 100) continue;
        uint8_t keep[6], *p = point(&m, i, 20), *other = point(&m, i, 70);
        if (!pbs_get_u16(other + 6)) continue;
        memcpy(keep, p, 6);
        memcpy(p, other, 6);
        REFUSED(&m, "closer to another");
        memcpy(p, keep, 6);
    }
    CHECK(!check(&m));
    end(&m);
}

/* Puts a point of node a where one of node b is, if that is in a's box; how often. */
static int put_together(made *m, size_t a, size_t b) {
    const pbs_node *na = &m->node[a], *nb = &m->node[b];
    for (size_t i = 0; i < nb->records; i++) {
        uint8_t *from = point(m, b, i), *to = point(m, a, na->records / 3), keep[6];
        bool in = pbs_get_u16(from + 6) > 0 && pbs_get_u16(to + 6) > 0;
        uint16_t q[3];
        for (int k = 0; k < 3 && in; k++) {
            double at = nb->origin[k] + nb->lattice * pbs_get_u16(from + 2 * k);
            double steps = floor((at - na->origin[k]) / na->lattice + 0.5);
            in = steps >= 0 && steps < 65536 && at >= na->box.min[k] && at <= na->box.max[k];
            q[k] = in ? (uint16_t)steps : 0;
        }
        if (!in) continue;
        memcpy(keep, to, 6);
        q[1] ^= 1; /* beside it */
        memcpy(to, q, 6);
        REFUSED(m, "closer to another");
        memcpy(to, keep, 6);
        return 1;
    }
    return 0;
}

TEST(one_of_a_node_and_one_above) {
    made m = make(1e7);
    int pairs = 0;
    for (size_t i = m.nodes; i--;)
        for (size_t k = i; k-- && pairs < 6;)
            if (m.node[i].records && m.node[k].records > 50) pairs += put_together(&m, k, i);
    CHECK_NUM(pairs == 6, pairs);
    CHECK(!check(&m));
    end(&m);
}

/* The place in a node that is nearest to `at` of those in its box. */
static void put_near(const pbs_node *n, const double at[3], uint8_t *p) {
    for (int k = 0; k < 3; k++) {
        double in = fmin(fmax(at[k], n->box.min[k]), n->box.max[k]);
        pbs_put_u16(p + 2 * k, (uint16_t)floor((in - n->origin[k]) / n->lattice + 0.5));
    }
}

/* Two leaves, one point of each moved to the same place between them. */
static int put_beside(made *m, size_t a, size_t b) {
    const pbs_node *na = &m->node[a], *nb = &m->node[b];
    double at[3], far = 0;
    if (na->child_count || nb->child_count || na->records < 50 || nb->records < 50) return 0;
    uint8_t *p = point(m, a, 0), *q = point(m, b, 0), keep[2][6];
    double s = (double)fminf(pbs_half_get(pbs_get_u16(p + 6)), pbs_half_get(pbs_get_u16(q + 6)));
    for (int k = 0; k < 3; k++) {
        at[k] = fmax(na->box.min[k], nb->box.min[k]);
        far = fmax(far, fmax(at[k] - na->box.max[k], at[k] - nb->box.max[k]));
    }
    if (far > s * 32768 * na->lattice) return 0;
    memcpy(keep[0], p, 6), memcpy(keep[1], q, 6);
    put_near(na, at, p), put_near(nb, at, q);
    REFUSED(m, "closer to another");
    memcpy(p, keep[0], 6), memcpy(q, keep[1], 6);
    return 1;
}

TEST(one_of_a_node_and_one_beside) {
    made m = make(0);
    int pairs = 0;
    for (size_t a = 0; a < m.nodes; a++)
        for (size_t b = 0; b < a && pairs < 6; b++) pairs += put_beside(&m, a, b);
    CHECK_NUM(pairs == 6, pairs);
    CHECK(!check(&m));
    end(&m);
}

TEST(spacings_of_levels_that_fall) {
    made m = make(0);
    size_t i = m.nodes - 1;
    while (m.node[i].records < 100) i--;
    uint8_t *p = point(&m, i, 50) + 6;
    uint16_t is = pbs_get_u16(p);
    pbs_put_u16(p, (uint16_t)(is + 1));
    REFUSED(&m, "that of no level");
    pbs_put_u16(p, (uint16_t)(is | 0x8000));
    CHECK(check(&m) == PBS_DATA);
    pbs_put_u16(p, (uint16_t)(is + 3072));
    REFUSED(&m, "larger than the one before");
    pbs_put_u16(p, is);
    /* the first one may have any that is not too large for the others */
    uint8_t *first = point(&m, i, 0) + 6;
    is = pbs_get_u16(first);
    pbs_put_u16(first, (uint16_t)(is + 1024));
    CHECK(!check(&m) || strstr(err.text, "closer"));
    pbs_put_u16(first, is);
    CHECK(!check(&m));
    end(&m);
}

TEST(a_level_too_coarse) {
    made m = make(0);
    size_t i = 0;
    while (m.node[i].records < 1000) i++;
    for (size_t k = 0; k < m.node[i].records; k++) {
        uint8_t *p = point(&m, i, k) + 6;
        if (pbs_get_u16(p) >= 1024) pbs_put_u16(p, (uint16_t)(pbs_get_u16(p) + 1024));
    }
    REFUSED(&m, "closer to another");
    end(&m);
}

TEST(a_point_outside_of_its_box) {
    made m = make(0);
    size_t i = m.nodes - 1;
    while (m.node[i].records < 100) i--;
    const pbs_node *n = &m.node[i];
    uint8_t *p = point(&m, i, 50);
    double top = (n->box.max[2] - n->origin[2]) / n->lattice;
    CHECK(top < 65000);
    pbs_put_u16(p + 4, 65535);
    REFUSED(&m, "outside of the node's box");
    end(&m);
}

TEST(memory_is_that_of_a_node) {
    made m = make(0);
    pbs_run fresh = {.threads = 1};
    reseal(m.b);
    CHECK(!check_blob(&fresh, m.b, false, &err));
    /* 40 bytes twice and places in a table, for the largest node and what is near it */
    CHECK_NUM(pbs_mem_peak(&fresh) < COUNT * 130, fresh.mem_peak);
    end(&m);
}

TEST_MAIN
