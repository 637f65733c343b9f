/* motions.h: how placings move, in files: the ANIM and MOTN chunks, the same in every kind of file.
 *
 * An animation is a name and a number; motions say in which animations they take part. A motion
 * (libcore/data/motion.h) belongs to any number of placings, which name it: pbs_child.motion is
 * its number + 1. The pose that it makes takes the place of the whole transform of such a placing,
 * so what stages do with nodes, groups and parts must never put the transform of a placing that has
 * a motion together with another one; they place what moves under an assembly of its own instead.
 *
 * Equal motions are one, so that equal assemblies whose children move alike are one, too.
 */
#ifndef PBS_MOTIONS_H
#define PBS_MOTIONS_H

#include "formats/container/container.h"
#include "formats/scene/node.h"
#include "libcore/data/motion.h"

#define PBS_TAG_ANIMATION PBS_TAG('A', 'N', 'I', 'M')
#define PBS_TAG_MOTION    PBS_TAG('M', 'O', 'T', 'N')

static inline bool pbs_is_motion(uint32_t tag) {
    return tag == PBS_TAG_ANIMATION || tag == PBS_TAG_MOTION;
}

typedef struct pbs_animation {
    char *name; /* "" for none */
    double end; /* time of the last key of all motions; 0: there is none */
} pbs_animation;

typedef struct pbs_motions {
    pbs_animation *animations;
    size_t animation_count, animation_cap;
    pbs_motion *motions; /* by number */
    size_t count, cap;
} pbs_motions; /* all zero: none */

/* ---- writing ---- */

pbs_code pbs_animation_write(pbs_writer *w, uint32_t number, const char *name, pbs_err *err);
/* The payload of a motion, to be freed with pbs_free. */
pbs_code pbs_motion_pack(pbs_run *run, const pbs_motion *motion, uint8_t **out, size_t *size,
                         pbs_err *err);
pbs_code pbs_motion_write(pbs_run *run, pbs_writer *w, uint32_t number, const pbs_motion *motion,
                          pbs_err *err);
/* All of them, for the next stage's stream, in which the nodes' children name the same. */
pbs_code pbs_motions_write(pbs_run *run, pbs_writer *w, const pbs_motions *m, pbs_err *err);

/* ---- reading ---- */

/* Adds what an ANIM or MOTN chunk says. Keys point into the payload, which must stay as long as
 * they are looked at. Errors: PBS_DATA if it is damaged, or not the next one; PBS_LIMIT. place: the
 * file's name. */
pbs_code pbs_motions_take(pbs_run *run, const char *place, const pbs_chunk *chunk, pbs_motions *m,
                          pbs_err *err);
/* Whether the motion that each child names is there: PBS_DATA. */
pbs_code pbs_motions_fit(const char *place, const pbs_motions *m, const pbs_node *nodes,
                         size_t count, pbs_err *err);
void pbs_motions_free(pbs_run *run, pbs_motions *m);
#endif
