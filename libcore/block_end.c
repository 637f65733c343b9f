/* block_end.c: from sums to voxels: which cells (grid.h), their faces, means of their attributes
 * (paper 2, section 3). */
#include "libcore/block_inner.h"

typedef struct walk {
    pbs_block *b;
    pbs_voxels *v;                     /* the block's own */
    bool edge;                         /* the grid ends in the block or beside it */
    uint64_t inside[3][PBS_BRICK_ROW]; /* cells of a brick that are in the grid, axis by axis */
    uint32_t corner[3];                /* of the block in its chunk */
    uint64_t touched, orphans;
    __int128 kept, beyond; /* area in voxels; outside of the grid */
} walk;

/* ---- where the grid ends ---- */

static bool is_inside(const pbs_block *b, int axis, int c) {
    int64_t at = (int64_t)b->at[axis] + c;
    return at >= 0 && at < b->size;
}

/* Cells of a brick whose coordinate along an axis is c, 0 .. 3. */
static uint64_t plane(int axis, int c) {
    static const uint64_t odd[3] = {0xaaaaaaaaaaaaaaaa, 0xcccccccccccccccc, 0xf0f0f0f0f0f0f0f0};
    static const uint64_t high[3] = {0xff00ff00ff00ff00, 0xffff0000ffff0000, 0xffffffff00000000};
    return (c & 1 ? odd[axis] : ~odd[axis]) & (c & 2 ? high[axis] : ~high[axis]);
}

static void find_edges(walk *w) {
    const pbs_block *b = w->b;
    for (int k = 0; k < 3; k++) {
        w->edge = w->edge || !is_inside(b, k, -1) || !is_inside(b, k, PBS_BLOCK);
        for (int i = 0; i < PBS_BRICK_ROW; i++) {
            w->inside[k][i] = 0;
            for (int c = 0; c < 4; c++)
                if (is_inside(b, k, 4 * (i - 1) + c)) w->inside[k][i] |= plane(k, c);
        }
    }
    for (uint32_t i = 0; w->edge && i < PBS_BRICK_TABLE; i++)
        w->b->bricks.six[i] &= w->inside[0][i % PBS_BRICK_ROW] &
                               w->inside[1][i / PBS_BRICK_ROW % PBS_BRICK_ROW] &
                               w->inside[2][i / (PBS_BRICK_ROW * PBS_BRICK_ROW)];
}

/* ---- room ---- */

static pbs_code more(pbs_run *run, void *array, size_t *cap, size_t need, pbs_err *err) {
    return pbs_grow(run, array, cap, need, 4, "a block's voxels", err);
}

static pbs_code make_room(pbs_block *b, size_t need, pbs_err *err) {
    pbs_block_out *o = &b->out;
    pbs_voxels *v = &o->voxels;
    uint32_t c = b->params.channels;
    pbs_code rc = more(b->run, &v->place, &o->cap[0], need, err);
    if (!rc && c & PBS_NORMAL) rc = more(b->run, &v->normal, &o->cap[1], need, err);
    if (!rc && c & PBS_WEIGHT) rc = more(b->run, &v->weight, &o->cap[2], need, err);
    if (!rc && c & PBS_COLOUR) rc = more(b->run, &v->colour, &o->cap[3], need, err);
    if (!rc && c & PBS_MATERIAL) rc = more(b->run, &v->material, &o->cap[4], need, err);
    if (!rc && c & PBS_EMISSIVE) rc = more(b->run, &v->emissive, &o->cap[5], need, err);
    if (!rc && b->params.per_face) {
        rc = more(b->run, &v->face, &o->cap[6], need, err);
        if (!rc) rc = more(b->run, &o->faces, &o->cap[7], o->face_count + 6 * 64, err);
    }
    return rc;
}

/* ---- a voxel ---- */

/* A cell's sums, both sides together: area, normal; and the difference of the normals. */
typedef struct sums {
    double area, normal[3], across[3];
    __int128 units; /* of area */
} sums;

static void sum_narrow(const int64_t *s, sums *out) {
    out->units = s[0] + s[4];
    out->area = (double)(s[0] + s[4]);
    for (int k = 0; k < 3; k++) {
        out->normal[k] = (double)(s[k + 1] + s[k + 5]);
        out->across[k] = (double)(s[k + 1] - s[k + 5]);
    }
}

static void sum_wide(const pbs_bricks *k, const pbs_brick *p, uint32_t cell, sums *out) {
    __int128 s[PBS_SUMS];
    for (uint32_t i = 0; i < PBS_SUMS; i++) s[i] = pbs_brick_total(k, p, cell, i);
    out->units = s[0] + s[4];
    out->area = (double)out->units;
    for (int i = 0; i < 3; i++) {
        out->normal[i] = (double)(s[i + 1] + s[i + 5]);
        out->across[i] = (double)(s[i + 1] - s[i + 5]);
    }
}

/* True: the normal is that of a sheet with two sides. */
static bool mean_normal(const sums *s, float out[3]) {
    const double *n = s->normal;
    double thin = PBS_BLOCK_THIN * s->area;
    bool sheet = n[0] * n[0] + n[1] * n[1] + n[2] * n[2] < thin * thin;
    if (sheet) n = s->across;
    for (int k = 0; k < 3; k++) out[k] = (float)(n[k] * (1 / PBS_UNIT));
    return sheet;
}

static double extra(const pbs_bricks *k, const pbs_brick *p, uint32_t cell, uint32_t i) {
    if (p->wide) return (double)pbs_brick_total(k, p, cell, PBS_SUMS + i);
    return (double)pbs_brick_extra(p, cell, k->extras)[i];
}

static uint32_t put_light(const double linear[3], double alpha) {
    const pbs_srgb_table *t = pbs_srgb();
    uint32_t out = (uint32_t)(alpha + 0.5) << 24;
    for (int k = 0; k < 3; k++)
        out |= (uint32_t)pbs_srgb_encode(t, (float)(linear[k] * (1.0 / PBS_LIGHT))) << 8 * k;
    return out;
}

static void put_extras(pbs_block *b, const pbs_brick *p, uint32_t cell, double area, size_t n,
                       uint32_t *colour) {
    const pbs_voxels *v = &b->out.voxels;
    double mean[PBS_EXTRAS];
    for (uint32_t i = 0; i < b->extras; i++)
        mean[i] = area > 0 ? extra(&b->bricks, p, cell, i) / area : 0;
    if (b->want & PBS_COLOUR) *colour = put_light(mean, mean[3]);
    if (v->colour) v->colour[n] = *colour;
    if (v->emissive) v->emissive[n] = put_light(mean + b->at_emissive, 0);
    if (v->material)
        v->material[n] = (uint32_t)(mean[b->at_material] + 0.5) |
                         (uint32_t)(mean[b->at_material + 1] + 0.5) << 8;
}

static void put_faces(pbs_block *b, uint32_t code, uint32_t faces, uint32_t colour, size_t n) {
    pbs_block_out *o = &b->out;
    o->voxels.face[n] = (uint32_t)o->face_count;
    for (int f = 0; f < 6; f++) {
        double light[4];
        if (!(faces >> f & 1)) continue;
        uint32_t *to = &o->faces[o->face_count++];
        if (b->params.per_face == PBS_PER_FACE_MATERIAL)
            *to = pbs_face_material(&b->face_sums, code, f);
        else
            *to =
                pbs_face_light(&b->face_sums, code, f, light) ? put_light(light, light[3]) : colour;
    }
}

/* faces: those seen; hidden by others already. */
static void put_voxel(walk *w, const pbs_brick *p, uint32_t code, uint32_t place, uint32_t faces) {
    pbs_block *b = w->b;
    pbs_voxels *v = w->v;
    uint32_t cell = code & 63, colour = 0;
    size_t n = v->count++;
    if (!b->set_alone) {
        sums s;
        float normal[3];
        if (p->wide)
            sum_wide(&b->bricks, p, cell, &s);
        else
            sum_narrow(pbs_brick_sums(p, cell), &s);
        if (mean_normal(&s, normal)) faces |= PBS_VOXEL_TWO_SIDED;
        bool bare = p->bare >> cell & 1 || !s.units;
        if (!bare) w->kept += s.units;
        if (v->normal) v->normal[n] = pbs_normal10_put(normal);
        if (v->weight) v->weight[n] = bare ? 0x1p-30f : (float)(s.area * (1 / PBS_UNIT));
        if (b->extras) put_extras(b, p, cell, s.area, n, &colour);
    }
    v->place[n] = place | faces << 24;
    if (b->params.per_face) put_faces(b, code, faces, colour, n);
}

/* ---- a brick ---- */

/* Bit k of byte c is bit c of byte k. */
static uint64_t transpose(uint64_t x) {
    uint64_t t = (x ^ x >> 7) & 0x00aa00aa00aa00aa;
    x ^= t ^ t << 7;
    t = (x ^ x >> 14) & 0x0000cccc0000cccc;
    x ^= t ^ t << 14;
    t = (x ^ x >> 28) & 0x00000000f0f0f0f0;
    return x ^ t ^ t << 28;
}

/* Six masks of cells to masks of six faces a cell. */
static void by_cell(const uint64_t mask[6], uint8_t out[64]) {
    for (int i = 0; i < 8; i++) {
        uint64_t x = 0;
        for (int f = 0; f < 6; f++) x |= (mask[f] >> 8 * i & 255) << 8 * f;
        x = transpose(x);
        memcpy(out + 8 * i, &x, 8);
    }
}

/* Cells that have a six-separating neighbour behind each of their faces. */
static void neighbours(const pbs_bricks *k, uint32_t index, uint64_t out[6]) {
    static const uint32_t step[3] = {1, PBS_BRICK_ROW, PBS_BRICK_ROW * PBS_BRICK_ROW};
    for (int a = 0; a < 3; a++) {
        out[2 * a] = pbs_brick_down(k->six[index], k->six[index - step[a]], a);
        out[2 * a + 1] = pbs_brick_up(k->six[index], k->six[index + step[a]], a);
    }
}

static uint64_t choose(walk *w, const pbs_brick *p, uint64_t seen, uint64_t six,
                       const uint64_t near[6]) {
    (void)p;
    pbs_cells cells = w->b->params.cells;
    if (cells == PBS_CELLS_CONSERVATIVE) return seen | six;
    if (cells == PBS_CELLS_SEPARATING) return six;
    uint64_t alone = seen & ~(six | near[0] | near[1] | near[2] | near[3] | near[4] | near[5]);
    w->orphans += (uint64_t)__builtin_popcountll(alone);
    return six | alone;
}

static void count_area(walk *w, const pbs_brick *p, uint64_t cells) {
    for (uint64_t c = cells & ~p->bare; c; c &= c - 1) {
        uint32_t cell = (uint32_t)__builtin_ctzll(c);
        w->beyond +=
            pbs_brick_total(&w->b->bricks, p, cell, 0) + pbs_brick_total(&w->b->bricks, p, cell, 4);
    }
}

static void put_brick(walk *w, uint32_t morton) {
    pbs_bricks *k = &w->b->bricks;
    uint32_t index = k->place[morton], corner[3];
    const pbs_brick *p = k->at[index];
    uint64_t hidden[6], caps[6], seen = p->seen;
    uint8_t hide[64], cap[64];
    uint32_t row[3] = {index % PBS_BRICK_ROW, index / PBS_BRICK_ROW % PBS_BRICK_ROW,
                       index / (PBS_BRICK_ROW * PBS_BRICK_ROW)};
    if (w->edge) seen &= w->inside[0][row[0]] & w->inside[1][row[1]] & w->inside[2][row[2]];
    if (seen != p->seen && !w->b->set_alone) count_area(w, p, p->seen & ~seen);
    w->touched += (uint64_t)__builtin_popcountll(seen);
    neighbours(k, index, hidden);
    uint64_t voxels = choose(w, p, seen, k->six[index], hidden);
    if (!voxels) return;
    for (int a = 0; a < 3; a++) {
        corner[a] = w->corner[a] + 4 * (row[a] - 1);
        caps[2 * a] = corner[a] == 0 ? plane(a, 0) : 0;
        caps[2 * a + 1] = corner[a] == PBS_CHUNK - 4 ? plane(a, 3) : 0;
    }
    by_cell(hidden, hide);
    by_cell(caps, cap);
    uint32_t place = PBS_PLACE(corner[0], corner[1], corner[2], 0);
    for (; voxels; voxels &= voxels - 1) {
        uint32_t c = (uint32_t)__builtin_ctzll(voxels), faces = p->faces[c];
        /* Nothing says where it is seen from: from all around. */
        if (!(faces & PBS_FACES_ALL)) faces = PBS_FACES_ALL | PBS_VOXEL_TWO_SIDED;
        put_voxel(w, p, index * 64 + c, place + pbs_unmorton8(c),
                  (faces & ~(uint32_t)hide[c]) | cap[c]);
    }
}

static void count(const walk *w, pbs_block_stats *out) {
    const pbs_block *b = w->b;
    *out = (pbs_block_stats){.triangles = b->triangles,
                             .fragments = b->fragment_count,
                             .touched = b->set_alone ? 0 : w->touched,
                             .orphans = w->orphans,
                             .area = (double)(b->area - w->beyond) / PBS_UNIT,
                             .kept = (double)w->kept / PBS_UNIT};
}

pbs_code pbs_block_end(pbs_block *b, pbs_voxels *out, const uint32_t **faces, size_t *face_count,
                       pbs_block_stats *stats, pbs_err *err) {
    walk w = {.b = b, .v = &b->out.voxels};
    pbs_code rc = PBS_OK;
    for (int k = 0; k < 3; k++) w.corner[k] = b->at[k] % PBS_CHUNK;
    w.v->count = b->out.face_count = 0;
    find_edges(&w);
    for (uint32_t i = 0; !rc && i < PBS_BRICKS / 64; i++)
        for (uint64_t u = b->bricks.used[i]; !rc && u; u &= u - 1) {
            rc = make_room(b, w.v->count + 64, err);
            if (!rc) put_brick(&w, 64 * i + (uint32_t)__builtin_ctzll(u));
        }
    *out = *w.v;
    *faces = b->out.faces;
    *face_count = b->out.face_count;
    if (stats) count(&w, stats);
    return rc;
}
