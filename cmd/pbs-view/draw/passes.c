/* passes.c: see the header. */
#include "cmd/pbs-view/draw/passes.h"
#include "cmd/pbs-view/draw/draw_internal.h"

struct pbs_passes {
    pbs_splat *splat;
    pbs_reduce *reduce;
    pbs_camera begun; /* of the pass that runs */
    uint64_t stepped; /* frame of the last step */
    bool running, again;
};

void pbs_passes_free(pbs_canvas *c) {
    struct pbs_passes *r = c->passes;
    if (!r) return;
    pbs_splat_free(r->splat);
    pbs_reduce_free(r->reduce);
    pbs_free(c->run, r);
    c->passes = NULL;
}

static pbs_code begin(pbs_canvas *c, pbs_err *err) {
    if (c->passes) return PBS_OK;
    pbs_code rc = pbs_alloc(c->run, &c->passes, 1, sizeof *c->passes, "the canvas", err);
    if (!rc) *c->passes = (struct pbs_passes){0};
    return rc;
}

pbs_code pbs_passes_splat(pbs_canvas *c, const pbs_resident *nodes, size_t count,
                          const pbs_splat_options *options, pbs_err *err) {
    pbs_code rc = begin(c, err);
    if (!rc && !c->passes->splat) rc = pbs_splat_new(c->run, c->gl, &c->passes->splat, err);
    if (rc) return rc;
    return pbs_splat_draw(c->passes->splat, c, nodes, count, options, err);
}

pbs_code pbs_passes_splat_count(pbs_canvas *c, pbs_splat_counts *out, pbs_err *err) {
    *out = (pbs_splat_counts){0};
    if (!c->passes || !c->passes->splat) return PBS_OK;
    return pbs_splat_count(c->passes->splat, out, err);
}

pbs_code pbs_passes_points(pbs_canvas *c, const pbs_resident *nodes, size_t count,
                           const pbs_reduce_options *options, bool wait, bool *again,
                           pbs_err *err) {
    pbs_code rc = begin(c, err);
    struct pbs_passes *r = c->passes;
    if (!rc && !r->reduce) rc = pbs_reduce_new(c->run, c->gl, 0, &r->reduce, err);
    /* The second eye's picture is drawn of what there is for both. */
    for (bool whole = false; !rc && r->stepped != c->frames;) {
        if (!r->running) r->begun = c->begun;
        rc = pbs_reduce_step(r->reduce, &c->begun, c->aspect, nodes, count, options, &whole, err);
        r->running = !whole;
        r->again = !whole || memcmp(&r->begun, &c->begun, sizeof c->begun);
        if (!wait || !r->again) r->stepped = c->frames;
        if (!rc) rc = pbs_run_check(c->run, err);
    }
    *again = !rc && r->again;
    return rc ? rc : pbs_reduce_draw(r->reduce, c, options, err);
}

pbs_code pbs_passes_points_count(pbs_canvas *c, uint64_t *kept, pbs_err *err) {
    uint64_t lost;
    *kept = 0;
    if (!c->passes || !c->passes->reduce) return PBS_OK;
    return pbs_reduce_count(c->passes->reduce, kept, &lost, err);
}
