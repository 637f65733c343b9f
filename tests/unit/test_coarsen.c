/* Coarser levels against a plain one in double, and their laws: what is a parent, what it covers,
 * weight that is kept, what is constant stays, and that calls may be split anywhere. */
#include "libcore/surfels/candidates.h"
#include "libcore/voxels/coarsen_inner.h"
#include "libcore/data/srgb.h"
#include "tests/check.h"
#include "tests/unit/voxelset.h"

#define ALL (PBS_POSITION | PBS_NORMAL | PBS_WEIGHT | PBS_COLOUR | PBS_MATERIAL | PBS_EMISSIVE)

/* ---- what comes out ---- */

typedef struct taken {
    cells level[20];
    uint32_t chunk[20][3], done[20]; /* the chunk that is open; chunks that were */
    bool open[20], order, lists;
    bool has_faces;
} taken;

static void take_cell(taken *t, uint32_t l, const uint32_t chunk[3], const pbs_voxels *v, size_t i,
                      const uint32_t *faces, size_t face_count) {
    uint32_t p = v->place[i];
    cell *c = add_cell(&t->level[l], chunk[0] << 8 | (p & 255), chunk[1] << 8 | (p >> 8 & 255),
                       chunk[2] << 8 | (p >> 16 & 255));
    c->mask = p >> 24;
    c->normal = v->normal ? v->normal[i] : 0;
    c->weight = v->weight ? v->weight[i] : 0;
    c->colour = v->colour ? v->colour[i] : 0;
    c->material = v->material ? v->material[i] : 0;
    c->emissive = v->emissive ? v->emissive[i] : 0;
    if (!v->face) return;
    t->has_faces = true;
    size_t at = v->face[i];
    for (int f = 0; f < 6; f++) {
        if (!(c->mask >> f & 1)) continue;
        t->lists = t->lists && at < face_count;
        c->face[f] = at < face_count ? faces[at] : 0;
        at++;
    }
}

static pbs_code take(void *ctx, uint32_t l, const uint32_t chunk[3], const pbs_voxels *v,
                     const uint32_t *faces, size_t face_count, bool done, pbs_err *err) {
    taken *t = ctx;
    (void)err;
    if (t->open[l]) t->order = t->order && !memcmp(t->chunk[l], chunk, sizeof t->chunk[l]);
    /* Those above that are open hold it: children are done before their parents. */
    for (uint32_t up = l + 1; up < 20; up++)
        for (int k = 0; k < 3; k++)
            t->order = t->order && (!t->open[up] || t->chunk[up][k] == chunk[k] >> (up - l));
    memcpy(t->chunk[l], chunk, sizeof t->chunk[l]);
    t->open[l] = !done;
    t->done[l] += done;
    for (size_t i = 0; i < v->count; i++) take_cell(t, l, chunk, v, i, faces, face_count);
    return PBS_OK;
}

static void free_taken(taken *t) {
    for (int l = 0; l < 20; l++) free(t->level[l].cell);
}

/* Gives c to a coarsen in calls of about `split` voxels; 0: a call a chunk. */
static pbs_code run_coarsen(const cells *c, uint32_t channels, uint32_t levels, bool colour,
                            size_t split, taken *out, pbs_err *err) {
    pbs_run run = {.threads = 1};
    pbs_coarsen *made;
    pbs_coarsen_sink sink = {out, take};
    uint64_t seed = split;
    memset(out, 0, sizeof *out);
    out->order = out->lists = true;
    pbs_code rc = pbs_coarsen_new(&run, channels, levels, colour, &sink, &made, err);
    for (size_t i = 0, n, end = 0; i < c->count && !rc; i += n) {
        uint32_t chunk[3];
        if (i == end) end = chunk_end(c, i);
        n = end - i;
        if (split && n > 1) {
            size_t some = 1 + noise(&seed) % (2 * split);
            n = some < n ? some : n;
        }
        chunk_of(&c->cell[i], chunk);
        cell_arrays a = arrays_of(c->cell + i, n, channels);
        rc = pbs_coarsen_add(made, chunk, &a.v, a.faces, a.face_count, err);
        free_arrays(&a);
    }
    if (!rc) rc = pbs_coarsen_end(made, err);
    pbs_coarsen_free(made);
    CHECK_NUM(run.mem_used == 0, run.mem_used);
    for (int l = 0; l < 20; l++) CHECK(rc || !out->open[l]);
    return rc;
}

static void coarsen(const cells *c, uint32_t channels, uint32_t levels, bool colour, size_t split,
                    taken *out) {
    pbs_err err = {0};
    if (run_coarsen(c, channels, levels, colour, split, out, &err)) printf("# %s\n", err.text);
    CHECK(!err.code && out->order && out->lists);
}

static bool same_levels(const taken *a, const taken *b) {
    bool same = true;
    for (int l = 0; l < 20; l++)
        same = same && a->level[l].count == b->level[l].count && a->done[l] == b->done[l] &&
               (!a->level[l].count || !memcmp(a->level[l].cell, b->level[l].cell,
                                              a->level[l].count * sizeof *a->level[l].cell));
    return same;
}

/* ---- the same, in double ---- */

typedef struct plain {
    uint64_t code;
    uint32_t mask;
    double n[3], w, c[4], m[4], e[4];
    double face[7][5]; /* of each face, and of all: colour and weight */
    int32_t normal[3]; /* as it is given out */
    bool two, unsure;  /* too near to a limit for a float to be sure */
    double own;        /* weight of the heaviest child so far */
} plain;

static int32_t field10(uint32_t packed, int k) {
    int32_t v = (int32_t)(packed >> 10 * k & 1023);
    return v < 512 ? v : v - 1024;
}

static void linear(double out[4], uint32_t c, bool srgb, double w) {
    const pbs_srgb_table *t = pbs_srgb();
    for (int k = 0; k < 4; k++) {
        uint32_t v = c >> 8 * k & 255;
        out[k] = w * (srgb && k < 3 ? (double)t->linear[v] : v / 255.0);
    }
}

static plain *plain_of(const cells *c, uint32_t channels) {
    plain *p = calloc(c->count + 1, sizeof *p);
    for (size_t i = 0; i < c->count; i++) {
        const cell *v = &c->cell[i];
        p[i].code = v->code;
        p[i].mask = v->mask & 63;
        p[i].two = v->mask & PBS_VOXEL_TWO_SIDED;
        p[i].w = channels & PBS_WEIGHT ? v->weight : 1;
        for (int k = 0; k < 3; k++) {
            p[i].normal[k] = field10(v->normal, k);
            p[i].n[k] = p[i].w * p[i].normal[k];
        }
        linear(p[i].c, v->colour, true, p[i].w);
        linear(p[i].m, v->material, false, p[i].w);
        linear(p[i].e, v->emissive, true, p[i].w);
        for (int f = 0; f < 6; f++) {
            if (!(v->mask >> f & 1)) continue;
            linear(p[i].face[f], v->face[f], true, p[i].w);
            p[i].face[f][4] = p[i].w;
        }
        for (int f = 0; f < 6; f++)
            for (int k = 0; k < 5; k++) p[i].face[6][k] += p[i].face[f][k];
    }
    return p;
}

static void add_child(plain *p, const plain *c) {
    bool heavier = c->w > p->own;
    if (fabs(c->w - p->own) < 1e-5 * p->own) p->unsure = true;
    if (heavier) {
        memcpy(p->normal, c->normal, sizeof p->normal);
        p->two = c->two, p->own = c->w;
    }
    p->unsure |= c->unsure;
    p->mask |= c->mask;
    p->w += c->w;
    for (int k = 0; k < 3; k++) p->n[k] += c->n[k];
    for (int k = 0; k < 4; k++) p->c[k] += c->c[k], p->m[k] += c->m[k], p->e[k] += c->e[k];
    for (int f = 0; f < 7; f++)
        for (int k = 0; k < 5; k++) p->face[f][k] += c->face[f][k];
}

static void end_parent(plain *p) {
    double l = sqrt(p->n[0] * p->n[0] + p->n[1] * p->n[1] + p->n[2] * p->n[2]);
    double mean = l / (511 * p->w);
    p->unsure |= fabs(mean - PBS_COARSEN_THIN) < 1e-4;
    if (mean < PBS_COARSEN_THIN)
        p->two = true;
    else
        for (int k = 0; k < 3; k++) p->normal[k] = (int32_t)lrint(p->n[k] / l * 511);
    for (int k = 0; k < 3; k++) {
        uint32_t at = 0;
        for (int b = 0; b < 8; b++) at |= (uint32_t)(p->code >> (3 * b + k) & 1) << b;
        if (at == 0) p->mask |= 1u << 2 * k;
        if (at == 255) p->mask |= 2u << 2 * k;
    }
    /* A cap that no child has looks like all of them. */
    double all[5];
    memcpy(all, p->face[6], sizeof all);
    memset(p->face[6], 0, sizeof p->face[6]);
    for (int f = 0; f < 6; f++) {
        if (p->mask >> f & 1 && p->face[f][4] == 0) memcpy(p->face[f], all, sizeof all);
        for (int k = 0; k < 5; k++) p->face[6][k] += p->face[f][k];
    }
}

static size_t plain_parents(const plain *p, size_t n, plain *out) {
    size_t m = 0;
    for (size_t i = 0; i < n; m++) {
        memset(&out[m], 0, sizeof out[m]);
        out[m].code = p[i].code >> 3;
        out[m].own = -1;
        while (i < n && p[i].code >> 3 == out[m].code) add_child(&out[m], &p[i++]);
        end_parent(&out[m]);
    }
    return m;
}

static bool near_colour(const double sum[4], double w, uint32_t got, bool srgb) {
    for (int k = 0; k < 4; k++) {
        float v = (float)(sum[k] / w);
        int want = pbs_unorm8(srgb && k < 3 ? pbs_linear_to_srgb(v) : v);
        if (abs(want - (int)(got >> 8 * k & 255)) > 1) return false;
    }
    return true;
}

static bool same_cell(const plain *p, const cell *c, uint32_t channels, uint32_t l) {
    bool same = p->code == c->code && p->mask == (c->mask & 63);
    if (channels & PBS_NORMAL && !p->unsure) {
        same = same && p->two == !!(c->mask & PBS_VOXEL_TWO_SIDED);
        for (int k = 0; k < 3; k++) same = same && abs(p->normal[k] - field10(c->normal, k)) <= 1;
    }
    if (channels & PBS_WEIGHT) same = same && fabs(c->weight * pow(4, l) - p->w) <= 1e-5 * p->w;
    if (channels & PBS_COLOUR) same = same && near_colour(p->c, p->w, c->colour, true);
    if (channels & PBS_MATERIAL) same = same && near_colour(p->m, p->w, c->material, false);
    if (channels & PBS_EMISSIVE) same = same && near_colour(p->e, p->w, c->emissive, true);
    for (int f = 0; f < 6 && channels & PBS_FACE; f++) {
        if (!(p->mask >> f & 1)) continue;
        const double *from = p->face[f];
        if (from[4] > 0) same = same && near_colour(from, from[4], c->face[f], true);
    }
    return same;
}

static void compare(const cells *c, uint32_t channels, uint32_t levels) {
    taken t;
    coarsen(c, channels, levels, true, 0, &t);
    plain *p = plain_of(c, channels), *next = calloc(c->count + 1, sizeof *p);
    size_t n = c->count;
    for (uint32_t l = 1; l <= levels; l++) {
        n = plain_parents(p, n, next);
        size_t wrong = 0;
        CHECK_NUM(n == t.level[l].count, t.level[l].count);
        for (size_t i = 0; i < n && n == t.level[l].count; i++)
            wrong += !same_cell(&next[i], &t.level[l].cell[i], channels, l);
        CHECK_NUM(!wrong, wrong);
        plain *swap = p;
        p = next, next = swap;
    }
    free(p);
    free(next);
    free_taken(&t);
}

TEST(all_levels_are_those_of_a_plain_sum) {
    cells ball = shell(300, 140, 1), some = scatter(900, 10000, 2), few = scatter(65536, 3000, 3);
    const uint32_t channels[] = {ALL,
                                 ALL | PBS_FACE,
                                 PBS_POSITION,
                                 PBS_POSITION | PBS_NORMAL,
                                 PBS_POSITION | PBS_NORMAL | PBS_WEIGHT,
                                 PBS_POSITION | PBS_WEIGHT | PBS_COLOUR,
                                 PBS_POSITION | PBS_EMISSIVE,
                                 PBS_POSITION | PBS_FACE};
    for (size_t i = 0; i < sizeof channels / sizeof *channels; i++) {
        compare(&some, channels[i], 10);
        compare(&few, channels[i], 16);
        if (i == 1) compare(&ball, channels[i], 10);
    }
    free(ball.cell), free(some.cell), free(few.cell);
}

/* ---- laws ---- */

static double total(const cells *c, uint32_t l) {
    double sum = 0;
    for (size_t i = 0; i < c->count; i++) sum += c->cell[i].weight * pow(4, l);
    return sum;
}

TEST(parents_cover_children_and_nothing_else) {
    cells c = shell(300, 145, 5);
    taken t;
    coarsen(&c, ALL, 9, false, 0, &t);
    const cells *fine = &c;
    for (uint32_t l = 1; l <= 9; l++) {
        const cells *up = &t.level[l];
        size_t p = 0, bare = 0, used = 0, disorder = 0;
        for (size_t i = 0; i < fine->count; i++) {
            size_t before = p;
            while (p < up->count && up->cell[p].code < fine->cell[i].code >> 3) p++;
            used += !i || p != before;
            bare += p == up->count || up->cell[p].code != fine->cell[i].code >> 3 ||
                    fine->cell[i].mask & 63 & ~up->cell[p].mask;
        }
        for (size_t i = 1; i < up->count; i++) disorder += up->cell[i].code <= up->cell[i - 1].code;
        CHECK_NUM(!bare, bare);
        CHECK_NUM(used == up->count, used);
        CHECK_NUM(!disorder, disorder);
        CHECK_NUM(fabs(total(up, l) / total(&c, 0) - 1) < 1e-5, total(up, l));
        fine = up;
    }
    CHECK_NUM(t.level[9].count == 1, t.level[9].count);
    free_taken(&t);
    free(c.cell);
}

TEST(what_is_constant_stays_exactly) {
    uint64_t seed = 4;
    for (int round = 0; round < 20; round++) {
        cells c = scatter(400, 2000, 10 + (uint64_t)round);
        float n[3];
        for (int k = 0; k < 3; k++) n[k] = (float)(noise(&seed) >> 8) - 0x1p23f;
        uint32_t normal = pbs_normal10_put(n), colour = noise(&seed), material = noise(&seed),
                 emissive = noise(&seed);
        for (size_t i = 0; i < c.count; i++) {
            cell *v = &c.cell[i];
            v->normal = normal, v->colour = colour, v->material = material, v->emissive = emissive;
            v->mask &= 63;
            if (round % 2) v->weight = ldexpf(v->weight, (int)(noise(&seed) % 30) - 25);
            for (int f = 0; f < 6; f++) v->face[f] = colour;
        }
        taken t;
        size_t other = 0;
        coarsen(&c, ALL | PBS_FACE, 9, round % 3, 0, &t);
        for (uint32_t l = 1; l <= 9; l++)
            for (size_t i = 0; i < t.level[l].count; i++) {
                const cell *v = &t.level[l].cell[i];
                other += v->normal != normal || v->colour != colour || v->material != material ||
                         v->emissive != emissive || v->mask >> 6;
                for (int f = 0; f < 6; f++) other += v->mask >> f & 1 && v->face[f] != colour;
            }
        CHECK_NUM(!other, other);
        free_taken(&t);
        free(c.cell);
    }
}

TEST(calls_may_be_split_anywhere) {
    cells c = shell(150, 70, 6), some = scatter(700, 10000, 7);
    const cells *set[] = {&c, &some};
    for (int s = 0; s < 2; s++) {
        taken whole;
        coarsen(set[s], ALL | PBS_FACE, 10, true, 0, &whole);
        const size_t splits[] = {1, 3, 100, 2048, 5000};
        for (int k = 0; k < 5; k++) {
            taken t;
            coarsen(set[s], ALL | PBS_FACE, 10, true, splits[k], &t);
            CHECK(same_levels(&whole, &t));
            free_taken(&t);
        }
        free_taken(&whole);
    }
    free(c.cell), free(some.cell);
}

/* Six-connected from the corner of a grid through cells that are no voxels: the ones it meets. */
static bool reaches_middle(const cells *c, uint32_t side) {
    uint32_t n = side + 2, middle = n / 2;
    uint8_t *state = calloc((size_t)n * n * n, 1);
    uint32_t *stack = malloc(sizeof *stack * n * n * n);
    size_t top = 0;
    for (size_t i = 0; i < c->count; i++) {
        const uint32_t *a = c->cell[i].at;
        state[((size_t)(a[2] + 1) * n + a[1] + 1) * n + a[0] + 1] = 1;
    }
    state[0] = 2, stack[top++] = 0;
    while (top) {
        uint32_t i = stack[--top], at[3] = {i % n, i / n % n, i / n / n}, step[3] = {1, n, n * n};
        for (int f = 0; f < 6; f++) {
            int k = f / 2;
            if (f & 1 ? at[k] + 1 == n : at[k] == 0) continue;
            uint32_t next = f & 1 ? i + step[k] : i - step[k];
            if (!state[next]) state[next] = 2, stack[top++] = next;
        }
    }
    bool through = state[((size_t)middle * n + middle) * n + middle] == 2;
    free(state), free(stack);
    return through;
}

TEST(parents_of_a_separating_shell_separate) {
    cells c = shell(128, 50, 8);
    taken t;
    coarsen(&c, PBS_POSITION, 5, false, 0, &t);
    CHECK(!reaches_middle(&c, 128));
    for (uint32_t l = 1; l <= 4; l++) CHECK_NUM(!reaches_middle(&t.level[l], 128 >> l), l);
    c.count -= 1;
    memmove(c.cell + 10000, c.cell + 10001, (c.count - 10000) * sizeof *c.cell);
    CHECK(reaches_middle(&c, 128)); /* a hole would be seen */
    free_taken(&t);
    free(c.cell);
}

/* ---- normals that vanish ---- */

static void put(cells *c, uint32_t x, float nx, float nz, float w, uint32_t mask) {
    const float n[3] = {nx, 0, nz};
    cell *v = add_cell(c, x, 20, 20);
    v->normal = pbs_normal10_put(n), v->weight = w, v->mask = mask;
}

TEST(a_short_mean_is_two_sided_and_has_the_normal_of_the_heaviest) {
    cells c = {.size = 64};
    const uint32_t two = PBS_VOXEL_TWO_SIDED;
    put(&c, 0, 0, 1, 1, 1), put(&c, 1, 0, -1, 1, 2);          /* none heavier: the first */
    put(&c, 2, 0, 1, 1, 1), put(&c, 3, 0, -1, 1.5f, 2);       /* the heavier */
    put(&c, 4, 0, 1, 1, 1), put(&c, 5, 1, 0, 1, 2);           /* long enough: the mean */
    put(&c, 6, 0, 1, 2, 1), put(&c, 7, 1, 0, 1, two);         /* heaviest one-sided */
    put(&c, 8, 0, 1, 1, 1), put(&c, 9, 1, 0, 2, two);         /* heaviest two-sided */
    put(&c, 10, 0, 1, 0, 1), put(&c, 11, 1, 0, 0, 1);         /* no weight at all */
    put(&c, 12, 0, 1, 1e-44f, 1), put(&c, 13, 0, 1, 0, 1);    /* hardly any */
    put(&c, 14, 0, 1, 3e38f, 1), put(&c, 15, 0, 1, 3e38f, 1); /* more than a float holds */
    sort_cells(&c);
    taken t;
    coarsen(&c, ALL, 1, false, 0, &t);
    const float up[3] = {0, 0, 1}, down[3] = {0, 0, -1}, between[3] = {1, 0, 1};
    const cell *v = t.level[1].cell;
    uint32_t u = pbs_normal10_put(up);
    CHECK(t.level[1].count == 8);
    CHECK(v[0].normal == u && v[0].mask == (two | 3 | 1));
    CHECK(v[1].normal == pbs_normal10_put(down) && v[1].mask == (two | 3));
    CHECK(v[2].normal == pbs_normal10_put(between) && v[2].mask == 3);
    CHECK(v[3].mask == 1);
    CHECK(v[4].mask == (two | 1));
    CHECK(v[5].normal == u && v[5].mask == (two | 1));
    CHECK(v[6].normal == u && v[6].mask == 1);
    CHECK(v[7].normal == u);
    free_taken(&t);
    free(c.cell);
}

/* The id with the largest sum of weights, ties to the lower one; a cap that no child has takes all
 * faces. */
TEST(materials_of_faces_are_voted) {
    cells c = {.size = 64};
    const uint32_t id[8] = {7, 3, 3, 7, 9, 9, 9, 1};
    for (uint32_t i = 0; i < 8; i++) {
        cell *v = add_cell(&c, 2 + (i & 1), 2 + (i >> 1 & 1), 2 + (i >> 2));
        v->mask = i < 4 ? PBS_FACE_X0 : PBS_FACE_Z1;
        v->face[i < 4 ? 0 : 5] = id[i];
    }
    cell *border = add_cell(&c, 0, 2, 2);
    border->mask = PBS_FACE_Y0, border->face[2] = 4;
    sort_cells(&c);
    taken t;
    coarsen(&c, PBS_POSITION | PBS_FACE, 1, false, 0, &t);
    CHECK(t.level[1].count == 2);
    const cell *v = t.level[1].cell;
    CHECK(v[0].mask == (PBS_FACE_X0 | PBS_FACE_Y0) && v[0].face[0] == 4 && v[0].face[2] == 4);
    CHECK(v[1].mask == (PBS_FACE_X0 | PBS_FACE_Z1));
    CHECK_NUM(v[1].face[0] == 3, v[1].face[0]);
    CHECK_NUM(v[1].face[5] == 9, v[1].face[5]);
    free_taken(&t);
    free(c.cell);
}

/* ---- with AVX2 and without ---- */

enum { STEP_ROOM = PBS_COARSEN_BLOCK + PBS_COARSEN_SLACK };

static pbs_cell_rows step_rows(void) {
    pbs_cell_rows r = {0};
    uint32_t **a[] = {&r.v.place, &r.v.normal, &r.v.colour, &r.v.material, &r.v.emissive};
    for (int i = 0; i < 5; i++) *a[i] = calloc(STEP_ROOM, 4);
    r.v.weight = calloc(STEP_ROOM, 4);
    for (int i = 0; i < PBS_SUMS; i++) r.sum[i] = aligned_alloc(64, STEP_ROOM * sizeof *r.sum[i]);
    return r;
}

static void free_rows(pbs_cell_rows *r) {
    free(r->v.place), free(r->v.normal), free(r->v.colour), free(r->v.material);
    free(r->v.emissive), free(r->v.weight);
    for (int i = 0; i < PBS_SUMS; i++) free(r->sum[i]);
}

static bool same_rows(const pbs_cell_rows *a, const pbs_cell_rows *b, size_t n) {
    bool same =
        !memcmp(a->v.place, b->v.place, 4 * n) && !memcmp(a->v.normal, b->v.normal, 4 * n) &&
        !memcmp(a->v.weight, b->v.weight, 4 * n) && !memcmp(a->v.colour, b->v.colour, 4 * n) &&
        !memcmp(a->v.material, b->v.material, 4 * n) &&
        !memcmp(a->v.emissive, b->v.emissive, 4 * n);
    for (int i = 0; i < PBS_SUMS; i++)
        same = same && !memcmp(a->sum[i], b->sum[i], n * sizeof *a->sum[i]);
    return same;
}

TEST(avx2_gives_the_same_bits) {
#if defined(__x86_64__)
    if (!pbs_cpu_has_avx2()) SKIP("no AVX2 here");
    cells c = scatter(20, 2000, 21);
    cell_arrays a = arrays_of(c.cell, c.count, ALL);
    pbs_coarsen_block *b = aligned_alloc(64, (sizeof *b + 63) / 64 * 64);
    pbs_cell_rows in = {.v = a.v}, slow[2] = {step_rows(), step_rows()},
                  fast[2] = {step_rows(), step_rows()};
    memset(b, 0, sizeof *b);
    b->channels = ALL, b->weight_scale = 0.25f, b->srgb = pbs_srgb();
    size_t n = coarsen_step(b, &in, c.count, &slow[0]);
    CHECK(n > 100 && n != SIZE_MAX);
    CHECK(pbs_coarsen_step_avx2(b, &in, c.count, &fast[0]) == n);
    CHECK(same_rows(&slow[0], &fast[0], n));
    size_t up = coarsen_step(b, &slow[0], n, &slow[1]);
    CHECK(pbs_coarsen_step_avx2(b, &fast[0], n, &fast[1]) == up && up != SIZE_MAX);
    CHECK(same_rows(&slow[1], &fast[1], up));
    for (int i = 0; i < 2; i++) free_rows(&slow[i]), free_rows(&fast[i]);
    free(b), free_arrays(&a), free(c.cell);
#else
    SKIP("another processor");
#endif
}

/* ---- what is wrong ---- */

TEST(what_is_not_in_order_is_an_error) {
    uint64_t seed = 12;
    for (int round = 0; round < 200; round++) {
        cells c = scatter(round % 2 ? 700 : 40, 400, 100 + (uint64_t)round);
        size_t i = noise(&seed) % c.count, k = noise(&seed) % c.count;
        pbs_err err = {0};
        taken t;
        cell swap = c.cell[i];
        if (round % 3)
            c.cell[i] = c.cell[k], c.cell[k] = swap;
        else
            c.cell[i] = c.cell[i ? i - 1 : 1]; /* twice */
        if (i == k) {
            free(c.cell);
            continue;
        }
        pbs_code rc =
            run_coarsen(&c, ALL, 1 + (uint32_t)round % 10, false, (size_t)round % 5, &t, &err);
        CHECK_NUM(rc == PBS_DATA, rc);
        free_taken(&t);
        free(c.cell);
    }
}

TEST(lists_that_end_too_early_are_an_error) {
    cells c = scatter(40, 400, 3);
    pbs_run run = {.threads = 1};
    for (int waits = 0; waits < 2; waits++) {
        taken t = {.order = true};
        pbs_coarsen *made;
        pbs_coarsen_sink sink = {&t, take};
        pbs_err err = {0};
        const uint32_t chunk[3] = {0, 0, 0};
        cell_arrays a = arrays_of(c.cell, c.count, PBS_POSITION | PBS_FACE);
        if (waits) a.v.face[a.v.count - 1] = UINT32_MAX - 2;
        CHECK(!pbs_coarsen_new(&run, PBS_POSITION | PBS_FACE, 3, false, &sink, &made, &err));
        CHECK(pbs_coarsen_add(made, chunk, &a.v, a.faces, waits ? a.face_count : 20, &err) ==
              PBS_DATA);
        pbs_coarsen_free(made);
        free_arrays(&a);
        free_taken(&t);
    }
    free(c.cell);
}

TEST(nothing_makes_nothing) {
    cells none = {.size = 9};
    taken t;
    coarsen(&none, ALL, 5, false, 0, &t);
    for (int l = 0; l < 20; l++) CHECK(!t.level[l].count && !t.done[l]);
    cells one = scatter(9, 1, 1);
    coarsen(&one, ALL, 0, false, 0, &t);
    CHECK(!t.done[0] && !t.done[1]);
    free(one.cell);
}

TEST_MAIN
