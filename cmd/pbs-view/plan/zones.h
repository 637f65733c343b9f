/* zones.h: foveation: larger surfels away from where one looks: paper 1, section 4.4. Pure
 * arithmetic.
 *
 * A zone is an angle from the line of sight and a factor of the surfel size there; between two
 * angles the factor is interpolated, and it is the nearest one's before the first and behind the
 * last. A node takes the factor of the smallest angle at which any of it can be seen.
 */
#ifndef PBS_ZONES_H
#define PBS_ZONES_H

#include "libcore/ground/err.h"
#include "libcore/data/vec.h"

enum { PBS_ZONES_MOST = 8 };

typedef struct pbs_zones {
    int count;                    /* 0: the factor is 1 everywhere */
    double angle[PBS_ZONES_MOST]; /* degrees, rising */
    double factor[PBS_ZONES_MOST];
} pbs_zones;

/* "ANGLE:FACTOR[,ANGLE:FACTOR...]": angles rising from 0 to 180, factors from 0.1 to 100. Errors:
 * PBS_USAGE. */
pbs_code pbs_zones_parse(pbs_zones *out, const char *text, pbs_err *err);

/* NaN counts as angle 0. */
double pbs_zones_factor(const pbs_zones *zones, double degrees);

/* Direction, of length 1 in view coordinates, of a point of the picture: x and y are shares of it
 * from its left upper corner, tan_x and tan_y those of half its field of view. */
void pbs_zones_gaze(double out[3], double tan_x, double tan_y, double x, double y);

/* A lower bound, in degrees, for the angle between the gaze and anything in the box; 0 if the eye
 * is in the sphere around it. view takes the box to view coordinates. */
double pbs_zones_angle(const double gaze[3], const pbs_box *box, const double view[12]);
#endif
