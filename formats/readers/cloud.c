/* cloud.c: which reader a point cloud needs; and what text is read into. */
#include "formats/readers/cloud.h"
#include "formats/readers/text.h"
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

static bool begins(const pbs_cloud *c, const char *with) {
    return c->in.size >= strlen(with) && !memcmp(c->in.bytes, with, strlen(with));
}

static bool ends(const char *path, const char *with) {
    size_t n = path ? strlen(path) : 0, w = strlen(with);
    return n > w && !strcasecmp(path + n - w, with);
}

static const struct {
    const char *magic, *ending, *what;
} refused[] = {
    {"ASTM-E57", ".e57", "E57 is not read: write LAS or PLY (CloudCompare, or pdal translate)"},
    {NULL, ".laz", "LAZ is not read: unpack it to LAS (laszip, las2las, or pdal translate)"},
    {"glTF", ".glb", "a mesh: pbs-gbuffer and pbs-voxelize read it"},
    {NULL, ".gltf", "a mesh: pbs-gbuffer and pbs-voxelize read it"},
    {NULL, ".obj", "a mesh: pbs-gbuffer and pbs-voxelize read it"},
    {"solid ", ".stl", "a mesh: pbs-gbuffer and pbs-voxelize read it"},
    {"# .PCD", ".pcd", "PCD is not read: write PLY (pcl_pcd2ply, or CloudCompare)"},
};

/* Text has no zero bytes, and its first letter is of a number or a name. */
static bool looks_like_text(const pbs_cloud *c) {
    size_t n = c->in.size < 4096 ? (size_t)c->in.size : 4096;
    return !memchr(c->in.bytes, 0, n);
}

static pbs_code pick(pbs_cloud *c, const char *path, pbs_err *err) {
    if (!c->in.size) return pbs_fail(err, PBS_DATA, "the file is empty");
    if (begins(c, "LASF")) return pbs_cloud_las(c, err);
    if (begins(c, "ply\n") || begins(c, "ply\r")) return pbs_cloud_ply(c, err);
    for (size_t i = 0; i < sizeof refused / sizeof refused[0]; i++)
        if ((refused[i].magic && begins(c, refused[i].magic)) || ends(path, refused[i].ending))
            return pbs_fail(err, PBS_DATA, "%s", refused[i].what);
    if (ends(path, ".las")) return pbs_fail(err, PBS_DATA, "is not a LAS file");
    if (looks_like_text(c)) return pbs_cloud_text(c, err);
    return pbs_fail(err, PBS_DATA,
                    "neither a pbs stream nor a point cloud that is read (LAS, PLY, XYZ, PTS)");
}

static bool frame_is_sound(const pbs_cloud *c) {
    for (int k = 0; k < 3; k++)
        if (!isfinite(c->offset[k]) || !isfinite(c->scale[k]) || c->scale[k] == 0) return false;
    return true;
}

/* The mapped file once more, to read from: that takes a quarter of the time of a map, whose every
 * page is set up to be looked at once. -1 if it is not there any more, or there are too many. */
static int open_again(const pbs_input *in, const char *path) {
    struct stat st;
    bool standard = !path || !strcmp(path, "-");
    int fd = standard ? fcntl(0, F_DUPFD_CLOEXEC, 0) : open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0) return -1;
    if (in->inode && !fstat(fd, &st) && st.st_dev == in->device && st.st_ino == in->inode)
        return fd;
    close(fd);
    return -1;
}

pbs_code pbs_cloud_open_input(pbs_run *run, pbs_input *in, const char *path, pbs_cloud *c,
                              pbs_err *err) {
    *c = (pbs_cloud){
        .run = run, .in = *in, .own.fd = -1, .fd = -1, .scale = {1, 1, 1}, .said_low = {1}};
    pbs_code rc = pbs_input_map(&c->in, err);
    if (!rc) {
        c->fd = open_again(&c->in, path);
        rc = pick(c, path, err);
        if (!rc && !frame_is_sound(c))
            rc = pbs_fail(err, PBS_DATA, "its scale and offset are not numbers to place points by");
        if (rc) pbs_fail_in(err, "%s", c->in.name);
    }
    if (rc) pbs_cloud_close(c);
    return rc;
}

pbs_code pbs_cloud_open(pbs_run *run, const char *path, pbs_cloud *c, pbs_err *err) {
    pbs_input in;
    pbs_code rc = pbs_input_open(run, path, &in, err);
    return rc ? rc : pbs_cloud_open_input(run, &in, path, c, err);
}

void pbs_cloud_close(pbs_cloud *c) {
    if (!c->run) return;
    if (c->fd >= 0) close(c->fd);
    pbs_input_close(&c->in);
    pbs_input_close(&c->own);
    memset(c, 0, sizeof *c);
}

/* ---- points ---- */

enum { PIECE = 64 << 10 };

static pbs_code read_piece(const pbs_cloud *c, uint64_t at, uint8_t *to, size_t size,
                           pbs_err *err) {
    for (size_t got = 0; got < size;) {
        ssize_t n = pread(c->fd, to + got, size - got, (off_t)(at + got));
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return pbs_fail_errno(err, "%s", c->in.name);
        if (!n) return pbs_fail(err, PBS_IO, "%s: became shorter", c->in.name);
        got += (size_t)n;
    }
    return PBS_OK;
}

pbs_code pbs_cloud_records(const pbs_cloud *c, uint64_t first, size_t n, void *room,
                           const uint8_t **out, pbs_err *err) {
    const uint8_t *base = c->own.bytes ? c->own.bytes : c->in.bytes;
    uint64_t at = (uint64_t)(c->first - base) + first * c->stride;
    *out = c->fd < 0 ? base + at : room;
    return c->fd < 0 ? PBS_OK : read_piece(c, at, room, n * c->stride, err);
}

pbs_code pbs_cloud_read(const pbs_cloud *c, uint64_t first, size_t n, double (*value)[3],
                        uint16_t (*colour)[3], pbs_err *err) {
    _Alignas(16) uint8_t piece[PIECE];
    const uint8_t *from;
    if (c->colour == PBS_CLOUD_NO_COLOUR) colour = NULL;
    if (c->fd < 0 || c->stride > PIECE) {
        c->decode(c, c->first + first * c->stride, n, value, colour);
        return PBS_OK;
    }
    for (size_t i = 0, some; i < n; i += some) {
        some = PIECE / c->stride < n - i ? PIECE / c->stride : n - i;
        pbs_code rc = pbs_cloud_records(c, first + i, some, piece, &from, err);
        if (rc) return rc;
        c->decode(c, from, some, value + i, colour ? colour + i : NULL);
    }
    return PBS_OK;
}

/* ---- rows ---- */

static void decode_rows(const pbs_cloud *c, const uint8_t *from, size_t n, double (*value)[3],
                        uint16_t (*colour)[3]) {
    const pbs_cloud_row *r = (const void *)from;
    for (size_t i = 0; i < n; i++) {
        memcpy(value[i], r[i].value, sizeof *value);
        for (int k = 0; colour && k < 3; k++) {
            float v = r[i].colour[k] * c->colour_scale;
            colour[i][k] = v >= 65535 ? 65535 : v > 0 ? (uint16_t)(v + 0.5f) : 0;
        }
    }
}

pbs_code pbs_cloud_rows(pbs_cloud *c, pbs_output *rows, bool colours, float most, bool fraction,
                        pbs_err *err) {
    c->count = rows->written / sizeof(pbs_cloud_row);
    if (c->fd >= 0) close(c->fd);
    c->fd = fcntl(rows->fd, F_DUPFD_CLOEXEC, 0);
    pbs_code rc = pbs_output_reopen(rows, &c->own, err);
    if (rc) return rc;
    c->colour = colours ? PBS_CLOUD_COLOUR_16 : PBS_CLOUD_NO_COLOUR;
    c->colour_scale = most <= 1 && fraction ? 65535 : most <= 255 ? 257 : 1;
    c->first = c->own.bytes;
    c->stride = sizeof(pbs_cloud_row);
    c->decode = decode_rows;
    return PBS_OK;
}
