/* morton.h: voxels of a chunk along the Morton curve: whether they are in order, and made so.
 */
#ifndef PBS_MORTON_H
#define PBS_MORTON_H

#include "libcore/run.h"
#include "libcore/voxel.h"

/* Whether chunk or cell a comes before b. */
bool pbs_morton_before(const uint32_t a[3], const uint32_t b[3]);

/* Whether the cells come in order, each once. last: the place before, and the last one after it; at
 * first PBS_NO_PLACE. */
#define PBS_NO_PLACE UINT32_MAX
bool pbs_morton_sorted(const uint32_t *place, size_t n, uint32_t *last);

/* Least and largest coordinates; both are kept where they are less or larger. */
void pbs_place_bounds(const uint32_t *place, size_t n, uint8_t low[3], uint8_t high[3]);

/* Which of 64 cubes of 64^3 cells a cell is in, counted along the curve. */
uint32_t pbs_morton_digit(uint32_t place);

/* Which voxel comes first, second ...: order[0 .. n - 1]. Takes 1.1 MiB. Errors: PBS_DATA if a cell
 * comes twice, PBS_LIMIT. */
pbs_code pbs_morton_sort(pbs_run *run, const uint32_t *place, size_t n, uint32_t *order,
                         pbs_err *err);
#endif
