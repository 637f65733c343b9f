/* metrics.h: how far a picture is from the truth.
 *
 * Pictures are 8-bit sRGB RGBA of equal size, rows top down; alpha is coverage (0: background). The
 * colours are compared as stored; a pixel counts as covered from alpha 128.
 */
#ifndef PBS_METRICS_H
#define PBS_METRICS_H

#include "libcore/data/mesh.h"
#include "libcore/ground/run.h"

typedef struct pbs_picture_error {
    double ssim;  /* mean structural similarity of luma, 11-tap gaussian, sigma 1.5 (Wang et al.
                     2004), over the pixels whose window lies in the picture; 1: equal */
    double psnr;  /* dB over r, g, b; infinite: equal */
    double max;   /* largest difference of a channel, 0 .. 255 */
    double hole;  /* of the pixels the truth covers, the share that the picture does not */
    double spill; /* of the pixels the picture covers, the share that the truth does not */
} pbs_picture_error;

/* Errors: PBS_DATA if the sizes differ or a side is under 11 pixels; PBS_LIMIT. */
pbs_code pbs_picture_compare(pbs_run *run, const pbs_image *picture, const pbs_image *truth,
                             pbs_picture_error *out, pbs_err *err);
#endif
