/* test_gltf_motion.c: the keys of glTF animations, whole, in every form, and damaged. */
#include "tests/gltf_tally.h"

static tally seen;
static pbs_err err;

#define MESH "'meshes':[{'primitives':[{'attributes':{'POSITION':0}}]}],"

/* Floats of the file: a triangle, then what a case says. */
typedef struct file {
    float corners[9];
    float data[64];
} file;

static file with(const float *data, size_t n) {
    file f = {{0, 0, 0, 1, 0, 0, 0, 1, 0}, {0}};
    memcpy(f.data, data, n * sizeof *data);
    return f;
}

/* accessor: members of that of the times, then of that of the values, whose view is the same. */
static pbs_code import(const file *f, const char *node, const char *times, const char *values,
                       const char *more, const char *animations) {
    char *text =
        gltf_text(f, sizeof *f,
                  "'nodes':[{%s'name':'x','mesh':0}]," MESH "'animations':[%s],"
                  "'bufferViews':[{'buffer':0,'byteLength':36},{'buffer':0,'byteOffset':36,'"
                  "byteLength':256}],"
                  "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'},"
                  "{%s'type':'SCALAR'},{%s}%s]",
                  node, animations, times, values, more);
    tally_begin(&seen);
    pbs_code rc = import_bytes(&seen, "/nowhere/x.gltf", text, strlen(text), &err);
    CHECK(pbs_mem_used(&seen.run) == 0);
    free(text);
    return rc;
}

#define FLOATS(offset, count)                                                                      \
    "'bufferView':1,'byteOffset':" offset ",'componentType':5126,'count':" count ","
#define CHANNEL(path, way)                                                                         \
    "{'name':'go','samplers':[{'input':1,'output':2" way                                           \
    "}],'channels':[{'sampler':0,'target':{'node':0,'path':'" path "'}}]}"

static uint32_t motion_of(void) {
    return seen.roots ? tally_root_node(&seen)->children[0].motion : UINT32_MAX;
}

TEST(keys_come_as_they_are) {
    NEED_GLTF;
    const float data[] = {0, 0.5f, 2, /* times */
                          1, 2,    3, 4, 5, 6, 7, 8, 9};
    file f = with(data, 12);
    CHECK(!import(&f, "'translation':[1,2,4],'scale':[2,2,2],", FLOATS("0", "3"),
                  FLOATS("12", "3") "'type':'VEC3'", "", CHANNEL("translation", "")));
    CHECK(seen.animation_count == 1 && !strcmp(seen.animations[0], "go"));
    CHECK(seen.motion_count == 1 && motion_of() == 1);
    if (seen.motion_count == 1) {
        const pbs_motion *m = seen.motions;
        const pbs_motion_channel *c = m->channels;
        CHECK(m->count == 1 && m->rest.translation[2] == 4 && m->rest.scale[0] == 2);
        CHECK(c->keys == 3 && c->path == PBS_MOTION_TRANSLATION && c->way == PBS_MOTION_LINEAR);
        CHECK(c->time[1] == 0.5 && c->time[2] == 2 && c->value[0] == 1 && c->value[8] == 9);
    }
    CHECK(!seen.skipped[PBS_SKIP_KEY] && !seen.skipped[PBS_SKIP_CHANNEL]);
    tally_end(&seen);
}

/* Rotations in bytes and shorts, which the standard allows, and their bounds. */
TEST(rotations_in_integers) {
    NEED_GLTF;
    const struct {
        int type;
        unsigned char bytes[16];
        double value[8];
    } cases[] = {
        {5120, {0, 0, 127, 0, 0, 0x81, 0, 0x80}, {0, 0, 1, 0, 0, -1, 0, -1}},
        {5121, {0, 0, 255, 0, 0, 51, 0, 0}, {0, 0, 1, 0, 0, 0.2, 0, 0}},
        {5122,
         {0, 0, 0, 0, 0xff, 0x7f, 0, 0, 0, 0, 1, 0x80, 0, 0, 0, 0x80},
         {0, 0, 1, 0, 0, -1, 0, -1}},
        {5123, {0, 0, 0, 0, 0xff, 0xff, 0, 0, 0, 0, 0x33, 0x33}, {0, 0, 1, 0, 0, 0.2, 0, 0}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        file f = with((const float[]){0, 1}, 2);
        char values[200];
        memcpy(f.data + 2, cases[i].bytes, 16);
        snprintf(values, sizeof values,
                 "'bufferView':1,'byteOffset':8,'componentType':%d,'count':2,'type':'VEC4',"
                 "'normalized':true",
                 cases[i].type);
        CHECK(!import(&f, "", FLOATS("0", "2"), values, "", CHANNEL("rotation", "")));
        CHECK_NUM(seen.motion_count == 1, i);
        for (int k = 0; seen.motion_count == 1 && k < 8; k++)
            CHECK_NUM(seen.motions[0].channels[0].value[k] == cases[i].value[k], 10 * i + k);
        tally_end(&seen);
    }
}

TEST(steps_and_splines) {
    NEED_GLTF;
    const float data[] = {0, 1, 0, 0, 0, 1, 1, 1, 5, 5, 5, 6, 6, 6, 2, 2, 2, 0, 0, 0};
    file f = with(data, 20);
    CHECK(!import(&f, "", FLOATS("0", "2"), FLOATS("8", "2") "'type':'VEC3'", "",
                  CHANNEL("scale", ",'interpolation':'STEP'")));
    CHECK(seen.motion_count == 1 && seen.motions[0].channels[0].way == PBS_MOTION_STEP);
    tally_end(&seen);
    CHECK(!import(&f, "", FLOATS("0", "2"), FLOATS("8", "6") "'type':'VEC3'", "",
                  CHANNEL("scale", ",'interpolation':'CUBICSPLINE'")));
    CHECK(seen.motion_count == 1);
    if (seen.motion_count == 1) {
        const pbs_motion_channel *c = seen.motions[0].channels;
        CHECK(c->way == PBS_MOTION_CUBIC && c->keys == 2 && c->value[3] == 1 && c->value[6] == 5);
        CHECK(c->value[9] == 6 && c->value[12] == 2);
    }
    tally_end(&seen);
}

TEST(sparse_keys) {
    NEED_GLTF;
    /* Three keys of zeros but the second one, whose index 1 is the byte behind. */
    float data[] = {0, 1, 2, 7, 8, 9, 0};
    unsigned char one = 1;
    memcpy(&data[6], &one, 1);
    file f = with(data, 7);
    CHECK(!import(&f, "", FLOATS("0", "3"),
                  "'componentType':5126,'count':3,'type':'VEC3','sparse':{'count':1,"
                  "'indices':{'bufferView':1,'byteOffset':24,'componentType':5121},"
                  "'values':{'bufferView':1,'byteOffset':12}}",
                  "", CHANNEL("translation", "")));
    CHECK(seen.motion_count == 1);
    if (seen.motion_count == 1) {
        const double *v = seen.motions[0].channels[0].value;
        CHECK(v[0] == 0 && v[3] == 7 && v[5] == 9 && v[8] == 0);
    }
    tally_end(&seen);
}

/* Keys that say nothing go, and are counted; the others stay. */
TEST(bad_keys) {
    NEED_GLTF;
    const float nan = NAN, inf = INFINITY;
    const struct {
        float time[4], value[16];
        const char *type;
        unsigned keys, bad;
    } cases[] = {
        {{0, nan, 1, 2}, {1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4}, "'VEC3'", 3, 1},
        {{0, 2, 1, 3}, {1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4}, "'VEC3'", 3, 1},
        {{0, 1, 1, 3}, {1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4}, "'VEC3'", 4, 0},
        {{0, inf, -inf, 3}, {1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4}, "'VEC3'", 2, 2},
        {{0, 1, 2, 3}, {1, nan, 1, 2, inf, 2, 3, 3, 3, 4, 4, 4}, "'VEC3'", 2, 2},
        {{nan, nan, nan, nan}, {1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4}, "'VEC3'", 0, 0},
        {{0, 1, 2, 3}, {0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0}, "'VEC4'", 2, 2},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        float data[20];
        char values[100];
        memcpy(data, cases[i].time, sizeof cases[i].time);
        memcpy(data + 4, cases[i].value, sizeof cases[i].value);
        file f = with(data, 20);
        snprintf(values, sizeof values, "%s'type':%s", FLOATS("16", "4"), cases[i].type);
        CHECK(!import(&f, "", FLOATS("0", "4"), values, "",
                      i == 6 ? CHANNEL("rotation", "") : CHANNEL("scale", "")));
        CHECK_NUM(seen.motion_count == (cases[i].keys > 0), i);
        CHECK_NUM(motion_of() == seen.motion_count, i);
        if (seen.motion_count == 1) CHECK_NUM(seen.motions[0].channels[0].keys == cases[i].keys, i);
        CHECK_NUM(seen.skipped[PBS_SKIP_KEY] == cases[i].bad, i);
        CHECK_NUM(seen.skipped[PBS_SKIP_CHANNEL] == (cases[i].keys == 0), i);
        /* It moves, as far as one can tell, and stays where it is. */
        CHECK_NUM(tally_root_node(&seen)->children[0].flags == PBS_CHILD_MOVES, i);
        tally_end(&seen);
    }
}

/* What cannot be read is counted, and the scene is still one. */
TEST(bad_channels) {
    NEED_GLTF;
    const struct {
        const char *node, *times, *values, *animations;
    } cases[] = {
        {"", FLOATS("0", "3"), FLOATS("16", "2") "'type':'VEC3'", CHANNEL("scale", "")},
        {"", FLOATS("0", "2"), FLOATS("16", "2") "'type':'VEC4'", CHANNEL("scale", "")},
        {"", FLOATS("0", "2"), FLOATS("16", "2") "'type':'VEC3'",
         CHANNEL("scale", ",'interpolation':'CUBICSPLINE'")},
        {"", FLOATS("0", "2"), FLOATS("16", "7") "'type':'VEC3'",
         CHANNEL("scale", ",'interpolation':'CUBICSPLINE'")},
        {"", FLOATS("0", "0"), FLOATS("16", "0") "'type':'VEC3'", CHANNEL("scale", "")},
        {"", FLOATS("0", "2000"), FLOATS("16", "2") "'type':'VEC3'", CHANNEL("scale", "")},
        {"", "'componentType':5126,'count':9000000,",
         "'componentType':5126,'count':9000000,'type':'VEC3'", CHANNEL("scale", "")},
        {"'matrix':[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1],", FLOATS("0", "2"),
         FLOATS("16", "2") "'type':'VEC3'", CHANNEL("scale", "")},
        {"", FLOATS("0", "2"), FLOATS("16", "2") "'type':'VEC3'",
         "{'samplers':[{'output':2}],'channels':[{'sampler':0,'target':{'node':0,'path':'scale'}}]"
         "}"},
        {"", FLOATS("0", "2"), FLOATS("16", "2") "'type':'VEC3'",
         "{'samplers':[{'input':-4,'output':2}],"
         "'channels':[{'sampler':0,'target':{'node':0,'path':'scale'}}]}"},
        {"", FLOATS("0", "2"), FLOATS("16", "2") "'type':'VEC3'",
         "{'channels':[{'sampler':7,'target':{'node':0,'path':'scale'}}]}"},
    };
    const float data[20] = {0, 1, 2, 3, 5, 6, 7, 8, 9};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        file f = with(data, 20);
        CHECK_NUM(
            !import(&f, cases[i].node, cases[i].times, cases[i].values, "", cases[i].animations),
            i);
        CHECK_NUM(seen.motion_count == 0 && motion_of() == 0, i);
        /* One without any key never shows another pose. */
        CHECK_NUM(seen.skipped[PBS_SKIP_CHANNEL] == (i != 4), i);
        tally_end(&seen);
    }
}

/* Two animations keep their numbers; a channel that repeats the rest says nothing. */
TEST(several_animations) {
    NEED_GLTF;
    const float data[] = {0, 1, 0, 0, 0, 5, 5, 5, 1, 1, 1, 1, 1, 1};
    file f = with(data, 14);
    CHECK(!import(&f, "", FLOATS("0", "2"), FLOATS("8", "2") "'type':'VEC3'",
                  ",{" FLOATS("32", "2") "'type':'VEC3'}",
                  "{'samplers':[{'input':1,'output':3}],"
                  "'channels':[{'sampler':0,'target':{'node':0,'path':'scale'}}]},"
                  "{'name':'b','samplers':[{'input':1,'output':3},{'input':1,'output':2}],"
                  "'channels':[{'sampler':0,'target':{'node':0,'path':'scale'}},"
                  "{'sampler':1,'target':{'node':0,'path':'translation'}}]}"));
    CHECK(seen.animation_count == 2 && !*seen.animations[0] && !strcmp(seen.animations[1], "b"));
    CHECK(seen.motion_count == 1);
    if (seen.motion_count == 1) {
        CHECK(seen.motions[0].count == 1 && seen.motions[0].channels[0].animation == 1);
        CHECK(seen.motions[0].channels[0].path == PBS_MOTION_TRANSLATION);
    }
    tally_end(&seen);
    /* Nothing moves: nothing is said. */
    CHECK(!import(&f, "", FLOATS("0", "2"), FLOATS("32", "2") "'type':'VEC3'", "",
                  CHANNEL("scale", "")));
    CHECK(seen.animation_count == 0 && seen.motion_count == 0);
    tally_end(&seen);
}
TEST_MAIN
