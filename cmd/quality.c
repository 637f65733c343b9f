#include "cmd/quality.h"
#include "libcore/measures/measure.h"
#include <stdio.h>
#include <string.h>

static const char head[] = "node\tname\tsurfels\tmin_spacing\tmedian_spacing\tcovering_radius\t"
                           "covering_radius_d\thole_radius\tholes\tcolour_error\t"
                           "colour_error_averaged\n";

pbs_code pbs_quality_open(pbs_quality *q, pbs_err *err) {
    pbs_code rc = pbs_averager_new(q->run, &q->averager, err);
    if (rc || !q->measure) return rc;
    rc = pbs_output_open(q->run, q->measure, &q->table, err);
    if (rc) return rc;
    q->table_open = true;
    return pbs_output_write(&q->table, head, sizeof head - 1, err);
}

size_t pbs_quality_need(const pbs_quality *q, uint32_t channels, size_t candidates,
                        size_t surfels) {
    size_t need = 0;
    if (q->octaves)
        need += pbs_average_need(channels, candidates, surfels) +
                pbs_octave_begin(surfels, 0) * (size_t)pbs_octave_record(channels).stride;
    if (q->measure) need += pbs_measurer_need(channels, candidates, surfels);
    return need;
}

/* ---- measures ---- */

static void put_name(char *to, size_t size, const char *from) {
    size_t n = 0;
    for (; from[n] && n + 1 < size; n++)
        to[n] = (unsigned char)from[n] < 0x20 || from[n] == 0x7f ? '?' : from[n];
    to[n] = 0;
}

static pbs_code write_row(pbs_quality *q, const pbs_node *node, const pbs_measures *m,
                          pbs_err *err) {
    char name[400], row[900];
    put_name(name, sizeof name, node->name);
    int n =
        snprintf(row, sizeof row, "%u\t%s\t%zu\t%.9g\t%.9g\t%.9g\t%.9g\t%.9g\t%.6f\t%.4f\t%.4f\n",
                 node->id, name, m->surfels, m->min_spacing, m->median_spacing, m->covering,
                 m->covering_d, m->radius, m->holes, m->colour_own, m->colour_averaged);
    return pbs_output_write(&q->table, row, (size_t)n, err);
}

/* The colours that a player shows a prefix in; NULL: its own. */
static const uint8_t *shown(const pbs_quality *q, size_t surfels, size_t prefix) {
    int k = pbs_octave_of(surfels, prefix);
    if (!q->octaves || !k || !q->entries.colour) return NULL;
    return q->entries.colour + 4 * pbs_octave_begin(surfels, k);
}

static pbs_code measure_node(pbs_quality *q, const pbs_node *node, const pbs_points *candidates,
                             const uint32_t *order, size_t surfels, pbs_err *err) {
    pbs_measurer *m;
    pbs_code rc = pbs_measurer_new(q->run, candidates, q->normal_weight, &m, err);
    if (rc) return rc;
    for (size_t n = 16; !rc && surfels; n = 4 * n < surfels ? 4 * n : surfels) {
        size_t prefix = n < surfels ? n : surfels;
        const uint8_t *colours = shown(q, surfels, prefix);
        pbs_measures got;
        rc = pbs_measure(m, order, prefix, 0, colours, &got, err);
        if (!colours) got.colour_averaged = got.colour_own;
        if (!rc) rc = write_row(q, node, &got, err);
        if (prefix == surfels) break;
    }
    pbs_measurer_free(m);
    return rc;
}

/* ---- octaves, averaged or found ---- */

static bool has_octaves(const pbs_quality *q, const pbs_points *candidates, size_t surfels) {
    uint32_t channels = pbs_points_channels(candidates) & ~(uint32_t)PBS_POSITION;
    return q->octaves && pbs_octave_record(channels).stride && pbs_octaves(surfels);
}

static int parts_of(const pbs_points *entries, size_t n, pbs_cache_part part[4]) {
    void *channel[4] = {entries->normal, entries->colour, entries->material, entries->emissive};
    int count = 0;
    for (int i = 0; i < 4; i++)
        if (channel[i]) part[count++] = (pbs_cache_part){channel[i], 4 * n};
    return count;
}

void pbs_quality_key(pbs_quality *q, const pbs_cache_key *key, const pbs_points *c) {
    pbs_piece piece[5] = {{"octaves 1", 9},
                          {key, sizeof *key},
                          {c->colour, c->colour ? 4 * c->count : 0},
                          {c->material, c->material ? 4 * c->count : 0},
                          {c->emissive, c->emissive ? 4 * c->count : 0}};
    q->key = pbs_cache_key_of(piece, 5);
}

pbs_code pbs_quality_find(pbs_quality *q, const pbs_points *candidates, size_t surfels, bool *found,
                          pbs_err *err) {
    *found = true;
    if (!has_octaves(q, candidates, surfels)) return PBS_OK;
    size_t n = pbs_octave_begin(surfels, 0);
    pbs_cache_part part[4];
    pbs_code rc = pbs_points_grow(q->run, pbs_points_channels(candidates) & ~(uint32_t)PBS_POSITION,
                                  &q->entries, &q->cap, n, err);
    if (rc) return rc;
    int count = parts_of(&q->entries, n, part);
    *found = pbs_cache_find(q->cache, &q->key, part, count);
    for (int i = 0; i < count && *found; i++) *found = part[i].size == 4 * n;
    q->found = *found;
    if (*found) q->entries.count = n;
    return PBS_OK;
}

static pbs_code make_octaves(pbs_quality *q, pbs_sampler *sampler, const pbs_points *candidates,
                             const uint32_t *order, const float *spacing, size_t surfels,
                             pbs_err *err) {
    pbs_cache_part part[4];
    pbs_piece piece[4];
    size_t n = pbs_octave_begin(surfels, 0);
    pbs_code rc = pbs_points_grow(q->run, pbs_points_channels(candidates) & ~(uint32_t)PBS_POSITION,
                                  &q->entries, &q->cap, n, err);
    if (!rc)
        rc = pbs_average(q->averager, sampler, candidates, order, spacing, surfels, &q->entries,
                         err);
    if (rc || !q->cache) return rc;
    int count = parts_of(&q->entries, n, part);
    for (int i = 0; i < count; i++) piece[i] = (pbs_piece){part[i].bytes, part[i].size};
    return pbs_cache_store(q->cache, &q->key, piece, count, err);
}

pbs_code pbs_quality_node(pbs_quality *q, pbs_writer *w, const pbs_node *node, pbs_sampler *sampler,
                          const pbs_points *candidates, const uint32_t *order, const float *spacing,
                          size_t surfels, pbs_err *err) {
    pbs_record entry = pbs_octave_record(pbs_points_channels(candidates) & ~(uint32_t)PBS_POSITION);
    pbs_code rc = PBS_OK;
    if (has_octaves(q, candidates, surfels)) {
        if (!q->found) rc = make_octaves(q, sampler, candidates, order, spacing, surfels, err);
        q->found = false;
        if (!rc)
            rc = pbs_octaves_write(q->run, w, &entry, node->id, &q->entries, PBS_POINTS_CHUNK, err);
    }
    if (!rc && q->measure) rc = measure_node(q, node, candidates, order, surfels, err);
    return rc;
}

pbs_code pbs_quality_commit(pbs_quality *q, pbs_err *err) {
    return q->table_open ? pbs_output_commit(&q->table, err) : PBS_OK;
}

void pbs_quality_close(pbs_quality *q) {
    if (q->table_open) pbs_output_close(&q->table);
    pbs_points_free(q->run, &q->entries);
    pbs_averager_free(q->averager);
}
