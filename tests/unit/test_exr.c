/* test_exr.c: the module "exr": multi-part files, written and read back. */
#include "formats/readers/module.h"
#include "tests/check.h"
#include <math.h>
#include <sys/stat.h>
#include <unistd.h>

static pbs_run run = {.threads = 1};
static pbs_err err;
static const pbs_module_exr *module;
static char folder[32], path[64];

static bool begin(void) {
    const void *table = NULL;
    pbs_code rc = pbs_module_open(&run, "exr", 0, &table, &err);
    if (rc && strstr(err.text, "not installed")) return false;
    CHECK(!rc);
    module = table;
    strcpy(folder, "/tmp/pbs-exr-XXXXXX");
    if (!mkdtemp(folder)) abort();
    snprintf(path, sizeof path, "%s/x.exr", folder);
    return module != NULL;
}
static void end(void) {
    unlink(path);
    CHECK(rmdir(folder) == 0); /* no temporary file was left */
    CHECK(pbs_mem_used(&run) == 0);
}
#define NEED_EXR                                                                                   \
    if (!begin()) SKIP("the module exr is not built")

static float value(int part, int channel, uint32_t x, uint32_t y) {
    switch ((x + y) % 7) {
    case 0:
        return 0;
    case 1:
        return INFINITY;
    case 2:
        return -1e-3f;
    default:
        return (float)(part + 1) * 1000.25f + (float)channel * 0.125f + (float)x - 3.5f * (float)y;
    }
}

/* What the nearest half is, for values that are not subnormal. */
static float half_of(float v) {
    if (!isfinite(v) || v == 0) return v;
    int e;
    frexpf(v, &e);
    float step = ldexpf(1, e - 11);
    return step * nearbyintf(v / step);
}

typedef struct expect {
    int parts, fail;
    const char *const *names;
    const uint32_t (*sizes)[2];
} expect;

/* Channels come in alphabetical order: N.Z (half), P.X, P.Y. */
static pbs_code look(void *ctx, const pbs_exr_part *part, pbs_err *e) {
    expect *want = ctx;
    int p = want->parts++;
    if (want->fail == want->parts) return pbs_fail(e, PBS_IO, "the sink is full");
    CHECK(!strcmp(part->name, want->names[p]));
    CHECK(part->width == want->sizes[p][0] && part->height == want->sizes[p][1]);
    CHECK(part->plane_count == 3);
    static const char *const channels[] = {"N.Z", "P.X", "P.Y"};
    CHECK(part->origin[0] == 1e7 && part->origin[1] == -2 && part->origin[2] == 0.5);
    for (int c = 0; c < part->plane_count && c < 3; c++) {
        const pbs_exr_plane *plane = &part->planes[c];
        CHECK(!strcmp(plane->channel, channels[c]) && plane->stride == 1 &&
              plane->half == (c == 0));
        int wrong = 0;
        for (uint32_t y = 0; y < part->height; y++)
            for (uint32_t x = 0; x < part->width; x++) {
                float v = value(p, c, x, y);
                wrong += plane->data[(size_t)y * part->width + x] != (c ? v : half_of(v));
            }
        CHECK_NUM(wrong == 0, wrong);
    }
    return PBS_OK;
}

static const char *const names[] = {"view0", "view1", "view2"};
static const uint32_t sizes[][2] = {{1, 1}, {37, 50}, {64, 16}};

/* Three parts; two channels interleaved, in another order than the file's. */
static pbs_code write_three(void) {
    pbs_exr_part parts[3];
    pbs_exr_plane planes[3][3];
    float *data[3];
    for (int p = 0; p < 3; p++) {
        size_t n = (size_t)sizes[p][0] * sizes[p][1];
        float *d = data[p] = malloc(n * 3 * sizeof *d);
        for (size_t i = 0; i < n; i++) {
            uint32_t x = (uint32_t)(i % sizes[p][0]), y = (uint32_t)(i / sizes[p][0]);
            d[2 * i] = value(p, 1, x, y);
            d[2 * i + 1] = value(p, 2, x, y);
            d[2 * n + i] = value(p, 0, x, y);
        }
        planes[p][0] = (pbs_exr_plane){"P.Y", d + 1, 2, 0};
        planes[p][1] = (pbs_exr_plane){"P.X", d, 2, 0};
        planes[p][2] = (pbs_exr_plane){"N.Z", d + 2 * n, 1, 1};
        parts[p] = (pbs_exr_part){names[p], sizes[p][0], sizes[p][1], planes[p], 3, {1e7, -2, 0.5}};
    }
    pbs_code rc = module->write(path, parts, 3, &err);
    for (int p = 0; p < 3; p++) free(data[p]);
    return rc;
}

TEST(round_trip) {
    NEED_EXR;
    CHECK(!write_three());
    expect want = {0, 0, names, sizes};
    pbs_code rc = module->read(&run, path, look, &want, &err);
    if (rc) printf("# %s\n", err.text);
    CHECK(!rc && want.parts == 3);
    want = (expect){0, 2, names, sizes};
    CHECK(module->read(&run, path, look, &want, &err) == PBS_IO && want.parts == 2);
    CHECK(!strcmp(err.text, "the sink is full"));
    end();
}

/* Writing the same again gives the same bytes, and replaces the old file. */
TEST(same_bytes) {
    NEED_EXR;
    static uint8_t a[100000], b[100000];
    CHECK(!write_three());
    FILE *f = fopen(path, "rb");
    size_t n = fread(a, 1, sizeof a, f);
    fclose(f);
    CHECK(!write_three());
    f = fopen(path, "rb");
    CHECK(n > 1000 && fread(b, 1, sizeof b, f) == n && !memcmp(a, b, n));
    fclose(f);
    end();
}

static pbs_code ignore(void *ctx, const pbs_exr_part *part, pbs_err *e) {
    (void)e;
    double *sum = ctx;
    for (int c = 0; c < part->plane_count; c++)
        for (size_t i = 0; i < (size_t)part->width * part->height; i++)
            *sum += isfinite(part->planes[c].data[i]);
    return PBS_OK;
}

static pbs_code read_bytes(const uint8_t *p, size_t n) {
    double sum = 0;
    memset(&err, 0, sizeof err);
    FILE *f = fopen(path, "wb");
    fwrite(p, 1, n, f);
    fclose(f);
    pbs_code rc = module->read(&run, path, ignore, &sum, &err);
    CHECK(rc == PBS_OK || (err.code == rc && *err.text));
    CHECK(pbs_mem_used(&run) == 0);
    return rc;
}

TEST(damaged) {
    NEED_EXR;
    static uint8_t good[100000], bad[100000];
    CHECK(!write_three());
    FILE *f = fopen(path, "rb");
    size_t n = fread(good, 1, sizeof good, f);
    fclose(f);
    run.mem_limit = (size_t)256 << 20;
    CHECK(read_bytes(good, n) == PBS_OK);
    for (size_t k = 0; k < n; k += k < 1500 ? 13 : 197) CHECK(read_bytes(good, k) != PBS_OK);
    uint32_t x = 3, fine = 0;
    for (int round = 0; round < 400; round++) {
        memcpy(bad, good, n);
        for (int k = 0; k < 2; k++) {
            x = x * 1664525 + 1013904223;
            bad[(x >> 4) % (round % 2 ? n : 1500)] ^= (uint8_t)(1 << (x >> 29));
        }
        fine += read_bytes(bad, n) == PBS_OK;
    }
    CHECK_NUM(fine < 400, fine);
    run.mem_limit = 1000;
    CHECK(read_bytes(good, n) == PBS_LIMIT);
    run.mem_limit = 0;
    end();
}

TEST(errors) {
    NEED_EXR;
    float data[4] = {0};
    pbs_exr_plane plane = {"R", data, 1, 0};
    pbs_exr_part part = {"a", 2, 2, &plane, 1, {0, 0, 0}};
    CHECK(module->write("/nonexistent/x.exr", &part, 1, &err) == PBS_IO);
    CHECK(strstr(err.text, "/nonexistent/x.exr"));
    CHECK(module->write(path, &part, 0, &err) == PBS_DATA);
    part.plane_count = 0;
    CHECK(module->write(path, &part, 1, &err) == PBS_DATA);
    part.plane_count = 1, part.width = 0;
    CHECK(module->write(path, &part, 1, &err) == PBS_DATA);
    CHECK(access(path, F_OK) != 0);
    CHECK(module->read(&run, path, ignore, data, &err) == PBS_IO);
    end();
}

TEST_MAIN
