#include "formats/scene/meshlist.h"
#include "formats/container/wire.h"
#include <string.h>

static const uint8_t zeros[8];

static pbs_code spill(pbs_meshlist *l, pbs_err *err) {
    pbs_code rc = pbs_output_spool(l->run, &l->spool, err);
    if (rc) return rc;
    l->spilled = true;
    l->map.fd = l->trim.statm = -1;
    rc = pbs_output_write(&l->spool, l->bytes, l->used, err);
    l->used = 0;
    return rc;
}

static pbs_code append(pbs_meshlist *l, const void *bytes, size_t n, pbs_err *err) {
    if (l->spilled) return pbs_output_write(&l->spool, bytes, n, err);
    if (n) memcpy(l->bytes + l->used, bytes, n);
    l->used += n;
    return PBS_OK;
}

/* In few steps: fresh memory costs more than what is copied to it. */
static pbs_code reserve(pbs_meshlist *l, size_t need, pbs_err *err) {
    size_t want = 4 * l->room < l->budget ? 4 * l->room : l->budget;
    if (need <= l->room) return PBS_OK;
    return pbs_grow(l->run, &l->bytes, &l->room, want > need ? want : need, 1, "a part", err);
}

/* A payload's pieces are digested one by one: they are cut in the same way for every -m. */
pbs_code pbs_meshlist_add(void *list, uint32_t triangles, const pbs_piece *piece, int pieces,
                          pbs_err *err) {
    pbs_meshlist *l = list;
    size_t size = 0;
    for (int i = 0; i < pieces; i++) size += piece[i].size;
    size_t pad = (size_t)pbs_padding(size, sizeof zeros);
    pbs_code rc = PBS_OK;
    if (!l->spilled && l->used + size + pad > l->budget)
        rc = spill(l, err);
    else if (!l->spilled)
        rc = reserve(l, l->used + size + pad, err);
    for (int i = 0; i < pieces && !rc; i++) {
        pbs_digest_add(&l->digest, piece[i].bytes, piece[i].size);
        rc = append(l, piece[i].bytes, piece[i].size, err);
    }
    l->count++;
    l->triangles += triangles;
    return rc ? rc : append(l, zeros, pad, err);
}

pbs_code pbs_meshlist_end(pbs_meshlist *l, pbs_err *err) {
    if (!l->spilled) return PBS_OK;
    pbs_code rc = pbs_output_reopen(&l->spool, &l->map, err);
    if (rc) return rc;
    pbs_trim_open(l->run, &l->trim);
    pbs_trim_add(&l->trim, l->map.bytes, (size_t)l->map.size);
    return PBS_OK;
}

bool pbs_meshlist_next(const pbs_meshlist *l, uint64_t *at, pbs_mesh *mesh, const void **payload,
                       size_t *bytes) {
    if (*at >= (l->spilled ? l->map.size : l->used)) return false;
    if (l->spilled) pbs_trim_now(&l->trim);
    *payload = (l->spilled ? l->map.bytes : l->bytes) + *at;
    *bytes = pbs_mesh_view(*payload, mesh);
    *at += *bytes + pbs_padding(*bytes, sizeof zeros);
    return true;
}

void pbs_meshlist_clear(pbs_meshlist *l) {
    if (l->spilled) {
        pbs_output_close(&l->spool);
        pbs_input_close(&l->map);
        pbs_trim_close(&l->trim);
    }
    l->spilled = false;
    l->used = 0;
    l->count = l->triangles = 0;
    l->digest = (pbs_digest){{0, 0}};
}

void pbs_meshlist_free(pbs_meshlist *l) {
    pbs_meshlist_clear(l);
    pbs_free(l->run, l->bytes);
    l->bytes = NULL;
}
