/* scene_box.c: the exact box of a scene without looking at all of it: first the parts that reach
 * farthest along each axis, then whatever could still lie outside of their box. */
#include "formats/voxels/blocks.h"
#include "formats/scene/bounds.h"
#include "formats/scene/dag.h"
#include "formats/scene/pages.h"
#include "libcore/ground/pipe.h"

typedef struct boxing {
    const pbs_scene *s;
    float (*mesh)[6];
    pbs_bound *bound;
    pbs_box box;
    pbs_pages pages;
    uint64_t wild; /* placings whose numbers overflow, so far */
} boxing;

/* So many of them may be looked at one by one: nothing can be left out where nothing is known. */
enum { WILD_MOST = 1 << 20 };

static pbs_code box_mesh(void *ctx, size_t i, int thread, pbs_err *err) {
    boxing *b = ctx;
    const pbs_mesh *m = &b->s->meshes[i];
    float box[6] = {INFINITY, INFINITY, INFINITY, -INFINITY, -INFINITY, -INFINITY};
    (void)thread, (void)err;
    for (size_t v = 0; v < m->vertices; v++)
        for (int k = 0; k < 3; k++) {
            float p = m->position[3 * v + (size_t)k];
            box[k] = p < box[k] ? p : box[k];
            box[k + 3] = p > box[k + 3] ? p : box[k + 3];
        }
    memcpy(b->mesh[i], box, sizeof box);
    pbs_pages_saw(&b->pages, m->triangles);
    return PBS_OK;
}

/* Whether nothing of it can make the box larger. What is not a number does not: a NaN coordinate
 * is no place, and a row of m with NaN makes nothing else. */
static bool is_inside(const boxing *b, const pbs_bound *what, const double m[12]) {
    pbs_box box = pbs_bound_placed(what, m);
    for (int k = 0; k < 3; k++) {
        const double *r = m + 4 * k;
        if (isnan(r[0]) || isnan(r[1]) || isnan(r[2]) || isnan(r[3])) continue;
        if (!(box.min[k] >= b->box.min[k] && box.max[k] <= b->box.max[k])) return false;
    }
    return true;
}

/* The same sums as those of pbs_scene_flatten, bit for bit. */
static void add_meshes(boxing *b, uint32_t node, const double m[12]) {
    const pbs_scene *s = b->s;
    double local[12];
    pbs_part_place(local, m, &s->nodes[node]);
    for (size_t i = s->first_mesh[node]; i < s->first_mesh[node + 1]; i++) {
        pbs_bound bound = pbs_bound_of(b->mesh[i]);
        if (pbs_bound_is_empty(&bound) || is_inside(b, &bound, local)) continue;
        for (size_t v = 0; v < s->meshes[i].vertices; v++) {
            const float *q = s->meshes[i].position + 3 * v;
            double p[3] = {q[0], q[1], q[2]};
            pbs_xform_point(p, local, p);
            pbs_box_add(&b->box, p);
        }
        pbs_pages_saw(&b->pages, s->meshes[i].triangles);
    }
}

/* Follows the children that seem to reach farthest along an axis, to some part. */
static pbs_code seek(boxing *b, int axis, bool up, pbs_err *err) {
    const pbs_scene *s = b->s;
    uint32_t node = (uint32_t)s->node_count - 1;
    double m[12];
    pbs_code rc = PBS_OK;
    memcpy(m, PBS_IDENTITY, sizeof m);
    while (!rc && s->first_mesh[node] == s->first_mesh[node + 1]) {
        const pbs_node *n = &s->nodes[node];
        double best = -INFINITY, best_m[12];
        bool any = false;
        for (uint32_t i = 0; i < n->child_count; i++) {
            double t[12];
            if (pbs_bound_is_empty(&b->bound[n->children[i].node])) continue;
            pbs_xform_mul(t, m, n->children[i].m);
            pbs_box box = pbs_bound_placed(&b->bound[n->children[i].node], t);
            double at = up ? box.max[axis] : -box.min[axis];
            if (any && !(at > best)) continue;
            any = true, best = at, node = n->children[i].node;
            memcpy(best_m, t, sizeof best_m);
        }
        if (!any) return PBS_OK;
        memcpy(m, best_m, sizeof m);
        rc = pbs_run_check(s->run, err);
    }
    if (!rc) add_meshes(b, node, m);
    return rc;
}

static pbs_code too_large(const boxing *b, pbs_err *err) {
    return pbs_fail(err, PBS_DATA, "%s: transforms blow the scene up beyond all numbers",
                    pbs_reader_name(b->s->reader));
}

static bool is_wild(const pbs_bound *what, const double m[12]) {
    pbs_box box = pbs_bound_placed(what, m);
    for (int k = 0; k < 3; k++)
        if (!isfinite(box.min[k]) || !isfinite(box.max[k])) return true;
    return false;
}

static pbs_code visit(void *ctx, uint32_t node, const double m[12], uint32_t flags, bool *descend,
                      pbs_err *err) {
    boxing *b = ctx;
    (void)flags;
    *descend = !pbs_bound_is_empty(&b->bound[node]) && !is_inside(b, &b->bound[node], m);
    if (!*descend) return PBS_OK;
    if (is_wild(&b->bound[node], m) && b->wild++ == WILD_MOST) return too_large(b, err);
    add_meshes(b, node, m);
    return PBS_OK;
}

static pbs_code find(boxing *b, pbs_err *err) {
    const pbs_scene *s = b->s;
    const char *name = pbs_reader_name(s->reader);
    pbs_code rc = PBS_OK;
    for (int i = 0; i < 6 && !rc; i++) rc = seek(b, i / 2, i % 2, err);
    if (!rc) rc = pbs_dag_walk(s->run, s->nodes, s->node_count, visit, b, err);
    if (rc) return rc;
    if (pbs_box_is_empty(&b->box))
        return pbs_fail(err, PBS_DATA, "%s: transforms leave no finite vertex", name);
    for (int k = 0; k < 3; k++)
        if (!isfinite(b->box.max[k] - b->box.min[k])) return too_large(b, err);
    return PBS_OK;
}

/* ---- counts ---- */

static uint64_t own_triangles(const void *ctx, uint32_t node) {
    const pbs_scene *s = ctx;
    uint64_t n = 0;
    for (size_t i = s->first_mesh[node]; i < s->first_mesh[node + 1]; i++)
        n += s->meshes[i].triangles;
    return n;
}

static uint64_t own_placing(const void *ctx, uint32_t node) {
    const pbs_scene *s = ctx;
    return s->first_mesh[node] < s->first_mesh[node + 1];
}

static uint64_t saturated(uint64_t a, uint64_t b) {
    return a + b < a ? UINT64_MAX : a + b;
}

/* A product of transforms presses flat if one of them does. */
static pbs_code count_singular(const pbs_scene *s, uint64_t *out, pbs_err *err) {
    uint64_t *placed, *flat;
    pbs_code rc = pbs_dag_count(s->run, s->nodes, s->node_count, own_placing, s, &placed, err);
    if (rc) return rc;
    rc = pbs_alloc(s->run, &flat, s->node_count, sizeof *flat, "the table of nodes", err);
    for (size_t i = 0; i < s->node_count && !rc; i++) {
        flat[i] = 0;
        for (uint32_t k = 0; k < s->nodes[i].child_count; k++) {
            const pbs_child *c = &s->nodes[i].children[k];
            bool all = placed[c->node] != flat[c->node] && pbs_xform_is_singular(c->m);
            flat[i] = saturated(flat[i], all ? placed[c->node] : flat[c->node]);
        }
    }
    if (!rc) *out = flat[s->node_count - 1];
    if (!rc) pbs_free(s->run, flat);
    pbs_free(s->run, placed);
    return rc;
}

static pbs_code count(const pbs_scene *s, uint64_t *triangles, uint64_t *singular, pbs_err *err) {
    uint64_t *below;
    pbs_code rc = pbs_dag_count(s->run, s->nodes, s->node_count, own_triangles, s, &below, err);
    if (rc) return rc;
    *triangles = below[s->node_count - 1];
    pbs_free(s->run, below);
    if (!*triangles)
        return pbs_fail(err, PBS_DATA, "%s: no triangles in it", pbs_reader_name(s->reader));
    return count_singular(s, singular, err);
}

pbs_code pbs_scene_box(const pbs_scene *s, pbs_box *out, uint64_t *triangles, uint64_t *singular,
                       pbs_err *err) {
    boxing b = {.s = s, .box = PBS_BOX_EMPTY};
    pbs_pages_open(s, NULL, &b.pages);
    pbs_code rc = count(s, triangles, singular, err);
    if (!rc)
        rc = pbs_alloc(s->run, &b.mesh, s->mesh_count, sizeof *b.mesh, "the boxes of meshes", err);
    if (!rc) rc = pbs_parallel(s->run, s->mesh_count, box_mesh, &b, err);
    if (!rc) rc = pbs_bounds_make(s, (const float(*)[6])b.mesh, &b.bound, err);
    if (!rc) rc = find(&b, err);
    *out = b.box;
    pbs_pages_close(&b.pages);
    pbs_free(s->run, b.bound);
    pbs_free(s->run, b.mesh);
    return rc;
}
