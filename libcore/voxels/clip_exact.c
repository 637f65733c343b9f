/* clip_exact.c: whether a triangle and a half-open cell have a point in common, decided exactly.
 *
 * Two convex bodies are apart if an axis separates them: here one of the box's three normals, the
 * triangle's normal, or one of the nine cross products of their edges. The box is that from the
 * cell's lower corner to just below its upper one, so its end along an axis is not a point of it if
 * that end is on an upper face; then the triangle may reach that end and still be apart.
 */
#include "libcore/voxels/clip_inner.h"
#include "libcore/voxels/exact.h"

/* Below this part of the sum of its terms' sizes, the sign of a rounded expression is not certain.
 * Differences of coordinates are exact; a comparison has at most a dozen roundings after that. */
static const double little = 0x1p-48;

typedef enum verdict { APART, UNKNOWN, TOGETHER } verdict;

/* Whether doubles make no error: at most 2^16 units of 2^-6, which a normal's product with a place
 * has 51 bits of. Lattices often are such, and what lies on them leaves nothing to bounds. */
static bool is_plain(double q[3][3]) {
    for (int i = 0; i < 9; i++) {
        double x = q[i / 3][i % 3];
        if (!(fabs(x) < 512) || (int)(x * 64) != x * 64) return false;
    }
    return true;
}

/* a < b is APART, a > b TOGETHER, up to an error; without one, an end of the box may be open. */
static verdict compare(double a, double b, double error, bool open) {
    double d = a - b;
    if (error == 0 && d == 0) return open ? APART : TOGETHER;
    return d < -error ? APART : d > error ? TOGETHER : UNKNOWN;
}

/* q: corners from the cell's. Axis across edge e in the plane of the axes a, b. doubt: above, or 0.
 */
static verdict edge_rounded(double q[3][3], int e, int a, int b, double doubt) {
    const double *from = q[e], *to = q[(e + 1) % 3], *other = q[(e + 2) % 3];
    double x = to[b] - from[b], y = from[a] - to[a];
    double f = x * from[a] + y * from[b], g = x * other[a] + y * other[b];
    double low = (x < 0 ? x : 0) + (y < 0 ? y : 0), high = (x > 0 ? x : 0) + (y > 0 ? y : 0);
    double size = fabs(x) * (fabs(from[a]) + fabs(other[a]) + 1) +
                  fabs(y) * (fabs(from[b]) + fabs(other[b]) + 1);
    if (size == 0) return TOGETHER;
    verdict u = compare(f > g ? f : g, low, doubt * size, low < 0);
    verdict v = compare(high, f < g ? f : g, doubt * size, high > 0);
    return u < v ? u : v;
}

static verdict plane_rounded(double q[3][3], double doubt) {
    double at = 0, low = 0, high = 0, size = 0;
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        double s = (q[1][a] - q[0][a]) * (q[2][b] - q[0][b]);
        double t = (q[1][b] - q[0][b]) * (q[2][a] - q[0][a]), n = s - t;
        at += n * q[0][k];
        size += (fabs(s) + fabs(t)) * (fabs(q[0][k]) + 1);
        low += n < 0 ? n : 0, high += n > 0 ? n : 0;
    }
    if (size == 0) return TOGETHER;
    verdict u = compare(at, low, doubt * size, low < 0);
    verdict v = compare(high, at, doubt * size, high > 0);
    return u < v ? u : v;
}

static bool edge_exact(int64_t q[3][3], int e, int a, int b) {
    const int64_t *from = q[e], *to = q[(e + 1) % 3], *other = q[(e + 2) % 3], one = PBS_FIXED_ONE;
    int64_t x = to[b] - from[b], y = from[a] - to[a];
    pbs_int128 f = (pbs_int128)x * from[a] + (pbs_int128)y * from[b];
    pbs_int128 g = (pbs_int128)x * other[a] + (pbs_int128)y * other[b];
    pbs_int128 least = f < g ? f : g, most = f < g ? g : f;
    pbs_int128 low = (pbs_int128)((x < 0 ? x : 0) + (y < 0 ? y : 0)) * one;
    pbs_int128 high = (pbs_int128)((x > 0 ? x : 0) + (y > 0 ? y : 0)) * one;
    bool low_out = x < 0 || y<0, high_out = x> 0 || y > 0;
    return !(most < low || (most == low && low_out) || least > high || (least == high && high_out));
}

/* Sign of the normal times q[0], less where an end of the box is along it. */
static int plane_side(const pbs_int128 n[3], int64_t q[3][3], bool high) {
    pbs_wide sum = {0, 0};
    for (int k = 0; k < 3; k++) {
        bool upper = high ? n[k] > 0 : n[k] < 0;
        sum = pbs_wide_add(sum, pbs_wide_mul64(n[k], q[0][k] - (upper ? PBS_FIXED_ONE : 0)));
    }
    return pbs_wide_sign(sum);
}

static bool plane_exact(int64_t q[3][3]) {
    pbs_int128 n[3];
    bool low_out = false, high_out = false;
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        n[k] =
            pbs_cross(q[1][a] - q[0][a], q[1][b] - q[0][b], q[2][a] - q[0][a], q[2][b] - q[0][b]);
        low_out |= n[k]<0, high_out |= n[k]> 0;
    }
    int low = plane_side(n, q, false), high = plane_side(n, q, true);
    return !(low < 0 || (low == 0 && low_out) || high > 0 || (high == 0 && high_out));
}

static void from_cell(const double p[3][3], const int cell[3], int64_t q[3][3]) {
    for (int i = 0; i < 9; i++) q[i / 3][i % 3] = pbs_fixed(p[i / 3][i % 3] - cell[i % 3]);
}

static bool meets_exact(const double p[3][3], const int cell[3]) {
    int64_t q[3][3];
    from_cell(p, cell, q);
    for (int i = 0; i < 9; i++)
        if (!edge_exact(q, i / 3, (i + 1) % 3, (i + 2) % 3)) return false;
    return plane_exact(q);
}

bool pbs_clip_meets(const double p[3][3], const int cell[3]) {
    double q[3][3];
    verdict sure = TOGETHER;
    for (int i = 0; i < 9; i++) q[i / 3][i % 3] = p[i / 3][i % 3] - cell[i % 3];
    for (int k = 0; k < 3; k++) {
        double x = q[0][k], y = q[1][k], z = q[2][k];
        if ((x < 0 && y < 0 && z < 0) || (x >= 1 && y >= 1 && z >= 1)) return false;
    }
    double doubt = is_plain(q) ? 0 : little;
    for (int i = 0; i < 10; i++) {
        verdict v = i < 9 ? edge_rounded(q, i / 3, (i + 1) % 3, (i + 2) % 3, doubt)
                          : plane_rounded(q, doubt);
        if (v == APART) return false;
        sure = v < sure ? v : sure;
    }
    return sure == TOGETHER || meets_exact(p, cell);
}

bool pbs_clip_meets_plane(const double p[3][3], const int cell[3]) {
    double q[3][3];
    for (int i = 0; i < 9; i++) q[i / 3][i % 3] = p[i / 3][i % 3] - cell[i % 3];
    verdict sure = plane_rounded(q, is_plain(q) ? 0 : little);
    if (sure != UNKNOWN) return sure == TOGETHER;
    int64_t exact[3][3];
    from_cell(p, cell, exact);
    return plane_exact(exact);
}

void pbs_clip_normal(const double p[3][3], double n[3]) {
    int64_t d[2][3];
    for (int i = 0; i < 6; i++) d[i / 3][i % 3] = pbs_fixed(p[1 + i / 3][i % 3] - p[0][i % 3]);
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        n[k] = (double)pbs_cross(d[0][a], d[0][b], d[1][a], d[1][b]) * 0x1p-64;
    }
}
