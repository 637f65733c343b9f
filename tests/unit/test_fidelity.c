/* How far voxels are from their surface: shapes for which that is known. */
#include "libcore/measures/fidelity.h"
#include "tests/unit/block_shapes.h"

static pbs_fidelity measure(const how *h, const pbs_mesh *mesh, const result *r) {
    pbs_run run = {.threads = 1};
    pbs_fidelity_block *f;
    pbs_fidelity out = {0};
    CHECK(!pbs_fidelity_new(&run, &f, NULL));
    for (uint32_t i = 0; i < mesh->triangles; i++) list[i] = i;
    CHECK(!pbs_fidelity_begin(f, h->at, &r->v, NULL));
    CHECK(!pbs_fidelity_add(f, mesh, list, mesh->triangles, &h->to, h->sides, NULL));
    pbs_fidelity_end(f, &out);
    pbs_fidelity_free(f);
    CHECK(pbs_mem_used(&run) == 0);
    return out;
}

static void sheet(double z0, double z1) {
    clear(&one);
    int a = vertex(&one, 1, 1, z0), b = vertex(&one, 61, 1, z1);
    int c = vertex(&one, 61, 61, z1), d = vertex(&one, 1, 61, z0);
    quad(&one, a, b, c, d);
}

TEST(a_level_sheet) {
    how h = plainly();
    sheet(20.25, 20.25);
    result r = work(&h, &one.mesh);
    pbs_fidelity f = measure(&h, &one.mesh, &r);
    CHECK(f.voxels == r.v.count && f.voxels >= 60 * 60);
    CHECK_NUM(fabs(f.distance_sum - 0.25 * (double)f.voxels) < 1e-6 * f.distance_sum,
              f.distance_sum);
    CHECK_NUM(fabs(f.distance_max - 0.25) < 1e-9, f.distance_max);
    CHECK_NUM(fabs(f.area - 3600) < 1e-3, f.area);
    CHECK_NUM(f.normal_max < 0.1, f.normal_max);
    drop(&r);
}

/* A voxel's middle is at most half a voxel from a plane along an axis, and as many are near as far.
 */
TEST(a_sloping_sheet) {
    how h = plainly();
    sheet(10.1, 47.3);
    result r = work(&h, &one.mesh);
    pbs_fidelity f = measure(&h, &one.mesh, &r);
    double slope = (47.3 - 10.1) / 60, c = 1 / sqrt(1 + slope * slope);
    CHECK_NUM(f.distance_max <= 0.5 * c + 1e-9 && f.distance_max > 0.45 * c, f.distance_max);
    double mean = f.distance_sum / (double)f.voxels;
    CHECK_NUM(fabs(mean - 0.25 * c) < 0.01, mean);
    CHECK_NUM(f.normal_max < 0.1, f.normal_max);
    drop(&r);
}

/* What is far from a voxel is so, and a normal that is turned over is; up to the sign where a voxel
 * has two sides. */
TEST(wrong_voxels) {
    how h = plainly();
    sheet(20.25, 20.25);
    result r = work(&h, &one.mesh);
    for (size_t i = 0; i < r.v.count; i++) r.v.normal[i] = pbs_normal10_put((float[3]){0, 0, -1});
    pbs_fidelity f = measure(&h, &one.mesh, &r);
    CHECK_NUM(fabs(f.normal_sum / f.area - 180) < 1e-6, f.normal_sum / f.area);
    for (size_t i = 0; i < r.v.count; i++) r.v.place[i] |= (uint32_t)PBS_VOXEL_TWO_SIDED << 24;
    f = measure(&h, &one.mesh, &r);
    CHECK_NUM(f.normal_max < 0.1, f.normal_max);
    drop(&r);
}

/* The nearest point of a triangle that passes below a corner of a voxel is on its edge. */
TEST(edges_are_near) {
    how h = plainly();
    clear(&one);
    int a = vertex(&one, 20.1, 20.1, 20.1), b = vertex(&one, 20.2, 20.1, 20.1);
    triangle(&one, a, b, vertex(&one, 20.1, 20.2, 20.1));
    result r = work(&h, &one.mesh);
    pbs_fidelity f = measure(&h, &one.mesh, &r);
    double d = sqrt(2 * 0.35 * 0.35 + 0.4 * 0.4);
    CHECK(f.voxels == 1);
    CHECK_NUM(fabs(f.distance_max - d) < 1e-6, f.distance_max - d);
    drop(&r);
}

TEST_MAIN
