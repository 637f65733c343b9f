/* parts.h: soups and cubes as parts, and trees of them, for the tests of what walks over scenes. */
#ifndef PBS_PARTS_H
#define PBS_PARTS_H
#include "tests/unit/scenes.h"

static inline double chance(uint64_t *state) {
    return random_bits(state) / 4294967296.0;
}
static inline double between(uint64_t *state, double a, double b) {
    return a + (b - a) * chance(state);
}

/* ---- parts ---- */

static inline void put_triangle(const maker *m, const double p[3][3]) {
    pbs_corner c[3];
    memset(c, 0, sizeof c);
    for (int i = 0; i < 3; i++) memcpy(c[i].position, p[i], sizeof c[i].position);
    must(m->s->triangle(m->s->ctx, c, PBS_NONE, &err), &err);
}

static inline void begin_part(const maker *m, double x, double y, double z) {
    const double origin[3] = {x, y, z};
    must(m->s->part_begin(m->s->ctx, "", origin, 0, &err), &err);
}

static inline uint32_t end_part(const maker *m) {
    uint32_t node;
    must(m->s->part_end(m->s->ctx, &node, &err), &err);
    return node;
}

static inline uint32_t soup(const maker *m, uint32_t triangles, double size, const double origin[3],
                            uint64_t *seed) {
    begin_part(m, origin[0], origin[1], origin[2]);
    for (uint32_t t = 0; t < triangles; t++) {
        double at[3], p[3][3], reach = t % 50 ? 0.1 : 1;
        for (int k = 0; k < 3; k++) at[k] = between(seed, -1, 1);
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                p[i][k] = origin[k] + size * (at[k] + reach * between(seed, -1, 1));
        put_triangle(m, p);
    }
    return end_part(m);
}

enum { WHOLE = 1 << 0, TURNED = 1 << 1, HALF_ONE = 1 << 2, HALF_TWO = 1 << 3 };

/* 12 triangles from low to high on each axis; those of one half of its faces, or all. */
static inline void put_cube(const maker *m, double low, double high, unsigned which) {
    for (int f = 0; f < 6; f++) {
        int k = f / 2, up = f % 2;
        bool wanted = which & WHOLE || (f < 3 ? which & HALF_ONE : which & HALF_TWO);
        double c[4][3];
        for (int i = 0; i < 4 && wanted; i++) {
            bool a = i & 1, b = i >> 1;
            c[i][k] = up ? high : low;
            c[i][(k + 1) % 3] = a ? high : low;
            c[i][(k + 2) % 3] = b ? high : low;
        }
        for (int t = 0; t < 2 && wanted; t++) {
            double p[3][3];
            for (int i = 0; i < 3; i++) {
                int from = up != !!(which & TURNED) ? t + i : t + 2 - i;
                memcpy(p[i], c[t ? (from == 1 ? 1 : from == 2 ? 3 : 2) : from], sizeof p[i]);
            }
            put_triangle(m, p);
        }
    }
}

static inline uint32_t cube(const maker *m, unsigned which) {
    begin_part(m, 0.5, 0.25, -1);
    put_cube(m, -1, 1, which);
    return end_part(m);
}

static inline pbs_child placed(uint32_t node, uint64_t *seed, double scale, double spread) {
    pbs_child c = {.node = node};
    for (int i = 0; i < 12; i++)
        c.m[i] = i % 4 == 3 ? between(seed, -spread, spread) : scale * between(seed, -1, 1);
    return c;
}

static inline pbs_child here(uint32_t node) {
    return child_at(node, 0, 1, false);
}

/* Parts in assemblies in assemblies; turned, sheared, mirrored; scales from 2^-8 to 2^8. */
static inline uint32_t tree(const maker *m, double offset, uint64_t *seed) {
    uint32_t node[14];
    for (int i = 0; i < 4; i++) {
        double origin[3];
        for (int k = 0; k < 3; k++) origin[k] = between(seed, -2, 2);
        node[i] = soup(m, i ? 30 : 200, exp2(-i), origin, seed);
    }
    for (int i = 4; i < 14; i++) {
        pbs_child c[4];
        for (int k = 0; k < 4; k++) {
            uint32_t from = i < 8 ? 0 : 4;
            uint32_t which = from + random_bits(seed) % (i < 8 ? 4 : (unsigned)i - 4);
            c[k] = placed(node[which], seed, exp2(between(seed, -2, 1)), 4);
            if (k == 3 && i % 3 == 0) c[k] = c[0]; /* twice in one place */
        }
        node[i] = add_assembly(m, c, 4);
    }
    pbs_child top = here(node[13]);
    for (int k = 0; k < 3; k++) top.m[4 * k + 3] = offset * (k + 1);
    return add_assembly(m, &top, 1);
}
#endif
