/* thin.h: points of which no two are closer than a spacing, chosen from many: one level of a
 * continuous level of detail (paper 3, section 3.1), on integer positions.
 *
 * Candidates come in Morton order and are taken one after the other: one that is at least 2^k from
 * all that are kept stays, any other is rejected. What stays is as dense as it can be: every
 * candidate that goes is closer than 2^k to one that stays, or to a fixed point.
 *
 * The colour of a point that stays becomes the mean of all candidates closer than 2^k, weighted by
 * 1 - (d / 2^k)^2. (beyond: the paper takes the plain mean of the next level.) Level by level that
 * is a wider and wider window over all points there were.
 *
 * Fixed points were chosen before, by others. Each has a spacing of its own, and two points must
 * be as far apart as the smaller of their spacings says.
 */
#ifndef PBS_THIN_H
#define PBS_THIN_H

#include "libcore/ground/run.h"

enum { PBS_THIN_BLOCK = 2 }; /* a level works in blocks that are 2^2 spacings wide */

/* Points in Morton order of their positions. */
typedef struct pbs_thin_set {
    int32_t *x, *y, *z; /* the range of all is below 2^31 */
    uint32_t *id;       /* the caller's */
    float *sum;         /* linear red, green, blue, and weight, of each; NULL: no colours */
    uint32_t count;
} pbs_thin_set;

typedef struct pbs_thin_block {
    int32_t at[3];
    uint32_t kept, kept_count; /* first of them, and how many */
    uint32_t tail, tail_count;
    uint32_t fixed; /* first of a chain, from 1; 0: none */
} pbs_thin_block;

/* Candidates that follow each other in one block. */
typedef struct pbs_thin_run {
    uint32_t first, end, rejected, rejected_end; /* rejected: among these */
    int32_t at[3], min[3], max[3];               /* block; box around them */
} pbs_thin_run;

/* Points near others, relative to a corner. */
typedef struct pbs_thin_list {
    float *at;    /* rows x, y, z, square of the spacing, each of `room` */
    uint32_t *id; /* of kept ones: which */
    size_t count, room;
} pbs_thin_list;

/* Working memory, for one thread at a time. */
typedef struct pbs_thin {
    pbs_run *run;
    pbs_thin_block *block;
    size_t block_count, block_room, slot_room;
    uint32_t *slot, slot_mask;
    uint64_t (*row)[64]; /* 64 x 64 rows of 64 blocks along x, all modulo 64: bits: may be there */
    pbs_thin_run *runs;
    size_t run_count, run_room;
    float *tail; /* squares of spacings of the rejected */
    struct pbs_thin_fixed {
        int32_t at[3], k; /* spacing 2^k */
        uint32_t next;
    } * fixed; /* the caller fills it, up to fixed_count */
    size_t fixed_count, fixed_room;
    pbs_thin_list kept, other, some_kept, some_other; /* near a block, and near a few of it */
} pbs_thin;

/* Room for sets of up to `room` points. Free it also after an error. */
pbs_code pbs_thin_new(pbs_run *run, size_t room, pbs_thin *t, pbs_err *err);
void pbs_thin_free(pbs_thin *t); /* zeroed by = {0} is fine */

/* A set with arrays for `room` points (and sixteen, that are read with the last), and back. */
pbs_code pbs_thin_set_new(pbs_run *run, size_t room, bool colours, pbs_thin_set *s, pbs_err *err);
void pbs_thin_set_free(pbs_run *run, pbs_thin_set *s);

static inline void pbs_thin_put(pbs_thin_set *to, int32_t x, int32_t y, int32_t z, uint32_t id) {
    uint32_t n = to->count++;
    to->x[n] = x, to->y[n] = y, to->z[n] = z, to->id[n] = id;
}

/* Makes room for `more` fixed points behind those that are there. */
pbs_code pbs_thin_reserve_fixed(pbs_thin *t, size_t more, pbs_err *err);

/* One level, with spacing 2^k: candidates become kept or rejected, both in the same order and with
 * room for all. Rejected ones keep their colour. first: of several levels; pbs_thin_tail follows,
 * and it is there that the rejected give their colours. */
pbs_code pbs_thin_level(pbs_thin *t, const pbs_thin_set *candidates, int k, bool first,
                        pbs_thin_set *kept, pbs_thin_set *rejected, pbs_err *err);

/* Directly after the first level k: gives each of those that it rejected, one after the other, the
 * coarsest level below k where it is far enough from all so far, level[id] = its exponent; distinct
 * points have one of at least 0. So of each level, what is not in it is within its spacing of what
 * is. A rejected one keeps its colour, and gives it to the nearest that stays within half a
 * spacing: points are few there, and giving it to all costs as much as everything else. */
pbs_code pbs_thin_tail(pbs_thin *t, pbs_thin_set *kept, const pbs_thin_set *rejected, int k,
                       int8_t *level, pbs_err *err);
#endif
