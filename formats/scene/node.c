#include "formats/scene/node.h"
#include "formats/container/wire.h"
#include <float.h>
#include <string.h>

/* The fixed part; then the name, zeros to a multiple of 8, and the children. */
enum {
    AT_ORIGIN = 0,
    AT_BOX = 24,
    AT_TRIANGLES = 72,
    AT_RECORDS = 80,
    AT_PIXEL = 88,
    AT_COVERING = 96,
    AT_MEDIAN = 104,
    AT_LATTICE_MIN = 112,
    AT_LATTICE = 136,
    AT_MEDIAN_COUNT = 144,
    AT_NAME_BYTES = 148,
    AT_CHILDREN = 152,
    AT_WANTED = 156,
    FIXED = 160,
    /* one child: f64 transform[12], u32 node, u32 flags, u32 name bytes, u32 motion, name to 8 */
    CHILD_FIXED = 112,
    CHILD_NODE_AT = 96,
    CHILD_FLAGS_AT = 100,
    CHILD_NAME_AT = 104,
    CHILD_MOTION_AT = 108
};

static size_t name_bytes(const char *name) {
    return name ? strlen(name) : 0;
}
static size_t padded(size_t n) {
    return n + (size_t)pbs_padding(n, 8);
}

static size_t node_size(const pbs_node *n) {
    size_t size = FIXED + padded(name_bytes(n->name));
    for (uint32_t i = 0; i < n->child_count; i++)
        size += CHILD_FIXED + padded(name_bytes(n->children[i].name));
    return size;
}

static uint8_t *put_doubles(uint8_t *p, const double *v, int n) {
    while (n--) p = pbs_put_f64(p, *v++);
    return p;
}

/* Transforms may blow a box up beyond all numbers, or leave it without a coordinate. What is read
 * is finite or empty. */
static pbs_box sound_box(const pbs_box *b) {
    pbs_box out;
    if (pbs_box_is_empty(b)) return PBS_BOX_EMPTY;
    for (int k = 0; k < 3; k++) {
        out.min[k] = fmin(fmax(b->min[k], -DBL_MAX), DBL_MAX);
        out.max[k] = fmin(fmax(b->max[k], -DBL_MAX), DBL_MAX);
    }
    return out;
}

static void put_fixed(uint8_t *p, const pbs_node *n) {
    pbs_box box = sound_box(&n->box);
    put_doubles(p + AT_ORIGIN, n->origin, 3);
    put_doubles(put_doubles(p + AT_BOX, box.min, 3), box.max, 3);
    pbs_put_u64(p + AT_TRIANGLES, n->triangles);
    pbs_put_u64(p + AT_RECORDS, n->records);
    pbs_put_f64(p + AT_PIXEL, n->pixel);
    pbs_put_f64(p + AT_COVERING, n->covering);
    pbs_put_f64(p + AT_MEDIAN, n->median);
    put_doubles(p + AT_LATTICE_MIN, n->lattice_min, 3);
    pbs_put_f64(p + AT_LATTICE, n->lattice);
    pbs_put_u32(p + AT_MEDIAN_COUNT, n->median_count);
    pbs_put_u32(p + AT_NAME_BYTES, (uint32_t)name_bytes(n->name));
    pbs_put_u32(p + AT_CHILDREN, n->child_count);
    pbs_put_u32(p + AT_WANTED, n->wanted);
}

static uint8_t *put_name(uint8_t *p, const char *name) {
    size_t n = name_bytes(name);
    if (n) memcpy(p, name, n);
    return p + padded(n);
}

pbs_code pbs_node_write(pbs_run *run, pbs_writer *w, const pbs_node *n, pbs_err *err) {
    size_t size = node_size(n);
    uint8_t *buf;
    pbs_code rc = pbs_alloc(run, &buf, size, 1, "a node", err);
    if (rc) return rc;
    memset(buf, 0, size);
    put_fixed(buf, n);
    uint8_t *p = put_name(buf + FIXED, n->name);
    for (uint32_t i = 0; i < n->child_count; i++) {
        const pbs_child *c = &n->children[i];
        put_doubles(p, c->m, 12);
        pbs_put_u32(p + CHILD_NODE_AT, c->node);
        pbs_put_u32(p + CHILD_FLAGS_AT, c->flags);
        pbs_put_u32(p + CHILD_NAME_AT, (uint32_t)name_bytes(c->name));
        pbs_put_u32(p + CHILD_MOTION_AT, c->motion);
        p = put_name(p + CHILD_FIXED, c->name);
    }
    pbs_chunk c = {.tag = PBS_TAG_NODE, .flags = n->flags, .node = n->id, .count = 1};
    pbs_piece piece = {buf, size};
    rc = pbs_writer_chunk(w, &c, &piece, 1, err);
    pbs_free(run, buf);
    return rc;
}

/* ---- reading: a cursor that never passes the end ---- */

typedef struct cursor {
    const uint8_t *p;
    size_t left;
} cursor;

static const uint8_t *take(cursor *c, size_t n) {
    if (n > c->left) return NULL;
    const uint8_t *p = c->p;
    c->p += n;
    c->left -= n;
    return p;
}

static bool get_finite(const uint8_t *p, double *v, int n) {
    bool ok = true;
    for (int i = 0; i < n; i++) {
        v[i] = pbs_get_f64(p + 8 * i);
        ok = ok && isfinite(v[i]);
    }
    return ok;
}

/* An empty box is stored as +inf, -inf. */
static bool get_box(const uint8_t *p, pbs_box *b) {
    bool finite = get_finite(p, b->min, 3) & get_finite(p + 24, b->max, 3);
    if (finite) return !pbs_box_is_empty(b);
    return !memcmp(b, &PBS_BOX_EMPTY, sizeof *b);
}

static bool get_fixed(const uint8_t *p, pbs_node *n) {
    n->triangles = pbs_get_u64(p + AT_TRIANGLES);
    n->records = pbs_get_u64(p + AT_RECORDS);
    n->median_count = pbs_get_u32(p + AT_MEDIAN_COUNT);
    n->child_count = pbs_get_u32(p + AT_CHILDREN);
    n->wanted = pbs_get_u32(p + AT_WANTED);
    return get_finite(p + AT_ORIGIN, n->origin, 3) & get_box(p + AT_BOX, &n->box) &
           get_finite(p + AT_PIXEL, &n->pixel, 1) & get_finite(p + AT_COVERING, &n->covering, 1) &
           get_finite(p + AT_MEDIAN, &n->median, 1) &
           get_finite(p + AT_LATTICE_MIN, n->lattice_min, 3) &
           get_finite(p + AT_LATTICE, &n->lattice, 1) & (n->lattice >= 0);
}

static pbs_code get_name(pbs_run *run, cursor *c, size_t bytes, const char **name, bool *ok,
                         pbs_err *err) {
    const uint8_t *p = take(c, padded(bytes));
    *ok = p && !memchr(p, 0, bytes);
    if (!*ok) return PBS_OK;
    char *copy;
    pbs_code rc = pbs_alloc(run, &copy, bytes + 1, 1, "a node's name", err);
    if (rc) return rc;
    memcpy(copy, p, bytes);
    copy[bytes] = 0;
    *name = copy;
    return PBS_OK;
}

static pbs_code get_children(pbs_run *run, cursor *cur, pbs_node *n, bool *ok, pbs_err *err) {
    *ok = n->child_count <= cur->left / CHILD_FIXED;
    if (!*ok || !n->child_count) return PBS_OK;
    pbs_code rc =
        pbs_alloc(run, &n->children, n->child_count, sizeof *n->children, "a node's children", err);
    if (rc) return rc;
    memset(n->children, 0, n->child_count * sizeof *n->children);
    for (uint32_t i = 0; i < n->child_count && *ok && !rc; i++) {
        pbs_child *c = &n->children[i];
        const uint8_t *p = take(cur, CHILD_FIXED);
        *ok = p && get_finite(p, c->m, 12);
        if (!*ok) break;
        c->node = pbs_get_u32(p + CHILD_NODE_AT);
        c->flags = pbs_get_u32(p + CHILD_FLAGS_AT);
        c->motion = pbs_get_u32(p + CHILD_MOTION_AT);
        uint32_t bytes = pbs_get_u32(p + CHILD_NAME_AT);
        if (bytes) rc = get_name(run, cur, bytes, &c->name, ok, err);
        *ok = *ok && c->node < n->id && (!c->motion || c->flags & PBS_CHILD_MOVES);
    }
    return rc;
}

pbs_code pbs_node_read(pbs_run *run, const char *place, const pbs_chunk *chunk, uint32_t expect,
                       pbs_node *n, pbs_err *err) {
    memset(n, 0, sizeof *n);
    n->id = chunk->node;
    n->flags = chunk->flags;
    cursor cur = {chunk->payload, (size_t)chunk->bytes};
    const uint8_t *p = take(&cur, FIXED);
    bool ok = p && n->id == expect && get_fixed(p, n);
    uint32_t children = n->child_count;
    pbs_code rc = PBS_OK;
    n->child_count = 0; /* none allocated yet, for pbs_node_free */
    if (ok) rc = get_name(run, &cur, pbs_get_u32(p + AT_NAME_BYTES), &n->name, &ok, err);
    if (ok && !rc) {
        n->child_count = children;
        rc = get_children(run, &cur, n, &ok, err);
        if (!n->children) n->child_count = 0;
    }
    if (!rc && (!ok || cur.left))
        rc = pbs_fail(err, PBS_DATA, "%s: node %u is damaged", place, chunk->node);
    if (rc) pbs_node_free(run, n);
    return rc;
}

void pbs_node_free(pbs_run *run, pbs_node *n) {
    for (uint32_t i = 0; i < n->child_count; i++) pbs_free(run, (void *)n->children[i].name);
    pbs_free(run, n->children);
    pbs_free(run, (void *)n->name);
    memset(n, 0, sizeof *n);
}
