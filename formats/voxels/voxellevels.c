#include "formats/voxels/voxellevels.h"
#include <string.h>

/* ---- nodes ---- */

static void add_box(pbs_box *to, const pbs_box *b) {
    if (pbs_box_is_empty(b)) return;
    pbs_box_add(to, b->min);
    pbs_box_add(to, b->max);
}

/* A node is a child of the chunk above it, or of the root. */
static pbs_code note_node(pbs_levels *s, uint32_t l, const pbs_node *n, bool above, pbs_err *err) {
    s->voxels[l] += n->records;
    s->nodes++;
    s->next++;
    if (above) {
        pbs_level_out *up = &s->level[l + 1];
        if (up->child_count == 8) return pbs_fail(err, PBS_DATA, "a chunk of voxels comes twice");
        up->child[up->child_count++] = n->id;
        add_box(&up->below, &n->box);
        return PBS_OK;
    }
    pbs_code rc = pbs_grow(s->run, &s->top, &s->top_cap, s->top_count + 1, sizeof *s->top,
                           "the coarsest chunks", err);
    if (rc) return rc;
    s->top[s->top_count] = (pbs_child){.node = n->id};
    memcpy(s->top[s->top_count++].m, PBS_IDENTITY, sizeof PBS_IDENTITY);
    add_box(&s->box, &n->box);
    return PBS_OK;
}

/* Whether a chunk of level l with so many voxels has one above it. */
static bool goes_on(pbs_levels *s, uint32_t l, uint64_t voxels) {
    bool more = l < s->made && (l < s->whole || voxels > s->params.least);
    if (!more && l >= s->whole) s->last = l;
    return more;
}

static void reset(pbs_levels *s, uint32_t l) {
    pbs_level_out *o = &s->level[l];
    pbs_pile_clear(&o->voxels);
    pbs_pile_clear(&o->faces);
    o->look = PBS_LOOK_NONE;
    o->child_count = 0;
    o->below = PBS_BOX_EMPTY;
}

static pbs_code end_chunk(pbs_levels *s, uint32_t l, const uint32_t chunk[3], pbs_err *err) {
    pbs_level_out *o = &s->level[l];
    pbs_voxel_place place = {l, s->whole, s->size, {chunk[0], chunk[1], chunk[2]}};
    pbs_child child[8];
    pbs_node n =
        pbs_voxel_node(&s->grid, &place, s->next, o->voxels.count, o->look.low, o->look.high);
    bool above = goes_on(s, l, o->voxels.count);
    add_box(&n.box, &o->below);
    if (!above && l >= s->whole) {
        s->rooted = true;
        n.name = s->name;
        n.triangles = s->triangles;
    }
    n.children = child;
    for (; n.child_count < o->child_count; n.child_count++) {
        child[n.child_count] = (pbs_child){.node = o->child[n.child_count]};
        memcpy(child[n.child_count].m, PBS_IDENTITY, sizeof PBS_IDENTITY);
    }
    pbs_code rc = pbs_pile_write(&o->voxels, s->w, s->next, &place, err);
    if (!rc && s->channels & PBS_FACE)
        rc = pbs_pile_write_faces(&o->faces, s->w, s->next, s->face_colour, err);
    if (!rc) rc = pbs_node_write(s->run, s->w, &n, err);
    if (!rc) rc = note_node(s, l, &n, above, err);
    reset(s, l);
    return rc;
}

static pbs_code take_faces(pbs_level_out *o, const uint32_t *faces, size_t n, pbs_err *err) {
    if (o->faces.count + n > UINT32_MAX)
        return pbs_fail(err, PBS_LIMIT, "more than 2^32 attributes of faces in a chunk");
    return pbs_pile_add(&o->faces, &(pbs_voxels){.count = n, .place = (uint32_t *)faces}, 0, err);
}

static pbs_code take(void *ctx, uint32_t l, const uint32_t chunk[3], const pbs_voxels *v,
                     const uint32_t *faces, size_t face_count, bool done, pbs_err *err) {
    pbs_levels *s = ctx;
    pbs_level_out *o = &s->level[l];
    if (l > s->last) return PBS_OK;
    pbs_look_at_places(&o->look, v->place, v->count);
    pbs_code rc = pbs_pile_add(&o->voxels, v, (uint32_t)o->faces.count, err);
    if (!rc && v->face) rc = take_faces(o, faces, face_count, err);
    return rc || !done ? rc : end_chunk(s, l, chunk, err);
}

/* ---- all of them ---- */

pbs_code pbs_levels_begin(pbs_levels *s, pbs_run *run, pbs_writer *w, uint32_t channels,
                          bool face_colour, const pbs_voxel_place *place,
                          const pbs_levels_params *params, pbs_err *err) {
    *s = (pbs_levels){.run = run,
                      .w = w,
                      .params = *params,
                      .channels = channels,
                      .face_colour = face_colour,
                      .size = place->size,
                      .whole = pbs_voxel_levels(place->size),
                      .last = UINT32_MAX,
                      .box = PBS_BOX_EMPTY};
    uint32_t all = s->whole + 8; /* 256 cells along an axis become one */
    s->made = params->most < all ? params->most : all;
    /* Every level may hold as much as a part is large, and so may its faces. */
    size_t memory = pbs_mem_left(run) / (3 * (s->made + 1));
    for (uint32_t l = 1; l <= s->made; l++) {
        pbs_pile_begin(&s->level[l].voxels, run, channels, memory);
        pbs_pile_begin(&s->level[l].faces, run, PBS_POSITION, memory / 4);
        reset(s, l);
    }
    pbs_coarsen_sink sink = {s, take};
    return pbs_coarsen_new(run, channels, s->made, face_colour, &sink, &s->coarsen, err);
}

pbs_code pbs_levels_add(pbs_levels *s, const uint32_t chunk[3], const pbs_voxels *v,
                        const uint32_t *faces, size_t face_count, pbs_err *err) {
    return pbs_coarsen_add(s->coarsen, chunk, v, faces, face_count, err);
}

pbs_code pbs_levels_finest(pbs_levels *s, const pbs_voxel_place *place, const pbs_node *node,
                           pbs_err *err) {
    double side = node->lattice * PBS_CHUNK;
    bool fits = node->lattice > 0;
    if (fits && !(s->grid.voxel > 0)) {
        s->grid = (pbs_grid){.voxel = node->lattice, .size = s->size};
        for (int k = 0; k < 3; k++) s->grid.min[k] = node->origin[k] - side * place->chunk[k];
    }
    fits = fits && node->lattice == s->grid.voxel;
    for (int k = 0; k < 3; k++) {
        double expected = s->grid.min[k] + side * place->chunk[k];
        fits = fits && fabs(node->origin[k] - expected) <= node->lattice / 64;
    }
    if (!fits) return pbs_fail(err, PBS_DATA, "node %u is not in the grid of the others", node->id);
    pbs_node n = *node;
    n.id = s->next;
    return note_node(s, 0, &n, goes_on(s, 0, n.records), err);
}

pbs_code pbs_levels_end(pbs_levels *s, const char *name, uint64_t triangles, pbs_err *err) {
    s->name = name;
    s->triangles = triangles;
    pbs_code rc = pbs_coarsen_end(s->coarsen, err);
    if (rc || s->rooted) return rc;
    pbs_node root = {.id = s->next,
                     .name = name,
                     .box = s->box,
                     .triangles = triangles,
                     .child_count = (uint32_t)s->top_count,
                     .children = s->top};
    s->nodes++;
    return pbs_node_write(s->run, s->w, &root, err);
}

void pbs_levels_free(pbs_levels *s) {
    if (!s->run) return;
    for (int l = 0; l < PBS_LEVELS_MAX; l++) {
        pbs_pile_free(&s->level[l].voxels);
        pbs_pile_free(&s->level[l].faces);
    }
    pbs_coarsen_free(s->coarsen);
    pbs_free(s->run, s->top);
}
