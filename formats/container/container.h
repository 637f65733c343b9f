/* container.h: the one file format: header, chunks, directory, footer. pbs-container(5) specifies
 * it byte by byte; this is the code's side of that page.
 *
 * Every stage's stream and the final archive are such files. A writer that pipes puts the
 * directory at the end; pbs-flatten, which knows all its chunks before, puts it in front. A file
 * that was cut off has no footer and is an error, never a shorter file.
 */
#ifndef PBS_CONTAINER_H
#define PBS_CONTAINER_H

#include "formats/container/codec.h"
#include "formats/container/file.h"

#define PBS_VERSION_MAJOR 1 /* a reader refuses a newer one */
#define PBS_VERSION_MINOR 0 /* additions that an older reader can ignore */

#define PBS_ALIGN        64
#define PBS_HEADER_MAX   (1u << 20)
#define PBS_PAYLOAD_MAX  (64u << 20) /* so that every reader's buffer is bounded */
#define PBS_PAGE_ENTRIES 1024u       /* directory entries in one DIR chunk */

typedef enum pbs_kind {
    PBS_SCENE,
    PBS_CANDIDATES,
    PBS_SURFELS,
    PBS_VOXELS,
    PBS_ARCHIVE,
    PBS_KINDS
} pbs_kind;
extern const char *const pbs_kind_name[PBS_KINDS];
#define PBS_KIND(k) (1u << (k))

#define PBS_TAG(a, b, c, d)                                                                        \
    ((uint32_t)(a) | (uint32_t)(b) << 8 | (uint32_t)(c) << 16 | (uint32_t)(d) << 24)
#define PBS_TAG_DIR      PBS_TAG('D', 'I', 'R', ' ')
#define PBS_TAG_NODE     PBS_TAG('N', 'O', 'D', 'E') /* node.h */
#define PBS_TAG_MESH     PBS_TAG('M', 'E', 'S', 'H') /* scene.h */
#define PBS_TAG_MATERIAL PBS_TAG('M', 'A', 'T', 'L')
#define PBS_TAG_TEXTURE  PBS_TAG('T', 'E', 'X', 'R')
#define PBS_TAG_COUNTS   PBS_TAG('C', 'N', 'T', 'S')
#define PBS_TAG_POINTS   PBS_TAG('P', 'N', 'T', 'S') /* points.h */
/* "MESH" for messages and listings; out has 5 bytes; what is not printable becomes '?'. */
const char *pbs_tag_text(uint32_t tag, char out[5]);

typedef struct pbs_chunk {
    uint32_t tag, flags, node, count, first;
    pbs_codec codec; /* of the payload in the file; flags do not have it */
    uint64_t bytes;  /* of the payload; in a directory's entry, which does not know: as stored */
    uint64_t stored; /* of the payload in the file: the same without a codec */
    uint32_t crc;    /* of the payload in the file */
    uint64_t offset; /* of the chunk's header in the file */
    const void *payload; /* unpacked, aligned to PBS_ALIGN; NULL if there is none */
} pbs_chunk;

/* ---- writing ---- */

typedef struct pbs_writer pbs_writer;

typedef struct pbs_writer_desc {
    const char *path;   /* NULL or "-": standard output */
    pbs_output *output; /* instead of path: already open, the writer closes it */
    pbs_kind kind;
    const char *channels; /* "position:f32x3 normal:i16x2", "" for a scene that has none */
    const char *history;  /* provenance of the inputs, whole lines, or NULL */
    const char *stage;    /* this stage's line, without "stage " and newline */
    uint64_t front;  /* chunks that will be written; their directory goes in front. 0: behind */
    pbs_codec codec; /* of archives: data goes through it, where that makes it smaller */
} pbs_writer_desc;

pbs_code pbs_writer_open(pbs_run *run, const pbs_writer_desc *desc, pbs_writer **out, pbs_err *err);
/* chunk: tag, flags, node, count, first. The payload comes in up to `pieces` pieces. */
typedef struct pbs_piece {
    const void *bytes;
    size_t size;
} pbs_piece;
pbs_code pbs_writer_chunk(pbs_writer *w, const pbs_chunk *chunk, const pbs_piece *piece, int pieces,
                          pbs_err *err);
/* A chunk as a reader gave it, which has checked it: with that payload, and its checksum is not
 * made again, unless a codec is between them. Only tag, flags, node, count and first may have
 * changed. */
pbs_code pbs_writer_pass(pbs_writer *w, const pbs_chunk *chunk, pbs_err *err);
/* Directory, footer, and the file gets its name. */
pbs_code pbs_writer_commit(pbs_writer *w, pbs_err *err);
/* The same, but the whole stream comes back as a mapped input (a spool). */
pbs_code pbs_writer_reopen(pbs_writer *w, pbs_input *in, pbs_err *err);
uint64_t pbs_writer_bytes(const pbs_writer *w);
void pbs_writer_close(pbs_writer *w); /* always; without commit nothing is left. NULL is fine */

/* ---- reading ---- */

typedef struct pbs_reader pbs_reader;

/* Takes over *in, closes it also on error. kinds: sum of PBS_KIND that the caller understands.
 * The stream is read front to back with pbs_reader_next, from a pipe or a map. Errors: PBS_DATA,
 * each with its own text: not such a file, damaged by text mode, wrong kind, newer version,
 * unknown feature, cut off, damaged. */
pbs_code pbs_reader_open(pbs_run *run, pbs_input *in, uint32_t kinds, pbs_reader **out,
                         pbs_err *err);
/* The same from a path. */
pbs_code pbs_reader_open_path(pbs_run *run, const char *path, uint32_t kinds, pbs_reader **out,
                              pbs_err *err);
bool pbs_is_container(const uint8_t *bytes, size_t n);

/* The next chunk but directory pages, checked and unpacked; payload is valid until the next call
 * (in a map, and without a codec: until close, unless it came from pbs_input_open_both). *end: the
 * footer was reached and everything agrees. */
pbs_code pbs_reader_next(pbs_reader *r, pbs_chunk *chunk, bool *end, pbs_err *err);

/* Random access, mapped inputs only (pbs_input_map makes one of a pipe). entries is the whole
 * directory, in file order, without payloads; it belongs to the reader. */
pbs_code pbs_reader_directory(pbs_reader *r, const pbs_chunk **entries, size_t *count,
                              pbs_err *err);
/* The payload behind an entry as it lies in the map, without a look at it or its checksum: for its
 * first bytes, where the rest is not to be read. NULL if the file is too short, or no map, or there
 * is a codec. */
const void *pbs_reader_peek(const pbs_reader *r, const pbs_chunk *entry);
/* Reads and checks the chunk behind an entry, which has no codec (of data in archives:
 * pbs_reader_load). Thread-safe, as the next two are. */
pbs_code pbs_reader_at(const pbs_reader *r, const pbs_chunk *entry, pbs_chunk *chunk, pbs_err *err);
/* The same of any chunk, but as pbs_reader_next does it: one at a time, valid until the next call,
 * and read from the file where pbs_input_open_both left it open. */
pbs_code pbs_reader_read(pbs_reader *r, const pbs_chunk *entry, pbs_chunk *chunk, pbs_err *err);
/* The same of any chunk: *own is the unpacked payload, which the caller frees with pbs_free and the
 * reader's run, or NULL without a codec; also after an error. */
pbs_code pbs_reader_load(const pbs_reader *r, const pbs_chunk *entry, pbs_chunk *chunk, void **own,
                         pbs_err *err);
/* The same without a look at the payload, which is as it is stored: only the chunk's header is
 * checked, and that the file is long enough. For sizes, and for the first bytes of a payload, where
 * the rest is not to be read. */
pbs_code pbs_reader_look(const pbs_reader *r, const pbs_chunk *entry, pbs_chunk *chunk,
                         pbs_err *err);

pbs_kind pbs_reader_kind(const pbs_reader *r);
const char *pbs_reader_name(const pbs_reader *r);     /* for messages */
const char *pbs_reader_channels(const pbs_reader *r); /* as in pbs_writer_desc */
const char *pbs_reader_history(const pbs_reader *r);  /* the "stage" lines */
bool pbs_reader_mapped(const pbs_reader *r);
uint64_t pbs_reader_bytes(const pbs_reader *r); /* read so far; of a map: of the file */
void pbs_reader_close(pbs_reader *r);           /* NULL is fine */
#endif
