/* camera.h: where the eye is. Pure arithmetic in double.
 *
 * View coordinates: x to the right, y up, the camera looks along -z, and the target is at
 * distance 1: the GPU sees numbers near 1 in every scene, 10^-9 or 10^9 across and any distance
 * from the origin, because the eye is subtracted in double (DESIGN section 9).
 */
#ifndef PBS_CAMERA_H
#define PBS_CAMERA_H

#include "libcore/ground/err.h"
#include "libcore/data/vec.h"
#include <stdbool.h>

typedef struct pbs_camera {
    double eye[3], target[3];
    double right[3], up[3], back[3]; /* orthonormal, right-handed */
    double world_up[3];              /* unit vector: where the sky is */
    double tan_half;                 /* of half the vertical field of view */
    double unit;                     /* distance of the target */
} pbs_camera;

/* Nothing nearer than this is drawn; in view coordinates. Depth is reversed, float, and without a
 * far end, so its relative precision is 2^-24 at any distance and this can be small. */
#define PBS_CAMERA_NEAR 1e-5

typedef struct pbs_camera_desc {
    double toward_eye[3]; /* from the box to the eye, length free; 0: three-quarter from above */
    double up[3];         /* 0: +y, as in glTF */
    double fov;           /* vertical, degrees; 0: 30 */
    double aspect;        /* width / height; 0: 1 */
} pbs_camera_desc;

/* A camera that sees the whole box, as large as it can. An empty or infinite box counts as the
 * unit cube, a point as a cube that is small beside its distance from the origin. */
void pbs_camera_frame(pbs_camera *out, const pbs_box *box, const pbs_camera_desc *desc);

/* "EX,EY,EZ,TX,TY,TZ[,UX,UY,UZ][,FOV]": eye, target, up (0,1,0) and the vertical field of view in
 * degrees (30). Errors: PBS_USAGE. */
pbs_code pbs_camera_parse(pbs_camera *out, const char *text, pbs_err *err);

/* The same from numbers; up 0: +y; fov in degrees, 0: 30. False, and *out unchanged: eye and target
 * are the same point, or a number is out of range. */
bool pbs_camera_look(pbs_camera *out, const double eye[3], const double target[3],
                     const double up[3], double fov);

/* For the mouse; dx and dy are shares of the window's height. Orbit turns around the target and
 * stops before the pole; pan moves the target along; a dolly step of 1 goes a tenth nearer. */
void pbs_camera_orbit(pbs_camera *camera, double dx, double dy);
void pbs_camera_pan(pbs_camera *camera, double dx, double dy);
void pbs_camera_dolly(pbs_camera *camera, double steps);

/* For flying: turn looks around from where the eye is, dx and dy as above; move goes so far to the
 * right, up and ahead, in distances of the target. The target comes along. */
void pbs_camera_turn(pbs_camera *camera, double dx, double dy);
void pbs_camera_move(pbs_camera *camera, double right, double up, double ahead);
/* Puts the target so far ahead, in present distances of the target: what the eye sees stays. A
 * number that is none, or too far for doubles, changes nothing. */
void pbs_camera_refocus(pbs_camera *camera, double distance);
/* Moves the eye alone to the right, world unit; the line of sight stays parallel. */
void pbs_camera_shift(pbs_camera *camera, double right);

/* out takes the coordinates that m takes to the world to view coordinates instead. */
void pbs_camera_place(double out[12], const pbs_camera *camera, const double m[12]);

/* Size of a pixel at distance 1, in view coordinates, in a picture `height` pixels high. */
double pbs_camera_pixel(const pbs_camera *camera, unsigned height);
#endif
