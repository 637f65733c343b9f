/* clip_large_inner.h: triangles that span more than two cells along some axis, row by row. */
#ifndef PBS_CLIP_LARGE_INNER_H
#define PBS_CLIP_LARGE_INNER_H

#include "libcore/voxels/clip_pixel_inner.h"

/* The axis of the longest component. */
static inline int clip_longest(const double x[3]) {
    double a = fabs(x[0]), b = fabs(x[1]), c = fabs(x[2]);
    return a >= b && a >= c ? 0 : b >= c ? 1 : 2;
}

static void clip_axes(clip_job *job, const double n[3]) {
    double size[3];
    int first = clip_longest(n);
    if (job->flat) {
        for (int k = 0; k < 3; k++) {
            const double(*c)[3] = job->corner;
            size[k] = fabs(c[1][k] - c[0][k]) + fabs(c[2][k] - c[0][k]);
        }
        first = (clip_longest(size) + 1) % 3; /* v is the longest then */
    }
    job->w = first, job->u = (first + 1) % 3, job->v = (first + 2) % 3;
}

/* The normal in doubles, unless they cancel. */
static void clip_normal(const double p[3][3], double n[3]) {
    double most = 0, terms = 0;
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        double s = (p[1][a] - p[0][a]) * (p[2][b] - p[0][b]);
        double t = (p[1][b] - p[0][b]) * (p[2][a] - p[0][a]);
        n[k] = s - t;
        most = fabs(n[k]) > most ? fabs(n[k]) : most;
        terms = fabs(s) + fabs(t) > terms ? fabs(s) + fabs(t) : terms;
    }
    if (most < terms * 0.125) pbs_clip_normal(p, n);
}

/* The cell that x is in, or the nearest of the block. */
static inline int clip_cell_in_block(double x) {
    return x < 0 ? 0 : x >= PBS_BLOCK ? PBS_BLOCK - 1 : clip_floor(x);
}

static void clip_edges(clip_job *job) {
    const int axis[3] = {job->u, job->v, job->w};
    double far = 0;
    for (int k = 0; k < 3; k++)
        for (int e = 0; e < 3; e++) {
            job->p[e][k] = job->corner[e][axis[k]];
            job->d[e][k] = job->corner[(e + 1) % 3][axis[k]] - job->p[e][k];
            job->over[e][k] = job->d[e][k] != 0 ? 1 / job->d[e][k] : 0;
            far = fabs(job->d[e][k]) > far ? fabs(job->d[e][k]) : far;
        }
    /* The triangle meets the block: no corner is farther from its own. Not where they are, so that
     * a triangle that moves by whole voxels is cut as it was. */
    job->margin = (far + PBS_BLOCK) * 0x1p-46;
    clip_walls_set(job);
}

/* The ends along k. */
static clip_range clip_ends(const clip_job *job, int k) {
    clip_range r = {job->p[0][k], job->p[0][k]};
    clip_add(&r, job->p[1][k]);
    clip_add(&r, job->p[2][k]);
    return r;
}

static void clip_plane(clip_job *job, const double n[3], double length) {
    job->normal[0] = n[job->u], job->normal[1] = n[job->v], job->normal[2] = n[job->w];
    job->even = job->d[0][2] == 0 && job->d[1][2] == 0;
    if (job->flat) return;
    double over = 1 / job->normal[2];
    for (int k = 0; k < 2; k++) job->slope[k] = -job->normal[k] / job->normal[2];
    job->level = clip_floor(job->p[0][2] + 0.5);
    job->stretch = job->even ? 1 : fabs(length * over);
    job->place[0] = -job->d[2][1] * over, job->place[1] = job->d[2][0] * over;
    job->place[2] = -job->d[0][1] * over, job->place[3] = job->d[0][0] * over;
}

static void clip_large(const double corner[3][3], uint32_t triangle, bool centroids,
                       pbs_fragments *out) {
    double n[3];
    clip_normal(corner, n);
    double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    clip_job job;
    job.corner = corner, job.area = length / 2, job.flat = !(length > 0);
    job.triangle = triangle, job.centroids = centroids, job.out = out;
    clip_axes(&job, n);
    clip_edges(&job);
    clip_plane(&job, n, length);
    /* Seen as pixels, what is narrower than this would lose too much to rounding. */
    double far = job.margin * 0x1p46;
    bool narrow = length < far * far * 0x1p-18;
    clip_pixels px[2]; /* on edges, covered */
    px[0].count = px[1].count = 0;
    clip_range v = clip_ends(&job, 1), w = clip_ends(&job, 2);
    job.low = w.low, job.high = w.high;
    job.inside = w.low >= 0 && w.high < PBS_BLOCK;
    job.lowest = clip_cell_in_block(w.low), job.highest = clip_cell_in_block(w.high);
    int last = clip_cell_in_block(v.high);
    clip_side side[3];
    clip_rows rows;
    clip_sides_set(side, &job);
    for (int begin = clip_cell_in_block(v.low), j = begin; j <= last; j++) {
        int r = (j - begin) % 4;
        if (r == 0) clip_rows_find(&job, side, j, &rows);
        if (!narrow) pixel_row(&job, &rows, r, j, px);
        for (int i = rows.from[r]; i <= rows.to[r] && narrow; i++) clip_pixel(&job, i, j);
    }
    pixel_join(px);
    pixel_flush(&job, &px[0], true);
    pixel_flush(&job, &px[1], false);
}
#endif
