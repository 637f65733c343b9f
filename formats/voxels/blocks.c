/* blocks.c: what the walk over blocks needs to know before it begins: the meshes' clusters, the
 * boxes of nodes, and which side of each part is out. */
#include "formats/voxels/blocks_inner.h"
#include "libcore/ground/pipe.h"
#include "libcore/voxels/winding.h"

typedef struct sorting {
    pbs_blocks *b;
    size_t *at;           /* of each mesh in the store */
    pbs_winding *winding; /* of each mesh; NULL: not wanted */
} sorting;

/* ---- which side is out ---- */

/* A node and what is placed below it where it is, around the same origin: a part, or one that the
 * importer has split. */
typedef struct whole {
    pbs_winding winding;
    uint64_t triangles; /* 0: its pieces do not fit together */
    const double *origin;
    pbs_wound wound; /* OPEN: not known */
    bool decided;    /* it is closed by itself */
} whole;

static bool at_home(const pbs_child *c) {
    for (int i = 0; i < 12; i++)
        if (c->m[i] != PBS_IDENTITY[i]) return false;
    return true;
}

/* Sums are mod 2^64: 2^64 times the same open piece would look closed. */
static bool join(whole *w, const double *origin, const pbs_winding *piece, uint64_t triangles) {
    if (!w->origin) w->origin = origin;
    for (int k = 0; k < 3; k++)
        if (w->origin[k] != origin[k]) return false;
    pbs_winding_add(&w->winding, piece);
    w->triangles += triangles;
    return w->triangles <= UINT32_MAX;
}

static void sum_up(const pbs_blocks *b, const pbs_winding *mesh, whole *all, uint32_t node) {
    const pbs_scene *s = b->s;
    const pbs_node *n = &s->nodes[node];
    whole w = {.wound = PBS_WOUND_OPEN};
    bool fits = true;
    for (size_t i = s->first_mesh[node]; i < s->first_mesh[node + 1] && fits; i++)
        fits = join(&w, n->origin, &mesh[i], s->meshes[i].triangles);
    for (uint32_t k = 0; k < n->child_count && fits; k++) {
        const whole *c = &all[n->children[k].node];
        if (pbs_bound_is_empty(&b->bound[n->children[k].node])) continue;
        fits = c->triangles && at_home(&n->children[k]) &&
               join(&w, c->origin, &c->winding, c->triangles);
    }
    if (!fits) w.triangles = 0;
    if (w.triangles) w.wound = pbs_winding_says(&w.winding);
    w.decided = w.wound != PBS_WOUND_OPEN;
    all[node] = w;
}

/* Pieces that are open take what the smallest whole around them says; if they are a piece of
 * several wholes which do not agree, nothing is known. */
static void hand_down(const pbs_node *n, whole *all) {
    const whole *w = &all[n->id];
    if (!w->triangles || w->wound == PBS_WOUND_OPEN) return;
    for (uint32_t k = 0; k < n->child_count; k++) {
        whole *c = &all[n->children[k].node];
        if (!c->triangles || c->decided) continue;
        c->wound = c->wound == PBS_WOUND_OPEN || c->wound == w->wound ? w->wound : PBS_WOUND_FLAT;
    }
}

static pbs_code orient(pbs_blocks *b, const pbs_winding *mesh, pbs_err *err) {
    const pbs_scene *s = b->s;
    whole *all;
    pbs_code rc = pbs_alloc(b->run, &all, s->node_count, sizeof *all, "the sides of parts", err);
    if (rc) return rc;
    for (size_t i = 0; i < s->node_count; i++) sum_up(b, mesh, all, (uint32_t)i);
    for (size_t i = s->node_count; i-- > 0;) {
        hand_down(&s->nodes[i], all);
        size_t first = s->first_mesh[i], end = s->first_mesh[i + 1];
        pbs_wound wound = all[i].wound;
        bool known = wound == PBS_WOUND_OUT || wound == PBS_WOUND_IN;
        pbs_sides sides = !known                   ? PBS_SIDES_UNKNOWN
                          : wound == PBS_WOUND_OUT ? PBS_SIDES_OUT
                                                   : PBS_SIDES_IN;
        memset(b->sides + first, sides, end - first);
        if (first == end) continue;
        b->stats.parts_known += known;
        b->stats.parts_unknown += !known;
        b->stats.parts_turned += wound == PBS_WOUND_IN;
    }
    pbs_free(b->run, all);
    return PBS_OK;
}

static pbs_code find_sides(pbs_blocks *b, pbs_orient how, const pbs_winding *mesh, pbs_err *err) {
    const pbs_scene *s = b->s;
    pbs_code rc = pbs_alloc(b->run, &b->sides, s->mesh_count, 1, "the sides of parts", err);
    if (rc || how == PBS_ORIENT_AUTO) return rc ? rc : orient(b, mesh, err);
    bool trust = how == PBS_ORIENT_TRUST;
    memset(b->sides, trust ? PBS_SIDES_OUT : PBS_SIDES_UNKNOWN, s->mesh_count);
    for (size_t i = 0; i < s->node_count; i++) {
        bool part = s->first_mesh[i] < s->first_mesh[i + 1];
        b->stats.parts_known += part && trust;
        b->stats.parts_unknown += part && !trust;
    }
    return PBS_OK;
}

/* ---- clusters and boxes ---- */

static pbs_code sort_mesh(void *ctx, size_t i, int thread, pbs_err *err) {
    sorting *w = ctx;
    const pbs_mesh *mesh = &w->b->s->meshes[i];
    (void)thread;
    pbs_code rc = pbs_clusters_make(w->b->run, mesh, (uint8_t *)w->b->store.bytes + w->at[i],
                                    &w->b->clusters[i], err);
    if (w->winding) w->winding[i] = pbs_winding_of(mesh);
    pbs_pages_saw(&w->b->pages, mesh->triangles);
    return rc;
}

static pbs_code sort_all(sorting *w, pbs_err *err) {
    pbs_blocks *b = w->b;
    const pbs_scene *s = b->s;
    size_t bytes = 0;
    for (size_t i = 0; i < s->mesh_count; i++) {
        w->at[i] = bytes;
        bytes += pbs_clusters_bytes(s->meshes[i].triangles);
    }
    pbs_code rc = pbs_alloc(b->run, &b->clusters, s->mesh_count, sizeof *b->clusters,
                            "the table of meshes", err);
    if (!rc) rc = pbs_scratch_new(b->run, bytes, 1, "the clusters of triangles", &b->store, err);
    if (rc) return rc;
    pbs_pages_open(s, &b->store, &b->pages);
    return pbs_parallel(b->run, s->mesh_count, sort_mesh, w, err);
}

static pbs_code box_nodes(pbs_blocks *b, pbs_err *err) {
    const pbs_scene *s = b->s;
    static const float none[6] = {INFINITY, INFINITY, INFINITY, -INFINITY, -INFINITY, -INFINITY};
    float(*box)[6];
    pbs_code rc = pbs_alloc(b->run, &box, s->mesh_count, sizeof *box, "the boxes of meshes", err);
    if (rc) return rc;
    for (size_t i = 0; i < s->mesh_count; i++) {
        const pbs_clusters *c = &b->clusters[i];
        memcpy(box[i], c->levels ? c->box[c->levels - 1][0] : none, sizeof *box);
    }
    rc = pbs_bounds_make(s, (const float(*)[6])box, &b->bound, err);
    pbs_free(b->run, box);
    return rc;
}

static pbs_code prepare(pbs_blocks *b, pbs_orient how, pbs_err *err) {
    const pbs_scene *s = b->s;
    sorting w = {.b = b};
    pbs_code rc = pbs_alloc(b->run, &w.at, s->mesh_count, sizeof *w.at, "the table of meshes", err);
    if (!rc && how == PBS_ORIENT_AUTO)
        rc = pbs_alloc(b->run, &w.winding, s->mesh_count, sizeof *w.winding, "the sides of parts",
                       err);
    if (!rc) rc = sort_all(&w, err);
    if (!rc) rc = box_nodes(b, err);
    if (!rc) rc = find_sides(b, how, w.winding, err);
    pbs_free(b->run, w.winding);
    pbs_free(b->run, w.at);
    return rc;
}

pbs_code pbs_blocks_new(const pbs_scene *s, const pbs_grid *grid, pbs_orient how, size_t memory,
                        pbs_blocks **out, pbs_err *err) {
    pbs_blocks *b;
    *out = NULL;
    pbs_code rc = pbs_alloc(s->run, &b, 1, sizeof *b, "the walk over blocks", err);
    if (rc) return rc;
    *b = (pbs_blocks){.run = s->run, .s = s, .grid = *grid, .pages.trim.statm = -1};
    b->per_voxel = 1 / grid->voxel;
    for (int k = 0; k < 3; k++) b->slack[k] = fabs(grid->min[k]) * b->per_voxel * 0x1p-48 + 0x1p-31;
    b->across = (grid->size + PBS_BLOCK - 1) / PBS_BLOCK;
    rc = prepare(b, how, err);
    if (!rc) rc = walk_begin(b, memory, err);
    if (rc)
        pbs_blocks_free(b);
    else
        *out = b;
    return rc;
}

void pbs_blocks_free(pbs_blocks *b) {
    if (!b) return;
    pbs_run *run = b->run;
    pbs_pages_close(&b->pages);
    pbs_scratch_free(&b->store);
    pbs_free(run, b->clusters);
    pbs_free(run, b->bound);
    pbs_free(run, b->sides);
    pbs_free(run, b->list);
    pbs_free(run, b->place);
    pbs_free(run, b);
}

pbs_blocks_stats pbs_blocks_totals(const pbs_blocks *b) {
    return b->stats;
}
