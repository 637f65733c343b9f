/* Small vectors, transforms, octahedral normals, half floats, the lattice and the spacing of a
 * prefix: each against its definition, computed slowly in double. */
#include "libcore/data/quant.h"
#include "libcore/measures/spacing.h"
#include "libcore/data/vec.h"
#include "tests/check.h"

static uint64_t state = 1;
static uint32_t random_bits(void) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(state >> 32);
}
static double uniform(double lo, double hi) {
    return lo + (hi - lo) * (random_bits() / 4294967296.0);
}

/* ---- boxes and transforms ---- */

static void random_transform(double m[12], double scale) {
    for (int i = 0; i < 12; i++) m[i] = uniform(-scale, scale);
}

/* p' = m p with 4x4 matrices, the long way. */
static void slow_point(double out[3], const double m[12], const double p[3]) {
    const double h[4] = {p[0], p[1], p[2], 1};
    for (int r = 0; r < 3; r++) {
        out[r] = 0;
        for (int c = 0; c < 4; c++) out[r] += m[4 * r + c] * h[c];
    }
}

static bool near3(const double a[3], const double b[3], double eps) {
    double d = 0;
    for (int k = 0; k < 3; k++) d = fmax(d, fabs(a[k] - b[k]));
    return d <= eps;
}

TEST(transform_point_and_product) {
    for (int i = 0; i < 2000; i++) {
        double a[12], b[12], ab[12], p[3], q[3], want[3];
        random_transform(a, 3), random_transform(b, 3);
        for (int k = 0; k < 3; k++) p[k] = uniform(-5, 5);
        slow_point(want, b, p);
        pbs_xform_point(q, b, p);
        CHECK(near3(q, want, 1e-12));
        slow_point(want, a, want);
        pbs_xform_mul(ab, a, b);
        pbs_xform_point(q, ab, p);
        CHECK(near3(q, want, 1e-11));
        memcpy(q, p, sizeof q);
        pbs_xform_point(q, ab, q); /* in place */
        CHECK(near3(q, want, 1e-11));
        double c[12];
        memcpy(c, a, sizeof c), pbs_xform_mul(c, c, b);
        CHECK(!memcmp(c, ab, sizeof c));
        memcpy(c, b, sizeof c), pbs_xform_mul(c, a, c);
        CHECK(!memcmp(c, ab, sizeof c));
        pbs_xform_mul(c, a, PBS_IDENTITY);
        CHECK(!memcmp(c, a, sizeof c));
        pbs_xform_mul(c, PBS_IDENTITY, a);
        CHECK(!memcmp(c, a, sizeof c));
    }
}

TEST(determinant) {
    CHECK(pbs_xform_det(PBS_IDENTITY) == 1);
    const double mirror[12] = {-1, 0, 0, 9, 0, 2, 0, 9, 0, 0, 3, 9};
    CHECK(pbs_xform_det(mirror) == -6);
    for (int i = 0; i < 1000; i++) {
        double a[12], b[12], ab[12];
        random_transform(a, 2), random_transform(b, 2);
        pbs_xform_mul(ab, a, b);
        double want = pbs_xform_det(a) * pbs_xform_det(b);
        CHECK_NUM(fabs(pbs_xform_det(ab) - want) < 1e-11, want);
    }
}

/* The transformed normal is perpendicular to the transformed edges: also mirrored, sheared, flat.
 */
TEST(cofactor_carries_normals) {
    for (int i = 0; i < 2000; i++) {
        double m[12], cof[9], u[3], v[3], n[3], tu[3], tv[3], tn[3], cross[3];
        random_transform(m, 2);
        if (i % 3 == 0) m[8] = m[9] = m[10] = 0; /* singular: flattened to a plane */
        if (i % 7 == 0)
            for (int k = 0; k < 3; k++) m[4 + k] = 3 * m[k];
        for (int k = 0; k < 3; k++) u[k] = uniform(-1, 1), v[k] = uniform(-1, 1);
        for (int k = 0; k < 3; k++) {
            n[k] = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
            tu[k] = m[4 * k] * u[0] + m[4 * k + 1] * u[1] + m[4 * k + 2] * u[2];
            tv[k] = m[4 * k] * v[0] + m[4 * k + 1] * v[1] + m[4 * k + 2] * v[2];
        }
        pbs_xform_cofactor(cof, m);
        for (int k = 0; k < 3; k++) {
            tn[k] = cof[3 * k] * n[0] + cof[3 * k + 1] * n[1] + cof[3 * k + 2] * n[2];
            cross[k] = tu[(k + 1) % 3] * tv[(k + 2) % 3] - tu[(k + 2) % 3] * tv[(k + 1) % 3];
        }
        CHECK(near3(tn, cross, 1e-11)); /* M u x M v = cof(M) (u x v), sign and length included */
    }
}

TEST(boxes) {
    pbs_box b = PBS_BOX_EMPTY;
    CHECK(pbs_box_is_empty(&b));
    pbs_box_add(&b, (const double[3]){1, 2, 3});
    CHECK(!pbs_box_is_empty(&b) && b.min[1] == 2 && b.max[1] == 2);
    pbs_box_add(&b, (const double[3]){NAN, -1, 9});
    CHECK(b.min[0] == 1 && b.max[0] == 1 && b.min[1] == -1 && b.max[2] == 9);
    pbs_box empty = PBS_BOX_EMPTY, moved = pbs_xform_box(PBS_IDENTITY, &empty);
    CHECK(pbs_box_is_empty(&moved));
    for (int i = 0; i < 300; i++) {
        double m[12], p[3];
        random_transform(m, 4);
        pbs_box from = PBS_BOX_EMPTY, want = PBS_BOX_EMPTY;
        for (int k = 0; k < 2; k++) {
            for (int c = 0; c < 3; c++) p[c] = uniform(-3, 3);
            pbs_box_add(&from, p);
        }
        for (int c = 0; c < 8; c++) {
            for (int k = 0; k < 3; k++) p[k] = c >> k & 1 ? from.max[k] : from.min[k];
            slow_point(p, m, p);
            pbs_box_add(&want, p);
        }
        pbs_box got = pbs_xform_box(m, &from);
        CHECK(near3(got.min, want.min, 1e-12) && near3(got.max, want.max, 1e-12));
    }
}

/* ---- octahedral normals ---- */

static double angle_back(const float n[3]) {
    int16_t o[2];
    float d[3];
    pbs_oct_encode(o, n);
    pbs_oct_decode(d, o);
    double l = sqrt((double)n[0] * n[0] + (double)n[1] * n[1] + (double)n[2] * n[2]), c[3], s = 0;
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        c[k] = (n[a] / l) * d[b] - (n[b] / l) * d[a];
        s += c[k] * c[k];
    }
    double dot = (n[0] / l) * d[0] + (n[1] / l) * d[1] + (n[2] / l) * d[2];
    return atan2(sqrt(s), dot) * 180 / acos(-1.0);
}

TEST(octahedral_bound) {
    double worst = 0, sum = 0;
    int count = 0;
    for (int i = 0; i < 1000000; i++) {
        float n[3];
        for (int k = 0; k < 3; k++) n[k] = (float)uniform(-1, 1);
        if (i % 5 == 0) n[i % 3] = 0;                       /* edges of the octahedron */
        if (i % 7 == 0) n[2] = (float)uniform(-1e-4, 1e-4); /* the fold */
        if (i % 11 == 0) n[0] *= 1e-5f, n[1] *= 1e-5f;      /* the poles */
        if (n[0] == 0 && n[1] == 0 && n[2] == 0) continue;
        double angle = angle_back(n);
        worst = fmax(worst, angle);
        sum += angle, count++;
    }
    CHECK_NUM(worst <= 0.0038, worst);
    CHECK_NUM(worst > 0.0034, worst); /* the bound that vec.h states is not idle */
    CHECK_NUM(sum / count < 0.0015, sum / count);
}

TEST(octahedral_length_does_not_matter) {
    static const float lengths[] = {1e-30f, 1e-10f, 1e-3f, 1, 1e3f, 1e10f, 1e30f, 1e38f};
    for (size_t i = 0; i < sizeof lengths / sizeof lengths[0]; i++)
        for (int c = 1; c < 27; c++) {
            float n[3], s = lengths[i];
            n[0] = s * (float)(c % 3 - 1), n[1] = s * (float)(c / 3 % 3 - 1);
            n[2] = s * (float)(c / 9 - 1);
            if (c == 13) continue;
            CHECK_NUM(angle_back(n) < 0.0038, s);
        }
}

TEST(octahedral_axes_are_exact) {
    for (int k = 0; k < 6; k++) {
        float n[3] = {0, 0, 0}, d[3];
        int16_t o[2];
        n[k / 2] = k & 1 ? -1 : 1;
        pbs_oct_encode(o, n);
        pbs_oct_decode(d, o);
        CHECK(d[0] == n[0] && d[1] == n[1] && d[2] == n[2]);
    }
}

TEST(octahedral_hostile) {
    static const float bad[][3] = {{0, 0, 0},   {NAN, 0, 0},      {0, NAN, 1},
                                   {1, 1, NAN}, {INFINITY, 0, 0}, {-INFINITY, NAN, INFINITY}};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        int16_t o[2];
        float d[3];
        pbs_oct_encode(o, bad[i]);
        pbs_oct_decode(d, o);
        CHECK(d[0] == 0 && d[1] == 0 && d[2] == 1);
    }
    for (int x = -32768; x < 32768; x += 17) /* any bytes of a damaged file decode to length 1 */
        for (int y = -32768; y < 32768; y += 331) {
            float d[3];
            pbs_oct_decode(d, (const int16_t[2]){(int16_t)x, (int16_t)y});
            float l = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            if (!(fabsf(l - 1) < 1e-5f)) {
                CHECK_NUM(!"length 1", l);
                return;
            }
        }
}

/* ---- colours ---- */

TEST(srgb) {
    float last = -1;
    for (int i = 0; i < 256; i++) {
        float linear = pbs_srgb_to_linear((float)i / 255);
        double v = i / 255.0, want = v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4);
        CHECK_NUM(fabs(linear - want) < 1e-6, i);
        CHECK(linear > last);
        CHECK(pbs_unorm8(pbs_linear_to_srgb(linear)) == i);
        last = linear;
    }
    CHECK(pbs_srgb_to_linear(0) == 0 && pbs_srgb_to_linear(1) == 1);
    CHECK(pbs_unorm8(NAN) == 0 && pbs_unorm8(-1) == 0 && pbs_unorm8(INFINITY) == 255);
    CHECK(pbs_unorm8(-INFINITY) == 0 && pbs_unorm8(0.999f) == 255 && pbs_unorm8(0.5f) == 128);
    for (int i = 0; i < 256; i++) CHECK(pbs_unorm8((float)i / 255) == i);
}

/* ---- half floats ---- */

static double half_value(uint16_t h) { /* from the definition in IEEE 754 */
    double v =
        (h >> 10 & 31) ? ldexp(1024 + (h & 1023), (h >> 10 & 31) - 25) : ldexp(h & 1023, -24);
    return h >> 15 ? -v : v;
}

TEST(half_round_trip) {
    for (uint32_t h = 0; h < 65536; h++) {
        float v = pbs_half_get((uint16_t)h);
        CHECK(isfinite(v));
        if ((h >> 10 & 31) == 31) { /* no infinity, no NaN: these stand for nothing we write */
            CHECK((pbs_half_put(v) & 0x7fff) == 0x7bff);
            continue;
        }
        CHECK(v == half_value((uint16_t)h) && pbs_half_put(v) == h);
    }
}

/* The nearest of all values by binary search; of two equally near ones, the even. */
static uint16_t slow_half(float f) {
    uint16_t lo = 0, hi = 0x7bff, sign = signbit(f) ? 0x8000 : 0;
    double v = fabs((double)f);
    if (v >= half_value(hi)) return sign | hi;
    while (hi - lo > 1) {
        uint16_t mid = (uint16_t)((lo + hi) / 2);
        if (half_value(mid) <= v)
            lo = mid;
        else
            hi = mid;
    }
    double down = v - half_value(lo), up = half_value(hi) - v;
    return sign | (down < up || (down == up && !(lo & 1)) ? lo : hi);
}

TEST(half_rounds_to_nearest_even) {
    int wrong = 0;
    for (uint32_t h = 0; h < 0x7bff; h++) {
        float a = (float)half_value((uint16_t)h), b = (float)half_value((uint16_t)(h + 1));
        float mid = (a + b) / 2; /* exact: 12 bits */
        const float tries[] = {mid, nextafterf(mid, 0), nextafterf(mid, 1e9f), nextafterf(a, 1e9f),
                               nextafterf(b, 0)};
        for (int k = 0; k < 5; k++) {
            wrong += pbs_half_put(tries[k]) != slow_half(tries[k]);
            wrong += pbs_half_put(-tries[k]) != slow_half(-tries[k]);
        }
    }
    CHECK_NUM(wrong == 0, wrong);
    for (int i = 0; i < 1000000; i++) {
        uint32_t bits = random_bits();
        float f;
        memcpy(&f, &bits, 4);
        if (isfinite(f)) wrong += pbs_half_put(f) != slow_half(f);
    }
    CHECK_NUM(wrong == 0, wrong);
    CHECK(pbs_half_put(NAN) == 0 && pbs_half_put(-NAN) == 0);
    CHECK(pbs_half_put(INFINITY) == 0x7bff && pbs_half_put(-INFINITY) == 0xfbff);
    CHECK(pbs_half_put(65519) == 0x7bff && pbs_half_put(65520) == 0x7bff);
    CHECK(pbs_half_put(3e38f) == 0x7bff && pbs_half_put(1e-40f) == 0);
}

TEST(half_monotone) {
    uint16_t last = 0;
    for (uint32_t b = 0; b < 0x7f800000; b += 977) {
        float f;
        memcpy(&f, &b, 4);
        uint16_t h = pbs_half_put(f);
        if (h < last) CHECK_NUM(!"monotone", f);
        last = h;
    }
}

/* ---- the lattice ---- */

static void check_lattice(const float *p, size_t n) {
    pbs_lattice l = pbs_lattice_of(p, n);
    CHECK(l.step > 0 && isfinite(l.step));
    for (size_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) {
            float v = p[3 * i + k];
            uint16_t q = pbs_lattice_put(&l, k, v);
            float back = pbs_lattice_get(&l, k, q);
            double exact = l.min[k] + l.step * q; /* before it becomes a float */
            double bound = l.step / 2 * (1 + 1e-9);
            if (!(fabs(exact - v) <= bound) || !(fabs((double)back - v) <= 2 * bound))
                CHECK_NUM(!"within the bound", fabs(exact - v) / l.step);
            if (pbs_lattice_put(&l, k, back) != q && l.step > fabs(v) * 1e-6)
                CHECK_NUM(!"stable", v);
        }
}

TEST(lattice_bound) {
    static const double scale[] = {1e-30, 1e-9, 1, 1e9, 1e30};
    float p[300];
    for (size_t s = 0; s < 5; s++)
        for (int round = 0; round < 40; round++) {
            double off = round % 3 * scale[s], flat = round % 4 ? 1 : 0;
            for (int i = 0; i < 300; i++)
                p[i] = (float)(off + uniform(-scale[s], scale[s]) * (i % 3 == 2 ? flat : 1));
            check_lattice(p, 100);
        }
}

TEST(lattice_edges) {
    const float one[3] = {5, -7, 1e20f};
    check_lattice(one, 1);
    const float huge[6] = {-3.4e38f, 0, 1, 3.4e38f, 0, 1};
    check_lattice(huge, 2);
    const float tiny[6] = {0, 0, 0, 1e-45f, 0, 0};
    check_lattice(tiny, 2);
    pbs_lattice none = pbs_lattice_of(NULL, 0);
    CHECK(none.step > 0 && none.min[0] == 0);
    pbs_lattice l = {{0, 0, 0}, 1};
    CHECK(pbs_lattice_put(&l, 0, -5) == 0 && pbs_lattice_put(&l, 0, 1e30f) == 65535);
    CHECK(pbs_lattice_put(&l, 0, NAN) == 0 && pbs_lattice_put(&l, 0, INFINITY) == 65535);
    CHECK(pbs_lattice_put(&l, 0, -INFINITY) == 0 && pbs_lattice_put(&l, 0, 65534.6f) == 65535);
    /* the ends of the box are on it, and the step is the same along all axes */
    const float box[6] = {-1, 10, 3, 2, 11, 3};
    l = pbs_lattice_of(box, 2);
    CHECK(l.step == 3.0 / 65535 && l.min[0] == -1 && l.min[1] == 10 && l.min[2] == 3);
    CHECK(pbs_lattice_put(&l, 0, -1) == 0 && pbs_lattice_put(&l, 0, 2) == 65535);
    CHECK(pbs_lattice_put(&l, 1, 11) == 21845 && pbs_lattice_put(&l, 2, 3) == 0);
}

/* ---- spacing ---- */

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

TEST(spacing_against_brute_force) {
    static float p[3 * 1200];
    static const size_t counts[] = {2, 3, 10, 333, 1000, 1200};
    for (int c = 0; c < 6; c++) {
        size_t n = counts[c], used = n < PBS_SPACING_COUNT ? n : PBS_SPACING_COUNT;
        static double d[1200];
        for (size_t i = 0; i < 3 * n; i++) p[i] = (float)uniform(-1, 1);
        if (n > 5) memcpy(p + 12, p, 12); /* a coincident pair */
        for (size_t i = 0; i < used; i++) {
            d[i] = INFINITY;
            for (size_t k = 0; k < used; k++) {
                double x = (double)p[3 * i] - p[3 * k], y = (double)p[3 * i + 1] - p[3 * k + 1];
                double z = (double)p[3 * i + 2] - p[3 * k + 2];
                if (k != i) d[i] = fmin(d[i], sqrt(x * x + y * y + z * z));
            }
        }
        qsort(d, used, sizeof *d, by_value);
        pbs_points points = {.count = n, .position = p};
        pbs_spacing s;
        pbs_spacing_of_prefix(&points, &s);
        CHECK(s.count == used && s.min == d[0] && s.max == d[used - 1]);
        CHECK(s.median == d[used / 2] || s.median == d[(used - 1) / 2]);
    }
}

TEST(spacing_of_few) {
    float p[3] = {1, 2, 3};
    for (size_t n = 0; n < 2; n++) {
        pbs_points points = {.count = n, .position = p};
        pbs_spacing s = {9, 9, 9, 9};
        pbs_spacing_of_prefix(&points, &s);
        CHECK(s.count == n && s.min == 0 && s.median == 0 && s.max == 0);
    }
}

TEST_MAIN
