/* pack_same.c: nodes that are equal in all that they say, hold and place are stored once.
 *
 * The table is in the order children first, so that of two trees that are equal the lowest nodes
 * become one, then those that place them. What chunks say of themselves finds a candidate; then
 * the bytes are compared. */
#include "formats/archive/pack_inner.h"
#include <string.h>

static void add_node(pbs_digest *d, const pbs_node *n) {
    const uint64_t whole[] = {n->triangles, n->records,      n->wanted,
                              n->flags,     n->median_count, n->child_count};
    const double real[] = {n->pixel,          n->covering,       n->median,        n->lattice,
                           n->lattice_min[0], n->lattice_min[1], n->lattice_min[2]};
    pbs_digest_add(d, whole, sizeof whole);
    pbs_digest_add(d, real, sizeof real);
    pbs_digest_add(d, n->origin, sizeof n->origin);
    pbs_digest_add(d, &n->box, sizeof n->box);
    uint64_t name = pbs_digest_text(n->name);
    pbs_digest_add(d, &name, sizeof name);
    for (uint32_t i = 0; i < n->child_count; i++) {
        const pbs_child *c = &n->children[i];
        const uint64_t what[] = {c->node, c->flags, c->motion, pbs_digest_text(c->name)};
        pbs_digest_add(d, what, sizeof what);
        pbs_digest_add(d, c->m, sizeof c->m);
    }
}

static bool is_own(const pbs_chunk *c) {
    return pack_is_data(c->tag) || pack_is_other(c->tag);
}

static void add_chunks(pbs_digest *d, const pbs_chunk *c, size_t n) {
    for (size_t i = 0; i < n; i++) {
        if (!is_own(&c[i])) continue;
        const uint64_t what[] = {c[i].tag,   c[i].flags, c[i].count,
                                 c[i].first, c[i].bytes, c[i].crc};
        pbs_digest_add(d, what, sizeof what);
    }
}

static void add_materials(pbs_digest *d, const pack_input *in) {
    pbs_digest_add(d, in->material, in->materials * sizeof *in->material);
}

static pbs_digest digest_of(const pbs_pack *p, const pack_entry *e) {
    const pack_input *in = &p->inputs[e->input];
    const uint32_t sort[] = {in->kind, in->record.channels, in->voxels};
    pbs_digest d = {{0}};
    add_node(&d, &e->node);
    pbs_digest_add(&d, sort, sizeof sort);
    add_chunks(&d, in->entries + e->first_chunk, e->end_chunk - e->first_chunk);
    if (e->voxels.faces) add_materials(&d, in);
    if (!pack_mesh_chunks(e)) return d;
    add_chunks(&d, e->mesh, e->mesh_count);
    add_materials(&d, &p->inputs[e->mesh_input]);
    pbs_digest_add(&d, e->shift, sizeof e->shift);
    return d;
}

/* What chunks say of themselves is equal. */
static bool same_bytes(pbs_reader *a, const pbs_chunk *ca, size_t na, pbs_reader *b,
                       const pbs_chunk *cb, size_t nb) {
    size_t i = 0, j = 0;
    for (;;) {
        while (i < na && !is_own(&ca[i])) i++;
        while (j < nb && !is_own(&cb[j])) j++;
        if (i == na || j == nb) return i == na && j == nb;
        const void *pa = pbs_reader_peek(a, &ca[i]), *pb = pbs_reader_peek(b, &cb[j]);
        if (!pa || !pb || memcmp(pa, pb, (size_t)ca[i].bytes)) return false;
        i++, j++;
    }
}

static bool is_same(const pbs_pack *p, const pack_entry *a, const pack_entry *b) {
    const pack_input *ia = &p->inputs[a->input], *ib = &p->inputs[b->input];
    return same_bytes(ia->reader, ia->entries + a->first_chunk, a->end_chunk - a->first_chunk,
                      ib->reader, ib->entries + b->first_chunk, b->end_chunk - b->first_chunk) &&
           same_bytes(a->mesh_reader, a->mesh, a->mesh_count, b->mesh_reader, b->mesh,
                      b->mesh_count);
}

static void stand_for_children(const pbs_pack *p, pbs_node *n) {
    for (uint32_t c = 0; c < n->child_count; c++)
        n->children[c].node = p->entries[n->children[c].node].same;
}

/* Where an input's root will be the archive's, that must stay the last. */
pbs_code pack_same(pbs_pack *p, pbs_err *err) {
    pbs_known known = {.run = p->run};
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < p->entry_count && !rc; i++) {
        pack_entry *e = &p->entries[i];
        stand_for_children(p, &e->node);
        if (!p->has_root && i + 1 == p->entry_count) break;
        pbs_known_node node = {.digest = digest_of(p, e)};
        bool found;
        uint32_t id = 0;
        rc = pbs_known_find(&known, &node.digest, NULL, &found, &id, err);
        if (!rc) rc = pbs_known_add(&known, &node, err);
        if (rc || !found || !is_same(p, &p->entries[id], e)) continue;
        e->same = p->entries[id].same;
        p->stats.same++;
    }
    pbs_known_free(&known);
    return rc;
}
