/* voxelset.h: generated voxels for the tests of coarser levels: closed shells and noise, any grid,
 * all channels, sorted along the Morton curve of the whole grid. */
#ifndef PBS_VOXELSET_H
#define PBS_VOXELSET_H

#include "libcore/voxels/grid.h"
#include "libcore/data/vec.h"
#include "libcore/voxels/voxel.h"
#include <math.h>
#include <stdlib.h>

typedef struct cell {
    uint64_t code; /* Morton, of the whole grid */
    uint32_t at[3];
    uint32_t mask; /* faces, PBS_VOXEL_TWO_SIDED */
    uint32_t normal, colour, material, emissive;
    float weight;
    uint32_t face[6]; /* of each face in the mask */
} cell;

typedef struct cells {
    cell *cell;
    size_t count, cap;
    uint32_t size;
} cells;

static inline uint32_t noise(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(*state >> 32);
}

static inline uint64_t morton64(const uint32_t at[3]) {
    uint64_t code = 0;
    for (int i = 0; i < 17; i++)
        for (int k = 0; k < 3; k++) code |= (uint64_t)(at[k] >> i & 1) << (3 * i + k);
    return code;
}

static inline cell *add_cell(cells *c, uint32_t x, uint32_t y, uint32_t z) {
    if (c->count == c->cap) {
        c->cap = c->cap ? 2 * c->cap : 1024;
        c->cell = realloc(c->cell, c->cap * sizeof *c->cell);
    }
    cell *v = &c->cell[c->count++];
    memset(v, 0, sizeof *v);
    v->at[0] = x, v->at[1] = y, v->at[2] = z;
    v->code = morton64(v->at);
    v->weight = 1;
    v->normal = 511u << 20;
    return v;
}

static inline int by_code(const void *a, const void *b) {
    uint64_t x = ((const cell *)a)->code, y = ((const cell *)b)->code;
    return (x > y) - (x < y);
}
static inline void sort_cells(cells *c) {
    qsort(c->cell, c->count, sizeof *c->cell, by_code);
}

/* Noise in every channel; faces of the border of a chunk are there, as they must. */
static inline void fill_cell(cell *v, const float n[3], uint64_t *seed) {
    v->normal = pbs_normal10_put(n);
    v->weight = 0.25f + (float)(noise(seed) >> 8) * 0x1p-24f;
    v->colour = noise(seed);
    v->material = noise(seed) & 0xffff;
    v->emissive = noise(seed) & 0xffffff;
    for (int k = 0; k < 3; k++) {
        if (n[k] < 0 || (v->at[k] & 255) == 0) v->mask |= 1u << 2 * k;
        if (n[k] > 0 || (v->at[k] & 255) == 255) v->mask |= 2u << 2 * k;
    }
    for (int f = 0; f < 6; f++) v->face[f] = noise(seed) % 5;
}

static inline bool in_ball(const uint32_t at[3], const int d[3], double middle, double r) {
    double s = 0;
    for (int k = 0; k < 3; k++) {
        double x = (double)at[k] + d[k] + 0.5 - middle;
        s += x * x;
    }
    return s <= r * r;
}

/* The cells inside of a ball that have a neighbour outside: a path through faces cannot cross. */
static inline cells shell(uint32_t size, double r, uint64_t seed) {
    cells out = {.size = size};
    const int none[3] = {0, 0, 0};
    double m = size / 2.0;
    for (uint32_t z = 0; z < size; z++)
        for (uint32_t y = 0; y < size; y++) {
            double dz = z + 0.5 - m, dy = y + 0.5 - m, h2 = r * r - dz * dz - dy * dy;
            if (h2 < 0) continue;
            uint32_t low = (uint32_t)fmax(0, m - sqrt(h2) - 2), high = (uint32_t)(m + sqrt(h2) + 2);
            for (uint32_t x = low; x < high && x < size; x++) {
                uint32_t at[3] = {x, y, z};
                bool border = false;
                if (!in_ball(at, none, m, r)) continue;
                for (int f = 0; f < 6 && !border; f++) {
                    int d[3] = {0, 0, 0};
                    d[f / 2] = f & 1 ? 1 : -1;
                    border = !in_ball(at, d, m, r);
                }
                if (!border) {
                    /* The middle of a row is inside; go on at its mirror image. */
                    uint32_t mirror = (uint32_t)(2 * m) - 1 - x;
                    if (mirror > x + 8) x = mirror - 8;
                    continue;
                }
                float n[3] = {(float)(x + 0.5 - m), (float)dy, (float)dz};
                fill_cell(add_cell(&out, x, y, z), n, &seed);
            }
        }
    sort_cells(&out);
    return out;
}

/* n cells anywhere, each once. */
static inline cells scatter(uint32_t size, size_t n, uint64_t seed) {
    cells out = {.size = size};
    for (size_t i = 0; i < n; i++) {
        cell *v = add_cell(&out, noise(&seed) % size, noise(&seed) % size, noise(&seed) % size);
        float d[3];
        for (int k = 0; k < 3; k++) d[k] = (float)((int)(noise(&seed) >> 8) - (1 << 23));
        fill_cell(v, d, &seed);
        if (noise(&seed) % 4 == 0) v->mask |= PBS_VOXEL_TWO_SIDED;
    }
    sort_cells(&out);
    size_t kept = 0;
    for (size_t i = 0; i < out.count; i++)
        if (!kept || out.cell[i].code != out.cell[kept - 1].code) out.cell[kept++] = out.cell[i];
    out.count = kept;
    return out;
}

/* Cells first .. first + n - 1 as arrays of these channels; malloc'ed. */
typedef struct cell_arrays {
    pbs_voxels v;
    uint32_t *faces;
    size_t face_count;
} cell_arrays;

static inline void *words(bool wanted, size_t n) {
    return wanted ? malloc(4 * n + 4) : NULL;
}

static inline cell_arrays arrays_of(const cell *c, size_t n, uint32_t channels) {
    cell_arrays a = {.v = {.count = n,
                           .place = words(true, n),
                           .normal = words(channels & PBS_NORMAL, n),
                           .weight = words(channels & PBS_WEIGHT, n),
                           .colour = words(channels & PBS_COLOUR, n),
                           .material = words(channels & PBS_MATERIAL, n),
                           .emissive = words(channels & PBS_EMISSIVE, n),
                           .face = words(channels & PBS_FACE, n)},
                     .faces = words(channels & PBS_FACE, 6 * n)};
    for (size_t i = 0; i < n; i++, c++) {
        a.v.place[i] = PBS_PLACE(c->at[0] & 255, c->at[1] & 255, c->at[2] & 255, c->mask);
        if (a.v.normal) a.v.normal[i] = c->normal;
        if (a.v.weight) a.v.weight[i] = c->weight;
        if (a.v.colour) a.v.colour[i] = c->colour;
        if (a.v.material) a.v.material[i] = c->material;
        if (a.v.emissive) a.v.emissive[i] = c->emissive;
        if (!a.v.face) continue;
        a.v.face[i] = (uint32_t)a.face_count;
        for (int f = 0; f < 6; f++)
            if (c->mask >> f & 1) a.faces[a.face_count++] = c->face[f];
    }
    return a;
}

static inline void free_arrays(cell_arrays *a) {
    free(a->v.place), free(a->v.normal), free(a->v.weight), free(a->v.colour);
    free(a->v.material), free(a->v.emissive), free(a->v.face), free(a->faces);
}

/* Where the run of cells ends that are in the chunk of cell number i. */
static inline size_t chunk_end(const cells *c, size_t i) {
    size_t k = i;
    while (k < c->count && c->cell[k].code >> 24 == c->cell[i].code >> 24) k++;
    return k;
}
static inline void chunk_of(const cell *v, uint32_t chunk[3]) {
    for (int k = 0; k < 3; k++) chunk[k] = v->at[k] >> 8;
}
#endif
