/* What the candidates of the G-buffer look like: normals, textures, masks, materials; and bad and
 * odd scenes. */
#include "tests/unit/gbuffer_shape.h"

/* ---- normals ---- */

/* On a sphere under any matrix, the normal is the gradient of its equation, on the seen side. */
TEST(normals_under_a_matrix) {
    shape s = ball(200, 300, 0);
    double m[3][12] = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                       {-2, 0.3, 0, 5, 0, 1, 0.4, 6, 0.1, 0, 0.5, 7},
                       {1e-9, 0, 0, 0, 0, -3e-9, 1e-9, 0, 0, 0, 2e-9, 0}};
    for (int i = 0; i < 6; i++) {
        pbs_draw d = placed(&s);
        memcpy(d.m, m[i % 3], sizeof d.m);
        s.mesh.normal = i < 3 ? s.normal : NULL;
        picture scene = {.draws = &d, .draw_count = 1};
        pbs_gbuffer_params params = {
            .resolution = 200, .channels = PBS_NORMAL, .box = box_of(&d, 1)};
        result r = draw_scene(&scene, &params, 1);
        double cof[9], inv[9], det = pbs_xform_det(d.m), least = 1;
        pbs_xform_cofactor(cof, d.m);
        for (int k = 0; k < 9; k++) inv[k] = cof[k % 3 * 3 + k / 3] / det;
        for (int v = 0; v < 8; v++)
            for (size_t k = 0; k < r.view[v].p.count; k++) {
                const float *p = r.view[v].p.position + 3 * k;
                double q[3] = {p[0] - d.m[3], p[1] - d.m[7], p[2] - d.m[11]}, u[3], g[3];
                float n[3];
                pbs_oct_decode(n, r.view[v].p.normal + 2 * k);
                for (int c = 0; c < 3; c++)
                    u[c] = inv[3 * c] * q[0] + inv[3 * c + 1] * q[1] + inv[3 * c + 2] * q[2];
                for (int c = 0; c < 3; c++)
                    g[c] = (cof[3 * c] * u[0] + cof[3 * c + 1] * u[1] + cof[3 * c + 2] * u[2]) *
                           (det < 0 ? -1 : 1);
                double l = sqrt(dot(g, g)), cosine = (g[0] * n[0] + g[1] * n[1] + g[2] * n[2]) / l;
                least = fmin(least, cosine);
            }
        CHECK_NUM(least > (i < 3 ? 0.9999 : 0.996), least);
        drop(&r);
    }
    s.mesh.normal = s.normal;
    free_shape(&s);
}

/* A sheet seen from both sides, with a smooth normal that leans: turned to each viewer. */
TEST(normals_of_a_sheet) {
    shape s = new_shape(3, 1);
    corner_is(&s, 1, 1, 0, 0), corner_is(&s, 2, 0, 1, 0);
    s.index[1] = 1, s.index[2] = 2;
    s.mesh.normal = s.normal = calloc(3, 4);
    for (int how = 0; how < 3; how++) {
        float n[3] = {0.6f, 0, how ? -0.8f : 0.8f};
        for (int i = 0; i < 3; i++) pbs_oct_encode(s.normal + 2 * i, n);
        if (how == 2) { /* two opposite normals cancel out: the face's own is used */
            float o[3] = {-0.6f, 0, 0.8f};
            pbs_oct_encode(s.normal + 2, o), pbs_oct_encode(s.normal + 4, o);
        }
        pbs_draw d = placed(&s);
        picture scene = {.draws = &d, .draw_count = 1};
        pbs_gbuffer_params params = {.pairs = 1,
                                     .direction = {{0, 0, 2}},
                                     .resolution = 40,
                                     .channels = PBS_NORMAL,
                                     .box = box_of(&d, 1)};
        result r = draw_scene(&scene, &params, 1);
        CHECK(r.count == 2 && r.view[0].p.count > 500);
        for (int v = 0; v < 2; v++)
            for (size_t i = 0; i < r.view[v].p.count; i++) {
                pbs_oct_decode(n, r.view[v].p.normal + 2 * i);
                CHECK((v ? -n[2] : n[2]) > 0.001f);
            }
        drop(&r);
    }
    free_shape(&s);
}

/* ---- textures, masks, materials ---- */

/* The unit square in z = 0, seen along z; uv is its position, v downwards. */
static shape square(void) {
    shape s = new_shape(4, 2);
    s.mesh.uv = s.uv = calloc(8, sizeof(float));
    for (uint32_t i = 0; i < 4; i++) {
        corner_is(&s, i, i & 1, i >> 1, 0);
        s.uv[2 * i] = (float)(i & 1), s.uv[2 * i + 1] = 1 - (float)(i >> 1);
    }
    memcpy(s.index, (uint16_t[6]){0, 1, 2, 1, 3, 2}, 12);
    s.mesh.material = 0;
    return s;
}

static result draw_square(const shape *s, const pbs_material *m, const pbs_image *image,
                          uint32_t res, uint32_t channels) {
    pbs_draw d = placed(s);
    picture scene = {.draws = &d,
                     .draw_count = 1,
                     .materials = m,
                     .material_count = 1,
                     .textures = image,
                     .texture_count = 1};
    pbs_gbuffer_params params = {.pairs = 1,
                                 .direction = {{0, 0, 1}},
                                 .resolution = res,
                                 .channels = channels,
                                 .box = box_of(&d, 1)};
    result r = draw_scene(&scene, &params, 1);
    CHECK(r.rc == PBS_OK && r.count == 2);
    return r;
}

TEST(texture_where_it_belongs) {
    shape s = square();
    uint8_t px[4 * 16 * 16];
    for (int i = 0; i < 256; i++) {
        uint8_t c[4] = {(uint8_t)(16 * (i % 16)), (uint8_t)(16 * (i / 16)), 77, 200};
        memcpy(px + 4 * i, c, 4);
    }
    pbs_image image = {16, 16, px};
    pbs_material m = PBS_MATERIAL_DEFAULT;
    m.base_texture.texture = 0;
    result r = draw_square(&s, &m, &image, 257, PBS_COLOUR); /* 16 pixels a texel */
    int wrong = 0;
    for (int v = 0; v < 2; v++)
        for (size_t i = 0; i < r.view[v].p.count; i++) {
            const float *p = r.view[v].p.position + 3 * i;
            double u = p[0] * 16, w = (1 - p[1]) * 16;
            if (fabs(u - floor(u) - 0.5) > 0.01 || fabs(w - floor(w) - 0.5) > 0.01) continue;
            const uint8_t *c = r.view[v].p.colour + 4 * i;
            wrong += abs(c[0] - 16 * (int)u) > 2 || abs(c[1] - 16 * (int)w) > 2 || c[2] != 77;
            wrong += c[3] != 255; /* opaque */
        }
    CHECK_NUM(wrong == 0, wrong);
    CHECK(r.view[0].p.count == 256 * 256);
    drop(&r);
    /* One pixel a texture: its mean in linear light. */
    double mean = 0;
    for (int i = 0; i < 16; i++) mean += pbs_srgb_to_linear((float)(16 * i) / 255) / 16;
    int want = pbs_unorm8(pbs_linear_to_srgb((float)mean));
    m.alpha = PBS_ALPHA_BLEND;
    r = draw_square(&s, &m, &image, 2, PBS_COLOUR);
    CHECK(r.view[0].p.count == 1);
    for (int k = 0; k < 2; k++)
        CHECK_NUM(abs(r.view[0].p.colour[k] - want) <= 2, r.view[0].p.colour[k]);
    CHECK(r.view[0].p.colour[3] == 200);
    drop(&r);
    free_shape(&s);
}

TEST(material_planes) {
    shape s = square();
    uint8_t px[4] = {10, 51, 102, 255};
    pbs_image image = {1, 1, px};
    pbs_material m = PBS_MATERIAL_DEFAULT;
    m.metallic = 0.5f, m.roughness = 0.5f;
    m.emissive[0] = 0, m.emissive[1] = 1, m.emissive[2] = 0.5f;
    result r = draw_square(&s, &m, &image, 20, PBS_MATERIAL | PBS_EMISSIVE);
    CHECK(!r.view[0].p.normal && !r.view[0].p.colour);
    CHECK(!memcmp(r.view[0].p.material, (uint8_t[4]){128, 128, 0, 0}, 4));
    CHECK(!memcmp(r.view[0].p.emissive, (uint8_t[4]){0, 255, 188, 0}, 4));
    drop(&r);
    m.material_texture.texture = 0, m.emissive_texture.texture = 0;
    r = draw_square(&s, &m, &image, 20, PBS_MATERIAL | PBS_EMISSIVE);
    CHECK(!memcmp(r.view[0].p.material, (uint8_t[4]){51, 26, 0, 0}, 4));
    CHECK(!memcmp(r.view[0].p.emissive, (uint8_t[4]){0, 51, 73, 0}, 4));
    drop(&r);
    free_shape(&s);
}

/* Holes in a masked square show what is behind it, and have no candidate where nothing is. */
TEST(masked_material) {
    shape s = square();
    uint8_t px[4 * 64 * 64];
    for (int i = 0; i < 64 * 64; i++) {
        uint8_t hole = i % 64 >= 16 && i % 64 < 48 && i / 64 >= 16 && i / 64 < 48;
        uint8_t c[4] = {255, 0, 0, hole ? 0 : 255};
        memcpy(px + 4 * i, c, 4);
    }
    pbs_image image = {64, 64, px};
    pbs_material m[2] = {PBS_MATERIAL_DEFAULT, PBS_MATERIAL_DEFAULT};
    m[0].base_texture.texture = 0;
    m[0].alpha = PBS_ALPHA_MASK;
    for (int behind = 0; behind < 2; behind++) {
        shape b = square();
        for (uint32_t i = 0; i < 4; i++) b.position[3 * i + 2] = -0.5f;
        b.mesh.material = 1;
        pbs_draw d[2] = {placed(&s), placed(&b)};
        picture scene = {.draws = d,
                         .draw_count = 1 + (size_t)behind,
                         .materials = m,
                         .material_count = 2,
                         .textures = &image,
                         .texture_count = 1};
        pbs_gbuffer_params params = {.pairs = 1,
                                     .direction = {{0, 0, 1}},
                                     .resolution = 101,
                                     .channels = PBS_COLOUR,
                                     .box = box_of(d, 2)};
        result r = draw_scene(&scene, &params, 2);
        const kept *k = &r.view[0];
        CHECK_NUM(k->p.count == (behind ? 100 * 100 : 100 * 100 - 49 * 49), k->p.count);
        int wrong = 0;
        for (size_t i = 0; i < k->p.count; i++) {
            const float *p = k->p.position + 3 * i;
            bool hole = fabsf(p[0] - 0.5f) < 0.25f && fabsf(p[1] - 0.5f) < 0.25f;
            wrong += (p[2] != 0) != hole || (k->p.colour[4 * i + 1] != 0) != hole;
            wrong += k->p.colour[4 * i + 3] != 255;
        }
        CHECK_NUM(wrong == 0, wrong);
        drop(&r);
        free_shape(&b);
    }
    /* Constant alpha below the cutoff: nothing there at all. */
    m[0].base_texture.texture = PBS_NONE, m[0].base[3] = 0.4f;
    result r = draw_square(&s, m, &image, 30, PBS_COLOUR);
    CHECK(r.stats.candidates == 0);
    drop(&r);
    free_shape(&s);
}

/* ---- bad and odd input ---- */

TEST(empty_and_flat) {
    shape s = new_shape(3, 1);
    s.index[1] = 1, s.index[2] = 2;
    for (int dim = 0; dim < 4; dim++) { /* a point, a line, a triangle in a plane, in space */
        for (int i = 0; i < dim && i < 3; i++) s.position[3 * ((i + 1) % 3) + i] = 1;
        if (dim == 3) s.position[2] = 0.5f;
        result r = draw_shape(&s, 64, PBS_NORMAL, 1);
        CHECK(r.rc == PBS_OK && r.count == 8);
        CHECK((r.stats.candidates > 0) == (dim > 1));
        for (int v = 0; v < r.count; v++) CHECK(r.view[v].v.width >= 1 && r.view[v].v.height >= 1);
        drop(&r);
    }
    picture none = {0};
    pbs_gbuffer_params params = {.resolution = 16, .box = {{0, 0, 0}, {1, 1, 1}}};
    result r = draw_scene(&none, &params, 2);
    CHECK(r.rc == PBS_OK && r.count == 8 && r.stats.candidates == 0);
    drop(&r);
    free_shape(&s);
}

TEST(box_too_small_and_hostile_matrices) {
    shape s = soup(200);
    pbs_draw d = placed(&s);
    picture scene = {.draws = &d, .draw_count = 1};
    double odd[] = {1, 0, -1, 1e-30, 1e9, 1e40, 1e200, 1e308, INFINITY, NAN};
    for (size_t i = 0; i < sizeof odd / sizeof *odd; i++)
        for (int where = 0; where < 12; where++) {
            pbs_gbuffer_params params = {.resolution = 37,
                                         .channels = PBS_NORMAL,
                                         .box = {{0.2, 0.3, 0.4}, {0.7, 0.6, 0.5}}};
            memcpy(d.m, PBS_IDENTITY, sizeof d.m);
            d.m[where] = odd[i];
            result r = draw_scene(&scene, &params, 2);
            CHECK(r.rc == PBS_OK && r.count == 8);
            drop(&r);
        }
    free_shape(&s);
}

TEST(all_resolutions) {
    shape s = ball(10, 12, 0.1);
    pbs_draw d = placed(&s);
    picture scene = {.draws = &d, .draw_count = 1};
    for (uint32_t res = 1; res < 70; res += res < 5 ? 1 : 13) {
        pbs_gbuffer_params params = {.pairs = 3,
                                     .direction = {{1, 0, 0}, {0, -2, 0}, {1, 2, 3}},
                                     .resolution = res,
                                     .box = box_of(&d, 1)};
        result r = draw_scene(&scene, &params, 2);
        uint32_t longest = 0;
        for (int v = 0; v < r.count; v++) {
            longest = r.view[v].v.width > longest ? r.view[v].v.width : longest;
            longest = r.view[v].v.height > longest ? r.view[v].v.height : longest;
        }
        CHECK(r.count == 6 && longest == res && (r.stats.candidates > 0 || res == 2));
        drop(&r);
    }
    free_shape(&s);
}

TEST(refusals) {
    shape s = soup(10);
    pbs_draw d = placed(&s);
    picture scene = {.draws = &d, .draw_count = 1};
    pbs_gbuffer_params good = {.resolution = 64, .box = box_of(&d, 1)}, p;
    result r = {0};
    volatile sig_atomic_t stop = 1;
    pbs_run run = {.threads = 2};
    pbs_err err;
    p = good, p.resolution = 0;
    CHECK(draw_once(&run, &scene, &p, &r, &err) == PBS_USAGE);
    p = good, p.resolution = PBS_GBUFFER_MAX_SIZE + 1;
    CHECK(draw_once(&run, &scene, &p, &r, &err) == PBS_USAGE);
    p = good, p.pairs = 17;
    CHECK(draw_once(&run, &scene, &p, &r, &err) == PBS_USAGE);
    p = good, p.pairs = 1;
    CHECK(draw_once(&run, &scene, &p, &r, &err) == PBS_USAGE);
    p = good, p.box = PBS_BOX_EMPTY;
    CHECK(draw_once(&run, &scene, &p, &r, &err) == PBS_USAGE);
    p = good, p.box.max[1] = NAN;
    CHECK(draw_once(&run, &scene, &p, &r, &err) == PBS_USAGE);
    CHECK(r.count == 0);
    run.mem_limit = 120000;
    CHECK(draw_once(&run, &scene, &good, &r, &err) == PBS_LIMIT);
    run.mem_limit = 0, run.cancel = &stop;
    CHECK(draw_once(&run, &scene, &good, &r, &err) == PBS_CANCEL);
    CHECK(r.count == 0);
    run.cancel = NULL, r.stop_at = 3;
    CHECK(draw_once(&run, &scene, &good, &r, &err) == PBS_IO);
    CHECK(r.count == 3 && pbs_mem_used(&run) == 0);
    drop(&r);
    free_shape(&s);
}

TEST_MAIN
