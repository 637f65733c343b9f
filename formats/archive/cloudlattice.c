/* cloudlattice.c: the lattice that the points of clouds go onto (cloudtake.h). */
#include "formats/archive/cloudtake.h"
#include <float.h>
#include <math.h>
#include <string.h>

enum {
    PER_CELL = 4096,  /* points of a surface in a cell of the grid, or more */
    LATTICE_BITS = 23 /* of clouds without a lattice of their own */
};

int pbs_cloud_grid_depth(uint64_t points, int bits) {
    int depth = 0;
    while (depth < PBS_CLOD_DEPTH && depth < bits && ldexp(PER_CELL, 2 * depth) < (double)points)
        depth++;
    return depth;
}

typedef struct choice {
    const pbs_cloud *clouds;
    size_t count;
    const pbs_cloud_bounds *bounds;
    uint64_t points;
    pbs_cloud_lattice *l;
    pbs_cloud_map *maps;
} choice;

/* All numbers of all clouds, as positions. */
static pbs_code cloud_box(const choice *t, pbs_box *box, pbs_err *err) {
    *box = PBS_BOX_EMPTY;
    for (size_t c = 0; c < t->count; c++) {
        const pbs_cloud_bounds *b = &t->bounds[c];
        const pbs_cloud *cloud = &t->clouds[c];
        double low[3], high[3];
        if (!(b->low[0] <= b->high[0])) continue;
        for (int k = 0; k < 3; k++) {
            low[k] = cloud->offset[k] + cloud->scale[k] * b->low[k];
            high[k] = cloud->offset[k] + cloud->scale[k] * b->high[k];
        }
        pbs_box_add(box, low);
        pbs_box_add(box, high);
    }
    if (pbs_box_is_empty(box)) return pbs_fail(err, PBS_DATA, "no points");
    for (int k = 0; k < 3; k++)
        if (!(box->max[k] - box->min[k] < 1e38) || !(fabs(box->min[k]) < 1e300))
            return pbs_fail(err, PBS_DATA, "points from %g to %g: too far apart", box->min[k],
                            box->max[k]);
    return PBS_OK;
}

static double extent_of(const pbs_box *b) {
    return fmax(b->max[0] - b->min[0], fmax(b->max[1] - b->min[1], b->max[2] - b->min[2]));
}

/* The smallest scale of the files; 0: some have no lattice. */
static double files_step(const choice *t) {
    double step = INFINITY;
    for (size_t c = 0; c < t->count; c++)
        for (int k = 0; k < 3; k++)
            step = t->clouds[c].lattice ? fmin(step, fabs(t->clouds[c].scale[k])) : 0;
    return step;
}

/* v, if it is an integer but for rounding; else *exact becomes false. */
static double snap(double v, double slack, bool *exact) {
    double r = floor(v + 0.5);
    if (fabs(v - r) <= slack) return r;
    *exact = false;
    return v;
}

static void make_maps(const choice *t, bool *exact) {
    const pbs_cloud_lattice *l = t->l;
    for (size_t c = 0; c < t->count; c++) {
        const pbs_cloud *cloud = &t->clouds[c];
        pbs_cloud_map *m = &t->maps[c];
        bool own = cloud->lattice;
        m->whole = own;
        for (int k = 0; k < 3; k++) {
            double mul = cloud->scale[k] / l->step,
                   add = (cloud->offset[k] - l->origin[k]) / l->step;
            m->mul[k] = own ? snap(mul, 1e-9 * fabs(mul), &m->whole) : mul;
            m->add[k] = own ? snap(add, 1e-3, &m->whole) : add;
        }
        *exact = *exact && m->whole;
        for (int k = 0; k < 3; k++) {
            m->whole = m->whole && m->mul[k] == 1 && fabs(m->add[k]) < 0x1p40;
            m->plus[k] = m->whole ? (uint32_t)(int64_t)m->add[k] : 0;
        }
    }
}

static int bits_of(double steps) {
    int bits = 0;
    while (ldexp(1, bits) < steps + 2) bits++;
    return bits;
}

/* Where an exact lattice begins, in steps from `at`, and its bits. */
static void align(const choice *t, const pbs_box *box, const double at[3], double from[3]) {
    pbs_cloud_lattice *l = t->l;
    double first[3], last[3];
    l->bits = bits_of(floor(extent_of(box) / l->step + 0.5));
    for (int k = 0; k < 3; k++) {
        first[k] = floor((box->min[k] - at[k]) / l->step + 0.5);
        last[k] = first[k] + floor((box->max[k] - box->min[k]) / l->step + 0.5);
    }
    for (; l->bits <= PBS_CLOD_BITS; l->bits++) {
        double side = ldexp(1, l->bits - pbs_cloud_grid_depth(t->points, l->bits));
        bool fits = true;
        for (int k = 0; k < 3; k++) {
            from[k] = floor(first[k] / side) * side;
            fits = fits && last[k] - from[k] + 2 <= ldexp(1, l->bits);
        }
        if (fits) return;
    }
    l->bits = PBS_CLOD_BITS;
    memcpy(from, first, sizeof first);
}

pbs_code pbs_cloud_lattice_choose(const pbs_cloud *clouds, size_t count,
                                  const pbs_cloud_bounds *bounds, uint64_t points,
                                  pbs_cloud_lattice *l, pbs_cloud_map *maps, pbs_err *err) {
    const choice t = {clouds, count, bounds, points, l, maps};
    pbs_box box;
    pbs_code rc = cloud_box(&t, &box, err);
    if (rc) return rc;
    double extent = extent_of(&box), step = files_step(&t), from[3];
    bool exact = step > 0;
    if (!exact) {
        /* A power of two: scaling by it is exact, and so is then the difference to the origin. */
        step = extent > 0 ? fmax(ldexp(1, (int)ceil(log2(extent)) - LATTICE_BITS), DBL_MIN) : 1;
    }
    while (extent / step >= ldexp(1, PBS_CLOD_BITS) - 2) step *= 2, exact = false;
    l->step = step;
    l->shift = 0;
    const double *at = clouds[0].offset;
    if (exact)
        align(&t, &box, at, from);
    else
        l->bits = bits_of(floor(extent / step + 0.5));
    for (int k = 0; k < 3; k++) l->origin[k] = exact ? at[k] + step * from[k] : box.min[k];
    make_maps(&t, &exact);
    l->bound = exact ? 0 : sqrt(3) / 2 * step;
    return PBS_OK;
}

/* How many cells of the grid have points, and how many times more than of one a level less deep: 2
 * along a line, 4 on a surface. A volume counts as a surface, since a surface that lies between two
 * layers of cells looks like one here. */
static double occupied(const pbs_clod_grid *g, double *grows) {
    double n = 0, coarse = 0;
    for (size_t i = 0; i < (size_t)1 << 3 * g->depth; i += 8) {
        int here = 0;
        for (size_t j = i; j < i + 8 && g->depth; j++) here += g->count[j] > 0;
        n += here, coarse += here > 0;
    }
    *grows = coarse > 0 ? fmin(n / coarse, 4) : 4;
    return g->depth ? n : 1;
}

int pbs_cloud_too_fine(const pbs_cloud_lattice *l, const pbs_clod_grid *g, uint64_t points,
                       double all) {
    const int fine = PBS_CLOD_SIDE + g->depth;
    double grows, cells = occupied(g, &grows), n = (double)points;
    double most = l->bound > 0 ? fmin(n / 512 + 8, all / 8) : all / 8;
    int by = 0;
    /* Such a surface fills half as many as it seems. */
    if (!(l->bound > 0) && fmin(cells * pow(grows, l->bits - fine), n) <= 2 * all) return 0;
    while (l->bits - by > PBS_CLOD_SIDE && l->bits - by > g->depth &&
           fmin(cells * ldexp(1, 2 * (l->bits - by - fine)), n) > most)
        by++;
    return by;
}

void pbs_cloud_choose_colours(const pbs_cloud *clouds, size_t count, const pbs_cloud_bounds *bounds,
                              pbs_cloud_map *maps) {
    uint16_t any = 0;
    for (size_t c = 0; c < count; c++) any |= bounds[c].colour;
    for (size_t c = 0; c < count; c++)
        maps[c].colour_shift = clouds[c].colour == PBS_CLOUD_COLOUR_8    ? 0
                               : clouds[c].colour == PBS_CLOUD_COLOUR_16 ? 8
                               : any > 255                               ? 8
                                                                         : 0;
}
