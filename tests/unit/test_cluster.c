/* Clusters: every triangle once, inside all boxes above it; neighbours together. Windings: what is
 * closed, and which side is out. */
#include "libcore/voxels/cluster.h"
#include "libcore/ground/pipe.h"
#include "libcore/voxels/winding.h"
#include "tests/check.h"
#include <time.h>

static pbs_run run = {.threads = 2};
static pbs_err err;

static uint32_t random_bits(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(*state >> 32);
}

static double chance(uint64_t *state) {
    return random_bits(state) / 4294967296.0;
}

typedef struct shape {
    pbs_mesh mesh;
    float *position;
    uint16_t *index;
} shape;

static shape new_shape(uint32_t vertices, uint32_t triangles) {
    shape s = {.position = calloc(3 * (size_t)vertices + 1, sizeof(float)),
               .index = calloc(3 * (size_t)triangles + 1, sizeof(uint16_t))};
    s.mesh = (pbs_mesh){.vertices = vertices,
                        .triangles = triangles,
                        .position = s.position,
                        .index = s.index,
                        .material = PBS_NONE};
    return s;
}

static void free_shape(shape *s) {
    free(s->position);
    free(s->index);
}

/* Small triangles all over a unit cube. */
static shape soup(uint32_t triangles, uint64_t seed) {
    uint32_t vertices = triangles < 20000 ? 3 * triangles : 60000;
    shape s = new_shape(vertices, triangles);
    for (uint32_t i = 0; i < vertices; i++) {
        static double at[3];
        for (int k = 0; k < 3; k++) {
            if (i % 3 == 0) at[k] = chance(&seed);
            s.position[3 * i + (uint32_t)k] = (float)(at[k] + 0.01 * chance(&seed));
        }
    }
    for (uint32_t t = 0; t < triangles; t++)
        for (uint32_t k = 0; k < 3; k++) s.index[3 * t + k] = (uint16_t)((3 * t + k) % vertices);
    return s;
}

/* ---- clusters ---- */

static bool holds(const float box[6], const float p[3]) {
    for (int k = 0; k < 3; k++)
        if (p[k] < box[k] || p[k] > box[k + 3]) return false;
    return true;
}

static void check_tree(const pbs_mesh *m, const pbs_clusters *c) {
    uint8_t *seen = calloc(m->triangles + 1, 1);
    uint32_t bad = 0, once = 0, tight = 0;
    for (int l = 0; l < c->levels; l++) {
        uint32_t below = 0;
        for (uint32_t i = 0; i < c->count[l]; i++) {
            uint32_t first, n = pbs_clusters_below(c, l, i, &first), faces = 0;
            below += n;
            for (uint32_t t = first; t < first + n; t++)
                for (int v = 0; v < 3; v++) {
                    const float *p = m->position + 3 * m->index[3 * c->order[t] + (uint32_t)v];
                    bad += !holds(c->box[l][i], p);
                    for (int k = 0; k < 3; k++)
                        faces |= (p[k] == c->box[l][i][k] ? 1u : 0u) << k |
                                 (p[k] == c->box[l][i][k + 3] ? 8u : 0u) << k;
                }
            tight += faces == 63;
        }
        CHECK(below == m->triangles);
        CHECK(tight == c->count[l]);
        tight = 0;
    }
    for (uint32_t t = 0; t < m->triangles; t++) once += !seen[c->order[t]]++;
    CHECK(!bad);
    CHECK(once == m->triangles);
    free(seen);
}

TEST(every_triangle_is_in_its_boxes) {
    static const uint32_t sizes[] = {1,   2,    63,   64,   65,    128,   511,   512,
                                     513, 4095, 4096, 4097, 20000, 32768, 65537, 131072};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        shape s = soup(sizes[i], i);
        pbs_clusters c;
        size_t bytes = pbs_clusters_bytes(sizes[i]);
        uint8_t *memory = malloc(bytes + 4);
        memset(memory + bytes, 77, 4);
        CHECK(bytes % 64 == 0);
        CHECK_NUM(sizes[i] > 64 ? bytes <= 4.5 * sizes[i] + 128 : bytes == 64, bytes);
        CHECK(!pbs_clusters_make(&run, &s.mesh, memory, &c, &err));
        check_tree(&s.mesh, &c);
        CHECK(c.count[c.levels - 1] == 1 && c.count[0] == (sizes[i] + 63) / 64);
        CHECK(memory[bytes] == 77 && memory[bytes + 3] == 77);
        free(memory);
        free_shape(&s);
    }
    CHECK(pbs_clusters_bytes(0) == 0);
    CHECK(!run.mem_used);
}

TEST(no_triangles) {
    shape s = new_shape(0, 0);
    pbs_clusters c;
    CHECK(!pbs_clusters_make(&run, &s.mesh, NULL, &c, &err));
    CHECK(c.levels == 0);
    free_shape(&s);
}

/* In a cube of n clusters, each should have a box of about 1 / n of its volume; by chance, nearly
 * all of it. */
TEST(clusters_are_small) {
    shape s = soup(65536, 5);
    pbs_clusters c;
    double volume = 0;
    void *memory = malloc(pbs_clusters_bytes(s.mesh.triangles));
    CHECK(!pbs_clusters_make(&run, &s.mesh, memory, &c, &err));
    for (uint32_t i = 0; i < c.count[0]; i++) {
        const float *b = c.box[0][i];
        volume += (double)(b[3] - b[0]) * (b[4] - b[1]) * (b[5] - b[2]);
    }
    CHECK_NUM(volume < 4, volume);
    free(memory);
    free_shape(&s);
}

TEST(numbers_as_large_as_they_get) {
    shape s = soup(300, 9);
    pbs_clusters c;
    for (uint32_t i = 0; i < 900; i++) s.position[i] = i % 2 ? 3.4e38f : -3.4e38f;
    s.position[5] = 1e-45f;
    void *memory = malloc(pbs_clusters_bytes(s.mesh.triangles));
    CHECK(!pbs_clusters_make(&run, &s.mesh, memory, &c, &err));
    for (uint32_t i = 0; i < 900; i++) s.position[i] = 5;
    CHECK(!pbs_clusters_make(&run, &s.mesh, memory, &c, &err));
    check_tree(&s.mesh, &c);
    free(memory);
    free_shape(&s);
}

TEST(too_little_memory_to_sort) {
    pbs_run small = {.threads = 1, .mem_limit = 1000};
    shape s = soup(1000, 3);
    pbs_clusters c;
    void *memory = malloc(pbs_clusters_bytes(s.mesh.triangles));
    CHECK(pbs_clusters_make(&small, &s.mesh, memory, &c, &err) == PBS_LIMIT);
    free(memory);
    free_shape(&s);
}

/* ---- windings ---- */

enum { SIDE = 40 };

/* A sphere of triangles around c: rings of vertices, poles repeated as often as a ring has. */
static shape sphere(const double c[3], double radius) {
    shape s = new_shape((SIDE + 1) * SIDE, 2 * SIDE * (SIDE - 1));
    uint32_t t = 0;
    for (uint32_t i = 0; i <= SIDE; i++)
        for (uint32_t k = 0; k < SIDE; k++) {
            double a = M_PI * i / SIDE, b = 2 * M_PI * k / SIDE;
            double p[3] = {sin(a) * cos(b), sin(a) * sin(b), cos(a)};
            if (i % SIDE == 0) p[0] = k % 2 ? 0.0 : -0.0, p[1] = 0; /* one place, two zeros */
            for (int x = 0; x < 3; x++)
                s.position[3 * (SIDE * i + k) + (uint32_t)x] = (float)(c[x] + radius * p[x]);
        }
    for (uint16_t i = 0; i < SIDE; i++)
        for (uint16_t k = 0; k < SIDE; k++) {
            uint16_t n = (uint16_t)((k + 1) % SIDE), down = SIDE, row = (uint16_t)(SIDE * i);
            uint16_t a = (uint16_t)(row + k), b = (uint16_t)(row + n), e = (uint16_t)(a + down),
                     f = (uint16_t)(b + down);
            const uint16_t two[2][3] = {{a, e, f}, {a, f, b}};
            for (int x = 0; x < 2; x++)
                if (!(i == 0 && x == 1) && !(i == SIDE - 1 && x == 0))
                    memcpy(s.index + 3 * t++, two[x], sizeof two[x]);
        }
    return s;
}

static void turn(shape *s, uint32_t first, uint32_t end) {
    for (uint32_t t = first; t < end; t++) {
        uint16_t a = s->index[3 * t];
        s->index[3 * t] = s->index[3 * t + 1];
        s->index[3 * t + 1] = a;
    }
}

static pbs_wound says(const shape *s) {
    pbs_winding w = pbs_winding_of(&s->mesh);
    return pbs_winding_says(&w);
}

TEST(spheres) {
    static const double at[][4] = {
        {0, 0, 0, 1}, {0, 0, 0, 1e-20}, {0, 0, 0, 1e30}, {1000, -2000, 10, 1}, {1e5, 0, 0, 1}};
    for (size_t i = 0; i < sizeof at / sizeof *at; i++) {
        shape s = sphere(at[i], at[i][3]);
        pbs_winding w = pbs_winding_of(&s.mesh);
        double volume = 8 * M_PI * at[i][3] * at[i][3] * at[i][3];
        CHECK(says(&s) == PBS_WOUND_OUT);
        if (i < 4) CHECK_NUM(fabs(w.volume / volume - 1) < 0.01, w.volume / volume);
        turn(&s, 0, s.mesh.triangles);
        CHECK(says(&s) == PBS_WOUND_IN);
        turn(&s, 7, 8);
        CHECK(says(&s) == PBS_WOUND_OPEN);
        turn(&s, 7, 8);
        s.mesh.triangles--;
        CHECK(says(&s) == PBS_WOUND_OPEN);
        free_shape(&s);
    }
}

/* A leaf of two sides holds nothing. */
TEST(flat) {
    shape s = new_shape(4, 4);
    static const uint16_t index[] = {0, 1, 2, 1, 3, 2, 1, 0, 2, 3, 1, 2};
    uint64_t seed = 4;
    memcpy(s.index, index, sizeof index);
    for (int i = 0; i < 100; i++) {
        for (int k = 0; k < 12; k++) s.position[k] = (float)(1e6 * (chance(&seed) - 0.5));
        CHECK(says(&s) == PBS_WOUND_FLAT);
    }
    s.mesh.triangles = 3;
    CHECK(says(&s) == PBS_WOUND_OPEN);
    free_shape(&s);
}

/* Two shells in one part, a hollow one inside, and one piece for each triangle. */
TEST(shells_and_pieces) {
    shape a = sphere((double[3]){0, 0, 0}, 2), b = sphere((double[3]){0.1, 0, 0}, 1);
    turn(&b, 0, b.mesh.triangles);
    pbs_winding sum = {0, 0, 0};
    for (uint32_t t = 0; t < a.mesh.triangles; t++) {
        pbs_mesh one = a.mesh;
        one.index += 3 * t;
        one.triangles = 1;
        pbs_winding w = pbs_winding_of(&one);
        CHECK(pbs_winding_says(&w) == PBS_WOUND_OPEN);
        if (t) CHECK(pbs_winding_says(&sum) == PBS_WOUND_OPEN);
        pbs_winding_add(&sum, &w);
    }
    CHECK(pbs_winding_says(&sum) == PBS_WOUND_OUT);
    pbs_winding hollow = pbs_winding_of(&b.mesh);
    CHECK(pbs_winding_says(&hollow) == PBS_WOUND_IN);
    pbs_winding_add(&sum, &hollow);
    CHECK(pbs_winding_says(&sum) == PBS_WOUND_OUT);
    CHECK_NUM(fabs(sum.volume / (8 * M_PI * 7) - 1) < 0.01, sum.volume);
    free_shape(&a);
    free_shape(&b);
}

TEST_MAIN
