/* draw_internal.h: what draw.c (target, discs), draw_mesh.c (triangles) and draw_voxel.c share. */
#ifndef PBS_DRAW_INTERNAL_H
#define PBS_DRAW_INTERNAL_H

#include "cmd/pbs-view/draw.h"

#define PBS_GLSL_VERSION "#version 450 core\n"

enum { PBS_CANVAS_STREAM = 8 << 20 }; /* bytes of the buffer that records go through */

/* Framebuffer and its renderbuffers; 0: none. */
typedef struct target {
    GLuint frame, colour, depth;
} target;

/* Triangles of one material in the index buffer. */
typedef struct material_run {
    uint32_t material, first, count;
} material_run;

typedef struct mesh_painter {
    GLuint program, vertices, indices, array, white;
    GLuint sampler[9]; /* 3 * wrap_u + wrap_v */
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
    GLuint program, indices, array;
} voxel_painter;

struct pbs_canvas {
    pbs_run *run;
    const pbs_gl *gl;
    uint32_t width, height;
    int samples;
    size_t counted; /* bytes taken with pbs_mem_take */
    target draw, resolved;
    pbs_camera camera;
    double aspect;
    GLuint disc, stream, no_vertices;
    size_t stream_at;
    mesh_painter mesh;
    voxel_painter voxel;
    struct pbs_retained *retained; /* retained.c; NULL: nothing is */
};

void pbs_mesh_painter_init(pbs_canvas *c);
void pbs_mesh_painter_free(pbs_canvas *c);
void pbs_voxel_painter_free(pbs_canvas *c);
void pbs_retained_free(pbs_canvas *c);

/* Makes room for so many bytes in the stream buffer, without a restart between them. What was
 * drawn from it before keeps its own memory: the driver gives out a new one when the buffer starts
 * again. (llvmpipe does not, but it has run the vertex shaders by then. Fragment shaders must not
 * read this buffer.) */
void pbs_canvas_room(pbs_canvas *c, size_t size);
/* Returns the word of the stream buffer where the bytes lie now. */
GLuint pbs_canvas_upload(pbs_canvas *c, const void *bytes, size_t size);

/* Makes the program current and sets what the camera determines. */
void pbs_canvas_view_uniforms(const pbs_canvas *c, GLuint program);
/* Three rows of `columns` numbers each, times scale. */
void pbs_canvas_matrix(const pbs_gl *gl, GLint place, int columns, const double *m, double scale);
void pbs_canvas_normal_matrix(const pbs_gl *gl, GLint place, const double m[12]);
#endif
