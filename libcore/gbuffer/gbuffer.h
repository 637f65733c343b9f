/* gbuffer.h: what of a node can be seen from outside (paper 1, section 3.1).
 *
 * Our own rasteriser draws the node orthographically from opposite pairs of directions into
 * depth + triangle id buffers, and resolves every covered pixel to a candidate: position, normal,
 * colour, material. The paper knows opaque surfaces only: masked materials are tested per
 * fragment, blended ones count as opaque and keep their alpha. Orientation is not trusted: nothing
 * is culled by facing, normals are turned to the viewer.
 *
 * How exact it is. Vertices are taken from their part's frame into the picture in double, and there
 * to the nearest 1/256 pixel; coverage follows from those by the exact rule of raster.h. Depth is
 * a float across the box. Between two surfaces that are nearer to each other than 2/256 pixel, or
 * than 10^-6 of the box's depth, rounding decides which is seen; between equal depths the lower
 * number does, and equal triangles under equal matrices have equal depths. Positions are computed
 * from the vertices in double and rounded to float once, relative to the frame's origin; they lie
 * on their triangle, at most 1/256 pixel from the pixel's centre. Normals are those of the inverse
 * transpose, to 0.01 degrees. So:
 * - a scene scaled by a power of two has the same candidates, bit by bit;
 * - scaled by anything else, moved, or mirrored together with the views: the same but for rounding.
 *   A vertex that is within 10^-9 of half way between two steps of 1/256 pixel may go to the other
 *   one, and with it a pixel whose centre its edges touch; positions differ by a few ulps of the
 *   box's largest coordinate. Moved by D, box and matrix are doubles there: add 2^-52 D;
 * - a needle too thin to hold a pixel's centre leaves no candidate, and its neighbours no gap;
 * - what is smaller than a pixel of the node leaves none either: a part of 10^-9 beside one of 10^9
 *   must be a node of its own.
 *
 * A hierarchy has thousands of nodes, most of them small. What they share is made once:
 * pbs_surfaces. What a node needs for itself is kept from node to node, since fresh memory costs
 * as much as drawing: pbs_gbuffers, one for each thread that has nodes drawn.
 */
#ifndef PBS_GBUFFER_H
#define PBS_GBUFFER_H

#include "libcore/data/record.h"
#include "libcore/ground/run.h"
#include "libcore/gbuffer/views.h"

/* Materials, and their textures' pyramids; any number of threads may read it. */
typedef struct pbs_surfaces pbs_surfaces;

/* Builds the pyramids of those textures that a material shows in these channels (of PBS_COLOUR |
 * MATERIAL | EMISSIVE; masked materials always need their colour). Materials and textures are
 * borrowed as long as it lives; an image with rgba NULL counts as white. Free it with the same run;
 * NULL is fine. Errors: PBS_LIMIT. */
pbs_code pbs_surfaces_new(pbs_run *run, const pbs_material *materials, size_t material_count,
                          const pbs_image *textures, size_t texture_count, uint32_t channels,
                          pbs_surfaces **out, pbs_err *err);
void pbs_surfaces_free(pbs_run *run, pbs_surfaces *s);
/* Bytes that pbs_surfaces_new takes. */
size_t pbs_surfaces_need(const pbs_material *materials, size_t material_count,
                         const pbs_image *textures, size_t texture_count, uint32_t channels);

/* Buffers for one node at a time. They grow as needed and are kept until the end. */
typedef struct pbs_gbuffers pbs_gbuffers;

/* threads: how many a call may use: 1, or more for all of run's. 1 is right for calls from inside
 * another's work, each thread with buffers of its own. run and surfaces are borrowed as long as it
 * lives. Errors: PBS_LIMIT. NULL can be freed. */
pbs_code pbs_gbuffers_new(pbs_run *run, const pbs_surfaces *surfaces, int threads,
                          pbs_gbuffers **out, pbs_err *err);
void pbs_gbuffers_free(pbs_gbuffers *g);

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

/* Bytes that a call takes at most, beside what g holds already. g NULL: those of a new one for
 * `threads` threads, which counts in this case only. Parameters out of range: 0. */
size_t pbs_gbuffer_need(const pbs_gbuffers *g, const pbs_draw *draws, size_t draw_count,
                        const pbs_gbuffer_params *params, int threads);

/* Draws a node. draws are in its frame: positions are relative to its origin; at most 2^32 - 2
 * triangles together. Calls sink once a view, in order. Same views for any number of threads, and
 * for any order of the triangles up to ties in depth, which go to the lower (draw, triangle). A
 * surface seen edge-on or smaller than a pixel may leave no candidate: that is what resolution is
 * for. stats may be NULL. After an error g can be used again.
 * Errors: PBS_LIMIT, PBS_CANCEL, PBS_USAGE for parameters out of range and for channels that the
 * surfaces were not made for, and the sink's. */
pbs_code pbs_gbuffer(pbs_gbuffers *g, const pbs_draw *draws, size_t draw_count,
                     const pbs_gbuffer_params *params,
                     pbs_code (*sink)(void *ctx, const pbs_gbuffer_view *view, pbs_err *err),
                     void *ctx, pbs_gbuffer_stats *stats, pbs_err *err);
#endif
