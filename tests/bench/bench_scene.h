/* bench_scene.h: candidates for benchmarks: half on a bumpy sphere, half on thin plates, in pixel
 * grids of several views, which is what G-buffers give. */
#ifndef PBS_BENCH_SCENE_H
#define PBS_BENCH_SCENE_H
#include "libcore/data/record.h"
#include "libcore/data/vec.h"
#include <stdlib.h>

static void *need(size_t count, size_t size) {
    void *p = malloc(count * size + 1);
    if (!p) abort();
    return p;
}

static void put(pbs_points *c, const double p[3], const double n[3]) {
    for (int k = 0; k < 3; k++) c->position[3 * c->count + (size_t)k] = (float)p[k];
    pbs_oct_encode(c->normal + 2 * c->count, (float[3]){(float)n[0], (float)n[1], (float)n[2]});
    c->count++;
}

/* r(d) = 1 + 0.06 sin 9x sin 9y sin 9z on the unit sphere, seen from one side of an axis. */
static void bumpy_view(pbs_points *c, int axis, double side, int pixels) {
    for (int i = 0; i < pixels * pixels; i++) {
        double u = 2 * (i % pixels + 0.5) / pixels - 1, v = 2 * (i / pixels + 0.5) / pixels - 1;
        double d[3], s[3], o[3], n[3], p[3], along = 0, w = 1 - u * u - v * v;
        if (w <= 0) continue;
        d[axis] = side * sqrt(w), d[(axis + 1) % 3] = u, d[(axis + 2) % 3] = v;
        for (int k = 0; k < 3; k++) s[k] = sin(9 * d[k]), o[k] = cos(9 * d[k]);
        double r = 1 + 0.06 * s[0] * s[1] * s[2];
        for (int k = 0; k < 3; k++) n[k] = 0.54 * o[k] * s[(k + 1) % 3] * s[(k + 2) % 3];
        for (int k = 0; k < 3; k++) along += n[k] * d[k];
        for (int k = 0; k < 3; k++) n[k] = r * d[k] - (n[k] - along * d[k]), p[k] = r * d[k];
        put(c, p, n);
    }
}

/* Both sides of plate number `plate`: 2 by 2, 0.01 thick, one of a stack beside the sphere. */
static void plate_view(pbs_points *c, int plate, double side, int pixels) {
    double x = 1.5 + 0.25 * plate;
    for (int i = 0; i < pixels * pixels; i++) {
        double p[3] = {x + 0.005 * side, 2 * (i % pixels + 0.5) / pixels - 1,
                       2 * (i / pixels + 0.5) / pixels - 1};
        put(c, p, (double[3]){side, 0, 0});
    }
}

static pbs_points make(size_t wanted) {
    enum { PLATES = 4 };
    /* 6 discs and 8 squares of n * n pixels */
    int pixels = (int)sqrt((double)wanted / (6 * 0.785398 + 2 * PLATES));
    size_t room = (size_t)pixels * (size_t)pixels * (6 + 2 * PLATES) + 1;
    pbs_points c = {.position = need(room, 12), .normal = need(room, 4)};
    for (int axis = 0; axis < 3; axis++)
        for (int side = -1; side <= 1; side += 2) bumpy_view(&c, axis, side, pixels);
    for (int plate = 0; plate < PLATES; plate++)
        for (int side = -1; side <= 1; side += 2) plate_view(&c, plate, side, pixels);
    return c;
}
#endif
