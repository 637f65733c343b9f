/* scratch.h: what is larger than memory: arrays that lie in a temporary file if they are large, and
 * maps of files whose pages are let go.
 *
 * A page of a file that a program has looked at counts as its memory until it is given back. Given
 * back, it stays in the system's cache, and the next look finds it there.
 */
#ifndef PBS_SCRATCH_H
#define PBS_SCRATCH_H

#include "libcore/ground/run.h"

/* ---- pages ---- */

enum { PBS_TRIM_RANGES = 8 };

typedef struct pbs_trim {
    int statm;    /* where the system says how many pages of files we hold; -1: it does not */
    size_t limit; /* bytes of them that may be held */
    int count;
    struct pbs_trim_range {
        const void *bytes;
        size_t size;
    } range[PBS_TRIM_RANGES];
} pbs_trim;

/* The limit is half of what run's leaves. */
void pbs_trim_open(const pbs_run *run, pbs_trim *t);
/* What is read in order comes before what is read at random: it is given back first, which may do.
 * bytes must be in the map of a file, never other memory, which would be lost; NULL is left out,
 * and so is what has no place in the table. */
void pbs_trim_add(pbs_trim *t, const void *bytes, size_t size);
/* Before the map goes. */
void pbs_trim_drop(pbs_trim *t, const void *bytes);
/* Gives back the pages of one range after the other while more than the limit are held. About a
 * microsecond: call it every few hundred places that are read at random, or every megabyte that is
 * read in order. */
void pbs_trim_now(const pbs_trim *t);
void pbs_trim_close(pbs_trim *t);
/* The whole pages of one range are given back now; it must be in the map of a file. */
void pbs_pages_rest(const void *bytes, size_t size);

/* ---- arrays ---- */

typedef struct pbs_scratch {
    pbs_run *run;
    void *bytes;
    size_t size;
    bool is_file;  /* a map, which may be trimmed; its memory is not counted */
    int fd;        /* the file; -1: memory */
    char name[64]; /* for messages */
} pbs_scratch;

/* count * size bytes, not cleared: in memory if that takes at most a quarter of what the limit
 * leaves, else in a nameless file in $TMPDIR. what names it in errors. Errors: PBS_IO if the disk
 * is full, which is known here and not later. Free it also after an error. */
pbs_code pbs_scratch_new(pbs_run *run, size_t count, size_t size, const char *what,
                         pbs_scratch *out, pbs_err *err);
/* The same with at most `most` bytes in memory, whatever the limit leaves. */
pbs_code pbs_scratch_within(pbs_run *run, size_t count, size_t size, const char *what, size_t most,
                            pbs_scratch *out, pbs_err *err);
/* The same, in a file whatever the size. */
pbs_code pbs_scratch_file(pbs_run *run, size_t count, size_t size, const char *what,
                          pbs_scratch *out, pbs_err *err);
/* Bytes in and out without touching pages of the map, which costs far more than the copy: a page of
 * a map is one's own memory until it is given back. What is written is seen through the map.
 * Thread-safe for different places. at + size must be within. */
pbs_code pbs_scratch_read(const pbs_scratch *s, uint64_t at, size_t size, void *to, pbs_err *err);
pbs_code pbs_scratch_write(const pbs_scratch *s, uint64_t at, size_t size, const void *from,
                           pbs_err *err);
/* Zeroed by = {0} is fine. */
void pbs_scratch_free(pbs_scratch *s);
#endif
