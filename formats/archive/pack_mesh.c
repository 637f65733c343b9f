/* pack_mesh.c: the meshes of a node, whose materials have other numbers in the archive, and whose
 * node may have another origin; and, if that is asked for, on lattices. */
#include "formats/scene/meshbits.h"
#include "formats/scene/meshbuild.h"
#include "formats/archive/pack_inner.h"
#include "formats/container/wire.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MATERIAL_AT = 12 }; /* of a MESH chunk */

/* ---- lattices ---- */

/* The pieces of a part that was split have its origin, and share corners: they get one step, that
 * of the largest. */
typedef struct piece {
    double origin[3], side;
    size_t entry;
} piece;

static const pbs_node *source_of(const pack_entry *e) {
    return e->mesh_node ? e->mesh_node : &e->node;
}

static double longest_side(const pbs_box *b) {
    if (pbs_box_is_empty(b)) return 0;
    return fmax(b->max[0] - b->min[0], fmax(b->max[1] - b->min[1], b->max[2] - b->min[2]));
}

static int by_origin(const void *a, const void *b) {
    return memcmp(((const piece *)a)->origin, ((const piece *)b)->origin,
                  sizeof((const piece *)a)->origin);
}

static void share_step(pack_entry *entries, const piece *first, size_t n, unsigned bits) {
    double side = 0;
    for (size_t i = 0; i < n; i++) side = fmax(side, first[i].side);
    int exponent = pbs_mesh_exponent(side, bits);
    for (size_t i = 0; i < n; i++) entries[first[i].entry].mesh_exponent = exponent;
}

pbs_code pack_choose_steps(pbs_pack *p, pbs_err *err) {
    piece *all;
    size_t n = 0;
    if (!p->mesh_bits) return PBS_OK;
    pbs_code rc = pbs_alloc(p->run, &all, p->entry_count, sizeof *all, "the lattices", err);
    for (size_t i = 0; i < p->entry_count && !rc; i++) {
        pack_entry *e = &p->entries[i];
        e->mesh_exponent = PBS_MESH_EXACT;
        if (!pack_mesh_chunks(e)) continue;
        /* Cells are all of one size, so their chunks have one lattice. */
        if (e->voxels.voxels)
            e->mesh_exponent = pbs_mesh_exponent(e->node.lattice * PBS_CHUNK, p->mesh_bits);
        else
            memcpy(all[n].origin, source_of(e)->origin, sizeof all->origin),
                all[n].side = longest_side(&source_of(e)->box), all[n++].entry = i;
    }
    if (rc) return rc;
    qsort(all, n, sizeof *all, by_origin);
    for (size_t i = 0, end; i < n; i = end) {
        for (end = i + 1; end < n && !by_origin(&all[i], &all[end]);) end++;
        share_step(p->entries, all + i, end - i, p->mesh_bits);
    }
    pbs_free(p->run, all);
    return PBS_OK;
}

/* ---- payloads ---- */

uint64_t pack_mesh_chunks(const pack_entry *e) {
    uint64_t n = 0;
    for (size_t i = 0; i < e->mesh_count; i++) n += e->mesh[i].tag == PBS_TAG_MESH;
    return n;
}

static uint32_t renumbered(const pack_input *in, uint32_t material) {
    return material < in->materials ? in->material[material] : PBS_NONE;
}

static bool keeps_materials(const pack_input *in) {
    for (uint32_t i = 0; i < in->materials; i++)
        if (in->material[i] != i) return false;
    return true;
}

static void move_vertices(uint8_t *at, uint32_t vertices, const double shift[3]) {
    for (uint32_t i = 0; i < vertices; i++)
        for (int k = 0; k < 3; k++, at += 4)
            pbs_put_f32(at, (float)(pbs_get_f32(at) + shift[k]) + 0.0f);
}

/* The mesh's payload with the archive's materials, in the packer's buffer. */
static pbs_code copy_mesh(pbs_pack *p, const pack_entry *e, const pbs_chunk *c, pbs_mesh *m,
                          pbs_err *err) {
    const pack_input *in = &p->inputs[e->mesh_input];
    pbs_code rc = pbs_mesh_parse(pbs_reader_name(e->mesh_reader), c, m, err);
    if (!rc)
        rc = pbs_grow(p->run, &p->payload, &p->payload_cap, (size_t)c->bytes, 1, "a mesh", err);
    if (rc) return rc;
    memcpy(p->payload, c->payload, (size_t)c->bytes);
    pbs_put_u32(p->payload + MATERIAL_AT, renumbered(in, m->material));
    if (!m->triangle_material) return PBS_OK;
    size_t at = (size_t)((const uint8_t *)m->triangle_material - (const uint8_t *)c->payload);
    for (uint32_t i = 0; i < m->triangles; i++)
        pbs_put_u32(p->payload + at + 4 * (size_t)i, renumbered(in, m->triangle_material[i]));
    return PBS_OK;
}

/* *snapped: on its lattice, from pbs_alloc; NULL: it has none, and the buffer is it. */
static pbs_code change(pbs_pack *p, const pack_entry *e, pbs_chunk *c, uint8_t **snapped,
                       pbs_err *err) {
    pbs_mesh m;
    size_t size;
    uint32_t flat;
    *snapped = NULL;
    pbs_code rc = copy_mesh(p, e, c, &m, err);
    if (!rc && p->mesh_bits) {
        pbs_mesh_snap how = {.exponent = e->mesh_exponent};
        memcpy(how.from, source_of(e)->origin, sizeof how.from);
        memcpy(how.to, e->node.origin, sizeof how.to);
        rc = pbs_mesh_snap_to(p->run, &how, p->payload, snapped, &size, &flat, err);
    }
    if (rc) return rc;
    c->payload = p->payload;
    if (!*snapped) {
        pbs_mesh_view(p->payload, &m);
        move_vertices((uint8_t *)m.position, m.vertices, e->shift);
        return PBS_OK;
    }
    c->payload = *snapped;
    c->bytes = size;
    c->count -= flat;
    c->flags |= pbs_mesh_flags(e->mesh_exponent);
    p->stats.flat += flat;
    p->stats.mesh_bound = fmax(p->stats.mesh_bound, sqrt(3) / 2 * ldexp(1, e->mesh_exponent));
    return PBS_OK;
}

pbs_code pack_write_meshes(pbs_pack *p, const pack_entry *e, pbs_err *err) {
    if (e->mesh_input == PACK_NOWHERE) return PBS_OK;
    bool same = !p->mesh_bits && keeps_materials(&p->inputs[e->mesh_input]) && e->shift[0] == 0 &&
                e->shift[1] == 0 && e->shift[2] == 0;
    uint64_t first = 0;
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < e->mesh_count && !rc; i++) {
        pbs_chunk c = {0};
        uint8_t *snapped = NULL;
        if (e->mesh[i].tag != PBS_TAG_MESH) continue;
        rc = pbs_reader_at(e->mesh_reader, &e->mesh[i], &c, err);
        if (!rc && !same) rc = change(p, e, &c, &snapped, err);
        pbs_piece whole = {c.payload, (size_t)c.bytes};
        c.node = e->number;
        c.first = (uint32_t)first;
        first += c.count;
        if (!rc) rc = pbs_writer_chunk(p->w, &c, &whole, 1, err);
        pbs_free(p->run, snapped);
        p->stats.meshes++;
        p->stats.triangles += c.count;
    }
    return rc;
}
