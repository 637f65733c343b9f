/* polygon.h: planar polygons of any number of corners to triangles.
 *
 * Ear clipping, made exact by snapping: the polygon is looked at along the axis nearest to its
 * normal, its corners are rounded to 2^-52 of its size, and from there on every decision is made
 * in integers. Collinear corners, corners that coincide, slits and holes joined by a bridge are
 * ordinary. A tree over the corners that can be in the way keeps a polygon of 100,000 corners at
 * about n log n.
 */
#ifndef PBS_POLYGON_H
#define PBS_POLYGON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Bytes of scratch memory, aligned to 8, that a polygon of n corners needs; 0 for n below 5. */
size_t pbs_polygon_scratch(uint32_t n);

/* Writes exactly n - 2 triangles, three corner numbers each, with the polygon's winding; nothing
 * if n < 3. Corner i is at xyz[i * stride .. + 2]. The areas of the triangles add up to the
 * polygon's, as vectors, always.
 *
 * True: every triangle has the polygon's winding or no area, so those of an outline that does not
 * cross itself do not overlap. False: some may overlap, because the outline crosses itself, has no
 * area, or has a corner that is not finite (then it is cut as a fan). */
bool pbs_polygon_triangulate(const double *xyz, size_t stride, uint32_t n, uint32_t *triangle,
                             void *scratch);
#endif
