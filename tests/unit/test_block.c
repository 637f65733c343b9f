/* Blocks of voxels: laws that hold for any triangles. */
#include "tests/unit/block_shapes.h"

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
    size_t wrong = 0, sided = 0, turned = 0;
    for (size_t i = 0; i < a.v.count; i++) {
        float m[3], n[3], u[3], p[3] = {31.3f, 32.2f, 30.7f}, out = 0, along = 0;
        pbs_normal10_get(m, a.v.normal[i]), pbs_normal10_get(n, b.v.normal[i]);
        pbs_normal10_get(u, f.v.normal[i]);
        for (int k = 0; k < 3; k++) {
            wrong += fabsf(m[k] + n[k]) > 0.003f;
            along += m[k] * u[k];
            out += m[k] * ((float)(a.v.place[i] >> 8 * k & 255) - 63.5f - p[k]);
        }
        wrong += out < 0;
        /* Also where the surface runs along the fixed direction, whose two sides meet there. */
        turned += fabsf(along) < 0.99f;
        wrong += (a.v.place[i] ^ b.v.place[i]) << 8 != 0;
        wrong += (a.v.place[i] | b.v.place[i]) >> 30 & 1;
        sided += f.v.place[i] >> 30 & 1;
        /* Neighbours hide the same faces in both. */
        wrong += (faces_of(&a, i) | faces_of(&b, i)) != faces_of(&f, i);
    }
    CHECK_NUM(!wrong, wrong);
    CHECK_NUM(!turned, turned);
    CHECK(f.v.count == a.v.count && sided == f.v.count);
    drop(&a), drop(&b), drop(&c), drop(&d), drop(&e), drop(&f);
}

/* A voxel of the grid, moved back. */
typedef struct shown {
    uint32_t place, normal;
    float weight;
} shown;

static int by_place(const void *a, const void *b) {
    const shown *x = a, *y = b;
    return (x->place > y->place) - (x->place < y->place);
}

/* Eight blocks, so that faces are hidden across their borders, and chunks; sorted by place. */
static size_t gather(how h, const pbs_mesh *mesh, const int move[3], shown *out, size_t most) {
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
            out[n] = (shown){PBS_PLACE(x, y, z, p >> 24), r.v.normal[k], r.v.weight[k]};
        }
        drop(&r);
    }
    pbs_block_free(b);
    CHECK(n < most);
    qsort(out, n, sizeof *out, by_place);
    return n;
}

/* Small triangles and large ones, wherever the blocks' borders are: the same bits. */
TEST(moved_by_whole_voxels) {
    enum { N = 60000 };
    static const int move[][3] = {{23, 31, -41}, {1, 0, 0}, {-17, 64, 5}};
    shown *a = malloc(N * sizeof *a), *b = malloc(N * sizeof *b);
    how h = plainly();
    clear(&one);
    sphere(&one, 31.3, 32.2, 30.7, 27.9, 40);
    sphere(&one, 29.3, 26.2, 30.1, 19.5, 4);
    size_t n = gather(h, &one.mesh, (const int[3]){0, 0, 0}, a, N);
    CHECK_NUM(n > 9000, n);
    for (int i = 0; i < 3; i++) {
        size_t m = gather(h, &one.mesh, move[i], b, N);
        CHECK_NUM(m == n && !memcmp(a, b, n * sizeof *a), i);
    }
    free(a), free(b);
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

/* Room for voxels is counted brick by brick, in the order in which these were taken. */
TEST(bricks_know_their_place) {
    how h = plainly();
    pbs_run run = {.threads = 1};
    clear(&one);
    soup(&one, 50, 6, 30);
    pbs_block *b = fresh(&run, &h);
    pbs_block_begin(b, h.at, h.size);
    feed(b, &h, &one.mesh);
    CHECK(b->bricks.count > 10);
    for (uint32_t i = 0; i < b->bricks.count; i++) {
        const pbs_brick *p = pbs_brick_number(&b->bricks, i);
        CHECK_NUM(b->bricks.at[p->index] == p, p->index);
    }
    pbs_block_free(b);
}

TEST_MAIN
