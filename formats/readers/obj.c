/* Wavefront OBJ. Three passes over the mapped text: count the vertices, so that the arrays have the
 * right size at once; read vertices, parts and material libraries; then hand over the faces.
 *
 * A part is what follows an `o` line or, in a file without any, a `g` line. Its origin is the
 * middle of the first corners of its faces, which costs one number a face to know beforehand.
 * Vertex colours behind the coordinates are 0 .. 1, or 0 .. 255 if any of them is above 2, and sRGB
 * as in every program that writes them. The weight of rational curves (v x y z w) is ignored.
 */
#include "formats/readers/faces.h"
#include "formats/readers/mtl.h"
#include "formats/container/scratch.h"

typedef struct part {
    pbs_span name;
    pbs_box box;
    uint64_t faces;
    uint32_t attributes; /* PBS_CORNER_*, of the first corner of any face */
} part;

/* How many of each there are, or have been read so far. */
typedef struct counts {
    uint64_t v, vt, vn;
} counts;

typedef struct obj {
    const char *file, *at; /* at: what is being read, for messages */
    size_t size;
    const char *stem;
    pbs_run *run;
    pbs_faces faces;
    pbs_mtl mtl;
    counts total, seen;
    bool by_object; /* parts are `o`, not `g` */
    double *v;
    float *vt, *vn;
    uint8_t *colour;      /* 4 a vertex; NULL until there is one */
    pbs_scratch place[4]; /* of these four: files if they are large */
    pbs_trim trim;
    double colour_scale;
    pbs_box box;
    part *part;
    size_t parts, parts_room;
    uint64_t all_faces, points, lines;
    uint32_t material;
} obj;

enum key { OTHER, V, VT, VN, FACE, OBJECT, GROUP, LINE, POINT, USEMTL, MTLLIB, SURFACE, CURVE };

static enum key key_of(pbs_span line, pbs_span *rest) {
    const char *p = pbs_text_skip_word(line.p, line.end);
    pbs_span word = {line.p, p};
    *rest = (pbs_span){p, line.end};
    if (p - line.p == 1) {
        switch (*line.p) {
        case 'v':
            return V;
        case 'f':
            return FACE;
        case 'o':
            return OBJECT;
        case 'g':
            return GROUP;
        case 'l':
            return LINE;
        case 'p':
            return POINT;
        default:
            return OTHER;
        }
    }
    if (p - line.p == 2 && *line.p == 'v')
        return line.p[1] == 't' ? VT : line.p[1] == 'n' ? VN : OTHER;
    if (pbs_text_is(word, "usemtl")) return USEMTL;
    if (pbs_text_is(word, "mtllib")) return MTLLIB;
    if (pbs_text_is(word, "surf")) return SURFACE;
    if (pbs_text_is(word, "curv") || pbs_text_is(word, "curv2")) return CURVE;
    return pbs_text_is(word, "fo") ? FACE : OTHER;
}

/* One pass: calls read for every line. half is which half of the progress it is; -1: none, it is
 * over soon. */
static pbs_code each_line(obj *o, int half, pbs_code (*read)(obj *, enum key, pbs_span, pbs_err *),
                          pbs_err *err) {
    pbs_lines lines = pbs_lines_of(o->file, o->size);
    pbs_span line, rest;
    pbs_code rc = PBS_OK;
    for (uint64_t n = 1; !rc && pbs_lines_next(&lines, &line); n++) {
        o->at = line.p;
        enum key key = key_of(line, &rest);
        if (key != OTHER) rc = read(o, key, rest, err);
        if (rc || n % PBS_TRIM_EVERY) continue;
        pbs_trim_now(&o->trim);
        if (n % PBS_CHECK_EVERY) continue;
        rc = pbs_run_check(o->run, err);
        uint64_t done = (uint64_t)(lines.p - o->file) + (half > 0 ? o->size : 0);
        if (half >= 0) pbs_run_progress(o->run, "reading", done / 2, o->size);
    }
    return rc;
}

/* ---- first pass ---- */

static pbs_code count(obj *o, enum key key, pbs_span rest, pbs_err *err) {
    (void)rest, (void)err;
    o->total.v += key == V;
    o->total.vt += key == VT;
    o->total.vn += key == VN;
    o->by_object |= key == OBJECT;
    return PBS_OK;
}

enum { PLACE_V, PLACE_VT, PLACE_VN, PLACE_COLOUR };

static pbs_code make_place(obj *o, int i, uint64_t count, size_t size, const char *what,
                           pbs_err *err) {
    pbs_scratch *s = &o->place[i];
    pbs_code rc = pbs_scratch_new(o->run, count, size, what, s, err);
    if (s->is_file) pbs_trim_add(&o->trim, s->bytes, s->size);
    return rc;
}

static pbs_code make_room(obj *o, pbs_err *err) {
    const counts *n = &o->total;
    if (n->v >= PBS_NONE || n->vt >= PBS_NONE || n->vn >= PBS_NONE)
        return pbs_fail(err, PBS_DATA, "more than 4294967294 vertices");
    pbs_code rc = make_place(o, PLACE_V, n->v, 3 * sizeof *o->v, "the vertices", err);
    if (!rc) rc = make_place(o, PLACE_VT, n->vt, 2 * sizeof *o->vt, "the texture coordinates", err);
    if (!rc) rc = make_place(o, PLACE_VN, n->vn, 3 * sizeof *o->vn, "the normals", err);
    o->v = o->place[PLACE_V].bytes;
    o->vt = o->place[PLACE_VT].bytes;
    o->vn = o->place[PLACE_VN].bytes;
    return rc;
}

/* ---- second pass ---- */

/* The file turns out to count to 255: what was taken for 1 so far was 1/255. */
static void rescale_colours(obj *o) {
    for (uint64_t i = 0; i < o->seen.v; i++) {
        for (int k = 0; k < 3; k++) o->colour[4 * i + k] = o->colour[4 * i + k] >= 128;
        if (i % PBS_CHECK_EVERY == 0) pbs_trim_now(&o->trim);
    }
    o->colour_scale = 1 / 255.0;
}

static void make_white(obj *o) {
    const size_t all = o->place[PLACE_COLOUR].size, step = (size_t)4 << 20;
    for (size_t at = 0; at < all; at += step) {
        memset(o->colour + at, 255, all - at < step ? all - at : step);
        pbs_trim_now(&o->trim);
    }
}

static pbs_code read_colour(obj *o, const double *rgb, pbs_err *err) {
    if (!o->colour) {
        pbs_code rc = make_place(o, PLACE_COLOUR, o->total.v, 4, "the vertex colours", err);
        if (rc) return rc;
        o->colour = o->place[PLACE_COLOUR].bytes;
        o->colour_scale = 1;
        make_white(o);
    }
    if (o->colour_scale == 1 && (rgb[0] > 2 || rgb[1] > 2 || rgb[2] > 2)) rescale_colours(o);
    for (int k = 0; k < 3; k++)
        o->colour[4 * o->seen.v + k] = pbs_unorm8((float)(rgb[k] * o->colour_scale));
    return PBS_OK;
}

static pbs_code read_vertex(obj *o, pbs_span rest, pbs_err *err) {
    double x[6];
    int n;
    pbs_code rc = pbs_text_numbers(rest, x, 6, &n, err);
    if (rc) return rc;
    if (n < 3) return pbs_fail(err, PBS_DATA, "a vertex with %d numbers instead of 3", n);
    if (n == 6 && (rc = read_colour(o, x + 3, err))) return rc;
    memcpy(o->v + 3 * o->seen.v, x, 3 * sizeof *x);
    pbs_box_add(&o->box, x);
    o->seen.v++;
    return PBS_OK;
}

static pbs_code read_floats(pbs_span rest, float *to, int least, int most, pbs_err *err) {
    double x[3] = {0, 0, 0};
    int n;
    pbs_code rc = pbs_text_numbers(rest, x, most, &n, err);
    if (!rc && n < least) rc = pbs_fail(err, PBS_DATA, "%d numbers instead of %d", n, least);
    for (int k = 0; k < most && !rc; k++) to[k] = (float)x[k];
    return rc;
}

static pbs_code begin_part(obj *o, pbs_span name, pbs_err *err) {
    pbs_code rc = pbs_grow(o->run, &o->part, &o->parts_room, o->parts + 1, sizeof *o->part,
                           "the list of parts", err);
    if (!rc) o->part[o->parts++] = (part){name, PBS_BOX_EMPTY, 0, 0};
    return rc;
}

/* The first corner of a face, for the part's box and attributes. Whether it is right is looked at
 * in the third pass. */
static void peek_face(obj *o, pbs_span rest) {
    part *now = &o->part[o->parts - 1];
    now->faces++;
    o->all_faces++;
    int64_t i;
    const char *p = pbs_text_skip_joined(rest.p, rest.end);
    if (!pbs_text_int(&p, rest.end, &i)) return;
    i = i < 0 ? (int64_t)o->seen.v + i : i - 1;
    if (i >= 0 && i < (int64_t)o->seen.v) {
        const double *v = o->v + 3 * i;
        if ((v[0] + v[1] + v[2]) * 0 == 0) pbs_box_add(&now->box, v);
    }
    if (p == rest.end || *p++ != '/') return;
    if (p < rest.end && *p != '/' && !pbs_text_is_blank(*p)) now->attributes |= PBS_CORNER_UV;
    while (p < rest.end && *p != '/' && !pbs_text_is_blank(*p)) p++;
    if (p + 1 < rest.end && *p == '/' && !pbs_text_is_blank(p[1]))
        now->attributes |= PBS_CORNER_NORMAL;
}

static uint64_t count_words(pbs_span rest) {
    uint64_t n = 0;
    for (const char *p = rest.p;; n++) {
        p = pbs_text_skip_joined(p, rest.end);
        if (p == rest.end || *p == '#') return n;
        p = pbs_text_skip_word(p, rest.end);
    }
}

/* Programs repeat the line of a group that is open; that does not end it. */
static bool is_new_part(const obj *o, enum key key, pbs_span name, const part *now) {
    if (key != (o->by_object ? OBJECT : GROUP)) return false;
    size_t n = (size_t)(name.end - name.p);
    return !(n == (size_t)(now->name.end - now->name.p) && n && !memcmp(name.p, now->name.p, n));
}

static pbs_code read_elements(obj *o, enum key key, pbs_span rest, pbs_err *err) {
    uint64_t words;
    pbs_code rc = PBS_OK;
    switch (key) {
    case V:
        return read_vertex(o, rest, err);
    case VT:
        return read_floats(rest, o->vt + 2 * o->seen.vt++, 1, 2, err);
    case VN:
        return read_floats(rest, o->vn + 3 * o->seen.vn++, 3, 3, err);
    case FACE:
        peek_face(o, rest);
        break;
    case LINE:
        words = count_words(rest), o->lines += words > 1 ? words - 1 : 0;
        break;
    case POINT:
        o->points += count_words(rest);
        break;
    case CURVE:
        o->lines++;
        break;
    case SURFACE:
        return pbs_fail(err, PBS_DATA, "a free-form surface (surf); export triangles instead");
    case MTLLIB:
        return pbs_mtl_load(&o->mtl, rest, err);
    default:
        if (is_new_part(o, key, rest, &o->part[o->parts - 1])) rc = begin_part(o, rest, err);
    }
    return rc;
}

/* ---- third pass ---- */

static pbs_code open_part(obj *o, pbs_err *err) {
    const part *now = &o->part[o->parts];
    const pbs_box *box = pbs_box_is_empty(&now->box) ? &o->box : &now->box;
    double origin[3];
    for (int k = 0; k < 3; k++) {
        origin[k] = box->min[k] / 2 + box->max[k] / 2;
        if (!(origin[k] * 0 == 0)) origin[k] = 0;
    }
    char name[PBS_NAME_MAX];
    pbs_text_name(name, now->name);
    const pbs_sink *sink = o->faces.sink;
    return sink->part_begin(sink->ctx, *name ? name : o->stem, origin,
                            now->attributes | (o->colour ? PBS_CORNER_COLOUR : 0), err);
}

/* Parts without faces are not parts. */
static pbs_code enter_part(obj *o, size_t i, pbs_err *err) {
    pbs_code rc = PBS_OK;
    if (i && o->part[i - 1].faces) rc = pbs_faces_part_end(&o->faces, err);
    o->parts = i;
    if (!rc && o->part[i].faces) rc = open_part(o, err);
    return rc;
}

/* An index as it is written to a number from 0. */
static inline bool resolve(int64_t i, uint64_t seen, uint64_t total, uint64_t *out) {
    *out = i > 0 ? (uint64_t)i - 1 : (uint64_t)((int64_t)seen + i);
    return i > 0 ? *out < total : i < 0 && (int64_t)*out >= 0;
}

static pbs_code bad_index(const char *what, int64_t i, uint64_t seen, uint64_t total,
                          pbs_err *err) {
    if (i == 0) return pbs_fail(err, PBS_DATA, "%s 0: they are counted from 1", what);
    return pbs_fail(err, PBS_DATA, "%s %lld, but there are %llu", what, (long long)i,
                    (unsigned long long)(i > 0 ? total : seen));
}

static pbs_code bad_corner(const char *p, const char *end, pbs_err *err) {
    char name[PBS_NAME_MAX];
    pbs_text_name(name, (pbs_span){p, pbs_text_skip_word(p, end)});
    return pbs_fail(err, PBS_DATA, "\"%.40s\" is not a corner of a face", name);
}

/* v, v/t, v//n or v/t/n; also v/ and v//, which some programs write. */
static pbs_code read_corner(const obj *o, const char **at, const char *end, pbs_corner *c,
                            pbs_err *err) {
    const char *p = *at;
    int64_t i;
    uint64_t v, t = UINT64_MAX, n = UINT64_MAX;
    if (!pbs_text_int(&p, end, &i)) return bad_corner(*at, end, err);
    if (!resolve(i, o->seen.v, o->total.v, &v))
        return bad_index("vertex", i, o->seen.v, o->total.v, err);
    if (p < end && *p == '/') {
        p++;
        if (pbs_text_int(&p, end, &i) && !resolve(i, o->seen.vt, o->total.vt, &t))
            return bad_index("texture coordinate", i, o->seen.vt, o->total.vt, err);
        p += p < end && *p == '/';
        if (p > *at && p[-1] == '/' && pbs_text_int(&p, end, &i) &&
            !resolve(i, o->seen.vn, o->total.vn, &n))
            return bad_index("normal", i, o->seen.vn, o->total.vn, err);
    }
    if (p < end && !pbs_text_is_blank(*p) && *p != '\\') return bad_corner(*at, end, err);
    memset(c, 0, sizeof *c);
    memcpy(c->position, o->v + 3 * v, sizeof c->position);
    if (t != UINT64_MAX) c->uv[0] = o->vt[2 * t], c->uv[1] = 1 - o->vt[2 * t + 1];
    if (n != UINT64_MAX) memcpy(c->normal, o->vn + 3 * n, sizeof c->normal);
    if (o->colour) memcpy(c->colour, o->colour + 4 * v, 4);
    *at = p;
    return PBS_OK;
}

static pbs_code read_face(obj *o, pbs_span rest, pbs_err *err) {
    const char *p = rest.p;
    size_t n = 0;
    for (;; n++) {
        p = pbs_text_skip_joined(p, rest.end);
        if (p == rest.end || *p == '#') break;
        pbs_code rc = n < o->faces.corners ? PBS_OK : pbs_faces_reserve(&o->faces, n + 1, err);
        if (!rc) rc = read_corner(o, &p, rest.end, &o->faces.corner[n], err);
        if (rc) return rc;
    }
    return pbs_faces_polygon(&o->faces, n, o->material, err);
}

static pbs_code send_faces(obj *o, enum key key, pbs_span rest, pbs_err *err) {
    switch (key) {
    case V:
        o->seen.v++;
        break;
    case VT:
        o->seen.vt++;
        break;
    case VN:
        o->seen.vn++;
        break;
    case FACE:
        return read_face(o, rest, err);
    case USEMTL:
        o->material = pbs_mtl_find(&o->mtl, rest);
        break;
    default:
        if (is_new_part(o, key, rest, &o->part[o->parts])) return enter_part(o, o->parts + 1, err);
    }
    return PBS_OK;
}

/* ---- all of it ---- */

static pbs_code no_faces(const obj *o, pbs_err *err) {
    return pbs_fail(err, PBS_DATA, "has no faces (%llu vertices, %llu points, %llu lines)",
                    (unsigned long long)o->total.v, (unsigned long long)o->points,
                    (unsigned long long)o->lines);
}

static pbs_code send_all(obj *o, pbs_err *err) {
    const pbs_sink *sink = o->faces.sink;
    size_t parts = o->parts;
    o->seen = (counts){0};
    o->material = PBS_NONE;
    sink->skip(sink->ctx, PBS_SKIP_POINTS, o->points);
    sink->skip(sink->ctx, PBS_SKIP_LINES, o->lines);
    pbs_code rc = enter_part(o, 0, err);
    if (!rc) rc = each_line(o, 1, send_faces, err);
    if (!rc && o->part[parts - 1].faces) rc = pbs_faces_part_end(&o->faces, err);
    return rc;
}

static pbs_code import(obj *o, pbs_err *err) {
    if (o->size >= 2 && (!memcmp(o->file, "\xff\xfe", 2) || !memcmp(o->file, "\xfe\xff", 2)))
        return pbs_fail(err, PBS_DATA, "is UTF-16 text: convert it to UTF-8");
    pbs_code rc = each_line(o, -1, count, err);
    if (!rc) rc = make_room(o, err);
    if (!rc) rc = begin_part(o, (pbs_span){o->file, o->file}, err);
    if (!rc) rc = each_line(o, 0, read_elements, err);
    if (!rc && !o->all_faces) {
        o->at = NULL;
        return no_faces(o, err);
    }
    if (!rc) rc = send_all(o, err);
    if (rc != PBS_DATA) o->at = NULL;
    return rc;
}

pbs_code pbs_import_obj(const char *path, const void *bytes, size_t size, const pbs_sink *sink,
                        pbs_err *err) {
    char stem[PBS_NAME_MAX];
    pbs_file_stem(stem, path);
    obj o = {.file = bytes, .size = size, .stem = stem, .run = sink->run, .box = PBS_BOX_EMPTY};
    o.faces.sink = o.mtl.sink = sink;
    o.mtl.path = path;
    pbs_trim_open(o.run, &o.trim);
    if (sink->mapped) pbs_trim_add(&o.trim, bytes, size);
    pbs_code rc = import(&o, err);
    if (rc && o.at) pbs_fail_in(err, "line %llu", (unsigned long long)pbs_text_line(o.file, o.at));
    if (!rc) rc = pbs_faces_root(&o.faces, stem, err);
    for (int i = 0; i < 4; i++) pbs_scratch_free(&o.place[i]);
    pbs_trim_close(&o.trim);
    pbs_free(sink->run, o.part);
    pbs_mtl_free(&o.mtl);
    pbs_faces_free(&o.faces);
    return rc;
}
