/* evenness.c: points on a surface, in a grid of buckets (evenness.h). */
#include "libcore/measures/evenness.h"
#include "libcore/data/rng.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct grid {
    const float *position;
    uint32_t *order, *begin; /* of each bucket */
    size_t count, buckets;
    double low[3], cell;
    int64_t side[3]; /* cells that there are along each axis */
} grid;

static bool is_finite(const float *p) {
    return isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]);
}

static void cell_of(const grid *g, const float *p, int64_t out[3]) {
    for (int k = 0; k < 3; k++) {
        double c = floor(((double)p[k] - g->low[k]) / g->cell);
        /* What lies far outside looks from the border. */
        out[k] = c < -1 ? -1 : c > (double)g->side[k] ? g->side[k] : (int64_t)c;
    }
}

static size_t bucket_of(const grid *g, const int64_t c[3]) {
    uint64_t key = (uint64_t)c[0] * 0x9e3779b97f4a7c15u + (uint64_t)c[1] * 0xbf58476d1ce4e5b9u +
                   (uint64_t)c[2] * 0x94d049bb133111ebu;
    return (size_t)(pbs_mix64(key) & (g->buckets - 1));
}

/* Cells of about a point each, if the points are on a surface. */
static void lay_out(grid *g, const pbs_points *p) {
    double high[3], longest = 0;
    for (int k = 0; k < 3; k++) g->low[k] = INFINITY, high[k] = -INFINITY;
    g->count = 0;
    for (size_t i = 0; i < p->count; i++) {
        const float *at = p->position + 3 * i;
        if (!is_finite(at)) continue;
        g->count++;
        for (int k = 0; k < 3; k++) {
            g->low[k] = fmin(g->low[k], (double)at[k]);
            high[k] = fmax(high[k], (double)at[k]);
        }
    }
    for (int k = 0; k < 3 && g->count; k++) longest = fmax(longest, high[k] - g->low[k]);
    g->cell = longest > 0 ? longest / ceil(sqrt((double)g->count)) : 1;
    for (int k = 0; k < 3 && g->count; k++)
        g->side[k] = (int64_t)floor((high[k] - g->low[k]) / g->cell) + 1;
    for (g->buckets = 64; g->buckets < g->count;) g->buckets *= 2;
}

static void fill(grid *g, const pbs_points *p) {
    int64_t c[3];
    memset(g->begin, 0, (g->buckets + 1) * sizeof *g->begin);
    for (int pass = 0; pass < 2; pass++) {
        for (size_t i = 0; i < p->count; i++) {
            if (!is_finite(p->position + 3 * i)) continue;
            cell_of(g, p->position + 3 * i, c);
            size_t b = bucket_of(g, c);
            if (pass)
                g->order[--g->begin[b]] = (uint32_t)i;
            else
                g->begin[b]++;
        }
        for (size_t b = 0, sum = 0; b <= g->buckets && !pass; b++)
            g->begin[b] = (uint32_t)(sum += b < g->buckets ? g->begin[b] : 0);
    }
}

static pbs_code make_grid(pbs_run *run, const pbs_points *p, grid *g, pbs_err *err) {
    *g = (grid){.position = p->position};
    if (p->count >= UINT32_MAX) return pbs_fail(err, PBS_LIMIT, "more than 2^32 points");
    lay_out(g, p);
    pbs_code rc = pbs_alloc(run, &g->order, g->count, sizeof *g->order, "the points' grid", err);
    if (!rc)
        rc = pbs_alloc(run, &g->begin, g->buckets + 1, sizeof *g->begin, "the points' grid", err);
    if (!rc) fill(g, p);
    return rc;
}

static void free_grid(pbs_run *run, grid *g) {
    pbs_free(run, g->order);
    pbs_free(run, g->begin);
}

static double distance2(const float *a, const float *b) {
    double x = (double)a[0] - (double)b[0], y = (double)a[1] - (double)b[1],
           z = (double)a[2] - (double)b[2];
    return x * x + y * y + z * z;
}

/* What is asked of the points of a bucket, which may be of other cells as well. */
typedef struct asked {
    const float *at;
    size_t self; /* that does not count; SIZE_MAX: all do */
    double best; /* square of the distance to the nearest */
    double radius2;
    size_t within;
} asked;

static void look(const grid *g, const int64_t c[3], asked *a) {
    size_t b = bucket_of(g, c);
    for (uint32_t i = g->begin[b]; i < g->begin[b + 1]; i++) {
        uint32_t id = g->order[i];
        int64_t own[3];
        double d = distance2(a->at, g->position + 3 * (size_t)id);
        if (id == a->self) continue;
        a->best = fmin(a->best, d);
        if (d > a->radius2) continue;
        cell_of(g, g->position + 3 * (size_t)id, own);
        a->within += own[0] == c[0] && own[1] == c[1] && own[2] == c[2];
    }
}

/* The shell of cells that are `ring` away from c. */
static void look_around(const grid *g, const int64_t c[3], int64_t ring, asked *a) {
    int64_t from[3], to[3], at[3];
    for (int k = 0; k < 3; k++) {
        from[k] = c[k] - ring > 0 ? c[k] - ring : 0;
        to[k] = c[k] + ring < g->side[k] - 1 ? c[k] + ring : g->side[k] - 1;
    }
    for (at[2] = from[2]; at[2] <= to[2]; at[2]++)
        for (at[1] = from[1]; at[1] <= to[1]; at[1]++) {
            bool edge = llabs(at[2] - c[2]) == ring || llabs(at[1] - c[1]) == ring;
            for (at[0] = from[0]; at[0] <= to[0]; at[0]++)
                if (edge || llabs(at[0] - c[0]) == ring)
                    look(g, at, a);
                else if (at[0] < c[0] + ring - 1)
                    at[0] = c[0] + ring - 1; /* to the other end */
        }
}

/* All that is nearer than the rings looked at reach. reach: at least so far. */
static void ask(const grid *g, asked *a, double reach) {
    int64_t c[3], most = 0;
    cell_of(g, a->at, c);
    for (int k = 0; k < 3; k++) most = most > g->side[k] ? most : g->side[k];
    for (int64_t ring = 0; ring <= most + 1; ring++) {
        look_around(g, c, ring, a);
        double seen = (double)ring * g->cell;
        if (seen * seen >= a->best && seen >= reach) break;
    }
}

static int rising(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Distances of all points of p to the nearest of the grid, sorted. */
static pbs_code nearest(pbs_run *run, const grid *g, const pbs_points *p, bool self, double *out,
                        size_t *count, pbs_err *err) {
    *count = 0;
    for (size_t i = 0; i < p->count; i++) {
        asked a = {p->position + 3 * i, self ? i : SIZE_MAX, INFINITY, -1, 0};
        if (!is_finite(a.at)) continue;
        if (i % 4096 == 0 && pbs_run_check(run, err)) return PBS_CANCEL;
        ask(g, &a, 0);
        out[(*count)++] = sqrt(a.best);
    }
    qsort(out, *count, sizeof *out, rising);
    return PBS_OK;
}

static void sum_up(const double *d, size_t n, double *mean, double *sigma) {
    double sum = 0, square = 0;
    for (size_t i = 0; i < n; i++) sum += d[i];
    *mean = sum / (double)n;
    for (size_t i = 0; i < n; i++) square += (d[i] - *mean) * (d[i] - *mean);
    *sigma = sqrt(square / (double)n);
}

static void scatter(const grid *g, const pbs_points *surface, double radius, double *room,
                    pbs_evenness *out) {
    size_t step = surface->count / PBS_EVENNESS_DISCS + 1, n = 0;
    double mean, sigma;
    for (size_t i = 0; i < surface->count; i += step) {
        asked a = {surface->position + 3 * i, SIZE_MAX, INFINITY, radius * radius, 0};
        if (!is_finite(a.at)) continue;
        ask(g, &a, radius);
        room[n++] = (double)a.within;
    }
    if (!n) return;
    sum_up(room, n, &mean, &sigma);
    out->scatter = mean > 0 ? sigma / mean : 0;
}

pbs_code pbs_evenness_of(pbs_run *run, const pbs_points *p, const pbs_points *surface,
                         double radius, pbs_evenness *out, pbs_err *err) {
    grid g;
    double *d = NULL;
    size_t n, room = surface && surface->count > p->count ? surface->count : p->count;
    *out = (pbs_evenness){0};
    pbs_code rc = make_grid(run, p, &g, err);
    if (!rc) rc = pbs_alloc(run, &d, room, sizeof *d, "distances", err);
    if (!rc) out->count = g.count;
    if (!rc && g.count > 1) {
        rc = nearest(run, &g, p, true, d, &n, err);
        if (!rc) out->least = d[0], out->percentile = d[n / 100];
        if (!rc) sum_up(d, n, &out->mean, &out->sigma);
    }
    if (!rc && surface) {
        rc = nearest(run, &g, surface, false, d, &n, err);
        if (!rc && n) out->covering = d[n - 1], out->covering99 = d[n - 1 - n / 100];
        if (!rc) scatter(&g, surface, radius, d, out);
    }
    pbs_free(run, d);
    free_grid(run, &g);
    return rc;
}
