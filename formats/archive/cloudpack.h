/* cloudpack.h: point clouds become an archive, of any size and in bounded memory.
 *
 * The points of all clouds go onto one lattice (exactly, if the files have one), into the cells of
 * an octree (libcore/clouds/clod.h), get their levels, and are written as the archive's nodes:
 * coarse first, neighbours together. Points in between lie in a temporary file of 16 bytes a point.
 *
 * A node is a cube of 2^b steps, b at most 16, so that its positions are 16-bit numbers. It has the
 * points of the level whose spacing is 2^(b - 7) steps, about ten thousand of a surface; the
 * largest cubes have all coarser levels, too, in two nodes, and the leaves all finer ones. Its
 * points stay when those of its children are drawn (PBS_NODE_ADDS). In a node levels come one after
 * the other, and of each level every prefix is spread over the cube: its points in Morton order are
 * taken in the order of their rank with its bits reversed.
 */
#ifndef PBS_FORMAT_CLOUDPACK_H
#define PBS_FORMAT_CLOUDPACK_H

#include "formats/readers/cloud.h"
#include "formats/scene/node.h"
#include "formats/surfels/points.h"
#include "libcore/clouds/clod.h"

typedef struct pbs_cloudpack_stats {
    uint64_t points, left_out; /* in the archive; not finite */
    uint64_t equal;            /* at the place of another one */
    uint64_t nodes, cells, bytes;
    int levels;
    double root_spacing;
    double step, bound; /* of the lattice; how far a point can be moved: 0: not at all */
    pbs_record record;
} pbs_cloudpack_stats;

/* desc: path, kind, history and stage; the rest is filled in. Errors: PBS_DATA if there is no
 * point, or points are too far apart for numbers. */
pbs_code pbs_cloudpack(pbs_run *run, const pbs_cloud *clouds, size_t count,
                       const pbs_writer_desc *desc, pbs_cloudpack_stats *stats, pbs_err *err);

/* ---- the same in steps, for an archive that has more in it (pack.h) ---- */

typedef struct pbs_cloudpack_parts pbs_cloudpack_parts;

/* Everything up to the nodes; nothing is written. The clouds stay open until it is freed. */
pbs_code pbs_cloudpack_make(pbs_run *run, const pbs_cloud *clouds, size_t count,
                            pbs_cloudpack_parts **out, pbs_err *err);
void pbs_cloudpack_free(pbs_cloudpack_parts *p); /* NULL is fine */
uint32_t pbs_cloudpack_nodes(const pbs_cloudpack_parts *p);
pbs_node pbs_cloudpack_root(const pbs_cloudpack_parts *p); /* without children */
uint32_t pbs_cloudpack_channels(const pbs_cloudpack_parts *p);
uint64_t pbs_cloudpack_chunks(const pbs_cloudpack_parts *p); /* that will be written, nodes too */
/* All but `bytes`. */
void pbs_cloudpack_count(const pbs_cloudpack_parts *p, pbs_cloudpack_stats *stats);
/* Its nodes as number `first` on, children before parents, the root last; then, when all nodes of
 * the archive are there, its points, as records of at least its channels. */
pbs_code pbs_cloudpack_write_nodes(pbs_cloudpack_parts *p, pbs_writer *w, uint32_t first,
                                   pbs_err *err);
pbs_code pbs_cloudpack_write_points(pbs_cloudpack_parts *p, const pbs_record *record, pbs_err *err);

/* ---- what its files share ---- */

/* position = origin + step * q */
typedef struct pbs_cloud_lattice {
    double origin[3], step;
    int bits;  /* q below 2^bits */
    int shift; /* of the integers that the files' numbers become: q = integer >> shift */
    double bound;
} pbs_cloud_lattice;

/* Cubes of 2^16 steps that a cloud may fill and keep the lattice of its files: a cube costs some
 * 300 bytes of memory, as a cell, a node or two, and chunks of the archive. A cloud that fills
 * more, and one whose files have no lattice, gets a lattice on which it fills an eighth at most, or
 * a quarter if it is unlike what its shape promised. */
enum { PBS_CLOUD_CUBES = 1 << 19 };

typedef struct pbs_cloud_points {
    pbs_run *run;
    pbs_scratch raw;  /* pbs_clod_raw, then pbs_clod_point */
    pbs_scratch rest; /* what is left of cells */
    pbs_clod_cells cells;
    pbs_cloud_lattice lattice;
    uint64_t count, left_out;
    bool colours;
    uint32_t cubes; /* 0: PBS_CLOUD_CUBES */
    pbs_trim trim;
    size_t held; /* pages of files that count as its memory */
} pbs_cloud_points;

/* For clod.h: the points' room. */
pbs_clod_store pbs_cloud_store(pbs_cloud_points *p);

/* All points of the clouds, in the order of cells that are fine enough. Zeroed but for `cubes`;
 * free it also after an error. */
pbs_code pbs_cloud_take(pbs_run *run, const pbs_cloud *clouds, size_t count, pbs_cloud_points *p,
                        pbs_err *err);
void pbs_cloud_points_free(pbs_run *run, pbs_cloud_points *p);

/* A node to be. */
typedef struct pbs_cloud_node {
    uint64_t count;           /* its points */
    uint32_t first, end;      /* its cells */
    uint32_t child, children; /* in the order of the archive's points */
    uint32_t origin[3];
    int8_t bits;
    int8_t low, high; /* levels k of it */
} pbs_cloud_node;

typedef struct pbs_cloud_tree {
    const pbs_cloud_points *points;
    const pbs_clod_upper *upper;
    pbs_cloud_node *node; /* the root first, then level by level: the order of their points */
    size_t count, room;
} pbs_cloud_tree;

/* The cells' level counts become those of all levels. */
pbs_code pbs_cloud_tree_new(pbs_run *run, pbs_cloud_points *p, const pbs_clod_upper *u,
                            pbs_cloud_tree *t, pbs_err *err);
void pbs_cloud_tree_free(pbs_run *run, pbs_cloud_tree *t);
/* Node i as the archive has it, without children; its number is t->count - 1 - i. */
pbs_node pbs_cloud_tree_node(const pbs_cloud_tree *t, size_t i);
/* All points at one place: they are taken as they lie. */
static inline bool pbs_cloud_node_is_place(const pbs_cloud_node *n) {
    return n->bits == 0;
}
/* Its points, in their order; out and scratch have room for them. */
pbs_code pbs_cloud_tree_points(const pbs_cloud_tree *t, size_t i, pbs_clod_point *out,
                               pbs_clod_point *scratch, pbs_err *err);
#endif
