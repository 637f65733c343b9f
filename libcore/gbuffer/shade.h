/* shade.h: what a point of a surface looks like: colour, material, emission (paper 1, section
 * 3.1), and whether it is there at all (masked materials).
 */
#ifndef PBS_SHADE_H
#define PBS_SHADE_H

#include "libcore/gbuffer/gbuffer.h"
#include "libcore/data/lanes.h"
#include "libcore/data/texture.h"

/* What of a material does not depend on the point. */
typedef struct pbs_plain {
    const pbs_texture *base, *material, *emissive; /* NULL: no texture */
    uint8_t colour[4], finish[4], glow[4];         /* without textures and vertex colours */
} pbs_plain;

struct pbs_surfaces {
    const pbs_material *materials;
    uint32_t count;
    uint32_t channels;
    bool masked; /* whether there are masked materials */
    const pbs_srgb_table *srgb;
    pbs_plain *flat;      /* count + 1: the last is for PBS_NONE; NULL: no channel needs it */
    pbs_texture *texture; /* 2 an image: as sRGB, as plain numbers */
    size_t textures;
};

/* Whether pbs_surfaces_asks can say yes for a triangle of this mesh. */
bool pbs_surfaces_may_ask(const pbs_surfaces *s, const pbs_mesh *mesh);
/* Whether fragments of the triangle must be asked for with pbs_surfaces_keep. */
bool pbs_surfaces_asks(const pbs_surfaces *s, const pbs_mesh *mesh, uint32_t triangle);
bool pbs_surfaces_keep(const pbs_surfaces *s, const pbs_lanes *b, int lane);

/* For a lane with barycentric coordinates. Record formats as in record.h. Opaque and masked
 * surfaces have alpha 255. */
void pbs_surfaces_colour(const pbs_surfaces *s, const pbs_lanes *b, int lane, uint8_t out[4]);
void pbs_surfaces_material(const pbs_surfaces *s, const pbs_lanes *b, int lane, uint8_t out[4]);
void pbs_surfaces_emissive(const pbs_surfaces *s, const pbs_lanes *b, int lane, uint8_t out[4]);
#endif
