/* The octree of cells of a point cloud (clod.h): from the counts of a grid, and by cutting. */
#include "libcore/clouds/clod_internal.h"
#include <string.h>

enum {
    CUT_DEPTH = 5,    /* of the grid that a cell is cut by, at most */
    CUT_POINTS = 1024 /* of a surface in a cell of it, or more */
};

pbs_code pbs_clod_grid_new(pbs_run *run, int bits, int depth, pbs_clod_grid *g, pbs_err *err) {
    size_t n = (size_t)1 << 3 * depth;
    *g = (pbs_clod_grid){.bits = bits, .depth = depth};
    for (uint32_t v = 0; v < 1u << PBS_CLOD_DEPTH; v++)
        for (int i = 0; i < PBS_CLOD_DEPTH; i++) g->spread[v] |= (v >> i & 1) << 3 * i;
    pbs_code rc = pbs_alloc(run, &g->count, n, sizeof *g->count, "the grid of cells", err);
    if (!rc) rc = pbs_alloc(run, &g->cell, n, sizeof *g->cell, "the grid of cells", err);
    if (rc)
        pbs_clod_grid_free(run, g);
    else
        memset(g->count, 0, n * sizeof *g->count);
    return rc;
}

void pbs_clod_grid_free(pbs_run *run, pbs_clod_grid *g) {
    pbs_free(run, g->count);
    pbs_free(run, g->cell);
    memset(g, 0, sizeof *g);
}

static inline uint32_t gather3(uint32_t v) {
    uint32_t r = 0;
    for (int i = 0; i < 10; i++) r |= (v >> 3 * i & 1) << i;
    return r;
}

/* What cutting needs. */
typedef struct cutter {
    pbs_run *run;
    pbs_clod_raw *raw;
    pbs_clod_cells *out;
    void (*done)(void *ctx);
    void *ctx;
    pbs_clod_looks looks; /* of whatever cell */
} cutter;

typedef struct builder {
    pbs_run *run;
    pbs_clod_grid *g;
    pbs_clod_cells *out;
    uint64_t first;
} builder;

static bool fits(int bits, uint64_t count) {
    return bits <= PBS_CLOD_SIDE && (count <= PBS_CLOD_CELL || !bits);
}

static pbs_code add(pbs_run *run, pbs_clod_cells *to, const pbs_clod_cell *c, pbs_err *err) {
    to->too_many = to->most && to->count == to->most;
    if (to->too_many) return pbs_fail(err, PBS_LIMIT, "points too far apart for the lattice");
    pbs_code rc =
        pbs_grow(run, &to->cell, &to->room, to->count + 1, sizeof *to->cell, "the cells", err);
    if (!rc) to->cell[to->count++] = *c;
    return rc;
}

/* The cells of one place of the grid at a depth. */
static pbs_code build(builder *b, uint32_t place, int depth, pbs_err *err) {
    const pbs_clod_grid *g = b->g;
    int below = g->depth - depth, bits = g->bits - depth;
    size_t begin = (size_t)place << 3 * below, end = ((size_t)place + 1) << 3 * below;
    uint64_t count = 0;
    pbs_code rc = PBS_OK;
    for (size_t i = begin; i < end; i++) count += g->count[i];
    if (!count) return PBS_OK;
    if (depth < g->depth && !fits(bits, count)) {
        for (uint32_t i = 0; i < 8 && !rc; i++) rc = build(b, 8 * place + i, depth + 1, err);
        return rc;
    }
    for (size_t i = begin; i < end; i++) g->cell[i] = (uint32_t)b->out->count;
    pbs_clod_cell c = {.bits = (int8_t)bits, .first = b->first, .count = count};
    for (int k = 0; k < 3; k++) c.origin[k] = g->origin[k] + (gather3(place >> k) << bits);
    b->first += count;
    return add(b->run, b->out, &c, err);
}

pbs_code pbs_clod_cells_of(pbs_run *run, pbs_clod_grid *g, uint64_t first, pbs_clod_cells *out,
                           pbs_err *err) {
    builder b = {run, g, out, first};
    return build(&b, 0, 0, err);
}

static inline void look(cutter *u, const pbs_clod_raw *at) {
    if (pbs_clod_look(&u->looks, at) && u->done) u->done(u->ctx);
}

/* Puts points in the order of the cells that the grid found, within their own room. */
static void permute(cutter *u, const pbs_clod_grid *g, const pbs_clod_cells *cells, uint64_t *at) {
    pbs_clod_raw *raw = u->raw;
    for (size_t c = 0; c < cells->count; c++) at[c] = cells->cell[c].first;
    for (size_t c = 0; c < cells->count; c++) {
        uint64_t end = cells->cell[c].first + cells->cell[c].count;
        while (at[c] < end) {
            pbs_clod_raw p = raw[at[c]];
            for (uint32_t to; (to = g->cell[pbs_clod_place(g, p.q)]) != c;) {
                pbs_clod_raw other = raw[at[to]];
                raw[at[to]++] = p;
                p = other;
                look(u, &raw[at[to]]);
            }
            look(u, &raw[at[c]]);
            raw[at[c]++] = p;
        }
    }
}

static pbs_code cut(cutter *u, const pbs_clod_cell *c, pbs_err *err);

/* One grid's worth of cutting, then what is still too much. */
static pbs_code cut_once(cutter *u, const pbs_clod_cell *c, pbs_clod_grid *g, pbs_clod_cells *parts,
                         pbs_err *err) {
    uint64_t *at = NULL;
    memcpy(g->origin, c->origin, sizeof g->origin);
    for (uint64_t i = c->first; i < c->first + c->count; i++) {
        g->count[pbs_clod_place(g, u->raw[i].q)]++;
        look(u, &u->raw[i]);
    }
    pbs_code rc = pbs_clod_cells_of(u->run, g, c->first, parts, err);
    if (!rc) rc = pbs_alloc(u->run, &at, parts->count, sizeof *at, "the cells", err);
    if (!rc) permute(u, g, parts, at);
    pbs_free(u->run, at);
    pbs_clod_grid_free(u->run, g);
    for (size_t i = 0; i < parts->count && !rc; i++) rc = cut(u, &parts->cell[i], err);
    return rc;
}

static pbs_code cut(cutter *u, const pbs_clod_cell *c, pbs_err *err) {
    pbs_clod_cells *out = u->out;
    pbs_code rc = pbs_run_check(u->run, err);
    if (rc) return rc;
    if (fits(c->bits, c->count)) return add(u->run, out, c, err);
    pbs_clod_grid g;
    pbs_clod_cells parts = {0};
    int depth = 1;
    while (depth < CUT_DEPTH && depth < c->bits && c->count >> 2 * depth > CUT_POINTS) depth++;
    rc = pbs_clod_grid_new(u->run, c->bits, depth, &g, err);
    if (rc) return rc;
    rc = cut_once(u, c, &g, &parts, err);
    pbs_clod_grid_free(u->run, &g);
    pbs_free(u->run, parts.cell);
    return rc;
}

/* Gives back the room that they have beyond what they need, which lasts. */
static pbs_code fit(pbs_run *run, pbs_clod_cells *c, pbs_err *err) {
    pbs_clod_cell *exact;
    pbs_code rc = pbs_alloc(run, &exact, c->count, sizeof *exact, "the cells", err);
    if (rc) return rc;
    memcpy(exact, c->cell, c->count * sizeof *exact);
    pbs_free(run, c->cell);
    c->cell = exact, c->room = c->count;
    return PBS_OK;
}

pbs_code pbs_clod_cut(pbs_run *run, pbs_clod_raw *raw, pbs_clod_cells *cells,
                      void (*done)(void *ctx), void *ctx, pbs_err *err) {
    pbs_clod_cells out = {.most = cells->most, .piece = cells->piece};
    cutter u = {run, raw, &out, done, ctx, {0, 0}};
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < cells->count && !rc; i++) rc = cut(&u, &cells->cell[i], err);
    if (done) done(ctx);
    pbs_free(run, cells->cell);
    *cells = out;
    return rc || !out.count ? rc : fit(run, cells, err);
}

void pbs_clod_cells_free(pbs_run *run, pbs_clod_cells *cells) {
    pbs_free(run, cells->cell);
    memset(cells, 0, sizeof *cells);
}
