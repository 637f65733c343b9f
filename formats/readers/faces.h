/* faces.h: what the readers of OBJ, PLY and STL have in common on their way to the sink: polygons
 * become triangles, parts become a scene. */
#ifndef PBS_FACES_H
#define PBS_FACES_H

#include "formats/readers/sink.h"
#include "formats/readers/text.h"

/* How many elements a reader handles between two looks at run->cancel. */
enum { PBS_CHECK_EVERY = 1 << 16 };
/* How many elements that may be anywhere in a map it reads between two calls of pbs_trim_now. */
enum { PBS_TRIM_EVERY = 1 << 8 };

typedef struct pbs_faces {
    const pbs_sink *sink;
    pbs_corner *corner; /* of the polygon that is being read; fill it after pbs_faces_reserve */
    size_t corners;     /* room in it */
    uint32_t *triangle;
    void *scratch;
    size_t triangles, scratch_size;
    pbs_child *part; /* the nodes of the parts that have ended */
    size_t parts, parts_room;
} pbs_faces;

/* Makes room for n corners and keeps those that are there. */
pbs_code pbs_faces_reserve(pbs_faces *f, size_t n, pbs_err *err);
/* Hands corner[0 .. n-1] over as n - 2 triangles; fewer than 3 are counted as PBS_SKIP_POLYGON. */
pbs_code pbs_faces_polygon(pbs_faces *f, size_t n, uint32_t material, pbs_err *err);
/* part_end, and remembers the node. */
pbs_code pbs_faces_part_end(pbs_faces *f, pbs_err *err);
/* Calls root: with an assembly of that name holding all parts where they are. */
pbs_code pbs_faces_root(pbs_faces *f, const char *name, pbs_err *err);
void pbs_faces_free(pbs_faces *f);

/* The file's name without its folder and its ending. */
void pbs_file_stem(char out[PBS_NAME_MAX], const char *path);
#endif
