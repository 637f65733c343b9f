/* pbs-voxelize: a scene's surface as voxels (paper 2, section 3). */
#include "cmd/notes.h"
#include "cmd/tool.h"
#include "formats/voxels/blocks.h"
#include "formats/voxels/voxelstream.h"
#include "libcore/measures/fidelity.h"
#include "libcore/ground/pipe.h"
#include <float.h>
#include <string.h>

typedef struct options {
    uint64_t resolution;
    double max_error;
    const char *box;
    int orientation, per_face;
    bool conservative, separating, bare, interior, ignore_missing, keep_going, measure;
} options;

static const char *const orientation_names[] = {"auto", "trust", "unknown", NULL};
static const char *const per_face_names[] = {"none", "material", "colour", NULL};

static const pbs_option table[] = {
    {'r', "resolution", PBS_COUNT, offsetof(options, resolution), "N",
     "voxels along each axis of the cube (default 1024)", 1, PBS_GRID_MAX, NULL, true},
    {'e', "max-error", PBS_REAL, offsetof(options, max_error), "E",
     "instead: as many as bring the error down to E, in the scene's unit", 1e-300, 1e300, NULL,
     true},
    {'b', "box", PBS_TEXT, offsetof(options, box), "X,Y,Z,SIDE",
     "lower corner and side of the cube (default: around the scene)", 0, 0, NULL, true},
    {0, "conservative", PBS_FLAG, offsetof(options, conservative), NULL,
     "keep every voxel that a triangle touches", 0, 0, NULL, true},
    {0, "separating", PBS_FLAG, offsetof(options, separating), NULL,
     "keep the six-separating set alone, without parts thinner than a voxel", 0, 0, NULL, true},
    {0, "bare", PBS_FLAG, offsetof(options, bare), NULL,
     "positions and faces of the six-separating set, no attributes", 0, 0, NULL, true},
    {0, "interior", PBS_FLAG, offsetof(options, interior), NULL,
     "faces that look inwards, too: the viewer may be inside", 0, 0, NULL, true},
    {0, "orientation", PBS_CHOICE, offsetof(options, orientation), "WHICH",
     "which side of a triangle is outside", 0, 0, orientation_names, true},
    {0, "per-face", PBS_CHOICE, offsetof(options, per_face), "WHAT",
     "an attribute for each face of a voxel", 0, 0, per_face_names, true},
    {0, "ignore-missing", PBS_FLAG, offsetof(options, ignore_missing), NULL,
     "go on without textures that are not there", 0, 0, NULL, true},
    {0, "keep-going", PBS_FLAG, offsetof(options, keep_going), NULL,
     "leave out what fails, and end with status 65", 0, 0, NULL, true},
    {0, "measure", PBS_FLAG, offsetof(options, measure), NULL,
     "measure how far the voxels are from the surface", 0, 0, NULL, false},
};

static const pbs_tool tool = {"pbs-voxelize", "Turns a scene's surface into voxels", "[FILE]", 0, 1,
                              table,          sizeof table / sizeof table[0],        false};

typedef struct item {
    uint32_t at[3];
    pbs_nearby *near;
    pbs_voxels voxels;
    size_t cap;
    uint32_t *faces;
    size_t face_count, face_cap;
    pbs_block_stats stats;
    pbs_fidelity fidelity;
} item;

typedef struct job {
    pbs_app *app;
    const options *o;
    pbs_failures failures;
    pbs_scene scene;
    uint64_t triangles, singular;
    size_t base; /* memory besides the blocks */
    pbs_grid grid;
    pbs_image *images;
    pbs_surfaces *surfaces;
    pbs_block_params params;
    pbs_blocks *blocks;
    pbs_block **block;            /* one a thread */
    pbs_fidelity_block **measure; /* likewise, or NULL */
    item *items;
    int threads, item_count;
    pbs_writer *w;
    uint32_t channels;
    pbs_voxelstream stream;
    pbs_block_stats total;
    pbs_fidelity fidelity;
    uint64_t block_count;
} job;

/* ---- source | work | sink ---- */

static pbs_code next_block(void *ctx, void *slot, bool *end, pbs_err *err) {
    job *j = ctx;
    item *i = slot;
    return pbs_blocks_next(j->blocks, i->at, &i->near, end, err);
}

/* What a block gives is its own until it begins anew, so it is copied. */
static pbs_code keep(job *j, item *i, const pbs_voxels *v, const uint32_t *faces, size_t n,
                     pbs_err *err) {
    pbs_run *run = &j->app->run;
    pbs_code rc = pbs_voxels_grow(run, j->channels, &i->voxels, &i->cap, v->count, err);
    if (!rc)
        rc = pbs_grow(run, &i->faces, &i->face_cap, n, sizeof *i->faces, "the attributes of faces",
                      err);
    if (rc) return rc;
    i->voxels.count = 0;
    pbs_voxels_append(&i->voxels, v, 0, v->count);
    if (n) memcpy(i->faces, faces, n * sizeof *faces);
    i->face_count = n;
    return PBS_OK;
}

static pbs_code measure_block(void *ctx, const pbs_mesh *mesh, const uint32_t *triangles,
                              size_t count, const pbs_to_grid *to, pbs_sides sides, pbs_err *err) {
    return pbs_fidelity_add(ctx, mesh, triangles, count, to, sides, err);
}

static pbs_code measure(job *j, item *i, int thread, const pbs_voxels *v, pbs_err *err) {
    pbs_fidelity_block *f = j->measure[thread];
    pbs_code rc = pbs_fidelity_begin(f, i->at, v, err);
    if (!rc) rc = pbs_nearby_visit(i->near, measure_block, f, err);
    if (!rc) pbs_fidelity_end(f, &i->fidelity);
    return rc;
}

static pbs_code fill_block(void *ctx, void *slot, int thread, pbs_err *err) {
    job *j = ctx;
    item *i = slot;
    pbs_block *b = j->block[thread];
    pbs_voxels v;
    const uint32_t *faces;
    size_t n;
    pbs_block_begin(b, i->at, j->grid.size);
    pbs_code rc = pbs_nearby_add(i->near, b, err);
    if (!rc) rc = pbs_block_end(b, &v, &faces, &n, &i->stats, err);
    if (!rc && j->measure) rc = measure(j, i, thread, &v, err);
    pbs_nearby_free(i->near);
    i->near = NULL;
    return rc ? rc : keep(j, i, &v, faces, n, err);
}

static void add_up(pbs_block_stats *sum, const pbs_block_stats *s) {
    sum->triangles += s->triangles;
    sum->fragments += s->fragments;
    sum->touched += s->touched;
    sum->orphans += s->orphans;
    sum->lost += s->lost;
    sum->area += s->area;
    sum->kept += s->kept;
}

/* Blocks come in Morton order, so their numbers say how far we are. */
static uint64_t morton(const uint32_t at[3]) {
    uint64_t code = 0;
    for (int b = 0; b < 16; b++)
        for (int k = 0; k < 3; k++) code |= (uint64_t)(at[k] / PBS_BLOCK >> b & 1) << (3 * b + k);
    return code;
}

static pbs_code take_block(void *ctx, void *slot, pbs_err *err) {
    job *j = ctx;
    item *i = slot;
    uint64_t side = UINT64_C(1) << pbs_voxel_levels(j->grid.size);
    add_up(&j->total, &i->stats);
    pbs_fidelity_sum(&j->fidelity, &i->fidelity);
    j->block_count += i->voxels.count > 0;
    pbs_run_progress(&j->app->run, "voxelizing", morton(i->at), side * side * side * 64);
    return pbs_voxelstream_add(&j->stream, i->at, &i->voxels, i->faces, i->face_count, err);
}

static pbs_code run_blocks(job *j, pbs_err *err) {
    pbs_pipe pipe = {j,        next_block,         fill_block,   take_block,
                     j->items, sizeof j->items[0], j->item_count};
    return pbs_pipe_run(&j->app->run, &pipe, err);
}

/* ---- the grid ---- */

static pbs_code bad_box(const job *j, pbs_err *err) {
    return pbs_fail(err, PBS_USAGE,
                    "--box %s: expected the lower corner and the side of a cube, X,Y,Z,SIDE",
                    j->o->box);
}

static pbs_code parse_box(job *j, pbs_err *err) {
    double v[4];
    char number[64];
    const char *p = j->o->box;
    for (int k = 0; k < 4; k++) {
        size_t n = strcspn(p, ",");
        if (n >= sizeof number || (k < 3) != (p[n] == ',')) return bad_box(j, err);
        memcpy(number, p, n);
        number[n] = 0;
        if (pbs_cli_number(number, PBS_REAL, &v[k], NULL)) return bad_box(j, err);
        p += n + (k < 3);
    }
    j->grid.voxel = v[3] / j->grid.size;
    if (!(v[3] > 0)) return bad_box(j, err);
    if (j->grid.voxel < DBL_MIN)
        return pbs_fail(err, PBS_USAGE,
                        "--box %s: voxels of side %g are too small: the side of the cube must be "
                        "at least %g",
                        j->o->box, j->grid.voxel, DBL_MIN * 1.0001 * j->grid.size);
    memcpy(j->grid.min, v, sizeof j->grid.min);
    return PBS_OK;
}

static pbs_code set_grid(job *j, const pbs_box *box, uint32_t size, pbs_err *err) {
    j->grid = pbs_grid_around(box, size);
    return j->o->box ? parse_box(j, err) : PBS_OK;
}

/* The middle of a voxel is at most half its diagonal from a point of the surface in it. */
static double error_of(const job *j) {
    return sqrt(3) / 2 * j->grid.voxel;
}

/* The fewest voxels whose error is small enough. */
static pbs_code refine_grid(job *j, const pbs_box *box, pbs_err *err) {
    const double most = j->o->max_error;
    pbs_code rc = set_grid(j, box, PBS_GRID_MAX, err);
    if (rc) return rc;
    if (error_of(j) > most)
        return pbs_fail(err, PBS_LIMIT,
                        "--max-error %g: %d voxels along each axis, the most there "
                        "can be, have an error of up to %g",
                        most, PBS_GRID_MAX, error_of(j));
    uint32_t low = 1, high = PBS_GRID_MAX;
    while (low < high && !rc) {
        uint32_t middle = low + (high - low) / 2;
        rc = set_grid(j, box, middle, err);
        if (error_of(j) > most)
            low = middle + 1;
        else
            high = middle;
    }
    return rc ? rc : set_grid(j, box, low, err);
}

static pbs_code choose_grid(job *j, pbs_err *err) {
    pbs_box box;
    const options *o = j->o;
    if (o->resolution && o->max_error > 0)
        return pbs_fail(err, PBS_USAGE, "only one of --resolution and --max-error can be given");
    pbs_code rc = pbs_scene_box(&j->scene, &box, &j->triangles, &j->singular, err);
    if (rc) return rc;
    rc = o->max_error > 0 ? refine_grid(j, &box, err)
                          : set_grid(j, &box, o->resolution ? (uint32_t)o->resolution : 1024, err);
    if (rc || o->box) return rc;
    if (!(j->grid.voxel < INFINITY) || !(j->grid.voxel >= DBL_MIN))
        return pbs_fail(err, PBS_DATA, "%s: the scene is too large or too small for a grid",
                        pbs_reader_name(j->scene.reader));
    return PBS_OK;
}

/* ---- the parts of the job ---- */

/* Rather fewer threads than no voxels: a full block takes some memory, and each thread has one.
 * What it must be at least is said early, and again when it is known what the scene has. */
static void fit_memory(job *j) {
    const size_t reading = 20 << 20;
    pbs_run *run = &j->app->run;
    size_t block = pbs_block_memory(&j->params), limit = pbs_mem_used(run) + pbs_mem_left(run);
    if (!j->base) j->base = pbs_mem_used(run) + reading;
    run->mem_floor = j->base + block;
    while (run->threads > 1 && j->base + (size_t)run->threads * block > limit) run->threads--;
}

static pbs_code set_up_params(job *j, pbs_err *err) {
    const options *o = j->o;
    const uint32_t looks = PBS_COLOUR | PBS_MATERIAL | PBS_EMISSIVE;
    pbs_block_params *p = &j->params;
    if (o->conservative + o->separating + o->bare > 1)
        return pbs_fail(err, PBS_USAGE,
                        "only one of --conservative, --separating and --bare can be given");
    if (o->bare && o->per_face)
        return pbs_fail(err, PBS_USAGE, "--per-face: there are no attributes with --bare");
    p->channels = o->bare ? 0 : PBS_NORMAL | PBS_WEIGHT | (j->scene.channels & looks);
    p->cells = o->conservative            ? PBS_CELLS_CONSERVATIVE
               : o->separating || o->bare ? PBS_CELLS_SEPARATING
                                          : PBS_CELLS_THIN;
    p->interior = o->interior;
    fit_memory(j);
    j->channels = PBS_POSITION | p->channels | (o->per_face ? PBS_FACE : 0);
    uint32_t shown = p->channels | (o->per_face == PBS_PER_FACE_COLOUR ? PBS_COLOUR : 0);
    pbs_code rc = o->bare ? PBS_OK : pbs_scene_images(&j->scene, &j->images, err);
    if (!rc)
        rc = pbs_surfaces_new(&j->app->run, j->scene.materials, j->scene.material_count, j->images,
                              j->images ? j->scene.texture_count : 0, shown & looks, &j->surfaces,
                              err);
    p->surfaces = j->surfaces;
    return rc;
}

/* An array of one for each thread, NULL so far. */
static pbs_code one_each(job *j, void *out, pbs_err *err) {
    pbs_code rc =
        pbs_alloc(&j->app->run, out, (size_t)j->threads, sizeof(void *), "the blocks", err);
    void *array;
    memcpy(&array, out, sizeof array);
    if (!rc) memset(array, 0, (size_t)j->threads * sizeof(void *));
    return rc;
}

static pbs_code set_up_blocks(job *j, pbs_err *err) {
    pbs_run *run = &j->app->run;
    size_t lists = pbs_mem_left(run) / 8;
    if (lists > 16 << 20) lists = 16 << 20;
    if (lists < 1 << 20) lists = 1 << 20;
    j->threads = run->threads;
    j->item_count = 2 * run->threads;
    pbs_code rc =
        pbs_blocks_new(&j->scene, &j->grid, (pbs_orient)j->o->orientation, lists, &j->blocks, err);
    if (!rc) rc = one_each(j, &j->block, err);
    for (int i = 0; i < j->threads && !rc; i++)
        rc = pbs_block_new(run, &j->params, &j->block[i], err);
    if (!rc)
        rc = pbs_alloc(run, &j->items, (size_t)j->item_count, sizeof *j->items, "the blocks", err);
    if (!rc) memset(j->items, 0, (size_t)j->item_count * sizeof *j->items);
    return rc;
}

static pbs_code set_up_measure(job *j, pbs_err *err) {
    if (!j->o->measure) return PBS_OK;
    pbs_code rc = one_each(j, &j->measure, err);
    for (int i = 0; i < j->threads && !rc; i++)
        rc = pbs_fidelity_new(&j->app->run, &j->measure[i], err);
    return rc;
}

static pbs_code open_writer(job *j, pbs_err *err) {
    char channels[256];
    pbs_voxels_text(j->channels, channels);
    pbs_code rc = pbs_writer_open(&j->app->run,
                                  &(pbs_writer_desc){.path = j->app->common.output,
                                                     .kind = PBS_VOXELS,
                                                     .channels = channels,
                                                     .history = pbs_scene_history(&j->scene),
                                                     .stage = j->app->stage},
                                  &j->w, err);
    if (!rc)
        pbs_voxelstream_begin(&j->stream, &j->app->run, j->w, &j->grid, j->channels,
                              j->o->per_face == PBS_PER_FACE_COLOUR);
    return rc;
}

/* Ids of materials say nothing without their list. */
static pbs_code copy_materials(job *j, pbs_err *err) {
    return j->o->per_face == PBS_PER_FACE_MATERIAL ? pbs_scene_copy_materials(&j->scene, j->w, err)
                                                   : PBS_OK;
}

static pbs_code end_stream(job *j, pbs_err *err) {
    char title[512];
    pbs_scene_title(&j->scene, title, sizeof title);
    pbs_code rc = pbs_voxelstream_end(&j->stream, title, j->triangles, err);
    if (!rc && !j->stream.voxels)
        rc = pbs_fail(err, PBS_DATA, "%s: no voxel is touched: nothing of the scene is in the cube",
                      pbs_reader_name(j->scene.reader));
    return rc ? rc : pbs_writer_commit(j->w, err);
}

static void add_measures(job *j) {
    const pbs_fidelity *f = &j->fidelity;
    pbs_stat_real(j->app, "distance_mean", f->distance_sum / (double)f->voxels * j->grid.voxel);
    pbs_stat_real(j->app, "distance_max", f->distance_max * j->grid.voxel);
    if (!(f->area > 0)) return;
    pbs_stat_real(j->app, "normal_mean", f->normal_sum / f->area);
    pbs_stat_real(j->app, "normal_max", f->normal_max);
}

static void add_stats(job *j) {
    pbs_app *app = j->app;
    char channels[256];
    const char *name = pbs_reader_name(j->scene.reader);
    pbs_blocks_stats parts = pbs_blocks_totals(j->blocks);
    pbs_stat_count(app, "triangles", j->triangles);
    pbs_stat_count(app, "triangles_visited", j->total.triangles);
    if (j->total.lost) pbs_stat_count(app, "triangles_lost", j->total.lost);
    pbs_stat_count(app, "blocks", j->block_count);
    pbs_stat_count(app, "chunks", j->stream.child_count);
    pbs_stat_count(app, "voxels", j->stream.voxels);
    if (!j->o->bare) {
        pbs_stat_count(app, "fragments", j->total.fragments);
        pbs_stat_count(app, "touched", j->total.touched);
        pbs_stat_count(app, "orphans", j->total.orphans);
        pbs_stat_real(app, "area", j->total.area * j->grid.voxel * j->grid.voxel);
        pbs_stat_real(app, "area_kept", j->total.kept * j->grid.voxel * j->grid.voxel);
    }
    if (j->measure) add_measures(j);
    pbs_stat_count(app, "resolution", j->grid.size);
    pbs_stat_real(app, "error_bound", error_of(j));
    pbs_stat_real(app, "voxel", j->grid.voxel);
    pbs_stat_count(app, "parts_oriented", parts.parts_known);
    pbs_stat_count(app, "parts_turned", parts.parts_turned);
    pbs_stat_count(app, "parts_unoriented", parts.parts_unknown);
    pbs_voxels_text(j->channels, channels);
    pbs_stat_record(app, channels, pbs_voxels_stride(j->channels));
    pbs_stat_count(app, "bytes", pbs_writer_bytes(j->w));
    pbs_note_skips(app, name, j->scene.skipped);
    if (j->total.lost)
        pbs_note(app, "%s: triangles with corners farther than 2^1000 voxels are left out", name);
    if (j->scene.motions.count) pbs_note(app, "%s: what an animation moves is shown at rest", name);
    if (j->singular)
        pbs_note(app, "%s: %llu placings have a transform that cannot be inverted", name,
                 (unsigned long long)j->singular);
}

static void clean_up(job *j) {
    pbs_run *run = &j->app->run;
    for (int i = 0; j->items && i < j->item_count; i++) {
        pbs_nearby_free(j->items[i].near);
        pbs_voxels_free(run, &j->items[i].voxels);
        pbs_free(run, j->items[i].faces);
    }
    for (int i = 0; j->block && i < j->threads; i++) pbs_block_free(j->block[i]);
    pbs_free(run, j->items);
    pbs_free(run, j->block);
    for (int i = 0; j->measure && i < j->threads; i++) pbs_fidelity_free(j->measure[i]);
    pbs_free(run, j->measure);
    pbs_voxelstream_free(&j->stream);
    pbs_writer_close(j->w);
    pbs_blocks_free(j->blocks);
    pbs_surfaces_free(run, j->surfaces);
    pbs_images_free(run, j->images, j->scene.texture_count);
    pbs_scene_close(&j->scene);
}

static pbs_code work(pbs_app *app, void *opt, pbs_err *err) {
    job j = {.app = app, .o = opt, .failures = {app, 0}};
    j.params.per_face = (pbs_per_face)j.o->per_face;
    fit_memory(&j);
    pbs_scene_options so = PBS_SCENE_DEFAULTS;
    so.ignore_missing = j.o->ignore_missing;
    so.failed = j.o->keep_going ? pbs_note_failure : NULL;
    so.failed_ctx = &j.failures;
    pbs_code rc = pbs_scene_open(&app->run, pbs_operand(app, 0), &so, &j.scene, err);
    if (rc) return rc;
    rc = choose_grid(&j, err);
    if (!rc) rc = set_up_params(&j, err);
    if (!rc) rc = set_up_blocks(&j, err);
    if (!rc) rc = set_up_measure(&j, err);
    if (!rc) rc = open_writer(&j, err);
    if (!rc) rc = copy_materials(&j, err);
    if (!rc) rc = run_blocks(&j, err);
    if (!rc) rc = end_stream(&j, err);
    if (!rc) add_stats(&j);
    if (!rc) rc = pbs_failures_end(&j.failures, err);
    clean_up(&j);
    return rc;
}

int main(int argc, char **argv) {
    options o = {0};
    return pbs_tool_main(argc, argv, &tool, &o, work);
}
