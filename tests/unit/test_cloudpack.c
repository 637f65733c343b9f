/* Point clouds as archives: every point of the file is there, where it was; no two that a spacing
 * promises are closer; nodes are nested and their prefixes coarse; the same bytes for any number of
 * threads and any memory. */
#include "formats/archive/archive.h"
#include "formats/archive/check.h"
#include "formats/archive/cloudpack.h"
#include "tests/check.h"
#include "tests/cloudfile.h"
#include <math.h>
#include <unistd.h>

static pbs_err err;

static uint64_t state = 7;
static double chance(void) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (double)(state >> 11) / 9007199254740992.0;
}

static pbs_cloudpack_stats stats;

static pbs_code pack(pbs_run *run, const char *const *paths, size_t n, const char *to) {
    pbs_cloud clouds[4] = {0};
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < n && !rc; i++) rc = pbs_cloud_open(run, paths[i], &clouds[i], &err);
    if (!rc)
        rc = pbs_cloudpack(run, clouds, n, &(pbs_writer_desc){.path = to, .stage = "test"}, &stats,
                           &err);
    for (size_t i = 0; i < n; i++) pbs_cloud_close(&clouds[i]);
    CHECK_NUM(!run->mem_used, run->mem_used);
    if (rc) printf("# %s\n", err.text);
    return rc;
}

static pbs_code pack_one(const char *path, const char *to) {
    pbs_run run = {.threads = 2};
    return pack(&run, &path, 1, to);
}

/* ---- what is in an archive ---- */

typedef struct found {
    size_t count;
    double (*p)[3];
    float *spacing;
    uint8_t (*colour)[4];
} found;

static void take_node(found *f, const pbs_archive *a, const pbs_node *n) {
    float before = INFINITY;
    const pbs_record *r = &a->record;
    int colour = pbs_record_at(r, PBS_COLOUR);
    CHECK(n->flags == PBS_NODE_ADDS);
    pbs_node_data d;
    CHECK(!pbs_archive_load_node(a, n->id, &d, &err));
    for (uint64_t i = 0; i < n->records; i++) {
        const uint8_t *at = d.records + i * r->stride;
        uint16_t q[4];
        memcpy(q, at, sizeof q);
        for (int k = 0; k < 3; k++) {
            double v = n->origin[k] + n->lattice_min[k] + n->lattice * q[k];
            f->p[f->count][k] = v;
            CHECK(v >= n->box.min[k] - n->lattice / 9 && v <= n->box.max[k] + n->lattice / 9);
        }
        float s = (float)(pbs_half_get(q[3]) * 65535 * n->lattice);
        CHECK(s <= before);
        before = f->spacing[f->count] = s;
        if (colour >= 0) memcpy(f->colour[f->count], at + colour, 4);
        f->count++;
    }
    pbs_node_data_free(a, &d);
    for (uint32_t c = 0; c < n->child_count; c++) {
        const pbs_node *o = &a->nodes[n->children[c].node];
        CHECK(!memcmp(n->children[c].m, PBS_IDENTITY, sizeof PBS_IDENTITY));
        for (int k = 0; k < 3; k++)
            CHECK(o->box.min[k] >= n->box.min[k] && o->box.max[k] <= n->box.max[k]);
    }
}

static found open_found(const char *path) {
    pbs_run run = {.threads = 1};
    pbs_archive a;
    pbs_checked checked;
    pbs_input in;
    found f = {0};
    CHECK(!pbs_input_open(&run, path, &in, &err) && !pbs_check_file(&run, &in, &checked, &err));
    if (pbs_archive_open(&run, path, &a, &err)) {
        printf("# %s\n", err.text);
        CHECK(false);
        return f;
    }
    size_t n = (size_t)checked.records;
    f.p = calloc(n + 1, sizeof *f.p);
    f.spacing = calloc(n + 1, sizeof *f.spacing);
    f.colour = calloc(n + 1, sizeof *f.colour);
    for (size_t i = a.node_count; i--;) take_node(&f, &a, &a.nodes[i]);
    CHECK(f.count == n);
    pbs_archive_close(&a);
    return f;
}

static void close_found(found *f) {
    free(f->p);
    free(f->spacing);
    free(f->colour);
}

static int compare(const void *a, const void *b) {
    return memcmp(a, b, sizeof(int64_t[3]));
}

/* Each of the n points at `at` is in the archive as often, within `bound`, on a grid of step 2 *
 * bound (or exactly: steps). */
static void check_same(const found *f, const double (*at)[3], size_t n, double step) {
    int64_t(*a)[3] = malloc((n + 1) * sizeof *a), (*b)[3] = malloc((n + 1) * sizeof *b);
    CHECK_NUM(f->count == n, f->count);
    for (size_t i = 0; i < n && f->count == n; i++)
        for (int k = 0; k < 3; k++) {
            a[i][k] = llround(at[i][k] / step);
            b[i][k] = llround(f->p[i][k] / step);
        }
    qsort(a, n, sizeof *a, compare);
    qsort(b, n, sizeof *b, compare);
    CHECK(!memcmp(a, b, n * sizeof *a));
    free(a);
    free(b);
}

/* All pairs: two points are as far apart as the smaller spacing of the two says. */
static void check_spacing(const found *f) {
    size_t bad = 0;
    for (size_t i = 0; i < f->count; i++)
        for (size_t j = 0; j < i; j++) {
            double d2 = 0, s = (double)fminf(f->spacing[i], f->spacing[j]);
            for (int k = 0; k < 3; k++) d2 += (f->p[i][k] - f->p[j][k]) * (f->p[i][k] - f->p[j][k]);
            bad += d2 < s * s * (1 - 1e-9);
        }
    CHECK_NUM(bad == 0, bad);
}

/* ---- clouds ---- */

enum { N = 6000 };
static int32_t q[3 * N];
static uint16_t rgb[3 * N];
static double at[N][3];

static const las_desc terrain = {2, 2, 3, {0.01, 0.01, 0.01}, {637000, -4851000, 400.5}, N, 0, 10};

static void make_terrain(const las_desc *d, double side) {
    for (size_t i = 0; i < N; i++) {
        double x = chance(), y = chance(), z = 0.1 * sin(7 * x) * cos(5 * y);
        q[3 * i] = (int32_t)(side * x) - 1000, q[3 * i + 1] = (int32_t)(side * y);
        q[3 * i + 2] = (int32_t)(side * z);
        for (int k = 0; k < 3; k++) {
            at[i][k] = d->offset[k] + d->scale[k] * q[3 * i + (size_t)k];
            rgb[3 * i + (size_t)k] = (uint16_t)(65535 * chance());
        }
    }
    las_write("t.las", d, q, rgb);
}

TEST(a_las_file_stays_exact) {
    for (double side = 3000; side < 3e7; side *= 100) {
        make_terrain(&terrain, side);
        CHECK(!pack_one("t.las", "t.pbs"));
        CHECK(stats.bound == 0 && stats.step == 0.01 && stats.points == N &&
              stats.record.stride == 12);
        found f = open_found("t.pbs");
        check_same(&f, (const double(*)[3])at, N, 0.01);
        check_spacing(&f);
        close_found(&f);
    }
}

TEST(scales_that_differ_stay_exact) {
    las_desc d = terrain;
    d.format = 0, d.scale[2] = 0.001;
    make_terrain(&d, 100000);
    CHECK(!pack_one("t.las", "t.pbs"));
    CHECK(stats.bound == 0 && stats.step == 0.001 && stats.record.stride == 8);
    found f = open_found("t.pbs");
    check_same(&f, (const double(*)[3])at, N, 0.001);
    check_spacing(&f);
    close_found(&f);
}

/* A few points far apart on a very fine lattice, nearly as many nodes: they stay exact. */
TEST(a_lattice_far_too_fine) {
    las_desc d = terrain;
    for (int k = 0; k < 3; k++) d.scale[k] = 1e-6;
    make_terrain(&d, 2e9);
    CHECK(!pack_one("t.las", "t.pbs"));
    found f = open_found("t.pbs");
    CHECK(stats.bound == 0 && stats.step == 1e-6);
    check_same(&f, (const double(*)[3])at, N, 1e-6);
    check_spacing(&f);
    close_found(&f);
}

/* The distance of the point of the file that is farthest from all that were taken. */
static double farthest(const pbs_cloud_points *p) {
    const pbs_clod_raw *raw = p->raw.bytes;
    const pbs_cloud_lattice *l = &p->lattice;
    double most = 0;
    for (size_t i = 0; i < N; i++) {
        double nearest = INFINITY;
        for (size_t j = 0; j < N; j++) {
            double d = 0;
            for (int k = 0; k < 3; k++) {
                double v = l->origin[k] + l->step * raw[j].q[k] - at[i][k];
                d += v * v;
            }
            nearest = fmin(nearest, d);
        }
        most = fmax(most, sqrt(nearest));
    }
    return most;
}

static void take_into(uint32_t cubes, pbs_cloud_points *p) {
    pbs_run run = {.threads = 2};
    pbs_cloud c;
    uint64_t n = 0;
    *p = (pbs_cloud_points){.cubes = cubes};
    CHECK(!pbs_cloud_open(&run, "t.las", &c, &err));
    CHECK(!pbs_cloud_take(&run, &c, 1, p, &err));
    for (size_t i = 0; i < p->cells.count; i++) n += p->cells.cell[i].count;
    CHECK_NUM(n == N, n);
    CHECK_NUM(farthest(p) <= p->lattice.bound + 1e-9, farthest(p) / p->lattice.step);
    CHECK((p->lattice.bound > 0) == (p->lattice.step > 0.01));
    pbs_cloud_points_free(&run, p);
    pbs_cloud_close(&c);
    CHECK(!run.mem_used);
}

/* Points all over a volume of 4096 cubes, of which the grid, 2 cells wide, promises 512: a lattice
 * stays if its cubes can be borne; if they turn out to be too many it gets coarser, and if that was
 * to be seen at once, too. */
TEST(more_cubes_than_can_be_borne) {
    pbs_cloud_points p;
    const double side = 0xffff0;
    for (size_t i = 0; i < 3 * N; i++) {
        q[i] = (int32_t)(side * chance());
        at[i / 3][i % 3] = terrain.offset[i % 3] + 0.01 * q[i];
    }
    las_write("t.las", &terrain, q, rgb);
    take_into(0, &p);
    CHECK(p.lattice.bound == 0);
    take_into(1000, &p); /* seems fine, is not */
    CHECK_NUM(p.lattice.bound > 0 && fabs(p.lattice.step - 0.04) < 1e-9, p.lattice.step);
    take_into(200, &p);
    CHECK_NUM(p.lattice.bound > 0 && p.lattice.step < 1, p.lattice.step);
}

TEST(tiles_are_one_cloud) {
    make_terrain(&terrain, 200000);
    las_desc half = terrain;
    half.count = N / 2;
    las_write("a.las", &half, q, rgb);
    /* the other half with an offset of its own */
    for (size_t i = N / 2; i < N; i++) q[3 * i] -= 5000;
    half.offset[0] += 50;
    las_write("b.las", &half, q + 3 * N / 2, rgb + 3 * N / 2);
    pbs_run run = {.threads = 1};
    CHECK(!pack(&run, (const char *const[]){"a.las", "b.las"}, 2, "t.pbs"));
    CHECK(stats.bound == 0);
    found f = open_found("t.pbs");
    check_same(&f, (const double(*)[3])at, N, 0.01);
    check_spacing(&f);
    close_found(&f);
}

TEST(colours_of_16_bits_and_of_8) {
    for (int wide = 0; wide < 2; wide++) {
        las_desc d = terrain;
        d.count = 2;
        const int32_t two[6] = {0, 0, 0, 90000, 0, 0};
        /* The first point alone would not tell. */
        const uint16_t c[6] = {200, 100, 7, wide ? 65535 : 255, 0, 0};
        las_write("t.las", &d, two, c);
        CHECK(!pack_one("t.las", "t.pbs"));
        found f = open_found("t.pbs");
        int first = f.p[0][0] < f.p[1][0] ? 0 : 1;
        CHECK(f.colour[first][0] == (wide ? 0 : 200) && f.colour[1 - first][0] == 255);
        CHECK(f.colour[0][3] == 255);
        close_found(&f);
    }
}

/* 10^7 from the origin, with millimetres; what is not finite is left out and counted. */
TEST(doubles_keep_their_detail) {
    FILE *t = fopen("t.xyz", "w");
    size_t n = 0;
    for (size_t i = 0; i < 3000; i++) {
        at[n][0] = 1e7 + floor(50000 * chance()) / 1000,
        at[n][1] = -1e7 + floor(3e4 * chance()) / 1000;
        at[n][2] = floor(4000 * chance()) / 1000;
        fprintf(t, "%.17g %.17g %.17g\n", at[n][0], at[n][1], at[n][2]);
        if (i % 500 == 3) fprintf(t, "nan 1 1\n1 inf 1\n");
        n++;
    }
    fclose(t);
    CHECK(!pack_one("t.xyz", "t.pbs"));
    CHECK(stats.left_out == 12 && stats.points == n);
    CHECK_NUM(stats.bound > 0 && stats.bound < 5e-4, stats.bound);
    found f = open_found("t.pbs");
    check_same(&f, (const double(*)[3])at, n, 0.001);
    check_spacing(&f);
    close_found(&f);
}

TEST(clouds_without_extent) {
    const char *const text[] = {
        "1 2 3\n",          "5 5 5\n5 5 5\n5 5 5\n", "0 0 0\n1e-300 0 0\n",
        "0 0 0\n0 0 1e9\n", "1e15 0 0\n1e15 1 0\n",  "-1e37 0 0\n1e37 0 0\n"};
    const uint64_t count[] = {1, 3, 2, 2, 2, 2};
    for (size_t i = 0; i < sizeof count / sizeof *count; i++) {
        FILE *t = fopen("t.xyz", "w");
        fputs(text[i], t);
        fclose(t);
        CHECK(!pack_one("t.xyz", "t.pbs"));
        found f = open_found("t.pbs");
        CHECK_NUM(f.count == count[i], i);
        close_found(&f);
    }
    for (int pass = 0; pass < 2; pass++) {
        FILE *t = fopen("t.xyz", "w");
        fputs(pass ? "1e299 0 0\n0 0 0\n" : "nan nan nan\n", t);
        fclose(t);
        pbs_run run = {.threads = 1};
        pbs_cloud c;
        CHECK(!pbs_cloud_open(&run, "t.xyz", &c, &err));
        CHECK(pbs_cloudpack(&run, &c, 1, &(pbs_writer_desc){.path = "x.pbs"}, &stats, &err) ==
              PBS_DATA);
        pbs_cloud_close(&c);
        CHECK(access("x.pbs", F_OK));
    }
}

/* A million and more at one place, others around. */
TEST(equal_points_by_the_million) {
    las_desc d = terrain;
    d.format = 2, d.extra = 0, d.count = 1300000;
    int32_t *many = calloc(3 * d.count, sizeof *many);
    uint16_t *colour = calloc(3 * d.count, sizeof *colour);
    for (size_t i = 0; i < d.count; i += 1000) many[3 * i] = (int32_t)i;
    las_write("t.las", &d, many, colour);
    CHECK(!pack_one("t.las", "t.pbs"));
    CHECK_NUM(stats.equal == d.count - 1300, stats.equal);
    pbs_run run = {.threads = 1};
    pbs_checked checked;
    pbs_input in;
    CHECK(!pbs_input_open(&run, "t.pbs", &in, &err) && !pbs_check_file(&run, &in, &checked, &err));
    CHECK_NUM(checked.records == d.count, checked.records);
    free(many);
    free(colour);
}

static bool same_files(const char *a, const char *b) {
    FILE *f = fopen(a, "rb"), *g = fopen(b, "rb");
    int c = 0, d = 0;
    size_t n = 0;
    while (f && g && c == d && c != EOF) c = getc(f), d = getc(g), n++;
    if (f) fclose(f);
    if (g) fclose(g);
    return c == d && n > 1000;
}

/* A header may say any box: the archive is the same. */
TEST(a_box_that_is_right_or_wrong) {
    const int32_t boxes[][2][3] = {{{-1000, 0, -40000}, {399000, 400000, 40000}},
                                   {{-2000000, -2000000, -2000000}, {2000000, 2000000, 2000000}},
                                   {{500, 500, 500}, {900, 900, 900}},
                                   {{INT32_MIN, 0, 0}, {INT32_MAX, 3, 3}}};
    make_terrain(&terrain, 400000);
    CHECK(!pack_one("t.las", "none.pbs"));
    for (int b = -1; b < 4; b++) {
        int32_t low[3] = {INT32_MAX, INT32_MAX, INT32_MAX},
                high[3] = {INT32_MIN, INT32_MIN, INT32_MIN};
        for (size_t i = 0; i < 3 * N; i++) {
            low[i % 3] = q[i] < low[i % 3] ? q[i] : low[i % 3];
            high[i % 3] = q[i] > high[i % 3] ? q[i] : high[i % 3];
        }
        las_say_box("t.las", &terrain, b < 0 ? low : boxes[b][0], b < 0 ? high : boxes[b][1]);
        CHECK(!pack_one("t.las", "t.pbs"));
        CHECK_NUM(same_files("t.pbs", "none.pbs"), b);
    }
    CHECK(stats.bound == 0);
}

/* Points far apart on a fine lattice: what is left of their cells must not take more memory. */
TEST(a_sparse_cloud_in_little_memory) {
    las_desc d = terrain;
    d.count = 120000, d.extra = 0;
    int32_t *many = calloc(3 * d.count, sizeof *many);
    for (size_t i = 0; i < 3 * d.count; i++) many[i] = (int32_t)(2e9 * (chance() - 0.5));
    las_write("t.las", &d, many, NULL);
    free(many);
    const char *path = "t.las";
    pbs_run tight = {.threads = 1, .mem_limit = 64 << 20}, wide = {.threads = 2};
    CHECK(!pack(&tight, &path, 1, "one.pbs") && !pack(&wide, &path, 1, "two.pbs"));
    CHECK(stats.points == d.count && same_files("one.pbs", "two.pbs"));
    CHECK_NUM(wide.mem_peak < 96 << 20, wide.mem_peak);
}

TEST(the_same_bytes_for_any_threads_and_memory) {
    las_desc d = terrain;
    d.count = 200000;
    int32_t *many = calloc(3 * d.count, sizeof *many);
    uint16_t *colour = calloc(3 * d.count, sizeof *colour);
    for (size_t i = 0; i < d.count; i++) {
        many[3 * i] = (int32_t)(300000 * chance() * (i % 3 ? 1 : 0.1));
        many[3 * i + 1] = (int32_t)(300000 * chance() * (i % 3 ? 1 : 0.1));
        colour[3 * i] = (uint16_t)(60000 * chance());
    }
    las_write("t.las", &d, many, colour);
    pbs_run one = {.threads = 1}, three = {.threads = 3, .mem_limit = 60 << 20};
    const char *path = "t.las";
    CHECK(!pack(&one, &path, 1, "one.pbs") && !pack(&three, &path, 1, "three.pbs"));
    CHECK(same_files("one.pbs", "three.pbs"));
    CHECK_NUM(three.mem_peak <= three.mem_limit, three.mem_peak);
    pbs_run tight = {.threads = 1, .mem_limit = 5 << 20};
    pbs_cloud c;
    CHECK(!pbs_cloud_open(&tight, path, &c, &err));
    CHECK(pbs_cloudpack(&tight, &c, 1, &(pbs_writer_desc){.path = "x.pbs"}, &stats, &err) ==
          PBS_LIMIT);
    pbs_cloud_close(&c);
    CHECK(!tight.mem_used && access("x.pbs", F_OK));
    free(many);
    free(colour);
}

TEST_MAIN
