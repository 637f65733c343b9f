/* archive.h: an archive, opened for the player. */
#ifndef PBS_FORMAT_ARCHIVE_H
#define PBS_FORMAT_ARCHIVE_H

#include "formats/node.h"
#include "formats/octaves.h"
#include "formats/points.h"

typedef struct pbs_archive {
    pbs_run *run;
    pbs_reader *reader;
    pbs_record record;
    pbs_node *nodes; /* the last is the root */
    size_t node_count;
    const uint8_t **records; /* of each node, one after the other; NULL: it has none */
    uint64_t *placings;      /* of nodes with records, below and including each node */
    uint64_t *moving;        /* placings that an animation moves, below each node */
    uint8_t **joined;        /* own copies of those that the file has in several chunks */
    pbs_record octave;       /* an entry of theirs; stride 0: there are none in the file */
    const uint8_t **octaves; /* of each node, all entries; NULL: it has none */
    uint8_t **joined_octaves;
} pbs_archive;

/* path NULL: standard input, which is spooled. Reads and checks everything. */
pbs_code pbs_archive_open(pbs_run *run, const char *path, pbs_archive *out, pbs_err *err);
void pbs_archive_close(pbs_archive *a);
#endif
