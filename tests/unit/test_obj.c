/* OBJ and MTL, from text in strings. */
#include "tests/sinkrec.h"
#include <sys/stat.h>
#include <unistd.h>

static void load(rec *r, const char *text) {
    rec_begin(r);
    rec_import(r, pbs_import_obj, "folder/model.obj", text, strlen(text));
}

#define SQUARE "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\n"

static bool fails(const char *text, const char *message) {
    rec r;
    load(&r, text);
    bool ok = r.code == PBS_DATA && strstr(r.err.text, message);
    if (!ok) printf("# %d %s, wanted %s\n", r.code, r.err.text, message);
    rec_end(&r);
    return ok;
}

TEST(one_triangle) {
    rec r;
    load(&r, "v 1 2 3\nv 4 5 6\nv 7 8 10\nf 1 2 3");
    CHECK(!r.code && r.triangles == 1 && r.parts == 1 && r.root_children == 1);
    CHECK(!strcmp(r.part[0].name, "model") && r.part[0].corners == 0);
    static const double want[3][3] = {{1, 2, 3}, {4, 5, 6}, {7, 8, 10}};
    for (int i = 0; i < 3; i++)
        CHECK(!memcmp(r.triangle[0].corner[i].position, want[i], sizeof want[i]));
    rec_end(&r);
}

TEST(every_way_to_name_a_corner) {
    static const char *const faces[] = {
        "f 1/1/1 2/2/1 3/3/1\n",          "f -3/-3/-1 -2/-2/-1 -1/-1/-1\n",
        "f 1/1/1 2/2/1 3/3/1 # end",      "f\t1/1/1\t2/2/1  3/3/1 \r\n",
        "f 1/1/1 \\\n2/2/1 \\\r\n 3/3/1", "fo 1/1/1 2/2/1 3/3/1",
        "  f 1/1/1 2/2/1 3/3/1\\"};
    for (size_t i = 0; i < sizeof faces / sizeof *faces; i++) {
        char text[256];
        snprintf(text, sizeof text,
                 "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0.5 .25\nvn 0 0 1\n%s", faces[i]);
        rec r;
        load(&r, text);
        CHECK(!r.code && r.triangles == 1);
        CHECK(r.part[0].corners == (PBS_CORNER_NORMAL | PBS_CORNER_UV));
        if (r.triangles == 1) {
            const pbs_corner *c = r.triangle[0].corner;
            CHECK(c[1].position[0] == 1 && c[2].normal[2] == 1);
            CHECK(c[2].uv[0] == 0.5f && c[2].uv[1] == 0.75f); /* downwards */
        }
        rec_end(&r);
    }
}

TEST(attributes_are_those_of_the_part) {
    rec r;
    load(&r, SQUARE "vt 0 0\nvn 0 0 1\no a\nf 1 2 3\no b\nf 1//1 2//1 3//1\no c\nf 1/1 2/1 3/1\n"
                    "o d\nf 1// 2// 3//\no e\nf 1/ 2/ 3/\n");
    static const uint32_t want[] = {0, PBS_CORNER_NORMAL, PBS_CORNER_UV, 0, 0};
    CHECK(!r.code && r.parts == 5);
    for (int i = 0; i < 5; i++) CHECK(r.part[i].corners == want[i] && r.part[i].triangles == 1);
    rec_end(&r);
}

/* What is at line n, whichever way its lines end. */
TEST(line_ends) {
    static const char *const end[] = {"\n", "\r\n", "\r"};
    for (int i = 0; i < 3; i++) {
        char text[256];
        snprintf(text, sizeof text, "# x%sv 0 0 0%sv 1 0 0%sv 0 1 0%s%sf 1 2 3%s", end[i], end[i],
                 end[i], end[i], end[i], end[i]);
        rec r;
        load(&r, text);
        CHECK(!r.code && r.triangles == 1);
        rec_end(&r);
        text[strlen(text) - strlen(end[i]) - 1] = '4';
        CHECK(fails(text, "line 6: vertex 4, but there are 3"));
    }
}

TEST(parts) {
    rec r;
    load(&r, SQUARE "f 1 2 3\ng first group\nf 1 2 3\nf 1 3 4\ng first group\nf 1 2 4\n"
                    "g nothing\ng\nf 2 3 4\ng \tlast \r\nf 1 2 3\n");
    CHECK(!r.code && r.parts == 4 && r.root_children == 4);
    CHECK(!strcmp(r.part[0].name, "model") && r.part[0].triangles == 1);
    CHECK(!strcmp(r.part[1].name, "first group") && r.part[1].triangles == 3);
    CHECK(!strcmp(r.part[2].name, "model") && r.part[2].triangles == 1);
    CHECK(!strcmp(r.part[3].name, "last") && r.part[3].triangles == 1);
    rec_end(&r);
    load(&r, SQUARE "o a\ng x\nf 1 2 3\ng y\nf 1 3 4\no b\nf 1 2 4\n"); /* o wins over g */
    CHECK(!r.code && r.parts == 2 && !strcmp(r.part[0].name, "a") && r.part[0].triangles == 2);
    rec_end(&r);
}

TEST(origin_is_in_the_middle_of_the_part) {
    rec r;
    load(&r, "v 10000000.125 0 0\nv 10000002.125 0 0\nv 10000002.125 2 0\nv 10000000.125 2 8\n"
             "v nan 0 0\nv -5e6 -5e6 -5e6\nv -4e6 -5e6 -5e6\nv -5e6 -4e6 -5e6\n"
             "o a\nf 1 2 3\nf 2 3 4\nf 3 4 1\nf 4 1 2\nf 5 1 2\no b\nf 6 7 8\n");
    CHECK(!r.code && r.parts == 2);
    CHECK(r.part[0].origin[0] == 10000001.125 && r.part[0].origin[1] == 1);
    CHECK(r.part[0].origin[2] == 4);
    CHECK(r.part[1].origin[0] == -5e6);
    CHECK(r.triangle[0].corner[0].position[0] == 10000000.125);
    rec_end(&r);
}

TEST(polygons) {
    rec r;
    load(&r, "v 0 0 1\nv 4 0 1\nv 4 4 1\nv 2 1 1\nv 0 4 1\nv 2 0 1\n"
             "f 1 2 3 4 5\nf 1 6 2 3 4 5\nf 1 1 2\nf 1 2\nf 1\nf\n");
    CHECK(!r.code && r.triangles == 3 + 4 + 1 && r.skipped[PBS_SKIP_POLYGON] == 3);
    CHECK(rec_area(&r, 0) == 2 * 10);
    rec_end(&r);
}

TEST(points_and_lines_are_counted) {
    rec r;
    load(&r, SQUARE "l 1 2 3\nl 1/1 2/2\nl 1\np 1 2 \\\n 3\np 4\ncurv 0 1 1 2\nf 1 2 3\n");
    CHECK(!r.code && r.skipped[PBS_SKIP_LINES] == 4 && r.skipped[PBS_SKIP_POINTS] == 4);
    rec_end(&r);
}

TEST(colours) {
    rec r;
    load(&r, "v 0 0 0 1 0.5 0\nv 1 0 0 0 0 1\nv 0 1 0\nf 1 2 3\n");
    CHECK(!r.code && r.part[0].corners == PBS_CORNER_COLOUR);
    static const uint8_t ones[3][4] = {{255, 128, 0, 255}, {0, 0, 255, 255}, {255, 255, 255, 255}};
    for (int i = 0; i < 3; i++) CHECK(!memcmp(r.triangle[0].corner[i].colour, ones[i], 4));
    rec_end(&r);
    /* the same to 255, which shows only at the second vertex */
    load(&r, "v 0 0 0 1 0 1\nv 1 0 0 7 128 255\nv 0 1 0 nan -3 999\nf 1 2 3\n");
    static const uint8_t bytes[3][4] = {{1, 0, 1, 255}, {7, 128, 255, 255}, {0, 0, 255, 255}};
    for (int i = 0; i < 3; i++) CHECK(!memcmp(r.triangle[0].corner[i].colour, bytes[i], 4));
    rec_end(&r);
}

TEST(errors_say_the_line) {
    CHECK(fails(SQUARE "f 1 2 5\n", "line 5: vertex 5, but there are 4"));
    CHECK(fails(SQUARE "f 1 2 0\n", "line 5: vertex 0: they are counted from 1"));
    CHECK(fails(SQUARE "\nf 1 2 -5\n", "line 6: vertex -5, but there are 4"));
    CHECK(fails(SQUARE "f 1/1 2/1 3/1\n", "line 5: texture coordinate 1, but there are 0"));
    CHECK(fails(SQUARE "f 1//1 2//1 3//1\n", "line 5: normal 1, but there are 0"));
    CHECK(fails(SQUARE "f 1 2 99999999999999999999999\n", "line 5: vertex"));
    CHECK(fails(SQUARE "f 1 2 x\n", "line 5: \"x\" is not a corner"));
    CHECK(fails(SQUARE "f 1 2 3/x\n", "line 5: \"3/x\" is not a corner"));
    CHECK(fails(SQUARE "f 1 2 3/1/1/1\n", "line 5"));
    CHECK(fails("v 0 0\nf 1 1 1\n", "line 1: a vertex with 2 numbers"));
    CHECK(fails("v 0 0 zero\nf 1 1 1\n", "line 1: \"zero\" is not a number"));
    CHECK(fails("v 0 0 1,5\nf 1 1 1\n", "line 1: \"1,5\" is not a number"));
    CHECK(fails("vn 0 1\n", "line 1"));
    CHECK(fails("", "has no faces"));
    CHECK(fails(SQUARE "p 1 2\n", "has no faces (4 vertices, 2 points"));
    CHECK(fails(SQUARE "surf 0 1 0 1 1 2 3\nf 1 2 3\n", "line 5: a free-form surface"));
    CHECK(fails("\xff\xfev\0 \0", "UTF-16"));
}

TEST(memory_limit_and_cancel) {
    rec r;
    char *text = malloc(2 << 20);
    if (!text) abort();
    size_t n = 0;
    while (n < (2 << 20) - 64) n += (size_t)sprintf(text + n, "v 1 2 3 0.5 0 1\n");
    n += (size_t)sprintf(text + n, "v 7 8 9 255 0 0\nf -1 2 3\n");
    rec_begin(&r);
    r.run.mem_limit = 1000;
    rec_import(&r, pbs_import_obj, "a.obj", text, n);
    CHECK(r.code == PBS_LIMIT);
    rec_end(&r);
    rec_begin(&r); /* the vertices do not fit: they go to a file */
    r.run.mem_limit = 1 << 20;
    rec_import(&r, pbs_import_obj, "a.obj", text, n);
    CHECK(r.code == PBS_OK && r.triangles == 1 && r.run.mem_peak < 1 << 20);
    const pbs_corner *c = r.triangle[0].corner;
    CHECK(c[0].position[0] == 7 && c[0].position[2] == 9 && c[2].position[1] == 2);
    CHECK(c[0].colour[0] == 255 && c[0].colour[3] == 255 && c[1].colour[2] == 1);
    rec_end(&r);
    volatile sig_atomic_t stop = 1;
    rec_begin(&r);
    r.run.cancel = &stop;
    rec_import(&r, pbs_import_obj, "a.obj", text, n);
    CHECK(r.code == PBS_CANCEL);
    rec_end(&r);
    free(text);
}

/* ---- materials ---- */

static char folder[256];

static void put(const char *name, const char *text) {
    char path[400];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *f = fopen(path, "wb");
    if (!f) abort();
    fputs(text, f);
    fclose(f);
}

static bool in_folder(void) {
    const char *tmp = getenv("TMPDIR");
    snprintf(folder, sizeof folder, "%s/pbs-test-XXXXXX", tmp ? tmp : "/tmp");
    return mkdtemp(folder);
}

static void remove_folder(const char *const *names) {
    char path[400];
    for (; *names; names++) {
        snprintf(path, sizeof path, "%s/%s", folder, *names);
        remove(path);
    }
    rmdir(folder);
}

static void load_in_folder(rec *r, const char *text, bool allow_missing) {
    char path[400];
    snprintf(path, sizeof path, "%s/model.obj", folder);
    rec_begin(r);
    r->allow_missing = allow_missing;
    rec_import(r, pbs_import_obj, path, text, strlen(text));
}

static bool near(double a, double b) {
    return fabs(a - b) < 1e-6;
}

TEST(materials) {
    if (!in_folder()) SKIP("no folder for temporary files");
    put("my lib.mtl", "# comment\nnewmtl shiny  red paint \nKd 1 0.5 0\nd 0.25\nTr 0\nKe 0 0.5 0\n"
                      "Pm 0.75\nPr 0.125\nmap_d x.png\nnewmtl grey\nKd 0.5\nTr 0.75\n"
                      "newmtl pic\r\nKd 0 0 0\r\nmap_Kd -s 2 3 -o 0.25 0.5 0 -clamp on -bm 1 "
                      "tex\\with space.png\r\nmap_Ke .\\tex\\with space.png\r\n"
                      "newmtl none\nmap_Kd gone.png");
    char path[400];
    snprintf(path, sizeof path, "%s/tex", folder);
    mkdir(path, 0777);
    put("tex/with space.png", "12345");
    rec r;
    load_in_folder(&r,
                   SQUARE "vt 0 0\nmtllib my lib.mtl\nmtllib my lib.mtl\nf 1 2 3\n"
                          "usemtl  shiny  red paint\nf 1 2 3\nusemtl grey\nf 1 2 3\n"
                          "usemtl pic\nf 1 2 3\nusemtl unknown\nf 1 2 3\nusemtl none\nf 1 2 3\n",
                   true);
    CHECK(!r.code && r.materials == 4 && r.triangles == 6);
    static const uint32_t want[] = {PBS_NONE, 0, 1, 2, PBS_NONE, 3};
    for (size_t i = 0; i < 6 && i < r.triangles; i++) CHECK(r.triangle[i].material == want[i]);
    const pbs_material *m = r.material;
    CHECK(!strcmp(m[0].name, "shiny  red paint"));
    CHECK(near(m[0].base[0], 1) && near(m[0].base[1], 0.21404114) && m[0].base[2] == 0);
    CHECK(m[0].base[3] == 0.25f && m[0].alpha == PBS_ALPHA_BLEND); /* d wins over Tr */
    CHECK(near(m[0].emissive[1], 0.21404114) && m[0].metallic == 0.75f && m[0].roughness == 0.125f);
    CHECK(m[0].base_texture.texture == PBS_NONE);
    CHECK(near(m[1].base[2], 0.21404114) && m[1].base[3] == 0.25f && m[1].roughness == 1);
    CHECK(m[1].metallic == 0 && m[1].emissive[0] == 0);
    /* black with a texture is white; the file is sent once per name */
    CHECK(m[2].base[0] == 1 && m[2].base_texture.texture == 0 && m[2].base_texture.wrap_u == 1);
    const float *t = m[2].base_texture.transform;
    CHECK(t[0] == 2 && t[1] == 0 && t[2] == 0.25f && t[3] == 0 && t[4] == 3 && t[5] == -2.5f);
    CHECK(m[2].emissive_texture.texture < 2 && m[2].emissive[0] == 1);
    CHECK(m[2].alpha == PBS_ALPHA_OPAQUE);
    CHECK(r.textures >= 1 && r.texture_size[0] == 5);
    CHECK(r.missings == 1 && !strcmp(r.missing[0], "gone.png"));
    CHECK(m[3].base_texture.texture == PBS_NONE);
    rec_end(&r);
    /* the same, not allowed: says where */
    load_in_folder(&r, SQUARE "mtllib my lib.mtl\nf 1 2 3\n", false);
    CHECK(r.code == PBS_DATA && strstr(r.err.text, "line 5: ") &&
          strstr(r.err.text, "my lib.mtl: line 18: gone.png: is missing"));
    rec_end(&r);
    remove_folder((const char *const[]){"my lib.mtl", "tex/with space.png", "tex", NULL});
}

TEST(several_and_missing_libraries) {
    if (!in_folder()) SKIP("no folder for temporary files");
    put("a.mtl", "newmtl a\nKd 1 1 1\n");
    put("b.mtl", "newmtl b\nKd bad\n");
    put("c.mtl", "");
    rec r;
    load_in_folder(&r, "mtllib c.mtl a.mtl gone.mtl\n" SQUARE "usemtl a\nf 1 2 3\n", true);
    CHECK(!r.code && r.missings == 1 && !strcmp(r.missing[0], "gone.mtl") && r.materials == 1);
    CHECK(r.triangles == 1 && r.triangle[0].material == 0);
    rec_end(&r);
    load_in_folder(&r, "mtllib c.mtl a.mtl gone.mtl\n" SQUARE "f 1 2 3\n", false);
    CHECK(r.code == PBS_DATA && !strcmp(r.err.text, "line 1: gone.mtl: is missing"));
    rec_end(&r);
    load_in_folder(&r, "mtllib b.mtl\n" SQUARE "f 1 2 3\n", false);
    CHECK(r.code == PBS_DATA && strstr(r.err.text, "b.mtl: line 2: \"bad\" is not a number"));
    rec_end(&r);
    /* a folder, or a pipe nobody writes to, is not a file */
    char path[400];
    snprintf(path, sizeof path, "%s/fifo", folder);
    CHECK(!mkfifo(path, 0666));
    load_in_folder(&r, "mtllib fifo .\n" SQUARE "f 1 2 3\n", true);
    CHECK(!r.code && r.missings == 2);
    rec_end(&r);
    remove_folder((const char *const[]){"a.mtl", "b.mtl", "c.mtl", "fifo", NULL});
}

TEST(many_materials) {
    if (!in_folder()) SKIP("no folder for temporary files");
    size_t room = 1 << 20, n = 0;
    char *text = malloc(room);
    if (!text) abort();
    for (int i = 0; i < 5000; i++)
        n += (size_t)sprintf(text + n, "newmtl m%d\nPm %g\n", i, i / 5e3);
    put("many.mtl", text);
    n = (size_t)sprintf(text, "mtllib many.mtl\n" SQUARE);
    for (int i = 4999; i >= 0; i -= 7) n += (size_t)sprintf(text + n, "usemtl m%d\nf 1 2 3\n", i);
    rec r;
    load_in_folder(&r, text, false);
    CHECK(!r.code && r.materials == 5000);
    for (size_t i = 0; i < r.triangles; i++) CHECK(r.triangle[i].material == 4999 - 7 * i);
    rec_end(&r);
    free(text);
    remove_folder((const char *const[]){"many.mtl", NULL});
}

/* ---- damage ---- */

static const char whole[] =
    "\xef\xbb\xbf# x\r\nmtllib no.mtl\no a\nv 0 0 0 1 0 0\nv 1e0 0 -nan\nv 1 1 0\nv 0 +1.5e-3 0\n"
    "vt 0.5 1\nvn 0 0 1\ng b \\\n c\nusemtl m\ns off\nf 1/1/1 2/1/1 3/1/1 4/1/1\nf -4// -3//-1 \\\n"
    " -2//1\nl 1 2\np 1\no c\nf 1 2 3 4 1 2\n";

TEST(every_truncation) {
    int good = 0;
    for (size_t n = 0; n <= sizeof whole - 1; n++) {
        rec r;
        rec_begin(&r);
        r.allow_missing = true;
        rec_import(&r, pbs_import_obj, "t.obj", whole, n);
        CHECK(r.code == PBS_OK || r.code == PBS_DATA);
        good += r.code == PBS_OK;
        rec_end(&r);
    }
    CHECK(good > 1);
}

TEST(every_byte_damaged) {
    static const char with[] = {0, '\n', '\\', '/', '#', '9', '-', (char)0xff, 'v', 'f'};
    char text[sizeof whole];
    for (size_t i = 0; i < sizeof whole - 1; i++)
        for (size_t k = 0; k < sizeof with; k++) {
            memcpy(text, whole, sizeof whole);
            text[i] = with[k];
            rec r;
            rec_begin(&r);
            r.allow_missing = true;
            rec_import(&r, pbs_import_obj, "t.obj", text, sizeof whole - 1);
            CHECK(r.code == PBS_OK || r.code == PBS_DATA);
            rec_end(&r);
        }
}

TEST(other_peoples_files) {
    static const struct {
        const char *name;
        size_t triangles, materials;
    } file[] = {{"box", 12, 0},
                {"spider", 1368, 5},
                {"space_in_material_name", 64, 1},
                {"empty_mat", 256, 1},
                {"box_mat_with_spaces", 12, 12}};
    for (size_t i = 0; i < sizeof file / sizeof *file; i++) {
        char path[200];
        size_t size;
        snprintf(path, sizeof path, "/usr/share/assimp/models/OBJ/%s.obj", file[i].name);
        char *bytes = rec_file(path, &size);
        if (!bytes) SKIP("assimp-testmodels is not installed");
        rec r;
        rec_begin(&r);
        rec_import(&r, pbs_import_obj, path, bytes, size);
        CHECK(!r.code && r.triangles == file[i].triangles && r.materials == file[i].materials);
        rec_end(&r);
        free(bytes);
    }
}

TEST_MAIN
