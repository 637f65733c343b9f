/* codec.h: the payloads of chunks, packed for the disk or the network; pbs-container(5) has the
 * bytes.
 *
 * What a payload is made of, arrays of records of equal size, follows from the chunk's tag, its
 * count and its size, so that no codec needs more than the chunk. Only the data of archives is
 * packed: PNTS, OCTV, VOXL, VFAC and MESH chunks. Unpacking gives the same bytes again, always.
 *
 * There is no Draco: it either quantises positions, so that surfaces come apart where pieces meet,
 * or stores them as they are, and then it is larger than meshopt-zstd.
 */
#ifndef PBS_FORMAT_CODEC_H
#define PBS_FORMAT_CODEC_H

#include "libcore/run.h"

typedef enum pbs_codec {
    PBS_CODEC_NONE,
    PBS_CODEC_ZSTD,
    PBS_CODEC_MESHOPT, /* bytes of neighbouring records against each other: unpacked at once */
    PBS_CODEC_MESHOPT_ZSTD,
    PBS_CODECS
} pbs_codec;
extern const char *const pbs_codec_name[PBS_CODECS + 1]; /* as options have them; NULL ends it */

/* Whether chunks with this tag may be packed. */
bool pbs_codec_fits(uint32_t tag);

/* Packs the n bytes of a payload of `count` records. *out comes from pbs_alloc(run) and has *size
 * bytes; NULL if packing saves less than a sixteenth, and the payload is better left as it is.
 * Errors: PBS_LIMIT; PBS_IO if the codec's module is not installed. */
pbs_code pbs_codec_pack(pbs_run *run, pbs_codec codec, uint32_t tag, uint32_t count,
                        const void *bytes, size_t n, uint8_t **out, size_t *size, pbs_err *err);

/* Unpacks `size` bytes to exactly n, which the caller has checked for a limit. Thread-safe. Errors:
 * PBS_DATA if they are not a packing of n bytes and count records, with a text that says only what
 * is wrong; PBS_LIMIT; PBS_IO if the module is not installed. */
pbs_code pbs_codec_unpack(pbs_run *run, pbs_codec codec, uint32_t tag, uint32_t count,
                          const void *bytes, size_t size, void *to, size_t n, pbs_err *err);
#endif
