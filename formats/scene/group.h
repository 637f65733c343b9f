/* group.h: a flat list of placed children becomes a tree of groups: paper 1, sections 3.1 and 3.4,
 * by a loose octree (Ulrich, "Loose octrees", Game Programming Gems, 2000).
 *
 * A child that is larger than half a cell stays at that cell, the others go to the eight cells
 * below by the centre of their boxes; so a cell's children reach at most half its side over its
 * border. A cell stops dividing at `limit` children or below 4000 triangles. A cell of at most 8
 * children or of less than 1000 triangles, which would have no surfels of its own, is dissolved
 * into the one above.
 */
#ifndef PBS_GROUP_H
#define PBS_GROUP_H

#include "libcore/ground/run.h"
#include "libcore/data/vec.h"

typedef struct pbs_group_item {
    pbs_box box; /* empty or not finite: it stays at the top */
    uint64_t triangles;
    bool apart; /* stays at the top, too */
} pbs_group_item;

typedef struct pbs_grouping {
    const pbs_group_item *item;
    uint32_t count;
    uint64_t limit; /* children of a group; at least 1 */
    void *ctx;
    /* A group, in the order of their numbers: what it holds. Numbers below count are items, the
     * others are groups that were made before, counted from there. Ascending. */
    pbs_code (*make)(void *ctx, const uint32_t *ref, size_t n, pbs_err *err);
} pbs_grouping;

/* *top: what is left at the top, as in make; *n numbers, pbs_free gives them back. */
pbs_code pbs_group(pbs_run *run, const pbs_grouping *g, uint32_t **top, size_t *n, pbs_err *err);
#endif
