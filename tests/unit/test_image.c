/* test_image.c: pictures in and out: PPM and PAM by hand, the rest through the module. */
#include "formats/readers/image.h"
#include "formats/readers/module.h"
#include "tests/check.h"
#include <sys/stat.h>
#include <unistd.h>

static pbs_run run = {.threads = 1};
static pbs_err err;
static char folder[] = "/tmp/pbs-image-XXXXXX";

static bool is_left_out(void) {
    const void *table;
    return pbs_module_open(&run, "image", 0, &table, &err) && strstr(err.text, "not installed");
}
#define NEED_IMAGE                                                                                 \
    if (is_left_out()) SKIP("the module image is not built")

static const char *in_folder(const char *name) {
    static char path[128];
    if (strstr(folder, "XXXXXX") && !mkdtemp(folder)) abort();
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

/* Every combination of colour and alpha that goes wrong easily, in w x h pixels. */
static pbs_image make(uint32_t w, uint32_t h) {
    pbs_image image = {w, h, NULL};
    if (pbs_alloc(&run, &image.rgba, (size_t)w * h, 4, "test", &err)) abort();
    for (uint32_t i = 0; i < w * h; i++) {
        const uint8_t p[4] = {(uint8_t)(i * 7), (uint8_t)(255 - i), (uint8_t)(i * i),
                              (uint8_t)(i * 85 % 256)};
        memcpy(image.rgba + 4 * i, p, 4);
    }
    return image;
}

static int worst(const pbs_image *a, const pbs_image *b, int channels) {
    if (a->width != b->width || a->height != b->height) return 1000;
    int max = 0;
    for (size_t i = 0; i < (size_t)a->width * a->height; i++)
        for (int k = 0; k < channels; k++) {
            int d = abs(a->rgba[4 * i + (size_t)k] - b->rgba[4 * i + (size_t)k]);
            max = d > max ? d : max;
        }
    return max;
}

static void round_trip(const char *ending, int channels, int tolerance) {
    const uint32_t sizes[][2] = {{1, 1}, {17, 5}, {3, 64}};
    for (int s = 0; s < 3; s++) {
        char name[32];
        snprintf(name, sizeof name, "x y.%s", ending);
        const char *path = in_folder(name);
        pbs_image in = make(sizes[s][0], sizes[s][1]), out;
        pbs_code rc = pbs_image_write(&run, path, &in, &err);
        CHECK(!rc);
        if (!rc && !(rc = pbs_image_read(&run, path, &out, &err))) {
            CHECK_NUM(worst(&in, &out, channels) <= tolerance, worst(&in, &out, channels));
            for (size_t i = 0; channels < 4 && i < (size_t)out.width * out.height; i++)
                if (out.rgba[4 * i + 3] != 255) CHECK(!"no alpha is full alpha");
            pbs_free(&run, out.rgba);
        }
        if (rc) printf("# %s\n", err.text);
        CHECK(!rc);
        pbs_free(&run, in.rgba);
        unlink(path);
    }
    CHECK(rmdir(folder) == 0); /* nothing else was left there */
    strcpy(strrchr(folder, '-'), "-XXXXXX");
}

TEST(ppm) {
    round_trip("ppm", 3, 0);
}
TEST(pam) {
    round_trip("PAM", 4, 0);
}
TEST(png) {
    NEED_IMAGE;
    round_trip("png", 4, 0);
}
TEST(tga) {
    NEED_IMAGE;
    round_trip("tga", 4, 0);
}
TEST(bmp) {
    NEED_IMAGE;
    round_trip("bmp", 4, 0);
}
TEST(jpg) { /* noise at the coarse end of the format */
    NEED_IMAGE;
    round_trip("jpg", 3, 255);
}

static pbs_code decode(const void *bytes, size_t n, pbs_image *out) {
    memset(&err, 0, sizeof err);
    uint8_t *copy = malloc(n ? n : 1);
    memcpy(copy, bytes, n);
    pbs_code rc = pbs_image_decode(&run, "pic", copy, n, out, &err);
    free(copy);
    CHECK(rc == PBS_OK || (out->rgba == NULL && err.code == rc));
    return rc;
}

TEST(headers) {
    const struct {
        const char *text;
        uint8_t first[4];
    } good[] = {{"P6 1 1 255\n\1\2\3", {1, 2, 3, 255}},
                {"P6\n# a comment\n1 # one\n1\n255 \1\2\3", {1, 2, 3, 255}},
                {"P7\nWIDTH 1\nHEIGHT 1\nDEPTH 1\nMAXVAL 255\nTUPLTYPE GRAYSCALE\nENDHDR\n\7",
                 {7, 7, 7, 255}},
                {"P7\nWIDTH 1\n#\nHEIGHT 1\nDEPTH 2\nMAXVAL 255\nENDHDR\n\7\10", {7, 7, 7, 8}},
                {"P7\nWIDTH 1\nHEIGHT 1\nMAXVAL 255\nDEPTH 4\nENDHDR\n\1\2\3\4", {1, 2, 3, 4}}};
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        pbs_image out;
        size_t n = strlen(good[i].text);
        CHECK(decode(good[i].text, n, &out) == PBS_OK);
        CHECK(out.width == 1 && out.height == 1 && out.rgba && !memcmp(out.rgba, good[i].first, 4));
        pbs_free(&run, out.rgba);
        /* the last byte missing, and everything before */
        for (size_t k = 3; k < n; k++) CHECK(decode(good[i].text, k, &out) == PBS_DATA);
    }
    const char *bad[] = {"P6 0 1 255\n123",
                         "P6 1 -1 255\n123",
                         "P6 1 1 254\n123",
                         "P6 16385 1 255\n123",
                         "P6 4294967296 4294967296 255\n123",
                         "P6 9999 9999 255\n1",
                         "P6 x 1 255\n123",
                         "P7\nWIDTH 1\nHEIGHT 1\nDEPTH 5\nMAXVAL 255\nENDHDR\n12345"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        pbs_image out;
        CHECK(decode(bad[i], strlen(bad[i]), &out) == PBS_DATA);
    }
    pbs_image out;
    CHECK(decode("", 0, &out) == PBS_DATA && !strcmp(err.text, "pic: the image is empty"));
}

/* 16 bits, a format that says more than there is, and files that are no image. */
TEST(module_decode) {
    NEED_IMAGE;
    pbs_image out;
    CHECK(decode("P6 1 1 65535\n\x80\0\xff\xff\0\0", 19, &out) == PBS_OK);
    CHECK(out.rgba[0] == 128 && out.rgba[1] == 255 && out.rgba[2] == 0 && out.rgba[3] == 255);
    pbs_free(&run, out.rgba);
    CHECK(decode("hello", 5, &out) == PBS_DATA && strstr(err.text, "pic: "));

    pbs_image in = make(20, 20);
    const char *path = in_folder("x.png");
    CHECK(!pbs_image_write(&run, path, &in, &err));
    uint8_t png[8192];
    FILE *f = fopen(path, "rb");
    size_t n = fread(png, 1, sizeof png, f);
    fclose(f);
    for (size_t k = 0; k < n; k += 7) /* cut off */
        CHECK(decode(png, k, &out) == PBS_DATA);
    /* Targa has no checksum: 65535 x 65535 pixels in 20 bytes. */
    static const uint8_t huge[20] = {0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 255, 255, 255, 255, 24};
    CHECK(decode(huge, sizeof huge, &out) == PBS_DATA);
    CHECK(strstr(err.text, "65535 x 65535 is more than 16384 a side"));
    uint32_t x = 5;
    for (int round = 0; round < 60; round++) {
        uint8_t bad[8192];
        memcpy(bad, png, n);
        for (int k = 0; k < 3; k++) {
            x = x * 1664525 + 1013904223;
            bad[(x >> 4) % n] ^= (uint8_t)(1 << (x >> 29));
        }
        CHECK(decode(bad, n, &out) == (memcmp(bad, png, n) ? PBS_DATA : PBS_OK));
        pbs_free(&run, out.rgba);
    }
    unlink(path);
    rmdir(folder);
    strcpy(strrchr(folder, '-'), "-XXXXXX");
    pbs_free(&run, in.rgba);
}

TEST(write_errors) {
    pbs_image in = make(2, 2), empty = {0};
    CHECK(pbs_image_write(&run, "/nonexistent/x.ppm", &in, &err) == PBS_IO);
    CHECK(!strcmp(err.text, "/nonexistent/x.ppm: cannot be written: No such file or directory"));
    CHECK(pbs_image_write(&run, in_folder("noending"), &in, &err) == PBS_USAGE);
    CHECK(pbs_image_write(&run, in_folder(".ppm"), &in, &err) == PBS_USAGE);
    CHECK(pbs_image_write(&run, in_folder("x.ppm"), &empty, &err) == PBS_DATA);
    mkdir(in_folder("y.ppm"), 0777);
    CHECK(pbs_image_write(&run, in_folder("y.ppm"), &in, &err) == PBS_IO);
    rmdir(in_folder("y.ppm"));
    CHECK(pbs_image_read(&run, in_folder("gone.ppm"), &empty, &err) == PBS_IO);
    CHECK(pbs_image_read(&run, "/tmp", &empty, &err) == PBS_IO);
    if (!is_left_out())
        CHECK(pbs_image_write(&run, in_folder("x.unknown"), &in, &err) == PBS_USAGE);
    CHECK(rmdir(folder) == 0);
    strcpy(strrchr(folder, '-'), "-XXXXXX");
    pbs_free(&run, in.rgba);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST_MAIN
