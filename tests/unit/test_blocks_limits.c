/* The walk over blocks at its limits: memory, threads, hierarchies that stand for more than fits
 * anywhere, numbers that overflow; and which side of parts is out. */
#include "formats/voxels/blocks.h"
#include "libcore/ground/pipe.h"
#include "tests/check.h"
#include "tests/unit/parts.h"

static pbs_code tally(void *ctx, const pbs_mesh *mesh, const uint32_t *triangles, size_t count,
                      const pbs_to_grid *to, pbs_sides sides, pbs_err *e) {
    (void)mesh, (void)triangles, (void)to, (void)sides, (void)e;
    *(uint64_t *)ctx += count;
    return PBS_OK;
}

/* Walks with one reader of blocks. */
static uint64_t count_all(const pbs_scene *s, const pbs_grid *g, uint64_t *blocks) {
    pbs_blocks *b;
    uint64_t n = 0;
    must(pbs_blocks_new(s, g, PBS_ORIENT_AUTO, 1 << 20, &b, &err), &err);
    for (*blocks = 0;; (*blocks)++) {
        pbs_nearby *near;
        uint32_t at[3];
        bool end;
        must(pbs_blocks_next(b, at, &near, &end, &err), &err);
        if (end) break;
        must(pbs_nearby_visit(near, tally, &n, &err), &err);
        pbs_nearby_free(near);
    }
    pbs_blocks_free(b);
    return n;
}

/* As the digest of a flat scene, for scenes of one part. */
static pbs_code digest(void *ctx, const pbs_mesh *mesh, const uint32_t *triangles, size_t count,
                       const pbs_to_grid *to, pbs_sides sides, pbs_err *e) {
    uint64_t *d = ctx;
    (void)to, (void)sides, (void)e;
    for (size_t i = 0; i < count; i++) {
        uint32_t bits;
        memcpy(&bits, mesh->position, sizeof bits);
        uint64_t h = bits * (uint64_t)1000003 + triangles[i] + d[1];
        d[0] += (h ^ h >> 29) * 0xe7037ed1a0b428dbu;
    }
    return PBS_OK;
}

/* Clusters in a file, or in memory; one thread, or two. */
TEST(a_part_larger_than_memory) {
    uint64_t seed = 3, first = 0;
    maker m = new_scene();
    uint32_t root = soup(&m, 120000, 100, (double[3]){0, 0, 0}, &seed);
    pbs_scene s = reopen(&m, root);
    pbs_box box;
    uint64_t triangles, singular;
    CHECK(!pbs_scene_box(&s, &box, &triangles, &singular, &err));
    pbs_grid g = pbs_grid_around(&box, 256);
    for (int i = 0; i < 3; i++) {
        pbs_blocks *b;
        uint64_t d[2] = {0, 0};
        size_t limit = pbs_mem_used(&run) + ((size_t)5 << 18);
        run.threads = 1 + i % 2;
        run.mem_limit = i ? limit : 0;
        run.mem_peak = pbs_mem_used(&run);
        must(pbs_blocks_new(&s, &g, PBS_ORIENT_AUTO, 1 << 20, &b, &err), &err);
        for (;; d[1]++) {
            pbs_nearby *near;
            uint32_t at[3];
            bool end;
            must(pbs_blocks_next(b, at, &near, &end, &err), &err);
            if (end) break;
            must(pbs_nearby_visit(near, digest, d, &err), &err);
            pbs_nearby_free(near);
        }
        pbs_blocks_free(b);
        if (!i) first = d[0];
        CHECK(d[0] == first && d[1] == 64);
        if (i) CHECK(pbs_mem_peak(&run) <= limit);
    }
    run.mem_limit = pbs_mem_used(&run) + (1 << 18); /* not enough for the lists */
    pbs_blocks *b;
    CHECK(pbs_blocks_new(&s, &g, PBS_ORIENT_AUTO, 1 << 20, &b, &err) == PBS_LIMIT && !b);
    run.mem_limit = 0;
    pbs_scene_close(&s);
}

/* ---- on threads: the walk goes on while blocks are worked on ---- */

typedef struct job {
    pbs_nearby *near;
    uint64_t triangles;
} job;

static pbs_code next_job(void *ctx, void *slot, bool *end, pbs_err *e) {
    uint32_t at[3];
    return pbs_blocks_next(ctx, at, &((job *)slot)->near, end, e);
}

static pbs_code do_job(void *ctx, void *slot, int thread, pbs_err *e) {
    job *j = slot;
    (void)ctx, (void)thread;
    j->triangles = 0;
    return pbs_nearby_visit(j->near, tally, &j->triangles, e);
}

static uint64_t jobs_total;
static pbs_code end_job(void *ctx, void *slot, pbs_err *e) {
    job *j = slot;
    (void)ctx, (void)e;
    jobs_total += j->triangles;
    pbs_nearby_free(j->near);
    return PBS_OK;
}

TEST(on_threads) {
    uint64_t seed = 77, total = 0, blocks;
    maker m = new_scene();
    uint32_t root = tree(&m, 0, &seed);
    pbs_scene s = reopen(&m, root);
    pbs_box box;
    uint64_t triangles, singular;
    CHECK(!pbs_scene_box(&s, &box, &triangles, &singular, &err));
    pbs_grid g = pbs_grid_around(&box, 2000);
    total = count_all(&s, &g, &blocks);
    for (run.threads = 1; run.threads <= 4; run.threads *= 2) {
        pbs_blocks *b;
        job slots[8];
        must(pbs_blocks_new(&s, &g, PBS_ORIENT_AUTO, 1 << 20, &b, &err), &err);
        pbs_pipe p = {b, next_job, do_job, end_job, slots, sizeof *slots, 2 * run.threads};
        jobs_total = 0;
        must(pbs_pipe_run(&run, &p, &err), &err);
        CHECK(jobs_total == total);
        pbs_blocks_free(b);
    }
    run.threads = 2;
    pbs_scene_close(&s);
}

TEST(cancelled) {
    maker m = new_scene();
    pbs_scene s = reopen(&m, cube(&m, WHOLE));
    volatile sig_atomic_t stop = 0;
    pbs_grid g = {.min = {-20, -20, -20}, .voxel = 0.1, .size = 400};
    pbs_blocks *b;
    pbs_nearby *near;
    uint32_t at[3];
    bool end;
    must(pbs_blocks_new(&s, &g, PBS_ORIENT_AUTO, 1 << 20, &b, &err), &err);
    stop = 1;
    run.cancel = &stop;
    CHECK(pbs_blocks_next(b, at, &near, &end, &err) == PBS_CANCEL && !near);
    run.cancel = NULL;
    pbs_blocks_free(b);
    pbs_scene_close(&s);
}

/* 4^9 cubes, all in one block, or on the corner of eight. */
TEST(a_bomb) {
    maker m = new_scene();
    uint32_t node = cube(&m, WHOLE);
    for (int i = 0; i < 9; i++) {
        pbs_child c[4];
        for (int k = 0; k < 4; k++) c[k] = child_at(node, k * exp2(-20 + i), 1, false);
        node = add_assembly(&m, c, 4);
    }
    pbs_scene s = reopen(&m, node);
    pbs_grid g = {.min = {-8, -8, -8}, .voxel = 0.25, .size = 64};
    uint64_t blocks;
    run.mem_peak = pbs_mem_used(&run);
    size_t before = run.mem_peak;
    CHECK(count_all(&s, &g, &blocks) == 12u << 18 && blocks == 1);
    for (int k = 0; k < 3; k++) g.min[k] = -15.75;
    g.size = 1000;
    CHECK(count_all(&s, &g, &blocks) == 8 * (12u << 18) && blocks == 8);
    CHECK_NUM(pbs_mem_peak(&run) - before < 3 << 20, pbs_mem_peak(&run) - before);
    pbs_scene_close(&s);
}

/* 10^5 assemblies of one child each; and 2^60 placings of nothing. */
TEST(deep) {
    maker m = new_scene();
    uint32_t node = cube(&m, WHOLE), none = add_assembly(&m, NULL, 0);
    for (int i = 0; i < 60; i++) none = add_pair(&m, here(none), child_at(none, 1, 1, false));
    for (int i = 0; i < 100000; i++) {
        pbs_child c = child_at(node, i % 2 ? 0.001 : -0.001, 1, false);
        node = add_assembly(&m, &c, 1);
    }
    node = add_pair(&m, here(node), child_at(none, 5, 1, false));
    pbs_scene s = reopen(&m, node);
    pbs_box box;
    uint64_t triangles, singular, blocks;
    CHECK(!pbs_scene_box(&s, &box, &triangles, &singular, &err));
    CHECK(triangles == 12 && singular == 0);
    CHECK(fabs(box.max[0] - 1) < 1e-9 && box.max[1] == 1);
    pbs_grid g = pbs_grid_around(&box, 100);
    uint64_t n = count_all(&s, &g, &blocks);
    CHECK(n == 12 * blocks && blocks == 8);
    pbs_scene_close(&s);
}

/* ---- numbers that are none ---- */

static pbs_code box_of_chain(double a, double b, pbs_box *box) {
    maker m = new_scene();
    uint32_t part = cube(&m, WHOLE);
    uint32_t inner = add_pair(&m, child_at(part, 0, a, false), child_at(part, 0, a, false));
    uint32_t outer = add_pair(&m, child_at(inner, 0, b, false), child_at(part, 1, 1, false));
    pbs_scene s = reopen(&m, outer);
    uint64_t triangles, singular;
    pbs_flat flat_scene;
    pbs_err other;
    pbs_code rc = pbs_scene_box(&s, box, &triangles, &singular, &err);
    CHECK(rc == pbs_scene_flatten(&s, &flat_scene, &other));
    if (rc)
        CHECK(!strcmp(err.text, other.text));
    else
        CHECK(!memcmp(box, &flat_scene.box, sizeof *box));
    pbs_grid g = {.min = {-2, -2, -2}, .voxel = 1, .size = 64};
    pbs_blocks *b2;
    pbs_nearby *near;
    uint32_t at[3];
    bool end;
    uint64_t seen = 0;
    must(pbs_blocks_new(&s, &g, PBS_ORIENT_AUTO, 1 << 20, &b2, &err), &err);
    must(pbs_blocks_next(b2, at, &near, &end, &err), &err);
    CHECK(!end);
    pbs_code visit = pbs_nearby_visit(near, tally, &seen, &err);
    CHECK(visit == PBS_OK || visit == PBS_DATA);
    if (!visit) CHECK(seen >= 12);
    pbs_nearby_free(near);
    pbs_blocks_free(b2);
    pbs_free(&run, flat_scene.draws);
    pbs_scene_close(&s);
    return rc;
}

TEST(numbers_that_overflow) {
    pbs_box box;
    CHECK(box_of_chain(1e200, 1e200, &box) == PBS_OK); /* infinity times 0 is no place */
    CHECK(box_of_chain(1e308, 1, &box) == PBS_DATA);
    CHECK(box_of_chain(0, 1, &box) == PBS_OK);
    CHECK(box_of_chain(1e-200, 1e-200, &box) == PBS_OK);
    CHECK(box_of_chain(1e200, 1e-200, &box) == PBS_OK);
    CHECK(box_of_chain(0x1p1023, 0x1p1023, &box) == PBS_OK);
}

/* From corner to corner of the largest grid: only blocks along the needle come. */
TEST(a_needle) {
    maker m = new_scene();
    begin_part(&m, 0, 0, 0);
    put_triangle(&m, (const double[3][3]){{0, 0, 0}, {100, 99, 98}, {100, 99, 98.001}});
    pbs_scene s = reopen(&m, end_part(&m));
    pbs_grid g = {.min = {-1, -1, -1}, .voxel = 102.0 / PBS_GRID_MAX, .size = PBS_GRID_MAX};
    uint64_t blocks;
    CHECK(count_all(&s, &g, &blocks) == blocks);
    CHECK_NUM(blocks > 1000 && blocks < 5000, blocks);
    pbs_scene_close(&s);
}

/* Infinity with both signs, in a row that never becomes NaN: 2^60 placings that nothing is known
 * of, and none of which is anywhere. */
TEST(a_bomb_of_infinities) {
    static const double below[12] = {.9, -.1, .1, 1, -.1, .9, -.1, -1, .1, -.1, .9, 1};
    static const double large[12] = {1e200, -1e200, 1e200, 1e200, 0, 1, 0, 0, 0, 0, 1, 0};
    maker m = new_scene();
    begin_part(&m, 1, 1, 1);
    put_triangle(&m, (const double[3][3]){{1, 1, 1}, {2, 1, 1}, {1, 2, 1}});
    uint32_t part = end_part(&m), node = part;
    for (int i = 0; i < 62; i++) {
        pbs_child c = {.node = node};
        memcpy(c.m, i < 60 ? below : large, sizeof c.m);
        if (i == 61) c.m[1] = c.m[2] = c.m[3] = 0;
        node = i < 60 ? add_pair(&m, c, c) : add_assembly(&m, &c, 1);
    }
    pbs_scene s = reopen(&m, add_pair(&m, here(node), here(part)));
    pbs_box box;
    uint64_t triangles, singular;
    CHECK(pbs_scene_box(&s, &box, &triangles, &singular, &err) == PBS_DATA);
    pbs_scene_close(&s);
}

TEST(nothing_in_it) {
    maker m = new_scene();
    uint32_t part = cube(&m, WHOLE);
    pbs_scene s = reopen(&m, part);
    uint64_t blocks;
    pbs_grid g = {.min = {50, 50, 50}, .voxel = 0.5, .size = 640};
    CHECK(count_all(&s, &g, &blocks) == 0 && blocks == 0);
    pbs_scene_close(&s);
}

/* ---- sides ---- */

static pbs_code note_sides(void *ctx, const pbs_mesh *mesh, const uint32_t *triangles, size_t count,
                           const pbs_to_grid *to, pbs_sides sides, pbs_err *e) {
    (void)mesh, (void)triangles, (void)count, (void)to, (void)e;
    ((uint32_t *)ctx)[sides]++;
    return PBS_OK;
}

/* How often meshes were visited with each of the sides; all in one block. */
static void sides_of(maker *m, uint32_t root, pbs_orient how, uint32_t out[3],
                     pbs_blocks_stats *stats) {
    pbs_scene s = reopen(m, root);
    pbs_grid g = {.min = {-50, -50, -50}, .voxel = 10, .size = 10};
    pbs_blocks *b;
    pbs_nearby *near;
    uint32_t at[3];
    bool end;
    memset(out, 0, 3 * sizeof *out);
    must(pbs_blocks_new(&s, &g, how, 1 << 20, &b, &err), &err);
    must(pbs_blocks_next(b, at, &near, &end, &err), &err);
    CHECK(!end);
    must(pbs_nearby_visit(near, note_sides, out, &err), &err);
    *stats = pbs_blocks_totals(b);
    pbs_nearby_free(near);
    pbs_blocks_free(b);
    pbs_scene_close(&s);
}

static bool is(const uint32_t n[3], uint32_t outside, uint32_t inside, uint32_t unknown) {
    return n[PBS_SIDES_OUT] == outside && n[PBS_SIDES_IN] == inside &&
           n[PBS_SIDES_UNKNOWN] == unknown;
}

TEST(cubes_and_their_sides) {
    uint32_t n[3];
    pbs_blocks_stats stats;
    for (int how = PBS_ORIENT_AUTO; how <= PBS_ORIENT_UNKNOWN; how++) {
        maker m = new_scene();
        pbs_child c[4] = {here(cube(&m, WHOLE)), child_at(cube(&m, WHOLE | TURNED), 3, 1, false),
                          child_at(cube(&m, HALF_ONE), 6, 1, false),
                          child_at(c[0].node, 9, -1, false)}; /* mirrored: the part's own frame */
        sides_of(&m, add_assembly(&m, c, 4), (pbs_orient)how, n, &stats);
        if (how == PBS_ORIENT_AUTO)
            CHECK(is(n, 2, 1, 1) && stats.parts_known == 2 && stats.parts_turned == 1 &&
                  stats.parts_unknown == 1);
        if (how == PBS_ORIENT_TRUST) CHECK(is(n, 4, 0, 0) && stats.parts_known == 3);
        if (how == PBS_ORIENT_UNKNOWN) CHECK(is(n, 0, 0, 4) && stats.parts_unknown == 3);
    }
}

/* Two halves that are placed where they are make a whole; not if one is moved; and a half of two
 * wholes of which one is inside out is not known. */
TEST(halves) {
    uint32_t n[3];
    pbs_blocks_stats stats;
    for (unsigned turned = 0; turned <= TURNED; turned += TURNED) {
        maker m = new_scene();
        uint32_t one = cube(&m, HALF_ONE | turned), two = cube(&m, HALF_TWO | turned);
        uint32_t whole = add_pair(&m, here(one), here(two));
        pbs_child c[2] = {child_at(whole, 5, 2, false), child_at(one, 9, 1, false)};
        sides_of(&m, add_assembly(&m, c, 2), PBS_ORIENT_AUTO, n, &stats);
        CHECK(turned ? is(n, 0, 3, 0) : is(n, 3, 0, 0));
    }
    maker m = new_scene();
    uint32_t one = cube(&m, HALF_ONE), two = cube(&m, HALF_TWO);
    sides_of(&m, add_pair(&m, here(one), child_at(two, 1e-9, 1, false)), PBS_ORIENT_AUTO, n,
             &stats);
    CHECK(is(n, 0, 0, 2));
    m = new_scene();
    one = cube(&m, HALF_ONE);
    begin_part(&m, 1.5, 1.25, 0); /* the same bits around another origin */
    put_cube(&m, 0, 2, HALF_TWO);
    sides_of(&m, add_pair(&m, here(one), here(end_part(&m))), PBS_ORIENT_AUTO, n, &stats);
    CHECK(is(n, 0, 0, 2));
    m = new_scene();
    one = cube(&m, HALF_ONE), two = cube(&m, HALF_TWO);
    begin_part(&m, 0.5, 0.25, -1); /* closes the first half around the outside of itself */
    put_cube(&m, -1, 1, HALF_ONE | TURNED);
    put_cube(&m, -9, 9, WHOLE | TURNED);
    uint32_t other = end_part(&m);
    pbs_child c[2] = {here(add_pair(&m, here(one), here(two))),
                      child_at(add_pair(&m, here(one), here(other)), 0, 1, true)};
    sides_of(&m, add_assembly(&m, c, 2), PBS_ORIENT_AUTO, n, &stats);
    CHECK(is(n, 1, 1, 2));
}

static void put_sphere(const maker *m, double radius) {
    enum { N = 30 };
    for (int i = 0; i < 2 * N * N; i++) {
        double p[4][3];
        for (int c = 0; c < 4; c++) {
            int row = i / (2 * N) + (c >> 1), at = (i + (c & 1)) % (2 * N);
            double a = M_PI * row / N, b = M_PI * at / N, wide = row % N ? radius * sin(a) : 0;
            p[c][0] = wide * cos(b), p[c][1] = wide * sin(b), p[c][2] = radius * cos(a);
        }
        double two[2][3][3];
        for (int k = 0; k < 3; k++) {
            memcpy(two[0][k], p[k == 0 ? 0 : k + 1], sizeof two[0][k]);
            memcpy(two[1][k], p[k == 0 ? 0 : k == 1 ? 3 : 1], sizeof two[1][k]);
        }
        put_triangle(m, two[0]);
        put_triangle(m, two[1]);
    }
}

/* What the importer splits is known as before; a part may have several shells. */
TEST(a_part_that_is_split) {
    uint32_t n[3];
    pbs_blocks_stats stats;
    for (uint64_t split = 0; split < 200; split += 100) {
        const pbs_scene_options options = {.split = split};
        maker m = {.w = spool_writer(&run, PBS_SCENE, NULL, 0)};
        must(pbs_scene_writer_new(&run, m.w, &options, &m.sw, &err), &err);
        m.s = pbs_scene_sink(m.sw);
        begin_part(&m, 1, 1, 1);
        put_sphere(&m, 20);
        put_sphere(&m, 30);
        sides_of(&m, end_part(&m), PBS_ORIENT_AUTO, n, &stats);
        CHECK_NUM(split ? stats.parts_known > 50 : stats.parts_known == 1, stats.parts_known);
        CHECK(is(n, (uint32_t)stats.parts_known, 0, 0));
    }
}

TEST_MAIN
