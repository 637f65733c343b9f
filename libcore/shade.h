/* shade.h: what a point of a surface looks like: colour, material, emission (paper 1, section
 * 3.1), and whether it is there at all (masked materials).
 */
#ifndef PBS_SHADE_H
#define PBS_SHADE_H

#include "libcore/gbuffer.h"
#include "libcore/lanes.h"
#include "libcore/texture.h"

/* What of a material does not depend on the point. */
typedef struct pbs_plain {
    const pbs_texture *base, *material, *emissive; /* NULL: no texture */
    uint8_t colour[4], finish[4], glow[4];         /* without textures and vertex colours */
} pbs_plain;

typedef struct pbs_shader {
    const pbs_material *materials;
    uint32_t count;
    uint32_t channels;
    bool masked; /* whether there are masked materials */
    const pbs_srgb_table *srgb;
    pbs_plain *flat;      /* count + 1: the last is for PBS_NONE */
    pbs_texture *texture; /* 2 an image: as sRGB, as plain numbers */
    size_t textures;
} pbs_shader;

/* Builds the pyramids of those textures that the draws can show in these channels. Errors:
 * PBS_LIMIT. pbs_shader_free also after an error. */
size_t pbs_shader_need(const pbs_gbuffer_scene *scene, uint32_t channels);
pbs_code pbs_shader_init(pbs_run *run, pbs_shader *s, const pbs_gbuffer_scene *scene,
                         uint32_t channels, pbs_err *err);
void pbs_shader_free(pbs_run *run, pbs_shader *s);

/* Whether fragments of the triangle must be asked for with pbs_shader_keep. */
bool pbs_shader_asks(const pbs_shader *s, const pbs_mesh *mesh, uint32_t triangle);
bool pbs_shader_keep(const pbs_shader *s, const pbs_lanes *b, int lane);

/* For a lane with barycentric coordinates. Record formats as in record.h. Opaque and masked
 * surfaces have alpha 255. */
void pbs_shader_colour(const pbs_shader *s, const pbs_lanes *b, int lane, uint8_t out[4]);
void pbs_shader_material(const pbs_shader *s, const pbs_lanes *b, int lane, uint8_t out[4]);
void pbs_shader_emissive(const pbs_shader *s, const pbs_lanes *b, int lane, uint8_t out[4]);
#endif
