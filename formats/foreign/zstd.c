/* zstd.c: module zstd: bytes packed with libzstd. */
#include "formats/readers/module.h"
#include <zstd.h>

static size_t bound(size_t n) {
    return ZSTD_compressBound(n);
}

static size_t pack(void *to, size_t room, const void *from, size_t n, int level) {
    size_t size = ZSTD_compress(to, room, from, n, level);
    return ZSTD_isError(size) ? 0 : size;
}

static uint64_t content(const void *from, size_t size) {
    unsigned long long n = ZSTD_getFrameContentSize(from, size);
    return n == ZSTD_CONTENTSIZE_ERROR || n == ZSTD_CONTENTSIZE_UNKNOWN ? UINT64_MAX : n;
}

static bool unpack(void *to, size_t n, const void *from, size_t size) {
    return ZSTD_decompress(to, n, from, size) == n;
}

__attribute__((visibility("default")))
const pbs_module_zstd pbs_module = {PBS_MODULE_ABI, bound, pack, content, unpack};
