/* image.c: pictures; PPM and PAM here, the rest through the module "image". */
#include "formats/readers/image.h"
#include "formats/readers/module.h"
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

/* What opening OpenImageIO and its 250 libraries was seen to add to the process. */
#define IMAGE_COST ((size_t)130 << 20)
#define MAX_SIDE   16384

typedef struct header {
    uint32_t width, height, depth, maxval;
    size_t pixels; /* where they begin */
} header;

static bool is_space(uint8_t c) {
    return c == ' ' || (c >= '\t' && c <= '\r');
}

/* The next word of a header; '#' begins a comment up to the end of the line. */
static size_t word(const uint8_t *p, size_t n, size_t at, char out[16]) {
    size_t k = 0;
    while (at < n && (is_space(p[at]) || p[at] == '#'))
        if (p[at++] == '#')
            while (at < n && p[at] != '\n') at++;
    while (at < n && !is_space(p[at]) && p[at] != '#' && k < 15) out[k++] = (char)p[at++];
    out[k] = 0;
    return at;
}

static size_t number(const uint8_t *p, size_t n, size_t at, uint32_t *out) {
    char w[16], *end;
    at = word(p, n, at, w);
    unsigned long v = strtoul(w, &end, 10);
    *out = *w && !*end && v < UINT32_MAX ? (uint32_t)v : 0;
    return at;
}

static bool parse_ppm(const uint8_t *p, size_t n, header *h) {
    size_t at = number(p, n, 2, &h->width);
    at = number(p, n, at, &h->height);
    at = number(p, n, at, &h->maxval);
    h->depth = 3;
    h->pixels = at + 1; /* one white-space character */
    return at < n;
}

static bool parse_pam(const uint8_t *p, size_t n, header *h) {
    char key[16];
    for (size_t at = word(p, n, 2, key); *key; at = word(p, n, at, key)) {
        if (!strcmp(key, "ENDHDR")) {
            h->pixels = at + 1;
            return at < n;
        }
        if (!strcmp(key, "WIDTH"))
            at = number(p, n, at, &h->width);
        else if (!strcmp(key, "HEIGHT"))
            at = number(p, n, at, &h->height);
        else if (!strcmp(key, "DEPTH"))
            at = number(p, n, at, &h->depth);
        else if (!strcmp(key, "MAXVAL"))
            at = number(p, n, at, &h->maxval);
        else
            while (at < n && p[at] != '\n') at++;
    }
    return false;
}

static pbs_code check_header(const header *h, size_t size, const char *name, pbs_err *err) {
    if (!h->width || !h->height || h->depth < 1 || h->depth > 4 || h->maxval != 255)
        return pbs_fail(err, PBS_DATA, "%s: not 8 bits in 1 to 4 channels", name);
    if (h->width > MAX_SIDE || h->height > MAX_SIDE)
        return pbs_fail(err, PBS_DATA, "%s: %u x %u is more than %d a side", name, h->width,
                        h->height, MAX_SIDE);
    if ((uint64_t)h->width * h->height * h->depth > size - h->pixels)
        return pbs_fail(err, PBS_DATA, "%s: the file is cut off", name);
    return PBS_OK;
}

/* Grey, grey and alpha, rgb, rgb and alpha to the last. */
static void expand(uint8_t *out, const uint8_t *in, size_t pixels, uint32_t depth) {
    for (size_t i = 0; i < pixels; i++, in += depth, out += 4) {
        for (int k = 0; k < 3; k++) out[k] = in[depth < 3 ? 0 : k];
        out[3] = depth % 2 ? 255 : in[depth - 1];
    }
}

static pbs_code decode_pnm(pbs_run *run, const char *name, const uint8_t *p, size_t size,
                           pbs_image *out, pbs_err *err) {
    header h = {0};
    if (!(p[1] == '6' ? parse_ppm(p, size, &h) : parse_pam(p, size, &h)))
        return pbs_fail(err, PBS_DATA, "%s: the file ends inside its header", name);
    pbs_code rc = check_header(&h, size, name, err);
    if (rc) return rc;
    size_t pixels = (size_t)h.width * h.height;
    rc = pbs_alloc(run, &out->rgba, pixels, 4, "an image", err);
    if (rc) return rc;
    out->width = h.width, out->height = h.height;
    expand(out->rgba, p + h.pixels, pixels, h.depth);
    return PBS_OK;
}

/* 16-bit PPM is OpenImageIO's. */
static bool is_ours(const uint8_t *p, size_t size) {
    header h = {0};
    if (size < 3 || p[0] != 'P' || !is_space(p[2])) return false;
    return p[1] == '7' || (p[1] == '6' && !(parse_ppm(p, size, &h) && h.maxval > 255));
}

pbs_code pbs_image_decode(pbs_run *run, const char *name, const void *bytes, size_t size,
                          pbs_image *out, pbs_err *err) {
    *out = (pbs_image){0};
    if (!size) return pbs_fail(err, PBS_DATA, "%s: the image is empty", name);
    if (is_ours(bytes, size)) return decode_pnm(run, name, bytes, size, out, err);
    const void *table;
    pbs_code rc = pbs_module_open(run, "image", IMAGE_COST, &table, err);
    if (rc) return rc;
    const pbs_module_image *image = table;
    return image->decode(run, name, bytes, size, out, err);
}

pbs_code pbs_image_read(pbs_run *run, const char *path, pbs_image *out, pbs_err *err) {
    *out = (pbs_image){0};
    struct stat st;
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0) return pbs_fail_errno(err, "%s", path);
    if (fstat(fd, &st) || !S_ISREG(st.st_mode)) {
        close(fd);
        return pbs_fail(err, PBS_IO, "%s: not a plain file", path);
    }
    size_t size = (size_t)st.st_size;
    void *map = size ? mmap(NULL, size, PROT_READ, MAP_PRIVATE, fd, 0) : NULL;
    int keep = errno;
    close(fd);
    errno = keep;
    if (map == MAP_FAILED) return pbs_fail_errno(err, "%s", path);
    pbs_code rc = pbs_image_decode(run, path, map, size, out, err);
    if (map) munmap(map, size);
    return rc;
}

static bool write_ppm(FILE *f, const pbs_image *image, bool alpha) {
    if (alpha)
        fprintf(f, "P7\nWIDTH %u\nHEIGHT %u\nDEPTH 4\nMAXVAL 255\nTUPLTYPE RGB_ALPHA\nENDHDR\n",
                image->width, image->height);
    else
        fprintf(f, "P6\n%u %u\n255\n", image->width, image->height);
    size_t pixels = (size_t)image->width * image->height;
    for (size_t i = 0; i < pixels; i++)
        if (fwrite(image->rgba + 4 * i, 1, alpha ? 4 : 3, f) != (alpha ? 4 : 3)) return false;
    return true;
}

static pbs_code write_pnm_file(const char *path, const pbs_image *image, bool alpha, pbs_err *err) {
    FILE *f = fopen(path, "wb");
    if (!f) return pbs_fail_errno(err, "cannot be written");
    bool good = write_ppm(f, image, alpha);
    int keep = errno;
    if (fclose(f) == 0 && good) return PBS_OK;
    errno = good ? errno : keep;
    return pbs_fail_errno(err, "cannot be written");
}

/* Where the ending begins, with its dot; the end of path if there is none. */
static const char *ending(const char *path) {
    const char *slash = strrchr(path, '/'), *dot = strrchr(path, '.');
    return dot && dot > (slash ? slash + 1 : path) ? dot : path + strlen(path);
}

static pbs_code write_as(pbs_run *run, const char *path, const char *dot, const pbs_image *image,
                         pbs_err *err) {
    bool pam = !strcasecmp(dot, ".pam");
    if (pam || !strcasecmp(dot, ".ppm")) return write_pnm_file(path, image, pam, err);
    const void *table;
    pbs_code rc = pbs_module_open(run, "image", IMAGE_COST, &table, err);
    if (rc) return rc;
    const pbs_module_image *module = table;
    return module->write(path, image, err);
}

pbs_code pbs_image_write(pbs_run *run, const char *path, const pbs_image *image, pbs_err *err) {
    struct stat st;
    const char *dot = ending(path);
    if (!*dot) return pbs_fail(err, PBS_USAGE, "%s: an image needs an ending, like .png", path);
    if (!image->width || !image->height)
        return pbs_fail(err, PBS_DATA, "%s: the image is empty", path);
    /* Renaming over a device or a pipe would replace it. */
    if (stat(path, &st) == 0 && !S_ISREG(st.st_mode))
        return pbs_fail(err, PBS_IO, "%s: not a plain file", path);
    char *temporary;
    size_t size = strlen(path) + 40;
    pbs_code rc = pbs_alloc(run, &temporary, size, 1, "a file name", err);
    if (rc) return rc;
    /* The same ending, because it says the format. */
    snprintf(temporary, size, "%.*s.%ld~%s", (int)(dot - path), path, (long)getpid(), dot);
    rc = write_as(run, temporary, dot, image, err);
    if (!rc && rename(temporary, path)) rc = pbs_fail_errno(err, "cannot be renamed");
    if (rc) {
        unlink(temporary);
        pbs_fail_in(err, "%s", path);
    }
    pbs_free(run, temporary);
    return rc;
}
