#include "formats/container/file.h"
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#define BUFFER ((size_t)256 << 10)
#define AHEAD  64

/* ---- input ---- */

static pbs_code map_fd(int fd, uint64_t size, const uint8_t **bytes) {
    *bytes = NULL;
    if (!size) return PBS_OK;
    void *p = mmap(NULL, size, PROT_READ, MAP_PRIVATE, fd, 0);
    if (p == MAP_FAILED) return PBS_IO;
    *bytes = p;
    return PBS_OK;
}

/* Opening a FIFO waits for its other end; a signal ends that. */
static pbs_code open_failed(const pbs_run *run, const char *name, pbs_err *err) {
    pbs_code rc = errno == EINTR ? pbs_run_check(run, err) : PBS_OK;
    return rc ? rc : pbs_fail_errno(err, "%s", name);
}

pbs_code pbs_input_open_both(pbs_run *run, const char *path, pbs_input *in, pbs_err *err) {
    memset(in, 0, sizeof *in);
    in->run = run;
    bool standard = !path || !strcmp(path, "-");
    snprintf(in->name, sizeof in->name, "%s", standard ? "standard input" : path);
    in->fd = standard ? dup(0) : open(path, O_RDONLY | O_CLOEXEC);
    if (in->fd < 0) return open_failed(run, in->name, err);
    if (!standard) pbs_run_opened(run, path);
    struct stat st;
    pbs_code rc = PBS_OK;
    if (fstat(in->fd, &st))
        rc = pbs_fail_errno(err, "%s", in->name);
    else if (S_ISDIR(st.st_mode))
        rc = pbs_fail(err, PBS_DATA, "%s: is a directory", in->name);
    else if (standard && isatty(in->fd))
        rc = pbs_fail(err, PBS_USAGE, "standard input is a terminal: name a file or pipe one in");
    else if (S_ISREG(st.st_mode) && lseek(in->fd, 0, SEEK_CUR) == 0) {
        in->size = (uint64_t)st.st_size;
        in->device = st.st_dev, in->inode = st.st_ino;
        if (map_fd(in->fd, in->size, &in->bytes)) rc = pbs_fail_errno(err, "%s: map", in->name);
        in->mapped = !rc;
    }
    if (rc) close(in->fd), in->fd = -1;
    return rc;
}

/* A map needs no descriptor, and a program may have thousands of inputs. */
pbs_code pbs_input_open(pbs_run *run, const char *path, pbs_input *in, pbs_err *err) {
    pbs_code rc = pbs_input_open_both(run, path, in, err);
    if (!rc && in->mapped) close(in->fd), in->fd = -1;
    return rc;
}

/* From byte `at` of a file, or, if that is NULL, on. */
static pbs_code read_fully(pbs_input *in, const uint64_t *at, uint8_t *to, size_t n, size_t *got,
                           pbs_err *err) {
    *got = 0;
    while (*got < n) {
        ssize_t r = at ? pread(in->fd, to + *got, n - *got, (off_t)(*at + *got))
                       : read(in->fd, to + *got, n - *got);
        if (r == 0) break;
        if (r < 0 && errno == EINTR) {
            pbs_code rc = pbs_run_check(in->run, err);
            if (rc) return rc;
            continue;
        }
        if (r < 0) return pbs_fail_errno(err, "%s", in->name);
        *got += (size_t)r;
        pbs_code rc = *got < n ? pbs_run_check(in->run, err) : PBS_OK;
        if (rc) return rc;
    }
    return PBS_OK;
}

pbs_code pbs_input_peek(pbs_input *in, const uint8_t **bytes, size_t *n, pbs_err *err) {
    if (in->mapped) {
        *bytes = in->bytes;
        *n = in->size < AHEAD ? (size_t)in->size : AHEAD;
        return PBS_OK;
    }
    if (!in->ahead) {
        if (!(in->ahead = malloc(AHEAD))) return pbs_fail(err, PBS_LIMIT, "no memory");
        pbs_code rc = read_fully(in, NULL, in->ahead, AHEAD, &in->ahead_size, err);
        if (rc) return rc;
    }
    *bytes = in->ahead;
    *n = in->ahead_size;
    return PBS_OK;
}

pbs_code pbs_input_read(pbs_input *in, void *to, size_t n, size_t *got, pbs_err *err) {
    size_t head = in->ahead_size - in->ahead_used, rest;
    *got = 0;
    if (!n) return PBS_OK;
    if (head > n) head = n;
    if (head) memcpy(to, in->ahead + in->ahead_used, head);
    in->ahead_used += head;
    pbs_code rc = read_fully(in, NULL, (uint8_t *)to + head, n - head, &rest, err);
    *got = head + rest;
    return rc;
}

pbs_code pbs_input_read_at(pbs_input *in, uint64_t at, void *to, size_t n, size_t *got,
                           pbs_err *err) {
    return read_fully(in, &at, to, n, got, err);
}

pbs_code pbs_input_map(pbs_input *in, pbs_err *err) {
    if (in->mapped) return PBS_OK;
    pbs_output spool;
    pbs_code rc = pbs_output_spool(in->run, &spool, err);
    uint8_t *buf = NULL;
    if (!rc && !(buf = malloc(BUFFER))) rc = pbs_fail(err, PBS_LIMIT, "no memory");
    for (size_t got = 1; !rc && got;) {
        rc = pbs_input_read(in, buf, BUFFER, &got, err);
        if (!rc) rc = pbs_run_check(in->run, err);
        if (!rc) rc = pbs_output_write(&spool, buf, got, err);
    }
    free(buf);
    if (rc) {
        pbs_output_close(&spool);
        return rc;
    }
    pbs_input mapped;
    if ((rc = pbs_output_reopen(&spool, &mapped, err))) return rc;
    memcpy(mapped.name, in->name, sizeof mapped.name);
    pbs_input_close(in);
    *in = mapped;
    return PBS_OK;
}

void pbs_input_close(pbs_input *in) {
    if (in->bytes) munmap((void *)in->bytes, in->size);
    if (in->fd >= 0) close(in->fd);
    free(in->ahead);
    memset(in, 0, sizeof *in);
    in->fd = -1;
}

pbs_code pbs_map_file(const char *path, const uint8_t **bytes, size_t *size, pbs_err *err) {
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0) return pbs_fail_errno(err, "%s", path);
    struct stat st;
    pbs_code rc = PBS_OK;
    if (fstat(fd, &st))
        rc = pbs_fail_errno(err, "%s", path);
    else if (!S_ISREG(st.st_mode))
        rc = pbs_fail(err, PBS_IO, "%s: not a regular file", path);
    else if (map_fd(fd, (uint64_t)st.st_size, bytes))
        rc = pbs_fail_errno(err, "%s: map", path);
    else
        *size = (size_t)st.st_size;
    close(fd);
    return rc;
}

void pbs_unmap_file(const uint8_t *bytes, size_t size) {
    if (bytes) munmap((void *)bytes, size);
}

/* ---- output ---- */

static pbs_code take_buffer(pbs_run *run, pbs_output *out, pbs_err *err) {
    out->run = run;
    return pbs_alloc(run, &out->buffer, BUFFER, 1, "the output buffer", err);
}

/* A file without a name in the folder of path: a crash, or kill -9, leaves nothing behind. It gets
 * its name through /proc at the end. */
static int open_nameless(const char *path) {
#ifdef O_TMPFILE
    if (access("/proc/self/fd", X_OK)) return -1;
    char dir[4096];
    const char *slash = strrchr(path, '/');
    int n = slash ? (int)(slash - path + 1) : 0;
    if (n >= (int)sizeof dir - 2) return -1;
    snprintf(dir, sizeof dir, "%.*s.", n, path);
    return open(dir, O_TMPFILE | O_RDWR | O_CLOEXEC, 0666);
#else
    return -1;
#endif
}

static char *beside(const char *path) {
    const char *slash = strrchr(path, '/');
    int n = slash ? (int)(slash - path + 1) : 0;
    char *name;
    /* Names end at 255 bytes; what makes this one longer than the file's must fit. */
    if (asprintf(&name, "%.*s.%.200s.%ld.tmp", n, path, path + n, (long)getpid()) < 0) return NULL;
    return name;
}

static pbs_code open_beside(const char *path, pbs_output *out, pbs_err *err) {
    /* A link stays: its file is replaced. /dev/stdout is a link, too. */
    out->path = realpath(path, NULL);
    if (!out->path && !(out->path = strdup(path))) return pbs_fail(err, PBS_LIMIT, "no memory");
    out->seekable = true;
    if ((out->fd = open_nameless(out->path)) >= 0) return PBS_OK;
    if (!(out->temporary = beside(out->path))) return pbs_fail(err, PBS_LIMIT, "no memory");
    out->fd = open(out->temporary, O_CREAT | O_TRUNC | O_RDWR | O_CLOEXEC, 0666);
    if (out->fd >= 0) return PBS_OK;
    pbs_code rc = pbs_fail_errno(err, "%s", path);
    free(out->temporary);
    out->temporary = NULL;
    return rc;
}

static pbs_code open_file(pbs_run *run, const char *path, pbs_output *out, pbs_err *err) {
    struct stat st;
    bool there = !stat(path, &st);
    if (there && S_ISDIR(st.st_mode)) return pbs_fail(err, PBS_IO, "%s: is a directory", path);
    if (there && !S_ISREG(st.st_mode)) { /* /dev/null, a FIFO: written as it is */
        out->fd = open(path, O_WRONLY | O_CLOEXEC);
        return out->fd < 0 ? open_failed(run, path, err) : PBS_OK;
    }
    pbs_code rc = open_beside(path, out, err);
    /* Who could read the file before can read it after, and nobody else. */
    if (!rc && there && fchmod(out->fd, st.st_mode & 0777)) rc = pbs_fail_errno(err, "%s", path);
    return rc;
}

pbs_code pbs_output_open(pbs_run *run, const char *path, pbs_output *out, pbs_err *err) {
    memset(out, 0, sizeof *out);
    out->fd = -1;
    out->run = run;
    bool standard = !path || !strcmp(path, "-");
    snprintf(out->name, sizeof out->name, "%s", standard ? "standard output" : path);
    pbs_code rc = PBS_OK;
    if (!standard)
        rc = open_file(run, path, out, err);
    else if (isatty(1))
        rc = pbs_fail(err, PBS_USAGE, "standard output is a terminal: give -o FILE or a pipe");
    else if ((out->fd = dup(1)) < 0)
        rc = pbs_fail_errno(err, "%s", out->name);
    if (!rc) rc = take_buffer(run, out, err);
    if (rc) pbs_output_close(out);
    return rc;
}

/* Never has a name where the file system can do that: somebody may kill us at any moment. */
static int open_spool(const char *dir) {
    char path[4096];
#ifdef O_TMPFILE
    int fd = open(dir, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (fd >= 0) return fd;
#endif
    snprintf(path, sizeof path, "%s/pbs-XXXXXX", dir);
    int named = mkostemp(path, O_CLOEXEC);
    if (named >= 0) unlink(path);
    return named;
}

pbs_code pbs_output_spool(pbs_run *run, pbs_output *out, pbs_err *err) {
    memset(out, 0, sizeof *out);
    const char *dir = getenv("TMPDIR");
    if (!dir || !*dir) dir = "/tmp";
    snprintf(out->name, sizeof out->name, "temporary file in %s", dir);
    out->fd = open_spool(dir);
    if (out->fd < 0) return pbs_fail_errno(err, "%s", out->name);
    out->seekable = true;
    pbs_code rc = take_buffer(run, out, err);
    if (rc) pbs_output_close(out);
    return rc;
}

/* How much of *n a pipe takes without waiting. A thread that waits inside of write for a reader
 * which never reads may not be the one that a signal wakes, so we wait outside, and look. An empty
 * pipe takes what it holds; one that poll calls writable takes a page. */
static pbs_code wait_for_pipe(const pbs_output *out, size_t *n, pbs_err *err) {
    struct pollfd p = {.fd = out->fd, .events = POLLOUT};
    for (int ready = 0; !ready;) {
        pbs_code rc = pbs_run_check(out->run, err);
        if (rc) return rc;
        ready = poll(&p, 1, 200);
        if (ready < 0 && errno != EINTR) return pbs_fail_errno(err, "%s", out->name);
        if (ready < 0) ready = 0;
    }
    int queued = 1, holds = 0;
    if (!ioctl(out->fd, FIONREAD, &queued) && !queued) holds = fcntl(out->fd, F_GETPIPE_SZ);
    size_t room = holds > PIPE_BUF ? (size_t)holds : PIPE_BUF;
    if (*n > room) *n = room;
    return PBS_OK;
}

static pbs_code write_fully(pbs_output *out, const uint8_t *p, size_t n, pbs_err *err) {
    struct stat st;
    bool pipe = !out->seekable && !fstat(out->fd, &st) && S_ISFIFO(st.st_mode);
    while (n) {
        size_t now = n;
        pbs_code waited = pipe ? wait_for_pipe(out, &now, err) : PBS_OK;
        if (waited) return waited;
        ssize_t w = write(out->fd, p, now);
        if (w < 0 && errno == EINTR) {
            pbs_code rc = pbs_run_check(out->run, err);
            if (rc) return rc;
            continue;
        }
        if (w < 0) return pbs_fail_errno(err, "%s", out->name);
        p += w;
        n -= (size_t)w;
        /* A signal that comes while a pipe is full ends the write early and without EINTR. */
        if (n) {
            pbs_code rc = pbs_run_check(out->run, err);
            if (rc) return rc;
        }
    }
    return PBS_OK;
}

pbs_code pbs_output_flush(pbs_output *out, pbs_err *err) {
    size_t n = out->buffered;
    out->buffered = 0;
    return write_fully(out, out->buffer, n, err);
}

pbs_code pbs_output_write(pbs_output *out, const void *bytes, size_t n, pbs_err *err) {
    if (out->buffered + n > BUFFER) {
        pbs_code rc = pbs_output_flush(out, err);
        if (rc) return rc;
    }
    out->written += n;
    if (n > BUFFER) return write_fully(out, bytes, n, err);
    if (n) memcpy(out->buffer + out->buffered, bytes, n);
    out->buffered += n;
    return PBS_OK;
}

pbs_code pbs_output_patch(pbs_output *out, uint64_t at, const void *bytes, size_t n, pbs_err *err) {
    pbs_code rc = pbs_output_flush(out, err);
    if (rc) return rc;
    for (size_t done = 0; done < n;) {
        ssize_t w = pwrite(out->fd, (const char *)bytes + done, n - done, (off_t)(at + done));
        if (w < 0 && errno == EINTR) continue;
        if (w < 0) return pbs_fail_errno(err, "%s", out->name);
        done += (size_t)w;
    }
    return PBS_OK;
}

/* linkat cannot replace a file, so a nameless file gets a name beside first. */
static pbs_code give_name(pbs_output *out) {
    if (out->temporary) return PBS_OK;
    if (!(out->temporary = beside(out->path))) return PBS_LIMIT;
    char self[64];
    snprintf(self, sizeof self, "/proc/self/fd/%d", out->fd);
    unlink(out->temporary);
    if (!linkat(AT_FDCWD, self, AT_FDCWD, out->temporary, AT_SYMLINK_FOLLOW)) return PBS_OK;
    free(out->temporary);
    out->temporary = NULL;
    return PBS_IO;
}

pbs_code pbs_output_commit(pbs_output *out, pbs_err *err) {
    pbs_code rc = pbs_output_flush(out, err);
    if (!rc) rc = pbs_run_check(out->run, err);
    if (rc || !out->path) return rc;
    if (give_name(out)) return pbs_fail_errno(err, "%s", out->name);
    /* A network file system may report a full disk only when it is closed. */
    int fd = out->fd;
    out->fd = -1;
    if (close(fd)) return pbs_fail_errno(err, "%s", out->name);
    if (rename(out->temporary, out->path)) return pbs_fail_errno(err, "%s", out->name);
    free(out->temporary);
    out->temporary = NULL;
    return PBS_OK;
}

void pbs_output_close(pbs_output *out) {
    if (out->fd >= 0) close(out->fd);
    if (out->temporary) unlink(out->temporary);
    free(out->temporary);
    free(out->path);
    if (out->run) pbs_free(out->run, out->buffer);
    memset(out, 0, sizeof *out);
    out->fd = -1;
}

pbs_code pbs_output_reopen(pbs_output *out, pbs_input *in, pbs_err *err) {
    memset(in, 0, sizeof *in);
    in->fd = -1;
    pbs_code rc = pbs_output_flush(out, err);
    if (!rc) {
        in->run = out->run;
        in->size = out->written;
        memcpy(in->name, out->name, sizeof in->name);
        if (map_fd(out->fd, in->size, &in->bytes)) rc = pbs_fail_errno(err, "%s: map", out->name);
    }
    in->mapped = !rc;
    pbs_output_close(out);
    return rc;
}
