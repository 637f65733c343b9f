/* clip_row_inner.h: the pixels of a row that a triangle is in, and those that it covers: four rows
 * at a time. */
#ifndef PBS_CLIP_ROW_INNER_H
#define PBS_CLIP_ROW_INNER_H

#include "libcore/voxels/clip_lanes_inner.h"
#include "libcore/voxels/clip_walk_inner.h"

typedef struct clip_side {
    double u, v, du, dv, over, slope; /* an edge; 1 / dv and du / dv, or 0 */
    bool flat, right; /* it is along u; else: whether the triangle is on the left of it */
    bool above;       /* whether the triangle is, of an edge along u */
} clip_side;

typedef struct clip_rows {
    int from[4], to[4];  /* may be touched: from .. to; to < from: none */
    int low[4], high[4]; /* covered: low .. high - 1; both to + 1: none */
} clip_rows;

static inline void clip_sides_set(clip_side side[3], const clip_job *job) {
    bool turn = job->normal[2] < 0;
    for (int e = 0; e < 3; e++) {
        clip_side *s = &side[e];
        s->u = job->p[e][0], s->v = job->p[e][1];
        s->du = job->d[e][0], s->dv = job->d[e][1], s->over = job->over[e][1];
        s->slope = s->du * s->over;
        /* The inside is on the left of every edge of a triangle that turns left. */
        s->flat = s->dv == 0;
        s->right = (s->dv > 0) != turn;
        s->above = (s->du > 0) != turn;
    }
}

typedef struct row_ranges {
    d4 low, high; /* the hull of the parts of the edges that are in the row, with its margins */
    d4 from, to;  /* what is covered is between */
} row_ranges;

LANE void row_flat(const clip_side *s, d4 at, d4 m, row_ranges *r) {
    l4 in = (l4)(at - m <= s->v) & (l4)(at + 1 + m >= s->v);
    double a = s->u, b = s->u + s->du;
    r->low = pick(in, min4(r->low, all4(a < b ? a : b)), r->low);
    r->high = pick(in, max4(r->high, all4(a < b ? b : a)), r->high);
    /* Without a pixel, too, where an edge along u cuts the row. */
    l4 cut = s->above ? (l4)(at < s->v) : (l4)(at + 1 > s->v);
    r->to = pick(cut, all4(-INFINITY), r->to);
}

LANE void row_edge(const clip_side *s, d4 at, d4 m, row_ranges *r) {
    d4 x = (at - m - s->v) * s->over, y = (at + 1 + m - s->v) * s->over;
    d4 first = max4(min4(x, y), all4(0)), last = min4(max4(x, y), all4(1));
    l4 none = (l4)(first > last);
    d4 a = s->u + first * s->du, b = s->u + last * s->du;
    r->low = pick(none, r->low, min4(r->low, min4(a, b)));
    r->high = pick(none, r->high, max4(r->high, max4(a, b)));
    x = s->u + s->slope * (at - s->v), y = x + s->slope;
    if (s->right)
        r->to = min4(r->to, min4(x, y));
    else
        r->from = max4(r->from, max4(x, y));
}

/* Cuts rows to where the plane is in the block. Slopes that make no difference within it are left
 * to the pixels. */
LANE void row_in_block(const clip_job *job, d4 at, row_ranges *r) {
    double g = job->slope[0], h = job->slope[1], m = job->margin;
    d4 base = job->p[0][2] + (h * (at - job->p[0][1]) - g * job->p[0][0]);
    d4 low = base + ((h < 0 ? h : 0) - m), high = base + ((h > 0 ? h : 0) + m);
    if (fabs(g) < 0x1p-20) {
        l4 out = (l4)(low > PBS_BLOCK + 1) | (l4)(high < -1);
        r->low = pick(out, all4(INFINITY), r->low), r->high = pick(out, all4(-INFINITY), r->high);
        return;
    }
    d4 x = (g > 0 ? -high : PBS_BLOCK - low) / g, y = (g > 0 ? PBS_BLOCK - low : -high) / g;
    r->low = max4(x - 1, r->low), r->high = min4(y + 1, r->high);
}

LANE void put_ints(int out[4], d4 x) {
    i4 i = __builtin_convertvector(x, i4);
    memcpy(out, &i, sizeof i);
}

/* Rows j .. j + 3. */
static inline void clip_rows_find(const clip_job *job, const clip_side side[3], int j,
                                  clip_rows *rows) {
    const d4 far = all4(INFINITY), m = all4(job->margin), at = (d4){0, 1, 2, 3} + j;
    row_ranges r = {far, -far, -far, far};
    UNROLL
    for (int e = 0; e < 3; e++) {
        if (side[e].flat)
            row_flat(&side[e], at, m, &r);
        else
            row_edge(&side[e], at, m, &r);
    }
    if (!job->flat && !job->inside) row_in_block(job, at, &r);
    const d4 zero = all4(0), one = all4(1), width = all4(PBS_BLOCK), wide = all4(PBS_BLOCK + 1);
    l4 in = (l4)(r.low - m < width) & (l4)(r.high + m >= zero);
    d4 from = max4(floor4(min4(max4(r.low - m, -one), width)), zero);
    d4 to = min4(floor4(min4(max4(r.high + m, -one), width)), width - 1);
    to = pick(in, to, from - one);
    d4 low = max4(-floor4(-(min4(max4(r.from, -wide), wide) + m)), from);
    d4 high = min4(floor4(min4(max4(r.to, -wide), wide) - m), to + one);
    l4 some = (l4)(low < high);
    put_ints(rows->from, from), put_ints(rows->to, to);
    put_ints(rows->low, pick(some, low, to + one));
    put_ints(rows->high, pick(some, high, to + one));
}
#endif
