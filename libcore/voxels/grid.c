#include "libcore/voxels/grid.h"

pbs_grid pbs_grid_around(const pbs_box *box, uint32_t size) {
    pbs_grid g = {.size = size};
    double longest = 0;
    for (int k = 0; k < 3; k++) longest = fmax(longest, box->max[k] - box->min[k]);
    /* The longest side takes size - 1 cells, so that half a one is left at both ends. */
    g.voxel = longest > 0 ? longest / (size > 1 ? size - 1 : 0.5) : 1;
    double margin = g.voxel * (size > 1 || !(longest > 0) ? 0.5 : 0.25);
    for (int k = 0; k < 3; k++) g.min[k] = box->min[k] - margin;
    return g;
}

bool pbs_to_grid_make(pbs_to_grid *out, const pbs_grid *grid, const double m[12]) {
    bool fine = true;
    for (int r = 0; r < 3; r++) {
        double t = (m[4 * r + 3] - grid->min[r]) / grid->voxel;
        for (int c = 0; c < 3; c++) {
            out->m[3 * r + c] = m[4 * r + c] / grid->voxel;
            fine = fine && fabs(out->m[3 * r + c]) < INFINITY;
        }
        out->whole[r] = floor(t);
        out->part[r] = t - out->whole[r];
        fine = fine && fabs(t) < 0x1p52;
    }
    return fine;
}
