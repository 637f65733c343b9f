/* pbs-flatten: surfels and voxels of one or more streams into one archive in the player's order.
 * Point clouds are flatten_cloud.c's. */
#include "cmd/flatten_cloud.h"
#include "cmd/tool.h"
#include "formats/archive.h"
#include "formats/scene.h"
#include "formats/voxelpack.h"
#include <stdlib.h>
#include <string.h>

typedef struct options {
    int codec; /* pbs_codec */
} options;

static const pbs_option table[] = {
    {0, "codec", PBS_CHOICE, offsetof(options, codec), "WHICH", "how the data is packed", 0, 0,
     pbs_codec_name, true},
};

static const pbs_tool tool = {"pbs-flatten",
                              "Packs surfels and voxels, or point clouds, into one archive",
                              "[FILE...]",
                              0,
                              -1,
                              table,
                              sizeof table / sizeof table[0],
                              false};

typedef struct input {
    pbs_reader *reader;
    pbs_record record; /* of surfels; stride 0: these are voxels */
    uint32_t voxels;   /* channels of voxels */
    const pbs_chunk *entries;
    size_t entry_count;
    uint32_t first_node, first_material; /* of this input in the archive */
} input;

/* A node of the archive, and where its data comes from. */
typedef struct entry {
    pbs_node node;
    size_t input;
    size_t first_chunk, end_chunk; /* of the input's directory: its data is among these */
    bool has_points;
    uint64_t octaves;        /* entries of them; 0: it has none */
    pbs_voxel_survey voxels; /* voxels 0: it has none */
} entry;

typedef struct job {
    pbs_app *app;
    pbs_codec codec;
    pbs_input first; /* of the first input, which is open already */
    input *inputs;
    size_t input_count;
    entry *entries;
    size_t entry_count, entry_cap;
    pbs_record out;
    uint32_t out_voxels;   /* channels */
    uint64_t *voxel_order; /* in which they are written, below */
    size_t voxel_nodes;
    uint32_t materials;
    pbs_writer *w;
    uint64_t surfels, voxels, others; /* chunks of tags that this program does not know */
    double error, bound;              /* largest error of a position; what is promised */
} job;

static pbs_lattice lattice_of(const pbs_node *n) {
    pbs_lattice l = {{n->lattice_min[0], n->lattice_min[1], n->lattice_min[2]}, n->lattice};
    return l;
}

/* ---- what the inputs hold ---- */

static pbs_code read_channels(input *in, pbs_err *err) {
    const char *name = pbs_reader_name(in->reader), *text = pbs_reader_channels(in->reader);
    if (pbs_reader_kind(in->reader) == PBS_VOXELS)
        return pbs_voxels_parse(name, text, &in->voxels, err);
    pbs_code rc = pbs_record_parse(name, text, &in->record, err);
    if (!rc && (in->record.packed || !(in->record.channels & PBS_SPACING)))
        rc = pbs_fail(err, PBS_DATA, "%s: surfels without spacing", name);
    return rc;
}

static pbs_code expect_stream(pbs_input *file, pbs_err *err) {
    bool stream;
    pbs_code rc = pbs_flatten_is_stream(file, &stream, err);
    return rc || stream ? rc
                        : pbs_fail(err, PBS_DATA,
                                   "%s: no pbs stream, as the first file is: make an archive of "
                                   "streams, and one of point clouds",
                                   file->name);
}

static pbs_code open_input(job *j, input *in, const char *path, pbs_err *err) {
    pbs_input file = j->first;
    pbs_run *run = &j->app->run;
    pbs_code rc = in == j->inputs ? PBS_OK : pbs_input_open(run, path, &file, err);
    if (rc) return rc;
    rc = expect_stream(&file, err);
    if (!rc) rc = pbs_input_map(&file, err);
    if (rc) {
        pbs_input_close(&file);
        return rc;
    }
    rc =
        pbs_reader_open(run, &file, PBS_KIND(PBS_SURFELS) | PBS_KIND(PBS_VOXELS), &in->reader, err);
    if (!rc) rc = read_channels(in, err);
    if (!rc) rc = pbs_reader_directory(in->reader, &in->entries, &in->entry_count, err);
    if (rc) return rc;
    j->out.channels |= in->record.channels;
    j->out_voxels |= in->voxels & ~(uint32_t)PBS_WEIGHT;
    return PBS_OK;
}

static pbs_code add_entry(job *j, const entry *e, pbs_err *err) {
    pbs_code rc = pbs_grow(&j->app->run, &j->entries, &j->entry_cap, j->entry_count + 1,
                           sizeof *j->entries, "the table of nodes", err);
    if (!rc) j->entries[j->entry_count++] = *e;
    return rc;
}

/* What came before its node. */
typedef struct counts {
    uint64_t points, octaves, voxels;
} counts;

/* Whether the node got what it says. */
static pbs_code check_counts(const input *in, const entry *e, const counts *n, pbs_err *err) {
    const char *name = pbs_reader_name(in->reader);
    pbs_record octave = pbs_octave_record(in->record.channels);
    uint64_t records = in->voxels ? n->voxels : n->points;
    if (records != e->node.records)
        return pbs_fail(err, PBS_DATA, "%s: node %u has %llu %s and not %llu", name, e->node.id,
                        (unsigned long long)records, in->voxels ? "voxels" : "points",
                        (unsigned long long)e->node.records);
    if (n->octaves && n->octaves != pbs_octave_entries(&octave, n->points))
        return pbs_fail(err, PBS_DATA, "%s: node %u has %llu entries of octaves", name, e->node.id,
                        (unsigned long long)n->octaves);
    return PBS_OK;
}

static pbs_voxel_source source_of(const job *j, const entry *e) {
    const input *in = &j->inputs[e->input];
    return (pbs_voxel_source){in->reader,     in->voxels,   in->entries,
                              e->first_chunk, e->end_chunk, in->first_material};
}

/* Nodes keep their order; their numbers move up by what the inputs before have. */
static pbs_code add_node(job *j, entry e, const pbs_chunk *at, const counts *n, pbs_err *err) {
    const input *in = &j->inputs[e.input];
    pbs_chunk c;
    uint32_t expect = (uint32_t)j->entry_count - in->first_node;
    pbs_code rc = pbs_reader_at(in->reader, at, &c, err);
    if (!rc)
        rc = pbs_node_read(&j->app->run, pbs_reader_name(in->reader), &c, expect, &e.node, err);
    if (rc) return rc;
    rc = check_counts(in, &e, n, err);
    pbs_voxel_source s = source_of(j, &e);
    if (!rc && n->voxels) rc = pbs_voxels_survey(&s, &e.voxels, err);
    j->voxels += n->voxels;
    j->voxel_nodes += n->voxels > 0;
    e.octaves = n->octaves;
    e.has_points = n->points != 0;
    e.node.id += in->first_node;
    for (uint32_t k = 0; k < e.node.child_count; k++) e.node.children[k].node += in->first_node;
    if (!rc) rc = add_entry(j, &e, err);
    if (rc) pbs_node_free(&j->app->run, &e.node);
    return rc;
}

/* A chunk of the node that comes next: of points, octaves or voxels, of which *have came before. */
static pbs_code count_chunk(const job *j, const input *in, const pbs_chunk *c, uint64_t *have,
                            const pbs_record *record, pbs_err *err) {
    const char *name = pbs_reader_name(in->reader);
    char tag[5];
    size_t next = j->entry_count - in->first_node;
    if (c->node != next || (record && !record->stride) || (!record && !in->voxels))
        return pbs_fail(err, PBS_DATA, "%s: %s of node %u where %zu is expected", name,
                        pbs_tag_text(c->tag, tag), c->node, next);
    pbs_code rc = record ? pbs_points_fit(name, record, c, *have, err) : PBS_OK;
    *have += c->count;
    return rc;
}

static pbs_code take_chunk(job *j, const input *in, const pbs_chunk *c, counts *n, pbs_err *err) {
    uint64_t ignored = 0;
    pbs_record octave = pbs_octave_record(in->record.channels);
    switch (c->tag) {
    case PBS_TAG_POINTS:
        return count_chunk(j, in, c, &n->points, &in->record, err);
    case PBS_TAG_OCTAVES:
        return count_chunk(j, in, c, &n->octaves, &octave, err);
    case PBS_TAG_VOXELS:
        return count_chunk(j, in, c, &n->voxels, NULL, err);
    case PBS_TAG_FACES: /* the survey counts them */
        return count_chunk(j, in, c, &ignored, NULL, err);
    case PBS_TAG_MATERIAL:
        j->materials++;
        j->others++;
        return PBS_OK;
    default:
        j->others++;
        return PBS_OK;
    }
}

static pbs_code take_input(job *j, size_t i, pbs_err *err) {
    input *in = &j->inputs[i];
    const char *name = pbs_reader_name(in->reader);
    in->first_node = (uint32_t)j->entry_count;
    in->first_material = j->materials;
    size_t first = 0;
    counts n = {0};
    for (size_t k = 0; k < in->entry_count; k++) {
        const pbs_chunk *c = &in->entries[k];
        pbs_code rc;
        if (c->tag == PBS_TAG_NODE) {
            entry e = {.input = i, .first_chunk = first, .end_chunk = k};
            rc = add_node(j, e, c, &n, err);
            first = k + 1;
            n = (counts){0};
        } else
            rc = take_chunk(j, in, c, &n, err);
        if (rc) return rc;
    }
    if (n.points || n.octaves || n.voxels)
        return pbs_fail(err, PBS_DATA, "%s: records without a node", name);
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
        chunks += pbs_voxels_pack_chunks(&j->entries[i].voxels);
    for (size_t i = 0; i < j->entry_count; i++)
        if (j->entries[i].has_points)
            chunks += pbs_points_chunks(j->entries[i].node.records, PBS_ARCHIVE_CHUNK) +
                      pbs_points_chunks(j->entries[i].octaves, PBS_ARCHIVE_CHUNK);
    char channels[512], *history = history_of(j);
    if (!history) return pbs_fail(err, PBS_LIMIT, "no memory");
    pbs_archive_text(&j->out, j->out_voxels, channels);
    pbs_code rc = pbs_writer_open(&j->app->run,
                                  &(pbs_writer_desc){.path = j->app->common.output,
                                                     .kind = PBS_ARCHIVE,
                                                     .channels = channels,
                                                     .history = history,
                                                     .stage = j->app->stage,
                                                     .front = chunks,
                                                     .codec = j->codec},
                                  &j->w, err);
    free(history);
    return rc;
}

/* Chunks go as they are, but for their numbers: materials, or what this program does not know. */
static pbs_code write_others(job *j, const input *in, bool materials, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < in->entry_count && !rc; i++) {
        pbs_chunk c;
        uint32_t tag = in->entries[i].tag;
        if (tag == PBS_TAG_NODE || tag == PBS_TAG_POINTS || tag == PBS_TAG_OCTAVES ||
            tag == PBS_TAG_VOXELS || tag == PBS_TAG_FACES || materials != (tag == PBS_TAG_MATERIAL))
            continue;
        rc = pbs_reader_at(in->reader, &in->entries[i], &c, err);
        pbs_piece piece = {c.payload, (size_t)c.bytes};
        if (c.node != PBS_NONE) c.node += materials ? in->first_material : in->first_node;
        if (!rc) rc = pbs_writer_chunk(j->w, &c, &piece, 1, err);
    }
    return rc;
}

static int by_number(const void *a, const void *b) {
    uint64_t x, y;
    memcpy(&x, a, sizeof x);
    memcpy(&y, b, sizeof y);
    return (x > y) - (x < y);
}

/* Level by level from the one chunk that holds everything, and there in the order of the nodes,
 * which is Morton's: so every beginning of the archive is a coarse model. */
static pbs_code order_voxels(job *j, pbs_err *err) {
    pbs_code rc = pbs_alloc(&j->app->run, &j->voxel_order, j->voxel_nodes, sizeof *j->voxel_order,
                            "the order of the nodes", err);
    size_t n = 0;
    for (size_t i = 0; i < j->entry_count && !rc; i++) {
        const pbs_voxel_survey *v = &j->entries[i].voxels;
        if (!v->voxels) continue;
        uint32_t below = v->place.levels > v->place.level ? v->place.levels - v->place.level : 0;
        j->voxel_order[n++] = (uint64_t)below << 32 | i;
    }
    if (!rc) qsort(j->voxel_order, n, sizeof *j->voxel_order, by_number);
    return rc;
}

static pbs_code write_voxels(job *j, pbs_err *err) {
    pbs_run *run = &j->app->run;
    pbs_code rc = order_voxels(j, err);
    for (size_t i = 0; i < j->voxel_nodes && !rc; i++) {
        const entry *e = &j->entries[j->voxel_order[i] & UINT32_MAX];
        pbs_voxel_source s = source_of(j, e);
        pbs_run_progress(run, "writing", i, j->voxel_nodes);
        rc = pbs_run_check(run, err);
        if (!rc) rc = pbs_voxels_pack(run, &s, &e->voxels, j->w, e->node.id, j->out_voxels, err);
    }
    return rc;
}

/* Nodes and materials first, then points from the root down, then voxels: coarse first. */
static pbs_code write_archive(job *j, pbs_err *err) {
    pbs_code rc = open_writer(j, err);
    for (size_t i = 0; i < j->entry_count && !rc; i++)
        rc = pbs_node_write(&j->app->run, j->w, &j->entries[i].node, err);
    for (size_t i = 0; i < j->input_count && !rc; i++)
        rc = write_others(j, &j->inputs[i], true, err);
    for (size_t i = j->entry_count; i-- && !rc;) {
        pbs_run_progress(&j->app->run, "writing", j->entry_count - i, j->entry_count);
        rc = write_points(j, &j->entries[i], err);
    }
    if (!rc) rc = write_voxels(j, err);
    for (size_t i = 0; i < j->input_count && !rc; i++)
        rc = write_others(j, &j->inputs[i], false, err);
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
    pbs_codec codec = (pbs_codec)((options *)opt)->codec;
    job j = {.app = app, .codec = codec, .input_count = (size_t)app->common.operand_count};
    bool done;
    pbs_code rc = pbs_flatten_clouds(app, codec, &j.first, &done, err);
    if (rc || done) return rc;
    if (!j.input_count) j.input_count = 1;
    if (!(j.inputs = calloc(j.input_count, sizeof *j.inputs))) {
        pbs_input_close(&j.first);
        return pbs_fail(err, PBS_LIMIT, "no memory");
    }
    rc = flatten(&j, err);
    if (!rc) {
        char channels[512];
        pbs_stat_count(app, "nodes", j.entry_count);
        pbs_stat_count(app, "surfels", j.surfels);
        pbs_stat_count(app, "voxels", j.voxels);
        pbs_archive_text(&j.out, j.out_voxels, channels);
        pbs_stat_record(app, channels, j.out.stride);
        pbs_stat_count(app, "voxel_bytes", pbs_voxels_stride(j.out_voxels));
        pbs_stat_count(app, "bytes", pbs_writer_bytes(j.w));
        pbs_stat_real(app, "position_error", j.error);
        pbs_stat_real(app, "position_error_bound", j.bound);
    }
    pbs_writer_close(j.w);
    for (size_t i = 0; i < j.entry_count; i++) pbs_node_free(&app->run, &j.entries[i].node);
    pbs_free(&app->run, j.entries);
    pbs_free(&app->run, j.voxel_order);
    for (size_t i = 0; i < j.input_count; i++) pbs_reader_close(j.inputs[i].reader);
    free(j.inputs);
    return rc;
}

int main(int argc, char **argv) {
    options o = {0};
    return pbs_tool_main(argc, argv, &tool, &o, work);
}
