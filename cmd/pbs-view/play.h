/* play.h: what decides how a picture is taken besides what is shown: camera path, eyes, zones, the
 * controller of the frame-time; the same for one picture, a series of measurements and a window. */
#ifndef PBS_PLAY_H
#define PBS_PLAY_H

#include "cmd/pbs-view/plan/control.h"
#include "cmd/pbs-view/plan/path.h"
#include "cmd/pbs-view/show.h"

typedef struct pbs_play_options {
    const char *path, *bench, *truth, *zones, *gaze, *stereo, *pick;
    uint64_t frames;
    double at, frame_time; /* seconds; milliseconds */
    double time, speed;    /* of the animations: seconds, NaN: not said; how fast they are */
    bool overlay, window, keys;
} pbs_play_options;

typedef struct pbs_play {
    pbs_run *run;
    const pbs_play_options *options;
    pbs_path path; /* count 0: none */
    pbs_zones zones;
    double gaze[2];
    bool gaze_is_mouse;
    double separation, focus; /* world unit, or shares of the target's distance */
    bool separation_is_share, focus_is_share;
    bool zones_on, stereo_on;
    pbs_control control;
    double moment; /* of the animations; NaN: everything rests */
    double speed;  /* their seconds in one of ours */
} pbs_play;

/* options are borrowed. Reads the path; nothing of what is shown is needed yet. up: 0, 1, 2: what
 * points up where the path does not say it. Errors: PBS_USAGE, PBS_DATA, PBS_IO. */
pbs_code pbs_play_open(pbs_run *run, const pbs_play_options *options, int up, double surfel_size,
                       pbs_play *out, pbs_err *err);
void pbs_play_close(pbs_play *play);

/* The path's camera at a time; without a path that of the show. */
pbs_camera pbs_play_camera(const pbs_play *play, const pbs_show *show, double time);
/* Frame i of n of a series: along the path from its first keyframe to its last, or without one once
 * around the target. *time: seconds. */
pbs_camera pbs_play_frame(const pbs_play *play, const pbs_show *show, uint64_t i, uint64_t n,
                          double *time);
/* Frames of a series: as many as the options say, else 60 for each second of the path, else 60. */
uint64_t pbs_play_frames(const pbs_play *play);

/* Where the animations are when the camera is at a time of its path (0: there is none): from what
 * the options say, with their speed. Nothing moves if they say neither a time nor an animation. */
void pbs_play_move(pbs_play *play, const pbs_show *show, double time);

/* Everything together, for pbs_show_draw. The view borrows the play. */
pbs_show_view pbs_play_view(const pbs_play *play, const pbs_camera *camera, uint32_t width,
                            uint32_t height);

/* "X,Y": two numbers. */
bool pbs_play_pair(const char *text, double out[2]);

/* The name of what is at a place of the canvas that was just drawn, as pbs_pick has it; x, y in
 * pixels. "": nothing is there. Errors: PBS_LIMIT, PBS_INTERNAL. */
pbs_code pbs_play_pick(pbs_show *show, pbs_canvas *canvas, const pbs_show_view *view, double x,
                       double y, char *out, size_t size, pbs_err *err);
#endif
