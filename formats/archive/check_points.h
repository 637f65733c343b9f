/* check_points.h: does a cloud keep what it promises: that any two of its points are at least as
 * far apart as the smaller one of their spacings says (pbs-container(5), point clouds)? */
#ifndef PBS_CHECK_POINTS_H
#define PBS_CHECK_POINTS_H

#include "formats/scene/node.h"
#include "formats/surfels/points.h"

/* Looks at all nodes whose points add to those above them (PBS_NODE_ADDS), once everything else is
 * known to be right: each with itself, with all that are above it, and with all others that its
 * points can be too near to. Also that spacings are those of levels and never rise in a node, that
 * points are in their node's box, and that nodes lie on one lattice, unmoved.
 *
 * Exact: in integers. Memory: a node's points, those of others near it, and 150 bytes a node; never
 * all points. Only where origins are so large that doubles cannot tell neighbouring lattice points
 * apart, nodes are looked at one by one. Errors: PBS_DATA, PBS_LIMIT. */
pbs_code pbs_check_clouds(pbs_run *run, pbs_reader *r, const pbs_record *record,
                          const pbs_chunk *entries, size_t count, pbs_err *err);
#endif
