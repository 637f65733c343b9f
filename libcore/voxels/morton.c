#include "libcore/surfels/candidates.h"
#include "libcore/voxels/morton_inner.h"

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

void pbs_look_at_places(pbs_place_look *look, const uint32_t *place, size_t n) {
#if defined(__x86_64__)
    if (pbs_cpu_has_avx2()) {
        pbs_place_look_avx2(look, place, n);
        return;
    }
#endif
    place_look(look, place, n);
}

bool pbs_are_areas(const float *area, size_t n) {
#if defined(__x86_64__)
    if (pbs_cpu_has_avx2()) return pbs_areas_avx2(area, n);
#endif
    return areas(area, n);
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
