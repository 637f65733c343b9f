/* camera.c: framing a box, reading a camera from text, world to view. */
#include "cmd/pbs-view/plan/camera.h"
#include <stdlib.h>

#define DEFAULT_FOV 30.0
#define RADIANS     (3.14159265358979323846 / 180)
/* Free space around a framed box, as a share of the picture's half side. */
#define MARGIN 0.06

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(double out[3], const double a[3], const double b[3]) {
    for (int k = 0; k < 3; k++)
        out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

/* Returns the length; 0 and v unchanged if it has none. Scaled first, for 10^-200 and 10^200. */
static double normalise(double v[3]) {
    double largest = fmax(fabs(v[0]), fmax(fabs(v[1]), fabs(v[2])));
    if (!(largest > 0) || !isfinite(largest)) return 0;
    for (int k = 0; k < 3; k++) v[k] /= largest;
    double length = sqrt(dot(v, v));
    for (int k = 0; k < 3; k++) v[k] /= length;
    return length * largest;
}

/* back and world_up are set, of length 1. */
static void complete(pbs_camera *c) {
    cross(c->right, c->world_up, c->back);
    if (normalise(c->right) < 1e-9) {
        /* Looking straight up or down: any direction is right, but always the same. */
        double side[3] = {fabs(c->back[0]) < 0.5, fabs(c->back[0]) >= 0.5, 0};
        cross(c->right, side, c->back);
        normalise(c->right);
    }
    cross(c->up, c->back, c->right);
}

static void set_up(pbs_camera *c, const double up[3]) {
    memcpy(c->world_up, up, sizeof c->world_up);
    if (normalise(c->world_up) > 0) return;
    memcpy(c->world_up, (double[3]){0, 1, 0}, sizeof c->world_up);
}

/* Towards the eye: front, right and above, for any axis that is up. */
static void three_quarter(double out[3], const double up[3]) {
    double front[3] = {0, 0, 1}, right[3];
    if (fabs(up[2]) > 0.9) front[1] = -1, front[2] = 0;
    cross(right, up, front);
    normalise(right);
    cross(front, right, up);
    for (int k = 0; k < 3; k++) out[k] = 0.62 * front[k] + 0.58 * right[k] + 0.42 * up[k];
}

static pbs_box usable(const pbs_box *box) {
    pbs_box b = *box;
    double size = 0, away = 0;
    for (int k = 0; k < 3; k++) {
        if (pbs_box_is_empty(box) || !isfinite(b.max[k] - b.min[k]))
            return (pbs_box){{-0.5, -0.5, -0.5}, {0.5, 0.5, 0.5}};
        size = fmax(size, b.max[k] - b.min[k]);
        away = fmax(away, fabs(b.max[k]));
    }
    double least = away * 1e-9 > 0 ? away * 1e-9 : 1e-9;
    for (int k = 0; size == 0 && k < 3; k++) b.min[k] -= least, b.max[k] += least;
    return b;
}

/* Half sides of the box's picture from a target and a distance: left, right, bottom, top. Returns
 * the depth of the nearest corner. */
static double extents(const pbs_camera *c, const pbs_box *b, double out[4]) {
    double nearest = INFINITY;
    out[0] = out[2] = INFINITY, out[1] = out[3] = -INFINITY;
    for (int i = 0; i < 8; i++) {
        double p[3];
        for (int k = 0; k < 3; k++) p[k] = (i >> k & 1 ? b->max[k] : b->min[k]) - c->target[k];
        double depth = c->unit - dot(p, c->back);
        double x = dot(p, c->right) / depth, y = dot(p, c->up) / depth;
        out[0] = fmin(out[0], x), out[1] = fmax(out[1], x);
        out[2] = fmin(out[2], y), out[3] = fmax(out[3], y);
        nearest = fmin(nearest, depth);
    }
    return nearest;
}

/* The least distance from which every corner is inside, for the present target. */
static double least_distance(const pbs_camera *c, const pbs_box *b, double tan_x, double tan_y) {
    double least = 0;
    for (int i = 0; i < 8; i++) {
        double p[3];
        for (int k = 0; k < 3; k++) p[k] = (i >> k & 1 ? b->max[k] : b->min[k]) - c->target[k];
        double side = fmax(fabs(dot(p, c->right)) / tan_x, fabs(dot(p, c->up)) / tan_y);
        least = fmax(least, dot(p, c->back) + side);
    }
    return least;
}

void pbs_camera_frame(pbs_camera *out, const pbs_box *box, const pbs_camera_desc *desc) {
    pbs_box b = usable(box);
    double fov = desc->fov > 0 && desc->fov < 179 ? desc->fov : DEFAULT_FOV;
    double aspect = desc->aspect > 0 && isfinite(desc->aspect) ? desc->aspect : 1;
    pbs_camera c = {.tan_half = tan(fov / 2 * RADIANS)};
    double tan_y = c.tan_half * (1 - MARGIN), tan_x = tan_y * aspect;
    set_up(&c, desc->up);
    memcpy(c.back, desc->toward_eye, sizeof c.back);
    if (normalise(c.back) == 0) {
        three_quarter(c.back, c.world_up);
        normalise(c.back);
    }
    complete(&c);
    for (int k = 0; k < 3; k++) c.target[k] = b.min[k] + (b.max[k] - b.min[k]) / 2;
    c.unit = least_distance(&c, &b, tan_x, tan_y);
    /* A box is not seen in the middle of its picture: move there, and nearer. */
    for (int step = 0; step < 4; step++) {
        double e[4];
        extents(&c, &b, e);
        for (int k = 0; k < 3; k++)
            c.target[k] += c.unit * ((e[0] + e[1]) / 2 * c.right[k] + (e[2] + e[3]) / 2 * c.up[k]);
        c.unit = least_distance(&c, &b, tan_x, tan_y);
    }
    for (int k = 0; k < 3; k++) c.eye[k] = c.target[k] + c.unit * c.back[k];
    *out = c;
}

bool pbs_camera_look(pbs_camera *out, const double eye[3], const double target[3],
                     const double up[3], double fov) {
    if (fov == 0) fov = DEFAULT_FOV;
    pbs_camera c = {.tan_half = tan(fov / 2 * RADIANS)};
    for (int k = 0; k < 3; k++) {
        c.eye[k] = eye[k];
        c.target[k] = target[k];
        c.back[k] = eye[k] - target[k];
    }
    c.unit = normalise(c.back);
    if (!(c.unit > 0) || !(fov > 0 && fov < 180)) return false;
    set_up(&c, up);
    complete(&c);
    *out = c;
    return true;
}

static int parse_numbers(const char *text, double out[10]) {
    for (int n = 0; n < 10; n++) {
        char *end;
        out[n] = strtod(text, &end);
        if (end == text || !isfinite(out[n])) return -1;
        if (!*end) return n + 1;
        if (*end != ',') return -1;
        text = end + 1;
    }
    return -1;
}

pbs_code pbs_camera_parse(pbs_camera *out, const char *text, pbs_err *err) {
    double v[10], up[3] = {0, 1, 0}, fov = DEFAULT_FOV;
    int n = parse_numbers(text, v);
    if (n != 6 && n != 7 && n != 9 && n != 10)
        return pbs_fail(err, PBS_USAGE,
                        "camera %s: EX,EY,EZ,TX,TY,TZ[,UX,UY,UZ][,FOV] is wanted: 6, 7, 9 or 10 "
                        "numbers",
                        text);
    if (n >= 9) memcpy(up, v + 6, sizeof up);
    if (n == 7 || n == 10) fov = v[n - 1];
    if (!(fov > 0 && fov < 180))
        return pbs_fail(err, PBS_USAGE, "camera %s: field of view %g: between 0 and 180", text,
                        fov);
    if (!pbs_camera_look(out, v, v + 3, up, fov))
        return pbs_fail(err, PBS_USAGE, "camera %s: eye and target are the same point", text);
    return PBS_OK;
}

static void place_eye(pbs_camera *c) {
    for (int k = 0; k < 3; k++) c->eye[k] = c->target[k] + c->unit * c->back[k];
    complete(c);
}

/* Turns the direction towards the eye around what is up, and lifts it; never over the pole. */
static void swing(pbs_camera *c, double dx, double dy) {
    double height = dot(c->back, c->world_up), turn = -3 * dx;
    double lift = asin(height > 1 ? 1 : height < -1 ? -1 : height);
    double higher = lift + 3 * dy, most = 89.5 * RADIANS;
    higher = higher > most ? most : higher < -most ? -most : higher;
    double flat[3], side[3];
    cross(flat, c->right, c->world_up); /* horizontal, towards the eye */
    cross(side, c->world_up, flat);
    for (int k = 0; k < 3; k++)
        c->back[k] = cos(higher) * (cos(turn) * flat[k] + sin(turn) * side[k]) +
                     sin(higher) * c->world_up[k];
    normalise(c->back);
}

void pbs_camera_orbit(pbs_camera *c, double dx, double dy) {
    swing(c, dx, dy);
    place_eye(c);
}

void pbs_camera_pan(pbs_camera *c, double dx, double dy) {
    double scale = 2 * c->tan_half * c->unit;
    for (int k = 0; k < 3; k++) c->target[k] += scale * (-dx * c->right[k] + dy * c->up[k]);
    place_eye(c);
}

/* As near as doubles tell the eye from the target, and as far. */
static bool usable_unit(const double at[3], double unit) {
    double reach = fmax(fabs(at[0]), fmax(fabs(at[1]), fabs(at[2])));
    return unit > 1e-12 * reach && unit > 1e-290 && unit < 1e290;
}

void pbs_camera_dolly(pbs_camera *c, double steps) {
    double unit = c->unit * pow(0.9, steps);
    if (!usable_unit(c->target, unit)) return;
    c->unit = unit;
    place_eye(c);
}

static void place_target(pbs_camera *c) {
    for (int k = 0; k < 3; k++) c->target[k] = c->eye[k] - c->unit * c->back[k];
}

void pbs_camera_turn(pbs_camera *c, double dx, double dy) {
    swing(c, dx, dy);
    complete(c);
    place_target(c);
}

void pbs_camera_move(pbs_camera *c, double right, double up, double ahead) {
    for (int k = 0; k < 3; k++)
        c->eye[k] += c->unit * (right * c->right[k] + up * c->up[k] - ahead * c->back[k]);
    place_target(c);
}

void pbs_camera_refocus(pbs_camera *c, double distance) {
    double unit = c->unit * distance;
    if (!usable_unit(c->eye, unit)) return;
    c->unit = unit;
    place_target(c);
}

void pbs_camera_shift(pbs_camera *c, double right) {
    for (int k = 0; k < 3; k++) c->eye[k] += right * c->right[k];
    place_target(c);
}

void pbs_camera_place(double out[12], const pbs_camera *c, const double m[12]) {
    const double *axis[3] = {c->right, c->up, c->back};
    double t[12];
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 4; k++) {
            double v = 0;
            for (int i = 0; i < 3; i++)
                v += axis[r][i] * (k == 3 ? m[4 * i + 3] - c->eye[i] : m[4 * i + k]);
            t[4 * r + k] = v / c->unit;
        }
    memcpy(out, t, sizeof t);
}

double pbs_camera_pixel(const pbs_camera *camera, unsigned height) {
    return 2 * camera->tan_half / (height ? height : 1);
}
