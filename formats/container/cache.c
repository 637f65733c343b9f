#include "formats/container/cache.h"
#include "formats/container/file.h"
#include "formats/container/wire.h"
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>
#define XXH_INLINE_ALL
#include <xxhash.h>

/* An entry: the magic, its key, the number and sizes of its parts, a checksum of all this and of
 * the parts, then the parts. */
#define MAGIC  "PBSCACH1"
#define ENDING ".pbsc"
enum {
    KEY_AT = 8,
    COUNT_AT = 24,
    SIZES_AT = 32,
    SUM_AT = SIZES_AT + 8 * PBS_CACHE_PARTS,
    HEAD = SUM_AT + 8,
    NAME = 2 * sizeof(pbs_cache_key) + sizeof ENDING
};

struct pbs_cache {
    pbs_run *run;
    char *folder;
    uint64_t limit;
    pbs_cache_totals totals; /* counts are atomic */
    int troubled;
};

static void count(uint64_t *what) {
    __atomic_fetch_add(what, 1, __ATOMIC_RELAXED);
}

/* ---- keys ---- */

pbs_cache_key pbs_cache_key_of(const pbs_piece *pieces, int n) {
    pbs_cache_key key;
    XXH3_state_t state;
    XXH3_128bits_reset(&state);
    XXH3_128bits_update(&state, MAGIC PBS_VERSION, sizeof MAGIC PBS_VERSION);
    for (int i = 0; i < n; i++) {
        uint8_t size[8];
        pbs_put_u64(size, pieces[i].size);
        XXH3_128bits_update(&state, size, sizeof size);
        if (pieces[i].size) XXH3_128bits_update(&state, pieces[i].bytes, pieces[i].size);
    }
    XXH128_canonical_t canonical;
    XXH128_canonicalFromHash(&canonical, XXH3_128bits_digest(&state));
    memcpy(key.bytes, canonical.digest, sizeof key.bytes);
    return key;
}

static void name_of(const pbs_cache_key *key, char out[NAME]) {
    for (size_t i = 0; i < sizeof key->bytes; i++) sprintf(out + 2 * i, "%02x", key->bytes[i]);
    strcpy(out + 2 * sizeof key->bytes, ENDING);
}

static char *path_of(const pbs_cache *c, const char *name) {
    char *path;
    return asprintf(&path, "%s/%s", c->folder, name) < 0 ? NULL : path;
}

static char *path_of_key(const pbs_cache *c, const pbs_cache_key *key) {
    char name[NAME];
    name_of(key, name);
    return path_of(c, name);
}

static uint64_t sum_of(const uint8_t head[HEAD], const pbs_piece *parts, int n) {
    XXH3_state_t state;
    XXH3_64bits_reset(&state);
    XXH3_64bits_update(&state, head, SUM_AT);
    for (int i = 0; i < n; i++)
        if (parts[i].size) XXH3_64bits_update(&state, parts[i].bytes, parts[i].size);
    return XXH3_64bits_digest(&state);
}

/* ---- opening ---- */

pbs_code pbs_cache_open(pbs_run *run, const char *folder, uint64_t limit, pbs_cache **out,
                        pbs_err *err) {
    struct stat st;
    if (mkdir(folder, 0777) && errno != EEXIST) return pbs_fail_errno(err, "%s", folder);
    if (stat(folder, &st)) return pbs_fail_errno(err, "%s", folder);
    if (!S_ISDIR(st.st_mode)) return pbs_fail(err, PBS_IO, "%s: is not a folder", folder);
    pbs_cache *c = calloc(1, sizeof *c);
    if (!c || !(c->folder = strdup(folder))) {
        free(c);
        return pbs_fail(err, PBS_LIMIT, "no memory");
    }
    c->run = run;
    c->limit = limit;
    *out = c;
    return PBS_OK;
}

/* ---- finding ---- */

static bool read_all(int fd, void *to, size_t n) {
    for (size_t done = 0; done < n;) {
        ssize_t r = read(fd, (char *)to + done, n - done);
        if (r < 0 && errno == EINTR) continue;
        if (r <= 0) return false;
        done += (size_t)r;
    }
    return true;
}

/* Sizes in the head are looked at before anything is read by them. */
static bool sizes_fit(const uint8_t head[HEAD], uint64_t bytes, pbs_cache_part *parts, int n) {
    uint64_t left = bytes - HEAD;
    for (int i = 0; i < PBS_CACHE_PARTS; i++) {
        uint64_t size = pbs_get_u64(head + SIZES_AT + 8 * i);
        if (size > left || size > (i < n ? parts[i].size : 0)) return false;
        if (i < n) parts[i].size = (size_t)size;
        left -= size;
    }
    return !left;
}

static bool read_entry(int fd, const pbs_cache_key *key, pbs_cache_part *parts, int n) {
    uint8_t head[HEAD];
    pbs_piece pieces[PBS_CACHE_PARTS];
    struct stat st;
    if (fstat(fd, &st) || !S_ISREG(st.st_mode) || st.st_size < HEAD || !read_all(fd, head, HEAD) ||
        memcmp(head, MAGIC, KEY_AT) || memcmp(head + KEY_AT, key, sizeof *key) ||
        pbs_get_u64(head + COUNT_AT) != (uint64_t)n ||
        !sizes_fit(head, (uint64_t)st.st_size, parts, n))
        return false;
    for (int i = 0; i < n; i++) {
        if (!read_all(fd, parts[i].bytes, parts[i].size)) return false;
        pieces[i] = (pbs_piece){parts[i].bytes, parts[i].size};
    }
    return pbs_get_u64(head + SUM_AT) == sum_of(head, pieces, n);
}

bool pbs_cache_find(pbs_cache *c, const pbs_cache_key *key, pbs_cache_part *parts, int n) {
    if (!c) return false;
    char *path = path_of_key(c, key);
    int fd = path ? open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK) : -1;
    bool good = fd >= 0 && read_entry(fd, key, parts, n);
    if (good) {
        futimens(fd, NULL); /* for "used longest ago"; a folder that is read-only keeps its times */
    } else if (fd >= 0) {
        count(&c->totals.damaged);
        unlink(path);
    }
    count(good ? &c->totals.found : &c->totals.missed);
    if (fd >= 0) close(fd);
    free(path);
    return good;
}

/* ---- storing ---- */

static pbs_code write_entry(pbs_cache *c, const char *path, const uint8_t head[HEAD],
                            const pbs_piece *parts, int n, pbs_err *err) {
    pbs_output out;
    pbs_code rc = pbs_output_open(c->run, path, &out, err);
    if (rc) return rc;
    rc = pbs_output_write(&out, head, HEAD, err);
    for (int i = 0; i < n && !rc; i++)
        rc = pbs_output_write(&out, parts[i].bytes, parts[i].size, err);
    if (!rc) rc = pbs_output_commit(&out, err);
    pbs_output_close(&out);
    return rc;
}

pbs_code pbs_cache_store(pbs_cache *c, const pbs_cache_key *key, const pbs_piece *parts, int n,
                         pbs_err *err) {
    /* After the first trouble (a full disk) there is nothing to be gained. */
    if (!c || __atomic_load_n(&c->troubled, __ATOMIC_RELAXED)) return PBS_OK;
    uint8_t head[HEAD] = MAGIC;
    pbs_err why = {0};
    memcpy(head + KEY_AT, key, sizeof *key);
    pbs_put_u64(head + COUNT_AT, (uint64_t)n);
    for (int i = 0; i < n; i++) pbs_put_u64(head + SIZES_AT + 8 * i, parts[i].size);
    pbs_put_u64(head + SUM_AT, sum_of(head, parts, n));
    char *path = path_of_key(c, key);
    pbs_code rc = path ? write_entry(c, path, head, parts, n, &why)
                       : pbs_fail(&why, PBS_LIMIT, "%s: no memory", c->folder);
    free(path);
    if (!rc) count(&c->totals.stored);
    if (rc == PBS_CANCEL) return pbs_fail(err, rc, "%s", why.text);
    if (rc && !__atomic_exchange_n(&c->troubled, 1, __ATOMIC_RELAXED))
        snprintf(c->totals.trouble, sizeof c->totals.trouble, "%.250s", why.text);
    return PBS_OK;
}

/* ---- what the sampler made ---- */

pbs_cache_key pbs_cache_sample_key(const pbs_points *in, const pbs_sample_params *p) {
    uint8_t text[52] = "order 2", *at = text + 8;
    at = pbs_put_u64(at, p->count);
    at = pbs_put_u64(at, p->seed);
    at = pbs_put_u32(at, p->node);
    at = pbs_put_u32(at, (uint32_t)p->method);
    at = pbs_put_u32(at, p->subset);
    at = pbs_put_f32(at, p->normal_weight);
    at = pbs_put_f32(at, p->radius);
    pbs_piece pieces[3] = {{text, (size_t)(at - text)},
                           {in->position, in->count * 12},
                           {in->normal, in->normal ? in->count * 4 : 0}};
    return pbs_cache_key_of(pieces, in->normal ? 3 : 2);
}

/* Marks a candidate; false: it cannot have been chosen, or was already. */
static bool choose(uint8_t *chosen, const pbs_points *in, uint32_t i) {
    if (i >= in->count || chosen[i / 8] >> i % 8 & 1) return false;
    chosen[i / 8] |= (uint8_t)(1 << i % 8);
    const float *p = in->position + 3 * (size_t)i;
    return isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]);
}

/* What can be written can be forged: nothing is believed that could lead out of an array. */
static bool sample_fits(pbs_run *run, const uint8_t *text, const pbs_cache_part part[3],
                        const pbs_points *in, pbs_sample_result *r) {
    *r = (pbs_sample_result){.count = part[1].size / 4,
                             .covering = pbs_get_f32(text),
                             .duplicates = (size_t)pbs_get_u64(text + 8),
                             .invalid = (size_t)pbs_get_u64(text + 16)};
    if (part[0].size != 24 || part[1].size != part[2].size || part[1].size % 4) return false;
    const uint32_t *order = part[1].bytes;
    const float *spacing = part[2].bytes;
    uint8_t *chosen;
    bool good = isfinite(r->covering) && r->covering >= 0;
    if (pbs_alloc(run, &chosen, in->count / 8 + 1, 1, "what was found", NULL)) return false;
    memset(chosen, 0, in->count / 8 + 1);
    for (size_t i = 0; i < r->count && good; i++)
        good = choose(chosen, in, order[i]) && isfinite(spacing[i]) && spacing[i] >= 0;
    pbs_free(run, chosen);
    return good;
}

bool pbs_cache_find_sample(pbs_cache *c, const pbs_cache_key *key, const pbs_points *in,
                           size_t room, uint32_t *order, float *spacing,
                           pbs_sample_result *result) {
    uint8_t text[24] = {0};
    pbs_cache_part part[3] = {{text, sizeof text}, {order, 4 * room}, {spacing, 4 * room}};
    return pbs_cache_find(c, key, part, 3) && sample_fits(c->run, text, part, in, result);
}

pbs_code pbs_cache_store_sample(pbs_cache *c, const pbs_cache_key *key, const uint32_t *order,
                                const float *spacing, const pbs_sample_result *r, pbs_err *err) {
    uint8_t text[24] = {0};
    pbs_put_f32(text, r->covering);
    pbs_put_u64(text + 8, r->duplicates);
    pbs_put_u64(text + 16, r->invalid);
    pbs_piece part[3] = {{text, sizeof text}, {order, 4 * r->count}, {spacing, 4 * r->count}};
    return pbs_cache_store(c, key, part, 3, err);
}

/* ---- the limit ---- */

typedef struct old_file {
    char name[NAME];
    struct timespec used;
    uint64_t bytes;
} old_file;

static int older(const void *a, const void *b) {
    const struct timespec *x = &((const old_file *)a)->used, *y = &((const old_file *)b)->used;
    if (x->tv_sec != y->tv_sec) return x->tv_sec < y->tv_sec ? -1 : 1;
    return (x->tv_nsec > y->tv_nsec) - (x->tv_nsec < y->tv_nsec);
}

/* Only names that we give: whatever else lies in the folder is somebody's. */
static bool is_entry(const char *name) {
    size_t n = NAME - sizeof ENDING;
    return strspn(name, "0123456789abcdef") == n && !strcmp(name + n, ENDING);
}

static size_t list_files(pbs_cache *c, old_file **out, uint64_t *bytes) {
    size_t n = 0, cap = 0;
    DIR *dir = opendir(c->folder);
    for (struct dirent *d; dir && (d = readdir(dir));) {
        struct stat st;
        if (!is_entry(d->d_name) || fstatat(dirfd(dir), d->d_name, &st, AT_SYMLINK_NOFOLLOW) ||
            pbs_grow(c->run, out, &cap, n + 1, sizeof **out, "the cache's files", NULL))
            continue;
        old_file *f = &(*out)[n++];
        memcpy(f->name, d->d_name, NAME);
        f->used = st.st_mtim;
        f->bytes = (uint64_t)st.st_size;
        *bytes += f->bytes;
    }
    if (dir) closedir(dir);
    return n;
}

static void evict(pbs_cache *c) {
    old_file *files = NULL;
    uint64_t bytes = 0;
    size_t n = c->limit ? list_files(c, &files, &bytes) : 0;
    if (bytes > c->limit) qsort(files, n, sizeof *files, older);
    for (size_t i = 0; i < n && bytes > c->limit; i++) {
        char *path = path_of(c, files[i].name);
        if (path && !unlink(path)) count(&c->totals.evicted);
        bytes -= files[i].bytes;
        free(path);
    }
    pbs_free(c->run, files);
}

pbs_cache_totals pbs_cache_close(pbs_cache *c) {
    if (!c) return (pbs_cache_totals){0};
    evict(c);
    pbs_cache_totals t = c->totals;
    free(c->folder);
    free(c);
    return t;
}
