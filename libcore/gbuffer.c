/* gbuffer.c: the views of a node, their size, and the work spread over threads (paper 1, section
 * 3.1). A pair of opposite views is one piece of work; with more threads than pairs, so is a band
 * of its rows. Drawing is in raster.c, what becomes of a pixel in resolve.c and shade.c.
 */
#include "libcore/gbuffer.h"
#include "libcore/pipe.h"
#include "libcore/resolve.h"

#define MAX_THREADS 256
#define CHECK_EVERY (1 << 16) /* triangles between two looks at the cancel flag */

typedef struct layout {
    pbs_views views;
    uint32_t bands; /* of each pair */
} layout;

/* A thread's own. */
typedef struct bench {
    uint64_t *key;
    pbs_snapped *vertex;
    pbs_resolve_scratch *resolve;
    uint32_t *column;
} bench;

/* A band of a pair on its way from the work to the sink. */
typedef struct slot {
    int pair;
    uint32_t band;
    uint64_t fragments;
    size_t room; /* points in each block */
    void *block[2];
    pbs_resolve_out out[2];
} slot;

typedef struct job {
    pbs_run *run;
    const pbs_gbuffer_scene *scene;
    layout at;
    pbs_shader shader;
    pbs_resolve set;
    uint32_t *first;
    uint32_t channels, vertices;
    uint64_t triangles, done;
    bench bench[MAX_THREADS];
    slot slots[MAX_THREADS + 1], whole; /* whole: a pair put together from its bands */
    size_t next;
    pbs_code (*sink)(void *ctx, const pbs_gbuffer_view *view, pbs_err *err);
    void *ctx;
    pbs_gbuffer_stats stats;
} job;

/* ---- sizes ---- */

static pbs_code plan(layout *at, const pbs_gbuffer_params *params, int threads, pbs_err *err) {
    pbs_code rc = pbs_views_plan(params, &at->views, err);
    if (rc) return rc;
    at->bands = (uint32_t)((threads + at->views.pairs - 1) / at->views.pairs);
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

static int thread_count(int threads) {
    return threads < 1 ? 1 : threads > MAX_THREADS ? MAX_THREADS : threads;
}

/* One more than threads, so that nobody waits for the view whose turn it is. */
static size_t slot_count(const layout *at, int threads) {
    size_t n = (size_t)at->views.pairs * at->bands, most = threads > 1 ? (size_t)threads + 1 : 1;
    return n < most ? n : most;
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
static pbs_code make_room(job *j, slot *s, size_t room, pbs_err *err) {
    for (int i = 0; i < 2; i++) {
        if (room > s->room || !s->block[i]) {
            pbs_free(j->run, s->block[i]);
            pbs_code rc = pbs_alloc(j->run, &s->block[i], block_size(room, j->channels), 1,
                                    "the candidates of a view", err);
            if (rc) {
                s->room = 0;
                return rc;
            }
        }
    }
    s->room = room > s->room ? room : s->room;
    for (int i = 0; i < 2; i++) lay_out(&s->out[i], s->block[i], s->room, j->channels);
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
    const pbs_shader *shader;
    pbs_placed place;
    uint32_t triangle;
    pbs_lanes lanes;
} question;

static bool ask(void *ctx, uint32_t x, uint32_t y) {
    question *q = ctx;
    pbs_resolve_one(&q->place, q->triangle, x, y, &q->lanes);
    return pbs_shader_keep(q->shader, &q->lanes, 0);
}

/* A mesh that may have masked triangles: runs of others between them. */
static void draw_mixed(const job *j, pbs_raster *r, const pbs_pair *pair, uint32_t d,
                       const pbs_snapped *v, bool finite) {
    const pbs_mesh *mesh = j->scene->draws[d].mesh;
    question q;
    q.shader = &j->shader, q.place.draw = NULL;
    uint32_t run = 0, first = j->first[d];
    for (uint32_t i = 0; i < mesh->triangles; i++) {
        if (!pbs_shader_asks(&j->shader, mesh, i)) continue;
        if (!q.place.draw) pbs_place(&q.place, pair, &j->scene->draws[d], d, first);
        pbs_raster_draw(r, v, mesh->index + 3 * (size_t)run, i - run, first + run, finite);
        q.triangle = i;
        pbs_raster_draw_masked(r, v, mesh->index + 3 * (size_t)i, first + i, ask, &q);
        run = i + 1;
    }
    pbs_raster_draw(r, v, mesh->index + 3 * (size_t)run, mesh->triangles - run, first + run,
                    finite);
}

static pbs_code draw_all(job *j, pbs_raster *r, const pbs_pair *pair, pbs_snapped *v,
                         pbs_err *err) {
    uint64_t since = 0, total = j->triangles * (uint64_t)j->at.views.pairs * j->at.bands;
    for (size_t d = 0; d < j->scene->draw_count; d++) {
        const pbs_draw *draw = &j->scene->draws[d];
        const pbs_mesh *mesh = draw->mesh;
        double m[12];
        int32_t box[4];
        if (!mesh->triangles || !mesh->vertices) continue;
        pbs_pair_project(m, pair, draw->m);
        bool finite = pbs_raster_snap(m, mesh->position, mesh->vertices, r->simd, v, box);
        if (!pbs_raster_sees(r, box)) {
        } else if (j->shader.masked)
            draw_mixed(j, r, pair, (uint32_t)d, v, finite);
        else
            pbs_raster_draw(r, v, mesh->index, mesh->triangles, j->first[d], finite);
        since += mesh->triangles;
        if (since < CHECK_EVERY && d + 1 < j->scene->draw_count) continue;
        pbs_code rc = pbs_run_check(j->run, err);
        if (rc) return rc;
        uint64_t done = __atomic_add_fetch(&j->done, since, __ATOMIC_RELAXED);
        pbs_run_progress(j->run, "drawing", done, total);
        since = 0;
    }
    return PBS_OK;
}

/* A thread's buffers are taken when it gets its first piece of work. */
static pbs_code set_up(job *j, bench *b, pbs_err *err) {
    if (b->resolve) return PBS_OK;
    size_t keys = 2 * largest(&j->at, j->at.bands) + PBS_KEY_PAD;
    pbs_code rc = PBS_OK;
    if (!b->key) rc = pbs_alloc(j->run, &b->key, keys, sizeof *b->key, "the depth buffer", err);
    if (!rc && !b->vertex)
        rc = pbs_alloc(j->run, &b->vertex, j->vertices, sizeof *b->vertex, "the vertices", err);
    if (!rc && !b->column)
        rc = pbs_alloc(j->run, &b->column, widest(&j->at), sizeof *b->column, "a row", err);
    if (!rc) rc = pbs_alloc(j->run, &b->resolve, 1, sizeof *b->resolve, "the placed meshes", err);
    return rc;
}

static pbs_code source(void *ctx, void *item, bool *end, pbs_err *err) {
    job *j = ctx;
    slot *s = item;
    (void)err;
    *end = j->next == (size_t)j->at.views.pairs * j->at.bands;
    if (*end) return PBS_OK;
    s->pair = (int)(j->next / j->at.bands);
    s->band = (uint32_t)(j->next++ % j->at.bands);
    return PBS_OK;
}

static pbs_code work(void *ctx, void *item, int thread, pbs_err *err) {
    job *j = ctx;
    slot *s = item;
    bench *b = &j->bench[thread];
    const pbs_pair *pair = &j->at.views.pair[s->pair];
    pbs_code rc = set_up(j, b, err);
    if (rc) return rc;
    pbs_raster r = {.key = b->key, .width = pair->width, .simd = pbs_raster_simd()};
    band_rows(&j->at, s->pair, s->band, &r.y0, &r.y1);
    pbs_raster_clear(&r);
    if ((rc = draw_all(j, &r, pair, b->vertex, err))) return rc;
    s->fragments = r.fragments;
    size_t room = (size_t)(r.y1 - r.y0) * r.width;
    room = r.fragments < room ? (size_t)r.fragments : room;
    if ((rc = make_room(j, s, room, err))) return rc;
    b->resolve->column = b->column;
    b->resolve->simd = r.simd;
    pbs_resolve_begin(b->resolve, &j->set, pair);
    pbs_resolve_band(b->resolve, &r, s->out);
    return PBS_OK;
}

/* ---- handing over ---- */

static pbs_code hand_over(job *j, int number, const pbs_resolve_out out[2], pbs_err *err) {
    const pbs_pair *p = &j->at.views.pair[number];
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
        j->stats.candidates += view.points.count;
        rc = j->sink(j->ctx, &view, err);
    }
    return rc;
}

static pbs_code drain(void *ctx, void *item, pbs_err *err) {
    job *j = ctx;
    slot *s = item;
    j->stats.fragments += s->fragments;
    if (j->at.bands == 1) return hand_over(j, s->pair, s->out, err);
    if (s->band == 0) {
        pbs_code rc = make_room(j, &j->whole, largest(&j->at, 1), err);
        if (rc) return rc;
    }
    for (int odd = 0; odd < 2; odd++) append(&j->whole.out[odd], &s->out[odd]);
    return s->band + 1 < j->at.bands ? PBS_OK : hand_over(j, s->pair, j->whole.out, err);
}

static void free_slot(job *j, slot *s) {
    for (int i = 0; i < 2; i++) pbs_free(j->run, s->block[i]);
}

static void free_job(job *j) {
    pbs_run *run = j->run;
    for (int i = 0; i < MAX_THREADS; i++) {
        pbs_free(run, j->bench[i].key);
        pbs_free(run, j->bench[i].vertex);
        pbs_free(run, j->bench[i].column);
        pbs_free(run, j->bench[i].resolve);
    }
    for (int i = 0; i <= MAX_THREADS; i++) free_slot(j, &j->slots[i]);
    free_slot(j, &j->whole);
    pbs_shader_free(run, &j->shader);
    pbs_free(run, j->first);
    pbs_free(run, j);
}

/* Numbers the triangles of all draws; finds the largest mesh. */
static pbs_code number(job *j, pbs_err *err) {
    const pbs_gbuffer_scene *scene = j->scene;
    if (scene->draw_count >= UINT32_MAX)
        return pbs_fail(err, PBS_USAGE, "too many meshes for one picture");
    pbs_code rc = pbs_alloc(j->run, &j->first, scene->draw_count + 1, sizeof *j->first,
                            "the list of meshes", err);
    if (rc) return rc;
    j->first[0] = 0;
    for (size_t i = 0; i < scene->draw_count; i++) {
        const pbs_mesh *mesh = scene->draws[i].mesh;
        if (mesh->vertices) j->triangles += mesh->triangles;
        if (mesh->triangles && mesh->vertices > j->vertices) j->vertices = mesh->vertices;
        if (j->triangles > UINT32_MAX - 1)
            return pbs_fail(err, PBS_USAGE, "more than 2^32 - 2 triangles in one picture");
        j->first[i + 1] = (uint32_t)j->triangles;
    }
    return PBS_OK;
}

size_t pbs_gbuffer_need(const pbs_gbuffer_scene *scene, const pbs_gbuffer_params *params,
                        int threads) {
    layout at;
    size_t vertices = 0, t = (size_t)thread_count(threads);
    if (plan(&at, params, (int)t, NULL)) return 0;
    for (size_t i = 0; i < scene->draw_count; i++)
        if (scene->draws[i].mesh->vertices > vertices) vertices = scene->draws[i].mesh->vertices;
    size_t pieces = (size_t)at.views.pairs * at.bands, head = 128;
    size_t own = 16 * largest(&at, at.bands) + 8 * PBS_KEY_PAD + sizeof(pbs_snapped) * vertices +
                 4 * (size_t)widest(&at) + sizeof(pbs_resolve_scratch) + 4 * head;
    size_t need = sizeof(job) + 4 * (scene->draw_count + 1) + 2 * head;
    need += pbs_shader_need(scene, params->channels);
    need += (t < pieces ? t : pieces) * own;
    need +=
        slot_count(&at, (int)t) * 2 * (block_size(largest(&at, at.bands), params->channels) + head);
    if (at.bands > 1) need += 2 * (block_size(largest(&at, 1), params->channels) + head);
    return need;
}

pbs_code pbs_gbuffer(pbs_run *run, const pbs_gbuffer_scene *scene, const pbs_gbuffer_params *params,
                     pbs_code (*sink)(void *ctx, const pbs_gbuffer_view *view, pbs_err *err),
                     void *ctx, pbs_gbuffer_stats *stats, pbs_err *err) {
    job *j;
    int threads = thread_count(run->threads);
    pbs_code rc = pbs_alloc(run, &j, 1, sizeof *j, "the list of views", err);
    if (rc) return rc;
    memset(j, 0, sizeof *j);
    j->run = run, j->scene = scene, j->channels = params->channels;
    j->sink = sink, j->ctx = ctx;
    rc = plan(&j->at, params, threads, err);
    if (!rc) rc = number(j, err);
    if (!rc) rc = pbs_shader_init(run, &j->shader, scene, params->channels, err);
    j->set = (pbs_resolve){scene, &j->shader, j->first, params->channels};
    j->stats.triangles = j->triangles;
    j->stats.pixel = j->at.views.pixel;
    if (!rc) {
        pbs_pipe pipe = {.ctx = j,
                         .source = source,
                         .work = work,
                         .sink = drain,
                         .slots = j->slots,
                         .slot_size = sizeof j->slots[0],
                         .slot_count = (int)slot_count(&j->at, threads)};
        rc = pbs_pipe_run(run, &pipe, err);
    }
    if (!rc && stats) *stats = j->stats;
    free_job(j);
    return rc;
}
