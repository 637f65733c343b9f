/* notes.h: notes that more than one program prints. */
#ifndef PBS_NOTES_H
#define PBS_NOTES_H
#include "cmd/tool.h"
#include "formats/scene.h"

/* One line for each kind of thing that was left out, and a stat for each. */
void pbs_note_skips(pbs_app *app, const char *file, const uint64_t skipped[PBS_SKIP_KINDS]);
#endif
