/* owned.h: the mean of the candidates that each surfel owns.
 *
 * A candidate is a row of 16-bit numbers that can be added up: linear light, alpha, material and
 * the normal. Sums are integers, so neither the order nor the number of threads matters.
 */
#ifndef PBS_OWNED_H
#define PBS_OWNED_H

#include "libcore/surfels/cover.h"

enum { PBS_OWNED_FEW = 8, PBS_OWNED_MOST = 16 };

typedef struct pbs_owned {
    const pbs_points *in;
    int lanes;                              /* of a row: 8 or 16, some unused */
    int colour, normal, material, emissive; /* first lane, or -1; lane 0 counts */
    uint16_t *row;                          /* of each slot */
    uint64_t *sum;                          /* of each surfel, and of each part after that */
} pbs_owned;

/* What a row holds, of those channels; says nothing yet about where the arrays are. */
void pbs_owned_init(pbs_owned *o, uint32_t channels);
/* Adds what they take. surfels: the most that will be summed for; parts as of pbs_parts_most. */
void pbs_owned_layout(pbs_owned *o, size_t slots, size_t surfels, int parts, pbs_layout *layout);
/* in: the candidates of the tree, borrowed. */
pbs_code pbs_owned_fill(pbs_run *run, pbs_owned *o, const pbs_points *in, const pbs_tree *t,
                        pbs_err *err);
/* Sums for surfels 0 .. count - 1. */
pbs_code pbs_owned_sum(pbs_run *run, pbs_owned *o, const pbs_cover *c, size_t count, pbs_err *err);

/* The mean of what surfel i owns: linear light and alpha, material, emitted light, 0 to 1; the
 * normal in any length, 0 where there is none. false: it owns nothing. */
typedef struct pbs_mean {
    double colour[4], material[2], emissive[3], normal[3];
} pbs_mean;
bool pbs_owned_mean(const pbs_owned *o, size_t i, pbs_mean *out);
#endif
