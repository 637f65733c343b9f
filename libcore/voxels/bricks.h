/* bricks.h: what pbs_block adds up, cell by cell, and which cells are six-separating.
 *
 * Bricks of 4^3 cells are taken from a pool when the first thing happens in them, and so is the
 * record of a cell, a line of the cache: memory that is touched grows with the cells only. Records
 * are whole numbers: sums do not depend on the order. They are 64 bits wide; a cell whose sums get
 * large has their upper bits moved to a second record, which few cells have. Cells of a brick, and
 * bricks at the end, are in Morton order, so nothing is sorted.
 */
#ifndef PBS_BRICKS_H
#define PBS_BRICKS_H

#include "libcore/voxels/grid.h"
#include "libcore/ground/run.h"
#include <string.h>

enum {
    PBS_BRICK_ROW = 18, /* bricks along an axis: those of the block, and one at each end */
    PBS_BRICK_TABLE = 18 * 18 * 18,
    PBS_BRICKS = 16 * 16 * 16, /* of the block itself */
    PBS_CELLS = 64 * PBS_BRICKS,
    PBS_BRICK_SLAB = 256, /* taken at a time */
    PBS_RECORD_SLAB = 4096
};

/* A record: area times normal on this side of the fixed plane, the area, area times normal beyond
 * it, flags; then the extras. So either side's sums and the area lie side by side. */
enum { PBS_REC_NEAR, PBS_REC_AREA = 3, PBS_REC_BEYOND, PBS_REC_FLAGS = 7, PBS_REC_EXTRA };

/* Record 0 is nobody's and empty. Flags: from the lowest bit on, directions it is seen from and
 * PBS_VOXEL_TWO_SIDED; */
#define PBS_REC_BARE  256 /* no area so far: each thing in it weighs PBS_UNIT */
#define PBS_REC_WIDE  32  /* from this bit on: the number of its second record, or 0 */
#define PBS_WIDE_BITS 40  /* what that one counts in: enough for 2^47 square voxels in a cell */

typedef struct pbs_brick {
    uint64_t seen;  /* cells that something is in */
    uint32_t index; /* in the table */
    uint32_t pad[13];
    union {
        uint32_t record[64]; /* numbers; 0: none */
        uint8_t faces[64];   /* if only the set is wanted: that is all there is of a brick then */
    };
} pbs_brick;

typedef struct pbs_bricks {
    pbs_run *run;
    uint32_t extras, numbers; /* numbers of a record: besides sums, in all */
    bool sums;                /* whether there are records */
    size_t brick_bytes;
    uint32_t axis[3][128]; /* from a coordinate of PBS_CELL: they add up to the code, below */
    uint64_t six[PBS_BRICK_TABLE];
    pbs_brick *at[PBS_BRICK_TABLE]; /* NULL: nothing in it so far */
    uint64_t used[PBS_BRICKS / 64]; /* Morton numbers of bricks of the block that are not NULL */
    uint16_t morton[PBS_BRICK_TABLE], place[PBS_BRICKS];
    uint32_t count, records, wides; /* in use; records and wides begin with 1 */
    char *brick[PBS_BRICKS / PBS_BRICK_SLAB];
    int64_t *record[PBS_CELLS / PBS_RECORD_SLAB + 1];
    int64_t *wide[PBS_CELLS / PBS_RECORD_SLAB + 1];
    pbs_brick *spare; /* stands for all outside of the block */
    pbs_code rc;      /* of taking memory */
    pbs_err err;
} pbs_bricks;

pbs_code pbs_bricks_init(pbs_bricks *b, pbs_run *run, bool sums, uint32_t extras, pbs_err *err);
void pbs_bricks_free(pbs_bricks *b);
void pbs_bricks_begin(pbs_bricks *b);

/* Room for n more bricks and records. False: there is none, and b->rc says so until it begins
 * anew. */
bool pbs_bricks_reserve(pbs_bricks *b, uint32_t n);

/* A brick of the table, for which there must be room. */
pbs_brick *pbs_brick_new(pbs_bricks *b, uint32_t index);
/* Moves the upper bits of a record's numbers away. */
void pbs_record_widen(pbs_bricks *b, int64_t *record);
/* Number i of a record; whole. */
__int128 pbs_record_total(const pbs_bricks *b, const int64_t *record, uint32_t i);
/* Back to nothing but its flags, of which it loses PBS_REC_BARE. */
void pbs_record_clear(pbs_bricks *b, int64_t *record);

/* Of a PBS_CELL: its brick in the table times 64, and the cell in it. */
static inline uint32_t pbs_bricks_code(const pbs_bricks *b, uint32_t cell) {
    return b->axis[0][cell & 127] + b->axis[1][cell >> 7 & 127] + b->axis[2][cell >> 14 & 127];
}
static inline pbs_brick *pbs_bricks_get(pbs_bricks *b, uint32_t code) {
    pbs_brick *p = b->at[code >> 6];
    return __builtin_expect(p != NULL, 1) ? p : pbs_brick_new(b, code >> 6);
}
static inline pbs_brick *pbs_brick_number(const pbs_bricks *b, uint32_t number) {
    return (void *)(b->brick[number / PBS_BRICK_SLAB] + number % PBS_BRICK_SLAB * b->brick_bytes);
}
static inline int64_t *pbs_record_at(const pbs_bricks *b, uint32_t number) {
    return b->record[number / PBS_RECORD_SLAB] + (size_t)(number % PBS_RECORD_SLAB) * b->numbers;
}
/* The record of a cell of a brick, a new one if need be, for which there must be room. */
static inline int64_t *pbs_brick_record(pbs_bricks *b, pbs_brick *p, uint32_t cell) {
    uint32_t n = p->record[cell];
    if (n) return pbs_record_at(b, n);
    p->record[cell] = n = b->records++;
    p->seen |= UINT64_C(1) << cell;
    int64_t *r = pbs_record_at(b, n);
    memset(r, 0, PBS_REC_EXTRA * sizeof *r);
    for (uint32_t i = PBS_REC_EXTRA; i < b->numbers; i++) r[i] = 0;
    return r;
}

/* Cells of a brick whose neighbour along an axis (0, 1, 2), up or down, is set. own: the brick's
 * cells, next: those of the brick behind. */
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
