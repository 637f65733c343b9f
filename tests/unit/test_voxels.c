/* The grid around a box, transforms to it, Morton numbers, packed normals, and voxels as bytes. */
#include "formats/voxels/voxelstream.h"
#include "libcore/voxels/grid.h"
#include "libcore/voxels/morton.h"
#include "tests/check.h"
#include "tests/unit/support.h"

TEST(the_grid_leaves_half_a_voxel) {
    pbs_box box = {{1e7, -3, 5}, {1e7 + 8, -1, 5}};
    for (uint32_t n = 2; n <= 65536; n *= 2) {
        pbs_grid g = pbs_grid_around(&box, n);
        CHECK_NUM(fabs(g.voxel * (n - 1) - 8) < 1e-12, g.voxel);
        for (int k = 0; k < 3; k++) {
            double low = (box.min[k] - g.min[k]) / g.voxel,
                   high = (box.max[k] - g.min[k]) / g.voxel;
            CHECK_NUM(fabs(low - 0.5) < 1e-4 && high < n - 0.49, low);
        }
    }
}

TEST(a_grid_of_one_cell_or_around_a_point) {
    pbs_box box = {{-1, -1, -1}, {3, 1, 0}}, point = {{2, 2, 2}, {2, 2, 2}};
    pbs_grid g = pbs_grid_around(&box, 1);
    CHECK(g.voxel == 8 && g.min[0] == -3);
    g = pbs_grid_around(&point, 1024);
    CHECK(g.voxel == 1 && g.min[1] == 1.5);
}

/* Whole voxels more in the translation change the whole part only. */
TEST(a_transform_keeps_fractions) {
    pbs_grid g = {{0.125, 0, 0}, 0.25, 1024};
    double m[12] = {1, 0, 0, 0.3125, 0, 2, 0, -1, 0, 0, 1, 7};
    pbs_to_grid a, b;
    CHECK(pbs_to_grid_make(&a, &g, m));
    m[3] += 5 * 0.25;
    CHECK(pbs_to_grid_make(&b, &g, m));
    CHECK(a.whole[0] == 0 && a.part[0] == 0.75 && a.m[0] == 4 && a.m[4] == 8);
    CHECK(b.whole[0] == 5 && !memcmp(a.part, b.part, sizeof a.part));
    CHECK(a.whole[1] == -4 && a.part[1] == 0);
    m[3] = 1e300;
    CHECK(!pbs_to_grid_make(&a, &g, m));
    m[3] = NAN;
    CHECK(!pbs_to_grid_make(&a, &g, m));
    m[3] = 0, m[0] = INFINITY;
    CHECK(!pbs_to_grid_make(&a, &g, m));
}

TEST(morton_numbers_interleave_and_come_back) {
    uint64_t state = 7;
    for (int i = 0; i < 10000; i++) {
        uint32_t p = random_bits(&state) & 0xffffff, code = 0;
        for (int k = 0; k < 3; k++)
            for (int b = 0; b < 8; b++) code |= (p >> (8 * k + b) & 1) << (3 * b + k);
        CHECK(pbs_morton8(p | 0x3f000000) == code);
        CHECK(pbs_unmorton8(code) == p);
    }
}

/* By any number at a time, what is found is what one after the other shows. */
TEST(places_are_looked_at) {
    uint64_t state = 11;
    for (uint32_t round = 0; round < 4000; round++) {
        uint32_t place[48], n = round % 49, code = random_bits(&state) & 0x7fffff, any = 0;
        uint8_t low[3] = {255, 255, 255}, high[3] = {0, 0, 0};
        bool sorted = true;
        for (uint32_t i = 0; i < n; i++) {
            code += 1 + (random_bits(&state) & (round & 1 ? 3 : 0x1ffff));
            place[i] = pbs_unmorton8(code) | (random_bits(&state) & 127) << 24;
        }
        if (round & 2 && n) place[random_bits(&state) % n] = random_bits(&state);
        for (uint32_t i = 0; i < n; i++) {
            sorted = sorted && (!i || pbs_morton8(place[i]) > pbs_morton8(place[i - 1]));
            any |= place[i];
            for (int k = 0; k < 3; k++) {
                uint8_t c = (uint8_t)(place[i] >> 8 * k);
                low[k] = c < low[k] ? c : low[k], high[k] = c > high[k] ? c : high[k];
            }
        }
        pbs_place_look look = PBS_LOOK_NONE;
        uint32_t first = n ? random_bits(&state) % (n + 1) : 0;
        pbs_look_at_places(&look, place, first);
        pbs_look_at_places(&look, place + first, n - first);
        CHECK(look.sorted == sorted && look.any == any && !memcmp(look.low, low, 3));
        CHECK(!memcmp(look.high, high, 3));
        CHECK(look.last == (n ? place[n - 1] & 0xffffff : PBS_NO_PLACE));
    }
}

TEST(areas_are_told_from_other_numbers) {
    static const float wrong[] = {NAN, INFINITY, -INFINITY, -1e-30f};
    float area[40] = {0};
    for (size_t n = 0; n <= 40; n++) {
        for (size_t i = 0; i < n; i++) area[i] = i % 3 ? (float)i * 1e36f : -0.0f;
        CHECK(pbs_are_areas(area, n));
        for (size_t i = 0; i < n; i++) {
            float good = area[i];
            area[i] = wrong[i % 4];
            CHECK_NUM(!pbs_are_areas(area, n), (double)i);
            area[i] = good;
        }
    }
}

TEST(packed_normals_are_near) {
    uint64_t state = 3;
    double worst = 0;
    for (int i = 0; i < 20000; i++) {
        float n[3], back[3];
        for (int k = 0; k < 3; k++) n[k] = (float)((int32_t)random_bits(&state) * 0x1p-31);
        float l = sqrtf(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        pbs_normal10_get(back, pbs_normal10_put(n));
        for (int k = 0; k < 3; k++) worst = fmax(worst, fabs(back[k] - n[k] / l));
    }
    CHECK_NUM(worst < 0.501 / 511, worst);
    float none[3] = {0, 0, 0}, bad[3] = {NAN, 1, 0}, back[3];
    pbs_normal10_get(back, pbs_normal10_put(none));
    CHECK(back[0] == 0 && back[1] == 0 && back[2] == 1);
    CHECK(pbs_normal10_put(bad) == pbs_normal10_put(none));
}

/* ---- bytes ---- */

static pbs_run run = {.threads = 1};

static pbs_voxels some(size_t n) {
    pbs_voxels v;
    pbs_err err;
    must(pbs_voxels_alloc(&run, PBS_POSITION | PBS_WEIGHT | PBS_COLOUR, n, &v, &err), &err);
    for (size_t i = 0; i < n; i++) {
        v.place[i] = pbs_unmorton8((uint32_t)(i * 7)) | 0x12000000;
        v.weight[i] = (float)i;
        v.colour[i] = (uint32_t)(i * 2654435761u);
    }
    return v;
}

/* More voxels than fit into one chunk come back as they were. */
TEST(voxels_are_read_as_written) {
    enum { N = PBS_VOXELS_CHUNK + 1000, BITS = PBS_POSITION | PBS_WEIGHT | PBS_COLOUR };
    pbs_voxel_place at = {3, 4, 4096, {1, 0, 1}}, got;
    pbs_voxels v = some(N), part;
    pbs_err err = {0};
    char text[256];
    uint32_t channels;
    pbs_voxels_text(BITS, text);
    must(pbs_voxels_parse("x", text, &channels, &err), &err);
    CHECK(channels == BITS && pbs_voxels_stride(channels) == 12);
    CHECK(pbs_voxels_parse("x", "place:u8x4 weight:f64", &channels, &err) == PBS_DATA);
    channels = BITS;
    pbs_writer *w = spool_writer(&run, PBS_VOXELS, text, 0);
    must(pbs_voxels_write(w, 9, &at, &v, 0, &err), &err);
    pbs_input in;
    must(pbs_writer_reopen(w, &in, &err), &err);
    pbs_writer_close(w);
    pbs_reader *r;
    must(pbs_reader_open(&run, &in, PBS_KIND(PBS_VOXELS), &r, &err), &err);
    uint64_t have = 0;
    int64_t last = -1;
    pbs_chunk c;
    for (bool end = false;;) {
        must(pbs_reader_next(r, &c, &end, &err), &err);
        if (end) break;
        must(pbs_voxels_view("x", channels, &c, have, &got, &part, &err), &err);
        CHECK(c.node == 9 && got.level == 3 && got.levels == 4 && got.size == 4096);
        CHECK(got.chunk[0] == 1 && got.chunk[1] == 0 && got.chunk[2] == 1 && !part.normal);
        CHECK(!memcmp(part.place, v.place + have, 4 * part.count));
        CHECK(!memcmp(part.weight, v.weight + have, 4 * part.count));
        CHECK(!memcmp(part.colour, v.colour + have, 4 * part.count));
        CHECK(!pbs_voxels_fault(&got, &part, &last));
        have += part.count;
    }
    CHECK(have == N);
    pbs_reader_close(r);
    pbs_voxels_free(&run, &v);
}

static const char *fault(pbs_voxel_place at, pbs_voxels v) {
    int64_t last = -1;
    return pbs_voxels_fault(&at, &v, &last);
}

TEST(faults_are_found) {
    uint32_t place[2] = {PBS_PLACE(1, 0, 0, 1), PBS_PLACE(0, 1, 0, 2)};
    float weight[2] = {0.5f, 1};
    pbs_voxels v = {.count = 2, .place = place, .weight = weight};
    pbs_voxel_place at = {0, 0, 200, {0, 0, 0}};
    CHECK(!fault(at, v));
    weight[1] = NAN;
    CHECK(fault(at, v) != NULL);
    weight[1] = -1;
    CHECK(fault(at, v) != NULL);
    weight[1] = 1, place[1] = PBS_PLACE(200, 0, 0, 1);
    CHECK(fault(at, v) != NULL);
    place[1] = PBS_PLACE(1, 0, 0, 4);
    CHECK(fault(at, v) != NULL);
    place[1] = PBS_PLACE(0, 1, 0, 128);
    CHECK(fault(at, v) != NULL);
    /* 1000 cells are 125 of level 3. */
    place[1] = PBS_PLACE(124, 0, 0, 1), at = (pbs_voxel_place){3, 2, 1000, {0, 0, 0}};
    CHECK(!fault(at, v));
    place[1] = PBS_PLACE(125, 0, 0, 1);
    CHECK(fault(at, v) != NULL);
}
/* Each voxel hides all faces of the other: there are lists of faces, but nothing in them. */
TEST(voxels_without_any_face) {
    pbs_err err = {0};
    pbs_grid grid = {{0, 0, 0}, 1, 64};
    const uint32_t channels = PBS_POSITION | PBS_FACE, at[3] = {0, 0, 0};
    uint32_t place[2] = {PBS_PLACE(8, 8, 8, 0), PBS_PLACE(9, 8, 8, 0)}, face[2] = {0, 0};
    pbs_voxels v = {.count = 2, .place = place, .face = face};
    pbs_voxelstream s;
    pbs_writer *w = spool_writer(&run, PBS_VOXELS, "place:u8x4 face:u32", 0);
    pbs_voxelstream_begin(&s, &run, w, &grid, channels, false);
    CHECK(!pbs_voxelstream_add(&s, at, &v, NULL, 0, &err));
    CHECK(!pbs_voxelstream_end(&s, "", 0, &err) && s.voxels == 2);
    pbs_voxelstream_free(&s);
    pbs_input in;
    pbs_checked found;
    blob b = take_bytes(w);
    open_blob(&run, b, false, &in);
    CHECK(!pbs_check_file(&run, &in, &found, &err));
    free(b.bytes);
}

TEST_MAIN
