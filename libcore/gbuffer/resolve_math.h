/* resolve_math.h: the arithmetic of resolve.c, four pixels at a time. It is compiled twice, in
 * resolve.c and, with AVX2, in resolve_avx2.c; each lane is a sequence of IEEE operations, so both
 * give the same bits.
 */
#ifndef PBS_RESOLVE_MATH_H
#define PBS_RESOLVE_MATH_H

#include "libcore/gbuffer/resolve.h"
#include "libcore/data/vectors.h"

LANE d4_at *at_d(const double *p) {
    return (d4_at *)(uintptr_t)p;
}
LANE l4_at *at_l(const int64_t *p) {
    return (l4_at *)(uintptr_t)p;
}
LANE f4_at *at_f(const float *p) {
    return (f4_at *)(uintptr_t)p;
}
LANE i4_at *at_i(const int32_t *p) {
    return (i4_at *)(uintptr_t)p;
}

typedef struct d43 {
    d4 x, y, z;
} d43;

LANE d43 point(const pbs_lanes *b, int corner, int i) {
    return (d43){__builtin_convertvector(*at_f(&b->p[corner][0][i]), d4),
                 __builtin_convertvector(*at_f(&b->p[corner][1][i]), d4),
                 __builtin_convertvector(*at_f(&b->p[corner][2][i]), d4)};
}
LANE d43 minus(const d43 *a, const d43 *b) {
    return (d43){a->x - b->x, a->y - b->y, a->z - b->z};
}
LANE d4 row3(const double *m, const d43 *v) {
    return m[0] * v->x + m[1] * v->y + m[2] * v->z;
}
LANE d4 dot3(const d43 *a, const d43 *b) {
    return a->x * b->x + a->y * b->y + a->z * b->z;
}
LANE d43 edge(const pbs_lanes *b, int corner, const d43 *o, int i) {
    d43 p = point(b, corner, i);
    return minus(&p, o);
}
LANE d4 pick(const l4 *which, const d4 *then, const d4 *other) {
    return (d4)((*which & (l4)*then) | (~*which & (l4)*other));
}

typedef struct triangles {
    d43 o, e, f; /* corner 0, and the edges from it, in the part's coordinates */
} triangles;

/* Barycentric coordinates of the pixel centres, from the edges as the view sees them. Snapping
 * puts some centres outside; they are the exception, and are done one by one. */
LANE void aim_four(const pbs_placed *p, pbs_lanes *b, int i, int to, const triangles *t) {
    const double *v = p->view;
    d4 dx = *at_d(&b->centre[0][i]) - (row3(v, &t->o) + v[3]);
    d4 dy = *at_d(&b->centre[1][i]) - (row3(v + 4, &t->o) + v[7]);
    d4 ax = row3(v, &t->e), ay = row3(v + 4, &t->e), bx = row3(v, &t->f), by = row3(v + 4, &t->f);
    d4 det = ax * by - bx * ay, inv = 1 / det;
    d4 b1 = (dx * by - bx * dy) * inv, b2 = (ax * dy - dx * ay) * inv, b0 = 1 - b1 - b2;
    *at_d(&b->a[0][0][i]) = ax, *at_d(&b->a[0][1][i]) = ay;
    *at_d(&b->a[1][0][i]) = bx, *at_d(&b->a[1][1][i]) = by;
    *at_d(&b->det[i]) = det;
    *at_d(&b->b[0][i]) = b0, *at_d(&b->b[1][i]) = b1, *at_d(&b->b[2][i]) = b2;
    l4 in = (b0 >= 0) & (b1 >= 0) & (b2 >= 0);
    if (in[0] & in[1] & in[2] & in[3]) return;
    for (int k = 0; k < 4 && i + k < to; k++)
        if (!in[k]) pbs_resolve_nearest(b, i + k, dx[k], dy[k]);
}

LANE void place_four(const pbs_placed *p, pbs_lanes *b, int i, const triangles *t) {
    const double *m = p->draw->m;
    d4 b1 = *at_d(&b->b[1][i]), b2 = *at_d(&b->b[2][i]);
    d43 q = {t->o.x + (b1 * t->e.x + b2 * t->f.x), t->o.y + (b1 * t->e.y + b2 * t->f.y),
             t->o.z + (b1 * t->e.z + b2 * t->f.z)};
    for (int r = 0; r < 3; r++) {
        d4 v = row3(m + 4 * r, &q) + m[4 * r + 3];
        *at_f(&b->position[r][i]) = __builtin_convertvector(v, f4);
    }
}

/* The corners' normals, decoded as in vec.h and weighed. */
LANE d43 smooth_four(const pbs_lanes *b, int i) {
    f4 sum[3] = {{0}, {0}, {0}};
    for (int c = 0; c < 3; c++) {
        i4 packed = *at_i(&b->normal[c][i]);
        f4 x = __builtin_convertvector((packed << 16) >> 16, f4) * (1 / 32767.0f);
        f4 y = __builtin_convertvector(packed >> 16, f4) * (1 / 32767.0f);
        f4 z = 1 - abs4f(x) - abs4f(y), t = (f4)((i4)(-z) & (z < 0));
        x -= turn4f(t, x), y -= turn4f(t, y);
        f4 w = __builtin_convertvector(*at_d(&b->b[c][i]), f4) / sqrt4f(x * x + y * y + z * z);
        sum[0] += w * x, sum[1] += w * y, sum[2] += w * z;
    }
    return (d43){__builtin_convertvector(sum[0], d4), __builtin_convertvector(sum[1], d4),
                 __builtin_convertvector(sum[2], d4)};
}

/* Octahedral code as in vec.h; the length of n doesn't matter. */
LANE i4 encode_four(const d43 *n) {
    d4 ax = (d4)((l4)n->x & INT64_MAX), ay = (d4)((l4)n->y & INT64_MAX);
    d4 s = ax + ay + (d4)((l4)n->z & INT64_MAX), inv = 1 / s;
    l4 good = (s > 0) & (s < INFINITY);
    f4 x = __builtin_convertvector((d4)((l4)(n->x * inv) & good), f4);
    f4 y = __builtin_convertvector((d4)((l4)(n->y * inv) & good), f4);
    i4 low = __builtin_convertvector(n->z, f4) < 0;
    f4 u = turn4f(1 - abs4f(y), x), v = turn4f(1 - abs4f(x), y);
    x = (f4)((low & (i4)u) | (~low & (i4)x)), y = (f4)((low & (i4)v) | (~low & (i4)y));
    const f4 half = {0.5f, 0.5f, 0.5f, 0.5f};
    i4 ix = __builtin_convertvector(x * 32767.0f + turn4f(half, x), i4);
    i4 iy = __builtin_convertvector(y * 32767.0f + turn4f(half, y), i4);
    return (ix & 0xffff) | (iy << 16);
}

/* The triangle's own normal g is turned to the viewer, the smooth one to its side. */
LANE void normal_four(const pbs_placed *p, pbs_lanes *b, int i, const triangles *a, bool odd) {
    const d43 *e = &a->e, *f = &a->f;
    d43 face = {e->y * f->z - e->z * f->y, e->z * f->x - e->x * f->z, e->x * f->y - e->y * f->x};
    const double *c = p->cofactor;
    d43 g = {row3(c, &face), row3(c + 3, &face), row3(c + 6, &face)}, n = g;
    d4 det = *at_d(&b->det[i]);
    l4 flip = odd ? det > 0 : det < 0;
    if (p->draw->mesh->normal) {
        d43 s = smooth_four(b, i), t = {row3(c, &s), row3(c + 3, &s), row3(c + 6, &s)};
        l4 use = (dot3(&s, &s) > 1e-8) & (dot3(&t, &t) > 0);
        n = (d43){pick(&use, &t.x, &g.x), pick(&use, &t.y, &g.y), pick(&use, &t.z, &g.z)};
        flip ^= use & (dot3(&t, &g) < 0);
    }
    l4 sign = flip & INT64_MIN;
    n = (d43){(d4)((l4)n.x ^ sign), (d4)((l4)n.y ^ sign), (d4)((l4)n.z ^ sign)};
    *at_i(&b->code[i]) = encode_four(&n);
}

/* Lanes from .. to - 1, which have one mesh; up to three more are written. */
LANE void solve_all(const pbs_placed *p, pbs_lanes *b, int from, int to, bool normals, bool odd) {
    for (int i = from; i < to; i += 4) {
        triangles t = {.o = point(b, 0, i)};
        t.e = edge(b, 1, &t.o, i), t.f = edge(b, 2, &t.o, i);
        aim_four(p, b, i, to, &t);
        place_four(p, b, i, &t);
        if (normals) normal_four(p, b, i, &t, odd);
    }
}
#endif
