#include "formats/container/scratch.h"
#include "formats/container/file.h"
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

/* ---- pages ---- */

/* The program itself and its libraries are mapped files, too. */
#define PROGRAM ((size_t)16 << 20)

/* Bytes of mapped files in memory; 0 if the system does not say. */
static size_t held(const pbs_trim *t) {
    char text[128];
    unsigned long long size, resident, shared;
    ssize_t n = t->statm < 0 ? 0 : pread(t->statm, text, sizeof text - 1, 0);
    if (n <= 0) return 0;
    text[n] = 0;
    if (sscanf(text, "%llu %llu %llu", &size, &resident, &shared) != 3) return 0;
    return (size_t)shared * (size_t)sysconf(_SC_PAGESIZE);
}

void pbs_trim_open(const pbs_run *run, pbs_trim *t) {
    memset(t, 0, sizeof *t);
    t->statm = open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
    t->limit = pbs_mem_left(run) / 2 + PROGRAM;
}

void pbs_trim_add(pbs_trim *t, const void *bytes, size_t size) {
    if (!bytes || t->count == PBS_TRIM_RANGES) return;
    t->range[t->count].bytes = bytes;
    t->range[t->count++].size = size;
}

void pbs_trim_drop(pbs_trim *t, const void *bytes) {
    for (int i = 0; i < t->count; i++)
        if (t->range[i].bytes == bytes) t->range[i--] = t->range[--t->count];
}

static void give_back(const void *bytes, size_t size) {
    const uintptr_t page = (uintptr_t)sysconf(_SC_PAGESIZE), end = (uintptr_t)bytes + size;
    uintptr_t from = ((uintptr_t)bytes + page - 1) / page * page;
    if (from < end) madvise((void *)from, end - from, MADV_DONTNEED);
}

void pbs_trim_now(const pbs_trim *t) {
    size_t enough = t->limit - t->limit / 16, now = held(t);
    if (now && now <= t->limit) return;
    for (int i = 0; i < t->count && (!now || now > enough); i++) {
        give_back(t->range[i].bytes, t->range[i].size);
        if (now) now = held(t);
    }
}

void pbs_trim_close(pbs_trim *t) {
    if (t->statm >= 0) close(t->statm);
    t->statm = -1;
    t->count = 0;
}

void pbs_pages_rest(const void *bytes, size_t size) {
    const uintptr_t page = 65536;
    uintptr_t from = ((uintptr_t)bytes + page - 1) & ~(page - 1);
    uintptr_t to = ((uintptr_t)bytes + size) & ~(page - 1);
    if (from < to) madvise((void *)from, to - from, MADV_DONTNEED);
}

/* ---- arrays ---- */

/* The file gets all its blocks at once: a page of a map that finds the disk full would end the
 * program. */
static pbs_code map_file(pbs_scratch *s, const pbs_output *spool, const char *what, pbs_err *err) {
    int bad;
    do {
        pbs_code rc = pbs_run_check(s->run, err);
        if (rc) return rc;
        bad = posix_fallocate(spool->fd, 0, (off_t)s->size);
    } while (bad == EINTR);
    errno = bad;
    if (bad) return pbs_fail_errno(err, "%s: %s", what, spool->name);
    void *p = mmap(NULL, s->size, PROT_READ | PROT_WRITE, MAP_SHARED, spool->fd, 0);
    if (p == MAP_FAILED) return pbs_fail_errno(err, "%s: %s: map", what, spool->name);
    s->bytes = p;
    s->is_file = true;
    s->fd = fcntl(spool->fd, F_DUPFD_CLOEXEC, 0);
    snprintf(s->name, sizeof s->name, "%.60s", spool->name);
    return s->fd < 0 ? pbs_fail_errno(err, "%s: %s", what, spool->name) : PBS_OK;
}

pbs_code pbs_scratch_new(pbs_run *run, size_t count, size_t size, const char *what,
                         pbs_scratch *out, pbs_err *err) {
    return pbs_scratch_within(run, count, size, what, SIZE_MAX, out, err);
}

pbs_code pbs_scratch_file(pbs_run *run, size_t count, size_t size, const char *what,
                          pbs_scratch *out, pbs_err *err) {
    return pbs_scratch_within(run, count, size, what, 0, out, err);
}

pbs_code pbs_scratch_within(pbs_run *run, size_t count, size_t size, const char *what, size_t most,
                            pbs_scratch *out, pbs_err *err) {
    *out = (pbs_scratch){.run = run, .fd = -1};
    if (size && count > SIZE_MAX / 4 / size) return pbs_fail(err, PBS_LIMIT, "%s: too large", what);
    out->size = count * size;
    if (out->size <= most && out->size <= pbs_mem_left(run) / 4)
        return pbs_alloc(run, &out->bytes, out->size, 1, what, err);
    pbs_output spool;
    pbs_code rc = pbs_output_spool(run, &spool, err);
    if (rc) return rc;
    rc = map_file(out, &spool, what, err);
    pbs_output_close(&spool);
    return rc;
}

pbs_code pbs_scratch_read(const pbs_scratch *s, uint64_t at, size_t size, void *to, pbs_err *err) {
    if (!s->is_file) {
        if (size) memcpy(to, (const char *)s->bytes + at, size);
        return PBS_OK;
    }
    for (size_t got = 0; got < size;) {
        ssize_t n = pread(s->fd, (char *)to + got, size - got, (off_t)(at + got));
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return pbs_fail_errno(err, "%s", s->name);
        got += (size_t)n;
    }
    return PBS_OK;
}

pbs_code pbs_scratch_write(const pbs_scratch *s, uint64_t at, size_t size, const void *from,
                           pbs_err *err) {
    if (!s->is_file) {
        if (size) memcpy((char *)s->bytes + at, from, size);
        return PBS_OK;
    }
    for (size_t done = 0; done < size;) {
        ssize_t n = pwrite(s->fd, (const char *)from + done, size - done, (off_t)(at + done));
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return pbs_fail_errno(err, "%s", s->name);
        done += (size_t)n;
    }
    return PBS_OK;
}

void pbs_scratch_free(pbs_scratch *s) {
    if (s->is_file) {
        munmap(s->bytes, s->size);
        if (s->fd >= 0) close(s->fd);
    } else if (s->bytes)
        pbs_free(s->run, s->bytes);
    memset(s, 0, sizeof *s);
}
