/* voxelstream.h: the voxels of blocks, one after the other, become the chunks and nodes of a voxel
 * stream (voxels.h).
 */
#ifndef PBS_VOXELSTREAM_H
#define PBS_VOXELSTREAM_H

#include "formats/scene/node.h"
#include "formats/voxels/voxels.h"
#include "libcore/voxels/block.h"

typedef struct pbs_voxelstream {
    pbs_run *run;
    pbs_writer *w; /* borrowed */
    pbs_grid grid;
    uint32_t channels;
    bool face_colour;
    pbs_voxel_place place; /* of the chunk that is open */
    pbs_voxels held;       /* not written yet, at most PBS_VOXELS_CHUNK */
    size_t cap;
    uint32_t *faces; /* of the open chunk, not written yet */
    size_t face_count, face_cap;
    uint64_t written, faces_written; /* of the open chunk */
    uint8_t low[3], high[3];         /* cells of it that are voxels */
    pbs_child *children;             /* of the root: all chunks so far */
    size_t child_count, child_cap;
    pbs_box box; /* of all voxels */
    uint64_t voxels;
} pbs_voxelstream;

/* channels: PBS_POSITION | ...; PBS_FACE if there are lists of faces, face_colour what they are. */
void pbs_voxelstream_begin(pbs_voxelstream *s, pbs_run *run, pbs_writer *w, const pbs_grid *grid,
                           uint32_t channels, bool face_colour);
/* Voxels of the block whose lower corner is `at`, as pbs_block_end gives them; blocks come in
 * Morton order. Errors: PBS_LIMIT, PBS_IO. */
pbs_code pbs_voxelstream_add(pbs_voxelstream *s, const uint32_t at[3], const pbs_voxels *v,
                             const uint32_t *faces, size_t face_count, pbs_err *err);
/* The last chunk, and the root. triangles: of the scene. Not the footer. */
pbs_code pbs_voxelstream_end(pbs_voxelstream *s, const char *name, uint64_t triangles,
                             pbs_err *err);
/* Always. */
void pbs_voxelstream_free(pbs_voxelstream *s);

/* The node of a chunk of cells, without name and children. low, high: its least and largest cells
 * that are voxels. */
pbs_node pbs_voxel_node(const pbs_grid *grid, const pbs_voxel_place *place, uint32_t id,
                        uint64_t voxels, const uint8_t low[3], const uint8_t high[3]);
/* Level of the chunk that holds the whole grid. */
uint32_t pbs_voxel_levels(uint32_t size);
#endif
