#include "formats/scene/bounds.h"

pbs_bound pbs_bound_of(const float box[6]) {
    pbs_bound b;
    for (int k = 0; k < 3; k++) {
        b.box.min[k] = box[k];
        b.box.max[k] = box[k + 3];
        b.reach[k] = fmax(fabs(b.box.min[k]), fabs(b.box.max[k]));
    }
    b.height = 0;
    return b;
}

bool pbs_bound_is_empty(const pbs_bound *b) {
    return b->box.min[0] > b->box.max[0];
}

/* NaN, which comes of numbers that overflow, stays: nothing is known then. */
static double least(double a, double b) {
    return a < b || a != a ? a : b;
}
static double most(double a, double b) {
    return a > b || a != a ? a : b;
}

/* Adds what m places. */
static void add_below(pbs_bound *b, const pbs_bound *below, const double m[12]) {
    if (pbs_bound_is_empty(below)) return;
    for (int r = 0; r < 3; r++) {
        pbs_bound_axis a = pbs_bound_along(below, m + 4 * r);
        b->box.min[r] = least(a.middle - a.half, b->box.min[r]);
        b->box.max[r] = most(a.middle + a.half, b->box.max[r]);
        b->reach[r] = most(a.reach, b->reach[r]);
    }
    b->height = below->height + 1 > b->height ? below->height + 1 : b->height;
}

pbs_code pbs_bounds_make(const pbs_scene *s, const float (*box)[6], pbs_bound **out, pbs_err *err) {
    pbs_bound *b;
    *out = NULL;
    pbs_code rc = pbs_alloc(s->run, &b, s->node_count, sizeof *b, "the boxes of nodes", err);
    if (rc) return rc;
    for (size_t i = 0; i < s->node_count; i++) {
        const pbs_node *n = &s->nodes[i];
        double home[12];
        b[i] = (pbs_bound){.box = PBS_BOX_EMPTY};
        pbs_part_place(home, PBS_IDENTITY, n);
        for (size_t k = s->first_mesh[i]; k < s->first_mesh[i + 1]; k++) {
            pbs_bound mesh = pbs_bound_of(box[k]);
            add_below(&b[i], &mesh, home);
        }
        for (uint32_t k = 0; k < n->child_count; k++)
            add_below(&b[i], &b[n->children[k].node], n->children[k].m);
    }
    *out = b;
    return PBS_OK;
}
