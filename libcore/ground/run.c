#include "libcore/ground/run.h"
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

/* Every block begins with its size, so that pbs_free knows what to give back. */
#define HEAD 64

/* What a block for that many bytes takes, which must not be near SIZE_MAX. */
static size_t block_size(size_t bytes) {
    return (HEAD + bytes + HEAD - 1) / HEAD * HEAD;
}

static void raise_to(size_t *peak, size_t v) {
    size_t p = __atomic_load_n(peak, __ATOMIC_RELAXED);
    while (p < v &&
           !__atomic_compare_exchange_n(peak, &p, v, 1, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
    }
}

static pbs_code too_small(const pbs_run *run, size_t bytes, const char *what, pbs_err *err) {
    size_t used = pbs_mem_used(run);
    size_t sum = bytes > SIZE_MAX - used ? SIZE_MAX : used + bytes;
    if (sum < run->mem_floor) sum = run->mem_floor;
    return pbs_fail(err, PBS_LIMIT, "%s: -m %.4gMi is too small: at least -m %zuMi is needed", what,
                    (double)run->mem_limit / (1 << 20), sum / (1 << 20) + 1);
}

pbs_code pbs_mem_take(pbs_run *run, size_t bytes, const char *what, pbs_err *err) {
    size_t used = __atomic_load_n(&run->mem_used, __ATOMIC_RELAXED);
    do {
        if (run->mem_limit && (used > run->mem_limit || bytes > run->mem_limit - used))
            return too_small(run, bytes, what, err);
        if (bytes > SIZE_MAX - used) return pbs_fail(err, PBS_LIMIT, "%s: too large", what);
    } while (!__atomic_compare_exchange_n(&run->mem_used, &used, used + bytes, 1, __ATOMIC_RELAXED,
                                          __ATOMIC_RELAXED));
    raise_to(&run->mem_peak, used + bytes);
    return PBS_OK;
}

void pbs_mem_give(pbs_run *run, size_t bytes) {
    __atomic_fetch_sub(&run->mem_used, bytes, __ATOMIC_RELAXED);
}

pbs_code pbs_mem_plan(pbs_run *run, size_t bytes, const char *what, pbs_err *err) {
    if (bytes <= pbs_mem_left(run)) return PBS_OK;
    return too_small(run, bytes, what, err);
}

size_t pbs_mem_used(const pbs_run *run) {
    return __atomic_load_n(&run->mem_used, __ATOMIC_RELAXED);
}
size_t pbs_mem_peak(const pbs_run *run) {
    return __atomic_load_n(&run->mem_peak, __ATOMIC_RELAXED);
}

size_t pbs_mem_left(const pbs_run *run) {
    size_t used = pbs_mem_used(run);
    if (!run->mem_limit) return SIZE_MAX / 4;
    return used < run->mem_limit ? run->mem_limit - used : 0;
}

/* Very large blocks are maps of their own, which grow without a copy; smaller ones come from
 * malloc, which keeps the pages of freed ones: fresh pages cost as much as what is done in them.
 * Under the address sanitizer all come from malloc, so that it sees their ends. */
#if defined(__SANITIZE_ADDRESS__)
#define LARGE SIZE_MAX
#else
#define LARGE ((size_t)32 << 20)
#endif

/* Big arrays are touched once from end to end, and page by page that costs more than what is
 * written into them. Only whole huge pages inside the block are asked for: no memory is wasted. */
static void ask_for_huge_pages(void *p, size_t bytes) {
    const uintptr_t huge = (uintptr_t)2 << 20;
    uintptr_t from = ((uintptr_t)p + huge - 1) / huge * huge,
              to = ((uintptr_t)p + bytes) / huge * huge;
    if (to > from + huge) madvise((void *)from, to - from, MADV_HUGEPAGE);
}

static void *take_block(size_t bytes) {
    if (bytes < LARGE) {
        void *p = aligned_alloc(HEAD, bytes);
        if (p) ask_for_huge_pages(p, bytes);
        return p;
    }
    void *p = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (p == MAP_FAILED) return NULL;
    madvise(p, bytes, MADV_HUGEPAGE); /* the whole: a map in two parts could not be stretched */
    return p;
}

/* Grows a large block to `bytes`, or leaves it alone and returns NULL. */
static void *stretch(pbs_run *run, void *ptr, size_t bytes) {
    void *block = (char *)ptr - HEAD;
    size_t old;
    memcpy(&old, block, sizeof old);
    if (old < LARGE || pbs_mem_take(run, bytes - old, "", NULL)) return NULL;
    void *p = mremap(block, old, bytes, MREMAP_MAYMOVE);
    if (p == MAP_FAILED) {
        pbs_mem_give(run, bytes - old);
        return NULL;
    }
    memcpy(p, &bytes, sizeof bytes);
    return (char *)p + HEAD;
}

pbs_code pbs_alloc(pbs_run *run, void *out, size_t count, size_t size, const char *what,
                   pbs_err *err) {
    void *p = NULL;
    memcpy(out, &p, sizeof p);
    if (size && count > (SIZE_MAX / 2 - HEAD) / size)
        return pbs_fail(err, PBS_LIMIT, "%s: too large", what);
    size_t bytes = block_size(count * size);
    pbs_code rc = pbs_mem_take(run, bytes, what, err);
    if (rc) return rc;
    if (!(p = take_block(bytes))) {
        pbs_mem_give(run, bytes);
        return pbs_fail(err, PBS_LIMIT, "%s: the machine has no %zu MiB left", what, bytes >> 20);
    }
    memcpy(p, &bytes, sizeof bytes);
    p = (char *)p + HEAD;
    memcpy(out, &p, sizeof p);
    return PBS_OK;
}

pbs_code pbs_grow(pbs_run *run, void *ptr, size_t *cap, size_t need, size_t size, const char *what,
                  pbs_err *err) {
    if (need <= *cap) return PBS_OK;
    void *old, *fresh;
    memcpy(&old, ptr, sizeof old);
    size_t want = *cap + *cap / 2;
    if (want < need) want = need;
    /* The last step before the limit may be the exact one. */
    if (size && (want > SIZE_MAX / 4 / size || block_size(want * size) > pbs_mem_left(run)))
        want = need;
    if (old && size && want < SIZE_MAX / 4 / size &&
        (fresh = stretch(run, old, block_size(want * size)))) {
        memcpy(ptr, &fresh, sizeof fresh);
        *cap = want;
        return PBS_OK;
    }
    pbs_code rc = pbs_alloc(run, &fresh, want, size, what, err);
    if (rc) return rc;
    if (old) memcpy(fresh, old, *cap * size);
    pbs_free(run, old);
    memcpy(ptr, &fresh, sizeof fresh);
    *cap = want;
    return PBS_OK;
}

void pbs_free(pbs_run *run, void *ptr) {
    if (!ptr) return;
    void *block = (char *)ptr - HEAD;
    size_t bytes;
    memcpy(&bytes, block, sizeof bytes);
    if (bytes < LARGE)
        free(block);
    else
        munmap(block, bytes);
    pbs_mem_give(run, bytes);
}

pbs_code pbs_run_check(const pbs_run *run, pbs_err *err) {
    if (run->cancel && *run->cancel) return pbs_fail(err, PBS_CANCEL, "stopped");
    return PBS_OK;
}

void pbs_run_progress(const pbs_run *run, const char *what, uint64_t done, uint64_t total) {
    if (run->progress) run->progress(run->progress_ctx, what, done, total);
}
