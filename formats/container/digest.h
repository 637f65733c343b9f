/* digest.h: 128 bits that stand for bytes: what has the same digest is the same (XXH3, which is not
 * meant to withstand anybody who looks for two things that agree). */
#ifndef PBS_DIGEST_H
#define PBS_DIGEST_H

#include <stddef.h>
#include <stdint.h>

typedef struct pbs_digest {
    uint64_t h[2]; /* zero at first */
} pbs_digest;

/* The digest of what d stands for, followed by these bytes, in these pieces. */
void pbs_digest_add(pbs_digest *d, const void *bytes, size_t n);
/* 64 bits of a text; NULL is "". */
uint64_t pbs_digest_text(const char *text);
#endif
