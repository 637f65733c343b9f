/* test_gltf_failed.c: a sink that goes on without what cannot be read (--keep-going): only that is
 * left out, and what is told of it is what the reader would have ended with. */
#include "tests/gltf_tally.h"

typedef struct told {
    tally t; /* first, so that its functions serve */
    int count;
    char text[8][1024];
} told;

static told seen;
static pbs_err err;

static void on_failure(void *ctx, const pbs_err *why) {
    told *s = ctx;
    CHECK(why->code == PBS_DATA && !s->t.inside);
    snprintf(s->text[s->count++ % 8], sizeof s->text[0], "%s", why->text);
}

/* A mesh of one primitive and a mesh of two with everything that can be pointed to. */
static char *good_text(void) {
    struct {
        float p[12];
        uint16_t index[6], zero[2];
    } d = {{0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0}, {0, 1, 2, 2, 1, 3}, {0}};
    return gltf_text(
        &d, sizeof d,
        "'scene':0,'scenes':[{'nodes':[0]}],'nodes':[{'children':[1,2,3]},{'mesh':0,'name':'a'},"
        "{'mesh':1,'name':'b','matrix':[1,0,0,0,0,1,0,0,0,0,1,0,5,0,0,1]},"
        "{'mesh':0,'name':'c','extensions':{'EXT_mesh_gpu_instancing':{'attributes':{"
        "'TRANSLATION':4}}}}],"
        "'meshes':[{'name':'m','primitives':[{'indices':1,'attributes':{'POSITION':0}}]},"
        "{'name':'n','primitives':[{'attributes':{'POSITION':0}},"
        "{'indices':2,'material':0,'attributes':{'POSITION':3}}]}],"
        "'materials':[{'name':'red','pbrMetallicRoughness':{'baseColorFactor':[1,0,0,1],"
        "'baseColorTexture':{'index':0}}}],"
        "'textures':[{'source':0}],'images':[{'name':'i','bufferView':2}],"
        "'bufferViews':[{'buffer':0,'byteLength':48},{'buffer':0,'byteOffset':48,'byteLength':12},"
        "{'buffer':0,'byteOffset':60,'byteLength':4}],"
        "'accessors':[{'bufferView':0,'componentType':5126,'count':4,'type':'VEC3'},"
        "{'bufferView':1,'componentType':5123,'count':6,'type':'SCALAR'},"
        "{'bufferView':1,'byteOffset':0,'componentType':5123,'count':6,'type':'SCALAR'},"
        "{'bufferView':0,'byteOffset':0,'componentType':5126,'count':4,'type':'VEC3'},"
        "{'bufferView':0,'byteOffset':0,'componentType':5126,'count':2,'type':'VEC3'}]");
}

static char *changed(const char *text, const char *from, const char *to) {
    char *f = strdup(from), *t = strdup(to), *out;
    for (char *c = f; *c; c++) *c = *c == '\'' ? '"' : *c;
    for (char *c = t; *c; c++) *c = *c == '\'' ? '"' : *c;
    const char *at = strstr(text, f);
    if (!at || asprintf(&out, "%.*s%s%s", (int)(at - text), text, t, at + strlen(f)) < 0) abort();
    free(f);
    free(t);
    return out;
}

static pbs_code import_text(const char *text, bool going) {
    tally_begin(&seen.t);
    seen.count = 0;
    seen.t.sink.failed = going ? on_failure : NULL;
    pbs_code rc = import_bytes(&seen.t, "/nowhere/x.gltf", text, strlen(text), &err);
    CHECK(pbs_mem_used(&seen.t.run) == 0);
    return rc;
}

/* What is there of each kind. The good file has 2 triangles at a, 1 + 2 at b, and 2 * 2 at c. */
static const struct {
    const char *from, *to;
    unsigned below; /* triangles of the scene, all instances */
    unsigned materials, textures;
    const char *text; /* of the only failure; it ends so */
} cases[] = {
    /* a primitive */
    {"'indices':2", "'indices':9", 7, 1, 1, "accessor 9, but there are 5"},
    {"'byteOffset':0,'componentType':5123", "'byteOffset':4,'componentType':5123", 7, 1, 1,
     "bufferView 1 has 12"},
    {"'byteOffset':0,'componentType':5126,'count':4",
     "'byteOffset':0,'componentType':5126,'count':3", 7, 1, 1,
     "mesh 1 (n): primitive 1: index 3 at place 5, but there are 3 vertices"},
    {"'indices':2,", "'mode':9,'indices':2,", 7, 0, 0,
     "mesh 1 (n): primitive 1: mode 9 is not known"},
    {"'material':0", "'material':5", 7, 0, 0, "material 5, but there are 1"},
    /* the placings of a node, and one placing */
    {"'count':2,'type':'VEC3'", "'count':2,'type':'VEC4'", 5, 1, 1,
     "node 3 (c): EXT_mesh_gpu_instancing: TRANSLATION does not fit"},
    {"5,0,0,1]", "5,0,0,2]", 6, 1, 1,
     "node 2 (b): matrix: the last row is not 0 0 0 1: this is no placing"},
    {"'mesh':1", "'mesh':7", 6, 0, 0, "mesh 7, but there are 2"},
    /* a material, an image */
    {"'index':0", "'index':4", 9, 0, 0, "texture 4, but there are 1"},
    {"'bufferView':2", "'bufferView':8", 9, 1, 0, "bufferView 8, but there are 3"},
    {"'source':0", "'source':3", 9, 0, 0, "image 3, but there are 1"},
};

TEST(good) {
    NEED_GLTF;
    char *text = good_text();
    CHECK(import_text(text, true) == PBS_OK && !seen.count);
    CHECK_NUM(tally_root_node(&seen.t)->triangles == 9, tally_root_node(&seen.t)->triangles);
    CHECK(seen.t.material_count == 1 && seen.t.texture_count == 1);
    tally_end(&seen.t);
    free(text);
}

TEST(only_what_fails_is_left_out) {
    NEED_GLTF;
    char *text = good_text();
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char *bad = changed(text, cases[i].from, cases[i].to);
        CHECK(import_text(bad, false) == PBS_DATA);
        char would[1024];
        snprintf(would, sizeof would, "%s", err.text);
        tally_end(&seen.t);
        pbs_code rc = import_text(bad, true);
        uint64_t n = tally_root_node(&seen.t)->triangles;
        bool same = rc == PBS_OK && seen.count == 1 && n == cases[i].below &&
                    seen.t.material_count == cases[i].materials &&
                    seen.t.texture_count == cases[i].textures;
        size_t l = strlen(seen.text[0]), w = strlen(would);
        /* In the place where it is met; the reader adds what it was on the way to. */
        bool told_so =
            w >= l && !strcmp(would + w - l, seen.text[0]) && strstr(seen.text[0], cases[i].text);
        if (!same || !told_so)
            printf("# %s: code %d, %d told, %d triangles, %u materials, %u textures: %s | %s\n",
                   cases[i].to, rc, seen.count, (int)n, seen.t.material_count, seen.t.texture_count,
                   seen.text[0], would);
        CHECK(same && told_so);
        tally_end(&seen.t);
        free(bad);
    }
    free(text);
}

/* A box that was begun with a primitive that fails later must not move the part's origin. */
TEST(origin_is_that_of_what_is_there) {
    NEED_GLTF;
    char *text = good_text(), *bad, *far;
    bad = changed(text, "{'indices':2,'material':0,", "{'indices':1,");
    far = changed(bad, "'byteOffset':0,'componentType':5126,'count':4",
                  "'byteOffset':0,'componentType':5126,'count':3");
    CHECK(import_text(far, true) == PBS_OK && seen.count == 1);
    CHECK(seen.t.nodes[1].origin[0] == 0.5 && seen.t.nodes[1].triangles == 1);
    tally_end(&seen.t);
    free(text), free(bad), free(far);
}

/* One note for a material or an image, however many primitives use it; one for each primitive that
 * needs a buffer which is not there. */
TEST(how_often_it_is_told) {
    NEED_GLTF;
    char *text = good_text(), *twice, *bad;
    twice = changed(text, "{'attributes':{'POSITION':0}},",
                    "{'material':0,'attributes':{'POSITION':0}},");
    bad = changed(twice, "'index':0", "'index':4");
    CHECK(import_text(bad, true) == PBS_OK && seen.count == 1);
    tally_end(&seen.t);
    free(bad);
    bad = changed(text, "data:", "gone:");
    CHECK(import_text(bad, true) == PBS_OK);
    CHECK_NUM(seen.count == 4, seen.count); /* three primitives and the instances of c */
    CHECK(tally_root_node(&seen.t)->triangles == 0);
    tally_end(&seen.t);
    free(text), free(twice), free(bad);
}

/* What is no list of things, or whose structure is broken, stays an error. */
TEST(structure_stays_an_error) {
    NEED_GLTF;
    char *text = good_text();
    static const char *const wrong[][2] = {{"[1,2,3]", "[1,2,0]"},
                                           {"[1,2,3]", "[1,2,9]"},
                                           {"'2.0'", "'1.0'"},
                                           {"'scene':0", "'scene':2"},
                                           {"'baseColorFactor':[", "'baseColorFactor':[}"}};
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        char *bad = changed(text, wrong[i][0], wrong[i][1]);
        pbs_code rc = import_text(bad, true);
        if (rc != PBS_DATA) printf("# %s: %d %s\n", wrong[i][1], rc, err.text);
        CHECK(rc == PBS_DATA);
        tally_end(&seen.t);
        free(bad);
    }
    free(text);
}

/* Errors that are not the file's are never left out. */
TEST(a_full_sink_is_an_error) {
    NEED_GLTF;
    char *text = good_text();
    for (int at = 1;; at++) {
        tally_begin(&seen.t);
        seen.count = 0;
        seen.t.sink.failed = on_failure;
        seen.t.fail_at = at;
        pbs_code rc = import_bytes(&seen.t, "x.gltf", text, strlen(text), &err);
        bool all = seen.t.calls < at;
        CHECK(rc == (all ? PBS_OK : PBS_IO) && !seen.count);
        tally_end(&seen.t);
        if (all || rc == PBS_OK) break;
    }
    free(text);
}

TEST_MAIN
