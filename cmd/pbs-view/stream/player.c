/* player.c: from the archive to the picture, a frame at a time. */
#include "cmd/pbs-view/stream/player.h"
#include <string.h>

#define GPU_DEFAULT    ((uint64_t)1 << 30)
#define LARGEST        ((uint64_t)128 << 20) /* of a storage buffer that every driver allows */
#define UPLOAD_DEFAULT ((uint64_t)16 << 20)
#define HOST_MOST      ((uint64_t)256 << 20)
#define FIRST_FRAME    ((uint64_t)64 << 20)

/* ---- the store's GPU ---- */

/* Of a software renderer the GPU's memory is the process's own. */
static bool make_buffer(void *ctx, uint64_t bytes, uint32_t *buffer) {
    pbs_player *p = ctx;
    const pbs_gl *gl = p->gl;
    pbs_err err;
    if (gl->software && pbs_mem_take(p->run, (size_t)bytes, "the GPU's memory", &err)) return false;
    gl->CreateBuffers(1, buffer);
    gl->NamedBufferStorage(*buffer, (GLsizeiptr)bytes, NULL, GL_DYNAMIC_STORAGE_BIT);
    if (pbs_gl_check(gl, "buffer", &err) == PBS_OK) {
        p->counted += gl->software ? bytes : 0;
        return true;
    }
    gl->DeleteBuffers(1, buffer);
    if (gl->software) pbs_mem_give(p->run, (size_t)bytes);
    return false;
}

static void fill_buffer(void *ctx, uint32_t buffer, uint64_t at, const void *bytes, uint64_t size) {
    const pbs_player *p = ctx;
    p->gl->NamedBufferSubData(buffer, (GLintptr)at, (GLsizeiptr)size, bytes);
}

static void drop_buffer(void *ctx, uint32_t buffer) {
    pbs_player *p = ctx;
    GLint64 bytes = 0;
    p->gl->GetNamedBufferParameteri64v(buffer, GL_BUFFER_SIZE, &bytes);
    p->gl->DeleteBuffers(1, &buffer);
    if (!p->gl->software) return;
    pbs_mem_give(p->run, (size_t)bytes);
    p->counted -= (uint64_t)bytes;
}

/* ---- from beginning to end ---- */

pbs_code pbs_player_new(pbs_run *run, const pbs_archive *a, const pbs_player_desc *desc,
                        pbs_player *p, pbs_err *err) {
    *p = (pbs_player){.run = run, .archive = a, .desc = *desc};
    pbs_code rc = pbs_source_new(run, a, &p->source, err);
    if (!rc) rc = pbs_player_open_near(p, err);
    if (rc) pbs_player_free(p);
    return rc;
}

void pbs_player_free(pbs_player *p) {
    pbs_run *run = p->run;
    if (!run) return;
    pbs_cut_free(p->cut);
    pbs_store_free(p->store, false);
    pbs_source_free(&p->source);
    pbs_mem_give(run, (size_t)p->counted);
    pbs_free(run, p->surfels);
    pbs_free(run, p->residents);
    pbs_free(run, p->cubes);
    pbs_free(run, p->near);
    pbs_free(run, p->ready);
    pbs_free(run, p->covered);
    pbs_free(run, p->needs);
    pbs_free(run, p->wanted_at);
    *p = (pbs_player){0};
}

static uint64_t least(uint64_t a, uint64_t b) {
    return a < b ? a : b;
}

/* When the first canvas is there, whose device decides how much there is. */
static pbs_code start(pbs_player *p, const pbs_canvas *canvas, pbs_err *err) {
    const pbs_archive *a = p->archive;
    uint64_t left = pbs_mem_left(p->run);
    p->gl = pbs_canvas_gl(canvas);
    p->source.largest =
        least(p->desc.buffer ? p->desc.buffer : LARGEST, (uint64_t)p->gl->max_storage);
    pbs_store_desc d = {.bytes = p->source.bytes,
                        .gpu = p->desc.gpu ? p->desc.gpu : GPU_DEFAULT,
                        .largest = p->source.largest,
                        .upload = p->desc.upload ? p->desc.upload : UPLOAD_DEFAULT,
                        .host = least(left / 4, HOST_MOST),
                        .threaded = true};
    if (p->gl->software) d.gpu = least(d.gpu, left / 2);
    pbs_store_source source = {&p->source, pbs_source_load, pbs_source_part};
    pbs_store_gpu gpu = {.ctx = p, .make = make_buffer, .fill = fill_buffer, .drop = drop_buffer};
    pbs_player_textures(p, &d, &gpu);
    pbs_code rc = pbs_store_new(p->run, &d, &source, &gpu, &p->store, err);
    if (rc) return rc;
    pbs_cut_scene scene = {a->nodes,         a->node_count,
                           p->source.has,    a->placings,
                           a->moving,        p->ready ? p->ready : pbs_store_resident(p->store),
                           p->source.profile};
    return pbs_cut_new(p->run, &scene, &p->cut, err);
}

/* ---- a frame ---- */

/* What was seen two frames ago. */
static pbs_code listen(pbs_player *p, pbs_canvas *canvas, pbs_err *err) {
    uint64_t frame;
    const uint32_t *seen;
    size_t n;
    pbs_code rc = pbs_canvas_seen(canvas, false, &frame, &seen, &n, err);
    return rc || !frame ? rc : pbs_cut_feedback(p->cut, frame, seen, n, err);
}

static pbs_code step(pbs_player *p, const pbs_cut_view *view, pbs_err *err) {
    pbs_code rc = pbs_player_load(p, &p->busy, err);
    if (!rc) rc = pbs_cut_next(p->cut, view, &p->frame, err);
    if (!rc) p->busy = p->busy || p->frame.missing;
    return rc;
}

/* Whether something of the coarsest level is missing. */
static bool unseen(const pbs_player *p) {
    for (size_t i = 0; i < p->frame.need_count && p->frame.needs[i].level == 0; i++)
        if (!pbs_store_resident(p->store)[p->frame.needs[i].item]) return true;
    return false;
}

pbs_code pbs_player_look(pbs_player *p, pbs_canvas *canvas, const pbs_cut_view *view,
                         pbs_err *err) {
    bool first = !p->store;
    pbs_code rc = first ? start(p, canvas, err) : PBS_OK;
    if (!rc && view->occlusion) rc = listen(p, canvas, err);
    if (!rc) rc = step(p, view, err);
    while (!rc && first && unseen(p) && pbs_player_measure(p).uploaded < FIRST_FRAME) {
        bool more;
        rc = pbs_player_load(p, &more, err);
        if (rc || !more) break;
        pbs_store_wait(p->store, 0.1);
        if (!(rc = pbs_run_check(p->run, err))) rc = step(p, view, err);
    }
    return rc;
}

pbs_code pbs_player_settle(pbs_player *p, pbs_canvas *canvas, const pbs_cut_view *view,
                           pbs_err *err) {
    pbs_code rc = pbs_player_look(p, canvas, view, err);
    for (bool more = true; !rc && more;) {
        rc = pbs_player_load(p, &more, err);
        if (!rc && more) pbs_store_wait(p->store, 0.1);
        if (!rc) rc = pbs_run_check(p->run, err);
        if (!rc) rc = pbs_cut_next(p->cut, view, &p->frame, err);
        /* What has just come may need more below it. */
        bool again = false;
        if (!rc && !more) rc = pbs_player_load(p, &again, err);
        more = more || again;
    }
    return rc;
}

/* Part k of a node's voxels. */
static void describe_voxels(const pbs_player *p, const pbs_cut_draw *d, uint32_t k,
                            pbs_cubes *out) {
    const pbs_source *s = &p->source;
    const pbs_node *node = &p->archive->nodes[d->node];
    uint32_t each = pbs_source_each(s, d->node), item = PBS_ITEM_OWN(d->node);
    uint64_t left = node->records - (uint64_t)each * k;
    pbs_region r = pbs_store_where(p->store, item, k);
    *out = (pbs_cubes){.buffer = r.buffer,
                       .at = r.at,
                       .count = (uint32_t)(left < each ? left : each),
                       .place = pbs_source_voxels(s, d->node, k, PBS_POSITION),
                       .normal = pbs_source_voxels(s, d->node, k, PBS_NORMAL),
                       .colour = pbs_source_voxels(s, d->node, k, PBS_COLOUR),
                       .material = pbs_source_voxels(s, d->node, k, PBS_MATERIAL),
                       .emissive = pbs_source_voxels(s, d->node, k, PBS_EMISSIVE),
                       .face = pbs_source_voxels(s, d->node, k, PBS_FACE),
                       .faces = pbs_source_voxels(s, d->node, k, 0),
                       .face_colours = s->face_colours[d->node],
                       .again = k != 0,
                       .side = node->lattice};
    if (out->faces >= 0) {
        r = pbs_store_where(p->store, item, pbs_source_faces(s, d->node));
        out->faces_buffer = r.buffer;
        out->faces_at = r.at;
        out->face_count = (uint32_t)(r.size / 4) - (uint32_t)out->faces;
    }
    memcpy(out->corner, node->origin, sizeof out->corner);
    memcpy(out->m, d->m, sizeof out->m);
}

static pbs_code list_voxels(pbs_player *p, const pbs_cut_draw *d, size_t *n, pbs_err *err) {
    uint64_t records = p->archive->nodes[d->node].records;
    uint32_t each = pbs_source_each(&p->source, d->node);
    for (uint32_t k = 0; !k || (uint64_t)each * k < records; k++) {
        pbs_code rc = pbs_grow(p->run, &p->cubes, &p->cube_cap, *n + 1, sizeof *p->cubes,
                               "the list of what is drawn", err);
        if (rc) return rc;
        describe_voxels(p, d, k, &p->cubes[(*n)++]);
    }
    if (d->kind == PBS_CUT_VOXELS) p->voxels += records;
    return PBS_OK;
}

static pbs_code draw_voxels(pbs_player *p, pbs_canvas *canvas, pbs_cut_kind kind, bool noted,
                            pbs_err *err) {
    const pbs_cut_frame *f = &p->frame;
    size_t first = f->first[kind], count = f->first[kind + 1] - first, n = 0;
    for (size_t i = 0; i < count; i++) {
        pbs_code rc = list_voxels(p, &f->draws[first + i], &n, err);
        if (rc) return rc;
    }
    pbs_voxel_mode mode = {.frame = noted ? f->number : 0,
                           .first = (uint32_t)first,
                           .all = (uint32_t)f->draw_count,
                           .probes = kind == PBS_CUT_PROBE,
                           .palette = {p->archive->materials, p->archive->material_count}};
    return pbs_canvas_voxels(canvas, p->cubes, n, &mode, err);
}

pbs_code pbs_player_draw(pbs_player *p, pbs_canvas *canvas, const pbs_cut_view *view,
                         pbs_err *err) {
    p->voxels = p->triangles = p->replaced = p->points = p->visible = 0;
    pbs_code rc = pbs_player_near(p, canvas, err);
    if (!rc) rc = draw_voxels(p, canvas, PBS_CUT_VOXELS, view->occlusion, err);
    if (!rc) rc = pbs_player_surfels(p, canvas, view, err);
    if (!rc && view->occlusion) rc = draw_voxels(p, canvas, PBS_CUT_PROBE, true, err);
    p->calls = pbs_canvas_calls(canvas);
    return rc;
}

pbs_store_stats pbs_player_measure(const pbs_player *p) {
    return p->store ? pbs_store_measure(p->store) : (pbs_store_stats){0};
}
