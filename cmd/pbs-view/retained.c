/* retained.c: see the header; identities by hashing. */
#include "cmd/pbs-view/retained.h"
#include "cmd/pbs-view/draw_internal.h"

struct pbs_retained {
    pbs_residents *pool;
    pbs_splat *splat;
    pbs_reduce *reduce;
    pbs_resident *list;
    size_t list_room;
    pbs_camera begun; /* of the pass that runs */
    bool running;
};

void pbs_retained_free(pbs_canvas *c) {
    struct pbs_retained *r = c->retained;
    if (!r) return;
    pbs_splat_free(r->splat);
    pbs_reduce_free(r->reduce);
    pbs_residents_free(r->pool);
    pbs_free(c->run, r->list);
    pbs_free(c->run, r);
    c->retained = NULL;
}

/* By where its records lie on the device, which does not change from run to run, and its transform.
 */
static uint64_t key_of(const pbs_resident *r) {
    uint64_t word, h = (r->offset ^ (uint64_t)r->buffer << 40) * 0x9e3779b97f4a7c15u;
    for (int i = 0; i < 12; i++) {
        memcpy(&word, &r->m[i], sizeof word);
        h = (h ^ h >> 31 ^ word) * 0xbf58476d1ce4e5b9u;
    }
    return h ^ h >> 29;
}

/* The nodes, on the device. */
static pbs_code retain(pbs_canvas *c, const pbs_surfels *nodes, size_t count, pbs_err *err) {
    pbs_code rc = PBS_OK;
    if (!c->retained) {
        rc = pbs_alloc(c->run, &c->retained, 1, sizeof *c->retained, "the canvas", err);
        if (rc) return rc;
        *c->retained = (struct pbs_retained){0};
    }
    struct pbs_retained *r = c->retained;
    if (!r->pool) rc = pbs_residents_new(c->run, c->gl, &r->pool, err);
    if (!rc)
        rc = pbs_grow(c->run, &r->list, &r->list_room, count, sizeof *r->list,
                      "the list of what is drawn", err);
    for (size_t i = 0; i < count && !rc; i++) {
        rc = pbs_residents_add(r->pool, &nodes[i], 0, &r->list[i], err);
        r->list[i].key = key_of(&r->list[i]);
    }
    return rc;
}

pbs_code pbs_retained_splat(pbs_canvas *c, const pbs_surfels *nodes, size_t count,
                            const pbs_splat_options *options, pbs_err *err) {
    pbs_code rc = retain(c, nodes, count, err);
    if (!rc && !c->retained->splat) rc = pbs_splat_new(c->run, c->gl, &c->retained->splat, err);
    if (rc) return rc;
    return pbs_splat_draw(c->retained->splat, c, c->retained->list, count, options, err);
}

pbs_code pbs_retained_splat_count(pbs_canvas *c, pbs_splat_counts *out, pbs_err *err) {
    *out = (pbs_splat_counts){0};
    if (!c->retained || !c->retained->splat) return PBS_OK;
    return pbs_splat_count(c->retained->splat, out, err);
}

pbs_code pbs_retained_points(pbs_canvas *c, const pbs_surfels *nodes, size_t count,
                             const pbs_reduce_options *options, bool wait, bool *again,
                             pbs_err *err) {
    *again = false;
    pbs_code rc = retain(c, nodes, count, err);
    struct pbs_retained *r = c->retained;
    if (!rc && !r->reduce) rc = pbs_reduce_new(c->run, c->gl, 0, &r->reduce, err);
    for (bool whole = false; !rc;) {
        if (!r->running) r->begun = c->camera;
        rc =
            pbs_reduce_step(r->reduce, &c->camera, c->aspect, r->list, count, options, &whole, err);
        r->running = !whole;
        *again = !whole || memcmp(&r->begun, &c->camera, sizeof c->camera);
        if (!wait || !*again) break;
        rc = pbs_run_check(c->run, err);
    }
    return rc ? rc : pbs_reduce_draw(r->reduce, c, options, err);
}

pbs_code pbs_retained_points_count(pbs_canvas *c, uint64_t *kept, pbs_err *err) {
    uint64_t lost;
    *kept = 0;
    if (!c->retained || !c->retained->reduce) return PBS_OK;
    return pbs_reduce_count(c->retained->reduce, kept, &lost, err);
}
