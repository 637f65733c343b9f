/* clip_row_inner.h: the pixels of a row that a triangle is in, and those that it covers. */
#ifndef PBS_CLIP_ROW_INNER_H
#define PBS_CLIP_ROW_INNER_H

#include "libcore/clip_lanes_inner.h"
#include "libcore/clip_walk_inner.h"

/* The edges side by side, the last one twice. */
typedef struct clip_sides {
    d4 u, v, du, dv, over; /* 1 / dv, or 0 */
    d4 slope;              /* du / dv */
    l4 left, right;        /* of the triangle; neither: along u */
    l4 above;              /* which the triangle is, of an edge along u */
} clip_sides;

typedef struct clip_row {
    int from, to;  /* may be touched: from .. to */
    int low, high; /* covered: low .. high - 1; both to + 1: none */
} clip_row;

static inline void clip_sides_set(clip_sides *s, const clip_job *job) {
    for (int i = 0; i < 4; i++) {
        int e = i < 3 ? i : 2;
        s->u[i] = job->p[e][0], s->v[i] = job->p[e][1];
        s->du[i] = job->d[e][0], s->dv[i] = job->d[e][1], s->over[i] = job->over[e][1];
    }
    s->slope = s->du * s->over;
    /* The inside is on the left of every edge of a triangle that turns left. */
    l4 turn = (l4)(all4(job->normal[2]) < 0);
    l4 up = (l4)(s->dv > 0) ^ turn, flat = (l4)(s->dv == 0);
    s->right = up & ~flat, s->left = ~up & ~flat;
    s->above = (l4)(s->du > 0) ^ turn;
}

LANE double least4(d4 x) {
    double a = x[0] < x[1] ? x[0] : x[1], b = x[2] < x[3] ? x[2] : x[3];
    return a < b ? a : b;
}
LANE double most4(d4 x) {
    return -least4(-x);
}

/* The hull of the parts of the edges that are in the row, with its margins. */
LANE clip_range clip_row_touched(const clip_sides *s, double low, double high) {
    d4 zero = all4(0), one = all4(1), far = all4(INFINITY);
    d4 x = (low - s->v) * s->over, y = (high - s->v) * s->over;
    l4 flat = (l4)(s->dv == 0), off = (l4)(s->v < low) | (l4)(s->v > high);
    d4 first = pick(flat, zero, max4(min4(x, y), zero));
    d4 last = pick(flat, one, min4(max4(x, y), one));
    l4 none = (l4)(first > last) | (flat & off);
    d4 a = s->u + first * s->du, b = s->u + last * s->du;
    return (clip_range){least4(pick(none, far, min4(a, b))), most4(pick(none, -far, max4(a, b)))};
}

LANE clip_range clip_row_covered(const clip_sides *s, int j) {
    d4 far = all4(PBS_BLOCK + 1), x = s->u + s->slope * (j - s->v), y = x + s->slope;
    d4 low = pick(s->left, max4(x, y), -far), high = pick(s->right, min4(x, y), far);
    l4 flat = ~(s->left | s->right);
    l4 cut = flat & ((s->above & (l4)(s->v > j)) | (~s->above & (l4)(s->v < j + 1)));
    /* Without a pixel, too, where an edge along u cuts the row. */
    high = pick(cut, -far, high);
    return (clip_range){most4(min4(max4(low, -far), far)), least4(max4(min4(high, far), -far))};
}

static bool clip_row_find(const clip_job *job, const clip_sides *s, int j, clip_row *row) {
    double m = job->margin;
    clip_range r = clip_row_touched(s, j - m, j + 1 + m);
    if (!job->flat && !job->inside) clip_row_in_block(job, j, &r);
    if (!(r.low - m < PBS_BLOCK && r.high + m >= 0)) return false;
    row->from = r.low < 1 ? 0 : clip_floor(r.low - m);
    row->to = r.high > PBS_BLOCK - 1 ? PBS_BLOCK - 1 : clip_floor(r.high + m);
    r = clip_row_covered(s, j);
    int low = -clip_floor(-(r.low + m)), high = clip_floor(r.high - m);
    low = low > row->from ? low : row->from, high = high < row->to + 1 ? high : row->to + 1;
    row->low = low < high ? low : row->to + 1, row->high = low < high ? high : row->to + 1;
    return row->from <= row->to;
}
#endif
