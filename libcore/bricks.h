/* bricks.h: what pbs_block adds up, cell by cell, and which cells are six-separating.
 *
 * Bricks of 4^3 cells are taken from a pool when the first thing happens in them. A cell has whole
 * numbers only: sums do not depend on the order. They are 64 bits wide; a cell whose sums get large
 * has their upper bits moved to a second array, which few bricks have. Cells of a brick, and bricks
 * at the end, are in Morton order, so nothing is sorted.
 */
#ifndef PBS_BRICKS_H
#define PBS_BRICKS_H

#include "libcore/grid.h"
#include "libcore/run.h"

enum {
    PBS_BRICK_ROW = 18, /* bricks along an axis: those of the block, and one at each end */
    PBS_BRICK_TABLE = 18 * 18 * 18,
    PBS_BRICKS = 16 * 16 * 16, /* of the block itself */
    PBS_BRICK_SLAB = 512,      /* taken at a time */
    PBS_SUMS = 8               /* area, area * normal, for either side of the fixed plane */
};
#define PBS_WIDE_BITS 24 /* what the second array counts in */

typedef struct pbs_brick {
    uint64_t seen; /* cells that something is in */
    uint64_t bare; /* of these, those without any area so far: each thing in them weighs 1 */
    int64_t *wide; /* upper parts of sums and extras, or NULL */
    uint64_t pad[5];
    uint8_t faces[64]; /* directions it is seen from, and PBS_VOXEL_TWO_SIDED */
    /* int64_t sums[64][PBS_SUMS], extra[64][extras]: none if only the set is wanted */
} pbs_brick;

typedef struct pbs_bricks {
    pbs_run *run;
    uint32_t extras;       /* numbers a cell besides its sums */
    bool sums;             /* whether there are any */
    size_t bytes;          /* of a brick */
    uint32_t axis[3][128]; /* from a coordinate of PBS_CELL: they add up to code, below */
    uint64_t six[PBS_BRICK_TABLE];
    pbs_brick *at[PBS_BRICK_TABLE]; /* NULL: nothing in it so far */
    uint64_t used[PBS_BRICKS / 64]; /* Morton numbers of bricks of the block that are not NULL */
    uint16_t morton[PBS_BRICK_TABLE], place[PBS_BRICKS];
    uint32_t count, wide_count;
    char *slab[PBS_BRICKS / PBS_BRICK_SLAB];
    int64_t **wide;   /* PBS_BRICKS pointers, of which wide_count are in use; NULL: none ever was */
    pbs_brick *spare; /* takes what lies outside of the block, and what there is no memory for */
    pbs_code rc;      /* of taking memory */
    pbs_err err;
} pbs_bricks;

pbs_code pbs_bricks_init(pbs_bricks *b, pbs_run *run, bool sums, uint32_t extras, pbs_err *err);
void pbs_bricks_free(pbs_bricks *b);
void pbs_bricks_begin(pbs_bricks *b);

/* The brick of a cell's code, a new one if need be; never NULL. */
pbs_brick *pbs_brick_new(pbs_bricks *b, uint32_t index);
/* Moves the upper bits of a cell's numbers away. */
void pbs_brick_widen(pbs_bricks *b, pbs_brick *brick, uint32_t cell);

/* Of a PBS_CELL: its brick in the table times 64, and the cell in it. */
static inline uint32_t pbs_bricks_code(const pbs_bricks *b, uint32_t cell) {
    return b->axis[0][cell & 127] + b->axis[1][cell >> 7 & 127] + b->axis[2][cell >> 14 & 127];
}
static inline pbs_brick *pbs_bricks_get(pbs_bricks *b, uint32_t code) {
    pbs_brick *p = b->at[code >> 6];
    return __builtin_expect(p != NULL, 1) ? p : pbs_brick_new(b, code >> 6);
}
static inline int64_t *pbs_brick_sums(const pbs_brick *p, uint32_t cell) {
    return (int64_t *)(p + 1) + PBS_SUMS * (size_t)cell;
}
static inline int64_t *pbs_brick_extra(const pbs_brick *p, uint32_t cell, uint32_t extras) {
    return (int64_t *)(p + 1) + PBS_SUMS * 64 + (size_t)extras * cell;
}
/* Number i of a cell's sums and, from PBS_SUMS on, extras; whole. */
__int128 pbs_brick_total(const pbs_bricks *b, const pbs_brick *p, uint32_t cell, uint32_t i);

/* Cells of a brick whose neighbour along an axis (0, 1, 2), up or down, is set; near: the brick's
 * own cells, next: those of the brick behind. */
static inline uint64_t pbs_brick_up(uint64_t own, uint64_t next, int axis) {
    static const uint64_t even[3] = {0x5555555555555555, 0x3333333333333333, 0x0f0f0f0f0f0f0f0f};
    static const uint64_t high[3] = {0xff00ff00ff00ff00, 0xffff0000ffff0000, 0xffffffff00000000};
    int s = 1 << axis;
    uint64_t e = even[axis], h = high[axis];
    return (own >> s & e) | (own >> 7 * s & ~e & ~h) | (next << 9 * s & ~e & h);
}
static inline uint64_t pbs_brick_down(uint64_t own, uint64_t next, int axis) {
    static const uint64_t even[3] = {0x5555555555555555, 0x3333333333333333, 0x0f0f0f0f0f0f0f0f};
    static const uint64_t high[3] = {0xff00ff00ff00ff00, 0xffff0000ffff0000, 0xffffffff00000000};
    int s = 1 << axis;
    uint64_t e = even[axis], h = high[axis];
    return (own << s & ~e) | (own << 7 * s & e & h) | (next >> 9 * s & e & ~h);
}
#endif
