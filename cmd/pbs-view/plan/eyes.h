/* eyes.h: from where a picture is seen: one eye, or two side by side, and how large surfels are
 * that lie off the line of sight. Pure arithmetic.
 *
 * Two eyes share one cut (paper 1, section 4.4; paper 3, section 3.3.1 does the same for points):
 * a node is drawn if either sees it, as fine as the one needs that needs it finer.
 */
#ifndef PBS_EYES_H
#define PBS_EYES_H

#include "cmd/pbs-view/plan/camera.h"
#include "cmd/pbs-view/plan/zones.h"
#include <stdint.h>

typedef struct pbs_eyes {
    int count; /* 1 or 2 */
    pbs_camera camera[2];
    uint32_t left[2], width, height; /* columns of the picture; equal sizes */
    int32_t from[2];        /* where each camera's own picture begins, of which its columns are a */
    uint32_t wide;          /* part, and its columns: the frusta are off the axis */
    double aspect;          /* of that */
    const pbs_zones *zones; /* NULL: none */
    double gaze[2][3];      /* in each eye's view coordinates */
} pbs_eyes;

/* separation: distance of the eyes, world unit; 0: one eye with the whole picture. Each of two has
 * half of the columns, the left eye the left ones. Their axes are parallel; what is as far away as
 * focus, world unit, is at the same place in both parts, to half a pixel; 0: that is at infinity.
 * gaze: shares of each eye's part from its left upper corner; looked at with zones only. */
void pbs_eyes_of(pbs_eyes *out, const pbs_camera *camera, uint32_t width, uint32_t height,
                 double separation, double focus, const pbs_zones *zones, const double gaze[2]);

/* As pbs_cut_visible: either eye sees it. */
bool pbs_eyes_see(const pbs_eyes *eyes, const pbs_box *box, double padding, const double m[12]);
/* As pbs_cut_depth: the lesser of both. */
double pbs_eyes_depth(const pbs_eyes *eyes, const pbs_box *box, const double m[12]);
/* Surfel size, times the zone's factor, for what is in the box. */
double pbs_eyes_size(const pbs_eyes *eyes, double size, const pbs_box *box, const double m[12]);
#endif
