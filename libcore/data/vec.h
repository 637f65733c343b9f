/* vec.h: small vectors, affine transforms, octahedral normals and sRGB. All inline, no state.
 *
 * A transform is 12 doubles in three rows: p' = (m[0..2].p + m[3], m[4..6].p + m[7],
 * m[8..10].p + m[11]).
 */
#ifndef PBS_VEC_H
#define PBS_VEC_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

typedef struct pbs_box {
    double min[3], max[3]; /* empty: min > max */
} pbs_box;

#define PBS_BOX_EMPTY ((pbs_box){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}})

static inline bool pbs_box_is_empty(const pbs_box *b) {
    return !(b->min[0] <= b->max[0] && b->min[1] <= b->max[1] && b->min[2] <= b->max[2]);
}
static inline void pbs_box_add(pbs_box *b, const double p[3]) {
    for (int k = 0; k < 3; k++) {
        b->min[k] = p[k] < b->min[k] ? p[k] : b->min[k];
        b->max[k] = p[k] > b->max[k] ? p[k] : b->max[k];
    }
}

static const double PBS_IDENTITY[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

static inline void pbs_xform_point(double out[3], const double m[12], const double p[3]) {
    double x = p[0], y = p[1], z = p[2];
    for (int r = 0; r < 3; r++)
        out[r] = m[4 * r] * x + m[4 * r + 1] * y + m[4 * r + 2] * z + m[4 * r + 3];
}
/* out = a after b; may be one of them */
static inline void pbs_xform_mul(double out[12], const double a[12], const double b[12]) {
    double t[12];
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            t[4 * r + c] = a[4 * r] * b[c] + a[4 * r + 1] * b[4 + c] + a[4 * r + 2] * b[8 + c] +
                           (c == 3 ? a[4 * r + 3] : 0);
    memcpy(out, t, sizeof t);
}
static inline double pbs_xform_det(const double m[12]) {
    return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
           m[2] * (m[4] * m[9] - m[5] * m[8]);
}
/* Whether it presses flat, relative to its longest axis: uniform scales of any size do not. */
static inline bool pbs_xform_is_singular(const double m[12]) {
    double norm = 0, unit[12];
    for (int r = 0; r < 3; r++)
        norm = fmax(norm, hypot(hypot(m[4 * r], m[4 * r + 1]), m[4 * r + 2]));
    for (int i = 0; i < 12; i++) unit[i] = m[i] / norm;
    return !(fabs(pbs_xform_det(unit)) > 1e-30);
}
/* The box of a transformed box. */
static inline pbs_box pbs_xform_box(const double m[12], const pbs_box *b) {
    pbs_box out = PBS_BOX_EMPTY;
    for (int i = 0; i < 8 && !pbs_box_is_empty(b); i++) {
        double p[3] = {i & 1 ? b->max[0] : b->min[0], i & 2 ? b->max[1] : b->min[1],
                       i & 4 ? b->max[2] : b->min[2]};
        pbs_xform_point(p, m, p);
        pbs_box_add(&out, p);
    }
    return out;
}
/* Cofactor matrix (row by row): what normals are multiplied with. Right for mirrored, sheared and
 * singular transforms up to length and, for a negative determinant, sign. */
static inline void pbs_xform_cofactor(double out[9], const double m[12]) {
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            int r1 = (r + 1) % 3, r2 = (r + 2) % 3, c1 = (c + 1) % 3, c2 = (c + 2) % 3;
            out[3 * r + c] = m[4 * r1 + c1] * m[4 * r2 + c2] - m[4 * r1 + c2] * m[4 * r2 + c1];
        }
}

/* Octahedral normals, two signed 16-bit numbers; worst error 0.0038 degrees. The zero vector,
 * NaN, and what is so long that its sum overflows (1e38), become +z. */
static inline int16_t pbs_snorm16(float v) {
    v = v > 1 ? 1 : v < -1 ? -1 : v;
    return (int16_t)(v * 32767.0f + (v < 0 ? -0.5f : 0.5f));
}
#define PBS_NO_NORMAL (-32768) /* both numbers: there is none; no direction is written so */
static inline void pbs_oct_encode(int16_t out[2], const float n[3]) {
    float s = fabsf(n[0]) + fabsf(n[1]) + fabsf(n[2]);
    if (!(s > 0) || !(s < INFINITY)) {
        out[0] = out[1] = 0;
        return;
    }
    float x = n[0] / s, y = n[1] / s;
    if (n[2] < 0) {
        float t = (1 - fabsf(y)) * (x < 0 ? -1.0f : 1.0f);
        y = (1 - fabsf(x)) * (y < 0 ? -1.0f : 1.0f);
        x = t;
    }
    out[0] = pbs_snorm16(x);
    out[1] = pbs_snorm16(y);
}
static inline void pbs_oct_decode(float n[3], const int16_t in[2]) {
    float x = in[0] * (1 / 32767.0f), y = in[1] * (1 / 32767.0f);
    float z = 1 - fabsf(x) - fabsf(y), t = z < 0 ? -z : 0;
    x += x < 0 ? t : -t;
    y += y < 0 ? t : -t;
    float l = 1 / sqrtf(x * x + y * y + z * z);
    n[0] = x * l, n[1] = y * l, n[2] = z * l;
}

static inline float pbs_srgb_to_linear(float v) {
    return v <= 0.04045f ? v / 12.92f : powf((v + 0.055f) / 1.055f, 2.4f);
}
static inline float pbs_linear_to_srgb(float v) {
    return v <= 0.0031308f ? v * 12.92f : 1.055f * powf(v, 1 / 2.4f) - 0.055f;
}
/* NaN becomes 0. */
static inline uint8_t pbs_unorm8(float v) {
    return v >= 1 ? 255 : v > 0 ? (uint8_t)(v * 255.0f + 0.5f) : 0;
}
#endif
