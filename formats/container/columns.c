#include "formats/container/columns.h"
#include <string.h>

/* The members are pointers to different types, so they are read and written as bytes. */
uint8_t *pbs_column_get(const pbs_column *c, const void *s) {
    uint8_t *array;
    memcpy(&array, (const char *)s + c->at, sizeof array);
    return array;
}

void pbs_column_set(const pbs_column *c, void *s, const void *array) {
    memcpy((char *)s + c->at, &array, sizeof array);
}

pbs_code pbs_columns_grow(pbs_run *run, const pbs_columns *all, uint32_t channels, void *s,
                          size_t *cap, size_t need, pbs_err *err) {
    if (need <= *cap) return PBS_OK;
    size_t target = *cap + *cap / 2;
    if (target < need) target = need;
    for (size_t i = 0; i < all->count; i++) {
        const pbs_column *c = all->column + i;
        if (!(channels & c->channel)) continue;
        size_t room = *cap;
        pbs_code rc = pbs_grow(run, (char *)s + c->at, &room, target, c->size, all->what, err);
        if (rc) return rc;
    }
    *cap = target;
    return PBS_OK;
}

void pbs_columns_free(pbs_run *run, const pbs_columns *all, void *s) {
    for (size_t i = 0; i < all->count; i++) {
        pbs_free(run, pbs_column_get(all->column + i, s));
        pbs_column_set(all->column + i, s, NULL);
    }
}
