/* export_faces.c: the colours of single faces of voxels, from their attributes (export.h). */
#include "formats/export/export.h"
#include "formats/scene/scene.h"
#include "libcore/data/srgb.h"

/* As a voxel's colour is stored. */
static uint32_t colour_of(const float base[4]) {
    const pbs_srgb_table *t = pbs_srgb();
    uint8_t c[4];
    uint32_t word;
    for (int k = 0; k < 3; k++) c[k] = pbs_srgb_encode(t, base[k]);
    c[3] = 255;
    memcpy(&word, c, sizeof word);
    return word;
}

pbs_code pbs_export_palette(pbs_exporter *x, pbs_err *err) {
    size_t n = 0;
    for (size_t i = 0; i < x->entry_count; i++) n += x->entries[i].tag == PBS_TAG_MATERIAL;
    pbs_code rc = pbs_alloc(x->run, &x->palette, n, sizeof *x->palette, "the materials", err);
    for (size_t i = 0; i < x->entry_count && !rc; i++) {
        pbs_chunk c;
        pbs_material m;
        if (x->entries[i].tag != PBS_TAG_MATERIAL) continue;
        rc = pbs_reader_at(x->reader, &x->entries[i], &c, err);
        if (!rc && !pbs_material_parse(&c, PBS_NONE, &m))
            rc = pbs_fail(err, PBS_DATA, "%s: material %zu is damaged", x->name, x->palette_count);
        if (!rc) x->palette[x->palette_count++] = colour_of(m.base);
    }
    return rc;
}

/* Numbers of materials become their colours. */
static void look_up(const pbs_exporter *x, uint32_t *face, size_t n) {
    const pbs_material none = PBS_MATERIAL_DEFAULT;
    uint32_t white = colour_of(none.base);
    for (size_t i = 0; i < n; i++)
        face[i] = face[i] < x->palette_count ? x->palette[face[i]] : white;
}

pbs_code pbs_export_faces(pbs_exporter *x, uint32_t node, pbs_err *err) {
    const pbs_export_data *d = &x->data[node];
    pbs_code rc = PBS_OK;
    x->face_count = 0;
    if (!x->o->faces) return PBS_OK;
    for (size_t at = d->first_face, i = 0; i < d->face_chunks && !rc; at++) {
        const pbs_chunk *e = &x->entries[at];
        pbs_chunk c;
        if (e->tag != PBS_TAG_FACES || e->node != node) continue;
        i++;
        rc = pbs_reader_read(x->reader, e, &c, err);
        if (!rc)
            rc = pbs_grow(x->run, &x->face, &x->face_cap, x->face_count + c.count, sizeof *x->face,
                          "the faces of a node", err);
        if (rc) return rc;
        if (c.bytes != 4 * (uint64_t)c.count || c.first != (uint32_t)x->face_count)
            return pbs_fail(err, PBS_DATA, "%s: faces of node %u do not fit it", x->name, node);
        uint32_t *to = x->face + x->face_count;
        if (c.count) memcpy(to, c.payload, (size_t)c.bytes);
        if (!(c.flags & PBS_VFAC_COLOUR)) look_up(x, to, c.count);
        x->face_count += c.count;
    }
    return rc;
}
