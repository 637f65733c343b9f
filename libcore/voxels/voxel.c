#include "libcore/voxels/voxel.h"
#include <math.h>

static uint32_t put10(float v) {
    int q = (int)lrintf(v * 511);
    return (uint32_t)q & 1023;
}

uint32_t pbs_normal10_put(const float n[3]) {
    float l = sqrtf(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    if (!(l > 0) || !(l < INFINITY)) return 511u << 20;
    return put10(n[0] / l) | put10(n[1] / l) << 10 | put10(n[2] / l) << 20;
}

static float get10(uint32_t q) {
    int v = (int)(q & 1023) - (int)(q << 1 & 1024);
    return (float)v * (1 / 511.0f);
}

void pbs_normal10_get(float n[3], uint32_t packed) {
    for (int k = 0; k < 3; k++) n[k] = get10(packed >> 10 * k);
}

/* Each of 8 bits to every third place, and back. */
static uint32_t spread(uint32_t v) {
    v = (v | v << 8) & 0x00f00f;
    v = (v | v << 4) & 0x0c30c3;
    return (v | v << 2) & 0x249249;
}
static uint32_t gather(uint32_t v) {
    v &= 0x249249;
    v = (v | v >> 2) & 0x0c30c3;
    v = (v | v >> 4) & 0x00f00f;
    return (v | v >> 8) & 0x0000ff;
}

uint32_t pbs_morton8(uint32_t place) {
    return spread(place & 255) | spread(place >> 8 & 255) << 1 | spread(place >> 16 & 255) << 2;
}

uint32_t pbs_unmorton8(uint32_t code) {
    return PBS_PLACE(gather(code), gather(code >> 1), gather(code >> 2), 0);
}
