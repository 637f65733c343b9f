#include "formats/voxels/voxels.h"
#include "formats/container/columns.h"
#include "formats/container/wire.h"
#include "libcore/voxels/grid.h"
#include <math.h>
#include <stddef.h>
#include <stdio.h>

/* One row a channel, in the order of the payload; each is 4 bytes a voxel. */
static const struct {
    uint32_t channel;
    const char *text;
} channel[] = {
    {PBS_POSITION, "place:u8x4"}, {PBS_NORMAL, "normal:i10x3"},    {PBS_WEIGHT, "weight:f32"},
    {PBS_COLOUR, "colour:u8x4"},  {PBS_MATERIAL, "material:u8x4"}, {PBS_EMISSIVE, "emissive:u8x4"},
    {PBS_FACE, "face:u32"},
};
enum { CHANNELS = sizeof channel / sizeof channel[0] };

/* And the array of each. */
static const pbs_column column[CHANNELS] = {
    {PBS_POSITION, 4, offsetof(pbs_voxels, place)},
    {PBS_NORMAL, 4, offsetof(pbs_voxels, normal)},
    {PBS_WEIGHT, 4, offsetof(pbs_voxels, weight)},
    {PBS_COLOUR, 4, offsetof(pbs_voxels, colour)},
    {PBS_MATERIAL, 4, offsetof(pbs_voxels, material)},
    {PBS_EMISSIVE, 4, offsetof(pbs_voxels, emissive)},
    {PBS_FACE, 4, offsetof(pbs_voxels, face)},
};
static const pbs_columns columns = {column, CHANNELS, "the voxels"};

void pbs_voxels_text(uint32_t channels, char out[256]) {
    char *p = out;
    *p = 0;
    for (size_t i = 0; i < CHANNELS; i++)
        if (channels & channel[i].channel)
            p += sprintf(p, "%s%s", p == out ? "" : " ", channel[i].text);
}

pbs_code pbs_voxels_parse(const char *place, const char *text, uint32_t *channels, pbs_err *err) {
    /* The text is canonical, so: find the channels named, and see whether they give this text. */
    char canonical[256];
    *channels = 0;
    for (size_t i = 0; i < CHANNELS; i++)
        if (strstr(text, channel[i].text)) *channels |= channel[i].channel;
    pbs_voxels_text(*channels, canonical);
    if (strcmp(canonical, text) || !(*channels & PBS_POSITION))
        return pbs_fail(err, PBS_DATA, "%s: channels that this program does not know: %s", place,
                        text);
    return PBS_OK;
}

uint32_t pbs_voxels_stride(uint32_t channels) {
    uint32_t n = 0;
    for (size_t i = 0; i < CHANNELS; i++) n += channels & channel[i].channel ? 4 : 0;
    return n;
}

/* ---- arrays ---- */

pbs_code pbs_voxels_grow(pbs_run *run, uint32_t channels, pbs_voxels *v, size_t *cap, size_t need,
                         pbs_err *err) {
    return pbs_columns_grow(run, &columns, channels, v, cap, need, err);
}

pbs_code pbs_voxels_alloc(pbs_run *run, uint32_t channels, size_t count, pbs_voxels *out,
                          pbs_err *err) {
    memset(out, 0, sizeof *out);
    size_t cap = 0;
    pbs_code rc = pbs_voxels_grow(run, channels, out, &cap, count ? count : 1, err);
    if (rc) pbs_voxels_free(run, out);
    out->count = rc ? 0 : count;
    return rc;
}

void pbs_voxels_free(pbs_run *run, pbs_voxels *v) {
    pbs_columns_free(run, &columns, v);
    memset(v, 0, sizeof *v);
}

void pbs_voxels_append(pbs_voxels *v, const pbs_voxels *from, size_t first, size_t n) {
    for (size_t i = 0; i < CHANNELS; i++) {
        uint8_t *to = pbs_column_get(column + i, v);
        const uint8_t *source = pbs_column_get(column + i, from);
        if (to && source) memcpy(to + 4 * v->count, source + 4 * first, 4 * n);
    }
    v->count += n;
}

/* ---- bytes ---- */

enum { LEVEL_AT = 0, LEVELS_AT = 4, SIZE_AT = 8, CHUNK_AT = 12 };

static void put_place(uint8_t out[PBS_VOXELS_HEADER], const pbs_voxel_place *p) {
    memset(out, 0, PBS_VOXELS_HEADER);
    pbs_put_u32(out + LEVEL_AT, p->level);
    pbs_put_u32(out + LEVELS_AT, p->levels);
    pbs_put_u32(out + SIZE_AT, p->size);
    for (int k = 0; k < 3; k++) pbs_put_u32(out + CHUNK_AT + 4 * k, p->chunk[k]);
}

pbs_code pbs_voxels_write(pbs_writer *w, uint32_t node, const pbs_voxel_place *place,
                          const pbs_voxels *v, uint64_t at, pbs_err *err) {
    uint8_t head[PBS_VOXELS_HEADER];
    put_place(head, place);
    for (size_t i = 0; i < v->count; i += PBS_VOXELS_CHUNK) {
        size_t n = v->count - i < PBS_VOXELS_CHUNK ? v->count - i : PBS_VOXELS_CHUNK;
        pbs_chunk c = {
            .tag = PBS_TAG_VOXELS, .node = node, .count = (uint32_t)n, .first = (uint32_t)(at + i)};
        pbs_piece piece[1 + CHANNELS] = {{head, sizeof head}};
        int pieces = 1;
        for (size_t k = 0; k < CHANNELS; k++) {
            const uint8_t *a = pbs_column_get(column + k, v);
            if (a) piece[pieces++] = (pbs_piece){a + 4 * i, 4 * n};
        }
        pbs_code rc = pbs_writer_chunk(w, &c, piece, pieces, err);
        if (rc) return rc;
    }
    return PBS_OK;
}

pbs_code pbs_faces_write(pbs_writer *w, uint32_t node, bool colour, const uint32_t *faces,
                         size_t count, uint64_t at, pbs_err *err) {
    for (size_t i = 0; i < count; i += PBS_VOXELS_CHUNK) {
        size_t n = count - i < PBS_VOXELS_CHUNK ? count - i : PBS_VOXELS_CHUNK;
        pbs_chunk c = {.tag = PBS_TAG_FACES,
                       .flags = colour ? PBS_VFAC_COLOUR : 0,
                       .node = node,
                       .count = (uint32_t)n,
                       .first = (uint32_t)(at + i)};
        pbs_piece piece = {faces + i, 4 * n};
        pbs_code rc = pbs_writer_chunk(w, &c, &piece, 1, err);
        if (rc) return rc;
    }
    return PBS_OK;
}

/* Chunks along an axis of the grid at a level; a cell of a coarse level may reach beyond it. */
static uint64_t chunks_along(const pbs_voxel_place *p) {
    uint64_t cells = ((uint64_t)p->size + (UINT64_C(1) << p->level) - 1) >> p->level;
    return (cells + PBS_CHUNK - 1) / PBS_CHUNK;
}

static bool get_place(const uint8_t *in, pbs_voxel_place *p) {
    p->level = pbs_get_u32(in + LEVEL_AT);
    p->levels = pbs_get_u32(in + LEVELS_AT);
    p->size = pbs_get_u32(in + SIZE_AT);
    for (int k = 0; k < 3; k++) p->chunk[k] = pbs_get_u32(in + CHUNK_AT + 4 * k);
    bool fine = p->size >= 1 && p->size <= PBS_GRID_MAX && p->level <= 31 && p->levels <= 31;
    for (int k = 0; k < 3; k++) fine = fine && p->chunk[k] < chunks_along(p);
    return fine;
}

static pbs_code bad(pbs_err *err, const char *file, const pbs_chunk *c, const char *what) {
    return pbs_fail(err, PBS_DATA, "%s: voxels of node %u: %s: the file is damaged", file, c->node,
                    what);
}

pbs_code pbs_voxels_view(const char *file, uint32_t channels, const pbs_chunk *chunk, uint64_t have,
                         pbs_voxel_place *place, pbs_voxels *out, pbs_err *err) {
    const uint8_t *p = chunk->payload;
    memset(out, 0, sizeof *out);
    if (chunk->bytes != PBS_VOXELS_HEADER + (uint64_t)chunk->count * pbs_voxels_stride(channels) ||
        chunk->count > PBS_VOXELS_CHUNK)
        return bad(err, file, chunk, "size and count differ");
    if (chunk->first != have || !chunk->count)
        return bad(err, file, chunk, "they do not go on where the last ones ended");
    if (!get_place(p, place)) return bad(err, file, chunk, "no such place in the grid");
    p += PBS_VOXELS_HEADER;
    out->count = chunk->count;
    for (size_t i = 0; i < CHANNELS; i++) {
        if (!(channels & channel[i].channel)) continue;
        pbs_column_set(column + i, out, p);
        p += 4 * (size_t)chunk->count;
    }
    return PBS_OK;
}

const char *pbs_voxels_fault(const pbs_voxel_place *place, const pbs_voxels *v, int64_t *last) {
    uint32_t end[3]; /* of the grid, in cells of this chunk */
    for (int k = 0; k < 3; k++) {
        uint64_t cells =
            ((uint64_t)place->size + (UINT64_C(1) << place->level) - 1) >> place->level;
        uint64_t left = cells - (uint64_t)place->chunk[k] * PBS_CHUNK;
        end[k] = left < PBS_CHUNK ? (uint32_t)left : PBS_CHUNK;
    }
    for (size_t i = 0; i < v->count; i++) {
        uint32_t p = v->place[i], code = pbs_morton8(p);
        if ((int64_t)code <= *last) return "cells that are not in Morton order";
        *last = code;
        if ((p & 255) >= end[0] || (p >> 8 & 255) >= end[1] || (p >> 16 & 255) >= end[2])
            return "a cell outside of the grid";
        if (p >> 31) return "faces that there are none of";
        if (v->weight && !(v->weight[i] >= 0 && v->weight[i] < INFINITY))
            return "a weight that is no area";
    }
    return NULL;
}
