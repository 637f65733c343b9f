/* record.h: which channels a point record can have, and how wide each is in memory.
 *
 * A scene names the channels it has; what it does not have costs no byte and no time, in files,
 * tools and on the GPU (DESIGN section 3).
 */
#ifndef PBS_RECORD_H
#define PBS_RECORD_H

#include <stddef.h>
#include <stdint.h>

enum {
    PBS_POSITION = 1,  /* float[3], relative to the node's origin */
    PBS_SPACING = 2,   /* float: distance to the nearest earlier surfel of its node */
    PBS_NORMAL = 4,    /* int16[2], octahedral (vec.h), length 1, towards the viewer */
    PBS_COLOUR = 8,    /* uint8[4]: sRGB and linear alpha */
    PBS_MATERIAL = 16, /* uint8[4]: metallic, roughness, 0, 0 */
    PBS_EMISSIVE = 32  /* uint8[4]: sRGB, 0 */
};

/* Structure of arrays: candidates or surfels of one node. A channel that is absent is NULL. */
typedef struct pbs_points {
    size_t count;
    float *position;
    float *spacing;
    int16_t *normal;
    uint8_t *colour, *material, *emissive;
} pbs_points;

static inline uint32_t pbs_points_channels(const pbs_points *p) {
    return (p->position ? PBS_POSITION : 0) | (p->spacing ? PBS_SPACING : 0) |
           (p->normal ? PBS_NORMAL : 0) | (p->colour ? PBS_COLOUR : 0) |
           (p->material ? PBS_MATERIAL : 0) | (p->emissive ? PBS_EMISSIVE : 0);
}
#endif
