/* near.h: the nearest of a growing set of surfels, for the heuristics.
 *
 * A hash grid whose cells follow the spacing: a query looks at the 2 x 2 x 2 cells around it, and
 * at more only if the nearest so far is farther away than they reach.
 */
#ifndef PBS_NEAR_H
#define PBS_NEAR_H

#include "libcore/surfels/candidates.h"

typedef struct pbs_near {
    const pbs_metric *m;
    pbs_place *place, *sorted; /* surfels in the order they came; the first `built` by bucket */
    uint32_t *begin;           /* of each bucket in sorted; buckets + 3 */
    uint32_t *head, *next;     /* the others, as one list a bucket; place index + 1, 0 ends */
    size_t count, built;
    uint32_t buckets; /* a power of two, less than half full on average */
    float cell;       /* its side, scaled */
} pbs_near;

void pbs_near_layout(pbs_near *g, size_t surfels, pbs_layout *layout);
void pbs_near_init(pbs_near *g, const pbs_metric *m);
/* D^2 to the nearest surfel; infinite if there is none. */
float pbs_near_d2(const pbs_near *g, const pbs_place *at);
/* spacing: D^2 of the newest surfels to the earlier ones, from which the cells' size follows. */
void pbs_near_add(pbs_near *g, const pbs_place *at, float spacing);
#endif
