/* draw_text.c: rectangles of letters, two triangles each. */
#include "cmd/pbs-view/draw/draw_text.h"
#include "cmd/pbs-view/draw/draw_internal.h"
#include "shaders.h"
#include <stb/stb_easy_font.h>

enum {
    MARGIN = 6,          /* around the text, pixels at scale 1 */
    LETTER_BYTES = 1280, /* more than any letter's rectangles take */
    CHUNK = 256,         /* letters at a time */
};

struct pbs_text {
    pbs_run *run;
    const pbs_gl *gl;
    GLuint program, array, buffer;
    float *corners; /* 12 a rectangle */
    char *quads;    /* stb_easy_font's: 4 vertices of 16 bytes a rectangle */
};

pbs_code pbs_text_new(pbs_run *run, const pbs_gl *gl, pbs_text **out, pbs_err *err) {
    const pbs_gl_stage stages[2] = {
        {GL_VERTEX_SHADER, {PBS_GLSL_VERSION, text_vert_glsl}},
        {GL_FRAGMENT_SHADER, {PBS_GLSL_VERSION, text_frag_glsl}},
    };
    pbs_text *t;
    *out = NULL;
    pbs_code rc = pbs_alloc(run, &t, 1, sizeof *t, "the text", err);
    if (rc) return rc;
    *t = (pbs_text){.run = run, .gl = gl};
    rc = pbs_alloc(run, &t->quads, CHUNK, LETTER_BYTES, "the text", err);
    if (!rc) rc = pbs_alloc(run, &t->corners, CHUNK, LETTER_BYTES, "the text", err);
    if (!rc) rc = pbs_gl_program(gl, "text", stages, 2, &t->program, err);
    if (rc) {
        pbs_text_free(t);
        return rc;
    }
    gl->CreateBuffers(1, &t->buffer);
    gl->CreateVertexArrays(1, &t->array);
    gl->VertexArrayVertexBuffer(t->array, 0, t->buffer, 0, 2 * sizeof(float));
    gl->VertexArrayAttribFormat(t->array, 0, 2, GL_FLOAT, GL_FALSE, 0);
    gl->VertexArrayAttribBinding(t->array, 0, 0);
    gl->EnableVertexArrayAttrib(t->array, 0);
    *out = t;
    return pbs_gl_check(gl, "text", err);
}

void pbs_text_free(pbs_text *t) {
    if (!t) return;
    t->gl->DeleteProgram(t->program);
    t->gl->DeleteBuffers(1, &t->buffer);
    t->gl->DeleteVertexArrays(1, &t->array);
    pbs_free(t->run, t->quads);
    pbs_free(t->run, t->corners);
    pbs_free(t->run, t);
}

/* The font has ASCII, and looks nothing up that is not. Returns what follows the line. */
static const char *next_line(const char *p, char out[CHUNK]) {
    size_t n = 0;
    for (; *p && *p != '\n'; p++) {
        unsigned char c = (unsigned char)*p;
        if ((c & 0xc0) == 0x80) continue; /* the rest of a character */
        if (n < CHUNK - 1) out[n++] = (c >= 32 && c < 127) || c == '\t' ? (char)c : '?';
    }
    out[n] = 0;
    return *p ? p + 1 : p;
}

/* Ends the line at its tab; returns what follows it, or NULL. */
static char *second_cell(char *line) {
    char *tab = strchr(line, '\t');
    if (!tab) return NULL;
    *tab = 0;
    for (char *p = tab + 1; *p; p++) *p = *p == '\t' ? ' ' : *p;
    return tab + 1;
}

/* Where second cells begin. */
static int column(const char *lines) {
    char line[CHUNK];
    int most = 0;
    while (*lines) {
        lines = next_line(lines, line);
        int w = second_cell(line) ? stb_easy_font_width(line) : 0;
        most = w > most ? w : most;
    }
    return most + 12;
}

void pbs_text_size(const char *lines, int *width, int *height) {
    char line[CHUNK];
    int second = column(lines);
    *width = *height = 0;
    while (*lines) {
        lines = next_line(lines, line);
        char *cell = second_cell(line);
        int w = cell ? second + stb_easy_font_width(cell) : stb_easy_font_width(line);
        *width = w > *width ? w : *width;
        *height += 12;
    }
}

static void put(const pbs_text *t, const float *corners, size_t rectangles, const float ink[4]) {
    const pbs_gl *gl = t->gl;
    gl->NamedBufferData(t->buffer, (GLsizeiptr)(rectangles * 12 * sizeof(float)), corners,
                        GL_STREAM_DRAW);
    gl->Uniform4fv(gl->GetUniformLocation(t->program, "ink"), 1, ink);
    gl->DrawArrays(GL_TRIANGLES, 0, (GLsizei)(6 * rectangles));
}

static void rectangle(float out[12], float x0, float y0, float x1, float y1) {
    memcpy(out, (float[12]){x0, y0, x1, y0, x0, y1, x1, y0, x1, y1, x0, y1}, 12 * sizeof *out);
}

static void put_cell(const pbs_text *t, char *line, int x, int y, int scale, const float ink[4]) {
    int n = stb_easy_font_print(0, 0, line, NULL, t->quads, CHUNK * LETTER_BYTES);
    float s = (float)scale, fx = (float)x, fy = (float)y;
    for (int i = 0; i < n; i++) {
        float a[2], b[2]; /* the first and the third corner are opposite */
        memcpy(a, t->quads + (size_t)i * 64, sizeof a);
        memcpy(b, t->quads + (size_t)i * 64 + 32, sizeof b);
        rectangle(t->corners + 12 * (size_t)i, fx + s * a[0], fy + s * a[1], fx + s * b[0],
                  fy + s * b[1]);
    }
    if (n) put(t, t->corners, (size_t)n, ink);
}

pbs_code pbs_text_draw(pbs_text *t, pbs_canvas *c, const char *lines, int x, int y, int scale,
                       pbs_err *err) {
    const float dark[4] = {0.01f, 0.012f, 0.016f, 0.8f}, light[4] = {0.9f, 0.92f, 0.95f, 1};
    const pbs_gl *gl = t->gl;
    char line[CHUNK];
    float panel[12];
    int width, height, edge = MARGIN * scale, second = column(lines);
    pbs_text_size(lines, &width, &height);
    gl->BindFramebuffer(GL_FRAMEBUFFER, c->draw.frame);
    gl->Viewport(0, 0, (GLsizei)c->width, (GLsizei)c->height);
    gl->Disable(GL_DEPTH_TEST);
    gl->Enable(GL_BLEND);
    gl->BlendEquation(GL_FUNC_ADD);
    gl->BlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
    gl->UseProgram(t->program);
    gl->Uniform2f(gl->GetUniformLocation(t->program, "size"), (float)c->width, (float)c->height);
    gl->BindVertexArray(t->array);
    rectangle(panel, (float)x, (float)y, (float)(x + width * scale + 2 * edge),
              (float)(y + height * scale + 2 * edge));
    put(t, panel, 1, dark);
    for (int row = y + edge; *lines; row += 12 * scale) {
        lines = next_line(lines, line);
        char *cell = second_cell(line);
        put_cell(t, line, x + edge, row, scale, light);
        if (cell) put_cell(t, cell, x + edge + second * scale, row, scale, light);
    }
    gl->Disable(GL_BLEND);
    gl->Enable(GL_DEPTH_TEST);
    return pbs_gl_check(gl, "text", err);
}
