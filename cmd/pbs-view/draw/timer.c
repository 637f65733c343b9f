/* timer.c: timestamps in a ring; see the header. */
#include "cmd/pbs-view/draw/timer.h"
#include <string.h>
#include <time.h>

void pbs_timer_open(pbs_timer *t, const pbs_gl *gl) {
    memset(t, 0, sizeof *t);
    t->gl = gl;
    gl->CreateQueries(GL_TIMESTAMP, 2 * PBS_TIMER_FRAMES, t->query[0]);
}

void pbs_timer_close(pbs_timer *t) {
    if (t->gl) t->gl->DeleteQueries(2 * PBS_TIMER_FRAMES, t->query[0]);
    t->gl = NULL;
}

void pbs_timer_begin(pbs_timer *t) {
    t->open = t->begun - t->taken < PBS_TIMER_FRAMES;
    if (t->open) t->gl->QueryCounter(t->query[t->begun % PBS_TIMER_FRAMES][0], GL_TIMESTAMP);
}

void pbs_timer_end(pbs_timer *t) {
    if (!t->open) return;
    t->gl->QueryCounter(t->query[t->begun % PBS_TIMER_FRAMES][1], GL_TIMESTAMP);
    t->begun++;
    t->open = false;
}

bool pbs_timer_take(pbs_timer *t, bool wait, double *seconds) {
    GLuint *pair = t->query[t->taken % PBS_TIMER_FRAMES];
    GLuint64 from = 0, to = 0;
    GLint ready = 0;
    if (t->taken == t->begun) return false;
    if (!wait) t->gl->GetQueryObjectiv(pair[1], GL_QUERY_RESULT_AVAILABLE, &ready);
    if (!wait && !ready) return false;
    t->gl->GetQueryObjectui64v(pair[0], GL_QUERY_RESULT, &from);
    t->gl->GetQueryObjectui64v(pair[1], GL_QUERY_RESULT, &to);
    t->taken++;
    /* A clock that is set back in between, as when the device is reset. */
    *seconds = to > from ? 1e-9 * (double)(to - from) : 0;
    return true;
}

static double clock_of(clockid_t id) {
    struct timespec t;
    clock_gettime(id, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

double pbs_clock_wall(void) {
    return clock_of(CLOCK_MONOTONIC);
}
double pbs_clock_thread(void) {
    return clock_of(CLOCK_THREAD_CPUTIME_ID);
}
