/* window.h: a window in which the mouse moves the camera. GLFW is opened when a window is wanted,
 * so everything else runs on machines without it. */
#ifndef PBS_WINDOW_H
#define PBS_WINDOW_H

#include "cmd/pbs-view/show.h"

/* Returns when the window is closed. Keys and mouse: pbs-view(1). Errors: PBS_IO without GLFW,
 * display or OpenGL 4.5. */
pbs_code pbs_window_run(pbs_show *show, const char *title, pbs_err *err);
#endif
