#include "libcore/voxels/block_inner.h"
#include "libcore/gbuffer/raster.h"
#include "libcore/data/vectors.h"

/* ---- fragments ---- */

/* A cell that is only touched so far is counted by touches; the first area replaces them. False: a
 * touch that doesn't count. */
static __attribute__((noinline)) bool touch(pbs_bricks *k, int64_t *record, bool fresh, bool bare) {
    if (bare) {
        if (fresh) record[PBS_REC_FLAGS] |= PBS_REC_BARE;
        return record[PBS_REC_FLAGS] & PBS_REC_BARE;
    }
    pbs_record_clear(k, record);
    return true;
}

/* To whole numbers, as they lie behind the binary point of a number of this size. */
LANE l4 whole(const d4 *v) {
    const d4 magic = {0x1.8p52, 0x1.8p52, 0x1.8p52, 0x1.8p52};
    return (l4)(*v + magic) - (l4)magic;
}

/* The mean of three corners at a fragment. */
LANE f4 mix(const float corner[3][4], float u, float v) {
    const f4 *c = (const void *)corner;
    return (1 - u - v) * c[0] + u * c[1] + v * c[2];
}

/* The normal of a fragment from those of its corners: unit as in pbs_batch, returns the slot. One
 * of a triangle without area has no side to turn to; those that cancel say nothing. Where it is not
 * known which side is out, the way that the corners run says less than the normals do. */
LANE uint32_t smooth(const pbs_block *b, const pbs_fragment *f, double unit[4]) {
    const pbs_batch *t = &b->batch;
    uint32_t i = f->triangle;
    double uv[2] = {f->u, f->v};
    if (__builtin_expect(t->cut >> i & 1, 0)) pbs_block_uncut(b, i, uv);
    f4 n = mix(t->smooth[i], (float)uv[0], (float)uv[1]);
    f4 square = n * n;
    float length = sqrtf(square[0] + square[1] + square[2]);
    if (__builtin_expect(!(length > 1e-6f), 0)) {
        memcpy(unit, t->unit[i], 4 * sizeof *unit);
        return t->slot[i];
    }
    double turned = n[0] * t->normal[0][i] + n[1] * t->normal[1][i] + n[2] * t->normal[2][i];
    double side = n[0] * PBS_SIDE_X + n[1] * PBS_SIDE_Y + n[2] * PBS_SIDE_Z;
    double sign = !b->placing.both && turned < 0 ? -1 : 1;
    double scale = sign * PBS_UNIT * (1 / length);
    uint32_t beyond = side * sign < 0;
    unit[beyond ? 0 : 3] = PBS_UNIT;
    unit[beyond] = n[0] * scale, unit[beyond + 1] = n[1] * scale, unit[beyond + 2] = n[2] * scale;
    return beyond;
}

LANE void values(pbs_block *b, const pbs_fragment *f, int32_t *out) {
    if (b->mixes >> f->triangle & 1) {
        i4 v = __builtin_convertvector(mix(b->mix[f->triangle], f->u, f->v) + 0.5f, i4);
        memcpy(out, &v, sizeof v);
    } else {
        pbs_block_values(b, f, out);
    }
}

LANE void add_extras(int64_t *to, uint32_t n, int64_t area, const int32_t *value) {
    if (n == 4) {
        for (int i = 0; i < 4; i++) to[i] += area * value[i];
        return;
    }
    for (uint32_t i = 0; i < n; i++) to[i] += area * value[i];
}

/* Where a fragment is added. Found for some before any of these is added, so that records come from
 * memory side by side. */
typedef struct spot {
    int64_t *record; /* NULL: the triangle is not there */
    uint32_t code;
    bool fresh;
} spot;

LANE void find_spot(pbs_block *b, const pbs_fragment *f, bool general, spot *out) {
    pbs_bricks *k = &b->bricks;
    out->record = NULL;
    if (general && b->asks >> f->triangle & 1 && !pbs_block_keeps(b, f->triangle, f->cell)) return;
    uint32_t code = out->code = pbs_bricks_code(k, f->cell);
    pbs_brick *p = pbs_bricks_get(k, code);
    out->fresh = !p->record[code & 63];
    out->record = pbs_brick_record(k, p, code & 63);
    __builtin_prefetch(out->record, 1);
}

/* general false: the triangle's normal and values are the fragment's. Returns its area. */
LANE int64_t put(pbs_block *b, const pbs_fragment *f, const spot *at, bool general) {
    pbs_bricks *k = &b->bricks;
    uint32_t t = f->triangle, slot = b->batch.slot[t];
    double own[4];
    int32_t varied[PBS_EXTRAS];
    const double *unit = b->batch.unit[t];
    const int32_t *value = b->value[t];
    int64_t *record = at->record;
    if (general) {
        if (!record) return 0;
        if (b->placing.mesh->normal) slot = smooth(b, f, own), unit = own;
        if (b->varies >> t & 1) values(b, f, varied), value = varied;
    }
    d4 each = *(const d4_at *)(const void *)unit, v = f->area * each;
    l4 q = whole(&v);
    int64_t area = lrint(f->area * PBS_UNIT), weight = area, before = record[PBS_REC_AREA];
    if (__builtin_expect(!area || record[PBS_REC_FLAGS] & PBS_REC_BARE, 0)) {
        bool counts = touch(k, record, at->fresh, !area);
        q = !counts ? q & 0 : area ? q : whole(&each);
        weight = !counts ? 0 : area ? area : (int64_t)PBS_UNIT;
    }
    *(l4_at *)(void *)(record + (slot ? PBS_REC_AREA : PBS_REC_NEAR)) += q;
    if (b->extras) add_extras(record + PBS_REC_EXTRA, b->extras, weight, value);
    record[PBS_REC_FLAGS] |= b->batch.faces[t];
    b->hit |= UINT64_C(1) << t;
    if (__builtin_expect(before + weight > b->wide_at, 0)) pbs_record_widen(k, record);
    if (general && b->params.per_face)
        pbs_face_sums_add(
            &b->face_sums, at->code, b->material[t], b->batch.faces[t], area,
            (double[3]){b->batch.normal[0][t], b->batch.normal[1][t], b->batch.normal[2][t]},
            value);
    return area;
}

LANE int64_t put_all(pbs_block *b, const pbs_fragments *f, bool general) {
    enum { TOGETHER = 8 };
    spot at[TOGETHER];
    int64_t area = 0;
    for (uint32_t i = 0; i < f->count; i += TOGETHER) {
        const pbs_fragment *from = &f->fragment[i];
        uint32_t n = f->count - i < TOGETHER ? f->count - i : TOGETHER;
        for (uint32_t j = 0; j < n; j++) find_spot(b, &from[j], general, &at[j]);
        for (uint32_t j = 0; j < n; j++) area += put(b, &from[j], &at[j], general);
    }
    return area;
}

static void flush_fragments(void *ctx, pbs_fragments *f) {
    pbs_block *b = ctx;
    int64_t area;
    if (!pbs_bricks_reserve(&b->bricks, f->count)) f->count = 0;
    if (b->general)
        area = put_all(b, f, true);
    else
        area = put_all(b, f, false);
    b->area += area;
    b->fragment_count += f->count;
    f->count = 0;
}

/* ---- hits ---- */

static inline void put_hit(pbs_block *b, const pbs_hit *h, bool set_alone) {
    if (b->asks >> h->triangle & 1 && !pbs_block_keeps(b, h->triangle, h->cell)) return;
    pbs_bricks *k = &b->bricks;
    uint32_t code = pbs_bricks_code(k, h->cell);
    uint64_t bit = UINT64_C(1) << (code & 63);
    k->six[code >> 6] |= bit;
    pbs_brick *p = pbs_bricks_get(k, code);
    if (!set_alone) return;
    p->seen |= bit;
    p->faces[code & 63] |= b->batch.faces[h->triangle];
    b->hit |= (uint64_t)(p != k->spare) << h->triangle;
}

static void flush_hits(void *ctx, pbs_hits *h) {
    pbs_block *b = ctx;
    if (!pbs_bricks_reserve(&b->bricks, h->count)) h->count = 0;
    if (b->set_alone)
        for (uint32_t i = 0; i < h->count; i++) put_hit(b, &h->hit[i], true);
    else
        for (uint32_t i = 0; i < h->count; i++) put_hit(b, &h->hit[i], false);
    h->count = 0;
}

/* ---- batches ---- */

static void run_batch(pbs_block *b) {
    pbs_block_shade_batch(b);
    b->hit = 0;
    b->general = b->placing.mesh->normal || b->asks || b->varies || b->params.per_face;
    if (!b->set_alone) {
        bool centroids = b->placing.mesh->normal || b->varies;
        pbs_clip(&b->batch.t, centroids, b->simd, &b->fragments);
        flush_fragments(b, &b->fragments);
    }
    pbs_separate(&b->batch.t, b->simd, &b->hits);
    flush_hits(b, &b->hits);
    b->triangles += (uint64_t)__builtin_popcountll(b->hit);
}

static pbs_code went_wrong(const pbs_block *b, pbs_err *err) {
    const pbs_err *e = b->bricks.rc ? &b->bricks.err : &b->face_sums.err;
    if (!b->bricks.rc && !b->face_sums.rc) return PBS_OK;
    return pbs_fail(err, e->code, "%s", e->text);
}

pbs_code pbs_block_add(pbs_block *b, const pbs_mesh *mesh, const uint32_t *triangles, size_t count,
                       const pbs_to_grid *to, pbs_sides sides, pbs_err *err) {
    pbs_feed feed = {.triangles = triangles, .count = count};
    pbs_placing_make(&b->placing, mesh, to, b->at, sides, b->params.interior, b->simd);
    pbs_block_shade_call(b, mesh);
    for (uint32_t n = 0; pbs_batch_fill(&b->placing, &feed, &b->batch); n++) {
        if (n % 64 == 0 && pbs_run_check(b->run, err)) return PBS_CANCEL;
        run_batch(b);
        if (b->bricks.rc || b->face_sums.rc) break;
    }
    b->lost += feed.lost;
    return went_wrong(b, err);
}

/* ---- its life ---- */

size_t pbs_block_memory(const pbs_block_params *p) {
    size_t mib = 26;
    mib += (p->channels & PBS_COLOUR ? 9 : 0) + (p->channels & PBS_MATERIAL ? 5 : 0);
    mib += p->channels & PBS_EMISSIVE ? 7 : 0;
    mib += p->per_face == PBS_PER_FACE_COLOUR ? 360 : p->per_face ? 140 : 0;
    return mib << 20;
}

pbs_code pbs_block_new(pbs_run *run, const pbs_block_params *params, pbs_block **out,
                       pbs_err *err) {
    pbs_block *b;
    pbs_code rc = pbs_alloc(run, &b, 1, sizeof *b, "a block", err);
    *out = NULL;
    if (rc) return rc;
    memset(b, 0, sizeof *b);
    b->run = run;
    b->params = *params;
    b->set_alone = !params->channels && !params->per_face;
    if (b->set_alone) b->params.cells = PBS_CELLS_SEPARATING;
    b->simd = pbs_raster_simd();
    b->wide_at = PBS_BLOCK_WIDE;
    b->fragments.flush = flush_fragments, b->fragments.ctx = b;
    b->hits.flush = flush_hits, b->hits.ctx = b;
    pbs_block_shade_init(b);
    pbs_face_sums_init(&b->face_sums, run, params->per_face == PBS_PER_FACE_COLOUR);
    rc = pbs_bricks_init(&b->bricks, run, !b->set_alone, b->extras, err);
    if (rc)
        pbs_block_free(b);
    else
        *out = b;
    return rc;
}

void pbs_block_free(pbs_block *b) {
    if (!b) return;
    pbs_run *run = b->run;
    pbs_voxels *v = &b->out.voxels;
    void *array[] = {v->place,    v->normal, v->weight,    v->colour,    v->material,
                     v->emissive, v->face,   b->out.faces, b->out.chosen};
    for (size_t i = 0; i < sizeof array / sizeof *array; i++) pbs_free(run, array[i]);
    pbs_face_sums_free(&b->face_sums);
    pbs_bricks_free(&b->bricks);
    pbs_free(run, b);
}

void pbs_block_begin(pbs_block *b, const uint32_t at[3], uint32_t size) {
    memcpy(b->at, at, sizeof b->at);
    b->size = size;
    b->triangles = b->fragment_count = b->lost = 0;
    b->area = 0;
    b->fragments.count = b->hits.count = 0;
    pbs_bricks_begin(&b->bricks);
    pbs_face_sums_begin(&b->face_sums);
}
