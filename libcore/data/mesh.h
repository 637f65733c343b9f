/* mesh.h: geometry and materials as plain arrays, the currency between readers and algorithms.
 *
 * A part (a unique triangle set in local coordinates) is one or more meshes, each small enough
 * for 16-bit indices, so that everything that streams works in bounded memory. A vertex that two
 * meshes of a part share has the same bits in both: borders stay watertight.
 */
#ifndef PBS_MESH_H
#define PBS_MESH_H

#include "libcore/data/vec.h"
#include <stddef.h>
#include <stdint.h>

#define PBS_NONE UINT32_MAX /* no material, no texture, no node */

#define PBS_MESH_VERTICES  65536
#define PBS_MESH_TRIANGLES 131072

typedef struct pbs_mesh {
    uint32_t vertices, triangles;
    const float *position;             /* 3 a vertex, finite, relative to the part's origin */
    const int16_t *normal;             /* 2 a vertex, octahedral (vec.h); NULL: face normals */
    const float *uv;                   /* 2 a vertex; v grows downwards, as in glTF; NULL: none */
    const uint8_t *colour;             /* 4 a vertex: sRGB and linear alpha; NULL: white */
    const uint16_t *index;             /* 3 a triangle, all < vertices */
    const uint32_t *triangle_material; /* 1 a triangle, or PBS_NONE; NULL: all have `material` */
    uint32_t material;                 /* or PBS_NONE: white, metallic 0, roughness 1 */
} pbs_mesh;

typedef enum pbs_alpha { PBS_ALPHA_OPAQUE, PBS_ALPHA_MASK, PBS_ALPHA_BLEND } pbs_alpha;

typedef struct pbs_texture_use {
    uint32_t texture;       /* or PBS_NONE */
    uint8_t wrap_u, wrap_v; /* 0 repeat, 1 clamp to edge, 2 mirrored repeat */
    float transform[6];     /* uv' = (t0 u + t1 v + t2, t3 u + t4 v + t5); identity 1 0 0 0 1 0 */
} pbs_texture_use;

typedef struct pbs_material {
    float base[4];     /* linear rgb and alpha; multiplies texture and vertex colour */
    float emissive[3]; /* linear */
    float metallic, roughness;
    float alpha_cutoff;           /* with PBS_ALPHA_MASK: a fragment with less alpha is not there */
    uint8_t alpha;                /* pbs_alpha */
    uint8_t double_sided;         /* kept, never used for culling */
    pbs_texture_use base_texture; /* sRGB, alpha linear */
    pbs_texture_use material_texture; /* glTF: green roughness, blue metallic */
    pbs_texture_use emissive_texture; /* sRGB */
    const char *name;                 /* UTF-8, or NULL */
} pbs_material;

#define PBS_TEXTURE_NONE ((pbs_texture_use){PBS_NONE, 0, 0, {1, 0, 0, 0, 1, 0}})
#define PBS_MATERIAL_DEFAULT                                                                       \
    ((pbs_material){{1, 1, 1, 1},                                                                  \
                    {0, 0, 0},                                                                     \
                    0,                                                                             \
                    1,                                                                             \
                    0.5f,                                                                          \
                    PBS_ALPHA_OPAQUE,                                                              \
                    1,                                                                             \
                    PBS_TEXTURE_NONE,                                                              \
                    PBS_TEXTURE_NONE,                                                              \
                    PBS_TEXTURE_NONE,                                                              \
                    NULL})

/* A decoded image: rows from the top, 4 bytes a pixel: rgb as stored (sRGB) and alpha. */
typedef struct pbs_image {
    uint32_t width, height;
    uint8_t *rgba;
} pbs_image;

/* One placed mesh: m takes part coordinates (origin included) to the frame that is drawn in. */
typedef struct pbs_draw {
    const pbs_mesh *mesh;
    double m[12];
} pbs_draw;
#endif
