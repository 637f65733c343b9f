/* codec.h: the payloads of chunks, packed for the disk or the network; pbs-container(5) has the
 * bytes.
 *
 * What a payload is made of, arrays of records of equal size, follows from the chunk's tag, its
 * count and its size, so that no codec needs more than the chunk. Only the data of archives is
 * packed: PNTS, OCTV, VOXL, VFAC and MESH chunks. Unpacking gives the same bytes again, always,
 * but that of Draco the same mesh with its vertices and triangles in another order.
 *
 * PNTS, OCTV and VFAC chunks are packed in blocks of PBS_CODEC_BLOCK records, each on its own, so
 * that the first records are unpacked without the others.
 *
 * Draco packs meshes on a lattice (meshbits.h), where it loses nothing. What else there is, and a
 * mesh that it makes larger, is packed by meshopt-zstd then.
 */
#ifndef PBS_FORMAT_CODEC_H
#define PBS_FORMAT_CODEC_H

#include "libcore/ground/run.h"

#define PBS_CODEC_BLOCK 16384u

typedef enum pbs_codec {
    PBS_CODEC_NONE,
    PBS_CODEC_ZSTD,
    PBS_CODEC_MESHOPT, /* bytes of neighbouring records against each other: unpacked at once */
    PBS_CODEC_MESHOPT_ZSTD,
    PBS_CODEC_DRACO,
    PBS_CODECS
} pbs_codec;
extern const char *const pbs_codec_name[PBS_CODECS + 1]; /* as options have them; NULL ends it */

/* Whether chunks with this tag may be packed. */
bool pbs_codec_fits(uint32_t tag);

typedef struct pbs_packed {
    uint8_t *bytes;   /* NULL: packing saves less than a sixteenth, leave the payload as it is */
    size_t size, raw; /* raw: what it is unpacked to; of Draco not n */
    pbs_codec codec;  /* with Draco not always that which was asked for */
} pbs_packed;

/* Packs the n bytes of a payload of `count` records. out->bytes comes from pbs_alloc(run).
 * Thread-safe. Errors: PBS_LIMIT; PBS_IO if the codec's module is not installed. */
pbs_code pbs_codec_pack(pbs_run *run, pbs_codec codec, uint32_t tag, uint32_t count,
                        const void *bytes, size_t n, pbs_packed *out, pbs_err *err);

/* What that takes of the run's memory at most, the result included. */
size_t pbs_codec_memory(pbs_codec codec, uint32_t tag, size_t n);

/* Unpacks `size` bytes to exactly n, which the caller has checked for a limit. Thread-safe. Errors:
 * PBS_DATA if they are not a packing of n bytes and count records, with a text that says only what
 * is wrong; PBS_LIMIT; PBS_IO if the module is not installed. */
pbs_code pbs_codec_unpack(pbs_run *run, pbs_codec codec, uint32_t tag, uint32_t count,
                          const void *bytes, size_t size, void *to, size_t n, pbs_err *err);

/* The same of the first `records` <= count records of n / count bytes, looking at no more than the
 * blocks in which they are; PNTS, OCTV and VFAC only. */
pbs_code pbs_codec_prefix(pbs_run *run, pbs_codec codec, uint32_t tag, uint32_t count,
                          const void *bytes, size_t size, void *to, size_t n, uint32_t records,
                          pbs_err *err);
#endif
