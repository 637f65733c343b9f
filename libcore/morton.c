#include "libcore/morton.h"
#include "libcore/vectors.h"
#include <string.h>

typedef uint8_t b16 __attribute__((vector_size(16)));

/* The highest bit in which they differ decides, of equally high ones that of the later axis. */
bool pbs_morton_before(const uint32_t a[3], const uint32_t b[3]) {
    int axis = 0;
    uint32_t most = 0;
    for (int k = 0; k < 3; k++) {
        uint32_t d = a[k] ^ b[k];
        if (d >= most || d > (d ^ most)) axis = k, most = d;
    }
    return a[axis] < b[axis];
}

/* ---- looked at ---- */

LANE u4 spread4(u4 v) {
    v = (v | v << 8) & 0x00f00f;
    v = (v | v << 4) & 0x0c30c3;
    return (v | v << 2) & 0x249249;
}
LANE i4 codes4(const uint32_t *place) {
    u4 p = *(const u4_at *)(uintptr_t)place;
    return (i4)(spread4(p & 255) | spread4(p >> 8 & 255) << 1 | spread4(p >> 16 & 255) << 2);
}

bool pbs_morton_sorted(const uint32_t *place, size_t n, uint32_t *last) {
    if (!n) return true;
    int32_t before = *last == PBS_NO_PLACE ? -1 : (int32_t)pbs_morton8(*last);
    i4 bad = {0, 0, 0, 0};
    size_t i = 0;
    for (; i + 4 <= n; i += 4) {
        i4 now = codes4(place + i), shifted = __builtin_shuffle(now, (i4){0, 0, 1, 2});
        shifted[0] = before;
        bad |= now <= shifted;
        before = now[3];
    }
    bool sorted = !(bad[0] | bad[1] | bad[2] | bad[3]);
    for (; i < n; i++) {
        int32_t now = (int32_t)pbs_morton8(place[i]);
        sorted = sorted && now > before;
        before = now;
    }
    *last = place[n - 1] & 0xffffff;
    return sorted;
}

LANE b16 pick16(b16 which, b16 then, b16 other) {
    return (then & which) | (other & ~which);
}

void pbs_place_bounds(const uint32_t *place, size_t n, uint8_t low[3], uint8_t high[3]) {
    b16 least, most;
    memset(&least, 255, sizeof least);
    memset(&most, 0, sizeof most);
    size_t i = 0;
    for (; i + 4 <= n; i += 4) {
        b16 p = (b16) * (const u4_at *)(uintptr_t)(place + i);
        least = pick16((b16)(p < least), p, least);
        most = pick16((b16)(p > most), p, most);
    }
    for (int j = 0; j < 16; j++) {
        if (j % 4 == 3) continue;
        if (least[j] < low[j % 4]) low[j % 4] = least[j];
        if (i && most[j] > high[j % 4]) high[j % 4] = most[j];
    }
    for (; i < n; i++)
        for (int k = 0; k < 3; k++) {
            uint8_t c = (uint8_t)(place[i] >> 8 * k);
            if (c < low[k]) low[k] = c;
            if (c > high[k]) high[k] = c;
        }
}

/* ---- made ---- */

/* First by the highest digit, so that what is left of a digit's voxels are 2^18 cells, each of
 * which has one place in a table. */
enum { HIGH = 64, LOW = 1 << 18 };

typedef struct sorter {
    const uint32_t *place;
    uint32_t slot[LOW];
    uint64_t taken[LOW / 64];
} sorter;

uint32_t pbs_morton_digit(uint32_t place) {
    return pbs_morton8(place & 0xc0c0c0) >> 18;
}

static void by_high_digit(const sorter *s, size_t n, size_t end[HIGH + 1], uint32_t *order) {
    size_t at[HIGH];
    memset(end, 0, (HIGH + 1) * sizeof *end);
    for (size_t i = 0; i < n; i++) end[pbs_morton_digit(s->place[i]) + 1]++;
    for (int d = 0; d < HIGH; d++) {
        end[d + 1] += end[d];
        at[d] = end[d];
    }
    for (size_t i = 0; i < n; i++) order[at[pbs_morton_digit(s->place[i])]++] = (uint32_t)i;
}

/* False if a cell comes twice. */
static bool by_cell(sorter *s, uint32_t *order, size_t n) {
    bool once = true;
    memset(s->taken, 0, sizeof s->taken);
    for (size_t i = 0; i < n; i++) {
        uint32_t cell = pbs_morton8(s->place[order[i]]) % LOW;
        uint64_t bit = UINT64_C(1) << cell % 64;
        once = once && !(s->taken[cell / 64] & bit);
        s->taken[cell / 64] |= bit;
        s->slot[cell] = order[i];
    }
    if (!once) return false;
    for (uint32_t w = 0; w < LOW / 64; w++)
        for (uint64_t left = s->taken[w]; left; left &= left - 1)
            *order++ = s->slot[64 * w + (uint32_t)__builtin_ctzll(left)];
    return true;
}

pbs_code pbs_morton_sort(pbs_run *run, const uint32_t *place, size_t n, uint32_t *order,
                         pbs_err *err) {
    size_t end[HIGH + 1];
    sorter *s;
    if (n > (size_t)HIGH * LOW) return pbs_fail(err, PBS_DATA, "a cell comes twice");
    pbs_code rc = pbs_alloc(run, &s, 1, sizeof *s, "sorting voxels", err);
    if (rc) return rc;
    s->place = place;
    by_high_digit(s, n, end, order);
    for (int d = 0; d < HIGH && !rc; d++)
        if (!by_cell(s, order + end[d], end[d + 1] - end[d]))
            rc = pbs_fail(err, PBS_DATA, "a cell comes twice");
    pbs_free(run, s);
    return rc;
}
