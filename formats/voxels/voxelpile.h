/* voxelpile.h: the voxels of a node until it can be written: its number is known only when all
 * nodes before it are. Few lie in memory, many in $TMPDIR.
 */
#ifndef PBS_VOXELPILE_H
#define PBS_VOXELPILE_H

#include "formats/container/scratch.h"
#include "formats/voxels/voxels.h"

typedef struct pbs_pile_part {
    pbs_scratch scratch;
    pbs_voxels v; /* PBS_VOXELS_CHUNK of them; the last part may have fewer */
} pbs_pile_part;

typedef struct pbs_pile {
    pbs_run *run;
    uint32_t channels;
    pbs_voxels held;  /* those behind the parts */
    size_t cap, room; /* how many may be held */
    pbs_pile_part *part;
    size_t parts, made, part_cap; /* in use; those that there is memory for */
    uint64_t count;
} pbs_pile;

/* memory: bytes that may be held. */
void pbs_pile_begin(pbs_pile *p, pbs_run *run, uint32_t channels, size_t memory);
/* Appends; v has at least the pile's channels. face_base is added to v->face. Errors: PBS_LIMIT,
 * PBS_IO. */
pbs_code pbs_pile_add(pbs_pile *p, const pbs_voxels *v, uint32_t face_base, pbs_err *err);
/* Where voxel i is: an offset into *v. Not while any are held beside parts: settle before. */
size_t pbs_pile_find(const pbs_pile *p, uint64_t i, const pbs_voxels **v);
/* Pages of parts in files are given back (scratch.h); to be called while many are looked at. */
void pbs_pile_rest(const pbs_pile *p);
/* All are in parts, or none. */
pbs_code pbs_pile_settle(pbs_pile *p, pbs_err *err);
pbs_code pbs_pile_write(pbs_pile *p, pbs_writer *w, uint32_t node, const pbs_voxel_place *place,
                        pbs_err *err);
/* The same of a pile whose places are entries of a list of faces. */
pbs_code pbs_pile_write_faces(pbs_pile *p, pbs_writer *w, uint32_t node, bool colour, pbs_err *err);
/* Empties it; what it holds memory for it keeps. */
void pbs_pile_clear(pbs_pile *p);
void pbs_pile_free(pbs_pile *p); /* zeroed is fine */
#endif
