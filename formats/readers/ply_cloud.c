/* PLY files without faces: point clouds, in text or binary. */
#include "formats/readers/cloud.h"
#include "formats/readers/ply_header.h"
#include <math.h>

typedef struct ply {
    pbs_cloud *c;
    pbs_ply_header h;
    const pbs_ply_element *vertex;
    int column[6]; /* of x, y, z, red, green, blue among the vertex's properties; -1: absent */
    bool colours;
} ply;

static float colour_unit(pbs_ply_type t) {
    return t == PBS_PLY_F32 || t == PBS_PLY_F64 ? 65535.0f : t <= PBS_PLY_U8 ? 257.0f : 1.0f;
}

static void decode(const pbs_cloud *c, const uint8_t *from, size_t n, double (*value)[3],
                   uint16_t (*colour)[3]) {
    const char *p = (const char *)from;
    for (size_t i = 0; i < n; i++, p += c->stride) {
        for (int k = 0; k < 3; k++) value[i][k] = pbs_ply_load(p + c->at[k], c->type[k], c->swap);
        for (int k = 0; colour && k < 3; k++) {
            double v = pbs_ply_load(p + c->at[3 + k], c->type[3 + k], c->swap) *
                       (double)colour_unit(c->type[3 + k]);
            colour[i][k] = v >= 65535 ? 65535 : v > 0 ? (uint16_t)(v + 0.5) : 0;
        }
    }
}

static pbs_code find_columns(ply *p, pbs_err *err) {
    static const pbs_ply_role role[6] = {PBS_PLY_X,   PBS_PLY_Y,     PBS_PLY_Z,
                                         PBS_PLY_RED, PBS_PLY_GREEN, PBS_PLY_BLUE};
    for (int k = 0; k < 6; k++) {
        p->column[k] = -1;
        for (size_t i = 0; i < p->vertex->properties; i++) {
            const pbs_ply_property *q = &p->h.property[p->vertex->first + i];
            if (q->role == role[k] && q->count == PBS_PLY_NO_TYPE) p->column[k] = (int)i;
        }
        if (k < 3 && p->column[k] < 0)
            return pbs_fail(err, PBS_DATA, "the vertices have no %c", 'x' + k);
    }
    p->colours = p->column[3] >= 0 && p->column[4] >= 0 && p->column[5] >= 0;
    return PBS_OK;
}

/* The vertices, and that nothing is made of them. */
static pbs_code find_vertices(ply *p, pbs_err *err) {
    for (size_t i = 0; i < p->h.elements; i++) {
        const pbs_ply_element *e = &p->h.element[i];
        if ((pbs_ply_is_face(e) || pbs_ply_is_strip(e)) && e->count)
            return pbs_fail(
                err, PBS_DATA, "a mesh (%llu %.*s): pbs-gbuffer and pbs-voxelize read it",
                (unsigned long long)e->count, (int)(e->name.end - e->name.p), e->name.p);
        if (pbs_ply_is_vertex(e) && !p->vertex) p->vertex = e;
    }
    if (!p->vertex) return pbs_fail(err, PBS_DATA, "has no vertices");
    return find_columns(p, err);
}

static pbs_code cut_off(uint64_t count, uint64_t there, pbs_err *err) {
    return pbs_fail(err, PBS_DATA,
                    "cut off: the header says %llu points, and %llu of them are there",
                    (unsigned long long)count, (unsigned long long)there);
}

static pbs_code open_binary(ply *p, pbs_err *err) {
    pbs_cloud *c = p->c;
    const char *at = p->h.data, *end = (const char *)c->in.bytes + c->in.size;
    for (const pbs_ply_element *e = p->h.element; e <= p->vertex; e++) {
        if (!e->fixed) return pbs_fail(err, PBS_DATA, "a point cloud with lists is not read");
        uint64_t left = (uint64_t)(end - at), there = e->least ? left / e->least : UINT64_MAX;
        if (e == p->vertex && e->count > there) return cut_off(e->count, there, err);
        if (e == p->vertex) break;
        if (e->count > there) return pbs_fail(err, PBS_DATA, "cut off before the vertices");
        at += e->count * e->least;
    }
    for (int k = 0; k < 6; k++) {
        if (p->column[k] < 0) continue;
        const pbs_ply_property *q = &p->h.property[p->vertex->first + (size_t)p->column[k]];
        c->at[k] = (uint32_t)q->offset, c->type[k] = (uint8_t)q->type;
    }
    c->swap = p->h.big_endian;
    c->count = p->vertex->count;
    c->stride = p->vertex->least;
    c->first = (const uint8_t *)at;
    c->decode = decode;
    c->colour = p->colours ? PBS_CLOUD_COLOUR_16 : PBS_CLOUD_NO_COLOUR;
    /* Two bytes a colour may still hold one. */
    if (p->colours && c->type[3] == PBS_PLY_U16) c->colour = PBS_CLOUD_COLOUR_ANY;
    return PBS_OK;
}

/* ---- text: a vertex is a line, but the words are what counts ---- */

static bool skip_words(const char **at, const char *end, uint64_t n) {
    while (n--) {
        pbs_span w = pbs_text_word(at, end);
        if (w.p == w.end) return false;
    }
    return true;
}

/* False at the end of the file. */
static bool read_row(const ply *p, const char **at, const char *end, pbs_cloud_row *row,
                     bool *number) {
    for (size_t i = 0; i < p->vertex->properties; i++) {
        const pbs_ply_property *q = &p->h.property[p->vertex->first + i];
        pbs_span w = pbs_text_word(at, end);
        double v;
        if (w.p == w.end) return false;
        *number = *number && pbs_text_double(&w.p, w.end, &v) && w.p == w.end;
        if (!*number) return true;
        if (q->count != PBS_PLY_NO_TYPE && v > 0 && !skip_words(at, end, (uint64_t)v)) return false;
        for (int k = 0; k < 6; k++) {
            if (p->column[k] != (int)i) continue;
            if (k < 3)
                row->value[k] = v;
            else
                row->colour[k - 3] = (float)(v * (double)colour_unit(q->type));
        }
    }
    return true;
}

static pbs_code read_rows(ply *p, const char *at, const char *end, pbs_output *rows, pbs_err *err) {
    pbs_trim trim;
    pbs_code rc = PBS_OK;
    pbs_trim_open(p->c->run, &trim);
    pbs_trim_add(&trim, p->c->in.bytes, (size_t)p->c->in.size);
    for (uint64_t i = 0; i < p->vertex->count && !rc; i++) {
        pbs_cloud_row row = {0};
        bool number = true;
        const char *from = at;
        if (!read_row(p, &at, end, &row, &number))
            rc = cut_off(p->vertex->count, i, err);
        else if (!number)
            rc = pbs_fail(err, PBS_DATA, "line %llu: a vertex that is no numbers",
                          (unsigned long long)pbs_text_line((const char *)p->c->in.bytes,
                                                            pbs_text_skip_blank(from, end)));
        else
            rc = pbs_output_write(rows, &row, sizeof row, err);
        if (!rc && i % 65536 == 65535) {
            pbs_trim_now(&trim);
            rc = pbs_run_check(p->c->run, err);
        }
    }
    pbs_trim_close(&trim);
    return rc;
}

static pbs_code open_text(ply *p, pbs_err *err) {
    const char *at = p->h.data, *end = (const char *)p->c->in.bytes + p->c->in.size;
    for (const pbs_ply_element *e = p->h.element; e < p->vertex; e++) {
        if (!e->fixed) return pbs_fail(err, PBS_DATA, "a point cloud with lists is not read");
        if (!skip_words(&at, end, e->count * e->properties))
            return pbs_fail(err, PBS_DATA, "cut off before the vertices");
    }
    pbs_output rows;
    pbs_code rc = pbs_output_spool(p->c->run, &rows, err);
    if (rc) return rc;
    rc = read_rows(p, at, end, &rows, err);
    /* Colours are of 16 bits as they were read. */
    if (!rc) return pbs_cloud_rows(p->c, &rows, p->colours, 65535, false, err);
    pbs_output_close(&rows);
    return rc;
}

pbs_code pbs_cloud_ply(pbs_cloud *c, pbs_err *err) {
    ply p = {.c = c};
    pbs_code rc = pbs_ply_header_read(c->run, c->in.bytes, (size_t)c->in.size, &p.h, err);
    if (!rc) rc = find_vertices(&p, err);
    if (!rc) rc = p.h.ascii ? open_text(&p, err) : open_binary(&p, err);
    pbs_ply_header_free(c->run, &p.h);
    return rc;
}
