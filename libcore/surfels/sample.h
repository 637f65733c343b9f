/* sample.h: from candidates to an ordered set of surfels (paper 1, sections 3.2 and 3.3).
 *
 * The result is an order: surfel i is candidate order[i], and every prefix is the best that can be
 * said about the surface with so many surfels. spacing[i] is the distance of surfel i to the
 * nearest of the surfels before it, in the metric of `params`; for the exact method it never
 * rises, and it is the covering radius of the prefix of length i: no candidate is farther from
 * that prefix (paper 1, section 4.1: p(r) is a search in it, not an estimate).
 *
 * Metric, beyond the paper (its section 6 names thin walls as open):
 *
 *     D^2(p, q) = |p - q|^2 / (1 - w^2 (1 - n.n') / 2)
 *
 * w = 0 is plain Euclid; w = 1 is |p-q| / cos(angle / 2): the way along a circle for small angles,
 * infinite between the two sides of a wall. Candidates without normals: Euclid.
 *
 * Precisely: normals are rounded to 16 bits an axis, D is computed in float. A denominator up to
 * 2^-14 (for w = 1: normals 179.1 degrees apart) makes D infinite, whatever the distance, so both
 * sides of a sheet without thickness are sampled. Distances below 2^-128 of the box's longest side
 * count as 0. Lengths in the result are finite: what is longer than spacing[0] is given as that.
 */
#ifndef PBS_SAMPLE_H
#define PBS_SAMPLE_H

#include "libcore/data/record.h"
#include "libcore/ground/run.h"

typedef enum pbs_method {
    PBS_GREEDY, /* the exact greedy permutation: farthest candidate next, ties to the lower
                   index; same result for any number of threads */
    PBS_PAPER,  /* paper 1, 3.2 as printed: of `subset` random candidates the farthest; one more
                   accepted per round after each 500 rounds */
    PBS_RANDOM  /* uniformly random: the paper's lower bound for comparison */
} pbs_method;

typedef struct pbs_sample_params {
    size_t count; /* surfels wanted; fewer come out if there are fewer distinct candidates */
    pbs_method method;
    float normal_weight; /* w above, 0 .. 1 */
    uint64_t seed;       /* with the node decides the first surfel, and the heuristics' choices */
    uint32_t node;
    uint32_t subset; /* PBS_PAPER: 0 means 200 */
    float radius;    /* PBS_GREEDY: the order ends where the covering radius is at most this, to
                        one in a million; 0: it does not */
} pbs_sample_params;

typedef struct pbs_sample_result {
    size_t count;      /* entries written */
    float covering;    /* covering radius of the whole result: max over all candidates of the
                          distance to the nearest surfel; 0 if every candidate is covered */
    size_t duplicates; /* candidates left out because they coincide with a surfel (D = 0) */
    size_t invalid;    /* candidates left out because a coordinate is not finite */
} pbs_sample_result;

/* Scratch memory, reused between nodes (fresh pages cost as much as the sampling). */
typedef struct pbs_sampler pbs_sampler;
pbs_code pbs_sampler_new(pbs_run *run, pbs_sampler **out, pbs_err *err);
void pbs_sampler_free(pbs_sampler *s); /* NULL is fine */

/* Bytes that pbs_sample needs beside the caller's arrays, for pbs_mem_plan. */
size_t pbs_sample_need(size_t candidates, const pbs_sample_params *params);

/* in: at least position; at most 2^32 - 2 candidates. order and spacing have room for
 * min(params->count, in->count) entries and belong to the caller. spacing[0] is the largest
 * finite distance there is a use for: the length of the diagonal of the candidates' box.
 * Nothing else of `in` is read than position and normal. For the heuristics spacing[i] is likewise
 * the distance to the nearest earlier surfel, but it may rise. Errors: PBS_LIMIT, PBS_CANCEL. */
pbs_code pbs_sample(pbs_sampler *s, const pbs_points *in, const pbs_sample_params *params,
                    uint32_t *order, float *spacing, pbs_sample_result *result, pbs_err *err);
#endif
