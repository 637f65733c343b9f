/* gl.h: OpenGL without a GL library to link with.
 *
 * libEGL is opened when the first context is made and every function comes from
 * eglGetProcAddress, so the programs start and the other tools work on machines that have no GL.
 * Making a context and loading the functions are separate: a window brings a context of its own.
 *
 * Calls go through the table: gl->Clear(GL_COLOR_BUFFER_BIT). A table belongs to the thread in
 * which its context is current.
 *
 * With PBS_GL_DEBUG in the environment contexts are debug contexts: what the driver says about
 * errors and about calls whose result is undefined fails the next pbs_gl_check, with its words.
 */
#ifndef PBS_GL_H
#define PBS_GL_H

#include "libcore/ground/err.h"
#include <stdbool.h>
#include <stdint.h>

/* The prototypes are wanted for their types only; nothing here is linked. */
#define GL_GLEXT_PROTOTYPES 1
#include <GL/glcorearb.h>

/* clang-format off */
#define PBS_GL_FUNCTIONS(F) \
    /* state */ \
    F(Enable) F(Disable) F(GetError) F(GetString) F(GetStringi) F(GetIntegerv) F(GetInteger64v) \
    F(GetGraphicsResetStatus) F(Viewport) F(Scissor) F(ColorMask) F(ClipControl) F(PixelStorei) F(Finish) F(Flush) \
    F(PolygonMode) F(PolygonOffset) F(FrontFace) F(CullFace) F(PointSize) F(MemoryBarrier) \
    F(DebugMessageCallback) F(MinSampleShading) \
    F(DepthFunc) F(DepthMask) F(DepthRange) F(StencilFunc) F(StencilOp) F(StencilMask) \
    F(BlendFunc) F(BlendFunci) F(BlendFuncSeparate) F(BlendEquation) F(BlendEquationi) F(Enablei) \
    F(Disablei) \
    /* drawing */ \
    F(Clear) F(ClearColor) F(ClearDepth) F(ClearDepthf) \
    F(DrawArrays) F(DrawArraysInstanced) F(DrawArraysInstancedBaseInstance) F(DrawArraysIndirect) \
    F(MultiDrawArrays) F(MultiDrawArraysIndirect) F(DrawElements) F(DrawElementsBaseVertex) \
    F(DrawElementsInstanced) F(DrawElementsInstancedBaseVertexBaseInstance) \
    F(DrawElementsIndirect) F(MultiDrawElementsIndirect) F(DispatchCompute) \
    F(DispatchComputeIndirect) \
    /* buffers */ \
    F(CreateBuffers) F(DeleteBuffers) F(BindBuffer) F(BindBufferBase) F(BindBufferRange) \
    F(NamedBufferStorage) F(NamedBufferData) F(NamedBufferSubData) F(GetNamedBufferSubData) \
    F(GetNamedBufferParameteri64v) \
    F(MapNamedBuffer) F(MapNamedBufferRange) F(UnmapNamedBuffer) F(FlushMappedNamedBufferRange) \
    F(CopyNamedBufferSubData) F(ClearNamedBufferData) F(ClearNamedBufferSubData) \
    /* vertex arrays */ \
    F(CreateVertexArrays) F(DeleteVertexArrays) F(BindVertexArray) F(VertexArrayVertexBuffer) \
    F(VertexArrayElementBuffer) F(VertexArrayAttribFormat) F(VertexArrayAttribIFormat) \
    F(VertexArrayAttribBinding) F(VertexArrayBindingDivisor) F(EnableVertexArrayAttrib) \
    F(DisableVertexArrayAttrib) F(VertexAttrib4f) F(VertexAttribI4ui) \
    /* textures */ \
    F(CreateTextures) F(DeleteTextures) F(TextureStorage2D) F(TextureStorage2DMultisample) \
    F(TextureStorage3D) F(TextureSubImage2D) F(TextureSubImage3D) F(TextureParameteri) \
    F(TextureParameterf) F(GenerateTextureMipmap) F(BindTextureUnit) F(BindImageTexture) \
    F(GetTextureImage) F(ClearTexImage) F(TextureBuffer) \
    F(CreateSamplers) F(DeleteSamplers) F(SamplerParameteri) F(SamplerParameterf) F(BindSampler) \
    /* framebuffers */ \
    F(CreateFramebuffers) F(DeleteFramebuffers) F(BindFramebuffer) F(NamedFramebufferTexture) \
    F(NamedFramebufferTextureLayer) F(NamedFramebufferRenderbuffer) F(NamedFramebufferDrawBuffer) \
    F(NamedFramebufferDrawBuffers) F(NamedFramebufferReadBuffer) F(CheckNamedFramebufferStatus) \
    F(ClearNamedFramebufferfv) F(ClearNamedFramebufferiv) F(ClearNamedFramebufferuiv) \
    F(ClearNamedFramebufferfi) F(BlitNamedFramebuffer) F(ReadPixels) F(ReadBuffer) \
    F(CreateRenderbuffers) F(DeleteRenderbuffers) F(NamedRenderbufferStorage) \
    F(NamedRenderbufferStorageMultisample) \
    /* shaders */ \
    F(CreateShader) F(DeleteShader) F(ShaderSource) F(CompileShader) F(GetShaderiv) \
    F(GetShaderInfoLog) F(CreateProgram) F(DeleteProgram) F(AttachShader) F(DetachShader) \
    F(LinkProgram) F(GetProgramiv) F(GetProgramInfoLog) F(UseProgram) F(GetUniformLocation) \
    F(Uniform1i) F(Uniform2i) F(Uniform1ui) F(Uniform1f) F(Uniform2f) F(Uniform3f) F(Uniform4f) F(Uniform2fv) \
    F(Uniform3fv) F(Uniform4fv) F(Uniform2ui) F(Uniform3ui) F(Uniform4i) F(Uniform4ui) F(UniformMatrix3fv) \
    F(UniformMatrix4fv) F(UniformMatrix3x2fv) F(UniformMatrix3x4fv) F(UniformMatrix4x3fv) \
    /* queries and fences */ \
    F(CreateQueries) F(DeleteQueries) F(BeginQuery) F(EndQuery) F(QueryCounter) \
    F(GetQueryObjectiv) F(GetQueryObjectuiv) F(GetQueryObjectui64v) \
    F(FenceSync) F(ClientWaitSync) F(DeleteSync)
/* clang-format on */

typedef struct pbs_gl {
#define PBS_GL_MEMBER(name) __typeof__(&gl##name) name;
    PBS_GL_FUNCTIONS(PBS_GL_MEMBER)
#undef PBS_GL_MEMBER
    int version;         /* 45, 46 */
    bool software;       /* llvmpipe, softpipe or swrast */
    int max_samples;     /* of a colour or depth renderbuffer */
    int max_texture;     /* pixels along a side */
    int64_t max_storage; /* bytes of a storage buffer that one shader sees */
    char device[256];    /* "llvmpipe (LLVM 15.0.6, 256 bits), OpenGL 4.5" */
} pbs_gl;

typedef void (*pbs_gl_proc)(void);

/* Fills the table from a context that is current in this thread; get is its GetProcAddress.
 * Errors: PBS_IO if the context is older than OpenGL 4.5, or its vertex shaders see no storage
 * buffers, which is allowed. */
pbs_code pbs_gl_load(pbs_gl *gl, pbs_gl_proc (*get)(const char *name), pbs_err *err);

/* Whether PBS_GL_DEBUG is set and not empty: a window's context should be a debug context then. */
bool pbs_gl_debug(void);

/* A context without a window, by EGL. */
typedef struct pbs_gl_context pbs_gl_context;

/* device: NULL or "": a graphics card if there is one that works, else Mesa's software renderer;
 * "hw", "sw": that kind or an error; "0", "1", ...: that device of the machine's list, or an
 * error. The context is current in the calling thread afterwards and gl is filled. Errors:
 * PBS_USAGE for a device string of another form; PBS_IO. Free it in the same thread. */
pbs_code pbs_gl_context_new(const char *device, pbs_gl_context **out, pbs_gl *gl, pbs_err *err);
void pbs_gl_context_free(pbs_gl_context *context); /* NULL is fine */

/* A program of stages; the parts of a stage's source are concatenated. */
typedef struct pbs_gl_stage {
    GLenum stage;        /* GL_VERTEX_SHADER, ... */
    const char *part[5]; /* GLSL; "#version" stands in the first; unused ones NULL */
} pbs_gl_stage;

/* *program belongs to the caller: gl->DeleteProgram. name is for messages. Errors:
 * PBS_INTERNAL with the first lines of the driver's log. */
pbs_code pbs_gl_program(const pbs_gl *gl, const char *name, const pbs_gl_stage *stages, int count,
                        GLuint *program, pbs_err *err);

/* PBS_IO if the device was reset, taken away or has stopped since the context was made; nothing can
 * be drawn with it any more. */
pbs_code pbs_gl_lost(const pbs_gl *gl, pbs_err *err);
/* PBS_LIMIT for GL_OUT_OF_MEMORY, as pbs_gl_lost for GL_CONTEXT_LOST, PBS_INTERNAL for another GL
 * error since the last call, and in a debug context for what the driver has complained about. */
pbs_code pbs_gl_check(const pbs_gl *gl, const char *what, pbs_err *err);
#endif
