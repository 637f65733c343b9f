/* keys.c: the table of keys. */
#include "cmd/pbs-view/keys.h"
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

const pbs_key pbs_keys[] = {
    {"left button",
     "dragging turns the scene; a click names what is under the cursor",
     PBS_KEY_NONE,
     {0}},
    {"right button, middle button",
     "dragging moves along; so does the left one with shift",
     PBS_KEY_NONE,
     {0}},
    {"wheel", "nearer and farther", PBS_KEY_NONE, {0}},
    {"Left, Right, Up, Down",
     "turn the scene",
     PBS_KEY_TURN,
     {GLFW_KEY_LEFT, GLFW_KEY_RIGHT, GLFW_KEY_UP, GLFW_KEY_DOWN}},
    {"PageUp, PageDown",
     "nearer and farther",
     PBS_KEY_DOLLY,
     {GLFW_KEY_PAGE_UP, GLFW_KEY_PAGE_DOWN}},
    {"F", "fly, and back to turning", PBS_KEY_FLY, {GLFW_KEY_F}},
    {"W, A, S, D, E, C",
     "when flying: ahead, left, back, right, up, down; the mouse looks around",
     PBS_KEY_NONE,
     {0}},
    {"Home, R", "back to the first view", PBS_KEY_HOME, {GLFW_KEY_HOME, GLFW_KEY_R}},
    {"N", "name what is under the cursor", PBS_KEY_NAME, {GLFW_KEY_N}},
    {"P", "play the camera path, and stop", PBS_KEY_PLAY, {GLFW_KEY_P}},
    {"M", "play the animations, and stop", PBS_KEY_ANIMATE, {GLFW_KEY_M}},
    {"Comma, Period",
     "animations at half and at twice the speed",
     PBS_KEY_SPEED,
     {GLFW_KEY_COMMA, GLFW_KEY_PERIOD}},
    {"[, ]",
     "smaller and larger surfels",
     PBS_KEY_SIZE,
     {GLFW_KEY_LEFT_BRACKET, GLFW_KEY_RIGHT_BRACKET}},
    {"T", "hold the time of a frame, and not", PBS_KEY_HOLD, {GLFW_KEY_T}},
    {"V", "larger surfels away from the gaze, and not", PBS_KEY_FOVEA, {GLFW_KEY_V}},
    {"2", "two eyes side by side, and one", PBS_KEY_STEREO, {GLFW_KEY_2, GLFW_KEY_KP_2}},
    {"I", "statistics, and none", PBS_KEY_STATISTICS, {GLFW_KEY_I}},
    {"H", "this list, and none", PBS_KEY_HELP, {GLFW_KEY_H}},
    {"Escape, Q",
     "the end; when flying, Escape goes back to turning",
     PBS_KEY_QUIT,
     {GLFW_KEY_ESCAPE, GLFW_KEY_Q}},
};
const size_t pbs_key_count = sizeof pbs_keys / sizeof pbs_keys[0];

pbs_action pbs_key_find(int code, int *which) {
    for (size_t i = 0; i < pbs_key_count; i++)
        for (int k = 0; k < 6 && pbs_keys[i].codes[k]; k++)
            if (pbs_keys[i].codes[k] == code) {
                *which = k;
                return pbs_keys[i].action;
            }
    *which = 0;
    return PBS_KEY_NONE;
}
