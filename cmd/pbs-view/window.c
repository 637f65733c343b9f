#include "cmd/pbs-view/window.h"
#include <dlfcn.h>
#include <stdio.h>
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

/* clang-format off */
#define GLFW_FUNCTIONS(F) \
    F(Init) F(Terminate) F(GetError) F(WindowHint) F(CreateWindow) F(DestroyWindow) \
    F(MakeContextCurrent) F(GetProcAddress) F(SwapBuffers) F(SwapInterval) F(WaitEventsTimeout) \
    F(WindowShouldClose) F(SetWindowShouldClose) F(GetFramebufferSize) F(GetWindowSize) \
    F(SetWindowTitle) F(SetCursorPosCallback) F(SetScrollCallback) F(SetKeyCallback) \
    F(SetFramebufferSizeCallback) F(SetWindowRefreshCallback) F(GetMouseButton) F(GetKey)
/* clang-format on */

typedef struct glfw {
#define MEMBER(name) __typeof__(&glfw##name) name;
    GLFW_FUNCTIONS(MEMBER)
#undef MEMBER
} glfw;

typedef struct window {
    glfw f;
    GLFWwindow *w;
    pbs_gl gl;
    pbs_show *show;
    pbs_canvas *canvas;
    pbs_camera camera;
    const char *title;
    double surfel_size, x, y; /* where the mouse was */
    uint32_t width, height;   /* of the canvas */
    bool stale;               /* the picture is not what the window shows */
} window;

static pbs_code load_glfw(glfw *f, pbs_err *err) {
    void *lib = dlopen("libglfw.so.3", RTLD_NOW | RTLD_LOCAL);
    if (!lib)
        return pbs_fail(err, PBS_IO,
                        "no window: GLFW (libglfw3) is not installed; --shot needs none");
#define LOAD(name)                                                                                 \
    *(void **)&f->name = dlsym(lib, "glfw" #name);                                                 \
    if (!f->name) return pbs_fail(err, PBS_IO, "GLFW is too old: no glfw" #name);
    GLFW_FUNCTIONS(LOAD)
#undef LOAD
    return PBS_OK;
}

static pbs_code glfw_error(const glfw *f, const char *what, pbs_err *err) {
    const char *text = NULL;
    f->GetError(&text);
    return pbs_fail(err, PBS_IO, "%s: %s; --shot FILE needs no display", what,
                    text ? text : "failed");
}

/* ---- input: every change makes the picture stale ---- */

/* GLFW's own pointer from a window to its user could only be asked for through the table that it
 * leads to. There is one window. */
static window *the_window;

static window *of(GLFWwindow *w) {
    (void)w;
    return the_window;
}

static void on_move(GLFWwindow *w, double x, double y) {
    window *s = of(w);
    int width, height;
    s->f.GetWindowSize(w, &width, &height);
    double dx = (x - s->x) / (height > 0 ? height : 1), dy = (y - s->y) / (height > 0 ? height : 1);
    s->x = x, s->y = y;
    bool left = s->f.GetMouseButton(w, GLFW_MOUSE_BUTTON_LEFT) == GLFW_PRESS;
    bool other = s->f.GetMouseButton(w, GLFW_MOUSE_BUTTON_RIGHT) == GLFW_PRESS ||
                 s->f.GetMouseButton(w, GLFW_MOUSE_BUTTON_MIDDLE) == GLFW_PRESS;
    bool shift = s->f.GetKey(w, GLFW_KEY_LEFT_SHIFT) == GLFW_PRESS;
    if (other || (left && shift))
        pbs_camera_pan(&s->camera, dx, dy);
    else if (left)
        pbs_camera_orbit(&s->camera, dx, dy);
    s->stale = s->stale || left || other;
}

static void on_scroll(GLFWwindow *w, double dx, double dy) {
    window *s = of(w);
    (void)dx;
    pbs_camera_dolly(&s->camera, dy);
    s->stale = true;
}

static void on_key(GLFWwindow *w, int key, int code, int action, int mods) {
    window *s = of(w);
    (void)code, (void)mods;
    if (action == GLFW_RELEASE) return;
    double size = s->surfel_size;
    switch (key) {
    case GLFW_KEY_ESCAPE:
    case GLFW_KEY_Q:
        s->f.SetWindowShouldClose(w, GLFW_TRUE);
        break;
    case GLFW_KEY_HOME:
    case GLFW_KEY_R:
        s->camera = s->show->camera;
        break;
    case GLFW_KEY_RIGHT_BRACKET:
        s->surfel_size = size < 32 ? size * 1.25 : size;
        break;
    case GLFW_KEY_LEFT_BRACKET:
        s->surfel_size = size > 0.5 ? size / 1.25 : size;
        break;
    case GLFW_KEY_LEFT:
        pbs_camera_orbit(&s->camera, 0.02, 0);
        break;
    case GLFW_KEY_RIGHT:
        pbs_camera_orbit(&s->camera, -0.02, 0);
        break;
    case GLFW_KEY_UP:
        pbs_camera_orbit(&s->camera, 0, 0.02);
        break;
    case GLFW_KEY_DOWN:
        pbs_camera_orbit(&s->camera, 0, -0.02);
        break;
    case GLFW_KEY_PAGE_UP:
        pbs_camera_dolly(&s->camera, 1);
        break;
    case GLFW_KEY_PAGE_DOWN:
        pbs_camera_dolly(&s->camera, -1);
        break;
    default:
        return;
    }
    s->stale = true;
}

static void on_resize(GLFWwindow *w, int width, int height) {
    (void)width, (void)height;
    of(w)->stale = true;
}
static void on_refresh(GLFWwindow *w) {
    of(w)->stale = true;
}

/* ---- drawing ---- */

static pbs_code fit_canvas(window *s, pbs_err *err) {
    int width, height;
    s->f.GetFramebufferSize(s->w, &width, &height);
    if (width < 1 || height < 1) return PBS_OK; /* minimised */
    if (s->canvas && (uint32_t)width == s->width && (uint32_t)height == s->height) return PBS_OK;
    pbs_canvas_free(s->canvas);
    s->canvas = NULL;
    s->width = (uint32_t)width;
    s->height = (uint32_t)height;
    pbs_canvas_desc d = {s->width, s->height, (int)s->show->options->samples};
    return pbs_canvas_new(s->show->run, &s->gl, &d, &s->canvas, err);
}

static pbs_code draw(window *s, pbs_err *err) {
    char text[300];
    pbs_code rc = fit_canvas(s, err);
    s->stale = false;
    if (rc || !s->canvas) return rc;
    pbs_show_view v = {s->camera, s->width, s->height, s->surfel_size};
    rc = pbs_show_draw(s->show, s->canvas, &v, err);
    if (!rc) rc = pbs_canvas_present(s->canvas, err);
    if (rc) return rc;
    s->stale = s->show->unfinished;
    snprintf(text, sizeof text,
             "%s: %llu nodes, %llu surfels, %llu voxels, %llu triangles, surfel size %.2g px",
             s->title, (unsigned long long)s->show->drawn_nodes,
             (unsigned long long)s->show->drawn_surfels, (unsigned long long)s->show->drawn_voxels,
             (unsigned long long)s->show->drawn_triangles, s->surfel_size);
    s->f.SetWindowTitle(s->w, text);
    s->f.SwapBuffers(s->w);
    return PBS_OK;
}

static pbs_code open_window(window *s, pbs_err *err) {
    const pbs_show_options *o = s->show->options;
    if (!s->f.Init()) return glfw_error(&s->f, "no window", err);
    s->f.WindowHint(GLFW_CONTEXT_VERSION_MAJOR, 4);
    s->f.WindowHint(GLFW_CONTEXT_VERSION_MINOR, 5);
    s->f.WindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    s->w = s->f.CreateWindow((int)o->width, (int)o->height, s->title, NULL, NULL);
    if (!s->w) return glfw_error(&s->f, "no window with OpenGL 4.5", err);
    s->f.MakeContextCurrent(s->w);
    s->f.SwapInterval(1);
    s->f.SetCursorPosCallback(s->w, on_move);
    s->f.SetScrollCallback(s->w, on_scroll);
    s->f.SetKeyCallback(s->w, on_key);
    s->f.SetFramebufferSizeCallback(s->w, on_resize);
    s->f.SetWindowRefreshCallback(s->w, on_refresh);
    return pbs_gl_load(&s->gl, s->f.GetProcAddress, err);
}

pbs_code pbs_window_run(pbs_show *show, const char *title, pbs_err *err) {
    window s = {.show = show,
                .title = title,
                .camera = show->camera,
                .surfel_size = show->options->surfel_size,
                .stale = true};
    the_window = &s;
    pbs_code rc = load_glfw(&s.f, err);
    if (rc) return rc;
    rc = open_window(&s, err);
    while (!rc && !s.f.WindowShouldClose(s.w)) {
        if (s.stale) rc = draw(&s, err);
        if (!rc) s.f.WaitEventsTimeout(0.2); /* SIGTERM wakes nobody */
        if (!rc) rc = pbs_run_check(show->run, err);
    }
    pbs_canvas_free(s.canvas);
    if (s.w) s.f.DestroyWindow(s.w);
    s.f.Terminate();
    return rc;
}
