/* cli.h: a program's options are a table; help text, parsing, provenance and the check of the man
 * pages all come from it.
 *
 * GNU manners: --name VALUE, --name=VALUE, -n VALUE, -nVALUE, flags together (-vq), options after
 * operands, "--" ends options. Of an option given twice the last counts. Nothing is abbreviated
 * and nothing unknown is ignored.
 */
#ifndef PBS_CLI_H
#define PBS_CLI_H

#include "libcore/ground/err.h"
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef enum pbs_option_type {
    PBS_FLAG,  /* bool */
    PBS_COUNT, /* uint64_t; k, M, G are powers of 1000: 100k, 1.5M */
    PBS_BYTES, /* uint64_t; k, M, G, and Ki, Mi, Gi powers of 1024 */
    PBS_REAL,  /* double */
    PBS_TEXT,  /* const char *, points into argv */
    PBS_CHOICE /* int: place in `choices` */
} pbs_option_type;

typedef struct pbs_option {
    char letter;      /* 0: long name only */
    const char *name; /* "resolution" */
    pbs_option_type type;
    size_t offset;              /* of the field in the program's struct of options */
    const char *value;          /* "N", what help calls the value; NULL for flags */
    const char *help;           /* one line */
    double min, max;            /* of COUNT, BYTES and REAL; max 0: no limit */
    const char *const *choices; /* of CHOICE, ends with NULL */
    bool result;                /* the result's bytes depend on it: it goes into the provenance */
} pbs_option;

typedef struct pbs_tool {
    const char *name;               /* "pbs-sample" */
    const char *purpose;            /* "orders candidates into surfels", for --help */
    const char *operands;           /* "[FILE]", for --help */
    int operands_min, operands_max; /* max -1: any number */
    const pbs_option *options;
    size_t option_count; /* at most 48 */
    bool no_output;      /* has no -o: prints text */
} pbs_tool;

/* What every program understands; the table in cli.c. */
typedef struct pbs_common {
    uint64_t threads; /* 0: not given */
    uint64_t memory;  /* bytes; 0: not given */
    const char *output, *stats;
    bool verbose, quiet, help, version;
    uint64_t given;  /* bit i: option i of the tool's table was given */
    char **operands; /* into argv, which is permuted */
    int operand_count;
} pbs_common;

/* Fills *common and the program's struct, which holds the defaults. Errors: PBS_USAGE, a text
 * that names the option and what is wrong with it. With --help or --version nothing else is
 * checked. */
pbs_code pbs_cli_parse(const pbs_tool *tool, int argc, char **argv, void *options,
                       pbs_common *common, pbs_err *err);

/* Numbers as options take them. Errors: PBS_USAGE. */
pbs_code pbs_cli_number(const char *text, pbs_option_type type, double *out, pbs_err *err);

/* malloc'ed text; NULL if there is no memory. */
char *pbs_cli_help(const pbs_tool *tool);
/* This stage's line of provenance: name, the options that were given and determine the result,
 * in the order of the table, and the operands without their folders. */
char *pbs_cli_stage(const pbs_tool *tool, const void *options, const pbs_common *common);
#endif
