/* dag.h: walks the DAG of nodes as the tree of placings that it stands for. */
#ifndef PBS_DAG_H
#define PBS_DAG_H

#include "formats/scene/node.h"

/* Called for every placing, parents first, children in order: m takes the node's coordinates to the
 * top's, flags are those of the placing (of the top: 0). What it returns in *descend decides
 * whether the node's children follow. */
typedef pbs_code (*pbs_visit_fn)(void *ctx, uint32_t node, const double m[12], uint32_t flags,
                                 bool *descend, pbs_err *err);

/* From the last of `count` nodes down. No recursion: hierarchies may be deeper than the stack. */
pbs_code pbs_dag_walk(pbs_run *run, const pbs_node *nodes, size_t count, pbs_visit_fn visit,
                      void *ctx, pbs_err *err);

/* The same with motions in their poses (pbs_pose_of). */
pbs_code pbs_dag_walk_posed(pbs_run *run, const pbs_node *nodes, size_t count,
                            const double (*pose)[12], pbs_visit_fn visit, void *ctx, pbs_err *err);

/* How often things are placed below each node, when node i itself has own(ctx, i) of them; a walk
 * that leaves out subtrees with none of them ends even if 64 levels of two equal children each
 * place an empty node 2^64 times. Saturates at UINT64_MAX. *out: an array of count, for pbs_free.
 */
pbs_code pbs_dag_count(pbs_run *run, const pbs_node *nodes, size_t count,
                       uint64_t (*own)(const void *ctx, uint32_t node), const void *ctx,
                       uint64_t **out, pbs_err *err);
#endif
