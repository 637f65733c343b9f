#include "cmd/pbs-view/plan/poses.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static bool is_number(const char *text, uint64_t *n) {
    char *end;
    *n = strtoull(text, &end, 10);
    return *text >= '0' && *text <= '9' && !*end;
}

/* Names of files may hold anything; what is not printable would change the terminal. */
static void write_list(const pbs_motions *m, char *out, size_t size) {
    size_t n = 0;
    out[0] = 0;
    for (size_t i = 0; i < m->animation_count && n < size; i++) {
        const char *name = m->animations[i].name;
        size_t from = n;
        n += (size_t)snprintf(out + n, size - n, "%s%zu%s%.40s", i ? ", " : "", i, *name ? " " : "",
                              name);
        for (size_t k = from; k < n && k < size; k++)
            if ((unsigned char)out[k] < ' ' || out[k] == 127) out[k] = '?';
    }
}

static pbs_code choose(pbs_poses *p, const char *choice, pbs_err *err) {
    const pbs_motions *m = p->motions;
    bool all = !choice || !strcmp(choice, "all"), known = all || !strcmp(choice, "none");
    bool named = !known, numbered = false;
    uint64_t number = 0;
    char list[400];
    if (named) numbered = is_number(choice, &number);
    for (size_t i = 0; i < m->animation_count; i++) {
        bool called = named && !strcmp(m->animations[i].name, choice);
        p->plays[i] = all || (numbered ? number == i : called);
        known = known || p->plays[i];
    }
    if (known) return PBS_OK;
    write_list(m, list, sizeof list);
    return pbs_fail(err, PBS_USAGE, "--animation: %s: there is no such animation%s%s", choice,
                    list[0] ? ", only " : ", nor another one", list);
}

pbs_code pbs_poses_open(pbs_run *run, const pbs_motions *m, const char *choice, pbs_poses *p,
                        pbs_err *err) {
    *p = (pbs_poses){.run = run, .motions = m, .at = NAN};
    pbs_code rc =
        pbs_alloc(run, &p->plays, m->animation_count, sizeof *p->plays, "the animations", err);
    if (!rc)
        rc = pbs_alloc(run, &p->time, m->animation_count, sizeof *p->time, "the animations", err);
    if (!rc) rc = pbs_alloc(run, &p->pose, m->count, sizeof *p->pose, "the poses", err);
    if (!rc) rc = choose(p, choice, err);
    if (rc) pbs_poses_close(p);
    return rc;
}

void pbs_poses_close(pbs_poses *p) {
    pbs_free(p->run, p->plays);
    pbs_free(p->run, p->time);
    pbs_free(p->run, p->pose);
    *p = (pbs_poses){0};
}

bool pbs_poses_any(const pbs_poses *p) {
    bool any = false;
    for (size_t i = 0; p->motions && p->motions->count && i < p->motions->animation_count; i++)
        any = any || p->plays[i];
    return any;
}

const double (*pbs_poses_at(pbs_poses *p, double time))[12] {
    const pbs_motions *m = p->motions;
    if (isnan(time) || !m || !m->count) return NULL;
    if (time == p->at) return (const double(*)[12])p->pose;
    p->at = time;
    for (size_t i = 0; i < m->animation_count; i++)
        p->time[i] = p->plays[i] ? pbs_motion_loop(time, m->animations[i].end) : NAN;
    for (size_t i = 0; i < m->count; i++) pbs_motion_at(&m->motions[i], p->time, p->pose[i]);
    return (const double(*)[12])p->pose;
}
