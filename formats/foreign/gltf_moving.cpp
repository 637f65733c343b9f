/* gltf_moving.cpp: the nodes that an animation moves: their surfels cannot be merged with those of
 * what stands still (paper 1, section 3.4). Exporters write channels for every node of a scene,
 * most of which only repeat where the node is; those do not count. */
#include "formats/foreign/gltf.hpp"
#include <algorithm>
#include <cmath>

namespace pbs::gltf {

/* Where a node stands without animation. */
static void rest_pose(const document &doc, const node_entry &n, int path, double out[4]) {
    static const double otherwise[3][4] = {{0, 0, 0, 0}, {0, 0, 0, 1}, {1, 1, 1, 0}};
    std::copy(otherwise[path], otherwise[path] + 4, out);
    uint32_t at = n.numbers;
    for (int p = 0; p < path; p++)
        if (n.has >> p & 1) at += path_numbers[p];
    for (uint32_t k = 0; (n.has >> path & 1) && k < path_numbers[path]; k++)
        out[k] = doc.numbers[at + k];
}

/* Keyframes are floats (or less), and the text may have fewer digits. */
static bool differs(const double *key, const double *rest, int n, double sign) {
    double largest = 0;
    for (int k = 0; k < n; k++) largest = std::max(largest, std::fabs(rest[k]));
    for (int k = 0; k < n; k++)
        if (!(std::fabs(sign * key[k] - rest[k]) <= largest * 0x1p-22)) return true;
    return false;
}

/* True if the channel ever shows another pose, or cannot be read: then nothing is known. */
bool reader::moves(const channel_entry &c) {
    const node_entry &n = doc_.nodes[(size_t)c.node];
    if (n.has >> MATRIX & 1 || c.output < 0) return true;
    forget_views();
    stream s = open_stream(c.output);
    int numbers = (int)path_numbers[c.path];
    if (s.components != numbers) return true;
    double rest[4], key[4], still[4] = {0, 0, 0, 0};
    rest_pose(doc_, n, c.path, rest);
    for (uint64_t i = 0; i < s.count; i++) {
        if (i % 65536 == 0) check(pbs_run_check(run_, err_));
        s.get(i, key);
        /* Splines have a tangent before and behind each value. */
        const double *want = c.cubic && i % 3 != 1 ? still : rest;
        bool turned = c.path == ROTATION && want == rest; /* q and -q are one rotation */
        if (differs(key, want, numbers, 1) && !(turned && !differs(key, want, numbers, -1)))
            return true;
    }
    return false;
}

void reader::mark_moving() {
    moves_.assign(doc_.nodes.size(), 0);
    for (const channel_entry &c : doc_.channels) {
        if ((size_t)c.node >= moves_.size() || moves_[(size_t)c.node]) continue;
        pbs_err before = *err_;
        try {
            moves_[(size_t)c.node] = moves(c);
        } catch (const failure &e) {
            /* A file that only lacks its animation's data is still a scene. */
            if (e.code != PBS_DATA) throw;
            *err_ = before;
            moves_[(size_t)c.node] = 1;
        }
    }
}

} // namespace pbs::gltf
