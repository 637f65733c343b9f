/* pick.c: from a point to the part it belongs to; see the header. */
#include "cmd/pbs-view/plan/pick.h"
#include <stdio.h>

enum { MOST_BOXES = 1000000 };

void pbs_pick_point(double out[3], const pbs_camera *c, double aspect, double x, double y,
                    double depth) {
    double right = (2 * x - 1) * c->tan_half * aspect * depth;
    double up = (1 - 2 * y) * c->tan_half * depth;
    for (int k = 0; k < 3; k++)
        out[k] = c->eye[k] + c->unit * (right * c->right[k] + up * c->up[k] - depth * c->back[k]);
}

typedef struct frame {
    uint32_t node, next; /* child to look at next */
    const char *name;
    bool inside; /* one of its children holds the point, too */
    double m[12];
} frame;

typedef struct search {
    pbs_run *run;
    const pbs_node *nodes;
    const pbs_pick_scene *scene;
    const double *point;
    double tolerance;
    frame *frames;
    size_t depth, cap, boxes;
    double best; /* size of the smallest box so far */
    bool found, best_is_part;
    char *out;
    size_t out_size;
} search;

/* The point in the node's coordinates, and how far the tolerance reaches along each axis there.
 * False: the placing is flat. */
static bool to_node(const search *s, const double m[12], double q[3], double reach[3]) {
    double cofactor[9], det = pbs_xform_det(m);
    if (pbs_xform_is_singular(m)) return false;
    pbs_xform_cofactor(cofactor, m);
    for (int k = 0; k < 3; k++) {
        double square = 0;
        q[k] = 0;
        for (int i = 0; i < 3; i++) {
            double a = cofactor[3 * i + k] / det;
            q[k] += a * (s->point[i] - m[4 * i + 3]);
            square += a * a;
        }
        reach[k] = s->tolerance * sqrt(square);
    }
    return true;
}

/* Whether the node's box holds the point; *size: the sum of the box's sides, world unit, with which
 * flat ones can be compared, too. */
static bool holds(const search *s, uint32_t node, const double m[12], double *size) {
    pbs_box box = s->nodes[node].box, world = pbs_xform_box(m, &box);
    double q[3], reach[3];
    if (pbs_box_is_empty(&box)) return false;
    *size = 0;
    for (int k = 0; k < 3; k++) *size += world.max[k] - world.min[k];
    if (!to_node(s, m, q, reach)) {
        box = world;
        for (int k = 0; k < 3; k++) q[k] = s->point[k], reach[k] = s->tolerance;
    }
    for (int k = 0; k < 3; k++)
        if (!(q[k] >= box.min[k] - reach[k] && q[k] <= box.max[k] + reach[k])) return false;
    return true;
}

/* Whether something below the node may be out of its box, which is that of the scene at rest. */
static bool may_leave(const search *s, uint32_t node) {
    return s->scene->pose && s->scene->moving[node];
}

static pbs_code push(search *s, uint32_t node, const char *name, const double m[12], pbs_err *err) {
    pbs_code rc = pbs_grow(s->run, &s->frames, &s->cap, s->depth + 1, sizeof *s->frames,
                           "the search for a part", err);
    if (rc) return rc;
    frame *f = &s->frames[s->depth++];
    *f = (frame){.node = node, .name = name};
    memcpy(f->m, m, sizeof f->m);
    return PBS_OK;
}

static void write_path(const search *s) {
    size_t n = 0;
    s->out[0] = 0;
    for (size_t i = 0; i < s->depth; i++) {
        const char *name = s->frames[i].name;
        size_t more = name ? strlen(name) : 0;
        if (!more || n + more + 4 > s->out_size) continue;
        n += (size_t)snprintf(s->out + n, s->out_size - n, "%s%s", n ? " / " : "", name);
    }
    if (!n) snprintf(s->out, s->out_size, "node %u", s->frames[s->depth - 1].node);
}

/* The node on top of the stack has no child that holds the point. Parts go before assemblies, which
 * hold it only because their parts' surfels stand out a little. */
static void take(search *s) {
    const frame *f = &s->frames[s->depth - 1];
    bool part = s->nodes[f->node].child_count == 0;
    double size;
    if (!holds(s, f->node, f->m, &size)) return;
    if (s->found && (s->best_is_part > part || (s->best_is_part == part && s->best <= size)))
        return;
    s->found = true;
    s->best_is_part = part;
    s->best = size;
    write_path(s);
}

static pbs_code step(search *s, pbs_err *err) {
    frame *f = &s->frames[s->depth - 1];
    const pbs_node *n = &s->nodes[f->node];
    if (f->next == n->child_count) {
        if (!f->inside) take(s);
        s->depth--;
        return PBS_OK;
    }
    const pbs_child *c = &n->children[f->next++];
    double m[12], size;
    pbs_xform_mul(m, f->m, pbs_pose_of(s->scene->pose, c));
    bool inside = holds(s, c->node, m, &size);
    if (!inside && !may_leave(s, c->node)) return PBS_OK;
    f->inside = f->inside || inside;
    s->boxes++;
    return push(s, c->node, c->name ? c->name : s->nodes[c->node].name, m, err);
}

pbs_code pbs_pick(pbs_run *run, const pbs_pick_scene *scene, const double point[3],
                  double tolerance, char *out, size_t size, bool *part, pbs_err *err) {
    search s = {.run = run,
                .nodes = scene->nodes,
                .scene = scene,
                .point = point,
                .tolerance = tolerance,
                .out = out,
                .out_size = size};
    double box;
    uint32_t root = (uint32_t)scene->count - 1;
    pbs_code rc = PBS_OK;
    out[0] = 0;
    if (scene->count && (holds(&s, root, PBS_IDENTITY, &box) || may_leave(&s, root)))
        rc = push(&s, root, scene->nodes[root].name, PBS_IDENTITY, err);
    while (s.depth && s.boxes < MOST_BOXES && !rc) rc = step(&s, err);
    pbs_free(run, s.frames);
    *part = s.best_is_part;
    return rc;
}
