/* place.h: triangles of a mesh taken into the frame of a block, a batch at a time (grid.h).
 *
 * Most triangles are placed four at a time. One that reaches so far that its coordinates would not
 * fit is cut first along a cube around the grid's corner that holds all of the grid. A cut point is
 * computed from the edge's ends in one order, so that triangles that share an edge still do.
 */
#ifndef PBS_PLACE_H
#define PBS_PLACE_H

#include "libcore/voxels/block.h"

/* Half of what coordinates may be, so that the block's place in the grid can be subtracted. */
#define PBS_PLACE_FAR (PBS_GRID_FAR / 2)

/* Units of sums per square voxel. */
#define PBS_UNIT 0x1p40

/* How the triangles of a call are placed. */
typedef struct pbs_placing {
    const pbs_mesh *mesh;
    double m[9], part[3];
    double at[3], shift[3];      /* the block; whole voxels of the translation relative to it */
    double far_lo[3], far_hi[3]; /* what lies beyond is cut */
    double cofactor[9];          /* for vertex normals, scaled to at most 1 */
    double sign;                 /* of the triangle's own normal: -1 turns it over */
    bool both;                   /* it is not known which side is out */
    bool all_faces;              /* triangles look out of both sides */
    bool safe;                   /* no product overflows */
    bool simd;
} pbs_placing;

typedef struct pbs_batch {
    pbs_triangles t;
    _Alignas(32) double unit[PBS_TRIANGLES][4];     /* PBS_UNIT times: the unit normal, outwards or
                                                       as the corners run, 0 without area; and 1,
                                                       behind it or, beyond the plane, before it */
    _Alignas(32) double normal[3][PBS_TRIANGLES];   /* the same, length 1 */
    _Alignas(16) float smooth[PBS_TRIANGLES][3][4]; /* vertex normals, placed; any length */
    uint32_t id[PBS_TRIANGLES];                     /* of the mesh */
    uint8_t faces[PBS_TRIANGLES];                   /* that it looks out of */
    uint8_t slot[PBS_TRIANGLES];                    /* 1: beyond the fixed plane */
    uint64_t cut; /* pieces of triangles; where their corners are in these: */
    float bary[PBS_TRIANGLES][3][2];
} pbs_batch;

/* What is still to be placed. */
typedef struct pbs_feed {
    const uint32_t *triangles;
    size_t count;
    uint32_t far_count, far[PBS_TRIANGLES]; /* taken from there, waiting for room */
    uint64_t lost; /* that have a corner which is no number, or farther than 2^1000 voxels */
} pbs_feed;

void pbs_placing_make(pbs_placing *out, const pbs_mesh *mesh, const pbs_to_grid *to,
                      const uint32_t at[3], pbs_sides sides, bool interior, bool simd);

/* Fills a batch with those of the next triangles whose boxes touch the block or the layer around
 * it. False: there are no more. Same bits with and without AVX2. */
bool pbs_batch_fill(const pbs_placing *p, pbs_feed *feed, pbs_batch *out);

/* The side of the fixed plane, which no usual direction lies in. */
#define PBS_SIDE_X 0.5377
#define PBS_SIDE_Y 0.7939
#define PBS_SIDE_Z 0.2841

/* ---- place.c, place_avx2.c ---- */

typedef struct pbs_corners {
    _Alignas(16) float p[3][3][PBS_TRIANGLES]; /* as pbs_triangles, in the part's frame */
    _Alignas(16) int32_t normal[3][PBS_TRIANGLES];
} pbs_corners;

#if defined(__x86_64__)
uint64_t pbs_batch_place_avx2(const pbs_placing *p, const pbs_corners *in, const uint32_t *id,
                              uint32_t count, pbs_batch *out);
void pbs_batch_normals_avx2(const pbs_placing *p, pbs_batch *b);
void pbs_batch_smooth_avx2(const pbs_placing *p, const pbs_corners *in, pbs_batch *b);
#endif
#endif
