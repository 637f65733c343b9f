/* Packed payloads: whatever the codec, the data that comes back is that of the archive without one;
 * and damaged ones are refused. */
#include "formats/archive.h"
#include "tests/unit/support.h"
#include "tests/check.h"

static pbs_run run = {.threads = 1};
static pbs_err err;

static bool no_modules(void) {
    const void *table;
    return pbs_module_open(&run, "zstd", 0, &table, &err) ||
           pbs_module_open(&run, "meshopt", 0, &table, &err);
}
static const char *const why = "libzstd and meshoptimizer are not installed";

/* ---- payloads ---- */

static void round_trip(uint32_t tag, uint32_t count, const uint8_t *bytes, size_t n) {
    for (int codec = 1; codec < PBS_CODECS; codec++) {
        uint8_t *packed, *back;
        size_t size;
        CHECK(!pbs_codec_pack(&run, (pbs_codec)codec, tag, count, bytes, n, &packed, &size, &err));
        CHECK_NUM(packed && size < n, codec);
        must(pbs_alloc(&run, &back, n, 1, "test", &err), &err);
        for (size_t cut = 0; packed && cut < 3; cut++) {
            pbs_code rc = pbs_codec_unpack(&run, (pbs_codec)codec, tag, count, packed, size - cut,
                                           back, n, &err);
            CHECK_NUM(rc == (cut ? PBS_DATA : PBS_OK), codec);
            CHECK(cut || !memcmp(back, bytes, n));
        }
        if (packed) {
            uint8_t byte = packed[size / 2];
            int bad = 0;
            for (int i = 1; i < 256; i++) { /* any answer, but no crash */
                packed[size / 2] = (uint8_t)(byte ^ i);
                pbs_code rc = pbs_codec_unpack(&run, (pbs_codec)codec, tag, count, packed, size,
                                               back, n, &err);
                bad += rc && rc != PBS_DATA;
            }
            CHECK_NUM(bad == 0, bad);
        }
        pbs_free(&run, packed);
        pbs_free(&run, back);
        CHECK(pbs_mem_used(&run) == 0);
    }
}

TEST(every_sort_of_payload) {
    if (no_modules()) SKIP(why);
    enum { N = 3000 };
    static uint8_t bytes[PBS_VOXELS_HEADER + 64 * N];
    for (size_t i = 0; i < sizeof bytes; i++) bytes[i] = (uint8_t)(i / 64 + i % 4);
    for (uint32_t stride = 4; stride <= 64; stride += 4)
        round_trip(PBS_TAG_POINTS, N, bytes, (size_t)N * stride);
    round_trip(PBS_TAG_OCTAVES, N, bytes, (size_t)N * 8);
    round_trip(PBS_TAG_FACES, N, bytes, (size_t)N * 4);
    for (size_t columns = 1; columns <= 7; columns++)
        round_trip(PBS_TAG_VOXELS, N, bytes, PBS_VOXELS_HEADER + columns * 4 * N);
}

TEST(meshes_of_all_arrays) {
    if (no_modules()) SKIP(why);
    enum { V = 400, T = 700 };
    static const size_t size[4] = {4 * V, 8 * V, 4 * V, 4 * T};
    static uint8_t bytes[16 + 28 * V + 10 * T];
    for (uint32_t arrays = 0; arrays < 16; arrays++) {
        size_t n = 16 + 12 * V;
        memset(bytes, 0, sizeof bytes);
        pbs_put_u32(bytes, V), pbs_put_u32(bytes + 4, T), pbs_put_u32(bytes + 8, arrays);
        for (int k = 0; k < 4; k++)
            if (arrays >> k & 1) n += size[k];
        for (size_t i = 16; i < n; i++) bytes[i] = (uint8_t)(i / 100);
        for (size_t i = 0; i < 3 * T; i++, n += 2)
            pbs_put_u16(bytes + n, (uint16_t)((i / 2 * 7 + i % 3) % V));
        round_trip(PBS_TAG_MESH, T, bytes, n);
    }
}

/* Nothing is gained, and so nothing is packed; nothing that has no arrays is. */
TEST(left_as_it_is) {
    if (no_modules()) SKIP(why);
    uint8_t bytes[4000], *packed;
    uint64_t seed = 1;
    size_t size;
    for (size_t i = 0; i < sizeof bytes; i++) bytes[i] = (uint8_t)random_bits(&seed);
    for (int codec = 0; codec < PBS_CODECS; codec++) {
        const struct {
            uint32_t tag, count;
            size_t n;
        } few[] = {
            {PBS_TAG_POINTS, 250, 4000}, {PBS_TAG_POINTS, 0, 0},   {PBS_TAG_NODE, 1, 4000},
            {PBS_TAG_VOXELS, 1, 8},      {PBS_TAG_MESH, 1, 4},     {PBS_TAG_MESH, 9, 4000},
            {PBS_TAG_POINTS, 7, 3999},   {PBS_TAG_FACES, 2, 4000}, {PBS_TAG_VOXELS, 9, 4000}};
        for (size_t i = 0; i < sizeof few / sizeof *few; i++) {
            CHECK(!pbs_codec_pack(&run, (pbs_codec)codec, few[i].tag, few[i].count, bytes, few[i].n,
                                  &packed, &size, &err));
            CHECK_NUM(!packed, i);
        }
    }
}

/* ---- archives ---- */

static pbs_code open_bytes(blob b, pbs_archive *a) {
    char path[40];
    int fd = memfd_create("archive", MFD_CLOEXEC);
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    if (write(fd, b.bytes, b.size) != (ssize_t)b.size) abort();
    pbs_code rc = pbs_archive_open(&run, path, a, &err);
    close(fd);
    return rc;
}

static int packed_chunks(const pbs_archive *a) {
    int n = 0;
    for (size_t i = 0; i < a->chunk_count; i++) n += a->chunks[i].codec != PBS_CODEC_NONE;
    return n;
}

TEST(the_same_data_for_every_codec) {
    if (no_modules()) SKIP(why);
    pbs_archive plain, a;
    blob p = small_mixed(&run, PBS_CODEC_NONE);
    CHECK(!open_bytes(p, &plain) && !packed_chunks(&plain));
    for (int codec = 1; codec < PBS_CODECS; codec++) {
        blob b = small_mixed(&run, (pbs_codec)codec);
        CHECK(!check_blob(&run, b, false, &err) && !check_blob(&run, b, true, &err));
        CHECK(!open_bytes(b, &a) && a.chunk_count == plain.chunk_count);
        CHECK_NUM(packed_chunks(&a) >= 2, codec);
        for (uint32_t i = 0; i < a.chunk_count; i++) {
            pbs_fetched f, g;
            CHECK(!pbs_archive_fetch(&plain, i, &f, &err) && !pbs_archive_fetch(&a, i, &g, &err));
            CHECK(f.chunk.bytes == g.chunk.bytes && pbs_archive_bytes(&a, i) == g.chunk.bytes);
            CHECK_NUM(!memcmp(f.chunk.payload, g.chunk.payload, (size_t)f.chunk.bytes), i);
            CHECK((uintptr_t)g.chunk.payload % 64 == 0 && f.chunk.tag == g.chunk.tag);
            pbs_archive_release(&plain, &f);
            pbs_archive_release(&a, &g);
        }
        pbs_archive_close(&a);
        free(b.bytes);
    }
    pbs_archive_close(&plain);
    free(p.bytes);
}

TEST(prefixes_of_packed_points) {
    if (no_modules()) SKIP(why);
    for (int codec = 1; codec < PBS_CODECS; codec++) {
        pbs_archive a;
        pbs_node_data d;
        uint8_t some[MIXED_RECORDS * 64];
        blob b = small_mixed(&run, (pbs_codec)codec);
        CHECK(!open_bytes(b, &a) && !pbs_archive_load_node(&a, MIXED_SURFELS, &d, &err));
        for (uint64_t n = 0; n <= MIXED_RECORDS; n += 7) {
            bool verified;
            CHECK(!pbs_archive_prefix(&a, MIXED_SURFELS, n, some, &verified, &err) && verified);
            CHECK(!memcmp(some, d.records, n * a.record.stride));
        }
        pbs_node_data_free(&a, &d);
        pbs_archive_close(&a);
        free(b.bytes);
    }
}

/* ---- damage ---- */

static void hostile(blob b, int *refused) {
    pbs_archive a;
    pbs_fetched f;
    pbs_code rc = open_bytes(b, &a), checked = check_blob(&run, b, false, &err);
    CHECK(checked == PBS_OK || checked == PBS_DATA);
    CHECK(checked || check_blob(&run, b, true, &err) == PBS_OK); /* pipes do not see directories */
    CHECK(rc == PBS_OK || rc == PBS_DATA);
    for (uint32_t i = 0; !rc && i < a.chunk_count; i++) {
        pbs_code one = pbs_archive_fetch(&a, i, &f, &err);
        CHECK(one == PBS_OK || one == PBS_DATA);
        CHECK(checked || !one);
        if (!one) pbs_archive_release(&a, &f);
    }
    if (!rc) pbs_archive_close(&a);
    *refused += checked == PBS_DATA;
}

TEST(damaged_bits_behind_good_checksums) {
    if (no_modules()) SKIP(why);
    for (int codec = 1; codec < PBS_CODECS; codec++) {
        int refused = 0;
        blob b = small_mixed(&run, (pbs_codec)codec);
        for (size_t bit = 8 * pbs_get_u32(b.bytes + HEADER_BYTES_AT); bit < 8 * b.size; bit += 13) {
            blob c = copy_blob(b);
            c.bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
            reseal(c);
            hostile(c, &refused);
            free(c.bytes);
        }
        CHECK(refused > 50);
        free(b.bytes);
    }
}

/* Offset of the first chunk with a codec. */
static size_t first_packed(blob b) {
    size_t h = pbs_get_u32(b.bytes + HEADER_BYTES_AT);
    while (!(pbs_get_u32(b.bytes + h + CHUNK_FLAGS_AT) & PBS_CODEC_MASK)) {
        uint64_t n = pbs_get_u64(b.bytes + h + CHUNK_BYTES_AT);
        h += CHUNK_FIXED + (size_t)(n + pbs_padding(n, PBS_ALIGN));
    }
    return h;
}

static void expect_refused(blob b, size_t at, uint64_t value, size_t bytes) {
    blob c = copy_blob(b);
    memcpy(c.bytes + first_packed(b) + at, &value, bytes);
    reseal(c);
    CHECK_NUM(check_blob(&run, c, false, &err) == PBS_DATA, value);
    CHECK_NUM(check_blob(&run, c, true, &err) == PBS_DATA, value);
    free(c.bytes);
}

TEST(headers_that_lie) {
    if (no_modules()) SKIP(why);
    for (int codec = 1; codec < PBS_CODECS; codec++) {
        blob b = small_mixed(&run, (pbs_codec)codec);
        uint64_t raw = pbs_get_u64(b.bytes + first_packed(b) + CHUNK_RAW_AT);
        const uint64_t sizes[] = {
            0, 1, raw - 4, raw + 4, 2 * raw, PBS_PAYLOAD_MAX, PBS_PAYLOAD_MAX + 1, UINT64_MAX};
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
            expect_refused(b, CHUNK_RAW_AT, sizes[i], 8);
        for (uint64_t other = 0; other < 256; other = other < 5 ? other + 1 : 2 * other)
            if (other != (uint64_t)codec) expect_refused(b, CHUNK_FLAGS_AT, other, 1);
        expect_refused(b, CHUNK_TAG_AT, PBS_TAG('T', 'e', 's', 't'), 4);
        expect_refused(b, CHUNK_COUNT_AT, 1, 4);
        free(b.bytes);
    }
}

/* What is refused for memory says so, and nothing stays taken. */
TEST(little_memory) {
    if (no_modules()) SKIP(why);
    blob b = small_mixed(&run, PBS_CODEC_MESHOPT_ZSTD);
    int limits = 0;
    for (size_t limit = 500; limit < 20000; limit += 500) {
        run.mem_limit = limit;
        pbs_code rc = check_blob(&run, b, false, &err);
        limits += rc == PBS_LIMIT;
        CHECK((rc == PBS_LIMIT || !rc) && pbs_mem_used(&run) == 0);
    }
    run.mem_limit = 0;
    CHECK(limits > 0);
    free(b.bytes);
}

TEST_MAIN
