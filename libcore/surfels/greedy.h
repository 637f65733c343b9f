/* greedy.h: the exact greedy permutation (paper 1, section 3.3) of the candidates in a tree. */
#ifndef PBS_GREEDY_H
#define PBS_GREEDY_H

#include "libcore/surfels/candidates.h"
#include "libcore/surfels/sample.h"

typedef struct pbs_greedy pbs_greedy; /* scratch */

/* Chooses surfels, `first` (a slot) first, until at least `wanted` are chosen or every candidate
 * has d <= t->enough. Those chosen have d < 0 in the tree. There may be some more than wanted; each
 * has the value and the place in the order that it would have if one were chosen after the other.
 * The second is the same function compiled for AVX2; it may be called where the CPU has that. */
pbs_code pbs_greedy_run(pbs_run *run, pbs_tree *t, size_t first, size_t wanted, pbs_layout *scratch,
                        pbs_err *err);
pbs_code pbs_greedy_run_avx2(pbs_run *run, pbs_tree *t, size_t first, size_t wanted,
                             pbs_layout *scratch, pbs_err *err);

/* Makes one candidate a surfel, whichever, and brings the whole tree up to date. Returns the d it
 * had; 0: it coincides with a surfel, or is one, and nothing is done. */
float pbs_greedy_take(pbs_tree *t, size_t slot);
float pbs_greedy_take_avx2(pbs_tree *t, size_t slot);

/* Adds what pbs_greedy_run takes from its layout. */
void pbs_greedy_layout(const pbs_tree *t, size_t candidates, pbs_layout *scratch);
void pbs_greedy_layout_avx2(const pbs_tree *t, size_t candidates, pbs_layout *scratch);

/* Reads the result off the tree: the first `wanted` in order, their spacing, and the rest of
 * *result but `invalid`. Changes the d of the tree. */
pbs_code pbs_greedy_result(pbs_run *run, pbs_tree *t, size_t first, size_t wanted,
                           pbs_layout *scratch, uint32_t *order, float *spacing,
                           pbs_sample_result *result, pbs_err *err);
pbs_code pbs_greedy_result_avx2(pbs_run *run, pbs_tree *t, size_t first, size_t wanted,
                                pbs_layout *scratch, uint32_t *order, float *spacing,
                                pbs_sample_result *result, pbs_err *err);
void pbs_greedy_result_layout(size_t candidates, size_t wanted, pbs_layout *scratch);
void pbs_greedy_result_layout_avx2(size_t candidates, size_t wanted, pbs_layout *scratch);
#endif
