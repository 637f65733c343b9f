/* PLY: the same scene in all formats and types gives the same triangles; damaged files say where.
 */
#include "tests/sinkrec.h"

enum { ASCII, LITTLE, BIG, FORMATS };
static const char *const format_name[] = {"ascii", "binary_little_endian", "binary_big_endian"};

typedef struct out {
    char bytes[8192];
    size_t n;
    int format;
} out;

static void text(out *o, const char *s) {
    o->n += (size_t)snprintf(o->bytes + o->n, sizeof o->bytes - o->n, "%s", s);
}

static void begin(out *o, int format, const char *header) {
    o->n = 0, o->format = format;
    text(o, "ply\nformat ");
    text(o, format_name[format]);
    text(o, " 1.0\n");
    text(o, header);
    text(o, "end_header\n");
}

static void raw(out *o, const void *v, size_t size) {
    int little = 1, swap = *(char *)&little == (o->format == BIG);
    for (size_t i = 0; i < size; i++) o->bytes[o->n++] = ((const char *)v)[swap ? size - 1 - i : i];
}

/* One number; type as in the header. */
static void num(out *o, const char *type, double v) {
    if (o->format == ASCII) {
        char s[32];
        snprintf(s, sizeof s, "%.17g ", v);
        text(o, s);
        return;
    }
    char i8 = (char)(v < 0 ? v : (unsigned char)v);
    int16_t i16 = (int16_t)(v < 0 ? v : (uint16_t)v);
    int32_t i32 = (int32_t)(v < 0 ? (int64_t)v : (uint32_t)v);
    float f = (float)v;
    if (strstr(type, "char") || !strcmp(type, "int8") || !strcmp(type, "uint8"))
        raw(o, &i8, 1);
    else if (strstr(type, "short") || strstr(type, "int16"))
        raw(o, &i16, 2);
    else if (strstr(type, "int"))
        raw(o, &i32, 4);
    else if (!strcmp(type, "double") || !strcmp(type, "float64"))
        raw(o, &v, 8);
    else
        raw(o, &f, 4);
}

static void list(out *o, const char *count, const char *type, int n, const int *v) {
    num(o, count, n);
    for (int i = 0; i < n; i++) num(o, type, v[i]);
    if (o->format == ASCII) text(o, "\n");
}

static void load(rec *r, const out *o) {
    rec_begin(r);
    rec_import(r, pbs_import_ply, "folder/model.ply", o->bytes, o->n);
}

static bool fails(const out *o, const char *message) {
    rec r;
    load(&r, o);
    bool ok = r.code == PBS_DATA && strstr(r.err.text, message);
    if (!ok) printf("# %d %s, wanted %s\n", r.code, r.err.text, message);
    rec_end(&r);
    return ok;
}

static const double corner[5][3] = {{0, 0, 1}, {4, 0, 1}, {4, 4, 1}, {2, 1, 1}, {0, 4, 1}};
static const int outline[5] = {0, 1, 2, 3, 4};

TEST(all_types_and_formats) {
    static const char *const types[] = {"char",  "uchar",  "short",   "ushort", "int",   "uint",
                                        "float", "double", "int8",    "uint8",  "int16", "uint16",
                                        "int32", "uint32", "float32", "float64"};
    for (size_t t = 0; t < 16; t++)
        for (int f = 0; f < FORMATS; f++) {
            static out o;
            char header[400];
            const char *count =
                strstr(types[t], "flo") || strstr(types[t], "dou") ? "int" : types[t];
            snprintf(header, sizeof header,
                     "comment x\nelement vertex 5\nproperty uchar a\nproperty %s x\nproperty list "
                     "uchar short junk\nproperty %s z\nproperty %s y\nproperty double w\nelement "
                     "face 1\nproperty %s before\nproperty list %s %s vertex_index\n",
                     types[t], types[t], types[t], types[t], count, types[t]);
            begin(&o, f, header);
            for (int i = 0; i < 5; i++) {
                num(&o, "uchar", 9), num(&o, types[t], corner[i][0]);
                list(&o, "uchar", "short", i, outline);
                num(&o, types[t], corner[i][2]), num(&o, types[t], corner[i][1]);
                num(&o, "double", -1e300);
            }
            num(&o, types[t], 100);
            list(&o, count, types[t], 5, outline);
            rec r;
            load(&r, &o);
            CHECK(!r.code && r.triangles == 3 && r.parts == 1 && rec_area(&r, 0) == 10);
            CHECK(!strcmp(r.part[0].name, "model") && r.part[0].corners == 0);
            CHECK(r.part[0].origin[0] == 2 && r.part[0].origin[1] == 2 && r.part[0].origin[2] == 1);
            for (size_t i = 0; i < 3 * r.triangles; i++)
                CHECK(r.triangle[i / 3].corner[i % 3].position[2] == 1);
            rec_end(&r);
        }
}

/* Vertices of a fixed size are read in place: x, y, z in a row or not, aligned or not. */
TEST(records_in_place) {
    static const char *const header[] = {
        "element vertex 5\nproperty float x\nproperty float y\nproperty float z\n",
        "element vertex 5\nproperty uchar q\nproperty float x\nproperty float y\nproperty float "
        "z\n",
        "element vertex 5\nproperty float x\nproperty double y\nproperty uchar q\nproperty float "
        "z\n"};
    for (int f = 0; f < FORMATS; f++)
        for (int h = 0; h < 3; h++) {
            static out o;
            char all[400];
            snprintf(all, sizeof all, "%selement face 2\nproperty list uchar int vertex_indices\n",
                     header[h]);
            begin(&o, f, all);
            for (int i = 0; i < 5; i++) {
                if (h == 1) num(&o, "uchar", 7);
                num(&o, "float", corner[i][0]);
                num(&o, h == 2 ? "double" : "float", corner[i][1]);
                if (h == 2) num(&o, "uchar", 7);
                num(&o, "float", corner[i][2]);
            }
            list(&o, "uchar", "int", 3, outline);
            list(&o, "uchar", "int", 3, outline + 2);
            rec r;
            load(&r, &o);
            CHECK(!r.code && r.triangles == 2);
            for (int i = 0; i < 6 && r.triangles == 2; i++)
                CHECK(!memcmp(r.triangle[i / 3].corner[i % 3].position, corner[i < 3 ? i : i - 1],
                              sizeof *corner));
            if (f != ASCII) CHECK_NUM(r.run.mem_peak < 2048, r.run.mem_peak); /* nothing copied */
            rec_end(&r);
        }
}

#define XYZ   "property float x\nproperty float y\nproperty float z\n"
#define FACE1 "element face 1\nproperty list uchar int vertex_indices\n"

static void triangle(out *o, int format, const char *properties, const char *face, const char *type,
                     int extra, const double *value) {
    char header[600];
    snprintf(header, sizeof header, "element vertex 3\n" XYZ "%s%s", properties, face);
    begin(o, format, header);
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) num(o, "float", corner[i][k]);
        for (int k = 0; k < extra; k++) num(o, type, value[k]);
    }
    list(o, "uchar", "int", 3, outline);
}

TEST(colours) {
    static const struct {
        const char *type;
        double in[4];
    } how[] = {{"uchar", {255, 128, 0, 51}},
               {"ushort", {65535, 32896, 0, 13107}},
               {"float", {1, 0.501, -1, 0.2}},
               {"double", {255, 128, 0, 51}},
               {"int", {999, 128, -3, 51}}};
    static const uint8_t want[4] = {255, 128, 0, 51};
    for (int f = 0; f < FORMATS; f++)
        for (size_t h = 0; h < sizeof how / sizeof *how; h++) {
            static out o;
            char properties[300];
            const char *t = how[h].type;
            snprintf(properties, sizeof properties,
                     "property %s red\nproperty %s green\nproperty %s blue\nproperty %s alpha\n", t,
                     t, t, t);
            triangle(&o, f, properties, FACE1, t, 4, how[h].in);
            rec r;
            load(&r, &o);
            CHECK(!r.code && r.part[0].corners == PBS_CORNER_COLOUR && r.triangles == 1);
            for (int i = 0; i < 3; i++) CHECK(!memcmp(r.triangle[0].corner[i].colour, want, 4));
            rec_end(&r);
        }
}

TEST(normals_and_texture_coordinates) {
    static const char *const names[][2] = {{"s", "t"}, {"u", "v"}, {"texture_u", "texture_v"}};
    static const double in[5] = {0.25, -0.5, 2, 0.75, 0.125};
    for (int f = 0; f < FORMATS; f++)
        for (int h = 0; h < 3; h++) {
            static out o;
            char p[300];
            snprintf(p, sizeof p,
                     "property float nx\nproperty float ny\nproperty float nz\nproperty float %s\n"
                     "property float %s\n",
                     names[h][0], names[h][1]);
            triangle(&o, f, p, FACE1, "float", 5, in);
            rec r;
            load(&r, &o);
            CHECK(!r.code && r.part[0].corners == (PBS_CORNER_NORMAL | PBS_CORNER_UV));
            const pbs_corner *c = &r.triangle[0].corner[1];
            CHECK(c->normal[0] == 0.25f && c->normal[1] == -0.5f && c->normal[2] == 2);
            CHECK(c->uv[0] == 0.75f && c->uv[1] == 0.875f);
            rec_end(&r);
        }
}

TEST(face_colours_and_wedge_coordinates) {
    for (int f = 0; f < FORMATS; f++) {
        static out o;
        triangle(&o, f, "",
                 "comment TextureFile no such file.png\nelement face 1\n"
                 "property list uchar int vertex_indices\nproperty list uchar float texcoord\n"
                 "property uchar red\nproperty uchar green\nproperty uchar blue\n",
                 "", 0, NULL);
        num(&o, "uchar", 6);
        for (int i = 0; i < 6; i++) num(&o, "float", i * 0.125);
        num(&o, "uchar", 10), num(&o, "uchar", 20), num(&o, "uchar", 30);
        rec r;
        rec_begin(&r);
        r.allow_missing = true;
        rec_import(&r, pbs_import_ply, "model.ply", o.bytes, o.n);
        CHECK(!r.code && r.part[0].corners == (PBS_CORNER_COLOUR | PBS_CORNER_UV));
        CHECK(r.missings == 1 && !strcmp(r.missing[0], "no such file.png"));
        CHECK(r.materials == 1 && r.triangle[0].material == 0);
        static const uint8_t want[4] = {10, 20, 30, 255};
        for (int i = 0; i < 3; i++) {
            CHECK(!memcmp(r.triangle[0].corner[i].colour, want, 4));
            CHECK(r.triangle[0].corner[i].uv[0] == i * 0.25f);
            CHECK(r.triangle[0].corner[i].uv[1] == 0.875f - i * 0.25f);
        }
        rec_end(&r);
    }
}

/* Two strips over a 2 x n ladder: all triangles must look the same way. */
TEST(strips) {
    static const int ladder[] = {0, 1, 2, 3, 4, 5, -1, 6, 7, 8, 9};
    for (int f = 0; f < FORMATS; f++) {
        static out o;
        begin(&o, f,
              "element vertex 10\n" XYZ "element tristrips 1\nproperty list int int "
              "vertex_indices\n");
        for (int i = 0; i < 10; i++)
            num(&o, "float", i / 2), num(&o, "float", i % 2), num(&o, "float", 0);
        list(&o, "int", "int", 11, ladder);
        rec r;
        load(&r, &o);
        CHECK(!r.code && r.triangles == 4 + 2 && rec_area(&r, 0) == 3);
        for (size_t i = 0; i < r.triangles; i++) {
            double a[3];
            rec_area_vector(r.triangle[i].corner, a);
            CHECK(a[2] == -1);
        }
        rec_end(&r);
    }
}

TEST(faces_before_vertices_and_other_elements) {
    for (int f = 0; f < FORMATS; f++) {
        static out o;
        begin(&o, f,
              "element junk 2\nproperty list int double d\nproperty short s\nelement none 99"
              "99999999\n" FACE1 "element vertex 5\n" XYZ "element edge 1\nproperty int a\n");
        for (int i = 0; i < 2; i++) list(&o, "int", "double", 2 * i, outline), num(&o, "short", -9);
        list(&o, "uchar", "int", 5, outline);
        for (int i = 0; i < 5; i++)
            for (int k = 0; k < 3; k++) num(&o, "float", corner[i][k]);
        num(&o, "int", 3);
        rec r;
        load(&r, &o);
        CHECK(!r.code && r.triangles == 3 && rec_area(&r, 0) == 10);
        rec_end(&r);
        o.n -= 2; /* the edge is cut off, behind everything that is of interest */
        CHECK(f == ASCII || fails(&o, "edge 0: the file ends too early: 1 are promised"));
        text(&o, "  777 888 ");
        CHECK(fails(&o, "follow the last element"));
    }
}

TEST(header_forms) {
    static const char *const good[] = {
        "ply\r\nformat ascii 1.0\r\nelement vertex 3\r\nproperty float x\r\nproperty float y\r\n"
        "property float z\r\nelement face 1\r\nproperty list uchar int "
        "vertex_index\r\nend_header\r\n"
        "0 0 0\r\n1 0 0\r\n0 1 0\r\n3 0 1 2\r\n",
        "ply\rformat ascii 1.0\rcomment y\relement vertex 3\rproperty float x\rproperty float y\r"
        "property float z\relement face 1\rproperty list uchar int vertex_index\rend_header\r"
        "0 0 0\r1 0 0\r0 1 0\r3 0 1 2",
        "ply\nformat ascii 1.0\nMade by a program that forgets comment\nobj_info x\nelement vertex "
        "3  \n" XYZ FACE1 "end_header\n0 0 0 1 0 0 0 1 0 3 0 1 2.0"};
    for (int i = 0; i < 3; i++) {
        rec r;
        rec_begin(&r);
        rec_import(&r, pbs_import_ply, "a.ply", good[i], strlen(good[i]));
        CHECK(!r.code && r.triangles == 1);
        rec_end(&r);
    }
}

static bool fails_text(const char *header, const char *body, const char *message) {
    static out o;
    begin(&o, ASCII, header);
    text(&o, body);
    return fails(&o, message);
}

TEST(errors_say_where) {
#define THREE "element vertex 3\n" XYZ
    CHECK(fails_text(THREE FACE1, "0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n",
                     "line 13: face 0: vertex 3, but"));
    CHECK(fails_text(THREE FACE1, "0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "line 13: face 0: vertex -1"));
    CHECK(fails_text(THREE FACE1, "0 0 0\n1 0 0\n0 1 0\n3 0 1 1.5\n", "vertex 1.5"));
    CHECK(fails_text(THREE FACE1, "0 0 0\n1 0 0\n0 1 0\n-3 0 1 1\n", "a list of -3 elements"));
    CHECK(fails_text(THREE FACE1, "0 0 0\n1 zero 0\n0 1 0\n3 0 1 1\n",
                     "line 11: vertex 1: \"zero\" is not a number"));
    CHECK(
        fails_text(THREE FACE1, "0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "face 0: the file ends too early"));
    CHECK(fails_text(THREE, "0 0 0\n1 0 0\n0 1 0\n", "only 3 vertices"));
    CHECK(fails_text(THREE "element face 0\nproperty list uchar int vertex_indices\n", "0 0 0",
                     "no faces"));
    CHECK(fails_text(FACE1, "3 0 1 2", "no vertices"));
    CHECK(fails_text("", "", "has no faces and no vertices"));
    CHECK(fails_text(THREE "element face 1\nproperty int q\n", "0 0 0\n1 0 0\n0 1 0\n3 \n",
                     "no list vertex_indices"));
    CHECK(
        fails_text("element vertex 3\nproperty float x\n" FACE1, "0 0 0 3 0 1 2", "no x, y and z"));
    CHECK(fails_text("element vertex\n", "", "line 3: an element without a count"));
    CHECK(fails_text("element vertex -1\n", "", "line 3: an element without a count"));
    CHECK(fails_text("property int x\n", "", "line 3: a property without an element"));
    CHECK(
        fails_text("element vertex 3\nproperty colour x\n", "", "line 4: a property of no known"));
    CHECK(fails_text("element f 3\nproperty list float int x\n", "", "line 4: a list whose count"));
    CHECK(fails(&(out){"ply\nelement x 0\nend_header\n", 27, ASCII}, "the header has no format"));
    CHECK(fails(&(out){"ply\nformat ascii 1.0\n", 21, ASCII}, "no end_header"));
    CHECK(fails(&(out){"plyx\n", 5, ASCII}, "not a PLY file"));
    CHECK(fails(&(out){"ply\nformat binary 1.0\n", 22, ASCII}, "line 2: the format"));
}

/* Counts that lie allocate nothing and are refused at once. */
TEST(huge_counts) {
    static const char *const header[] = {
        "element vertex 4000000000000\n" XYZ FACE1,
        "element vertex 99999999999999999999999999\n" XYZ FACE1,
        "element vertex 3\n" XYZ "element face 18446744073709551615\nproperty list uchar int "
        "vertex_indices\n",
        "element vertex 5000000000\n" XYZ "property list int int q\n" FACE1,
        "element junk 800000000000\nproperty list uchar int q\nelement vertex 3\n" XYZ FACE1};
    for (int f = 0; f < FORMATS; f++) {
        static out o;
        for (int h = 0; h < 5; h++) {
            begin(&o, f, header[h]);
            for (int i = 0; i < 9; i++) num(&o, "float", i);
            list(&o, "uchar", "int", 3, outline);
            rec r;
            load(&r, &o);
            CHECK(r.code == PBS_DATA && r.run.mem_peak < 100000);
            rec_end(&r);
        }
        begin(&o, f, THREE "element face 1\nproperty list uint int vertex_indices\n");
        for (int i = 0; i < 9; i++) num(&o, "float", i);
        num(&o, "uint", 4294967295.0), num(&o, "int", 0), num(&o, "int", 0);
        rec r;
        load(&r, &o);
        CHECK(r.code == PBS_DATA && r.run.mem_peak < 100000 && strstr(r.err.text, "face 0"));
        rec_end(&r);
    }
}

static void whole(out *o, int f) {
    begin(o, f,
          "element vertex 5\n" XYZ "property uchar red\nproperty uchar green\nproperty uchar "
          "blue\nelement face 2\nproperty list uchar uint vertex_indices\nproperty list char "
          "float texcoord\nelement tristrips 1\nproperty list int int vertex_indices\n");
    for (int i = 0; i < 5; i++) {
        for (int k = 0; k < 3; k++) num(o, "float", corner[i][k]);
        for (int k = 0; k < 3; k++) num(o, "uchar", 40 * i + k);
    }
    list(o, "uchar", "uint", 5, outline), num(o, "char", 0);
    list(o, "uchar", "uint", 3, outline), num(o, "char", 6);
    for (int i = 0; i < 6; i++) num(o, "float", i);
    list(o, "int", "int", 4, outline);
}

TEST(every_truncation) {
    for (int f = 0; f < FORMATS; f++) {
        static out o;
        whole(&o, f);
        size_t size = o.n;
        for (size_t n = 0; n <= size; n++) {
            o.n = n;
            rec r;
            load(&r, &o);
            /* binary has no slack; the last number of ascii may lose digits or its blank */
            CHECK(r.code == (n == size ? PBS_OK : PBS_DATA) || (f == ASCII && n + 2 >= size));
            rec_end(&r);
        }
    }
}

TEST(every_byte_damaged) {
    static const char with[] = {0, '\n', (char)0xff, '9', '-', (char)0x80, ' '};
    for (int f = 0; f < FORMATS; f++) {
        static out o, damaged;
        whole(&o, f);
        for (size_t i = 0; i < o.n; i++)
            for (size_t k = 0; k < sizeof with; k++) {
                damaged = o;
                damaged.bytes[i] = with[k];
                rec r;
                load(&r, &damaged);
                CHECK(r.code == PBS_OK || r.code == PBS_DATA);
                CHECK(r.run.mem_peak < 100000);
                rec_end(&r);
            }
    }
}

TEST(memory_limit_and_cancel) {
    static out o;
    whole(&o, ASCII);
    rec r;
    rec_begin(&r);
    r.run.mem_limit = 1000;
    rec_import(&r, pbs_import_ply, "a.ply", o.bytes, o.n);
    CHECK(r.code == PBS_LIMIT);
    rec_end(&r);
    volatile sig_atomic_t stop = 1;
    rec_begin(&r);
    r.run.cancel = &stop;
    rec_import(&r, pbs_import_ply, "a.ply", o.bytes, o.n);
    CHECK(r.code == PBS_CANCEL);
    rec_end(&r);
}

/* Vertices of a text that do not fit into the limit go to a file, and nothing else changes. */
TEST(more_vertices_than_memory) {
    enum { N = 40000 };
    char *text = malloc(N * 32 + 200);
    if (!text) abort();
    size_t n = (size_t)sprintf(text,
                               "ply\nformat ascii 1.0\nelement vertex %d\nproperty double x\n"
                               "property double y\nproperty double z\nelement face %d\n"
                               "property list uchar int vertex_indices\nend_header\n",
                               N, N / 2);
    for (int i = 0; i < N; i++) n += (size_t)sprintf(text + n, "%d %d %d\n", i, -i, i % 7);
    for (int i = 0; i < N / 2; i++)
        n += (size_t)sprintf(text + n, "3 %d %d %d\n", i, N - 1 - i, i + 1);
    for (int limited = 0; limited < 2; limited++) {
        rec r;
        int wrong = 0;
        rec_begin(&r);
        r.run.mem_limit = limited ? 1 << 20 : 0;
        rec_import(&r, pbs_import_ply, "a.ply", text, n);
        CHECK(!r.code && r.triangles == N / 2);
        CHECK(!limited || r.run.mem_peak < 1 << 20);
        for (int i = 0; i < N / 2; i++) {
            const pbs_corner *c = r.triangle[i].corner;
            wrong += c[0].position[0] != i || c[1].position[1] != 1 - N + i ||
                     c[2].position[2] != (i + 1) % 7;
        }
        CHECK_NUM(wrong == 0, wrong);
        rec_end(&r);
    }
    free(text);
}

TEST(other_peoples_files) {
    static const struct {
        const char *name;
        size_t triangles;
        uint32_t corners;
    } file[] = {{"cube", 12, 0},
                {"cube_binary", 12, 0},
                {"cube_uv", 12, PBS_CORNER_NORMAL | PBS_CORNER_UV},
                {"float-color", 1, PBS_CORNER_COLOUR},
                {"Wuson", 3732, PBS_CORNER_NORMAL | PBS_CORNER_UV}};
    for (size_t i = 0; i < sizeof file / sizeof *file; i++) {
        char path[200];
        size_t size;
        snprintf(path, sizeof path, "/usr/share/assimp/models/PLY/%s.ply", file[i].name);
        char *bytes = rec_file(path, &size);
        if (!bytes) SKIP("assimp-testmodels is not installed");
        rec r;
        rec_begin(&r);
        rec_import(&r, pbs_import_ply, path, bytes, size);
        CHECK(!r.code && r.triangles == file[i].triangles && r.part[0].corners == file[i].corners);
        rec_end(&r);
        free(bytes);
    }
}

TEST_MAIN
