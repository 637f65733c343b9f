/* cluster.h: the triangles of a mesh in clusters that lie together, under a tree of boxes, so that
 * those near a block of cells are found without looking at all of them.
 *
 * Triangles are sorted along a Morton curve through their middles; cluster i holds the triangles
 * order[64 i] .. order[64 i + 63]. Eight clusters have a box above them, eight of these another,
 * up to one. Nothing is copied: 4.5 bytes a triangle, and 64 bytes for a mesh of one cluster.
 */
#ifndef PBS_CLUSTER_H
#define PBS_CLUSTER_H

#include "libcore/data/mesh.h"
#include "libcore/ground/run.h"

#define PBS_CLUSTER        64
#define PBS_CLUSTER_LEVELS 6 /* 64 * 8^5 are more than PBS_MESH_TRIANGLES */

typedef struct pbs_clusters {
    uint32_t triangles;
    int levels;                         /* 0: the mesh has no triangles */
    uint32_t count[PBS_CLUSTER_LEVELS]; /* boxes of each level; level 0: clusters; the last: 1 */
    const float (*box[PBS_CLUSTER_LEVELS])[6]; /* least x y z, largest x y z, in part coordinates */
    const uint32_t *order;                     /* a permutation of the mesh's triangles */
} pbs_clusters;

/* Bytes that a mesh of so many triangles takes, a multiple of 64. */
size_t pbs_clusters_bytes(uint32_t triangles);

/* memory: pbs_clusters_bytes of them, aligned to 4, which *out points into. Errors: PBS_LIMIT for
 * the scratch memory of sorting, 16 bytes a triangle. */
pbs_code pbs_clusters_make(pbs_run *run, const pbs_mesh *mesh, void *memory, pbs_clusters *out,
                           pbs_err *err);

/* The triangles below box i of a level: order[*first .. *first + the result - 1]. */
static inline uint32_t pbs_clusters_below(const pbs_clusters *c, int level, uint32_t i,
                                          uint32_t *first) {
    uint32_t each = (uint32_t)PBS_CLUSTER << 3 * level;
    *first = i * each;
    return c->triangles - *first < each ? c->triangles - *first : each;
}
#endif
