/* depend.h: which files a program read, as a rule for make. */
#ifndef PBS_DEPEND_H
#define PBS_DEPEND_H

#include "libcore/ground/run.h"

typedef struct pbs_depend {
    char **paths;
    size_t count;
    bool lost; /* there was no memory for one of them */
} pbs_depend;

/* From here on *d remembers every file that is opened with this run. d starts zeroed. */
void pbs_depend_begin(pbs_depend *d, pbs_run *run);
/* Writes "target: files" to the file `path`, and an empty rule for each of the files, so that make
 * does not stop when one of them is gone. Errors: PBS_IO; PBS_DATA for names with a line end, which
 * make cannot write. */
pbs_code pbs_depend_write(const pbs_depend *d, pbs_run *run, const char *path, const char *target,
                          pbs_err *err);
void pbs_depend_end(pbs_depend *d, pbs_run *run);
#endif
