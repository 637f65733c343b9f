/* Numbers against strtod, bit for bit; lines; names. */
#include "formats/readers/text.h"
#include "tests/check.h"
#include <locale.h>
#include <math.h>

static uint64_t seed = 7;
static uint32_t any(uint32_t n) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)((seed >> 33) % n);
}

/* Parsed from a block of exactly that size. */
static bool parse(const char *text, double *v, size_t *used) {
    size_t n = strlen(text);
    char *copy = malloc(n ? n : 1);
    if (!copy) abort();
    memcpy(copy, text, n);
    const char *p = copy;
    bool ok = pbs_text_double(&p, copy + n, v);
    *used = (size_t)(p - copy);
    free(copy);
    return ok;
}

static bool same(const char *text) {
    double got = 0, want;
    size_t used;
    char *end;
    want = strtod(text, &end);
    bool ok = parse(text, &got, &used) && used == (size_t)(end - text) && !memcmp(&got, &want, 8);
    if (!ok) printf("# %s: %.17g, strtod says %.17g\n", text, got, want);
    return ok;
}

TEST(numbers_as_strtod) {
    static const char *const list[] = {
        "0",
        "-0",
        "+1",
        "1.",
        ".5",
        "-.5e1",
        "1e2",
        "1E+2",
        "1e-2",
        "12345678901234567890",
        "0.1",
        "0.10000000000000000000000000001",
        "9007199254740993",
        "9007199254740993.0000001",
        "1e22",
        "1e23",
        "1e-22",
        "1e-23",
        "1e308",
        "1e309",
        "-1e400",
        "4.9e-324",
        "2.4703e-324",
        "2.2250738585072011e-308",
        "1e99999999999999999999",
        "1e-99999999999999999999",
        "0e99999999999999999999",
        "0.000000000000000000000000000000000000000000000001",
        "100000000000000000000000000000000000000000000000000000000000000000000000e-72",
        "179769313486231580793e289",
        "8.98846567431158e307",
        "0.30000000000000004",
        "18446744073709551615",
        "18446744073709551616",
        "9999999999999999999e-19",
        "2.00000000000000011102230246251565404236316680908203125",
        "2.00000000000000011102230246251565404236316680908203124",
        "2.00000000000000011102230246251565404236316680908203126"};
    for (size_t i = 0; i < sizeof list / sizeof *list; i++) CHECK(same(list[i]));
}

TEST(random_numbers_as_strtod) {
    char text[64];
    for (int i = 0; i < 200000; i++) {
        uint64_t bits = (uint64_t)any(UINT32_MAX) << 32 | any(UINT32_MAX);
        double v;
        memcpy(&v, &bits, 8);
        if (i % 2) v = ldexp((double)(bits >> 11), (int)any(60) - 80);
        if (!isfinite(v)) continue;
        static const char *const how[] = {"%.17g", "%.15g", "%.9g", "%.6f", "%.18e", "%.20g"};
        snprintf(text, sizeof text, how[any(6)], fabs(v) < 1e30 ? v : v / ldexp(1, 1000));
        CHECK(same(text));
    }
}

/* Random digits come nearer to the middle between two doubles than printed doubles do. */
TEST(random_digits_as_strtod) {
    char text[64];
    for (int i = 0; i < 200000; i++) {
        int digits = 1 + (int)any(21), point = (int)any(22);
        size_t n = 0;
        for (int k = 0; k < digits; k++) {
            if (k == point) text[n++] = '.';
            text[n++] = (char)('0' + any(10));
        }
        text[n] = 0;
        if (any(2)) snprintf(text + n, sizeof text - n, "e%d", (int)any(60) - 30);
        CHECK(same(text));
    }
}

/* Numbers exactly between two doubles, and one digit more or less, 800 digits long. */
TEST(halfway_numbers) {
    char text[1200];
    for (int i = 0; i < 2000; i++) {
        double v = ldexp(1 + any(1 << 30) * 0x1p-30 + any(1 << 22) * 0x1p-52, -(int)any(1040));
        long double half = (long double)v + (long double)(nextafter(v, 2 * v) - v) / 2;
        int n = snprintf(text, sizeof text, "%.*Lf", 780 + (int)any(320), half);
        CHECK(n > 0 && same(text));
        text[n - 1] = '1';
        CHECK(same(text));
    }
}

TEST(numbers_do_not_depend_on_the_locale) {
    char old[64];
    snprintf(old, sizeof old, "%s", setlocale(LC_ALL, NULL));
    if (!setlocale(LC_ALL, "de_DE.UTF-8") && !setlocale(LC_ALL, "fr_FR.UTF-8"))
        SKIP("no locale with a decimal comma installed");
    double v = 0;
    size_t used;
    CHECK(parse("1.2345678901234567890123", &v, &used) && v == 1.2345678901234567890123);
    setlocale(LC_ALL, old);
}

TEST(what_is_not_finite) {
    static const char *const nan_list[] = {"nan",       "NaN",     "-nan",      "nan(ind)",
                                           "-nan(ind)", "1.#QNAN", "-1.#IND00", "1.#SNAN"};
    static const char *const inf_list[] = {"inf", "INF", "+Infinity", "1.#INF", "1.#INF00"};
    double v;
    size_t used;
    for (size_t i = 0; i < sizeof nan_list / sizeof *nan_list; i++)
        CHECK(parse(nan_list[i], &v, &used) && isnan(v) && used == strlen(nan_list[i]));
    for (size_t i = 0; i < sizeof inf_list / sizeof *inf_list; i++)
        CHECK(parse(inf_list[i], &v, &used) && v == INFINITY && used == strlen(inf_list[i]));
    CHECK(parse("-inf", &v, &used) && v == -INFINITY);
    CHECK(parse("-1.#INF", &v, &used) && v == -INFINITY);
}

TEST(no_numbers) {
    static const char *const list[] = {"",  "-",  "+", ".",  "-.", "e5",
                                       "x", "-x", "#", "na", "in", "/1"};
    double v;
    size_t used;
    for (size_t i = 0; i < sizeof list / sizeof *list; i++)
        CHECK(!parse(list[i], &v, &used) && used == 0);
    CHECK(parse("1e", &v, &used) && v == 1 && used == 1);
    CHECK(parse("1e+", &v, &used) && v == 1 && used == 1);
    CHECK(parse("1.5.5", &v, &used) && v == 1.5 && used == 3);
    CHECK(parse("1.#comment", &v, &used) && v == 1 && used == 2);
}

TEST(integers) {
    static const char text[] = "-12/+7/x99999999999999999999999";
    const char *p = text, *end = text + sizeof text - 1;
    int64_t v;
    CHECK(pbs_text_int(&p, end, &v) && v == -12 && *p == '/');
    p++;
    CHECK(pbs_text_int(&p, end, &v) && v == 7 && *p == '/');
    p++;
    CHECK(!pbs_text_int(&p, end, &v) && *p == 'x');
    p++;
    CHECK(pbs_text_int(&p, end, &v) && v >= 100000000000000000 && p == end);
}

TEST(lines) {
    static const char text[] = "\xef\xbb\xbf  one\r\n\r\n# a\\\r\ntwo \\\r\n 2 \\\n3\nlast\\";
    static const char *const want[] = {"one\r", "# a\\\r", "two \\\r\n 2 \\\n3", "last\\"};
    static const uint64_t number[] = {1, 3, 4, 7};
    pbs_lines l = pbs_lines_of(text, sizeof text - 1);
    pbs_span line;
    for (int i = 0; i < 4; i++) {
        CHECK(pbs_lines_next(&l, &line));
        CHECK((size_t)(line.end - line.p) == strlen(want[i]) &&
              !memcmp(line.p, want[i], strlen(want[i])));
        CHECK_NUM(pbs_text_line(text, line.p) == number[i], pbs_text_line(text, line.p));
    }
    CHECK(!pbs_lines_next(&l, &line));
    l = pbs_lines_of("a\rb\r", 4);
    CHECK(pbs_lines_next(&l, &line) && line.end - line.p == 1 && *line.p == 'a');
    CHECK(pbs_lines_next(&l, &line) && line.end - line.p == 1 && *line.p == 'b');
    CHECK(!pbs_lines_next(&l, &line));
    CHECK(pbs_text_line("a\rb\r", "a\rb\r") == 1);
    l = pbs_lines_of(NULL, 0);
    CHECK(!pbs_lines_next(&l, &line));
}

static bool name_is(const char *text, size_t n, const char *want) {
    char out[PBS_NAME_MAX];
    pbs_text_name(out, (pbs_span){text, text + n});
    return !strcmp(out, want);
}

TEST(names) {
    CHECK(name_is("  a b\tc \r", 9, "a b c"));
    CHECK(name_is("", 0, ""));
    CHECK(name_is("Terrainst\xfc\x63k", 12,
                  "Terrainst\xc3\xbc"
                  "ck"));
    CHECK(name_is("Terrainst\xc3\xbc", 11, "Terrainst\xc3\xbc"));
    CHECK(name_is("\xc3", 1, "\xc3\x83"));                         /* cut off: Latin-1 */
    CHECK(name_is("\xed\xa0\x80", 3, "\xc3\xad\xc2\xa0\xc2\x80")); /* a surrogate is not UTF-8 */
    CHECK(name_is("a\0b", 3, "a b"));
    char longer[3000];
    memset(longer, 0xfc, sizeof longer);
    char out[PBS_NAME_MAX];
    pbs_text_name(out, (pbs_span){longer, longer + sizeof longer});
    CHECK(strlen(out) < PBS_NAME_MAX && strlen(out) % 2 == 0 && strlen(out) > 400);
}

TEST_MAIN
