#include "libcore/ground/cli.h"
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const pbs_option common_options[] = {
    {'o', "output", PBS_TEXT, offsetof(pbs_common, output), "FILE",
     "where the result goes (default: standard output)", 0, 0, NULL, false},
    {'j', "threads", PBS_COUNT, offsetof(pbs_common, threads), "N",
     "threads (default: all processors); never changes the result", 1, 256, NULL, false},
    {'m', "memory", PBS_BYTES, offsetof(pbs_common, memory), "SIZE",
     "limit of memory (default: half of the machine's)", 1 << 20, 0, NULL, false},
    {0, "stats", PBS_TEXT, offsetof(pbs_common, stats), "FILE",
     "write time, memory, counts and errors as JSON", 0, 0, NULL, false},
    {'v', "verbose", PBS_FLAG, offsetof(pbs_common, verbose), NULL,
     "say what was done, on standard error", 0, 0, NULL, false},
    {'q', "quiet", PBS_FLAG, offsetof(pbs_common, quiet), NULL,
     "no notes, no progress; errors only", 0, 0, NULL, false},
    {0, "help", PBS_FLAG, offsetof(pbs_common, help), NULL, "print this and exit", 0, 0, NULL,
     false},
    {0, "version", PBS_FLAG, offsetof(pbs_common, version), NULL, "print the version and exit", 0,
     0, NULL, false},
};
#define COMMON (sizeof common_options / sizeof common_options[0])

typedef struct parser {
    const pbs_tool *tool;
    void *options;
    pbs_common *common;
    pbs_err *err;
} parser;

/* Option number i: the tool's own first. */
static const pbs_option *option_at(const pbs_tool *t, size_t i) {
    if (i < t->option_count) return &t->options[i];
    i = i - t->option_count + t->no_output; /* -o is the first of the common ones */
    return i < COMMON ? &common_options[i] : NULL;
}

static const pbs_option *find(const pbs_tool *t, char letter, const char *name, size_t n) {
    const pbs_option *o;
    for (size_t i = 0; (o = option_at(t, i)); i++)
        if (name ? strlen(o->name) == n && !memcmp(o->name, name, n) : o->letter == letter)
            return o;
    return NULL;
}

static double suffix(const char *s, pbs_option_type type) {
    static const char letters[] = "kMG";
    if (!*s) return 1;
    const char *l = strchr(*s == 'K' ? "K" : letters, *s);
    if (!l || type == PBS_REAL) return 0;
    int power = *s == 'K' ? 1 : (int)(l - letters) + 1;
    if (!s[1]) return *s == 'K' ? 0 : pow(1000, power);
    if (type == PBS_BYTES && s[1] == 'i' && !s[2]) return pow(1024, power);
    return 0;
}

pbs_code pbs_cli_number(const char *text, pbs_option_type type, double *out, pbs_err *err) {
    char *end;
    /* strtod takes hexadecimal, inf and nan; a number of things is none of these */
    bool plain = *text && strspn(text, type == PBS_REAL ? "0123456789.+-eE" : "0123456789.kKMGi") ==
                              strlen(text);
    double v = strtod(text, &end), factor = plain && end != text ? suffix(end, type) : 0;
    v *= factor;
    /* 1.005k is a whole number, but 1.005 * 1000 in binary is not quite */
    if (factor > 1 && fabs(v - round(v)) <= 2.3e-16 * v) v = round(v);
    if (!(factor > 0) || !isfinite(v) || (type != PBS_REAL && (v < 0 || v > 9e15 || v != floor(v))))
        return pbs_fail(err, PBS_USAGE, "%s: not a number%s", text,
                        type == PBS_COUNT   ? " (such as 500, 100k or 1.5M)"
                        : type == PBS_BYTES ? " (such as 500M or 2Gi)"
                                            : "");
    *out = v;
    return PBS_OK;
}

static pbs_code set_number(const pbs_option *o, void *field, const char *value, pbs_err *err) {
    double v;
    pbs_code rc = pbs_cli_number(value, o->type, &v, err);
    if (rc) return pbs_fail_in(err, "--%s", o->name);
    if (v < o->min || (o->max != 0 && v > o->max))
        return o->max != 0 ? pbs_fail(err, PBS_USAGE, "--%s: %s: must be from %.16g to %.16g",
                                      o->name, value, o->min, o->max)
                           : pbs_fail(err, PBS_USAGE, "--%s: %s: must be at least %.16g", o->name,
                                      value, o->min);
    if (o->type == PBS_REAL)
        memcpy(field, &v, sizeof v);
    else
        memcpy(field, &(uint64_t){(uint64_t)v}, sizeof(uint64_t));
    return PBS_OK;
}

static pbs_code set_choice(const pbs_option *o, void *field, const char *value, pbs_err *err) {
    char all[200] = "";
    for (int i = 0; o->choices[i]; i++) {
        if (!strcmp(o->choices[i], value)) {
            memcpy(field, &i, sizeof i);
            return PBS_OK;
        }
        size_t n = strlen(all);
        snprintf(all + n, sizeof all - n, "%s%s", i ? ", " : "", o->choices[i]);
    }
    return pbs_fail(err, PBS_USAGE, "--%s: %s: must be one of %s", o->name, value, all);
}

static pbs_code set(parser *p, const pbs_option *o, const char *value) {
    bool own = o >= p->tool->options && o < p->tool->options + p->tool->option_count;
    void *field = (char *)(own ? p->options : (void *)p->common) + o->offset;
    if (own) p->common->given |= (uint64_t)1 << (o - p->tool->options);
    switch (o->type) {
    case PBS_FLAG:
        *(bool *)field = true;
        return PBS_OK;
    case PBS_TEXT:
        memcpy(field, &value, sizeof value);
        return PBS_OK;
    case PBS_CHOICE:
        return set_choice(o, field, value, p->err);
    default:
        return set_number(o, field, value, p->err);
    }
}

static pbs_code needs_value(const pbs_option *o, pbs_err *err) {
    return pbs_fail(err, PBS_USAGE, "--%s: needs a value: %s", o->name, o->value);
}

static pbs_code parse_long(parser *p, char *arg, char *next, int *used) {
    char *eq = strchr(arg, '=');
    size_t n = eq ? (size_t)(eq - arg) : strlen(arg);
    const pbs_option *o = find(p->tool, 0, arg + 2, n - 2);
    if (!o)
        return pbs_fail(p->err, PBS_USAGE, "%.*s: no such option (--help lists them)", (int)n, arg);
    if (o->type == PBS_FLAG)
        return eq ? pbs_fail(p->err, PBS_USAGE, "--%s: takes no value", o->name) : set(p, o, NULL);
    if (eq) return set(p, o, eq + 1);
    if (!next) return needs_value(o, p->err);
    *used = 2;
    return set(p, o, next);
}

static pbs_code parse_short(parser *p, char *arg, char *next, int *used) {
    pbs_code rc = PBS_OK;
    for (char *c = arg + 1; *c && !rc; c++) {
        const pbs_option *o = find(p->tool, *c, NULL, 0);
        if (!o) return pbs_fail(p->err, PBS_USAGE, "-%c: no such option (--help lists them)", *c);
        if (o->type == PBS_FLAG) {
            rc = set(p, o, NULL);
            continue;
        }
        if (c[1]) return set(p, o, c + 1);
        if (!next) return needs_value(o, p->err);
        *used = 2;
        return set(p, o, next);
    }
    return rc;
}

static pbs_code check_operands(const parser *p) {
    const pbs_tool *t = p->tool;
    const pbs_common *c = p->common;
    if (c->operand_count < t->operands_min)
        return pbs_fail(p->err, PBS_USAGE, "operands are missing: %s %s (--help says more)",
                        t->name, t->operands);
    if (t->operands_max >= 0 && c->operand_count > t->operands_max)
        return pbs_fail(p->err, PBS_USAGE, "%s: one operand too many",
                        c->operands[t->operands_max]);
    return PBS_OK;
}

pbs_code pbs_cli_parse(const pbs_tool *tool, int argc, char **argv, void *options,
                       pbs_common *common, pbs_err *err) {
    parser p = {tool, options, common, err};
    memset(common, 0, sizeof *common);
    common->operands = argv + 1;
    bool only_operands = false;
    for (int i = 1, used; i < argc; i += used) {
        char *arg = argv[i], *next = i + 1 < argc ? argv[i + 1] : NULL;
        pbs_code rc = PBS_OK;
        used = 1;
        if (only_operands || arg[0] != '-' || !arg[1])
            common->operands[common->operand_count++] = arg; /* at or before where it was */
        else if (!strcmp(arg, "--"))
            only_operands = true;
        else if (arg[1] == '-')
            rc = parse_long(&p, arg, next, &used);
        else
            rc = parse_short(&p, arg, next, &used);
        if (rc) return rc;
        if (common->help || common->version) return PBS_OK;
    }
    return check_operands(&p);
}

/* ---- text ---- */

typedef struct text {
    char *s;
    size_t n, cap;
} text;

__attribute__((format(printf, 2, 3))) static void add(text *t, const char *fmt, ...) {
    va_list ap;
    va_start(ap, fmt);
    char *piece;
    int n = vasprintf(&piece, fmt, ap);
    va_end(ap);
    if (n < 0) return;
    if (t->n + (size_t)n + 1 > t->cap) {
        size_t cap = 2 * (t->n + (size_t)n + 64);
        char *grown = realloc(t->s, cap);
        if (!grown) {
            free(piece);
            return;
        }
        t->s = grown;
        t->cap = cap;
    }
    memcpy(t->s + t->n, piece, (size_t)n + 1);
    t->n += (size_t)n;
    free(piece);
}

static void help_line(text *t, const pbs_option *o) {
    char left[80], letter[8] = "    ";
    if (o->letter) snprintf(letter, sizeof letter, "-%c, ", o->letter);
    snprintf(left, sizeof left, "%s--%s%s%s", letter, o->name, o->value ? " " : "",
             o->value ? o->value : "");
    add(t, "  %-26s  %s", left, o->help);
    for (int i = 0; o->choices && o->choices[i]; i++)
        add(t, "%s%s", i ? ", " : ": ", o->choices[i]);
    add(t, "\n");
}

char *pbs_cli_help(const pbs_tool *tool) {
    text t = {0};
    const pbs_option *o;
    add(&t, "Usage: %s [OPTION...] %s\n%s.\n\n", tool->name, tool->operands, tool->purpose);
    for (size_t i = 0; (o = option_at(tool, i)); i++) {
        if (i == tool->option_count && i) add(&t, "\n");
        help_line(&t, o);
    }
    add(&t, "\nman %s says more.\n", tool->name);
    return t.s;
}

static void add_value(text *t, const pbs_option *o, const void *field) {
    double real;
    uint64_t count;
    int choice;
    const char *s;
    switch (o->type) {
    case PBS_FLAG:
        break;
    case PBS_REAL:
        memcpy(&real, field, sizeof real), add(t, " %.17g", real);
        break;
    case PBS_TEXT:
        memcpy(&s, field, sizeof s), add(t, " %s", s);
        break;
    case PBS_CHOICE:
        memcpy(&choice, field, sizeof choice), add(t, " %s", o->choices[choice]);
        break;
    default:
        memcpy(&count, field, sizeof count), add(t, " %llu", (unsigned long long)count);
    }
}

char *pbs_cli_stage(const pbs_tool *tool, const void *options, const pbs_common *common) {
    text t = {0};
    add(&t, "%s", tool->name);
    for (size_t i = 0; i < tool->option_count; i++) {
        const pbs_option *o = &tool->options[i];
        if (!o->result || !(common->given >> i & 1)) continue;
        add(&t, " --%s", o->name);
        add_value(&t, o, (const char *)options + o->offset);
    }
    for (int i = 0; i < common->operand_count; i++) {
        const char *s = common->operands[i], *slash = strrchr(s, '/');
        add(&t, " %s", slash ? slash + 1 : s);
    }
    for (size_t i = 0; i < t.n; i++)
        if ((unsigned char)t.s[i] < 0x20) t.s[i] = '?'; /* one line, whatever a file is called */
    return t.s;
}
