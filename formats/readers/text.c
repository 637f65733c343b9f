#include "formats/readers/text.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef unsigned __int128 wide;

static bool is_digit(char c) {
    return (unsigned)(c - '0') < 10;
}

static char lower(char c) {
    return c >= 'A' && c <= 'Z' ? (char)(c + 32) : c;
}

bool pbs_text_is(pbs_span word, const char *what) {
    size_t n = strlen(what);
    if ((size_t)(word.end - word.p) != n) return false;
    for (size_t i = 0; i < n; i++)
        if (lower(word.p[i]) != lower(what[i])) return false;
    return true;
}

static bool begins(const char *p, const char *end, const char *what) {
    size_t n = strlen(what);
    return (size_t)(end - p) >= n && pbs_text_is((pbs_span){p, p + n}, what);
}

/* nan, -nan(ind), inf, infinity, and whatever a C library puts in parentheses. */
static bool parse_word(const char **at, const char *end, double *v) {
    const char *p = *at;
    bool minus = p < end && *p == '-';
    p += p < end && (*p == '-' || *p == '+');
    if (begins(p, end, "nan")) {
        *v = NAN;
        p += 3;
        if (p < end && *p == '(') {
            while (p < end && *p != ')' && !pbs_text_is_blank(*p)) p++;
            p += p < end && *p == ')';
        }
    } else if (begins(p, end, "inf")) {
        *v = minus ? -INFINITY : INFINITY;
        p += begins(p, end, "infinity") ? 8 : 3;
    } else {
        return false;
    }
    *at = p;
    return true;
}

/* Behind "1.": the way old Microsoft libraries print what is not finite. */
static bool parse_microsoft(const char **at, const char *p, const char *end, bool minus,
                            double *v) {
    if (begins(p, end, "#inf"))
        *v = minus ? -INFINITY : INFINITY;
    else if (begins(p, end, "#ind") || begins(p, end, "#qnan") || begins(p, end, "#snan"))
        *v = NAN;
    else
        return false;
    *at = pbs_text_skip_word(p, end);
    return true;
}

/* m / 10^k for k up to 19, rounded once: the quotient has 63 or 64 bits and a sticky one, and the
 * conversion to double rounds it. */
static double divide(uint64_t m, int k) {
    static const uint64_t ten[20] = {1u,
                                     10u,
                                     100u,
                                     1000u,
                                     10000u,
                                     100000u,
                                     1000000u,
                                     10000000u,
                                     100000000u,
                                     1000000000u,
                                     10000000000u,
                                     100000000000u,
                                     1000000000000u,
                                     10000000000000u,
                                     100000000000000u,
                                     1000000000000000u,
                                     10000000000000000u,
                                     100000000000000000u,
                                     1000000000000000000u,
                                     10000000000000000000u};
    int up = __builtin_clzll(m), down = __builtin_clzll(ten[k]);
    wide n = (wide)(m << up) << 63;
    uint64_t d = ten[k] << down, q = (uint64_t)(n / d);
    q |= (wide)q * d != n;
    return ldexp((double)q, down - up - 63);
}

/* Everything else: up to 770 significant digits and a sticky one decide any double. The text that
 * strtod sees has no decimal point, so the locale does not matter. */
static double parse_long(const char *p, const char *end, int64_t exponent) {
    char text[832];
    size_t n = 0;
    bool point = false, rest = false;
    for (; p < end; p++) {
        if (*p == '.') {
            point = true;
        } else if (n < 770) {
            if (n || *p != '0') text[n++] = *p;
            exponent -= point;
        } else {
            rest |= *p != '0';
            exponent += !point;
        }
    }
    if (rest) text[n++] = '1', exponent--;
    if (!n) return 0;
    exponent = exponent > 99999 ? 99999 : exponent < -99999 ? -99999 : exponent;
    snprintf(text + n, sizeof text - n, "e%d", (int)exponent);
    return strtod(text, NULL);
}

/* e, a sign, digits; *p stays where it is if it is something else. */
static int64_t parse_exponent(const char **p, const char *end) {
    const char *q = *p;
    int64_t e;
    if (q == end || (*q != 'e' && *q != 'E')) return 0;
    q++;
    if (!pbs_text_int(&q, end, &e)) return 0;
    *p = q;
    return e;
}

bool pbs_text_double(const char **at, const char *end, double *v) {
    static const double ten[23] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,
                                   1e8,  1e9,  1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
                                   1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
    const char *p = *at;
    bool minus = p < end && *p == '-';
    p += p < end && (*p == '-' || *p == '+');
    const char *first = p;
    uint64_t m = 0; /* wraps for long numbers, which do not use it */
    for (; p < end && is_digit(*p); p++) m = 10 * m + (uint64_t)(*p - '0');
    ptrdiff_t digits = p - first, exponent = 0;
    if (p < end && *p == '.') {
        const char *point = p++;
        for (; p < end && is_digit(*p); p++) m = 10 * m + (uint64_t)(*p - '0');
        exponent = point + 1 - p;
        digits -= exponent;
        if (!exponent && digits && p < end && *p == '#' && parse_microsoft(at, p, end, minus, v))
            return true;
    }
    if (!digits) return parse_word(at, end, v);
    const char *last = p;
    int64_t given = parse_exponent(&p, end), e = given + exponent;
    double x;
    if (digits > 19)
        x = parse_long(first, last, given);
    else if (m == 0)
        x = 0;
    else if (m <= (uint64_t)1 << 53 && e >= -22 && e <= 22)
        x = e < 0 ? m / ten[-e] : m * ten[e];
    else if (e >= -19 && e <= 0)
        x = divide(m, (int)-e);
    else
        x = parse_long(first, last, given);
    *v = minus ? -x : x;
    *at = p;
    return true;
}

pbs_lines pbs_lines_of(const void *bytes, size_t size) {
    pbs_lines l = {bytes, size ? (const char *)bytes + size : bytes, '\n'};
    if (size >= 3 && !memcmp(bytes, "\xef\xbb\xbf", 3)) l.p += 3;
    if (size && !memchr(bytes, '\n', size) && memchr(bytes, '\r', size)) l.eol = '\r';
    return l;
}

static bool joins(const char *begin, const char *eol) {
    if (eol > begin && eol[-1] == '\r') eol--;
    return eol > begin && eol[-1] == '\\' && *begin != '#';
}

bool pbs_lines_next(pbs_lines *l, pbs_span *line) {
    const char *begin = pbs_text_skip_blank(l->p, l->end), *p = begin, *eol;
    if (begin == l->end) return false;
    do {
        eol = memchr(p, l->eol, (size_t)(l->end - p));
        if (!eol) eol = l->end;
        p = eol < l->end ? eol + 1 : eol;
    } while (p < l->end && joins(begin, eol));
    l->p = p;
    *line = (pbs_span){begin, eol};
    return true;
}

const char *pbs_text_skip_joined(const char *p, const char *end) {
    p = pbs_text_skip_blank(p, end);
    while (p < end && *p == '\\' && (p + 1 == end || pbs_text_is_blank(p[1])))
        p = pbs_text_skip_blank(p + 1, end);
    return p;
}

static pbs_code no_number(const char *p, const char *end, pbs_err *err) {
    char name[PBS_NAME_MAX];
    pbs_text_name(name, (pbs_span){p, pbs_text_skip_word(p, end)});
    return pbs_fail(err, PBS_DATA, "\"%.40s\" is not a number", name);
}

pbs_code pbs_text_numbers(pbs_span rest, double *v, int max, int *got, pbs_err *err) {
    const char *p = rest.p, *end = rest.end;
    for (*got = 0; *got < max; (*got)++) {
        p = pbs_text_skip_joined(p, end);
        if (p == end || *p == '#') break;
        const char *first = p;
        if (!pbs_text_double(&p, end, &v[*got]) ||
            (p < end && !pbs_text_is_blank(*p) && *p != '#' && *p != '\\'))
            return no_number(first, end, err);
    }
    return PBS_OK;
}

static uint64_t count(const char *p, const char *end, char c) {
    uint64_t n = 0;
    while (p < end && (p = memchr(p, c, (size_t)(end - p)))) n++, p++;
    return n;
}

uint64_t pbs_text_line(const char *file, const char *at) {
    uint64_t n = count(file, at, '\n');
    return 1 + (n ? n : count(file, at, '\r'));
}

/* The length of the UTF-8 character at p; 0 if it is none. */
static size_t utf8(const unsigned char *p, const unsigned char *end) {
    size_t n = *p < 0x80 ? 1 : *p < 0xc2 ? 0 : *p < 0xe0 ? 2 : *p < 0xf0 ? 3 : *p < 0xf5 ? 4 : 0;
    if (n > (size_t)(end - p)) return 0;
    for (size_t i = 1; i < n; i++)
        if ((p[i] & 0xc0) != 0x80) return 0;
    if ((*p == 0xe0 && p[1] < 0xa0) || (*p == 0xed && p[1] > 0x9f) || (*p == 0xf0 && p[1] < 0x90) ||
        (*p == 0xf4 && p[1] > 0x8f))
        return 0;
    return n;
}

void pbs_text_name(char out[PBS_NAME_MAX], pbs_span text) {
    while (text.p < text.end && pbs_text_is_blank(*text.p)) text.p++;
    while (text.p < text.end && pbs_text_is_blank(text.end[-1])) text.end--;
    const unsigned char *p = (const unsigned char *)text.p, *end = (const unsigned char *)text.end;
    bool latin = false;
    for (size_t n; p < end && !latin; p += n) latin = !(n = utf8(p, end));
    size_t at = 0;
    for (p = (const unsigned char *)text.p; p < end && at + 4 < PBS_NAME_MAX;) {
        if (latin && *p >= 0x80) {
            out[at++] = (char)(0xc0 | *p >> 6);
            out[at++] = (char)(0x80 | (*p++ & 0x3f));
        } else {
            for (size_t n = latin ? 1 : utf8(p, end); n; n--, p++)
                out[at++] = *p < 0x20 || *p == 0x7f ? ' ' : (char)*p;
        }
    }
    out[at] = 0;
}
