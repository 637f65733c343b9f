/* mend.h: scenes repaired: every part becomes an oriented mesh, through the module "mend".
 *
 * Parts are repaired one by one, in their own coordinates: triangles are turned round or dropped,
 * holes filled between vertices that are there; no vertex moves. What corners carry goes with
 * them. Where the normals of a triangle's corners point against it on the whole, they are turned.
 * A part that needs nothing comes out as it was.
 */
#ifndef PBS_MEND_H
#define PBS_MEND_H

#include "formats/readers/module.h"
#include "formats/scene/scene.h"

typedef struct pbs_mend_options {
    uint64_t fill;      /* holes of at most so many edges are filled; 0: none */
    bool intersections; /* count triangles that cut each other */
    /* Told of each part that CGAL gives up on, which stays as it is. NULL: that is an error. */
    void (*failed)(void *ctx, const pbs_err *err);
    void *failed_ctx;
} pbs_mend_options;

typedef struct pbs_mend_totals {
    uint64_t parts; /* with triangles, each once */
    uint64_t counts[PBS_MEND_COUNTS];
} pbs_mend_totals;

/* The names of counts in statistics: "closed_before". */
extern const char *const pbs_mend_count_name[PBS_MEND_COUNTS];

/* Hands the scene with its parts repaired to the writer; the caller ends that. Nodes keep their
 * names and places. Errors: PBS_IO without the module, PBS_LIMIT, PBS_DATA. */
pbs_code pbs_scene_mend(const pbs_scene *s, const pbs_mend_options *options, pbs_scene_writer *to,
                        pbs_mend_totals *totals, pbs_err *err);
#endif
