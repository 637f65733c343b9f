/* eyes.c: one eye or two, and what they see; see the header. */
#include "cmd/pbs-view/plan/eyes.h"
#include "cmd/pbs-view/plan/cut.h"

/* Columns by which the eyes' pictures move towards each other: a frustum off the axis is a part of
 * a wider one around it. At most half of an eye's, where something is closer than it can be seen.
 */
static uint32_t shift_of(const pbs_eyes *e, double separation, double focus) {
    double pixel = pbs_camera_pixel(&e->camera[0], e->height) * focus;
    double shift = focus > 0 && pixel > 0 ? separation / 2 / pixel : 0;
    return (uint32_t)fmin(floor(shift + 0.5), e->width / 2);
}

void pbs_eyes_of(pbs_eyes *out, const pbs_camera *camera, uint32_t width, uint32_t height,
                 double separation, double focus, const pbs_zones *zones, const double gaze[2]) {
    bool two = separation > 0 && isfinite(separation) && width >= 2;
    *out = (pbs_eyes){.count = two ? 2 : 1,
                      .width = two ? width / 2 : width,
                      .height = height ? height : 1,
                      .zones = zones && zones->count ? zones : NULL};
    out->camera[0] = *camera;
    uint32_t shift = two ? shift_of(out, separation, focus) : 0;
    out->wide = out->width + 2 * shift;
    out->aspect = (double)out->wide / out->height;
    for (int i = 0; i < out->count; i++) {
        out->camera[i] = *camera;
        out->left[i] = i * out->width;
        out->from[i] = (int32_t)out->left[i] - (i ? 0 : 2 * (int32_t)shift);
        if (two) pbs_camera_shift(&out->camera[i], i ? separation / 2 : -separation / 2);
        if (out->zones)
            pbs_zones_gaze(out->gaze[i], camera->tan_half * out->aspect, camera->tan_half,
                           (out->left[i] + gaze[0] * out->width - out->from[i]) / out->wide,
                           gaze[1]);
    }
}

bool pbs_eyes_see(const pbs_eyes *e, const pbs_box *box, double padding, const double m[12]) {
    for (int i = 0; i < e->count; i++)
        if (pbs_cut_visible(&e->camera[i], e->aspect, box, padding, m)) return true;
    return false;
}

double pbs_eyes_depth(const pbs_eyes *e, const pbs_box *box, const double m[12]) {
    double depth = INFINITY;
    for (int i = 0; i < e->count; i++)
        depth = fmin(depth, pbs_cut_depth(&e->camera[i], e->aspect, box, m));
    return depth;
}

double pbs_eyes_size(const pbs_eyes *e, double size, const pbs_box *box, const double m[12]) {
    double least = INFINITY;
    if (!e->zones) return size;
    for (int i = 0; i < e->count; i++) {
        double view[12];
        pbs_camera_place(view, &e->camera[i], m);
        double angle = pbs_zones_angle(e->gaze[i], box, view);
        least = fmin(least, pbs_zones_factor(e->zones, angle));
    }
    return size * least;
}
