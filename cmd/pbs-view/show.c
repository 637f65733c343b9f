#include "cmd/pbs-view/show.h"
#include <string.h>

static pbs_code open_scene(pbs_show *s, const char *path, pbs_err *err) {
    pbs_scene_options so = PBS_SCENE_DEFAULTS;
    so.ignore_missing = s->options->ignore_missing;
    pbs_code rc = pbs_scene_open(s->run, path, &so, &s->scene, err);
    if (rc) return rc;
    rc = pbs_scene_flatten(&s->scene, &s->flat, err);
    if (rc) return rc;
    s->box = s->flat.box;
    for (size_t i = 0; i < s->flat.count; i++)
        for (int k = 0; k < 3; k++) s->flat.draws[i].m[4 * k + 3] += s->flat.origin[k];
    return pbs_scene_images(&s->scene, &s->images, err);
}

static void make_profile(pbs_show *s, uint32_t id) {
    const pbs_archive *a = &s->archive;
    const pbs_node *n = &a->nodes[id];
    pbs_spacings spacings = {a->records[id] + pbs_record_at(&a->record, PBS_SPACING),
                             a->record.stride,
                             (uint32_t)n->records,
                             65535 * n->lattice,
                             n->covering,
                             0.7 * n->pixel};
    pbs_profile_make(&spacings, &s->profiles[id]);
    s->profile[id] = &s->profiles[id];
}

static pbs_code open_archive(pbs_show *s, const char *path, pbs_err *err) {
    const char *what = "the table of nodes";
    pbs_archive *a = &s->archive;
    pbs_code rc = pbs_archive_open(s->run, path, a, err);
    if (rc) return rc;
    size_t n = a->node_count;
    s->box = a->nodes[n - 1].box;
    rc = pbs_alloc(s->run, &s->has, n, 1, what, err);
    if (!rc) rc = pbs_alloc(s->run, &s->resident, 2 * n, 1, what, err);
    if (!rc) rc = pbs_alloc(s->run, &s->profiles, n, sizeof *s->profiles, what, err);
    if (!rc) rc = pbs_alloc(s->run, &s->profile, n, sizeof *s->profile, what, err);
    if (rc) return rc;
    memset(s->resident, 1, 2 * n);
    for (uint32_t i = 0; i < n; i++) {
        size_t chunks;
        pbs_archive_voxels(a, i, &chunks);
        s->has[i] = a->records[i] ? PBS_HAS_SURFELS : chunks ? PBS_HAS_VOXELS : 0;
        if (a->records[i]) make_profile(s, i);
    }
    pbs_cut_scene scene = {a->nodes, n, s->has, a->placings, a->moving, s->resident, s->profile};
    return pbs_cut_new(s->run, &scene, &s->cut, err);
}

pbs_code pbs_show_open(pbs_run *run, const pbs_show_options *o, const char *path, pbs_show *s,
                       pbs_err *err) {
    memset(s, 0, sizeof *s);
    s->run = run;
    s->options = o;
    pbs_code rc = o->geometry ? open_scene(s, path, err) : open_archive(s, path, err);
    if (!rc) {
        pbs_camera_desc d = {.aspect = (double)o->width / (double)o->height};
        d.up[o->up] = 1;
        pbs_camera_frame(&s->camera, &s->box, &d);
        if (o->camera) rc = pbs_camera_parse(&s->camera, o->camera, err);
    }
    if (rc) pbs_show_close(s);
    return rc;
}

/* ---- which surfels and voxels ---- */

static pbs_code draw_surfels(pbs_show *s, pbs_canvas *canvas, const pbs_cut_frame *f,
                             pbs_err *err) {
    const pbs_archive *a = &s->archive;
    size_t first = f->first[PBS_CUT_SURFELS], n = f->first[PBS_CUT_SURFELS + 1] - first;
    pbs_code rc = pbs_grow(s->run, &s->list, &s->list_cap, n, sizeof *s->list,
                           "the list of what is drawn", err);
    for (size_t i = 0; i < n && !rc; i++) {
        const pbs_cut_draw *d = &f->draws[first + i];
        const pbs_node *node = &a->nodes[d->node];
        pbs_surfels *out = &s->list[i];
        *out = (pbs_surfels){.records = a->records[d->node],
                             .stride = a->record.stride,
                             .channels = a->record.channels,
                             .prefix = d->prefix,
                             .whole = (uint32_t)node->records,
                             .octaves = a->octaves[d->node],
                             .radius = d->radius,
                             .step = node->lattice};
        for (int k = 0; k < 3; k++) out->corner[k] = node->origin[k] + node->lattice_min[k];
        memcpy(out->m, d->m, sizeof out->m);
    }
    return rc ? rc : pbs_canvas_surfels(canvas, s->list, n, err);
}

static pbs_code draw_voxels(pbs_show *s, pbs_canvas *canvas, const pbs_cut_frame *f, pbs_err *err) {
    const pbs_archive *a = &s->archive;
    size_t first = f->first[PBS_CUT_VOXELS], n = f->first[PBS_CUT_VOXELS + 1] - first;
    pbs_code rc = pbs_grow(s->run, &s->cubes, &s->cubes_cap, n, sizeof *s->cubes,
                           "the list of what is drawn", err);
    for (size_t i = 0; i < n && !rc; i++) {
        const pbs_cut_draw *d = &f->draws[first + i];
        pbs_cubes *out = &s->cubes[i];
        out->chunks = pbs_archive_voxels(a, d->node, &out->chunk_count);
        memcpy(out->corner, a->nodes[d->node].origin, sizeof out->corner);
        out->side = a->nodes[d->node].lattice;
        memcpy(out->m, d->m, sizeof out->m);
        s->drawn_voxels += a->nodes[d->node].records;
    }
    return rc ? rc : pbs_canvas_voxels(canvas, s->cubes, n, err);
}

static pbs_code draw_archive(pbs_show *s, pbs_canvas *canvas, const pbs_show_view *view,
                             pbs_err *err) {
    pbs_cut_view v = {.camera = view->camera,
                      .width = view->width,
                      .height = view->height,
                      .size = view->surfel_size,
                      .prefix = s->options->prefix,
                      .formula = s->options->formula};
    pbs_cut_frame f;
    pbs_code rc = pbs_cut_next(s->cut, &v, &f, err);
    if (rc) return rc;
    s->drawn_nodes = f.draw_count;
    s->drawn_surfels = f.surfels;
    rc = draw_surfels(s, canvas, &f, err);
    return rc ? rc : draw_voxels(s, canvas, &f, err);
}

static pbs_code draw_scene(pbs_show *s, pbs_canvas *canvas, pbs_err *err) {
    pbs_meshes m = {s->flat.draws,           s->flat.count, s->scene.materials,
                    s->scene.material_count, s->images,     s->scene.texture_count};
    s->drawn_nodes = s->flat.count;
    s->drawn_triangles = s->flat.triangles;
    return pbs_canvas_meshes(canvas, &m, err);
}

pbs_show_view pbs_show_first_view(const pbs_show *s) {
    const pbs_show_options *o = s->options;
    return (pbs_show_view){s->camera, (uint32_t)o->width, (uint32_t)o->height, o->surfel_size};
}

pbs_code pbs_show_draw(pbs_show *s, pbs_canvas *canvas, const pbs_show_view *view, pbs_err *err) {
    pbs_frame frame = {.camera = view->camera};
    s->drawn_nodes = s->drawn_surfels = s->drawn_voxels = s->drawn_triangles = 0;
    pbs_code rc = pbs_canvas_begin(canvas, &frame, err);
    if (rc) return rc;
    return s->options->geometry ? draw_scene(s, canvas, err) : draw_archive(s, canvas, view, err);
}

void pbs_show_close(pbs_show *s) {
    pbs_run *run = s->run;
    pbs_images_free(run, s->images, s->scene.texture_count);
    pbs_free(run, s->flat.draws);
    pbs_free(run, s->list);
    pbs_free(run, s->cubes);
    pbs_cut_free(s->cut);
    pbs_free(run, s->has);
    pbs_free(run, s->resident);
    pbs_free(run, s->profiles);
    pbs_free(run, s->profile);
    if (s->scene.run) pbs_scene_close(&s->scene);
    if (s->archive.run) pbs_archive_close(&s->archive);
    memset(s, 0, sizeof *s);
}
