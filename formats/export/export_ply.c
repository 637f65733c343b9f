/* export_ply.c: PLY, binary and little-endian (export.h). */
#include "formats/export/export.h"
#include "formats/container/wire.h"
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>

/* ---- the header ---- */

typedef struct text {
    char *at, *end;
} text;

__attribute__((format(printf, 2, 3))) static void put(text *t, const char *fmt, ...) {
    va_list ap;
    va_start(ap, fmt);
    t->at += vsnprintf(t->at, (size_t)(t->end - t->at), fmt, ap);
    va_end(ap);
    if (t->at > t->end) t->at = t->end;
}

/* Readers have lines of fixed length, and think of ASCII. */
static const char *put_comment(text *t, const char *line) {
    char clean[201];
    size_t n = strcspn(line, "\n");
    for (size_t i = 0; i < n && i < sizeof clean - 1; i++)
        clean[i] = line[i] >= ' ' && line[i] < 127 ? line[i] : '?';
    clean[n < sizeof clean - 1 ? n : sizeof clean - 1] = 0;
    put(t, "comment %s\n", clean);
    return line + n + (line[n] == '\n');
}

enum { HISTORY_LINES = 50 };

static pbs_code write_header(pbs_export_writer *w, pbs_err *err) {
    char bytes[16384], stage[256];
    text t = {bytes, bytes + sizeof bytes};
    const char *line = pbs_reader_history(w->x->reader);
    uint32_t channels = w->x->channels;
    put(&t, "ply\nformat binary_little_endian 1.0\n");
    for (int i = 0; *line && i < HISTORY_LINES; i++) line = put_comment(&t, line);
    snprintf(stage, sizeof stage, "stage %s", w->x->o->stage ? w->x->o->stage : "");
    put_comment(&t, stage);
    put(&t, "element vertex %" PRIu64 "\n", w->m->vertices);
    for (int k = 0; k < 3; k++)
        put(&t, "property %s %c\n", w->doubles ? "double" : "float", "xyz"[k]);
    for (int k = 0; k < 3 && channels & PBS_NORMAL; k++) put(&t, "property float n%c\n", "xyz"[k]);
    if (channels & PBS_COLOUR)
        put(&t, "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                "property uchar alpha\n");
    if (channels & PBS_SPACING) put(&t, "property float radius\n");
    if (w->x->o->faces)
        put(&t, "element face %" PRIu64 "\nproperty list uchar int vertex_indices\n", w->m->faces);
    put(&t, "end_header\n");
    return pbs_output_write(&w->out, bytes, (size_t)(t.at - bytes), err);
}

/* ---- what follows ---- */

static pbs_code write_block(void *ctx, const pbs_export_block *b, pbs_err *err) {
    pbs_export_writer *w = ctx;
    uint8_t *p = w->bytes;
    for (size_t i = 0; i < b->count; i++) {
        for (int k = 0; k < 3; k++)
            p = w->doubles ? pbs_put_f64(p, b->position[i][k])
                           : pbs_put_f32(p, (float)b->position[i][k]);
        for (int k = 0; k < 3 && b->normal; k++) p = pbs_put_f32(p, b->normal[i][k]);
        if (b->colour) p = (uint8_t *)memcpy(p, b->colour[i], 4) + 4;
        if (b->radius) p = pbs_put_f32(p, b->radius[i]);
    }
    pbs_run_progress(w->x->run, "writing", w->out.written, w->m->vertices * w->stride);
    return pbs_output_write(&w->out, w->bytes, (size_t)(p - w->bytes), err);
}

static pbs_code write_faces(pbs_export_writer *w, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (uint64_t i = 0; i < w->m->faces && !rc;) {
        uint8_t *p = w->bytes;
        for (int n = 0; n < PBS_EXPORT_WINDOW && i < w->m->faces; n++, i++) {
            *p++ = 4;
            for (uint32_t k = 0; k < 4; k++) p = pbs_put_u32(p, (uint32_t)(4 * i) + k);
        }
        rc = pbs_output_write(&w->out, w->bytes, (size_t)(p - w->bytes), err);
        if (!rc) rc = pbs_run_check(w->x->run, err);
    }
    return rc;
}

pbs_code pbs_export_ply(pbs_export_writer *w, pbs_err *err) {
    uint32_t channels = w->x->channels;
    w->stride = (w->doubles ? 24 : 12) + (channels & PBS_NORMAL ? 12 : 0) +
                (channels & PBS_COLOUR ? 4 : 0) + (channels & PBS_SPACING ? 4 : 0);
    if (w->m->faces > INT32_MAX / 4)
        return pbs_fail(err, PBS_LIMIT,
                        "%s: %" PRIu64 " corners of faces, and a PLY's have numbers up to 2^31: "
                        "choose a coarser --level, or --spacing",
                        w->x->name, 4 * w->m->faces);
    pbs_code rc = write_header(w, err);
    if (!rc) rc = pbs_export_each(w->x, write_block, w, err);
    return rc ? rc : write_faces(w, err);
}
