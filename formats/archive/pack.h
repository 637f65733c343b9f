/* pack.h: any of surfels, voxels, point clouds and source geometry become one archive, in the order
 * in which a player wants it: what is coarse first, so that every beginning is a model.
 *
 * Inputs. A stream of surfels, a stream of voxels, a scene (a stream, or any file that
 * pbs_scene_open reads), a point cloud (any that pbs_cloud_open reads). What a file is, its bytes
 * say; a PLY file is a scene if it has faces, and a file that is neither known to be a cloud nor a
 * scene is a cloud. All clouds together are one.
 *
 * Nodes. Each input brings its own, in its order, children first; more than one such input gets a
 * root above them, which places each where it is. A scene brings none if it is known in another
 * input, whose nodes get its meshes then, beside their surfels or voxels:
 *
 *   - of surfels, if its nodes are the scene's: as many, with the same children, placings and
 *     triangles, and around the same boxes where they are parts; names do not matter. A mesh
 *     belongs to the node that it had in the scene.
 *   - of voxels, if as many triangles are at its root as the scene has, and its grid holds the
 *     scene. Instances are unfolded: a node of the finest level has each triangle that touches
 *     its cells or the layer of one cell around them.
 *
 * The first stream of each of the two sorts that is the scene's and has no other is taken, and both
 * may be. A scene that nothing is made from becomes a node like the others, with its meshes.
 *
 * Motions (motions.h) of nodes that the archive has come along; animations of several inputs that
 * have the same name are one. Nodes of voxels have none: they are the scene at rest.
 *
 * Order of chunks: NODE; ANIM; MOTN; MATL; points with their octaves (OCTV, PNTS) from the last
 * node to the first; voxels (VOXL, VFAC) from the coarsest level to the finest; MESH, which only
 * close views need, in the same two orders; TEXR; chunks that nobody knows.
 *
 * What is promised. Records of surfels are quantised (quant.h); positions of a cloud are as
 * cloudpack.h says; vertices of meshes move by at most 2^-24 of their distance from the node's
 * origin, or to their lattice; voxels lose their weights, and nothing else of an input is lost, but
 * CNTS. Channels are those of all inputs together, and what a record lacks is white, rough, not
 * metallic, dark and without a normal (PBS_NO_NORMAL; for voxels 0). Materials and textures are
 * numbered anew, equal ones once (of textures the pictures are compared, not the names), and
 * textures that no triangle shows are left out; materials whose textures do not come along name
 * none. Nodes that are equal in all that they say and hold and in their children are stored once.
 * The bytes do not depend on the number of threads, nor on the limit of memory.
 */
#ifndef PBS_PACK_H
#define PBS_PACK_H

#include "formats/archive/cloudpack.h"
#include "formats/container/container.h"
#include "formats/readers/sink.h"

typedef struct pbs_pack_stats {
    uint64_t nodes, same;       /* of the archive; left out because an equal one is there */
    uint64_t surfels, voxels;   /* stored */
    uint64_t meshes, triangles; /* stored, in every node that they are in */
    uint64_t scenes, matched;   /* inputs; those whose meshes went to other inputs' nodes */
    uint64_t homeless; /* triangles, of every instance, that are near no node with voxels */
    uint64_t flat;     /* and so small, or large, that a node's numbers leave nothing of them */
    double mesh_bound; /* how far a corner of a mesh moves to its lattice; 0: there is none */
    uint64_t skipped[PBS_SKIP_KINDS]; /* what of scenes that were imported was no triangle */
    const char *scene;       /* name of the first scene, or NULL; until the pack is freed */
    double error, bound;     /* largest error of a surfel; what is promised */
    pbs_record record;       /* stride 0: there are no points */
    uint32_t voxel_channels; /* 0: there are no voxels */
    bool has_cloud;
    pbs_cloudpack_stats cloud; /* if there is one; its nodes are among `nodes` */
    uint64_t bytes;
} pbs_pack_stats;

typedef struct pbs_pack pbs_pack;

pbs_code pbs_pack_new(pbs_run *run, pbs_pack **out, pbs_err *err);
void pbs_pack_free(pbs_pack *p); /* NULL is fine */

/* Meshes go on lattices (meshbits.h), with at most 2^bits steps along the longest side of a part,
 * or of a chunk of cells; bits up to PBS_MESH_BITS_MOST, 0 (at first): they stay exact. Before
 * pbs_pack_write. */
void pbs_pack_mesh_bits(pbs_pack *p, unsigned bits);

/* One more input, from a path or (NULL, "-") standard input. Scenes are imported, and text of
 * clouds is read; of streams all is read and checked but the values of meshes' vertices. Errors:
 * PBS_DATA, PBS_IO, PBS_LIMIT, PBS_CANCEL. */
pbs_code pbs_pack_add(pbs_pack *p, const char *path, pbs_err *err);

/* Once, after all inputs. desc: path or output, and stage; the rest is filled in. Errors as above,
 * and PBS_USAGE for a terminal. */
pbs_code pbs_pack_write(pbs_pack *p, const pbs_writer_desc *desc, pbs_pack_stats *stats,
                        pbs_err *err);
#endif
