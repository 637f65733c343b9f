/* blocks_inner.h: what the parts of the walk over blocks share: where things are in the grid. */
#ifndef PBS_BLOCKS_INNER_H
#define PBS_BLOCKS_INNER_H

#include "formats/voxels/blocks.h"
#include "formats/scene/bounds.h"
#include "formats/scene/pages.h"

enum {
    WALK_DEPTH = 12, /* levels of the octree: 2^11 blocks are more than the largest grid has */
    WALK_NODE = 255  /* level of an entry that is a node */
};

/* What touches a cell of the octree. */
typedef struct walk_entry {
    uint32_t id;                /* a node, or a mesh */
    uint32_t place;             /* where: its transform */
    uint8_t level;              /* WALK_NODE, or a level of the mesh's clusters */
    uint8_t span;               /* its box is at most 2^span cells wide */
    uint16_t box;               /* of that level */
    uint16_t first[3], last[3]; /* blocks that it touches */
} walk_entry;

/* A cell of the octree that the walk is in. */
typedef struct walk_frame {
    uint32_t at[3], side; /* in blocks */
    uint32_t child;       /* that comes next */
    size_t begin, end;    /* its list */
    size_t places;        /* transforms before its own */
} walk_frame;

struct pbs_blocks {
    pbs_run *run;
    const pbs_scene *s;
    pbs_grid grid;
    double per_voxel, slack[3]; /* 1 / voxel; what rounding to the grid can add, in voxels */
    uint32_t across;            /* blocks along an axis */
    pbs_scratch store;
    pbs_clusters *clusters; /* of each mesh, in the store */
    pbs_bound *bound;       /* of each node */
    uint8_t *sides;         /* pbs_sides of each mesh */
    pbs_blocks_stats stats;
    pbs_pages pages;

    walk_frame frame[WALK_DEPTH];
    int depth; /* -1: in none */
    bool begun;
    walk_entry *list; /* a stack of lists, the innermost cell's last */
    size_t list_most; /* entries in one of them */
    double (*place)[12];
    size_t places, places_most;
};

struct pbs_nearby {
    pbs_blocks *b;
    uint32_t at[3]; /* in blocks */
    size_t count;
    const walk_entry *entry; /* behind this struct, as are their transforms */
    const double (*place)[12];
};

/* In voxels, and padded: by the transform (bounds.h), by what the scale and the rounding to the
 * grid can add (grid.h). */
static inline pbs_box walk_in_grid(const pbs_blocks *b, const pbs_box *box) {
    pbs_box out;
    for (int k = 0; k < 3; k++) {
        out.min[k] = (box->min[k] - b->grid.min[k]) * b->per_voxel - b->slack[k];
        out.max[k] = (box->max[k] - b->grid.min[k]) * b->per_voxel + b->slack[k];
    }
    return out;
}

static inline pbs_box walk_node_box(const pbs_blocks *b, uint32_t node, const double m[12]) {
    pbs_box box = pbs_bound_placed(&b->bound[node], m);
    return walk_in_grid(b, &box);
}

/* A mesh in the grid. Its pad is that of the whole mesh, for each of its boxes. */
typedef struct walk_mesh {
    const pbs_clusters *clusters;
    double m[12], pad[3];
} walk_mesh;

static inline walk_mesh walk_mesh_at(const pbs_blocks *b, uint32_t mesh, const double m[12]) {
    walk_mesh w = {.clusters = &b->clusters[mesh]};
    const float *box = w.clusters->box[w.clusters->levels - 1][0];
    for (int r = 0; r < 3; r++) {
        double reach = fabs(m[4 * r + 3]);
        for (int c = 0; c < 3; c++) {
            float a = fabsf(box[c]), z = fabsf(box[c + 3]);
            w.m[4 * r + c] = m[4 * r + c] * b->per_voxel;
            reach += fabs(m[4 * r + c]) * (a > z ? a : z);
        }
        w.m[4 * r + 3] = (m[4 * r + 3] - b->grid.min[r]) * b->per_voxel;
        w.pad[r] = (2 * 0x1p-48 * reach + 0x1p-1020) * b->per_voxel + b->slack[r];
    }
    return w;
}

static inline pbs_box walk_mesh_box(const walk_mesh *w, int level, uint32_t i) {
    const float *box = w->clusters->box[level][i];
    pbs_box out;
    for (int r = 0; r < 3; r++) {
        double middle = w->m[4 * r + 3], half = w->pad[r];
        for (int c = 0; c < 3; c++) {
            double low = box[c], high = box[c + 3];
            middle += w->m[4 * r + c] * ((low + high) / 2);
            half += fabs(w->m[4 * r + c]) * ((high - low) / 2);
        }
        out.min[r] = middle - half;
        out.max[r] = middle + half;
    }
    return out;
}

/* A NaN coordinate is no place, so nothing below is anywhere. */
static inline bool walk_is_nowhere(const double m[12]) {
    for (int i = 0; i < 12; i++)
        if (isnan(m[i])) return true;
    return false;
}

/* Most parts are one mesh: there is no need to open them. */
static inline bool walk_is_mesh(const pbs_scene *s, uint32_t node) {
    return !s->nodes[node].child_count && s->first_mesh[node + 1] == s->first_mesh[node] + 1;
}

pbs_code walk_begin(pbs_blocks *b, size_t memory, pbs_err *err);

/* Whether some triangle of a cluster may touch a cell of the octree, and the layer of one cell of
 * the grid around it. */
bool walk_cluster_touches(pbs_blocks *b, const walk_entry *e, const uint32_t at[3], uint32_t side);
#endif
