#include "cmd/depend.h"
#include "formats/container/file.h"
#include <stdlib.h>

#define SOURCE " \t#:"
#define TARGET SOURCE "%"

static void remember(void *ctx, const char *path) {
    pbs_depend *d = ctx;
    if (d->count % 64 == 0) {
        char **grown = realloc(d->paths, (d->count + 64) * sizeof *grown);
        if (!grown) {
            d->lost = true;
            return;
        }
        d->paths = grown;
    }
    if (!(d->paths[d->count] = strdup(path))) {
        d->lost = true;
        return;
    }
    d->count++;
}

void pbs_depend_begin(pbs_depend *d, pbs_run *run) {
    run->opened = remember;
    run->opened_ctx = d;
}

/* As make reads names: what is special, and backslashes before it, have a backslash before them,
 * and a dollar sign stands twice. A % is special in targets only. */
static pbs_code put_name(pbs_output *out, const char *name, const char *special, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (const char *c = name; *c && !rc; c++) {
        if (*c == '\n' || *c == '\r')
            return pbs_fail(err, PBS_DATA, "%s: make has no names with a line end", name);
        if (strchr(special, *c)) {
            for (const char *b = c; b > name && b[-1] == '\\' && !rc; b--)
                rc = pbs_output_write(out, "\\", 1, err);
            if (!rc) rc = pbs_output_write(out, "\\", 1, err);
        }
        if (*c == '$' && !rc) rc = pbs_output_write(out, "$", 1, err);
        if (!rc) rc = pbs_output_write(out, c, 1, err);
    }
    return rc;
}

static pbs_code put_rules(const pbs_depend *d, pbs_output *out, const char *target, pbs_err *err) {
    pbs_code rc = put_name(out, target, TARGET, err);
    if (!rc) rc = pbs_output_write(out, ":", 1, err);
    for (size_t i = 0; i < d->count && !rc; i++) {
        rc = pbs_output_write(out, " \\\n  ", 5, err);
        if (!rc) rc = put_name(out, d->paths[i], SOURCE, err);
    }
    if (!rc) rc = pbs_output_write(out, "\n", 1, err);
    for (size_t i = 0; i < d->count && !rc; i++) {
        rc = put_name(out, d->paths[i], TARGET, err);
        if (!rc) rc = pbs_output_write(out, ":\n", 2, err);
    }
    return rc;
}

pbs_code pbs_depend_write(const pbs_depend *d, pbs_run *run, const char *path, const char *target,
                          pbs_err *err) {
    pbs_output out;
    if (d->lost) return pbs_fail(err, PBS_LIMIT, "no memory");
    pbs_code rc = pbs_output_open(run, path, &out, err);
    if (rc) return rc;
    rc = put_rules(d, &out, target, err);
    if (!rc) rc = pbs_output_commit(&out, err);
    pbs_output_close(&out);
    return rc;
}

void pbs_depend_end(pbs_depend *d, pbs_run *run) {
    if (run->opened_ctx == d) run->opened = NULL;
    for (size_t i = 0; i < d->count; i++) free(d->paths[i]);
    free(d->paths);
    *d = (pbs_depend){0};
}
