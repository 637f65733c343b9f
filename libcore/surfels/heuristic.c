/* The paper's heuristic, as its text has it (paper 1, section 3.2), and plain random choice. */
#include "libcore/surfels/heuristic.h"
#include "libcore/surfels/greedy.h"
#include "libcore/surfels/near.h"
#include "libcore/data/rng.h"
#include <string.h>

enum { SUBSET = 200, MORE_AFTER = 500 };

static size_t wanted_of(size_t candidates, const pbs_sample_params *p) {
    return p->count < candidates ? p->count : candidates;
}

static size_t subset_of(size_t candidates, const pbs_sample_params *p) {
    size_t s = p->subset ? p->subset : SUBSET;
    return s < candidates ? s : candidates;
}

/* ---- the paper's ---- */

/* One of a round's random candidates. */
typedef struct drawn {
    pbs_place at;
    float d2;
    uint32_t id, at_left; /* where it is in left[] */
} drawn;

typedef struct paper {
    const pbs_metric *m;
    const pbs_points *in;
    uint64_t random; /* of seed and node */
    uint64_t draws;
    uint32_t *left; /* candidates that are neither surfels nor removed */
    size_t lefts;
    bool *gone;  /* of the subset */
    drawn *best; /* the farthest of the subset, farthest first */
    size_t bests;
    pbs_near near;
} paper;

static void paper_layout(paper *p, size_t candidates, const pbs_sample_params *params,
                         pbs_layout *l) {
    size_t subset = subset_of(candidates, params);
    p->left = pbs_layout_take(l, candidates * sizeof *p->left);
    p->gone = pbs_layout_take(l, subset * sizeof *p->gone);
    p->best = pbs_layout_take(l, (subset + 1) * sizeof *p->best);
    pbs_near_layout(&p->near, wanted_of(candidates, params), l);
}

static bool comes_before(const drawn *a, const drawn *b) {
    return a->d2 > b->d2 || (a->d2 == b->d2 && a->id < b->id);
}

/* Keeps the farthest `most`. */
static void keep_best(paper *p, const drawn *x, size_t most) {
    size_t i = p->bests;
    if (i == most && !comes_before(x, &p->best[i - 1])) return;
    if (i < most)
        p->bests++;
    else
        i--;
    for (; i > 0 && comes_before(x, &p->best[i - 1]); i--) p->best[i] = p->best[i - 1];
    p->best[i] = *x;
}

/* Draws a random subset to the front of left[], and keeps the farthest of it. */
static void draw(paper *p, size_t subset, size_t most) {
    for (size_t i = 0; i < subset; i++) {
        uint64_t r = pbs_mix64(p->random + p->draws++);
        size_t j = i + pbs_random_below(r, (uint32_t)(p->lefts - i));
        uint32_t id = p->left[j];
        p->left[j] = p->left[i];
        p->left[i] = id;
        __builtin_prefetch(p->in->position + 3 * (size_t)id);
        if (p->m->normals) __builtin_prefetch(p->in->normal + 2 * (size_t)id);
    }
    p->bests = 0;
    for (size_t i = 0; i < subset; i++) {
        drawn x = {.id = p->left[i], .at_left = (uint32_t)i};
        pbs_place_of(p->m, p->in, x.id, &x.at);
        x.d2 = pbs_near_d2(&p->near, &x.at);
        p->gone[i] = x.d2 == 0; /* coincides with a surfel */
        if (!p->gone[i]) keep_best(p, &x, most);
    }
}

static void remove_gone(paper *p, size_t subset) {
    for (size_t i = subset; i-- > 0;)
        if (p->gone[i]) p->left[i] = p->left[--p->lefts];
}

static size_t accept(paper *p, size_t made, size_t wanted, uint32_t *order, float *spacing) {
    size_t before = made;
    float farthest = p->bests ? p->best[0].d2 : 0;
    for (size_t i = 0; i < p->bests && made < wanted; i++) {
        drawn *x = &p->best[i];
        p->gone[x->at_left] = true;
        /* Those accepted in the same round count as earlier ones. */
        for (size_t j = before; j < made; j++) {
            float d2 = pbs_metric_d2(p->m, &p->near.place[j], &x->at);
            x->d2 = d2 < x->d2 ? d2 : x->d2;
        }
        if (x->d2 == 0) continue;
        order[made] = x->id;
        spacing[made++] = pbs_metric_length(p->m, x->d2);
        pbs_near_add(&p->near, &x->at, farthest);
    }
    return made;
}

static void start(paper *p) {
    pbs_place at;
    for (size_t i = 0; i < p->in->count; i++)
        if (pbs_place_of(p->m, p->in, i, &at)) p->left[p->lefts++] = (uint32_t)i;
    pbs_near_init(&p->near, p->m);
}

pbs_code pbs_paper_choose(pbs_run *run, const pbs_metric *m, const pbs_points *in,
                          const pbs_sample_params *params, pbs_layout scratch, uint32_t *order,
                          float *spacing, size_t *count, pbs_err *err) {
    paper p = {.m = m, .in = in, .random = pbs_random(params->seed, params->node, 1)};
    paper_layout(&p, in->count, params, &scratch);
    size_t wanted = wanted_of(in->count, params), made = 0;
    pbs_code rc = PBS_OK;
    start(&p);
    for (size_t round = 0; made < wanted && p.lefts && !rc; round++) {
        /* The first surfel is any one. */
        size_t subset = round ? subset_of(p.lefts, params) : 1;
        size_t most = 1 + round / MORE_AFTER;
        draw(&p, subset, most < subset ? most : subset);
        made = accept(&p, made, wanted, order, spacing);
        remove_gone(&p, subset);
        if (round % 64) continue;
        pbs_run_progress(run, "sampling", made, wanted);
        rc = pbs_run_check(run, err);
    }
    *count = made;
    return rc;
}

/* ---- any order: spacing and covering from the tree ---- */

static void finish(const pbs_tree *t, size_t made, pbs_sample_result *result) {
    float most = 0;
    size_t zero = 0;
    for (size_t i = 0; i < t->points; i++) {
        float d = t->leaf[i / PBS_LEAF].d[i % PBS_LEAF];
        most = d > most ? d : most;
        zero += d == 0;
    }
    result->covering = pbs_metric_length(&t->metric, most);
    result->duplicates = zero;
    result->count = made;
}

/* Goes through order[] again to see what it covers. slot: room for all candidates. */
static pbs_code cover(pbs_run *run, pbs_tree *t, const uint32_t *order, size_t made, uint32_t *slot,
                      pbs_err *err) {
    float (*take)(pbs_tree *, size_t) = pbs_cpu_has_avx2() ? pbs_greedy_take_avx2 : pbs_greedy_take;
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < t->points; i++) slot[t->id[i]] = (uint32_t)i;
    for (size_t i = 0; i < made && !rc; i++) {
        take(t, slot[order[i]]);
        if (i % 64 == 0) rc = pbs_run_check(run, err);
    }
    return rc;
}

static pbs_code choose_random(pbs_run *run, pbs_tree *t, const pbs_sample_params *params,
                              uint32_t *slot, uint32_t *order, float *spacing, size_t *made,
                              pbs_err *err) {
    float (*take)(pbs_tree *, size_t) = pbs_cpu_has_avx2() ? pbs_greedy_take_avx2 : pbs_greedy_take;
    uint64_t random = pbs_random(params->seed, params->node, 2);
    size_t wanted = wanted_of(t->points, params);
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < t->points; i++) slot[i] = (uint32_t)i;
    for (size_t i = 0; i < t->points && *made < wanted && !rc; i++) {
        size_t j = i + pbs_random_below(pbs_mix64(random + i), (uint32_t)(t->points - i));
        uint32_t s = slot[j];
        slot[j] = slot[i];
        float d2 = take(t, s);
        if (d2 == 0) continue; /* coincides with an earlier one */
        order[*made] = t->id[s];
        spacing[(*made)++] = pbs_metric_length(&t->metric, d2);
        if (i % 64 == 0) rc = pbs_run_check(run, err);
    }
    return rc;
}

pbs_code pbs_heuristic_run(pbs_run *run, pbs_tree *t, const pbs_points *in,
                           const pbs_sample_params *params, pbs_layout scratch, uint32_t *order,
                           float *spacing, pbs_sample_result *result, pbs_err *err) {
    pbs_code rc = PBS_OK;
    size_t made = 0;
    if (params->method == PBS_PAPER)
        rc = pbs_paper_choose(run, &t->metric, in, params, scratch, order, spacing, &made, err);
    pbs_tree_layout(t, in->count, &scratch);
    uint32_t *slot = pbs_layout_take(&scratch, in->count * sizeof *slot);
    if (!rc) rc = (pbs_cpu_has_avx2() ? pbs_tree_build_avx2 : pbs_tree_build)(run, t, in, err);
    if (!rc && params->method == PBS_PAPER)
        rc = cover(run, t, order, made, slot, err);
    else if (!rc)
        rc = choose_random(run, t, params, slot, order, spacing, &made, err);
    if (!rc) finish(t, made, result);
    return rc;
}

void pbs_heuristic_layout(size_t candidates, const pbs_sample_params *params, pbs_layout *scratch) {
    pbs_layout choice = {NULL, 0}, rest = {NULL, 0};
    paper p;
    pbs_tree t;
    if (params->method == PBS_PAPER) paper_layout(&p, candidates, params, &choice);
    pbs_tree_layout(&t, candidates, &rest);
    pbs_layout_take(&rest, candidates * sizeof(uint32_t));
    /* The tree comes after the choice, in the same place. */
    pbs_layout_take(scratch, choice.used > rest.used ? choice.used : rest.used);
}
