/* run.h: what every long function is given: how many threads, how much memory, when to stop.
 *
 * Memory is counted before it is taken (DESIGN section 10). A program sets the limit once; all
 * big arrays come from pbs_alloc. What is not counted one by one (code, stacks, stdio, small
 * strings) is covered by PBS_MEM_BASE, which the program takes when it starts. Mapped input
 * files are the system's page cache and are not counted.
 */
#ifndef PBS_RUN_H
#define PBS_RUN_H

#include "libcore/ground/err.h"
#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PBS_MEM_BASE ((size_t)6 << 20)

typedef struct pbs_run {
    int threads;      /* at least 1 */
    size_t mem_limit; /* bytes; 0: no limit */
    size_t mem_floor; /* what the program knows early that it will need in the end; 0: nothing.
                         A refusal names it, so that a user need not find it step by step */
    size_t mem_used, mem_peak;           /* atomic; read them with pbs_mem_used, pbs_mem_peak */
    const volatile sig_atomic_t *cancel; /* not 0: stop soon; NULL: nobody asks */
    /* Called from any thread, at any rate; NULL: nobody looks. total 0: not known. */
    void (*progress)(void *ctx, const char *what, uint64_t done, uint64_t total);
    void *progress_ctx;
    /* Called with the path of every file that is read, as it was opened; NULL: nobody asks. */
    void (*opened)(void *ctx, const char *path);
    void *opened_ctx;
} pbs_run;

/* count * size bytes, aligned to 64, not cleared. what names the array in the error: "the depth
 * buffer". Fails with PBS_LIMIT, before taking anything, if the limit would be passed; the text
 * says how much would do up to here. Thread-safe. count 0 gives a pointer that can be freed.
 * The owner frees it with pbs_free and the same run. */
pbs_code pbs_alloc(pbs_run *run, void *out, size_t count, size_t size, const char *what,
                   pbs_err *err);

/* As pbs_alloc, for an array that grows: *ptr (NULL at first) keeps its old_count elements.
 * *cap is raised to at least need, by half of itself or more. */
pbs_code pbs_grow(pbs_run *run, void *ptr, size_t *cap, size_t need, size_t size, const char *what,
                  pbs_err *err);

/* NULL is fine. */
void pbs_free(pbs_run *run, void *ptr);

/* Counts memory that somebody else takes (a library, a module); give it back with pbs_mem_give. */
pbs_code pbs_mem_take(pbs_run *run, size_t bytes, const char *what, pbs_err *err);
void pbs_mem_give(pbs_run *run, size_t bytes);

/* Fails with PBS_LIMIT unless `bytes` more would fit, and says what -m would do. Takes nothing.
 * A stage calls it once with the sum of what it is going to need. */
pbs_code pbs_mem_plan(pbs_run *run, size_t bytes, const char *what, pbs_err *err);

size_t pbs_mem_used(const pbs_run *run);
size_t pbs_mem_peak(const pbs_run *run);
/* What is left below the limit; SIZE_MAX / 4 without one. */
size_t pbs_mem_left(const pbs_run *run);

/* PBS_CANCEL if somebody asked to stop. Cheap; call it every few milliseconds of work. */
pbs_code pbs_run_check(const pbs_run *run, pbs_err *err);
void pbs_run_progress(const pbs_run *run, const char *what, uint64_t done, uint64_t total);
static inline void pbs_run_opened(const pbs_run *run, const char *path) {
    if (run->opened) run->opened(run->opened_ctx, path);
}

#ifdef __cplusplus
}
#endif
#endif
