/* pack_take.c: the nodes of a stream or a scene to the packer's table, checked against the data
 * that came with them. */
#include "formats/archive/pack_inner.h"
#include <string.h>

static pbs_code add_entry(pbs_pack *p, pack_entry *e, pbs_err *err) {
    pbs_code rc = p->entry_count < UINT32_MAX - 1
                      ? pbs_grow(p->run, &p->entries, &p->entry_cap, p->entry_count + 1,
                                 sizeof *p->entries, "the table of nodes", err)
                      : pbs_fail(err, PBS_LIMIT, "more than 2^32 nodes");
    e->same = (uint32_t)p->entry_count;
    if (!rc) p->entries[p->entry_count++] = *e;
    return rc;
}

/* What came before its node. */
typedef struct counts {
    uint64_t points, octaves, voxels;
} counts;

/* Whether the node got what it says. */
static pbs_code check_counts(const pack_input *in, const pack_entry *e, const counts *n,
                             pbs_err *err) {
    const char *name = pbs_reader_name(in->reader);
    pbs_record octave = pbs_octave_record(in->record.channels);
    uint64_t records = in->voxels ? n->voxels : n->points;
    if (records != e->node.records)
        return pbs_fail(err, PBS_DATA, "%s: node %u has %llu %s and not %llu", name, e->own,
                        (unsigned long long)records, in->voxels ? "voxels" : "points",
                        (unsigned long long)e->node.records);
    if (n->octaves && n->octaves != pbs_octave_entries(&octave, n->points))
        return pbs_fail(err, PBS_DATA, "%s: node %u has %llu entries of octaves", name, e->own,
                        (unsigned long long)n->octaves);
    return PBS_OK;
}

/* Nodes keep their order; their children are entries of the table. */
static pbs_code add_node(pbs_pack *p, pack_entry e, const pbs_chunk *at, const counts *n,
                         pbs_err *err) {
    const pack_input *in = &p->inputs[e.input];
    pbs_chunk c;
    e.own = (uint32_t)(p->entry_count - in->first_node);
    pbs_code rc = pbs_reader_at(in->reader, at, &c, err);
    if (!rc) rc = pbs_node_read(p->run, pbs_reader_name(in->reader), &c, e.own, &e.node, err);
    if (rc) return rc;
    rc = check_counts(in, &e, n, err);
    pbs_voxel_source s = pack_voxel_source(p, &e);
    if (!rc && n->voxels) rc = pbs_voxels_survey(&s, &e.voxels, err);
    pbs_trim_now(&p->trim);
    e.octaves = n->octaves;
    e.has_points = n->points != 0;
    for (uint32_t k = 0; k < e.node.child_count; k++)
        e.node.children[k].node += (uint32_t)in->first_node;
    if (!rc) rc = add_entry(p, &e, err);
    if (rc) pbs_node_free(p->run, &e.node);
    return rc;
}

/* A chunk of the node that comes next: of points, octaves or voxels, of which *have came before. */
static pbs_code count_chunk(const pbs_pack *p, const pack_input *in, const pbs_chunk *c,
                            uint64_t *have, const pbs_record *record, pbs_err *err) {
    const char *name = pbs_reader_name(in->reader);
    char tag[5];
    size_t next = p->entry_count - in->first_node;
    if (c->node != next || (record && !record->stride) || (!record && !in->voxels))
        return pbs_fail(err, PBS_DATA, "%s: %s of node %u where %zu is expected", name,
                        pbs_tag_text(c->tag, tag), c->node, next);
    pbs_code rc = record ? pbs_points_fit(name, record, c, *have, err) : PBS_OK;
    *have += c->count;
    return rc;
}

static pbs_code take_motion(const pbs_pack *p, pack_input *in, const pbs_chunk *entry,
                            pbs_err *err) {
    pbs_chunk c;
    pbs_code rc = pbs_reader_at(in->reader, entry, &c, err);
    return rc ? rc : pbs_motions_take(p->run, pbs_reader_name(in->reader), &c, &in->motions, err);
}

static pbs_code take_chunk(const pbs_pack *p, pack_input *in, const pbs_chunk *c, counts *n,
                           pbs_err *err) {
    uint64_t ignored = 0;
    char tag[5];
    pbs_record octave = pbs_octave_record(in->record.channels);
    switch (c->tag) {
    case PBS_TAG_POINTS:
        return count_chunk(p, in, c, &n->points, &in->record, err);
    case PBS_TAG_OCTAVES:
        return count_chunk(p, in, c, &n->octaves, &octave, err);
    case PBS_TAG_VOXELS:
        return count_chunk(p, in, c, &n->voxels, NULL, err);
    case PBS_TAG_FACES: /* the survey counts them */
        return count_chunk(p, in, c, &ignored, NULL, err);
    case PBS_TAG_ANIMATION:
    case PBS_TAG_MOTION:
        return take_motion(p, in, c, err);
    case PBS_TAG_MESH:
    case PBS_TAG_TEXTURE:
        return pbs_fail(err, PBS_DATA, "%s: %s in a stream of another kind",
                        pbs_reader_name(in->reader), pbs_tag_text(c->tag, tag));
    default:
        return PBS_OK;
    }
}

static pbs_code take_stream(pbs_pack *p, int input, pbs_err *err) {
    pack_input *in = &p->inputs[input];
    const char *name = pbs_reader_name(in->reader);
    size_t first = 0;
    counts n = {0};
    pbs_code rc = PBS_OK;
    for (size_t k = 0; k < in->entry_count && !rc; k++) {
        const pbs_chunk *c = &in->entries[k];
        if (c->tag != PBS_TAG_NODE) {
            rc = take_chunk(p, in, c, &n, err);
            continue;
        }
        pack_entry e = {
            .input = input, .first_chunk = first, .end_chunk = k, .mesh_input = PACK_NOWHERE};
        rc = add_node(p, e, c, &n, err);
        first = k + 1;
        n = (counts){0};
    }
    if (!rc && (n.points || n.octaves || n.voxels))
        rc = pbs_fail(err, PBS_DATA, "%s: records without a node", name);
    if (!rc && p->entry_count == in->first_node)
        rc = pbs_fail(err, PBS_DATA, "%s: no node in it", name);
    return rc;
}

/* The triangles of a scene are its meshes' business, no records. */
static pbs_code take_scene(pbs_pack *p, int input, pbs_err *err) {
    pack_input *in = &p->inputs[input];
    size_t first = 0, node = 0;
    pbs_code rc = PBS_OK;
    for (size_t k = 0; k < in->entry_count && !rc; k++) {
        if (in->entries[k].tag != PBS_TAG_NODE) continue;
        pack_entry e = {.input = input,
                        .own = (uint32_t)node,
                        .first_chunk = first,
                        .end_chunk = k,
                        .mesh_input = input,
                        .mesh_reader = in->reader,
                        .mesh = in->entries + first,
                        .mesh_count = k - first,
                        .node = in->scene.nodes[node]};
        in->scene.nodes[node] = (pbs_node){0}; /* the table's now */
        e.node.records = 0;
        e.node.flags = 0;
        for (uint32_t c = 0; c < e.node.child_count; c++)
            e.node.children[c].node += (uint32_t)in->first_node;
        rc = add_entry(p, &e, err);
        if (rc) pbs_node_free(p->run, &e.node);
        first = k + 1;
        node++;
    }
    return rc;
}

pbs_code pack_take(pbs_pack *p, int input, pbs_err *err) {
    pack_input *in = &p->inputs[input];
    in->first_node = p->entry_count;
    pbs_code rc = in->kind == PACK_SCENE ? take_scene(p, input, err) : take_stream(p, input, err);
    in->node_count = p->entry_count - in->first_node;
    return rc;
}
