/* cgal: CGAL, packages Point Set Processing, Polygon Mesh Processing, Surface Mesh Simplification.
 *
 * cgal grid CELL IN.ply OUT.ply       one point of each cell of a grid
 * cgal hierarchy SIZE IN.ply OUT.ply  clusters of at most SIZE points, a point for each
 * cgal wlop SHARE IN.ply OUT.ply      weighted locally optimal projection, SHARE per cent of them
 * cgal random N MESH.ply OUT.ply      random points of a mesh, by area
 * cgal collapse SHARE MESH.ply OUT.ply  edges collapsed (Lindstrom-Turk) until SHARE of them are
 *                                     left; a mesh must be manifold, and is made so first
 */
#include "tests/peers/ply.hpp"
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/distance.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/repair_polygon_soup.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Count_ratio_stop_predicate.h>
#include <CGAL/Surface_mesh_simplification/edge_collapse.h>
#include <CGAL/grid_simplify_point_set.h>
#include <CGAL/hierarchy_simplify_point_set.h>
#include <CGAL/wlop_simplify_and_regularize_point_set.h>

using kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using point = kernel::Point_3;
using mesh = CGAL::Surface_mesh<point>;
namespace processing = CGAL::Polygon_mesh_processing;

static std::vector<point> points_of(const peers::cloud &c) {
    std::vector<point> out;
    for (const auto &p : c.at) out.emplace_back(p[0], p[1], p[2]);
    return out;
}
static void write(const char *path, const std::vector<point> &points) {
    peers::cloud c;
    for (const point &p : points) c.at.push_back({p.x(), p.y(), p.z()});
    peers::write_ply(path, c);
}

static mesh mesh_of(const peers::cloud &c) {
    std::vector<point> points = points_of(c);
    std::vector<std::vector<size_t>> polygons;
    for (const auto &t : c.triangle) polygons.push_back({t[0], t[1], t[2]});
    processing::repair_polygon_soup(points, polygons);
    processing::orient_polygon_soup(points, polygons);
    mesh m;
    processing::polygon_soup_to_polygon_mesh(points, polygons, m);
    return m;
}
static void write(const char *path, mesh &m) {
    peers::cloud c;
    m.collect_garbage();
    for (auto v : m.vertices()) {
        const point &p = m.point(v);
        c.at.push_back({p.x(), p.y(), p.z()});
    }
    for (auto f : m.faces()) {
        std::array<uint32_t, 3> t{};
        int k = 0;
        for (auto v : m.vertices_around_face(m.halfedge(f))) t[(size_t)k++ % 3] = (uint32_t)v.idx();
        c.triangle.push_back(t);
    }
    peers::write_ply(path, c);
}

int main(int argc, char **argv) {
    if (argc != 5) return 64;
    std::string what = argv[1];
    double number = strtod(argv[2], nullptr);
    peers::cloud in = peers::read_ply(argv[3]);
    if (what == "collapse") {
        mesh m = mesh_of(in);
        namespace simplification = CGAL::Surface_mesh_simplification;
        simplification::edge_collapse(m, simplification::Count_ratio_stop_predicate<mesh>(number));
        write(argv[4], m);
        return 0;
    }
    std::vector<point> points = points_of(in), out;
    if (what == "grid") {
        points.erase(CGAL::grid_simplify_point_set(points, number), points.end());
        out = points;
    } else if (what == "hierarchy") {
        points.erase(CGAL::hierarchy_simplify_point_set(
                         points, CGAL::parameters::size((unsigned)number).maximum_variation(0.33)),
                     points.end());
        out = points;
    } else if (what == "wlop") {
        CGAL::wlop_simplify_and_regularize_point_set<CGAL::Sequential_tag>(
            points, std::back_inserter(out), CGAL::parameters::select_percentage(number));
    } else if (what == "random") {
        processing::sample_triangle_soup(
            points, in.triangle, std::back_inserter(out),
            CGAL::parameters::number_of_points_on_faces((unsigned)number)
                .do_sample_vertices(false)
                .do_sample_edges(false));
    } else {
        return 64;
    }
    write(argv[4], out);
    return 0;
}
