/* block_inner.h: what the files of block.h share. */
#ifndef PBS_BLOCK_INNER_H
#define PBS_BLOCK_INNER_H

#include "libcore/voxels/bricks.h"
#include "libcore/voxels/clip.h"
#include "libcore/voxels/place.h"
#include "libcore/voxels/separate.h"
#include "libcore/gbuffer/shade.h"

/* Linear light has 16 bits in sums: a step is less than a tenth of the smallest of sRGB. */
#define PBS_LIGHT 65535

enum { PBS_EXTRAS = 9 }; /* colour 4, material 2, emissive 3 */

/* Above that, in units of area, a cell's numbers are widened: with one fragment more, times
 * PBS_LIGHT, they are still less than 2^63. */
#define PBS_BLOCK_WIDE (INT64_C(1) << 46)

/* ---- faces' attributes (block_faces.c) ---- */

typedef unsigned __int128 pbs_sum128;

/* Of a cell, and a material if that is wanted. Weights are areas projected along a face's axis,
 * and a bit for the touch alone. */
typedef struct pbs_face_entry {
    pbs_sum128 weight[7]; /* of each face; of all */
    uint32_t next;        /* of the cell, or PBS_NONE */
    uint32_t material;
    pbs_sum128 light[]; /* [6][4] for colours */
} pbs_face_entry;

typedef struct pbs_face_key {
    uint64_t key; /* the cell's code times 2^33, + 2^32 + the material; the cell alone: its first */
    uint32_t entry;
} pbs_face_key;

typedef struct pbs_face_sums {
    pbs_run *run;
    bool colour;
    size_t bytes; /* of an entry */
    pbs_face_key *key;
    size_t keys, key_count; /* a power of 2, or 0 */
    char *entry;
    size_t entry_cap;
    uint32_t count;
    pbs_code rc;
    pbs_err err;
} pbs_face_sums;

void pbs_face_sums_init(pbs_face_sums *s, pbs_run *run, bool colour);
void pbs_face_sums_free(pbs_face_sums *s);
void pbs_face_sums_begin(pbs_face_sums *s);
/* area: in units; 0: only touched. light: 4 numbers, for colours. */
void pbs_face_sums_add(pbs_face_sums *s, uint32_t code, uint32_t material, uint8_t faces,
                       int64_t area, const double normal[3], const int32_t *light);
/* Of a face: the material; or four sums and what they must be divided by, false if that is 0. */
uint32_t pbs_face_material(const pbs_face_sums *s, uint32_t code, int face);
bool pbs_face_light(const pbs_face_sums *s, uint32_t code, int face, double out[4]);

/* ---- the block ---- */

/* A cell that becomes a voxel. */
typedef struct pbs_chosen {
    const int64_t *record;
    uint32_t code;
    uint8_t faces;      /* that it looks out of, if there are no records */
    uint8_t hide, caps; /* faces that others hide; faces that are there always */
} pbs_chosen;

typedef struct pbs_block_out {
    pbs_voxels voxels;
    pbs_chosen *chosen;
    uint32_t *faces;
    size_t cap[8], face_cap, face_count;
} pbs_block_out;

struct pbs_block {
    pbs_run *run;
    pbs_block_params params;
    uint32_t at[3], size;
    bool simd, set_alone;
    int64_t wide_at; /* PBS_BLOCK_WIDE */

    /* The call and the batch that it is at. */
    pbs_placing placing;
    pbs_batch batch;
    uint32_t material[PBS_TRIANGLES];
    uint64_t asks;   /* triangles of which not every fragment is there */
    uint64_t varies; /* triangles that are not of one colour */
    uint64_t mixes;  /* of these, those whose corners' colours are in mix */
    uint64_t hit;    /* triangles that touch the block */
    bool general;    /* fragments differ in more than their area */

    /* block_shade.c */
    uint32_t extras, at_material, at_emissive; /* numbers a fragment; where these begin */
    uint32_t want;                             /* channels */
    int32_t value[PBS_TRIANGLES][PBS_EXTRAS];
    _Alignas(16) float mix[PBS_TRIANGLES][3][4];
    uint32_t plain_material; /* what plain was made of */
    int32_t plain[PBS_EXTRAS];
    const pbs_srgb_table *srgb;
    uint16_t light[256]; /* sRGB to linear light */
    pbs_draw draw;
    pbs_placed placed;
    pbs_lanes lanes; /* only the first is used */
    uint32_t lane_triangle;

    uint64_t triangles, fragment_count, lost;
    __int128 area;
    pbs_bricks bricks;
    pbs_face_sums face_sums;
    pbs_block_out out;
    pbs_fragments fragments;
    pbs_hits hits;
};

/* ---- block_shade.c: what fragments look like ---- */

void pbs_block_shade_init(struct pbs_block *b);
/* A call begins; a batch begins. */
void pbs_block_shade_call(struct pbs_block *b, const pbs_mesh *mesh);
void pbs_block_shade_batch(struct pbs_block *b);
/* Whether a triangle is there in a cell: asked at its point that is nearest to the middle. The
 * same answer for a fragment and a hit, and wherever the block is. */
bool pbs_block_keeps(struct pbs_block *b, uint32_t triangle, uint32_t cell);
/* Where a point of a piece is in the triangle that was cut. */
void pbs_block_uncut(const struct pbs_block *b, uint32_t triangle, double uv[2]);
/* The values of a fragment. */
void pbs_block_values(struct pbs_block *b, const pbs_fragment *f, int32_t value[PBS_EXTRAS]);

/* ---- block_means.c: the attributes of those that were chosen, whose places are there ---- */

/* Adds up the area that is in voxels. Errors: PBS_LIMIT. */
pbs_code pbs_block_means(struct pbs_block *b, __int128 *kept, pbs_err *err);
#endif
