/* quality.h: what pbs-sample says of a node beside its surfels: octaves and measures. */
#ifndef PBS_QUALITY_H
#define PBS_QUALITY_H
#include "cmd/tool.h"
#include "formats/container/cache.h"
#include "formats/scene/node.h"
#include "formats/surfels/octaves.h"

typedef struct pbs_quality {
    pbs_run *run;
    bool octaves;        /* write them */
    const char *measure; /* file of measures, or NULL */
    float normal_weight;
    pbs_cache *cache;  /* or NULL */
    pbs_cache_key key; /* of the octaves of the node at hand */
    bool found;        /* they are in entries already */
    pbs_averager *averager;
    pbs_points entries; /* of the node at hand */
    size_t cap;
    pbs_output table;
    bool table_open;
} pbs_quality;

/* run, octaves, measure, normal_weight and cache are set; nothing else. */
pbs_code pbs_quality_open(pbs_quality *q, pbs_err *err);

/* Bytes that a node may take at the most, for pbs_mem_plan. */
size_t pbs_quality_need(const pbs_quality *q, uint32_t channels, size_t candidates, size_t surfels);

/* With a cache, before the node is sampled: key is that of its order. */
void pbs_quality_key(pbs_quality *q, const pbs_cache_key *key, const pbs_points *candidates);
/* Whether an order that was found there will do: its octaves, which need what the sampler leaves,
 * are there too, or it has none. */
pbs_code pbs_quality_find(pbs_quality *q, const pbs_points *candidates, size_t surfels, bool *found,
                          pbs_err *err);

/* After the node's points are written and before the node; the sampler has just made the order,
 * or pbs_quality_find has just said yes. */
pbs_code pbs_quality_node(pbs_quality *q, pbs_writer *w, const pbs_node *node, pbs_sampler *sampler,
                          const pbs_points *candidates, const uint32_t *order, const float *spacing,
                          size_t surfels, pbs_err *err);

/* The table gets its name. */
pbs_code pbs_quality_commit(pbs_quality *q, pbs_err *err);
void pbs_quality_close(pbs_quality *q);
#endif
