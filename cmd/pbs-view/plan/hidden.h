/* hidden.h: a set of 64-bit keys: the placings below which everything was hidden. */
#ifndef PBS_HIDDEN_H
#define PBS_HIDDEN_H

#include "libcore/ground/run.h"

/* Zeroed by = {0}. Key 0 is no key. */
typedef struct pbs_hidden {
    uint64_t *slots; /* 0: free; cap is a power of two, at most half of it is used */
    size_t count, cap;
} pbs_hidden;

bool pbs_hidden_has(const pbs_hidden *h, uint64_t key);
/* Errors: PBS_LIMIT; the set is as before then. */
pbs_code pbs_hidden_add(pbs_run *run, pbs_hidden *h, uint64_t key, pbs_err *err);
void pbs_hidden_remove(pbs_hidden *h, uint64_t key); /* it need not be there */
void pbs_hidden_clear(pbs_hidden *h);                /* keeps the room */
void pbs_hidden_free(pbs_run *run, pbs_hidden *h);
#endif
