#include "libcore/voxels/winding.h"
#include <float.h>

/* Both halves of the product, so that every bit of a and b matters. */
static uint64_t mix(uint64_t a, uint64_t b) {
    unsigned __int128 p = (unsigned __int128)a * b;
    return (uint64_t)p ^ (uint64_t)(p >> 64);
}

typedef struct place {
    uint64_t u, v;
} place;

static place place_of(const float p[3]) {
    float q[3] = {p[0] + 0.0f, p[1] + 0.0f, p[2] + 0.0f}; /* -0 becomes +0 */
    uint32_t bits[3];
    memcpy(bits, q, sizeof bits);
    uint64_t a = bits[0] | (uint64_t)bits[1] << 32, b = bits[2] * 0x9e3779b97f4a7c15u;
    return (place){mix(a ^ 0xa0761d6478bd642fu, b ^ 0xe7037ed1a0b428dbu),
                   mix(a ^ 0x8ebc6af09c88c6e3u, b ^ 0x589965cc75374cc3u)};
}

/* Twice the area. */
static uint64_t area(place a, place b, place c) {
    return (b.u - a.u) * (c.v - a.v) - (c.u - a.u) * (b.v - a.v);
}

/* Adds a . (b - a) x (c - a); *size grows by the magnitudes of its terms. */
static void add_volume(const float *a, const float *b, const float *c, double *sum, double *size) {
    double d[3], e[3];
    for (int k = 0; k < 3; k++) d[k] = (double)b[k] - a[k], e[k] = (double)c[k] - a[k];
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        double left = d[i] * e[j], right = d[j] * e[i];
        *sum += a[k] * (left - right);
        *size += fabs(a[k]) * (fabs(left) + fabs(right));
    }
}

/* A term is wrong by at most 8 roundings of its magnitude, and each of the 3 additions a triangle
 * by one of what is there by then. */
pbs_winding pbs_winding_of(const pbs_mesh *mesh) {
    pbs_winding w = {0, 0, 0};
    double size = 0;
    for (uint32_t t = 0; t < mesh->triangles; t++) {
        const uint16_t *i = mesh->index + 3 * (size_t)t;
        const float *a = mesh->position + 3 * (size_t)i[0], *b = mesh->position + 3 * (size_t)i[1],
                    *c = mesh->position + 3 * (size_t)i[2];
        w.border += area(place_of(a), place_of(b), place_of(c));
        add_volume(a, b, c, &w.volume, &size);
    }
    w.error = size * DBL_EPSILON * (3 * (double)mesh->triangles + 8);
    return w;
}

void pbs_winding_add(pbs_winding *sum, const pbs_winding *piece) {
    sum->border += piece->border;
    sum->volume += piece->volume;
    sum->error += piece->error + fabs(sum->volume) * DBL_EPSILON;
}

pbs_wound pbs_winding_says(const pbs_winding *w) {
    if (w->border) return PBS_WOUND_OPEN;
    if (!(fabs(w->volume) > w->error)) return PBS_WOUND_FLAT;
    return w->volume > 0 ? PBS_WOUND_OUT : PBS_WOUND_IN;
}
