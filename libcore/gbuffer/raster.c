/* raster.c: the portable rasteriser, the row solver for large triangles, and the choice between
 * them and raster_avx2.c (paper 1, section 3.1).
 */
#include "libcore/gbuffer/raster_inner.h"

#define LIMIT ((double)(1 << 29))

void pbs_pair_project(double out[12], const pbs_pair *pair, const double m[12]) {
    double scale = PBS_SUBPIXELS / pair->pixel;
    double deep = pair->depth > 0 ? -1 / pair->depth : 0;
    double row[3][3];
    for (int k = 0; k < 3; k++) {
        row[0][k] = pair->right[k] * scale;
        row[1][k] = pair->up[k] * scale;
        row[2][k] = pair->toward[k] * deep;
    }
    /* The centre is taken off before anything is multiplied: a scene far from its origin loses
     * nothing, and a moved scene gives the same numbers. */
    double t[3] = {m[3] - pair->centre[0], m[7] - pair->centre[1], m[11] - pair->centre[2]};
    double middle[3] = {PBS_SUBPIXELS / 2 * (double)pair->width,
                        PBS_SUBPIXELS / 2 * (double)pair->height, 0.5};
    for (int r = 0; r < 3; r++) {
        for (int c = 0; c < 3; c++)
            out[4 * r + c] = row[r][0] * m[c] + row[r][1] * m[4 + c] + row[r][2] * m[8 + c];
        out[4 * r + 3] = row[r][0] * t[0] + row[r][1] * t[1] + row[r][2] * t[2] + middle[r];
    }
}

bool pbs_raster_simd(void) {
#ifdef PBS_RASTER_AVX2
    return __builtin_cpu_supports("avx2");
#else
    return false;
#endif
}

void pbs_raster_clear(pbs_raster *r) {
    memset(r->key, 0x7f, ((size_t)(r->y1 - r->y0) * r->width * 2 + PBS_KEY_PAD) * sizeof *r->key);
}

/* NaN becomes hi, as the vector instruction has it. */
static double clamp(double v, double lo, double hi) {
    v = v < hi ? v : hi;
    return v > lo ? v : lo;
}

static void snap_one(const double m[12], const float *p, pbs_snapped *o) {
    double x = p[0], y = p[1], z = p[2], s[3];
    for (int r = 0; r < 3; r++)
        s[r] = ((m[4 * r] * x + m[4 * r + 1] * y) + m[4 * r + 2] * z) + m[4 * r + 3];
    double none = (s[0] - s[0]) + (s[1] - s[1]) + (s[2] - s[2]); /* 0, or NaN */
    o->x = (int32_t)lrint(clamp(s[0], -LIMIT, LIMIT));
    o->y = (int32_t)lrint(clamp(s[1], -LIMIT, LIMIT));
    o->z = (float)clamp(s[2], 0, 1);
    o->bad = none == 0 ? 0 : -1;
}

static void box_add(int32_t box[4], const pbs_snapped *o) {
    box[0] = o->x < box[0] ? o->x : box[0];
    box[1] = o->y < box[1] ? o->y : box[1];
    box[2] = o->x > box[2] ? o->x : box[2];
    box[3] = o->y > box[3] ? o->y : box[3];
}

bool pbs_raster_snap(const double m[12], const float *position, uint32_t n, bool simd,
                     pbs_snapped *out, int32_t box[4]) {
    int32_t bad = 0;
    uint32_t i = 0;
    box[0] = box[1] = 1 << 29;
    box[2] = box[3] = -(1 << 29);
#ifdef PBS_RASTER_AVX2
    if (simd && n >= 4) {
        i = n & ~3u;
        pbs_raster_snap_avx2(m, position, i, out, box, &bad);
    }
#else
    (void)simd;
#endif
    for (; i < n; i++) {
        snap_one(m, position + 3 * (size_t)i, out + i);
        bad |= out[i].bad;
        box_add(box, out + i);
    }
    return bad == 0;
}

/* Which pixels' centres a snapped box holds, cut to the band; false: none. */
static bool cover(const pbs_raster *r, const int32_t box[4], int32_t px[4]) {
    int32_t x0 = (box[0] + 127) >> 8, y0 = (box[1] + 127) >> 8;
    int32_t x1 = (box[2] - 128) >> 8, y1 = (box[3] - 128) >> 8;
    px[0] = x0 > 0 ? x0 : 0;
    px[1] = y0 > (int32_t)r->y0 ? y0 : (int32_t)r->y0;
    px[2] = x1 < (int32_t)r->width - 1 ? x1 : (int32_t)r->width - 1;
    px[3] = y1 < (int32_t)r->y1 - 1 ? y1 : (int32_t)r->y1 - 1;
    return px[0] <= px[2] && px[1] <= px[3];
}

bool pbs_raster_sees(const pbs_raster *r, const int32_t box[4]) {
    int32_t px[4];
    return cover(r, box, px);
}

static void box_of(const pbs_snapped *const v[3], int32_t box[4]) {
    box[0] = box[2] = v[0]->x;
    box[1] = box[3] = v[0]->y;
    box_add(box, v[1]);
    box_add(box, v[2]);
}

static void depth_range(pbs_raster_plane *p, const pbs_snapped *const v[3]) {
    float a = v[0]->z, b = v[1]->z, c = v[2]->z;
    p->x0 = v[0]->x, p->y0 = v[0]->y;
    p->z0 = a;
    p->lo = b < c ? b : c, p->lo = a < p->lo ? a : p->lo;
    p->hi = b > c ? b : c, p->hi = a > p->hi ? a : p->hi;
}

/* An edge is inside where e >= 0; e counts pixels, not 1/256 of them: only its sign is asked for,
 * all centres are whole pixels apart, and a floor keeps the sign. An edge that does not own the
 * centres on it is moved by the smallest step. */
static int64_t edge_start(int64_t ex, int64_t ey, int64_t dx, int64_t dy) {
    bool owns = ey < 0 || (ey == 0 && ex > 0);
    return (ex * dy - ey * dx - (owns ? 0 : 1)) >> 8;
}

/* As raster_avx2.c has it, in plain C. */
static void draw_small(pbs_raster *r, const pbs_snapped *const v[3], const int32_t px[4],
                       uint32_t id) {
    int32_t ex[3], ey[3], e[3], area = 0;
    int32_t cx = px[0] * PBS_SUBPIXELS + 128, cy = px[1] * PBS_SUBPIXELS + 128;
    for (int i = 0; i < 3; i++) {
        const pbs_snapped *a = v[i], *b = v[(i + 1) % 3];
        ex[i] = b->x - a->x, ey[i] = b->y - a->y;
        area += ex[i] * (cy - a->y) - ey[i] * (cx - a->x);
    }
    if (area == 0) return;
    pbs_raster_plane p;
    depth_range(&p, v);
    float inv = 1 / (float)area, d1 = v[1]->z - p.z0, d2 = v[2]->z - p.z0;
    /* The third edge runs back to the first corner, so its vector is minus (x20, y20). */
    p.gx = (d2 * -(float)ey[0] - d1 * (float)ey[2]) * inv;
    p.gy = (d2 * (float)ex[0] - d1 * -(float)ex[2]) * inv;
    for (int i = 0; i < 3; i++) {
        if (area < 0) ex[i] = -ex[i], ey[i] = -ey[i];
        e[i] = (int32_t)edge_start(ex[i], ey[i], cx - v[i]->x, cy - v[i]->y);
    }
    for (int32_t y = px[1]; y <= px[3]; y++) {
        int32_t a = e[0], b = e[1], c = e[2];
        float row = pbs_raster_row_z(&p, y);
        uint64_t *key = pbs_raster_at(r, 0, y);
        for (int32_t x = px[0]; x <= px[2]; x++, a -= ey[0], b -= ey[1], c -= ey[2]) {
            if ((a | b | c) < 0) continue;
            pbs_raster_put(key + 2 * x, pbs_float_bits(pbs_raster_z(&p, row, x)), id);
            r->fragments++;
        }
        for (int i = 0; i < 3; i++) e[i] += ex[i];
    }
}

static int64_t floor_div(int64_t a, int64_t b) {
    return a / b - (a % b < 0);
} /* b > 0 */

/* Narrows x0 .. x1 to where e + x * step >= 0. */
static void narrow(int64_t e, int64_t step, int64_t *x0, int64_t *x1) {
    if (step > 0) {
        int64_t first = -floor_div(e, step);
        *x0 = first > *x0 ? first : *x0;
    } else if (step < 0) {
        int64_t last = floor_div(e, -step);
        *x1 = last < *x1 ? last : *x1;
    } else if (e < 0) {
        *x1 = *x0 - 1;
    }
}

static void large_plane(pbs_raster_plane *p, const pbs_snapped *const v[3], int64_t area) {
    depth_range(p, v);
    double x1 = (double)v[1]->x - v[0]->x, y1 = (double)v[1]->y - v[0]->y;
    double x2 = (double)v[2]->x - v[0]->x, y2 = (double)v[2]->y - v[0]->y;
    double d1 = (double)v[1]->z - v[0]->z, d2 = (double)v[2]->z - v[0]->z;
    p->gx = (float)((d1 * y2 - d2 * y1) / (double)area);
    p->gy = (float)((d2 * x1 - d1 * x2) / (double)area);
}

void pbs_raster_large(pbs_raster *r, const pbs_snapped *const v[3], uint32_t id,
                      pbs_raster_span span, void *ctx) {
    int32_t box[4], px[4];
    box_of(v, box);
    if (!cover(r, box, px)) return;
    int64_t ex[3], ey[3], e[3];
    for (int i = 0; i < 3; i++) {
        const pbs_snapped *a = v[i], *b = v[(i + 1) % 3];
        ex[i] = (int64_t)b->x - a->x, ey[i] = (int64_t)b->y - a->y;
    }
    int64_t area = ex[2] * ey[0] - ex[0] * ey[2];
    if (area == 0) return;
    pbs_raster_plane p;
    large_plane(&p, v, area);
    for (int i = 0; i < 3; i++) {
        if (area < 0) ex[i] = -ex[i], ey[i] = -ey[i];
        e[i] = edge_start(ex[i], ey[i], PBS_SUBPIXELS / 2 - (int64_t)v[i]->x,
                          px[1] * PBS_SUBPIXELS + PBS_SUBPIXELS / 2 - (int64_t)v[i]->y);
    }
    for (int32_t y = px[1]; y <= px[3]; y++) {
        int64_t x0 = px[0], x1 = px[2];
        for (int i = 0; i < 3; i++) {
            narrow(e[i], -ey[i], &x0, &x1);
            e[i] += ex[i];
        }
        if (x0 <= x1) span(r, &p, (int32_t)x0, (int32_t)x1, y, id, ctx);
    }
}

static void plain_span(pbs_raster *r, const pbs_raster_plane *p, int32_t x0, int32_t x1, int32_t y,
                       uint32_t id, void *ctx) {
    (void)ctx;
    float row = pbs_raster_row_z(p, y);
    uint64_t *key = pbs_raster_at(r, 0, y);
    for (int32_t x = x0; x <= x1; x++)
        pbs_raster_put(key + 2 * x, pbs_float_bits(pbs_raster_z(p, row, x)), id);
    r->fragments += (uint64_t)(x1 - x0 + 1);
}

static void draw_one(pbs_raster *r, const pbs_snapped *const v[3], uint32_t id) {
    int32_t box[4], px[4];
    box_of(v, box);
    if (!cover(r, box, px)) return;
    if (box[2] - box[0] < PBS_RASTER_SMALL && box[3] - box[1] < PBS_RASTER_SMALL)
        draw_small(r, v, px, id);
    else
        pbs_raster_large(r, v, id, plain_span, NULL);
}

void pbs_raster_draw(pbs_raster *r, const pbs_snapped *v, const uint16_t *index, uint32_t count,
                     uint32_t first, bool finite) {
#ifdef PBS_RASTER_AVX2
    if (r->simd && finite) {
        pbs_raster_draw_avx2(r, v, index, count, first);
        return;
    }
#endif
    for (uint32_t i = 0; i < count; i++) {
        const uint16_t *t = index + 3 * (size_t)i;
        const pbs_snapped *c[3] = {v + t[0], v + t[1], v + t[2]};
        if (finite || !(c[0]->bad | c[1]->bad | c[2]->bad)) draw_one(r, c, first + i);
    }
}

typedef struct mask {
    bool (*keep)(void *ctx, uint32_t x, uint32_t y);
    void *ctx;
} mask;

static void masked_span(pbs_raster *r, const pbs_raster_plane *p, int32_t x0, int32_t x1, int32_t y,
                        uint32_t id, void *ctx) {
    const mask *m = ctx;
    float row = pbs_raster_row_z(p, y);
    for (int32_t x = x0; x <= x1; x++) {
        uint32_t bits = pbs_float_bits(pbs_raster_z(p, row, x));
        uint64_t *key = pbs_raster_at(r, x, y);
        r->fragments++;
        /* The depth test is cheap and the texture is not: a hidden fragment is not looked up. */
        uint64_t near = (uint64_t)bits << 32 | id,
                 far = (uint64_t)(PBS_RASTER_FAR - bits) << 32 | id;
        if (near >= key[0] && far >= key[1]) continue;
        if (m->keep(m->ctx, (uint32_t)x, (uint32_t)y)) pbs_raster_put(key, bits, id);
    }
}

void pbs_raster_draw_masked(pbs_raster *r, const pbs_snapped *v, const uint16_t index[3],
                            uint32_t id, bool (*keep)(void *ctx, uint32_t x, uint32_t y),
                            void *ctx) {
    const pbs_snapped *c[3] = {v + index[0], v + index[1], v + index[2]};
    mask m = {keep, ctx};
    if (!(c[0]->bad | c[1]->bad | c[2]->bad)) pbs_raster_large(r, c, id, masked_span, &m);
}
