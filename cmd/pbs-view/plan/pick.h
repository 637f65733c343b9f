/* pick.h: which part a point of the picture belongs to. The depth under the cursor makes it a point
 * of the world; of all placed parts whose box holds it, it is that of the smallest box. So surfels
 * of an assembly are named by the part they were taken from, and no id has to be drawn or stored.
 * Pure arithmetic. */
#ifndef PBS_PICK_H
#define PBS_PICK_H

#include "cmd/pbs-view/plan/camera.h"
#include "formats/scene/node.h"

/* A point of the world from a column and a row of the picture, as shares from its left upper
 * corner, and the depth there in view coordinates. */
void pbs_pick_point(double out[3], const pbs_camera *camera, double aspect, double x, double y,
                    double depth);

/* What is looked at. */
typedef struct pbs_pick_scene {
    const pbs_node *nodes; /* the last is the root */
    size_t count;
    const uint64_t *moving;   /* placings that an animation moves, below each node; with pose */
    const double (*pose)[12]; /* of each motion; NULL: everything rests */
} pbs_pick_scene;

/* "plant / pump 3 / shaft": the names from the root to the part, those that have one; "node 17" if
 * none has. tolerance, world unit: how far outside of its box a point of a part may lie. *part: it
 * is a part; false: an assembly, none of whose parts' boxes hold the point, or "", where no box
 * does. Goes by boxes that hold the point, at most a million of them: a hierarchy that places more
 * around one point is named by what was found until then. Errors: PBS_LIMIT. */
pbs_code pbs_pick(pbs_run *run, const pbs_pick_scene *scene, const double point[3],
                  double tolerance, char *out, size_t size, bool *part, pbs_err *err);
#endif
