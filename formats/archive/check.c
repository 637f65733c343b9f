#include "formats/archive/check.h"
#include "formats/archive/archive.h"
#include "formats/archive/check_points.h"
#include "formats/archive/check_voxels.h"
#include "formats/scene/meshbits.h"
#include "formats/scene/meshbuild.h"
#include "formats/scene/scene.h"
#include <string.h>

typedef struct node_state {
    uint64_t records;   /* seen so far */
    uint64_t promised;  /* by the node; in archives it comes first */
    uint64_t entries;   /* of octaves, seen so far */
    uint64_t triangles; /* in archives: of its meshes, which are no records of its */
    uint32_t tag;       /* of the chunks that its records are in */
    pbs_lattice lattice;
} node_state;

typedef struct state {
    pbs_run *run;
    pbs_reader *r;
    const char *name;
    pbs_record record;       /* stride 0: the file has no points */
    pbs_voxel_check *voxels; /* NULL: nor voxels */
    bool archive;
    const pbs_chunk *entries; /* of the directory; NULL: a pipe */
    size_t entry_count;
    node_state *nodes;
    size_t cap;
    uint32_t textures, materials; /* so far */
    uint64_t textures_end;        /* textures that materials name are below */
    pbs_motions motions;          /* so far; their keys are gone */
    uint32_t motions_end;         /* motions that placings name are below */
    pbs_checked *out;
} state;

static pbs_code bad(const state *s, const pbs_chunk *c, const char *what, pbs_err *err) {
    char tag[5];
    return pbs_fail(err, PBS_DATA, "%s: byte %llu: chunk %s of node %u: %s", s->name,
                    (unsigned long long)c->offset, pbs_tag_text(c->tag, tag), c->node, what);
}

static pbs_code check_entry(state *s, const pbs_chunk *c, uint64_t i, pbs_err *err) {
    if (!s->entries) return PBS_OK;
    if (i >= s->entry_count) return bad(s, c, "not in the directory", err);
    const pbs_chunk *e = &s->entries[i];
    if (e->tag != c->tag || e->flags != c->flags || e->node != c->node || e->count != c->count ||
        e->offset != c->offset || e->stored != c->stored || e->codec != c->codec ||
        e->crc != c->crc || e->first != c->first)
        return bad(s, c, "differs from the directory", err);
    return PBS_OK;
}

static pbs_code room_for_node(state *s, uint32_t id, pbs_err *err) {
    size_t old = s->cap;
    pbs_code rc = pbs_grow(s->run, &s->nodes, &s->cap, (size_t)id + 1, sizeof *s->nodes,
                           "the table of nodes", err);
    if (!rc) memset(s->nodes + old, 0, (s->cap - old) * sizeof *s->nodes);
    return rc;
}

static pbs_code check_points(state *s, const pbs_chunk *c, pbs_err *err) {
    pbs_points p;
    if (!s->record.stride) return bad(s, c, "points in a file of another kind", err);
    node_state *n = &s->nodes[c->node];
    if (n->records != c->first) return bad(s, c, "does not follow the points before", err);
    if (s->archive && !c->count) return bad(s, c, "has no points", err);
    if (c->bytes != (uint64_t)c->count * s->record.stride)
        return bad(s, c, "has not the size of its points", err);
    /* One chunk at a time: pretend that it is the first. */
    pbs_chunk one = *c;
    one.first = 0;
    pbs_code rc = pbs_points_alloc(s->run, s->record.channels, c->count, &p, err);
    if (rc) return rc;
    p.count = 0;
    if (s->record.packed && !(n->lattice.step > 0)) rc = bad(s, c, "its node has no lattice", err);
    if (!rc) rc = pbs_points_read(s->name, &s->record, &one, &p, &n->lattice, err);
    const char *fault = rc ? NULL : pbs_points_fault(&p, 0);
    if (fault) rc = bad(s, c, fault, err);
    pbs_points_free(s->run, &p);
    n->records += c->count;
    s->out->records += c->count;
    return rc;
}

static pbs_code check_octaves(state *s, const pbs_chunk *c, pbs_err *err) {
    if (!s->record.stride) return bad(s, c, "octaves in a file of another kind", err);
    node_state *n = &s->nodes[c->node];
    pbs_record entry = pbs_octave_record(s->record.channels);
    if (n->entries != c->first || c->bytes != (uint64_t)c->count * entry.stride || !entry.stride)
        return bad(s, c, "does not fit the octaves before", err);
    n->entries += c->count;
    return PBS_OK;
}

static pbs_code check_voxels(state *s, const pbs_chunk *c, pbs_err *err) {
    if (!s->voxels) return bad(s, c, "voxels in a file of another kind", err);
    if (c->tag == PBS_TAG_VOXELS) {
        s->nodes[c->node].records += c->count;
        s->out->records += c->count;
    }
    /* chunks counts this one */
    return pbs_voxel_check_chunk(s->voxels, c, (size_t)s->out->chunks - 1, err);
}

/* In streams a node follows its points; in archives it comes before them. */
static pbs_code check_node(state *s, const pbs_chunk *c, pbs_err *err) {
    pbs_node n;
    pbs_code rc = pbs_node_read(s->run, s->name, c, (uint32_t)s->out->nodes, &n, err);
    if (!rc) rc = room_for_node(s, n.id, err);
    if (!rc) {
        node_state *known = &s->nodes[n.id];
        s->out->nodes++;
        known->promised = n.records;
        for (uint32_t i = 0; i < n.child_count; i++)
            if (n.children[i].motion > s->motions_end) s->motions_end = n.children[i].motion;
        memcpy(known->lattice.min, n.lattice_min, sizeof n.lattice_min);
        known->lattice.step = n.lattice;
        if (!s->archive && known->records != n.records)
            rc = bad(s, c, "has not as many records as it says", err);
        if (!rc && s->voxels) rc = pbs_voxel_check_node(s->voxels, &n, err);
    }
    pbs_node_free(s->run, &n);
    return rc;
}

/* What a mesh says of its lattice, in front of its arrays and in its flags, and keeps. */
static pbs_code check_lattice(const state *s, const pbs_chunk *c, pbs_err *err) {
    pbs_mesh_lattice l;
    const uint8_t *payload = c->payload;
    double step = pbs_mesh_flags_step(c->flags);
    bool has = pbs_mesh_has_lattice(payload);
    if (!has && step == 0) return PBS_OK;
    if (!s->archive) return bad(s, c, "a lattice elsewhere than in an archive", err);
    if (!has || !pbs_mesh_lattice_get(payload, (size_t)c->bytes, &l) || l.step != step)
        return bad(s, c, "its lattice is not what it says", err);
    return pbs_mesh_on_lattice(payload, (size_t)c->bytes)
               ? PBS_OK
               : bad(s, c, "its numbers are not on its lattice", err);
}

/* In archives a node has meshes beside its records. */
static pbs_code check_mesh(state *s, const pbs_chunk *c, pbs_err *err) {
    pbs_mesh m;
    node_state *n = &s->nodes[c->node];
    if (s->archive && n->triangles != c->first)
        return bad(s, c, "does not follow the meshes before", err);
    if (s->archive && !c->count) return bad(s, c, "has no triangles", err);
    *(s->archive ? &n->triangles : &n->records) += c->count;
    s->out->records += c->count;
    pbs_code rc = pbs_mesh_parse(s->name, c, &m, err);
    if (!rc && !pbs_mesh_materials_fit(&m, s->materials))
        rc = bad(s, c, "there is no such material", err);
    return rc ? rc : check_lattice(s, c, err);
}

/* Elsewhere than in scenes textures come later, or stay behind in the scene. */
static pbs_code check_material(state *s, const pbs_chunk *c, pbs_err *err) {
    pbs_material m;
    uint32_t textures = pbs_reader_kind(s->r) == PBS_SCENE ? s->textures : PBS_NONE;
    bool ok = c->node == s->materials++ && pbs_material_parse(c, textures, &m);
    if (!ok) return bad(s, c, "is not a material", err);
    const uint32_t used[3] = {m.base_texture.texture, m.material_texture.texture,
                              m.emissive_texture.texture};
    for (int i = 0; i < 3; i++)
        if (used[i] != PBS_NONE && used[i] >= s->textures_end)
            s->textures_end = (uint64_t)used[i] + 1;
    return PBS_OK;
}

static pbs_code check_texture(state *s, const pbs_chunk *c, pbs_err *err) {
    bool ok = c->node == s->textures++ && pbs_texture_parse(c);
    return ok ? PBS_OK : bad(s, c, "is not a texture", err);
}

/* A chunk of a node's data is where its node is, and all of the node's records are of one sort; in
 * archives it may have meshes besides. */
static pbs_code check_data(state *s, const pbs_chunk *c, pbs_err *err) {
    bool mesh = c->tag == PBS_TAG_MESH,
         record = c->tag == PBS_TAG_POINTS || mesh || c->tag == PBS_TAG_VOXELS;
    pbs_code rc = PBS_OK;
    if (!record && c->tag != PBS_TAG_OCTAVES && c->tag != PBS_TAG_FACES) return PBS_OK;
    if (s->archive && c->node >= s->out->nodes)
        return bad(s, c, "there is no such node before it", err);
    if (!s->archive) {
        if (c->node != s->out->nodes) return bad(s, c, "its node comes elsewhere", err);
        rc = room_for_node(s, c->node, err);
    }
    if (rc || !record || (mesh && s->archive)) return rc;
    node_state *n = &s->nodes[c->node];
    if (n->tag && n->tag != c->tag) return bad(s, c, "its node has records of another sort", err);
    n->tag = c->tag;
    return PBS_OK;
}

static pbs_code check_chunk(state *s, const pbs_chunk *c, pbs_err *err) {
    pbs_code rc = check_data(s, c, err);
    if (rc) return rc;
    if (c->tag == PBS_TAG_NODE) return check_node(s, c, err);
    if (c->tag == PBS_TAG_POINTS) return check_points(s, c, err);
    if (c->tag == PBS_TAG_OCTAVES) return check_octaves(s, c, err);
    if (c->tag == PBS_TAG_MESH) return check_mesh(s, c, err);
    if (c->tag == PBS_TAG_VOXELS || c->tag == PBS_TAG_FACES) return check_voxels(s, c, err);
    if (c->tag == PBS_TAG_MATERIAL) return check_material(s, c, err);
    if (c->tag == PBS_TAG_TEXTURE) return check_texture(s, c, err);
    if (pbs_is_motion(c->tag)) return pbs_motions_take(s->run, s->name, c, &s->motions, err);
    return PBS_OK;
}

static pbs_code check_promises(const state *s, pbs_err *err) {
    pbs_record entry = pbs_octave_record(s->record.channels);
    if (s->archive && s->textures && s->textures_end > s->textures)
        return pbs_fail(err, PBS_DATA, "%s: a material names texture %llu, which is not there",
                        s->name, (unsigned long long)s->textures_end - 1);
    if (s->motions_end > s->motions.count)
        return pbs_fail(err, PBS_DATA, "%s: a placing names motion %u, which is not there", s->name,
                        s->motions_end - 1);
    for (uint64_t i = 0; i < s->out->nodes; i++) {
        uint64_t entries = s->nodes[i].entries;
        if (entries && entries != pbs_octave_entries(&entry, s->nodes[i].records))
            return pbs_fail(err, PBS_DATA, "%s: node %llu has %llu entries of octaves and not %llu",
                            s->name, (unsigned long long)i, (unsigned long long)entries,
                            (unsigned long long)pbs_octave_entries(&entry, s->nodes[i].records));
        if (s->nodes[i].records != s->nodes[i].promised)
            return pbs_fail(err, PBS_DATA, "%s: node %llu has %llu records of %llu", s->name,
                            (unsigned long long)i, (unsigned long long)s->nodes[i].records,
                            (unsigned long long)s->nodes[i].promised);
    }
    return PBS_OK;
}

static pbs_code check_all(state *s, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (uint64_t i = 0; !rc; i++) {
        pbs_chunk c;
        bool end;
        rc = pbs_reader_next(s->r, &c, &end, err);
        if (rc || end) break;
        s->out->chunks++;
        rc = check_entry(s, &c, i, err);
        if (!rc) rc = check_chunk(s, &c, err);
    }
    if (!rc && s->entries && s->out->chunks != s->entry_count)
        rc = pbs_fail(err, PBS_DATA, "%s: the directory lists chunks that are not there", s->name);
    if (!rc && s->archive && s->textures && s->textures_end > s->textures)
        rc = pbs_fail(err, PBS_DATA, "%s: a material has a texture that is not there", s->name);
    if (!rc && !s->out->nodes) rc = pbs_fail(err, PBS_DATA, "%s: no node in it", s->name);
    if (!rc) rc = check_promises(s, err);
    if (!rc && s->archive && s->entries && s->record.stride)
        rc = pbs_check_clouds(s->run, s->r, &s->record, s->entries, s->entry_count, err);
    return rc || !s->voxels ? rc
                            : pbs_voxel_check_end(s->voxels, s->materials, s->entries ? s->r : NULL,
                                                  s->entries, err);
}

/* What the file says that it has. */
static pbs_code read_channels(state *s, pbs_kind kind, uint32_t *voxels, pbs_err *err) {
    const char *text = pbs_reader_channels(s->r);
    if (kind == PBS_CANDIDATES || kind == PBS_SURFELS)
        return pbs_record_parse(s->name, text, &s->record, err);
    if (kind == PBS_VOXELS) return pbs_voxels_parse(s->name, text, voxels, err);
    return s->archive ? pbs_archive_parse(s->name, text, &s->record, voxels, err) : PBS_OK;
}

static pbs_code start(state *s, pbs_err *err) {
    pbs_kind kind = pbs_reader_kind(s->r);
    s->name = pbs_reader_name(s->r);
    s->archive = kind == PBS_ARCHIVE;
    uint32_t voxels = 0;
    pbs_code rc = read_channels(s, kind, &voxels, err);
    if (!rc && s->record.packed && !s->archive)
        rc = pbs_fail(err, PBS_DATA, "%s: its records are not those of its kind", s->name);
    if (!rc && voxels) rc = pbs_voxel_check_new(s->run, s->name, voxels, &s->voxels, err);
    if (!rc && pbs_reader_mapped(s->r))
        rc = pbs_reader_directory(s->r, &s->entries, &s->entry_count, err);
    return rc;
}

pbs_code pbs_check_file(pbs_run *run, pbs_input *in, pbs_checked *out, pbs_err *err) {
    memset(out, 0, sizeof *out);
    state s = {.run = run, .out = out};
    pbs_code rc = pbs_reader_open(run, in, (1u << PBS_KINDS) - 1, &s.r, err);
    if (rc) return rc;
    rc = start(&s, err);
    if (!rc) rc = check_all(&s, err);
    out->bytes = pbs_reader_bytes(s.r);
    pbs_voxel_check_free(s.voxels);
    pbs_free(run, s.nodes);
    pbs_motions_free(run, &s.motions);
    pbs_reader_close(s.r);
    return rc;
}
