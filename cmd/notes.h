/* notes.h: notes that more than one program prints. */
#ifndef PBS_NOTES_H
#define PBS_NOTES_H
#include "cmd/tool.h"
#include "formats/scene/scene.h"

/* One line for each kind of thing that was left out, and a stat for each. */
void pbs_note_skips(pbs_app *app, const char *file, const uint64_t skipped[PBS_SKIP_KINDS]);

/* --keep-going: what could not be read or made and is left out. */
typedef struct pbs_failures {
    pbs_app *app;
    uint64_t count;
} pbs_failures;
/* Counts it, and says so in a line. As pbs_scene_options.failed; failures: a pbs_failures. */
void pbs_note_failure(void *failures, const pbs_err *err);
/* PBS_DATA if there were any; the program's result is whole all the same (pbs_tool_whole). */
pbs_code pbs_failures_end(const pbs_failures *f, pbs_err *err);
#endif
