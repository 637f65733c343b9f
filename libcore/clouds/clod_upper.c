/* clod_upper.c: what is left of the cells of a point cloud, through the coarser levels (clod.h).
 *
 * Of each level there are cubes with few points, one after the other in Morton order; those near
 * the faces of a cube are fixed for the cubes that come later. Up to PBS_CLOD_PIECE points are one
 * cube. */
#include "libcore/clouds/clod_internal.h"
#include <string.h>

/* A cube that is done. */
typedef struct piece {
    int64_t low[3], high[3]; /* box around its points */
    size_t first, end;       /* of those near its faces */
} piece;

typedef struct upper {
    pbs_run *run;
    const pbs_clod_store *store;
    const pbs_clod_cells *cells;
    pbs_clod_upper *out;
    pbs_clod_border *border;
    pbs_thin thin;
    pbs_thin_set set, kept, rejected; /* set: of more than one cube */
    uint32_t most;                    /* points of a cube */
    size_t room, next;                /* of the set; which rest is looked at next */
    uint32_t at;                      /* first of the set that is not done */
    bool before;                      /* there was one before it: */
    uint32_t last[3];
    piece *piece;
    size_t piece_count, piece_room;
    int32_t (*face)[3];
    size_t face_count, face_room;
    pbs_clod_looks looks; /* at what is left */
} upper;

static void give_back(const upper *u) {
    if (u->store->done) u->store->done(u->store->ctx);
}

/* ---- the points ---- */

static pbs_code take_rests(upper *u, bool colours, pbs_err *err) {
    pbs_clod_upper *out = u->out;
    pbs_clod_work w = {0};
    size_t n = 0;
    for (size_t i = 0; i < u->cells->count; i++) n += u->cells->cell[i].rest_count;
    pbs_code rc =
        u->store->more
            ? u->store->more(u->store->ctx, n * sizeof *out->rest, (void **)&out->rest, err)
            : pbs_alloc(u->run, &out->rest, n, sizeof *out->rest, "coarse points", err);
    out->stored = u->store->more != NULL;
    if (!rc)
        rc = pbs_alloc(u->run, &out->first, u->cells->count + 1, sizeof *out->first,
                       "coarse points", err);
    if (!rc) rc = pbs_clod_work_new(u->run, colours, &w, err);
    for (size_t i = 0; i < u->cells->count && !rc; i++) {
        const pbs_clod_cell *c = &u->cells->cell[i];
        out->first[i] = out->count;
        rc = pbs_clod_take_rest(u->store, c, colours, &w, out->rest + out->count, err);
        out->count += c->rest_count;
        if (i % 64 == 63) give_back(u);
    }
    if (!rc) out->first[u->cells->count] = out->count;
    pbs_clod_work_free(u->run, &w);
    return rc;
}

/* ---- cubes ---- */

static void position(const pbs_thin_set *s, uint32_t i, uint32_t q[3]) {
    q[0] = (uint32_t)s->x[i], q[1] = (uint32_t)s->y[i], q[2] = (uint32_t)s->z[i];
}

/* Bits of the smallest cube of the octree that two points are in. */
static int cube_of(const uint32_t a[3], const uint32_t b[3]) {
    uint32_t differ = (a[0] ^ b[0]) | (a[1] ^ b[1]) | (a[2] ^ b[2]);
    return differ ? 32 - __builtin_clz(differ) : 0;
}

/* Fills the set with points of level k - 1, as long as there are and room is. */
static void fill(upper *u, int k) {
    pbs_thin_set *s = &u->set;
    uint32_t left = s->count - u->at;
    memmove(s->x, s->x + u->at, left * sizeof *s->x);
    memmove(s->y, s->y + u->at, left * sizeof *s->y);
    memmove(s->z, s->z + u->at, left * sizeof *s->z);
    memmove(s->id, s->id + u->at, left * sizeof *s->id);
    if (s->sum) memmove(s->sum, s->sum + 4 * (size_t)u->at, left * 4 * sizeof *s->sum);
    s->count = left, u->at = 0;
    for (; s->count < u->room && u->next < u->out->count; u->next++) {
        const pbs_clod_rest *r = &u->out->rest[u->next];
        if (u->next % 65536 == 65535) give_back(u);
        if (r->level != k - 1) continue;
        if (s->sum) memcpy(s->sum + 4 * (size_t)s->count, r->sum, sizeof r->sum);
        pbs_thin_put(s, (int32_t)r->q[0], (int32_t)r->q[1], (int32_t)r->q[2], (uint32_t)u->next);
    }
}

/* The largest cube that begins with the next point, holds none before it and few enough: its bits,
 * and the end of its points. */
static int next_cube(const upper *u, uint32_t *end) {
    const pbs_thin_set *s = &u->set;
    uint32_t q[3], other[3];
    int bits = PBS_CLOD_BITS + 1;
    position(s, u->at, q);
    if (u->before) bits = cube_of(u->last, q) - 1;
    if (s->count - u->at > u->most) {
        position(s, u->at + u->most, other);
        if (cube_of(q, other) - 1 < bits) bits = cube_of(q, other) - 1;
    }
    uint32_t low = u->at + 1, high = s->count - u->at > u->most ? u->at + u->most : s->count;
    while (low < high) { /* the first that is not in it */
        uint32_t mid = low + (high - low) / 2;
        position(s, mid, other);
        if (cube_of(q, other) <= bits)
            low = mid + 1;
        else
            high = mid;
    }
    *end = low;
    return bits;
}

/* Points at, .. end - 1 of the set. */
static pbs_thin_set part_of(const pbs_thin_set *s, uint32_t at, uint32_t end) {
    return (pbs_thin_set){.x = s->x + at,
                          .y = s->y + at,
                          .z = s->z + at,
                          .id = s->id + at,
                          .sum = s->sum ? s->sum + 4 * (size_t)at : NULL,
                          .count = end - at};
}

static piece piece_of(const pbs_thin_set *s) {
    piece p = {{s->x[0], s->y[0], s->z[0]}, {s->x[0], s->y[0], s->z[0]}, 0, 0};
    for (uint32_t i = 1; i < s->count; i++) {
        const int32_t q[3] = {s->x[i], s->y[i], s->z[i]};
        for (int k = 0; k < 3; k++) {
            p.low[k] = q[k] < p.low[k] ? q[k] : p.low[k];
            p.high[k] = q[k] > p.high[k] ? q[k] : p.high[k];
        }
    }
    return p;
}

/* What a cube must respect: cells that decided level k themselves, and cubes before it. */
static pbs_code take_fixed(upper *u, const piece *p, int k, pbs_err *err) {
    const int64_t side = (int64_t)1 << k;
    pbs_code rc = PBS_OK;
    u->thin.fixed_count = 0;
    for (size_t i = 0; i < u->cells->count && !rc; i++) {
        const pbs_clod_cell *c = &u->cells->cell[i];
        int64_t low[3], high[3];
        if (pbs_clod_top(c) < k) continue;
        for (int a = 0; a < 3; a++) low[a] = c->low[a], high[a] = c->high[a];
        if (pbs_clod_is_near(p->low, p->high, low, high, (int64_t)1 << PBS_CLOD_SIDE))
            rc = pbs_clod_take_border(&u->thin, u->store, c, p->low, p->high, k, u->border, err);
    }
    for (size_t i = 0; i < u->piece_count && !rc; i++) {
        const piece *o = &u->piece[i];
        if (!pbs_clod_is_near(p->low, p->high, o->low, o->high, side)) continue;
        rc = pbs_thin_reserve_fixed(&u->thin, o->end - o->first, err);
        for (size_t f = o->first; f < o->end && !rc; f++) {
            const int64_t q[3] = {u->face[f][0], u->face[f][1], u->face[f][2]};
            struct pbs_thin_fixed *to = &u->thin.fixed[u->thin.fixed_count];
            *to = (struct pbs_thin_fixed){{u->face[f][0], u->face[f][1], u->face[f][2]}, k, 0};
            u->thin.fixed_count += pbs_clod_is_near(p->low, p->high, q, q, side);
        }
    }
    return rc;
}

/* Keeps those that stay near the faces of their cube. */
static pbs_code leave_faces(upper *u, piece p, int bits, int k, pbs_err *err) {
    const pbs_thin_set *s = &u->kept;
    const int64_t cube = (int64_t)1 << (bits < 0 ? 0 : bits), side = (int64_t)1 << k;
    pbs_code rc = pbs_grow(u->run, &u->piece, &u->piece_room, u->piece_count + 1, sizeof *u->piece,
                           "coarse points", err);
    if (!rc)
        rc = pbs_grow(u->run, &u->face, &u->face_room, u->face_count + s->count, sizeof *u->face,
                      "coarse points", err);
    if (rc) return rc;
    p.first = u->face_count;
    for (uint32_t i = 0; i < s->count; i++) {
        const int32_t q[3] = {s->x[i], s->y[i], s->z[i]};
        bool near = false;
        for (int a = 0; a < 3; a++) {
            int64_t from = q[a] & (cube - 1);
            near = near || from + 1 < side || cube - from < side;
        }
        if (near) memcpy(u->face[u->face_count++], q, sizeof q);
    }
    p.end = u->face_count;
    u->piece[u->piece_count++] = p;
    return PBS_OK;
}

static pbs_code thin_cube(upper *u, int k, bool more, pbs_err *err) {
    uint32_t end;
    int bits = next_cube(u, &end);
    pbs_thin_set part = part_of(&u->set, u->at, end);
    piece p = piece_of(&part);
    pbs_code rc = pbs_run_check(u->run, err);
    if (!rc) rc = take_fixed(u, &p, k, err);
    if (!rc) rc = pbs_thin_level(&u->thin, &part, k, false, &u->kept, &u->rejected, err);
    for (uint32_t i = 0; i < u->kept.count && !rc; i++) {
        pbs_clod_rest *r = &u->out->rest[u->kept.id[i]];
        r->level = (int8_t)k;
        if (u->kept.sum) memcpy(r->sum, u->kept.sum + 4 * (size_t)i, sizeof r->sum);
        if (pbs_clod_look(&u->looks, r)) give_back(u);
    }
    position(&u->set, end - 1, u->last);
    u->before = true;
    u->at = end;
    if (!rc && (more || u->at < u->set.count)) rc = leave_faces(u, p, bits, k, err);
    give_back(u);
    return rc;
}

static pbs_code upper_level(upper *u, int k, pbs_err *err) {
    pbs_code rc = PBS_OK;
    u->set.count = u->at = 0;
    u->next = 0;
    u->before = false;
    u->piece_count = u->face_count = 0;
    do {
        /* Whether a cube is small enough can be seen as long as there is one point more than it
         * may have. */
        if (u->set.count - u->at <= u->most) fill(u, k);
        if (u->at < u->set.count) rc = thin_cube(u, k, u->next < u->out->count, err);
    } while (!rc && (u->at < u->set.count || u->next < u->out->count));
    return rc;
}

static pbs_code upper_levels(upper *u, int top, pbs_err *err) {
    int least = top;
    for (size_t i = 0; i < u->cells->count; i++)
        if (pbs_clod_top(&u->cells->cell[i]) < least) least = pbs_clod_top(&u->cells->cell[i]);
    pbs_code rc = PBS_OK;
    for (int k = least + 1; k <= top && !rc; k++) {
        rc = upper_level(u, k, err);
        pbs_run_progress(u->run, "coarse levels", (uint64_t)(k - least), (uint64_t)(top - least));
    }
    return rc;
}

static pbs_code new_sets(upper *u, bool colours, pbs_err *err) {
    size_t n = u->out->count < u->most ? u->out->count : u->most;
    u->room = u->out->count < 2 * (size_t)u->most ? u->out->count : 2 * (size_t)u->most;
    pbs_code rc =
        pbs_alloc(u->run, &u->border, PBS_CLOD_BORDER, sizeof *u->border, "coarse points", err);
    if (!rc) rc = pbs_thin_new(u->run, n, &u->thin, err);
    if (!rc) rc = pbs_thin_set_new(u->run, u->room, colours, &u->set, err);
    if (!rc) rc = pbs_thin_set_new(u->run, n, colours, &u->kept, err);
    return rc ? rc : pbs_thin_set_new(u->run, n, colours, &u->rejected, err);
}

pbs_code pbs_clod_thin_upper(pbs_run *run, const pbs_clod_store *store, pbs_clod_cells *cells,
                             int top, bool colours, pbs_clod_upper *out, pbs_err *err) {
    upper u = {.run = run, .store = store, .cells = cells, .out = out};
    u.most = cells->piece ? cells->piece : PBS_CLOD_PIECE;
    memset(out, 0, sizeof *out);
    pbs_code rc = take_rests(&u, colours, err);
    if (!rc) rc = new_sets(&u, colours, err);
    if (!rc) rc = upper_levels(&u, top, err);
    pbs_free(run, u.border);
    pbs_free(run, u.piece);
    pbs_free(run, u.face);
    pbs_thin_free(&u.thin);
    pbs_thin_set_free(run, &u.set);
    pbs_thin_set_free(run, &u.kept);
    pbs_thin_set_free(run, &u.rejected);
    if (rc) pbs_clod_upper_free(run, out);
    return rc;
}

void pbs_clod_upper_free(pbs_run *run, pbs_clod_upper *u) {
    if (!u->stored) pbs_free(run, u->rest);
    pbs_free(run, u->first);
    memset(u, 0, sizeof *u);
}
