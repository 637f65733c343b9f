#include "libcore/surfels/owned.h"
#include "libcore/ground/pipe.h"
#include "libcore/data/srgb.h"

void pbs_owned_init(pbs_owned *o, uint32_t channels) {
    int lane = 1;
    *o = (pbs_owned){.colour = -1, .normal = -1, .material = -1, .emissive = -1};
    if (channels & PBS_COLOUR) o->colour = lane, lane += 4;
    if (channels & PBS_NORMAL) o->normal = lane, lane += 3;
    if (channels & PBS_MATERIAL) o->material = lane, lane += 2;
    if (channels & PBS_EMISSIVE) o->emissive = lane, lane += 3;
    o->lanes = lane <= PBS_OWNED_FEW ? PBS_OWNED_FEW : PBS_OWNED_MOST;
}

void pbs_owned_layout(pbs_owned *o, size_t slots, size_t surfels, int parts, pbs_layout *layout) {
    size_t lanes = (size_t)o->lanes;
    o->row = pbs_layout_take(layout, slots * lanes * sizeof *o->row);
    o->sum = pbs_layout_take(layout, (size_t)parts * surfels * lanes * sizeof *o->sum);
}

/* ---- rows ---- */

enum { ZERO = 32768 /* a normal's 0 */, AHEAD = 16 };

typedef struct filler {
    pbs_owned *o;
    const pbs_tree *t;
    uint16_t linear[256];
    int parts;
} filler;

static void fill_normal(const filler *f, size_t slot, uint16_t *row) {
    int16_t n[4];
    if (f->t->normal) {
        const pbs_leaf_normals *l = &f->t->normal[slot / PBS_LEAF];
        memcpy(n, l->xy[slot % PBS_LEAF], 4);
        memcpy(n + 2, l->z0[slot % PBS_LEAF], 4);
    } else
        pbs_place_normal(n, f->o->in->normal + 2 * (size_t)f->t->id[slot]);
    for (int k = 0; k < 3; k++) row[f->o->normal + k] = (uint16_t)(n[k] + ZERO);
}

static void fill_row(const filler *f, size_t slot, uint16_t *row) {
    const pbs_owned *o = f->o;
    size_t i = 4 * (size_t)f->t->id[slot];
    row[0] = 1;
    if (o->colour >= 0) {
        const uint8_t *c = o->in->colour + i;
        for (int k = 0; k < 3; k++) row[o->colour + k] = f->linear[c[k]];
        row[o->colour + 3] = (uint16_t)(257 * c[3]);
    }
    if (o->normal >= 0) fill_normal(f, slot, row);
    for (int k = 0; k < 2 && o->material >= 0; k++)
        row[o->material + k] = (uint16_t)(257 * o->in->material[i + (size_t)k]);
    for (int k = 0; k < 3 && o->emissive >= 0; k++)
        row[o->emissive + k] = f->linear[o->in->emissive[i + (size_t)k]];
}

static void ask_for(const filler *f, size_t slot) {
    const pbs_owned *o = f->o;
    size_t i = 4 * (size_t)f->t->id[slot];
    if (o->colour >= 0) __builtin_prefetch(o->in->colour + i);
    if (o->normal >= 0 && !f->t->normal) __builtin_prefetch(o->in->normal + i / 2);
    if (o->material >= 0) __builtin_prefetch(o->in->material + i);
    if (o->emissive >= 0) __builtin_prefetch(o->in->emissive + i);
}

static pbs_code fill_part(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    const filler *f = ctx;
    size_t lanes = (size_t)f->o->lanes, n = f->t->points, end = pbs_part_end(n, f->parts, i);
    for (size_t slot = pbs_part_begin(n, f->parts, i); slot < end; slot++) {
        uint16_t *row = f->o->row + slot * lanes;
        if (slot + AHEAD < n) ask_for(f, slot + AHEAD);
        memset(row, 0, lanes * sizeof *row);
        fill_row(f, slot, row);
    }
    return PBS_OK;
}

pbs_code pbs_owned_fill(pbs_run *run, pbs_owned *o, const pbs_points *in, const pbs_tree *t,
                        pbs_err *err) {
    o->in = in;
    filler f = {.o = o, .t = t, .parts = pbs_parts(run, t->points, PBS_TREE_PART)};
    const pbs_srgb_table *srgb = pbs_srgb();
    for (int v = 0; v < 256; v++) f.linear[v] = (uint16_t)(srgb->linear[v] * 65535 + 0.5f);
    return pbs_parallel(run, (size_t)f.parts, fill_part, &f, err);
}

/* ---- sums ---- */

typedef struct adder {
    const pbs_owned *o;
    const pbs_cover *c;
    size_t count;
    int parts;
} adder;

/* Neighbours along the curve mostly have the same owner: their rows are added up apart, in 32 bits:
 * a leaf's rows cannot need more. */
static void add_leaf(const adder *a, uint64_t *sum, size_t leaf, size_t count) {
    size_t lanes = (size_t)a->o->lanes;
    const uint32_t *owner = a->c->owner + leaf * PBS_LEAF;
    const uint16_t *row = a->o->row + leaf * PBS_LEAF * lanes;
    for (size_t i = 0, end; i < count; i = end) {
        for (end = i + 1; end < count && owner[end] == owner[i]; end++) continue;
        if (owner[i] >= a->count) continue;
        for (size_t k = 0; k < lanes; k += PBS_OWNED_FEW) {
            uint32_t few[PBS_OWNED_FEW] = {0};
            for (size_t j = i; j < end; j++)
                for (size_t v = 0; v < PBS_OWNED_FEW; v++) few[v] += row[j * lanes + k + v];
            for (size_t v = 0; v < PBS_OWNED_FEW; v++) sum[owner[i] * lanes + k + v] += few[v];
        }
    }
}

static pbs_code add_part(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    const adder *a = ctx;
    const pbs_tree *t = a->c->tree;
    uint64_t *sum = a->o->sum + i * a->count * (size_t)a->o->lanes;
    memset(sum, 0, a->count * (size_t)a->o->lanes * sizeof *sum);
    for (size_t leaf = pbs_part_begin(t->leaves, a->parts, i);
         leaf < pbs_part_end(t->leaves, a->parts, i); leaf++) {
        size_t left = t->points - leaf * PBS_LEAF;
        add_leaf(a, sum, leaf, left < PBS_LEAF ? left : PBS_LEAF);
    }
    return PBS_OK;
}

pbs_code pbs_owned_sum(pbs_run *run, pbs_owned *o, const pbs_cover *c, size_t count, pbs_err *err) {
    adder a = {o, c, count, pbs_parts(run, c->tree->points, PBS_TREE_PART)};
    size_t size = count * (size_t)o->lanes;
    pbs_code rc = pbs_parallel(run, (size_t)a.parts, add_part, &a, err);
    for (size_t part = 1; part < (size_t)a.parts; part++)
        for (size_t k = 0; k < size; k++) o->sum[k] += o->sum[part * size + k];
    return rc;
}

static void mean_of(const uint64_t *sum, int lane, int n, double per, double *out) {
    for (int k = 0; k < n && lane >= 0; k++) out[k] = (double)sum[lane + k] * per;
}

bool pbs_owned_mean(const pbs_owned *o, size_t i, pbs_mean *out) {
    const uint64_t *sum = o->sum + i * (size_t)o->lanes;
    double n = (double)sum[0], per = 1 / (65535 * n);
    *out = (pbs_mean){{0}, {0}, {0}, {0}};
    if (!sum[0]) return false;
    mean_of(sum, o->colour, 4, per, out->colour);
    mean_of(sum, o->material, 2, per, out->material);
    mean_of(sum, o->emissive, 3, per, out->emissive);
    mean_of(sum, o->normal, 3, 1, out->normal);
    for (int k = 0; k < 3 && o->normal >= 0; k++)
        out->normal[k] = (out->normal[k] - ZERO * n) / (32767 * n);
    return true;
}
