/* draw_batch.c: the numbers of many nodes, uploaded at once, and the way of the host's records to
 * the GPU. */
#include "cmd/pbs-view/draw/draw_internal.h"

pbs_code pbs_batch_begin(pbs_canvas *c, size_t nodes, pbs_err *err) {
    batch *b = &c->batch;
    pbs_code rc =
        pbs_grow(c->run, &b->blocks, &b->cap, nodes * PBS_BLOCK, 1, "the nodes drawn", err);
    if (!rc) memset(b->blocks, 0, nodes * PBS_BLOCK);
    return rc;
}

void pbs_batch_send(pbs_canvas *c, size_t nodes) {
    batch *b = &c->batch;
    if (!b->buffer) c->gl->CreateBuffers(1, &b->buffer);
    c->gl->NamedBufferData(b->buffer, (GLsizeiptr)(nodes * PBS_BLOCK), b->blocks, GL_STREAM_DRAW);
}

void pbs_batch_use(const pbs_canvas *c, size_t i) {
    c->gl->BindBufferRange(GL_UNIFORM_BUFFER, 0, c->batch.buffer, (GLintptr)(i * PBS_BLOCK),
                           PBS_BLOCK);
}

void pbs_batch_free(pbs_canvas *c) {
    c->gl->DeleteBuffers(1, &c->batch.buffer);
    pbs_free(c->run, c->batch.blocks);
}

pbs_code pbs_canvas_stream(pbs_canvas *c, const void *const *piece, const size_t *size, int pieces,
                           pbs_err *err) {
    size_t all = 0, at = 0;
    for (int i = 0; i < pieces; i++) all += size[i];
    if (all > (size_t)c->gl->max_storage)
        return pbs_fail(err, PBS_LIMIT, "a node of %zu bytes: too large for %s", all,
                        c->gl->device);
    c->gl->NamedBufferData(c->stream, (GLsizeiptr)(all ? all : 4), NULL, GL_STREAM_DRAW);
    for (int i = 0; i < pieces; i++) {
        if (size[i])
            c->gl->NamedBufferSubData(c->stream, (GLintptr)at, (GLsizeiptr)size[i], piece[i]);
        at += size[i];
    }
    return PBS_OK;
}

/* ---- matrices ---- */

void pbs_canvas_matrix(const pbs_gl *gl, GLint place, int columns, const double *m, double scale) {
    float f[12];
    for (int i = 0; i < 3 * columns; i++) f[i] = (float)(m[i] * scale);
    if (columns == 4)
        gl->UniformMatrix4x3fv(place, 1, GL_TRUE, f);
    else
        gl->UniformMatrix3fv(place, 1, GL_TRUE, f);
}

/* Cofactors of the linear part, scaled so that the largest is 1: float holds no squares of
 * 10^-30. */
static void normal_matrix(double out[9], const double m[12]) {
    double unit[12], largest = 0;
    for (int i = 0; i < 12; i++)
        if (i % 4 < 3) largest = fmax(largest, fabs(m[i]));
    for (int i = 0; i < 12; i++) unit[i] = largest > 0 ? m[i] / largest : m[i];
    pbs_xform_cofactor(out, unit);
    largest = 0;
    for (int i = 0; i < 9; i++) largest = fmax(largest, fabs(out[i]));
    for (int i = 0; i < 9 && largest > 0; i++) out[i] /= largest;
}

void pbs_canvas_normal_matrix(const pbs_gl *gl, GLint place, const double m[12]) {
    double cofactor[9];
    normal_matrix(cofactor, m);
    pbs_canvas_matrix(gl, place, 3, cofactor, 1);
}

void pbs_rows(float out[3][4], const double m[12], double scale) {
    for (int i = 0; i < 12; i++) out[i / 4][i % 4] = (float)(m[i] * scale);
}

void pbs_normal_rows(float out[3][4], const double m[12]) {
    double cofactor[9];
    normal_matrix(cofactor, m);
    for (int i = 0; i < 9; i++) out[i / 3][i % 3] = (float)cofactor[i];
}
