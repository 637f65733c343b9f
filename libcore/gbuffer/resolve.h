/* resolve.h: from covered pixels to candidates (paper 1, section 3.1).
 *
 * The position is the point of the triangle's plane at the pixel's centre, computed from the
 * vertices in double, not from the depth buffer. Snapping can put a centre up to 1/256 pixel
 * outside of its triangle; then it is the triangle's nearest point as seen in the view, so a
 * candidate always lies on its triangle, however thin or edge-on that is.
 *
 * Normals: the triangle's own normal is turned to the viewer, and the smooth normal to the side
 * of that. A surface point gets the same normal from every view that sees the same side of it,
 * which sampling relies on; near a silhouette a smooth normal may lean away from the viewer.
 */
#ifndef PBS_RESOLVE_H
#define PBS_RESOLVE_H

#include "libcore/data/lanes.h"
#include "libcore/gbuffer/raster.h"
#include "libcore/gbuffer/shade.h"

#define PBS_RESOLVE_CACHE 256 /* placed meshes kept ready, a power of two */

/* What all threads read. */
typedef struct pbs_resolve {
    const pbs_draw *draws;
    size_t draw_count;
    const pbs_surfaces *surfaces;
    const uint32_t *first; /* draw_count + 1: number of the first triangle of each draw */
    uint32_t channels;
} pbs_resolve;

/* What one thread writes. */
typedef struct pbs_resolve_scratch {
    const pbs_resolve *set;
    const pbs_pair *pair;
    uint32_t *column; /* a row's covered pixels; as many as the picture is wide */
    uint32_t last;    /* draw that was hit last */
    pbs_placed cache[PBS_RESOLVE_CACHE]; /* draw NULL: empty */
    uint64_t used[PBS_RESOLVE_CACHE];    /* number of the batch that last used it */
    uint64_t batch;
    pbs_lanes lanes;
    bool simd; /* may use AVX2; same bits either way */
} pbs_resolve_scratch;

/* One view of a band. Room for as many points as there are covered pixels. */
typedef struct pbs_resolve_out {
    pbs_points points;
    uint32_t *where;
} pbs_resolve_out;

/* To be called for each pair. column and simd stay. */
void pbs_resolve_begin(pbs_resolve_scratch *s, const pbs_resolve *set, const pbs_pair *pair);

/* Appends the covered pixels of r's band to out[0] (even view) and out[1] (odd view, mirrored). */
void pbs_resolve_band(pbs_resolve_scratch *s, const pbs_raster *r, pbs_resolve_out out[2]);

void pbs_resolve_place(pbs_placed *p, const pbs_pair *pair, const pbs_draw *draw, uint32_t number,
                       uint32_t first);

/* Fills lane 0 for the centre of pixel x, y of the even view. */
void pbs_resolve_one(const pbs_placed *p, uint32_t triangle, uint32_t x, uint32_t y,
                     pbs_lanes *out);

/* Barycentric coordinates of the point of the triangle nearest to the pixel's centre, which is
 * dx, dy from corner 0, as the view sees both. */
void pbs_resolve_nearest(pbs_lanes *b, int lane, double dx, double dy);

/* resolve_math.h */
void pbs_resolve_solve_avx2(const pbs_placed *p, pbs_lanes *b, int from, int to, bool normals,
                            bool odd);
#endif
