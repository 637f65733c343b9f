/* input.c: keys and mouse. Every change makes the picture stale. */
#include "cmd/pbs-view/input.h"
#include "cmd/pbs-view/keys.h"

/* A click may tremble so far, pixels. */
#define TREMBLE 4.0
/* Flying: distances of the target a second; and how much faster than the mouse the view turns. */
#define SPEED      0.7
#define TURN_RATIO 2.0

/* GLFW's own pointer from a window to its user could only be asked for through the table that it
 * leads to. There is one window. */
static pbs_window *the_window;

static pbs_window *of(GLFWwindow *w) {
    (void)w;
    return the_window;
}

static bool down(const pbs_window *s, int button) {
    return s->f.GetMouseButton(s->w, button) == GLFW_PRESS;
}

static bool held(const pbs_window *s, int key) {
    return s->f.GetKey(s->w, key) == GLFW_PRESS;
}

/* A mouse that looks around, or one that gazes, needs no button. */
static void follow_mouse(pbs_window *s, double dx, double dy, int width, int height) {
    if (s->overlay.flying) {
        double ratio = TURN_RATIO * 2 * s->camera.tan_half / 3;
        pbs_camera_turn(&s->camera, ratio * dx, ratio * dy);
        s->stale = true;
    } else if (s->play->gaze_is_mouse && width > 0 && height > 0) {
        double eyes = s->play->stereo_on ? 2 : 1, x = eyes * s->x / width;
        s->play->gaze[0] = fmin(fmax(x > 1 && eyes > 1 ? x - 1 : x, 0), 1);
        s->play->gaze[1] = fmin(fmax(s->y / height, 0), 1);
        s->stale = s->stale || s->play->zones_on;
    }
}

static void on_move(GLFWwindow *w, double x, double y) {
    pbs_window *s = of(w);
    int width, height;
    s->f.GetWindowSize(w, &width, &height);
    double dx = x - s->x, dy = y - s->y, unit = height > 0 ? height : 1;
    s->x = x, s->y = y;
    follow_mouse(s, dx / unit, dy / unit, width, height);
    bool left = down(s, GLFW_MOUSE_BUTTON_LEFT);
    bool other = down(s, GLFW_MOUSE_BUTTON_RIGHT) || down(s, GLFW_MOUSE_BUTTON_MIDDLE);
    if (s->overlay.flying || !(left || other)) return;
    s->moved += fabs(dx) + fabs(dy);
    if (s->moved <= TREMBLE) return;
    if (other || held(s, GLFW_KEY_LEFT_SHIFT))
        pbs_camera_pan(&s->camera, dx / unit, dy / unit);
    else
        pbs_camera_orbit(&s->camera, dx / unit, dy / unit);
    s->stale = true;
}

static void ask_for_name(pbs_window *s) {
    s->f.GetCursorPos(s->w, &s->pick_x, &s->pick_y);
    if (s->overlay.flying) {
        int width, height;
        s->f.GetWindowSize(s->w, &width, &height);
        s->pick_x = width / 2.0, s->pick_y = height / 2.0; /* the mouse has no place then */
    }
    s->pick = s->stale = true;
}

static void on_button(GLFWwindow *w, int button, int action, int mods) {
    pbs_window *s = of(w);
    (void)mods;
    if (action == GLFW_PRESS) s->moved = 0;
    if (action == GLFW_RELEASE && button == GLFW_MOUSE_BUTTON_LEFT && s->moved <= TREMBLE)
        ask_for_name(s);
}

static void on_scroll(GLFWwindow *w, double dx, double dy) {
    pbs_window *s = of(w);
    (void)dx;
    if (s->overlay.flying)
        pbs_camera_move(&s->camera, 0, 0, 0.1 * dy);
    else
        pbs_camera_dolly(&s->camera, dy);
    s->stale = true;
}

static void fly(pbs_window *s, bool on) {
    s->overlay.flying = on;
    s->f.SetInputMode(s->w, GLFW_CURSOR, on ? GLFW_CURSOR_DISABLED : GLFW_CURSOR_NORMAL);
    s->f.GetCursorPos(s->w, &s->x, &s->y); /* GLFW moves it */
    s->focus_at = 0;
}

static void play_path(pbs_window *s) {
    s->overlay.playing = !s->overlay.playing && s->play->path.count;
    s->path_time = s->overlay.playing ? pbs_path_start(&s->play->path) : 0;
}

/* Animations go on from where they are. */
static void play_animations(pbs_window *s) {
    s->overlay.moving = !s->overlay.moving && pbs_poses_any(&s->show->poses);
    if (s->overlay.moving && isnan(s->play->moment)) s->play->moment = 0;
}

static void set_speed(pbs_window *s, double factor) {
    double speed = s->play->speed * factor;
    if (fabs(speed) > 1e-3 && fabs(speed) < 1e3) s->play->speed = speed;
}

/* Held frame-time by key: what the options say, or 60 a second. */
static void hold(pbs_window *s) {
    double wanted =
        s->play->options->frame_time > 0 ? s->play->options->frame_time / 1000 : 1.0 / 60;
    s->play->control =
        pbs_control_start(s->play->control.target > 0 ? 0 : wanted, s->play->control.size);
}

static void resize_surfels(pbs_window *s, double factor) {
    double size = s->play->control.size * factor;
    if (size < 0.25 || size > 64) return;
    s->play->control = pbs_control_start(s->play->control.target, size);
}

static void act(pbs_window *s, pbs_action action, int which) {
    static const double turn[4][2] = {{0.02, 0}, {-0.02, 0}, {0, 0.02}, {0, -0.02}};
    switch (action) {
    case PBS_KEY_HELP:
        s->overlay.help = !s->overlay.help;
        break;
    case PBS_KEY_STATISTICS:
        s->overlay.statistics = !s->overlay.statistics;
        break;
    case PBS_KEY_FLY:
        fly(s, !s->overlay.flying);
        break;
    case PBS_KEY_HOME:
        s->overlay.playing = false;
        s->camera = pbs_play_camera(s->play, s->show, s->play->options->at);
        break;
    case PBS_KEY_NAME:
        ask_for_name(s);
        break;
    case PBS_KEY_PLAY:
        play_path(s);
        break;
    case PBS_KEY_ANIMATE:
        play_animations(s);
        break;
    case PBS_KEY_SPEED:
        set_speed(s, which ? 2 : 0.5);
        break;
    case PBS_KEY_STEREO:
        s->play->stereo_on = !s->play->stereo_on;
        break;
    case PBS_KEY_FOVEA:
        s->play->zones_on = !s->play->zones_on;
        break;
    case PBS_KEY_HOLD:
        hold(s);
        break;
    case PBS_KEY_SIZE:
        resize_surfels(s, which ? 1.25 : 0.8);
        break;
    case PBS_KEY_TURN:
        pbs_camera_orbit(&s->camera, turn[which][0], turn[which][1]);
        break;
    case PBS_KEY_DOLLY:
        pbs_camera_dolly(&s->camera, which ? -1 : 1);
        break;
    case PBS_KEY_QUIT:
        if (s->overlay.flying && which == 0)
            fly(s, false);
        else
            s->f.SetWindowShouldClose(s->w, GLFW_TRUE);
        break;
    case PBS_KEY_NONE:
        return;
    }
    s->stale = true;
}

static void on_key(GLFWwindow *w, int key, int code, int action, int mods) {
    pbs_window *s = of(w);
    int which;
    (void)code, (void)mods;
    pbs_action found = pbs_key_find(key, &which);
    bool repeats = found == PBS_KEY_SIZE || found == PBS_KEY_TURN || found == PBS_KEY_DOLLY;
    if (action == GLFW_PRESS || (action == GLFW_REPEAT && repeats)) act(s, found, which);
}

static void on_resize(GLFWwindow *w, int width, int height) {
    (void)width, (void)height;
    of(w)->stale = true;
}
static void on_refresh(GLFWwindow *w) {
    of(w)->stale = true;
}

void pbs_input_open_window(pbs_window *s) {
    the_window = s;
    s->f.SetCursorPosCallback(s->w, on_move);
    s->f.SetMouseButtonCallback(s->w, on_button);
    s->f.SetScrollCallback(s->w, on_scroll);
    s->f.SetKeyCallback(s->w, on_key);
    s->f.SetFramebufferSizeCallback(s->w, on_resize);
    s->f.SetWindowRefreshCallback(s->w, on_refresh);
}

/* ---- what moves by itself ---- */

static double axis(const pbs_window *s, int more, int less) {
    return (double)held(s, more) - (double)held(s, less);
}

void pbs_input_advance(pbs_window *s, double now) {
    double passed = s->before > 0 ? fmin(now - s->before, 0.1) : 0; /* a stall is no leap */
    s->before = now;
    if (s->overlay.flying) {
        double step = SPEED * passed, right = axis(s, GLFW_KEY_D, GLFW_KEY_A);
        double up = axis(s, GLFW_KEY_E, GLFW_KEY_C), ahead = axis(s, GLFW_KEY_W, GLFW_KEY_S);
        pbs_camera_move(&s->camera, step * right, step * up, step * ahead);
        if (right != 0 || up != 0 || ahead != 0) s->stale = true;
    }
    if (s->overlay.moving) {
        s->play->moment += s->play->speed * passed;
        s->stale = true;
    }
    if (s->overlay.playing) {
        s->path_time += passed;
        pbs_path_at(&s->play->path, s->path_time, &s->camera);
        s->overlay.playing = s->path_time < pbs_path_end(&s->play->path);
        s->stale = true;
    }
}
