/* path.c: reading camera paths, and the curves through their keyframes. */
#include "cmd/pbs-view/plan/path.h"
#include "formats/container/file.h"
#include "formats/readers/text.h"
#include <stdio.h>

#define RADIANS (3.14159265358979323846 / 180)
/* Sums and differences of such numbers, times seconds, are still finite. */
#define LARGEST  1e100
#define LONGEST  1e9
#define CLOSEST  1e-6
#define MOST_BAD 8

typedef struct reader {
    const char *name;
    const double *up;
    size_t bad[MOST_BAD], bad_count;
    pbs_err *err;
} reader;

/* ---- a line ---- */

/* Numbers with blanks or commas between them, up to the end or #. -1: something else is there, or
 * there are too many. */
static int numbers(const char *p, const char *end, double *v, int most) {
    for (int n = 0;; n++) {
        p = pbs_text_skip_blank(p, end);
        bool comma = n && p < end && *p == ',';
        if (comma) p = pbs_text_skip_blank(p + 1, end);
        if (!comma && (p == end || *p == '#')) return n;
        if (n == most || !pbs_text_double(&p, end, &v[n])) return -1;
        if (p < end && !pbs_text_is_blank(*p) && *p != ',' && *p != '#') return -1;
    }
}

static const char *bad_numbers(const double *v, int n) {
    if (n != 7 && n != 8 && n != 10 && n != 11)
        return "TIME EX EY EZ TX TY TZ [UX UY UZ] [FOV] is wanted: 7, 8, 10 or 11 numbers";
    for (int i = 0; i < n; i++)
        if (!(fabs(v[i]) <= LARGEST)) return "a number is not finite, or beyond 1e100";
    if (!(fabs(v[0]) <= LONGEST)) return "the time is beyond 1e9 seconds";
    if (n == 8 || n == 11)
        if (!(v[n - 1] > 0 && v[n - 1] < 180)) return "the field of view is not between 0 and 180";
    return NULL;
}

/* What is wrong with it, or NULL. before: the keyframe in front of it, or NULL. */
static const char *keyframe(const reader *r, const double *v, int n, const pbs_keyframe *before,
                            pbs_keyframe *out) {
    const char *wrong = bad_numbers(v, n);
    pbs_camera c;
    if (wrong) return wrong;
    const double *up = n >= 10 ? v + 7 : r->up;
    if (!pbs_camera_look(&c, v + 1, v + 4, up, n == 8 || n == 11 ? v[n - 1] : 0))
        return "eye and target are the same point";
    if (before && !(v[0] - before->time >= CLOSEST))
        return "the time is not later than that of the line before";
    *out = (pbs_keyframe){.time = v[0]};
    for (int k = 0; k < 3; k++) {
        out->at[PBS_PATH_EYE + k] = c.eye[k];
        out->at[PBS_PATH_TARGET + k] = c.target[k];
        out->at[PBS_PATH_UP + k] = c.world_up[k];
    }
    out->at[PBS_PATH_ZOOM] = log(c.tan_half);
    return NULL;
}

/* ---- the file ---- */

static void note_bad(reader *r, size_t line, const char *wrong) {
    if (!r->bad_count) pbs_fail(r->err, PBS_DATA, "%s: line %zu: %s", r->name, line, wrong);
    if (r->bad_count < MOST_BAD) r->bad[r->bad_count] = line;
    r->bad_count++;
}

/* One line names them all: the first with its reason, the others by their numbers. */
static pbs_code say_bad(const reader *r) {
    char also[200] = "", first[1024];
    size_t shown = r->bad_count < MOST_BAD ? r->bad_count : MOST_BAD;
    if (!r->err || r->bad_count == 1) return PBS_DATA;
    for (size_t i = 1, n = 0; i < shown; i++)
        n += (size_t)snprintf(also + n, sizeof also - n, "%s%zu", i > 1 ? ", " : "", r->bad[i]);
    snprintf(first, sizeof first, "%s", r->err->text);
    return pbs_fail(r->err, PBS_DATA, "%s; also bad: line%s %s%s", first, shown > 2 ? "s" : "",
                    also, shown < r->bad_count ? ", ..." : "");
}

static pbs_code read_lines(pbs_run *run, reader *r, const char *p, const char *end, pbs_path *out) {
    size_t room = 0, line = 0;
    while (p < end) {
        const char *stop = memchr(p, '\n', (size_t)(end - p));
        if (!stop) stop = end;
        double v[11] = {0};
        int n = numbers(p, stop, v, 11);
        p = stop < end ? stop + 1 : end;
        line++;
        if (n == 0) continue;
        pbs_code rc = pbs_grow(run, &out->keys, &room, out->count + 1, sizeof *out->keys,
                               "the camera path", r->err);
        if (rc) return rc;
        const char *wrong = keyframe(r, v, n, out->count ? &out->keys[out->count - 1] : NULL,
                                     &out->keys[out->count]);
        if (wrong)
            note_bad(r, line, wrong);
        else
            out->count++;
    }
    return r->bad_count ? say_bad(r) : PBS_OK;
}

/* ---- curves ---- */

static bool still(const pbs_keyframe *a, const pbs_keyframe *b, int first, int count) {
    return memcmp(a->at + first, b->at + first, (size_t)count * sizeof *a->at) == 0;
}

/* The slope of the parabola through three keyframes; at the ends the curve is straight. */
static void set_speeds(pbs_path *p) {
    static const int first[] = {PBS_PATH_EYE, PBS_PATH_TARGET, PBS_PATH_UP, PBS_PATH_ZOOM,
                                PBS_PATH_VALUES};
    for (size_t i = 0; i < p->count; i++) {
        pbs_keyframe *a = &p->keys[i ? i - 1 : 0], *k = &p->keys[i];
        pbs_keyframe *b = &p->keys[i + 1 < p->count ? i + 1 : i];
        double before = k->time - a->time, after = b->time - k->time;
        for (int g = 0; g < 4; g++) {
            int from = first[g], n = first[g + 1] - from;
            if ((a != k && still(a, k, from, n)) || (b != k && still(k, b, from, n))) continue;
            for (int v = from; v < from + n && p->count > 1; v++) {
                double in = a != k ? (k->at[v] - a->at[v]) / before : 0;
                double out = b != k ? (b->at[v] - k->at[v]) / after : 0;
                if (a == k) k->speed[v] = out;
                if (b == k) k->speed[v] = in;
                if (a != k && b != k) k->speed[v] = (in * after + out * before) / (before + after);
            }
        }
    }
}

/* Written so that it is exact where nothing moves. */
static double cubic(const pbs_keyframe *a, const pbs_keyframe *b, int v, double t) {
    double length = b->time - a->time, u = 1 - t;
    return a->at[v] + t * t * (3 - 2 * t) * (b->at[v] - a->at[v]) +
           t * u * length * (u * a->speed[v] - t * b->speed[v]);
}

void pbs_path_at(const pbs_path *p, double time, pbs_camera *out) {
    const pbs_keyframe *a = p->keys, *last = p->keys + p->count - 1, *b;
    double at[PBS_PATH_VALUES], t = 0;
    while (a < last && time >= a[1].time) a++;
    b = a < last ? a + 1 : a;
    if (a < b && time > a->time) t = (time - a->time) / (b->time - a->time);
    for (int v = 0; v < PBS_PATH_VALUES; v++) at[v] = t > 0 ? cubic(a, b, v, t) : a->at[v];
    double fov = 2 * atan(exp(at[PBS_PATH_ZOOM])) / RADIANS;
    fov = fmin(fmax(fov, 1e-6), 180 - 1e-6);
    /* Where the eye passes through its target, it looks as it did at the keyframe. */
    if (pbs_camera_look(out, at + PBS_PATH_EYE, at + PBS_PATH_TARGET, at + PBS_PATH_UP, fov))
        return;
    pbs_camera_look(out, a->at + PBS_PATH_EYE, a->at + PBS_PATH_TARGET, a->at + PBS_PATH_UP, fov);
    for (int k = 0; k < 3; k++) out->target[k] += at[PBS_PATH_EYE + k] - out->eye[k];
    memcpy(out->eye, at + PBS_PATH_EYE, sizeof out->eye);
}

pbs_code pbs_path_parse(pbs_run *run, const char *name, const void *bytes, size_t size,
                        const double up[3], pbs_path *out, pbs_err *err) {
    reader r = {.name = name, .up = up, .err = err};
    const char *p = bytes;
    *out = (pbs_path){0};
    size_t mark = size >= 3 && !memcmp(p, "\xef\xbb\xbf", 3) ? 3 : 0; /* of UTF-8 */
    pbs_code rc = size ? read_lines(run, &r, p + mark, p + size, out) : PBS_OK;
    if (!rc && !out->count) rc = pbs_fail(err, PBS_DATA, "%s: no keyframes", name);
    if (rc)
        pbs_path_free(run, out);
    else
        set_speeds(out);
    return rc;
}

pbs_code pbs_path_read(pbs_run *run, const char *file, const double up[3], pbs_path *out,
                       pbs_err *err) {
    pbs_input in;
    *out = (pbs_path){0};
    pbs_code rc = pbs_input_open(run, file, &in, err);
    if (rc) return rc;
    rc = pbs_input_map(&in, err);
    if (!rc) rc = pbs_path_parse(run, in.name, in.bytes, (size_t)in.size, up, out, err);
    pbs_input_close(&in);
    return rc;
}

void pbs_path_free(pbs_run *run, pbs_path *p) {
    pbs_free(run, p->keys);
    *p = (pbs_path){0};
}
