#include "formats/voxels/simplify.h"
#include "formats/scene/scene.h"
#include "libcore/voxels/morton.h"
#include <stdlib.h>
#include <string.h>

/* What becomes of the voxels of the node that is being read. */
typedef enum fate {
    NONE,   /* there are none so far */
    PASSED, /* written as they come */
    HELD,   /* on a pile until all are there: to be sorted, or because lists of faces follow */
    DROPPED /* a coarser level's */
} fate;

typedef struct reading {
    pbs_run *run;
    pbs_reader *r;
    pbs_writer *w;
    const char *file;
    pbs_levels_params params;
    uint32_t channels;
    pbs_levels levels;
    bool begun; /* levels */
    /* the node that is being read */
    uint32_t node;
    fate fate;
    pbs_voxel_place place;
    uint64_t have, faces_have;
    uint32_t last; /* place of the last voxel */
    bool sorted, face_colour;
    pbs_pile voxels, faces; /* if HELD */
    /* of the last node: the root's */
    char *name;
    uint64_t triangles;
    uint32_t grid_size; /* 0: no voxels so far */
    bool any_last;
    uint32_t last_chunk[3]; /* of the finest level */
    pbs_simplified *out;
} reading;

static pbs_code bad(const reading *d, const char *what, pbs_err *err) {
    return pbs_fail(err, PBS_DATA, "%s: voxels of node %u: %s", d->file, d->node, what);
}

/* What the functions below say of the input comes without its name. */
static pbs_code in_file(const reading *d, pbs_code rc, pbs_err *err) {
    return rc == PBS_DATA ? pbs_fail_in(err, "%s", d->file) : rc;
}

/* ---- voxels ---- */

static pbs_code begin_levels(reading *d, pbs_err *err) {
    if (d->begun) return PBS_OK;
    d->begun = true;
    return pbs_levels_begin(&d->levels, d->run, d->w, d->channels, d->face_colour, &d->place,
                            &d->params, err);
}

/* The first voxels of a finest node say where it is. */
static pbs_code check_chunk(reading *d, pbs_err *err) {
    const uint32_t *chunk = d->place.chunk;
    if (d->grid_size && d->grid_size != d->place.size) return bad(d, "another grid", err);
    if (d->any_last && !memcmp(d->last_chunk, chunk, sizeof d->last_chunk))
        return bad(d, "their chunk comes twice", err);
    if (d->any_last && !pbs_morton_before(d->last_chunk, chunk))
        return bad(d,
                   pbs_reader_mapped(d->r) ? "their chunk is not in Morton order"
                                           : "their chunk is not in Morton order; of a file, named "
                                             "as an operand, chunks are sorted",
                   err);
    d->grid_size = d->place.size;
    d->any_last = true;
    memcpy(d->last_chunk, chunk, sizeof d->last_chunk);
    return PBS_OK;
}

/* Everything but the order. */
static const char *fault_of(const pbs_voxel_place *place, const pbs_voxels *v,
                            const pbs_place_look *look) {
    for (int k = 0; k < 3; k++)
        if (place->chunk[k] * PBS_CHUNK + look->high[k] >= place->size)
            return "a cell outside the grid";
    if (look->any >> 31) return "faces that there are none of";
    if (v->weight && !pbs_are_areas(v->weight, v->count)) return "a weight that is no area";
    return NULL;
}

static pbs_code hold(reading *d, const pbs_voxels *v, pbs_err *err) {
    if (d->fate == NONE) {
        size_t memory = pbs_mem_left(d->run) / 16;
        pbs_pile_free(&d->voxels);
        pbs_pile_free(&d->faces);
        pbs_pile_begin(&d->voxels, d->run, d->channels, memory);
        pbs_pile_begin(&d->faces, d->run, PBS_POSITION, memory);
        d->fate = HELD;
        d->sorted = true;
    }
    return pbs_pile_add(&d->voxels, v, 0, err);
}

static pbs_code pass(reading *d, const pbs_chunk *c, const pbs_voxels *v, pbs_err *err) {
    pbs_code rc = begin_levels(d, err);
    if (!rc) rc = in_file(d, pbs_levels_add(&d->levels, d->place.chunk, v, NULL, 0, err), err);
    if (rc) return rc;
    d->fate = PASSED;
    pbs_chunk out = *c;
    out.node = d->levels.next;
    return pbs_writer_pass(d->w, &out, err);
}

static pbs_code take_finest(reading *d, const pbs_chunk *c, const pbs_voxels *v, pbs_err *err) {
    bool first = d->have == v->count; /* lists of faces may have come before */
    pbs_code rc = first ? check_chunk(d, err) : PBS_OK;
    if (rc) return rc;
    pbs_place_look look = PBS_LOOK_NONE;
    look.last = d->last;
    pbs_look_at_places(&look, v->place, v->count);
    const char *fault = fault_of(&d->place, v, &look);
    if (fault) return bad(d, fault, err);
    bool sorted = look.sorted;
    d->last = look.last;
    if (d->fate == PASSED && !sorted) return bad(d, "not in Morton order from here on", err);
    if (d->fate == PASSED || (d->fate == NONE && sorted && !(d->channels & PBS_FACE)))
        return pass(d, c, v, err);
    rc = hold(d, v, err);
    d->sorted = d->sorted && sorted;
    return rc;
}

static pbs_code take_voxels(reading *d, const pbs_chunk *c, pbs_err *err) {
    pbs_voxels v;
    pbs_voxel_place place;
    if (c->node != d->node) return bad(d, "voxels of another node come before it", err);
    pbs_code rc = pbs_voxels_view(d->file, d->channels, c, d->have, &place, &v, err);
    if (rc) return rc;
    if (place.levels != pbs_voxel_levels(place.size)) return bad(d, "no such grid", err);
    if (d->have && memcmp(&place, &d->place, sizeof place))
        return bad(d, "they are of two chunks", err);
    d->place = place;
    d->have += v.count;
    if (place.level) {
        d->fate = DROPPED;
        return PBS_OK;
    }
    return take_finest(d, c, &v, err);
}

static pbs_code take_faces(reading *d, const pbs_chunk *c, pbs_err *err) {
    bool colour = c->flags & PBS_VFAC_COLOUR;
    if (!(d->channels & PBS_FACE) || c->node != d->node || c->first != d->faces_have ||
        c->bytes != 4 * (uint64_t)c->count)
        return bad(d, "attributes of faces that do not belong there", err);
    d->faces_have += c->count;
    if (d->fate == DROPPED) return PBS_OK;
    if (d->begun && colour != d->face_colour)
        return bad(d, "attributes of faces of another kind", err);
    d->face_colour = colour;
    pbs_voxels none = {0};
    pbs_code rc = d->fate == NONE ? hold(d, &none, err) : PBS_OK;
    if (rc) return rc;
    return pbs_pile_add(&d->faces,
                        &(pbs_voxels){.count = c->count, .place = (uint32_t *)c->payload}, 0, err);
}

/* ---- nodes that were held ---- */

/* Voxels at a time, of a sorted pile and to be sorted. */
enum { GATHER = 4096, SORT = 1 << 20 };

/* What is worked with, and where it goes. */
typedef struct gathered {
    pbs_voxels v, cube; /* to be added; to be sorted */
    uint32_t *faces;    /* lists of v, one after the other */
    size_t face_count;
    uint32_t *order; /* of the cube */
    pbs_pile sorted;
} gathered;

static void copy_voxel(pbs_voxels *to, size_t i, const pbs_voxels *v, size_t at) {
    to->place[i] = v->place[at];
    if (to->normal) to->normal[i] = v->normal[at];
    if (to->weight) to->weight[i] = v->weight[at];
    if (to->colour) to->colour[i] = v->colour[at];
    if (to->material) to->material[i] = v->material[at];
    if (to->emissive) to->emissive[i] = v->emissive[at];
    if (to->face) to->face[i] = v->face[at];
}

static pbs_code gather_faces(const reading *d, gathered *g, pbs_err *err) {
    g->face_count = 0;
    for (size_t i = 0; i < g->v.count; i++) {
        uint32_t from = g->v.face[i];
        uint32_t n = (uint32_t)__builtin_popcount(g->v.place[i] >> 24 & PBS_FACES_ALL);
        if (from > d->faces.count || n > d->faces.count - from)
            return bad(d, "attributes of faces that are not there", err);
        g->v.face[i] = (uint32_t)g->face_count;
        for (uint32_t k = 0; k < n; k++) {
            const pbs_voxels *v;
            size_t at = pbs_pile_find(&d->faces, from + k, &v);
            g->faces[g->face_count++] = v->place[at];
        }
    }
    return PBS_OK;
}

static pbs_code add_gathered(reading *d, gathered *g, pbs_err *err) {
    pbs_code rc = g->faces ? gather_faces(d, g, err) : PBS_OK;
    if (rc) return rc;
    return in_file(
        d, pbs_levels_add(&d->levels, d->place.chunk, &g->v, g->faces, g->face_count, err), err);
}

/* A pile that is in order. */
static pbs_code add_held(reading *d, gathered *g, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (uint64_t i = 0; i < d->voxels.count && !rc; i += g->v.count) {
        uint64_t left = d->voxels.count - i;
        if (i % (GATHER * 64) == 0) {
            pbs_pile_rest(&d->voxels);
            pbs_pile_rest(&d->faces);
        }
        g->v.count = left < GATHER ? (size_t)left : GATHER;
        for (size_t k = 0; k < g->v.count; k++) {
            const pbs_voxels *v;
            size_t at = pbs_pile_find(&d->voxels, i + k, &v);
            copy_voxel(&g->v, k, v, at);
        }
        rc = add_gathered(d, g, err);
    }
    return rc;
}

/* The voxels of cubes first .. end - 1, as they come. The pile is read from front to back. */
static void collect(const reading *d, uint32_t first, uint32_t end, pbs_voxels *to) {
    to->count = 0;
    for (uint64_t i = 0; i < d->voxels.count; i++) {
        const pbs_voxels *v;
        size_t at = pbs_pile_find(&d->voxels, i, &v);
        uint32_t digit = pbs_morton_digit(v->place[at]);
        if (i % (GATHER * 256) == 0) pbs_pile_rest(&d->voxels);
        if (digit >= first && digit < end) copy_voxel(to, to->count++, v, at);
    }
}

static pbs_code add_cubes(reading *d, gathered *g, pbs_err *err) {
    const pbs_voxels *c = &g->cube;
    pbs_code rc = pbs_morton_sort(d->run, c->place, c->count, g->order, err);
    if (rc == PBS_DATA) return bad(d, "a cell comes twice", err);
    for (size_t i = 0; i < c->count && !rc; i += g->v.count) {
        g->v.count = c->count - i < GATHER ? c->count - i : GATHER;
        for (size_t k = 0; k < g->v.count; k++) copy_voxel(&g->v, k, c, g->order[i + k]);
        rc = pbs_pile_add(&g->sorted, &g->v, 0, err);
        if (!rc) rc = add_gathered(d, g, err);
    }
    pbs_pile_rest(&d->faces);
    return rc;
}

/* A pile that is not in order: as many cubes of 64^3 cells at a time as are not too many voxels. */
static pbs_code sort_held(reading *d, gathered *g, pbs_err *err) {
    uint64_t count[65] = {0};
    size_t room = d->voxels.count < SORT ? (size_t)d->voxels.count : SORT;
    for (uint64_t i = 0; i < d->voxels.count; i++) {
        const pbs_voxels *v;
        size_t at = pbs_pile_find(&d->voxels, i, &v);
        count[pbs_morton_digit(v->place[at])]++;
    }
    pbs_code rc = pbs_voxels_alloc(d->run, d->channels, room, &g->cube, err);
    if (!rc) rc = pbs_alloc(d->run, &g->order, room, 4, "the order of voxels", err);
    d->out->nodes_sorted++;
    for (uint32_t first = 0, end; first < 64 && !rc; first = end) {
        uint64_t n = count[first];
        for (end = first + 1; end < 64 && n + count[end] <= room; end++) n += count[end];
        if (n > room) return bad(d, "a cell comes twice", err);
        if (!n) continue;
        collect(d, first, end, &g->cube);
        rc = add_cubes(d, g, err);
    }
    return rc;
}

static pbs_code write_held(reading *d, pbs_err *err) {
    gathered g = {0};
    pbs_pile_begin(&g.sorted, d->run, d->channels, pbs_mem_left(d->run) / 16);
    pbs_code rc = begin_levels(d, err);
    if (!rc) rc = pbs_pile_settle(&d->voxels, err);
    if (!rc) rc = pbs_pile_settle(&d->faces, err);
    if (!rc) rc = pbs_voxels_alloc(d->run, d->channels, GATHER, &g.v, err);
    if (!rc && d->channels & PBS_FACE)
        rc = pbs_alloc(d->run, &g.faces, GATHER * 6, 4, "lists of faces", err);
    if (!rc) rc = d->sorted ? add_held(d, &g, err) : sort_held(d, &g, err);
    if (!rc)
        rc = pbs_pile_write(d->sorted ? &d->voxels : &g.sorted, d->w, d->levels.next, &d->place,
                            err);
    if (!rc && d->channels & PBS_FACE)
        rc = pbs_pile_write_faces(&d->faces, d->w, d->levels.next, d->face_colour, err);
    pbs_pile_free(&g.sorted);
    pbs_voxels_free(d->run, &g.v);
    pbs_voxels_free(d->run, &g.cube);
    pbs_free(d->run, g.faces);
    pbs_free(d->run, g.order);
    return rc;
}

/* ---- nodes ---- */

static pbs_code end_finest(reading *d, const pbs_chunk *c, const pbs_node *node, pbs_err *err) {
    pbs_code rc = PBS_OK;
    if (node->records != d->have)
        return pbs_fail(err, PBS_DATA, "%s: node %u has %llu voxels and not %llu", d->file,
                        node->id, (unsigned long long)d->have, (unsigned long long)node->records);
    if (node->child_count) return bad(d, "a finest chunk that has children", err);
    if (d->fate == HELD) rc = write_held(d, err);
    if (rc) return rc;
    pbs_chunk out = *c;
    out.node = d->levels.next;
    rc = pbs_writer_pass(d->w, &out, err);
    return rc ? rc : in_file(d, pbs_levels_finest(&d->levels, &d->place, node, err), err);
}

static pbs_code take_node(reading *d, const pbs_chunk *c, pbs_err *err) {
    pbs_node node;
    pbs_code rc = pbs_node_read(d->run, d->file, c, d->node, &node, err);
    if (rc) return rc;
    if (d->fate == PASSED || (d->fate == HELD && d->have))
        rc = end_finest(d, c, &node, err);
    else if (d->fate == HELD)
        rc = bad(d, "attributes of faces, but no voxels", err);
    pbs_free(d->run, d->name);
    d->name = (char *)node.name;
    node.name = NULL;
    d->triangles = node.triangles;
    pbs_node_free(d->run, &node);
    pbs_pile_clear(&d->voxels);
    pbs_pile_clear(&d->faces);
    d->fate = NONE;
    d->have = d->faces_have = 0;
    d->last = PBS_NO_PLACE;
    d->node++;
    return rc;
}

/* What this program does not know it passes on. Materials and textures have numbers of their own;
 * what belongs to a node follows it, or goes with it. */
static pbs_code take_other(reading *d, const pbs_chunk *c, pbs_err *err) {
    pbs_chunk out = *c;
    bool own = c->tag == PBS_TAG_MATERIAL || c->tag == PBS_TAG_TEXTURE ||
               c->tag == PBS_TAG_COUNTS || pbs_is_motion(c->tag);
    if (!own && c->node == d->node) {
        if (d->fate == DROPPED) return PBS_OK;
        if (d->fate == PASSED) out.node = d->levels.next;
    }
    return pbs_writer_pass(d->w, &out, err);
}

static pbs_code take_chunk(reading *d, const pbs_chunk *c, pbs_err *err) {
    if (c->tag == PBS_TAG_VOXELS) return take_voxels(d, c, err);
    if (c->tag == PBS_TAG_FACES) return take_faces(d, c, err);
    if (c->tag == PBS_TAG_NODE) return take_node(d, c, err);
    return take_other(d, c, err);
}

/* ---- the stream as it comes ---- */

static pbs_code read_in_order(reading *d, pbs_err *err) {
    uint64_t total = pbs_reader_mapped(d->r) ? pbs_reader_bytes(d->r) : 0, done = 0;
    for (;;) {
        pbs_chunk c;
        bool end;
        pbs_code rc = pbs_reader_next(d->r, &c, &end, err);
        if (rc || end) return rc;
        rc = take_chunk(d, &c, err);
        if (rc) return rc;
        done += c.bytes;
        pbs_run_progress(d->run, "simplifying", done, total);
    }
}

/* ---- or through its directory ---- */

typedef struct listed {
    size_t first, end; /* its chunks; the last one is the node */
    bool finest;
    uint32_t chunk[3];
    double origin[3], lattice;
} listed;

typedef struct list {
    const pbs_chunk *entry;
    size_t entries;
    listed *node;
    size_t count, cap;
    bool sorted;
} list;

static pbs_code list_node(reading *d, list *l, size_t first, size_t at, pbs_err *err) {
    pbs_chunk c;
    pbs_node node;
    bool voxels = false;
    for (size_t i = first; i < at; i++) voxels = voxels || l->entry[i].tag == PBS_TAG_VOXELS;
    pbs_code rc =
        pbs_grow(d->run, &l->node, &l->cap, l->count + 1, sizeof *l->node, "the nodes", err);
    listed *n = rc ? NULL : &l->node[l->count];
    if (rc) return rc;
    *n = (listed){.first = first, .end = at + 1};
    if (voxels) rc = pbs_reader_read(d->r, &l->entry[at], &c, err);
    if (!rc && voxels) rc = pbs_node_read(d->run, d->file, &c, (uint32_t)l->count, &node, err);
    if (!rc && voxels) {
        memcpy(n->origin, node.origin, sizeof n->origin);
        n->lattice = node.lattice;
        pbs_node_free(d->run, &node);
    }
    if (!rc) l->count++;
    return rc;
}

/* Where each chunk is follows from its node, which is small, and from the first chunk of voxels;
 * that the others are there too is checked when they are read. */
static pbs_code place_nodes(reading *d, list *l, pbs_err *err) {
    pbs_voxel_place place = {0};
    pbs_voxels v;
    pbs_chunk c;
    listed *first = l->node;
    while (first < l->node + l->count && !(first->lattice > 0)) first++;
    if (first == l->node + l->count) return PBS_OK;
    size_t i = first->first;
    while (l->entry[i].tag != PBS_TAG_VOXELS) i++;
    pbs_code rc = pbs_reader_read(d->r, &l->entry[i], &c, err);
    if (!rc) rc = pbs_voxels_view(d->file, d->channels, &c, c.first, &place, &v, err);
    if (rc) return rc;
    double finest = ldexp(first->lattice, -(int)place.level), side = finest * PBS_CHUNK;
    for (size_t k = 0; k < l->count; k++) {
        listed *n = &l->node[k];
        n->finest = n->lattice == finest;
        for (int a = 0; a < 3 && n->finest; a++) {
            double at = ldexp(place.chunk[a], (int)place.level) +
                        rint((n->origin[a] - first->origin[a]) / side);
            n->chunk[a] = at > 0 && at < PBS_GRID_MAX ? (uint32_t)at : 0;
        }
    }
    return PBS_OK;
}

static int by_chunk(const void *a, const void *b) {
    const listed *x = a, *y = b;
    if (x->finest != y->finest) return y->finest - x->finest; /* the root stays behind */
    if (x->finest && pbs_morton_before(x->chunk, y->chunk)) return -1;
    if (x->finest && pbs_morton_before(y->chunk, x->chunk)) return 1;
    return (x->first > y->first) - (x->first < y->first);
}

static bool in_order(const list *l) {
    const listed *last = NULL;
    for (size_t i = 0; i < l->count; i++) {
        const listed *n = &l->node[i];
        if (!n->finest) continue;
        if (last && !pbs_morton_before(last->chunk, n->chunk)) return false;
        last = n;
    }
    return true;
}

static pbs_code make_list(reading *d, list *l, pbs_err *err) {
    size_t first = 0;
    pbs_code rc = pbs_reader_directory(d->r, &l->entry, &l->entries, err);
    for (size_t i = 0; i < l->entries && !rc; i++) {
        if (l->entry[i].tag != PBS_TAG_NODE) continue;
        rc = list_node(d, l, first, i, err);
        first = i + 1;
    }
    if (!rc) rc = place_nodes(d, l, err);
    l->sorted = rc || in_order(l);
    return rc;
}

static pbs_code take_entry(reading *d, const pbs_chunk *entry, pbs_err *err) {
    pbs_chunk c;
    pbs_code rc = pbs_run_check(d->run, err);
    if (!rc) rc = pbs_reader_read(d->r, entry, &c, err);
    return rc ? rc : take_chunk(d, &c, err);
}

static bool of_nodes(uint32_t tag) {
    return tag == PBS_TAG_NODE || tag == PBS_TAG_VOXELS || tag == PBS_TAG_FACES;
}

static pbs_code read_listed(reading *d, list *l, pbs_err *err) {
    pbs_code rc = PBS_OK;
    d->out->ordered = true;
    d->node = UINT32_MAX;
    for (size_t i = 0; i < l->entries && !rc; i++)
        if (!of_nodes(l->entry[i].tag)) rc = take_entry(d, &l->entry[i], err);
    qsort(l->node, l->count, sizeof *l->node, by_chunk);
    for (size_t i = 0; i < l->count && !rc; i++) {
        const listed *n = &l->node[i];
        d->node = l->entry[n->end - 1].node;
        for (size_t k = n->first; k < n->end && !rc; k++)
            if (of_nodes(l->entry[k].tag)) rc = take_entry(d, &l->entry[k], err);
        pbs_run_progress(d->run, "simplifying", i, l->count);
    }
    return rc;
}

/* ---- all ---- */

static pbs_code read_all(reading *d, pbs_err *err) {
    list l = {.sorted = true};
    pbs_code rc = pbs_reader_mapped(d->r) ? make_list(d, &l, err) : PBS_OK;
    if (!rc) rc = l.sorted ? read_in_order(d, err) : read_listed(d, &l, err);
    pbs_free(d->run, l.node);
    if (rc) return rc;
    if (d->fate != NONE) return bad(d, "no node follows", err);
    if (!d->name) return pbs_fail(err, PBS_DATA, "%s: no node in it", d->file);
    d->place = d->begun ? d->place : (pbs_voxel_place){.size = 1};
    rc = begin_levels(d, err);
    return rc ? rc : in_file(d, pbs_levels_end(&d->levels, d->name, d->triangles, err), err);
}

static void add_up(const pbs_levels *s, pbs_simplified *out) {
    out->voxels = s->voxels[0];
    out->nodes = s->nodes;
    for (uint32_t l = 0; l < PBS_LEVELS_MAX; l++) {
        if (!s->voxels[l]) continue;
        out->coarser += l ? s->voxels[l] : 0;
        out->levels = l + 1;
        out->coarsest = s->voxels[l];
    }
}

pbs_code pbs_simplify(pbs_run *run, pbs_reader *r, pbs_writer *w, const pbs_levels_params *params,
                      pbs_simplified *out, pbs_err *err) {
    reading d = {.run = run,
                 .r = r,
                 .w = w,
                 .file = pbs_reader_name(r),
                 .params = *params,
                 .last = PBS_NO_PLACE,
                 .out = out};
    *out = (pbs_simplified){0};
    pbs_code rc = pbs_voxels_parse(d.file, pbs_reader_channels(r), &d.channels, err);
    if (!rc) rc = read_all(&d, err);
    if (!rc) add_up(&d.levels, out);
    pbs_levels_free(&d.levels);
    pbs_pile_free(&d.voxels);
    pbs_pile_free(&d.faces);
    pbs_free(run, d.name);
    return rc;
}
