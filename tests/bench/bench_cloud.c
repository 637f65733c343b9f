/* Point clouds: from a LAS file to the finished archive, points per CPU second, beside the time
 * that sorting them along Morton's curve alone takes; two threads against one, whose bytes must be
 * the same. bench_cloud [FILE.las | POINTS]: a file, or a generated terrain with trees of so many
 * points (10 M). Files go to $TMPDIR. */
#include "formats/cloudpack.h"
#include "tests/cloudfile.h"
#include <math.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

static pbs_err err;
static char las[300], archive[2][300];

static double cpu(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}
static double wall(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static uint64_t state = 1;
static double chance(void) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (double)(state >> 11) / 9007199254740992.0;
}

/* In strips, as an aeroplane flies; a third of the points are in trees. */
static void generate(uint64_t count) {
    int32_t *q = malloc(count * 12);
    uint16_t *c = malloc(count * 6);
    double side = 60 * sqrt((double)count); /* 0.6 m between points, in centimetres */
    for (uint64_t i = 0; i < count; i++) {
        double strip = floor(20 * (double)i / (double)count) / 20;
        double x = side * (strip + chance() / 20),
               y = side * fmod(20 * (double)i / (double)count, 1);
        double z = 3000 * sin(x / 40000) * cos(y / 30000);
        double tree = sin(x / 300) * sin(y / 250);
        if (tree > 0.5 && i % 3) z += 1500 * chance() * tree;
        q[3 * i] = (int32_t)x, q[3 * i + 1] = (int32_t)y, q[3 * i + 2] = (int32_t)z;
        c[3 * i] = (uint16_t)(30000 + 20000 * sin(x / 900));
        c[3 * i + 1] = (uint16_t)(30000 + 20000 * sin(y / 700)), c[3 * i + 2] = 9000;
    }
    las_write(las, &(las_desc){2, 2, 0, {0.01, 0.01, 0.01}, {6e5, 5e6, 0}, count, 0, 0}, q, c);
    free(q);
    free(c);
}

typedef struct times {
    double cpu, wall;
    uint64_t points;
    size_t memory;
} times;

static times run_once(const char *path, int threads) {
    pbs_run run = {.threads = threads, .mem_limit = 256 << 20};
    pbs_cloud c;
    pbs_cloudpack_stats s = {0};
    times t = {-cpu(), -wall(), 0, 0};
    if (pbs_cloud_open(&run, path, &c, &err) ||
        pbs_cloudpack(&run, &c, 1, &(pbs_writer_desc){.path = archive[threads - 1]}, &s, &err)) {
        fprintf(stderr, "bench_cloud: %s\n", err.text);
        exit(err.code);
    }
    pbs_cloud_close(&c);
    t.cpu += cpu(), t.wall += wall(), t.points = s.points, t.memory = run.mem_peak;
    return t;
}

static int by_key(const void *a, const void *b) {
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y;
}

/* The measure of the machine: a library's sort of as many numbers. */
static double sort_time(uint64_t n) {
    uint64_t *a = malloc(n * sizeof *a);
    for (uint64_t i = 0; i < n; i++) chance(), a[i] = state;
    double t = -cpu();
    qsort(a, n, sizeof *a, by_key);
    t += cpu();
    free(a);
    return t;
}

static bool same(void) {
    FILE *a = fopen(archive[0], "rb"), *b = fopen(archive[1], "rb");
    static char x[1 << 16], y[1 << 16];
    size_t n = 1, m = 1;
    while (a && b && n && n == m && !memcmp(x, y, n))
        n = fread(x, 1, sizeof x, a), m = fread(y, 1, sizeof y, b);
    if (a) fclose(a);
    if (b) fclose(b);
    return n == 0 && m == 0;
}

int main(int argc, char **argv) {
    const char *dir = getenv("TMPDIR") ? getenv("TMPDIR") : "/tmp", *path = las;
    snprintf(las, sizeof las, "%s/bench_cloud.%d.las", dir, (int)getpid());
    for (int i = 0; i < 2; i++)
        snprintf(archive[i], sizeof archive[i], "%s/bench_cloud.%d.%d.pbs", dir, (int)getpid(), i);
    if (argc > 1 && !strtoull(argv[1], NULL, 10))
        path = argv[1];
    else
        generate(argc > 1 ? strtoull(argv[1], NULL, 10) : 10000000);
    times one = {INFINITY, INFINITY, 0, 0}, two = one;
    for (int i = 0; i < 3; i++) {
        times a = run_once(path, 1), b = run_once(path, 2);
        one.cpu = fmin(one.cpu, a.cpu), one.wall = fmin(one.wall, a.wall);
        two.cpu = fmin(two.cpu, b.cpu), two.wall = fmin(two.wall, b.wall);
        one.points = a.points, one.memory = a.memory, two.memory = b.memory;
    }
    double sort = sort_time(one.points), m = (double)one.points * 1e-6;
    struct rusage r;
    getrusage(RUSAGE_SELF, &r);
    printf(
        "%.2f M points: %.3f CPU s, %.2f M points a CPU second; qsort of as many numbers %.3f s, "
        "ratio %.2f\n",
        m, one.cpu, m / one.cpu, sort, sort / one.cpu);
    printf(
        "two threads: wall %.2f times, CPU %.2f times, bytes %s; memory counted %zu and %zu MiB\n",
        one.wall / two.wall, two.cpu / one.cpu, same() ? "the same" : "DIFFER", one.memory >> 20,
        two.memory >> 20);
    if (path == las) unlink(las);
    for (int i = 0; i < 2; i++) unlink(archive[i]);
    return 0;
}
