/* check.h: a unit test is TEST(name) { ... CHECK(condition); ... }; a program ends with
 * TEST_MAIN. Each prints "ok NAME", "not ok NAME" or "skip NAME: why" and tests/run counts the
 * lines. */
#ifndef PBS_CHECK_H
#define PBS_CHECK_H
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct pbs_test {
    const char *name;
    void (*fn)(void);
    struct pbs_test *next;
} pbs_test;
static pbs_test *pbs_tests, **pbs_tests_end = &pbs_tests;
static int pbs_bad;
static const char *pbs_skip_why;

#define TEST(n)                                                                                    \
    static void test_##n(void);                                                                    \
    __attribute__((constructor)) static void add_##n(void) {                                       \
        static pbs_test t = {#n, test_##n, 0};                                                     \
        *pbs_tests_end = &t;                                                                       \
        pbs_tests_end = &t.next;                                                                   \
    }                                                                                              \
    static void test_##n(void)

#define CHECK(c)                                                                                   \
    do {                                                                                           \
        if (!(c)) {                                                                                \
            printf("# %s:%d: %s\n", __FILE__, __LINE__, #c);                                       \
            pbs_bad++;                                                                             \
        }                                                                                          \
    } while (0)
/* As CHECK for a number, which it prints. */
#define CHECK_NUM(c, v)                                                                            \
    do {                                                                                           \
        if (!(c)) {                                                                                \
            printf("# %s:%d: %s, with %s = %.9g\n", __FILE__, __LINE__, #c, #v, (double)(v));      \
            pbs_bad++;                                                                             \
        }                                                                                          \
    } while (0)
#define SKIP(why)                                                                                  \
    do {                                                                                           \
        pbs_skip_why = why;                                                                        \
        return;                                                                                    \
    } while (0)

#define TEST_MAIN                                                                                  \
    int main(void) {                                                                               \
        int failed = 0;                                                                            \
        for (pbs_test *t = pbs_tests; t; t = t->next) {                                            \
            pbs_bad = 0, pbs_skip_why = NULL;                                                      \
            t->fn();                                                                               \
            if (pbs_bad)                                                                           \
                printf("not ok %s\n", t->name), failed++;                                          \
            else if (pbs_skip_why)                                                                 \
                printf("skip %s: %s\n", t->name, pbs_skip_why);                                    \
            else                                                                                   \
                printf("ok %s\n", t->name);                                                        \
            fflush(stdout);                                                                        \
        }                                                                                          \
        return failed != 0;                                                                        \
    }
#endif
