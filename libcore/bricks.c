#include "libcore/bricks.h"
#include <string.h>

/* Two bits to every third place. */
static uint32_t spread2(uint32_t v) {
    return (v & 1) | (v & 2) << 2;
}
static uint32_t spread4(uint32_t v) {
    return spread2(v) | spread2(v >> 2) << 6;
}

static void make_tables(pbs_bricks *b) {
    static const uint32_t step[3] = {1, PBS_BRICK_ROW, PBS_BRICK_ROW * PBS_BRICK_ROW};
    for (int k = 0; k < 3; k++)
        for (uint32_t i = 0; i < 128; i++) {
            uint32_t c = i < 66 ? i + 3 : 0; /* so that the layer below is the end of a brick */
            b->axis[k][i] = step[k] * (c / 4) * 64 + (spread2(c % 4) << k);
        }
    for (uint32_t i = 0; i < PBS_BRICK_TABLE; i++) b->morton[i] = UINT16_MAX;
    for (uint32_t z = 0; z < 16; z++)
        for (uint32_t y = 0; y < 16; y++)
            for (uint32_t x = 0; x < 16; x++) {
                uint32_t m = spread4(x) | spread4(y) << 1 | spread4(z) << 2;
                b->place[m] = (uint16_t)(x + 1 + step[1] * (y + 1) + step[2] * (z + 1));
                b->morton[b->place[m]] = (uint16_t)m;
            }
}

pbs_code pbs_bricks_init(pbs_bricks *b, pbs_run *run, bool sums, uint32_t extras, pbs_err *err) {
    memset(b, 0, sizeof *b);
    b->run = run;
    b->sums = sums, b->extras = sums ? extras : 0;
    b->bytes = sizeof(pbs_brick) + (sums ? 64 * (PBS_SUMS + b->extras) * sizeof(int64_t) : 0);
    make_tables(b);
    pbs_code rc = pbs_alloc(run, &b->spare, 1, b->bytes, "a block's cells", err);
    if (!rc) memset(b->spare, 0, b->bytes);
    return rc;
}

void pbs_bricks_free(pbs_bricks *b) {
    for (int i = 0; i < PBS_BRICKS / PBS_BRICK_SLAB; i++) pbs_free(b->run, b->slab[i]);
    for (int i = 0; b->wide && i < PBS_BRICKS; i++) pbs_free(b->run, b->wide[i]);
    pbs_free(b->run, b->wide);
    pbs_free(b->run, b->spare);
}

void pbs_bricks_begin(pbs_bricks *b) {
    memset(b->six, 0, sizeof b->six);
    memset(b->at, 0, sizeof b->at);
    memset(b->used, 0, sizeof b->used);
    b->count = b->wide_count = 0;
    b->spare->wide = NULL;
    b->rc = PBS_OK;
}

/* The spare brick is the same for all: its numbers mean nothing. */
static pbs_brick *spare(pbs_bricks *b, uint32_t index) {
    return b->at[index] = b->spare;
}

pbs_brick *pbs_brick_new(pbs_bricks *b, uint32_t index) {
    uint32_t m = b->morton[index];
    if (m >= PBS_BRICKS) return spare(b, index);
    char **slab = &b->slab[b->count / PBS_BRICK_SLAB];
    if (!*slab && !b->rc)
        b->rc = pbs_alloc(b->run, slab, PBS_BRICK_SLAB, b->bytes, "a block's cells", &b->err);
    if (!*slab) return spare(b, index);
    pbs_brick *p = (void *)(*slab + b->count % PBS_BRICK_SLAB * b->bytes);
    memset(p, 0, b->bytes);
    b->count++;
    b->used[m / 64] |= UINT64_C(1) << m % 64;
    return b->at[index] = p;
}

static int64_t *new_wide(pbs_bricks *b) {
    size_t n = 64 * (PBS_SUMS + b->extras) * sizeof(int64_t);
    if (b->rc) return NULL;
    if (!b->wide) {
        b->rc = pbs_alloc(b->run, &b->wide, PBS_BRICKS + 1, sizeof *b->wide, "large sums", &b->err);
        if (b->rc) return NULL;
        memset(b->wide, 0, (PBS_BRICKS + 1) * sizeof *b->wide);
    }
    int64_t **p = &b->wide[b->wide_count];
    if (!*p) b->rc = pbs_alloc(b->run, p, 1, n, "large sums", &b->err);
    if (!*p) return NULL;
    memset(*p, 0, n);
    b->wide_count++;
    return *p;
}

static void widen(int64_t *v, int64_t *wide, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) {
        int64_t upper = v[i] >> PBS_WIDE_BITS;
        wide[i] += upper;
        v[i] -= upper * (INT64_C(1) << PBS_WIDE_BITS);
    }
}

void pbs_brick_widen(pbs_bricks *b, pbs_brick *p, uint32_t cell) {
    if (p == b->spare || (!p->wide && !(p->wide = new_wide(b)))) {
        /* What is in the spare brick, or has no room, is never looked at. */
        memset(pbs_brick_sums(p, cell), 0, PBS_SUMS * sizeof(int64_t));
        memset(pbs_brick_extra(p, cell, b->extras), 0, b->extras * sizeof(int64_t));
        return;
    }
    widen(pbs_brick_sums(p, cell), p->wide + PBS_SUMS * cell, PBS_SUMS);
    widen(pbs_brick_extra(p, cell, b->extras), p->wide + PBS_SUMS * 64 + b->extras * cell,
          b->extras);
}

__int128 pbs_brick_total(const pbs_bricks *b, const pbs_brick *p, uint32_t cell, uint32_t i) {
    size_t k = i < PBS_SUMS ? PBS_SUMS * cell + i
                            : PBS_SUMS * 64 + b->extras * (size_t)cell + i - PBS_SUMS;
    __int128 v = ((const int64_t *)(p + 1))[k];
    if (p->wide) v += (__int128)p->wide[k] * (INT64_C(1) << PBS_WIDE_BITS);
    return v;
}
