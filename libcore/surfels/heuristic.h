/* heuristic.h: the ways of choosing surfels that the greedy permutation is compared with. */
#ifndef PBS_HEURISTIC_H
#define PBS_HEURISTIC_H

#include "libcore/surfels/candidates.h"
#include "libcore/surfels/sample.h"

/* PBS_PAPER and PBS_RANDOM; as pbs_sample, with metric and invalid of the tree set, and
 * in->count - invalid > 0. The tree is built in the scratch. */
pbs_code pbs_heuristic_run(pbs_run *run, pbs_tree *t, const pbs_points *in,
                           const pbs_sample_params *params, pbs_layout scratch, uint32_t *order,
                           float *spacing, pbs_sample_result *result, pbs_err *err);

/* The choice of PBS_PAPER alone, without the covering radius: what the paper times. */
pbs_code pbs_paper_choose(pbs_run *run, const pbs_metric *m, const pbs_points *in,
                          const pbs_sample_params *params, pbs_layout scratch, uint32_t *order,
                          float *spacing, size_t *count, pbs_err *err);

/* Adds what these take from their layout. */
void pbs_heuristic_layout(size_t candidates, const pbs_sample_params *params, pbs_layout *scratch);
#endif
