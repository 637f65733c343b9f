/* quant.h: half floats and the lattice that archived positions are stored on.
 *
 * A node's positions are integers 0 .. 65535 on a lattice with the same step along all axes, so
 * that distances keep their ratios: position = min + step * integer, relative to the node's
 * origin. The error is at most step / 2 along each axis, before a reader rounds to float. Spacing
 * is a half float in units of 65535 steps (the lattice's side), which keeps its order.
 */
#ifndef PBS_QUANT_H
#define PBS_QUANT_H

#include <math.h>
#include <stdint.h>
#include <string.h>

typedef struct pbs_lattice {
    double min[3], step; /* step > 0 */
} pbs_lattice;

/* The lattice of positions count x 3; step is never 0, also for a single point. */
pbs_lattice pbs_lattice_of(const float *position, size_t count);

static inline uint16_t pbs_lattice_put(const pbs_lattice *l, int axis, float v) {
    double q = floor((v - l->min[axis]) / l->step + 0.5);
    return q >= 65535 ? 65535 : q > 0 ? (uint16_t)q : 0;
}
static inline float pbs_lattice_get(const pbs_lattice *l, int axis, uint16_t q) {
    return (float)(l->min[axis] + l->step * q);
}

/* Round to nearest, ties to even; overflow gives the largest finite value, NaN gives 0. */
static inline uint16_t pbs_half_put(float v) {
    uint32_t b, sign;
    memcpy(&b, &v, sizeof b);
    sign = b >> 16 & 0x8000;
    b &= 0x7fffffff;
    if (b > 0x7f800000) return 0;
    if (b >= 0x477ff000) return (uint16_t)(sign | 0x7bff);
    if (b < 0x38800000) { /* subnormal: let float addition round it */
        float a, magic = 0.5f;
        memcpy(&a, &b, sizeof a);
        a += magic;
        memcpy(&b, &a, sizeof b);
        return (uint16_t)(sign | (b - 0x3f000000));
    }
    return (uint16_t)(sign | (b - 0x38000000 + 0xfff + (b >> 13 & 1)) >> 13);
}
/* There is no infinity and no NaN: the largest exponent is one more like the others. */
static inline float pbs_half_get(uint16_t h) {
    int e = h >> 10 & 31, m = h & 1023;
    float v = e ? ldexpf((float)(m | 1024), e - 25) : ldexpf((float)m, -24);
    return h & 0x8000 ? -v : v;
}
#endif
