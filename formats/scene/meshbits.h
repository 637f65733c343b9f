/* meshbits.h: meshes whose numbers are whole ones: positions on a lattice, normals and texture
 * coordinates in steps. pbs-container(5) has the bytes.
 *
 * The lattice is one for the whole world in which a node is not moved: its points are the multiples
 * of `step`, a power of two, from the world's origin, not from the node's. So a corner that two
 * meshes share, of one node or of two with the same step, is the same afterwards as before, and no
 * crack opens. An axis' error is at most step / 2, and what storing as a float takes besides.
 *
 * The payload of such a mesh still has floats, which are what a reader wants, and says in front
 * what they are multiples of. Codecs take the whole numbers instead, from which the same floats
 * come again, bit for bit.
 */
#ifndef PBS_MESHBITS_H
#define PBS_MESHBITS_H

#include "formats/container/container.h"

enum {
    PBS_MESH_BITS_MOST = 20, /* of positions, along the longest side */
    PBS_MESH_NORMAL_BITS = 10,
    PBS_MESH_UV_BITS = 14,      /* of a whole: steps of 2^-14 */
    PBS_MESH_EXACT = INT32_MIN, /* an exponent: there is no lattice */
    PBS_MESH_LATTICE = 16,      /* in the word of arrays: the mesh has one */
    PBS_MESH_LATTICE_AT = 16,   /* where it is in the payload, and its size */
    PBS_MESH_LATTICE_SIZE = 48
};

/* What a payload says of its lattice: position = corner + step * (least + whole number >= 0). */
typedef struct pbs_mesh_lattice {
    double corner[3], step; /* |corner| <= step / 2 unless the origin is too far for doubles */
    int32_t least[3];
    uint32_t normal_bits, uv_bits; /* 0: as they are */
} pbs_mesh_lattice;

/* The exponent e of the step 2^e for which `side` has at most 2^bits steps and more than half as
 * many. PBS_MESH_EXACT if bits is 0 or side is not a length. */
int pbs_mesh_exponent(double side, unsigned bits);

typedef struct pbs_mesh_snap {
    int exponent;
    double from[3]; /* the origin to which the mesh's positions are relative */
    double to[3];   /* and that to which they shall be */
} pbs_mesh_snap;

/* A mesh's payload with the numbers of a lattice. Corners that have become equal are one, and
 * triangles two of whose corners lie at one place are left out (*flat; but never the first one, so
 * that there is one). *out comes from pbs_alloc(run) and has *size bytes; NULL if a position is
 * further than 2^22 steps from `to`, and the mesh should stay as it is. payload: one without a
 * lattice, as pbs_mesh_parse took it. Errors: PBS_LIMIT. */
pbs_code pbs_mesh_snap_to(pbs_run *run, const pbs_mesh_snap *snap, const uint8_t *payload,
                          uint8_t **out, size_t *size, uint32_t *flat, pbs_err *err);

/* Whether a payload says that it has a lattice; it has a head at least. */
static inline bool pbs_mesh_has_lattice(const uint8_t *payload) {
    return payload[8] & PBS_MESH_LATTICE;
}
/* False: the payload has no lattice, or one that is damaged. */
bool pbs_mesh_lattice_get(const uint8_t *payload, size_t n, pbs_mesh_lattice *out);

/* Floats to whole numbers in their place, positions as u32, normals as i16, texture coordinates as
 * i32; and back. The sizes of a payload's arrays are those of its head: n, checked before. False:
 * there is no lattice, or the numbers are not on it, and the payload is not to be used. */
bool pbs_mesh_to_whole(uint8_t *payload, size_t n);
bool pbs_mesh_from_whole(uint8_t *payload, size_t n);
/* Whether everything is on the lattice. */
bool pbs_mesh_on_lattice(const uint8_t *payload, size_t n);

/* The step as the flags of a MESH chunk have it, so that a directory says it: 0 without one. */
uint32_t pbs_mesh_flags(int exponent);
double pbs_mesh_flags_step(uint32_t flags);
#endif
