#include "libcore/ground/err.h"
#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

/* Messages quote file names and bytes of damaged files: keep the terminal safe. */
static void clean(char *s) {
    for (; *s; s++)
        if ((unsigned char)*s < 0x20 || *s == 0x7f) *s = '?';
}

pbs_code pbs_fail(pbs_err *err, pbs_code code, const char *fmt, ...) {
    if (!err) return code;
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(err->text, sizeof err->text, fmt, ap);
    va_end(ap);
    clean(err->text);
    return err->code = code;
}

pbs_code pbs_fail_in(pbs_err *err, const char *fmt, ...) {
    if (!err) return PBS_INTERNAL;
    char place[sizeof err->text], text[2 * sizeof err->text + 2];
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(place, sizeof place, fmt, ap);
    va_end(ap);
    snprintf(text, sizeof text, "%s: %s", place, err->text);
    clean(text);
    memcpy(err->text, text, sizeof err->text - 1);
    err->text[sizeof err->text - 1] = 0;
    return err->code;
}

pbs_code pbs_fail_errno(pbs_err *err, const char *fmt, ...) {
    int no = errno;
    pbs_code code = no == ENOMEM ? PBS_LIMIT : PBS_IO;
    if (!err) return code;
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(err->text, sizeof err->text, fmt, ap);
    va_end(ap);
    size_t n = strlen(err->text);
    snprintf(err->text + n, sizeof err->text - n, ": %s", strerror(no));
    clean(err->text);
    return err->code = code;
}
