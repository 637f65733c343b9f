#include "libcore/measures/measure.h"
#include "libcore/surfels/owned.h"
#include "libcore/data/srgb.h"
#include "libcore/data/vec.h"
#include <stdlib.h>

struct pbs_measurer {
    pbs_run *run;
    const pbs_points *in;
    void *block;
    pbs_tree tree;
    uint32_t *owner, *scratch;
    float weight;
};

static void lay_out(pbs_measurer *m, size_t candidates, pbs_layout *l) {
    pbs_tree_layout(&m->tree, candidates, l);
    m->owner = pbs_layout_take(l, pbs_tree_slots(candidates) * sizeof *m->owner);
    m->scratch = pbs_layout_take(l, candidates * sizeof *m->scratch);
}

static pbs_code build(pbs_run *run, pbs_tree *t, const pbs_points *in, pbs_err *err) {
    return (pbs_cpu_has_avx2() ? pbs_tree_build_avx2 : pbs_tree_build)(run, t, in, err);
}

static pbs_code cover(pbs_run *run, const pbs_cover *c, const pbs_cover_surfel *s, size_t n,
                      float radius2, bool once, pbs_err *err) {
    pbs_code rc = pbs_cover_begin(run, c, err);
    return rc ? rc
              : (pbs_cpu_has_avx2() ? pbs_cover_add_avx2 : pbs_cover_add)(run, c, s, n, radius2,
                                                                          once, err);
}

/* Squares of distances of points spread over a surface as large as the box is: a first guess. */
static float guess2(const pbs_metric *m, size_t surfels) {
    double d = m->diagonal * m->length;
    return (float)(d * d / (double)surfels);
}

static float largest(const pbs_tree *t) {
    const pbs_fan *root = &t->fan[t->levels - 1][0];
    float most = 0;
    for (int k = 0; k < PBS_FAN; k++) most = root->max[k] > most ? root->max[k] : most;
    return most;
}

static double length_of(const pbs_metric *m, float d2) {
    return sqrt((double)d2) / m->length;
}

/* ---- a node ---- */

pbs_code pbs_measurer_new(pbs_run *run, const pbs_points *in, float normal_weight,
                          pbs_measurer **out, pbs_err *err) {
    pbs_measurer *m = *out = calloc(1, sizeof *m);
    if (!m) return pbs_fail(err, PBS_LIMIT, "no memory");
    pbs_layout l = {NULL, 0};
    m->run = run;
    m->in = in;
    m->weight = normal_weight > 1 ? 1 : normal_weight > 0 ? normal_weight : 0;
    lay_out(m, in->count, &l);
    pbs_code rc = pbs_alloc(run, &m->block, l.used, 1, "measuring", err);
    if (!rc) {
        l = (pbs_layout){m->block, 0};
        lay_out(m, in->count, &l);
        /* Weight 1, so that the tree has the normals. */
        rc = pbs_metric_set(run, &m->tree.metric, in, 1, &m->tree.invalid, err);
    }
    if (!rc && m->tree.invalid < in->count) rc = build(run, &m->tree, in, err);
    if (rc) {
        pbs_measurer_free(m);
        *out = NULL;
    }
    return rc;
}

void pbs_measurer_free(pbs_measurer *m) {
    if (!m) return;
    pbs_free(m->run, m->block);
    free(m);
}

static void set_weight(pbs_metric *m, float w) {
    m->base = 1 - w * w / 2;
    m->slope = w * w / 2 / (32767.0f * 32767.0f);
}

/* ---- the surfels among themselves ---- */

typedef struct nearest {
    pbs_points points;
    pbs_tree tree;
    pbs_cover cover;
    pbs_cover_surfel *surfels;
    float *d2;
} nearest;

static void nearest_layout(nearest *n, size_t surfels, pbs_layout *l) {
    pbs_tree_layout(&n->tree, surfels, l);
    n->points.position = pbs_layout_take(l, surfels * 12);
    n->cover.owner = pbs_layout_take(l, pbs_tree_slots(surfels) * sizeof *n->cover.owner);
    n->surfels = pbs_layout_take(l, surfels * sizeof *n->surfels);
    n->d2 = pbs_layout_take(l, surfels * sizeof *n->d2);
}

static int rising(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static pbs_code find_nearest(pbs_run *run, nearest *n, pbs_err *err) {
    size_t count = n->points.count;
    pbs_code rc = pbs_metric_set(run, &n->tree.metric, &n->points, 0, &n->tree.invalid, err);
    if (!rc) rc = build(run, &n->tree, &n->points, err);
    for (size_t i = 0; i < count; i++) n->surfels[i] = (pbs_cover_surfel){(uint32_t)i, 0};
    n->cover.tree = &n->tree;
    n->cover.kind = PBS_COVER_OTHERS;
    if (!rc)
        rc = cover(run, &n->cover, n->surfels, count, guess2(&n->tree.metric, count), false, err);
    for (size_t i = 0; i < count && !rc; i++) n->d2[i] = n->tree.leaf[i / PBS_LEAF].d[i % PBS_LEAF];
    return rc;
}

static pbs_code measure_spacing(const pbs_measurer *m, const uint32_t *order, size_t surfels,
                                pbs_measures *out, pbs_err *err) {
    nearest n = {0};
    void *block;
    pbs_layout l = {NULL, 0};
    if (surfels < 2) return PBS_OK;
    nearest_layout(&n, surfels, &l);
    pbs_code rc = pbs_alloc(m->run, &block, l.used, 1, "measuring", err);
    if (rc) return rc;
    l = (pbs_layout){block, 0};
    nearest_layout(&n, surfels, &l);
    for (size_t i = 0; i < surfels; i++)
        memcpy(n.points.position + 3 * i, m->in->position + 3 * (size_t)order[i], 12);
    n.points.count = surfels;
    rc = find_nearest(m->run, &n, err);
    if (!rc) {
        qsort(n.d2, surfels, sizeof *n.d2, rising);
        out->min_spacing = length_of(&n.tree.metric, n.d2[0]);
        out->median_spacing = length_of(&n.tree.metric, n.d2[surfels / 2]);
    }
    pbs_free(m->run, block);
    return rc;
}

/* ---- against the candidates ---- */

typedef struct prefix {
    pbs_measurer *m;
    const uint32_t *order;
    size_t count;
    pbs_cover_surfel *surfels;
    pbs_cover cover;
} prefix;

/* weight 0: Euclid */
static pbs_code measure_covering(prefix *p, float weight, double *covering, pbs_err *err) {
    pbs_metric *m = &p->m->tree.metric;
    set_weight(m, weight);
    p->cover.kind = PBS_COVER_METRIC;
    pbs_code rc =
        cover(p->m->run, &p->cover, p->surfels, p->count,
              weight > 0 && *covering > 0 ? pbs_cover_radius2(m, *covering) : guess2(m, p->count),
              false, err);
    *covering = length_of(m, largest(&p->m->tree));
    return rc;
}

static pbs_code measure_holes(prefix *p, pbs_measures *out, pbs_err *err) {
    const pbs_tree *t = &p->m->tree;
    double reach = 1.25 * out->radius * t->metric.length, reach2 = reach * reach;
    if (!p->m->in->normal) return PBS_OK;
    p->cover.kind = PBS_COVER_SIDE;
    float most = reach2 < 3e38 ? nextafterf((float)reach2, INFINITY) : INFINITY;
    pbs_code rc = cover(p->m->run, &p->cover, p->surfels, p->count, most, true, err);
    size_t holes = 0;
    for (size_t i = 0; i < t->points; i++) holes += t->leaf[i / PBS_LEAF].d[i % PBS_LEAF] > reach2;
    out->holes = (double)holes / (double)t->points;
    return rc;
}

static double code_of(double linear) {
    return 255 * pbs_linear_to_srgb((float)linear);
}

static void compare_colours(const prefix *p, const pbs_owned *o, const uint8_t *averaged,
                            pbs_measures *out) {
    double own = 0, mean = 0;
    size_t n = 0;
    for (size_t i = 0; i < p->count; i++) {
        pbs_mean truth;
        const uint8_t *c = p->m->in->colour + 4 * (size_t)p->order[i];
        if (!pbs_owned_mean(o, i, &truth)) continue;
        n += 3;
        for (int k = 0; k < 3; k++) {
            double want = code_of(truth.colour[k]), a = c[k] - want;
            own += a * a;
            if (averaged) a = averaged[4 * i + (size_t)k] - want, mean += a * a;
        }
    }
    if (!n) return;
    out->colour_own = sqrt(own / (double)n);
    out->colour_averaged = sqrt(mean / (double)n);
}

static void colours_layout(pbs_owned *o, size_t candidates, size_t surfels, int parts,
                           pbs_layout *l) {
    pbs_owned_init(o, PBS_COLOUR);
    pbs_owned_layout(o, pbs_tree_slots(candidates), surfels, parts, l);
}

/* The owners are those of the covering in D. */
static pbs_code measure_colours(const prefix *p, const uint8_t *averaged, pbs_measures *out,
                                pbs_err *err) {
    pbs_run *run = p->m->run;
    const pbs_points *in = p->m->in;
    pbs_owned o;
    pbs_layout l = {NULL, 0};
    void *block;
    if (!in->colour) return PBS_OK;
    int parts = pbs_parts(run, p->m->tree.points, PBS_TREE_PART);
    colours_layout(&o, in->count, p->count, parts, &l);
    pbs_code rc = pbs_alloc(run, &block, l.used, 1, "measuring", err);
    if (rc) return rc;
    l = (pbs_layout){block, 0};
    colours_layout(&o, in->count, p->count, parts, &l);
    rc = pbs_owned_fill(run, &o, in, &p->m->tree, err);
    if (!rc) rc = pbs_owned_sum(run, &o, &p->cover, p->count, err);
    if (!rc) compare_colours(p, &o, averaged, out);
    pbs_free(run, block);
    return rc;
}

size_t pbs_measurer_need(uint32_t channels, size_t candidates, size_t surfels) {
    pbs_measurer m;
    nearest n;
    pbs_owned o;
    pbs_layout all = {NULL, 0}, spacing = {NULL, 0}, colours = {NULL, 0};
    lay_out(&m, candidates, &all);
    pbs_layout_take(&all, surfels * sizeof(pbs_cover_surfel));
    nearest_layout(&n, surfels, &spacing);
    int parts = pbs_parts_most(candidates, PBS_TREE_PART);
    if (channels & PBS_COLOUR) colours_layout(&o, candidates, surfels, parts, &colours);
    return all.used + (spacing.used > colours.used ? spacing.used : colours.used) +
           3 * PBS_ALLOC_HEAD;
}

static pbs_code measure_prefix(prefix *p, const uint8_t *averaged, pbs_measures *out,
                               pbs_err *err) {
    pbs_measurer *m = p->m;
    pbs_cover_find(&m->tree, p->order, p->count, m->scratch, m->in->count, p->surfels);
    pbs_code rc = measure_covering(p, 0, &out->covering, err);
    if (!out->radius) out->radius = out->covering;
    if (!rc) rc = measure_holes(p, out, err);
    out->covering_d = out->covering;
    if (!rc) rc = measure_covering(p, m->weight, &out->covering_d, err);
    return rc ? rc : measure_colours(p, averaged, out, err);
}

pbs_code pbs_measure(pbs_measurer *m, const uint32_t *order, size_t surfels, double radius,
                     const uint8_t *averaged, pbs_measures *out, pbs_err *err) {
    prefix p = {.m = m, .order = order, .count = surfels};
    p.cover = (pbs_cover){.tree = &m->tree, .owner = m->owner};
    *out = (pbs_measures){.surfels = surfels, .radius = radius > 0 ? radius : 0};
    if (!surfels || !m->tree.points) return PBS_OK;
    pbs_code rc = measure_spacing(m, order, surfels, out, err);
    if (!rc) rc = pbs_alloc(m->run, &p.surfels, surfels, sizeof *p.surfels, "measuring", err);
    if (rc) return rc;
    rc = measure_prefix(&p, averaged, out, err);
    pbs_free(m->run, p.surfels);
    return rc;
}
