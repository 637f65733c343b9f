/* place_math.h: the arithmetic of place.c, four triangles at a time. It is compiled twice, in
 * place.c and, with AVX2, in place_avx2.c; each lane is a sequence of IEEE operations, so both give
 * the same bits.
 */
#ifndef PBS_PLACE_MATH_H
#define PBS_PLACE_MATH_H

#include "libcore/voxels/place.h"
#include "libcore/data/vectors.h"

LANE d4 load4(const double *p) {
    return *(const d4_at *)(const void *)p;
}
LANE d4_at *store4(double *p) {
    return (d4_at *)(void *)p;
}
LANE d4 load4f(const float *p) {
    return __builtin_convertvector(*(const f4_at *)(const void *)p, d4);
}
/* Macros, since what a vector of this size is passed in depends on the processor. */
#define PICK4(which, then, other) ((d4)(((which) & (l4)(then)) | (~(which) & (l4)(other))))
#define MIN4(a, b)                PICK4((a) < (b), a, b)
#define MAX4(a, b)                PICK4((a) > (b), a, b)
LANE unsigned bits4(const l4 *m) {
#if defined(__AVX2__)
    return (unsigned)_mm256_movemask_pd((__m256d)*m);
#else
    return (unsigned)(((*m)[0] & 1) | ((*m)[1] & 2) | ((*m)[2] & 4) | ((*m)[3] & 8));
#endif
}
LANE d4 sqrt4(const d4 *v) {
#if defined(__AVX2__)
    return (d4)_mm256_sqrt_pd((__m256d)*v);
#else
    return (d4){sqrt((*v)[0]), sqrt((*v)[1]), sqrt((*v)[2]), sqrt((*v)[3])};
#endif
}

/* To a multiple of 2^-32, ties to even: from 2^20 on, that is what a double can hold. */
LANE d4 snap4(const d4 *v) {
    const d4 far = {PBS_GRID_FAR, PBS_GRID_FAR, PBS_GRID_FAR, PBS_GRID_FAR};
    d4 s = (d4)(((l4)*v & INT64_MIN) | (l4)far);
    return (*v + s) - s;
}

typedef struct placed4 {
    d4 p[3][3], min[3], max[3];
} placed4;

LANE void place_four(const pbs_placing *g, const pbs_corners *in, uint32_t i, placed4 *t) {
#pragma GCC unroll 3
    for (int c = 0; c < 3; c++) {
        d4 x = load4f(&in->p[c][0][i]), y = load4f(&in->p[c][1][i]), z = load4f(&in->p[c][2][i]);
#pragma GCC unroll 3
        for (int r = 0; r < 3; r++) {
            const double *m = g->m + 3 * r;
            d4 v = m[0] * x + m[1] * y + m[2] * z + g->part[r];
            t->p[c][r] = snap4(&v) + g->shift[r];
        }
    }
#pragma GCC unroll 3
    for (int r = 0; r < 3; r++) {
        d4 lo = MIN4(t->p[0][r], t->p[1][r]), hi = MAX4(t->p[0][r], t->p[1][r]);
        t->min[r] = MIN4(lo, t->p[2][r]), t->max[r] = MAX4(hi, t->p[2][r]);
    }
}

LANE void keep_lane(const placed4 *t, int lane, pbs_triangles *out, uint32_t n) {
    for (int r = 0; r < 3; r++) {
        for (int c = 0; c < 3; c++) out->p[c][r][n] = t->p[c][r][lane];
        out->min[r][n] = t->min[r][lane], out->max[r][n] = t->max[r][lane];
    }
}

/* Appends those lanes of four triangles whose bits are set. */
LANE void keep_four(const placed4 *t, unsigned which, const uint32_t *id, pbs_batch *out) {
    uint32_t n = out->t.count;
    if (which == 15 && n + 4 <= PBS_TRIANGLES) {
#pragma GCC unroll 3
        for (int r = 0; r < 3; r++) {
#pragma GCC unroll 3
            for (int c = 0; c < 3; c++) *store4(&out->t.p[c][r][n]) = t->p[c][r];
            *store4(&out->t.min[r][n]) = t->min[r];
            *store4(&out->t.max[r][n]) = t->max[r];
        }
        memcpy(out->id + n, id, 4 * sizeof *id);
        out->t.count = n + 4;
        return;
    }
    for (int lane = 0; lane < 4; lane++) {
        if (!(which >> lane & 1)) continue;
        keep_lane(t, lane, &out->t, n);
        out->id[n++] = id[lane];
    }
    out->t.count = n;
}

/* Returns the bits of those that must be cut. */
LANE uint64_t place_all(const pbs_placing *g, const pbs_corners *in, const uint32_t *id,
                        uint32_t count, pbs_batch *out) {
    uint64_t far = 0;
    for (uint32_t i = 0; i < count; i += 4) {
        placed4 t;
        place_four(g, in, i, &t);
        l4 near = {-1, -1, -1, -1}, out_of = {0, 0, 0, 0};
#pragma GCC unroll 3
        for (int r = 0; r < 3; r++) {
            near &= (t.min[r] < PBS_BLOCK + 1) & (t.max[r] >= -1);
            out_of |= (t.min[r] < g->far_lo[r]) | (t.max[r] > g->far_hi[r]);
        }
        unsigned which = bits4(&near), cut = bits4(&out_of);
        if (count - i < 4) which &= (1u << (count - i)) - 1;
        far |= (uint64_t)(which & cut) << i;
        which &= ~cut;
        if (which) keep_four(&t, which, id + i, out);
    }
    return far;
}

/* Normals of the triangles of a batch, and what follows from them. */
LANE void normals_all(const pbs_placing *g, pbs_batch *b) {
    const l4 one = {1, 1, 1, 1};
    for (uint32_t i = 0; i < b->t.count; i += 4) {
        d4 e[3], f[3], n[3];
#pragma GCC unroll 3
        for (int r = 0; r < 3; r++) {
            d4 o = load4(&b->t.p[0][r][i]);
            e[r] = load4(&b->t.p[1][r][i]) - o, f[r] = load4(&b->t.p[2][r][i]) - o;
        }
        n[0] = (e[1] * f[2] - e[2] * f[1]) * g->sign;
        n[1] = (e[2] * f[0] - e[0] * f[2]) * g->sign;
        n[2] = (e[0] * f[1] - e[1] * f[0]) * g->sign;
        d4 square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2], l = sqrt4(&square);
        d4 inv = (d4)((l > 0) & (l4)(1 / l));
        l4 beyond = (PBS_SIDE_X * n[0] + PBS_SIDE_Y * n[1] + PBS_SIDE_Z * n[2]) < 0;
        l4 faces = g->all_faces ? one * PBS_VOXEL_TWO_SIDED : one & 0;
#pragma GCC unroll 3
        for (int r = 0; r < 3; r++) {
            l4 down = n[r]<0, up = n[r]> 0, any = down | up;
            if (g->all_faces) down = up = any;
            faces |= (down & (one << (2 * r))) | (up & (one << (2 * r + 1)));
            n[r] *= inv;
            *store4(&b->normal[r][i]) = n[r];
        }
        for (int lane = 0; lane < 4; lane++) {
            double *u = b->unit[i + (uint32_t)lane];
            bool far = beyond[lane];
            u[far ? 0 : 3] = PBS_UNIT;
            u[far] = PBS_UNIT * n[0][lane], u[far + 1] = PBS_UNIT * n[1][lane];
            u[far + 2] = PBS_UNIT * n[2][lane];
            b->faces[i + (uint32_t)lane] = (uint8_t)faces[lane];
            b->slot[i + (uint32_t)lane] = far;
        }
    }
}

/* Vertex normals decoded as in vec.h, and placed. */
LANE void smooth_all(const pbs_placing *g, const pbs_corners *in, pbs_batch *b) {
    float k[9];
    for (int i = 0; i < 9; i++) k[i] = (float)g->cofactor[i];
    for (uint32_t i = 0; i < b->t.count; i += 4)
        for (int c = 0; c < 3; c++) {
            i4 packed = *(const i4_at *)(const void *)&in->normal[c][i];
            f4 x = __builtin_convertvector((packed << 16) >> 16, f4) * (1 / 32767.0f);
            f4 y = __builtin_convertvector(packed >> 16, f4) * (1 / 32767.0f);
            f4 z = 1 - abs4f(x) - abs4f(y), t = (f4)((i4)(-z) & (z < 0));
            x -= turn4f(t, x), y -= turn4f(t, y);
            f4 w = 1 / sqrt4f(x * x + y * y + z * z);
            x *= w, y *= w, z *= w;
            f4 n[3];
#pragma GCC unroll 3
            for (int r = 0; r < 3; r++) n[r] = k[3 * r] * x + k[3 * r + 1] * y + k[3 * r + 2] * z;
            for (uint32_t lane = 0; lane < 4; lane++) {
                const f4 own = {n[0][lane], n[1][lane], n[2][lane], 0};
                memcpy(b->smooth[i + lane][c], &own, sizeof own);
            }
        }
}
#endif
