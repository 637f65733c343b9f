/* mend.cpp: the module "mend": CGAL's polygon mesh processing makes of a soup of triangles a mesh
 * that is oriented, stitched, and outward.
 *
 * CGAL's package is GPL-3+, so this module as it is built is, too.
 *
 * Open surfaces have no outside by themselves. Theirs is the side from which more rays escape, or
 * if as many do, go further: Takayama, Jacobson, Kavan, Sorkine-Hornung, "A Simple Method for
 * Correcting Facet Orientations in Polygon Meshes Based on Ray Casting", JCGT 3(4), 2014. */
#define CGAL_HOLE_FILLING_DO_NOT_USE_DT3
#define CGAL_HOLE_FILLING_DO_NOT_USE_CDT2
#include "formats/foreign/mend.hpp"
#include "libcore/data/rng.h"
#include <CGAL/AABB_face_graph_triangle_primitive.h>
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/connected_components.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Polygon_mesh_processing/stitch_borders.h>
#include <CGAL/Polygon_mesh_processing/triangulate_hole.h>
#include <CGAL/Surface_mesh.h>
#include <algorithm>
#include <boost/iterator/function_output_iterator.hpp>
#include <cmath>
#include <cstring>
#include <string>

namespace pbs::mend {

namespace PMP = CGAL::Polygon_mesh_processing;
using kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using point = kernel::Point_3;
using mesh = CGAL::Surface_mesh<point>;
using face = mesh::Face_index;
using halfedge = mesh::Halfedge_index;
using vertex = mesh::Vertex_index;

/* Measured at its peak, with all options on. */
static const size_t per_triangle = 800;
/* Rays for each connected surface, from each side. */
static const uint32_t ray_count = 128, fewest_rays = 16;
static const size_t all_rays = 100000; /* of a part; surfaces beyond stay as most of them is */

static point position(const pbs_mend_job *job, size_t corner) {
    const float *p = job->position + 3 * corner;
    return point(p[0] + 0.0f, p[1] + 0.0f, p[2] + 0.0f);
}

/* Three points of each face, in its order. */
static std::array<vertex, 3> corners(const mesh &m, face f) {
    halfedge h = m.halfedge(f);
    return {m.source(h), m.target(h), m.target(m.next(h))};
}

/* ---- from a soup to a mesh ---- */

static void drop_flat(soup *s, pbs_mend_job *job) {
    size_t n = 0;
    for (const polygon &p : s->polygons) {
        size_t at = 3 * (size_t)p.source;
        if (CGAL::collinear(position(job, at), position(job, at + 1), position(job, at + 2)))
            job->fate[p.source] = PBS_MEND_DEGENERATE;
        else
            s->polygons[n++] = p;
    }
    s->polygons.resize(n);
}

/* A vertex has the same position as the corners that it stands for; faces are the polygons. */
static mesh build(const std::vector<point> &points, const std::vector<polygon> &polygons,
                  pbs_err *err) {
    mesh m;
    m.reserve((uint32_t)points.size(), (uint32_t)(2 * polygons.size()), (uint32_t)polygons.size());
    for (const point &p : points) m.add_vertex(p);
    for (const polygon &p : polygons)
        if (m.add_face(vertex(p[0]), vertex(p[1]), vertex(p[2])) == mesh::null_face())
            fail(err, PBS_DATA, "CGAL made no surface of it");
    return m;
}

/* Whether a face runs the other way round than the triangle that it comes from. */
static bool is_flipped(const pbs_mend_job *job, const mesh &m, face f, uint32_t source) {
    std::array<vertex, 3> v = corners(m, f);
    size_t at = 3 * (size_t)source, i = 0;
    while (i < 2 && position(job, at + i) != m.point(v[0])) i++;
    return position(job, at + (i + 1) % 3) != m.point(v[1]);
}

/* ---- components ---- */

struct components {
    mesh::Property_map<face, size_t> of;
    size_t count;
    std::vector<bool> closed;
    std::vector<double> area;
};

static double area(const mesh &m, face f) {
    std::array<vertex, 3> v = corners(m, f);
    return std::sqrt(CGAL::squared_area(m.point(v[0]), m.point(v[1]), m.point(v[2])));
}

static components find_components(mesh &m) {
    components c;
    c.of = m.add_property_map<face, size_t>("f:component", 0).first;
    c.count = PMP::connected_components(m, c.of);
    c.closed.assign(c.count, true);
    c.area.assign(c.count, 0);
    for (halfedge h : m.halfedges())
        if (m.is_border(h)) c.closed[c.of[m.face(m.opposite(h))]] = false;
    for (face f : m.faces()) c.area[c.of[f]] += area(m, f);
    return c;
}

/* ---- holes ---- */

/* The border around a flat sheet is no hole: what would fill it lies upon the sheet. */
static bool is_filling(const mesh &m, const std::vector<face> &patch, double whole) {
    double sum = 0;
    for (face f : patch) sum += area(m, f);
    return !patch.empty() && sum < 0.9 * whole;
}

static void fill_hole(pbs_mend_job *job, mesh &m, const components &c, halfedge border) {
    size_t edges = 0, component = c.of[m.face(m.opposite(border))];
    for (halfedge h : CGAL::halfedges_around_face(border, m)) edges += h.is_valid();
    if (edges > job->fill) return;
    std::vector<face> patch;
    PMP::triangulate_hole(m, border, std::back_inserter(patch));
    if (is_filling(m, patch, c.area[component])) {
        job->counts[PBS_MEND_HOLES_FILLED]++;
        return;
    }
    for (face f : patch) CGAL::Euler::remove_face(m.halfedge(f), m);
}

static void fill_holes(pbs_run *run, pbs_mend_job *job, mesh &m, pbs_err *err) {
    std::vector<halfedge> holes;
    PMP::extract_boundary_cycles(m, std::back_inserter(holes));
    job->counts[PBS_MEND_HOLES] = holes.size();
    if (!job->fill || holes.empty()) return;
    components c = find_components(m);
    for (halfedge h : holes) {
        check(pbs_run_check(run, err));
        fill_hole(job, m, c, h);
    }
    m.remove_property_map(c.of);
}

/* ---- rays ---- */

using primitive = CGAL::AABB_face_graph_triangle_primitive<mesh>;
using tree = CGAL::AABB_tree<CGAL::AABB_traits<kernel, primitive>>;

/* A component's faces, to choose from them by area. */
struct surface {
    uint64_t number;
    const mesh *m;
    std::vector<face> faces;
    std::vector<double> sum; /* of the areas up to each */
    double random(uint64_t i) const { return (double)(pbs_random(0, number, i) >> 11) * 0x1p-53; }
    face choose(uint64_t i) const {
        auto at = std::upper_bound(sum.begin(), sum.end(), random(i) * sum.back());
        return faces[std::min((size_t)(at - sum.begin()), faces.size() - 1)];
    }
};

static std::vector<surface> find_surfaces(const mesh &m, const components &c) {
    std::vector<surface> s(c.count);
    for (size_t i = 0; i < c.count; i++) s[i].number = i, s[i].m = &m;
    for (face f : m.faces()) {
        surface &own = s[c.of[f]];
        own.faces.push_back(f);
        own.sum.push_back((own.sum.empty() ? 0 : own.sum.back()) + area(m, f));
    }
    return s;
}

static kernel::Vector_3 random_direction(const surface &s, uint64_t i) {
    double z = 2 * s.random(i) - 1, phi = 2 * M_PI * s.random(i + 1), r = std::sqrt(1 - z * z);
    return kernel::Vector_3(r * std::cos(phi), r * std::sin(phi), z);
}

static point random_point(const surface &s, face f, uint64_t i) {
    std::array<vertex, 3> v = corners(*s.m, f);
    double u = s.random(i), w = s.random(i + 1);
    if (u + w > 1) u = 1 - u, w = 1 - w;
    const point &a = s.m->point(v[0]);
    return a + u * (s.m->point(v[1]) - a) + w * (s.m->point(v[2]) - a);
}

static kernel::Vector_3 normal(const mesh &m, face f) {
    std::array<vertex, 3> v = corners(m, f);
    return CGAL::normal(m.point(v[0]), m.point(v[1]), m.point(v[2]));
}

/* ---- closed surfaces ---- */

/* With sign; 0 if it is none but for rounding, as that of a sheet with two sides. CGAL's own
 * orient_to_bound_a_volume looks at one corner only, and fails where the surface is folded. */
static double volume(const surface &s) {
    double sum = 0, size = 0;
    const point o = s.m->point(corners(*s.m, s.faces[0])[0]);
    for (face f : s.faces) {
        std::array<vertex, 3> v = corners(*s.m, f);
        double d =
            CGAL::determinant(s.m->point(v[0]) - o, s.m->point(v[1]) - o, s.m->point(v[2]) - o);
        sum += d;
        size += std::fabs(d);
    }
    return std::fabs(sum) > 1e-10 * size ? sum : 0;
}

/* Whether it lies within an odd number of other solids, as a cavity does. Asked of points just
 * inside, since solids may touch. */
static bool is_inside_out(const surface &s, const tree &t, const components &c,
                          const std::vector<double> &volumes) {
    int odd = 0;
    for (uint64_t i = 0; i < 8 * 5; i += 8) {
        face f = s.choose(i);
        kernel::Vector_3 n = normal(*s.m, f);
        double length = std::sqrt(n.squared_length());
        n = n * ((volumes[s.number] > 0 ? -1e-6 : 1e-6) / std::sqrt(length));
        kernel::Ray_3 ray(random_point(s, f, i + 1) + n, random_direction(s, i + 3));
        size_t hits = 0;
        t.all_intersected_primitives(ray, boost::make_function_output_iterator([&](face g) {
                                         hits += volumes[c.of[g]] != 0 && c.of[g] != s.number;
                                     }));
        odd += hits % 2;
    }
    return odd > 2;
}

/* ---- open surfaces ---- */

struct votes {
    double front = 0, back = 0;               /* rays that escape */
    double front_length = 0, back_length = 0; /* of the others */
};

static void shoot(const tree &t, face f, const kernel::Ray_3 &ray, double *escaped,
                  double *length) {
    auto hit = t.first_intersection(ray, [&](face g) { return g == f; });
    if (!hit) {
        *escaped += 1;
    } else if (const point *p = boost::get<point>(&hit->first)) {
        *length += std::sqrt(CGAL::squared_distance(ray.source(), *p));
    }
}

/* Whether a surface looks better turned round. Undecided: as most of its area was in the file. */
static bool should_turn(const votes &v, double rays, double area_flipped, double area_kept) {
    if (std::fabs(v.front - v.back) > rays / 8) return v.front < v.back;
    double length = v.front_length + v.back_length;
    if (std::fabs(v.front_length - v.back_length) > length / 4)
        return v.front_length < v.back_length;
    return area_flipped > area_kept;
}

static bool is_seen_from_behind(const pbs_mend_job *job, const surface &s, const tree &t,
                                uint32_t rays, const std::vector<polygon> &polygons) {
    double flipped = 0;
    for (face f : s.faces)
        if ((size_t)f < polygons.size() && is_flipped(job, *s.m, f, polygons[f].source))
            flipped += area(*s.m, f);
    votes v;
    for (uint32_t i = 0; i < 8 * rays; i += 8) {
        face f = s.choose(i);
        kernel::Vector_3 d = random_direction(s, i + 3);
        kernel::Ray_3 ray(random_point(s, f, i + 1), normal(*s.m, f) * d < 0 ? -d : d);
        shoot(t, f, ray, &v.front, &v.front_length);
        shoot(t, f, ray.opposite(), &v.back, &v.back_length);
    }
    return should_turn(v, rays, flipped, s.sum.back() - flipped);
}

/* Rays for each surface without a volume: the largest get some, if not all can. */
static std::vector<uint32_t> share_rays(const std::vector<surface> &surfaces,
                                        const std::vector<double> &volumes) {
    std::vector<size_t> open;
    for (size_t i = 0; i < surfaces.size(); i++)
        if (volumes[i] == 0) open.push_back(i);
    std::sort(open.begin(), open.end(), [&](size_t a, size_t b) {
        double x = surfaces[a].sum.back(), y = surfaces[b].sum.back();
        return x != y ? x > y : a < b;
    });
    size_t each = std::clamp<size_t>(all_rays / (open.size() + 1), fewest_rays, ray_count);
    std::vector<uint32_t> rays(surfaces.size());
    for (size_t i = 0; i < open.size() && (i + 1) * each <= all_rays; i++)
        rays[open[i]] = (uint32_t)each;
    return rays;
}

/* ---- outward ---- */

static void turn_outward(pbs_run *run, const pbs_mend_job *job, mesh &m,
                         const std::vector<polygon> &polygons, pbs_err *err) {
    components c = find_components(m);
    std::vector<surface> surfaces = find_surfaces(m, c);
    std::vector<double> volumes(c.count);
    size_t solids = 0;
    for (const surface &s : surfaces)
        if (c.closed[s.number]) solids += (volumes[s.number] = volume(s)) != 0;
    tree t;
    if (solids < c.count || solids > 1) t.insert(m.faces().begin(), m.faces().end(), m);
    std::vector<uint32_t> rays = share_rays(surfaces, volumes);
    std::vector<face> turned;
    for (const surface &s : surfaces) {
        check(pbs_run_check(run, err));
        double v = volumes[s.number];
        bool turn = v == 0 ? is_seen_from_behind(job, s, t, rays[s.number], polygons)
                           : (v < 0) != (solids > 1 && is_inside_out(s, t, c, volumes));
        if (turn) turned.insert(turned.end(), s.faces.begin(), s.faces.end());
    }
    PMP::reverse_face_orientations(turned, m);
}

/* ---- what comes out ---- */

/* Each vertex of the mesh as a corner of the job that lies there. */
static std::vector<uint32_t> find_corners(const pbs_mend_job *job, const mesh &m,
                                          const std::vector<polygon> &polygons) {
    std::vector<uint32_t> corner(m.number_of_vertices() + m.number_of_removed_vertices());
    for (size_t i = 0; i < polygons.size(); i++)
        for (vertex v : corners(m, face((uint32_t)i))) {
            uint32_t k = 3 * polygons[i].source;
            while (position(job, k) != m.point(v)) k++;
            corner[v] = k;
        }
    return corner;
}

static void put_filled(pbs_run *run, pbs_mend_job *job, const mesh &m, size_t first,
                       const std::vector<uint32_t> &corner, pbs_err *err) {
    job->filled_count = (uint32_t)(m.number_of_faces() - first);
    job->counts[PBS_MEND_FILLED_TRIANGLES] = job->filled_count;
    if (!job->filled_count) return;
    array<uint32_t> filled(run, 3 * (size_t)job->filled_count, "filled holes", err);
    size_t at = 0;
    for (face f : m.faces())
        if ((size_t)f >= first)
            for (vertex v : corners(m, f)) filled[at++] = corner[v];
    job->filled = filled.release();
}

static void put_fates(pbs_mend_job *job, const mesh &m, const std::vector<polygon> &polygons,
                      const std::vector<seam> &seams) {
    for (size_t i = 0; i < polygons.size(); i++)
        if (is_flipped(job, m, face((uint32_t)i), polygons[i].source))
            job->fate[polygons[i].source] = PBS_MEND_FLIPPED;
    auto way = [&](const side &s) {
        return s.descending != (job->fate[polygons[s.polygon].source] == PBS_MEND_FLIPPED);
    };
    for (const seam &s : seams) job->counts[PBS_MEND_UNORIENTABLE_EDGES] += way(s.a) == way(s.b);
}

/* place: which point each corner of the job is. */
static void count_after(pbs_mend_job *job, const mesh &m, const std::vector<uint32_t> &corner,
                        const std::vector<uint32_t> &place) {
    std::vector<polygon> result;
    std::vector<uint32_t> vertices(place.size());
    for (face f : m.faces()) {
        polygon p;
        for (size_t k = 0; k < 3; k++) p[k] = place[corner[corners(m, f)[k]]];
        result.push_back(p);
    }
    for (vertex v : m.vertices())
        if (!m.is_isolated(v))
            job->counts[PBS_MEND_NONMANIFOLD_VERTICES] += ++vertices[place[corner[v]]] == 2;
    job->counts[PBS_MEND_CLOSED_AFTER] = is_closed(sides_of(result));
}

/* ---- all of it ---- */

static mesh orient(pbs_run *run, soup *s, const std::vector<seam> &seams, pbs_err *err) {
    std::vector<uint32_t> split;
    std::vector<point> points;
    split_vertices(s, seams, &split);
    for (uint32_t i : split) points.emplace_back(s->points[i][0], s->points[i][1], s->points[i][2]);
    PMP::orient_polygon_soup(points, s->polygons);
    check(pbs_run_check(run, err));
    mesh m = build(points, s->polygons, err);
    PMP::stitch_borders(m, CGAL::parameters::apply_per_connected_component(true));
    PMP::stitch_borders(m);
    check(pbs_run_check(run, err));
    return m;
}

static void mend_soup(pbs_run *run, pbs_mend_job *job, soup *s, pbs_err *err) {
    std::vector<uint32_t> place(3 * (size_t)job->triangles);
    for (const polygon &p : s->polygons)
        for (size_t k = 0; k < 3; k++) place[3 * (size_t)p.source + k] = p[k];
    std::vector<seam> seams = find_seams(sides_of(s->polygons), job);
    mesh m = orient(run, s, seams, err);
    fill_holes(run, job, m, err);
    turn_outward(run, job, m, s->polygons, err);
    put_fates(job, m, s->polygons, seams);
    std::vector<uint32_t> corner = find_corners(job, m, s->polygons);
    put_filled(run, job, m, s->polygons.size(), corner, err);
    count_after(job, m, corner, place);
    if (!job->intersections) return;
    check(pbs_run_check(run, err));
    auto count = [&](const std::pair<face, face> &) { job->counts[PBS_MEND_INTERSECTIONS]++; };
    PMP::self_intersections(m, boost::make_function_output_iterator(count));
}

static void mend_part(pbs_run *run, pbs_mend_job *job, pbs_err *err) {
    counted memory(run, job->triangles * per_triangle, "a part to be repaired", err);
    std::fill_n(job->counts, PBS_MEND_COUNTS, 0);
    std::fill_n(job->fate, job->triangles, (uint8_t)PBS_MEND_KEPT);
    job->filled = nullptr;
    job->filled_count = 0;
    soup s = weld(job);
    drop_flat(&s, job);
    job->counts[PBS_MEND_CLOSED_BEFORE] = is_closed(sides_of(s.polygons));
    drop_duplicates(&s, job);
    check(pbs_run_check(run, err));
    if (!s.polygons.empty()) mend_soup(run, job, &s, err);
    for (uint32_t i = 0; i < job->triangles; i++) {
        job->counts[PBS_MEND_FLIPPED_TRIANGLES] += job->fate[i] == PBS_MEND_FLIPPED;
        job->counts[PBS_MEND_DUPLICATE_TRIANGLES] += job->fate[i] == PBS_MEND_DUPLICATE;
        job->counts[PBS_MEND_DEGENERATE_TRIANGLES] += job->fate[i] == PBS_MEND_DEGENERATE;
    }
}

/* CGAL would print it in five lines and throw it. */
static void give_up(const char *, const char *what, const char *file, int line, const char *) {
    const char *slash = strrchr(file, '/');
    throw std::runtime_error(std::string("CGAL gives up: ") + (slash ? slash + 1 : file) + ":" +
                             std::to_string(line) + ": " + what);
}
static void be_silent(const char *, const char *, const char *, int, const char *) {}

static pbs_code mend(pbs_run *run, pbs_mend_job *job, pbs_err *err) {
    CGAL::set_error_handler(give_up);
    CGAL::set_warning_handler(be_silent);
    pbs_code rc = guard(err, [&] { mend_part(run, job, err); });
    if (rc) {
        pbs_free(run, job->filled);
        job->filled = nullptr;
        job->filled_count = 0;
    }
    return rc;
}

} // namespace pbs::mend

extern "C" __attribute__((visibility("default")))
const pbs_module_mend pbs_module = {PBS_MODULE_ABI, pbs::mend::per_triangle, pbs::mend::mend};
