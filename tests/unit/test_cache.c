/* The cache against what can happen to its files: other keys, damage, other processes, a limit; and
 * around the sampler, as pbs-sample uses it. */
#include "formats/container/cache.h"
#include "tests/check.h"
#include <dirent.h>
#include <fcntl.h>
#include <math.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

static pbs_run run_of_tests = {.threads = 1};
static char folder[64];

static pbs_cache *begin(uint64_t limit) {
    pbs_cache *c;
    pbs_err err = {0};
    if (pbs_cache_open(&run_of_tests, folder, limit, &c, &err)) {
        printf("# %s\n", err.text);
        exit(1);
    }
    return c;
}

/* A folder that is not there yet. */
static pbs_cache *begin_empty(uint64_t limit) {
    strcpy(folder, "cache-XXXXXX");
    if (!mkdtemp(folder) || rmdir(folder)) exit(1);
    return begin(limit);
}

static int each_file(void (*fn)(const char *path)) {
    int n = 0;
    char path[512];
    DIR *dir = opendir(folder);
    for (struct dirent *d; dir && (d = readdir(dir));) {
        if (d->d_name[0] == '.' && strlen(d->d_name) < 3) continue;
        snprintf(path, sizeof path, "%s/%s", folder, d->d_name);
        if (fn) fn(path);
        n++;
    }
    if (dir) closedir(dir);
    return n;
}

static void delete (const char *path) {
    unlink(path);
}
static pbs_cache_totals end(pbs_cache *c) {
    pbs_cache_totals t = pbs_cache_close(c);
    each_file(delete);
    rmdir(folder);
    return t;
}

static pbs_cache_key key_of(const char *text) {
    return pbs_cache_key_of(&(pbs_piece){text, strlen(text)}, 1);
}

static void put(pbs_cache *c, const char *key, const char *a, const char *b) {
    pbs_cache_key k = key_of(key);
    pbs_piece parts[2] = {{a, strlen(a)}, {b, strlen(b)}};
    CHECK(!pbs_cache_store(c, &k, parts, 2, NULL));
}
static bool get(pbs_cache *c, const char *key, const char *a, const char *b) {
    char x[100], y[100];
    pbs_cache_key k = key_of(key);
    pbs_cache_part parts[2] = {{x, sizeof x}, {y, sizeof y}};
    if (!pbs_cache_find(c, &k, parts, 2)) return false;
    CHECK(parts[0].size == strlen(a) && !memcmp(x, a, parts[0].size));
    CHECK(parts[1].size == strlen(b) && !memcmp(y, b, parts[1].size));
    return true;
}

TEST(what_is_stored_is_found_by_its_key_alone_and_by_later_runs) {
    pbs_cache *c = begin_empty(0);
    CHECK(!get(c, "one", "", ""));
    put(c, "one", "first", "");
    put(c, "two", "", "second");
    CHECK(get(c, "one", "first", "") && get(c, "two", "", "second") && !get(c, "three", "", ""));
    pbs_cache_totals t = pbs_cache_close(c);
    CHECK(t.found == 2 && t.missed == 2 && t.stored == 2 && !t.damaged && !t.evicted);
    c = begin(0);
    put(c, "one", "first", ""); /* again: the same file */
    CHECK(get(c, "one", "first", "") && each_file(NULL) == 2);
    end(c);
    CHECK(!pbs_cache_find(NULL, &(pbs_cache_key){{0}}, NULL, 0));
    CHECK(!pbs_cache_store(NULL, &(pbs_cache_key){{0}}, NULL, 0, NULL));
    CHECK(pbs_cache_close(NULL).found == 0);
}

TEST(the_key_knows_where_a_piece_ends) {
    pbs_piece ab[2] = {{"ab", 2}, {"c", 1}}, bc[2] = {{"a", 1}, {"bc", 2}}, abc[1] = {{"abc", 3}};
    pbs_piece more[3] = {{"ab", 2}, {"c", 1}, {NULL, 0}};
    pbs_cache_key k[4] = {pbs_cache_key_of(ab, 2), pbs_cache_key_of(bc, 2),
                          pbs_cache_key_of(abc, 1), pbs_cache_key_of(more, 3)};
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < i; j++) CHECK(memcmp(&k[i], &k[j], sizeof k[i]));
}

TEST(parts_without_room_are_not_found) {
    pbs_cache *c = begin_empty(0);
    char x[5], y[6];
    pbs_cache_key k = key_of("k");
    put(c, "k", "hello", "world!");
    CHECK(pbs_cache_find(c, &k, (pbs_cache_part[2]){{x, 5}, {y, 6}}, 2));
    CHECK(!pbs_cache_find(c, &k, (pbs_cache_part[2]){{x, 4}, {y, 6}}, 2));
    put(c, "k", "hello", "world!");
    CHECK(!pbs_cache_find(c, &k, (pbs_cache_part[1]){{x, 5}}, 1));
    end(c);
}

/* ---- damage ---- */

static size_t damage_at;
static void flip(const char *path) {
    uint8_t b;
    int fd = open(path, O_RDWR);
    CHECK(pread(fd, &b, 1, (off_t)damage_at) == 1);
    b ^= 4;
    CHECK(pwrite(fd, &b, 1, (off_t)damage_at) == 1);
    close(fd);
}
static void cut(const char *path) {
    CHECK(!truncate(path, (off_t)damage_at));
}

TEST(a_damaged_or_short_entry_is_removed_and_can_be_stored_again) {
    pbs_cache *c = begin_empty(0);
    struct stat st;
    char path[512];
    put(c, "k", "hello", "world");
    pbs_cache_key k = key_of("k");
    size_t n = (size_t)snprintf(path, sizeof path, "%s/", folder);
    for (int i = 0; i < 16; i++)
        n += (size_t)snprintf(path + n, sizeof path - n, "%02x", k.bytes[i]);
    snprintf(path + n, sizeof path - n, ".pbsc");
    CHECK(!stat(path, &st) && st.st_size > 10);
    for (damage_at = 0; damage_at < (size_t)st.st_size; damage_at++) {
        flip(path);
        CHECK(!get(c, "k", "", "") && access(path, F_OK));
        put(c, "k", "hello", "world");
        cut(path);
        CHECK(!get(c, "k", "", "") && access(path, F_OK));
        put(c, "k", "hello", "world");
    }
    damage_at = (size_t)st.st_size + 1;
    cut(path); /* longer by a zero */
    CHECK(!get(c, "k", "", ""));
    put(c, "k", "hello", "world");
    CHECK(get(c, "k", "hello", "world"));
    CHECK(end(c).damaged == 2 * (uint64_t)st.st_size + 1);
}

static const char *wrong_name;
static void rename_to_wrong(const char *path) {
    rename(path, wrong_name);
}
TEST(an_entry_under_another_entrys_name_is_not_found) {
    pbs_cache *c = begin_empty(0);
    char path[512];
    pbs_cache_key k = key_of("k");
    size_t n = (size_t)snprintf(path, sizeof path, "%s/", folder);
    for (int i = 0; i < 16; i++)
        n += (size_t)snprintf(path + n, sizeof path - n, "%02x", k.bytes[i]);
    snprintf(path + n, sizeof path - n, ".pbsc");
    put(c, "other", "a", "b");
    wrong_name = path;
    each_file(rename_to_wrong);
    CHECK(!get(c, "k", "a", "b"));
    CHECK(end(c).damaged == 1);
}

/* ---- trouble ---- */

TEST(trouble_is_told_and_is_no_error) {
    pbs_cache *c = begin_empty(0);
    rmdir(folder);
    put(c, "k", "a", "b");
    put(c, "l", "a", "b");
    CHECK(!get(c, "k", "a", "b"));
    pbs_cache_totals t = pbs_cache_close(c);
    CHECK(!t.stored && strstr(t.trouble, "No such file"));
    pbs_err err = {0};
    CHECK(pbs_cache_open(&run_of_tests, "no/such/folder", 0, &c, &err) == PBS_IO);
    CHECK(pbs_cache_open(&run_of_tests, "/dev/null", 0, &c, &err) == PBS_IO);
}

TEST(several_processes_share_a_folder) {
    pbs_cache *c = begin_empty(0);
    char name[20], value[60];
    for (int p = 0; p < 4; p++) {
        if (fork()) continue;
        for (int i = 0; i < 200; i++) {
            snprintf(name, sizeof name, "%d", i % 20);
            snprintf(value, sizeof value, "value of %d", i % 20);
            if (!get(c, name, value, value)) put(c, name, value, value);
        }
        pbs_cache_totals t = pbs_cache_close(c);
        _exit(pbs_bad || t.damaged || t.trouble[0] || t.found + t.missed != 200);
    }
    for (int status; wait(&status) > 0;) CHECK(!status);
    CHECK(each_file(NULL) == 20);
    for (int i = 0; i < 20; i++) {
        snprintf(name, sizeof name, "%d", i);
        snprintf(value, sizeof value, "value of %d", i);
        CHECK(get(c, name, value, value));
    }
    end(c);
}

/* ---- the limit ---- */

static struct timespec age[2];
static void make_old(const char *path) {
    age[0].tv_sec = age[1].tv_sec = 1000000;
    utimensat(AT_FDCWD, path, age, 0);
}

TEST(what_was_used_longest_ago_goes_first) {
    pbs_cache *c = begin_empty(0);
    char name[20], mine[80];
    for (int i = 0; i < 10; i++) snprintf(name, sizeof name, "%d", i), put(c, name, "1234", "5678");
    snprintf(mine, sizeof mine, "%s/notes.txt", folder);
    close(open(mine, O_CREAT | O_WRONLY, 0666));
    pbs_cache_close(c);
    each_file(make_old);
    c = begin(4 * (104 + 8)); /* room for four */
    CHECK(get(c, "3", "1234", "5678") && get(c, "7", "1234", "5678"));
    put(c, "new", "1234", "5678");
    CHECK(pbs_cache_close(c).evicted == 7);
    c = begin(0);
    CHECK(get(c, "3", "1234", "5678") && get(c, "7", "1234", "5678"));
    CHECK(get(c, "new", "1234", "5678"));
    CHECK(each_file(NULL) == 5 && !access(mine, F_OK)); /* four and what is not ours */
    end(c);
}

/* ---- around the sampler ---- */

enum { N = 3000, WANTED = 500 };
static float position[3 * N];
static int16_t normal[2 * N];
static pbs_points cloud = {.count = N, .position = position, .normal = normal};

static void fill(void) {
    uint32_t x = 1;
    for (int i = 0; i < 3 * N; i++) position[i] = (float)((x = x * 1664525 + 1013904223) >> 8);
    for (int i = 0; i < 2 * N; i++) normal[i] = (int16_t)((x = x * 1664525 + 1013904223) >> 16);
}

typedef struct outcome {
    uint32_t order[WANTED];
    float spacing[WANTED];
    pbs_sample_result r;
} outcome;

/* What pbs-sample does with a node. */
static outcome sample(pbs_cache *c, const pbs_points *in, const pbs_sample_params *p) {
    outcome o;
    pbs_sampler *s;
    pbs_err err = {0};
    memset(&o, 0, sizeof o);
    pbs_code rc = pbs_sampler_new(&run_of_tests, &s, &err);
    pbs_cache_key key = pbs_cache_sample_key(in, p);
    if (!pbs_cache_find_sample(c, &key, in, WANTED, o.order, o.spacing, &o.r)) {
        if (!rc) rc = pbs_sample(s, in, p, o.order, o.spacing, &o.r, &err);
        if (!rc) rc = pbs_cache_store_sample(c, &key, o.order, o.spacing, &o.r, &err);
    }
    CHECK(!rc);
    pbs_sampler_free(s);
    return o;
}

static bool equal(const outcome *a, const outcome *b) {
    return !memcmp(a->order, b->order, sizeof a->order) &&
           !memcmp(a->spacing, b->spacing, sizeof a->spacing) && a->r.count == b->r.count &&
           a->r.covering == b->r.covering && a->r.duplicates == b->r.duplicates &&
           a->r.invalid == b->r.invalid;
}

TEST(the_second_run_has_the_same_bytes_and_samples_nothing) {
    fill();
    position[30] = NAN;
    pbs_sample_params p = {.count = WANTED, .normal_weight = 1};
    outcome plain = sample(NULL, &cloud, &p);
    pbs_cache *c = begin_empty(0);
    outcome first = sample(c, &cloud, &p), second = sample(c, &cloud, &p);
    CHECK(plain.r.count == WANTED && plain.r.invalid == 1);
    CHECK(equal(&plain, &first) && equal(&plain, &second));
    pbs_cache_totals t = end(c);
    CHECK(t.found == 1 && t.missed == 1 && t.stored == 1);
}

TEST(whatever_determines_the_order_changes_the_key) {
    fill();
    const pbs_sample_params p = {.count = WANTED, .normal_weight = 1};
    pbs_sample_params q[6] = {p, p, p, p, p, p};
    q[0].count--, q[1].method = PBS_PAPER, q[2].normal_weight = 0.5f;
    q[3].seed = 1, q[4].node = 1, q[5].subset = 7;
    pbs_cache_key k = pbs_cache_sample_key(&cloud, &p), other;
    for (int i = 0; i < 6; i++) {
        other = pbs_cache_sample_key(&cloud, &q[i]);
        CHECK(memcmp(&k, &other, sizeof k));
    }
    pbs_points less = cloud, bare = cloud;
    less.count--, bare.normal = NULL;
    other = pbs_cache_sample_key(&less, &p);
    CHECK(memcmp(&k, &other, sizeof k));
    other = pbs_cache_sample_key(&bare, &p);
    CHECK(memcmp(&k, &other, sizeof k));
    normal[2 * N - 1] ^= 1;
    other = pbs_cache_sample_key(&cloud, &p);
    CHECK(memcmp(&k, &other, sizeof k));
    normal[2 * N - 1] ^= 1;
    position[0] += 1;
    other = pbs_cache_sample_key(&cloud, &p);
    CHECK(memcmp(&k, &other, sizeof k));
}

TEST(a_forged_order_is_not_believed) {
    pbs_cache *c = begin_empty(0);
    pbs_cache_key k = key_of("forged");
    uint32_t order[3] = {0, 1, 10};
    float spacing[3] = {3, 2, 1};
    float at[33] = {0};
    pbs_points in = {.count = 11, .position = at};
    pbs_sample_result r = {.count = 3}, got;
    CHECK(!pbs_cache_store_sample(c, &k, order, spacing, &r, NULL));
    CHECK(pbs_cache_find_sample(c, &k, &in, 3, order, spacing, &got) && got.count == 3);
    at[3] = NAN;
    CHECK(!pbs_cache_find_sample(c, &k, &in, 3, order, spacing, &got));
    at[3] = 0, in.count = 10;
    CHECK(!pbs_cache_find_sample(c, &k, &in, 3, order, spacing, &got));
    order[2] = 1, in.count = 11;
    CHECK(!pbs_cache_store_sample(c, &k, order, spacing, &r, NULL));
    CHECK(!pbs_cache_find_sample(c, &k, &in, 3, order, spacing, &got));
    order[2] = 10, spacing[1] = NAN;
    CHECK(!pbs_cache_store_sample(c, &k, order, spacing, &r, NULL));
    CHECK(!pbs_cache_find_sample(c, &k, &in, 3, order, spacing, &got));
    end(c);
}
TEST_MAIN
