/* measure.h: how good a prefix of surfels is, against all candidates; exact.
 *
 * Beyond paper 1, section 3.3, which looks at spacing only. Lengths are in the caller's unit, and
 * plain (Euclid) where nothing else is said. D is the metric of sample.h, with the weight given.
 */
#ifndef PBS_MEASURE_H
#define PBS_MEASURE_H

#include "libcore/surfels/sample.h"

typedef struct pbs_measures {
    size_t surfels; /* of the prefix */
    /* Distance of a surfel to the nearest other one; 0 if there are fewer than two. */
    double min_spacing, median_spacing; /* the median of an even number is the upper one */
    /* Distance of the worst candidate to its nearest surfel; INFINITY in D: no surfel is at a
     * finite distance from it. */
    double covering, covering_d;
    /* Wrong-side holes. Of a candidate only surfels on its side count, n.n' > 0. holes is the
     * share of the candidates, 0 to 1, that have none of those within 1.25 radius: what is drawn
     * there has its back to the viewer, or comes from the other side of a wall. 0 without
     * normals. */
    double radius, holes;
    /* RMS difference, in 1/255 of sRGB, of a surfel's colour from the mean (in linear light) of the
     * candidates that are nearest to it in D: of its own colour, and of `averaged`. 0 without. */
    double colour_own, colour_averaged;
} pbs_measures;

/* The candidates of a node, prepared; `in` is borrowed. normal_weight: w of D. */
typedef struct pbs_measurer pbs_measurer;
pbs_code pbs_measurer_new(pbs_run *run, const pbs_points *in, float normal_weight,
                          pbs_measurer **out, pbs_err *err);
void pbs_measurer_free(pbs_measurer *m); /* NULL is fine */
/* Bytes that a measurer takes in all, prefixes of up to `surfels` included, for pbs_mem_plan. */
size_t pbs_measurer_need(uint32_t channels, size_t candidates, size_t surfels);

/* order: valid candidates, each once. radius: R of the holes; 0: the prefix's own covering radius.
 * averaged: colours to judge, 4 bytes a surfel, or NULL. Errors: PBS_LIMIT, PBS_CANCEL. */
pbs_code pbs_measure(pbs_measurer *m, const uint32_t *order, size_t surfels, double radius,
                     const uint8_t *averaged, pbs_measures *out, pbs_err *err);
#endif
