/* module.h: libraries that are opened when a scene needs them, never linked into a tool.
 *
 * A module is lib/pbs/NAME.so beside the bin folder of the running program, or in the folder
 * that PBS_MODULES names. It exports one symbol, pbs_module, a table that begins with the
 * version of this interface. Inside is C++ and one third-party library; outside is C. No
 * exception leaves it.
 */
#ifndef PBS_MODULE_H
#define PBS_MODULE_H

#include "formats/readers/sink.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Changes whenever a struct that crosses the border does, so that a module of another build is
 * refused and not called. */
#define PBS_MODULE_ABI                                                                             \
    ((int)(1000000 + 10000 * sizeof(pbs_run) + 100 * sizeof(pbs_sink) + sizeof(pbs_err) +          \
           sizeof(pbs_exr_part) + sizeof(pbs_mend_job) + sizeof(pbs_draco_mesh)))

/* gltf.so: simdjson, tinygltf, Draco and meshoptimizer. */
typedef struct pbs_module_gltf {
    int abi;
    pbs_import_fn import;
} pbs_module_gltf;

/* image.so: OpenImageIO. Costs about 130 MB and 0.3 s when opened. */
typedef struct pbs_module_image {
    int abi;
    /* Decodes an image of any format OpenImageIO knows from memory; name is for messages.
     * out->rgba comes from pbs_alloc(run); missing colour channels are filled (grey to rgb, alpha
     * 255). 16-bit and float images are rounded to 8 bits. */
    pbs_code (*decode)(pbs_run *run, const char *name, const void *bytes, size_t size,
                       pbs_image *out, pbs_err *err);
    /* Writes a file whose format follows from its ending. */
    pbs_code (*write)(const char *path, const pbs_image *image, pbs_err *err);
} pbs_module_image;

/* exr.so: OpenEXRCore. A part of an EXR file is a view; planes are rows top down, `stride` floats
 * from one pixel to the next. */
typedef struct pbs_exr_plane {
    const char *channel; /* "P.X", "N.Z", "R", ... */
    float *data;         /* width * height * stride */
    uint32_t stride;
    int half; /* store as half float */
} pbs_exr_plane;
typedef struct pbs_exr_part {
    const char *name; /* "view0" */
    uint32_t width, height;
    pbs_exr_plane *planes;
    int plane_count;
    double origin[3]; /* what positions are relative to: the attribute pbsOrigin; 0 without one */
} pbs_exr_part;
typedef struct pbs_module_exr {
    int abi;
    /* One file, any number of parts, ZIP compressed, scanlines. */
    pbs_code (*write)(const char *path, const pbs_exr_part *parts, int part_count, pbs_err *err);
    /* Reads part after part: calls sink with all float, half and uint channels of a part as float
     * planes with stride 1, which are borrowed. Scanline and tiled, not deep. */
    pbs_code (*read)(pbs_run *run, const char *path,
                     pbs_code (*sink)(void *ctx, const pbs_exr_part *part, pbs_err *err), void *ctx,
                     pbs_err *err);
} pbs_module_exr;

/* mend.so: CGAL. One part, repaired: triangles are kept, turned round or dropped, and holes filled
 * between corners that are there. No position changes. formats/scene/mend.h does whole scenes. */
typedef enum pbs_mend_fate {
    PBS_MEND_KEPT,
    PBS_MEND_FLIPPED,
    PBS_MEND_DUPLICATE, /* of one that is kept: dropped */
    PBS_MEND_DEGENERATE /* no area: dropped */
} pbs_mend_fate;
typedef enum pbs_mend_count {
    PBS_MEND_CLOSED_BEFORE, /* 1: every edge is passed as often one way as the other */
    PBS_MEND_CLOSED_AFTER,
    PBS_MEND_FLIPPED_TRIANGLES,
    PBS_MEND_DUPLICATE_TRIANGLES,
    PBS_MEND_DEGENERATE_TRIANGLES,
    PBS_MEND_NONMANIFOLD_EDGES,    /* of more than two triangles, without duplicates */
    PBS_MEND_NONMANIFOLD_VERTICES, /* points that became several vertices */
    PBS_MEND_UNORIENTABLE_EDGES,   /* where a surface of one side was cut */
    PBS_MEND_HOLES,                /* closed border lines, before any is filled */
    PBS_MEND_HOLES_FILLED,
    PBS_MEND_FILLED_TRIANGLES,
    PBS_MEND_INTERSECTIONS,  /* pairs of triangles that meet in more than a common edge or corner */
    PBS_MEND_NORMALS_TURNED, /* not by the module */
    PBS_MEND_COUNTS
} pbs_mend_count;
typedef struct pbs_mend_job {
    const float *position; /* 9 a triangle, finite */
    uint32_t triangles;
    uint32_t fill;     /* holes of at most so many edges are filled; 0: none */
    int intersections; /* count them */
    uint8_t *fate;     /* out, 1 a triangle: the caller's array */
    uint32_t *filled;  /* out, 3 a new triangle: corners 3 * triangle + 0, 1, 2. pbs_alloc(run) */
    uint32_t filled_count;
    uint64_t counts[PBS_MEND_COUNTS]; /* out */
} pbs_mend_job;
typedef struct pbs_module_mend {
    int abi;
    size_t per_triangle; /* bytes that mend needs at most for each */
    /* Errors: PBS_LIMIT; PBS_DATA if CGAL gives up. */
    pbs_code (*mend)(pbs_run *run, pbs_mend_job *job, pbs_err *err);
} pbs_module_mend;

/* zstd.so: libzstd. Sizes are checked by the caller. Thread-safe. */
typedef struct pbs_module_zstd {
    int abi;
    size_t (*bound)(size_t n); /* bytes that packing n may take */
    /* Returns the packed size, or 0 if the machine has no memory left. */
    size_t (*pack)(void *to, size_t room, const void *from, size_t n, int level);
    /* Bytes that were packed; UINT64_MAX: this is no frame, or it does not say. */
    uint64_t (*content)(const void *from, size_t size);
    /* False: it is damaged, or not a packing of n bytes. */
    bool (*unpack)(void *to, size_t n, const void *from, size_t size);
} pbs_module_zstd;

/* meshopt.so: meshoptimizer. Arrays of records of 4, 8, ... 256 bytes, or of u16 indices, which
 * have stride 2; never empty. Thread-safe. */
typedef struct pbs_module_meshopt {
    int abi;
    size_t (*bound)(size_t count, size_t stride); /* bytes that packing may take */
    pbs_code (*pack)(pbs_run *run, void *to, size_t room, const void *from, size_t count,
                     size_t stride, size_t *size, pbs_err *err);
    /* False: it is damaged. */
    bool (*unpack)(void *to, size_t count, size_t stride, const void *from, size_t size);
} pbs_module_meshopt;

/* draco.so: Draco. A mesh of whole numbers, its arrays as those of a MESH chunk; NULL: it has none.
 */
typedef struct pbs_draco_mesh {
    uint32_t vertices, triangles; /* at most 65536 and 131072 */
    int32_t *position;            /* 3 a vertex */
    int16_t *normal;              /* 2 */
    int32_t *uv;                  /* 2 */
    uint8_t *colour;              /* 4 */
    uint16_t *index;              /* 3 a triangle, all < vertices */
} pbs_draco_mesh;
typedef struct pbs_module_draco {
    int abi;
    /* *out comes from pbs_alloc(run) and has *size bytes, 0 if the library does not take the mesh;
     * *vertices of it come back. Vertices and triangles get another order. */
    pbs_code (*pack)(pbs_run *run, const pbs_draco_mesh *mesh, uint8_t **out, size_t *size,
                     uint32_t *vertices, pbs_err *err);
    /* Into the caller's arrays, which have exactly that size. Errors: PBS_DATA if it is damaged or
     * of another size; PBS_LIMIT. Thread-safe, as pack is. */
    pbs_code (*unpack)(pbs_run *run, const pbs_draco_mesh *to, const void *from, size_t size,
                       pbs_err *err);
} pbs_module_draco;

/* *table points to the module's table, for as long as the program runs. counted: bytes that
 * opening it costs, counted in run. Errors: PBS_IO, "module gltf: not installed ...", PBS_LIMIT. */
pbs_code pbs_module_open(pbs_run *run, const char *name, size_t counted, const void **table,
                         pbs_err *err);

#ifdef __cplusplus
}
#endif
#endif
