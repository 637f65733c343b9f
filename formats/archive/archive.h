/* archive.h: an archive, opened for the player: what is in it at once, its data when it is asked
 * for (DESIGN section 3).
 *
 * Opening reads the header, the directory, and the chunks of nodes, motions and materials: its cost
 * is that of the index, whatever the file's size. Everything else lies in chunks of data, each of
 * one node and one sort, which any thread fetches when it wants it.
 *
 * The channels line of an archive is that of its surfels, that of its voxels, or both, one behind
 * the other: a record of surfels begins with position, one of voxels with place.
 */
#ifndef PBS_FORMAT_ARCHIVE_H
#define PBS_FORMAT_ARCHIVE_H

#include "formats/scene/motions.h"
#include "formats/surfels/octaves.h"
#include "formats/surfels/points.h"
#include "formats/voxels/voxels.h"

/* Sorts of data. A node has points or voxels or neither, and meshes besides: they are the finest
 * level of the node itself, for close views. Node.records counts points or voxels, never a mesh. */
typedef enum pbs_sort {
    PBS_SORT_POINTS,  /* PNTS: records; the first N of a node are its prefix */
    PBS_SORT_OCTAVES, /* OCTV: all entries that its number of points asks for */
    PBS_SORT_VOXELS,  /* VOXL */
    PBS_SORT_FACES,   /* VFAC */
    PBS_SORT_MESHES,  /* MESH */
    PBS_SORTS
} pbs_sort;

typedef struct pbs_archive {
    pbs_run *run;
    pbs_reader *reader;
    pbs_record record;       /* of points; stride 0: it has none */
    pbs_record octave;       /* an entry of theirs; stride 0: there are none in the file */
    uint32_t voxel_channels; /* 0: it has no voxels */
    pbs_node *nodes;         /* the last is the root */
    size_t node_count;
    pbs_material *materials; /* without their names */
    size_t material_count;
    const pbs_chunk *chunks; /* the directory: every chunk of the file, without payloads */
    size_t chunk_count;
    uint32_t *data;  /* numbers of chunks: by node, there by sort, there as in the file */
    uint32_t *begin; /* PBS_SORTS * node_count + 1: where those of a node and sort begin in data */
    uint32_t
        *textures; /* numbers of the TEXR chunks. None: those that materials name are not here */
    size_t texture_count;
    pbs_motions motions; /* keys point into the map */
    uint64_t *placings;  /* of nodes with any data, below and including each node */
    uint64_t *moving;    /* placings that an animation moves, below each node */
} pbs_archive;

/* Of an archive, or a stream of voxels, in which all is there too. path NULL: standard input, which
 * is spooled. What the directory says of the data is checked here, so that it can be believed:
 * every chunk of data belongs to a node that can have it, those of a node and sort go on where the
 * last one ended, sizes fit counts, and the counts add up to the node's records. Errors: PBS_DATA.
 */
pbs_code pbs_archive_open(pbs_run *run, const char *path, pbs_archive *out, pbs_err *err);
void pbs_archive_close(pbs_archive *a);

/* The chunks of a node and sort, in the order of the file: *count numbers, for pbs_archive_fetch
 * and for a->chunks, whose count and first are those of the node's records in it. */
static inline const uint32_t *pbs_archive_list(const pbs_archive *a, uint32_t node, pbs_sort sort,
                                               size_t *count) {
    const uint32_t *b = a->begin + (size_t)node * PBS_SORTS + sort;
    *count = b[1] - b[0];
    return a->data + b[0];
}
static inline bool pbs_archive_has(const pbs_archive *a, uint32_t node, pbs_sort sort) {
    const uint32_t *b = a->begin + (size_t)node * PBS_SORTS + sort;
    return b[1] != b[0];
}

/* ---- one chunk ---- */

typedef struct pbs_fetched {
    pbs_chunk chunk;       /* with its payload, aligned to 64: count records, or entries, or ... */
    pbs_voxel_place place; /* of voxels */
    pbs_voxels voxels;     /* points into the payload */
    pbs_mesh mesh;         /* likewise */
    void *own;             /* a decoded payload; NULL: it lies in the map */
} pbs_fetched;

/* Chunk number `chunk` of the file, any chunk but those that open read: reads it, verifies its
 * checksum, decodes it, and checks that it is what the directory says, and what opening promised:
 * sizes, the place of voxels, and of meshes that every number in them can be believed. What the
 * values of points and voxels are is not looked at (every one of them is a point or a voxel).
 * Thread-safe between open and close; memory is counted in the archive's run. Give it back with
 * pbs_archive_release, from any thread; after an error there is nothing to give back. */
pbs_code pbs_archive_fetch(const pbs_archive *a, uint32_t chunk, pbs_fetched *out, pbs_err *err);
void pbs_archive_release(const pbs_archive *a, pbs_fetched *f);

/* Bytes of its payload when it is decoded; of chunks with a codec other than meshes' the directory
 * is enough, of meshes the chunk's header is read. 0: that is damaged. */
uint64_t pbs_archive_bytes(const pbs_archive *a, uint32_t chunk);

/* The first n records of a node's points, n <= its records, to `to`, which has n * record.stride
 * bytes. Of the file only those are read, and the header of each chunk; of a chunk with a codec the
 * blocks in which they are (codec.h). *verified: false if the last one was not read to its end, and
 * so its checksum does not say whether the bytes are good. Any bits are points, so that nothing
 * worse than a wrong picture can come of it; bytes that cannot be unpacked are PBS_DATA.
 * Thread-safe. */
pbs_code pbs_archive_prefix(const pbs_archive *a, uint32_t node, uint64_t n, void *to,
                            bool *verified, pbs_err *err);

/* ---- all of a node, but its meshes ---- */

typedef struct pbs_node_data {
    uint8_t *records;  /* node.records of them, if they are points; NULL: it has none */
    uint8_t *octaves;  /* all entries; NULL: it has none */
    pbs_voxels voxels; /* node.records of them; count 0: it has none */
    uint32_t *faces;   /* what voxels.face points to; NULL: it has none */
    size_t face_count;
    bool face_colours; /* faces are colours, not materials */
} pbs_node_data;

/* Fetches everything and puts it together, in arrays of its own. Thread-safe. */
pbs_code pbs_archive_load_node(const pbs_archive *a, uint32_t node, pbs_node_data *out,
                               pbs_err *err);
void pbs_node_data_free(const pbs_archive *a, pbs_node_data *d);

/* ---- the channels line ---- */

/* points->channels 0, voxels 0: it has none of them. */
void pbs_archive_text(const pbs_record *points, uint32_t voxels, char out[512]);
/* Errors: PBS_DATA for channels this program does not know. place: the file. */
pbs_code pbs_archive_parse(const char *place, const char *text, pbs_record *points,
                           uint32_t *voxels, pbs_err *err);
#endif
