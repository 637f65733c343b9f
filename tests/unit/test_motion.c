/* Motions: poses against values by hand and exact curves, and their chunks, whole and damaged. */
#include "formats/scene/motions.h"
#include "tests/unit/support.h"
#include "tests/check.h"
#include <math.h>

static pbs_run run = {.threads = 1};
static pbs_err err;
static uint64_t state = 88172645463325252u;

static double uniform(double low, double high) {
    state ^= state << 13, state ^= state >> 7, state ^= state << 17;
    return low + (high - low) * (double)(state >> 11) / 9007199254740992.0;
}

static const double quarter = 0.70710678118654752440;

/* A quaternion of a turn around z. */
static void turn(double q[4], double angle) {
    q[0] = q[1] = 0, q[2] = sin(angle / 2), q[3] = cos(angle / 2);
}

static double angle_of(const double q[4]) {
    return 2 * atan2(q[2], q[3]);
}

static bool near(const double *a, const double *b, int n, double tolerance) {
    for (int k = 0; k < n; k++)
        if (!(fabs(a[k] - b[k]) <= tolerance)) return false;
    return true;
}

TEST(poses) {
    /* Scaled, then turned by 90 degrees around z, then moved; far from the origin exactly there. */
    pbs_trs p = {{1e7, 2, 3}, {0, 0, 5 * quarter, 5 * quarter}, {2, 3, 4}};
    double m[12], out[3];
    pbs_trs_matrix(&p, m);
    pbs_xform_point(out, m, (double[3]){1, 1, 1});
    CHECK(near(out, (double[3]){1e7 - 3, 4, 7}, 3, 1e-8) && m[3] == 1e7);
    pbs_trs rest = PBS_TRS_IDENTITY;
    pbs_trs_matrix(&rest, m);
    CHECK(!memcmp(m, PBS_IDENTITY, sizeof m));
    const double none[4][4] = {
        {0, 0, 0, 0}, {NAN, 0, 0, 1}, {INFINITY, 0, 0, 0}, {0, 0, 0, 1e-320}};
    for (int i = 0; i < 4; i++) {
        memcpy(rest.rotation, none[i], sizeof rest.rotation);
        pbs_trs_matrix(&rest, m);
        CHECK_NUM(near(m, PBS_IDENTITY, 12, 1e-3), i);
    }
}

TEST(rotations_take_the_shorter_arc) {
    for (int i = 0; i < 1000; i++) {
        double keys[2][4], out[4], a = uniform(-3, 3), b = a + uniform(-3.1, 3.1);
        double u = uniform(0, 1), longer = uniform(0.1, 9);
        turn(keys[0], a);
        turn(keys[1], b);
        if (i % 2) /* of the same turn by -q, of any length */
            for (int k = 0; k < 4; k++) keys[1][k] *= -longer;
        pbs_motion_channel c = {0, PBS_MOTION_ROTATION, PBS_MOTION_LINEAR,
                                2, (double[2]){0, 1},   keys[0]};
        pbs_motion_channel_at(&c, u, out);
        double off = remainder(angle_of(out) - (a + u * (b - a)), 2 * 3.14159265358979323846);
        CHECK_NUM(fabs(off) < 1e-12, off);
    }
    /* Turns so small that an arc cosine would not see them. */
    double keys[2][4], out[4];
    turn(keys[0], 0.5);
    turn(keys[1], 0.5 + 1e-10);
    pbs_motion_channel c = {0, PBS_MOTION_ROTATION, PBS_MOTION_LINEAR,
                            2, (double[2]){0, 1},   keys[0]};
    pbs_motion_channel_at(&c, 0.25, out);
    CHECK_NUM(fabs(angle_of(out) - 0.5 - 0.25e-10) < 1e-15, angle_of(out) - 0.5);
    memcpy(keys[1], keys[0], sizeof keys[1]);
    pbs_motion_channel_at(&c, 0.25, out);
    CHECK(near(out, keys[0], 4, 1e-15));
}

TEST(between_keys) {
    const double time[3] = {1, 2, 4};
    const double far = 1e7, value[9] = {far, 0, 1, far, 4, 3, far, 8, -1};
    const struct {
        unsigned way;
        double time, y, z;
    } cases[] = {
        {PBS_MOTION_LINEAR, 0, 0, 1},         {PBS_MOTION_LINEAR, 1, 0, 1},
        {PBS_MOTION_LINEAR, 1.25, 1, 1.5},    {PBS_MOTION_LINEAR, 2, 4, 3},
        {PBS_MOTION_LINEAR, 3, 6, 1},         {PBS_MOTION_LINEAR, 4, 8, -1},
        {PBS_MOTION_LINEAR, 9, 8, -1},        {PBS_MOTION_LINEAR, NAN, 0, 1},
        {PBS_MOTION_LINEAR, INFINITY, 8, -1}, {PBS_MOTION_STEP, 0, 0, 1},
        {PBS_MOTION_STEP, 1.999, 0, 1},       {PBS_MOTION_STEP, 2, 4, 3},
        {PBS_MOTION_STEP, 3.999, 4, 3},       {PBS_MOTION_STEP, 4, 8, -1},
        {PBS_MOTION_STEP, -INFINITY, 0, 1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        pbs_motion_channel c = {0, PBS_MOTION_TRANSLATION, (uint8_t)cases[i].way, 3, time, value};
        double out[4];
        pbs_motion_channel_at(&c, cases[i].time, out);
        CHECK_NUM(out[0] == far && out[1] == cases[i].y && out[2] == cases[i].z, i);
    }
    /* A jump: from the second key at 1 on the third one counts. */
    const double jump[4] = {0, 1, 1, 2}, x[12] = {0, 0, 0, 2, 0, 0, 7, 0, 0, 9, 0, 0};
    pbs_motion_channel c = {0, PBS_MOTION_SCALE, PBS_MOTION_LINEAR, 4, jump, x};
    double out[4];
    pbs_motion_channel_at(&c, 0.75, out);
    CHECK(out[0] == 1.5);
    pbs_motion_channel_at(&c, 1, out);
    CHECK(out[0] == 7);
    pbs_motion_channel_at(&c, 1.5, out);
    CHECK(out[0] == 8);
}

/* A spline goes through every cubic curve whose derivatives are its tangents. */
TEST(splines_are_cubic_curves) {
    const double f[3][4] = {{1e7, 2, -3, 0.5}, {-1, 0, 2, -0.25}, {0, 1, 0, 0}};
    const double time[3] = {-1, 0.5, 4};
    double value[27], out[4];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            double t = time[i], slope = f[k][1] + t * (2 * f[k][2] + t * 3 * f[k][3]);
            value[9 * i + k] = value[9 * i + 6 + k] = slope;
            value[9 * i + 3 + k] = f[k][0] + t * (f[k][1] + t * (f[k][2] + t * f[k][3]));
        }
    pbs_motion_channel c = {0, PBS_MOTION_TRANSLATION, PBS_MOTION_CUBIC, 3, time, value};
    for (double t = -1; t <= 4; t += 0.125) {
        pbs_motion_channel_at(&c, t, out);
        for (int k = 0; k < 3; k++) {
            double want = f[k][0] + t * (f[k][1] + t * (f[k][2] + t * f[k][3]));
            CHECK_NUM(fabs(out[k] - want) < (k ? 1e-12 : 1e-7), out[k] - want);
        }
    }
    pbs_motion_channel_at(&c, 99, out);
    CHECK(near(out, value + 21, 3, 0));
    /* By hand: from 0 to 1 in 2 s, leaving with 3 a second, arriving with -1: at the half 1/2 + 1.
     */
    const double hand[18] = {9, 9, 9, 0, 0, 0, 3, 3, 3, -1, -1, -1, 1, 1, 1, 9, 9, 9};
    c = (pbs_motion_channel){0, PBS_MOTION_SCALE, PBS_MOTION_CUBIC, 2, (double[2]){0, 2}, hand};
    pbs_motion_channel_at(&c, 1, out);
    CHECK_NUM(out[0] == 1.5 && out[2] == 1.5, out[0]);
}

/* Whatever finite numbers the keys are. */
TEST(hostile_keys_give_numbers) {
    const double huge[] = {1e308, -1e308, 5e-324, 0, 1, -1e-300};
    for (int i = 0; i < 20000; i++) {
        double time[2], value[24], out[4];
        for (int k = 0; k < 24; k++) value[k] = huge[(size_t)uniform(0, 6)];
        time[0] = huge[(size_t)uniform(0, 6)];
        time[1] = fmax(time[0], huge[(size_t)uniform(0, 6)]);
        pbs_motion_channel c = {0, (uint8_t)uniform(0, 3), (uint8_t)uniform(0, 3), 2, time, value};
        pbs_motion_channel_at(&c, i % 2 ? time[0] / 2 + time[1] / 2 : huge[(size_t)uniform(0, 6)],
                              out);
        bool finite = true;
        for (int k = 0; k < (c.path == PBS_MOTION_ROTATION ? 4 : 3); k++)
            finite = finite && isfinite(out[k]);
        CHECK_NUM(finite, i);
    }
}

TEST(what_plays) {
    const double t0[1] = {0}, a[3] = {1, 2, 3}, b[3] = {4, 5, 6}, s[3] = {7, 7, 7};
    const pbs_motion_channel channels[3] = {
        {1, PBS_MOTION_TRANSLATION, PBS_MOTION_LINEAR, 1, t0, a},
        {0, PBS_MOTION_TRANSLATION, PBS_MOTION_LINEAR, 1, t0, b},
        {2, PBS_MOTION_SCALE, PBS_MOTION_STEP, 1, t0, s}};
    const pbs_motion motion = {{{9, 9, 9}, {0, 0, 0, 1}, {2, 2, 2}}, 3, channels};
    const struct {
        double time[3], x, scale;
        bool moves;
    } cases[] = {{{0, 0, 0}, 1, 7, true},
                 {{0, NAN, NAN}, 4, 2, true},
                 {{NAN, 0, NAN}, 1, 2, true},
                 {{NAN, NAN, 5}, 9, 7, true},
                 {{NAN, NAN, NAN}, 9, 2, false}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        double m[12];
        CHECK_NUM(pbs_motion_at(&motion, cases[i].time, m) == cases[i].moves, i);
        CHECK_NUM(m[3] == cases[i].x && m[0] == cases[i].scale && m[10] == cases[i].scale, i);
    }
}

TEST(loops) {
    CHECK(pbs_motion_loop(0, 2) == 0 && pbs_motion_loop(2, 2) == 2 &&
          pbs_motion_loop(2.5, 2) == 0.5);
    CHECK(pbs_motion_loop(-0.5, 2) == 1.5 && pbs_motion_loop(5, 0) == 5 &&
          pbs_motion_loop(5, -1) == 5);
    CHECK(isnan(pbs_motion_loop(NAN, 2)) && pbs_motion_loop(INFINITY, 2) == 2);
    CHECK(pbs_motion_loop(-INFINITY, 2) == 0 && pbs_motion_loop(1e300, 3) < 3);
}

/* ---- chunks ---- */

static const double keys_time[3] = {0, 1, 1}, keys_value[9] = {1, 2, 3, 4, 5, 6, 7, 8, 9};
static const double spline_time[2] = {0, 2.5}, spline_value[24] = {0, 0, 0, 0, 0, 0, 0, 1};
static const pbs_motion_channel two[2] = {
    {1, PBS_MOTION_SCALE, PBS_MOTION_STEP, 3, keys_time, keys_value},
    {0, PBS_MOTION_ROTATION, PBS_MOTION_CUBIC, 2, spline_time, spline_value}};
static const pbs_motion sample = {{{1, 2, 3}, {0, 0, 0, 1}, {1, 1, 1}}, 2, two};

static void take_name(pbs_motions *m, const char *name) {
    uint8_t bytes[64] = {(uint8_t)strlen(name)};
    memcpy(bytes + 8, name, strlen(name));
    pbs_chunk c = {.tag = PBS_TAG_ANIMATION,
                   .node = (uint32_t)m->animation_count,
                   .payload = bytes,
                   .bytes = 8 + strlen(name)};
    must(pbs_motions_take(&run, "x", &c, m, &err), &err);
}

TEST(chunks) {
    pbs_motions m = {0};
    uint8_t *bytes;
    size_t size;
    take_name(&m, "walk");
    take_name(&m, "");
    must(pbs_motion_pack(&run, &sample, &bytes, &size, &err), &err);
    pbs_chunk c = {.tag = PBS_TAG_MOTION, .payload = bytes, .bytes = size};
    must(pbs_motions_take(&run, "x", &c, &m, &err), &err);
    CHECK(m.count == 1 && m.animations[0].end == 2.5 && m.animations[1].end == 1);
    CHECK(!strcmp(m.animations[0].name, "walk") && !*m.animations[1].name);
    const pbs_motion *got = m.motions;
    CHECK(got->count == 2 && !memcmp(&got->rest, &sample.rest, sizeof got->rest));
    for (int i = 0; i < 2; i++) {
        const pbs_motion_channel *a = &got->channels[i], *b = &two[i];
        CHECK(a->animation == b->animation && a->path == b->path && a->way == b->way);
        CHECK(a->keys == b->keys && !memcmp(a->time, b->time, 8 * a->keys));
        CHECK(!memcmp(a->value, b->value, 8 * a->keys * pbs_motion_numbers(a->path, a->way)));
    }
    /* Numbers go up one by one, and placings name what is there. */
    CHECK(pbs_motions_take(&run, "x", &c, &m, &err) == PBS_DATA);
    pbs_child child = {.motion = 1, .flags = PBS_CHILD_MOVES};
    pbs_node node = {.child_count = 1, .children = &child};
    CHECK(!pbs_motions_fit("x", &m, &node, 1, &err));
    child.motion = 2;
    CHECK(pbs_motions_fit("x", &m, &node, 1, &err) == PBS_DATA);
    CHECK(!strcmp(err.text, "x: node 0 names motion 1, which is not there"));
    pbs_motions_free(&run, &m);
    pbs_free(&run, bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

/* Every byte in turn, and every length: refused, or poses that are numbers. */
TEST(damaged_chunks) {
    uint8_t *bytes;
    size_t size;
    unsigned refused = 0, good = 0;
    must(pbs_motion_pack(&run, &sample, &bytes, &size, &err), &err);
    for (size_t i = 0; i < 2 * size; i++)
        for (int bit = 0; bit < (i < size ? 8 : 1); bit++) {
            pbs_motions m = {0};
            take_name(&m, "a");
            take_name(&m, "b");
            size_t n = i < size ? size : i - size;
            uint8_t *copy = aligned_alloc(64, (n + 63) / 64 * 64 + 64);
            if (!copy) abort();
            memcpy(copy, bytes, n);
            if (i < size) copy[i] ^= (uint8_t)(1 << bit);
            pbs_chunk c = {.tag = PBS_TAG_MOTION, .payload = copy, .bytes = n};
            pbs_code rc = pbs_motions_take(&run, "x", &c, &m, &err);
            CHECK(rc == PBS_OK || rc == PBS_DATA);
            if (rc) refused++;
            for (double t = -1; !rc && t < 4; t += 0.5) {
                double pose[12];
                pbs_motion_at(m.motions, (double[2]){t, t}, pose);
                for (int k = 0; k < 12; k++) CHECK(!isnan(pose[k]));
            }
            good += !rc;
            pbs_motions_free(&run, &m);
            free(copy);
        }
    CHECK(refused > size && good > size);
    pbs_free(&run, bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(damaged_names) {
    const uint8_t inner[] = {3, 0, 0, 0, 0, 0, 0, 0, 'a', 0, 'b'}, longer[9] = {9};
    pbs_motions m = {0};
    pbs_chunk c = {.tag = PBS_TAG_ANIMATION, .payload = inner, .bytes = sizeof inner};
    CHECK(pbs_motions_take(&run, "x", &c, &m, &err) == PBS_DATA);
    c.payload = longer, c.bytes = sizeof longer;
    CHECK(pbs_motions_take(&run, "x", &c, &m, &err) == PBS_DATA);
    c.bytes = 7;
    CHECK(pbs_motions_take(&run, "x", &c, &m, &err) == PBS_DATA);
    c.payload = NULL, c.bytes = 0;
    CHECK(pbs_motions_take(&run, "x", &c, &m, &err) == PBS_DATA);
    CHECK(!strcmp(err.text, "x: animation 0 is damaged"));
    pbs_motions_free(&run, &m);
}

TEST(too_many_keys) {
    pbs_motion_channel c = {0, PBS_MOTION_SCALE, PBS_MOTION_CUBIC, 1000000, NULL, NULL};
    const pbs_motion m = {PBS_TRS_IDENTITY, 1, &c};
    uint8_t *bytes;
    size_t size;
    CHECK(pbs_motion_pack(&run, &m, &bytes, &size, &err) == PBS_LIMIT && !bytes);
}
TEST_MAIN
