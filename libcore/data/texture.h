/* texture.h: mip pyramid of an image, and the filtered look-up.
 *
 * Filtering is done in linear light. Every level is the exact area average of the one below it,
 * of odd sizes too, so the top level is the image's mean.
 */
#ifndef PBS_TEXTURE_H
#define PBS_TEXTURE_H

#include "libcore/data/mesh.h"
#include "libcore/ground/run.h"
#include "libcore/data/srgb.h"

#define PBS_TEXTURE_LEVELS 32

typedef struct pbs_texture {
    const pbs_srgb_table *table;
    int levels; /* 0: no picture, everything is white */
    bool srgb;  /* how r, g, b are stored; alpha is linear always */
    uint32_t width[PBS_TEXTURE_LEVELS], height[PBS_TEXTURE_LEVELS];
    const uint8_t *level[PBS_TEXTURE_LEVELS]; /* level 0 is the image's own */
    uint8_t *own;                             /* the others */
} pbs_texture;

/* Bytes that pbs_texture_build takes. */
size_t pbs_texture_need(const pbs_image *image);

/* image is borrowed as long as the texture lives; an image without pixels gives white. srgb
 * false: r, g, b are plain numbers (metallic, roughness). Errors: PBS_LIMIT. */
pbs_code pbs_texture_build(pbs_run *run, const pbs_image *image, bool srgb, pbs_texture *out,
                           pbs_err *err);
void pbs_texture_free(pbs_run *run, pbs_texture *texture);

/* out: linear r, g, b and alpha around uv, averaged over about a pixel of the view; trilinear.
 * dx, dy: how uv changes from that pixel to its neighbours; the longer of the two decides the
 * level. All three before use->transform, which is applied here. Not finite: the level with
 * least detail, or uv 0. */
void pbs_texture_sample(const pbs_texture *texture, const pbs_texture_use *use, const double uv[2],
                        const double dx[2], const double dy[2], float out[4]);
#endif
