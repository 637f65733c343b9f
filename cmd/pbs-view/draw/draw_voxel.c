/* draw_voxel.c: voxels as cubes of at most three faces (paper 2, section 4), made on the GPU from
 * the arrays as they are in the file. */
#include "cmd/pbs-view/draw/draw_internal.h"
#include "shaders.h"

enum {
    VERTICES = 7,
    INDICES = 18,
    BATCH = 8192 /* voxels of an instance: the indices of its vertices have 16 bits */
};

/* Near corner 0, its neighbour along axis k 1 + k, and 4 + k the far corner of the face across k,
 * which is last and so gives the triangle its light. */
static pbs_code make_indices(pbs_canvas *c, pbs_err *err) {
    uint16_t *index, *p;
    pbs_code rc = pbs_alloc(c->run, &index, BATCH * INDICES, sizeof *index, "the canvas", err);
    if (rc) return rc;
    p = index;
    for (int i = 0; i < BATCH; i++)
        for (int k = 0; k < 3; k++) {
            int base = VERTICES * i, far = base + 4 + k;
            int a = base + 1 + (k + 1) % 3, b = base + 1 + (k + 2) % 3;
            const int six[6] = {base, a, far, b, base, far};
            for (int j = 0; j < 6; j++) *p++ = (uint16_t)six[j];
        }
    c->gl->NamedBufferData(c->voxel.indices, BATCH * INDICES * sizeof *index, index,
                           GL_STATIC_DRAW);
    pbs_free(c->run, index);
    return PBS_OK;
}

/* As voxel.vert.glsl has it (std140). */
typedef struct node_params {
    float to_view[3][4], normal[3][4];
    float eye[3], hand;
    int32_t look[4], place, face, faces; /* words; -1: absent */
    uint32_t face_count, face_colours, number, pad[2];
} node_params;

static pbs_code make_program(pbs_canvas *c, const char *defines, GLuint *out, GLint *batch_at,
                             pbs_err *err) {
    const pbs_gl_stage stage[2] = {
        {GL_VERTEX_SHADER, {PBS_GLSL_VERSION, shade_glsl, material_glsl, voxel_vert_glsl}},
        {GL_FRAGMENT_SHADER, {PBS_GLSL_VERSION, defines, voxel_frag_glsl}},
    };
    pbs_code rc = pbs_gl_program(c->gl, "voxel", stage, 2, out, err);
    if (!rc) *batch_at = c->gl->GetUniformLocation(*out, "batch");
    return rc;
}

/* When the first voxels are drawn: a shader's compilation is what a short run pays. */
static pbs_code init(pbs_canvas *c, bool noted, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    voxel_painter *p = &c->voxel;
    pbs_code rc = PBS_OK;
    if (noted && !p->probing)
        rc = make_program(c, "#define NOTED\n", &p->probing, &p->note_batch, err);
    if (!noted && !p->program) rc = make_program(c, "", &p->program, &p->batch, err);
    if (rc || p->array) return rc;
    gl->CreateBuffers(1, &p->indices);
    gl->CreateVertexArrays(1, &p->array);
    gl->VertexArrayElementBuffer(p->array, p->indices);
    return make_indices(c, err);
}

void pbs_voxel_painter_free(pbs_canvas *c) {
    const pbs_gl *gl = c->gl;
    gl->DeleteProgram(c->voxel.program);
    gl->DeleteProgram(c->voxel.probing);
    gl->DeleteBuffers(1, &c->voxel.indices);
    gl->DeleteVertexArrays(1, &c->voxel.array);
    gl->DeleteBuffers(1, &c->notes[0].buffer);
    gl->DeleteBuffers(1, &c->notes[1].buffer);
    pbs_free(c->run, c->seen);
}

/* The eye in cells, from where cells are in view coordinates. A transform that presses flat has no
 * inverse; any place sees all of such voxels. */
static void eye_in_cells(float eye[3], const double view[12]) {
    double cofactor[9], det = pbs_xform_det(view);
    pbs_xform_cofactor(cofactor, view);
    for (int k = 0; k < 3; k++) {
        double sum = 0;
        for (int r = 0; r < 3; r++) sum -= cofactor[3 * r + k] * view[4 * r + 3];
        eye[k] = isfinite(sum / det) ? (float)(sum / det) : -1e6f;
    }
}

static void place_node(const pbs_canvas *c, const pbs_cubes *node, node_params *p) {
    double s = node->side, view[12];
    double cells[12] = {s, 0, 0, node->corner[0], 0, s, 0, node->corner[1],
                        0, 0, s, node->corner[2]};
    /* In this order the corner, far from the origin as it may be, is added in double. */
    pbs_xform_mul(cells, node->m, cells);
    pbs_camera_place(view, &c->camera, cells);
    eye_in_cells(p->eye, view);
    pbs_rows(p->to_view, view, 1);
    pbs_normal_rows(p->normal, view);
    p->hand = pbs_xform_det(view) < 0 ? -1 : 1;
}

static int32_t behind(int32_t array, uint64_t words) {
    return array < 0 ? -1 : array + (int32_t)words;
}

static void fill(const pbs_canvas *c, const pbs_cubes *n, uint64_t done, uint32_t number,
                 node_params *p) {
    uint64_t at = n->at / 4 + done;
    place_node(c, n, p);
    p->place = behind(n->place, at);
    p->look[0] = behind(n->normal, at);
    p->look[1] = behind(n->colour, at);
    p->look[2] = behind(n->material, at);
    p->look[3] = behind(n->emissive, at);
    p->face = behind(n->face_count ? n->face : -1, at);
    p->faces = behind(n->faces, (n->faces_buffer ? n->faces_at : n->at) / 4);
    p->face_count = n->face_count;
    p->face_colours = n->face_colours;
    p->number = number;
}

static void draw_part(pbs_canvas *c, size_t i, const pbs_cubes *node, uint32_t voxels,
                      uint32_t instances) {
    GLuint faces = node->faces_buffer ? node->faces_buffer : node->buffer;
    if (!voxels || !instances) return;
    pbs_batch_use(c, i);
    c->gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, node->buffer);
    c->gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 1, faces);
    c->gl->DrawElementsInstanced(GL_TRIANGLES, (GLsizei)(voxels * INDICES), GL_UNSIGNED_SHORT, NULL,
                                 (GLsizei)instances);
    c->calls++;
}

/* Whole instances of a node's voxels, and what is left, are two draws. */
static pbs_code draw_resident(pbs_canvas *c, const pbs_cubes *nodes, size_t count, uint32_t number,
                              pbs_err *err) {
    pbs_code rc = pbs_batch_begin(c, 2 * count, err);
    if (rc) return rc;
    for (size_t i = 0; i < count; i++) {
        if (i && !nodes[i].again) number++;
        fill(c, &nodes[i], 0, number, pbs_batch_block(c, 2 * i));
        fill(c, &nodes[i], nodes[i].count / BATCH * BATCH, number, pbs_batch_block(c, 2 * i + 1));
    }
    pbs_batch_send(c, 2 * count);
    for (size_t i = 0; i < count; i++) {
        draw_part(c, 2 * i, &nodes[i], BATCH, nodes[i].count / BATCH);
        draw_part(c, 2 * i + 1, &nodes[i], nodes[i].count % BATCH, 1);
    }
    return PBS_OK;
}

/* Voxels of the host's memory, through the stream buffer. */
static pbs_code draw_streamed(pbs_canvas *c, const pbs_cubes *node, uint32_t number, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < node->chunk_count && !rc; i++) {
        const pbs_voxels *v = &node->chunks[i];
        const void *piece[5] = {v->place, v->normal, v->colour, v->material, v->emissive};
        pbs_cubes n = *node;
        int32_t *at[5] = {&n.place, &n.normal, &n.colour, &n.material, &n.emissive}, words = 0;
        size_t size[5];
        for (int k = 0; k < 5; k++) {
            size[k] = piece[k] ? 4 * v->count : 0;
            *at[k] = piece[k] ? words : -1;
            words += piece[k] ? (int32_t)v->count : 0;
        }
        n.buffer = c->stream;
        n.at = n.face_count = 0;
        n.count = (uint32_t)v->count;
        rc = pbs_canvas_stream(c, piece, size, 5, err);
        if (!rc) rc = draw_resident(c, &n, 1, number, err);
    }
    return rc;
}

/* ---- what is seen ---- */

static pbs_code start_notes(pbs_canvas *c, const pbs_voxel_mode *mode, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    static const uint32_t none = 0;
    notes *n = &c->notes[mode->frame % 2];
    if (n->frame != mode->frame) {
        if (!n->buffer) gl->CreateBuffers(1, &n->buffer);
        if (n->room < mode->all) {
            n->room = mode->all + mode->all / 2 + 64;
            gl->NamedBufferData(n->buffer, (GLsizeiptr)n->room * 4, NULL, GL_DYNAMIC_READ);
        }
        gl->MemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT); /* nobody may have read it */
        gl->ClearNamedBufferData(n->buffer, GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, &none);
        n->frame = mode->frame;
        n->count = mode->all;
    }
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 2, n->buffer);
    return pbs_gl_check(gl, "notes of what is seen", err);
}

pbs_code pbs_canvas_seen(pbs_canvas *c, bool last, uint64_t *frame, const uint32_t **seen,
                         size_t *count, pbs_err *err) {
    const notes *a = &c->notes[0], *b = &c->notes[1];
    const notes *n = (a->frame > b->frame) == last ? a : b;
    *frame = n->frame;
    *count = n->count;
    pbs_code rc = pbs_grow(c->run, &c->seen, &c->seen_cap, n->count + 1, sizeof *c->seen,
                           "the list of what is seen", err);
    if (rc || !n->frame || !n->count) return rc;
    c->gl->MemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
    c->gl->GetNamedBufferSubData(n->buffer, 0, (GLsizeiptr)n->count * 4, c->seen);
    *seen = c->seen;
    return pbs_gl_check(c->gl, "notes of what is seen", err);
}

static void write_to(const pbs_gl *gl, bool all) {
    GLboolean on = all ? GL_TRUE : GL_FALSE;
    gl->ColorMask(on, on, on, on);
    gl->DepthMask(on);
}

pbs_code pbs_canvas_voxels(pbs_canvas *c, const pbs_cubes *nodes, size_t count,
                           const pbs_voxel_mode *mode, pbs_err *err) {
    static const pbs_voxel_mode plain;
    const pbs_gl *gl = c->gl;
    if (!mode) mode = &plain;
    bool noted = mode->frame != 0;
    pbs_code rc = noted ? start_notes(c, mode, err) : PBS_OK;
    if (rc || !count) return rc;
    rc = init(c, noted, err);
    if (!rc) rc = pbs_canvas_palette(c, &mode->palette, err);
    if (rc) return rc;
    pbs_canvas_view_uniforms(c, noted ? c->voxel.probing : c->voxel.program);
    gl->Uniform1ui(noted ? c->voxel.note_batch : c->voxel.batch, BATCH);
    gl->BindVertexArray(c->voxel.array);
    if (mode->probes) write_to(gl, false);
    uint32_t number = mode->first;
    for (size_t i = 0, n; i < count && !rc; i += n) {
        for (n = 0; i + n < count && nodes[i + n].buffer;) n++;
        rc = pbs_run_check(c->run, err);
        if (!rc && n) rc = draw_resident(c, nodes + i, n, number, err);
        if (!rc && !n) rc = draw_streamed(c, nodes + i, number, err), n = 1;
        for (size_t k = i + 1; k <= i + n && k < count; k++) number += !nodes[k].again;
    }
    if (mode->probes) write_to(gl, true);
    return rc ? rc : pbs_gl_check(gl, "voxels", err);
}
