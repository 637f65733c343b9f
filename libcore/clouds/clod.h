/* clod.h: a point cloud as a continuous level of detail (paper 3, sections 3.1 and 3.2), cell by
 * cell, for clouds of any size.
 *
 * Positions are integers on one lattice. The spacing of a level is 2^k steps of it, and k falls by
 * one from level to level: with top = the largest k of the cloud, level l has k = top - l. No two
 * points of levels up to l are closer than the spacing of l, wherever they are in the cloud; every
 * point is in exactly one level. Of points at one place all but one are in the last level, k = -1,
 * which has no spacing. Positions stay what they are; the colour of a point becomes the mean over
 * the area that it stands for, in linear light. (beyond: the paper takes a converter's levels,
 * which keep their distance inside a cell only.)
 *
 * How: space is cut into an octree of cells with few points each. Cells are thinned on their own
 * (thin.h), from fine to coarse, up to an eighth of their size; what they decide near their border
 * is fixed for the neighbours that come later. Cells of equal size and equal parity of their place
 * never touch and can be worked on at a time; the order of these groups, and so the result, does
 * not depend on threads or memory. What is left of all cells, usually less than a hundredth, is
 * thinned further level by level, in cubes of at most PBS_CLOD_PIECE points. So memory grows with
 * the number of cells alone, by 140 bytes each.
 */
#ifndef PBS_CLOD_H
#define PBS_CLOD_H

#include "libcore/ground/run.h"
#include "libcore/clouds/thin.h"

enum {
    PBS_CLOD_CELL = 65535, /* points of a cell at most, but if all are at one place */
    PBS_CLOD_SIDE = 16,    /* a cell's side is at most 2^16 steps */
    PBS_CLOD_BITS = 31,    /* that of the whole cloud at most 2^31 */
    PBS_CLOD_DEPTH = 7,    /* of a grid of cells at most */
    PBS_CLOD_KEEP = 3,     /* a cell is thinned up to 2^-3 of its side */
    PBS_CLOD_LEVELS = 29   /* k = 0 .. 28, an eighth of 2^31 */
};

/* A point as it comes in. */
typedef struct pbs_clod_raw {
    uint32_t q[3];
    uint8_t colour[4]; /* sRGB; the fourth is carried along */
} pbs_clod_raw;

/* A point as it comes out: the archive's record, relative to its cell. */
typedef struct pbs_clod_point {
    uint16_t q[3];
    uint16_t spacing; /* half float: 2^k / 65536; 0 for k = -1 */
    uint8_t colour[4];
} pbs_clod_point;

/* What is left of a cell when it is thinned. */
typedef struct pbs_clod_rest {
    uint32_t q[3];
    float sum[4]; /* linear red, green, blue, and weight */
    uint8_t alpha;
    int8_t level; /* k */
} pbs_clod_rest;

/* There may be half a million, so their numbers are as small as they can be. */
typedef struct pbs_clod_cell {
    uint64_t first, count; /* of the array of points */
    uint32_t origin[3];
    uint32_t low[3], high[3]; /* box around its points */
    /* Set by pbs_clod_thin: points of each k, the largest first in the array, those that are left
     * (of k = pbs_clod_top) before all, and last those of k = -1. */
    uint64_t equal; /* of k = -1 */
    uint32_t rest_count;
    uint32_t border_count; /* that neighbours must respect; PBS_CLOD_NO_LIST: of all its points */
    uint16_t level[PBS_CLOD_LEVELS];
    int8_t bits; /* side 2^bits */
} pbs_clod_cell;

#define PBS_CLOD_NO_LIST UINT32_MAX

/* Points of level k. */
static inline uint64_t pbs_clod_of_level(const pbs_clod_cell *c, int k) {
    return k < 0 ? c->equal : c->level[k];
}

/* The coarsest k that a cell decides on its own. */
static inline int pbs_clod_top(const pbs_clod_cell *c) {
    return c->bits > PBS_CLOD_KEEP ? c->bits - PBS_CLOD_KEEP : 0;
}

/* Sorts n keys of bits 16 .. 16 + bits - 1; of equal ones the first stays first. The result is in
 * *key; *other, as large, may change places with it. */
void pbs_clod_sort(uint64_t **key, uint64_t **other, uint32_t n, int bits);

/* ---- where the points are ---- */

/* Bytes in memory or in a file, 16 for each point. Different places can be read and written at a
 * time. */
typedef struct pbs_clod_store {
    void *ctx;
    pbs_code (*read)(void *ctx, uint64_t at, size_t size, void *to, pbs_err *err);
    pbs_code (*write)(void *ctx, uint64_t at, size_t size, const void *from, pbs_err *err);
    /* More room, which may be a file's map; once. It is the store's. NULL: it comes from memory. */
    pbs_code (*more)(void *ctx, size_t size, void **out, pbs_err *err);
    /* Called every now and then while that is used, so that its pages can be given back. */
    void (*done)(void *ctx);
} pbs_clod_store;

/* ---- the octree of cells ---- */

/* Counts of a regular grid of cells in Morton order, 2^depth along each axis. */
typedef struct pbs_clod_grid {
    uint32_t origin[3];
    int bits, depth; /* of the cloud's side 2^bits; depth <= bits, PBS_CLOD_DEPTH */
    uint64_t *count; /* 8^depth */
    uint32_t *cell;  /* 8^depth: which cell of the octree; set by pbs_clod_cells */
    uint32_t spread[1 << PBS_CLOD_DEPTH]; /* every third bit of a number */
} pbs_clod_grid;

pbs_code pbs_clod_grid_new(pbs_run *run, int bits, int depth, pbs_clod_grid *g, pbs_err *err);
void pbs_clod_grid_free(pbs_run *run, pbs_clod_grid *g);

/* Place in the grid. */
static inline uint32_t pbs_clod_place(const pbs_clod_grid *g, const uint32_t q[3]) {
    int shift = g->bits - g->depth;
    return g->spread[(q[0] - g->origin[0]) >> shift] |
           g->spread[(q[1] - g->origin[1]) >> shift] << 1 |
           g->spread[(q[2] - g->origin[2]) >> shift] << 2;
}

/* So many of what is left of cells are thinned in one go, whatever the memory; of more, cubes one
 * after the other, which respect those before them. */
enum { PBS_CLOD_PIECE = 1 << 17 };

typedef struct pbs_clod_cells {
    pbs_clod_cell *cell; /* in Morton order, none empty */
    size_t count, room;
    size_t most; /* 0: any number; of more there is an error, PBS_LIMIT, and too_many */
    bool too_many;
    uint32_t piece; /* 0: PBS_CLOD_PIECE */
} pbs_clod_cells;

/* Appends the cells of a grid that is counted; their points begin at `first` and follow each
 * other. */
pbs_code pbs_clod_cells_of(pbs_run *run, pbs_clod_grid *g, uint64_t first, pbs_clod_cells *out,
                           pbs_err *err);
/* Cells that are too large, or have too many points, are cut, and their points put in order. raw:
 * all points, those of a cell together. done is called every now and then, so that pages of the
 * array can be given back; NULL: nobody asks. */
pbs_code pbs_clod_cut(pbs_run *run, pbs_clod_raw *raw, pbs_clod_cells *cells,
                      void (*done)(void *ctx), void *ctx, pbs_err *err);
void pbs_clod_cells_free(pbs_run *run, pbs_clod_cells *cells);

/* ---- levels ---- */

/* Thins all cells. The room of a cell, from pbs_clod_at on, holds its points as pbs_clod_cut left
 * them, and then as pbs_clod_point (12 bytes a point), the coarse before the fine and those of a
 * level in Morton order. colours: false: they are not touched. */
pbs_code pbs_clod_thin(pbs_run *run, const pbs_clod_store *store, pbs_clod_cells *cells,
                       bool colours, pbs_err *err);

static inline uint64_t pbs_clod_at(const pbs_clod_cell *c) {
    return c->first * sizeof(pbs_clod_raw);
}

/* What is left of all cells, through all coarser levels up to k = top. */
typedef struct pbs_clod_upper {
    size_t count;
    pbs_clod_rest *rest; /* in the order of the cells, and in them in Morton order */
    size_t *first;       /* of each cell, and the end */
    bool stored;         /* rest is the store's */
} pbs_clod_upper;

pbs_code pbs_clod_thin_upper(pbs_run *run, const pbs_clod_store *store, pbs_clod_cells *cells,
                             int top, bool colours, pbs_clod_upper *out, pbs_err *err);
/* Its colour. */
void pbs_clod_rest_colour(const pbs_clod_rest *r, uint8_t colour[4]);
void pbs_clod_upper_free(pbs_run *run, pbs_clod_upper *u);

/* 2^k / 65536 as a half float; k -1 .. 31. */
uint16_t pbs_clod_spacing(int k);
#endif
