/* show.h: what is shown: an archive, or a stream of voxels, or a scene's full geometry, opened once
 * and drawn any number of times onto a canvas. */
#ifndef PBS_SHOW_H
#define PBS_SHOW_H

#include "cmd/pbs-view/draw/draw.h"
#include "cmd/pbs-view/stream/player.h"
#include "cmd/pbs-view/plan/eyes.h"
#include "cmd/pbs-view/plan/poses.h"
#include "formats/scene/scene.h"

typedef struct pbs_show_options {
    const char *shot, *camera, *device;
    const char *animation; /* poses.h; NULL: all */
    uint64_t prefix, width, height, samples;
    double surfel_size;
    uint64_t gpu_memory, upload, buffer;
    bool formula, per_point, partial, no_occlusion;
    int up;     /* 0, 1, 2: x, y, z */
    int splat;  /* PBS_SPLAT_OFF, ... */
    int points; /* PBS_POINTS_CUT, ... */
    bool still; /* each picture by itself: it waits for what it needs and counts what it shows */
    bool geometry, ignore_missing;
} pbs_show_options;

typedef struct pbs_show {
    pbs_run *run;
    const pbs_show_options *options;
    pbs_camera camera; /* the one asked for, or all in view */
    pbs_box box;       /* of everything, world coordinates */
    pbs_archive archive;
    pbs_player player; /* of the archive */
    pbs_scene scene;   /* with --geometry */
    pbs_flat flat;
    pbs_image *images;
    pbs_poses poses;
    uint64_t *moving; /* of the scene: placings that an animation moves, below each node */
    double drawn_at;  /* time of the scene's draws */
    /* of the last draw */
    uint64_t drawn_nodes, drawn_surfels, drawn_voxels, drawn_triangles;
    uint64_t visible_surfels; /* with --splat and --shot */
    uint64_t draw_calls;      /* of what lies in the GPU's memory */
    uint64_t uploaded_bytes;  /* to the GPU, for this draw */
    uint64_t resident_bytes;  /* there */
    uint64_t culled,
        hidden;       /* nodes outside of the picture, and drawn to see whether they are seen */
    uint64_t missing; /* nodes and meshes that are wanted and not there yet */
    bool unfinished;  /* another draw of the same view would show more */
} pbs_show;

/* options are borrowed until close. */
pbs_code pbs_show_open(pbs_run *run, const pbs_show_options *options, const char *path,
                       pbs_show *out, pbs_err *err);
/* What may change from picture to picture. */
typedef struct pbs_show_view {
    pbs_camera camera;
    uint32_t width, height;
    double surfel_size;
    double separation;      /* of two eyes side by side, world unit; 0: one eye */
    double focus;           /* distance at which both see the same place; 0: infinity */
    const pbs_zones *zones; /* factors of the surfel size around the gaze; NULL: none */
    double gaze[2];         /* shares of an eye's part of the picture, from its left upper corner */
    double time;            /* of the animations, seconds; NaN: everything rests */
} pbs_show_view;

/* Loads all that the view needs, as far as the limits allow: what is drawn then does not depend on
 * how fast the disk is. */
pbs_code pbs_show_settle(pbs_show *show, pbs_canvas *canvas, const pbs_show_view *view,
                         pbs_err *err);
/* Why something of the archive cannot be shown; NULL: all of it can, as far as it was asked for. */
const char *pbs_show_trouble(const pbs_show *show);

/* Clears the canvas and draws what is there; the caller ends or presents it. */
pbs_code pbs_show_draw(pbs_show *show, pbs_canvas *canvas, const pbs_show_view *view, pbs_err *err);
void pbs_show_close(pbs_show *show);
#endif
