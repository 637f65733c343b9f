/* part.h: a node that is larger than a buffer may be lies in several, and is drawn part by part:
 * which of its records are in one of them. Arithmetic only. */
#ifndef PBS_PART_H
#define PBS_PART_H

#include "libcore/surfels/average.h"

typedef struct pbs_part {
    uint32_t before; /* records of the node before this part's first one */
    uint32_t here;   /* records of this part; 0: the part is the whole node */
    uint32_t prefix; /* drawn of the whole node; looked at where here is not 0 */
} pbs_part;

/* A part has of every octave the entries of its own records, coarse octaves first. Of how many
 * octave k has entries here, and how many entries are before them: */
static inline size_t pbs_part_octave_length(pbs_part p, size_t whole, int k) {
    size_t n = pbs_octave_length(whole, k);
    if (!p.here) return n;
    n = n > p.before ? n - p.before : 0;
    return n < p.here ? n : p.here;
}
static inline size_t pbs_part_octave_begin(pbs_part p, size_t whole, int octave) {
    size_t sum = 0;
    for (int k = pbs_octaves(whole); k > octave; k--) sum += pbs_part_octave_length(p, whole, k);
    return sum;
}
#endif
