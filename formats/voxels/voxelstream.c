#include "formats/voxels/voxelstream.h"
#include <string.h>

uint32_t pbs_voxel_levels(uint32_t size) {
    uint32_t levels = 0;
    while ((uint64_t)PBS_CHUNK << levels < size) levels++;
    return levels;
}

pbs_node pbs_voxel_node(const pbs_grid *grid, const pbs_voxel_place *place, uint32_t id,
                        uint64_t voxels, const uint8_t low[3], const uint8_t high[3]) {
    pbs_node n = {.id = id, .name = "", .records = voxels, .box = PBS_BOX_EMPTY};
    n.lattice = ldexp(grid->voxel, (int)place->level);
    for (int k = 0; k < 3; k++) {
        n.origin[k] = grid->min[k] + n.lattice * PBS_CHUNK * place->chunk[k];
        if (!voxels) continue;
        n.box.min[k] = n.origin[k] + n.lattice * low[k];
        n.box.max[k] = n.origin[k] + n.lattice * (high[k] + 1);
    }
    return n;
}

void pbs_voxelstream_begin(pbs_voxelstream *s, pbs_run *run, pbs_writer *w, const pbs_grid *grid,
                           uint32_t channels, bool face_colour) {
    *s = (pbs_voxelstream){.run = run,
                           .w = w,
                           .grid = *grid,
                           .channels = channels,
                           .face_colour = face_colour,
                           .place = {0, pbs_voxel_levels(grid->size), grid->size, {0, 0, 0}},
                           .box = PBS_BOX_EMPTY};
}

void pbs_voxelstream_free(pbs_voxelstream *s) {
    if (!s->run) return;
    pbs_voxels_free(s->run, &s->held);
    pbs_free(s->run, s->faces);
    pbs_free(s->run, s->children);
}

static uint32_t node_id(const pbs_voxelstream *s) {
    return (uint32_t)s->child_count;
}

static pbs_code flush(pbs_voxelstream *s, pbs_err *err) {
    pbs_code rc = pbs_voxels_write(s->w, node_id(s), &s->place, &s->held, s->written, err);
    if (!rc)
        rc = pbs_faces_write(s->w, node_id(s), s->face_colour, s->faces, s->face_count,
                             s->faces_written, err);
    s->written += s->held.count;
    s->faces_written += s->face_count;
    s->held.count = s->face_count = 0;
    return rc;
}

/* The open chunk becomes a node, if there is anything in it. */
static pbs_code close_chunk(pbs_voxelstream *s, pbs_err *err) {
    pbs_code rc = flush(s, err);
    if (rc || !s->written) return rc;
    pbs_node n = pbs_voxel_node(&s->grid, &s->place, node_id(s), s->written, s->low, s->high);
    rc = pbs_node_write(s->run, s->w, &n, err);
    if (!rc)
        rc = pbs_grow(s->run, &s->children, &s->child_cap, s->child_count + 1, sizeof *s->children,
                      "the list of chunks", err);
    if (rc) return rc;
    pbs_box_add(&s->box, n.box.min);
    pbs_box_add(&s->box, n.box.max);
    pbs_child *c = &s->children[s->child_count++];
    *c = (pbs_child){.node = n.id};
    memcpy(c->m, PBS_IDENTITY, sizeof c->m);
    s->voxels += s->written;
    s->written = s->faces_written = 0;
    return PBS_OK;
}

static pbs_code go_to(pbs_voxelstream *s, const uint32_t at[3], pbs_err *err) {
    uint32_t chunk[3] = {at[0] / PBS_CHUNK, at[1] / PBS_CHUNK, at[2] / PBS_CHUNK};
    if (!memcmp(chunk, s->place.chunk, sizeof chunk)) return PBS_OK;
    pbs_code rc = close_chunk(s, err);
    memcpy(s->place.chunk, chunk, sizeof chunk);
    return rc;
}

static void take_bounds(pbs_voxelstream *s, const pbs_voxels *v) {
    if (!s->written && !s->held.count) {
        memset(s->low, 255, 3);
        memset(s->high, 0, 3);
    }
    for (size_t i = 0; i < v->count; i++)
        for (int k = 0; k < 3; k++) {
            uint8_t c = (uint8_t)(v->place[i] >> 8 * k);
            if (c < s->low[k]) s->low[k] = c;
            if (c > s->high[k]) s->high[k] = c;
        }
}

/* The block's list of faces goes behind those of the chunk. */
static pbs_code take_faces(pbs_voxelstream *s, uint32_t *index, size_t n, const uint32_t *faces,
                           size_t face_count, pbs_err *err) {
    uint64_t base = s->faces_written + s->face_count;
    if (base + face_count > UINT32_MAX)
        return pbs_fail(err, PBS_LIMIT, "more than 2^32 attributes of faces in a chunk");
    for (size_t i = 0; i < n; i++) index[i] += (uint32_t)base;
    pbs_code rc = pbs_grow(s->run, &s->faces, &s->face_cap, s->face_count + face_count,
                           sizeof *s->faces, "the attributes of faces", err);
    if (rc || !face_count) return rc;
    memcpy(s->faces + s->face_count, faces, face_count * sizeof *faces);
    s->face_count += face_count;
    return PBS_OK;
}

/* Chunks are cut at the same voxels whatever the blocks. */
static pbs_code take_voxels(pbs_voxelstream *s, const pbs_voxels *v, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < v->count && !rc;) {
        size_t n = PBS_VOXELS_CHUNK - s->held.count;
        if (n > v->count - i) n = v->count - i;
        rc = pbs_voxels_grow(s->run, s->channels, &s->held, &s->cap, s->held.count + n, err);
        if (rc) return rc;
        pbs_voxels_append(&s->held, v, i, n);
        i += n;
        if (s->held.count == PBS_VOXELS_CHUNK) rc = flush(s, err);
    }
    return rc;
}

pbs_code pbs_voxelstream_add(pbs_voxelstream *s, const uint32_t at[3], const pbs_voxels *v,
                             const uint32_t *faces, size_t face_count, pbs_err *err) {
    if (!v->count) return PBS_OK;
    pbs_code rc = go_to(s, at, err);
    if (!rc) take_bounds(s, v);
    if (!rc && v->face) rc = take_faces(s, v->face, v->count, faces, face_count, err);
    return rc ? rc : take_voxels(s, v, err);
}

pbs_code pbs_voxelstream_end(pbs_voxelstream *s, const char *name, uint64_t triangles,
                             pbs_err *err) {
    pbs_code rc = close_chunk(s, err);
    if (rc) return rc;
    pbs_node root = {.id = node_id(s),
                     .name = name,
                     .box = s->box,
                     .triangles = triangles,
                     .child_count = (uint32_t)s->child_count,
                     .children = s->children};
    return pbs_node_write(s->run, s->w, &root, err);
}
