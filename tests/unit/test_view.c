/* The player's arithmetic: cameras, and what they see of a node. */
#include "cmd/pbs-view/plan/cut.h"
#include "libcore/gbuffer/lod.h"
#include "tests/check.h"

static uint64_t state = 88172645463325252u;

static double uniform(double low, double high) {
    state ^= state << 13, state ^= state >> 7, state ^= state << 17;
    return low + (high - low) * (double)(state >> 11) / 9007199254740992.0;
}

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static pbs_box random_box(double size, double away) {
    pbs_box b;
    for (int k = 0; k < 3; k++) {
        b.min[k] = away * uniform(-1, 1);
        b.max[k] = b.min[k] + size * uniform(0.01, 1);
    }
    return b;
}

static void random_matrix(double m[12], double size) {
    for (int i = 0; i < 12; i++) m[i] = uniform(-size, size);
}

static pbs_camera random_camera(const pbs_box *box, double aspect) {
    pbs_camera c;
    pbs_camera_desc d = {.aspect = aspect, .fov = uniform(5, 120)};
    for (int k = 0; k < 3; k++) d.toward_eye[k] = uniform(-1, 1), d.up[k] = uniform(-1, 1);
    pbs_camera_frame(&c, box, &d);
    return c;
}

static void check_axes(const pbs_camera *c) {
    CHECK(fabs(dot(c->right, c->right) - 1) < 1e-12 && fabs(dot(c->up, c->up) - 1) < 1e-12);
    CHECK(fabs(dot(c->back, c->back) - 1) < 1e-12 && fabs(dot(c->right, c->up)) < 1e-12);
    CHECK(fabs(dot(c->right, c->back)) < 1e-12 && fabs(dot(c->up, c->back)) < 1e-12);
    double view[12], eye[3], target[3];
    pbs_camera_place(view, c, PBS_IDENTITY);
    double cross[3] = {c->right[1] * c->up[2] - c->right[2] * c->up[1],
                       c->right[2] * c->up[0] - c->right[0] * c->up[2],
                       c->right[0] * c->up[1] - c->right[1] * c->up[0]};
    CHECK(dot(cross, c->back) > 0.999); /* right-handed */
    pbs_xform_point(eye, view, c->eye);
    pbs_xform_point(target, view, c->target);
    double far = fmax(fabs(c->eye[0]), fmax(fabs(c->eye[1]), fabs(c->eye[2])));
    double tolerance = 1e-12 + 1e-14 * far / c->unit;
    CHECK_NUM(sqrt(dot(eye, eye)) < tolerance, sqrt(dot(eye, eye)));
    CHECK(fabs(target[0]) < tolerance && fabs(target[1]) < tolerance);
    CHECK_NUM(fabs(target[2] + 1) < tolerance, target[2] + 1);
}

/* Every corner is in the picture, and the box could hardly be larger. */
static void check_framed(const pbs_camera *c, const pbs_box *b, double aspect, double tolerance) {
    double view[12], largest = 0;
    pbs_camera_place(view, c, PBS_IDENTITY);
    for (int i = 0; i < 8; i++) {
        double p[3];
        for (int k = 0; k < 3; k++) p[k] = i >> k & 1 ? b->max[k] : b->min[k];
        pbs_xform_point(p, view, p);
        CHECK_NUM(-p[2] > PBS_CAMERA_NEAR, p[2]);
        double x = fabs(p[0] / p[2]) / (c->tan_half * aspect), y = fabs(p[1] / p[2]) / c->tan_half;
        largest = fmax(largest, fmax(x, y));
    }
    CHECK_NUM(largest < 0.94 + tolerance && largest > 0.9 - tolerance, largest);
}

TEST(frame_holds_the_box) {
    for (int i = 0; i < 300; i++) {
        double size = pow(10, uniform(-9, 9)), aspect = uniform(0.3, 3);
        pbs_box b = random_box(size, i % 2 ? 0 : size * 1e6);
        pbs_camera c = random_camera(&b, aspect);
        check_axes(&c);
        check_framed(&c, &b, aspect, 1e-6);
    }
}

TEST(frame_defaults) {
    pbs_box b = {{-1, -2, -3}, {4, 5, 6}};
    pbs_camera c, z;
    pbs_camera_frame(&c, &b, &(pbs_camera_desc){0});
    CHECK(c.world_up[1] == 1 && c.up[1] > 0.5 && c.back[0] > 0 && c.back[1] > 0 && c.back[2] > 0);
    CHECK_NUM(fabs(c.tan_half - tan(15 * 3.14159265358979 / 180)) < 1e-12, c.tan_half);
    check_framed(&c, &b, 1, 1e-9);
    /* z up: the same picture of the same thing turned. */
    pbs_box turned = {{-1, -6, -2}, {4, 3, 5}};
    pbs_camera_frame(&z, &turned, &(pbs_camera_desc){.up = {0, 0, 1}});
    CHECK(fabs(z.eye[0] - c.eye[0]) < 1e-9 && fabs(z.eye[1] + c.eye[2]) < 1e-9);
    CHECK(fabs(z.eye[2] - c.eye[1]) < 1e-9 && fabs(z.unit - c.unit) < 1e-9);
}

TEST(frame_of_strange_boxes) {
    pbs_box odd[] = {PBS_BOX_EMPTY,
                     {{0, 0, 0}, {0, 0, 0}},
                     {{1e7, 1e7, 1e7}, {1e7, 1e7, 1e7}},
                     {{0, 0, 0}, {INFINITY, 1, 1}},
                     {{NAN, 0, 0}, {1, 1, 1}},
                     {{0, 0, 0}, {1, 0, 0}},
                     {{-1e300, -1e300, -1e300}, {1e300, 1e300, 1e300}},
                     {{0, 0, 0}, {1e-300, 1e-300, 1e-300}}};
    pbs_camera_desc down = {.toward_eye = {0, 3, 0}};
    for (size_t i = 0; i < sizeof odd / sizeof *odd; i++)
        for (int k = 0; k < 2; k++) {
            pbs_camera c;
            pbs_camera_frame(&c, &odd[i], k ? &down : &(pbs_camera_desc){0});
            CHECK_NUM(isfinite(c.unit) && c.unit > 0, i);
            check_axes(&c);
        }
}

TEST(parse_forms) {
    pbs_camera c;
    pbs_err err;
    CHECK(pbs_camera_parse(&c, "1,2,3,1,2,-7", &err) == PBS_OK);
    check_axes(&c);
    CHECK(c.eye[2] == 3 && c.target[2] == -7 && c.unit == 10 && c.back[2] == 1 && c.up[1] == 1);
    CHECK(pbs_camera_parse(&c, "1,2,3,1,2,-7,90", &err) == PBS_OK && fabs(c.tan_half - 1) < 1e-12);
    CHECK(pbs_camera_parse(&c, "1,2,3,1,2,-7,2,0,0", &err) == PBS_OK && c.up[0] == 1);
    CHECK(pbs_camera_parse(&c, "1e7,0,0,0,0,0,0,0,1,60", &err) == PBS_OK && c.up[2] == 1);
    CHECK(pbs_camera_parse(&c, "0,5,0,0,0,0", &err) == PBS_OK); /* up is the line of sight */
    check_axes(&c);
    const char *bad[] = {"",
                         "1,2,3",
                         "1,2,3,4,5,x",
                         "1,2,3,4,5,6,",
                         "1,2,3,4,5,6,7,8",
                         "1,2,3,1,2,3",
                         "1,2,3,4,5,nan",
                         "1,2,3,4,5,inf",
                         "1,2,3,4,5,6,180",
                         "1,2,3,4,5,6,0",
                         "1,2,3,4,5,6,7,8,9,10,11",
                         "1;2;3;4;5;6"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        CHECK_NUM(pbs_camera_parse(&c, bad[i], &err) == PBS_USAGE, i);
}

/* Points of a placed box: those in the picture are at least that deep, and the box is visible. */
TEST(depth_and_visibility_are_safe) {
    int hidden = 0, seen = 0;
    for (int i = 0; i < 2000; i++) {
        double aspect = uniform(0.5, 2), m[12], view[12];
        pbs_box b = random_box(1, 1), framed = random_box(2, 2);
        pbs_camera c = random_camera(&framed, aspect);
        random_matrix(m, 1.5);
        pbs_camera_place(view, &c, m);
        double depth = pbs_cut_depth(&c, aspect, &b, m), nearest = INFINITY;
        bool visible = pbs_cut_visible(&c, aspect, &b, 0, m), inside = false;
        for (int k = 0; k < 200; k++) {
            double p[3];
            for (int j = 0; j < 3; j++) p[j] = uniform(b.min[j], b.max[j]);
            pbs_xform_point(p, view, p);
            if (-p[2] < PBS_CAMERA_NEAR || fabs(p[0]) > -p[2] * c.tan_half * aspect ||
                fabs(p[1]) > -p[2] * c.tan_half)
                continue;
            inside = true;
            nearest = fmin(nearest, -p[2]);
        }
        CHECK(visible || !inside);
        CHECK_NUM(nearest >= depth, nearest - depth);
        hidden += !visible, seen += inside;
    }
    CHECK_NUM(hidden > 300, hidden);
    CHECK_NUM(seen > 300, seen);
}

TEST(padding_makes_visible) {
    pbs_camera c;
    CHECK(pbs_camera_parse(&c, "0,0,10,0,0,0,90", NULL) == PBS_OK);
    pbs_box b = {{10.5, -1, 0}, {12, 1, 0}}, empty = PBS_BOX_EMPTY;
    CHECK(!pbs_cut_visible(&c, 1, &b, 0, PBS_IDENTITY));
    CHECK(!pbs_cut_visible(&c, 1, &b, 0.2, PBS_IDENTITY));
    CHECK(pbs_cut_visible(&c, 1, &b, 0.6, PBS_IDENTITY));
    CHECK(!pbs_cut_visible(&c, 1, &empty, 1, PBS_IDENTITY));
    pbs_box deep = {{-1, -1, -3}, {1, 1, 2}};
    double d = pbs_cut_depth(&c, 1, &deep, PBS_IDENTITY);
    CHECK_NUM(fabs(d - 0.8) < 1e-12, d);
}

TEST(stretch_is_the_largest) {
    for (int i = 0; i < 200; i++) {
        double m[12], largest = 0;
        random_matrix(m, pow(10, uniform(-9, 9)));
        double stretch = pbs_lod_stretch(m);
        for (int k = 0; k < 2000; k++) {
            double v[3] = {uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)}, w[3];
            double length = sqrt(dot(v, v));
            for (int r = 0; r < 3; r++) w[r] = dot(m + 4 * r, v);
            largest = fmax(largest, sqrt(dot(w, w)) / length);
        }
        CHECK_NUM(largest <= stretch * (1 + 1e-3), largest / stretch);
        CHECK_NUM(largest >= stretch * 0.99, largest / stretch);
    }
    double mirrored[12] = {0, 3, 0, 9, -3, 0, 0, 9, 0, 0, -3, 9}, zero[12] = {0};
    CHECK_NUM(fabs(pbs_lod_stretch(mirrored) - 3) < 1e-12, pbs_lod_stretch(mirrored));
    CHECK(pbs_lod_stretch(zero) == 0);
}

/* A disc of the wanted radius that faces the eye is `pixels` across in the picture. */
TEST(wanted_radius_projects_to_pixels) {
    for (int i = 0; i < 50; i++) {
        pbs_box b = random_box(10, 10);
        pbs_camera c = random_camera(&b, 1);
        double scale = pow(10, uniform(-3, 3)),
               m[12] = {scale, 0, 0, 1, 0, scale, 0, 2, 0, 0, scale, 3};
        double depth = uniform(0.1, 5), pixels = uniform(0.5, 20);
        double radius = pbs_cut_wanted(&c, 700, depth, pixels, m);
        double in_view = radius * scale / c.unit;
        double across = 2 * in_view / depth / c.tan_half * 350;
        CHECK_NUM(fabs(across - pixels) < 1e-9 * pixels, across / pixels);
    }
}

/* A cell that counts as fine is at most so many pixels large wherever it is in the box, and one
 * that is much smaller counts. */
TEST(fine_cells_are_small_in_the_picture) {
    const unsigned height = 768;
    int fine = 0;
    for (int i = 0; i < 20000; i++) {
        pbs_box box = random_box(1, 2);
        pbs_camera c = random_camera(&box, 1.5);
        double scale = exp(uniform(-8, 8)), m[12] = {scale, 0, 0, 0, 0, scale, 0, 0, 0, 0, scale};
        pbs_box world = pbs_xform_box(m, &box);
        pbs_camera_frame(&c, &world, &(pbs_camera_desc){.aspect = 1.5});
        double side = exp(uniform(-9, -2)), pixels = uniform(0.5, 8), view[12], p[3], far;
        double depth = pbs_cut_depth(&c, 1.5, &box, m);
        bool is = pbs_cut_fine(&c, height, depth, pixels, side, m);
        fine += is;
        pbs_camera_place(view, &c, m);
        for (int k = 0; k < 3; k++) p[k] = uniform(box.min[k], box.max[k]);
        pbs_xform_point(p, view, p);
        /* A pixel at distance 1 is so large; the scale takes cells to view coordinates. */
        far = scale / c.unit * side / (-p[2] * pbs_camera_pixel(&c, height));
        if (is) CHECK_NUM(far <= pixels * (1 + 1e-9), far / pixels);
        CHECK(!is || pbs_cut_fine(&c, height, depth, pixels, side / 2, m));
        CHECK(!is || pbs_cut_fine(&c, height, depth, pixels * 2, side * 2, m));
        if (scale / c.unit * side <= 0.99 * pixels * depth * pbs_camera_pixel(&c, height))
            CHECK(is);
    }
    CHECK(fine > 2000 && fine < 18000);
}

TEST_MAIN
