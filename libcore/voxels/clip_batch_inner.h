/* clip_batch_inner.h: a batch of triangles, sorted by the cells that their boxes span. */
#ifndef PBS_CLIP_BATCH_INNER_H
#define PBS_CLIP_BATCH_INNER_H

#include "libcore/voxels/clip_large_inner.h"
#include "libcore/voxels/clip_small_inner.h"

enum { CLIP_OUTSIDE = 27 * 2, CLIP_CODES };

/* What is known of each triangle before it is cut. */
typedef struct clip_look {
    double low[3][PBS_TRIANGLES]; /* cells */
    double area[PBS_TRIANGLES];
    double code[PBS_TRIANGLES]; /* cells spanned along x, less 1 and at most 2, 3 times y, 9 times
                                   z; 27 for needles; or CLIP_OUTSIDE */
} clip_look;

LANE void clip_look_four(const pbs_triangles *t, uint32_t i, clip_look *look) {
    d4 e[2][3], n[3], code = all4(0), most = all4(0), terms = all4(0), far = all4(0);
    l4 outside = (l4)code;
    const d4 two = all4(2);
    UNROLL
    for (int k = 0; k < 3; k++) {
        d4 low = at4(&t->min[k][i]), high = at4(&t->max[k][i]), from = floor4(low);
        outside |= (l4)(high < 0) | (l4)(low >= PBS_BLOCK);
        put4(&look->low[k][i], from);
        d4 span = min4(floor4(high) - from, two);
        code += span * (k == 0 ? 1.0 : k == 1 ? 3.0 : 9.0);
        d4 p = at4(&t->p[0][k][i]);
        e[0][k] = at4(&t->p[1][k][i]) - p, e[1][k] = at4(&t->p[2][k][i]) - p;
    }
    UNROLL
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        d4 x = e[0][a] * e[1][b], y = e[0][b] * e[1][a];
        n[k] = x - y;
        most = max4(most, abs4(n[k])), terms = max4(terms, abs4(x) + abs4(y));
        far += n[k] * n[k];
    }
    code += pick((l4)(most < terms * 0x1p-20), all4(27), all4(0));
    put4(&look->code[i], pick(outside, all4(CLIP_OUTSIDE), code));
    put4(&look->area[i], sqrt4(far) * 0.5);
}

/* The axes that are cut, in front; how many these are: 3 and a little for what spans more than
 * two cells. */
enum { CLIP_LARGE = 4, CLIP_NOWHERE };
typedef struct clip_kind {
    uint8_t kind, axis[3];
} clip_kind;

static inline clip_kind clip_kind_of(int code) {
    static const clip_kind table[8] = {{0, {0, 1, 2}}, {1, {0, 1, 2}}, {1, {1, 2, 0}},
                                       {2, {0, 1, 2}}, {1, {2, 0, 1}}, {2, {2, 0, 1}},
                                       {2, {1, 2, 0}}, {3, {0, 1, 2}}};
    static const int8_t bits[27] = {0,  1,  -1, 2,  3,  -1, -1, -1, -1, 4,  5,  -1, 6, 7,
                                    -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1};
    if (code == CLIP_OUTSIDE) return (clip_kind){CLIP_NOWHERE, {0}};
    if (code == 27) return (clip_kind){0, {0, 1, 2}};
    if (code > 27 || bits[code] < 0) return (clip_kind){CLIP_LARGE, {0}};
    return table[bits[code]];
}

typedef struct clip_list {
    uint32_t count;
    uint8_t index[PBS_TRIANGLES + 3], axis[PBS_TRIANGLES + 3][3];
} clip_list;

LANE void clip_list_cut(const clip_small *s, clip_list *l, int axes, bool centroids) {
    for (uint32_t i = 0; i < 3 && l->count; i++) { /* the last, again, to fill the vector */
        l->index[l->count + i] = l->index[l->count - 1];
        memcpy(l->axis[l->count + i], l->axis[l->count - 1], 3);
    }
    for (uint32_t i = 0; i < l->count; i += 4) {
        int count = l->count - i < 4 ? (int)(l->count - i) : 4;
        small_four(s, &l->index[i], &l->axis[i], count, axes, centroids);
    }
}

static void clip_corners(const pbs_triangles *t, uint32_t i, double p[3][3]) {
    for (int c = 0; c < 9; c++) p[c / 3][c % 3] = t->p[c / 3][c % 3][i];
}

static void clip_single(const clip_small *s, const clip_look *look, uint32_t i, bool centroids) {
    double area = look->area[i];
    float third = centroids ? 1.0f / 3 : 0;
    if (look->code[i] != 0) { /* a needle */
        double p[3][3], n[3];
        clip_corners(s->t, i, p);
        pbs_clip_normal(p, n);
        area = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) / 2;
    }
    uint32_t cell = PBS_CELL((int)look->low[0][i], (int)look->low[1][i], (int)look->low[2][i]);
    clip_put(s->out, cell, i, area, third, third);
}

LANE void clip_lists(const clip_small *s, clip_list list[3], bool centroids) {
    clip_list_cut(s, &list[0], 1, centroids);
    clip_list_cut(s, &list[1], 2, centroids);
    clip_list_cut(s, &list[2], 3, centroids);
}

static void clip_batch(const pbs_triangles *t, bool centroids, pbs_fragments *out) {
    clip_look look;
    clip_list list[3];
    const clip_small s = {t, look.area, look.low, out};
    for (int i = 0; i < 3; i++) list[i].count = 0;
    for (uint32_t i = 0; i < t->count; i += 4) clip_look_four(t, i, &look);
    for (uint32_t i = 0; i < t->count; i++) {
        clip_kind kind = clip_kind_of((int)look.code[i]);
        if (kind.kind == CLIP_NOWHERE) continue;
        if (kind.kind == 0) {
            clip_single(&s, &look, i, centroids);
        } else if (kind.kind == CLIP_LARGE) {
            double p[3][3];
            clip_corners(t, i, p);
            clip_large((const double(*)[3])p, i, centroids, out);
        } else {
            clip_list *l = &list[kind.kind - 1];
            l->index[l->count] = (uint8_t)i;
            memcpy(l->axis[l->count++], kind.axis, 3);
        }
    }
    if (centroids)
        clip_lists(&s, list, true);
    else
        clip_lists(&s, list, false);
}
#endif
