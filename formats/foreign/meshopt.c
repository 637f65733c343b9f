/* meshopt.c: module meshopt: arrays of records packed with meshoptimizer's codecs. Its functions
 * only assert what they expect of sizes, so that codec.c has looked at those. */
#include "formats/readers/module.h"
#include <meshoptimizer.h>

enum { INDEX = 2 }; /* the stride of indices; records have multiples of 4 */

static size_t bound(size_t count, size_t stride) {
    return stride == INDEX ? meshopt_encodeIndexSequenceBound(count, 65536)
                           : meshopt_encodeVertexBufferBound(count, stride);
}

/* The library wants indices of 32 bits. */
static pbs_code pack_index(pbs_run *run, void *to, size_t room, const uint16_t *from, size_t count,
                           size_t *size, pbs_err *err) {
    unsigned *wide;
    pbs_code rc = pbs_alloc(run, &wide, count, sizeof *wide, "a packed mesh", err);
    if (rc) return rc;
    for (size_t i = 0; i < count; i++) wide[i] = from[i];
    *size = meshopt_encodeIndexSequence(to, room, wide, count);
    pbs_free(run, wide);
    return PBS_OK;
}

static pbs_code pack(pbs_run *run, void *to, size_t room, const void *from, size_t count,
                     size_t stride, size_t *size, pbs_err *err) {
    pbs_code rc = PBS_OK;
    if (stride == INDEX)
        rc = pack_index(run, to, room, from, count, size, err);
    else
        *size = meshopt_encodeVertexBuffer(to, room, from, count, stride);
    return rc || *size ? rc : pbs_fail(err, PBS_INTERNAL, "meshoptimizer: no room");
}

static bool unpack(void *to, size_t count, size_t stride, const void *from, size_t size) {
    return stride == INDEX ? !meshopt_decodeIndexSequence(to, count, stride, from, size)
                           : !meshopt_decodeVertexBuffer(to, count, stride, from, size);
}

__attribute__((visibility("default")))
const pbs_module_meshopt pbs_module = {PBS_MODULE_ABI, bound, pack, unpack};
