/* pbs-flatten: surfels, voxels, point clouds and scenes into one archive in the player's order. */
#include "cmd/notes.h"
#include "cmd/tool.h"
#include "formats/archive/archive.h"
#include "formats/scene/meshbits.h"
#include "formats/archive/pack.h"

typedef struct options {
    int codec; /* pbs_codec */
    uint64_t mesh_bits;
} options;

static const pbs_option table[] = {
    {0, "codec", PBS_CHOICE, offsetof(options, codec), "WHICH", "how the data is packed", 0, 0,
     pbs_codec_name, true},
    {0, "mesh-bits", PBS_COUNT, offsetof(options, mesh_bits), "N",
     "meshes on a lattice of 2^N steps; 0: exact (default 0; with draco 16)", 0, PBS_MESH_BITS_MOST,
     NULL, true},
};
enum { MESH_BITS = 1 };   /* its place in the table */
enum { DRACO_BITS = 16 }; /* if they are not given */

static const pbs_tool tool = {"pbs-flatten",
                              "Packs surfels, voxels, point clouds and scenes into one archive",
                              "[FILE...]",
                              0,
                              -1,
                              table,
                              sizeof table / sizeof table[0],
                              false};

static void report_cloud(pbs_app *app, const pbs_cloudpack_stats *s) {
    if (s->left_out)
        pbs_note(app, "%llu points are not finite and were left out",
                 (unsigned long long)s->left_out);
    pbs_stat_count(app, "points", s->points);
    pbs_stat_count(app, "points_left_out", s->left_out);
    pbs_stat_count(app, "points_equal", s->equal);
    pbs_stat_count(app, "levels", (uint64_t)s->levels);
    pbs_stat_real(app, "root_spacing", s->root_spacing);
    pbs_stat_real(app, "lattice", s->step);
}

static void report_scenes(pbs_app *app, const pbs_pack_stats *s) {
    pbs_stat_count(app, "scenes_matched", s->matched);
    pbs_stat_count(app, "meshes", s->meshes);
    pbs_stat_count(app, "triangles", s->triangles);
    pbs_stat_count(app, "triangles_homeless", s->homeless);
    pbs_stat_count(app, "triangles_flat", s->flat);
    pbs_stat_real(app, "mesh_error_bound", s->mesh_bound);
    if (s->matched < s->scenes && (s->surfels || s->voxels))
        pbs_note(app,
                 "%llu of %llu scenes are not what the surfels or voxels were made from, and "
                 "stand for themselves",
                 (unsigned long long)(s->scenes - s->matched), (unsigned long long)s->scenes);
    if (s->homeless)
        pbs_note(app, "%llu triangles are near no voxel, and are not in the archive",
                 (unsigned long long)s->homeless);
    pbs_note_skips(app, s->scene, s->skipped);
}

static void report(pbs_app *app, const pbs_pack_stats *s) {
    char channels[512];
    pbs_stat_count(app, "nodes", s->nodes);
    pbs_stat_count(app, "nodes_equal", s->same);
    pbs_stat_count(app, "surfels", s->surfels);
    pbs_stat_count(app, "voxels", s->voxels);
    pbs_archive_text(&s->record, s->voxel_channels, channels);
    pbs_stat_record(app, channels, s->record.stride);
    pbs_stat_count(app, "voxel_bytes", pbs_voxels_stride(s->voxel_channels));
    pbs_stat_count(app, "bytes", s->bytes);
    pbs_stat_real(app, "position_error", s->error);
    pbs_stat_real(app, "position_error_bound",
                  s->has_cloud && s->cloud.bound > s->bound ? s->cloud.bound : s->bound);
    if (s->scene) report_scenes(app, s);
    if (s->has_cloud) report_cloud(app, &s->cloud);
}

static pbs_code work(pbs_app *app, void *opt, pbs_err *err) {
    const options *o = opt;
    int n = app->common.operand_count ? app->common.operand_count : 1;
    bool draco = o->codec == PBS_CODEC_DRACO, given = app->common.given >> MESH_BITS & 1;
    if (draco && given && !o->mesh_bits)
        return pbs_fail(err, PBS_USAGE,
                        "--codec draco packs whole numbers: --mesh-bits 0 has none");
    pbs_pack *pack;
    pbs_pack_stats stats;
    pbs_writer_desc to = {
        .path = app->common.output, .stage = app->stage, .codec = (pbs_codec)o->codec};
    pbs_code rc = pbs_pack_new(&app->run, &pack, err);
    if (!rc) pbs_pack_mesh_bits(pack, draco && !given ? DRACO_BITS : (unsigned)o->mesh_bits);
    for (int i = 0; i < n && !rc; i++) rc = pbs_pack_add(pack, pbs_operand(app, i), err);
    if (!rc) rc = pbs_pack_write(pack, &to, &stats, err);
    if (!rc) report(app, &stats);
    pbs_pack_free(pack);
    return rc;
}

int main(int argc, char **argv) {
    options o = {PBS_CODEC_NONE, 0};
    return pbs_tool_main(argc, argv, &tool, &o, work);
}
