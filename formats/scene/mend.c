#include "formats/scene/mend.h"
#include "formats/scene/meshbuild.h"
#include <string.h>

/* What opening it was seen to add to the process. */
#define MEND_BYTES ((size_t)4 << 20)

const char *const pbs_mend_count_name[PBS_MEND_COUNTS] = {
    "closed_before",        "closed_after",       "flipped",
    "duplicates",           "degenerate",         "nonmanifold_edges",
    "nonmanifold_vertices", "unorientable_edges", "holes",
    "holes_filled",         "filled_triangles",   "intersections",
    "normals_turned"};

typedef struct mender {
    const pbs_scene *scene;
    const pbs_module_mend *module;
    const pbs_mend_options *options;
    pbs_scene_writer *to;
    const pbs_sink *sink;
    pbs_mend_totals *totals;
    uint32_t *node; /* what the nodes of the scene are behind the writer */
    uint32_t *motion;
    uint64_t done; /* triangles */
} mender;

/* A part while it is being repaired. */
typedef struct part {
    const pbs_mesh *mesh;
    size_t meshes;
    uint32_t corners; /* PBS_CORNER_* */
    pbs_mend_job job;
    float *position;
} part;

/* ---- a part's triangles ---- */

static uint32_t corners_of(const pbs_mesh *mesh, size_t meshes) {
    uint32_t corners = 0;
    for (size_t i = 0; i < meshes; i++)
        corners |= (mesh[i].normal ? PBS_CORNER_NORMAL : 0u) | (mesh[i].uv ? PBS_CORNER_UV : 0u) |
                   (mesh[i].colour ? PBS_CORNER_COLOUR : 0u);
    return corners;
}

/* A mesh without colours is white where another of its part has some. */
static void stored(const part *p, const pbs_mesh *m, uint32_t t, pbs_vertex v[3], uint32_t *mat) {
    pbs_mesh_stored(m, t, p->corners, v, mat);
    for (int i = 0; i < 3 && !m->colour && p->corners & PBS_CORNER_COLOUR; i++)
        memset(v[i].colour, 255, sizeof v->colour);
}

/* Corner c of the whole part. */
static void stored_corner(const part *p, uint32_t c, pbs_vertex *out, uint32_t *material) {
    pbs_vertex v[3];
    const pbs_mesh *m = p->mesh;
    uint32_t t = c / 3;
    for (; t >= m->triangles; m++) t -= m->triangles;
    stored(p, m, t, v, material);
    *out = v[c % 3];
}

static void gather(const pbs_mesh *m, float *position) {
    for (size_t i = 0; i < 3 * (size_t)m->triangles; i++)
        memcpy(position + 3 * i, m->position + 3 * (size_t)m->index[i], 3 * sizeof *position);
}

/* ---- a part's triangles again ---- */

static void cross(const pbs_vertex v[3], double n[3]) {
    double a[3], b[3];
    for (int k = 0; k < 3; k++) {
        a[k] = (double)v[1].position[k] - v[0].position[k];
        b[k] = (double)v[2].position[k] - v[0].position[k];
    }
    for (int k = 0; k < 3; k++)
        n[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

/* Whether it had to. */
static bool turn_normals(pbs_vertex v[3]) {
    double face[3], sum = 0;
    float n[3][3];
    cross(v, face);
    for (int i = 0; i < 3; i++) {
        pbs_oct_decode(n[i], v[i].normal);
        for (int k = 0; k < 3; k++) sum += face[k] * n[i][k];
    }
    if (!(sum < 0)) return false;
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) n[i][k] = -n[i][k];
        pbs_oct_encode(v[i].normal, n[i]);
    }
    return true;
}

static pbs_code put(const mender *m, const part *p, pbs_vertex v[3], uint32_t material,
                    pbs_err *err) {
    if (p->corners & PBS_CORNER_NORMAL)
        m->totals->counts[PBS_MEND_NORMALS_TURNED] += turn_normals(v);
    return pbs_scene_stored(m->to, v, material, err);
}

static pbs_code put_mesh(const mender *m, const part *p, const pbs_mesh *mesh, const uint8_t *fate,
                         pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (uint32_t t = 0; t < mesh->triangles && !rc; t++) {
        pbs_vertex v[3];
        uint32_t material;
        if (fate[t] == PBS_MEND_DUPLICATE || fate[t] == PBS_MEND_DEGENERATE) continue;
        stored(p, mesh, t, v, &material);
        if (fate[t] == PBS_MEND_FLIPPED) {
            pbs_vertex swap = v[1];
            v[1] = v[2];
            v[2] = swap;
        }
        rc = put(m, p, v, material, err);
    }
    return rc;
}

/* A new triangle is flat: its corners get its own normal. The first one's triangle gives it the
 * material. */
static pbs_code put_filled(const mender *m, const part *p, const uint32_t corner[3], pbs_err *err) {
    pbs_vertex v[3];
    uint32_t material, other;
    double n[3];
    stored_corner(p, corner[0], &v[0], &material);
    stored_corner(p, corner[1], &v[1], &other);
    stored_corner(p, corner[2], &v[2], &other);
    cross(v, n);
    double most = fmax(fabs(n[0]), fmax(fabs(n[1]), fabs(n[2])));
    float f[3] = {0, 0, 0};
    for (int k = 0; k < 3 && most > 0; k++) f[k] = (float)(n[k] / most);
    for (int i = 0; i < 3 && p->corners & PBS_CORNER_NORMAL; i++) pbs_oct_encode(v[i].normal, f);
    return put(m, p, v, material, err);
}

static pbs_code put_part(mender *m, const pbs_node *n, part *p, uint32_t *id, pbs_err *err) {
    pbs_code rc = m->sink->part_begin(m->sink->ctx, n->name, n->origin, p->corners, err);
    const uint8_t *fate = p->job.fate;
    for (size_t i = 0; i < p->meshes && !rc; fate += p->mesh[i++].triangles)
        rc = put_mesh(m, p, &p->mesh[i], fate, err);
    for (uint32_t i = 0; i < p->job.filled_count && !rc; i++)
        rc = put_filled(m, p, p->job.filled + 3 * (size_t)i, err);
    return rc ? rc : m->sink->part_end(m->sink->ctx, id, err);
}

/* ---- parts ---- */

static pbs_code give_up(const mender *m, const pbs_node *n, part *p, pbs_err *err) {
    pbs_fail_in(err, "%s: part %u (%s)", pbs_reader_name(m->scene->reader), n->id, n->name);
    if (err->code != PBS_DATA || !m->options->failed) return err->code;
    m->options->failed(m->options->failed_ctx, err);
    memset(p->job.fate, PBS_MEND_KEPT, p->job.triangles);
    memset(p->job.counts, 0, sizeof p->job.counts);
    return PBS_OK;
}

static pbs_code mend(mender *m, const pbs_node *n, part *p, pbs_err *err) {
    pbs_run *run = m->scene->run;
    size_t need = p->job.triangles * (m->module->per_triangle + 9 * sizeof(float) + 1);
    pbs_code rc = pbs_mem_plan(run, need, "the largest part", err);
    if (!rc) rc = pbs_alloc(run, &p->job.fate, p->job.triangles, 1, "a part to be repaired", err);
    if (!rc)
        rc = pbs_alloc(run, &p->position, p->job.triangles, 9 * sizeof(float),
                       "a part to be repaired", err);
    if (rc) return rc;
    float *to = p->position;
    for (size_t i = 0; i < p->meshes; to += 9 * (size_t)p->mesh[i++].triangles)
        gather(&p->mesh[i], to);
    p->job.position = p->position;
    rc = m->module->mend(run, &p->job, err);
    pbs_free(run, p->position);
    p->position = NULL;
    if (rc) rc = give_up(m, n, p, err);
    for (int i = 0; i < PBS_MEND_COUNTS; i++) m->totals->counts[i] += p->job.counts[i];
    return rc;
}

static pbs_code mend_part(mender *m, uint32_t i, uint32_t *id, pbs_err *err) {
    const pbs_scene *s = m->scene;
    part p = {.mesh = s->meshes + s->first_mesh[i],
              .meshes = s->first_mesh[i + 1] - s->first_mesh[i]};
    uint64_t triangles = 0;
    for (size_t k = 0; k < p.meshes; k++) triangles += p.mesh[k].triangles;
    if (triangles > UINT32_MAX / 8)
        return pbs_fail(err, PBS_DATA, "%s: part %u has %llu triangles: more than 2^29",
                        pbs_reader_name(s->reader), i, (unsigned long long)triangles);
    p.corners = corners_of(p.mesh, p.meshes);
    p.job.triangles = (uint32_t)triangles;
    p.job.fill = m->options->fill > UINT32_MAX ? UINT32_MAX : (uint32_t)m->options->fill;
    p.job.intersections = m->options->intersections;
    pbs_run_progress(s->run, "repairing", m->done, 0);
    m->totals->parts += triangles != 0;
    pbs_code rc = triangles ? mend(m, &s->nodes[i], &p, err) : PBS_OK;
    if (!rc) rc = put_part(m, &s->nodes[i], &p, id, err);
    m->done += triangles;
    pbs_free(s->run, p.position);
    pbs_free(s->run, p.job.fate);
    pbs_free(s->run, p.job.filled);
    return rc;
}

/* ---- the scene ---- */

static pbs_code put_assembly(mender *m, const pbs_node *n, uint32_t *id, pbs_err *err) {
    pbs_child *child;
    pbs_run *run = m->scene->run;
    pbs_code rc =
        pbs_alloc(run, &child, n->child_count, sizeof *child, "an assembly's children", err);
    if (rc) return rc;
    for (uint32_t i = 0; i < n->child_count; i++) {
        child[i] = n->children[i];
        child[i].node = m->node[child[i].node];
        if (child[i].motion) child[i].motion = m->motion[child[i].motion - 1];
    }
    rc = m->sink->assembly(m->sink->ctx, n->name, child, n->child_count, id, err);
    pbs_free(run, child);
    return rc;
}

static pbs_code put_looks(mender *m, pbs_err *err) {
    const pbs_scene *s = m->scene;
    const pbs_sink *to = m->sink;
    pbs_code rc = PBS_OK;
    uint32_t id;
    for (size_t i = 0; i < s->texture_count && !rc; i++) {
        const pbs_texture *t = &s->textures[i];
        rc = to->texture(to->ctx, t->name, t->bytes, t->size, &id, err);
    }
    for (size_t i = 0; i < s->material_count && !rc; i++)
        rc = to->material(to->ctx, &s->materials[i], &id, err);
    for (size_t i = 0; i < s->motions.animation_count && !rc; i++)
        rc = to->animation(to->ctx, s->motions.animations[i].name, &id, err);
    for (size_t i = 0; i < s->motions.count && !rc; i++)
        rc = to->motion(to->ctx, &s->motions.motions[i], &m->motion[i], err);
    for (int i = 0; i < PBS_SKIP_KINDS && !rc; i++) to->skip(to->ctx, i, s->skipped[i]);
    return rc;
}

static pbs_code put_node(mender *m, uint32_t i, pbs_err *err) {
    const pbs_scene *s = m->scene;
    const pbs_node *n = &s->nodes[i];
    bool meshes = s->first_mesh[i] < s->first_mesh[i + 1];
    if (meshes && n->child_count)
        return pbs_fail(err, PBS_DATA, "%s: node %u is both a part and an assembly",
                        pbs_reader_name(s->reader), i);
    return n->child_count ? put_assembly(m, n, &m->node[i], err)
                          : mend_part(m, i, &m->node[i], err);
}

pbs_code pbs_scene_mend(const pbs_scene *s, const pbs_mend_options *options, pbs_scene_writer *to,
                        pbs_mend_totals *totals, pbs_err *err) {
    const void *module;
    mender m = {.scene = s, .options = options, .to = to, .totals = totals};
    memset(totals, 0, sizeof *totals);
    pbs_code rc = pbs_module_open(s->run, "mend", MEND_BYTES, &module, err);
    if (rc) return rc;
    m.module = module;
    m.sink = pbs_scene_sink(to);
    rc = pbs_alloc(s->run, &m.node, s->node_count, sizeof *m.node, "the table of nodes", err);
    if (!rc)
        rc = pbs_alloc(s->run, &m.motion, s->motions.count, sizeof *m.motion, "the motions", err);
    if (!rc) rc = put_looks(&m, err);
    for (uint32_t i = 0; i < s->node_count && !rc; i++) {
        rc = pbs_run_check(s->run, err);
        if (!rc) rc = put_node(&m, i, err);
    }
    if (!rc) rc = m.sink->root(m.sink->ctx, m.node[s->node_count - 1], err);
    pbs_free(s->run, m.node);
    pbs_free(s->run, m.motion);
    return rc;
}
