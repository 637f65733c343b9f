#include "cmd/notes.h"

void pbs_note_skips(pbs_app *app, const char *file, const uint64_t skipped[PBS_SKIP_KINDS]) {
    static const char *const stat[PBS_SKIP_KINDS] = {
        "skipped_nonfinite",  "skipped_degenerate", "skipped_points",  "skipped_lines",
        "skipped_transforms", "skipped_textures",   "skipped_polygons"};
    for (int i = 0; i < PBS_SKIP_KINDS; i++) {
        if (!skipped[i]) continue;
        pbs_note(app, "%s: left out: %llu %s", file, (unsigned long long)skipped[i],
                 pbs_skip_text[i]);
        pbs_stat_count(app, stat[i], skipped[i]);
    }
}
