/* pack.c: inputs in, one archive out (pack.h): which sort a file is of, the root above several, the
 * numbers of nodes, the order of chunks. */
#include "formats/archive/pack.h"
#include "formats/archive/archive.h"
#include "formats/container/layout.h"
#include "formats/archive/pack_inner.h"
#include "formats/readers/ply_header.h"
#include <stdlib.h>
#include <string.h>
#include <strings.h>

pbs_code pbs_pack_new(pbs_run *run, pbs_pack **out, pbs_err *err) {
    pbs_code rc = pbs_alloc(run, out, 1, sizeof **out, "the archive", err);
    if (rc)
        *out = NULL;
    else
        **out = (pbs_pack){.run = run, .cloud_input = PACK_NOWHERE};
    if (!rc) pbs_trim_open(run, &(*out)->trim);
    return rc;
}

/* All that lies between the first chunk and the last: it is read in order, more than once. */
static void watch(pbs_pack *p, const pack_input *in) {
    if (!in->entry_count || !pbs_reader_mapped(in->reader)) return;
    const pbs_chunk *last = &in->entries[in->entry_count - 1];
    const uint8_t *first = pbs_reader_peek(in->reader, in->entries);
    const uint8_t *end = pbs_reader_peek(in->reader, last);
    if (first && end > first) pbs_trim_add(&p->trim, first, (size_t)(end - first));
}

static void free_input(pbs_run *run, pack_input *in) {
    pbs_free(run, in->material);
    pbs_free(run, in->texture);
    pbs_motions_free(run, &in->motions);
    if (in->kind == PACK_SCENE)
        pbs_scene_close(&in->scene);
    else
        pbs_reader_close(in->reader);
}

void pbs_pack_free(pbs_pack *p) {
    if (!p) return;
    pbs_run *run = p->run;
    pbs_trim_close(&p->trim);
    pbs_writer_close(p->w);
    pbs_cloudpack_free(p->cloud);
    pack_free_motions(p);
    for (size_t i = 0; i < p->cloud_count; i++) pbs_cloud_close(&p->clouds[i]);
    for (size_t i = 0; i < p->entry_count; i++) pbs_node_free(run, &p->entries[i].node);
    for (int i = 0; i < p->input_count; i++) free_input(run, &p->inputs[i]);
    for (size_t i = 0; i < p->spool_count; i++) pbs_reader_close(p->spools[i]);
    pbs_free(run, p->clouds);
    pbs_free(run, p->entries);
    pbs_free(run, p->inputs);
    pbs_free(run, p->spools);
    pbs_free(run, p->voxel_order);
    pbs_free(run, p->materials);
    pbs_free(run, p->textures);
    pbs_free(run, p->payload);
    pbs_free(run, p);
}

void pbs_pack_mesh_bits(pbs_pack *p, unsigned bits) {
    p->mesh_bits = bits;
}

/* ---- what a file is ---- */

static bool begins(const pbs_input *in, size_t at, const char *with) {
    size_t n = strlen(with);
    return in->size >= at + n && !memcmp(in->bytes + at, with, n);
}

static bool ends(const char *path, const char *with) {
    size_t n = path ? strlen(path) : 0, w = strlen(with);
    return n > w && !strcasecmp(path + n - w, with);
}

static bool has_faces(pbs_run *run, const pbs_input *in) {
    pbs_ply_header h = {0};
    bool any = false;
    if (!pbs_ply_header_read(run, in->bytes, (size_t)in->size, &h, NULL))
        for (size_t i = 0; i < h.elements; i++)
            any |= (pbs_ply_is_face(&h.element[i]) || pbs_ply_is_strip(&h.element[i])) &&
                   h.element[i].count;
    pbs_ply_header_free(run, &h);
    return any;
}

/* Text is a cloud; text with the ending of a scene, or that begins like glTF, is one. */
static bool is_scene(pbs_run *run, const pbs_input *in, const char *path) {
    static const char *const ending[] = {".glb", ".gltf", ".obj", ".stl", ".step",
                                         ".stp", ".fbx",  ".drc", ".igs", ".dae"};
    if (pbs_is_container(in->bytes, (size_t)in->size))
        return begins(in, HEADER_FIXED, "pbs scene ");
    if (begins(in, 0, "ply\n") || begins(in, 0, "ply\r")) return has_faces(run, in);
    if (begins(in, 0, "LASF")) return false;
    for (size_t i = 0; i < sizeof ending / sizeof ending[0]; i++)
        if (ends(path, ending[i])) return true;
    return begins(in, 0, "glTF") || begins(in, 0, "solid ") || begins(in, 0, "{");
}

/* ---- opening ---- */

static pbs_code add_input(pbs_pack *p, pack_kind kind, pack_input **out, pbs_err *err) {
    pbs_code rc = pbs_grow(p->run, &p->inputs, &p->input_cap, (size_t)p->input_count + 1,
                           sizeof *p->inputs, "the inputs", err);
    if (rc) return rc;
    *out = &p->inputs[p->input_count++];
    **out = (pack_input){.kind = kind, .made_from = PACK_NOWHERE};
    return PBS_OK;
}

static pbs_code add_cloud(pbs_pack *p, pbs_input *file, const char *path, pbs_err *err) {
    pack_input *in;
    pbs_code rc = pbs_grow(p->run, &p->clouds, &p->cloud_cap, p->cloud_count + 1, sizeof *p->clouds,
                           "the clouds", err);
    if (!rc && p->cloud_input == PACK_NOWHERE) {
        rc = add_input(p, PACK_CLOUD, &in, err);
        if (!rc) p->cloud_input = p->input_count - 1;
    }
    if (rc) {
        pbs_input_close(file);
        return rc;
    }
    rc = pbs_cloud_open_input(p->run, file, path, &p->clouds[p->cloud_count], err);
    p->cloud_count += !rc;
    return rc;
}

static pbs_code add_scene(pbs_pack *p, pbs_input *file, const char *path, pbs_err *err) {
    pack_input *in;
    pbs_code rc = add_input(p, PACK_SCENE, &in, err);
    if (rc) {
        pbs_input_close(file);
        return rc;
    }
    rc = pbs_scene_open_input(p->run, file, path, NULL, &in->scene, err);
    if (rc) return rc;
    in->reader = in->scene.reader;
    for (int i = 0; i < PBS_SKIP_KINDS; i++) p->stats.skipped[i] += in->scene.skipped[i];
    p->stats.scenes++;
    if (!p->stats.scene) p->stats.scene = pbs_reader_name(in->reader);
    rc = pbs_reader_directory(in->reader, &in->entries, &in->entry_count, err);
    if (!rc) watch(p, in);
    pbs_trim_now(&p->trim);
    return rc;
}

static pbs_code read_channels(pack_input *in, pbs_err *err) {
    const char *name = pbs_reader_name(in->reader), *text = pbs_reader_channels(in->reader);
    if (in->kind == PACK_VOXELS) return pbs_voxels_parse(name, text, &in->voxels, err);
    pbs_code rc = pbs_record_parse(name, text, &in->record, err);
    if (!rc && (in->record.packed || !(in->record.channels & PBS_SPACING)))
        rc = pbs_fail(err, PBS_DATA, "%s: surfels without spacing", name);
    return rc;
}

/* A scene does not come here, but the message of what does names it. */
static pbs_code add_stream(pbs_pack *p, pbs_input *file, pbs_err *err) {
    const uint32_t kinds = PBS_KIND(PBS_SURFELS) | PBS_KIND(PBS_VOXELS) | PBS_KIND(PBS_SCENE);
    pack_input *in;
    pbs_reader *r;
    pbs_code rc = pbs_reader_open(p->run, file, kinds, &r, err);
    if (rc) return rc;
    pack_kind kind = pbs_reader_kind(r) == PBS_VOXELS ? PACK_VOXELS : PACK_SURFELS;
    rc = add_input(p, kind, &in, err);
    if (rc) {
        pbs_reader_close(r);
        return rc;
    }
    in->reader = r;
    rc = read_channels(in, err);
    if (!rc) rc = pbs_reader_directory(r, &in->entries, &in->entry_count, err);
    if (!rc) watch(p, in);
    return rc ? rc : pack_take(p, p->input_count - 1, err);
}

pbs_code pbs_pack_add(pbs_pack *p, const char *path, pbs_err *err) {
    pbs_input file;
    pbs_code rc = pbs_input_open(p->run, path, &file, err);
    if (rc) return rc;
    rc = pbs_input_map(&file, err);
    if (rc) {
        pbs_input_close(&file);
        return rc;
    }
    if (is_scene(p->run, &file, path)) return add_scene(p, &file, path, err);
    /* An empty file is nobody's; the streams' reader says what is wrong with it. */
    if (!file.size || pbs_is_container(file.bytes, (size_t)file.size))
        return add_stream(p, &file, err);
    return add_cloud(p, &file, path, err);
}

/* ---- nodes ---- */

static bool brings_nodes(const pack_input *in) {
    return in->kind == PACK_CLOUD || in->node_count;
}

/* The child of the root that an input is. A cloud's node is known when all are numbered. */
static void add_child(pbs_pack *p, pbs_node *root, const pack_input *in) {
    pbs_child *child = &root->children[root->child_count++];
    *child = (pbs_child){.node = UINT32_MAX};
    memcpy(child->m, PBS_IDENTITY, sizeof child->m);
    pbs_node cloud;
    const pbs_node *c = &cloud;
    if (in->kind == PACK_CLOUD)
        cloud = pbs_cloudpack_root(p->cloud);
    else {
        size_t last = in->first_node + in->node_count - 1;
        child->node = p->entries[last].same;
        c = &p->entries[child->node].node;
    }
    if (!pbs_box_is_empty(&c->box))
        pbs_box_add(&root->box, c->box.min), pbs_box_add(&root->box, c->box.max);
    if (__builtin_add_overflow(root->triangles, c->triangles, &root->triangles))
        root->triangles = UINT64_MAX;
}

/* Several inputs get a root of their own, so that an archive always has one. */
static pbs_code add_root(pbs_pack *p, pbs_err *err) {
    if (!p->has_root) return PBS_OK;
    pack_entry e = {.input = PACK_NOWHERE,
                    .mesh_input = PACK_NOWHERE,
                    .same = (uint32_t)p->entry_count,
                    .node.box = PBS_BOX_EMPTY};
    pbs_code rc = pbs_grow(p->run, &p->entries, &p->entry_cap, p->entry_count + 1,
                           sizeof *p->entries, "the table of nodes", err);
    if (!rc)
        rc = pbs_alloc(p->run, &e.node.children, (size_t)p->input_count, sizeof *e.node.children,
                       "the root's children", err);
    for (int i = 0; i < p->input_count && !rc; i++)
        if (brings_nodes(&p->inputs[i])) add_child(p, &e.node, &p->inputs[i]);
    if (!rc) p->entries[p->entry_count++] = e;
    return rc;
}

/* The archive's numbers: inputs in order, a cloud where its first file is. */
static pbs_code number_nodes(pbs_pack *p, pbs_err *err) {
    uint64_t next = 0;
    for (int i = 0; i <= p->input_count; i++) {
        bool root = i == p->input_count;
        if (i == p->cloud_input) {
            p->first_cloud_node = (uint32_t)next;
            next += pbs_cloudpack_nodes(p->cloud);
        }
        size_t first = root ? p->entry_count - p->has_root : p->inputs[i].first_node;
        size_t n = root ? p->has_root : p->inputs[i].node_count;
        for (size_t k = first; k < first + n; k++)
            if (pack_is_kept(p, k)) p->entries[k].number = (uint32_t)next++;
        if (next >= UINT32_MAX) return pbs_fail(err, PBS_LIMIT, "more than 2^32 nodes");
    }
    p->node_count = (uint32_t)next;
    p->stats.nodes = next;
    return PBS_OK;
}

static pbs_code write_node(pbs_pack *p, pack_entry *e, pbs_err *err) {
    uint32_t cloud = p->cloud ? p->first_cloud_node + pbs_cloudpack_nodes(p->cloud) - 1 : 0;
    e->node.id = e->number;
    for (uint32_t c = 0; c < e->node.child_count; c++) {
        uint32_t *child = &e->node.children[c].node;
        *child = *child == UINT32_MAX ? cloud : p->entries[*child].number;
    }
    return pbs_node_write(p->run, p->w, &e->node, err);
}

static pbs_code write_nodes(pbs_pack *p, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (int i = 0; i <= p->input_count && !rc; i++) {
        bool root = i == p->input_count;
        if (i == p->cloud_input)
            rc = pbs_cloudpack_write_nodes(p->cloud, p->w, p->first_cloud_node, err);
        size_t first = root ? p->entry_count - p->has_root : p->inputs[i].first_node;
        size_t n = root ? p->has_root : p->inputs[i].node_count;
        for (size_t k = first; k < first + n && !rc; k++)
            if (pack_is_kept(p, k)) rc = write_node(p, &p->entries[k], err);
    }
    return rc;
}

/* ---- data ---- */

static int by_number(const void *a, const void *b) {
    uint64_t x, y;
    memcpy(&x, a, sizeof x);
    memcpy(&y, b, sizeof y);
    return (x > y) - (x < y);
}

/* Level by level from the one chunk that holds everything, and there in the order of the nodes,
 * which is Morton's: so every beginning of the archive is a coarse model. */
static pbs_code order_voxels(pbs_pack *p, pbs_err *err) {
    for (size_t i = 0; i < p->entry_count; i++)
        p->voxel_nodes += p->entries[i].voxels.voxels && pack_is_kept(p, i);
    pbs_code rc = pbs_alloc(p->run, &p->voxel_order, p->voxel_nodes, sizeof *p->voxel_order,
                            "the order of the nodes", err);
    size_t n = 0;
    for (size_t i = 0; i < p->entry_count && !rc; i++) {
        const pbs_voxel_survey *v = &p->entries[i].voxels;
        if (!v->voxels || !pack_is_kept(p, i)) continue;
        uint32_t below = v->place.levels > v->place.level ? v->place.levels - v->place.level : 0;
        p->voxel_order[n++] = (uint64_t)below << 32 | i;
    }
    if (!rc) qsort(p->voxel_order, n, sizeof *p->voxel_order, by_number);
    return rc;
}

/* What is written of each node that has no voxels, from the last to the first. */
static pbs_code write_down(pbs_pack *p, bool meshes, pbs_err *err) {
    pbs_code rc = PBS_OK;
    uint64_t done = 0;
    for (int i = p->input_count; i-- && !rc;) {
        const pack_input *in = &p->inputs[i];
        if (i == p->cloud_input && !meshes) rc = pbs_cloudpack_write_points(p->cloud, &p->out, err);
        for (size_t k = in->first_node + in->node_count; k-- > in->first_node && !rc;) {
            const pack_entry *e = &p->entries[k];
            if (!pack_is_kept(p, k) || e->voxels.voxels) continue;
            pbs_run_progress(p->run, meshes ? "writing meshes" : "writing", ++done, p->entry_count);
            rc = pbs_run_check(p->run, err);
            if (!rc) rc = (meshes ? pack_write_meshes : pack_write_points)(p, e, err);
            pbs_trim_now(&p->trim);
        }
    }
    return rc;
}

static pbs_code write_voxels(pbs_pack *p, bool meshes, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < p->voxel_nodes && !rc; i++) {
        const pack_entry *e = &p->entries[(uint32_t)p->voxel_order[i]];
        pbs_run_progress(p->run, meshes ? "writing meshes" : "writing voxels", i + 1,
                         p->voxel_nodes);
        rc = pbs_run_check(p->run, err);
        if (rc) break;
        pbs_voxel_source s = pack_voxel_source(p, e);
        rc = meshes ? pack_write_meshes(p, e, err)
                    : pbs_voxels_pack(p->run, &s, &e->voxels, p->w, e->number, p->out_voxels, err);
        if (!meshes) p->stats.voxels += e->voxels.voxels;
        pbs_trim_now(&p->trim);
    }
    return rc;
}

/* Whether a chunk that nobody knows goes on; it belongs to the node that follows it, if that is its
 * node, and is left out with it where an equal one stands for that. */
static bool goes_on(const pbs_pack *p, const pack_input *in, const pbs_chunk *c, size_t before) {
    if (!pack_is_other(c->tag)) return false;
    return c->node != before || before >= in->node_count ||
           pack_is_kept(p, in->first_node + before);
}

static pbs_code write_others(pbs_pack *p, const pack_input *in, bool count, pbs_err *err) {
    pbs_code rc = PBS_OK;
    size_t before = 0; /* nodes */
    for (size_t i = 0; i < in->entry_count && !rc; i++) {
        pbs_chunk c = in->entries[i];
        before += c.tag == PBS_TAG_NODE;
        if (!goes_on(p, in, &c, before)) continue;
        p->others += count;
        if (count) continue;
        rc = pbs_reader_at(in->reader, &in->entries[i], &c, err);
        pbs_piece piece = {c.payload, (size_t)c.bytes};
        if (c.node < in->node_count)
            c.node = p->entries[p->entries[in->first_node + c.node].same].number;
        if (!rc) rc = pbs_writer_chunk(p->w, &c, &piece, 1, err);
    }
    return rc;
}

/* ---- the archive ---- */

static char *history_of(const pbs_pack *p) {
    size_t n = 1;
    for (int i = 0; i < p->input_count; i++)
        if (p->inputs[i].reader) n += strlen(pbs_reader_history(p->inputs[i].reader));
    char *all = calloc(1, n), *at = all;
    for (int i = 0; all && i < p->input_count; i++)
        if (p->inputs[i].reader) at = stpcpy(at, pbs_reader_history(p->inputs[i].reader));
    return all;
}

static uint64_t count_chunks(pbs_pack *p) {
    uint64_t n = p->material_count + p->texture_count + p->animation_count + p->motion_count;
    if (p->cloud) n += pbs_cloudpack_chunks(p->cloud);
    for (size_t i = 0; i < p->entry_count; i++) {
        const pack_entry *e = &p->entries[i];
        if (!pack_is_kept(p, i)) continue;
        n += 1 + pbs_voxels_pack_chunks(&e->voxels) + pack_mesh_chunks(e);
        if (e->has_points)
            n += pbs_points_chunks(e->node.records, PBS_ARCHIVE_CHUNK) +
                 pbs_points_chunks(e->octaves, PBS_ARCHIVE_CHUNK);
    }
    for (int i = 0; i < p->input_count; i++) write_others(p, &p->inputs[i], true, NULL);
    return n + p->others;
}

static pbs_code open_writer(pbs_pack *p, const pbs_writer_desc *desc, pbs_err *err) {
    pbs_writer_desc d = *desc;
    char channels[512], *history = history_of(p);
    if (!history) return pbs_fail(err, PBS_LIMIT, "no memory");
    pbs_archive_text(&p->out, p->out_voxels, channels);
    d.kind = PBS_ARCHIVE;
    d.channels = channels;
    d.history = history;
    d.front = count_chunks(p);
    pbs_code rc = pbs_writer_open(p->run, &d, &p->w, err);
    free(history);
    return rc;
}

static pbs_code write_archive(pbs_pack *p, const pbs_writer_desc *desc, pbs_err *err) {
    pbs_code rc = open_writer(p, desc, err);
    if (!rc) rc = write_nodes(p, err);
    if (!rc) rc = pack_write_motions(p, err);
    if (!rc) rc = pack_write_materials(p, err);
    if (!rc) rc = write_down(p, false, err);
    if (!rc) rc = write_voxels(p, false, err);
    if (!rc) rc = write_down(p, true, err);
    if (!rc) rc = write_voxels(p, true, err);
    if (!rc) rc = pack_write_textures(p, err);
    for (int i = 0; i < p->input_count && !rc; i++) rc = write_others(p, &p->inputs[i], false, err);
    return rc ? rc : pbs_writer_commit(p->w, err);
}

/* The channels of all inputs together; lattices of nodes need them. */
static pbs_code prepare(pbs_pack *p, pbs_err *err) {
    uint32_t channels = 0;
    int nodes = 0;
    pbs_code rc = pack_match(p, err);
    if (!rc && p->cloud_count)
        rc = pbs_cloudpack_make(p->run, p->clouds, p->cloud_count, &p->cloud, err);
    if (rc) return rc;
    for (int i = 0; i < p->input_count; i++) {
        const pack_input *in = &p->inputs[i];
        channels |= in->record.channels;
        p->out_voxels |= in->voxels & ~(uint32_t)PBS_WEIGHT;
        nodes += brings_nodes(in);
    }
    if (p->cloud) channels |= pbs_cloudpack_channels(p->cloud);
    p->out = channels ? pbs_record_make(channels, true) : (pbs_record){0};
    p->has_root = nodes > 1;
    rc = pack_look_number(p, err);
    if (!rc) rc = pack_motions(p, err);
    if (!rc) rc = pack_same(p, err);
    for (size_t i = 0; i < p->entry_count && !rc; i++)
        if (pack_is_kept(p, i)) rc = pack_choose_lattice(p, &p->entries[i], err);
    if (!rc) rc = pack_choose_steps(p, err);
    if (!rc) rc = add_root(p, err);
    if (!rc) rc = number_nodes(p, err);
    return rc ? rc : order_voxels(p, err);
}

pbs_code pbs_pack_write(pbs_pack *p, const pbs_writer_desc *desc, pbs_pack_stats *stats,
                        pbs_err *err) {
    pbs_code rc = prepare(p, err);
    if (!rc) rc = write_archive(p, desc, err);
    if (rc) return rc;
    p->stats.record = p->out;
    p->stats.voxel_channels = p->out_voxels;
    p->stats.bytes = pbs_writer_bytes(p->w);
    p->stats.has_cloud = p->cloud != NULL;
    if (p->cloud) pbs_cloudpack_count(p->cloud, &p->stats.cloud);
    *stats = p->stats;
    return PBS_OK;
}
