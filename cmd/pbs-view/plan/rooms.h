/* rooms.h: places in a few large buffers, given out and taken back. Arithmetic only. */
#ifndef PBS_ROOMS_H
#define PBS_ROOMS_H

#include "libcore/ground/run.h"

enum { PBS_ROOM_ALIGN = 256 };

typedef struct pbs_extent {
    uint64_t at, size;
} pbs_extent;

/* One buffer: what of it is free, sorted, neighbours joined. Zeroed by = {0}. */
typedef struct pbs_rooms {
    uint64_t size, used;
    pbs_extent *free;
    size_t count, cap;
} pbs_rooms;

pbs_code pbs_rooms_new(pbs_run *run, uint64_t size, pbs_rooms *out, pbs_err *err);
void pbs_rooms_free(pbs_run *run, pbs_rooms *r);

/* The first place of that size, rounded up to PBS_ROOM_ALIGN; false: there is none. */
bool pbs_rooms_take(pbs_rooms *r, uint64_t size, uint64_t *at);
/* What was taken, with the same size. Errors: PBS_LIMIT; it stays taken then. */
pbs_code pbs_rooms_give(pbs_run *run, pbs_rooms *r, uint64_t at, uint64_t size, pbs_err *err);
#endif
