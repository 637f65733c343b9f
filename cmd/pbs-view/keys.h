/* keys.h: which number belongs to which 64-bit key: what a node was in the last frame. Plain
 * arithmetic. */
#ifndef PBS_KEYS_H
#define PBS_KEYS_H

#include "libcore/run.h"

/* Zero-initialised it is empty. */
typedef struct pbs_keys {
    struct pbs_key {
        uint64_t key;
        uint32_t value, used;
    } * slot;
    size_t room, count; /* room: 0 or a power of two */
} pbs_keys;

enum { PBS_KEYS_NONE = -1 }; /* as uint32_t: no such key */

/* A key that is there gets the new value. Errors: PBS_LIMIT. */
pbs_code pbs_keys_put(pbs_run *run, pbs_keys *keys, uint64_t key, uint32_t value, pbs_err *err);
uint32_t pbs_keys_get(const pbs_keys *keys, uint64_t key); /* (uint32_t)PBS_KEYS_NONE */
void pbs_keys_clear(pbs_keys *keys);                       /* the room stays */
void pbs_keys_free(pbs_run *run, pbs_keys *keys);
#endif
