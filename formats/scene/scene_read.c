/* scene_read.c: a scene stream, mapped and checked; any scene file opened as one. */
#include "formats/scene/meshbuild.h"
#include "formats/scene/scene.h"
#include "formats/scene/scene_wire.h"
#include "formats/container/wire.h"
#include <stdio.h>
#include <string.h>

typedef struct caps {
    size_t nodes, first, meshes, materials, textures;
} caps;

static pbs_code damaged(const pbs_scene *s, const char *what, uint32_t id, pbs_err *err) {
    return pbs_fail(err, PBS_DATA, "%s: %s %u is damaged", pbs_reader_name(s->reader), what, id);
}

static pbs_code copy_name(pbs_run *run, const void *bytes, size_t n, const char **out,
                          pbs_err *err) {
    char *copy;
    pbs_code rc = pbs_alloc(run, &copy, n + 1, 1, "a name", err);
    if (rc) return rc;
    if (n) memcpy(copy, bytes, n);
    copy[n] = 0;
    *out = copy;
    return PBS_OK;
}

bool pbs_texture_parse(const pbs_chunk *c) {
    const uint8_t *p = c->payload;
    return c->bytes >= TEXTURE_FIXED && pbs_get_u32(p) <= c->bytes - TEXTURE_FIXED;
}

static pbs_code add_texture(pbs_scene *s, caps *cap, const pbs_chunk *c, pbs_err *err) {
    const uint8_t *p = c->payload;
    if (c->node != s->texture_count || !pbs_texture_parse(c))
        return damaged(s, "texture", c->node, err);
    pbs_code rc = pbs_grow(s->run, &s->textures, &cap->textures, s->texture_count + 1,
                           sizeof *s->textures, "the textures", err);
    if (rc) return rc;
    pbs_texture *t = &s->textures[s->texture_count];
    size_t n = pbs_get_u32(p);
    *t = (pbs_texture){NULL, p + TEXTURE_FIXED + n, (size_t)c->bytes - TEXTURE_FIXED - n};
    rc = copy_name(s->run, p + TEXTURE_FIXED, n, &t->name, err);
    s->texture_count += !rc;
    return rc;
}

static bool get_floats(const uint8_t *p, float *v, int n) {
    bool ok = true;
    for (int i = 0; i < n; i++) {
        v[i] = pbs_get_f32(p + 4 * i);
        ok = ok && isfinite(v[i]);
    }
    return ok;
}

static bool get_use(const uint8_t *p, size_t textures, pbs_texture_use *u) {
    u->texture = pbs_get_u32(p);
    u->wrap_u = p[4];
    u->wrap_v = p[5];
    return get_floats(p + 8, u->transform, 6) && u->wrap_u < 3 && u->wrap_v < 3 &&
           (u->texture == PBS_NONE || u->texture < textures);
}

bool pbs_material_parse(const pbs_chunk *c, size_t textures, pbs_material *m) {
    const uint8_t *p = c->payload;
    *m = PBS_MATERIAL_DEFAULT;
    if (c->bytes < MATERIAL_FIXED || pbs_get_u32(p + MATERIAL_NAME_AT) != c->bytes - MATERIAL_FIXED)
        return false;
    bool ok = get_floats(p, m->base, 4) & get_floats(p + 16, m->emissive, 3) &
              get_floats(p + 28, &m->metallic, 1) & get_floats(p + 32, &m->roughness, 1) &
              get_floats(p + 36, &m->alpha_cutoff, 1);
    m->alpha = p[40];
    m->double_sided = p[41];
    const uint8_t *u = p + MATERIAL_USES_AT;
    return ok && m->alpha <= PBS_ALPHA_BLEND && get_use(u, textures, &m->base_texture) &&
           get_use(u + USE_FIXED, textures, &m->material_texture) &&
           get_use(u + 2 * USE_FIXED, textures, &m->emissive_texture);
}

static pbs_code add_material(pbs_scene *s, caps *cap, const pbs_chunk *c, pbs_err *err) {
    const uint8_t *p = c->payload;
    if (c->node != s->material_count) return damaged(s, "material", c->node, err);
    pbs_code rc = pbs_grow(s->run, &s->materials, &cap->materials, s->material_count + 1,
                           sizeof *s->materials, "the materials", err);
    if (rc) return rc;
    pbs_material *m = &s->materials[s->material_count];
    if (!pbs_material_parse(c, s->texture_count, m)) return damaged(s, "material", c->node, err);
    rc = copy_name(s->run, p + MATERIAL_FIXED, (size_t)c->bytes - MATERIAL_FIXED, &m->name, err);
    s->material_count += !rc;
    return rc;
}

bool pbs_mesh_materials_fit(const pbs_mesh *m, size_t materials) {
    if (m->material != PBS_NONE && m->material >= materials) return false;
    for (uint32_t i = 0; m->triangle_material && i < m->triangles; i++)
        if (m->triangle_material[i] != PBS_NONE && m->triangle_material[i] >= materials)
            return false;
    return true;
}

/* What candidates of these materials can carry. */
static uint32_t channels_of(const pbs_material *m) {
    uint32_t c = 0;
    bool white = m->base[0] == 1 && m->base[1] == 1 && m->base[2] == 1 && m->base[3] == 1;
    if (!white || m->base_texture.texture != PBS_NONE) c |= PBS_COLOUR;
    if (m->metallic != 0 || m->roughness != 1 || m->material_texture.texture != PBS_NONE)
        c |= PBS_MATERIAL;
    if (m->emissive[0] > 0 || m->emissive[1] > 0 || m->emissive[2] > 0 ||
        m->emissive_texture.texture != PBS_NONE)
        c |= PBS_EMISSIVE;
    return c;
}

static void note_channels(pbs_scene *s, const pbs_mesh *m) {
    if (m->colour) s->channels |= PBS_COLOUR;
    if (m->material != PBS_NONE) s->channels |= channels_of(&s->materials[m->material]);
    for (uint32_t i = 0; m->triangle_material && i < m->triangles; i++)
        if (m->triangle_material[i] != PBS_NONE)
            s->channels |= channels_of(&s->materials[m->triangle_material[i]]);
}

static pbs_code add_mesh(pbs_scene *s, caps *cap, const pbs_chunk *c, pbs_err *err) {
    if (c->node != s->node_count) return damaged(s, "mesh of node", c->node, err);
    pbs_code rc = pbs_grow(s->run, &s->meshes, &cap->meshes, s->mesh_count + 1, sizeof *s->meshes,
                           "the table of meshes", err);
    if (rc) return rc;
    pbs_mesh *m = &s->meshes[s->mesh_count];
    rc = pbs_mesh_parse(pbs_reader_name(s->reader), c, m, err);
    if (rc) return rc;
    if (!pbs_mesh_materials_fit(m, s->material_count))
        return damaged(s, "mesh of node", c->node, err);
    note_channels(s, m);
    s->mesh_count++;
    return PBS_OK;
}

static pbs_code add_node(pbs_scene *s, caps *cap, const pbs_chunk *c, pbs_err *err) {
    pbs_code rc = pbs_grow(s->run, &s->nodes, &cap->nodes, s->node_count + 1, sizeof *s->nodes,
                           "the table of nodes", err);
    if (!rc)
        rc = pbs_grow(s->run, &s->first_mesh, &cap->first, s->node_count + 2, sizeof *s->first_mesh,
                      "the table of nodes", err);
    if (!rc)
        rc = pbs_node_read(s->run, pbs_reader_name(s->reader), c, (uint32_t)s->node_count,
                           &s->nodes[s->node_count], err);
    if (rc) return rc;
    if (!s->node_count) s->first_mesh[0] = 0;
    s->first_mesh[++s->node_count] = s->mesh_count;
    return PBS_OK;
}

static void add_counts(pbs_scene *s, const pbs_chunk *c) {
    const uint8_t *p = c->payload;
    for (uint64_t i = 0; i < c->bytes / 8 && i < PBS_SKIP_KINDS; i++)
        s->skipped[i] += pbs_get_u64(p + 8 * i);
}

static pbs_code read_all(pbs_scene *s, pbs_err *err) {
    caps cap = {0};
    for (;;) {
        pbs_chunk c;
        bool end;
        pbs_code rc = pbs_reader_next(s->reader, &c, &end, err);
        if (rc || end) return rc;
        if (c.tag == PBS_TAG_TEXTURE)
            rc = add_texture(s, &cap, &c, err);
        else if (c.tag == PBS_TAG_MATERIAL)
            rc = add_material(s, &cap, &c, err);
        else if (c.tag == PBS_TAG_MESH)
            rc = add_mesh(s, &cap, &c, err);
        else if (c.tag == PBS_TAG_NODE)
            rc = add_node(s, &cap, &c, err);
        else if (pbs_is_motion(c.tag))
            rc = pbs_motions_take(s->run, pbs_reader_name(s->reader), &c, &s->motions, err);
        else if (c.tag == PBS_TAG_COUNTS)
            add_counts(s, &c);
        if (rc) return rc;
    }
}

static pbs_code open_stream(pbs_scene *s, pbs_input *in, pbs_err *err) {
    pbs_code rc = pbs_input_map(in, err);
    if (rc) {
        pbs_input_close(in);
        return rc;
    }
    rc = pbs_reader_open(s->run, in, PBS_KIND(PBS_SCENE), &s->reader, err);
    if (!rc) rc = read_all(s, err);
    if (!rc && !s->node_count)
        rc = pbs_fail(err, PBS_DATA, "%s: a scene without nodes", pbs_reader_name(s->reader));
    if (!rc)
        rc = pbs_motions_fit(pbs_reader_name(s->reader), &s->motions, s->nodes, s->node_count, err);
    return rc;
}

/* ---- foreign files: import to a spool, open that ---- */

static pbs_code import_spool(pbs_run *run, pbs_input *in, const char *path,
                             const pbs_scene_options *options, pbs_input *scene, pbs_err *err) {
    pbs_output spool;
    pbs_writer *w = NULL;
    pbs_scene_writer *sw = NULL;
    char stage[600];
    snprintf(stage, sizeof stage, "pbs-import %s%s%s",
             options->ignore_missing ? "--ignore-missing " : "",
             options->failed ? "--keep-going " : "", pbs_base_name(in->name));
    pbs_code rc = pbs_output_spool(run, &spool, err);
    if (rc) return rc;
    rc = pbs_writer_open(
        run, &(pbs_writer_desc){.output = &spool, .kind = PBS_SCENE, .stage = stage}, &w, err);
    if (!rc) rc = pbs_scene_writer_new(run, w, options, &sw, err);
    if (!rc) rc = pbs_import_input(in, path, pbs_scene_sink(sw), err);
    if (!rc && (rc = pbs_scene_writer_end(sw, err))) pbs_fail_in(err, "%s", in->name);
    pbs_scene_writer_free(sw);
    if (!rc) rc = pbs_writer_reopen(w, scene, err);
    if (!rc) memcpy(scene->name, in->name, sizeof scene->name);
    pbs_writer_close(w);
    return rc;
}

pbs_code pbs_scene_open_input(pbs_run *run, pbs_input *in, const char *path,
                              const pbs_scene_options *options, pbs_scene *s, pbs_err *err) {
    memset(s, 0, sizeof *s);
    s->run = run;
    s->options = options ? *options : PBS_SCENE_DEFAULTS;
    s->channels = PBS_NORMAL;
    pbs_input scene;
    const uint8_t *head;
    size_t n;
    pbs_code rc = pbs_input_peek(in, &head, &n, err);
    if (!rc && !pbs_is_container(head, n)) {
        rc = import_spool(run, in, path, &s->options, &scene, err);
        pbs_input_close(in);
        if (!rc) *in = scene;
    }
    if (rc)
        pbs_input_close(in);
    else
        rc = open_stream(s, in, err);
    if (rc) pbs_scene_close(s);
    return rc;
}

pbs_code pbs_scene_open(pbs_run *run, const char *path, const pbs_scene_options *options,
                        pbs_scene *s, pbs_err *err) {
    pbs_input in;
    memset(s, 0, sizeof *s);
    pbs_code rc = pbs_input_open(run, path, &in, err);
    return rc ? rc : pbs_scene_open_input(run, &in, path, options, s, err);
}

const char *pbs_scene_history(const pbs_scene *s) {
    return pbs_reader_history(s->reader);
}

void pbs_scene_close(pbs_scene *s) {
    pbs_run *run = s->run;
    for (size_t i = 0; i < s->node_count; i++) pbs_node_free(run, &s->nodes[i]);
    for (size_t i = 0; i < s->material_count; i++) pbs_free(run, (void *)s->materials[i].name);
    for (size_t i = 0; i < s->texture_count; i++) pbs_free(run, (void *)s->textures[i].name);
    pbs_free(run, s->nodes);
    pbs_free(run, s->first_mesh);
    pbs_free(run, s->meshes);
    pbs_free(run, s->materials);
    pbs_free(run, s->textures);
    pbs_motions_free(run, &s->motions);
    pbs_reader_close(s->reader);
    memset(s, 0, sizeof *s);
}
