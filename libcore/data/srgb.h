/* srgb.h: 8-bit sRGB to linear light and back by table, for loops that do it per pixel.
 *
 * The way back gives the code whose linear value is nearest on the sRGB scale, like
 * pbs_unorm8(pbs_linear_to_srgb(v)) without its two calls of powf.
 */
#ifndef PBS_SRGB_H
#define PBS_SRGB_H

#include <stdint.h>
#include <string.h>

#define PBS_SRGB_OCTAVES 13 /* 2^-13 rounds to 0 */
#define PBS_SRGB_STEPS   128

typedef struct pbs_srgb_table {
    float linear[256]; /* sRGB code to linear */
    float unorm[256];  /* code / 255 */
    float up[256];     /* from here on the next code is nearer; up[255] is infinite */
    uint8_t first[PBS_SRGB_OCTAVES * PBS_SRGB_STEPS]; /* code at the low end of each step */
} pbs_srgb_table;

/* Built by the first call, from any thread. */
const pbs_srgb_table *pbs_srgb(void);

/* NaN becomes 0. No step holds more than one change of code, so there is no loop and no branch. */
static inline uint8_t pbs_srgb_encode(const pbs_srgb_table *t, float v) {
    const uint32_t low = (127 - PBS_SRGB_OCTAVES) << 23;
    v = v > 0x1p-13f ? v : 0x1p-13f;
    v = v < 0x1.fffffep-1f ? v : 0x1.fffffep-1f;
    uint32_t bits;
    memcpy(&bits, &v, sizeof bits);
    uint8_t code = t->first[(bits - low) >> 16];
    return (uint8_t)(code + (v >= t->up[code]));
}
#endif
