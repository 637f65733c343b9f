/* mend.hpp: module mend: a part's triangles as a soup whose points are shared. No CGAL in here. */
#ifndef PBS_MEND_HPP
#define PBS_MEND_HPP

#include "formats/foreign/guard.hpp"
#include "formats/readers/module.h"
#include <array>
#include <cstdint>
#include <vector>

namespace pbs::mend {

/* CGAL takes this for a polygon and turns its corners round; where it comes from goes along. */
struct polygon : std::array<uint32_t, 3> {
    uint32_t source; /* the triangle of the job */
};

/* One side of a polygon. Sorted by its points, then by polygon. */
struct side {
    uint32_t low, high; /* points, low < high */
    uint32_t polygon;
    uint8_t corner;  /* at which it begins */
    bool descending; /* from high to low */
};

struct soup {
    std::vector<std::array<float, 3>> points;
    std::vector<polygon> polygons;
};

/* Corners at equal positions become one point; triangles with two equal corners are dropped. */
soup weld(pbs_mend_job *job);

std::vector<side> sides_of(const std::vector<polygon> &polygons);
/* Calls each(begin, end) for the sides of each edge. */
template <class F> void for_edges(const std::vector<side> &sides, F each) {
    for (size_t i = 0, end; i < sides.size(); i = end) {
        for (end = i + 1; end < sides.size() && sides[end].low == sides[i].low &&
                          sides[end].high == sides[i].high;)
            end++;
        each(sides.data() + i, sides.data() + end);
    }
}
/* Every edge is passed as often one way as the other. */
bool is_closed(const std::vector<side> &sides);

/* Drops all but one of the polygons with the same three points, and all but two where they are two
 * sides: wound both ways, where windings can be trusted (no edge of two polygons is passed the same
 * way by both); else, where they are the wall between two solids that touch. What is closed stays
 * closed. */
void drop_duplicates(soup *s, pbs_mend_job *job);

/* Two polygons that go on in each other over an edge. */
struct seam {
    side a, b;
};
/* What goes on in what. An edge of two polygons is simple. At others, file order helps, since
 * exporters write one solid after the other: polygons are paired there with the nearest in the
 * file that pass the edge the other way, if windings can be trusted at all; else two and two, if
 * they stand in the file like that. What is left has a border there. */
std::vector<seam> find_seams(const std::vector<side> &sides, pbs_mend_job *job);

/* Points become so many vertices as there are fans of polygons around them that the seams hold
 * together. Afterwards polygons count vertices, and *point says which point each is. */
void split_vertices(soup *s, const std::vector<seam> &seams, std::vector<uint32_t> *point);

} // namespace pbs::mend
#endif
