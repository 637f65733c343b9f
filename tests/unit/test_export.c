/* PLY and GLB of clouds, surfels and voxels: what is chosen keeps its spacing and is the coarsest,
 * instances are where they are placed, far from the origin nothing is lost, and faces look out. */
#include "formats/archive/cloudpack.h"
#include "formats/export/export.h"
#include "tests/unit/support.h"
#include "tests/check.h"
#include "tests/cloudfile.h"
#include <math.h>

static pbs_err err;
static pbs_exported got;

static double chance(void) {
    static uint64_t state = 11;
    return random_bits(&state) / 4294967296.0;
}

/* ---- reading what was written ---- */

typedef struct ply {
    size_t count, faces;
    bool doubles;
    double (*p)[3];
    float (*n)[3], *radius;
    uint8_t (*c)[4];
    uint32_t (*face)[4];
} ply;

static void file_of(blob b, const char *path) {
    FILE *f = fopen(path, "wb");
    if (!f || fwrite(b.bytes, 1, b.size, f) != b.size || fclose(f)) abort();
}

static blob bytes_of(const char *path) {
    FILE *f = fopen(path, "rb");
    if (!f || fseek(f, 0, SEEK_END)) abort();
    blob b = {NULL, (size_t)ftell(f)};
    b.bytes = calloc(1, b.size + 1);
    rewind(f);
    if (fread(b.bytes, 1, b.size, f) != b.size) abort();
    fclose(f);
    return b;
}

static ply read_ply(const char *path) {
    blob b = bytes_of(path);
    ply o = {0};
    char *text = (char *)b.bytes, *end = b.size ? strstr(text, "end_header\n") : NULL, *at;
    CHECK(end != NULL);
    if (!end) return o;
    *end = 0;
    if ((at = strstr(text, "element vertex "))) o.count = strtoul(at + 15, NULL, 10);
    if ((at = strstr(text, "element face "))) o.faces = strtoul(at + 13, NULL, 10);
    o.doubles = strstr(text, "double x") != NULL;
    bool normal = strstr(text, "nx"), colour = strstr(text, "red"), radius = strstr(text, "radius");
    o.p = calloc(o.count + 1, sizeof *o.p), o.n = calloc(o.count + 1, sizeof *o.n);
    o.c = calloc(o.count + 1, sizeof *o.c), o.radius = calloc(o.count + 1, sizeof *o.radius);
    o.face = calloc(o.faces + 1, sizeof *o.face);
    const uint8_t *d = (uint8_t *)end + 11;
    for (size_t i = 0; i < o.count; i++) {
        for (int k = 0; k < 3; k++, d += o.doubles ? 8 : 4)
            o.p[i][k] = o.doubles ? pbs_get_f64(d) : (double)pbs_get_f32(d);
        if (normal) memcpy(o.n[i], d, 12), d += 12;
        if (colour) memcpy(o.c[i], d, 4), d += 4;
        if (radius) memcpy(&o.radius[i], d, 4), d += 4;
    }
    for (size_t i = 0; i < o.faces; i++, d += 17) {
        CHECK(d[0] == 4);
        memcpy(o.face[i], d + 1, 16);
    }
    CHECK(d == b.bytes + b.size);
    free(b.bytes);
    return o;
}

static void free_ply(ply *o) {
    free(o->p), free(o->n), free(o->c), free(o->radius), free(o->face);
}

static pbs_code export(const char *input, pbs_export_options o, const char *output) {
    pbs_run run = {.threads = 1, .mem_limit = 16 << 20};
    o.input = input, o.output = output;
    pbs_code rc = pbs_export(&run, &o, &got, &err);
    CHECK(!run.mem_used);
    return rc;
}

static ply exported(const char *input, pbs_export_options o) {
    pbs_code rc = export(input, o, "export.ply");
    if (rc) printf("# %s\n", err.text);
    CHECK(!rc);
    ply p = read_ply("export.ply");
    unlink("export.ply");
    return p;
}

#define WISH .level = -1, .node = -1

/* ---- clouds ---- */

enum { POINTS_OF_CLOUD = 30000 };

/* A slope with a dense corner, far away: several nodes and levels. */
static void make_cloud(double offset) {
    static int32_t q[3 * POINTS_OF_CLOUD];
    static uint16_t c[3 * POINTS_OF_CLOUD];
    pbs_run run = {.threads = 2};
    pbs_cloud cloud;
    pbs_cloudpack_stats stats;
    for (size_t i = 0; i < POINTS_OF_CLOUD; i++) {
        double side = i % 3 ? 150000 : 9000;
        for (int k = 0; k < 2; k++) q[3 * i + k] = (int32_t)(side * chance());
        q[3 * i + 2] = q[3 * i] / 3;
        for (int k = 0; k < 3; k++) c[3 * i + k] = (uint16_t)(65535 * chance());
    }
    las_desc d = {2, 2, 0, {0.001, 0.001, 0.001}, {offset, offset, 0}, POINTS_OF_CLOUD, 0, 0};
    las_write("export.las", &d, q, c);
    must(pbs_cloud_open(&run, "export.las", &cloud, &err), &err);
    must(pbs_cloudpack(&run, &cloud, 1, &(pbs_writer_desc){.path = "export.pbs", .stage = "test"},
                       &stats, &err),
         &err);
    pbs_cloud_close(&cloud);
    unlink("export.las");
}

static double nearest_pair(const ply *p) {
    double least = INFINITY;
    for (size_t i = 0; i < p->count; i++)
        for (size_t k = 0; k < i; k++) {
            double x = p->p[i][0] - p->p[k][0], y = p->p[i][1] - p->p[k][1],
                   z = p->p[i][2] - p->p[k][2], d = x * x + y * y + z * z;
            if (d < least) least = d;
        }
    return sqrt(least);
}

TEST(a_spacing_is_kept) {
    make_cloud(1e7);
    for (double s = 4; s < 16; s *= 1.7) {
        ply p = exported("export.pbs", (pbs_export_options){WISH, .spacing = s, .radius = true});
        double least = nearest_pair(&p);
        CHECK_NUM(least >= s && p.count > 10 && p.count < 20000, least);
        for (size_t i = 0; i < p.count; i++) CHECK((double)p.radius[i] >= s);
        CHECK(p.doubles && got.points == p.count);
        free_ply(&p);
    }
}

TEST(everything_is_there_exactly) {
    make_cloud(1e7);
    ply p = exported("export.pbs", (pbs_export_options){WISH});
    CHECK_NUM(p.count == POINTS_OF_CLOUD && got.points == POINTS_OF_CLOUD, p.count);
    for (size_t i = 0; i < p.count; i++)
        for (int k = 0; k < 2; k++) {
            double mm = (p.p[i][k] - 1e7) * 1000;
            CHECK_NUM(fabs(mm - round(mm)) < 1e-5 && mm > -1 && mm < 150001, mm);
        }
    free_ply(&p);
}

static int falling(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x < y) - (x > y);
}

/* Exactly as many, and those of the largest spacings; of equal ones some in every part. */
TEST(a_count_takes_the_coarsest) {
    make_cloud(0);
    pbs_export_options o = {WISH, .radius = true};
    ply all = exported("export.pbs", o);
    qsort(all.radius, all.count, sizeof(float), falling);
    const uint64_t counts[] = {1, 2, 77, 5000, 20001, POINTS_OF_CLOUD - 1, POINTS_OF_CLOUD};
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
        o.count = counts[i];
        ply p = exported("export.pbs", o);
        CHECK_NUM(p.count == counts[i], p.count);
        qsort(p.radius, p.count, sizeof(float), falling);
        CHECK(!memcmp(p.radius, all.radius, p.count * sizeof(float)));
        free_ply(&p);
    }
    free_ply(&all);
}

TEST(rounding_is_small_where_floats_are_written) {
    make_cloud(0);
    ply p = exported("export.pbs", (pbs_export_options){WISH});
    /* 2^-24 of 150 units is less than an eighth of a millimetre */
    CHECK(!p.doubles);
    free_ply(&p);
    p = exported("export.pbs", (pbs_export_options){WISH, .positions = PBS_EXPORT_DOUBLE});
    CHECK(p.doubles);
    free_ply(&p);
    unlink("export.pbs");
}

/* ---- surfels, placed twice ---- */

static const double mirrored[12] = {0, -2, 0, 1e7, 2, 0, 0, 5, 0, 0, -2, 0};

static void make_instances(void) {
    pbs_run run = {.threads = 1};
    uint32_t channels = PBS_POSITION | PBS_SPACING | PBS_NORMAL | PBS_COLOUR;
    pbs_record r = pbs_record_make(channels, false);
    pbs_points p;
    char text[256];
    pbs_record_text(&r, text);
    must(pbs_points_alloc(&run, channels, 100, &p, &err), &err);
    for (size_t i = 0; i < 100; i++) {
        for (int k = 0; k < 3; k++) p.position[3 * i + k] = (float)((i * (7 + k * 3)) % 50);
        p.spacing[i] = 100.0f / (float)(i + 1);
        pbs_oct_encode(p.normal + 2 * i, (float[3]){0.6f, 0, 0.8f});
        memcpy(p.colour + 4 * i, (uint8_t[4]){(uint8_t)i, 188, 255, 128}, 4);
    }
    pbs_writer *w = spool_writer(&run, PBS_SURFELS, text, 0);
    must(pbs_points_write(&run, w, &r, 0, &p, 0, 33, NULL, &err), &err);
    pbs_node part = small_node(0, 100, NULL), root = {.id = 1, .box = part.box, .child_count = 2};
    pbs_child child[2] = {{.node = 0}, {.node = 0}};
    memcpy(child[0].m, PBS_IDENTITY, sizeof child[0].m);
    memcpy(child[1].m, mirrored, sizeof child[1].m);
    root.children = child;
    must(pbs_node_write(&run, w, &part, &err), &err);
    must(pbs_node_write(&run, w, &root, &err), &err);
    pbs_points_free(&run, &p);
    blob b = take_bytes(w);
    file_of(b, "export.surf");
    free(b.bytes);
}

TEST(instances_are_where_they_are_placed) {
    make_instances();
    ply p = exported("export.surf", (pbs_export_options){WISH, .radius = true});
    CHECK_NUM(p.count == 200, p.count);
    for (size_t i = 0; i < 100 && p.count == 200; i++) {
        double at[3] = {1 + (double)((i * 7) % 50), 2 + (double)((i * 10) % 50),
                        3 + (double)((i * 13) % 50)};
        double to[3];
        pbs_xform_point(to, mirrored, at);
        for (int k = 0; k < 3; k++) CHECK(p.p[i][k] == at[k] && p.p[100 + i][k] == to[k]);
        CHECK(p.radius[100 + i] == 2 * p.radius[i]);
        CHECK(p.c[i][0] == i && p.c[i][3] == 128);
        /* as it lies in the part, turned with it: the transform's rows, over 2 */
        const float want[2][3] = {{0.6f, 0, 0.8f}, {0, 0.6f, -0.8f}};
        for (int k = 0; k < 3; k++)
            CHECK(fabsf(p.n[i][k] - want[0][k]) + fabsf(p.n[100 + i][k] - want[1][k]) < 2e-4f);
    }
    free_ply(&p);
    p = exported("export.surf", (pbs_export_options){WISH, .prefix = 7});
    CHECK_NUM(p.count == 14, p.count);
    free_ply(&p);
    /* the second is twice as large, and so are its spacings */
    p = exported("export.surf", (pbs_export_options){WISH, .spacing = 10});
    CHECK_NUM(p.count == 10 + 20, p.count);
    free_ply(&p);
    p = exported("export.surf", (pbs_export_options){.level = -1, .node = 0, .prefix = 7});
    CHECK_NUM(p.count == 7, p.count);
    free_ply(&p);
    p = exported("export.surf", (pbs_export_options){WISH, .count = 50});
    CHECK_NUM(p.count == 50, p.count);
    free_ply(&p);
}

/* The text of a head's number, behind a word. */
static double number_behind(const char *text, const char *word, int skip) {
    const char *at = strstr(text, word);
    at = at ? at + strlen(word) : "";
    while (skip--) at = strchr(at, ',') ? strchr(at, ',') + 1 : at;
    return strtod(at, NULL);
}

TEST(glb_is_relative_and_linear) {
    make_instances();
    CHECK(
        !export("export.surf", (pbs_export_options){WISH, .format = PBS_EXPORT_GLB}, "export.glb"));
    blob b = bytes_of("export.glb");
    uint32_t head = pbs_get_u32(b.bytes + 12);
    CHECK(!memcmp(b.bytes, "glTF\2\0\0\0", 8) && pbs_get_u32(b.bytes + 8) == b.size);
    CHECK(head % 4 == 0 && pbs_get_u32(b.bytes + 20 + head) == 200 * 32);
    const uint8_t *v = b.bytes + 28 + head;
    char *text = (char *)b.bytes + 20;
    text[head - 1] = 0;
    float least = INFINITY;
    for (size_t i = 0; i < 100; i++) {
        double x = 1 + (double)((i * 7) % 50);
        double is = number_behind(text, "translation\":[", 0) + (double)pbs_get_f32(v + i * 32);
        CHECK_NUM(fabs(is - x) < 0.5, is);
        CHECK_NUM(pbs_get_u16(v + i * 32 + 24 + 6) == 128 * 257, i);
        double linear = (double)pbs_srgb_to_linear((float)i / 255.0f);
        CHECK(fabs(pbs_get_u16(v + i * 32 + 24) - 65535 * linear) < 0.6);
        CHECK(i == 0 || pbs_get_u16(v + i * 32 + 24) > pbs_get_u16(v + (i - 1) * 32 + 24));
        least = fminf(least, pbs_get_f32(v + i * 32));
    }
    CHECK((float)number_behind(text, "\"min\":[", 0) == least);
    free(b.bytes);
    unlink("export.glb");
}

TEST(what_is_asked_must_be_there) {
    make_instances();
    CHECK(export("export.surf", (pbs_export_options){.level = 1, .node = -1}, "x") == PBS_USAGE);
    CHECK(export("export.surf", (pbs_export_options){WISH, .faces = true}, "x") == PBS_USAGE);
    CHECK(export("export.surf", (pbs_export_options){.level = -1, .node = 2}, "x") == PBS_USAGE);
    ply p = exported("export.surf", (pbs_export_options){WISH, .spacing = 1e30});
    CHECK_NUM(p.count == 0, p.count);
    CHECK(!export("export.surf",
                  (pbs_export_options){WISH, .spacing = 1e30, .format = PBS_EXPORT_GLB},
                  "export.glb"));
    blob b = bytes_of("export.glb");
    CHECK(b.size == 20 + pbs_get_u32(b.bytes + 12) &&
          strstr((char *)b.bytes + 20, "\"scenes\":[{}]"));
    free(b.bytes);
    free_ply(&p);
    unlink("export.glb");
    unlink("export.surf");
}

/* Two nodes that each place the one below twice, 70 times: nobody waits for that. */
TEST(too_many_instances_are_refused_soon) {
    pbs_run run = {.threads = 1};
    pbs_record r = pbs_record_make(PBS_POSITION | PBS_SPACING, false);
    pbs_points p;
    char text[256];
    pbs_record_text(&r, text);
    fill_points(&run, r.channels, 100000, 1, &p);
    pbs_writer *w = spool_writer(&run, PBS_SURFELS, text, 0);
    must(pbs_points_write(&run, w, &r, 0, &p, 0, 65536, NULL, &err), &err);
    pbs_points_free(&run, &p);
    for (uint32_t id = 0; id < 70; id++) {
        pbs_child child[2];
        pbs_node n = small_node(id, id ? 0 : 100000, id ? &child[0] : NULL);
        child[1] = child[0];
        if (id) n.child_count = 2;
        must(pbs_node_write(&run, w, &n, &err), &err);
    }
    blob b = take_bytes(w);
    file_of(b, "export.surf");
    free(b.bytes);
    pbs_export_options o = {WISH, .format = PBS_EXPORT_GLB};
    CHECK(export("export.surf", o, "export.glb") == PBS_LIMIT);
    unlink("export.surf");
}

/* ---- voxels ---- */

static void make_voxels(uint32_t size) {
    pbs_run run = {.threads = 1};
    vox_model m;
    vox_sphere(&m, size);
    blob b = vox_file(&run, &m, PBS_POSITION | PBS_NORMAL, true);
    file_of(b, "export.vox");
    free(b.bytes);
    vox_free(&m);
}

TEST(levels_of_voxels) {
    make_voxels(512);
    size_t before = SIZE_MAX;
    for (int level = 0; level < 2; level++) {
        ply p = exported("export.vox", (pbs_export_options){.level = level, .node = -1});
        CHECK_NUM(p.count && p.count < before && got.voxels == p.count, p.count);
        ply same = exported("export.vox", (pbs_export_options){WISH, .count = p.count});
        CHECK_NUM(same.count == p.count, same.count);
        before = p.count;
        free_ply(&p), free_ply(&same);
    }
}

/* Each face's corners turn so that its normal points to the side where there is no voxel: away from
 * its own voxel's middle; and its own voxel is the one of its place in the file without faces. */
TEST(faces_look_out) {
    make_voxels(64);
    ply p = exported("export.vox", (pbs_export_options){.level = 0, .node = -1, .faces = true});
    CHECK(p.count == 4 * p.faces && p.faces > 100 && got.faces == p.faces);
    double middle[3] = {0}, out = 0;
    for (size_t i = 0; i < p.count; i++)
        for (int k = 0; k < 3; k++) middle[k] += p.p[i][k] / (double)p.count;
    for (size_t f = 0; f < p.faces; f++) {
        const uint32_t *c = p.face[f];
        double u[3], v[3], n[3], length = 0;
        for (int k = 0; k < 3; k++)
            u[k] = p.p[c[1]][k] - p.p[c[0]][k], v[k] = p.p[c[2]][k] - p.p[c[0]][k];
        for (int k = 0; k < 3; k++) {
            int a = (k + 1) % 3, b = (k + 2) % 3;
            n[k] = u[a] * v[b] - u[b] * v[a];
            length += n[k] * n[k];
        }
        CHECK_NUM(length > 0, length);
        /* with the rest of the voxel on its other side: a sphere's outer faces win */
        for (int k = 0; k < 3; k++) out += n[k] * (p.p[c[0]][k] - middle[k]);
    }
    CHECK_NUM(out > 0, out);
    free_ply(&p);
    unlink("export.vox");
}

TEST_MAIN
