/* bench_hierarchy CANDIDATES NAME=SURFELS...: how well surfels of a root show what can be seen of
 * it, measured on the same candidates: those that pbs-gbuffer --top-down draws.
 *
 * Of each stream the last node with records is taken, which is the root. Distances are exact. Of
 * every candidate the distance to its nearest surfel: the largest (covering radius), the 99.9 %
 * quantile and the mean; and wrong-side holes: the share of the candidates without a surfel on
 * their side (n.n' > 0) within 1.25 R, where R is the smallest of the covering radii, for all.
 * Ratios are to the surfels named first; radii also relative to the diagonal of the root's
 * box. */
#include "formats/scene/node.h"
#include "formats/surfels/points.h"
#include "libcore/surfels/cover.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static pbs_run run = {.threads = 1};
static pbs_err err;

static void must(pbs_code rc) {
    if (!rc) return;
    fprintf(stderr, "bench_hierarchy: %s\n", err.text);
    exit(rc);
}

/* ---- streams ---- */

typedef struct root {
    pbs_points points;
    double origin[3], diagonal;
} root;

static double diagonal_of(const pbs_box *b) {
    double d[3];
    for (int k = 0; k < 3; k++) d[k] = b->max[k] - b->min[k];
    return hypot(hypot(d[0], d[1]), d[2]);
}

static void take_node(const char *path, const pbs_chunk *c, uint32_t id, pbs_points *next,
                      size_t caps[2], root *out) {
    pbs_node n;
    must(pbs_node_read(&run, path, c, id, &n, &err));
    if (next->count) {
        pbs_points last = out->points;
        size_t cap = caps[0];
        out->points = *next, caps[0] = caps[1];
        *next = last, caps[1] = cap;
        next->count = 0;
        memcpy(out->origin, n.origin, sizeof out->origin);
        out->diagonal = diagonal_of(&n.box);
    }
    pbs_node_free(&run, &n);
}

static root load(const char *path) {
    pbs_reader *r;
    pbs_record record;
    pbs_points next = {0};
    root out = {0};
    size_t caps[2] = {0, 0}; /* of out and next */
    uint32_t nodes = 0;
    must(pbs_reader_open_path(&run, path, PBS_KIND(PBS_CANDIDATES) | PBS_KIND(PBS_SURFELS), &r,
                              &err));
    must(pbs_record_parse(path, pbs_reader_channels(r), &record, &err));
    for (bool end = false; !end;) {
        pbs_chunk c;
        must(pbs_reader_next(r, &c, &end, &err));
        if (end) break;
        if (c.tag == PBS_TAG_NODE) take_node(path, &c, nodes++, &next, caps, &out);
        if (c.tag != PBS_TAG_POINTS) continue;
        must(pbs_points_grow(&run, record.channels, &next, &caps[1], next.count + c.count, &err));
        must(pbs_points_read(path, &record, &c, &next, NULL, &err));
    }
    pbs_reader_close(r);
    pbs_points_free(&run, &next);
    if (!out.points.count) must(pbs_fail(&err, PBS_DATA, "%s: no records in it", path));
    return out;
}

/* ---- the distances ---- */

typedef struct figures {
    double most, quantile, mean; /* distance of a candidate to its nearest surfel */
    double holes;                /* share of the candidates */
} figures;

/* Surfels, then candidates, in the candidates' frame. */
static pbs_points join(const root *surfels, const root *candidates) {
    size_t n = surfels->points.count;
    pbs_points all;
    must(pbs_points_alloc(&run, PBS_POSITION | PBS_NORMAL, n + candidates->points.count, &all,
                          &err));
    for (size_t i = 0; i < 3 * n; i++)
        all.position[i] = (float)(surfels->points.position[i] + surfels->origin[i % 3] -
                                  candidates->origin[i % 3]);
    memcpy(all.position + 3 * n, candidates->points.position, candidates->points.count * 12);
    memcpy(all.normal, surfels->points.normal, n * 4);
    memcpy(all.normal + 2 * n, candidates->points.normal, candidates->points.count * 4);
    return all;
}

static void lay_out(pbs_tree *t, pbs_cover *c, size_t points, pbs_layout *l) {
    pbs_tree_layout(t, points, l);
    c->owner = pbs_layout_take(l, (points + PBS_LEAF - 1) / PBS_LEAF * PBS_LEAF * 4);
}

static int rising(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The candidates' distances to the surfels; returns how many. */
static size_t distances(pbs_cover *c, const pbs_cover_surfel *s, size_t surfels, double radius,
                        bool once, double *out) {
    pbs_tree *t = c->tree;
    size_t n = 0;
    must(pbs_cover_begin(&run, c, &err));
    must(pbs_cover_add(&run, c, s, surfels, pbs_cover_radius2(&t->metric, radius), once, &err));
    for (size_t i = 0; i < t->points; i++)
        if (t->id[i] >= surfels)
            out[n++] = sqrt((double)t->leaf[i / PBS_LEAF].d[i % PBS_LEAF]) / t->metric.length;
    return n;
}

static void add_covering(pbs_cover *c, const pbs_cover_surfel *s, size_t n, double *d, figures *f) {
    double guess = c->tree->metric.diagonal / sqrt((double)n);
    size_t m = distances(c, s, n, guess, false, d);
    qsort(d, m, sizeof *d, rising);
    f->most = d[m - 1], f->quantile = d[(size_t)(0.999 * (double)(m - 1))];
    for (size_t i = 0; i < m; i++) f->mean += d[i] / (double)m;
}

static void add_holes(pbs_cover *c, const pbs_cover_surfel *s, size_t n, double radius, double *d,
                      figures *f) {
    double reach = 1.25 * radius, holes = 0;
    c->kind = PBS_COVER_SIDE;
    size_t m = distances(c, s, n, reach, true, d);
    for (size_t i = 0; i < m; i++) holes += d[i] > reach;
    f->holes = holes / (double)m;
}

/* radius: R, and only the holes are measured; 0: all but the holes are. */
static void measure(const root *surfels, const root *candidates, double radius, figures *f) {
    pbs_points all = join(surfels, candidates);
    size_t n = surfels->points.count;
    pbs_tree t = {0};
    pbs_cover c = {.tree = &t, .kind = PBS_COVER_METRIC};
    pbs_layout l = {NULL, 0};
    void *block;
    lay_out(&t, &c, all.count, &l);
    must(pbs_alloc(&run, &block, l.used, 1, "the tree", &err));
    l = (pbs_layout){block, 0};
    lay_out(&t, &c, all.count, &l);
    /* With normals for the holes, but the distance is Euclid's. */
    must(pbs_metric_set(&run, &t.metric, &all, 1, &t.invalid, &err));
    must(pbs_tree_build(&run, &t, &all, &err));
    t.metric.base = 1, t.metric.slope = 0;

    uint32_t *order, *scratch;
    pbs_cover_surfel *s;
    double *d;
    must(pbs_alloc(&run, &order, n, 4, "the order", &err));
    must(pbs_alloc(&run, &scratch, all.count, 4, "the order", &err));
    must(pbs_alloc(&run, &s, n, sizeof *s, "the order", &err));
    must(pbs_alloc(&run, &d, all.count, sizeof *d, "the distances", &err));
    for (size_t i = 0; i < n; i++) order[i] = (uint32_t)i;
    pbs_cover_find(&t, order, n, scratch, all.count, s);
    if (radius > 0)
        add_holes(&c, s, n, radius, d, f);
    else
        add_covering(&c, s, n, d, f);
    pbs_free(&run, order), pbs_free(&run, scratch), pbs_free(&run, s), pbs_free(&run, d);
    pbs_free(&run, block);
    pbs_points_free(&run, &all);
}

enum { MOST = 8 };

int main(int argc, char **argv) {
    figures f[MOST] = {{0}};
    root candidates, surfels[MOST];
    char *path;
    int n = argc - 2;
    if (n < 1 || n > MOST) return printf("bench_hierarchy CANDIDATES NAME=SURFELS...\n"), PBS_USAGE;
    candidates = load(argv[1]);
    double radius = INFINITY, d = candidates.diagonal;
    for (int i = 0; i < n; i++) {
        if (!(path = strrchr(argv[2 + i], '=')))
            must(pbs_fail(&err, PBS_USAGE, "%s: not NAME=SURFELS", argv[2 + i]));
        *path = 0;
        surfels[i] = load(path + 1);
        measure(&surfels[i], &candidates, 0, &f[i]);
        radius = fmin(radius, f[i].most);
    }
    printf("%-16s %8s %9s %9s %9s   ratios: %6s %7s %7s %9s\n", "root", "surfels", "max/diag",
           "99.9%", "mean", "max", "99.9%", "mean", "holes %");
    for (int i = 0; i < n; i++) {
        measure(&surfels[i], &candidates, radius, &f[i]);
        printf("%-16s %8zu %9.3g %9.3g %9.3g %15.3f %7.3f %7.3f %9.4f\n", argv[2 + i],
               surfels[i].points.count, f[i].most / d, f[i].quantile / d, f[i].mean / d,
               f[i].most / f[0].most, f[i].quantile / f[0].quantile, f[i].mean / f[0].mean,
               100 * f[i].holes);
        pbs_points_free(&run, &surfels[i].points);
    }
    pbs_points_free(&run, &candidates.points);
    return 0;
}
