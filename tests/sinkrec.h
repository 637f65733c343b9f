/* sinkrec.h: a sink that keeps everything a reader hands over, and checks the order of the calls.
 */
#ifndef PBS_SINKREC_H
#define PBS_SINKREC_H

#include "formats/readers/sink.h"
#include "tests/check.h"

typedef struct rec_triangle {
    pbs_corner corner[3];
    uint32_t material;
    size_t part;
} rec_triangle;

typedef struct rec_part {
    char name[64];
    double origin[3];
    uint32_t corners, node;
    size_t triangles;
} rec_part;

enum { REC_MAX = 64 };

typedef struct rec {
    pbs_run run;
    pbs_sink sink;
    pbs_err err;
    pbs_code code;
    rec_triangle *triangle;
    size_t triangles, room;
    rec_part part[REC_MAX];
    size_t parts;
    pbs_material material[REC_MAX];
    char material_name[REC_MAX][64];
    size_t materials;
    char texture[REC_MAX][64];
    size_t texture_size[REC_MAX], textures;
    char missing[REC_MAX][64];
    size_t missings;
    uint64_t skipped[PBS_SKIP_KINDS];
    uint32_t nodes, root, root_children;
    bool allow_missing, open, has_root, wrong; /* wrong: a call that is out of order */
} rec;

static pbs_code rec_texture(void *ctx, const char *name, const void *bytes, size_t size,
                            uint32_t *id, pbs_err *err) {
    rec *r = ctx;
    (void)bytes, (void)err;
    r->wrong |= r->open || r->textures == REC_MAX;
    snprintf(r->texture[r->textures], sizeof *r->texture, "%s", name);
    r->texture_size[r->textures] = size;
    *id = (uint32_t)r->textures++;
    return PBS_OK;
}

static pbs_code rec_missing(void *ctx, const char *name, uint32_t *id, pbs_err *err) {
    rec *r = ctx;
    snprintf(r->missing[r->missings++ % REC_MAX], sizeof *r->missing, "%s", name);
    *id = PBS_NONE;
    return r->allow_missing ? PBS_OK : pbs_fail(err, PBS_DATA, "%s: is missing", name);
}

static pbs_code rec_material(void *ctx, const pbs_material *m, uint32_t *id, pbs_err *err) {
    rec *r = ctx;
    (void)err;
    size_t at = r->materials % REC_MAX;
    r->wrong |= r->open;
    r->material[at] = *m;
    snprintf(r->material_name[at], sizeof *r->material_name, "%s", m->name ? m->name : "");
    r->material[at].name = r->material_name[at];
    *id = (uint32_t)r->materials++;
    return PBS_OK;
}

static pbs_code rec_part_begin(void *ctx, const char *name, const double origin[3],
                               uint32_t corners, pbs_err *err) {
    rec *r = ctx;
    (void)err;
    r->wrong |= r->open || r->has_root;
    r->open = true;
    rec_part *p = &r->part[r->parts % REC_MAX];
    memset(p, 0, sizeof *p);
    snprintf(p->name, sizeof p->name, "%s", name ? name : "");
    memcpy(p->origin, origin, sizeof p->origin);
    p->corners = corners;
    return PBS_OK;
}

static pbs_code rec_triangle_in(void *ctx, const pbs_corner corner[3], uint32_t material,
                                pbs_err *err) {
    rec *r = ctx;
    (void)err;
    r->wrong |= !r->open || (material != PBS_NONE && material >= r->materials);
    if (r->triangles == r->room) {
        r->room = 2 * r->room + 64;
        r->triangle = realloc(r->triangle, r->room * sizeof *r->triangle);
        if (!r->triangle) abort();
    }
    rec_triangle *t = &r->triangle[r->triangles++];
    memcpy(t->corner, corner, sizeof t->corner);
    t->material = material;
    t->part = r->parts;
    r->part[r->parts % REC_MAX].triangles++;
    return PBS_OK;
}

static pbs_code rec_part_end(void *ctx, uint32_t *node, pbs_err *err) {
    rec *r = ctx;
    (void)err;
    r->wrong |= !r->open;
    r->open = false;
    r->part[r->parts++ % REC_MAX].node = *node = r->nodes++;
    return PBS_OK;
}

static pbs_code rec_assembly(void *ctx, const char *name, const pbs_child *children, size_t count,
                             uint32_t *node, pbs_err *err) {
    rec *r = ctx;
    (void)name, (void)err;
    r->wrong |= r->open;
    for (size_t i = 0; i < count; i++) {
        r->wrong |= children[i].node >= r->nodes;
        r->wrong |= memcmp(children[i].m, PBS_IDENTITY, sizeof PBS_IDENTITY) != 0;
    }
    r->root_children = (uint32_t)count;
    *node = r->nodes++;
    return PBS_OK;
}

static pbs_code rec_root(void *ctx, uint32_t node, pbs_err *err) {
    rec *r = ctx;
    (void)err;
    r->wrong |= r->open || r->has_root || node >= r->nodes;
    r->has_root = true;
    r->root = node;
    return PBS_OK;
}

static void rec_skip(void *ctx, pbs_skip kind, uint64_t count) {
    ((rec *)ctx)->skipped[kind] += count;
}

static void rec_begin(rec *r) {
    memset(r, 0, sizeof *r);
    r->run.threads = 1;
    r->sink = (pbs_sink){r,
                         &r->run,
                         rec_texture,
                         rec_missing,
                         rec_material,
                         rec_part_begin,
                         rec_triangle_in,
                         rec_part_end,
                         rec_assembly,
                         rec_root,
                         rec_skip,
                         false,
                         NULL,
                         NULL,
                         NULL};
}

/* What must hold after any import: calls in order, all memory given back, a text with an error. */
static void rec_check(const rec *r) {
    CHECK(!r->wrong);
    CHECK_NUM(r->run.mem_used == 0, r->run.mem_used);
    CHECK(r->code ? r->err.text[0] && r->err.code == r->code : r->has_root && !r->open);
}

/* The bytes are copied to a block of exactly that size, so that a reader that looks behind the end
 * is caught. */
static void rec_import(rec *r, pbs_import_fn import, const char *path, const void *bytes,
                       size_t size) {
    char *copy = malloc(size ? size : 1);
    if (!copy) abort();
    if (size) memcpy(copy, bytes, size);
    r->code = import(path, copy, size, &r->sink, &r->err);
    free(copy);
    rec_check(r);
}

static void rec_end(rec *r) {
    free(r->triangle);
    r->triangle = NULL;
}

/* Twice the area, as a vector. */
static inline void rec_area_vector(const pbs_corner c[3], double a[3]) {
    double u[3], v[3];
    for (int k = 0; k < 3; k++) {
        u[k] = c[1].position[k] - c[0].position[k];
        v[k] = c[2].position[k] - c[0].position[k];
    }
    for (int k = 0; k < 3; k++)
        a[k] = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
}

/* The areas of all triangles of a part, or of all parts with SIZE_MAX. */
static inline double rec_area(const rec *r, size_t part) {
    double sum = 0, a[3];
    for (size_t i = 0; i < r->triangles; i++) {
        if (part != SIZE_MAX && r->triangle[i].part != part) continue;
        rec_area_vector(r->triangle[i].corner, a);
        sum += sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]) / 2;
    }
    return sum;
}

/* A whole file, or NULL; the caller frees it. */
static inline char *rec_file(const char *path, size_t *size) {
    FILE *f = fopen(path, "rb");
    if (!f) return NULL;
    fseek(f, 0, SEEK_END);
    long n = ftell(f);
    rewind(f);
    char *bytes = malloc(n > 0 ? (size_t)n : 1);
    *size = bytes && n > 0 ? fread(bytes, 1, (size_t)n, f) : 0;
    fclose(f);
    return bytes;
}
#endif
