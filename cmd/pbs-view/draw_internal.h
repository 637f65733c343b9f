/* draw_internal.h: what draw.c (target, discs) and draw_mesh.c (triangles) share. */
#ifndef PBS_DRAW_INTERNAL_H
#define PBS_DRAW_INTERNAL_H

#include "cmd/pbs-view/draw.h"

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
};

void pbs_mesh_painter_init(pbs_canvas *c);
void pbs_mesh_painter_free(pbs_canvas *c);

/* Makes the program current and sets what the camera determines. */
void pbs_canvas_view_uniforms(const pbs_canvas *c, GLuint program);
/* Three rows of `columns` numbers each, times scale. */
void pbs_canvas_matrix(const pbs_gl *gl, GLint place, int columns, const double *m, double scale);
void pbs_canvas_normal_matrix(const pbs_gl *gl, GLint place, const double m[12]);
#endif
