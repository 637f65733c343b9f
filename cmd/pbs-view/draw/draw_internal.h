/* draw_internal.h: what the files that draw share: draw.c (target), draw_batch.c (numbers of many
 * nodes at once), draw_look.c (materials), draw_disc.c, draw_mesh.c, draw_near.c and
 * draw_voxel.c. */
#ifndef PBS_DRAW_INTERNAL_H
#define PBS_DRAW_INTERNAL_H

#include "cmd/pbs-view/draw/draw.h"
#include "cmd/pbs-view/draw/draw_texture.h"

#define PBS_GLSL_VERSION "#version 450 core\n"

/* Made when the first discs come; 0: not yet. */
typedef struct disc_painter {
    GLuint program, array;
    GLint smallest, samples;
} disc_painter;

/* The numbers of many nodes, uploaded at once: a uniform block for each. */
enum { PBS_BLOCK = 256 }; /* bytes of one; every device can bind at multiples of this */
typedef struct batch {
    GLuint buffer;
    uint8_t *blocks; /* the host's copy */
    size_t cap;
} batch;

/* Framebuffer and its renderbuffers; 0: none. */
typedef struct target {
    GLuint frame, colour, depth;
} target;

/* Triangles of one material in the index buffer. */
typedef struct material_run {
    uint32_t material, first, count;
} material_run;

typedef struct mesh_painter {
    GLuint program, vertices, indices, array;
    /* The mesh that is in the buffers now; valid during one call. */
    const pbs_mesh *uploaded;
    material_run *runs;
    size_t run_count, run_room;
    uint64_t *order;
    uint16_t *index;
    uint8_t *corner;
    size_t order_room, index_room, corner_room;
} mesh_painter;

/* Made when the first voxels come; 0: not yet. */
typedef struct voxel_painter {
    GLuint program, probing, indices, array; /* probing: the same, with notes of what is seen */
    GLint batch, note_batch;
} voxel_painter;

/* Source geometry that is in the GPU's memory. Made when the first comes; 0: not yet. */
typedef struct near_painter {
    GLuint program, textured, array;
} near_painter;

/* What stands for textures that are not there, and how textures are looked up. */
typedef struct wardrobe {
    GLuint white;      /* 0: nothing has been made yet */
    GLuint sampler[9]; /* 3 * wrap_u + wrap_v */
} wardrobe;

/* What was seen, of the last two frames; frame 0: none. */
typedef struct notes {
    GLuint buffer;
    uint64_t frame;
    uint32_t count, room;
} notes;

struct pbs_canvas {
    pbs_run *run;
    const pbs_gl *gl;
    uint32_t width, height;
    int samples;
    size_t counted; /* bytes taken with pbs_mem_take */
    target draw, resolved;
    pbs_camera camera;
    pbs_camera begun; /* that of pbs_canvas_begin, between the eyes */
    uint64_t frames;  /* begun so far */
    pbs_columns columns;
    double aspect; /* of `wide` columns */
    GLuint stream; /* the host's records go through it */
    batch batch;
    disc_painter disc;
    mesh_painter mesh;
    voxel_painter voxel;
    near_painter near;
    wardrobe wardrobe;
    notes notes[2];
    uint32_t *seen; /* the host's copy */
    size_t seen_cap;
    GLuint palette;
    const pbs_material *palette_of; /* that it holds */
    uint64_t calls;                 /* draw calls since the last begin */
    struct pbs_passes *passes;      /* passes.c; NULL: none so far */
};

void pbs_mesh_painter_init(pbs_canvas *c);
void pbs_mesh_painter_free(pbs_canvas *c);
void pbs_disc_painter_free(pbs_canvas *c);
void pbs_voxel_painter_free(pbs_canvas *c);
void pbs_near_painter_free(pbs_canvas *c);
void pbs_wardrobe_free(pbs_canvas *c);
void pbs_batch_free(pbs_canvas *c);
void pbs_passes_free(pbs_canvas *c);

/* Room for so many cleared blocks in the host's memory: c->batch.blocks. */
pbs_code pbs_batch_begin(pbs_canvas *c, size_t nodes, pbs_err *err);
void pbs_batch_send(pbs_canvas *c, size_t nodes);
/* Node i's becomes uniform block 0. */
void pbs_batch_use(const pbs_canvas *c, size_t i);
static inline void *pbs_batch_block(const pbs_canvas *c, size_t i) {
    return c->batch.blocks + i * PBS_BLOCK;
}

/* Binds the materials as storage buffer 3; behind them is the one of what has none. */
pbs_code pbs_canvas_palette(pbs_canvas *c, const pbs_palette *palette, pbs_err *err);
/* Binds a material's textures (base, material, emission; 0: white) to units 0 to 2, and how they
 * are looked up, until the undressing. */
void pbs_canvas_wear(pbs_canvas *c, const pbs_material *m, const GLuint texture[3]);
void pbs_canvas_undress(const pbs_canvas *c);
/* Puts the host's pieces, one behind the other, into the stream buffer in place of what was there.
 * (What was drawn from it before keeps its own memory: the driver gives out a new one.) Errors:
 * PBS_LIMIT for more than a storage buffer holds. */
pbs_code pbs_canvas_stream(pbs_canvas *c, const void *const *piece, const size_t *size, int pieces,
                           pbs_err *err);

/* Viewport and scissor of the columns that are drawn. */
void pbs_canvas_window(const pbs_canvas *c);
/* Makes the program current and sets what the camera determines. */
void pbs_canvas_view_uniforms(const pbs_canvas *c, GLuint program);
/* Three rows of `columns` numbers each, times scale. */
void pbs_canvas_matrix(const pbs_gl *gl, GLint place, int columns, const double *m, double scale);
void pbs_canvas_normal_matrix(const pbs_gl *gl, GLint place, const double m[12]);
/* The same as three rows of four floats, for a batch. normal: cofactors, the largest 1. */
void pbs_rows(float out[3][4], const double m[12], double scale);
void pbs_normal_rows(float out[3][4], const double m[12]);
#endif
