/* pack_match.c: where the meshes of a scene go (pack.h). */
#include "formats/voxels/blocks.h"
#include "formats/archive/pack_inner.h"
#include <math.h>
#include <string.h>

/* ---- surfels ---- */

/* Sums of the same numbers in another order. */
static bool same_box(const pbs_box *a, const pbs_box *b) {
    if (pbs_box_is_empty(a) || pbs_box_is_empty(b))
        return pbs_box_is_empty(a) && pbs_box_is_empty(b);
    for (int k = 0; k < 3; k++) {
        double size = fabs(a->min[k]) + fabs(a->max[k]);
        if (!(fabs(a->min[k] - b->min[k]) <= 1e-6 * size) ||
            !(fabs(a->max[k] - b->max[k]) <= 1e-6 * size))
            return false;
    }
    return true;
}

/* first: what the stream's numbers are moved by. */
static bool same_children(const pbs_node *a, const pbs_node *b, size_t first) {
    if (a->child_count != b->child_count) return false;
    for (uint32_t i = 0; i < a->child_count; i++) {
        const pbs_child *x = &a->children[i], *y = &b->children[i];
        if (x->node + first != y->node || x->flags != y->flags || memcmp(x->m, y->m, sizeof x->m))
            return false;
    }
    return true;
}

/* An assembly may have got a closer box; and names come from files', or pipes that have none. */
static bool is_made_from(const pbs_pack *p, const pack_input *in, const pbs_scene *s) {
    if (in->kind != PACK_SURFELS || in->node_count != s->node_count) return false;
    for (size_t i = 0; i < s->node_count; i++) {
        const pbs_node *a = &s->nodes[i], *b = &p->entries[in->first_node + i].node;
        if (a->triangles != b->triangles || !same_children(a, b, in->first_node) ||
            (!a->child_count && !same_box(&a->box, &b->box)))
            return false;
    }
    return true;
}

/* A node without surfels gets the scene's origin, with which nothing of its meshes changes. */
static void give_meshes(pbs_pack *p, const pack_input *to, int scene) {
    const pack_input *from = &p->inputs[scene];
    size_t node = 0, first = 0;
    for (size_t k = 0; k < from->entry_count; k++) {
        if (from->entries[k].tag != PBS_TAG_NODE) continue;
        pack_entry *e = &p->entries[to->first_node + node];
        const double *origin = from->scene.nodes[node].origin;
        e->mesh_node = &from->scene.nodes[node];
        e->mesh_input = scene;
        e->mesh_reader = from->reader;
        e->mesh = from->entries + first;
        e->mesh_count = k - first;
        bool any = pack_mesh_chunks(e) > 0;
        if (any && !e->has_points) memcpy(e->node.origin, origin, sizeof e->node.origin);
        for (int a = 0; a < 3 && any; a++) e->shift[a] = origin[a] - e->node.origin[a];
        first = k + 1;
        node++;
    }
}

/* ---- voxels ---- */

/* The grid that a stream's chunks of cells are in. Corners of chunks were computed from that of the
 * grid; the one that is nearest says it best, and exactly if it is there. False: no voxels. */
static bool grid_of(const pbs_pack *p, const pack_input *in, pbs_grid *g) {
    uint32_t least[3] = {UINT32_MAX, UINT32_MAX, UINT32_MAX};
    *g = (pbs_grid){.size = 0};
    for (size_t i = in->first_node; i < in->first_node + in->node_count; i++) {
        const pack_entry *e = &p->entries[i];
        const pbs_voxel_place *at = &e->voxels.place;
        if (!e->voxels.voxels || at->level) continue;
        g->size = at->size;
        g->voxel = e->node.lattice;
        for (int k = 0; k < 3; k++) {
            if (at->chunk[k] >= least[k]) continue;
            least[k] = at->chunk[k];
            g->min[k] = e->node.origin[k] - g->voxel * PBS_CHUNK * at->chunk[k];
        }
    }
    return g->size && g->voxel > 0;
}

static bool holds(const pbs_grid *g, const pbs_box *box) {
    for (int k = 0; k < 3; k++)
        if (!(box->min[k] >= g->min[k]) || !(box->max[k] <= g->min[k] + g->voxel * g->size))
            return false;
    return true;
}

/* A stream of voxels that may be the scene's, so far. */
static bool may_be_made_from(const pbs_pack *p, const pack_input *in, const pbs_scene *s) {
    if (in->kind != PACK_VOXELS || in->made_from != PACK_NOWHERE || !in->node_count) return false;
    const pbs_node *root = &p->entries[in->first_node + in->node_count - 1].node;
    return root->triangles == s->nodes[s->node_count - 1].triangles;
}

static pbs_code match_voxels(pbs_pack *p, int scene, pbs_err *err) {
    const pbs_scene *s = &p->inputs[scene].scene;
    pbs_box box;
    uint64_t triangles, singular;
    bool known = false;
    for (int i = 0; i < p->input_count; i++) {
        pbs_grid grid;
        if (!may_be_made_from(p, &p->inputs[i], s) || !grid_of(p, &p->inputs[i], &grid)) continue;
        pbs_code rc = known ? PBS_OK : pbs_scene_box(s, &box, &triangles, &singular, err);
        if (rc) return rc;
        known = true;
        if (!holds(&grid, &box)) continue;
        p->inputs[i].made_from = scene;
        p->inputs[scene].elsewhere = true;
        return pack_cells(p, scene, i, &grid, err);
    }
    return PBS_OK;
}

/* ---- all ---- */

static pbs_code match_scene(pbs_pack *p, int scene, pbs_err *err) {
    pack_input *from = &p->inputs[scene];
    for (int i = 0; i < p->input_count && !from->elsewhere; i++) {
        pack_input *to = &p->inputs[i];
        if (to->made_from != PACK_NOWHERE || !is_made_from(p, to, &from->scene)) continue;
        to->made_from = scene;
        from->elsewhere = true;
        give_meshes(p, to, scene);
    }
    pbs_code rc = match_voxels(p, scene, err);
    p->stats.matched += from->elsewhere;
    return rc;
}

pbs_code pack_match(pbs_pack *p, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (int i = 0; i < p->input_count && !rc; i++)
        if (p->inputs[i].kind == PACK_SCENE) rc = match_scene(p, i, err);
    for (int i = 0; i < p->input_count && !rc; i++)
        if (p->inputs[i].kind == PACK_SCENE && !p->inputs[i].elsewhere) rc = pack_take(p, i, err);
    return rc;
}
