/* sink.h: what a reader of a foreign scene file hands over, piece by piece.
 *
 * A reader knows its file and nothing else; it calls these functions and never builds a scene of
 * its own. The other side (scene.c, or a test) decides what to keep. Everything passed in is
 * borrowed for the call. Ids of textures and materials count from 0 in the order of the calls;
 * those of nodes are the sink's business, and equal nodes may get the same. Every function may
 * fail; the reader stops then and returns that error.
 *
 * Order of calls: textures and materials before they are used; a part's triangles between
 * part_begin and part_end; children before the assembly that places them; root last, once.
 * Parts and assemblies share one numbering: the node ids.
 */
#ifndef PBS_SINK_H
#define PBS_SINK_H

#include "libcore/data/mesh.h"
#include "libcore/data/motion.h"
#include "libcore/data/record.h"
#include "libcore/ground/run.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Which optional attributes the corners of a part carry; the others are ignored. */
enum { PBS_CORNER_NORMAL = 1, PBS_CORNER_UV = 2, PBS_CORNER_COLOUR = 4 };

typedef struct pbs_corner {
    double position[3]; /* local to the part, in double as the file has it */
    float normal[3];    /* any length; zero or not finite: the triangle's own normal is used */
    float uv[2];
    uint8_t colour[4]; /* sRGB and linear alpha */
} pbs_corner;

typedef struct pbs_child {
    uint32_t node;
    double m[12];     /* child's coordinates to the assembly's (vec.h) */
    const char *name; /* of this placing, NULL: none */
    uint32_t flags;   /* PBS_CHILD_MOVES: a glTF animation moves it */
    uint32_t motion;  /* how: what pbs_sink.motion gave it. 0: it stays, or how is not known */
} pbs_child;
enum { PBS_CHILD_MOVES = 1 };

/* What could not become triangles. Nothing is dropped without being counted here. */
typedef enum pbs_skip {
    PBS_SKIP_NONFINITE,  /* triangle with a NaN or infinite corner (counted by the sink) */
    PBS_SKIP_DEGENERATE, /* triangle with two equal corners or exactly zero area (by the sink) */
    PBS_SKIP_POINTS,     /* point primitives, by the reader */
    PBS_SKIP_LINES,      /* line segments, by the reader */
    PBS_SKIP_TRANSFORM,  /* placing with a NaN or infinite transform, by the sink */
    PBS_SKIP_TEXTURE, /* texture or material library that is missing, where the user allowed it */
    PBS_SKIP_POLYGON, /* polygon with fewer than 3 corners, by the reader */
    PBS_SKIP_FAILED, /* part of the file that cannot be read, where the user allowed it, by the sink
                      */
    PBS_SKIP_CHANNEL, /* channel of an animation that cannot be read, by the reader */
    PBS_SKIP_KEY,     /* key with a NaN, infinite or decreasing time, a value that is not finite, or
                         a quaternion 0, by the reader */
    PBS_SKIP_KINDS
} pbs_skip;

typedef struct pbs_sink {
    void *ctx;
    pbs_run *run;
    /* The file's encoded bytes (PNG, JPEG, ...), read from where the scene refers to. */
    pbs_code (*texture)(void *ctx, const char *name, const void *bytes, size_t size, uint32_t *id,
                        pbs_err *err);
    /* A texture whose file is not there: an error, or PBS_OK and *id = PBS_NONE if the user
     * allowed it. The sink counts it. */
    pbs_code (*missing)(void *ctx, const char *name, uint32_t *id, pbs_err *err);
    pbs_code (*material)(void *ctx, const pbs_material *material, uint32_t *id, pbs_err *err);
    /* origin: somewhere near the middle of the part; positions are stored in float relative to it,
     * rounded to 2^-24 of their distance from it. */
    pbs_code (*part_begin)(void *ctx, const char *name, const double origin[3], uint32_t corners,
                           pbs_err *err);
    /* material: an id or PBS_NONE. Never fails for the values of the corners. */
    pbs_code (*triangle)(void *ctx, const pbs_corner corner[3], uint32_t material, pbs_err *err);
    /* A part may turn out to have no triangles; it gets an id all the same. */
    pbs_code (*part_end)(void *ctx, uint32_t *node, pbs_err *err);
    pbs_code (*assembly)(void *ctx, const char *name, const pbs_child *children, size_t count,
                         uint32_t *node, pbs_err *err);
    pbs_code (*root)(void *ctx, uint32_t node, pbs_err *err);
    void (*skip)(void *ctx, pbs_skip kind, uint64_t count);
    bool mapped; /* the bytes that the reader gets are a file's map, whose pages a pbs_trim may let
                    go (formats/container/scratch.h) */
    /* What is one of many cannot be read: *err says which and why, as the reader would end with.
     * NULL: it does. Else that is left out and the reader goes on: a primitive and the placings of
     * a node are not there, a material or an image is PBS_NONE. Only errors of the file (PBS_DATA)
     * and never inside a part. */
    void (*failed)(void *ctx, const pbs_err *err);
    /* An animation, before the motions that take part in it; ids count from 0. And a motion, before
     * the placings that have it; ids count from 1, and equal ones may get the same. Its keys are
     * as libcore/data/motion.h says, PBS_MOTION_MOST numbers at most. NULL, both: nobody wants
     * to know.
     */
    pbs_code (*animation)(void *ctx, const char *name, uint32_t *id, pbs_err *err);
    pbs_code (*motion)(void *ctx, const pbs_motion *motion, uint32_t *id, pbs_err *err);
} pbs_sink;

/* A reader. path is for messages and for finding files beside it; bytes is the whole file, mapped
 * read-only. Errors: PBS_DATA with the place in the file and without its path, which the caller
 * puts in front; and the sink's. */
typedef pbs_code (*pbs_import_fn)(const char *path, const void *bytes, size_t size,
                                  const pbs_sink *sink, pbs_err *err);

pbs_code pbs_import_obj(const char *path, const void *bytes, size_t size, const pbs_sink *sink,
                        pbs_err *err);
pbs_code pbs_import_ply(const char *path, const void *bytes, size_t size, const pbs_sink *sink,
                        pbs_err *err);
pbs_code pbs_import_stl(const char *path, const void *bytes, size_t size, const pbs_sink *sink,
                        pbs_err *err);
/* Opens the module "gltf" (formats/readers/module.h). */
pbs_code pbs_import_gltf(const char *path, const void *bytes, size_t size, const pbs_sink *sink,
                         pbs_err *err);

#ifdef __cplusplus
}
#endif
#endif
