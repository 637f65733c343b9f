/* zones.c: paper 1, section 4.4; see the header. */
#include "cmd/pbs-view/plan/zones.h"
#include <math.h>
#include <stdlib.h>

#define DEGREES (180 / 3.14159265358979323846)

static bool number(const char **p, char behind, double *v) {
    char *end;
    *v = strtod(*p, &end);
    if (end == *p || *end != behind || !isfinite(*v)) return false;
    *p = end + (behind != 0);
    return true;
}

static bool zone(const char **p, pbs_zones *z) {
    int n = z->count;
    if (n == PBS_ZONES_MOST || !number(p, ':', &z->angle[n])) return false;
    const char *comma = *p;
    if (!number(p, ',', &z->factor[n])) {
        *p = comma;
        if (!number(p, 0, &z->factor[n])) return false;
    }
    z->count++;
    return z->angle[n] >= 0 && z->angle[n] <= 180 && (!n || z->angle[n] > z->angle[n - 1]) &&
           z->factor[n] >= 0.1 && z->factor[n] <= 100;
}

pbs_code pbs_zones_parse(pbs_zones *out, const char *text, pbs_err *err) {
    const char *p = text;
    pbs_zones z = {0};
    bool more = true;
    while (more) {
        if (!zone(&p, &z))
            return pbs_fail(err, PBS_USAGE,
                            "zones %s: ANGLE:FACTOR[,...] is wanted: at most %d, angles rising "
                            "from 0 to 180 degrees, factors from 0.1 to 100",
                            text, PBS_ZONES_MOST);
        more = *p || p[-1] == ',';
    }
    *out = z;
    return PBS_OK;
}

double pbs_zones_factor(const pbs_zones *z, double degrees) {
    int i = 0;
    if (!z->count) return 1;
    while (i < z->count && degrees > z->angle[i]) i++;
    if (i == 0) return z->factor[0];
    if (i == z->count) return z->factor[i - 1];
    double share = (degrees - z->angle[i - 1]) / (z->angle[i] - z->angle[i - 1]);
    return z->factor[i - 1] + share * (z->factor[i] - z->factor[i - 1]);
}

void pbs_zones_gaze(double out[3], double tan_x, double tan_y, double x, double y) {
    double p[3] = {(2 * x - 1) * tan_x, (1 - 2 * y) * tan_y, -1};
    double length = sqrt(p[0] * p[0] + p[1] * p[1] + 1);
    for (int k = 0; k < 3; k++) out[k] = p[k] / length;
}

double pbs_zones_angle(const double gaze[3], const pbs_box *box, const double view[12]) {
    double middle[3], square = 0, along = 0, radius = 0;
    if (pbs_box_is_empty(box)) return 0;
    for (int k = 0; k < 3; k++) middle[k] = box->min[k] + (box->max[k] - box->min[k]) / 2;
    pbs_xform_point(middle, view, middle);
    for (int i = 0; i < 8; i++) {
        double p[3], d = 0;
        for (int k = 0; k < 3; k++) p[k] = i >> k & 1 ? box->max[k] : box->min[k];
        pbs_xform_point(p, view, p);
        for (int k = 0; k < 3; k++) d += (p[k] - middle[k]) * (p[k] - middle[k]);
        radius = fmax(radius, sqrt(d));
    }
    for (int k = 0; k < 3; k++) square += middle[k] * middle[k], along += middle[k] * gaze[k];
    double distance = sqrt(square);
    if (!(distance > radius)) return 0;
    double to_middle = acos(fmax(-1, fmin(1, along / distance)));
    return fmax(0, to_middle - asin(radius / distance)) * DEGREES;
}
