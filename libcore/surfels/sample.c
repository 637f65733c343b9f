#include "libcore/surfels/sample.h"
#include "libcore/surfels/candidates.h"
#include "libcore/surfels/greedy.h"
#include "libcore/surfels/heuristic.h"
#include "libcore/data/rng.h"
#include "libcore/surfels/sampler.h"
#include <stdlib.h>
#include <sys/mman.h>

struct pbs_sampler {
    pbs_run *run;
    void *block;
    size_t size;
    pbs_tree tree; /* of the last candidates; points 0: none */
};

pbs_code pbs_sampler_new(pbs_run *run, pbs_sampler **out, pbs_err *err) {
    if (!(*out = calloc(1, sizeof **out))) return pbs_fail(err, PBS_LIMIT, "no memory");
    (*out)->run = run;
    return PBS_OK;
}

void pbs_sampler_free(pbs_sampler *s) {
    if (!s) return;
    pbs_free(s->run, s->block);
    free(s);
}

static size_t wanted_of(size_t candidates, const pbs_sample_params *p) {
    return p->count < candidates ? p->count : candidates;
}

size_t pbs_sample_need(size_t candidates, const pbs_sample_params *p) {
    pbs_tree t;
    pbs_layout l = {NULL, 0};
    if (p->method == PBS_GREEDY) {
        pbs_tree_layout(&t, candidates, &l);
        pbs_greedy_layout(&t, candidates, &l);
        pbs_greedy_result_layout(candidates, wanted_of(candidates, p), &l);
    } else
        pbs_heuristic_layout(candidates, p, &l);
    return l.used + PBS_ALLOC_HEAD;
}

/* The tree is walked in all directions: with 4 KiB pages, finding the pages costs as much as the
 * walk. Nothing depends on whether the system agrees. */
static void ask_for_huge_pages(void *block, size_t size) {
    const uintptr_t huge = 2 << 20;
    uintptr_t begin = ((uintptr_t)block + huge - 1) / huge * huge;
    uintptr_t end = ((uintptr_t)block + size) / huge * huge;
    if (begin < end) madvise((void *)begin, end - begin, MADV_HUGEPAGE);
}

static pbs_code reserve(pbs_sampler *s, size_t size, pbs_err *err) {
    if (size <= s->size) return PBS_OK;
    pbs_free(s->run, s->block);
    s->block = NULL;
    s->size = 0;
    pbs_code rc = pbs_alloc(s->run, &s->block, size, 1, "sampling", err);
    if (rc) return rc;
    s->size = size;
    ask_for_huge_pages(s->block, size);
    return PBS_OK;
}

static pbs_code run_greedy(pbs_sampler *s, const pbs_points *in, const pbs_sample_params *p,
                           pbs_tree *t, uint32_t *order, float *spacing, pbs_sample_result *result,
                           pbs_err *err) {
    pbs_layout l = {s->block, 0};
    pbs_tree_layout(t, in->count, &l);
    bool wide = pbs_cpu_has_avx2();
    t->enough = pbs_metric_within(&t->metric, p->radius);
    pbs_code rc = (wide ? pbs_tree_build_avx2 : pbs_tree_build)(s->run, t, in, err);
    if (rc) return rc;
    size_t wanted = wanted_of(t->points, p);
    size_t first = pbs_random_below(pbs_random(p->seed, p->node, 0), (uint32_t)t->points);
    rc = (wide ? pbs_greedy_run_avx2 : pbs_greedy_run)(s->run, t, first, wanted, &l, err);
    if (rc) return rc;
    return (wide ? pbs_greedy_result_avx2 : pbs_greedy_result)(s->run, t, first, wanted, &l, order,
                                                               spacing, result, err);
}

pbs_tree *pbs_sampler_tree(pbs_sampler *s) {
    return s->tree.points ? &s->tree : NULL;
}

pbs_code pbs_sample(pbs_sampler *s, const pbs_points *in, const pbs_sample_params *params,
                    uint32_t *order, float *spacing, pbs_sample_result *result, pbs_err *err) {
    pbs_tree t = {0};
    s->tree.points = 0;
    *result = (pbs_sample_result){0};
    if (in->count > UINT32_MAX - 1)
        return pbs_fail(err, PBS_LIMIT, "%zu candidates in one node: at most %u are possible",
                        in->count, UINT32_MAX - 1);
    pbs_code rc = pbs_metric_set(s->run, &t.metric, in, params->normal_weight, &t.invalid, err);
    if (rc) return rc;
    result->invalid = t.invalid;
    if (t.invalid == in->count) return PBS_OK;
    if (params->count == 0) {
        result->covering = pbs_metric_length(&t.metric, INFINITY);
        return PBS_OK;
    }
    rc = reserve(s, pbs_sample_need(in->count, params) - PBS_ALLOC_HEAD, err);
    if (rc) return rc;
    if (params->method == PBS_GREEDY) {
        rc = run_greedy(s, in, params, &t, order, spacing, result, err);
    } else {
        pbs_layout l = {s->block, 0};
        rc = pbs_heuristic_run(s->run, &t, in, params, l, order, spacing, result, err);
    }
    if (!rc) s->tree = t;
    return rc;
}
