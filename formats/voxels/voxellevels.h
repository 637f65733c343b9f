/* voxellevels.h: finest voxels become nodes of all coarser levels, in a stream in which children
 * come before their parents (paper 2, section 3, "Level of detail").
 *
 * Up to the chunk that holds the whole grid a parent has up to eight children, beyond it one; a
 * level with few enough voxels is the last. The finest nodes are written by the caller, each after
 * its voxels were added here, with the number that they have here.
 */
#ifndef PBS_VOXELLEVELS_H
#define PBS_VOXELLEVELS_H

#include "formats/voxels/voxelpile.h"
#include "formats/voxels/voxelstream.h"
#include "libcore/voxels/coarsen.h"
#include "libcore/voxels/morton.h"

#define PBS_LEVELS_MAX 32

typedef struct pbs_levels_params {
    uint64_t least; /* a level with at most so many voxels has none above it, if it is one chunk */
    uint32_t most;  /* levels above the finest, at most */
} pbs_levels_params;

typedef struct pbs_level_out {
    pbs_pile voxels, faces;
    pbs_place_look look;
    uint32_t child[8], child_count;
    pbs_box below; /* of the children */
} pbs_level_out;

typedef struct pbs_levels {
    pbs_run *run;
    pbs_writer *w; /* borrowed */
    pbs_levels_params params;
    uint32_t channels;
    bool face_colour;
    pbs_coarsen *coarsen;
    pbs_grid grid;        /* voxel 0: no node came so far */
    uint32_t size, whole; /* of the grid; level of the chunk that holds it */
    uint32_t made, last;  /* levels that coarsen makes; the one that has none above it */
    uint32_t next;        /* number of the next node */
    pbs_level_out level[PBS_LEVELS_MAX];
    pbs_child *top; /* nodes that have none above them */
    size_t top_count, top_cap;
    pbs_box box;                     /* of these */
    const char *name;                /* of the root */
    uint64_t triangles;              /* below the root */
    bool rooted;                     /* the last node is the root */
    uint64_t voxels[PBS_LEVELS_MAX]; /* written, of each level */
    uint32_t nodes;
} pbs_levels;

/* place: of any chunk of the finest level. *s must not move. Errors: PBS_LIMIT. */
pbs_code pbs_levels_begin(pbs_levels *s, pbs_run *run, pbs_writer *w, uint32_t channels,
                          bool face_colour, const pbs_voxel_place *place,
                          const pbs_levels_params *params, pbs_err *err);
/* Voxels of a chunk of the finest level, as for pbs_coarsen_add. Nodes of coarser levels may be
 * written, if it is another chunk than before; s->next is the number of this one's after it. */
pbs_code pbs_levels_add(pbs_levels *s, const uint32_t chunk[3], const pbs_voxels *v,
                        const uint32_t *faces, size_t face_count, pbs_err *err);
/* The finest node whose voxels were added was written as number s->next. place: its chunk. Errors:
 * PBS_DATA if it is not in the grid of the others. */
pbs_code pbs_levels_finest(pbs_levels *s, const pbs_voxel_place *place, const pbs_node *node,
                           pbs_err *err);
/* All chunks that are open, and the root, which is the coarsest chunk, or a node without voxels if
 * there are several of them, or if it is a finest one. Not the footer. */
pbs_code pbs_levels_end(pbs_levels *s, const char *name, uint64_t triangles, pbs_err *err);
/* Always; zeroed is fine. */
void pbs_levels_free(pbs_levels *s);
#endif
