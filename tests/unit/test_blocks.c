/* The walk over blocks against brute force: every triangle near a block is visited once for each
 * placing, whatever the memory and the numbers; the box of a scene. */
#include "formats/voxels/blocks.h"
#include "formats/scene/dag.h"
#include "tests/check.h"
#include "tests/unit/parts.h"

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
    uint64_t visited; /* pairs of a triangle and a block that it touches, as visited */
    uint64_t digest;  /* of them, in any order */
    uint64_t block;
    uint32_t at[3];
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

/* Whether a triangle surely touches what a block and the layer around it hold: what is left of it
 * when all else is cut away. */
static bool is_there(const flat *f, const placing *p, uint32_t t, const uint32_t at[3]) {
    const pbs_mesh *m = &f->s->meshes[p->mesh];
    double v[12][3], out[12][3];
    int n = 3;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            const float *q = m->position + 3 * m->index[3 * t + (uint32_t)i];
            const double *r = p->to.m + 3 * k;
            v[i][k] = r[0] * q[0] + r[1] * q[1] + r[2] * q[2] + p->to.part[k] + p->to.whole[k];
        }
    for (int side = 0; side < 6; side++) {
        int k = side / 2, left = 0;
        double sign = side & 1 ? 1 : -1, end = at[k] + (side & 1 ? 65 - 1e-6 : -1 + 1e-6);
        for (int i = 0; i < n; i++) {
            const double *a = v[i], *b = v[(i + 1) % n];
            double da = (end - a[k]) * sign, db = (end - b[k]) * sign;
            if (da >= 0) memcpy(out[left++], a, sizeof *out);
            if ((da >= 0) == (db >= 0)) continue;
            for (int j = 0; j < 3; j++) out[left][j] = a[j] + da / (da - db) * (b[j] - a[j]);
            out[left++][k] = end;
        }
        memcpy(v, out, (size_t)left * sizeof *out);
        n = left;
    }
    return n > 0;
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
        if (!is_there(f, &f->p[i], triangles[t], f->at)) continue;
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
            *missing += !p->seen[t] && is_near(b, b + 3, at) && is_there(f, p, t, at);
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
        memcpy(f->at, at, sizeof at);
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

TEST_MAIN
