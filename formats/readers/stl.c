/* STL, binary and ascii.
 *
 * Many binary files begin with "solid" like ascii ones. A file is binary if its size is what the
 * count at byte 80 says, or if it does not begin with "solid" or has a zero byte near its
 * beginning. The normals in the file are ignored: they are the triangles' own or wrong.
 *
 * The two bytes behind a triangle carry a colour in two dialects, sRGB, 5 bits a channel. With
 * "COLOR=" and four bytes in the header (Materialise): red lowest, bit 15 set means the header's
 * colour. Otherwise (VisCAM, SolidView): blue lowest, bit 15 set means that there is one.
 */
#include "formats/readers/faces.h"
#include "formats/container/scratch.h"

enum { HEAD = 84, RECORD = 50 };

typedef struct stl {
    const char *file, *p, *end;
    const char *stem;
    pbs_run *run;
    pbs_faces faces;
    pbs_trim trim;
    uint64_t number; /* of the triangle, from 0, for messages */
} stl;

/* ---- binary ---- */

static uint32_t get32(const char *p) {
    const unsigned char *b = (const unsigned char *)p;
    return b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
}

static uint16_t get16(const char *p) {
    const unsigned char *b = (const unsigned char *)p;
    return (uint16_t)(b[0] | b[1] << 8);
}

static void get_corner(const char *p, double v[3]) {
    for (int k = 0; k < 3; k++) {
        uint32_t bits = get32(p + 4 * k);
        float f;
        memcpy(&f, &bits, 4);
        v[k] = f;
    }
}

typedef struct colours {
    bool any, materialise;
    uint8_t whole[4]; /* of triangles that have none of their own */
} colours;

/* As the header says; whether triangles have some is seen later. */
static colours colours_of(const stl *s) {
    colours c = {false, false, {255, 255, 255, 255}};
    const char *mark = memmem(s->file, 80, "COLOR=", 6);
    if (mark && mark + 10 <= s->file + 80) {
        c.any = c.materialise = true;
        memcpy(c.whole, mark + 6, 4);
    }
    return c;
}

static void colour_of(const colours *c, uint16_t bits, uint8_t rgba[4]) {
    memcpy(rgba, c->whole, 4);
    if ((bits >> 15 != 0) == c->materialise) return;
    for (int k = 0; k < 3; k++) {
        int v = bits >> 5 * (c->materialise ? k : 2 - k) & 31;
        rgba[k] = (uint8_t)(v << 3 | v >> 2);
    }
    rgba[3] = 255;
}

static void middle(const pbs_box *box, double origin[3]) {
    for (int k = 0; k < 3; k++)
        origin[k] = pbs_box_is_empty(box) ? 0 : box->min[k] / 2 + box->max[k] / 2;
}

static void add_corner(pbs_box *box, const double v[3]) {
    if ((v[0] + v[1] + v[2]) * 0 == 0) pbs_box_add(box, v);
}

static pbs_code check(const stl *s, uint64_t i, pbs_err *err) {
    if (i % PBS_CHECK_EVERY) return PBS_OK;
    pbs_trim_now(&s->trim);
    pbs_run_progress(s->run, "reading", (uint64_t)(s->p - s->file), (uint64_t)(s->end - s->file));
    return pbs_run_check(s->run, err);
}

/* The first corner of every triangle tells where they are; and whether any has a colour. */
static pbs_code survey_binary(stl *s, uint32_t n, double origin[3], colours *c, pbs_err *err) {
    pbs_box box = PBS_BOX_EMPTY;
    pbs_code rc = PBS_OK;
    for (uint32_t i = 0; i < n && !rc; i++) {
        const char *record = s->file + HEAD + (size_t)RECORD * i;
        double v[3];
        get_corner(record + 12, v);
        add_corner(&box, v);
        c->any |= get16(record + 48) >> 15;
        rc = check(s, i, err);
    }
    middle(&box, origin);
    return rc;
}

static pbs_code read_binary(stl *s, uint32_t n, pbs_err *err) {
    const pbs_sink *sink = s->faces.sink;
    colours c = colours_of(s);
    double origin[3];
    pbs_code rc = survey_binary(s, n, origin, &c, err);
    if (!rc) rc = sink->part_begin(sink->ctx, s->stem, origin, c.any ? PBS_CORNER_COLOUR : 0, err);
    pbs_corner corner[3];
    memset(corner, 0, sizeof corner);
    for (uint32_t i = 0; i < n && !rc; i++) {
        s->p = s->file + HEAD + (size_t)RECORD * i;
        for (int k = 0; k < 3; k++) {
            get_corner(s->p + 12 * (k + 1), corner[k].position);
            if (c.any) colour_of(&c, get16(s->p + 48), corner[k].colour);
        }
        rc = check(s, i, err);
        if (!rc) rc = sink->triangle(sink->ctx, corner, PBS_NONE, err);
    }
    return rc ? rc : pbs_faces_part_end(&s->faces, err);
}

static pbs_code import_binary(stl *s, size_t size, pbs_err *err) {
    if (size < HEAD)
        return pbs_fail(err, PBS_DATA, "is neither ascii STL nor long enough for a binary one");
    uint32_t n = get32(s->file + 80);
    if (size != HEAD + (uint64_t)RECORD * n)
        return pbs_fail(err, PBS_DATA, "promises %u triangles, but has room for %.2f", n,
                        (double)(size - HEAD) / RECORD);
    if (!n) return pbs_fail(err, PBS_DATA, "has no triangles");
    return read_binary(s, n, err);
}

/* ---- ascii ---- */

static pbs_code unexpected(stl *s, pbs_span word, const char *wanted, pbs_err *err) {
    char name[PBS_NAME_MAX];
    pbs_text_name(name, word);
    s->p = word.p;
    if (word.p == word.end)
        return pbs_fail(err, PBS_DATA, "the file ends where %s should follow", wanted);
    return pbs_fail(err, PBS_DATA, "\"%.40s\" where %s should follow", name, wanted);
}

static pbs_code expect(stl *s, const char *what, pbs_err *err) {
    pbs_span word = pbs_text_word(&s->p, s->end);
    return pbs_text_is(word, what) ? PBS_OK : unexpected(s, word, what, err);
}

static pbs_code read_vertex(stl *s, double v[3], pbs_err *err) {
    for (int k = 0; k < 3; k++) {
        pbs_span word = pbs_text_word(&s->p, s->end);
        const char *p = word.p;
        if (!pbs_text_double(&p, word.end, &v[k]) || p != word.end)
            return unexpected(s, word, "a number", err);
    }
    return PBS_OK;
}

/* Behind "facet": a normal, then the loop. It should have three corners; polygons are cut. */
static pbs_code read_facet(stl *s, pbs_err *err) {
    pbs_span word = pbs_text_word(&s->p, s->end);
    if (pbs_text_is(word, "normal"))
        for (int k = 0; k < 4; k++) word = pbs_text_word(&s->p, s->end);
    if (!pbs_text_is(word, "outer")) return unexpected(s, word, "outer loop", err);
    pbs_code rc = expect(s, "loop", err);
    size_t n = 0;
    while (!rc) {
        word = pbs_text_word(&s->p, s->end);
        if (pbs_text_is(word, "endloop")) break;
        if (!pbs_text_is(word, "vertex")) return unexpected(s, word, "vertex or endloop", err);
        if (n >= s->faces.corners) rc = pbs_faces_reserve(&s->faces, n + 3, err);
        if (rc) break;
        memset(&s->faces.corner[n], 0, sizeof *s->faces.corner);
        rc = read_vertex(s, s->faces.corner[n++].position, err);
    }
    if (!rc) rc = expect(s, "endfacet", err);
    return rc ? rc : pbs_faces_polygon(&s->faces, n, PBS_NONE, err);
}

/* Where a solid is: some of its corners are enough, the first ones and then every 16th. Words, not
 * lines: a file that is one long line is looked at once, too. */
static void survey_ascii(const stl *s, double origin[3]) {
    pbs_box box = PBS_BOX_EMPTY;
    const char *p = s->p;
    for (uint64_t n = 0;;) {
        pbs_span word = pbs_text_word(&p, s->end);
        if (word.p == word.end || pbs_text_is(word, "endsolid")) break;
        if (!pbs_text_is(word, "vertex") || (n++ >= 256 && n % 16)) continue;
        if (n % PBS_CHECK_EVERY == 0) pbs_trim_now(&s->trim);
        double v[3];
        int got = 0;
        for (const char *q = p; got < 3; got++) {
            q = pbs_text_skip_blank(q, s->end);
            if (!pbs_text_double(&q, s->end, &v[got])) break;
        }
        if (got == 3) add_corner(&box, v);
    }
    middle(&box, origin);
}

static pbs_span rest_of_line(stl *s) {
    const char *e = s->p;
    while (e < s->end && *e != '\n' && *e != '\r') e++;
    pbs_span rest = {s->p, e};
    s->p = e;
    return rest;
}

/* Behind "solid". */
static pbs_code read_solid(stl *s, pbs_err *err) {
    const pbs_sink *sink = s->faces.sink;
    char name[PBS_NAME_MAX];
    double origin[3];
    pbs_text_name(name, rest_of_line(s));
    survey_ascii(s, origin);
    pbs_code rc = sink->part_begin(sink->ctx, *name ? name : s->stem, origin, 0, err);
    while (!rc) {
        pbs_span word = pbs_text_word(&s->p, s->end);
        if (pbs_text_is(word, "endsolid")) break;
        if (!pbs_text_is(word, "facet")) return unexpected(s, word, "facet or endsolid", err);
        rc = read_facet(s, err);
        if (!rc) rc = check(s, ++s->number, err);
    }
    if (rc) return rc;
    rest_of_line(s);
    return pbs_faces_part_end(&s->faces, err);
}

static pbs_code import_ascii(stl *s, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (;;) {
        pbs_span word = pbs_text_word(&s->p, s->end);
        if (word.p == word.end) break;
        if (!pbs_text_is(word, "solid")) rc = unexpected(s, word, "solid", err);
        if (!rc) rc = read_solid(s, err);
        if (rc == PBS_DATA)
            pbs_fail_in(err, "line %llu", (unsigned long long)pbs_text_line(s->file, s->p));
        if (rc) return rc;
    }
    return s->number ? PBS_OK : pbs_fail(err, PBS_DATA, "has no triangles");
}

static bool is_ascii(const stl *s, size_t size) {
    if (size >= HEAD && size == HEAD + (uint64_t)RECORD * get32(s->file + 80)) return false;
    if (memchr(s->file, 0, size < 512 ? size : 512)) return false;
    const char *p = s->p;
    return pbs_text_is(pbs_text_word(&p, s->end), "solid");
}

pbs_code pbs_import_stl(const char *path, const void *bytes, size_t size, const pbs_sink *sink,
                        pbs_err *err) {
    char stem[PBS_NAME_MAX];
    pbs_file_stem(stem, path);
    stl s = {.file = bytes, .p = bytes, .end = bytes, .stem = stem, .run = sink->run};
    s.end += size;
    s.faces.sink = sink;
    if (!size) return pbs_fail(err, PBS_DATA, "is empty");
    pbs_trim_open(s.run, &s.trim);
    if (sink->mapped) pbs_trim_add(&s.trim, bytes, size);
    pbs_code rc = is_ascii(&s, size) ? import_ascii(&s, err) : import_binary(&s, size, err);
    if (!rc) rc = pbs_faces_root(&s.faces, stem, err);
    pbs_trim_close(&s.trim);
    pbs_faces_free(&s.faces);
    return rc;
}
