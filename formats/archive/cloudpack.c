/* cloudpack.c: from clouds to the archive (cloudpack.h). */
#include "formats/archive/cloudpack.h"
#include "libcore/ground/pipe.h"
#include <math.h>
#include <string.h>

typedef struct slot {
    size_t node;
    pbs_clod_point *out, *scratch;
    size_t room, scratch_room;
} slot;

typedef struct pbs_cloudpack_parts pack;
struct pbs_cloudpack_parts {
    pbs_run *run;
    pbs_cloud_points points;
    pbs_clod_upper upper;
    pbs_cloud_tree tree;
    pbs_record record; /* the archive's, which may have more than a cloud has */
    pbs_writer *w;
    uint32_t first; /* number of the first of its nodes in the archive */
    size_t next;    /* node */
    uint64_t done;
    int threads; /* that memory is enough for */
};

/* ---- nodes ---- */

/* The tree's order is that of the points; numbers go the other way. */
static uint32_t number(const pack *p, size_t node) {
    return p->first + (uint32_t)(p->tree.count - 1 - node);
}

static pbs_code write_nodes(pack *p, pbs_err *err) {
    pbs_child children[8];
    pbs_code rc = PBS_OK;
    for (size_t i = p->tree.count; i-- && !rc;) {
        pbs_node n = pbs_cloud_tree_node(&p->tree, i);
        n.id = number(p, i);
        n.children = children;
        for (uint32_t c = 0; c < n.child_count; c++) {
            children[c] = (pbs_child){.node = number(p, p->tree.node[i].child + c)};
            memcpy(children[c].m, PBS_IDENTITY, sizeof children[c].m);
        }
        rc = pbs_node_write(p->run, p->w, &n, err);
    }
    return rc;
}

/* ---- points: node | its points | written ---- */

static pbs_code next_node(void *ctx, void *s, bool *end, pbs_err *err) {
    (void)err;
    pack *p = ctx;
    while (p->next < p->tree.count && !p->tree.node[p->next].count) p->next++;
    *end = p->next == p->tree.count;
    if (!*end) ((slot *)s)->node = p->next++;
    return PBS_OK;
}

/* The record that the points of the cloud are by themselves. */
static pbs_record own_record(const pack *p) {
    return pbs_record_make(PBS_POSITION | PBS_SPACING | (p->points.colours ? PBS_COLOUR : 0), true);
}

/* Records of 8 bytes, if there are no colours. */
static void pack_records(const pack *p, pbs_clod_point *points, size_t n) {
    if (p->points.colours) return;
    uint8_t *to = (uint8_t *)points;
    for (size_t i = 0; i < n; i++) memmove(to + 8 * i, &points[i], 8);
}

/* An archive with more channels than the cloud has. */
static void widen(const pack *p, const uint8_t *from, size_t n, uint8_t *to) {
    const pbs_record own = own_record(p), *r = &p->record;
    uint8_t blank[64] = {0};
    int colour = pbs_record_at(r, PBS_COLOUR);
    pbs_points_blank(r, blank);
    for (size_t i = 0; i < n; i++, from += own.stride, to += r->stride) {
        memcpy(to, from, 8);
        memcpy(to + 8, blank + 8, r->stride - 8);
        if (p->points.colours) memcpy(to + colour, from + 8, 4);
    }
}

static pbs_code work_node(void *ctx, void *s, int thread, pbs_err *err) {
    (void)thread;
    pack *p = ctx;
    slot *to = s;
    const pbs_cloud_node *n = &p->tree.node[to->node];
    if (pbs_cloud_node_is_place(n)) return PBS_OK;
    size_t room = (size_t)n->count;
    pbs_code rc =
        pbs_grow(p->run, &to->out, &to->room, room, sizeof *to->out, "a node's points", err);
    if (!rc)
        rc = pbs_grow(p->run, &to->scratch, &to->scratch_room, room, sizeof *to->scratch,
                      "a node's points", err);
    if (rc) return rc;
    rc = pbs_cloud_tree_points(&p->tree, to->node, to->out, to->scratch, err);
    if (!rc) pack_records(p, to->out, room);
    return rc;
}

static pbs_code write_chunks(pack *p, size_t node, uint64_t first, const pbs_clod_point *points,
                             uint64_t n, pbs_err *err) {
    pbs_code rc = PBS_OK;
    uint32_t own = own_record(p).stride;
    uint8_t *wide = NULL;
    if (own != p->record.stride)
        rc = pbs_alloc(p->run, &wide, (size_t)(n < PBS_ARCHIVE_CHUNK ? n : PBS_ARCHIVE_CHUNK),
                       p->record.stride, "a node's points", err);
    for (uint64_t i = 0; i < n && !rc; i += PBS_ARCHIVE_CHUNK) {
        uint64_t count = n - i < PBS_ARCHIVE_CHUNK ? n - i : PBS_ARCHIVE_CHUNK;
        pbs_chunk c = {.tag = PBS_TAG_POINTS,
                       .node = number(p, node),
                       .count = (uint32_t)count,
                       .first = (uint32_t)(first + i)};
        const uint8_t *from = (const uint8_t *)points + (size_t)i * own;
        if (wide) widen(p, from, (size_t)count, wide);
        pbs_piece piece = {wide ? wide : from, (size_t)count * p->record.stride};
        rc = pbs_writer_chunk(p->w, &c, &piece, 1, err);
    }
    pbs_free(p->run, wide);
    return rc;
}

/* Points at one place, as they lie, but for the one that may have gone up. */
static pbs_code write_place(pack *p, size_t node, pbs_err *err) {
    const pbs_cloud_node *n = &p->tree.node[node];
    const pbs_clod_cell *c = &p->points.cells.cell[n->first];
    uint64_t from = pbs_clod_at(c) + (c->count - n->count) * sizeof(pbs_clod_point);
    pbs_clod_point *piece;
    pbs_code rc =
        pbs_alloc(p->run, &piece, PBS_ARCHIVE_CHUNK, sizeof *piece, "a place's points", err);
    for (uint64_t i = 0; i < n->count && !rc; i += PBS_ARCHIVE_CHUNK) {
        uint64_t count = n->count - i < PBS_ARCHIVE_CHUNK ? n->count - i : PBS_ARCHIVE_CHUNK;
        rc = pbs_scratch_read(&p->points.raw, from + i * sizeof *piece,
                              (size_t)count * sizeof *piece, piece, err);
        if (rc) break;
        pack_records(p, piece, (size_t)count);
        rc = write_chunks(p, node, i, piece, count, err);
    }
    pbs_free(p->run, piece);
    return rc;
}

static pbs_code sink_node(void *ctx, void *s, pbs_err *err) {
    pack *p = ctx;
    const slot *from = s;
    const pbs_cloud_node *n = &p->tree.node[from->node];
    pbs_code rc = pbs_cloud_node_is_place(n)
                      ? write_place(p, from->node, err)
                      : write_chunks(p, from->node, 0, from->out, n->count, err);
    p->done += n->count;
    pbs_trim_now(&p->points.trim);
    pbs_run_progress(p->run, "writing", p->done, p->points.count);
    return rc;
}

static pbs_code write_points(pack *p, pbs_err *err) {
    slot *slots;
    size_t count = 2 * (size_t)p->run->threads;
    pbs_code rc = pbs_alloc(p->run, &slots, count, sizeof *slots, "the nodes", err);
    if (rc) return rc;
    memset(slots, 0, count * sizeof *slots);
    pbs_pipe pipe = {.ctx = p,
                     .source = next_node,
                     .work = work_node,
                     .sink = sink_node,
                     .slots = slots,
                     .slot_size = sizeof *slots,
                     .slot_count = (int)count};
    rc = pbs_pipe_run(p->run, &pipe, err);
    for (size_t i = 0; i < count; i++) {
        pbs_free(p->run, slots[i].out);
        pbs_free(p->run, slots[i].scratch);
    }
    pbs_free(p->run, slots);
    return rc;
}

/* ---- all ---- */

static int top_level(const pack *p) {
    int bits = p->points.lattice.bits;
    return bits > PBS_CLOD_KEEP ? bits - PBS_CLOD_KEEP : 0;
}

static pbs_code make_levels(pack *p, pbs_err *err) {
    const pbs_clod_store store = pbs_cloud_store(&p->points);
    bool colours = p->points.colours;
    pbs_code rc = pbs_clod_thin(p->run, &store, &p->points.cells, colours, err);
    if (!rc)
        rc = pbs_clod_thin_upper(p->run, &store, &p->points.cells, top_level(p), colours, &p->upper,
                                 err);
    return rc ? rc : pbs_cloud_tree_new(p->run, &p->points, &p->upper, &p->tree, err);
}

void pbs_cloudpack_count(const pack *p, pbs_cloudpack_stats *s) {
    const pbs_cloud_lattice *l = &p->points.lattice;
    int top = -1, least = PBS_CLOD_LEVELS;
    *s = (pbs_cloudpack_stats){.points = p->points.count,
                               .left_out = p->points.left_out,
                               .nodes = p->tree.count,
                               .cells = p->points.cells.count,
                               .step = l->step,
                               .bound = l->bound,
                               .record = own_record(p)};
    for (size_t i = 0; i < p->points.cells.count; i++) {
        const pbs_clod_cell *c = &p->points.cells.cell[i];
        s->equal += c->equal;
        for (int k = 0; k < PBS_CLOD_LEVELS; k++) {
            if (!c->level[k]) continue;
            top = k > top ? k : top;
            least = k < least ? k : least;
        }
    }
    s->levels = top - least + 1 + (s->equal > 0);
    s->root_spacing = ldexp(l->step, top);
}

enum { LEAST = 24 << 20, A_THREAD = 16 << 20, THREADS = 112 << 20 };

/* A thread needs memory of its own; a thread less changes nothing but time. */
static int threads_that_fit(pbs_run *run) {
    size_t left = pbs_mem_left(run) / 2;
    int most = (int)((left < THREADS ? left : THREADS) / A_THREAD);
    if (run->mem_limit && run->mem_floor < pbs_mem_used(run) + LEAST)
        run->mem_floor = pbs_mem_used(run) + LEAST;
    return most < 1 ? 1 : most < run->threads ? most : run->threads;
}

/* Less threads than there are while a step lasts. */
static int narrow(pbs_run *run, int threads) {
    int before = run->threads;
    run->threads = threads;
    return before;
}

pbs_code pbs_cloudpack_make(pbs_run *run, const pbs_cloud *clouds, size_t count, pack **out,
                            pbs_err *err) {
    pack *p;
    pbs_code rc = pbs_alloc(run, &p, 1, sizeof *p, "the cloud", err);
    *out = rc ? NULL : p;
    if (rc) return rc;
    *p = (pack){.run = run, .threads = threads_that_fit(run)};
    int threads = narrow(run, p->threads);
    rc = pbs_cloud_take(run, clouds, count, &p->points, err);
    if (!rc) rc = make_levels(p, err);
    narrow(run, threads);
    if (rc) pbs_cloudpack_free(p);
    if (rc) *out = NULL;
    return rc;
}

void pbs_cloudpack_free(pack *p) {
    if (!p) return;
    pbs_cloud_tree_free(p->run, &p->tree);
    pbs_clod_upper_free(p->run, &p->upper);
    pbs_cloud_points_free(p->run, &p->points);
    pbs_free(p->run, p);
}

uint32_t pbs_cloudpack_nodes(const pack *p) {
    return (uint32_t)p->tree.count;
}

pbs_node pbs_cloudpack_root(const pack *p) {
    return pbs_cloud_tree_node(&p->tree, 0);
}

uint32_t pbs_cloudpack_channels(const pack *p) {
    return own_record(p).channels;
}

uint64_t pbs_cloudpack_chunks(const pack *p) {
    uint64_t n = p->tree.count;
    for (size_t i = 0; i < p->tree.count; i++)
        n += pbs_points_chunks(p->tree.node[i].count, PBS_ARCHIVE_CHUNK);
    return n;
}

pbs_code pbs_cloudpack_write_nodes(pack *p, pbs_writer *w, uint32_t first, pbs_err *err) {
    p->w = w;
    p->first = first;
    return write_nodes(p, err);
}

pbs_code pbs_cloudpack_write_points(pack *p, const pbs_record *record, pbs_err *err) {
    p->record = *record;
    int threads = narrow(p->run, p->threads);
    pbs_code rc = write_points(p, err);
    narrow(p->run, threads);
    return rc;
}

static pbs_code write_archive(pack *p, const pbs_writer_desc *desc, pbs_writer **w, pbs_err *err) {
    pbs_writer_desc d = *desc;
    pbs_record record = own_record(p);
    char channels[256];
    pbs_record_text(&record, channels);
    d.kind = PBS_ARCHIVE;
    d.channels = channels;
    d.front = pbs_cloudpack_chunks(p);
    pbs_code rc = pbs_writer_open(p->run, &d, w, err);
    if (!rc) rc = pbs_cloudpack_write_nodes(p, *w, 0, err);
    if (!rc) rc = pbs_cloudpack_write_points(p, &record, err);
    return rc ? rc : pbs_writer_commit(*w, err);
}

pbs_code pbs_cloudpack(pbs_run *run, const pbs_cloud *clouds, size_t count,
                       const pbs_writer_desc *desc, pbs_cloudpack_stats *stats, pbs_err *err) {
    pack *p;
    pbs_writer *w = NULL;
    pbs_code rc = pbs_cloudpack_make(run, clouds, count, &p, err);
    if (!rc) rc = write_archive(p, desc, &w, err);
    if (!rc) pbs_cloudpack_count(p, stats);
    if (!rc) stats->bytes = pbs_writer_bytes(w);
    pbs_writer_close(w);
    pbs_cloudpack_free(p);
    return rc;
}
