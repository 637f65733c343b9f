/* player_surfels.c: surfels and points of clouds: as discs, or through the passes that look at
 * single ones. */
#include "cmd/pbs-view/stream/player.h"

/* Part k of a node's surfels: those of the first `prefix` of it. */
static void describe(const pbs_player *p, const pbs_cut_draw *d, const pbs_cut_view *view,
                     uint32_t k, uint32_t prefix, pbs_surfels *out) {
    const pbs_node *node = &p->archive->nodes[d->node];
    pbs_region r = pbs_store_where(p->store, PBS_ITEM_OWN(d->node), k);
    uint64_t octaves = pbs_source_octaves(&p->source, d->node, k);
    uint32_t each = pbs_source_each(&p->source, d->node), before = each * k;
    bool per_point = p->desc.per_point && !view->prefix && !(node->flags & PBS_NODE_ADDS);
    *out = (pbs_surfels){.buffer = r.buffer,
                         .at = r.at,
                         .octave = octaves ? r.at + octaves : 0,
                         .stride = p->archive->record.stride,
                         .channels = p->archive->record.channels,
                         .prefix = prefix - before < each ? prefix - before : each,
                         .whole = (uint32_t)node->records,
                         .radius = d->radius,
                         .step = node->lattice,
                         .size = per_point ? view->size : 0,
                         .slack = p->source.profile[d->node]->slack};
    if (each < node->records) out->part = (pbs_part){before, each, prefix};
    if (each < node->records && node->records - before < each)
        out->part.here = (uint32_t)node->records - before;
    for (int i = 0; i < 3; i++) out->corner[i] = node->origin[i] + node->lattice_min[i];
    memcpy(out->m, d->m, sizeof out->m);
}

static pbs_resident resident_of(const pbs_surfels *s, uint64_t key) {
    pbs_resident r = {.key = key,
                      .buffer = s->buffer,
                      .offset = s->at,
                      .octaves = s->octave ? s->octave : PBS_NO_OCTAVES,
                      .stride = s->stride,
                      .channels = s->channels,
                      .prefix = s->prefix,
                      .whole = s->whole,
                      .part = s->part,
                      .radius = s->radius,
                      .step = s->step};
    memcpy(r.corner, s->corner, sizeof r.corner);
    memcpy(r.m, s->m, sizeof r.m);
    return r;
}

static pbs_code list_parts(pbs_player *p, const pbs_cut_draw *d, const pbs_cut_view *view,
                           uint32_t prefix, size_t *count, pbs_err *err) {
    uint32_t each = pbs_source_each(&p->source, d->node);
    pbs_code rc = PBS_OK;
    for (uint32_t k = 0; !rc && (uint64_t)each * k < prefix; k++) {
        rc = pbs_grow(p->run, &p->surfels, &p->surfel_cap, *count + 1, sizeof *p->surfels,
                      "the list of what is drawn", err);
        if (!rc)
            rc = pbs_grow(p->run, &p->residents, &p->resident_cap, *count + 1, sizeof *p->residents,
                          "the list of what is drawn", err);
        if (rc) break;
        pbs_surfels *s = &p->surfels[*count];
        describe(p, d, view, k, prefix, s);
        p->residents[(*count)++] = resident_of(s, d->key);
    }
    return rc;
}

/* Surfels or, with clouds, points that a pass chooses from: all of each node's. */
static pbs_code list(pbs_player *p, const pbs_cut_view *view, bool clouds, size_t *count,
                     pbs_err *err) {
    const pbs_cut_frame *f = &p->frame;
    pbs_code rc = PBS_OK;
    *count = 0;
    for (size_t i = f->first[PBS_CUT_SURFELS]; i < f->first[PBS_CUT_SURFELS + 1] && !rc; i++) {
        const pbs_cut_draw *d = &f->draws[i];
        const pbs_node *node = &p->archive->nodes[d->node];
        bool cloud = p->desc.points && node->flags & PBS_NODE_ADDS;
        if (cloud != clouds) continue;
        if (clouds) p->replaced += d->prefix;
        rc = list_parts(p, d, view, clouds ? (uint32_t)node->records : d->prefix, count, err);
    }
    return rc;
}

/* How far apart points of the clouds in the list usually are, where they are closest; 0: unknown.
 */
static double closest(const pbs_player *p) {
    const pbs_cut_frame *f = &p->frame;
    double least = INFINITY;
    for (size_t i = f->first[PBS_CUT_SURFELS]; i < f->first[PBS_CUT_SURFELS + 1]; i++) {
        const pbs_node *n = &p->archive->nodes[f->draws[i].node];
        if (n->flags & PBS_NODE_ADDS && n->covering > 0) least = fmin(least, n->covering);
    }
    return isfinite(least) ? least : 0;
}

/* Discs of the clouds' points are as large as those of the cut: four wanted spacings. */
static pbs_code draw_clouds(pbs_player *p, pbs_canvas *canvas, const pbs_cut_view *view,
                            pbs_err *err) {
    const pbs_reduce_options o = {.spacing = 250 * view->size *
                                             pbs_camera_pixel(&view->camera, view->height),
                                  .size = 4,
                                  .smallest = 2 * closest(p),
                                  .periphery = p->desc.points == PBS_POINTS_PERIPHERY,
                                  .cast = p->desc.points == PBS_POINTS_CAST};
    size_t count;
    bool again = false;
    pbs_code rc = list(p, view, true, &count, err);
    if (rc || !count) return rc;
    rc = pbs_passes_points(canvas, p->residents, count, &o, p->desc.still, &again, err);
    p->busy = p->busy || again;
    return rc || !p->desc.still ? rc : pbs_passes_points_count(canvas, &p->points, err);
}

pbs_code pbs_player_surfels(pbs_player *p, pbs_canvas *canvas, const pbs_cut_view *view,
                            pbs_err *err) {
    const pbs_splat_options o = {.whole = p->desc.splat == PBS_SPLAT_WHOLE,
                                 .afresh = p->desc.splat == PBS_SPLAT_AFRESH};
    pbs_splat_counts counts = {0};
    size_t n;
    pbs_code rc = p->desc.points ? draw_clouds(p, canvas, view, err) : PBS_OK;
    if (!rc) rc = list(p, view, false, &n, err);
    if (rc) return rc;
    if (!p->desc.splat) return pbs_canvas_surfels(canvas, p->surfels, n, err);
    rc = pbs_passes_splat(canvas, p->residents, n, &o, err);
    if (!rc && p->desc.still) rc = pbs_passes_splat_count(canvas, &counts, err);
    p->visible = counts.visible + counts.plain;
    return rc;
}
