#include "libcore/data/quant.h"

pbs_lattice pbs_lattice_of(const float *position, size_t count) {
    pbs_lattice l = {{0, 0, 0}, 0};
    double side = 0;
    for (int k = 0; k < 3; k++) {
        float lo = INFINITY, hi = -INFINITY;
        for (size_t i = 0; i < count; i++) {
            float v = position[3 * i + k];
            lo = v < lo ? v : lo;
            hi = v > hi ? v : hi;
        }
        if (!(lo <= hi)) continue;
        l.min[k] = lo;
        if ((double)hi - lo > side) side = (double)hi - lo;
    }
    l.step = side > 0 ? side / 65535 : 1;
    return l;
}
