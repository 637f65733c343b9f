/* raster.h: transform, and depth + triangle id rasterisation of one opposite pair of views
 * (paper 1, section 3.1).
 *
 * The two views of a pair have the same projection mirrored, so one pass over the triangles finds
 * the nearest and the farthest triangle of every pixel, and the far one is what the opposite view
 * sees. Each pixel holds two 64-bit keys, near and far: depth in the upper half, triangle number
 * in the lower. The smaller key wins, which makes the result independent of the order of drawing,
 * and gives ties in depth to the lower triangle number.
 *
 * Vertices are snapped once to 1/256 pixel and everything after that is exact in integers, so
 * triangles that share an edge share its pixels out without a gap or an overlap. A pixel centre
 * that lies on an edge belongs to the triangle on its right, or above it if the edge is level:
 * the top-left rule for rows stored bottom first, as GL has it.
 */
#ifndef PBS_RASTER_H
#define PBS_RASTER_H

#include "libcore/data/mesh.h"

#define PBS_SUBPIXELS 256

/* A key is below this as long as depth is 0 .. 1; it is what memset with 0x7f leaves. */
#define PBS_KEY_EMPTY UINT64_C(0x7f7f7f7f7f7f7f7f)
/* Keys behind the last row that rows may be read and written back beyond their end. */
#define PBS_KEY_PAD 16

/* How a pair projects. Even view: seen from `toward`; the odd one has right and toward negated. */
typedef struct pbs_pair {
    double right[3], up[3], toward[3]; /* unit, right-handed */
    double centre[3];                  /* of the box; lies in the middle of the picture */
    double pixel;                      /* side of a pixel */
    double depth;                      /* of the box along toward; 0: flat */
    uint32_t width, height;
} pbs_pair;

/* m after the projection: rows for x and y in 1/256 pixel from the lower left corner, and for
 * depth, 0 at the near side of the box and 1 at the far side. */
void pbs_pair_project(double out[12], const pbs_pair *pair, const double m[12]);

typedef struct pbs_snapped {
    int32_t x, y; /* 1/256 pixel, at most 2^29 */
    float z;      /* 0 .. 1 */
    int32_t bad;  /* not 0: not finite */
} pbs_snapped;

/* Where to draw: all of a pair, or a band of its rows. */
typedef struct pbs_raster {
    uint64_t *key;      /* near and far of each pixel of the band, then PBS_KEY_PAD more */
    uint32_t width;     /* of the view */
    uint32_t y0, y1;    /* the band: rows y0 .. y1 - 1 */
    uint64_t fragments; /* counted up: depth tests */
    bool simd;          /* may use AVX2; same bits either way */
} pbs_raster;

bool pbs_raster_simd(void); /* whether this processor has AVX2 */
void pbs_raster_clear(pbs_raster *r);

/* Projects n positions with a matrix of pbs_pair_project. *box is x0, y0, x1, y1 around all of
 * them. Returns false if there is one that is not finite. Coordinates beyond 2^29 are moved
 * there: the caller's box has nothing to do with the scene then. */
bool pbs_raster_snap(const double m[12], const float *position, uint32_t n, bool simd,
                     pbs_snapped *out, int32_t box[4]);

/* Whether a snapped box holds a pixel centre of the band. */
bool pbs_raster_sees(const pbs_raster *r, const int32_t box[4]);

/* Draws triangles; triangle i has the number first + i. finite: what pbs_raster_snap returned. */
void pbs_raster_draw(pbs_raster *r, const pbs_snapped *v, const uint16_t *index, uint32_t count,
                     uint32_t first, bool finite);

/* Draws one triangle, of whose fragments only those are there for which keep says so. */
void pbs_raster_draw_masked(pbs_raster *r, const pbs_snapped *v, const uint16_t index[3],
                            uint32_t id, bool (*keep)(void *ctx, uint32_t x, uint32_t y),
                            void *ctx);
#endif
