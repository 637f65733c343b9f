/* dag.h: walks the DAG of nodes as the tree of placings that it stands for. */
#ifndef PBS_DAG_H
#define PBS_DAG_H

#include "formats/node.h"

/* visit is called for every placing, parents first, children in order, with the transform from
 * the node's coordinates to the root's; what it returns in *descend decides whether the node's
 * children follow. No recursion: hierarchies may be deeper than the stack. */
pbs_code pbs_dag_walk(pbs_run *run, const pbs_node *nodes, size_t count,
                      pbs_code (*visit)(void *ctx, uint32_t node, const double m[12], bool *descend,
                                        pbs_err *err),
                      void *ctx, pbs_err *err);

/* How often things are placed below each node, when node i itself has own(ctx, i) of them; a walk
 * that leaves out subtrees with none of them ends even if 64 levels of two equal children each
 * place an empty node 2^64 times. Saturates at UINT64_MAX. *out: an array of count, for pbs_free.
 */
pbs_code pbs_dag_count(pbs_run *run, const pbs_node *nodes, size_t count,
                       uint64_t (*own)(const void *ctx, uint32_t node), const void *ctx,
                       uint64_t **out, pbs_err *err);
#endif
