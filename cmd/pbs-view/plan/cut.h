/* cut.h: what is drawn of a hierarchy: which prefix of which node, with which discs (paper 1,
 * section 4), which chunks of voxels (paper 2, section 4), and where the source geometry takes
 * over; and what should be loaded for it. Arithmetic only: it knows no GL, no file and no thread.
 */
#ifndef PBS_CUT_H
#define PBS_CUT_H

#include "cmd/pbs-view/plan/eyes.h"
#include "cmd/pbs-view/plan/profile.h"
#include <stddef.h>

/* ---- arithmetic of one node ---- */

/* Depth, in view coordinates, that nothing of the box is nearer than which can be in the picture;
 * at least PBS_CAMERA_NEAR. m takes the box to the world. */
double pbs_cut_depth(const pbs_camera *camera, double aspect, const pbs_box *box,
                     const double m[12]);

/* Disc radius in the node's unit such that a disc, at its nearest, is `pixels` across. */
double pbs_cut_wanted(const pbs_camera *camera, unsigned height, double depth, double pixels,
                      const double m[12]);

/* Whether cells whose side is `side` (node's unit) are, at the nearest, at most `pixels` large. */
bool pbs_cut_fine(const pbs_camera *camera, unsigned height, double depth, double pixels,
                  double side, const double m[12]);

/* False only if nothing within `padding` (node's unit) of the box can be in the picture. */
bool pbs_cut_visible(const pbs_camera *camera, double aspect, const pbs_box *box, double padding,
                     const double m[12]);

/* ---- the whole hierarchy ---- */

/* What a node has of its own. Two items can be loaded of it: its surfels or voxels, and its source
 * geometry. */
enum { PBS_HAS_SURFELS = 1, PBS_HAS_VOXELS = 2, PBS_HAS_MESH = 4 };
#define PBS_ITEM_OWN(node)  (2 * (uint32_t)(node))
#define PBS_ITEM_MESH(node) (2 * (uint32_t)(node) + 1)

/* Arrays over the nodes or items; borrowed as long as the cut lives. */
typedef struct pbs_cut_scene {
    const pbs_node *nodes; /* the last is the root */
    size_t node_count;
    const uint8_t *has;          /* of each node: PBS_HAS_... */
    const uint64_t *placings;    /* of nodes that have something, below and including each node */
    const uint64_t *moving;      /* placings that an animation moves, below each node */
    const uint8_t *resident;     /* of each item: it can be drawn. The only one that may change from
                                    frame to frame */
    pbs_profile *const *profile; /* of each node with surfels that are resident */
} pbs_cut_scene;

typedef struct pbs_cut_view {
    pbs_camera camera;
    uint32_t width, height;
    const pbs_eyes *eyes; /* of this camera and picture; NULL: one, and no zones */
    double size;          /* pixels: diameter of a surfel, side of a voxel */
    uint64_t prefix;      /* surfels of each node whatever the camera needs; 0: what it needs */
    bool formula;         /* p(r) by the paper's estimate */
    bool partial;   /* paper 2's second policy: of children those are drawn that are there, with
                       holes for the others. Else a node stays until all of them are there */
    bool occlusion; /* what was hidden is drawn coarse; needs pbs_cut_feedback */
    const double (*pose)[12]; /* of each motion, in the place of the transforms of its placings;
                                 NULL: everything rests */
} pbs_cut_view;

/* In the order in which they are drawn; near before far within a kind. */
typedef enum pbs_cut_kind {
    PBS_CUT_MESH, /* source geometry: nearest to the eye, so it primes the depth buffer */
    PBS_CUT_VOXELS,
    PBS_CUT_SURFELS,
    PBS_CUT_PROBE, /* voxels that are drawn only to see whether they would be seen: neither colour
                      nor depth is written (paper 2, figure 8) */
    PBS_CUT_KINDS
} pbs_cut_kind;

typedef struct pbs_cut_draw {
    pbs_cut_kind kind;
    uint32_t node;
    uint32_t prefix;        /* surfels */
    uint32_t parent, order; /* for pbs_cut_feedback, and to sort by */
    double radius;          /* of their discs, node's unit */
    double depth;           /* of its nearest point */
    uint64_t key;           /* of the placed node: the same from frame to frame, no other one's */
    double m[12];           /* node to world */
} pbs_cut_draw;

/* An item that the picture needs, resident or not. Sorted: one complete level before the next, near
 * before far. */
typedef struct pbs_cut_need {
    uint32_t item, level;
    double depth;
} pbs_cut_need;

typedef struct pbs_cut pbs_cut;

pbs_code pbs_cut_new(pbs_run *run, const pbs_cut_scene *scene, pbs_cut **out, pbs_err *err);
void pbs_cut_free(pbs_cut *cut); /* NULL is fine */

/* What the next frame shows and needs. The lists belong to the cut, until the next call.
 *
 * A node with surfels stands for everything below it but what moves. Where all of them are not
 * enough it is blended with what is below: while the radius that the camera wants falls from that
 * of all its surfels to three quarters, theirs come, and down to half its own go. Only where
 * everything below has something to draw: surfels, or source geometry.
 *
 * A chunk of voxels is drawn if its cells are fine enough, or its children are not there; or for
 * its visibility only, where all its children were hidden.
 * Errors: PBS_LIMIT, PBS_CANCEL. */
typedef struct pbs_cut_frame {
    uint64_t number; /* counts up from 1 */
    const pbs_cut_draw *draws;
    size_t draw_count;
    size_t first[PBS_CUT_KINDS + 1]; /* draws of kind k: first[k] .. first[k + 1] - 1 */
    const pbs_cut_need *needs;
    size_t need_count;
    uint64_t missing;                 /* needs that are not resident */
    uint64_t surfels, culled, hidden; /* surfels drawn; nodes outside of the picture, and those
                                         drawn coarse because what is below them was hidden */
} pbs_cut_frame;
pbs_code pbs_cut_next(pbs_cut *cut, const pbs_cut_view *view, pbs_cut_frame *out, pbs_err *err);

/* Which draws of an earlier frame had a pixel in the picture: visible[i] is not 0. Only
 * those of voxels count: of what is not noted it is never said that it was hidden. Frames that are
 * older than the one before the last are ignored; so is what comes twice. */
pbs_code pbs_cut_feedback(pbs_cut *cut, uint64_t frame, const uint32_t *visible, size_t count,
                          pbs_err *err);
#endif
