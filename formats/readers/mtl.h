/* mtl.h: the materials of an OBJ file, and the textures that OBJ and PLY files refer to. */
#ifndef PBS_MTL_H
#define PBS_MTL_H

#include "formats/readers/sink.h"
#include "formats/readers/text.h"

/* A table from names to ids. */
typedef struct pbs_names {
    struct pbs_name {
        size_t text, length;
        uint32_t id, hash;
    } * entry;
    size_t count, room;
    char *text;
    size_t text_used, text_room;
    uint32_t *slot; /* entry number + 1, 0: free; the number of slots is a power of two */
    size_t slots;
} pbs_names;

typedef struct pbs_mtl {
    const pbs_sink *sink;
    const char *path; /* of the file that refers to others; its folder is where they are */
    pbs_names materials, textures, libraries;
} pbs_mtl;

/* Reads the libraries that the rest of a mtllib line names: one name with blanks if there is such
 * a file, else several. Hands textures and materials to the sink. One that is not there is told
 * with sink->missing. */
pbs_code pbs_mtl_load(pbs_mtl *m, pbs_span names, pbs_err *err);
/* The material's id, or PBS_NONE. */
uint32_t pbs_mtl_find(const pbs_mtl *m, pbs_span name);
/* The texture's id; every file is handed over once. other: a second folder (up to its slash) to
 * look in, or NULL. */
pbs_code pbs_mtl_texture(pbs_mtl *m, pbs_span name, const char *other, uint32_t *id, pbs_err *err);
void pbs_mtl_free(pbs_mtl *m);
#endif
