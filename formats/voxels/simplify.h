/* simplify.h: a stream of voxels of the finest level becomes one of all levels, in one pass.
 *
 * Chunks come in Morton order, as pbs-voxelize writes them. Those of a file may come in any order:
 * they are read through its directory then. Voxels within a node may come in any order: they are
 * sorted then, in $TMPDIR if they are many. Coarser levels that the stream has already, and its
 * root, are left out and made anew.
 */
#ifndef PBS_SIMPLIFY_H
#define PBS_SIMPLIFY_H

#include "formats/voxels/voxellevels.h"

typedef struct pbs_simplified {
    uint64_t voxels, coarser; /* of the finest level; of all others */
    uint32_t levels;          /* all that have voxels */
    uint64_t coarsest;        /* voxels of the last of these */
    uint32_t nodes;
    uint32_t nodes_sorted; /* whose voxels were not in order */
    bool ordered;          /* chunks were not in order */
} pbs_simplified;

/* Reads r to its end, and writes all chunks to w. Errors: PBS_DATA, PBS_LIMIT, PBS_IO. */
pbs_code pbs_simplify(pbs_run *run, pbs_reader *r, pbs_writer *w, const pbs_levels_params *params,
                      pbs_simplified *out, pbs_err *err);
#endif
