/* draw_text.h: lines of text onto the canvas, over whatever is there. The letters are those of
 * stb_easy_font, made of rectangles: no texture, no font file. */
#ifndef PBS_DRAW_TEXT_H
#define PBS_DRAW_TEXT_H

#include "cmd/pbs-view/draw/draw.h"

typedef struct pbs_text pbs_text;

/* gl is borrowed. Errors: PBS_LIMIT, PBS_INTERNAL. */
pbs_code pbs_text_new(pbs_run *run, const pbs_gl *gl, pbs_text **out, pbs_err *err);
void pbs_text_free(pbs_text *text); /* NULL is fine */

/* Lines end with \n and may have a tab, behind which all lines continue at the same column; what is
 * not ASCII is shown as '?', one for each character of UTF-8. x, y: of the left upper corner,
 * pixels; scale: 1 makes lines of 12 pixels. A darker rectangle lies under it. Call it behind
 * everything else that is drawn. Errors: PBS_LIMIT, PBS_INTERNAL. */
pbs_code pbs_text_draw(pbs_text *text, pbs_canvas *canvas, const char *lines, int x, int y,
                       int scale, pbs_err *err);
/* Pixels at scale 1. */
void pbs_text_size(const char *lines, int *width, int *height);
#endif
