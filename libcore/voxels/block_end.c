/* block_end.c: which cells become voxels (grid.h), and which of their faces are hidden (paper 2,
 * section 3). */
#include "libcore/voxels/block_inner.h"

typedef struct walk {
    pbs_block *b;
    pbs_voxels *v;                     /* the block's own */
    bool edge;                         /* the grid ends in the block or beside it */
    uint64_t inside[3][PBS_BRICK_ROW]; /* cells of a brick that are in the grid, axis by axis */
    uint32_t corner[3];                /* of the block in its chunk */
    uint32_t in_brick[64];             /* place of a cell */
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

/* What was in the array is not needed: it goes first. */
static pbs_code more(pbs_block *b, void *array, size_t *cap, size_t need, size_t size,
                     pbs_err *err) {
    void *p;
    if (need <= *cap) return PBS_OK;
    memcpy(&p, array, sizeof p);
    pbs_free(b->run, p);
    *cap = need + need / 4 < PBS_CELLS ? need + need / 4 : PBS_CELLS;
    pbs_code rc = pbs_alloc(b->run, array, *cap, size, "a block's voxels", err);
    if (rc) *cap = 0;
    return rc;
}

static pbs_code make_room(pbs_block *b, size_t need, pbs_err *err) {
    pbs_block_out *o = &b->out;
    pbs_voxels *v = &o->voxels;
    void *array[6] = {&v->normal, &v->weight, &v->colour, &v->material, &v->emissive, &v->face};
    static const uint32_t channel[5] = {PBS_NORMAL, PBS_WEIGHT, PBS_COLOUR, PBS_MATERIAL,
                                        PBS_EMISSIVE};
    pbs_code rc = more(b, &o->chosen, &o->cap[7], need, sizeof *o->chosen, err);
    if (!rc) rc = more(b, &v->place, &o->cap[6], need, 4, err);
    for (int i = 0; !rc && i < 5; i++)
        if (b->params.channels & channel[i]) rc = more(b, array[i], &o->cap[i], need, 4, err);
    if (!rc && b->params.per_face) rc = more(b, array[5], &o->cap[5], need, 4, err);
    return rc;
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

/* Six masks of cells to masks of six faces, for the eight cells from 8 i on. */
static uint64_t by_cell(const uint64_t mask[6], int i) {
    uint64_t x = 0;
    for (int f = 0; f < 6; f++) x |= (mask[f] >> 8 * i & 255) << 8 * f;
    return transpose(x);
}

/* Cells that have a six-separating neighbour behind each of their faces. */
static void neighbours(const pbs_bricks *k, uint32_t index, uint64_t out[6]) {
    static const uint32_t step[3] = {1, PBS_BRICK_ROW, PBS_BRICK_ROW * PBS_BRICK_ROW};
    for (int a = 0; a < 3; a++) {
        out[2 * a] = pbs_brick_down(k->six[index], k->six[index - step[a]], a);
        out[2 * a + 1] = pbs_brick_up(k->six[index], k->six[index + step[a]], a);
    }
}

/* Whether none of the 26 cells around one is six-separating. Bits of a brick are in Morton order.
 */
static bool is_lonely(const pbs_bricks *k, uint32_t index, uint32_t cell) {
    uint32_t brick[3] = {index % PBS_BRICK_ROW, index / PBS_BRICK_ROW % PBS_BRICK_ROW,
                         index / (PBS_BRICK_ROW * PBS_BRICK_ROW)};
    uint32_t at[3];
    for (int a = 0; a < 3; a++) at[a] = 4 * brick[a] + (cell >> a & 1) + (cell >> (a + 2) & 2);
    for (uint32_t i = 0; i < 27; i++) {
        uint32_t to[3] = {at[0] + i % 3 - 1, at[1] + i / 3 % 3 - 1, at[2] + i / 9 - 1}, bit = 0;
        for (int a = 0; a < 3; a++) bit |= (to[a] & 1) << a | (to[a] & 2) << (a + 2);
        if (k->six[to[0] / 4 + PBS_BRICK_ROW * (to[1] / 4 + PBS_BRICK_ROW * (to[2] / 4))] >> bit &
            1)
            return false;
    }
    return true;
}

/* Of those without a neighbour: what is touched without any area in it is kept only if nothing is
 * near at all. */
static uint64_t orphans(const pbs_bricks *k, const pbs_brick *p, uint32_t index, uint64_t alone) {
    uint64_t kept = alone;
    for (uint64_t c = alone; c; c &= c - 1) {
        uint32_t cell = (uint32_t)__builtin_ctzll(c);
        const int64_t *r = pbs_record_at(k, p->record[cell]);
        if (r[PBS_REC_FLAGS] & PBS_REC_BARE && !is_lonely(k, index, cell))
            kept &= ~(UINT64_C(1) << cell);
    }
    return kept;
}

static uint64_t choose(walk *w, const pbs_brick *p, uint32_t index, uint64_t seen,
                       const uint64_t near[6]) {
    pbs_cells cells = w->b->params.cells;
    uint64_t six = w->b->bricks.six[index];
    if (cells == PBS_CELLS_CONSERVATIVE) return seen | six;
    if (cells == PBS_CELLS_SEPARATING) return six;
    uint64_t alone = seen & ~(six | near[0] | near[1] | near[2] | near[3] | near[4] | near[5]);
    alone = orphans(&w->b->bricks, p, index, alone);
    w->orphans += (uint64_t)__builtin_popcountll(alone);
    return six | alone;
}

static void count_beyond(walk *w, const pbs_brick *p, uint64_t cells) {
    const pbs_bricks *k = &w->b->bricks;
    for (uint64_t c = cells; c; c &= c - 1) {
        const int64_t *r = pbs_record_at(k, p->record[__builtin_ctzll(c)]);
        if (!(r[PBS_REC_FLAGS] & PBS_REC_BARE)) w->beyond += pbs_record_total(k, r, PBS_REC_AREA);
    }
}

/* Returns whether there are any. */
static bool find_caps(const uint32_t corner[3], uint64_t caps[6]) {
    uint64_t any = 0;
    for (int a = 0; a < 3; a++) {
        caps[2 * a] = corner[a] == 0 ? plane(a, 0) : 0;
        caps[2 * a + 1] = corner[a] == PBS_CHUNK - 4 ? plane(a, 3) : 0;
        any |= caps[2 * a] | caps[2 * a + 1];
    }
    return any;
}

static void put_cells(walk *w, const pbs_brick *p, uint32_t index, uint64_t voxels,
                      const uint32_t corner[3], const uint64_t hidden[6]) {
    pbs_block_out *o = &w->b->out;
    const pbs_bricks *k = &w->b->bricks;
    uint64_t caps[6];
    bool any_caps = find_caps(corner, caps);
    uint32_t place = PBS_PLACE(corner[0], corner[1], corner[2], 0);
    size_t n = o->voxels.count;
    for (int i = 0; i < 8; i++) {
        uint64_t some = voxels >> 8 * i & 255;
        if (!some) continue;
        uint64_t hide = by_cell(hidden, i), cap = any_caps ? by_cell(caps, i) : 0;
        for (; some; some &= some - 1) {
            uint32_t c = (uint32_t)__builtin_ctzll(some), cell = 8 * (uint32_t)i + c;
            o->voxels.place[n] = place + w->in_brick[cell];
            pbs_chosen *to = &o->chosen[n++];
            *to = (pbs_chosen){.code = index * 64 + cell,
                               .hide = (uint8_t)(hide >> 8 * c),
                               .caps = (uint8_t)(cap >> 8 * c)};
            if (!k->sums)
                to->faces = p->faces[cell];
            else {
                to->record = pbs_record_at(k, p->record[cell]);
                __builtin_prefetch(to->record);
                __builtin_prefetch(to->record + k->numbers - 1);
            }
        }
    }
    o->voxels.count = n;
}

static void put_brick(walk *w, uint32_t morton) {
    pbs_bricks *k = &w->b->bricks;
    uint32_t index = k->place[morton], corner[3];
    const pbs_brick *p = k->at[index];
    uint64_t hidden[6], seen = p->seen;
    uint32_t row[3] = {index % PBS_BRICK_ROW, index / PBS_BRICK_ROW % PBS_BRICK_ROW,
                       index / (PBS_BRICK_ROW * PBS_BRICK_ROW)};
    if (w->edge) seen &= w->inside[0][row[0]] & w->inside[1][row[1]] & w->inside[2][row[2]];
    if (seen != p->seen && k->sums) count_beyond(w, p, p->seen & ~seen);
    w->touched += (uint64_t)__builtin_popcountll(seen);
    neighbours(k, index, hidden);
    uint64_t voxels = choose(w, p, index, seen, hidden);
    for (int a = 0; a < 3; a++) corner[a] = w->corner[a] + 4 * (row[a] - 1);
    if (voxels) put_cells(w, p, index, voxels, corner, hidden);
}

static void count(const walk *w, pbs_block_stats *out) {
    const pbs_block *b = w->b;
    *out = (pbs_block_stats){.triangles = b->triangles,
                             .fragments = b->fragment_count,
                             .lost = b->lost,
                             .touched = b->set_alone ? 0 : w->touched,
                             .orphans = w->orphans,
                             .area = (double)(b->area - w->beyond) / PBS_UNIT,
                             .kept = (double)w->kept / PBS_UNIT};
}

/* As many cells as may become voxels. Asks for the memory that is read next. */
static size_t most_voxels(const pbs_bricks *k) {
    size_t n = 0;
    for (uint32_t i = 0; i < k->count; i++) {
        const pbs_brick *p = pbs_brick_number(k, i);
        n += (size_t)__builtin_popcountll(p->seen | k->six[p->index]);
        for (size_t at = 64; at < k->brick_bytes; at += 64) __builtin_prefetch((char *)p + at);
    }
    return n;
}

pbs_code pbs_block_end(pbs_block *b, pbs_voxels *out, const uint32_t **faces, size_t *face_count,
                       pbs_block_stats *stats, pbs_err *err) {
    walk w = {.b = b};
    for (int k = 0; k < 3; k++) w.corner[k] = b->at[k] % PBS_CHUNK;
    for (uint32_t c = 0; c < 64; c++) w.in_brick[c] = pbs_unmorton8(c);
    b->out.voxels.count = b->out.face_count = 0;
    find_edges(&w);
    pbs_code rc = make_room(b, most_voxels(&b->bricks), err);
    for (uint32_t i = 0; !rc && i < PBS_BRICKS / 64; i++)
        for (uint64_t u = b->bricks.used[i]; u; u &= u - 1)
            put_brick(&w, 64 * i + (uint32_t)__builtin_ctzll(u));
    if (!rc) rc = pbs_block_means(b, &w.kept, err);
    *out = b->out.voxels;
    *faces = b->out.faces;
    *face_count = b->out.face_count;
    if (stats) count(&w, stats);
    return rc;
}
