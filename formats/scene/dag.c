#include "formats/scene/dag.h"
#include <string.h>

typedef struct frame {
    uint32_t node, next; /* child to visit next */
    double m[12];
} frame;

typedef struct stack {
    pbs_run *run;
    frame *frames;
    size_t depth, cap;
} stack;

static pbs_code push(stack *s, uint32_t node, const double m[12], pbs_err *err) {
    pbs_code rc = pbs_grow(s->run, &s->frames, &s->cap, s->depth + 1, sizeof *s->frames,
                           "the hierarchy", err);
    if (rc) return rc;
    frame *f = &s->frames[s->depth++];
    f->node = node;
    f->next = 0;
    memcpy(f->m, m, sizeof f->m);
    return PBS_OK;
}

pbs_code pbs_dag_walk(pbs_run *run, const pbs_node *nodes, size_t count, pbs_visit_fn visit,
                      void *ctx, pbs_err *err) {
    return pbs_dag_walk_posed(run, nodes, count, NULL, visit, ctx, err);
}

/* Children have smaller ids than their parents, so the stack is never higher than there are
 * nodes. */
pbs_code pbs_dag_walk_posed(pbs_run *run, const pbs_node *nodes, size_t count,
                            const double (*pose)[12], pbs_visit_fn visit, void *ctx, pbs_err *err) {
    stack s = {.run = run};
    bool descend = true;
    pbs_code rc = visit(ctx, (uint32_t)count - 1, PBS_IDENTITY, 0, &descend, err);
    if (!rc && descend) rc = push(&s, (uint32_t)count - 1, PBS_IDENTITY, err);
    for (uint32_t step = 1; s.depth && !rc; step++) {
        if (step % 4096 == 0 && (rc = pbs_run_check(run, err))) break;
        frame *f = &s.frames[s.depth - 1];
        const pbs_node *n = &nodes[f->node];
        if (f->next == n->child_count) {
            s.depth--;
            continue;
        }
        const pbs_child *c = &n->children[f->next++];
        double m[12];
        pbs_xform_mul(m, f->m, pbs_pose_of(pose, c));
        descend = true;
        rc = visit(ctx, c->node, m, c->flags, &descend, err);
        if (!rc && descend && nodes[c->node].child_count) rc = push(&s, c->node, m, err);
    }
    pbs_free(run, s.frames);
    return rc;
}

pbs_code pbs_dag_count(pbs_run *run, const pbs_node *nodes, size_t count,
                       uint64_t (*own)(const void *ctx, uint32_t node), const void *ctx,
                       uint64_t **out, pbs_err *err) {
    uint64_t *n;
    *out = NULL;
    pbs_code rc = pbs_alloc(run, &n, count, sizeof *n, "the table of nodes", err);
    if (rc) return rc;
    for (size_t i = 0; i < count; i++) {
        n[i] = own(ctx, (uint32_t)i);
        for (uint32_t k = 0; k < nodes[i].child_count; k++)
            if (__builtin_add_overflow(n[i], n[nodes[i].children[k].node], &n[i]))
                n[i] = UINT64_MAX;
    }
    *out = n;
    return PBS_OK;
}
