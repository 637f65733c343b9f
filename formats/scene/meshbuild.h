/* meshbuild.h: triangles in, MESH chunks out: cuts a part into meshes of at most
 * PBS_MESH_VERTICES vertices and welds corners that are equal bit for bit. */
#ifndef PBS_MESHBUILD_H
#define PBS_MESHBUILD_H

#include "formats/container/container.h"
#include "formats/readers/sink.h"

typedef struct pbs_builder pbs_builder;

/* A corner as it is stored: position relative to the origin of its part. No padding. */
typedef struct pbs_vertex {
    float position[3], uv[2];
    int16_t normal[2];
    uint8_t colour[4];
} pbs_vertex;

/* Where finished meshes go: the payload of a MESH chunk, in pieces. */
typedef struct pbs_mesh_out {
    void *ctx;
    pbs_code (*mesh)(void *ctx, uint32_t triangles, const pbs_piece *piece, int pieces,
                     pbs_err *err);
} pbs_mesh_out;

pbs_code pbs_builder_new(pbs_run *run, pbs_mesh_out to, pbs_builder **out, pbs_err *err);
void pbs_builder_free(pbs_builder *b);

void pbs_builder_begin(pbs_builder *b, const double origin[3], uint32_t corners);
pbs_code pbs_builder_triangle(pbs_builder *b, const pbs_corner corner[3], uint32_t material,
                              pbs_err *err);
/* A triangle that was stored before with the same origin: nothing is rounded or left out. */
pbs_code pbs_builder_stored(pbs_builder *b, const pbs_vertex v[3], uint32_t material, pbs_err *err);
/* box: in the part's coordinates, of what was kept, as stored. */
pbs_code pbs_builder_end(pbs_builder *b, uint64_t *triangles, pbs_box *box, pbs_err *err);
/* Triangles left out since the builder is there: by PBS_SKIP_NONFINITE, PBS_SKIP_DEGENERATE. */
void pbs_builder_skips(const pbs_builder *b, uint64_t skipped[PBS_SKIP_KINDS]);

/* The MESH chunk as a mesh; pointers go into the chunk. Errors: PBS_DATA, everything is checked. */
pbs_code pbs_mesh_parse(const char *place, const pbs_chunk *chunk, pbs_mesh *out, pbs_err *err);

/* A payload that came from a builder, unchecked; returns its size. */
size_t pbs_mesh_view(const void *payload, pbs_mesh *out);
/* Triangle i of it. A mesh without normals gives the triangle's own if `corners` wants some. */
void pbs_mesh_stored(const pbs_mesh *m, uint32_t i, uint32_t corners, pbs_vertex v[3],
                     uint32_t *material);
#endif
