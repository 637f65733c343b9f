/* archive_fetch.c: the data of an archive, a chunk or a node at a time. Nothing here changes the
 * archive, so that any number of threads may read at once. */
#include "formats/archive/archive.h"
#include "formats/scene/meshbuild.h"
#include "formats/scene/scene.h"
#include <string.h>

uint64_t pbs_archive_bytes(const pbs_archive *a, uint32_t chunk) {
    const pbs_chunk *c = &a->chunks[chunk];
    pbs_chunk header;
    switch (c->tag) {
    case PBS_TAG_POINTS:
        return (uint64_t)c->count * a->record.stride;
    case PBS_TAG_OCTAVES:
        return (uint64_t)c->count * a->octave.stride;
    case PBS_TAG_VOXELS:
        return a->voxel_channels
                   ? PBS_VOXELS_HEADER + (uint64_t)c->count * pbs_voxels_stride(a->voxel_channels)
                   : 0;
    case PBS_TAG_FACES:
        return a->voxel_channels & PBS_FACE ? (uint64_t)c->count * 4 : 0;
    default: /* only the chunk itself knows */
        return !c->codec                                      ? c->bytes
               : pbs_reader_look(a->reader, c, &header, NULL) ? 0
                                                              : header.bytes;
    }
}

/* ---- one chunk ---- */

static pbs_code look_inside(const pbs_archive *a, pbs_fetched *f, pbs_err *err) {
    const pbs_chunk *c = &f->chunk;
    const char *name = pbs_reader_name(a->reader);
    if (c->tag == PBS_TAG_VOXELS)
        return pbs_voxels_view(name, a->voxel_channels, c, c->first, &f->place, &f->voxels, err);
    if (c->tag == PBS_TAG_TEXTURE && !pbs_texture_parse(c))
        return pbs_fail(err, PBS_DATA, "%s: texture %u is damaged", name, c->node);
    if (c->tag != PBS_TAG_MESH) return PBS_OK;
    pbs_code rc = pbs_mesh_parse(name, c, &f->mesh, err);
    if (!rc && !pbs_mesh_materials_fit(&f->mesh, a->material_count))
        rc = pbs_fail(err, PBS_DATA, "%s: a mesh of node %u: there is no such material", name,
                      c->node);
    return rc;
}

pbs_code pbs_archive_fetch(const pbs_archive *a, uint32_t chunk, pbs_fetched *out, pbs_err *err) {
    memset(out, 0, sizeof *out);
    pbs_code rc = pbs_reader_load(a->reader, &a->chunks[chunk], &out->chunk, &out->own, err);
    if (!rc && out->chunk.codec && out->chunk.bytes != pbs_archive_bytes(a, chunk))
        rc = pbs_fail(err, PBS_DATA, "%s: data of node %u does not fit it",
                      pbs_reader_name(a->reader), out->chunk.node);
    if (!rc) rc = look_inside(a, out, err);
    if (rc) pbs_archive_release(a, out);
    return rc;
}

void pbs_archive_release(const pbs_archive *a, pbs_fetched *f) {
    pbs_free(a->run, f->own);
    memset(f, 0, sizeof *f);
}

/* ---- a prefix ---- */

/* The first n records of a chunk. */
static pbs_code copy_records(const pbs_archive *a, uint32_t chunk, uint64_t n, uint8_t *to,
                             bool *verified, pbs_err *err) {
    const pbs_chunk *entry = &a->chunks[chunk];
    size_t bytes = (size_t)n * a->record.stride;
    pbs_fetched f = {0};
    *verified = n == entry->count;
    pbs_code rc = *verified ? pbs_archive_fetch(a, chunk, &f, err)
                            : pbs_reader_look(a->reader, entry, &f.chunk, err);
    const pbs_chunk *c = &f.chunk;
    if (!rc && !*verified && c->codec) {
        rc = pbs_codec_prefix(a->run, c->codec, c->tag, c->count, c->payload, (size_t)c->stored, to,
                              (size_t)c->count * a->record.stride, (uint32_t)n, err);
        return rc == PBS_DATA
                   ? pbs_fail_in(err, "%s: byte %llu: points of node %u",
                                 pbs_reader_name(a->reader), (unsigned long long)c->offset, c->node)
                   : rc;
    }
    if (!rc && bytes) memcpy(to, c->payload, bytes);
    if (!rc) pbs_archive_release(a, &f);
    return rc;
}

pbs_code pbs_archive_prefix(const pbs_archive *a, uint32_t node, uint64_t n, void *to,
                            bool *verified, pbs_err *err) {
    size_t count;
    uint8_t *p = to;
    const uint32_t *list = pbs_archive_list(a, node, PBS_SORT_POINTS, &count);
    pbs_code rc = PBS_OK;
    *verified = true;
    for (size_t i = 0; i < count && n && !rc; i++) {
        uint64_t here = a->chunks[list[i]].count < n ? a->chunks[list[i]].count : n;
        rc = copy_records(a, list[i], here, p, verified, err);
        p += here * a->record.stride;
        n -= here;
    }
    if (!rc && n)
        rc = pbs_fail(err, PBS_INTERNAL, "%s: node %u has not so many records",
                      pbs_reader_name(a->reader), node);
    return rc;
}

/* ---- a node ---- */

/* The payloads of a node's chunks, one after the other, of `stride` bytes a record. */
static pbs_code gather(const pbs_archive *a, uint32_t node, pbs_sort sort, uint32_t stride,
                       uint8_t **to, size_t *records, uint32_t *flags, pbs_err *err) {
    size_t count;
    const uint32_t *list = pbs_archive_list(a, node, sort, &count);
    *records = 0;
    if (!count) return PBS_OK;
    for (size_t i = 0; i < count; i++) *records += a->chunks[list[i]].count;
    pbs_code rc = pbs_alloc(a->run, to, *records, stride, "a node's data", err);
    for (size_t i = 0; i < count && !rc; i++) {
        pbs_fetched f;
        if ((rc = pbs_archive_fetch(a, list[i], &f, err))) break;
        if (f.chunk.bytes)
            memcpy(*to + (size_t)f.chunk.first * stride, f.chunk.payload, (size_t)f.chunk.bytes);
        *flags = f.chunk.flags;
        pbs_archive_release(a, &f);
    }
    return rc;
}

static pbs_code gather_voxels(const pbs_archive *a, uint32_t node, pbs_voxels *to, pbs_err *err) {
    size_t count;
    const uint32_t *list = pbs_archive_list(a, node, PBS_SORT_VOXELS, &count);
    if (!count) return PBS_OK;
    pbs_code rc =
        pbs_voxels_alloc(a->run, a->voxel_channels, (size_t)a->nodes[node].records, to, err);
    to->count = 0;
    for (size_t i = 0; i < count && !rc; i++) {
        pbs_fetched f;
        if ((rc = pbs_archive_fetch(a, list[i], &f, err))) break;
        pbs_voxels_append(to, &f.voxels, 0, f.voxels.count);
        pbs_archive_release(a, &f);
    }
    return rc;
}

pbs_code pbs_archive_load_node(const pbs_archive *a, uint32_t node, pbs_node_data *out,
                               pbs_err *err) {
    memset(out, 0, sizeof *out);
    size_t n;
    uint32_t flags = 0;
    uint8_t *faces = NULL;
    pbs_code rc =
        gather(a, node, PBS_SORT_POINTS, a->record.stride, &out->records, &n, &flags, err);
    if (!rc)
        rc = gather(a, node, PBS_SORT_OCTAVES, a->octave.stride, &out->octaves, &n, &flags, err);
    if (!rc) rc = gather_voxels(a, node, &out->voxels, err);
    if (!rc) rc = gather(a, node, PBS_SORT_FACES, 4, &faces, &out->face_count, &flags, err);
    out->faces = (uint32_t *)(void *)faces;
    out->face_colours = faces && flags & PBS_VFAC_COLOUR;
    if (rc) pbs_node_data_free(a, out);
    return rc;
}

void pbs_node_data_free(const pbs_archive *a, pbs_node_data *d) {
    pbs_free(a->run, d->records);
    pbs_free(a->run, d->octaves);
    pbs_voxels_free(a->run, &d->voxels);
    pbs_free(a->run, d->faces);
    memset(d, 0, sizeof *d);
}
