/* voxel.h: voxels as plain arrays (paper 2, section 3).
 *
 * A chunk is a cube of at most 256^3 cells at one level of detail; its voxels are in Morton order
 * (x in the lowest bit), each cell at most once. Each channel is an array of 4 bytes a voxel; one
 * that the scene does not have is NULL and costs nothing. Levels count from 0, the finest; a cell
 * of level l + 1 is 2^3 cells of level l.
 */
#ifndef PBS_VOXEL_H
#define PBS_VOXEL_H

#include "libcore/data/record.h"

enum {
    PBS_WEIGHT = 64, /* float: area of surface in the voxel, in squares of its own side */
    PBS_FACE = 128 /* uint32: where its faces' attributes begin in the node's list of them; one for
                      each face in the mask, in the order of the bits */
};

/* place: x, y, z in bytes 0 to 2, in byte 3 the faces that look outwards and PBS_VOXEL_TWO_SIDED.
 */
enum {
    PBS_FACE_X0 = 1, /* towards smaller x */
    PBS_FACE_X1 = 2,
    PBS_FACE_Y0 = 4,
    PBS_FACE_Y1 = 8,
    PBS_FACE_Z0 = 16,
    PBS_FACE_Z1 = 32,
    PBS_FACES_ALL = 63,
    PBS_VOXEL_TWO_SIDED = 64 /* the normal may be turned to the viewer: a sheet thinner than the
                                voxel, or a surface of which no side is known to be the outer one */
};
#define PBS_PLACE(x, y, z, faces)                                                                  \
    ((uint32_t)(x) | (uint32_t)(y) << 8 | (uint32_t)(z) << 16 | (uint32_t)(faces) << 24)

typedef struct pbs_voxels {
    size_t count;
    uint32_t *place;  /* always */
    uint32_t *normal; /* x, y, z: 10 bits each from the lowest on, signed, / 511; 2 bits 0 */
    float *weight;
    uint32_t *colour;   /* u8x4: sRGB, linear alpha */
    uint32_t *material; /* u8x4: metallic, roughness, 0, 0 */
    uint32_t *emissive; /* u8x4: sRGB, 0 */
    uint32_t *face;
} pbs_voxels;

/* Unit normals to 10-10-10; zero and what is not finite become +z. */
uint32_t pbs_normal10_put(const float n[3]);
void pbs_normal10_get(float n[3], uint32_t packed);

/* 8-bit coordinates to 24-bit Morton numbers and back. */
uint32_t pbs_morton8(uint32_t place);
uint32_t pbs_unmorton8(uint32_t code); /* faces 0 */
#endif
