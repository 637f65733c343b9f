/* pbs-import: a scene file to a scene stream. */
#include "cmd/depend.h"
#include "cmd/notes.h"
#include "cmd/tool.h"
#include "formats/scene/scene.h"
#include <string.h>

typedef struct options {
    bool ignore_missing, keep_going;
    uint64_t split, group;
    const char *depend, *target;
} options;

static const pbs_option table[] = {
    {0, "ignore-missing", PBS_FLAG, offsetof(options, ignore_missing), NULL,
     "go on without textures that are not there", 0, 0, NULL, true},
    {0, "split", PBS_COUNT, offsetof(options, split), "N",
     "cut parts with more triangles into parts (0: never)", 0, 0, NULL, true},
    {0, "group", PBS_COUNT, offsetof(options, group), "N",
     "group the children of assemblies with more (0: never)", 0, 0, NULL, true},
    {0, "depend", PBS_TEXT, offsetof(options, depend), "FILE",
     "write a rule for make: which files were read", 0, 0, NULL, false},
    {0, "depend-target", PBS_TEXT, offsetof(options, target), "NAME",
     "what the rule says is made of them (default: the output)", 0, 0, NULL, false},
    {0, "keep-going", PBS_FLAG, offsetof(options, keep_going), NULL,
     "leave out what cannot be read, and end with status 65", 0, 0, NULL, true},
};

static const pbs_tool tool = {"pbs-import",
                              "Turns a scene file (glTF, GLB, OBJ, PLY, STL) into a scene stream",
                              "[FILE]",
                              0,
                              1,
                              table,
                              sizeof table / sizeof table[0],
                              false};

static pbs_code import(pbs_app *app, pbs_input *in, pbs_writer *w, const options *o, pbs_depend *d,
                       pbs_err *err) {
    pbs_scene_writer *sw;
    pbs_failures failures = {app, 0};
    pbs_scene_options so = {.ignore_missing = o->ignore_missing,
                            .split = o->split,
                            .group = o->group,
                            .failed = o->keep_going ? pbs_note_failure : NULL,
                            .failed_ctx = &failures};
    pbs_code rc = pbs_scene_writer_new(&app->run, w, &so, &sw, err);
    if (rc) return rc;
    rc = pbs_import_input(in, pbs_operand(app, 0), pbs_scene_sink(sw), err);
    if (!rc && (rc = pbs_scene_writer_end(sw, err))) pbs_fail_in(err, "%s", in->name);
    /* Before the output is whole: who has the output has the rule. */
    if (!rc && o->depend)
        rc = pbs_depend_write(d, &app->run, o->depend, o->target ? o->target : app->common.output,
                              err);
    if (!rc) rc = pbs_writer_commit(w, err);
    if (!rc) {
        pbs_scene_totals t = pbs_scene_writer_totals(sw);
        pbs_stat_count(app, "nodes", t.nodes);
        pbs_stat_count(app, "triangles", t.triangles);
        pbs_stat_count(app, "triangles_stored", t.stored);
        pbs_stat_count(app, "parts_unified", t.parts_unified);
        pbs_stat_count(app, "assemblies_unified", t.assemblies_unified);
        pbs_stat_count(app, "parts_split", t.parts_split);
        pbs_stat_count(app, "groups", t.groups);
        if (t.motions) {
            pbs_stat_count(app, "animations", t.animations);
            pbs_stat_count(app, "motions", t.motions);
        }
        pbs_stat_count(app, "bytes", pbs_writer_bytes(w));
        pbs_note_skips(app, in->name, t.skipped);
        rc = pbs_failures_end(&failures, err);
    }
    pbs_scene_writer_free(sw);
    return rc;
}

static pbs_code work(pbs_app *app, void *opt, pbs_err *err) {
    pbs_input in;
    pbs_writer *w = NULL;
    const uint8_t *head;
    size_t n;
    const options *o = opt;
    pbs_depend depend = {0};
    if (o->depend && !o->target && !app->common.output)
        return pbs_fail(err, PBS_USAGE, "--depend: needs --depend-target or --output");
    if (o->depend) pbs_depend_begin(&depend, &app->run);
    pbs_code rc = pbs_input_open(&app->run, pbs_operand(app, 0), &in, err);
    if (rc) {
        pbs_depend_end(&depend, &app->run);
        return rc;
    }
    rc = pbs_input_peek(&in, &head, &n, err);
    if (!rc && pbs_is_container(head, n))
        rc = pbs_fail(err, PBS_DATA, "%s: is a pbs file already", in.name);
    if (!rc)
        rc = pbs_writer_open(
            &app->run,
            &(pbs_writer_desc){.path = app->common.output, .kind = PBS_SCENE, .stage = app->stage},
            &w, err);
    if (!rc) rc = import(app, &in, w, o, &depend, err);
    pbs_depend_end(&depend, &app->run);
    pbs_writer_close(w);
    pbs_input_close(&in);
    return rc;
}

int main(int argc, char **argv) {
    const pbs_scene_options defaults = PBS_SCENE_DEFAULTS;
    options o = {.split = defaults.split, .group = defaults.group};
    return pbs_tool_main(argc, argv, &tool, &o, work);
}
