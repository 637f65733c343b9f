/* nearest.hpp: the nearest of many triangles, exactly but for rounding: a tree of boxes. Points are
 * triangles whose corners are one. */
#ifndef PEERS_NEAREST_HPP
#define PEERS_NEAREST_HPP

#include "tests/peers/ply.hpp"
#include <algorithm>
#include <cmath>
#include <cstddef>

namespace peers {

using corners = std::array<vec, 3>;

inline vec sub(const vec &a, const vec &b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
inline double dot(const vec &a, const vec &b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline vec cross(const vec &a, const vec &b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

inline double segment_d2(const vec &p, const vec &a, const vec &b) {
    vec d = sub(b, a), e = sub(p, a);
    double l = dot(d, d), t = l > 0 ? std::clamp(dot(d, e) / l, 0.0, 1.0) : 0;
    for (int k = 0; k < 3; k++) e[k] -= t * d[k];
    return dot(e, e);
}
inline double triangle_d2(const vec &p, const corners &t) {
    vec n = cross(sub(t[1], t[0]), sub(t[2], t[0]));
    double area = dot(n, n);
    bool inside = area > 0;
    for (int k = 0; k < 3 && inside; k++)
        inside = dot(cross(sub(t[(k + 1) % 3], t[k]), sub(p, t[k])), n) >= 0;
    if (inside) {
        double h = dot(sub(p, t[0]), n);
        return h * h / area;
    }
    double best = segment_d2(p, t[0], t[1]);
    if (t[0] == t[1] && t[1] == t[2]) return best;
    return std::min({best, segment_d2(p, t[1], t[2]), segment_d2(p, t[2], t[0])});
}

class nearest {
  public:
    explicit nearest(std::vector<corners> all) : set(std::move(all)), order(set.size()) {
        for (size_t i = 0; i < order.size(); i++) order[i] = (uint32_t)i;
        if (!order.empty()) build(0, order.size());
    }
    static nearest of_points(const std::vector<vec> &at, size_t count) {
        std::vector<corners> set(std::min(count, at.size()));
        for (size_t i = 0; i < set.size(); i++) set[i] = {at[i], at[i], at[i]};
        return nearest(std::move(set));
    }
    static nearest of_mesh(const cloud &c) {
        std::vector<corners> set;
        for (const auto &t : c.triangle) set.push_back({c.at[t[0]], c.at[t[1]], c.at[t[2]]});
        return nearest(std::move(set));
    }
    /* The square of the distance to the nearest for which skip(number) is not true, or `within` if
     * none is nearer than that. */
    template <class Skip> double d2(const vec &p, const Skip &skip, double within) const {
        if (!nodes.empty()) visit(0, p, skip, within, nullptr);
        return within;
    }
    double d2(const vec &p) const {
        return d2(
            p, [](size_t) { return false; }, INFINITY);
    }
    /* The number of the nearest. */
    size_t number(const vec &p) const {
        size_t which = 0;
        double best = INFINITY;
        if (!nodes.empty())
            visit(
                0, p, [](size_t) { return false; }, best, &which);
        return which;
    }

  private:
    struct node {
        vec low, high;
        uint32_t begin, end, right; /* right 0: a leaf; the left child is the next node */
    };
    std::vector<corners> set;
    std::vector<uint32_t> order;
    std::vector<node> nodes;

    size_t build(size_t begin, size_t end) {
        node n{{INFINITY, INFINITY, INFINITY},
               {-INFINITY, -INFINITY, -INFINITY},
               (uint32_t)begin,
               (uint32_t)end,
               0};
        for (size_t i = begin; i < end; i++)
            for (const vec &c : set[order[i]])
                for (int k = 0; k < 3; k++)
                    n.low[k] = std::min(n.low[k], c[k]), n.high[k] = std::max(n.high[k], c[k]);
        size_t at = nodes.size();
        nodes.push_back(n);
        if (end - begin <= 4) return at;
        int axis = 0;
        for (int k = 1; k < 3; k++)
            if (n.high[k] - n.low[k] > n.high[axis] - n.low[axis]) axis = k;
        size_t middle = (begin + end) / 2;
        auto key = [&](uint32_t i) { return set[i][0][axis] + set[i][1][axis] + set[i][2][axis]; };
        std::nth_element(order.begin() + (std::ptrdiff_t)begin,
                         order.begin() + (std::ptrdiff_t)middle,
                         order.begin() + (std::ptrdiff_t)end,
                         [&](uint32_t a, uint32_t b) { return key(a) < key(b); });
        build(begin, middle);
        size_t right = build(middle, end);
        nodes[at].right = (uint32_t)right;
        return at;
    }
    static double box_d2(const node &n, const vec &p) {
        double s = 0;
        for (int k = 0; k < 3; k++) {
            double d = std::max({n.low[k] - p[k], 0.0, p[k] - n.high[k]});
            s += d * d;
        }
        return s;
    }
    template <class Skip>
    void visit(size_t at, const vec &p, const Skip &skip, double &best, size_t *which) const {
        const node &n = nodes[at];
        if (!n.right) {
            for (size_t i = n.begin; i < n.end; i++) {
                double d = triangle_d2(p, set[order[i]]);
                if (d < best && !skip(order[i])) {
                    best = d;
                    if (which) *which = order[i];
                }
            }
            return;
        }
        size_t child[2] = {at + 1, n.right};
        double d[2] = {box_d2(nodes[child[0]], p), box_d2(nodes[child[1]], p)};
        int first = d[1] < d[0];
        if (d[first] < best) visit(child[first], p, skip, best, which);
        if (d[!first] < best) visit(child[!first], p, skip, best, which);
    }
};

} // namespace peers
#endif
