/* pbs-flatten: surfels of one or more streams into one archive in the player's order. Point clouds
 * are flatten_cloud.c's. */
#include "cmd/flatten_cloud.h"
#include "cmd/tool.h"
#include "formats/node.h"
#include "formats/octaves.h"
#include "formats/points.h"
#include <stdlib.h>
#include <string.h>

static const pbs_tool tool = {
    "pbs-flatten", "Packs surfels or point clouds into one archive", "[FILE...]", 0, -1, NULL, 0,
    false};

typedef struct input {
    pbs_reader *reader;
    pbs_record record;
    const pbs_chunk *entries;
    size_t entry_count;
    uint32_t first_node; /* of this input in the archive */
} input;

/* A node of the archive, and where its points come from. */
typedef struct entry {
    pbs_node node;
    size_t input;
    size_t first_chunk, end_chunk; /* of the input's directory: its points are among these */
    bool has_points;
    uint64_t octaves; /* entries of them; 0: it has none */
} entry;

typedef struct job {
    pbs_app *app;
    pbs_input first; /* of the first input, which is open already */
    input *inputs;
    size_t input_count;
    entry *entries;
    size_t entry_count, entry_cap;
    pbs_record out;
    pbs_writer *w;
    uint64_t surfels, others; /* chunks of tags that this program does not know */
    double error, bound;      /* largest error of a position; what is promised */
} job;

static pbs_lattice lattice_of(const pbs_node *n) {
    pbs_lattice l = {{n->lattice_min[0], n->lattice_min[1], n->lattice_min[2]}, n->lattice};
    return l;
}

/* ---- what the inputs hold ---- */

static pbs_code open_input(job *j, input *in, const char *path, pbs_err *err) {
    pbs_input file = j->first;
    pbs_run *run = &j->app->run;
    pbs_code rc = in == j->inputs ? PBS_OK : pbs_input_open(run, path, &file, err);
    if (rc) return rc;
    if ((rc = pbs_input_map(&file, err))) {
        pbs_input_close(&file);
        return rc;
    }
    rc = pbs_reader_open(run, &file, PBS_KIND(PBS_SURFELS), &in->reader, err);
    if (!rc)
        rc = pbs_record_parse(pbs_reader_name(in->reader), pbs_reader_channels(in->reader),
                              &in->record, err);
    if (!rc && (in->record.packed || !(in->record.channels & PBS_SPACING)))
        rc = pbs_fail(err, PBS_DATA, "%s: surfels without spacing", pbs_reader_name(in->reader));
    if (!rc) rc = pbs_reader_directory(in->reader, &in->entries, &in->entry_count, err);
    if (!rc) j->out.channels |= in->record.channels;
    return rc;
}

static pbs_code add_entry(job *j, const entry *e, pbs_err *err) {
    pbs_code rc = pbs_grow(&j->app->run, &j->entries, &j->entry_cap, j->entry_count + 1,
                           sizeof *j->entries, "the table of nodes", err);
    if (!rc) j->entries[j->entry_count++] = *e;
    return rc;
}

/* Nodes keep their order; their numbers move up by what the inputs before have. */
static pbs_code add_node(job *j, entry e, const pbs_chunk *at, uint64_t points, pbs_err *err) {
    const input *in = &j->inputs[e.input];
    const char *name = pbs_reader_name(in->reader);
    pbs_chunk c;
    uint32_t expect = (uint32_t)j->entry_count - in->first_node;
    pbs_code rc = pbs_reader_at(in->reader, at, &c, err);
    if (!rc) rc = pbs_node_read(&j->app->run, name, &c, expect, &e.node, err);
    if (rc) return rc;
    if (points != e.node.records) {
        rc = pbs_fail(err, PBS_DATA, "%s: node %u has %llu points and not %llu", name, e.node.id,
                      (unsigned long long)points, (unsigned long long)e.node.records);
        pbs_node_free(&j->app->run, &e.node);
        return rc;
    }
    pbs_record octave = pbs_octave_record(in->record.channels);
    if (e.octaves && e.octaves != pbs_octave_entries(&octave, points)) {
        rc = pbs_fail(err, PBS_DATA, "%s: node %u has %llu entries of octaves", name, e.node.id,
                      (unsigned long long)e.octaves);
        pbs_node_free(&j->app->run, &e.node);
        return rc;
    }
    e.has_points = points != 0;
    e.node.id += in->first_node;
    for (uint32_t k = 0; k < e.node.child_count; k++) e.node.children[k].node += in->first_node;
    rc = add_entry(j, &e, err);
    if (rc) pbs_node_free(&j->app->run, &e.node);
    return rc;
}

/* A chunk of points of the node that comes next, of which `have` came before. */
static pbs_code check_points(const job *j, const input *in, const pbs_chunk *c, uint64_t have,
                             pbs_err *err) {
    const char *name = pbs_reader_name(in->reader);
    size_t next = j->entry_count - in->first_node;
    if (c->node != next)
        return pbs_fail(err, PBS_DATA, "%s: points of node %u where %zu is expected", name, c->node,
                        next);
    return pbs_points_fit(name, &in->record, c, have, err);
}

static pbs_code check_octaves(const job *j, const input *in, const pbs_chunk *c, uint64_t have,
                              pbs_err *err) {
    const char *name = pbs_reader_name(in->reader);
    pbs_record octave = pbs_octave_record(in->record.channels);
    if (c->node != j->entry_count - in->first_node || !octave.stride)
        return pbs_fail(err, PBS_DATA, "%s: octaves of node %u are not expected", name, c->node);
    return pbs_points_fit(name, &octave, c, have, err);
}

static pbs_code take_input(job *j, size_t i, pbs_err *err) {
    input *in = &j->inputs[i];
    const char *name = pbs_reader_name(in->reader);
    in->first_node = (uint32_t)j->entry_count;
    size_t first = 0;
    uint64_t points = 0, octaves = 0;
    for (size_t k = 0; k < in->entry_count; k++) {
        const pbs_chunk *c = &in->entries[k];
        pbs_code rc = PBS_OK;
        if (c->tag == PBS_TAG_POINTS) {
            rc = check_points(j, in, c, points, err);
            points += c->count;
        } else if (c->tag == PBS_TAG_OCTAVES) {
            rc = check_octaves(j, in, c, octaves, err);
            octaves += c->count;
        } else if (c->tag == PBS_TAG_NODE) {
            entry e = {.input = i, .first_chunk = first, .end_chunk = k, .octaves = octaves};
            rc = add_node(j, e, c, points, err);
            first = k + 1;
            points = octaves = 0;
        } else
            j->others++;
        if (rc) return rc;
    }
    if (points || octaves) return pbs_fail(err, PBS_DATA, "%s: points without a node", name);
    if (j->entry_count == in->first_node) return pbs_fail(err, PBS_DATA, "%s: no node in it", name);
    return PBS_OK;
}

/* Several inputs get a root of their own, so that an archive always has one. */
static pbs_code add_root(job *j, pbs_err *err) {
    pbs_run *run = &j->app->run;
    entry e = {.node = {.id = (uint32_t)j->entry_count, .box = PBS_BOX_EMPTY}};
    pbs_node *n = &e.node;
    pbs_code rc = pbs_alloc(run, &n->children, j->input_count, sizeof *n->children,
                            "the root's children", err);
    for (size_t i = 0; i < j->input_count && !rc; i++) {
        bool last = i + 1 == j->input_count;
        uint32_t id = (last ? (uint32_t)j->entry_count : j->inputs[i + 1].first_node) - 1;
        const pbs_node *c = &j->entries[id].node;
        pbs_child *child = &n->children[n->child_count++];
        *child = (pbs_child){.node = id};
        memcpy(child->m, PBS_IDENTITY, sizeof child->m);
        if (!pbs_box_is_empty(&c->box))
            pbs_box_add(&n->box, c->box.min), pbs_box_add(&n->box, c->box.max);
        n->triangles += c->triangles;
    }
    if (!rc) rc = add_entry(j, &e, err);
    if (rc) pbs_node_free(run, n);
    return rc;
}

/* ---- the points of a node ---- */

static void fill_absent(const job *j, uint32_t have, pbs_points *p) {
    uint32_t absent = j->out.channels & ~have;
    for (size_t i = 0; i < p->count; i++) {
        if (absent & PBS_NORMAL) memset(p->normal + 2 * i, 0, 4);
        if (absent & PBS_COLOUR) memset(p->colour + 4 * i, 255, 4);
        if (absent & PBS_MATERIAL) memcpy(p->material + 4 * i, "\0\xff\0\0", 4);
        if (absent & PBS_EMISSIVE) memset(p->emissive + 4 * i, 0, 4);
    }
}

/* The records of a node's chunks with a tag, in p's arrays of the channels `all`, which have room
 * for `count`. */
static pbs_code load_records(const job *j, const entry *e, uint32_t tag, const pbs_record *record,
                             uint32_t all, uint64_t count, pbs_points *p, pbs_err *err) {
    const input *in = &j->inputs[e->input];
    const char *name = pbs_reader_name(in->reader);
    pbs_code rc = pbs_points_alloc(&j->app->run, all, (size_t)count, p, err);
    p->count = 0;
    for (size_t k = e->first_chunk; k < e->end_chunk && !rc; k++) {
        pbs_chunk c;
        if (in->entries[k].tag != tag) continue;
        rc = pbs_reader_at(in->reader, &in->entries[k], &c, err);
        if (!rc) rc = pbs_points_read(name, record, &c, p, NULL, err);
    }
    if (rc)
        pbs_points_free(&j->app->run, p);
    else
        fill_absent(j, record->channels, p);
    return rc;
}

static pbs_code load_points(const job *j, const entry *e, pbs_points *p, pbs_err *err) {
    const input *in = &j->inputs[e->input];
    const char *name = pbs_reader_name(in->reader), *fault;
    pbs_code rc =
        load_records(j, e, PBS_TAG_POINTS, &in->record, j->out.channels, e->node.records, p, err);
    if (!rc && (fault = pbs_points_fault(p, 0)))
        rc = pbs_fail(err, PBS_DATA, "%s: node %u: %s", name, e->node.id - in->first_node, fault);
    if (rc) pbs_points_free(&j->app->run, p);
    return rc;
}

/* The archive's nodes come before all points, so lattices are needed before they are written. */
static pbs_code choose_lattice(job *j, entry *e, pbs_err *err) {
    if (!e->has_points) return PBS_OK;
    pbs_points p;
    pbs_code rc = load_points(j, e, &p, err);
    if (rc) return rc;
    pbs_lattice l = pbs_lattice_of(p.position, p.count);
    memcpy(e->node.lattice_min, l.min, sizeof l.min);
    e->node.lattice = l.step;
    j->surfels += p.count;
    pbs_points_free(&j->app->run, &p);
    return PBS_OK;
}

static void measure_error(job *j, const pbs_points *p, const pbs_lattice *l) {
    for (size_t i = 0; i < p->count; i++) {
        double d = 0;
        for (int k = 0; k < 3; k++) {
            float v = p->position[3 * i + k];
            double x = (double)pbs_lattice_get(l, k, pbs_lattice_put(l, k, v)) - v;
            d += x * x;
        }
        j->error = fmax(j->error, sqrt(d));
    }
    j->bound = fmax(j->bound, sqrt(3) / 2 * l->step);
}

static pbs_code write_octaves(job *j, const entry *e, pbs_err *err) {
    if (!e->octaves) return PBS_OK;
    pbs_points p;
    pbs_record from = pbs_octave_record(j->inputs[e->input].record.channels);
    pbs_record to = pbs_octave_record(j->out.channels);
    pbs_code rc = load_records(j, e, PBS_TAG_OCTAVES, &from, to.channels, e->octaves, &p, err);
    if (rc) return rc;
    rc = pbs_octaves_write(&j->app->run, j->w, &to, e->node.id, &p, PBS_ARCHIVE_CHUNK, err);
    pbs_points_free(&j->app->run, &p);
    return rc;
}

static pbs_code write_points(job *j, const entry *e, pbs_err *err) {
    if (!e->has_points) return PBS_OK;
    pbs_points p;
    pbs_code rc = write_octaves(j, e, err);
    if (!rc) rc = load_points(j, e, &p, err);
    if (rc) return rc;
    pbs_lattice l = lattice_of(&e->node);
    measure_error(j, &p, &l);
    rc = pbs_points_write(&j->app->run, j->w, &j->out, e->node.id, &p, 0, PBS_ARCHIVE_CHUNK, &l,
                          err);
    pbs_points_free(&j->app->run, &p);
    return rc;
}

/* ---- the archive ---- */

static char *history_of(const job *j) {
    size_t n = 1;
    for (size_t i = 0; i < j->input_count; i++)
        n += strlen(pbs_reader_history(j->inputs[i].reader));
    char *all = calloc(1, n), *p = all;
    for (size_t i = 0; all && i < j->input_count; i++)
        p = stpcpy(p, pbs_reader_history(j->inputs[i].reader));
    return all;
}

static pbs_code open_writer(job *j, pbs_err *err) {
    uint64_t chunks = j->entry_count + j->others;
    for (size_t i = 0; i < j->entry_count; i++)
        if (j->entries[i].has_points)
            chunks += pbs_points_chunks(j->entries[i].node.records, PBS_ARCHIVE_CHUNK) +
                      pbs_points_chunks(j->entries[i].octaves, PBS_ARCHIVE_CHUNK);
    char channels[256], *history = history_of(j);
    if (!history) return pbs_fail(err, PBS_LIMIT, "no memory");
    pbs_record_text(&j->out, channels);
    pbs_code rc = pbs_writer_open(&j->app->run,
                                  &(pbs_writer_desc){.path = j->app->common.output,
                                                     .kind = PBS_ARCHIVE,
                                                     .channels = channels,
                                                     .history = history,
                                                     .stage = j->app->stage,
                                                     .front = chunks},
                                  &j->w, err);
    free(history);
    return rc;
}

/* What this program does not know it passes on. */
static pbs_code write_others(job *j, const input *in, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < in->entry_count && !rc; i++) {
        pbs_chunk c;
        uint32_t tag = in->entries[i].tag;
        if (tag == PBS_TAG_NODE || tag == PBS_TAG_POINTS || tag == PBS_TAG_OCTAVES) continue;
        rc = pbs_reader_at(in->reader, &in->entries[i], &c, err);
        pbs_piece piece = {c.payload, (size_t)c.bytes};
        if (c.node != PBS_NONE) c.node += in->first_node;
        if (!rc) rc = pbs_writer_chunk(j->w, &c, &piece, 1, err);
    }
    return rc;
}

/* Nodes first, then points from the root down: coarse first. */
static pbs_code write_archive(job *j, pbs_err *err) {
    pbs_code rc = open_writer(j, err);
    for (size_t i = 0; i < j->entry_count && !rc; i++)
        rc = pbs_node_write(&j->app->run, j->w, &j->entries[i].node, err);
    for (size_t i = j->entry_count; i-- && !rc;) {
        pbs_run_progress(&j->app->run, "writing", j->entry_count - i, j->entry_count);
        rc = write_points(j, &j->entries[i], err);
    }
    for (size_t i = 0; i < j->input_count && !rc; i++) rc = write_others(j, &j->inputs[i], err);
    return rc ? rc : pbs_writer_commit(j->w, err);
}

static pbs_code flatten(job *j, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < j->input_count && !rc; i++) {
        rc = open_input(j, &j->inputs[i], pbs_operand(j->app, (int)i), err);
        if (!rc) rc = take_input(j, i, err);
    }
    if (!rc && j->input_count > 1) rc = add_root(j, err);
    j->out = pbs_record_make(j->out.channels, true);
    for (size_t i = 0; i < j->entry_count && !rc; i++) rc = choose_lattice(j, &j->entries[i], err);
    return rc ? rc : write_archive(j, err);
}

static pbs_code work(pbs_app *app, void *opt, pbs_err *err) {
    (void)opt;
    job j = {.app = app, .input_count = (size_t)app->common.operand_count};
    bool done;
    pbs_code rc = pbs_flatten_clouds(app, &j.first, &done, err);
    if (rc || done) return rc;
    if (!j.input_count) j.input_count = 1;
    if (!(j.inputs = calloc(j.input_count, sizeof *j.inputs))) {
        pbs_input_close(&j.first);
        return pbs_fail(err, PBS_LIMIT, "no memory");
    }
    rc = flatten(&j, err);
    if (!rc) {
        char channels[256];
        pbs_stat_count(app, "nodes", j.entry_count);
        pbs_stat_count(app, "surfels", j.surfels);
        pbs_record_text(&j.out, channels);
        pbs_stat_record(app, channels, j.out.stride);
        pbs_stat_count(app, "bytes", pbs_writer_bytes(j.w));
        pbs_stat_real(app, "position_error", j.error);
        pbs_stat_real(app, "position_error_bound", j.bound);
    }
    pbs_writer_close(j.w);
    for (size_t i = 0; i < j.entry_count; i++) pbs_node_free(&app->run, &j.entries[i].node);
    pbs_free(&app->run, j.entries);
    for (size_t i = 0; i < j.input_count; i++) pbs_reader_close(j.inputs[i].reader);
    free(j.inputs);
    return rc;
}

int main(int argc, char **argv) {
    return pbs_tool_main(argc, argv, &tool, NULL, work);
}
