/* cache.h: results that are kept from one run to the next, each in a file of its own.
 *
 * An entry is found by a key, 128 bits over everything that determines the result (XXH3), so it
 * never grows stale and is never invalidated: what changed has another key. Files are named by it,
 * appear when they are whole, and carry a checksum: one that is damaged is removed and counts as
 * not found. Any number of processes may share a folder, and any number of threads a pbs_cache.
 * The cache only ever saves time: trouble with its files is told, and is no error.
 *
 * Around the sampler (tests/unit/test_cache.c does this):
 *
 *     pbs_cache_key key = pbs_cache_sample_key(&candidates, &params);
 *     if (!pbs_cache_find_sample(cache, &key, &candidates, room, order, spacing, &result)) {
 *         rc = pbs_sample(sampler, &candidates, &params, order, spacing, &result, err);
 *         if (!rc) rc = pbs_cache_store_sample(cache, &key, order, spacing, &result, err);
 *     }
 *
 * params.node is part of the key because it decides the first surfel. It should not be a number
 * that changes when a part is added before this one, or all that follows is sampled anew.
 */
#ifndef PBS_CACHE_H
#define PBS_CACHE_H

#include "formats/container/container.h"
#include "libcore/surfels/sample.h"

typedef struct pbs_cache pbs_cache;
typedef struct pbs_cache_key {
    uint8_t bytes[16];
} pbs_cache_key;

enum { PBS_CACHE_PARTS = 8 };

/* Makes the folder if it is not there; the one above it must be. limit: bytes that its files may
 * have after pbs_cache_close; 0: any. Errors: PBS_IO, PBS_LIMIT. */
pbs_code pbs_cache_open(pbs_run *run, const char *folder, uint64_t limit, pbs_cache **out,
                        pbs_err *err);

/* Of the bytes of all pieces and of where one ends and the next begins. The program's version is
 * in it, too. */
pbs_cache_key pbs_cache_key_of(const pbs_piece *pieces, int count);

/* Fills the parts of an entry, at most PBS_CACHE_PARTS. parts[i].size is the room that there is,
 * and becomes what was stored. False: not found (or not whole, or too large for the room), and the
 * parts hold anything. cache NULL: never found. */
typedef struct pbs_cache_part {
    void *bytes;
    size_t size;
} pbs_cache_part;
bool pbs_cache_find(pbs_cache *cache, const pbs_cache_key *key, pbs_cache_part *parts, int count);

/* cache NULL: nothing to do. Errors: PBS_CANCEL only. */
pbs_code pbs_cache_store(pbs_cache *cache, const pbs_cache_key *key, const pbs_piece *parts,
                         int count, pbs_err *err);

/* Results of pbs_sample: an order and spacings, whatever channels the candidates have. room: of
 * order and spacing. What is found is some of `in`, each once, whoever wrote the file. */
pbs_cache_key pbs_cache_sample_key(const pbs_points *in, const pbs_sample_params *params);
bool pbs_cache_find_sample(pbs_cache *cache, const pbs_cache_key *key, const pbs_points *in,
                           size_t room, uint32_t *order, float *spacing, pbs_sample_result *result);
pbs_code pbs_cache_store_sample(pbs_cache *cache, const pbs_cache_key *key, const uint32_t *order,
                                const float *spacing, const pbs_sample_result *result,
                                pbs_err *err);

/* Removes the files that were used longest ago until the rest is within the limit. NULL is fine. */
typedef struct pbs_cache_totals {
    uint64_t found, missed, stored, damaged, evicted;
    char trouble[256]; /* the first; "": none */
} pbs_cache_totals;
pbs_cache_totals pbs_cache_close(pbs_cache *cache);
#endif
