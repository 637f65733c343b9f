/* writer.c: the container, written. Chunks that go through a codec wait until there are enough of
 * them for all threads, and are written in the order in which they came. */
#include "formats/container/container.h"
#include "formats/container/layout.h"
#include "formats/container/wire.h"
#include "libcore/ground/pipe.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    WAITING = 256,           /* chunks at most, */
    WAITING_BYTES = 1 << 20, /* or so many bytes for each thread, if every thread has two of them */
    WAITING_SHARE = 8        /* and never more than this part of the memory that is left */
};

typedef struct waiting {
    pbs_chunk chunk;
    uint8_t *payload; /* in one piece */
    pbs_packed packed;
} waiting;

struct pbs_writer {
    pbs_run *run;
    pbs_output out;
    bool piped;        /* `out` is a spool that is copied to standard output at the end */
    pbs_output target; /* if piped */
    uint8_t *dir;      /* entries so far */
    size_t dir_bytes, dir_cap;
    uint64_t chunks, front, front_at;
    uint32_t chain;
    pbs_codec codec;
    waiting *queue;                       /* WAITING of them; NULL: there is no codec */
    size_t queued, queued_bytes, working; /* working: what packing the one that needs most takes */
};

const char *const pbs_kind_name[PBS_KINDS] = {"scene", "candidates", "surfels", "voxels",
                                              "archive"};

const char *pbs_tag_text(uint32_t tag, char out[5]) {
    for (int i = 0; i < 4; i++) {
        char c = (char)(tag >> 8 * i);
        out[i] = c >= 0x20 && c < 0x7f ? c : '?';
    }
    out[4] = 0;
    return out;
}

static pbs_code put_zeros(pbs_writer *w, uint64_t n, pbs_err *err) {
    static const uint8_t zeros[4096];
    pbs_code rc = PBS_OK;
    for (; n && !rc; n -= n < sizeof zeros ? n : sizeof zeros)
        rc = pbs_output_write(&w->out, zeros, n < sizeof zeros ? (size_t)n : sizeof zeros, err);
    return rc;
}

static char *header_text(const pbs_writer_desc *d) {
    char *text;
    int n = asprintf(&text, "pbs %s %d\n%s%s%s%s%s%s%s", pbs_kind_name[d->kind], PBS_VERSION_MAJOR,
                     d->channels && *d->channels ? "channels " : "", d->channels ? d->channels : "",
                     d->channels && *d->channels ? "\n" : "", d->history ? d->history : "",
                     d->stage ? "stage " : "", d->stage ? d->stage : "", d->stage ? "\n" : "");
    if (n < 0) return NULL;
    /* A stage names files, and a file's name may have line ends in it. */
    for (char *c = text + n - (d->stage ? strlen(d->stage) + 1 : 0); *c && c[1]; c++)
        if ((unsigned char)*c < 0x20 || *c == 0x7f) *c = '?';
    return text;
}

static pbs_code write_header(pbs_writer *w, const pbs_writer_desc *d, pbs_err *err) {
    char *text = header_text(d);
    if (!text) return pbs_fail(err, PBS_LIMIT, "no memory");
    size_t n = strlen(text);
    size_t bytes = HEADER_FIXED + n + (size_t)pbs_padding(n, PBS_ALIGN);
    uint8_t *h = bytes <= PBS_HEADER_MAX ? calloc(1, bytes) : NULL;
    if (!h) {
        free(text);
        return pbs_fail(err, PBS_LIMIT, "the history of the inputs is too long (%zu bytes)", n);
    }
    memcpy(h, PBS_MAGIC, 8);
    pbs_put_u32(h + HEADER_BYTES_AT, (uint32_t)bytes);
    pbs_put_u16(h + HEADER_MAJOR_AT, PBS_VERSION_MAJOR);
    pbs_put_u16(h + HEADER_MINOR_AT, PBS_VERSION_MINOR);
    pbs_put_u32(h + HEADER_TEXT_AT, (uint32_t)n);
    memcpy(h + HEADER_FIXED, text, n);
    pbs_put_u32(h + HEADER_CRC_AT, pbs_crc32c(0, h, bytes));
    /* In a file the magic comes last: what has it is whole. */
    if (w->out.seekable) memset(h, 0, 8);
    pbs_code rc = pbs_output_write(&w->out, h, bytes, err);
    free(h);
    free(text);
    return rc;
}

static uint64_t page_bytes(uint64_t entries) {
    uint64_t payload = PAGE_FIXED + entries * ENTRY_SIZE;
    return CHUNK_FIXED + payload + pbs_padding(payload, PBS_ALIGN);
}

static uint64_t directory_bytes(uint64_t entries) {
    uint64_t full = entries / PBS_PAGE_ENTRIES, rest = entries % PBS_PAGE_ENTRIES;
    return full * page_bytes(PBS_PAGE_ENTRIES) + (rest || !full ? page_bytes(rest) : 0);
}

/* An archive's directory goes in front of what it lists, which needs a file to go back in; a pipe
 * gets its bytes from a spool at the end. */
static pbs_code open_output(pbs_writer *w, const pbs_writer_desc *d, pbs_err *err) {
    if (d->output) {
        w->out = *d->output;
        return PBS_OK;
    }
    pbs_code rc = pbs_output_open(w->run, d->path, &w->out, err);
    if (rc || !d->front || w->out.seekable) return rc;
    w->target = w->out;
    w->piped = true;
    return pbs_output_spool(w->run, &w->out, err);
}

pbs_code pbs_writer_open(pbs_run *run, const pbs_writer_desc *d, pbs_writer **out, pbs_err *err) {
    pbs_writer *w = *out = calloc(1, sizeof *w);
    if (!w) return pbs_fail(err, PBS_LIMIT, "no memory");
    w->run = run;
    w->front = d->front;
    w->codec = d->kind == PBS_ARCHIVE ? d->codec : PBS_CODEC_NONE;
    w->out.fd = w->target.fd = -1;
    pbs_code rc = open_output(w, d, err);
    if (!rc && w->codec)
        rc = pbs_alloc(run, &w->queue, WAITING, sizeof *w->queue, "chunks to be packed", err);
    if (!rc) rc = write_header(w, d, err);
    w->front_at = w->out.written;
    if (!rc && w->front) rc = put_zeros(w, directory_bytes(w->front), err);
    /* Announced chunks need no room that grows. */
    if (!rc)
        rc = pbs_grow(run, &w->dir, &w->dir_cap, (size_t)w->front * ENTRY_SIZE, 1, "the directory",
                      err);
    if (!rc) return PBS_OK;
    pbs_writer_close(w);
    *out = NULL;
    return rc;
}

static void chunk_header(uint8_t h[CHUNK_FIXED], const pbs_chunk *c, uint64_t sequence) {
    memset(h, 0, CHUNK_FIXED);
    pbs_put_u32(h + CHUNK_TAG_AT, c->tag);
    pbs_put_u32(h + CHUNK_FLAGS_AT, c->flags | c->codec);
    pbs_put_u32(h + CHUNK_NODE_AT, c->node);
    pbs_put_u32(h + CHUNK_COUNT_AT, c->count);
    pbs_put_u64(h + CHUNK_BYTES_AT, c->stored);
    pbs_put_u64(h + CHUNK_RAW_AT, c->bytes);
    pbs_put_u32(h + CHUNK_CRC_AT, c->crc);
    pbs_put_u32(h + CHUNK_FIRST_AT, c->first);
    pbs_put_u32(h + CHUNK_SEQUENCE_AT, (uint32_t)sequence);
    pbs_put_u32(h + CHUNK_SELF_AT, pbs_crc32c(0, h, CHUNK_SELF_AT));
}

static pbs_code add_entry(pbs_writer *w, const pbs_chunk *c, pbs_err *err) {
    pbs_code rc =
        pbs_grow(w->run, &w->dir, &w->dir_cap, w->dir_bytes + ENTRY_SIZE, 1, "the directory", err);
    if (rc) return rc;
    uint8_t *e = w->dir + w->dir_bytes;
    pbs_put_u32(e + ENTRY_TAG_AT, c->tag);
    pbs_put_u32(e + ENTRY_FLAGS_AT, c->flags | c->codec);
    pbs_put_u32(e + ENTRY_NODE_AT, c->node);
    pbs_put_u32(e + ENTRY_COUNT_AT, c->count);
    pbs_put_u64(e + ENTRY_OFFSET_AT, c->offset);
    pbs_put_u64(e + ENTRY_BYTES_AT, c->stored);
    pbs_put_u32(e + ENTRY_CRC_AT, c->crc);
    pbs_put_u32(e + ENTRY_FIRST_AT, c->first);
    w->dir_bytes += ENTRY_SIZE;
    return PBS_OK;
}

/* c: all but its place in the file. */
static pbs_code put_chunk(pbs_writer *w, pbs_chunk *c, const pbs_piece *piece, int pieces,
                          pbs_err *err) {
    c->offset = w->out.written;
    if (c->bytes > PBS_PAYLOAD_MAX)
        return pbs_fail(err, PBS_LIMIT, "a chunk of %llu bytes: the format's limit is %u",
                        (unsigned long long)c->bytes, PBS_PAYLOAD_MAX);
    if (w->front && w->chunks == w->front)
        return pbs_fail(err, PBS_INTERNAL, "more chunks than announced");
    uint8_t h[CHUNK_FIXED];
    chunk_header(h, c, w->chunks++);
    w->chain = pbs_crc32c(w->chain, h, CHUNK_SELF_AT);
    pbs_code rc = add_entry(w, c, err);
    if (!rc) rc = pbs_output_write(&w->out, h, sizeof h, err);
    for (int i = 0; i < pieces && !rc; i++)
        rc = pbs_output_write(&w->out, piece[i].bytes, piece[i].size, err);
    return rc ? rc : put_zeros(w, pbs_padding(c->stored, PBS_ALIGN), err);
}

/* In one piece, for a codec; bytes is what they have together. */
static pbs_code join(pbs_run *run, const pbs_piece *piece, int pieces, uint64_t bytes,
                     uint8_t **out, pbs_err *err) {
    pbs_code rc = pbs_alloc(run, out, (size_t)bytes, 1, "a chunk to be packed", err);
    uint8_t *to = *out;
    for (int i = 0; i < pieces && !rc; i++) {
        if (piece[i].size) memcpy(to, piece[i].bytes, piece[i].size);
        to += piece[i].size;
    }
    return rc;
}

/* ---- chunks that are packed ---- */

static bool is_packed(const pbs_writer *w, const pbs_chunk *c) {
    return w->codec && c->bytes && c->bytes <= PBS_PAYLOAD_MAX && pbs_codec_fits(c->tag);
}

/* As pbs_parallel's. */
static pbs_code pack(void *ctx, size_t i, int thread, pbs_err *err) {
    pbs_writer *w = ctx;
    waiting *q = &w->queue[i];
    pbs_chunk *c = &q->chunk;
    (void)thread;
    pbs_code rc = pbs_codec_pack(w->run, w->codec, c->tag, c->count, q->payload, (size_t)c->bytes,
                                 &q->packed, err);
    if (rc) return rc;
    if (q->packed.bytes) {
        pbs_free(w->run, q->payload);
        q->payload = NULL;
        c->codec = q->packed.codec;
        c->stored = q->packed.size;
        c->bytes = q->packed.raw;
    }
    c->crc = pbs_crc32c(0, q->payload ? q->payload : q->packed.bytes, (size_t)c->stored);
    return PBS_OK;
}

static void drop_queue(pbs_writer *w) {
    for (size_t i = 0; i < w->queued; i++) {
        pbs_free(w->run, w->queue[i].payload);
        pbs_free(w->run, w->queue[i].packed.bytes);
    }
    w->queued = w->queued_bytes = w->working = 0;
}

/* One after the other if memory is too little for several: what it does then, it does on one
 * thread, too. */
static pbs_code flush_queue(pbs_writer *w, pbs_err *err) {
    size_t threads = w->queued < (size_t)w->run->threads ? w->queued : (size_t)w->run->threads;
    bool several = threads > 1 && w->working <= pbs_mem_left(w->run) / threads;
    pbs_code rc = several ? pbs_parallel(w->run, w->queued, pack, w, err) : PBS_OK;
    for (size_t i = 0; i < w->queued && !rc; i++) {
        waiting *q = &w->queue[i];
        if (!several) rc = pack(w, i, 0, err);
        pbs_piece piece = {q->payload ? q->payload : q->packed.bytes, (size_t)q->chunk.stored};
        if (!rc) rc = put_chunk(w, &q->chunk, &piece, 1, err);
        pbs_free(w->run, q->payload);
        pbs_free(w->run, q->packed.bytes);
        q->payload = q->packed.bytes = NULL;
    }
    drop_queue(w);
    return rc;
}

static bool is_full(const pbs_writer *w) {
    size_t threads = (size_t)w->run->threads;
    return threads == 1 || w->queued == WAITING ||
           (w->queued >= 2 * threads && w->queued_bytes >= WAITING_BYTES * threads);
}

static pbs_code queue_chunk(pbs_writer *w, const pbs_chunk *c, const pbs_piece *piece, int pieces,
                            pbs_err *err) {
    pbs_code rc = PBS_OK;
    if (w->queued_bytes + c->bytes > pbs_mem_left(w->run) / WAITING_SHARE) rc = flush_queue(w, err);
    waiting *q = &w->queue[w->queued];
    *q = (waiting){.chunk = *c};
    if (!rc) rc = join(w->run, piece, pieces, c->bytes, &q->payload, err);
    if (rc) return rc;
    size_t working = pbs_codec_memory(w->codec, c->tag, (size_t)c->bytes);
    if (working > w->working) w->working = working;
    w->queued++;
    w->queued_bytes += c->bytes;
    return is_full(w) ? flush_queue(w, err) : PBS_OK;
}

pbs_code pbs_writer_chunk(pbs_writer *w, const pbs_chunk *chunk, const pbs_piece *piece, int pieces,
                          pbs_err *err) {
    pbs_chunk c = *chunk;
    c.bytes = c.crc = 0;
    c.codec = PBS_CODEC_NONE;
    for (int i = 0; i < pieces; i++) c.bytes += piece[i].size;
    c.stored = c.bytes;
    if (is_packed(w, &c)) return queue_chunk(w, &c, piece, pieces, err);
    pbs_code rc = flush_queue(w, err);
    for (int i = 0; i < pieces && !rc; i++)
        c.crc = pbs_crc32c(c.crc, piece[i].bytes, piece[i].size);
    return rc ? rc : put_chunk(w, &c, piece, pieces, err);
}

pbs_code pbs_writer_pass(pbs_writer *w, const pbs_chunk *chunk, pbs_err *err) {
    pbs_chunk c = *chunk;
    pbs_piece piece = {c.payload, (size_t)c.bytes};
    if (w->codec || c.codec) return pbs_writer_chunk(w, &c, &piece, 1, err);
    c.stored = c.bytes;
    return put_chunk(w, &c, &piece, 1, err);
}

/* One page, chunk header and all, into buf; returns its size. */
static size_t make_page(const pbs_writer *w, uint64_t page, uint64_t pages, uint8_t *buf) {
    uint64_t first = page * PBS_PAGE_ENTRIES;
    uint64_t n = w->chunks - first < PBS_PAGE_ENTRIES ? w->chunks - first : PBS_PAGE_ENTRIES;
    size_t size = (size_t)page_bytes(n);
    memset(buf, 0, size);
    uint8_t *p = buf + CHUNK_FIXED;
    pbs_put_u32(p, (uint32_t)page);
    pbs_put_u32(p + 4, (uint32_t)pages);
    pbs_put_u64(p + 8, w->chunks);
    if (n) memcpy(p + PAGE_FIXED, w->dir + first * ENTRY_SIZE, (size_t)n * ENTRY_SIZE);
    pbs_chunk c = {.tag = PBS_TAG_DIR,
                   .node = UINT32_MAX,
                   .count = (uint32_t)n,
                   .first = (uint32_t)first,
                   .bytes = PAGE_FIXED + n * ENTRY_SIZE};
    c.stored = c.bytes;
    c.crc = pbs_crc32c(0, p, (size_t)c.bytes);
    chunk_header(buf, &c, page);
    return size;
}

static pbs_code write_directory(pbs_writer *w, pbs_err *err) {
    if (w->front && w->chunks != w->front)
        return pbs_fail(err, PBS_INTERNAL, "fewer chunks than announced");
    uint8_t *buf = malloc((size_t)page_bytes(PBS_PAGE_ENTRIES));
    if (!buf) return pbs_fail(err, PBS_LIMIT, "no memory");
    uint64_t pages = (w->chunks + PBS_PAGE_ENTRIES - 1) / PBS_PAGE_ENTRIES, at = w->front_at;
    pbs_code rc = PBS_OK;
    if (!pages) pages = 1;
    for (uint64_t i = 0; i < pages && !rc; i++) {
        size_t n = make_page(w, i, pages, buf);
        rc = w->front ? pbs_output_patch(&w->out, at, buf, n, err)
                      : pbs_output_write(&w->out, buf, n, err);
        at += n;
    }
    free(buf);
    return rc;
}

static pbs_code finish(pbs_writer *w, pbs_err *err) {
    pbs_code rc = flush_queue(w, err);
    uint64_t dir = w->front ? w->front_at : w->out.written;
    if (!rc) rc = write_directory(w, err);
    if (rc) return rc;
    uint8_t f[FOOTER_FIXED] = {0};
    pbs_put_u64(f + FOOTER_DIR_AT, dir);
    pbs_put_u64(f + FOOTER_DIR_BYTES_AT, directory_bytes(w->chunks));
    pbs_put_u64(f + FOOTER_FILE_AT, w->out.written + FOOTER_FIXED);
    pbs_put_u64(f + FOOTER_CHUNKS_AT, w->chunks);
    pbs_put_u32(f + FOOTER_CHAIN_AT, w->chain);
    pbs_put_u32(f + FOOTER_CRC_AT, pbs_crc32c(0, f, FOOTER_CRC_AT));
    memcpy(f + FOOTER_MAGIC_AT, PBS_END, 8);
    rc = pbs_output_write(&w->out, f, sizeof f, err);
    if (!rc && w->out.seekable) rc = pbs_output_patch(&w->out, 0, PBS_MAGIC, 8, err);
    return rc;
}

static pbs_code copy_spool(pbs_writer *w, pbs_err *err) {
    pbs_input in;
    pbs_code rc = pbs_output_reopen(&w->out, &in, err);
    const uint64_t step = 4 << 20;
    for (uint64_t at = 0; !rc && at < in.size; at += step) {
        rc = pbs_run_check(w->run, err);
        uint64_t n = in.size - at < step ? in.size - at : step;
        if (!rc) rc = pbs_output_write(&w->target, in.bytes + at, (size_t)n, err);
    }
    if (!rc) rc = pbs_output_commit(&w->target, err);
    pbs_input_close(&in);
    return rc;
}

pbs_code pbs_writer_commit(pbs_writer *w, pbs_err *err) {
    pbs_code rc = finish(w, err);
    if (rc) return rc;
    return w->piped ? copy_spool(w, err) : pbs_output_commit(&w->out, err);
}

pbs_code pbs_writer_reopen(pbs_writer *w, pbs_input *in, pbs_err *err) {
    pbs_code rc = finish(w, err);
    return rc ? rc : pbs_output_reopen(&w->out, in, err);
}

uint64_t pbs_writer_bytes(const pbs_writer *w) {
    return w->piped && !w->out.run ? w->target.written : w->out.written;
}

void pbs_writer_close(pbs_writer *w) {
    if (!w) return;
    pbs_output_close(&w->out);
    if (w->piped) pbs_output_close(&w->target);
    drop_queue(w);
    pbs_free(w->run, w->queue);
    pbs_free(w->run, w->dir);
    free(w);
}
