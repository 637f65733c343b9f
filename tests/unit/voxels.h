/* voxels.h: small voxel streams and archives for the tests, with all levels of detail, made by the
 * plainest means: cells of the finest level in Morton order, runs of equal parents joined. */
#ifndef PBS_TEST_VOXELS_H
#define PBS_TEST_VOXELS_H

#include "formats/archive/archive.h"
#include "formats/voxels/voxelstream.h"

typedef struct vox_cell {
    uint64_t code; /* Morton, 16 bits an axis */
    uint32_t faces;
    float normal[3], weight;
} vox_cell;

enum { VOX_LEVELS = 9, VOX_NODES = 4096 };

typedef struct vox_node {
    uint32_t level, first, count;
    uint64_t chunk; /* Morton */
    pbs_child child[8];
    uint32_t children, flags;
} vox_node;

typedef struct vox_model {
    pbs_grid grid;
    uint32_t levels, nodes;
    vox_cell *cell[VOX_LEVELS];
    uint32_t count[VOX_LEVELS];
    size_t cap;
    vox_node *node; /* all but the root, children first */
} vox_model;

static inline uint64_t vox_code(const uint32_t c[3]) {
    uint64_t low = pbs_morton8(PBS_PLACE(c[0] & 255, c[1] & 255, c[2] & 255, 0));
    return (uint64_t)pbs_morton8(PBS_PLACE(c[0] >> 8, c[1] >> 8, c[2] >> 8, 0)) << 24 | low;
}

static inline void vox_begin(vox_model *m, uint32_t size) {
    memset(m, 0, sizeof *m);
    m->grid = (pbs_grid){{-1, -1, -1}, 2.0 / size, size};
    m->levels = pbs_voxel_levels(size);
    m->node = malloc(VOX_NODES * sizeof *m->node);
}

static inline void vox_free(vox_model *m) {
    for (int i = 0; i < VOX_LEVELS; i++) free(m->cell[i]);
    free(m->node);
}

/* Cells of the finest level, in Morton order. */
static inline void vox_add(vox_model *m, const uint32_t c[3], uint32_t faces, const float n[3]) {
    if (m->count[0] == m->cap) {
        m->cap = m->cap ? 2 * m->cap : 64;
        m->cell[0] = realloc(m->cell[0], m->cap * sizeof *m->cell[0]);
    }
    m->cell[0][m->count[0]++] = (vox_cell){vox_code(c), faces, {n[0], n[1], n[2]}, 1};
}

static inline void vox_caps(vox_cell *c) {
    uint32_t p = pbs_unmorton8((uint32_t)c->code & 0xffffff);
    for (int k = 0; k < 3; k++) {
        uint32_t at = p >> 8 * k & 255;
        if (at == 0) c->faces |= 1u << 2 * k;
        if (at == 255) c->faces |= 2u << 2 * k;
    }
}

static inline void vox_join(vox_model *m, uint32_t level) {
    const vox_cell *from = m->cell[level - 1];
    vox_cell *to = m->cell[level] = malloc((m->count[level - 1] + 1) * sizeof *to);
    uint32_t n = 0;
    for (uint32_t i = 0; i < m->count[level - 1]; i++) {
        if (!n || to[n - 1].code != from[i].code >> 3)
            to[n++] = (vox_cell){.code = from[i].code >> 3};
        to[n - 1].faces |= from[i].faces;
        to[n - 1].weight += from[i].weight / 4;
        for (int k = 0; k < 3; k++) to[n - 1].normal[k] += from[i].normal[k];
    }
    m->count[level] = n;
}

static inline uint32_t vox_first(const vox_model *m, uint32_t level, uint64_t code) {
    uint32_t low = 0, high = m->count[level];
    while (low < high) {
        uint32_t mid = low + (high - low) / 2;
        if (m->cell[level][mid].code < code)
            low = mid + 1;
        else
            high = mid;
    }
    return low;
}

/* Number of the chunk's node, or PBS_NONE if it is empty. */
static inline uint32_t vox_list(vox_model *m, uint32_t level, uint64_t chunk) {
    vox_node n = {.level = level, .chunk = chunk, .first = vox_first(m, level, chunk << 24)};
    n.count = vox_first(m, level, (chunk + 1) << 24) - n.first;
    if (!n.count) return PBS_NONE;
    for (uint64_t o = 0; level && o < 8; o++) {
        pbs_child *c = &n.child[n.children];
        *c = (pbs_child){.node = vox_list(m, level - 1, chunk << 3 | o)};
        memcpy(c->m, PBS_IDENTITY, sizeof c->m);
        n.children += c->node != PBS_NONE;
    }
    m->node[m->nodes] = n;
    return m->nodes++;
}

static inline void vox_finish(vox_model *m) {
    for (uint32_t i = 0; i < m->count[0]; i++) vox_caps(&m->cell[0][i]);
    for (uint32_t l = 1; l <= m->levels; l++) {
        vox_join(m, l);
        for (uint32_t i = 0; i < m->count[l]; i++) vox_caps(&m->cell[l][i]);
    }
    vox_list(m, m->levels, 0);
}

/* ---- as bytes ---- */

static inline pbs_voxel_place vox_place(const vox_model *m, const vox_node *n) {
    uint32_t p = pbs_unmorton8((uint32_t)n->chunk);
    return (pbs_voxel_place){
        n->level, m->levels, m->grid.size, {p & 255, p >> 8 & 255, p >> 16 & 255}};
}

static inline void vox_write_data(pbs_run *run, const vox_model *m, uint32_t id, uint32_t channels,
                                  pbs_writer *w) {
    const vox_node *n = &m->node[id];
    pbs_err err = {0};
    pbs_voxels v;
    uint32_t *faces = malloc(6 * 4 * (size_t)n->count), face = 0;
    pbs_voxel_place place = vox_place(m, n);
    must(pbs_voxels_alloc(run, channels, n->count, &v, &err), &err);
    for (uint32_t i = 0; i < n->count; i++) {
        const vox_cell *c = &m->cell[n->level][n->first + i];
        v.place[i] = pbs_unmorton8((uint32_t)c->code & 0xffffff) | c->faces << 24;
        if (v.normal) v.normal[i] = pbs_normal10_put(c->normal);
        if (v.weight) v.weight[i] = c->weight;
        if (v.colour) v.colour[i] = 0xff3c78b4 + n->level * 0x300000;
        if (v.material) v.material[i] = 128 << 8;
        if (v.emissive) v.emissive[i] = 0;
        if (v.face) v.face[i] = face;
        for (uint32_t k = 0; k < (uint32_t)__builtin_popcount(c->faces & PBS_FACES_ALL); k++)
            faces[face++] = 0xff000000 + i + k;
    }
    must(pbs_voxels_write(w, id, &place, &v, 0, &err), &err);
    if (v.face) must(pbs_faces_write(w, id, true, faces, face, 0, &err), &err);
    pbs_voxels_free(run, &v);
    free(faces);
}

/* Chunks that vox_write_data writes. */
static inline uint64_t vox_data_chunks(const vox_model *m, uint32_t id, uint32_t channels) {
    const vox_node *n = &m->node[id];
    uint64_t faces = 0;
    for (uint32_t i = 0; channels & PBS_FACE && i < n->count; i++)
        faces +=
            (uint32_t)__builtin_popcount(m->cell[n->level][n->first + i].faces & PBS_FACES_ALL);
    return (n->count + PBS_VOXELS_CHUNK - 1) / PBS_VOXELS_CHUNK +
           (faces + PBS_VOXELS_CHUNK - 1) / PBS_VOXELS_CHUNK;
}

static inline void vox_write_node(pbs_run *run, const vox_model *m, uint32_t id, pbs_writer *w) {
    const vox_node *n = &m->node[id];
    pbs_err err = {0};
    pbs_voxel_place place = vox_place(m, n);
    uint8_t low[3] = {255, 255, 255}, high[3] = {0};
    for (uint32_t i = 0; i < n->count; i++) {
        uint32_t p = pbs_unmorton8((uint32_t)m->cell[n->level][n->first + i].code & 0xffffff);
        for (int k = 0; k < 3; k++) {
            uint8_t at = (uint8_t)(p >> 8 * k);
            low[k] = at < low[k] ? at : low[k], high[k] = at > high[k] ? at : high[k];
        }
    }
    pbs_node node = pbs_voxel_node(&m->grid, &place, id, n->count, low, high);
    node.children = (pbs_child *)n->child;
    node.child_count = n->children;
    node.flags = n->flags;
    must(pbs_node_write(run, w, &node, &err), &err);
}

static inline void vox_write_root(pbs_run *run, const vox_model *m, pbs_writer *w) {
    pbs_err err = {0};
    pbs_child child = {.node = m->nodes - 1};
    double size = m->grid.voxel * m->grid.size;
    memcpy(child.m, PBS_IDENTITY, sizeof child.m);
    pbs_node root = {.id = m->nodes,
                     .name = "model",
                     .box = {{m->grid.min[0], -1, -1}, {m->grid.min[0] + size, size - 1, size - 1}},
                     .child_count = 1,
                     .children = &child};
    must(pbs_node_write(run, w, &root, &err), &err);
}

/* archive: NODE chunks first, data coarse first. */
static inline void vox_write(pbs_run *run, const vox_model *m, uint32_t channels, bool archive,
                             pbs_writer *w) {
    for (uint32_t i = 0; i < m->nodes; i++) {
        if (!archive) vox_write_data(run, m, i, channels, w);
        vox_write_node(run, m, i, w);
    }
    vox_write_root(run, m, w);
    for (uint32_t i = m->nodes; archive && i--;) vox_write_data(run, m, i, channels, w);
}

/* ---- a sphere ---- */

/* All cells of an octant of the grid that the sphere of radius r, in units of half the grid, meets:
 * those with a corner inside and one outside. */
static inline void vox_octant(vox_model *m, const uint32_t at[3], uint32_t side, double r) {
    double near = 0, far = 0, middle[3];
    for (int k = 0; k < 3; k++) {
        double low = 2.0 * at[k] / m->grid.size - 1, high = low + 2.0 * side / m->grid.size;
        double d = fmax(0, fmax(low, -high)), e = fmax(fabs(low), fabs(high));
        near += d * d, far += e * e;
        middle[k] = (low + high) / 2;
    }
    if (near > r * r || far < r * r) return;
    if (side > 1) {
        for (uint32_t o = 0; o < 8; o++)
            vox_octant(m,
                       (uint32_t[3]){at[0] + (o & 1) * side / 2, at[1] + (o >> 1 & 1) * side / 2,
                                     at[2] + (o >> 2) * side / 2},
                       side / 2, r);
        return;
    }
    uint32_t faces = 0;
    float n[3];
    for (int k = 0; k < 3; k++) {
        faces |= (middle[k] < 0 ? 1u : 2u) << 2 * k;
        n[k] = (float)(middle[k] / r);
    }
    vox_add(m, at, faces, n);
}

/* size: a power of two. */
static inline void vox_sphere(vox_model *m, uint32_t size) {
    vox_begin(m, size);
    vox_octant(m, (uint32_t[3]){0, 0, 0}, size, 0.96);
    vox_finish(m);
}

/* A handful of voxels in three chunks and one above them. */
static inline void vox_small(vox_model *m) {
    static const uint32_t at[5][3] = {
        {0, 1, 2}, {255, 255, 255}, {256, 0, 0}, {256, 1, 0}, {256, 256, 256}};
    vox_begin(m, 512);
    for (int i = 0; i < 5; i++)
        vox_add(m, at[i], 1u << i | (i == 3) << 6, (float[3]){0, (float)i, 1});
    vox_finish(m);
}
#endif
