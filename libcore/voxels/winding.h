/* winding.h: is a set of triangles closed, and which side of it is outside?
 *
 * It is closed if each edge is used as often in one direction as in the other. That is found out
 * without storing edges: each corner gets a place in a plane by chance (two numbers mod 2^64, made
 * from the bits of its position), and the areas of the triangles in this plane are summed. What
 * the edges inside add cancels, whatever the places are; the edges of a border leave a sum that is
 * 0 by a chance of about 2^-60. Sums of pieces add up, if a corner has the same bits in all.
 *
 * The volume inside, with its sign, says which way the triangles of a closed set look.
 */
#ifndef PBS_WINDING_H
#define PBS_WINDING_H

#include "libcore/data/mesh.h"

typedef struct pbs_winding {
    uint64_t border; /* 0: closed */
    double volume;   /* six times; of an open set: of the cone to the part's origin */
    double error;    /* the volume is right within this */
} pbs_winding;

/* -0 and +0 are the same place. */
pbs_winding pbs_winding_of(const pbs_mesh *mesh);
void pbs_winding_add(pbs_winding *sum, const pbs_winding *piece);

typedef enum pbs_wound {
    PBS_WOUND_OPEN,
    PBS_WOUND_FLAT, /* closed, but without a volume that is more than rounding */
    PBS_WOUND_OUT,  /* counter-clockwise seen from outside */
    PBS_WOUND_IN
} pbs_wound;
pbs_wound pbs_winding_says(const pbs_winding *w);
#endif
