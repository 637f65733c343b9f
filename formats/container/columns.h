/* columns.h: records that are kept as one array a channel, such as pbs_points and pbs_voxels. A
 * table says which member of the struct is the array of which channel.
 */
#ifndef PBS_FORMAT_COLUMNS_H
#define PBS_FORMAT_COLUMNS_H

#include "libcore/ground/run.h"

typedef struct pbs_column {
    uint32_t channel; /* one bit */
    uint32_t size;    /* bytes a record */
    size_t at;        /* offsetof(the struct, its pointer) */
} pbs_column;

typedef struct pbs_columns {
    const pbs_column *column;
    size_t count;
    const char *what; /* for messages: "the points" */
} pbs_columns;

/* The array of a channel in the struct s; NULL if it has none. */
uint8_t *pbs_column_get(const pbs_column *c, const void *s);
void pbs_column_set(const pbs_column *c, void *s, const void *array);

/* Makes room for `need` records of those channels in s, keeping what is there. cap: the room so
 * far, 0 at first. Errors: PBS_MEMORY; *cap stays what all arrays have. */
pbs_code pbs_columns_grow(pbs_run *run, const pbs_columns *all, uint32_t channels, void *s,
                          size_t *cap, size_t need, pbs_err *err);
/* Frees all arrays, and sets them to NULL. */
void pbs_columns_free(pbs_run *run, const pbs_columns *all, void *s);
#endif
