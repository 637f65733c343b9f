/* bench_sample [candidates] [count]: the sampler's time and quality, as ratios within one run.
 *
 * The candidates are those of bench_scene.h. Times are CPU seconds of one thread, the smallest
 * of three; "wall 1/2" is how much sooner two threads are done. The paper's heuristic is timed
 * without its covering radius, which the greedy method knows for nothing. */
#include "libcore/heuristic.h"
#include "libcore/sample.h"
#include "tests/bench/bench_scene.h"
#include <stdio.h>
#include <time.h>

enum { REPEAT = 3 };

static double now(clockid_t clock) {
    struct timespec t;
    clock_gettime(clock, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

typedef struct figures {
    double cpu, wall;
    pbs_sample_result r;
} figures;

static figures measure(const pbs_points *c, const pbs_sample_params *p, int threads,
                       uint32_t *order, float *spacing) {
    pbs_run run = {.threads = threads};
    pbs_sampler *s;
    pbs_err err = {0};
    figures f = {INFINITY, INFINITY, {0}};
    if (pbs_sampler_new(&run, &s, &err)) abort();
    for (int i = 0; i <= REPEAT; i++) { /* the first takes the memory */
        double cpu = now(CLOCK_PROCESS_CPUTIME_ID), wall = now(CLOCK_MONOTONIC);
        if (pbs_sample(s, c, p, order, spacing, &f.r, &err)) fprintf(stderr, "%s\n", err.text);
        if (!i) continue;
        f.cpu = fmin(f.cpu, now(CLOCK_PROCESS_CPUTIME_ID) - cpu);
        f.wall = fmin(f.wall, now(CLOCK_MONOTONIC) - wall);
    }
    pbs_sampler_free(s);
    return f;
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

static void print(const char *name, const figures *f, double ratio, double threads,
                  float *spacing) {
    qsort(spacing, f->r.count, sizeof *spacing, rising);
    printf("%-22s %8zu %8.3f %8.2f %9.6f %9.6f %9.6f", name, f->r.count, f->cpu, ratio,
           (double)spacing[0], (double)spacing[f->r.count / 2], (double)f->r.covering);
    if (threads > 0) printf(" %8.2f", threads);
    printf("\n");
    fflush(stdout);
}

int main(int argc, char **argv) {
    size_t candidates = argc > 1 ? strtoul(argv[1], NULL, 10) : 2000000;
    pbs_sample_params p = {.count = argc > 2 ? strtoul(argv[2], NULL, 10) : 100000};
    pbs_points c = make(candidates);
    uint32_t *order = need(p.count, sizeof *order);
    float *spacing = need(p.count, sizeof *spacing);
    printf("%zu candidates\n%-22s %8s %8s %8s %9s %9s %9s %8s\n", c.count, "method", "count",
           "cpu s", "paper/it", "min", "median", "covering", "wall 1/2");
    for (int w = 0; w < 2; w++) {
        p.normal_weight = (float)w;
        p.method = PBS_PAPER;
        figures paper = measure(&c, &p, 1, order, spacing);
        paper.cpu = paper_seconds(&c, &p, order, spacing);
        print(w ? "paper, w = 1" : "paper, w = 0", &paper, 1, 0, spacing);
        p.method = PBS_GREEDY;
        figures two = measure(&c, &p, 2, order, spacing), one = measure(&c, &p, 1, order, spacing);
        print(w ? "greedy, w = 1" : "greedy, w = 0", &one, paper.cpu / one.cpu, one.wall / two.wall,
              spacing);
    }
    p.method = PBS_RANDOM;
    p.normal_weight = 0;
    figures random = measure(&c, &p, 1, order, spacing);
    print("random, w = 0", &random, NAN, 0, spacing);
    free(order), free(spacing), free(c.position), free(c.normal);
    return 0;
}
