/* spacing.h: how even a prefix of surfels is (paper 1, sections 3.3 and 4.1). */
#ifndef PBS_SPACING_H
#define PBS_SPACING_H

#include "libcore/data/record.h"
#include "libcore/ground/run.h"

typedef struct pbs_spacing {
    uint32_t count;          /* points looked at */
    double min, median, max; /* of the distance of each to its nearest neighbour (Euclid); 0 if
                                there are fewer than two points */
} pbs_spacing;

/* Of the first min(count, PBS_SPACING_COUNT) points. */
#define PBS_SPACING_COUNT 1000u
void pbs_spacing_of_prefix(const pbs_points *p, pbs_spacing *out);
#endif
