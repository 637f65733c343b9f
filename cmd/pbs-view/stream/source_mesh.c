/* source_mesh.c: meshes of an archive as they lie in the GPU's memory: the triangles of a chunk are
 * sorted so that each textured material is one draw, and all without textures are one. */
#include "cmd/pbs-view/stream/source.h"
#include <stdlib.h>
#include <string.h>

void pbs_source_free_mesh(pbs_run *run, pbs_node_mesh *m) {
    if (!m) return;
    pbs_free(run, m->parts);
    pbs_free(run, m->textures);
    pbs_free(run, m);
}

void pbs_source_look(const pbs_source *s, const pbs_material *m, uint32_t item[3]) {
    const pbs_texture_use *use[3] = {&m->base_texture, &m->material_texture, &m->emissive_texture};
    for (int i = 0; i < 3; i++)
        item[i] = use[i]->texture < s->archive->texture_count
                      ? pbs_source_texture(s, use[i]->texture, i != 1)
                      : PBS_NONE;
}

/* The material, if it has textures. */
static uint32_t look_of(const pbs_source *s, uint32_t material) {
    uint32_t item[3];
    if (material >= s->archive->material_count) return PBS_NONE;
    pbs_source_look(s, &s->archive->materials[material], item);
    return item[0] == PBS_NONE && item[1] == PBS_NONE && item[2] == PBS_NONE ? PBS_NONE : material;
}

uint64_t pbs_source_mesh_part(const pbs_source *s, uint32_t node, size_t *next) {
    size_t n;
    uint64_t sum = 0;
    const uint32_t *list = pbs_archive_list(s->archive, node, PBS_SORT_MESHES, &n);
    for (bool first = true; *next < n; ++*next, first = false) {
        uint64_t more = pbs_source_rounded(pbs_archive_bytes(s->archive, list[*next]));
        if (!first && sum + more > s->largest) break;
        sum += more;
    }
    return sum;
}

static int64_t place_of(const pbs_fetched *f, const void *array, uint64_t at) {
    return array ? (int64_t)at + ((const uint8_t *)array - (const uint8_t *)f->chunk.payload) : -1;
}

/* number, at: the part of the item, and where the chunk begins in it. */
static pbs_mesh_part part_of(const pbs_fetched *f, uint32_t number, uint64_t at) {
    const pbs_mesh *m = &f->mesh;
    return (pbs_mesh_part){.part = number,
                           .triangles = m->triangles,
                           .material = m->material,
                           .look = PBS_NONE,
                           .position = place_of(f, m->position, at),
                           .normal = place_of(f, m->normal, at),
                           .uv = place_of(f, m->uv, at),
                           .colour = place_of(f, m->colour, at),
                           .index = place_of(f, m->index, at),
                           .triangle_material = place_of(f, m->triangle_material, at)};
}

static pbs_code add_part(const pbs_source *s, pbs_node_mesh *n, const pbs_mesh_part *part,
                         pbs_err *err) {
    pbs_code rc = pbs_grow(s->run, &n->parts, &n->part_cap, n->part_count + 1, sizeof *n->parts,
                           "meshes", err);
    if (!rc) n->parts[n->part_count++] = *part;
    return rc;
}

/* The textures of a part to those of its node. */
static pbs_code add_look(const pbs_source *s, pbs_node_mesh *n, uint32_t look, pbs_err *err) {
    uint32_t item[3];
    pbs_code rc = PBS_OK;
    if (look == PBS_NONE) return PBS_OK;
    pbs_source_look(s, &s->archive->materials[look], item);
    for (int i = 0; i < 3 && !rc; i++) {
        size_t k = 0;
        while (k < n->texture_count && n->textures[k] != item[i]) k++;
        if (item[i] == PBS_NONE || k < n->texture_count) continue;
        rc = pbs_grow(s->run, &n->textures, &n->texture_cap, n->texture_count + 1,
                      sizeof *n->textures, "meshes", err);
        if (!rc) n->textures[n->texture_count++] = item[i];
    }
    return rc;
}

static int by_key(const void *a, const void *b) {
    uint64_t x, y;
    memcpy(&x, a, sizeof x);
    memcpy(&y, b, sizeof y);
    return (x > y) - (x < y);
}

/* In the item's copy of a mesh: triangle order[i] becomes triangle i. */
static void rearrange(const pbs_mesh *m, const uint64_t *order, uint16_t *index,
                      uint32_t *material) {
    for (uint32_t i = 0; i < m->triangles; i++) {
        uint32_t from = (uint32_t)order[i];
        memcpy(index + 3 * (size_t)i, m->index + 3 * (size_t)from, 3 * sizeof *index);
        material[i] = m->triangle_material[from];
    }
}

/* A mesh whose triangles have materials of their own, which is in its part, `to`, already. */
static pbs_code split(pbs_source *s, pbs_node_mesh *n, const pbs_fetched *f, pbs_mesh_part part,
                      uint8_t *to, pbs_err *err) {
    const pbs_mesh *m = &f->mesh;
    uint64_t *order;
    pbs_code rc = pbs_alloc(s->run, &order, m->triangles, sizeof *order, "triangle order", err);
    if (rc) return rc;
    for (uint32_t i = 0; i < m->triangles; i++)
        order[i] = (uint64_t)look_of(s, m->triangle_material[i]) << 32 | i;
    qsort(order, m->triangles, sizeof *order, by_key);
    rearrange(m, order, (uint16_t *)(void *)(to + part.index),
              (uint32_t *)(void *)(to + part.triangle_material));
    for (uint32_t i = 0; i < m->triangles && !rc; i += part.triangles) {
        part.first = i;
        part.look = (uint32_t)(order[i] >> 32);
        part.triangles = 1;
        while (i + part.triangles < m->triangles && order[i + part.triangles] >> 32 == part.look)
            part.triangles++;
        rc = add_part(s, n, &part, err);
        if (!rc) rc = add_look(s, n, part.look, err);
    }
    pbs_free(s->run, order);
    return rc;
}

/* to: the item's part. at: where the chunk begins in it. */
static pbs_code add_mesh(pbs_source *s, pbs_node_mesh *n, const pbs_fetched *f, uint32_t number,
                         uint64_t at, uint8_t *to, pbs_err *err) {
    pbs_mesh_part part = part_of(f, number, at);
    memcpy(to + at, f->chunk.payload, (size_t)f->chunk.bytes);
    bool looks = f->mesh.uv && s->archive->texture_count;
    if (looks && f->mesh.triangle_material) return split(s, n, f, part, to, err);
    if (looks) part.look = look_of(s, part.material);
    pbs_code rc = add_part(s, n, &part, err);
    return rc ? rc : add_look(s, n, part.look, err);
}

pbs_code pbs_source_load_mesh(pbs_source *s, uint32_t node, uint8_t *to, pbs_err *err) {
    const pbs_archive *a = s->archive;
    size_t n, next = 0;
    uint64_t at = 0, size = pbs_source_mesh_part(s, node, &next);
    uint32_t part = 0;
    const uint32_t *list = pbs_archive_list(a, node, PBS_SORT_MESHES, &n);
    pbs_code rc = PBS_OK;
    if (!s->mesh[node]) {
        rc = pbs_alloc(s->run, &s->mesh[node], 1, sizeof **s->mesh, "meshes", err);
        if (rc) return rc;
        *s->mesh[node] = (pbs_node_mesh){0};
    }
    s->mesh[node]->part_count = s->mesh[node]->texture_count = 0;
    for (size_t i = 0; i < n && !rc; i++) {
        pbs_fetched f;
        if (i == next) {
            to += size, at = 0, part++;
            size = pbs_source_mesh_part(s, node, &next);
        }
        rc = pbs_archive_fetch(a, list[i], &f, err);
        if (rc) break;
        rc = add_mesh(s, s->mesh[node], &f, part, at, to, err);
        at += pbs_source_rounded(pbs_archive_bytes(a, list[i]));
        pbs_archive_release(a, &f);
    }
    return rc;
}
