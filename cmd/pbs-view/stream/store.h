/* store.h: what of an archive is in the GPU's memory: loaded by a thread of its own, uploaded a
 * little every frame, and let go when there is no room (paper 2, section 4, streaming).
 *
 * It knows items by number and their bytes by a function, buffers by number and their making by a
 * table: no archive and no GL, so that it is tested without either. What is wanted comes sorted
 * from the cut (cut.h), every frame anew; a frame never waits for the disk.
 */
#ifndef PBS_STORE_H
#define PBS_STORE_H

#include "cmd/pbs-view/plan/cut.h"

/* An item in the host's memory; bytes are from pbs_alloc. */
typedef struct pbs_blob {
    uint8_t *bytes;
    size_t size;
} pbs_blob;

/* load: called on the loader's thread, one at a time. An error is the item's own: it is never asked
 * for again.
 * part: bytes of part k of an item that is larger than a buffer may be; parts lie in the blob one
 * behind the other; 0: there are only k. NULL: items cannot be divided. */
typedef struct pbs_store_source {
    void *ctx;
    pbs_code (*load)(void *ctx, uint32_t item, pbs_blob *out, pbs_err *err);
    uint64_t (*part)(void *ctx, uint32_t item, uint32_t k);
} pbs_store_source;

/* Called on the thread of pbs_store_frame. make: false: there is no more memory. The second three
 * are for items that are apart; offsets and sizes are multiples of 4. */
typedef struct pbs_store_gpu {
    void *ctx;
    bool (*make)(void *ctx, uint64_t bytes, uint32_t *buffer);
    void (*fill)(void *ctx, uint32_t buffer, uint64_t at, const void *bytes, uint64_t size);
    void (*drop)(void *ctx, uint32_t buffer);
    bool (*make_apart)(void *ctx, uint32_t item, uint64_t bytes, uint32_t *texture);
    void (*fill_apart)(void *ctx, uint32_t item, uint32_t texture, uint64_t at, const void *bytes,
                       uint64_t size);
    void (*drop_apart)(void *ctx, uint32_t texture, uint64_t bytes); /* bytes: as made */
} pbs_store_gpu;

typedef struct pbs_store_desc {
    size_t items;
    const uint64_t *bytes; /* of each item; 0: there is none. Of items that are apart: what is
                              expected, until one has been loaded */
    uint64_t gpu;          /* limit of all buffers together */
    uint64_t largest;      /* of one buffer; items that are larger have parts in several */
    uint64_t upload;       /* bytes a frame; 0: any */
    uint64_t host;         /* limit of what is loaded and not yet uploaded; one item is always
                              allowed */
    bool threaded;         /* else pbs_store_frame loads itself, which is for tests */
    size_t apart;          /* items from this number on lie in no buffer, but each is an object of
                              the GPU's own: a texture. 0: there are none */
} pbs_store_desc;

typedef struct pbs_store pbs_store;

pbs_code pbs_store_new(pbs_run *run, const pbs_store_desc *desc, const pbs_store_source *source,
                       const pbs_store_gpu *gpu, pbs_store **out, pbs_err *err);
/* Ends the thread. buffers: drop them, too; false where the context is gone and took them along. */
void pbs_store_free(pbs_store *s, bool buffers); /* NULL is fine */

/* One of each item, 1: it can be drawn. Belongs to the store and changes in pbs_store_frame. */
const uint8_t *pbs_store_resident(const pbs_store *s);

typedef struct pbs_region {
    uint32_t buffer;   /* or texture */
    uint64_t at, size; /* bytes; at is a multiple of 256 */
} pbs_region;
/* Of part k of an item that is resident, until the next pbs_store_frame. */
pbs_region pbs_store_where(const pbs_store *s, uint32_t item, uint32_t k);

/* Whether an item is not there, but comes if further frames need it like the last one; else it is
 * there, or damaged, or not needed, or there is no room. */
bool pbs_store_awaits(const pbs_store *s, uint32_t item);
/* Whether it is damaged. */
bool pbs_store_failed(const pbs_store *s, uint32_t item);

/* Between two frames: takes what was loaded, uploads, and tells the thread what to load next. What
 * the needs name, as far as 95 % of the limit go, stays; of the rest what was unused for longest
 * goes when there is no room. *busy: more will come of it with another call. Errors: PBS_LIMIT of
 * its own lists, never of an item. */
pbs_code pbs_store_frame(pbs_store *s, const pbs_cut_need *needs, size_t count, bool *busy,
                         pbs_err *err);

/* Until something was loaded, at most `seconds`. */
void pbs_store_wait(pbs_store *s, double seconds);

typedef struct pbs_store_stats {
    uint64_t resident; /* bytes of items, and of the buffers that they are in */
    uint64_t buffers;
    uint64_t uploaded, uploaded_last; /* bytes, in all and by the last frame */
    uint64_t loaded, evicted, failed; /* items */
    uint64_t host_peak;               /* bytes that were loaded and not yet uploaded */
} pbs_store_stats;
pbs_store_stats pbs_store_measure(const pbs_store *s);
/* Why the first item failed; NULL: none did. */
const char *pbs_store_trouble(const pbs_store *s);
#endif
