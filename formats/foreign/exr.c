/* exr.c: the module "exr": multi-part OpenEXR by OpenEXRCore, the C part of OpenEXR.
 *
 * Writing is ZIP at level 1, which is 1.6 times as fast as the usual level 4 and a tenth larger:
 * these files are for looking at, not for keeping. */
#include "formats/readers/module.h"
#include <limits.h>
#include <math.h>
#include <openexr.h>
#include <stdio.h>
#include <string.h>

#define MAX_SIDE 65536

/* The library tells why it failed only through a callback. */
static _Thread_local char reason[256];

static void remember(exr_const_context_t c, exr_result_t code, const char *text) {
    (void)c, (void)code;
    snprintf(reason, sizeof reason, "%s", text ? text : "");
}

static pbs_code failed(pbs_err *err, pbs_code code, const char *where, exr_result_t rc) {
    if (rc == EXR_ERR_OUT_OF_MEMORY) code = PBS_LIMIT;
    const char *why = *reason ? reason : exr_get_default_error_message(rc);
    return pbs_fail(err, code, "%s: %s", where, why);
}

static pbs_code add_part(exr_context_t c, const pbs_exr_part *part, pbs_err *err) {
    int p;
    exr_result_t rc;
    if (!part->width || !part->height || part->width > MAX_SIDE || part->height > MAX_SIDE ||
        part->plane_count < 1)
        return pbs_fail(err, PBS_DATA, "part %s: %u x %u with %d channels", part->name, part->width,
                        part->height, part->plane_count);
    if ((rc = exr_add_part(c, part->name, EXR_STORAGE_SCANLINE, &p)) ||
        (rc = exr_initialize_required_attr_simple(c, p, (int)part->width, (int)part->height,
                                                  EXR_COMPRESSION_ZIP)))
        return failed(err, PBS_IO, part->name, rc);
    exr_attr_v3d_t origin = {{{part->origin[0], part->origin[1], part->origin[2]}}};
    if ((rc = exr_attr_set_v3d(c, p, "pbsOrigin", &origin)))
        return failed(err, PBS_IO, part->name, rc);
    for (int i = 0; i < part->plane_count; i++) {
        const pbs_exr_plane *plane = &part->planes[i];
        if ((uint64_t)part->width * plane->stride * sizeof(float) > INT_MAX)
            return pbs_fail(err, PBS_DATA, "channel %s: the lines are too long", plane->channel);
        rc = exr_add_channel(c, p, plane->channel, plane->half ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT,
                             EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1);
        if (rc) return failed(err, PBS_IO, plane->channel, rc);
    }
    return PBS_OK;
}

/* Points the encoder's channel at line y of the plane of that name; the encoder has its own
 * order. */
static void aim(exr_coding_channel_info_t *ch, const pbs_exr_part *part, uint32_t y) {
    for (int i = 0; i < part->plane_count; i++) {
        const pbs_exr_plane *plane = &part->planes[i];
        if (strcmp(plane->channel, ch->channel_name) != 0) continue;
        ch->user_bytes_per_element = sizeof(float);
        ch->user_data_type = EXR_PIXEL_FLOAT;
        ch->user_pixel_stride = (int32_t)(plane->stride * sizeof(float));
        ch->user_line_stride = (int32_t)(part->width * plane->stride * sizeof(float));
        ch->encode_from_ptr =
            (const uint8_t *)(plane->data + (size_t)y * part->width * plane->stride);
    }
}

static exr_result_t write_lines(exr_context_t c, int p, const pbs_exr_part *part,
                                exr_encode_pipeline_t *e) {
    int32_t lines;
    exr_result_t rc = exr_get_scanlines_per_chunk(c, p, &lines);
    for (uint32_t y = 0; !rc && y < part->height; y += (uint32_t)lines) {
        exr_chunk_info_t chunk;
        if ((rc = exr_write_scanline_chunk_info(c, p, (int)y, &chunk)) ||
            (rc = y ? exr_encoding_update(c, p, &chunk, e)
                    : exr_encoding_initialize(c, p, &chunk, e)))
            return rc;
        for (int i = 0; i < e->channel_count; i++) aim(&e->channels[i], part, y);
        if ((!y && (rc = exr_encoding_choose_default_routines(c, p, e))) ||
            (rc = exr_encoding_run(c, p, e)))
            return rc;
    }
    return rc;
}

static pbs_code write_parts(exr_context_t c, const pbs_exr_part *parts, int n, pbs_err *err) {
    pbs_code code = n > 0 ? PBS_OK : pbs_fail(err, PBS_DATA, "no part to write");
    for (int p = 0; !code && p < n; p++) code = add_part(c, &parts[p], err);
    exr_result_t rc = code ? EXR_ERR_SUCCESS : exr_write_header(c);
    for (int p = 0; !code && !rc && p < n; p++) {
        exr_encode_pipeline_t e = EXR_ENCODE_PIPELINE_INITIALIZER;
        rc = write_lines(c, p, &parts[p], &e);
        exr_encoding_destroy(c, &e);
    }
    return code ? code : rc ? failed(err, PBS_IO, "writing", rc) : PBS_OK;
}

static pbs_code exr_write(const char *path, const pbs_exr_part *parts, int part_count,
                          pbs_err *err) {
    exr_context_t c = NULL;
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    init.error_handler_fn = remember;
    init.zip_level = 1;
    *reason = 0;
    /* The library writes beside, and renames or removes that file when it is finished. */
    exr_result_t rc = exr_start_write(&c, path, EXR_INTERMEDIATE_TEMP_FILE, &init);
    if (rc) return failed(err, PBS_IO, path, rc);
    pbs_code code = write_parts(c, parts, part_count, err);
    rc = exr_finish(&c);
    if (!code && rc) code = failed(err, PBS_IO, path, rc);
    return code;
}

/* One part while it is read: all channels as planes of floats in one array. */
typedef struct reading {
    exr_context_t c;
    int part;
    int32_t x0, y0;
    uint32_t width, height;
    const exr_attr_chlist_t *channels;
    float *data;
    exr_decode_pipeline_t decoder;
    bool begun;
} reading;

static pbs_code read_chunk(reading *r, const exr_chunk_info_t *chunk, uint32_t x, uint32_t y,
                           pbs_err *err) {
    if (x > r->width || y > r->height || (uint32_t)chunk->width > r->width - x ||
        (uint32_t)chunk->height > r->height - y)
        return pbs_fail(err, PBS_DATA, "a chunk lies outside the image");
    exr_decode_pipeline_t *d = &r->decoder;
    exr_result_t rc = r->begun ? exr_decoding_update(r->c, r->part, chunk, d)
                               : exr_decoding_initialize(r->c, r->part, chunk, d);
    bool first = !r->begun;
    r->begun = true;
    for (int i = 0; !rc && i < d->channel_count; i++) {
        exr_coding_channel_info_t *ch = &d->channels[i];
        size_t plane = (size_t)i * r->width * r->height;
        ch->user_bytes_per_element = ch->user_pixel_stride = sizeof(float);
        ch->user_data_type = EXR_PIXEL_FLOAT;
        ch->user_line_stride = (int32_t)(r->width * sizeof(float));
        ch->decode_to_ptr = (uint8_t *)(r->data + plane + (size_t)y * r->width + x);
    }
    if (!rc && first) rc = exr_decoding_choose_default_routines(r->c, r->part, d);
    if (!rc) rc = exr_decoding_run(r->c, r->part, d);
    return rc ? failed(err, PBS_DATA, "reading", rc) : PBS_OK;
}

static pbs_code read_scanlines(pbs_run *run, reading *r, pbs_err *err) {
    int32_t lines = 0;
    exr_result_t rc = exr_get_scanlines_per_chunk(r->c, r->part, &lines);
    if (rc || lines < 1) return failed(err, PBS_DATA, "reading", rc);
    pbs_code code = PBS_OK;
    for (uint32_t y = 0; !code && y < r->height; y += (uint32_t)lines) {
        exr_chunk_info_t chunk;
        if ((code = pbs_run_check(run, err))) break;
        rc = exr_read_scanline_chunk_info(r->c, r->part, r->y0 + (int32_t)y, &chunk);
        code = rc ? failed(err, PBS_DATA, "reading", rc) : read_chunk(r, &chunk, 0, y, err);
    }
    return code;
}

/* The full-size level; smaller ones are left alone. */
static pbs_code read_tiles(pbs_run *run, reading *r, pbs_err *err) {
    int32_t w = 0, h = 0;
    exr_result_t rc = exr_get_tile_sizes(r->c, r->part, 0, 0, &w, &h);
    if (rc || w < 1 || h < 1) return failed(err, PBS_DATA, "reading", rc);
    uint32_t columns = (r->width - 1) / (uint32_t)w + 1, rows = (r->height - 1) / (uint32_t)h + 1;
    pbs_code code = PBS_OK;
    for (uint64_t i = 0; !code && i < (uint64_t)columns * rows; i++) {
        uint32_t x = (uint32_t)(i % columns), y = (uint32_t)(i / columns);
        exr_chunk_info_t chunk;
        if ((code = pbs_run_check(run, err))) break;
        rc = exr_read_tile_chunk_info(r->c, r->part, (int)x, (int)y, 0, 0, &chunk);
        code = rc ? failed(err, PBS_DATA, "reading", rc)
                  : read_chunk(r, &chunk, x * (uint32_t)w, y * (uint32_t)h, err);
    }
    return code;
}

static pbs_code read_header(reading *r, exr_storage_t *storage, pbs_err *err) {
    exr_attr_box2i_t box;
    exr_result_t rc;
    if ((rc = exr_get_storage(r->c, r->part, storage)) ||
        (rc = exr_get_data_window(r->c, r->part, &box)) ||
        (rc = exr_get_channels(r->c, r->part, &r->channels)))
        return failed(err, PBS_DATA, "the header", rc);
    if (*storage != EXR_STORAGE_SCANLINE && *storage != EXR_STORAGE_TILED)
        return pbs_fail(err, PBS_DATA, "deep data is not supported");
    int64_t width = (int64_t)box.max.x - box.min.x + 1, height = (int64_t)box.max.y - box.min.y + 1;
    if (width < 1 || height < 1 || width > MAX_SIDE || height > MAX_SIDE ||
        r->channels->num_channels < 1)
        return pbs_fail(err, PBS_DATA, "%lld x %lld with %d channels", (long long)width,
                        (long long)height, r->channels->num_channels);
    for (int i = 0; i < r->channels->num_channels; i++) {
        const exr_attr_chlist_entry_t *e = &r->channels->entries[i];
        if (e->x_sampling != 1 || e->y_sampling != 1)
            return pbs_fail(err, PBS_DATA, "channel %s is subsampled: not supported", e->name.str);
    }
    r->x0 = box.min.x, r->y0 = box.min.y;
    r->width = (uint32_t)width, r->height = (uint32_t)height;
    return PBS_OK;
}

typedef pbs_code exr_sink(void *ctx, const pbs_exr_part *part, pbs_err *err);

static pbs_code hand_over(pbs_run *run, const reading *r, exr_sink *sink, void *ctx, pbs_err *err) {
    const char *name = NULL;
    int n = r->channels->num_channels;
    pbs_exr_part part = {"", r->width, r->height, NULL, n, {0, 0, 0}};
    exr_attr_v3d_t origin;
    if (!exr_attr_get_v3d(r->c, r->part, "pbsOrigin", &origin))
        for (int k = 0; k < 3; k++) part.origin[k] = isfinite(origin.arr[k]) ? origin.arr[k] : 0;
    if (!exr_get_name(r->c, r->part, &name) && name) part.name = name;
    pbs_code code = pbs_alloc(run, &part.planes, (size_t)n, sizeof *part.planes, "EXR", err);
    if (code) return code;
    for (int i = 0; i < n; i++) {
        const exr_attr_chlist_entry_t *e = &r->channels->entries[i];
        part.planes[i] = (pbs_exr_plane){e->name.str, r->data + (size_t)i * r->width * r->height, 1,
                                         e->pixel_type == EXR_PIXEL_HALF};
    }
    code = sink(ctx, &part, err);
    pbs_free(run, part.planes);
    return code;
}

static pbs_code read_part(pbs_run *run, reading *r, exr_sink *sink, void *ctx, pbs_err *err) {
    exr_storage_t storage = EXR_STORAGE_SCANLINE;
    uint64_t chunk = 0;
    pbs_code code = read_header(r, &storage, err);
    if (code) return code;
    exr_result_t rc = exr_get_chunk_unpacked_size(r->c, r->part, &chunk);
    if (rc) return failed(err, PBS_DATA, "the header", rc);
    size_t inside = chunk < SIZE_MAX / 4 ? 3 * (size_t)chunk : SIZE_MAX / 2;
    if ((code = pbs_mem_take(run, inside, "reading EXR", err))) return code;
    size_t floats = (size_t)r->width * r->height * (size_t)r->channels->num_channels;
    code = pbs_alloc(run, &r->data, floats, sizeof *r->data, "the planes of an EXR part", err);
    if (!code)
        code = storage == EXR_STORAGE_TILED ? read_tiles(run, r, err) : read_scanlines(run, r, err);
    if (!code) code = hand_over(run, r, sink, ctx, err);
    if (r->begun) exr_decoding_destroy(r->c, &r->decoder);
    pbs_free(run, r->data);
    pbs_mem_give(run, inside);
    return code;
}

static pbs_code exr_read(pbs_run *run, const char *path, exr_sink *sink, void *ctx, pbs_err *err) {
    exr_context_t c = NULL;
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    init.error_handler_fn = remember;
    /* A file that was cut off is an error, not a shorter file. */
    init.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    init.max_image_width = init.max_image_height = MAX_SIDE;
    int parts = 0;
    *reason = 0;
    exr_result_t rc = exr_start_read(&c, path, &init);
    if (rc)
        return failed(err, rc == EXR_ERR_FILE_ACCESS || rc == EXR_ERR_READ_IO ? PBS_IO : PBS_DATA,
                      path, rc);
    pbs_code code = exr_get_count(c, &parts) ? pbs_fail(err, PBS_DATA, "%s", path) : PBS_OK;
    for (int p = 0; !code && p < parts; p++) {
        reading r = {.c = c, .part = p, .decoder = EXR_DECODE_PIPELINE_INITIALIZER};
        code = read_part(run, &r, sink, ctx, err);
        if (code == PBS_DATA) pbs_fail_in(err, "%s: part %d", path, p);
    }
    exr_finish(&c);
    return code;
}

__attribute__((visibility("default")))
const pbs_module_exr pbs_module = {PBS_MODULE_ABI, exr_write, exr_read};
