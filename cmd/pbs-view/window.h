/* window.h: a window in which mouse and keys move the camera. GLFW is opened when a window is
 * wanted, so everything else runs on machines without it. */
#ifndef PBS_WINDOW_H
#define PBS_WINDOW_H

#include "cmd/pbs-view/bench.h"

/* Returns when the window is closed. With --bench it shows the series, writes the table of what was
 * shown and returns. Keys: keys.h. Errors: PBS_IO without GLFW, display or OpenGL 4.5, and for a
 * device that is lost. */
pbs_code pbs_window_run(pbs_show *show, pbs_play *play, const char *title, pbs_err *err);
#endif
