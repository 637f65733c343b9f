/* How a picture is taken: the controller of the frame-time, foveation zones, two eyes, flying,
 * picking, keys. Arithmetic only. */
#include "cmd/pbs-view/plan/control.h"
#include "cmd/pbs-view/plan/cut.h"
#include "cmd/pbs-view/plan/eyes.h"
#include "cmd/pbs-view/keys.h"
#include "cmd/pbs-view/overlay.h"
#include "cmd/pbs-view/plan/pick.h"
#include "tests/check.h"

static uint64_t state = 88172645463325252u;
static pbs_run run = {.threads = 1};
static pbs_err err;

static double uniform(double low, double high) {
    state ^= state << 13, state ^= state >> 7, state ^= state << 17;
    return low + (high - low) * (double)(state >> 11) / 9007199254740992.0;
}

/* ---- the controller ---- */

/* A device: so many surfels as the size asks for, so long for each, and something for the rest. */
static double device(double size, double each, double rest) {
    return rest + each / (size * size);
}

TEST(control_is_the_papers_formula) {
    pbs_control c = pbs_control_start(0.010, 2);
    CHECK(pbs_control_step(&c, 0.020));
    CHECK_NUM(fabs(c.size - (2 * 3 + 2 * 2.0) / 4) < 1e-12, c.size);
    c = pbs_control_start(0.010, 4);
    CHECK(pbs_control_step(&c, 0.004));
    CHECK_NUM(fabs(c.size - (4 * 3 + 4 * 0.4) / 4) < 1e-12, c.size);
    /* The mean is that of the last three frames. */
    double mean = (4 + 4 + c.size) / 3;
    CHECK(pbs_control_step(&c, 0.020));
    CHECK_NUM(fabs(c.size - (mean * 3 + mean * 2) / 4) < 1e-12, c.size);
}

TEST(control_has_a_dead_band) {
    for (double ratio = 0.9; ratio <= 1.1; ratio += 0.02) {
        pbs_control c = pbs_control_start(0.010, 3);
        CHECK(!pbs_control_step(&c, 0.010 * ratio) && c.size == 3);
    }
    pbs_control c = pbs_control_start(0.010, 3);
    CHECK(pbs_control_step(&c, 0.0089));
    CHECK(pbs_control_step(&c, 0.0111));
}

TEST(control_stays_in_its_range) {
    pbs_control c = pbs_control_start(0.010, 100), slow = pbs_control_start(0.010, 0.1);
    CHECK(c.size == 8 && slow.size == 1);
    for (int i = 0; i < 100; i++) {
        pbs_control_step(&slow, 10);
        pbs_control_step(&c, 1e-6);
        CHECK(c.size >= 1 && slow.size <= 8);
    }
    CHECK(c.size == 1 && slow.size == 8);
    CHECK(!pbs_control_step(&c, 1e-6) && !pbs_control_step(&slow, 10)); /* nothing more to do */
}

TEST(control_bears_bad_times) {
    const double bad[] = {NAN, -NAN, 0, -1, -INFINITY};
    pbs_control c = pbs_control_start(0.010, 3);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        CHECK_NUM(!pbs_control_step(&c, bad[i]) && c.size == 3, i);
    CHECK(pbs_control_step(&c, INFINITY) && isfinite(c.size));
    const double none[] = {0, -1, NAN, INFINITY};
    for (size_t i = 0; i < sizeof none / sizeof *none; i++) {
        c = pbs_control_start(none[i], 30);
        CHECK(c.size == 30 && !pbs_control_step(&c, 0.5) && c.size == 30);
    }
    c = pbs_control_start(0.010, NAN);
    CHECK(c.size == 1);
}

/* Whatever the device and wherever it begins, the time comes into the dead band and stays, if sizes
 * from 1 to 8 can bring it there; with times that come some frames late, too. */
TEST(control_converges) {
    for (int i = 0; i < 3000; i++) {
        double rest = uniform(0, 0.004), goal = uniform(1.2, 7), late[4];
        double each = (0.010 - rest) * goal * goal;
        int delay = i % 4;
        pbs_control c = pbs_control_start(0.010, uniform(1, 8));
        for (int k = 0; k < 4; k++) late[k] = NAN;
        double t = 0;
        for (int frame = 0; frame < 200; frame++) {
            t = device(c.size, each, rest);
            late[frame % 4] = t;
            pbs_control_step(&c, late[(frame + 4 - delay) % 4]);
        }
        CHECK_NUM(t >= 0.0089 && t <= 0.0111, t);
        for (int frame = 0; frame < 20; frame++)
            CHECK(!pbs_control_step(&c, device(c.size, each, rest)));
    }
}

/* One stall of any length enlarges by half, and is forgotten within a second. */
TEST(control_forgives_a_stall) {
    for (double stall = 0.1; stall < 1e6; stall *= 10) {
        pbs_control c = pbs_control_start(0.010, 2);
        double each = 0.010 * 4;
        pbs_control_step(&c, stall);
        CHECK_NUM(c.size <= 3.0 + 1e-12, c.size);
        int frames = 0;
        for (; frames < 100 && device(c.size, each, 0) < 0.0089; frames++)
            pbs_control_step(&c, device(c.size, each, 0));
        CHECK_NUM(frames < 30, frames);
    }
}

/* ---- zones ---- */

TEST(zones_are_read) {
    pbs_zones z;
    CHECK(pbs_zones_parse(&z, "5:1,15:2.5,30:4", &err) == PBS_OK && z.count == 3);
    CHECK(z.angle[1] == 15 && z.factor[1] == 2.5);
    CHECK(pbs_zones_parse(&z, "0:0.5", &err) == PBS_OK && z.count == 1);
    CHECK(pbs_zones_parse(&z, "1:1,2:1,3:1,4:1,5:1,6:1,7:1,8:1", &err) == PBS_OK && z.count == 8);
    const char *bad[] = {"",         "5",
                         "5:",       "5:1,",
                         "5:1 ",     ":1",
                         "5:1,5:2",  "15:1,5:2",
                         "-1:1",     "181:1",
                         "5:0",      "5:0.01",
                         "5:101",    "nan:1",
                         "5:nan",    "5:inf",
                         "5:1;6:2",  "5:1,6",
                         ",5:1",     "5:1,6:2,x",
                         "5:1,,6:2", "1:1,2:1,3:1,4:1,5:1,6:1,7:1,8:1,9:1"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        CHECK_NUM(pbs_zones_parse(&z, bad[i], &err) == PBS_USAGE, i);
}

TEST(factor_goes_from_zone_to_zone) {
    pbs_zones z, none = {0};
    CHECK(pbs_zones_parse(&z, "5:1,15:2,35:4", &err) == PBS_OK);
    const double angle[] = {0, 5, 10, 15, 25, 35, 90, NAN}, want[] = {1, 1, 1.5, 2, 3, 4, 4, 1};
    for (size_t i = 0; i < 8; i++) {
        double f = pbs_zones_factor(&z, angle[i]);
        CHECK_NUM(fabs(f - want[i]) < 1e-12, f);
        CHECK(pbs_zones_factor(&none, angle[i]) == 1);
    }
    for (double a = 0; a < 60; a += 0.01)
        CHECK(fabs(pbs_zones_factor(&z, a + 0.01) - pbs_zones_factor(&z, a)) < 0.0011);
}

static double angle_between(const double a[3], const double b[3]) {
    double ab = 0, aa = 0, bb = 0;
    for (int k = 0; k < 3; k++) ab += a[k] * b[k], aa += a[k] * a[k], bb += b[k] * b[k];
    double c = ab / sqrt(aa * bb);
    return acos(c > 1 ? 1 : c < -1 ? -1 : c) * 180 / 3.14159265358979323846;
}

/* Never more than the angle of any point of the box; and for a small box hardly less. */
TEST(angle_is_a_lower_bound) {
    int apart = 0;
    for (int i = 0; i < 2000; i++) {
        double m[12], gaze[3], middle[3];
        double size = pow(10, uniform(-3, 0.5));
        pbs_box b;
        for (int k = 0; k < 3; k++) {
            b.min[k] = uniform(-3, 3);
            b.max[k] = b.min[k] + size * uniform(0, 1);
            middle[k] = (b.min[k] + b.max[k]) / 2;
        }
        for (int k = 0; k < 12; k++) m[k] = uniform(-1, 1);
        pbs_zones_gaze(gaze, uniform(0.1, 2), uniform(0.1, 2), uniform(0, 1), uniform(0, 1));
        double bound = pbs_zones_angle(gaze, &b, m), least = 180;
        for (int n = 0; n < 100; n++) {
            double p[3];
            for (int k = 0; k < 3; k++) p[k] = uniform(b.min[k], b.max[k]);
            pbs_xform_point(p, m, p);
            least = fmin(least, angle_between(gaze, p));
        }
        CHECK_NUM(bound <= least + 1e-9, bound - least);
        pbs_xform_point(middle, m, middle);
        if (size < 0.01 && middle[0] * middle[0] + middle[1] * middle[1] > 1)
            CHECK_NUM(bound > least - 4, bound - least);
        apart += bound > 1;
    }
    CHECK_NUM(apart > 500, apart);
    const double gaze[3] = {0, 0, -1};
    pbs_box empty = PBS_BOX_EMPTY, around = {{-1, -1, -1}, {1, 1, 1}};
    CHECK(pbs_zones_angle(gaze, &empty, PBS_IDENTITY) == 0);
    CHECK(pbs_zones_angle(gaze, &around, PBS_IDENTITY) == 0);
}

/* ---- eyes ---- */

TEST(one_eye_is_the_camera) {
    pbs_camera c;
    pbs_eyes e;
    const double gaze[2] = {0.5, 0.5};
    CHECK(pbs_camera_parse(&c, "0,0,10,0,0,0", &err) == PBS_OK);
    const double none[] = {0, -1, NAN, INFINITY};
    for (int i = 0; i < 4; i++) {
        pbs_eyes_of(&e, &c, 641, 480, none[i], 0, NULL, gaze);
        CHECK(e.count == 1 && e.width == 641 && e.left[0] == 0 && e.aspect == 641.0 / 480);
        CHECK(memcmp(&e.camera[0], &c, sizeof c) == 0);
    }
    pbs_eyes_of(&e, &c, 1, 1, 1, 1, NULL, gaze); /* no room for two */
    CHECK(e.count == 1);
}

/* The eyes are so far apart, look the same way, and see what either of two cameras sees. */
TEST(two_eyes_share_a_cut) {
    const double gaze[2] = {0.5, 0.5};
    int either = 0, both = 0;
    pbs_camera c;
    CHECK(pbs_camera_parse(&c, "0,0,10,0,0,0,40", &err) == PBS_OK);
    pbs_eyes e;
    pbs_eyes_of(&e, &c, 801, 300, 2, 0, NULL, gaze);
    CHECK(e.count == 2 && e.width == 400 && e.left[0] == 0 && e.left[1] == 400);
    CHECK(e.camera[0].eye[0] == -1 && e.camera[1].eye[0] == 1);
    CHECK(e.camera[0].target[0] == -1 && e.camera[0].unit == c.unit);
    for (int i = 0; i < 5000; i++) {
        pbs_box b;
        for (int k = 0; k < 3; k++) b.min[k] = uniform(-9, 9), b.max[k] = b.min[k] + uniform(0, 1);
        bool left = pbs_cut_visible(&e.camera[0], e.aspect, &b, 0, PBS_IDENTITY);
        bool right = pbs_cut_visible(&e.camera[1], e.aspect, &b, 0, PBS_IDENTITY);
        CHECK(pbs_eyes_see(&e, &b, 0, PBS_IDENTITY) == (left || right));
        double depth = pbs_eyes_depth(&e, &b, PBS_IDENTITY);
        CHECK(depth <= pbs_cut_depth(&e.camera[0], e.aspect, &b, PBS_IDENTITY));
        CHECK(depth <= pbs_cut_depth(&e.camera[1], e.aspect, &b, PBS_IDENTITY));
        either += left != right, both += left && right;
    }
    CHECK(either > 20 && both > 20);
}

/* Columns of a point in an eye's part of the picture. */
static double column_of(const pbs_eyes *e, int i, const double p[3]) {
    double view[12], q[3];
    pbs_camera_place(view, &e->camera[i], PBS_IDENTITY);
    pbs_xform_point(q, view, p);
    double x = q[0] / -q[2] / (e->camera[i].tan_half * e->aspect);
    return e->from[i] + (0.5 + 0.5 * x) * e->wide - e->left[i];
}

/* What is as far away as the focus is at the same place for both eyes; what is nearer is farther to
 * the left for the right one, what is farther away to the right. Each sees all of its part. */
TEST(two_eyes_meet_at_the_focus) {
    const double gaze[2] = {0.5, 0.5};
    pbs_camera c;
    CHECK(pbs_camera_parse(&c, "0,0,10,0,0,0,40", &err) == PBS_OK);
    for (double focus = 4; focus < 100; focus *= 2.5) {
        pbs_eyes e;
        pbs_eyes_of(&e, &c, 2000, 500, 0.4, focus, NULL, gaze);
        for (int i = 0; i < 2; i++)
            CHECK(e.from[i] <= (int32_t)e.left[i] &&
                  e.from[i] + (int32_t)e.wide >= (int32_t)(e.left[i] + e.width));
        for (int i = 0; i < 100; i++) {
            double p[3] = {uniform(-1, 1), uniform(-1, 1), 10 - focus};
            double apart = column_of(&e, 1, p) - column_of(&e, 0, p);
            CHECK_NUM(fabs(apart) <= 1, apart);
            p[2] = 10 - focus / 2;
            CHECK(column_of(&e, 1, p) < column_of(&e, 0, p));
            p[2] = 10 - focus * 2;
            CHECK(column_of(&e, 1, p) > column_of(&e, 0, p));
        }
    }
    pbs_eyes e;
    pbs_eyes_of(&e, &c, 2000, 500, 0.4, 1e-30, NULL, gaze); /* within the nose */
    CHECK(e.wide == 2 * e.width);
}

/* What one looks at keeps its size; what lies aside grows, with two eyes as the nearer gaze has it.
 */
TEST(sizes_follow_the_gaze) {
    pbs_zones z;
    pbs_camera c;
    pbs_eyes e;
    CHECK(pbs_zones_parse(&z, "2:1,10:3", &err) == PBS_OK);
    CHECK(pbs_camera_parse(&c, "0,0,10,0,0,0,60", &err) == PBS_OK);
    pbs_box middle = {{-0.1, -0.1, -0.1}, {0.1, 0.1, 0.1}};
    pbs_box side = {{4.9, -0.1, -0.1}, {5.1, 0.1, 0.1}};
    pbs_eyes_of(&e, &c, 600, 600, 0, 0, &z, (double[2]){0.5, 0.5});
    CHECK(pbs_eyes_size(&e, 2, &middle, PBS_IDENTITY) == 2);
    CHECK(pbs_eyes_size(&e, 2, &side, PBS_IDENTITY) == 6);
    /* x = 5 at distance 10, half width 5.77: gaze at the right end, nearly. */
    pbs_eyes_of(&e, &c, 600, 600, 0, 0, &z, (double[2]){0.93, 0.5});
    CHECK(pbs_eyes_size(&e, 2, &side, PBS_IDENTITY) == 2);
    CHECK(pbs_eyes_size(&e, 2, &middle, PBS_IDENTITY) == 6);
    pbs_eyes_of(&e, &c, 600, 300, 10, 0, &z, (double[2]){0.5, 0.5});
    CHECK(pbs_eyes_size(&e, 2, &side, PBS_IDENTITY) == 2); /* the right eye is above it */
    pbs_eyes_of(&e, &c, 600, 600, 0, 0, NULL, (double[2]){0, 0});
    CHECK(pbs_eyes_size(&e, 2, &side, PBS_IDENTITY) == 2);
}

/* ---- flying ---- */

TEST(flying_moves_and_looks) {
    pbs_camera c, before;
    CHECK(pbs_camera_parse(&c, "0,0,10,0,0,0", &err) == PBS_OK);
    pbs_camera_move(&c, 0.1, 0.2, 0.5);
    CHECK(c.eye[0] == 1 && c.eye[1] == 2 && c.eye[2] == 5 && c.target[2] == -5 && c.unit == 10);
    before = c;
    pbs_camera_refocus(&c, 0.25);
    CHECK(memcmp(c.eye, before.eye, sizeof c.eye) == 0 && c.unit == 2.5 && c.target[2] == 2.5);
    const double bad[] = {NAN, INFINITY, 0, -1, 1e-300, 1e300};
    for (int i = 0; i < 6; i++) {
        before = c;
        pbs_camera_refocus(&c, bad[i]);
        CHECK_NUM(memcmp(&c, &before, sizeof c) == 0, i);
    }
    /* To the right and down, from where the eye is; never over the pole. */
    pbs_camera_turn(&c, 0.1, 0);
    CHECK(c.target[0] > c.eye[0] && c.eye[2] == 5);
    for (int i = 0; i < 100; i++) pbs_camera_turn(&c, 0.03, 0.1);
    CHECK(c.eye[0] == 1 && c.target[1] < c.eye[1] && c.up[1] > 0);
    double away = 0;
    for (int k = 0; k < 3; k++) away += (c.eye[k] - c.target[k]) * (c.eye[k] - c.target[k]);
    CHECK_NUM(fabs(sqrt(away) - c.unit) < 1e-12, away);
}

/* ---- picking ---- */

TEST(point_of_a_pixel) {
    for (int i = 0; i < 500; i++) {
        pbs_camera c;
        double eye[3], target[3], p[3], view[12], q[3];
        for (int k = 0; k < 3; k++) eye[k] = uniform(-9, 9), target[k] = uniform(-9, 9);
        CHECK(pbs_camera_look(&c, eye, target, (double[3]){0, 1, 0}, uniform(5, 120)));
        double x = uniform(0, 1), y = uniform(0, 1), depth = uniform(0.1, 9);
        pbs_pick_point(p, &c, 1.5, x, y, depth);
        pbs_camera_place(view, &c, PBS_IDENTITY);
        pbs_xform_point(q, view, p);
        CHECK_NUM(fabs(-q[2] - depth) < 1e-9, q[2]);
        CHECK(fabs(q[0] / depth / (c.tan_half * 1.5) - (2 * x - 1)) < 1e-9);
        CHECK(fabs(q[1] / depth / c.tan_half - (1 - 2 * y)) < 1e-9);
    }
}

/* Two cubes of one part and a long bolt through the first; an assembly of both, twice. */
static pbs_child assembly_of[3] = {{0, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, NULL, 0, 0},
                                   {0, {2, 0, 0, 5, 0, 2, 0, 0, 0, 0, 2, 0}, "large cube", 0, 0},
                                   {1, {0, 0, 9, 0, 0, 1, 0, 0, -1, 0, 0, 0}, NULL, 0, 0}};
static pbs_child root_of[2] = {{2, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, "left", 0, 0},
                               {2, {1, 0, 0, 1e7, 0, 1, 0, 0, 0, 0, 1, 0}, "", 0, 0}};
static const pbs_node nodes[4] = {
    {.id = 0, .name = "cube", .box = {{-1, -1, -1}, {1, 1, 1}}},
    {.id = 1, .name = "bolt", .box = {{-0.1, -0.1, -0.1}, {0.1, 0.1, 0.1}}},
    {.id = 2,
     .name = "pump",
     .box = {{-1, -2, -2}, {7, 2, 2}},
     .child_count = 3,
     .children = assembly_of},
    {.id = 3,
     .name = "plant",
     .box = {{-1, -2, -2}, {1e7 + 7, 2, 2}},
     .child_count = 2,
     .children = root_of}};

static bool last_is_part;
static const char *pick(double x, double y, double z, double tolerance) {
    static char out[128];
    bool part = false;
    if (pbs_pick(&run, &(pbs_pick_scene){nodes, 4, NULL, NULL}, (double[3]){x, y, z}, tolerance,
                 out, sizeof out, &part, &err))
        return "error";
    last_is_part = part;
    return out;
}

TEST(parts_are_named_by_their_path) {
    CHECK(!strcmp(pick(-0.95, 0.5, 0.5, 0), "plant / left / cube"));
    CHECK(!strcmp(pick(0.5, 0.05, 0.05, 0), "plant / left / bolt")); /* the smaller box */
    CHECK(!strcmp(pick(6, 1.5, -1.5, 0), "plant / left / large cube"));
    CHECK(!strcmp(pick(1e7 + 6, 1.5, -1.5, 0), "plant / large cube")); /* a name that is none */
    CHECK(last_is_part);
    CHECK(!strcmp(pick(2, 1, 1, 0), "plant / left") &&
          !last_is_part); /* between parts, in the assembly */
    CHECK(!strcmp(pick(-1.05, 0, 0, 0.2), "plant / left / bolt")); /* beside them all */
    CHECK(!strcmp(pick(-1.05, 0.9, 0, 0.1), "plant / left / cube"));
    CHECK(!strcmp(pick(0, 50, 0, 0), ""));
    CHECK(!strcmp(pick(NAN, 0, 0, 0), ""));
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(names_that_do_not_fit_and_none) {
    char out[16];
    bool found;
    CHECK(pbs_pick(&run, &(pbs_pick_scene){nodes, 4, NULL, NULL}, (double[3]){6, 1.5, -1.5}, 0, out,
                   sizeof out, &found, &err) == PBS_OK);
    CHECK(found && !strcmp(out, "plant / left")); /* whole names only */
    pbs_node nameless = {.id = 0, .name = "", .box = {{0, 0, 0}, {1, 1, 1}}};
    CHECK(pbs_pick(&run, &(pbs_pick_scene){&nameless, 1, NULL, NULL}, (double[3]){0.5, 0.5, 0.5}, 0,
                   out, sizeof out, &found, &err) == PBS_OK);
    CHECK(found && !strcmp(out, "node 0"));
    CHECK(pbs_pick(&run, &(pbs_pick_scene){nodes, 0, NULL, NULL}, (double[3]){0}, 0, out,
                   sizeof out, &found, &err) == PBS_OK);
    CHECK(!found && !out[0]);
}

/* What moves is named where it is, also out of the boxes of all that is above it. */
TEST(what_moved_is_picked) {
    const double pose[1][12] = {{1, 0, 0, 0, 0, 1, 0, 100, 0, 0, 1, 0}};
    const uint64_t moving[4] = {0, 0, 0, 1};
    const pbs_pick_scene scene = {nodes, 4, moving, pose};
    char out[128];
    bool part;
    root_of[0].flags = PBS_CHILD_MOVES, root_of[0].motion = 1;
    CHECK(!pbs_pick(&run, &scene, (double[3]){6, 101.5, -1.5}, 0, out, sizeof out, &part, &err));
    CHECK(part && !strcmp(out, "plant / left / large cube"));
    CHECK(!pbs_pick(&run, &scene, (double[3]){6, 1.5, -1.5}, 0, out, sizeof out, &part, &err));
    CHECK(!part && !strcmp(out, "plant"));
    CHECK(!strcmp(pick(6, 1.5, -1.5, 0), "plant / left / large cube"));
    root_of[0].flags = root_of[0].motion = 0;
}

/* A light goes on and off, a wheel turns, nothing else moves. */
TEST(chosen_animations_play) {
    static const double time[2] = {0, 2}, x[6] = {0, 0, 0, 4, 0, 0};
    static const pbs_motion_channel channels[2] = {
        {0, PBS_MOTION_TRANSLATION, PBS_MOTION_LINEAR, 2, time, x},
        {2, PBS_MOTION_TRANSLATION, PBS_MOTION_STEP, 2, time, x}};
    pbs_motion motions[2] = {{PBS_TRS_IDENTITY, 1, &channels[0]},
                             {PBS_TRS_IDENTITY, 1, &channels[1]}};
    pbs_animation animations[3] = {{(char *)"turn", 2}, {(char *)"", 0}, {(char *)"turn", 1}};
    const pbs_motions m = {animations, 3, 0, motions, 2, 0};
    const struct {
        const char *choice;
        double time, first, second;
    } cases[] = {{NULL, 0.5, 1, 0}, {"all", 1.5, 3, 0}, {"turn", 3.5, 3, 0}, {"0", 2, 4, 0},
                 {"2", 1, 0, 0},    {"none", 1, 0, 0},  {"1", 1, 0, 0},      {"2", -0.25, 0, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        pbs_poses p;
        CHECK(!pbs_poses_open(&run, &m, cases[i].choice, &p, &err));
        const double(*pose)[12] = pbs_poses_at(&p, cases[i].time);
        CHECK_NUM(pose && pose[0][3] == cases[i].first && pose[1][3] == cases[i].second, i);
        CHECK_NUM(pbs_poses_any(&p) == (i != 5), i);
        CHECK(!pbs_poses_at(&p, NAN));
        pbs_poses_close(&p);
    }
    static const pbs_motions none;
    pbs_poses p;
    CHECK(pbs_poses_open(&run, &m, "3", &p, &err) == PBS_USAGE);
    animations[1].name = (char *)"a\033[2J";
    CHECK(pbs_poses_open(&run, &m, "tur", &p, &err) == PBS_USAGE);
    CHECK(!strcmp(err.text, "--animation: tur: there is no such animation, only 0 turn, 1 a?[2J, "
                            "2 turn"));
    CHECK(pbs_poses_open(&run, &none, "x", &p, &err) == PBS_USAGE);
    CHECK(!pbs_poses_open(&run, &none, NULL, &p, &err) && !pbs_poses_any(&p));
    CHECK(!pbs_poses_at(&p, 1));
    pbs_poses_close(&p);
    CHECK(pbs_mem_used(&run) == 0);
}

/* 64 levels of two equal children place the part 2^64 times around one point. */
TEST(picking_ends) {
    enum { LEVELS = 64 };
    static pbs_child twice[LEVELS + 1][2];
    static pbs_node tower[LEVELS + 1];
    for (uint32_t i = 0; i <= LEVELS; i++) {
        tower[i] = (pbs_node){.id = i, .name = "n", .box = {{0, 0, 0}, {1, 1, 1}}};
        for (int k = 0; k < 2 && i; k++) {
            twice[i][k] = (pbs_child){.node = i - 1};
            memcpy(twice[i][k].m, PBS_IDENTITY, sizeof twice[i][k].m);
        }
        if (i) tower[i].child_count = 2, tower[i].children = twice[i];
    }
    char out[512];
    bool found;
    CHECK(pbs_pick(&run, &(pbs_pick_scene){tower, LEVELS + 1, NULL, NULL},
                   (double[3]){0.5, 0.5, 0.5}, 0, out, sizeof out, &found, &err) == PBS_OK);
    CHECK(found && strlen(out) == 1 + 4 * LEVELS);
}

/* A placing that is flat has no inverse. */
TEST(flat_placings_are_picked) {
    pbs_child flat = {0, {1, 0, 0, 0, 0, 0, 0, 5, 0, 0, 1, 0}, "plate", 0, 0};
    pbs_node two[2] = {nodes[0],
                       {.id = 1,
                        .name = "",
                        .box = {{-1, 5, -1}, {1, 5, 1}},
                        .child_count = 1,
                        .children = &flat}};
    char out[64];
    bool found;
    CHECK(pbs_pick(&run, &(pbs_pick_scene){two, 2, NULL, NULL}, (double[3]){0.5, 5.01, 0.5}, 0.1,
                   out, sizeof out, &found, &err) == PBS_OK);
    CHECK(found && !strcmp(out, "plate"));
}

/* ---- keys ---- */

TEST(keys_are_all_different) {
    for (size_t i = 0; i < pbs_key_count; i++) {
        CHECK(pbs_keys[i].name[0] && pbs_keys[i].what[0]);
        for (int k = 0; k < 6 && pbs_keys[i].codes[k]; k++) {
            int which;
            CHECK_NUM(pbs_key_find(pbs_keys[i].codes[k], &which) == pbs_keys[i].action, i);
            CHECK_NUM(which == k, i); /* a code that two rows have would be found in the first */
        }
        for (size_t j = 0; j < i; j++) CHECK(strcmp(pbs_keys[i].name, pbs_keys[j].name) != 0);
    }
    int which;
    CHECK(pbs_key_find(0, &which) == PBS_KEY_NONE && pbs_key_find(-1, &which) == PBS_KEY_NONE);
    CHECK(pbs_key_find('H', &which) == PBS_KEY_HELP);
    char text[PBS_OVERLAY_TEXT];
    pbs_overlay_keys(text);
    for (size_t i = 0; i < pbs_key_count; i++) CHECK(strstr(text, pbs_keys[i].what));
}

TEST_MAIN
