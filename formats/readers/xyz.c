/* Point clouds as text (XYZ, PTS, CSV and their like): a line a point, numbers with blanks, commas
 * or semicolons between.
 *
 *     x y z                       x y z intensity
 *     x y z r g b                 x y z intensity r g b
 *     x y z r g b nx ny nz        x y z nx ny nz: with negative numbers among the last three
 *
 * What follows seven numbers is skipped. All lines have as many numbers as the first one. A line
 * with one number says how many follow (PTS). Lines that begin with # or // are skipped, and so is
 * the first one if it names columns. */
#include "formats/readers/cloud.h"
#include "formats/readers/text.h"
#include <math.h>

enum { COLUMNS = 32 };

typedef struct text {
    pbs_cloud *c;
    pbs_output rows;
    int columns, colour; /* numbers in a line; which is red, 0: none */
    uint64_t points, promised;
    float most;
    bool fraction, negative;
} text;

static bool is_gap(char c) {
    return pbs_text_is_blank(c) || c == ',' || c == ';';
}

/* The numbers of a line, at most COLUMNS; *whole: there is nothing else in it. */
static int numbers(pbs_span line, double v[COLUMNS], bool *whole) {
    int n = 0;
    const char *p = line.p;
    for (*whole = true; *whole;) {
        while (p < line.end && is_gap(*p)) p++;
        if (p == line.end) break;
        double d;
        *whole = pbs_text_double(&p, line.end, &d) && (p == line.end || is_gap(*p));
        if (*whole && n < COLUMNS) v[n++] = d;
    }
    return n;
}

static pbs_code put_row(text *t, const double v[COLUMNS], pbs_err *err) {
    pbs_cloud_row row = {{v[0], v[1], v[2]}, {0}, 0};
    for (int k = 0; k < 3 && t->colour; k++) {
        float c = row.colour[k] = (float)v[t->colour + k];
        t->most = c > t->most ? c : t->most;
        t->negative |= c < 0;
        t->fraction |= c != floorf(c);
    }
    t->points++;
    return pbs_output_write(&t->rows, &row, sizeof row, err);
}

static pbs_code take_line(text *t, pbs_span line, bool first, pbs_err *err) {
    double v[COLUMNS];
    bool whole;
    int n = numbers(line, v, &whole);
    if (!whole && first) return PBS_OK; /* names of columns */
    if (whole && n == 1 && v[0] >= 0 && v[0] < 1e18 && v[0] == floor(v[0])) {
        t->promised += (uint64_t)v[0];
        return PBS_OK;
    }
    if (!whole) return pbs_fail(err, PBS_DATA, "is no point: a word that is no number");
    if (!t->columns) {
        t->columns = n;
        t->colour = n == 6 || n == 9 ? 3 : n >= 7 ? 4 : 0;
    }
    if (n != t->columns || n < 3)
        return pbs_fail(err, PBS_DATA, "is no point: %d number%s where %s%d are expected", n,
                        n == 1 ? "" : "s", t->columns < 3 ? "at least " : "",
                        t->columns < 3 ? 3 : t->columns);
    return put_row(t, v, err);
}

static bool is_comment(pbs_span l) {
    return *l.p == '#' || (l.end - l.p >= 2 && l.p[0] == '/' && l.p[1] == '/');
}

static pbs_code read_lines(text *t, pbs_err *err) {
    const char *file = (const char *)t->c->in.bytes, *end = file + t->c->in.size, *p = file;
    pbs_trim trim;
    pbs_code rc = PBS_OK;
    bool first = true;
    pbs_trim_open(t->c->run, &trim);
    pbs_trim_add(&trim, file, (size_t)t->c->in.size);
    if (end - p >= 3 && !memcmp(p, "\xef\xbb\xbf", 3)) p += 3;
    char eol = memchr(p, '\n', (size_t)(end - p)) ? '\n' : '\r';
    for (uint64_t i = 0; p < end && !rc; i++) {
        const char *e = memchr(p, eol, (size_t)(end - p));
        pbs_span line = {pbs_text_skip_blank(p, e ? e : end), e ? e : end};
        p = e ? e + 1 : end;
        if (line.p != line.end && !is_comment(line)) {
            rc = take_line(t, line, first, err);
            first = false;
        }
        if (rc == PBS_DATA)
            pbs_fail_in(err, "line %llu", (unsigned long long)pbs_text_line(file, line.p));
        if (!rc && i % 65536 == 65535) {
            pbs_trim_now(&trim);
            rc = pbs_run_check(t->c->run, err);
        }
    }
    pbs_trim_close(&trim);
    return rc;
}

pbs_code pbs_cloud_text(pbs_cloud *c, pbs_err *err) {
    text t = {.c = c};
    pbs_code rc = pbs_output_spool(c->run, &t.rows, err);
    if (rc) return rc;
    rc = read_lines(&t, err);
    if (!rc && t.promised > t.points)
        rc = pbs_fail(err, PBS_DATA, "cut off: it says %llu points, and %llu of them are there",
                      (unsigned long long)t.promised, (unsigned long long)t.points);
    if (!rc && !t.points) rc = pbs_fail(err, PBS_DATA, "no points in it");
    if (rc) {
        pbs_output_close(&t.rows);
        return rc;
    }
    return pbs_cloud_rows(c, &t.rows, t.colour && !t.negative, t.most, t.fraction, err);
}
