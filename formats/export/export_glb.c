/* export_glb.c: glTF 2.0 in one binary file (export.h).
 *
 * The head is a page of JSON in which only numbers change: it is printed, and the rest streamed,
 * since a library would want all points in memory first. Vertices lie one after the other, each
 * with all that it has.
 */
#include "formats/export/export.h"
#include "formats/container/wire.h"
#include "libcore/data/srgb.h"
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>

enum { HEAD = 4096, FLOAT = 5126, USHORT = 5123, UINT = 5125, POINTS = 0, TRIANGLES = 4 };

typedef struct json {
    char text[HEAD];
    size_t n;
    int accessors;
} json;

__attribute__((format(printf, 2, 3))) static void put(json *j, const char *fmt, ...) {
    va_list ap;
    va_start(ap, fmt);
    int n = vsnprintf(j->text + j->n, HEAD - j->n, fmt, ap);
    va_end(ap);
    j->n += n > 0 ? (size_t)n : 0;
    if (j->n > HEAD - 1) j->n = HEAD - 1;
}

/* ---- the head ---- */

/* Where the points are: relative to the origin as floats. Readers that keep a matrix as floats
 * lose nothing if the origin is one. */
static void put_node(json *j, const pbs_export_writer *w) {
    const double *o = w->origin;
    if (w->x->o->z_up)
        put(j, "\"matrix\":[1,0,0,0,0,0,-1,0,0,1,0,0,%.17g,%.17g,%.17g,1]", o[0], o[2], -o[1]);
    else
        put(j, "\"translation\":[%.17g,%.17g,%.17g]", o[0], o[1], o[2]);
}

static void put_accessor(json *j, uint64_t count, uint32_t at, int type, const char *shape) {
    put(j,
        "%s{\"bufferView\":0,\"byteOffset\":%u,\"componentType\":%d,\"count\":%" PRIu64
        ",\"type\":\"%s\"",
        j->accessors++ ? "," : "", at, type, count, shape);
}

static float relative(const pbs_export_writer *w, const double p[3], int axis) {
    return (float)(p[axis] - w->origin[axis]);
}

static void put_accessors(json *j, const pbs_export_writer *w) {
    uint32_t channels = w->x->channels, at = 12;
    uint64_t n = w->m->vertices;
    const pbs_box *b = &w->m->box;
    put(j, "\"accessors\":[");
    put_accessor(j, n, 0, FLOAT, "VEC3");
    /* Rounding keeps the order, so these are the least and the largest of what is written. */
    put(j, ",\"min\":[%.9g,%.9g,%.9g],\"max\":[%.9g,%.9g,%.9g]}", (double)relative(w, b->min, 0),
        (double)relative(w, b->min, 1), (double)relative(w, b->min, 2),
        (double)relative(w, b->max, 0), (double)relative(w, b->max, 1),
        (double)relative(w, b->max, 2));
    if (channels & PBS_NORMAL) put_accessor(j, n, at, FLOAT, "VEC3"), put(j, "}"), at += 12;
    if (channels & PBS_COLOUR)
        put_accessor(j, n, at, USHORT, "VEC4"), put(j, ",\"normalized\":true}"), at += 8;
    if (channels & PBS_SPACING) put_accessor(j, n, at, FLOAT, "SCALAR"), put(j, "}");
    if (w->m->faces)
        put(j, ",{\"bufferView\":1,\"componentType\":%d,\"count\":%" PRIu64 ",\"type\":\"SCALAR\"}",
            UINT, 6 * w->m->faces);
    put(j, "]");
}

static void put_mesh(json *j, const pbs_export_writer *w) {
    uint32_t channels = w->x->channels;
    int next = 1;
    put(j,
        "\"meshes\":[{\"primitives\":[{\"mode\":%d,\"material\":0,\"attributes\":{\"POSITION\":0",
        w->m->faces ? TRIANGLES : POINTS);
    if (channels & PBS_NORMAL) put(j, ",\"NORMAL\":%d", next++);
    if (channels & PBS_COLOUR) put(j, ",\"COLOR_0\":%d", next++);
    if (channels & PBS_SPACING) put(j, ",\"_RADIUS\":%d", next++);
    put(j, "}");
    if (w->m->faces) put(j, ",\"indices\":%d", next);
    put(j, "}]}]");
}

static void put_views(json *j, const pbs_export_writer *w, uint64_t vertices, uint64_t indices) {
    put(j,
        "\"buffers\":[{\"byteLength\":%" PRIu64 "}],\"bufferViews\":[{\"buffer\":0,"
        "\"byteLength\":%" PRIu64 ",\"byteStride\":%u,\"target\":34962}",
        vertices + indices, vertices, w->stride);
    if (indices)
        put(j,
            ",{\"buffer\":0,\"byteOffset\":%" PRIu64 ",\"byteLength\":%" PRIu64
            ",\"target\":34963}",
            vertices, indices);
    put(j, "]");
}

static void put_json(json *j, const pbs_export_writer *w, uint64_t vertices, uint64_t indices) {
    /* What has no normals is not lit. */
    bool lit = w->x->channels & PBS_NORMAL;
    put(j, "{\"asset\":{\"version\":\"2.0\",\"generator\":\"pbs-export " PBS_VERSION "\"}");
    if (!lit) put(j, ",\"extensionsUsed\":[\"KHR_materials_unlit\"]");
    put(j, ",\"scene\":0,\"scenes\":[{");
    if (vertices) {
        put(j, "\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,");
        put_node(j, w);
        put(j,
            "}],\"materials\":[{\"pbrMetallicRoughness\":{\"metallicFactor\":0},"
            "\"doubleSided\":true%s}],",
            lit ? "" : ",\"extensions\":{\"KHR_materials_unlit\":{}}");
        put_mesh(j, w);
        put(j, ",");
        put_accessors(j, w);
        put(j, ",");
        put_views(j, w, vertices, indices);
        put(j, "}");
    } else
        put(j, "}]}");
    while (j->n % 4) put(j, " ");
}

static pbs_code write_head(pbs_export_writer *w, uint64_t vertices, uint64_t indices,
                           pbs_err *err) {
    json j = {.n = 0};
    uint8_t head[20], *p = head, chunk[8];
    put_json(&j, w, vertices, indices);
    uint64_t all = 20 + j.n + (vertices ? 8 + vertices + indices : 0);
    if (all > UINT32_MAX)
        return pbs_fail(err, PBS_LIMIT,
                        "%s: %" PRIu64 " bytes of GLB, which has at most 4 GiB: write PLY, or "
                        "fewer points with --count or --spacing",
                        w->x->name, all);
    p = (uint8_t *)memcpy(p, "glTF", 4) + 4;
    p = pbs_put_u32(p, 2);
    p = pbs_put_u32(p, (uint32_t)all);
    p = pbs_put_u32(p, (uint32_t)j.n);
    memcpy(p, "JSON", 4);
    pbs_code rc = pbs_output_write(&w->out, head, sizeof head, err);
    if (!rc) rc = pbs_output_write(&w->out, j.text, j.n, err);
    if (rc || !vertices) return rc;
    p = pbs_put_u32(chunk, (uint32_t)(vertices + indices));
    memcpy(p, "BIN", 4);
    return pbs_output_write(&w->out, chunk, sizeof chunk, err);
}

/* ---- the rest ---- */

static uint8_t *put_normal(uint8_t *p, const float n[3]) {
    static const float up[3] = {0, 0, 1}; /* there must be one */
    const float *from = n[0] == 0 && n[1] == 0 && n[2] == 0 ? up : n;
    for (int k = 0; k < 3; k++) p = pbs_put_f32(p, from[k]);
    return p;
}

/* Linear light, of which 8 bits are too few: dark colours would fall together. */
static uint8_t *put_colour(uint8_t *p, const pbs_srgb_table *t, const uint8_t c[4]) {
    for (int k = 0; k < 3; k++) p = pbs_put_u16(p, (uint16_t)(t->linear[c[k]] * 65535.0f + 0.5f));
    return pbs_put_u16(p, (uint16_t)(c[3] * 257));
}

static pbs_code write_block(void *ctx, const pbs_export_block *b, pbs_err *err) {
    pbs_export_writer *w = ctx;
    const pbs_srgb_table *t = pbs_srgb();
    uint8_t *p = w->bytes;
    for (size_t i = 0; i < b->count; i++) {
        for (int k = 0; k < 3; k++) p = pbs_put_f32(p, relative(w, b->position[i], k));
        if (b->normal) p = put_normal(p, b->normal[i]);
        if (b->colour) p = put_colour(p, t, b->colour[i]);
        if (b->radius) p = pbs_put_f32(p, b->radius[i]);
    }
    pbs_run_progress(w->x->run, "writing", w->out.written, w->m->vertices * w->stride);
    return pbs_output_write(&w->out, w->bytes, (size_t)(p - w->bytes), err);
}

static pbs_code write_indices(pbs_export_writer *w, pbs_err *err) {
    static const uint32_t corner[6] = {0, 1, 2, 0, 2, 3};
    pbs_code rc = PBS_OK;
    for (uint64_t i = 0; i < w->m->faces && !rc;) {
        uint8_t *p = w->bytes;
        for (int n = 0; n < PBS_EXPORT_WINDOW && i < w->m->faces; n++, i++)
            for (int k = 0; k < 6; k++) p = pbs_put_u32(p, (uint32_t)(4 * i) + corner[k]);
        rc = pbs_output_write(&w->out, w->bytes, (size_t)(p - w->bytes), err);
        if (!rc) rc = pbs_run_check(w->x->run, err);
    }
    return rc;
}

pbs_code pbs_export_glb(pbs_export_writer *w, pbs_err *err) {
    uint32_t channels = w->x->channels;
    const pbs_box *b = &w->m->box;
    w->stride = 12 + (channels & PBS_NORMAL ? 12 : 0) + (channels & PBS_COLOUR ? 8 : 0) +
                (channels & PBS_SPACING ? 4 : 0);
    for (int k = 0; k < 3; k++) {
        w->origin[k] = w->m->vertices ? (double)(float)(b->min[k] / 2 + b->max[k] / 2) : 0;
        bool fit = isfinite(w->origin[k]) && isfinite(relative(w, b->min, k)) &&
                   isfinite(relative(w, b->max, k));
        if (w->m->vertices && !fit)
            return pbs_fail(err, PBS_LIMIT, "%s: positions are too large for floats: write PLY",
                            w->x->name);
    }
    pbs_code rc = write_head(w, w->m->vertices * w->stride, w->m->faces * 24, err);
    if (!rc) rc = pbs_export_each(w->x, write_block, w, err);
    return rc ? rc : write_indices(w, err);
}
