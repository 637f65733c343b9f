/* bench_levels [surfels]: how even a level between two levels is, by the two ways to have one.
 *
 * Paper 3, section 3.3, adds a random number in [0, 1) to the level of each point and takes those
 * up to the wanted one: `offset`. Level x is all points of levels up to floor(x) and a share x -
 * floor(x) of those of the next. Surfels know their true spacing, and a level is a prefix of them:
 * `spacing`; for the paper's way their spacings are rounded down to root / 2^level. Points of
 * clouds know their level only; but those of a level are in bit-reversed Morton order, and a prefix
 * of that is taken: `prefix`. Each is given as many points as `offset` takes.
 *
 * s = root / 2^x. Columns: points; over s: least, mean, standard deviation and 1st percentile of
 * the distance to the nearest other point; the largest distance of the surface from a point (holes)
 * and its 99th percentile; how far the number of points in balls of radius 3 s scatters over the
 * surface, standard deviation over mean. */
#include "libcore/measures/evenness.h"
#include "libcore/data/rng.h"
#include "libcore/surfels/sample.h"
#include "libcore/clouds/thin.h"
#include "tests/bench/bench_scene.h"
#include <stdio.h>
#include <string.h>

static pbs_run run = {.threads = 1};
static pbs_err err;

static void must(pbs_code rc) {
    if (!rc) return;
    fprintf(stderr, "bench_levels: %s\n", err.text);
    exit(rc);
}

/* Points in an order, each with a spacing that is its own, or that of its level. */
typedef struct set {
    size_t count;
    const float *position; /* of all candidates */
    uint32_t *id;
    float *spacing;
    double root; /* spacing of level 0 */
} set;

static int level_of(const set *s, size_t i) {
    int level = (int)ceil(log2(s->root / (double)s->spacing[i]) - 1e-6);
    return level > 0 ? level : 0;
}

static double offset_of(const set *s, size_t i) {
    return (double)(pbs_random(1, 0, s->id[i]) >> 11) * 0x1p-53;
}

static size_t add(const set *s, size_t i, float *out, size_t n) {
    memcpy(out + 3 * n, s->position + 3 * (size_t)s->id[i], 12);
    return n + 1;
}

static size_t by_offset(const set *s, double wanted, float *out) {
    size_t n = 0;
    for (size_t i = 0; i < s->count; i++)
        if (level_of(s, i) + offset_of(s, i) <= wanted + 1) n = add(s, i, out, n);
    return n;
}

/* The order of both: the largest spacings come first. */
static size_t by_order(const set *s, size_t all, float *out) {
    for (size_t i = 0; i < all; i++) add(s, i, out, i);
    return all;
}

static void print(const char *way, double wanted, double s, const pbs_points *surface,
                  float *position, size_t n) {
    pbs_evenness e;
    pbs_points p = {.count = n, .position = position};
    must(pbs_evenness_of(&run, &p, surface, 3 * s, &e, &err));
    printf("%-10s %5.2f %8zu %7.3f %7.3f %7.3f %7.3f %9.3f %7.3f %8.3f\n", way, wanted, n,
           e.least / s, e.mean / s, e.sigma / s, e.percentile / s, e.covering / s, e.covering99 / s,
           e.scatter);
    fflush(stdout);
}

static void print_head(const char *name) {
    printf("%s\n%-10s %5s %8s %7s %7s %7s %7s %9s %7s %8s\n", name, "way", "level", "points",
           "least", "mean", "sigma", "1 %", "covering", "99 %", "scatter");
}

/* From level x to x + 1. */
static void both(const set *s, double x, const char *other, const pbs_points *c, float *out) {
    for (double l = x; l <= x + 1; l += 0.25) {
        double spacing = s->root * exp2(-l);
        size_t n = by_offset(s, l, out);
        print("offset", l, spacing, c, out, n);
        print(other, l, spacing, c, out, by_order(s, n, out));
    }
}

/* ---- surfels ---- */

static void surfels(const pbs_points *c, size_t count) {
    pbs_sampler *sampler;
    pbs_sample_params p = {.count = count};
    pbs_sample_result r;
    set s = {.position = c->position, .id = need(count, 4), .spacing = need(count, 4)};
    float *out = need(count, 12);
    must(pbs_sampler_new(&run, &sampler, &err));
    must(pbs_sample(sampler, c, &p, s.id, s.spacing, &r, &err));
    pbs_sampler_free(sampler);
    s.count = r.count;
    s.root = (double)s.spacing[r.count - 1] * 16; /* the last is of level 4 */
    print_head("surfels: the greedy permutation's own spacing");
    both(&s, 3, "spacing", c, out);
    free(s.id), free(s.spacing), free(out);
}

/* ---- a cloud's levels ---- */

/* In Morton order of the lattice, then the ranks of each level with their bits reversed. */
typedef struct coded {
    uint64_t code;
    uint32_t id;
} coded;

static int by_code(const void *a, const void *b) {
    uint64_t x = ((const coded *)a)->code, y = ((const coded *)b)->code;
    return x < y ? -1 : x > y;
}

static uint64_t spread(uint64_t v) {
    uint64_t r = 0;
    for (int b = 0; b < 21; b++) r |= (v >> b & 1) << (3 * b);
    return r;
}

static void put_level(set *s, const pbs_thin_set *kept, float spacing) {
    size_t n = kept->count, side = 1;
    while (side < n) side *= 2;
    for (size_t i = 0, rank = 0; i < side; i++) {
        if (rank < n) s->id[s->count] = kept->id[rank], s->spacing[s->count++] = spacing;
        size_t bit = side >> 1;
        while (rank & bit) rank ^= bit, bit >>= 1;
        rank |= bit;
    }
}

enum { STEPS = 1 << 14 }; /* of the lattice, along 2 units */

/* From the finest level up: what a level keeps goes on to the next. */
static void make_levels(const pbs_points *c, set *s, int fine, int levels) {
    coded *a = need(c->count, sizeof *a);
    pbs_thin t = {0};
    pbs_thin_set of[2], rejected[8];
    must(pbs_thin_new(&run, c->count, &t, &err));
    for (int i = 0; i < 2; i++) must(pbs_thin_set_new(&run, c->count, false, &of[i], &err));
    for (size_t i = 0; i < c->count; i++) {
        a[i] = (coded){0, (uint32_t)i};
        for (int k = 0; k < 3; k++)
            a[i].code |= spread((uint64_t)(((double)c->position[3 * i + k] + 2) * STEPS / 2)) << k;
    }
    qsort(a, c->count, sizeof *a, by_code);
    for (size_t i = 0; i < c->count; i++) {
        int32_t q[3];
        for (int k = 0; k < 3; k++)
            q[k] = (int32_t)(((double)c->position[3 * (size_t)a[i].id + k] + 2) * STEPS / 2);
        pbs_thin_put(&of[0], q[0], q[1], q[2], a[i].id);
    }
    for (int l = 0; l < levels; l++) {
        must(pbs_thin_set_new(&run, c->count, false, &rejected[l], &err));
        of[1].count = 0;
        must(pbs_thin_level(&t, &of[0], fine + l, false, &of[1], &rejected[l], &err));
        pbs_thin_set swap = of[0];
        of[0] = of[1], of[1] = swap;
    }
    s->root = ldexp(2.0 / STEPS, fine + levels - 1);
    put_level(s, &of[0], (float)s->root);
    for (int l = levels - 1; l > 0; l--)
        put_level(s, &rejected[l], (float)ldexp(2.0 / STEPS, fine + l - 1));
    for (int i = 0; i < 2; i++) pbs_thin_set_free(&run, &of[i]);
    for (int l = 0; l < levels; l++) pbs_thin_set_free(&run, &rejected[l]);
    pbs_thin_free(&t);
    free(a);
}

static void cloud(const pbs_points *c) {
    set s = {.position = c->position, .id = need(c->count, 4), .spacing = need(c->count, 4)};
    float *out = need(c->count, 12);
    make_levels(c, &s, 6, 5);
    print_head("a cloud's levels, which know no more than their level's spacing");
    both(&s, 1, "prefix", c, out);
    free(s.id), free(s.spacing), free(out);
}

int main(int argc, char **argv) {
    size_t count = argc > 1 ? strtoul(argv[1], NULL, 10) : 10000;
    pbs_points c = make(count * 20);
    surfels(&c, count);
    cloud(&c);
    free(c.position), free(c.normal);
    return 0;
}
