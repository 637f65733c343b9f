/* known.h: what the writer of a scene keeps of the nodes that are written: enough to place them,
 * and to see that a new one is the same as an earlier one. About 120 bytes a node.
 *
 * Equal nodes are one, though their names may differ. Then the later one gets an id of its own, an
 * alias, which stands for the earlier node and remembers the name for placings that have none.
 */
#ifndef PBS_KNOWN_H
#define PBS_KNOWN_H

#include "formats/container/digest.h"
#include "libcore/gbuffer/extent.h"
#include "libcore/ground/run.h"

#define PBS_ALIAS_BIT 0x80000000u /* in ids of aliases */

typedef struct pbs_known_node {
    uint64_t triangles;
    pbs_extent extent;
    pbs_digest digest;
    uint64_t name; /* its digest */
} pbs_known_node;

typedef struct pbs_alias {
    uint32_t node;
    char *name;
} pbs_alias;

typedef struct pbs_known {
    pbs_run *run;
    pbs_known_node *node;
    size_t count, room;
    uint32_t *slot; /* node + 1, by digest; a power of two of them */
    size_t slots;
    pbs_alias *alias;
    size_t aliases, alias_room;
} pbs_known;

/* The next node; its id is the count before. Errors: PBS_LIMIT. */
pbs_code pbs_known_add(pbs_known *k, const pbs_known_node *node, pbs_err *err);
/* The first node with that digest, under that name: *id is its id or an alias. False: none. */
pbs_code pbs_known_find(pbs_known *k, const pbs_digest *digest, const char *name, bool *found,
                        uint32_t *id, pbs_err *err);
/* The node that an id stands for, and the alias's name ("" if it is none); false: no such id. */
bool pbs_known_resolve(const pbs_known *k, uint32_t id, uint32_t *node, const char **name);
void pbs_known_free(pbs_known *k);
#endif
