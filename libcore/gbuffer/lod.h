/* lod.h: which nodes of a hierarchy get surfels, how many, and when they are fine enough to stand
 * for their node in the picture of one above it (paper 1, sections 3.4 and 5).
 */
#ifndef PBS_LOD_H
#define PBS_LOD_H

#include "libcore/data/vec.h"
#include <stdbool.h>
#include <stdint.h>

typedef struct pbs_lod {
    uint64_t least;      /* triangles: a node with fewer has no surfels, a group above it has */
    double share;        /* surfels a triangle, at most */
    uint64_t most;       /* surfels of a node, at most */
    uint32_t resolution; /* of the G-buffers of a node with `most` surfels; 0: from the count */
    double error;        /* that surfels may have, in the scene's unit; 0: as small as can be */
} pbs_lod;
#define PBS_LOD_DEFAULT ((pbs_lod){1000, 0.5, 200000, 0, 0})

/* Surfels wanted for a node of so many triangles; 0: none. A top, which nothing above stands for,
 * always gets `most`: there it is surfels or nothing. */
uint32_t pbs_lod_count(const pbs_lod *lod, uint64_t triangles, bool top);

/* Pixels along the longest side of its views: about twenty candidates a surfel, since over eight
 * views a third of the pixels is covered; but not more than lod->error needs of a node whose box
 * has this longest side. 64 at least, PBS_GBUFFER_MAX_SIZE at most. */
uint32_t pbs_lod_resolution(const pbs_lod *lod, uint32_t count, double side);

/* How much longer m makes a vector at most: its largest singular value. */
double pbs_lod_stretch(const double m[12]);

/* The surface is at most this many pixels of the G-buffer from the nearest candidate that shows it:
 * half a diagonal of a pixel that is seen head-on. */
#define PBS_LOD_SLACK 0.7
/* An error is this many pixels: with fewer the candidates take up too much of it, and with more
 * they are too many. */
#define PBS_LOD_ERROR 5

/* Surfels lie about this many pixels of their G-buffer apart. */
#define PBS_LOD_SPACING 3.5
/* Covering radius, in pixels of the G-buffer, up to which surfels count as dense there. What is
 * lost is at most that: about a quarter of the distance between the surfels chosen from it. */
#define PBS_LOD_DENSE 1.25

/* A part that is placed at an angle is seen in directions from which its own views did not look at
 * it, and its surfels do not show what only these see: so they stand for it only if it is at most
 * this many pixels large. */
#define PBS_LOD_ANY_ANGLE 10

/* Whether m takes the diagonals of a cube, and its axes, to one another: quarter turns, mirrors,
 * one scale, to 1 %. */
bool pbs_lod_keeps_views(const double m[12]);

/* Whether the surfels of a node with this box, whose own G-buffer had pixels of `below`, show it in
 * a G-buffer with pixels of `pixel`, into which m takes them. Decided before there are surfels, so
 * that all programs decide the same. */
bool pbs_lod_fine(const pbs_box *box, double below, const double m[12], double pixel);
#endif
