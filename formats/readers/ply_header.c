#include "formats/readers/ply_header.h"
#include <string.h>

static pbs_ply_type type_of(pbs_span word) {
    static const char *const name[2][PBS_PLY_NO_TYPE] = {
        {"char", "uchar", "short", "ushort", "int", "uint", "float", "double"},
        {"int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"}};
    int t = 0;
    while (t < PBS_PLY_NO_TYPE && !pbs_text_is(word, name[0][t]) && !pbs_text_is(word, name[1][t]))
        t++;
    return (pbs_ply_type)t;
}

static pbs_ply_role role_of(pbs_span word, bool list) {
    static const struct {
        const char *name;
        pbs_ply_role role;
        bool list;
    } known[] = {{"x", PBS_PLY_X, 0},
                 {"y", PBS_PLY_Y, 0},
                 {"z", PBS_PLY_Z, 0},
                 {"nx", PBS_PLY_NX, 0},
                 {"ny", PBS_PLY_NY, 0},
                 {"nz", PBS_PLY_NZ, 0},
                 {"red", PBS_PLY_RED, 0},
                 {"green", PBS_PLY_GREEN, 0},
                 {"blue", PBS_PLY_BLUE, 0},
                 {"alpha", PBS_PLY_ALPHA, 0},
                 {"r", PBS_PLY_RED, 0},
                 {"g", PBS_PLY_GREEN, 0},
                 {"b", PBS_PLY_BLUE, 0},
                 {"a", PBS_PLY_ALPHA, 0},
                 {"diffuse_red", PBS_PLY_RED, 0},
                 {"diffuse_green", PBS_PLY_GREEN, 0},
                 {"diffuse_blue", PBS_PLY_BLUE, 0},
                 {"diffuse_alpha", PBS_PLY_ALPHA, 0},
                 {"s", PBS_PLY_S, 0},
                 {"t", PBS_PLY_T, 0},
                 {"u", PBS_PLY_S, 0},
                 {"v", PBS_PLY_T, 0},
                 {"texture_u", PBS_PLY_S, 0},
                 {"texture_v", PBS_PLY_T, 0},
                 {"texnumber", PBS_PLY_TEXTURE, 0},
                 {"vertex_indices", PBS_PLY_INDICES, 1},
                 {"vertex_index", PBS_PLY_INDICES, 1},
                 {"texcoord", PBS_PLY_WEDGE_UV, 1}};
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (known[i].list == list && pbs_text_is(word, known[i].name)) return known[i].role;
    return PBS_PLY_OTHER;
}

static pbs_code read_format(pbs_ply_header *h, pbs_span rest, pbs_err *err) {
    pbs_span word = pbs_text_word(&rest.p, rest.end);
    h->ascii = pbs_text_is(word, "ascii");
    h->big_endian = pbs_text_is(word, "binary_big_endian");
    if (h->ascii || h->big_endian || pbs_text_is(word, "binary_little_endian")) return PBS_OK;
    return pbs_fail(err, PBS_DATA,
                    "the format is none of ascii, binary_little_endian, "
                    "binary_big_endian");
}

static pbs_code read_element(pbs_run *run, pbs_ply_header *h, pbs_span rest, pbs_err *err) {
    pbs_ply_element e = {
        .name = pbs_text_word(&rest.p, rest.end), .first = h->properties, .fixed = 1};
    pbs_span number = pbs_text_word(&rest.p, rest.end);
    int64_t n;
    if (!pbs_text_int(&number.p, number.end, &n) || number.p != number.end || n < 0)
        return pbs_fail(err, PBS_DATA, "an element without a count");
    e.count = (uint64_t)n;
    pbs_code rc = pbs_grow(run, &h->element, &h->elements_room, h->elements + 1, sizeof *h->element,
                           "the header", err);
    if (!rc) h->element[h->elements++] = e;
    return rc;
}

static pbs_code read_property(pbs_run *run, pbs_ply_header *h, pbs_span rest, pbs_err *err) {
    if (!h->elements) return pbs_fail(err, PBS_DATA, "a property without an element");
    pbs_ply_element *e = &h->element[h->elements - 1];
    pbs_ply_property p = {.count = PBS_PLY_NO_TYPE, .offset = e->least};
    pbs_span word = pbs_text_word(&rest.p, rest.end);
    bool list = pbs_text_is(word, "list");
    if (list) {
        p.count = type_of(pbs_text_word(&rest.p, rest.end));
        if (p.count >= PBS_PLY_F32)
            return pbs_fail(err, PBS_DATA, "a list whose count is of no integer type");
        word = pbs_text_word(&rest.p, rest.end);
        e->fixed = false;
    }
    p.type = type_of(word);
    if (p.type == PBS_PLY_NO_TYPE) return pbs_fail(err, PBS_DATA, "a property of no known type");
    p.role = role_of(pbs_text_word(&rest.p, rest.end), list);
    e->least += pbs_ply_size(list ? p.count : p.type);
    e->properties++;
    pbs_code rc = pbs_grow(run, &h->property, &h->properties_room, h->properties + 1,
                           sizeof *h->property, "the header", err);
    if (!rc) h->property[h->properties++] = p;
    return rc;
}

static pbs_code read_comment(pbs_run *run, pbs_ply_header *h, pbs_span rest, pbs_err *err) {
    if (!pbs_text_is(pbs_text_word(&rest.p, rest.end), "TextureFile")) return PBS_OK;
    pbs_code rc = pbs_grow(run, &h->texture, &h->textures_room, h->textures + 1, sizeof *h->texture,
                           "the header", err);
    if (!rc) h->texture[h->textures++] = rest;
    return rc;
}

/* Lines end with LF or CR LF; with CR alone if the first one does. */
static bool next_line(const char **p, const char *end, char eol, pbs_span *line) {
    if (*p == end) return false;
    const char *e = memchr(*p, eol, (size_t)(end - *p));
    *line = (pbs_span){*p, e ? e : end};
    *p = e ? e + 1 : end;
    return e != NULL;
}

static pbs_code read_line(pbs_run *run, pbs_ply_header *h, pbs_span key, pbs_span rest,
                          bool *format, pbs_err *err) {
    if (pbs_text_is(key, "format")) {
        *format = true;
        return read_format(h, rest, err);
    }
    if (pbs_text_is(key, "element")) return read_element(run, h, rest, err);
    if (pbs_text_is(key, "property")) return read_property(run, h, rest, err);
    if (pbs_text_is(key, "comment")) return read_comment(run, h, rest, err);
    return PBS_OK; /* obj_info, and comments of programs that forget the word */
}

pbs_code pbs_ply_header_read(pbs_run *run, const void *bytes, size_t size, pbs_ply_header *h,
                             pbs_err *err) {
    const char *file = bytes, *p = file, *end = size ? file + size : file;
    if (size < 4 || memcmp(p, "ply", 3) || !pbs_text_is_blank(p[3]))
        return pbs_fail(err, PBS_DATA, "is not a PLY file");
    const char *first = p + 3;
    while (first < end && (*first == ' ' || *first == '\t')) first++;
    char eol = first + 1 < end && first[0] == '\r' && first[1] != '\n' ? '\r' : '\n';
    bool format = false, done = false;
    pbs_code rc = PBS_OK;
    pbs_span line = {p, p};
    while (!rc && !done && next_line(&p, end, eol, &line)) {
        pbs_span rest = line, key = pbs_text_word(&rest.p, rest.end);
        done = pbs_text_is(key, "end_header");
        if (!done) rc = read_line(run, h, key, rest, &format, err);
        if (!rc) rc = pbs_run_check(run, err);
    }
    if (!rc && !done) rc = pbs_fail(err, PBS_DATA, "the header has no end_header");
    if (!rc && !format) rc = pbs_fail(err, PBS_DATA, "the header has no format");
    if (rc == PBS_DATA)
        pbs_fail_in(err, "line %llu", (unsigned long long)pbs_text_line(file, line.p));
    h->data = p;
    return rc;
}

void pbs_ply_header_free(pbs_run *run, pbs_ply_header *h) {
    pbs_free(run, h->element);
    pbs_free(run, h->property);
    pbs_free(run, h->texture);
}

bool pbs_ply_is_face(const pbs_ply_element *e) {
    return pbs_text_is(e->name, "face");
}
bool pbs_ply_is_strip(const pbs_ply_element *e) {
    return pbs_text_is(e->name, "tristrips");
}
bool pbs_ply_is_vertex(const pbs_ply_element *e) {
    return pbs_text_is(e->name, "vertex");
}

pbs_code pbs_ply_check_header(const pbs_ply_header *h, pbs_err *err) {
    uint64_t vertices = 0, faces = 0;
    for (size_t i = 0; i < h->elements; i++) {
        const pbs_ply_element *e = &h->element[i];
        vertices += pbs_ply_is_vertex(e) ? e->count : 0;
        faces += pbs_ply_is_face(e) || pbs_ply_is_strip(e) ? e->count : 0;
    }
    if (faces && !vertices) return pbs_fail(err, PBS_DATA, "has faces, but no vertices");
    if (!faces && vertices)
        return pbs_fail(err, PBS_DATA,
                        "has no faces, only %llu vertices: a point cloud has no triangles",
                        (unsigned long long)vertices);
    return faces ? PBS_OK : pbs_fail(err, PBS_DATA, "has no faces and no vertices");
}
