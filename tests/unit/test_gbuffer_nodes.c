/* Many nodes drawn one after the other with the same buffers, and by several threads at a time:
 * each comes out as if it were the only one. */
#include "libcore/ground/pipe.h"
#include "tests/unit/gbuffer_shape.h"

enum { NODES = 24 };

/* Nodes of all sizes, in no order: soups, balls, some with several draws, an empty one. */
typedef struct nodes {
    shape shape[NODES];
    pbs_draw draw[NODES][3];
    size_t draws[NODES];
    pbs_gbuffer_params params[NODES];
    result want[NODES];
} nodes;

static nodes *make_nodes(void) {
    nodes *n = calloc(1, sizeof *n);
    for (int i = 0; i < NODES; i++) {
        shape *s = &n->shape[i];
        *s = i % 3 ? soup(1 + (uint32_t)(i * 577 % 1900)) : ball(5 + (uint32_t)i, 9, 0.2);
        n->draws[i] = i == 7 ? 0 : 1 + (size_t)i % 3;
        for (int k = 0; k < 3; k++) {
            n->draw[i][k] = placed(s);
            n->draw[i][k].m[3] = 0.4 * k;
        }
        n->params[i] = (pbs_gbuffer_params){.resolution = 2 + (uint32_t)(i * 89 % 211),
                                            .box = {{0, 0, 0}, {1, 1, 1}}};
        n->params[i].channels = (i & 1 ? PBS_NORMAL : 0) | (i & 2 ? PBS_COLOUR : 0);
        if (n->draws[i]) n->params[i].box = box_of(n->draw[i], n->draws[i]);
        picture p = {.draws = n->draw[i], .draw_count = n->draws[i]};
        n->want[i] = draw_scene(&p, &n->params[i], 1);
    }
    return n;
}

static void free_nodes(nodes *n) {
    for (int i = 0; i < NODES; i++) free_shape(&n->shape[i]), drop(&n->want[i]);
    free(n);
}

/* Whatever came before; and never more memory than was said. */
TEST(one_after_the_other) {
    nodes *n = make_nodes();
    for (int threads = 1; threads < 12; threads += 5) {
        pbs_run run = {.threads = threads};
        pbs_surfaces *surfaces;
        pbs_gbuffers *g;
        CHECK(!pbs_surfaces_new(&run, NULL, 0, NULL, 0, PBS_COLOUR, &surfaces, NULL));
        CHECK(!pbs_gbuffers_new(&run, surfaces, threads, &g, NULL));
        for (int turn = 0, i = 0; turn < 2 * NODES; turn++, i = (i + 5) % NODES) {
            result r = {0};
            size_t need = pbs_gbuffer_need(g, n->draw[i], n->draws[i], &n->params[i], 0);
            run.mem_peak = run.mem_used;
            need += run.mem_used;
            r.rc = pbs_gbuffer(g, n->draw[i], n->draws[i], &n->params[i], keep_view, &r, &r.stats,
                               NULL);
            CHECK_NUM(same(&r, &n->want[i]), i);
            CHECK(!memcmp(&r.stats, &n->want[i].stats, sizeof r.stats));
            CHECK_NUM(run.mem_peak <= need, run.mem_peak - need);
            drop(&r);
        }
        pbs_gbuffers_free(g);
        pbs_surfaces_free(&run, surfaces);
        CHECK(run.mem_used == 0);
    }
    free_nodes(n);
}

/* What a second, equal call takes: nothing. */
TEST(buffers_are_kept) {
    nodes *n = make_nodes();
    pbs_run run = {.threads = 1};
    pbs_surfaces *surfaces;
    pbs_gbuffers *g;
    CHECK(!pbs_surfaces_new(&run, NULL, 0, NULL, 0, PBS_COLOUR, &surfaces, NULL));
    CHECK(!pbs_gbuffers_new(&run, surfaces, 1, &g, NULL));
    for (int turn = 0; turn < 2; turn++) {
        for (int i = 0; i < NODES; i++) {
            result r = {0};
            CHECK(
                !pbs_gbuffer(g, n->draw[i], n->draws[i], &n->params[i], keep_view, &r, NULL, NULL));
            drop(&r);
        }
        if (!turn) run.mem_limit = run.mem_used;
    }
    pbs_gbuffers_free(g);
    pbs_surfaces_free(&run, surfaces);
    free_nodes(n);
}

typedef struct crew {
    pbs_run run;
    nodes *n;
    pbs_surfaces *surfaces;
    pbs_gbuffers *g[4];
    int same[NODES];
} crew;

static pbs_code draw_node(void *ctx, size_t i, int thread, pbs_err *err) {
    crew *c = ctx;
    result r = {0};
    r.rc = pbs_gbuffer(c->g[thread], c->n->draw[i], c->n->draws[i], &c->n->params[i], keep_view, &r,
                       &r.stats, err);
    c->same[i] = same(&r, &c->n->want[i]);
    drop(&r);
    return r.rc;
}

TEST(several_at_a_time) {
    crew c = {.run = {.threads = 4}, .n = make_nodes()};
    CHECK(!pbs_surfaces_new(&c.run, NULL, 0, NULL, 0, PBS_COLOUR, &c.surfaces, NULL));
    for (int i = 0; i < 4; i++) CHECK(!pbs_gbuffers_new(&c.run, c.surfaces, 1, &c.g[i], NULL));
    CHECK(!pbs_parallel(&c.run, NODES, draw_node, &c, NULL));
    for (int i = 0; i < NODES; i++) CHECK_NUM(c.same[i], i);
    for (int i = 0; i < 4; i++) pbs_gbuffers_free(c.g[i]);
    pbs_surfaces_free(&c.run, c.surfaces);
    CHECK(c.run.mem_used == 0);
    free_nodes(c.n);
}

/* An error leaves the buffers usable. */
TEST(after_an_error) {
    nodes *n = make_nodes();
    pbs_run run = {.threads = 2};
    pbs_err err;
    pbs_surfaces *surfaces;
    pbs_gbuffers *g;
    CHECK(!pbs_surfaces_new(&run, NULL, 0, NULL, 0, 0, &surfaces, NULL));
    CHECK(!pbs_gbuffers_new(&run, surfaces, 2, &g, NULL));
    for (int i = 1; i < NODES; i += 4) { /* without colours */
        result r = {0}, stopped = {.stop_at = 3};
        pbs_gbuffer_params p = n->params[i], bad = p;
        CHECK(pbs_gbuffer(g, n->draw[i], n->draws[i], &p, keep_view, &stopped, NULL, &err) ==
              PBS_IO);
        bad.channels |= PBS_COLOUR;
        CHECK(pbs_gbuffer(g, n->draw[i], n->draws[i], &bad, keep_view, &r, NULL, &err) ==
              PBS_USAGE);
        run.mem_limit = 1;
        bad = p, bad.resolution = 1000;
        CHECK(pbs_gbuffer(g, n->draw[i], n->draws[i], &bad, keep_view, &r, NULL, &err) ==
              PBS_LIMIT);
        run.mem_limit = 0;
        CHECK(r.count == 0 && stopped.count == 3);
        CHECK(!pbs_gbuffer(g, n->draw[i], n->draws[i], &p, keep_view, &r, NULL, &err));
        CHECK_NUM(same(&r, &n->want[i]), i);
        drop(&r), drop(&stopped);
    }
    pbs_gbuffers_free(g);
    pbs_surfaces_free(&run, surfaces);
    CHECK(run.mem_used == 0);
    free_nodes(n);
}

TEST_MAIN
