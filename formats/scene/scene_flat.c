/* scene_flat.c: the scene DAG unfolded into placed meshes, and the textures decoded. */
#include "formats/scene/dag.h"
#include "formats/readers/image.h"
#include "formats/scene/scene.h"
#include <string.h>

static uint64_t own_meshes(const void *ctx, uint32_t node) {
    const pbs_scene *s = ctx;
    return s->first_mesh[node + 1] - s->first_mesh[node];
}

typedef struct unfold {
    const pbs_scene *s;
    const uint64_t *draws; /* below each node */
    pbs_flat *out;
} unfold;

static pbs_code place(void *ctx, uint32_t node, const double m[12], uint32_t flags, bool *descend,
                      pbs_err *err) {
    unfold *u = ctx;
    const pbs_scene *s = u->s;
    double local[12];
    (void)err, (void)flags;
    *descend = u->draws[node] != 0; /* empty subtrees may be huge */
    memcpy(local, PBS_IDENTITY, sizeof local);
    for (int k = 0; k < 3; k++) local[4 * k + 3] = s->nodes[node].origin[k];
    pbs_xform_mul(local, m, local);
    size_t first = s->first_mesh[node], end = s->first_mesh[node + 1];
    for (size_t i = first; i < end; i++) {
        pbs_draw *d = &u->out->draws[u->out->count++];
        d->mesh = &s->meshes[i];
        memcpy(d->m, local, sizeof local);
        u->out->triangles += d->mesh->triangles;
    }
    u->out->singular += first < end && pbs_xform_is_singular(m);
    return PBS_OK;
}

static void add_bounds(pbs_box *box, const pbs_draw *d) {
    for (uint32_t i = 0; i < d->mesh->vertices; i++) {
        const float *v = d->mesh->position + 3 * i;
        double p[3] = {v[0], v[1], v[2]};
        pbs_xform_point(p, d->m, p);
        pbs_box_add(box, p);
    }
}

/* The box of all vertices, then the frame's origin in its middle. */
static pbs_code center(const pbs_scene *s, pbs_flat *out, pbs_err *err) {
    out->box = PBS_BOX_EMPTY;
    for (size_t i = 0; i < out->count; i++) {
        pbs_code rc = i % 1024 ? PBS_OK : pbs_run_check(s->run, err);
        if (rc) return rc;
        add_bounds(&out->box, &out->draws[i]);
    }
    if (pbs_box_is_empty(&out->box))
        return pbs_fail(err, PBS_DATA, "%s: transforms leave no finite vertex",
                        pbs_reader_name(s->reader));
    for (int k = 0; k < 3; k++) {
        out->origin[k] = out->box.min[k] / 2 + out->box.max[k] / 2;
        if (!isfinite(out->box.max[k] - out->box.min[k]))
            return pbs_fail(err, PBS_DATA, "%s: transforms blow the scene up beyond all numbers",
                            pbs_reader_name(s->reader));
    }
    for (size_t i = 0; i < out->count; i++)
        for (int k = 0; k < 3; k++) out->draws[i].m[4 * k + 3] -= out->origin[k];
    return PBS_OK;
}

pbs_code pbs_scene_flatten(const pbs_scene *s, pbs_flat *out, pbs_err *err) {
    memset(out, 0, sizeof *out);
    const char *name = pbs_reader_name(s->reader);
    uint64_t *draws;
    pbs_code rc = pbs_dag_count(s->run, s->nodes, s->node_count, own_meshes, s, &draws, err);
    if (rc) return rc;
    uint64_t n = draws[s->node_count - 1], triangles = s->nodes[s->node_count - 1].triangles;
    if (!n)
        rc = pbs_fail(err, PBS_DATA, "%s: no triangles in it", name);
    else if (triangles > UINT32_MAX - 1 || n > SIZE_MAX / sizeof(pbs_draw))
        rc = pbs_fail(err, PBS_DATA, "%s: %llu triangles with all instances: more than 2^32 - 2",
                      name, (unsigned long long)triangles);
    if (!rc)
        rc = pbs_alloc(s->run, &out->draws, (size_t)n, sizeof(pbs_draw), "the placed meshes", err);
    unfold u = {s, draws, out};
    if (!rc) rc = pbs_dag_walk(s->run, s->nodes, s->node_count, place, &u, err);
    pbs_free(s->run, draws);
    if (!rc && out->triangles > UINT32_MAX - 1)
        rc = pbs_fail(err, PBS_DATA, "%s: the counts of its nodes are damaged", name);
    if (!rc) rc = center(s, out, err);
    if (rc) {
        pbs_free(s->run, out->draws);
        memset(out, 0, sizeof *out);
    }
    return rc;
}

pbs_code pbs_scene_pose(const pbs_scene *s, const double (*pose)[12], pbs_flat *flat,
                        pbs_err *err) {
    uint64_t *draws;
    pbs_code rc = pbs_dag_count(s->run, s->nodes, s->node_count, own_meshes, s, &draws, err);
    if (rc) return rc;
    unfold u = {s, draws, flat};
    flat->count = 0;
    flat->triangles = flat->singular = 0;
    rc = pbs_dag_walk_posed(s->run, s->nodes, s->node_count, pose, place, &u, err);
    pbs_free(s->run, draws);
    for (size_t i = 0; i < flat->count; i++)
        for (int k = 0; k < 3; k++) flat->draws[i].m[4 * k + 3] -= flat->origin[k];
    return rc;
}

/* ---- textures ---- */

static void mark(const pbs_texture_use *u, pbs_image *images) {
    if (u->texture != PBS_NONE) images[u->texture].width = 1;
}

pbs_code pbs_scene_images(const pbs_scene *s, pbs_image **out, pbs_err *err) {
    pbs_image *images;
    *out = NULL;
    pbs_code rc = pbs_alloc(s->run, &images, s->texture_count, sizeof *images, "the textures", err);
    if (rc) return rc;
    if (s->texture_count) memset(images, 0, s->texture_count * sizeof *images);
    for (size_t i = 0; i < s->material_count; i++) {
        mark(&s->materials[i].base_texture, images);
        mark(&s->materials[i].material_texture, images);
        mark(&s->materials[i].emissive_texture, images);
    }
    for (size_t i = 0; i < s->texture_count && !rc; i++) {
        if (!images[i].width) continue;
        images[i].width = 0;
        const pbs_texture *t = &s->textures[i];
        rc = pbs_image_decode(s->run, t->name, t->bytes, t->size, &images[i], err);
        if (rc != PBS_DATA || !s->options.failed) continue;
        s->options.failed(s->options.failed_ctx, err);
        pbs_free(s->run, images[i].rgba);
        images[i] = (pbs_image){0};
        rc = PBS_OK;
    }
    if (rc) {
        pbs_images_free(s->run, images, s->texture_count);
        return pbs_fail_in(err, "%s", pbs_reader_name(s->reader));
    }
    *out = images;
    return PBS_OK;
}

void pbs_images_free(pbs_run *run, pbs_image *images, size_t count) {
    for (size_t i = 0; images && i < count; i++) pbs_free(run, images[i].rgba);
    pbs_free(run, images);
}
