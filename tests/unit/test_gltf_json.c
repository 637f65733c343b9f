/* test_gltf_json.c: the glTF reader on JSON that is long or odd: what it costs, and that nothing
 * depends on where it is cut into batches.
 *
 * PBS_TEST_NODES=200000 makes the long file 100 MB, and then its time counts, too. */
#include "tests/gltf_tally.h"
#include <time.h>

static tally seen;
static pbs_err err;

static pbs_code import_text(const char *text) {
    tally_begin(&seen);
    pbs_code rc = import_bytes(&seen, "/nowhere/x.gltf", text, strlen(text), &err);
    CHECK(pbs_mem_used(&seen.run) == 0);
    return rc;
}

#define REST                                                                                       \
    "'meshes':[{'primitives':[{'attributes':{'POSITION':0}}]}],"                                   \
    "'bufferViews':[{'buffer':0,'byteLength':36}],"                                                \
    "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'}]"
static const float corners[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};

static uint32_t dice(uint32_t *x) {
    *x = *x * 1664525 + 1013904223;
    return *x >> 8;
}

/* Objects of every length, so that each of their bytes lies at a border somewhere. */
TEST(batches) {
    NEED_GLTF;
    enum { N = 3000 };
    char *nodes = malloc(N * 2300), *w = nodes;
    uint32_t x = 5;
    for (int i = 0; i < N; i++) {
        w += sprintf(w, "{\"extras\":[%d,{\"a\":\"]}\\\\\"}],\"name\":\"%d \xfc\\u00fc\\\"", i, i);
        for (uint32_t k = dice(&x) % 2000; k; k--) *w++ = "[]{},: x"[dice(&x) % 8];
        w += sprintf(w, "\" , \"translation\" : [%d, 0.5, 1e-3],\n\"mesh\":0.0},", i);
    }
    w[-1] = 0;
    char *text = gltf_text(corners, sizeof corners, "'nodes':[%s]," REST, "NODES"), *all;
    char *at = strstr(text, "NODES");
    if (asprintf(&all, "%.*s%s%s", (int)(at - text), text, nodes, at + 5) < 0) abort();
    CHECK(!import_text(all));
    tally_node *root = tally_root_node(&seen);
    CHECK(root->count == (seen.roots ? N : 0));
    for (size_t i = 0; i < root->count; i++) {
        char want[64];
        int n = snprintf(want, sizeof want, "%zu ?\xc3\xbc\"", i);
        CHECK(!strncmp(root->child_names[i], want, (size_t)n));
        CHECK(root->children[i].m[3] == (double)i && root->children[i].m[11] == 1e-3);
    }
    tally_end(&seen);
    free(all), free(text), free(nodes);
}

/* An assembly of n nodes, as a CAD system writes it: 500 bytes each. */
static char *long_text(int n) {
    char *head = gltf_text(corners, sizeof corners, REST ",'scenes':[{'nodes':[0]}],'nodes':[");
    char *text = malloc((size_t)n * 640 + strlen(head) + 100), *w = text;
    uint32_t x = 9;
    w += sprintf(w, "%.*s", (int)strlen(head) - 1, head);
    free(head);
    for (int i = 0; i < n; i++) {
        w += sprintf(w, "%s{\"name\":\"Assembly 4711 / Part %d rev. B\",\"matrix\":[", i ? "," : "",
                     i);
        for (int k = 0; k < 16; k++)
            w += k % 4 == 3 ? sprintf(w, "%s%d", k ? "," : "", k == 15)
                            : sprintf(w, "%s%.17f", k ? "," : "", dice(&x) / 16777216.0);
        *w++ = ']';
        for (int c = 20 * i + 1; c <= 20 * i + 20 && c < n; c++)
            w += sprintf(w, "%s%d", c % 20 == 1 ? ",\"children\":[" : ",", c);
        w += sprintf(w, "%s,\"extras\":{\"layer\":\"LAYER_%d\",\"guid\":\"",
                     20 * i + 1 < n ? "]" : ",\"mesh\":0", i % 50);
        for (int k = 0; k < 100; k++) *w++ = "0123456789abcdef"[dice(&x) % 16];
        w += sprintf(w, "\"}}");
    }
    strcpy(w, "]}");
    return text;
}

static double cpu_seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* No tree of the JSON: what is kept is less than its text. */
TEST(cost_of_many_nodes) {
    NEED_GLTF;
    const char *wanted = getenv("PBS_TEST_NODES");
    int n = wanted ? atoi(wanted) : 20000;
    char *text = long_text(n);
    size_t size = strlen(text);
    double start = cpu_seconds();
    CHECK(!import_text(text));
    double seconds = cpu_seconds() - start;
    /* a node for every assembly, one part, the root */
    CHECK_NUM(seen.node_count == (uint32_t)((n - 2) / 20 + 1) + 2, seen.node_count);
    CHECK(tally_root_node(&seen)->triangles == (uint64_t)n - (uint64_t)((n - 2) / 20 + 1));
    CHECK_NUM(pbs_mem_peak(&seen.run) < size * 3 / 4 + (4 << 20),
              (double)pbs_mem_peak(&seen.run) / (double)size);
    if (wanted) {
        printf("# %zu bytes, %zu counted, %.2f s\n", size, pbs_mem_peak(&seen.run), seconds);
        CHECK_NUM(seconds < 2, seconds);
    }
    tally_end(&seen);
    /* With less than the tables need: refused, before it is taken. */
    tally_begin(&seen);
    seen.run.mem_limit = size / 10 + (1 << 20);
    CHECK(import_bytes(&seen, "x", text, size, &err) == PBS_LIMIT);
    CHECK(pbs_mem_peak(&seen.run) <= seen.run.mem_limit && pbs_mem_used(&seen.run) == 0);
    tally_end(&seen);
    free(text);
}

/* Reading the JSON looks at signals: no mesh is there that could. */
TEST(cancel) {
    NEED_GLTF;
    static const volatile sig_atomic_t stop = 1;
    tally_begin(&seen);
    seen.run.cancel = &stop;
    static const char text[] = "{\"asset\":{\"version\":\"2.0\"},\"nodes\":[{},{}]}";
    CHECK(import_bytes(&seen, "x", text, sizeof text - 1, &err) == PBS_CANCEL);
    tally_end(&seen);
}

static char *with_node(const char *members) {
    return gltf_text(corners, sizeof corners, "'nodes':[{%s'mesh':0}]," REST, members);
}

/* What nobody reads may be anything that has a beginning and an end. */
TEST(unread_members) {
    NEED_GLTF;
    static const char *const good[] = {"'extras':{'a':NaN,'b':[1e999,-Infinity]},",
                                       "'extras':'\xff\xfe',",
                                       "'extras':123456789012345678901234567890,",
                                       "'weights':[nan],'skin':'x',",
                                       "'name':null,'children':null,'matrix':null,'camera':1.5,",
                                       "'children':[],'translation':[],",
                                       "'na\\u006de':'x','translation':[1e0,2.0,-0.0],",
                                       "'extensions':{'X':{'a':[[]]}},"};
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        char *text = with_node(good[i]);
        CHECK(!import_text(text));
        CHECK(seen.triangles == 1);
        if (err.code) printf("# %s: %s\n", good[i], err.text);
        tally_end(&seen);
        free(text);
    }
}

TEST(wrong_kinds) {
    NEED_GLTF;
    static const char *const bad[][2] = {
        {"'children':{},", "node 0: children is not a list"},
        {"'name':'a','children':7,", "node 0 (a): children is not a list"},
        {"'children':['x'],", "a child is not an index"},
        {"'children':[4294967296],", "a child is not an index"},
        {"'children':[1.5],", "a child is not an index"},
        {"'translation':'x',", "translation is not a list"},
        {"'translation':[1,2,[]],", "translation has something that is not a number"},
        {"'scale':[1,2,3,4],", "node 0: scale has 4 numbers"},
        {"'extensions':{'EXT_mesh_gpu_instancing':5},", "EXT_mesh_gpu_instancing is not an object"},
        {"'extensions':{'EXT_mesh_gpu_instancing':{'attributes':{'SCALE':'a'}}},",
         "node 0: SCALE is not an index"},
        {"'extensions':{'EXT_mesh_gpu_instancing':{'attributes':{'SCALE':7}}},",
         "node 0: accessor 7, but there are 1"},
        {"'extensions':{'EXT_mesh_gpu_instancing':{'attributes':{'SCALE':-1}}},", "accessor -1"},
        {"'translation':[1,2,tru],", "line 1"},
        {"'translation':[1,2,01],", "line 1"},
        {"'name':'\\x',", "line 1"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char *text = with_node(bad[i][0]);
        pbs_code rc = import_text(text);
        bool fine = rc == PBS_DATA && strstr(err.text, bad[i][1]);
        if (!fine) printf("# %s: %d %s\n", bad[i][0], rc, err.text);
        CHECK(fine);
        tally_end(&seen);
        free(text);
    }
    static const char *const lists[] = {"nodes",       "meshes",  "accessors",
                                        "bufferViews", "scenes",  "animations",
                                        "materials",   "buffers", "images"};
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++)
        for (int kind = 0; kind < 3; kind++) {
            char *text;
            if (asprintf(&text, "{\"asset\":{\"version\":\"2.0\"},\"%s\":%s}", lists[i],
                         kind == 0   ? "null"
                         : kind == 1 ? "7"
                                     : "[3]") < 0)
                abort();
            pbs_code rc = import_text(text);
            bool lazy = kind == 2 && !strcmp(lists[i], "materials"); /* looked at when used */
            CHECK(rc == (kind && !lazy ? PBS_DATA : PBS_OK));
            if (rc) CHECK(strstr(err.text, kind == 1 ? "is not a list" : " 0") != NULL);
            tally_end(&seen);
            free(text);
        }
}

static size_t held_by_files; /* bytes, when the part ended */
static pbs_code note_held(void *ctx, uint32_t *node, pbs_err *e) {
    unsigned long long size = 0, resident = 0, shared = 0;
    FILE *f = fopen("/proc/self/statm", "r");
    if (f && fscanf(f, "%llu %llu %llu", &size, &resident, &shared) == 3)
        held_by_files = (size_t)shared * (size_t)sysconf(_SC_PAGESIZE);
    if (f) fclose(f);
    return tally_part_end(ctx, node, e);
}

/* A file that is larger than anybody's memory is never in it as a whole. */
TEST(pages_of_a_map) {
    NEED_GLTF;
    enum { VERTICES = 6000000 };
    char path[] = "/tmp/pbs-gltf-XXXXXX", json[512];
    int fd = mkstemp(path);
    if (fd < 0) SKIP("no /tmp");
    uint32_t bin = VERTICES * 12,
             n = (uint32_t)snprintf(
                 json, sizeof json, "%-400s",
                 "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":72000000}],"
                 "\"nodes\":[{\"mesh\":0}],\"meshes\":[{\"primitives\":[{\"attributes\":{"
                 "\"POSITION\":0}}]}],"
                 "\"bufferViews\":[{\"buffer\":0,\"byteLength\":72000000}],\"accessors\":[{"
                 "\"bufferView\":0,"
                 "\"componentType\":5126,\"count\":6000000,\"type\":\"VEC3\"}]}");
    const uint32_t head[] = {0x46546c67, 2, 28 + n + bin, n, 0x4e4f534a},
                   tail[] = {bin, 0x004e4942};
    bool made = write(fd, head, 20) == 20 && write(fd, json, n) == (ssize_t)n &&
                write(fd, tail, 8) == 8 && !ftruncate(fd, 28 + (off_t)n + bin);
    close(fd);
    CHECK(made);
    tally_begin(&seen);
    seen.sink.part_end = note_held;
    CHECK(!import_file(&seen, path, &err) && seen.triangles == VERTICES / 3);
    CHECK_NUM(held_by_files < 60u << 20, held_by_files);
    tally_end(&seen);
    unlink(path);
}

#define DRACO "/usr/share/assimp/models/glTF2/draco/2CylinderEngine.gltf"

/* With little memory decoded primitives are not kept but decoded again: the same triangles. */
TEST(any_memory) {
    NEED_GLTF;
    if (access(DRACO, F_OK)) SKIP("the package assimp-testmodels is not installed");
    static pbs_corner want[TALLY_CORNERS];
    tally_begin(&seen);
    CHECK(!import_file(&seen, DRACO, &err));
    size_t limit = pbs_mem_peak(&seen.run);
    uint64_t triangles = seen.triangles;
    memcpy(want, seen.corners, sizeof want);
    tally_end(&seen);
    int good = 0;
    for (pbs_code rc = PBS_OK; rc == PBS_OK; limit -= limit / 16) {
        tally_begin(&seen);
        seen.run.mem_limit = limit;
        rc = import_file(&seen, DRACO, &err);
        CHECK(rc == PBS_OK || rc == PBS_LIMIT);
        if (rc == PBS_OK)
            CHECK(seen.triangles == triangles && !memcmp(want, seen.corners, sizeof want));
        good += rc == PBS_OK;
        tally_end(&seen);
    }
    CHECK_NUM(good > 0, good);
}

TEST_MAIN
