/* splat_internal.h: what splat.c (passes) and splat_table.c (objects, identifiers) share. */
#ifndef PBS_SPLAT_INTERNAL_H
#define PBS_SPLAT_INTERNAL_H

#include "cmd/pbs-view/draw/draw_internal.h"
#include "cmd/pbs-view/plan/numbers.h"
#include "cmd/pbs-view/draw/splat.h"

enum {
    PBS_SPLAT_MARGIN =
        16, /* pixels around the picture: centres outside of it whose discs are not */
    PBS_SPLAT_LARGE = 1 << 20, /* surfels of an object, by scheme */
    PBS_SPLAT_SMALL = 1 << 17,
    PBS_SPLAT_LARGES =
        1 << 11, /* objects, by scheme; the last of all identifiers stands for none */
    PBS_SPLAT_SMALLS = (1 << 14) - 1,
    PBS_SPLAT_LIST = 30 << 20 /* entries of a list at most: a buffer is smaller than 128 MiB */
};

/* A buffer that grows. */
typedef struct splat_store {
    GLuint buffer;
    size_t room;
} splat_store;

/* Part of a node: up to 2^20 of its records. */
typedef struct splat_object {
    uint64_t key, offset;
    GLuint buffer;
    uint32_t node, skip, count; /* of the nodes; records before it; its own */
    uint32_t slot, base;        /* number of its buffer; of its first flag */
    uint32_t kind;              /* 0 large, 1 small, 2 without identifier */
} splat_object;

/* A buffer with records. */
typedef struct splat_slot {
    GLuint buffer;
    uint64_t bytes;
    uint64_t surfels, groups; /* with identifiers */
} splat_slot;

typedef struct splat_frame {
    splat_object *objects; /* large, small, others */
    size_t count, room;
    uint32_t larges, selected, group;
    splat_slot *slots;
    size_t slot_count, slot_room;
    uint32_t flags;     /* how many there are */
    bool lists;         /* they are filled */
    pbs_numbers by_key; /* of objects: index */
    splat_store flag, visible, groups, commands;
} splat_frame;

struct pbs_splat {
    pbs_run *run;
    const pbs_gl *gl;
    size_t counted;
    GLuint depth_program, index_program, collect_program, ewa_program, final_program, no_vertices;
    uint32_t width, height;                        /* with margin; 0: nothing is made yet */
    GLuint depth, depth_copy, ids, sums, coverage; /* textures */
    GLuint depth_frame, index_frame, sum_frame;
    size_t textures_counted;
    splat_frame frames[2];
    int now; /* which is this frame's */
    splat_store table, fresh, places;
    splat_object *parts; /* as they come */
    size_t part_room;
    struct splat_entry *entries;
    uint32_t *moved;
    size_t entry_room, moved_room;
    uint64_t all, plain;
    bool coherent; /* this frame's visible set is for the next one */
    bool compared; /* and there was one from the last */
};

/* An entry of the table as the shaders see it. */
typedef struct splat_entry {
    float to_view[3][4], disc[3][4], normal[3][4];
    uint32_t records[4], flags[4], octaves[4];
    int32_t field[4];
    uint32_t id;
    float octave;
    uint32_t before, here; /* of its part; here: as many as it has */
} splat_entry;

/* Makes room; what was in it is lost if it grows. */
pbs_code pbs_splat_reserve(pbs_splat *s, splat_store *store, size_t bytes, pbs_err *err);

/* Fills this frame's objects and slots, the table on the device and, with coherent, the places
 * where the last frame's objects are now. */
pbs_code pbs_splat_table(pbs_splat *s, const pbs_canvas *canvas, const pbs_resident *nodes,
                         size_t count, const pbs_splat_options *options, bool coherent,
                         pbs_err *err);
#endif
