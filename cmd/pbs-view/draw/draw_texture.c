/* draw_texture.c: textures in the GPU's memory. */
#include "cmd/pbs-view/draw/draw_texture.h"

GLuint pbs_gl_texture_new(const pbs_gl *gl, const pbs_mips *m) {
    GLuint texture;
    gl->CreateTextures(GL_TEXTURE_2D, 1, &texture);
    gl->TextureStorage2D(texture, pbs_mips_levels(m), m->srgb ? GL_SRGB8_ALPHA8 : GL_RGBA8,
                         (GLsizei)m->width, (GLsizei)m->height);
    return texture;
}

/* Pixels `from` to `to` of a level, in reading order: the rest of a row, whole rows, the begin of a
 * row. */
static void fill_level(const pbs_gl *gl, GLuint texture, GLint level, uint64_t width, uint64_t from,
                       uint64_t to, const uint8_t *bytes) {
    while (from < to) {
        uint64_t x = from % width, rows = x ? 1 : (to - from) / width;
        uint64_t columns = x || !rows ? width - x : width;
        if (columns > to - from) columns = to - from;
        if (!rows) rows = 1;
        gl->TextureSubImage2D(texture, level, (GLint)x, (GLint)(from / width), (GLsizei)columns,
                              (GLsizei)rows, GL_RGBA, GL_UNSIGNED_BYTE, bytes);
        from += columns * rows;
        bytes += 4 * columns * rows;
    }
}

void pbs_gl_texture_fill(const pbs_gl *gl, GLuint texture, const pbs_mips *mips, uint64_t at,
                         const void *bytes, uint64_t size) {
    const uint8_t *p = bytes;
    gl->PixelStorei(GL_UNPACK_ALIGNMENT, 4);
    for (int i = 0; i < pbs_mips_levels(mips) && size; i++) {
        uint64_t begin;
        pbs_mips l = pbs_mips_level(mips, i, &begin);
        uint64_t end = begin + (uint64_t)4 * l.width * l.height;
        if (at >= end) continue;
        uint64_t n = end - at < size ? end - at : size;
        fill_level(gl, texture, i, l.width, (at - begin) / 4, (at - begin + n) / 4, p);
        at += n, p += n, size -= n;
    }
}
