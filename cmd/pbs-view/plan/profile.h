/* profile.h: how the prefixes of a node get denser: all that the cut knows of its spacings, so that
 * these need not be in the host's memory (paper 1, section 4.1).
 *
 * A node's surfels are a greedy permutation, and every surfel carries its spacing: the distance to
 * the nearest of the surfels before it. spacing[p] is the covering radius of the prefix of length
 * p: every other surfel of the node is within that distance of one in the prefix. So the paper's
 * p(r) = p_m (r_m / r)^2, an estimate, becomes a search in a table that falls. A profile has that
 * table at PBS_PROFILE_STEPS radii from the largest to the smallest, in equal ratios: whoever asks
 * gets a prefix that is never coarser than asked for, and of a node of 200k surfels at most 9 %
 * longer than needed.
 */
#ifndef PBS_PROFILE_H
#define PBS_PROFILE_H

#include "formats/scene/node.h"

/* Spacings as they lie in the records: little-endian half floats, never rising. */
typedef struct pbs_spacings {
    const uint8_t *first; /* the spacing of surfel 0, not its record */
    size_t stride;        /* bytes from one to the next */
    uint32_t count;
    double unit;     /* length in the node's unit that the value 1 stands for */
    double covering; /* covering radius of all surfels, node's unit; 0: not known */
    double slack;    /* how far the surface can be from the candidates that spacings are
                        measured on, about 0.7 pixels of the G-buffer; node's unit. Without
                        it 1 in 5000 pixels is a pinhole, with it none (sphere, 50
                        candidates a surfel); 5% more radius do as much there. */
} pbs_spacings;

enum { PBS_PROFILE_STEPS = 140 };

typedef struct pbs_profile {
    uint32_t count;
    double top;         /* spacing of surfel 0, node's unit like all lengths here */
    double first, last; /* of surfel 1 and of the last one; of surfel 0 where it is alone */
    double covering, slack;
    double ratio; /* step i is at first * ratio^i, the last at `last` or 2^-20 of the first */
    uint32_t longer[PBS_PROFILE_STEPS]; /* surfels whose spacing is above the step's */
} pbs_profile;

/* Of records of any order: what is not sound gives another prefix, and nothing worse. */
void pbs_profile_make(const pbs_spacings *s, pbs_profile *out);

/* A radius with which discs of the first `prefix` surfels close the surface: covering radius and
 * slack, node's unit. A prefix of 0 counts as 1, more than all as all. */
double pbs_profile_radius(const pbs_profile *p, uint32_t prefix);

/* A prefix whose pbs_profile_radius is at most `radius`, and at most one step longer than the
 * shortest; all if there is none. */
uint32_t pbs_profile_prefix(const pbs_profile *p, double radius);

/* Of points whose spacing is that of their level: the prefix of those with at least `radius`, or a
 * little more; the ones behind are closer together than such discs are wide. */
uint32_t pbs_profile_adding(const pbs_profile *p, double radius);

/* The paper's own estimate, p_m (r_m / r)^2, of a node that knows r_m and p_m (node.h: median);
 * 1 to all. And the radius for which it gives `prefix`. 0: the node does not know them. */
uint32_t pbs_formula_prefix(const pbs_node *n, double radius);
double pbs_formula_radius(const pbs_node *n, uint32_t prefix);
#endif
