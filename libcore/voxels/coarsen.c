/* coarsen.c: all coarser levels of voxels while the finest stream by (paper 2, section 3, "Level of
 * detail"). coarsen_inner.h makes one level from another; here is when it does.
 *
 * Each level holds the cells that its parents are not made of yet. Once they are a block, they
 * become parents, which are cells of the next level, and go to the sink; only those of the last
 * parent stay, since more children of it may come. When a chunk ends, so does every chunk above it
 * that the next one is not in. */
#include "libcore/surfels/candidates.h"
#include "libcore/voxels/coarsen_inner.h"
#include "libcore/voxels/morton.h"
#include <string.h>

#define LEVELS_MAX 32
#define FAMILY     8 /* children of a parent, at most */
/* A level gets a block of parents while it holds less than a block. */
#define ROWS_ROOM (2 * PBS_COARSEN_BLOCK + PBS_COARSEN_SLACK)

typedef size_t step_fn(pbs_coarsen_block *b, const pbs_cell_rows *in, size_t n, pbs_cell_rows *out);

typedef struct level {
    pbs_cell_rows rows;
    uint32_t chunk[3];
    int64_t last; /* code of the last cell, at the coarsest level only */
} level;

struct pbs_coarsen {
    pbs_run *run;
    pbs_coarsen_sink sink;
    uint32_t channels, levels;
    bool face_colour, open; /* there was a chunk */
    step_fn *step;
    level level[LEVELS_MAX]; /* 0: voxels of the finest that are the last parent's so far */
    uint8_t *memory;
    pbs_coarsen_block block;
};

static size_t portable_step(pbs_coarsen_block *b, const pbs_cell_rows *in, size_t n,
                            pbs_cell_rows *out) {
    return coarsen_step(b, in, n, out);
}

/* ---- memory ---- */

static void *take(uint8_t *memory, size_t *used, size_t bytes) {
    size_t at = *used;
    *used += (bytes + 63) & ~(size_t)63;
    return memory ? memory + at : NULL;
}

/* Where the arrays of a level are; NULL only counts. */
static void lay_out(pbs_coarsen *c, uint32_t l, uint8_t *memory, size_t *used) {
    pbs_cell_rows *r = &c->level[l].rows;
    size_t n = l ? ROWS_ROOM : FAMILY + PBS_COARSEN_SLACK;
    uint32_t ch = c->channels;
    r->v.place = take(memory, used, 4 * n);
    if (ch & PBS_NORMAL) r->v.normal = take(memory, used, 4 * n);
    if (ch & PBS_WEIGHT) r->v.weight = take(memory, used, 4 * n);
    if (ch & PBS_COLOUR) r->v.colour = take(memory, used, 4 * n);
    if (ch & PBS_MATERIAL) r->v.material = take(memory, used, 4 * n);
    if (ch & PBS_EMISSIVE) r->v.emissive = take(memory, used, 4 * n);
    if (ch & PBS_FACE) {
        r->v.face = take(memory, used, 4 * n);
        r->faces = take(memory, used, 4 * 6 * n);
        if (l) r->face_weight = take(memory, used, 4 * 6 * n);
        if (l && c->face_colour) r->face_sum = take(memory, used, sizeof(f4) * 6 * n);
    }
    if (!l || !(ch & ~PBS_POSITION)) return;
    r->sum[PBS_SUM_BASE] = take(memory, used, sizeof(f4) * n);
    if (ch & PBS_COLOUR) r->sum[PBS_SUM_COLOUR] = take(memory, used, sizeof(f4) * n);
    if (ch & PBS_MATERIAL) r->sum[PBS_SUM_MATERIAL] = take(memory, used, sizeof(f4) * n);
    if (ch & PBS_EMISSIVE) r->sum[PBS_SUM_EMISSIVE] = take(memory, used, sizeof(f4) * n);
}

pbs_code pbs_coarsen_new(pbs_run *run, uint32_t channels, uint32_t levels, bool per_face_colour,
                         const pbs_coarsen_sink *sink, pbs_coarsen **out, pbs_err *err) {
    size_t used = 0;
    *out = NULL;
    if (levels >= LEVELS_MAX) return pbs_fail(err, PBS_INTERNAL, "%u levels of voxels", levels);
    pbs_coarsen *c;
    pbs_code rc = pbs_alloc(run, &c, 1, sizeof *c, "the levels of voxels", err);
    if (rc) return rc;
    memset(c, 0, sizeof *c);
    c->run = run;
    c->sink = *sink;
    c->channels = channels;
    c->levels = levels;
    c->face_colour = per_face_colour;
    c->block.channels = channels;
    c->block.srgb = pbs_srgb();
    c->step = portable_step;
#if defined(__x86_64__)
    if (pbs_cpu_has_avx2()) c->step = pbs_coarsen_step_avx2;
#endif
    for (uint32_t l = 0; l <= levels; l++) lay_out(c, l, NULL, &used);
    rc = pbs_alloc(run, &c->memory, used, 1, "the levels of voxels", err);
    if (rc) {
        pbs_free(run, c);
        return rc;
    }
    used = 0;
    for (uint32_t l = 0; l <= levels; l++) lay_out(c, l, c->memory, &used);
    *out = c;
    return PBS_OK;
}

void pbs_coarsen_free(pbs_coarsen *c) {
    if (!c) return;
    pbs_free(c->run, c->memory);
    pbs_free(c->run, c);
}

/* ---- rows ---- */

static pbs_code out_of_order(pbs_err *err) {
    return pbs_fail(err, PBS_DATA, "voxels that are not in Morton order");
}

/* Where in the rows a channel's array is; the same for all. */
#define EACH_CHANNEL(X) X(place) X(normal) X(weight) X(colour) X(material) X(emissive) X(face)

/* The rows from `first` on. */
static pbs_voxels view_of(const pbs_voxels *v, size_t first, size_t n) {
    pbs_voxels out = {.count = n};
#define SHIFT(a)                                                                                   \
    if (v->a) out.a = v->a + first;
    EACH_CHANNEL(SHIFT)
#undef SHIFT
    return out;
}

/* Appends n voxels of `from` to the rows. */
static void append(pbs_cell_rows *r, const pbs_voxels *from, size_t first, size_t n) {
#define COPY(a)                                                                                    \
    if (r->v.a) memcpy(r->v.a + r->n, from->a + first, 4 * n);
    EACH_CHANNEL(COPY)
#undef COPY
    r->n += n;
}

/* The first n rows go. */
static void drop(pbs_cell_rows *r, size_t n) {
    size_t rest = r->n - n;
#define MOVE(a)                                                                                    \
    if (r->v.a) memmove(r->v.a, r->v.a + n, 4 * rest);
    EACH_CHANNEL(MOVE)
#undef MOVE
    for (int s = 0; s < PBS_SUMS; s++)
        if (r->sum[s]) memmove(r->sum[s], r->sum[s] + n, sizeof(f4) * rest);
    r->n = rest;
}

/* As long as a parent's children may follow, they stay: the end of the last but one parent among
 * the first n of `total` cells. n at the end of all, 0 if there is only one. */
static size_t whole_parents(const uint32_t *place, size_t n, size_t total, bool final) {
    if (n == total) {
        if (final || !n) return n;
        n--;
    }
    while (n && !((place[n] ^ place[n - 1]) & NOT_FINE)) n--;
    return n;
}

static void where_in_parent(pbs_coarsen *c, uint32_t l) {
    const uint32_t *chunk = c->level[l].chunk;
    c->block.add = PBS_PLACE((chunk[0] & 1) << 7, (chunk[1] & 1) << 7, (chunk[2] & 1) << 7, 0);
    c->block.weight_scale = ldexpf(1, -2 * ((int)l + 1));
}

/* Parents of the first n of `in`, which is at level l. */
static pbs_code make_parents(pbs_coarsen *c, uint32_t l, const pbs_cell_rows *in, size_t n,
                             pbs_err *err) {
    pbs_cell_rows *out = &c->level[l + 1].rows;
    where_in_parent(c, l);
    size_t made = c->step(&c->block, in, n, out);
    if (made == SIZE_MAX) return out_of_order(err);
    if (c->channels & PBS_FACE && !pbs_coarsen_faces(&c->block, in, made, out))
        return pbs_fail(err, PBS_DATA, "a voxel whose faces have no attributes");
    out->n += made;
    return PBS_OK;
}

/* ---- levels ---- */

/* At the coarsest level nothing else looks at the order. */
static pbs_code check_last(level *v, pbs_err *err) {
    for (size_t i = 0; i < v->rows.n; i++) {
        int64_t code = pbs_morton8(v->rows.v.place[i]);
        if (code <= v->last) return out_of_order(err);
        v->last = code;
    }
    return PBS_OK;
}

static pbs_code give(pbs_coarsen *c, uint32_t l, size_t first, size_t n, bool done, pbs_err *err) {
    level *v = &c->level[l];
    pbs_voxels out = view_of(&v->rows.v, first, n);
    const uint32_t *faces = v->rows.faces;
    size_t face_count = 0;
    if (faces) face_count = pbs_coarsen_lists(&v->rows, first, n, &faces);
    return c->sink.voxels(c->sink.ctx, l, v->chunk, &out, faces, face_count, done, err);
}

static pbs_code consume(pbs_coarsen *c, uint32_t l, bool final, pbs_err *err);

static pbs_code consume_block(pbs_coarsen *c, uint32_t l, size_t at, size_t n, bool done,
                              pbs_err *err) {
    pbs_cell_rows *r = &c->level[l].rows, in = *r;
    pbs_code rc = PBS_OK;
    if (l < c->levels && n) {
        in.v = view_of(&r->v, at, n);
        for (int s = 0; s < PBS_SUMS; s++)
            if (in.sum[s]) in.sum[s] += at;
        rc = make_parents(c, l, &in, n, err);
    }
    if (!rc) rc = give(c, l, at, n, done, err);
    if (!rc && l < c->levels && c->level[l + 1].rows.n >= PBS_COARSEN_BLOCK)
        rc = consume(c, l + 1, false, err);
    return rc;
}

/* Cells of a level become parents and go to the sink. final: its chunk ends. */
static pbs_code consume(pbs_coarsen *c, uint32_t l, bool final, pbs_err *err) {
    level *v = &c->level[l];
    const uint32_t *place = v->rows.v.place;
    size_t total = v->rows.n, at = 0, n;
    pbs_code rc = l == c->levels ? check_last(v, err) : PBS_OK;
    while (!rc) {
        n = total - at < PBS_COARSEN_BLOCK ? total - at : PBS_COARSEN_BLOCK;
        if (l < c->levels) n = whole_parents(place + at, n, total - at, final);
        bool done = final && at + n == total;
        if (!n && !done) break;
        rc = consume_block(c, l, at, n, done, err);
        at += n;
        if (at == total) break;
    }
    if (!rc && total - at > FAMILY) rc = out_of_order(err);
    if (rc) return rc;
    if (v->rows.faces) pbs_coarsen_drop_lists(&v->rows, at);
    drop(&v->rows, at);
    return PBS_OK;
}

/* ---- the finest level ---- */

static pbs_code add_block(pbs_coarsen *c, const pbs_cell_rows *in, size_t n, pbs_err *err) {
    pbs_code rc = make_parents(c, 0, in, n, err);
    if (!rc && c->level[1].rows.n >= PBS_COARSEN_BLOCK) rc = consume(c, 1, false, err);
    return rc;
}

/* The voxels that wait become a parent. */
static pbs_code end_family(pbs_coarsen *c, pbs_err *err) {
    pbs_cell_rows *wait = &c->level[0].rows;
    pbs_code rc = wait->n ? add_block(c, wait, wait->n, err) : PBS_OK;
    wait->n = wait->face_count = 0;
    return rc;
}

/* Some of them wait until all children of their parent are there. */
static pbs_code keep_waiting(pbs_coarsen *c, const pbs_voxels *v, size_t first, size_t n,
                             const uint32_t *faces, size_t face_count, pbs_err *err) {
    pbs_cell_rows *wait = &c->level[0].rows;
    if (wait->n + n > FAMILY) return out_of_order(err);
    append(wait, v, first, n);
    if (faces && !pbs_coarsen_keep_lists(wait, n, faces, face_count))
        return pbs_fail(err, PBS_DATA, "a voxel whose faces have no attributes");
    return PBS_OK;
}

static pbs_code add_voxels(pbs_coarsen *c, const pbs_voxels *v, const uint32_t *faces,
                           size_t face_count, pbs_err *err) {
    pbs_cell_rows *wait = &c->level[0].rows,
                  in = {.faces = (uint32_t *)faces, .face_count = face_count};
    size_t at = 0, n;
    pbs_code rc = PBS_OK;
    if (wait->n) {
        uint32_t parent = wait->v.place[0];
        while (at < v->count && at <= FAMILY && !((v->place[at] ^ parent) & NOT_FINE)) at++;
        rc = keep_waiting(c, v, 0, at, faces, face_count, err);
        if (rc || at == v->count) return rc;
        rc = end_family(c, err);
    }
    while (!rc && at < v->count) {
        size_t left = v->count - at;
        n = left < PBS_COARSEN_BLOCK ? left : PBS_COARSEN_BLOCK;
        n = whole_parents(v->place + at, n, left, false);
        if (!n) return keep_waiting(c, v, at, left, faces, face_count, err);
        in.v = view_of(v, at, n);
        rc = add_block(c, &in, n, err);
        at += n;
    }
    return rc;
}

/* ---- chunks ---- */

static void begin_chunks(pbs_coarsen *c, uint32_t levels, const uint32_t chunk[3]) {
    for (uint32_t l = 0; l < levels; l++) {
        c->level[l].last = -1;
        for (int k = 0; k < 3; k++) c->level[l].chunk[k] = chunk[k] >> l;
    }
}

/* Ends the chunks that the next one is not in, from the finest up; NULL: all. */
static pbs_code end_chunks(pbs_coarsen *c, const uint32_t next[3], uint32_t *ended, pbs_err *err) {
    pbs_code rc = end_family(c, err);
    uint32_t l = 1;
    for (; l <= c->levels && !rc; l++) {
        const uint32_t *chunk = c->level[l].chunk;
        if (next && chunk[0] == next[0] >> l && chunk[1] == next[1] >> l &&
            chunk[2] == next[2] >> l)
            break;
        rc = consume(c, l, true, err);
    }
    *ended = l;
    return rc;
}

pbs_code pbs_coarsen_add(pbs_coarsen *c, const uint32_t chunk[3], const pbs_voxels *v,
                         const uint32_t *faces, size_t face_count, pbs_err *err) {
    uint32_t ended;
    if (!c->levels || !v->count) return PBS_OK;
    if (!c->open) {
        begin_chunks(c, c->levels + 1, chunk);
        c->open = true;
    } else if (memcmp(c->level[0].chunk, chunk, sizeof c->level[0].chunk)) {
        if (!pbs_morton_before(c->level[0].chunk, chunk))
            return pbs_fail(err, PBS_DATA, "chunks that are not in Morton order");
        pbs_code rc = end_chunks(c, chunk, &ended, err);
        if (rc) return rc;
        begin_chunks(c, ended, chunk);
    }
    return add_voxels(c, v, c->channels & PBS_FACE ? faces : NULL, face_count, err);
}

pbs_code pbs_coarsen_end(pbs_coarsen *c, pbs_err *err) {
    uint32_t ended;
    if (!c->open) return PBS_OK;
    c->open = false;
    return end_chunks(c, NULL, &ended, err);
}
