#include "libcore/data/texture.h"

/* Level sizes halve, rounded down; returns the bytes of all but the first. */
static size_t shape(pbs_texture *t, const pbs_image *image) {
    size_t bytes = 0;
    uint32_t w = image->width, h = image->height;
    t->levels = 0;
    if (!image->rgba || !w || !h) return 0;
    for (;;) {
        t->width[t->levels] = w, t->height[t->levels] = h;
        if (t->levels++) bytes += (size_t)4 * w * h;
        if (w == 1 && h == 1) return bytes;
        w = w > 1 ? w / 2 : 1, h = h > 1 ? h / 2 : 1;
    }
}

size_t pbs_texture_need(const pbs_image *image) {
    pbs_texture t;
    size_t bytes = shape(&t, image);
    return bytes ? bytes + 128 : 0;
}

/* Which texels of a row of n the texel i of the halved row covers, and with what share: two for
 * even n; for odd n three, of which the outer ones are shared with the neighbours. */
static void taps(uint32_t n, uint32_t i, uint32_t at[3], float share[3]) {
    for (uint32_t k = 0; k < 3; k++) at[k] = 2 * i + k < n ? 2 * i + k : n - 1;
    float m = (float)(n / 2), whole = (float)n;
    bool odd = n & 1;
    share[0] = n == 1 ? 1 : odd ? (m - (float)i) / whole : 0.5f;
    share[1] = n == 1 ? 0 : odd ? m / whole : 0.5f;
    share[2] = n == 1 || !odd ? 0 : ((float)i + 1) / whole;
}

static void average(const pbs_srgb_table *s, const float *rgb, const uint8_t *src, uint32_t w,
                    const uint32_t x[3], const uint32_t y[3], const float sx[3], const float sy[3],
                    float out[4]) {
    for (int k = 0; k < 4; k++) out[k] = 0;
    for (int j = 0; j < 3; j++)
        for (int i = 0; i < 3; i++) {
            float share = sx[i] * sy[j];
            if (share == 0) continue;
            const uint8_t *p = src + 4 * ((size_t)y[j] * w + x[i]);
            for (int k = 0; k < 3; k++) out[k] += share * rgb[p[k]];
            out[3] += share * s->unorm[p[3]];
        }
}

static void halve(const pbs_texture *t, int from, uint8_t *to) {
    const pbs_srgb_table *s = t->table;
    const float *rgb = t->srgb ? s->linear : s->unorm;
    uint32_t w = t->width[from], h = t->height[from];
    for (uint32_t y = 0; y < t->height[from + 1]; y++) {
        uint32_t ay[3], ax[3];
        float sy[3], sx[3], v[4];
        taps(h, y, ay, sy);
        for (uint32_t x = 0; x < t->width[from + 1]; x++, to += 4) {
            taps(w, x, ax, sx);
            average(s, rgb, t->level[from], w, ax, ay, sx, sy, v);
            for (int k = 0; k < 3; k++)
                to[k] = t->srgb ? pbs_srgb_encode(s, v[k]) : pbs_unorm8(v[k]);
            to[3] = pbs_unorm8(v[3]);
        }
    }
}

pbs_code pbs_texture_build(pbs_run *run, const pbs_image *image, bool srgb, pbs_texture *out,
                           pbs_err *err) {
    memset(out, 0, sizeof *out);
    size_t bytes = shape(out, image);
    out->srgb = srgb;
    out->table = pbs_srgb();
    if (!out->levels) return PBS_OK;
    out->level[0] = image->rgba;
    if (!bytes) return PBS_OK;
    pbs_code rc = pbs_alloc(run, &out->own, bytes, 1, "the smaller sizes of a texture", err);
    if (rc) {
        out->levels = 0;
        return rc;
    }
    uint8_t *to = out->own;
    for (int l = 1; l < out->levels; l++) {
        halve(out, l - 1, to);
        out->level[l] = to;
        to += (size_t)4 * out->width[l] * out->height[l];
    }
    return PBS_OK;
}

void pbs_texture_free(pbs_run *run, pbs_texture *texture) {
    pbs_free(run, texture->own);
    memset(texture, 0, sizeof *texture);
}

/* ---- look-up ---- */

static uint32_t wrap(int64_t i, uint32_t n, uint8_t mode) {
    int64_t m = (int64_t)n;
    if (mode == 1) return (uint32_t)(i < 0 ? 0 : i >= m ? m - 1 : i);
    int64_t period = mode == 2 ? 2 * m : m;
    i %= period;
    i = i < 0 ? i + period : i;
    return (uint32_t)(i < m ? i : 2 * m - 1 - i);
}

/* The two texels beside u (0 .. 1 is the picture) and the share of the second. Far coordinates
 * are brought near first: they must not overflow, and have no fraction left anyway. */
static void neighbours(double u, uint32_t n, uint8_t mode, uint32_t at[2], float *share) {
    if (!(fabs(u) < 1e9)) u = 0;
    double x = u * n - 0.5, f = floor(x);
    at[0] = wrap((int64_t)f, n, mode);
    at[1] = wrap((int64_t)f + 1, n, mode);
    *share = (float)(x - f);
}

static void bilinear(const pbs_texture *t, int l, const pbs_texture_use *use, double u, double v,
                     float out[4]) {
    const pbs_srgb_table *s = t->table;
    const float *rgb = t->srgb ? s->linear : s->unorm;
    uint32_t x[2], y[2];
    float fx, fy;
    neighbours(u, t->width[l], use->wrap_u, x, &fx);
    neighbours(v, t->height[l], use->wrap_v, y, &fy);
    const uint8_t *r0 = t->level[l] + (size_t)4 * t->width[l] * y[0];
    const uint8_t *r1 = t->level[l] + (size_t)4 * t->width[l] * y[1];
    const uint8_t *a = r0 + (size_t)4 * x[0], *b = r0 + (size_t)4 * x[1];
    const uint8_t *c = r1 + (size_t)4 * x[0], *d = r1 + (size_t)4 * x[1];
    float wa = (1 - fx) * (1 - fy), wb = fx * (1 - fy), wc = (1 - fx) * fy, wd = fx * fy;
    for (int k = 0; k < 4; k++) {
        const float *lut = k < 3 ? rgb : s->unorm;
        out[k] = wa * lut[a[k]] + wb * lut[b[k]] + wc * lut[c[k]] + wd * lut[d[k]];
    }
}

/* log2 of the side of a pixel's footprint in texels, linear between whole levels: cheap, and the
 * same bits on every machine. */
static float level_of(const pbs_texture *t, const double jx[2], const double jy[2]) {
    double w = t->width[0], h = t->height[0];
    double x = jx[0] * w * (jx[0] * w) + jx[1] * h * (jx[1] * h);
    double y = jy[0] * w * (jy[0] * w) + jy[1] * h * (jy[1] * h);
    double side = sqrt(x > y ? x : y);
    int e, top = t->levels - 1;
    if (!(side < 1e9) || !(x < INFINITY)) return (float)top;
    if (side <= 1) return 0;
    float l = (float)(2 * frexp(side, &e) - 1);
    l += (float)(e - 1);
    return l < (float)top ? l : (float)top;
}

static void turn(const float m[6], const double v[2], double out[2]) {
    out[0] = m[0] * v[0] + m[1] * v[1];
    out[1] = m[3] * v[0] + m[4] * v[1];
}

void pbs_texture_sample(const pbs_texture *t, const pbs_texture_use *use, const double uv[2],
                        const double dx[2], const double dy[2], float out[4]) {
    for (int k = 0; k < 4; k++) out[k] = 1;
    if (!t->levels) return;
    double at[2], jx[2], jy[2];
    turn(use->transform, uv, at);
    turn(use->transform, dx, jx);
    turn(use->transform, dy, jy);
    at[0] += use->transform[2], at[1] += use->transform[5];
    float l = level_of(t, jx, jy);
    int below = (int)l;
    float f = l - (float)below, more[4];
    bilinear(t, below, use, at[0], at[1], out);
    if (f == 0) return;
    bilinear(t, below + 1, use, at[0], at[1], more);
    for (int k = 0; k < 4; k++) out[k] += f * (more[k] - out[k]);
}
