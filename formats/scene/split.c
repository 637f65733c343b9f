/* split.c: an octree over the triangles of a part, out of core: paper 1, section 3.1.
 *
 * Three passes over the triangles: the box of their middles; how many there are in each of 32^3
 * cells, from which the tree follows; and each to the place of its leaf. A cell that is still too
 * full has a place of its own, and the same is done again with what is in it.
 */
#include "formats/scene/split.h"

enum { DEPTH = 5, SIDE = 1 << DEPTH, CELLS = SIDE * SIDE * SIDE };
/* All levels of the octree, one after the other: level d begins at (8^d - 1) / 7. */
enum { ALL_CELLS = (8 * CELLS - 1) / 7 };
enum { TRIM_EVERY = 512 };

typedef enum op_kind { LEAF, DENSE, CLOSE } op_kind;
typedef struct op {
    op_kind kind;
    uint32_t n; /* the bucket; of CLOSE: how many of the last nodes become one */
} op;

typedef struct bucket {
    uint64_t count, at; /* triangles; where the next one goes, and at last the end */
} bucket;

/* Where triangles come from: a list, or places of the level above. */
typedef struct source {
    pbs_meshlist *list;
    const uint8_t *bytes;
    uint64_t count;
} source;

typedef struct level {
    pbs_box box;
    double scale;
    op *ops; /* what becomes of the buckets, in order */
    size_t op_count, op_room;
    bucket *bucket;
    size_t buckets, bucket_room;
    pbs_scratch place;
} level;

typedef struct splitter {
    const pbs_split *s;
    pbs_trim trim;
    size_t vertex_bytes, stride;
    bool normals; /* any mesh has some */
    uint32_t corners;
    uint64_t *sum;   /* triangles of each cell of each level */
    uint32_t *to;    /* the bucket of each of the smallest cells */
    uint32_t *stack; /* nodes that have no parent yet */
    size_t nodes, room;
} splitter;

static size_t level_start(int depth) {
    return (((size_t)1 << 3 * depth) - 1) / 7;
}

/* ---- triangles at their places ---- */

static uint8_t *pack(uint8_t *p, uint32_t corners, const pbs_vertex v[3], uint32_t material) {
    for (int i = 0; i < 3; i++) {
        memcpy(p, v[i].position, 12), p += 12;
        if (corners & PBS_CORNER_UV) memcpy(p, v[i].uv, 8), p += 8;
        if (corners & PBS_CORNER_NORMAL) memcpy(p, v[i].normal, 4), p += 4;
        if (corners & PBS_CORNER_COLOUR) memcpy(p, v[i].colour, 4), p += 4;
    }
    memcpy(p, &material, 4);
    return p + 4;
}

static void unpack(const uint8_t *p, uint32_t corners, pbs_vertex v[3], uint32_t *material) {
    memset(v, 0, 3 * sizeof *v);
    for (int i = 0; i < 3; i++) {
        memcpy(v[i].position, p, 12), p += 12;
        if (corners & PBS_CORNER_UV) memcpy(v[i].uv, p, 8), p += 8;
        if (corners & PBS_CORNER_NORMAL) memcpy(v[i].normal, p, 4), p += 4;
        if (corners & PBS_CORNER_COLOUR) memcpy(v[i].colour, p, 4), p += 4;
    }
    memcpy(material, p, 4);
}

static size_t vertex_bytes(uint32_t corners) {
    return 12u + (corners & PBS_CORNER_UV ? 8 : 0) + (corners & PBS_CORNER_NORMAL ? 4 : 0) +
           (corners & PBS_CORNER_COLOUR ? 4 : 0);
}

void pbs_leaf_get(const pbs_leaf *leaf, uint64_t i, pbs_vertex v[3], uint32_t *material) {
    if (i % TRIM_EVERY == 0) pbs_trim_now(leaf->trim);
    unpack(leaf->bytes + i * leaf->stride, leaf->corners, v, material);
}

/* ---- passes ---- */

/* Three times the middle. */
static void add_up(const float *a, const float *b, const float *c, double sum[3]) {
    for (int k = 0; k < 3; k++) sum[k] = (double)a[k] + b[k] + c[k];
}

static uint32_t spread(uint32_t v) {
    return (v & 1) | (v & 2) << 2 | (v & 4) << 4 | (v & 8) << 6 | (v & 16) << 8;
}

/* The smallest cell, in Morton order. */
static uint32_t cell_of(const level *l, const double sum[3]) {
    uint32_t cell = 0;
    for (int k = 0; k < 3; k++) {
        double x = (sum[k] - l->box.min[k]) * l->scale;
        cell |= spread(x < SIDE - 1 ? (uint32_t)x : SIDE - 1) << k;
    }
    return cell;
}

typedef enum pass { BOX, COUNT, PUT } pass;

static uint8_t *place_of(splitter *p, level *l, const double sum[3]) {
    return (uint8_t *)l->place.bytes + l->bucket[p->to[cell_of(l, sum)]].at++ * p->stride;
}

static pbs_code pass_list(splitter *p, level *l, pbs_meshlist *list, pass what, pbs_err *err) {
    pbs_mesh m;
    const void *payload;
    size_t bytes;
    uint64_t done = 0;
    for (uint64_t at = 0; pbs_meshlist_next(list, &at, &m, &payload, &bytes);) {
        p->normals |= m.normal != NULL;
        for (uint32_t t = 0; t < m.triangles; t++) {
            const uint16_t *i = m.index + 3 * (size_t)t;
            double sum[3];
            add_up(m.position + 3 * i[0], m.position + 3 * i[1], m.position + 3 * i[2], sum);
            if (what == BOX) {
                pbs_box_add(&l->box, sum);
            } else if (what == COUNT) {
                p->sum[level_start(DEPTH) + cell_of(l, sum)]++;
            } else {
                pbs_vertex v[3];
                uint32_t material;
                if (t % TRIM_EVERY == 0) pbs_trim_now(&p->trim);
                pbs_mesh_stored(&m, t, p->corners, v, &material);
                pack(place_of(p, l, sum), p->corners, v, material);
            }
        }
        done += m.triangles;
        pbs_run_progress(p->s->run, "splitting", (uint64_t)what * list->triangles + done,
                         3 * list->triangles);
        pbs_code rc = pbs_run_check(p->s->run, err);
        if (rc) return rc;
    }
    return PBS_OK;
}

static pbs_code pass_places(splitter *p, level *l, const source *from, pass what, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (uint64_t t = 0; t < from->count && !rc; t++) {
        const uint8_t *r = from->bytes + t * p->stride;
        float v[3][3];
        double sum[3];
        for (int i = 0; i < 3; i++) memcpy(v[i], r + (size_t)i * p->vertex_bytes, sizeof v[i]);
        add_up(v[0], v[1], v[2], sum);
        if (what == BOX)
            pbs_box_add(&l->box, sum);
        else if (what == COUNT)
            p->sum[level_start(DEPTH) + cell_of(l, sum)]++;
        else
            memcpy(place_of(p, l, sum), r, p->stride);
        if (t % TRIM_EVERY) continue;
        pbs_trim_now(&p->trim);
        rc = pbs_run_check(p->s->run, err);
    }
    return rc;
}

static pbs_code one_pass(splitter *p, level *l, const source *from, pass what, pbs_err *err) {
    return from->list ? pass_list(p, l, from->list, what, err) : pass_places(p, l, from, what, err);
}

/* ---- the tree ---- */

static pbs_code add_op(splitter *p, level *l, op_kind kind, size_t n, pbs_err *err) {
    pbs_code rc = pbs_grow(p->s->run, &l->ops, &l->op_room, l->op_count + 1, sizeof *l->ops,
                           "the tree of a part", err);
    if (!rc) l->ops[l->op_count++] = (op){kind, (uint32_t)n};
    return rc;
}

static pbs_code add_bucket(splitter *p, level *l, uint64_t count, pbs_err *err) {
    pbs_code rc = pbs_grow(p->s->run, &l->bucket, &l->bucket_room, l->buckets + 1,
                           sizeof *l->bucket, "the tree of a part", err);
    if (!rc) l->bucket[l->buckets++] = (bucket){count, 0};
    return rc;
}

static void send_cell(splitter *p, int depth, uint32_t cell, size_t to) {
    size_t each = (size_t)1 << 3 * (DEPTH - depth);
    for (size_t i = 0; i < each; i++) p->to[cell * each + i] = (uint32_t)to;
}

/* A child that is small enough joins the first leaf of its cell that has room for it. */
static pbs_code join_leaf(splitter *p, level *l, size_t leaves[8], int *n, uint64_t count,
                          size_t *to, pbs_err *err) {
    for (int i = 0; i < *n; i++) {
        *to = leaves[i];
        if (l->bucket[*to].count > p->s->limit - count) continue;
        l->bucket[*to].count += count;
        return PBS_OK;
    }
    *to = leaves[(*n)++] = l->buckets;
    return add_bucket(p, l, count, err);
}

/* The tree below a cell that is to be divided. */
static pbs_code plan(splitter *p, level *l, int depth, uint32_t cell, pbs_err *err) {
    size_t leaves[8], nodes = 0, to;
    int leaf_count = 0;
    pbs_code rc = PBS_OK;
    for (uint32_t child = 8 * cell; child < 8 * cell + 8 && !rc; child++) {
        uint64_t count = p->sum[level_start(depth + 1) + child];
        if (!count) continue;
        if (count <= p->s->limit) {
            rc = join_leaf(p, l, leaves, &leaf_count, count, &to, err);
            send_cell(p, depth + 1, child, to);
            continue;
        }
        nodes++;
        if (depth + 1 < DEPTH) {
            rc = plan(p, l, depth + 1, child, err);
            continue;
        }
        p->to[child] = (uint32_t)l->buckets;
        rc = add_op(p, l, DENSE, l->buckets, err);
        if (!rc) rc = add_bucket(p, l, count, err);
    }
    for (int i = 0; i < leaf_count && !rc; i++) rc = add_op(p, l, LEAF, leaves[i], err);
    nodes += (size_t)leaf_count;
    return rc || nodes < 2 ? rc : add_op(p, l, CLOSE, nodes, err);
}

static pbs_code make_plan(splitter *p, level *l, const source *from, pbs_err *err) {
    memset(p->sum, 0, ALL_CELLS * sizeof *p->sum);
    pbs_code rc = one_pass(p, l, from, COUNT, err);
    for (int d = DEPTH; d-- > 0;)
        for (size_t i = 0; i < (size_t)1 << 3 * d; i++)
            for (size_t k = 0; k < 8; k++)
                p->sum[level_start(d) + i] += p->sum[level_start(d + 1) + 8 * i + k];
    if (!rc) rc = plan(p, l, 0, 0, err);
    uint64_t at = 0;
    for (size_t i = 0; i < l->buckets; i++) l->bucket[i].at = at, at += l->bucket[i].count;
    return rc;
}

/* ---- nodes ---- */

static pbs_code push(splitter *p, uint32_t node, pbs_err *err) {
    pbs_code rc = pbs_grow(p->s->run, &p->stack, &p->room, p->nodes + 1, sizeof *p->stack,
                           "the tree of a part", err);
    if (!rc) p->stack[p->nodes++] = node;
    return rc;
}

static pbs_code make_leaf(splitter *p, const source *from, pbs_err *err) {
    pbs_leaf leaf = {from->bytes, from->count, p->corners, p->stride, &p->trim};
    uint32_t node;
    pbs_code rc = p->s->leaf(p->s->ctx, &leaf, &node, err);
    return rc ? rc : push(p, node, err);
}

static pbs_code split_level(splitter *p, const source *from, bool whole, bool *done, pbs_err *err);

static pbs_code make_nodes(splitter *p, const level *l, bool whole, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < l->op_count && !rc; i++) {
        const op *o = &l->ops[i];
        if (o->kind == CLOSE) {
            uint32_t node;
            p->nodes -= o->n;
            rc = p->s->cell(p->s->ctx, p->stack + p->nodes, o->n, whole && i + 1 == l->op_count,
                            &node, err);
            if (!rc) rc = push(p, node, err);
            continue;
        }
        const bucket *b = &l->bucket[o->n];
        source in = {.count = b->count};
        in.bytes = (const uint8_t *)l->place.bytes + (b->at - b->count) * p->stride;
        bool done = false;
        if (o->kind == DENSE) rc = split_level(p, &in, false, &done, err);
        if (!rc && !done) rc = make_leaf(p, &in, err);
    }
    return rc;
}

static pbs_code fill_places(splitter *p, level *l, const source *from, pbs_err *err) {
    uint64_t count = from->list ? from->list->triangles : from->count;
    pbs_code rc =
        pbs_scratch_new(p->s->run, count, p->stride, "the triangles of a part", &l->place, err);
    if (rc) return rc;
    if (l->place.is_file) pbs_trim_add(&p->trim, l->place.bytes, l->place.size);
    rc = one_pass(p, l, from, PUT, err);
    if (from->list) pbs_meshlist_clear(from->list);
    return rc;
}

/* The first of two middles and the last of them are in different halves of the root cell, so every
 * level gets on, and the whole part has two children at least. */
static pbs_code split_level(splitter *p, const source *from, bool whole, bool *done, pbs_err *err) {
    level l = {.box = PBS_BOX_EMPTY};
    double side = 0;
    pbs_code rc = one_pass(p, &l, from, BOX, err);
    for (int k = 0; k < 3; k++) side = fmax(side, l.box.max[k] - l.box.min[k]);
    *done = !rc && side > 0;
    if (!*done) return rc;
    if (!p->normals) p->corners &= ~(uint32_t)PBS_CORNER_NORMAL;
    p->vertex_bytes = vertex_bytes(p->corners);
    p->stride = 3 * p->vertex_bytes + 4;
    l.scale = SIDE / side;
    rc = make_plan(p, &l, from, err);
    if (!rc) rc = fill_places(p, &l, from, err);
    if (!rc) rc = make_nodes(p, &l, whole, err);
    pbs_trim_drop(&p->trim, l.place.bytes);
    pbs_scratch_free(&l.place);
    pbs_free(p->s->run, l.ops);
    pbs_free(p->s->run, l.bucket);
    return rc;
}

pbs_code pbs_split_part(const pbs_split *s, pbs_meshlist *part, bool *done, uint32_t *node,
                        pbs_err *err) {
    splitter p = {.s = s, .corners = s->corners};
    source from = {.list = part};
    *done = false;
    const char *what = "the tree of a part";
    pbs_trim_open(s->run, &p.trim);
    pbs_code rc = pbs_alloc(s->run, &p.sum, ALL_CELLS, sizeof *p.sum, what, err);
    if (!rc) rc = pbs_alloc(s->run, &p.to, CELLS, sizeof *p.to, what, err);
    if (!rc) rc = split_level(&p, &from, true, done, err);
    if (!rc && *done) *node = p.stack[0];
    pbs_free(s->run, p.sum);
    pbs_free(s->run, p.to);
    pbs_free(s->run, p.stack);
    pbs_trim_close(&p.trim);
    return rc;
}
