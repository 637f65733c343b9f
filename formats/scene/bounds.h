/* bounds.h: boxes of everything below a node, which hold whatever rounding does.
 *
 * What is placed is placed by the product of the transforms on its way, computed from the top down
 * (dag.h). A box of a subtree was computed from the bottom up, so the two differ by roundings. Each
 * entry of a product of affine transforms, and each coordinate of a point, is wrong by at most 4
 * roundings for each factor, relative to the same product of absolute values; that is what `reach`
 * is. With the roundings of boxes (8 for each level, in the middle and the extent), all is within
 * 12 (height + 1) roundings, 2^-53 each, of the placed reach. Boxes are padded by 32 (height + 2)
 * of them: the padded box of a node also holds the padded boxes of all below it, so that a walk
 * that looks at boxes on its way finds the same as one that looks at the last ones only.
 */
#ifndef PBS_BOUNDS_H
#define PBS_BOUNDS_H

#include "formats/scene/scene.h"

typedef struct pbs_bound {
    pbs_box box;     /* in the node's coordinates, not padded; empty: no triangles below */
    double reach[3]; /* |m1| |m2| .. |p| at most, for all points below, in the node's coordinates */
    uint32_t height; /* of placings below, and one for the node's own meshes */
} pbs_bound;

/* box: of the vertices of each of the scene's meshes: least x y z, largest x y z; a mesh without
 * any has min > max. *out: one for each node, for pbs_free. Errors: PBS_LIMIT. */
pbs_code pbs_bounds_make(const pbs_scene *s, const float (*box)[6], pbs_bound **out, pbs_err *err);
bool pbs_bound_is_empty(const pbs_bound *b);

/* The bound of a mesh, or of some of its triangles, in part coordinates. */
pbs_bound pbs_bound_of(const float box[6]);

/* What a row of m makes of a bound, not padded. */
typedef struct pbs_bound_axis {
    double middle, half, reach;
} pbs_bound_axis;
static inline pbs_bound_axis pbs_bound_along(const pbs_bound *b, const double row[4]) {
    pbs_bound_axis a = {row[3], 0, fabs(row[3])};
    for (int c = 0; c < 3; c++) {
        a.middle += row[c] * (b->box.min[c] / 2 + b->box.max[c] / 2);
        a.half += fabs(row[c]) * (b->box.max[c] / 2 - b->box.min[c] / 2);
        a.reach += fabs(row[c]) * b->reach[c];
    }
    return a;
}

/* The padded box of what m places; 2^-1020 is for what underflows. A coordinate may be NaN or
 * infinite if numbers overflow; then nothing is known of it: compare so that NaN counts as
 * touching. */
static inline pbs_box pbs_bound_placed(const pbs_bound *b, const double m[12]) {
    pbs_box out;
    for (int r = 0; r < 3; r++) {
        pbs_bound_axis a = pbs_bound_along(b, m + 4 * r);
        double half = a.half + (b->height + 2) * 0x1p-48 * a.reach + 0x1p-1020;
        out.min[r] = a.middle - half;
        out.max[r] = a.middle + half;
    }
    return out;
}

/* A part's coordinates to where m places the node: its origin. As pbs_scene_flatten does it. */
static inline void pbs_part_place(double out[12], const double m[12], const pbs_node *node) {
    double local[12];
    memcpy(local, PBS_IDENTITY, sizeof local);
    for (int k = 0; k < 3; k++) local[4 * k + 3] = node->origin[k];
    pbs_xform_mul(out, m, local);
}
#endif
