/* Ear clipping with exact predicates; see polygon.h.
 *
 * An ear is a corner whose triangle with its two neighbours has no other corner in it. Only
 * corners that are not convex can be in the way, so only they are searched, through a tree of
 * boxes. Whether a corner is an ear changes only when a neighbour goes, so a queue of corners to
 * look at is enough: about 3 n tests for a simple polygon.
 */
#include "libcore/data/polygon.h"
#include <math.h>

#define LEAF 8
#define NONE UINT32_MAX

typedef __int128 wide;

/* What a corner looks like from inside. PINCHED: it coincides with a neighbour, or the outline
 * turns back on itself there; cutting it off costs no area. All but CONVEX and GONE block. */
enum { CONVEX, REFLEX, FLAT, PINCHED, GONE };

typedef struct box {
    int64_t min[2], max[2];
} box;

typedef struct clip {
    uint32_t n, left;
    int64_t (*p)[2];
    box *tree;
    uint32_t *next, *prev;
    uint32_t *queue, queue_head, queued;
    uint32_t *blocker, blockers;
    uint8_t *state, *in_queue;
    uint32_t *out;
    uint64_t rescue_work;
    bool clean;
} clip;

static size_t tree_nodes(uint32_t n) {
    size_t nodes = 1;
    for (uint64_t leaf = LEAF; leaf < n; leaf *= 2) nodes = 2 * nodes + 1;
    return nodes;
}

size_t pbs_polygon_scratch(uint32_t n) {
    if (n < 5) return 0;
    return sizeof(box) * tree_nodes(n) +
           (size_t)n * (sizeof(int64_t[2]) + 4 * sizeof(uint32_t) + 2);
}

static void lay_out(clip *c, uint32_t n, uint32_t *triangle, void *scratch) {
    *c = (clip){.n = n, .left = n, .out = triangle, .clean = true};
    c->tree = scratch;
    c->p = (void *)(c->tree + tree_nodes(n));
    c->next = (uint32_t *)(c->p + n);
    c->prev = c->next + n;
    c->queue = c->prev + n;
    c->blocker = c->queue + n;
    c->state = (uint8_t *)(c->blocker + n);
    c->in_queue = c->state + n;
}

/* Twice the signed area of a, b, q: positive if q is left of a to b. Exact: the coordinates have
 * 53 bits. */
static wide orient(const int64_t a[2], const int64_t b[2], const int64_t q[2]) {
    return (wide)(b[0] - a[0]) * (q[1] - a[1]) - (wide)(b[1] - a[1]) * (q[0] - a[0]);
}

static bool same(const int64_t a[2], const int64_t b[2]) {
    return a[0] == b[0] && a[1] == b[1];
}

static uint8_t look(const clip *c, uint32_t i) {
    const int64_t *a = c->p[c->prev[i]], *b = c->p[i], *d = c->p[c->next[i]];
    if (same(a, b) || same(b, d)) return PINCHED;
    wide turn = orient(a, b, d);
    if (turn) return turn > 0 ? CONVEX : REFLEX;
    wide ahead = (wide)(b[0] - a[0]) * (d[0] - b[0]) + (wide)(b[1] - a[1]) * (d[1] - b[1]);
    return ahead > 0 ? FLAT : PINCHED;
}

static void push(clip *c, uint32_t i) {
    if (c->in_queue[i]) return;
    c->in_queue[i] = 1;
    uint64_t at = (uint64_t)c->queue_head + c->queued++;
    c->queue[at < c->n ? at : at - c->n] = i;
}

static uint32_t pop(clip *c) {
    if (!c->queued) return NONE;
    uint32_t i = c->queue[c->queue_head];
    c->queue_head = c->queue_head + 1 < c->n ? c->queue_head + 1 : 0;
    c->queued--;
    c->in_queue[i] = 0;
    return i;
}

/* Puts the element that belongs at mid there, smaller ones before and larger ones behind it. */
static void select_middle(const clip *c, uint32_t lo, uint32_t hi, uint32_t mid, int axis) {
    uint32_t *v = c->blocker;
    while (hi - lo > 1) {
        int64_t pivot = c->p[v[lo + (hi - lo) / 2]][axis];
        uint32_t i = lo, j = hi - 1;
        for (;;) {
            while (c->p[v[i]][axis] < pivot) i++;
            while (c->p[v[j]][axis] > pivot) j--;
            if (i >= j) break;
            uint32_t t = v[i];
            v[i++] = v[j], v[j--] = t;
        }
        uint32_t cut = i > j ? i : i + 1;
        if (cut == hi) cut--;
        if (mid < cut)
            hi = cut;
        else
            lo = cut;
    }
}

/* A node covers blocker[lo .. hi - 1]; its children are 2 node + 1 and 2 node + 2. */
static void build(clip *c, size_t node, uint32_t lo, uint32_t hi) {
    box b = {{INT64_MAX, INT64_MAX}, {INT64_MIN, INT64_MIN}};
    for (uint32_t i = lo; i < hi; i++)
        for (int k = 0; k < 2; k++) {
            int64_t v = c->p[c->blocker[i]][k];
            b.min[k] = v < b.min[k] ? v : b.min[k];
            b.max[k] = v > b.max[k] ? v : b.max[k];
        }
    c->tree[node] = b;
    if (hi - lo <= LEAF) return;
    uint32_t mid = lo + (hi - lo) / 2;
    select_middle(c, lo, hi, mid, b.max[1] - b.min[1] > b.max[0] - b.min[0]);
    build(c, 2 * node + 1, lo, mid);
    build(c, 2 * node + 2, mid, hi);
}

/* The triangle of a corner and its neighbours, and whether touching it counts as being in it. */
typedef struct ear {
    const int64_t *p[3];
    box bounds;
    bool closed;
} ear;

static bool outside(const ear *e, const box *b) {
    for (int k = 0; k < 2; k++)
        if (b->max[k] < e->bounds.min[k] || b->min[k] > e->bounds.max[k]) return true;
    for (int s = 0; s < 3; s++) {
        const int64_t *p = e->p[s], *q = e->p[s == 2 ? 0 : s + 1];
        /* the corner of the box that is farthest to the left */
        int64_t far[2] = {q[1] > p[1] ? b->min[0] : b->max[0], q[0] > p[0] ? b->max[1] : b->min[1]};
        if (orient(p, q, far) < 0) return true;
    }
    return false;
}

static bool inside(const ear *e, const int64_t q[2]) {
    if (same(q, e->p[0]) || same(q, e->p[1]) || same(q, e->p[2])) return false;
    for (int s = 0; s < 3; s++) {
        wide side = orient(e->p[s], e->p[s == 2 ? 0 : s + 1], q);
        if (side < 0 || (side == 0 && !e->closed)) return false;
    }
    return true;
}

static bool blocked(const clip *c, const ear *e, size_t node, uint32_t lo, uint32_t hi) {
    if (outside(e, &c->tree[node])) return false;
    if (hi - lo > LEAF) {
        uint32_t mid = lo + (hi - lo) / 2;
        return blocked(c, e, 2 * node + 1, lo, mid) || blocked(c, e, 2 * node + 2, mid, hi);
    }
    for (uint32_t i = lo; i < hi; i++) {
        uint32_t q = c->blocker[i];
        if (c->state[q] != CONVEX && c->state[q] != GONE && inside(e, c->p[q])) return true;
    }
    return false;
}

static bool is_ear(const clip *c, uint32_t i, bool closed) {
    if (c->state[i] != CONVEX) return false;
    ear e = {{c->p[c->prev[i]], c->p[i], c->p[c->next[i]]}, {{0, 0}, {0, 0}}, closed};
    for (int k = 0; k < 2; k++) {
        e.bounds.min[k] = e.bounds.max[k] = e.p[0][k];
        for (int s = 1; s < 3; s++) {
            e.bounds.min[k] = e.p[s][k] < e.bounds.min[k] ? e.p[s][k] : e.bounds.min[k];
            e.bounds.max[k] = e.p[s][k] > e.bounds.max[k] ? e.p[s][k] : e.bounds.max[k];
        }
    }
    return !c->blockers || !blocked(c, &e, 0, 0, c->blockers);
}

static void emit(clip *c, uint32_t a, uint32_t b, uint32_t d) {
    c->out[0] = a, c->out[1] = b, c->out[2] = d;
    c->out += 3;
}

static void cut_off(clip *c, uint32_t i) {
    uint32_t a = c->prev[i], d = c->next[i];
    emit(c, a, i, d);
    c->next[a] = d, c->prev[d] = a;
    c->state[i] = GONE;
    c->left--;
    c->state[a] = look(c, a), c->state[d] = look(c, d);
    push(c, a), push(c, d);
}

/* No ear is known. In a simple polygon that only happens when what was in the way has gone since;
 * in others an ear that is merely touched, or any convex corner, has to do. The work spent here is
 * bounded: an outline of 100,000 corners that crosses itself everywhere must not take for ever. */
static uint32_t rescue(clip *c, uint32_t from) {
    if (c->rescue_work > 8 * (uint64_t)c->n + 200000) return NONE;
    for (int how = 0; how < 3; how++) {
        uint32_t i = from;
        for (uint32_t k = 0; k < c->left; k++, i = c->next[i]) {
            c->rescue_work++;
            if (how == 2 ? c->state[i] == CONVEX : is_ear(c, i, how == 0)) {
                c->clean &= how < 2;
                return i;
            }
        }
    }
    return NONE;
}

static void cut_all(clip *c) {
    uint32_t live = 0;
    while (c->left > 3) {
        uint32_t i = pop(c);
        if (i == NONE) {
            i = rescue(c, live);
            if (i == NONE) break;
        } else if (c->state[i] != PINCHED && !is_ear(c, i, true)) {
            continue;
        }
        live = c->next[i];
        cut_off(c, i);
    }
    uint32_t last = c->next[live];
    c->clean &= c->left == 3 && orient(c->p[live], c->p[last], c->p[c->next[last]]) >= 0;
    for (uint32_t i = c->next[live]; c->left > 2; c->left--, i = c->next[i])
        emit(c, live, i, c->next[i]);
}

static bool fan(uint32_t n, uint32_t *triangle) {
    for (uint32_t i = 0; i + 2 < n; i++)
        triangle[3 * i] = 0, triangle[3 * i + 1] = i + 1, triangle[3 * i + 2] = i + 2;
    return false;
}

static double dot_cross(const double n[3], const double *a, const double *b, const double *c) {
    double u[3], v[3];
    for (int k = 0; k < 3; k++) u[k] = b[k] - a[k], v[k] = c[k] - a[k];
    return n[0] * (u[1] * v[2] - u[2] * v[1]) + n[1] * (u[2] * v[0] - u[0] * v[2]) +
           n[2] * (u[0] * v[1] - u[1] * v[0]);
}

/* Four corners are by far the most frequent case: the diagonal 0-2, unless a corner is concave or
 * flat so that only 1-3 gives two proper triangles. */
static bool cut_quad(const double *xyz, size_t stride, uint32_t *triangle) {
    const double *p[4] = {xyz, xyz + stride, xyz + 2 * stride, xyz + 3 * stride};
    double u[3], v[3];
    for (int k = 0; k < 3; k++) u[k] = p[2][k] - p[0][k], v[k] = p[3][k] - p[1][k];
    double n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
    double a = dot_cross(n, p[0], p[1], p[2]), b = dot_cross(n, p[0], p[2], p[3]);
    double c = dot_cross(n, p[1], p[2], p[3]), d = dot_cross(n, p[1], p[3], p[0]);
    double straight = a < b ? a : b, other = c < d ? c : d;
    bool turn = straight <= 1e-12 * (a + b) && other > straight;
    static const uint32_t cuts[2][6] = {{0, 1, 2, 0, 2, 3}, {1, 2, 3, 1, 3, 0}};
    for (int k = 0; k < 6; k++) triangle[k] = cuts[turn][k];
    return a + b > 0 && (turn ? other : straight) >= 0;
}

/* Sets the polygon's box; false if a corner is not finite. */
static bool measure(const double *xyz, size_t stride, uint32_t n, double min[3], double max[3]) {
    for (int k = 0; k < 3; k++) min[k] = INFINITY, max[k] = -INFINITY;
    double sum = 0;
    for (uint32_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) {
            double v = xyz[i * stride + k];
            min[k] = v < min[k] ? v : min[k];
            max[k] = v > max[k] ? v : max[k];
            sum += v * 0; /* NaN from here on if v is not finite */
        }
    return sum == 0;
}

/* Newell's normal of the corners, scaled to about 1 so that no product overflows. */
static void newell(const double *xyz, size_t stride, uint32_t n, const double min[3], double scale,
                   double normal[3]) {
    double a[3], b[3];
    normal[0] = normal[1] = normal[2] = 0;
    for (int k = 0; k < 3; k++) a[k] = (xyz[(n - 1) * stride + k] * 0.5 - min[k] * 0.5) * scale;
    for (uint32_t i = 0; i < n; i++) {
        for (int k = 0; k < 3; k++) b[k] = (xyz[i * stride + k] * 0.5 - min[k] * 0.5) * scale;
        for (int k = 0; k < 3; k++) {
            int u = k == 2 ? 0 : k + 1, v = k == 0 ? 2 : k - 1;
            normal[k] += (a[u] - b[u]) * (a[v] + b[v]);
        }
        for (int k = 0; k < 3; k++) a[k] = b[k];
    }
}

/* Projects along the axis nearest to the normal, not along the normal itself: that rounds nothing,
 * so corners on a line stay on it. Coordinates become integers in 0 .. 2^52. */
static bool snap(clip *c, const double *xyz, size_t stride) {
    double min[3], max[3], normal[3], size = 0;
    if (!measure(xyz, stride, c->n, min, max)) return false;
    for (int k = 0; k < 3; k++) size = fmax(size, max[k] * 0.5 - min[k] * 0.5);
    int e;
    frexp(size, &e);
    double scale = ldexp(1, e > -900 ? -e : 900);
    newell(xyz, stride, c->n, min, scale, normal);
    int axis = 0;
    for (int k = 1; k < 3; k++)
        if (fabs(normal[k]) > fabs(normal[axis])) axis = k;
    if (normal[axis] == 0) return false;
    int u = (axis + 1) % 3, v = (axis + 2) % 3;
    if (normal[axis] < 0) u = (axis + 2) % 3, v = (axis + 1) % 3;
    for (uint32_t i = 0; i < c->n; i++) {
        const double *p = xyz + i * stride;
        c->p[i][0] = (int64_t)((p[u] * 0.5 - min[u] * 0.5) * scale * 0x1p52 + 0.5);
        c->p[i][1] = (int64_t)((p[v] * 0.5 - min[v] * 0.5) * scale * 0x1p52 + 0.5);
    }
    return true;
}

bool pbs_polygon_triangulate(const double *xyz, size_t stride, uint32_t n, uint32_t *triangle,
                             void *scratch) {
    if (n < 4) return fan(n, triangle) || n == 3;
    if (n == 4) return cut_quad(xyz, stride, triangle);
    clip c;
    lay_out(&c, n, triangle, scratch);
    if (!snap(&c, xyz, stride)) return fan(n, triangle);
    for (uint32_t i = 0; i < n; i++)
        c.next[i] = i + 1 < n ? i + 1 : 0, c.prev[i] = i ? i - 1 : n - 1, c.in_queue[i] = 0;
    for (uint32_t i = 0; i < n; i++)
        if ((c.state[i] = look(&c, i)) != CONVEX) c.blocker[c.blockers++] = i;
    if (c.blockers) build(&c, 0, 0, c.blockers);
    /* every other corner first: a round outline is halved again and again, not cut into slivers */
    for (uint32_t i = 1; i < n; i += 2) push(&c, i);
    for (uint32_t i = 0; i < n; i += 2) push(&c, i);
    cut_all(&c);
    return c.clean;
}
