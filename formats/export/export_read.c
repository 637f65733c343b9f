/* export_read.c: what is chosen, decoded and placed, block by block (export.h). */
#include "formats/export/export.h"
#include "formats/container/wire.h"
#include <math.h>

/* A placing that is being read. */
typedef struct placed {
    pbs_exporter *x;
    uint32_t node;
    const double *m;
    double scale, turn[9]; /* what normals are multiplied with */
    bool mirrors;
    uint64_t at, left; /* records before this one; points of the spacing chosen that may come */
    pbs_export_block_fn take;
    void *ctx;
} placed;

double pbs_export_spacing(const pbs_exporter *x, uint32_t node, const uint8_t *p) {
    if (!x->record.packed) return (double)pbs_get_f32(p);
    return (double)pbs_half_get(pbs_get_u16(p)) * 65535 * x->node[node].lattice;
}

static void set_turn(placed *p) {
    double det = pbs_xform_det(p->m);
    p->mirrors = det < 0;
    pbs_xform_cofactor(p->turn, p->m);
    for (int k = 0; k < 9 && p->mirrors; k++) p->turn[k] = -p->turn[k];
}

static void put_normal(const placed *p, const float from[3], float to[3]) {
    double n[3], length;
    for (int r = 0; r < 3; r++)
        n[r] = p->turn[3 * r] * (double)from[0] + p->turn[3 * r + 1] * (double)from[1] +
               p->turn[3 * r + 2] * (double)from[2];
    length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (int r = 0; r < 3; r++)
        to[r] = length > 0 && length < INFINITY ? (float)(n[r] / length) : 0;
}

static pbs_code flush(placed *p, uint64_t records, pbs_err *err) {
    pbs_export_block *b = &p->x->block;
    b->records = records;
    pbs_code rc = b->count ? p->take(p->ctx, b, err) : PBS_OK;
    b->count = 0;
    return rc ? rc : pbs_run_check(p->x->run, err);
}

/* ---- points ---- */

static bool is_chosen(placed *p, const uint8_t *spacing) {
    pbs_exporter *x = p->x;
    if (x->spacing == 0 && !x->equal) return true;
    double s = pbs_export_spacing(x, p->node, spacing) * p->scale;
    if (s != x->spacing || !x->equal) return s >= x->spacing;
    if (!p->left) return false;
    p->left--;
    return true;
}

/* What the lattice says is not rounded to float on the way. */
static void put_position(placed *p, size_t i, const uint8_t *record) {
    const pbs_exporter *x = p->x;
    const pbs_node *n = &x->node[p->node];
    double at[3];
    for (int k = 0; k < 3; k++)
        at[k] = n->origin[k] + (x->record.packed
                                    ? n->lattice_min[k] + n->lattice * pbs_get_u16(record + 2 * k)
                                    : (double)x->points.position[3 * i + k]);
    pbs_xform_point(x->block.position[x->block.count], p->m, at);
}

static void put_point(placed *p, size_t i, const uint8_t *record) {
    pbs_exporter *x = p->x;
    pbs_export_block *b = &x->block;
    float normal[3];
    put_position(p, i, record);
    if (b->normal) {
        pbs_oct_decode(normal, x->points.normal + 2 * i);
        put_normal(p, normal, b->normal[b->count]);
    }
    if (b->colour) memcpy(b->colour[b->count], x->points.colour + 4 * i, 4);
    if (b->radius) b->radius[b->count] = (float)((double)x->points.spacing[i] * p->scale);
    b->count++;
}

static pbs_code read_window(pbs_exporter *x, const pbs_chunk *c, uint32_t node, uint32_t first,
                            uint32_t n, pbs_err *err) {
    const pbs_node *of = &x->node[node];
    pbs_lattice l = {{of->lattice_min[0], of->lattice_min[1], of->lattice_min[2]}, of->lattice};
    pbs_chunk one = *c;
    one.payload = (const uint8_t *)c->payload + (size_t)first * x->record.stride;
    one.bytes = (uint64_t)n * x->record.stride;
    one.count = n;
    one.first = 0;
    x->points.count = 0;
    pbs_code rc = pbs_points_read(x->name, &x->record, &one, &x->points, &l, err);
    const char *fault = rc ? NULL : pbs_points_fault(&x->points, 0);
    return fault ? pbs_fail(err, PBS_DATA, "%s: node %u: %s", x->name, node, fault) : rc;
}

static pbs_code read_points(placed *p, const pbs_chunk *c, pbs_err *err) {
    pbs_exporter *x = p->x;
    uint64_t prefix = x->o->prefix ? x->o->prefix : UINT64_MAX;
    int spacing = pbs_record_at(&x->record, PBS_SPACING);
    pbs_code rc = PBS_OK;
    for (uint32_t k = 0; k < c->count && p->at < prefix && !rc; k += PBS_EXPORT_WINDOW) {
        uint32_t n = c->count - k < PBS_EXPORT_WINDOW ? c->count - k : PBS_EXPORT_WINDOW;
        const uint8_t *record = (const uint8_t *)c->payload + (size_t)k * x->record.stride;
        rc = read_window(x, c, p->node, k, n, err);
        for (uint32_t i = 0; i < n && !rc && p->at < prefix; i++, record += x->record.stride) {
            p->at++;
            if (is_chosen(p, record + spacing)) put_point(p, i, record);
        }
        if (!rc) rc = flush(p, x->block.count, err);
    }
    return rc;
}

/* Every node gives its share of the points of the spacing that not all can be taken of. */
static pbs_code share_of(placed *p, pbs_err *err) {
    pbs_exporter *x = p->x;
    pbs_export_tally t;
    if (!x->equal) return PBS_OK;
    pbs_code rc = pbs_export_tally_of(x, p->node, p->scale, &t, err);
    if (rc) return rc;
    uint64_t before = (uint64_t)((unsigned __int128)x->seen * x->share / x->equal);
    x->seen += t.equal;
    p->left = (uint64_t)((unsigned __int128)x->seen * x->share / x->equal) - before;
    return PBS_OK;
}

/* ---- voxels ---- */

static void put_vertex(placed *p, const double cell[3], const float normal[3], uint32_t colour) {
    pbs_exporter *x = p->x;
    pbs_export_block *b = &x->block;
    const pbs_node *n = &x->node[p->node];
    double at[3];
    for (int k = 0; k < 3; k++) at[k] = n->origin[k] + (n->lattice_min[k] + n->lattice * cell[k]);
    pbs_xform_point(b->position[b->count], p->m, at);
    if (b->normal) put_normal(p, normal, b->normal[b->count]);
    if (b->colour) memcpy(b->colour[b->count], &colour, 4);
    if (b->radius) b->radius[b->count] = (float)(n->lattice * p->scale);
    b->count++;
}

/* Four corners, counter-clockwise as seen from outside. */
static void put_face(placed *p, const uint8_t place[4], int face, const float *normal,
                     uint32_t colour) {
    int axis = face / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
    bool back = !(face & 1) != p->mirrors;
    float out[3] = {0, 0, 0};
    out[axis] = face & 1 ? 1 : -1;
    for (int i = 0; i < 4; i++) {
        int corner = back ? 3 - i : i;
        double cell[3] = {place[0], place[1], place[2]};
        cell[axis] += face & 1;
        cell[u] += corner == 1 || corner == 2;
        cell[v] += corner >= 2;
        put_vertex(p, cell, normal ? normal : out, colour);
    }
}

/* Of a voxel without one: where its faces look. */
static void voxel_normal(const pbs_voxels *v, size_t i, float out[3]) {
    if (v->normal && v->normal[i]) {
        pbs_normal10_get(out, v->normal[i]);
        return;
    }
    for (int k = 0; k < 3; k++) {
        uint32_t faces = v->place[i] >> 24 >> 2 * k;
        out[k] = (float)(faces >> 1 & 1) - (float)(faces & 1);
    }
}

/* That of the face, whose place in the node's list follows from the faces before it; else that of
 * the voxel. */
static uint32_t face_colour(const pbs_exporter *x, const pbs_voxels *v, size_t i, int face,
                            uint32_t colour) {
    if (!v->face || !x->face_count) return colour;
    uint32_t before = v->place[i] >> 24 & ((1u << face) - 1);
    uint64_t at = (uint64_t)v->face[i] + (uint64_t)__builtin_popcount(before);
    return at < x->face_count ? x->face[at] : colour;
}

static void put_voxel(placed *p, const pbs_voxels *v, size_t i) {
    uint8_t place[4];
    uint32_t colour = v->colour ? v->colour[i] : UINT32_MAX;
    float normal[3];
    memcpy(place, &v->place[i], 4);
    voxel_normal(v, i, normal);
    if (!p->x->o->faces) {
        put_vertex(p, (double[]){place[0] + 0.5, place[1] + 0.5, place[2] + 0.5}, normal, colour);
        return;
    }
    bool own = v->normal && v->normal[i];
    for (int f = 0; f < 6; f++)
        if (place[3] >> f & 1)
            put_face(p, place, f, own ? normal : NULL, face_colour(p->x, v, i, f, colour));
}

static pbs_code read_voxels(placed *p, const pbs_chunk *c, pbs_err *err) {
    pbs_exporter *x = p->x;
    pbs_voxel_place place;
    pbs_voxels v;
    pbs_code rc = pbs_voxels_view(x->name, x->voxels, c, p->at, &place, &v, err);
    if (rc) return rc;
    p->at += c->count;
    for (size_t i = 0; i < v.count && !rc; i += 512) {
        size_t n = v.count - i < 512 ? v.count - i : 512;
        for (size_t k = i; k < i + n; k++) put_voxel(p, &v, k);
        rc = flush(p, n, err);
    }
    return rc;
}

/* ---- all ---- */

typedef struct each {
    pbs_exporter *x;
    pbs_export_block_fn take;
    void *ctx;
} each;

static pbs_code read_placing(void *ctx, uint32_t node, const double m[12], double scale,
                             pbs_err *err) {
    const each *e = ctx;
    pbs_exporter *x = e->x;
    const pbs_export_data *d = &x->data[node];
    placed p = {.x = x, .node = node, .m = m, .scale = scale, .take = e->take, .ctx = e->ctx};
    bool voxels = d->tag == PBS_TAG_VOXELS;
    size_t at = 0;
    if (x->o->faces && !voxels) {
        x->left_out += x->node[node].records;
        return PBS_OK;
    }
    if ((voxels || x->record.packed) && !(x->node[node].lattice > 0))
        return pbs_fail(err, PBS_DATA, "%s: node %u has no lattice", x->name, node);
    set_turn(&p);
    x->block.voxels = voxels;
    /* Half a step is what is lost already; voxels are to fit together. */
    x->block.grain = x->node[node].lattice * scale / (voxels ? 256 : 1);
    pbs_code rc = voxels ? pbs_export_faces(x, node, err) : share_of(&p, err);
    for (uint32_t i = 0; i < d->chunks && !rc; i++) {
        pbs_chunk c;
        if (!voxels && x->o->prefix && p.at >= x->o->prefix) break;
        rc = pbs_export_chunk(x, node, i, &at, &c, err);
        if (!rc) rc = voxels ? read_voxels(&p, &c, err) : read_points(&p, &c, err);
    }
    return rc;
}

pbs_code pbs_export_each(pbs_exporter *x, pbs_export_block_fn take, void *ctx, pbs_err *err) {
    each e = {x, take, ctx};
    x->seen = x->left_out = 0;
    x->block.count = 0;
    return pbs_export_walk(x, read_placing, &e, err);
}
