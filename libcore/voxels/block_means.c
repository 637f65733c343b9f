/* block_means.c: from sums to attributes of voxels: means by area (paper 2, section 3). Four voxels
 * at a time; what is 64 bits wide becomes a float one by one, so that it is rounded once. */
#include "libcore/voxels/block_inner.h"
#include "libcore/data/vectors.h"

typedef float f2 __attribute__((vector_size(8)));
typedef double d2 __attribute__((vector_size(16)));
typedef int64_t l2 __attribute__((vector_size(16)));
typedef l2 l2_at __attribute__((aligned(8), may_alias));

#define SCALE ((float)(1 / PBS_UNIT))

/* Sums of a voxel in units: area times normal of both sides together, and the area; the difference
 * of the sides. */
typedef struct sums {
    f4 mean, across;
} sums;

/* Whole numbers of less than 2^51, rounded once. */
LANE f2 to_float(l2 v) {
    const d2 magic = {0x1.8p52, 0x1.8p52};
    return __builtin_convertvector((d2)(v + (l2)magic) - magic, f2);
}

static __attribute__((noinline)) sums sum_wide(const pbs_bricks *k, const int64_t *r) {
    sums s = {{0, 0, 0, (float)pbs_record_total(k, r, PBS_REC_AREA)}, {0}};
    for (uint32_t i = 0; i < 3; i++) {
        __int128 p = pbs_record_total(k, r, PBS_REC_NEAR + i);
        __int128 q = pbs_record_total(k, r, PBS_REC_BEYOND + i);
        s.mean[i] = (float)(p + q), s.across[i] = (float)(p - q);
    }
    return s;
}

LANE bool is_wide(const int64_t *r) {
    return __builtin_expect(r[PBS_REC_FLAGS] >> PBS_REC_WIDE != 0, 0);
}

LANE sums sum_of(const pbs_bricks *k, const int64_t *r) {
    if (is_wide(r)) return sum_wide(k, r);
    const l2_at *v = (const void *)r;
    const l2 first = {-1, 0};
    l2 far = v[3] & first;
    return (sums){__builtin_shufflevector(to_float(v[0] + v[2]), to_float(v[1] + far), 0, 1, 2, 3),
                  __builtin_shufflevector(to_float(v[0] - v[2]), to_float(v[1] - far), 0, 1, 2, 3)};
}

/* Rows to columns. */
LANE void turn(const f4 in[4], f4 out[4]) {
    f4 a = __builtin_shufflevector(in[0], in[1], 0, 4, 1, 5);
    f4 b = __builtin_shufflevector(in[2], in[3], 0, 4, 1, 5);
    f4 c = __builtin_shufflevector(in[0], in[1], 2, 6, 3, 7);
    f4 d = __builtin_shufflevector(in[2], in[3], 2, 6, 3, 7);
    out[0] = __builtin_shufflevector(a, b, 0, 1, 4, 5);
    out[1] = __builtin_shufflevector(a, b, 2, 3, 6, 7);
    out[2] = __builtin_shufflevector(c, d, 0, 1, 4, 5);
    out[3] = __builtin_shufflevector(c, d, 2, 3, 6, 7);
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

/* As pbs_normal10_put. *sheet: the mean is short, so the normal is that of a sheet; but where the
 * sheet runs along the fixed direction, the difference of the sides is short, too. */
LANE i4 normals4(const f4 mean[4], const f4 across[4], i4 *sheet) {
    f4 thin = (float)PBS_BLOCK_THIN * mean[3], n[3], square = square4(mean);
    *sheet = square < thin * thin;
    i4 pick = *sheet & (square < square4(across));
    for (int k = 0; k < 3; k++) n[k] = (f4)((pick & (i4)across[k]) | (~pick & (i4)mean[k]));
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

/* ---- place, normal, weight ---- */

LANE void put_four(const pbs_block *b, size_t n, size_t count, __int128 *kept) {
    const pbs_voxels *v = &b->out.voxels;
    const pbs_chosen *c = b->out.chosen + n;
    f4 mean[4], across[4];
    i4 sheet, flags;
    int64_t area = 0;
#pragma GCC unroll 4
    for (size_t i = 0; i < 4; i++) {
        const int64_t *r = c[i < count ? i : 0].record;
        sums s = sum_of(&b->bricks, r);
        mean[i] = s.mean * SCALE, across[i] = s.across * SCALE;
        flags[i] = (int32_t)r[PBS_REC_FLAGS];
        if (i >= count || flags[i] & PBS_REC_BARE) continue;
        if (is_wide(r))
            *kept += pbs_record_total(&b->bricks, r, PBS_REC_AREA);
        else
            area += r[PBS_REC_AREA];
    }
    *kept += area;
    turn(mean, mean), turn(across, across);
    i4 normal = normals4(mean, across, &sheet), bare = (flags & PBS_REC_BARE) != 0;
    const f4 touch = {0x1p-30f, 0x1p-30f, 0x1p-30f, 0x1p-30f};
    f4 weight = (f4)((bare & (i4)touch) | (~bare & (i4)mean[3]));
    for (size_t i = 0; i < count; i++)
        v->place[n + i] |=
            (faces_of((uint32_t)flags[i], c + i) | ((uint32_t)sheet[i] & PBS_VOXEL_TWO_SIDED))
            << 24;
    if (v->normal) memcpy(v->normal + n, &normal, 4 * count);
    if (v->weight) memcpy(v->weight + n, &weight, 4 * count);
}

/* ---- colours and materials ---- */

static uint32_t put_light(const pbs_block *b, const double linear[3], double alpha) {
    uint32_t out = (uint32_t)(alpha + 0.5) << 24;
    for (int k = 0; k < 3; k++)
        out |= (uint32_t)pbs_srgb_encode(b->srgb, (float)(linear[k] * (1.0 / PBS_LIGHT))) << 8 * k;
    return out;
}

LANE void find_means(const pbs_block *b, const int64_t *r, uint32_t n, double *mean) {
    bool wide = is_wide(r);
    double area =
        wide ? (double)pbs_record_total(&b->bricks, r, PBS_REC_AREA) : (double)r[PBS_REC_AREA];
    double per = area > 0 ? 1 / area : 0;
    for (uint32_t i = 0; i < n; i++)
        mean[i] = per * (wide ? (double)pbs_record_total(&b->bricks, r, PBS_REC_EXTRA + i)
                              : (double)r[PBS_REC_EXTRA + i]);
}

static void put_extras(const pbs_block *b, size_t n, uint32_t *colour) {
    const pbs_voxels *v = &b->out.voxels;
    const int64_t *r = b->out.chosen[n].record;
    double mean[PBS_EXTRAS];
    if (b->extras == 4)
        find_means(b, r, 4, mean);
    else
        find_means(b, r, b->extras, mean);
    if (b->want & PBS_COLOUR) *colour = put_light(b, mean, mean[3]);
    if (v->colour) v->colour[n] = *colour;
    if (v->emissive) v->emissive[n] = put_light(b, mean + b->at_emissive, 0);
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
            *to = pbs_face_light(&b->face_sums, code, f, light) ? put_light(b, light, light[3])
                                                                : colour;
    }
}

static void put_rest(pbs_block *b, size_t i, size_t end) {
    for (; i < end; i++) {
        uint32_t colour = 0;
        if (b->extras) put_extras(b, i, &colour);
        if (b->params.per_face) put_faces(b, i, colour);
    }
}

/* Many blocks' records are more than the processor keeps near. */
LANE void ask_ahead(const pbs_block *b, size_t i) {
    const pbs_chosen *c = b->out.chosen;
    size_t end = i + 20 < b->out.voxels.count ? i + 20 : b->out.voxels.count;
    for (i += 16; i < end; i++) {
        __builtin_prefetch(c[i].record);
        __builtin_prefetch(c[i].record + b->bricks.numbers - 1);
    }
}

pbs_code pbs_block_means(pbs_block *b, __int128 *kept, pbs_err *err) {
    pbs_block_out *o = &b->out;
    size_t n = o->voxels.count;
    pbs_code rc = PBS_OK;
    if (b->set_alone) {
        for (size_t i = 0; i < n; i++)
            o->voxels.place[i] |= faces_of(o->chosen[i].faces, &o->chosen[i]) << 24;
        return PBS_OK;
    }
    if (b->params.per_face)
        rc = pbs_grow(b->run, &o->faces, &o->face_cap, 6 * n, 4, "attributes of faces", err);
    if (rc) return rc;
    for (size_t i = 0; i < n; i += 4) {
        ask_ahead(b, i);
        if (i + 4 <= n)
            put_four(b, i, 4, kept);
        else
            put_four(b, i, n - i, kept);
        if (b->extras || b->params.per_face) put_rest(b, i, i + 4 <= n ? i + 4 : n);
    }
    return rc;
}
