/* resident.h: records of a node that are in the GPU's memory, as splat.h and reduce.h take them. */
#ifndef PBS_RESIDENT_H
#define PBS_RESIDENT_H

#include "cmd/pbs-view/draw/draw.h"

/* The first `prefix` records of a node, as draw.h describes them, in a storage buffer that is
 * smaller than 128 MiB (pbs_gl's max_storage) and may hold those of other nodes too. Counts that
 * the buffer has no room for are cut off, so that a damaged number reads no foreign memory. */
typedef struct pbs_resident {
    uint64_t key;     /* of the placed node, the same from frame to frame, no other one's */
    GLuint buffer;    /* 0: nothing is drawn */
    uint64_t offset;  /* of record 0, bytes, a multiple of 4 */
    uint64_t octaves; /* of the octaves' entries in the same buffer; PBS_NO_OCTAVES: it has none */
    uint32_t stride;  /* bytes, a multiple of 4; 0: what the channels need */
    uint32_t channels, prefix, whole; /* as in pbs_surfels */
    pbs_part part;
    double radius;                 /* of a disc, node's unit */
    double corner[3], step, m[12]; /* as in pbs_surfels; spacing 1 is 65535 steps */
} pbs_resident;

#define PBS_NO_OCTAVES UINT64_MAX

/* What shaders need of it: checked, in words. */
typedef struct pbs_resident_words {
    uint32_t first, stride, count; /* count: of the prefix, as far as the buffer goes */
    uint32_t octaves;              /* UINT32_MAX: none, or not all of them are in the buffer */
    int32_t field[4];              /* of normal, colour, material, emissive in a record; -1: none */
} pbs_resident_words;

/* Its part has a key of its own. */
static inline uint64_t pbs_resident_key(const pbs_resident *r) {
    return r->key ^ (uint64_t)r->part.before * 0xd6e8feb86659fd93u;
}

/* bytes: of its buffer. Errors: PBS_INTERNAL for an offset or a stride that is no multiple of 4, or
 * a stride smaller than the channels. */
pbs_code pbs_resident_check(const pbs_resident *r, uint64_t bytes, pbs_resident_words *out,
                            pbs_err *err);

/* Size of a buffer; 0 for one that is not there. */
uint64_t pbs_resident_bytes(const pbs_gl *gl, GLuint buffer);

/* Lattice to view coordinates, the linear part alone times radius, and normals to view (three rows
 * each; the last of the linear ones is 0). The corner, far from the origin as it may be, is added
 * in double. */
void pbs_resident_place(const pbs_resident *r, const pbs_camera *camera, float to_view[3][4],
                        float disc[3][4], float normal[3][4]);
#endif
