/* archive.h: an archive, opened for the player.
 *
 * The channels line of an archive is that of its surfels, that of its voxels, or both, one behind
 * the other: a record of surfels begins with position, one of voxels with place.
 */
#ifndef PBS_FORMAT_ARCHIVE_H
#define PBS_FORMAT_ARCHIVE_H

#include "formats/node.h"
#include "formats/octaves.h"
#include "formats/points.h"
#include "formats/voxels.h"

typedef struct pbs_archive {
    pbs_run *run;
    pbs_reader *reader;
    pbs_record record;       /* stride 0: it has no surfels */
    uint32_t voxel_channels; /* 0: it has no voxels */
    pbs_node *nodes;         /* the last is the root */
    size_t node_count;
    const uint8_t **records; /* of each node, one after the other; NULL: it has none */
    pbs_voxels *voxels;      /* chunks of all nodes, as they lie in the map */
    size_t *voxels_end;      /* node i's end there, and begin where those of node i - 1 end */
    uint64_t *placings;      /* of nodes with surfels or voxels, below and including each node */
    uint64_t *moving;        /* placings that an animation moves, below each node */
    uint8_t **joined;        /* own copies of those that the file has in several chunks */
    pbs_record octave;       /* an entry of theirs; stride 0: there are none in the file */
    const uint8_t **octaves; /* of each node, all entries; NULL: it has none */
    uint8_t **joined_octaves;
} pbs_archive;

/* Of an archive, or a stream of voxels, in which all is there too. path NULL: standard input, which
 * is spooled. Reads everything; what the values of surfels and voxels are is not looked at. */
pbs_code pbs_archive_open(pbs_run *run, const char *path, pbs_archive *out, pbs_err *err);
void pbs_archive_close(pbs_archive *a);

/* The chunks of a node's voxels, and how many; 0: it has none. */
static inline const pbs_voxels *pbs_archive_voxels(const pbs_archive *a, uint32_t node,
                                                   size_t *count) {
    size_t first = node ? a->voxels_end[node - 1] : 0;
    *count = a->voxels_end[node] - first;
    return a->voxels + first;
}

/* The channels line. points->channels 0, voxels 0: it has none of them. */
void pbs_archive_text(const pbs_record *points, uint32_t voxels, char out[512]);
/* Errors: PBS_DATA for channels this program does not know. place: the file. */
pbs_code pbs_archive_parse(const char *place, const char *text, pbs_record *points,
                           uint32_t *voxels, pbs_err *err);
#endif
