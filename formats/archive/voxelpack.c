#include "formats/archive/voxelpack.h"
#include "libcore/data/mesh.h"
#include <string.h>

static pbs_code bad(const pbs_voxel_source *s, const pbs_chunk *c, const char *what, pbs_err *err) {
    return pbs_fail(err, PBS_DATA, "%s: node %u: %s", pbs_reader_name(s->reader), c->node, what);
}

/* The entries of a chunk of faces' attributes, which goes on after `have` of them. */
static pbs_code faces_of(const pbs_voxel_source *s, const pbs_chunk *c, uint64_t have,
                         const uint32_t **faces, pbs_err *err) {
    if (c->bytes != (uint64_t)c->count * 4 || c->first != have || !(s->channels & PBS_FACE))
        return bad(s, c, "a list of faces is damaged", err);
    *faces = c->payload;
    return PBS_OK;
}

static bool copy_faces(const pbs_voxel_source *s, uint32_t *to, const uint32_t *from, size_t n) {
    for (size_t i = 0; i < n; i++) {
        if (from[i] != PBS_NONE && from[i] >= s->materials) return false;
        to[i] = from[i] == PBS_NONE ? PBS_NONE : s->material[from[i]];
    }
    return true;
}

static pbs_code survey_voxels(const pbs_voxel_source *s, const pbs_chunk *c, int64_t *last,
                              pbs_voxel_survey *out, pbs_err *err) {
    pbs_voxel_place place;
    pbs_voxels v;
    pbs_code rc =
        pbs_voxels_view(pbs_reader_name(s->reader), s->channels, c, out->voxels, &place, &v, err);
    if (rc) return rc;
    if (!out->voxels) out->place = place;
    if (memcmp(&out->place, &place, sizeof place))
        return bad(s, c, "voxels of several chunks of cells", err);
    const char *fault = pbs_voxels_fault(&place, &v, last);
    if (fault) return bad(s, c, fault, err);
    out->voxels += c->count;
    return PBS_OK;
}

static pbs_code survey_faces(const pbs_voxel_source *s, const pbs_chunk *c, pbs_voxel_survey *out,
                             pbs_err *err) {
    const uint32_t *faces = NULL;
    bool colour = c->flags & PBS_VFAC_COLOUR;
    pbs_code rc = faces_of(s, c, out->faces, &faces, err);
    if (rc) return rc;
    if (out->faces && colour != out->colour) return bad(s, c, "lists of faces of two kinds", err);
    out->colour = colour;
    out->faces += c->count;
    return PBS_OK;
}

pbs_code pbs_voxels_survey(const pbs_voxel_source *s, pbs_voxel_survey *out, pbs_err *err) {
    int64_t last = -1;
    pbs_code rc = PBS_OK;
    memset(out, 0, sizeof *out);
    for (size_t i = s->first; i < s->end && !rc; i++) {
        pbs_chunk c;
        uint32_t tag = s->entries[i].tag;
        if (tag != PBS_TAG_VOXELS && tag != PBS_TAG_FACES) continue;
        rc = pbs_reader_at(s->reader, &s->entries[i], &c, err);
        if (rc) break;
        rc = tag == PBS_TAG_VOXELS ? survey_voxels(s, &c, &last, out, err)
                                   : survey_faces(s, &c, out, err);
    }
    return rc;
}

static uint64_t chunks(uint64_t n) {
    return (n + PBS_VOXELS_CHUNK - 1) / PBS_VOXELS_CHUNK;
}

uint64_t pbs_voxels_pack_chunks(const pbs_voxel_survey *survey) {
    return chunks(survey->voxels) + chunks(survey->faces);
}

/* ---- writing ---- */

static void fill(uint32_t *array, size_t n, uint32_t value) {
    for (size_t i = 0; array && i < n; i++) array[i] = value;
}

/* What no chunk of the stream writes to is filled once. */
static void fill_absent(pbs_voxels *v, uint32_t have, size_t room) {
    if (!(have & PBS_NORMAL)) fill(v->normal, room, 0);
    if (!(have & PBS_COLOUR)) fill(v->colour, room, UINT32_MAX);
    if (!(have & PBS_MATERIAL)) fill(v->material, room, 255u << 8);
    if (!(have & PBS_EMISSIVE)) fill(v->emissive, room, 0);
    if (!(have & PBS_FACE)) fill(v->face, room, PBS_NONE);
}

static pbs_code pack_voxels(const pbs_voxel_source *s, const pbs_voxel_survey *survey,
                            pbs_writer *w, uint32_t node, pbs_voxels *buffer, pbs_err *err) {
    uint64_t have = 0, written = 0;
    for (size_t i = s->first; i < s->end; i++) {
        pbs_chunk c;
        pbs_voxel_place place;
        pbs_voxels v;
        if (s->entries[i].tag != PBS_TAG_VOXELS) continue;
        pbs_code rc = pbs_reader_at(s->reader, &s->entries[i], &c, err);
        if (!rc)
            rc =
                pbs_voxels_view(pbs_reader_name(s->reader), s->channels, &c, have, &place, &v, err);
        if (rc) return rc;
        have += v.count;
        for (size_t at = 0, n; at < v.count; at += n) {
            n = PBS_VOXELS_CHUNK - buffer->count;
            n = n < v.count - at ? n : v.count - at;
            pbs_voxels_append(buffer, &v, at, n);
            if (buffer->count < PBS_VOXELS_CHUNK && written + buffer->count < survey->voxels)
                continue;
            if ((rc = pbs_voxels_write(w, node, &survey->place, buffer, written, err))) return rc;
            written += buffer->count;
            buffer->count = 0;
        }
    }
    return PBS_OK;
}

static pbs_code pack_faces(const pbs_voxel_source *s, const pbs_voxel_survey *survey, pbs_writer *w,
                           uint32_t node, uint32_t *buffer, pbs_err *err) {
    uint64_t have = 0, written = 0;
    size_t count = 0;
    for (size_t i = s->first; i < s->end; i++) {
        pbs_chunk c;
        const uint32_t *faces = NULL;
        if (s->entries[i].tag != PBS_TAG_FACES) continue;
        pbs_code rc = pbs_reader_at(s->reader, &s->entries[i], &c, err);
        if (!rc) rc = faces_of(s, &c, have, &faces, err);
        if (rc) return rc;
        have += c.count;
        for (size_t at = 0, n; at < c.count; at += n) {
            n = PBS_VOXELS_CHUNK - count;
            n = n < c.count - at ? n : c.count - at;
            if (survey->colour)
                memcpy(buffer + count, faces + at, 4 * n);
            else if (!copy_faces(s, buffer + count, faces + at, n))
                return bad(s, &c, "a face names a material that is not there", err);
            count += n;
            if (count < PBS_VOXELS_CHUNK && written + count < survey->faces) continue;
            if ((rc = pbs_faces_write(w, node, survey->colour, buffer, count, written, err)))
                return rc;
            written += count;
            count = 0;
        }
    }
    return PBS_OK;
}

static size_t room_for(uint64_t n) {
    return n < PBS_VOXELS_CHUNK ? (size_t)n : PBS_VOXELS_CHUNK;
}

pbs_code pbs_voxels_pack(pbs_run *run, const pbs_voxel_source *s, const pbs_voxel_survey *survey,
                         pbs_writer *w, uint32_t node, uint32_t channels, pbs_err *err) {
    pbs_voxels buffer;
    uint32_t *faces = NULL;
    size_t room = room_for(survey->voxels);
    pbs_code rc = pbs_voxels_alloc(run, channels, room, &buffer, err);
    if (rc) return rc;
    fill_absent(&buffer, s->channels, room);
    buffer.count = 0;
    rc = pack_voxels(s, survey, w, node, &buffer, err);
    pbs_voxels_free(run, &buffer);
    if (rc || !survey->faces) return rc;
    rc = pbs_alloc(run, &faces, room_for(survey->faces), 4, "a list of faces", err);
    if (rc) return rc;
    rc = pack_faces(s, survey, w, node, faces, err);
    pbs_free(run, faces);
    return rc;
}
