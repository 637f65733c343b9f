/* test_gltf.c: the glTF reader on files that are right: geometry, hierarchy, materials. */
#include "tests/gltf_tally.h"

static tally seen;
static pbs_err err;

/* Imports a text of gltf_text and frees it. */
static pbs_code import_text(char *text) {
    tally_begin(&seen);
    pbs_code rc = import_bytes(&seen, "/nowhere/test.gltf", text, strlen(text), &err);
    if (rc) printf("# %s\n", err.text);
    free(text);
    return rc;
}
static bool same(const double *a, const double *b, int n, double eps) {
    for (int k = 0; k < n; k++)
        if (!(fabs(a[k] - b[k]) <= eps)) return false;
    return true;
}
/* Corner k of all has the position of vertex v, which is (v, v * v, -v). */
static bool is_vertex(size_t k, double v) {
    const double want[3] = {v, v * v, -v};
    return same(seen.corners[k].position, want, 3, 0);
}
static void vertices(float *p, int n) {
    for (int v = 0; v < n; v++)
        p[3 * v] = (float)v, p[3 * v + 1] = (float)(v * v), p[3 * v + 2] = (float)-v;
}

TEST(module_missing) {
    pbs_run run = {.threads = 1};
    const void *table = &run;
    char *old = getenv("PBS_MODULES"), *keep = old ? strdup(old) : NULL;
    setenv("PBS_MODULES", "/nonexistent", 1);
    CHECK(pbs_module_open(&run, "gltf", 1000, &table, &err) == PBS_IO);
    CHECK(!strcmp(err.text,
                  "module gltf: not installed (looked in /nonexistent): install simdjson, "
                  "tinygltf, Draco and meshoptimizer and build again"));
    CHECK(table == NULL && pbs_mem_used(&run) == 0);
    CHECK(pbs_module_open(&run, "nothing", 0, &table, &err) == PBS_INTERNAL);
    if (keep)
        setenv("PBS_MODULES", keep, 1);
    else
        unsetenv("PBS_MODULES");
    free(keep);

    run.mem_limit = 1000;
    CHECK(pbs_module_open(&run, "gltf", 1001, &table, &err) == PBS_LIMIT);
    pbs_code rc = pbs_module_open(&run, "gltf", 600, &table, &err);
    NEED_GLTF;
    CHECK(rc == PBS_OK);
    CHECK(pbs_module_open(&run, "gltf", 600, &table, &err) == PBS_OK); /* counted once */
    CHECK(pbs_mem_used(&run) == 600 && table != NULL);
}

/* All modes and kinds of index give the triangles of the standard's formulas. */
TEST(modes_and_indices) {
    NEED_GLTF;
    struct {
        float p[7 * 3];
        uint8_t i8[8];
        uint16_t i16[8];
        uint32_t i32[7];
    } data;
    memset(&data, 0, sizeof data);
    vertices(data.p, 7);
    for (int k = 0; k < 7; k++)
        data.i8[k] = (uint8_t)(6 - k), data.i16[k] = (uint16_t)(6 - k),
        data.i32[k] = (uint32_t)(6 - k);
    const struct {
        const char *indices;
        size_t at;
        int type;
    } kinds[] = {{"", 0, 5121},
                 {"'indices':1,", offsetof(__typeof__(data), i8), 5121},
                 {"'indices':1,", offsetof(__typeof__(data), i16), 5123},
                 {"'indices':1,", offsetof(__typeof__(data), i32), 5125}};
    const int triangles[7] = {0, 0, 0, 0, 2, 5, 5};
    for (int mode = 0; mode < 7; mode++)
        for (int kind = 0; kind < 4; kind++) {
            CHECK(!import_text(gltf_text(
                &data, sizeof data,
                ONE_NODE
                "'meshes':[{'primitives':[{%s'mode':%d,'attributes':{'POSITION':0}}]}],"
                "'bufferViews':[{'buffer':0,'byteLength':%zu}],"
                "'accessors':[{'bufferView':0,'componentType':5126,'count':7,'type':'VEC3'},"
                "{'bufferView':0,'byteOffset':%zu,'componentType':%d,'count':7,'type':'SCALAR'}]",
                kinds[kind].indices, mode, sizeof data, kinds[kind].at, kinds[kind].type)));
            if (!seen.roots) return;
            CHECK_NUM((int)seen.triangles == triangles[mode], seen.triangles);
            for (int i = 0; i < triangles[mode]; i++) {
                int list[3] = {3 * i, 3 * i + 1, 3 * i + 2}, fan[3] = {i + 1, i + 2, 0};
                int strip[3] = {i, i + 1 + i % 2, i + 2 - i % 2};
                const int *want = mode == 4 ? list : mode == 5 ? strip : fan;
                for (int k = 0; k < 3; k++)
                    CHECK(is_vertex((size_t)(3 * i + k), kind ? 6 - want[k] : want[k]));
            }
            CHECK(seen.skipped[PBS_SKIP_POINTS] == (mode == 0 ? 7 : 0));
            CHECK(seen.skipped[PBS_SKIP_LINES] == (uint64_t)(mode == 1   ? 3
                                                             : mode == 2 ? 7
                                                             : mode == 3 ? 6
                                                                         : 0));
            CHECK(seen.skipped[PBS_SKIP_POLYGON] == (mode == 4)); /* the seventh corner */
            CHECK(seen.part_count == 1);
            if (triangles[mode]) {
                /* A list uses vertices 0..5, or 6..1 backwards. */
                double lo = mode == 4 && kind ? 1 : 0, hi = mode == 4 && !kind ? 5 : 6;
                const double middle[3] = {(lo + hi) / 2, (lo * lo + hi * hi) / 2, -(lo + hi) / 2};
                CHECK(same(seen.nodes[0].origin, middle, 3, 0));
            }
            tally_end(&seen);
        }
}

/* The same colours in every form a file may have them. */
TEST(colours) {
    NEED_GLTF;
    struct {
        float p[9], rgb[9], rgba[12];
        uint8_t b3[12], b4[12];
        uint16_t s3[12], s4[12];
    } d;
    memset(&d, 0, sizeof d);
    const double linear[3] = {0, 0.2, 1};
    vertices(d.p, 3);
    for (int v = 0; v < 3; v++)
        for (int k = 0; k < 4; k++) {
            double c = k == 3 ? 0.4 : linear[(v + k) % 3];
            if (k < 3)
                d.rgb[3 * v + k] = (float)c, d.s3[4 * v + k] = (uint16_t)(c * 65535),
                              d.b3[4 * v + k] = (uint8_t)(c * 255);
            d.rgba[4 * v + k] = (float)c, d.s4[4 * v + k] = (uint16_t)(c * 65535),
                           d.b4[4 * v + k] = (uint8_t)(c * 255);
        }
    const struct {
        size_t at;
        int type, stride;
        const char *form;
    } forms[] = {{offsetof(__typeof__(d), rgb), 5126, 12, "VEC3"},
                 {offsetof(__typeof__(d), rgba), 5126, 16, "VEC4"},
                 {offsetof(__typeof__(d), b3), 5121, 4, "VEC3"},
                 {offsetof(__typeof__(d), b4), 5121, 4, "VEC4"},
                 {offsetof(__typeof__(d), s3), 5123, 8, "VEC3"},
                 {offsetof(__typeof__(d), s4), 5123, 8, "VEC4"}};
    const int srgb[3] = {0, 124, 255}; /* 255 * (1.055 * 0.2^(1/2.4) - 0.055) = 123.57 */
    for (size_t f = 0; f < sizeof forms / sizeof *forms; f++) {
        CHECK(!import_text(gltf_text(
            &d, sizeof d,
            ONE_NODE "'meshes':[{'primitives':[{'attributes':{'POSITION':0,'COLOR_0':1}}]}],"
                     "'bufferViews':[{'buffer':0,'byteLength':36},{'buffer':0,'byteOffset':%zu,'"
                     "byteLength':%d,'byteStride':%d}],"
                     "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'},"
                     "{'bufferView':1,'componentType':%d,%s'count':3,'type':'%s'}]",
            forms[f].at, 3 * forms[f].stride, forms[f].stride, forms[f].type,
            f % 2 || forms[f].type == 5126 ? "'normalized':true," : "", forms[f].form)));
        if (!seen.roots) return;
        CHECK(seen.nodes[0].flags == PBS_CORNER_COLOUR);
        for (int v = 0; v < 3; v++) {
            for (int k = 0; k < 3; k++)
                CHECK_NUM(seen.corners[v].colour[k] == srgb[(v + k) % 3],
                          seen.corners[v].colour[k]);
            CHECK(seen.corners[v].colour[3] == (f % 2 ? 102 : 255));
        }
        tally_end(&seen);
    }
}

/* KHR_mesh_quantization: integer positions, normals and texture coordinates, normalized or not. */
TEST(quantised) {
    NEED_GLTF;
    struct {
        int16_t p[12];
        int8_t n[12];
        uint16_t uv[6];
    } d = {{32767, -32768, 0, 0, 100, -100, 7, 0, 1, 2, 3, 0},
           {127, 0, -128, 0, 0, -64, 0, 0, 0, 0, 127, 0},
           {0, 65535, 13107, 0, 1, 2}};
    const double plain[3] = {32767, -32768, 0}, unit[3] = {1, -1, 0};
    for (int normalized = 0; normalized < 2; normalized++) {
        CHECK(!import_text(gltf_text(
            &d, sizeof d,
            "'extensionsRequired':['KHR_mesh_quantization']," ONE_NODE
            "'meshes':[{'primitives':[{'attributes':{'POSITION':0,'NORMAL':1,'TEXCOORD_0':2}}]}],"
            "'bufferViews':[{'buffer':0,'byteLength':24,'byteStride':8},{'buffer':0,'byteOffset':"
            "24,'byteLength':12,'byteStride':4},"
            "{'buffer':0,'byteOffset':36,'byteLength':12}],"
            "'accessors':[{'bufferView':0,'componentType':5122,'normalized':%s,'count':3,'type':'"
            "VEC3'},"
            "{'bufferView':1,'componentType':5120,'normalized':true,'count':3,'type':'VEC3'},"
            "{'bufferView':2,'componentType':5123,'normalized':true,'count':3,'type':'VEC2'}]",
            normalized ? "true" : "false")));
        if (!seen.roots) return;
        CHECK(seen.nodes[0].flags == (PBS_CORNER_NORMAL | PBS_CORNER_UV));
        CHECK(same(seen.corners[0].position, normalized ? unit : plain, 3, 0));
        CHECK(seen.corners[0].normal[0] == 1 && seen.corners[0].normal[2] == -1);
        CHECK(seen.corners[0].uv[1] == 1 && fabsf(seen.corners[1].uv[0] - 0.2f) < 1e-6f);
        tally_end(&seen);
    }
}

TEST(sparse) {
    NEED_GLTF;
    struct {
        float p[12], values[6];
        uint16_t where[4];
    } d = {{0}, {10, 11, 12, 20, 21, 22}, {1, 3, 0, 0}};
    vertices(d.p, 4);
    const double ten[3] = {10, 11, 12}, twenty[3] = {20, 21, 22}, zero[3] = {0, 0, 0};
    for (int view = 0; view < 2; view++) {
        CHECK(!import_text(gltf_text(
            &d, sizeof d,
            ONE_NODE
            "'meshes':[{'primitives':[{'mode':5,'attributes':{'POSITION':0}}]}],"
            "'bufferViews':[{'buffer':0,'byteLength':80}],"
            "'accessors':[{%s'componentType':5126,'count':4,'type':'VEC3','sparse':{'count':2,"
            "'indices':{'bufferView':0,'byteOffset':72,'componentType':5123},'values':{'bufferView'"
            ":0,'byteOffset':48}}}]",
            view ? "'bufferView':0," : "")));
        if (!seen.roots) return;
        /* triangles 0 1 2 and 1 3 2 */
        CHECK(seen.triangles == 2 && same(seen.corners[1].position, ten, 3, 0));
        CHECK(same(seen.corners[4].position, twenty, 3, 0));
        CHECK(view ? is_vertex(2, 2) : same(seen.corners[2].position, zero, 3, 0));
        tally_end(&seen);
    }
}

TEST(instancing) {
    NEED_GLTF;
    struct {
        float p[9], move[6], turn[8], size[6];
    } d = {{0}, {1, 2, 3, 4, 5, 6}, {0, 0, 0, 1, 0, 0, 3, 3}, {1, 1, 1, 2, 3, 4}};
    vertices(d.p, 3);
    CHECK(!import_text(
        gltf_text(&d, sizeof d,
                  "'extensionsRequired':['EXT_mesh_gpu_instancing'],'nodes':[{'name':'many','mesh':"
                  "0,'children':[1],'extensions':"
                  "{'EXT_mesh_gpu_instancing':{'attributes':{'TRANSLATION':1,'ROTATION':2,'SCALE':"
                  "3,'_ID':0}}}},{'name':'one','mesh':0}],"
                  "'meshes':[{'primitives':[{'attributes':{'POSITION':0}}]}],"
                  "'bufferViews':[{'buffer':0,'byteLength':%zu}],'accessors':["
                  "{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'},"
                  "{'bufferView':0,'byteOffset':36,'componentType':5126,'count':2,'type':'VEC3'},"
                  "{'bufferView':0,'byteOffset':60,'componentType':5126,'count':2,'type':'VEC4'},"
                  "{'bufferView':0,'byteOffset':92,'componentType':5126,'count':2,'type':'VEC3'}]",
                  sizeof d)));
    if (!seen.roots) return;
    CHECK(seen.part_count == 1 && seen.triangles == 1 && tally_root_node(&seen)->triangles == 3);
    tally_node *many = &seen.nodes[tally_root_node(&seen)->children[0].node];
    CHECK(many->count == 2 && !strcmp(many->child_names[1], "one"));
    tally_node *list = &seen.nodes[many->children[0].node];
    CHECK(list->count == 2 && list->triangles == 2);
    const double first[12] = {1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3};
    /* a quarter turn around z (of a quaternion that is not unit), after the scale */
    const double second[12] = {0, -3, 0, 4, 2, 0, 0, 5, 0, 0, 4, 6};
    CHECK(same(list->children[0].m, first, 12, 0));
    CHECK(same(list->children[1].m, second, 12, 1e-14));
    tally_end(&seen);
}

static const char hierarchy[] =
    "'scene':1,'scenes':[{'nodes':[4]},{'name':'all','nodes':[0,5]}],'nodes':["
    "{'name':'top','children':[1,2,3],'translation':[1,2,3],'rotation':[0,0,0.70710678118654752,0."
    "70710678118654752],'scale':[1,2,3]},"
    "{'name':'left','mesh':0,'matrix':[1,2,3,0,4,5,6,0,7,8,9,0,10,11,12,1]},"
    "{'name':'bone'},{'name':'both','mesh':0,'children':[6]},{'mesh':0},"
    "{'mesh':1.0},{'name':'leaf','mesh':1}],"
    "'animations':[{'channels':[{'sampler':0,'target':{'node':3,'path':'rotation'}},{'sampler':0,'"
    "target':{'node':6,'path':'weights'}}],"
    "'samplers':[{'input':0,'output':0}]}],"
    "'meshes':[{'name':'wheel','primitives':[{'attributes':{'POSITION':0}}]},{'primitives':[{'"
    "attributes':{'POSITION':0}}]}],"
    "'bufferViews':[{'buffer':0,'byteLength':36}],'accessors':[{'bufferView':0,'componentType':"
    "5126,'count':3,'type':'VEC3'}]";

TEST(hierarchy) {
    NEED_GLTF;
    float p[9];
    vertices(p, 3);
    CHECK(!import_text(gltf_text(p, sizeof p, hierarchy)));
    if (!seen.roots) return;
    tally_node *root = tally_root_node(&seen);
    CHECK(seen.part_count == 2 && seen.triangles == 2 && root->triangles == 4);
    CHECK(root->count == 2 && !strcmp(root->name, "all"));
    CHECK(!strcmp(root->child_names[0], "top") && !strcmp(root->child_names[1], "-"));
    /* 'mesh':1.0 is 1 */
    CHECK(seen.nodes[root->children[1].node].part);
    const double trs[12] = {0, -2, 0, 1, 1, 0, 0, 2, 0, 0, 3, 3};
    CHECK(same(root->children[0].m, trs, 12, 1e-15));

    tally_node *top = &seen.nodes[root->children[0].node];
    CHECK(top->count == 2 && !strcmp(top->name, "top")); /* without the bone */
    CHECK(!strcmp(top->child_names[0], "left") && !strcmp(top->child_names[1], "both"));
    const double matrix[12] = {1, 4, 7, 10, 2, 5, 8, 11, 3, 6, 9, 12};
    CHECK(same(top->children[0].m, matrix, 12, 0));
    CHECK(top->children[0].flags == 0 && top->children[1].flags == PBS_CHILD_MOVES);
    tally_node *wheel = &seen.nodes[top->children[0].node];
    CHECK(wheel->part && !strcmp(wheel->name, "wheel"));

    tally_node *both = &seen.nodes[top->children[1].node];
    CHECK(both->count == 2 && both->children[0].node == top->children[0].node);
    CHECK(same(both->children[0].m, PBS_IDENTITY, 12, 0));
    CHECK(!strcmp(both->child_names[1], "leaf") && both->children[1].flags == 0);
    CHECK(both->children[1].node == root->children[1].node);
    tally_end(&seen);
}

/* A chain of 100,000 nodes. */
TEST(deep) {
    NEED_GLTF;
    const int n = 100000;
    float p[9];
    vertices(p, 3);
    char *nodes = malloc((size_t)n * 32), *w = nodes;
    for (int i = 1; i < n; i++) w += sprintf(w, "{'children':[%d]},", i);
    CHECK(!import_text(gltf_text(
        p, sizeof p,
        "'nodes':[%s{'mesh':0}],'meshes':[{'primitives':[{'attributes':{'POSITION':0}}]}],"
        "'bufferViews':[{'buffer':0,'byteLength':36}],'accessors':[{'bufferView':0,'componentType':"
        "5126,'count':3,'type':'VEC3'}]",
        nodes)));
    if (!seen.roots) return;
    CHECK(seen.node_count == (uint32_t)n + 1 && tally_root_node(&seen)->triangles == 1);
    free(nodes);
    tally_end(&seen);
}

#define TRIANGLE                                                                                   \
    "'bufferViews':[{'buffer':0,'byteLength':36},{'buffer':0,'byteLength':7}],"                    \
    "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'},"                  \
    "{'bufferView':0,'componentType':5126,'count':3,'type':'VEC2'},"                               \
    "{'bufferView':0,'byteOffset':12,'componentType':5126,'count':3,'type':'VEC2'}]"
#define USES                                                                                       \
    "'meshes':[{'primitives':[{'material':%d,'attributes':{'POSITION':0,'TEXCOORD_0':1,'TEXCOORD_" \
    "1':2}}]}],"

static pbs_code import_materials(int used, const char *materials) {
    float p[9];
    vertices(p, 3);
    return import_text(gltf_text(
        p, sizeof p,
        ONE_NODE USES
        "'materials':[%s],'textures':[{'source':0},{'source':1,'sampler':0},{'source':0}],"
        "'samplers':[{'wrapS':33071,'wrapT':33648}],"
        "'images':[{'name':'inside','bufferView':1},{'uri':'data:image/"
        "png;base64,AAAA'}]," TRIANGLE,
        used, materials));
}

TEST(materials) {
    NEED_GLTF;
    CHECK(!import_materials(
        1, "{},{'name':'paint','alphaMode':'MASK','alphaCutoff':0.25,'doubleSided':true,"
           "'emissiveFactor':[0.5,0,1],'emissiveTexture':{'index':1},"
           "'extensions':{'KHR_materials_emissive_strength':{'emissiveStrength':4}},"
           "'pbrMetallicRoughness':{'baseColorFactor':[0.1,0.2,0.3,0.4],'metallicFactor':0.5,"
           "'roughnessFactor':0.75,'baseColorTexture':{'index':2,'extensions':{'KHR_texture_"
           "transform':"
           "{'offset':[0.5,0.25],'rotation':1.5707963267948966,'scale':[2,3]}}},"
           "'metallicRoughnessTexture':{'index':0}}}"));
    if (!seen.roots) return;
    const pbs_material *m = &seen.materials[0];
    CHECK(seen.material_count == 1 && !strcmp(seen.material_names[0], "paint"));
    CHECK(m->base[0] == 0.1f && m->base[3] == 0.4f && m->metallic == 0.5f && m->roughness == 0.75f);
    CHECK(m->emissive[0] == 2 && m->emissive[1] == 0 && m->emissive[2] == 4);
    CHECK(m->alpha == PBS_ALPHA_MASK && m->alpha_cutoff == 0.25f && m->double_sided);
    /* Two textures of one image are one. */
    CHECK(seen.texture_count == 2 && m->base_texture.texture == 0 &&
          m->material_texture.texture == 0);
    CHECK(!strcmp(seen.textures[0], "inside") && seen.texture_sizes[0] == 7 &&
          seen.texture_sizes[1] == 3);
    CHECK(m->base_texture.wrap_u == 0 && m->emissive_texture.wrap_u == 1 &&
          m->emissive_texture.wrap_v == 2);
    /* counterclockwise on the screen, with v downwards: (1, 0) goes to (0, -1) */
    const float turned[6] = {0, 3, 0.5f, -2, 0, 0.25f};
    for (int k = 0; k < 6; k++)
        CHECK_NUM(fabsf(m->base_texture.transform[k] - turned[k]) < 1e-6f,
                  m->base_texture.transform[k]);
    CHECK(seen.nodes[0].flags == PBS_CORNER_UV && seen.corner_materials[0] == 0);
    tally_end(&seen);

    CHECK(!import_materials(0, "{}")); /* the standard's default differs from no material */
    if (!seen.roots) return;
    CHECK(seen.materials[0].metallic == 1 && seen.materials[0].roughness == 1 &&
          seen.materials[0].base[2] == 1);
    CHECK(seen.materials[0].base_texture.texture == PBS_NONE && seen.texture_count == 0);
    tally_end(&seen);
    CHECK(!import_materials(-1, "{}"));
    if (!seen.roots) return;
    CHECK(seen.material_count == 0 && seen.corner_materials[0] == PBS_NONE);
    tally_end(&seen);

    CHECK(!import_materials(
        0, "{'extensions':{'KHR_materials_pbrSpecularGlossiness':{'diffuseFactor':[1,0,0,0.5],"
           "'glossinessFactor':0.25,'diffuseTexture':{'index':1}}},"
           "'pbrMetallicRoughness':{'baseColorTexture':{'index':0}}}"));
    if (!seen.roots) return;
    CHECK(seen.materials[0].base[1] == 0 && seen.materials[0].base[3] == 0.5f &&
          seen.materials[0].roughness == 0.75f);
    CHECK(seen.materials[0].metallic == 0 && seen.texture_count == 1 && seen.texture_sizes[0] == 3);
    tally_end(&seen);
}

/* One set of texture coordinates for a part: the base texture's. */
TEST(texture_coordinates) {
    NEED_GLTF;
    CHECK(!import_materials(0,
                            "{'pbrMetallicRoughness':{'baseColorTexture':{'index':0,'texCoord':1},"
                            "'metallicRoughnessTexture':{'index':1,'texCoord':0}},'emissiveTexture'"
                            ":{'index':1,'texCoord':0,"
                            "'extensions':{'KHR_texture_transform':{'texCoord':1}}}}"));
    if (!seen.roots) return;
    CHECK(seen.materials[0].base_texture.texture == 0 &&
          seen.materials[0].material_texture.texture == PBS_NONE);
    CHECK(seen.materials[0].emissive_texture.texture == 1 && seen.skipped[PBS_SKIP_TEXTURE] == 1);
    CHECK(seen.corners[0].uv[0] == 1 &&
          seen.corners[0].uv[1] == 1); /* TEXCOORD_1: three floats on */
    tally_end(&seen);
}

TEST(files_beside) {
    NEED_GLTF;
    char folder[] = "/tmp/pbs-gltf-XXXXXX", path[64];
    if (!mkdtemp(folder)) SKIP("no /tmp");
    float p[9];
    vertices(p, 3);
    const char *names[] = {"a b.bin", "t.png"};
    for (int i = 0; i < 2; i++) {
        snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        FILE *f = fopen(path, "wb");
        fwrite(p, 1, sizeof p, f);
        fclose(f);
    }
    snprintf(path, sizeof path, "%s/x.gltf", folder);
    const char *buffers[] = {"a%20b.bin",   "a b.bin", ".\\\\a b.bin", "c.bin", "http://x/a",
                             "/etc/passwd", "."};
    const char *images[] = {"t.png", "u.png"};
    for (size_t b = 0; b < sizeof buffers / sizeof *buffers; b++)
        for (size_t i = 0; i < 2; i++) {
            char *text;
            if (asprintf(
                    &text,
                    "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":36,\"uri\":\"%"
                    "s\"}],"
                    "\"images\":[{\"uri\":\"%s\"}],\"textures\":[{\"source\":0}],"
                    "\"materials\":[{\"emissiveTexture\":{\"index\":0}}],\"nodes\":[{\"mesh\":0}],"
                    "\"meshes\":[{\"primitives\":[{\"material\":0,\"attributes\":{\"POSITION\":0}}]"
                    "}],"
                    "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],"
                    "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":"
                    "\"VEC3\"}]}",
                    buffers[b], images[i]) < 0)
                abort();
            for (int allow = 0; allow < 2; allow++) {
                tally_begin(&seen);
                seen.allow_missing = allow;
                pbs_code rc = import_bytes(&seen, path, text, strlen(text), &err);
                bool good = b < 3 && (i == 0 || allow);
                CHECK((rc == PBS_OK) == good);
                if (b >= 3)
                    CHECK(strstr(err.text, buffers[b]) && rc == PBS_DATA);
                else
                    CHECK(seen.texture_count == (i == 0) && seen.missing_count == (i == 1));
                if (b < 3 && i == 0)
                    CHECK(seen.texture_sizes[0] == 36 && !strcmp(seen.textures[0], "t.png"));
                tally_end(&seen);
            }
            free(text);
        }
    for (int i = 0; i < 2; i++) {
        snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        unlink(path);
    }
    rmdir(folder);
}

/* Names in Latin-1, escapes, a mark of byte order, and members that do not belong to us. */
TEST(text) {
    NEED_GLTF;
    float p[9];
    vertices(p, 3);
    char *text = gltf_text(p, sizeof p,
                           "'nodes':[{'name':'K\xfchler "
                           "\\u00fc\\ud83d\\ude00\\n','mesh':0}],'me\\u0073hes':[{'primitives':[{'"
                           "attributes':{'POSITION':0}}]}],"
                           "'bufferViews':[{'buffer':0,'byteLength':36}],'accessors':[{'bufferView'"
                           ":0,'componentType':5126,'count':3,'type':'VEC3'}],"
                           "'cameras':[1,2],'x':[{'deep':[[[]]]}]");
    char *with;
    if (asprintf(&with, "\xef\xbb\xbf%s\n", text) < 0) abort();
    free(text);
    CHECK(!import_text(with));
    if (!seen.roots) return;
    CHECK(seen.triangles == 1);
    CHECK(!strcmp(tally_root_node(&seen)->child_names[0], "K?hler \xc3\xbc\xf0\x9f\x98\x80\n"));
    tally_end(&seen);
}

/* Nothing is kept after an import, and a limit that is too small is said. */
TEST(memory) {
    NEED_GLTF;
    float p[9];
    vertices(p, 3);
    char *text = gltf_text(p, sizeof p, hierarchy);
    tally_begin(&seen);
    CHECK(!import_bytes(&seen, "x", text, strlen(text), &err));
    CHECK(pbs_mem_used(&seen.run) == 0 && pbs_mem_peak(&seen.run) > strlen(text));
    tally_end(&seen);
    tally_begin(&seen);
    seen.run.mem_limit = 1000;
    CHECK(import_bytes(&seen, "x", text, strlen(text), &err) == PBS_LIMIT);
    CHECK(pbs_mem_used(&seen.run) == 0);
    tally_end(&seen);
    /* An error of the sink ends the import at once, wherever it happens. */
    for (long at = 1; at < 20; at++) {
        tally_begin(&seen);
        seen.fail_at = at;
        pbs_code rc = import_bytes(&seen, "x", text, strlen(text), &err);
        CHECK(seen.calls <= at && rc == (seen.calls == at ? PBS_IO : PBS_OK));
        if (rc) CHECK(!strcmp(err.text, "the sink is full"));
        CHECK(pbs_mem_used(&seen.run) == 0);
        seen.roots = 0;
        tally_end(&seen);
    }
    static const volatile sig_atomic_t stop = 1;
    tally_begin(&seen);
    seen.run.cancel = &stop;
    CHECK(import_bytes(&seen, "x", text, strlen(text), &err) == PBS_CANCEL);
    tally_end(&seen);
    free(text);
}

#define SAMPLES "/usr/share/assimp/models/glTF2/"

TEST(real_files) {
    NEED_GLTF;
    static const struct {
        const char *path;
        uint64_t flattened, unique;
        uint32_t parts;
    } files[] = {{"2CylinderEngine-glTF-Binary/2CylinderEngine.glb", 121496, 75730, 29},
                 /* Draco's encoder left out triangles with two equal corners. */
                 {"draco/2CylinderEngine.gltf", 110336, 65311, 29},
                 {"ClearCoat-glTF/ClearCoatTest.gltf", 37116, 37116, 27},
                 {"BoxTextured-glTF-Embedded/BoxTextured.gltf", 12, 12, 1},
                 {"BoxTextured-glTF-Binary/BoxTextured.glb", 12, 12, 1},
                 {"simple_skin/simple_skin.gltf", 8, 8, 1}};
    if (access(SAMPLES, F_OK)) SKIP("the package assimp-testmodels is not installed");
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        char path[256];
        snprintf(path, sizeof path, "%s%s", SAMPLES, files[i].path);
        tally_begin(&seen);
        CHECK(!import_file(&seen, path, &err));
        CHECK_NUM(tally_root_node(&seen)->triangles == files[i].flattened,
                  tally_root_node(&seen)->triangles);
        CHECK_NUM(seen.triangles == files[i].unique, seen.triangles);
        CHECK_NUM(seen.part_count == files[i].parts, seen.part_count);
        CHECK(pbs_mem_used(&seen.run) == 0);
        tally_end(&seen);
    }
}

TEST(real_bad_files) {
    NEED_GLTF;
    static const char *const files[][2] = {
        {"IndexOutOfRange/IndexOutOfRange.gltf",
         "mesh 0 (Mesh): primitive 0: index 255 at place 0, but there are 24 vertices"},
        {"MissingBin/BoxTextured.gltf", "buffer 0: BoxTextured0.bin: No such file"},
        {"RecursiveNodes/RecursiveNodes.gltf", "node 0: the hierarchy has a cycle"},
        {"BoxTextured-glTF-techniqueWebGL/BoxTextured.gltf",
         "needs the extension KHR_technique_webgl, which is not supported"}};
    if (access(SAMPLES, F_OK)) SKIP("the package assimp-testmodels is not installed");
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        char path[256];
        snprintf(path, sizeof path, "%s%s", SAMPLES, files[i][0]);
        tally_begin(&seen);
        CHECK(import_file(&seen, path, &err) == PBS_DATA);
        CHECK(strstr(err.text, files[i][1]) != NULL);
        tally_end(&seen);
    }
}

TEST_MAIN
