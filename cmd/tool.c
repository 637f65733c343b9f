#include "cmd/tool.h"
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

static volatile sig_atomic_t cancelled;

static void on_signal(int sig) {
    cancelled = 1;
    signal(sig, SIG_DFL); /* a second one ends at once */
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

/* Without SA_RESTART: a read that waits for a pipe returns and looks at the flag. A signal that
 * was ignored when we started (nohup) stays ignored. */
static void catch_signals(void) {
    const int sigs[] = {SIGINT, SIGTERM, SIGHUP};
    for (int i = 0; i < 3; i++) {
        struct sigaction a = {.sa_handler = on_signal}, old;
        sigaction(sigs[i], NULL, &old);
        if (old.sa_handler != SIG_IGN) sigaction(sigs[i], &a, NULL);
    }
    signal(SIGPIPE, SIG_IGN); /* a closed pipe is an error of write, */
    signal(SIGXFSZ, SIG_IGN); /* and so is ulimit -f */
}

/* ---- progress: at most six times a second, on a terminal or to whoever asked for it ---- */

/* A line in one piece, so that several programs can write to the same file. A pipe that nobody
 * empties takes nothing, and we don't wait for it. */
static void tell_progress(const pbs_app *app, const char *what, double share, double left) {
    char line[160], percent[24] = "-", seconds[24] = "-";
    if (share >= 0) snprintf(percent, sizeof percent, "%.0f", floor(100 * share));
    if (left >= 0) snprintf(seconds, sizeof seconds, "%.0f", ceil(left));
    int n = snprintf(line, sizeof line, "%s %s %s %s\n", app->tool->name, percent, seconds, what);
    if (n >= (int)sizeof line) line[sizeof line - 2] = '\n', n = (int)sizeof line - 1;
    ssize_t told = write(app->progress_to, line, (size_t)n);
    (void)told;
}

/* From how fast this went so far; a stage of a pipe has waited before, and that counts for nothing.
 */
static double time_left(pbs_app *app, const char *what, double t, double share) {
    if (what != app->phase || share < app->phase_share) {
        app->phase = what;
        app->phase_start = t;
        app->phase_share = share;
    }
    double made = share - app->phase_share;
    return made > 0.02 ? (t - app->phase_start) * (1 - share) / made : -1;
}

static void draw_progress(void *ctx, const char *what, uint64_t done, uint64_t total) {
    pbs_app *app = ctx;
    double t = now(), last;
    __atomic_load(&app->drawn, &last, __ATOMIC_RELAXED);
    if (t - last < 1.0 / 6 || !__atomic_compare_exchange(&app->drawn, &last, &t, false,
                                                         __ATOMIC_ACQ_REL, __ATOMIC_RELAXED))
        return;
    double share = total && done <= total ? (double)done / (double)total : -1;
    double left = time_left(app, what, t, share);
    if (app->progress_to >= 0) {
        tell_progress(app, what, share, left);
        return;
    }
    __atomic_store_n(&app->progress_shown, true, __ATOMIC_RELAXED);
    fprintf(stderr, "\r\033[K%s: %s", app->tool->name, what);
    if (share >= 0) fprintf(stderr, " %3.0f %%", 100 * share);
    if (left >= 0) fprintf(stderr, ", %.0f s left", ceil(left));
}

static void clear_progress(pbs_app *app) {
    if (app->progress_shown) fprintf(stderr, "\r\033[K");
    app->progress_shown = false;
}

/* Progress is a courtesy: a file that cannot be opened is no error. */
static void open_progress(pbs_app *app) {
    const char *to = getenv("PBS_PROGRESS");
    if (app->common.quiet) return;
    if (to && *to)
        app->progress_to =
            open(to, O_WRONLY | O_CREAT | O_APPEND | O_NONBLOCK | O_CLOEXEC | O_NOCTTY, 0666);
    if (app->progress_to < 0 && ((to && *to) || !isatty(2))) return;
    app->run.progress = draw_progress;
    app->run.progress_ctx = app;
}

/* ---- limits ---- */

static pbs_code from_environment(const char *name, pbs_option_type type, uint64_t *out,
                                 pbs_err *err) {
    const char *s = getenv(name);
    double v;
    if (*out || !s || !*s) return PBS_OK; /* the command line comes first */
    pbs_code rc = pbs_cli_number(s, type, &v, err);
    if (rc) return pbs_fail_in(err, "%s", name);
    *out = (uint64_t)v;
    return PBS_OK;
}

static pbs_code set_limits(pbs_app *app, pbs_err *err) {
    long cpus = sysconf(_SC_NPROCESSORS_ONLN);
    uint64_t j = app->common.threads, m = app->common.memory;
    pbs_code rc = from_environment("PBS_THREADS", PBS_COUNT, &j, err);
    if (!rc) rc = from_environment("PBS_MEMORY", PBS_BYTES, &m, err);
    if (rc) return rc;
    if (!j) j = cpus > 0 ? (uint64_t)cpus : 1;
    if (!m) m = (uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE) / 2;
    app->run = (pbs_run){.threads = j > 256 ? 256 : (int)j, .mem_limit = m, .cancel = &cancelled};
    open_progress(app);
    return pbs_mem_take(&app->run, PBS_MEM_BASE, "the program itself", err);
}

/* ---- statistics ---- */

static void add_stat(pbs_app *app, struct pbs_stat stat) {
    if (app->stat_count < (int)(sizeof app->stats / sizeof app->stats[0]))
        app->stats[app->stat_count++] = stat;
}
void pbs_stat_count(pbs_app *app, const char *name, uint64_t value) {
    add_stat(app, (struct pbs_stat){.name = name, .value = (double)value, .integer = true});
}
void pbs_stat_real(pbs_app *app, const char *name, double value) {
    add_stat(app, (struct pbs_stat){.name = name, .value = value});
}
void pbs_stat_record(pbs_app *app, const char *channels, uint32_t bytes) {
    snprintf(app->channels, sizeof app->channels, "%s", channels);
    add_stat(app, (struct pbs_stat){.name = "channels", .text = true});
    pbs_stat_count(app, "record_bytes", bytes);
}

static double seconds(struct timeval t) {
    return (double)t.tv_sec + (double)t.tv_usec * 1e-6;
}

static void add_costs(pbs_app *app) {
    struct rusage u;
    getrusage(RUSAGE_SELF, &u);
    pbs_stat_real(app, "seconds", now() - app->start);
    pbs_stat_real(app, "cpu_seconds", seconds(u.ru_utime) + seconds(u.ru_stime));
    pbs_stat_count(app, "memory_counted", pbs_mem_peak(&app->run));
    pbs_stat_count(app, "memory_resident", (uint64_t)u.ru_maxrss * 1024);
}

static void print_stat(const pbs_app *app, FILE *f, const struct pbs_stat *s) {
    if (s->text)
        fprintf(f, "\"%s\"", app->channels);
    else if (s->integer)
        fprintf(f, "%.0f", s->value);
    else if (isfinite(s->value))
        fprintf(f, "%.9g", s->value);
    else
        fprintf(f, "null");
}

/* "-" is standard error: standard output is for results. Buffered and so in one piece, as several
 * programs of a pipe share it. */
static FILE *open_stats(const char *path) {
    if (strcmp(path, "-")) return fopen(path, "w");
    int copy = dup(2);
    FILE *f = copy < 0 ? NULL : fdopen(copy, "w");
    if (f) setvbuf(f, NULL, _IOFBF, BUFSIZ);
    if (!f && copy >= 0) close(copy);
    return f;
}

static pbs_code write_stats(pbs_app *app, pbs_err *err) {
    add_costs(app);
    for (int i = 0; i < app->stat_count && app->common.verbose; i++) {
        fprintf(stderr, "%s: %s ", app->tool->name, app->stats[i].name);
        print_stat(app, stderr, &app->stats[i]);
        fprintf(stderr, "\n");
    }
    const char *path = app->common.stats;
    if (!path) return PBS_OK;
    FILE *f = open_stats(path);
    if (!f) return pbs_fail_errno(err, "%s", path);
    fprintf(f, "{\"program\": \"%s\", \"version\": \"%s\"", app->tool->name, PBS_VERSION);
    for (int i = 0; i < app->stat_count; i++) {
        fprintf(f, ",\n \"%s\": ", app->stats[i].name);
        print_stat(app, f, &app->stats[i]);
    }
    fprintf(f, "}\n");
    if (ferror(f) | fclose(f)) return pbs_fail_errno(err, "%s", path);
    return PBS_OK;
}

/* ---- the frame ---- */

const char *pbs_operand(const pbs_app *app, int i) {
    return i < app->common.operand_count ? app->common.operands[i] : NULL;
}

void pbs_note(pbs_app *app, const char *fmt, ...) {
    if (app->common.quiet) return;
    char text[1024];
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(text, sizeof text, fmt, ap);
    va_end(ap);
    clear_progress(app);
    pbs_err clean; /* a note quotes names of files, as errors do */
    pbs_fail(&clean, PBS_OK, "%s", text);
    fprintf(stderr, "%s: %s\n", app->tool->name, clean.text);
}

void pbs_print_json_text(const char *s, size_t n) {
    putchar('"');
    for (size_t i = 0; i < n; i++) {
        unsigned char c = (unsigned char)s[i];
        if (c == '"' || c == '\\')
            printf("\\%c", c);
        else if (c < 0x20 || c == 0x7f)
            printf("\\u%04x", c);
        else
            putchar(c);
    }
    putchar('"');
}

/* Text on standard output is an output too: a full disk is an error. */
static pbs_code flush_stdout(pbs_err *err) {
    if (fflush(stdout) || ferror(stdout)) return pbs_fail_errno(err, "standard output");
    return PBS_OK;
}

static pbs_code print_and_end(const pbs_app *app, pbs_err *err) {
    if (app->common.version) {
        printf("%s %s\n", app->tool->name, PBS_VERSION);
    } else {
        char *help = pbs_cli_help(app->tool);
        if (!help) return pbs_fail(err, PBS_LIMIT, "no memory");
        fputs(help, stdout);
        free(help);
    }
    return flush_stdout(err);
}

void pbs_tool_whole(pbs_app *app) {
    app->whole = true;
}

static pbs_code run(pbs_app *app, void *options, pbs_code (*work)(pbs_app *, void *, pbs_err *),
                    pbs_err *err) {
    if (app->common.help || app->common.version) return print_and_end(app, err);
    pbs_code rc = set_limits(app, err);
    if (rc) return rc;
    if (!(app->stage = pbs_cli_stage(app->tool, options, &app->common)))
        return pbs_fail(err, PBS_LIMIT, "no memory");
    catch_signals();
    rc = work(app, options, err);
    clear_progress(app);
    if (!rc && app->progress_to >= 0) tell_progress(app, "done", 1, 0);
    if (!rc) rc = flush_stdout(err);
    if (rc && !app->whole) return rc;
    pbs_code told = write_stats(app, rc ? NULL : err);
    return rc ? rc : told;
}

int pbs_tool_main(int argc, char **argv, const pbs_tool *tool, void *options,
                  pbs_code (*work)(pbs_app *app, void *options, pbs_err *err)) {
    pbs_app app = {.tool = tool, .start = now(), .progress_to = -1};
    pbs_err err = {0};
    pbs_code rc = pbs_cli_parse(tool, argc, argv, options, &app.common, &err);
    if (!rc) rc = run(&app, options, work, &err);
    free(app.stage);
    if (app.progress_to >= 0) close(app.progress_to);
    if (rc) fprintf(stderr, "%s: %s\n", tool->name, err.text);
    return rc;
}
