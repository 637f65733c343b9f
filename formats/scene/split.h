/* split.h: a huge part becomes a tree of parts: paper 1, section 3.1. An octree over the middles of
 * the triangles; leaves hold at most `limit` of them, and small leaves of one cell are put
 * together. Everything stays relative to the origin of the part, so that a corner that two leaves
 * share has the same bits in both. Out of core: the triangles are sorted by leaf in a pbs_scratch.
 */
#ifndef PBS_SPLIT_H
#define PBS_SPLIT_H

#include "formats/scene/meshlist.h"

/* The triangles of a leaf, in the order of the part. */
typedef struct pbs_leaf {
    const uint8_t *bytes;
    uint64_t count;
    uint32_t corners; /* what they carry: PBS_CORNER_* */
    size_t stride;
    const pbs_trim *trim;
} pbs_leaf;

typedef struct pbs_split {
    pbs_run *run;
    uint64_t limit;   /* triangles of a leaf; at least 1 */
    uint32_t corners; /* PBS_CORNER_*, as the builder that made the meshes was told */
    void *ctx;
    /* Leaves, and cells of two nodes or more, children first. whole: this cell is the part. */
    pbs_code (*leaf)(void *ctx, const pbs_leaf *leaf, uint32_t *node, pbs_err *err);
    pbs_code (*cell)(void *ctx, const uint32_t *child, size_t n, bool whole, uint32_t *node,
                     pbs_err *err);
} pbs_split;

/* Splits a part of more than `limit` triangles and empties the list before the first leaf comes.
 * *done false: it cannot be split, because all triangles have the same middle; the list is as it
 * was. Errors: PBS_IO, PBS_LIMIT, and those of leaf and cell. */
pbs_code pbs_split_part(const pbs_split *s, pbs_meshlist *part, bool *done, uint32_t *node,
                        pbs_err *err);
/* Triangle i of a leaf. */
void pbs_leaf_get(const pbs_leaf *leaf, uint64_t i, pbs_vertex v[3], uint32_t *material);
#endif
