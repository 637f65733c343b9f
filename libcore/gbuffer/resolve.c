#include "libcore/gbuffer/resolve_math.h"

/* ---- placed meshes ---- */

void pbs_resolve_place(pbs_placed *p, const pbs_pair *pair, const pbs_draw *draw, uint32_t number,
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
    size_t lo = 0, n = set->draw_count;
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
        pbs_resolve_place(p, s->pair, &set->draws[d], d, set->first[d]);
    }
    s->used[slot] = s->batch;
    s->last = d;
    return p;
}

/* ---- a batch of pixels ---- */

static void solve(bool simd, const pbs_placed *p, pbs_lanes *b, int from, int to, bool normals,
                  bool odd) {
#if defined(__x86_64__)
    if (simd) {
        pbs_resolve_solve_avx2(p, b, from, to, normals, odd);
        return;
    }
#endif
    (void)simd;
    solve_all(p, b, from, to, normals, odd);
}

void pbs_resolve_nearest(pbs_lanes *b, int lane, double dx, double dy) {
    double p[4][2] = {{0}}, best = INFINITY, out[3] = {1, 0, 0};
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 2; k++) p[i + 1][k] = b->a[i][k][lane];
    for (int i = 0; i < 3; i++) {
        double ex = p[i + 1][0] - p[i][0], ey = p[i + 1][1] - p[i][1];
        double qx = dx - p[i][0], qy = dy - p[i][1], l = ex * ex + ey * ey;
        double t = l > 0 ? (qx * ex + qy * ey) / l : 0;
        t = t < 1 ? t : 1, t = t > 0 ? t : 0;
        double x = qx - t * ex, y = qy - t * ey, far = x * x + y * y;
        if (!(far < best)) continue;
        best = far;
        out[0] = out[1] = out[2] = 0;
        out[i] = 1 - t, out[(i + 1) % 3] = t;
    }
    for (int k = 0; k < 3; k++) b->b[k][lane] = out[k];
}

/* Every step ends with asking for the memory that the next one reads. */
static void locate(pbs_resolve_scratch *s, const uint64_t *row, const uint32_t *column, int count,
                   int step) {
    pbs_lanes *b = &s->lanes;
    const pbs_placed *p = NULL;
    uint32_t first = 0, many = 0;
    s->batch++;
    for (b->count = 0; b->count < count; b->count++) {
        uint32_t x = column[b->count * step], id = (uint32_t)row[2 * (size_t)x];
        if (id - first >= many) {
            if (!(p = placed(s, id))) break;
            first = p->first, many = p->draw->mesh->triangles;
        }
        b->x[b->count] = x;
        b->place[b->count] = p;
        b->triangle[b->count] = id - first;
        __builtin_prefetch(p->draw->mesh->index + 3 * (size_t)(id - first));
    }
}

static void find_corners(const pbs_resolve *set, pbs_lanes *b) {
    bool normal = set->channels & PBS_NORMAL, colour = set->channels & PBS_COLOUR;
    for (int i = 0; i < b->count; i++) {
        const pbs_mesh *mesh = b->place[i]->draw->mesh;
        const uint16_t *t = mesh->index + 3 * (size_t)b->triangle[i];
#pragma GCC unroll 3
        for (int k = 0; k < 3; k++) {
            size_t v = b->corner[k][i] = t[k];
            __builtin_prefetch(mesh->position + 3 * v);
            if (normal && mesh->normal) __builtin_prefetch(mesh->normal + 2 * v);
            if (colour && mesh->colour) __builtin_prefetch(mesh->colour + 4 * v);
        }
    }
}

static void gather(pbs_lanes *b, bool normals, uint32_t y) {
    for (int i = 0; i < b->count + 3; i++) {
        int from = i < b->count ? i : b->count - 1;
        const pbs_mesh *mesh = b->place[from]->draw->mesh;
#pragma GCC unroll 3
        for (int k = 0; k < 3; k++) {
            size_t v = b->corner[k][from];
            const float *p = mesh->position + 3 * v;
            b->p[k][0][i] = p[0], b->p[k][1][i] = p[1], b->p[k][2][i] = p[2];
            b->normal[k][i] = 0;
            if (normals && mesh->normal) memcpy(&b->normal[k][i], mesh->normal + 2 * v, 4);
        }
        b->centre[0][i] = b->x[from] * (double)PBS_SUBPIXELS + PBS_SUBPIXELS / 2;
        b->centre[1][i] = y * (double)PBS_SUBPIXELS + PBS_SUBPIXELS / 2;
    }
}

static void compute(const pbs_resolve_scratch *s, pbs_lanes *b, bool odd) {
    bool normals = s->set->channels & PBS_NORMAL;
    for (int from = 0, to; from < b->count; from = to) {
        const pbs_placed *p = b->place[from];
        for (to = from + 1; to < b->count && b->place[to] == p;) to++;
        solve(s->simd, p, b, from, to, normals, odd);
    }
}

static void shade(const pbs_surfaces *surfaces, const pbs_lanes *b, pbs_points *to, size_t n) {
    for (int i = 0; i < b->count; i++, n++) {
        if (to->colour) pbs_surfaces_colour(surfaces, b, i, to->colour + 4 * n);
        if (to->material) pbs_surfaces_material(surfaces, b, i, to->material + 4 * n);
        if (to->emissive) pbs_surfaces_emissive(surfaces, b, i, to->emissive + 4 * n);
    }
}

static void put(const pbs_resolve_scratch *s, uint32_t y, bool odd, pbs_resolve_out *out) {
    const pbs_lanes *b = &s->lanes;
    pbs_points *to = &out->points;
    size_t n = to->count;
    uint32_t width = s->pair->width;
    for (int i = 0; i < b->count; i++) {
        out->where[n + (size_t)i] = y * width + (odd ? width - 1 - b->x[i] : b->x[i]);
#pragma GCC unroll 3
        for (int k = 0; k < 3; k++)
            to->position[3 * (n + (size_t)i) + (size_t)k] = b->position[k][i];
    }
    if (to->normal) memcpy(to->normal + 2 * n, b->code, 4 * (size_t)b->count);
    if (to->colour || to->material || to->emissive) shade(s->set->surfaces, b, to, n);
    to->count += (size_t)b->count;
}

void pbs_resolve_one(const pbs_placed *p, uint32_t triangle, uint32_t x, uint32_t y,
                     pbs_lanes *out) {
    const uint16_t *t = p->draw->mesh->index + 3 * (size_t)triangle;
    out->count = 1;
    out->place[0] = p, out->triangle[0] = triangle, out->x[0] = x;
    for (int k = 0; k < 3; k++) out->corner[k][0] = t[k];
    gather(out, false, y);
    solve_all(p, out, 0, 1, false, false);
}

void pbs_resolve_begin(pbs_resolve_scratch *s, const pbs_resolve *set, const pbs_pair *pair) {
    s->set = set;
    s->pair = pair;
    s->last = 0;
    s->batch = 0;
    size_t slots = set->draw_count < PBS_RESOLVE_CACHE ? set->draw_count : PBS_RESOLVE_CACHE;
    for (size_t i = 0; i < slots; i++) s->cache[i].draw = NULL, s->used[i] = 0;
}

void pbs_resolve_band(pbs_resolve_scratch *s, const pbs_raster *r, pbs_resolve_out out[2]) {
    for (uint32_t y = r->y0; y < r->y1; y++) {
        const uint64_t *row = r->key + 2 * (size_t)(y - r->y0) * r->width;
        int n = 0;
        for (uint32_t x = 0; x < r->width; x++) {
            s->column[n] = x;
            n += row[2 * (size_t)x] < PBS_KEY_EMPTY;
        }
        for (int odd = 0; odd < 2; odd++)
            for (int i = 0; i < n; i += s->lanes.count) {
                const uint32_t *column = odd ? s->column + (n - 1 - i) : s->column + i;
                int count = n - i < PBS_LANES_BATCH ? n - i : PBS_LANES_BATCH;
                locate(s, row + odd, column, count, odd ? -1 : 1);
                find_corners(s->set, &s->lanes);
                gather(&s->lanes, s->set->channels & PBS_NORMAL, y);
                compute(s, &s->lanes, odd);
                put(s, y, odd, &out[odd]);
            }
    }
}
