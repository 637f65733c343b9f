/* pack_inner.h: what the parts of pack.h share: the table of nodes, and where their data is. */
#ifndef PBS_PACK_INNER_H
#define PBS_PACK_INNER_H

#include "formats/scene/known.h"
#include "formats/scene/motions.h"
#include "formats/surfels/octaves.h"
#include "formats/archive/pack.h"
#include "formats/scene/scene.h"
#include "formats/archive/voxelpack.h"
#include "libcore/voxels/grid.h"

enum { PACK_NOWHERE = -1 }; /* no input */

typedef enum pack_kind { PACK_SURFELS, PACK_VOXELS, PACK_SCENE, PACK_CLOUD } pack_kind;

typedef struct pack_input {
    pack_kind kind;
    pbs_reader *reader; /* a scene's is the scene's; a cloud has none */
    pbs_scene scene;
    pbs_record record;   /* of surfels; stride 0: there are none */
    uint32_t voxels;     /* channels */
    pbs_motions motions; /* of a stream; a scene has its own */
    const pbs_chunk *entries;
    size_t entry_count;
    size_t first_node, node_count; /* in the table; none: a scene whose meshes are elsewhere */
    bool elsewhere;
    int made_from;      /* of a stream: the scene whose meshes its nodes get */
    uint32_t *material; /* the archive's number of each of its materials */
    uint32_t materials;
    uint32_t *texture; /* and textures */
    uint32_t textures;
} pack_input;

/* A node, and where its data comes from. Children are entries of the table until all is numbered.
 */
typedef struct pack_entry {
    pbs_node node;
    int input;
    uint32_t own;                  /* its number there, for messages */
    size_t first_chunk, end_chunk; /* its data is among these of the input's directory */
    bool has_points;
    uint64_t octaves;          /* entries of them; 0: it has none */
    pbs_voxel_survey voxels;   /* voxels 0: it has none */
    int mesh_input;            /* whose materials its meshes name, or PACK_NOWHERE */
    pbs_reader *mesh_reader;   /* where they are */
    const pbs_chunk *mesh;     /* chunks among which they are, */
    size_t mesh_count;         /* as many */
    double shift[3];           /* added to their positions */
    const pbs_node *mesh_node; /* of the scene that they are from; NULL: of this node */
    int mesh_exponent;         /* of their lattice's step, if there are lattices (meshbits.h) */
    uint32_t same;             /* the entry that stands for it: itself, or an equal one */
    uint32_t number;           /* in the archive, if it stands for itself */
} pack_entry;

/* What was stored before, by what its chunk says; known.h has the hash table. */
typedef struct pack_look {
    const pbs_chunk *chunk;
    pbs_reader *reader;
    int input;
} pack_look;

struct pbs_pack {
    pbs_run *run;
    pack_input *inputs;
    int input_count;
    size_t input_cap;
    pack_entry *entries;
    size_t entry_count, entry_cap;
    pbs_cloud *clouds;
    size_t cloud_count, cloud_cap;
    int cloud_input;
    pbs_cloudpack_parts *cloud;
    uint32_t first_cloud_node, node_count; /* of the archive */
    pbs_record out;                        /* of its points */
    uint32_t out_voxels;
    bool has_root;         /* the last entry places the inputs' roots */
    uint64_t *voxel_order; /* level and entry */
    size_t voxel_nodes;
    pack_look *materials, *textures; /* that are written, by their numbers */
    size_t material_count, material_cap, texture_count, texture_cap;
    const char **animations; /* names, which are the inputs' */
    pbs_motion *motions;     /* with channels of their own, and keys of the inputs */
    size_t animation_count, animation_cap, motion_count, motion_cap;
    pbs_reader **spools; /* meshes by chunks of cells */
    size_t spool_count, spool_cap;
    uint8_t *payload; /* of a mesh that is changed */
    size_t payload_cap;
    unsigned mesh_bits; /* 0: meshes stay exact */
    pbs_trim trim;      /* of the inputs' maps */
    uint64_t others;    /* chunks that this program does not know */
    pbs_writer *w;
    pbs_pack_stats stats;
};

static inline bool pack_is_material(uint32_t tag) {
    return tag == PBS_TAG_MATERIAL || tag == PBS_TAG_TEXTURE;
}
/* Data of nodes; what is neither this nor above nor a NODE, CNTS, ANIM or MOTN is somebody
 * else's. */
static inline bool pack_is_data(uint32_t tag) {
    return tag == PBS_TAG_POINTS || tag == PBS_TAG_OCTAVES || tag == PBS_TAG_VOXELS ||
           tag == PBS_TAG_FACES || tag == PBS_TAG_MESH;
}
static inline bool pack_is_other(uint32_t tag) {
    return !pack_is_data(tag) && !pack_is_material(tag) && tag != PBS_TAG_NODE &&
           tag != PBS_TAG_COUNTS && !pbs_is_motion(tag);
}
static inline bool pack_is_kept(const pbs_pack *p, size_t entry) {
    return p->entries[entry].same == entry;
}
static inline pbs_voxel_source pack_voxel_source(const pbs_pack *p, const pack_entry *e) {
    const pack_input *in = &p->inputs[e->input];
    return (pbs_voxel_source){in->reader,   in->voxels,   in->entries,  e->first_chunk,
                              e->end_chunk, in->material, in->materials};
}

/* pack_take.c: the nodes of an input, which is open, to the table. */
pbs_code pack_take(pbs_pack *p, int input, pbs_err *err);
/* pack_match.c: which stream each scene is known in; then what has no nodes brings some, or gives
 * them meshes. */
pbs_code pack_match(pbs_pack *p, pbs_err *err);
/* pack_cells.c: the triangles of a scene near the nodes of a stream of voxels, into a spool. grid:
 * of the stream. */
pbs_code pack_cells(pbs_pack *p, int scene, int voxels, const pbs_grid *grid, pbs_err *err);
/* pack_look.c: materials and textures: numbered, written. */
pbs_code pack_look_number(pbs_pack *p, pbs_err *err);
pbs_code pack_write_materials(pbs_pack *p, pbs_err *err);
pbs_code pack_write_textures(pbs_pack *p, pbs_err *err);
/* pack_motion.c: motions, and the nodes' numbers of them, when all nodes are in the table. */
pbs_code pack_motions(pbs_pack *p, pbs_err *err);
pbs_code pack_write_motions(pbs_pack *p, pbs_err *err);
void pack_free_motions(pbs_pack *p);
/* pack_same.c: equal nodes get one that stands for them. */
pbs_code pack_same(pbs_pack *p, pbs_err *err);
/* pack_points.c: surfels of a node: its lattice, which must be known before all; and written. */
pbs_code pack_choose_lattice(pbs_pack *p, pack_entry *e, pbs_err *err);
pbs_code pack_write_points(pbs_pack *p, const pack_entry *e, pbs_err *err);
/* pack_mesh.c: the meshes of a node; the steps of all lattices, before any is written. */
uint64_t pack_mesh_chunks(const pack_entry *e);
pbs_code pack_choose_steps(pbs_pack *p, pbs_err *err);
pbs_code pack_write_meshes(pbs_pack *p, const pack_entry *e, pbs_err *err);
#endif
