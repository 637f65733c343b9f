/* count.c: functions of the driver's signatures that count and call the driver's. */
#include "cmd/pbs-view/draw/count.h"

/* The driver's functions take no context of ours. */
static _Thread_local pbs_gl driver;
static _Thread_local pbs_counts counts;

/* name, parameters, arguments, what is counted */
/* clang-format off */
#define COUNTED(F) \
    F(DrawArrays, (GLenum mode, GLint first, GLsizei n), (mode, first, n), counts.draws++) \
    F(DrawArraysInstanced, (GLenum mode, GLint first, GLsizei n, GLsizei instances), \
      (mode, first, n, instances), counts.draws++) \
    F(DrawArraysInstancedBaseInstance, \
      (GLenum mode, GLint first, GLsizei n, GLsizei instances, GLuint base), \
      (mode, first, n, instances, base), counts.draws++) \
    F(DrawArraysIndirect, (GLenum mode, const void *at), (mode, at), counts.draws++) \
    F(MultiDrawArrays, (GLenum mode, const GLint *first, const GLsizei *n, GLsizei draws), \
      (mode, first, n, draws), counts.draws++) \
    F(MultiDrawArraysIndirect, (GLenum mode, const void *at, GLsizei draws, GLsizei stride), \
      (mode, at, draws, stride), counts.draws++) \
    F(DrawElements, (GLenum mode, GLsizei n, GLenum type, const void *at), (mode, n, type, at), \
      counts.draws++) \
    F(DrawElementsBaseVertex, (GLenum mode, GLsizei n, GLenum type, const void *at, GLint base), \
      (mode, n, type, at, base), counts.draws++) \
    F(DrawElementsInstanced, \
      (GLenum mode, GLsizei n, GLenum type, const void *at, GLsizei instances), \
      (mode, n, type, at, instances), counts.draws++) \
    F(DrawElementsInstancedBaseVertexBaseInstance, \
      (GLenum mode, GLsizei n, GLenum type, const void *at, GLsizei instances, GLint vertex, \
       GLuint base), \
      (mode, n, type, at, instances, vertex, base), counts.draws++) \
    F(DrawElementsIndirect, (GLenum mode, GLenum type, const void *at), (mode, type, at), \
      counts.draws++) \
    F(MultiDrawElementsIndirect, \
      (GLenum mode, GLenum type, const void *at, GLsizei draws, GLsizei stride), \
      (mode, type, at, draws, stride), counts.draws++) \
    F(DispatchCompute, (GLuint x, GLuint y, GLuint z), (x, y, z), counts.dispatches++) \
    F(DispatchComputeIndirect, (GLintptr at), (at), counts.dispatches++) \
    F(NamedBufferStorage, (GLuint buffer, GLsizeiptr size, const void *data, GLbitfield flags), \
      (buffer, size, data, flags), counts.bytes += data ? (uint64_t)size : 0) \
    F(NamedBufferData, (GLuint buffer, GLsizeiptr size, const void *data, GLenum usage), \
      (buffer, size, data, usage), counts.bytes += data ? (uint64_t)size : 0) \
    F(NamedBufferSubData, (GLuint buffer, GLintptr at, GLsizeiptr size, const void *data), \
      (buffer, at, size, data), counts.bytes += (uint64_t)size) \
    F(FlushMappedNamedBufferRange, (GLuint buffer, GLintptr at, GLsizeiptr size), \
      (buffer, at, size), counts.bytes += (uint64_t)size) \
    F(TextureSubImage2D, (GLuint texture, GLint level, GLint x, GLint y, GLsizei width, \
      GLsizei height, GLenum format, GLenum type, const void *data), \
      (texture, level, x, y, width, height, format, type, data), \
      counts.bytes += (uint64_t)width * (uint64_t)height * pixel_bytes(format, type)) \
    F(TextureSubImage3D, (GLuint texture, GLint level, GLint x, GLint y, GLint z, GLsizei width, \
      GLsizei height, GLsizei depth, GLenum format, GLenum type, const void *data), \
      (texture, level, x, y, z, width, height, depth, format, type, data), \
      counts.bytes += (uint64_t)width * (uint64_t)height * (uint64_t)depth * \
                      pixel_bytes(format, type))
/* clang-format on */

static uint64_t pixel_bytes(GLenum format, GLenum type) {
    uint64_t channels = 4, size = 1;
    if (format == GL_RED || format == GL_RED_INTEGER) channels = 1;
    if (format == GL_RG || format == GL_RG_INTEGER) channels = 2;
    if (format == GL_RGB || format == GL_RGB_INTEGER) channels = 3;
    if (type == GL_UNSIGNED_SHORT || type == GL_SHORT || type == GL_HALF_FLOAT) size = 2;
    if (type == GL_UNSIGNED_INT || type == GL_INT || type == GL_FLOAT) size = 4;
    return channels * size;
}

#define DEFINE(name, parameters, arguments, counting)                                              \
    static void APIENTRY count_##name parameters {                                                 \
        counting;                                                                                  \
        driver.name arguments;                                                                     \
    }
COUNTED(DEFINE)
#undef DEFINE

void pbs_count_open(pbs_gl *gl) {
    driver = *gl;
    counts = (pbs_counts){0};
#define REPLACE(name, parameters, arguments, counting) gl->name = count_##name;
    COUNTED(REPLACE)
#undef REPLACE
}

pbs_counts pbs_count_take(void) {
    pbs_counts c = counts;
    counts = (pbs_counts){0};
    return c;
}
