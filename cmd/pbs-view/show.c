#include "cmd/pbs-view/show.h"
#include "cmd/pbs-view/cut.h"
#include "cmd/pbs-view/retained.h"
#include "formats/dag.h"
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

pbs_code pbs_show_open(pbs_run *run, const pbs_show_options *o, const char *path, pbs_show *s,
                       pbs_err *err) {
    memset(s, 0, sizeof *s);
    s->run = run;
    s->options = o;
    pbs_code rc =
        o->geometry ? open_scene(s, path, err) : pbs_archive_open(run, path, &s->archive, err);
    if (!rc && !o->geometry) s->box = s->archive.nodes[s->archive.node_count - 1].box;
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

/* A placed node whose subtree is still to be looked at. */
typedef struct task {
    uint32_t node;
    bool drawn; /* its surfels are: only what moves below it is left */
    double m[12];
} task;

typedef struct cut {
    pbs_show *show;
    const pbs_show_view *view;
    double aspect;
    size_t count, clouds, cubes;
    double least; /* distance of points of the clouds that are as near as any */
    task *tasks, now;
    size_t task_count, task_cap;
} cut;

static pbs_code add_task(cut *c, uint32_t node, bool drawn, const double m[12], pbs_err *err) {
    pbs_code rc = pbs_grow(c->show->run, &c->tasks, &c->task_cap, c->task_count + 1,
                           sizeof *c->tasks, "the list of what is drawn", err);
    if (rc) return rc;
    task *t = &c->tasks[c->task_count++];
    *t = (task){.node = node, .drawn = drawn};
    memcpy(t->m, m, sizeof t->m);
    return PBS_OK;
}

static pbs_spacings spacings_of(const pbs_archive *a, const pbs_node *n) {
    return (pbs_spacings){a->records[n->id] + pbs_record_at(&a->record, PBS_SPACING),
                          a->record.stride,
                          (uint32_t)n->records,
                          65535 * n->lattice,
                          n->covering,
                          0.7 * n->pixel};
}

/* With --prefix the discs close the surface whatever it costs in shape; without, they are as
 * large as the camera allows and the prefix is what closes the surface then (paper 1, 4.1). */
static void choose(const cut *c, const pbs_node *n, const double m[12], pbs_surfels *out) {
    const pbs_show_options *o = c->show->options;
    pbs_spacings s = spacings_of(&c->show->archive, n);
    if (o->prefix) {
        out->prefix = o->prefix < s.count ? (uint32_t)o->prefix : s.count;
    } else {
        const pbs_show_view *v = c->view;
        double depth = pbs_cut_depth(&v->camera, c->aspect, &n->box, m);
        double wanted = pbs_cut_wanted(&v->camera, v->height, depth, v->surfel_size, m);
        out->prefix = pbs_cut_prefix(&s, wanted);
    }
    out->radius = pbs_cut_radius(&s, out->prefix);
}

/* A node whose points stay when its children are drawn (cloudpack.h). All of them together close
 * the surface: discs are as large as the camera allows, of points half as far apart, but not
 * smaller than points of the cloud usually are apart. *finer: the children have points that are
 * wanted, too. */
static void choose_adding(const cut *c, const pbs_node *n, const double m[12], pbs_surfels *out,
                          bool *finer) {
    const pbs_show_options *o = c->show->options;
    const pbs_show_view *v = c->view;
    pbs_spacings s = spacings_of(&c->show->archive, n);
    double depth = pbs_cut_depth(&v->camera, c->aspect, &n->box, m);
    double wanted = pbs_cut_wanted(&v->camera, v->height, depth, v->surfel_size, m);
    out->prefix = o->prefix ? (o->prefix < s.count ? (uint32_t)o->prefix : s.count)
                            : pbs_cut_adding(&s, wanted / 2);
    out->radius = fmax(o->prefix ? 0 : wanted, n->covering);
    *finer = !o->prefix ? out->prefix == s.count : o->prefix > s.count;
}

static pbs_code add_surfels(cut *c, uint32_t id, const double m[12], bool *finer, pbs_err *err) {
    pbs_show *s = c->show;
    const pbs_archive *a = &s->archive;
    const pbs_node *n = &a->nodes[id];
    bool reduce = s->options->points && n->flags & PBS_NODE_ADDS;
    if (!reduce && !pbs_cut_visible(&c->view->camera, c->aspect, &n->box, n->covering, m))
        return PBS_OK;
    pbs_surfels **list = reduce ? &s->clouds : &s->list;
    size_t *count = reduce ? &c->clouds : &c->count;
    pbs_code rc = pbs_grow(s->run, list, reduce ? &s->clouds_cap : &s->list_cap, *count + 1,
                           sizeof **list, "the list of what is drawn", err);
    if (rc) return rc;
    pbs_surfels *d = &(*list)[(*count)++];
    *d = (pbs_surfels){.records = a->records[id],
                       .stride = a->record.stride,
                       .channels = a->record.channels,
                       .whole = (uint32_t)n->records,
                       .octaves = a->octaves[id],
                       .step = n->lattice};
    for (int k = 0; k < 3; k++) d->corner[k] = n->origin[k] + n->lattice_min[k];
    memcpy(d->m, m, sizeof d->m);
    if (reduce) {
        d->prefix = d->whole;
        *finer = true;
        if (n->covering > 0) c->least = fmin(c->least, n->covering);
    } else if (n->flags & PBS_NODE_ADDS)
        choose_adding(c, n, m, d, finer);
    else
        choose(c, n, m, d);
    s->drawn_nodes++;
    if (!reduce) s->drawn_surfels += d->prefix;
    return PBS_OK;
}

/* Children in the place of their parent: all of them or none, so that nothing is missing. */
static bool has_finer(const pbs_archive *a, const pbs_node *n) {
    for (uint32_t i = 0; i < n->child_count; i++) {
        size_t chunks;
        pbs_archive_voxels(a, n->children[i].node, &chunks);
        if (!chunks) return false;
    }
    return n->child_count != 0;
}

/* A chunk of voxels: drawn if its cells are small enough in the picture, or there are no finer. */
static pbs_code visit_voxels(cut *c, const pbs_node *n, const double m[12], bool *descend,
                             pbs_err *err) {
    pbs_show *s = c->show;
    const pbs_show_view *v = c->view;
    *descend = false;
    if (!pbs_cut_visible(&v->camera, c->aspect, &n->box, 0, m)) return PBS_OK;
    double depth = pbs_cut_depth(&v->camera, c->aspect, &n->box, m);
    *descend = !pbs_cut_fine(&v->camera, v->height, depth, v->surfel_size, n->lattice, m) &&
               has_finer(&s->archive, n);
    if (*descend) return PBS_OK;
    pbs_code rc = pbs_grow(s->run, &s->cubes, &s->cubes_cap, c->cubes + 1, sizeof *s->cubes,
                           "the list of what is drawn", err);
    if (rc) return rc;
    pbs_cubes *d = &s->cubes[c->cubes++];
    d->chunks = pbs_archive_voxels(&s->archive, n->id, &d->chunk_count);
    memcpy(d->corner, n->origin, sizeof d->corner);
    d->side = n->lattice;
    memcpy(d->m, m, sizeof d->m);
    s->drawn_nodes++;
    s->drawn_voxels += n->records;
    return PBS_OK;
}

/* A node with surfels stands for everything below it but what moves. */
static pbs_code visit(void *ctx, uint32_t id, const double m[12], uint32_t flags, bool *descend,
                      pbs_err *err) {
    cut *c = ctx;
    const pbs_archive *a = &c->show->archive;
    double placed[12];
    pbs_xform_mul(placed, c->now.m, m);
    if (c->now.drawn) {
        bool moves = flags & PBS_CHILD_MOVES;
        *descend = !moves && a->moving[id];
        return moves ? add_task(c, id, false, placed, err) : PBS_OK;
    }
    size_t chunks;
    pbs_archive_voxels(a, id, &chunks);
    if (chunks) return visit_voxels(c, &a->nodes[id], placed, descend, err);
    *descend = !a->records[id] && a->placings[id];
    if (!a->records[id]) return PBS_OK;
    bool finer = false;
    pbs_code rc = add_surfels(c, id, placed, &finer, err);
    if (finer) *descend = true;
    return rc || !a->moving[id] ? rc : add_task(c, id, true, placed, err);
}

static pbs_code list_all(cut *c, pbs_err *err) {
    const pbs_archive *a = &c->show->archive;
    pbs_code rc = add_task(c, (uint32_t)a->node_count - 1, false, PBS_IDENTITY, err);
    while (!rc && c->task_count) {
        c->now = c->tasks[--c->task_count];
        rc = pbs_dag_walk(c->show->run, a->nodes, c->now.node + 1, visit, c, err);
    }
    pbs_free(c->show->run, c->tasks);
    return rc;
}

/* Discs of the clouds' points are as large as those of the cut: four wanted spacings. */
static pbs_code draw_clouds(pbs_show *s, pbs_canvas *canvas, const cut *c, pbs_err *err) {
    const pbs_show_view *v = c->view;
    pbs_reduce_options o = {.spacing =
                                250 * v->surfel_size * pbs_camera_pixel(&v->camera, v->height),
                            .size = 4,
                            .smallest = isfinite(c->least) ? 2 * c->least : 0,
                            .periphery = s->options->points == PBS_POINTS_PERIPHERY,
                            .cast = s->options->points == PBS_POINTS_CAST};
    uint64_t kept = 0;
    if (!c->clouds) return PBS_OK;
    pbs_code rc = pbs_retained_points(canvas, s->clouds, c->clouds, &o, s->options->shot,
                                      &s->unfinished, err);
    if (!rc && s->options->shot) rc = pbs_retained_points_count(canvas, &kept, err);
    s->drawn_surfels += kept;
    return rc;
}

static pbs_code draw_surfels(pbs_show *s, pbs_canvas *canvas, size_t count, pbs_err *err) {
    const int splat = s->options->splat;
    const pbs_splat_options o = {.whole = splat == PBS_SPLAT_WHOLE,
                                 .afresh = splat == PBS_SPLAT_AFRESH};
    pbs_splat_counts counts = {0};
    if (!splat) return pbs_canvas_surfels(canvas, s->list, count, err);
    pbs_code rc = pbs_retained_splat(canvas, s->list, count, &o, err);
    if (!rc && s->options->shot) rc = pbs_retained_splat_count(canvas, &counts, err);
    s->visible_surfels = counts.visible + counts.plain;
    return rc;
}

static pbs_code draw_archive(pbs_show *s, pbs_canvas *canvas, const pbs_show_view *view,
                             pbs_err *err) {
    cut c = {.show = s,
             .view = view,
             .aspect = (double)view->width / (double)view->height,
             .least = INFINITY};
    s->unfinished = false;
    pbs_code rc = list_all(&c, err);
    if (!rc) rc = pbs_canvas_voxels(canvas, s->cubes, c.cubes, err);
    if (!rc) rc = draw_clouds(s, canvas, &c, err);
    return rc ? rc : draw_surfels(s, canvas, c.count, err);
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
    s->visible_surfels = 0;
    pbs_code rc = pbs_canvas_begin(canvas, &frame, err);
    if (rc) return rc;
    return s->options->geometry ? draw_scene(s, canvas, err) : draw_archive(s, canvas, view, err);
}

void pbs_show_close(pbs_show *s) {
    pbs_run *run = s->run;
    pbs_images_free(run, s->images, s->scene.texture_count);
    pbs_free(run, s->flat.draws);
    pbs_free(run, s->list);
    pbs_free(run, s->clouds);
    pbs_free(run, s->cubes);
    if (s->scene.run) pbs_scene_close(&s->scene);
    if (s->archive.run) pbs_archive_close(&s->archive);
    memset(s, 0, sizeof *s);
}
