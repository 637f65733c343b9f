/* tool.h: what all programs share around their work: options, signals, threads and memory,
 * progress, notes, statistics, the one line of an error, the exit status. */
#ifndef PBS_TOOL_H
#define PBS_TOOL_H

#include "libcore/ground/cli.h"
#include "libcore/ground/run.h"

typedef struct pbs_app {
    const pbs_tool *tool;
    pbs_common common;
    pbs_run run;
    char *stage; /* provenance of this run */
    struct pbs_stat {
        const char *name;
        double value;
        bool integer;
        bool text; /* the value is app->channels */
    } stats[48];
    int stat_count;
    char channels[256];
    double start, drawn; /* seconds; when progress was last drawn */
    const char *phase;   /* what is going on, since when, and how far it was then */
    double phase_start, phase_share;
    bool progress_shown;
    int progress_to; /* where PBS_PROGRESS says; -1: nowhere */
    bool whole;      /* see pbs_tool_whole */
} pbs_app;

/* Parses, runs work and ends: returns the exit status. options holds the defaults. */
int pbs_tool_main(int argc, char **argv, const pbs_tool *tool, void *options,
                  pbs_code (*work)(pbs_app *app, void *options, pbs_err *err));

/* Operand i, or NULL: standard input. */
const char *pbs_operand(const pbs_app *app, int i);

/* A line on standard error, unless -q; control characters become '?'. */
void pbs_note(pbs_app *app, const char *fmt, ...) __attribute__((format(printf, 2, 3)));

/* The result is whole although work will return an error: statistics are written as without one. */
void pbs_tool_whole(pbs_app *app);

/* Prints n bytes to standard output as a JSON string. */
void pbs_print_json_text(const char *s, size_t n);

/* Named numbers for --stats and -v; name is a literal, lower case with underscores. */
void pbs_stat_count(pbs_app *app, const char *name, uint64_t value);
void pbs_stat_real(pbs_app *app, const char *name, double value);
/* What a record of the result holds: "channels", the text of the header, and "record_bytes". */
void pbs_stat_record(pbs_app *app, const char *channels, uint32_t bytes);
#endif
