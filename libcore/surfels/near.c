#include "libcore/surfels/near.h"
#include <string.h>

enum { RINGS = 4 };

static uint32_t buckets_for(size_t surfels) {
    uint32_t b = 64;
    while (b < 2 * surfels && b < 1u << 31) b *= 2;
    return b;
}

void pbs_near_layout(pbs_near *g, size_t surfels, pbs_layout *layout) {
    size_t buckets = buckets_for(surfels);
    g->place = pbs_layout_take(layout, surfels * sizeof *g->place);
    g->sorted = pbs_layout_take(layout, surfels * sizeof *g->sorted);
    g->next = pbs_layout_take(layout, surfels * sizeof *g->next);
    g->begin = pbs_layout_take(layout, (buckets + 3) * sizeof *g->begin);
    g->head = pbs_layout_take(layout, (buckets + 1) * sizeof *g->head);
}

static double longest_side(const pbs_metric *m) {
    double side = 0;
    for (int k = 0; k < 3; k++) side = fmax(side, m->high[k] - m->low[k]);
    return side;
}

/* Neighbours along x share a bucket or have consecutive ones, so a row of cells is one look. */
static uint32_t bucket_of(const pbs_near *g, int x, int y, int z) {
    return ((uint32_t)x + (uint32_t)y * 0x9e3779b1u + (uint32_t)z * 0x85ebca77u) & (g->buckets - 1);
}

/* The lower corner of the 2 x 2 x 2 cells whose middle is nearest. */
static void corner_of(const pbs_near *g, const float p[3], int cell[3]) {
    for (int k = 0; k < 3; k++) cell[k] = (int)((p[k] - (float)g->m->low[k]) / g->cell + 0.5f) - 1;
}

static uint32_t bucket_at(const pbs_near *g, const float p[3]) {
    int c[3];
    for (int k = 0; k < 3; k++) c[k] = (int)((p[k] - (float)g->m->low[k]) / g->cell);
    return bucket_of(g, c[0], c[1], c[2]);
}

/* Sorts what there is by bucket. */
static void build(pbs_near *g, float spacing) {
    double side = longest_side(g->m), cell = 2.4 * sqrt((double)spacing);
    if (!(cell < side)) cell = side;
    if (!(cell > side * 0x1p-20)) cell = side * 0x1p-20;
    g->cell = cell > 0 ? (float)cell : 1;
    g->buckets = buckets_for(g->count);
    memset(g->begin, 0, (g->buckets + 3) * sizeof *g->begin);
    memset(g->head, 0, (g->buckets + 1) * sizeof *g->head);
    for (size_t i = 0; i < g->count; i++) g->begin[bucket_at(g, g->place[i].p) + 2]++;
    for (uint32_t b = 2; b < g->buckets + 2; b++) g->begin[b] += g->begin[b - 1];
    for (size_t i = 0; i < g->count; i++)
        g->sorted[g->begin[bucket_at(g, g->place[i].p) + 1]++] = g->place[i];
    g->built = g->count;
}

void pbs_near_init(pbs_near *g, const pbs_metric *m) {
    g->m = m;
    g->count = g->built = 0;
    build(g, INFINITY);
}

void pbs_near_add(pbs_near *g, const pbs_place *at, float spacing) {
    g->place[g->count++] = *at;
    /* Often enough that the lists stay short, seldom enough to cost little. */
    if (g->count > g->built + g->built / 4 + 8) {
        build(g, spacing);
        return;
    }
    uint32_t b = bucket_at(g, at->p);
    g->next[g->count - 1] = g->head[b];
    g->head[b] = (uint32_t)g->count;
}

static float list_d2(const pbs_near *g, uint32_t b, const pbs_place *at, float best) {
    for (uint32_t i = g->head[b]; i; i = g->next[i - 1]) {
        float d2 = pbs_metric_d2(g->m, &g->place[i - 1], at);
        best = d2 < best ? d2 : best;
    }
    return best;
}

/* Cells x .. x + cells - 1 of a row. */
static float row_d2(const pbs_near *g, int x, int y, int z, int cells, const pbs_place *at,
                    float best) {
    while (cells > 0) {
        uint32_t b = bucket_of(g, x, y, z), most = g->buckets - b, end;
        end = b + ((uint32_t)cells < most ? (uint32_t)cells : most);
        for (uint32_t i = g->begin[b]; i < g->begin[end]; i++) {
            float d2 = pbs_metric_d2(g->m, &g->sorted[i], at);
            best = d2 < best ? d2 : best;
        }
        x += (int)(end - b), cells -= (int)(end - b);
        for (; b < end; b++) best = list_d2(g, b, at, best);
    }
    return best;
}

static float all_d2(const pbs_near *g, const pbs_place *at) {
    float best = INFINITY;
    for (size_t i = 0; i < g->count; i++) {
        float d2 = pbs_metric_d2(g->m, &g->place[i], at);
        best = d2 < best ? d2 : best;
    }
    return best;
}

float pbs_near_d2(const pbs_near *g, const pbs_place *at) {
    float best = INFINITY;
    int c[3];
    corner_of(g, at->p, c);
    for (int ring = 0; ring < RINGS; ring++) {
        int x = c[0] - ring, wide = 2 + 2 * ring;
        for (int z = c[2] - ring; z <= c[2] + 1 + ring; z++)
            for (int y = c[1] - ring; y <= c[1] + 1 + ring; y++) {
                bool through =
                    z > c[2] - ring && z <= c[2] + ring && y > c[1] - ring && y <= c[1] + ring;
                /* Of rows through the rings before only the two ends are new. */
                best = row_d2(g, x, y, z, ring && through ? 1 : wide, at, best);
                if (ring && through) best = row_d2(g, x + wide - 1, y, z, 1, at, best);
            }
        /* 0.499 and not 0.5: the corner was found by rounding. */
        double reach = (0.499 + ring) * g->cell;
        if (best <= reach * reach) return best;
    }
    return all_d2(g, at);
}
