/* scene IN OUT.ply: all triangles of a scene, each instance at its place, relative to the middle of
 * the whole, with the normals of corners if all of its meshes have them; without colours. This is
 * the input of all programs alike. */
#include "formats/scene/scene.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static void normal_of(float out[3], const pbs_draw *d, size_t v) {
    double cofactor[9], length = 0, sum[3];
    float n[3];
    pbs_oct_decode(n, d->mesh->normal + 2 * v);
    pbs_xform_cofactor(cofactor, d->m);
    for (int r = 0; r < 3; r++) {
        sum[r] = 0;
        for (int c = 0; c < 3; c++) sum[r] += cofactor[3 * r + c] * (double)n[c];
        length += sum[r] * sum[r];
    }
    /* A mirrored instance: cofactors turn the normal to the other side. */
    length = copysign(sqrt(length), pbs_xform_det(d->m));
    for (int r = 0; r < 3; r++) out[r] = length != 0 ? (float)(sum[r] / length) : 0;
}
static void vertices(const pbs_flat *flat, bool normals, FILE *f) {
    for (size_t i = 0; i < flat->count; i++)
        for (size_t v = 0; v < flat->draws[i].mesh->vertices; v++) {
            const float *at = flat->draws[i].mesh->position + 3 * v;
            double p[3] = {(double)at[0], (double)at[1], (double)at[2]};
            float out[6];
            pbs_xform_point(p, flat->draws[i].m, p);
            for (int k = 0; k < 3; k++) out[k] = (float)p[k];
            if (normals) normal_of(out + 3, &flat->draws[i], v);
            fwrite(out, sizeof *out, normals ? 6 : 3, f);
        }
}
static void triangles(const pbs_flat *flat, FILE *f) {
    uint32_t base = 0;
    for (size_t i = 0; i < flat->count; i++) {
        const pbs_mesh *m = flat->draws[i].mesh;
        for (size_t t = 0; t < m->triangles; t++) {
            uint32_t c[3];
            for (size_t k = 0; k < 3; k++) c[k] = base + m->index[3 * t + k];
            fputc(3, f);
            fwrite(c, sizeof *c, 3, f);
        }
        base += m->vertices;
    }
}

static void write_ply(const pbs_flat *flat, FILE *f) {
    size_t count = 0;
    bool normals = true;
    for (size_t i = 0; i < flat->count; i++) {
        count += flat->draws[i].mesh->vertices;
        normals = normals && flat->draws[i].mesh->normal;
    }
    fprintf(f, "ply\nformat binary_little_endian 1.0\nelement vertex %zu\n", count);
    for (int k = 0; k < (normals ? 6 : 3); k++)
        fprintf(f, "property float %s%c\n", k < 3 ? "" : "n", "xyz"[k % 3]);
    fprintf(f, "element face %llu\nproperty list uchar uint vertex_indices\nend_header\n",
            (unsigned long long)flat->triangles);
    vertices(flat, normals, f);
    triangles(flat, f);
}

int main(int argc, char **argv) {
    pbs_run run = {.threads = 1};
    pbs_err err = {0};
    pbs_scene s;
    pbs_flat flat;
    if (argc != 3) return 64;
    pbs_scene_options options = PBS_SCENE_DEFAULTS;
    options.ignore_missing = true;
    if (pbs_scene_open(&run, argv[1], &options, &s, &err) || pbs_scene_flatten(&s, &flat, &err)) {
        fprintf(stderr, "%s\n", err.text);
        return err.code;
    }
    FILE *f = fopen(argv[2], "wb");
    if (!f) return 74;
    write_ply(&flat, f);
    bool written = !fclose(f);
    pbs_free(&run, flat.draws);
    pbs_scene_close(&s);
    return written ? 0 : 74;
}
