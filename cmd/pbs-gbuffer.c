/* pbs-gbuffer: what can be seen of a scene's nodes from outside, as candidates (paper 1, sections
 * 3.1 and 3.4). */
#include "cmd/notes.h"
#include "cmd/tool.h"
#include "formats/surfels/exr.h"
#include "formats/surfels/hierarchy.h"
#include "formats/surfels/points.h"
#include "libcore/gbuffer/gbuffer.h"
#include <stdio.h>
#include <string.h>

typedef struct options {
    uint64_t resolution, count, least;
    double share, max_error;
    int directions;
    const char *exr;
    bool ignore_missing, top_down, keep_going;
} options;

enum { CORNERS, FACES, BOTH };
static const char *const direction_names[] = {"corners", "faces", "both", NULL};

static const pbs_option table[] = {
    {'n', "count", PBS_COUNT, offsetof(options, count), "N",
     "surfels that a node gets at most (default 200k)", 1, 1e9, NULL, true},
    {0, "least", PBS_COUNT, offsetof(options, least), "N",
     "triangles of a node below which it gets none (default 1000)", 1, 1e15, NULL, true},
    {0, "share", PBS_REAL, offsetof(options, share), "X",
     "surfels for each triangle, at most (default 0.5)", 0, 1e6, NULL, true},
    {0, "top-down", PBS_FLAG, offsetof(options, top_down), NULL,
     "draw the geometry of every node, use no surfels of those below", 0, 0, NULL, true},
    {'r', "resolution", PBS_COUNT, offsetof(options, resolution), "N",
     "pixels along the longest side of a view (default: from -n)", 1, PBS_GBUFFER_MAX_SIZE, NULL,
     true},
    {'e', "max-error", PBS_REAL, offsetof(options, max_error), "E",
     "no more pixels than surfels with an error of E need, in the scene's unit", 1e-300, 1e300,
     NULL, true},
    {'d', "directions", PBS_CHOICE, offsetof(options, directions), "SET", "views from", 0, 0,
     direction_names, true},
    {0, "exr", PBS_TEXT, offsetof(options, exr), "DIR", "also write the buffers as OpenEXR files",
     0, 0, NULL, false},
    {0, "ignore-missing", PBS_FLAG, offsetof(options, ignore_missing), NULL,
     "go on without textures that are not there", 0, 0, NULL, true},
    {0, "keep-going", PBS_FLAG, offsetof(options, keep_going), NULL,
     "leave out what fails, and end with status 65", 0, 0, NULL, true},
};

static const pbs_tool tool = {"pbs-gbuffer",
                              "Renders a scene's nodes from outside into candidates for surfels",
                              "[FILE]",
                              0,
                              1,
                              table,
                              sizeof table / sizeof table[0],
                              false};

typedef struct job {
    pbs_app *app;
    const options *o;
    pbs_scene scene;
    pbs_image *images;
    pbs_gbuffer_params params;
    pbs_plan plan;
    pbs_draw *draws;
    size_t cap;
    pbs_surfaces *surfaces;
    pbs_gbuffers *buffers;
    pbs_writer *w;
    pbs_record record;
    uint32_t node;    /* that is being drawn */
    uint64_t written; /* candidates of it */
    uint64_t drawn, placings;
    pbs_failures failures;
    pbs_gbuffer_stats total;
} job;

/* ---- one node ---- */

/* A scene of one node has its views in DIR, of several in DIR/NODE. */
static pbs_code write_exr(job *j, const pbs_gbuffer_view *view, pbs_err *err) {
    char dir[4096];
    bool single = j->plan.wanted == 1;
    int n = single ? snprintf(dir, sizeof dir, "%s", j->o->exr)
                   : snprintf(dir, sizeof dir, "%s/%u", j->o->exr, j->node);
    if (n >= (int)sizeof dir) return pbs_fail(err, PBS_USAGE, "%s: too long", j->o->exr);
    pbs_code rc = single ? PBS_OK : pbs_exr_folder(j->o->exr, err);
    return rc ? rc
              : pbs_exr_write_view(&j->app->run, dir, j->plan.nodes[j->node].origin, view, err);
}

static pbs_code take_view(void *ctx, const pbs_gbuffer_view *view, pbs_err *err) {
    job *j = ctx;
    if (j->o->exr) {
        pbs_code rc = write_exr(j, view, err);
        if (rc) return rc;
    }
    pbs_code rc = pbs_points_write(&j->app->run, j->w, &j->record, j->node, &view->points,
                                   j->written, PBS_POINTS_CHUNK, NULL, err);
    j->written += view->points.count;
    return rc;
}

static pbs_code draw_node(job *j, pbs_err *err) {
    const pbs_planned *plan = &j->plan.nodes[j->node];
    size_t count;
    uint64_t triangles;
    pbs_gbuffer_stats stats = {0};
    pbs_gbuffer_params p = j->params;
    p.box = plan->seen;
    p.resolution = plan->resolution;
    pbs_code rc =
        pbs_plan_draws(&j->scene, &j->plan, j->node, &j->draws, &j->cap, &count, &triangles, err);
    if (rc || !count) return rc;
    rc = pbs_mem_plan(&j->app->run, pbs_gbuffer_need(j->buffers, j->draws, count, &p, 0),
                      "the G-buffers", err);
    if (!rc) rc = pbs_gbuffer(j->buffers, j->draws, count, &p, take_view, j, &stats, err);
    j->placings += count;
    j->total.triangles += stats.triangles;
    j->total.fragments += stats.fragments;
    j->total.candidates += stats.candidates;
    return rc;
}

/* A scene's root often has no name; the file's is better than none. */
static const char *name_of(const job *j, char *title, size_t size) {
    if (j->node + 1 < j->scene.node_count) return j->scene.nodes[j->node].name;
    pbs_scene_title(&j->scene, title, size);
    return title;
}

static pbs_code write_node(job *j, pbs_err *err) {
    char title[512];
    const pbs_node *from = &j->scene.nodes[j->node];
    const pbs_planned *plan = &j->plan.nodes[j->node];
    pbs_node n = {.id = j->node,
                  .name = name_of(j, title, sizeof title),
                  .box = plan->box,
                  .triangles = from->triangles,
                  .records = j->written,
                  .wanted = plan->wanted,
                  .flags = plan->flags,
                  .pixel = plan->pixel,
                  .child_count = from->child_count,
                  .children = from->children};
    if (plan->wanted) n.flags |= j->o->directions == FACES ? PBS_NODE_FACES : PBS_NODE_CORNERS;
    if (plan->wanted && j->o->directions == BOTH) n.flags |= PBS_NODE_FACES;
    memcpy(n.origin, plan->origin, sizeof n.origin);
    return pbs_node_write(&j->app->run, j->w, &n, err);
}

static pbs_code take_node(job *j, pbs_err *err) {
    pbs_planned *plan = &j->plan.nodes[j->node];
    j->written = 0;
    pbs_code rc = plan->wanted ? draw_node(j, err) : PBS_OK;
    if (rc && rc != PBS_DATA && rc != PBS_LIMIT) return rc;
    if (rc) {
        pbs_fail_in(err, "node %u \"%s\"", j->node, j->scene.nodes[j->node].name);
        if (!j->o->keep_going || j->written)
            return pbs_fail_in(err, "%s", pbs_reader_name(j->scene.reader));
        pbs_note_failure(&j->failures, err);
        plan->wanted = plan->flags = 0;
    }
    j->drawn += plan->wanted != 0;
    return write_node(j, err);
}

/* ---- the scene ---- */

static void choose_directions(int which, pbs_gbuffer_params *p) {
    p->pairs = 0;
    if (which != FACES) {
        memcpy(p->direction, PBS_GBUFFER_CORNERS, sizeof PBS_GBUFFER_CORNERS);
        p->pairs = 4;
    }
    for (int k = 0; k < 3 && which != CORNERS; k++) p->direction[p->pairs++][k] = 1;
}

static uint32_t largest_resolution(const job *j) {
    uint32_t most = 0;
    for (size_t i = 0; i < j->scene.node_count; i++)
        if (j->plan.nodes[i].resolution > most) most = j->plan.nodes[i].resolution;
    return most;
}

/* Each thread has buffers of its own: rather fewer threads than no picture. */
static pbs_code set_up(job *j, pbs_err *err) {
    pbs_run *run = &j->app->run;
    const pbs_scene *s = &j->scene;
    pbs_code rc = pbs_surfaces_new(run, s->materials, s->material_count, j->images,
                                   s->texture_count, s->channels, &j->surfaces, err);
    pbs_gbuffer_params p = j->params;
    p.resolution = largest_resolution(j);
    p.box = (pbs_box){{-1, -1, -1}, {1, 1, 1}};
    while (run->threads > 1 &&
           pbs_gbuffer_need(NULL, NULL, 0, &p, run->threads) > pbs_mem_left(run))
        run->threads /= 2;
    return rc ? rc : pbs_gbuffers_new(run, j->surfaces, run->threads, &j->buffers, err);
}

static pbs_code plan(job *j, pbs_err *err) {
    const options *o = j->o;
    pbs_lod lod = {o->least, o->share, o->count, (uint32_t)o->resolution, o->max_error};
    j->params.channels = j->scene.channels;
    choose_directions(o->directions, &j->params);
    return pbs_plan_make(&j->scene, &lod, &j->params, o->top_down, &j->plan, err);
}

static pbs_code open_writer(job *j, pbs_err *err) {
    char channels[256];
    j->record = pbs_record_make(PBS_POSITION | j->scene.channels, false);
    pbs_record_text(&j->record, channels);
    return pbs_writer_open(&j->app->run,
                           &(pbs_writer_desc){.path = j->app->common.output,
                                              .kind = PBS_CANDIDATES,
                                              .channels = channels,
                                              .history = pbs_scene_history(&j->scene),
                                              .stage = j->app->stage},
                           &j->w, err);
}

static pbs_code draw_nodes(job *j, pbs_err *err) {
    size_t n = j->scene.node_count;
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < n && !rc; i++) {
        j->node = (uint32_t)i;
        pbs_run_progress(&j->app->run, "drawing", i, n);
        rc = pbs_run_check(&j->app->run, err);
        if (!rc) rc = take_node(j, err);
    }
    if (!rc && !j->total.candidates && !j->failures.count)
        rc = pbs_fail(err, PBS_DATA, "%s: no pixel is covered at resolution %u: nothing to see",
                      pbs_reader_name(j->scene.reader), largest_resolution(j));
    return rc ? rc : pbs_writer_commit(j->w, err);
}

static void add_stats(job *j) {
    pbs_app *app = j->app;
    char channels[256];
    const char *name = pbs_reader_name(j->scene.reader);
    pbs_stat_count(app, "nodes", j->scene.node_count);
    pbs_stat_count(app, "nodes_drawn", j->drawn);
    pbs_stat_count(app, "triangles", j->scene.nodes[j->scene.node_count - 1].triangles);
    pbs_stat_count(app, "triangles_drawn", j->total.triangles);
    pbs_stat_count(app, "placings", j->placings);
    pbs_stat_count(app, "fragments", j->total.fragments);
    pbs_stat_count(app, "candidates", j->total.candidates);
    pbs_stat_count(app, "resolution", largest_resolution(j));
    pbs_stat_real(app, "pixel", j->plan.nodes[j->plan.root].pixel);
    pbs_record_text(&j->record, channels);
    pbs_stat_record(app, channels, j->record.stride);
    pbs_stat_count(app, "bytes", pbs_writer_bytes(j->w));
    pbs_note_skips(app, name, j->scene.skipped);
    if (j->plan.singular)
        pbs_note(app, "%s: %llu placings have a transform that cannot be inverted", name,
                 (unsigned long long)j->plan.singular);
}

/* The buffers' size follows from the options alone; with the reading of a small scene that is
 * what will do at least. */
static size_t least_memory(const job *j) {
    const size_t reading = 20 << 20;
    pbs_lod lod = {1, 1, j->o->count, (uint32_t)j->o->resolution, 0};
    pbs_gbuffer_params p = {.channels = PBS_NORMAL, .box = {{-1, -1, -1}, {1, 1, 1}}};
    p.resolution = pbs_lod_resolution(&lod, (uint32_t)j->o->count, 0);
    choose_directions(j->o->directions, &p);
    return pbs_mem_used(&j->app->run) + reading + pbs_gbuffer_need(NULL, NULL, 0, &p, 1);
}

static pbs_code work(pbs_app *app, void *opt, pbs_err *err) {
    job j = {.app = app, .o = opt, .failures = {app, 0}};
    pbs_scene_options so = PBS_SCENE_DEFAULTS;
    so.ignore_missing = j.o->ignore_missing;
    so.failed = j.o->keep_going ? pbs_note_failure : NULL;
    so.failed_ctx = &j.failures;
    app->run.mem_floor = least_memory(&j);
    pbs_code rc = pbs_scene_open(&app->run, pbs_operand(app, 0), &so, &j.scene, err);
    if (rc) return rc;
    rc = plan(&j, err);
    if (!rc) rc = pbs_scene_images(&j.scene, &j.images, err);
    if (!rc) rc = set_up(&j, err);
    if (!rc) rc = open_writer(&j, err);
    if (!rc) rc = pbs_motions_write(&app->run, j.w, &j.scene.motions, err);
    if (!rc) rc = draw_nodes(&j, err);
    if (!rc) add_stats(&j);
    if (!rc) rc = pbs_failures_end(&j.failures, err);
    pbs_writer_close(j.w);
    pbs_gbuffers_free(j.buffers);
    pbs_surfaces_free(&app->run, j.surfaces);
    pbs_images_free(&app->run, j.images, j.scene.texture_count);
    pbs_free(&app->run, j.draws);
    pbs_plan_free(&app->run, &j.plan);
    pbs_scene_close(&j.scene);
    return rc;
}

int main(int argc, char **argv) {
    pbs_lod lod = PBS_LOD_DEFAULT;
    options o = {.count = lod.most, .least = lod.least, .share = lod.share};
    return pbs_tool_main(argc, argv, &tool, &o, work);
}
