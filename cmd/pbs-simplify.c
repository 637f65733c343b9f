/* pbs-simplify: voxels of the finest level to all levels (paper 2, section 3). */
#include "cmd/tool.h"
#include "formats/voxels/simplify.h"

typedef struct options {
    uint64_t least, levels;
} options;

static const pbs_option table[] = {
    {0, "least", PBS_COUNT, offsetof(options, least), "N",
     "no further level above one of at most N voxels (default 4096)", 1, 4e9, NULL, true},
    {0, "levels", PBS_COUNT, offsetof(options, levels), "N",
     "levels above the finest, at most (default: all)", 0, 31, NULL, true},
};

static const pbs_tool tool = {"pbs-simplify", "Makes all coarser levels of voxels", "[FILE]", 0, 1,
                              table,          sizeof table / sizeof table[0],       false};

/* More would not make it faster. */
#define ENOUGH ((size_t)160 << 20)

static void add_stats(pbs_app *app, pbs_reader *r, pbs_writer *w, const pbs_simplified *s,
                      uint32_t stride) {
    pbs_stat_count(app, "voxels", s->voxels);
    pbs_stat_count(app, "voxels_coarser", s->coarser);
    pbs_stat_count(app, "voxels_coarsest", s->coarsest);
    pbs_stat_count(app, "levels", s->levels);
    pbs_stat_count(app, "nodes", s->nodes);
    pbs_stat_count(app, "nodes_sorted", s->nodes_sorted);
    pbs_stat_record(app, pbs_reader_channels(r), stride);
    pbs_stat_count(app, "bytes", pbs_writer_bytes(w));
    if (s->ordered) pbs_note(app, "chunks were not in Morton order: read through the directory");
}

static pbs_code work(pbs_app *app, void *opt, pbs_err *err) {
    const options *o = opt;
    pbs_run *run = &app->run;
    if (!run->mem_limit || run->mem_limit > ENOUGH) run->mem_limit = ENOUGH;
    pbs_reader *r;
    pbs_writer *w = NULL;
    pbs_simplified s;
    pbs_levels_params params = {o->least, (uint32_t)o->levels};
    uint32_t channels;
    pbs_input in;
    pbs_code rc = pbs_input_open_both(run, pbs_operand(app, 0), &in, err);
    if (!rc) rc = pbs_reader_open(run, &in, PBS_KIND(PBS_VOXELS), &r, err);
    if (rc) return rc;
    rc = pbs_voxels_parse(pbs_reader_name(r), pbs_reader_channels(r), &channels, err);
    if (!rc)
        rc = pbs_writer_open(run,
                             &(pbs_writer_desc){.path = app->common.output,
                                                .kind = PBS_VOXELS,
                                                .channels = pbs_reader_channels(r),
                                                .history = pbs_reader_history(r),
                                                .stage = app->stage},
                             &w, err);
    if (!rc) rc = pbs_simplify(run, r, w, &params, &s, err);
    if (!rc) rc = pbs_writer_commit(w, err);
    if (!rc) add_stats(app, r, w, &s, pbs_voxels_stride(channels));
    pbs_writer_close(w);
    pbs_reader_close(r);
    return rc;
}

int main(int argc, char **argv) {
    options defaults = {.least = 4096, .levels = 31};
    return pbs_tool_main(argc, argv, &tool, &defaults, work);
}
