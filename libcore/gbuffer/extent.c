#include "libcore/gbuffer/extent.h"
#include "libcore/gbuffer/lod.h"

static double distance(const double a[3], const double b[3]) {
    return hypot(hypot(a[0] - b[0], a[1] - b[1]), a[2] - b[2]);
}

pbs_extent pbs_extent_of(const pbs_box *box) {
    pbs_extent e = {.box = *box};
    for (int k = 0; k < 3; k++) e.centre[k] = box->min[k] / 2 + box->max[k] / 2;
    e.radius = distance(box->max, e.centre);
    return e;
}

/* The smaller ball, of the two that are known to hold everything; then the box is cut to it. What
 * overflowed to infinity or NaN cuts nothing. */
static void settle(pbs_extent *e) {
    pbs_extent around = pbs_extent_of(&e->box);
    if (!(e->radius <= around.radius)) *e = around;
    double reach = e->radius * (1 + 1e-12); /* roundings of this file, however deep */
    for (int k = 0; k < 3; k++) {
        double low = e->centre[k] - reach, high = e->centre[k] + reach;
        if (low > e->box.min[k] && low <= e->box.max[k]) e->box.min[k] = low;
        if (high < e->box.max[k] && high >= e->box.min[k]) e->box.max[k] = high;
    }
}

pbs_extent pbs_extent_place(const double m[12], const pbs_extent *e) {
    pbs_extent out = PBS_EXTENT_EMPTY;
    if (pbs_box_is_empty(&e->box)) return out;
    out.box = pbs_xform_box(m, &e->box);
    pbs_xform_point(out.centre, m, e->centre);
    out.radius = e->radius * pbs_lod_stretch(m);
    if (!pbs_box_is_empty(&out.box)) settle(&out);
    return out;
}

void pbs_extent_join(pbs_extent *to, const pbs_extent *other) {
    if (pbs_box_is_empty(&other->box)) return;
    if (pbs_box_is_empty(&to->box)) {
        *to = *other;
        return;
    }
    double apart = distance(to->centre, other->centre);
    if (apart + to->radius <= other->radius) {
        memcpy(to->centre, other->centre, sizeof to->centre);
        to->radius = other->radius;
    } else if (!(apart + other->radius <= to->radius)) {
        double radius = (apart + to->radius + other->radius) / 2,
               share = (radius - to->radius) / apart;
        for (int k = 0; k < 3; k++) to->centre[k] += share * (other->centre[k] - to->centre[k]);
        to->radius = radius;
    }
    pbs_box_add(&to->box, other->box.min);
    pbs_box_add(&to->box, other->box.max);
    settle(to);
}
