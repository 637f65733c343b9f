/* source.h: the items of an archive as they lie in the GPU's memory.
 *
 *     surfels   the node's records, and behind them the entries of its octaves, as in the file
 *     voxels    an array of 4 bytes a voxel for each channel that is drawn: place, normal, colour,
 *               material, emissive, face; then the faces' attributes
 *     mesh      the payloads of the MESH chunks, each beginning at a multiple of 64
 *
 * An item that is larger than a buffer may be has parts, each like an item of its own: surfels with
 * the entries of theirs of every octave; voxels, and a last part with the faces' attributes of all
 * of them; some of the chunks.
 */
#ifndef PBS_SOURCE_H
#define PBS_SOURCE_H

#include "cmd/pbs-view/store.h"
#include "formats/archive.h"

/* A MESH chunk of an item: where its arrays lie in it, bytes; -1: there is none. */
typedef struct pbs_mesh_part {
    uint32_t part; /* of the item, and places are in it */
    uint32_t vertices, triangles, material;
    int64_t position, normal, uv, colour, index, triangle_material;
} pbs_mesh_part;

typedef struct pbs_source {
    pbs_run *run;
    const pbs_archive *archive;
    uint8_t *has;          /* of each node: PBS_HAS_... */
    uint64_t *bytes;       /* of each item */
    pbs_profile **profile; /* of each node, made when its surfels were loaded first */
    pbs_mesh_part **parts; /* of each node's meshes, likewise; as many as it has MESH chunks */
    bool *face_colours;    /* of each node: its faces' attributes are colours, not materials */
    uint64_t largest;      /* bytes of a part at most; UINT64_MAX: nothing is divided. It may be set
                              until the first item is loaded */
} pbs_source;

/* archive is borrowed until the free. */
pbs_code pbs_source_new(pbs_run *run, const pbs_archive *archive, pbs_source *out, pbs_err *err);
void pbs_source_free(pbs_source *s);

/* For pbs_store_source: ctx is the pbs_source. What it writes into profile, parts and face_colours
 * may be read when the item is resident. */
pbs_code pbs_source_load(void *ctx, uint32_t item, pbs_blob *out, pbs_err *err);

/* Likewise: bytes of an item's part; 0: it has only so many. */
uint64_t pbs_source_part(void *ctx, uint32_t item, uint32_t k);

/* Records of the node in each of its parts but the last: all of them where it is not divided. */
uint32_t pbs_source_each(const pbs_source *s, uint32_t node);
/* Where the octaves' entries lie in part k of a node's surfels, bytes; 0: it has none. */
uint64_t pbs_source_octaves(const pbs_source *s, uint32_t node, uint32_t k);
/* Where the array of a channel of the node's voxels (PBS_POSITION: place, ..., PBS_FACE), or, with
 * 0, that of the faces' attributes, lies in part k, in words; -1: there is none. */
int32_t pbs_source_voxels(const pbs_source *s, uint32_t node, uint32_t k, uint32_t channel);
/* The part that the faces' attributes are in: 0 where the node is not divided. */
uint32_t pbs_source_faces(const pbs_source *s, uint32_t node);
#endif
