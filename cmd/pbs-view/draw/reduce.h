/* reduce.h: points with a continuous level of detail (paper 3, section 3.3): a compute pass looks
 * at every record that is on the device and copies those that the camera needs into one buffer,
 * which is drawn by one indirect call. What it draws is independent of nodes, levels and their
 * borders.
 *
 *     pbs_reduce_step(r, &camera, aspect, nodes, count, &options, &whole, err);   every frame
 *     pbs_reduce_draw(r, canvas, &options, err);
 *
 * A pass over all nodes may take several frames; what is drawn is what the last whole one left, so
 * it looks at more than the picture shows, and draws for the camera as it is.
 */
#ifndef PBS_REDUCE_H
#define PBS_REDUCE_H

#include "cmd/pbs-view/draw/resident.h"

typedef struct pbs_reduce pbs_reduce;

typedef struct pbs_reduce_options {
    double spacing;     /* wanted, thousandths of the distance (the paper's CLOD); 0: 1 */
    bool periphery;     /* less density away from the middle, for head-mounted displays:
                           spacing / max(1 - fall * distance from the middle, least) */
    double fall, least; /* 0: 0.5, 0.3 */
    double wide;        /* of the picture's half extents, how far points are taken; 0: 2 */
    bool steps;      /* spacings as they are; otherwise, where levels have one spacing each, every
                        point's is divided by its own number from 1 to 2, always the same */
    double fade;     /* points grow to their size until the wanted spacing has fallen to this
                        share of their own; 0: 0.8 */
    double size;     /* diameter in wanted spacings; 0: 1 */
    double smallest; /* least diameter, world units: how far apart the scanner's points are */
    bool cast;       /* pbs_reduce_draw does what pbs_reduce_cast does */
    uint64_t step;   /* records that a step looks at; 0: 16777216 */
} pbs_reduce_options;

/* most: points kept at most, 0: 4000000; more are left out, whichever come last. Errors:
 * PBS_LIMIT, PBS_INTERNAL. */
pbs_code pbs_reduce_new(pbs_run *run, const pbs_gl *gl, uint32_t most, pbs_reduce **out,
                        pbs_err *err);
void pbs_reduce_free(pbs_reduce *r); /* NULL is fine */

/* Goes on with the pass, or begins the next one with this camera. In one pass every node is looked
 * at once, in the call in which there is room for it, with the record and the place it has there;
 * nodes that come while it runs are part of it, too. *whole: the pass is
 * done, and drawn from now on. Records without a spacing, which are at the place of others, are
 * never taken. Errors: PBS_LIMIT, PBS_INTERNAL. */
pbs_code pbs_reduce_step(pbs_reduce *r, const pbs_camera *camera, double aspect,
                         const pbs_resident *nodes, size_t count, const pbs_reduce_options *options,
                         bool *whole, pbs_err *err);

/* Nothing before the first whole pass. Points without normals face the eye; materials and emission
 * are not shown. Errors: PBS_INTERNAL. */
pbs_code pbs_reduce_draw(pbs_reduce *r, pbs_canvas *canvas, const pbs_reduce_options *options,
                         pbs_err *err);

/* The same without the rasteriser: a compute pass goes through the pixels under each point and
 * keeps the nearest, with 64-bit atomics where the device has them, else in two runs. One sample a
 * pixel, and all points face the eye. Errors: PBS_LIMIT, PBS_INTERNAL. */
pbs_code pbs_reduce_cast(pbs_reduce *r, pbs_canvas *canvas, const pbs_reduce_options *options,
                         pbs_err *err);

/* A point of the last whole pass, in the view coordinates of its camera. */
typedef struct pbs_reduced {
    float position[3], spacing; /* spacing: as compared, so divided already */
    uint8_t colour[4];
    int16_t normal[2]; /* octahedral, view coordinates; -32768, -32768: none */
} pbs_reduced;

/* How many; waits for the device. *lost: those that there was no room for. */
pbs_code pbs_reduce_count(pbs_reduce *r, uint64_t *kept, uint64_t *lost, pbs_err *err);
/* They themselves, in no particular order; *out belongs to the caller: pbs_free. */
pbs_code pbs_reduce_read(pbs_reduce *r, pbs_reduced **out, size_t *count, pbs_err *err);

/* What the spacing of a record is multiplied with: 2^-((n + 0.5) / 256), n from 0 to 255 by a hash
 * of the node's key and the record's index. */
float pbs_reduce_share(uint64_t key, uint32_t index);
#endif
