/* reader.c: the container, read front to back or through its directory. Every byte of a file is
 * covered by a checksum or known to be zero, so that a flipped bit anywhere is found. */
#include "formats/container/container.h"
#include "formats/container/layout.h"
#include "formats/container/wire.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

struct pbs_reader {
    pbs_run *run;
    pbs_input in;
    pbs_kind kind;
    char *text, *channels, *history;
    uint64_t at, header_bytes;
    uint64_t dropped;         /* of a map read front to back: the pages before it are given back */
    uint64_t chunks, pages;   /* seen so far */
    uint64_t dir_at, dir_end; /* where directory pages were seen */
    uint32_t chain;
    uint8_t *buffer; /* payload of a piped chunk */
    size_t buffer_cap;
    uint8_t *unpacked; /* payload of a chunk with a codec */
    size_t unpacked_cap;
    pbs_chunk *entries;
    size_t entry_count;
    bool ended;
};

static pbs_code bad_at(const pbs_reader *r, uint64_t at, pbs_err *err, const char *what) {
    return pbs_fail(err, PBS_DATA, "%s: byte %llu: %s", r->in.name, (unsigned long long)at, what);
}

static pbs_code bad(const pbs_reader *r, pbs_err *err, const char *what) {
    return bad_at(r, r->at, err, what);
}

/* n bytes at r->at: in the map, or read into to. */
static pbs_code fetch(pbs_reader *r, uint8_t *to, size_t n, const uint8_t **out, pbs_err *err) {
    size_t got = n;
    pbs_code rc = PBS_OK;
    if (r->in.mapped && (r->at > r->in.size || n > r->in.size - r->at)) goto cut;
    if (!r->in.mapped)
        rc = pbs_input_read(&r->in, to, n, &got, err);
    else if (r->in.fd >= 0)
        rc = pbs_input_read_at(&r->in, r->at, to, n, &got, err);
    if (rc) return rc;
    if (got < n) goto cut;
    *out = r->in.fd >= 0 ? to : r->in.bytes + r->at;
    r->at += n;
    return PBS_OK;
cut:
    return bad(r, err, "the file is cut off here");
}

static bool all_zero(const uint8_t *p, uint64_t n) {
    while (n--)
        if (*p++) return false;
    return true;
}

bool pbs_is_container(const uint8_t *b, size_t n) {
    /* The first four bytes; the rest tells whether it came through intact. */
    return n >= 4 && !memcmp(b, PBS_MAGIC, 4);
}

/* ---- header ---- */

static pbs_code check_fixed(pbs_reader *r, const uint8_t *h, pbs_err *err) {
    const char *name = r->in.name;
    if (all_zero(h, 8)) return pbs_fail(err, PBS_DATA, "%s: was never finished", name);
    if (!pbs_is_container(h, 8))
        return pbs_fail(err, PBS_DATA, "%s: not a pbs file (pbs-import reads scene files)", name);
    if (memcmp(h, PBS_MAGIC, 8))
        return pbs_fail(err, PBS_DATA, "%s: damaged by a transfer in text mode", name);
    unsigned major = pbs_get_u16(h + HEADER_MAJOR_AT);
    uint64_t incompat = pbs_get_u64(h + HEADER_INCOMPAT_AT);
    if (major > PBS_VERSION_MAJOR)
        return pbs_fail(err, PBS_DATA, "%s: version %u is newer than this program's %d", name,
                        major, PBS_VERSION_MAJOR);
    if (incompat)
        return pbs_fail(err, PBS_DATA, "%s: uses features (%#llx) that this program does not know",
                        name, (unsigned long long)incompat);
    r->header_bytes = pbs_get_u32(h + HEADER_BYTES_AT);
    if (r->header_bytes < HEADER_FIXED || r->header_bytes > PBS_HEADER_MAX ||
        r->header_bytes % PBS_ALIGN ||
        pbs_get_u32(h + HEADER_TEXT_AT) > r->header_bytes - HEADER_FIXED)
        return pbs_fail(err, PBS_DATA, "%s: the header is damaged", name);
    return PBS_OK;
}

/* "pbs KIND VERSION\n", then "channels ...\n", "stage ...\n" in any number. */
static pbs_code parse_text(pbs_reader *r, pbs_err *err) {
    char *history = r->history, *save = NULL;
    r->kind = PBS_KINDS;
    for (char *line = strtok_r(r->text, "\n", &save); line; line = strtok_r(NULL, "\n", &save)) {
        if (!strncmp(line, "pbs ", 4))
            for (int k = 0; k < PBS_KINDS; k++) {
                size_t n = strlen(pbs_kind_name[k]);
                if (!strncmp(line + 4, pbs_kind_name[k], n) && line[4 + n] == ' ')
                    r->kind = (pbs_kind)k;
            }
        else if (!strncmp(line, "channels ", 9))
            r->channels = line + 9;
        else
            history += sprintf(history, "%s\n", line);
    }
    if (r->kind == PBS_KINDS)
        return pbs_fail(err, PBS_DATA, "%s: a kind of pbs file that this program does not know",
                        r->in.name);
    return PBS_OK;
}

static pbs_code check_header(pbs_reader *r, uint8_t *h, pbs_err *err) {
    uint32_t crc = pbs_get_u32(h + HEADER_CRC_AT);
    pbs_put_u32(h + HEADER_CRC_AT, 0);
    size_t n = pbs_get_u32(h + HEADER_TEXT_AT), rest = (size_t)r->header_bytes - HEADER_FIXED;
    if (crc != pbs_crc32c(0, h, (size_t)r->header_bytes) || memchr(h + HEADER_FIXED, 0, n) ||
        !all_zero(h + HEADER_FIXED + n, rest - n))
        return pbs_fail(err, PBS_DATA, "%s: the header is damaged: its checksum differs",
                        r->in.name);
    if (!(r->text = strndup((char *)h + HEADER_FIXED, n)) || !(r->history = calloc(1, n + 2)))
        return pbs_fail(err, PBS_LIMIT, "no memory");
    return parse_text(r, err);
}

static pbs_code read_header(pbs_reader *r, pbs_err *err) {
    uint8_t fixed[HEADER_FIXED], *h;
    const uint8_t *p;
    size_t peeked;
    pbs_code rc = pbs_input_peek(&r->in, &p, &peeked, err);
    if (rc) return rc;
    if (!peeked) return pbs_fail(err, PBS_DATA, "%s: the file is empty", r->in.name);
    if (peeked < HEADER_FIXED && !pbs_is_container(p, peeked))
        return pbs_fail(err, PBS_DATA, "%s: not a pbs file", r->in.name);
    if ((rc = fetch(r, fixed, sizeof fixed, &p, err))) return rc;
    memcpy(fixed, p, sizeof fixed);
    if ((rc = check_fixed(r, fixed, err))) return rc;
    if (!(h = malloc((size_t)r->header_bytes + 1))) return pbs_fail(err, PBS_LIMIT, "no memory");
    memcpy(h, fixed, sizeof fixed);
    size_t rest = (size_t)r->header_bytes - sizeof fixed;
    rc = fetch(r, h + sizeof fixed, rest, &p, err);
    if (!rc && p != h + sizeof fixed) memcpy(h + sizeof fixed, p, rest);
    if (!rc) rc = check_header(r, h, err);
    free(h);
    return rc;
}

static pbs_code wrong_kind(const pbs_reader *r, uint32_t kinds, pbs_err *err) {
    char wanted[100] = "";
    for (int k = 0; k < PBS_KINDS; k++) {
        size_t n = strlen(wanted);
        if (kinds & PBS_KIND(k))
            snprintf(wanted + n, sizeof wanted - n, "%s%s", n ? " or " : "", pbs_kind_name[k]);
    }
    return pbs_fail(err, PBS_DATA, "%s: is a file of kind %s where %s is wanted", r->in.name,
                    pbs_kind_name[r->kind], wanted);
}

pbs_code pbs_reader_open(pbs_run *run, pbs_input *in, uint32_t kinds, pbs_reader **out,
                         pbs_err *err) {
    pbs_reader *r = *out = calloc(1, sizeof *r);
    if (!r) {
        pbs_input_close(in);
        return pbs_fail(err, PBS_LIMIT, "no memory");
    }
    r->run = run;
    r->in = *in;
    memset(in, 0, sizeof *in);
    in->fd = -1;
    pbs_code rc = read_header(r, err);
    if (!rc && !(kinds & PBS_KIND(r->kind))) rc = wrong_kind(r, kinds, err);
    if (!rc) return PBS_OK;
    pbs_reader_close(r);
    *out = NULL;
    return rc;
}

pbs_code pbs_reader_open_path(pbs_run *run, const char *path, uint32_t kinds, pbs_reader **out,
                              pbs_err *err) {
    pbs_input in;
    *out = NULL;
    pbs_code rc = pbs_input_open(run, path, &in, err);
    return rc ? rc : pbs_reader_open(run, &in, kinds, out, err);
}

/* ---- chunks ---- */

/* at: where a message says that the header ends. */
static pbs_code parse_chunk(const pbs_reader *r, uint64_t at, const uint8_t *h, pbs_chunk *c,
                            pbs_err *err) {
    if (pbs_crc32c(0, h, CHUNK_SELF_AT) != pbs_get_u32(h + CHUNK_SELF_AT))
        return bad_at(r, at, err, "a chunk's header is damaged: its checksum differs");
    c->tag = pbs_get_u32(h + CHUNK_TAG_AT);
    uint32_t flags = pbs_get_u32(h + CHUNK_FLAGS_AT), codec = flags & PBS_CODEC_MASK;
    c->flags = flags & ~PBS_CODEC_MASK;
    c->codec = (pbs_codec)codec;
    c->node = pbs_get_u32(h + CHUNK_NODE_AT);
    c->count = pbs_get_u32(h + CHUNK_COUNT_AT);
    c->stored = pbs_get_u64(h + CHUNK_BYTES_AT);
    c->bytes = pbs_get_u64(h + CHUNK_RAW_AT);
    c->crc = pbs_get_u32(h + CHUNK_CRC_AT);
    c->first = pbs_get_u32(h + CHUNK_FIRST_AT);
    char tag[5];
    if (c->stored > PBS_PAYLOAD_MAX || c->bytes > PBS_PAYLOAD_MAX)
        return bad_at(r, at, err, "a chunk is larger than the format allows");
    bool may = codec < PBS_CODECS && r->kind == PBS_ARCHIVE && pbs_codec_fits(c->tag);
    if (codec && !may)
        return pbs_fail(err, PBS_DATA, "%s: chunk %s: codec %u is not known", r->in.name,
                        pbs_tag_text(c->tag, tag), codec);
    if (codec ? !c->bytes : c->bytes != c->stored)
        return bad_at(r, at, err, "a chunk whose two sizes do not agree");
    return PBS_OK;
}

/* Bytes that the payload takes in the file, with the zeros behind it. */
static size_t stored_room(const pbs_chunk *c) {
    return (size_t)(c->stored + pbs_padding(c->stored, PBS_ALIGN));
}

/* p: the payload as it is stored, and the zeros behind it. */
static pbs_code take_payload(const pbs_reader *r, pbs_chunk *c, const uint8_t *p, pbs_err *err) {
    char tag[5];
    c->payload = c->stored ? p : NULL;
    if (pbs_crc32c(0, p, (size_t)c->stored) == c->crc &&
        all_zero(p + c->stored, stored_room(c) - c->stored))
        return PBS_OK;
    return pbs_fail(err, PBS_DATA, "%s: byte %llu: chunk %s is damaged: its checksum differs",
                    r->in.name, (unsigned long long)c->offset, pbs_tag_text(c->tag, tag));
}

/* Puts the unpacked payload to `to` in the place of the stored one. */
static pbs_code unpack(const pbs_reader *r, pbs_chunk *c, void *to, pbs_err *err) {
    char tag[5];
    pbs_code rc = pbs_codec_unpack(r->run, c->codec, c->tag, c->count, c->payload,
                                   (size_t)c->stored, to, (size_t)c->bytes, err);
    c->payload = to;
    return rc ? pbs_fail_in(err, "%s: byte %llu: chunk %s", r->in.name,
                            (unsigned long long)c->offset, pbs_tag_text(c->tag, tag))
              : PBS_OK;
}

/* Room for n bytes, of which none are kept. */
static pbs_code make_room(pbs_reader *r, uint8_t **buffer, size_t *cap, size_t n, pbs_err *err) {
    if (*buffer && n <= *cap) return PBS_OK;
    size_t room = *cap * 2 > n && *cap * 2 <= pbs_mem_left(r->run) / 8 ? *cap * 2 : n;
    pbs_free(r->run, *buffer);
    *buffer = NULL;
    *cap = 0;
    pbs_code rc = pbs_alloc(r->run, buffer, room, 1, "a chunk's buffer", err);
    if (!rc) *cap = room;
    return rc;
}

static pbs_code fetch_payload(pbs_reader *r, pbs_chunk *c, pbs_err *err) {
    const uint8_t *p;
    pbs_code rc = PBS_OK;
    if (r->in.fd >= 0) rc = make_room(r, &r->buffer, &r->buffer_cap, stored_room(c), err);
    if (!rc) rc = fetch(r, r->buffer, stored_room(c), &p, err);
    if (!rc) rc = take_payload(r, c, p, err);
    if (rc || !c->codec) return rc;
    rc = make_room(r, &r->unpacked, &r->unpacked_cap, (size_t)c->bytes, err);
    return rc ? rc : unpack(r, c, r->unpacked, err);
}

static pbs_code note_page(pbs_reader *r, const pbs_chunk *c, pbs_err *err) {
    if (!r->pages++)
        r->dir_at = c->offset;
    else if (c->offset != r->dir_end)
        return bad(r, err, "directory pages that are apart");
    r->dir_end = r->at;
    return PBS_OK;
}

static pbs_code check_footer(pbs_reader *r, const uint8_t *f, pbs_err *err) {
    if (pbs_crc32c(0, f, FOOTER_CRC_AT) != pbs_get_u32(f + FOOTER_CRC_AT))
        return bad(r, err, "the footer is damaged: its checksum differs");
    if (pbs_get_u64(f + FOOTER_CHUNKS_AT) != r->chunks ||
        pbs_get_u32(f + FOOTER_CHAIN_AT) != r->chain)
        return bad(r, err, "chunks are missing, doubled or changed");
    if (!r->pages || pbs_get_u64(f + FOOTER_DIR_AT) != r->dir_at ||
        pbs_get_u64(f + FOOTER_DIR_BYTES_AT) != r->dir_end - r->dir_at)
        return bad(r, err, "the directory is not where the footer says");
    if (pbs_get_u64(f + FOOTER_FILE_AT) != r->at) return bad(r, err, "the length is wrong");
    uint8_t one;
    size_t got = 0;
    if (r->in.mapped)
        got = r->in.size > r->at;
    else {
        pbs_code rc = pbs_input_read(&r->in, &one, 1, &got, err);
        if (rc) return rc;
    }
    if (got) return bad(r, err, "more bytes follow the end of the file");
    r->ended = true;
    return PBS_OK;
}

/* A footer is told from a chunk by its last eight bytes, which in a chunk header are a sequence
 * number and a checksum of everything before: they do not agree by chance. */
static bool is_footer(const uint8_t *h) {
    return !memcmp(h + FOOTER_MAGIC_AT, PBS_END, 8);
}

static pbs_code next_any(pbs_reader *r, pbs_chunk *c, bool *end, pbs_err *err) {
    uint8_t fixed[CHUNK_FIXED];
    const uint8_t *h;
    memset(c, 0, sizeof *c);
    c->offset = r->at;
    *end = r->ended;
    if (r->ended) return PBS_OK;
    pbs_code rc = fetch(r, fixed, sizeof fixed, &h, err);
    if (rc) return rc;
    if (is_footer(h)) {
        *end = true;
        return check_footer(r, h, err);
    }
    if ((rc = parse_chunk(r, r->at, h, c, err))) return rc;
    bool page = c->tag == PBS_TAG_DIR;
    if (pbs_get_u32(h + CHUNK_SEQUENCE_AT) != (uint32_t)(page ? r->pages : r->chunks))
        return bad(r, err, "a chunk is missing or doubled");
    if (!page) {
        r->chain = pbs_crc32c(r->chain, h, CHUNK_SELF_AT);
        r->chunks++;
    }
    rc = fetch_payload(r, c, err);
    return rc || !page ? rc : note_page(r, c, err);
}

/* What was read stays in the system's cache and comes back when it is touched again, but it does
 * not count as this program's memory. */
static void drop_behind(pbs_reader *r) {
    const uint64_t window = 16 << 20, page = 65536;
    if (!r->in.mapped || r->at < r->dropped + 2 * window) return;
    uint64_t to = (r->at - window) & ~(page - 1);
    madvise((void *)(r->in.bytes + r->dropped), (size_t)(to - r->dropped), MADV_DONTNEED);
    r->dropped = to;
}

pbs_code pbs_reader_next(pbs_reader *r, pbs_chunk *c, bool *end, pbs_err *err) {
    pbs_code rc;
    drop_behind(r);
    do {
        rc = pbs_run_check(r->run, err);
        if (!rc) rc = next_any(r, c, end, err);
    } while (!rc && !*end && c->tag == PBS_TAG_DIR);
    return rc;
}

/* ---- directory ---- */

static pbs_code read_page(pbs_reader *r, uint64_t page, uint64_t total, pbs_err *err) {
    pbs_chunk c;
    uint8_t fixed[CHUNK_FIXED];
    const uint8_t *h;
    c.offset = r->at;
    pbs_code rc = fetch(r, fixed, CHUNK_FIXED, &h, err);
    if (!rc) rc = parse_chunk(r, r->at, h, &c, err);
    if (!rc) rc = fetch_payload(r, &c, err);
    if (rc) return rc;
    const uint8_t *p = c.payload;
    if (c.tag != PBS_TAG_DIR || c.bytes < PAGE_FIXED || pbs_get_u32(p) != page ||
        pbs_get_u64(p + 8) != total || (c.bytes - PAGE_FIXED) / ENTRY_SIZE != c.count ||
        c.count > total - r->entry_count || (!c.count && total))
        return bad(r, err, "the directory is damaged");
    for (uint32_t i = 0; i < c.count; i++) {
        const uint8_t *e = p + PAGE_FIXED + (size_t)i * ENTRY_SIZE;
        uint32_t flags = pbs_get_u32(e + ENTRY_FLAGS_AT);
        r->entries[r->entry_count++] = (pbs_chunk){.tag = pbs_get_u32(e + ENTRY_TAG_AT),
                                                   .flags = flags & ~PBS_CODEC_MASK,
                                                   .codec = (pbs_codec)(flags & PBS_CODEC_MASK),
                                                   .node = pbs_get_u32(e + ENTRY_NODE_AT),
                                                   .count = pbs_get_u32(e + ENTRY_COUNT_AT),
                                                   .offset = pbs_get_u64(e + ENTRY_OFFSET_AT),
                                                   .bytes = pbs_get_u64(e + ENTRY_BYTES_AT),
                                                   .stored = pbs_get_u64(e + ENTRY_BYTES_AT),
                                                   .crc = pbs_get_u32(e + ENTRY_CRC_AT),
                                                   .first = pbs_get_u32(e + ENTRY_FIRST_AT)};
    }
    return PBS_OK;
}

static pbs_code read_directory(pbs_reader *r, pbs_err *err) {
    const uint8_t *f = r->in.bytes + r->in.size - FOOTER_FIXED;
    r->at = r->in.size;
    if (r->in.size < r->header_bytes + FOOTER_FIXED || !is_footer(f))
        return bad(r, err, "no footer here: the file is cut off, or more follows its end");
    if (pbs_crc32c(0, f, FOOTER_CRC_AT) != pbs_get_u32(f + FOOTER_CRC_AT))
        return bad(r, err, "the footer is damaged: its checksum differs");
    uint64_t dir = pbs_get_u64(f + FOOTER_DIR_AT), bytes = pbs_get_u64(f + FOOTER_DIR_BYTES_AT);
    uint64_t total = pbs_get_u64(f + FOOTER_CHUNKS_AT);
    if (pbs_get_u64(f + FOOTER_FILE_AT) != r->in.size || dir > r->in.size ||
        bytes > r->in.size - dir || total > bytes / ENTRY_SIZE)
        return bad(r, err, "the footer does not fit the file");
    pbs_code rc =
        pbs_alloc(r->run, &r->entries, (size_t)total, sizeof *r->entries, "the directory", err);
    r->at = dir;
    for (uint64_t page = 0; !rc && (r->entry_count < total || !page); page++)
        rc = read_page(r, page, total, err);
    return rc;
}

pbs_code pbs_reader_directory(pbs_reader *r, const pbs_chunk **entries, size_t *count,
                              pbs_err *err) {
    if (!r->in.mapped) return pbs_fail(err, PBS_INTERNAL, "%s: is not mapped", r->in.name);
    uint64_t at = r->at;
    if (!r->entries) {
        pbs_code rc = read_directory(r, err);
        r->at = at;
        if (rc) {
            pbs_free(r->run, r->entries);
            r->entries = NULL;
            r->entry_count = 0;
            return rc;
        }
    }
    *entries = r->entries;
    *count = r->entry_count;
    return PBS_OK;
}

const void *pbs_reader_peek(const pbs_reader *r, const pbs_chunk *e) {
    if (!r->in.mapped || e->offset % PBS_ALIGN || e->offset > r->in.size) return NULL;
    uint64_t left = r->in.size - e->offset;
    return left < CHUNK_FIXED || e->stored > left - CHUNK_FIXED || e->codec
               ? NULL
               : r->in.bytes + e->offset + CHUNK_FIXED;
}

pbs_code pbs_reader_look(const pbs_reader *r, const pbs_chunk *entry, pbs_chunk *c, pbs_err *err) {
    const pbs_input *in = &r->in;
    c->offset = entry->offset;
    if (!in->mapped) return pbs_fail(err, PBS_INTERNAL, "%s: is not mapped", in->name);
    if (entry->offset % PBS_ALIGN)
        return bad_at(r, entry->offset, err, "a chunk that is not aligned");
    if (entry->offset > in->size || in->size - entry->offset < CHUNK_FIXED)
        return bad_at(r, entry->offset, err, "the file is cut off here");
    uint64_t at = entry->offset + CHUNK_FIXED;
    pbs_code rc = parse_chunk(r, at, in->bytes + entry->offset, c, err);
    if (rc) return rc;
    if (c->tag != entry->tag || c->flags != entry->flags || c->node != entry->node ||
        c->count != entry->count || c->stored != entry->stored || c->crc != entry->crc ||
        c->first != entry->first || c->codec != entry->codec)
        return bad_at(r, at, err, "a chunk is not what the directory says");
    if (in->size - at < stored_room(c)) return bad_at(r, at, err, "the file is cut off here");
    c->payload = c->stored ? in->bytes + at : NULL;
    return PBS_OK;
}

pbs_code pbs_reader_at(const pbs_reader *r, const pbs_chunk *entry, pbs_chunk *c, pbs_err *err) {
    pbs_code rc = pbs_reader_look(r, entry, c, err);
    if (!rc && c->codec)
        rc = pbs_fail(err, PBS_INTERNAL, "%s: a chunk with a codec is read as if it had none",
                      r->in.name);
    return rc ? rc : take_payload(r, c, r->in.bytes + c->offset + CHUNK_FIXED, err);
}

pbs_code pbs_reader_load(const pbs_reader *r, const pbs_chunk *entry, pbs_chunk *c, void **own,
                         pbs_err *err) {
    *own = NULL;
    pbs_code rc = pbs_reader_look(r, entry, c, err);
    if (!rc) rc = take_payload(r, c, r->in.bytes + c->offset + CHUNK_FIXED, err);
    if (rc || !c->codec) return rc;
    rc = pbs_alloc(r->run, own, (size_t)c->bytes, 1, "an unpacked chunk", err);
    return rc ? rc : unpack(r, c, *own, err);
}

pbs_code pbs_reader_read(pbs_reader *r, const pbs_chunk *entry, pbs_chunk *c, pbs_err *err) {
    uint64_t at = r->at;
    pbs_code rc = pbs_reader_look(r, entry, c, err);
    r->at = entry->offset + CHUNK_FIXED;
    if (!rc) rc = fetch_payload(r, c, err);
    r->at = at;
    return rc;
}

pbs_kind pbs_reader_kind(const pbs_reader *r) {
    return r->kind;
}
const char *pbs_reader_name(const pbs_reader *r) {
    return r->in.name;
}
const char *pbs_reader_channels(const pbs_reader *r) {
    return r->channels ? r->channels : "";
}
const char *pbs_reader_history(const pbs_reader *r) {
    return r->history;
}
bool pbs_reader_mapped(const pbs_reader *r) {
    return r->in.mapped;
}
uint64_t pbs_reader_bytes(const pbs_reader *r) {
    return r->in.mapped ? r->in.size : r->at;
}

void pbs_reader_close(pbs_reader *r) {
    if (!r) return;
    pbs_input_close(&r->in);
    free(r->text);
    free(r->history);
    pbs_free(r->run, r->buffer);
    pbs_free(r->run, r->unpacked);
    pbs_free(r->run, r->entries);
    free(r);
}
