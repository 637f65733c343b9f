/* ply_header.h: the header of a PLY file: what elements there are, and what is in them. */
#ifndef PBS_PLY_HEADER_H
#define PBS_PLY_HEADER_H

#include "formats/readers/text.h"
#include "libcore/ground/run.h"
#include <string.h>

typedef enum pbs_ply_type {
    PBS_PLY_I8,
    PBS_PLY_U8,
    PBS_PLY_I16,
    PBS_PLY_U16,
    PBS_PLY_I32,
    PBS_PLY_U32,
    PBS_PLY_F32,
    PBS_PLY_F64,
    PBS_PLY_NO_TYPE
} pbs_ply_type;

/* Bytes of one number. */
static inline size_t pbs_ply_size(pbs_ply_type t) {
    static const uint8_t size[] = {1, 1, 2, 2, 4, 4, 4, 8, 0};
    return size[t];
}

/* What a property means to us. */
typedef enum pbs_ply_role {
    PBS_PLY_X,
    PBS_PLY_Y,
    PBS_PLY_Z,
    PBS_PLY_NX,
    PBS_PLY_NY,
    PBS_PLY_NZ,
    PBS_PLY_RED,
    PBS_PLY_GREEN,
    PBS_PLY_BLUE,
    PBS_PLY_ALPHA,
    PBS_PLY_S,
    PBS_PLY_T,
    PBS_PLY_ROLES, /* of numbers; the ones below are not vertex attributes */
    PBS_PLY_TEXTURE,
    PBS_PLY_INDICES,  /* a list */
    PBS_PLY_WEDGE_UV, /* a list */
    PBS_PLY_OTHER
} pbs_ply_role;

typedef struct pbs_ply_property {
    pbs_ply_type type, count; /* count: PBS_PLY_NO_TYPE unless it is a list */
    pbs_ply_role role;
    size_t offset; /* in the element, if that has no list */
} pbs_ply_property;

typedef struct pbs_ply_element {
    pbs_span name;
    uint64_t count;
    size_t first, properties; /* of pbs_ply_header.property */
    size_t least;             /* bytes that one takes at least in a binary file */
    bool fixed;               /* no lists: exactly that many */
    const char *start;        /* for the reader */
} pbs_ply_element;

typedef struct pbs_ply_header {
    bool ascii, big_endian;
    pbs_ply_element *element;
    size_t elements, elements_room;
    pbs_ply_property *property;
    size_t properties, properties_room;
    pbs_span *texture; /* "comment TextureFile NAME" */
    size_t textures, textures_room;
    const char *data; /* behind the header */
} pbs_ply_header;

/* *h is all 0 before; free it also after an error. Errors carry the line. */
pbs_code pbs_ply_header_read(pbs_run *run, const void *bytes, size_t size, pbs_ply_header *h,
                             pbs_err *err);
void pbs_ply_header_free(pbs_run *run, pbs_ply_header *h);

/* What an element is for. */
bool pbs_ply_is_vertex(const pbs_ply_element *e);
bool pbs_ply_is_face(const pbs_ply_element *e);
bool pbs_ply_is_strip(const pbs_ply_element *e);

/* PBS_DATA for a file that cannot hold triangles: no faces, or no vertices. */
pbs_code pbs_ply_check_header(const pbs_ply_header *h, pbs_err *err);

/* A number of the file. swap: its bytes are in the other order than the machine's. */
static inline double pbs_ply_load(const char *p, pbs_ply_type t, bool swap) {
    uint8_t b1;
    uint16_t b2;
    uint32_t b4;
    uint64_t b8;
    float f;
    double d;
    switch (t) {
    case PBS_PLY_I8:
        memcpy(&b1, p, 1);
        return (int8_t)b1;
    case PBS_PLY_U8:
        memcpy(&b1, p, 1);
        return b1;
    case PBS_PLY_I16:
    case PBS_PLY_U16:
        memcpy(&b2, p, 2);
        b2 = swap ? __builtin_bswap16(b2) : b2;
        return t == PBS_PLY_I16 ? (int16_t)b2 : b2;
    case PBS_PLY_I32:
    case PBS_PLY_U32:
    case PBS_PLY_F32:
        memcpy(&b4, p, 4);
        b4 = swap ? __builtin_bswap32(b4) : b4;
        if (t != PBS_PLY_F32) return t == PBS_PLY_I32 ? (double)(int32_t)b4 : (double)b4;
        memcpy(&f, &b4, 4);
        return f;
    default:
        memcpy(&b8, p, 8);
        b8 = swap ? __builtin_bswap64(b8) : b8;
        memcpy(&d, &b8, 8);
        return d;
    }
}
#endif
