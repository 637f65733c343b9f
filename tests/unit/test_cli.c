/* The command line: every form, every type, hostile numbers, the exact texts of the errors (they
 * are the user interface), provenance and help. */
#include "libcore/ground/cli.h"
#include "tests/check.h"
#include <math.h>

typedef struct options {
    bool all, brief;
    uint64_t number, size;
    double real, signed_real;
    const char *text;
    int method;
} options;

static const char *const methods[] = {"exact", "random", "off", NULL};
static const pbs_option table[] = {
    {'a', "all", PBS_FLAG, offsetof(options, all), NULL, "take all", 0, 0, NULL, true},
    {'b', "brief", PBS_FLAG, offsetof(options, brief), NULL, "say less", 0, 0, NULL, false},
    {'n', "number", PBS_COUNT, offsetof(options, number), "N", "how many", 1, 1e6, NULL, true},
    {'s', "size", PBS_BYTES, offsetof(options, size), "SIZE", "how large", 0, 0, NULL, true},
    {'r', "real", PBS_REAL, offsetof(options, real), "X", "how far", 0, 10, NULL, true},
    {0, "signed", PBS_REAL, offsetof(options, signed_real), "X", "where", -1e9, 0, NULL, true},
    {'t', "text", PBS_TEXT, offsetof(options, text), "TEXT", "what", 0, 0, NULL, true},
    {0, "method", PBS_CHOICE, offsetof(options, method), "NAME", "one of", 0, 0, methods, true},
};
static const pbs_tool tool = {"pbs-test", "does nothing", "[FILE...]", 0, 2, table, 8, false};

typedef struct result {
    options o;
    pbs_common c;
    pbs_code rc;
    pbs_err err;
    char *argv[24];
    char line[2000]; /* argv points into it */
} result;

/* Words are separated by one space; two in a row make an empty word. */
static void parse_with(result *r, const pbs_tool *t, const char *line) {
    memset(r, 0, sizeof *r);
    r->o.number = 5;
    snprintf(r->line, sizeof r->line, "%s %s", t->name, line);
    int argc = 0;
    char *p = r->line, *word;
    while ((word = strsep(&p, " "))) r->argv[argc++] = word;
    if (!*line) argc = 1;
    r->rc = pbs_cli_parse(t, argc, r->argv, &r->o, &r->c, &r->err);
}
static void parse(result *r, const char *line) {
    parse_with(r, &tool, line);
}

static void expect_error(const char *line, const char *text) {
    result r;
    parse(&r, line);
    if (r.rc != PBS_USAGE || r.err.code != PBS_USAGE || strcmp(r.err.text, text)) {
        printf("# \"%s\" gives %d \"%s\", not \"%s\"\n", line, (int)r.rc, r.err.text, text);
        pbs_bad++;
    }
}

TEST(defaults_stay) {
    result r;
    parse(&r, "");
    CHECK(r.rc == PBS_OK && r.o.number == 5 && !r.o.all && !r.o.text && r.c.given == 0);
    CHECK(r.c.operand_count == 0 && !r.c.output && !r.c.threads && !r.c.memory && !r.c.verbose);
}

TEST(forms) {
    static const char *const same[] = {"--number=7 --all --text=x f",
                                       "--number 7 -a -t x f",
                                       "-n7 -atx f",
                                       "f -an 7 -tx",
                                       "-an7 f --text x",
                                       "-n 1 -tx -n 7 --all f",
                                       "-atx --number=7 -- f",
                                       "-a -n7 -t x -- f"};
    for (size_t i = 0; i < sizeof same / sizeof same[0]; i++) {
        result r;
        parse(&r, same[i]);
        bool ok = !r.rc && r.o.number == 7 && r.o.all && !r.o.brief && r.o.text &&
                  !strcmp(r.o.text, "x") && r.c.operand_count == 1 &&
                  !strcmp(r.c.operands[0], "f") && r.c.given == (1 | 4 | 64);
        if (!ok) printf("# %s: %s\n", same[i], r.err.text), pbs_bad++;
    }
}

TEST(flags_together) {
    result r;
    parse(&r, "-vabq");
    CHECK(!r.rc && r.o.all && r.o.brief && r.c.verbose && r.c.quiet && r.c.given == 3);
}

TEST(operands) {
    result r;
    parse(&r, "one - ");
    CHECK(r.rc == PBS_USAGE); /* an empty word is an operand as well */
    parse(&r, "one -a -");
    CHECK(!r.rc && r.c.operand_count == 2 && !strcmp(r.c.operands[1], "-"));
    parse(&r, "-- -a --");
    CHECK(!r.rc && r.c.operand_count == 2 && !r.o.all && !strcmp(r.c.operands[0], "-a") &&
          !strcmp(r.c.operands[1], "--"));
    parse(&r, "-t -- x");
    CHECK(!r.rc && !strcmp(r.o.text, "--") && r.c.operand_count == 1);
    parse(&r, "--text= x");
    CHECK(!r.rc && !strcmp(r.o.text, ""));
    parse(&r, "--text=a=b");
    CHECK(!r.rc && !strcmp(r.o.text, "a=b"));
}

TEST(common_options) {
    result r;
    parse(&r, "-o out -j8 -m 2Gi --stats s.json -v -q in");
    CHECK(!r.rc && !strcmp(r.c.output, "out") && r.c.threads == 8 && r.c.memory == 2ull << 30);
    CHECK(!strcmp(r.c.stats, "s.json") && r.c.verbose && r.c.quiet && r.c.given == 0);
    expect_error("-j0", "--threads: 0: must be from 1 to 256");
    expect_error("-j 257", "--threads: 257: must be from 1 to 256");
    expect_error("-m1", "--memory: 1: must be at least 1048576");
    pbs_tool text = tool;
    text.no_output = true;
    parse_with(&r, &text, "-o x");
    CHECK(r.rc == PBS_USAGE && !strcmp(r.err.text, "-o: no such option (--help lists them)"));
}

TEST(errors) {
    expect_error("--nope", "--nope: no such option (--help lists them)");
    expect_error("--nope=3", "--nope: no such option (--help lists them)");
    expect_error("--num 3", "--num: no such option (--help lists them)");
    expect_error("--numbers 3", "--numbers: no such option (--help lists them)");
    expect_error("--=3", "--: no such option (--help lists them)");
    expect_error("-az", "-z: no such option (--help lists them)");
    expect_error("--all=yes", "--all: takes no value");
    expect_error("--number", "--number: needs a value: N");
    expect_error("-an", "--number: needs a value: N");
    expect_error("--text", "--text: needs a value: TEXT");
    expect_error("a b c", "c: one operand too many");
    expect_error("--method=fast", "--method: fast: must be one of exact, random, off");
    expect_error("--method=", "--method: : must be one of exact, random, off");
    expect_error("--method=exac", "--method: exac: must be one of exact, random, off");
    expect_error("-n0", "--number: 0: must be from 1 to 1000000");
    expect_error("-n 2M", "--number: 2M: must be from 1 to 1000000");
    expect_error("-r 11", "--real: 11: must be from 0 to 10");
    expect_error("-r -5", "--real: -5: must be from 0 to 10");
    expect_error("-n x", "--number: x: not a number (such as 500, 100k or 1.5M)");
    expect_error("-s x", "--size: x: not a number (such as 500M or 2Gi)");
    expect_error("-r x", "--real: x: not a number");
    pbs_tool needs = tool;
    needs.operands = "FILE", needs.operands_min = 1;
    result r;
    parse_with(&r, &needs, "-a");
    CHECK(r.rc == PBS_USAGE &&
          !strcmp(r.err.text, "operands are missing: pbs-test FILE (--help says more)"));
    needs.operands_max = -1;
    parse_with(&r, &needs, "a b c d e");
    CHECK(!r.rc && r.c.operand_count == 5);
}

TEST(help_and_version_come_first) {
    pbs_tool needs = tool;
    needs.operands_min = 1;
    result r;
    parse_with(&r, &needs, "--help");
    CHECK(!r.rc && r.c.help);
    parse_with(&r, &needs, "--version --nope");
    CHECK(!r.rc && r.c.version);
    parse_with(&r, &needs, "a b c d --help -n x");
    CHECK(!r.rc && r.c.help);
}

TEST(choices) {
    for (int i = 0; methods[i]; i++) {
        char line[40];
        result r;
        snprintf(line, sizeof line, "--method %s", methods[i]);
        parse(&r, line);
        CHECK(!r.rc && r.o.method == i);
    }
}

/* ---- numbers ---- */

static double number(const char *text, pbs_option_type type) {
    double v = -12345;
    pbs_err err = {0};
    pbs_code rc = pbs_cli_number(text, type, &v, &err);
    if (rc && (rc != PBS_USAGE || err.code != rc || !strstr(err.text, ": not a number")))
        return NAN;
    return rc ? -1 : v;
}

TEST(suffixes) {
    static const struct {
        const char *text;
        double count, bytes; /* -1: refused */
    } row[] = {
        {"0", 0, 0},
        {"1", 1, 1},
        {"007", 7, 7},
        {"100k", 1e5, 1e5},
        {"1.5M", 15e5, 15e5},
        {".5k", 500, 500},
        {"5.k", 5000, 5000},
        {"2G", 2e9, 2e9},
        {"1Ki", -1, 1024},
        {"1ki", -1, 1024},
        {"2Mi", -1, 2 << 20},
        {"0.5Gi", -1, 1 << 29},
        {"1K", -1, -1},
        {"1m", -1, -1},
        {"1g", -1, -1},
        {"1T", -1, -1},
        {"1kk", -1, -1},
        {"1kiB", -1, -1},
        {"1i", -1, -1},
        {"1 k", -1, -1},
        {"k", -1, -1},
        {"1.2Ki", -1, -1},
        {"1.0005k", -1, -1},
        {"0.1", -1, -1},
        {"9000000G", 9e15, 9e15},
        {"9000001G", -1, -1},
        {"1.00", 1, 1},
        {"1.0000001", -1, -1},
        {"1.0000001M", -1, -1},
        {"1.0000001G", 1000000100, 1000000100},
    };
    for (size_t i = 0; i < sizeof row / sizeof row[0]; i++) {
        double c = number(row[i].text, PBS_COUNT), b = number(row[i].text, PBS_BYTES);
        if (c == row[i].count && b == row[i].bytes) continue;
        printf("# %s gives %.17g and %.17g\n", row[i].text, c, b);
        pbs_bad++;
    }
}

/* Every whole number can be written with a suffix, though most decimals are no binary fractions. */
TEST(suffix_decimals) {
    char text[40];
    int wrong = 0;
    for (int i = 0; i < 20000; i++) {
        snprintf(text, sizeof text, "%d.%03dk", i / 1000, i % 1000);
        wrong += number(text, PBS_COUNT) != i;
        snprintf(text, sizeof text, "%d.%06dM", i * 7 / 1000000, i * 7 % 1000000);
        wrong += number(text, PBS_COUNT) != i * 7;
        snprintf(text, sizeof text, "%d.%09dG", i, (int)(i * 7919ll % 1000000000));
        wrong += number(text, PBS_COUNT) != i * 1e9 + (double)(i * 7919ll % 1000000000);
    }
    CHECK_NUM(wrong == 0, wrong);
}

TEST(hostile_numbers) {
    static const char *const never[] = {
        "",     " ",    ".",     "-",   "+",        "e5",    "1e400", "nan", "NaN", "inf",
        "-inf", "0x10", "1e",    "1e+", "1,5",      "1.2.3", " 1",    "1 ",  "--1", "1-1",
        "١",    "1e5k", "1_000", "1\n", "infinity", "1p3",   "0x1p3", "1d5"};
    for (size_t i = 0; i < sizeof never / sizeof never[0]; i++)
        for (int t = PBS_COUNT; t <= PBS_REAL; t++)
            if (number(never[i], (pbs_option_type)t) != -1) {
                printf("# \"%s\" is taken as type %d\n", never[i], t);
                pbs_bad++;
            }
    static const char *const no_count[] = {"-5",
                                           "+5",
                                           "1e5",
                                           "-0",
                                           "1e-3",
                                           "10000000000000000",
                                           "99999999999999999999999999999999999999999999"};
    for (size_t i = 0; i < sizeof no_count / sizeof no_count[0]; i++)
        for (int t = PBS_COUNT; t <= PBS_BYTES; t++)
            CHECK(number(no_count[i], (pbs_option_type)t) == -1);
    CHECK(number("1e5", PBS_REAL) == 1e5 && number("+2.5", PBS_REAL) == 2.5);
    CHECK(number("1E-3", PBS_REAL) == 1e-3 && number(".5", PBS_REAL) == 0.5);
    CHECK(number("1e-400", PBS_REAL) == 0 && number("3k", PBS_REAL) == -1);
    result r;
    parse(&r, "--signed -5.5");
    CHECK(!r.rc && r.o.signed_real == -5.5);
    expect_error("--signed=-1e10", "--signed: -1e10: must be at least -1000000000");
    expect_error("-n 1e400", "--number: 1e400: not a number (such as 500, 100k or 1.5M)");
    expect_error("-r nan", "--real: nan: not a number");
}

/* ---- texts ---- */

static void expect_stage(const char *line, const char *text) {
    result r;
    parse(&r, line);
    char *s = pbs_cli_stage(&tool, &r.o, &r.c);
    if (strcmp(s, text)) printf("# \"%s\" gives \"%s\", not \"%s\"\n", line, s, text), pbs_bad++;
    free(s);
}

TEST(provenance) {
    expect_stage("", "pbs-test");
    /* what does not determine the result is left out; the order is the table's */
    expect_stage("-o out -j3 -m1G -v -b", "pbs-test");
    expect_stage("--method off -tx -n 1.5k -a -r 0.5 dir/sub/f.glb /g",
                 "pbs-test --all --number 1500 --real 0.5 --text x --method off f.glb g");
    expect_stage("-s 2Ki --signed=-3", "pbs-test --size 2048 --signed -3");
    expect_stage("-t a\nb\x01 c\td", "pbs-test --text a?b? c?d");
    /* a number comes back as the same bits */
    result r;
    parse(&r, "-r 0.1");
    char *s = pbs_cli_stage(&tool, &r.o, &r.c);
    CHECK(!strncmp(s, "pbs-test --real ", 16) && strtod(s + 16, NULL) == 0.1);
    free(s);
    /* the line gives the same line again */
    parse(&r, "--method off -tx -n 1.5k -a -r 0.3 f");
    s = pbs_cli_stage(&tool, &r.o, &r.c);
    expect_stage(s + strlen("pbs-test "), s);
    free(s);
}

TEST(help_text) {
    char *s = pbs_cli_help(&tool);
    CHECK(!strncmp(s, "Usage: pbs-test [OPTION...] [FILE...]\ndoes nothing.\n\n", 53));
    CHECK(strstr(s, "\n  -n, --number N              how many\n") != NULL);
    CHECK(strstr(s, "\n      --method NAME           one of: exact, random, off\n") != NULL);
    CHECK(strstr(s, "\n  -o, --output FILE           where the result goes"));
    CHECK(strstr(s, "\n\nman pbs-test says more.\n"));
    for (size_t i = 0; i < tool.option_count; i++) {
        char name[40];
        snprintf(name, sizeof name, "--%s ", table[i].name);
        CHECK(strstr(s, name) && strstr(s, table[i].help));
    }
    free(s);
    pbs_tool text = tool;
    text.no_output = true;
    s = pbs_cli_help(&text);
    CHECK(!strstr(s, "--output") && strstr(s, "--threads"));
    free(s);
}

TEST_MAIN
