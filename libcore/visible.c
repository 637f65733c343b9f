/* visible.c: surfels seen from outside (paper 1, section 3.4): splat all, then ask for each. */
#include "libcore/visible.h"
#include "libcore/pipe.h"
#include <stdlib.h>

/* Discs are pushed back by their radius and this many pixels before they hide anything. */
#define PUSH 1.5
/* Discs of the covering radius overlap. Drawn with this share of it they still leave hardly a gap,
 * and what lies deep behind a slit of a few pixels is not hidden by the slit's own edges: a hole in
 * the candidates is worse than some that nobody sees. */
#define HIDING 0.7
/* A smooth normal may lean this far away from a view that sees its surface. */
#define LEAN 0.1
/* Discs seen at a steeper angle than this cosine are drawn as if at this one. */
#define STEEP 0.25

enum { CHUNK = 1 << 14 }; /* surfels asked for at a time */

struct pbs_visible {
    pbs_run *run;
    pbs_views views;
    size_t first[PBS_GBUFFER_MAX_PAIRS + 1]; /* pixel where a pair begins */
    float *depth;                            /* near and far of each pixel, in pixels */
    size_t room;
    uint8_t *seen; /* of the surfels of one cloud */
    size_t seen_room;
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

/* ---- a cloud, projected ---- */

/* Takes a surfel to a pair: x and y in pixels from the lower left corner, z in pixels towards the
 * viewer of the even view. */
typedef struct aim {
    double m[12];
    double normal[9];
    double radius; /* pixels */
    const pbs_points *points;
    int32_t width, height;
} aim;

static void aim_at(aim *a, const pbs_pair *pair, const pbs_cloud *cloud) {
    const double *axis[3] = {pair->right, pair->up, pair->toward};
    double middle[3] = {pair->width / 2.0, pair->height / 2.0, 0}, view[12], cofactor[9];
    for (int r = 0; r < 3; r++) {
        view[4 * r + 3] = middle[r];
        for (int c = 0; c < 3; c++) {
            view[4 * r + c] = axis[r][c] / pair->pixel;
            view[4 * r + 3] -= axis[r][c] / pair->pixel * pair->centre[c];
        }
    }
    pbs_xform_mul(a->m, view, cloud->m);
    pbs_xform_cofactor(cofactor, cloud->m);
    double side = pbs_xform_det(cloud->m) < 0 ? -1 : 1;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            a->normal[3 * r + c] = 0;
            for (int k = 0; k < 3; k++)
                a->normal[3 * r + c] += side * axis[r][k] * cofactor[3 * k + c];
        }
    a->radius = HIDING * cloud->radius / pair->pixel;
    a->points = cloud->points;
    a->width = (int32_t)pair->width, a->height = (int32_t)pair->height;
}

typedef struct spot {
    float x, y, z;
    float n[3];
} spot;

static void turn(const double m[9], const int16_t oct[2], float out[3]) {
    float n[3];
    double v[3], l = 0;
    pbs_oct_decode(n, oct);
    for (int r = 0; r < 3; r++) {
        v[r] = m[3 * r] * n[0] + m[3 * r + 1] * n[1] + m[3 * r + 2] * n[2];
        l = fmax(l, fabs(v[r]));
    }
    out[0] = out[1] = 0, out[2] = 1;
    if (!(l > 0) || !(l < INFINITY)) return;
    for (int r = 0; r < 3; r++) v[r] /= l;
    l = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int r = 0; r < 3; r++) out[r] = (float)(v[r] / l);
}

/* False if the surfel is not in the picture. */
static bool project(const aim *a, size_t i, spot *s) {
    const float *f = a->points->position + 3 * i;
    double p[3] = {f[0], f[1], f[2]};
    pbs_xform_point(p, a->m, p);
    s->x = (float)p[0], s->y = (float)p[1], s->z = (float)p[2];
    return s->x >= 0 && s->x < (float)a->width && s->y >= 0 && s->y < (float)a->height &&
           isfinite(s->z);
}

static void face(const aim *a, size_t i, spot *s) {
    s->n[0] = s->n[1] = 0, s->n[2] = 1;
    if (a->points->normal) turn(a->normal, a->points->normal + 2 * i, s->n);
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
    float r = (float)a->radius, push = r + (float)PUSH;
    float nz = fabsf(s->n[2]) > (float)STEEP ? s->n[2] : copysignf((float)STEEP, s->n[2]);
    float gx = -s->n[0] / nz, gy = -s->n[1] / nz, g = 1 + gx * gx + gy * gy;
    float wide = r * sqrtf((1 + gy * gy) / g), high = r * sqrtf((1 + gx * gx) / g);
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

static pbs_code splat_cloud(const pbs_run *run, const aim *a, size_t count, float *depth,
                            pbs_err *err) {
    for (size_t i = 0; i < count; i++) {
        spot s;
        /* Discs may be as large as the picture. */
        pbs_code rc = i % 1024 ? PBS_OK : pbs_run_check(run, err);
        if (rc) return rc;
        if (!project(a, i, &s)) continue;
        size_t at = (size_t)s.y * (size_t)a->width + (size_t)s.x;
        put(depth + 2 * at, s.z, (float)(a->radius + PUSH));
        if (a->radius <= 0.5) continue;
        face(a, i, &s);
        put_disc(a, depth, &s);
    }
    return PBS_OK;
}

typedef struct splatting {
    pbs_visible *v;
    const pbs_cloud *clouds;
    size_t count;
} splatting;

static pbs_code splat_pair(void *ctx, size_t i, int thread, pbs_err *err) {
    splatting *s = ctx;
    (void)thread;
    pbs_code rc = PBS_OK;
    for (size_t k = 0; k < s->count && !rc; k++) {
        aim a;
        aim_at(&a, &s->v->views.pair[i], &s->clouds[k]);
        rc = splat_cloud(s->v->run, &a, s->clouds[k].count, s->v->depth + 2 * s->v->first[i], err);
    }
    return rc;
}

pbs_code pbs_visible_splat(pbs_visible *v, const pbs_cloud *clouds, size_t count, pbs_err *err) {
    splatting s = {v, clouds, count};
    return pbs_parallel(v->run, (size_t)v->views.pairs, splat_pair, &s, err);
}

/* ---- asking ---- */

typedef struct asking {
    pbs_visible *v;
    const pbs_cloud *cloud;
    aim aim[PBS_GBUFFER_MAX_PAIRS];
} asking;

static bool in_front(const asking *q, int pair, size_t i) {
    const aim *a = &q->aim[pair];
    spot s;
    if (!project(a, i, &s)) return false;
    const float *depth =
        q->v->depth + 2 * (q->v->first[pair] + (size_t)s.y * (size_t)a->width + (size_t)s.x);
    bool near = s.z >= depth[0], far = s.z <= depth[1];
    if (!near && !far) return false;
    if (!a->points->normal) return true;
    face(a, i, &s);
    return (near && s.n[2] >= (float)-LEAN) || (far && s.n[2] <= (float)LEAN);
}

static pbs_code ask_chunk(void *ctx, size_t chunk, int thread, pbs_err *err) {
    asking *q = ctx;
    size_t end = (chunk + 1) * CHUNK < q->cloud->count ? (chunk + 1) * CHUNK : q->cloud->count;
    (void)thread;
    for (size_t i = chunk * CHUNK; i < end; i++) {
        q->v->seen[i] = false;
        for (int k = 0; k < q->v->views.pairs && !q->v->seen[i]; k++)
            q->v->seen[i] = in_front(q, k, i);
    }
    return pbs_run_check(q->v->run, err);
}

/* Normals in the frame of the views: as for a pair whose axes are those of the frame. */
static void append(const pbs_cloud *cloud, size_t i, const aim *frame, pbs_points *out) {
    const pbs_points *in = cloud->points;
    size_t to = out->count++;
    double p[3] = {in->position[3 * i], in->position[3 * i + 1], in->position[3 * i + 2]};
    pbs_xform_point(p, cloud->m, p);
    for (int k = 0; k < 3; k++) out->position[3 * to + (size_t)k] = (float)p[k];
    if (out->normal && in->normal) {
        float n[3];
        turn(frame->normal, in->normal + 2 * i, n);
        pbs_oct_encode(out->normal + 2 * to, n);
    }
    if (out->colour && in->colour) memcpy(out->colour + 4 * to, in->colour + 4 * i, 4);
    if (out->material && in->material) memcpy(out->material + 4 * to, in->material + 4 * i, 4);
    if (out->emissive && in->emissive) memcpy(out->emissive + 4 * to, in->emissive + 4 * i, 4);
}

pbs_code pbs_visible_take(pbs_visible *v, const pbs_cloud *cloud, pbs_points *out, pbs_err *err) {
    asking q = {.v = v, .cloud = cloud};
    pbs_code rc = pbs_grow(v->run, &v->seen, &v->seen_room, cloud->count, 1, "marks", err);
    if (rc) return rc;
    for (int k = 0; k < v->views.pairs; k++) aim_at(&q.aim[k], &v->views.pair[k], cloud);
    rc = pbs_parallel(v->run, (cloud->count + CHUNK - 1) / CHUNK, ask_chunk, &q, err);
    static const pbs_pair identity = {
        .right = {1, 0, 0}, .up = {0, 1, 0}, .toward = {0, 0, 1}, .pixel = 1};
    aim frame;
    aim_at(&frame, &identity, cloud);
    for (size_t i = 0; i < cloud->count && !rc; i++)
        if (v->seen[i]) append(cloud, i, &frame, out);
    return rc;
}
