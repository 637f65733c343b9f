/* bench_sample [candidates] [count]: the sampler's time and quality, as ratios within one run.
 *
 * The candidates are those of bench_scene.h. Times are CPU seconds of one thread, the smallest of
 * several. "wall 1/2" is how much sooner two threads are done, runs of one and of two taking turns:
 * on a machine that does other work it says little. The paper's heuristic is timed without its
 * covering radius, which the greedy method knows for nothing. What was asked for stands at the end
 * of a line. */
#include "libcore/surfels/heuristic.h"
#include "libcore/surfels/sample.h"
#include "tests/bench/bench_scene.h"
#include <stdio.h>
#include <time.h>

enum { REPEAT = 5, SMALL_REPEAT = 200 };

static double now(clockid_t clock) {
    struct timespec t;
    clock_gettime(clock, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

typedef struct figures {
    double cpu, wall;
    pbs_sample_result r;
} figures;

/* Runs `repeat` times on each number of threads, in turn, after one run that takes the memory. */
static void measure(const pbs_points *c, const pbs_sample_params *p, int most_threads, int repeat,
                    uint32_t *order, float *spacing, figures f[2]) {
    pbs_run run = {.threads = 1};
    pbs_sampler *s;
    pbs_err err = {0};
    if (pbs_sampler_new(&run, &s, &err)) abort();
    f[0] = f[1] = (figures){INFINITY, INFINITY, {0}};
    for (int i = 0; i <= repeat; i++)
        for (run.threads = 1; run.threads <= most_threads; run.threads++) {
            figures *to = &f[run.threads - 1];
            double cpu = now(CLOCK_PROCESS_CPUTIME_ID), wall = now(CLOCK_MONOTONIC);
            if (pbs_sample(s, c, p, order, spacing, &to->r, &err))
                fprintf(stderr, "%s\n", err.text);
            if (!i) continue;
            to->cpu = fmin(to->cpu, now(CLOCK_PROCESS_CPUTIME_ID) - cpu);
            to->wall = fmin(to->wall, now(CLOCK_MONOTONIC) - wall);
        }
    pbs_sampler_free(s);
}

static double paper_seconds(const pbs_points *c, const pbs_sample_params *p, uint32_t *order,
                            float *spacing) {
    pbs_run run = {.threads = 1};
    pbs_metric m;
    pbs_layout l = {0};
    pbs_err err;
    size_t count;
    double best = INFINITY;
    pbs_heuristic_layout(c->count, p, &l);
    void *block = aligned_alloc(64, l.used);
    if (!block) abort();
    for (int i = 0; i <= REPEAT; i++) {
        double cpu = now(CLOCK_PROCESS_CPUTIME_ID);
        if (pbs_metric_set(&run, &m, c, p->normal_weight, &count, &err)) abort();
        if (pbs_paper_choose(&run, &m, c, p, (pbs_layout){block, 0}, order, spacing, &count, &err))
            abort();
        if (i) best = fmin(best, now(CLOCK_PROCESS_CPUTIME_ID) - cpu);
    }
    free(block);
    return best;
}

static int rising(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

#define ASKED "  0.15 s or 6; 1.7"

static void print(const char *name, const figures *f, double ratio, double threads,
                  const char *asked, float *spacing) {
    qsort(spacing, f->r.count, sizeof *spacing, rising);
    printf("%-22s %8zu %8.3f %8.2f %9.6f %9.6f %9.6f", name, f->r.count, f->cpu, ratio,
           (double)spacing[0], (double)spacing[f->r.count / 2], (double)f->r.covering);
    if (threads > 0) printf(" %8.2f", threads);
    printf("%s\n", asked);
    fflush(stdout);
}

/* What one call costs on one thread for the nodes of a hierarchy. */
static void small_nodes(void) {
    static const size_t sizes[][2] = {{200, 50}, {2000, 500}, {20000, 1000}, {100000, 10000}};
    printf("\n%10s %8s %12s %12s\n", "candidates", "count", "us, w = 0", "us, w = 1");
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        pbs_points c = make(sizes[i][0]);
        pbs_sample_params p = {.count = sizes[i][1]};
        uint32_t *order = need(p.count, sizeof *order);
        float *spacing = need(p.count, sizeof *spacing);
        figures f[2][2];
        for (int w = 0; w < 2; w++) {
            p.normal_weight = (float)w;
            measure(&c, &p, 1, (int)(SMALL_REPEAT * 1000 / (1000 + p.count)), order, spacing, f[w]);
        }
        printf("%10zu %8zu %12.1f %12.1f\n", c.count, f[0][0].r.count, 1e6 * f[0][0].cpu,
               1e6 * f[1][0].cpu);
        free(order), free(spacing), free(c.position), free(c.normal);
    }
}

int main(int argc, char **argv) {
    size_t candidates = argc > 1 ? strtoul(argv[1], NULL, 10) : 2000000;
    pbs_sample_params p = {.count = argc > 2 ? strtoul(argv[2], NULL, 10) : 100000};
    pbs_points c = make(candidates);
    uint32_t *order = need(p.count, sizeof *order);
    float *spacing = need(p.count, sizeof *spacing);
    figures f[2];
    printf("%zu candidates\n%-22s %8s %8s %8s %9s %9s %9s %8s\n", c.count, "method", "count",
           "cpu s", "paper/it", "min", "median", "covering", "wall 1/2");
    for (int w = 0; w < 2; w++) {
        p.normal_weight = (float)w;
        p.method = PBS_PAPER;
        measure(&c, &p, 1, 1, order, spacing, f);
        double paper = f[0].cpu = paper_seconds(&c, &p, order, spacing);
        print(w ? "paper, w = 1" : "paper, w = 0", f, 1, 0, "", spacing);
        p.method = PBS_GREEDY;
        measure(&c, &p, 2, REPEAT, order, spacing, f);
        print(w ? "greedy, w = 1" : "greedy, w = 0", f, paper / f[0].cpu, f[0].wall / f[1].wall,
              ASKED, spacing);
    }
    p.method = PBS_RANDOM;
    p.normal_weight = 0;
    measure(&c, &p, 1, 1, order, spacing, f);
    print("random, w = 0", f, NAN, 0, "", spacing);
    free(order), free(spacing), free(c.position), free(c.normal);
    small_nodes();
    return 0;
}
