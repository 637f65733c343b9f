/* show.h: what is shown: an archive, or a stream of voxels, or a scene's full geometry, opened once
 * and drawn any number of times onto a canvas. */
#ifndef PBS_SHOW_H
#define PBS_SHOW_H

#include "cmd/pbs-view/draw.h"
#include "formats/archive.h"
#include "formats/scene.h"

/* --splat, --points */
enum { PBS_SPLAT_OFF, PBS_SPLAT_ON, PBS_SPLAT_AFRESH, PBS_SPLAT_WHOLE };
enum { PBS_POINTS_CUT, PBS_POINTS_REDUCE, PBS_POINTS_PERIPHERY, PBS_POINTS_CAST };

typedef struct pbs_show_options {
    const char *shot, *camera, *device;
    uint64_t prefix, width, height, samples;
    double surfel_size;
    int up;     /* 0, 1, 2: x, y, z */
    int splat;  /* PBS_SPLAT_OFF, ... */
    int points; /* PBS_POINTS_CUT, ... */
    bool geometry, ignore_missing;
} pbs_show_options;

typedef struct pbs_show {
    pbs_run *run;
    const pbs_show_options *options;
    pbs_camera camera; /* the one asked for, or all in view */
    pbs_box box;       /* of everything, world coordinates */
    pbs_archive archive;
    pbs_scene scene; /* with --geometry */
    pbs_flat flat;
    pbs_image *images;
    /* of the last draw */
    uint64_t drawn_nodes, drawn_surfels, drawn_voxels, drawn_triangles;
    uint64_t visible_surfels; /* with --splat and --shot */
    bool unfinished;          /* draw again: the points are those of an earlier camera */
    pbs_surfels *list, *clouds;
    pbs_cubes *cubes;
    size_t list_cap, clouds_cap, cubes_cap;
} pbs_show;

/* options are borrowed until close. */
pbs_code pbs_show_open(pbs_run *run, const pbs_show_options *options, const char *path,
                       pbs_show *out, pbs_err *err);
/* What may change from picture to picture. */
typedef struct pbs_show_view {
    pbs_camera camera;
    uint32_t width, height;
    double surfel_size;
} pbs_show_view;
/* As the options have it. */
pbs_show_view pbs_show_first_view(const pbs_show *show);

/* Clears the canvas and draws; the caller ends or presents it. */
pbs_code pbs_show_draw(pbs_show *show, pbs_canvas *canvas, const pbs_show_view *view, pbs_err *err);
void pbs_show_close(pbs_show *show);
#endif
