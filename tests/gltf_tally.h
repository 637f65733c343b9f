/* gltf_tally.h: for the tests of the glTF reader: a sink that keeps everything it is given and
 * checks the order of the calls, and a writer of small glTF files with embedded bytes. */
#ifndef PBS_GLTF_TALLY_H
#define PBS_GLTF_TALLY_H

#include "formats/readers/module.h"
#include "tests/check.h"
#include <fcntl.h>
#include <math.h>
#include <stdarg.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#define TALLY_CORNERS 3000

typedef struct tally_node {
    bool part;
    uint64_t triangles; /* flattened */
    char name[64];
    double origin[3];
    uint32_t flags; /* of the corners */
    pbs_child *children;
    char (*child_names)[64];
    size_t count;
} tally_node;

typedef struct tally {
    pbs_run run;
    pbs_sink sink;
    tally_node *nodes;
    uint32_t node_count, part_count, root, roots;
    pbs_material materials[64];
    char material_names[64][64];
    uint32_t material_count;
    char textures[64][64];
    size_t texture_sizes[64];
    uint32_t texture_count, missing_count;
    pbs_corner corners[TALLY_CORNERS]; /* the first ones */
    uint32_t corner_materials[TALLY_CORNERS];
    uint64_t triangles; /* of all parts */
    char animations[8][64];
    uint32_t animation_count, motion_count;
    pbs_motion motions[8]; /* with keys of their own */
    uint64_t skipped[PBS_SKIP_KINDS];
    bool inside, allow_missing;
    long calls, fail_at; /* 1: the first call fails, 0: none */
} tally;

static inline pbs_code tally_call(tally *t, pbs_err *err) {
    if (++t->calls != t->fail_at) return PBS_OK;
    return pbs_fail(err, PBS_IO, "the sink is full");
}
static inline void tally_name(char out[64], const char *name) {
    snprintf(out, 64, "%s", name ? name : "-");
}
static inline tally_node *tally_add(tally *t, const char *name) {
    if ((t->node_count & (t->node_count - 1)) == 0)
        t->nodes = realloc(t->nodes, (2 * (size_t)t->node_count + 1) * sizeof *t->nodes);
    tally_node *n = &t->nodes[t->node_count++];
    memset(n, 0, sizeof *n);
    tally_name(n->name, name);
    return n;
}
static inline pbs_code tally_texture(void *ctx, const char *name, const void *bytes, size_t size,
                                     uint32_t *id, pbs_err *err) {
    tally *t = ctx;
    CHECK(!t->inside);
    /* Every byte must be there. */
    unsigned sum = 0;
    for (size_t i = 0; i < size; i++) sum += ((const uint8_t *)bytes)[i];
    tally_name(t->textures[t->texture_count % 64], name);
    t->texture_sizes[t->texture_count % 64] = size + 0 * sum;
    *id = t->texture_count++;
    return tally_call(t, err);
}
static inline pbs_code tally_missing(void *ctx, const char *name, uint32_t *id, pbs_err *err) {
    tally *t = ctx;
    t->missing_count++;
    *id = PBS_NONE;
    if (!t->allow_missing) return pbs_fail(err, PBS_DATA, "texture %s is missing", name);
    return tally_call(t, err);
}
static inline pbs_code tally_material(void *ctx, const pbs_material *m, uint32_t *id,
                                      pbs_err *err) {
    tally *t = ctx;
    CHECK(!t->inside);
    const uint32_t used[] = {m->base_texture.texture, m->material_texture.texture,
                             m->emissive_texture.texture};
    for (int k = 0; k < 3; k++) CHECK(used[k] == PBS_NONE || used[k] < t->texture_count);
    t->materials[t->material_count % 64] = *m;
    tally_name(t->material_names[t->material_count % 64], m->name);
    *id = t->material_count++;
    return tally_call(t, err);
}
static inline pbs_code tally_part_begin(void *ctx, const char *name, const double origin[3],
                                        uint32_t corners, pbs_err *err) {
    tally *t = ctx;
    CHECK(!t->inside);
    t->inside = true;
    tally_node *n = tally_add(t, name);
    n->part = true;
    n->flags = corners;
    memcpy(n->origin, origin, sizeof n->origin);
    CHECK(isfinite(origin[0]) && isfinite(origin[1]) && isfinite(origin[2]));
    return tally_call(t, err);
}
static inline pbs_code tally_triangle(void *ctx, const pbs_corner corner[3], uint32_t material,
                                      pbs_err *err) {
    tally *t = ctx;
    if (!t->inside) CHECK(!"a triangle outside a part");
    if (material != PBS_NONE && material >= t->material_count) CHECK(!"an unknown material");
    for (int k = 0; k < 3; k++)
        if (3 * t->triangles + (uint64_t)k < TALLY_CORNERS) {
            t->corners[3 * t->triangles + (uint64_t)k] = corner[k];
            t->corner_materials[3 * t->triangles + (uint64_t)k] = material;
        }
    t->triangles++;
    t->nodes[t->node_count - 1].triangles++;
    return tally_call(t, err);
}
static inline pbs_code tally_part_end(void *ctx, uint32_t *node, pbs_err *err) {
    tally *t = ctx;
    CHECK(t->inside);
    t->inside = false;
    t->part_count++;
    *node = t->node_count - 1;
    return tally_call(t, err);
}
static inline pbs_code tally_assembly(void *ctx, const char *name, const pbs_child *children,
                                      size_t count, uint32_t *node, pbs_err *err) {
    tally *t = ctx;
    CHECK(!t->inside);
    tally_node *n = tally_add(t, name);
    n->count = count;
    n->children = malloc((count + 1) * sizeof *n->children);
    n->child_names = malloc((count + 1) * sizeof *n->child_names);
    for (size_t i = 0; i < count; i++) {
        n->children[i] = children[i];
        tally_name(n->child_names[i], children[i].name);
        CHECK(children[i].node < t->node_count - 1);
        n->triangles += t->nodes[children[i].node].triangles;
    }
    *node = t->node_count - 1;
    return tally_call(t, err);
}
static inline pbs_code tally_root(void *ctx, uint32_t node, pbs_err *err) {
    tally *t = ctx;
    CHECK(node < t->node_count);
    pbs_code rc = tally_call(t, err);
    t->root = node;
    t->roots += rc == PBS_OK;
    return rc;
}
static inline void tally_skip(void *ctx, pbs_skip kind, uint64_t count) {
    ((tally *)ctx)->skipped[kind] += count;
}

static inline pbs_code tally_animation(void *ctx, const char *name, uint32_t *id, pbs_err *err) {
    tally *t = ctx;
    (void)err;
    snprintf(t->animations[t->animation_count % 8], 64, "%s", name ? name : "");
    *id = t->animation_count++;
    return PBS_OK;
}

/* Keeps a copy, in one piece. */
static inline pbs_code tally_motion(void *ctx, const pbs_motion *motion, uint32_t *id,
                                    pbs_err *err) {
    tally *t = ctx;
    (void)err;
    size_t numbers = 0;
    for (uint32_t i = 0; i < motion->count; i++)
        numbers += (size_t)motion->channels[i].keys *
                   (1 + pbs_motion_numbers(motion->channels[i].path, motion->channels[i].way));
    CHECK(motion->count && t->motion_count < 8);
    pbs_motion_channel *c = malloc(motion->count * sizeof *c + numbers * sizeof(double));
    if (!c) abort();
    double *at = (double *)(c + motion->count);
    for (uint32_t i = 0; i < motion->count; i++) {
        c[i] = motion->channels[i];
        size_t keys = c[i].keys, values = keys * pbs_motion_numbers(c[i].path, c[i].way);
        CHECK(keys && c[i].animation < t->animation_count);
        c[i].time = memcpy(at, c[i].time, keys * sizeof *at);
        c[i].value = memcpy(at + keys, c[i].value, values * sizeof *at);
        at += keys + values;
    }
    t->motions[t->motion_count % 8] = (pbs_motion){motion->rest, motion->count, c};
    *id = ++t->motion_count;
    return PBS_OK;
}

static inline void tally_begin(tally *t) {
    memset(t, 0, sizeof *t);
    t->run.threads = 1;
    t->sink = (pbs_sink){t,
                         &t->run,
                         tally_texture,
                         tally_missing,
                         tally_material,
                         tally_part_begin,
                         tally_triangle,
                         tally_part_end,
                         tally_assembly,
                         tally_root,
                         tally_skip,
                         false,
                         NULL,
                         tally_animation,
                         tally_motion};
}
static inline void tally_end(tally *t) {
    for (uint32_t i = 0; i < t->node_count; i++) {
        free(t->nodes[i].children);
        free(t->nodes[i].child_names);
    }
    for (uint32_t i = 0; i < t->motion_count && i < 8; i++) free((void *)t->motions[i].channels);
    free(t->nodes);
    t->nodes = NULL;
    t->node_count = 0;
}
static inline tally_node *tally_root_node(tally *t) {
    static tally_node none;
    return t->roots ? &t->nodes[t->root] : &none;
}

static inline pbs_code import_bytes(tally *t, const char *path, const void *p, size_t n,
                                    pbs_err *err) {
    memset(err, 0, sizeof *err);
    /* The exact size on the heap, so that asan sees one byte too far. */
    void *copy = malloc(n ? n : 1);
    memcpy(copy, p, n);
    pbs_code rc = pbs_import_gltf(path, copy, n, &t->sink, err);
    free(copy);
    CHECK((rc == PBS_OK) == (t->roots == 1));
    CHECK(rc == PBS_OK || (err->code == rc && *err->text));
    return rc;
}
static inline pbs_code import_file(tally *t, const char *path, pbs_err *err) {
    int fd = open(path, O_RDONLY);
    struct stat st;
    if (fd < 0 || fstat(fd, &st)) return pbs_fail_errno(err, "%s", path);
    void *p = st.st_size ? mmap(NULL, (size_t)st.st_size, PROT_READ, MAP_PRIVATE, fd, 0) : NULL;
    close(fd);
    t->sink.mapped = true;
    pbs_code rc = pbs_import_gltf(path, p, (size_t)st.st_size, &t->sink, err);
    if (p) munmap(p, (size_t)st.st_size);
    return rc;
}

static inline char *base64(const void *data, size_t n) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const uint8_t *p = data;
    char *out = malloc((n + 2) / 3 * 4 + 1), *o = out;
    for (size_t i = 0; i < n; i += 3) {
        uint32_t v = (uint32_t)p[i] << 16 | (i + 1 < n ? (uint32_t)p[i + 1] << 8 : 0) |
                     (i + 2 < n ? p[i + 2] : 0);
        for (int k = 0; k < 4; k++) *o++ = digits[v >> (18 - 6 * k) & 63];
        if (i + 1 >= n) o[-2] = '=';
        if (i + 2 >= n) o[-1] = '=';
    }
    *o = 0;
    return out;
}

/* A glTF with one embedded buffer; the rest is the members behind "buffers", with ' for ". */
static inline char *gltf_text(const void *data, size_t n, const char *fmt, ...) {
    char *b = base64(data, n), *rest, *text;
    va_list ap;
    va_start(ap, fmt);
    if (vasprintf(&rest, fmt, ap) < 0) abort();
    va_end(ap);
    for (char *c = rest; *c; c++)
        if (*c == '\'') *c = '"';
    if (asprintf(&text,
                 "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":%zu,\"uri\":"
                 "\"data:application/octet-stream;base64,%s\"}],%s}",
                 n, b, rest) < 0)
        abort();
    free(b);
    free(rest);
    return text;
}

/* Without the libraries there is no module, and nothing to test; a module that is there and does
 * not open is a failure. */
static inline bool gltf_is_left_out(void) {
    pbs_run run = {.threads = 1};
    const void *table;
    pbs_err err = {0};
    return pbs_module_open(&run, "gltf", 0, &table, &err) && strstr(err.text, "not installed");
}
#define NEED_GLTF                                                                                  \
    if (gltf_is_left_out()) SKIP("the module gltf is not built")

/* One mesh in one node in one scene. */
#define ONE_NODE "'scene':0,'scenes':[{'nodes':[0]}],'nodes':[{'mesh':0}],"
#endif
