/* test_gltf_nodes.c: the glTF reader's nodes: what moves, what places, what they are called. */
#include "tests/gltf_tally.h"

static tally seen;
static pbs_err err;

static pbs_code import_text(char *text) {
    tally_begin(&seen);
    pbs_code rc = import_bytes(&seen, "/nowhere/x.gltf", text, strlen(text), &err);
    CHECK(pbs_mem_used(&seen.run) == 0);
    free(text);
    return rc;
}

#define MESH "'meshes':[{'name':'wheel','primitives':[{'attributes':{'POSITION':0}}]}],"
static const float corners[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};

/* Whether the only node, which stands as rest says, moves under channels. */
static int moves(const float *keys, size_t n, const char *rest, const char *accessor,
                 const char *sampler, const char *target) {
    struct {
        float corners[9], keys[64];
    } d = {{0}, {0}};
    memcpy(d.corners, corners, sizeof corners);
    memcpy(d.keys, keys, n * sizeof *keys);
    CHECK(!import_text(gltf_text(
        &d, sizeof d,
        "'nodes':[{%s'mesh':0}]," MESH
        "'animations':[{'channels':[{'sampler':0,'target':{%s}}],'samplers':[{%s}]}],"
        "'bufferViews':[{'buffer':0,'byteLength':36},{'buffer':0,'byteOffset':36,'byteLength':256}"
        "],'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'},"
        "{'bufferView':1,%s}]",
        rest, target, sampler, accessor)));
    int flags = seen.roots ? (int)tally_root_node(&seen)->children[0].flags : -1;
    tally_end(&seen);
    return flags;
}

#define VEC3_2     "'componentType':5126,'type':'VEC3','count':2"
#define VEC4_2     "'componentType':5126,'type':'VEC4','count':2"
#define VEC3_3     "'componentType':5126,'type':'VEC3','count':3"
#define OUTPUT     "'input':0,'output':1"
#define SHIFT      "'node':0,'path':'translation'"
#define POINTER(p) "'path':'pointer','extensions':{'KHR_animation_pointer':{'pointer':'" p "'}}"

TEST(moving) {
    NEED_GLTF;
    const float rest[6] = {1, 2, 3, 1, 2, 3}, last[6] = {1, 2, 3, 1, 2, 3.00001f};
    const float unit[6] = {1, 1, 1, 1, 1, 1}, zero[6] = {0}, half = 0.70710678f;
    const float turn[8] = {0, 0, half, half, 0, 0, -half, -half},
                none[8] = {0, 0, 0, 1, 0, 0, 0, 1};
    const float spline[9] = {0, 0, 0, 1, 2, 3, 0, 0, 0}, swing[9] = {0, 0, 0, 1, 2, 3, 0, 1, 0};
    const struct {
        const float *keys;
        size_t n;
        const char *rest, *accessor, *sampler, *target;
        int moves;
    } cases[] = {
        {rest, 6, "'translation':[1,2,3],", VEC3_2, OUTPUT, SHIFT, 0},
        {last, 6, "'translation':[1,2,3],", VEC3_2, OUTPUT, SHIFT, 1},
        {rest, 6, "", VEC3_2, OUTPUT, SHIFT, 1},
        {zero, 6, "", VEC3_2, OUTPUT, SHIFT, 0},
        {unit, 6, "", VEC3_2, OUTPUT, "'node':0,'path':'scale'", 0},
        {rest, 6, "", VEC3_2, OUTPUT, "'node':0,'path':'scale'", 1},
        {rest, 6, "'rotation':[0,0,0,1],'scale':[1,2,3],", VEC3_2, OUTPUT,
         "'node':0,'path':'scale'", 0},
        /* 7 digits in the text; q and -q */
        {turn, 8, "'translation':[9,9,9],'rotation':[0,0,0.7071068,0.7071068],", VEC4_2, OUTPUT,
         "'node':0,'path':'rotation'", 0},
        {turn, 8, "", VEC4_2, OUTPUT, "'node':0,'path':'rotation'", 1},
        {none, 8, "", VEC4_2, OUTPUT, "'node':0,'path':'rotation'", 0},
        {last, 6, "", VEC3_2, OUTPUT, "'node':0,'path':'weights'", 0},
        {last, 6, "", VEC3_2, OUTPUT, "'node':1,'path':'translation'", 0},
        {last, 6, "", VEC3_2, OUTPUT, "'path':'translation'", 0},
        /* the standard forbids it, so nothing is known */
        {zero, 6, "'matrix':[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1],", VEC3_2, OUTPUT, SHIFT, 1},
        {spline, 9, "'translation':[1,2,3],", VEC3_3, OUTPUT ",'interpolation':'CUBICSPLINE'",
         SHIFT, 0},
        {swing, 9, "'translation':[1,2,3],", VEC3_3, OUTPUT ",'interpolation':'CUBICSPLINE'", SHIFT,
         1},
        {swing, 9, "'translation':[1,2,3],", VEC3_3, OUTPUT ",'interpolation':'STEP'", SHIFT, 1},
        {last, 6, "", VEC3_2, OUTPUT, POINTER("/nodes/0/translation"), 1},
        {zero, 6, "", VEC3_2, OUTPUT, POINTER("/nodes/0/translation"), 0},
        {last, 6, "", VEC3_2, OUTPUT, POINTER("/nodes/0/weights"), 0},
        {last, 6, "", VEC3_2, OUTPUT, POINTER("/nodes/1/scale"), 0},
        {last, 6, "", VEC3_2, OUTPUT, POINTER("/nodes//scale"), 0},
        {last, 6, "", VEC3_2, OUTPUT, POINTER("/nodes/99999999999/scale"), 0},
        {last, 6, "", VEC3_2, OUTPUT, POINTER("/materials/0/translation"), 0},
        /* a channel that cannot be read is no reason to refuse a scene */
        {zero, 6, "", VEC4_2, OUTPUT, SHIFT, 1},
        {zero, 6, "", VEC3_2, "'input':0,'output':7", SHIFT, 1},
        {zero, 6, "", VEC3_2, "'input':0", SHIFT, 1},
        {zero, 6, "", "'componentType':5126,'type':'VEC3','count':2000", OUTPUT, SHIFT, 1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int flags = moves(cases[i].keys, cases[i].n, cases[i].rest, cases[i].accessor,
                          cases[i].sampler, cases[i].target);
        CHECK_NUM(flags == (cases[i].moves ? PBS_CHILD_MOVES : 0), i);
    }
}

static pbs_code import_matrix(const char *matrix) {
    return import_text(
        gltf_text(corners, sizeof corners,
                  "'nodes':[{'name':'lens','mesh':0,'matrix':[%s]}]," MESH
                  "'bufferViews':[{'buffer':0,'byteLength':36}],"
                  "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'}]",
                  matrix));
}

TEST(matrices) {
    NEED_GLTF;
    /* Exporters leave noise in the last row. */
    CHECK(!import_matrix("2,0,0,1e-17,0,3,0,-1e-9,0,0,4,0,5,6,7,0.99999994"));
    if (!seen.roots) return;
    const double want[12] = {2, 0, 0, 5, 0, 3, 0, 6, 0, 0, 4, 7};
    for (int k = 0; k < 12; k++) CHECK(tally_root_node(&seen)->children[0].m[k] == want[k]);
    tally_end(&seen);
    static const char *const bad[] = {"1,0,0,0.1,0,1,0,0,0,0,1,0,0,0,0,1",
                                      "1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,2",
                                      "1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,0"};
    for (int i = 0; i < 3; i++) {
        CHECK(import_matrix(bad[i]) == PBS_DATA);
        CHECK(!strcmp(err.text, "node 0 (lens): matrix: the last row is not 0 0 0 1: this is no "
                                "placing"));
        tally_end(&seen);
    }
    static const char *const odd[] = {"1,0,0", "1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,'a'",
                                      "1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1e999"};
    for (int i = 0; i < 3; i++) {
        CHECK(import_matrix(odd[i]) == PBS_DATA && *err.text);
        tally_end(&seen);
    }
}

TEST(strides) {
    NEED_GLTF;
    static const struct {
        int stride, good;
    } cases[] = {{0, 1}, {12, 1}, {16, 1}, {-12, 0}, {-4, 0}, {4, 0}, {8, 0}, {13, 0}, {14, 0}};
    float data[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        pbs_code rc = import_text(
            gltf_text(data, sizeof data,
                      ONE_NODE MESH "'bufferViews':[{'buffer':0,'byteLength':48,'byteStride':%d}],"
                                    "'accessors':[{'bufferView':0,'componentType':5126,'count':3,"
                                    "'type':'VEC3'}]",
                      cases[i].stride));
        CHECK_NUM(rc == (cases[i].good ? PBS_OK : PBS_DATA), cases[i].stride);
        if (rc)
            CHECK(strstr(err.text, "mesh 0 (wheel): primitive 0: accessor 0: bufferView 0: "
                                   "byteStride"));
        tally_end(&seen);
    }
}

static pbs_code import_instances(const void *data, size_t n, const char *attributes,
                                 const char *accessors) {
    return import_text(
        gltf_text(data, n,
                  "'nodes':[{'name':'forest','mesh':0,'extensions':{'EXT_mesh_gpu_instancing':{"
                  "'attributes':{%s}}}}]," MESH "'bufferViews':[{'buffer':0,'byteLength':%zu}],"
                  "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'},%s]",
                  attributes, n, accessors));
}

/* A quarter turn around z in each kind of number. */
TEST(normalised_instances) {
    NEED_GLTF;
    struct {
        float p[9], f[4];
        int8_t i8[4];
        int16_t i16[4];
    } d = {{0}, {0, 0, 3, 3}, {0, 0, 90, 90}, {0, 0, 23170, 23170}};
    const struct {
        int type;
        size_t at;
        const char *normalized;
    } kinds[] = {{5126, offsetof(__typeof__(d), f), ""},
                 {5120, offsetof(__typeof__(d), i8), "'normalized':true,"},
                 {5122, offsetof(__typeof__(d), i16), "'normalized':true,"}};
    for (int k = 0; k < 3; k++) {
        char accessor[256];
        snprintf(accessor, sizeof accessor,
                 "{'bufferView':0,'byteOffset':%zu,'componentType':%d,%s'count':1,'type':'VEC4'}",
                 kinds[k].at, kinds[k].type, kinds[k].normalized);
        CHECK(!import_instances(&d, sizeof d, "'ROTATION':1", accessor));
        if (!seen.roots) return;
        tally_node *root = tally_root_node(&seen);
        const double *m = seen.nodes[root->children[0].node].children[0].m;
        const double want[12] = {0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0};
        for (int i = 0; i < 12; i++) CHECK(fabs(m[i] - want[i]) < 1e-14);
        tally_end(&seen);
    }
    CHECK(import_instances(&d, sizeof d, "'SCALE':1",
                           "{'bufferView':0,'componentType':5126,'count':1,'type':'VEC4'}") ==
          PBS_DATA);
    CHECK(strstr(err.text, "node 0 (forest): EXT_mesh_gpu_instancing: SCALE does not fit"));
    tally_end(&seen);
    CHECK(import_instances(&d, sizeof d, "'SCALE':1,'ROTATION':2",
                           "{'bufferView':0,'componentType':5126,'count':1,'type':'VEC3'},"
                           "{'bufferView':0,'componentType':5126,'count':2,'type':'VEC4'}") ==
          PBS_DATA);
    tally_end(&seen);
}

/* Many instances cost the list of placings, and nothing per instance beside it. */
TEST(many_instances) {
    NEED_GLTF;
    enum { N = 100000 };
    float *d = calloc(3 * N, sizeof *d);
    for (int i = 0; i < N; i++) d[3 * i] = (float)i;
    CHECK(!import_instances(d, 3 * N * sizeof *d, "'TRANSLATION':1",
                            "{'bufferView':0,'componentType':5126,'count':100000,'type':'VEC3'}"));
    if (!seen.roots) return;
    tally_node *list = &seen.nodes[tally_root_node(&seen)->children[0].node];
    CHECK(list->count == N && !strcmp(list->name, "forest"));
    CHECK(list->children[N - 1].m[3] == N - 1);
    size_t decoded = 3 * N * sizeof *d;
    CHECK_NUM(pbs_mem_peak(&seen.run) < decoded + N * sizeof(pbs_child) + (1 << 20),
              pbs_mem_peak(&seen.run));
    tally_end(&seen);
    free(d);
}

/* Two assemblies that are equal but for their names: each placing has the name of its node, so
 * that a sink may keep one of them. */
TEST(names_of_placings) {
    NEED_GLTF;
    CHECK(!import_text(gltf_text(
        corners, sizeof corners,
        "'scenes':[{'nodes':[0,1,4]}],'nodes':[{'name':'front axle','children':[2,3]},"
        "{'name':'rear axle','children':[2,3]},{'name':'left','mesh':0},{'name':'right','mesh':0,"
        "'translation':[0,0,1]},{'name':'spare','mesh':0,'children':[0]}]," MESH
        "'bufferViews':[{'buffer':0,'byteLength':36}],"
        "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'}]")));
    if (!seen.roots) return;
    tally_node *root = tally_root_node(&seen);
    static const char *const top[] = {"front axle", "rear axle", "spare"};
    CHECK(root->count == 3 && seen.part_count == 1);
    for (size_t i = 0; i < 3; i++) CHECK(!strcmp(root->child_names[i], top[i]));
    for (size_t i = 0; i < 2; i++) {
        tally_node *axle = &seen.nodes[root->children[i].node];
        CHECK(!strcmp(axle->name, top[i]) && axle->count == 2);
        CHECK(!strcmp(axle->child_names[0], "left") && !strcmp(axle->child_names[1], "right"));
    }
    tally_node *spare = &seen.nodes[root->children[2].node];
    CHECK(spare->count == 2 && !strcmp(spare->child_names[0], "wheel") &&
          !strcmp(spare->child_names[1], "front axle"));
    tally_end(&seen);
}

TEST_MAIN
