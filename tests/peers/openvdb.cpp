/* openvdb: OpenVDB's distances of voxels from a mesh.
 *
 * openvdb X Y Z SIDE REACH MESH.ply OUT.vdb [MIDDLES.ply]
 *     Voxels of the given side, of which one has its lower corner at X, Y, Z, whose middle is at
 *     most REACH voxels from a triangle. OUT.vdb: the set alone, as the library packs it. MIDDLES:
 *     to be measured; not a part of what is timed.
 */
#include "tests/peers/ply.hpp"
#include <openvdb/openvdb.h>
#include <openvdb/tools/MeshToVolume.h>

int main(int argc, char **argv) {
    if (argc != 8 && argc != 9) return 64;
    double low[3], side = strtod(argv[4], nullptr);
    for (int k = 0; k < 3; k++) low[k] = strtod(argv[1 + k], nullptr);
    float reach = strtof(argv[5], nullptr);
    peers::cloud in = peers::read_ply(argv[6]);
    std::vector<openvdb::Vec3s> at; /* in voxels, whose middles are whole numbers */
    std::vector<openvdb::Vec3I> index;
    for (const auto &p : in.at) {
        float v[3];
        for (int k = 0; k < 3; k++) v[k] = (float)((p[k] - low[k]) / side - 0.5);
        at.emplace_back(v[0], v[1], v[2]);
    }
    for (const auto &t : in.triangle) index.emplace_back(t[0], t[1], t[2]);
    openvdb::initialize();
    openvdb::tools::QuadAndTriangleDataAdapter<openvdb::Vec3s, openvdb::Vec3I> mesh(at, index);
    auto identity = openvdb::math::Transform::createLinearTransform(1.0);
    auto distance = openvdb::tools::meshToVolume<openvdb::FloatGrid>(
        mesh, *identity, reach + 0.01f, reach + 0.01f, openvdb::tools::UNSIGNED_DISTANCE_FIELD);
    auto set = openvdb::MaskGrid::create();
    auto out = set->getAccessor();
    for (auto v = distance->cbeginValueOn(); v; ++v)
        if (*v <= reach) out.setValueOn(v.getCoord());
    openvdb::io::File(argv[7]).write({set});
    if (argc == 9) {
        peers::cloud c;
        for (auto v = set->cbeginValueOn(); v; ++v) {
            peers::vec p;
            for (int k = 0; k < 3; k++) p[k] = low[k] + (v.getCoord()[k] + 0.5) * side;
            c.at.push_back(p);
        }
        peers::write_ply(argv[8], c);
    }
    return 0;
}
