/* cloud.h: candidates for the tests of averages and measures: shapes, ties, walls, bad numbers. */
#ifndef PBS_CLOUD_H
#define PBS_CLOUD_H
#include "libcore/data/rng.h"
#include "libcore/surfels/sample.h"
#include "libcore/data/vec.h"
#include "tests/check.h"

enum { MOST = 140000, CLOUDS = 9 };

typedef struct cloud {
    pbs_points points;
    float position[3 * MOST];
    int16_t normal[2 * MOST];
    uint8_t colour[4 * MOST], material[4 * MOST], emissive[4 * MOST];
} cloud;

static double uniform(uint64_t *state) {
    *state += 1;
    return (double)(pbs_mix64(*state * 0x9e3779b97f4a7c15u) >> 11) * 0x1p-53;
}

static void add(cloud *c, double x, double y, double z, double nx, double ny, double nz) {
    size_t i = c->points.count++;
    uint64_t r = pbs_mix64(i + 17);
    c->position[3 * i] = (float)x, c->position[3 * i + 1] = (float)y;
    c->position[3 * i + 2] = (float)z;
    pbs_oct_encode(c->normal + 2 * i, (float[3]){(float)nx, (float)ny, (float)nz});
    memcpy(c->colour + 4 * i, &r, 4);
    memcpy(c->emissive + 4 * i, (char *)&r + 4, 4);
    c->emissive[4 * i + 3] = 0;
    c->material[4 * i] = (uint8_t)r, c->material[4 * i + 1] = (uint8_t)(i % 256);
    c->material[4 * i + 2] = c->material[4 * i + 3] = 0;
}

static void sphere(cloud *c, size_t n, double scale, double at) {
    uint64_t r = n + 77;
    for (size_t i = 0; i < n; i++) {
        double z = 2 * uniform(&r) - 1, a = 6.283185307179586 * uniform(&r), s = sqrt(1 - z * z);
        double x = s * cos(a), y = s * sin(a);
        add(c, at + scale * x, at + scale * y, at + scale * z, x, y, z);
    }
}

/* Both sides of a plate on a regular grid: ties everywhere; gap 0: nothing but the normal differs.
 */
static void plate(cloud *c, size_t side, double gap) {
    for (size_t i = 0; i < side * side; i++) {
        add(c, (double)(i % side), (double)(i / side), gap, 0, 0, 1);
        add(c, (double)(i % side), (double)(i / side), 0, 0, 0, -1);
    }
}

static void make(cloud *c, int which) {
    memset(&c->points, 0, sizeof c->points);
    c->points.position = c->position, c->points.normal = c->normal, c->points.colour = c->colour;
    c->points.material = c->material, c->points.emissive = c->emissive;
    uint64_t r = 5;
    switch (which) {
    case 0:
        sphere(c, 3000, 1, 0);
        return;
    case 1:
        plate(c, 35, 0.3);
        return;
    case 2:
        plate(c, 35, 0);
        return;
    case 3: /* two clusters and one point far away */
        for (int i = 0; i < 2000; i++) {
            double s = i % 10 ? 1e-4 : 1;
            add(c, s * uniform(&r), s * uniform(&r), s * uniform(&r), 0, 1, uniform(&r));
        }
        add(c, 1e7, -1e7, 3, 1, 0, 0);
        return;
    case 4: /* many coincide */
        for (int i = 0; i < 2000; i++) {
            double x = floor(20 * uniform(&r)), y = floor(20 * uniform(&r));
            add(c, x, y, 0, i % 3 ? 1 : -1, i % 2 ? 1 : -1, 0);
        }
        return;
    case 5: /* not all are finite */
        sphere(c, 2500, 1, 0);
        for (size_t i = 0; i < 2500; i += 7)
            c->position[3 * i + i % 3] = i % 2 ? (float)NAN : INFINITY;
        return;
    case 6:
        sphere(c, 1500, 1e30, 0);
        return;
    case 7:
        sphere(c, 1500, 1e-38, 0);
        return;
    default:
        sphere(c, 1500, 1e-3, 1e4);
    }
}

static uint32_t order[MOST];
static float spacing[MOST];

static size_t sample_with(pbs_sampler *s, const cloud *c, const pbs_sample_params *p) {
    pbs_sample_result r = {0};
    CHECK(!pbs_sample(s, &c->points, p, order, spacing, &r, NULL));
    return r.count;
}
#endif
