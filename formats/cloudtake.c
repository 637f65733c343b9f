/* cloudtake.c: the points of clouds on one lattice, in the cells of an octree (cloudpack.h).
 *
 * Three passes over the files: bounds, counts of a grid of cells, and the points themselves. */
#include "formats/cloudpack.h"
#include "libcore/pipe.h"
#include <float.h>
#include <math.h>
#include <string.h>

enum {
    BATCH = 65536, /* so many that the points of a cell are usually many, and 16 bits count them */
    PART = 1024,   /* of it, as numbers of the file */
    PER_CELL = 4096,      /* points of a surface in a cell of it, or more */
    LATTICE_BITS = 23,    /* of clouds without a lattice of their own */
    IN_MEMORY = 32 << 20, /* bytes of points: more lie in a file */
    HELD = 32 << 20       /* bytes of pages of files */
};

/* What the files' numbers become: value * mul + add, in steps. */
typedef struct map {
    double mul[3], add[3];
    int colour_shift;
} map;

typedef struct bounds {
    double low[3], high[3]; /* values of the file */
    uint64_t bad;
    uint16_t colour; /* largest */
} bounds;

typedef struct batch {
    const pbs_cloud *cloud;
    const map *map;
    uint64_t first;
    size_t count, taken;
    double (*value)[3]; /* PART of them */
    uint16_t (*colour)[3];
    pbs_clod_raw *raw, *sorted;
    uint64_t *key, *other; /* place in the grid, or cell; and which point it is */
} batch;

typedef struct take {
    pbs_run *run;
    const pbs_cloud *clouds;
    size_t cloud_count;
    pbs_cloud_points *out;
    map *maps;
    bounds *bounds; /* of each cloud; those of threads behind */
    pbs_clod_grid grid;
    uint64_t *at; /* of each cell, where its next point goes; NULL: count */
    /* the source */
    size_t cloud;
    uint64_t next, done, all;
} take;

static bool finite3(const double v[3]) {
    /* x - x is 0 for finite numbers only */
    return v[0] - v[0] + (v[1] - v[1]) + (v[2] - v[2]) == 0;
}

/* ---- bounds ---- */

typedef struct measure {
    const pbs_cloud *cloud;
    bounds *thread;
    batch *batches;
} measure;

static void add_bounds(bounds *b, const double (*v)[3], const uint16_t (*colour)[3], size_t n) {
    uint16_t most = b->colour;
    double low[3], high[3];
    memcpy(low, b->low, sizeof low), memcpy(high, b->high, sizeof high);
    for (size_t i = 0; i < n; i++) {
        if (!finite3(v[i])) {
            b->bad++;
            continue;
        }
        for (int k = 0; k < 3; k++) {
            low[k] = v[i][k] < low[k] ? v[i][k] : low[k];
            high[k] = v[i][k] > high[k] ? v[i][k] : high[k];
        }
    }
    for (size_t i = 0; colour && i < n; i++)
        for (int k = 0; k < 3; k++) most = colour[i][k] > most ? colour[i][k] : most;
    memcpy(b->low, low, sizeof low), memcpy(b->high, high, sizeof high);
    b->colour = most;
}

static pbs_code measure_batch(void *ctx, size_t i, int thread, pbs_err *err) {
    measure *m = ctx;
    batch *b = &m->batches[thread];
    uint64_t first = (uint64_t)i * BATCH;
    size_t count = m->cloud->count - first < BATCH ? (size_t)(m->cloud->count - first) : BATCH;
    bool colours = m->cloud->colour == PBS_CLOUD_COLOUR_ANY;
    pbs_code rc = PBS_OK;
    for (size_t p = 0, n; p < count && !rc; p += n) {
        n = count - p < PART ? count - p : PART;
        rc = pbs_cloud_read(m->cloud, first + p, n, b->value, colours ? b->colour : NULL, err);
        if (!rc)
            add_bounds(&m->thread[thread], (const double(*)[3])b->value,
                       colours ? (const uint16_t(*)[3])b->colour : NULL, n);
    }
    return rc;
}

static void merge_bounds(bounds *to, const bounds *b) {
    for (int k = 0; k < 3; k++) {
        to->low[k] = fmin(to->low[k], b->low[k]);
        to->high[k] = fmax(to->high[k], b->high[k]);
    }
    to->bad += b->bad;
    to->colour = b->colour > to->colour ? b->colour : to->colour;
}

static const bounds NOTHING = {
    {INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}, 0, 0};

/* In pieces, so that pages of the file can go between them. */
static pbs_code measure_cloud(take *t, size_t c, batch *batches, pbs_err *err) {
    bounds *own = &t->bounds[c], *threads = t->bounds + t->cloud_count;
    const size_t piece = 64;
    pbs_cloud part = t->clouds[c];
    pbs_code rc = PBS_OK;
    *own = NOTHING;
    for (int i = 0; i < t->run->threads; i++) threads[i] = NOTHING;
    while (part.count && !rc) {
        uint64_t all = part.count, n = (all + BATCH - 1) / BATCH;
        if (n > piece) n = piece, part.count = (uint64_t)piece * BATCH;
        measure m = {&part, threads, batches};
        rc = pbs_parallel(t->run, (size_t)n, measure_batch, &m, err);
        part.first += part.count * part.stride;
        part.count = all - part.count;
        pbs_trim_now(&t->out->trim);
        pbs_run_progress(t->run, "bounds", t->clouds[c].count - part.count, t->clouds[c].count);
    }
    for (int i = 0; i < t->run->threads; i++) merge_bounds(own, &threads[i]);
    return rc;
}

/* ---- the lattice ---- */

/* All numbers of all clouds, as positions. */
static pbs_code cloud_box(const take *t, pbs_box *box, pbs_err *err) {
    *box = PBS_BOX_EMPTY;
    for (size_t c = 0; c < t->cloud_count; c++) {
        const bounds *b = &t->bounds[c];
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
static double files_step(const take *t) {
    double step = INFINITY;
    for (size_t c = 0; c < t->cloud_count; c++)
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

static void make_maps(take *t, bool *exact) {
    const pbs_cloud_lattice *l = &t->out->lattice;
    for (size_t c = 0; c < t->cloud_count; c++)
        for (int k = 0; k < 3; k++) {
            const pbs_cloud *cloud = &t->clouds[c];
            double mul = cloud->scale[k] / l->step,
                   add = (cloud->offset[k] - l->origin[k]) / l->step;
            bool own = cloud->lattice;
            t->maps[c].mul[k] = own ? snap(mul, 1e-9 * fabs(mul), exact) : mul;
            t->maps[c].add[k] = own ? snap(add, 1e-3, exact) : add;
            *exact = *exact && own;
        }
}

static pbs_code choose_lattice(take *t, pbs_err *err) {
    pbs_cloud_lattice *l = &t->out->lattice;
    pbs_box box;
    pbs_code rc = cloud_box(t, &box, err);
    if (rc) return rc;
    double extent = extent_of(&box), step = files_step(t);
    bool exact = step > 0;
    if (!exact) {
        /* A power of two: scaling by it is exact, and so is then the difference to the origin. */
        step = extent > 0 ? fmax(ldexp(1, (int)ceil(log2(extent)) - LATTICE_BITS), DBL_MIN) : 1;
    }
    while (extent / step >= ldexp(1, PBS_CLOD_BITS) - 2) step *= 2, exact = false;
    l->step = step;
    const double *at = t->clouds[0].offset;
    for (int k = 0; k < 3; k++)
        l->origin[k] = exact ? at[k] + step * floor((box.min[k] - at[k]) / step + 0.5) : box.min[k];
    make_maps(t, &exact);
    l->bound = exact ? 0 : sqrt(3) / 2 * step;
    for (l->bits = 0; ldexp(1, l->bits) < floor(extent / step + 0.5) + 2; l->bits++) {
    }
    return PBS_OK;
}

static void choose_colours(take *t) {
    uint16_t most = 0;
    for (size_t c = 0; c < t->cloud_count; c++) {
        t->out->colours |= t->clouds[c].colour != PBS_CLOUD_NO_COLOUR;
        most = t->bounds[c].colour > most ? t->bounds[c].colour : most;
    }
    /* One answer for all files: a dark tile is not a file of 8 bits. */
    for (size_t c = 0; c < t->cloud_count; c++)
        t->maps[c].colour_shift = t->clouds[c].colour == PBS_CLOUD_COLOUR_8    ? 0
                                  : t->clouds[c].colour == PBS_CLOUD_COLOUR_16 ? 8
                                  : most > 255                                 ? 8
                                                                               : 0;
}

/* ---- points, batch by batch ---- */

static pbs_code next_batch(void *ctx, void *slot, bool *end, pbs_err *err) {
    take *t = ctx;
    batch *b = slot;
    while (t->cloud < t->cloud_count && t->next == t->clouds[t->cloud].count)
        t->cloud++, t->next = 0;
    if ((*end = t->cloud == t->cloud_count)) return PBS_OK;
    uint64_t left = t->clouds[t->cloud].count - t->next;
    b->cloud = &t->clouds[t->cloud];
    b->map = &t->maps[t->cloud];
    b->first = t->next;
    b->count = left < BATCH ? (size_t)left : BATCH;
    t->next += b->count;
    return pbs_run_check(t->run, err);
}

/* In the box that was measured, so 0 .. 2^bits - 1 but for rounding. */
static inline uint32_t quantise(double v, double most, int shift) {
    v += 0.5;
    return (uint32_t)(int64_t)(v > 0 ? v < most ? v : most : 0) >> shift;
}

/* A part of a batch: numbers to steps, and where they are. */
static pbs_code take_part(const take *t, batch *b, size_t at, size_t n, pbs_err *err) {
    const map *m = b->map;
    const pbs_cloud_lattice *l = &t->out->lattice;
    const double most = ldexp(1, l->bits + l->shift) - 1;
    bool colours = t->at && b->cloud->colour != PBS_CLOUD_NO_COLOUR;
    const bool all_finite = !t->bounds[b->cloud - t->clouds].bad;
    pbs_code rc =
        pbs_cloud_read(b->cloud, b->first + at, n, b->value, colours ? b->colour : NULL, err);
    for (size_t i = 0; i < n && !rc; i++) {
        const double *v = b->value[i];
        if (!all_finite && !finite3(v)) continue;
        pbs_clod_raw *r = &b->raw[b->taken];
        for (int k = 0; k < 3; k++)
            r->q[k] = quantise(v[k] * m->mul[k] + m->add[k], most, l->shift);
        memset(r->colour, 255, 4);
        for (int k = 0; colours && k < 3; k++)
            r->colour[k] = (uint8_t)(b->colour[i][k] >> m->colour_shift);
        uint32_t place = pbs_clod_place(&t->grid, r->q);
        b->key[b->taken] = (uint64_t)(t->at ? t->grid.cell[place] : place) << 16 | b->taken;
        b->taken++;
    }
    return rc;
}

static pbs_code work_batch(void *ctx, void *slot, int thread, pbs_err *err) {
    (void)thread;
    const take *t = ctx;
    batch *b = slot;
    pbs_code rc = PBS_OK;
    b->taken = 0;
    for (size_t i = 0; i < b->count && !rc; i += PART)
        rc = take_part(t, b, i, b->count - i < PART ? b->count - i : PART, err);
    if (rc || !t->at) return rc;
    int bits = 0;
    while (t->out->cells.count >> bits) bits++;
    pbs_clod_sort(&b->key, &b->other, (uint32_t)b->taken, bits);
    for (size_t i = 0; i < b->taken; i++) b->sorted[i] = b->raw[b->key[i] & 0xffff];
    return PBS_OK;
}

/* The points of one cell after those that it has. */
static pbs_code put_points(take *t, const batch *b, size_t first, size_t end, pbs_err *err) {
    uint64_t *at = &t->at[b->key[first] >> 16];
    pbs_code rc = pbs_scratch_write(&t->out->raw, *at * sizeof *b->sorted,
                                    (end - first) * sizeof *b->sorted, b->sorted + first, err);
    *at += end - first;
    return rc;
}

static pbs_code sink_batch(void *ctx, void *slot, pbs_err *err) {
    take *t = ctx;
    const batch *b = slot;
    pbs_code rc = PBS_OK;
    if (!t->at)
        for (size_t i = 0; i < b->taken; i++) t->grid.count[b->key[i] >> 16]++;
    else
        for (size_t i = 0, end; i < b->taken && !rc; i = end) {
            for (end = i + 1; end < b->taken && b->key[end] >> 16 == b->key[i] >> 16;) end++;
            rc = put_points(t, b, i, end, err);
        }
    t->done += b->count;
    pbs_trim_now(&t->out->trim);
    pbs_run_progress(t->run, t->at ? "points" : "cells", t->done, t->all);
    return rc;
}

static pbs_code batch_new(pbs_run *run, batch *b, pbs_err *err) {
    const char *what = "a batch of points";
    memset(b, 0, sizeof *b);
    pbs_code rc = pbs_alloc(run, &b->value, PART, sizeof *b->value, what, err);
    if (!rc) rc = pbs_alloc(run, &b->colour, PART, sizeof *b->colour, what, err);
    if (!rc) rc = pbs_alloc(run, &b->raw, BATCH, sizeof *b->raw, what, err);
    if (!rc) rc = pbs_alloc(run, &b->sorted, BATCH, sizeof *b->sorted, what, err);
    if (!rc) rc = pbs_alloc(run, &b->key, BATCH, sizeof *b->key, what, err);
    if (!rc) rc = pbs_alloc(run, &b->other, BATCH, sizeof *b->other, what, err);
    return rc;
}

static void batch_free(pbs_run *run, batch *b) {
    pbs_free(run, b->value);
    pbs_free(run, b->colour);
    pbs_free(run, b->raw);
    pbs_free(run, b->sorted);
    pbs_free(run, b->key);
    pbs_free(run, b->other);
}

static pbs_code pass(take *t, batch *slots, int count, pbs_err *err) {
    pbs_pipe pipe = {.ctx = t,
                     .source = next_batch,
                     .work = work_batch,
                     .sink = sink_batch,
                     .slots = slots,
                     .slot_size = sizeof *slots,
                     .slot_count = count};
    t->cloud = 0;
    t->next = t->done = 0;
    return pbs_pipe_run(t->run, &pipe, err);
}

/* ---- all ---- */

/* Cells of 2^16 steps hold few points if the lattice is much finer than the cloud: nearly every
 * point would be a node. Then the lattice is made coarser; a point moves by half a step. Files that
 * have a lattice keep it as long as that can be borne. */
static void coarsen(take *t, uint64_t points) {
    pbs_cloud_lattice *l = &t->out->lattice;
    const int fine = PBS_CLOD_SIDE + t->grid.depth;
    double occupied = 0, step = l->step, n = (double)points;
    double most = l->bound > 0 ? n / 512 + 8 : n / 8 + 4096;
    for (size_t i = 0; i < (size_t)1 << 3 * t->grid.depth; i++) occupied += t->grid.count[i] > 0;
    while (l->bits > PBS_CLOD_SIDE && l->bits > t->grid.depth &&
           fmin(occupied * ldexp(1, 2 * (l->bits - fine)), n) > most)
        l->bits--, l->shift++;
    if (!l->shift) return;
    double half = (ldexp(1, l->shift) - 1) / 2;
    for (int k = 0; k < 3; k++) l->origin[k] += half * step;
    l->step = ldexp(step, l->shift);
    l->bound += sqrt(3) * half * step;
    t->grid.bits = l->bits;
}

static pbs_code count_cells(take *t, batch *slots, int count, pbs_err *err) {
    int depth = 0, bits = t->out->lattice.bits;
    while (depth < PBS_CLOD_DEPTH && depth < bits && ldexp(PER_CELL, 2 * depth) < (double)t->all)
        depth++;
    pbs_code rc = pbs_clod_grid_new(t->run, bits, depth, &t->grid, err);
    if (!rc) rc = pass(t, slots, count, err);
    if (rc) return rc;
    coarsen(t, t->out->count);
    return pbs_clod_cells_of(t->run, &t->grid, 0, &t->out->cells, err);
}

static void trim(void *t) {
    pbs_trim_now(t);
}

static pbs_code sort_points(take *t, batch *slots, int count, pbs_err *err) {
    pbs_cloud_points *out = t->out;
    pbs_clod_cells *cells = &out->cells;
    pbs_code rc = pbs_scratch_within(t->run, (size_t)out->count, sizeof(pbs_clod_raw), "the points",
                                     IN_MEMORY, &out->raw, err);
    if (rc) return rc;
    if (out->raw.is_file) pbs_trim_add(&out->trim, out->raw.bytes, out->raw.size);
    rc = pbs_alloc(t->run, &t->at, cells->count, sizeof *t->at, "the cells", err);
    if (rc) return rc;
    for (size_t i = 0; i < cells->count; i++) t->at[i] = cells->cell[i].first;
    rc = pass(t, slots, count, err);
    pbs_clod_grid_free(t->run, &t->grid);
    return rc ? rc : pbs_clod_cut(t->run, out->raw.bytes, cells, trim, &out->trim, err);
}

static pbs_code take_all(take *t, batch *slots, int count, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t c = 0; c < t->cloud_count && !rc; c++) {
        rc = measure_cloud(t, c, slots, err);
        t->all += t->clouds[c].count;
        t->out->left_out += t->bounds[c].bad;
    }
    t->out->count = t->all - t->out->left_out;
    if (!rc) rc = choose_lattice(t, err);
    if (!rc) choose_colours(t);
    if (!rc) rc = count_cells(t, slots, count, err);
    return rc ? rc : sort_points(t, slots, count, err);
}

pbs_code pbs_cloud_take(pbs_run *run, const pbs_cloud *clouds, size_t count, pbs_cloud_points *p,
                        pbs_err *err) {
    take t = {.run = run, .clouds = clouds, .cloud_count = count, .out = p};
    size_t slots = 2 * (size_t)run->threads;
    batch *batches = NULL;
    pbs_trim_open(run, &p->trim);
    if (p->trim.limit > HELD) p->trim.limit = HELD;
    for (size_t c = 0; c < count; c++) pbs_cloud_trim(&clouds[c], &p->trim);
    pbs_code rc = pbs_alloc(run, &t.maps, count, sizeof *t.maps, "the clouds", err);
    if (!rc)
        rc = pbs_alloc(run, &t.bounds, count + (size_t)run->threads, sizeof *t.bounds, "the clouds",
                       err);
    if (!rc) rc = pbs_alloc(run, &batches, slots, sizeof *batches, "the clouds", err);
    if (!rc) memset(batches, 0, slots * sizeof *batches);
    for (size_t i = 0; i < slots && !rc; i++) rc = batch_new(run, &batches[i], err);
    if (!rc) rc = take_all(&t, batches, (int)slots, err);
    for (size_t i = 0; i < slots && batches; i++) batch_free(run, &batches[i]);
    pbs_free(run, batches);
    pbs_free(run, t.maps);
    pbs_free(run, t.bounds);
    pbs_free(run, t.at);
    pbs_clod_grid_free(run, &t.grid);
    return rc;
}

static pbs_code read_points(void *ctx, uint64_t at, size_t size, void *to, pbs_err *err) {
    return pbs_scratch_read(ctx, at, size, to, err);
}
static pbs_code write_points(void *ctx, uint64_t at, size_t size, const void *from, pbs_err *err) {
    return pbs_scratch_write(ctx, at, size, from, err);
}
pbs_clod_store pbs_cloud_store(const pbs_cloud_points *p) {
    return (pbs_clod_store){(void *)&p->raw, read_points, write_points};
}

void pbs_cloud_points_free(pbs_run *run, pbs_cloud_points *p) {
    pbs_clod_cells_free(run, &p->cells);
    pbs_scratch_free(&p->raw);
    pbs_trim_close(&p->trim);
}
