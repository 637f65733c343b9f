/* numbers.h: which number belongs to which 64-bit key: what a node was in the last frame. Plain
 * arithmetic. */
#ifndef PBS_NUMBERS_H
#define PBS_NUMBERS_H

#include "libcore/ground/run.h"

/* Zero-initialised it is empty. */
typedef struct pbs_numbers {
    struct pbs_number {
        uint64_t key;
        uint32_t value, used;
    } * slot;
    size_t room, count; /* room: 0 or a power of two */
} pbs_numbers;

enum { PBS_NUMBERS_NONE = -1 }; /* as uint32_t: no such key */

/* A key that is there gets the new value. Errors: PBS_LIMIT. */
pbs_code pbs_numbers_put(pbs_run *run, pbs_numbers *keys, uint64_t key, uint32_t value,
                         pbs_err *err);
uint32_t pbs_numbers_get(const pbs_numbers *keys, uint64_t key); /* (uint32_t)PBS_NUMBERS_NONE */
void pbs_numbers_clear(pbs_numbers *keys);                       /* the room stays */
void pbs_numbers_free(pbs_run *run, pbs_numbers *keys);
#endif
