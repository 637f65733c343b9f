/* visible.c: surfels seen from outside (paper 1, section 3.4): splat all, then ask for each. */
#include "libcore/gbuffer/visible.h"
#include "libcore/ground/pipe.h"
#include <stdlib.h>

/* Discs are pushed back by their radius and this many pixels before they hide anything. */
#define PUSH 1.5
/* Discs of the covering radius overlap. Drawn with this share of it they still leave hardly a gap,
 * and what lies deep behind a slit of a few pixels is not hidden by the slit's own edges: a hole in
 * the candidates is worse than some that nobody sees. */
#define HIDING 0.7
/* How far from the middle of a pixel a point of it is, at most. */
#define CENTRED 0.05f
/* A smooth normal may lean this far away from a view that sees its surface. */
#define LEAN 0.1
/* Discs seen at a steeper angle than this cosine are drawn as if at this one. */
#define STEEP 0.25

/* Discs with a larger radius in pixels are drawn row by row of their ellipse's box. */
#define LARGE 4

enum { BLOCK = 1024 }; /* surfels placed at a time */

/* Surfels in the frame of the views, a block at a time: all pairs use them. */
typedef struct block {
    size_t count;
    double p[3][BLOCK];
    float n[3][BLOCK]; /* unit length; 0: faces every viewer */
} block;

struct pbs_visible {
    pbs_run *run;
    pbs_views views;
    size_t first[PBS_GBUFFER_MAX_PAIRS + 1]; /* pixel where a pair begins */
    float *depth;                            /* near and far of each pixel, in pixels */
    size_t room;
    uint8_t *seen; /* of the surfels of one cloud */
    size_t seen_room;
    block *blocks; /* one a thread */
    size_t blocks_room;
};

pbs_code pbs_visible_new(pbs_run *run, pbs_visible **out, pbs_err *err) {
    if (!(*out = calloc(1, sizeof **out))) return pbs_fail(err, PBS_LIMIT, "no memory");
    (*out)->run = run;
    return PBS_OK;
}

void pbs_visible_free(pbs_visible *v) {
    if (!v) return;
    pbs_free(v->run, v->depth);
    pbs_free(v->run, v->seen);
    pbs_free(v->run, v->blocks);
    free(v);
}

static size_t pixels_of(const pbs_pair *p) {
    return (size_t)p->width * p->height;
}

size_t pbs_visible_need(const pbs_views *views) {
    size_t n = 0;
    for (int i = 0; i < views->pairs; i++) n += pixels_of(&views->pair[i]);
    return 2 * n * sizeof(float);
}

/* The number of threads may change from call to call. */
static pbs_code take_blocks(pbs_visible *v, pbs_err *err) {
    return pbs_grow(v->run, &v->blocks, &v->blocks_room, (size_t)v->run->threads, sizeof(block),
                    "placed surfels", err);
}

pbs_code pbs_visible_begin(pbs_visible *v, const pbs_views *views, pbs_err *err) {
    size_t need = pbs_visible_need(views) / sizeof(float);
    v->views = *views;
    if (need > v->room) {
        pbs_free(v->run, v->depth);
        v->depth = NULL;
        v->room = 0;
        pbs_code rc = pbs_alloc(v->run, &v->depth, need, sizeof(float), "depth buffers", err);
        if (rc) return rc;
        v->room = need;
    }
    for (int i = 0; i < views->pairs; i++)
        v->first[i + 1] = v->first[i] + pixels_of(&views->pair[i]);
    for (size_t i = 0; i < need; i += 2) v->depth[i] = -INFINITY, v->depth[i + 1] = INFINITY;
    return PBS_OK;
}

/* ---- surfels, placed and projected ---- */

/* How a cloud gets there. */
typedef struct placer {
    const pbs_cloud *cloud;
    float normal[9]; /* cofactors, largest 1 */
} placer;

static placer placer_of(const pbs_cloud *cloud) {
    placer p = {.cloud = cloud};
    double cofactor[9], most = 0;
    pbs_xform_cofactor(cofactor, cloud->m);
    for (int i = 0; i < 9; i++) most = fmax(most, fabs(cofactor[i]));
    if (!(most > 0) || !isfinite(most)) return p;
    if (pbs_xform_det(cloud->m) < 0) most = -most;
    for (int i = 0; i < 9; i++) p.normal[i] = (float)(cofactor[i] / most);
    return p;
}

static void place_normal(const placer *p, size_t i, float out[3]) {
    const float *m = p->normal;
    float n[3], l = 0;
    pbs_oct_decode(n, p->cloud->points->normal + 2 * i);
    for (int r = 0; r < 3; r++) {
        out[r] = m[3 * r] * n[0] + m[3 * r + 1] * n[1] + m[3 * r + 2] * n[2];
        l += out[r] * out[r];
    }
    l = l > 0 ? 1 / sqrtf(l) : 0;
    for (int r = 0; r < 3; r++) out[r] = l < INFINITY ? out[r] * l : 0;
}

static void place_point(const placer *p, size_t i, double out[3]) {
    const float *f = p->cloud->points->position + 3 * i;
    double v[3] = {f[0], f[1], f[2]};
    pbs_xform_point(out, p->cloud->m, v);
}

/* Surfels `first` on, at most BLOCK. */
static void fill_block(const placer *p, size_t first, block *b) {
    size_t left = p->cloud->count - first;
    b->count = left < BLOCK ? left : BLOCK;
    for (size_t i = 0; i < b->count; i++) {
        double at[3];
        float n[3] = {0, 0, 0};
        place_point(p, first + i, at);
        if (p->cloud->points->normal) place_normal(p, first + i, n);
        for (int k = 0; k < 3; k++) b->p[k][i] = at[k], b->n[k][i] = n[k];
    }
}

/* A pair, and how large a cloud's discs are there: x and y in pixels from the lower left corner, z
 * in pixels towards the viewer of the even view. */
typedef struct aim {
    double m[12];
    float axis[9];
    float radius; /* pixels */
    int32_t width, height;
} aim;

static aim aim_at(const pbs_pair *pair, const pbs_cloud *cloud) {
    const double *axis[3] = {pair->right, pair->up, pair->toward};
    aim a = {.radius = (float)(HIDING * cloud->radius / pair->pixel),
             .width = (int32_t)pair->width,
             .height = (int32_t)pair->height};
    a.m[3] = pair->width / 2.0, a.m[7] = pair->height / 2.0;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            a.axis[3 * r + c] = (float)axis[r][c];
            a.m[4 * r + c] = axis[r][c] / pair->pixel;
            a.m[4 * r + 3] -= a.m[4 * r + c] * pair->centre[c];
        }
    return a;
}

typedef struct spot {
    float x, y, z;
    float n[3];
} spot;

/* False if the surfel is not in the picture. */
static bool project(const aim *a, const block *b, size_t i, spot *s) {
    double p[3] = {b->p[0][i], b->p[1][i], b->p[2][i]};
    pbs_xform_point(p, a->m, p);
    s->x = (float)p[0], s->y = (float)p[1], s->z = (float)p[2];
    return s->x >= 0 && s->x < (float)a->width && s->y >= 0 && s->y < (float)a->height &&
           isfinite(s->z);
}

static void face(const aim *a, const block *b, size_t i, spot *s) {
    float n[3] = {b->n[0][i], b->n[1][i], b->n[2][i]};
    for (int r = 0; r < 3; r++)
        s->n[r] = a->axis[3 * r] * n[0] + a->axis[3 * r + 1] * n[1] + a->axis[3 * r + 2] * n[2];
    if (n[0] == 0 && n[1] == 0 && n[2] == 0) s->n[2] = 1;
}

/* ---- splatting ---- */

static void put(float *depth, float z, float push) {
    if (z - push > depth[0]) depth[0] = z - push;
    if (z + push < depth[1]) depth[1] = z + push;
}

static int32_t clamp(float v, int32_t most) {
    return v > 0 ? (v < (float)most ? (int32_t)v : most) : 0;
}

static void put_disc(const aim *a, float *depth, const spot *s) {
    float r = a->radius, push = r + (float)PUSH, wide = r, high = r;
    float nz = fabsf(s->n[2]) > (float)STEEP ? s->n[2] : copysignf((float)STEEP, s->n[2]);
    float gx = -s->n[0] / nz, gy = -s->n[1] / nz;
    if (r > LARGE) { /* for the others, the ellipse's own size costs more than it saves */
        float g = 1 + gx * gx + gy * gy;
        wide = r * sqrtf((1 + gy * gy) / g), high = r * sqrtf((1 + gx * gx) / g);
    }
    int32_t x0 = clamp(s->x - wide, a->width - 1), x1 = clamp(s->x + wide, a->width - 1);
    int32_t y0 = clamp(s->y - high, a->height - 1), y1 = clamp(s->y + high, a->height - 1);
    for (int32_t y = y0; y <= y1; y++)
        for (int32_t x = x0; x <= x1; x++) {
            float dx = (float)x + 0.5f - s->x, dy = (float)y + 0.5f - s->y;
            float dz = gx * dx + gy * dy;
            if (dx * dx + dy * dy + dz * dz > r * r) continue;
            put(depth + 2 * ((size_t)y * (size_t)a->width + (size_t)x), s->z + dz, push);
        }
}

/* A point without a size that was seen in a pixel lies in its middle. In other views it lies
 * anywhere, and would close slits there as wide as a pixel. */
static bool is_centred(const spot *s) {
    return fabsf(s->x - floorf(s->x) - 0.5f) <= CENTRED &&
           fabsf(s->y - floorf(s->y) - 0.5f) <= CENTRED;
}

static pbs_code splat_block(const pbs_run *run, const aim *a, const block *b, float *depth,
                            pbs_err *err) {
    for (size_t i = 0; i < b->count; i++) {
        spot s;
        if (!project(a, b, i, &s)) continue;
        if (a->radius == 0 && !is_centred(&s)) continue;
        put(depth + 2 * ((size_t)s.y * (size_t)a->width + (size_t)s.x), s.z,
            a->radius + (float)PUSH);
        if (a->radius <= 0.5f) continue;
        face(a, b, i, &s);
        put_disc(a, depth, &s);
    }
    return pbs_run_check(run, err); /* discs may be as large as the picture */
}

typedef struct splatting {
    pbs_visible *v;
    const pbs_cloud *clouds;
    size_t count, shares;
} splatting;

/* A share is every so manieth pair: a thread places surfels once for all its pairs. */
static pbs_code splat_share(void *ctx, size_t share, int thread, pbs_err *err) {
    splatting *s = ctx;
    pbs_visible *v = s->v;
    block *b = &v->blocks[thread];
    pbs_code rc = PBS_OK;
    for (size_t k = 0; k < s->count && !rc; k++) {
        placer p = placer_of(&s->clouds[k]);
        for (size_t first = 0; first < s->clouds[k].count && !rc; first += BLOCK) {
            fill_block(&p, first, b);
            for (size_t i = share; i < (size_t)v->views.pairs && !rc; i += s->shares) {
                aim a = aim_at(&v->views.pair[i], &s->clouds[k]);
                rc = splat_block(v->run, &a, b, v->depth + 2 * v->first[i], err);
            }
        }
    }
    return rc;
}

pbs_code pbs_visible_splat(pbs_visible *v, const pbs_cloud *clouds, size_t count, pbs_err *err) {
    size_t pairs = (size_t)v->views.pairs, threads = (size_t)v->run->threads;
    splatting s = {v, clouds, count, threads < pairs ? threads : pairs};
    pbs_code rc = take_blocks(v, err);
    return rc ? rc : pbs_parallel(v->run, s.shares, splat_share, &s, err);
}

/* ---- asking ---- */

typedef struct asking {
    pbs_visible *v;
    const pbs_cloud *cloud;
    placer placer;
    aim aim[PBS_GBUFFER_MAX_PAIRS];
} asking;

static bool in_front(const asking *q, int pair, const block *b, size_t i) {
    const aim *a = &q->aim[pair];
    spot s;
    if (!project(a, b, i, &s)) return false;
    const float *depth =
        q->v->depth + 2 * (q->v->first[pair] + (size_t)s.y * (size_t)a->width + (size_t)s.x);
    bool near = s.z >= depth[0], far = s.z <= depth[1];
    if (!near && !far) return false;
    if (!q->cloud->points->normal) return true;
    face(a, b, i, &s);
    return (near && s.n[2] >= (float)-LEAN) || (far && s.n[2] <= (float)LEAN);
}

static pbs_code ask_block(void *ctx, size_t number, int thread, pbs_err *err) {
    asking *q = ctx;
    block *b = &q->v->blocks[thread];
    uint8_t *seen = q->v->seen + number * BLOCK;
    fill_block(&q->placer, number * BLOCK, b);
    for (size_t i = 0; i < b->count; i++) {
        seen[i] = false;
        for (int k = 0; k < q->v->views.pairs && !seen[i]; k++) seen[i] = in_front(q, k, b, i);
    }
    return pbs_run_check(q->v->run, err);
}

static void append(const placer *place, size_t i, pbs_points *out) {
    const pbs_points *in = place->cloud->points;
    size_t to = out->count++;
    double p[3];
    place_point(place, i, p);
    for (int k = 0; k < 3; k++) out->position[3 * to + (size_t)k] = (float)p[k];
    if (out->normal && in->normal) {
        float n[3];
        place_normal(place, i, n);
        pbs_oct_encode(out->normal + 2 * to, n);
    }
    if (out->colour && in->colour) memcpy(out->colour + 4 * to, in->colour + 4 * i, 4);
    if (out->material && in->material) memcpy(out->material + 4 * to, in->material + 4 * i, 4);
    if (out->emissive && in->emissive) memcpy(out->emissive + 4 * to, in->emissive + 4 * i, 4);
}

pbs_code pbs_visible_take(pbs_visible *v, const pbs_cloud *cloud, pbs_points *out, pbs_err *err) {
    asking q = {.v = v, .cloud = cloud, .placer = placer_of(cloud)};
    pbs_code rc = pbs_grow(v->run, &v->seen, &v->seen_room, cloud->count, 1, "marks", err);
    if (!rc) rc = take_blocks(v, err);
    if (rc) return rc;
    for (int k = 0; k < v->views.pairs; k++) q.aim[k] = aim_at(&v->views.pair[k], cloud);
    rc = pbs_parallel(v->run, (cloud->count + BLOCK - 1) / BLOCK, ask_block, &q, err);
    for (size_t i = 0; i < cloud->count && !rc; i++)
        if (v->seen[i]) append(&q.placer, i, out);
    return rc;
}
