/* coarsen_inner.h: one level of coarsen.c: children to parents. It is compiled twice, in coarsen.c
 * and, for AVX2, in coarsen_avx2.c; each lane is a sequence of IEEE operations, so both give the
 * same bits.
 *
 * Children of one parent follow each other, from one to eight of them, in no foreseeable pattern.
 * So nothing branches on where a parent ends: a sum is masked to zero by the first child, and
 * written to its parent's place after every child; the last one stays.
 */
#ifndef PBS_COARSEN_INNER_H
#define PBS_COARSEN_INNER_H

#include "libcore/voxels/coarsen.h"
#include "libcore/data/srgb.h"
#include "libcore/data/vec.h"
#include "libcore/data/vectors.h"
#include <float.h>

#define PBS_COARSEN_BLOCK 2048 /* children at a time: all their arrays lie in the first caches */
#define PBS_COARSEN_SLACK 16   /* elements behind an array's end that may be read and written */
#define PBS_COARSEN_ROOM  (PBS_COARSEN_BLOCK + PBS_COARSEN_SLACK)

/* Sums over the finest voxels of a cell, by weight: BASE: normal * 511, and the weight itself. */
enum { PBS_SUM_BASE, PBS_SUM_COLOUR, PBS_SUM_MATERIAL, PBS_SUM_EMISSIVE, PBS_SUMS };

/* Cells of a level: as they are given out, and their sums. */
typedef struct pbs_cell_rows {
    size_t n;
    pbs_voxels v;      /* its count is not used */
    f4 *sum[PBS_SUMS]; /* NULL: the finest level, or a channel that is not there */
    /* Lists of faces, which v.face points into: as they are given out; what they are the mean of,
     * or NULL; its weight. */
    uint32_t *faces;
    f4 *face_sum;
    float *face_weight;
    size_t face_count;
} pbs_cell_rows;

/* What is known of children while parents are made. */
typedef struct pbs_coarsen_block {
    _Alignas(64) uint32_t same[PBS_COARSEN_ROOM]; /* all ones: the parent of the last one */
    uint32_t place[PBS_COARSEN_ROOM];             /* the parent's, with this one's faces */
    uint32_t group[PBS_COARSEN_ROOM];             /* which parent */
    uint32_t end[PBS_COARSEN_ROOM];               /* of a parent: behind its last child */
    uint32_t channels;
    uint32_t add;       /* where the chunk of the children lies in that of the parents */
    float weight_scale; /* of a sum of finest weights in squares of the parents' side */
    const pbs_srgb_table *srgb;
} pbs_coarsen_block;

/* While faces are gathered, the highest bit says that not all children are two-sided. */
#define SOME_TWO  0x40000000u
#define SOME_ONE  0x80000000u
#define PARENT    0x7f7f7fu
#define OCTANT    0x010101u
#define NOT_FINE  0xfefefeu
#define FACE_BITS 0x7f000000u

LANE f4 mask4(f4 v, u4 mask) {
    return (f4)((u4)v & mask);
}
LANE f4 all4(float v) {
    return (f4){v, v, v, v};
}
LANE u4 all4u(uint32_t v) {
    return (u4){v, v, v, v};
}
LANE f4 pick4(u4 which, f4 then, f4 other) {
    return (f4)((which & (u4)then) | (~which & (u4)other));
}
LANE const u4_at *at_u(const uint32_t *p) {
    return (const u4_at *)(uintptr_t)p;
}
LANE const f4_at *at_f(const float *p) {
    return (const f4_at *)(uintptr_t)p;
}
LANE u4_at *to_u(uint32_t *p) {
    return (u4_at *)(uintptr_t)p;
}
LANE f4_at *to_f(float *p) {
    return (f4_at *)(uintptr_t)p;
}

/* Fills same and place. False if children of a parent are not in Morton order. */
LANE bool find_parents(pbs_coarsen_block *b, const uint32_t *place, size_t n) {
    uint32_t wrong = 0;
    u4 bad = all4u(0);
    size_t i = 0;
    for (; i < 1 || (i < n && i % 4); i++) {
        uint32_t p = place[i], last = i ? place[i - 1] : ~p;
        b->same[i] = (p ^ last) & NOT_FINE ? 0 : ~0u;
        wrong |= b->same[i] & ((p & OCTANT) <= (last & OCTANT));
        b->place[i] = ((p >> 1 & PARENT) | b->add | (p & FACE_BITS)) | (~p & SOME_TWO) << 1;
    }
    for (; i + 4 <= n; i += 4) {
        u4 p = *at_u(place + i), last = *at_u(place + i - 1);
        u4 same = (u4)(((p ^ last) & NOT_FINE) == 0);
        bad |= same & (u4)((i4)(p & OCTANT) <= (i4)(last & OCTANT));
        *(u4 *)(b->same + i) = same;
        *(u4 *)(b->place + i) = ((p >> 1 & PARENT) | b->add | (p & FACE_BITS)) | (~p & SOME_TWO)
                                                                                     << 1;
    }
    for (; i < n; i++) {
        uint32_t p = place[i], last = place[i - 1];
        b->same[i] = (p ^ last) & NOT_FINE ? 0 : ~0u;
        wrong |= b->same[i] & ((p & OCTANT) <= (last & OCTANT));
        b->place[i] = ((p >> 1 & PARENT) | b->add | (p & FACE_BITS)) | (~p & SOME_TWO) << 1;
    }
    return !(wrong | bad[0] | bad[1] | bad[2] | bad[3]);
}

/* x * 511, y * 511, z * 511, 1 of a packed normal. The fields are converted where they lie, which
 * is exact; with the sign's bit turned over they are 512 too large. */
LANE f4 normal4(uint32_t packed) {
    u4 u = (all4u(packed ^ 0x20080200u)) & (u4){1023, 1023u << 10, 1023u << 20, 0};
    f4 v = __builtin_convertvector((i4)u, f4) * (f4){1, 0x1p-10f, 0x1p-20f, 0};
    return v - (f4){512, 512, 512, -1};
}

/* The first sum and the places, in one walk. */
LANE size_t sum_base(pbs_coarsen_block *b, const pbs_cell_rows *in, size_t n, pbs_cell_rows *out,
                     bool leaf, bool normals, bool weights, bool groups) {
    uint32_t *place = out->v.place + out->n, *end = b->end, faces = 0;
    f4 *sum = out->sum[PBS_SUM_BASE] + out->n, acc = all4(0);
    int32_t g = -1;
    for (size_t i = 0; i < n; i++) {
        uint32_t same = b->same[i];
        f4 v = leaf ? (f4){0, 0, 0, 1} : in->sum[PBS_SUM_BASE][i];
        if (leaf && normals) v = normal4(in->v.normal[i]);
        if (leaf && weights) v = v * all4(in->v.weight[i]);
        acc = mask4(acc, all4u(same)) + v;
        faces = (faces & same) | b->place[i];
        g += 1 + (int32_t)same;
        sum[g] = acc;
        place[g] = faces;
        end[g] = (uint32_t)i + 1;
        if (groups) b->group[i] = (uint32_t)g;
    }
    return (size_t)(g + 1);
}

LANE size_t sum_places(pbs_coarsen_block *b, size_t n, pbs_cell_rows *out) {
    uint32_t *place = out->v.place + out->n, faces = 0;
    int32_t g = -1;
    for (size_t i = 0; i < n; i++) {
        faces = (faces & b->same[i]) | b->place[i];
        g += 1 + (int32_t)b->same[i];
        place[g] = faces;
    }
    return (size_t)(g + 1);
}

/* Four bytes: three sRGB and one linear, or all linear. */
LANE f4 colour4(const pbs_srgb_table *t, uint32_t c, bool linear) {
    const float *rgb = linear ? t->unorm : t->linear;
    return (f4){rgb[c & 255], rgb[c >> 8 & 255], rgb[c >> 16 & 255], t->unorm[c >> 24]};
}

LANE void sum_channel(const pbs_coarsen_block *b, const uint32_t *colour, const float *weight,
                      const f4 *in, size_t n, f4 *sum, bool linear) {
    f4 acc = all4(0);
    for (size_t i = 0; i < n; i++) {
        f4 v = in ? in[i] : colour4(b->srgb, colour[i], linear);
        if (!in && weight) v = v * all4(weight[i]);
        acc = mask4(acc, all4u(b->same[i])) + v;
        sum[b->group[i]] = acc;
    }
}

/* ---- parents ---- */

/* Faces on the border of the chunk: a byte that is 0 or 255. */
LANE u4 caps4(u4 place) {
    u4 low = (u4)((i4)((place & 0x0000ff) == 0)) & ((uint32_t)PBS_FACE_X0 << 24);
    low |= (u4)((i4)((place & 0x00ff00) == 0)) & ((uint32_t)PBS_FACE_Y0 << 24);
    low |= (u4)((i4)((place & 0xff0000) == 0)) & ((uint32_t)PBS_FACE_Z0 << 24);
    low |= (u4)((i4)((place & 0x0000ff) == 0x0000ff)) & ((uint32_t)PBS_FACE_X1 << 24);
    low |= (u4)((i4)((place & 0x00ff00) == 0x00ff00)) & ((uint32_t)PBS_FACE_Y1 << 24);
    low |= (u4)((i4)((place & 0xff0000) == 0xff0000)) & ((uint32_t)PBS_FACE_Z1 << 24);
    return low;
}

/* Lengths of what unit normals are packed to, * 511; squares. Means of such length are not made
 * unit, so that a normal that all children have stays as it is. */
#define UNIT_LOW  (510.1f * 510.1f)
#define UNIT_HIGH (511.9f * 511.9f)
#define THIN      ((float)(PBS_COARSEN_THIN * 511) * (float)(PBS_COARSEN_THIN * 511))
/* Sums whose squares neither overflow nor vanish. */
#define PLAIN_LOW  0x1p-50f
#define PLAIN_HIGH 0x1p50f

LANE size_t first_child(const pbs_coarsen_block *b, size_t g) {
    return g ? b->end[g - 1] : 0;
}
LANE float weight_of(const pbs_cell_rows *in, size_t i) {
    return in->sum[PBS_SUM_BASE] ? in->sum[PBS_SUM_BASE][i][3] : in->v.weight ? in->v.weight[i] : 1;
}
static size_t heaviest(const pbs_coarsen_block *b, const pbs_cell_rows *in, size_t g) {
    size_t best = first_child(b, g);
    float most = weight_of(in, best);
    for (size_t i = best + 1; i < b->end[g]; i++)
        if (weight_of(in, i) > most) best = i, most = weight_of(in, i);
    return best;
}

static uint32_t rounded10(double v) {
    return (uint32_t)(int)(v < 0 ? v - 0.5 : v + 0.5) & 1023;
}

/* A parent whose mean is short, whose weight is no plain number, or some of whose children are
 * two-sided. */
__attribute__((noinline)) static void
finish_one(const pbs_coarsen_block *b, const pbs_cell_rows *in, pbs_cell_rows *out, size_t g) {
    size_t child = heaviest(b, in, g), at = out->n + g;
    f4 s = out->sum[PBS_SUM_BASE][at];
    double x = s[0], y = s[1], z = s[2], w = s[3], l2 = x * x + y * y + z * z;
    bool thin = !(l2 >= (double)THIN * w * w) || !(w > 0) || !(l2 < INFINITY);
    bool two = thin || in->v.place[child] & SOME_TWO;
    out->v.place[at] = (out->v.place[at] & ~SOME_TWO) | (two ? SOME_TWO : 0);
    if (thin)
        out->v.normal[at] = in->v.normal[child];
    else if (!(w >= PLAIN_LOW && w <= PLAIN_HIGH)) {
        double k = 511 / sqrt(l2);
        out->v.normal[at] = rounded10(x * k) | rounded10(y * k) << 10 | rounded10(z * k) << 20;
    }
}

/* The lowest bits of what is added to 1.5 * 2^23 are those of the nearest whole number. */
LANE u4 round10(f4 v) {
    return (u4)(v + 0x1.8p23f) & 1023;
}

LANE void finish_normals(const pbs_coarsen_block *b, const pbs_cell_rows *in, pbs_cell_rows *out,
                         size_t n) {
    const f4 *sum = out->sum[PBS_SUM_BASE] + out->n;
    uint32_t *place = out->v.place + out->n, *normal = out->v.normal + out->n;
    for (size_t g = 0; g < n; g += 4) {
        f4 a = sum[g], c = sum[g + 1], d = sum[g + 2], e = sum[g + 3];
        f4 ac = __builtin_shuffle(a, c, (i4){0, 4, 1, 5}),
           de = __builtin_shuffle(d, e, (i4){0, 4, 1, 5});
        f4 ac2 = __builtin_shuffle(a, c, (i4){2, 6, 3, 7});
        f4 de2 = __builtin_shuffle(d, e, (i4){2, 6, 3, 7});
        f4 x = __builtin_shuffle(ac, de, (i4){0, 1, 4, 5});
        f4 y = __builtin_shuffle(ac, de, (i4){2, 3, 6, 7});
        f4 z = __builtin_shuffle(ac2, de2, (i4){0, 1, 4, 5});
        f4 w = __builtin_shuffle(ac2, de2, (i4){2, 3, 6, 7});
        f4 l2 = x * x + y * y + z * z, w2 = w * w;
        u4 unit = (u4)(l2 >= w2 * UNIT_LOW) & (u4)(l2 <= w2 * UNIT_HIGH);
        f4 k = pick4(unit, all4(1), all4(511)) / pick4(unit, w, sqrt4f(l2));
        *to_u(normal + g) = round10(x * k) | round10(y * k) << 10 | round10(z * k) << 20;
        u4 p = *at_u(place + g);
        u4 plain = (u4)(l2 >= w2 * THIN) & (u4)(w >= PLAIN_LOW) & (u4)(w <= PLAIN_HIGH);
        u4 mixed = (u4)((i4)p < 0) & (p << 1);
        u4 slow = ~plain | (u4)((i4)mixed < 0);
        *to_u(place + g) = (p | caps4(p)) & ~SOME_ONE;
        if (!(slow[0] | slow[1] | slow[2] | slow[3])) continue;
        for (size_t i = 0; i < 4 && g + i < n; i++)
            if (slow[i]) finish_one(b, in, out, g + i);
    }
}

LANE void finish_places(pbs_cell_rows *out, size_t n) {
    uint32_t *place = out->v.place + out->n;
    for (size_t g = 0; g < n; g += 4) {
        u4 p = *at_u(place + g);
        *to_u(place + g) = (p | caps4(p)) & ~SOME_ONE;
    }
}

/* What overflows stays a number. */
LANE void finish_weights(const pbs_coarsen_block *b, pbs_cell_rows *out, size_t n) {
    const f4 *sum = out->sum[PBS_SUM_BASE] + out->n;
    for (size_t g = 0; g < n; g++) {
        float w = sum[g][3] * b->weight_scale;
        out->v.weight[out->n + g] = w < FLT_MAX ? w : FLT_MAX;
    }
}

LANE uint32_t encode4(const pbs_srgb_table *t, f4 v, bool linear) {
    if (linear) {
        uint32_t c = pbs_unorm8(v[0]);
        return c | (uint32_t)pbs_unorm8(v[1]) << 8 | (uint32_t)pbs_unorm8(v[2]) << 16 |
               (uint32_t)pbs_unorm8(v[3]) << 24;
    }
    return (uint32_t)pbs_srgb_encode(t, v[0]) | (uint32_t)pbs_srgb_encode(t, v[1]) << 8 |
           (uint32_t)pbs_srgb_encode(t, v[2]) << 16 | (uint32_t)pbs_unorm8(v[3]) << 24;
}

LANE void finish_channel(const pbs_coarsen_block *b, const pbs_cell_rows *in,
                         const uint32_t *children, pbs_cell_rows *out, const f4 *sum,
                         uint32_t *colour, size_t n, bool linear) {
    const f4 *base = out->sum[PBS_SUM_BASE] + out->n;
    for (size_t g = 0; g < n; g++) {
        float w = base[g][3];
        if (w >= PLAIN_LOW && w <= PLAIN_HIGH)
            colour[g] = encode4(b->srgb, sum[g] / all4(w), linear);
        else
            colour[g] = children[heaviest(b, in, g)];
    }
}

LANE void one_channel(pbs_coarsen_block *b, const pbs_cell_rows *in, const uint32_t *children,
                      size_t n, pbs_cell_rows *out, int which, uint32_t *colour, size_t parents,
                      bool linear) {
    f4 *sum = out->sum[which] + out->n;
    sum_channel(b, children, in->v.weight, in->sum[which], n, sum, linear);
    finish_channel(b, in, children, out, sum, colour + out->n, parents, linear);
}

/* Parents of n children behind those that out has; all children of each are there. Gives their
 * number, or SIZE_MAX if children are not in Morton order. */
LANE size_t coarsen_step(pbs_coarsen_block *b, const pbs_cell_rows *in, size_t n,
                         pbs_cell_rows *out) {
    uint32_t ch = b->channels;
    bool leaf = !in->sum[PBS_SUM_BASE], normals = ch & PBS_NORMAL, weights = in->v.weight;
    bool groups = ch & (PBS_COLOUR | PBS_MATERIAL | PBS_EMISSIVE);
    size_t m;
    if (!find_parents(b, in->v.place, n)) return SIZE_MAX;
    if (!out->sum[PBS_SUM_BASE]) {
        m = sum_places(b, n, out);
        finish_places(out, m);
        return m;
    }
    if (!leaf)
        m = groups ? sum_base(b, in, n, out, false, false, false, true)
                   : sum_base(b, in, n, out, false, false, false, false);
    else if (normals && weights)
        m = groups ? sum_base(b, in, n, out, true, true, true, true)
                   : sum_base(b, in, n, out, true, true, true, false);
    else
        m = sum_base(b, in, n, out, true, normals, weights, true);
    if (ch & PBS_NORMAL)
        finish_normals(b, in, out, m);
    else
        finish_places(out, m);
    if (ch & PBS_WEIGHT) finish_weights(b, out, m);
    if (ch & PBS_COLOUR)
        one_channel(b, in, in->v.colour, n, out, PBS_SUM_COLOUR, out->v.colour, m, false);
    if (ch & PBS_MATERIAL)
        one_channel(b, in, in->v.material, n, out, PBS_SUM_MATERIAL, out->v.material, m, true);
    if (ch & PBS_EMISSIVE)
        one_channel(b, in, in->v.emissive, n, out, PBS_SUM_EMISSIVE, out->v.emissive, m, false);
    return m;
}

size_t pbs_coarsen_step_avx2(pbs_coarsen_block *b, const pbs_cell_rows *in, size_t n,
                             pbs_cell_rows *out);
/* ---- lists of faces (coarsen_faces.c) ---- */

/* Those of parents that were just made behind the ones that out has. False if a child's list is not
 * in the list of all. */
bool pbs_coarsen_faces(const pbs_coarsen_block *b, const pbs_cell_rows *in, size_t parents,
                       pbs_cell_rows *out);
/* The last n rows come from elsewhere, with `faces`: copies their lists. False as above. */
bool pbs_coarsen_keep_lists(pbs_cell_rows *r, size_t n, const uint32_t *faces, size_t face_count);
/* Rows `first` on are given out: *faces is their list, which their v.face points into from now on;
 * gives its length. */
size_t pbs_coarsen_lists(pbs_cell_rows *r, size_t first, size_t n, const uint32_t **faces);
/* The lists of the first n rows go. */
void pbs_coarsen_drop_lists(pbs_cell_rows *r, size_t n);
#endif
