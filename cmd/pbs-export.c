/* pbs-export: points and voxels for other people's programs. */
#include "cmd/tool.h"
#include "formats/export/export.h"
#include <string.h>
#include <strings.h>

typedef struct options {
    uint64_t prefix, count, level, node;
    double spacing;
    int format, positions;
    bool faces, radius, z_up;
} options;

enum { FROM_NAME = 2 };
static const char *const formats[] = {"ply", "glb", NULL};
static const char *const positions[] = {"auto", "float", "double", NULL};

static const pbs_option table[] = {
    {'n', "count", PBS_COUNT, offsetof(options, count), "N", "the N coarsest points of the whole",
     1, 0, NULL, true},
    {'s', "spacing", PBS_REAL, offsetof(options, spacing), "S",
     "points that are at least S apart (default 0: everything)", 0, 0, NULL, true},
    {'p', "prefix", PBS_COUNT, offsetof(options, prefix), "N",
     "the first N points of each of the coarsest nodes", 1, 0, NULL, true},
    {'l', "level", PBS_COUNT, offsetof(options, level), "L", "voxels of level L; 0 is the finest",
     0, 31, NULL, true},
    {0, "node", PBS_COUNT, offsetof(options, node), "N",
     "node N alone, in its own coordinates (default: the root)", 0, 4294967294.0, NULL, true},
    {0, "faces", PBS_FLAG, offsetof(options, faces), NULL, "the faces of voxels, as a mesh", 0, 0,
     NULL, true},
    {0, "radius", PBS_FLAG, offsetof(options, radius), NULL, "the spacing of each point, too", 0, 0,
     NULL, true},
    {0, "z-up", PBS_FLAG, offsetof(options, z_up), NULL,
     "GLB: z points up, as in most scans, and becomes y", 0, 0, NULL, true},
    {0, "positions", PBS_CHOICE, offsetof(options, positions), "TYPE",
     "PLY: auto, float or double (default auto: float if nothing is lost)", 0, 0, positions, true},
    {'f', "format", PBS_CHOICE, offsetof(options, format), "FORMAT",
     "ply or glb (default: as the name of the output ends)", 0, 0, formats, true},
};
enum { COUNT, SPACING, PREFIX, LEVEL, NODE };

static const pbs_tool tool = {
    "pbs-export", "Writes points and voxels as PLY or GLB", "[FILE]", 0, 1,
    table,        sizeof table / sizeof table[0],           false};

static bool given(const pbs_app *app, int option) {
    return app->common.given >> option & 1;
}

static pbs_code find_format(const pbs_app *app, options *o, pbs_err *err) {
    const char *name = app->common.output ? app->common.output : "", *dot = strrchr(name, '.');
    for (int i = 0; o->format == FROM_NAME && dot && formats[i]; i++)
        if (!strcasecmp(dot + 1, formats[i])) o->format = i;
    return o->format != FROM_NAME
               ? PBS_OK
               : pbs_fail(err, PBS_USAGE,
                          "which format? --format ply or --format glb says so, or "
                          "an -o that ends in .ply or .glb");
}

static pbs_code check_choice(const pbs_app *app, pbs_err *err) {
    int ways = given(app, COUNT) + given(app, SPACING) + given(app, PREFIX) + given(app, LEVEL);
    return ways < 2
               ? PBS_OK
               : pbs_fail(err, PBS_USAGE, "--count, --spacing, --prefix and --level: one of them");
}

static pbs_code work(pbs_app *app, void *opt, pbs_err *err) {
    options *o = opt;
    pbs_exported e;
    pbs_code rc = find_format(app, o, err);
    if (!rc) rc = check_choice(app, err);
    if (rc) return rc;
    pbs_export_options x = {.format = (pbs_export_format)o->format,
                            .positions = (pbs_export_positions)o->positions,
                            .spacing = o->spacing,
                            .prefix = o->prefix,
                            .count = o->count,
                            .level = given(app, LEVEL) ? (int)o->level : -1,
                            .node = given(app, NODE) ? (int64_t)o->node : -1,
                            .faces = o->faces,
                            .radius = o->radius,
                            .z_up = o->z_up,
                            .input = pbs_operand(app, 0),
                            .output = app->common.output,
                            .stage = app->stage};
    rc = pbs_export(&app->run, &x, &e, err);
    if (rc) return rc;
    pbs_stat_count(app, "nodes", e.nodes);
    pbs_stat_count(app, "points", e.points);
    pbs_stat_count(app, "voxels", e.voxels);
    pbs_stat_count(app, "vertices", e.vertices);
    pbs_stat_count(app, "faces", e.faces);
    pbs_stat_real(app, "spacing", e.spacing);
    pbs_stat_count(app, "bytes", e.bytes);
    if (e.left_out)
        pbs_note(app, "%llu points that are not voxels are left out: --faces",
                 (unsigned long long)e.left_out);
    if (o->count && e.points + e.voxels > o->count)
        pbs_note(app, "more than %llu: there are no coarser voxels", (unsigned long long)o->count);
    if (!e.vertices) pbs_note(app, "nothing is left: the file is empty");
    return PBS_OK;
}

int main(int argc, char **argv) {
    options o = {.format = FROM_NAME};
    return pbs_tool_main(argc, argv, &tool, &o, work);
}
