/* draw_probe.c: the depth of one pixel. A target of many samples cannot be read: a pixel of it is
 * copied to one of one sample. */
#include "cmd/pbs-view/draw/draw_probe.h"
#include "cmd/pbs-view/draw/draw_internal.h"

pbs_code pbs_canvas_depth(pbs_canvas *c, uint32_t x, uint32_t y, double *depth, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    GLuint frame, buffer;
    GLint px = (GLint)x, py = (GLint)y;
    float stored = 0;
    *depth = 0;
    if (x >= c->width || y >= c->height) return PBS_OK;
    gl->CreateFramebuffers(1, &frame);
    gl->CreateRenderbuffers(1, &buffer);
    gl->NamedRenderbufferStorage(buffer, GL_DEPTH_COMPONENT32F, 1, 1);
    gl->NamedFramebufferRenderbuffer(frame, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, buffer);
    gl->NamedFramebufferDrawBuffer(frame, GL_NONE);
    gl->NamedFramebufferReadBuffer(frame, GL_NONE);
    gl->BlitNamedFramebuffer(c->draw.frame, frame, px, py, px + 1, py + 1, 0, 0, 1, 1,
                             GL_DEPTH_BUFFER_BIT, GL_NEAREST);
    gl->BindFramebuffer(GL_READ_FRAMEBUFFER, frame);
    gl->ReadPixels(0, 0, 1, 1, GL_DEPTH_COMPONENT, GL_FLOAT, &stored);
    gl->DeleteFramebuffers(1, &frame);
    gl->DeleteRenderbuffers(1, &buffer);
    /* Reversed: the near plane is at 1 and infinity at 0. */
    if (stored > 0) *depth = PBS_CAMERA_NEAR / (double)stored;
    return pbs_gl_check(gl, "the depth under the cursor", err);
}
