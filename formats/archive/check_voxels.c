/* check_voxels.c: are the voxels of a file what they should be? Paper 2, section 3 asks that every
 * parent covers its children; the player relies on it. */
#include "formats/archive/check_voxels.h"
#include "libcore/voxels/grid.h"
#include <string.h>

typedef struct member {
    pbs_voxel_place place;
    uint64_t voxels, faces; /* seen so far */
    uint64_t face_end;      /* entries of the list of faces that voxels point to */
    int64_t last;           /* Morton code of the last voxel */
    size_t index;           /* of the first chunk of voxels */
    uint32_t flags;         /* of the list's chunks */
    double origin[3], cell;
    size_t children; /* where they begin in the checker's list */
    uint32_t child_count;
    bool moved; /* some child is not where it was made */
    bool adds;  /* its flag says that it is drawn with its children */
} member;

struct pbs_voxel_check {
    pbs_run *run;
    const char *name;
    uint32_t channels;
    member *nodes;
    size_t count, cap; /* nodes that are known, by their chunk or their data */
    uint32_t *children;
    size_t child_count, child_cap;
    uint32_t current;       /* node of the last chunk */
    uint64_t materials_end; /* materials that lists of faces name are below */
    pbs_reader *reader;
    const pbs_chunk *entries;
};

pbs_code pbs_voxel_check_new(pbs_run *run, const char *name, uint32_t channels,
                             pbs_voxel_check **out, pbs_err *err) {
    pbs_code rc = pbs_alloc(run, out, 1, sizeof **out, "the checker", err);
    if (!rc)
        **out =
            (pbs_voxel_check){.run = run, .name = name, .channels = channels, .current = PBS_NONE};
    return rc;
}

void pbs_voxel_check_free(pbs_voxel_check *v) {
    if (!v) return;
    pbs_free(v->run, v->nodes);
    pbs_free(v->run, v->children);
    pbs_free(v->run, v);
}

static pbs_code bad(const pbs_voxel_check *v, uint32_t node, const char *what, pbs_err *err) {
    return pbs_fail(err, PBS_DATA, "%s: voxels of node %u: %s", v->name, node, what);
}

/* In streams a node's data is before it, in archives behind it. */
static pbs_code know(pbs_voxel_check *v, uint32_t id, pbs_err *err) {
    pbs_code rc = pbs_grow(v->run, &v->nodes, &v->cap, (size_t)id + 1, sizeof *v->nodes,
                           "the table of nodes", err);
    for (; !rc && v->count <= id; v->count++) v->nodes[v->count] = (member){.last = -1};
    return rc;
}

pbs_code pbs_voxel_check_node(pbs_voxel_check *v, const pbs_node *n, pbs_err *err) {
    pbs_code rc = know(v, n->id, err);
    if (!rc)
        rc = pbs_grow(v->run, &v->children, &v->child_cap, v->child_count + n->child_count,
                      sizeof *v->children, "the table of children", err);
    if (rc) return rc;
    member *m = &v->nodes[n->id];
    memcpy(m->origin, n->origin, sizeof m->origin);
    m->cell = n->lattice;
    m->adds = n->flags & PBS_NODE_ADDS;
    m->children = v->child_count;
    m->child_count = n->child_count;
    for (uint32_t i = 0; i < n->child_count; i++) {
        v->children[v->child_count++] = n->children[i].node;
        for (int k = 0; k < 12; k++)
            if (n->children[i].m[k] != PBS_IDENTITY[k]) m->moved = true;
    }
    return PBS_OK;
}

/* ---- data ---- */

static bool same_place(const pbs_voxel_place *a, const pbs_voxel_place *b) {
    return a->level == b->level && a->levels == b->levels && a->size == b->size &&
           !memcmp(a->chunk, b->chunk, sizeof a->chunk);
}

/* PBS_NONE stands for no attributes of its own. */
static uint64_t last_face(const pbs_voxels *v) {
    uint64_t end = 0;
    for (size_t i = 0; v->face && i < v->count; i++) {
        if (v->face[i] == PBS_NONE) continue;
        uint32_t faces = v->place[i] >> 24 & PBS_FACES_ALL;
        uint64_t after = (uint64_t)v->face[i] + (uint64_t)__builtin_popcount(faces);
        if (after > end) end = after;
    }
    return end;
}

static pbs_code check_voxels(pbs_voxel_check *v, member *m, const pbs_chunk *c, size_t index,
                             pbs_err *err) {
    pbs_voxel_place place;
    pbs_voxels some;
    pbs_code rc = pbs_voxels_view(v->name, v->channels, c, m->voxels, &place, &some, err);
    if (rc) return rc;
    if (!m->voxels) m->place = place, m->index = index;
    if (!same_place(&m->place, &place)) return bad(v, c->node, "they are of several chunks", err);
    const char *fault = pbs_voxels_fault(&place, &some, &m->last);
    if (fault) return bad(v, c->node, fault, err);
    uint64_t end = last_face(&some);
    if (end > m->face_end) m->face_end = end;
    m->voxels += c->count;
    return PBS_OK;
}

static pbs_code check_faces(pbs_voxel_check *v, member *m, const pbs_chunk *c, pbs_err *err) {
    uint32_t flags = c->flags & PBS_VFAC_COLOUR;
    if (c->bytes != (uint64_t)c->count * 4 || c->first != m->faces || !c->count)
        return bad(v, c->node, "lists of faces do not go on where the last ones ended", err);
    if (m->faces && flags != m->flags) return bad(v, c->node, "lists of faces of two kinds", err);
    if (!(v->channels & PBS_FACE))
        return bad(v, c->node, "lists of faces that nothing points to", err);
    m->flags = flags;
    m->faces += c->count;
    const uint32_t *id = c->payload;
    for (uint32_t i = 0; !flags && i < c->count; i++)
        if (id[i] != PBS_NONE && id[i] >= v->materials_end) v->materials_end = (uint64_t)id[i] + 1;
    return PBS_OK;
}

pbs_code pbs_voxel_check_chunk(pbs_voxel_check *v, const pbs_chunk *c, size_t index, pbs_err *err) {
    pbs_code rc = know(v, c->node, err);
    if (rc) return rc;
    member *m = &v->nodes[c->node];
    if (v->current != c->node && (m->voxels || m->faces))
        return bad(v, c->node, "some are apart from the others", err);
    v->current = c->node;
    return c->tag == PBS_TAG_VOXELS ? check_voxels(v, m, c, index, err) : check_faces(v, m, c, err);
}

/* ---- levels of detail ---- */

/* The voxels of a node, one after the other. */
typedef struct cursor {
    const pbs_voxel_check *v;
    const member *m;
    size_t index, at;
    uint64_t have; /* voxels in chunks so far */
    pbs_voxels view;
    void *own; /* the unpacked payload that view points into */
} cursor;

static cursor begin(const pbs_voxel_check *v, const member *m) {
    return (cursor){.v = v, .m = m, .index = m->index};
}

/* What it reads was checked before. *end: there was no more. */
static pbs_code next_voxel(cursor *c, uint32_t *place, bool *end, pbs_err *err) {
    if (c->at == c->view.count) {
        pbs_chunk chunk;
        pbs_voxel_place where;
        if ((*end = c->have == c->m->voxels)) return PBS_OK;
        while (c->v->entries[c->index].tag != PBS_TAG_VOXELS) c->index++;
        pbs_free(c->v->run, c->own);
        pbs_code rc =
            pbs_reader_load(c->v->reader, &c->v->entries[c->index++], &chunk, &c->own, err);
        if (!rc)
            rc =
                pbs_voxels_view(c->v->name, c->v->channels, &chunk, c->have, &where, &c->view, err);
        if (rc) return rc;
        c->have += c->view.count;
        c->at = 0;
    }
    *place = c->view.place[c->at++];
    *end = false;
    return PBS_OK;
}

/* The next voxel of the parent is this cell, and has these faces. */
static pbs_code expect(cursor *parent, uint32_t id, uint32_t code, uint32_t faces, pbs_err *err) {
    uint32_t place = 0;
    bool end;
    pbs_code rc = next_voxel(parent, &place, &end, err);
    if (rc) return rc;
    if (end || pbs_morton8(place) != code)
        return bad(parent->v, id, "they are not those that their children make", err);
    if (faces & ~(place >> 24))
        return bad(parent->v, id, "a face of their children is missing", err);
    return PBS_OK;
}

/* All come in Morton order, so both sides are walked once. octant: PBS_NONE for none. */
static pbs_code check_cover(const pbs_voxel_check *v, uint32_t id, const uint32_t octant[8],
                            pbs_err *err) {
    cursor parent = begin(v, &v->nodes[id]);
    pbs_code rc = PBS_OK;
    for (uint32_t o = 0; o < 8 && !rc; o++) {
        if (octant[o] == PBS_NONE) continue;
        cursor child = begin(v, &v->nodes[octant[o]]);
        uint32_t place = 0, code = PBS_NONE, faces = 0;
        bool end = false;
        while (!(rc = next_voxel(&child, &place, &end, err)) && !end) {
            uint32_t above = o << 21 | pbs_morton8(place) >> 3;
            if (above != code && code != PBS_NONE && (rc = expect(&parent, id, code, faces, err)))
                break;
            faces = (above == code ? faces : 0) | (place >> 24 & PBS_FACES_ALL);
            code = above;
        }
        if (!rc) rc = expect(&parent, id, code, faces, err);
        pbs_free(v->run, child.own);
    }
    bool end = true;
    uint32_t place;
    if (!rc) rc = next_voxel(&parent, &place, &end, err);
    pbs_free(v->run, parent.own);
    return rc || end ? rc : bad(v, id, "they are not those that their children make", err);
}

/* Which eighth of m the child is, or 8 if it is none. */
static uint32_t octant_of(const member *m, const member *c) {
    uint32_t octant = 0;
    bool fits = c->voxels && c->place.level + 1 == m->place.level &&
                c->place.levels == m->place.levels && c->place.size == m->place.size &&
                c->cell * 2 == m->cell;
    for (int k = 0; k < 3; k++) {
        uint32_t half = c->place.chunk[k] & 1;
        double at = m->origin[k] + half * (PBS_CHUNK * c->cell);
        fits = fits && c->place.chunk[k] >> 1 == m->place.chunk[k];
        /* Computed in another order: at most a few roundings apart. */
        fits = fits && fabs(c->origin[k] - at) <= c->cell / 2 + 1e-14 * fabs(at);
        octant |= half << k;
    }
    return fits ? octant : 8;
}

static pbs_code check_family(const pbs_voxel_check *v, uint32_t id, pbs_err *err) {
    const member *m = &v->nodes[id];
    uint32_t octant[8];
    memset(octant, 255, sizeof octant);
    if (m->moved) return bad(v, id, "a child is moved", err);
    for (uint32_t i = 0; i < m->child_count; i++) {
        uint32_t c = v->children[m->children + i], o = octant_of(m, &v->nodes[c]);
        if (o == 8 || octant[o] != PBS_NONE)
            return bad(v, id, "a child is not an eighth of it, one level finer", err);
        octant[o] = c;
    }
    return v->reader && m->child_count ? check_cover(v, id, octant, err) : PBS_OK;
}

pbs_code pbs_voxel_check_end(pbs_voxel_check *v, uint32_t materials, pbs_reader *r,
                             const pbs_chunk *entries, pbs_err *err) {
    pbs_code rc = PBS_OK;
    if (v->materials_end > materials)
        return pbs_fail(err, PBS_DATA, "%s: a face has a material that is not there", v->name);
    v->reader = r;
    v->entries = entries;
    for (size_t i = 0; i < v->count && !rc; i++) {
        const member *m = &v->nodes[i];
        if (m->face_end > m->faces)
            rc = bad(v, (uint32_t)i, "faces beyond the end of their list", err);
        else if (m->voxels && !(m->cell > 0))
            rc = bad(v, (uint32_t)i, "the node says no side of cells", err);
        else if (m->voxels && m->adds)
            rc = bad(v, (uint32_t)i, "the node's flag says that they are points of a cloud", err);
        else if (m->voxels)
            rc = check_family(v, (uint32_t)i, err);
        if (!rc && i % 64 == 0) rc = pbs_run_check(v->run, err);
    }
    return rc;
}
