#include "libcore/pipe.h"
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

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

static void *thread_main(void *arg) {
    state *s = arg;
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
    return NULL;
}

pbs_code pbs_pipe_run(pbs_run *run, const pbs_pipe *pipe, pbs_err *err) {
    state s = {.run = run, .pipe = pipe, .err_at = SIZE_MAX};
    pthread_t thread[256];
    int extra = (run->threads > 256 ? 256 : run->threads) - 1, started = 0;
    if (!(s.slot = calloc((size_t)pipe->slot_count, 1)))
        return pbs_fail(err, PBS_LIMIT, "no memory for %d slots", pipe->slot_count);
    pthread_mutex_init(&s.lock, NULL);
    pthread_cond_init(&s.cond, NULL);
    /* Fewer threads than asked for change nothing but the time. */
    while (started < extra && !pthread_create(&thread[started], NULL, thread_main, &s)) started++;
    thread_main(&s);
    while (started) pthread_join(thread[--started], NULL);
    pthread_cond_destroy(&s.cond);
    pthread_mutex_destroy(&s.lock);
    free(s.slot);
    if (s.err_at == SIZE_MAX) return PBS_OK;
    if (err) *err = s.err;
    return s.err.code;
}

typedef struct loop {
    void *ctx;
    pbs_code (*work)(void *ctx, size_t i, int thread, pbs_err *err);
    size_t next, n;
} loop;

static pbs_code loop_source(void *ctx, void *slot, bool *end, pbs_err *err) {
    (void)err;
    loop *l = ctx;
    if (l->next == l->n)
        *end = true;
    else
        *(size_t *)slot = l->next++;
    return PBS_OK;
}

static pbs_code loop_work(void *ctx, void *slot, int thread, pbs_err *err) {
    loop *l = ctx;
    return l->work(l->ctx, *(size_t *)slot, thread, err);
}

pbs_code pbs_parallel(pbs_run *run, size_t n,
                      pbs_code (*work)(void *ctx, size_t i, int thread, pbs_err *err), void *ctx,
                      pbs_err *err) {
    loop l = {ctx, work, 0, n};
    size_t slots[512];
    int count = run->threads < 256 ? 2 * run->threads : 512;
    pbs_pipe p = {&l, loop_source, loop_work, NULL, slots, sizeof slots[0], count};
    return pbs_pipe_run(run, &p, err);
}
