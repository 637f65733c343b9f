/* poses.h: which animations play, and where they put what they move. Arithmetic only. */
#ifndef PBS_POSES_H
#define PBS_POSES_H

#include "formats/scene/motions.h"

typedef struct pbs_poses {
    pbs_run *run;
    const pbs_motions *motions;
    bool *plays;        /* of each animation */
    double *time;       /* of each: where it is; NaN where it does not play */
    double (*pose)[12]; /* of each motion */
    double at;          /* the time of the poses; NaN: there are none yet */
} pbs_poses;

/* choice: the number of an animation, a name, which all have that are called so, "all" (NULL, too)
 * or "none". motions are borrowed until close. Errors: PBS_USAGE if there is no such animation,
 * with those that there are; PBS_LIMIT. */
pbs_code pbs_poses_open(pbs_run *run, const pbs_motions *motions, const char *choice,
                        pbs_poses *out, pbs_err *err);
void pbs_poses_close(pbs_poses *poses);

/* Whether anything ever moves. */
bool pbs_poses_any(const pbs_poses *poses);

/* The pose of each motion at a time in seconds; every animation begins again when it is at its end.
 * NULL: everything rests, since nothing moves or the time is NaN. Valid until the next call. */
const double (*pbs_poses_at(pbs_poses *poses, double time))[12];
#endif
