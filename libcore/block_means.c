/* block_means.c: from sums to attributes of voxels: means by area (paper 2, section 3). Four voxels
 * at a time; what is 64 bits wide becomes a float one by one, so that it is rounded once. */
#include "libcore/block_inner.h"
#if defined(__SSE2__)
#include <emmintrin.h>
#endif

typedef float f4 __attribute__((vector_size(16)));
typedef int32_t i4 __attribute__((vector_size(16)));

#define LANE  __attribute__((always_inline)) static inline
#define SCALE ((float)(1 / PBS_UNIT))

/* Sums of four voxels, square voxels. */
typedef struct four {
    f4 area, mean[3], across[3]; /* normals of both sides; their difference */
} four;

static const int64_t nothing[PBS_REC_EXTRA + PBS_EXTRAS];

static void sum_wide(const pbs_bricks *k, const int64_t *r, int lane, four *out) {
    out->area[lane] = (float)pbs_record_total(k, r, PBS_REC_AREA) * SCALE;
    for (uint32_t i = 0; i < 3; i++) {
        __int128 p = pbs_record_total(k, r, PBS_REC_NEAR + i);
        __int128 q = pbs_record_total(k, r, PBS_REC_BEYOND + i);
        out->mean[i][lane] = (float)(p + q) * SCALE;
        out->across[i][lane] = (float)(p - q) * SCALE;
    }
}

LANE void sum_lane(const pbs_bricks *k, const int64_t *r, int lane, four *out) {
    if (__builtin_expect(r[PBS_REC_FLAGS] >> PBS_REC_WIDE != 0, 0)) {
        sum_wide(k, r, lane, out);
        return;
    }
    out->area[lane] = (float)r[PBS_REC_AREA] * SCALE;
#pragma GCC unroll 3
    for (int i = 0; i < 3; i++) {
        int64_t p = r[PBS_REC_NEAR + i], q = r[PBS_REC_BEYOND + i];
        out->mean[i][lane] = (float)(p + q) * SCALE;
        out->across[i][lane] = (float)(p - q) * SCALE;
    }
}

LANE f4 sqrt4f(f4 v) {
#if defined(__SSE2__)
    return (f4)_mm_sqrt_ps((__m128)v);
#else
    for (int i = 0; i < 4; i++) v[i] = sqrtf(v[i]);
    return v;
#endif
}
LANE i4 round4(f4 v) {
#if defined(__SSE2__)
    return (i4)_mm_cvtps_epi32((__m128)v);
#else
    i4 out;
    for (int i = 0; i < 4; i++) out[i] = (int32_t)lrintf(v[i]);
    return out;
#endif
}

LANE f4 square4(const f4 n[3]) {
    return n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
}

/* As pbs_normal10_put. *sheet: the mean is short, so the normal is that of a sheet. */
LANE i4 normals4(const four *s, i4 *sheet) {
    f4 thin = (float)PBS_BLOCK_THIN * s->area, n[3];
    *sheet = square4(s->mean) < thin * thin;
    for (int k = 0; k < 3; k++)
        n[k] = (f4)((*sheet & (i4)s->across[k]) | (~*sheet & (i4)s->mean[k]));
    f4 l = sqrt4f(square4(n));
    i4 good = (l > 0) & (l < INFINITY), q[3];
    for (int k = 0; k < 3; k++) q[k] = round4((f4)((i4)(n[k] / l * 511) & good)) & 1023;
    q[2] = (q[2] & good) | (~good & 511);
    return q[0] | q[1] << 10 | q[2] << 20;
}

/* Faces that a voxel looks out of and that are not hidden. Where nothing says which: all around. */
LANE uint32_t faces_of(uint32_t flags, const pbs_chosen *c) {
    uint32_t all = PBS_FACES_ALL | PBS_VOXEL_TWO_SIDED;
    uint32_t faces = flags & PBS_FACES_ALL ? flags & all : all;
    return (faces & ~(uint32_t)c->hide) | c->caps;
}

static const int64_t *record_of(const pbs_block *b, const pbs_chosen *c) {
    return c->record ? pbs_record_at(&b->bricks, c->record) : nothing;
}

/* ---- place, normal, weight ---- */

static __int128 area_of(const pbs_block *b, const int64_t *r) {
    if (r[PBS_REC_FLAGS] & PBS_REC_BARE) return 0;
    return pbs_record_total(&b->bricks, r, PBS_REC_AREA);
}

LANE void put_four(const pbs_block *b, size_t n, size_t count, __int128 *kept) {
    const pbs_voxels *v = &b->out.voxels;
    const pbs_chosen *c = b->out.chosen + n;
    const int64_t *r[4];
    four s;
    i4 sheet;
#pragma GCC unroll 4
    for (size_t i = 0; i < 4; i++) {
        r[i] = record_of(b, c + (i < count ? i : 0));
        sum_lane(&b->bricks, r[i], (int)i, &s);
    }
    i4 normal = normals4(&s, &sheet);
    for (size_t i = 0; i < count; i++) {
        uint32_t flags = (uint32_t)r[i][PBS_REC_FLAGS], faces = faces_of(flags, c + i);
        bool bare = flags & PBS_REC_BARE || !c[i].record;
        v->place[n + i] |= (faces | (sheet[i] & PBS_VOXEL_TWO_SIDED)) << 24;
        if (v->normal) v->normal[n + i] = (uint32_t)normal[i];
        if (v->weight) v->weight[n + i] = bare ? 0x1p-30f : s.area[i];
        *kept += area_of(b, r[i]);
    }
}

/* ---- colours and materials ---- */

static uint32_t put_light(const double linear[3], double alpha) {
    const pbs_srgb_table *t = pbs_srgb();
    uint32_t out = (uint32_t)(alpha + 0.5) << 24;
    for (int k = 0; k < 3; k++)
        out |= (uint32_t)pbs_srgb_encode(t, (float)(linear[k] * (1.0 / PBS_LIGHT))) << 8 * k;
    return out;
}

static void put_extras(const pbs_block *b, size_t n, uint32_t *colour) {
    const pbs_voxels *v = &b->out.voxels;
    const int64_t *r = record_of(b, &b->out.chosen[n]);
    double area = (double)pbs_record_total(&b->bricks, r, PBS_REC_AREA), mean[PBS_EXTRAS];
    for (uint32_t i = 0; i < b->extras; i++)
        mean[i] = area > 0 ? (double)pbs_record_total(&b->bricks, r, PBS_REC_EXTRA + i) / area : 0;
    if (b->want & PBS_COLOUR) *colour = put_light(mean, mean[3]);
    if (v->colour) v->colour[n] = *colour;
    if (v->emissive) v->emissive[n] = put_light(mean + b->at_emissive, 0);
    if (v->material)
        v->material[n] = (uint32_t)(mean[b->at_material] + 0.5) |
                         (uint32_t)(mean[b->at_material + 1] + 0.5) << 8;
}

/* colour: what a face has that no triangle looks out of. */
static void put_faces(pbs_block *b, size_t n, uint32_t colour) {
    pbs_block_out *o = &b->out;
    uint32_t faces = o->voxels.place[n] >> 24, code = o->chosen[n].code;
    o->voxels.face[n] = (uint32_t)o->face_count;
    for (int f = 0; f < 6; f++) {
        double light[4];
        if (!(faces >> f & 1)) continue;
        uint32_t *to = &o->faces[o->face_count++];
        if (b->params.per_face == PBS_PER_FACE_MATERIAL)
            *to = pbs_face_material(&b->face_sums, code, f);
        else
            *to =
                pbs_face_light(&b->face_sums, code, f, light) ? put_light(light, light[3]) : colour;
    }
}

pbs_code pbs_block_means(pbs_block *b, __int128 *kept, pbs_err *err) {
    pbs_block_out *o = &b->out;
    size_t n = o->voxels.count;
    pbs_code rc = PBS_OK;
    if (b->set_alone) {
        for (size_t i = 0; i < n; i++)
            o->voxels.place[i] |= faces_of(o->chosen[i].record, &o->chosen[i]) << 24;
        return PBS_OK;
    }
    if (b->params.per_face)
        rc = pbs_grow(b->run, &o->faces, &o->face_cap, 6 * n, 4, "attributes of faces", err);
    if (rc) return rc;
    for (size_t i = 0; i < n; i += 4) {
        for (size_t k = i + 16; k < i + 20 && k < n; k++)
            __builtin_prefetch(record_of(b, &o->chosen[k]));
        put_four(b, i, n - i < 4 ? n - i : 4, kept);
    }
    for (size_t i = 0; i < n && (b->extras || b->params.per_face); i++) {
        uint32_t colour = 0;
        if (b->extras) put_extras(b, i, &colour);
        if (b->params.per_face) put_faces(b, i, colour);
    }
    return rc;
}
