/* candidates.h: the candidates of one node, sorted along a space-filling curve.
 *
 * What the greedy permutation works on. 32 neighbours are a leaf, 8 leaves are a fan, 8 fans are
 * a fan of the next level, and so on up to one root: an implicit tree without pointers, whose
 * inner loops are eight boxes or eight points at a time.
 *
 * d of a point is the square of its distance to the nearest surfel so far; infinite at first.
 * A point that has become a surfel holds the negative of the value it was chosen with: no
 * distance is below that, so it is never touched again, and the result can be read off the tree.
 *
 * Everything is scaled by a power of two that brings the longest side of the box to 2^52 .. 2^53:
 * exact, and neither squares nor their quotients can overflow or underflow for any input in float.
 */
#ifndef PBS_CANDIDATES_H
#define PBS_CANDIDATES_H

#include "libcore/data/record.h"
#include "libcore/ground/run.h"
#include <math.h>

enum {
    PBS_LEAF = 32,
    PBS_FAN = 8,
    PBS_FAN_POINTS = PBS_LEAF * PBS_FAN,
    PBS_LEVELS = 10,
    PBS_TREE_DIGITS = 1 << 12, /* half a key of the sort */
    PBS_TREE_PART = 1 << 15    /* candidates that are worth a thread */
};

/* Below this cos^2 of half the angle (179.1 degrees) two normals count as opposite and their
 * points as infinitely far from each other, coincident or not: the two sides of a wall. */
#define PBS_OPPOSITE 0x1p-14f

typedef struct pbs_metric {
    float up, up2;     /* scaled = in * up * up2; two factors, since 2^201 is no float */
    float base, slope; /* D^2 = |p-q|^2 / min(1, base + slope * n.n') */
    bool normals;
    double length;          /* in the caller's unit = scaled / length */
    double diagonal;        /* of the box, in the caller's unit */
    double low[3], high[3]; /* the box, scaled */
} pbs_metric;

/* A candidate by itself: scaled position, normal times 32767. */
typedef struct pbs_place {
    float p[3];
    int16_t n[4]; /* the last is 0 */
} pbs_place;

/* D^2, the one definition: what is vectorised elsewhere does the same operations in the same
 * order. Symmetric in every bit, and never below the square of the Euclidean distance. */
static inline float pbs_metric_d2(const pbs_metric *m, const pbs_place *a, const pbs_place *b) {
    float x = a->p[0] - b->p[0], y = a->p[1] - b->p[1], z = a->p[2] - b->p[2];
    float d2 = x * x + y * y + z * z;
    if (!m->normals) return d2;
    int32_t dot = a->n[0] * b->n[0] + a->n[1] * b->n[1] + a->n[2] * b->n[2];
    float below = m->base + m->slope * (float)dot;
    below = below < 1 ? below : 1;
    return below > PBS_OPPOSITE ? d2 / below : INFINITY;
}

/* A squared distance as the caller wants it: in his unit, never above the diagonal. */
static inline float pbs_metric_length(const pbs_metric *m, float d2) {
    double d = sqrt((double)d2) / m->length;
    if (!(d < m->diagonal)) d = m->diagonal;
    return d < 3.4028234e38 ? (float)d : 3.4028234e38f;
}

/* Of the squared distances that are lengths of at most `length`, one that is hardly smaller than
 * the largest; 0: there is none. */
static inline float pbs_metric_within(const pbs_metric *m, double length) {
    double d = length * m->length * (1 - 0x1p-20);
    d *= d;
    return !(d > 0x1p-126) ? 0 : d < 3.4e38 ? (float)d : 3.4e38f;
}

typedef struct pbs_leaf {
    float x[PBS_LEAF], y[PBS_LEAF], z[PBS_LEAF], d[PBS_LEAF];
} pbs_leaf;
typedef struct pbs_leaf_normals {
    int16_t xy[PBS_LEAF][2], z0[PBS_LEAF][2]; /* pairs, as the multiply-and-add wants them */
} pbs_leaf_normals;

/* Eight boxes, and the largest d in each (0: nothing left in it; a missing child is empty). */
typedef struct pbs_fan {
    float low[3][PBS_FAN], high[3][PBS_FAN], max[PBS_FAN];
} pbs_fan;

/* Points of a leaf beyond `points` repeat the last one with d = 0. */
typedef struct pbs_tree {
    pbs_metric metric;
    size_t points, leaves, invalid;
    pbs_leaf *leaf;
    pbs_leaf_normals *normal; /* NULL: Euclid */
    uint32_t *id;             /* of slot leaf * 32 + lane: the caller's index */
    uint32_t *digits;         /* scratch of the sort */
    int levels;               /* fan[levels - 1] is the root */
    float enough; /* d up to which candidates count as covered: they do not become surfels */
    size_t fans[PBS_LEVELS];
    pbs_fan
        *fan[PBS_LEVELS]; /* child c of fan[0][i] is leaf 8i + c, of fan[k][i] fan[k-1][8i + c] */
} pbs_tree;

/* Where a function's scratch lies in one block. The first walk, with base NULL, adds up what is
 * needed; the second hands it out. */
typedef struct pbs_layout {
    char *base;
    size_t used;
} pbs_layout;

static inline void *pbs_layout_take(pbs_layout *l, size_t bytes) {
    size_t at = l->used;
    l->used += (bytes + 63) / 64 * 64;
    return l->base ? l->base + at : NULL;
}

enum { PBS_ALLOC_HEAD = 64 }; /* what pbs_alloc adds to a layout's bytes */

/* Slots of a tree of so many points: its leaves are whole. */
static inline size_t pbs_tree_slots(size_t points) {
    return (points + PBS_LEAF - 1) / PBS_LEAF * PBS_LEAF;
}

/* Looks at every coordinate: sets the metric's scale and box and *invalid. weight 0: Euclid. */
pbs_code pbs_metric_set(pbs_run *run, pbs_metric *m, const pbs_points *in, float weight,
                        size_t *invalid, pbs_err *err);
/* Sets the arrays' places for up to `candidates` points. */
void pbs_tree_layout(pbs_tree *t, size_t candidates, pbs_layout *layout);
/* Sorts and fills; pbs_tree_layout and pbs_metric_set (into t->metric, t->invalid) came before. */
pbs_code pbs_tree_build(pbs_run *run, pbs_tree *t, const pbs_points *in, pbs_err *err);
pbs_code pbs_tree_build_avx2(pbs_run *run, pbs_tree *t, const pbs_points *in, pbs_err *err);

/* Functions whose name ends in _avx2 are the ones without it, compiled for that. */
bool pbs_cpu_has_avx2(void);

/* Work is cut into one part per thread, of at least `least` things, and at most PBS_PARTS: parts
 * never change a result, only the time. Scratch is planned for the most that there can be. */
enum { PBS_PARTS = 16 };
int pbs_parts_most(size_t things, size_t least);
int pbs_parts(const pbs_run *run, size_t things, size_t least);
static inline size_t pbs_part_begin(size_t n, int parts, size_t i) {
    return i < (size_t)parts ? n / (size_t)parts * i : n;
}
static inline size_t pbs_part_end(size_t n, int parts, size_t i) {
    return pbs_part_begin(n, parts, i + 1);
}

void pbs_place_normal(int16_t out[4], const int16_t oct[2]);

/* Scales a position; false if a coordinate is not finite. */
static inline bool pbs_scaled(const pbs_metric *m, const float in[3], float out[3]) {
    for (int k = 0; k < 3; k++) out[k] = in[k] * m->up * m->up2;
    return isfinite(out[0]) && isfinite(out[1]) && isfinite(out[2]);
}

/* False if candidate i has a coordinate that is not finite. */
static inline bool pbs_place_of(const pbs_metric *m, const pbs_points *in, size_t i,
                                pbs_place *out) {
    if (!pbs_scaled(m, in->position + 3 * i, out->p)) return false;
    out->n[0] = out->n[1] = out->n[2] = out->n[3] = 0;
    if (m->normals) pbs_place_normal(out->n, in->normal + 2 * i);
    return true;
}
#endif
