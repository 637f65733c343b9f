#include "formats/surfels/exr.h"
#include "formats/container/file.h"
#include "formats/readers/module.h"
#include "formats/surfels/points.h"
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#define OPENEXR_BYTES ((size_t)8 << 20) /* its buffers, counted roughly */

/* ---- writing ---- */

enum { PLANES = 15 };

/* Which plane is which component of which channel. */
static const struct plane {
    const char *part, *name;
    uint32_t channel;
    int component;
    bool half;
} planes[PLANES] = {
    {"position", "P.X", PBS_POSITION, 0, false},
    {"position", "P.Y", PBS_POSITION, 1, false},
    {"position", "P.Z", PBS_POSITION, 2, false},
    {"normal", "N.X", PBS_NORMAL, 0, false},
    {"normal", "N.Y", PBS_NORMAL, 1, false},
    {"normal", "N.Z", PBS_NORMAL, 2, false},
    {"colour", "R", PBS_COLOUR, 0, true},
    {"colour", "G", PBS_COLOUR, 1, true},
    {"colour", "B", PBS_COLOUR, 2, true},
    {"colour", "A", PBS_COLOUR, 3, true},
    {"material", "metallic", PBS_MATERIAL, 0, true},
    {"material", "roughness", PBS_MATERIAL, 1, true},
    {"emissive", "E.R", PBS_EMISSIVE, 0, true},
    {"emissive", "E.G", PBS_EMISSIVE, 1, true},
    {"emissive", "E.B", PBS_EMISSIVE, 2, true},
};

static uint32_t channels_of(const pbs_points *p) {
    return PBS_POSITION | (p->normal ? PBS_NORMAL : 0u) | (p->colour ? PBS_COLOUR : 0u) |
           (p->material ? PBS_MATERIAL : 0u) | (p->emissive ? PBS_EMISSIVE : 0u);
}

static float component(const pbs_points *p, size_t i, const struct plane *pl) {
    float n[3];
    int k = pl->component;
    switch (pl->channel) {
    case PBS_POSITION:
        return p->position[3 * i + k];
    case PBS_NORMAL:
        pbs_oct_decode(n, p->normal + 2 * i);
        return n[k];
    case PBS_MATERIAL:
        return p->material[4 * i + k] / 255.0f;
    case PBS_EMISSIVE:
        return pbs_srgb_to_linear(p->emissive[4 * i + k] / 255.0f);
    default:
        return k == 3 ? p->colour[4 * i + 3] / 255.0f
                      : pbs_srgb_to_linear(p->colour[4 * i + k] / 255.0f);
    }
}

/* EXR's rows go down, the view's go up. */
static void scatter(const pbs_gbuffer_view *v, const struct plane *pl, float *data) {
    memset(data, 0, (size_t)v->width * v->height * sizeof *data);
    for (size_t i = 0; i < v->points.count; i++) {
        uint32_t y = v->where[i] / v->width, x = v->where[i] % v->width;
        data[(size_t)(v->height - 1 - y) * v->width + x] = component(&v->points, i, pl);
    }
}

static int fill_parts(const pbs_gbuffer_view *v, float *data, pbs_exr_plane *plane,
                      pbs_exr_part *part) {
    size_t size = (size_t)v->width * v->height;
    uint32_t channels = channels_of(&v->points);
    int parts = 0;
    for (int i = 0; i < PLANES; i++) {
        if (!(channels & planes[i].channel)) continue;
        scatter(v, &planes[i], data);
        *plane = (pbs_exr_plane){planes[i].name, data, 1, planes[i].half};
        if (!parts || strcmp(part[parts - 1].name, planes[i].part))
            part[parts++] =
                (pbs_exr_part){planes[i].part, v->width, v->height, plane, 0, {0, 0, 0}};
        part[parts - 1].plane_count++;
        plane++;
        data += size;
    }
    return parts;
}

pbs_code pbs_exr_folder(const char *dir, pbs_err *err) {
    if (mkdir(dir, 0777) && errno != EEXIST) return pbs_fail_errno(err, "%s", dir);
    return PBS_OK;
}

pbs_code pbs_exr_write_view(pbs_run *run, const char *dir, const double origin[3],
                            const pbs_gbuffer_view *v, pbs_err *err) {
    const pbs_module_exr *exr;
    char path[4096];
    float *data;
    pbs_exr_plane plane[PLANES];
    pbs_exr_part part[5];
    const void *module;
    pbs_code rc = pbs_module_open(run, "exr", OPENEXR_BYTES, &module, err);
    if (rc) return rc;
    exr = module;
    if ((rc = pbs_exr_folder(dir, err))) return rc;
    snprintf(path, sizeof path, "%s/view%d.exr", dir, v->view);
    rc = pbs_alloc(run, &data, (size_t)v->width * v->height * PLANES, sizeof *data,
                   "the planes of an EXR file", err);
    if (rc) return rc;
    int parts = fill_parts(v, data, plane, part);
    for (int i = 0; i < parts; i++) memcpy(part[i].origin, origin, sizeof part[i].origin);
    rc = exr->write(path, part, parts, err);
    pbs_free(run, data);
    return rc;
}

/* ---- reading ---- */

typedef struct view {
    pbs_run *run;
    const char *path;
    uint32_t width, height;
    float *plane[PLANES]; /* own copies; NULL: not there */
    uint32_t *channels;
    pbs_points *points;
    size_t *cap;
    double *origin;
    int views;
} view;

static bool ends(const char *s, size_t n, const char *with) {
    size_t w = strlen(with);
    return n >= w && !strncasecmp(s + n - w, with, w);
}

/* "P.X", "position.x", "position.R", ".../P.Z": which of our planes; -1 for none. */
static int plane_of(const char *part, const char *name) {
    static const char *const layer[] = {"P", "position", "N", "normal"};
    size_t n = strlen(name);
    for (int i = 6; i < PLANES; i++)
        if (!strcmp(name, planes[i].name)) return i;
    if (n < 1) return -1;
    char last = name[n - 1];
    const char *at = strchr("XYZxyzRGBrgb", last);
    if (!at) return -1;
    int k = (int)(at - "XYZxyzRGBrgb") % 3;
    for (int l = 0; l < 4; l++) {
        if (n > 2 && name[n - 2] == '.' && ends(name, n - 2, layer[l])) return (l < 2 ? 0 : 3) + k;
        if (n == 1 && strchr("XYZxyz", last) && part && !strcasecmp(part, layer[l]))
            return (l < 2 ? 0 : 3) + k;
    }
    return -1;
}

static void forget(view *v) {
    for (int i = 0; i < PLANES; i++) {
        pbs_free(v->run, v->plane[i]);
        v->plane[i] = NULL;
    }
}

static bool has(const view *v, int first, int count) {
    while (count--)
        if (!v->plane[first++]) return false;
    return true;
}

static void add_point(view *v, size_t i) {
    pbs_points *p = v->points;
    float n[3] = {v->plane[3][i], v->plane[4][i], v->plane[5][i]};
    float l = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
    if (!(l > 0) || !(l < INFINITY)) return;
    size_t at = p->count++;
    for (int k = 0; k < 3; k++) p->position[3 * at + k] = v->plane[k][i];
    pbs_oct_encode(p->normal + 2 * at, n);
    for (int k = 0; k < 3 && p->colour; k++)
        p->colour[4 * at + k] = pbs_unorm8(pbs_linear_to_srgb(v->plane[6 + k][i]));
    if (p->colour) p->colour[4 * at + 3] = v->plane[9] ? pbs_unorm8(v->plane[9][i]) : 255;
    for (int k = 0; k < 4 && p->material; k++)
        p->material[4 * at + k] = k < 2 ? pbs_unorm8(v->plane[10 + k][i]) : 0;
    for (int k = 0; k < 4 && p->emissive; k++)
        p->emissive[4 * at + k] = k < 3 ? pbs_unorm8(pbs_linear_to_srgb(v->plane[12 + k][i])) : 0;
}

/* The planes gathered so far are one view: its covered pixels become candidates. */
static pbs_code finish_view(view *v, pbs_err *err) {
    if (!has(v, 0, 3) || !has(v, 3, 3))
        return pbs_fail(err, PBS_DATA, "%s: no planes P.X P.Y P.Z and N.X N.Y N.Z", v->path);
    uint32_t channels = PBS_POSITION | PBS_NORMAL | (has(v, 6, 3) ? PBS_COLOUR : 0u) |
                        (has(v, 10, 2) ? PBS_MATERIAL : 0u) | (has(v, 12, 3) ? PBS_EMISSIVE : 0u);
    if (*v->channels && *v->channels != channels)
        return pbs_fail(err, PBS_DATA, "%s: its planes are not those of the views before", v->path);
    *v->channels = channels;
    size_t n = (size_t)v->width * v->height;
    pbs_code rc = pbs_points_grow(v->run, channels, v->points, v->cap, v->points->count + n, err);
    for (size_t i = 0; i < n && !rc; i++) add_point(v, i);
    forget(v);
    v->views++;
    return rc;
}

static pbs_code take_plane(view *v, const pbs_exr_part *part, const pbs_exr_plane *from,
                           pbs_err *err) {
    int i = plane_of(part->name, from->channel);
    if (i < 0 || v->plane[i]) return PBS_OK;
    size_t n = (size_t)part->width * part->height;
    pbs_code rc =
        pbs_alloc(v->run, &v->plane[i], n, sizeof(float), "the planes of an EXR file", err);
    for (size_t k = 0; k < n && !rc; k++) v->plane[i][k] = from->data[k * from->stride];
    return rc;
}

static pbs_code take_part(void *ctx, const pbs_exr_part *part, pbs_err *err) {
    view *v = ctx;
    pbs_code rc = PBS_OK;
    for (int i = 0; i < part->plane_count && !rc; i++)
        if (plane_of(part->name, part->planes[i].channel) == 0 && v->plane[0]) {
            rc = finish_view(v, err);
            break;
        }
    bool first = !*v->channels && !v->plane[0];
    if (first) memcpy(v->origin, part->origin, sizeof part->origin);
    if (!rc && memcmp(v->origin, part->origin, sizeof part->origin))
        rc = pbs_fail(err, PBS_DATA, "%s: views with different origins", v->path);
    bool fresh = true;
    for (int i = 0; i < PLANES; i++) fresh = fresh && !v->plane[i];
    if (!rc && !fresh && (part->width != v->width || part->height != v->height))
        rc = pbs_fail(err, PBS_DATA, "%s: parts of different sizes", v->path);
    v->width = part->width;
    v->height = part->height;
    for (int i = 0; i < part->plane_count && !rc; i++)
        rc = take_plane(v, part, &part->planes[i], err);
    return rc;
}

pbs_code pbs_exr_read_views(pbs_run *run, const char *path, uint32_t *channels, pbs_points *points,
                            size_t *cap, double origin[3], pbs_err *err) {
    const void *module;
    pbs_code rc = pbs_module_open(run, "exr", OPENEXR_BYTES, &module, err);
    if (rc) return rc;
    view v = {.run = run,
              .path = path,
              .channels = channels,
              .points = points,
              .cap = cap,
              .origin = origin};
    rc = ((const pbs_module_exr *)module)->read(run, path, take_part, &v, err);
    if (!rc) rc = finish_view(&v, err);
    forget(&v);
    return rc;
}
