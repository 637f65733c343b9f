/* points.h: candidates and surfels as bytes: the PNTS chunk.
 *
 * A chunk holds `count` records of one node, from record `first` on, one after the other; what a
 * record holds is the header's channels line, in this order, without gaps:
 *
 *     streams   position:f32x3 [spacing:f32] [normal:i16x2] [colour:u8x4] [material:u8x4]
 * [emissive:u8x4] archives  position:u16x3 spacing:f16   [normal:i16x2] ...
 *
 * Records are whole, one after the other, so that the prefix of a node is one range of bytes.
 */
#ifndef PBS_FORMAT_POINTS_H
#define PBS_FORMAT_POINTS_H

#include "formats/container/container.h"
#include "libcore/data/quant.h"
#include "libcore/data/record.h"

typedef struct pbs_record {
    uint32_t channels; /* PBS_POSITION | ... */
    bool packed;       /* the archive's record */
    uint32_t stride;   /* bytes, a multiple of 4 */
} pbs_record;

pbs_record pbs_record_make(uint32_t channels, bool packed);
/* Byte offset of a channel in the record, or -1. */
int pbs_record_at(const pbs_record *r, uint32_t channel);
void pbs_record_text(const pbs_record *r, char out[256]);
/* Errors: PBS_DATA for channels this program does not know. place: the file. */
pbs_code pbs_record_parse(const char *place, const char *channels, pbs_record *out, pbs_err *err);

/* Arrays for count points of those channels; freed with pbs_points_free. */
pbs_code pbs_points_alloc(pbs_run *run, uint32_t channels, size_t count, pbs_points *out,
                          pbs_err *err);
/* Makes room for need points, keeping what is there. cap: the room so far, 0 at first. */
pbs_code pbs_points_grow(pbs_run *run, uint32_t channels, pbs_points *p, size_t *cap, size_t need,
                         pbs_err *err);
void pbs_points_free(pbs_run *run, pbs_points *p);

/* Writes all points of p as records number `at` on of the node, in chunks of at most `limit`
 * records. lattice: for packed records. */
pbs_code pbs_points_write(pbs_run *run, pbs_writer *w, const pbs_record *r, uint32_t node,
                          const pbs_points *p, size_t at, uint32_t limit,
                          const pbs_lattice *lattice, pbs_err *err);
/* The same under another tag, for records without positions too (octaves.h). */
pbs_code pbs_records_write(pbs_run *run, pbs_writer *w, uint32_t tag, const pbs_record *r,
                           uint32_t node, const pbs_points *p, size_t at, uint32_t limit,
                           const pbs_lattice *lattice, pbs_err *err);
#define PBS_POINTS_CHUNK  65536u     /* in streams */
#define PBS_ARCHIVE_CHUNK (1u << 20) /* in archives: a node of paper 1 is one chunk */

/* Chunks that pbs_points_write makes. */
static inline uint64_t pbs_points_chunks(uint64_t count, uint32_t limit) {
    return (count + limit - 1) / limit;
}

/* Whether a chunk (or its entry in the directory) has the size of its points and goes on after
 * `have` of them; to be asked before room is made. Errors: PBS_DATA. */
pbs_code pbs_points_fit(const char *place, const pbs_record *r, const pbs_chunk *chunk,
                        uint64_t have, pbs_err *err);

/* A record's channels that its point has not: white, rough, not metallic, dark, no normal. *to,
 * with room for a record; position and spacing are left alone. */
void pbs_points_blank(const pbs_record *r, uint8_t *to);

/* What is wrong with the values of points `first` on, or NULL: a position that is not finite, a
 * spacing that is no distance. */
const char *pbs_points_fault(const pbs_points *p, size_t first);

/* Appends a chunk's records to p, which has room for them. Errors: as pbs_points_fit. */
pbs_code pbs_points_read(const char *place, const pbs_record *r, const pbs_chunk *chunk,
                         pbs_points *p, const pbs_lattice *lattice, pbs_err *err);
#endif
