/* player_near.c: source geometry of an archive and its textures: which are wanted, when a mesh can
 * be drawn, and drawing it.
 *
 * A mesh takes the place of surfels or voxels when its textures are there, too: else the picture
 * would lose its colours for a while. */
#include "cmd/pbs-view/stream/player.h"
#include <string.h>

/* ---- the store's textures ---- */

static bool make_texture(void *ctx, uint32_t item, uint64_t bytes, uint32_t *texture) {
    pbs_player *p = ctx;
    const pbs_gl *gl = p->gl;
    pbs_err err;
    if (gl->software && pbs_mem_take(p->run, (size_t)bytes, "the GPU's memory", &err)) return false;
    *texture = pbs_gl_texture_new(gl, pbs_source_mips(&p->source, item));
    if (pbs_gl_check(gl, "texture", &err) == PBS_OK) {
        p->counted += gl->software ? bytes : 0;
        return true;
    }
    gl->DeleteTextures(1, texture);
    if (gl->software) pbs_mem_give(p->run, (size_t)bytes);
    return false;
}

static void fill_texture(void *ctx, uint32_t item, uint32_t texture, uint64_t at, const void *bytes,
                         uint64_t size) {
    const pbs_player *p = ctx;
    pbs_gl_texture_fill(p->gl, texture, pbs_source_mips(&p->source, item), at, bytes, size);
}

static void drop_texture(void *ctx, uint32_t texture, uint64_t bytes) {
    pbs_player *p = ctx;
    p->gl->DeleteTextures(1, &texture);
    if (!p->gl->software) return;
    pbs_mem_give(p->run, (size_t)bytes);
    p->counted -= bytes;
}

void pbs_player_textures(pbs_player *p, pbs_store_desc *desc, pbs_store_gpu *gpu) {
    desc->items = p->source.items;
    if (p->source.items > 2 * p->archive->node_count) desc->apart = 2 * p->archive->node_count;
    gpu->make_apart = make_texture;
    gpu->fill_apart = fill_texture;
    gpu->drop_apart = drop_texture;
    p->source.largest_side = (uint32_t)p->gl->max_texture;
    p->source.largest_texture = desc->gpu / 4;
}

/* ---- what is wanted ---- */

/* Which nodes have something that stands for their meshes: of their own or of one above them. */
static void mark_covered(const pbs_player *p) {
    const pbs_archive *a = p->archive;
    for (size_t i = a->node_count; i--;) {
        p->covered[i] |= (p->source.has[i] & ~PBS_HAS_MESH) != 0;
        for (uint32_t c = 0; c < a->nodes[i].child_count && p->covered[i]; c++)
            p->covered[a->nodes[i].children[c].node] = 1;
    }
}

pbs_code pbs_player_open_near(pbs_player *p, pbs_err *err) {
    const char *what = "the table of what is loaded";
    size_t n = p->archive->node_count;
    if (!p->archive->texture_count) return PBS_OK;
    pbs_code rc = pbs_alloc(p->run, &p->ready, 2 * n, 1, what, err);
    if (!rc) rc = pbs_alloc(p->run, &p->covered, n, 1, what, err);
    if (!rc)
        rc = pbs_alloc(p->run, &p->wanted_at, p->source.items - 2 * n, sizeof *p->wanted_at, what,
                       err);
    if (rc) return rc;
    memset(p->ready, 0, 2 * n);
    memset(p->covered, 0, n);
    memset(p->wanted_at, 0, (p->source.items - 2 * n) * sizeof *p->wanted_at);
    mark_covered(p);
    return PBS_OK;
}

/* The mesh of an item of needs, if it is there. */
static const pbs_node_mesh *mesh_of(const pbs_player *p, uint32_t item) {
    return item % 2 && pbs_store_resident(p->store)[item] ? p->source.mesh[item / 2] : NULL;
}

/* The cut's needs, and behind each mesh that is there its textures. */
static pbs_code list_needs(pbs_player *p, pbs_err *err) {
    const pbs_cut_frame *f = &p->frame;
    size_t n = 0;
    p->want_number++;
    for (size_t i = 0; i < f->need_count; i++) {
        const pbs_node_mesh *m = mesh_of(p, f->needs[i].item);
        size_t more = m ? m->texture_count : 0;
        pbs_code rc = pbs_grow(p->run, &p->needs, &p->need_cap, n + 1 + more, sizeof *p->needs,
                               "the list of what is needed", err);
        if (rc) return rc;
        pbs_cut_need need = p->needs[n++] = f->needs[i];
        for (size_t k = 0; k < more; k++) {
            uint64_t *at = &p->wanted_at[m->textures[k] - 2 * p->archive->node_count];
            need.item = m->textures[k];
            if (*at != p->want_number) p->needs[n++] = need;
            *at = p->want_number;
        }
    }
    p->need_count = n;
    return PBS_OK;
}

/* Whether the mesh of a node, which is there, need not wait for a texture. */
static bool is_ready(const pbs_player *p, size_t node) {
    const pbs_node_mesh *m = p->source.mesh[node];
    for (size_t k = 0; k < m->texture_count; k++) {
        uint32_t item = m->textures[k];
        bool waits = p->covered[node]
                         ? !pbs_store_resident(p->store)[item] && !pbs_store_failed(p->store, item)
                         : pbs_store_awaits(p->store, item);
        if (waits) return false;
    }
    return true;
}

static void note_ready(pbs_player *p) {
    const uint8_t *resident = pbs_store_resident(p->store);
    memcpy(p->ready, resident, 2 * p->archive->node_count);
    for (size_t i = 0; i < p->archive->node_count; i++)
        if (resident[PBS_ITEM_MESH(i)]) p->ready[PBS_ITEM_MESH(i)] = is_ready(p, i);
}

pbs_code pbs_player_load(pbs_player *p, bool *busy, pbs_err *err) {
    const pbs_cut_frame *f = &p->frame;
    if (!p->ready) return pbs_store_frame(p->store, f->needs, f->need_count, busy, err);
    pbs_code rc = list_needs(p, err);
    if (!rc) rc = pbs_store_frame(p->store, p->needs, p->need_count, busy, err);
    if (!rc) note_ready(p);
    return rc;
}

/* ---- drawing ---- */

static void set_look(const pbs_player *p, uint32_t look, pbs_placed_mesh *t) {
    uint32_t item[3];
    if (look == PBS_NONE) return;
    t->look = &p->archive->materials[look];
    pbs_source_look(&p->source, t->look, item);
    for (int i = 0; i < 3; i++)
        if (item[i] != PBS_NONE && pbs_store_resident(p->store)[item[i]])
            t->texture[i] = pbs_store_where(p->store, item[i], 0).buffer;
}

static int64_t behind(int64_t array, uint64_t at) {
    return array < 0 ? -1 : array + (int64_t)at;
}

static void place(const pbs_player *p, const pbs_cut_draw *d, const pbs_mesh_part *m,
                  pbs_placed_mesh *t) {
    pbs_region r = pbs_store_where(p->store, PBS_ITEM_MESH(d->node), m->part);
    *t = (pbs_placed_mesh){.buffer = r.buffer,
                           .first = m->first,
                           .count = m->triangles,
                           .material = m->material,
                           .position = behind(m->position, r.at),
                           .normal = behind(m->normal, r.at),
                           .uv = behind(m->uv, r.at),
                           .colour = behind(m->colour, r.at),
                           .index = behind(m->index, r.at),
                           .triangle_material = behind(m->triangle_material, r.at)};
    set_look(p, m->look, t);
    memcpy(t->origin, p->archive->nodes[d->node].origin, sizeof t->origin);
    memcpy(t->m, d->m, sizeof t->m);
}

pbs_code pbs_player_near(pbs_player *p, pbs_canvas *canvas, pbs_err *err) {
    const pbs_cut_frame *f = &p->frame;
    pbs_palette palette = {p->archive->materials, p->archive->material_count};
    size_t n = 0;
    for (size_t i = f->first[PBS_CUT_MESH]; i < f->first[PBS_CUT_MESH + 1]; i++) {
        const pbs_cut_draw *d = &f->draws[i];
        const pbs_node_mesh *m = p->source.mesh[d->node];
        pbs_code rc = pbs_grow(p->run, &p->near, &p->near_cap, n + m->part_count, sizeof *p->near,
                               "the list of what is drawn", err);
        if (rc) return rc;
        for (size_t k = 0; k < m->part_count; k++) {
            place(p, d, &m->parts[k], &p->near[n++]);
            p->triangles += m->parts[k].triangles;
        }
    }
    return pbs_canvas_triangles(canvas, p->near, n, &palette, err);
}
