/* control.h: the size of surfels that keeps a frame-time: paper 1, section 4.3. Pure arithmetic.
 *
 * With s the mean size of the last three frames and t the time of the last one,
 *
 *     s_new = (3 s + s t / t_target) / 4
 *
 * where t / t_target is outside of 0.9 .. 1.1, clamped to 1 .. 8 pixels. Two things are added,
 * since clocks are not the paper's: a time that is none (NaN, or not above 0) changes nothing, and
 * one frame counts as at most three times too slow: a stall, as of a disk or a window that is
 * moved, enlarges by half at most and does not throw the picture to the largest size.
 */
#ifndef PBS_CONTROL_H
#define PBS_CONTROL_H

#include <stdbool.h>

#define PBS_CONTROL_LEAST 1.0
#define PBS_CONTROL_MOST  8.0

typedef struct pbs_control {
    double target;  /* seconds; 0: the size stays */
    double size;    /* pixels, of the next frame */
    double past[3]; /* of the last three */
} pbs_control;

/* size is clamped if there is a target. */
pbs_control pbs_control_start(double target, double size);

/* A frame of size control->size took so many seconds. True: the size is another one now, so the
 * next frame will not look the same. */
bool pbs_control_step(pbs_control *control, double seconds);
#endif
