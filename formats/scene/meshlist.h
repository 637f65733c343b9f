/* meshlist.h: the meshes of the part that is being read, kept until it is known what becomes of
 * them: in memory up to a budget, in a temporary file beyond. */
#ifndef PBS_MESHLIST_H
#define PBS_MESHLIST_H

#include "formats/container/digest.h"
#include "formats/scene/meshbuild.h"
#include "formats/container/scratch.h"

typedef struct pbs_meshlist {
    pbs_run *run;
    size_t budget; /* bytes; set by the owner before the first use */
    uint64_t count, triangles;
    pbs_digest digest; /* of all payloads */
    uint8_t *bytes;
    size_t used, room;
    bool spilled;
    pbs_output spool;
    pbs_input map; /* of the spool, once it is read */
    pbs_trim trim;
} pbs_meshlist;

/* As pbs_mesh_out's. */
pbs_code pbs_meshlist_add(void *list, uint32_t triangles, const pbs_piece *piece, int pieces,
                          pbs_err *err);
/* After the last one, before they are read. */
pbs_code pbs_meshlist_end(pbs_meshlist *l, pbs_err *err);
/* The mesh at *at, which begins at 0 and goes on; false behind the last one. *bytes is its payload.
 */
bool pbs_meshlist_next(const pbs_meshlist *l, uint64_t *at, pbs_mesh *mesh, const void **payload,
                       size_t *bytes);
/* Empties it, for the next part. */
void pbs_meshlist_clear(pbs_meshlist *l);
void pbs_meshlist_free(pbs_meshlist *l);
#endif
