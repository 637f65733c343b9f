/* Arrays in files and pages that are let go: what was written is there, and what is held stays
 * bounded; digests tell bytes and pieces apart. */
#include "formats/container/digest.h"
#include "formats/container/file.h"
#include "formats/container/scratch.h"
#include "tests/check.h"
#include <sys/mman.h>
#include <unistd.h>

static pbs_err err;

static size_t pages_held(void) {
    FILE *f = fopen("/proc/self/statm", "r");
    unsigned long all = 0, resident = 0, shared = 0;
    if (f && fscanf(f, "%lu %lu %lu", &all, &resident, &shared) != 3) shared = 0;
    if (f) fclose(f);
    return shared * (size_t)sysconf(_SC_PAGESIZE);
}

TEST(small_ones_are_memory) {
    pbs_run run = {.threads = 1, .mem_limit = 1 << 20};
    pbs_scratch s;
    CHECK(!pbs_scratch_new(&run, 1000, 8, "it", &s, &err) && !s.is_file && run.mem_used > 8000);
    memset(s.bytes, 7, s.size);
    pbs_scratch_free(&s);
    CHECK(!run.mem_used && !s.bytes);
    CHECK(!pbs_scratch_new(&run, 0, 8, "it", &s, &err));
    pbs_scratch_free(&s);
    CHECK(pbs_scratch_new(&run, SIZE_MAX / 8, 8, "it", &s, &err) == PBS_LIMIT);
    pbs_scratch_free(&s);
    CHECK(!run.mem_used);
}

TEST(large_ones_are_files_and_let_go) {
    enum { N = 96 << 20, STEP = 1 << 20 };
    pbs_run run = {.threads = 1, .mem_limit = 4 << 20};
    pbs_scratch s;
    CHECK(!pbs_scratch_new(&run, N, 1, "it", &s, &err) && s.is_file);
    CHECK_NUM(run.mem_used < 100000, run.mem_used);
    pbs_trim t;
    pbs_trim_open(&run, &t);
    pbs_trim_add(&t, s.bytes, s.size);
    pbs_trim_add(&t, NULL, 5);
    CHECK(t.count == 1);
    char *p = s.bytes;
    size_t most = 0, wrong = 0;
    for (int pass = 0; pass < 2; pass++)
        for (size_t i = 0; i < N; i += STEP) {
            if (!pass) memset(p + i, (int)(i / STEP), STEP);
            for (size_t k = 0; k < STEP; k += 4096) wrong += p[i + k] != (char)(i / STEP);
            pbs_trim_now(&t);
            most = pages_held() > most ? pages_held() : most;
        }
    CHECK_NUM(wrong == 0, wrong);
    if (t.statm >= 0) CHECK_NUM(most <= ((size_t)18 << 20), most);
    pbs_trim_drop(&t, s.bytes);
    CHECK(t.count == 0);
    pbs_trim_close(&t);
    pbs_scratch_free(&s);
    CHECK(!run.mem_used);
}

TEST(no_folder_for_files) {
    char *old = getenv("TMPDIR") ? strdup(getenv("TMPDIR")) : NULL;
    setenv("TMPDIR", "/nowhere", 1);
    pbs_run run = {.threads = 1, .mem_limit = 1 << 20};
    pbs_scratch s;
    CHECK(pbs_scratch_new(&run, 1 << 20, 1, "it", &s, &err) == PBS_IO);
    CHECK(strstr(err.text, "/nowhere"));
    pbs_scratch_free(&s);
    CHECK(!run.mem_used);
    if (old)
        setenv("TMPDIR", old, 1);
    else
        unsetenv("TMPDIR");
    free(old);
}

TEST(digests) {
    pbs_digest a = {{0, 0}}, b = a, c = a;
    pbs_digest_add(&a, "abcd", 4);
    pbs_digest_add(&b, "ab", 2), pbs_digest_add(&b, "cd", 2);
    pbs_digest_add(&c, "abcd", 4);
    CHECK(!memcmp(&a, &c, sizeof a) && memcmp(&a, &b, sizeof a));
    pbs_digest_add(&c, "", 0);
    CHECK(memcmp(&a, &c, sizeof a));
    CHECK(pbs_digest_text(NULL) == pbs_digest_text("") &&
          pbs_digest_text("a") != pbs_digest_text("b"));
}

TEST_MAIN
