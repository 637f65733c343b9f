/* path.h: camera paths from a small text file (pbs-view(1) has its format): keyframes, and the
 * camera at any time between them.
 *
 * Eye, target, up and field of view each run on a cubic curve through the keyframes, with the
 * speed at a keyframe that its neighbours give; where the camera stands still between two
 * keyframes it comes to rest before. So the movement is smooth, and a stop is a stop.
 */
#ifndef PBS_PATH_H
#define PBS_PATH_H

#include "cmd/pbs-view/plan/camera.h"
#include "libcore/ground/run.h"

/* What a keyframe's curve runs through: eye, target, up, and the logarithm of the tangent of half
 * the field of view. */
enum { PBS_PATH_EYE = 0, PBS_PATH_TARGET = 3, PBS_PATH_UP = 6, PBS_PATH_ZOOM = 9, PBS_PATH_VALUES };

typedef struct pbs_keyframe {
    double time; /* seconds */
    double at[PBS_PATH_VALUES], speed[PBS_PATH_VALUES];
} pbs_keyframe;

typedef struct pbs_path {
    pbs_keyframe *keys;
    size_t count; /* at least 1 */
} pbs_path;

/* name is for messages; up: of keyframes that have none, 0: +y. The path's keys are freed with
 * pbs_path_free. Errors: PBS_DATA, which names the first bad line and what is wrong with it, and
 * the numbers of the other bad lines; PBS_LIMIT. */
pbs_code pbs_path_parse(pbs_run *run, const char *name, const void *bytes, size_t size,
                        const double up[3], pbs_path *out, pbs_err *err);
/* The same from a file; "-": standard input. */
pbs_code pbs_path_read(pbs_run *run, const char *file, const double up[3], pbs_path *out,
                       pbs_err *err);
void pbs_path_free(pbs_run *run, pbs_path *path);

/* The camera at a time; before the first keyframe and behind the last it stands still, and NaN
 * counts as before. */
void pbs_path_at(const pbs_path *path, double time, pbs_camera *out);

static inline double pbs_path_start(const pbs_path *p) {
    return p->keys[0].time;
}
static inline double pbs_path_end(const pbs_path *p) {
    return p->keys[p->count - 1].time;
}
#endif
