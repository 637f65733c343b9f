/* grid.h: the lattice of cells that triangles are turned into voxels on (paper 2, section 3).
 *
 * Coordinates are in voxels: cell (i, j, k) is [i, i+1) x [j, j+1) x [k, k+1), half open along each
 * axis, so that every point of space lies in exactly one cell. That is the one rule for borders:
 * what lies on a face between two cells belongs to the upper one, its area too.
 *
 * A corner is rounded once to a multiple of 2^-32 voxel, by a function of its own coordinates
 * alone: what triangles share stays shared. A coordinate is at most 2^20 voxels, so it is exact as
 * a double, and so is the difference of two. From there on every decision is exact: the set of
 * voxels is that of the rounded triangles, not an approximation of it.
 *
 *     conservative     cells that hold a point of a triangle (a triangle is closed: its edges and
 *                      corners belong to it)
 *     six-separating   cells in which a point of a triangle lies on the cell's crosshair: the three
 *                      segments through its middle along the axes, half open as the cell is (Laine
 *                      2013, which paper 2 uses). A path from cell to cell through faces cannot
 *                      cross the surface without meeting one
 *     thin             six-separating, and those conservative cells that have no six-separating
 *                      neighbour behind any of their faces. A plane has none of those: there, the
 *                      neighbour along the longest axis of the normal, towards the plane, is always
 *                      six-separating. So they are needles, tips, and parts that are smaller than
 *                      a voxel, which would vanish else. Cells without any area
 *                      in them, touched at a corner or an edge, are not kept if a six-separating
 * one is among the 26 around them
 */
#ifndef PBS_GRID_H
#define PBS_GRID_H

#include "libcore/data/vec.h"
#include <stdint.h>

#define PBS_GRID_BITS 32      /* of a coordinate behind the binary point */
#define PBS_GRID_FAR  1048576 /* voxels: coordinates are within this of 0 */
#define PBS_GRID_MAX  65536   /* cells along an axis */
#define PBS_BLOCK     64      /* cells along an axis of what is worked on at a time */
#define PBS_CHUNK     256     /* and of what is stored together: positions have 8 bits */

typedef struct pbs_grid {
    double min[3]; /* lower corner of cell 0, 0, 0 in the scene's coordinates */
    double voxel;  /* side of a cell */
    uint32_t size; /* cells along each axis, 1 .. PBS_GRID_MAX */
} pbs_grid;

/* The cube of size^3 cells around a box: half a voxel is left on each side of the box's longest
 * axis, and below it on the others, so that nothing lies on the cube's own faces, and the faces of
 * a box lie in the middle of cells. The box is not empty; one that is a point has voxels of side 1.
 */
pbs_grid pbs_grid_around(const pbs_box *box, uint32_t size);

/* A placing's transform to the grid. The fraction of the translation is added before a coordinate
 * is rounded, whole voxels after it, so that a scene that moves by whole voxels keeps all its
 * fractions. */
typedef struct pbs_to_grid {
    double m[9];     /* rows: part coordinates to voxels */
    double part[3];  /* fraction of the translation, [0, 1) */
    double whole[3]; /* the rest of it, whole voxels */
} pbs_to_grid;

/* m: part coordinates to the scene's (vec.h). False if the numbers are not finite or too large. */
bool pbs_to_grid_make(pbs_to_grid *out, const pbs_grid *grid, const double m[12]);

/* A batch of triangles in the frame of a block: coordinates relative to the block's lower corner,
 * in voxels, whole multiples of 2^-32, at most PBS_GRID_FAR from 0. Triangles may have no area. */
#define PBS_TRIANGLES 64
typedef struct pbs_triangles {
    _Alignas(64) double p[3][3][PBS_TRIANGLES]; /* [corner][axis][triangle] */
    double min[3][PBS_TRIANGLES], max[3][PBS_TRIANGLES];
    uint32_t count;
} pbs_triangles;

/* A cell of a block and of the cells around it: coordinates -1 .. 64, each plus one, 7 bits. */
#define PBS_CELL(x, y, z)                                                                          \
    ((uint32_t)((x) + 1) | (uint32_t)((y) + 1) << 7 | (uint32_t)((z) + 1) << 14)
#define PBS_CELL_X(c) ((int)((c)&127) - 1)
#define PBS_CELL_Y(c) ((int)((c) >> 7 & 127) - 1)
#define PBS_CELL_Z(c) ((int)((c) >> 14 & 127) - 1)
#endif
