/* hilbert.h: the place of a cell along Hilbert's curve, 8 bits an axis.
 *
 * After Hamilton, Compact Hilbert Indices (2006): a state is the corner where the curve enters a
 * cube and the axis along which it leaves; two levels are one look into a table.
 */
#ifndef PBS_HILBERT_H
#define PBS_HILBERT_H

#include <pthread.h>
#include <stdint.h>

enum { PBS_HILBERT_AXIS = 8, PBS_HILBERT_BITS = 3 * PBS_HILBERT_AXIS };

typedef struct pbs_hilbert {
    uint32_t spread[1 << PBS_HILBERT_AXIS]; /* bit i to bit 3i */
    uint16_t step[24][64];                  /* of two levels' octants: index << 5 | next state */
} pbs_hilbert;

static inline unsigned pbs_rotate3(unsigned v, unsigned by) {
    by %= 3;
    return ((v << by) | (v >> (3 - by))) & 7;
}

/* One level: the octant's place along the curve; *state becomes the one inside it. */
static inline unsigned pbs_hilbert_level(unsigned octant, unsigned *state) {
    static const uint8_t entry[8] = {0, 0, 0, 3, 3, 6, 6, 5}, axis[8] = {0, 1, 1, 2, 2, 1, 1, 0};
    unsigned e = *state / 3, d = *state % 3;
    unsigned g = pbs_rotate3(octant ^ e, 2 - d); /* right by d + 1 */
    unsigned w = g ^ (g >> 1) ^ (g >> 2);
    *state = (e ^ pbs_rotate3(entry[w], d + 1)) * 3 + (d + axis[w] + 1) % 3;
    return w;
}

static inline void pbs_hilbert_fill(pbs_hilbert *h) {
    for (unsigned v = 0; v < 1u << PBS_HILBERT_AXIS; v++) {
        h->spread[v] = 0;
        for (int b = 0; b < PBS_HILBERT_AXIS; b++) h->spread[v] |= (v >> b & 1) << (3 * b);
    }
    for (unsigned s = 0; s < 24; s++)
        for (unsigned two = 0; two < 64; two++) {
            unsigned state = s, high = pbs_hilbert_level(two >> 3, &state);
            unsigned low = pbs_hilbert_level(two & 7, &state);
            h->step[s][two] = (uint16_t)((high << 3 | low) << 5 | state);
        }
}

/* The tables; filled once in a process. */
static pbs_hilbert pbs_hilbert_tables;
static void pbs_hilbert_once(void) {
    pbs_hilbert_fill(&pbs_hilbert_tables);
}
static inline const pbs_hilbert *pbs_hilbert_get(void) {
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, pbs_hilbert_once);
    return &pbs_hilbert_tables;
}

static inline uint32_t pbs_hilbert_index(const pbs_hilbert *h, unsigned x, unsigned y, unsigned z) {
    uint32_t octants = h->spread[x] | h->spread[y] << 1 | h->spread[z] << 2;
    uint32_t index = 0, state = 0;
#pragma GCC unroll 4
    for (int shift = PBS_HILBERT_BITS - 6; shift >= 0; shift -= 6) {
        uint32_t s = h->step[state][octants >> shift & 63];
        index = index << 6 | s >> 5;
        state = s & 31;
    }
    return index;
}
#endif
