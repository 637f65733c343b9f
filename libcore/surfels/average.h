/* average.h: what the surfels of early prefixes look like from far away.
 *
 * Beyond the paper, which shows a prefix in the colours of its few candidates: here every prefix
 * that is four times shorter than the one before, an octave, has colours, normals and materials of
 * its own, the means over what its surfels stand for (surfel mipmaps, as Pfister and others store
 * them per surfel; here a pyramid over the order, a third of a record more).
 *
 * Of N surfels octave k = 1, 2, ... is the prefix of ceil(N / 4^k), as long as that is at least
 * PBS_OCTAVE_LEAST. Each candidate belongs to the nearest surfel of the prefix, exactly, in the
 * metric D of the sampling, ties to the earlier one; what is infinitely far from all to none.
 * Candidates weigh the same: they are pixels of a G-buffer, about as dense everywhere.
 */
#ifndef PBS_AVERAGE_H
#define PBS_AVERAGE_H

#include "libcore/surfels/sample.h"

#define PBS_OCTAVE_LEAST 16u

/* ceil(surfels / 4^octave); octave 0 is the whole. */
static inline size_t pbs_octave_length(size_t surfels, int octave) {
    for (; octave > 0; octave--) surfels = surfels / 4 + (surfels % 4 != 0);
    return surfels;
}
/* How many octaves there are beside the whole. */
static inline int pbs_octaves(size_t surfels) {
    int k = 0;
    while (pbs_octave_length(surfels, 1) >= PBS_OCTAVE_LEAST)
        surfels = pbs_octave_length(surfels, 1), k++;
    return k;
}
/* Where the entries of an octave begin, coarse first; of octave 0: how many there are. */
static inline size_t pbs_octave_begin(size_t surfels, int octave) {
    size_t sum = 0;
    for (int k = pbs_octaves(surfels); k > octave; k--) sum += pbs_octave_length(surfels, k);
    return sum;
}
/* The octave for a prefix: the largest k with prefix <= surfels / 4^k that there is. */
static inline int pbs_octave_of(size_t surfels, size_t prefix) {
    int k = pbs_octaves(surfels);
    while (k > 0 && pbs_octave_length(surfels, k) < prefix) k--;
    return k;
}

/* Scratch, reused between nodes. */
typedef struct pbs_averager pbs_averager;
pbs_code pbs_averager_new(pbs_run *run, pbs_averager **out, pbs_err *err);
void pbs_averager_free(pbs_averager *a); /* NULL is fine */

/* Bytes that pbs_average needs beside the caller's arrays, for pbs_mem_plan. */
size_t pbs_average_need(uint32_t channels, size_t candidates, size_t surfels);

/* The octaves of the order that the sampler has just made of `in`: nothing may have been sampled
 * in between. order, spacing and surfels (result->count) as pbs_sample gave them. out has arrays
 * for pbs_octave_begin(surfels, 0) entries in those of normal, colour, material and emissive that
 * `in` has, coarse octaves first; its count is set. The same for any number of threads. A normal
 * whose mean has no direction is the surfel's own. Errors: PBS_LIMIT, PBS_CANCEL. */
pbs_code pbs_average(pbs_averager *a, pbs_sampler *sampler, const pbs_points *in,
                     const uint32_t *order, const float *spacing, size_t surfels, pbs_points *out,
                     pbs_err *err);
#endif
