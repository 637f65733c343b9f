/* keep.c: a spool with the channels of each node one after the other, so that a prefix is one read
 * a channel. */
#include "formats/surfels/keep.h"
#include <errno.h>
#include <stdlib.h>
#include <unistd.h>

typedef struct kept {
    uint32_t node;
    uint32_t count;
    uint64_t at; /* in the spool */
    double covering;
    pbs_box box;
} kept;

struct pbs_keep {
    pbs_run *run;
    uint32_t channels;
    pbs_output spool;
    bool open;
    kept *nodes;
    size_t count, cap;
    struct { /* the answer before: one part is often placed many times at one scale */
        uint32_t node;
        double radius, covered;
        size_t prefix;
    } last;
};

pbs_code pbs_keep_new(pbs_run *run, uint32_t channels, pbs_keep **out, pbs_err *err) {
    pbs_keep *k = *out = calloc(1, sizeof *k);
    if (!k) return pbs_fail(err, PBS_LIMIT, "no memory");
    k->run = run;
    k->channels = channels | PBS_SPACING;
    pbs_code rc = pbs_output_spool(run, &k->spool, err);
    k->open = !rc;
    if (!rc) return PBS_OK;
    pbs_keep_free(k);
    *out = NULL;
    return rc;
}

void pbs_keep_free(pbs_keep *k) {
    if (!k) return;
    if (k->open) pbs_output_close(&k->spool);
    pbs_free(k->run, k->nodes);
    free(k);
}

/* A node's arrays in the order in which they lie in the spool. */
enum { ARRAYS = 6 };
typedef struct array {
    void *data;
    size_t size; /* bytes a surfel; 0: absent */
} array;

static void arrays_of(const pbs_keep *k, const pbs_points *p, array out[ARRAYS]) {
    out[0] = (array){p->spacing, 4};
    out[1] = (array){p->position, 12};
    out[2] = (array){p->normal, k->channels & PBS_NORMAL ? 4 : 0};
    out[3] = (array){p->colour, k->channels & PBS_COLOUR ? 4 : 0};
    out[4] = (array){p->material, k->channels & PBS_MATERIAL ? 4 : 0};
    out[5] = (array){p->emissive, k->channels & PBS_EMISSIVE ? 4 : 0};
}

static pbs_box box_of(const pbs_points *p) {
    pbs_box box = PBS_BOX_EMPTY;
    for (size_t i = 0; i < p->count; i++) {
        const float *f = p->position + 3 * i;
        pbs_box_add(&box, (double[3]){f[0], f[1], f[2]});
    }
    return box;
}

pbs_code pbs_keep_put(pbs_keep *k, uint32_t node, const pbs_points *surfels, double covering,
                      pbs_err *err) {
    pbs_code rc = pbs_grow(k->run, &k->nodes, &k->cap, k->count + 1, sizeof *k->nodes,
                           "the list of surfels", err);
    if (rc || !surfels->count) return rc;
    array a[ARRAYS];
    arrays_of(k, surfels, a);
    k->nodes[k->count++] =
        (kept){node, (uint32_t)surfels->count, k->spool.written, covering, box_of(surfels)};
    for (int i = 0; i < ARRAYS && !rc; i++)
        rc = pbs_output_write(&k->spool, a[i].data, a[i].size * surfels->count, err);
    return rc;
}

static const kept *find(const pbs_keep *k, uint32_t node) {
    size_t low = 0, high = k->count;
    while (low < high) {
        size_t mid = low + (high - low) / 2;
        if (k->nodes[mid].node < node)
            low = mid + 1;
        else
            high = mid;
    }
    return low < k->count && k->nodes[low].node == node ? &k->nodes[low] : NULL;
}

pbs_box pbs_keep_box(const pbs_keep *k, uint32_t node) {
    const kept *n = find(k, node);
    return n ? n->box : PBS_BOX_EMPTY;
}

static pbs_code read_at(pbs_keep *k, uint64_t at, void *to, size_t bytes, pbs_err *err) {
    pbs_code rc = pbs_output_flush(&k->spool, err);
    for (size_t got = 0; !rc && got < bytes;) {
        ssize_t n = pread(k->spool.fd, (char *)to + got, bytes - got, (off_t)(at + got));
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return pbs_fail_errno(err, "%s", k->spool.name);
        if (!n) return pbs_fail(err, PBS_IO, "%s: ends early", k->spool.name);
        got += (size_t)n;
    }
    return rc;
}

static pbs_code search(pbs_keep *k, uint32_t node, double radius, size_t *prefix, double *covered,
                       pbs_err *err) {
    const kept *n = find(k, node);
    *prefix = 0;
    *covered = 0;
    if (!n) return PBS_OK;
    size_t low = 1, high = n->count; /* spacing[i] is the covering radius of i surfels */
    float at = 0;
    *covered = n->covering;
    while (low < high) {
        size_t mid = low + (high - low) / 2;
        pbs_code rc = read_at(k, n->at + 4 * mid, &at, sizeof at, err);
        if (rc) return rc;
        if (at <= radius) {
            high = mid;
            *covered = at;
        } else
            low = mid + 1;
    }
    *prefix = low;
    return PBS_OK;
}

pbs_code pbs_keep_prefix(pbs_keep *k, uint32_t node, double radius, size_t *prefix, double *covered,
                         pbs_err *err) {
    if (!k->last.prefix || k->last.node != node || k->last.radius != radius) {
        pbs_code rc = search(k, node, radius, &k->last.prefix, &k->last.covered, err);
        if (rc) k->last.prefix = 0;
        if (rc) return rc;
        k->last.node = node;
        k->last.radius = radius;
    }
    *prefix = k->last.prefix;
    *covered = k->last.covered;
    return PBS_OK;
}

pbs_code pbs_keep_get(pbs_keep *k, uint32_t node, size_t count, pbs_points *out, size_t *cap,
                      pbs_err *err) {
    const kept *n = find(k, node);
    array a[ARRAYS];
    pbs_code rc = pbs_points_grow(k->run, k->channels, out, cap, count, err);
    if (rc || !n) return rc;
    arrays_of(k, out, a);
    uint64_t at = n->at;
    for (int i = 0; i < ARRAYS && !rc; i++) {
        rc = read_at(k, at, a[i].data, a[i].size * count, err);
        at += a[i].size * n->count;
    }
    out->count = count;
    return rc;
}
