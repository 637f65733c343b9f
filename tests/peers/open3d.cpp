/* open3d: Open3D.
 *
 * open3d grid CELL IN.ply OUT.ply        VoxelDownSample: the mean of the points in a cell
 * open3d farthest N IN.ply OUT.ply       FarthestPointDownSample: N points, each the farthest
 * open3d poisson N MESH.ply OUT.ply      SamplePointsPoissonDisk of a mesh
 * open3d quadric N MESH.ply OUT.ply      SimplifyQuadricDecimation to N triangles
 */
#include "tests/peers/ply.hpp"
#include <open3d/geometry/PointCloud.h>
#include <open3d/geometry/TriangleMesh.h>
#include <open3d/utility/Logging.h>

using open3d::geometry::PointCloud;
using open3d::geometry::TriangleMesh;

static peers::cloud of(const std::vector<Eigen::Vector3d> &points) {
    peers::cloud c;
    for (const auto &p : points) c.at.push_back({p[0], p[1], p[2]});
    return c;
}

int main(int argc, char **argv) {
    if (argc != 5) return 64;
    std::string what = argv[1];
    double number = strtod(argv[2], nullptr);
    open3d::utility::SetVerbosityLevel(open3d::utility::VerbosityLevel::Error);
    peers::cloud in = peers::read_ply(argv[3]), out;
    std::vector<Eigen::Vector3d> at;
    std::vector<Eigen::Vector3i> index;
    for (const auto &p : in.at) at.emplace_back(p[0], p[1], p[2]);
    for (const auto &t : in.triangle) index.emplace_back((int)t[0], (int)t[1], (int)t[2]);
    if (what == "grid") {
        out = of(PointCloud(at).VoxelDownSample(number)->points_);
    } else if (what == "farthest") {
        out = of(PointCloud(at).FarthestPointDownSample((size_t)number)->points_);
    } else if (what == "poisson") {
        out = of(TriangleMesh(at, index).SamplePointsPoissonDisk((size_t)number)->points_);
    } else if (what == "quadric") {
        TriangleMesh m(at, index);
        m.RemoveDuplicatedVertices();
        auto s = m.SimplifyQuadricDecimation((int)number, INFINITY, 1.0);
        out = of(s->vertices_);
        for (const auto &t : s->triangles_)
            out.triangle.push_back({(uint32_t)t[0], (uint32_t)t[1], (uint32_t)t[2]});
    } else {
        return 64;
    }
    peers::write_ply(argv[4], out);
    return 0;
}
