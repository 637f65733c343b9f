/* gl.c: contexts by EGL, the function table, and programs from source. */
#include "cmd/pbs-view/draw/gl.h"
#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Functions of libEGL, all through eglGetProcAddress: EGL 1.5 promises it for core ones too. */
#define EGL_FUNCTIONS(F)                                                                           \
    F(PFNEGLGETERRORPROC, GetError)                                                                \
    F(PFNEGLQUERYSTRINGPROC, QueryString)                                                          \
    F(PFNEGLINITIALIZEPROC, Initialize)                                                            \
    F(PFNEGLTERMINATEPROC, Terminate)                                                              \
    F(PFNEGLGETDISPLAYPROC, GetDisplay)                                                            \
    F(PFNEGLBINDAPIPROC, BindAPI)                                                                  \
    F(PFNEGLCHOOSECONFIGPROC, ChooseConfig)                                                        \
    F(PFNEGLCREATECONTEXTPROC, CreateContext)                                                      \
    F(PFNEGLDESTROYCONTEXTPROC, DestroyContext)                                                    \
    F(PFNEGLMAKECURRENTPROC, MakeCurrent)                                                          \
    F(PFNEGLRELEASETHREADPROC, ReleaseThread)

typedef struct egl {
#define MEMBER(type, name) type name;
    EGL_FUNCTIONS(MEMBER)
#undef MEMBER
    PFNEGLGETPROCADDRESSPROC GetProcAddress;
    /* extensions, NULL where missing */
    PFNEGLQUERYDEVICESEXTPROC QueryDevices;
    PFNEGLQUERYDEVICESTRINGEXTPROC QueryDeviceString;
    PFNEGLGETPLATFORMDISPLAYEXTPROC GetPlatformDisplay;
} egl;

struct pbs_gl_context {
    egl egl;
    EGLDisplay display;
    EGLContext context;
};

enum { MAX_DEVICES = 32, VERTEX_BLOCKS = 4 };

/* What the user asked for. */
typedef struct wish {
    bool hardware, software; /* kinds that will do */
    int index;               /* or -1 */
} wish;

static pbs_code parse_device(const char *device, wish *out, pbs_err *err) {
    *out = (wish){true, true, -1};
    if (!device || !*device) return PBS_OK;
    if (strcmp(device, "hw") == 0) {
        out->software = false;
    } else if (strcmp(device, "sw") == 0) {
        out->hardware = false;
    } else {
        char *end;
        long n = strtol(device, &end, 10);
        if (*end || n < 0 || n >= MAX_DEVICES || *device < '0' || *device > '9')
            return pbs_fail(err, PBS_USAGE, "device %s: one of hw, sw or a number", device);
        out->index = (int)n;
    }
    return PBS_OK;
}

/* libEGL stays open: drivers keep threads and thread-local data, and do not survive dlclose. */
static pbs_code open_egl(egl *e, pbs_err *err) {
    void *lib = dlopen("libEGL.so.1", RTLD_NOW | RTLD_LOCAL);
    if (!lib)
        return pbs_fail(err, PBS_IO,
                        "OpenGL: %s (Debian: apt install libegl1 libegl-mesa0 libgl1-mesa-dri)",
                        dlerror());
    void *get = dlsym(lib, "eglGetProcAddress");
    if (!get) return pbs_fail(err, PBS_IO, "OpenGL: libEGL.so.1 has no eglGetProcAddress");
    memcpy(&e->GetProcAddress, &get, sizeof get);
#define LOAD(type, name)                                                                           \
    if (!(e->name = (type)e->GetProcAddress("egl" #name)))                                         \
        return pbs_fail(err, PBS_IO, "OpenGL: libEGL.so.1 is too old: no egl" #name);
    EGL_FUNCTIONS(LOAD)
#undef LOAD
    e->QueryDevices = (PFNEGLQUERYDEVICESEXTPROC)e->GetProcAddress("eglQueryDevicesEXT");
    e->QueryDeviceString =
        (PFNEGLQUERYDEVICESTRINGEXTPROC)e->GetProcAddress("eglQueryDeviceStringEXT");
    e->GetPlatformDisplay =
        (PFNEGLGETPLATFORMDISPLAYEXTPROC)e->GetProcAddress("eglGetPlatformDisplayEXT");
    return PBS_OK;
}

static bool has(const char *list, const char *word) {
    return list && strstr(list, word);
}

bool pbs_gl_debug(void) {
    const char *value = getenv("PBS_GL_DEBUG");
    return value && *value;
}

/* robust: a device that is reset says so, and calls do nothing then, instead of ending the
 * program. */
static EGLContext create_context(const egl *e, EGLDisplay display, int minor, bool robust) {
    EGLint attributes[16] = {EGL_CONTEXT_MAJOR_VERSION,       4,
                             EGL_CONTEXT_MINOR_VERSION,       minor,
                             EGL_CONTEXT_OPENGL_PROFILE_MASK, EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT};
    int n = 6;
    /* Both are of EGL 1.5; an older one refuses what it does not know. */
    if (robust) attributes[n++] = EGL_CONTEXT_OPENGL_RESET_NOTIFICATION_STRATEGY;
    if (robust) attributes[n++] = EGL_LOSE_CONTEXT_ON_RESET;
    if (pbs_gl_debug()) attributes[n++] = EGL_CONTEXT_OPENGL_DEBUG;
    if (pbs_gl_debug()) attributes[n++] = EGL_TRUE;
    attributes[n] = EGL_NONE;
    const EGLint wanted[] = {EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT, EGL_SURFACE_TYPE, 0, EGL_NONE};
    EGLConfig config = EGL_NO_CONFIG_KHR;
    EGLint configs = 0;
    if (!has(e->QueryString(display, EGL_EXTENSIONS), "EGL_KHR_no_config_context"))
        if (!e->ChooseConfig(display, wanted, &config, 1, &configs) || configs < 1)
            return EGL_NO_CONTEXT;
    return e->CreateContext(display, config, EGL_NO_CONTEXT, attributes);
}

static bool is_software(const char *renderer) {
    return has(renderer, "llvmpipe") || has(renderer, "softpipe") || has(renderer, "swrast");
}

/* Makes a 4.6 or 4.5 context current on this display; gives the display back if it can't, or if
 * the renderer is of a kind that nobody asked for (a DRM device can hide a software one). */
static bool try_display(pbs_gl_context *c, EGLDisplay display, bool hardware, bool software) {
    const egl *e = &c->egl;
    if (!display || !e->Initialize(display, NULL, NULL)) return false;
    EGLContext context = EGL_NO_CONTEXT;
    if (e->BindAPI(EGL_OPENGL_API) &&
        has(e->QueryString(display, EGL_EXTENSIONS), "EGL_KHR_surfaceless_context"))
        for (int attempt = 0; attempt < 4 && context == EGL_NO_CONTEXT; attempt++)
            context = create_context(e, display, attempt % 2 ? 5 : 6, attempt < 2);
    if (context != EGL_NO_CONTEXT &&
        e->MakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context)) {
        PFNGLGETSTRINGPROC string = (PFNGLGETSTRINGPROC)e->GetProcAddress("glGetString");
        const char *renderer = string ? (const char *)string(GL_RENDERER) : "";
        if (is_software(renderer) ? software : hardware) {
            c->display = display, c->context = context;
            return true;
        }
        e->MakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    }
    if (context != EGL_NO_CONTEXT) e->DestroyContext(display, context);
    e->Terminate(display);
    return false;
}

static bool try_devices(pbs_gl_context *c, const wish *w, int *seen) {
    const egl *e = &c->egl;
    const char *client = e->QueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
    EGLDeviceEXT device[MAX_DEVICES];
    EGLint n = 0;
    /* NVIDIA alone names only device_base (NVIDIA/egl-wayland issue 191). */
    if (!has(client, "EGL_EXT_device_base") && !has(client, "EGL_EXT_device_enumeration"))
        return false;
    if (!e->QueryDevices || !e->QueryDeviceString || !e->GetPlatformDisplay ||
        !e->QueryDevices(MAX_DEVICES, device, &n))
        return false;
    *seen = n;
    for (int pass = 0; pass < 2; pass++)
        for (int i = 0; i < n; i++) {
            bool soft =
                has(e->QueryDeviceString(device[i], EGL_EXTENSIONS), "EGL_MESA_device_software");
            if (soft != (pass == 1) || (w->index >= 0 && i != w->index)) continue;
            EGLDisplay d = e->GetPlatformDisplay(EGL_PLATFORM_DEVICE_EXT, device[i], NULL);
            if (soft ? !w->software : !w->hardware) continue;
            if (try_display(c, d, w->hardware, w->software && (soft || w->index >= 0))) return true;
        }
    return false;
}

static bool try_platforms(pbs_gl_context *c, const wish *w) {
    const egl *e = &c->egl;
    if (e->GetPlatformDisplay &&
        has(e->QueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS), "EGL_MESA_platform_surfaceless") &&
        try_display(c,
                    e->GetPlatformDisplay(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, NULL),
                    w->hardware, w->software))
        return true;
    return try_display(c, e->GetDisplay(EGL_DEFAULT_DISPLAY), w->hardware, w->software);
}

static pbs_code open_device(pbs_gl_context *c, const wish *w, pbs_err *err) {
    int seen = 0;
    if (try_devices(c, w, &seen)) return PBS_OK;
    if (w->index >= 0)
        return pbs_fail(err, PBS_IO,
                        w->index < seen ? "OpenGL: device %d gives no OpenGL 4.5 context"
                                        : "OpenGL: there is no device %d",
                        w->index);
    if (try_platforms(c, w)) return PBS_OK;
    return pbs_fail(err, PBS_IO, "OpenGL: no %sdevice gives an OpenGL 4.5 context%s",
                    w->software ? (w->hardware ? "" : "software ") : "hardware ",
                    w->software ? " (Debian: apt install libgl1-mesa-dri)" : "");
}

/* eglGetProcAddress of the library that is open; pbs_gl_load takes a plain function. */
static _Thread_local PFNEGLGETPROCADDRESSPROC current_get;
static pbs_gl_proc get_by_egl(const char *name) {
    return current_get(name);
}

pbs_code pbs_gl_context_new(const char *device, pbs_gl_context **out, pbs_gl *gl, pbs_err *err) {
    wish w;
    *out = NULL;
    pbs_code code = parse_device(device, &w, err);
    if (code) return code;
    pbs_gl_context *c = calloc(1, sizeof *c);
    if (!c) return pbs_fail_errno(err, "OpenGL");
    code = open_egl(&c->egl, err);
    if (!code) code = open_device(c, &w, err);
    if (!code) {
        current_get = c->egl.GetProcAddress;
        code = pbs_gl_load(gl, get_by_egl, err);
    }
    if (code)
        pbs_gl_context_free(c);
    else
        *out = c;
    return code;
}

void pbs_gl_context_free(pbs_gl_context *c) {
    if (!c) return;
    if (c->context) {
        c->egl.MakeCurrent(c->display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
        c->egl.DestroyContext(c->display, c->context);
        /* The display stays: terminated, Mesa unloads its driver with what it has left lying
         * about, and leak checkers can't tell any more whose it is. The next context uses it. */
        c->egl.ReleaseThread();
    }
    free(c);
}

/* ---- what the driver complains about ---- */

/* Of the context that is current in this thread; the first one stays until it is asked for. */
static _Thread_local char complaint[400];

static void APIENTRY on_message(GLenum source, GLenum type, GLuint id, GLenum severity,
                                GLsizei length, const GLchar *text, const void *ctx) {
    (void)source, (void)id, (void)severity, (void)length, (void)ctx;
    bool wrong = type == GL_DEBUG_TYPE_ERROR || type == GL_DEBUG_TYPE_UNDEFINED_BEHAVIOR ||
                 type == GL_DEBUG_TYPE_DEPRECATED_BEHAVIOR || type == GL_DEBUG_TYPE_PORTABILITY;
    if (wrong && !complaint[0]) snprintf(complaint, sizeof complaint, "%s", text);
}

/* In a context that is none for debugging a driver need not say anything. */
static void listen(const pbs_gl *gl) {
    complaint[0] = 0;
    if (!pbs_gl_debug()) return;
    gl->Enable(GL_DEBUG_OUTPUT);
    gl->Enable(GL_DEBUG_OUTPUT_SYNCHRONOUS);
    gl->DebugMessageCallback(on_message, NULL);
}

static pbs_code complained(const char *what, pbs_err *err) {
    if (!complaint[0]) return PBS_OK;
    pbs_fail(err, PBS_INTERNAL, "OpenGL: %s: %s", what, complaint);
    complaint[0] = 0;
    return PBS_INTERNAL;
}

/* Of the largest program of each stage; OpenGL promises vertex shaders none. */
static pbs_code check_limits(const pbs_gl *gl, pbs_err *err) {
    GLint blocks = 0;
    gl->GetIntegerv(GL_MAX_VERTEX_SHADER_STORAGE_BLOCKS, &blocks);
    if (blocks >= VERTEX_BLOCKS) return PBS_OK;
    return pbs_fail(err, PBS_IO,
                    "OpenGL: vertex shaders of %s see %d storage buffers: %d are needed",
                    gl->device, blocks, VERTEX_BLOCKS);
}

pbs_code pbs_gl_load(pbs_gl *gl, pbs_gl_proc (*get)(const char *name), pbs_err *err) {
    GLint major = 0, minor = 0;
    memset(gl, 0, sizeof *gl);
    gl->GetIntegerv = (PFNGLGETINTEGERVPROC)get("glGetIntegerv");
    if (gl->GetIntegerv) {
        gl->GetIntegerv(GL_MAJOR_VERSION, &major);
        gl->GetIntegerv(GL_MINOR_VERSION, &minor);
    }
    gl->version = 10 * major + minor;
    if (gl->version < 45)
        return pbs_fail(err, PBS_IO, "OpenGL: 4.5 is needed, this is %d.%d", major, minor);
#define LOAD(name)                                                                                 \
    if (!(gl->name = (__typeof__(gl->name))get("gl" #name)))                                       \
        return pbs_fail(err, PBS_IO, "OpenGL: the driver has no gl" #name);
    PBS_GL_FUNCTIONS(LOAD)
#undef LOAD
    const char *renderer = (const char *)gl->GetString(GL_RENDERER);
    gl->software = is_software(renderer);
    snprintf(gl->device, sizeof gl->device, "%s, OpenGL %d.%d", renderer ? renderer : "?", major,
             minor);
    GLint64 storage = 0;
    gl->GetIntegerv(GL_MAX_SAMPLES, &gl->max_samples);
    gl->GetIntegerv(GL_MAX_TEXTURE_SIZE, &gl->max_texture);
    gl->GetInteger64v(GL_MAX_SHADER_STORAGE_BLOCK_SIZE, &storage);
    gl->max_storage = storage;
    listen(gl);
    pbs_code rc = check_limits(gl, err);
    return rc ? rc : pbs_gl_check(gl, "context", err);
}

static pbs_code add_stage(const pbs_gl *gl, const char *name, const pbs_gl_stage *stage,
                          GLuint program, pbs_err *err) {
    int parts = 0;
    while (parts < 5 && stage->part[parts]) parts++;
    GLuint shader = gl->CreateShader(stage->stage);
    gl->ShaderSource(shader, parts, stage->part, NULL);
    gl->CompileShader(shader);
    GLint ok = 0;
    gl->GetShaderiv(shader, GL_COMPILE_STATUS, &ok);
    if (ok) {
        gl->AttachShader(program, shader);
    } else {
        char log[800] = "";
        gl->GetShaderInfoLog(shader, sizeof log, NULL, log);
        pbs_fail(err, PBS_INTERNAL, "shader %s: %s", name, log);
    }
    /* An attached shader lives on until its program goes. */
    gl->DeleteShader(shader);
    return ok ? PBS_OK : PBS_INTERNAL;
}

pbs_code pbs_gl_program(const pbs_gl *gl, const char *name, const pbs_gl_stage *stages, int count,
                        GLuint *program, pbs_err *err) {
    GLuint p = gl->CreateProgram();
    pbs_code code = PBS_OK;
    *program = 0;
    for (int i = 0; i < count && !code; i++) code = add_stage(gl, name, &stages[i], p, err);
    if (!code) {
        GLint ok = 0;
        gl->LinkProgram(p);
        gl->GetProgramiv(p, GL_LINK_STATUS, &ok);
        if (!ok) {
            char log[800] = "";
            gl->GetProgramInfoLog(p, sizeof log, NULL, log);
            code = pbs_fail(err, PBS_INTERNAL, "program %s: %s", name, log);
        }
    }
    if (code)
        gl->DeleteProgram(p);
    else
        *program = p;
    return code;
}

static pbs_code device_lost(const pbs_gl *gl, GLenum why, pbs_err *err) {
    return pbs_fail(err, PBS_IO, "OpenGL: the device was lost (%s): %s",
                    why == GL_GUILTY_CONTEXT_RESET     ? "it was reset because of this program"
                    : why == GL_INNOCENT_CONTEXT_RESET ? "it was reset because of another program"
                                                       : "it was reset or taken away",
                    gl->device);
}

pbs_code pbs_gl_lost(const pbs_gl *gl, pbs_err *err) {
    GLenum why = gl->GetGraphicsResetStatus();
    return why == GL_NO_ERROR ? PBS_OK : device_lost(gl, why, err);
}

pbs_code pbs_gl_check(const pbs_gl *gl, const char *what, pbs_err *err) {
    GLenum first = gl->GetError();
    if (first == GL_NO_ERROR) return complained(what, err);
    /* A lost context reports errors for ever. */
    for (int i = 0; i < 16 && gl->GetError() != GL_NO_ERROR; i++) continue;
    if (first == GL_CONTEXT_LOST) return device_lost(gl, gl->GetGraphicsResetStatus(), err);
    if (first == GL_OUT_OF_MEMORY)
        return pbs_fail(err, PBS_LIMIT, "OpenGL: %s: out of memory", what);
    if (complaint[0]) return complained(what, err);
    return pbs_fail(err, PBS_INTERNAL, "OpenGL: %s: error 0x%04x", what, first);
}
