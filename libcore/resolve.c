#include "libcore/resolve.h"

/* ---- placed meshes ---- */

void pbs_place(pbs_placed *p, const pbs_pair *pair, const pbs_draw *draw, uint32_t number,
               uint32_t first) {
    double m[12], scaled[12], most = 0;
    pbs_pair_project(m, pair, draw->m);
    *p = (pbs_placed){.draw = draw, .number = number, .first = first};
    memcpy(p->view, m, sizeof p->view);
    /* Scales of 10^-200 would underflow in the products. */
    for (int i = 0; i < 12; i++)
        if (i % 4 != 3 && fabs(draw->m[i]) > most) most = fabs(draw->m[i]);
    for (int i = 0; i < 12; i++) scaled[i] = most > 0 ? draw->m[i] / most : 0;
    pbs_xform_cofactor(p->cofactor, scaled);
    most = 0;
    for (int i = 0; i < 9; i++) most = fabs(p->cofactor[i]) > most ? fabs(p->cofactor[i]) : most;
    for (int i = 0; i < 9 && most > 0; i++) p->cofactor[i] /= most;
}

/* The last draw whose first triangle is not behind id. */
static uint32_t draw_of(const pbs_resolve *set, uint32_t id) {
    size_t lo = 0, n = set->scene->draw_count;
    while (n > 1) {
        size_t half = n / 2;
        if (set->first[lo + half] <= id) lo += half;
        n -= half;
    }
    return (uint32_t)lo;
}

/* NULL: its place in the cache belongs to another draw of this batch. */
static pbs_placed *placed(pbs_resolve_scratch *s, uint32_t id) {
    const pbs_resolve *set = s->set;
    uint32_t d = s->last;
    if (id < set->first[d] || id >= set->first[d + 1]) d = draw_of(set, id);
    uint32_t slot = d % PBS_RESOLVE_CACHE;
    pbs_placed *p = &s->cache[slot];
    if (!p->draw || p->number != d) {
        if (s->used[slot] == s->batch) return NULL;
        pbs_place(p, s->pair, &set->scene->draws[d], d, set->first[d]);
    }
    s->used[slot] = s->batch;
    s->last = d;
    return p;
}

/* ---- where a triangle is hit ---- */

/* Barycentric coordinates of the point of the triangle 0, a[0], a[1] nearest to d. */
static void nearest(const double a[2][2], const double d[2], double b[3]) {
    const double p[4][2] = {{0, 0}, {a[0][0], a[0][1]}, {a[1][0], a[1][1]}, {0, 0}};
    double best = INFINITY;
    b[0] = 1, b[1] = b[2] = 0;
    for (int i = 0; i < 3; i++) {
        double ex = p[i + 1][0] - p[i][0], ey = p[i + 1][1] - p[i][1];
        double dx = d[0] - p[i][0], dy = d[1] - p[i][1], l = ex * ex + ey * ey;
        double t = l > 0 ? (dx * ex + dy * ey) / l : 0;
        t = t < 1 ? t : 1, t = t > 0 ? t : 0;
        double x = dx - t * ex, y = dy - t * ey, far = x * x + y * y;
        if (!(far < best)) continue;
        best = far;
        b[0] = b[1] = b[2] = 0;
        b[i] = 1 - t, b[(i + 1) % 3] = t;
    }
}

typedef struct surface {
    const float *p[3];
    double e[2][3]; /* edges from corner 0 in the part's coordinates */
} surface;

static inline void find(const pbs_placed *p, uint32_t x, uint32_t y, pbs_hit *h, surface *s) {
    const double *v = p->view;
    for (int i = 0; i < 3; i++) s->p[i] = h->mesh->position + 3 * (size_t)h->corner[i];
    for (int k = 0; k < 3; k++) {
        s->e[0][k] = (double)s->p[1][k] - s->p[0][k];
        s->e[1][k] = (double)s->p[2][k] - s->p[0][k];
    }
    double o[3] = {s->p[0][0], s->p[0][1], s->p[0][2]}, d[2];
    d[0] = x * (double)PBS_SUBPIXELS + PBS_SUBPIXELS / 2 -
           (v[0] * o[0] + v[1] * o[1] + v[2] * o[2] + v[3]);
    d[1] = y * (double)PBS_SUBPIXELS + PBS_SUBPIXELS / 2 -
           (v[4] * o[0] + v[5] * o[1] + v[6] * o[2] + v[7]);
    for (int i = 0; i < 2; i++) {
        h->a[i][0] = v[0] * s->e[i][0] + v[1] * s->e[i][1] + v[2] * s->e[i][2];
        h->a[i][1] = v[4] * s->e[i][0] + v[5] * s->e[i][1] + v[6] * s->e[i][2];
    }
    h->det = h->a[0][0] * h->a[1][1] - h->a[1][0] * h->a[0][1];
    double inv = 1 / h->det;
    h->b[1] = (d[0] * h->a[1][1] - h->a[1][0] * d[1]) * inv;
    h->b[2] = (h->a[0][0] * d[1] - d[0] * h->a[0][1]) * inv;
    h->b[0] = 1 - h->b[1] - h->b[2];
    if (!(h->b[0] >= 0 && h->b[1] >= 0 && h->b[2] >= 0)) nearest((const double(*)[2])h->a, d, h->b);
}

static void corners(pbs_hit *h, const pbs_mesh *mesh, uint32_t triangle) {
    h->mesh = mesh;
    h->triangle = triangle;
    for (int i = 0; i < 3; i++) h->corner[i] = mesh->index[3 * (size_t)triangle + (size_t)i];
}

void pbs_hit_at(const pbs_placed *p, uint32_t triangle, uint32_t x, uint32_t y, pbs_hit *hit) {
    surface s;
    corners(hit, p->draw->mesh, triangle);
    find(p, x, y, hit, &s);
}

static inline void put_position(const pbs_placed *p, const pbs_hit *h, const surface *s,
                                float out[3]) {
    double q[3];
    for (int k = 0; k < 3; k++) q[k] = s->p[0][k] + (h->b[1] * s->e[0][k] + h->b[2] * s->e[1][k]);
    pbs_xform_point(q, p->draw->m, q);
    for (int k = 0; k < 3; k++) out[k] = (float)q[k];
}

/* ---- normals ---- */

static inline void turn(const double c[9], const double v[3], double out[3]) {
    for (int r = 0; r < 3; r++)
        out[r] = c[3 * r] * v[0] + c[3 * r + 1] * v[1] + c[3 * r + 2] * v[2];
}
static inline double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* The corners' normals in the part's coordinates; false: there are none, or they cancel out. */
static inline bool smooth(const pbs_hit *h, double out[3]) {
    if (!h->mesh->normal) return false;
    out[0] = out[1] = out[2] = 0;
    for (int i = 0; i < 3; i++) {
        float n[3];
        pbs_oct_decode(n, h->mesh->normal + 2 * (size_t)h->corner[i]);
        for (int k = 0; k < 3; k++) out[k] += h->b[i] * n[k];
    }
    return dot(out, out) > 1e-8;
}

/* away: the triangle's own normal, right-handed, points away from the viewer. */
static inline void put_normal(const pbs_placed *p, const pbs_hit *h, const surface *s, bool away,
                              int16_t out[2]) {
    const double *a = s->e[0], *b = s->e[1];
    double face[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                      a[0] * b[1] - a[1] * b[0]};
    double g[3], v[3], n[3], l = 0;
    turn(p->cofactor, face, g);
    bool flip = away;
    if (smooth(h, v)) {
        turn(p->cofactor, v, n);
        flip = (dot(n, g) < 0) != away;
        l = dot(n, n);
    }
    if (!(l > 0)) {
        memcpy(n, g, sizeof n);
        flip = away;
        l = dot(n, n);
    }
    l = (flip ? -1 : 1) / sqrt(l);
    float unit[3] = {(float)(n[0] * l), (float)(n[1] * l), (float)(n[2] * l)};
    pbs_oct_encode(out, unit);
}

/* ---- a batch of pixels of one row and one view ---- */

typedef struct batch {
    int count;
    uint32_t x[PBS_RESOLVE_BATCH]; /* in the even view */
    const pbs_placed *place[PBS_RESOLVE_BATCH];
    pbs_hit hit[PBS_RESOLVE_BATCH];
} batch;

/* Every step ends with asking for the memory that the next one reads. */
static void locate(pbs_resolve_scratch *s, batch *b, const uint64_t *row, const uint32_t *column,
                   int count, int step) {
    s->batch++;
    for (b->count = 0; b->count < count; b->count++) {
        uint32_t x = column[b->count * step];
        uint32_t id = (uint32_t)row[2 * (size_t)x];
        const pbs_placed *p = placed(s, id);
        if (!p) break;
        b->x[b->count] = x;
        b->place[b->count] = p;
        b->hit[b->count].triangle = id - p->first;
        __builtin_prefetch(p->draw->mesh->index + 3 * (size_t)(id - p->first));
    }
}

static void fetch(const pbs_resolve *set, batch *b) {
    for (int i = 0; i < b->count; i++) {
        const pbs_mesh *mesh = b->place[i]->draw->mesh;
        pbs_hit *h = &b->hit[i];
        corners(h, mesh, h->triangle);
        for (int k = 0; k < 3; k++) {
            __builtin_prefetch(mesh->position + 3 * (size_t)h->corner[k]);
            if (mesh->normal && set->channels & PBS_NORMAL)
                __builtin_prefetch(mesh->normal + 2 * (size_t)h->corner[k]);
            if (mesh->colour && set->channels & PBS_COLOUR)
                __builtin_prefetch(mesh->colour + 4 * (size_t)h->corner[k]);
        }
    }
}

static void put_batch(pbs_resolve_scratch *s, batch *b, uint32_t y, bool odd,
                      pbs_resolve_out *out) {
    const pbs_resolve *set = s->set;
    pbs_points *to = &out->points;
    uint32_t width = s->pair->width;
    for (int i = 0; i < b->count; i++) {
        const pbs_placed *p = b->place[i];
        pbs_hit *h = &b->hit[i];
        surface face;
        find(p, b->x[i], y, h, &face);
        size_t n = to->count++;
        out->where[n] = y * width + (odd ? width - 1 - b->x[i] : b->x[i]);
        put_position(p, h, &face, to->position + 3 * n);
        if (to->normal) put_normal(p, h, &face, odd ? h->det > 0 : h->det < 0, to->normal + 2 * n);
        if (to->colour) pbs_shader_colour(set->shader, h, to->colour + 4 * n);
        if (to->material) pbs_shader_material(set->shader, h, to->material + 4 * n);
        if (to->emissive) pbs_shader_emissive(set->shader, h, to->emissive + 4 * n);
    }
}

void pbs_resolve_begin(pbs_resolve_scratch *s, const pbs_resolve *set, const pbs_pair *pair) {
    uint32_t *column = s->column;
    memset(s, 0, sizeof *s);
    s->set = set;
    s->pair = pair;
    s->column = column;
}

void pbs_resolve_band(pbs_resolve_scratch *s, const pbs_raster *r, pbs_resolve_out out[2]) {
    batch b;
    for (uint32_t y = r->y0; y < r->y1; y++) {
        const uint64_t *row = r->key + 2 * (size_t)(y - r->y0) * r->width;
        int n = 0;
        for (uint32_t x = 0; x < r->width; x++) {
            s->column[n] = x;
            n += row[2 * (size_t)x] < PBS_KEY_EMPTY;
        }
        for (int odd = 0; odd < 2; odd++)
            for (int i = 0; i < n; i += b.count) {
                const uint32_t *column = odd ? s->column + (n - 1 - i) : s->column + i;
                int count = n - i < PBS_RESOLVE_BATCH ? n - i : PBS_RESOLVE_BATCH;
                locate(s, &b, row + odd, column, count, odd ? -1 : 1);
                fetch(s->set, &b);
                put_batch(s, &b, y, odd, &out[odd]);
            }
    }
}
