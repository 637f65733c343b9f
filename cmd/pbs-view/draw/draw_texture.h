/* draw_texture.h: textures in the GPU's memory, filled a piece at a time. */
#ifndef PBS_DRAW_TEXTURE_H
#define PBS_DRAW_TEXTURE_H

#include "cmd/pbs-view/draw/gl.h"
#include "cmd/pbs-view/draw/mips.h"

/* Room for all levels, without contents; mips has sides. Errors are the GL's (pbs_gl_check). */
GLuint pbs_gl_texture_new(const pbs_gl *gl, const pbs_mips *mips);

/* Bytes `at` to `at + size` of the levels (mips.h), both multiples of 4. */
void pbs_gl_texture_fill(const pbs_gl *gl, GLuint texture, const pbs_mips *mips, uint64_t at,
                         const void *bytes, uint64_t size);
#endif
