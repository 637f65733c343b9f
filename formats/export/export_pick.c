/* export_pick.c: the nodes of the file, and which placings are chosen (export.h). */
#include "formats/archive/archive.h"
#include "formats/export/export.h"
#include <string.h>

/* ---- the file ---- */

static pbs_code read_channels(pbs_exporter *x, pbs_err *err) {
    const char *text = pbs_reader_channels(x->reader);
    switch (pbs_reader_kind(x->reader)) {
    case PBS_SURFELS:
        return pbs_record_parse(x->name, text, &x->record, err);
    case PBS_VOXELS:
        return pbs_voxels_parse(x->name, text, &x->voxels, err);
    default:
        return pbs_archive_parse(x->name, text, &x->record, &x->voxels, err);
    }
}

static pbs_code read_nodes(pbs_exporter *x, pbs_err *err) {
    size_t count = 0;
    for (size_t i = 0; i < x->entry_count; i++) count += x->entries[i].tag == PBS_TAG_NODE;
    if (!count) return pbs_fail(err, PBS_DATA, "%s: no node in it", x->name);
    pbs_code rc = pbs_alloc(x->run, &x->node, count, sizeof *x->node, "the nodes", err);
    if (!rc) rc = pbs_alloc(x->run, &x->data, count, sizeof *x->data, "the nodes", err);
    if (rc) return rc;
    memset(x->data, 0, count * sizeof *x->data);
    for (size_t i = 0; i < x->entry_count && !rc; i++) {
        pbs_chunk c;
        if (x->entries[i].tag != PBS_TAG_NODE) continue;
        rc = pbs_reader_at(x->reader, &x->entries[i], &c, err);
        if (!rc)
            rc = pbs_node_read(x->run, x->name, &c, (uint32_t)x->count, &x->node[x->count], err);
        if (!rc) x->data[x->count++].tallied[0] = -1;
    }
    return rc;
}

/* Where the data of each node is, and that it is all there. */
static pbs_code find_data(pbs_exporter *x, pbs_err *err) {
    uint64_t *seen;
    pbs_code rc = pbs_alloc(x->run, &seen, x->count, sizeof *seen, "the nodes", err);
    if (rc) return rc;
    memset(seen, 0, x->count * sizeof *seen);
    for (size_t i = 0; i < x->entry_count && !rc; i++) {
        const pbs_chunk *e = &x->entries[i];
        bool points = e->tag == PBS_TAG_POINTS, voxels = e->tag == PBS_TAG_VOXELS;
        if (e->tag == PBS_TAG_FACES && e->node < x->count && !x->data[e->node].face_chunks++)
            x->data[e->node].first_face = i;
        if (!points && !voxels) continue;
        pbs_export_data *d = e->node < x->count ? &x->data[e->node] : NULL;
        if (!d || (d->chunks && d->tag != e->tag) || e->first != (uint32_t)seen[e->node] ||
            (points ? !x->record.stride || e->bytes != (uint64_t)e->count * x->record.stride
                    : !x->voxels)) {
            rc = pbs_fail(err, PBS_DATA, "%s: data of node %u does not fit it", x->name, e->node);
            break;
        }
        if (!d->chunks++) d->first = i, d->tag = e->tag;
        seen[e->node] += e->count;
    }
    for (size_t i = 0; i < x->count && !rc; i++)
        if (seen[i] != x->node[i].records)
            rc = pbs_fail(err, PBS_DATA, "%s: node %zu has not as many records as it says", x->name,
                          i);
    pbs_free(x->run, seen);
    return rc;
}

pbs_code pbs_export_chunk(pbs_exporter *x, uint32_t node, uint32_t i, size_t *at, pbs_chunk *c,
                          pbs_err *err) {
    const pbs_export_data *d = &x->data[node];
    if (!i) *at = d->first;
    while (x->entries[*at].tag != d->tag || x->entries[*at].node != node) ++*at;
    pbs_trim_now(&x->trim);
    return pbs_reader_read(x->reader, &x->entries[(*at)++], c, err);
}

/* Children come before their parents. */
static void look_below(pbs_exporter *x) {
    for (size_t i = 0; i < x->count; i++) {
        const pbs_node *n = &x->node[i];
        pbs_export_data *d = &x->data[i];
        bool all = n->child_count > 0;
        d->below = n->records > 0;
        d->level = -1;
        for (uint32_t k = 0; k < n->child_count; k++) {
            const pbs_export_data *c = &x->data[n->children[k].node];
            d->below |= c->below;
            d->moving |= c->moving || (n->children[k].flags & PBS_CHILD_MOVES && c->below);
            all = all && (c->complete || n->children[k].flags & PBS_CHILD_MOVES);
        }
        d->complete = n->records || all || !n->triangles;
    }
}

/* Is everything that a node with surfels stands for also below it? */
static bool has_finer(const pbs_exporter *x, const pbs_node *n) {
    bool any = false;
    for (uint32_t k = 0; k < n->child_count; k++) {
        const pbs_export_data *c = &x->data[n->children[k].node];
        if (n->children[k].flags & PBS_CHILD_MOVES) continue;
        if (!c->complete) return false;
        any |= c->below;
    }
    return any;
}

/* ---- the walk ---- */

/* The level of a node of voxels is in its data. */
static pbs_code find_level(pbs_exporter *x, uint32_t id, pbs_err *err) {
    pbs_chunk c;
    pbs_voxel_place place;
    pbs_voxels some;
    size_t at;
    if (x->data[id].level >= 0) return PBS_OK;
    pbs_code rc = pbs_export_chunk(x, id, 0, &at, &c, err);
    if (!rc) rc = pbs_voxels_view(x->name, x->voxels, &c, 0, &place, &some, err);
    if (!rc) x->data[id].level = (int)place.level;
    return rc;
}

/* Does what is below come instead of the node? */
static pbs_code descends(pbs_exporter *x, uint32_t id, double scale, bool *finer, pbs_err *err) {
    const pbs_node *n = &x->node[id];
    const pbs_export_options *o = x->o;
    *finer = has_finer(x, n);
    if (!*finer) return PBS_OK;
    if (x->data[id].tag == PBS_TAG_POINTS) {
        *finer = !o->prefix && (x->spacing == 0 || n->covering * scale > x->spacing);
        return PBS_OK;
    }
    if (o->level < 0) {
        *finer = n->lattice * scale / 2 >= x->spacing;
        return PBS_OK;
    }
    pbs_code rc = find_level(x, id, err);
    *finer = x->data[id].level > o->level;
    return rc;
}

/* The mean of what it does to lengths; of a scale, the scale. */
static double scale_of(const double m[12]) {
    double s = 0;
    for (int r = 0; r < 3; r++) s = hypot(s, hypot(hypot(m[4 * r], m[4 * r + 1]), m[4 * r + 2]));
    return s == sqrt(3) ? 1 : s / sqrt(3);
}

typedef struct frame {
    uint32_t node, next; /* child that comes next */
    bool covered;        /* something above stands for it */
    double m[12];
} frame;

typedef struct walk {
    pbs_exporter *x;
    pbs_export_placing_fn take;
    void *ctx;
    frame *frame;
    size_t depth, room;
} walk;

static pbs_code visit(walk *w, uint32_t id, const double m[12], bool covered, pbs_err *err) {
    pbs_exporter *x = w->x;
    const pbs_node *n = &x->node[id];
    pbs_code rc = PBS_OK;
    bool take = n->records && !covered, finer = false;
    if (take && !(n->flags & PBS_NODE_ADDS)) {
        rc = descends(x, id, scale_of(m), &finer, err);
        take = !finer;
        covered = take;
    }
    if (rc) return rc;
    if (take) rc = w->take(w->ctx, id, m, scale_of(m), err);
    if (rc || !n->child_count || (covered ? !x->data[id].moving : !x->data[id].below)) return rc;
    rc =
        pbs_grow(x->run, &w->frame, &w->room, w->depth + 1, sizeof *w->frame, "the hierarchy", err);
    if (rc) return rc;
    frame *f = &w->frame[w->depth++];
    *f = (frame){.node = id, .covered = covered};
    memcpy(f->m, m, sizeof f->m);
    return PBS_OK;
}

/* No recursion: hierarchies may be deeper than the stack. */
pbs_code pbs_export_walk(pbs_exporter *x, pbs_export_placing_fn take, void *ctx, pbs_err *err) {
    walk w = {.x = x, .take = take, .ctx = ctx};
    pbs_code rc = visit(&w, x->top, PBS_IDENTITY, false, err);
    for (uint64_t step = 1; w.depth && !rc; step++) {
        if (step % 1024 == 0 && (rc = pbs_run_check(x->run, err))) break;
        if (step >> 33) /* 64 nodes can place one 2^64 times */
            rc = pbs_fail(err, PBS_LIMIT, "%s: its nodes are placed more than 2^32 times", x->name);
        if (rc) break;
        frame *f = &w.frame[w.depth - 1];
        const pbs_node *n = &x->node[f->node];
        if (f->next == n->child_count) {
            w.depth--;
            continue;
        }
        const pbs_child *c = &n->children[f->next++];
        bool covered = f->covered && !(c->flags & PBS_CHILD_MOVES);
        double m[12];
        if (!x->data[c->node].below || (covered && !x->data[c->node].moving)) continue;
        pbs_xform_mul(m, f->m, c->m);
        rc = visit(&w, c->node, m, covered, err);
    }
    pbs_free(x->run, w.frame);
    return rc;
}

/* ---- all ---- */

/* What is written is what all that is written has. */
static uint32_t written_channels(const pbs_exporter *x) {
    uint32_t points = x->record.stride && !x->o->faces ? x->record.channels : ~0u;
    uint32_t voxels = x->voxels ? x->voxels | PBS_SPACING : ~0u;
    if (x->o->faces && x->voxels & PBS_FACE) voxels |= PBS_COLOUR;
    uint32_t asked = PBS_NORMAL | PBS_COLOUR | (x->o->radius ? PBS_SPACING : 0);
    if (x->o->faces) asked &= ~(uint32_t)PBS_SPACING;
    return points & voxels & asked;
}

static pbs_code check_options(const pbs_exporter *x, pbs_err *err) {
    const pbs_export_options *o = x->o;
    if (o->node >= 0 && (uint64_t)o->node >= x->count)
        return pbs_fail(err, PBS_USAGE, "%s: --node %lld: it has nodes 0 to %zu", x->name,
                        (long long)o->node, x->count - 1);
    if ((o->faces || o->level >= 0) && !x->voxels)
        return pbs_fail(err, PBS_USAGE, "%s: --%s: there are no voxels in it", x->name,
                        o->faces ? "faces" : "level");
    if (o->prefix && !x->record.stride)
        return pbs_fail(err, PBS_USAGE,
                        "%s: --prefix: there are only voxels in it, which have --level", x->name);
    return PBS_OK;
}

static pbs_code room_for_blocks(pbs_exporter *x, pbs_err *err) {
    pbs_export_block *b = &x->block;
    size_t n = PBS_EXPORT_ROOM;
    const char *what = "a block of points";
    pbs_code rc = pbs_alloc(x->run, &b->position, n, sizeof *b->position, what, err);
    if (!rc && x->channels & PBS_NORMAL)
        rc = pbs_alloc(x->run, &b->normal, n, sizeof *b->normal, what, err);
    if (!rc && x->channels & PBS_COLOUR)
        rc = pbs_alloc(x->run, &b->colour, n, sizeof *b->colour, what, err);
    if (!rc && x->channels & PBS_SPACING)
        rc = pbs_alloc(x->run, &b->radius, n, sizeof *b->radius, what, err);
    if (!rc && x->record.stride)
        rc = pbs_points_alloc(x->run, x->record.channels, PBS_EXPORT_WINDOW, &x->points, err);
    return rc;
}

/* What is read is given back: a file may be larger than the memory. */
static void let_go(pbs_exporter *x) {
    pbs_trim_open(x->run, &x->trim);
    if (!x->entry_count) return;
    const pbs_chunk *last = &x->entries[x->entry_count - 1];
    const uint8_t *from = pbs_reader_peek(x->reader, &x->entries[0]);
    const uint8_t *to = pbs_reader_peek(x->reader, last);
    if (from && to && from <= to) pbs_trim_add(&x->trim, from, (size_t)(to + last->bytes - from));
}

pbs_code pbs_export_open(pbs_exporter *x, pbs_err *err) {
    pbs_input in;
    x->trim.statm = -1;
    pbs_code rc = pbs_input_open(x->run, x->o->input, &in, err);
    if (rc) return rc;
    if ((rc = pbs_input_map(&in, err))) {
        pbs_input_close(&in);
        return rc;
    }
    uint32_t kinds = PBS_KIND(PBS_ARCHIVE) | PBS_KIND(PBS_SURFELS) | PBS_KIND(PBS_VOXELS);
    rc = pbs_reader_open(x->run, &in, kinds, &x->reader, err);
    if (rc) return rc;
    x->name = pbs_reader_name(x->reader);
    rc = read_channels(x, err);
    if (!rc) rc = pbs_reader_directory(x->reader, &x->entries, &x->entry_count, err);
    if (!rc) let_go(x);
    if (!rc) rc = read_nodes(x, err);
    if (!rc) rc = find_data(x, err);
    if (!rc) rc = check_options(x, err);
    if (!rc && x->o->faces) rc = pbs_export_palette(x, err);
    if (rc) return rc;
    look_below(x);
    x->top = x->o->node < 0 ? (uint32_t)x->count - 1 : (uint32_t)x->o->node;
    x->spacing = x->o->spacing;
    x->channels = written_channels(x);
    return room_for_blocks(x, err);
}

void pbs_export_close(pbs_exporter *x) {
    for (size_t i = 0; i < x->count; i++) pbs_node_free(x->run, &x->node[i]);
    pbs_free(x->run, x->node);
    pbs_free(x->run, x->data);
    pbs_free(x->run, x->palette);
    pbs_free(x->run, x->face);
    pbs_free(x->run, x->block.position);
    pbs_free(x->run, x->block.normal);
    pbs_free(x->run, x->block.colour);
    pbs_free(x->run, x->block.radius);
    pbs_points_free(x->run, &x->points);
    pbs_trim_close(&x->trim);
    pbs_reader_close(x->reader);
}
