/* meshoptimizer: its simplifiers.
 *
 * meshoptimizer simplify ERROR MESH.ply OUT.ply  keeps the topology; ERROR is a length
 * meshoptimizer sloppy ERROR MESH.ply OUT.ply    does not
 * meshoptimizer points N IN.ply OUT.ply          N of the points
 */
#include "tests/peers/ply.hpp"
#include <meshoptimizer.h>

static peers::cloud keep(const peers::cloud &in, const std::vector<unsigned> &index) {
    std::vector<uint32_t> number(in.at.size(), UINT32_MAX);
    peers::cloud out;
    for (size_t i = 0; i < index.size(); i++) {
        unsigned v = index[i];
        if (number[v] == UINT32_MAX) {
            number[v] = (uint32_t)out.at.size();
            out.at.push_back(in.at[v]);
            if (!in.normal.empty()) out.normal.push_back(in.normal[v]);
        }
        if (i % 3 == 0 && !in.triangle.empty()) out.triangle.push_back({});
        if (!in.triangle.empty()) out.triangle.back()[i % 3] = number[v];
    }
    return out;
}

int main(int argc, char **argv) {
    if (argc != 5) return 64;
    std::string what = argv[1];
    double number = strtod(argv[2], nullptr);
    peers::cloud in = peers::read_ply(argv[3]);
    std::vector<float> at;
    std::vector<unsigned> index, out;
    for (const auto &p : in.at)
        for (double x : p) at.push_back((float)x);
    for (const auto &t : in.triangle) index.insert(index.end(), t.begin(), t.end());
    size_t vertices = in.at.size(), stride = 3 * sizeof(float), count;
    float scale = meshopt_simplifyScale(at.data(), vertices, stride), error = 0;
    float target = (float)(number / scale);
    if (what == "simplify") {
        out.resize(index.size());
        count = meshopt_simplify(out.data(), index.data(), index.size(), at.data(), vertices,
                                 stride, 0, target, 0, &error);
    } else if (what == "sloppy") {
        out.resize(index.size());
        count = meshopt_simplifySloppy(out.data(), index.data(), index.size(), at.data(), vertices,
                                       stride, 0, target, &error);
    } else if (what == "points") {
        out.resize((size_t)number);
        count = meshopt_simplifyPoints(out.data(), at.data(), vertices, stride, (size_t)number);
    } else {
        return 64;
    }
    out.resize(count);
    peers::write_ply(argv[4], keep(in, out));
    return 0;
}
