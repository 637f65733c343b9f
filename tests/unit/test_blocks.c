/* The walk over blocks against brute force: every triangle near a block is visited once for each
 * placing, whatever the memory; the box of a scene; which side of parts is out. */
#include "formats/blocks.h"
#include "formats/dag.h"
#include "libcore/pipe.h"
#include "tests/check.h"
#include "tests/unit/scenes.h"

static double chance(uint64_t *state) {
    return random_bits(state) / 4294967296.0;
}
static double between(uint64_t *state, double a, double b) {
    return a + (b - a) * chance(state);
}

/* ---- parts ---- */

static void put_triangle(const maker *m, const double p[3][3]) {
    pbs_corner c[3];
    memset(c, 0, sizeof c);
    for (int i = 0; i < 3; i++) memcpy(c[i].position, p[i], sizeof c[i].position);
    must(m->s->triangle(m->s->ctx, c, PBS_NONE, &err), &err);
}

static void begin_part(const maker *m, double x, double y, double z) {
    const double origin[3] = {x, y, z};
    must(m->s->part_begin(m->s->ctx, "", origin, 0, &err), &err);
}

static uint32_t end_part(const maker *m) {
    uint32_t node;
    must(m->s->part_end(m->s->ctx, &node, &err), &err);
    return node;
}

static uint32_t soup(const maker *m, uint32_t triangles, double size, const double origin[3],
                     uint64_t *seed) {
    begin_part(m, origin[0], origin[1], origin[2]);
    for (uint32_t t = 0; t < triangles; t++) {
        double at[3], p[3][3], reach = t % 50 ? 0.1 : 1;
        for (int k = 0; k < 3; k++) at[k] = between(seed, -1, 1);
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                p[i][k] = origin[k] + size * (at[k] + reach * between(seed, -1, 1));
        put_triangle(m, p);
    }
    return end_part(m);
}

enum { WHOLE = 1 << 0, TURNED = 1 << 1, HALF_ONE = 1 << 2, HALF_TWO = 1 << 3 };

/* 12 triangles from low to high on each axis; those of one half of its faces, or all. */
static void put_cube(const maker *m, double low, double high, unsigned which) {
    for (int f = 0; f < 6; f++) {
        int k = f / 2, up = f % 2;
        bool wanted = which & WHOLE || (f < 3 ? which & HALF_ONE : which & HALF_TWO);
        double c[4][3];
        for (int i = 0; i < 4 && wanted; i++) {
            bool a = i & 1, b = i >> 1;
            c[i][k] = up ? high : low;
            c[i][(k + 1) % 3] = a ? high : low;
            c[i][(k + 2) % 3] = b ? high : low;
        }
        for (int t = 0; t < 2 && wanted; t++) {
            double p[3][3];
            for (int i = 0; i < 3; i++) {
                int from = up != !!(which & TURNED) ? t + i : t + 2 - i;
                memcpy(p[i], c[t ? (from == 1 ? 1 : from == 2 ? 3 : 2) : from], sizeof p[i]);
            }
            put_triangle(m, p);
        }
    }
}

static uint32_t cube(const maker *m, unsigned which) {
    begin_part(m, 0.5, 0.25, -1);
    put_cube(m, -1, 1, which);
    return end_part(m);
}

static pbs_child placed(uint32_t node, uint64_t *seed, double scale, double spread) {
    pbs_child c = {.node = node};
    for (int i = 0; i < 12; i++)
        c.m[i] = i % 4 == 3 ? between(seed, -spread, spread) : scale * between(seed, -1, 1);
    return c;
}

static pbs_child here(uint32_t node) {
    return child_at(node, 0, 1, false);
}

/* ---- brute force ---- */

typedef struct placing {
    uint32_t mesh, group; /* group: the first one with the same mesh and transform */
    double m[12];
    pbs_to_grid to;
    uint32_t *seen; /* of each triangle */
    uint32_t times; /* of a group's first: how many there are */
} placing;

typedef struct flat {
    const pbs_scene *s;
    placing *p;
    size_t count, cap;
    uint64_t visited; /* pairs of a triangle and a block, as visited */
    uint64_t digest;  /* of them, in any order */
    uint64_t block;
} flat;

static pbs_code collect(void *ctx, uint32_t node, const double m[12], uint32_t flags, bool *descend,
                        pbs_err *e) {
    flat *f = ctx;
    (void)flags, (void)e;
    for (size_t i = f->s->first_mesh[node]; i < f->s->first_mesh[node + 1]; i++) {
        if (f->count == f->cap) f->p = realloc(f->p, (f->cap = 2 * f->cap + 64) * sizeof *f->p);
        placing *p = &f->p[f->count++];
        *p = (placing){.mesh = (uint32_t)i, .times = 1};
        double local[12];
        memcpy(local, PBS_IDENTITY, sizeof local);
        for (int k = 0; k < 3; k++) local[4 * k + 3] = f->s->nodes[node].origin[k];
        pbs_xform_mul(p->m, m, local);
    }
    *descend = true;
    return PBS_OK;
}

static bool equal(const placing *a, const placing *b) {
    return a->mesh == b->mesh && !memcmp(&a->to, &b->to, sizeof a->to);
}

static flat flatten(const pbs_scene *s, const pbs_grid *g) {
    flat f = {.s = s};
    must(pbs_dag_walk(&run, s->nodes, s->node_count, collect, &f, &err), &err);
    for (size_t i = 0; i < f.count; i++) {
        placing *p = &f.p[i];
        p->group = (uint32_t)i;
        if (!pbs_to_grid_make(&p->to, g, p->m)) abort();
        for (size_t k = 0; k < i; k++)
            if (equal(&f.p[k], p)) {
                p->group = (uint32_t)k;
                f.p[k].times++;
                break;
            }
        p->seen = calloc(s->meshes[p->mesh].triangles, sizeof *p->seen);
    }
    return f;
}

static void free_flat(flat *f) {
    for (size_t i = 0; i < f->count; i++) free(f->p[i].seen);
    free(f->p);
}

static pbs_code see(void *ctx, const pbs_mesh *mesh, const uint32_t *triangles, size_t count,
                    const pbs_to_grid *to, pbs_sides sides, pbs_err *e) {
    flat *f = ctx;
    placing key = {.mesh = (uint32_t)(mesh - f->s->meshes), .to = *to};
    (void)sides, (void)e;
    size_t i = 0;
    while (i < f->count && !equal(&f->p[i], &key)) i++;
    CHECK(i < f->count);
    for (size_t t = 0; t < count && i < f->count; t++) {
        f->p[i].seen[triangles[t]]++;
        f->visited++;
        uint64_t h = f->block * 1000003 + i;
        h = (h * 0x9e3779b97f4a7c15u ^ triangles[t]) * 0xe7037ed1a0b428dbu;
        f->digest += h ^ h >> 29;
    }
    return PBS_OK;
}

/* The triangle's box in voxels, within 2^-32 and rounding. */
static void box_of(const flat *f, const placing *p, uint32_t t, double min[3], double max[3]) {
    const pbs_mesh *m = &f->s->meshes[p->mesh];
    for (int k = 0; k < 3; k++) {
        min[k] = INFINITY, max[k] = -INFINITY;
        for (int i = 0; i < 3; i++) {
            const float *v = m->position + 3 * m->index[3 * t + (uint32_t)i];
            const double *r = p->to.m + 3 * k;
            long double x = (long double)r[0] * v[0] + (long double)r[1] * v[1] +
                            (long double)r[2] * v[2] + p->to.part[k] + p->to.whole[k];
            min[k] = fmin(min[k], (double)x), max[k] = fmax(max[k], (double)x);
        }
    }
}

static bool is_near(const double min[3], const double max[3], const uint32_t at[3]) {
    for (int k = 0; k < 3; k++)
        if (max[k] < at[k] - 1.0 || min[k] >= at[k] + 65.0) return false;
    return true;
}

/* What was seen in a block (or in none, if the walk left it out) is what is there. Boxes of
 * triangles are kept from block to block. */
static void compare(flat *f, const double (*box)[6], const uint32_t at[3], uint64_t *missing,
                    uint64_t *wrong) {
    for (size_t i = 0; i < f->count; i++) {
        placing *p = &f->p[i];
        uint32_t n = f->s->meshes[p->mesh].triangles;
        for (uint32_t t = 0; t < n && p->group == i; t++) {
            const double *b = box[t];
            *missing += !p->seen[t] && is_near(b, b + 3, at);
            *wrong += p->seen[t] && p->seen[t] != p->times;
            p->seen[t] = 0;
        }
        box += n;
    }
}

static double (*all_boxes(const flat *f))[6] {
    size_t n = 0, at = 0;
    for (size_t i = 0; i < f->count; i++) n += f->s->meshes[f->p[i].mesh].triangles;
    double(*box)[6] = malloc((n + 1) * sizeof *box);
    for (size_t i = 0; i < f->count; i++)
        for (uint32_t t = 0; t < f->s->meshes[f->p[i].mesh].triangles; t++, at++)
            box_of(f, &f->p[i], t, box[at], box[at] + 3);
    return box;
}

static uint64_t morton(const uint32_t at[3]) {
    uint64_t code = 0;
    for (int bit = 0; bit < 10; bit++)
        for (int k = 0; k < 3; k++) code |= (uint64_t)(at[k] / 64 >> bit & 1) << (3 * bit + k);
    return code;
}

/* Walks; all blocks of the grid in Morton order if `box` is given, which is slow. */
static void walk(flat *f, const pbs_grid *g, size_t memory, const double (*box)[6]) {
    pbs_blocks *b;
    pbs_nearby *near;
    uint32_t at[3], side = (g->size + 63) / 64;
    uint64_t expected = 0, missing = 0, wrong = 0;
    bool end = false;
    f->visited = f->digest = 0;
    must(pbs_blocks_new(f->s, g, PBS_ORIENT_AUTO, memory, &b, &err), &err);
    for (;;) {
        must(pbs_blocks_next(b, at, &near, &end, &err), &err);
        uint64_t here_code = end ? UINT64_MAX : morton(at);
        for (; box && expected < 1u << 30 && expected < here_code; expected++) {
            uint32_t c[3] = {0, 0, 0};
            for (int bit = 0; bit < 10; bit++)
                for (int k = 0; k < 3; k++)
                    c[k] |= (uint32_t)(expected >> (3 * bit + k) & 1) << bit;
            if (c[0] >= 32 || c[1] >= 32 || c[2] >= 32) break;
            if (c[0] >= side || c[1] >= side || c[2] >= side) continue;
            for (int k = 0; k < 3; k++) c[k] *= 64;
            compare(f, box, c, &missing, &wrong);
        }
        if (end) break;
        CHECK(at[0] % 64 == 0 && at[0] < g->size && at[1] < g->size && at[2] < g->size);
        CHECK(here_code >= expected);
        expected = here_code + 1;
        f->block = here_code;
        must(pbs_nearby_visit(near, see, f, &err), &err);
        pbs_nearby_free(near);
        if (box) compare(f, box, at, &missing, &wrong);
    }
    CHECK_NUM(!missing, missing);
    CHECK_NUM(!wrong, wrong);
    pbs_blocks_free(b);
}

static uint64_t check_grid(const pbs_scene *s, const pbs_grid *g, bool brute) {
    flat f = flatten(s, g);
    double(*box)[6] = brute ? all_boxes(&f) : NULL;
    walk(&f, g, 64u << 20, box);
    uint64_t visited = f.visited, digest = f.digest;
    walk(&f, g, 1, NULL);
    CHECK(f.visited == visited && f.digest == digest);
    free(box);
    free_flat(&f);
    return visited;
}

static void check_scene(maker *m, uint32_t root, uint32_t size) {
    size_t used = pbs_mem_used(&run);
    pbs_scene s = reopen(m, root);
    pbs_box box;
    pbs_flat flat_scene;
    uint64_t triangles, singular;
    CHECK(!pbs_scene_box(&s, &box, &triangles, &singular, &err));
    must(pbs_scene_flatten(&s, &flat_scene, &err), &err);
    CHECK(!memcmp(&box, &flat_scene.box, sizeof box));
    CHECK(triangles == flat_scene.triangles && singular == flat_scene.singular);
    pbs_free(&run, flat_scene.draws);
    pbs_grid g = pbs_grid_around(&box, size);
    CHECK(check_grid(&s, &g, true) > 0);
    for (int k = 0; k < 3; k++) g.min[k] += (0.2 + 0.1 * k) * size * g.voxel; /* cuts the scene */
    g.size = size / 2 + 5;
    check_grid(&s, &g, true);
    pbs_scene_close(&s);
    CHECK(pbs_mem_used(&run) <= used);
}

/* ---- scenes ---- */

TEST(one_part) {
    static const uint32_t sizes[] = {1, 64, 65, 200, 700};
    for (size_t i = 0; i < 5; i++) {
        uint64_t seed = i;
        maker m = new_scene();
        uint32_t root = soup(&m, 3000, 1, (double[3]){1, 2, 3}, &seed);
        check_scene(&m, root, sizes[i]);
    }
}

/* Parts in assemblies in assemblies; turned, sheared, mirrored; scales from 2^-8 to 2^8. */
static uint32_t tree(const maker *m, double offset, uint64_t *seed) {
    uint32_t node[14];
    for (int i = 0; i < 4; i++) {
        double origin[3];
        for (int k = 0; k < 3; k++) origin[k] = between(seed, -2, 2);
        node[i] = soup(m, i ? 30 : 200, exp2(-i), origin, seed);
    }
    for (int i = 4; i < 14; i++) {
        pbs_child c[4];
        for (int k = 0; k < 4; k++) {
            uint32_t from = i < 8 ? 0 : 4;
            uint32_t which = from + random_bits(seed) % (i < 8 ? 4 : (unsigned)i - 4);
            c[k] = placed(node[which], seed, exp2(between(seed, -2, 1)), 4);
            if (k == 3 && i % 3 == 0) c[k] = c[0]; /* twice in one place */
        }
        node[i] = add_assembly(m, c, 4);
    }
    pbs_child top = here(node[13]);
    for (int k = 0; k < 3; k++) top.m[4 * k + 3] = offset * (k + 1);
    return add_assembly(m, &top, 1);
}

TEST(trees) {
    static const double offset[] = {0, 1e7, -3e9, 5};
    for (uint64_t i = 0; i < 4; i++) {
        uint64_t seed = 100 + i;
        maker m = new_scene();
        uint32_t root = tree(&m, offset[i], &seed);
        check_scene(&m, root, i == 3 ? 1000 : 300);
    }
}

/* A scale is taken back by the one below. */
TEST(scales_that_cancel) {
    static const double scale[] = {1e9, 1e-9, 1e30, 1e-30};
    for (size_t i = 0; i < 4; i++) {
        uint64_t seed = i;
        maker m = new_scene();
        uint32_t part = soup(&m, 300, 1, (double[3]){0, 0, 0}, &seed);
        uint32_t big =
            add_pair(&m, child_at(part, 1, scale[i], false), child_at(part, 3, scale[i], false));
        uint32_t root = add_pair(&m, child_at(big, 0, 1 / scale[i], false),
                                 child_at(big, 5 / scale[i], 1 / scale[i], false));
        check_scene(&m, root, 300);
    }
}

/* Far out and back again: what is below a node is not where its box says, by some voxels. */
TEST(translations_that_cancel) {
    uint64_t seed = 5;
    maker m = new_scene();
    uint32_t part = soup(&m, 1, 0.5, (double[3]){0, 0, 0}, &seed);
    enum { N = 600, EACH = 1 };
    pbs_child all[N];
    for (int i = 0; i < N; i++) {
        pbs_child back[EACH], out = placed(0, &seed, 1, 1e15);
        for (int k = 0; k < EACH; k++) {
            double wanted[3], t[3], det = pbs_xform_det(out.m), inverse[9];
            pbs_xform_cofactor(inverse, out.m); /* its transpose / det */
            for (int r = 0; r < 3; r++) wanted[r] = between(&seed, -100, 100) - out.m[4 * r + 3];
            for (int r = 0; r < 3; r++)
                t[r] = (inverse[r] * wanted[0] + inverse[3 + r] * wanted[1] +
                        inverse[6 + r] * wanted[2]) /
                       det;
            back[k] = child_at(part, 0, 1, false);
            for (int r = 0; r < 3; r++) back[k].m[4 * r + 3] = t[r];
        }
        out.node = add_assembly(&m, back, EACH);
        all[i] = out;
    }
    uint32_t root = add_assembly(&m, all, N);
    pbs_scene s = reopen(&m, root);
    pbs_grid g = {.min = {-90, -90, -90}, .voxel = 0.25, .size = 720};
    CHECK(check_grid(&s, &g, true) > 0);
    pbs_scene_close(&s);
}

/* A triangle on the border of what a block reaches, of numbers so large that a rounding matters:
 * 0.3 / 0.1 is not 0.3 * 10. */
TEST(roundings_on_borders) {
    const float far = 0x1.ffp29f;
    maker m = new_scene();
    begin_part(&m, 0, 0, 0);
    put_triangle(&m, (double[3][3]){{far, 0, 2e-7}, {far, 64, 2e-7}, {far, 0, 1}});
    uint32_t part = end_part(&m);
    pbs_child c[80];
    for (int i = 0; i < 80; i++) {
        double at = -0.3 * far + 6.5 + 2e-8 * (i - 40);
        c[i] = (pbs_child){.node = part, .m = {0.3, 0, 0.1, at, 0, 0.1, 0, 0, 0, 0, 0.1, 0}};
    }
    pbs_scene s = reopen(&m, add_assembly(&m, c, 80));
    pbs_grid g = {.min = {0, 0, 0}, .voxel = 0.1, .size = 400};
    CHECK(check_grid(&s, &g, true) > 0);
    pbs_scene_close(&s);
}

/* More placings than the smallest lists hold. */
TEST(many_children) {
    enum { N = 6000 };
    uint64_t seed = 1;
    maker m = new_scene();
    uint32_t part = soup(&m, 2, 1, (double[3]){0, 0, 0}, &seed);
    pbs_child *c = malloc(N * sizeof *c);
    for (int i = 0; i < N; i++) c[i] = placed(part, &seed, i % 100 ? 0.2 : 10, 20);
    uint32_t root = add_assembly(&m, c, N);
    free(c);
    pbs_scene s = reopen(&m, root);
    pbs_box box;
    uint64_t triangles, singular;
    CHECK(!pbs_scene_box(&s, &box, &triangles, &singular, &err));
    CHECK(triangles == 2 * N);
    pbs_grid g = pbs_grid_around(&box, 256);
    CHECK(check_grid(&s, &g, true) > 0);
    pbs_scene_close(&s);
}

static pbs_code tally(void *ctx, const pbs_mesh *mesh, const uint32_t *triangles, size_t count,
                      const pbs_to_grid *to, pbs_sides sides, pbs_err *e) {
    (void)mesh, (void)triangles, (void)to, (void)sides, (void)e;
    *(uint64_t *)ctx += count;
    return PBS_OK;
}

/* Walks with one reader of blocks. */
static uint64_t count_all(const pbs_scene *s, const pbs_grid *g, uint64_t *blocks) {
    pbs_blocks *b;
    uint64_t n = 0;
    must(pbs_blocks_new(s, g, PBS_ORIENT_AUTO, 1 << 20, &b, &err), &err);
    for (*blocks = 0;; (*blocks)++) {
        pbs_nearby *near;
        uint32_t at[3];
        bool end;
        must(pbs_blocks_next(b, at, &near, &end, &err), &err);
        if (end) break;
        must(pbs_nearby_visit(near, tally, &n, &err), &err);
        pbs_nearby_free(near);
    }
    pbs_blocks_free(b);
    return n;
}

/* As the digest of a flat scene, for scenes of one part. */
static pbs_code digest(void *ctx, const pbs_mesh *mesh, const uint32_t *triangles, size_t count,
                       const pbs_to_grid *to, pbs_sides sides, pbs_err *e) {
    uint64_t *d = ctx;
    (void)to, (void)sides, (void)e;
    for (size_t i = 0; i < count; i++) {
        uint32_t bits;
        memcpy(&bits, mesh->position, sizeof bits);
        uint64_t h = bits * (uint64_t)1000003 + triangles[i] + d[1];
        d[0] += (h ^ h >> 29) * 0xe7037ed1a0b428dbu;
    }
    return PBS_OK;
}

/* Clusters in a file, or in memory; one thread, or two. */
TEST(a_part_larger_than_memory) {
    uint64_t seed = 3, first = 0;
    maker m = new_scene();
    uint32_t root = soup(&m, 120000, 100, (double[3]){0, 0, 0}, &seed);
    pbs_scene s = reopen(&m, root);
    pbs_box box;
    uint64_t triangles, singular;
    CHECK(!pbs_scene_box(&s, &box, &triangles, &singular, &err));
    pbs_grid g = pbs_grid_around(&box, 256);
    for (int i = 0; i < 3; i++) {
        pbs_blocks *b;
        uint64_t d[2] = {0, 0};
        size_t limit = pbs_mem_used(&run) + ((size_t)5 << 18);
        run.threads = 1 + i % 2;
        run.mem_limit = i ? limit : 0;
        run.mem_peak = pbs_mem_used(&run);
        must(pbs_blocks_new(&s, &g, PBS_ORIENT_AUTO, 1 << 20, &b, &err), &err);
        for (;; d[1]++) {
            pbs_nearby *near;
            uint32_t at[3];
            bool end;
            must(pbs_blocks_next(b, at, &near, &end, &err), &err);
            if (end) break;
            must(pbs_nearby_visit(near, digest, d, &err), &err);
            pbs_nearby_free(near);
        }
        pbs_blocks_free(b);
        if (!i) first = d[0];
        CHECK(d[0] == first && d[1] == 64);
        if (i) CHECK(pbs_mem_peak(&run) <= limit);
    }
    run.mem_limit = pbs_mem_used(&run) + (1 << 18); /* not enough for the lists */
    pbs_blocks *b;
    CHECK(pbs_blocks_new(&s, &g, PBS_ORIENT_AUTO, 1 << 20, &b, &err) == PBS_LIMIT && !b);
    run.mem_limit = 0;
    pbs_scene_close(&s);
}

/* ---- on threads: the walk goes on while blocks are worked on ---- */

typedef struct job {
    pbs_nearby *near;
    uint64_t triangles;
} job;

static pbs_code next_job(void *ctx, void *slot, bool *end, pbs_err *e) {
    uint32_t at[3];
    return pbs_blocks_next(ctx, at, &((job *)slot)->near, end, e);
}

static pbs_code do_job(void *ctx, void *slot, int thread, pbs_err *e) {
    job *j = slot;
    (void)ctx, (void)thread;
    j->triangles = 0;
    return pbs_nearby_visit(j->near, tally, &j->triangles, e);
}

static uint64_t jobs_total;
static pbs_code end_job(void *ctx, void *slot, pbs_err *e) {
    job *j = slot;
    (void)ctx, (void)e;
    jobs_total += j->triangles;
    pbs_nearby_free(j->near);
    return PBS_OK;
}

TEST(on_threads) {
    uint64_t seed = 77, total = 0, blocks;
    maker m = new_scene();
    uint32_t root = tree(&m, 0, &seed);
    pbs_scene s = reopen(&m, root);
    pbs_box box;
    uint64_t triangles, singular;
    CHECK(!pbs_scene_box(&s, &box, &triangles, &singular, &err));
    pbs_grid g = pbs_grid_around(&box, 2000);
    total = count_all(&s, &g, &blocks);
    for (run.threads = 1; run.threads <= 4; run.threads *= 2) {
        pbs_blocks *b;
        job slots[8];
        must(pbs_blocks_new(&s, &g, PBS_ORIENT_AUTO, 1 << 20, &b, &err), &err);
        pbs_pipe p = {b, next_job, do_job, end_job, slots, sizeof *slots, 2 * run.threads};
        jobs_total = 0;
        must(pbs_pipe_run(&run, &p, &err), &err);
        CHECK(jobs_total == total);
        pbs_blocks_free(b);
    }
    run.threads = 2;
    pbs_scene_close(&s);
}

TEST(cancelled) {
    maker m = new_scene();
    pbs_scene s = reopen(&m, cube(&m, WHOLE));
    volatile sig_atomic_t stop = 0;
    pbs_grid g = {.min = {-20, -20, -20}, .voxel = 0.1, .size = 400};
    pbs_blocks *b;
    pbs_nearby *near;
    uint32_t at[3];
    bool end;
    must(pbs_blocks_new(&s, &g, PBS_ORIENT_AUTO, 1 << 20, &b, &err), &err);
    stop = 1;
    run.cancel = &stop;
    CHECK(pbs_blocks_next(b, at, &near, &end, &err) == PBS_CANCEL && !near);
    run.cancel = NULL;
    pbs_blocks_free(b);
    pbs_scene_close(&s);
}

/* 4^9 cubes, all in one block, or on the corner of eight. */
TEST(a_bomb) {
    maker m = new_scene();
    uint32_t node = cube(&m, WHOLE);
    for (int i = 0; i < 9; i++) {
        pbs_child c[4];
        for (int k = 0; k < 4; k++) c[k] = child_at(node, k * exp2(-20 + i), 1, false);
        node = add_assembly(&m, c, 4);
    }
    pbs_scene s = reopen(&m, node);
    pbs_grid g = {.min = {-8, -8, -8}, .voxel = 0.25, .size = 64};
    uint64_t blocks;
    run.mem_peak = pbs_mem_used(&run);
    size_t before = run.mem_peak;
    CHECK(count_all(&s, &g, &blocks) == 12u << 18 && blocks == 1);
    for (int k = 0; k < 3; k++) g.min[k] = -15.75;
    g.size = 1000;
    CHECK(count_all(&s, &g, &blocks) == 8 * (12u << 18) && blocks == 8);
    CHECK_NUM(pbs_mem_peak(&run) - before < 3 << 20, pbs_mem_peak(&run) - before);
    pbs_scene_close(&s);
}

/* 10^5 assemblies of one child each; and 2^60 placings of nothing. */
TEST(deep) {
    maker m = new_scene();
    uint32_t node = cube(&m, WHOLE), none = add_assembly(&m, NULL, 0);
    for (int i = 0; i < 60; i++) none = add_pair(&m, here(none), child_at(none, 1, 1, false));
    for (int i = 0; i < 100000; i++) {
        pbs_child c = child_at(node, i % 2 ? 0.001 : -0.001, 1, false);
        node = add_assembly(&m, &c, 1);
    }
    node = add_pair(&m, here(node), child_at(none, 5, 1, false));
    pbs_scene s = reopen(&m, node);
    pbs_box box;
    uint64_t triangles, singular, blocks;
    CHECK(!pbs_scene_box(&s, &box, &triangles, &singular, &err));
    CHECK(triangles == 12 && singular == 0);
    CHECK(fabs(box.max[0] - 1) < 1e-9 && box.max[1] == 1);
    pbs_grid g = pbs_grid_around(&box, 100);
    uint64_t n = count_all(&s, &g, &blocks);
    CHECK(n == 12 * blocks && blocks == 8);
    pbs_scene_close(&s);
}

/* ---- numbers that are none ---- */

static pbs_code box_of_chain(double a, double b, pbs_box *box) {
    maker m = new_scene();
    uint32_t part = cube(&m, WHOLE);
    uint32_t inner = add_pair(&m, child_at(part, 0, a, false), child_at(part, 0, a, false));
    uint32_t outer = add_pair(&m, child_at(inner, 0, b, false), child_at(part, 1, 1, false));
    pbs_scene s = reopen(&m, outer);
    uint64_t triangles, singular;
    pbs_flat flat_scene;
    pbs_err other;
    pbs_code rc = pbs_scene_box(&s, box, &triangles, &singular, &err);
    CHECK(rc == pbs_scene_flatten(&s, &flat_scene, &other));
    if (rc)
        CHECK(!strcmp(err.text, other.text));
    else
        CHECK(!memcmp(box, &flat_scene.box, sizeof *box));
    pbs_grid g = {.min = {-2, -2, -2}, .voxel = 1, .size = 64};
    pbs_blocks *b2;
    pbs_nearby *near;
    uint32_t at[3];
    bool end;
    uint64_t seen = 0;
    must(pbs_blocks_new(&s, &g, PBS_ORIENT_AUTO, 1 << 20, &b2, &err), &err);
    must(pbs_blocks_next(b2, at, &near, &end, &err), &err);
    CHECK(!end);
    pbs_code visit = pbs_nearby_visit(near, tally, &seen, &err);
    CHECK(visit == PBS_OK || visit == PBS_DATA);
    if (!visit) CHECK(seen >= 12);
    pbs_nearby_free(near);
    pbs_blocks_free(b2);
    pbs_free(&run, flat_scene.draws);
    pbs_scene_close(&s);
    return rc;
}

TEST(numbers_that_overflow) {
    pbs_box box;
    CHECK(box_of_chain(1e200, 1e200, &box) == PBS_OK); /* infinity times 0 is no place */
    CHECK(box_of_chain(1e308, 1, &box) == PBS_DATA);
    CHECK(box_of_chain(0, 1, &box) == PBS_OK);
    CHECK(box_of_chain(1e-200, 1e-200, &box) == PBS_OK);
    CHECK(box_of_chain(1e200, 1e-200, &box) == PBS_OK);
    CHECK(box_of_chain(0x1p1023, 0x1p1023, &box) == PBS_OK);
}

TEST(nothing_in_it) {
    maker m = new_scene();
    uint32_t part = cube(&m, WHOLE);
    pbs_scene s = reopen(&m, part);
    uint64_t blocks;
    pbs_grid g = {.min = {50, 50, 50}, .voxel = 0.5, .size = 640};
    CHECK(count_all(&s, &g, &blocks) == 0 && blocks == 0);
    pbs_scene_close(&s);
}

/* ---- sides ---- */

static pbs_code note_sides(void *ctx, const pbs_mesh *mesh, const uint32_t *triangles, size_t count,
                           const pbs_to_grid *to, pbs_sides sides, pbs_err *e) {
    (void)mesh, (void)triangles, (void)count, (void)to, (void)e;
    ((uint32_t *)ctx)[sides]++;
    return PBS_OK;
}

/* How often meshes were visited with each of the sides; all in one block. */
static void sides_of(maker *m, uint32_t root, pbs_orient how, uint32_t out[3],
                     pbs_blocks_stats *stats) {
    pbs_scene s = reopen(m, root);
    pbs_grid g = {.min = {-50, -50, -50}, .voxel = 10, .size = 10};
    pbs_blocks *b;
    pbs_nearby *near;
    uint32_t at[3];
    bool end;
    memset(out, 0, 3 * sizeof *out);
    must(pbs_blocks_new(&s, &g, how, 1 << 20, &b, &err), &err);
    must(pbs_blocks_next(b, at, &near, &end, &err), &err);
    CHECK(!end);
    must(pbs_nearby_visit(near, note_sides, out, &err), &err);
    *stats = pbs_blocks_totals(b);
    pbs_nearby_free(near);
    pbs_blocks_free(b);
    pbs_scene_close(&s);
}

static bool is(const uint32_t n[3], uint32_t outside, uint32_t inside, uint32_t unknown) {
    return n[PBS_SIDES_OUT] == outside && n[PBS_SIDES_IN] == inside &&
           n[PBS_SIDES_UNKNOWN] == unknown;
}

TEST(cubes_and_their_sides) {
    uint32_t n[3];
    pbs_blocks_stats stats;
    for (int how = PBS_ORIENT_AUTO; how <= PBS_ORIENT_UNKNOWN; how++) {
        maker m = new_scene();
        pbs_child c[4] = {here(cube(&m, WHOLE)), child_at(cube(&m, WHOLE | TURNED), 3, 1, false),
                          child_at(cube(&m, HALF_ONE), 6, 1, false),
                          child_at(c[0].node, 9, -1, false)}; /* mirrored: the part's own frame */
        sides_of(&m, add_assembly(&m, c, 4), (pbs_orient)how, n, &stats);
        if (how == PBS_ORIENT_AUTO)
            CHECK(is(n, 2, 1, 1) && stats.parts_known == 2 && stats.parts_turned == 1 &&
                  stats.parts_unknown == 1);
        if (how == PBS_ORIENT_TRUST) CHECK(is(n, 4, 0, 0) && stats.parts_known == 3);
        if (how == PBS_ORIENT_UNKNOWN) CHECK(is(n, 0, 0, 4) && stats.parts_unknown == 3);
    }
}

/* Two halves that are placed where they are make a whole; not if one is moved; and a half of two
 * wholes of which one is inside out is not known. */
TEST(halves) {
    uint32_t n[3];
    pbs_blocks_stats stats;
    for (unsigned turned = 0; turned <= TURNED; turned += TURNED) {
        maker m = new_scene();
        uint32_t one = cube(&m, HALF_ONE | turned), two = cube(&m, HALF_TWO | turned);
        uint32_t whole = add_pair(&m, here(one), here(two));
        pbs_child c[2] = {child_at(whole, 5, 2, false), child_at(one, 9, 1, false)};
        sides_of(&m, add_assembly(&m, c, 2), PBS_ORIENT_AUTO, n, &stats);
        CHECK(turned ? is(n, 0, 3, 0) : is(n, 3, 0, 0));
    }
    maker m = new_scene();
    uint32_t one = cube(&m, HALF_ONE), two = cube(&m, HALF_TWO);
    sides_of(&m, add_pair(&m, here(one), child_at(two, 1e-9, 1, false)), PBS_ORIENT_AUTO, n,
             &stats);
    CHECK(is(n, 0, 0, 2));
    m = new_scene();
    one = cube(&m, HALF_ONE);
    begin_part(&m, 1.5, 1.25, 0); /* the same bits around another origin */
    put_cube(&m, 0, 2, HALF_TWO);
    sides_of(&m, add_pair(&m, here(one), here(end_part(&m))), PBS_ORIENT_AUTO, n, &stats);
    CHECK(is(n, 0, 0, 2));
    m = new_scene();
    one = cube(&m, HALF_ONE), two = cube(&m, HALF_TWO);
    begin_part(&m, 0.5, 0.25, -1); /* closes the first half around the outside of itself */
    put_cube(&m, -1, 1, HALF_ONE | TURNED);
    put_cube(&m, -9, 9, WHOLE | TURNED);
    uint32_t other = end_part(&m);
    pbs_child c[2] = {here(add_pair(&m, here(one), here(two))),
                      child_at(add_pair(&m, here(one), here(other)), 0, 1, true)};
    sides_of(&m, add_assembly(&m, c, 2), PBS_ORIENT_AUTO, n, &stats);
    CHECK(is(n, 1, 1, 2));
}

static void put_sphere(const maker *m, double radius) {
    enum { N = 30 };
    for (int i = 0; i < 2 * N * N; i++) {
        double p[4][3];
        for (int c = 0; c < 4; c++) {
            int row = i / (2 * N) + (c >> 1), at = (i + (c & 1)) % (2 * N);
            double a = M_PI * row / N, b = M_PI * at / N, wide = row % N ? radius * sin(a) : 0;
            p[c][0] = wide * cos(b), p[c][1] = wide * sin(b), p[c][2] = radius * cos(a);
        }
        double two[2][3][3];
        for (int k = 0; k < 3; k++) {
            memcpy(two[0][k], p[k == 0 ? 0 : k + 1], sizeof two[0][k]);
            memcpy(two[1][k], p[k == 0 ? 0 : k == 1 ? 3 : 1], sizeof two[1][k]);
        }
        put_triangle(m, two[0]);
        put_triangle(m, two[1]);
    }
}

/* What the importer splits is known as before; a part may have several shells. */
TEST(a_part_that_is_split) {
    uint32_t n[3];
    pbs_blocks_stats stats;
    for (uint64_t split = 0; split < 200; split += 100) {
        const pbs_scene_options options = {.split = split};
        maker m = {.w = spool_writer(&run, PBS_SCENE, NULL, 0)};
        must(pbs_scene_writer_new(&run, m.w, &options, &m.sw, &err), &err);
        m.s = pbs_scene_sink(m.sw);
        begin_part(&m, 1, 1, 1);
        put_sphere(&m, 20);
        put_sphere(&m, 30);
        sides_of(&m, end_part(&m), PBS_ORIENT_AUTO, n, &stats);
        CHECK_NUM(split ? stats.parts_known > 50 : stats.parts_known == 1, stats.parts_known);
        CHECK(is(n, (uint32_t)stats.parts_known, 0, 0));
    }
}

TEST_MAIN
