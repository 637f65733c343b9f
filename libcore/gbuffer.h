/* gbuffer.h: what of a node can be seen from outside (paper 1, section 3.1).
 *
 * Our own rasteriser draws the node orthographically from opposite pairs of directions into
 * depth + triangle id buffers, and resolves every covered pixel to a candidate: position, normal,
 * colour, material. All views share one pixel size. The paper knows opaque surfaces only: masked
 * materials are tested per fragment, blended ones count as opaque and keep their alpha.
 * Orientation is not trusted: nothing is culled by facing, normals are turned to the viewer.
 */
#ifndef PBS_GBUFFER_H
#define PBS_GBUFFER_H

#include "libcore/record.h"
#include "libcore/run.h"
#include "libcore/views.h"

typedef struct pbs_gbuffer_scene {
    const pbs_draw *draws; /* in the node's frame: positions are relative to its origin */
    size_t draw_count;     /* triangles of all draws together: at most 2^32 - 2 */
    const pbs_material *materials;
    size_t material_count;
    const pbs_image *textures; /* rgba NULL: counts as white */
    size_t texture_count;
} pbs_gbuffer_scene;

/* One view, resolved: the covered pixels in row order, bottom row first. */
typedef struct pbs_gbuffer_view {
    int view;
    uint32_t width, height;
    double right[3], up[3], toward[3]; /* unit vectors in the node's frame, right-handed */
    double pixel;                      /* side of a pixel in the node's unit */
    const uint32_t *where;             /* y * width + x of each point */
    pbs_points points;                 /* no spacing; borrowed until the sink returns */
} pbs_gbuffer_view;

typedef struct pbs_gbuffer_stats {
    uint64_t triangles;  /* drawn, of all draws */
    uint64_t fragments;  /* depth tests, all pairs */
    uint64_t candidates; /* covered pixels, all views */
    double pixel;
} pbs_gbuffer_stats;

size_t pbs_gbuffer_need(const pbs_gbuffer_scene *scene, const pbs_gbuffer_params *params,
                        int threads);

/* Calls sink once a view, in order. Same views for any number of threads, and for any order of
 * the triangles up to ties in depth, which go to the lower (draw, triangle). A surface seen
 * edge-on or smaller than a pixel may leave no candidate: that is what resolution is for.
 * Errors: PBS_LIMIT, PBS_CANCEL, PBS_USAGE for parameters out of range, and the sink's. */
pbs_code pbs_gbuffer(pbs_run *run, const pbs_gbuffer_scene *scene, const pbs_gbuffer_params *params,
                     pbs_code (*sink)(void *ctx, const pbs_gbuffer_view *view, pbs_err *err),
                     void *ctx, pbs_gbuffer_stats *stats, pbs_err *err);
#endif
