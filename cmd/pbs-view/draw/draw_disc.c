/* draw_disc.c: surfels as oriented discs, one draw a node: paper 1, section 4.2. */
#include "cmd/pbs-view/draw/draw_internal.h"
#include "libcore/surfels/average.h"
#include "libcore/gbuffer/lod.h"
#include "shaders.h"
#include <stddef.h>

/* A disc's picture has at least this half axis in pixels: it holds a pixel's centre wherever it
 * lies. */
#define LEAST_HALF_AXIS 0.70710678f

/* As disc.vert.glsl has it (std140). */
typedef struct node_params {
    float to_view[3][4], disc[3][4], normal[3][4];
    uint32_t first, stride, fine, fine_stride; /* words */
    uint32_t coarse, coarse_stride, coarse_count, before;
    int32_t fine_field[4], coarse_field[4];
    float blend, wanted, unit, slack;
} node_params;

/* In words, as the shader wants it; -1: absent. */
static int32_t field_word(uint32_t channels, uint32_t channel) {
    return channels & channel ? (int32_t)(pbs_surfel_size(channels & (channel - 1)) / 4) : -1;
}

static void set_fields(int32_t out[4], uint32_t channels, bool entries) {
    for (int k = 0; k < 4; k++) {
        out[k] = field_word(channels, (uint32_t)PBS_NORMAL << k);
        if (out[k] >= 0 && entries) out[k] -= 2; /* no position, no spacing */
    }
}

static pbs_code init(pbs_canvas *c, pbs_err *err) {
    disc_painter *p = &c->disc;
    const pbs_gl_stage stage[2] = {
        {GL_VERTEX_SHADER, {PBS_GLSL_VERSION, shade_glsl, disc_vert_glsl}},
        {GL_FRAGMENT_SHADER, {PBS_GLSL_VERSION, shade_glsl, disc_frag_glsl}},
    };
    if (p->program) return PBS_OK;
    pbs_code rc = pbs_gl_program(c->gl, "disc", stage, 2, &p->program, err);
    if (rc) return rc;
    p->smallest = c->gl->GetUniformLocation(p->program, "smallest");
    p->samples = c->gl->GetUniformLocation(p->program, "samples");
    c->gl->CreateVertexArrays(1, &p->array);
    return PBS_OK;
}

void pbs_disc_painter_free(pbs_canvas *c) {
    c->gl->DeleteProgram(c->disc.program);
    c->gl->DeleteVertexArrays(1, &c->disc.array);
}

static void place_node(const pbs_canvas *c, const pbs_surfels *node, node_params *p) {
    static const double unset[12];
    const double *m = memcmp(node->m, unset, sizeof unset) ? node->m : PBS_IDENTITY;
    double view[12], linear[12];
    double lattice[12] = {node->step, 0,          0,          node->corner[0],
                          0,          node->step, 0,          node->corner[1],
                          0,          0,          node->step, node->corner[2]};
    pbs_camera_place(view, &c->camera, m);
    memcpy(linear, view, sizeof linear);
    linear[3] = linear[7] = linear[11] = 0;
    double radius = node->radius > 0 && isfinite(node->radius) ? node->radius : 0;
    pbs_normal_rows(p->normal, view);
    pbs_rows(p->disc, linear, radius);
    /* In this order the corner, far from the origin as it may be, is added in double. */
    pbs_xform_mul(lattice, m, lattice);
    pbs_camera_place(view, &c->camera, lattice);
    pbs_rows(p->to_view, view, 1);
    if (!(node->size > 0) || !(radius > 0)) return;
    /* Lengths in radii of the node's discs: what a pixel's share of them is at distance 1. */
    double stretch = pbs_lod_stretch(linear);
    p->wanted =
        (float)(node->size / 2 * pbs_camera_pixel(&c->camera, c->height) / stretch / radius);
    p->unit = (float)(65535 * node->step / radius);
    p->slack = (float)(node->slack / radius);
}

/* Where the looks of surfels come from: normal, colour, material, emission. */
typedef struct looks {
    uint32_t first, stride, count; /* words, words, entries; stride 0: none */
} looks;

static looks octave_of(const pbs_surfels *node, uint64_t octaves, int octave) {
    uint32_t size = (pbs_surfel_size(node->channels) - 8) / 4;
    if (!octaves || !octave || octave > pbs_octaves(node->whole)) return (looks){0, 0, 0};
    uint64_t at = octaves / 4 + pbs_part_octave_begin(node->part, node->whole, octave) * size;
    return (looks){(uint32_t)at, size,
                   (uint32_t)pbs_part_octave_length(node->part, node->whole, octave)};
}

/* at, octaves: bytes in the buffer. */
static void fill(const pbs_canvas *c, const pbs_surfels *node, uint64_t at, uint64_t octaves,
                 node_params *p) {
    uint32_t stride = node->stride ? node->stride : pbs_surfel_size(node->channels);
    uint32_t prefix = node->part.here ? node->part.prefix : node->prefix;
    int k = octaves ? pbs_octave_of(node->whole, prefix) : 0;
    looks fine = octave_of(node, octaves, k), coarse = octave_of(node, octaves, k + 1);
    double between = coarse.stride ? log2((double)node->whole / prefix) / 2 - k : 0;
    place_node(c, node, p);
    p->first = (uint32_t)(at / 4);
    p->stride = stride / 4;
    p->fine = fine.stride ? fine.first : p->first;
    p->fine_stride = fine.stride ? fine.stride : p->stride;
    p->coarse = coarse.first;
    p->coarse_stride = coarse.stride;
    p->coarse_count = coarse.count;
    p->before = node->part.before;
    p->blend = (float)fmin(1, fmax(0, between));
    set_fields(p->fine_field, node->channels, fine.stride != 0);
    set_fields(p->coarse_field, node->channels, true);
}

static pbs_code check(const pbs_surfels *n, pbs_err *err) {
    uint32_t size = pbs_surfel_size(n->channels), stride = n->stride ? n->stride : size;
    if (stride < size || stride % 4 || n->at % 4 || n->octave % 4 || n->prefix > INT32_MAX / 3)
        return pbs_fail(err, PBS_INTERNAL, "surfel records of %u bytes, stride %u", size, stride);
    return PBS_OK;
}

/* A node in the host's memory: as much of it as is drawn goes to the stream buffer. */
static pbs_code stream(pbs_canvas *c, const pbs_surfels *n, uint64_t *octaves, pbs_err *err) {
    uint32_t entry = pbs_surfel_size(n->channels) - 8,
             stride = n->stride ? n->stride : pbs_surfel_size(n->channels);
    const void *piece[2] = {n->records, n->octaves};
    size_t size[2] = {(size_t)n->prefix * stride, 0};
    if (n->octaves) size[1] = pbs_octave_begin(n->whole, 0) * entry;
    *octaves = size[1] ? size[0] : 0;
    return pbs_canvas_stream(c, piece, size, 2, err);
}

static void draw_node(pbs_canvas *c, size_t i, GLuint buffer, uint32_t prefix) {
    pbs_batch_use(c, i);
    c->gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, buffer);
    c->gl->DrawArrays(GL_TRIANGLES, 0, (GLsizei)(3 * prefix));
    c->calls++;
}

static pbs_code draw_streamed(pbs_canvas *c, const pbs_surfels *node, pbs_err *err) {
    uint64_t octaves;
    pbs_code rc = pbs_batch_begin(c, 1, err);
    if (!rc) rc = stream(c, node, &octaves, err);
    if (rc) return rc;
    fill(c, node, 0, octaves, pbs_batch_block(c, 0));
    pbs_batch_send(c, 1);
    draw_node(c, 0, c->stream, node->prefix);
    return PBS_OK;
}

static pbs_code draw_resident(pbs_canvas *c, const pbs_surfels *nodes, size_t count, pbs_err *err) {
    pbs_code rc = pbs_batch_begin(c, count, err);
    if (rc) return rc;
    for (size_t i = 0; i < count; i++)
        fill(c, &nodes[i], nodes[i].at, nodes[i].octave, pbs_batch_block(c, i));
    pbs_batch_send(c, count);
    for (size_t i = 0; i < count; i++) draw_node(c, i, nodes[i].buffer, nodes[i].prefix);
    return PBS_OK;
}

pbs_code pbs_canvas_surfels(pbs_canvas *c, const pbs_surfels *nodes, size_t count, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    pbs_code rc = count ? init(c, err) : PBS_OK;
    if (rc || !count) return rc;
    pbs_canvas_view_uniforms(c, c->disc.program);
    gl->Uniform1f(c->disc.smallest,
                  LEAST_HALF_AXIS * (float)pbs_camera_pixel(&c->camera, c->height));
    gl->Uniform1i(c->disc.samples, c->samples);
    gl->BindVertexArray(c->disc.array);
    for (size_t i = 0; i < count && !rc; i++) rc = check(&nodes[i], err);
    for (size_t i = 0, n; i < count && !rc; i += n) {
        for (n = 0; i + n < count && nodes[i + n].buffer;) n++;
        rc = pbs_run_check(c->run, err);
        if (!rc && n) rc = draw_resident(c, nodes + i, n, err);
        if (!rc && !n) rc = draw_streamed(c, nodes + i, err), n = 1;
    }
    return rc ? rc : pbs_gl_check(gl, "surfels", err);
}
