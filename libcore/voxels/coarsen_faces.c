/* coarsen_faces.c: lists of what each face looks like, for coarsen.c: the paper's Minecraft example
 * one level up. Few scenes have them, so what does it stays out of the fast loops. */
#include "libcore/voxels/coarsen_inner.h"
#include <string.h>

static uint32_t mask_of(uint32_t place) {
    return place >> 24 & PBS_FACES_ALL;
}

/* What one face of a child says. */
typedef struct vote {
    uint32_t value; /* a material or a colour */
    float weight;
    f4 sum; /* of colours, times their weights */
} vote;

/* All of a parent's children: at most 8 with 6 faces. */
typedef struct votes {
    int count[7]; /* of a face; [6]: of all */
    vote vote[7][48];
} votes;

static bool lies_within(const pbs_cell_rows *in, size_t i) {
    uint64_t n = (uint64_t)__builtin_popcount(mask_of(in->v.place[i]));
    return in->v.face[i] + n <= in->face_count;
}

static void add_vote(votes *all, int face, const vote *v) {
    all->vote[face][all->count[face]++] = *v;
}

static void take_votes(const pbs_coarsen_block *b, const pbs_cell_rows *in, size_t i, bool colours,
                       votes *all) {
    size_t at = in->v.face[i];
    for (int f = 0; f < 6; f++) {
        if (!(mask_of(in->v.place[i]) >> f & 1)) continue;
        vote v = {.value = in->faces[at],
                  .weight = in->face_weight ? in->face_weight[at] : weight_of(in, i)};
        if (colours && in->face_sum)
            v.sum = in->face_sum[at];
        else if (colours)
            v.sum = colour4(b->srgb, v.value, false) * all4(v.weight);
        add_vote(all, f, &v);
        add_vote(all, 6, &v);
        at++;
    }
}

static vote mean_colour(const pbs_coarsen_block *b, const vote *v, int n) {
    vote out = v[0];
    float most = v[0].weight;
    for (int i = 1; i < n; i++) {
        out.sum += v[i].sum;
        out.weight += v[i].weight;
        if (v[i].weight > most) most = v[i].weight, out.value = v[i].value;
    }
    if (out.weight >= PLAIN_LOW && out.weight <= PLAIN_HIGH)
        out.value = encode4(b->srgb, out.sum / all4(out.weight), false);
    return out;
}

static vote most_voted(const vote *v, int n) {
    vote out = {.value = v[0].value, .weight = -1};
    for (int i = 0; i < n; i++) {
        float sum = 0;
        for (int k = 0; k < n; k++)
            if (v[k].value == v[i].value) sum += v[k].weight;
        if (sum > out.weight || (sum == out.weight && v[i].value < out.value))
            out.value = v[i].value, out.weight = sum;
    }
    return out;
}

static void put_faces(const pbs_coarsen_block *b, const votes *all, uint32_t mask, bool colours,
                      pbs_cell_rows *out) {
    for (int f = 0; f < 6; f++) {
        if (!(mask >> f & 1)) continue;
        /* A cap that no child has looks like all other faces together. */
        int from = all->count[f] ? f : 6, n = all->count[from];
        vote v = {.value = UINT32_MAX, .sum = all4(0)};
        if (n) v = colours ? mean_colour(b, all->vote[from], n) : most_voted(all->vote[from], n);
        size_t at = out->face_count++;
        out->faces[at] = v.value;
        out->face_weight[at] = v.weight;
        if (colours) out->face_sum[at] = v.sum;
    }
}

bool pbs_coarsen_faces(const pbs_coarsen_block *b, const pbs_cell_rows *in, size_t parents,
                       pbs_cell_rows *out) {
    bool colours = out->face_sum;
    votes all;
    for (size_t g = 0; g < parents; g++) {
        memset(all.count, 0, sizeof all.count);
        for (size_t i = first_child(b, g); i < b->end[g]; i++) {
            if (!lies_within(in, i)) return false;
            take_votes(b, in, i, colours, &all);
        }
        out->v.face[out->n + g] = (uint32_t)out->face_count;
        put_faces(b, &all, mask_of(out->v.place[out->n + g]), colours, out);
    }
    return true;
}

bool pbs_coarsen_keep_lists(pbs_cell_rows *r, size_t n, const uint32_t *faces, size_t face_count) {
    for (size_t i = r->n - n; i < r->n; i++) {
        size_t count = (size_t)__builtin_popcount(mask_of(r->v.place[i]));
        if (r->v.face[i] > face_count || count > face_count - r->v.face[i]) return false;
        memcpy(r->faces + r->face_count, faces + r->v.face[i], 4 * count);
        r->v.face[i] = (uint32_t)r->face_count;
        r->face_count += count;
    }
    return true;
}

size_t pbs_coarsen_lists(pbs_cell_rows *r, size_t first, size_t n, const uint32_t **faces) {
    *faces = r->faces;
    if (!n) return 0;
    uint32_t from = r->v.face[first];
    size_t to = first + n < r->n ? r->v.face[first + n] : r->face_count;
    for (size_t i = first; i < first + n; i++) r->v.face[i] -= from;
    *faces += from;
    return to - from;
}

void pbs_coarsen_drop_lists(pbs_cell_rows *r, size_t n) {
    uint32_t from = n < r->n ? r->v.face[n] : (uint32_t)r->face_count;
    size_t rest = r->face_count - from;
    for (size_t i = n; i < r->n; i++) r->v.face[i] -= from;
    memmove(r->faces, r->faces + from, 4 * rest);
    memmove(r->face_weight, r->face_weight + from, 4 * rest);
    if (r->face_sum) memmove(r->face_sum, r->face_sum + from, sizeof(f4) * rest);
    r->face_count = rest;
}
