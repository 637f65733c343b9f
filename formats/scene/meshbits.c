/* meshbits.c: positions, normals and texture coordinates of meshes as whole numbers, and back. */
#include "formats/scene/meshbits.h"
#include "formats/scene/meshbuild.h"
#include "formats/container/wire.h"
#include <math.h>
#include <string.h>

enum {
    VERTICES_AT = 0,
    TRIANGLES_AT = 4,
    ARRAYS_AT = 8,
    HEAD = PBS_MESH_LATTICE_AT + PBS_MESH_LATTICE_SIZE,
    STEP_AT = PBS_MESH_LATTICE_AT + 24,
    LEAST_AT = STEP_AT + 8,
    BITS_AT = LEAST_AT + 12,
    FURTHEST = 1 << 22, /* steps: a float still tells them apart */
    FLAGS_SHIFT = 8,
    FLAGS_MASK = 0x1ff,
    LEAST_EXPONENT = -140,
    MOST_EXPONENT = 95, /* 2^32 steps of it are finite */
    FLAGS_BIAS = 200
};

int pbs_mesh_exponent(double side, unsigned bits) {
    int e;
    if (!bits || !(side > 0) || !isfinite(side)) return PBS_MESH_EXACT;
    double m = frexp(side, &e);
    e -= (m == 0.5) + (int)bits;
    return e < LEAST_EXPONENT ? LEAST_EXPONENT : e > MOST_EXPONENT ? PBS_MESH_EXACT : e;
}

uint32_t pbs_mesh_flags(int exponent) {
    return exponent == PBS_MESH_EXACT ? 0 : (uint32_t)(exponent + FLAGS_BIAS) << FLAGS_SHIFT;
}

double pbs_mesh_flags_step(uint32_t flags) {
    int e = (int)(flags >> FLAGS_SHIFT & FLAGS_MASK);
    return e ? ldexp(1, e - FLAGS_BIAS) : 0;
}

/* ---- single numbers ---- */

static int16_t normal_whole(int16_t v, int most) {
    double a = floor((double)v * most / 32767 + 0.5);
    return (int16_t)fmax(-most, fmin(most, a));
}
static int16_t normal_value(int16_t a, int most) {
    double v = floor((double)a * 32767 / most + 0.5);
    return (int16_t)fmax(-32767, fmin(32767, v));
}

/* False: too large to be a whole number of steps. */
static bool uv_whole(float v, int bits, int32_t *k) {
    double a = floor(ldexp(v, bits) + 0.5);
    if (!(fabs(a) < INT32_MAX)) return false;
    *k = (int32_t)a;
    return true;
}
static float uv_value(int32_t k, int bits) {
    return (float)ldexp(k, -bits);
}

static float position_value(const pbs_mesh_lattice *l, int axis, double whole) {
    return (float)(l->corner[axis] + l->step * whole);
}

/* ---- the lattice in a payload ---- */

static void put_lattice(uint8_t *payload, const pbs_mesh_lattice *l) {
    for (int k = 0; k < 3; k++) {
        pbs_put_f64(payload + PBS_MESH_LATTICE_AT + 8 * k, l->corner[k]);
        pbs_put_u32(payload + LEAST_AT + 4 * k, (uint32_t)l->least[k]);
    }
    pbs_put_f64(payload + STEP_AT, l->step);
    pbs_put_u32(payload + BITS_AT, l->normal_bits | l->uv_bits << 8);
}

bool pbs_mesh_lattice_get(const uint8_t *payload, size_t n, pbs_mesh_lattice *l) {
    if (n < HEAD || !(pbs_get_u32(payload + ARRAYS_AT) & PBS_MESH_LATTICE)) return false;
    int e;
    l->step = pbs_get_f64(payload + STEP_AT);
    uint32_t bits = pbs_get_u32(payload + BITS_AT);
    l->normal_bits = bits & 0xff, l->uv_bits = bits >> 8;
    bool ok = l->step > 0 && isfinite(l->step) && frexp(l->step, &e) == 0.5 &&
              e - 1 >= LEAST_EXPONENT && e - 1 <= MOST_EXPONENT && l->normal_bits <= 16 &&
              l->normal_bits != 1 && l->uv_bits <= 30;
    for (int k = 0; k < 3; k++) {
        l->corner[k] = pbs_get_f64(payload + PBS_MESH_LATTICE_AT + 8 * k);
        l->least[k] = (int32_t)pbs_get_u32(payload + LEAST_AT + 4 * k);
        ok = ok && fabs(l->corner[k]) <= l->step;
    }
    return ok;
}

/* ---- whole numbers and back ---- */

typedef struct arrays {
    size_t vertices;
    uint8_t *position, *normal, *uv; /* NULL: none */
} arrays;

/* Where the arrays are that change. */
static arrays arrays_of(uint8_t *payload) {
    pbs_mesh m;
    pbs_mesh_view(payload, &m);
    return (arrays){m.vertices, (uint8_t *)m.position, (uint8_t *)m.normal, (uint8_t *)m.uv};
}

/* What the four put: the number at p, of axis k, as the other kind; false: it cannot be. */
static bool put_whole(const pbs_mesh_lattice *l, uint8_t *p, int k) {
    float v = pbs_get_f32(p);
    double whole = floor((v - l->corner[k]) / l->step + 0.5), more = whole - l->least[k];
    if (!(more >= 0 && more <= UINT32_MAX)) return false;
    float back = position_value(l, k, whole);
    pbs_put_u32(p, (uint32_t)more);
    return !memcmp(&back, &v, sizeof v);
}

static bool normals_to_whole(uint8_t *p, size_t n, uint32_t bits) {
    int most = (1 << (bits - 1)) - 1;
    bool same = true;
    for (size_t i = 0; i < n; i++, p += 2) {
        int16_t v = (int16_t)pbs_get_u16(p), a = normal_whole(v, most);
        same = same && normal_value(a, most) == v;
        pbs_put_u16(p, (uint16_t)a);
    }
    return same;
}

static bool uv_to_whole(uint8_t *p, size_t n, int bits) {
    for (size_t i = 0; i < n; i++, p += 4) {
        float v = pbs_get_f32(p);
        int32_t a;
        if (!uv_whole(v, bits, &a)) return false;
        float back = uv_value(a, bits);
        if (memcmp(&back, &v, sizeof v) != 0) return false;
        pbs_put_u32(p, (uint32_t)a);
    }
    return true;
}

bool pbs_mesh_to_whole(uint8_t *payload, size_t n) {
    pbs_mesh_lattice l;
    if (!pbs_mesh_lattice_get(payload, n, &l)) return false;
    arrays a = arrays_of(payload);
    for (size_t i = 0; i < 3 * a.vertices; i++)
        if (!put_whole(&l, a.position + 4 * i, (int)(i % 3))) return false;
    if (a.normal && l.normal_bits && !normals_to_whole(a.normal, 2 * a.vertices, l.normal_bits))
        return false;
    return !a.uv || !l.uv_bits || uv_to_whole(a.uv, 2 * a.vertices, (int)l.uv_bits);
}

bool pbs_mesh_from_whole(uint8_t *payload, size_t n) {
    pbs_mesh_lattice l;
    if (!pbs_mesh_lattice_get(payload, n, &l)) return false;
    arrays a = arrays_of(payload);
    for (size_t i = 0; i < a.vertices; i++)
        for (int k = 0; k < 3; k++) {
            uint8_t *p = a.position + 12 * i + 4 * (size_t)k;
            pbs_put_f32(p, position_value(&l, k, (double)pbs_get_u32(p) + l.least[k]));
        }
    int most = (1 << (l.normal_bits ? l.normal_bits - 1 : 1)) - 1;
    for (size_t i = 0; a.normal && l.normal_bits && i < 2 * a.vertices; i++) {
        uint8_t *p = a.normal + 2 * i;
        pbs_put_u16(p, (uint16_t)normal_value((int16_t)pbs_get_u16(p), most));
    }
    for (size_t i = 0; a.uv && l.uv_bits && i < 2 * a.vertices; i++) {
        uint8_t *p = a.uv + 4 * i;
        pbs_put_f32(p, uv_value((int32_t)pbs_get_u32(p), (int)l.uv_bits));
    }
    return true;
}

bool pbs_mesh_on_lattice(const uint8_t *payload, size_t n) {
    pbs_mesh_lattice l;
    if (!pbs_mesh_lattice_get(payload, n, &l)) return false;
    arrays a = arrays_of((uint8_t *)payload);
    for (size_t i = 0; i < 3 * a.vertices; i++) {
        uint8_t p[4];
        memcpy(p, a.position + 4 * i, 4);
        if (!put_whole(&l, p, (int)(i % 3))) return false;
    }
    int most = (1 << (l.normal_bits ? l.normal_bits - 1 : 1)) - 1;
    for (size_t i = 0; a.normal && l.normal_bits && i < 2 * a.vertices; i++) {
        int16_t v = (int16_t)pbs_get_u16(a.normal + 2 * i);
        if (normal_value(normal_whole(v, most), most) != v) return false;
    }
    for (size_t i = 0; a.uv && l.uv_bits && i < 2 * a.vertices; i++) {
        int32_t k;
        float v = pbs_get_f32(a.uv + 4 * i);
        if (!uv_whole(v, (int)l.uv_bits, &k) || uv_value(k, (int)l.uv_bits) != v) return false;
    }
    return true;
}

/* ---- snapping ---- */

typedef struct snapper {
    pbs_mesh m; /* as it is */
    pbs_mesh_lattice l;
    pbs_vertex *vertex; /* snapped, each once */
    uint32_t *slot;     /* vertex + 1, by its bytes; a power of two of them */
    uint32_t *number;   /* of each of the mesh's vertices */
    size_t slots;
    uint32_t vertices;
} snapper;

static uint32_t hash(const pbs_vertex *v) {
    uint64_t h = 0;
    uint32_t w[sizeof *v / 4];
    memcpy(w, v, sizeof w);
    for (size_t i = 0; i < sizeof w / 4; i++) h = (h ^ w[i]) * 0x9e3779b97f4a7c15u;
    return (uint32_t)(h >> 32);
}

/* The first of equal ones keeps its place. */
static uint32_t weld(snapper *s, const pbs_vertex *v) {
    size_t at = hash(v) & (s->slots - 1);
    for (; s->slot[at]; at = (at + 1) & (s->slots - 1))
        if (!memcmp(&s->vertex[s->slot[at] - 1], v, sizeof *v)) return s->slot[at] - 1;
    s->vertex[s->vertices] = *v;
    s->slot[at] = ++s->vertices;
    return s->vertices - 1;
}

/* The lattice as it lies around `to`: exact, but where doubles cannot tell its points apart. */
static void place_lattice(pbs_mesh_lattice *l, const pbs_mesh_snap *snap, double first[3]) {
    l->step = ldexp(1, snap->exponent);
    l->normal_bits = PBS_MESH_NORMAL_BITS;
    l->uv_bits = PBS_MESH_UV_BITS;
    for (int k = 0; k < 3; k++) {
        double n = floor(snap->to[k] / l->step + 0.5);
        bool near = fabs(n) < 0x1p52;
        first[k] = near ? n : 0;
        l->corner[k] = near ? n * l->step - snap->to[k] : 0;
    }
}

/* The number of steps from the lattice's corner. */
static double steps_of(const pbs_mesh_snap *snap, const double first[3], double step, int k,
                       float v) {
    bool near = fabs(snap->to[k] / step) < 0x1p52;
    double world = near ? snap->from[k] + v : snap->from[k] - snap->to[k] + v;
    return floor(world / step + 0.5) - first[k];
}

static bool snap_positions(snapper *s, const pbs_mesh_snap *snap, const double first[3],
                           double (*whole)[3]) {
    for (int k = 0; k < 3; k++) s->l.least[k] = INT32_MAX;
    for (uint32_t i = 0; i < s->m.vertices; i++)
        for (int k = 0; k < 3; k++) {
            double q = steps_of(snap, first, s->l.step, k, s->m.position[3 * i + (uint32_t)k]);
            if (!(fabs(q) < FURTHEST)) return false;
            whole[i][k] = q;
            if (q < s->l.least[k]) s->l.least[k] = (int32_t)q;
        }
    return true;
}

static void snap_vertices(snapper *s, double (*whole)[3]) {
    const pbs_mesh *m = &s->m;
    int32_t k = 0;
    for (uint32_t i = 0; m->uv && i < 2 * m->vertices; i++)
        if (!uv_whole(m->uv[i], PBS_MESH_UV_BITS, &k)) s->l.uv_bits = 0;
    int most = (1 << (PBS_MESH_NORMAL_BITS - 1)) - 1;
    for (uint32_t i = 0; i < m->vertices; i++) {
        pbs_vertex v;
        memset(&v, 0, sizeof v);
        for (int a = 0; a < 3; a++) v.position[a] = position_value(&s->l, a, whole[i][a]);
        for (int a = 0; m->normal && a < 2; a++)
            v.normal[a] = normal_value(normal_whole(m->normal[2 * i + (uint32_t)a], most), most);
        for (int a = 0; m->uv && a < 2; a++) {
            v.uv[a] = m->uv[2 * i + (uint32_t)a];
            if (s->l.uv_bits && uv_whole(v.uv[a], PBS_MESH_UV_BITS, &k))
                v.uv[a] = uv_value(k, PBS_MESH_UV_BITS);
        }
        if (m->colour) memcpy(v.colour, m->colour + 4 * i, 4);
        s->number[i] = weld(s, &v);
    }
}

static bool is_flat(const snapper *s, const uint32_t v[3]) {
    for (int i = 0; i < 3; i++)
        if (!memcmp(s->vertex[v[i]].position, s->vertex[v[(i + 1) % 3]].position,
                    sizeof s->vertex->position))
            return true;
    return false;
}

/* All triangles that are left, in their order, to the end of the payload; those of a mesh of which
 * nothing is left have one. */
static uint32_t put_triangles(const snapper *s, uint8_t *material, uint8_t *index) {
    uint32_t kept = 0;
    for (int pass = 0; pass < 2 && !kept; pass++)
        for (uint32_t t = 0; t < s->m.triangles && !(pass && kept); t++) {
            uint32_t v[3];
            for (uint32_t i = 0; i < 3; i++) v[i] = s->number[s->m.index[3 * t + i]];
            if (!pass && is_flat(s, v)) continue;
            for (int i = 0; i < 3; i++, index += 2) pbs_put_u16(index, (uint16_t)v[i]);
            if (s->m.triangle_material)
                pbs_put_u32(material + 4 * (size_t)kept, s->m.triangle_material[t]);
            kept++;
        }
    return kept;
}

static size_t put_mesh(const snapper *s, const uint8_t *payload, uint8_t *out, uint32_t *flat) {
    const pbs_mesh *m = &s->m;
    pbs_mesh to;
    memcpy(out, payload, PBS_MESH_LATTICE_AT);
    pbs_put_u32(out + VERTICES_AT, s->vertices);
    pbs_put_u32(out + ARRAYS_AT, pbs_get_u32(payload + ARRAYS_AT) | PBS_MESH_LATTICE);
    put_lattice(out, &s->l);
    pbs_mesh_view(out, &to);
    for (uint32_t i = 0; i < s->vertices; i++) {
        const pbs_vertex *v = &s->vertex[i];
        memcpy((float *)to.position + 3 * i, v->position, sizeof v->position);
        if (m->normal) memcpy((int16_t *)to.normal + 2 * i, v->normal, sizeof v->normal);
        if (m->uv) memcpy((float *)to.uv + 2 * i, v->uv, sizeof v->uv);
        if (m->colour) memcpy((uint8_t *)to.colour + 4 * i, v->colour, sizeof v->colour);
    }
    uint32_t kept = put_triangles(s, (uint8_t *)to.triangle_material, (uint8_t *)to.index);
    *flat = m->triangles - kept;
    /* The corners move up behind fewer materials. */
    pbs_put_u32(out + TRIANGLES_AT, kept);
    const uint16_t *index = to.index;
    size_t n = pbs_mesh_view(out, &to);
    memmove((uint16_t *)to.index, index, 6 * (size_t)kept);
    return n;
}

static pbs_code make_room(pbs_run *run, snapper *s, double (**whole)[3], uint8_t **out, size_t n,
                          pbs_err *err) {
    const char *what = "a mesh on a lattice";
    s->slots = 16;
    while (s->slots < 2 * (size_t)s->m.vertices) s->slots *= 2;
    pbs_code rc = pbs_alloc(run, whole, s->m.vertices, sizeof **whole, what, err);
    if (!rc) rc = pbs_alloc(run, &s->vertex, s->m.vertices, sizeof *s->vertex, what, err);
    if (!rc) rc = pbs_alloc(run, &s->number, s->m.vertices, sizeof *s->number, what, err);
    if (!rc) rc = pbs_alloc(run, &s->slot, s->slots, sizeof *s->slot, what, err);
    if (!rc) memset(s->slot, 0, s->slots * sizeof *s->slot);
    return rc ? rc : pbs_alloc(run, out, n + PBS_MESH_LATTICE_SIZE, 1, what, err);
}

pbs_code pbs_mesh_snap_to(pbs_run *run, const pbs_mesh_snap *snap, const uint8_t *payload,
                          uint8_t **out, size_t *size, uint32_t *flat, pbs_err *err) {
    snapper s = {.vertex = NULL};
    double(*whole)[3] = NULL, first[3];
    *out = NULL;
    *size = *flat = 0;
    if (snap->exponent == PBS_MESH_EXACT) return PBS_OK;
    size_t n = pbs_mesh_view(payload, &s.m);
    place_lattice(&s.l, snap, first);
    pbs_code rc = make_room(run, &s, &whole, out, n, err);
    bool fits = !rc && snap_positions(&s, snap, first, whole);
    if (fits) {
        snap_vertices(&s, whole);
        *size = put_mesh(&s, payload, *out, flat);
    }
    if (!fits) pbs_free(run, *out), *out = NULL;
    pbs_free(run, whole);
    pbs_free(run, s.vertex);
    pbs_free(run, s.number);
    pbs_free(run, s.slot);
    return rc;
}
