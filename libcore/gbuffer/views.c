#include "libcore/gbuffer/views.h"

const double PBS_GBUFFER_CORNERS[4][3] = {{1, 1, 1}, {-1, 1, 1}, {1, -1, 1}, {1, 1, -1}};

static double length3(const double v[3]) {
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

static void cross(const double a[3], const double b[3], double out[3]) {
    for (int k = 0; k < 3; k++)
        out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

/* y is up, unless one looks along it. */
static bool axes(pbs_pair *p, const double direction[3]) {
    double most = 0, l;
    for (int k = 0; k < 3; k++) most = fmax(most, fabs(direction[k]));
    if (!(most > 0) || !isfinite(most)) return false;
    for (int k = 0; k < 3; k++) p->toward[k] = direction[k] / most;
    l = length3(p->toward);
    for (int k = 0; k < 3; k++) p->toward[k] /= l;
    const double y[3] = {0, 1, 0}, z[3] = {0, 0, 1};
    cross(fabs(p->toward[1]) < 0.95 ? y : z, p->toward, p->right);
    l = length3(p->right);
    for (int k = 0; k < 3; k++) p->right[k] /= l;
    cross(p->toward, p->right, p->up);
    return true;
}

static double extent(const double axis[3], const double size[3]) {
    return fabs(axis[0]) * size[0] + fabs(axis[1]) * size[1] + fabs(axis[2]) * size[2];
}

/* One pixel more than the box is long: half a pixel of margin on each side. */
static uint32_t pixels(double extent, double pixel, uint32_t most) {
    double n = ceil(extent / pixel * (1 - 1e-12)) + 1;
    return n < most ? (uint32_t)n : most;
}

pbs_code pbs_views_plan(const pbs_gbuffer_params *params, pbs_views *out, pbs_err *err) {
    if (params->pairs < 0 || params->pairs > PBS_GBUFFER_MAX_PAIRS)
        return pbs_fail(err, PBS_USAGE, "%d pairs of views: 1 .. %d", params->pairs,
                        PBS_GBUFFER_MAX_PAIRS);
    if (params->resolution < 1 || params->resolution > PBS_GBUFFER_MAX_SIZE)
        return pbs_fail(err, PBS_USAGE, "resolution %u: 1 .. %d", params->resolution,
                        PBS_GBUFFER_MAX_SIZE);
    double size[3], centre[3], most = 0;
    for (int k = 0; k < 3; k++) {
        size[k] = params->box.max[k] - params->box.min[k];
        centre[k] = params->box.min[k] + size[k] / 2;
        if (!(size[k] >= 0) || !(size[k] < 1e300) || !isfinite(centre[k]))
            return pbs_fail(err, PBS_USAGE, "the box to be drawn is empty or not finite");
    }
    *out = (pbs_views){.pairs = params->pairs ? params->pairs : 4};
    for (int i = 0; i < out->pairs; i++) {
        pbs_pair *p = &out->pair[i];
        if (!axes(p, params->pairs ? params->direction[i] : PBS_GBUFFER_CORNERS[i]))
            return pbs_fail(err, PBS_USAGE, "view direction %d is zero or not finite", i);
        memcpy(p->centre, centre, sizeof centre);
        p->depth = extent(p->toward, size);
        most = fmax(most, fmax(extent(p->right, size), extent(p->up, size)));
    }
    out->pixel = most / (params->resolution > 1 ? params->resolution - 1 : 0.5);
    if (!(out->pixel > 1e-290)) out->pixel = 1; /* a point: any size does */
    for (int i = 0; i < out->pairs; i++) {
        pbs_pair *p = &out->pair[i];
        p->pixel = out->pixel;
        p->width = pixels(extent(p->right, size), out->pixel, params->resolution);
        p->height = pixels(extent(p->up, size), out->pixel, params->resolution);
    }
    return PBS_OK;
}
