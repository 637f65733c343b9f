/* lanes.h: what resolve.c computes side by side, and shade.c reads. */
#ifndef PBS_LANES_H
#define PBS_LANES_H

#include "libcore/data/mesh.h"

#define PBS_LANES_BATCH 64

/* A draw, ready to be hit. */
typedef struct pbs_placed {
    const pbs_draw *draw;
    uint32_t number, first; /* of the draw, of its first triangle */
    double view[8];         /* x and y rows of pbs_pair_project */
    double cofactor[9];     /* scaled to at most 1 */
} pbs_placed;

/* A batch of pixels of one row and one view, lane by lane; consecutive lanes with one placed mesh
 * are computed together. The last lanes repeat the last pixel, so that every lane can be read. */
enum { PBS_LANES = PBS_LANES_BATCH + 4 };
typedef struct pbs_lanes {
    int count;
    const pbs_placed *place[PBS_LANES];
    uint32_t x[PBS_LANES]; /* in the even view */
    uint32_t triangle[PBS_LANES], corner[3][PBS_LANES];
    float p[3][3][PBS_LANES]; /* corners in the part's coordinates */
    int32_t normal[3][PBS_LANES];
    double centre[2][PBS_LANES]; /* of the pixel, in 1/256 pixel */
    /* Seen from the view: the edges from corner 0, in 1/256 pixel, and their area. */
    double a[2][2][PBS_LANES], det[PBS_LANES];
    double b[3][PBS_LANES]; /* barycentric */
    float position[3][PBS_LANES];
    int32_t code[PBS_LANES]; /* octahedral normal */
} pbs_lanes;
#endif
