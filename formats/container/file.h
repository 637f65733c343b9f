/* file.h: bytes in and out: files, pipes, maps, temporary files.
 *
 * An output file appears under its name only when it is whole (DESIGN section 11): it is written
 * to a nameless file in the same folder, or beside under a name with a dot where the file system
 * has no nameless files, and renamed by pbs_output_commit. A pipe gets the bytes at once.
 */
#ifndef PBS_FILE_H
#define PBS_FILE_H

#include "libcore/ground/run.h"
#include <string.h>

typedef struct pbs_input {
    int fd;               /* -1 if mapped, unless it was opened to be read as well */
    bool mapped;          /* bytes and size are valid */
    const uint8_t *bytes; /* of the whole file; NULL if it is empty */
    uint64_t size;
    uint64_t device, inode; /* of what is mapped, to find it again */
    uint8_t *ahead;         /* of a pipe: the first bytes, read to see what it is */
    size_t ahead_size, ahead_used;
    char name[512]; /* for messages: the path or "standard input" */
    pbs_run *run;
} pbs_input;

/* A path without its folders; points into it. */
static inline const char *pbs_base_name(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

/* path NULL or "-": standard input. Regular files are mapped, pipes are not. Errors: PBS_IO;
 * PBS_DATA for a directory. */
pbs_code pbs_input_open(pbs_run *run, const char *path, pbs_input *in, pbs_err *err);
/* The same, and a file that is mapped stays open, to be read as well. What is looked at once, from
 * front to back, comes cheaper as a copy than through the map, whose pages cost a fault each and
 * count as the program's memory until they are given back. */
pbs_code pbs_input_open_both(pbs_run *run, const char *path, pbs_input *in, pbs_err *err);
/* Reads up to n bytes from byte `at` of such a file; *got < n only at its end. */
pbs_code pbs_input_read_at(pbs_input *in, uint64_t at, void *to, size_t n, size_t *got,
                           pbs_err *err);
/* What the input begins with; *n is at most 64 and less only if the input is shorter. */
pbs_code pbs_input_peek(pbs_input *in, const uint8_t **bytes, size_t *n, pbs_err *err);
/* Makes a map of a pipe: spools it to a nameless file in $TMPDIR. */
pbs_code pbs_input_map(pbs_input *in, pbs_err *err);
/* Reads up to n bytes of a pipe; *got < n only at its end. */
pbs_code pbs_input_read(pbs_input *in, void *to, size_t n, size_t *got, pbs_err *err);
void pbs_input_close(pbs_input *in);

/* Maps a whole file beside another one (a .mtl, a .bin, a texture). *bytes is NULL if it is
 * empty; pbs_unmap_file gives it back. Errors: PBS_IO with the system's text. */
pbs_code pbs_map_file(const char *path, const uint8_t **bytes, size_t *size, pbs_err *err);
void pbs_unmap_file(const uint8_t *bytes, size_t size);

typedef struct pbs_output {
    int fd;
    bool seekable;
    char name[512];  /* for messages */
    char *path;      /* final name; NULL: a pipe, or a spool */
    char *temporary; /* its name until then; NULL: it has none */
    uint8_t *buffer;
    size_t buffered;
    uint64_t written; /* bytes so far, buffered ones included */
    pbs_run *run;
} pbs_output;

/* path NULL or "-": standard output. PBS_USAGE if that is a terminal. */
pbs_code pbs_output_open(pbs_run *run, const char *path, pbs_output *out, pbs_err *err);
/* A nameless file in $TMPDIR (or /tmp), gone when closed. */
pbs_code pbs_output_spool(pbs_run *run, pbs_output *out, pbs_err *err);
pbs_code pbs_output_write(pbs_output *out, const void *bytes, size_t n, pbs_err *err);
/* Overwrites what was written before; seekable outputs only. */
pbs_code pbs_output_patch(pbs_output *out, uint64_t at, const void *bytes, size_t n, pbs_err *err);
pbs_code pbs_output_flush(pbs_output *out, pbs_err *err);
/* Gives the file its name. After it, or instead of it to throw everything away: close. */
pbs_code pbs_output_commit(pbs_output *out, pbs_err *err);
void pbs_output_close(pbs_output *out);
/* Turns a spool that is written into a mapped input; the spool is closed. */
pbs_code pbs_output_reopen(pbs_output *out, pbs_input *in, pbs_err *err);
#endif
