/* profile.c: covering radii of prefixes at equal ratios: paper 1, section 4.1. */
#include "cmd/pbs-view/plan/profile.h"
#include "libcore/data/quant.h"
#include <math.h>
#include <string.h>

static double spacing(const pbs_spacings *s, uint32_t i) {
    const uint8_t *p = s->first + (size_t)i * s->stride;
    return fmax(0, s->unit * (double)pbs_half_get((uint16_t)(p[0] | p[1] << 8)));
}

/* How many lead with a spacing above `length`. */
static uint32_t longer(const pbs_spacings *s, double length) {
    uint32_t low = 0, high = s->count;
    while (low < high) {
        uint32_t mid = low + (high - low) / 2;
        if (spacing(s, mid) > length)
            low = mid + 1;
        else
            high = mid;
    }
    return low;
}

static double step(const pbs_profile *p, int i) {
    return i == PBS_PROFILE_STEPS - 1 ? fmax(p->last, p->first * 0x1p-20)
                                      : p->first * pow(p->ratio, i);
}

void pbs_profile_make(const pbs_spacings *s, pbs_profile *out) {
    memset(out, 0, sizeof *out);
    out->count = s->count;
    out->covering = s->covering;
    out->slack = s->slack;
    if (!s->count) return;
    out->top = spacing(s, 0);
    out->first = spacing(s, s->count > 1);
    out->last = fmin(out->first, spacing(s, s->count - 1));
    double least = fmax(out->last, out->first * 0x1p-20);
    out->ratio = out->first > 0 ? pow(least / out->first, 1.0 / (PBS_PROFILE_STEPS - 1)) : 1;
    for (int i = 0; i < PBS_PROFILE_STEPS; i++) out->longer[i] = longer(s, step(out, i));
}

/* The first step whose length is at most (or, below, less than) `length`; STEPS: none. */
static int first_step(const pbs_profile *p, double length, bool below) {
    int low = 0, high = PBS_PROFILE_STEPS;
    while (low < high) {
        int mid = (low + high) / 2;
        double at = step(p, mid);
        if (below ? at < length : at <= length)
            high = mid;
        else
            low = mid + 1;
    }
    return low;
}

uint32_t pbs_profile_prefix(const pbs_profile *p, double radius) {
    int i = first_step(p, radius - p->slack, false);
    if (i == PBS_PROFILE_STEPS || !p->count) return p->count;
    return p->longer[i] > 1 ? p->longer[i] : 1;
}

double pbs_profile_radius(const pbs_profile *p, uint32_t prefix) {
    if (!p->count) return 0;
    /* Nothing is known about what lies between the surfels of the whole set; it was covered about
     * as well as the last surfel found it. */
    if (prefix >= p->count) return (p->covering > 0 ? p->covering : p->last) + p->slack;
    if (!prefix) prefix = 1;
    int low = 0, high = PBS_PROFILE_STEPS - 1; /* the last step that the prefix covers */
    while (low < high) {
        int mid = (low + high + 1) / 2;
        if (p->longer[mid] <= prefix)
            low = mid;
        else
            high = mid - 1;
    }
    return step(p, low) + p->slack;
}

uint32_t pbs_profile_adding(const pbs_profile *p, double radius) {
    if (!p->count || radius > p->first) return p->count && radius <= p->top;
    int i = first_step(p, radius, true);
    return i == PBS_PROFILE_STEPS ? p->count : p->longer[i];
}

uint32_t pbs_formula_prefix(const pbs_node *n, double radius) {
    double all = fmin((double)n->records, UINT32_MAX);
    if (!n->median_count) return 0;
    double ratio = n->median / radius, p = n->median_count * ratio * ratio;
    return (uint32_t)(p >= 1 ? fmin(ceil(p), all) : 1);
}

double pbs_formula_radius(const pbs_node *n, uint32_t prefix) {
    if (!n->median_count) return 0;
    return n->median * sqrt(n->median_count / fmax(1, (double)prefix));
}
