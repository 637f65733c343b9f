/* sight.c: how large a node is in the picture, and whether it is in it (cut.h).
 *
 * Paper 1, section 4.1. With d_p the distance between two neighbouring pixels, projected onto the
 * plane through the node's nearest point, a disc that is s pixels across has the radius
 *
 *     r = s d_p / 2
 *
 * (the paper prints s / (2 d_p), with d_p in pixels per unit). In view coordinates
 * d_p = 2 tan(fov / 2) / height * depth, and the node's unit is the stretch of its transform
 * longer there.
 */
#include "cmd/pbs-view/plan/cut.h"
#include "libcore/gbuffer/lod.h"

double pbs_cut_depth(const pbs_camera *camera, double aspect, const pbs_box *box,
                     const double m[12]) {
    double view[12], square = 0, x = camera->tan_half * aspect, y = camera->tan_half;
    pbs_camera_place(view, camera, m);
    pbs_box b = pbs_xform_box(view, box);
    if (pbs_box_is_empty(&b)) return PBS_CAMERA_NEAR;
    for (int k = 0; k < 3; k++) {
        double d = fmax(0, fmax(b.min[k], -b.max[k]));
        square += d * d;
    }
    /* A point in the picture is at most sqrt(1 + x^2 + y^2) times as far as it is deep. */
    double depth = fmax(-b.max[2], sqrt(square / (1 + x * x + y * y)));
    return fmax(depth, PBS_CAMERA_NEAR);
}

double pbs_cut_wanted(const pbs_camera *camera, unsigned height, double depth, double pixels,
                      const double m[12]) {
    double stretch = pbs_lod_stretch(m);
    double radius = pixels / 2 * pbs_camera_pixel(camera, height) * depth * camera->unit;
    return stretch > 0 ? radius / stretch : INFINITY;
}

bool pbs_cut_fine(const pbs_camera *camera, unsigned height, double depth, double pixels,
                  double side, const double m[12]) {
    return side <= 2 * pbs_cut_wanted(camera, height, depth, pixels, m);
}

bool pbs_cut_visible(const pbs_camera *camera, double aspect, const pbs_box *box, double padding,
                     const double m[12]) {
    double view[12], tan_x = camera->tan_half * aspect, tan_y = camera->tan_half;
    pbs_box padded = *box;
    if (pbs_box_is_empty(box)) return false;
    for (int k = 0; k < 3; k++) padded.min[k] -= padding, padded.max[k] += padding;
    pbs_camera_place(view, camera, m);
    unsigned outside = 31; /* planes that all corners so far are behind */
    for (int i = 0; i < 8; i++) {
        double p[3];
        for (int k = 0; k < 3; k++) p[k] = i >> k & 1 ? padded.max[k] : padded.min[k];
        pbs_xform_point(p, view, p);
        outside &= (unsigned)(p[0] > -p[2] * tan_x) | (unsigned)(-p[0] > -p[2] * tan_x) << 1 |
                   (unsigned)(p[1] > -p[2] * tan_y) << 2 | (unsigned)(-p[1] > -p[2] * tan_y) << 3 |
                   (unsigned)(-p[2] < PBS_CAMERA_NEAR) << 4;
    }
    return outside == 0;
}
