/* meshbuild.h: triangles in, MESH chunks out: cuts a part into meshes of at most
 * PBS_MESH_VERTICES vertices and welds corners that are equal bit for bit. */
#ifndef PBS_MESHBUILD_H
#define PBS_MESHBUILD_H

#include "formats/container.h"
#include "formats/sink.h"

typedef struct pbs_builder pbs_builder;

pbs_code pbs_builder_new(pbs_run *run, pbs_writer *w, pbs_builder **out, pbs_err *err);
void pbs_builder_free(pbs_builder *b);

/* node: the id the part is going to have. */
void pbs_builder_begin(pbs_builder *b, uint32_t node, const double origin[3], uint32_t corners);
pbs_code pbs_builder_triangle(pbs_builder *b, const pbs_corner corner[3], uint32_t material,
                              pbs_err *err);
/* box: in the part's coordinates, of what was kept, as stored. */
pbs_code pbs_builder_end(pbs_builder *b, uint64_t *triangles, pbs_box *box, pbs_err *err);
/* Triangles left out since the builder is there: by PBS_SKIP_NONFINITE, PBS_SKIP_DEGENERATE. */
void pbs_builder_skips(const pbs_builder *b, uint64_t skipped[PBS_SKIP_KINDS]);

/* The MESH chunk as a mesh; pointers go into the chunk. Errors: PBS_DATA, everything is checked. */
pbs_code pbs_mesh_parse(const char *place, const pbs_chunk *chunk, pbs_mesh *out, pbs_err *err);
#endif
