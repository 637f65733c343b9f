/* mips.h: a texture as it is uploaded: all its levels, one behind the other, in one piece of
 * memory. Made off the frame, by the same means as the sampler's (libcore/data/texture.h): so
 * close-ups have the colours that surfels and voxels were given. Knows no GL.
 */
#ifndef PBS_MIPS_H
#define PBS_MIPS_H

#include "libcore/data/mesh.h"
#include "libcore/ground/run.h"

/* Sides of the first level; of each other they are half, rounded down, and at least 1. */
typedef struct pbs_mips {
    uint32_t width, height; /* 0: there is no picture */
    bool srgb;              /* how r, g, b are stored; alpha is linear always */
} pbs_mips;

int pbs_mips_levels(const pbs_mips *m);
/* Of all levels together, 4 bytes a pixel. */
uint64_t pbs_mips_bytes(const pbs_mips *m);
/* Level `level` and where it begins. */
pbs_mips pbs_mips_level(const pbs_mips *m, int level, uint64_t *at);

/* Of a picture whose first levels are left out, as long as a side is longer than `side` or the rest
 * takes more than `most` bytes. *chain belongs to the caller: pbs_free. A picture without pixels:
 * sides 0 and *chain NULL. Errors: PBS_LIMIT. */
pbs_code pbs_mips_make(pbs_run *run, const pbs_image *image, bool srgb, uint32_t side,
                       uint64_t most, pbs_mips *out, uint8_t **chain, pbs_err *err);
#endif
