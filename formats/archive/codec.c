/* codec.c: payloads packed and unpacked. The libraries are modules, opened for the first chunk that
 * needs them; they are so small that what every program takes as its base has room for them. */
#include "formats/container/codec.h"
#include "formats/archive/codec_draco.h"
#include "formats/container/container.h"
#include "formats/scene/meshbits.h"
#include "formats/readers/module.h"
#include "formats/surfels/octaves.h"
#include "formats/voxels/voxels.h"
#include "formats/container/wire.h"
#include <string.h>

const char *const pbs_codec_name[PBS_CODECS + 1] = {"none",         "zstd",  "meshopt",
                                                    "meshopt-zstd", "draco", NULL};

enum {
    ZSTD_LEVEL = 9,
    ZSTD_LEAST = 1 << 20, /* what packing takes besides: so much, 14 bytes for each, up to most */
    ZSTD_MOST = 13 << 20,
    MESH_HEAD = 16,
    MOST_ARRAYS = 8
};

bool pbs_codec_fits(uint32_t tag) {
    return tag == PBS_TAG_POINTS || tag == PBS_TAG_OCTAVES || tag == PBS_TAG_VOXELS ||
           tag == PBS_TAG_FACES || tag == PBS_TAG_MESH;
}

/* ---- what a payload is made of ---- */

typedef struct array {
    size_t count, stride; /* stride 2: indices */
} array;

typedef struct shape {
    size_t head; /* bytes in front of the arrays, which stay as they are */
    array arrays[MOST_ARRAYS];
    int count;
} shape;

static void add_array(shape *s, size_t count, size_t stride) {
    if (count) s->arrays[s->count++] = (array){count, stride};
}

/* head: the payload's first bytes, size of them. */
static void mesh_shape(const uint8_t *head, size_t size, shape *s) {
    if (size < MESH_HEAD) return;
    size_t v = pbs_get_u32(head), t = pbs_get_u32(head + 4);
    uint32_t arrays = pbs_get_u32(head + 8);
    if (v > PBS_MESH_VERTICES || t > PBS_MESH_TRIANGLES) return;
    s->head = MESH_HEAD + (arrays & PBS_MESH_LATTICE ? PBS_MESH_LATTICE_SIZE : 0);
    add_array(s, v, 12);
    if (arrays & 1) add_array(s, v, 4);
    if (arrays & 2) add_array(s, v, 8);
    if (arrays & 4) add_array(s, v, 4);
    if (arrays & 8) add_array(s, t, 4);
    add_array(s, 3 * t, 2);
}

/* False: n bytes of so many records are not made of arrays that can be packed. */
static bool shape_of(uint32_t tag, uint32_t count, size_t n, const uint8_t *head, size_t size,
                     shape *s) {
    memset(s, 0, sizeof *s);
    if (tag == PBS_TAG_MESH) {
        mesh_shape(head, size, s);
    } else if (tag == PBS_TAG_VOXELS) {
        s->head = PBS_VOXELS_HEADER;
        size_t columns = count && n > s->head ? (n - s->head) / 4 / count : 0;
        for (size_t i = 0; i < columns && i < MOST_ARRAYS; i++) add_array(s, count, 4);
    } else if (count) {
        add_array(s, count, n / count);
    }
    size_t sum = s->head;
    for (int i = 0; i < s->count; i++) {
        const array *a = &s->arrays[i];
        bool index = tag == PBS_TAG_MESH && a->stride == 2;
        if (!index && (!a->stride || a->stride % 4 || a->stride > 256)) return false;
        sum += a->count * a->stride;
    }
    return s->count && sum == n && s->head <= size;
}

/* ---- meshoptimizer: the head, and of each array its packed size as u32, and then the bytes ----
 */

static pbs_code open_meshopt(pbs_run *run, const pbs_module_meshopt **m, pbs_err *err) {
    const void *table;
    pbs_code rc = pbs_module_open(run, "meshopt", 0, &table, err);
    *m = table;
    return rc;
}

/* *size 0: it has no arrays. */
static pbs_code pack_arrays(pbs_run *run, uint32_t tag, uint32_t count, const uint8_t *bytes,
                            size_t n, uint8_t **out, size_t *size, pbs_err *err) {
    shape s;
    const pbs_module_meshopt *m;
    *out = NULL;
    *size = 0;
    if (!shape_of(tag, count, n, bytes, n, &s)) return PBS_OK;
    pbs_code rc = open_meshopt(run, &m, err);
    if (rc) return rc;
    size_t room = s.head, at = s.head;
    for (int i = 0; i < s.count; i++) room += 4 + m->bound(s.arrays[i].count, s.arrays[i].stride);
    if ((rc = pbs_alloc(run, out, room, 1, "a packed chunk", err))) return rc;
    memcpy(*out, bytes, s.head);
    const uint8_t *from = bytes + s.head;
    for (int i = 0; i < s.count && !rc; i++) {
        const array *a = &s.arrays[i];
        size_t got = 0;
        rc = m->pack(run, *out + at + 4, room - at - 4, from, a->count, a->stride, &got, err);
        pbs_put_u32(*out + at, (uint32_t)got);
        at += 4 + got;
        from += a->count * a->stride;
    }
    *size = at;
    return rc;
}

static pbs_code damaged(pbs_err *err) {
    return pbs_fail(err, PBS_DATA, "the packed bytes are damaged");
}

static pbs_code unpack_arrays(pbs_run *run, uint32_t tag, uint32_t count, const uint8_t *bytes,
                              size_t size, uint8_t *to, size_t n, pbs_err *err) {
    shape s;
    const pbs_module_meshopt *m;
    if (!shape_of(tag, count, n, bytes, size, &s)) return damaged(err);
    pbs_code rc = open_meshopt(run, &m, err);
    if (rc) return rc;
    const uint8_t *p = bytes + s.head;
    size_t left = size - s.head;
    memcpy(to, bytes, s.head);
    to += s.head;
    for (int i = 0; i < s.count; i++) {
        const array *a = &s.arrays[i];
        size_t own = left < 4 ? SIZE_MAX : pbs_get_u32(p);
        if (own == SIZE_MAX || own > left - 4 || !m->unpack(to, a->count, a->stride, p + 4, own))
            return damaged(err);
        p += 4 + own;
        left -= 4 + own;
        to += a->count * a->stride;
    }
    return left ? damaged(err) : PBS_OK;
}

/* ---- zstd ---- */

static pbs_code open_zstd(pbs_run *run, const pbs_module_zstd **m, pbs_err *err) {
    const void *table;
    pbs_code rc = pbs_module_open(run, "zstd", 0, &table, err);
    *m = table;
    return rc;
}

static pbs_code pack_bytes(pbs_run *run, const uint8_t *bytes, size_t n, uint8_t **out,
                           size_t *size, pbs_err *err) {
    const pbs_module_zstd *m;
    *out = NULL;
    pbs_code rc = open_zstd(run, &m, err);
    size_t room = rc ? 0 : m->bound(n), working = n < ZSTD_MOST / 14 ? 14 * n : ZSTD_MOST;
    working += ZSTD_LEAST;
    if (!rc) rc = pbs_mem_take(run, working, "packing with zstd", err);
    if (rc) return rc;
    rc = pbs_alloc(run, out, room, 1, "a packed chunk", err);
    if (!rc) *size = m->pack(*out, room, bytes, n, ZSTD_LEVEL);
    pbs_mem_give(run, working);
    return rc || *size ? rc : pbs_fail(err, PBS_LIMIT, "zstd: the machine has no memory left");
}

static pbs_code unpack_bytes(pbs_run *run, const uint8_t *bytes, size_t size, uint8_t *to, size_t n,
                             pbs_err *err) {
    const pbs_module_zstd *m;
    pbs_code rc = open_zstd(run, &m, err);
    return rc || m->unpack(to, n, bytes, size) ? rc : damaged(err);
}

/* Arrays that lie in a frame of zstd, which says how large they are. */
static pbs_code unpack_both(pbs_run *run, uint32_t tag, uint32_t count, const uint8_t *bytes,
                            size_t size, uint8_t *to, size_t n, pbs_err *err) {
    const pbs_module_zstd *m;
    uint8_t *arrays = NULL;
    pbs_code rc = open_zstd(run, &m, err);
    uint64_t inner = rc ? 0 : m->content(bytes, size);
    if (!rc && inner > PBS_PAYLOAD_MAX) rc = damaged(err);
    if (!rc) rc = pbs_alloc(run, &arrays, (size_t)inner, 1, "an unpacked chunk", err);
    if (!rc && !m->unpack(arrays, (size_t)inner, bytes, size)) rc = damaged(err);
    if (!rc) rc = unpack_arrays(run, tag, count, arrays, (size_t)inner, to, n, err);
    pbs_free(run, arrays);
    return rc;
}

/* ---- any ---- */

static pbs_code pack_both(pbs_run *run, uint32_t tag, uint32_t count, const uint8_t *bytes,
                          size_t n, uint8_t **out, size_t *size, pbs_err *err) {
    uint8_t *arrays;
    size_t inner;
    *out = NULL;
    pbs_code rc = pack_arrays(run, tag, count, bytes, n, &arrays, &inner, err);
    if (!rc && inner && inner <= PBS_PAYLOAD_MAX)
        rc = pack_bytes(run, arrays, inner, out, size, err);
    pbs_free(run, arrays);
    return rc;
}

static pbs_code pack_one(pbs_run *run, pbs_codec codec, uint32_t tag, uint32_t count,
                         const uint8_t *bytes, size_t n, uint8_t **out, size_t *size,
                         pbs_err *err) {
    *out = NULL;
    *size = 0;
    return codec == PBS_CODEC_ZSTD      ? pack_bytes(run, bytes, n, out, size, err)
           : codec == PBS_CODEC_MESHOPT ? pack_arrays(run, tag, count, bytes, n, out, size, err)
                                        : pack_both(run, tag, count, bytes, n, out, size, err);
}

static pbs_code unpack_one(pbs_run *run, pbs_codec codec, uint32_t tag, uint32_t count,
                           const uint8_t *bytes, size_t size, uint8_t *to, size_t n, pbs_err *err) {
    if (codec == PBS_CODEC_ZSTD) return unpack_bytes(run, bytes, size, to, n, err);
    return codec == PBS_CODEC_MESHOPT ? unpack_arrays(run, tag, count, bytes, size, to, n, err)
                                      : unpack_both(run, tag, count, bytes, size, to, n, err);
}

/* ---- blocks: of each its packed size as u32, and then all of them ---- */

static bool has_blocks(uint32_t tag) {
    return tag != PBS_TAG_MESH && tag != PBS_TAG_VOXELS;
}

static uint32_t blocks_of(uint32_t records) {
    return records / PBS_CODEC_BLOCK + !!(records % PBS_CODEC_BLOCK);
}

static uint32_t block_records(uint32_t count, uint32_t block) {
    uint32_t left = count - block * PBS_CODEC_BLOCK;
    return left < PBS_CODEC_BLOCK ? left : PBS_CODEC_BLOCK;
}

/* *size 0: they are not records, or packing makes them larger. */
static pbs_code pack_blocks(pbs_run *run, pbs_codec codec, uint32_t tag, uint32_t count,
                            const uint8_t *bytes, size_t n, uint8_t **out, size_t *size,
                            pbs_err *err) {
    *out = NULL;
    *size = 0;
    if (!count || n % count) return PBS_OK;
    uint32_t blocks = blocks_of(count);
    size_t stride = n / count, at = 4 * (size_t)blocks, room = n + at;
    pbs_code rc = pbs_alloc(run, out, room, 1, "a packed chunk", err);
    for (uint32_t i = 0; i < blocks && !rc; i++) {
        uint8_t *one;
        size_t own;
        uint32_t records = block_records(count, i);
        rc = pack_one(run, codec, tag, records, bytes + i * stride * PBS_CODEC_BLOCK,
                      records * stride, &one, &own, err);
        bool fits = !rc && own && own <= room - at;
        if (fits) {
            pbs_put_u32(*out + 4 * (size_t)i, (uint32_t)own);
            memcpy(*out + at, one, own);
            at += own;
        }
        pbs_free(run, one);
        if (!fits) return rc;
    }
    *size = at;
    return rc;
}

static pbs_code unpack_blocks(pbs_run *run, pbs_codec codec, uint32_t tag, uint32_t count,
                              const uint8_t *bytes, size_t size, uint8_t *to, size_t n,
                              uint32_t wanted, pbs_err *err) {
    uint32_t blocks = blocks_of(count);
    size_t at = 4 * (size_t)blocks, stride = count ? n / count : 0;
    uint8_t *last = NULL;
    if (!count || n % count || at > size) return damaged(err);
    pbs_code rc = PBS_OK;
    for (uint32_t i = 0; i < blocks_of(wanted) && !rc; i++) {
        size_t own = pbs_get_u32(bytes + 4 * (size_t)i);
        uint32_t records = block_records(count, i), left = wanted - i * PBS_CODEC_BLOCK;
        if (own > size - at) rc = damaged(err);
        if (!rc && left < records) rc = pbs_alloc(run, &last, records * stride, 1, "a prefix", err);
        if (!rc)
            rc = unpack_one(run, codec, tag, records, bytes + at, own, last ? last : to,
                            records * stride, err);
        if (!rc && last) memcpy(to, last, left * stride);
        at += own;
        to += records * stride;
    }
    pbs_free(run, last);
    return rc || wanted < count || at == size ? rc : damaged(err);
}

pbs_code pbs_codec_prefix(pbs_run *run, pbs_codec codec, uint32_t tag, uint32_t count,
                          const void *bytes, size_t size, void *to, size_t n, uint32_t records,
                          pbs_err *err) {
    if (!has_blocks(tag) || codec == PBS_CODEC_DRACO || records > count) return damaged(err);
    return unpack_blocks(run, codec, tag, count, bytes, size, to, n, records, err);
}

/* ---- meshes, which are packed as whole numbers if they have a lattice ---- */

/* *size 0: their numbers are not what they say. */
static pbs_code pack_whole(pbs_run *run, pbs_codec codec, uint32_t count, const uint8_t *bytes,
                           size_t n, pbs_packed *out, pbs_err *err) {
    uint8_t *whole, *other = NULL;
    size_t other_size = 0;
    shape s;
    if (!shape_of(PBS_TAG_MESH, count, n, bytes, n, &s)) return PBS_OK;
    pbs_code rc = pbs_alloc(run, &whole, n, 1, "a chunk to be packed", err);
    if (rc) return rc;
    memcpy(whole, bytes, n);
    bool draco = codec == PBS_CODEC_DRACO, good = pbs_mesh_to_whole(whole, n);
    if (good && draco) rc = pbs_draco_pack(run, whole, n, &out->bytes, &out->size, &out->raw, err);
    if (good && draco && !rc) codec = PBS_CODEC_MESHOPT_ZSTD;
    if (good && !rc)
        rc = pack_one(run, codec, PBS_TAG_MESH, count, whole, n, &other, &other_size, err);
    if (out->bytes && other_size >= out->size) {
        out->codec = PBS_CODEC_DRACO;
        pbs_free(run, other);
    } else {
        pbs_free(run, out->bytes);
        *out = (pbs_packed){other, other_size, n, codec};
    }
    pbs_free(run, whole);
    return rc;
}

static bool on_lattice(uint32_t tag, const uint8_t *bytes, size_t n) {
    return tag == PBS_TAG_MESH && n >= MESH_HEAD && pbs_mesh_has_lattice(bytes);
}

pbs_code pbs_codec_pack(pbs_run *run, pbs_codec codec, uint32_t tag, uint32_t count,
                        const void *bytes, size_t n, pbs_packed *out, pbs_err *err) {
    *out = (pbs_packed){.codec = codec, .raw = n};
    if (!n || !codec || !pbs_codec_fits(tag)) return PBS_OK;
    bool lattice = on_lattice(tag, bytes, n);
    if (codec == PBS_CODEC_DRACO && !lattice) out->codec = codec = PBS_CODEC_MESHOPT_ZSTD;
    pbs_code rc = lattice ? pack_whole(run, codec, count, bytes, n, out, err)
                          : (has_blocks(tag) ? pack_blocks : pack_one)(
                                run, codec, tag, count, bytes, n, &out->bytes, &out->size, err);
    if (!rc && out->size && out->size <= n - n / 16) return PBS_OK;
    pbs_free(run, out->bytes);
    out->bytes = NULL;
    return rc;
}

/* Arrays that are packed may become a little larger, and a frame's room is larger, too. */
static size_t packing_memory(size_t n) {
    size_t room = n + n / 8 + 65536;
    return 2 * room + ZSTD_LEAST + (n < ZSTD_MOST / 14 ? 14 * n : ZSTD_MOST);
}

size_t pbs_codec_memory(pbs_codec codec, uint32_t tag, size_t n) {
    size_t block = 256 * (size_t)PBS_CODEC_BLOCK; /* of records as large as they can be */
    if (has_blocks(tag)) return n + n / 8 + packing_memory(n < block ? n : block);
    size_t draco = codec == PBS_CODEC_DRACO && tag == PBS_TAG_MESH ? pbs_draco_memory(n) : 0;
    return n + (draco > packing_memory(n) ? draco : packing_memory(n));
}

pbs_code pbs_codec_unpack(pbs_run *run, pbs_codec codec, uint32_t tag, uint32_t count,
                          const void *bytes, size_t size, void *to, size_t n, pbs_err *err) {
    shape s;
    if (has_blocks(tag)) {
        if (codec == PBS_CODEC_DRACO) return damaged(err);
        return unpack_blocks(run, codec, tag, count, bytes, size, to, n, count, err);
    }
    if (codec == PBS_CODEC_DRACO && tag != PBS_TAG_MESH) return damaged(err);
    pbs_code rc = codec == PBS_CODEC_DRACO
                      ? pbs_draco_unpack(run, bytes, size, to, n, err)
                      : unpack_one(run, codec, tag, count, bytes, size, to, n, err);
    if (rc || !on_lattice(tag, to, n)) return rc;
    bool good = shape_of(tag, count, n, to, n, &s) && pbs_mesh_from_whole(to, n);
    return good ? PBS_OK : damaged(err);
}
