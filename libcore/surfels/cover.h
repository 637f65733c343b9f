/* cover.h: which of some surfels each candidate of a tree is nearest to, exactly.
 *
 * Not a query per candidate but a walk per surfel: it lowers the d of the candidates within a
 * radius, eight at a time, and where it does becomes their owner. A candidate that holds at most
 * the square of that radius then is right; for the others the radius is doubled. Surfels may come
 * in several goes, each with its own radius, so the octaves of a greedy order cost little more
 * than the finest of them: their radii are known.
 */
#ifndef PBS_COVER_H
#define PBS_COVER_H

#include "libcore/surfels/candidates.h"

#define PBS_NOBODY UINT32_MAX

/* A surfel: its candidate's slot in the tree, and its place in the order. */
typedef struct pbs_cover_surfel {
    uint32_t slot, rank;
} pbs_cover_surfel;

typedef enum pbs_cover_kind {
    PBS_COVER_METRIC, /* D of tree->metric */
    PBS_COVER_SIDE,   /* Euclid; infinite unless n.n' > 0 */
    PBS_COVER_OTHERS  /* as METRIC; no surfel covers its own slot */
} pbs_cover_kind;

typedef struct pbs_cover {
    pbs_tree *tree;  /* its d are overwritten: squares of the distances, scaled */
    uint32_t *owner; /* of each slot (leaves * PBS_LEAF): a rank, or PBS_NOBODY */
    pbs_cover_kind kind;
} pbs_cover;

/* Nobody owns anything. */
pbs_code pbs_cover_begin(pbs_run *run, const pbs_cover *c, pbs_err *err);

/* Adds surfels, best in the order of their slots. radius2: a guess of the largest D^2 (scaled)
 * that will remain; a bad one costs time only. once: nothing beyond it is asked for, and a d above
 * it may be too large. Ties belong to the lower rank; a candidate at an infinite distance from all
 * to nobody. The second is the same for CPUs that have AVX2. */
pbs_code pbs_cover_add(pbs_run *run, const pbs_cover *c, const pbs_cover_surfel *surfels,
                       size_t count, float radius2, bool once, pbs_err *err);
pbs_code pbs_cover_add_avx2(pbs_run *run, const pbs_cover *c, const pbs_cover_surfel *surfels,
                            size_t count, float radius2, bool once, pbs_err *err);

/* The square, scaled, of a length in the caller's unit, somewhat above it. Infinite for the
 * diagonal, which stands for all that is longer. */
float pbs_cover_radius2(const pbs_metric *m, double length);

/* Finds the slots of the first `count` candidates of order[], in the order of the slots. scratch:
 * a number for each candidate of the caller. */
void pbs_cover_find(const pbs_tree *t, const uint32_t *order, size_t count, uint32_t *scratch,
                    size_t candidates, pbs_cover_surfel *out);
#endif
