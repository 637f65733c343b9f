/* Damaged containers: nothing that is cut off or changed is taken for whole, each kind of damage
 * has its own words, and contents that contradict each other are found behind right checksums. */
#include "tests/unit/support.h"
#include "tests/check.h"

static pbs_run run = {.threads = 1};
static pbs_err err;

/* ---- damage ---- */

static const char *const small_name[SMALL_KINDS] = {
    "scene", "candidates", "surfels", "archive", "voxels", "archive of voxels", "mixed"};

TEST(small_files_are_whole) {
    for (int k = 0; k < SMALL_KINDS; k++) {
        blob b = small_file(&run, k), again = copy_blob(b);
        for (int piped = 0; piped < 2; piped++)
            if (check_blob(&run, b, piped, &err))
                printf("# %s: %s\n", small_name[k], err.text), pbs_bad++;
        reseal(again); /* does nothing to what is right: the tests below rely on it */
        CHECK(!memcmp(again.bytes, b.bytes, b.size));
        free(b.bytes), free(again.bytes);
    }
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(every_truncation) {
    for (int k = 0; k < SMALL_KINDS; k++) {
        blob b = small_file(&run, k);
        for (size_t n = 0; n < b.size; n++)
            for (int piped = 0; piped < 2; piped++) {
                blob cut = {b.bytes, n};
                err = (pbs_err){0};
                pbs_code rc =
                    piped ? check_blob(&run, cut, true, &err) : check_guarded(&run, cut, &err);
                if (rc == PBS_DATA && err.code == PBS_DATA && *err.text) continue;
                printf("# %s, %zu bytes of %zu, %s: %d\n", small_name[k], n, b.size,
                       piped ? "piped" : "mapped", (int)rc);
                pbs_bad++;
            }
        free(b.bytes);
    }
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(every_flipped_bit) {
    for (int k = 0; k < SMALL_KINDS; k++) {
        blob b = small_file(&run, k);
        for (size_t bit = 0; bit < 8 * b.size; bit++) {
            b.bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
            pbs_code rc = check_guarded(&run, b, &err);
            if (rc == PBS_DATA && bit % 29 == 0) rc = check_blob(&run, b, true, &err);
            b.bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
            if (rc == PBS_DATA) continue;
            printf("# %s: bit %zu of byte %zu: %d\n", small_name[k], bit % 8, bit / 8, (int)rc);
            pbs_bad++;
        }
        free(b.bytes);
    }
    CHECK(pbs_mem_used(&run) == 0);
}

/* Behind the checksums: what gets past them must not crash either, whatever the answer. */
TEST(flipped_bits_with_right_checksums) {
    for (int k = 0; k < SMALL_KINDS; k++) {
        blob b = small_file(&run, k);
        for (size_t bit = 0; bit < 8 * b.size; bit += 3) {
            blob c = copy_blob(b);
            c.bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
            reseal(c);
            pbs_code rc = check_guarded(&run, c, &err);
            if (rc && rc != PBS_DATA) printf("# byte %zu: %s\n", bit / 8, err.text), pbs_bad++;
            free(c.bytes);
        }
        free(b.bytes);
    }
    CHECK(pbs_mem_used(&run) == 0);
}

/* ---- messages ---- */

/* Reads front to back; the error's text without the file's name. */
static const char *read_text(blob b, uint32_t kinds, bool piped) {
    pbs_input in;
    pbs_reader *r;
    open_blob(&run, b, piped, &in);
    snprintf(in.name, sizeof in.name, "f");
    err = (pbs_err){0};
    pbs_code rc = pbs_reader_open(&run, &in, kinds, &r, &err);
    for (bool end = false; !rc && !end;) {
        pbs_chunk c;
        rc = pbs_reader_next(r, &c, &end, &err);
    }
    if (r) pbs_reader_close(r);
    return rc ? err.text : "";
}

/* The blob is used up. */
static void expect_text(blob b, const char *text) {
    for (int piped = 0; piped < 2; piped++) {
        const char *got = read_text(b, PBS_KIND(PBS_SCENE), piped);
        if (strcmp(got, text)) printf("# \"%s\", not \"%s\"\n", got, text), pbs_bad++;
        CHECK(check_blob(&run, b, piped, &err) != PBS_OK);
    }
    free(b.bytes);
}

TEST(header_messages) {
    blob b = chunks_file(&run, 3, false), c;
    expect_text((blob){calloc(1, 1), 0}, "f: the file is empty");
    c = copy_blob(b), c.bytes[0] = 'P';
    expect_text(c, "f: not a pbs file (pbs-import reads scene files)");
    c = copy_blob(b), c.size = 20, c.bytes[0] = 'P';
    expect_text(c, "f: not a pbs file");
    c = copy_blob(b), memset(c.bytes, 0, 8);
    expect_text(c, "f: was never finished");
    c = copy_blob(b), pbs_put_u16(c.bytes + HEADER_MAJOR_AT, 2), reseal_header(c);
    expect_text(c, "f: version 2 is newer than this program's 1");
    c = copy_blob(b), pbs_put_u64(c.bytes + HEADER_INCOMPAT_AT, 1ull << 40), reseal_header(c);
    expect_text(c, "f: uses features (0x10000000000) that this program does not know");
    c = copy_blob(b), c.bytes[HEADER_FIXED + 20] ^= 1;
    expect_text(c, "f: the header is damaged: its checksum differs");
    c = copy_blob(b), pbs_put_u32(c.bytes + HEADER_BYTES_AT, 100);
    expect_text(c, "f: the header is damaged");
    c = copy_blob(b), pbs_put_u32(c.bytes + HEADER_TEXT_AT, 1 << 20), reseal_header(c);
    expect_text(c, "f: the header is damaged");
    c = copy_blob(b), *strchr((char *)c.bytes + HEADER_FIXED, 's') = 'x', reseal_header(c);
    expect_text(c, "f: a kind of pbs file that this program does not know");
    c = copy_blob(b);
    CHECK(!strcmp(read_text(c, PBS_KIND(PBS_SURFELS) | PBS_KIND(PBS_VOXELS), false),
                  "f: is a file of kind scene where surfels or voxels is wanted"));
    pbs_put_u64(c.bytes + HEADER_COMPAT_AT, ~0ull); /* additions that may be ignored */
    pbs_put_u16(c.bytes + HEADER_MINOR_AT, 77);
    reseal_header(c);
    CHECK(!strcmp(read_text(c, PBS_KIND(PBS_SCENE), false), ""));
    CHECK(!strcmp(read_text(c, PBS_KIND(PBS_SCENE), true), ""));
    free(c.bytes), free(b.bytes);
}

/* What FTP and git do to line ends, in both directions. */
TEST(text_mode_message) {
    blob b = chunks_file(&run, 3, false), c = {malloc(3 * b.size), 0};
    for (size_t i = 0; i < b.size; i++) {
        if (b.bytes[i] == '\n') c.bytes[c.size++] = '\r';
        c.bytes[c.size++] = b.bytes[i];
    }
    expect_text(c, "f: damaged by a transfer in text mode");
    c = (blob){malloc(b.size), 0};
    for (size_t i = 0; i < b.size; i++)
        if (b.bytes[i] != '\r') c.bytes[c.size++] = b.bytes[i];
    expect_text(c, "f: damaged by a transfer in text mode");
    free(b.bytes);
}

/* Where chunk i of the file begins (4: the footer of three chunks and a page). */
static size_t chunk_at(blob b, int i) {
    size_t at = pbs_get_u32(b.bytes + HEADER_BYTES_AT);
    while (i--) {
        uint64_t n = pbs_get_u64(b.bytes + at + CHUNK_BYTES_AT);
        at += CHUNK_FIXED + (size_t)(n + pbs_padding(n, PBS_ALIGN));
    }
    return at;
}

/* Header, then those chunks of b in that order, then its directory and footer. */
static blob with_chunks(blob b, const char *order) {
    blob c = {malloc(4 * b.size), chunk_at(b, 0)};
    memcpy(c.bytes, b.bytes, c.size);
    for (; *order; order++) {
        size_t from = chunk_at(b, *order - '0'), n = chunk_at(b, *order - '0' + 1) - from;
        memcpy(c.bytes + c.size, b.bytes + from, n), c.size += n;
    }
    size_t rest = chunk_at(b, 4);
    memcpy(c.bytes + c.size, b.bytes + rest, b.size - rest), c.size += b.size - rest;
    return c;
}

static void expect_prefix(blob b, const char *text, const char *end) {
    for (int piped = 0; piped < 2; piped++) {
        const char *got = read_text(b, PBS_KIND(PBS_SCENE), piped);
        bool ok = !strncmp(got, text, strlen(text)) && strlen(got) > strlen(end) &&
                  !strcmp(got + strlen(got) - strlen(end), end);
        if (!ok) printf("# \"%s\", not \"%s ... %s\"\n", got, text, end), pbs_bad++;
        CHECK(check_blob(&run, b, piped, &err) == PBS_DATA);
    }
    free(b.bytes);
}

TEST(chunk_messages) {
    blob b = chunks_file(&run, 4, false), c;
    const char *moved = ": a chunk is missing or doubled";
    expect_prefix(with_chunks(b, "1023"), "f: byte ", moved);
    expect_prefix(with_chunks(b, "0213"), "f: byte ", moved);
    expect_prefix(with_chunks(b, "00123"), "f: byte ", moved);
    expect_prefix(with_chunks(b, "023"), "f: byte ", moved);
    expect_prefix(with_chunks(b, "123"), "f: byte ", moved);
    expect_prefix(with_chunks(b, "012"), "f: byte ", ": chunks are missing, doubled or changed");
    expect_prefix(with_chunks(b, ""), "f: byte ", ": chunks are missing, doubled or changed");
    c = with_chunks(b, "0123");
    CHECK(c.size == b.size && !memcmp(c.bytes, b.bytes, b.size));
    free(c.bytes);
    size_t one = chunk_at(b, 1), foot = b.size - FOOTER_FIXED;
    c = copy_blob(b), c.bytes[one + 5] ^= 1;
    expect_prefix(c, "f: byte ", ": a chunk's header is damaged: its checksum differs");
    c = copy_blob(b), c.bytes[one + CHUNK_FIXED] ^= 1;
    expect_prefix(c, "f: byte ", ": chunk Tes1 is damaged: its checksum differs");
    c = copy_blob(b), c.bytes[foot] ^= 1;
    expect_prefix(c, "f: byte ", ": the footer is damaged: its checksum differs");
    c = copy_blob(b), c.bytes[one + CHUNK_FLAGS_AT] = 9, reseal(c);
    expect_prefix(c, "f: chunk Tes1: codec 9 is not known", "");
    c = copy_blob(b), pbs_put_u64(c.bytes + one + CHUNK_BYTES_AT, PBS_PAYLOAD_MAX + 1);
    pbs_put_u32(c.bytes + one + CHUNK_SELF_AT, pbs_crc32c(0, c.bytes + one, CHUNK_SELF_AT));
    expect_prefix(c, "f: byte ", ": a chunk is larger than the format allows");
    c = copy_blob(b), c.size -= 10;
    expect_prefix(c, "f: byte ", ": the file is cut off here");
    free(b.bytes);
}

/* A chunk whose own checksums are right, but which is not the one that was written. */
TEST(exchanged_chunk_breaks_the_chain) {
    for (int kind = 0; kind < SMALL_KINDS; kind++) {
        blob b = small_file(&run, kind);
        uint8_t *h = b.bytes + pbs_get_u32(b.bytes + HEADER_BYTES_AT);
        while (pbs_get_u32(h + CHUNK_TAG_AT) == PBS_TAG_DIR)
            h += CHUNK_FIXED + pbs_get_u64(h + CHUNK_BYTES_AT) +
                 pbs_padding(pbs_get_u64(h + CHUNK_BYTES_AT), PBS_ALIGN);
        h[CHUNK_FIXED + pbs_get_u64(h + CHUNK_BYTES_AT) - 1] ^= 1;
        reseal_chunk(h, pbs_get_u64(h + CHUNK_BYTES_AT), pbs_get_u32(h + CHUNK_SEQUENCE_AT));
        CHECK(check_blob(&run, b, true, &err) == PBS_DATA);
        CHECK(check_blob(&run, b, false, &err) == PBS_DATA);
        free(b.bytes);
    }
}

TEST(trailing_bytes_message) {
    blob b = chunks_file(&run, 4, false);
    b.bytes = realloc(b.bytes, 2 * b.size);
    memcpy(b.bytes + b.size, b.bytes, b.size);
    for (size_t extra = 1; extra <= b.size;
         extra = extra * 4 < b.size || extra == b.size ? extra * 4 : b.size) {
        blob c = {malloc(b.size + extra), b.size + extra};
        memcpy(c.bytes, b.bytes, c.size);
        expect_prefix(c, "f: byte ", ": more bytes follow the end of the file");
    }
    free(b.bytes);
}

/* A directory that does not tell the truth about a file whose checksums are all right. */
TEST(directory_that_lies) {
    blob b = small_file(&run, SMALL_ARCHIVE);
    size_t dir = pbs_get_u32(b.bytes + HEADER_BYTES_AT), page = dir + CHUNK_FIXED;
    uint64_t bytes = pbs_get_u64(b.bytes + dir + CHUNK_BYTES_AT);
    for (size_t i = PAGE_FIXED; i < bytes; i++) {
        blob c = copy_blob(b);
        c.bytes[page + i] ^= 0x10;
        reseal_chunk(c.bytes + dir, bytes, 0);
        CHECK(check_blob(&run, c, false, &err) == PBS_DATA);
        free(c.bytes);
    }
    free(b.bytes);
}

/* Chunks that nobody knows are passed on; a reader that knows better may have put them there. */
TEST(unknown_tags_are_passed) {
    pbs_record r = pbs_record_make(PBS_POSITION, false);
    pbs_writer *w = spool_writer(&run, PBS_SURFELS, "position:f32x3", 0);
    pbs_points p;
    fill_points(&run, PBS_POSITION, 3, 1, &p);
    pbs_node n = small_node(0, 3, NULL);
    write_chunks(w, 0, 2);
    must(pbs_points_write(&run, w, &r, 0, &p, 0, 2, NULL, &err), &err);
    write_chunks(w, 2, 4);
    must(pbs_node_write(&run, w, &n, &err), &err);
    write_chunks(w, 4, 6);
    blob b = take_bytes(w);
    pbs_points_free(&run, &p);
    for (int piped = 0; piped < 2; piped++) {
        pbs_input in;
        pbs_checked found;
        open_blob(&run, b, piped, &in);
        CHECK(!pbs_check_file(&run, &in, &found, &err));
        CHECK(found.chunks == 9 && found.nodes == 1 && found.records == 3 && found.bytes == b.size);
    }
    free(b.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

/* ---- files whose container is right and whose contents are not ---- */

typedef struct wrong_archive {
    const char *name;
    uint32_t node[3], first[3], count[3]; /* of points chunks; node 9: no chunk */
} wrong_archive;

TEST(archive_contents) {
    static const wrong_archive row[] = {
        {"right", {0, 1, 1}, {0, 0, 2}, {4, 2, 2}},
        {"no such node", {0, 1, 2}, {0, 0, 0}, {4, 4, 1}},
        {"too few", {0, 1, 9}, {0, 0, 0}, {4, 2, 0}},
        {"too many", {0, 1, 1}, {0, 0, 4}, {4, 4, 1}},
        {"one twice, the other not at all", {0, 0, 9}, {0, 0, 0}, {4, 4, 0}},
        {"one has the other's", {0, 0, 9}, {0, 4, 0}, {4, 4, 0}},
        {"a hole", {0, 1, 1}, {0, 0, 3}, {4, 2, 1}},
        {"overlap", {0, 1, 1}, {0, 0, 1}, {4, 2, 2}},
    };
    pbs_record r = pbs_record_make(PBS_POSITION | PBS_SPACING, true);
    for (size_t k = 0; k < sizeof row / sizeof row[0]; k++) {
        pbs_writer *w = spool_writer(&run, PBS_ARCHIVE, "position:u16x3 spacing:f16", 0);
        uint8_t zeros[64] = {0};
        for (uint32_t id = 0; id < 2; id++) {
            pbs_child child;
            pbs_node n = small_node(id, 4, id ? &child : NULL);
            n.lattice = 1;
            must(pbs_node_write(&run, w, &n, &err), &err);
        }
        for (int i = 0; i < 3; i++) {
            if (row[k].node[i] == 9) continue;
            pbs_chunk c = {.tag = PBS_TAG_POINTS,
                           .node = row[k].node[i],
                           .first = row[k].first[i],
                           .count = row[k].count[i]};
            pbs_piece piece = {zeros, c.count * r.stride};
            must(pbs_writer_chunk(w, &c, &piece, 1, &err), &err);
        }
        blob b = take_bytes(w);
        for (int piped = 0; piped < 2; piped++)
            if ((check_blob(&run, b, piped, &err) != PBS_OK) != (k != 0))
                printf("# %s: %s\n", row[k].name, k ? "taken" : err.text), pbs_bad++;
        free(b.bytes);
    }
    CHECK(pbs_mem_used(&run) == 0);
}

/* Packed records need a lattice, which streams have no place for before the points. */
TEST(records_of_the_wrong_form) {
    for (int kind = PBS_CANDIDATES; kind <= PBS_SURFELS; kind++) {
        pbs_writer *w = spool_writer(&run, (pbs_kind)kind, "position:u16x3 spacing:f16", 0);
        uint8_t zeros[64] = {0};
        pbs_chunk c = {.tag = PBS_TAG_POINTS, .count = 2};
        pbs_piece piece = {zeros, 16};
        must(pbs_writer_chunk(w, &c, &piece, 1, &err), &err);
        pbs_node n = small_node(0, 2, NULL);
        must(pbs_node_write(&run, w, &n, &err), &err);
        blob b = take_bytes(w);
        for (int piped = 0; piped < 2; piped++) CHECK(check_blob(&run, b, piped, &err) == PBS_DATA);
        free(b.bytes);
    }
}

/* A count that the bytes do not back asks for no memory. */
TEST(counts_that_lie) {
    blob b = small_file(&run, SMALL_SURFELS);
    size_t at = pbs_get_u32(b.bytes + HEADER_BYTES_AT);
    CHECK(pbs_get_u32(b.bytes + at) == PBS_TAG_POINTS);
    pbs_put_u32(b.bytes + at + CHUNK_COUNT_AT, 4000000000u);
    reseal(b);
    pbs_run small = {.threads = 1, .mem_limit = 64 << 20};
    for (int piped = 0; piped < 2; piped++) {
        CHECK(check_blob(&small, b, piped, &err) == PBS_DATA);
        CHECK_NUM(pbs_mem_peak(&small) < 1 << 20, small.mem_peak);
    }
    free(b.bytes);
}

TEST(no_node_is_no_file) {
    blob b = chunks_file(&run, 0, false);
    for (int piped = 0; piped < 2; piped++) {
        CHECK(!strcmp(read_text(b, PBS_KIND(PBS_SCENE), piped), ""));
        CHECK(check_blob(&run, b, piped, &err) == PBS_DATA && strstr(err.text, "no node in it"));
    }
    free(b.bytes);
}

/* No text wanted: the code must come all the same. */
TEST(no_error_wanted) {
    blob b = small_file(&run, SMALL_SURFELS);
    for (size_t n = 0; n < b.size; n += 37)
        for (int piped = 0; piped < 2; piped++)
            CHECK(check_blob(&run, (blob){b.bytes, n}, piped, NULL) == PBS_DATA);
    CHECK(check_blob(&run, b, true, NULL) == PBS_OK);
    free(b.bytes);
}

TEST_MAIN
