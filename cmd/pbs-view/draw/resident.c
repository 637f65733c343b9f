/* resident.c: records in the GPU's memory, checked and placed. */
#include "cmd/pbs-view/draw/resident.h"
#include "libcore/surfels/average.h"

static void find_fields(uint32_t channels, int32_t field[4]) {
    int32_t word = 2;
    for (int k = 0; k < 4; k++) field[k] = channels & (uint32_t)PBS_NORMAL << k ? word++ : -1;
}

uint64_t pbs_resident_bytes(const pbs_gl *gl, GLuint buffer) {
    GLint64 bytes = 0;
    if (!buffer) return 0;
    gl->GetNamedBufferParameteri64v(buffer, GL_BUFFER_SIZE, &bytes);
    return bytes > 0 ? (uint64_t)bytes : 0;
}

pbs_code pbs_resident_check(const pbs_resident *r, uint64_t bytes, pbs_resident_words *out,
                            pbs_err *err) {
    uint32_t size = pbs_surfel_size(r->channels), stride = r->stride ? r->stride : size;
    if (stride < size || stride % 4 || r->offset % 4)
        return pbs_fail(err, PBS_INTERNAL, "surfel records of %u bytes, stride %u, at %llu", size,
                        stride, (unsigned long long)r->offset);
    uint64_t fit = r->offset < bytes ? (bytes - r->offset) / stride : 0;
    *out = (pbs_resident_words){(uint32_t)(r->offset / 4),
                                stride / 4,
                                r->prefix < fit ? r->prefix : (uint32_t)fit,
                                UINT32_MAX,
                                {0}};
    find_fields(r->channels, out->field);
    uint64_t entries = (uint64_t)pbs_part_octave_begin(r->part, r->whole, 0) * (size - 8);
    if (r->octaves % 4 == 0 && r->octaves < bytes && entries && bytes - r->octaves >= entries)
        out->octaves = (uint32_t)(r->octaves / 4);
    return PBS_OK;
}

static void store(float out[3][4], const double *m, int columns, double scale) {
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 4; k++)
            out[i][k] = k < columns ? (float)(m[columns * i + k] * scale) : 0;
}

/* Cofactors, scaled so that the largest is 1: float holds no squares of 10^-30. Those of a mirror
 * turn around what points outside, and so are turned back. */
static void place_normals(float out[3][4], const double view[12]) {
    double unit[12], cofactor[9], largest = 0;
    for (int i = 0; i < 12; i++)
        if (i % 4 < 3) largest = fmax(largest, fabs(view[i]));
    for (int i = 0; i < 12; i++) unit[i] = largest > 0 ? view[i] / largest : view[i];
    pbs_xform_cofactor(cofactor, unit);
    largest = 0;
    for (int i = 0; i < 9; i++) largest = fmax(largest, fabs(cofactor[i]));
    if (pbs_xform_det(unit) < 0) largest = -largest;
    store(out, cofactor, 3, largest != 0 ? 1 / largest : 1);
}

void pbs_resident_place(const pbs_resident *r, const pbs_camera *camera, float to_view[3][4],
                        float disc[3][4], float normal[3][4]) {
    static const double unset[12];
    const double *m = memcmp(r->m, unset, sizeof unset) ? r->m : PBS_IDENTITY;
    double view[12], linear[9], s = r->step;
    double lattice[12] = {s, 0, 0, r->corner[0], 0, s, 0, r->corner[1], 0, 0, s, r->corner[2]};
    pbs_camera_place(view, camera, m);
    for (int i = 0; i < 9; i++) linear[i] = view[4 * (i / 3) + i % 3];
    store(disc, linear, 3, r->radius > 0 && isfinite(r->radius) ? r->radius : 0);
    place_normals(normal, view);
    pbs_xform_mul(lattice, m, lattice);
    pbs_camera_place(view, camera, lattice);
    store(to_view, view, 4, 1);
}
