/* block.h: the voxels of a block of 64^3 cells (paper 2, section 3).
 *
 * Triangles are added in any order and any number; memory grows with the cells that are touched,
 * not with the triangles. Sums are whole numbers, so the result does not depend on the order of the
 * triangles, nor on the calls that they come in.
 *
 * Which cells become voxels: grid.h. Normals, colours, materials are means over the clipped area. A
 * cell that is hit without any area in it takes its triangles' attributes with a weight of 2^-30.
 * The area in cells that do not become voxels is dropped, and counted.
 *
 * Normals and faces. A face is in the mask if any triangle in the voxel looks out of it (the sign
 * of the normal's component), if not the six-separating neighbour behind it hides it; faces on the
 * border of a chunk are never hidden and always there, so that levels of detail can meet ("caps").
 * A voxel whose faces are all hidden has none, and is kept for its attributes; one of which nothing
 * says where it is seen from (triangles without area) is seen from all around.
 * Normals are summed apart for the two sides of a fixed plane: where the mean of all is short (less
 * than PBS_BLOCK_THIN), the two sides of a sheet are in one voxel, which is then two-sided and has
 * the normal of the sheet. Triangles whose orientation is not known look out of both their sides,
 * and so do all if the viewer may be inside (`interior`); such voxels are two-sided, too. What is
 * not known is most often the same all over a part, so their normals are added as they are, vertex
 * normals if there are any: to turn all to one side of a plane breaks surfaces where they meet it.
 *
 * Colours are means in linear light, of surfaces seen with pixels of the size of a voxel. A
 * triangle of a masked material is in a cell if it is there at its point nearest to the cell's
 * middle.
 */
#ifndef PBS_BLOCK_H
#define PBS_BLOCK_H

#include "libcore/gbuffer/gbuffer.h"
#include "libcore/voxels/grid.h"
#include "libcore/voxels/voxel.h"

#define PBS_BLOCK_THIN 0.3

typedef enum pbs_cells { PBS_CELLS_THIN, PBS_CELLS_SEPARATING, PBS_CELLS_CONSERVATIVE } pbs_cells;
typedef enum pbs_per_face {
    PBS_PER_FACE_NONE,
    PBS_PER_FACE_MATERIAL, /* the id with the largest area, projected along the face's axis; ties to
                              the lower id */
    PBS_PER_FACE_COLOUR    /* the mean, sRGB */
} pbs_per_face;

typedef struct pbs_block_params {
    uint32_t channels; /* of PBS_NORMAL | WEIGHT | COLOUR | MATERIAL | EMISSIVE. 0: the set alone,
                          with faces; cells is PBS_CELLS_SEPARATING then */
    pbs_cells cells;
    pbs_per_face per_face;
    bool interior;
    const pbs_surfaces *surfaces; /* borrowed; made for the channels, and PBS_COLOUR if faces have
                                     colours; may be NULL if nothing needs it: then there are no
                                     masked materials */
} pbs_block_params;

/* Bytes that a block takes at most, all of its cells being touched: 26 MiB with normals and
 * weights; a colour adds 9 MiB, material 5, emissive 7; attributes of faces 0.5 KiB for each
 * material in a cell, of which one is counted here, or 1.4 KiB a cell for colours. Sums that are
 * large (64 square voxels in a cell) take up to 17 MiB more, if they are in all. A block of an even
 * surface takes 2 MiB. */
size_t pbs_block_memory(const pbs_block_params *params);

/* One thread's scratch. Kept from block to block: fresh memory costs as much as the work. */
typedef struct pbs_block pbs_block;
pbs_code pbs_block_new(pbs_run *run, const pbs_block_params *params, pbs_block **out, pbs_err *err);
void pbs_block_free(pbs_block *b); /* NULL is fine */

/* at: the block's lower corner in cells, multiples of PBS_BLOCK. size: of the grid; cells beyond it
 * do not become voxels. */
void pbs_block_begin(pbs_block *b, const uint32_t at[3], uint32_t size);

typedef enum pbs_sides {
    PBS_SIDES_OUT,    /* counter-clockwise seen from outside, in the part's own frame */
    PBS_SIDES_IN,     /* clockwise */
    PBS_SIDES_UNKNOWN /* both */
} pbs_sides;

/* Adds triangles[0 .. count - 1] of the mesh. Triangles that do not touch the block cost a few
 * nanoseconds. Materials are the surfaces'. A mirrored placing turns a triangle's normal over, as
 * it should. Errors: PBS_LIMIT, PBS_CANCEL; the block must begin anew. */
pbs_code pbs_block_add(pbs_block *b, const pbs_mesh *mesh, const uint32_t *triangles, size_t count,
                       const pbs_to_grid *to, pbs_sides sides, pbs_err *err);

typedef struct pbs_block_stats {
    uint64_t triangles; /* that touch cells of the block itself; for the set alone, that hit some */
    uint64_t fragments; /* pairs of a triangle and a cell */
    uint64_t touched;   /* cells of the conservative set; 0 for the set alone */
    uint64_t orphans;   /* voxels that are not six-separating, and kept (PBS_CELLS_THIN) */
    uint64_t lost; /* triangles that may be near, with a corner farther than 2^1000 voxels: left out
                    */
    double area, kept; /* of all fragments; of those in voxels; square voxels */
} pbs_block_stats;

/* The voxels in Morton order; places are relative to the chunk of 256^3 that the block is in. *out
 * and its arrays belong to the block and are valid until the next begin; faces: the list that
 * out->face points into. stats may be NULL. Errors: PBS_LIMIT. */
pbs_code pbs_block_end(pbs_block *b, pbs_voxels *out, const uint32_t **faces, size_t *face_count,
                       pbs_block_stats *stats, pbs_err *err);
#endif
