#include "formats/voxels/voxelpile.h"
#include <string.h>

void pbs_pile_begin(pbs_pile *p, pbs_run *run, uint32_t channels, size_t memory) {
    *p = (pbs_pile){.run = run, .channels = channels, .room = PBS_VOXELS_CHUNK};
    while (p->room > 1024 && p->room * pbs_voxels_stride(channels) > memory) p->room /= 2;
}

/* Arrays of a part, one behind the other. */
static void cut_part(pbs_pile_part *part, uint32_t channels) {
    uint32_t *at = part->scratch.bytes;
    pbs_voxels *v = &part->v;
    memset(v, 0, sizeof *v);
    v->place = at;
    if (channels & PBS_NORMAL) v->normal = at += PBS_VOXELS_CHUNK;
    if (channels & PBS_WEIGHT) v->weight = (float *)(at += PBS_VOXELS_CHUNK);
    if (channels & PBS_COLOUR) v->colour = at += PBS_VOXELS_CHUNK;
    if (channels & PBS_MATERIAL) v->material = at += PBS_VOXELS_CHUNK;
    if (channels & PBS_EMISSIVE) v->emissive = at += PBS_VOXELS_CHUNK;
    if (channels & PBS_FACE) v->face = at += PBS_VOXELS_CHUNK;
}

/* In memory while more than half of it is free. */
static pbs_code new_part(pbs_pile *p, pbs_err *err) {
    const char *what = "voxels of a chunk";
    if (p->parts < p->made) {
        p->part[p->parts++].v.count = 0;
        return PBS_OK;
    }
    size_t stride = pbs_voxels_stride(p->channels);
    bool plenty = pbs_mem_left(p->run) / 2 > pbs_mem_used(p->run);
    pbs_code rc =
        pbs_grow(p->run, &p->part, &p->part_cap, p->parts + 1, sizeof *p->part, what, err);
    if (rc) return rc;
    pbs_pile_part *part = &p->part[p->parts];
    memset(part, 0, sizeof *part);
    rc = (plenty ? pbs_scratch_new : pbs_scratch_file)(p->run, PBS_VOXELS_CHUNK, stride, what,
                                                       &part->scratch, err);
    if (rc) {
        pbs_scratch_free(&part->scratch);
        return rc;
    }
    cut_part(part, p->channels);
    p->made = ++p->parts;
    return PBS_OK;
}

static void rest(const pbs_pile_part *part) {
    if (part->scratch.is_file) pbs_pages_rest(part->scratch.bytes, part->scratch.size);
}

void pbs_pile_rest(const pbs_pile *p) {
    for (size_t i = 0; i < p->parts; i++) rest(&p->part[i]);
}

static pbs_code store_held(pbs_pile *p, pbs_err *err) {
    for (size_t i = 0; i < p->held.count;) {
        pbs_pile_part *part = p->parts ? &p->part[p->parts - 1] : NULL;
        if (!part || part->v.count == PBS_VOXELS_CHUNK) {
            pbs_code rc = new_part(p, err);
            if (rc) return rc;
            continue;
        }
        size_t n = PBS_VOXELS_CHUNK - part->v.count;
        if (n > p->held.count - i) n = p->held.count - i;
        pbs_voxels_append(&part->v, &p->held, i, n);
        i += n;
        if (part->v.count == PBS_VOXELS_CHUNK) rest(part);
    }
    p->held.count = 0;
    return PBS_OK;
}

pbs_code pbs_pile_add(pbs_pile *p, const pbs_voxels *v, uint32_t face_base, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < v->count && !rc;) {
        if (p->held.count == p->room && (rc = store_held(p, err))) break;
        size_t n = p->room - p->held.count, at = p->held.count;
        if (n > v->count - i) n = v->count - i;
        rc = pbs_voxels_grow(p->run, p->channels, &p->held, &p->cap, at + n, err);
        if (rc) break;
        pbs_voxels_append(&p->held, v, i, n);
        for (size_t k = at; p->held.face && face_base && k < at + n; k++)
            p->held.face[k] += face_base;
        i += n;
    }
    p->count += rc ? 0 : v->count;
    return rc;
}

pbs_code pbs_pile_settle(pbs_pile *p, pbs_err *err) {
    return p->parts ? store_held(p, err) : PBS_OK;
}

size_t pbs_pile_find(const pbs_pile *p, uint64_t i, const pbs_voxels **v) {
    *v = p->parts ? &p->part[i / PBS_VOXELS_CHUNK].v : &p->held;
    return (size_t)(i % PBS_VOXELS_CHUNK);
}

pbs_code pbs_pile_write(pbs_pile *p, pbs_writer *w, uint32_t node, const pbs_voxel_place *place,
                        pbs_err *err) {
    uint64_t at = 0;
    pbs_code rc = pbs_pile_settle(p, err);
    for (size_t i = 0; i < p->parts && !rc; i++) {
        rc = pbs_voxels_write(w, node, place, &p->part[i].v, at, err);
        at += p->part[i].v.count;
        rest(&p->part[i]);
    }
    return rc || p->parts ? rc : pbs_voxels_write(w, node, place, &p->held, 0, err);
}

pbs_code pbs_pile_write_faces(pbs_pile *p, pbs_writer *w, uint32_t node, bool colour,
                              pbs_err *err) {
    uint64_t at = 0;
    pbs_code rc = pbs_pile_settle(p, err);
    for (size_t i = 0; i < p->parts && !rc; i++) {
        const pbs_voxels *v = &p->part[i].v;
        rc = pbs_faces_write(w, node, colour, v->place, v->count, at, err);
        at += v->count;
        rest(&p->part[i]);
    }
    return rc || p->parts ? rc
                          : pbs_faces_write(w, node, colour, p->held.place, p->held.count, 0, err);
}

/* The first parts stay, as long as they are in memory. */
void pbs_pile_clear(pbs_pile *p) {
    size_t kept = 0;
    while (kept < p->made && !p->part[kept].scratch.is_file) kept++;
    while (p->made > kept) pbs_scratch_free(&p->part[--p->made].scratch);
    p->parts = 0;
    p->held.count = 0;
    p->count = 0;
}

void pbs_pile_free(pbs_pile *p) {
    if (!p->run) return;
    while (p->made) pbs_scratch_free(&p->part[--p->made].scratch);
    pbs_free(p->run, p->part);
    pbs_voxels_free(p->run, &p->held);
}
