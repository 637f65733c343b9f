/* source.c: chunks of an archive, put together as source.h says. */
#include "cmd/pbs-view/stream/source.h"
#include "cmd/pbs-view/plan/part.h"
#include <string.h>

/* Those that are uploaded, in their order. */
static const uint32_t channels[] = {PBS_POSITION, PBS_NORMAL,   PBS_COLOUR,
                                    PBS_MATERIAL, PBS_EMISSIVE, PBS_FACE};
enum { CHANNELS = sizeof channels / sizeof *channels };

static uint64_t count_of(const pbs_archive *a, uint32_t node, pbs_sort sort) {
    size_t n;
    uint64_t sum = 0;
    const uint32_t *list = pbs_archive_list(a, node, sort, &n);
    for (size_t i = 0; i < n; i++) sum += a->chunks[list[i]].count;
    return sum;
}

static uint64_t octave_bytes(const pbs_archive *a, uint32_t node) {
    return count_of(a, node, PBS_SORT_OCTAVES) * a->octave.stride;
}

/* Of a node without faces' attributes the channel that points to them says nothing. */
static bool has_channel(const pbs_archive *a, uint32_t node, uint32_t channel) {
    if (channel == PBS_FACE && !pbs_archive_has(a, node, PBS_SORT_FACES)) return false;
    return a->voxel_channels & channel;
}

/* Channels of a node's voxels. */
static uint32_t channel_count(const pbs_archive *a, uint32_t node) {
    uint32_t n = 0;
    for (int i = 0; i < CHANNELS; i++) n += has_channel(a, node, channels[i]);
    return n;
}

static uint64_t own_bytes(const pbs_source *s, uint32_t node) {
    const pbs_archive *a = s->archive;
    uint64_t n = 0;
    if (s->has[node] & PBS_HAS_SURFELS)
        return a->nodes[node].records * a->record.stride + octave_bytes(a, node);
    if (!(s->has[node] & PBS_HAS_VOXELS)) return 0;
    n = channel_count(a, node);
    return 4 * (n * a->nodes[node].records + count_of(a, node, PBS_SORT_FACES));
}

static uint64_t mesh_bytes(const pbs_archive *a, uint32_t node) {
    size_t n;
    uint64_t sum = 0;
    const uint32_t *list = pbs_archive_list(a, node, PBS_SORT_MESHES, &n);
    for (size_t i = 0; i < n; i++) sum += pbs_source_rounded(pbs_archive_bytes(a, list[i]));
    return sum;
}

/* ---- parts ---- */

static bool divided(const pbs_source *s, uint32_t node) {
    return s->bytes[PBS_ITEM_OWN(node)] > s->largest;
}

static pbs_part part_of_node(uint32_t each, uint32_t k, uint64_t records) {
    uint64_t before = (uint64_t)each * k, here = records > before ? records - before : 0;
    return (pbs_part){(uint32_t)before, (uint32_t)(here < each ? here : each), 0};
}

/* Bytes of `here` records and their entries in the octaves. */
static uint64_t surfel_bytes(const pbs_archive *a, uint32_t node, pbs_part part) {
    uint64_t entries = 0;
    if (octave_bytes(a, node)) entries = pbs_part_octave_begin(part, a->nodes[node].records, 0);
    return (uint64_t)part.here * a->record.stride + entries * a->octave.stride;
}

/* The first part has the most entries for its records. */
uint32_t pbs_source_each(const pbs_source *s, uint32_t node) {
    const pbs_archive *a = s->archive;
    uint64_t all = a->nodes[node].records, each;
    if (!divided(s, node)) return (uint32_t)all;
    if (!(s->has[node] & PBS_HAS_SURFELS)) {
        each = s->largest / (4 * (uint64_t)channel_count(a, node));
    } else {
        each = s->largest / a->record.stride;
        while (each > 1 && surfel_bytes(a, node, (pbs_part){0, (uint32_t)each, 0}) > s->largest)
            each -= (each + 15) / 16;
    }
    return (uint32_t)(each < 1 ? 1 : each < all ? each : all);
}

static uint64_t own_part(const pbs_source *s, uint32_t node, uint32_t k) {
    const pbs_archive *a = s->archive;
    uint64_t records = a->nodes[node].records;
    pbs_part part = part_of_node(pbs_source_each(s, node), k, records);
    if (s->has[node] & PBS_HAS_SURFELS) return part.here ? surfel_bytes(a, node, part) : 0;
    if (part.here) return 4 * (uint64_t)channel_count(a, node) * part.here;
    return k == pbs_source_faces(s, node) ? 4 * count_of(a, node, PBS_SORT_FACES) : 0;
}

uint64_t pbs_source_part(void *ctx, uint32_t item, uint32_t k) {
    const pbs_source *s = ctx;
    size_t next = 0;
    if (s->bytes[item] <= s->largest) return k ? 0 : s->bytes[item];
    if (item % 2 == 0) return own_part(s, item / 2, k);
    for (; k; k--) pbs_source_mesh_part(s, item / 2, &next);
    return pbs_source_mesh_part(s, item / 2, &next);
}

uint64_t pbs_source_octaves(const pbs_source *s, uint32_t node, uint32_t k) {
    const pbs_archive *a = s->archive;
    pbs_part part = part_of_node(pbs_source_each(s, node), k, a->nodes[node].records);
    uint64_t records = (uint64_t)part.here * a->record.stride;
    return surfel_bytes(a, node, part) > records ? records : 0;
}

uint32_t pbs_source_faces(const pbs_source *s, uint32_t node) {
    uint32_t each = pbs_source_each(s, node);
    if (!divided(s, node)) return 0;
    return (uint32_t)((s->archive->nodes[node].records + each - 1) / each);
}

int32_t pbs_source_voxels(const pbs_source *s, uint32_t node, uint32_t k, uint32_t channel) {
    const pbs_archive *a = s->archive;
    pbs_part part = part_of_node(pbs_source_each(s, node), k, a->nodes[node].records);
    uint64_t at = 0;
    if (channel ? !has_channel(a, node, channel) : !has_channel(a, node, PBS_FACE)) return -1;
    for (int i = 0; i < CHANNELS && channels[i] != channel; i++)
        if (has_channel(a, node, channels[i])) at += part.here;
    return channel || !divided(s, node) ? (int32_t)at : 0;
}

static void look(pbs_source *s) {
    const pbs_archive *a = s->archive;
    for (uint32_t i = 0; i < a->node_count; i++) {
        s->has[i] = (pbs_archive_has(a, i, PBS_SORT_POINTS) ? PBS_HAS_SURFELS : 0) |
                    (pbs_archive_has(a, i, PBS_SORT_VOXELS) ? PBS_HAS_VOXELS : 0) |
                    (pbs_archive_has(a, i, PBS_SORT_MESHES) ? PBS_HAS_MESH : 0);
        s->bytes[PBS_ITEM_OWN(i)] = own_bytes(s, i);
        s->bytes[PBS_ITEM_MESH(i)] = mesh_bytes(a, i);
    }
    for (uint32_t i = 0; i < a->texture_count; i++)
        for (int srgb = 0; srgb < 2; srgb++)
            s->bytes[pbs_source_texture(s, i, srgb)] = pbs_source_guess(s, i);
}

pbs_code pbs_source_new(pbs_run *run, const pbs_archive *a, pbs_source *s, pbs_err *err) {
    const char *what = "the table of nodes";
    size_t n = a->node_count, textures = 2 * a->texture_count;
    *s = (pbs_source){.run = run,
                      .archive = a,
                      .items = 2 * n + textures,
                      .largest = UINT64_MAX,
                      .largest_side = UINT32_MAX,
                      .largest_texture = UINT64_MAX};
    pbs_code rc = pbs_alloc(run, &s->has, n, 1, what, err);
    if (!rc) rc = pbs_alloc(run, &s->bytes, s->items, sizeof *s->bytes, what, err);
    if (!rc) rc = pbs_alloc(run, &s->face_colours, n, sizeof *s->face_colours, what, err);
    if (!rc) rc = pbs_alloc(run, &s->profile, n, sizeof *s->profile, what, err);
    if (!rc) memset(s->profile, 0, n * sizeof *s->profile);
    if (!rc) rc = pbs_alloc(run, &s->mesh, n, sizeof *s->mesh, what, err);
    if (!rc) memset(s->mesh, 0, n * sizeof *s->mesh);
    if (!rc) rc = pbs_alloc(run, &s->mips, textures, sizeof *s->mips, what, err);
    if (rc) {
        pbs_source_free(s);
        return rc;
    }
    memset(s->face_colours, 0, n * sizeof *s->face_colours);
    look(s);
    return PBS_OK;
}

void pbs_source_free(pbs_source *s) {
    size_t n = s->archive ? s->archive->node_count : 0;
    for (size_t i = 0; i < n && s->profile; i++) pbs_free(s->run, s->profile[i]);
    for (size_t i = 0; i < n && s->mesh; i++) pbs_source_free_mesh(s->run, s->mesh[i]);
    pbs_free(s->run, s->has);
    pbs_free(s->run, s->bytes);
    pbs_free(s->run, s->face_colours);
    pbs_free(s->run, s->profile);
    pbs_free(s->run, s->mesh);
    pbs_free(s->run, s->mips);
    *s = (pbs_source){0};
}

/* Records of `stride` bytes of all chunks of a sort, to where they belong; flags: of the last one.
 */
static pbs_code copy_records(const pbs_source *s, uint32_t node, pbs_sort sort, uint32_t stride,
                             uint8_t *to, uint32_t *flags, pbs_err *err) {
    const pbs_archive *a = s->archive;
    size_t n;
    const uint32_t *list = pbs_archive_list(a, node, sort, &n);
    for (size_t i = 0; i < n; i++) {
        pbs_fetched f;
        pbs_code rc = pbs_archive_fetch(a, list[i], &f, err);
        if (rc) return rc;
        memcpy(to + (size_t)f.chunk.first * stride, f.chunk.payload,
               (size_t)f.chunk.count * stride);
        if (flags) *flags = f.chunk.flags;
        pbs_archive_release(a, &f);
    }
    return PBS_OK;
}

static pbs_code make_profile(pbs_source *s, uint32_t id, const uint8_t *records, pbs_err *err) {
    const pbs_archive *a = s->archive;
    const pbs_node *n = &a->nodes[id];
    pbs_spacings spacings = {.first = records + pbs_record_at(&a->record, PBS_SPACING),
                             .stride = a->record.stride,
                             .count = (uint32_t)n->records,
                             .unit = 65535 * n->lattice,
                             .covering = n->covering,
                             .slack = 0.7 * n->pixel};
    if (s->profile[id]) return PBS_OK;
    pbs_code rc = pbs_alloc(s->run, &s->profile[id], 1, sizeof **s->profile, "spacings", err);
    if (!rc) pbs_profile_make(&spacings, s->profile[id]);
    return rc;
}

static pbs_code load_surfels(pbs_source *s, uint32_t node, uint8_t *to, pbs_err *err) {
    const pbs_archive *a = s->archive;
    uint64_t records = a->nodes[node].records * a->record.stride;
    pbs_code rc = copy_records(s, node, PBS_SORT_POINTS, a->record.stride, to, NULL, err);
    if (!rc)
        rc = copy_records(s, node, PBS_SORT_OCTAVES, a->octave.stride, to + records, NULL, err);
    return rc ? rc : make_profile(s, node, to, err);
}

static const void *array_of(const pbs_voxels *v, uint32_t channel) {
    switch (channel) {
    case PBS_POSITION:
        return v->place;
    case PBS_NORMAL:
        return v->normal;
    case PBS_COLOUR:
        return v->colour;
    case PBS_MATERIAL:
        return v->material;
    case PBS_EMISSIVE:
        return v->emissive;
    default:
        return v->face;
    }
}

static pbs_code load_voxels(pbs_source *s, uint32_t node, uint8_t *to, pbs_err *err) {
    const pbs_archive *a = s->archive;
    size_t n, have = 0;
    uint32_t flags = 0;
    const uint32_t *list = pbs_archive_list(a, node, PBS_SORT_VOXELS, &n);
    for (size_t i = 0; i < n; i++) {
        pbs_fetched f;
        size_t at = 0;
        pbs_code rc = pbs_archive_fetch(a, list[i], &f, err);
        if (rc) return rc;
        for (int k = 0; k < CHANNELS; k++) {
            if (!has_channel(a, node, channels[k])) continue;
            memcpy(to + 4 * (at + have), array_of(&f.voxels, channels[k]), 4 * f.voxels.count);
            at += a->nodes[node].records;
        }
        have += f.voxels.count;
        pbs_archive_release(a, &f);
    }
    if (!has_channel(a, node, PBS_FACE)) return PBS_OK;
    size_t faces = channel_count(a, node) * (size_t)a->nodes[node].records;
    pbs_code rc = copy_records(s, node, PBS_SORT_FACES, 4, to + 4 * faces, &flags, err);
    s->face_colours[node] = flags & PBS_VFAC_COLOUR;
    return rc;
}

/* A node as load_surfels and load_voxels make it becomes its parts, one behind the other: of each
 * array that it has, `size` bytes a record and `count` of them, the share of every part. */
typedef struct array {
    uint64_t size, count;
} array;

static size_t arrays_of(const pbs_source *s, uint32_t node, array out[40]) {
    const pbs_archive *a = s->archive;
    uint64_t records = a->nodes[node].records;
    size_t n = 0;
    if (!(s->has[node] & PBS_HAS_SURFELS)) {
        for (uint32_t k = channel_count(a, node); k > 0; k--) out[n++] = (array){4, records};
        return n;
    }
    out[n++] = (array){a->record.stride, records};
    for (int k = octave_bytes(a, node) ? pbs_octaves(records) : 0; k > 0; k--)
        out[n++] = (array){a->octave.stride, pbs_octave_length(records, k)};
    return n;
}

static void divide(const pbs_source *s, uint32_t node, const uint8_t *from, uint8_t *to) {
    uint32_t each = pbs_source_each(s, node);
    uint64_t records = s->archive->nodes[node].records, at = 0, end = 0;
    array arrays[40];
    size_t n = arrays_of(s, node, arrays);
    for (uint64_t before = 0; before < records; before += each) {
        uint64_t begin = 0;
        for (size_t i = 0; i < n; begin += arrays[i].size * arrays[i].count, i++) {
            const array *a = &arrays[i];
            uint64_t here = a->count > before ? a->count - before : 0;
            here = here < each ? here : each;
            if (here) memcpy(to + at, from + begin + a->size * before, (size_t)(a->size * here));
            at += a->size * here;
        }
        end = begin;
    }
    /* The faces' attributes stay behind all. */
    memcpy(to + at, from + end, (size_t)(s->bytes[PBS_ITEM_OWN(node)] - end));
}

/* Surfels or voxels, in parts where the node is divided. */
static pbs_code load_own(pbs_source *s, uint32_t node, pbs_blob *out, pbs_err *err) {
    bool surfels = s->has[node] & PBS_HAS_SURFELS;
    uint8_t *parts;
    pbs_code rc =
        surfels ? load_surfels(s, node, out->bytes, err) : load_voxels(s, node, out->bytes, err);
    if (rc || !divided(s, node)) return rc;
    rc = pbs_alloc(s->run, &parts, out->size, 1, "a node's data", err);
    if (rc) return rc;
    divide(s, node, out->bytes, parts);
    pbs_free(s->run, out->bytes);
    out->bytes = parts;
    return PBS_OK;
}

pbs_code pbs_source_load(void *ctx, uint32_t item, pbs_blob *out, pbs_err *err) {
    pbs_source *s = ctx;
    uint32_t node = item / 2;
    if (node >= s->archive->node_count) return pbs_source_load_texture(s, item, out, err);
    *out = (pbs_blob){.size = (size_t)s->bytes[item]};
    pbs_code rc = pbs_alloc(s->run, &out->bytes, out->size, 1, "a node's data", err);
    if (!rc)
        rc =
            item % 2 ? pbs_source_load_mesh(s, node, out->bytes, err) : load_own(s, node, out, err);
    if (!rc) return PBS_OK;
    pbs_free(s->run, out->bytes);
    *out = (pbs_blob){0};
    return rc;
}
