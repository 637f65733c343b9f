/* archive.c: an archive, opened: its index, and whether it can be believed. */
#include "formats/archive/archive.h"
#include "formats/scene/dag.h"
#include "formats/scene/scene.h"
#include <stdio.h>
#include <string.h>

void pbs_archive_text(const pbs_record *points, uint32_t voxels, char out[512]) {
    char more[256];
    pbs_record_text(points, out);
    pbs_voxels_text(voxels, more);
    size_t n = strlen(out);
    snprintf(out + n, 512 - n, "%s%s", n && *more ? " " : "", more);
}

pbs_code pbs_archive_parse(const char *place, const char *text, pbs_record *points,
                           uint32_t *voxels, pbs_err *err) {
    char first[256];
    const char *second = strstr(text, "place:");
    size_t n = second ? (size_t)(second - text) : strlen(text);
    *points = (pbs_record){0};
    *voxels = 0;
    pbs_code rc = PBS_OK;
    if (n > sizeof first || (second && n && text[n - 1] != ' '))
        return pbs_fail(err, PBS_DATA, "%s: channels that this program does not know: %s", place,
                        text);
    if (second) rc = pbs_voxels_parse(place, second, voxels, err);
    if (rc || !n) return rc; /* an archive of meshes has neither */
    snprintf(first, sizeof first, "%.*s", (int)(n - (second != NULL)), text);
    rc = pbs_record_parse(place, first, points, err);
    if (!rc && !points->packed) rc = pbs_fail(err, PBS_DATA, "%s: not an archive's records", place);
    return rc;
}

static const uint32_t tag_of[PBS_SORTS] = {PBS_TAG_POINTS, PBS_TAG_OCTAVES, PBS_TAG_VOXELS,
                                           PBS_TAG_FACES, PBS_TAG_MESH};

static int sort_of(uint32_t tag) {
    for (int i = 0; i < PBS_SORTS; i++)
        if (tag_of[i] == tag) return i;
    return -1;
}

/* ---- nodes, materials, textures ---- */

static size_t count_tag(const pbs_archive *a, uint32_t tag) {
    size_t n = 0;
    for (size_t i = 0; i < a->chunk_count; i++) n += a->chunks[i].tag == tag;
    return n;
}

static pbs_code read_nodes(pbs_archive *a, pbs_err *err) {
    const char *name = pbs_reader_name(a->reader);
    size_t n = count_tag(a, PBS_TAG_NODE);
    if (!n) return pbs_fail(err, PBS_DATA, "%s: no node in it", name);
    pbs_code rc = pbs_alloc(a->run, &a->nodes, n, sizeof *a->nodes, "the nodes", err);
    for (size_t i = 0; !rc && i < a->chunk_count; i++) {
        pbs_chunk c;
        if (a->chunks[i].tag != PBS_TAG_NODE) continue;
        rc = pbs_reader_at(a->reader, &a->chunks[i], &c, err);
        if (!rc)
            rc = pbs_node_read(a->run, name, &c, (uint32_t)a->node_count, &a->nodes[a->node_count],
                               err);
        a->node_count += !rc;
    }
    return rc;
}

static pbs_code read_motions(pbs_archive *a, pbs_err *err) {
    const char *name = pbs_reader_name(a->reader);
    pbs_code rc = PBS_OK;
    for (size_t i = 0; !rc && i < a->chunk_count; i++) {
        pbs_chunk c;
        if (!pbs_is_motion(a->chunks[i].tag)) continue;
        rc = pbs_reader_at(a->reader, &a->chunks[i], &c, err);
        if (!rc) rc = pbs_motions_take(a->run, name, &c, &a->motions, err);
    }
    return rc ? rc : pbs_motions_fit(name, &a->motions, a->nodes, a->node_count, err);
}

static pbs_code list_textures(pbs_archive *a, pbs_err *err) {
    size_t n = count_tag(a, PBS_TAG_TEXTURE);
    pbs_code rc = pbs_alloc(a->run, &a->textures, n, sizeof *a->textures, "the textures", err);
    for (size_t i = 0; !rc && i < a->chunk_count; i++) {
        if (a->chunks[i].tag != PBS_TAG_TEXTURE) continue;
        if (a->chunks[i].node != a->texture_count)
            return pbs_fail(err, PBS_DATA, "%s: texture %zu is not in its place",
                            pbs_reader_name(a->reader), a->texture_count);
        a->textures[a->texture_count++] = (uint32_t)i;
    }
    return rc;
}

static pbs_code read_materials(pbs_archive *a, pbs_err *err) {
    size_t n = count_tag(a, PBS_TAG_MATERIAL), textures = a->texture_count;
    pbs_code rc = pbs_alloc(a->run, &a->materials, n, sizeof *a->materials, "the materials", err);
    for (size_t i = 0; !rc && i < a->chunk_count; i++) {
        pbs_chunk c;
        if (a->chunks[i].tag != PBS_TAG_MATERIAL) continue;
        if ((rc = pbs_reader_at(a->reader, &a->chunks[i], &c, err))) break;
        if (c.node != a->material_count || !pbs_material_parse(&c, textures ? textures : PBS_NONE,
                                                               &a->materials[a->material_count]))
            return pbs_fail(err, PBS_DATA, "%s: material %zu is damaged",
                            pbs_reader_name(a->reader), a->material_count);
        a->material_count++;
    }
    return rc;
}

/* ---- the chunks of data ---- */

/* Two walks: how many there are of each node and sort, and then where they are. */
static pbs_code list_data(pbs_archive *a, pbs_err *err) {
    size_t lists = PBS_SORTS * a->node_count, count = 0;
    pbs_code rc = pbs_alloc(a->run, &a->begin, lists + 1, sizeof *a->begin, "the index", err);
    if (rc) return rc;
    memset(a->begin, 0, (lists + 1) * sizeof *a->begin);
    for (size_t i = 0; i < a->chunk_count; i++) {
        const pbs_chunk *c = &a->chunks[i];
        int sort = sort_of(c->tag);
        if (sort < 0) continue;
        if (c->node >= a->node_count)
            return pbs_fail(err, PBS_DATA, "%s: data of node %u, which is not there",
                            pbs_reader_name(a->reader), c->node);
        a->begin[(size_t)c->node * PBS_SORTS + (size_t)sort]++;
        count++;
    }
    for (size_t i = 0, at = 0; i <= lists; i++) {
        at += a->begin[i];
        a->begin[i] = (uint32_t)at;
    }
    if ((rc = pbs_alloc(a->run, &a->data, count, sizeof *a->data, "the index", err))) return rc;
    /* From the last on, so that ends become beginnings. */
    for (size_t i = a->chunk_count; i--;) {
        const pbs_chunk *c = &a->chunks[i];
        int sort = sort_of(c->tag);
        if (sort >= 0)
            a->data[--a->begin[(size_t)c->node * PBS_SORTS + (size_t)sort]] = (uint32_t)i;
    }
    return PBS_OK;
}

/* Records, entries, voxels or triangles of a node and sort; false: its chunks do not fit. */
static bool add_up(const pbs_archive *a, uint32_t node, pbs_sort sort, uint64_t *total) {
    size_t n;
    const uint32_t *list = pbs_archive_list(a, node, sort, &n);
    *total = 0;
    for (size_t i = 0; i < n; i++) {
        const pbs_chunk *c = &a->chunks[list[i]];
        uint64_t bytes = pbs_archive_bytes(a, list[i]);
        bool whole = c->codec || (c->bytes == bytes && bytes);
        if (!whole || c->first != *total || (sort != PBS_SORT_POINTS && !c->count)) return false;
        if (sort != PBS_SORT_MESHES && (!bytes || bytes > PBS_PAYLOAD_MAX)) return false;
        if (sort == PBS_SORT_VOXELS && c->count > PBS_VOXELS_CHUNK) return false;
        *total += c->count;
    }
    return true;
}

static pbs_code check_node(const pbs_archive *a, const pbs_node *n, pbs_err *err) {
    static const char *const what[PBS_SORTS] = {"points", "octaves", "voxels", "faces", "meshes"};
    const char *name = pbs_reader_name(a->reader);
    uint64_t total[PBS_SORTS];
    for (int sort = 0; sort < PBS_SORTS; sort++)
        if (!add_up(a, n->id, sort, &total[sort]))
            return pbs_fail(err, PBS_DATA, "%s: %s of node %u do not fit it", name, what[sort],
                            n->id);
    uint64_t points = total[PBS_SORT_POINTS], voxels = total[PBS_SORT_VOXELS];
    if (points + voxels != n->records)
        return pbs_fail(err, PBS_DATA, "%s: node %u has %llu records of %llu", name, n->id,
                        (unsigned long long)(points + voxels), (unsigned long long)n->records);
    if ((points && voxels) || (n->records && !(n->lattice > 0)))
        return pbs_fail(err, PBS_DATA, "%s: the records of node %u do not fit it", name, n->id);
    if (total[PBS_SORT_OCTAVES] &&
        total[PBS_SORT_OCTAVES] != pbs_octave_entries(&a->octave, points))
        return pbs_fail(err, PBS_DATA, "%s: octaves of node %u are not all there", name, n->id);
    return PBS_OK;
}

/* ---- opening ---- */

static pbs_code read_index(pbs_archive *a, pbs_err *err) {
    const char *name = pbs_reader_name(a->reader);
    const char *text = pbs_reader_channels(a->reader);
    pbs_code rc = pbs_reader_kind(a->reader) == PBS_VOXELS
                      ? pbs_voxels_parse(name, text, &a->voxel_channels, err)
                      : pbs_archive_parse(name, text, &a->record, &a->voxel_channels, err);
    if (!rc) a->octave = pbs_octave_record(a->record.channels);
    if (!rc) rc = pbs_reader_directory(a->reader, &a->chunks, &a->chunk_count, err);
    if (!rc && a->chunk_count > UINT32_MAX)
        rc = pbs_fail(err, PBS_LIMIT, "%s: more than 2^32 - 1 chunks", name);
    if (!rc) rc = read_nodes(a, err);
    if (!rc) rc = read_motions(a, err);
    if (!rc) rc = list_textures(a, err);
    if (!rc) rc = read_materials(a, err);
    if (!rc) rc = list_data(a, err);
    for (size_t i = 0; !rc && i < a->node_count; i++) rc = check_node(a, &a->nodes[i], err);
    return rc;
}

static uint64_t own_data(const void *ctx, uint32_t node) {
    const uint32_t *b = ((const pbs_archive *)ctx)->begin + (size_t)node * PBS_SORTS;
    return b[0] != b[PBS_SORTS];
}

static uint64_t own_moving(const void *ctx, uint32_t node) {
    const pbs_archive *a = ctx;
    uint64_t n = 0;
    for (uint32_t i = 0; i < a->nodes[node].child_count; i++)
        n += !!(a->nodes[node].children[i].flags & PBS_CHILD_MOVES);
    return n;
}

pbs_code pbs_archive_open(pbs_run *run, const char *path, pbs_archive *a, pbs_err *err) {
    memset(a, 0, sizeof *a);
    a->run = run;
    pbs_input in;
    pbs_code rc = pbs_input_open(run, path, &in, err);
    if (rc) return rc;
    if ((rc = pbs_input_map(&in, err))) {
        pbs_input_close(&in);
        return rc;
    }
    rc = pbs_reader_open(run, &in, PBS_KIND(PBS_ARCHIVE) | PBS_KIND(PBS_VOXELS), &a->reader, err);
    if (!rc) rc = read_index(a, err);
    if (!rc) rc = pbs_dag_count(run, a->nodes, a->node_count, own_data, a, &a->placings, err);
    if (!rc) rc = pbs_dag_count(run, a->nodes, a->node_count, own_moving, a, &a->moving, err);
    if (rc) pbs_archive_close(a);
    return rc;
}

void pbs_archive_close(pbs_archive *a) {
    for (size_t i = 0; i < a->node_count; i++) pbs_node_free(a->run, &a->nodes[i]);
    pbs_free(a->run, a->nodes);
    pbs_free(a->run, a->materials);
    pbs_free(a->run, a->data);
    pbs_free(a->run, a->begin);
    pbs_free(a->run, a->textures);
    pbs_motions_free(a->run, &a->motions);
    pbs_free(a->run, a->placings);
    pbs_free(a->run, a->moving);
    pbs_reader_close(a->reader);
    memset(a, 0, sizeof *a);
}
