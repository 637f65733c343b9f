/* Levels of a point cloud: the cells in their groups, and what is left of them (clod.h). */
#include "libcore/clouds/clod_internal.h"
#include "libcore/ground/pipe.h"
#include <string.h>

/* ---- groups of cells that do not touch ---- */

enum { GROUPS = (PBS_CLOD_SIDE + 1) * 8 };

/* Small cells first: what they leave is little, and large ones are few. */
static int group_of(const pbs_clod_cell *c) {
    int parity = 0;
    for (int k = 0; k < 3; k++) parity |= (int)(c->origin[k] >> c->bits & 1) << k;
    return 8 * c->bits + parity;
}

typedef struct job {
    pbs_run *run;
    const pbs_clod_store *store;
    const pbs_clod_cells *cells;
    pbs_clod_work *work; /* one a thread */
    const uint32_t *group;
} job;

/* The first cell that does not come before a place. */
static size_t lower_bound(const pbs_clod_cells *cells, const uint32_t at[3]) {
    size_t low = 0, high = cells->count;
    while (low < high) {
        size_t mid = low + (high - low) / 2;
        if (pbs_clod_before(cells->cell[mid].origin, at))
            low = mid + 1;
        else
            high = mid;
    }
    return low;
}

/* The cells that are in the place of a neighbour of c's size, or are it, and came before c. */
static pbs_code take_neighbour(const job *j, const pbs_clod_cell *c, const int64_t at[3],
                               pbs_clod_work *w, pbs_err *err) {
    uint32_t origin[3];
    int64_t low[3], high[3];
    for (int k = 0; k < 3; k++) {
        low[k] = c->origin[k], high[k] = low[k] + ((int64_t)1 << c->bits) - 1;
        if (at[k] < 0 || at[k] >= (int64_t)1 << PBS_CLOD_BITS) return PBS_OK;
        origin[k] = (uint32_t)at[k];
    }
    pbs_code rc = PBS_OK;
    for (size_t i = lower_bound(j->cells, origin); i < j->cells->count && !rc; i++) {
        const pbs_clod_cell *o = &j->cells->cell[i];
        bool in = true;
        for (int k = 0; k < 3; k++) in = in && o->origin[k] >> c->bits == origin[k] >> c->bits;
        if (!in) break;
        if (group_of(o) < group_of(c))
            rc = pbs_clod_take_border(&w->thin, j->store, o, low, high, 0, (void *)w->other, err);
    }
    return rc;
}

static pbs_code thin_one(void *ctx, size_t i, int thread, pbs_err *err) {
    const job *j = ctx;
    pbs_clod_cell *c = &j->cells->cell[j->group[i]];
    pbs_clod_work *w = &j->work[thread];
    const int64_t side = (int64_t)1 << c->bits;
    pbs_code rc = PBS_OK;
    w->thin.fixed_count = 0;
    for (int n = 0; n < 27 && !rc; n++) {
        int64_t at[3] = {c->origin[0] + (n % 3 - 1) * side, c->origin[1] + (n / 3 % 3 - 1) * side,
                         c->origin[2] + (n / 9 - 1) * side};
        if (n != 13) rc = take_neighbour(j, c, at, w, err);
    }
    return rc ? rc : pbs_clod_thin_cell(j->store, c, w, err);
}

static pbs_code thin_groups(job *j, uint32_t *order, pbs_err *err) {
    size_t at[GROUPS + 1] = {0}, end[GROUPS];
    const pbs_clod_cells *cells = j->cells;
    for (size_t i = 0; i < cells->count; i++) at[group_of(&cells->cell[i]) + 1]++;
    for (int g = 0; g < GROUPS; g++) at[g + 1] += at[g];
    memcpy(end, at, sizeof end);
    for (size_t i = 0; i < cells->count; i++) order[end[group_of(&cells->cell[i])]++] = (uint32_t)i;
    pbs_code rc = PBS_OK;
    for (int g = 0; g < GROUPS && !rc; g++) {
        if (at[g] == end[g]) continue;
        j->group = order + at[g];
        rc = pbs_parallel(j->run, end[g] - at[g], thin_one, j, err);
        pbs_run_progress(j->run, "levels", end[g], cells->count);
    }
    return rc;
}

pbs_code pbs_clod_thin(pbs_run *run, const pbs_clod_store *store, pbs_clod_cells *cells,
                       bool colours, pbs_err *err) {
    job j = {.run = run, .store = store, .cells = cells};
    size_t threads = (size_t)run->threads;
    uint32_t *order = NULL;
    pbs_code rc = pbs_alloc(run, &j.work, threads, sizeof *j.work, "the threads", err);
    if (rc) return rc;
    memset(j.work, 0, threads * sizeof *j.work);
    for (size_t i = 0; i < threads && !rc; i++)
        rc = pbs_clod_work_new(run, colours, &j.work[i], err);
    if (!rc) rc = pbs_alloc(run, &order, cells->count, sizeof *order, "the cells", err);
    if (!rc) rc = thin_groups(&j, order, err);
    pbs_free(run, order);
    for (size_t i = 0; i < threads; i++) pbs_clod_work_free(run, &j.work[i]);
    pbs_free(run, j.work);
    return rc;
}
