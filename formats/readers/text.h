/* text.h: numbers, names and places in text files that are mapped, so not NUL-terminated.
 *
 * Nothing here depends on the locale, keeps a state or counts lines while reading: the line of a
 * place is counted when an error needs it.
 */
#ifndef PBS_TEXT_H
#define PBS_TEXT_H

#include "libcore/ground/err.h"
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* A piece of the file. */
typedef struct pbs_span {
    const char *p, *end;
} pbs_span;

/* Space, tab, and the ends of lines. */
static inline bool pbs_text_is_blank(char c) {
    return c == ' ' || (c >= '\t' && c <= '\r');
}

static inline const char *pbs_text_skip_blank(const char *p, const char *end) {
    while (p < end && pbs_text_is_blank(*p)) p++;
    return p;
}
static inline const char *pbs_text_skip_word(const char *p, const char *end) {
    while (p < end && !pbs_text_is_blank(*p)) p++;
    return p;
}
/* Skips blanks, then takes what comes up to the next blank; empty at the end. */
static inline pbs_span pbs_text_word(const char **p, const char *end) {
    pbs_span word = {pbs_text_skip_blank(*p, end), NULL};
    word.end = *p = pbs_text_skip_word(word.p, end);
    return word;
}

/* A number at *p, which goes behind it: the double nearest to what is written, for any number of
 * digits. Also nan, inf, infinity in any case and Microsoft's 1.#INF, 1.#QNAN, -nan(ind). False,
 * with *p unchanged, if there is none. */
bool pbs_text_double(const char **p, const char *end, double *v);

/* The same for an integer; beyond +-10^17 it stays there. */
static inline bool pbs_text_int(const char **p, const char *end, int64_t *v) {
    const char *s = *p;
    bool minus = s < end && *s == '-';
    s += s < end && (*s == '-' || *s == '+');
    const char *first = s;
    int64_t m = 0;
    for (; s < end && (unsigned)(*s - '0') < 10; s++) {
        m = 10 * m + (*s - '0');
        if (m > 100000000000000000) m = 100000000000000000;
    }
    if (s == first) return false;
    *p = s;
    *v = minus ? -m : m;
    return true;
}

/* Is the word this one, in any case of A-Z? */
bool pbs_text_is(pbs_span word, const char *what);

/* The lines of a file, one after the other. A backslash at the end of a line joins the next one to
 * it, except in a comment (#), where it usually is the end of a Windows path. */
typedef struct pbs_lines {
    const char *p, *end;
    char eol;
} pbs_lines;

/* Skips the mark of UTF-8; lines end with CR if the file has no LF. */
pbs_lines pbs_lines_of(const void *bytes, size_t size);
/* The next line that has something in it, without the blanks at its beginning. */
bool pbs_lines_next(pbs_lines *l, pbs_span *line);
/* Skips blanks and backslashes that join lines. */
const char *pbs_text_skip_joined(const char *p, const char *end);
/* Reads up to max numbers from the rest of a line, which ends at #. PBS_DATA: a word is no number;
 * the error doesn't say the line yet. */
pbs_code pbs_text_numbers(pbs_span rest, double *v, int max, int *got, pbs_err *err);

/* The number, from 1, of the line that `at` is in. Lines end with LF, CR LF or, in a file without
 * any LF, with CR. */
uint64_t pbs_text_line(const char *file, const char *at);

/* Trims blanks and copies as UTF-8, cut to fit; text that is not UTF-8 is taken for Latin-1.
 * Control characters become spaces. */
enum { PBS_NAME_MAX = 512 };
void pbs_text_name(char out[PBS_NAME_MAX], pbs_span text);
#endif
