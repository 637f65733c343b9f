/* extent.h: where everything below a node lies: in a box, and in a ball.
 *
 * The box of a box that is turned is larger, at each of a thousand nested nodes: after as many
 * degrees it is ten million times too large. A ball that is turned is the same ball. So both are
 * carried up, and each bounds the other: boxes are at most a few times too large however deep the
 * nodes are. Roundings are not bounded here (formats/scene/bounds.h does that).
 */
#ifndef PBS_EXTENT_H
#define PBS_EXTENT_H

#include "libcore/data/vec.h"

typedef struct pbs_extent {
    pbs_box box;
    double centre[3], radius; /* of the ball; meaningless if the box is empty */
} pbs_extent;
#define PBS_EXTENT_EMPTY ((pbs_extent){.box = PBS_BOX_EMPTY})

/* Of a box with everything in it. */
pbs_extent pbs_extent_of(const pbs_box *box);

/* What m places. */
pbs_extent pbs_extent_place(const double m[12], const pbs_extent *e);

/* Makes *to hold the other one, too. */
void pbs_extent_join(pbs_extent *to, const pbs_extent *other);
#endif
