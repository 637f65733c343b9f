/* The container: what is written comes back, from a map and from a pipe, in any number of chunks;
 * files appear whole or not at all. */
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
    static uint8_t many[40000]; /* so long that it goes in lanes */
    for (size_t i = 0; i < sizeof many; i++) many[i] = (uint8_t)random_bits(&seed);
    for (size_t n = 12280; n < sizeof many; n += 1231)
        CHECK_NUM(pbs_crc32c(7, many + n % 5, n - 5) == slow_crc(7, many + n % 5, n - 5), n);
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
    unlink(path);
    /* the name is taken by a folder in the meantime: what was written does not stay beside it */
    CHECK(!write_text(&out, path, "fourth") && !mkdir(path, 0700));
    CHECK(pbs_output_commit(&out, &err) == PBS_IO && strstr(err.text, "directory"));
    pbs_output_close(&out);
    CHECK(files_in_folder() == 1);
    rmdir(path), rmdir(folder);
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

enum { MAPPED, PIPED, BOTH };

/* A file that is mapped and read. */
static void open_both(blob b, pbs_input *in) {
    FILE *f = fopen("both.pbs", "wb");
    CHECK(f && fwrite(b.bytes, 1, b.size, f) == b.size && !fclose(f));
    CHECK(!pbs_input_open_both(&run, "both.pbs", in, &err) && in->mapped && in->fd >= 0);
    remove("both.pbs");
}

static void check_chunks(blob b, uint64_t n, int mode) {
    bool piped = mode == PIPED;
    pbs_input in;
    pbs_reader *r;
    if (mode == BOTH)
        open_both(b, &in);
    else
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
            blob b = chunks_file(&run, counts[i], front);
            CHECK(b.size % PBS_ALIGN == 0);
            for (int mode = MAPPED; mode <= BOTH; mode++) check_chunks(b, counts[i], mode);
            free(b.bytes);
        }
    CHECK(pbs_mem_used(&run) == 0);
}

/* An archive's directory is in the first bytes of the file. */
TEST(front_directory_is_in_front) {
    blob b = chunks_file(&run, 50, true), c = chunks_file(&run, 50, false);
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
        blob spool = chunks_file(&run, 1500, front), piped = through_fifo(front);
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

/* What has the magic is whole: until the end there are zeros in its place. */
TEST(magic_is_written_last) {
    pbs_output spool;
    pbs_writer *w;
    pbs_input in;
    uint8_t head[8], zeros[8] = {0};
    must(pbs_output_spool(&run, &spool, &err), &err);
    int fd = dup(spool.fd);
    pbs_writer_desc d = {.output = &spool, .kind = PBS_SCENE};
    must(pbs_writer_open(&run, &d, &w, &err), &err);
    write_chunks(w, 0, BIG); /* more than the buffer: some of it is in the file */
    CHECK(pread(fd, head, 8, 0) == 8 && !memcmp(head, zeros, 8));
    must(pbs_writer_reopen(w, &in, &err), &err);
    CHECK(pread(fd, head, 8, 0) == 8 && !memcmp(head, PBS_MAGIC, 8));
    pbs_input_close(&in);
    pbs_writer_close(w);
    close(fd);
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

TEST_MAIN
