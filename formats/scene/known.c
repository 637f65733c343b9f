#include "formats/scene/known.h"
#include <string.h>

static uint32_t *slot_of(const pbs_known *k, const pbs_digest *d) {
    size_t i = (size_t)d->h[0] & (k->slots - 1);
    while (k->slot[i] && memcmp(&k->node[k->slot[i] - 1].digest, d, sizeof *d))
        i = (i + 1) & (k->slots - 1);
    return &k->slot[i];
}

static pbs_code grow_slots(pbs_known *k, pbs_err *err) {
    size_t slots = k->slots ? 2 * k->slots : 256;
    uint32_t *fresh;
    pbs_code rc = pbs_alloc(k->run, &fresh, slots, sizeof *fresh, "the table of nodes", err);
    if (rc) return rc;
    memset(fresh, 0, slots * sizeof *fresh);
    pbs_free(k->run, k->slot);
    k->slot = fresh;
    k->slots = slots;
    for (size_t i = 0; i < k->count; i++) {
        uint32_t *slot = slot_of(k, &k->node[i].digest);
        if (!*slot) *slot = (uint32_t)i + 1;
    }
    return PBS_OK;
}

pbs_code pbs_known_add(pbs_known *k, const pbs_known_node *node, pbs_err *err) {
    if (k->count + 1 >= PBS_ALIAS_BIT) return pbs_fail(err, PBS_LIMIT, "too many nodes");
    pbs_code rc = 3 * k->count >= 2 * k->slots ? grow_slots(k, err) : PBS_OK;
    if (!rc)
        rc = pbs_grow(k->run, &k->node, &k->room, k->count + 1, sizeof *k->node,
                      "the table of nodes", err);
    if (rc) return rc;
    k->node[k->count++] = *node;
    uint32_t *slot = slot_of(k, &node->digest);
    if (!*slot) *slot = (uint32_t)k->count;
    return PBS_OK;
}

static pbs_code add_alias(pbs_known *k, uint32_t node, const char *name, uint32_t *id,
                          pbs_err *err) {
    size_t n = strlen(name) + 1;
    if (k->aliases + 1 >= PBS_ALIAS_BIT) return pbs_fail(err, PBS_LIMIT, "too many nodes");
    pbs_code rc = pbs_grow(k->run, &k->alias, &k->alias_room, k->aliases + 1, sizeof *k->alias,
                           "the names of equal nodes", err);
    if (rc) return rc;
    pbs_alias a = {.node = node};
    rc = pbs_alloc(k->run, &a.name, n, 1, "the names of equal nodes", err);
    if (rc) return rc;
    memcpy(a.name, name, n);
    *id = PBS_ALIAS_BIT | (uint32_t)k->aliases;
    k->alias[k->aliases++] = a;
    return PBS_OK;
}

pbs_code pbs_known_find(pbs_known *k, const pbs_digest *digest, const char *name, bool *found,
                        uint32_t *id, pbs_err *err) {
    uint32_t slot = k->slots ? *slot_of(k, digest) : 0;
    *found = slot != 0;
    if (!slot) return PBS_OK;
    *id = slot - 1;
    if (!name || !*name || k->node[*id].name == pbs_digest_text(name)) return PBS_OK;
    return add_alias(k, *id, name, id, err);
}

bool pbs_known_resolve(const pbs_known *k, uint32_t id, uint32_t *node, const char **name) {
    bool alias = id & PBS_ALIAS_BIT;
    size_t i = id & ~PBS_ALIAS_BIT;
    if (i >= (alias ? k->aliases : k->count)) return false;
    *node = alias ? k->alias[i].node : id;
    *name = alias ? k->alias[i].name : "";
    return true;
}

void pbs_known_free(pbs_known *k) {
    for (size_t i = 0; i < k->aliases; i++) pbs_free(k->run, k->alias[i].name);
    pbs_free(k->run, k->alias);
    pbs_free(k->run, k->node);
    pbs_free(k->run, k->slot);
}
