/* Blocks of voxels: laws that hold for any triangles, and small cases written out. */
#include "libcore/block_inner.h"
#include "tests/check.h"

/* ---- meshes ---- */

enum { MOST = 20000 };
typedef struct shape {
    pbs_mesh mesh;
    float position[3 * MOST];
    int16_t normal[2 * MOST];
    uint8_t colour[4 * MOST];
    float uv[2 * MOST];
    uint16_t index[3 * MOST];
    uint32_t material[MOST];
} shape;
static shape one, two;

static uint64_t seed;
static double uniform(void) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(seed >> 11) * 0x1p-53;
}

static void clear(shape *s) {
    s->mesh = (pbs_mesh){.position = s->position, .index = s->index, .material = PBS_NONE};
}
static uint16_t vertex(shape *s, double x, double y, double z) {
    float *p = s->position + 3 * (size_t)s->mesh.vertices;
    p[0] = (float)x, p[1] = (float)y, p[2] = (float)z;
    return (uint16_t)s->mesh.vertices++;
}
static void triangle(shape *s, int a, int b, int c) {
    uint16_t *t = s->index + 3 * (size_t)s->mesh.triangles++;
    t[0] = (uint16_t)a, t[1] = (uint16_t)b, t[2] = (uint16_t)c;
}
static void quad(shape *s, int a, int b, int c, int d) {
    triangle(s, a, b, c);
    triangle(s, a, c, d);
}

/* Outwards, seen counter-clockwise. */
static void sphere(shape *s, double x, double y, double z, double r, int n) {
    int first = (int)s->mesh.vertices;
    for (int i = 0; i <= n; i++)
        for (int j = 0; j < 2 * n; j++) {
            double t = M_PI * i / n, p = M_PI * j / n, q = i % n ? sin(t) : 0;
            vertex(s, x + r * q * cos(p), y + r * q * sin(p), z + r * cos(t));
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < 2 * n; j++) {
            int a = first + i * 2 * n + j, b = first + i * 2 * n + (j + 1) % (2 * n);
            triangle(s, a, a + 2 * n, b + 2 * n);
            if (i) triangle(s, a, b + 2 * n, b);
        }
}

static void soup(shape *s, int n, double size, double large) {
    for (int i = 0; i < n; i++) {
        double c[3], r = uniform() < 0.05 ? large : size;
        for (int k = 0; k < 3; k++) c[k] = -3 + 70 * uniform();
        int v[3];
        for (int k = 0; k < 3; k++)
            v[k] = vertex(s, c[0] + r * (uniform() - 0.5), c[1] + r * (uniform() - 0.5),
                          c[2] + r * (uniform() - 0.5));
        triangle(s, v[0], v[1], v[2]);
    }
}

static void colours(shape *s) {
    for (uint32_t i = 0; i < s->mesh.vertices; i++) {
        for (int k = 0; k < 4; k++) s->colour[4 * i + (uint32_t)k] = (uint8_t)(256 * uniform());
        float n[3];
        for (int k = 0; k < 3; k++) n[k] = (float)(uniform() - 0.5);
        pbs_oct_encode(s->normal + 2 * i, n);
    }
    s->mesh.colour = s->colour;
}

/* ---- what comes out ---- */

typedef struct result {
    pbs_voxels v; /* malloc'ed */
    uint32_t *faces;
    size_t face_count;
    pbs_block_stats stats;
    double sum[4]; /* area, area * normal of all cells that are touched */
} result;

typedef struct how {
    pbs_block_params params;
    pbs_sides sides;
    uint32_t at[3], size;
    pbs_to_grid to;
    int order;       /* 1: backwards; 2: in many calls; 3: in another order, a third at a time */
    int64_t wide_at; /* 0: as it is */
    bool portable;
} how;

enum { ALL = PBS_NORMAL | PBS_WEIGHT | PBS_COLOUR | PBS_MATERIAL | PBS_EMISSIVE };

static how plainly(void) {
    return (how){.params = {.channels = PBS_NORMAL | PBS_WEIGHT},
                 .size = 4096,
                 .at = {64, 64, 64},
                 .to = {.m = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .whole = {64, 64, 64}}};
}

static void *copy(const void *from, size_t n) {
    void *to = malloc(4 * n + 1);
    if (n) memcpy(to, from, 4 * n);
    return to;
}

static void total(const pbs_block *b, double sum[4]) {
    __int128 all[8] = {0};
    for (uint32_t n = 1; n < b->bricks.records; n++) {
        const int64_t *r = pbs_record_at(&b->bricks, n);
        for (uint32_t i = 0; i < 8 && !(r[PBS_REC_FLAGS] & PBS_REC_BARE); i++)
            all[i] += pbs_record_total(&b->bricks, r, i);
    }
    sum[0] = (double)all[PBS_REC_AREA] / PBS_UNIT;
    for (int i = 0; i < 3; i++)
        sum[i + 1] = (double)(all[PBS_REC_NEAR + i] + all[PBS_REC_BEYOND + i]) / PBS_UNIT;
}

static uint32_t list[MOST];

static void feed(pbs_block *b, const how *h, const pbs_mesh *mesh) {
    uint32_t n = mesh->triangles, step = h->order == 3 ? 7919 : 1, each = n;
    for (uint32_t i = 0; i < n; i++)
        list[i] = h->order == 1 ? n - 1 - i : (uint32_t)((uint64_t)i * step % n);
    if (h->order == 2) each = 5;
    if (h->order == 3) each = n / 3 + 1;
    for (uint32_t i = 0; i < n; i += each)
        CHECK(
            !pbs_block_add(b, mesh, list + i, n - i < each ? n - i : each, &h->to, h->sides, NULL));
}

static result take(pbs_block *b) {
    result r = {0};
    pbs_voxels v;
    const uint32_t *faces;
    CHECK(!pbs_block_end(b, &v, &faces, &r.face_count, &r.stats, NULL));
    r.v.count = v.count;
    r.v.place = copy(v.place, v.count);
    if (v.normal) r.v.normal = copy(v.normal, v.count);
    if (v.weight) r.v.weight = copy(v.weight, v.count);
    if (v.colour) r.v.colour = copy(v.colour, v.count);
    if (v.material) r.v.material = copy(v.material, v.count);
    if (v.emissive) r.v.emissive = copy(v.emissive, v.count);
    if (v.face) r.v.face = copy(v.face, v.count);
    r.faces = copy(faces, r.face_count);
    total(b, r.sum);
    return r;
}

static pbs_block *fresh(pbs_run *run, const how *h) {
    pbs_block *b;
    CHECK(!pbs_block_new(run, &h->params, &b, NULL));
    if (h->wide_at) b->wide_at = h->wide_at;
    if (h->portable) b->simd = false;
    return b;
}

static result work(const how *h, const pbs_mesh *mesh) {
    pbs_run run = {.threads = 1};
    pbs_block *b = fresh(&run, h);
    pbs_block_begin(b, h->at, h->size);
    feed(b, h, mesh);
    result r = take(b);
    pbs_block_free(b);
    CHECK(pbs_mem_used(&run) == 0);
    return r;
}

static void drop(result *r) {
    void *p[] = {r->v.place,    r->v.normal,   r->v.weight, r->v.colour,
                 r->v.material, r->v.emissive, r->v.face,   r->faces};
    for (size_t i = 0; i < 8; i++) free(p[i]);
}

static bool same_array(const void *a, const void *b, size_t n) {
    return !a == !b && (!a || !memcmp(a, b, 4 * n));
}
static bool same(const result *a, const result *b) {
    size_t n = a->v.count;
    return n == b->v.count && same_array(a->v.place, b->v.place, n) &&
           same_array(a->v.normal, b->v.normal, n) && same_array(a->v.weight, b->v.weight, n) &&
           same_array(a->v.colour, b->v.colour, n) && same_array(a->v.material, b->v.material, n) &&
           same_array(a->v.emissive, b->v.emissive, n) && same_array(a->v.face, b->v.face, n) &&
           a->face_count == b->face_count && same_array(a->faces, b->faces, a->face_count) &&
           !memcmp(&a->stats, &b->stats, sizeof a->stats);
}

/* The same but for what rounding does to sums when corners come in another order. */
static bool alike(const result *a, const result *b) {
    size_t wrong = a->v.count != b->v.count;
    for (size_t i = 0; !wrong && i < a->v.count; i++) {
        float m[3], n[3];
        pbs_normal10_get(m, a->v.normal[i]), pbs_normal10_get(n, b->v.normal[i]);
        wrong += a->v.place[i] != b->v.place[i];
        wrong += fabsf(a->v.weight[i] - b->v.weight[i]) > 1e-6f;
        for (int k = 0; k < 3; k++) wrong += fabsf(m[k] - n[k]) > 0.0021f;
    }
    return !wrong;
}

static uint32_t faces_of(const result *r, size_t i) {
    return r->v.place[i] >> 24 & PBS_FACES_ALL;
}
static long find(const result *r, int x, int y, int z) {
    for (size_t i = 0; i < r->v.count; i++)
        if ((r->v.place[i] & 0xffffff) == (uint32_t)(x | y << 8 | z << 16)) return (long)i;
    return -1;
}

/* ---- materials ---- */

static pbs_run materials_run = {.threads = 1};
static pbs_material material[4];
static uint8_t pixels[64 * 64 * 4];
static pbs_image image = {64, 64, pixels};

static pbs_surfaces *surfaces(uint32_t channels) {
    pbs_surfaces *s;
    for (int i = 0; i < 4; i++) {
        material[i] = PBS_MATERIAL_DEFAULT;
        material[i].metallic = (float)i / 4, material[i].roughness = 0.3f;
        for (int k = 0; k < 3; k++) {
            material[i].base[k] = (float)((i + 3 * k) % 5) / 4;
            material[i].emissive[k] = (float)(i * k) / 7;
        }
    }
    material[3].base_texture.texture = 0;
    CHECK(!pbs_surfaces_new(&materials_run, material, 4, &image, 1, channels, &s, NULL));
    return s;
}

static void many_materials(shape *s) {
    for (uint32_t i = 0; i < s->mesh.triangles; i++) s->material[i] = i % 5 - (i % 5 == 4 ? 5 : 0);
    s->mesh.triangle_material = s->material;
    for (uint32_t i = 0; i < 2 * s->mesh.vertices; i++) s->uv[i] = (float)uniform();
    s->mesh.uv = s->uv;
}

/* ---- laws ---- */

static void make_soup(void) {
    clear(&one);
    seed = 4;
    soup(&one, 800, 2, 40);
    /* Touches without area, on corners, edges and faces of cells. */
    for (int i = 0; i < 300; i++) {
        int v[3];
        for (int k = 0; k < 3; k++)
            v[k] =
                vertex(&one, floor(60 * uniform()), floor(4 * uniform()) / 2, floor(9 * uniform()));
        triangle(&one, v[0], v[1], i % 4 ? v[2] : v[1]);
    }
    colours(&one);
    many_materials(&one);
    for (size_t i = 0; i < sizeof pixels; i++) pixels[i] = (uint8_t)(256 * uniform());
}

TEST(order_calls_and_instructions_do_not_matter) {
    pbs_surfaces *s = surfaces(PBS_COLOUR | PBS_MATERIAL | PBS_EMISSIVE);
    make_soup();
    for (int i = 0; i < 6; i++) {
        how h = plainly();
        h.params.channels = ALL;
        h.params.surfaces = s;
        h.params.per_face = (pbs_per_face)(i % 3);
        h.params.cells = (pbs_cells)(i / 2);
        h.sides = i >= 4 ? PBS_SIDES_UNKNOWN : PBS_SIDES_OUT;
        one.mesh.normal = i & 1 ? one.normal : NULL;
        result a = work(&h, &one.mesh);
        CHECK(a.v.count > 1000 && a.v.weight && a.v.emissive);
        for (int k = 1; k < 6; k++) {
            how other = h;
            other.order = k % 4;
            other.portable = k == 4;
            other.wide_at = k == 5 ? INT64_C(1) << 39 : 0;
            result b = work(&other, &one.mesh);
            CHECK_NUM(same(&a, &b), 10 * i + k);
            drop(&b);
        }
        drop(&a);
    }
    pbs_surfaces_free(&materials_run, s);
}

TEST(set_alone_is_that_of_all_channels) {
    how h = plainly();
    clear(&one);
    seed = 9;
    soup(&one, 2000, 3, 60);
    h.params.cells = PBS_CELLS_SEPARATING;
    result a = work(&h, &one.mesh);
    h.params.channels = 0;
    result b = work(&h, &one.mesh);
    CHECK(a.v.count == b.v.count && b.v.count > 0 && !b.v.normal && !b.v.weight);
    CHECK_NUM(b.stats.touched == 0, b.stats.touched);
    size_t differ = 0, lost = 0;
    for (size_t i = 0; i < a.v.count && i < b.v.count; i++) {
        differ += (a.v.place[i] ^ b.v.place[i]) << 8 != 0;
        /* A triangle that touches a cell without hitting its crosshair adds a face. */
        lost += (faces_of(&b, i) & ~faces_of(&a, i)) != 0;
    }
    CHECK_NUM(!differ && !lost, differ + lost);
    drop(&a), drop(&b);
}

TEST(sets_contain_each_other_in_morton_order) {
    how h = plainly();
    result r[3];
    clear(&one);
    seed = 1;
    soup(&one, 2500, 1, 50);
    const pbs_cells cells[3] = {PBS_CELLS_SEPARATING, PBS_CELLS_THIN, PBS_CELLS_CONSERVATIVE};
    for (int i = 0; i < 3; i++) {
        h.params.cells = cells[i];
        r[i] = work(&h, &one.mesh);
        for (size_t k = 1; k < r[i].v.count; k++)
            CHECK(pbs_morton8(r[i].v.place[k - 1]) < pbs_morton8(r[i].v.place[k]));
        if (!i) continue;
        CHECK(r[i].v.count > r[i - 1].v.count);
        for (size_t a = 0, b = 0; a < r[i - 1].v.count; a++) {
            while (b < r[i].v.count && (r[i].v.place[b] ^ r[i - 1].v.place[a]) << 8) b++;
            CHECK(b < r[i].v.count);
        }
    }
    CHECK_NUM(r[1].v.count == r[0].v.count + r[1].stats.orphans, r[1].stats.orphans);
    CHECK(r[2].v.count == r[2].stats.touched);
    CHECK_NUM(fabs(r[2].stats.kept / r[2].stats.area - 1) < 1e-12, r[2].stats.kept);
    CHECK(r[0].stats.kept < r[0].stats.area);
    for (int i = 0; i < 3; i++) drop(&r[i]);
}

/* Of a closed surface area times normal is 0, and areas are those of the triangles. */
static void check_closed(const shape *s, bool tight) {
    how h = plainly();
    double area = 0;
    for (uint32_t i = 0; i < s->mesh.triangles; i++) {
        double e[2][3], n = 0;
        for (int k = 0; k < 3; k++)
            for (int c = 0; c < 2; c++)
                e[c][k] = (double)s->position[3 * s->index[3 * i + 1 + (uint32_t)c] + k] -
                          s->position[3 * s->index[3 * i] + k];
        for (int k = 0; k < 3; k++) {
            int a = (k + 1) % 3, b = (k + 2) % 3;
            double v = e[0][a] * e[1][b] - e[0][b] * e[1][a];
            n += v * v;
        }
        area += sqrt(n) / 2;
    }
    result r = work(&h, &s->mesh);
    CHECK_NUM(fabs(r.sum[0] / area - 1) < 1e-9, r.sum[0] / area - 1);
    CHECK_NUM(fabs(r.stats.area / area - 1) < 1e-9, r.stats.area / area - 1);
    for (int k = 1; k < 4; k++) CHECK_NUM(fabs(r.sum[k]) < (tight ? 1e-9 : 1) * area, r.sum[k]);
    drop(&r);
}

TEST(closed_meshes_have_no_sum_of_normals) {
    clear(&one);
    sphere(&one, 31.3, 32.2, 30.7, 27.9, 40);
    check_closed(&one, true);
    clear(&one);
    sphere(&one, 31.3, 32.2, 30.7, 0.37, 50); /* all triangles far below a voxel */
    check_closed(&one, true);
    clear(&one);
    seed = 12;
    soup(&one, 400, 3, 9);
    for (uint32_t i = 0; i < 3 * one.mesh.vertices; i++)
        one.position[i] = (float)(20 + one.position[i] / 4);
    check_closed(&one, false);
}

/* Turned over: by the indices, by a word, by a mirrored placing of the mirrored mesh. */
TEST(orientation) {
    how h = plainly();
    clear(&one), clear(&two);
    sphere(&one, 31.3, 32.2, 30.7, 20, 12);
    sphere(&two, 31.3, 32.2, 30.7, 20, 12);
    for (uint32_t i = 0; i < two.mesh.triangles; i++) {
        uint16_t c = two.index[3 * i + 1];
        two.index[3 * i + 1] = two.index[3 * i + 2], two.index[3 * i + 2] = c;
    }
    result a = work(&h, &one.mesh), b = work(&h, &two.mesh);
    h.sides = PBS_SIDES_IN;
    result c = work(&h, &one.mesh), d = work(&h, &two.mesh);
    h.sides = PBS_SIDES_OUT;
    clear(&two);
    sphere(&two, 31.3, 32.2, 30.7, 20, 12);
    for (uint32_t i = 0; i < two.mesh.vertices; i++) two.position[3 * i] *= -1;
    h.to.m[0] = -1;
    result e = work(&h, &two.mesh);
    h.sides = PBS_SIDES_UNKNOWN;
    result f = work(&h, &two.mesh);
    CHECK(alike(&b, &c) && alike(&a, &d) && a.v.count == b.v.count);
    /* The mirrored mesh is seen clockwise; outside in its own frame is what was inside. */
    CHECK(alike(&b, &e));
    size_t wrong = 0, sided = 0;
    for (size_t i = 0; i < a.v.count; i++) {
        float m[3], n[3], p[3] = {31.3f, 32.2f, 30.7f}, out = 0;
        pbs_normal10_get(m, a.v.normal[i]), pbs_normal10_get(n, b.v.normal[i]);
        for (int k = 0; k < 3; k++) {
            wrong += fabsf(m[k] + n[k]) > 0.003f;
            out += m[k] * ((float)(a.v.place[i] >> 8 * k & 255) - 63.5f - p[k]);
        }
        wrong += out < 0;
        wrong += (a.v.place[i] ^ b.v.place[i]) << 8 != 0;
        wrong += (a.v.place[i] | b.v.place[i]) >> 30 & 1;
        sided += f.v.place[i] >> 30 & 1;
        /* Neighbours hide the same faces in both. */
        wrong += (faces_of(&a, i) | faces_of(&b, i)) != faces_of(&f, i);
    }
    CHECK_NUM(!wrong, wrong);
    CHECK(f.v.count == a.v.count && sided == f.v.count);
    drop(&a), drop(&b), drop(&c), drop(&d), drop(&e), drop(&f);
}

/* Eight blocks, so that faces are hidden across their borders, and chunks. */
static size_t gather(how h, const pbs_mesh *mesh, const int move[3], uint32_t *place, float *weight,
                     size_t most) {
    size_t n = 0;
    for (int k = 0; k < 3; k++) h.to.whole[k] = 64 + move[k];
    pbs_run run = {.threads = 1};
    pbs_block *b = fresh(&run, &h);
    for (int i = 0; i < 27; i++) {
        h.at[0] = (uint32_t)(i % 3) * 64, h.at[1] = (uint32_t)(i / 3 % 3) * 64;
        h.at[2] = (uint32_t)(i / 9) * 64;
        pbs_block_begin(b, h.at, h.size);
        feed(b, &h, mesh);
        result r = take(b);
        for (size_t k = 0; k < r.v.count && n < most; k++, n++) {
            uint32_t p = r.v.place[k];
            uint32_t x = (p & 255) - (uint32_t)move[0], y = (p >> 8 & 255) - (uint32_t)move[1];
            uint32_t z = (p >> 16 & 255) - (uint32_t)move[2];
            place[n] = PBS_PLACE(x, y, z, p >> 24), weight[n] = r.v.weight[k];
        }
        drop(&r);
    }
    pbs_block_free(b);
    CHECK(n < most);
    return n;
}

static uint32_t shown[60000];
static float shown_weight[60000];

TEST(moved_by_whole_voxels) {
    enum { N = 60000 };
    uint32_t *place = malloc(N * sizeof *place);
    float *weight = malloc(N * sizeof *weight);
    how h = plainly();
    clear(&one);
    sphere(&one, 31.3, 32.2, 30.7, 27.9, 40);
    sphere(&one, 29.3, 26.2, 30.1, 9.5, 10);
    size_t n = gather(h, &one.mesh, (const int[3]){0, 0, 0}, place, weight, N);
    CHECK_NUM(n > 9000, n);
    size_t m = gather(h, &one.mesh, (const int[3]){23, 31, -41}, shown, shown_weight, N);
    CHECK(m == n);
    uint64_t sum[2] = {0, 0};
    double area[2] = {0, 0};
    /* In another order now: sums of hashes say that the sets are equal. */
    for (size_t i = 0; i < n && i < m; i++) {
        sum[0] += place[i] * UINT64_C(0x9e3779b97f4a7c15) ^ place[i] * UINT64_C(77777777777);
        sum[1] += shown[i] * UINT64_C(0x9e3779b97f4a7c15) ^ shown[i] * UINT64_C(77777777777);
        area[0] += weight[i], area[1] += shown_weight[i];
    }
    CHECK_NUM(sum[0] == sum[1], m);
    CHECK_NUM(fabs(area[0] / area[1] - 1) < 1e-6, area[0] / area[1] - 1);
    free(place), free(weight);
}

/* From outside, no path through faces leads inside; and who stands outside sees no voxel from a
 * side that it does not have. */
TEST(closed_surfaces_separate) {
    static uint8_t cell[64][64][64], faces[64][64][64];
    static uint32_t stack[64 * 64 * 64];
    how h = plainly();
    clear(&one);
    sphere(&one, 31.3, 32.2, 30.7, 22.9, 9);
    result r = work(&h, &one.mesh);
    memset(cell, 0, sizeof cell);
    for (size_t i = 0; i < r.v.count; i++) {
        uint32_t p = r.v.place[i];
        cell[(p >> 16 & 255) - 64][(p >> 8 & 255) - 64][(p & 255) - 64] = 1;
        faces[(p >> 16 & 255) - 64][(p >> 8 & 255) - 64][(p & 255) - 64] = (uint8_t)(p >> 24);
    }
    uint32_t n = 0, without = 0;
    stack[n++] = 0, cell[0][0][0] = 2;
    while (n) {
        uint32_t c = stack[--n];
        for (int f = 0; f < 6; f++) {
            int p[3] = {(int)(c & 63), (int)(c >> 6 & 63), (int)(c >> 12)};
            p[f / 2] += f & 1 ? 1 : -1;
            if (p[f / 2] < 0 || p[f / 2] > 63) continue;
            uint8_t *to = &cell[p[2]][p[1]][p[0]];
            if (*to == 1) without += !(faces[p[2]][p[1]][p[0]] >> (f ^ 1) & 1);
            if (*to) continue;
            *to = 2;
            stack[n++] = (uint32_t)(p[0] | p[1] << 6 | p[2] << 12);
        }
    }
    CHECK(cell[30][32][31] == 0);
    /* Voxels on whose outer side the surface only passes by may lack a face. */
    CHECK_NUM(without * 50 < r.v.count, without);
    drop(&r);
}

/* ---- small cases ---- */

TEST(constant_colour_stays) {
    how h = plainly();
    h.params.channels = ALL;
    size_t wrong = 0;
    for (int code = 0; code < 256; code += 5) {
        clear(&one);
        seed = (uint64_t)code;
        soup(&one, 20, 6, 30);
        soup(&one, 20, 1e-4, 1e-5);
        for (uint32_t i = 0; i < one.mesh.vertices; i++) {
            uint8_t c[4] = {(uint8_t)code, (uint8_t)(255 - code), (uint8_t)(code / 2), 255};
            memcpy(one.colour + 4 * i, c, 4);
        }
        one.mesh.colour = one.colour;
        pbs_material m = PBS_MATERIAL_DEFAULT;
        m.metallic = (float)code / 255, m.roughness = 0.5f, m.emissive[1] = (float)code / 256;
        pbs_surfaces *s;
        CHECK(!pbs_surfaces_new(&materials_run, &m, 1, NULL, 0, ALL, &s, NULL));
        h.params.surfaces = s;
        one.mesh.material = 0;
        result r = work(&h, &one.mesh);
        uint32_t glow = (uint32_t)pbs_srgb_encode(pbs_srgb(), m.emissive[1]) << 8;
        uint32_t want = (uint32_t)(code | (255 - code) << 8 | code / 2 << 16) | 255u << 24;
        for (size_t i = 0; i < r.v.count; i++)
            wrong += (r.v.colour[i] != want) + (r.v.material[i] != ((uint32_t)code | 128 << 8)) +
                     (r.v.emissive[i] != glow);
        CHECK(r.v.count > 40);
        drop(&r);
        pbs_surfaces_free(&materials_run, s);
    }
    CHECK_NUM(!wrong, wrong);
}

/* A corner of a huge red triangle and a blue one: the area in the voxel counts, in linear light. */
TEST(colours_mix_by_area) {
    how h = plainly();
    h.params.channels = PBS_COLOUR | PBS_WEIGHT;
    h.params.cells = PBS_CELLS_CONSERVATIVE;
    clear(&one);
    int v[6] = {vertex(&one, 10.6, 10.6, 10.25), vertex(&one, -500, 10.6, 10.25),
                vertex(&one, 10.6, -500, 10.25), vertex(&one, 10, 10, 10.75),
                vertex(&one, 10.8, 10, 10.75),   vertex(&one, 10, 10.8, 10.75)};
    triangle(&one, v[0], v[1], v[2]), triangle(&one, v[3], v[4], v[5]);
    static const uint8_t red[4] = {255, 0, 0, 255}, blue[4] = {0, 0, 255, 255};
    for (int i = 0; i < 6; i++) memcpy(one.colour + 4 * i, i < 3 ? red : blue, 4);
    one.mesh.colour = one.colour;
    h.params.surfaces = surfaces(PBS_COLOUR);
    result r = work(&h, &one.mesh);
    long i = find(&r, 74, 74, 74);
    CHECK(i >= 0);
    float a = 0.36f, b = 0.32f, all = a + b;
    CHECK_NUM(fabsf(r.v.weight[i] - all) < 1e-6f, r.v.weight[i]);
    uint32_t want = (uint32_t)pbs_srgb_encode(pbs_srgb(), a / all) |
                    (uint32_t)pbs_srgb_encode(pbs_srgb(), b / all) << 16 | 255u << 24;
    CHECK_NUM(r.v.colour[i] == want, r.v.colour[i]);
    drop(&r);
    pbs_surfaces_free(&materials_run, (void *)(uintptr_t)h.params.surfaces);
}

/* A sheet of paper, both of its sides in one voxel. */
TEST(thin_sheets_have_two_sides) {
    how h = plainly();
    clear(&one);
    int v[8];
    for (int i = 0; i < 8; i++)
        v[i] = vertex(&one, i & 1 ? 50 : 10, i & 2 ? 50 : 10, i & 4 ? 20.7 : 20.3);
    quad(&one, v[0], v[2], v[3], v[1]);
    quad(&one, v[4], v[5], v[7], v[6]);
    result r = work(&h, &one.mesh);
    size_t wrong = 0;
    CHECK(r.v.count >= 39 * 39);
    for (size_t i = 0; i < r.v.count; i++) {
        float n[3];
        pbs_normal10_get(n, r.v.normal[i]);
        wrong += !(r.v.place[i] >> 30 & 1) || fabsf(n[2]) < 0.99f ||
                 (faces_of(&r, i) & 0x30) != (PBS_FACE_Z0 | PBS_FACE_Z1);
    }
    CHECK_NUM(!wrong, wrong);
    drop(&r);
    /* One side alone has one. */
    one.mesh.triangles = 2;
    r = work(&h, &one.mesh);
    for (size_t i = 0; i < r.v.count; i++)
        wrong += r.v.place[i] >> 30 & 1 || faces_of(&r, i) != PBS_FACE_Z0;
    CHECK_NUM(!wrong, wrong);
    drop(&r);
    h.params.interior = true;
    r = work(&h, &one.mesh);
    for (size_t i = 0; i < r.v.count; i++) wrong += faces_of(&r, i) != (PBS_FACE_Z0 | PBS_FACE_Z1);
    CHECK_NUM(!wrong, wrong);
    drop(&r);
}

TEST(touches_weigh_next_to_nothing) {
    how h = plainly();
    h.params.channels |= PBS_COLOUR;
    h.params.surfaces = surfaces(PBS_COLOUR);
    clear(&one);
    int a = vertex(&one, 20.5, 20.5, 20.5), b = vertex(&one, 30.25, 20.5, 20.5);
    triangle(&one, a, a, a), triangle(&one, a, b, b);
    static const uint8_t green[4] = {0, 99, 0, 255};
    memcpy(one.colour, green, 4), memcpy(one.colour + 4, green, 4);
    one.mesh.colour = one.colour;
    result r = work(&h, &one.mesh);
    CHECK_NUM(r.v.count == 11, r.v.count);
    for (size_t i = 0; i < r.v.count; i++) {
        CHECK(r.v.weight[i] == 0x1p-30f && r.v.colour[i] == (99u << 8 | 255u << 24));
        CHECK(r.v.place[i] >> 30 & 1);
    }
    CHECK(r.stats.area == 0 && r.sum[0] == 0);
    drop(&r);
    pbs_surfaces_free(&materials_run, (void *)(uintptr_t)h.params.surfaces);
}

TEST(small_parts_are_kept) {
    how h = plainly();
    clear(&one);
    int a = vertex(&one, 20.1, 20.1, 20.1), b = vertex(&one, 20.2, 20.1, 20.1);
    triangle(&one, a, b, vertex(&one, 20.1, 20.2, 20.1));
    result r = work(&h, &one.mesh);
    CHECK(r.v.count == 1 && r.stats.orphans == 1 && find(&r, 84, 84, 84) == 0);
    CHECK_NUM(fabsf(r.v.weight[0] - 0.005f) < 1e-6f, r.v.weight[0]);
    CHECK(faces_of(&r, 0) == PBS_FACE_Z1);
    drop(&r);
    h.params.cells = PBS_CELLS_SEPARATING;
    r = work(&h, &one.mesh);
    CHECK(r.v.count == 0 && r.stats.kept == 0 && r.stats.area > 0);
    drop(&r);
}

TEST(borders_of_chunks_have_caps) {
    how h = plainly();
    clear(&one);
    int v[4];
    for (int i = 0; i < 4; i++) v[i] = vertex(&one, i & 1 ? 400 : -400, i & 2 ? 400 : -400, 63.5);
    quad(&one, v[0], v[1], v[3], v[2]);
    for (int i = 0; i < 2; i++) {
        h.at[0] = i ? 0 : 192, h.at[1] = 64, h.at[2] = 192;
        for (int k = 0; k < 3; k++) h.to.whole[k] = h.at[k];
        result r = work(&h, &one.mesh);
        size_t wrong = 0;
        CHECK(r.v.count == 64 * 64);
        for (size_t k = 0; k < r.v.count; k++) {
            uint32_t x = r.v.place[k] & 255, want = PBS_FACE_Z1;
            if (x == 0) want |= PBS_FACE_X0;
            if (x == 255) want |= PBS_FACE_X1;
            wrong += faces_of(&r, k) != want;
        }
        CHECK_NUM(!wrong, wrong);
        drop(&r);
    }
    /* Cells behind the end of the grid are not there, and hide nothing. */
    h = plainly();
    h.size = 64 + 20;
    result r = work(&h, &one.mesh);
    CHECK(r.v.count == 0 && r.stats.touched == 0 && r.stats.area == 0);
    drop(&r);
    h.to.whole[2] = 14;
    r = work(&h, &one.mesh);
    CHECK(r.v.count == 20 * 20 && fabs(r.stats.area - 400) < 1e-9);
    drop(&r);
}

/* Triangles of 10^9 voxels: the plane is the same, and what shares an edge stays together. */
TEST(far_triangles) {
    how h = plainly();
    clear(&one), clear(&two);
    int v[5] = {vertex(&one, -3e9, -2e9, 20.25), vertex(&one, 4e9, -3e9, 20.25),
                vertex(&one, 1e9, 5e9, 20.25)};
    triangle(&one, v[0], v[1], v[2]);
    result a = work(&h, &one.mesh);
    CHECK_NUM(a.v.count == 64 * 64, a.v.count);
    CHECK_NUM(fabs(a.stats.area - 4096) < 1e-6, a.stats.area);
    for (size_t i = 0; i < a.v.count; i++) CHECK(a.v.place[i] >> 16 == (PBS_FACE_Z1 << 8 | 84));
    drop(&a);
    v[0] = vertex(&two, -3e8, -2e8, -1.4e8), v[1] = vertex(&two, 4e8, -3e7, 1e8);
    v[2] = vertex(&two, 1e7, 5e8, 2e8), v[3] = vertex(&two, 2e6, -3e9, -7e8);
    triangle(&two, v[0], v[1], v[2]), triangle(&two, v[1], v[0], v[3]);
    h.params.cells = PBS_CELLS_SEPARATING;
    a = work(&h, &two.mesh);
    result b;
    h.order = 1, h.portable = true;
    b = work(&h, &two.mesh);
    CHECK(same(&a, &b));
    drop(&a), drop(&b);
    /* Beyond all bounds: nothing, but no harm. */
    h.to.m[0] = 1e300, h.to.m[4] = 1e290;
    a = work(&h, &two.mesh);
    drop(&a);
}

TEST(masks_and_textures) {
    for (int y = 0; y < 64; y++)
        for (int x = 0; x < 64; x++) {
            uint8_t *p = pixels + 4 * (64 * y + x);
            p[0] = p[1] = p[2] = (uint8_t)(x < 32 ? 40 : 200);
            p[3] = (uint8_t)(y < 32 ? 255 : 0);
        }
    pbs_material m = PBS_MATERIAL_DEFAULT;
    m.base_texture.texture = 0;
    m.base_texture.wrap_u = m.base_texture.wrap_v = 1;
    clear(&one);
    for (int i = 0; i < 4; i++) {
        vertex(&one, i & 1 ? 52 : 4, i & 2 ? 52 : 4, 20.25);
        one.uv[2 * i] = (float)(i & 1), one.uv[2 * i + 1] = (float)(i >> 1);
    }
    quad(&one, 0, 1, 3, 2);
    one.mesh.uv = one.uv, one.mesh.material = 0;
    for (int masked = 0; masked < 3; masked++) {
        how h = plainly();
        m.alpha = masked ? PBS_ALPHA_MASK : PBS_ALPHA_OPAQUE;
        pbs_surfaces *s;
        CHECK(!pbs_surfaces_new(&materials_run, &m, 1, &image, 1, PBS_COLOUR, &s, NULL));
        h.params.channels = masked == 2 ? 0 : PBS_COLOUR | PBS_WEIGHT;
        h.params.surfaces = s;
        result r = work(&h, &one.mesh);
        size_t wrong = 0;
        double want = masked ? 48 * 24 : 48 * 48;
        CHECK_NUM(fabs((double)r.v.count - want) <= 48, r.v.count);
        if (masked < 2) CHECK_NUM(fabs(r.stats.area - want) <= 48.001, r.stats.area);
        for (size_t i = 0; i < r.v.count; i++) {
            int x = (int)(r.v.place[i] & 255) - 64, y = (int)(r.v.place[i] >> 8 & 255) - 64;
            if (masked) wrong += y > 28;
            if (x > 26 && x < 29) continue;
            if (masked < 2) wrong += abs((int)(r.v.colour[i] & 255) - (x < 28 ? 40 : 200)) > 2;
        }
        CHECK_NUM(!wrong, wrong);
        drop(&r);
        pbs_surfaces_free(&materials_run, s);
    }
}

TEST(attributes_of_faces) {
    how h = plainly();
    pbs_surfaces *s = surfaces(PBS_COLOUR);
    clear(&one);
    /* A box of 0.8 in one cell: each side has its own material, two of them on the top. */
    int v[9];
    for (int i = 0; i < 8; i++)
        v[i] = vertex(&one, i & 1 ? 20.9 : 20.1, i & 2 ? 20.9 : 20.1, i & 4 ? 20.9 : 20.1);
    v[8] = vertex(&one, 20.1 + 0.3, 20.1, 20.9);
    triangle(&one, v[4], v[8], v[6]);
    triangle(&one, v[8], v[5], v[7]), triangle(&one, v[8], v[7], v[6]);
    quad(&one, v[0], v[2], v[3], v[1]);
    quad(&one, v[0], v[4], v[6], v[2]), quad(&one, v[1], v[3], v[7], v[5]);
    quad(&one, v[0], v[1], v[5], v[4]), quad(&one, v[2], v[6], v[7], v[3]);
    static const uint32_t of[13] = {0, 2, 2, 1, 1, 0, 0, 1, 1, 2, 2, PBS_NONE, PBS_NONE};
    memcpy(one.material, of, sizeof of);
    one.mesh.triangle_material = one.material;
    h.params.surfaces = s;
    h.params.per_face = PBS_PER_FACE_MATERIAL;
    result r = work(&h, &one.mesh);
    CHECK(r.v.count == 1 && r.face_count == 6 && r.v.face[0] == 0);
    static const uint32_t want[6] = {0, 1, 2, PBS_NONE, 1, 2};
    CHECK(!memcmp(r.faces, want, sizeof want));
    drop(&r);
    h.params.per_face = PBS_PER_FACE_COLOUR;
    r = work(&h, &one.mesh);
    CHECK(r.v.count == 1 && r.face_count == 6);
    for (int f = 0; f < 5; f++) {
        uint32_t c = 255u << 24;
        for (int k = 0; k < 3; k++)
            c |= (uint32_t)pbs_srgb_encode(pbs_srgb(),
                                           want[f] == PBS_NONE ? 1 : material[want[f]].base[k])
                 << 8 * k;
        CHECK_NUM(r.faces[f] == c, f);
    }
    /* The top: 0.12 of material 0 and 0.52 of material 2. */
    uint32_t c = 255u << 24;
    for (int k = 0; k < 3; k++)
        c |= (uint32_t)pbs_srgb_encode(
                 pbs_srgb(),
                 (float)((0.12 * material[0].base[k] + 0.52 * material[2].base[k]) / 0.64))
             << 8 * k;
    CHECK_NUM(r.faces[5] == c, r.faces[5]);
    drop(&r);
    pbs_surfaces_free(&materials_run, s);
}

/* Vertex normals are turned to the side of the triangle. */
TEST(vertex_normals) {
    how h = plainly();
    clear(&one);
    for (int i = 0; i < 4; i++) {
        float n[3] = {i & 1 ? 0.5f : -0.5f, 0, i == 2 ? -1 : 1};
        if (i == 2) n[0] = -n[0];
        vertex(&one, i & 1 ? 52 : 4, i & 2 ? 52 : 4, 20.25);
        pbs_oct_encode(one.normal + 2 * i, n);
    }
    one.mesh.normal = one.normal;
    triangle(&one, 0, 1, 3);
    result r = work(&h, &one.mesh);
    size_t wrong = 0;
    for (size_t i = 0; i < r.v.count; i++) {
        float n[3], x = (float)(r.v.place[i] & 255) - 63.5f;
        pbs_normal10_get(n, r.v.normal[i]);
        float at = (x - 28) / 48 / sqrtf(1 + (x - 28) * (x - 28) / 48 / 48);
        wrong += fabsf(n[0] - at) > 0.02f || n[2] < 0.8f;
    }
    CHECK_NUM(r.v.count > 1000 && !wrong, wrong);
    drop(&r);
}

/* Everything full: within what the header says, and a smaller limit is an error that leaves the
 * block usable. */
TEST(memory) {
    how h = plainly();
    clear(&one);
    for (int i = 0; i < 3 * 64; i++) {
        int k = i / 64, a = (k + 1) % 3, b = (k + 2) % 3, v[4];
        for (int c = 0; c < 4; c++) {
            double p[3];
            p[k] = i % 64 + 0.25, p[a] = c & 1 ? 70 : -5, p[b] = c & 2 ? 70 : -5;
            v[c] = vertex(&one, p[0], p[1], p[2]);
        }
        quad(&one, v[0], v[1], v[3], v[2]);
    }
    pbs_run run = {.threads = 1, .mem_limit = (size_t)1 << 22};
    pbs_block *b = fresh(&run, &h);
    pbs_err err;
    for (uint32_t i = 0; i < one.mesh.triangles; i++) list[i] = i;
    pbs_block_begin(b, h.at, h.size);
    CHECK(pbs_block_add(b, &one.mesh, list, one.mesh.triangles, &h.to, h.sides, &err) == PBS_LIMIT);
    pbs_block_begin(b, h.at, h.size);
    CHECK(!pbs_block_add(b, &one.mesh, list, 1, &h.to, h.sides, &err));
    run.mem_limit = PBS_BLOCK_MEMORY;
    pbs_block_begin(b, h.at, h.size);
    feed(b, &h, &one.mesh);
    result r = take(b);
    CHECK(r.v.count == 64 * 64 * 64);
    CHECK_NUM(fabs(r.stats.area - 3 * 64 * 4096.0) < 1e-3, r.stats.area);
    drop(&r);
    pbs_block_free(b);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST_MAIN
