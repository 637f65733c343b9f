/* keys.h: the keys of the window, in one table: what they do, what `h` shows, what --keys prints,
 * and what the man page is checked against. */
#ifndef PBS_KEYS_H
#define PBS_KEYS_H

#include <stddef.h>

typedef enum pbs_action {
    PBS_KEY_NONE, /* of the mouse, or held down while flying */
    PBS_KEY_HELP,
    PBS_KEY_STATISTICS,
    PBS_KEY_FLY,
    PBS_KEY_HOME,
    PBS_KEY_NAME,
    PBS_KEY_PLAY,
    PBS_KEY_ANIMATE,
    PBS_KEY_SPEED, /* first key: slower, second: faster */
    PBS_KEY_STEREO,
    PBS_KEY_FOVEA,
    PBS_KEY_HOLD, /* of the frame-time */
    PBS_KEY_SIZE, /* first key: smaller, second: larger */
    PBS_KEY_TURN, /* left, right, up, down */
    PBS_KEY_DOLLY,
    PBS_KEY_QUIT
} pbs_action;

typedef struct pbs_key {
    const char *name; /* "Home, R" */
    const char *what; /* "back to the first view" */
    pbs_action action;
    int codes[6]; /* GLFW's; 0: no more */
} pbs_key;

extern const pbs_key pbs_keys[];
extern const size_t pbs_key_count;

/* The action of a key, or PBS_KEY_NONE; *which: its place among the row's keys. */
pbs_action pbs_key_find(int code, int *which);
#endif
