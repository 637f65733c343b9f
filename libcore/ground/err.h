/* err.h: the error value.
 *
 * Every function that can fail returns a pbs_code and takes a pbs_err as its last argument. The
 * code is the exit status of the program that gives up because of it; the text is one line that
 * says where and what, without the program's name:
 *
 *     engine.glb: mesh 3: index 70000 of 65535: the file is damaged
 *
 * libcore never prints it; cmd/tool.c does, once.
 */
#ifndef PBS_ERR_H
#define PBS_ERR_H

#ifdef __cplusplus
extern "C" {
#endif

typedef enum pbs_code {
    PBS_OK = 0,
    PBS_USAGE = 64,    /* the command line is wrong */
    PBS_DATA = 65,     /* the input is wrong: damaged, of another kind, not supported */
    PBS_INTERNAL = 70, /* a bug of ours */
    PBS_IO = 74,       /* the system said no: a file, a pipe, a full disk, a missing module */
    PBS_LIMIT = 75,    /* -m is too small, or the machine has no more memory */
    PBS_CANCEL = 76    /* SIGINT, SIGTERM or SIGHUP */
} pbs_code;

typedef struct pbs_err {
    pbs_code code;
    char text[1024]; /* one line of UTF-8, cut if longer; control characters become '?' */
} pbs_err;

#if defined(__GNUC__)
#define PBS_PRINTF(f, a) __attribute__((format(printf, f, a), cold))
#else
#define PBS_PRINTF(f, a)
#endif

/* Sets *err (NULL: not wanted) and returns code, so that a caller can write
 * `return pbs_fail(err, PBS_DATA, "chunk %u: checksum differs", n);` */
pbs_code pbs_fail(pbs_err *err, pbs_code code, const char *fmt, ...) PBS_PRINTF(3, 4);

/* Puts "place: " in front of the text of an error that is already set; returns its code. */
pbs_code pbs_fail_in(pbs_err *err, const char *fmt, ...) PBS_PRINTF(2, 3);

/* As pbs_fail with the system's text for errno behind ": "; PBS_LIMIT for ENOMEM, else PBS_IO. */
pbs_code pbs_fail_errno(pbs_err *err, const char *fmt, ...) PBS_PRINTF(2, 3);

#ifdef __cplusplus
}
#endif
#endif
