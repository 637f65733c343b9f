#include "cmd/pbs-view/show.h"
#include "formats/scene/dag.h"
#include <string.h>

static uint64_t own_moving(const void *ctx, uint32_t node) {
    const pbs_node *n = (const pbs_node *)ctx + node;
    uint64_t sum = 0;
    for (uint32_t i = 0; i < n->child_count; i++)
        sum += (n->children[i].flags & PBS_CHILD_MOVES) != 0;
    return sum;
}

/* The camera's frame is the world's. */
static void to_world(pbs_flat *flat) {
    for (size_t i = 0; i < flat->count; i++)
        for (int k = 0; k < 3; k++) flat->draws[i].m[4 * k + 3] += flat->origin[k];
}

static pbs_code open_scene(pbs_show *s, const char *path, pbs_err *err) {
    pbs_scene_options so = PBS_SCENE_DEFAULTS;
    so.ignore_missing = s->options->ignore_missing;
    pbs_code rc = pbs_scene_open(s->run, path, &so, &s->scene, err);
    if (rc) return rc;
    rc = pbs_scene_flatten(&s->scene, &s->flat, err);
    if (rc) return rc;
    s->box = s->flat.box;
    to_world(&s->flat);
    s->drawn_at = NAN;
    const pbs_node *nodes = s->scene.nodes;
    rc = pbs_poses_open(s->run, &s->scene.motions, s->options->animation, &s->poses, err);
    if (!rc)
        rc = pbs_dag_count(s->run, nodes, s->scene.node_count, own_moving, nodes, &s->moving, err);
    return rc ? rc : pbs_scene_images(&s->scene, &s->images, err);
}

static pbs_code open_archive(pbs_show *s, const char *path, pbs_err *err) {
    const pbs_show_options *o = s->options;
    pbs_player_desc d = {.gpu = o->gpu_memory,
                         .upload = o->upload,
                         .buffer = o->buffer,
                         .per_point = o->per_point,
                         .splat = o->splat,
                         .points = o->points,
                         .still = o->still};
    pbs_code rc = pbs_archive_open(s->run, path, &s->archive, err);
    if (rc) return rc;
    s->box = s->archive.nodes[s->archive.node_count - 1].box;
    rc = pbs_poses_open(s->run, &s->archive.motions, s->options->animation, &s->poses, err);
    return rc ? rc : pbs_player_new(s->run, &s->archive, &d, &s->player, err);
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

/* A picture that is taken once must not depend on what was hidden before. */
static pbs_cut_view cut_view(pbs_show *s, const pbs_show_view *v, const pbs_eyes *eyes) {
    const pbs_show_options *o = s->options;
    return (pbs_cut_view){.camera = v->camera,
                          .width = v->width,
                          .height = v->height,
                          .size = v->surfel_size,
                          .eyes = eyes,
                          .prefix = o->prefix,
                          .formula = o->formula,
                          .partial = o->partial,
                          .occlusion = !o->no_occlusion && !o->shot,
                          .pose = pbs_poses_at(&s->poses, v->time)};
}

static pbs_eyes eyes_of(const pbs_show_view *v) {
    pbs_eyes eyes;
    pbs_eyes_of(&eyes, &v->camera, v->width, v->height, v->separation, v->focus, v->zones, v->gaze);
    return eyes;
}

static void count(pbs_show *s) {
    const pbs_player *p = &s->player;
    pbs_store_stats stats = pbs_player_measure(p);
    s->drawn_nodes = p->frame.draw_count - p->frame.hidden;
    s->drawn_surfels = p->frame.surfels - p->replaced + p->points;
    s->visible_surfels = p->visible;
    s->drawn_voxels = p->voxels;
    s->drawn_triangles = p->triangles;
    s->draw_calls = p->calls;
    s->culled = p->frame.culled;
    s->hidden = p->frame.hidden;
    s->missing = p->frame.missing;
    s->uploaded_bytes = stats.uploaded_last;
    s->resident_bytes = stats.resident;
    s->unfinished = p->busy;
}

pbs_code pbs_show_settle(pbs_show *s, pbs_canvas *canvas, const pbs_show_view *view, pbs_err *err) {
    if (s->options->geometry) return PBS_OK;
    pbs_eyes eyes = eyes_of(view);
    pbs_cut_view v = cut_view(s, view, &eyes);
    return pbs_player_settle(&s->player, canvas, &v, err);
}

const char *pbs_show_trouble(const pbs_show *s) {
    return s->player.store ? pbs_store_trouble(s->player.store) : NULL;
}

/* The scene's draws follow the time, where anything moves. */
static pbs_code pose_scene(pbs_show *s, double time, pbs_err *err) {
    bool same = time == s->drawn_at || (isnan(time) && isnan(s->drawn_at));
    if (same || !pbs_poses_any(&s->poses)) return PBS_OK;
    pbs_code rc = pbs_scene_pose(&s->scene, pbs_poses_at(&s->poses, time), &s->flat, err);
    to_world(&s->flat);
    s->drawn_at = time;
    return rc;
}

static pbs_code draw_scene(pbs_show *s, pbs_canvas *canvas, pbs_err *err) {
    pbs_meshes m = {s->flat.draws,           s->flat.count, s->scene.materials,
                    s->scene.material_count, s->images,     s->scene.texture_count};
    s->drawn_nodes = s->flat.count;
    s->drawn_triangles = s->flat.triangles;
    return pbs_canvas_meshes(canvas, &m, err);
}

pbs_code pbs_show_draw(pbs_show *s, pbs_canvas *canvas, const pbs_show_view *view, pbs_err *err) {
    pbs_frame frame = {.camera = view->camera};
    pbs_eyes eyes = eyes_of(view);
    pbs_cut_view v = cut_view(s, view, &eyes);
    bool scene = s->options->geometry;
    s->drawn_nodes = s->drawn_surfels = s->drawn_voxels = s->drawn_triangles = 0;
    s->visible_surfels = 0;
    pbs_code rc = pbs_canvas_begin(canvas, &frame, err);
    if (!rc)
        rc = scene ? pose_scene(s, view->time, err) : pbs_player_look(&s->player, canvas, &v, err);
    for (int i = 0; i < eyes.count && !rc; i++) {
        pbs_canvas_look(canvas, &eyes.camera[i],
                        (pbs_columns){eyes.left[i], eyes.width, eyes.from[i], eyes.wide});
        rc = scene ? draw_scene(s, canvas, err) : pbs_player_draw(&s->player, canvas, &v, err);
    }
    /* What comes over the picture, and its way out of the canvas, is about all of it. */
    pbs_canvas_look(canvas, &view->camera, (pbs_columns){0, view->width, 0, view->width});
    if (!rc && !scene) count(s);
    return rc;
}

void pbs_show_close(pbs_show *s) {
    pbs_run *run = s->run;
    pbs_images_free(run, s->images, s->scene.texture_count);
    pbs_poses_close(&s->poses);
    pbs_free(run, s->moving);
    pbs_free(run, s->flat.draws);
    pbs_player_free(&s->player);
    if (s->scene.run) pbs_scene_close(&s->scene);
    if (s->archive.run) pbs_archive_close(&s->archive);
    memset(s, 0, sizeof *s);
}
