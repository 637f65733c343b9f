/* evenness.h: how evenly points lie on a surface: what spacing.h says of a short prefix, for any
 * number of points, and against the surface.
 *
 * Distances are plain (Euclid) and exact. A grid is looked through, so the time is near-linear for
 * points that are nearly evenly spread; it never is more than that of all pairs.
 */
#ifndef PBS_EVENNESS_H
#define PBS_EVENNESS_H

#include "libcore/data/record.h"
#include "libcore/ground/run.h"

typedef struct pbs_evenness {
    size_t count; /* points that are finite */
    /* Of the distance of a point to the nearest other one; 0 if there are fewer than two. */
    double least, mean, sigma;
    double percentile; /* one in a hundred is nearer */
    /* Of the distance of the surface's points to the nearest point: the largest, and the one that
     * one in a hundred is above; infinite if there are none. 0 without a surface. */
    double covering, covering99;
    /* Standard deviation over mean of the number of points within `radius` of points of the
     * surface, which are weighted by their area: 0 if it is the same everywhere. */
    double scatter;
} pbs_evenness;

/* surface: its points, much denser than p, and equally dense everywhere; NULL: none. Of it at most
 * PBS_EVENNESS_DISCS are taken for scatter, at equal steps. Points that are not finite are left
 * out. Errors: PBS_LIMIT, PBS_CANCEL. */
#define PBS_EVENNESS_DISCS 4096u
pbs_code pbs_evenness_of(pbs_run *run, const pbs_points *p, const pbs_points *surface,
                         double radius, pbs_evenness *out, pbs_err *err);
#endif
