#include "libcore/data/motion.h"
#include <math.h>
#include <string.h>

/* Of length 1, whatever its length is; what has no direction is no rotation. */
static void unit(double q[4]) {
    double most = 0, square = 0;
    for (int k = 0; k < 4; k++) most = isfinite(q[k]) ? fmax(most, fabs(q[k])) : INFINITY;
    bool good = most > 0 && isfinite(most);
    for (int k = 0; k < 4; k++) {
        q[k] = good ? q[k] / most : k == 3;
        square += q[k] * q[k];
    }
    for (int k = 0; k < 4; k++) q[k] /= sqrt(square);
}

void pbs_trs_matrix(const pbs_trs *p, double m[12]) {
    double r[4];
    memcpy(r, p->rotation, sizeof r);
    unit(r);
    double x = r[0], y = r[1], z = r[2], w = r[3];
    double q[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),
                   2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                   2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y)};
    for (int row = 0; row < 3; row++) {
        for (int c = 0; c < 3; c++) m[4 * row + c] = q[3 * row + c] * p->scale[c];
        m[4 * row + 3] = p->translation[row];
    }
}

/* ---- between two keys ---- */

/* Exact where both are equal; the second form bears differences beyond all numbers. */
static double mix(double a, double b, double u) {
    double v = a + u * (b - a);
    return isfinite(v) ? v : a * (1 - u) + b * u;
}

/* Appendix C.3, with the angle from both the sum and the difference, which is exact near 0, where
 * an arc cosine is not. After the turn to the shorter arc it is at most a right angle. */
static void slerp(const double *from, const double *to, double u, double out[4]) {
    double a[4], b[4], dot = 0, apart = 0, together = 0;
    memcpy(a, from, sizeof a);
    memcpy(b, to, sizeof b);
    unit(a);
    unit(b);
    for (int k = 0; k < 4; k++) dot += a[k] * b[k];
    for (int k = 0; k < 4 && dot < 0; k++) b[k] = -b[k];
    for (int k = 0; k < 4; k++) {
        apart += (a[k] - b[k]) * (a[k] - b[k]);
        together += (a[k] + b[k]) * (a[k] + b[k]);
    }
    double angle = 2 * atan2(sqrt(apart), sqrt(together)), s = sin(angle);
    double p = s > 1e-9 ? sin((1 - u) * angle) / s : 1 - u;
    double q = s > 1e-9 ? sin(u * angle) / s : u;
    for (int k = 0; k < 4; k++) out[k] = p * a[k] + q * b[k];
}

/* Appendix C.4. from, to: keys of tangent, value, tangent, n numbers each. */
static void spline(const double *from, const double *to, int n, double u, double seconds,
                   double *out) {
    double u2 = u * u, u3 = u2 * u;
    for (int k = 0; k < n; k++) {
        double v0 = from[n + k], leave = from[2 * n + k], arrive = to[k], v1 = to[n + k];
        double v = v0 + (3 * u2 - 2 * u3) * (v1 - v0) + seconds * (u3 - 2 * u2 + u) * leave +
                   seconds * (u3 - u2) * arrive;
        out[k] = isfinite(v) ? v : mix(v0, v1, u);
    }
}

void pbs_motion_channel_at(const pbs_motion_channel *c, double time, double out[4]) {
    uint32_t lo = 0, hi = c->keys; /* keys below lo are not after the time, those from hi on are */
    uint32_t step = pbs_motion_numbers(c->path, c->way);
    int n = c->path == PBS_MOTION_ROTATION ? 4 : 3, skip = c->way == PBS_MOTION_CUBIC ? n : 0;
    while (lo < hi) {
        uint32_t mid = lo + (hi - lo) / 2;
        if (c->time[mid] <= time)
            lo = mid + 1;
        else
            hi = mid;
    }
    bool between = lo > 0 && lo < c->keys && c->way != PBS_MOTION_STEP;
    const double *from = c->value + (size_t)step * (lo ? lo - 1 : 0), *to = from + step;
    memcpy(out, from + skip, (size_t)n * sizeof *out);
    if (!between) return;
    double begin = c->time[lo - 1], end = c->time[lo];
    /* Halves, since the whole may be more than there are numbers. */
    double u = fmin((time / 2 - begin / 2) / (end / 2 - begin / 2), 1);
    if (!(u > 0)) return;
    if (c->way == PBS_MOTION_CUBIC)
        spline(from, to, n, u, end - begin, out);
    else if (n == 4)
        slerp(from, to, u, out);
    else
        for (int k = 0; k < n; k++) out[k] = mix(from[k], to[k], u);
}

bool pbs_motion_at(const pbs_motion *motion, const double *time, double m[12]) {
    pbs_trs pose = motion->rest;
    double *const part[PBS_MOTION_PATHS] = {pose.translation, pose.rotation, pose.scale};
    bool set[PBS_MOTION_PATHS] = {false};
    for (uint32_t i = 0; i < motion->count; i++) {
        const pbs_motion_channel *c = &motion->channels[i];
        double v[4];
        if (set[c->path] || isnan(time[c->animation])) continue;
        set[c->path] = true;
        pbs_motion_channel_at(c, time[c->animation], v);
        memcpy(part[c->path], v, (c->path == PBS_MOTION_ROTATION ? 4 : 3) * sizeof *v);
    }
    pbs_trs_matrix(&pose, m);
    return set[PBS_MOTION_TRANSLATION] || set[PBS_MOTION_ROTATION] || set[PBS_MOTION_SCALE];
}

double pbs_motion_loop(double time, double end) {
    if (isnan(time) || !(end > 0) || (time >= 0 && time <= end)) return time;
    if (isinf(time)) return time > 0 ? end : 0;
    double rest = fmod(time, end);
    return rest < 0 ? rest + end : rest;
}
