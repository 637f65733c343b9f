/* test_gltf_meshopt.c: EXT_meshopt_compression: what the library's encoder packed comes out of the
 * reader as the numbers that went in; and damaged bytes and claims. */
#include "tests/gltf_tally.h"
#if __has_include(<meshoptimizer.h>)
#include <meshoptimizer.h>

static tally seen;
static pbs_err err;

#define SIDE     23
#define VERTICES (SIDE * SIDE)
#define INDICES  (6 * (SIDE - 1) * (SIDE - 1))

/* A wavy sheet with everything a vertex can have, as plain numbers. */
static struct sheet {
    float p[3 * VERTICES], n[4 * VERTICES];
    uint16_t uv[2 * VERTICES];
    uint32_t index[INDICES];
} sheet;

static void make_sheet(void) {
    for (int v = 0; v < VERTICES; v++) {
        float x = (float)(v % SIDE) / 8, y = (float)(v / SIDE) / 8;
        float slope = 0.5f * cosf(x), length = sqrtf(1 + slope * slope);
        const float p[3] = {x, y, 0.5f * sinf(x)}, n[4] = {-slope / length, 0, 1 / length, 0};
        memcpy(sheet.p + 3 * v, p, sizeof p);
        memcpy(sheet.n + 4 * v, n, sizeof n);
        sheet.uv[2 * v] = (uint16_t)(v * 100), sheet.uv[2 * v + 1] = (uint16_t)(65535 - v);
    }
    uint32_t *w = sheet.index;
    for (uint32_t y = 0; y + 1 < SIDE; y++)
        for (uint32_t x = 0; x + 1 < SIDE; x++) {
            uint32_t a = y * SIDE + x,
                     quad[6] = {a, a + 1, a + SIDE, a + SIDE, a + 1, a + SIDE + 1};
            memcpy(w, quad, sizeof quad);
            w += 6;
        }
}

/* A file that grows: compressed bytes, and the views that refer to them. */
typedef struct packed {
    uint8_t bytes[1 << 16];
    size_t size, fallback;
    char views[4096];
} packed;

static void add_view(packed *f, size_t n, size_t count, size_t stride, const char *mode,
                     const char *filter) {
    char *w = f->views + strlen(f->views);
    w += sprintf(w, "%s{'buffer':1,'byteOffset':%zu,'byteLength':%zu,", *f->views ? "," : "",
                 f->fallback, count * stride);
    if (!strcmp(mode, "ATTRIBUTES")) w += sprintf(w, "'byteStride':%zu,", stride);
    w += sprintf(w,
                 "'extensions':{'EXT_meshopt_compression':{'buffer':0,'byteOffset':%zu,'byteLength'"
                 ":%zu,'byteStride':%zu,'count':%zu,'mode':'%s'",
                 f->size, n, stride, count, mode);
    sprintf(w, *filter ? ",'filter':'%s'}}}" : "}}}", filter);
    f->size += n;
    f->fallback += count * stride;
}
static void add_vertices(packed *f, const void *data, size_t count, size_t stride,
                         const char *filter) {
    size_t n = meshopt_encodeVertexBuffer(f->bytes + f->size, sizeof f->bytes - f->size, data,
                                          count, stride);
    CHECK(n > 0);
    add_view(f, n, count, stride, "ATTRIBUTES", filter);
}
static void add_indices(packed *f, const uint32_t *index, size_t count, size_t width,
                        bool triangles) {
    uint8_t *to = f->bytes + f->size;
    size_t room = sizeof f->bytes - f->size;
    size_t n = triangles ? meshopt_encodeIndexBuffer(to, room, index, count)
                         : meshopt_encodeIndexSequence(to, room, index, count);
    CHECK(n > 0);
    add_view(f, n, count, width, triangles ? "TRIANGLES" : "INDICES", "");
}

static char *quoted(char *text) {
    for (char *c = text; *c; c++)
        if (*c == '\'') *c = '"';
    return text;
}
static char *packed_text(const packed *f, const char *rest) {
    char *b = base64(f->bytes, f->size), *head, *text;
    if (asprintf(&head,
                 "{'asset':{'version':'2.0'},'extensionsRequired':['EXT_meshopt_compression',"
                 "'KHR_mesh_quantization'],'buffers':[{'byteLength':%zu,'uri':"
                 "'data:application/octet-stream;base64,%s'},{'byteLength':%zu,'extensions':"
                 "{'EXT_meshopt_compression':{'fallback':true}}}],'bufferViews':[%s],%s}",
                 f->size, b, f->fallback, f->views, rest) < 0)
        abort();
    text = quoted(head);
    free(b);
    return text;
}
static pbs_code import_text(char *text) {
    tally_begin(&seen);
    seen.run.mem_limit = (size_t)256 << 20;
    seen.allow_missing = true; /* the texture that makes the coordinates count */
    pbs_code rc = import_bytes(&seen, "/nowhere/x.gltf", text, strlen(text), &err);
    CHECK(pbs_mem_used(&seen.run) == 0);
    free(text);
    return rc;
}

/* Corner k of triangle t: the codec may turn a triangle round, but not over. */
static int turn_of(size_t t) {
    for (int r = 0; r < 3; r++) {
        bool all = true;
        for (size_t k = 0; k < 3; k++) {
            const double *at = seen.corners[3 * t + (k + (size_t)r) % 3].position;
            const float *want = sheet.p + 3 * (size_t)sheet.index[3 * t + k];
            for (int c = 0; c < 3; c++) all = all && fabs(at[c] - (double)want[c]) < 1e-3;
        }
        if (all) return r;
    }
    return -1;
}

static const char sheet_mesh[] =
    ONE_NODE "'materials':[{'emissiveTexture':{'index':0}}],'textures':[{}],"
             "'meshes':[{'primitives':[{'indices':3,'material':0,'attributes':"
             "{'POSITION':0,'NORMAL':1,'TEXCOORD_0':2}}]}],'accessors':["
             "{'bufferView':0,'componentType':5126,'count':529,'type':'VEC3'},"
             "{'bufferView':1,'componentType':%d,'normalized':true,'count':529,'type':'VEC3'},"
             "{'bufferView':2,'componentType':5123,'normalized':true,'count':529,'type':'VEC2'},"
             "{'bufferView':3,'componentType':%d,'count':2904,'type':'SCALAR'}]";

static void pack_sheet(packed *f, bool filters, int wide, bool triangles) {
    static float p[3 * VERTICES];
    static int8_t n8[4 * VERTICES];
    static int16_t n16[4 * VERTICES];
    memset(f, 0, sizeof *f);
    memcpy(p, sheet.p, sizeof p);
    if (filters) meshopt_encodeFilterExp(p, VERTICES, 12, 15, sheet.p);
    add_vertices(f, p, VERTICES, 12, filters ? "EXPONENTIAL" : "NONE");
    if (wide)
        meshopt_encodeFilterOct(n16, VERTICES, 8, 16, sheet.n);
    else
        meshopt_encodeFilterOct(n8, VERTICES, 4, 8, sheet.n);
    add_vertices(f, wide ? (void *)n16 : n8, VERTICES, wide ? 8 : 4, "OCTAHEDRAL");
    add_vertices(f, sheet.uv, VERTICES, 4, "");
    add_indices(f, sheet.index, INDICES, wide ? 4 : 2, triangles);
}

TEST(modes_and_filters) {
    NEED_GLTF;
    make_sheet();
    static packed f;
    for (int form = 0; form < 8; form++) {
        bool filters = form & 1, wide = form & 2, triangles = form & 4;
        char *rest;
        if (asprintf(&rest, sheet_mesh, wide ? 5122 : 5120, wide ? 5125 : 5123) < 0) abort();
        pack_sheet(&f, filters, wide, triangles);
        char *text = packed_text(&f, rest);
        free(rest);
        CHECK(!import_text(text));
        if (!seen.roots) return;
        CHECK(seen.triangles == INDICES / 3);
        CHECK(seen.nodes[0].flags == (PBS_CORNER_NORMAL | PBS_CORNER_UV));
        for (size_t t = 0; t < TALLY_CORNERS / 3 && t < INDICES / 3; t++) {
            int turn = turn_of(t);
            CHECK(triangles ? turn >= 0 : turn == 0);
            for (size_t k = 0; k < 3 && turn >= 0; k++) {
                const pbs_corner *c = &seen.corners[3 * t + (k + (size_t)turn) % 3];
                size_t v = sheet.index[3 * t + k];
                for (size_t i = 0; i < 3; i++) {
                    if (!filters) CHECK(c->position[i] == (double)sheet.p[3 * v + i]);
                    CHECK(fabsf(c->normal[i] - sheet.n[4 * v + i]) < (wide ? 1e-4f : 0.02f));
                }
                CHECK(c->uv[0] == (float)(sheet.uv[2 * v] / 65535.0));
            }
        }
        tally_end(&seen);
    }
}

/* Quaternions turn instances; more of them than a view that is kept may have is no matter. */
TEST(quaternions) {
    NEED_GLTF;
    enum { N = 5000 };
    static packed f;
    static float q[4 * N];
    static int16_t packed_q[4 * N];
    const float p[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    memset(&f, 0, sizeof f);
    for (int i = 0; i < N; i++) {
        float half = (float)(i % 100) * 0.03f;
        q[4 * i + 2] = sinf(half), q[4 * i + 3] = cosf(half);
    }
    meshopt_encodeFilterQuat(packed_q, N, 8, 16, q);
    add_vertices(&f, packed_q, N, 8, "QUATERNION");
    add_vertices(&f, p, 3, 12, "NONE");
    CHECK(!import_text(packed_text(
        &f, "'nodes':[{'mesh':0,'extensions':{'EXT_mesh_gpu_instancing':{'attributes':{'ROTATION':"
            "0}}}}],'meshes':[{'primitives':[{'attributes':{'POSITION':1}}]}],'accessors':["
            "{'bufferView':0,'componentType':5122,'normalized':true,'count':5000,'type':'VEC4'},"
            "{'bufferView':1,'componentType':5126,'count':3,'type':'VEC3'}]")));
    if (!seen.roots) return;
    tally_node *many = &seen.nodes[tally_root_node(&seen)->children[0].node];
    CHECK(many->count == N);
    for (size_t i = 0; i < many->count; i++) {
        double angle = 2 * (double)(i % 100) * 0.03, *m = many->children[i].m;
        CHECK(fabs(m[0] - cos(angle)) < 1e-3 && fabs(m[4] - sin(angle)) < 1e-3);
        CHECK(fabs(m[10] - 1) < 1e-3);
    }
    tally_end(&seen);
}

/* One view for many meshes, and more views than are kept: each comes out as it went in. */
TEST(many_views) {
    NEED_GLTF;
    enum { N = 700 };
    char *views = malloc(N * 200), *w = views, *meshes = malloc(N * 80), *m = meshes;
    char *accessors = malloc(N * 80), *a = accessors, *nodes = malloc(N * 20), *o = nodes;
    uint8_t bytes[1024];
    float p[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    size_t n = meshopt_encodeVertexBuffer(bytes, sizeof bytes, p, 3, 12);
    for (int i = 0; i < N; i++) {
        w += sprintf(w,
                     "{'buffer':0,'byteLength':36,'extensions':{'EXT_meshopt_compression':{'buffer'"
                     ":0,'byteLength':%zu,'byteStride':12,'count':3,'mode':'ATTRIBUTES'}}},",
                     n);
        a += sprintf(a, "{'bufferView':%d,'componentType':5126,'count':3,'type':'VEC3'},",
                     i % 3 ? i : 0);
        m += sprintf(m, "{'primitives':[{'attributes':{'POSITION':%d,'NORMAL':%d}}]},", i,
                     N - 1 - i);
        o += sprintf(o, "{'mesh':%d},", i);
    }
    w[-1] = a[-1] = m[-1] = o[-1] = 0;
    CHECK(!import_text(gltf_text(bytes, n,
                                 "'nodes':[%s],'meshes':[%s],'accessors':[%s],'bufferViews':[%s]",
                                 nodes, meshes, accessors, views)));
    CHECK(seen.triangles == N);
    for (size_t k = 0; k < 3 * N && k < TALLY_CORNERS; k++)
        CHECK(seen.corners[k].position[0] == (double)p[k % 3 * 3] &&
              seen.corners[k].normal[1] == p[k % 3 * 3 + 1]);
    tally_end(&seen);
    free(views), free(meshes), free(accessors), free(nodes);
}

static char *sheet_text(void) {
    static packed f;
    char *rest, *text;
    make_sheet();
    pack_sheet(&f, true, 0, true);
    if (asprintf(&rest, sheet_mesh, 5120, 5123) < 0) abort();
    text = packed_text(&f, rest);
    free(rest);
    return text;
}

TEST(wrong_claims) {
    NEED_GLTF;
    static const struct {
        const char *from, *to, *text;
    } cases[] = {
        {"'count':529,'mode'", "'count':530,'mode'", "but the view has 6348"},
        {"'count':529,'mode'", "'count':4000000000,'mode'", "cannot be in"},
        {"'count':529,'mode'", "'count':18446744073709551615,'mode'", "cannot be in"},
        {"'count':529,'mode'", "'count':-1,'mode'", "count is negative"},
        {"'byteStride':12,'count'", "'byteStride':0,'count'", "byteStride 0"},
        {"'byteStride':12,'count'", "'byteStride':14,'count'", "byteStride 14"},
        {"'byteStride':12,'count'", "'byteStride':260,'count'", "byteStride 260"},
        {"'byteStride':2,'count'", "'byteStride':3,'count'", "byteStride 3"},
        {"ATTRIBUTES", "POINTS", "mode POINTS"},
        {"ATTRIBUTES", "TRIANGLES", "byteStride 12"},
        {"EXPONENTIAL", "COLOR", "filter COLOR"},
        {"EXPONENTIAL", "OCTAHEDRAL", "a filter that does not fit"},
        {"EXPONENTIAL", "QUATERNION", "a filter that does not fit"},
        {"'TRIANGLES'", "'TRIANGLES','filter':'EXPONENTIAL'", "a filter that does not fit"},
        {"'count':2904,'mode'", "'count':2905,'mode'", "cannot be in"},
        {"{'EXT_meshopt_compression':{'buffer':0", "{'EXT_meshopt_compression':{'buffer':2",
         "buffer 2, but there are 2"},
        {"{'EXT_meshopt_compression':{'buffer':0", "{'EXT_meshopt_compression':{'buffer':1",
         "buffer 1 has no data: it stands for EXT_meshopt_compression"},
        {"'byteLength':6348", "'byteLength':6349", "but the view has 6349"},
        {"'EXT_meshopt_compression':{'buffer':0,'byteOffset':0,'byteLength':",
         "'EXT_meshopt_compression':{'buffer':0,'byteOffset':0,'byteLength':99999", "buffer 0 has"},
        {"'EXT_meshopt_compression':{'buffer':0", "'x':{'buffer':0", "buffer 1 has no data"},
        {"'EXT_meshopt_compression':{'buffer':0,", "'EXT_meshopt_compression':7,'x':{",
         "EXT_meshopt_compression is not an object"},
    };
    char *text = sheet_text();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char *from = quoted(strdup(cases[i].from)), *to = quoted(strdup(cases[i].to)), *bad;
        char *at = strstr(strstr(text, "bufferViews"), from);
        if (!at) {
            printf("# no %s\n", from);
            abort();
        }
        if (asprintf(&bad, "%.*s%s%s", (int)(at - text), text, to, at + strlen(from)) < 0) abort();
        pbs_code rc = import_text(bad);
        bool fine = rc == PBS_DATA && strstr(err.text, cases[i].text);
        if (!fine) printf("# %s -> %s: %d %s\n", from, to, rc, err.text);
        CHECK(fine);
        tally_end(&seen);
        free(from), free(to);
    }
    free(text);
}

/* Any byte of the compressed data may be another one. */
TEST(accidents) {
    NEED_GLTF;
    char *text = sheet_text(), *data = strstr(text, "base64,") + 7;
    size_t n = strcspn(data, "\"");
    uint32_t x = 1, good = 0;
    for (int round = 0; round < 2000; round++) {
        char *bad = strdup(text);
        for (int k = 0; k < 1 + round % 3; k++) {
            x = x * 1664525 + 1013904223;
            bad[(size_t)(data - text) + (x >> 8) % (n - 4)] = (char)('A' + (x >> 3) % 26);
        }
        pbs_code rc = import_text(bad);
        good += rc == PBS_OK;
        CHECK(rc == PBS_OK || rc == PBS_DATA);
        tally_end(&seen);
    }
    CHECK_NUM(good > 100 && good < 1900, good);
    free(text);
}
#else
TEST(meshopt) {
    SKIP("libmeshoptimizer-dev is not installed");
}
#endif

TEST_MAIN
