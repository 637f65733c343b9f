/* Wavefront material libraries. What the format says and what programs write differ in places;
 * the decisions:
 *
 * - Kd and Ke are taken for sRGB values, as all programs show them.
 * - map_Kd multiplies Kd, except that a black Kd counts as white: many exporters write black when
 *   there is a texture.
 * - d wins over Tr = 1 - d, if both are there.
 * - Pm and Pr (metallic, roughness) are the usual extension; Ka, Ks, Ns and map_d are ignored.
 */
#include "formats/readers/mtl.h"
#include "formats/container/file.h"
#include <stdio.h>
#include <sys/stat.h>

/* ---- names ---- */

static uint32_t hash_of(const char *p, size_t n) {
    uint32_t h = 2166136261u;
    for (size_t i = 0; i < n; i++) h = (h ^ (unsigned char)p[i]) * 16777619u;
    return h;
}

static struct pbs_name *find(const pbs_names *t, const char *p, size_t n) {
    uint32_t h = hash_of(p, n);
    for (size_t i = h; t->slots; i++) {
        uint32_t e = t->slot[i & (t->slots - 1)];
        if (!e) break;
        struct pbs_name *x = &t->entry[e - 1];
        if (x->hash == h && x->length == n && (!n || !memcmp(t->text + x->text, p, n))) return x;
    }
    return NULL;
}

static void put_in_slot(pbs_names *t, size_t e) {
    size_t i = t->entry[e].hash & (t->slots - 1);
    while (t->slot[i]) i = (i + 1) & (t->slots - 1);
    t->slot[i] = (uint32_t)e + 1;
}

static pbs_code more_slots(pbs_run *run, pbs_names *t, pbs_err *err) {
    uint32_t *slot;
    size_t slots = t->slots ? 2 * t->slots : 64;
    pbs_code rc = pbs_alloc(run, &slot, slots, sizeof *slot, "a table of names", err);
    if (rc) return rc;
    memset(slot, 0, slots * sizeof *slot);
    pbs_free(run, t->slot);
    t->slot = slot, t->slots = slots;
    for (size_t e = 0; e < t->count; e++) put_in_slot(t, e);
    return PBS_OK;
}

/* A name that is there already gets the new id. */
static pbs_code set(pbs_run *run, pbs_names *t, pbs_span name, uint32_t id, pbs_err *err) {
    size_t n = (size_t)(name.end - name.p);
    struct pbs_name *x = find(t, name.p, n);
    if (x) {
        x->id = id;
        return PBS_OK;
    }
    pbs_code rc =
        pbs_grow(run, &t->entry, &t->room, t->count + 1, sizeof *t->entry, "a table of names", err);
    if (!rc)
        rc = pbs_grow(run, &t->text, &t->text_room, t->text_used + n, 1, "a table of names", err);
    if (!rc && 2 * (t->count + 1) > t->slots) rc = more_slots(run, t, err);
    if (rc) return rc;
    if (n) memcpy(t->text + t->text_used, name.p, n);
    t->entry[t->count] = (struct pbs_name){t->text_used, n, id, hash_of(name.p, n)};
    t->text_used += n;
    put_in_slot(t, t->count++);
    return PBS_OK;
}

static void free_names(pbs_run *run, pbs_names *t) {
    pbs_free(run, t->entry);
    pbs_free(run, t->text);
    pbs_free(run, t->slot);
}

void pbs_mtl_free(pbs_mtl *m) {
    free_names(m->sink->run, &m->materials);
    free_names(m->sink->run, &m->textures);
    free_names(m->sink->run, &m->libraries);
}

static pbs_span trim(pbs_span s) {
    s.p = pbs_text_skip_blank(s.p, s.end);
    while (s.p < s.end && pbs_text_is_blank(s.end[-1])) s.end--;
    return s;
}

uint32_t pbs_mtl_find(const pbs_mtl *m, pbs_span name) {
    name = trim(name);
    const struct pbs_name *x = find(&m->materials, name.p, (size_t)(name.end - name.p));
    return x ? x->id : PBS_NONE;
}

/* ---- files beside ---- */

typedef struct place {
    char path[4096];
} place;

/* Is there such a file? A pipe or a device is not one: opening it could wait for ever. */
static bool locate(place *at, const char *beside, pbs_span name) {
    const char *slash = strrchr(beside, '/');
    size_t folder = slash ? (size_t)(slash + 1 - beside) : 0, n = (size_t)(name.end - name.p);
    if (n && (*name.p == '/' || *name.p == '\\')) folder = 0;
    if (!n || folder + n >= sizeof at->path || memchr(name.p, 0, n)) return false;
    memcpy(at->path, beside, folder);
    memcpy(at->path + folder, name.p, n);
    at->path[folder + n] = 0;
    for (char *c = at->path + folder; *c; c++)
        if (*c == '\\') *c = '/';
    struct stat st;
    return !stat(at->path, &st) && S_ISREG(st.st_mode);
}

static pbs_code send_texture(pbs_mtl *m, const char *path, pbs_span name, uint32_t *id,
                             pbs_err *err) {
    const uint8_t *bytes;
    size_t size;
    pbs_run_opened(m->sink->run, path);
    pbs_code rc = pbs_map_file(path, &bytes, &size, err);
    if (rc) return rc;
    char label[PBS_NAME_MAX];
    pbs_text_name(label, name);
    rc = m->sink->texture(m->sink->ctx, label, bytes, size, id, err);
    pbs_unmap_file(bytes, size);
    return rc;
}

static pbs_code send_missing(const pbs_mtl *m, pbs_span name, uint32_t *id, pbs_err *err) {
    char label[PBS_NAME_MAX];
    pbs_text_name(label, name);
    return m->sink->missing(m->sink->ctx, label, id, err);
}

pbs_code pbs_mtl_texture(pbs_mtl *m, pbs_span name, const char *other, uint32_t *id, pbs_err *err) {
    name = trim(name);
    const struct pbs_name *x = find(&m->textures, name.p, (size_t)(name.end - name.p));
    if (x) {
        *id = x->id;
        return PBS_OK;
    }
    place at;
    pbs_code rc;
    if (locate(&at, m->path, name) || (other && locate(&at, other, name)))
        rc = send_texture(m, at.path, name, id, err);
    else
        rc = send_missing(m, name, id, err);
    return rc ? rc : set(m->sink->run, &m->textures, name, *id, err);
}

/* ---- the library ---- */

typedef struct texture_map {
    pbs_span name; /* empty: there is none */
    double scale[2], offset[2];
    bool clamp;
} texture_map;

typedef struct library {
    pbs_mtl *mtl;
    const char *path; /* of the library */
    bool open;        /* a newmtl has been seen */
    pbs_span name;
    double kd[3], ke[3], d, tr, metallic, roughness;
    bool has_d, has_ke;
    texture_map base, emissive;
} library;

static bool is_black(const double v[3]) {
    return v[0] == 0 && v[1] == 0 && v[2] == 0;
}

static pbs_code use_texture(library *l, const texture_map *map, pbs_texture_use *use,
                            pbs_err *err) {
    *use = PBS_TEXTURE_NONE;
    if (map->name.p == map->name.end) return PBS_OK;
    use->wrap_u = use->wrap_v = map->clamp;
    /* v' = s v + o with v upwards is v' = s v + (1 - s - o) with v downwards */
    use->transform[0] = (float)map->scale[0];
    use->transform[2] = (float)map->offset[0];
    use->transform[4] = (float)map->scale[1];
    use->transform[5] = (float)(1 - map->scale[1] - map->offset[1]);
    return pbs_mtl_texture(l->mtl, map->name, l->path, &use->texture, err);
}

static float clamp01(double v) {
    return v >= 1 ? 1 : v > 0 ? (float)v : 0;
}

static pbs_code end_material(library *l, pbs_err *err) {
    if (!l->open) return PBS_OK;
    pbs_material m = PBS_MATERIAL_DEFAULT;
    char name[PBS_NAME_MAX];
    pbs_text_name(name, l->name);
    m.name = name;
    pbs_code rc = use_texture(l, &l->base, &m.base_texture, err);
    if (!rc) rc = use_texture(l, &l->emissive, &m.emissive_texture, err);
    if (rc) return rc;
    bool white = is_black(l->kd) && m.base_texture.texture != PBS_NONE;
    bool shine = m.emissive_texture.texture != PBS_NONE && (!l->has_ke || is_black(l->ke));
    for (int k = 0; k < 3; k++) {
        m.base[k] = white ? 1 : pbs_srgb_to_linear(clamp01(l->kd[k]));
        m.emissive[k] = shine                            ? 1
                        : l->ke[k] > 0 && l->ke[k] < 1e9 ? pbs_srgb_to_linear((float)l->ke[k])
                                                         : 0;
    }
    m.base[3] = clamp01(l->has_d ? l->d : 1 - l->tr);
    if (m.base[3] < 1) m.alpha = PBS_ALPHA_BLEND;
    m.metallic = clamp01(l->metallic);
    m.roughness = clamp01(l->roughness);
    uint32_t id;
    rc = l->mtl->sink->material(l->mtl->sink->ctx, &m, &id, err);
    return rc ? rc : set(l->mtl->sink->run, &l->mtl->materials, l->name, id, err);
}

static void begin_material(library *l, pbs_span name) {
    *l = (library){.mtl = l->mtl,
                   .path = l->path,
                   .open = true,
                   .name = trim(name),
                   .d = 1,
                   .kd = {1, 1, 1},
                   .roughness = 1};
}

/* One number stands for all three. Spectral curves and CIE colours are rare and stay unread. */
static pbs_code read_colour(pbs_span rest, double v[3], pbs_err *err) {
    const char *p = rest.p;
    pbs_span word = pbs_text_word(&p, rest.end);
    if (pbs_text_is(word, "spectral") || pbs_text_is(word, "xyz")) return PBS_OK;
    double in[3];
    int n;
    pbs_code rc = pbs_text_numbers(rest, in, 3, &n, err);
    for (int k = 0; k < 3 && n && !rc; k++) v[k] = in[k < n ? k : 0];
    return rc;
}

static pbs_code read_one(pbs_span rest, double *v, pbs_err *err) {
    int n;
    double in;
    pbs_code rc = pbs_text_numbers(rest, &in, 1, &n, err);
    if (!rc && n) *v = in;
    return rc;
}

/* Up to three numbers behind an option; the last word of the line is the file's name, even if it
 * looks like a number. */
static const char *option_numbers(const char *p, const char *end, double v[2]) {
    for (int k = 0; k < 3; k++) {
        const char *q = p;
        pbs_span word = pbs_text_word(&q, end);
        const char *s = word.p;
        double x;
        if (pbs_text_skip_blank(q, end) == end || !pbs_text_double(&s, word.end, &x) ||
            s != word.end || !(fabs(x) < 1e9))
            break;
        if (v && k < 2) v[k] = x;
        p = q;
    }
    return p;
}

static void read_map(pbs_span rest, texture_map *m) {
    *m = (texture_map){.scale = {1, 1}};
    const char *p = pbs_text_skip_blank(rest.p, rest.end);
    while (p < rest.end && *p == '-') {
        const char *q = p;
        pbs_span word = pbs_text_word(&q, rest.end);
        if (pbs_text_skip_blank(q, rest.end) == rest.end) break; /* a name that begins with - */
        if (pbs_text_is(word, "-s"))
            q = option_numbers(q, rest.end, m->scale);
        else if (pbs_text_is(word, "-o"))
            q = option_numbers(q, rest.end, m->offset);
        else if (pbs_text_is(word, "-t") || pbs_text_is(word, "-mm"))
            q = option_numbers(q, rest.end, NULL);
        else {
            pbs_span value = pbs_text_word(&q, rest.end);
            if (pbs_text_is(word, "-clamp")) m->clamp = pbs_text_is(value, "on");
        }
        p = pbs_text_skip_blank(q, rest.end);
    }
    m->name = trim((pbs_span){p, rest.end});
}

static pbs_code read_opacity(library *l, pbs_span rest, pbs_err *err) {
    const char *p = rest.p;
    if (pbs_text_is(pbs_text_word(&p, rest.end), "-halo")) rest.p = p;
    l->has_d = true;
    return read_one(rest, &l->d, err);
}

static pbs_code read_line(library *l, pbs_span line, pbs_err *err) {
    const char *p = line.p;
    pbs_span key = pbs_text_word(&p, line.end), rest = {p, line.end};
    if (pbs_text_is(key, "newmtl")) {
        pbs_code rc = end_material(l, err);
        begin_material(l, rest);
        return rc;
    }
    if (pbs_text_is(key, "Kd")) return read_colour(rest, l->kd, err);
    if (pbs_text_is(key, "Ke")) {
        l->has_ke = true;
        return read_colour(rest, l->ke, err);
    }
    if (pbs_text_is(key, "d")) return read_opacity(l, rest, err);
    if (pbs_text_is(key, "Tr")) return read_one(rest, &l->tr, err);
    if (pbs_text_is(key, "Pm")) return read_one(rest, &l->metallic, err);
    if (pbs_text_is(key, "Pr")) return read_one(rest, &l->roughness, err);
    if (pbs_text_is(key, "map_Kd"))
        read_map(rest, &l->base);
    else if (pbs_text_is(key, "map_Ke"))
        read_map(rest, &l->emissive);
    return PBS_OK;
}

static pbs_code read_library(pbs_mtl *m, const char *path, pbs_err *err) {
    const uint8_t *bytes;
    size_t size;
    pbs_run_opened(m->sink->run, path);
    pbs_code rc = pbs_map_file(path, &bytes, &size, err);
    if (rc) return rc;
    library l = {.mtl = m, .path = path};
    pbs_lines lines = pbs_lines_of(bytes, size);
    pbs_span line = {lines.p, lines.p};
    while (!rc && pbs_lines_next(&lines, &line)) {
        rc = read_line(&l, line, err);
        if (!rc) rc = pbs_run_check(m->sink->run, err);
    }
    if (!rc) rc = end_material(&l, err);
    if (rc == PBS_DATA)
        pbs_fail_in(err, "%s: line %llu", path,
                    (unsigned long long)pbs_text_line((const char *)bytes, line.p));
    pbs_unmap_file(bytes, size);
    return rc;
}

/* Once: some programs repeat the line in every group. */
static pbs_code load_one(pbs_mtl *m, const place *at, pbs_span name, pbs_err *err) {
    if (find(&m->libraries, name.p, (size_t)(name.end - name.p))) return PBS_OK;
    uint32_t id = PBS_NONE;
    pbs_code rc = at ? read_library(m, at->path, err) : send_missing(m, name, &id, err);
    return rc ? rc : set(m->sink->run, &m->libraries, name, id, err);
}

pbs_code pbs_mtl_load(pbs_mtl *m, pbs_span names, pbs_err *err) {
    names = trim(names);
    place at;
    if (locate(&at, m->path, names)) return load_one(m, &at, names, err);
    const char *p = names.p;
    pbs_code rc = PBS_OK;
    for (pbs_span name = pbs_text_word(&p, names.end); name.p < name.end && !rc;
         name = pbs_text_word(&p, names.end))
        rc = load_one(m, locate(&at, m->path, name) ? &at : NULL, name, err);
    return rc;
}
