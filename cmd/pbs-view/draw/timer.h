/* timer.h: how long the device works on a frame, by timestamps in its own queue. A frame's time is
 * there only when the device has come to its end, frames later perhaps: nobody waits for it. */
#ifndef PBS_TIMER_H
#define PBS_TIMER_H

#include "cmd/pbs-view/draw/gl.h"

enum { PBS_TIMER_FRAMES = 8 }; /* under way at most; frames beyond are not measured */

typedef struct pbs_timer {
    const pbs_gl *gl;
    GLuint query[PBS_TIMER_FRAMES][2];
    unsigned begun, taken; /* frames so far */
    bool open;
} pbs_timer;

/* gl is borrowed. */
void pbs_timer_open(pbs_timer *timer, const pbs_gl *gl);
void pbs_timer_close(pbs_timer *timer);

/* Around the calls of a frame. */
void pbs_timer_begin(pbs_timer *timer);
void pbs_timer_end(pbs_timer *timer);

/* The oldest time that was not taken yet, in seconds. False: there is none, or it is not ready;
 * wait: then it is waited for. */
bool pbs_timer_take(pbs_timer *timer, bool wait, double *seconds);

/* Seconds of the wall's clock and of this thread's processor time. */
double pbs_clock_wall(void);
double pbs_clock_thread(void);
#endif
