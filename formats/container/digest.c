#include "formats/container/digest.h"
#include <string.h>
#define XXH_INLINE_ALL
#include <xxhash.h>

void pbs_digest_add(pbs_digest *d, const void *bytes, size_t n) {
    XXH128_hash_t one = XXH3_128bits(bytes, n);
    uint64_t both[5] = {d->h[0], d->h[1], one.low64, one.high64, n};
    XXH128_hash_t sum = XXH3_128bits(both, sizeof both);
    d->h[0] = sum.low64;
    d->h[1] = sum.high64;
}

uint64_t pbs_digest_text(const char *text) {
    return XXH3_64bits(text ? text : "", text ? strlen(text) : 0);
}
