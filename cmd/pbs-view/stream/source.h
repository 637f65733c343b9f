/* source.h: the items of an archive as they lie in the GPU's memory.
 *
 *     surfels   the node's records, and behind them the entries of its octaves, as in the file
 *     voxels    an array of 4 bytes a voxel for each channel that is drawn: place, normal, colour,
 *               material, emissive, face; then the faces' attributes
 *     mesh      the payloads of the MESH chunks, each beginning at a multiple of 64, their
 *               triangles sorted so that those of one textured material are neighbours
 *     texture   its levels (mips.h), decoded; items of their own behind those of the nodes: two of
 *               each image, as linear numbers and as sRGB
 *
 * An item that is larger than a buffer may be has parts, each like an item of its own: surfels with
 * the entries of theirs of every octave; voxels, and a last part with the faces' attributes of all
 * of them; some of the chunks. A texture is never divided.
 */
#ifndef PBS_SOURCE_H
#define PBS_SOURCE_H

#include "cmd/pbs-view/draw/mips.h"
#include "cmd/pbs-view/stream/store.h"
#include "formats/archive/archive.h"

/* Triangles of a MESH chunk of an item: where its arrays lie in it, bytes; -1: there is none. */
typedef struct pbs_mesh_part {
    uint32_t part; /* of the item, and places are in it */
    uint32_t first, triangles, material;
    uint32_t look; /* the material of all, which has textures; PBS_NONE: they have none */
    int64_t position, normal, uv, colour, index, triangle_material;
} pbs_mesh_part;

typedef struct pbs_node_mesh {
    pbs_mesh_part *parts;
    uint32_t *textures; /* items of those that it is drawn with, each once */
    size_t part_count, part_cap, texture_count, texture_cap;
} pbs_node_mesh;

typedef struct pbs_source {
    pbs_run *run;
    const pbs_archive *archive;
    uint8_t *has;          /* of each node: PBS_HAS_... */
    size_t items;          /* of nodes, and of textures behind them */
    uint64_t *bytes;       /* of each item; of textures expected */
    pbs_profile **profile; /* of each node, made when its surfels were loaded first */
    pbs_node_mesh **mesh;  /* of each node, likewise */
    bool *face_colours;    /* of each node: its faces' attributes are colours, not materials */
    pbs_mips *mips;        /* of each texture's item, made when it was loaded */
    /* What is larger loses its finest levels; set before anything is loaded. */
    uint32_t largest_side;
    uint64_t largest_texture; /* bytes */
    uint64_t largest; /* bytes of a part at most; UINT64_MAX: nothing is divided. It may be set
                         until the first item is loaded */
} pbs_source;

/* archive is borrowed until the free. */
pbs_code pbs_source_new(pbs_run *run, const pbs_archive *archive, pbs_source *out, pbs_err *err);
void pbs_source_free(pbs_source *s);

/* For pbs_store_source: ctx is the pbs_source. What it writes into profile, mesh, face_colours and
 * mips may be read when the item is resident; mips already when it is uploaded. */
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

/* The item of texture number `texture`, below those of the archive. */
static inline uint32_t pbs_source_texture(const pbs_source *s, uint32_t texture, bool srgb) {
    return (uint32_t)(2 * (s->archive->node_count + texture) + srgb);
}
static inline pbs_mips *pbs_source_mips(const pbs_source *s, uint32_t item) {
    return &s->mips[item - 2 * s->archive->node_count];
}
/* The three items of a material: base, material, emission; PBS_NONE: it has no such texture. */
void pbs_source_look(const pbs_source *s, const pbs_material *m, uint32_t item[3]);

/* ---- source_mesh.c, source_texture.c: parts of pbs_source_load ---- */

/* Bytes of the part of a node's meshes that begins at chunk *next of theirs: as many as fit, at
 * least one. *next: that of the next part. */
uint64_t pbs_source_mesh_part(const pbs_source *s, uint32_t node, size_t *next);
pbs_code pbs_source_load_mesh(pbs_source *s, uint32_t node, uint8_t *to, pbs_err *err);
void pbs_source_free_mesh(pbs_run *run, pbs_node_mesh *m); /* NULL is fine */
pbs_code pbs_source_load_texture(pbs_source *s, uint32_t item, pbs_blob *out, pbs_err *err);
/* Bytes of a texture before it was decoded: a guess. */
uint64_t pbs_source_guess(const pbs_source *s, uint32_t texture);
/* Where the next MESH chunk begins behind one of n bytes. */
static inline uint64_t pbs_source_rounded(uint64_t n) {
    return (n + 63) / 64 * 64;
}
#endif
