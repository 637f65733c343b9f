/* pbs-repair: a scene whose parts are oriented meshes. */
#include "cmd/notes.h"
#include "cmd/tool.h"
#include "formats/scene/mend.h"

typedef struct options {
    uint64_t fill, split;
    bool intersections, ignore_missing, keep_going;
} options;

static const pbs_option table[] = {
    {0, "fill-holes", PBS_COUNT, offsetof(options, fill), "N",
     "fill holes of at most N edges (default 0: none)", 0, 1e6, NULL, true},
    {0, "self-intersections", PBS_FLAG, offsetof(options, intersections), NULL,
     "count the triangles that cut each other", 0, 0, NULL, false},
    {0, "split", PBS_COUNT, offsetof(options, split), "N",
     "cut parts with more triangles afterwards (default 400k; 0: never)", 0, 0, NULL, true},
    {0, "ignore-missing", PBS_FLAG, offsetof(options, ignore_missing), NULL,
     "go on without textures that are not there", 0, 0, NULL, true},
    {0, "keep-going", PBS_FLAG, offsetof(options, keep_going), NULL,
     "leave out or as it is what fails, and end with status 65", 0, 0, NULL, true},
};

static const pbs_tool tool = {"pbs-repair",
                              "Makes oriented, closed meshes of a scene's parts, with CGAL",
                              "[FILE]",
                              0,
                              1,
                              table,
                              sizeof table / sizeof table[0],
                              false};

static void put_stats(pbs_app *app, const pbs_mend_totals *m, const pbs_scene_totals *t,
                      const pbs_mend_options *o) {
    pbs_stat_count(app, "nodes", t->nodes);
    pbs_stat_count(app, "triangles", t->triangles);
    pbs_stat_count(app, "triangles_stored", t->stored);
    pbs_stat_count(app, "parts", m->parts);
    for (int i = 0; i < PBS_MEND_COUNTS; i++)
        if (i != PBS_MEND_INTERSECTIONS || o->intersections)
            pbs_stat_count(app, pbs_mend_count_name[i], m->counts[i]);
}

static pbs_code repair(pbs_app *app, const pbs_scene *s, pbs_writer *w, const options *o,
                       pbs_failures *failures, pbs_err *err) {
    pbs_scene_writer *sw;
    pbs_mend_totals totals;
    pbs_scene_options so = {.split = o->split};
    pbs_mend_options mo = {.fill = o->fill,
                           .intersections = o->intersections,
                           .failed = o->keep_going ? pbs_note_failure : NULL,
                           .failed_ctx = failures};
    pbs_code rc = pbs_scene_writer_new(&app->run, w, &so, &sw, err);
    if (rc) return rc;
    rc = pbs_scene_mend(s, &mo, sw, &totals, err);
    if (!rc) rc = pbs_scene_writer_end(sw, err);
    if (!rc) rc = pbs_writer_commit(w, err);
    if (!rc) {
        pbs_scene_totals t = pbs_scene_writer_totals(sw);
        put_stats(app, &totals, &t, &mo);
        pbs_stat_count(app, "bytes", pbs_writer_bytes(w));
        pbs_note_skips(app, pbs_reader_name(s->reader), t.skipped);
        rc = pbs_failures_end(failures, err);
    }
    pbs_scene_writer_free(sw);
    return rc;
}

static pbs_code work(pbs_app *app, void *opt, pbs_err *err) {
    const options *o = opt;
    pbs_scene s;
    pbs_writer *w = NULL;
    pbs_failures failures = {app, 0};
    /* A part that is cut has borders where it was cut: that comes after. */
    pbs_scene_options so = PBS_SCENE_DEFAULTS;
    so.split = 0;
    so.ignore_missing = o->ignore_missing;
    so.failed = o->keep_going ? pbs_note_failure : NULL;
    so.failed_ctx = &failures;
    pbs_code rc = pbs_scene_open(&app->run, pbs_operand(app, 0), &so, &s, err);
    if (rc) return rc;
    rc = pbs_writer_open(&app->run,
                         &(pbs_writer_desc){.path = app->common.output,
                                            .kind = PBS_SCENE,
                                            .history = pbs_scene_history(&s),
                                            .stage = app->stage},
                         &w, err);
    if (!rc) rc = repair(app, &s, w, o, &failures, err);
    pbs_writer_close(w);
    pbs_scene_close(&s);
    return rc;
}

int main(int argc, char **argv) {
    options o = {.split = PBS_SCENE_DEFAULTS.split};
    return pbs_tool_main(argc, argv, &tool, &o, work);
}
