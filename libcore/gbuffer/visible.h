/* visible.h: which surfels of the nodes below a node can be seen from outside of it (paper 1,
 * section 3.4, bottom-up).
 *
 * The surfels are splatted as discs into the depth buffers of the node's own views (gbuffer.h).
 * Then a surfel is a candidate of the node if its centre lies in front in at least one view that
 * it faces. Candidates are the surfels themselves, not pixels of their discs: they never leave the
 * surface, however many levels lie above each other, and keep their colours.
 *
 * In front means: not deeper than the nearest disc by more than that disc's radius and a pixel and
 * a half, so that a surface does not hide itself where it is seen at an angle or bends. What lies
 * closer together than that and faces the same way is all kept. Discs are drawn with 0.7 of their
 * radius, so some of what lies behind them shows through: rather a candidate that nobody sees than
 * a hole.
 */
#ifndef PBS_VISIBLE_H
#define PBS_VISIBLE_H

#include "libcore/data/record.h"
#include "libcore/ground/run.h"
#include "libcore/gbuffer/views.h"

/* A placed prefix of surfels. */
typedef struct pbs_cloud {
    const pbs_points *points; /* position; normal NULL: discs face the viewer */
    size_t count;             /* the first so many */
    double m[12];             /* to the frame of the views */
    /* Of the discs, in the frame of the views. 0: candidates of the views themselves; each hides
     * what is behind it only in the view in the middle of whose pixel it lies, where it was seen.
     */
    double radius;
} pbs_cloud;

typedef struct pbs_visible pbs_visible; /* buffers, reused from node to node */

pbs_code pbs_visible_new(pbs_run *run, pbs_visible **out, pbs_err *err);
void pbs_visible_free(pbs_visible *v); /* NULL is fine */

/* Bytes for the buffers of such views. */
size_t pbs_visible_need(const pbs_views *views);

/* Empties the buffers. views are copied. Errors: PBS_LIMIT. */
pbs_code pbs_visible_begin(pbs_visible *v, const pbs_views *views, pbs_err *err);

/* Splats clouds; any number of calls. A surfel that is not finite in the frame of the views is
 * nowhere. Same buffers for any order and any number of threads. */
pbs_code pbs_visible_splat(pbs_visible *v, const pbs_cloud *clouds, size_t count, pbs_err *err);

/* After clouds are splatted: appends the visible surfels of one, in their order and placed, to
 * *out, which has room for cloud->count more; absent channels of the cloud that *out has are left
 * as they are. */
pbs_code pbs_visible_take(pbs_visible *v, const pbs_cloud *cloud, pbs_points *out, pbs_err *err);
#endif
