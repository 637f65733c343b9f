/* control.c: paper 1, section 4.3; see the header. */
#include "cmd/pbs-view/plan/control.h"
#include <math.h>

#define SLOWEST 3.0

static double clamped(double size) {
    if (!(size > PBS_CONTROL_LEAST)) return PBS_CONTROL_LEAST;
    return size < PBS_CONTROL_MOST ? size : PBS_CONTROL_MOST;
}

pbs_control pbs_control_start(double target, double size) {
    bool active = target > 0 && isfinite(target);
    double s = active ? clamped(size) : size;
    return (pbs_control){active ? target : 0, s, {s, s, s}};
}

bool pbs_control_step(pbs_control *c, double seconds) {
    double ratio = seconds / c->target, before = c->size;
    if (!(c->target > 0) || !(seconds > 0)) return false;
    c->past[0] = c->past[1], c->past[1] = c->past[2], c->past[2] = c->size;
    if (ratio < 0.9 || ratio > 1.1) {
        double mean = (c->past[0] + c->past[1] + c->past[2]) / 3;
        c->size = clamped((3 * mean + mean * fmin(ratio, SLOWEST)) / 4);
    }
    return c->size != before;
}
