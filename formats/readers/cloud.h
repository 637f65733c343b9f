/* cloud.h: point clouds from foreign files: LAS, PLY, and text (XYZ, PTS, CSV).
 *
 * A cloud that is open is an array of points of known length that any thread may read any part
 * of, as often as it wants; what a file has as text was read once and lies as numbers in a
 * temporary file. So a program of bounded memory can look at all points first and take them later.
 *
 * Positions come as the file's own numbers: a LAS file has integers, and
 *
 *     position = offset + scale * value
 *
 * along each axis. All other formats have offset 0 and scale 1. Nothing is rounded.
 */
#ifndef PBS_FORMAT_CLOUD_H
#define PBS_FORMAT_CLOUD_H

#include "formats/container/file.h"
#include "formats/container/scratch.h"

/* What 16-bit colours mean. */
typedef enum pbs_cloud_colour {
    PBS_CLOUD_NO_COLOUR,
    PBS_CLOUD_COLOUR_8,  /* 0 .. 255 */
    PBS_CLOUD_COLOUR_16, /* 0 .. 65535 */
    PBS_CLOUD_COLOUR_ANY /* the file does not say; its largest number tells: above 255 it is 16 */
} pbs_cloud_colour;

typedef struct pbs_cloud pbs_cloud;
struct pbs_cloud {
    pbs_run *run;
    pbs_input in;  /* mapped */
    pbs_input own; /* what was text, as numbers */
    int fd;        /* of the one with the points; -1: they are read from the map */
    uint64_t count;
    double offset[3], scale[3]; /* finite; scale not 0 */
    bool lattice;               /* values are integers of 32 bits */
    pbs_cloud_colour colour;
    /* Values between these, says the file, which may be wrong; low[0] > high[0]: it says nothing.
     */
    double said_low[3], said_high[3];

    /* the reader's own */
    const uint8_t *first;
    size_t stride;
    void (*decode)(const pbs_cloud *c, const uint8_t *from, size_t n, double (*value)[3],
                   uint16_t (*colour)[3]);
    uint32_t at[6];  /* of x, y, z, red, green, blue in a record */
    uint8_t type[6]; /* pbs_ply_type */
    bool swap;
    float colour_scale; /* of text: colours times this are of 16 bits */
};

/* path NULL or "-": standard input. Pipes are spooled. Errors: PBS_DATA, with the file's name: not
 * a format that is read (LAZ, E57 and meshes each with what to do), damaged, cut off (with how many
 * points are there). */
pbs_code pbs_cloud_open(pbs_run *run, const char *path, pbs_cloud *c, pbs_err *err);
/* The same for an input that is open already; takes it over, also on error. */
pbs_code pbs_cloud_open_input(pbs_run *run, pbs_input *in, const char *path, pbs_cloud *c,
                              pbs_err *err);
void pbs_cloud_close(pbs_cloud *c);

/* Points first .. first + n - 1, which must be there. Values may be NaN or infinite. colour NULL,
 * or the cloud has none: not touched. Thread-safe. Errors: PBS_IO, with the file's name. */
pbs_code pbs_cloud_read(const pbs_cloud *c, uint64_t first, size_t n, double (*value)[3],
                        uint16_t (*colour)[3], pbs_err *err);

/* The same points as the file has them, stride bytes each: in room (of n * stride bytes), or where
 * they are mapped. Those of a lattice begin with x, y, z as int32_t, and have their colour at
 * at[3], as uint16_t. */
pbs_code pbs_cloud_records(const pbs_cloud *c, uint64_t first, size_t n, void *room,
                           const uint8_t **out, pbs_err *err);

/* The pages that points may be read from are let go by this. */
static inline void pbs_cloud_trim(const pbs_cloud *c, pbs_trim *t) {
    pbs_trim_add(t, c->in.bytes, (size_t)c->in.size);
    pbs_trim_add(t, c->own.bytes, (size_t)c->own.size);
}

/* ---- the readers, for pbs_cloud_open: c->in is mapped; errors without the file's name ---- */

pbs_code pbs_cloud_las(pbs_cloud *c, pbs_err *err);
pbs_code pbs_cloud_ply(pbs_cloud *c, pbs_err *err);
pbs_code pbs_cloud_text(pbs_cloud *c, pbs_err *err);

/* What text is spooled as. */
typedef struct pbs_cloud_row {
    double value[3];
    float colour[3];
    uint32_t unused;
} pbs_cloud_row;
/* Makes the rows the cloud's points; closes the spool. colour_most: the largest of all colours,
 * fraction: some is no integer. Colours up to 1 are shares; up to 255, 8 bits; else 16 bits. */
pbs_code pbs_cloud_rows(pbs_cloud *c, pbs_output *rows, bool colours, float colour_most,
                        bool fraction, pbs_err *err);
#endif
