/* pack_cells.c: the triangles of a scene that are near each chunk of cells of a stream of voxels
 * (paper 2, section 3), so that a player that comes close has them.
 *
 * The walk over blocks (blocks.h) in a grid whose cells are four times as large has blocks of as
 * many cells as chunks have. Each chunk's triangles go into meshes around its own corner, and these
 * into a temporary file, since how many there are must be known before the archive begins. */
#include "formats/voxels/blocks.h"
#include "formats/scene/meshbuild.h"
#include "formats/archive/pack_inner.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* The walk's lists are always as large, because they decide in which order triangles come. */
enum { LISTS = 2 << 20, LARGER = PBS_CHUNK / PBS_BLOCK };

/* A node of the finest level, by its place. */
typedef struct chunk_node {
    uint64_t place;
    size_t entry;
} chunk_node;

typedef struct cells {
    pbs_pack *p;
    pbs_grid grid; /* the larger cells */
    uint32_t corners;
    chunk_node *node; /* sorted */
    size_t count;
    pbs_builder *builder;
    pbs_writer *spool;
    uint32_t at[3];  /* chunk */
    size_t entry;    /* its node; SIZE_MAX: it has none */
    uint64_t stored; /* triangles of it so far, in meshes */
} cells;

static uint64_t place_key(const uint32_t at[3]) {
    return (uint64_t)at[0] | (uint64_t)at[1] << 16 | (uint64_t)at[2] << 32;
}

static int by_place(const void *a, const void *b) {
    uint64_t x = ((const chunk_node *)a)->place, y = ((const chunk_node *)b)->place;
    return (x > y) - (x < y);
}

static size_t find(const cells *c, const uint32_t at[3]) {
    chunk_node key = {place_key(at), 0};
    const chunk_node *n = bsearch(&key, c->node, c->count, sizeof key, by_place);
    return n ? n->entry : SIZE_MAX;
}

static pbs_code list_nodes(cells *c, const pack_input *in, pbs_err *err) {
    pbs_code rc =
        pbs_alloc(c->p->run, &c->node, in->node_count, sizeof *c->node, "the chunks of cells", err);
    for (size_t i = in->first_node; i < in->first_node + in->node_count && !rc; i++) {
        const pbs_voxel_survey *v = &c->p->entries[i].voxels;
        if (v->voxels && !v->place.level)
            c->node[c->count++] = (chunk_node){place_key(v->place.chunk), i};
    }
    if (!rc) qsort(c->node, c->count, sizeof *c->node, by_place);
    return rc;
}

/* ---- one triangle ---- */

/* A batch of triangles of one mesh, placed in the grid of larger cells. */
typedef struct placed {
    const pbs_mesh *mesh;
    const pbs_to_grid *to;
    double cofactor[9]; /* of the transform, scaled; turned outwards */
    bool mirrored;
} placed;

/* Of the transform without its size, which might overflow. */
static void make_cofactor(placed *t) {
    double most = 0, m[12] = {0};
    for (int i = 0; i < 9; i++) most = fmax(most, fabs(t->to->m[i]));
    for (int i = 0; i < 9 && most > 0; i++) m[4 * (i / 3) + i % 3] = t->to->m[i] / most;
    pbs_xform_cofactor(t->cofactor, m);
    t->mirrored = pbs_xform_det(m) < 0;
    for (int i = 0; i < 9 && t->mirrored; i++) t->cofactor[i] = -t->cofactor[i];
}

/* Corners relative to a chunk's corner, in larger cells. */
static void corners_at(const placed *t, uint32_t triangle, const uint32_t at[3], double v[3][3]) {
    const uint16_t *index = t->mesh->index + 3 * (size_t)triangle;
    for (int i = 0; i < 3; i++) {
        const float *q = t->mesh->position + 3 * (size_t)index[i];
        for (int r = 0; r < 3; r++) {
            const double *m = t->to->m + 3 * r;
            v[i][r] = m[0] * q[0] + m[1] * q[1] + m[2] * q[2] + t->to->part[r] +
                      (t->to->whole[r] - (double)at[r] * PBS_BLOCK);
        }
    }
}

/* Whether it touches the chunk's cells or the layer of one (small) cell around them. */
static bool touches(const double v[3][3]) {
    const double half = PBS_BLOCK / 2.0,
                 reach[3] = {half + 1.0 / LARGER, half + 1.0 / LARGER, half + 1.0 / LARGER};
    double p[3][3];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) p[i][k] = v[i][k] - half;
    return !pbs_triangle_misses((const double(*)[3])p, reach);
}

static void turn_normal(const placed *t, uint32_t vertex, float out[3]) {
    float n[3];
    pbs_oct_decode(n, t->mesh->normal + 2 * (size_t)vertex);
    for (int r = 0; r < 3; r++) {
        const double *m = t->cofactor + 3 * r;
        out[r] = (float)(m[0] * n[0] + m[1] * n[1] + m[2] * n[2]);
    }
}

static pbs_code store(cells *c, const placed *t, uint32_t triangle, const double v[3][3],
                      pbs_err *err) {
    const pbs_mesh *m = t->mesh;
    pbs_corner corner[3] = {0};
    for (int i = 0; i < 3; i++) {
        /* A mirrored triangle goes the other way round, so that its outside stays. */
        int from = t->mirrored && i ? 3 - i : i;
        uint32_t vertex = m->index[3 * (size_t)triangle + (uint32_t)from];
        for (int k = 0; k < 3; k++) corner[i].position[k] = v[from][k] * c->grid.voxel;
        if (m->normal) turn_normal(t, vertex, corner[i].normal);
        if (m->uv) memcpy(corner[i].uv, m->uv + 2 * (size_t)vertex, sizeof corner->uv);
        memset(corner[i].colour, 255, 4);
        if (m->colour) memcpy(corner[i].colour, m->colour + 4 * (size_t)vertex, 4);
    }
    uint32_t material = m->triangle_material ? m->triangle_material[triangle] : m->material;
    return pbs_builder_triangle(c->builder, corner, material, err);
}

/* A chunk without voxels has no node. Its triangles are nearly always in the next one, too; those
 * that are in none are counted, at the first chunk that they touch. */
static bool is_homeless(const cells *c, const placed *t, uint32_t triangle) {
    const uint32_t zero[3] = {0};
    double v[3][3];
    uint32_t low[3], high[3], at[3], all = (c->grid.size + PBS_BLOCK - 1) / PBS_BLOCK;
    bool first = true;
    corners_at(t, triangle, zero, v);
    for (int k = 0; k < 3; k++) {
        double a = fmin(v[0][k], fmin(v[1][k], v[2][k])) - 1.0 / LARGER;
        double b = fmax(v[0][k], fmax(v[1][k], v[2][k])) + 1.0 / LARGER;
        low[k] = a > 0 ? (uint32_t)fmin(a / PBS_BLOCK, all - 1) : 0;
        high[k] = b > 0 ? (uint32_t)fmin(b / PBS_BLOCK, all - 1) : 0;
    }
    for (at[2] = low[2]; at[2] <= high[2]; at[2]++)
        for (at[1] = low[1]; at[1] <= high[1]; at[1]++)
            for (at[0] = low[0]; at[0] <= high[0]; at[0]++) {
                corners_at(t, triangle, at, v);
                if (!touches((const double(*)[3])v)) continue;
                if (find(c, at) != SIZE_MAX) return false;
                if (first && memcmp(at, c->at, sizeof at)) return false; /* counted there */
                first = false;
            }
    return !first;
}

/* As pbs_nearby_fn. */
static pbs_code take(void *ctx, const pbs_mesh *mesh, const uint32_t *triangles, size_t count,
                     const pbs_to_grid *to, pbs_sides sides, pbs_err *err) {
    cells *c = ctx;
    placed t = {.mesh = mesh, .to = to};
    (void)sides;
    make_cofactor(&t);
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < count && !rc; i++) {
        double v[3][3];
        corners_at(&t, triangles[i], c->at, v);
        if (!touches((const double(*)[3])v)) continue;
        if (c->entry != SIZE_MAX)
            rc = store(c, &t, triangles[i], (const double(*)[3])v, err);
        else
            c->p->stats.homeless += is_homeless(c, &t, triangles[i]);
    }
    return rc;
}

/* ---- chunks ---- */

/* As pbs_mesh_out's. */
static pbs_code take_mesh(void *ctx, uint32_t triangles, const pbs_piece *piece, int pieces,
                          pbs_err *err) {
    cells *c = ctx;
    pbs_chunk chunk = {.tag = PBS_TAG_MESH,
                       .node = (uint32_t)c->entry,
                       .count = triangles,
                       .first = (uint32_t)c->stored};
    if (c->stored + triangles > UINT32_MAX)
        return pbs_fail(err, PBS_LIMIT, "more than 2^32 triangles in a chunk of cells");
    c->stored += triangles;
    return pbs_writer_chunk(c->spool, &chunk, piece, pieces, err);
}

static pbs_code fill_chunk(cells *c, const uint32_t at[3], const pbs_nearby *near, pbs_err *err) {
    static const double origin[3] = {0};
    pbs_box box;
    uint64_t triangles;
    for (int k = 0; k < 3; k++) c->at[k] = at[k] / PBS_BLOCK;
    c->entry = find(c, c->at);
    c->stored = 0;
    if (c->entry != SIZE_MAX) pbs_builder_begin(c->builder, origin, c->corners);
    pbs_code rc = pbs_nearby_visit(near, take, c, err);
    return rc || c->entry == SIZE_MAX ? rc : pbs_builder_end(c->builder, &triangles, &box, err);
}

static pbs_code walk(cells *c, const pbs_scene *s, pbs_err *err) {
    pbs_blocks *blocks;
    bool end = false;
    uint64_t done = 0;
    pbs_code rc = pbs_blocks_new(s, &c->grid, PBS_ORIENT_TRUST, LISTS, &blocks, err);
    while (!rc && !end) {
        uint32_t at[3];
        pbs_nearby *near;
        rc = pbs_blocks_next(blocks, at, &near, &end, err);
        if (rc || end) break;
        pbs_run_progress(c->p->run, "placing triangles", done, c->count);
        rc = fill_chunk(c, at, near, err);
        done += c->entry != SIZE_MAX;
        pbs_nearby_free(near);
    }
    pbs_blocks_free(blocks);
    return rc;
}

/* ---- the spool ---- */

static pbs_code open_spool(cells *c, pbs_err *err) {
    pbs_output out;
    pbs_code rc = pbs_output_spool(c->p->run, &out, err);
    return rc ? rc
              : pbs_writer_open(c->p->run, &(pbs_writer_desc){.output = &out, .kind = PBS_SCENE},
                                &c->spool, err);
}

/* Its chunks are in the order of the walk, those of a node together. */
static pbs_code give_meshes(cells *c, int scene, pbs_reader *r, pbs_err *err) {
    const pbs_chunk *e;
    size_t n;
    pbs_code rc = pbs_reader_directory(r, &e, &n, err);
    for (size_t i = 0; i < n && !rc; i++) {
        pack_entry *to = &c->p->entries[e[i].node];
        if (to->mesh_input == PACK_NOWHERE) to->mesh = &e[i];
        to->mesh_input = scene;
        to->mesh_reader = r;
        to->mesh_count++;
    }
    return rc;
}

static pbs_code close_spool(cells *c, int scene, pbs_err *err) {
    pbs_pack *p = c->p;
    pbs_input in;
    pbs_reader *r;
    pbs_code rc = pbs_writer_reopen(c->spool, &in, err);
    if (!rc) rc = pbs_reader_open(p->run, &in, PBS_KIND(PBS_SCENE), &r, err);
    if (rc) return rc;
    rc = pbs_grow(p->run, &p->spools, &p->spool_cap, p->spool_count + 1, sizeof *p->spools,
                  "the temporary files", err);
    if (rc) {
        pbs_reader_close(r);
        return rc;
    }
    p->spools[p->spool_count++] = r;
    return give_meshes(c, scene, r, err);
}

static uint32_t corners_of(const pbs_scene *s) {
    uint32_t corners = 0;
    for (size_t i = 0; i < s->mesh_count; i++)
        corners |= (s->meshes[i].normal ? PBS_CORNER_NORMAL : 0u) |
                   (s->meshes[i].uv ? PBS_CORNER_UV : 0u) |
                   (s->meshes[i].colour ? PBS_CORNER_COLOUR : 0u);
    return corners;
}

static void count_flat(const cells *c) {
    uint64_t skipped[PBS_SKIP_KINDS] = {0};
    pbs_builder_skips(c->builder, skipped);
    for (int i = 0; i < PBS_SKIP_KINDS; i++) c->p->stats.flat += skipped[i];
}

pbs_code pack_cells(pbs_pack *p, int scene, int voxels, const pbs_grid *grid, pbs_err *err) {
    const pbs_scene *s = &p->inputs[scene].scene;
    cells c = {.p = p, .grid = *grid, .corners = corners_of(s)};
    c.grid.voxel *= LARGER;
    c.grid.size = (grid->size + LARGER - 1) / LARGER;
    pbs_code rc = list_nodes(&c, &p->inputs[voxels], err);
    if (!rc) rc = pbs_builder_new(p->run, (pbs_mesh_out){&c, take_mesh}, &c.builder, err);
    if (!rc) rc = open_spool(&c, err);
    if (!rc) rc = walk(&c, s, err);
    if (!rc) rc = close_spool(&c, scene, err);
    if (c.builder) count_flat(&c);
    pbs_writer_close(c.spool);
    pbs_builder_free(c.builder);
    pbs_free(p->run, c.node);
    return rc;
}
