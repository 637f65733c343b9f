/* Packed payloads: whatever the codec, the data that comes back is that of the archive without one;
 * and damaged ones are refused. */
#include "formats/archive/archive.h"
#include "tests/unit/support.h"
#include "tests/unit/latticed.h"
#include "tests/check.h"
#include <sys/resource.h>

static pbs_run run = {.threads = 1};
static pbs_err err;

static bool no_modules(void) {
    const void *table;
    return pbs_module_open(&run, "zstd", 0, &table, &err) ||
           pbs_module_open(&run, "meshopt", 0, &table, &err) ||
           pbs_module_open(&run, "draco", 0, &table, &err);
}
static const char *const why = "libzstd, meshoptimizer and Draco are not all installed";

/* ---- payloads ---- */

static void round_trip(uint32_t tag, uint32_t count, const uint8_t *bytes, size_t n) {
    for (int codec = 1; codec < PBS_CODECS; codec++) {
        pbs_packed p;
        uint8_t *back;
        CHECK(!pbs_codec_pack(&run, (pbs_codec)codec, tag, count, bytes, n, &p, &err));
        uint8_t *packed = p.bytes;
        size_t size = p.size;
        CHECK_NUM(packed && size < n && p.raw == n, codec);
        pbs_codec own = codec == PBS_CODEC_DRACO ? PBS_CODEC_MESHOPT_ZSTD : (pbs_codec)codec;
        CHECK_NUM(p.codec == own, codec);
        must(pbs_alloc(&run, &back, n, 1, "test", &err), &err);
        for (size_t cut = 0; packed && cut < 3; cut++) {
            pbs_code rc =
                pbs_codec_unpack(&run, p.codec, tag, count, packed, size - cut, back, n, &err);
            CHECK_NUM(rc == (cut ? PBS_DATA : PBS_OK), codec);
            CHECK(cut || !memcmp(back, bytes, n));
        }
        if (packed) {
            uint8_t byte = packed[size / 2];
            int bad = 0;
            for (int i = 1; i < 256; i++) { /* any answer, but no crash */
                packed[size / 2] = (uint8_t)(byte ^ i);
                pbs_code rc =
                    pbs_codec_unpack(&run, p.codec, tag, count, packed, size, back, n, &err);
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

/* ---- meshes on lattices ---- */

/* What a corner of a triangle is, and the triangle with its least corner first. */
typedef struct flat_corner {
    float position[3], uv[2];
    int16_t normal[2];
    uint8_t colour[4];
} flat_corner;
typedef struct flat_triangle {
    flat_corner corner[3];
    uint32_t material;
} flat_triangle;

static int by_value(const void *a, const void *b) {
    return memcmp(a, b, sizeof(flat_triangle));
}

static flat_triangle *flatten(const pbs_mesh *m) {
    flat_triangle *all = calloc(m->triangles, sizeof *all);
    for (uint32_t t = 0; t < m->triangles; t++) {
        flat_corner c[3];
        memset(c, 0, sizeof c);
        for (uint32_t i = 0; i < 3; i++) {
            uint32_t v = m->index[3 * t + i];
            memcpy(c[i].position, m->position + 3 * v, 12);
            if (m->uv) memcpy(c[i].uv, m->uv + 2 * v, 8);
            if (m->normal) memcpy(c[i].normal, m->normal + 2 * v, 4);
            if (m->colour) memcpy(c[i].colour, m->colour + 4 * v, 4);
        }
        int least = 0;
        for (int i = 1; i < 3; i++)
            if (memcmp(&c[i], &c[least], sizeof *c) < 0) least = i;
        for (int i = 0; i < 3; i++) all[t].corner[i] = c[(least + i) % 3];
        all[t].material = m->triangle_material ? m->triangle_material[t] : m->material;
    }
    qsort(all, m->triangles, sizeof *all, by_value);
    return all;
}

/* The same triangles, bit for bit, in any order. */
static bool same_triangles(const uint8_t *a, size_t na, const uint8_t *b, size_t nb) {
    pbs_mesh x, y;
    pbs_chunk ca = {.bytes = na, .payload = a, .count = pbs_get_u32(a + 4)};
    pbs_chunk cb = {.bytes = nb, .payload = b, .count = pbs_get_u32(b + 4)};
    if (pbs_mesh_parse("a", &ca, &x, &err) || pbs_mesh_parse("b", &cb, &y, &err)) return false;
    if (x.triangles != y.triangles || x.material != y.material) return false;
    flat_triangle *f = flatten(&x), *g = flatten(&y);
    bool same = !memcmp(f, g, x.triangles * sizeof *f);
    free(f);
    free(g);
    return same;
}

static pbs_packed pack_mesh(blob b, pbs_codec codec) {
    pbs_packed p;
    uint32_t count = pbs_get_u32(b.bytes + 4);
    must(pbs_codec_pack(&run, codec, PBS_TAG_MESH, count, b.bytes, b.size, &p, &err), &err);
    return p;
}

static pbs_code unpack_mesh(const pbs_packed *p, size_t size, uint32_t count, uint8_t *to) {
    return pbs_codec_unpack(&run, p->codec, PBS_TAG_MESH, count, p->bytes, size, to, p->raw, &err);
}

static const double origins[2][3] = {{0.3, 7, -1}, {0}};

TEST(meshes_on_lattices_come_back) {
    if (no_modules()) SKIP(why);
    for (uint32_t arrays = 0; arrays < 16; arrays++) {
        blob b = snapped(&run, wavy_mesh(40, 0, arrays), -9, origins[1], origins[0]);
        size_t left[PBS_CODECS] = {0};
        uint32_t count = pbs_get_u32(b.bytes + 4);
        for (int codec = 1; codec < PBS_CODECS; codec++) {
            uint8_t *back;
            pbs_packed p = pack_mesh(b, (pbs_codec)codec);
            CHECK_NUM(p.bytes && p.codec == (pbs_codec)codec, codec);
            must(pbs_alloc(&run, &back, p.raw, 1, "test", &err), &err);
            CHECK_NUM(!unpack_mesh(&p, p.size, count, back), codec);
            CHECK(codec == PBS_CODEC_DRACO || (p.raw == b.size && !memcmp(back, b.bytes, p.raw)));
            CHECK_NUM(same_triangles(b.bytes, b.size, back, p.raw), arrays);
            left[codec] = p.size;
            pbs_free(&run, back);
            pbs_free(&run, p.bytes);
        }
        CHECK_NUM(left[PBS_CODEC_DRACO] < left[PBS_CODEC_MESHOPT_ZSTD], arrays);
        CHECK_NUM(left[PBS_CODEC_MESHOPT_ZSTD] < left[PBS_CODEC_MESHOPT], arrays);
        free(b.bytes);
    }
    CHECK(pbs_mem_used(&run) == 0);
}

/* Fans around one corner, triangles that are there twice, and that turn their backs to each other;
 * whatever the library makes of them, none is lost. */
TEST(meshes_that_are_no_surfaces) {
    if (no_modules()) SKIP(why);
    enum { SIDE = 9 };
    for (uint32_t kind = 0; kind < 4; kind++) {
        blob b = wavy_mesh(SIDE, 0, 8);
        pbs_mesh m;
        pbs_mesh_view(b.bytes, &m);
        uint16_t *index = (uint16_t *)m.index;
        uint64_t seed = kind;
        for (uint32_t t = 0; t < m.triangles; t++) {
            uint16_t *v = index + 3 * t;
            if (kind == 0) v[0] = 0, v[1] = (uint16_t)(1 + t % 79), v[2] = (uint16_t)(v[1] + 1);
            if (kind == 1 && t % 2) memcpy(v, v - 3, 6);
            if (kind == 2 && t % 2) v[0] = v[-3], v[1] = v[-1], v[2] = v[-2];
            if (kind == 3)
                for (int i = 0; i < 3; i++) v[i] = (uint16_t)(random_bits(&seed) % (SIDE * SIDE));
        }
        blob c = snapped(&run, b, -9, origins[0], origins[0]);
        pbs_packed p = pack_mesh(c, PBS_CODEC_DRACO);
        uint8_t *back;
        must(pbs_alloc(&run, &back, p.raw, 1, "test", &err), &err);
        CHECK_NUM(p.bytes && !unpack_mesh(&p, p.size, pbs_get_u32(c.bytes + 4), back), kind);
        CHECK_NUM(same_triangles(c.bytes, c.size, back, p.raw), kind);
        pbs_free(&run, back);
        pbs_free(&run, p.bytes);
        free(c.bytes);
    }
}

/* Nothing of what Draco's bytes say makes it take memory that the mesh does not need. */
TEST(hostile_bytes_for_draco) {
    if (no_modules()) SKIP(why);
    blob b = snapped(&run, wavy_mesh(10, 0, 15), -9, origins[1], origins[0]);
    pbs_packed p = pack_mesh(b, PBS_CODEC_DRACO);
    uint32_t count = pbs_get_u32(b.bytes + 4);
    uint8_t *back, *bytes = malloc(p.size);
    struct rusage before, after;
    int refused = 0, tried = 0;
    CHECK(p.codec == PBS_CODEC_DRACO);
    must(pbs_alloc(&run, &back, p.raw, 1, "test", &err), &err);
    getrusage(RUSAGE_SELF, &before);
    for (size_t at = 0; at < p.size; at++)
        for (int k = 0; k < 12; k++, tried++) {
            memcpy(bytes, p.bytes, p.size);
            if (k < 8)
                bytes[at] ^= (uint8_t)(1 << k);
            else
                memset(bytes + at, k == 8 ? 0 : k == 9 ? 255 : 128, p.size - at < 5 ? 1 : 5);
            pbs_packed q = {bytes, p.size, p.raw, PBS_CODEC_DRACO};
            pbs_code rc = unpack_mesh(&q, k == 11 ? at : p.size, count, back);
            CHECK(rc == PBS_OK || rc == PBS_DATA);
            refused += rc == PBS_DATA;
        }
    getrusage(RUSAGE_SELF, &after);
    CHECK_NUM(refused > tried / 4, refused);
#ifndef __SANITIZE_ADDRESS__
    CHECK_NUM(after.ru_maxrss - before.ru_maxrss < 20000, after.ru_maxrss - before.ru_maxrss);
#endif
    CHECK(pbs_mem_peak(&run) < 32 << 20);
    free(bytes);
    free(b.bytes);
    pbs_free(&run, back);
    pbs_free(&run, p.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

/* ---- what is not packed ---- */

/* Nothing is gained, and so nothing is packed; nothing that has no arrays is. */
TEST(left_as_it_is) {
    if (no_modules()) SKIP(why);
    uint8_t bytes[4000];
    uint64_t seed = 1;
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
            pbs_packed p;
            CHECK(!pbs_codec_pack(&run, (pbs_codec)codec, few[i].tag, few[i].count, bytes, few[i].n,
                                  &p, &err));
            CHECK_NUM(!p.bytes, i);
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

/* Of two nodes that meet, and so that nothing but the order differs. */
TEST(archives_of_meshes_on_lattices) {
    if (no_modules()) SKIP(why);
    pbs_archive plain, a;
    blob p = small_latticed(&run, PBS_CODEC_NONE);
    CHECK(!check_blob(&run, p, false, &err) && !open_bytes(p, &plain));
    for (int codec = 1; codec < PBS_CODECS; codec++) {
        blob b = small_latticed(&run, (pbs_codec)codec);
        CHECK(!check_blob(&run, b, false, &err) && !check_blob(&run, b, true, &err));
        CHECK(b.size < p.size && !open_bytes(b, &a) && packed_chunks(&a) == 2);
        for (uint32_t i = 0; i < a.chunk_count; i++) {
            pbs_fetched f, g;
            if (a.chunks[i].tag != PBS_TAG_MESH) continue;
            CHECK(a.chunks[i].codec == (pbs_codec)codec);
            CHECK(!pbs_archive_fetch(&plain, i, &f, &err) && !pbs_archive_fetch(&a, i, &g, &err));
            CHECK_NUM(same_triangles(f.chunk.payload, (size_t)f.chunk.bytes, g.chunk.payload,
                                     (size_t)g.chunk.bytes),
                      codec);
            pbs_archive_release(&plain, &f);
            pbs_archive_release(&a, &g);
        }
        pbs_archive_close(&a);
        free(b.bytes);
    }
    pbs_archive_close(&plain);
    free(p.bytes);
}

/* ---- blocks ---- */

/* A prefix needs its blocks, and no byte of the others. */
TEST(prefixes_look_at_their_blocks) {
    if (no_modules()) SKIP(why);
    enum { N = 2 * PBS_CODEC_BLOCK + 777, STRIDE = 12 };
    static uint8_t bytes[N * STRIDE], to[N * STRIDE];
    const uint32_t wanted[] = {
        0, 1, PBS_CODEC_BLOCK - 1, PBS_CODEC_BLOCK, PBS_CODEC_BLOCK + 1, 2 * PBS_CODEC_BLOCK, N};
    for (size_t i = 0; i < sizeof bytes; i++) bytes[i] = (uint8_t)(i / 64 + i % 4);
    for (int codec = 1; codec < PBS_CODEC_DRACO; codec++) {
        pbs_packed p;
        must(pbs_codec_pack(&run, (pbs_codec)codec, PBS_TAG_POINTS, N, bytes, sizeof bytes, &p,
                            &err),
             &err);
        for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++) {
            size_t blocks = (wanted[i] + PBS_CODEC_BLOCK - 1) / PBS_CODEC_BLOCK, end = 3 * 4;
            for (size_t k = 0; k < blocks; k++) end += pbs_get_u32(p.bytes + 4 * k);
            uint8_t *own = malloc(end); /* a sanitizer sees what is read behind it */
            memcpy(own, p.bytes, end);
            memset(to, 0xaa, sizeof to);
            CHECK_NUM(!pbs_codec_prefix(&run, p.codec, PBS_TAG_POINTS, N, own, end, to,
                                        sizeof bytes, wanted[i], &err),
                      wanted[i]);
            CHECK_NUM(!memcmp(to, bytes, STRIDE * wanted[i]), wanted[i]);
            CHECK(wanted[i] == N || to[STRIDE * wanted[i]] == 0xaa);
            free(own);
        }
        /* Blocks that lie about their sizes. */
        for (uint32_t k = 0; k < 3; k++)
            for (int more = -1; more <= 1; more += 2) {
                uint32_t size = pbs_get_u32(p.bytes + 4 * k);
                pbs_put_u32(p.bytes + 4 * k, size + (uint32_t)more);
                CHECK(pbs_codec_unpack(&run, p.codec, PBS_TAG_POINTS, N, p.bytes, p.size, to,
                                       sizeof bytes, &err) == PBS_DATA);
                pbs_put_u32(p.bytes + 4 * k, size);
            }
        CHECK(pbs_codec_prefix(&run, p.codec, PBS_TAG_POINTS, N, p.bytes, 8, to, sizeof bytes, 1,
                               &err) == PBS_DATA);
        pbs_free(&run, p.bytes);
    }
    CHECK(pbs_mem_used(&run) == 0);
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
            bool whole = n == 0 || n == MIXED_FIRST || n == MIXED_RECORDS;
            CHECK(!pbs_archive_prefix(&a, MIXED_SURFELS, n, some, &verified, &err));
            CHECK(verified == whole || !packed_chunks(&a) || verified);
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
        blob b = codec == PBS_CODEC_DRACO ? small_latticed(&run, (pbs_codec)codec)
                                          : small_mixed(&run, (pbs_codec)codec);
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
        blob b = codec == PBS_CODEC_DRACO ? small_latticed(&run, (pbs_codec)codec)
                                          : small_mixed(&run, (pbs_codec)codec);
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
