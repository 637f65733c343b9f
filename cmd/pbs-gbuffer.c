/* pbs-gbuffer: what can be seen of a scene from outside, as candidates (paper 1, section 3.1). */
#include "cmd/notes.h"
#include "cmd/tool.h"
#include "formats/exr.h"
#include "formats/points.h"
#include "formats/scene.h"
#include "libcore/gbuffer.h"
#include <string.h>

typedef struct options {
    uint64_t resolution, count;
    int directions;
    const char *exr;
    bool ignore_missing;
} options;

enum { CORNERS, FACES, BOTH };
static const char *const direction_names[] = {"corners", "faces", "both", NULL};

static const pbs_option table[] = {
    {'r', "resolution", PBS_COUNT, offsetof(options, resolution), "N",
     "pixels along the longest side of a view (default: from -n)", 1, PBS_GBUFFER_MAX_SIZE, NULL,
     true},
    {'n', "count", PBS_COUNT, offsetof(options, count), "N",
     "surfels that will be wanted (default 100k)", 1, 1e9, NULL, true},
    {'d', "directions", PBS_CHOICE, offsetof(options, directions), "SET", "views from", 0, 0,
     direction_names, true},
    {0, "exr", PBS_TEXT, offsetof(options, exr), "DIR", "also write the buffers as OpenEXR files",
     0, 0, NULL, false},
    {0, "ignore-missing", PBS_FLAG, offsetof(options, ignore_missing), NULL,
     "go on without textures that are not there", 0, 0, NULL, true},
};

static const pbs_tool tool = {"pbs-gbuffer",
                              "Renders a scene from outside into candidates for surfels",
                              "[FILE]",
                              0,
                              1,
                              table,
                              sizeof table / sizeof table[0],
                              false};

typedef struct job {
    pbs_app *app;
    const options *o;
    pbs_writer *w;
    pbs_record record;
    uint64_t written;
    const double *origin; /* of the frame that is drawn in */
} job;

static pbs_code take_view(void *ctx, const pbs_gbuffer_view *view, pbs_err *err) {
    job *j = ctx;
    if (j->o->exr) {
        pbs_code rc = pbs_exr_write_view(&j->app->run, j->o->exr, j->origin, view, err);
        if (rc) return rc;
    }
    pbs_code rc = pbs_points_write(&j->app->run, j->w, &j->record, 0, &view->points, j->written,
                                   PBS_POINTS_CHUNK, NULL, err);
    j->written += view->points.count;
    return rc;
}

/* About twenty candidates for each surfel: over eight views a third of the pixels is covered. */
static uint32_t choose_resolution(const options *o) {
    if (o->resolution) return (uint32_t)o->resolution;
    double r = ceil(sqrt(10.0 * (double)o->count));
    return r < 64 ? 64 : r > PBS_GBUFFER_MAX_SIZE ? PBS_GBUFFER_MAX_SIZE : (uint32_t)r;
}

static void choose_directions(int which, pbs_gbuffer_params *p) {
    p->pairs = 0;
    if (which != FACES) {
        memcpy(p->direction, PBS_GBUFFER_CORNERS, sizeof PBS_GBUFFER_CORNERS);
        p->pairs = 4;
    }
    for (int k = 0; k < 3 && which != CORNERS; k++) p->direction[p->pairs++][k] = 1;
}

/* A scene's root often has no name; the file's is better than none. */
static const char *name_of(const pbs_scene *s) {
    const char *name = s->nodes[s->node_count - 1].name;
    return *name ? name : pbs_base_name(pbs_reader_name(s->reader));
}

static pbs_code write_node(job *j, const pbs_scene *s, const pbs_flat *flat,
                           const pbs_gbuffer_stats *stats, pbs_err *err) {
    pbs_node n = {.name = name_of(s),
                  .box = flat->box,
                  .triangles = flat->triangles,
                  .records = stats->candidates,
                  .pixel = stats->pixel};
    memcpy(n.origin, flat->origin, sizeof n.origin);
    return pbs_node_write(&j->app->run, j->w, &n, err);
}

/* Each thread has buffers of its own: rather fewer threads than no picture. */
static size_t fit_threads(pbs_run *run, const pbs_flat *flat, const pbs_gbuffer_params *p) {
    size_t need;
    while ((need = pbs_gbuffer_need(NULL, flat->draws, flat->count, p, run->threads)) >
               pbs_mem_left(run) &&
           run->threads > 1)
        run->threads /= 2;
    return need;
}

static pbs_code draw(job *j, const pbs_surfaces *surfaces, const pbs_flat *flat,
                     const pbs_gbuffer_params *p, pbs_gbuffer_stats *stats, pbs_err *err) {
    pbs_run *run = &j->app->run;
    pbs_gbuffers *g = NULL;
    size_t need = fit_threads(run, flat, p);
    pbs_code rc = pbs_mem_plan(run, need, "the G-buffers", err);
    if (!rc) rc = pbs_gbuffers_new(run, surfaces, run->threads, &g, err);
    if (!rc) rc = pbs_gbuffer(g, flat->draws, flat->count, p, take_view, j, stats, err);
    pbs_gbuffers_free(g);
    return rc;
}

static pbs_code render(job *j, const pbs_scene *s, const pbs_flat *flat, const pbs_image *images,
                       pbs_err *err) {
    pbs_app *app = j->app;
    j->origin = flat->origin;
    pbs_gbuffer_params p = {.resolution = choose_resolution(j->o),
                            .channels = s->channels,
                            .box = flat->box,
                            .progress = true};
    for (int k = 0; k < 3; k++) p.box.min[k] -= flat->origin[k], p.box.max[k] -= flat->origin[k];
    choose_directions(j->o->directions, &p);
    pbs_gbuffer_stats stats = {0};
    pbs_surfaces *surfaces;
    pbs_code rc = pbs_surfaces_new(&app->run, s->materials, s->material_count, images,
                                   s->texture_count, s->channels, &surfaces, err);
    if (!rc) rc = draw(j, surfaces, flat, &p, &stats, err);
    pbs_surfaces_free(&app->run, surfaces);
    if (!rc && !stats.candidates)
        rc = pbs_fail(err, PBS_DATA, "%s: no pixel is covered at resolution %u: nothing to see",
                      pbs_reader_name(s->reader), p.resolution);
    if (!rc) rc = write_node(j, s, flat, &stats, err);
    if (!rc) rc = pbs_writer_commit(j->w, err);
    if (rc) return rc;
    pbs_stat_count(app, "triangles", stats.triangles);
    pbs_stat_count(app, "placings", flat->count);
    pbs_stat_count(app, "fragments", stats.fragments);
    pbs_stat_count(app, "candidates", stats.candidates);
    pbs_stat_count(app, "resolution", p.resolution);
    pbs_stat_real(app, "pixel", stats.pixel);
    pbs_stat_count(app, "bytes", pbs_writer_bytes(j->w));
    return PBS_OK;
}

static pbs_code open_writer(job *j, const pbs_scene *s, pbs_err *err) {
    char channels[256];
    j->record = pbs_record_make(PBS_POSITION | s->channels, false);
    pbs_record_text(&j->record, channels);
    return pbs_writer_open(&j->app->run,
                           &(pbs_writer_desc){.path = j->app->common.output,
                                              .kind = PBS_CANDIDATES,
                                              .channels = channels,
                                              .history = pbs_scene_history(s),
                                              .stage = j->app->stage},
                           &j->w, err);
}

/* The buffers' size follows from the options alone; with the reading of a small scene that is what
 * will do at least. */
static size_t least_memory(const options *o, const pbs_run *run) {
    const size_t reading = 20 << 20;
    pbs_gbuffer_params p = {.resolution = choose_resolution(o),
                            .channels = PBS_NORMAL,
                            .box = {{-1, -1, -1}, {1, 1, 1}}};
    choose_directions(o->directions, &p);
    return pbs_mem_used(run) + reading + pbs_gbuffer_need(NULL, NULL, 0, &p, 1);
}

static pbs_code work(pbs_app *app, void *opt, pbs_err *err) {
    job j = {.app = app, .o = opt};
    pbs_scene s;
    pbs_flat flat = {0};
    pbs_image *images = NULL;
    pbs_scene_options so = {j.o->ignore_missing};
    app->run.mem_floor = least_memory(opt, &app->run);
    pbs_code rc = pbs_scene_open(&app->run, pbs_operand(app, 0), &so, &s, err);
    if (rc) return rc;
    rc = pbs_scene_flatten(&s, &flat, err);
    if (!rc) rc = pbs_scene_images(&s, &images, err);
    if (!rc) rc = open_writer(&j, &s, err);
    if (!rc) rc = render(&j, &s, &flat, images, err);
    if (!rc) pbs_note_skips(app, pbs_reader_name(s.reader), s.skipped);
    if (!rc && flat.singular)
        pbs_note(app, "%s: %llu placings have a transform that cannot be inverted",
                 pbs_reader_name(s.reader), (unsigned long long)flat.singular);
    pbs_writer_close(j.w);
    pbs_images_free(&app->run, images, s.texture_count);
    pbs_free(&app->run, flat.draws);
    pbs_scene_close(&s);
    return rc;
}

int main(int argc, char **argv) {
    options o = {.count = 100000};
    return pbs_tool_main(argc, argv, &tool, &o, work);
}
