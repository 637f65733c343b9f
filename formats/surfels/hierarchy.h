/* hierarchy.h: which nodes of a scene get surfels, and what each is made from (paper 1, section
 * 3.4).
 *
 * A node has surfels if it has enough triangles (lod.h); what has fewer is seen in the surfels of
 * a node above. Nothing stands for a top: the root, and every node that an animation moves, which
 * is kept apart from the static ones and left out of the nodes above. A node that is only a
 * wrapper of one child leaves it to that child.
 *
 * Bottom-up, what stands in a node's picture for the nodes below is their surfels where these are
 * dense enough and saw it from the same sides (pbs_lod_fine), and else what is in them: geometry,
 * or nodes further down. Both programs that need to know decide by the same rule from the same
 * numbers: pbs-gbuffer draws the geometry, pbs-sample adds the surfels. Top-down, everything is
 * geometry.
 */
#ifndef PBS_HIERARCHY_H
#define PBS_HIERARCHY_H

#include "formats/scene/scene.h"
#include "libcore/gbuffer/gbuffer.h"
#include "libcore/gbuffer/lod.h"

typedef struct pbs_planned {
    uint32_t wanted;     /* surfels; 0: none, and nothing is drawn */
    uint32_t resolution; /* of its views */
    uint32_t flags;      /* PBS_NODE_BELOW | PBS_NODE_USED */
    double pixel;        /* of its views; 0 if nothing is wanted */
    double origin[3];    /* of its candidates, in the node's coordinates */
    pbs_box seen;        /* what is drawn, relative to origin; empty: nothing is */
    pbs_box box;         /* of everything below, in the node's coordinates */
} pbs_planned;

typedef struct pbs_plan {
    pbs_planned *nodes; /* as many as the scene has */
    uint64_t *meshes;   /* placed below each node, itself included, without what moves */
    size_t wanted;      /* nodes that get surfels */
    uint32_t root;      /* the top that is not moved by anything */
    uint64_t singular;  /* placings whose transform cannot be inverted */
} pbs_plan;

/* views: directions and channels for all nodes; its box and resolution are not read. *out is given
 * back with pbs_plan_free, also after an error. Errors: PBS_LIMIT, PBS_CANCEL; PBS_DATA, with the
 * node's name, if transforms leave nothing finite of a top or blow a node up; or
 * that is told to s->options.failed, and the node gets no surfels. */
pbs_code pbs_plan_make(const pbs_scene *s, const pbs_lod *lod, const pbs_gbuffer_params *views,
                       bool top_down, pbs_plan *out, pbs_err *err);
void pbs_plan_free(pbs_run *run, pbs_plan *plan);

/* The geometry that is drawn for a node, in the frame with its origin. *draws is kept from call to
 * call and grows (NULL and *cap 0 at first; pbs_free in the end); *triangles is their sum. */
pbs_code pbs_plan_draws(const pbs_scene *s, const pbs_plan *plan, uint32_t node, pbs_draw **draws,
                        size_t *cap, size_t *count, uint64_t *triangles, pbs_err *err);

/* The other side, for a stream of candidates: calls place for every placing of a node whose
 * surfels stand for it in the picture of `node`, with the transform between the frames of their
 * points. nodes: at least up to `node`, with their flags; used[i]: how many nodes with surfels are
 * placed below i, itself included, without what moves. Errors: place's; PBS_DATA for more than 2^32
 * placings; PBS_LIMIT, PBS_CANCEL. */
pbs_code pbs_plan_below(pbs_run *run, const pbs_node *nodes, const uint64_t *used, uint32_t node,
                        pbs_code (*place)(void *ctx, uint32_t below, const double m[12],
                                          pbs_err *err),
                        void *ctx, pbs_err *err);
#endif
