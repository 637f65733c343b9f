/* pbs-view: the player: shows an archive, or a scene's full geometry, in a window, as a picture, or
 * as a series of pictures that is measured. */
#include "cmd/notes.h"
#include "cmd/pbs-view/bench.h"
#include "cmd/pbs-view/draw/draw_text.h"
#include "cmd/pbs-view/keys.h"
#include "cmd/pbs-view/overlay.h"
#include "cmd/pbs-view/window.h"
#include "cmd/tool.h"
#include "formats/readers/image.h"
#include <math.h>
#include <stdio.h>

typedef struct options {
    pbs_show_options show;
    pbs_play_options play;
} options;

static const char *const axes[] = {"x", "y", "z", NULL};

static const char *const splats[] = {"off", "on", "afresh", "whole", NULL};
static const char *const points[] = {"cut", "reduce", "periphery", "cast", NULL};

static const pbs_option table[] = {
    {'s', "shot", PBS_TEXT, offsetof(options, show.shot), "FILE",
     "render one picture and exit; no display needed", 0, 0, NULL, false},
    {'g', "geometry", PBS_FLAG, offsetof(options, show.geometry), NULL,
     "the operand is a scene: show all its triangles", 0, 0, NULL, false},
    {'p', "prefix", PBS_COUNT, offsetof(options, show.prefix), "N",
     "surfels drawn of each node (default: what the camera needs)", 1, 4e9, NULL, false},
    {0, "surfel-size", PBS_REAL, offsetof(options, show.surfel_size), "PX",
     "diameter of a surfel, side of a voxel that the camera needs (default 2)", 0.25, 64, NULL,
     false},
    {0, "splat", PBS_CHOICE, offsetof(options, show.splat), "MODE",
     "blend surfels under Gaussians: off, on, afresh or whole", 0, 0, splats, false},
    {0, "points", PBS_CHOICE, offsetof(options, show.points), "MODE",
     "which points of clouds are drawn: cut, reduce, periphery or cast", 0, 0, points, false},
    {0, "formula", PBS_FLAG, offsetof(options, show.formula), NULL,
     "length of the prefix by the paper's estimate, not by the spacings", 0, 0, NULL, false},
    {0, "per-point", PBS_FLAG, offsetof(options, show.per_point), NULL,
     "every surfel decides with its own distance whether it is drawn", 0, 0, NULL, false},
    {0, "partial", PBS_FLAG, offsetof(options, show.partial), NULL,
     "while loading: parts at once, with holes, and not all of a level", 0, 0, NULL, false},
    {0, "no-occlusion", PBS_FLAG, offsetof(options, show.no_occlusion), NULL,
     "hidden voxels are drawn as fine as others", 0, 0, NULL, false},
    {0, "gpu-memory", PBS_BYTES, offsetof(options, show.gpu_memory), "SIZE",
     "limit of the GPU's memory (default 1Gi)", 1 << 20, 1e15, NULL, false},
    {0, "upload", PBS_BYTES, offsetof(options, show.upload), "SIZE",
     "limit of what is uploaded for a picture (default 16Mi)", 1 << 10, 1e15, NULL, false},
    {0, "buffer", PBS_BYTES, offsetof(options, show.buffer), "SIZE",
     "limit of a buffer; larger nodes are divided (default 128Mi)", 1 << 12, 1e15, NULL, false},
    {0, "width", PBS_COUNT, offsetof(options, show.width), "PX", "of the picture (default 1024)",
     16, 16384, NULL, false},
    {0, "height", PBS_COUNT, offsetof(options, show.height), "PX", "of the picture (default 768)",
     16, 16384, NULL, false},
    {0, "camera", PBS_TEXT, offsetof(options, show.camera), "E,T[,U][,FOV]",
     "eye, target, up and field of view (default: all in view)", 0, 0, NULL, false},
    {0, "up", PBS_CHOICE, offsetof(options, show.up), "AXIS", "what points up without --camera", 0,
     0, axes, false},
    {0, "samples", PBS_COUNT, offsetof(options, show.samples), "N",
     "samples a pixel, 1 to 4 (default 4, or what the device has)", 1, 4, NULL, false},
    {0, "device", PBS_TEXT, offsetof(options, show.device), "WHICH",
     "hw, sw or a number (default: hardware if there is any)", 0, 0, NULL, false},
    {0, "ignore-missing", PBS_FLAG, offsetof(options, show.ignore_missing), NULL,
     "go on without textures that are not there", 0, 0, NULL, false},
    {0, "path", PBS_TEXT, offsetof(options, play.path), "FILE",
     "the camera moves along the keyframes of this text file", 0, 0, NULL, false},
    {0, "at", PBS_REAL, offsetof(options, play.at), "SECONDS",
     "with --path: the camera of that time (default 0)", -1e9, 1e9, NULL, false},
    {0, "animation", PBS_TEXT, offsetof(options, show.animation), "WHICH",
     "a number or name, all (default) or none: which animations play", 0, 0, NULL, false},
    {0, "time", PBS_REAL, offsetof(options, play.time), "SECONDS",
     "where animations are, or begin (default 0 in a window, else none plays)", -1e9, 1e9, NULL,
     false},
    {0, "speed", PBS_REAL, offsetof(options, play.speed), "RATIO", "of animations (default 1)",
     -1000, 1000, NULL, false},
    {0, "bench", PBS_TEXT, offsetof(options, play.bench), "FILE",
     "measure a series of pictures along the path; write a table", 0, 0, NULL, false},
    {0, "frames", PBS_COUNT, offsetof(options, play.frames), "N",
     "pictures of the series (default: 60 a second of the path)", 1, 1e6, NULL, false},
    {0, "truth", PBS_TEXT, offsetof(options, play.truth), "SCENE",
     "with --bench: compare each picture with this scene's geometry", 0, 0, NULL, false},
    {0, "window", PBS_FLAG, offsetof(options, play.window), NULL,
     "with --bench: in a window, not without a display", 0, 0, NULL, false},
    {0, "frame-time", PBS_REAL, offsetof(options, play.frame_time), "MS",
     "hold the time of a frame by the size of surfels", 0.1, 1e4, NULL, false},
    {0, "zones", PBS_TEXT, offsetof(options, play.zones), "A:F[,A:F...]",
     "surfels F times as large at A degrees from the gaze", 0, 0, NULL, false},
    {0, "gaze", PBS_TEXT, offsetof(options, play.gaze), "X,Y",
     "where one looks, 0,0 to 1,1, or mouse (default 0.5,0.5)", 0, 0, NULL, false},
    {0, "stereo", PBS_TEXT, offsetof(options, play.stereo), "DISTANCE[,FOCUS]",
     "two eyes side by side, so far apart; N% of the target's distance", 0, 0, NULL, false},
    {0, "overlay", PBS_FLAG, offsetof(options, play.overlay), NULL, "statistics over the picture",
     0, 0, NULL, false},
    {0, "pick", PBS_TEXT, offsetof(options, play.pick), "X,Y",
     "print the name of what is seen at a pixel, and exit", 0, 0, NULL, false},
    {0, "keys", PBS_FLAG, offsetof(options, play.keys), NULL,
     "print the keys of the window, and exit", 0, 0, NULL, false},
};

static const pbs_tool tool = {"pbs-view",
                              "Shows an archive or a stream of voxels, or with --geometry a scene",
                              "[FILE]",
                              0,
                              1,
                              table,
                              sizeof table / sizeof table[0],
                              true};

/* A canvas without a display. */
typedef struct studio {
    pbs_gl gl;
    pbs_gl_context *context;
    pbs_canvas *canvas;
} studio;

static pbs_code open_studio(pbs_run *run, const pbs_show_options *o, studio *s, pbs_err *err) {
    const pbs_canvas_desc d = {(uint32_t)o->width, (uint32_t)o->height, (int)o->samples};
    *s = (studio){0};
    pbs_code rc = pbs_gl_context_new(o->device, &s->context, &s->gl, err);
    if (rc) return rc;
    pbs_count_open(&s->gl);
    return pbs_canvas_new(run, &s->gl, &d, &s->canvas, err);
}

static void close_studio(studio *s) {
    pbs_canvas_free(s->canvas);
    pbs_gl_context_free(s->context);
}

static pbs_code draw_overlay(pbs_run *run, studio *s, const pbs_show *show, const pbs_show_view *v,
                             pbs_err *err) {
    pbs_overlay overlay = {.statistics = true,
                           .device = s->gl.device,
                           .surfel_size = v->surfel_size,
                           .counts = pbs_count_take()};
    char lines[PBS_OVERLAY_TEXT];
    pbs_text *text;
    pbs_code rc = pbs_text_new(run, &s->gl, &text, err);
    pbs_overlay_statistics(&overlay, show, v, lines);
    if (!rc) rc = pbs_text_draw(text, s->canvas, lines, 4, 4, v->height >= 800 ? 2 : 1, err);
    pbs_text_free(text);
    return rc;
}

static pbs_code print_pick(const pbs_play *play, pbs_show *show, studio *s, const pbs_show_view *v,
                           pbs_err *err) {
    char name[1024];
    double at[2];
    if (!play->options->pick || !pbs_play_pair(play->options->pick, at)) return PBS_OK;
    pbs_code rc = pbs_play_pick(show, s->canvas, v, at[0], at[1], name, sizeof name, err);
    if (!rc && puts(name) < 0) rc = pbs_fail_errno(err, "standard output");
    return rc;
}

/* One picture, or the name of what is at a place of it. */
static pbs_code shoot(pbs_app *app, const options *o, pbs_show *show, pbs_play *play,
                      pbs_err *err) {
    pbs_run *run = &app->run;
    pbs_image image = {0};
    studio s;
    pbs_code rc = open_studio(run, &o->show, &s, err);
    pbs_camera camera = pbs_play_camera(play, show, o->play.at);
    pbs_play_move(play, show, play->path.count ? o->play.at : 0);
    pbs_show_view v =
        pbs_play_view(play, &camera, (uint32_t)o->show.width, (uint32_t)o->show.height);
    if (!rc) rc = pbs_show_settle(show, s.canvas, &v, err);
    if (!rc) rc = pbs_show_draw(show, s.canvas, &v, err);
    if (!rc) rc = print_pick(play, show, &s, &v, err);
    if (!rc && o->play.overlay) rc = draw_overlay(run, &s, show, &v, err);
    if (!rc && o->show.shot) rc = pbs_canvas_end(s.canvas, &image, err);
    if (!rc) rc = pbs_gl_lost(&s.gl, err);
    if (!rc) rc = pbs_run_check(run, err);
    if (!rc && o->show.shot) rc = pbs_image_write(run, o->show.shot, &image, err);
    if (!rc && app->common.verbose) pbs_note(app, "device %s", s.gl.device);
    pbs_free(run, image.rgba);
    close_studio(&s);
    return rc;
}

static void stat_median(pbs_app *app, const char *name, const pbs_bench *b, size_t offset) {
    double v = pbs_bench_median(b, offset);
    if (!isnan(v)) pbs_stat_real(app, name, v);
}

static pbs_code measure(pbs_app *app, const options *o, pbs_show *show, pbs_play *play,
                        pbs_err *err) {
    pbs_bench b = {0};
    studio s;
    pbs_code rc = open_studio(&app->run, &o->show, &s, err);
    if (!rc) rc = pbs_bench_open(show, play, &s.gl, &b, err);
    while (!rc && !pbs_bench_is_done(&b)) {
        rc = pbs_bench_frame(&b, s.canvas, (uint32_t)o->show.width, (uint32_t)o->show.height, err);
        if (!rc) rc = pbs_gl_lost(&s.gl, err);
    }
    if (!rc) rc = pbs_bench_write(&b, err);
    if (!rc) {
        pbs_stat_count(app, "frames", b.done);
        stat_median(app, "gpu_ms", &b, offsetof(pbs_bench_row, gpu));
        stat_median(app, "cpu_ms", &b, offsetof(pbs_bench_row, cpu));
        stat_median(app, "wall_ms", &b, offsetof(pbs_bench_row, wall));
        stat_median(app, "ssim", &b, offsetof(pbs_bench_row, ssim));
    }
    if (!rc && app->common.verbose) pbs_note(app, "device %s", s.gl.device);
    pbs_bench_close(&b);
    close_studio(&s);
    return rc;
}

/* All in view of each of two eyes, which have half of the picture. */
static void frame_half(pbs_show *show) {
    const pbs_show_options *o = show->options;
    pbs_camera_desc d = {.aspect = 0.5 * (double)o->width / (double)o->height};
    d.up[o->up] = 1;
    pbs_camera_frame(&show->camera, &show->box, &d);
}

static pbs_code play_it(pbs_app *app, const options *o, pbs_show *show, pbs_play *play,
                        pbs_err *err) {
    const char *title = pbs_operand(app, 0) ? pbs_operand(app, 0) : "pbs-view";
    if (play->stereo_on && !o->show.camera) frame_half(show);
    if (o->play.bench && !o->play.window) return measure(app, o, show, play, err);
    if (o->show.shot || o->play.pick) return shoot(app, o, show, play, err);
    return pbs_window_run(show, play, title, err);
}

static pbs_code print_keys(pbs_err *err) {
    for (size_t i = 0; i < pbs_key_count; i++)
        if (printf("%s\t%s\n", pbs_keys[i].name, pbs_keys[i].what) < 0)
            return pbs_fail_errno(err, "standard output");
    return PBS_OK;
}

static pbs_code work(pbs_app *app, void *opt, pbs_err *err) {
    options *o = opt;
    pbs_play play;
    pbs_show show = {0};
    if (o->play.keys) return print_keys(err);
    if (o->play.bench && o->show.shot)
        return pbs_fail(err, PBS_USAGE, "--bench and --shot: one of them");
    o->show.still = o->show.shot || (o->play.bench && !o->play.window);
    pbs_code rc = pbs_play_open(&app->run, &o->play, o->show.up, o->show.surfel_size, &play, err);
    if (!rc) rc = pbs_show_open(&app->run, &o->show, pbs_operand(app, 0), &show, err);
    if (!rc) rc = play_it(app, o, &show, &play, err);
    if (!rc && pbs_show_trouble(&show))
        pbs_note(app, "not all of it can be shown: %s", pbs_show_trouble(&show));
    if (!rc) {
        pbs_stat_count(app, "nodes", show.drawn_nodes);
        pbs_stat_count(app, "surfels", show.drawn_surfels);
        if (o->show.splat && o->show.shot) pbs_stat_count(app, "visible", show.visible_surfels);
        pbs_stat_count(app, "voxels", show.drawn_voxels);
        pbs_stat_count(app, "triangles", show.drawn_triangles);
        pbs_stat_count(app, "draw_calls", show.draw_calls);
        pbs_stat_count(app, "culled", show.culled);
        pbs_stat_count(app, "missing", show.missing);
        pbs_stat_count(app, "resident_bytes", show.resident_bytes);
        if (o->show.geometry)
            pbs_note_skips(app, pbs_reader_name(show.scene.reader), show.scene.skipped);
    }
    if (show.run) pbs_show_close(&show);
    pbs_play_close(&play);
    return rc;
}

int main(int argc, char **argv) {
    options o = {.show = {.width = 1024, .height = 768, .surfel_size = 2, .up = 1, .device = ""},
                 .play = {.time = NAN, .speed = 1}};
    return pbs_tool_main(argc, argv, &tool, &o, work);
}
