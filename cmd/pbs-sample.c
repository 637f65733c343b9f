/* pbs-sample: candidates to ordered surfels (paper 1, sections 3.2 and 3.4), node by node. */
#include "cmd/quality.h"
#include "cmd/tool.h"
#include "formats/surfels/below.h"
#include "formats/surfels/exr.h"
#include "formats/scene/node.h"
#include "formats/surfels/points.h"
#include "libcore/gbuffer/lod.h"
#include "libcore/surfels/sample.h"
#include "libcore/measures/spacing.h"
#include <string.h>
#include <strings.h>

typedef struct options {
    uint64_t count, seed, subset;
    int method;
    double max_error, normal_weight;
    bool no_octaves;
    const char *measure, *cache;
    uint64_t cache_size;
} options;

static const char *const methods[] = {"greedy", "paper", "random", NULL}; /* as pbs_method */

static const pbs_option table[] = {
    {'n', "count", PBS_COUNT, offsetof(options, count), "N",
     "surfels of a node, at most (default: what pbs-gbuffer was told)", 1, 4e9, NULL, true},
    {'e', "max-error", PBS_REAL, offsetof(options, max_error), "E",
     "no more surfels than bring the error down to E, in the scene's unit", 1e-300, 1e300, NULL,
     true},
    {0, "method", PBS_CHOICE, offsetof(options, method), "METHOD", "how surfels are chosen", 0, 0,
     methods, true},
    {'w', "normal-weight", PBS_REAL, offsetof(options, normal_weight), "W",
     "0: plain Euclid, 1: opposite sides are far apart (default 1)", 0, 1, NULL, true},
    {0, "subset", PBS_COUNT, offsetof(options, subset), "N",
     "candidates a round of the paper's method looks at (default 200)", 1, 1e6, NULL, true},
    {0, "seed", PBS_COUNT, offsetof(options, seed), "N", "another first surfel (default 0)", 0,
     9e15, NULL, true},
    {0, "no-octaves", PBS_FLAG, offsetof(options, no_octaves), NULL,
     "write no averaged colours and normals for early prefixes", 0, 0, NULL, true},
    {0, "measure", PBS_TEXT, offsetof(options, measure), "FILE",
     "write measures of prefixes of every node as tab-separated values", 0, 0, NULL, false},
    {0, "cache", PBS_TEXT, offsetof(options, cache), "DIR",
     "keep results there, and reuse those of nodes that did not change", 0, 0, NULL, false},
    {0, "cache-size", PBS_BYTES, offsetof(options, cache_size), "SIZE",
     "what the cache may take (default 1G)", 0, 0, NULL, false},
};

static const pbs_tool tool = {"pbs-sample",
                              "Orders candidates into surfels of which every prefix covers evenly",
                              "[FILE | EXR...]",
                              0,
                              -1,
                              table,
                              sizeof table / sizeof table[0],
                              false};

typedef struct job {
    pbs_app *app;
    const options *o;
    pbs_writer *w;
    pbs_sampler *sampler;
    pbs_quality quality;
    pbs_cache *cache; /* or NULL */
    pbs_record in, out;
    pbs_points candidates; /* of the node that is being read */
    size_t cap;
    pbs_node *nodes; /* so far */
    uint64_t *used;  /* of each of them, as for pbs_plan_below */
    size_t node_count, nodes_cap, used_cap;
    pbs_keep *keep; /* NULL until a node asks for it */
    pbs_below *below;
    uint64_t total_in, total_out, duplicates, invalid, sampled, splats, cached;
    double covering, min_spacing, median, error;
    uint64_t short_of; /* nodes whose surfels do not reach the error that is asked for */
} job;

/* ---- one node ---- */

static void gather(const pbs_points *from, const uint32_t *order, const float *spacing,
                   pbs_points *to) {
    for (size_t i = 0; i < to->count; i++) {
        size_t k = order[i];
        memcpy(to->position + 3 * i, from->position + 3 * k, 12);
        to->spacing[i] = spacing[i];
        if (to->normal) memcpy(to->normal + 2 * i, from->normal + 2 * k, 4);
        if (to->colour) memcpy(to->colour + 4 * i, from->colour + 4 * k, 4);
        if (to->material) memcpy(to->material + 4 * i, from->material + 4 * k, 4);
        if (to->emissive) memcpy(to->emissive + 4 * i, from->emissive + 4 * k, 4);
    }
}

/* How far the surface can be from the node's surfels: the candidates lie on it a pixel apart. */
static double error_of(const pbs_node *node, double covering) {
    return covering + PBS_LOD_SLACK * node->pixel;
}

static void add_totals(job *j, const pbs_node *node, const pbs_sample_result *r,
                       const pbs_points *surfels, const pbs_spacing *even) {
    double error = error_of(node, r->covering);
    j->error = fmax(j->error, error);
    j->short_of += j->o->max_error > 0 && error > j->o->max_error;
    j->sampled++;
    j->total_in += j->candidates.count;
    j->total_out += r->count;
    j->duplicates += r->duplicates;
    j->invalid += r->invalid;
    /* Of the last node, which is the root or what it is a wrapper of. */
    j->covering = r->covering;
    j->median = even->median;
    j->min_spacing = NAN;
    for (size_t i = 1; i < surfels->count; i++)
        if (!(j->min_spacing <= surfels->spacing[i])) j->min_spacing = surfels->spacing[i];
}

static pbs_code keep(job *j, uint32_t node, const pbs_points *surfels, double covering,
                     pbs_err *err) {
    pbs_run *run = &j->app->run;
    pbs_code rc = PBS_OK;
    if (!j->keep) rc = pbs_keep_new(run, j->out.channels, &j->keep, err);
    if (!rc && !j->below) rc = pbs_below_new(run, j->keep, &j->below, err);
    return rc ? rc : pbs_keep_put(j->keep, node, surfels, covering, err);
}

static pbs_code emit(job *j, pbs_node *node, const uint32_t *order, const float *spacing,
                     const pbs_sample_result *r, pbs_err *err) {
    pbs_points surfels;
    pbs_spacing even;
    pbs_run *run = &j->app->run;
    pbs_code rc = pbs_points_alloc(run, j->out.channels, r->count, &surfels, err);
    if (rc) return rc;
    gather(&j->candidates, order, spacing, &surfels);
    pbs_spacing_of_prefix(&surfels, &even);
    rc = pbs_points_write(run, j->w, &j->out, node->id, &surfels, 0, PBS_POINTS_CHUNK, NULL, err);
    if (!rc && node->flags & PBS_NODE_USED) rc = keep(j, node->id, &surfels, r->covering, err);
    add_totals(j, node, r, &surfels, &even);
    pbs_points_free(run, &surfels);
    node->records = r->count;
    node->flags = node->wanted = 0;
    node->covering = r->covering;
    node->median = even.median;
    node->median_count = even.count;
    if (!rc)
        rc = pbs_quality_node(&j->quality, j->w, node, j->sampler, &j->candidates, order, spacing,
                              r->count, err);
    return rc ? rc : pbs_node_write(run, j->w, node, err);
}

/* What the user asks for, but not more than the node should have. */
static size_t count_of(const job *j, const pbs_node *node) {
    uint64_t n = j->o->count ? j->o->count : node->wanted ? node->wanted : PBS_LOD_DEFAULT.most;
    return node->wanted && node->wanted < n ? node->wanted : (size_t)n;
}

/* The node's number is not among them: a node is sampled alike wherever it comes in a stream, so
 * that the cache finds it after parts were added before it. */
static pbs_sample_params params_of(const job *j, const pbs_node *node) {
    double radius = j->o->max_error - error_of(node, 0);
    return (pbs_sample_params){.radius = radius > 0 ? (float)fmin(radius, 3e38) : 0,
                               .count = count_of(j, node),
                               .method = (pbs_method)j->o->method,
                               .normal_weight = (float)j->o->normal_weight,
                               .seed = j->o->seed,
                               .subset = (uint32_t)j->o->subset};
}

/* From the cache, or made and put there. */
static pbs_code choose(job *j, const pbs_sample_params *p, size_t room, uint32_t *order,
                       float *spacing, pbs_sample_result *r, pbs_err *err) {
    const pbs_points *in = &j->candidates;
    bool found = false;
    if (!j->cache) return pbs_sample(j->sampler, in, p, order, spacing, r, err);
    pbs_cache_key key = pbs_cache_sample_key(in, p);
    pbs_code rc = PBS_OK;
    pbs_quality_key(&j->quality, &key, in);
    if (pbs_cache_find_sample(j->cache, &key, in, room, order, spacing, r))
        rc = pbs_quality_find(&j->quality, in, r->count, &found, err);
    if (rc || found) {
        j->cached += found;
        return rc;
    }
    rc = pbs_sample(j->sampler, in, p, order, spacing, r, err);
    if (!rc) rc = pbs_cache_store_sample(j->cache, &key, order, spacing, r, err);
    return rc;
}

static pbs_code sample_node(job *j, pbs_node *node, pbs_err *err) {
    pbs_run *run = &j->app->run;
    pbs_sample_params p = params_of(j, node);
    size_t n = j->candidates.count < p.count ? j->candidates.count : (size_t)p.count;
    uint32_t *order = NULL;
    float *spacing = NULL;
    pbs_sample_result r;
    /* For few candidates a second thread costs more than it saves: 4 % over 222 nodes. */
    int threads = run->threads;
    if (j->candidates.count < 100000) run->threads = 1;
    pbs_code rc =
        pbs_mem_plan(run,
                     pbs_sample_need(j->candidates.count, &p) + n * (8 + j->out.stride) +
                         pbs_quality_need(&j->quality, j->in.channels, j->candidates.count, n),
                     "the sampler", err);
    if (!rc) rc = pbs_alloc(run, &order, n, sizeof *order, "the order", err);
    if (!rc) rc = pbs_alloc(run, &spacing, n, sizeof *spacing, "the spacing", err);
    if (!rc) rc = choose(j, &p, n, order, spacing, &r, err);
    if (!rc) rc = emit(j, node, order, spacing, &r, err);
    run->threads = threads;
    pbs_free(run, order);
    pbs_free(run, spacing);
    j->candidates.count = 0;
    return rc;
}

/* ---- a stream of nodes ---- */

static pbs_code open_writer(job *j, const char *history, pbs_err *err) {
    char channels[256];
    j->out = pbs_record_make(j->in.channels | PBS_SPACING, false);
    pbs_record_text(&j->out, channels);
    return pbs_writer_open(&j->app->run,
                           &(pbs_writer_desc){.path = j->app->common.output,
                                              .kind = PBS_SURFELS,
                                              .channels = channels,
                                              .history = history,
                                              .stage = j->app->stage},
                           &j->w, err);
}

static pbs_code take_points(job *j, const char *name, const pbs_chunk *c, pbs_err *err) {
    if (c->node != j->node_count)
        return pbs_fail(err, PBS_DATA, "%s: points of node %u where %llu is expected", name,
                        c->node, (unsigned long long)j->node_count);
    pbs_code rc = pbs_points_fit(name, &j->in, c, j->candidates.count, err);
    if (!rc)
        rc = pbs_points_grow(&j->app->run, j->in.channels, &j->candidates, &j->cap,
                             j->candidates.count + c->count, err);
    return rc ? rc : pbs_points_read(name, &j->in, c, &j->candidates, NULL, err);
}

/* What later nodes have to know of this one. */
static pbs_code note_node(job *j, const pbs_node *node, pbs_err *err) {
    pbs_run *run = &j->app->run;
    size_t n = j->node_count + 1;
    pbs_code rc = pbs_grow(run, &j->nodes, &j->nodes_cap, n, sizeof *j->nodes, "the nodes", err);
    if (!rc) rc = pbs_grow(run, &j->used, &j->used_cap, n, sizeof *j->used, "the nodes", err);
    if (rc) return rc;
    uint64_t used = node->wanted != 0;
    for (uint32_t i = 0; i < node->child_count; i++) {
        const pbs_child *c = &node->children[i];
        if (c->flags & PBS_CHILD_MOVES) continue;
        if (__builtin_add_overflow(used, j->used[c->node], &used)) used = UINT64_MAX;
    }
    j->used[j->node_count] = used;
    j->nodes[j->node_count++] = *node;
    return PBS_OK;
}

/* Surfels of the nodes below, as candidates beside those of the node's own geometry. */
static pbs_code add_below(job *j, const pbs_node *node, pbs_err *err) {
    if (!(node->flags & PBS_NODE_BELOW) || !j->below) return PBS_OK;
    return pbs_below_add(j->below, j->nodes, j->used, node->id, j->in.channels, &j->candidates,
                         &j->cap, &j->splats, err);
}

static pbs_code take_node(job *j, const char *name, const pbs_chunk *c, pbs_err *err) {
    pbs_node node;
    pbs_code rc = pbs_node_read(&j->app->run, name, c, (uint32_t)j->node_count, &node, err);
    if (rc) return rc;
    if (node.records != j->candidates.count)
        rc = pbs_fail(err, PBS_DATA, "%s: node %u has %llu points and not %llu", name, node.id,
                      (unsigned long long)j->candidates.count, (unsigned long long)node.records);
    if (!rc) rc = note_node(j, &node, err);
    if (rc) {
        pbs_node_free(&j->app->run, &node);
        return rc;
    }
    rc = add_below(j, &node, err);
    if (!rc && j->candidates.count)
        rc = sample_node(j, &node, err);
    else if (!rc) {
        node.flags = 0;
        rc = pbs_node_write(&j->app->run, j->w, &node, err);
    }
    return rc;
}

/* What this program does not know it passes on. */
static pbs_code take_other(job *j, const pbs_chunk *c, pbs_err *err) {
    pbs_piece piece = {c->payload, (size_t)c->bytes};
    return pbs_writer_chunk(j->w, c, &piece, 1, err);
}

/* A file's directory tells how large its largest node is: room for it is made at once, and a limit
 * that is too small is refused before anything is read. A pipe has to be read to know. */
static pbs_code make_room(job *j, pbs_reader *r, pbs_err *err) {
    const pbs_chunk *e;
    size_t n;
    uint64_t most = 0, points = 0;
    if (!pbs_reader_mapped(r)) return PBS_OK;
    pbs_code rc = pbs_reader_directory(r, &e, &n, err);
    for (size_t i = 0; i < n && !rc; i++) {
        points =
            e[i].tag == PBS_TAG_NODE ? 0 : points + (e[i].tag == PBS_TAG_POINTS ? e[i].count : 0);
        most = points > most ? points : most;
    }
    if (rc || most > pbs_reader_bytes(r)) return rc; /* a damaged directory promises nothing */
    pbs_sample_params p = params_of(j, &(pbs_node){0});
    size_t wanted = most < p.count ? (size_t)most : p.count;
    size_t buffers = (size_t)2 << 20;
    rc = pbs_mem_plan(&j->app->run,
                      (size_t)most * j->in.stride + pbs_sample_need((size_t)most, &p) +
                          wanted * (8 + j->out.stride) +
                          pbs_quality_need(&j->quality, j->in.channels, (size_t)most, wanted) +
                          buffers,
                      pbs_reader_name(r), err);
    return rc ? rc
              : pbs_points_grow(&j->app->run, j->in.channels, &j->candidates, &j->cap, (size_t)most,
                                err);
}

static pbs_code sample_stream(job *j, pbs_err *err) {
    pbs_reader *r;
    pbs_code rc = pbs_reader_open_path(&j->app->run, pbs_operand(j->app, 0),
                                       PBS_KIND(PBS_CANDIDATES), &r, err);
    if (rc) return rc;
    const char *name = pbs_reader_name(r);
    rc = pbs_record_parse(name, pbs_reader_channels(r), &j->in, err);
    if (!rc && (j->in.packed || j->in.channels & PBS_SPACING))
        rc = pbs_fail(err, PBS_DATA, "%s: candidates with channels of surfels", name);
    if (!rc) rc = open_writer(j, pbs_reader_history(r), err);
    if (!rc) rc = make_room(j, r, err);
    for (bool end = false; !rc;) {
        pbs_chunk c;
        rc = pbs_reader_next(r, &c, &end, err);
        if (rc || end) break;
        if (c.tag == PBS_TAG_POINTS)
            rc = take_points(j, name, &c, err);
        else if (c.tag == PBS_TAG_NODE)
            rc = take_node(j, name, &c, err);
        else
            rc = take_other(j, &c, err);
    }
    if (!rc && (j->candidates.count || !j->node_count))
        rc = pbs_fail(err, PBS_DATA, "%s: %s", name,
                      j->node_count ? "points without a node" : "no node in it");
    pbs_reader_close(r);
    return rc;
}

/* ---- EXR files: one node of all views ---- */

static bool is_exr(const char *path) {
    size_t n = path ? strlen(path) : 0;
    return n > 4 && !strcasecmp(path + n - 4, ".exr");
}

static pbs_code sample_exr(job *j, pbs_err *err) {
    pbs_run *run = &j->app->run;
    pbs_node node = {.name = "", .box = PBS_BOX_EMPTY};
    pbs_code rc = PBS_OK;
    for (int i = 0; i < j->app->common.operand_count && !rc; i++)
        rc = pbs_exr_read_views(run, pbs_operand(j->app, i), &j->in.channels, &j->candidates,
                                &j->cap, node.origin, err);
    if (!rc && !j->candidates.count)
        rc = pbs_fail(err, PBS_DATA, "%s: no pixel is covered", pbs_operand(j->app, 0));
    if (!rc) rc = open_writer(j, NULL, err);
    if (rc) return rc;
    for (size_t i = 0; i < j->candidates.count; i++) {
        const float *p = j->candidates.position + 3 * i;
        double v[3];
        for (int k = 0; k < 3; k++) v[k] = node.origin[k] + p[k];
        /* What is not finite is left out and counted by the sampler. */
        if (isfinite(v[0]) && isfinite(v[1]) && isfinite(v[2])) pbs_box_add(&node.box, v);
    }
    return sample_node(j, &node, err);
}

static void add_stats(job *j) {
    pbs_app *app = j->app;
    char channels[256];
    pbs_stat_count(app, "nodes", j->node_count);
    pbs_stat_count(app, "nodes_sampled", j->sampled);
    if (j->o->cache) pbs_stat_count(app, "nodes_cached", j->cached);
    if (j->splats) pbs_stat_count(app, "surfels_splatted", j->splats);
    pbs_stat_count(app, "candidates", j->total_in);
    pbs_stat_count(app, "surfels", j->total_out);
    pbs_stat_count(app, "candidates_coincident", j->duplicates);
    pbs_stat_count(app, "candidates_invalid", j->invalid);
    pbs_stat_real(app, "error_largest", j->error);
    if (j->o->max_error > 0) pbs_stat_count(app, "nodes_short", j->short_of);
    pbs_stat_real(app, "covering_radius", j->covering);
    pbs_stat_real(app, "min_spacing", isfinite(j->min_spacing) ? j->min_spacing : 0);
    pbs_stat_real(app, "median_spacing_1000", j->median);
    pbs_record_text(&j->out, channels);
    pbs_stat_record(app, channels, j->out.stride);
    pbs_stat_count(app, "bytes", pbs_writer_bytes(j->w));
    if (j->short_of)
        pbs_note(app,
                 "%llu of %llu nodes have errors up to %g: give pbs-gbuffer the same --max-error "
                 "and a larger -n",
                 (unsigned long long)j->short_of, (unsigned long long)j->sampled, j->error);
    if (j->invalid)
        pbs_note(app, "left out: %llu candidates with NaN or infinite positions",
                 (unsigned long long)j->invalid);
}

static pbs_code sample_all(job *j, pbs_err *err) {
    pbs_app *app = j->app;
    if (j->o->max_error > 0 && j->o->method != PBS_GREEDY)
        return pbs_fail(err, PBS_USAGE, "--max-error: only --method greedy knows its error");
    if (is_exr(pbs_operand(app, 0))) return sample_exr(j, err);
    if (app->common.operand_count > 1)
        return pbs_fail(err, PBS_USAGE, "%s: one file of candidates, or any number of EXR files",
                        pbs_operand(app, 1));
    return sample_stream(j, err);
}

static pbs_code work(pbs_app *app, void *opt, pbs_err *err) {
    job j = {.app = app, .o = opt, .min_spacing = NAN};
    pbs_code rc = PBS_OK;
    if (j.o->cache) rc = pbs_cache_open(&app->run, j.o->cache, j.o->cache_size, &j.cache, err);
    j.quality = (pbs_quality){.cache = j.cache,
                              .run = &app->run,
                              .octaves = !j.o->no_octaves,
                              .measure = j.o->measure,
                              .normal_weight = (float)j.o->normal_weight};
    if (!rc) rc = pbs_sampler_new(&app->run, &j.sampler, err);
    if (!rc) rc = pbs_quality_open(&j.quality, err);
    if (!rc) rc = sample_all(&j, err);
    if (!rc) rc = pbs_writer_commit(j.w, err);
    if (!rc) rc = pbs_quality_commit(&j.quality, err);
    if (!rc) add_stats(&j);
    pbs_writer_close(j.w);
    pbs_quality_close(&j.quality);
    pbs_points_free(&app->run, &j.candidates);
    pbs_sampler_free(j.sampler);
    for (size_t i = 0; i < j.node_count; i++) pbs_node_free(&app->run, &j.nodes[i]);
    pbs_free(&app->run, j.nodes);
    pbs_free(&app->run, j.used);
    pbs_below_free(j.below);
    pbs_keep_free(j.keep);
    pbs_cache_totals t = pbs_cache_close(j.cache);
    if (!rc && t.trouble[0]) pbs_note(app, "nothing more was put into the cache: %s", t.trouble);
    return rc;
}

int main(int argc, char **argv) {
    options o = {.normal_weight = 1, .subset = 200, .cache_size = 1000000000};
    return pbs_tool_main(argc, argv, &tool, &o, work);
}
