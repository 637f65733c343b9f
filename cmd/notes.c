#include "cmd/notes.h"
#include <string.h>

void pbs_note_skips(pbs_app *app, const char *file, const uint64_t skipped[PBS_SKIP_KINDS]) {
    static const char *const stat[PBS_SKIP_KINDS] = {
        "skipped_nonfinite",  "skipped_degenerate", "skipped_points",   "skipped_lines",
        "skipped_transforms", "skipped_textures",   "skipped_polygons", "skipped_failed",
        "skipped_channels",   "skipped_keys"};
    for (int i = 0; i < PBS_SKIP_KINDS; i++) {
        if (!skipped[i]) continue;
        pbs_note(app, "%s: left out: %llu %s", file, (unsigned long long)skipped[i],
                 pbs_skip_text[i]);
        pbs_stat_count(app, stat[i], skipped[i]);
    }
}

static const char *input_name(const pbs_app *app) {
    const char *path = pbs_operand(app, 0);
    return path && strcmp(path, "-") ? path : "standard input";
}

void pbs_note_failure(void *failures, const pbs_err *err) {
    pbs_failures *f = failures;
    f->count++;
    pbs_note(f->app, "%s: left out: %s", input_name(f->app), err->text);
}

pbs_code pbs_failures_end(const pbs_failures *f, pbs_err *err) {
    if (!f->count) return PBS_OK;
    pbs_stat_count(f->app, "left_out", f->count);
    pbs_tool_whole(f->app);
    return pbs_fail(err, PBS_DATA, "%s: left out because of errors: %llu, the rest is done",
                    input_name(f->app), (unsigned long long)f->count);
}
