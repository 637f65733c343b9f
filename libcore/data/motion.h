/* motion.h: how a placing moves: keyframes of its translation, rotation and scale, and the pose
 * that they make at a time (glTF 2.0, section 3.11 and appendix C). Arithmetic only.
 *
 * A motion moves one placing: its pose at a time takes the place of the placing's transform. What
 * is placed several levels deep, with motions at any of them, needs nothing else: the transforms
 * along the way are multiplied as ever, some of them fixed and some of them poses.
 */
#ifndef PBS_MOTION_H
#define PBS_MOTION_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Scaled first, then rotated, then moved. */
typedef struct pbs_trs {
    double translation[3];
    double rotation[4]; /* quaternion x y z w of any length; 0 or not finite: no rotation */
    double scale[3];
} pbs_trs;
#define PBS_TRS_IDENTITY ((pbs_trs){{0, 0, 0}, {0, 0, 0, 1}, {1, 1, 1}})

/* As a transform (vec.h). */
void pbs_trs_matrix(const pbs_trs *pose, double m[12]);

typedef enum pbs_motion_path {
    PBS_MOTION_TRANSLATION,
    PBS_MOTION_ROTATION,
    PBS_MOTION_SCALE,
    PBS_MOTION_PATHS
} pbs_motion_path;

/* From one key to the next: straight (rotations along the shorter arc), not at all, or along a
 * cubic Hermite spline. */
typedef enum pbs_motion_way {
    PBS_MOTION_LINEAR,
    PBS_MOTION_STEP,
    PBS_MOTION_CUBIC,
    PBS_MOTION_WAYS
} pbs_motion_way;

/* Keyframes of one of the three, in one animation. */
typedef struct pbs_motion_channel {
    uint32_t animation;
    uint8_t path, way;
    uint32_t keys;       /* at least 1 */
    const double *time;  /* of each key: seconds, finite, none below the one before. Of keys at the
                            same time the last one counts from there on */
    const double *value; /* of each key 3 numbers, rotations 4; with splines three times as many:
                            tangent before, value, tangent behind. Finite */
} pbs_motion_channel;

typedef struct pbs_motion {
    pbs_trs rest; /* of what no animation moves that plays */
    uint32_t count;
    const pbs_motion_channel *channels;
} pbs_motion;

/* Numbers of a key's value. */
static inline uint32_t pbs_motion_numbers(unsigned path, unsigned way) {
    return (path == PBS_MOTION_ROTATION ? 4 : 3) * (way == PBS_MOTION_CUBIC ? 3 : 1);
}
/* Times and values of all channels of one motion, so that it fits a chunk. */
#define PBS_MOTION_MOST 8000000u

/* 3 numbers, or 4 of a rotation, which are not always of length 1. Before the first key they are
 * its own, after the last one that one's; of a time that is NaN the first one's. */
void pbs_motion_channel_at(const pbs_motion_channel *c, double time, double out[4]);

/* time[i]: where animation i is; NaN: it does not play. Of several channels for the same the first
 * counts whose animation plays. False, and m the pose at rest: none of them does. */
bool pbs_motion_at(const pbs_motion *motion, const double *time, double m[12]);

/* Where an animation is that lasts from 0 to `end` and begins again then: `end` is still its end,
 * not its beginning. NaN stays; so does every time where the end is not above 0. */
double pbs_motion_loop(double time, double end);

#ifdef __cplusplus
}
#endif
#endif
