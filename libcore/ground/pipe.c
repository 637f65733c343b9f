#include "libcore/ground/pipe.h"
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* ---- helping threads ---- */

enum { MOST_THREADS = 256, SPINS = 300 };

/* Something that several threads may do together: help is called once by each that joins. */
typedef struct job {
    void (*help)(void *ctx);
    void *ctx;
    int wanted; /* helpers that may still join */
    int inside; /* helpers that have joined and not left; atomic */
    struct job *next;
} job;

static struct {
    pthread_mutex_t lock;
    pthread_cond_t offer, left;
    job *open;  /* those with wanted > 0 */
    int offers; /* whether there are any; atomic */
    int started, idle, busy;
    bool quit;
    pid_t owner;
    pthread_t thread[MOST_THREADS];
} pool = {.lock = PTHREAD_MUTEX_INITIALIZER,
          .offer = PTHREAD_COND_INITIALIZER,
          .left = PTHREAD_COND_INITIALIZER};

/* Whether this thread is inside of a call already. */
static _Thread_local bool inside;

static inline void relax(void) {
#if defined(__x86_64__) && defined(__GNUC__)
    __builtin_ia32_pause();
#endif
}

static void close_job(job *j) {
    job **at = &pool.open;
    while (*at && *at != j) at = &(*at)->next;
    if (*at) *at = j->next;
    __atomic_store_n(&pool.offers, pool.open != NULL, __ATOMIC_RELEASE);
}

/* Many calls follow each other closely. To look for the next one for some microseconds is cheaper
 * than to sleep and to be woken. */
static void wait_for_offer(void) {
    pthread_mutex_unlock(&pool.lock);
    for (int i = 0; i < SPINS && !__atomic_load_n(&pool.offers, __ATOMIC_ACQUIRE); i++) relax();
    pthread_mutex_lock(&pool.lock);
    if (pool.open || pool.quit) return;
    pool.idle++;
    pthread_cond_wait(&pool.offer, &pool.lock);
    pool.idle--;
}

static void *helper(void *arg) {
    (void)arg;
    inside = true;
    pthread_mutex_lock(&pool.lock);
    while (!pool.quit) {
        job *j = pool.open;
        if (!j) {
            wait_for_offer();
            continue;
        }
        if (--j->wanted == 0) close_job(j);
        __atomic_fetch_add(&j->inside, 1, __ATOMIC_RELAXED);
        pool.busy++;
        pthread_mutex_unlock(&pool.lock);
        j->help(j->ctx);
        pthread_mutex_lock(&pool.lock);
        pool.busy--;
        if (__atomic_sub_fetch(&j->inside, 1, __ATOMIC_RELEASE) == 0)
            pthread_cond_broadcast(&pool.left);
    }
    pthread_mutex_unlock(&pool.lock);
    return NULL;
}

/* A signal that is sent to the process has to interrupt what the program waits for, so it must
 * not go to a thread that sleeps here. Those that a thread causes itself are its own. */
static void block_signals(sigset_t *old) {
    static const int own[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGTRAP, SIGABRT, SIGPIPE, SIGXFSZ};
    sigset_t all;
    sigfillset(&all);
    for (size_t i = 0; i < sizeof own / sizeof *own; i++) sigdelset(&all, own[i]);
    pthread_sigmask(SIG_BLOCK, &all, old);
}

/* Fewer threads than asked for change nothing but the time. */
static void start_helpers(int wanted) {
    sigset_t old;
    if (pool.started >= wanted) return;
    pool.owner = getpid();
    block_signals(&old);
    while (pool.started < wanted && !pthread_create(&pool.thread[pool.started], NULL, helper, NULL))
        pool.started++;
    pthread_sigmask(SIG_SETMASK, &old, NULL);
}

/* Calls help(ctx) here and in up to `threads` - 1 helpers, and returns when all have left it. Help
 * must return as soon as nothing is left to do; nobody waits for a helper that comes late. */
static void together(int threads, void (*help)(void *ctx), void *ctx) {
    job j = {.help = help, .ctx = ctx, .wanted = threads - 1};
    if (inside || threads < 2) {
        help(ctx);
        return;
    }
    pthread_mutex_lock(&pool.lock);
    start_helpers(threads - 1);
    j.next = pool.open, pool.open = &j;
    __atomic_store_n(&pool.offers, 1, __ATOMIC_RELEASE);
    for (int i = 0; i < j.wanted && i < pool.idle; i++) pthread_cond_signal(&pool.offer);
    pthread_mutex_unlock(&pool.lock);
    inside = true;
    help(ctx);
    inside = false;
    pthread_mutex_lock(&pool.lock);
    close_job(&j);
    pthread_mutex_unlock(&pool.lock);
    for (int i = 0; i < SPINS && __atomic_load_n(&j.inside, __ATOMIC_ACQUIRE); i++) relax();
    if (!__atomic_load_n(&j.inside, __ATOMIC_ACQUIRE)) return;
    pthread_mutex_lock(&pool.lock);
    while (__atomic_load_n(&j.inside, __ATOMIC_ACQUIRE)) pthread_cond_wait(&pool.left, &pool.lock);
    pthread_mutex_unlock(&pool.lock);
}

/* Nothing is left behind for leak checkers, unless the process ends in the middle of work, or is
 * a copy (fork) that has no helpers. */
__attribute__((destructor)) static void end_helpers(void) {
    if (!pool.started || pool.owner != getpid() || inside) return;
    pthread_mutex_lock(&pool.lock);
    pool.quit = pool.busy == 0;
    pthread_cond_broadcast(&pool.offer);
    pthread_mutex_unlock(&pool.lock);
    while (pool.quit && pool.started) pthread_join(pool.thread[--pool.started], NULL);
}

/* ---- the pipe ---- */

/* One lock, one condition. A thread takes whatever is next: a finished slot whose turn it is for
 * the sink, else a filled slot to work on, else an empty one to fill. Slots are used round robin,
 * so slot order is source order. */
enum { EMPTY, FILLED, WORKING, DONE };

typedef struct state {
    pbs_run *run;
    const pbs_pipe *pipe;
    pthread_mutex_t lock;
    pthread_cond_t cond;
    unsigned char *slot;           /* state of each */
    size_t filled, taken, drained; /* slots so far; filled >= taken >= drained */
    bool sourcing, sinking, ended;
    pbs_err err;
    size_t err_at; /* slot number of err; SIZE_MAX: none */
    int next_thread;
} state;

static void *slot_at(const state *s, size_t i) {
    return (char *)s->pipe->slots + i % (size_t)s->pipe->slot_count * s->pipe->slot_size;
}

static void note_error(state *s, const pbs_err *err, size_t at) {
    if (at >= s->err_at) return;
    s->err = *err;
    s->err_at = at;
}

static void do_sink(state *s) {
    size_t i = s->drained;
    pbs_err err = {0};
    s->sinking = true;
    bool skip = s->err_at <= i; /* nothing behind an error becomes visible */
    pthread_mutex_unlock(&s->lock);
    pbs_code rc =
        skip || !s->pipe->sink ? PBS_OK : s->pipe->sink(s->pipe->ctx, slot_at(s, i), &err);
    pthread_mutex_lock(&s->lock);
    if (rc) note_error(s, &err, i);
    s->slot[i % (size_t)s->pipe->slot_count] = EMPTY;
    s->drained++;
    s->sinking = false;
}

static void do_work(state *s, int thread) {
    size_t i = s->taken++;
    pbs_err err = {0};
    s->slot[i % (size_t)s->pipe->slot_count] = WORKING;
    bool skip = s->err_at < i;
    pthread_mutex_unlock(&s->lock);
    pbs_code rc = skip ? PBS_OK : s->pipe->work(s->pipe->ctx, slot_at(s, i), thread, &err);
    pthread_mutex_lock(&s->lock);
    if (rc) note_error(s, &err, i);
    s->slot[i % (size_t)s->pipe->slot_count] = DONE;
}

static void do_source(state *s) {
    size_t i = s->filled;
    pbs_err err = {0};
    bool end = false;
    s->sourcing = true;
    pthread_mutex_unlock(&s->lock);
    pbs_code rc = pbs_run_check(s->run, &err);
    if (!rc) rc = s->pipe->source(s->pipe->ctx, slot_at(s, i), &end, &err);
    pthread_mutex_lock(&s->lock);
    s->sourcing = false;
    if (rc) note_error(s, &err, i);
    if (rc || end) {
        s->ended = true;
        return;
    }
    s->slot[i % (size_t)s->pipe->slot_count] = FILLED;
    s->filled++;
}

static void help_pipe(void *ctx) {
    state *s = ctx;
    size_t n = (size_t)s->pipe->slot_count;
    pthread_mutex_lock(&s->lock);
    int thread = s->next_thread++;
    for (;;) {
        if (s->err_at != SIZE_MAX) s->ended = true;
        if (!s->sinking && s->drained < s->taken && s->slot[s->drained % n] == DONE)
            do_sink(s);
        else if (s->taken < s->filled)
            do_work(s, thread);
        else if (!s->ended && !s->sourcing && s->filled - s->drained < n)
            do_source(s);
        else if (s->ended && !s->sourcing && s->drained == s->filled)
            break;
        else {
            pthread_cond_wait(&s->cond, &s->lock);
            continue;
        }
        pthread_cond_broadcast(&s->cond);
    }
    pthread_mutex_unlock(&s->lock);
}

static int threads_of(const pbs_run *run) {
    return run->threads < MOST_THREADS ? run->threads : MOST_THREADS;
}

pbs_code pbs_pipe_run(pbs_run *run, const pbs_pipe *pipe, pbs_err *err) {
    state s = {.run = run, .pipe = pipe, .err_at = SIZE_MAX};
    if (!(s.slot = calloc((size_t)pipe->slot_count, 1)))
        return pbs_fail(err, PBS_LIMIT, "no memory for %d slots", pipe->slot_count);
    pthread_mutex_init(&s.lock, NULL);
    pthread_cond_init(&s.cond, NULL);
    together(threads_of(run), help_pipe, &s);
    pthread_cond_destroy(&s.cond);
    pthread_mutex_destroy(&s.lock);
    free(s.slot);
    if (s.err_at == SIZE_MAX) return PBS_OK;
    if (err) *err = s.err;
    return s.err.code;
}

/* ---- the loop ---- */

typedef struct loop {
    const pbs_run *run;
    pbs_code (*work)(void *ctx, size_t i, int thread, pbs_err *err);
    void *ctx;
    size_t n, next; /* next: atomic */
    int threads;    /* that have come; atomic */
    pthread_mutex_t lock;
    size_t err_at; /* item of *err; SIZE_MAX: none; atomic, written under the lock */
    pbs_code code;
    pbs_err *err;
} loop;

static void note_loop_error(loop *l, pbs_code code, const pbs_err *err, size_t at) {
    pthread_mutex_lock(&l->lock);
    if (at < l->err_at) {
        if (l->err) *l->err = *err;
        l->code = code;
        __atomic_store_n(&l->err_at, at, __ATOMIC_RELAXED);
    }
    pthread_mutex_unlock(&l->lock);
}

/* Items are handed out in rising order, so that all before a failed one are worked on. */
static void help_loop(void *ctx) {
    loop *l = ctx;
    pbs_err err = {0};
    int thread = __atomic_fetch_add(&l->threads, 1, __ATOMIC_RELAXED);
    for (;;) {
        size_t i = __atomic_fetch_add(&l->next, 1, __ATOMIC_RELAXED);
        if (i > __atomic_load_n(&l->err_at, __ATOMIC_RELAXED)) return;
        pbs_code rc = pbs_run_check(l->run, &err);
        if (!rc && i >= l->n) return;
        if (!rc) rc = l->work(l->ctx, i, thread, &err);
        if (rc) note_loop_error(l, rc, &err, i);
    }
}

pbs_code pbs_parallel(pbs_run *run, size_t n,
                      pbs_code (*work)(void *ctx, size_t i, int thread, pbs_err *err), void *ctx,
                      pbs_err *err) {
    loop l = {.run = run, .work = work, .ctx = ctx, .n = n, .err_at = SIZE_MAX, .err = err};
    int threads = threads_of(run);
    pthread_mutex_init(&l.lock, NULL);
    together(n < (size_t)threads ? (int)n : threads, help_loop, &l);
    pthread_mutex_destroy(&l.lock);
    return l.code;
}
