/* Boxes and balls of what is below nodes. */
#include "libcore/gbuffer/extent.h"
#include "libcore/data/rng.h"
#include "tests/check.h"

static double any(uint32_t i) {
    return (double)pbs_random(7, 0, i) / 0x1p63 - 1;
}

static void turn(double m[12], double angle, double scale) {
    double c = scale * cos(angle), s = scale * sin(angle);
    const double to[12] = {c, 0, s, any(1), 0, scale, 0, any(2), -s, 0, c, any(3)};
    memcpy(m, to, sizeof to);
}

static bool is_in(const pbs_extent *e, const double p[3]) {
    double d[3];
    for (int k = 0; k < 3; k++) {
        double slack = 1e-9 * (1 + fabs(p[k]));
        if (!(p[k] >= e->box.min[k] - slack && p[k] <= e->box.max[k] + slack)) return false;
        d[k] = p[k] - e->centre[k];
    }
    return sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) <= e->radius * (1 + 1e-9) + 1e-9;
}

static double side(const pbs_box *b) {
    return fmax(fmax(b->max[0] - b->min[0], b->max[1] - b->min[1]), b->max[2] - b->min[2]);
}

TEST(a_thousand_turns_do_not_blow_it_up) {
    const pbs_box unit = {{0, 0, 0}, {1, 1, 1}};
    pbs_extent e = pbs_extent_of(&unit);
    double m[12], p[3] = {1, 0, 1};
    for (int i = 0; i < 1000; i++) {
        turn(m, 0.0174, 1);
        e = pbs_extent_place(m, &e);
        pbs_xform_point(p, m, p);
        CHECK(is_in(&e, p));
    }
    CHECK_NUM(side(&e.box) <= sqrt(3) * 1.001, side(&e.box));
}

/* Whatever is placed and joined is inside, and no box is larger than the box of boxes. */
TEST(everything_is_in_it) {
    enum { POINTS = 40 };
    static double point[4096][3];
    pbs_extent e = PBS_EXTENT_EMPTY;
    size_t n = 0;
    for (uint32_t round = 0; round < 60; round++) {
        double m[12];
        pbs_extent part, placed;
        pbs_box box = PBS_BOX_EMPTY;
        for (size_t i = 0; i < POINTS; i++) {
            for (int k = 0; k < 3; k++)
                point[n + i][k] = any(round * 1000 + (uint32_t)i * 3 + (uint32_t)k);
            pbs_box_add(&box, point[n + i]);
        }
        part = pbs_extent_of(&box);
        for (int i = 0; i < 12; i++) m[i] = 2 * any(round * 77 + (uint32_t)i);
        placed = pbs_extent_place(m, &part);
        pbs_box loose = pbs_xform_box(m, &box);
        CHECK_NUM(side(&placed.box) <= side(&loose) * (1 + 1e-12), side(&placed.box));
        for (size_t i = 0; i < POINTS; i++) {
            pbs_xform_point(point[n + i], m, point[n + i]);
            CHECK(is_in(&placed, point[n + i]));
        }
        pbs_extent_join(&e, &placed);
        n += POINTS;
        if (round % 3) { /* a node more above it all */
            turn(m, any(round), 1);
            e = pbs_extent_place(m, &e);
            for (size_t i = 0; i < n; i++) pbs_xform_point(point[i], m, point[i]);
        }
        for (size_t i = 0; i < n; i++) CHECK(is_in(&e, point[i]));
    }
}

TEST(what_is_no_number_cuts_nothing) {
    const pbs_box wide = {{-1e308, -1, -1}, {1e308, 1, 1}}, none = PBS_BOX_EMPTY;
    pbs_extent e = pbs_extent_of(&wide), empty = pbs_extent_of(&none);
    double m[12];
    turn(m, 0.5, 1e10);
    pbs_extent huge = pbs_extent_place(m, &e);
    pbs_box plain = pbs_xform_box(m, &wide);
    CHECK(!memcmp(&huge.box, &plain, sizeof plain));
    CHECK(pbs_box_is_empty(&empty.box));
    pbs_extent_join(&e, &empty);
    CHECK(!memcmp(&e.box, &wide, sizeof wide));
    pbs_extent_join(&empty, &e);
    CHECK(!memcmp(&empty.box, &wide, sizeof wide));
    memset(m, 0, sizeof m); /* a point */
    e = pbs_extent_place(m, &e);
    CHECK(side(&e.box) == 0);
}

TEST_MAIN
