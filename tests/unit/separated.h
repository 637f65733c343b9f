/* separated.h: random triangles, and the cells that libcore/voxels/separate.c finds for them. */
#ifndef PBS_TESTS_SEPARATED_H
#define PBS_TESTS_SEPARATED_H
#include "libcore/data/rng.h"
#include "libcore/voxels/separate.h"
#include "tests/check.h"

enum { SIDE = PBS_BLOCK + 2, CELLS = SIDE * SIDE * SIDE };
typedef struct cells {
    uint8_t *hit; /* [z][y][x], from -1 */
} cells;
typedef struct tri {
    double p[3][3];
} tri;

static uint64_t draws;
static inline uint64_t bits(void) {
    return pbs_random(5, 0, draws++);
}
static inline double uniform(double lo, double hi) {
    return lo + (hi - lo) * ((double)(bits() >> 11) * 0x1p-53);
}
static inline double snap(double v, double step) {
    return floor(v / step + 0.5) * step;
}

static inline size_t at(int x, int y, int z) {
    return ((size_t)(z + 1) * SIDE + (size_t)(y + 1)) * SIDE + (size_t)(x + 1);
}
static inline cells cells_new(void) {
    return (cells){calloc(CELLS, 1)};
}

#define STEP 0x1p-32

static inline tri random_tri(double lo, double hi, double size, double step) {
    tri t;
    for (int k = 0; k < 3; k++) {
        double at_k = uniform(lo, hi);
        for (int c = 0; c < 3; c++) t.p[c][k] = snap(at_k + uniform(-size, size), step);
    }
    return t;
}

typedef struct list {
    pbs_hit *hit;
    size_t count, room;
} list;
static inline void keep(void *ctx, pbs_hits *h) {
    list *l = ctx;
    if (h->count > PBS_HITS) abort();
    if (l->count + h->count > l->room) {
        l->room = 2 * (l->count + h->count);
        l->hit = realloc(l->hit, l->room * sizeof *l->hit);
    }
    for (uint32_t i = 0; i < h->count; i++) l->hit[l->count + i] = h->hit[i];
    l->count += h->count, h->count = 0;
}

static inline void batch_of(pbs_triangles *b, const tri *t, uint32_t n) {
    /* What is behind the last triangle may be anything. */
    for (size_t i = 0; i < sizeof *b / sizeof(double); i++) ((double *)(void *)b)[i] = NAN;
    b->count = n;
    for (uint32_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) {
            double lo = t[i].p[0][k], hi = lo;
            for (int c = 0; c < 3; c++) {
                b->p[c][k][i] = t[i].p[c][k];
                lo = fmin(lo, t[i].p[c][k]), hi = fmax(hi, t[i].p[c][k]);
            }
            b->min[k][i] = lo, b->max[k][i] = hi;
        }
}

static inline list hits_of(const tri *t, uint32_t n, bool simd) {
    static pbs_triangles b;
    static pbs_hits h;
    list l = {0};
    h.flush = keep, h.ctx = &l, h.count = 0;
    for (uint32_t i = 0; i < n; i += PBS_TRIANGLES) {
        batch_of(&b, t + i, n - i < PBS_TRIANGLES ? n - i : PBS_TRIANGLES);
        size_t before = l.count + h.count;
        pbs_separate(&b, simd, &h);
        keep(&l, &h);
        for (; before < l.count; before++) {
            CHECK(l.hit[before].triangle < b.count);
            l.hit[before].triangle += i;
        }
    }
    return l;
}

/* The cells of one triangle of the list. */
static inline void mark(const list *l, uint32_t triangle, cells *out) {
    for (size_t i = 0; i < l->count; i++)
        if (l->hit[i].triangle == triangle) {
            uint32_t c = l->hit[i].cell;
            out->hit[at(PBS_CELL_X(c), PBS_CELL_Y(c), PBS_CELL_Z(c))] = 1;
        }
}
#endif
