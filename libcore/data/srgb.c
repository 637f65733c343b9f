#include "libcore/data/srgb.h"
#include "libcore/data/vec.h"
#include <pthread.h>

_Static_assert(PBS_SRGB_STEPS == 1 << (23 - 16), "an octave of floats has so many steps");

static pbs_srgb_table table;
static pthread_once_t once = PTHREAD_ONCE_INIT;

static void build(void) {
    for (int i = 0; i < 256; i++) {
        table.linear[i] = pbs_srgb_to_linear((float)i / 255);
        table.unorm[i] = (float)i / 255;
        table.up[i] = i < 255 ? pbs_srgb_to_linear(((float)i + 0.5f) / 255) : INFINITY;
    }
    uint8_t code = 0;
    for (uint32_t i = 0; i < PBS_SRGB_OCTAVES * PBS_SRGB_STEPS; i++) {
        float v = ldexpf(1 + (float)(i % PBS_SRGB_STEPS) / PBS_SRGB_STEPS,
                         (int)(i / PBS_SRGB_STEPS) - PBS_SRGB_OCTAVES);
        while (v >= table.up[code]) code++;
        table.first[i] = code;
    }
}

const pbs_srgb_table *pbs_srgb(void) {
    pthread_once(&once, build);
    return &table;
}
