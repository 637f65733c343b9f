/* overlay.h: what the text over the picture says: statistics, the name of a part, the keys. */
#ifndef PBS_OVERLAY_H
#define PBS_OVERLAY_H

#include "cmd/pbs-view/draw/count.h"
#include "cmd/pbs-view/show.h"

typedef struct pbs_overlay {
    bool statistics, help;
    const char *device;
    pbs_counts counts;    /* of the last frame */
    double gpu, cpu;      /* seconds of a frame; 0: not measured, not shown */
    double target;        /* seconds that are held; 0: none */
    double surfel_size;   /* pixels */
    char name[512];       /* of the part that was asked for; "": none was */
    bool flying, playing; /* how the camera moves */
    bool moving;          /* animations play */
} pbs_overlay;

enum { PBS_OVERLAY_TEXT = 4096 };
/* Lines ending with \n; "": nothing to say. */
void pbs_overlay_statistics(const pbs_overlay *overlay, const pbs_show *show,
                            const pbs_show_view *view, char out[PBS_OVERLAY_TEXT]);
void pbs_overlay_keys(char out[PBS_OVERLAY_TEXT]);
#endif
