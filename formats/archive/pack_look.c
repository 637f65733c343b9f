/* pack_look.c: materials and textures of all inputs: numbered anew, equal ones once, and textures
 * only that are shown. */
#include "formats/archive/pack_inner.h"
#include "formats/scene/scene_wire.h"
#include "formats/container/wire.h"
#include <string.h>

/* A list of what is written, with the hash table that finds equals. */
typedef struct shelf {
    pbs_pack *p;
    pbs_known known;
    pack_look **list;
    size_t *count, *cap;
} shelf;

enum { USES = 3 }; /* textures that a material may use */

static uint8_t *texture_at(uint8_t *payload, int use) {
    return payload + MATERIAL_USES_AT + use * USE_FIXED;
}

/* The material with its textures' numbers in the archive; those that do not come along are none. */
static pbs_code renumbered(const pbs_pack *p, int input, const pbs_chunk *c, uint8_t **out,
                           pbs_err *err) {
    const pack_input *in = &p->inputs[input];
    pbs_material parsed;
    if (!pbs_material_parse(c, PBS_NONE, &parsed))
        return pbs_fail(err, PBS_DATA, "%s: material %u is damaged", pbs_reader_name(in->reader),
                        c->node);
    pbs_code rc = pbs_alloc(p->run, out, (size_t)c->bytes, 1, "a material", err);
    if (rc) return rc;
    memcpy(*out, c->payload, (size_t)c->bytes);
    for (int i = 0; i < USES; i++) {
        uint32_t texture = pbs_get_u32(texture_at(*out, i));
        pbs_put_u32(texture_at(*out, i), texture < in->textures ? in->texture[texture] : PBS_NONE);
    }
    return PBS_OK;
}

/* Its bytes as they will be: *own is to be freed, NULL if they are the chunk's. */
static pbs_code final_bytes(const pbs_pack *p, const pack_look *l, const void **bytes, size_t *n,
                            uint8_t **own, pbs_err *err) {
    pbs_chunk c;
    *own = NULL;
    pbs_code rc = pbs_reader_at(l->reader, l->chunk, &c, err);
    if (!rc && c.tag == PBS_TAG_MATERIAL) rc = renumbered(p, l->input, &c, own, err);
    *bytes = *own ? *own : c.payload;
    *n = rc ? 0 : (size_t)c.bytes;
    return rc;
}

/* Of a texture the picture counts, and not what its file was called. */
static void leave_name(const pack_look *l, const void **bytes, size_t *n) {
    const uint8_t *p = *bytes;
    if (l->chunk->tag != PBS_TAG_TEXTURE || *n < TEXTURE_FIXED) return;
    size_t skip = pbs_get_u32(p) < *n - TEXTURE_FIXED ? TEXTURE_FIXED + pbs_get_u32(p) : *n;
    *bytes = p + skip;
    *n -= skip;
}

static pbs_code is_equal(const shelf *s, uint32_t other, const void *bytes, size_t n, bool *equal,
                         pbs_err *err) {
    const void *there;
    size_t size;
    uint8_t *own;
    const pack_look *l = &(*s->list)[other];
    pbs_code rc = final_bytes(s->p, l, &there, &size, &own, err);
    if (!rc) leave_name(l, &there, &size);
    *equal = !rc && size == n && !memcmp(there, bytes, n);
    pbs_free(s->p->run, own);
    return rc;
}

/* The number that a chunk has in the archive. */
static pbs_code shelve(shelf *s, pack_look look, uint32_t *number, pbs_err *err) {
    const void *bytes;
    size_t n;
    uint8_t *own;
    bool found = false;
    pbs_code rc = final_bytes(s->p, &look, &bytes, &n, &own, err);
    if (rc) return rc;
    leave_name(&look, &bytes, &n);
    pbs_known_node node = {0};
    pbs_digest_add(&node.digest, bytes, n);
    rc = pbs_known_find(&s->known, &node.digest, NULL, &found, number, err);
    if (!rc && found) rc = is_equal(s, *number, bytes, n, &found, err);
    pbs_free(s->p->run, own);
    if (rc || found) return rc;
    *number = (uint32_t)*s->count;
    rc = pbs_known_add(&s->known, &node, err);
    if (!rc)
        rc = pbs_grow(s->p->run, s->list, s->cap, *s->count + 1, sizeof **s->list,
                      "the list of materials", err);
    if (!rc) (*s->list)[(*s->count)++] = look;
    return rc;
}

static uint32_t count_tag(const pack_input *in, uint32_t tag) {
    uint32_t n = 0;
    for (size_t i = 0; i < in->entry_count; i++) n += in->entries[i].tag == tag;
    return n;
}

/* A stream of voxels has its scene's materials, but not the textures: there they are known. */
static bool is_scenes(const pbs_pack *p, const pack_input *in, const pbs_chunk *entry, uint32_t i,
                      uint32_t *number) {
    const pack_input *scene = in->made_from == PACK_NOWHERE ? NULL : &p->inputs[in->made_from];
    if (!scene || entry->tag != PBS_TAG_MATERIAL || i >= scene->materials) return false;
    const pack_look *l = &p->materials[scene->material[i]];
    const void *there = pbs_reader_peek(l->reader, l->chunk);
    const void *here = pbs_reader_peek(in->reader, entry);
    *number = scene->material[i];
    return l->chunk->bytes == entry->bytes && there && here &&
           !memcmp(there, here, (size_t)entry->bytes);
}

/* ---- which textures are needed ---- */

static void need_use(uint8_t *needed, uint32_t textures, const pbs_texture_use *use) {
    if (use->texture < textures) needed[use->texture] = 1;
}

/* Those of a material that a triangle has which knows its place in them. */
static void need_material(const pbs_scene *scene, uint32_t material, uint8_t *needed) {
    uint32_t n = (uint32_t)scene->texture_count;
    if (material >= scene->material_count) return;
    const pbs_material *m = &scene->materials[material];
    need_use(needed, n, &m->base_texture);
    need_use(needed, n, &m->material_texture);
    need_use(needed, n, &m->emissive_texture);
}

/* One for each texture of the input: whether a triangle shows it. Streams have none. */
static pbs_code find_needed(const pbs_pack *p, const pack_input *in, uint32_t textures,
                            uint8_t **needed, pbs_err *err) {
    const pbs_scene *scene = &in->scene;
    pbs_code rc = pbs_alloc(p->run, needed, textures, 1, "the list of textures", err);
    if (rc || !textures) return rc;
    memset(*needed, in->kind != PACK_SCENE, textures);
    for (size_t i = 0; i < scene->mesh_count && in->kind == PACK_SCENE; i++) {
        const pbs_mesh *m = &scene->meshes[i];
        if (!m->uv) continue;
        if (!m->triangle_material) need_material(scene, m->material, *needed);
        for (uint32_t k = 0; k < m->triangles && m->triangle_material; k++)
            need_material(scene, m->triangle_material[k], *needed);
    }
    return PBS_OK;
}

/* needed: NULL: all of them. */
static pbs_code number_tag(shelf *s, int input, uint32_t tag, const uint8_t *needed, uint32_t **map,
                           uint32_t *count, pbs_err *err) {
    const pack_input *in = &s->p->inputs[input];
    uint32_t n = count_tag(in, tag), at = 0;
    pbs_code rc = pbs_alloc(s->p->run, map, n, sizeof **map, "the list of materials", err);
    for (size_t i = 0; i < in->entry_count && !rc; i++) {
        const pbs_chunk *c = &in->entries[i];
        if (c->tag != tag) continue;
        if (c->node != at)
            return pbs_fail(err, PBS_DATA, "%s: materials are not in order",
                            pbs_reader_name(in->reader));
        (*map)[at] = PBS_NONE;
        if (needed && !needed[at]) {
            at++;
            continue;
        }
        if (!is_scenes(s->p, in, c, at, &(*map)[at]))
            rc = shelve(s, (pack_look){c, in->reader, input}, &(*map)[at], err);
        at++;
    }
    *count = rc ? 0 : n;
    return rc;
}

static pbs_code number_textures(shelf *s, int input, pbs_err *err) {
    pack_input *in = &s->p->inputs[input];
    uint8_t *needed;
    pbs_code rc = find_needed(s->p, in, count_tag(in, PBS_TAG_TEXTURE), &needed, err);
    if (!rc) rc = number_tag(s, input, PBS_TAG_TEXTURE, needed, &in->texture, &in->textures, err);
    pbs_free(s->p->run, needed);
    return rc;
}

/* Textures first, which materials name; then the materials of scenes, which others may share. */
pbs_code pack_look_number(pbs_pack *p, pbs_err *err) {
    shelf textures = {p, {.run = p->run}, &p->textures, &p->texture_count, &p->texture_cap};
    shelf materials = {p, {.run = p->run}, &p->materials, &p->material_count, &p->material_cap};
    pbs_code rc = PBS_OK;
    for (int i = 0; i < p->input_count && !rc; i++) rc = number_textures(&textures, i, err);
    for (int scenes = 1; scenes >= 0; scenes--)
        for (int i = 0; i < p->input_count && !rc; i++) {
            pack_input *in = &p->inputs[i];
            if ((in->kind == PACK_SCENE) == scenes)
                rc = number_tag(&materials, i, PBS_TAG_MATERIAL, NULL, &in->material,
                                &in->materials, err);
        }
    pbs_known_free(&textures.known);
    pbs_known_free(&materials.known);
    return rc;
}

static pbs_code write_list(pbs_pack *p, const pack_look *list, size_t count, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < count && !rc; i++) {
        pbs_piece piece;
        uint8_t *own;
        rc = final_bytes(p, &list[i], &piece.bytes, &piece.size, &own, err);
        pbs_chunk c = {
            .tag = list[i].chunk->tag, .node = (uint32_t)i, .count = list[i].chunk->count};
        if (!rc) rc = pbs_writer_chunk(p->w, &c, &piece, 1, err);
        pbs_free(p->run, own);
    }
    return rc;
}

pbs_code pack_write_materials(pbs_pack *p, pbs_err *err) {
    return write_list(p, p->materials, p->material_count, err);
}

pbs_code pack_write_textures(pbs_pack *p, pbs_err *err) {
    return write_list(p, p->textures, p->texture_count, err);
}
