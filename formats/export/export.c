/* export.c: from a file of points or voxels to PLY and GLB (export.h). */
#include "formats/export/export.h"
#include <float.h>
#include <math.h>

/* ---- before the first byte ---- */

typedef struct measuring {
    pbs_exporter *x;
    pbs_export_measures *m;
} measuring;

static pbs_code measure_block(void *ctx, const pbs_export_block *b, pbs_err *err) {
    const measuring *to = ctx;
    pbs_export_measures *m = to->m;
    for (size_t i = 0; i < b->count; i++) {
        const double *p = b->position[i];
        if (!isfinite(p[0]) || !isfinite(p[1]) || !isfinite(p[2]))
            return pbs_fail(err, PBS_DATA, "%s: a position is too large for a number", to->x->name);
        pbs_box_add(&m->box, p);
        for (int k = 0; k < 3 && m->exact; k++) m->exact = (double)(float)p[k] == p[k];
    }
    m->vertices += b->count;
    m->grain = fmin(m->grain, b->grain);
    *(b->voxels ? &m->voxels : &m->points) += b->records;
    if (b->voxels && to->x->o->faces) m->faces += b->count / 4;
    pbs_run_progress(to->x->run, "measuring", m->vertices, 0);
    return PBS_OK;
}

/* Floats will do if they move a point by so little that its lattice finds it again. */
static bool needs_doubles(const pbs_export_options *o, const pbs_export_measures *m) {
    double most = 0;
    if (o->positions != PBS_EXPORT_AUTO) return o->positions == PBS_EXPORT_DOUBLE;
    if (m->exact || !m->vertices) return false;
    for (int k = 0; k < 3; k++) most = fmax(most, fmax(fabs(m->box.min[k]), fabs(m->box.max[k])));
    return !(most <= FLT_MAX && most * 0x1p-24 <= m->grain / 8);
}

/* ---- all ---- */

static pbs_code write_all(pbs_exporter *x, const pbs_export_measures *m, pbs_exported *out,
                          pbs_err *err) {
    pbs_export_writer w = {.x = x, .m = m, .doubles = needs_doubles(x->o, m)};
    pbs_code rc =
        pbs_alloc(x->run, &w.bytes, PBS_EXPORT_ROOM, PBS_EXPORT_STRIDE, "a block of points", err);
    if (rc) return rc;
    rc = pbs_output_open(x->run, x->o->output, &w.out, err);
    if (!rc) {
        rc = x->o->format == PBS_EXPORT_PLY ? pbs_export_ply(&w, err) : pbs_export_glb(&w, err);
        if (!rc) rc = pbs_output_commit(&w.out, err);
        out->bytes = w.out.written;
        pbs_output_close(&w.out);
    }
    out->doubles = w.doubles && x->o->format == PBS_EXPORT_PLY;
    pbs_free(x->run, w.bytes);
    return rc;
}

pbs_code pbs_export(pbs_run *run, const pbs_export_options *o, pbs_exported *out, pbs_err *err) {
    pbs_exporter x = {.run = run, .o = o};
    pbs_export_measures m = {.box = PBS_BOX_EMPTY, .grain = INFINITY, .exact = true};
    *out = (pbs_exported){0};
    pbs_code rc = pbs_export_open(&x, err);
    if (!rc) rc = pbs_export_choose(&x, err);
    if (!rc) rc = pbs_export_fits(&x, err);
    if (!rc) rc = pbs_export_each(&x, measure_block, &(measuring){&x, &m}, err);
    if (!rc) rc = write_all(&x, &m, out, err);
    out->points = m.points, out->voxels = m.voxels, out->left_out = x.left_out;
    out->vertices = m.vertices, out->faces = m.faces, out->nodes = x.count;
    out->spacing = x.spacing;
    pbs_export_close(&x);
    return rc;
}
