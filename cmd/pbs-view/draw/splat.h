/* splat.h: deferred splatting (paper 4): surfels whose colours are added up under Gaussians, only
 * those that are seen. Five passes:
 *
 *     1  depth of the discs that were visible in the last frame
 *     2  every surfel as one pixel, its identifier; what is left is what is visible
 *     3  depth of those that were not visible in the last frame
 *     4  EWA splatting of the visible ones: colour and weight are added up
 *     5  colour divided by weight, onto the canvas
 *
 * What pass 2 has left never comes to the processor: a compute pass turns it into lists that the
 * others draw indirectly (the paper's section 6). Identifiers have 32 bits by the two schemes of
 * section 4.2; a node of more than 2^20 surfels counts as several. Nodes for which there is no
 * identifier left, and those with discs so large that a centre says little about what is seen of
 * the rim, are splatted without selection.
 *
 * Beyond the paper: a surfel that is looked at from behind counts as farther away than it is, by
 * more than what is added up lies apart, and is not visible where a front covers a pixel beside its
 * own. So at the edges of a solid and through a thin plate nothing of the far side is seen. A
 * surface of which there is only the back, as inside of a hull, is drawn as any other.
 *
 * Octaves (draw.h) are the surfel mipmaps of section 4.4. Edges are smooth by the Gaussians and a
 * ring of half a pixel, whatever the samples of the canvas. It may hold other things already and be
 * drawn on afterwards; on the edges what was there shows through.
 */
#ifndef PBS_SPLAT_H
#define PBS_SPLAT_H

#include "cmd/pbs-view/draw/resident.h"

typedef struct pbs_splat pbs_splat;

typedef struct pbs_splat_options {
    bool whole;     /* no selection: all surfels in the passes 1 and 4, no others */
    bool afresh;    /* no temporal coherence: all in pass 1, no pass 3 */
    uint32_t group; /* flags say of so many surfels, one after the other in their node, that one of
                       them was visible in the last frame, and then all are drawn in pass 1: 1 to
                       64, a power of two; 0: 1. The paper has 64. In the order of our surfels those
                       are spread over the whole node, and a bit for each is cheap today */
} pbs_splat_options;

/* gl is borrowed. Errors: PBS_INTERNAL, PBS_LIMIT. */
pbs_code pbs_splat_new(pbs_run *run, const pbs_gl *gl, pbs_splat **out, pbs_err *err);
void pbs_splat_free(pbs_splat *s); /* NULL is fine */

/* Draws onto the canvas, as it was begun. Nodes are borrowed for the call. The next call compares
 * with this one: a node counts as the same if its key, buffer and offset are. Errors: PBS_LIMIT,
 * PBS_INTERNAL. */
pbs_code pbs_splat_draw(pbs_splat *s, pbs_canvas *canvas, const pbs_resident *nodes, size_t count,
                        const pbs_splat_options *options, pbs_err *err);

/* Surfels of the last draw. */
typedef struct pbs_splat_counts {
    uint64_t all;     /* prefixes of all nodes */
    uint64_t plain;   /* of those: splatted without selection */
    uint64_t first;   /* splatted in pass 1, `plain` among them */
    uint64_t visible; /* found by pass 2 */
    uint64_t fresh;   /* splatted in pass 3 */
} pbs_splat_counts;

/* Waits for the device. */
pbs_code pbs_splat_count(pbs_splat *s, pbs_splat_counts *out, pbs_err *err);

/* What pass 2 found in the last draw, in no particular order. *out belongs to the caller: pbs_free.
 * Waits for the device. */
typedef struct pbs_splat_surfel {
    uint32_t node, surfel; /* index into the nodes that were drawn; record */
} pbs_splat_surfel;
pbs_code pbs_splat_visible(pbs_splat *s, pbs_splat_surfel **out, size_t *count, pbs_err *err);
#endif
