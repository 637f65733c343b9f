/* morton.h: voxels of a chunk along the Morton curve: whether they are in order, and made so.
 */
#ifndef PBS_MORTON_H
#define PBS_MORTON_H

#include "libcore/ground/run.h"
#include "libcore/voxels/voxel.h"

/* Whether chunk or cell a comes before b. */
bool pbs_morton_before(const uint32_t a[3], const uint32_t b[3]);

/* What is known of cells that were looked at, some after the others. */
#define PBS_NO_PLACE UINT32_MAX
typedef struct pbs_place_look {
    uint32_t last;           /* the place of the last one; PBS_NO_PLACE: of none */
    bool sorted;             /* they came in order, each once */
    uint8_t low[3], high[3]; /* least and largest coordinates */
    uint32_t any;            /* all places, OR */
} pbs_place_look;
#define PBS_LOOK_NONE ((pbs_place_look){PBS_NO_PLACE, true, {255, 255, 255}, {0, 0, 0}, 0})
void pbs_look_at_places(pbs_place_look *look, const uint32_t *place, size_t n);
/* Whether all are finite and none is negative. */
bool pbs_are_areas(const float *area, size_t n);

/* Which of 64 cubes of 64^3 cells a cell is in, counted along the curve. */
uint32_t pbs_morton_digit(uint32_t place);

/* Which voxel comes first, second ...: order[0 .. n - 1]. Takes 1.1 MiB. Errors: PBS_DATA if a cell
 * comes twice, PBS_LIMIT. */
pbs_code pbs_morton_sort(pbs_run *run, const uint32_t *place, size_t n, uint32_t *order,
                         pbs_err *err);
#endif
