/* lod.c: thresholds of the hierarchy (paper 1, sections 3.4 and 5). */
#include "libcore/gbuffer/lod.h"
#include "libcore/gbuffer/gbuffer.h"

uint32_t pbs_lod_count(const pbs_lod *lod, uint64_t triangles, bool top) {
    double most = (double)lod->most, share = lod->share * (double)triangles;
    if (!triangles || (!top && triangles < lod->least)) return 0;
    double n = top || share > most ? most : floor(share);
    return n < UINT32_MAX ? (uint32_t)n : UINT32_MAX;
}

uint32_t pbs_lod_resolution(const pbs_lod *lod, uint32_t count, double side) {
    double r = ceil(sqrt(10.0 * count));
    if (lod->error > 0) r = fmin(r, ceil(PBS_LOD_ERROR * side / lod->error));
    if (lod->resolution) r = ceil(lod->resolution * sqrt(count / (double)lod->most));
    /* What the user asks for may be less. */
    double least = lod->resolution && lod->resolution < 64 ? lod->resolution : 64;
    return (uint32_t)fmin(fmax(r, least), PBS_GBUFFER_MAX_SIZE);
}

double pbs_lod_stretch(const double m[12]) {
    /* Largest eigenvalue of A = M^T M, by the cosine formula for symmetric 3x3 matrices, scaled
     * so that squares neither vanish nor overflow. */
    double a[6], scale = 0;
    for (int i = 0; i < 12; i++)
        if (i % 4 < 3) scale = fmax(scale, fabs(m[i]));
    if (!(scale > 0) || !isfinite(scale)) return scale;
    for (int i = 0; i < 6; i++) {
        static const int row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
        a[i] = 0;
        for (int k = 0; k < 3; k++)
            a[i] += m[4 * k + row[i]] / scale * (m[4 * k + column[i]] / scale);
    }
    double mean = (a[0] + a[1] + a[2]) / 3, x = a[0] - mean, y = a[1] - mean, z = a[2] - mean;
    double off = a[3] * a[3] + a[4] * a[4] + a[5] * a[5];
    double spread = sqrt((x * x + y * y + z * z + 2 * off) / 6);
    if (!(spread > 0)) return sqrt(mean) * scale;
    double det = x * (y * z - a[5] * a[5]) - a[3] * (a[3] * z - a[5] * a[4]) +
                 a[4] * (a[3] * a[5] - y * a[4]);
    double c = fmin(1, fmax(-1, det / (2 * spread * spread * spread)));
    return sqrt(mean + 2 * spread * cos(acos(c) / 3)) * scale;
}

bool pbs_lod_keeps_views(const double m[12]) {
    double stretch = pbs_lod_stretch(m);
    for (int r = 0; r < 3; r++) {
        int ones = 0;
        for (int c = 0; c < 3; c++) {
            double v = fabs(m[4 * r + c]) / stretch;
            if (!(v < 0.01 || v > 0.99)) return false;
            ones += v > 0.5;
        }
        if (ones != 1) return false;
    }
    return true; /* no column has two, since none is longer than the stretch */
}

bool pbs_lod_fine(const pbs_box *box, double below, const double m[12], double pixel) {
    double stretch = pbs_lod_stretch(m), size = 0;
    if (!(below > 0) || !(below * stretch * PBS_LOD_SPACING <= PBS_LOD_DENSE * pixel)) return false;
    for (int k = 0; k < 3; k++) size = fmax(size, box->max[k] - box->min[k]);
    return size * stretch <= PBS_LOD_ANY_ANGLE * pixel || pbs_lod_keeps_views(m);
}
