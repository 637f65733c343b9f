/* Errors, counted memory and the pipe. The pipe's laws hold for every number of threads and slots;
 * they are checked against what one thread would do. Built with -fsanitize=thread it shows that
 * callbacks need no locks of their own. */
#include "libcore/ground/pipe.h"
#include "tests/check.h"
#include <errno.h>
#include <pthread.h>
#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

/* ---- errors ---- */

TEST(error_text) {
    pbs_err err = {0};
    CHECK(pbs_fail(&err, PBS_DATA, "part %d", 7) == PBS_DATA);
    CHECK(err.code == PBS_DATA && !strcmp(err.text, "part 7"));
    CHECK(pbs_fail_in(&err, "a%s", ".glb") == PBS_DATA);
    CHECK(err.code == PBS_DATA && !strcmp(err.text, "a.glb: part 7"));
    CHECK(pbs_fail(NULL, PBS_LIMIT, "nobody listens") == PBS_LIMIT);
    pbs_fail(&err, PBS_DATA, "a\nb\x1b[1m\x7f\t\xc3\xa9");
    CHECK(!strcmp(err.text, "a?b?[1m??\xc3\xa9"));
}

TEST(error_errno) {
    pbs_err err = {0};
    errno = ENOSPC;
    CHECK(pbs_fail_errno(&err, "out %d", 1) == PBS_IO && err.code == PBS_IO);
    CHECK(!strcmp(err.text, "out 1: No space left on device"));
    errno = ENOMEM;
    CHECK(pbs_fail_errno(&err, "x") == PBS_LIMIT && err.code == PBS_LIMIT);
    errno = ENOMEM;
    CHECK(pbs_fail_errno(NULL, "x") == PBS_LIMIT);
}

TEST(error_too_long) {
    char *name = malloc(5001);
    pbs_err err = {0};
    memset(name, 'n', 5000), name[5000] = 0;
    pbs_fail(&err, PBS_IO, "%s", name);
    CHECK(strlen(err.text) == sizeof err.text - 1);
    errno = EIO;
    pbs_fail_errno(&err, "%s", name);
    CHECK(strlen(err.text) == sizeof err.text - 1);
    CHECK(pbs_fail_in(&err, "%s", name) == PBS_IO);
    CHECK(strlen(err.text) == sizeof err.text - 1);
    pbs_fail(&err, PBS_IO, "tail");
    pbs_fail_in(&err, "head");
    CHECK(!strcmp(err.text, "head: tail"));
    free(name);
}

/* ---- memory ---- */

TEST(alloc_counts) {
    pbs_run run = {.threads = 1};
    char *a, *b, *none;
    CHECK(!pbs_alloc(&run, &a, 1000, 3, "a", NULL) && !pbs_alloc(&run, &b, 1, 1, "b", NULL));
    CHECK(!pbs_alloc(&run, &none, 0, 8, "none", NULL) && none);
    CHECK((uintptr_t)a % 64 == 0 && (uintptr_t)b % 64 == 0 && (uintptr_t)none % 64 == 0);
    memset(a, 1, 3000), *b = 2;
    size_t used = pbs_mem_used(&run);
    CHECK_NUM(used >= 3001 && used < 3001 + 6 * 64, used);
    pbs_free(&run, a);
    pbs_free(&run, b);
    pbs_free(&run, none);
    pbs_free(&run, NULL);
    CHECK(pbs_mem_used(&run) == 0 && pbs_mem_peak(&run) == used);
}

TEST(alloc_overflow) {
    pbs_run run = {.threads = 1};
    pbs_err err = {0};
    void *p = &err;
    CHECK(pbs_alloc(&run, &p, SIZE_MAX, SIZE_MAX, "a", &err) == PBS_LIMIT && !p);
    CHECK(!strcmp(err.text, "a: too large"));
    CHECK(pbs_alloc(&run, &p, SIZE_MAX / 2, 1, "a", &err) == PBS_LIMIT && !p);
    CHECK(pbs_alloc(&run, &p, SIZE_MAX / 16, 16, "a", &err) == PBS_LIMIT && !p);
    CHECK(pbs_mem_take(&run, 10, "b", &err) == PBS_OK);
    CHECK(pbs_mem_take(&run, SIZE_MAX - 9, "b", &err) == PBS_LIMIT);
    CHECK(pbs_mem_used(&run) == 10);
    pbs_mem_give(&run, 10);
    CHECK(pbs_mem_used(&run) == 0);
}

/* The -m that the text asks for is enough, and one MiB less is not. */
TEST(limit_says_what_would_do) {
    const size_t mib = 1 << 20;
    for (size_t before = 0; before < 5; before++)
        for (size_t bytes = 1; bytes < 40 * mib; bytes = bytes * 3 + 100000) {
            pbs_run run = {.threads = 1, .mem_limit = mib};
            pbs_err err = {0};
            void *p;
            run.mem_used = before * 333333;
            pbs_code rc = pbs_alloc(&run, &p, bytes, 1, "the net", &err);
            size_t was = 0, need = 0;
            if (!rc) {
                pbs_free(&run, p);
                continue;
            }
            CHECK(rc == PBS_LIMIT && !p && run.mem_used == before * 333333);
            CHECK(sscanf(err.text, "the net: -m %zuMi is too small: at least -m %zuMi", &was,
                         &need) == 2);
            CHECK_NUM(was == 1 && need > 1, need);
            run.mem_limit = need * mib;
            CHECK(!pbs_alloc(&run, &p, bytes, 1, "the net", &err));
            pbs_free(&run, p);
            run.mem_limit = (need - 1) * mib;
            CHECK(pbs_alloc(&run, &p, bytes, 1, "the net", &err) == PBS_LIMIT);
        }
}

TEST(plan_takes_nothing) {
    pbs_run run = {.threads = 1, .mem_limit = 1000};
    pbs_err err = {0};
    CHECK(pbs_mem_left(&run) == 1000 && !pbs_mem_plan(&run, 1000, "p", &err));
    CHECK(pbs_mem_plan(&run, 1001, "p", &err) == PBS_LIMIT && pbs_mem_used(&run) == 0);
    run.mem_used = 2000; /* more than the limit: what the system took */
    CHECK(pbs_mem_left(&run) == 0 && pbs_mem_plan(&run, 1, "p", &err) == PBS_LIMIT);
    CHECK(pbs_mem_take(&run, 1, "p", &err) == PBS_LIMIT);
    run.mem_limit = 0;
    CHECK(pbs_mem_left(&run) == SIZE_MAX / 4 && !pbs_mem_plan(&run, SIZE_MAX / 4, "p", &err));
}

TEST(grow_keeps_and_is_amortised) {
    pbs_run run = {.threads = 1};
    uint32_t *a = NULL;
    size_t cap = 0, moves = 0;
    for (uint32_t i = 0; i < 100000; i++) {
        size_t old = cap;
        CHECK(!pbs_grow(&run, &a, &cap, i + 1, sizeof *a, "a", NULL));
        CHECK(cap > i && (cap == old || cap >= old + old / 2));
        moves += cap != old;
        a[i] = i * i;
    }
    CHECK_NUM(moves < 40, moves);
    for (uint32_t i = 0; i < 100000; i++)
        if (a[i] != i * i) {
            CHECK(!"kept");
            break;
        }
    pbs_free(&run, a);
    CHECK(pbs_mem_used(&run) == 0);
}

/* Whatever the limit: what fits exactly is given, and a failure leaves the array as it was. */
TEST(grow_at_the_limit) {
    for (size_t limit = 400; limit < 1500; limit++) {
        pbs_run run = {.threads = 1, .mem_limit = limit};
        pbs_err err = {0};
        char *a = NULL;
        size_t cap = 0;
        CHECK(!pbs_grow(&run, &a, &cap, 100, 1, "a", &err));
        memset(a, 7, 100);
        pbs_run sum = {.threads = 1, .mem_limit = limit, .mem_used = run.mem_used};
        char *exact;
        bool fits = !pbs_alloc(&sum, &exact, 120, 1, "a", NULL);
        pbs_free(&sum, exact);
        pbs_code rc = pbs_grow(&run, &a, &cap, 120, 1, "a", &err);
        CHECK_NUM((rc == PBS_OK) == fits, limit);
        CHECK(rc == PBS_OK ? cap >= 120 : rc == PBS_LIMIT && cap == 100);
        CHECK(a[0] == 7 && a[99] == 7);
        pbs_free(&run, a);
        CHECK(run.mem_used == 0 && run.mem_peak <= limit);
    }
}

static pbs_code take_and_give(void *ctx, size_t i, int thread, pbs_err *err) {
    pbs_run *run = ctx;
    (void)thread;
    for (int k = 0; k < 20; k++) {
        char *p;
        pbs_code rc = pbs_alloc(run, &p, 1 + (i * 37 + (size_t)k * 911) % 5000, 1, "p", err);
        if (rc && rc != PBS_LIMIT) return rc;
        if (!rc) p[0] = 1;
        pbs_free(run, p);
    }
    return PBS_OK;
}

TEST(alloc_from_many_threads) {
    pbs_run run = {.threads = 7, .mem_limit = 12000};
    CHECK(!pbs_parallel(&run, 500, take_and_give, &run, NULL));
    CHECK(pbs_mem_used(&run) == 0);
    CHECK_NUM(pbs_mem_peak(&run) <= 12000 && pbs_mem_peak(&run) > 1000, run.mem_peak);
}

/* ---- the pipe ---- */

enum { ITEMS = 400, NEVER = 1 << 20 };

typedef struct line {
    int n, source_fails, sink_fails, cancel_at;
    unsigned char fails[ITEMS], slow[ITEMS]; /* in work */
    pthread_t caller;
    bool one_thread;
    /* what happened; source and sink need no lock, that is a law */
    int filled, sunk, wrong;
    int in_source, in_sink, busy[16]; /* atomic */
    volatile sig_atomic_t cancel;
} line;

typedef struct item {
    int i, squared;
} item;

static void enter(line *l, int *flag) {
    if (__atomic_exchange_n(flag, 1, __ATOMIC_RELAXED)) __atomic_fetch_add(&l->wrong, 1, 0);
    if (l->one_thread && !pthread_equal(l->caller, pthread_self()))
        __atomic_fetch_add(&l->wrong, 1, 0);
}
static void leave(int *flag) {
    __atomic_store_n(flag, 0, __ATOMIC_RELAXED);
}

static pbs_code fill(void *ctx, void *slot, bool *end, pbs_err *err) {
    line *l = ctx;
    item *it = slot;
    pbs_code rc = PBS_OK;
    enter(l, &l->in_source);
    if (l->filled == l->source_fails)
        rc = pbs_fail(err, PBS_IO, "source %d", l->filled);
    else if (l->filled == l->n)
        *end = true;
    else
        it->i = l->filled, it->squared = -1;
    if (l->filled == l->cancel_at) l->cancel = 1;
    l->filled += !rc && !*end;
    leave(&l->in_source);
    return rc;
}

static pbs_code square(void *ctx, void *slot, int thread, pbs_err *err) {
    line *l = ctx;
    item *it = slot;
    pbs_code rc = PBS_OK;
    enter(l, &l->busy[thread]);
    for (int k = 0; k < 20 * l->slow[it->i]; k++) sched_yield();
    if (l->fails[it->i]) rc = pbs_fail(err, PBS_DATA, "work %d", it->i);
    it->squared = it->i * it->i;
    leave(&l->busy[thread]);
    return rc;
}

static pbs_code drain(void *ctx, void *slot, pbs_err *err) {
    line *l = ctx;
    const item *it = slot;
    pbs_code rc = PBS_OK;
    enter(l, &l->in_sink);
    l->wrong += it->i != l->sunk || it->squared != it->i * it->i;
    if (it->i == l->sink_fails) rc = pbs_fail(err, PBS_LIMIT, "sink %d", it->i);
    l->sunk++;
    leave(&l->in_sink);
    return rc;
}

static line new_line(int n) {
    line l = {.n = n, .source_fails = NEVER, .sink_fails = NEVER, .cancel_at = NEVER};
    return l;
}

static pbs_code run_line(line *l, int threads, int slots, pbs_err *err) {
    pbs_run run = {.threads = threads, .cancel = &l->cancel};
    item *array = calloc((size_t)slots, sizeof *array);
    l->caller = pthread_self();
    l->one_thread = threads == 1;
    l->filled = l->sunk = l->wrong = 0;
    l->cancel = 0;
    pbs_pipe p = {l, fill, square, drain, array, sizeof *array, slots};
    pbs_code rc = pbs_pipe_run(&run, &p, err);
    free(array);
    CHECK(l->wrong == 0);
    return rc;
}

static const int threads_of[] = {1, 2, 7}, slots_of[] = {1, 2, 5, 14};
#define EACH_SHAPE                                                                                 \
    for (size_t ti = 0; ti < 3; ti++)                                                              \
        for (size_t si = 0; si < 4; si++)
#define SHAPE threads_of[ti], slots_of[si]

static uint32_t seed = 1;
static uint32_t random_below(uint32_t n) {
    seed = seed * 1664525u + 1013904223u;
    return (seed >> 8) % n;
}

TEST(pipe_in_order) {
    EACH_SHAPE {
        for (int n = 0; n <= ITEMS; n = n < 20 ? n + 1 : n * 4) {
            line l = new_line(n);
            for (int i = 0; i < n; i++) l.slow[i] = random_below(9) == 0;
            CHECK(run_line(&l, SHAPE, NULL) == PBS_OK);
            CHECK_NUM(l.filled == n && l.sunk == n, l.sunk);
        }
    }
}

/* The earliest slot's error wins, though later ones are noticed earlier; the sink has seen exactly
 * what comes before. */
TEST(pipe_earliest_error) {
    EACH_SHAPE {
        for (int round = 0; round < 25; round++) {
            line l = new_line(ITEMS);
            int first = (int)random_below(60), at[3];
            for (int k = 0; k < 3; k++) at[k] = first + (int)random_below(8) + (k > 0);
            l.fails[at[0]] = 1, l.slow[at[0]] = 3;
            if (round % 3) l.source_fails = at[1];
            if (round % 2) l.sink_fails = at[2];
            /* of one slot: the source comes before the work, the work before the sink */
            int want = at[0];
            const char *who = "work";
            if (l.source_fails <= want) want = l.source_fails, who = "source";
            if (l.sink_fails < want) want = l.sink_fails, who = "sink";
            char text[40];
            snprintf(text, sizeof text, "%s %d", who, want);
            pbs_err err = {0};
            pbs_code rc = run_line(&l, SHAPE, &err);
            CHECK(rc == err.code);
            CHECK(rc == (*who == 'w' ? PBS_DATA : who[1] == 'o' ? PBS_IO : PBS_LIMIT));
            if (strcmp(err.text, text)) printf("# %s, not %s\n", err.text, text), pbs_bad++;
            CHECK_NUM(l.sunk == want + (who[1] == 'i'), l.sunk);
        }
    }
}

TEST(pipe_many_errors) {
    EACH_SHAPE {
        line l = new_line(ITEMS);
        memset(l.fails, 1, sizeof l.fails);
        l.fails[0] = l.fails[1] = l.fails[2] = 0;
        l.slow[3] = 5;
        pbs_err err = {0};
        CHECK(run_line(&l, SHAPE, &err) == PBS_DATA && !strcmp(err.text, "work 3") && l.sunk == 3);
        CHECK(run_line(&l, SHAPE, NULL) == PBS_DATA);
    }
}

TEST(pipe_cancel) {
    EACH_SHAPE {
        line l = new_line(ITEMS);
        pbs_err err = {0};
        l.cancel_at = 50;
        CHECK(run_line(&l, SHAPE, &err) == PBS_CANCEL && err.code == PBS_CANCEL);
        CHECK_NUM(l.filled == 51 && l.sunk == 51, l.sunk);
    }
}

TEST(pipe_without_sink) {
    for (int t = 1; t <= 7; t += 3) {
        line l = new_line(ITEMS);
        pbs_run run = {.threads = t};
        item array[5];
        pbs_pipe p = {&l, fill, square, NULL, array, sizeof *array, 5};
        CHECK(pbs_pipe_run(&run, &p, NULL) == PBS_OK && l.filled == ITEMS && !l.wrong);
    }
}

/* ---- loops ---- */

typedef struct loop {
    uint8_t seen[5000]; /* not atomic: each index belongs to one call */
    int busy[7];
    size_t fail_from;
    int wrong, threads;
} loop;

static pbs_code see(void *ctx, size_t i, int thread, pbs_err *err) {
    loop *l = ctx;
    if (thread < 0 || thread >= l->threads || __atomic_exchange_n(&l->busy[thread], 1, 0))
        __atomic_fetch_add(&l->wrong, 1, 0);
    l->seen[i]++;
    if (i == l->fail_from) sched_yield();
    leave(&l->busy[thread]);
    return i >= l->fail_from ? pbs_fail(err, PBS_DATA, "at %zu", i) : PBS_OK;
}

TEST(parallel_each_once) {
    static const size_t sizes[] = {0, 1, 2, 13, 5000};
    for (int t = 0; t < 3; t++)
        for (int k = 0; k < 5; k++) {
            static loop l;
            memset(&l, 0, sizeof l);
            l.threads = threads_of[t];
            l.fail_from = SIZE_MAX;
            pbs_run run = {.threads = l.threads};
            CHECK(!pbs_parallel(&run, sizes[k], see, &l, NULL) && !l.wrong);
            size_t once = 0;
            for (size_t i = 0; i < 5000; i++) once += l.seen[i] == (i < sizes[k]);
            CHECK(once == 5000);
        }
}

TEST(parallel_smallest_error) {
    for (int t = 0; t < 3; t++)
        for (size_t from = 0; from < 40; from++) {
            static loop l;
            memset(&l, 0, sizeof l);
            l.threads = threads_of[t];
            l.fail_from = from;
            pbs_run run = {.threads = l.threads};
            pbs_err err = {0};
            char text[32];
            snprintf(text, sizeof text, "at %zu", from);
            CHECK(pbs_parallel(&run, 5000, see, &l, &err) == PBS_DATA && !strcmp(err.text, text));
            for (size_t i = 0; i < from; i++) CHECK(l.seen[i] == 1);
        }
}

static pbs_code nothing(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)i, (void)err;
    if (thread >= 300) *(int *)ctx = 1;
    return PBS_OK;
}

TEST(parallel_with_more_threads_than_slots) {
    int wrong = 0;
    pbs_run run = {.threads = 300};
    CHECK(!pbs_parallel(&run, 2000, nothing, &wrong, NULL) && !wrong);
}

/* ---- calls within calls, and beside each other ---- */

typedef struct nest {
    pbs_run run;
    uint64_t sum[100];
    int wrong; /* atomic */
} nest;

typedef struct inner {
    nest *nest;
    pthread_t caller;
    uint64_t sum; /* not atomic: one thread adds */
} inner;

static pbs_code add_one(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)err;
    inner *in = ctx;
    if (thread || !pthread_equal(in->caller, pthread_self()))
        __atomic_fetch_add(&in->nest->wrong, 1, 0);
    in->sum += i;
    return PBS_OK;
}

static pbs_code loop_inside(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread;
    nest *n = ctx;
    inner in = {n, pthread_self(), 0};
    pbs_code rc = pbs_parallel(&n->run, i, add_one, &in, err);
    n->sum[i] = in.sum;
    return rc;
}

static pbs_code pipe_inside(void *ctx, size_t i, int thread, pbs_err *err) {
    nest *n = ctx;
    line l = new_line((int)i);
    item array[5];
    (void)thread;
    l.caller = pthread_self(), l.one_thread = true;
    pbs_pipe p = {&l, fill, square, drain, array, sizeof *array, 5};
    pbs_code rc = pbs_pipe_run(&n->run, &p, err);
    if (l.wrong || l.sunk != (int)i) __atomic_fetch_add(&n->wrong, 1, 0);
    return rc;
}

TEST(a_call_within_a_call_runs_alone) {
    static nest n;
    for (int threads = 2; threads < 9; threads += 3) {
        memset(&n, 0, sizeof n);
        n.run.threads = threads;
        CHECK(!pbs_parallel(&n.run, 100, loop_inside, &n, NULL) && !n.wrong);
        for (size_t i = 1; i < 100; i++) CHECK(n.sum[i] == i * (i - 1) / 2);
        CHECK(!pbs_parallel(&n.run, 100, pipe_inside, &n, NULL) && !n.wrong);
    }
}

static pbs_code note_thread(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)i, (void)err;
    for (int k = 0; k < 20; k++) sched_yield(); /* let the others come */
    __atomic_store_n((int *)ctx + thread, 1, __ATOMIC_RELAXED);
    return PBS_OK;
}

/* The one item of a loop has all threads for itself. */
static pbs_code loop_in_one(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)i, (void)thread;
    pbs_run run = {.threads = 2};
    return pbs_parallel(&run, 2000, note_thread, ctx, err);
}

TEST(one_item_is_no_loop) {
    int seen[2] = {0};
    pbs_run run = {.threads = 2};
    for (int i = 0; i < 100 && !seen[1]; i++)
        CHECK(!pbs_parallel(&run, 1, loop_in_one, seen, NULL));
    CHECK(seen[0] && seen[1]);
}

static void *caller(void *arg) {
    (void)arg;
    size_t wrong = 0;
    for (int round = 0; round < 20; round++) {
        pbs_run run = {.threads = 1 + round % 4};
        size_t from = round % 2 ? 150 : SIZE_MAX;
        loop l = {.fail_from = from, .threads = run.threads};
        pbs_code rc = pbs_parallel(&run, 200, see, &l, NULL);
        wrong += rc != (round % 2 ? PBS_DATA : PBS_OK) || l.wrong != 0;
        for (size_t i = 0; i < 150; i++) wrong += l.seen[i] != 1;
        line in_order = new_line(50);
        item array[6];
        pbs_pipe p = {&in_order, fill, square, drain, array, sizeof *array, 6};
        wrong += pbs_pipe_run(&run, &p, NULL) || in_order.wrong || in_order.sunk != 50;
    }
    return wrong ? "wrong" : NULL;
}

TEST(several_callers_at_a_time) {
    pthread_t t[4];
    for (int i = 0; i < 4; i++) CHECK(!pthread_create(&t[i], NULL, caller, NULL));
    for (int i = 0; i < 4; i++) {
        void *wrong;
        pthread_join(t[i], &wrong);
        CHECK(!wrong);
    }
}

/* A copy of the process has no helpers, and works without. */
TEST(a_fork_works_alone) {
    int wrong = 0, status = 1;
    pbs_run run = {.threads = 3};
    CHECK(!pbs_parallel(&run, 1000, nothing, &wrong, NULL));
    fflush(stdout);
    pid_t child = fork();
    if (!child) _exit(pbs_parallel(&run, 1000, nothing, &wrong, NULL) ? 1 : 0);
    CHECK(child > 0 && waitpid(child, &status, 0) == child && status == 0);
}

TEST_MAIN
