/* pbs-view: the player: shows an archive, or a scene's full geometry, as a picture. */
#include "cmd/notes.h"
#include "cmd/pbs-view/draw.h"
#include "cmd/pbs-view/show.h"
#include "cmd/pbs-view/window.h"
#include "cmd/tool.h"
#include "formats/image.h"
#include <stdio.h>

static const char *const axes[] = {"x", "y", "z", NULL};

static const char *const splats[] = {"off", "on", "afresh", "whole", NULL};
static const char *const points[] = {"cut", "reduce", "periphery", "cast", NULL};

static const pbs_option table[] = {
    {'s', "shot", PBS_TEXT, offsetof(pbs_show_options, shot), "FILE",
     "render one picture and exit; no display needed", 0, 0, NULL, false},
    {'g', "geometry", PBS_FLAG, offsetof(pbs_show_options, geometry), NULL,
     "the operand is a scene: show all its triangles", 0, 0, NULL, false},
    {'p', "prefix", PBS_COUNT, offsetof(pbs_show_options, prefix), "N",
     "surfels drawn of each node (default: what the camera needs)", 1, 4e9, NULL, false},
    {0, "surfel-size", PBS_REAL, offsetof(pbs_show_options, surfel_size), "PX",
     "diameter of a surfel, side of a voxel that the camera needs (default 2)", 0.25, 64, NULL,
     false},
    {0, "splat", PBS_CHOICE, offsetof(pbs_show_options, splat), "MODE",
     "blend surfels under Gaussians: off, on, afresh or whole", 0, 0, splats, false},
    {0, "points", PBS_CHOICE, offsetof(pbs_show_options, points), "MODE",
     "which points of clouds are drawn: cut, reduce, periphery or cast", 0, 0, points, false},
    {0, "width", PBS_COUNT, offsetof(pbs_show_options, width), "PX",
     "of the picture (default 1024)", 16, 16384, NULL, false},
    {0, "height", PBS_COUNT, offsetof(pbs_show_options, height), "PX",
     "of the picture (default 768)", 16, 16384, NULL, false},
    {0, "camera", PBS_TEXT, offsetof(pbs_show_options, camera), "E,T[,U][,FOV]",
     "eye, target, up and field of view (default: all in view)", 0, 0, NULL, false},
    {0, "up", PBS_CHOICE, offsetof(pbs_show_options, up), "AXIS", "what points up without --camera",
     0, 0, axes, false},
    {0, "samples", PBS_COUNT, offsetof(pbs_show_options, samples), "N",
     "samples a pixel, 1 to 4 (default 4, or what the device has)", 1, 4, NULL, false},
    {0, "device", PBS_TEXT, offsetof(pbs_show_options, device), "WHICH",
     "hw, sw or a number (default: hardware if there is any)", 0, 0, NULL, false},
    {0, "ignore-missing", PBS_FLAG, offsetof(pbs_show_options, ignore_missing), NULL,
     "go on without textures that are not there", 0, 0, NULL, false},
};

static const pbs_tool tool = {"pbs-view",
                              "Shows an archive or a stream of voxels, or with --geometry a scene",
                              "[FILE]",
                              0,
                              1,
                              table,
                              sizeof table / sizeof table[0],
                              true};

static pbs_code shoot(pbs_app *app, const pbs_show_options *o, pbs_show *show, pbs_err *err) {
    pbs_gl gl;
    pbs_gl_context *context;
    pbs_canvas *canvas = NULL;
    pbs_image image = {0};
    pbs_run *run = &app->run;
    pbs_code rc = pbs_gl_context_new(o->device, &context, &gl, err);
    if (rc) return rc;
    rc = pbs_canvas_new(
        run, &gl, &(pbs_canvas_desc){(uint32_t)o->width, (uint32_t)o->height, (int)o->samples},
        &canvas, err);
    pbs_show_view view = pbs_show_first_view(show);
    if (!rc) rc = pbs_show_draw(show, canvas, &view, err);
    if (!rc) rc = pbs_canvas_end(canvas, &image, err);
    if (!rc) rc = pbs_run_check(run, err);
    if (!rc) rc = pbs_image_write(run, o->shot, &image, err);
    if (!rc && app->common.verbose) pbs_note(app, "device %s", gl.device);
    pbs_free(run, image.rgba);
    pbs_canvas_free(canvas);
    pbs_gl_context_free(context);
    return rc;
}

static pbs_code work(pbs_app *app, void *opt, pbs_err *err) {
    const pbs_show_options *o = opt;
    pbs_show show;
    pbs_code rc = pbs_show_open(&app->run, o, pbs_operand(app, 0), &show, err);
    if (rc) return rc;
    rc = o->shot
             ? shoot(app, o, &show, err)
             : pbs_window_run(&show, pbs_operand(app, 0) ? pbs_operand(app, 0) : "pbs-view", err);
    if (!rc) {
        pbs_stat_count(app, "nodes", show.drawn_nodes);
        pbs_stat_count(app, "surfels", show.drawn_surfels);
        if (o->splat && o->shot) pbs_stat_count(app, "visible", show.visible_surfels);
        pbs_stat_count(app, "voxels", show.drawn_voxels);
        pbs_stat_count(app, "triangles", show.drawn_triangles);
        if (o->geometry)
            pbs_note_skips(app, pbs_reader_name(show.scene.reader), show.scene.skipped);
    }
    pbs_show_close(&show);
    return rc;
}

int main(int argc, char **argv) {
    pbs_show_options o = {.width = 1024, .height = 768, .surfel_size = 2, .up = 1, .device = ""};
    return pbs_tool_main(argc, argv, &tool, &o, work);
}
