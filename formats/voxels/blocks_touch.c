/* blocks_touch.c: which cells of the octree a cluster's triangles touch. The box of a needle, or of
 * a large triangle that is not along the axes, has far more cells than it touches: without a closer
 * look, time would grow with the cube of the resolution. */
#include "formats/voxels/blocks_inner.h"

/* How far rounding may be off, relative to the products that are summed up. */
#define ROUNDING 0x1p-44

/* Whether all projections of corners are beyond what the cell reaches. Not if one is NaN. */
static bool are_beyond(double a, double b, double c, double reach) {
    return (a > reach && b > reach && c > reach) || (a < -reach && b < -reach && c < -reach);
}

/* Whether an axis separates a triangle from the box around 0: those of the box, across the edges,
 * the normal. Never if they touch. */
bool pbs_triangle_misses(const double p[3][3], const double half[3]) {
    double e[3][3], n[3], size = 0, reach = 0, at[3] = {0};
    for (int k = 0; k < 3; k++) {
        if (are_beyond(p[0][k], p[1][k], p[2][k], half[k])) return true;
        for (int i = 0; i < 3; i++) {
            e[i][k] = p[(i + 1) % 3][k] - p[i][k];
            size = !(fabs(p[i][k]) <= size) ? fabs(p[i][k]) : size;
        }
    }
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            int u = (k + 1) % 3, v = (k + 2) % 3;
            double eu = e[i][u], ev = e[i][v], c[3];
            double far = half[u] * fabs(ev) + half[v] * fabs(eu);
            for (int j = 0; j < 3; j++) c[j] = p[j][u] * ev - p[j][v] * eu;
            if (are_beyond(c[0], c[1], c[2], far + ROUNDING * size * (fabs(eu) + fabs(ev))))
                return true;
        }
    for (int k = 0; k < 3; k++) {
        int u = (k + 1) % 3, v = (k + 2) % 3;
        n[k] = e[0][u] * e[1][v] - e[0][v] * e[1][u];
        reach += half[k] * fabs(n[k]);
        for (int j = 0; j < 3; j++) at[j] += n[k] * p[j][k];
    }
    return are_beyond(at[0], at[1], at[2], reach + ROUNDING * size * size * size);
}

bool walk_cluster_touches(pbs_blocks *b, const walk_entry *e, const uint32_t at[3], uint32_t side) {
    walk_mesh w = walk_mesh_at(b, e->id, b->place[e->place]);
    const pbs_mesh *mesh = &b->s->meshes[e->id];
    uint32_t first, n = pbs_clusters_below(w.clusters, 0, e->box, &first);
    double middle[3], half[3];
    for (int r = 0; r < 3; r++) {
        middle[r] = w.m[4 * r + 3] - ((double)at[r] + side / 2.0) * PBS_BLOCK;
        half[r] = side / 2.0 * PBS_BLOCK + 1 + w.pad[r];
    }
    pbs_pages_saw(&b->pages, n);
    for (uint32_t t = first; t < first + n; t++) {
        const uint16_t *index = mesh->index + 3 * (size_t)w.clusters->order[t];
        double p[3][3];
        for (int i = 0; i < 3; i++) {
            const float *q = mesh->position + 3 * (size_t)index[i];
            for (int r = 0; r < 3; r++)
                p[i][r] =
                    w.m[4 * r] * q[0] + w.m[4 * r + 1] * q[1] + w.m[4 * r + 2] * q[2] + middle[r];
        }
        if (!pbs_triangle_misses((const double(*)[3])p, half)) return true;
    }
    return false;
}
