#include "formats/surfels/points.h"
#include "formats/container/columns.h"
#include "formats/container/wire.h"
#include <stddef.h>
#include <stdio.h>
#include <string.h>

/* One row a channel, in the order of the record. */
static const struct {
    uint32_t channel;
    const char *text, *packed_text;
    uint8_t size, packed_size;
} channel[] = {
    {PBS_POSITION, "position:f32x3", "position:u16x3", 12, 6},
    {PBS_SPACING, "spacing:f32", "spacing:f16", 4, 2},
    {PBS_NORMAL, "normal:i16x2", "normal:i16x2", 4, 4},
    {PBS_COLOUR, "colour:u8x4", "colour:u8x4", 4, 4},
    {PBS_MATERIAL, "material:u8x4", "material:u8x4", 4, 4},
    {PBS_EMISSIVE, "emissive:u8x4", "emissive:u8x4", 4, 4},
};
#define CHANNELS (sizeof channel / sizeof channel[0])

/* And the array of each. */
static const pbs_column column[CHANNELS] = {
    {PBS_POSITION, 12, offsetof(pbs_points, position)},
    {PBS_SPACING, 4, offsetof(pbs_points, spacing)},
    {PBS_NORMAL, 4, offsetof(pbs_points, normal)},
    {PBS_COLOUR, 4, offsetof(pbs_points, colour)},
    {PBS_MATERIAL, 4, offsetof(pbs_points, material)},
    {PBS_EMISSIVE, 4, offsetof(pbs_points, emissive)},
};
static const pbs_columns columns = {column, CHANNELS, "the points"};

int pbs_record_at(const pbs_record *r, uint32_t which) {
    int at = 0;
    if (!(r->channels & which)) return -1;
    for (size_t i = 0; channel[i].channel != which; i++)
        if (r->channels & channel[i].channel)
            at += r->packed ? channel[i].packed_size : channel[i].size;
    return at;
}

pbs_record pbs_record_make(uint32_t channels, bool packed) {
    pbs_record r = {channels, packed, 0};
    for (size_t i = 0; i < CHANNELS; i++)
        if (channels & channel[i].channel)
            r.stride += packed ? channel[i].packed_size : channel[i].size;
    return r;
}

void pbs_record_text(const pbs_record *r, char out[256]) {
    char *p = out;
    *p = 0;
    for (size_t i = 0; i < CHANNELS; i++)
        if (r->channels & channel[i].channel)
            p += sprintf(p, "%s%s", p == out ? "" : " ",
                         r->packed ? channel[i].packed_text : channel[i].text);
}

pbs_code pbs_record_parse(const char *place, const char *channels, pbs_record *out, pbs_err *err) {
    /* The text is canonical, so: find the channels named, and see whether they give this text. */
    uint32_t bits = 0;
    bool packed = strstr(channels, "position:u16x3") != NULL;
    for (size_t i = 0; i < CHANNELS; i++)
        if (strstr(channels, packed ? channel[i].packed_text : channel[i].text))
            bits |= channel[i].channel;
    char text[256];
    *out = pbs_record_make(bits, packed);
    pbs_record_text(out, text);
    if (strcmp(text, channels) || !(bits & PBS_POSITION) || (packed && !(bits & PBS_SPACING)))
        return pbs_fail(err, PBS_DATA, "%s: channels that this program does not know: %s", place,
                        channels);
    return PBS_OK;
}

/* ---- arrays ---- */

pbs_code pbs_points_grow(pbs_run *run, uint32_t channels, pbs_points *p, size_t *cap, size_t need,
                         pbs_err *err) {
    return pbs_columns_grow(run, &columns, channels, p, cap, need, err);
}

pbs_code pbs_points_alloc(pbs_run *run, uint32_t channels, size_t count, pbs_points *out,
                          pbs_err *err) {
    memset(out, 0, sizeof *out);
    size_t cap = 0;
    pbs_code rc = pbs_points_grow(run, channels, out, &cap, count ? count : 1, err);
    if (rc) pbs_points_free(run, out);
    out->count = rc ? 0 : count;
    return rc;
}

void pbs_points_free(pbs_run *run, pbs_points *p) {
    pbs_columns_free(run, &columns, p);
    memset(p, 0, sizeof *p);
}

/* ---- records ---- */

static void pack_position(uint8_t *to, size_t stride, const float *from, size_t n,
                          const pbs_lattice *l) {
    for (size_t i = 0; i < n; i++, to += stride)
        for (int k = 0; k < 3; k++) pbs_put_u16(to + 2 * k, pbs_lattice_put(l, k, from[3 * i + k]));
}

static void pack_spacing(uint8_t *to, size_t stride, const float *from, size_t n,
                         const pbs_lattice *l) {
    for (size_t i = 0; i < n; i++, to += stride)
        pbs_put_u16(to, pbs_half_put((float)(from[i] / (65535 * l->step))));
}

/* n fields of 12 or 4 bytes from one step to another; a memcpy of fixed size is a move or two. */
static void copy_field(uint8_t *to, size_t to_step, const uint8_t *from, size_t from_step,
                       size_t size, size_t n) {
    if (size == 12)
        for (size_t i = 0; i < n; i++, to += to_step, from += from_step) memcpy(to, from, 12);
    else
        for (size_t i = 0; i < n; i++, to += to_step, from += from_step) memcpy(to, from, 4);
}

static void pack(const pbs_record *r, const pbs_points *p, size_t first, size_t n, uint8_t *to,
                 const pbs_lattice *l) {
    for (size_t i = 0; i < CHANNELS; i++) {
        int at = pbs_record_at(r, channel[i].channel);
        if (at < 0) continue;
        size_t size = channel[i].size;
        const uint8_t *from = pbs_column_get(column + i, p) + first * size;
        uint8_t *out = to + at;
        if (r->packed && channel[i].channel == PBS_POSITION)
            pack_position(out, r->stride, p->position + 3 * first, n, l);
        else if (r->packed && channel[i].channel == PBS_SPACING)
            pack_spacing(out, r->stride, p->spacing + first, n, l);
        else
            copy_field(out, r->stride, from, size, size, n);
    }
}

pbs_code pbs_points_write(pbs_run *run, pbs_writer *w, const pbs_record *r, uint32_t node,
                          const pbs_points *p, size_t at, uint32_t limit,
                          const pbs_lattice *lattice, pbs_err *err) {
    return pbs_records_write(run, w, PBS_TAG_POINTS, r, node, p, at, limit, lattice, err);
}

pbs_code pbs_records_write(pbs_run *run, pbs_writer *w, uint32_t tag, const pbs_record *r,
                           uint32_t node, const pbs_points *p, size_t at, uint32_t limit,
                           const pbs_lattice *lattice, pbs_err *err) {
    uint8_t *buf;
    size_t room = p->count < limit ? p->count : limit;
    pbs_code rc = pbs_alloc(run, &buf, room, r->stride, "a chunk of points", err);
    for (size_t i = 0; i < p->count && !rc; i += limit) {
        size_t n = p->count - i < limit ? p->count - i : limit;
        pack(r, p, i, n, buf, lattice);
        pbs_chunk c = {.tag = tag, .node = node, .count = (uint32_t)n, .first = (uint32_t)(at + i)};
        pbs_piece piece = {buf, n * r->stride};
        rc = pbs_writer_chunk(w, &c, &piece, 1, err);
    }
    pbs_free(run, buf);
    return rc;
}

void pbs_points_blank(const pbs_record *r, uint8_t *to) {
    static const struct {
        uint32_t channel;
        uint8_t value[4];
    } blank[] = {{PBS_NORMAL, {0, 0x80, 0, 0x80}}, /* PBS_NO_NORMAL, twice */
                 {PBS_COLOUR, {255, 255, 255, 255}},
                 {PBS_MATERIAL, {0, 255, 0, 0}},
                 {PBS_EMISSIVE, {0, 0, 0, 0}}};
    for (size_t i = 0; i < sizeof blank / sizeof blank[0]; i++) {
        int at = pbs_record_at(r, blank[i].channel);
        if (at >= 0) memcpy(to + at, blank[i].value, 4);
    }
}

static void unpack_lattice(const pbs_record *r, const uint8_t *from, size_t n, pbs_points *p,
                           const pbs_lattice *l) {
    const uint8_t *spacing = from + pbs_record_at(r, PBS_SPACING);
    for (size_t i = 0; i < n; i++, from += r->stride, spacing += r->stride) {
        for (int k = 0; k < 3; k++)
            p->position[3 * (p->count + i) + k] = pbs_lattice_get(l, k, pbs_get_u16(from + 2 * k));
        p->spacing[p->count + i] = (float)(pbs_half_get(pbs_get_u16(spacing)) * 65535 * l->step);
    }
}

pbs_code pbs_points_fit(const char *place, const pbs_record *r, const pbs_chunk *c, uint64_t have,
                        pbs_err *err) {
    if (c->bytes == (uint64_t)c->count * r->stride && c->first == have) return PBS_OK;
    return pbs_fail(err, PBS_DATA,
                    "%s: node %u: %u points in %llu bytes from number %u on: damaged", place,
                    c->node, c->count, (unsigned long long)c->bytes, c->first);
}

const char *pbs_points_fault(const pbs_points *p, size_t first) {
    for (size_t i = first; i < p->count; i++) {
        for (int k = 0; k < 3; k++)
            if (!isfinite(p->position[3 * i + k])) return "a position is not finite";
        if (p->spacing && (!(p->spacing[i] >= 0) || !isfinite(p->spacing[i])))
            return "a spacing is not a distance";
    }
    return NULL;
}

pbs_code pbs_points_read(const char *place, const pbs_record *r, const pbs_chunk *c, pbs_points *p,
                         const pbs_lattice *lattice, pbs_err *err) {
    pbs_code rc = pbs_points_fit(place, r, c, p->count, err);
    if (rc || !c->count) return rc;
    const uint8_t *from = c->payload;
    if (r->packed) unpack_lattice(r, from, c->count, p, lattice);
    for (size_t i = 0; i < CHANNELS; i++) {
        int at = pbs_record_at(r, channel[i].channel);
        if (at < 0 || (r->packed && (channel[i].channel & (PBS_POSITION | PBS_SPACING)))) continue;
        size_t size = channel[i].size;
        uint8_t *to = pbs_column_get(column + i, p) + p->count * size;
        copy_field(to, size, from + at, r->stride, size, c->count);
    }
    p->count += c->count;
    return PBS_OK;
}
