/* codec_draco.h: a mesh of whole numbers (meshbits.h), packed by Draco, through its module.
 *
 * The library orders vertices and triangles as it likes, and says nothing of it. So what is packed
 * is unpacked at once and compared, triangle by triangle: a mesh that does not come back whole is
 * not packed by it, and the materials of triangles get its order. */
#ifndef PBS_CODEC_DRACO_H
#define PBS_CODEC_DRACO_H

#include "libcore/ground/run.h"

/* whole: n bytes, as pbs_mesh_to_whole leaves them. *out comes from pbs_alloc(run), *raw bytes come
 * of it; NULL if it is none of Draco's. Errors: PBS_LIMIT; PBS_IO without the module. */
pbs_code pbs_draco_pack(pbs_run *run, const uint8_t *whole, size_t n, uint8_t **out, size_t *size,
                        size_t *raw, pbs_err *err);
/* To exactly n bytes. Errors: as pbs_codec_unpack's. */
pbs_code pbs_draco_unpack(pbs_run *run, const uint8_t *bytes, size_t size, uint8_t *to, size_t n,
                          pbs_err *err);
/* Counted while one is packed, besides the result. */
size_t pbs_draco_memory(size_t n);
#endif
