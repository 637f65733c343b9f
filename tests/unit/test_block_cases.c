/* Blocks of voxels: small cases written out. */
#include "tests/unit/block_shapes.h"

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

/* What lies in the layer around the block only is seen, and leaves nothing. */
TEST(the_layer_alone) {
    how h = plainly();
    clear(&one);
    int a = vertex(&one, -0.8, 20.1, 20.1), b = vertex(&one, -0.2, 20.9, 20.1);
    triangle(&one, a, b, vertex(&one, -0.5, 20.5, 20.9));
    result r = work(&h, &one.mesh);
    CHECK(r.v.count == 0 && r.stats.fragments == 0 && r.stats.area == 0);
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
    for (int per_face = 0; per_face <= PBS_PER_FACE_MATERIAL; per_face++) {
        h.params.per_face = (pbs_per_face)per_face;
        pbs_run run = {.threads = 1, .mem_limit = (size_t)1 << 22};
        pbs_block *b = fresh(&run, &h);
        pbs_err err;
        for (uint32_t i = 0; i < one.mesh.triangles; i++) list[i] = i;
        pbs_block_begin(b, h.at, h.size);
        CHECK(pbs_block_add(b, &one.mesh, list, one.mesh.triangles, &h.to, h.sides, &err) ==
              PBS_LIMIT);
        pbs_block_begin(b, h.at, h.size);
        CHECK(per_face || !pbs_block_add(b, &one.mesh, list, 1, &h.to, h.sides, &err));
        run.mem_limit = pbs_block_memory(&h.params);
        pbs_block_begin(b, h.at, h.size);
        feed(b, &h, &one.mesh);
        result r = take(b);
        CHECK(r.v.count == 64 * 64 * 64);
        CHECK_NUM(fabs(r.stats.area - 3 * 64 * 4096.0) < 1e-3, r.stats.area);
        drop(&r);
        pbs_block_free(b);
        CHECK(pbs_mem_used(&run) == 0);
    }
}

/* Corners that are so far that their products overflow cannot be placed, and are counted. */
TEST(corners_beyond_everything) {
    how h = plainly();
    clear(&one);
    for (int i = 0; i < 2; i++) {
        int a = vertex(&one, i ? 1e-299 : 100, 3, 3);
        quad(&one, a, vertex(&one, 0, 9, 3), vertex(&one, 0, 9, 9), vertex(&one, 0, 3, 9));
    }
    h.to.m[0] = 1e300;
    result r = work(&h, &one.mesh);
    CHECK_NUM(r.stats.lost == 2 && r.v.count > 20, (double)r.stats.lost);
    drop(&r);
}

TEST_MAIN
