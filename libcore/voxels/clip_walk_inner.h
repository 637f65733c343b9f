/* clip_walk_inner.h: a triangle seen along the axis that is nearest to its normal: rows of pixels,
 * and any triangle, needles too, pixel by pixel and cell by cell.
 *
 * Cells are found with margins for rounding, and kept if their piece is certainly larger than
 * nothing, or if the exact test says so. Pieces are polygons in the triangle's own coordinates, so
 * that the pieces of a needle are as right as those of any triangle.
 */
#ifndef PBS_CLIP_WALK_INNER_H
#define PBS_CLIP_WALK_INNER_H

#include "libcore/voxels/clip_lanes_inner.h"

/* What the edges say in the two views across axis w: the cell at place is on the outside of an edge
 * if u * place[u] + w * place[w] > far, likewise v. The edges are side by side, the last one twice.
 */
typedef struct clip_walls {
    d4 u[2], w[2], far[2];
} clip_walls;

/* Seen along axis w. p[corner][u v w], n likewise. */
typedef struct clip_job {
    const double (*corner)[3];
    double p[3][3], d[3][3], over[3][3]; /* edges: from p to the next, and 1 / d (0 if d is) */
    double normal[3], slope[2];          /* dw/du, dw/dv */
    int u, v, w, lowest, highest;        /* axes; cells of the block between the ends along w */
    bool flat;                           /* no area: p is a segment or a point */
    bool even;                           /* w is the same everywhere */
    bool inside;                         /* all of w is in the block */
    double low, high;                    /* ends along w */
    double level;                        /* a whole number near p[0][2] */
    double stretch;                      /* area of what has area 1 as seen */
    double place[4];     /* rows: from a place as seen, from corner 0, to a centroid's u and v */
    double area, margin; /* of the triangle; of a position */
    uint32_t triangle;
    bool centroids;
    pbs_fragments *out;
    clip_walls walls;
} clip_job;

/* Directions are turned away from the third corner; where rounding turns one the wrong way, as in
 * views in which the triangle is a line, far is beyond that corner all the same. */
static inline void clip_walls_set(clip_job *job) {
    UNROLL
    for (int a = 0; a < 2; a++) {
        d4 u, w, x, y, dx, dy, zero = all4(0);
        UNROLL
        for (int i = 0; i < 4; i++) {
            int e = i < 3 ? i : 2, other = (e + 2) % 3;
            u[i] = job->p[e][a], w[i] = job->p[e][2];
            x[i] = job->p[other][a] - job->p[e][a], y[i] = job->p[other][2] - job->p[e][2];
            dx[i] = job->d[e][2], dy[i] = -job->d[e][a];
        }
        l4 turn = (l4)(dx * x + dy * y > 0);
        dx = pick(turn, -dx, dx), dy = pick(turn, -dy, dy);
        d4 near = dx * u + dy * w, third = dx * (u + x) + dy * (w + y);
        d4 error = (abs4(dx) + abs4(dy)) * (4 * job->margin);
        job->walls.u[a] = dx, job->walls.w[a] = dy;
        job->walls.far[a] = max4(near, third) - min4(dx, zero) - min4(dy, zero) + error;
    }
}

/* Whether the cell is certainly apart from the triangle. */
LANE bool clip_apart(const clip_walls *s, const int place[3]) {
    l4 out = (l4)all4(0);
    UNROLL
    for (int a = 0; a < 2; a++) out |= (l4)(s->u[a] * place[a] + s->w[a] * place[2] > s->far[a]);
    return bits4(out) != 0;
}

/* ---- the piece in a cell ---- */

typedef struct clip_point {
    double q[2][3]; /* from the cell's lower corner, and from its upper one: exact near either */
    double a, b;    /* corner 0 + a (corner 1 - corner 0) + b (corner 2 - corner 0) */
} clip_point;

static inline clip_point clip_between(const clip_point *p, const clip_point *q, double dp,
                                      double dq) {
    double t = dp / (dp - dq);
    clip_point r = {.a = p->a + t * (q->a - p->a), .b = p->b + t * (q->b - p->b)};
    for (int i = 0; i < 6; i++)
        r.q[i / 3][i % 3] = p->q[i / 3][i % 3] + t * (q->q[i / 3][i % 3] - p->q[i / 3][i % 3]);
    return r;
}

/* Keeps what is on the inner side of a face. What lies in an upper face is outside. */
static int clip_face(const clip_point *in, int n, int axis, bool upper, clip_point *out) {
    double side[10];
    int inside = 0, m = 0;
    for (int i = 0; i < n; i++) {
        side[i] = upper ? -in[i].q[1][axis] : in[i].q[0][axis];
        inside += upper ? side[i] > 0 : side[i] >= 0;
    }
    if (inside == 0) return 0;
    for (int i = 0; i < n; i++) {
        int j = i + 1 < n ? i + 1 : 0;
        bool here = upper ? side[i] > 0 : side[i] >= 0, there = upper ? side[j] > 0 : side[j] >= 0;
        if (here) out[m++] = in[i];
        if (here != there) out[m++] = clip_between(&in[i], &in[j], side[i], side[j]);
    }
    return m;
}

/* Area and centroid of the piece in a cell. */
static double clip_piece(const clip_job *job, const int cell[3], double at[2]) {
    clip_point from[10], to[10], *now = from, *next = to;
    for (int i = 0; i < 3; i++) {
        now[i] = (clip_point){.a = i == 1, .b = i == 2};
        for (int k = 0; k < 6; k++)
            now[i].q[k / 3][k % 3] = job->corner[i][k % 3] - (cell[k % 3] + k / 3);
    }
    int n = 3;
    for (int f = 0; f < 6 && n; f++) {
        n = clip_face(now, n, f / 2, f & 1, next);
        clip_point *t = now;
        now = next, next = t;
    }
    double sum = 0, a = 0, b = 0, a0 = now[0].a, b0 = now[0].b;
    for (int i = 1; i + 1 < n; i++) {
        double xa = now[i].a - a0, xb = now[i].b - b0;
        double ya = now[i + 1].a - a0, yb = now[i + 1].b - b0, part = xa * yb - xb * ya;
        sum += part, a += part * (xa + ya), b += part * (xb + yb);
    }
    /* A polygon without area: a point of it, or of the triangle. */
    at[0] = n ? a0 : 1.0 / 3, at[1] = n ? b0 : 1.0 / 3;
    if (sum > 0) at[0] += a / (3 * sum), at[1] += b / (3 * sum);
    return sum > 0 ? sum * job->area : 0;
}

static void clip_cell(const clip_job *job, const int place[3]) {
    int cell[3];
    double at[2];
    cell[job->u] = place[0], cell[job->v] = place[1], cell[job->w] = place[2];
    double area = clip_piece(job, cell, at);
    /* A piece is right within the margin times its circumference. */
    if (area <= 32 * job->margin && !pbs_clip_meets(job->corner, cell)) return;
    uint32_t id = PBS_CELL(cell[0], cell[1], cell[2]);
    if (job->centroids)
        clip_put_at(job->out, id, job->triangle, area, at[0], at[1]);
    else
        clip_put(job->out, id, job->triangle, area, 0, 0);
}

/* ---- which cells ---- */

typedef struct clip_range {
    double low, high;
} clip_range;

static inline void clip_add(clip_range *r, double x) {
    r->low = x < r->low ? x : r->low;
    r->high = x > r->high ? x : r->high;
}

/* Cuts the part of an edge whose coordinate k is in low .. high. */
static inline void clip_edge(const clip_job *job, int e, int k, double low, double high,
                             clip_range *t) {
    double from = job->p[e][k], over = job->over[e][k];
    if (over == 0) {
        if (from < low || from > high) *t = (clip_range){1, 0};
        return;
    }
    double x = (low - from) * over, y = (high - from) * over;
    double first = x < y ? x : y, last = x < y ? y : x;
    t->low = first > t->low ? first : t->low;
    t->high = last < t->high ? last : t->high;
}

static inline double clip_on_edge(const clip_job *job, int e, int k, double t) {
    return job->p[e][k] + t * job->d[e][k];
}

/* Height of the plane; an end of the triangle is as far as the block is wide, or it is inside. */
static inline double clip_height(const clip_job *job, double u, double v) {
    return job->p[0][2] + (job->slope[0] * (u - job->p[0][0]) + job->slope[1] * (v - job->p[0][1]));
}

/* Whether the triangle covers a point, or may. */
static bool clip_covers(const clip_job *job, double u, double v) {
    for (int e = 0; e < 3; e++) {
        double x = job->d[e][0] * (v - job->p[e][1]), y = job->d[e][1] * (u - job->p[e][0]);
        double side = job->normal[2] > 0 ? x - y : y - x;
        if (side < -0x1p-50 * (fabs(x) + fabs(y))) return false;
    }
    return true;
}

/* Heights of the triangle above a pixel. */
static clip_range clip_above(const clip_job *job, int i, int j) {
    clip_range r = {INFINITY, -INFINITY};
    double m = job->margin;
    for (int e = 0; e < 3; e++) {
        clip_range t = {0, 1};
        clip_edge(job, e, 0, i - m, i + 1 + m, &t);
        clip_edge(job, e, 1, j - m, j + 1 + m, &t);
        if (t.low > t.high) continue;
        clip_add(&r, clip_on_edge(job, e, 2, t.low));
        clip_add(&r, clip_on_edge(job, e, 2, t.high));
    }
    for (int c = 0; c < 4 && !job->flat; c++) {
        double u = i + (c & 1), v = j + (c >> 1);
        if (clip_covers(job, u, v)) clip_add(&r, clip_height(job, u, v));
    }
    return r;
}

static void clip_pixel(const clip_job *job, int i, int j) {
    clip_range r = clip_above(job, i, j);
    if (r.low - job->margin >= PBS_BLOCK || r.high + job->margin < 0) return;
    int from = r.low < 1 ? 0 : clip_floor(r.low - job->margin);
    int to = r.high > PBS_BLOCK - 1 ? PBS_BLOCK - 1 : clip_floor(r.high + job->margin);
    for (int k = from; k <= to; k++) {
        const int place[3] = {i, j, k};
        if (!clip_apart(&job->walls, place)) clip_cell(job, place);
    }
}
#endif
