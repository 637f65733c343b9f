/* The container: what is written comes back, from a map and from a pipe; nothing that is cut off or
 * changed is taken for whole; each kind of damage has its own words. */
#include "tests/unit/support.h"
#include "tests/check.h"
#include <dirent.h>
#include <errno.h>
#include <sys/stat.h>

static pbs_run run = {.threads = 1};
static pbs_err err;

/* ---- checksums ---- */

static uint32_t slow_crc(uint32_t crc, const uint8_t *p, size_t n) {
    crc = ~crc;
    for (size_t i = 0; i < n; i++) {
        crc ^= p[i];
        for (int k = 0; k < 8; k++) crc = crc & 1 ? crc >> 1 ^ 0x82f63b78u : crc >> 1;
    }
    return ~crc;
}

TEST(crc32c) {
    CHECK(pbs_crc32c(0, "123456789", 9) == 0xe3069283u &&
          slow_crc(0, (uint8_t *)"123456789", 9) == 0xe3069283u);
    uint8_t bytes[512], zeros[32] = {0};
    CHECK(pbs_crc32c(0, zeros, 32) == 0x8a9136aau); /* RFC 3720, B.4 */
    uint64_t seed = 1;
    for (int i = 0; i < 512; i++) bytes[i] = (uint8_t)random_bits(&seed);
    for (size_t align = 0; align < 16; align++)
        for (size_t n = 0; n < 300; n++) {
            uint32_t want = slow_crc(0, bytes + align, n);
            CHECK(pbs_crc32c(0, bytes + align, n) == want);
            size_t cut = n * align / 16;
            CHECK(pbs_crc32c(pbs_crc32c(0, bytes + align, cut), bytes + align + cut, n - cut) ==
                  want);
        }
    CHECK(pbs_crc32c(0, NULL, 0) == 0);
}

TEST(wire_is_little_endian) {
    uint8_t b[8];
    CHECK(pbs_put_u16(b, 0x1234) == b + 2 && b[0] == 0x34 && b[1] == 0x12);
    CHECK(pbs_put_u64(b, 0x0102030405060708u) == b + 8 && b[0] == 8 && b[7] == 1);
    CHECK(pbs_get_u32(b) == 0x05060708u && pbs_get_u64(b) == 0x0102030405060708u);
    CHECK(pbs_padding(0, 64) == 0 && pbs_padding(1, 64) == 63 && pbs_padding(64, 64) == 0);
}

/* ---- files appear whole or not at all ---- */

static char folder[64];

static int files_in_folder(void) {
    DIR *d = opendir(folder);
    int n = 0;
    for (struct dirent *e; (e = readdir(d));)
        n += strcmp(e->d_name, ".") && strcmp(e->d_name, "..");
    closedir(d);
    return n;
}

static void make_folder(void) {
    snprintf(folder, sizeof folder, "/tmp/pbs-test-XXXXXX");
    if (!mkdtemp(folder)) abort();
}

static pbs_code write_text(pbs_output *out, const char *path, const char *text) {
    pbs_code rc = pbs_output_open(&run, path, out, &err);
    return rc ? rc : pbs_output_write(out, text, strlen(text), &err);
}

static bool holds(const char *path, const char *text) {
    const uint8_t *bytes;
    size_t n;
    if (pbs_map_file(path, &bytes, &n, &err)) return false;
    bool same = n == strlen(text) && (!n || !memcmp(bytes, text, n));
    pbs_unmap_file(bytes, n);
    return same;
}

TEST(output_commit) {
    make_folder();
    char path[100];
    pbs_output out;
    snprintf(path, sizeof path, "%s/x", folder);
    CHECK(!write_text(&out, path, "one") && !pbs_output_flush(&out, &err) && access(path, F_OK));
    pbs_output_close(&out);
    CHECK(files_in_folder() == 0);
    CHECK(!write_text(&out, path, "one") && !pbs_output_commit(&out, &err));
    pbs_output_close(&out);
    CHECK(files_in_folder() == 1 && holds(path, "one"));
    /* the old file stays until the new one is whole */
    CHECK(!write_text(&out, path, "second") && !pbs_output_flush(&out, &err) && holds(path, "one"));
    pbs_output_close(&out);
    CHECK(files_in_folder() == 1 && holds(path, "one"));
    CHECK(!write_text(&out, path, "") && !pbs_output_commit(&out, &err));
    pbs_output_close(&out);
    CHECK(files_in_folder() == 1 && holds(path, ""));
    /* a signal at the last moment */
    volatile sig_atomic_t cancel = 1;
    run.cancel = &cancel;
    CHECK(!write_text(&out, path, "third") && pbs_output_commit(&out, &err) == PBS_CANCEL);
    pbs_output_close(&out);
    run.cancel = NULL;
    CHECK(files_in_folder() == 1 && holds(path, ""));
    unlink(path), rmdir(folder);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(output_errors) {
    pbs_output out;
    CHECK(pbs_output_open(&run, "/nowhere/at/all", &out, &err) == PBS_IO);
    CHECK(!strcmp(err.text, "/nowhere/at/all: No such file or directory"));
    CHECK(pbs_output_open(&run, "/tmp", &out, &err) == PBS_IO);
    CHECK(!strcmp(err.text, "/tmp: is a directory"));
    CHECK(!write_text(&out, "/dev/full", "x") && pbs_output_commit(&out, &err) == PBS_IO);
    CHECK(!strcmp(err.text, "/dev/full: No space left on device"));
    pbs_output_close(&out);
    pbs_run small = {.threads = 1, .mem_limit = 1000};
    CHECK(pbs_output_open(&small, "/dev/null", &out, &err) == PBS_LIMIT && small.mem_used == 0);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(output_large_pieces_and_patches) {
    uint64_t seed = 3;
    size_t n = 0;
    uint8_t *want = malloc(3 << 20), *piece = malloc(700000);
    pbs_output out;
    pbs_input in;
    CHECK(!pbs_output_spool(&run, &out, &err));
    for (int i = 0; n < (2 << 20); i++) {
        size_t k = i % 5 ? random_bits(&seed) % 3000 : random_bits(&seed) % 700000;
        memset(piece, (int)random_bits(&seed), k);
        memcpy(want + n, piece, k), n += k;
        CHECK(!pbs_output_write(&out, piece, k, &err) && out.written == n);
        size_t at = random_bits(&seed) % (n / 2 + 1);
        if (at + 3 <= n) memcpy(want + at, "abc", 3);
        if (at + 3 <= n) CHECK(!pbs_output_patch(&out, at, "abc", 3, &err));
    }
    CHECK(!pbs_output_reopen(&out, &in, &err));
    CHECK(in.mapped && in.size == n && !memcmp(in.bytes, want, n));
    pbs_input_close(&in);
    free(want), free(piece);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(input_errors) {
    pbs_input in;
    CHECK(pbs_input_open(&run, "/nowhere/at/all", &in, &err) == PBS_IO);
    CHECK(pbs_input_open(&run, "/tmp", &in, &err) == PBS_DATA);
    CHECK(!strcmp(err.text, "/tmp: is a directory"));
    const uint8_t *bytes;
    size_t n;
    CHECK(pbs_map_file("/tmp", &bytes, &n, &err) == PBS_IO);
    CHECK(pbs_map_file("/nowhere", &bytes, &n, &err) == PBS_IO);
}

TEST(input_pipe_peek_read_map) {
    uint8_t data[300], got[400];
    for (int i = 0; i < 300; i++) data[i] = (uint8_t)(i * 7);
    for (size_t size = 0; size <= 300; size += 50)
        for (int mode = 0; mode < 4; mode++) { /* bit 0: peek first; bit 1: map */
            pbs_input in;
            const uint8_t *head;
            size_t n, a, b;
            open_piped(&run, (blob){data, size}, &in);
            CHECK(!in.mapped);
            if (mode & 1) {
                CHECK(!pbs_input_peek(&in, &head, &n, &err) && n == (size < 64 ? size : 64));
                CHECK(!n || !memcmp(head, data, n));
            }
            if (mode & 2) {
                CHECK(!pbs_input_map(&in, &err) && in.mapped && in.size == size);
                CHECK(!size || !memcmp(in.bytes, data, size));
            } else {
                CHECK(!pbs_input_read(&in, got, 33, &a, &err) && a == (size < 33 ? size : 33));
                CHECK(!pbs_input_read(&in, got + a, 367, &b, &err) && a + b == size);
                CHECK(!memcmp(got, data, size));
            }
            pbs_input_close(&in);
        }
    CHECK(pbs_mem_used(&run) == 0);
}

/* ---- what is written comes back ---- */

enum { BIG = 3000 };

static pbs_chunk chunk_number(uint64_t i, uint8_t payload[200], size_t *n) {
    uint64_t seed = i;
    *n = random_bits(&seed) % 5 ? random_bits(&seed) % 200 : 64 * (i % 2);
    for (size_t k = 0; k < *n; k++) payload[k] = (uint8_t)random_bits(&seed);
    return (pbs_chunk){.tag = PBS_TAG('T', 'e', 's', '0' + i % 10),
                       .flags = (uint32_t)(i * 256),
                       .node = (uint32_t)(i * 3),
                       .count = random_bits(&seed),
                       .first = random_bits(&seed)};
}

static void write_chunks(pbs_writer *w, uint64_t from, uint64_t n) {
    uint8_t payload[200];
    for (uint64_t i = from; i < n; i++) {
        size_t size;
        pbs_chunk c = chunk_number(i, payload, &size);
        pbs_piece piece[3] = {
            {payload, size / 3}, {NULL, 0}, {payload + size / 3, size - size / 3}};
        must(pbs_writer_chunk(w, &c, piece, 3, &err), &err);
    }
}

static blob chunks_file(uint64_t n, bool front) {
    pbs_writer *w = spool_writer(&run, PBS_SCENE, "some:u8", front ? n : 0);
    write_chunks(w, 0, n);
    return take_bytes(w);
}

static bool is_chunk(const pbs_chunk *c, uint64_t i) {
    uint8_t payload[200];
    size_t n;
    pbs_chunk want = chunk_number(i, payload, &n);
    return c->tag == want.tag && c->flags == want.flags && c->node == want.node &&
           c->count == want.count && c->first == want.first && c->bytes == n &&
           (uintptr_t)c->payload % PBS_ALIGN == 0 &&
           (n ? !memcmp(c->payload, payload, n) : !c->payload);
}

static void check_directory(pbs_reader *r, uint64_t n) {
    const pbs_chunk *e;
    size_t count = 0;
    CHECK(!pbs_reader_directory(r, &e, &count, &err) && count == n);
    for (size_t i = 0; i < count && count == n; i++) {
        size_t k = (i * 7919 + 5) % count; /* in no order */
        pbs_chunk c;
        if (!pbs_reader_at(r, &e[k], &c, &err) && is_chunk(&c, k) && c.offset == e[k].offset)
            continue;
        CHECK_NUM(!"chunk behind the directory", k);
        return;
    }
}

static void check_chunks(blob b, uint64_t n, bool piped) {
    pbs_input in;
    pbs_reader *r;
    open_blob(&run, b, piped, &in);
    CHECK(!pbs_reader_open(&run, &in, PBS_KIND(PBS_SCENE), &r, &err) && in.fd == -1);
    CHECK(pbs_reader_mapped(r) == !piped && pbs_reader_kind(r) == PBS_SCENE);
    CHECK(!strcmp(pbs_reader_channels(r), "some:u8"));
    CHECK(!strcmp(pbs_reader_history(r), "stage a test\nstage test\n"));
    if (!piped) check_directory(r, n);
    uint64_t i = 0;
    bool end = false;
    for (;; i++) {
        pbs_chunk c;
        pbs_code rc = pbs_reader_next(r, &c, &end, &err);
        if (rc || end) break;
        if (!is_chunk(&c, i)) {
            CHECK_NUM(!"the same chunk", i);
            break;
        }
    }
    CHECK_NUM(end && i == n, i);
    pbs_chunk c;
    CHECK(!pbs_reader_next(r, &c, &end, &err) && end && pbs_reader_bytes(r) == b.size);
    if (!piped) check_directory(r, n);
    pbs_reader_close(r);
}

TEST(any_number_of_chunks) {
    static const uint64_t counts[] = {0, 1, 2, 1023, 1024, 1025, 2047, 2048, 2049, BIG};
    for (int i = 0; i < 10; i++)
        for (int front = 0; front < 2; front++) {
            blob b = chunks_file(counts[i], front);
            CHECK(b.size % PBS_ALIGN == 0);
            check_chunks(b, counts[i], false);
            check_chunks(b, counts[i], true);
            free(b.bytes);
        }
    CHECK(pbs_mem_used(&run) == 0);
}

/* An archive's directory is in the first bytes of the file. */
TEST(front_directory_is_in_front) {
    blob b = chunks_file(50, true), c = chunks_file(50, false);
    uint32_t header = pbs_get_u32(b.bytes + HEADER_BYTES_AT);
    CHECK(pbs_get_u32(b.bytes + header) == PBS_TAG_DIR && b.size == c.size);
    CHECK(pbs_get_u32(c.bytes + header) != PBS_TAG_DIR);
    CHECK(!memcmp(b.bytes, "\x89PBS\r\n\x1a\n", 8) &&
          !memcmp(b.bytes + b.size - 8, "PBS END\n", 8));
    CHECK(!memcmp(b.bytes + HEADER_FIXED,
                  "pbs scene 1\nchannels some:u8\nstage a test\nstage test\n", 54));
    free(b.bytes), free(c.bytes);
}

static blob through_fifo(bool front) {
    char path[100];
    snprintf(path, sizeof path, "%s/fifo", folder);
    if (mkfifo(path, 0600)) abort();
    int fd = open(path, O_RDONLY | O_NONBLOCK);
    fcntl(fd, F_SETPIPE_SZ, 1 << 20);
    pbs_writer_desc d = {.path = path,
                         .kind = PBS_SCENE,
                         .channels = "some:u8",
                         .history = "stage a test\n",
                         .stage = "test",
                         .front = front ? 1500 : 0};
    pbs_writer *w;
    must(pbs_writer_open(&run, &d, &w, &err), &err);
    write_chunks(w, 0, 1500);
    must(pbs_writer_commit(w, &err), &err);
    blob b = {malloc(1 << 20), 0};
    CHECK(pbs_writer_bytes(w) > 1000);
    uint64_t bytes = pbs_writer_bytes(w);
    pbs_writer_close(w);
    b.size = (size_t)read(fd, b.bytes, 1 << 20);
    CHECK(b.size == bytes);
    close(fd);
    unlink(path);
    return b;
}

/* To a file, to a spool and to a pipe the same bytes are written. */
TEST(same_bytes_to_file_and_pipe) {
    make_folder();
    for (int front = 0; front < 2; front++) {
        char path[100];
        snprintf(path, sizeof path, "%s/f.pbs", folder);
        pbs_writer_desc d = {.path = path,
                             .kind = PBS_SCENE,
                             .channels = "some:u8",
                             .history = "stage a test\n",
                             .stage = "test",
                             .front = front ? 1500 : 0};
        pbs_writer *w;
        must(pbs_writer_open(&run, &d, &w, &err), &err);
        write_chunks(w, 0, 1500);
        CHECK(access(path, F_OK) && !pbs_writer_commit(w, &err) && !access(path, F_OK));
        pbs_writer_close(w);
        blob spool = chunks_file(1500, front), piped = through_fifo(front);
        const uint8_t *bytes = NULL;
        size_t n = 0;
        CHECK(!pbs_map_file(path, &bytes, &n, &err));
        CHECK(n == spool.size && !memcmp(bytes, spool.bytes, n));
        CHECK(n == piped.size && !memcmp(bytes, piped.bytes, n));
        pbs_unmap_file(bytes, n);
        free(spool.bytes), free(piped.bytes);
        unlink(path);
        /* thrown away */
        must(pbs_writer_open(&run, &d, &w, &err), &err);
        write_chunks(w, 0, 700);
        pbs_writer_close(w);
        CHECK(files_in_folder() == 0);
    }
    rmdir(folder);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(writer_errors) {
    pbs_writer *w = spool_writer(&run, PBS_SCENE, NULL, 3);
    pbs_chunk c = {.tag = 1};
    write_chunks(w, 0, 2);
    CHECK(pbs_writer_commit(w, &err) == PBS_INTERNAL);
    write_chunks(w, 2, 3);
    CHECK(pbs_writer_chunk(w, &c, NULL, 0, &err) == PBS_INTERNAL);
    pbs_writer_close(w);
    w = spool_writer(&run, PBS_SCENE, NULL, 0);
    uint8_t *large = calloc(1, PBS_PAYLOAD_MAX + 1);
    pbs_piece piece = {large, PBS_PAYLOAD_MAX + 1};
    CHECK(pbs_writer_chunk(w, &c, &piece, 1, &err) == PBS_LIMIT);
    CHECK(!strcmp(err.text, "a chunk of 67108865 bytes: the format's limit is 67108864"));
    pbs_writer_close(w);
    memset(large, 'x', PBS_HEADER_MAX), large[PBS_HEADER_MAX] = 0;
    pbs_writer_desc d = {.path = "/dev/null", .kind = PBS_SCENE, .history = (char *)large};
    CHECK(pbs_writer_open(&run, &d, &w, &err) == PBS_LIMIT && !w);
    free(large);
    pbs_writer_close(NULL);
    pbs_reader_close(NULL);
    CHECK(pbs_mem_used(&run) == 0);
}

/* ---- damage ---- */

static const char *const small_name[SMALL_KINDS] = {"scene", "candidates", "surfels", "archive"};

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
    blob b = chunks_file(3, false), c;
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
    CHECK(!strcmp(read_text(c, PBS_KIND(PBS_SURFELS) | PBS_KIND(PBS_POINTS), false),
                  "f: is a file of kind scene where surfels or points is wanted"));
    pbs_put_u64(c.bytes + HEADER_COMPAT_AT, ~0ull); /* additions that may be ignored */
    pbs_put_u16(c.bytes + HEADER_MINOR_AT, 77);
    reseal_header(c);
    CHECK(!strcmp(read_text(c, PBS_KIND(PBS_SCENE), false), ""));
    CHECK(!strcmp(read_text(c, PBS_KIND(PBS_SCENE), true), ""));
    free(c.bytes), free(b.bytes);
}

/* What FTP and git do to line ends, in both directions. */
TEST(text_mode_message) {
    blob b = chunks_file(3, false), c = {malloc(3 * b.size), 0};
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
    blob b = chunks_file(4, false), c;
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

TEST(trailing_bytes_message) {
    blob b = chunks_file(4, false);
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
    must(pbs_node_write(w, &n, &err), &err);
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
            must(pbs_node_write(w, &n, &err), &err);
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
        must(pbs_node_write(w, &n, &err), &err);
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
    blob b = chunks_file(0, false);
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
