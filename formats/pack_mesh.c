/* pack_mesh.c: the meshes of a node, whose materials have other numbers in the archive, and whose
 * node may have another origin. */
#include "formats/meshbuild.h"
#include "formats/pack_inner.h"
#include "formats/wire.h"
#include <string.h>

enum { MATERIAL_AT = 12, POSITIONS_AT = 16 }; /* of a MESH chunk */

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

/* The mesh's payload as it will be, in the packer's buffer. */
static pbs_code change(pbs_pack *p, const pack_entry *e, const pbs_chunk *c, pbs_err *err) {
    const pack_input *in = &p->inputs[e->mesh_input];
    pbs_mesh m;
    pbs_code rc = pbs_mesh_parse(pbs_reader_name(e->mesh_reader), c, &m, err);
    if (!rc)
        rc = pbs_grow(p->run, &p->payload, &p->payload_cap, (size_t)c->bytes, 1, "a mesh", err);
    if (rc) return rc;
    memcpy(p->payload, c->payload, (size_t)c->bytes);
    pbs_put_u32(p->payload + MATERIAL_AT, renumbered(in, m.material));
    move_vertices(p->payload + POSITIONS_AT, m.vertices, e->shift);
    if (!m.triangle_material) return PBS_OK;
    size_t at = (size_t)((const uint8_t *)m.triangle_material - (const uint8_t *)c->payload);
    for (uint32_t i = 0; i < m.triangles; i++)
        pbs_put_u32(p->payload + at + 4 * (size_t)i, renumbered(in, m.triangle_material[i]));
    return PBS_OK;
}

pbs_code pack_write_meshes(pbs_pack *p, const pack_entry *e, pbs_err *err) {
    if (e->mesh_input == PACK_NOWHERE) return PBS_OK;
    bool same = keeps_materials(&p->inputs[e->mesh_input]) && e->shift[0] == 0 &&
                e->shift[1] == 0 && e->shift[2] == 0;
    uint64_t first = 0;
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < e->mesh_count && !rc; i++) {
        pbs_chunk c;
        if (e->mesh[i].tag != PBS_TAG_MESH) continue;
        rc = pbs_reader_at(e->mesh_reader, &e->mesh[i], &c, err);
        if (!rc && !same) rc = change(p, e, &c, err);
        pbs_piece piece = {same ? c.payload : p->payload, (size_t)c.bytes};
        c.node = e->number;
        c.first = (uint32_t)first;
        first += c.count;
        if (!rc) rc = pbs_writer_chunk(p->w, &c, &piece, 1, err);
        p->stats.meshes++;
        p->stats.triangles += c.count;
    }
    return rc;
}
