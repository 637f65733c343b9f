/* scene_write.c: the sink behind which the readers of foreign files stand: a scene stream. */
#include "formats/meshbuild.h"
#include "formats/scene.h"
#include "formats/scene_wire.h"
#include "formats/wire.h"
#include <stdlib.h>
#include <string.h>

/* What an assembly has to know of its children. */
typedef struct below {
    uint64_t triangles;
    pbs_box box;
} below;

struct pbs_scene_writer {
    pbs_run *run;
    pbs_writer *w;
    pbs_sink sink;
    pbs_scene_options options;
    pbs_builder *builder;
    below *nodes;
    size_t node_count, node_cap;
    uint32_t materials, textures, root;
    char *part_name;
    double part_origin[3];
    uint64_t stored;
    uint64_t skipped[PBS_SKIP_KINDS];
};

const char *const pbs_skip_text[PBS_SKIP_KINDS] = {"triangles with NaN or infinite corners",
                                                   "triangles without area",
                                                   "points",
                                                   "line segments",
                                                   "placings with NaN or infinite transforms",
                                                   "missing textures or material libraries",
                                                   "polygons with fewer than 3 corners"};

static pbs_code put_texture(void *ctx, const char *name, const void *bytes, size_t size,
                            uint32_t *id, pbs_err *err) {
    pbs_scene_writer *s = ctx;
    uint8_t head[8] = {0};
    size_t n = name ? strlen(name) : 0;
    pbs_put_u32(head, (uint32_t)n);
    pbs_chunk c = {.tag = PBS_TAG_TEXTURE, .node = s->textures, .count = 1};
    pbs_piece piece[3] = {{head, sizeof head}, {name, n}, {bytes, size}};
    if (size + n + sizeof head > PBS_PAYLOAD_MAX)
        return pbs_fail(err, PBS_LIMIT, "texture %s: %zu MiB is more than the format takes (64)",
                        name ? name : "", size >> 20);
    *id = s->textures++;
    return pbs_writer_chunk(s->w, &c, piece, 3, err);
}

static pbs_code miss_texture(void *ctx, const char *name, uint32_t *id, pbs_err *err) {
    pbs_scene_writer *s = ctx;
    *id = PBS_NONE;
    if (!s->options.ignore_missing)
        return pbs_fail(err, PBS_DATA, "%s: is missing (--ignore-missing goes on without)", name);
    s->skipped[PBS_SKIP_TEXTURE]++;
    return PBS_OK;
}

static uint8_t *put_use(uint8_t *p, const pbs_texture_use *u) {
    p = pbs_put_u32(p, u->texture);
    *p++ = u->wrap_u;
    *p++ = u->wrap_v;
    p = pbs_put_u16(p, 0);
    for (int i = 0; i < 6; i++) p = pbs_put_f32(p, u->transform[i]);
    return p;
}

static pbs_code put_material(void *ctx, const pbs_material *m, uint32_t *id, pbs_err *err) {
    pbs_scene_writer *s = ctx;
    uint8_t buf[MATERIAL_FIXED] = {0}, *p = buf;
    for (int i = 0; i < 4; i++) p = pbs_put_f32(p, m->base[i]);
    for (int i = 0; i < 3; i++) p = pbs_put_f32(p, m->emissive[i]);
    p = pbs_put_f32(p, m->metallic);
    p = pbs_put_f32(p, m->roughness);
    p = pbs_put_f32(p, m->alpha_cutoff);
    *p++ = m->alpha;
    *p++ = m->double_sided;
    p = pbs_put_u16(p, 0);
    p = put_use(p, &m->base_texture);
    p = put_use(p, &m->material_texture);
    p = put_use(p, &m->emissive_texture);
    size_t n = m->name ? strlen(m->name) : 0;
    pbs_put_u32(p, (uint32_t)n);
    pbs_chunk c = {.tag = PBS_TAG_MATERIAL, .node = s->materials, .count = 1};
    pbs_piece piece[2] = {{buf, sizeof buf}, {m->name, n}};
    *id = s->materials++;
    return pbs_writer_chunk(s->w, &c, piece, 2, err);
}

static pbs_code part_begin(void *ctx, const char *name, const double origin[3], uint32_t corners,
                           pbs_err *err) {
    pbs_scene_writer *s = ctx;
    free(s->part_name);
    if (!(s->part_name = strdup(name ? name : ""))) return pbs_fail(err, PBS_LIMIT, "no memory");
    for (int k = 0; k < 3; k++) s->part_origin[k] = isfinite(origin[k]) ? origin[k] : 0;
    pbs_builder_begin(s->builder, (uint32_t)s->node_count, s->part_origin, corners);
    return PBS_OK;
}

static pbs_code triangle(void *ctx, const pbs_corner corner[3], uint32_t material, pbs_err *err) {
    pbs_scene_writer *s = ctx;
    return pbs_builder_triangle(s->builder, corner, material, err);
}

static pbs_code add_node(pbs_scene_writer *s, const pbs_node *n, uint32_t *id, pbs_err *err) {
    if (s->node_count >= PBS_NONE) return pbs_fail(err, PBS_LIMIT, "too many nodes");
    pbs_code rc = pbs_grow(s->run, &s->nodes, &s->node_cap, s->node_count + 1, sizeof *s->nodes,
                           "the table of nodes", err);
    if (rc) return rc;
    s->nodes[s->node_count] = (below){n->triangles, n->box};
    *id = (uint32_t)s->node_count++;
    return pbs_node_write(s->run, s->w, n, err);
}

static pbs_code part_end(void *ctx, uint32_t *id, pbs_err *err) {
    pbs_scene_writer *s = ctx;
    pbs_node n = {.id = (uint32_t)s->node_count, .name = s->part_name};
    pbs_code rc = pbs_builder_end(s->builder, &n.triangles, &n.box, err);
    if (rc) return rc;
    n.records = n.triangles;
    s->stored += n.triangles;
    memcpy(n.origin, s->part_origin, sizeof n.origin);
    return add_node(s, &n, id, err);
}

static bool is_finite_transform(const double m[12]) {
    for (int i = 0; i < 12; i++)
        if (!isfinite(m[i])) return false;
    return true;
}

static pbs_code put_assembly(pbs_scene_writer *s, const char *name, pbs_child *kept,
                             const pbs_child *children, size_t count, uint32_t *id, pbs_err *err) {
    pbs_node n = {.id = (uint32_t)s->node_count, .name = name, .box = PBS_BOX_EMPTY};
    n.children = kept;
    for (size_t i = 0; i < count; i++) {
        const pbs_child *c = &children[i];
        if (c->node >= s->node_count)
            return pbs_fail(err, PBS_INTERNAL, "a child comes after its assembly");
        if (!is_finite_transform(c->m)) {
            s->skipped[PBS_SKIP_TRANSFORM]++;
            continue;
        }
        kept[n.child_count++] = *c;
        const below *b = &s->nodes[c->node];
        pbs_box box = pbs_xform_box(c->m, &b->box);
        if (!pbs_box_is_empty(&box)) pbs_box_add(&n.box, box.min), pbs_box_add(&n.box, box.max);
        if (__builtin_add_overflow(n.triangles, b->triangles, &n.triangles))
            n.triangles = UINT64_MAX;
    }
    return add_node(s, &n, id, err);
}

static pbs_code assembly(void *ctx, const char *name, const pbs_child *children, size_t count,
                         uint32_t *id, pbs_err *err) {
    pbs_scene_writer *s = ctx;
    pbs_child *kept;
    pbs_code rc = pbs_alloc(s->run, &kept, count, sizeof *kept, "an assembly's children", err);
    if (rc) return rc;
    rc = put_assembly(s, name, kept, children, count, id, err);
    pbs_free(s->run, kept);
    return rc;
}

static pbs_code root(void *ctx, uint32_t node, pbs_err *err) {
    pbs_scene_writer *s = ctx;
    s->root = node;
    /* The root is the last node by the format's rule; a reader may have left others behind it. */
    if (node + 1 == s->node_count) return PBS_OK;
    pbs_child child = {.node = node};
    memcpy(child.m, PBS_IDENTITY, sizeof child.m);
    return assembly(s, "", &child, 1, &s->root, err);
}

static void skip(void *ctx, pbs_skip kind, uint64_t count) {
    pbs_scene_writer *s = ctx;
    s->skipped[kind] += count;
}

pbs_code pbs_scene_writer_new(pbs_run *run, pbs_writer *w, const pbs_scene_options *options,
                              pbs_scene_writer **out, pbs_err *err) {
    pbs_scene_writer *s = *out = calloc(1, sizeof *s);
    if (!s) return pbs_fail(err, PBS_LIMIT, "no memory");
    s->run = run;
    s->w = w;
    s->root = PBS_NONE;
    if (options) s->options = *options;
    s->sink = (pbs_sink){s,        run,      put_texture, miss_texture, put_material, part_begin,
                         triangle, part_end, assembly,    root,         skip,         false};
    pbs_code rc = pbs_builder_new(run, w, &s->builder, err);
    if (!rc) return PBS_OK;
    pbs_scene_writer_free(s);
    *out = NULL;
    return rc;
}

const pbs_sink *pbs_scene_sink(pbs_scene_writer *s) {
    return &s->sink;
}

pbs_code pbs_scene_writer_end(pbs_scene_writer *s, pbs_err *err) {
    pbs_builder_skips(s->builder, s->skipped);
    if (s->root == PBS_NONE || !s->nodes[s->root].triangles) {
        uint64_t bad = s->skipped[PBS_SKIP_NONFINITE] + s->skipped[PBS_SKIP_DEGENERATE];
        return pbs_fail(err, PBS_DATA, "no triangles in it%s",
                        bad ? " but such without area or with NaN" : "");
    }
    uint8_t buf[8 * PBS_SKIP_KINDS];
    for (int i = 0; i < PBS_SKIP_KINDS; i++) pbs_put_u64(buf + 8 * i, s->skipped[i]);
    pbs_chunk c = {.tag = PBS_TAG_COUNTS, .node = PBS_NONE, .count = PBS_SKIP_KINDS};
    pbs_piece piece = {buf, sizeof buf};
    return pbs_writer_chunk(s->w, &c, &piece, 1, err);
}

pbs_scene_totals pbs_scene_writer_totals(const pbs_scene_writer *s) {
    pbs_scene_totals t = {s->node_count, s->nodes[s->root].triangles, s->stored, {0}};
    memcpy(t.skipped, s->skipped, sizeof t.skipped);
    return t;
}

void pbs_scene_writer_free(pbs_scene_writer *s) {
    if (!s) return;
    pbs_builder_free(s->builder);
    pbs_free(s->run, s->nodes);
    free(s->part_name);
    free(s);
}
