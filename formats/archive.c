#include "formats/archive.h"
#include "formats/dag.h"
#include <stdio.h>
#include <string.h>

void pbs_archive_text(const pbs_record *points, uint32_t voxels, char out[512]) {
    char more[256];
    pbs_record_text(points, out);
    pbs_voxels_text(voxels, more);
    size_t n = strlen(out);
    snprintf(out + n, 512 - n, "%s%s", n && *more ? " " : "", more);
}

pbs_code pbs_archive_parse(const char *place, const char *text, pbs_record *points,
                           uint32_t *voxels, pbs_err *err) {
    char first[256];
    const char *second = strstr(text, "place:");
    size_t n = second ? (size_t)(second - text) : strlen(text);
    *points = (pbs_record){0};
    *voxels = 0;
    pbs_code rc = PBS_OK;
    if (n > sizeof first || (second && n && text[n - 1] != ' '))
        return pbs_fail(err, PBS_DATA, "%s: channels that this program does not know: %s", place,
                        text);
    if (second) rc = pbs_voxels_parse(place, second, voxels, err);
    if (rc || !n) return rc; /* an archive of meshes has neither */
    snprintf(first, sizeof first, "%.*s", (int)(n - (second != NULL)), text);
    rc = pbs_record_parse(place, first, points, err);
    if (!rc && !points->packed) rc = pbs_fail(err, PBS_DATA, "%s: not an archive's records", place);
    return rc;
}

static pbs_code count_nodes(pbs_archive *a, const pbs_chunk *e, size_t n, pbs_err *err) {
    size_t count = 0;
    for (size_t i = 0; i < n; i++) count += e[i].tag == PBS_TAG_NODE;
    if (!count) return pbs_fail(err, PBS_DATA, "%s: no node in it", pbs_reader_name(a->reader));
    pbs_code rc = pbs_alloc(a->run, &a->nodes, count, sizeof *a->nodes, "the nodes", err);
    if (!rc) rc = pbs_alloc(a->run, &a->records, count, sizeof *a->records, "the nodes", err);
    if (!rc) rc = pbs_alloc(a->run, &a->voxels_end, count, sizeof *a->voxels_end, "the nodes", err);
    if (!rc) rc = pbs_alloc(a->run, &a->joined, count, sizeof *a->joined, "the nodes", err);
    if (!rc) rc = pbs_alloc(a->run, &a->octaves, count, sizeof *a->octaves, "the nodes", err);
    if (!rc)
        rc = pbs_alloc(a->run, &a->joined_octaves, count, sizeof *a->joined_octaves, "the nodes",
                       err);
    if (rc) return rc;
    memset(a->octaves, 0, count * sizeof *a->octaves);
    memset(a->joined_octaves, 0, count * sizeof *a->joined_octaves);
    memset(a->records, 0, count * sizeof *a->records);
    memset(a->voxels_end, 0, count * sizeof *a->voxels_end);
    memset(a->joined, 0, count * sizeof *a->joined);
    return PBS_OK;
}

static pbs_code read_nodes(pbs_archive *a, const pbs_chunk *e, size_t n, pbs_err *err) {
    for (size_t i = 0; i < n; i++) {
        if (e[i].tag != PBS_TAG_NODE) continue;
        pbs_chunk c;
        pbs_code rc = pbs_reader_at(a->reader, &e[i], &c, err);
        if (!rc)
            rc = pbs_node_read(a->run, pbs_reader_name(a->reader), &c, (uint32_t)a->node_count,
                               &a->nodes[a->node_count], err);
        if (rc) return rc;
        a->node_count++;
    }
    return PBS_OK;
}

/* Puts a chunk's records behind those that are there; all: how many there will be. */
static pbs_code join(pbs_archive *a, const pbs_chunk *c, uint64_t all, uint32_t stride,
                     const uint8_t **records, uint8_t **joined, pbs_err *err) {
    if (c->count == all) {
        *records = c->payload;
        return PBS_OK;
    }
    if (!*joined) {
        pbs_code rc = pbs_alloc(a->run, joined, (size_t)all, stride, "a node's surfels", err);
        if (rc) return rc;
        memset(*joined, 0, (size_t)all * stride);
    }
    memcpy(*joined + (size_t)c->first * stride, c->payload, (size_t)c->bytes);
    *records = *joined;
    return PBS_OK;
}

/* seen: points of each node so far, which they follow in order. */
static pbs_code take_points(pbs_archive *a, const pbs_chunk *c, uint64_t *seen, pbs_err *err) {
    const pbs_node *n = c->node < a->node_count ? &a->nodes[c->node] : NULL;
    uint32_t stride = a->record.stride;
    if (!n || !stride || c->bytes != (uint64_t)c->count * stride || !(n->lattice > 0) ||
        c->first != seen[c->node] || c->count > n->records - seen[c->node])
        return pbs_fail(err, PBS_DATA, "%s: points of node %u do not fit it",
                        pbs_reader_name(a->reader), c->node);
    seen[c->node] += c->count;
    return join(a, c, n->records, a->record.stride, &a->records[c->node], &a->joined[c->node], err);
}

static pbs_code take_octaves(pbs_archive *a, const pbs_chunk *c, uint64_t *seen, pbs_err *err) {
    const pbs_node *n = c->node < a->node_count ? &a->nodes[c->node] : NULL;
    uint64_t all = n ? pbs_octave_entries(&a->octave, n->records) : 0;
    if (!n || !c->count || c->bytes != (uint64_t)c->count * a->octave.stride ||
        c->first != seen[c->node] || c->count > all - seen[c->node])
        return pbs_fail(err, PBS_DATA, "%s: octaves of node %u do not fit it",
                        pbs_reader_name(a->reader), c->node);
    seen[c->node] += c->count;
    return join(a, c, all, a->octave.stride, &a->octaves[c->node], &a->joined_octaves[c->node],
                err);
}

/* A node has surfels or voxels, so that voxels are looked at when all surfels are known. */
static pbs_code take_voxels(pbs_archive *a, const pbs_chunk *c, uint64_t *seen, pbs_err *err) {
    pbs_voxel_place place;
    const char *name = pbs_reader_name(a->reader);
    const pbs_node *n = c->node < a->node_count ? &a->nodes[c->node] : NULL;
    if (!n || !a->voxel_channels || !(n->lattice > 0) || a->records[c->node] ||
        c->count > n->records - seen[c->node])
        return pbs_fail(err, PBS_DATA, "%s: voxels of node %u do not fit it", name, c->node);
    pbs_code rc = pbs_voxels_view(name, a->voxel_channels, c, seen[c->node], &place,
                                  &a->voxels[a->voxels_end[c->node]], err);
    if (rc) return rc;
    seen[c->node] += c->count;
    a->voxels_end[c->node]++;
    return PBS_OK;
}

/* Where each node's chunks of voxels go: voxels_end is where they begin until they are there. */
static pbs_code count_voxels(pbs_archive *a, const pbs_chunk *e, size_t n, pbs_err *err) {
    size_t count = 0;
    for (size_t i = 0; i < n; i++) {
        if (e[i].tag != PBS_TAG_VOXELS) continue;
        if (e[i].node >= a->node_count)
            return pbs_fail(err, PBS_DATA, "%s: voxels of node %u, which is not there",
                            pbs_reader_name(a->reader), e[i].node);
        a->voxels_end[e[i].node]++;
        count++;
    }
    for (size_t i = 0, at = 0; i < a->node_count; i++) {
        size_t own = a->voxels_end[i];
        a->voxels_end[i] = at;
        at += own;
    }
    return pbs_alloc(a->run, &a->voxels, count, sizeof *a->voxels, "the chunks of voxels", err);
}

static uint64_t records_in(const pbs_archive *a, const pbs_chunk *e) {
    uint32_t voxel = pbs_voxels_stride(a->voxel_channels);
    if (e->tag == PBS_TAG_POINTS && a->record.stride) return e->bytes / a->record.stride;
    if (e->tag == PBS_TAG_VOXELS && voxel && e->bytes > PBS_VOXELS_HEADER)
        return (e->bytes - PBS_VOXELS_HEADER) / voxel;
    return 0;
}

/* Before any room is taken: what nodes promise must be in the file. */
static pbs_code check_counts(const pbs_archive *a, const pbs_chunk *e, size_t n, pbs_err *err) {
    uint64_t left = 0;
    bool same = true;
    for (size_t i = 0; i < n; i++) left += records_in(a, &e[i]);
    for (size_t i = 0; same && i < a->node_count; i++) {
        same = a->nodes[i].records <= left;
        left -= a->nodes[i].records;
    }
    if (same && !left) return PBS_OK;
    return pbs_fail(err, PBS_DATA, "%s: its nodes do not have as many records as they say",
                    pbs_reader_name(a->reader));
}

static pbs_code read_tag(pbs_archive *a, const pbs_chunk *e, size_t n, uint32_t tag, uint64_t *seen,
                         pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = 0; !rc && i < n; i++) {
        pbs_chunk c;
        if (e[i].tag != tag) continue;
        rc = pbs_reader_at(a->reader, &e[i], &c, err);
        if (rc) break;
        rc = tag == PBS_TAG_POINTS   ? take_points(a, &c, seen, err)
             : tag == PBS_TAG_VOXELS ? take_voxels(a, &c, seen, err)
                                     : take_octaves(a, &c, seen, err);
    }
    return rc;
}

static pbs_code read_records(pbs_archive *a, const pbs_chunk *e, size_t n, pbs_err *err) {
    uint64_t *seen;
    pbs_code rc = pbs_alloc(a->run, &seen, a->node_count, sizeof *seen, "the nodes", err);
    if (rc) return rc;
    memset(seen, 0, a->node_count * sizeof *seen);
    rc = read_tag(a, e, n, PBS_TAG_POINTS, seen, err);
    if (!rc) rc = count_voxels(a, e, n, err);
    if (!rc) rc = read_tag(a, e, n, PBS_TAG_VOXELS, seen, err);
    memset(seen, 0, a->node_count * sizeof *seen);
    if (!rc) rc = read_tag(a, e, n, PBS_TAG_OCTAVES, seen, err);
    for (size_t i = 0; !rc && i < a->node_count; i++)
        if (seen[i] && seen[i] != pbs_octave_entries(&a->octave, a->nodes[i].records))
            rc = pbs_fail(err, PBS_DATA, "%s: octaves of node %zu are not all there",
                          pbs_reader_name(a->reader), i);
    pbs_free(a->run, seen);
    return rc;
}

static pbs_code read_archive(pbs_archive *a, pbs_err *err) {
    const pbs_chunk *e;
    size_t n;
    const char *name = pbs_reader_name(a->reader);
    const char *text = pbs_reader_channels(a->reader);
    pbs_code rc = pbs_reader_kind(a->reader) == PBS_VOXELS
                      ? pbs_voxels_parse(name, text, &a->voxel_channels, err)
                      : pbs_archive_parse(name, text, &a->record, &a->voxel_channels, err);
    if (!rc) a->octave = pbs_octave_record(a->record.channels);
    if (!rc) rc = pbs_reader_directory(a->reader, &e, &n, err);
    if (!rc) rc = count_nodes(a, e, n, err);
    if (!rc) rc = read_nodes(a, e, n, err);
    if (!rc) rc = check_counts(a, e, n, err);
    return rc ? rc : read_records(a, e, n, err);
}

static uint64_t own_records(const void *ctx, uint32_t node) {
    const pbs_archive *a = ctx;
    size_t voxels;
    pbs_archive_voxels(a, node, &voxels);
    return a->records[node] || voxels;
}

static uint64_t own_moving(const void *ctx, uint32_t node) {
    const pbs_archive *a = ctx;
    uint64_t n = 0;
    for (uint32_t i = 0; i < a->nodes[node].child_count; i++)
        n += !!(a->nodes[node].children[i].flags & PBS_CHILD_MOVES);
    return n;
}

pbs_code pbs_archive_open(pbs_run *run, const char *path, pbs_archive *a, pbs_err *err) {
    memset(a, 0, sizeof *a);
    a->run = run;
    pbs_input in;
    pbs_code rc = pbs_input_open(run, path, &in, err);
    if (rc) return rc;
    if ((rc = pbs_input_map(&in, err))) {
        pbs_input_close(&in);
        return rc;
    }
    rc = pbs_reader_open(run, &in, PBS_KIND(PBS_ARCHIVE) | PBS_KIND(PBS_VOXELS), &a->reader, err);
    if (!rc) rc = read_archive(a, err);
    if (!rc) rc = pbs_dag_count(run, a->nodes, a->node_count, own_records, a, &a->placings, err);
    if (!rc) rc = pbs_dag_count(run, a->nodes, a->node_count, own_moving, a, &a->moving, err);
    if (rc) pbs_archive_close(a);
    return rc;
}

void pbs_archive_close(pbs_archive *a) {
    for (size_t i = 0; i < a->node_count; i++) {
        pbs_node_free(a->run, &a->nodes[i]);
        pbs_free(a->run, a->joined[i]);
        pbs_free(a->run, a->joined_octaves[i]);
    }
    pbs_free(a->run, a->nodes);
    pbs_free(a->run, a->records);
    pbs_free(a->run, a->voxels);
    pbs_free(a->run, a->voxels_end);
    pbs_free(a->run, a->placings);
    pbs_free(a->run, a->moving);
    pbs_free(a->run, a->joined);
    pbs_free(a->run, a->octaves);
    pbs_free(a->run, a->joined_octaves);
    pbs_reader_close(a->reader);
    memset(a, 0, sizeof *a);
}
