/* node.h: what the file says of a node: the NODE chunk, the same in every kind of file.
 *
 * Nodes form a DAG. A node's own data (meshes, candidates, surfels) and its children come before
 * it in a stream, so ids rise from the leaves to the root, which is the last node.
 */
#ifndef PBS_NODE_H
#define PBS_NODE_H

#include "formats/container/container.h"
#include "formats/readers/sink.h"

typedef struct pbs_node {
    uint32_t id;
    const char *name;   /* UTF-8, "" for none */
    double origin[3];   /* positions of the node's data are relative to it */
    pbs_box box;        /* in the node's coordinates, origin included; empty: nothing in it */
    uint64_t triangles; /* of the node and everything below, instances counted each time */
    uint64_t records;   /* of the node's own data: triangles, candidates or surfels */
    uint32_t wanted;    /* surfels that should be chosen from its candidates; 0: not said */
    uint32_t flags;     /* PBS_NODE_BELOW | ... */
    double pixel;       /* side of the pixels that its candidates come from; 0: unknown */
    double covering;    /* covering radius of its surfels; 0: not sampled */
    double median;      /* median distance to the nearest neighbour among the first median_count */
    uint32_t median_count; /* surfels: r_m and p_m of paper 1, section 4.1; 0: not sampled */
    double lattice_min[3], lattice; /* quantised positions: min + lattice * integer, relative to
                                       origin; lattice 0: positions are floats */
    uint32_t child_count;
    pbs_child *children;
} pbs_node;

enum {
    /* Candidates: what is fine enough below the node is missing among them, since surfels that come
     * before it in the stream show it (hierarchy.h). */
    PBS_NODE_BELOW = 1 << 8,
    PBS_NODE_USED = 1 << 9,     /* candidates: a node that follows needs the surfels of this one */
    PBS_NODE_CORNERS = 1 << 10, /* candidates: directions they are seen from */
    PBS_NODE_FACES = 1 << 11,
    /* Archives: its points stay when those of its children are drawn (cloudpack.h). */
    PBS_NODE_ADDS = 1 << 12
};

/* Writes the node as a chunk. Errors: PBS_LIMIT if it has millions of children. */
pbs_code pbs_node_write(pbs_run *run, pbs_writer *w, const pbs_node *node, pbs_err *err);

/* name and children are allocated with pbs_alloc(run): give them back with pbs_node_free. expect:
 * the id it must have, since ids count up. Everything is checked: children below the node, numbers
 * finite. place is the file's name for messages. */
pbs_code pbs_node_read(pbs_run *run, const char *place, const pbs_chunk *chunk, uint32_t expect,
                       pbs_node *out, pbs_err *err);
void pbs_node_free(pbs_run *run, pbs_node *node);

/* The transform of a placing: pose[i] is that of motion number i, which has i + 1 in its placings.
 * pose NULL: everything rests. */
static inline const double *pbs_pose_of(const double (*pose)[12], const pbs_child *child) {
    return pose && child->motion ? pose[child->motion - 1] : child->m;
}
#endif
