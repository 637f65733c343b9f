/* views.h: where a node is looked at from, and how large the pictures are (paper 1, section 3.1).
 *
 * The paper's orthographic views, in opposite pairs. All views of a node share one pixel size; each
 * picture is as large as the node's box needs in its direction, with half a pixel of margin, and
 * the box's centre lies in the middle of every picture. Geometry and children's surfels are drawn
 * into the same views, so that both give candidates of the same density.
 */
#ifndef PBS_VIEWS_H
#define PBS_VIEWS_H

#include "libcore/ground/err.h"
#include "libcore/gbuffer/raster.h"

#define PBS_GBUFFER_MAX_PAIRS 16
#define PBS_GBUFFER_MAX_SIZE  16384

typedef struct pbs_gbuffer_params {
    int pairs; /* opposite pairs of directions: views = 2 * pairs; 0: the default */
    double direction[PBS_GBUFFER_MAX_PAIRS]
                    [3]; /* towards the viewer of the even view; length free */
    uint32_t resolution; /* pixels along the longest side of the largest view; 1 .. MAX_SIZE */
    uint32_t channels;   /* of PBS_NORMAL | COLOUR | MATERIAL | EMISSIVE; position always */
    pbs_box box;         /* of the drawn scene in the node's frame, not empty */
    bool progress;       /* say through the run how far the drawing is */
} pbs_gbuffer_params;

/* The default: the four diagonals of a cube, views 2k and 2k + 1 opposite. A cube and not the
 * node's box, as the paper has it: from the corners of a flat box its big faces are seen edge-on.
 */
extern const double PBS_GBUFFER_CORNERS[4][3];

typedef struct pbs_views {
    int pairs;
    double pixel; /* side of a pixel of every view, in the node's unit */
    pbs_pair pair[PBS_GBUFFER_MAX_PAIRS];
} pbs_views;

/* Errors: PBS_USAGE for parameters out of range, an empty or endless box, a direction without a
 * length. */
pbs_code pbs_views_plan(const pbs_gbuffer_params *params, pbs_views *out, pbs_err *err);
#endif
