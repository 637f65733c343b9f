/* block_faces.c: attributes of faces (paper 2, section 3, its figure 3), in a table of cells, or of
 * cells and materials. Weights are exact sums again, and have 20 bits behind the unit of areas, so
 * that what merely touches a cell can have one. */
#include "libcore/voxels/block_inner.h"

enum { TOUCH_BITS = 20, ALL = 6 };

void pbs_face_sums_init(pbs_face_sums *s, pbs_run *run, bool colour) {
    *s = (pbs_face_sums){.run = run, .colour = colour};
    s->bytes = sizeof(pbs_face_entry) + (colour ? 24 * sizeof(pbs_sum128) : 0);
}
void pbs_face_sums_free(pbs_face_sums *s) {
    pbs_free(s->run, s->key);
    pbs_free(s->run, s->entry);
}
void pbs_face_sums_begin(pbs_face_sums *s) {
    if (s->key_count) memset(s->key, 0, s->keys * sizeof *s->key);
    s->key_count = s->count = 0;
    s->rc = PBS_OK;
}

static pbs_face_entry *entry_at(const pbs_face_sums *s, uint32_t i) {
    return (void *)(s->entry + i * s->bytes);
}

/* Keys are never 0: a cell's code is that of a brick of the block, and the first such is not 0. */
static uint64_t key_of_cell(uint32_t code) {
    return (uint64_t)code << 33;
}
static uint64_t key_of_both(uint32_t code, uint32_t material) {
    return (uint64_t)code << 33 | UINT64_C(1) << 32 | material;
}

static pbs_face_key *find(const pbs_face_sums *s, uint64_t key) {
    uint64_t h = key * UINT64_C(0x9e3779b97f4a7c15);
    size_t i = (h ^ h >> 32) & (s->keys - 1);
    while (s->key[i].key && s->key[i].key != key) i = (i + 1) & (s->keys - 1);
    return &s->key[i];
}

/* Room for two more keys and an entry. */
static bool has_room(pbs_face_sums *s) {
    if (!s->rc)
        s->rc = pbs_grow(s->run, &s->entry, &s->entry_cap, (size_t)s->count + 1, s->bytes,
                         "attributes of faces", &s->err);
    if (s->rc) return false;
    if (2 * (s->key_count + 2) <= s->keys) return true;
    pbs_face_sums old = *s;
    s->keys = old.keys ? 2 * old.keys : 4096;
    s->rc = pbs_alloc(s->run, &s->key, s->keys, sizeof *s->key, "attributes of faces", &s->err);
    if (s->rc) {
        s->key = old.key, s->keys = old.keys;
        return false;
    }
    memset(s->key, 0, s->keys * sizeof *s->key);
    for (size_t i = 0; i < old.keys; i++)
        if (old.key[i].key) *find(s, old.key[i].key) = old.key[i];
    pbs_free(s->run, old.key);
    return true;
}

static pbs_face_entry *make(pbs_face_sums *s, uint32_t code, uint32_t material, pbs_face_key *key) {
    pbs_face_entry *e = entry_at(s, s->count);
    memset(e, 0, s->bytes);
    e->material = material;
    e->next = PBS_NONE;
    *key = (pbs_face_key){s->colour ? key_of_cell(code) : key_of_both(code, material), s->count};
    s->key_count++;
    if (!s->colour) {
        pbs_face_key *first = find(s, key_of_cell(code));
        if (first->key)
            e->next = first->entry;
        else
            s->key_count++;
        *first = (pbs_face_key){key_of_cell(code), s->count};
    }
    s->count++;
    return e;
}

void pbs_face_sums_add(pbs_face_sums *s, uint32_t code, uint32_t material, uint8_t faces,
                       int64_t area, const double normal[3], const int32_t *light) {
    if (!has_room(s)) return;
    pbs_face_key *key = find(s, s->colour ? key_of_cell(code) : key_of_both(code, material));
    pbs_face_entry *e = key->key ? entry_at(s, key->entry) : make(s, code, material, key);
    e->weight[ALL] += ((pbs_sum128)area << TOUCH_BITS) + 1;
    for (int f = 0; f < 6; f++) {
        if (!(faces >> f & 1)) continue;
        int64_t across = (int64_t)((double)area * fabs(normal[f / 2]) + 0.5);
        pbs_sum128 w = ((pbs_sum128)across << TOUCH_BITS) + 1;
        e->weight[f] += w;
        for (int k = 0; k < 4 && s->colour; k++) e->light[4 * f + k] += w * (pbs_sum128)light[k];
    }
}

/* The heaviest in a column of weights; ties to the lower material. */
static uint32_t heaviest(const pbs_face_sums *s, uint32_t first, int column) {
    uint32_t best = PBS_NONE;
    pbs_sum128 most = 0;
    for (uint32_t i = first; i != PBS_NONE; i = entry_at(s, i)->next) {
        const pbs_face_entry *e = entry_at(s, i);
        if (e->weight[column] < most || !e->weight[column]) continue;
        if (e->weight[column] == most && e->material >= best) continue;
        best = e->material, most = e->weight[column];
    }
    return most ? best : PBS_NONE;
}

static bool column_is_empty(const pbs_face_sums *s, uint32_t first, int column) {
    for (uint32_t i = first; i != PBS_NONE; i = entry_at(s, i)->next)
        if (entry_at(s, i)->weight[column]) return false;
    return true;
}

uint32_t pbs_face_material(const pbs_face_sums *s, uint32_t code, int face) {
    const pbs_face_key *key = s->keys ? find(s, key_of_cell(code)) : NULL;
    if (!key || !key->key) return PBS_NONE;
    return heaviest(s, key->entry, column_is_empty(s, key->entry, face) ? ALL : face);
}

bool pbs_face_light(const pbs_face_sums *s, uint32_t code, int face, double out[4]) {
    const pbs_face_key *key = s->keys ? find(s, key_of_cell(code)) : NULL;
    const pbs_face_entry *e = key && key->key ? entry_at(s, key->entry) : NULL;
    if (!e || !e->weight[face]) return false;
    for (int k = 0; k < 4; k++) out[k] = (double)e->light[4 * face + k] / (double)e->weight[face];
    return true;
}
