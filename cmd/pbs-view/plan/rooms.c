/* rooms.c: first fit over a sorted list of what is free. */
#include "cmd/pbs-view/plan/rooms.h"
#include <string.h>

static uint64_t rounded(uint64_t size) {
    return (size + PBS_ROOM_ALIGN - 1) / PBS_ROOM_ALIGN * PBS_ROOM_ALIGN;
}

pbs_code pbs_rooms_new(pbs_run *run, uint64_t size, pbs_rooms *out, pbs_err *err) {
    *out = (pbs_rooms){.size = size};
    pbs_code rc = pbs_grow(run, &out->free, &out->cap, 1, sizeof *out->free, "the GPU's map", err);
    if (rc) return rc;
    out->free[out->count++] = (pbs_extent){0, size};
    return PBS_OK;
}

void pbs_rooms_free(pbs_run *run, pbs_rooms *r) {
    pbs_free(run, r->free);
    *r = (pbs_rooms){0};
}

static void remove_extent(pbs_rooms *r, size_t i) {
    memmove(&r->free[i], &r->free[i + 1], (--r->count - i) * sizeof *r->free);
}

bool pbs_rooms_take(pbs_rooms *r, uint64_t size, uint64_t *at) {
    size = rounded(size);
    for (size_t i = 0; i < r->count; i++) {
        pbs_extent *e = &r->free[i];
        if (e->size < size) continue;
        *at = e->at;
        e->at += size;
        e->size -= size;
        if (!e->size) remove_extent(r, i);
        r->used += size;
        return true;
    }
    return false;
}

pbs_code pbs_rooms_give(pbs_run *run, pbs_rooms *r, uint64_t at, uint64_t size, pbs_err *err) {
    size_t i = 0;
    size = rounded(size);
    pbs_code rc =
        pbs_grow(run, &r->free, &r->cap, r->count + 1, sizeof *r->free, "the GPU's map", err);
    if (rc) return rc;
    while (i < r->count && r->free[i].at < at) i++;
    memmove(&r->free[i + 1], &r->free[i], (r->count++ - i) * sizeof *r->free);
    r->free[i] = (pbs_extent){at, size};
    r->used -= size;
    if (i + 1 < r->count && at + size == r->free[i + 1].at) {
        r->free[i].size += r->free[i + 1].size;
        remove_extent(r, i + 1);
    }
    if (i && r->free[i - 1].at + r->free[i - 1].size == at) {
        r->free[i - 1].size += r->free[i].size;
        remove_extent(r, i);
    }
    return PBS_OK;
}
