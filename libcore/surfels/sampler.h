/* sampler.h: what a sampler lets the rest of libcore see of its scratch. */
#ifndef PBS_SAMPLER_H
#define PBS_SAMPLER_H

#include "libcore/surfels/candidates.h"
#include "libcore/surfels/sample.h"

/* The tree of the candidates that were sampled last; its d and maxima are anything. It is the
 * caller's until the next pbs_sample. NULL if nothing was sampled, or no candidate is valid. */
pbs_tree *pbs_sampler_tree(pbs_sampler *s);
#endif
