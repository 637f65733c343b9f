/* STL: both kinds, told apart by size and not by their first word. */
#include "tests/sinkrec.h"

typedef struct out {
    char bytes[4096];
    size_t n;
} out;

static void put32(out *o, uint32_t v) {
    for (int i = 0; i < 4; i++) o->bytes[o->n++] = (char)(v >> 8 * i);
}

static void put_float(out *o, float f) {
    uint32_t v;
    memcpy(&v, &f, 4);
    put32(o, v);
}

static void begin(out *o, const char *head, uint32_t count) {
    memset(o, 0, sizeof *o);
    memcpy(o->bytes, head, strlen(head));
    o->n = 80;
    put32(o, count);
}

/* A triangle of area 2, i further along x. */
static void triangle(out *o, float i, uint16_t bits) {
    const float v[12] = {9, 9, 9, i, 0, 1, i + 2, 0, 1, i, 2, 1};
    for (int k = 0; k < 12; k++) put_float(o, v[k]);
    o->bytes[o->n++] = (char)bits, o->bytes[o->n++] = (char)(bits >> 8);
}

static void load(rec *r, const void *bytes, size_t n) {
    rec_begin(r);
    rec_import(r, pbs_import_stl, "folder/model.v2.stl", bytes, n);
}

static bool fails(const void *bytes, size_t n, const char *message) {
    rec r;
    load(&r, bytes, n);
    bool ok = r.code == PBS_DATA && strstr(r.err.text, message);
    if (!ok) printf("# %d %s, wanted %s\n", r.code, r.err.text, message);
    rec_end(&r);
    return ok;
}

TEST(binary) {
    static const char *const head[] = {"", "Exported", "solid like ascii", "solid\nfacet normal"};
    for (int h = 0; h < 4; h++) {
        out o;
        begin(&o, head[h], 3);
        for (int i = 0; i < 3; i++) triangle(&o, (float)(1000 + 4 * i), 0);
        rec r;
        load(&r, o.bytes, o.n);
        CHECK(!r.code && r.triangles == 3 && r.parts == 1 && rec_area(&r, 0) == 6);
        CHECK(!strcmp(r.part[0].name, "model.v2") && r.part[0].corners == 0);
        CHECK(r.part[0].origin[0] == 1004 && r.part[0].origin[2] == 1);
        CHECK(r.triangle[2].corner[1].position[0] == 1010 && r.triangle[2].material == PBS_NONE);
        CHECK(r.run.mem_peak < 1024);
        rec_end(&r);
    }
}

TEST(binary_counts_must_agree_with_the_size) {
    out o;
    begin(&o, "x", 2);
    triangle(&o, 0, 0), triangle(&o, 1, 0), triangle(&o, 2, 0);
    CHECK(fails(o.bytes, o.n, "promises 2 triangles, but has room for 3.00"));
    CHECK(fails(o.bytes, o.n - 51, "promises 2 triangles, but has room for 1.98"));
    o.bytes[83] = (char)0xff;
    CHECK(fails(o.bytes, o.n, "promises 4278190082 triangles"));
    begin(&o, "solid x", 1);
    triangle(&o, 0, 0);
    CHECK(fails(o.bytes, o.n - 1, "promises 1 triangles")); /* not taken for ascii */
    begin(&o, "x", 0);
    CHECK(fails(o.bytes, o.n, "has no triangles"));
}

TEST(colours) {
    out o;
    begin(&o, "VisCAM", 2); /* blue lowest, bit 15: there is one */
    triangle(&o, 0, 0x8000 | 31 << 10 | 16 << 5 | 0), triangle(&o, 1, 31);
    rec r;
    load(&r, o.bytes, o.n);
    static const uint8_t want[2][4] = {{255, 132, 0, 255}, {255, 255, 255, 255}};
    CHECK(!r.code && r.part[0].corners == PBS_CORNER_COLOUR);
    for (int i = 0; i < 6; i++)
        CHECK(!memcmp(r.triangle[i / 3].corner[i % 3].colour, want[i / 3], 4));
    rec_end(&r);
    begin(&o, "x COLOR=\x0a\x14\x1e\x28,MATERIAL=", 2); /* red lowest, bit 15: the header's */
    triangle(&o, 0, 31 | 16 << 5), triangle(&o, 1, 0xffff);
    load(&r, o.bytes, o.n);
    static const uint8_t other[2][4] = {{255, 132, 0, 255}, {10, 20, 30, 40}};
    CHECK(!r.code && r.part[0].corners == PBS_CORNER_COLOUR);
    for (int i = 0; i < 6; i++)
        CHECK(!memcmp(r.triangle[i / 3].corner[i % 3].colour, other[i / 3], 4));
    rec_end(&r);
}

#define FACET(x)                                                                                   \
    " facet normal 0 0 1\n  outer loop\n   vertex " x " 0 0\n   vertex 1e1 0 0\n"                  \
    "   vertex 0 1.5 0\n  endloop\n endfacet\n"

/* Copies text with every end of line replaced. */
static void with_ends(char *to, const char *text, const char *end) {
    for (; *text; text++)
        if (*text != '\n')
            *to++ = *text;
        else
            for (const char *e = end; *e; e++) *to++ = *e;
    *to = 0;
}

TEST(ascii) {
    static const char *const end[] = {"\n", "\r\n", "\r"};
    for (int e = 0; e < 3; e++) {
        char text[2048];
        with_ends(text,
                  "\nsolid part one\n" FACET("0") FACET("5") "endsolid part one\n\nSOLID\n" FACET(
                      "NaN") "EndSolid\nsolid empty\nendsolid",
                  end[e]);
        rec r;
        load(&r, text, strlen(text));
        CHECK(!r.code && r.parts == 3 && r.root_children == 3 && r.triangles == 3);
        CHECK(!strcmp(r.part[0].name, "part one") && r.part[0].triangles == 2);
        CHECK(!strcmp(r.part[1].name, "model.v2") && r.part[1].triangles == 1);
        CHECK(!strcmp(r.part[2].name, "empty") && r.part[2].triangles == 0);
        CHECK(rec_area(&r, 0) == 7.5 + 3.75);
        CHECK(isnan(r.triangle[2].corner[0].position[0])); /* the sink counts it */
        CHECK(r.part[0].origin[0] == 5 && r.part[0].origin[1] == 0.75);
        rec_end(&r);
    }
}

TEST(ascii_on_one_line_and_without_normals) {
    static const char text[] =
        "solid x\nfacet outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 "
        "endloop endfacet facet normal nan 1.#IND - outer loop vertex 0 0 0 "
        "vertex 4 0 0 vertex 4 4 0 vertex 2 1 0 vertex 0 4 0 endloop endfacet "
        "facet outer loop vertex 1 1 1 endloop endfacet endsolid";
    rec r;
    load(&r, text, sizeof text - 1);
    CHECK(!r.code && r.triangles == 4 && rec_area(&r, 0) == 10.5);
    CHECK(r.skipped[PBS_SKIP_POLYGON] == 1);
    rec_end(&r);
}

static bool fails_text(const char *text, const char *message) {
    return fails(text, strlen(text), message);
}

TEST(ascii_errors_say_the_line) {
    CHECK(fails_text("", "is empty"));
    CHECK(fails_text("solid x\n" FACET("0"), "line 9: the file ends where facet or endsolid"));
    CHECK(fails_text("solid x\n" FACET("zero") "endsolid", "line 4: \"zero\" where a number"));
    CHECK(
        fails_text("solid x\nfacet normal 0 0 1\n inner loop\n", "line 3: \"inner\" where outer"));
    CHECK(fails_text("solid x\nendsolid x\ngarbage\n", "line 3: \"garbage\" where solid should"));
    CHECK(fails_text("solid x\nendsolid x\n", "has no triangles"));
    CHECK(fails_text("solid x\n facet normal 0 0 1\n outer loop\n endloop\n endsolid\n",
                     "line 5: \"endsolid\" where endfacet should follow"));
    CHECK(fails_text("hello", "neither ascii STL nor long enough"));
}

TEST(every_truncation) {
    static const char text[] =
        "solid a\n" FACET("0") "endsolid a\nsolid b\n" FACET("1") "endsolid b\n";
    int good = 0;
    for (size_t n = 0; n < sizeof text; n++) {
        rec r;
        load(&r, text, n);
        CHECK(r.code == PBS_OK || r.code == PBS_DATA);
        good += r.code == PBS_OK;
        rec_end(&r);
    }
    /* whole, without its last blank, or cut in the name; and the same for the first solid alone */
    CHECK_NUM(good == 8, good);
    out o;
    begin(&o, "solid", 3);
    for (int i = 0; i < 3; i++) triangle(&o, (float)i, 0);
    for (size_t n = 0; n <= o.n; n++) {
        rec r;
        load(&r, o.bytes, n);
        CHECK(r.code == (n == o.n ? PBS_OK : PBS_DATA));
        rec_end(&r);
    }
}

TEST(every_byte_damaged) {
    static const char text[] = "solid a\n" FACET("0") "endsolid a\n";
    static const char with[] = {0, '\n', (char)0xff, '9', '-', 'e'};
    char damaged[sizeof text];
    for (size_t i = 0; i < sizeof text - 1; i++)
        for (size_t k = 0; k < sizeof with; k++) {
            memcpy(damaged, text, sizeof text);
            damaged[i] = with[k];
            rec r;
            load(&r, damaged, sizeof text - 1);
            CHECK(r.code == PBS_OK || r.code == PBS_DATA);
            rec_end(&r);
        }
}

TEST(cancel) {
    out o;
    begin(&o, "x", 1);
    triangle(&o, 0, 0);
    volatile sig_atomic_t stop = 1;
    rec r;
    rec_begin(&r);
    r.run.cancel = &stop;
    rec_import(&r, pbs_import_stl, "a.stl", o.bytes, o.n);
    CHECK(r.code == PBS_CANCEL);
    rec_end(&r);
}

TEST(other_peoples_files) {
    static const struct {
        const char *name;
        size_t triangles, parts;
    } file[] = {{"Spider_ascii.stl", 1368, 1},           {"Spider_binary.stl", 1368, 1},
                {"3DSMaxExport.STL", 2000, 1},           {"Wuson.stl", 3732, 1},
                {"triangle_with_empty_solid.stl", 1, 2}, {"triangle_with_two_solids.stl", 2, 2}};
    double area[6] = {0};
    for (size_t i = 0; i < sizeof file / sizeof *file; i++) {
        char path[200];
        size_t size;
        snprintf(path, sizeof path, "/usr/share/assimp/models/STL/%s", file[i].name);
        char *bytes = rec_file(path, &size);
        if (!bytes) SKIP("assimp-testmodels is not installed");
        rec r;
        rec_begin(&r);
        rec_import(&r, pbs_import_stl, path, bytes, size);
        CHECK(!r.code && r.triangles == file[i].triangles && r.parts == file[i].parts);
        area[i] = rec_area(&r, SIZE_MAX);
        rec_end(&r);
        free(bytes);
    }
    CHECK_NUM(fabs(area[0] / area[1] - 1) < 1e-6, area[0] / area[1]);
}

TEST_MAIN
