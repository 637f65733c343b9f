#include "libcore/surfels/average.h"
#include "libcore/surfels/owned.h"
#include "libcore/surfels/sampler.h"
#include "libcore/data/srgb.h"
#include "libcore/data/vec.h"
#include <stdlib.h>

struct pbs_averager {
    pbs_run *run;
    void *block;
    size_t size;
};

pbs_code pbs_averager_new(pbs_run *run, pbs_averager **out, pbs_err *err) {
    if (!(*out = calloc(1, sizeof **out))) return pbs_fail(err, PBS_LIMIT, "no memory");
    (*out)->run = run;
    return PBS_OK;
}

void pbs_averager_free(pbs_averager *a) {
    if (!a) return;
    pbs_free(a->run, a->block);
    free(a);
}

typedef struct job {
    pbs_cover cover;
    pbs_owned owned;
    pbs_cover_surfel *surfels, *now; /* of all octaves; of one */
    uint32_t *scratch;
} job;

static void lay_out(job *j, uint32_t channels, size_t candidates, size_t surfels, int parts,
                    pbs_layout *l) {
    size_t finest = pbs_octave_length(surfels, 1), slots = pbs_tree_slots(candidates);
    pbs_owned_init(&j->owned, channels);
    j->cover.owner = pbs_layout_take(l, slots * sizeof *j->cover.owner);
    j->surfels = pbs_layout_take(l, finest * sizeof *j->surfels);
    j->now = pbs_layout_take(l, finest * sizeof *j->now);
    pbs_owned_layout(&j->owned, slots, finest, parts, l);
    /* Where the slots of surfels are is found before anything has an owner. */
    j->scratch = j->cover.owner;
}

static size_t need(uint32_t channels, size_t candidates, size_t surfels, int parts) {
    job j;
    pbs_layout l = {NULL, 0};
    lay_out(&j, channels, candidates, surfels, parts, &l);
    return l.used;
}

size_t pbs_average_need(uint32_t channels, size_t candidates, size_t surfels) {
    if (!pbs_octaves(surfels)) return 0;
    int parts = pbs_parts_most(candidates, PBS_TREE_PART);
    return need(channels, candidates, surfels, parts) + PBS_ALLOC_HEAD;
}

static pbs_code reserve(pbs_averager *a, size_t size, pbs_err *err) {
    if (size <= a->size) return PBS_OK;
    pbs_free(a->run, a->block);
    a->block = NULL;
    a->size = 0;
    pbs_code rc = pbs_alloc(a->run, &a->block, size, 1, "averaging", err);
    if (!rc) a->size = size;
    return rc;
}

/* ---- entries ---- */

static void put_light(const double linear[3], uint8_t out[3]) {
    for (int k = 0; k < 3; k++) out[k] = pbs_srgb_encode(pbs_srgb(), (float)linear[k]);
}

static void put_normal(const double n[3], const int16_t own[2], int16_t out[2]) {
    double square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
    if (square > 1e-6)
        pbs_oct_encode(out, (float[3]){(float)n[0], (float)n[1], (float)n[2]});
    else
        memcpy(out, own, 4);
}

/* candidate: the surfel itself. */
static void put_entry(const pbs_mean *m, const pbs_points *in, size_t candidate,
                      const pbs_points *out, size_t at) {
    if (in->normal) put_normal(m->normal, in->normal + 2 * candidate, out->normal + 2 * at);
    if (in->colour) {
        put_light(m->colour, out->colour + 4 * at);
        out->colour[4 * at + 3] = pbs_unorm8((float)m->colour[3]);
    }
    if (in->material) {
        for (size_t k = 0; k < 2; k++)
            out->material[4 * at + k] = pbs_unorm8((float)m->material[k]);
        memset(out->material + 4 * at + 2, 0, 2);
    }
    if (in->emissive) {
        put_light(m->emissive, out->emissive + 4 * at);
        out->emissive[4 * at + 3] = 0;
    }
}

/* ---- octaves ---- */

static size_t surfels_between(const job *j, size_t all, size_t first, size_t end) {
    size_t n = 0;
    for (size_t i = 0; i < all; i++)
        if (j->surfels[i].rank >= first && j->surfels[i].rank < end) j->now[n++] = j->surfels[i];
    return n;
}

/* before: surfels that own already. */
static pbs_code octave(pbs_run *run, job *j, const pbs_points *in, const uint32_t *order,
                       const float *spacing, size_t finest, size_t before, size_t length,
                       pbs_points *out, pbs_err *err) {
    float radius2 = pbs_cover_radius2(&j->cover.tree->metric, spacing[length]);
    size_t n = surfels_between(j, finest, before, length);
    pbs_code rc = (pbs_cpu_has_avx2() ? pbs_cover_add_avx2 : pbs_cover_add)(run, &j->cover, j->now,
                                                                            n, radius2, false, err);
    if (!rc) rc = pbs_owned_sum(run, &j->owned, &j->cover, length, err);
    for (size_t i = 0; i < length && !rc; i++) {
        pbs_mean m;
        pbs_owned_mean(&j->owned, i, &m);
        put_entry(&m, in, order[i], out, out->count++);
    }
    return rc;
}

pbs_code pbs_average(pbs_averager *a, pbs_sampler *sampler, const pbs_points *in,
                     const uint32_t *order, const float *spacing, size_t surfels, pbs_points *out,
                     pbs_err *err) {
    int octaves = pbs_octaves(surfels);
    size_t finest = pbs_octave_length(surfels, 1);
    out->count = 0;
    if (!octaves) return PBS_OK;
    int parts = pbs_parts(a->run, in->count, PBS_TREE_PART);
    uint32_t channels = pbs_points_channels(in);
    pbs_code rc = reserve(a, need(channels, in->count, surfels, parts), err);
    if (rc) return rc;
    job j;
    pbs_layout l = {a->block, 0};
    lay_out(&j, channels, in->count, surfels, parts, &l);
    j.cover.tree = pbs_sampler_tree(sampler);
    j.cover.kind = PBS_COVER_METRIC;
    pbs_cover_find(j.cover.tree, order, finest, j.scratch, in->count, j.surfels);
    rc = pbs_owned_fill(a->run, &j.owned, in, j.cover.tree, err);
    if (!rc) rc = pbs_cover_begin(a->run, &j.cover, err);
    size_t before = 0;
    for (int k = octaves; k > 0 && !rc; k--) {
        size_t length = pbs_octave_length(surfels, k);
        rc = octave(a->run, &j, in, order, spacing, finest, before, length, out, err);
        before = length;
    }
    return rc;
}
