/* draw_probe.h: what lies under a pixel of the canvas. */
#ifndef PBS_DRAW_PROBE_H
#define PBS_DRAW_PROBE_H

#include "cmd/pbs-view/draw/draw.h"

/* *depth: in view coordinates; 0: nothing was drawn there. x, y: pixels from the left upper corner,
 * outside of the canvas nothing is. Waits for the device. Errors: PBS_INTERNAL. */
pbs_code pbs_canvas_depth(pbs_canvas *canvas, uint32_t x, uint32_t y, double *depth, pbs_err *err);
#endif
