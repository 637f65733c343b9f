/* voxels.h: voxels as bytes: the VOXL and VFAC chunks.
 *
 * A node of a voxel stream is a chunk of cells: a cube of at most 256^3 at one level of detail. Its
 * voxels are one or more VOXL chunks of at most PBS_VOXELS_CHUNK each, which go on where the last
 * one ended, in Morton order. A payload is 64 bytes that say which chunk of cells it is, and then,
 * for each channel that the header's channels line names, count times 4 bytes:
 *
 *     place:u8x4 [normal:i10x3] [weight:f32] [colour:u8x4] [material:u8x4] [emissive:u8x4]
 *     [face:u32]
 *
 * VFAC chunks hold the attributes of faces of the node, u32 each, in the order in which face points
 * to them: a material's id, or a colour u8x4; the chunk's bit 12 says colour.
 *
 * NODE: origin is the lower corner of the chunk's cell 0, 0, 0 in the scene's coordinates, lattice
 * the side of its cells, lattice_min 0, records the number of voxels, box that of its cells. A
 * stream of pbs-voxelize has the finest level only, chunks in Morton order, and a root without
 * voxels whose children they are; pbs-simplify puts the levels above in between, children first,
 * all children placed with the identity.
 */
#ifndef PBS_FORMAT_VOXELS_H
#define PBS_FORMAT_VOXELS_H

#include "formats/container/container.h"
#include "libcore/voxels/voxel.h"

#define PBS_TAG_VOXELS PBS_TAG('V', 'O', 'X', 'L')
#define PBS_TAG_FACES  PBS_TAG('V', 'F', 'A', 'C')

#define PBS_VOXELS_CHUNK  (1u << 18)
#define PBS_VOXELS_HEADER 64

enum { PBS_VFAC_COLOUR = 1 << 12 }; /* flag of VFAC chunks */

/* Which chunk of cells. */
typedef struct pbs_voxel_place {
    uint32_t level;    /* 0: the finest */
    uint32_t levels;   /* level of the chunk that holds the whole grid: 0 for up to 256^3 */
    uint32_t size;     /* cells of the finest level along each axis of the grid */
    uint32_t chunk[3]; /* in chunks of its level */
} pbs_voxel_place;

/* Channels as the header has them: PBS_POSITION | PBS_NORMAL | PBS_WEIGHT | ... */
void pbs_voxels_text(uint32_t channels, char out[256]);
/* Errors: PBS_DATA for channels this program does not know. place: the file. */
pbs_code pbs_voxels_parse(const char *place, const char *text, uint32_t *channels, pbs_err *err);
/* Bytes of a voxel with these channels. */
uint32_t pbs_voxels_stride(uint32_t channels);

/* Arrays for `count` voxels of those channels; given back with pbs_voxels_free. */
pbs_code pbs_voxels_alloc(pbs_run *run, uint32_t channels, size_t count, pbs_voxels *out,
                          pbs_err *err);
/* Makes room for need voxels, keeping what is there. cap: the room so far, 0 at first. */
pbs_code pbs_voxels_grow(pbs_run *run, uint32_t channels, pbs_voxels *v, size_t *cap, size_t need,
                         pbs_err *err);
void pbs_voxels_free(pbs_run *run, pbs_voxels *v);
/* Appends n voxels of `from` to v, which has room for them. */
void pbs_voxels_append(pbs_voxels *v, const pbs_voxels *from, size_t first, size_t n);

/* Writes voxels number `at` on of the node, in chunks of at most PBS_VOXELS_CHUNK. */
pbs_code pbs_voxels_write(pbs_writer *w, uint32_t node, const pbs_voxel_place *place,
                          const pbs_voxels *v, uint64_t at, pbs_err *err);
/* Writes entries number `at` on of the node's list of faces. */
pbs_code pbs_faces_write(pbs_writer *w, uint32_t node, bool colour, const uint32_t *faces,
                         size_t count, uint64_t at, pbs_err *err);

/* A view of a VOXL chunk: *out points into its payload. Checks sizes, that the chunk goes on after
 * `have` voxels, and that the place is possible; not what the voxels say. Errors: PBS_DATA. */
pbs_code pbs_voxels_view(const char *file, uint32_t channels, const pbs_chunk *chunk, uint64_t have,
                         pbs_voxel_place *place, pbs_voxels *out, pbs_err *err);
/* What is wrong with voxels of a view, or NULL: cells that are not in Morton order after `last` (-1
 * at first, then the code of the last one), or outside of the grid, a weight that is no area. */
const char *pbs_voxels_fault(const pbs_voxel_place *place, const pbs_voxels *v, int64_t *last);
#endif
