/* An archive is opened by its index alone, and its data fetched from any thread. */
#include "formats/archive/archive.h"
#include "tests/unit/support.h"
#include "tests/check.h"
#include <pthread.h>

static pbs_run run = {.threads = 1};
static pbs_err err;

static pbs_code open_bytes(blob b, pbs_archive *a) {
    char path[40];
    int fd = memfd_create("archive", MFD_CLOEXEC);
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    if (write(fd, b.bytes, b.size) != (ssize_t)b.size) abort();
    pbs_code rc = pbs_archive_open(&run, path, a, &err);
    close(fd);
    return rc;
}

static bool is_index(uint32_t tag) {
    return tag == PBS_TAG_NODE || tag == PBS_TAG_MATERIAL;
}

/* Flips a bit in the payload of chunk k, and mends nothing. */
static blob damaged(blob b, const pbs_chunk *c) {
    blob d = copy_blob(b);
    d.bytes[c->offset + CHUNK_FIXED + c->bytes / 2] ^= 4;
    return d;
}

TEST(opening_reads_no_data) {
    blob b = small_mixed(&run, PBS_CODEC_NONE);
    pbs_archive a, other;
    CHECK(!open_bytes(b, &a) && a.chunk_count == MIXED_CHUNKS);
    for (uint32_t k = 0; k < a.chunk_count; k++) {
        pbs_fetched f;
        blob d = damaged(b, &a.chunks[k]);
        pbs_code rc = open_bytes(d, &other);
        CHECK_NUM(rc == (is_index(a.chunks[k].tag) ? PBS_DATA : PBS_OK), k);
        for (uint32_t i = 0; !rc && i < a.chunk_count; i++) {
            CHECK_NUM(pbs_archive_fetch(&other, i, &f, &err) == (i == k ? PBS_DATA : PBS_OK), i);
            pbs_archive_release(&other, &f);
        }
        if (!rc) pbs_archive_close(&other);
        free(d.bytes);
    }
    pbs_archive_close(&a);
    free(b.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(everything_is_listed) {
    static const size_t want[MIXED_NODES][PBS_SORTS] = {
        {2, 1, 0, 0, 1}, {1, 0, 0, 0, 0}, {0, 0, 1, 1, 2}, {0, 0, 0, 0, 0}};
    blob b = small_mixed(&run, PBS_CODEC_NONE);
    pbs_archive a;
    CHECK(!open_bytes(b, &a) && a.material_count == 1 && a.texture_count == 2);
    CHECK(a.placings[MIXED_ROOT] == 3 && a.record.stride && a.voxel_channels);
    for (uint32_t i = 0; i < MIXED_NODES; i++)
        for (int s = 0; s < PBS_SORTS; s++) {
            size_t n;
            const uint32_t *list = pbs_archive_list(&a, i, (pbs_sort)s, &n);
            CHECK(n == want[i][s] && pbs_archive_has(&a, i, (pbs_sort)s) == (n > 0));
            for (size_t k = 0; k < n; k++) {
                CHECK(a.chunks[list[k]].node == i && (!k || list[k] > list[k - 1]));
                CHECK(pbs_archive_bytes(&a, list[k]) == a.chunks[list[k]].bytes);
            }
        }
    pbs_archive_close(&a);
    CHECK(!check_blob(&run, b, false, &err));
    free(b.bytes);
}

TEST(fetched_chunks_are_what_was_written) {
    blob b = small_mixed(&run, PBS_CODEC_NONE);
    pbs_archive a;
    pbs_fetched f;
    size_t n;
    CHECK(!open_bytes(b, &a));
    const uint32_t *list = pbs_archive_list(&a, MIXED_VOXELS, PBS_SORT_MESHES, &n);
    CHECK(!pbs_archive_fetch(&a, list[1], &f, &err) && f.mesh.triangles == 2 &&
          f.chunk.first == 2 && f.mesh.position[0] == 2 && f.mesh.index[4] == 3);
    pbs_archive_release(&a, &f);
    list = pbs_archive_list(&a, MIXED_VOXELS, PBS_SORT_VOXELS, &n);
    CHECK(!pbs_archive_fetch(&a, list[0], &f, &err) && f.voxels.count == 3 && f.place.size == 4 &&
          f.voxels.normal[2] == 3 && (uintptr_t)f.chunk.payload % 64 == 0);
    pbs_archive_release(&a, &f);
    CHECK(!pbs_archive_fetch(&a, a.textures[1], &f, &err) && f.chunk.bytes == 12);
    pbs_archive_release(&a, &f);
    pbs_archive_close(&a);
    free(b.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(a_prefix_is_the_beginning) {
    blob b = small_mixed(&run, PBS_CODEC_NONE);
    pbs_archive a;
    pbs_node_data d;
    uint8_t some[MIXED_RECORDS * 64];
    CHECK(!open_bytes(b, &a) && !pbs_archive_load_node(&a, MIXED_SURFELS, &d, &err));
    for (uint64_t n = 0; n <= MIXED_RECORDS; n++) {
        bool verified;
        size_t bytes = n * a.record.stride;
        memset(some, 99, sizeof some);
        CHECK(!pbs_archive_prefix(&a, MIXED_SURFELS, n, some, &verified, &err));
        CHECK_NUM(!memcmp(some, d.records, bytes) && some[bytes] == 99, n);
        CHECK_NUM(verified == (n == 0 || n == MIXED_FIRST || n == MIXED_RECORDS), n);
    }
    pbs_node_data_free(&a, &d);
    pbs_archive_close(&a);
    free(b.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

/* It costs what it reads: behind the prefix the payload may be anything. */
TEST(a_prefix_does_not_read_the_rest) {
    blob b = small_mixed(&run, PBS_CODEC_NONE);
    pbs_archive a;
    uint8_t some[64];
    size_t n;
    bool verified;
    CHECK(!open_bytes(b, &a));
    const uint32_t *list = pbs_archive_list(&a, MIXED_SURFELS, PBS_SORT_POINTS, &n);
    blob d = damaged(b, &a.chunks[list[0]]);
    pbs_archive_close(&a);
    CHECK(!open_bytes(d, &a));
    CHECK(!pbs_archive_prefix(&a, MIXED_SURFELS, 3, some, &verified, &err) && !verified);
    uint8_t *all = malloc((size_t)MIXED_FIRST * a.record.stride);
    CHECK(pbs_archive_prefix(&a, MIXED_SURFELS, MIXED_FIRST, all, &verified, &err) == PBS_DATA);
    free(all);
    pbs_archive_close(&a);
    free(b.bytes), free(d.bytes);
}

/* ---- threads ---- */

static uint32_t sum_of(const pbs_archive *a, pbs_err *e) {
    uint32_t sum = 0;
    for (uint32_t i = 0; i < a->chunk_count; i++) {
        pbs_fetched f;
        if (pbs_archive_fetch(a, i, &f, e)) return 0;
        sum = pbs_crc32c(sum, f.chunk.payload, (size_t)f.chunk.bytes);
        pbs_archive_release(a, &f);
    }
    return sum;
}

static void *sum_often(void *ctx) {
    pbs_err e;
    uint32_t first = sum_of(ctx, &e), same = first;
    for (int i = 0; i < 200; i++) same = sum_of(ctx, &e) == first ? same : 0;
    return (void *)(uintptr_t)same;
}

TEST(threads_fetch_at_once) {
    blob b = small_mixed(&run, PBS_CODEC_NONE);
    pbs_archive a;
    pthread_t t[4];
    CHECK(!open_bytes(b, &a));
    uint32_t want = sum_of(&a, &err);
    for (int i = 0; i < 4; i++) CHECK(!pthread_create(&t[i], NULL, sum_often, &a));
    for (int i = 0; i < 4; i++) {
        void *got;
        pthread_join(t[i], &got);
        CHECK(want && (uintptr_t)got == want);
    }
    pbs_archive_close(&a);
    free(b.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

/* ---- what does not fit ---- */

/* All that opens can be used, and what the checker takes can be opened. */
TEST(hostile_bits) {
    blob b = small_mixed(&run, PBS_CODEC_NONE);
    int differ = 0;
    for (size_t bit = 8 * pbs_get_u32(b.bytes + HEADER_BYTES_AT); bit < 8 * b.size; bit += 3) {
        pbs_archive a;
        pbs_node_data d;
        blob c = copy_blob(b);
        c.bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
        reseal(c);
        pbs_code rc = open_bytes(c, &a), checked = check_blob(&run, c, false, NULL);
        bool opened = !rc;
        for (uint32_t i = 0; !rc && i < a.node_count; i++)
            if (!(rc = pbs_archive_load_node(&a, i, &d, &err))) pbs_node_data_free(&a, &d);
        for (uint32_t i = 0; !rc && i < a.chunk_count; i++) {
            pbs_fetched f;
            if (!(rc = pbs_archive_fetch(&a, i, &f, &err))) pbs_archive_release(&a, &f);
        }
        if (opened) pbs_archive_close(&a);
        CHECK(rc == PBS_OK || rc == PBS_DATA);
        differ += rc == PBS_DATA && checked == PBS_OK;
        free(c.bytes);
    }
    CHECK_NUM(differ == 0, differ);
    free(b.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

/* A number in a chunk's header that the checksums do not give away. */
static void expect_refused(uint32_t tag, size_t at, uint32_t value) {
    blob b = small_mixed(&run, PBS_CODEC_NONE);
    pbs_archive a;
    size_t h = pbs_get_u32(b.bytes + HEADER_BYTES_AT);
    while (pbs_get_u32(b.bytes + h + CHUNK_TAG_AT) != tag) {
        uint64_t n = pbs_get_u64(b.bytes + h + CHUNK_BYTES_AT);
        h += CHUNK_FIXED + (size_t)(n + pbs_padding(n, PBS_ALIGN));
    }
    pbs_put_u32(b.bytes + h + at, value);
    reseal(b);
    CHECK_NUM(open_bytes(b, &a) == PBS_DATA, value);
    CHECK_NUM(check_blob(&run, b, false, &err) == PBS_DATA, value);
    free(b.bytes);
}

TEST(data_that_does_not_fit_its_node) {
    expect_refused(PBS_TAG_POINTS, CHUNK_NODE_AT, MIXED_ROOT);
    expect_refused(PBS_TAG_POINTS, CHUNK_NODE_AT, MIXED_VOXELS);
    expect_refused(PBS_TAG_POINTS, CHUNK_NODE_AT, MIXED_NODES);
    expect_refused(PBS_TAG_POINTS, CHUNK_COUNT_AT, MIXED_FIRST - 1);
    expect_refused(PBS_TAG_POINTS, CHUNK_COUNT_AT, 0);
    expect_refused(PBS_TAG_POINTS, CHUNK_FIRST_AT, 1);
    expect_refused(PBS_TAG_OCTAVES, CHUNK_NODE_AT, MIXED_CLOUD);
    expect_refused(PBS_TAG_VOXELS, CHUNK_NODE_AT, MIXED_SURFELS);
    expect_refused(PBS_TAG_VOXELS, CHUNK_FIRST_AT, 1);
    expect_refused(PBS_TAG_FACES, CHUNK_COUNT_AT, 8);
    expect_refused(PBS_TAG_MESH, CHUNK_FIRST_AT, 2);
    expect_refused(PBS_TAG_MESH, CHUNK_NODE_AT, MIXED_NODES);
    expect_refused(PBS_TAG_TEXTURE, CHUNK_NODE_AT, 1);
    expect_refused(PBS_TAG_MATERIAL, CHUNK_NODE_AT, 1);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST_MAIN
