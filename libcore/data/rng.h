/* rng.h: random numbers without state: a hash of (seed, node, index).
 *
 * So a choice does not depend on what was drawn before it, by whom, or on which thread.
 */
#ifndef PBS_RNG_H
#define PBS_RNG_H

#include <stdint.h>

/* The finaliser of splitmix64 (Steele, Lea, Flood 2014): every input bit moves every output bit. */
static inline uint64_t pbs_mix64(uint64_t v) {
    v = (v ^ (v >> 30)) * 0xbf58476d1ce4e5b9u;
    v = (v ^ (v >> 27)) * 0x94d049bb133111ebu;
    return v ^ (v >> 31);
}

static inline uint64_t pbs_random(uint64_t seed, uint64_t node, uint64_t index) {
    const uint64_t step = 0x9e3779b97f4a7c15u;
    return pbs_mix64(pbs_mix64(pbs_mix64(seed + step) + node * step + step) + index * step);
}

/* Uniform in 0 .. n - 1, n < 2^32, from 64 random bits; the bias is below 2^-32. */
static inline uint32_t pbs_random_below(uint64_t random, uint32_t n) {
    return (uint32_t)(((random >> 32) * n) >> 32);
}
#endif
