/* blocks.h: the blocks of a grid that a scene's triangles touch, one after the other in Morton
 * order, with what touches each (paper 2, section 3: the tree is built while triangles come).
 *
 * Out of core and without a copy of any triangle. The scene stream is mapped; each unique mesh is
 * sorted into clusters once (cluster.h, in a pbs_scratch); then the octree of the grid is walked
 * down together with the DAG of nodes and the trees of boxes. What touches a cell of the octree is
 * a list of entries: a node that is placed, a mesh, some clusters of it. An entry that is larger
 * than the cell is opened, as long as the lists stay within their share of memory; what is not
 * opened there is opened for each block anew. A cluster that is larger stays only if some triangle
 * of it touches the cell (blocks_touch.c): the box of a needle says nothing. So instances are never
 * stored, and however many triangles fall into one block, memory stays bounded; only time grows.
 */
#ifndef PBS_BLOCKS_H
#define PBS_BLOCKS_H

#include "formats/scene/scene.h"
#include "libcore/voxels/block.h"
#include "libcore/voxels/cluster.h"

/* The exact box of all placed vertices, in the scene's coordinates: that of pbs_scene_flatten, bit
 * for bit. Only what may make the box larger is looked at. triangles: with all instances,
 * UINT64_MAX if there are more; singular: placings of parts below a transform that cannot be
 * inverted. Errors: PBS_DATA if there is none, or not finite, or the numbers of more than 2^20
 * placings overflow, of which none can be left out; PBS_LIMIT, PBS_CANCEL. */
pbs_code pbs_scene_box(const pbs_scene *s, pbs_box *out, uint64_t *triangles, uint64_t *singular,
                       pbs_err *err);

typedef enum pbs_orient {
    PBS_ORIENT_AUTO,  /* per part: closed, each edge used as often in one direction as in the other,
                         and the volume says which side is out; all other parts: unknown. What
                         materials say of their sides does not matter. A part that was split (its
                         pieces are placed where they are, around one origin) counts as a whole,
                         unless a piece is closed by itself */
    PBS_ORIENT_TRUST, /* counter-clockwise is outside */
    PBS_ORIENT_UNKNOWN /* both sides of everything */
} pbs_orient;

typedef struct pbs_blocks pbs_blocks;

/* Sorts the meshes (on all threads). memory: what the lists may take, at least 1 MiB; all of it is
 * counted now. Clusters take 4.5 bytes a unique triangle besides, in a file if that is much. The
 * scene is borrowed. Errors: PBS_LIMIT, PBS_IO, PBS_CANCEL. */
pbs_code pbs_blocks_new(const pbs_scene *s, const pbs_grid *grid, pbs_orient orient, size_t memory,
                        pbs_blocks **out, pbs_err *err);
void pbs_blocks_free(pbs_blocks *b); /* NULL is fine */

/* What touches a block; any thread may use it, while the walk goes on. At most a quarter of the
 * lists' memory. */
typedef struct pbs_nearby pbs_nearby;

/* The next block that some box touches (the block with the layer of one cell around it): its lower
 * corner in cells, and what touches it, which is the caller's until pbs_nearby_free and goes before
 * the pbs_blocks does. *end: there is no more. Which blocks triangles touch, and which ones, does
 * not depend on memory; a block that only boxes touch may come or not. One thread at a time.
 * Errors: PBS_LIMIT, PBS_CANCEL; the walk is over then. */
pbs_code pbs_blocks_next(pbs_blocks *b, uint32_t at[3], pbs_nearby **near, bool *end, pbs_err *err);
void pbs_nearby_free(pbs_nearby *n); /* NULL is fine */

/* Called with triangles of a mesh, all near each other; arguments as of pbs_block_add. */
typedef pbs_code (*pbs_nearby_fn)(void *ctx, const pbs_mesh *mesh, const uint32_t *triangles,
                                  size_t count, const pbs_to_grid *to, pbs_sides sides,
                                  pbs_err *err);

/* Visits all triangles near the block, for each placing once, and some more: clusters whose box
 * touches it. Placings with NaN are left out. Errors: PBS_DATA if a placing near the block has
 * numbers that are too large for the grid; PBS_LIMIT, PBS_CANCEL, and fn's. */
pbs_code pbs_nearby_visit(const pbs_nearby *n, pbs_nearby_fn fn, void *ctx, pbs_err *err);
/* Adds them to a block, which has begun at that corner. */
pbs_code pbs_nearby_add(const pbs_nearby *n, pbs_block *block, pbs_err *err);

/* Whether a triangle is surely apart from the box around 0 that reaches so far along each axis.
 * Never if they touch. */
bool pbs_triangle_misses(const double corner[3][3], const double half[3]);

typedef struct pbs_blocks_stats {
    uint64_t parts_known,
        parts_unknown;     /* unique parts with meshes: is it known which side is out? */
    uint64_t parts_turned; /* of those known: inside out */
} pbs_blocks_stats;
pbs_blocks_stats pbs_blocks_totals(const pbs_blocks *b);
#endif
