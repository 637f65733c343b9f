/* hidden.c: open addressing, linear probing; the hole that a removed key leaves is closed. */
#include "cmd/pbs-view/plan/hidden.h"
#include <string.h>

static size_t home(const pbs_hidden *h, uint64_t key) {
    return (size_t)((key * 0x9e3779b97f4a7c15u) >> 20) & (h->cap - 1);
}

/* Where it is, or where it would be. */
static size_t find(const pbs_hidden *h, uint64_t key) {
    size_t i = home(h, key);
    while (h->slots[i] && h->slots[i] != key) i = (i + 1) & (h->cap - 1);
    return i;
}

bool pbs_hidden_has(const pbs_hidden *h, uint64_t key) {
    return h->cap && h->slots[find(h, key)];
}

static pbs_code grow(pbs_run *run, pbs_hidden *h, pbs_err *err) {
    pbs_hidden larger = {.cap = h->cap ? 2 * h->cap : 256, .count = h->count};
    pbs_code rc = pbs_alloc(run, &larger.slots, larger.cap, sizeof *larger.slots,
                            "the list of what is hidden", err);
    if (rc) return rc;
    memset(larger.slots, 0, larger.cap * sizeof *larger.slots);
    for (size_t i = 0; i < h->cap; i++)
        if (h->slots[i]) larger.slots[find(&larger, h->slots[i])] = h->slots[i];
    pbs_free(run, h->slots);
    *h = larger;
    return PBS_OK;
}

pbs_code pbs_hidden_add(pbs_run *run, pbs_hidden *h, uint64_t key, pbs_err *err) {
    if (2 * (h->count + 1) > h->cap) {
        pbs_code rc = grow(run, h, err);
        if (rc) return rc;
    }
    size_t i = find(h, key);
    h->count += !h->slots[i];
    h->slots[i] = key;
    return PBS_OK;
}

void pbs_hidden_remove(pbs_hidden *h, uint64_t key) {
    if (!pbs_hidden_has(h, key)) return;
    size_t hole = find(h, key), mask = h->cap - 1;
    for (size_t i = (hole + 1) & mask; h->slots[i]; i = (i + 1) & mask)
        if (((i - home(h, h->slots[i])) & mask) >= ((i - hole) & mask))
            h->slots[hole] = h->slots[i], hole = i;
    h->slots[hole] = 0;
    h->count--;
}

void pbs_hidden_clear(pbs_hidden *h) {
    if (h->count) memset(h->slots, 0, h->cap * sizeof *h->slots);
    h->count = 0;
}

void pbs_hidden_free(pbs_run *run, pbs_hidden *h) {
    pbs_free(run, h->slots);
    *h = (pbs_hidden){0};
}
