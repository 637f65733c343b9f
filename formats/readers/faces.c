#include "formats/readers/faces.h"
#include "libcore/data/polygon.h"

pbs_code pbs_faces_reserve(pbs_faces *f, size_t n, pbs_err *err) {
    return pbs_grow(f->sink->run, &f->corner, &f->corners, n, sizeof *f->corner,
                    "the corners of a face", err);
}

static pbs_code cut(pbs_faces *f, size_t n, pbs_err *err) {
    pbs_run *run = f->sink->run;
    if (n > UINT32_MAX / 4) return pbs_fail(err, PBS_DATA, "a face with %zu corners", n);
    pbs_code rc = pbs_grow(run, &f->triangle, &f->triangles, n - 2, 3 * sizeof *f->triangle,
                           "the triangles of a face", err);
    size_t need = pbs_polygon_scratch((uint32_t)n);
    if (!rc) rc = pbs_grow(run, &f->scratch, &f->scratch_size, need, 1, "cutting a face", err);
    if (rc) return rc;
    pbs_polygon_triangulate(f->corner->position, sizeof *f->corner / sizeof(double), (uint32_t)n,
                            f->triangle, f->scratch);
    return PBS_OK;
}

_Static_assert(sizeof(pbs_corner) % sizeof(double) == 0, "corners have a stride in doubles");

pbs_code pbs_faces_polygon(pbs_faces *f, size_t n, uint32_t material, pbs_err *err) {
    const pbs_sink *sink = f->sink;
    if (n == 3) return sink->triangle(sink->ctx, f->corner, material, err);
    if (n < 3) {
        sink->skip(sink->ctx, PBS_SKIP_POLYGON, 1);
        return PBS_OK;
    }
    pbs_code rc = cut(f, n, err);
    for (size_t i = 0; i < n - 2 && !rc; i++) {
        const uint32_t *t = f->triangle + 3 * i;
        pbs_corner corner[3] = {f->corner[t[0]], f->corner[t[1]], f->corner[t[2]]};
        rc = sink->triangle(sink->ctx, corner, material, err);
    }
    return rc;
}

pbs_code pbs_faces_part_end(pbs_faces *f, pbs_err *err) {
    pbs_child child = {0};
    memcpy(child.m, PBS_IDENTITY, sizeof child.m);
    pbs_code rc = f->sink->part_end(f->sink->ctx, &child.node, err);
    if (!rc)
        rc = pbs_grow(f->sink->run, &f->part, &f->parts_room, f->parts + 1, sizeof *f->part,
                      "the list of parts", err);
    if (!rc) f->part[f->parts++] = child;
    return rc;
}

pbs_code pbs_faces_root(pbs_faces *f, const char *name, pbs_err *err) {
    const pbs_sink *sink = f->sink;
    uint32_t node;
    pbs_code rc = sink->assembly(sink->ctx, name, f->part, f->parts, &node, err);
    return rc ? rc : sink->root(sink->ctx, node, err);
}

void pbs_faces_free(pbs_faces *f) {
    pbs_run *run = f->sink->run;
    pbs_free(run, f->corner);
    pbs_free(run, f->triangle);
    pbs_free(run, f->scratch);
    pbs_free(run, f->part);
}

void pbs_file_stem(char out[PBS_NAME_MAX], const char *path) {
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
    const char *dot = strrchr(name, '.');
    pbs_text_name(out, (pbs_span){name, dot && dot > name ? dot : name + strlen(name)});
}
