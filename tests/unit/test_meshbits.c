/* Meshes on lattices: how far anything moves, that what meets stays together, and that whole
 * numbers and floats are the same. */
#include "tests/unit/support.h"
#include "tests/unit/latticed.h"
#include "tests/check.h"

static pbs_run run = {.threads = 1};
static pbs_err err;
static const double zero[3] = {0};

static pbs_mesh view(blob b) {
    pbs_mesh m;
    pbs_chunk c = {.bytes = b.size, .payload = b.bytes, .count = pbs_get_u32(b.bytes + 4)};
    CHECK(!pbs_mesh_parse("test", &c, &m, &err));
    return m;
}

TEST(steps_along_the_longest_side) {
    for (double side = 1e-30; side < 1e25; side *= 3.7)
        for (unsigned bits = 1; bits <= PBS_MESH_BITS_MOST; bits++) {
            double steps = side / ldexp(1, pbs_mesh_exponent(side, bits));
            CHECK_NUM(steps <= ldexp(1, (int)bits) && steps > ldexp(1, (int)bits - 1), side);
        }
    CHECK(pbs_mesh_exponent(8, 3) == 0 && pbs_mesh_exponent(8.001, 3) == 1);
    const double none[] = {0, -1, NAN, INFINITY, 1e300};
    for (int i = 0; i < 5; i++) CHECK_NUM(pbs_mesh_exponent(none[i], 9) == PBS_MESH_EXACT, i);
    CHECK(pbs_mesh_exponent(1, 0) == PBS_MESH_EXACT);
    for (int e = -140; e <= 95; e++)
        CHECK_NUM(pbs_mesh_flags_step(pbs_mesh_flags(e)) == ldexp(1, e), e);
    CHECK(!pbs_mesh_flags(PBS_MESH_EXACT) && pbs_mesh_flags_step(0) == 0);
    CHECK(!(pbs_mesh_flags(95) & 0xff));
}

/* ---- how far things move ---- */

static double degrees_between(const int16_t a[2], const int16_t b[2]) {
    float x[3], y[3];
    double dot = 0, cross = 0;
    pbs_oct_decode(x, a), pbs_oct_decode(y, b);
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        double c = (double)x[i] * y[j] - (double)x[j] * y[i];
        dot += (double)x[k] * y[k], cross += c * c;
    }
    return atan2(sqrt(cross), dot) * 180 / M_PI;
}

/* from and to: origins. A mesh whose corners stay apart keeps their order. */
static void within_bounds(uint32_t side, uint32_t arrays, int exponent, const double from[3],
                          const double to[3]) {
    blob a = wavy_mesh(side, 0, arrays), b = snapped(&run, copy_blob(a), exponent, from, to);
    CHECK(b.bytes);
    if (!b.bytes) return;
    pbs_mesh m = view(a), n = view(b);
    double step = ldexp(1, exponent);
    CHECK(m.vertices == n.vertices && m.triangles == n.triangles && n.material == 3);
    for (uint32_t i = 0; i < 3 * m.vertices; i++) {
        uint32_t k = i % 3;
        double moved = (to[k] - from[k]) + n.position[i] - m.position[i];
        double size = fabs(n.position[i]) + fabs(from[k]) * 0x1p-28;
        CHECK_NUM(fabs(moved) <= step / 2 + size * 0x1p-24, moved);
    }
    for (uint32_t i = 0; m.normal && i < 2 * m.vertices; i += 2)
        CHECK(degrees_between(m.normal + i, n.normal + i) <= 0.25);
    for (uint32_t i = 0; m.uv && i < 2 * m.vertices; i++)
        CHECK_NUM(fabsf(m.uv[i] - n.uv[i]) <= 0x1p-15f, m.uv[i]);
    CHECK(!m.colour || !memcmp(m.colour, n.colour, 4 * m.vertices));
    CHECK(!memcmp(m.index, n.index, 6 * m.triangles));
    CHECK(!m.triangle_material ||
          !memcmp(m.triangle_material, n.triangle_material, 4 * m.triangles));
    free(a.bytes);
    free(b.bytes);
}

TEST(nothing_moves_further_than_is_promised) {
    static const double far[3] = {1e7, -2e7, 3.25e6}, odd[3] = {0.1, 1 / 3.0, -7.77};
    for (uint32_t arrays = 0; arrays < 16; arrays++)
        for (int e = -14; e <= -2; e += 3) {
            within_bounds(20, arrays, e, zero, zero);
            within_bounds(20, arrays, e, odd, zero);
            within_bounds(20, arrays, e, zero, odd);
        }
    for (int e = -12; e <= -2; e += 2) within_bounds(30, 15, e, far, far);
}

TEST(normals_everywhere) {
    uint64_t seed = 7;
    blob b = wavy_mesh(100, 0, 1);
    pbs_mesh m = view(b), n;
    for (uint32_t i = 0; i < 2 * m.vertices; i++)
        ((int16_t *)m.normal)[i] = (int16_t)random_bits(&seed);
    blob c = snapped(&run, copy_blob(b), -8, zero, zero);
    n = view(c);
    double most = 0;
    for (uint32_t i = 0; i < 2 * m.vertices; i += 2)
        most = fmax(most, degrees_between(m.normal + i, n.normal + i));
    CHECK_NUM(most <= 0.25 && most > 0.1, most);
    free(b.bytes);
    free(c.bytes);
}

/* ---- what meets stays together ---- */

/* Two nodes with origins of their own, and meshes that share the corners of an edge: each corner is
 * one point of the world's lattice, the same one. */
static void no_crack(const double from[3], const double a[3], const double b[3], int exponent) {
    enum { SIDE = 30 };
    blob x = snapped(&run, wavy_mesh(SIDE, 0, 1), exponent, from, a);
    blob y = snapped(&run, wavy_mesh(SIDE, SIDE - 1, 1), exponent, from, b);
    pbs_mesh m = view(x), n = view(y);
    double step = ldexp(1, exponent);
    for (uint32_t row = 0; row < SIDE; row++)
        for (uint32_t k = 0; k < 3; k++) {
            double p = a[k] + m.position[3 * (row * SIDE + SIDE - 1) + k];
            double q = b[k] + n.position[3 * row * SIDE + k];
            CHECK_NUM(floor(p / step + 0.5) == floor(q / step + 0.5), p - q);
            double beside = p - step * floor(p / step + 0.5);
            CHECK_NUM(fabs(beside) <= (fabs(p) + fabs(a[k])) * 0x1p-23, beside);
        }
    free(x.bytes);
    free(y.bytes);
}

TEST(neighbours_do_not_come_apart) {
    static const double origin[][3] = {
        {0, 0, 0}, {0.1, -0.7, 1 / 3.0}, {14.5, 14.5, 0}, {43.7, 11.1, -0.3}, {29, 0.3, 1e-9}};
    for (size_t i = 0; i < 5; i++)
        for (size_t k = 0; k < 5; k++)
            for (int e = -13; e <= -1; e += 2)
                no_crack(origin[(i + k) % 5], origin[i], origin[k], e);
    static const double far[3] = {1e6 + 0.1, 1e6 - 0.3, -1e6};
    no_crack(far, far, far, -6);
}

/* ---- what becomes equal ---- */

TEST(flat_triangles_go) {
    pbs_mesh_snap s = {.exponent = 3};
    blob b = wavy_mesh(33, 0, 8);
    pbs_mesh m = view(b), n;
    uint8_t *out;
    size_t size;
    uint32_t flat;
    must(pbs_mesh_snap_to(&run, &s, b.bytes, &out, &size, &flat, &err), &err);
    n = view((blob){out, size});
    CHECK(n.vertices < 60 && flat && n.triangles == m.triangles - flat);
    for (uint32_t t = 0; t < n.triangles; t++)
        for (int i = 0; i < 3; i++)
            CHECK_NUM(memcmp(n.position + 3 * n.index[3 * t + (uint32_t)i],
                             n.position + 3 * n.index[3 * t + (uint32_t)(i + 1) % 3], 12),
                      t);
    pbs_free(&run, out);
    s.exponent = 10; /* one place is left, and one triangle */
    must(pbs_mesh_snap_to(&run, &s, b.bytes, &out, &size, &flat, &err), &err);
    n = view((blob){out, size});
    CHECK(n.triangles == 1 && n.vertices >= 1 && flat == m.triangles - 1);
    CHECK(n.triangle_material[0] == m.triangle_material[0]);
    CHECK(pbs_mesh_on_lattice(out, size));
    pbs_free(&run, out);
    free(b.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

/* ---- numbers that are too large ---- */

TEST(what_is_too_far_stays) {
    static const double there[3] = {1e9, 0, 0}, nowhere[3] = {1e300, -1e300, 0};
    CHECK(!snapped(&run, wavy_mesh(4, 0, 0), -5, there, zero).bytes);
    CHECK(!snapped(&run, wavy_mesh(4, 1e6, 0), -5, zero, zero).bytes);
    CHECK(!snapped(&run, wavy_mesh(4, 0, 0), PBS_MESH_EXACT, zero, zero).bytes);
    blob b = snapped(&run, wavy_mesh(4, 0, 0), -5, nowhere, nowhere);
    CHECK(!b.bytes || pbs_mesh_on_lattice(b.bytes, b.size));
    free(b.bytes);
    /* Texture coordinates beyond whole numbers stay floats. */
    b = wavy_mesh(4, 0, 2);
    pbs_mesh m = view(b);
    ((float *)m.uv)[5] = 3e9f;
    blob c = snapped(&run, copy_blob(b), -5, zero, zero);
    pbs_mesh n = view(c);
    CHECK(!memcmp(m.uv, n.uv, 8 * m.vertices) && pbs_mesh_on_lattice(c.bytes, c.size));
    free(b.bytes);
    free(c.bytes);
}

/* ---- whole numbers ---- */

TEST(whole_numbers_and_back) {
    static const double a[3] = {0.1, 0.2, 0.3}, b[3] = {1.1, 5, 6.3};
    for (uint32_t arrays = 0; arrays < 16; arrays++) {
        blob x = snapped(&run, wavy_mesh(20, 0, arrays), -9, a, b), y = copy_blob(x);
        CHECK(pbs_mesh_on_lattice(x.bytes, x.size));
        CHECK(pbs_mesh_to_whole(y.bytes, y.size) && memcmp(x.bytes, y.bytes, x.size) != 0);
        CHECK(pbs_mesh_from_whole(y.bytes, y.size) && !memcmp(x.bytes, y.bytes, x.size));
        /* What is beside the lattice is not taken for what is on it. */
        for (size_t at = 64; at < 64 + 12 * 400; at += 600) {
            blob z = copy_blob(x);
            pbs_put_f32(z.bytes + at, pbs_get_f32(z.bytes + at) + 0x1p-12f);
            CHECK(!pbs_mesh_on_lattice(z.bytes, z.size) && !pbs_mesh_to_whole(z.bytes, z.size));
            free(z.bytes);
        }
        free(x.bytes);
        free(y.bytes);
    }
}

TEST(lattices_that_are_none) {
    blob b = snapped(&run, wavy_mesh(4, 0, 1), -5, zero, zero);
    pbs_mesh_lattice l;
    CHECK(pbs_mesh_lattice_get(b.bytes, b.size, &l) && l.step == 0x1p-5);
    CHECK(!pbs_mesh_lattice_get(b.bytes, 63, &l));
    const double steps[] = {0, -1, NAN, INFINITY, 3, 0x1p96, 0x1p-141};
    for (int i = 0; i < 7; i++) {
        blob c = copy_blob(b);
        pbs_put_f64(c.bytes + 40, steps[i]);
        CHECK_NUM(!pbs_mesh_lattice_get(c.bytes, c.size, &l), steps[i]);
        CHECK_NUM(!pbs_mesh_from_whole(c.bytes, c.size), steps[i]);
        free(c.bytes);
    }
    const double corners[] = {NAN, INFINITY, 1};
    for (int i = 0; i < 3; i++) {
        blob c = copy_blob(b);
        pbs_put_f64(c.bytes + 16 + 8 * i, corners[i]);
        CHECK_NUM(!pbs_mesh_lattice_get(c.bytes, c.size, &l), corners[i]);
        free(c.bytes);
    }
    const uint32_t bits[] = {1, 17, 31 << 8, UINT32_MAX};
    for (int i = 0; i < 4; i++) {
        blob c = copy_blob(b);
        pbs_put_u32(c.bytes + 60, bits[i]);
        CHECK_NUM(!pbs_mesh_lattice_get(c.bytes, c.size, &l), i);
        free(c.bytes);
    }
    free(b.bytes);
}

TEST_MAIN
