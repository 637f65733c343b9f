/* export.h: points and voxels of a file for other people's programs: PLY and GLB.
 *
 * Which nodes are taken. A node with surfels or voxels stands for everything below it, so that each
 * path from the root down gives one of its nodes (and what an animation moves, which is in no node
 * above). Points of clouds add to those above them: all nodes are taken. How far down it goes:
 *
 *     spacing S   down to nodes whose covering radius is at most S, where everything below has
 *                 surfels, too; of voxels the finest level of cells whose side is at least S. Then
 *                 points whose own spacing is below S are left out. S = 0: everything, the finest.
 *     count N     the smallest spacing that leaves at most N points; of those that are next, if
 *                 their spacings are equal, as in clouds, each node gives its share.
 *     prefix N    the coarsest nodes; of each the first N points.
 *     level L     voxels of level L; 0 is the finest.
 *
 * Instances are written out, each at its place. Nothing is kept in memory but the nodes: the file
 * is walked once or more to choose, once to measure, and once to write.
 */
#ifndef PBS_EXPORT_H
#define PBS_EXPORT_H

#include "formats/scene/node.h"
#include "formats/surfels/points.h"
#include "formats/container/scratch.h"
#include "formats/voxels/voxels.h"

typedef enum pbs_export_format { PBS_EXPORT_PLY, PBS_EXPORT_GLB } pbs_export_format;
typedef enum pbs_export_positions {
    PBS_EXPORT_AUTO, /* float where that loses nothing */
    PBS_EXPORT_FLOAT,
    PBS_EXPORT_DOUBLE
} pbs_export_positions;

typedef struct pbs_export_options {
    pbs_export_format format;
    pbs_export_positions positions; /* of PLY */
    double spacing;                 /* 0: everything */
    uint64_t prefix, count;         /* 0: not wanted */
    int level;                      /* of voxels; -1: not wanted */
    int64_t node;                   /* the top, in its own coordinates; -1: the root */
    bool faces;                     /* voxels as their faces, and no points; where faces have
                                       colours or materials, in those */
    bool radius;                    /* the spacing of each point, too */
    bool z_up;                      /* GLB: the input's z becomes y */
    const char *input, *output, *stage;
} pbs_export_options;

typedef struct pbs_exported {
    uint64_t points, voxels; /* written */
    uint64_t left_out;       /* points that are not voxels, with `faces` */
    uint64_t vertices, faces, nodes, bytes;
    double spacing; /* what was chosen: of `count`; else what was said */
    bool doubles;
} pbs_exported;

/* Input: an archive, surfels or voxels. Errors: PBS_DATA; PBS_USAGE if the file has not what an
 * option is about; PBS_LIMIT for a GLB of 4 GiB or a PLY of 2^31 corners of faces. */
pbs_code pbs_export(pbs_run *run, const pbs_export_options *o, pbs_exported *out, pbs_err *err);

/* ---- what its files share ---- */

/* How many of a node's points a spacing takes. */
typedef struct pbs_export_tally {
    uint64_t above, equal; /* points with a larger spacing, with exactly this; voxels are above */
    double next;           /* the largest spacing that is smaller; 0: none */
    double least;          /* the smallest that is not; infinite: none */
} pbs_export_tally;

/* A node's own data. */
typedef struct pbs_export_data {
    size_t first; /* its chunks in the directory, from here on; there may be others in between */
    size_t first_face; /* likewise its faces' attributes */
    uint32_t chunks, tag, face_chunks;
    int level;         /* of voxels */
    bool below;        /* there is something in it or below it */
    bool moving;       /* below it something moves */
    bool complete;     /* all that is in it or below it has points */
    double tallied[2]; /* what `tally` is of: spacing and scale of the placing; spacing -1: none */
    pbs_export_tally tally;
} pbs_export_data;

/* Points or corners of faces on their way out; everything but position may be NULL. */
typedef struct pbs_export_block {
    size_t count;
    double (*position)[3];
    float (*normal)[3]; /* unit; zero: none */
    uint8_t (*colour)[4];
    float *radius;
    uint64_t records; /* that they come from */
    bool voxels;
    double grain; /* what a rounding of positions must be small against */
} pbs_export_block;

typedef struct pbs_exporter {
    pbs_run *run;
    const pbs_export_options *o;
    pbs_reader *reader;
    const char *name;
    const pbs_chunk *entries;
    size_t entry_count;
    pbs_trim trim;
    pbs_record record; /* stride 0: no points in it */
    uint32_t voxels;   /* channels; 0: no voxels in it */
    uint32_t channels; /* that are written: PBS_NORMAL, PBS_COLOUR, PBS_SPACING */
    pbs_node *node;
    size_t count;
    uint32_t top;
    pbs_export_data *data;
    /* What is chosen: points with at least this spacing; but if `equal` is not 0, so many have
     * exactly it, and `share` of them are taken. seen: of those, so far. */
    double spacing;
    uint64_t share, equal, seen;
    uint64_t left_out; /* points, where only faces are written */
    uint32_t *palette; /* colours of materials, as those of voxels */
    size_t palette_count;
    uint32_t *face; /* colours of the faces of the node that is read */
    size_t face_count, face_cap;
    /* Working memory of the reading. */
    pbs_export_block block;
    pbs_points points; /* a window of them */
} pbs_exporter;

/* Zeroed by = {0} before; to be closed also after an error. */
pbs_code pbs_export_open(pbs_exporter *x, pbs_err *err);
void pbs_export_close(pbs_exporter *x);

/* Calls take for every placing that is chosen, parents first. scale: by which the placing makes
 * lengths larger. */
typedef pbs_code (*pbs_export_placing_fn)(void *ctx, uint32_t node, const double m[12],
                                          double scale, pbs_err *err);
pbs_code pbs_export_walk(pbs_exporter *x, pbs_export_placing_fn take, void *ctx, pbs_err *err);

/* The spacing that a record says; p: where it is in the record. In the node's own unit. */
double pbs_export_spacing(const pbs_exporter *x, uint32_t node, const uint8_t *p);

/* Finds spacing and share. */
pbs_code pbs_export_choose(pbs_exporter *x, pbs_err *err);
/* Errors: PBS_LIMIT if what is chosen is certainly too much for a GLB. */
pbs_code pbs_export_fits(pbs_exporter *x, pbs_err *err);
pbs_code pbs_export_tally_of(pbs_exporter *x, uint32_t node, double scale, pbs_export_tally *out,
                             pbs_err *err);

/* Chunk number i of a node's data (0: from the beginning on); *at is the caller's place in the
 * directory, kept from call to call. */
pbs_code pbs_export_chunk(pbs_exporter *x, uint32_t node, uint32_t i, size_t *at, pbs_chunk *c,
                          pbs_err *err);

/* The materials, once; the colours of a node's faces: none, where they have no attributes. */
pbs_code pbs_export_palette(pbs_exporter *x, pbs_err *err);
pbs_code pbs_export_faces(pbs_exporter *x, uint32_t node, pbs_err *err);

/* Everything that is chosen, block by block, always the same. */
typedef pbs_code (*pbs_export_block_fn)(void *ctx, const pbs_export_block *b, pbs_err *err);
pbs_code pbs_export_each(pbs_exporter *x, pbs_export_block_fn take, void *ctx, pbs_err *err);

/* What is known before the first byte. */
typedef struct pbs_export_measures {
    pbs_box box;
    uint64_t vertices, faces, points, voxels;
    double grain; /* the least of all */
    bool exact;   /* all positions are floats */
} pbs_export_measures;

typedef struct pbs_export_writer {
    pbs_exporter *x;
    const pbs_export_measures *m;
    pbs_output out;
    uint8_t *bytes; /* room for a block's vertices */
    bool doubles;
    double origin[3]; /* of GLB */
    uint32_t stride;
} pbs_export_writer;

pbs_code pbs_export_ply(pbs_export_writer *w, pbs_err *err);
pbs_code pbs_export_glb(pbs_export_writer *w, pbs_err *err);

enum {
    PBS_EXPORT_STRIDE = 24 + 12 + 8 + 4, /* bytes of a vertex at most */
    PBS_EXPORT_WINDOW = 4096,            /* points of a block at most */
    PBS_EXPORT_ROOM = 24 * 512           /* corners of 512 voxels; and those */
};
#endif
