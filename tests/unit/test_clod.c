/* Levels of point clouds: every point once, no two of a level or coarser ones nearer than its
 * spacing wherever the borders of cells are, levels as full as they can be, the same for any number
 * of threads; colours against the filtered truth; hostile clouds. */
#include "libcore/clouds/clod.h"
#include "libcore/data/quant.h"
#include "libcore/data/srgb.h"
#include "libcore/data/vec.h"
#include "tests/check.h"
#include <math.h>

static pbs_err err;
static uint32_t piece; /* of what is left of cells; 0: as usual */

typedef struct cloud {
    pbs_clod_raw *raw; /* as it came in */
    size_t count;
    int bits;
    /* as it came out */
    size_t cells;
    uint32_t (*q)[3];
    int8_t *k;
    uint8_t (*colour)[4];
} cloud;

static uint64_t state = 1;
static double chance(void) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (double)(state >> 11) / 9007199254740992.0;
}

static cloud cloud_new(size_t n, int bits) {
    cloud c = {.count = n, .bits = bits};
    c.raw = calloc(n, sizeof *c.raw);
    c.q = calloc(n, sizeof *c.q);
    c.k = calloc(n, sizeof *c.k);
    c.colour = calloc(n, sizeof *c.colour);
    return c;
}
static void cloud_free(cloud *c) {
    free(c->raw);
    free(c->q);
    free(c->k);
    free(c->colour);
}

static void take_cell(cloud *c, pbs_clod_raw *points, const pbs_clod_cell *cell, size_t *n) {
    const pbs_clod_point *p = (const void *)((const char *)points + pbs_clod_at(cell));
    uint64_t i = 0;
    for (int k = PBS_CLOD_LEVELS - 1; k >= -1; k--)
        for (uint64_t end = i + pbs_clod_of_level(cell, k); i < end; i++, (*n)++) {
            for (int a = 0; a < 3; a++) {
                c->q[*n][a] = cell->origin[a] + p[i].q[a];
                CHECK(c->q[*n][a] >= cell->low[a] && c->q[*n][a] <= cell->high[a]);
            }
            c->k[*n] = (int8_t)k;
            CHECK(p[i].spacing == pbs_clod_spacing(k));
            memcpy(c->colour[*n], p[i].colour, 4);
        }
    CHECK(i == cell->count);
}

static void take_upper(cloud *c, const pbs_clod_cells *cells, const pbs_clod_upper *u,
                       const size_t *begin) {
    for (size_t i = 0; i < cells->count; i++)
        for (size_t r = u->first[i]; r < u->first[i + 1]; r++) {
            size_t at = begin[i] + (r - u->first[i]);
            CHECK(!memcmp(c->q[at], u->rest[r].q, sizeof c->q[at]));
            CHECK(c->k[at] == pbs_clod_top(&cells->cell[i]) && u->rest[r].level >= c->k[at]);
            c->k[at] = u->rest[r].level;
            if (u->rest[r].sum[3] > 0) pbs_clod_rest_colour(&u->rest[r], c->colour[at]);
        }
}

static pbs_code read_memory(void *ctx, uint64_t at, size_t size, void *to, pbs_err *e) {
    (void)e;
    memcpy(to, (char *)ctx + at, size);
    return PBS_OK;
}
static pbs_code write_memory(void *ctx, uint64_t at, size_t size, const void *from, pbs_err *e) {
    (void)e;
    memcpy((char *)ctx + at, from, size);
    return PBS_OK;
}

/* Counts, cuts, thins, and collects what came out. */
static void levels(cloud *c, int threads, bool colours) {
    pbs_run run = {.threads = threads};
    pbs_clod_grid g;
    pbs_clod_cells cells = {0};
    pbs_clod_upper u;
    int depth = c->bits < 4 ? c->bits : 4;
    cells.piece = piece;
    pbs_clod_raw *p = malloc((c->count + 1) * sizeof *p), *from = c->raw;
    CHECK(!pbs_clod_grid_new(&run, c->bits, depth, &g, &err));
    for (size_t i = 0; i < c->count; i++) g.count[pbs_clod_place(&g, from[i].q)]++;
    CHECK(!pbs_clod_cells_of(&run, &g, 0, &cells, &err));
    uint64_t *at = calloc(cells.count + 1, sizeof *at);
    for (size_t i = 0; i < cells.count; i++) at[i] = cells.cell[i].first;
    for (size_t i = 0; i < c->count; i++) p[at[g.cell[pbs_clod_place(&g, from[i].q)]]++] = from[i];
    CHECK(!pbs_clod_cut(&run, p, &cells, NULL, NULL, &err));
    const pbs_clod_store store = {p, read_memory, write_memory, NULL, NULL};
    CHECK(!pbs_clod_thin(&run, &store, &cells, colours, &err));
    int top = c->bits > 3 ? c->bits - 3 : 0;
    CHECK(!pbs_clod_thin_upper(&run, &store, &cells, top, colours, &u, &err));
    size_t n = 0, *begin = calloc(cells.count + 1, sizeof *begin);
    for (size_t i = 0; i < cells.count; i++) begin[i] = n, take_cell(c, p, &cells.cell[i], &n);
    CHECK(n == c->count);
    take_upper(c, &cells, &u, begin);
    c->cells = cells.count;
    free(at);
    free(begin);
    free(p);
    pbs_clod_upper_free(&run, &u);
    pbs_clod_cells_free(&run, &cells);
    pbs_clod_grid_free(&run, &g);
    CHECK_NUM(!run.mem_used, run.mem_used);
}

/* ---- a grid of cells that are as wide as a distance ---- */

typedef struct near_grid {
    const cloud *c;
    int shift;
    uint32_t *head, *next, mask;
} near_grid;

static uint32_t grid_slot(const near_grid *g, int64_t x, int64_t y, int64_t z) {
    return ((uint32_t)x * 73856093u ^ (uint32_t)y * 19349663u ^ (uint32_t)z * 83492791u) & g->mask;
}

static near_grid grid_of(const cloud *c, int shift, int least) {
    near_grid g = {.c = c, .shift = shift, .mask = (1u << 18) - 1};
    g.head = calloc(g.mask + 1, sizeof *g.head);
    g.next = calloc(c->count + 1, sizeof *g.next);
    for (size_t i = 0; i < c->count; i++) {
        if (c->k[i] < least) continue;
        uint32_t s = grid_slot(&g, c->q[i][0] >> shift, c->q[i][1] >> shift, c->q[i][2] >> shift);
        g.next[i] = g.head[s];
        g.head[s] = (uint32_t)i + 1;
    }
    return g;
}

static double distance2(const cloud *c, size_t i, size_t j) {
    double d2 = 0;
    for (int a = 0; a < 3; a++) {
        double d = (double)c->q[i][a] - (double)c->q[j][a];
        d2 += d * d;
    }
    return d2;
}

/* To the nearest other one in the grid, if that is within its width. */
static double nearest2(const near_grid *g, size_t i) {
    double best = INFINITY;
    for (int n = 0; n < 27; n++) {
        int64_t at[3] = {(g->c->q[i][0] >> g->shift) + n % 3 - 1,
                         (g->c->q[i][1] >> g->shift) + n / 3 % 3 - 1,
                         (g->c->q[i][2] >> g->shift) + n / 9 - 1};
        for (uint32_t j = g->head[grid_slot(g, at[0], at[1], at[2])]; j; j = g->next[j - 1])
            if (j - 1 != i) best = fmin(best, distance2(g->c, i, j - 1));
    }
    return best;
}
static void grid_free(near_grid *g) {
    free(g->head);
    free(g->next);
}

static int compare(const void *a, const void *b) {
    return memcmp(a, b, sizeof(uint32_t[3]));
}

static void check_same_points(const cloud *c) {
    uint32_t(*a)[3] = malloc((c->count + 1) * sizeof *a),
    (*b)[3] = malloc((c->count + 1) * sizeof *b);
    for (size_t i = 0; i < c->count; i++)
        memcpy(a[i], c->raw[i].q, sizeof *a), memcpy(b[i], c->q[i], sizeof *b);
    qsort(a, c->count, sizeof *a, compare);
    qsort(b, c->count, sizeof *b, compare);
    CHECK(!memcmp(a, b, c->count * sizeof *a));
    size_t places = 0, levelled = 0;
    for (size_t i = 0; i < c->count; i++) {
        places += !i || memcmp(a[i], a[i - 1], sizeof *a);
        levelled += c->k[i] >= 0;
    }
    CHECK_NUM(places == levelled, (double)levelled - (double)places);
    free(a);
    free(b);
}

/* The promise, for every level; and that of `full` of the points that a level lacks one of it is
 * within its spacing. */
static void check_levels(const cloud *c, double full) {
    check_same_points(c);
    for (int k = 0; k <= (c->bits > 3 ? c->bits - 3 : 0); k++) {
        near_grid g = grid_of(c, k, k);
        size_t bad = 0, absent = 0, far = 0;
        for (size_t i = 0; i < c->count; i++) {
            if (c->k[i] >= k)
                bad += nearest2(&g, i) < ldexp(1, 2 * k);
            else if (k && i % 16 == 0)
                absent++, far += nearest2(&g, i) >= ldexp(1, 2 * k);
        }
        CHECK_NUM(bad == 0, bad);
        CHECK_NUM((double)far <= (1 - full) * (double)absent, (double)far / (double)absent);
        grid_free(&g);
    }
}

/* ---- clouds ---- */

static void put(cloud *c, size_t i, double x, double y, double z) {
    double side = ldexp(1, c->bits) - 1, v[3] = {x, y, z};
    for (int a = 0; a < 3; a++) c->raw[i].q[a] = (uint32_t)fmin(fmax(floor(v[a]), 0), side);
    for (int a = 0; a < 3; a++) c->raw[i].colour[a] = (uint8_t)(128 + 127 * sin(v[a] / side * 30));
    c->raw[i].colour[3] = 255;
}

static cloud terrain(size_t n, int bits) {
    cloud c = cloud_new(n, bits);
    double side = ldexp(1, bits);
    for (size_t i = 0; i < n; i++) {
        double x = chance(), y = chance();
        put(&c, i, x * side, y * side, side * (0.5 + 0.1 * sin(9 * x) * cos(7 * y)));
    }
    return c;
}

TEST(a_terrain_of_many_cells) {
    cloud c = terrain(100000, 17);
    levels(&c, 1, true);
    CHECK_NUM(c.cells > 3, c.cells);
    check_levels(&c, 0.9);
    cloud_free(&c);
}

TEST(a_volume) {
    cloud c = cloud_new(80000, 11);
    for (size_t i = 0; i < c.count; i++)
        put(&c, i, 2048 * chance(), 2048 * chance(), 2048 * chance());
    levels(&c, 1, false);
    CHECK_NUM(c.cells > 7, c.cells);
    check_levels(&c, 0.9);
    cloud_free(&c);
}

/* Half of the points in a part that is a millionth of the area: cells of very different sizes. */
TEST(density_that_varies_by_a_million) {
    cloud c = cloud_new(160000, 20);
    double side = ldexp(1, 20);
    for (size_t i = 0; i < c.count; i++) {
        double s = i % 2 ? 1 : i % 4 ? 0.03 : 0.001;
        put(&c, i, side * (0.6 + (chance() - 0.6) * s), side * (0.4 + (chance() - 0.4) * s),
            side * 0.5 + 40 * chance());
    }
    levels(&c, 1, true);
    CHECK_NUM(c.cells > 12, c.cells);
    check_levels(&c, 0.9);
    cloud_free(&c);
}

TEST(the_same_for_any_number_of_threads) {
    cloud a = terrain(100000, 18), b = a;
    b.q = malloc(a.count * sizeof *b.q);
    b.k = malloc(a.count * sizeof *b.k);
    b.colour = malloc(a.count * sizeof *b.colour);
    levels(&a, 1, true);
    levels(&b, 3, true);
    CHECK(a.cells == b.cells && !memcmp(a.q, b.q, a.count * sizeof *a.q));
    CHECK(!memcmp(a.k, b.k, a.count) && !memcmp(a.colour, b.colour, a.count * sizeof *a.colour));
    free(b.q);
    free(b.k);
    free(b.colour);
    cloud_free(&a);
}

/* What is left of many cells, in cubes: of all sizes, down to one point. */
TEST(what_is_left_in_cubes) {
    const uint32_t sizes[] = {700, 40, 1};
    for (size_t i = 0; i < 3; i++) {
        cloud c = terrain(3000, 24);
        piece = sizes[i];
        levels(&c, 1, true);
        CHECK_NUM(c.cells > 300, c.cells);
        check_levels(&c, 0.9);
        cloud_free(&c);
    }
    piece = 0;
}

TEST(few_points_and_one) {
    for (size_t n = 1; n < 40; n += 3)
        for (int bits = 0; bits < 31; bits += 3) {
            cloud c = cloud_new(n, bits);
            double side = ldexp(1, bits);
            for (size_t i = 0; i < n; i++)
                put(&c, i, side * chance(), side * chance(), side * chance());
            levels(&c, 1, n % 2);
            check_levels(&c, 0);
            cloud_free(&c);
        }
}

TEST(all_points_at_one_place) {
    cloud c = cloud_new(300000, 20);
    for (size_t i = 0; i < c.count; i++)
        put(&c, i, 12345, 777, 99), c.raw[i].colour[0] = i % 2 ? 255 : 0;
    levels(&c, 1, true);
    size_t levelled = 0, at = 0;
    for (size_t i = 0; i < c.count; i++)
        if (c.k[i] >= 0) levelled++, at = i;
    CHECK_NUM(levelled == 1 && c.k[at] == 17, c.k[at]);
    CHECK_NUM(abs(c.colour[at][0] - 188) <= 1, c.colour[at][0]); /* half the light */
    check_same_points(&c);
    cloud_free(&c);
}

/* Each of 700 places a thousand times, some more than a cell takes. */
TEST(duplicates) {
    cloud c = cloud_new(700000, 16);
    for (size_t i = 0; i < c.count; i++) {
        size_t p = i % 7 ? i / 1000 : 3;
        put(&c, i, (double)(p * 7919 % 65536), (double)(p * 104729 % 65536), 5);
    }
    levels(&c, 1, false);
    check_same_points(&c);
    cloud_free(&c);
}

TEST(a_line_and_a_lattice) {
    cloud c = cloud_new(40000, 18);
    for (size_t i = 0; i < c.count; i++) put(&c, i, (double)i, 3, 3);
    levels(&c, 1, false);
    check_levels(&c, 0.8);
    cloud_free(&c);
    c = cloud_new(256 * 256, 12);
    for (size_t i = 0; i < c.count; i++)
        put(&c, i, 16 * (double)(i % 256), 16 * (double)(i / 256), 0);
    levels(&c, 1, false);
    size_t fine = 0;
    for (size_t i = 0; i < c.count; i++) fine += c.k[i] < 4;
    CHECK_NUM(fine == 0, fine); /* nothing is nearer than 16 to anything */
    check_levels(&c, 0.9);
    cloud_free(&c);
}

/* One point far away must not spoil the cells of the others. */
TEST(an_outlier) {
    cloud c = terrain(70000, 12);
    c.bits = 31;
    memset(c.raw[0].q, 0x7f, sizeof c.raw[0].q);
    levels(&c, 1, false);
    check_levels(&c, 0.9);
    cloud_free(&c);
}

/* Colours of a level against the mean of all points within its spacing, weighted by the square of
 * the distance, in linear light; beside it plain picking. Root mean squares in steps of sRGB. */
static void colour_errors(const cloud *c, int k, double *mean, double *picked) {
    const float *linear = pbs_srgb()->linear;
    near_grid g = grid_of(c, k, -1);
    double a = 0, b = 0, n = 0;
    for (size_t i = 0; i < c->count; i++) {
        if (c->k[i] != k) continue;
        double sum = 0, weight = 0, own = 0;
        for (int m = 0; m < 27; m++) {
            int64_t at[3] = {(c->q[i][0] >> k) + m % 3 - 1, (c->q[i][1] >> k) + m / 3 % 3 - 1,
                             (c->q[i][2] >> k) + m / 9 - 1};
            for (uint32_t j = g.head[grid_slot(&g, at[0], at[1], at[2])]; j; j = g.next[j - 1]) {
                double d2 = distance2(c, i, j - 1) * ldexp(1, -2 * k);
                if (d2 >= 1) continue;
                double v = (double)linear[c->raw[j - 1].colour[0]];
                sum += (1 - d2) * v, weight += 1 - d2;
            }
        }
        own = c->raw[i].colour[0];
        double truth = 255 * (double)pbs_linear_to_srgb((float)(sum / weight));
        a += (c->colour[i][0] - truth) * (c->colour[i][0] - truth);
        b += (own - truth) * (own - truth);
        n++;
    }
    *mean = sqrt(a / n), *picked = sqrt(b / n);
    grid_free(&g);
}

static void check_colours(bool checker) {
    cloud in = terrain(100000, 16);
    for (size_t i = 0; i < in.count; i++) {
        double x = in.raw[i].q[0], y = in.raw[i].q[1];
        in.raw[i].colour[0] =
            checker ? ((in.raw[i].q[0] / 500 + in.raw[i].q[1] / 500) % 2 ? 250 : 20)
                    : (uint8_t)(128 + 60 * sin(x / 700) + 60 * sin(y / 900 + x / 3000));
    }
    levels(&in, 1, true);
    /* In the order that came out, to have both colours of a point. */
    cloud c = in;
    c.raw = malloc(c.count * sizeof *c.raw);
    for (size_t i = 0; i < c.count; i++) {
        double x = c.q[i][0], y = c.q[i][1];
        c.raw[i].colour[0] =
            checker ? ((c.q[i][0] / 500 + c.q[i][1] / 500) % 2 ? 250 : 20)
                    : (uint8_t)(128 + 60 * sin(x / 700) + 60 * sin(y / 900 + x / 3000));
    }
    for (int k = 9; k <= 11; k++) {
        double mean, picked;
        colour_errors(&c, k, &mean, &picked);
        /* The first level that has means gets each colour once, at the nearest. */
        double most = k == 9 ? (checker ? 0.3 : 0.85) : (checker ? 0.1 : 0.6);
        CHECK_NUM(mean < most * picked, mean / picked);
    }
    free(c.raw);
    cloud_free(&in);
}

TEST(colours_of_smooth_imagery) {
    check_colours(false);
}
TEST(colours_of_a_checker) {
    check_colours(true);
}

TEST(spacings_are_their_half_floats) {
    for (int k = 0; k <= 31; k++)
        CHECK_NUM(pbs_half_get(pbs_clod_spacing(k)) == ldexpf(1, k - 16), k);
    CHECK(pbs_clod_spacing(-1) == 0);
}

TEST_MAIN
