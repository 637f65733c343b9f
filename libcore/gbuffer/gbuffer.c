/* gbuffer.c: a node drawn in all its views, and the work spread over threads (paper 1, section
 * 3.1). A pair of opposite views is one piece of work; with more threads than pairs, so is a band
 * of its rows. Drawing is in raster.c, what becomes of a pixel in resolve.c and shade.c.
 */
#include "libcore/gbuffer/gbuffer.h"
#include "libcore/ground/pipe.h"
#include "libcore/gbuffer/resolve.h"

#define MAX_THREADS 256
#define CHECK_EVERY (1 << 16) /* triangles between two looks at the cancel flag */

/* Work for fewer nanoseconds than this is not worth waking a thread for. The costs of a triangle
 * and of a pixel, in each pair, are rough. */
#define ALONE    500000
#define TRIANGLE 15
#define PIXEL    5

/* How the pairs are cut for some number of threads. */
typedef struct layout {
    pbs_views views;
    int threads;
    uint32_t bands; /* of each pair */
} layout;

/* A thread's own. */
typedef struct bench {
    uint64_t *key;
    pbs_snapped *vertex;
    uint32_t *column;
    pbs_resolve_scratch *resolve;
    size_t keys, vertices, columns;
} bench;

/* A band of a pair on its way from the work to the sink. */
typedef struct slot {
    int pair;
    uint32_t band;
    uint64_t fragments;
    void *block[2];
    size_t bytes[2]; /* of the blocks */
    pbs_resolve_out out[2];
} slot;

struct pbs_gbuffers {
    pbs_run *run;
    const pbs_surfaces *surfaces;
    int threads;
    uint32_t *first;
    size_t firsts;
    bench *bench; /* one a thread */
    slot *slots;  /* one more than threads */
    slot whole;   /* a pair put together from its bands */
    /* Of the call. */
    layout at;
    pbs_resolve set;
    uint32_t vertices; /* of the largest mesh */
    bool progress;
    uint64_t done;
    size_t next;
    pbs_code (*sink)(void *ctx, const pbs_gbuffer_view *view, pbs_err *err);
    void *ctx;
    pbs_gbuffer_stats stats;
};

/* ---- sizes ---- */

static int thread_count(int threads) {
    return threads < 1 ? 1 : threads > MAX_THREADS ? MAX_THREADS : threads;
}

static bool worth_threads(const pbs_views *v, uint64_t triangles) {
    double ns = TRIANGLE * (double)triangles * v->pairs;
    for (int i = 0; i < v->pairs; i++) ns += PIXEL * (double)v->pair[i].width * v->pair[i].height;
    return ns > ALONE;
}

static pbs_code plan(layout *at, const pbs_gbuffer_params *params, uint64_t triangles, int threads,
                     pbs_err *err) {
    pbs_code rc = pbs_views_plan(params, &at->views, err);
    if (rc) return rc;
    at->threads = worth_threads(&at->views, triangles) ? threads : 1;
    at->bands = (uint32_t)((at->threads + at->views.pairs - 1) / at->views.pairs);
    if (at->bands > params->resolution) at->bands = params->resolution;
    return PBS_OK;
}

static void band_rows(const layout *at, int pair, uint32_t band, uint32_t *y0, uint32_t *y1) {
    uint64_t h = at->views.pair[pair].height;
    *y0 = (uint32_t)(h * band / at->bands);
    *y1 = (uint32_t)(h * (band + 1) / at->bands);
}

/* Pixels of the largest band, or of the largest pair with bands = 1. */
static size_t largest(const layout *at, uint32_t bands) {
    size_t most = 0;
    for (int i = 0; i < at->views.pairs; i++) {
        size_t rows = (at->views.pair[i].height + bands - 1) / bands,
               n = rows * at->views.pair[i].width;
        most = n > most ? n : most;
    }
    return most;
}

static uint32_t widest(const layout *at) {
    uint32_t most = 0;
    for (int i = 0; i < at->views.pairs; i++)
        most = at->views.pair[i].width > most ? at->views.pair[i].width : most;
    return most;
}

/* One more than threads, so that nobody waits for the view whose turn it is. */
static size_t slot_count(const layout *at) {
    size_t n = (size_t)at->views.pairs * at->bands;
    size_t most = at->threads > 1 ? (size_t)at->threads + 1 : 1;
    return n < most ? n : most;
}

/* An array whose contents don't matter, made larger if need be. */
static pbs_code make_room(pbs_run *run, void *array, size_t *have, size_t count, size_t size,
                          const char *what, pbs_err *err) {
    void *old;
    memcpy(&old, array, sizeof old);
    if (old && *have >= count) return PBS_OK;
    pbs_free(run, old);
    *have = 0;
    pbs_code rc = pbs_alloc(run, array, count, size, what, err); /* NULL after an error */
    if (!rc) *have = count;
    return rc;
}

/* ---- arrays of points ---- */

static size_t aligned(size_t bytes) {
    return (bytes + 63) & ~(size_t)63;
}

static size_t block_size(size_t room, uint32_t channels) {
    int words = 1 + 3 + !!(channels & PBS_NORMAL) + !!(channels & PBS_COLOUR) +
                !!(channels & PBS_MATERIAL) + !!(channels & PBS_EMISSIVE);
    return aligned(4 * room) * (size_t)words;
}

static void *carve(char **at, size_t bytes) {
    void *p = *at;
    *at += aligned(bytes);
    return p;
}

static void lay_out(pbs_resolve_out *out, void *block, size_t room, uint32_t channels) {
    char *at = block;
    *out = (pbs_resolve_out){.where = carve(&at, 4 * room)};
    out->points.position = carve(&at, 12 * room);
    if (channels & PBS_NORMAL) out->points.normal = carve(&at, 4 * room);
    if (channels & PBS_COLOUR) out->points.colour = carve(&at, 4 * room);
    if (channels & PBS_MATERIAL) out->points.material = carve(&at, 4 * room);
    if (channels & PBS_EMISSIVE) out->points.emissive = carve(&at, 4 * room);
}

/* Empty arrays for `room` points a view. */
static pbs_code make_points(pbs_gbuffers *g, slot *s, size_t room, pbs_err *err) {
    for (int i = 0; i < 2; i++) {
        pbs_code rc =
            make_room(g->run, &s->block[i], &s->bytes[i], block_size(room, g->set.channels), 1,
                      "the candidates of a view", err);
        if (rc) return rc;
        lay_out(&s->out[i], s->block[i], room, g->set.channels);
    }
    return PBS_OK;
}

static void append(pbs_resolve_out *to, const pbs_resolve_out *from) {
    size_t at = to->points.count, n = from->points.count;
    memcpy(to->where + at, from->where, 4 * n);
    memcpy(to->points.position + 3 * at, from->points.position, 12 * n);
    if (to->points.normal) memcpy(to->points.normal + 2 * at, from->points.normal, 4 * n);
    if (to->points.colour) memcpy(to->points.colour + 4 * at, from->points.colour, 4 * n);
    if (to->points.material) memcpy(to->points.material + 4 * at, from->points.material, 4 * n);
    if (to->points.emissive) memcpy(to->points.emissive + 4 * at, from->points.emissive, 4 * n);
    to->points.count += n;
}

/* ---- drawing ---- */

typedef struct question {
    const pbs_surfaces *surfaces;
    pbs_placed place;
    uint32_t triangle;
    pbs_lanes lanes;
} question;

static bool ask(void *ctx, uint32_t x, uint32_t y) {
    question *q = ctx;
    pbs_resolve_one(&q->place, q->triangle, x, y, &q->lanes);
    return pbs_surfaces_keep(q->surfaces, &q->lanes, 0);
}

/* A mesh that may have masked triangles: runs of others between them. */
static void draw_mixed(const pbs_resolve *set, pbs_raster *r, const pbs_pair *pair, uint32_t d,
                       const pbs_snapped *v, bool finite) {
    const pbs_mesh *mesh = set->draws[d].mesh;
    question q;
    q.surfaces = set->surfaces, q.place.draw = NULL;
    uint32_t run = 0, first = set->first[d];
    for (uint32_t i = 0; i < mesh->triangles; i++) {
        if (!pbs_surfaces_asks(set->surfaces, mesh, i)) continue;
        if (!q.place.draw) pbs_resolve_place(&q.place, pair, &set->draws[d], d, first);
        pbs_raster_draw(r, v, mesh->index + 3 * (size_t)run, i - run, first + run, finite);
        q.triangle = i;
        pbs_raster_draw_masked(r, v, mesh->index + 3 * (size_t)i, first + i, ask, &q);
        run = i + 1;
    }
    pbs_raster_draw(r, v, mesh->index + 3 * (size_t)run, mesh->triangles - run, first + run,
                    finite);
}

static void draw_mesh(const pbs_resolve *set, pbs_raster *r, const pbs_pair *pair, uint32_t d,
                      pbs_snapped *v) {
    const pbs_draw *draw = &set->draws[d];
    const pbs_mesh *mesh = draw->mesh;
    double m[12];
    int32_t box[4];
    if (!mesh->triangles || !mesh->vertices) return;
    pbs_pair_project(m, pair, draw->m);
    bool finite = pbs_raster_snap(m, mesh->position, mesh->vertices, r->simd, v, box);
    if (!pbs_raster_sees(r, box)) return;
    if (pbs_surfaces_may_ask(set->surfaces, mesh))
        draw_mixed(set, r, pair, d, v, finite);
    else
        pbs_raster_draw(r, v, mesh->index, mesh->triangles, set->first[d], finite);
}

static void tell(pbs_gbuffers *g, uint64_t drawn) {
    if (!g->progress) return;
    uint64_t done = __atomic_add_fetch(&g->done, drawn, __ATOMIC_RELAXED);
    pbs_run_progress(g->run, "drawing", done,
                     g->stats.triangles * (uint64_t)g->at.views.pairs * g->at.bands);
}

static pbs_code draw_all(pbs_gbuffers *g, pbs_raster *r, const pbs_pair *pair, pbs_snapped *v,
                         pbs_err *err) {
    uint64_t since = 0;
    pbs_code rc = PBS_OK;
    for (size_t d = 0; !rc && d < g->set.draw_count; d++) {
        draw_mesh(&g->set, r, pair, (uint32_t)d, v);
        since += g->set.draws[d].mesh->triangles;
        if (since < CHECK_EVERY && d + 1 < g->set.draw_count) continue;
        rc = pbs_run_check(g->run, err);
        tell(g, since);
        since = 0;
    }
    return rc;
}

/* A thread's buffers are taken when it gets its first piece of work. */
static pbs_code set_up(pbs_gbuffers *g, bench *b, pbs_err *err) {
    size_t keys = 2 * largest(&g->at, g->at.bands) + PBS_KEY_PAD, one = 0;
    pbs_code rc =
        make_room(g->run, &b->key, &b->keys, keys, sizeof *b->key, "the depth buffer", err);
    if (!rc)
        rc = make_room(g->run, &b->vertex, &b->vertices, g->vertices, sizeof *b->vertex,
                       "the vertices", err);
    if (!rc)
        rc = make_room(g->run, &b->column, &b->columns, widest(&g->at), sizeof *b->column, "a row",
                       err);
    if (!rc && !b->resolve)
        rc = make_room(g->run, &b->resolve, &one, 1, sizeof *b->resolve, "the placed meshes", err);
    return rc;
}

static pbs_code source(void *ctx, void *item, bool *end, pbs_err *err) {
    pbs_gbuffers *g = ctx;
    slot *s = item;
    (void)err;
    *end = g->next == (size_t)g->at.views.pairs * g->at.bands;
    if (*end) return PBS_OK;
    s->pair = (int)(g->next / g->at.bands);
    s->band = (uint32_t)(g->next++ % g->at.bands);
    return PBS_OK;
}

static pbs_code work(void *ctx, void *item, int thread, pbs_err *err) {
    pbs_gbuffers *g = ctx;
    slot *s = item;
    bench *b = &g->bench[thread];
    const pbs_pair *pair = &g->at.views.pair[s->pair];
    pbs_code rc = set_up(g, b, err);
    if (rc) return rc;
    pbs_raster r = {.key = b->key, .width = pair->width, .simd = pbs_raster_simd()};
    band_rows(&g->at, s->pair, s->band, &r.y0, &r.y1);
    pbs_raster_clear(&r);
    if ((rc = draw_all(g, &r, pair, b->vertex, err))) return rc;
    s->fragments = r.fragments;
    size_t room = (size_t)(r.y1 - r.y0) * r.width;
    room = r.fragments < room ? (size_t)r.fragments : room;
    if ((rc = make_points(g, s, room, err))) return rc;
    b->resolve->column = b->column;
    b->resolve->simd = r.simd;
    pbs_resolve_begin(b->resolve, &g->set, pair);
    pbs_resolve_band(b->resolve, &r, s->out);
    return PBS_OK;
}

/* ---- handing over ---- */

static pbs_code hand_over(pbs_gbuffers *g, int number, const pbs_resolve_out out[2], pbs_err *err) {
    const pbs_pair *p = &g->at.views.pair[number];
    pbs_code rc = PBS_OK;
    for (int odd = 0; !rc && odd < 2; odd++) {
        pbs_gbuffer_view view = {.view = 2 * number + odd,
                                 .width = p->width,
                                 .height = p->height,
                                 .pixel = p->pixel,
                                 .where = out[odd].where,
                                 .points = out[odd].points};
        for (int k = 0; k < 3; k++) {
            view.right[k] = odd ? -p->right[k] : p->right[k];
            view.up[k] = p->up[k];
            view.toward[k] = odd ? -p->toward[k] : p->toward[k];
        }
        g->stats.candidates += view.points.count;
        rc = g->sink(g->ctx, &view, err);
    }
    return rc;
}

static pbs_code drain(void *ctx, void *item, pbs_err *err) {
    pbs_gbuffers *g = ctx;
    slot *s = item;
    g->stats.fragments += s->fragments;
    if (g->at.bands == 1) return hand_over(g, s->pair, s->out, err);
    if (s->band == 0) {
        pbs_code rc = make_points(g, &g->whole, largest(&g->at, 1), err);
        if (rc) return rc;
    }
    for (int odd = 0; odd < 2; odd++) append(&g->whole.out[odd], &s->out[odd]);
    return s->band + 1 < g->at.bands ? PBS_OK : hand_over(g, s->pair, g->whole.out, err);
}

/* What the pipe does with one thread, without its price. */
static pbs_code alone(pbs_gbuffers *g, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (bool end = false; !rc;) {
        rc = source(g, g->slots, &end, err);
        if (end) break;
        if (!rc) rc = work(g, g->slots, 0, err);
        if (!rc) rc = drain(g, g->slots, err);
    }
    return rc;
}

/* ---- the entry ---- */

static uint64_t count_triangles(const pbs_draw *draws, size_t draw_count) {
    uint64_t n = 0;
    for (size_t i = 0; i < draw_count; i++) {
        const pbs_mesh *mesh = draws[i].mesh;
        n += mesh->vertices ? mesh->triangles : 0;
    }
    return n;
}

static uint32_t most_vertices(const pbs_draw *draws, size_t draw_count) {
    uint32_t most = 0;
    for (size_t i = 0; i < draw_count; i++) {
        const pbs_mesh *mesh = draws[i].mesh;
        if (mesh->triangles && mesh->vertices > most) most = mesh->vertices;
    }
    return most;
}

/* Numbers the triangles of all draws. */
static pbs_code number(pbs_gbuffers *g, const pbs_draw *draws, size_t draw_count, pbs_err *err) {
    if (draw_count >= UINT32_MAX) return pbs_fail(err, PBS_USAGE, "too many meshes in one picture");
    if (count_triangles(draws, draw_count) > UINT32_MAX - 1)
        return pbs_fail(err, PBS_USAGE, "more than 2^32 - 2 triangles in one picture");
    pbs_code rc = make_room(g->run, &g->first, &g->firsts, draw_count + 1, sizeof *g->first,
                            "the list of meshes", err);
    if (rc) return rc;
    g->first[0] = 0;
    for (size_t i = 0; i < draw_count; i++)
        g->first[i + 1] = g->first[i] + (uint32_t)count_triangles(draws + i, 1);
    g->stats.triangles = g->first[draw_count];
    return PBS_OK;
}

static pbs_code begin(pbs_gbuffers *g, const pbs_draw *draws, size_t draw_count,
                      const pbs_gbuffer_params *params, pbs_err *err) {
    uint32_t shown = params->channels & (PBS_COLOUR | PBS_MATERIAL | PBS_EMISSIVE);
    if (shown & ~g->surfaces->channels)
        return pbs_fail(err, PBS_USAGE, "the surfaces were not made for all of these channels");
    g->stats = (pbs_gbuffer_stats){0};
    pbs_code rc = number(g, draws, draw_count, err);
    if (!rc) rc = plan(&g->at, params, g->stats.triangles, g->threads, err);
    if (rc) return rc;
    g->set = (pbs_resolve){draws, draw_count, g->surfaces, g->first, params->channels};
    g->vertices = most_vertices(draws, draw_count);
    g->stats.pixel = g->at.views.pixel;
    g->progress = params->progress;
    g->done = 0, g->next = 0;
    return PBS_OK;
}

pbs_code pbs_gbuffer(pbs_gbuffers *g, const pbs_draw *draws, size_t draw_count,
                     const pbs_gbuffer_params *params,
                     pbs_code (*sink)(void *ctx, const pbs_gbuffer_view *view, pbs_err *err),
                     void *ctx, pbs_gbuffer_stats *stats, pbs_err *err) {
    pbs_code rc = begin(g, draws, draw_count, params, err);
    if (rc) return rc;
    g->sink = sink, g->ctx = ctx;
    pbs_pipe pipe = {.ctx = g,
                     .source = source,
                     .work = work,
                     .sink = drain,
                     .slots = g->slots,
                     .slot_size = sizeof g->slots[0],
                     .slot_count = (int)slot_count(&g->at)};
    rc = g->at.threads > 1 ? pbs_pipe_run(g->run, &pipe, err) : alone(g, err);
    if (!rc && stats) *stats = g->stats;
    return rc;
}

/* ---- buffers ---- */

pbs_code pbs_gbuffers_new(pbs_run *run, const pbs_surfaces *surfaces, int threads,
                          pbs_gbuffers **out, pbs_err *err) {
    pbs_gbuffers *g;
    *out = NULL;
    pbs_code rc = pbs_alloc(run, &g, 1, sizeof *g, "the views", err);
    if (rc) return rc;
    *g = (pbs_gbuffers){.run = run, .surfaces = surfaces};
    g->threads = threads > 1 ? thread_count(run->threads) : 1;
    size_t n = (size_t)g->threads;
    rc = pbs_alloc(run, &g->bench, n, sizeof *g->bench, "the threads", err);
    if (!rc) memset(g->bench, 0, n * sizeof *g->bench);
    if (!rc) rc = pbs_alloc(run, &g->slots, n + 1, sizeof *g->slots, "the list of views", err);
    if (!rc) memset(g->slots, 0, (n + 1) * sizeof *g->slots);
    if (rc)
        pbs_gbuffers_free(g);
    else
        *out = g;
    return rc;
}

static void free_slot(pbs_run *run, slot *s) {
    for (int i = 0; i < 2; i++) pbs_free(run, s->block[i]);
}

void pbs_gbuffers_free(pbs_gbuffers *g) {
    if (!g) return;
    pbs_run *run = g->run;
    for (int i = 0; g->bench && i < g->threads; i++) {
        pbs_free(run, g->bench[i].key);
        pbs_free(run, g->bench[i].vertex);
        pbs_free(run, g->bench[i].column);
        pbs_free(run, g->bench[i].resolve);
    }
    for (int i = 0; g->slots && i <= g->threads; i++) free_slot(run, &g->slots[i]);
    free_slot(run, &g->whole);
    pbs_free(run, g->slots);
    pbs_free(run, g->bench);
    pbs_free(run, g->first);
    pbs_free(run, g);
}

/* What an array of `bytes` takes, if one of `held` is there already. */
static size_t more(size_t bytes, size_t held) {
    const size_t head = 128;
    return held && held >= bytes ? 0 : bytes + head - held;
}

static size_t bench_need(const layout *at, const bench *b, size_t vertices) {
    size_t need = more(8 * (2 * largest(at, at->bands) + PBS_KEY_PAD), 8 * b->keys);
    need += more(sizeof(pbs_snapped) * vertices, sizeof(pbs_snapped) * b->vertices);
    need += more(4 * (size_t)widest(at), 4 * b->columns);
    return need + more(sizeof(pbs_resolve_scratch), b->resolve ? sizeof(pbs_resolve_scratch) : 0);
}

static size_t slot_need(const slot *s, size_t bytes) {
    return more(bytes, s->bytes[0]) + more(bytes, s->bytes[1]);
}

size_t pbs_gbuffer_need(const pbs_gbuffers *g, const pbs_draw *draws, size_t draw_count,
                        const pbs_gbuffer_params *params, int threads) {
    layout at;
    const bench no_bench = {0};
    const slot no_slot = {0};
    size_t t = (size_t)(g ? g->threads : thread_count(threads)), need = 0;
    uint32_t channels = params->channels;
    if (plan(&at, params, count_triangles(draws, draw_count), (int)t, NULL)) return 0;
    if (!g)
        need = more(sizeof *g, 0) + more(t * sizeof(bench), 0) + more((t + 1) * sizeof(slot), 0);
    need += more(4 * (draw_count + 1), g ? 4 * g->firsts : 0);
    size_t vertices = most_vertices(draws, draw_count);
    for (size_t i = 0; i < (size_t)at.threads; i++)
        need += bench_need(&at, g ? &g->bench[i] : &no_bench, vertices);
    for (size_t i = 0; i < slot_count(&at); i++)
        need +=
            slot_need(g ? &g->slots[i] : &no_slot, block_size(largest(&at, at.bands), channels));
    if (at.bands > 1)
        need += slot_need(g ? &g->whole : &no_slot, block_size(largest(&at, 1), channels));
    return need;
}
