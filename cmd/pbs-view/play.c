#include "cmd/pbs-view/play.h"
#include "cmd/pbs-view/draw/draw_probe.h"
#include "cmd/pbs-view/plan/pick.h"
#include <stdlib.h>

static bool number(const char **p, double *v) {
    char *end;
    *v = strtod(*p, &end);
    if (end == *p || !isfinite(*v)) return false;
    *p = end;
    return true;
}

bool pbs_play_pair(const char *text, double out[2]) {
    return number(&text, &out[0]) && *text++ == ',' && number(&text, &out[1]) && !*text;
}

static pbs_code parse_gaze(pbs_play *p, const char *text, pbs_err *err) {
    p->gaze[0] = p->gaze[1] = 0.5;
    if (!text) return PBS_OK;
    p->gaze_is_mouse = strcmp(text, "mouse") == 0;
    if (p->gaze_is_mouse) return PBS_OK;
    if (pbs_play_pair(text, p->gaze) && p->gaze[0] >= 0 && p->gaze[0] <= 1 && p->gaze[1] >= 0 &&
        p->gaze[1] <= 1)
        return PBS_OK;
    return pbs_fail(err, PBS_USAGE, "--gaze: %s: must be mouse, or X,Y from 0,0 to 1,1", text);
}

/* A length of the scene's unit, or with % a share. */
static bool length(const char **p, double *v, bool *share) {
    if (!number(p, v) || *v < 0) return false;
    *share = **p == '%';
    if (*share) *v /= 100, ++*p;
    return true;
}

static pbs_code parse_stereo(pbs_play *p, const char *text, pbs_err *err) {
    const char *rest = text;
    p->separation = 1.0 / 30;
    p->focus = 1;
    p->separation_is_share = p->focus_is_share = true;
    if (!text) return PBS_OK;
    p->stereo_on = true;
    bool good = length(&rest, &p->separation, &p->separation_is_share) && p->separation > 0;
    if (good && *rest == ',') rest++, good = length(&rest, &p->focus, &p->focus_is_share);
    if (good && !*rest) return PBS_OK;
    return pbs_fail(err, PBS_USAGE,
                    "--stereo: %s: must be a distance above 0 in the scene's unit, or with %% a "
                    "share of the target's distance; and after a comma that at which the eyes' "
                    "views meet",
                    text);
}

static pbs_code check_together(const pbs_play_options *o, pbs_err *err) {
    double place[2];
    if (o->truth && !o->bench) return pbs_fail(err, PBS_USAGE, "--truth is for --bench");
    if (o->window && !o->bench) return pbs_fail(err, PBS_USAGE, "--window is for --bench");
    if (o->pick && !pbs_play_pair(o->pick, place))
        return pbs_fail(err, PBS_USAGE, "--pick: %s: must be X,Y in pixels", o->pick);
    return PBS_OK;
}

pbs_code pbs_play_open(pbs_run *run, const pbs_play_options *o, int up, double surfel_size,
                       pbs_play *p, pbs_err *err) {
    double axis[3] = {0};
    axis[up] = 1;
    *p = (pbs_play){.run = run, .options = o, .moment = o->time, .speed = o->speed};
    p->control = pbs_control_start(o->frame_time / 1000, surfel_size);
    pbs_code rc = check_together(o, err);
    if (!rc) rc = parse_gaze(p, o->gaze, err);
    if (!rc) rc = parse_stereo(p, o->stereo, err);
    if (!rc) rc = pbs_zones_parse(&p->zones, o->zones ? o->zones : "5:1,15:2,30:4", err);
    p->zones_on = o->zones != NULL;
    if (!rc && o->path) rc = pbs_path_read(run, o->path, axis, &p->path, err);
    return rc;
}

void pbs_play_close(pbs_play *p) {
    pbs_path_free(p->run, &p->path);
}

pbs_camera pbs_play_camera(const pbs_play *p, const pbs_show *show, double time) {
    pbs_camera c = show->camera;
    if (p->path.count) pbs_path_at(&p->path, time, &c);
    return c;
}

pbs_camera pbs_play_frame(const pbs_play *p, const pbs_show *show, uint64_t i, uint64_t n,
                          double *time) {
    double from = p->path.count ? pbs_path_start(&p->path) : 0;
    double to = p->path.count ? pbs_path_end(&p->path) : (double)n / 60;
    if (p->path.count) {
        *time = n > 1 ? from + (to - from) * ((double)i / (double)(n - 1)) : from;
        return pbs_play_camera(p, show, *time);
    }
    pbs_camera c = show->camera;
    /* The last frame is not the first once more. A whole window's height is 3 radians. */
    *time = to * ((double)i / (double)n);
    pbs_camera_orbit(&c, 2 * 3.14159265358979323846 / 3 * ((double)i / (double)n), 0);
    return c;
}

uint64_t pbs_play_frames(const pbs_play *p) {
    if (p->options->frames) return p->options->frames;
    double seconds = p->path.count ? pbs_path_end(&p->path) - pbs_path_start(&p->path) : 0;
    double n = floor(seconds * 60 + 0.5) + 1;
    return !p->path.count ? 60 : n < 1e6 ? (uint64_t)n : 1000000;
}

void pbs_play_move(pbs_play *p, const pbs_show *show, double time) {
    double from = p->options->time;
    if (isnan(from) && show->options->animation) from = 0;
    p->moment = from + p->speed * time;
}

pbs_show_view pbs_play_view(const pbs_play *p, const pbs_camera *camera, uint32_t width,
                            uint32_t height) {
    double apart = p->separation * (p->separation_is_share ? camera->unit : 1);
    return (pbs_show_view){.camera = *camera,
                           .width = width,
                           .height = height,
                           .surfel_size = p->control.size,
                           .separation = p->stereo_on ? apart : 0,
                           .focus = p->focus * (p->focus_is_share ? camera->unit : 1),
                           .zones = p->zones_on ? &p->zones : NULL,
                           .gaze = {p->gaze[0], p->gaze[1]},
                           .time = p->moment};
}

pbs_code pbs_play_pick(pbs_show *show, pbs_canvas *canvas, const pbs_show_view *v, double x,
                       double y, char *out, size_t size, pbs_err *err) {
    bool geometry = show->options->geometry, part = false;
    const pbs_pick_scene scene = {geometry ? show->scene.nodes : show->archive.nodes,
                                  geometry ? show->scene.node_count : show->archive.node_count,
                                  geometry ? show->moving : show->archive.moving,
                                  pbs_poses_at(&show->poses, v->time)};
    double depth, point[3];
    pbs_eyes eyes;
    out[0] = 0;
    if (!(x >= 0 && y >= 0 && x < v->width && y < v->height)) return PBS_OK;
    pbs_code rc = pbs_canvas_depth(canvas, (uint32_t)x, (uint32_t)y, &depth, err);
    if (rc || !(depth > 0)) return rc;
    pbs_eyes_of(&eyes, &v->camera, v->width, v->height, v->separation, v->focus, NULL, v->gaze);
    int i = eyes.count == 2 && x >= eyes.left[1];
    pbs_pick_point(point, &eyes.camera[i], eyes.aspect, (x - eyes.from[i]) / eyes.wide,
                   y / eyes.height, depth);
    /* Discs stand out of their part's box by their radius, which may be more than a pixel. */
    double pixel = pbs_camera_pixel(&v->camera, v->height) * depth * v->camera.unit;
    for (double wide = 1; wide <= 64 && !rc && !part; wide *= 4)
        rc = pbs_pick(show->run, &scene, point, wide * pixel, out, size, &part, err);
    return rc;
}
