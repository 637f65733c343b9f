/* mend_soup.cpp: what is done to a soup of triangles before CGAL sees it: points are found, copies
 * dropped, and edges of more than two triangles taken apart where the file says how. */
#include "formats/foreign/mend.hpp"
#include <algorithm>
#include <cstring>
#include <numeric>
#include <unordered_map>

namespace pbs::mend {

/* ---- points ---- */

struct key {
    uint32_t bits[3];
    bool operator==(const key &o) const { return !memcmp(bits, o.bits, sizeof bits); }
};
struct key_hash {
    size_t operator()(const key &k) const {
        uint64_t h = 0x9e3779b97f4a7c15u;
        for (uint32_t b : k.bits) {
            h = (h ^ b) * 0xd6e8feb86659fd93u;
            h ^= h >> 32;
        }
        return h;
    }
};

soup weld(pbs_mend_job *job) {
    soup s;
    std::unordered_map<key, uint32_t, key_hash> known;
    known.reserve(job->triangles / 2 + 16);
    s.polygons.reserve(job->triangles);
    for (uint32_t t = 0; t < job->triangles; t++) {
        polygon p;
        p.source = t;
        for (size_t c = 0; c < 3; c++) {
            std::array<float, 3> at;
            for (size_t k = 0; k < 3; k++) at[k] = job->position[9 * (size_t)t + 3 * c + k] + 0.0f;
            key bits;
            memcpy(bits.bits, at.data(), sizeof bits.bits);
            auto found = known.try_emplace(bits, (uint32_t)s.points.size());
            if (found.second) s.points.push_back(at);
            p[c] = found.first->second;
        }
        if (p[0] == p[1] || p[1] == p[2] || p[2] == p[0])
            job->fate[t] = PBS_MEND_DEGENERATE;
        else
            s.polygons.push_back(p);
    }
    return s;
}

/* ---- edges ---- */

std::vector<side> sides_of(const std::vector<polygon> &polygons) {
    std::vector<side> sides;
    sides.reserve(3 * polygons.size());
    for (uint32_t i = 0; i < polygons.size(); i++)
        for (uint8_t c = 0; c < 3; c++) {
            uint32_t a = polygons[i][c], b = polygons[i][(c + 1u) % 3];
            sides.push_back({std::min(a, b), std::max(a, b), i, c, a > b});
        }
    std::sort(sides.begin(), sides.end(), [](const side &a, const side &b) {
        return a.low != b.low     ? a.low < b.low
               : a.high != b.high ? a.high < b.high
                                  : a.polygon < b.polygon;
    });
    return sides;
}

bool is_closed(const std::vector<side> &sides) {
    bool closed = !sides.empty();
    for_edges(sides, [&](const side *e, const side *end) {
        long up = 0;
        for (; e < end; e++) up += e->descending ? -1 : 1;
        closed = closed && !up;
    });
    return closed;
}

/* Whether no edge of two polygons is passed the same way by both. */
static bool is_trusted(const std::vector<side> &sides) {
    bool trusted = true;
    for_edges(sides, [&](const side *e, const side *end) {
        trusted = trusted && (end - e != 2 || e[0].descending != e[1].descending);
    });
    return trusted;
}

class sets { /* disjoint ones, of numbers */
  public:
    explicit sets(size_t n) : up_(n) { std::iota(up_.begin(), up_.end(), 0u); }
    uint32_t find(uint32_t i) {
        while (up_[i] != i) i = up_[i] = up_[up_[i]];
        return i;
    }
    /* The smallest number of a set stands for it. */
    void join(uint32_t a, uint32_t b) {
        a = find(a), b = find(b);
        up_[std::max(a, b)] = std::min(a, b);
    }

  private:
    std::vector<uint32_t> up_;
};

/* ---- duplicates ---- */

static std::array<uint32_t, 3> sorted(const polygon &p) {
    std::array<uint32_t, 3> s = p;
    std::sort(s.begin(), s.end());
    return s;
}

/* Whether it runs through its points in the order of an even permutation of the sorted ones. */
static bool is_even(const polygon &p) {
    return (p[0] < p[1]) + (p[1] < p[2]) + (p[2] < p[0]) == 2;
}

/* Of each set of copies: the first, and the one that is kept with it as the other side of a wall:
 * one that is wound the other way, if there is one. Twin PBS_NONE: no copy. */
struct copies {
    std::vector<uint32_t> first, twin;
};

static copies find_copies(const soup &s) {
    copies c;
    std::vector<std::pair<std::array<uint32_t, 3>, uint32_t>> order;
    for (uint32_t i = 0; i < s.polygons.size(); i++) order.push_back({sorted(s.polygons[i]), i});
    std::sort(order.begin(), order.end());
    for (size_t i = 0, end; i < order.size(); i = end) {
        uint32_t first = order[i].second, twin = PBS_NONE;
        for (end = i + 1; end < order.size() && order[end].first == order[i].first; end++) {
            uint32_t p = order[end].second;
            bool turned = is_even(s.polygons[p]) != is_even(s.polygons[first]);
            if (twin == PBS_NONE ||
                (turned && is_even(s.polygons[twin]) == is_even(s.polygons[first])))
                twin = p;
        }
        c.first.push_back(first);
        c.twin.push_back(twin);
    }
    return c;
}

/* A patch of polygons with copies is a wall if most edges around it have an odd number of polygons,
 * three or more, when each counts once: two solids, each of which lacks a side. */
static std::vector<bool> find_walls(const std::vector<polygon> &once,
                                    const std::vector<uint32_t> &twin) {
    sets patch(once.size());
    std::vector<long> votes(once.size());
    std::vector<side> sides = sides_of(once);
    auto copied = [&](const side &e) { return twin[e.polygon] != PBS_NONE; };
    for_edges(sides, [&](const side *begin, const side *end) {
        const side *one = std::find_if(begin, end, copied);
        for (const side *e = one; e < end; e++)
            if (copied(*e)) patch.join(one->polygon, e->polygon);
    });
    for_edges(sides, [&](const side *begin, const side *end) {
        long n = end - begin, many = std::count_if(begin, end, copied);
        if (!many || (many == n && n > 1)) return;
        for (const side *e = begin; e < end; e++)
            if (copied(*e)) votes[patch.find(e->polygon)] += n > 2 && n % 2 ? 1 : -1;
    });
    std::vector<bool> wall(once.size());
    for (uint32_t i = 0; i < once.size(); i++)
        wall[i] = twin[i] != PBS_NONE && votes[patch.find(i)] > 0;
    return wall;
}

/* Where windings can be trusted, a copy that is wound the other way is another side. */
static std::vector<bool> find_sides(const soup &s, const copies &c) {
    std::vector<bool> side(c.first.size());
    for (size_t i = 0; i < side.size(); i++)
        side[i] = c.twin[i] != PBS_NONE &&
                  is_even(s.polygons[c.first[i]]) != is_even(s.polygons[c.twin[i]]);
    return side;
}

void drop_duplicates(soup *s, pbs_mend_job *job) {
    copies c = find_copies(*s);
    if (c.first.size() == s->polygons.size()) return;
    std::vector<polygon> once;
    for (uint32_t i : c.first) once.push_back(s->polygons[i]);
    bool closed = job->counts[PBS_MEND_CLOSED_BEFORE],
         trusted = closed || is_trusted(sides_of(once));
    std::vector<bool> two = trusted ? find_sides(*s, c) : find_walls(once, c.twin);
    std::vector<bool> keep(s->polygons.size());
    for (size_t i = 0; i < once.size(); i++) {
        keep[c.first[i]] = true;
        if (two[i]) keep[c.twin[i]] = true;
    }
    std::vector<polygon> left;
    for (size_t i = 0; i < keep.size(); i++)
        if (keep[i]) left.push_back(s->polygons[i]);
    if (closed && !is_closed(sides_of(left))) return;
    for (size_t i = 0; i < keep.size(); i++)
        if (!keep[i]) job->fate[s->polygons[i].source] = PBS_MEND_DUPLICATE;
    s->polygons = std::move(left);
}

/* ---- edges of more than two ---- */

/* As brackets: those that pass the other way close the nearest that is open. */
static void pair_by_winding(const side *begin, const side *end, std::vector<seam> *out) {
    std::vector<side> open;
    for (const side *e = begin; e < end; e++) {
        if (!open.empty() && open.back().descending != e->descending) {
            out->push_back({open.back(), *e});
            open.pop_back();
        } else
            open.push_back(*e);
    }
}

static void pair_by_order(const side *begin, const side *end, std::vector<seam> *out) {
    if ((end - begin) % 2) return;
    for (const side *e = begin; e + 2 < end; e += 2)
        if (e[2].polygon - e[1].polygon <=
            std::max(e[1].polygon - e[0].polygon, e[3].polygon - e[2].polygon))
            return;
    for (const side *e = begin; e < end; e += 2) out->push_back({e[0], e[1]});
}

std::vector<seam> find_seams(const std::vector<side> &sides, pbs_mend_job *job) {
    std::vector<seam> seams;
    bool trusted = is_trusted(sides);
    for_edges(sides, [&](const side *e, const side *end) {
        if (end - e == 2) seams.push_back({e[0], e[1]});
        if (end - e < 3) return;
        job->counts[PBS_MEND_NONMANIFOLD_EDGES]++;
        (trusted ? pair_by_winding : pair_by_order)(e, end, &seams);
    });
    return seams;
}

void split_vertices(soup *s, const std::vector<seam> &seams, std::vector<uint32_t> *point) {
    sets fan(3 * s->polygons.size());
    auto corner = [](const side &e, bool high) {
        return 3 * e.polygon + (e.corner + (e.descending != high)) % 3u;
    };
    for (const seam &m : seams)
        for (bool high : {false, true}) fan.join(corner(m.a, high), corner(m.b, high));
    std::vector<uint32_t> vertex(3 * s->polygons.size());
    for (uint32_t i = 0; i < vertex.size(); i++) {
        uint32_t first = fan.find(i);
        if (first == i) {
            vertex[i] = (uint32_t)point->size();
            point->push_back(s->polygons[i / 3][i % 3]);
        }
        s->polygons[i / 3][i % 3] = vertex[first];
        vertex[i] = vertex[first];
    }
}

} // namespace pbs::mend
