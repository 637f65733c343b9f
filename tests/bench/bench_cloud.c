/* Point clouds: from a LAS file to the finished archive, points per CPU second, beside the time
 * that sorting them along Morton's curve alone takes; two threads against one, whose bytes must be
 * the same; and clouds that builders of levels stumble over, small and four times as large.
 *
 * bench_cloud [POINTS]        of a generated terrain with trees (10 M)
 * bench_cloud FILE.las        of a file, without the hard clouds
 * bench_cloud POINTS TO.las   writes the terrain, 34 bytes a point, and does nothing else
 *
 * Files go to $TMPDIR. */
#include "formats/archive/cloudpack.h"
#include "tests/cloudfile.h"
#include <math.h>
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

/* ---- clouds: point i of n, in hundredths of a metre ---- */

/* In strips, as an aeroplane flies; a third of the points are in trees; 0.6 m between points. */
static void terrain(uint64_t i, uint64_t n, int32_t q[3]) {
    double side = 60 * sqrt((double)n), at = 20 * (double)i / (double)n;
    double x = side * (floor(at) + chance()) / 20, y = side * (at - floor(at));
    double z = 3000 * sin(x / 40000) * cos(y / 30000), tree = sin(x / 300) * sin(y / 250);
    if (tree > 0.5 && i % 3) z += 1500 * chance() * tree;
    q[0] = (int32_t)x, q[1] = (int32_t)y, q[2] = (int32_t)z;
}
static void one_place(uint64_t i, uint64_t n, int32_t q[3]) {
    (void)i, (void)n;
    q[0] = q[1] = q[2] = 77;
}
static void copies(uint64_t i, uint64_t n, int32_t q[3]) {
    for (int k = 0; k < 3; k++) q[k] = (int32_t)((i / 1000 * 2654435761u >> 7 * k) % (n / 10));
}
static void line(uint64_t i, uint64_t n, int32_t q[3]) {
    (void)n;
    q[0] = (int32_t)(7 * i), q[1] = q[2] = 0;
}
static void plane(uint64_t i, uint64_t n, int32_t q[3]) {
    double side = 10 * sqrt((double)n);
    (void)i;
    q[0] = (int32_t)(side * chance()), q[1] = (int32_t)(side * chance()), q[2] = 0;
}
static void volume(uint64_t i, uint64_t n, int32_t q[3]) {
    double side = 10 * cbrt((double)n);
    (void)i;
    for (int k = 0; k < 3; k++) q[k] = (int32_t)(side * chance());
}
/* Half of the points on a millionth of the area. */
static void dense(uint64_t i, uint64_t n, int32_t q[3]) {
    double side = 1000 * sqrt((double)n), s = i % 2 ? side : side / 1000;
    for (int k = 0; k < 2; k++) q[k] = (int32_t)(0.4 * (side - s) + s * chance());
    q[2] = (int32_t)(20 * chance());
}
/* All in a box of a metre but for one, 20,000 km away. */
static void outlier(uint64_t i, uint64_t n, int32_t q[3]) {
    (void)n;
    for (int k = 0; k < 3; k++) q[k] = i == 5 ? 2000000000 : (int32_t)(20000 * chance());
}

static const struct shape {
    const char *name;
    void (*point)(uint64_t i, uint64_t n, int32_t q[3]);
} shapes[] = {{"terrain with trees", terrain},
              {"all at one place", one_place},
              {"each a thousand times", copies},
              {"a line", line},
              {"a plane", plane},
              {"a volume", volume},
              {"density by 10^6", dense},
              {"an outlier", outlier}};
enum { SHAPES = sizeof shapes / sizeof *shapes };

/* A point's format is 2 (26 bytes) or 3 (34). */
static void generate(const char *to, const struct shape *shape, uint64_t count, int format) {
    uint8_t p[34] = {0};
    const las_desc d = {2, format, 0, {0.01, 0.01, 0.01}, {6e5, 5e6, 0}, 0, count, 0};
    int32_t low[3] = {INT32_MAX, INT32_MAX, INT32_MAX}, high[3] = {INT32_MIN, INT32_MIN, INT32_MIN};
    las_write(to, &d, NULL, NULL);
    FILE *f = fopen(to, "ab");
    state = 1;
    for (uint64_t i = 0; f && i < count; i++) {
        int32_t q[3];
        shape->point(i, count, q);
        for (int k = 0; k < 3; k++) {
            low[k] = q[k] < low[k] ? q[k] : low[k];
            high[k] = q[k] > high[k] ? q[k] : high[k];
        }
        uint16_t c[3] = {(uint16_t)(30000 + q[0] / 64 % 20000),
                         (uint16_t)(30000 + q[1] / 64 % 20000), 9000};
        memcpy(p, q, sizeof q);
        memcpy(p + las_red[format], c, sizeof c);
        fwrite(p, (size_t)las_size[format], 1, f);
    }
    if (!f || fclose(f)) exit(3);
    las_say_box(to, &d, low, high);
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

/* Clouds that builders of levels stumble over: what a point costs, of n and of four times as many.
 */
static void hard_clouds(uint64_t n) {
    printf("%-24s %12s %12s %8s %10s\n", "M points a CPU second", "small", "x 4", "MiB",
           "x terrain");
    double usual = 0;
    for (int s = 0; s < SHAPES; s++) {
        double speed[2];
        times t = {0};
        for (int i = 0; i < 2; i++) {
            generate(las, &shapes[s], i ? 4 * n : n, 2);
            t = run_once(las, 1);
            speed[i] = (double)t.points * 1e-6 / t.cpu;
        }
        usual = s ? usual : speed[1];
        printf("%-24s %12.2f %12.2f %8zu %10.2f\n", shapes[s].name, speed[0], speed[1],
               t.memory >> 20, usual / speed[1]);
    }
    unlink(las);
}

static void two_threads(const char *path) {
    times one = {INFINITY, INFINITY, 0, 0}, two = one;
    for (int i = 0; i < 3; i++) {
        times a = run_once(path, 1), b = run_once(path, 2);
        one.cpu = fmin(one.cpu, a.cpu), one.wall = fmin(one.wall, a.wall);
        two.cpu = fmin(two.cpu, b.cpu), two.wall = fmin(two.wall, b.wall);
        one.points = a.points, one.memory = a.memory, two.memory = b.memory;
    }
    double sort = sort_time(one.points), m = (double)one.points * 1e-6;
    printf(
        "%.2f M points: %.3f CPU s, %.2f M points a CPU second; qsort of as many numbers %.3f s, "
        "ratio %.2f\n",
        m, one.cpu, m / one.cpu, sort, sort / one.cpu);
    printf(
        "two threads: wall %.2f times, CPU %.2f times, bytes %s; memory counted %zu and %zu MiB\n",
        one.wall / two.wall, two.cpu / one.cpu, same() ? "the same" : "DIFFER", one.memory >> 20,
        two.memory >> 20);
}

int main(int argc, char **argv) {
    const char *dir = getenv("TMPDIR") ? getenv("TMPDIR") : "/tmp";
    uint64_t count = argc > 1 ? strtoull(argv[1], NULL, 10) : 10000000;
    if (count && argc > 2) {
        generate(argv[2], &shapes[0], count, 3);
        return 0;
    }
    snprintf(las, sizeof las, "%s/bench_cloud.%d.las", dir, (int)getpid());
    for (int i = 0; i < 2; i++)
        snprintf(archive[i], sizeof archive[i], "%s/bench_cloud.%d.%d.pbs", dir, (int)getpid(), i);
    if (count) {
        generate(las, &shapes[0], count, 2);
        two_threads(las);
        hard_clouds(count / 20);
    } else
        two_threads(argv[1]);
    for (int i = 0; i < 2; i++) unlink(archive[i]);
    return 0;
}
