/* numbers.c: open addressing, at most half full. */
#include "cmd/pbs-view/plan/numbers.h"
#include <string.h>

static size_t place(const pbs_numbers *k, uint64_t key) {
    uint64_t h = (key ^ key >> 32) * 0x9e3779b97f4a7c15u;
    size_t i = (size_t)(h >> 32) & (k->room - 1);
    while (k->slot[i].used && k->slot[i].key != key) i = (i + 1) & (k->room - 1);
    return i;
}

static pbs_code widen(pbs_run *run, pbs_numbers *k, pbs_err *err) {
    pbs_numbers wide = {.room = k->room ? 2 * k->room : 64, .count = k->count};
    pbs_code rc = pbs_alloc(run, &wide.slot, wide.room, sizeof *wide.slot, "the nodes' keys", err);
    if (rc) return rc;
    memset(wide.slot, 0, wide.room * sizeof *wide.slot);
    for (size_t i = 0; i < k->room; i++)
        if (k->slot[i].used) wide.slot[place(&wide, k->slot[i].key)] = k->slot[i];
    pbs_free(run, k->slot);
    *k = wide;
    return PBS_OK;
}

pbs_code pbs_numbers_put(pbs_run *run, pbs_numbers *k, uint64_t key, uint32_t value, pbs_err *err) {
    if (2 * (k->count + 1) > k->room) {
        pbs_code rc = widen(run, k, err);
        if (rc) return rc;
    }
    struct pbs_number *s = &k->slot[place(k, key)];
    k->count += !s->used;
    *s = (struct pbs_number){key, value, 1};
    return PBS_OK;
}

uint32_t pbs_numbers_get(const pbs_numbers *k, uint64_t key) {
    if (!k->room) return (uint32_t)PBS_NUMBERS_NONE;
    const struct pbs_number *s = &k->slot[place(k, key)];
    return s->used ? s->value : (uint32_t)PBS_NUMBERS_NONE;
}

void pbs_numbers_clear(pbs_numbers *k) {
    if (k->room) memset(k->slot, 0, k->room * sizeof *k->slot);
    k->count = 0;
}

void pbs_numbers_free(pbs_run *run, pbs_numbers *k) {
    pbs_free(run, k->slot);
    *k = (pbs_numbers){0};
}
