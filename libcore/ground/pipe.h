/* pipe.h: the one idiom for concurrency: source | work | sink (DESIGN section 10).
 *
 * A source fills slots one after the other, work is done on slots by any thread, the sink gets
 * them back in the source's order. The number of slots bounds the memory. Everything that is
 * visible outside happens in source and sink, which never run beside themselves; so the result
 * does not depend on the number of threads.
 *
 * Helping threads start when they are first needed and sleep until the process ends: a call costs
 * microseconds, not the start of threads. They take no signals that are sent to the process.
 * Several threads may call at a time; they share the helpers, and none waits for another's.
 *
 * Nesting: a call from inside the source, work, sink or loop of another one that has several
 * threads runs on the calling thread alone. It costs nothing, it cannot deadlock, and the result
 * is the same. A loop of one item is not such a one: what it calls may use all threads.
 */
#ifndef PBS_PIPE_H
#define PBS_PIPE_H

#include "libcore/ground/run.h"

typedef struct pbs_pipe {
    void *ctx;
    /* Fills slot; sets *end (and leaves the slot alone) when there is nothing more.
     * One call at a time, from any thread. */
    pbs_code (*source)(void *ctx, void *slot, bool *end, pbs_err *err);
    /* Any number at a time, one per slot. thread is 0 .. run->threads - 1 and no two calls with
     * the same thread run at a time, so it indexes scratch memory. */
    pbs_code (*work)(void *ctx, void *slot, int thread, pbs_err *err);
    /* In the source's order, one call at a time; NULL: nothing to do. */
    pbs_code (*sink)(void *ctx, void *slot, pbs_err *err);
    void *slots; /* caller's array */
    size_t slot_size;
    int slot_count; /* at least 1; 2 * threads keeps everybody busy */
} pbs_pipe;

/* Runs until the source ends, or until the first error: of several, the one whose slot came
 * first. With one thread everything runs in the caller's. Checks run->cancel between slots. */
pbs_code pbs_pipe_run(pbs_run *run, const pbs_pipe *pipe, pbs_err *err);

/* work(ctx, i, thread) for i in 0 .. n - 1, in no order, on all threads; items may be tiny. Of
 * several errors the one with the smallest i is returned; all before it have been worked on.
 * Checks run->cancel between items. */
pbs_code pbs_parallel(pbs_run *run, size_t n,
                      pbs_code (*work)(void *ctx, size_t i, int thread, pbs_err *err), void *ctx,
                      pbs_err *err);
#endif
