/* measure: what all results are measured with, whoever made them, and inputs that are not scenes.
 *
 * measure points REFERENCE.ply RESULT.ply [RADIUS]
 *                                           how well points stand for others: see points()
 * measure cells X Y Z SIDE RESULT.ply SEPARATING.ply CONSERVATIVE.ply
 *                                           which cells are missing or too many: see cells()
 * measure surface MESH.ply RESULT.ply       mean and largest distance of points from triangles
 * measure sample MESH.ply N TO.ply          N random points of the triangles, with normals
 * measure terrain N TO.ply                  a generated cloud: strips of terrain with trees
 * measure centre FILE.ply TO.ply            the same points around the origin, for those with
 * floats measure box FILE.ply                      least and largest x, y, z; numbers of points,
 * triangles
 */
#include "tests/peers/nearest.hpp"

using namespace peers;

static uint64_t state = 1;
static double chance() {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (double)(state >> 11) * 0x1p-53;
}

static double covering(const cloud &reference, const nearest &near) {
    double worst = 0;
    for (const vec &p : reference.at) worst = std::max(worst, near.d2(p));
    return std::sqrt(worst);
}
/* Least and mean distance of a point from its nearest neighbour. */
static std::array<double, 2> spacing(const cloud &c, const nearest &near) {
    double least = INFINITY, sum = 0;
    for (size_t i = 0; i < c.at.size(); i++) {
        double d = std::sqrt(near.d2(
            c.at[i], [i](size_t k) { return k == i; }, INFINITY));
        least = std::min(least, d), sum += d;
    }
    return {least, sum / (double)c.at.size()};
}
/* The share of the reference points that have no point of the result on their own side within a
 * radius. Results may lack normals, so theirs are those of the nearest reference point. */
static double wrong_side(const cloud &reference, const cloud &result, const nearest &near,
                         const nearest &of_reference, double radius) {
    if (reference.normal.empty()) return NAN;
    std::vector<vec> normal;
    for (const vec &p : result.at) normal.push_back(reference.normal[of_reference.number(p)]);
    double within = radius * radius;
    size_t holes = 0;
    for (size_t i = 0; i < reference.at.size(); i++) {
        const vec &n = reference.normal[i];
        auto other_side = [&](size_t k) { return !(dot(n, normal[k]) > 0); };
        holes += !(near.d2(reference.at[i], other_side, within) < within);
    }
    return (double)holes / (double)reference.at.size();
}
/* Prints: points, least and mean spacing, covering radius, that of the first quarter in the order
 * of the file, how far a point is from all reference points at most, and the share of the reference
 * points that have none on their side within the given radius (0: 1.25 times the covering one). */
static void points(const char *reference_path, const char *result_path, double within) {
    cloud reference = read_ply(reference_path), result = read_ply(result_path);
    if (result.at.empty()) fail("no points");
    nearest near = nearest::of_points(result.at, result.at.size());
    nearest quarter = nearest::of_points(result.at, (result.at.size() + 3) / 4);
    nearest of_reference = nearest::of_points(reference.at, reference.at.size());
    double radius = covering(reference, near), off = covering(result, of_reference);
    auto [least, mean] = spacing(result, near);
    printf("%zu %.9g %.9g %.9g %.9g %.9g %.9g\n", result.at.size(), least, mean, radius,
           covering(reference, quarter), off,
           wrong_side(reference, result, near, of_reference, within > 0 ? within : 1.25 * radius));
}

/* Which cells hold the points; each once, sorted. */
static std::vector<std::array<int64_t, 3>> cells_of(const char *path, const vec &low, double side) {
    std::vector<std::array<int64_t, 3>> out;
    for (const vec &p : read_ply(path).at) {
        std::array<int64_t, 3> c;
        for (int k = 0; k < 3; k++) c[k] = (int64_t)std::floor((p[k] - low[k]) / side);
        out.push_back(c);
    }
    std::sort(out.begin(), out.end());
    out.erase(std::unique(out.begin(), out.end()), out.end());
    return out;
}
/* Prints: cells, how many of the exact six-separating set are missing, how many of the exact
 * conservative set are missing, how many are not in that, so that nothing touches them. */
static void cells(const vec &low, double side, char **path) {
    auto result = cells_of(path[0], low, side);
    auto separating = cells_of(path[1], low, side), conservative = cells_of(path[2], low, side);
    auto beyond = [](const auto &a, const auto &b) {
        std::vector<std::array<int64_t, 3>> d;
        std::set_difference(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(d));
        return d.size();
    };
    printf("%zu %zu %zu %zu\n", result.size(), beyond(separating, result),
           beyond(conservative, result), beyond(result, conservative));
}

/* Of at most 200,000 of the points, evenly chosen. */
static void surface(const char *mesh, const char *path) {
    nearest near = nearest::of_mesh(read_ply(mesh));
    cloud c = read_ply(path);
    size_t step = c.at.size() / 200000 + 1, count = 0;
    double sum = 0, most = 0;
    for (size_t i = 0; i < c.at.size(); i += step, count++) {
        double d = std::sqrt(near.d2(c.at[i]));
        sum += d, most = std::max(most, d);
    }
    printf("%.9g %.9g\n", sum / (double)count, most);
}

static void sample(const char *mesh, size_t n, const char *to) {
    cloud c = read_ply(mesh), out;
    std::vector<double> until;
    std::vector<vec> normal;
    double area = 0;
    for (const auto &t : c.triangle) {
        vec m = cross(sub(c.at[t[1]], c.at[t[0]]), sub(c.at[t[2]], c.at[t[0]]));
        double l = std::sqrt(dot(m, m));
        for (double &x : m) x /= l > 0 ? l : 1;
        normal.push_back(m), until.push_back(area += l);
    }
    for (size_t i = 0; i < n; i++) {
        double at = ((double)i + chance()) / (double)n * area;
        size_t t = (size_t)(std::upper_bound(until.begin(), until.end(), at) - until.begin());
        t = std::min(t, until.size() - 1);
        double u = chance(), v = chance();
        if (u + v > 1) u = 1 - u, v = 1 - v;
        vec p;
        for (int k = 0; k < 3; k++) {
            double a = c.at[c.triangle[t][0]][k], b = c.at[c.triangle[t][1]][k];
            p[k] = a + u * (b - a) + v * (c.at[c.triangle[t][2]][k] - a);
        }
        out.at.push_back(p), out.normal.push_back(normal[t]);
    }
    write_ply(to, out);
}

/* In strips, as an aeroplane flies; a third of the points are in trees; 0.6 between points. */
static void terrain(size_t n, const char *to) {
    cloud c;
    double side = 0.6 * std::sqrt((double)n);
    for (size_t i = 0; i < n; i++) {
        double at = 20 * (double)i / (double)n;
        double x = side * (std::floor(at) + chance()) / 20, y = side * (at - std::floor(at));
        double tree = std::sin(x / 3) * std::sin(y / 2.5);
        double z = 30 * std::sin(x / 400) * std::cos(y / 300);
        if (tree > 0.5 && i % 3) z += 15 * chance() * tree;
        c.at.push_back({x, y, z});
    }
    write_ply(to, c);
}

static std::array<vec, 2> box_of(const cloud &c) {
    vec low = {INFINITY, INFINITY, INFINITY}, high = {-INFINITY, -INFINITY, -INFINITY};
    for (const vec &p : c.at)
        for (int k = 0; k < 3; k++) {
            low[k] = std::min(low[k], p[k]);
            high[k] = std::max(high[k], p[k]);
        }
    return {low, high};
}
static void box(const char *path) {
    cloud c = read_ply(path);
    for (const vec &v : box_of(c))
        for (double x : v) printf("%.17g ", x);
    printf("%zu %zu\n", c.at.size(), c.triangle.size());
}
static void centre(const char *path, const char *to) {
    cloud c = read_ply(path);
    auto [low, high] = box_of(c);
    for (vec &p : c.at)
        for (int k = 0; k < 3; k++) p[k] -= (low[k] + high[k]) / 2;
    write_ply(to, c);
}

int main(int argc, char **argv) {
    std::string what = argc > 1 ? argv[1] : "";
    auto length = [&](int i) { return strtod(argv[i], nullptr); };
    if (what == "points" && (argc == 4 || argc == 5))
        points(argv[2], argv[3], argc == 5 ? length(4) : 0);
    else if (what == "cells" && argc == 9)
        cells({length(2), length(3), length(4)}, length(5), argv + 6);
    else if (what == "surface" && argc == 4)
        surface(argv[2], argv[3]);
    else if (what == "sample" && argc == 5)
        sample(argv[2], (size_t)length(3), argv[4]);
    else if (what == "terrain" && argc == 4)
        terrain((size_t)length(2), argv[3]);
    else if (what == "centre" && argc == 4)
        centre(argv[2], argv[3]);
    else if (what == "box" && argc == 3)
        box(argv[2]);
    else
        return 64;
    return 0;
}
