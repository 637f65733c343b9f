/* residents.h: for tests and benches: a plain way to get records into the GPU's memory, all of
 * them, once. Buffers of a fixed size are filled one after the other, and everything that was ever
 * asked for stays until the free. */
#ifndef PBS_TESTS_RESIDENTS_H
#define PBS_TESTS_RESIDENTS_H

#include "cmd/pbs-view/plan/numbers.h"
#include "cmd/pbs-view/draw/resident.h"
#include "libcore/surfels/average.h"

enum { RESIDENTS_BLOCK = 32 << 20 }; /* bytes of a buffer, unless one node needs more */

typedef struct residents_block {
    GLuint buffer;
    size_t size, used;
} residents_block;

typedef struct pbs_residents {
    pbs_run *run;
    const pbs_gl *gl;
    residents_block *blocks;
    size_t block_count, block_room, counted;
    struct entry {
        GLuint buffer;
        uint32_t records;
        uint64_t offset, octaves;
    } * entries;
    size_t entry_count, entry_room;
    pbs_numbers by_place; /* of the records in this process's memory */
} pbs_residents;

static pbs_code pbs_residents_new(pbs_run *run, const pbs_gl *gl, pbs_residents **out,
                                  pbs_err *err) {
    pbs_code rc = pbs_alloc(run, out, 1, sizeof **out, "the records on the device", err);
    if (rc) return rc;
    **out = (pbs_residents){.run = run, .gl = gl};
    return PBS_OK;
}

static void pbs_residents_free(pbs_residents *p) {
    if (!p) return;
    for (size_t i = 0; i < p->block_count; i++) p->gl->DeleteBuffers(1, &p->blocks[i].buffer);
    pbs_mem_give(p->run, p->counted);
    pbs_numbers_free(p->run, &p->by_place);
    pbs_free(p->run, p->blocks);
    pbs_free(p->run, p->entries);
    pbs_free(p->run, p);
}

/* Room for so many bytes in one buffer. */
static pbs_code residents_room(pbs_residents *p, size_t bytes, residents_block **out,
                               pbs_err *err) {
    residents_block *b = p->block_count ? &p->blocks[p->block_count - 1] : NULL;
    *out = b;
    if (b && bytes <= b->size - b->used) return PBS_OK;
    size_t size = bytes > RESIDENTS_BLOCK ? bytes : RESIDENTS_BLOCK;
    if ((int64_t)size > p->gl->max_storage)
        return pbs_fail(err, PBS_LIMIT, "%zu bytes of one node: a shader of %s sees up to %lld",
                        bytes, p->gl->device, (long long)p->gl->max_storage);
    pbs_code rc = pbs_grow(p->run, &p->blocks, &p->block_room, p->block_count + 1, sizeof *b,
                           "the records on the device", err);
    if (!rc) rc = pbs_mem_take(p->run, size, "the records on the device", err);
    if (rc) return rc;
    p->counted += size;
    b = *out = &p->blocks[p->block_count++];
    *b = (residents_block){.size = size};
    p->gl->CreateBuffers(1, &b->buffer);
    p->gl->NamedBufferData(b->buffer, (GLsizeiptr)size, NULL, GL_STATIC_DRAW);
    return pbs_gl_check(p->gl, "records", err);
}

static pbs_code residents_upload(pbs_residents *p, const pbs_surfels *node, uint32_t stride,
                                 uint32_t *which, pbs_err *err) {
    uint32_t records = node->whole > node->prefix ? node->whole : node->prefix;
    size_t bytes = (size_t)records * stride, entries = 0;
    if (node->octaves)
        entries = pbs_octave_begin(node->whole, 0) * (pbs_surfel_size(node->channels) - 8);
    residents_block *b;
    pbs_code rc = residents_room(p, bytes + entries, &b, err);
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

/* The node, uploaded if its records are not there yet; records that lie at the same place in memory
 * are the same. All `whole` records (0: prefix) are, and the octaves. Errors: PBS_LIMIT. */
static pbs_code pbs_residents_add(pbs_residents *p, const pbs_surfels *node, uint64_t key,
                                  pbs_resident *out, pbs_err *err) {
    uint32_t size = pbs_surfel_size(node->channels), stride = node->stride ? node->stride : size;
    uint32_t which = pbs_numbers_get(&p->by_place, (uintptr_t)node->records);
    if (stride < size || stride % 4)
        return pbs_fail(err, PBS_INTERNAL, "surfel records of %u bytes, stride %u", size, stride);
    if (which == (uint32_t)PBS_NUMBERS_NONE) {
        pbs_code rc = residents_upload(p, node, stride, &which, err);
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
#endif
