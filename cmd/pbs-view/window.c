/* window.c: the window's life: opening, what is drawn when, closing. Input is in input.c. */
#include "cmd/pbs-view/window.h"
#include "cmd/pbs-view/draw/draw_text.h"
#include "cmd/pbs-view/input.h"
#include <dlfcn.h>
#include <stdio.h>
#include <unistd.h>

static pbs_code load_glfw(pbs_glfw *f, pbs_err *err) {
    void *lib = dlopen("libglfw.so.3", RTLD_NOW | RTLD_LOCAL);
    if (!lib)
        return pbs_fail(err, PBS_IO,
                        "no window: GLFW (libglfw3) is not installed; --shot needs none");
#define LOAD(name)                                                                                 \
    *(void **)&f->name = dlsym(lib, "glfw" #name);                                                 \
    if (!f->name) return pbs_fail(err, PBS_IO, "GLFW is too old: no glfw" #name);
    PBS_GLFW_FUNCTIONS(LOAD)
#undef LOAD
    return PBS_OK;
}

static pbs_code glfw_error(const pbs_glfw *f, const char *what, pbs_err *err) {
    const char *text = NULL;
    f->GetError(&text);
    return pbs_fail(err, PBS_IO, "%s: %s; --shot FILE needs no display", what,
                    text ? text : "failed");
}

/* Xlib would end the program with status 1, and cannot be talked out of ending it. */
static int on_display_lost(void *display) {
    static const char text[] = "pbs-view: the display was lost\n";
    (void)display;
    if (write(2, text, sizeof text - 1) < 0) _exit(PBS_INTERNAL);
    _exit(PBS_IO);
}

static void watch_display(void) {
    void *lib = dlopen("libX11.so.6", RTLD_NOW | RTLD_NOLOAD); /* GLFW's, if it uses X11 */
    void *(*set)(int (*)(void *)) = NULL;
    if (lib) *(void **)&set = dlsym(lib, "XSetIOErrorHandler");
    if (set) set(on_display_lost);
}

/* A device that is reset tells it then, and goes on with calls that do nothing, instead of ending
 * the program. Not every driver can. */
static GLFWwindow *create(const pbs_window *s) {
    const pbs_show_options *o = s->show->options;
    s->f.WindowHint(GLFW_CONTEXT_VERSION_MAJOR, 4);
    s->f.WindowHint(GLFW_CONTEXT_VERSION_MINOR, 5);
    s->f.WindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    s->f.WindowHint(GLFW_OPENGL_DEBUG_CONTEXT, pbs_gl_debug() ? GLFW_TRUE : GLFW_FALSE);
    s->f.WindowHint(GLFW_CONTEXT_ROBUSTNESS, GLFW_LOSE_CONTEXT_ON_RESET);
    GLFWwindow *w = s->f.CreateWindow((int)o->width, (int)o->height, s->title, NULL, NULL);
    if (w) return w;
    s->f.WindowHint(GLFW_CONTEXT_ROBUSTNESS, GLFW_NO_ROBUSTNESS);
    return s->f.CreateWindow((int)o->width, (int)o->height, s->title, NULL, NULL);
}

static pbs_code open_window(pbs_window *s, pbs_err *err) {
    if (!s->f.Init()) return glfw_error(&s->f, "no window", err);
    watch_display();
    s->w = create(s);
    if (!s->w) return glfw_error(&s->f, "no window with OpenGL 4.5", err);
    s->f.MakeContextCurrent(s->w);
    s->f.SwapInterval(s->play->options->bench ? 0 : 1);
    pbs_input_open_window(s);
    pbs_code rc = pbs_gl_load(&s->gl, s->f.GetProcAddress, err);
    if (rc) return rc;
    pbs_count_open(&s->gl);
    pbs_timer_open(&s->timer, &s->gl);
    s->overlay.device = s->gl.device;
    rc = pbs_text_new(s->show->run, &s->gl, &s->text, err);
    if (!rc && s->play->options->bench)
        rc = pbs_bench_open(s->show, s->play, &s->gl, s->bench, err);
    return rc;
}

/* ---- drawing ---- */

static pbs_code fit_canvas(pbs_window *s, pbs_err *err) {
    int width, height;
    s->f.GetFramebufferSize(s->w, &width, &height);
    s->hidden = width < 1 || height < 1; /* minimised */
    if (s->hidden) return PBS_OK;
    s->width = (uint32_t)width;
    s->height = (uint32_t)height;
    if (s->canvas) return pbs_canvas_resize(s->canvas, s->width, s->height, err);
    pbs_canvas_desc d = {s->width, s->height, (int)s->show->options->samples};
    return pbs_canvas_new(s->show->run, &s->gl, &d, &s->canvas, err);
}

static pbs_code draw_overlay(pbs_window *s, const pbs_show_view *v, pbs_err *err) {
    char lines[PBS_OVERLAY_TEXT];
    int scale = s->height >= 1600 ? 3 : s->height >= 800 ? 2 : 1, width, height;
    pbs_code rc = PBS_OK;
    pbs_overlay_statistics(&s->overlay, s->show, v, lines);
    if (lines[0]) rc = pbs_text_draw(s->text, s->canvas, lines, 4, 4, scale, err);
    if (!s->overlay.help || rc) return rc;
    pbs_overlay_keys(lines);
    pbs_text_size(lines, &width, &height);
    int x = ((int)s->width - width * scale) / 2, y = ((int)s->height - height * scale) / 2;
    return pbs_text_draw(s->text, s->canvas, lines, x > 0 ? x : 0, y > 0 ? y : 0, scale, err);
}

static void set_title(const pbs_window *s) {
    const pbs_show *show = s->show;
    char text[1200];
    snprintf(text, sizeof text,
             "%s%s%s: %llu nodes, %llu surfels, %llu voxels, %llu triangles, surfel size %.2g px",
             s->title, s->overlay.name[0] ? ": " : "", s->overlay.name,
             (unsigned long long)show->drawn_nodes, (unsigned long long)show->drawn_surfels,
             (unsigned long long)show->drawn_voxels, (unsigned long long)show->drawn_triangles,
             s->play->control.size);
    s->f.SetWindowTitle(s->w, text);
}

/* What the canvas shows now is named before anything else is drawn onto it. */
static pbs_code answer_pick(pbs_window *s, const pbs_show_view *v, pbs_err *err) {
    int width, height;
    s->f.GetWindowSize(s->w, &width, &height);
    double x = width > 0 ? s->pick_x * v->width / width : -1;
    double y = height > 0 ? s->pick_y * v->height / height : -1;
    s->pick = false;
    pbs_code rc =
        pbs_play_pick(s->show, s->canvas, v, x, y, s->overlay.name, sizeof s->overlay.name, err);
    if (!rc && !s->overlay.name[0])
        snprintf(s->overlay.name, sizeof s->overlay.name, "nothing there");
    return rc;
}

/* While flying, what is in the middle of the picture becomes the target, so that the speed follows
 * the distance to it, and turning is around it afterwards. */
static pbs_code follow_depth(pbs_window *s, double now, pbs_err *err) {
    double depth;
    if (!s->overlay.flying || now < s->focus_at) return PBS_OK;
    s->focus_at = now + 0.2;
    pbs_code rc = pbs_canvas_depth(s->canvas, s->width / 2, s->height / 2, &depth, err);
    if (!rc && depth > 0) pbs_camera_refocus(&s->camera, fmin(fmax(depth, 0.5), 2));
    return rc;
}

/* Times of the device come late, and may be those of a size before. The controller bears it
 * (tests/unit/test_play.c). */
static void take_times(pbs_window *s, double cpu) {
    double gpu, longest = 0;
    while (pbs_timer_take(&s->timer, false, &gpu)) {
        s->overlay.gpu = gpu;
        longest = fmax(longest, gpu);
    }
    s->overlay.cpu = cpu;
    if (longest > 0 && pbs_control_step(&s->play->control, fmax(longest, cpu))) s->stale = true;
    if (longest == 0 && s->play->control.target > 0) s->stale = true; /* it is still to come */
}

static pbs_code draw_picture(pbs_window *s, const pbs_show_view *v, pbs_err *err) {
    double from = pbs_clock_wall();
    pbs_count_take();
    pbs_timer_begin(&s->timer);
    pbs_code rc = pbs_show_draw(s->show, s->canvas, v, err);
    pbs_timer_end(&s->timer);
    s->overlay.counts = pbs_count_take();
    s->stale = s->show->unfinished;
    take_times(s, pbs_clock_wall() - from);
    if (!rc && s->pick) rc = answer_pick(s, v, err);
    if (!rc) rc = follow_depth(s, from, err);
    return rc ? rc : draw_overlay(s, v, err);
}

static pbs_code draw_bench(pbs_window *s, pbs_err *err) {
    pbs_code rc = pbs_bench_frame(s->bench, s->canvas, s->width, s->height, err);
    s->stale = true;
    if (pbs_bench_is_done(s->bench)) s->f.SetWindowShouldClose(s->w, GLFW_TRUE);
    return rc;
}

static pbs_code draw(pbs_window *s, pbs_err *err) {
    pbs_code rc = fit_canvas(s, err);
    s->stale = false;
    if (rc || s->hidden) return rc;
    pbs_show_view v = pbs_play_view(s->play, &s->camera, s->width, s->height);
    s->overlay.surfel_size = s->play->control.size;
    s->overlay.target = s->play->control.target;
    rc = s->play->options->bench ? draw_bench(s, err) : draw_picture(s, &v, err);
    if (!rc) rc = pbs_canvas_present(s->canvas, err);
    if (!rc) rc = pbs_gl_lost(&s->gl, err);
    if (rc) return rc;
    set_title(s);
    s->f.SwapBuffers(s->w);
    return PBS_OK;
}

static pbs_code live(pbs_window *s, pbs_err *err) {
    pbs_code rc = PBS_OK;
    while (!rc && !s->f.WindowShouldClose(s->w)) {
        pbs_input_advance(s, pbs_clock_wall());
        if (s->stale) rc = draw(s, err);
        /* A signal wakes nobody: look from time to time. */
        if (s->stale && !s->hidden)
            s->f.PollEvents();
        else
            s->f.WaitEventsTimeout(0.2);
        if (!rc) rc = pbs_run_check(s->show->run, err);
    }
    return rc;
}

pbs_code pbs_window_run(pbs_show *show, pbs_play *play, const char *title, pbs_err *err) {
    pbs_bench bench = {0};
    pbs_window s = {.show = show, .play = play, .title = title, .bench = &bench, .stale = true};
    s.camera = pbs_play_camera(play, show, play->options->at);
    s.overlay.statistics = play->options->overlay;
    s.overlay.moving =
        isnan(play->options->time) && !play->options->bench && pbs_poses_any(&show->poses);
    if (s.overlay.moving) play->moment = 0;
    pbs_code rc = load_glfw(&s.f, err);
    if (rc) return rc;
    rc = open_window(&s, err);
    if (!rc) rc = live(&s, err);
    if (!rc && play->options->bench) rc = pbs_bench_write(&bench, err);
    pbs_bench_close(&bench);
    pbs_text_free(s.text);
    pbs_timer_close(&s.timer);
    pbs_canvas_free(s.canvas);
    /* GLFW itself stays until the program ends: terminated, it unloads the driver with what that
     * has left lying about, and leak checkers can't tell any more whose it is. */
    if (s.w) s.f.DestroyWindow(s.w);
    return rc;
}
