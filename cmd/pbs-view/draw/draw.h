/* draw.h: a canvas: surfels, voxels and triangles into a picture, by OpenGL.
 *
 *     pbs_canvas_begin(canvas, &frame, err);
 *     pbs_canvas_surfels(canvas, nodes, count, err);      any number of times, in any order
 *     pbs_canvas_voxels(canvas, nodes, count, err);
 *     pbs_canvas_meshes(canvas, &scene, err);
 *     pbs_canvas_end(canvas, &image, err);
 *
 * What is drawn lies in storage buffers of the GPU already, or in the host's memory: then it goes
 * through a buffer of the canvas, a node at a time. All kinds are lit by the same
 * function (shade.glsl): their pictures can be compared. Structs may be zero-initialised; zero
 * means the default that is named.
 */
#ifndef PBS_DRAW_H
#define PBS_DRAW_H

#include "cmd/pbs-view/plan/camera.h"
#include "cmd/pbs-view/draw/gl.h"
#include "cmd/pbs-view/plan/part.h"
#include "libcore/data/mesh.h"
#include "libcore/data/record.h"
#include "libcore/ground/run.h"
#include "libcore/voxels/voxel.h"

typedef struct pbs_canvas pbs_canvas;

typedef struct pbs_canvas_desc {
    uint32_t width, height; /* pixels; 0: 1024 */
    int samples;            /* a pixel; 0: 4 or what the device has; 1: no antialiasing */
} pbs_canvas_desc;

/* gl is borrowed; its context stays current in this thread as long as the canvas lives. Errors:
 * PBS_LIMIT for a picture that is too large for the device or for -m; PBS_INTERNAL. */
pbs_code pbs_canvas_new(pbs_run *run, const pbs_gl *gl, const pbs_canvas_desc *desc,
                        pbs_canvas **out, pbs_err *err);
void pbs_canvas_free(pbs_canvas *canvas); /* NULL is fine */

/* Another size, 0: 1024; programs and what lies in the device's memory stay. What is in the picture
 * is lost. Errors: as pbs_canvas_new; nothing can be drawn then. */
pbs_code pbs_canvas_resize(pbs_canvas *canvas, uint32_t width, uint32_t height, pbs_err *err);

typedef struct pbs_frame {
    pbs_camera camera;
    uint8_t background[4]; /* sRGB; alpha 0: the default, a light grey */
} pbs_frame;

/* Clears the canvas. */
pbs_code pbs_canvas_begin(pbs_canvas *canvas, const pbs_frame *frame, pbs_err *err);

/* What follows is seen by this camera, in the columns left .. left + width - 1 of the canvas only:
 * one of two eyes. The camera's own picture, whose middle it looks at, has the columns from ..
 * from + wide - 1, of which these are a part; some may be outside of the canvas. */
typedef struct pbs_columns {
    uint32_t left, width;
    int32_t from;
    uint32_t wide;
} pbs_columns;
void pbs_canvas_look(pbs_canvas *canvas, const pbs_camera *camera, pbs_columns columns);

/* A prefix of a node's surfels, packed as in the archive (little-endian, fields in this order):
 *
 *     uint16 position[3], half spacing           always
 *     int16 normal[2]      PBS_NORMAL            octahedral (vec.h)
 *     uint8 colour[4]      PBS_COLOUR            sRGB, alpha
 *     uint8 material[4]    PBS_MATERIAL          metallic, roughness, 0, 0
 *     uint8 emissive[4]    PBS_EMISSIVE          sRGB, 0
 */
typedef struct pbs_surfels {
    GLuint buffer;       /* that they are in; 0: they are in the host's memory */
    uint64_t at, octave; /* bytes in it, multiples of 4: surfel 0; the octaves, 0: none */
    const void *records; /* in the host's memory: surfel 0; alignment does not matter */
    uint32_t stride;     /* bytes, a multiple of 4; 0: what the channels need */
    uint32_t channels;   /* PBS_NORMAL, ... (record.h); without normals discs face the eye */
    uint32_t prefix;     /* surfels drawn */
    uint32_t whole;      /* surfels of the node, where it has octaves */
    pbs_part part;       /* all 0: the whole node lies there */
    const void *octaves; /* in the host's memory: of colours and so on (libcore/surfels/average.h,
                            formats/surfels/octaves.h): entries without position and spacing, coarse
                            first; NULL: every surfel is shown as itself. A prefix is shown between
                            the two octaves that it is between */
    double radius; /* of a disc, node's unit: pbs_profile_radius(.., prefix) closes the surface */
    double corner[3]; /* of the quantisation lattice, node's unit; origin included */
    double step;      /* node's unit: position = corner + step * stored */
    double m[12];     /* node to world; all 0: identity */
    /* Beyond the paper: every surfel decides for itself with its own distance, whether those before
     * it close the surface there. */
    double size;  /* pixels of a disc that is wanted; 0: all of the prefix is drawn */
    double slack; /* as in pbs_profile */
} pbs_surfels;

/* Bytes of a record with these channels. */
uint32_t pbs_surfel_size(uint32_t channels);

/* Discs are never smaller than about a pixel, so none vanishes. Errors: PBS_INTERNAL for a stride
 * that does not fit; PBS_LIMIT. */
pbs_code pbs_canvas_surfels(pbs_canvas *canvas, const pbs_surfels *nodes, size_t count,
                            pbs_err *err);

/* A chunk of cells, as cubes. Weights are not looked at; without normals a face has its own. */
typedef struct pbs_cubes {
    GLuint buffer;  /* that the arrays are in; 0: they are in the host's memory */
    uint64_t at;    /* bytes in it, a multiple of 4: the arrays' words count from there */
    uint32_t count; /* voxels */
    int32_t place, normal, colour, material, emissive; /* arrays: words; -1: there is none */
    int32_t face, faces; /* likewise: where a voxel's faces begin in the list of their attributes */
    uint32_t face_count; /* of the list */
    bool face_colours;   /* it has colours u8x4, else numbers of materials */
    GLuint faces_buffer; /* that the list is in, with `faces` from `faces_at` on; 0: in `buffer` */
    uint64_t faces_at;
    bool again;               /* more voxels of the node before, which lies in several buffers */
    const pbs_voxels *chunks; /* in the host's memory: the voxels, in any number of parts */
    size_t chunk_count;
    double corner[3], side; /* of cell 0, 0, 0; of a cell; node's unit */
    double m[12];           /* node to world */
} pbs_cubes;

/* Colours and so on of materials, by the number that faces' attributes have. Borrowed until the
 * next call. */
typedef struct pbs_palette {
    const pbs_material *materials;
    size_t count;
} pbs_palette;

/* frame: of each node it is noted whether a pixel of it was in the picture when it was drawn, for
 * pbs_canvas_seen. 0: it is not; the frame's number otherwise, which is not that of the two before.
 * Errors: PBS_LIMIT, PBS_INTERNAL. */
typedef struct pbs_voxel_mode {
    uint64_t frame;
    uint32_t first, all; /* number of the first node among all draws of the frame, and of those */
    bool probes;         /* the note is all that is wanted: neither colour nor depth is written */
    pbs_palette palette;
} pbs_voxel_mode;
/* mode NULL: as they are, and nothing is noted. */
pbs_code pbs_canvas_voxels(pbs_canvas *canvas, const pbs_cubes *nodes, size_t count,
                           const pbs_voxel_mode *mode, pbs_err *err);

/* The notes of the frame before the last one that was noted, so that nothing waits for the GPU;
 * last: of the last one. seen[i], i < *count, belongs to the canvas until the next call; *frame 0:
 * there are none. */
pbs_code pbs_canvas_seen(pbs_canvas *canvas, bool last, uint64_t *frame, const uint32_t **seen,
                         size_t *count, pbs_err *err);

/* Source geometry that lies in storage buffers: triangles of a mesh, which has at most 2^16
 * vertices. */
typedef struct pbs_placed_mesh {
    GLuint buffer;
    uint32_t first, count; /* triangles */
    uint32_t material;     /* of all, where they have none of their own; PBS_NONE: white */
    int64_t position, normal, uv, colour, index, triangle_material; /* arrays, as in pbs_mesh: bytes
                                                                       in the buffer; -1: there is
                                                                       none */
    const pbs_material *look; /* the material of all; NULL, or without uv: they have no textures */
    GLuint texture[3];        /* of it: base, material, emission; 0: white */
    double origin[3];         /* that positions are relative to, node's unit */
    double m[12];             /* node to world */
} pbs_placed_mesh;

/* Two-sided. Errors: PBS_LIMIT, PBS_INTERNAL. */
pbs_code pbs_canvas_triangles(pbs_canvas *canvas, const pbs_placed_mesh *meshes, size_t count,
                              const pbs_palette *palette, pbs_err *err);

/* Draw calls since pbs_canvas_begin, of what lies in storage buffers. */
uint64_t pbs_canvas_calls(const pbs_canvas *canvas);
/* The table that it draws with. */
const pbs_gl *pbs_canvas_gl(const pbs_canvas *canvas);

/* Source geometry. Two-sided; a mesh without normals is flat. Blended materials count as opaque,
 * as they do for the surfels (gbuffer.h). */
typedef struct pbs_meshes {
    const pbs_draw *draws; /* m takes the mesh to the world; neighbours with the same mesh are
                              uploaded once */
    size_t draw_count;
    const pbs_material *materials;
    size_t material_count;
    const pbs_image *textures; /* rgba NULL: counts as white */
    size_t texture_count;
} pbs_meshes;

/* Textures that are too large for the device are drawn with less detail. Errors: PBS_LIMIT for
 * memory. */
pbs_code pbs_canvas_meshes(pbs_canvas *canvas, const pbs_meshes *scene, pbs_err *err);

/* The picture onto the window whose context is current; the caller swaps the buffers. */
pbs_code pbs_canvas_present(pbs_canvas *canvas, pbs_err *err);

/* out->rgba belongs to the caller: pbs_free. rgb is the finished picture on its background, alpha
 * is coverage: 0 where nothing was drawn. Rows top down. */
pbs_code pbs_canvas_end(pbs_canvas *canvas, pbs_image *out, pbs_err *err);
#endif
