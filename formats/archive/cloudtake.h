/* cloudtake.h: what cloudtake.c and cloudlattice.c share: the points of clouds are measured, and
 * what lattice they go onto. */
#ifndef PBS_FORMAT_CLOUDTAKE_H
#define PBS_FORMAT_CLOUDTAKE_H

#include "formats/archive/cloudpack.h"

/* What the files' numbers become: value * mul + add, in steps. */
typedef struct pbs_cloud_map {
    double mul[3], add[3];
    bool whole; /* value + plus, modulo 2^32, is the same */
    uint32_t plus[3];
    int colour_shift;
} pbs_cloud_map;

typedef struct pbs_cloud_bounds {
    double low[3], high[3]; /* values of the file */
    uint64_t bad;
    uint16_t colour; /* all bits of all colours */
} pbs_cloud_bounds;

#define PBS_CLOUD_NOTHING                                                                          \
    ((pbs_cloud_bounds){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}, 0, 0})

static inline void pbs_cloud_bounds_merge(pbs_cloud_bounds *to, const pbs_cloud_bounds *b) {
    for (int k = 0; k < 3; k++) {
        to->low[k] = b->low[k] < to->low[k] ? b->low[k] : to->low[k];
        to->high[k] = b->high[k] > to->high[k] ? b->high[k] : to->high[k];
    }
    to->bad += b->bad;
    to->colour |= b->colour;
}

/* The depth of the grid that cells are counted in first. */
int pbs_cloud_grid_depth(uint64_t points, int bits);

/* The lattice, and of each cloud its map, from the bounds of each. If files have a lattice, and
 * stay exact, its origin is a corner of the grid's cells wherever the points begin: a cell has the
 * same points whatever the bounds are. Errors: PBS_DATA, no points, or too far apart. */
pbs_code pbs_cloud_lattice_choose(const pbs_cloud *clouds, size_t count,
                                  const pbs_cloud_bounds *bounds, uint64_t points,
                                  pbs_cloud_lattice *l, pbs_cloud_map *maps, pbs_err *err);

/* Cells of 2^16 steps hold few points if the lattice is much finer than the cloud: nearly every
 * point would be a node. Then the lattice is made coarser. Files that have a lattice keep it as
 * long as that can be borne. Returns how often it is halved; g is counted, `all` the cubes that can
 * be borne. */
int pbs_cloud_too_fine(const pbs_cloud_lattice *l, const pbs_clod_grid *g, uint64_t points,
                       double all);

/* Sets how colours become 8 bits, one answer for all files: a dark tile is not a file of 8 bits. */
void pbs_cloud_choose_colours(const pbs_cloud *clouds, size_t count, const pbs_cloud_bounds *bounds,
                              pbs_cloud_map *maps);
#endif
