/* Camera paths: what they pass through, how smoothly, and what is said of bad files. */
#include "cmd/pbs-view/plan/path.h"
#include "tests/check.h"

static pbs_run run = {.threads = 1};
static pbs_err err;
static const double Y[3] = {0, 1, 0};

static pbs_code parse(const char *text, pbs_path *out) {
    return pbs_path_parse(&run, "p.txt", text, strlen(text), Y, out, &err);
}

static double apart(const double a[3], const double b[3]) {
    double s = 0;
    for (int k = 0; k < 3; k++) s += (a[k] - b[k]) * (a[k] - b[k]);
    return sqrt(s);
}

static const char *const tour = "\xef\xbb\xbf# time eye target up fov\r\n"
                                "\r\n"
                                "0    0 0 10   0 0 0\r\n"
                                "1.5, 10,0,0,  0,0,0, 40 # closer\n"
                                "\t2.5 0 5 -10  1 0 0  0 0 2\n"
                                "4 0 5 -10  1 0 0  0 0 1 90\n"
                                "5 -3 0 0  1 1 1";

TEST(keyframes_are_passed) {
    const double time[5] = {0, 1.5, 2.5, 4, 5},
                 eye[5][3] = {{0, 0, 10}, {10, 0, 0}, {0, 5, -10}, {0, 5, -10}, {-3, 0, 0}};
    const double fov[5] = {30, 40, 30, 90, 30};
    pbs_path p;
    CHECK(parse(tour, &p) == PBS_OK && p.count == 5);
    CHECK(pbs_path_start(&p) == 0 && pbs_path_end(&p) == 5);
    for (int i = 0; i < 5; i++) {
        pbs_camera c;
        pbs_path_at(&p, time[i], &c);
        CHECK_NUM(apart(c.eye, eye[i]) < 1e-12, i);
        double f = 2 * atan(c.tan_half) * 180 / 3.14159265358979323846;
        CHECK_NUM(fabs(f - fov[i]) < 1e-9, f);
    }
    pbs_camera c;
    pbs_path_at(&p, 2.5, &c);
    CHECK(c.world_up[2] == 1 && c.target[0] == 1);
    pbs_path_free(&run, &p);
    CHECK(pbs_mem_used(&run) == 0);
}

/* Before and behind it the camera stands; NaN and infinities are times, too. */
TEST(ends_hold) {
    const double early[] = {-1e300, -1, -INFINITY, NAN}, late[] = {5, 6, 1e300, INFINITY};
    pbs_path p;
    pbs_camera first, last, c;
    CHECK(parse(tour, &p) == PBS_OK);
    pbs_path_at(&p, 0, &first);
    pbs_path_at(&p, 5, &last);
    for (int i = 0; i < 4; i++) {
        pbs_path_at(&p, early[i], &c);
        CHECK(memcmp(&c, &first, sizeof c) == 0);
        pbs_path_at(&p, late[i], &c);
        CHECK(memcmp(&c, &last, sizeof c) == 0);
    }
    pbs_path_free(&run, &p);
}

/* No jump, and no jump of the speed: over steps of h, the eye moves by v h and v changes by a h. */
TEST(movement_is_smooth) {
    const double h = 1e-4;
    pbs_path p;
    CHECK(parse(tour, &p) == PBS_OK);
    pbs_camera a, b, c;
    double largest = 0, jolt = 0;
    for (double t = 0; t < 5 - 2 * h; t += h) {
        double in[3], out[3];
        pbs_path_at(&p, t, &a);
        pbs_path_at(&p, t + h, &b);
        pbs_path_at(&p, t + 2 * h, &c);
        for (int k = 0; k < 3; k++) in[k] = b.eye[k] - a.eye[k], out[k] = c.eye[k] - b.eye[k];
        largest = fmax(largest, apart(a.eye, b.eye) / h);
        jolt = fmax(jolt, apart(in, out) / h);
    }
    CHECK_NUM(largest < 40, largest); /* the fastest straight piece needs 18 a second */
    CHECK_NUM(jolt < 0.02, jolt);     /* a corner would be of the order of 10 */
    pbs_path_free(&run, &p);
}

/* Between two equal keyframes nothing moves, and nothing swings past them. */
TEST(a_stop_is_a_stop) {
    pbs_path p;
    pbs_camera c, rest;
    CHECK(parse(tour, &p) == PBS_OK);
    pbs_path_at(&p, 2.5, &rest);
    for (double t = 2.5; t <= 4; t += 0.01) {
        pbs_path_at(&p, t, &c);
        CHECK(apart(c.eye, rest.eye) == 0 && apart(c.target, rest.target) == 0);
    }
    pbs_path_free(&run, &p);
}

/* Far from the origin and in any unit the movement is the same. */
TEST(scale_and_place_do_not_matter) {
    const char *far = "0 1e7 0 10e3 1e7 0 0\n1 10010000 0 0 1e7 0 0\n3 1e7 5e3 -10e3 1e7 0 0";
    const char *near = "0 0 0 10 0 0 0\n1 10 0 0 0 0 0\n3 0 5 -10 0 0 0";
    pbs_path p, q;
    CHECK(parse(far, &p) == PBS_OK && parse(near, &q) == PBS_OK);
    for (double t = 0; t <= 3; t += 0.05) {
        pbs_camera a, b;
        pbs_path_at(&p, t, &a);
        pbs_path_at(&q, t, &b);
        double moved[3] = {(a.eye[0] - 1e7) / 1000, a.eye[1] / 1000, a.eye[2] / 1000};
        CHECK(apart(moved, b.eye) < 1e-9 && fabs(a.unit / 1000 - b.unit) < 1e-9);
        CHECK(apart(a.back, b.back) < 1e-9);
    }
    pbs_path_free(&run, &p);
    pbs_path_free(&run, &q);
}

/* Eye and target that meet, and ups that are opposite, still give a camera. */
TEST(degenerate_moments) {
    pbs_path p;
    CHECK(parse("0 1 0 0 -1 0 0  0 1 0\n1 -1 0 0 1 0 0  0 -1 0", &p) == PBS_OK);
    for (int i = 0; i <= 1000; i++) {
        pbs_camera c;
        pbs_path_at(&p, i / 1000.0, &c);
        double axes = 0;
        for (int k = 0; k < 3; k++)
            axes += c.right[k] * c.right[k] + c.up[k] * c.up[k] + c.back[k] * c.back[k];
        CHECK_NUM(fabs(axes - 3) < 1e-9 && c.unit > 0 && isfinite(c.eye[0]), i);
    }
    pbs_path_free(&run, &p);
    CHECK(parse("0 1e100 -1e100 1e100 0 0 0\n1e9 -1e100 1e100 0 1e-100 0 0 179", &p) == PBS_OK);
    for (int i = 0; i <= 100; i++) {
        pbs_camera c;
        pbs_path_at(&p, i * 1e7, &c);
        CHECK(isfinite(c.eye[0]) && isfinite(c.unit) && c.tan_half > 0);
    }
    pbs_path_free(&run, &p);
}

TEST(up_of_the_option) {
    const double z[3] = {0, 0, 1};
    pbs_path p;
    pbs_camera c;
    CHECK(pbs_path_parse(&run, "p", "0 1 0 0 0 0 0", 13, z, &p, &err) == PBS_OK);
    pbs_path_at(&p, 0, &c);
    CHECK(c.world_up[2] == 1);
    pbs_path_free(&run, &p);
}

TEST(bad_lines_are_named) {
    static const struct {
        const char *text, *says;
    } bad[] = {
        {"", "p.txt: no keyframes"},
        {"# nothing\n\n", "p.txt: no keyframes"},
        {"0 1 2 3 4 5 6\n1 1 2 3\n", "p.txt: line 2: TIME EX"},
        {"0 1 2 3 4 5 6 7 8\n", "p.txt: line 1: TIME EX"},
        {"\n0 1 2 3 4 5 6 7 8 9 10 11\n", "p.txt: line 2: TIME EX"},
        {"0 1 2 3 4 5 x\n", "p.txt: line 1: TIME EX"},
        {"0 1 2 3 4 5 6x\n", "p.txt: line 1: TIME EX"},
        {"0,,1 2 3 4 5 6\n", "p.txt: line 1: TIME EX"},
        {"0 1 2 3 4 5 6,\n", "p.txt: line 1: TIME EX"},
        {"0 1 2 3 4 5 nan\n", "p.txt: line 1: a number is not finite"},
        {"inf 1 2 3 4 5 6\n", "p.txt: line 1: a number is not finite"},
        {"0 1 2 3 4 5 1e101\n", "p.txt: line 1: a number is not finite, or beyond"},
        {"1e10 1 2 3 4 5 6\n", "p.txt: line 1: the time is beyond"},
        {"0 1 2 3 4 5 6 180\n", "p.txt: line 1: the field of view"},
        {"0 1 2 3 4 5 6 0\n", "p.txt: line 1: the field of view"},
        {"0 1 2 3 1 2 3\n", "p.txt: line 1: eye and target"},
        {"0 1 2 3 4 5 6\n0 1 2 3 4 5 6\n", "p.txt: line 2: the time is not later"},
        {"1 1 2 3 4 5 6\n0 1 2 3 4 5 6\n", "p.txt: line 2: the time is not later"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        pbs_path p;
        err.text[0] = 0;
        CHECK_NUM(parse(bad[i].text, &p) == PBS_DATA, i);
        if (strncmp(err.text, bad[i].says, strlen(bad[i].says))) {
            printf("# %s\n", err.text);
            CHECK(0);
        }
        CHECK(!p.keys && !p.count);
    }
    pbs_path p;
    CHECK(parse("x\n0 1 2 3 4 5 6\ny\nz\n", &p) == PBS_DATA);
    CHECK(strstr(err.text, "line 1: ") && strstr(err.text, "; also bad: lines 3, 4"));
    CHECK(parse("a\nb\nc\nd\ne\nf\ng\nh\ni\nj\n", &p) == PBS_DATA);
    CHECK(strstr(err.text, "; also bad: lines 2, 3, 4, 5, 6, 7, 8, ..."));
    CHECK(pbs_path_parse(&run, "p", "x\ny", 3, Y, &p, NULL) == PBS_DATA);
    CHECK(pbs_mem_used(&run) == 0);
}

/* Any bytes: an error or a path, never a crash, and a path gives cameras. */
TEST(any_bytes) {
    static const char letters[] = "0123456789.-+e, \n#naif\t\r";
    uint64_t state = 1234567;
    int good = 0;
    for (int i = 0; i < 20000; i++) {
        char text[96];
        size_t n = 0, size = (size_t)i % 96;
        for (; n < size; n++) {
            state ^= state << 13, state ^= state >> 7, state ^= state << 17;
            text[n] = letters[state % (i % 3 ? 14 : sizeof letters - 1)];
            if (i % 3 && state >> 60 < 7) text[n] = ' ';
        }
        pbs_path p;
        pbs_camera c;
        if (pbs_path_parse(&run, "p", text, n, Y, &p, &err)) continue;
        pbs_path_at(&p, pbs_path_start(&p), &c);
        CHECK(isfinite(c.eye[0]) && c.unit > 0);
        good++;
        pbs_path_free(&run, &p);
    }
    CHECK_NUM(good > 10, good);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST_MAIN
