/* Readers of point clouds: every version and point format of LAS, PLY in all encodings, text in all
 * its dialects; what is cut off, damaged or of another kind has its own message. */
#include "formats/readers/cloud.h"
#include "tests/check.h"
#include "tests/cloudfile.h"
#include <math.h>
#include <unistd.h>

static pbs_err err;
static pbs_run run = {.threads = 1};

static void put(const char *path, const char *text, size_t n) {
    FILE *f = fopen(path, "wb");
    fwrite(text, 1, n, f);
    fclose(f);
}
static void put_text(const char *path, const char *text) {
    put(path, text, strlen(text));
}

/* Fails, with this in the message, which has the file's name in front. */
static bool fails(const char *path, const char *with) {
    pbs_cloud c;
    bool ok = pbs_cloud_open(&run, path, &c, &err) == PBS_DATA && strstr(err.text, with) &&
              !strncmp(err.text, path, strlen(path)) && !run.mem_used;
    if (!ok) printf("# %s\n", err.text);
    unlink(path);
    return ok;
}
static bool text_fails(const char *path, const char *text, const char *with) {
    put_text(path, text);
    return fails(path, with);
}

/* All points: positions, and colours as the cloud has them. */
static size_t read_all(const char *path, double (*p)[3], uint16_t (*colour)[3],
                       pbs_cloud_colour *kind) {
    pbs_cloud c;
    if (pbs_cloud_open(&run, path, &c, &err)) {
        printf("# %s\n", err.text);
        unlink(path);
        return 0;
    }
    size_t n = (size_t)c.count;
    for (size_t i = 0; i < n; i++) CHECK(!pbs_cloud_read(&c, i, 1, p + i, colour + i, &err));
    for (size_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) p[i][k] = c.offset[k] + c.scale[k] * p[i][k];
    *kind = c.colour;
    pbs_cloud_close(&c);
    CHECK(!run.mem_used);
    unlink(path);
    return n;
}

TEST(las_of_all_versions_and_formats) {
    const int32_t q[6] = {-2147483647 - 1, 7, 2147483647, 100, -200, 300};
    const uint16_t rgb[6] = {1, 2, 3, 65535, 300, 0};
    for (int minor = 0; minor <= 4; minor++)
        for (int format = 0; format <= 10; format++)
            for (int extra = 0; extra < 20; extra += 7) {
                las_desc d = {minor, format, extra, {0.001, 0.01, 0.5}, {1e6, -2e6, 0.5},
                              2,     0,      extra};
                double p[2][3];
                uint16_t c[2][3];
                pbs_cloud_colour kind;
                las_write("t.las", &d, q, rgb);
                CHECK(read_all("t.las", p, c, &kind) == 2);
                CHECK(p[0][0] == 1e6 + 0.001 * q[0] && p[0][2] == 0.5 + 0.5 * q[2]);
                CHECK(p[1][1] == -2e6 + 0.01 * q[4]);
                CHECK(kind == (las_red[format] ? PBS_CLOUD_COLOUR_ANY : PBS_CLOUD_NO_COLOUR));
                if (las_red[format]) CHECK(!memcmp(c, rgb, sizeof rgb));
            }
}

TEST(las_that_is_not_whole) {
    const int32_t q[9] = {0};
    las_desc d = {2, 0, 0, {1, 1, 1}, {0, 0, 0}, 3, 10650000, 0};
    las_write("t.las", &d, q, NULL);
    CHECK(fails("t.las", "says 10650000 points, and 3 of them are there"));
    d.said = 0, d.minor = 4, d.format = 6;
    d.said = 5000000000;
    las_write("t.las", &d, q, NULL);
    CHECK(fails("t.las", "says 5000000000 points, and 3"));
    d.said = 0;
    for (int i = 0; i < 4; i++) {
        const double bad[4] = {0, NAN, INFINITY, -INFINITY};
        d.scale[1] = bad[i];
        las_write("t.las", &d, q, NULL);
        CHECK(fails("t.las", "scale"));
    }
    d.scale[1] = 1, d.offset[2] = NAN;
    las_write("t.las", &d, q, NULL);
    CHECK(fails("t.las", "offset"));
    CHECK(text_fails("t.las", "LASF and nothing more", "cut off in the header"));
    CHECK(text_fails("t.las", "no such thing", "is not a LAS file"));
}

TEST(las_with_a_damaged_header) {
    const int32_t q[3] = {0};
    las_desc d = {2, 3, 0, {1, 1, 1}, {0, 0, 0}, 1, 0, 0};
    const struct {
        int at;
        uint8_t value;
        const char *what;
    } bad[] = {{104, 3 | 0x80, "LAZ"}, {104, 11, "format 11"}, {25, 5, "1.5"},     {24, 2, "2.2"},
               {105, 33, "damaged"},   {94, 226, "damaged"},   {96, 10, "damaged"}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        las_write("t.las", &d, q, NULL);
        FILE *f = fopen("t.las", "r+b");
        fseek(f, bad[i].at, SEEK_SET);
        fputc(bad[i].value, f);
        if (bad[i].at == 96) fputc(0, f);
        fclose(f);
        CHECK(fails("t.las", bad[i].what));
    }
}

/* ---- PLY ---- */

static size_t put_ply(const char *format, bool swap, const char *position, size_t size) {
    FILE *f = fopen("t.ply", "wb");
    fprintf(f,
            "ply\nformat %s 1.0\nelement camera 1\nproperty float f\nelement vertex 2\n"
            "property %s x\nproperty uchar skipped\nproperty %s y\nproperty %s z\n"
            "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
            format, position, position, position);
    fwrite("abcd", 1, 4, f);
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++) {
            double v = i ? -1.5 - k : 1e7 + k;
            float w = (float)v;
            uint8_t b[8];
            memcpy(b, size == 8 ? (void *)&v : &w, size);
            for (size_t j = 0; j < size; j++) fputc(b[swap ? size - 1 - j : j], f);
            if (!k) fputc(9, f);
            if (k == 2) fwrite("\x01\x80\xff", 1, 3, f);
        }
    long n = ftell(f);
    fclose(f);
    return (size_t)n;
}

static void check_ply(void) {
    double p[2][3];
    uint16_t c[2][3];
    pbs_cloud_colour kind;
    CHECK(read_all("t.ply", p, c, &kind) == 2);
    CHECK(p[0][0] == 1e7 && p[0][2] == 1e7 + 2 && p[1][0] == -1.5 && p[1][1] == -2.5);
    CHECK(kind == PBS_CLOUD_COLOUR_16);
    CHECK(c[1][0] >> 8 == 1 && c[1][1] >> 8 == 128 && c[1][2] >> 8 == 255);
}

TEST(ply_in_binary) {
    put_ply("binary_little_endian", false, "double", 8);
    check_ply();
    put_ply("binary_big_endian", true, "double", 8);
    check_ply();
    put_ply("binary_little_endian", false, "float", 4);
    check_ply();
    put_ply("binary_big_endian", true, "float", 4);
    check_ply();
    size_t n = put_ply("binary_little_endian", false, "double", 8);
    CHECK(!truncate("t.ply", (off_t)n - 1));
    CHECK(fails("t.ply", "says 2 points, and 1 of them are there"));
}

#define PLY_HEAD "ply\nformat ascii 1.0\nelement vertex 2\n"
#define PLY_XYZ  "property double x\nproperty double y\nproperty double z\n"

TEST(ply_as_text) {
    double p[2][3];
    uint16_t c[2][3];
    pbs_cloud_colour kind;
    put_text("t.ply", PLY_HEAD PLY_XYZ "property list uchar int skipped\nproperty float red\n"
                                       "property float green\nproperty float blue\nend_header\n"
                                       "1 2 3 2 7 7 0 0.5 1\n1e7 nan -3 0 1 2 -1\n");
    CHECK(read_all("t.ply", p, c, &kind) == 2);
    CHECK(p[0][2] == 3 && p[1][0] == 1e7 && isnan(p[1][1]) && kind == PBS_CLOUD_COLOUR_16);
    CHECK(c[0][0] == 0 && c[0][1] >> 8 == 128 && c[0][2] == 65535);
    CHECK(c[1][0] == 65535 && c[1][1] == 65535 && c[1][2] == 0);
    CHECK(text_fails("t.ply", PLY_HEAD PLY_XYZ "end_header\n1 2 3\n4 5\n", "2 points, and 1 of"));
    CHECK(text_fails("t.ply", PLY_HEAD PLY_XYZ "end_header\n1 2 3\n4 x 5\n", "line 9: a vertex"));
    CHECK(text_fails("t.ply", PLY_HEAD "property float x\nend_header\n1\n2\n", "no y"));
    CHECK(text_fails("t.ply", "ply\nformat ascii 1.0\nend_header\n", "no vertices"));
    CHECK(text_fails("t.ply",
                     PLY_HEAD PLY_XYZ "element face 4\nproperty list uchar int vertex_indices\n"
                                      "end_header\n",
                     "a mesh (4 face): pbs-gbuffer and pbs-voxelize read it"));
}

TEST(ply_colours_of_two_bytes) {
    FILE *f = fopen("t.ply", "wb");
    fputs("ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\n"
          "property float y\nproperty float z\nproperty ushort red\nproperty ushort green\n"
          "property ushort blue\nend_header\n",
          f);
    fwrite("\0\0\0\0\0\0\0\0\0\0\0\0\x01\x00\xff\xff\x00\x80", 1, 18, f);
    fclose(f);
    double p[1][3];
    uint16_t c[1][3];
    pbs_cloud_colour kind;
    CHECK(read_all("t.ply", p, c, &kind) == 1 && kind == PBS_CLOUD_COLOUR_ANY);
    CHECK(c[0][0] == 1 && c[0][1] == 65535 && c[0][2] == 32768);
}

/* ---- text ---- */

static bool text_is(const char *text, size_t count, const double last[3], const int colour[3]) {
    double p[8][3];
    uint16_t c[8][3];
    pbs_cloud_colour kind;
    put_text("t.xyz", text);
    size_t n = read_all("t.xyz", p, c, &kind);
    bool ok = n == count && !memcmp(p[n - 1], last, sizeof *p);
    if (!colour) return ok && kind == PBS_CLOUD_NO_COLOUR;
    for (int k = 0; k < 3; k++) ok = ok && c[n - 1][k] >> 8 == colour[k];
    return ok && kind == PBS_CLOUD_COLOUR_16;
}

TEST(text_in_its_dialects) {
    const double at[3] = {1, 2.5, -3e3};
    const int rgb[3] = {10, 20, 255}, shares[3] = {255, 128, 0};
    CHECK(text_is("1 2.5 -3e3", 1, at, NULL));
    CHECK(text_is("0 0 0 7\n1\t2.5   -3000 -2048\n", 2, at, NULL));
    CHECK(text_is("# c\n\n//X Y Z\n0,0,0,1,2,3\r\n1, 2.5 ,-3000,10,20,255\r\n", 2, at, rgb));
    CHECK(text_is("\xef\xbb\xbfx;y;z;r;g;b\n1;2.5;-3000;10;20;255\n", 1, at, rgb));
    CHECK(text_is("1\r1 2.5 -3e3 900 10 20 255\r", 1, at, rgb));
    CHECK(text_is("2\n0 0 0 1 2 3 4\n1 2.5 -3e3 900 10 20 255\n", 2, at, rgb));
    CHECK(text_is("1 2.5 -3e3 10 20 255 0 0 -1", 1, at, rgb));
    CHECK(text_is("0 0 0 0 1 0\n1 2.5 -3e3 0 0 -1", 2, at, NULL));
    CHECK(text_is("1 2.5 -3e3 1 0.5 0", 1, at, shares));
    CHECK(text_is("0 0 0 0 0 0\n1 2.5 -3e3 2600 5200 65535", 2, at, rgb));
    CHECK(text_is("1\n0 0 0\n1\n1 2.5 -3e3\n", 2, at, NULL));
}

TEST(text_that_is_none) {
    CHECK(text_fails("t.xyz", "1 2 3\n1 2\n", "line 2: is no point: 2 numbers where 3"));
    CHECK(text_fails("t.xyz", "1 2 3\n1 2 3 4\n", "line 2: is no point: 4 numbers"));
    CHECK(text_fails("t.xyz", "1 2\n", "line 1: is no point: 2 numbers where at least 3"));
    CHECK(text_fails("t.xyz", "1 2 3\n1 2 three\n", "line 2: is no point: a word"));
    CHECK(text_fails("t.pts", "3\n1 2 3\n1 2 3\n", "says 3 points, and 2 of them"));
    CHECK(text_fails("t.xyz", "# nothing\n", "no points"));
    CHECK(text_fails("t.xyz", "", "empty"));
}

TEST(other_formats_by_name) {
    CHECK(text_fails("t.e57", "ASTM-E57...", "E57 is not read: write LAS"));
    CHECK(text_fails("t.laz", "whatever", "LAZ is not read: unpack it"));
    CHECK(text_fails("t.obj", "v 0 0 0\n", "a mesh"));
    CHECK(text_fails("t.glb", "glTF", "a mesh"));
    put("t.bin", "a\0b", 3);
    CHECK(fails("t.bin", "neither a pbs stream nor a point cloud"));
    pbs_cloud c;
    CHECK(pbs_cloud_open(&run, "gone.las", &c, &err) == PBS_IO);
}

TEST_MAIN
