/* latticed.h: wavy meshes with any arrays, on lattices or not yet, and an archive of two that share
 * corners. Included behind support.h by tests of meshes' lattices and of codecs. */
#ifndef PBS_TEST_LATTICED_H
#define PBS_TEST_LATTICED_H

#include "formats/scene/meshbits.h"
#include "formats/scene/meshbuild.h"
#include <math.h>

static inline uint32_t noise(uint64_t x) {
    for (int k = 0; k < 3; k++) x = (x ^ x >> 31) * 0x9e3779b97f4a7c15u;
    return (uint32_t)(x >> 32);
}

/* A sheet of side * side corners from (x, 0, 0) on, about 1 apart, its squares in no order; arrays
 * as a MESH chunk has them. The payload is malloc'ed. */
static inline blob wavy_mesh(uint32_t side, double x, uint32_t arrays) {
    uint32_t v = side * side, squares = (side - 1) * (side - 1), t = 2 * squares;
    blob b = {calloc(1, 16 + 28 * (size_t)v + 10 * (size_t)t), 0};
    uint32_t *order = malloc(squares * sizeof *order);
    for (uint32_t i = 0; i < squares; i++) {
        uint32_t k = noise(i) % (i + 1);
        order[i] = order[k], order[k] = i;
    }
    uint8_t *p = b.bytes;
    p = pbs_put_u32(pbs_put_u32(pbs_put_u32(pbs_put_u32(p, v), t), arrays), 3);
    for (uint32_t i = 0; i < v; i++) {
        double a = x + i % side, c = i / side;
        uint32_t some = noise((uint64_t)(a * 1000 + c)); /* where two meshes meet, the same */
        a += (some & 0xffff) * 0x1p-18, c += (some >> 16) * 0x1p-18;
        p = pbs_put_f32(pbs_put_f32(p, (float)a), (float)c);
        p = pbs_put_f32(p, (float)(sin(a / 3) * cos(c / 5)));
    }
    for (uint32_t i = 0; arrays & 1 && i < v; i++) {
        float n[3] = {(float)(noise(i) >> 16) * 0x1p-18f, (float)(i / side) / (float)side, 0.5f};
        int16_t o[2];
        pbs_oct_encode(o, n);
        p = pbs_put_u16(pbs_put_u16(p, (uint16_t)o[0]), (uint16_t)o[1]);
    }
    for (uint32_t i = 0; arrays & 2 && i < v; i++)
        for (uint32_t k = 0; k < 2; k++) {
            double at = k ? -(double)(i / side) : i % side;
            p = pbs_put_f32(p, (float)(at / 7 + (noise(2 * i + k) >> 16) * 0x1p-22));
        }
    for (uint32_t i = 0; arrays & 4 && i < v; i++) p = pbs_put_u32(p, i / side * 0x01020408u);
    for (uint32_t i = 0; arrays & 8 && i < t; i++) {
        uint32_t m = order[i / 2] / side / 5;
        p = pbs_put_u32(p, m % 5 ? m % 5 : PBS_NONE);
    }
    for (uint32_t i = 0; i < squares; i++) {
        uint32_t at = order[i] / (side - 1) * side + order[i] % (side - 1);
        const uint32_t six[6] = {at, at + 1, at + side, at + 1, at + side + 1, at + side};
        for (int k = 0; k < 6; k++) p = pbs_put_u16(p, (uint16_t)six[k]);
    }
    b.size = (size_t)(p - b.bytes);
    free(order);
    return b;
}

/* The mesh on a lattice of 2^exponent, moved from one origin to another; frees b. */
static inline blob snapped(pbs_run *run, blob b, int exponent, const double from[3],
                           const double to[3]) {
    pbs_mesh_snap s = {.exponent = exponent};
    pbs_err err = {0};
    uint8_t *out;
    uint32_t flat;
    blob c = {NULL, 0};
    memcpy(s.from, from, sizeof s.from), memcpy(s.to, to, sizeof s.to);
    must(pbs_mesh_snap_to(run, &s, b.bytes, &out, &c.size, &flat, &err), &err);
    if (out) {
        c.bytes = malloc(c.size);
        memcpy(c.bytes, out, c.size);
    }
    pbs_free(run, out);
    free(b.bytes);
    return c;
}

enum { LATTICED_SIDE = 12, LATTICED_EXPONENT = -8, LATTICED_CHUNKS = 2 + 5 + 2 };

/* Two nodes of which each has such a mesh with all arrays, the second where the first one ends. */
static inline blob small_latticed(pbs_run *run, pbs_codec packed) {
    static const double origin[2][3] = {{0.3, 7, -1}, {11.7, 2, 0}}, zero[3] = {0};
    uint8_t material[144] = {0};
    pbs_writer *w = coded_writer(run, PBS_ARCHIVE, "", LATTICED_CHUNKS, packed);
    pbs_err err = {0};
    for (uint32_t i = 0; i < 2; i++) {
        pbs_child child;
        pbs_node n = small_node(i, 0, i ? &child : NULL);
        memcpy(n.origin, origin[i], sizeof n.origin);
        must(pbs_node_write(run, w, &n, &err), &err);
    }
    for (int i = 0; i < 3; i++) pbs_put_u32(material + 44 + 32 * i, PBS_NONE);
    for (uint32_t i = 0; i < 5; i++)
        mixed_put(w, (pbs_chunk){.tag = PBS_TAG_MATERIAL, .node = i, .count = 1}, material,
                  sizeof material);
    for (uint32_t i = 0; i < 2; i++) {
        blob b = snapped(run, wavy_mesh(LATTICED_SIDE, i * (LATTICED_SIDE - 1), 15),
                         LATTICED_EXPONENT, zero, origin[i]);
        mixed_put(w,
                  (pbs_chunk){.tag = PBS_TAG_MESH,
                              .node = i,
                              .count = pbs_get_u32(b.bytes + 4),
                              .flags = pbs_mesh_flags(LATTICED_EXPONENT)},
                  b.bytes, b.size);
        free(b.bytes);
    }
    return take_bytes(w);
}
#endif
