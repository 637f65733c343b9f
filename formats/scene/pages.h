/* pages.h: the pages of a scene's meshes, given back while threads read them in any order. */
#ifndef PBS_PAGES_H
#define PBS_PAGES_H

#include "formats/scene/scene.h"
#include "formats/container/scratch.h"

typedef struct pbs_pages {
    pbs_trim trim;
    uint64_t seen; /* triangles; atomic */
} pbs_pages;

/* beside: what is read together with the meshes; NULL: nothing. It goes when the pages do. */
void pbs_pages_open(const pbs_scene *s, const pbs_scratch *beside, pbs_pages *p);
/* Tells that so many triangles were read. Thread-safe, nearly always free. */
void pbs_pages_saw(pbs_pages *p, uint64_t triangles);
void pbs_pages_close(pbs_pages *p);
#endif
