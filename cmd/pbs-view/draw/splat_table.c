/* splat_table.c: nodes become objects with identifiers: paper 4, section 4.2. */
#include "cmd/pbs-view/draw/splat_internal.h"
#include "libcore/surfels/average.h"

static uint64_t key_of(uint64_t key, uint32_t skip) {
    return key ^ (uint64_t)(skip / PBS_SPLAT_LARGE) * 0xd6e8feb86659fd93u;
}

pbs_code pbs_splat_reserve(pbs_splat *s, splat_store *store, size_t bytes, pbs_err *err) {
    if (store->room >= bytes && store->buffer) return PBS_OK;
    size_t room = bytes + bytes / 2 + 256, most = (size_t)s->gl->max_storage;
    if (room > most) room = bytes < most ? most : bytes;
    pbs_code rc = pbs_mem_take(s->run, room, "the lists of splats", err);
    if (rc) return rc;
    pbs_mem_give(s->run, store->room);
    s->counted += room - store->room;
    if (!store->buffer) s->gl->CreateBuffers(1, &store->buffer);
    s->gl->NamedBufferData(store->buffer, (GLsizeiptr)room, NULL, GL_DYNAMIC_DRAW);
    store->room = room;
    return PBS_OK;
}

static pbs_code slot_of(pbs_splat *s, splat_frame *f, GLuint buffer, uint32_t *out, pbs_err *err) {
    for (size_t i = f->slot_count; i-- > 0;)
        if (f->slots[i].buffer == buffer) {
            *out = (uint32_t)i;
            return PBS_OK;
        }
    pbs_code rc = pbs_grow(s->run, &f->slots, &f->slot_room, f->slot_count + 1, sizeof *f->slots,
                           "the list of splats", err);
    if (rc) return rc;
    *out = (uint32_t)f->slot_count;
    f->slots[f->slot_count++] =
        (splat_slot){.buffer = buffer, .bytes = pbs_resident_bytes(s->gl, buffer)};
    return PBS_OK;
}

/* Longest half axis of the node's discs in view. */
static double longest_axis(const splat_entry *e) {
    double longest = 0;
    for (int k = 0; k < 3; k++) {
        double square = 0;
        for (int i = 0; i < 3; i++) square += (double)e->disc[i][k] * e->disc[i][k];
        longest = fmax(longest, square);
    }
    return sqrt(longest);
}

/* Whether discs can be larger than the margin in the picture, so that one with its centre outside
 * may be seen. */
static bool too_large(const pbs_canvas *c, const splat_entry *e) {
    double nearest = INFINITY;
    for (int corner = 0; corner < 8; corner++) {
        double z = e->to_view[2][3];
        for (int k = 0; k < 3; k++) z += corner >> k & 1 ? 65535.0 * e->to_view[2][k] : 0;
        nearest = fmin(nearest, -z);
    }
    double pixel = pbs_camera_pixel(&c->camera, c->height);
    return !(longest_axis(e) < PBS_SPLAT_MARGIN * pixel * fmax(nearest, PBS_CAMERA_NEAR));
}

/* Room in the lists that a slot's surfels need. */
static uint64_t share(const pbs_splat *s, uint64_t surfels) {
    uint64_t pixels = (uint64_t)s->width * s->height;
    return surfels < pixels ? surfels : pixels;
}

static void choose_kind(const pbs_splat *s, splat_frame *f, splat_object *o, uint32_t used[3],
                        uint64_t *listed) {
    splat_slot *slot = &f->slots[o->slot];
    uint64_t more = share(s, slot->surfels + o->count) - share(s, slot->surfels);
    if (o->kind != 2) {
        o->kind = o->count <= PBS_SPLAT_SMALL && used[1] < PBS_SPLAT_SMALLS ? 1 : 0;
        if ((o->kind == 0 && used[0] == PBS_SPLAT_LARGES) || *listed + more > PBS_SPLAT_LIST)
            o->kind = 2;
    }
    used[o->kind]++;
    if (o->kind == 2) return;
    *listed += more;
    slot->surfels += o->count;
    slot->groups += (o->count + f->group - 1) / f->group;
}

static void fill_octaves(const pbs_resident *r, const pbs_resident_words *w, splat_entry *e) {
    e->octaves[0] = w->octaves;
    e->octaves[1] = pbs_surfel_size(r->channels) / 4 - 2;
    e->octaves[2] = r->whole;
    e->octaves[3] = (uint32_t)pbs_octaves(r->whole);
    uint32_t prefix = r->part.here ? r->part.prefix : r->prefix;
    if (prefix && prefix < r->whole) e->octave = (float)(log2((double)r->whole / prefix) / 2);
    e->before = r->part.before;
    e->here = r->part.here ? r->part.here : UINT32_MAX;
}

/* The node's parts, and what they have in common in the table. */
static pbs_code add_node(pbs_splat *s, splat_frame *f, const pbs_canvas *c, const pbs_resident *r,
                         uint32_t node, size_t *parts, bool whole, pbs_err *err) {
    pbs_resident_words w;
    uint32_t slot;
    pbs_code rc = slot_of(s, f, r->buffer, &slot, err);
    if (!rc) rc = pbs_resident_check(r, f->slots[slot].bytes, &w, err);
    for (uint32_t skip = 0; !rc && skip < w.count; skip += PBS_SPLAT_LARGE) {
        uint32_t left = w.count - skip;
        rc = pbs_grow(s->run, &s->parts, &s->part_room, *parts + 1, sizeof *s->parts,
                      "the list of splats", err);
        if (!rc)
            rc = pbs_grow(s->run, &s->entries, &s->entry_room, *parts + 1, sizeof *s->entries,
                          "the list of splats", err);
        if (rc) return rc;
        splat_entry *e = &s->entries[*parts];
        *e = (splat_entry){
            .records = {w.first + skip * w.stride, w.stride, 0, r->part.before + skip}};
        memcpy(e->field, w.field, sizeof e->field);
        e->records[2] = left < PBS_SPLAT_LARGE ? left : PBS_SPLAT_LARGE;
        pbs_resident_place(r, &c->camera, e->to_view, e->disc, e->normal);
        e->disc[0][3] = (float)longest_axis(e);
        fill_octaves(r, &w, e);
        s->parts[(*parts)++] = (splat_object){.key = pbs_resident_key(r),
                                              .offset = r->offset,
                                              .buffer = r->buffer,
                                              .node = node,
                                              .skip = skip,
                                              .count = e->records[2],
                                              .slot = slot,
                                              .kind = whole || too_large(c, e) ? 2 : 0};
        s->all += e->records[2];
    }
    return rc;
}

/* Where a part was in the last frame; the buffer must still be the same. */
static const splat_object *before(const splat_frame *last, const splat_object *o, uint32_t *where) {
    *where = pbs_numbers_get(&last->by_key, key_of(o->key, o->skip));
    if (*where == (uint32_t)PBS_NUMBERS_NONE) return NULL;
    const splat_object *b = &last->objects[*where];
    return b->key == o->key && b->skip == o->skip && b->buffer == o->buffer &&
                   b->offset == o->offset && b->kind != 2
               ? b
               : NULL;
}

/* Objects in the order of their kinds, each with its flags and its identifier. */
static pbs_code arrange(pbs_splat *s, splat_frame *f, const splat_frame *last, size_t parts,
                        const uint32_t used[3], bool coherent, pbs_err *err) {
    uint32_t at[3] = {0, used[0], used[0] + used[1]}, where;
    splat_entry *sorted;
    pbs_code rc = pbs_grow(s->run, &f->objects, &f->room, parts, sizeof *f->objects,
                           "the list of splats", err);
    if (!rc) rc = pbs_alloc(s->run, &sorted, parts, sizeof *sorted, "the list of splats", err);
    if (rc) return rc;
    for (size_t i = 0; i < parts && !rc; i++) {
        splat_object *o = &s->parts[i];
        uint32_t place = at[o->kind]++;
        splat_entry *e = &sorted[place];
        *e = s->entries[i];
        e->id = o->kind == 0 ? place << 20 : 1u << 31 | (place - used[0]) << 17;
        o->base = f->flags;
        const splat_object *b = coherent ? before(last, o, &where) : NULL;
        const uint32_t flags[4] = {o->base, b ? b->base : UINT32_MAX, b ? b->count : 0, o->slot};
        memcpy(e->flags, flags, sizeof flags);
        if (o->kind == 2)
            s->plain += o->count;
        else
            f->flags += (o->count + f->group - 1) / f->group;
        if (b && o->kind != 2) s->moved[where] = place;
        f->objects[place] = *o;
        rc = pbs_numbers_put(s->run, &f->by_key, key_of(o->key, o->skip), place, err);
    }
    if (!rc) rc = pbs_splat_reserve(s, &s->table, parts * sizeof *sorted, err);
    if (!rc && parts)
        s->gl->NamedBufferSubData(s->table.buffer, 0, (GLsizeiptr)(parts * sizeof *sorted), sorted);
    pbs_free(s->run, sorted);
    return rc;
}

static pbs_code send_places(pbs_splat *s, const splat_frame *last, pbs_err *err) {
    pbs_code rc = pbs_splat_reserve(s, &s->places, 4 * last->count, err);
    if (!rc && last->count)
        s->gl->NamedBufferSubData(s->places.buffer, 0, (GLsizeiptr)(4 * last->count), s->moved);
    return rc;
}

pbs_code pbs_splat_table(pbs_splat *s, const pbs_canvas *c, const pbs_resident *nodes, size_t count,
                         const pbs_splat_options *o, bool coherent, pbs_err *err) {
    splat_frame *f = &s->frames[s->now];
    const splat_frame *last = &s->frames[!s->now];
    uint32_t used[3] = {0};
    uint64_t listed = 0;
    size_t parts = 0;
    pbs_code rc = PBS_OK;
    f->slot_count = f->count = f->flags = 0;
    f->lists = false;
    f->group = o->group ? o->group : 1;
    s->all = s->plain = 0;
    pbs_numbers_clear(&f->by_key);
    for (size_t i = 0; i < count && !rc; i++)
        rc = add_node(s, f, c, &nodes[i], (uint32_t)i, &parts, o->whole, err);
    for (size_t i = 0; i < parts && !rc; i++) choose_kind(s, f, &s->parts[i], used, &listed);
    if (!rc)
        rc = pbs_grow(s->run, &s->moved, &s->moved_room, last->count, sizeof *s->moved,
                      "the list of splats", err);
    if (rc) return rc;
    for (size_t i = 0; i < last->count; i++) s->moved[i] = UINT32_MAX;
    rc = arrange(s, f, last, parts, used, coherent, err);
    if (rc) return rc;
    f->count = parts;
    f->larges = used[0];
    f->selected = used[0] + used[1];
    return coherent ? send_places(s, last, err) : PBS_OK;
}
