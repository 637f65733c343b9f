/* bench_walls [CANDIDATES...]: what normals in the metric do for thin walls, and what averaged
 * colours do for early prefixes.
 *
 * A candidate is a wrong-side hole if no surfel of the prefix is on its side (n.n' > 0) within
 * 1.25 R; R is the covering radius of the same prefix by plain Euclid, for both. Of each file the
 * first node with candidates is taken; without files, those of bench_scene.h. */
#include "formats/surfels/points.h"
#include "libcore/surfels/average.h"
#include "libcore/measures/measure.h"
#include "tests/bench/bench_scene.h"
#include <stdio.h>
#include <time.h>

enum { PREFIXES = 8 };
static const size_t prefixes[PREFIXES] = {1000, 4000, 10000, 25000, 50000, 100000, 200000, 400000};

static pbs_run run = {.threads = 1};
static pbs_err err;

static void must(pbs_code rc) {
    if (!rc) return;
    fprintf(stderr, "bench_walls: %s\n", err.text);
    exit(rc);
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static pbs_points load(const char *path) {
    pbs_reader *r;
    pbs_record record;
    pbs_points p = {0};
    size_t cap = 0;
    must(pbs_reader_open_path(&run, path, PBS_KIND(PBS_CANDIDATES), &r, &err));
    must(pbs_record_parse(path, pbs_reader_channels(r), &record, &err));
    for (bool end = false; !end;) {
        pbs_chunk c;
        must(pbs_reader_next(r, &c, &end, &err));
        if (end || (c.tag == PBS_TAG_NODE && p.count)) break;
        if (c.tag != PBS_TAG_POINTS) continue;
        must(pbs_points_grow(&run, record.channels, &p, &cap, p.count + c.count, &err));
        must(pbs_points_read(path, &record, &c, &p, NULL, &err));
    }
    pbs_reader_close(r);
    return p;
}

typedef struct result {
    uint32_t *order;
    float *spacing;
    pbs_sample_result r;
    pbs_points entries;
    double sampling, averaging;
} result;

static result sample(const pbs_points *c, float weight) {
    size_t most = prefixes[PREFIXES - 1];
    if (c->count < 4 * most) most = c->count / 4;
    pbs_sample_params p = {.count = most, .normal_weight = weight};
    result out = {.order = need(most, 4), .spacing = need(most, 4)};
    pbs_sampler *s;
    pbs_averager *a;
    size_t cap = 0;
    must(pbs_sampler_new(&run, &s, &err));
    must(pbs_averager_new(&run, &a, &err));
    uint32_t channels = pbs_points_channels(c) & ~(uint32_t)PBS_POSITION;
    must(pbs_points_grow(&run, channels, &out.entries, &cap, most, &err));
    for (int i = 0; i < 2; i++) { /* the first takes the memory */
        double t = now();
        must(pbs_sample(s, c, &p, out.order, out.spacing, &out.r, &err));
        out.sampling = now() - t;
        must(pbs_average(a, s, c, out.order, out.spacing, out.r.count, &out.entries, &err));
        out.averaging = now() - t - out.sampling;
    }
    pbs_averager_free(a);
    pbs_sampler_free(s);
    return out;
}

static pbs_measures measure(pbs_measurer *m, const result *r, size_t n, double radius) {
    int k = pbs_octave_of(r->r.count, n);
    const uint8_t *averaged =
        k && r->entries.colour ? r->entries.colour + 4 * pbs_octave_begin(r->r.count, k) : NULL;
    pbs_measures out;
    must(pbs_measure(m, r->order, n, radius, averaged, &out, &err));
    return out;
}

static void compare(const char *name, const pbs_points *c) {
    result plain = sample(c, 0), aware = sample(c, 1);
    pbs_measurer *m;
    must(pbs_measurer_new(&run, c, 1, &m, &err));
    printf("%s: %zu candidates\n", name, c->count);
    printf("cpu s of the order %.3f and %.3f, of its octaves %.3f and %.3f\n", plain.sampling,
           aware.sampling, plain.averaging, aware.averaging);
    printf("%8s %10s %9s %9s %7s %9s %9s %9s\n", "surfels", "R", "holes w=0", "holes w=1", "ratio",
           "cover w=1", "colour", "averaged");
    for (int i = 0; i < PREFIXES; i++) {
        size_t n = prefixes[i];
        if (n > plain.r.count || n > aware.r.count) break;
        pbs_measures a = measure(m, &plain, n, 0), b = measure(m, &aware, n, a.covering);
        double candidate = 1 / (double)c->count; /* no holes count as half of one */
        printf("%8zu %10.4g %8.3f%% %8.3f%% %7.1f %9.3f %9.2f %9.2f\n", n, a.covering,
               100 * a.holes, 100 * b.holes, a.holes / fmax(b.holes, candidate / 2),
               b.covering / a.covering, b.colour_own, b.colour_averaged);
    }
    pbs_measurer_free(m);
    result *all[2] = {&plain, &aware};
    for (int i = 0; i < 2; i++) {
        free(all[i]->order), free(all[i]->spacing);
        pbs_points_free(&run, &all[i]->entries);
    }
}

int main(int argc, char **argv) {
    for (int i = 1; i < argc; i++) {
        pbs_points c = load(argv[i]);
        compare(pbs_base_name(argv[i]), &c);
        pbs_points_free(&run, &c);
    }
    if (argc > 1) return 0;
    pbs_points c = make(2000000);
    compare("a bumpy sphere and plates 0.01 thick", &c);
    free(c.position), free(c.normal);
    return 0;
}
