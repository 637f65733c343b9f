/* voxelpack.h: a node's voxels from a stream to an archive: in as few chunks as can be, so that
 * each array of a node goes to the GPU in one piece, and without weights, which only simplification
 * needs. */
#ifndef PBS_VOXELPACK_H
#define PBS_VOXELPACK_H

#include "formats/voxels/voxels.h"

/* One node of a mapped stream; all is borrowed. */
typedef struct pbs_voxel_source {
    pbs_reader *reader;
    uint32_t channels;        /* of the stream */
    const pbs_chunk *entries; /* of its directory */
    size_t first, end;        /* the node's chunks are among these */
    const uint32_t *material; /* the new number of each of its materials */
    uint32_t materials;       /* how many there are; a survey does not need them */
} pbs_voxel_source;

typedef struct pbs_voxel_survey {
    pbs_voxel_place place;
    uint64_t voxels, faces;
    bool colour; /* what the entries for faces are */
} pbs_voxel_survey;

/* Reads and verifies all of the node's voxels. Errors: PBS_DATA. */
pbs_code pbs_voxels_survey(const pbs_voxel_source *s, pbs_voxel_survey *out, pbs_err *err);

/* Chunks that pbs_voxels_pack writes. */
uint64_t pbs_voxels_pack_chunks(const pbs_voxel_survey *survey);

/* Writes the node as number `node` with those channels, weight not among them. What the stream
 * lacks is white, rough, not metallic, dark, without a normal (0) and without attributes of faces
 * (PBS_NONE). Takes memory for one chunk. Errors: PBS_DATA for a material that is not there;
 * PBS_LIMIT, PBS_IO. */
pbs_code pbs_voxels_pack(pbs_run *run, const pbs_voxel_source *s, const pbs_voxel_survey *survey,
                         pbs_writer *w, uint32_t node, uint32_t channels, pbs_err *err);
#endif
