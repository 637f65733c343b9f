/* flatten_cloud.c: point clouds into an archive, for pbs-flatten. */
#include "cmd/flatten_cloud.h"
#include "formats/cloudpack.h"
#include <stdlib.h>
#include <string.h>

pbs_code pbs_flatten_is_stream(pbs_input *in, bool *is, pbs_err *err) {
    const uint8_t *b;
    size_t n;
    pbs_code rc = pbs_input_peek(in, &b, &n, err);
    /* An empty file is nobody's; the streams' reader says what is wrong with it. */
    *is = !rc && (!n || pbs_is_container(b, n));
    return rc;
}

static pbs_code open_next(pbs_app *app, int i, pbs_cloud *c, pbs_err *err) {
    pbs_input in;
    bool stream;
    pbs_code rc = pbs_input_open(&app->run, pbs_operand(app, i), &in, err);
    if (rc) return rc;
    rc = pbs_flatten_is_stream(&in, &stream, err);
    if (!rc && stream)
        rc = pbs_fail(err, PBS_DATA,
                      "%s: a pbs stream beside point clouds: make an archive of each", in.name);
    if (!rc) return pbs_cloud_open_input(&app->run, &in, pbs_operand(app, i), c, err);
    pbs_input_close(&in);
    return rc;
}

static void report(pbs_app *app, const pbs_cloudpack_stats *s) {
    char channels[256];
    if (s->left_out)
        pbs_note(app, "%llu points are not finite and were left out",
                 (unsigned long long)s->left_out);
    pbs_record_text(&s->record, channels);
    pbs_stat_count(app, "nodes", s->nodes);
    pbs_stat_count(app, "points", s->points);
    pbs_stat_count(app, "points_left_out", s->left_out);
    pbs_stat_count(app, "points_equal", s->equal);
    pbs_stat_count(app, "levels", (uint64_t)s->levels);
    pbs_stat_real(app, "root_spacing", s->root_spacing);
    pbs_stat_record(app, channels, s->record.stride);
    pbs_stat_count(app, "bytes", s->bytes);
    pbs_stat_real(app, "lattice", s->step);
    pbs_stat_real(app, "position_error_bound", s->bound);
}

static pbs_code flatten(pbs_app *app, pbs_codec codec, pbs_cloud *clouds, pbs_input *first,
                        pbs_err *err) {
    int count = app->common.operand_count ? app->common.operand_count : 1;
    pbs_cloudpack_stats stats;
    pbs_code rc = pbs_cloud_open_input(&app->run, first, pbs_operand(app, 0), &clouds[0], err);
    for (int i = 1; i < count && !rc; i++) rc = open_next(app, i, &clouds[i], err);
    if (!rc)
        rc = pbs_cloudpack(
            &app->run, clouds, (size_t)count,
            &(pbs_writer_desc){.path = app->common.output, .stage = app->stage, .codec = codec},
            &stats, err);
    if (!rc) report(app, &stats);
    for (int i = 0; i < count; i++) pbs_cloud_close(&clouds[i]);
    return rc;
}

pbs_code pbs_flatten_clouds(pbs_app *app, pbs_codec codec, pbs_input *first, bool *done,
                            pbs_err *err) {
    bool stream;
    *done = false;
    pbs_code rc = pbs_input_open(&app->run, pbs_operand(app, 0), first, err);
    if (rc) return rc;
    rc = pbs_flatten_is_stream(first, &stream, err);
    if (!rc && stream) return PBS_OK;
    *done = true;
    size_t count = (size_t)app->common.operand_count + 1;
    pbs_cloud *clouds = rc ? NULL : calloc(count, sizeof *clouds);
    if (clouds) {
        rc = flatten(app, codec, clouds, first, err);
        free(clouds);
        return rc;
    }
    pbs_input_close(first);
    return rc ? rc : pbs_fail(err, PBS_LIMIT, "no memory");
}
