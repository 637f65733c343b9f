/* draw_batch.c: numbers of many nodes for one draw call, and the way of the host's records to the
 * GPU. */
#include "cmd/pbs-view/draw_internal.h"

pbs_code pbs_batch_begin(pbs_canvas *c, size_t nodes, size_t param_size, size_t command_size,
                         pbs_err *err) {
    batch *b = &c->batch;
    size_t params = nodes * param_size, commands = nodes * command_size;
    if (params > (size_t)c->gl->max_storage)
        return pbs_fail(err, PBS_LIMIT, "%zu nodes in one picture: too many for %s", nodes,
                        c->gl->device);
    pbs_code rc = pbs_grow(c->run, &b->param, &b->param_cap, params, 1, "the nodes drawn", err);
    if (!rc)
        rc = pbs_grow(c->run, &b->command, &b->command_cap, commands, 1, "the nodes drawn", err);
    if (rc) return rc;
    memset(b->param, 0, params);
    memset(b->command, 0, commands);
    return PBS_OK;
}

static pbs_code number_up_to(pbs_canvas *c, size_t nodes, pbs_err *err) {
    batch *b = &c->batch;
    uint32_t *n, count = 1024;
    if (nodes <= b->number_count) return PBS_OK;
    while (count < nodes) count *= 2;
    pbs_code rc = pbs_alloc(c->run, &n, count, sizeof *n, "the nodes drawn", err);
    if (rc) return rc;
    for (uint32_t i = 0; i < count; i++) n[i] = i;
    c->gl->NamedBufferData(b->numbers, (GLsizeiptr)(count * sizeof *n), n, GL_STATIC_DRAW);
    pbs_free(c->run, n);
    b->number_count = count;
    return PBS_OK;
}

pbs_code pbs_batch_send(pbs_canvas *c, size_t nodes, size_t param_size, size_t command_size,
                        GLuint array, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    batch *b = &c->batch;
    if (!b->params) {
        gl->CreateBuffers(1, &b->params);
        gl->CreateBuffers(1, &b->commands);
        gl->CreateBuffers(1, &b->numbers);
    }
    pbs_code rc = number_up_to(c, nodes, err);
    if (rc) return rc;
    gl->NamedBufferData(b->params, (GLsizeiptr)(nodes * param_size), b->param, GL_STREAM_DRAW);
    gl->NamedBufferData(b->commands, (GLsizeiptr)(nodes * command_size), b->command,
                        GL_STREAM_DRAW);
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 1, b->params);
    gl->BindBuffer(GL_DRAW_INDIRECT_BUFFER, b->commands);
    gl->BindVertexArray(array);
    gl->VertexArrayVertexBuffer(array, 0, b->numbers, 0, 4);
    gl->VertexArrayAttribIFormat(array, 0, 1, GL_UNSIGNED_INT, 0);
    gl->VertexArrayAttribBinding(array, 0, 0);
    gl->VertexArrayBindingDivisor(array, 0, 1u << 30);
    gl->EnableVertexArrayAttrib(array, 0);
    return PBS_OK;
}

void pbs_batch_free(pbs_canvas *c) {
    c->gl->DeleteBuffers(1, &c->batch.params);
    c->gl->DeleteBuffers(1, &c->batch.commands);
    c->gl->DeleteBuffers(1, &c->batch.numbers);
    pbs_free(c->run, c->batch.param);
    pbs_free(c->run, c->batch.command);
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
