#include "libcore/voxels/bricks.h"

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
    b->numbers = PBS_REC_EXTRA + b->extras;
    b->brick_bytes = offsetof(pbs_brick, record) + (sums ? 64 * sizeof(uint32_t) : 64);
    make_tables(b);
    pbs_code rc = pbs_alloc(run, &b->spare, 1, b->brick_bytes, "a block's cells", err);
    if (!rc) memset(b->spare, 0, b->brick_bytes);
    if (!rc && sums && !pbs_bricks_reserve(b, 1)) rc = pbs_fail(err, b->rc, "%s", b->err.text);
    if (!rc && sums) {
        memset(b->record[0], 0, b->numbers * sizeof(int64_t));
        b->record[0][PBS_REC_FLAGS] = PBS_REC_BARE;
    }
    return rc;
}

void pbs_bricks_free(pbs_bricks *b) {
    for (int i = 0; i < PBS_BRICKS / PBS_BRICK_SLAB; i++) pbs_free(b->run, b->brick[i]);
    for (int i = 0; i <= PBS_CELLS / PBS_RECORD_SLAB; i++) {
        pbs_free(b->run, b->record[i]);
        pbs_free(b->run, b->wide[i]);
    }
    pbs_free(b->run, b->spare);
}

void pbs_bricks_begin(pbs_bricks *b) {
    memset(b->six, 0, sizeof b->six);
    memset(b->at, 0, sizeof b->at);
    memset(b->used, 0, sizeof b->used);
    b->count = 0;
    b->records = b->wides = 1;
    b->rc = PBS_OK;
}

/* ---- memory ---- */

static bool take(pbs_bricks *b, void *slab, size_t count, size_t size) {
    void *have;
    memcpy(&have, slab, sizeof have);
    if (have) return true;
    if (!b->rc) b->rc = pbs_alloc(b->run, slab, count, size, "a block's cells", &b->err);
    return !b->rc;
}

static uint32_t least(uint32_t a, uint32_t b) {
    return a < b ? a : b;
}

bool pbs_bricks_reserve(pbs_bricks *b, uint32_t n) {
    if (b->rc || !n) return !b->rc;
    uint32_t last = least(b->count + n, PBS_BRICKS) - 1;
    for (uint32_t i = b->count / PBS_BRICK_SLAB; i <= last / PBS_BRICK_SLAB; i++)
        if (!take(b, &b->brick[i], PBS_BRICK_SLAB, b->brick_bytes)) return false;
    if (!b->sums) return true;
    last = least(b->records + n - 1, PBS_CELLS);
    for (uint32_t i = b->records / PBS_RECORD_SLAB; i <= last / PBS_RECORD_SLAB; i++)
        if (!take(b, &b->record[i], PBS_RECORD_SLAB, b->numbers * sizeof(int64_t))) return false;
    return true;
}

pbs_brick *pbs_brick_new(pbs_bricks *b, uint32_t index) {
    uint32_t m = b->morton[index];
    if (m >= PBS_BRICKS) return b->at[index] = b->spare;
    pbs_brick *p =
        (void *)(b->brick[b->count / PBS_BRICK_SLAB] + b->count % PBS_BRICK_SLAB * b->brick_bytes);
    memset(p, 0, b->brick_bytes);
    p->index = index;
    b->count++;
    b->used[m / 64] |= UINT64_C(1) << m % 64;
    return b->at[index] = p;
}

/* ---- second records ---- */

static int64_t *wide_of(const pbs_bricks *b, const int64_t *record) {
    uint32_t n = (uint32_t)(record[PBS_REC_FLAGS] >> PBS_REC_WIDE);
    if (!n) return NULL;
    return b->wide[n / PBS_RECORD_SLAB] + (size_t)(n % PBS_RECORD_SLAB) * b->numbers;
}

static int64_t *new_wide(pbs_bricks *b, int64_t *record) {
    uint32_t n = b->wides;
    if (!take(b, &b->wide[n / PBS_RECORD_SLAB], PBS_RECORD_SLAB, b->numbers * sizeof(int64_t)))
        return NULL;
    record[PBS_REC_FLAGS] |= (int64_t)n << PBS_REC_WIDE;
    b->wides++;
    int64_t *w = wide_of(b, record);
    memset(w, 0, b->numbers * sizeof *w);
    return w;
}

void pbs_record_widen(pbs_bricks *b, int64_t *record) {
    int64_t *wide = wide_of(b, record);
    if (!wide) wide = new_wide(b, record);
    for (uint32_t i = 0; i < b->numbers; i++) {
        if (i == PBS_REC_FLAGS) continue;
        int64_t upper = record[i] >> PBS_WIDE_BITS;
        record[i] -= upper * (INT64_C(1) << PBS_WIDE_BITS);
        if (wide) wide[i] += upper; /* without, there is an error already */
    }
}

__int128 pbs_record_total(const pbs_bricks *b, const int64_t *record, uint32_t i) {
    const int64_t *wide = wide_of(b, record);
    __int128 upper = wide ? wide[i] : 0;
    return record[i] + upper * (INT64_C(1) << PBS_WIDE_BITS);
}

void pbs_record_clear(pbs_bricks *b, int64_t *record) {
    int64_t flags = record[PBS_REC_FLAGS] & ~(int64_t)PBS_REC_BARE, *wide = wide_of(b, record);
    memset(record, 0, b->numbers * sizeof *record);
    if (wide) memset(wide, 0, b->numbers * sizeof *wide);
    record[PBS_REC_FLAGS] = flags;
}
