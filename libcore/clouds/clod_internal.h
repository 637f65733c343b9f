/* clod_internal.h: what the files of clod.h share. */
#ifndef PBS_CLOD_INTERNAL_H
#define PBS_CLOD_INTERNAL_H

#include "libcore/clouds/clod.h"

/* A point that neighbours of its cell must respect, relative to the cell. */
typedef struct pbs_clod_border {
    uint16_t q[3];
    int16_t k;
} pbs_clod_border;

enum { PBS_CLOD_BORDER = PBS_CLOD_CELL / 2 }; /* of them behind a cell's points at most */

/* Morton order of two places. */
static inline bool pbs_clod_before(const uint32_t a[3], const uint32_t b[3]) {
    uint32_t most = 0;
    int axis = 0;
    for (int k = 0; k < 3; k++) {
        uint32_t differ = a[k] ^ b[k];
        /* The axis with the highest bit that differs; of equal ones the last. */
        if (differ < most && differ < (differ ^ most)) continue;
        axis = k, most = differ;
    }
    return a[axis] < b[axis];
}

/* Pages of a store's map that were looked at. A look may bring in as many around it as the system
 * keeps together, up to 2 MB; so what counts is how often one goes from 2 MB to others. */
typedef struct pbs_clod_looks {
    uintptr_t last;
    uint32_t count;
} pbs_clod_looks;

/* Whether it is time to give pages back. */
static inline bool pbs_clod_look(pbs_clod_looks *l, const void *at) {
    uintptr_t part = (uintptr_t)at >> 21;
    if (part == l->last) return false;
    l->last = part;
    return ++l->count % 4 == 0;
}

/* Working memory for one cell. */
typedef struct pbs_clod_work {
    pbs_clod_raw *raw;      /* then the points, and what is left behind them */
    pbs_clod_point *points; /* there */
    uint64_t *key, *other;
    uint8_t (*colour)[4];
    uint16_t (*q)[3];
    int8_t *level;
    pbs_thin_set kept, next, rejected, *last; /* last: what is left */
    pbs_thin thin;
} pbs_clod_work;

pbs_code pbs_clod_work_new(pbs_run *run, bool colours, pbs_clod_work *w, pbs_err *err);
void pbs_clod_work_free(pbs_run *run, pbs_clod_work *w);
/* The points that it must respect are in w->thin.fixed. */
pbs_code pbs_clod_thin_cell(const pbs_clod_store *store, pbs_clod_cell *c, pbs_clod_work *w,
                            pbs_err *err);
/* What is left of it: rest_count points. */
pbs_code pbs_clod_take_rest(const pbs_clod_store *store, const pbs_clod_cell *c, bool colours,
                            pbs_clod_work *w, pbs_clod_rest *out, pbs_err *err);
/* Appends a cell's border points of at least k to t's, if they matter for the box low .. high.
 * room: for PBS_CLOD_BORDER of them. */
pbs_code pbs_clod_take_border(pbs_thin *t, const pbs_clod_store *store, const pbs_clod_cell *from,
                              const int64_t low[3], const int64_t high[3], int least,
                              pbs_clod_border *room, pbs_err *err);

/* ---- what is left of all cells: clod_upper.c ---- */

/* Whether a neighbour's box is closer than a distance. */
static inline bool pbs_clod_is_near(const int64_t low[3], const int64_t high[3],
                                    const int64_t other_low[3], const int64_t other_high[3],
                                    int64_t distance) {
    for (int k = 0; k < 3; k++)
        if (other_low[k] - high[k] >= distance || low[k] - other_high[k] >= distance) return false;
    return true;
}
#endif
