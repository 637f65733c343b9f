/* LAS 1.0 to 1.4, point formats 0 to 10: positions and colours; everything else is skipped. The
 * box in the header is a hint, and is not trusted. */
#include "formats/readers/cloud.h"
#include "formats/container/wire.h"
#include <math.h>

enum {
    MINOR_AT = 25,
    HEADER_BYTES_AT = 94,
    POINTS_AT = 96,
    FORMAT_AT = 104,
    STRIDE_AT = 105,
    COUNT_AT = 107,
    SCALE_AT = 131,
    OFFSET_AT = 155,
    BOX_AT = 179, /* largest and least x, then y, then z */
    HEADER = 227,
    COUNT64_AT = 247, /* from 1.4 on */
    HEADER_14 = 375,
    PACKED = 0xc0 /* bits of the format that LAZ sets */
};

/* Bytes of a record at least, and where its red is; 0: it has no colours. */
static const struct {
    uint8_t least, red;
} format[] = {{20, 0}, {28, 0},  {26, 20}, {34, 28}, {57, 0}, {63, 28},
              {30, 0}, {36, 30}, {38, 30}, {59, 0},  {67, 30}};

static void decode(const pbs_cloud *c, const uint8_t *p, size_t n, double (*value)[3],
                   uint16_t (*colour)[3]) {
    const size_t stride = c->stride, red = c->at[3];
    for (size_t i = 0; i < n; i++, p += stride) {
        int32_t q[3];
        memcpy(q, p, sizeof q);
        value[i][0] = q[0], value[i][1] = q[1], value[i][2] = q[2];
        if (colour) memcpy(colour[i], p + red, sizeof *colour);
    }
}

static pbs_code check_count(const pbs_cloud *c, uint64_t at, pbs_err *err) {
    uint64_t there = at < c->in.size ? (c->in.size - at) / c->stride : 0;
    if (c->count <= there) return PBS_OK;
    return pbs_fail(err, PBS_DATA,
                    "cut off: the header says %llu points, and %llu of them are there",
                    (unsigned long long)c->count, (unsigned long long)there);
}

static void read_box(pbs_cloud *c) {
    const uint8_t *h = (const uint8_t *)c->in.bytes + BOX_AT;
    bool fits = true;
    for (int k = 0; k < 3; k++) {
        double a = (pbs_get_f64(h + 16 * k + 8) - c->offset[k]) / c->scale[k],
               b = (pbs_get_f64(h + 16 * k) - c->offset[k]) / c->scale[k];
        c->said_low[k] = floor(fmin(a, b) + 0.5), c->said_high[k] = floor(fmax(a, b) + 0.5);
        fits = fits && c->said_low[k] >= INT32_MIN && c->said_high[k] <= INT32_MAX;
    }
    if (!fits) c->said_low[0] = 1, c->said_high[0] = 0;
}

pbs_code pbs_cloud_las(pbs_cloud *c, pbs_err *err) {
    const uint8_t *h = c->in.bytes;
    if (c->in.size < HEADER) return pbs_fail(err, PBS_DATA, "cut off in the header");
    uint32_t header = pbs_get_u16(h + HEADER_BYTES_AT), at = pbs_get_u32(h + POINTS_AT);
    uint8_t kind = h[FORMAT_AT], minor = h[MINOR_AT];
    if (kind & PACKED)
        return pbs_fail(err, PBS_DATA,
                        "LAZ is not read: unpack it to LAS (laszip, las2las, or pdal translate)");
    if (h[MINOR_AT - 1] != 1 || minor > 4 || kind >= sizeof format / sizeof format[0])
        return pbs_fail(err, PBS_DATA, "LAS %u.%u with points of format %u is not read",
                        h[MINOR_AT - 1], minor, kind);
    c->stride = pbs_get_u16(h + STRIDE_AT);
    if (header < HEADER || at < header || c->stride < format[kind].least)
        return pbs_fail(err, PBS_DATA,
                        "the header is damaged: %u bytes of it, points at %u, %zu "
                        "bytes each",
                        header, at, c->stride);
    c->count = pbs_get_u32(h + COUNT_AT);
    if (minor >= 4 && header >= HEADER_14 && c->in.size >= HEADER_14 && pbs_get_u64(h + COUNT64_AT))
        c->count = pbs_get_u64(h + COUNT64_AT);
    for (int k = 0; k < 3; k++) {
        c->scale[k] = pbs_get_f64(h + SCALE_AT + 8 * k);
        c->offset[k] = pbs_get_f64(h + OFFSET_AT + 8 * k);
        if (!(fabs(c->scale[k]) > 0) || !isfinite(c->scale[k]))
            return pbs_fail(err, PBS_DATA, "the scale of the coordinates is %g", c->scale[k]);
    }
    read_box(c);
    c->lattice = true;
    c->colour = format[kind].red ? PBS_CLOUD_COLOUR_ANY : PBS_CLOUD_NO_COLOUR;
    c->at[3] = format[kind].red;
    c->first = h + at;
    c->decode = decode;
    return check_count(c, at, err);
}
