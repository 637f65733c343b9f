/* pack_points.c: the surfels of a node, from the stream's records to the archive's. */
#include "formats/archive/pack_inner.h"
#include <math.h>
#include <string.h>

static void fill(uint8_t *array, size_t n, const uint8_t value[4]) {
    for (size_t i = 0; i < n; i++) memcpy(array + 4 * i, value, 4);
}

static void fill_absent(const pbs_pack *p, uint32_t have, pbs_points *to) {
    uint32_t absent = p->out.channels & ~have;
    uint8_t blank[64] = {0};
    pbs_points_blank(&p->out, blank);
    if (absent & PBS_NORMAL)
        fill((uint8_t *)to->normal, to->count, blank + pbs_record_at(&p->out, PBS_NORMAL));
    if (absent & PBS_COLOUR)
        fill(to->colour, to->count, blank + pbs_record_at(&p->out, PBS_COLOUR));
    if (absent & PBS_MATERIAL)
        fill(to->material, to->count, blank + pbs_record_at(&p->out, PBS_MATERIAL));
    if (absent & PBS_EMISSIVE)
        fill(to->emissive, to->count, blank + pbs_record_at(&p->out, PBS_EMISSIVE));
}

/* The records of a node's chunks with a tag, in arrays of the channels `all`, which have room for
 * `count`. */
static pbs_code load_records(const pbs_pack *p, const pack_entry *e, uint32_t tag,
                             const pbs_record *record, uint32_t all, uint64_t count, pbs_points *to,
                             pbs_err *err) {
    const pack_input *in = &p->inputs[e->input];
    const char *name = pbs_reader_name(in->reader);
    pbs_code rc = pbs_points_alloc(p->run, all, (size_t)count, to, err);
    to->count = 0;
    for (size_t k = e->first_chunk; k < e->end_chunk && !rc; k++) {
        pbs_chunk c;
        if (in->entries[k].tag != tag) continue;
        rc = pbs_reader_at(in->reader, &in->entries[k], &c, err);
        if (!rc) rc = pbs_points_read(name, record, &c, to, NULL, err);
    }
    if (rc)
        pbs_points_free(p->run, to);
    else
        fill_absent(p, record->channels, to);
    return rc;
}

static pbs_code load_points(const pbs_pack *p, const pack_entry *e, uint32_t channels,
                            pbs_points *to, pbs_err *err) {
    const pack_input *in = &p->inputs[e->input];
    const char *name = pbs_reader_name(in->reader), *fault;
    pbs_code rc =
        load_records(p, e, PBS_TAG_POINTS, &in->record, channels, e->node.records, to, err);
    if (!rc && (fault = pbs_points_fault(to, 0)))
        rc = pbs_fail(err, PBS_DATA, "%s: node %u: %s", name, e->own, fault);
    if (rc) pbs_points_free(p->run, to);
    return rc;
}

pbs_code pack_choose_lattice(pbs_pack *p, pack_entry *e, pbs_err *err) {
    if (!e->has_points) return PBS_OK;
    pbs_points points;
    pbs_code rc = load_points(p, e, p->out.channels, &points, err);
    if (rc) return rc;
    pbs_lattice l = pbs_lattice_of(points.position, points.count);
    memcpy(e->node.lattice_min, l.min, sizeof l.min);
    e->node.lattice = l.step;
    pbs_points_free(p->run, &points);
    pbs_trim_now(&p->trim);
    return PBS_OK;
}

static void measure_error(pbs_pack *p, const pbs_points *points, const pbs_lattice *l) {
    for (size_t i = 0; i < points->count; i++) {
        double d = 0;
        for (int k = 0; k < 3; k++) {
            float v = points->position[3 * i + (size_t)k];
            double x = (double)pbs_lattice_get(l, k, pbs_lattice_put(l, k, v)) - v;
            d += x * x;
        }
        p->stats.error = fmax(p->stats.error, sqrt(d));
    }
    p->stats.bound = fmax(p->stats.bound, sqrt(3) / 2 * l->step);
}

static pbs_code write_octaves(pbs_pack *p, const pack_entry *e, pbs_err *err) {
    if (!e->octaves) return PBS_OK;
    pbs_points points;
    pbs_record from = pbs_octave_record(p->inputs[e->input].record.channels);
    pbs_record to = pbs_octave_record(p->out.channels);
    pbs_code rc = load_records(p, e, PBS_TAG_OCTAVES, &from, to.channels, e->octaves, &points, err);
    if (rc) return rc;
    rc = pbs_octaves_write(p->run, p->w, &to, e->number, &points, PBS_ARCHIVE_CHUNK, err);
    pbs_points_free(p->run, &points);
    return rc;
}

pbs_code pack_write_points(pbs_pack *p, const pack_entry *e, pbs_err *err) {
    if (!e->has_points) return PBS_OK;
    const pbs_node *n = &e->node;
    pbs_points points;
    pbs_code rc = write_octaves(p, e, err);
    if (!rc) rc = load_points(p, e, p->out.channels, &points, err);
    if (rc) return rc;
    pbs_lattice l = {{n->lattice_min[0], n->lattice_min[1], n->lattice_min[2]}, n->lattice};
    measure_error(p, &points, &l);
    p->stats.surfels += points.count;
    rc = pbs_points_write(p->run, p->w, &p->out, e->number, &points, 0, PBS_ARCHIVE_CHUNK, &l, err);
    pbs_points_free(p->run, &points);
    return rc;
}
