/* below.c: prefixes of kept surfels, placed, splatted and asked for (paper 1, section 3.4). */
#include "formats/surfels/below.h"
#include "formats/surfels/hierarchy.h"
#include <stdlib.h>
#include <string.h>

typedef struct placing {
    uint32_t node;
    size_t order; /* in the walk */
    size_t prefix;
    double m[12];
    double radius;
} placing;

struct pbs_below {
    pbs_run *run;
    pbs_keep *keep;
    pbs_visible *visible;
    placing *placings;
    size_t count, cap;
    pbs_cloud *clouds; /* of one node's placings */
    size_t clouds_cap;
    pbs_points surfels; /* of that node */
    size_t surfels_cap;
    const pbs_node *nodes;
    double pixel;
    uint64_t splats;
};

pbs_code pbs_below_new(pbs_run *run, pbs_keep *keep, pbs_below **out, pbs_err *err) {
    pbs_below *b = *out = calloc(1, sizeof *b);
    if (!b) return pbs_fail(err, PBS_LIMIT, "no memory");
    b->run = run;
    b->keep = keep;
    pbs_code rc = pbs_visible_new(run, &b->visible, err);
    if (!rc) return PBS_OK;
    pbs_below_free(b);
    *out = NULL;
    return rc;
}

void pbs_below_free(pbs_below *b) {
    if (!b) return;
    pbs_visible_free(b->visible);
    pbs_free(b->run, b->placings);
    pbs_free(b->run, b->clouds);
    pbs_points_free(b->run, &b->surfels);
    free(b);
}

/* ---- which prefixes, where ---- */

static pbs_code add_placing(void *ctx, uint32_t node, const double m[12], pbs_err *err) {
    pbs_below *b = ctx;
    pbs_code rc = pbs_grow(b->run, &b->placings, &b->cap, b->count + 1, sizeof *b->placings,
                           "the placed surfels", err);
    if (rc) return rc;
    placing p = {.node = node, .order = b->count};
    double stretch = pbs_lod_stretch(m), covered;
    if (!(stretch > 0) || !isfinite(stretch)) return PBS_OK;
    memcpy(p.m, m, sizeof p.m);
    rc = pbs_keep_prefix(b->keep, node, PBS_LOD_DENSE * b->pixel / stretch, &p.prefix, &covered,
                         err);
    /* A surface is up to 0.7 pixels away from the candidates that the radius was measured on. */
    p.radius = stretch * (covered + 0.7 * b->nodes[node].pixel);
    if (!rc && p.prefix) b->placings[b->count++] = p;
    return rc;
}

/* Placings of one node become neighbours. */
static int by_node(const void *a, const void *b) {
    const placing *p = a, *q = b;
    if (p->node != q->node) return p->node < q->node ? -1 : 1;
    return p->order < q->order ? -1 : 1;
}

static pbs_code list_placings(pbs_below *b, const uint64_t *used, uint32_t node, pbs_err *err) {
    b->count = 0;
    b->pixel = b->nodes[node].pixel;
    pbs_code rc = pbs_plan_below(b->run, b->nodes, used, node, add_placing, b, err);
    if (!rc && b->count) qsort(b->placings, b->count, sizeof *b->placings, by_node);
    return rc;
}

/* ---- node by node ---- */

/* The clouds of all placings of the node that placing `first` is of; *end is behind them. */
static pbs_code load(pbs_below *b, size_t first, size_t *end, pbs_err *err) {
    size_t n = 0, most = 0;
    while (first + n < b->count && b->placings[first + n].node == b->placings[first].node) {
        if (b->placings[first + n].prefix > most) most = b->placings[first + n].prefix;
        n++;
    }
    *end = first + n;
    pbs_code rc =
        pbs_keep_get(b->keep, b->placings[first].node, most, &b->surfels, &b->surfels_cap, err);
    if (!rc)
        rc = pbs_grow(b->run, &b->clouds, &b->clouds_cap, n, sizeof *b->clouds,
                      "the placed surfels", err);
    for (size_t i = 0; i < n && !rc; i++) {
        const placing *p = &b->placings[first + i];
        b->clouds[i] = (pbs_cloud){.points = &b->surfels, .count = p->prefix, .radius = p->radius};
        memcpy(b->clouds[i].m, p->m, sizeof p->m);
    }
    return rc;
}

static pbs_code splat_all(pbs_below *b, const pbs_cloud *own, pbs_err *err) {
    pbs_code rc = pbs_visible_splat(b->visible, own, 1, err);
    for (size_t i = 0, end; i < b->count && !rc; i = end) {
        rc = load(b, i, &end, err);
        if (!rc) rc = pbs_visible_splat(b->visible, b->clouds, end - i, err);
    }
    return rc;
}

static pbs_code take(pbs_below *b, const pbs_cloud *cloud, uint32_t channels, pbs_points *out,
                     size_t *cap, pbs_err *err) {
    b->splats += cloud->count;
    pbs_code rc = pbs_points_grow(b->run, channels, out, cap, out->count + cloud->count, err);
    return rc ? rc : pbs_visible_take(b->visible, cloud, out, err);
}

static pbs_code take_all(pbs_below *b, const pbs_cloud *own, uint32_t channels, pbs_points *out,
                         size_t *cap, pbs_err *err) {
    pbs_code rc = splat_all(b, own, err);
    if (!rc) rc = take(b, own, channels, out, cap, err);
    for (size_t i = 0, end; i < b->count && !rc; i = end) {
        rc = load(b, i, &end, err);
        for (size_t k = 0; k < end - i && !rc; k++)
            rc = take(b, &b->clouds[k], channels, out, cap, err);
    }
    return rc;
}

/* ---- the views of the node ---- */

/* What the candidates and surfels take up, within the node's box: that has what moves in it too,
 * which may be far away. */
static pbs_box box_of(const pbs_below *b, const pbs_node *n, const pbs_points *points) {
    pbs_box box = PBS_BOX_EMPTY;
    for (size_t i = 0; i < points->count; i++) {
        const float *f = points->position + 3 * i;
        double p[3] = {f[0], f[1], f[2]};
        if (isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2])) pbs_box_add(&box, p);
    }
    for (size_t i = 0; i < b->count; i++) {
        pbs_box own = pbs_keep_box(b->keep, b->placings[i].node);
        pbs_box placed = pbs_xform_box(b->placings[i].m, &own);
        pbs_box_add(&box, placed.min);
        pbs_box_add(&box, placed.max);
    }
    for (int k = 0; k < 3; k++) {
        box.min[k] = fmax(box.min[k], n->box.min[k] - n->origin[k]);
        box.max[k] = fmin(box.max[k], n->box.max[k] - n->origin[k]);
    }
    return box;
}

static bool damaged_views(const pbs_node *n, const pbs_gbuffer_params *p, pbs_views *views) {
    return !(n->pixel > 0) || pbs_views_plan(p, views, NULL);
}

/* With a resolution of 2 one pixel is the longest side. */
static void choose_resolution(const pbs_node *n, const pbs_views *one, pbs_gbuffer_params *p) {
    double r = round(one->pixel / n->pixel * (1 - 1e-12)) + 1;
    p->resolution = (uint32_t)fmin(fmax(r, 2), PBS_GBUFFER_MAX_SIZE);
}

/* The very views that the candidates were seen in: each then lies in the middle of a pixel of its
 * view. Unless something below moves: then the node's box is larger than what was drawn, and views
 * around what is there must do. */
static pbs_code plan_views(const pbs_below *b, const pbs_node *n, const pbs_points *points,
                           pbs_views *views, pbs_err *err) {
    pbs_gbuffer_params p = {.resolution = 2, .box = n->box};
    if (n->flags & PBS_NODE_CORNERS || !(n->flags & PBS_NODE_FACES)) {
        memcpy(p.direction, PBS_GBUFFER_CORNERS, sizeof PBS_GBUFFER_CORNERS);
        p.pairs = 4;
    }
    for (int k = 0; k < 3 && n->flags & PBS_NODE_FACES; k++) p.direction[p.pairs++][k] = 1;
    for (int k = 0; k < 3; k++) p.box.min[k] -= n->origin[k], p.box.max[k] -= n->origin[k];
    if (!damaged_views(n, &p, views)) {
        choose_resolution(n, views, &p);
        pbs_code rc = pbs_views_plan(&p, views, err);
        if (rc || views->pixel == n->pixel) return rc;
    }
    p.resolution = 2;
    p.box = box_of(b, n, points);
    if (damaged_views(n, &p, views))
        return pbs_fail(err, PBS_DATA, "node %u: its box or its pixel is damaged", n->id);
    choose_resolution(n, views, &p);
    return pbs_views_plan(&p, views, err);
}

pbs_code pbs_below_add(pbs_below *b, const pbs_node *nodes, const uint64_t *used, uint32_t node,
                       uint32_t channels, pbs_points *points, size_t *cap, uint64_t *splats,
                       pbs_err *err) {
    pbs_views views;
    pbs_points merged = {0};
    size_t merged_cap = 0;
    b->nodes = nodes;
    b->splats = 0;
    pbs_code rc = list_placings(b, used, node, err);
    if (rc || (!b->count && !points->count)) return rc;
    rc = plan_views(b, &nodes[node], points, &views, err);
    if (!rc) rc = pbs_visible_begin(b->visible, &views, err);
    pbs_cloud own = {.points = points, .count = points->count};
    memcpy(own.m, PBS_IDENTITY, sizeof own.m);
    if (!rc) rc = take_all(b, &own, channels, &merged, &merged_cap, err);
    if (rc) {
        pbs_points_free(b->run, &merged);
        return rc;
    }
    pbs_points_free(b->run, points);
    *points = merged;
    *cap = merged_cap;
    *splats += b->splats;
    return PBS_OK;
}
