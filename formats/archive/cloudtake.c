/* cloudtake.c: the points of clouds on one lattice, in the cells of an octree (cloudpack.h).
 *
 * Two passes over the files: bounds, and counts of a grid of cells in the box that the files say
 * they have; then the points themselves. If the box is not right, or files do not say one, or are
 * not on one lattice, counting is a pass of its own: what comes out is the same. */
#include "formats/archive/cloudtake.h"
#include "libcore/ground/pipe.h"
#include "libcore/data/vectors.h"
#include <math.h>
#include <string.h>

enum {
    BATCH = 65536,        /* so many that the points of a cell are usually many */
    PART = 1024,          /* of it, as numbers of the file */
    PIECE = 192 << 10,    /* bytes of a file at a time */
    HELD = 32 << 20,      /* bytes of pages of files at most, */
    HELD_POINT = 48,      /* and of each point: its record, itself, and what is left of cells */
    PROGRAM = 4 << 20,    /* pages of the program, which are counted elsewhere */
    IN_MEMORY = 32 << 20, /* bytes of points: a file costs less than as many fresh pages */
    REST_IN_MEMORY = 16 << 20
};

typedef enum pass_kind { MEASURE, COUNT, MEASURE_AND_COUNT, TAKE } pass_kind;

/* The points of a batch that are in one cell. */
typedef struct run_of {
    uint32_t cell, end;
} run_of;

typedef struct batch {
    size_t cloud;
    uint64_t first;
    size_t count, taken, run_count;
    pbs_cloud_bounds bounds;
    uint8_t *piece;
    double (*value)[3]; /* PART of them */
    uint16_t (*colour)[3];
    pbs_clod_raw *raw, *sorted;
    uint32_t *cell; /* or place in the grid */
    run_of *run;
} batch;

typedef struct take {
    pbs_run *run;
    const pbs_cloud *clouds;
    size_t cloud_count;
    pbs_cloud_points *out;
    pbs_cloud_map *maps;
    pbs_cloud_bounds *bounds; /* of each cloud */
    pbs_clod_grid grid;
    uint64_t *at;    /* of each cell, where its next point goes */
    uint32_t **seen; /* of each thread: zero for each cell */
    batch *slots;
    int slot_count;
    /* of a pass */
    pass_kind kind;
    size_t cloud;
    uint64_t next, done, all;
} take;

/* ---- bounds ---- */

static bool finite3(const double v[3]) {
    /* x - x is 0 for finite numbers only */
    return v[0] - v[0] + (v[1] - v[1]) + (v[2] - v[2]) == 0;
}

static void add_bounds(pbs_cloud_bounds *b, const double (*v)[3], const uint16_t (*colour)[3],
                       size_t n) {
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
        b->colour |= colour[i][0] | colour[i][1] | colour[i][2];
    memcpy(b->low, low, sizeof low), memcpy(b->high, high, sizeof high);
}

/* Three numbers of 16 bits, read with the two bytes before them: a record may end with them. */
static inline uint64_t colour_at(const uint8_t *p) {
    uint64_t v;
    memcpy(&v, p - 2, sizeof v);
    return v >> 16;
}

static inline i4 select4i(i4 which, i4 yes, i4 no) {
    return (yes & which) | (no & ~which);
}

static void add_record_bounds(pbs_cloud_bounds *b, const pbs_cloud *c, const uint8_t *p, size_t n) {
    i4 low = {INT32_MAX, INT32_MAX, INT32_MAX, 0}, high = {INT32_MIN, INT32_MIN, INT32_MIN, 0};
    uint64_t colours = 0;
    const uint32_t red = c->colour == PBS_CLOUD_COLOUR_ANY ? c->at[3] : 0;
    for (size_t i = 0; i < n; i++, p += c->stride) {
        i4 v; /* the fourth is something else */
        memcpy(&v, p, sizeof v);
        low = select4i(v < low, v, low);
        high = select4i(v > high, v, high);
        if (red) colours |= colour_at(p + red);
    }
    for (int k = 0; k < 3 && n; k++) {
        b->low[k] = fmin(b->low[k], low[k]);
        b->high[k] = fmax(b->high[k], high[k]);
    }
    b->colour |= (uint16_t)(colours | colours >> 16 | colours >> 32);
}

/* ---- points to steps, and where they are ---- */

/* In the box that was measured, so 0 .. most but for rounding. */
static inline uint32_t quantise(double v, double most, int shift) {
    v += 0.5;
    return (uint32_t)(int64_t)(v > 0 ? v < most ? v : most : 0) >> shift;
}

static void take_values(const take *t, batch *b, bool colours, size_t n) {
    const pbs_cloud_map *m = &t->maps[b->cloud];
    const pbs_cloud_lattice *l = &t->out->lattice;
    const double most = ldexp(1, l->bits + l->shift) - 1;
    const bool all_finite = !t->bounds[b->cloud].bad;
    for (size_t i = 0; i < n; i++) {
        const double *v = b->value[i];
        if (!all_finite && !finite3(v)) continue;
        pbs_clod_raw *r = &b->raw[b->taken];
        for (int k = 0; k < 3; k++)
            r->q[k] = quantise(v[k] * m->mul[k] + m->add[k], most, l->shift);
        memset(r->colour, 255, 4);
        for (int k = 0; colours && k < 3; k++)
            r->colour[k] = (uint8_t)(b->colour[i][k] >> m->colour_shift);
        uint32_t place = pbs_clod_place(&t->grid, r->q);
        b->cell[b->taken++] = t->kind == TAKE ? t->grid.cell[place] : place;
    }
}

/* The same for integers that stay what they are. */
static inline void steps_of(const uint8_t *p, const uint32_t plus[3], uint32_t most, int shift,
                            uint32_t q[3]) {
    memcpy(q, p, 12);
    for (int k = 0; k < 3; k++) {
        uint32_t v = q[k] + plus[k];
        q[k] = (v < most ? v : most) >> shift;
    }
}

static void count_records(const take *t, batch *b, const uint8_t *p, size_t n) {
    const pbs_cloud_lattice *l = &t->out->lattice;
    const uint32_t most = (uint32_t)(UINT64_C(1) << (l->bits + l->shift)) - 1;
    const size_t stride = t->clouds[b->cloud].stride;
    const uint32_t *plus = t->maps[b->cloud].plus;
    uint32_t *place = b->cell + b->taken, q[3];
    for (size_t i = 0; i < n; i++, p += stride) {
        steps_of(p, plus, most, l->shift, q);
        place[i] = pbs_clod_place(&t->grid, q);
    }
    b->taken += n;
}

static void take_records(const take *t, batch *b, const uint8_t *p, size_t n) {
    const pbs_cloud *c = &t->clouds[b->cloud];
    const pbs_cloud_map *m = &t->maps[b->cloud];
    const pbs_cloud_lattice *l = &t->out->lattice;
    const uint32_t most = (uint32_t)(UINT64_C(1) << (l->bits + l->shift)) - 1;
    const uint32_t red = c->colour == PBS_CLOUD_NO_COLOUR ? 0 : c->at[3], *cell = t->grid.cell;
    const int shift = l->shift, by = m->colour_shift;
    pbs_clod_raw *r = b->raw + b->taken;
    uint32_t *to = b->cell + b->taken;
    for (size_t i = 0; i < n; i++, p += c->stride, r++) {
        uint32_t colour = UINT32_MAX;
        steps_of(p, m->plus, most, shift, r->q);
        if (red) {
            uint64_t v = colour_at(p + red) >> by;
            colour = 0xff000000 | (uint32_t)(v >> 32 & 255) << 16 | (uint32_t)(v >> 16 & 255) << 8 |
                     (uint32_t)(v & 255);
        }
        for (int k = 0; k < 4; k++) r->colour[k] = (uint8_t)(colour >> 8 * k);
        to[i] = cell[pbs_clod_place(&t->grid, r->q)];
    }
    b->taken += n;
}

/* ---- batches ---- */

static pbs_code next_batch(void *ctx, void *slot, bool *end, pbs_err *err) {
    take *t = ctx;
    batch *b = slot;
    while (t->cloud < t->cloud_count && t->next == t->clouds[t->cloud].count)
        t->cloud++, t->next = 0;
    if ((*end = t->cloud == t->cloud_count)) return PBS_OK;
    uint64_t left = t->clouds[t->cloud].count - t->next;
    b->cloud = t->cloud;
    b->first = t->next;
    b->count = left < BATCH ? (size_t)left : BATCH;
    t->next += b->count;
    return pbs_run_check(t->run, err);
}

static pbs_code work_values(const take *t, batch *b, pbs_err *err) {
    const pbs_cloud *c = &t->clouds[b->cloud];
    bool colours = t->kind == TAKE ? c->colour != PBS_CLOUD_NO_COLOUR
                                   : t->kind == MEASURE && c->colour == PBS_CLOUD_COLOUR_ANY;
    pbs_code rc = PBS_OK;
    for (size_t i = 0, n; i < b->count && !rc; i += n) {
        n = b->count - i < PART ? b->count - i : PART;
        rc = pbs_cloud_read(c, b->first + i, n, b->value, colours ? b->colour : NULL, err);
        if (rc) break;
        if (t->kind == MEASURE)
            add_bounds(&b->bounds, (const double(*)[3])b->value,
                       colours ? (const uint16_t(*)[3])b->colour : NULL, n);
        else
            take_values(t, b, colours, n);
    }
    return rc;
}

static pbs_code work_records(const take *t, batch *b, pbs_err *err) {
    const pbs_cloud *c = &t->clouds[b->cloud];
    const size_t most = PIECE / c->stride;
    pbs_code rc = PBS_OK;
    for (size_t i = 0, n; i < b->count && !rc; i += n) {
        const uint8_t *p;
        n = b->count - i < most ? b->count - i : most;
        rc = pbs_cloud_records(c, b->first + i, n, b->piece, &p, err);
        if (rc) break;
        if (t->kind == MEASURE || t->kind == MEASURE_AND_COUNT)
            add_record_bounds(&b->bounds, c, p, n);
        if (t->kind == COUNT || t->kind == MEASURE_AND_COUNT) count_records(t, b, p, n);
        if (t->kind == TAKE) take_records(t, b, p, n);
    }
    return rc;
}

/* Sorts a batch by its cells, in the order that they come in. */
static void group(batch *b, uint32_t *seen) {
    uint32_t at = 0;
    b->run_count = 0;
    for (size_t i = 0; i < b->taken; i++)
        if (!seen[b->cell[i]]++) b->run[b->run_count++].cell = b->cell[i];
    for (size_t r = 0; r < b->run_count; r++) {
        uint32_t *n = &seen[b->run[r].cell], first = at;
        b->run[r].end = at += *n;
        *n = first;
    }
    for (size_t i = 0; i < b->taken; i++) b->sorted[seen[b->cell[i]]++] = b->raw[i];
    for (size_t r = 0; r < b->run_count; r++) seen[b->run[r].cell] = 0;
}

static pbs_code work_batch(void *ctx, void *slot, int thread, pbs_err *err) {
    const take *t = ctx;
    batch *b = slot;
    const pbs_cloud *c = &t->clouds[b->cloud];
    b->taken = 0;
    b->bounds = PBS_CLOUD_NOTHING;
    bool whole = c->lattice && (t->kind == MEASURE || t->maps[b->cloud].whole);
    pbs_code rc = whole ? work_records(t, b, err) : work_values(t, b, err);
    if (!rc && t->kind == TAKE) group(b, t->seen[thread]);
    return rc;
}

/* The points of one cell after those that it has. */
static pbs_code put_points(take *t, uint32_t cell, const pbs_clod_raw *points, size_t n,
                           pbs_err *err) {
    const pbs_clod_cell *c = &t->out->cells.cell[cell];
    uint64_t at = t->at[cell];
    if (at + n > c->first + c->count)
        return pbs_fail(err, PBS_IO, "the points changed while they were read");
    t->at[cell] += n;
    return pbs_scratch_write(&t->out->raw, at * sizeof *points, n * sizeof *points, points, err);
}

static pbs_code sink_batch(void *ctx, void *slot, pbs_err *err) {
    static const char *const name[] = {"bounds", "cells", "bounds", "points"};
    take *t = ctx;
    const batch *b = slot;
    pbs_code rc = PBS_OK;
    if (t->kind == MEASURE || t->kind == MEASURE_AND_COUNT)
        pbs_cloud_bounds_merge(&t->bounds[b->cloud], &b->bounds);
    if (t->kind == COUNT || t->kind == MEASURE_AND_COUNT)
        for (size_t i = 0; i < b->taken; i++) t->grid.count[b->cell[i]]++;
    if (t->kind == TAKE)
        for (size_t r = 0, first = 0; r < b->run_count && !rc; first = b->run[r++].end)
            rc = put_points(t, b->run[r].cell, b->sorted + first, b->run[r].end - first, err);
    t->done += b->count;
    pbs_trim_now(&t->out->trim);
    pbs_run_progress(t->run, name[t->kind], t->done, t->all);
    return rc;
}

static pbs_code batch_new(const take *t, batch *b, pbs_err *err) {
    const char *what = "a batch of points";
    const size_t n = t->all < BATCH ? (size_t)t->all : BATCH;
    memset(b, 0, sizeof *b);
    pbs_code rc = pbs_alloc(t->run, &b->piece, PIECE, 1, what, err);
    if (!rc) rc = pbs_alloc(t->run, &b->value, PART, sizeof *b->value, what, err);
    if (!rc) rc = pbs_alloc(t->run, &b->colour, PART, sizeof *b->colour, what, err);
    if (!rc) rc = pbs_alloc(t->run, &b->raw, n, sizeof *b->raw, what, err);
    if (!rc) rc = pbs_alloc(t->run, &b->sorted, n, sizeof *b->sorted, what, err);
    if (!rc) rc = pbs_alloc(t->run, &b->cell, n, sizeof *b->cell, what, err);
    if (!rc) rc = pbs_alloc(t->run, &b->run, n, sizeof *b->run, what, err);
    return rc;
}

static void batch_free(pbs_run *run, batch *b) {
    pbs_free(run, b->piece);
    pbs_free(run, b->value);
    pbs_free(run, b->colour);
    pbs_free(run, b->raw);
    pbs_free(run, b->sorted);
    pbs_free(run, b->cell);
    pbs_free(run, b->run);
}

static pbs_code pass(take *t, pass_kind kind, pbs_err *err) {
    pbs_pipe pipe = {.ctx = t,
                     .source = next_batch,
                     .work = work_batch,
                     .sink = sink_batch,
                     .slots = t->slots,
                     .slot_size = sizeof *t->slots,
                     .slot_count = t->slot_count};
    t->kind = kind;
    t->cloud = 0;
    t->next = t->done = 0;
    return pbs_pipe_run(t->run, &pipe, err);
}

/* ---- bounds and counts ---- */

static pbs_code choose(take *t, const pbs_cloud_bounds *bounds, pbs_err *err) {
    return pbs_cloud_lattice_choose(t->clouds, t->cloud_count, bounds, t->all, &t->out->lattice,
                                    t->maps, err);
}

static pbs_code new_grid(take *t, pbs_err *err) {
    int bits = t->out->lattice.bits;
    return pbs_clod_grid_new(t->run, bits, pbs_cloud_grid_depth(t->all, bits), &t->grid, err);
}

static bool all_whole(const take *t) {
    for (size_t c = 0; c < t->cloud_count; c++)
        if (!t->maps[c].whole) return false;
    return true;
}

/* Whether counting can begin before bounds are known: a grid for the box that files say. */
static bool guess(take *t) {
    pbs_err ignored;
    for (size_t c = 0; c < t->cloud_count; c++) {
        const pbs_cloud *cloud = &t->clouds[c];
        if (!cloud->lattice || !(cloud->said_low[0] <= cloud->said_high[0])) return false;
        t->bounds[c] = PBS_CLOUD_NOTHING;
        memcpy(t->bounds[c].low, cloud->said_low, sizeof cloud->said_low);
        memcpy(t->bounds[c].high, cloud->said_high, sizeof cloud->said_high);
    }
    if (choose(t, t->bounds, &ignored) || !all_whole(t)) return false;
    int depth = pbs_cloud_grid_depth(t->all, t->out->lattice.bits);
    /* Another one may come beside it. */
    if (((size_t)16 << 3 * depth) > pbs_mem_left(t->run) / 4) return false;
    return !new_grid(t, &ignored);
}

/* All values in the box that was guessed. */
static bool guess_was_right(const take *t, const pbs_cloud_map *maps, int bits) {
    for (size_t c = 0; c < t->cloud_count; c++)
        for (int k = 0; k < 3 && t->clouds[c].count; k++)
            if (t->bounds[c].low[k] + maps[c].add[k] < 0 ||
                t->bounds[c].high[k] + maps[c].add[k] >= ldexp(1, bits))
                return false;
    return true;
}

static uint32_t gather3(uint32_t v) {
    uint32_t r = 0;
    for (int i = 0; i < PBS_CLOD_DEPTH; i++) r |= (v >> 3 * i & 1) << i;
    return r;
}

/* Counts of a guessed grid become those of the right one, whose cells are the same. */
static void move_counts(take *t, const pbs_clod_grid *from, const uint32_t by[3]) {
    int side = t->grid.bits - t->grid.depth;
    for (uint32_t i = 0; i < (uint32_t)1 << 3 * from->depth; i++) {
        if (!from->count[i]) continue;
        uint32_t q[3];
        for (int k = 0; k < 3; k++) q[k] = (gather3(i >> k) << side) + by[k];
        t->grid.count[pbs_clod_place(&t->grid, q)] += from->count[i];
    }
}

/* The grid of the lattice, counted, and the bounds; one pass if the guess holds. */
static pbs_code measure_and_count(take *t, pbs_err *err) {
    bool guessed = guess(t), right = false;
    pbs_clod_grid before = t->grid;
    pbs_cloud_map first = t->maps[0];
    for (size_t c = 0; c < t->cloud_count; c++) t->bounds[c] = PBS_CLOUD_NOTHING;
    pbs_code rc = pass(t, guessed ? MEASURE_AND_COUNT : MEASURE, err);
    memset(&t->grid, 0, sizeof t->grid);
    if (!rc && guessed) right = guess_was_right(t, t->maps, before.bits);
    if (!rc) rc = choose(t, t->bounds, err);
    if (!rc) rc = new_grid(t, err);
    if (!rc && right && all_whole(t) &&
        t->grid.bits - t->grid.depth == before.bits - before.depth) {
        uint32_t by[3];
        for (int k = 0; k < 3; k++) by[k] = t->maps[0].plus[k] - first.plus[k];
        move_counts(t, &before, by);
    } else if (!rc)
        rc = pass(t, COUNT, err);
    pbs_clod_grid_free(t->run, &before);
    return rc;
}

/* Each 2^by steps of the lattice become one; a point moves by half of that at most. */
static void coarsen(take *t, int by) {
    pbs_cloud_lattice *l = &t->out->lattice;
    double half = (ldexp(1, by) - 1) / 2, step = l->step;
    if (!by) return;
    for (int k = 0; k < 3; k++) l->origin[k] += half * step;
    l->step = ldexp(step, by);
    l->bound += sqrt(3) * half * step;
    l->bits -= by, l->shift += by;
    t->grid.bits = l->bits;
}

static double cubes_borne(const take *t) {
    return t->out->cubes ? t->out->cubes : PBS_CLOUD_CUBES;
}

/* ---- all ---- */

static void trim(void *t) {
    pbs_trim_now(t);
}

static void free_places(take *t) {
    for (int i = 0; i < t->run->threads && t->seen; i++) {
        pbs_free(t->run, t->seen[i]);
        t->seen[i] = NULL;
    }
    pbs_free(t->run, t->at);
    t->at = NULL;
}

static pbs_code new_places(take *t, pbs_err *err) {
    const pbs_clod_cells *cells = &t->out->cells;
    const size_t threads = (size_t)t->run->threads;
    pbs_code rc = pbs_alloc(t->run, &t->at, cells->count, sizeof *t->at, "the cells", err);
    for (size_t i = 0; i < cells->count && !rc; i++) t->at[i] = cells->cell[i].first;
    for (size_t i = 0; i < threads && !rc; i++) {
        rc = pbs_alloc(t->run, &t->seen[i], cells->count, sizeof **t->seen, "the cells", err);
        if (!rc) memset(t->seen[i], 0, cells->count * sizeof **t->seen);
    }
    return rc;
}

static pbs_code sort_points(take *t, size_t most, pbs_err *err) {
    pbs_cloud_points *out = t->out;
    pbs_clod_cells_free(t->run, &out->cells);
    out->cells.most = most;
    pbs_code rc = pbs_clod_cells_of(t->run, &t->grid, 0, &out->cells, err);
    if (!rc) rc = new_places(t, err);
    if (!rc) rc = pass(t, TAKE, err);
    free_places(t);
    return rc ? rc : pbs_clod_cut(t->run, out->raw.bytes, &out->cells, trim, &out->trim, err);
}

/* More are too many, unless it is density that makes them. */
static size_t most_cells(const take *t) {
    double all = cubes_borne(t);
    size_t most = (size_t)(t->out->lattice.bound > 0 ? all / 4 : all), dense = t->all / 8192;
    return dense > most ? dense : most;
}

/* Cells may turn out to be more than was thought, and memory grows with them: then the lattice is
 * made coarser still. */
static pbs_code sort_into_few_cells(take *t, pbs_err *err) {
    pbs_code rc = pbs_scratch_within(t->run, (size_t)t->out->count, sizeof(pbs_clod_raw),
                                     "the points", IN_MEMORY, &t->out->raw, err);
    if (!rc && t->out->raw.is_file)
        pbs_trim_add(&t->out->trim, t->out->raw.bytes, t->out->raw.size);
    if (!rc) rc = sort_points(t, most_cells(t), err);
    while (rc && t->out->cells.too_many) {
        int least = PBS_CLOD_SIDE > t->grid.depth ? PBS_CLOD_SIDE : t->grid.depth;
        bool dense = t->out->lattice.bits - 2 < least;
        if (!dense) coarsen(t, 2);
        rc = sort_points(t, dense ? 0 : most_cells(t), err);
    }
    return rc;
}

static pbs_code take_all(take *t, pbs_err *err) {
    pbs_code rc = measure_and_count(t, err);
    if (rc) return rc;
    for (size_t c = 0; c < t->cloud_count; c++) t->out->left_out += t->bounds[c].bad;
    t->out->count = t->all - t->out->left_out;
    for (size_t c = 0; c < t->cloud_count; c++)
        t->out->colours |= t->clouds[c].colour != PBS_CLOUD_NO_COLOUR;
    pbs_cloud_choose_colours(t->clouds, t->cloud_count, t->bounds, t->maps);
    coarsen(t, pbs_cloud_too_fine(&t->out->lattice, &t->grid, t->out->count, cubes_borne(t)));
    return sort_into_few_cells(t, err);
}

static pbs_code take_new(take *t, pbs_err *err) {
    pbs_run *run = t->run;
    const char *what = "the clouds";
    const size_t threads = (size_t)run->threads, slots = (size_t)t->slot_count;
    pbs_code rc = pbs_alloc(run, &t->maps, t->cloud_count, sizeof *t->maps, what, err);
    if (!rc) memset(t->maps, 0, t->cloud_count * sizeof *t->maps);
    if (!rc) rc = pbs_alloc(run, &t->bounds, t->cloud_count, sizeof *t->bounds, what, err);
    if (!rc) rc = pbs_alloc(run, &t->seen, threads, sizeof *t->seen, what, err);
    if (!rc) memset(t->seen, 0, threads * sizeof *t->seen);
    if (!rc) rc = pbs_alloc(run, &t->slots, slots, sizeof *t->slots, what, err);
    if (!rc) memset(t->slots, 0, slots * sizeof *t->slots);
    for (size_t i = 0; i < slots && !rc; i++) rc = batch_new(t, &t->slots[i], err);
    return rc;
}

static void take_free(take *t) {
    for (int i = 0; i < t->slot_count && t->slots; i++) batch_free(t->run, &t->slots[i]);
    free_places(t);
    pbs_free(t->run, t->slots);
    pbs_free(t->run, t->seen);
    pbs_free(t->run, t->maps);
    pbs_free(t->run, t->bounds);
    pbs_clod_grid_free(t->run, &t->grid);
}

/* Pages of files are memory as other memory is. A quarter is left for those that come in before the
 * next look at how many there are. */
static pbs_code hold(pbs_cloud_points *p, uint64_t points, pbs_err *err) {
    size_t held = pbs_mem_left(p->run) / 4;
    if (held > HELD) held = HELD;
    if (held / HELD_POINT > points) held = (size_t)points * HELD_POINT;
    pbs_code rc = pbs_mem_take(p->run, held, "pages of files", err);
    if (rc) return rc;
    p->held = held;
    p->trim.limit = held - held / 4 + PROGRAM;
    return PBS_OK;
}

pbs_code pbs_cloud_take(pbs_run *run, const pbs_cloud *clouds, size_t count, pbs_cloud_points *p,
                        pbs_err *err) {
    take t = {.run = run,
              .clouds = clouds,
              .cloud_count = count,
              .out = p,
              .slot_count = 2 * run->threads};
    p->run = run;
    pbs_trim_open(run, &p->trim);
    for (size_t c = 0; c < count; c++) {
        pbs_cloud_trim(&clouds[c], &p->trim);
        t.all += clouds[c].count;
    }
    pbs_code rc = hold(p, t.all, err);
    if (!rc) rc = take_new(&t, err);
    if (!rc) rc = take_all(&t, err);
    take_free(&t);
    p->trim.count = 0;
    for (size_t c = 0; c < count; c++) { /* they are not looked at again */
        pbs_pages_rest(clouds[c].in.bytes, (size_t)clouds[c].in.size);
        pbs_pages_rest(clouds[c].own.bytes, (size_t)clouds[c].own.size);
    }
    if (p->raw.is_file) pbs_trim_add(&p->trim, p->raw.bytes, p->raw.size);
    return rc;
}

static pbs_code read_points(void *ctx, uint64_t at, size_t size, void *to, pbs_err *err) {
    return pbs_scratch_read(&((pbs_cloud_points *)ctx)->raw, at, size, to, err);
}
static pbs_code write_points(void *ctx, uint64_t at, size_t size, const void *from, pbs_err *err) {
    return pbs_scratch_write(&((pbs_cloud_points *)ctx)->raw, at, size, from, err);
}
static pbs_code more_room(void *ctx, size_t size, void **out, pbs_err *err) {
    pbs_cloud_points *p = ctx;
    pbs_code rc =
        pbs_scratch_within(p->run, size, 1, "coarse points", REST_IN_MEMORY, &p->rest, err);
    if (!rc && p->rest.is_file) pbs_trim_add(&p->trim, p->rest.bytes, p->rest.size);
    *out = p->rest.bytes;
    return rc;
}
static void give_back(void *ctx) {
    pbs_trim_now(&((pbs_cloud_points *)ctx)->trim);
}
pbs_clod_store pbs_cloud_store(pbs_cloud_points *p) {
    return (pbs_clod_store){p, read_points, write_points, more_room, give_back};
}

void pbs_cloud_points_free(pbs_run *run, pbs_cloud_points *p) {
    pbs_clod_cells_free(run, &p->cells);
    pbs_scratch_free(&p->raw);
    pbs_scratch_free(&p->rest);
    pbs_trim_close(&p->trim);
    pbs_mem_give(run, p->held);
    p->held = 0;
}
