/* PLY. Vertices of a fixed size in a binary file are read where they are. Others (ascii, or with
 * lists inside) are packed first into such records, in a temporary file if they are many, so there
 * is one way to fetch a corner. Faces are handed over as they are read.
 *
 * Colours are sRGB: integers count to 255 (ushort to 65535), floats to 1, or to 255 if any is above
 * 2. Texture coordinates have v upwards. Triangle strips with -1 as a restart are understood, and
 * so are texture coordinates per corner and "comment TextureFile".
 */
#include "formats/readers/faces.h"
#include "formats/readers/mtl.h"
#include "formats/readers/ply_header.h"
#include "formats/container/scratch.h"

/* Where a vertex attribute is in a record; offset -1: nowhere. */
typedef struct field {
    ptrdiff_t offset;
    pbs_ply_type type;
} field;

typedef struct ply {
    pbs_ply_header header;
    const char *file, *p, *end;
    const pbs_ply_element *element; /* that is being read, and the number of it, for messages */
    uint64_t number;
    pbs_run *run;
    pbs_faces faces;
    pbs_mtl mtl;
    /* vertices */
    const char *record;
    size_t stride;
    uint64_t vertices;
    bool swap;
    field field[PBS_PLY_ROLES];
    bool plain; /* x, y, z are three floats in a row */
    double colour_scale;
    pbs_scratch packed;
    pbs_trim trim;
    pbs_box box;
    /* faces */
    uint32_t attributes;
    bool face_colour, begun;
    float *uv; /* of the face that is being read */
    size_t uvs, uv_room;
    uint32_t *material; /* one a TextureFile */
    uint32_t texture;   /* of the face that is being read */
    uint8_t colour[4];
} ply;

/* ---- numbers ---- */

static const bool is_big_endian = __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__;

static size_t left(const ply *y) {
    return (size_t)(y->end - y->p);
}

static pbs_code too_short(const ply *y, pbs_err *err) {
    return pbs_fail(err, PBS_DATA, "the file ends too early: %llu are promised",
                    (unsigned long long)y->element->count);
}

/* The next number of the file. */
static inline pbs_code next(ply *y, pbs_ply_type t, double *v, pbs_err *err) {
    if (y->header.ascii) {
        y->p = pbs_text_skip_blank(y->p, y->end);
        if (y->p == y->end) return too_short(y, err);
        const char *p = y->p;
        if (!pbs_text_double(&p, y->end, v) || (p < y->end && !pbs_text_is_blank(*p)))
            return pbs_fail(err, PBS_DATA, "\"%.*s\" is not a number",
                            (int)(pbs_text_skip_word(p, p + 40 < y->end ? p + 40 : y->end) - y->p),
                            y->p);
        y->p = p;
        return PBS_OK;
    }
    if (left(y) < pbs_ply_size(t)) return too_short(y, err);
    *v = pbs_ply_load(y->p, t, y->header.big_endian != is_big_endian);
    y->p += pbs_ply_size(t);
    return PBS_OK;
}

/* The length of a list, which must fit into what is left of the file. */
static pbs_code next_count(ply *y, const pbs_ply_property *p, uint64_t *n, pbs_err *err) {
    double v;
    pbs_code rc = next(y, p->count, &v, err);
    if (rc) return rc;
    if (!(v >= 0 && v < 0x1p53) || v != (double)(uint64_t)v)
        return pbs_fail(err, PBS_DATA, "a list of %g elements", v);
    *n = (uint64_t)v;
    if (*n > (y->header.ascii ? left(y) / 2 + 1 : left(y) / pbs_ply_size(p->type)))
        return pbs_fail(err, PBS_DATA, "a list of %llu elements, which the file is too short for",
                        (unsigned long long)*n);
    return PBS_OK;
}

static pbs_code skip_list(ply *y, const pbs_ply_property *p, pbs_err *err) {
    uint64_t n;
    double v;
    pbs_code rc = next_count(y, p, &n, err);
    if (rc) return rc;
    if (!y->header.ascii)
        y->p += n * pbs_ply_size(p->type);
    else
        while (n-- && !rc) rc = next(y, p->type, &v, err);
    return rc;
}

/* ---- elements ---- */

/* Refuses a count that cannot be, before anything is allocated for it. */
static pbs_code begin_element(ply *y, const pbs_ply_element *e, pbs_err *err) {
    size_t least = y->header.ascii ? 2 * e->properties : e->least;
    size_t most = y->header.ascii ? left(y) + 1 : left(y);
    y->element = e, y->number = 0;
    if (!least || e->count <= most / least) return PBS_OK;
    y->number = most / least;
    return too_short(y, err);
}

static pbs_code check(ply *y, pbs_err *err) {
    if (++y->number % PBS_TRIM_EVERY) return PBS_OK;
    pbs_trim_now(&y->trim);
    if (y->number % PBS_CHECK_EVERY) return PBS_OK;
    pbs_run_progress(y->run, "reading", (uint64_t)(y->p - y->file), (uint64_t)(y->end - y->file));
    return pbs_run_check(y->run, err);
}

static pbs_code skip_element(ply *y, const pbs_ply_element *e, pbs_err *err) {
    pbs_code rc = begin_element(y, e, err);
    if (rc || !e->properties) return rc;
    if (e->fixed && !y->header.ascii) {
        y->p += e->count * e->least;
        return PBS_OK;
    }
    while (!rc && y->number < e->count) {
        for (size_t i = 0; i < e->properties && !rc; i++) {
            const pbs_ply_property *p = &y->header.property[e->first + i];
            double v;
            rc = p->count != PBS_PLY_NO_TYPE ? skip_list(y, p, err) : next(y, p->type, &v, err);
        }
        if (!rc) rc = check(y, err);
    }
    return rc;
}

/* ---- vertices ---- */

static bool has(const ply *y, pbs_ply_role first, int n) {
    for (int k = 0; k < n; k++)
        if (y->field[first + k].offset < 0) return false;
    return true;
}

static void find_fields(ply *y, const pbs_ply_element *e) {
    for (int r = 0; r < PBS_PLY_ROLES; r++) y->field[r] = (field){-1, PBS_PLY_NO_TYPE};
    for (size_t i = 0; i < e->properties; i++) {
        const pbs_ply_property *p = &y->header.property[e->first + i];
        if (p->role < PBS_PLY_ROLES && y->field[p->role].offset < 0)
            y->field[p->role] = (field){(ptrdiff_t)p->offset, p->type};
    }
}

static pbs_ply_type packed_type(pbs_ply_role r, pbs_ply_type t) {
    return r <= PBS_PLY_Z ? PBS_PLY_F64 : t == PBS_PLY_U8 ? t : PBS_PLY_F32;
}

static void store(char *p, pbs_ply_type t, double v) {
    float f = (float)v;
    uint8_t b = v >= 255 ? 255 : v > 0 ? (uint8_t)v : 0;
    if (t == PBS_PLY_F64)
        memcpy(p, &v, 8);
    else if (t == PBS_PLY_F32)
        memcpy(p, &f, 4);
    else
        memcpy(p, &b, 1);
}

/* to[i]: where property i goes in a packed record; -1: it is skipped. */
static size_t lay_out(ply *y, const pbs_ply_element *e, field *to) {
    size_t stride = 0;
    bool taken[PBS_PLY_ROLES] = {0};
    for (size_t i = 0; i < e->properties; i++) {
        const pbs_ply_property *p = &y->header.property[e->first + i];
        to[i] = (field){-1, p->type};
        if (p->role >= PBS_PLY_ROLES || taken[p->role]) continue;
        taken[p->role] = true;
        to[i] = y->field[p->role] = (field){(ptrdiff_t)stride, packed_type(p->role, p->type)};
        stride += pbs_ply_size(to[i].type);
    }
    return stride;
}

static pbs_code pack_one(ply *y, const pbs_ply_element *e, const field *to, pbs_err *err) {
    char *record = (char *)y->packed.bytes + y->number * y->stride;
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < e->properties && !rc; i++) {
        const pbs_ply_property *p = &y->header.property[e->first + i];
        double v;
        if (p->count != PBS_PLY_NO_TYPE)
            rc = skip_list(y, p, err);
        else if (!(rc = next(y, p->type, &v, err)) && to[i].offset >= 0)
            store(record + to[i].offset, to[i].type, v);
    }
    return rc;
}

static pbs_code pack(ply *y, const pbs_ply_element *e, pbs_err *err) {
    field *to;
    pbs_code rc = pbs_alloc(y->run, &to, e->properties, sizeof *to, "the header", err);
    if (rc) return rc;
    y->stride = lay_out(y, e, to);
    y->swap = false;
    rc = pbs_scratch_new(y->run, e->count, y->stride, "the vertices", &y->packed, err);
    if (y->packed.is_file) pbs_trim_add(&y->trim, y->packed.bytes, y->packed.size);
    while (!rc && y->number < e->count) {
        rc = pack_one(y, e, to, err);
        if (!rc) rc = check(y, err);
    }
    y->record = y->packed.bytes;
    pbs_free(y->run, to);
    return rc;
}

static inline const char *record_of(const ply *y, uint64_t i) {
    return y->record + i * y->stride;
}

static inline void position_of(const ply *y, const char *record, double v[3]) {
    if (y->plain) {
        float f[3];
        memcpy(f, record + y->field[PBS_PLY_X].offset, sizeof f);
        for (int k = 0; k < 3; k++) v[k] = f[k];
    } else {
        for (int k = 0; k < 3; k++)
            v[k] = pbs_ply_load(record + y->field[k].offset, y->field[k].type, y->swap);
    }
}

/* The box, and whether float colours count to 1 or to 255. */
static pbs_code survey(ply *y, pbs_err *err) {
    const field *red = &y->field[PBS_PLY_RED];
    bool floats = red->offset >= 0 && red->type >= PBS_PLY_F32 && y->colour_scale == 1;
    y->box = PBS_BOX_EMPTY;
    for (uint64_t i = 0; i < y->vertices; i++) {
        const char *record = record_of(y, i);
        double v[3];
        position_of(y, record, v);
        if ((v[0] + v[1] + v[2]) * 0 == 0) pbs_box_add(&y->box, v);
        for (int k = 0; k < 3 && floats; k++)
            if (pbs_ply_load(record + red[k].offset, red[k].type, y->swap) > 2)
                floats = false, y->colour_scale = 1 / 255.0;
        if (i % PBS_CHECK_EVERY) continue;
        pbs_trim_now(&y->trim);
        pbs_code rc = pbs_run_check(y->run, err);
        if (rc) return rc;
    }
    return PBS_OK;
}

static double scale_of(pbs_ply_type t) {
    return t >= PBS_PLY_F32 ? 1 : t == PBS_PLY_U16 ? 1 / 65535.0 : 1 / 255.0;
}

/* The vertices are given back only if giving back what is around them is not enough. */
static void trim_apart(ply *y) {
    if (!y->faces.sink->mapped) return;
    pbs_trim_drop(&y->trim, y->file);
    pbs_trim_add(&y->trim, y->p, left(y));
    pbs_trim_add(&y->trim, y->file, (size_t)(y->record - y->file));
    pbs_trim_add(&y->trim, y->record, (size_t)(y->p - y->record));
}

static pbs_code read_vertices(ply *y, const pbs_ply_element *e, pbs_err *err) {
    find_fields(y, e);
    if (!has(y, PBS_PLY_X, 3)) return pbs_fail(err, PBS_DATA, "the vertices have no x, y and z");
    pbs_code rc = begin_element(y, e, err);
    if (rc) return rc;
    y->vertices = e->count;
    y->colour_scale = has(y, PBS_PLY_RED, 3) ? scale_of(y->field[PBS_PLY_RED].type) : 1;
    if (e->fixed && !y->header.ascii) {
        y->record = y->p;
        y->stride = e->least;
        y->swap = y->header.big_endian != is_big_endian;
        y->p += e->count * e->least;
        trim_apart(y);
    } else if ((rc = pack(y, e, err))) {
        return rc;
    }
    const field *f = y->field;
    y->plain = !y->swap;
    for (int k = 0; k < 3; k++)
        y->plain &= f[k].type == PBS_PLY_F32 && f[k].offset == f[0].offset + 4 * k;
    return survey(y, err);
}

static uint8_t colour_of(const ply *y, const char *record, pbs_ply_role r) {
    const field *f = &y->field[r];
    double v = pbs_ply_load(record + f->offset, f->type, y->swap);
    return f->type == PBS_PLY_U8 ? (uint8_t)v : pbs_unorm8((float)(v * y->colour_scale));
}

static void fetch(const ply *y, uint64_t i, pbs_corner *c) {
    const char *record = record_of(y, i);
    const field *f = y->field;
    memset(c, 0, sizeof *c);
    position_of(y, record, c->position);
    for (int k = 0; k < 3 && y->attributes & PBS_CORNER_NORMAL; k++)
        c->normal[k] =
            (float)pbs_ply_load(record + f[PBS_PLY_NX + k].offset, f[PBS_PLY_NX + k].type, y->swap);
    if (y->attributes & PBS_CORNER_UV && has(y, PBS_PLY_S, 2)) {
        c->uv[0] = (float)pbs_ply_load(record + f[PBS_PLY_S].offset, f[PBS_PLY_S].type, y->swap);
        c->uv[1] =
            1 - (float)pbs_ply_load(record + f[PBS_PLY_T].offset, f[PBS_PLY_T].type, y->swap);
    }
    if (!(y->attributes & PBS_CORNER_COLOUR)) return;
    memcpy(c->colour, y->colour, 4);
    if (y->face_colour) return;
    for (int k = 0; k < 3; k++) c->colour[k] = colour_of(y, record, PBS_PLY_RED + k);
    if (f[PBS_PLY_ALPHA].offset >= 0) c->colour[3] = colour_of(y, record, PBS_PLY_ALPHA);
}

/* ---- faces ---- */

/* One number of the list of a face or strip; restart: -1 is allowed and gives UINT64_MAX. */
static inline pbs_code next_index(ply *y, pbs_ply_type t, bool restart, uint64_t *i, pbs_err *err) {
    double v;
    pbs_code rc = next(y, t, &v, err);
    if (rc) return rc;
    if (v >= 0 && v < (double)y->vertices) {
        *i = (uint64_t)v;
        if (v == (double)*i) return PBS_OK;
    }
    *i = UINT64_MAX;
    if (restart && v == -1) return PBS_OK;
    return pbs_fail(err, PBS_DATA, "vertex %.15g, but there are %llu, counted from 0", v,
                    (unsigned long long)y->vertices);
}

static pbs_code read_corners(ply *y, const pbs_ply_property *p, size_t *n, pbs_err *err) {
    uint64_t i, count;
    pbs_code rc = next_count(y, p, &count, err);
    for (*n = 0; *n < count && !rc; (*n)++) {
        rc = next_index(y, p->type, false, &i, err);
        if (!rc && *n >= y->faces.corners) rc = pbs_faces_reserve(&y->faces, *n + 1, err);
        if (!rc) fetch(y, i, &y->faces.corner[*n]);
    }
    return rc;
}

static pbs_code read_wedge_uv(ply *y, const pbs_ply_property *p, pbs_err *err) {
    uint64_t count;
    pbs_code rc = next_count(y, p, &count, err);
    for (y->uvs = 0; y->uvs < count && !rc; y->uvs++) {
        double v;
        rc = next(y, p->type, &v, err);
        if (!rc)
            rc = pbs_grow(y->run, &y->uv, &y->uv_room, y->uvs + 1, sizeof *y->uv,
                          "texture coordinates", err);
        if (!rc) y->uv[y->uvs] = (float)v;
    }
    return rc;
}

static pbs_code read_face_number(ply *y, const pbs_ply_property *p, pbs_err *err) {
    double v;
    pbs_code rc = next(y, p->type, &v, err);
    if (rc) return rc;
    if (p->role == PBS_PLY_TEXTURE)
        y->texture = v >= 0 && v < (double)y->header.textures ? (uint32_t)v : 0;
    else if (p->role >= PBS_PLY_RED && p->role <= PBS_PLY_ALPHA)
        y->colour[p->role - PBS_PLY_RED] = pbs_unorm8((float)(v * scale_of(p->type)));
    return PBS_OK;
}

static pbs_code read_face(ply *y, const pbs_ply_element *e, pbs_err *err) {
    size_t n = 0;
    pbs_code rc = PBS_OK;
    y->uvs = 0, y->texture = 0;
    for (size_t i = 0; i < e->properties && !rc; i++) {
        const pbs_ply_property *p = &y->header.property[e->first + i];
        if (p->role == PBS_PLY_INDICES)
            rc = read_corners(y, p, &n, err);
        else if (p->role == PBS_PLY_WEDGE_UV)
            rc = read_wedge_uv(y, p, err);
        else if (p->count != PBS_PLY_NO_TYPE)
            rc = skip_list(y, p, err);
        else
            rc = read_face_number(y, p, err);
    }
    for (size_t i = 0; i < n && !rc; i++) {
        pbs_corner *c = &y->faces.corner[i];
        if (y->uvs == 2 * n) c->uv[0] = y->uv[2 * i], c->uv[1] = 1 - y->uv[2 * i + 1];
        if (y->face_colour) memcpy(c->colour, y->colour, 4);
    }
    if (rc) return rc;
    return pbs_faces_polygon(&y->faces, n, y->material ? y->material[y->texture] : PBS_NONE, err);
}

/* A strip turns its winding with every triangle; a restart turns it back. */
static pbs_code read_strip(ply *y, const pbs_ply_property *p, pbs_err *err) {
    pbs_corner *c = y->faces.corner;
    const pbs_sink *sink = y->faces.sink;
    pbs_corner last[3];
    uint64_t count, i, run = 0;
    pbs_code rc = next_count(y, p, &count, err);
    for (uint64_t k = 0; k < count && !rc; k++) {
        rc = next_index(y, p->type, true, &i, err);
        if (k % PBS_TRIM_EVERY == 0) pbs_trim_now(&y->trim);
        if (!rc && k % PBS_CHECK_EVERY == 0) rc = pbs_run_check(y->run, err);
        if (rc) break;
        if (i == UINT64_MAX) {
            run = 0;
            continue;
        }
        fetch(y, i, &last[run++ % 3]);
        if (run < 3) continue;
        for (int j = 0; j < 3; j++) c[j] = last[(run + (uint64_t)j) % 3];
        if (run % 2 == 0) c[0] = last[(run + 1) % 3], c[1] = last[run % 3];
        rc = sink->triangle(sink->ctx, c, y->material ? y->material[0] : PBS_NONE, err);
    }
    return rc;
}

static pbs_code read_strips(ply *y, const pbs_ply_element *e, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < e->properties && !rc; i++) {
        const pbs_ply_property *p = &y->header.property[e->first + i];
        double v;
        if (p->role == PBS_PLY_INDICES)
            rc = read_strip(y, p, err);
        else if (p->count != PBS_PLY_NO_TYPE)
            rc = skip_list(y, p, err);
        else
            rc = next(y, p->type, &v, err);
    }
    return rc;
}

static bool has_role(const ply *y, const pbs_ply_element *e, pbs_ply_role r) {
    for (size_t i = 0; i < e->properties; i++)
        if (y->header.property[e->first + i].role == r) return true;
    return false;
}

static pbs_code read_faces(ply *y, const pbs_ply_element *e, pbs_err *err) {
    if (e->count && !has_role(y, e, PBS_PLY_INDICES))
        return pbs_fail(err, PBS_DATA, "the faces have no list vertex_indices");
    pbs_code rc = begin_element(y, e, err);
    while (!rc && y->number < e->count) {
        rc = pbs_ply_is_face(e) ? read_face(y, e, err) : read_strips(y, e, err);
        if (!rc) rc = check(y, err);
    }
    return rc;
}

/* ---- all of it ---- */

static pbs_code make_materials(ply *y, pbs_err *err) {
    size_t n = y->header.textures;
    if (!n || !(y->attributes & PBS_CORNER_UV)) return PBS_OK;
    pbs_code rc = pbs_alloc(y->run, &y->material, n, sizeof *y->material, "the materials", err);
    for (size_t i = 0; i < n && !rc; i++) {
        pbs_material m = PBS_MATERIAL_DEFAULT;
        rc = pbs_mtl_texture(&y->mtl, y->header.texture[i], NULL, &m.base_texture.texture, err);
        if (!rc) rc = y->faces.sink->material(y->faces.sink->ctx, &m, &y->material[i], err);
    }
    return rc;
}

static void find_attributes(ply *y) {
    if (has(y, PBS_PLY_NX, 3)) y->attributes |= PBS_CORNER_NORMAL;
    if (has(y, PBS_PLY_S, 2)) y->attributes |= PBS_CORNER_UV;
    if (has(y, PBS_PLY_RED, 3)) y->attributes |= PBS_CORNER_COLOUR;
    memset(y->colour, 255, 4);
    for (size_t i = 0; i < y->header.elements; i++) {
        const pbs_ply_element *e = &y->header.element[i];
        if (!pbs_ply_is_face(e)) continue;
        if (has_role(y, e, PBS_PLY_WEDGE_UV)) y->attributes |= PBS_CORNER_UV;
        y->face_colour |= !has(y, PBS_PLY_RED, 3) && has_role(y, e, PBS_PLY_RED) &&
                          has_role(y, e, PBS_PLY_GREEN) && has_role(y, e, PBS_PLY_BLUE);
    }
    if (y->face_colour) y->attributes |= PBS_CORNER_COLOUR;
}

static pbs_code begin(ply *y, const char *name, pbs_err *err) {
    y->element = NULL;
    find_attributes(y);
    pbs_code rc = make_materials(y, err);
    if (!rc) rc = pbs_faces_reserve(&y->faces, 3, err);
    double origin[3];
    for (int k = 0; k < 3; k++)
        origin[k] = pbs_box_is_empty(&y->box) ? 0 : y->box.min[k] / 2 + y->box.max[k] / 2;
    const pbs_sink *sink = y->faces.sink;
    if (!rc) rc = sink->part_begin(sink->ctx, name, origin, y->attributes, err);
    y->begun = !rc;
    return rc;
}

/* Faces that the file has before the vertices have been skipped; now they can be read. */
static pbs_code read_earlier_faces(ply *y, const pbs_ply_element *vertex, pbs_err *err) {
    const char *here = y->p;
    pbs_code rc = PBS_OK;
    for (pbs_ply_element *e = y->header.element; e < vertex && !rc; e++) {
        if (!pbs_ply_is_face(e) && !pbs_ply_is_strip(e)) continue;
        y->p = e->start;
        rc = read_faces(y, e, err);
    }
    if (!rc) y->p = here;
    return rc;
}

static pbs_code read_elements(ply *y, const char *name, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < y->header.elements && !rc; i++) {
        pbs_ply_element *e = &y->header.element[i];
        e->start = y->p;
        y->element = NULL;
        if (pbs_ply_is_vertex(e) && !y->begun) {
            rc = read_vertices(y, e, err);
            if (!rc) rc = begin(y, name, err);
            if (!rc) rc = read_earlier_faces(y, e, err);
        } else if (y->begun && (pbs_ply_is_face(e) || pbs_ply_is_strip(e))) {
            rc = read_faces(y, e, err);
        } else {
            rc = skip_element(y, e, err);
        }
    }
    return rc;
}

/* A count that is too small would lose what is behind. Blanks and zeros are padding. */
static pbs_code check_end(ply *y, pbs_err *err) {
    const char *p = y->p;
    while (p < y->end && (pbs_text_is_blank(*p) || *p == 0)) p++;
    if (p == y->end) return PBS_OK;
    return pbs_fail(err, PBS_DATA, "%zu bytes follow the last element: a count is wrong", left(y));
}

static void say_where(const ply *y, pbs_err *err) {
    char name[PBS_NAME_MAX];
    pbs_text_name(name, y->element->name);
    pbs_fail_in(err, "%.60s %llu", name, (unsigned long long)y->number);
    if (y->header.ascii)
        pbs_fail_in(err, "line %llu", (unsigned long long)pbs_text_line(y->file, y->p));
}

pbs_code pbs_import_ply(const char *path, const void *bytes, size_t size, const pbs_sink *sink,
                        pbs_err *err) {
    char stem[PBS_NAME_MAX];
    pbs_file_stem(stem, path);
    ply y = {.file = bytes, .run = sink->run};
    y.faces.sink = y.mtl.sink = sink;
    y.mtl.path = path;
    pbs_trim_open(y.run, &y.trim);
    if (sink->mapped) pbs_trim_add(&y.trim, bytes, size);
    pbs_code rc = pbs_ply_header_read(sink->run, bytes, size, &y.header, err);
    if (!rc) rc = pbs_ply_check_header(&y.header, err);
    y.p = y.header.data;
    y.end = y.file + size;
    if (!rc) {
        rc = read_elements(&y, stem, err);
        if (rc == PBS_DATA && y.element) say_where(&y, err);
        if (!rc) rc = check_end(&y, err);
        if (!rc) rc = pbs_faces_part_end(&y.faces, err);
        if (!rc) rc = pbs_faces_root(&y.faces, stem, err);
    }
    pbs_ply_header_free(sink->run, &y.header);
    pbs_scratch_free(&y.packed);
    pbs_trim_close(&y.trim);
    pbs_free(sink->run, y.uv);
    pbs_free(sink->run, y.material);
    pbs_mtl_free(&y.mtl);
    pbs_faces_free(&y.faces);
    return rc;
}
