/* blocks.h: the blocks of a grid that a scene's triangles touch, one after the other in Morton
 * order, with what touches each (paper 2, section 3: the tree is built while triangles come).
 *
 * Out of core and without a copy of any triangle. The scene stream is mapped; each unique mesh is
 * sorted into clusters once (cluster.h, in a pbs_scratch); then the octree of the grid is walked
 * down together with the DAG of nodes and the trees of boxes. What touches a cell of the octree is
 * a list of entries: a node that is placed, a mesh, some clusters of it. An entry that is larger
 * than the cell is opened, as long as the lists stay within their share of memory; what is not
 * opened there is opened for each block anew. So instances are never stored, and however many
 * triangles fall into one block, memory stays bounded; only time grows.
 */
#ifndef PBS_BLOCKS_H
#define PBS_BLOCKS_H

#include "formats/scene.h"
#include "libcore/block.h"
#include "libcore/cluster.h"

/* The exact box of all placed vertices, in the scene's coordinates. Only what may make the box
 * larger is looked at. triangles: with all instances; singular: placings whose transform cannot be
 * inverted. Errors: PBS_DATA if there is none, or not finite; PBS_LIMIT, PBS_CANCEL. */
pbs_code pbs_scene_box(const pbs_scene *s, pbs_box *out, uint64_t *triangles, uint64_t *singular,
                       pbs_err *err);

typedef enum pbs_orient {
    PBS_ORIENT_AUTO, /* per part: closed, each edge used once in each direction, and the volume says
                        which side is out; double-sided materials and all other parts: unknown */
    PBS_ORIENT_TRUST,  /* counter-clockwise is outside */
    PBS_ORIENT_UNKNOWN /* both sides of everything */
} pbs_orient;

typedef struct pbs_blocks pbs_blocks;

/* Sorts the meshes (on all threads). memory: what the lists may take, at least 1 MiB. The scene is
 * borrowed. Errors: PBS_LIMIT, PBS_IO, PBS_CANCEL. */
pbs_code pbs_blocks_new(const pbs_scene *s, const pbs_grid *grid, pbs_orient orient, size_t memory,
                        pbs_blocks **out, pbs_err *err);
void pbs_blocks_free(pbs_blocks *b); /* NULL is fine */

typedef struct pbs_near pbs_near; /* what touches a block: any thread may use it */

/* The next block that some box touches (the block with the layer of one cell around it): its lower
 * corner in cells, and what touches it, which is the caller's until pbs_near_free. *end: there is
 * no more. One thread at a time. Errors: PBS_LIMIT, PBS_CANCEL. */
pbs_code pbs_blocks_next(pbs_blocks *b, uint32_t at[3], pbs_near **near, bool *end, pbs_err *err);
void pbs_near_free(pbs_near *n); /* NULL is fine */

/* Adds to a block, which has begun at that corner, all triangles near it. */
pbs_code pbs_near_add(const pbs_near *n, pbs_block *block, pbs_err *err);

typedef struct pbs_blocks_stats {
    uint64_t parts_known, parts_turned, parts_unknown; /* by orientation; unique parts */
} pbs_blocks_stats;
pbs_blocks_stats pbs_blocks_totals(const pbs_blocks *b);
#endif
