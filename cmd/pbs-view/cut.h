/* cut.h: which prefix of which node is drawn, and with which discs (paper 1, section 4.1), and
 * which voxels are fine enough (paper 2, section 4).
 *
 * A node's surfels are a greedy permutation, and every surfel carries its spacing: the distance to
 * the nearest of the surfels before it. spacing[p] is the covering radius of the prefix of length
 * p: every other surfel of the node is within that distance of one in the prefix. So the paper's
 * p(r) = p_m (r_m / r)^2, an estimate, becomes a search in a table that falls.
 */
#ifndef PBS_CUT_H
#define PBS_CUT_H

#include "cmd/pbs-view/camera.h"
#include <stddef.h>

/* Spacings as they lie in the records: little-endian half floats, never rising. */
typedef struct pbs_spacings {
    const uint8_t *first; /* the spacing of surfel 0, not its record */
    size_t stride;        /* bytes from one to the next */
    uint32_t count;
    double unit;     /* length in the node's unit that the value 1 stands for */
    double covering; /* covering radius of all surfels, node's unit; 0: not known */
    double slack;    /* how far the surface can be from the candidates that spacings are
                        measured on, about 0.7 pixels of the G-buffer; node's unit. Without
                        it 1 in 5000 pixels is a pinhole, with it none (sphere, 50
                        candidates a surfel); 5% more radius do as much there. */
} pbs_spacings;

/* Covering radius of the first `prefix` surfels, and the slack, in the node's unit. The discs that
 * close the surface have this radius. A prefix of 0 counts as 1, more than all as all. */
double pbs_cut_radius(const pbs_spacings *s, uint32_t prefix);

/* The shortest prefix whose pbs_cut_radius is at most `radius`; all if there is none. */
uint32_t pbs_cut_prefix(const pbs_spacings *s, double radius);

/* Of points whose spacing is that of their level: the prefix of those with at least `radius`; the
 * ones behind are closer together than such discs are wide. */
uint32_t pbs_cut_adding(const pbs_spacings *s, double radius);

/* Depth, in view coordinates, that nothing of the box is nearer than which can be in the picture;
 * at least PBS_CAMERA_NEAR. m takes the box to the world. */
double pbs_cut_depth(const pbs_camera *camera, double aspect, const pbs_box *box,
                     const double m[12]);

/* Disc radius in the node's unit such that a disc, at its nearest, is `pixels` across. */
double pbs_cut_wanted(const pbs_camera *camera, unsigned height, double depth, double pixels,
                      const double m[12]);

/* Whether cells whose side is `side` (node's unit) are, at the nearest, at most `pixels` large. */
bool pbs_cut_fine(const pbs_camera *camera, unsigned height, double depth, double pixels,
                  double side, const double m[12]);

/* False only if nothing within `padding` (node's unit) of the box can be in the picture. */
bool pbs_cut_visible(const pbs_camera *camera, double aspect, const pbs_box *box, double padding,
                     const double m[12]);
#endif
