/* check.h: is every byte of a file what it should be? pbs-info --check asks, and so does the
 * fuzzer (tests/fuzz). */
#ifndef PBS_CHECK_FILE_H
#define PBS_CHECK_FILE_H

#include "formats/container/container.h"

typedef struct pbs_checked {
    uint64_t chunks, nodes, records, bytes;
} pbs_checked;

/* Reads the whole file front to back: checksums, footer, directory against the chunks (mapped
 * files), and what is in the chunks that this program knows: numbers finite, indices in range,
 * counts that agree. Takes over *in. Errors: PBS_DATA with the place. */
pbs_code pbs_check_file(pbs_run *run, pbs_input *in, pbs_checked *out, pbs_err *err);
#endif
