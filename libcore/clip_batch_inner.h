/* clip_batch_inner.h: a batch of triangles, sorted by the cells that their boxes span. */
#ifndef PBS_CLIP_BATCH_INNER_H
#define PBS_CLIP_BATCH_INNER_H

#include "libcore/clip_walk_inner.h"

static void clip_normal(const double p[3][3], double n[3]) {
    double most = 0, terms = 0;
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        double s = (p[1][a] - p[0][a]) * (p[2][b] - p[0][b]);
        double t = (p[1][b] - p[0][b]) * (p[2][a] - p[0][a]);
        n[k] = s - t;
        most = fmax(most, fabs(n[k]));
        terms = fmax(terms, fabs(s) + fabs(t));
    }
    /* Needles cancel too much. */
    if (most < 0x1p-8 * terms) pbs_clip_normal(p, n);
}

static void clip_batch(const pbs_triangles *t, bool centroids, pbs_fragments *out) {
    for (uint32_t i = 0; i < t->count; i++) {
        double p[3][3], n[3];
        bool outside = false;
        for (int k = 0; k < 3; k++) {
            outside |= t->max[k][i] < 0 || t->min[k][i] >= PBS_BLOCK;
            for (int c = 0; c < 3; c++) p[c][k] = t->p[c][k][i];
        }
        if (outside) continue;
        clip_normal(p, n);
        clip_walk(p, n, i, centroids, out);
    }
}
#endif
