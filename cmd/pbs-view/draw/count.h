/* count.h: draw calls and uploaded bytes, whoever makes them: the counter stands between the player
 * and the driver in the table of functions, so no painter has to keep books.
 *
 * What is written through a map that stays open is counted when it is flushed.
 */
#ifndef PBS_COUNT_H
#define PBS_COUNT_H

#include "cmd/pbs-view/draw/gl.h"

typedef struct pbs_counts {
    uint64_t draws;      /* calls that draw, with any number of instances or indirect draws */
    uint64_t dispatches; /* of compute shaders */
    uint64_t bytes;      /* to buffers and textures */
} pbs_counts;

/* Puts the counter into a table that pbs_gl_load filled; there is one in each thread. */
void pbs_count_open(pbs_gl *gl);
/* Since the last call, which sets them back to 0. */
pbs_counts pbs_count_take(void);
#endif
