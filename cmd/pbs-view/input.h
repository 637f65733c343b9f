/* input.h: what keys and mouse do to a window; for window.c. */
#ifndef PBS_INPUT_H
#define PBS_INPUT_H

#include "cmd/pbs-view/bench.h"
#include "cmd/pbs-view/draw/draw_probe.h"
#include "cmd/pbs-view/draw/draw_text.h"
#include "cmd/pbs-view/overlay.h"
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

/* clang-format off */
#define PBS_GLFW_FUNCTIONS(F) \
    F(Init) F(GetError) F(WindowHint) F(CreateWindow) F(DestroyWindow) \
    F(MakeContextCurrent) F(GetProcAddress) F(SwapBuffers) F(SwapInterval) F(WaitEventsTimeout) \
    F(PollEvents) F(WindowShouldClose) F(SetWindowShouldClose) F(GetFramebufferSize) \
    F(GetWindowSize) F(SetWindowTitle) F(SetCursorPosCallback) F(SetScrollCallback) \
    F(SetKeyCallback) F(SetMouseButtonCallback) F(SetFramebufferSizeCallback) \
    F(SetWindowRefreshCallback) F(GetMouseButton) F(GetKey) F(GetCursorPos) F(SetInputMode)
/* clang-format on */

typedef struct pbs_glfw {
#define PBS_GLFW_MEMBER(name) __typeof__(&glfw##name) name;
    PBS_GLFW_FUNCTIONS(PBS_GLFW_MEMBER)
#undef PBS_GLFW_MEMBER
} pbs_glfw;

typedef struct pbs_window {
    pbs_glfw f;
    GLFWwindow *w;
    pbs_gl gl;
    pbs_show *show;
    pbs_play *play;
    pbs_canvas *canvas;
    pbs_text *text;
    pbs_timer timer;
    pbs_overlay overlay;
    pbs_bench *bench;
    pbs_camera camera;
    const char *title;
    double x, y;             /* where the mouse was */
    double moved;            /* how far it was dragged, pixels: a click is no drag */
    double pick_x, pick_y;   /* window coordinates of what is to be named */
    double before, focus_at; /* times, seconds: of the last advance; of the next look ahead */
    double path_time;        /* of the path that is played */
    uint32_t width, height;  /* of the canvas */
    bool hidden;             /* the window has no size */
    bool stale;              /* the picture is not what the window should show */
    bool pick;               /* the next picture is to be asked for a name */
} pbs_window;

/* Sets the callbacks of the window, of which there can be one. */
void pbs_input_open_window(pbs_window *window);
/* Moves what moves by itself: flying, and the path. now: seconds of the wall's clock. */
void pbs_input_advance(pbs_window *window, double now);
#endif
