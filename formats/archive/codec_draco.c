/* codec_draco.c: meshes packed by Draco, and what it says nothing of put right. */
#include "formats/archive/codec_draco.h"
#include "formats/scene/meshbits.h"
#include "formats/scene/meshbuild.h"
#include "formats/readers/module.h"
#include "formats/container/wire.h"
#include <stdlib.h>
#include <string.h>

/* Packed: the head of the payload and its lattice, u32 size of Draco's bytes, these, and then, if
 * triangles have materials of their own, these, as an array packed by meshoptimizer. */
enum {
    HEAD = PBS_MESH_LATTICE_AT + PBS_MESH_LATTICE_SIZE,
    SIZE_AT = HEAD,
    DRACO_AT = HEAD + 4,
    LARGEST = 1 << 29 /* number that its predictions take without a doubt */
};

static pbs_code open_draco(pbs_run *run, const pbs_module_draco **m, pbs_err *err) {
    const void *table;
    pbs_code rc = pbs_module_open(run, "draco", 0, &table, err);
    *m = table;
    return rc;
}

static pbs_code open_meshopt(pbs_run *run, const pbs_module_meshopt **m, pbs_err *err) {
    const void *table;
    pbs_code rc = pbs_module_open(run, "meshopt", 0, &table, err);
    *m = table;
    return rc;
}

static pbs_draco_mesh mesh_of(const uint8_t *whole) {
    pbs_mesh m;
    pbs_mesh_view(whole, &m);
    return (pbs_draco_mesh){m.vertices,          m.triangles,     (int32_t *)m.position,
                            (int16_t *)m.normal, (int32_t *)m.uv, (uint8_t *)m.colour,
                            (uint16_t *)m.index};
}

/* ---- the same mesh in another order ---- */

/* A vertex as bytes, with its number. */
typedef struct key {
    uint8_t bytes[28];
    uint32_t i;
} key;

typedef struct corners {
    uint64_t same; /* three vertices by their ranks, the least first */
    uint32_t i;
} corners;

static void vertex_key(const pbs_draco_mesh *m, uint32_t i, key *out) {
    memset(out, 0, sizeof *out);
    memcpy(out->bytes, m->position + 3 * i, 12);
    if (m->normal) memcpy(out->bytes + 12, m->normal + 2 * i, 4);
    if (m->uv) memcpy(out->bytes + 16, m->uv + 2 * i, 8);
    if (m->colour) memcpy(out->bytes + 24, m->colour + 4 * i, 4);
    out->i = i;
}

static int by_bytes(const void *a, const void *b) {
    return memcmp(((const key *)a)->bytes, ((const key *)b)->bytes, sizeof((const key *)a)->bytes);
}

static int by_corners(const void *a, const void *b) {
    const corners *x = a, *y = b;
    if (x->same != y->same) return x->same < y->same ? -1 : 1;
    return (x->i > y->i) - (x->i < y->i);
}

/* Equal vertices have one rank. keys: room for them. */
static void rank_vertices(const pbs_draco_mesh *m, key *keys, uint32_t *rank) {
    for (uint32_t i = 0; i < m->vertices; i++) vertex_key(m, i, &keys[i]);
    qsort(keys, m->vertices, sizeof *keys, by_bytes);
    for (uint32_t i = 0; i < m->vertices; i++)
        rank[keys[i].i] = i && !by_bytes(&keys[i], &keys[i - 1]) ? rank[keys[i - 1].i] : i;
}

/* The ranks of another mesh's vertices among those; false: one is not there. */
static bool find_ranks(const pbs_draco_mesh *m, const key *keys, size_t n, const uint32_t *rank,
                       uint32_t *out) {
    for (uint32_t i = 0; i < m->vertices; i++) {
        key k;
        vertex_key(m, i, &k);
        const key *found = bsearch(&k, keys, n, sizeof *keys, by_bytes);
        if (!found) return false;
        out[i] = rank[found->i];
    }
    return true;
}

static void list_corners(const pbs_draco_mesh *m, const uint32_t *rank, corners *out) {
    for (uint32_t t = 0; t < m->triangles; t++) {
        uint64_t v[3];
        for (uint32_t i = 0; i < 3; i++) v[i] = rank[m->index[3 * t + i]];
        int least = v[0] <= v[1] && v[0] <= v[2] ? 0 : v[1] <= v[2] ? 1 : 2;
        out[t].same = v[least] << 40 | v[(least + 1) % 3] << 20 | v[(least + 2) % 3];
        out[t].i = t;
    }
    qsort(out, m->triangles, sizeof *out, by_corners);
}

/* Which of a's triangles each of b's is, to `from`; *same false: they are not the same. */
static pbs_code match(pbs_run *run, const pbs_draco_mesh *a, const pbs_draco_mesh *b,
                      uint32_t *from, bool *same, pbs_err *err) {
    const char *what = "a mesh that is compared";
    key *keys = NULL;
    uint32_t *ra = NULL, *rb = NULL;
    corners *ca = NULL, *cb = NULL;
    *same = false;
    pbs_code rc = pbs_alloc(run, &keys, a->vertices, sizeof *keys, what, err);
    if (!rc) rc = pbs_alloc(run, &ra, a->vertices, sizeof *ra, what, err);
    if (!rc) rc = pbs_alloc(run, &rb, b->vertices, sizeof *rb, what, err);
    if (!rc) rc = pbs_alloc(run, &ca, a->triangles, sizeof *ca, what, err);
    if (!rc) rc = pbs_alloc(run, &cb, b->triangles, sizeof *cb, what, err);
    if (!rc) {
        rank_vertices(a, keys, ra);
        *same = a->triangles == b->triangles && find_ranks(b, keys, a->vertices, ra, rb);
    }
    if (*same) {
        list_corners(a, ra, ca);
        list_corners(b, rb, cb);
        for (uint32_t t = 0; t < a->triangles; t++) {
            *same = *same && ca[t].same == cb[t].same;
            from[cb[t].i] = ca[t].i;
        }
    }
    pbs_free(run, keys);
    pbs_free(run, ra);
    pbs_free(run, rb);
    pbs_free(run, ca);
    pbs_free(run, cb);
    return rc;
}

/* ---- packing ---- */

static bool is_suited(const uint8_t *whole, size_t n, const pbs_draco_mesh *m) {
    pbs_mesh_lattice l;
    if (!pbs_mesh_lattice_get(whole, n, &l) || !m->triangles || (m->uv && !l.uv_bits)) return false;
    for (size_t i = 0; i < 3 * (size_t)m->vertices; i++)
        if ((uint32_t)m->position[i] > LARGEST) return false;
    for (size_t i = 0; m->uv && i < 2 * (size_t)m->vertices; i++)
        if (m->uv[i] > LARGEST || m->uv[i] < -LARGEST) return false;
    return true;
}

/* The bytes in front of the arrays, of a mesh of so many vertices. */
static size_t start_payload(uint8_t *to, const uint8_t *head, uint32_t vertices) {
    pbs_mesh m;
    memcpy(to, head, HEAD);
    pbs_put_u32(to, vertices);
    return pbs_mesh_view(to, &m);
}

/* Unpacks what was packed, and finds each of its triangles in the mesh. */
static pbs_code compare(pbs_run *run, const pbs_module_draco *draco, const uint8_t *whole,
                        const uint8_t *head, const uint8_t *packed, size_t own, size_t raw,
                        uint32_t *from, bool *same, pbs_err *err) {
    uint8_t *back = NULL;
    pbs_code rc = pbs_alloc(run, &back, raw, 1, "an unpacked chunk", err);
    if (!rc) {
        memcpy(back, head, HEAD);
        pbs_draco_mesh a = mesh_of(whole), b = mesh_of(back);
        rc = draco->unpack(run, &b, packed, own, err);
        if (!rc) rc = match(run, &a, &b, from, same, err);
    }
    pbs_free(run, back);
    return rc == PBS_DATA ? PBS_OK : rc; /* what the library does not read again */
}

/* The materials of triangles in Draco's order, to the end of the packed bytes. */
static pbs_code put_materials(pbs_run *run, const pbs_mesh *m, const uint32_t *from, uint8_t *to,
                              size_t room, size_t *size, pbs_err *err) {
    const pbs_module_meshopt *meshopt;
    uint32_t *ordered;
    *size = 0;
    if (!m->triangle_material) return PBS_OK;
    pbs_code rc = open_meshopt(run, &meshopt, err);
    if (rc) return rc;
    rc = pbs_alloc(run, &ordered, m->triangles, sizeof *ordered, "a packed mesh", err);
    for (uint32_t t = 0; t < m->triangles && !rc; t++) ordered[t] = m->triangle_material[from[t]];
    if (!rc) rc = meshopt->pack(run, to, room, ordered, m->triangles, 4, size, err);
    pbs_free(run, ordered);
    return rc;
}

static pbs_code materials_room(pbs_run *run, const pbs_mesh *m, size_t *room, pbs_err *err) {
    const pbs_module_meshopt *meshopt;
    *room = 0;
    if (!m->triangle_material) return PBS_OK;
    pbs_code rc = open_meshopt(run, &meshopt, err);
    if (!rc) *room = meshopt->bound(m->triangles, 4);
    return rc;
}

/* What is packed, together with what the library has made of the arrays. */
static pbs_code assemble(pbs_run *run, const pbs_module_draco *draco, const uint8_t *whole,
                         const uint8_t *packed, size_t own, uint32_t vertices, uint8_t **out,
                         size_t *size, size_t *raw, pbs_err *err) {
    uint8_t head[HEAD];
    uint32_t *from = NULL;
    size_t room = 0, materials = 0;
    bool same = false;
    pbs_mesh m;
    pbs_mesh_view(whole, &m);
    *raw = start_payload(head, whole, vertices);
    pbs_code rc = pbs_alloc(run, &from, m.triangles, sizeof *from, "a packed mesh", err);
    if (!rc) rc = compare(run, draco, whole, head, packed, own, *raw, from, &same, err);
    if (!rc && same) rc = materials_room(run, &m, &room, err);
    if (!rc && same) rc = pbs_alloc(run, out, DRACO_AT + own + room, 1, "a packed chunk", err);
    if (*out) {
        memcpy(*out, head, HEAD);
        pbs_put_u32(*out + SIZE_AT, (uint32_t)own);
        memcpy(*out + DRACO_AT, packed, own);
        rc = put_materials(run, &m, from, *out + DRACO_AT + own, room, &materials, err);
    }
    *size = DRACO_AT + own + materials;
    pbs_free(run, from);
    return rc;
}

pbs_code pbs_draco_pack(pbs_run *run, const uint8_t *whole, size_t n, uint8_t **out, size_t *size,
                        size_t *raw, pbs_err *err) {
    const pbs_module_draco *draco;
    uint8_t *packed = NULL;
    size_t own = 0;
    uint32_t vertices = 0;
    *out = NULL;
    pbs_draco_mesh m = mesh_of(whole);
    pbs_code rc = open_draco(run, &draco, err);
    if (rc || !is_suited(whole, n, &m)) return rc;
    rc = draco->pack(run, &m, &packed, &own, &vertices, err);
    if (rc == PBS_DATA) rc = PBS_OK, own = 0; /* what the library does not take */
    if (!rc && own && vertices <= PBS_MESH_VERTICES)
        rc = assemble(run, draco, whole, packed, own, vertices, out, size, raw, err);
    pbs_free(run, packed);
    if (!rc) return PBS_OK;
    pbs_free(run, *out);
    *out = NULL;
    return rc;
}

size_t pbs_draco_memory(size_t n) {
    return 24 * n + (1 << 20);
}

/* ---- unpacking ---- */

static pbs_code damaged(pbs_err *err) {
    return pbs_fail(err, PBS_DATA, "the packed bytes are damaged");
}

static pbs_code get_materials(pbs_run *run, const pbs_mesh *m, const uint8_t *bytes, size_t size,
                              pbs_err *err) {
    const pbs_module_meshopt *meshopt;
    if (!m->triangle_material) return size ? damaged(err) : PBS_OK;
    pbs_code rc = open_meshopt(run, &meshopt, err);
    if (rc) return rc;
    bool good = meshopt->unpack((uint32_t *)m->triangle_material, m->triangles, 4, bytes, size);
    return good ? PBS_OK : damaged(err);
}

pbs_code pbs_draco_unpack(pbs_run *run, const uint8_t *bytes, size_t size, uint8_t *to, size_t n,
                          pbs_err *err) {
    const pbs_module_draco *draco;
    pbs_mesh m;
    if (size < DRACO_AT || n < HEAD || !pbs_mesh_has_lattice(bytes) ||
        pbs_get_u32(bytes) > PBS_MESH_VERTICES || pbs_get_u32(bytes + 4) > PBS_MESH_TRIANGLES ||
        !pbs_get_u32(bytes + 4) || pbs_mesh_view(bytes, &m) != n)
        return damaged(err);
    memcpy(to, bytes, HEAD);
    pbs_mesh_view(to, &m);
    size_t own = pbs_get_u32(bytes + SIZE_AT), left = size - DRACO_AT;
    if (own > left) return damaged(err);
    pbs_code rc = open_draco(run, &draco, err);
    if (rc) return rc;
    pbs_draco_mesh mesh = mesh_of(to);
    rc = draco->unpack(run, &mesh, bytes + DRACO_AT, own, err);
    if (!rc) rc = get_materials(run, &m, bytes + DRACO_AT + own, left - own, err);
    return rc == PBS_DATA ? damaged(err) : rc;
}
