/* scene_write.c: the sink behind which the readers of foreign files stand: a scene stream. Here is
 * decided what becomes of parts and assemblies: split, grouped (paper 1, section 3.1), or one with
 * an equal one. */
#include "formats/scene/group.h"
#include "formats/scene/known.h"
#include "formats/scene/meshlist.h"
#include "formats/scene/scene.h"
#include "formats/scene/split.h"
#include "formats/scene/scene_wire.h"
#include "formats/container/wire.h"
#include <stdlib.h>
#include <string.h>

struct pbs_scene_writer {
    pbs_run *run;
    pbs_writer *w;
    pbs_sink sink;
    pbs_scene_options options;
    pbs_builder *builder;
    pbs_meshlist meshes; /* of the part that is open */
    pbs_known known;
    pbs_known motions; /* by their bytes */
    uint32_t animations;
    uint32_t materials, textures, root;
    char *part_name;
    double part_origin[3];
    uint32_t part_corners;
    pbs_scene_totals totals;
};

const char *const pbs_skip_text[PBS_SKIP_KINDS] = {
    "triangles with NaN or infinite corners",
    "triangles without area",
    "points",
    "line segments",
    "placings with NaN or infinite transforms",
    "missing textures or material libraries",
    "polygons with fewer than 3 corners",
    "parts, materials or textures that cannot be read",
    "channels of animations that cannot be read",
    "keys of animations that cannot be used"};

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

static void leave_out(void *ctx, const pbs_err *err) {
    pbs_scene_writer *s = ctx;
    s->totals.skipped[PBS_SKIP_FAILED]++;
    s->options.failed(s->options.failed_ctx, err);
}

static pbs_code miss_texture(void *ctx, const char *name, uint32_t *id, pbs_err *err) {
    pbs_scene_writer *s = ctx;
    *id = PBS_NONE;
    if (s->options.ignore_missing) {
        s->totals.skipped[PBS_SKIP_TEXTURE]++;
        return PBS_OK;
    }
    pbs_err why;
    pbs_fail(&why, PBS_DATA, "%s: is missing (--ignore-missing goes on without)", name);
    if (!s->options.failed) return pbs_fail(err, PBS_DATA, "%s", why.text);
    leave_out(s, &why);
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

/* ---- motions ---- */

static pbs_code put_animation(void *ctx, const char *name, uint32_t *id, pbs_err *err) {
    pbs_scene_writer *s = ctx;
    *id = s->animations++;
    s->totals.animations++;
    return pbs_animation_write(s->w, *id, name, err);
}

/* Equal ones are one; a node's id counts from 0, a motion's from 1. */
static pbs_code put_motion(void *ctx, const pbs_motion *motion, uint32_t *id, pbs_err *err) {
    pbs_scene_writer *s = ctx;
    pbs_known_node known = {0};
    uint8_t *bytes;
    pbs_piece piece;
    bool found = false;
    pbs_code rc = pbs_motion_pack(s->run, motion, &bytes, &piece.size, err);
    if (rc) return rc;
    piece.bytes = bytes;
    pbs_chunk c = {.tag = PBS_TAG_MOTION, .node = (uint32_t)s->motions.count, .count = 1};
    pbs_digest_add(&known.digest, bytes, piece.size);
    rc = pbs_known_find(&s->motions, &known.digest, NULL, &found, id, err);
    if (!rc && !found) rc = pbs_known_add(&s->motions, &known, err);
    if (!rc && !found) rc = pbs_writer_chunk(s->w, &c, &piece, 1, err);
    *id = (found ? *id : c.node) + 1;
    s->totals.motions += !rc && !found;
    pbs_free(s->run, bytes);
    return rc;
}

/* ---- nodes ---- */

/* What nodes are told apart by: their kind, and whether they have a name. Nodes with names are
 * never one with nodes without, which would show a name that they do not have. */
static pbs_digest begin_digest(char kind, const char *name) {
    pbs_digest d = {{0, 0}};
    const char head[2] = {kind, name && *name};
    pbs_digest_add(&d, head, sizeof head);
    return d;
}

static pbs_code add_node(pbs_scene_writer *s, pbs_node *n, const pbs_extent *extent,
                         const pbs_digest *digest, uint32_t *id, pbs_err *err) {
    pbs_known_node known = {n->triangles, *extent, *digest, pbs_digest_text(n->name)};
    n->box = extent->box;
    *id = n->id;
    pbs_code rc = pbs_known_add(&s->known, &known, err);
    return rc ? rc : pbs_node_write(s->run, s->w, n, err);
}

/* ---- parts ---- */

static pbs_code part_begin(void *ctx, const char *name, const double origin[3], uint32_t corners,
                           pbs_err *err) {
    pbs_scene_writer *s = ctx;
    free(s->part_name);
    if (!(s->part_name = strdup(name ? name : ""))) return pbs_fail(err, PBS_LIMIT, "no memory");
    for (int k = 0; k < 3; k++) s->part_origin[k] = isfinite(origin[k]) ? origin[k] : 0;
    s->part_corners = corners;
    pbs_meshlist_clear(&s->meshes);
    pbs_builder_begin(s->builder, s->part_origin, corners);
    return PBS_OK;
}

static pbs_code triangle(void *ctx, const pbs_corner corner[3], uint32_t material, pbs_err *err) {
    pbs_scene_writer *s = ctx;
    return pbs_builder_triangle(s->builder, corner, material, err);
}

pbs_code pbs_scene_stored(pbs_scene_writer *s, const pbs_vertex *corner, uint32_t material,
                          pbs_err *err) {
    return pbs_builder_stored(s->builder, corner, material, err);
}

static pbs_code write_meshes(pbs_scene_writer *s, uint32_t node, pbs_err *err) {
    pbs_mesh m;
    pbs_piece piece;
    uint64_t first = 0;
    pbs_code rc = PBS_OK;
    for (uint64_t at = 0; !rc && pbs_meshlist_next(&s->meshes, &at, &m, &piece.bytes, &piece.size);
         first += m.triangles) {
        pbs_chunk c = {
            .tag = PBS_TAG_MESH, .node = node, .count = m.triangles, .first = (uint32_t)first};
        rc = pbs_run_check(s->run, err);
        if (!rc) rc = pbs_writer_chunk(s->w, &c, &piece, 1, err);
    }
    return rc;
}

/* The meshes in the list become a node, unless one of the same bytes is there. */
static pbs_code put_part(pbs_scene_writer *s, const char *name, const pbs_box *box, uint32_t *id,
                         pbs_err *err) {
    pbs_digest d = begin_digest('P', name);
    bool found;
    pbs_digest_add(&d, s->part_origin, sizeof s->part_origin);
    pbs_digest_add(&d, &s->meshes.digest, sizeof s->meshes.digest);
    pbs_code rc = pbs_known_find(&s->known, &d, name, &found, id, err);
    s->totals.parts_unified += found;
    if (rc || found) return rc;
    pbs_node n = {.id = (uint32_t)s->known.count, .name = name};
    pbs_extent extent = pbs_extent_of(box);
    n.triangles = n.records = s->meshes.triangles;
    memcpy(n.origin, s->part_origin, sizeof n.origin);
    s->totals.stored += n.triangles;
    rc = write_meshes(s, n.id, err);
    return rc ? rc : add_node(s, &n, &extent, &d, id, err);
}

static pbs_code put_leaf(void *ctx, const pbs_leaf *leaf, uint32_t *id, pbs_err *err) {
    pbs_scene_writer *s = ctx;
    pbs_vertex v[3];
    uint32_t material;
    uint64_t triangles;
    pbs_box box;
    pbs_code rc = PBS_OK;
    pbs_meshlist_clear(&s->meshes);
    pbs_builder_begin(s->builder, s->part_origin, leaf->corners);
    for (uint64_t i = 0; i < leaf->count && !rc; i++) {
        pbs_leaf_get(leaf, i, v, &material);
        rc = pbs_builder_stored(s->builder, v, material, err);
    }
    if (!rc) rc = pbs_builder_end(s->builder, &triangles, &box, err);
    if (!rc) rc = pbs_meshlist_end(&s->meshes, err);
    return rc ? rc : put_part(s, "", &box, id, err);
}

static pbs_code put_assembly(pbs_scene_writer *s, const char *name, pbs_child *child, size_t count,
                             bool group, uint32_t *id, pbs_err *err);

static pbs_child at_home(uint32_t node) {
    pbs_child c = {.node = node};
    memcpy(c.m, PBS_IDENTITY, sizeof c.m);
    return c;
}

static pbs_code put_cell(void *ctx, const uint32_t *node, size_t n, bool whole, uint32_t *id,
                         pbs_err *err) {
    pbs_scene_writer *s = ctx;
    pbs_child child[8];
    for (size_t i = 0; i < n; i++) child[i] = at_home(node[i]);
    return put_assembly(s, whole ? s->part_name : "", child, n, false, id, err);
}

static pbs_code part_end(void *ctx, uint32_t *id, pbs_err *err) {
    pbs_scene_writer *s = ctx;
    uint64_t triangles;
    pbs_box box;
    bool split = false;
    pbs_code rc = pbs_builder_end(s->builder, &triangles, &box, err);
    if (!rc) rc = pbs_meshlist_end(&s->meshes, err);
    if (!rc && s->options.split && triangles > s->options.split) {
        pbs_split how = {s->run, s->options.split, s->part_corners, s, put_leaf, put_cell};
        rc = pbs_split_part(&how, &s->meshes, &split, id, err);
        s->totals.parts_split += split;
    }
    if (!rc && !split) rc = put_part(s, s->part_name, &box, id, err);
    pbs_meshlist_clear(&s->meshes);
    return rc;
}

/* ---- assemblies ---- */

static bool is_finite_transform(const double m[12]) {
    for (int i = 0; i < 12; i++)
        if (!isfinite(m[i])) return false;
    return true;
}

static pbs_digest assembly_digest(const char *name, const pbs_child *child, size_t count) {
    pbs_digest d = begin_digest('A', name);
    for (size_t i = 0; i < count; i++) {
        const pbs_child *c = &child[i];
        struct {
            double m[12];
            uint64_t name;
            uint32_t node, flags;
            uint64_t motion;
        } all = {.name = pbs_digest_text(c->name),
                 .node = c->node,
                 .flags = c->flags,
                 .motion = c->motion};
        memcpy(all.m, c->m, sizeof all.m);
        pbs_digest_add(&d, &all, sizeof all);
    }
    return d;
}

/* Writes the node: children are final. */
static pbs_code write_assembly(pbs_scene_writer *s, const char *name, pbs_child *child,
                               size_t count, const pbs_digest *d, uint32_t *id, pbs_err *err) {
    pbs_node n = {.id = (uint32_t)s->known.count, .name = name};
    pbs_extent all = PBS_EXTENT_EMPTY;
    n.children = child;
    n.child_count = (uint32_t)count;
    for (size_t i = 0; i < count; i++) {
        const pbs_known_node *b = &s->known.node[child[i].node];
        pbs_extent placed = pbs_extent_place(child[i].m, &b->extent);
        pbs_extent_join(&all, &placed);
        if (__builtin_add_overflow(n.triangles, b->triangles, &n.triangles))
            n.triangles = UINT64_MAX;
    }
    return add_node(s, &n, &all, d, id, err);
}

typedef struct grouped {
    pbs_scene_writer *s;
    const pbs_child *child;
    size_t count;
    uint32_t *group; /* their nodes */
    size_t groups, room;
} grouped;

/* The children that the numbers mean. */
static pbs_code gather(const grouped *g, const uint32_t *ref, size_t n, pbs_child **out,
                       pbs_err *err) {
    pbs_code rc = pbs_alloc(g->s->run, out, n, sizeof **out, "an assembly's children", err);
    for (size_t i = 0; i < n && !rc; i++)
        (*out)[i] = ref[i] < g->count ? g->child[ref[i]] : at_home(g->group[ref[i] - g->count]);
    return rc;
}

static pbs_code make_group(void *ctx, const uint32_t *ref, size_t n, pbs_err *err) {
    grouped *g = ctx;
    pbs_scene_writer *s = g->s;
    pbs_child *child;
    pbs_code rc = pbs_grow(s->run, &g->group, &g->room, g->groups + 1, sizeof *g->group,
                           "groups of children", err);
    if (!rc) rc = gather(g, ref, n, &child, err);
    if (rc) return rc;
    size_t before = s->known.count;
    rc = put_assembly(s, "", child, n, false, &g->group[g->groups++], err);
    s->totals.groups += s->known.count - before;
    pbs_free(s->run, child);
    return rc;
}

/* What the children of a flat list look like from where they are placed. */
static pbs_code measure(pbs_scene_writer *s, const pbs_child *child, size_t count,
                        pbs_group_item **item, pbs_err *err) {
    pbs_code rc = pbs_alloc(s->run, item, count, sizeof **item, "groups of children", err);
    for (size_t i = 0; i < count && !rc; i++) {
        const pbs_known_node *b = &s->known.node[child[i].node];
        (*item)[i] = (pbs_group_item){pbs_extent_place(child[i].m, &b->extent).box, b->triangles,
                                      child[i].flags & PBS_CHILD_MOVES};
    }
    return rc;
}

static pbs_code write_grouped(pbs_scene_writer *s, const char *name, const pbs_child *child,
                              size_t count, const pbs_digest *d, uint32_t *id, pbs_err *err) {
    grouped g = {.s = s, .child = child, .count = count};
    pbs_grouping how = {NULL, (uint32_t)count, s->options.group, &g, make_group};
    pbs_group_item *item;
    uint32_t *top = NULL;
    size_t n = 0;
    pbs_code rc = measure(s, child, count, &item, err);
    how.item = item;
    if (!rc) rc = pbs_group(s->run, &how, &top, &n, err);
    pbs_free(s->run, item);
    pbs_child *final = NULL;
    if (!rc) rc = gather(&g, top, n, &final, err);
    if (!rc) rc = write_assembly(s, name, final, n, d, id, err);
    pbs_free(s->run, final);
    pbs_free(s->run, top);
    pbs_free(s->run, g.group);
    return rc;
}

/* children: nodes, not aliases, and finite. */
static pbs_code put_assembly(pbs_scene_writer *s, const char *name, pbs_child *child, size_t count,
                             bool group, uint32_t *id, pbs_err *err) {
    pbs_digest d = assembly_digest(name, child, count);
    bool found;
    pbs_code rc = pbs_known_find(&s->known, &d, name, &found, id, err);
    s->totals.assemblies_unified += found;
    if (rc || found) return rc;
    if (group && s->options.group && count > s->options.group)
        return write_grouped(s, name, child, count, &d, id, err);
    return write_assembly(s, name, child, count, &d, id, err);
}

/* Copies what can be placed. A child that has no name of its own gets the one that its node had
 * before it was found to be equal to another. */
static pbs_code keep(pbs_scene_writer *s, const pbs_child *child, size_t count, pbs_child *kept,
                     size_t *n, pbs_err *err) {
    *n = 0;
    for (size_t i = 0; i < count; i++) {
        pbs_child c = child[i];
        const char *name;
        if (!pbs_known_resolve(&s->known, child[i].node, &c.node, &name))
            return pbs_fail(err, PBS_INTERNAL, "a child comes after its assembly");
        if (!is_finite_transform(c.m)) {
            s->totals.skipped[PBS_SKIP_TRANSFORM]++;
            continue;
        }
        if (!c.name || !*c.name) c.name = *name ? name : NULL;
        kept[(*n)++] = c;
    }
    return PBS_OK;
}

static pbs_code assembly(void *ctx, const char *name, const pbs_child *children, size_t count,
                         uint32_t *id, pbs_err *err) {
    pbs_scene_writer *s = ctx;
    pbs_child *kept;
    if (count >= UINT32_MAX / 2) return pbs_fail(err, PBS_LIMIT, "too many children");
    pbs_code rc = pbs_alloc(s->run, &kept, count, sizeof *kept, "an assembly's children", err);
    if (rc) return rc;
    rc = keep(s, children, count, kept, &count, err);
    if (!rc) rc = put_assembly(s, name, kept, count, true, id, err);
    pbs_free(s->run, kept);
    return rc;
}

static pbs_code root(void *ctx, uint32_t id, pbs_err *err) {
    pbs_scene_writer *s = ctx;
    pbs_child child = at_home(id);
    size_t n;
    pbs_code rc = keep(s, &child, 1, &child, &n, err);
    if (rc) return rc;
    /* The root is the last node by the format's rule; others may have been written behind it, or
     * it is one with an inner node. */
    s->root = child.node;
    if (id == child.node && id + 1 == s->known.count) return PBS_OK;
    pbs_digest d = assembly_digest("", &child, 1);
    return write_assembly(s, "", &child, 1, &d, &s->root, err);
}

static void skip(void *ctx, pbs_skip kind, uint64_t count) {
    pbs_scene_writer *s = ctx;
    s->totals.skipped[kind] += count;
}

/* How much of a part waits in memory for its end. */
static size_t part_budget(const pbs_run *run) {
    size_t n = pbs_mem_left(run) / 8;
    return n > (size_t)64 << 20 ? (size_t)64 << 20 : n;
}

pbs_code pbs_scene_writer_new(pbs_run *run, pbs_writer *w, const pbs_scene_options *options,
                              pbs_scene_writer **out, pbs_err *err) {
    pbs_scene_writer *s = *out = calloc(1, sizeof *s);
    if (!s) return pbs_fail(err, PBS_LIMIT, "no memory");
    s->run = s->known.run = s->motions.run = s->meshes.run = run;
    s->w = w;
    s->root = PBS_NONE;
    s->options = options ? *options : PBS_SCENE_DEFAULTS;
    s->sink = (pbs_sink){s,
                         run,
                         put_texture,
                         miss_texture,
                         put_material,
                         part_begin,
                         triangle,
                         part_end,
                         assembly,
                         root,
                         skip,
                         false,
                         s->options.failed ? leave_out : NULL,
                         put_animation,
                         put_motion};
    pbs_mesh_out to = {&s->meshes, pbs_meshlist_add};
    pbs_code rc = pbs_builder_new(run, to, &s->builder, err);
    s->meshes.budget = part_budget(run);
    if (!rc) return PBS_OK;
    pbs_scene_writer_free(s);
    *out = NULL;
    return rc;
}

const pbs_sink *pbs_scene_sink(pbs_scene_writer *s) {
    return &s->sink;
}

pbs_code pbs_scene_writer_end(pbs_scene_writer *s, pbs_err *err) {
    const uint64_t *skipped = s->totals.skipped;
    pbs_builder_skips(s->builder, s->totals.skipped);
    if (s->root == PBS_NONE || !s->known.node[s->root].triangles) {
        uint64_t bad = skipped[PBS_SKIP_NONFINITE] + skipped[PBS_SKIP_DEGENERATE];
        return pbs_fail(err, PBS_DATA, "no triangles in it%s",
                        bad ? " but such without area or with NaN" : "");
    }
    s->totals.nodes = s->known.count;
    s->totals.triangles = s->known.node[s->root].triangles;
    uint8_t buf[8 * PBS_SKIP_KINDS];
    /* What animations lack costs no byte where nothing moves. */
    uint32_t n = PBS_SKIP_KINDS;
    while (n > PBS_SKIP_CHANNEL && !skipped[n - 1]) n--;
    for (uint32_t i = 0; i < n; i++) pbs_put_u64(buf + 8 * i, skipped[i]);
    pbs_chunk c = {.tag = PBS_TAG_COUNTS, .node = PBS_NONE, .count = n};
    pbs_piece piece = {buf, 8 * n};
    return pbs_writer_chunk(s->w, &c, &piece, 1, err);
}

pbs_scene_totals pbs_scene_writer_totals(const pbs_scene_writer *s) {
    return s->totals;
}

void pbs_scene_writer_free(pbs_scene_writer *s) {
    if (!s) return;
    pbs_builder_free(s->builder);
    pbs_meshlist_free(&s->meshes);
    pbs_known_free(&s->known);
    pbs_known_free(&s->motions);
    free(s->part_name);
    free(s);
}
