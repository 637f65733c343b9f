/* resident.c: records in the GPU's memory; buffers of a fixed size are filled one after the other.
 */
#include "cmd/pbs-view/resident.h"
#include "cmd/pbs-view/numbers.h"
#include "libcore/average.h"

enum { BLOCK = 32 << 20 }; /* bytes of a buffer, unless one node needs more */

typedef struct block {
    GLuint buffer;
    size_t size, used;
} block;

struct pbs_residents {
    pbs_run *run;
    const pbs_gl *gl;
    block *blocks;
    size_t block_count, block_room, counted;
    struct entry {
        GLuint buffer;
        uint32_t records;
        uint64_t offset, octaves;
    } * entries;
    size_t entry_count, entry_room;
    pbs_numbers by_place; /* of the records in this process's memory */
};

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
    uint64_t entries = (uint64_t)pbs_octave_begin(r->whole, 0) * (size - 8);
    if (r->octaves % 4 == 0 && r->octaves < bytes && entries && bytes - r->octaves >= entries)
        out->octaves = (uint32_t)(r->octaves / 4);
    return PBS_OK;
}

static void store(float out[3][4], const double *m, int columns, double scale) {
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 4; k++)
            out[i][k] = k < columns ? (float)(m[columns * i + k] * scale) : 0;
}

/* Cofactors, scaled so that the largest is 1: float holds no squares of 10^-30. */
static void place_normals(float out[3][4], const double view[12]) {
    double unit[12], cofactor[9], largest = 0;
    for (int i = 0; i < 12; i++)
        if (i % 4 < 3) largest = fmax(largest, fabs(view[i]));
    for (int i = 0; i < 12; i++) unit[i] = largest > 0 ? view[i] / largest : view[i];
    pbs_xform_cofactor(cofactor, unit);
    largest = 0;
    for (int i = 0; i < 9; i++) largest = fmax(largest, fabs(cofactor[i]));
    store(out, cofactor, 3, largest > 0 ? 1 / largest : 1);
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

pbs_code pbs_residents_new(pbs_run *run, const pbs_gl *gl, pbs_residents **out, pbs_err *err) {
    pbs_code rc = pbs_alloc(run, out, 1, sizeof **out, "the records on the device", err);
    if (rc) return rc;
    **out = (pbs_residents){.run = run, .gl = gl};
    return PBS_OK;
}

void pbs_residents_free(pbs_residents *p) {
    if (!p) return;
    for (size_t i = 0; i < p->block_count; i++) p->gl->DeleteBuffers(1, &p->blocks[i].buffer);
    pbs_mem_give(p->run, p->counted);
    pbs_numbers_free(p->run, &p->by_place);
    pbs_free(p->run, p->blocks);
    pbs_free(p->run, p->entries);
    pbs_free(p->run, p);
}

/* Room for so many bytes in one buffer. */
static pbs_code room(pbs_residents *p, size_t bytes, block **out, pbs_err *err) {
    block *b = p->block_count ? &p->blocks[p->block_count - 1] : NULL;
    *out = b;
    if (b && bytes <= b->size - b->used) return PBS_OK;
    size_t size = bytes > BLOCK ? bytes : BLOCK;
    if ((int64_t)size > p->gl->max_storage)
        return pbs_fail(err, PBS_LIMIT, "%zu bytes of one node: a shader of %s sees up to %lld",
                        bytes, p->gl->device, (long long)p->gl->max_storage);
    pbs_code rc = pbs_grow(p->run, &p->blocks, &p->block_room, p->block_count + 1, sizeof *b,
                           "the records on the device", err);
    if (!rc) rc = pbs_mem_take(p->run, size, "the records on the device", err);
    if (rc) return rc;
    p->counted += size;
    b = *out = &p->blocks[p->block_count++];
    *b = (block){.size = size};
    p->gl->CreateBuffers(1, &b->buffer);
    p->gl->NamedBufferData(b->buffer, (GLsizeiptr)size, NULL, GL_STATIC_DRAW);
    return pbs_gl_check(p->gl, "records", err);
}

static pbs_code upload(pbs_residents *p, const pbs_surfels *node, uint32_t stride, uint32_t *which,
                       pbs_err *err) {
    uint32_t records = node->whole > node->prefix ? node->whole : node->prefix;
    size_t bytes = (size_t)records * stride, entries = 0;
    if (node->octaves)
        entries = pbs_octave_begin(node->whole, 0) * (pbs_surfel_size(node->channels) - 8);
    block *b;
    pbs_code rc = room(p, bytes + entries, &b, err);
    if (!rc)
        rc = pbs_grow(p->run, &p->entries, &p->entry_room, p->entry_count + 1, sizeof *p->entries,
                      "the records on the device", err);
    if (!rc)
        rc = pbs_numbers_put(p->run, &p->by_place, (uintptr_t)node->records,
                             (uint32_t)p->entry_count, err);
    if (rc) return rc;
    const GLintptr at = (GLintptr)b->used;
    if (bytes) p->gl->NamedBufferSubData(b->buffer, at, (GLsizeiptr)bytes, node->records);
    if (entries)
        p->gl->NamedBufferSubData(b->buffer, at + (GLintptr)bytes, (GLsizeiptr)entries,
                                  node->octaves);
    *which = (uint32_t)p->entry_count++;
    p->entries[*which] =
        (struct entry){b->buffer, records, b->used, entries ? b->used + bytes : PBS_NO_OCTAVES};
    b->used += bytes + entries;
    return PBS_OK;
}

pbs_code pbs_residents_add(pbs_residents *p, const pbs_surfels *node, uint64_t key,
                           pbs_resident *out, pbs_err *err) {
    uint32_t size = pbs_surfel_size(node->channels), stride = node->stride ? node->stride : size;
    uint32_t which = pbs_numbers_get(&p->by_place, (uintptr_t)node->records);
    if (stride < size || stride % 4)
        return pbs_fail(err, PBS_INTERNAL, "surfel records of %u bytes, stride %u", size, stride);
    if (which == (uint32_t)PBS_NUMBERS_NONE) {
        pbs_code rc = upload(p, node, stride, &which, err);
        if (rc) return rc;
    }
    const struct entry *e = &p->entries[which];
    *out = (pbs_resident){.key = key,
                          .buffer = e->buffer,
                          .offset = e->offset,
                          .octaves = e->octaves,
                          .stride = stride,
                          .channels = node->channels,
                          .prefix = node->prefix < e->records ? node->prefix : e->records,
                          .whole = node->whole,
                          .radius = node->radius,
                          .step = node->step};
    memcpy(out->corner, node->corner, sizeof out->corner);
    memcpy(out->m, node->m, sizeof out->m);
    return PBS_OK;
}
